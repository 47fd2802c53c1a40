//! Curves over a plane of two quantities: time series, tables.
//!
//! Units: the caller's, named in the axis labels. Errors: none; a curve has a gap where a point is not finite.

use super::axis::{DOT_RADIUS, Frame, Heading, Key, Range, TEXT_SIZE};
use super::figure::Panel;
use super::page::{Anchor, Area, Page, PagePoint, Text};
use super::style::{Colour, Dash, Stroke, Style};

/// Free space above and below the curves, as a share of their extent.
const PADDING: f64 = 0.06;

/// Free space beside dots, so that the outermost are whole.
const DOTS_PADDING: f64 = 0.03;

/// Distance of a level's label from its line.
const LEVEL_GAP: f64 = 9.0;

/// Opacity of a band.
const BAND_OPACITY: f64 = 0.25;

/// A chart of y over x.
///
/// ```
/// use palpate_cli::pictures::plot::{Chart, Colour, Figure, Stroke};
///
/// let mut chart = Chart::new("contact angle", ["time [s]", "u [°]"]);
/// chart.curve("felt", &[[0.0, 30.0], [0.5, 31.5], [1.0, 34.0]], Stroke::solid(Colour::BLUE, 1.5));
/// chart.level(32.0, "expected");
/// let page = Figure::new("contact angle", 480.0, 240.0).column(1.0, vec![chart.into()]).to_page();
/// assert!(page.to_png()?.starts_with(b"\x89PNG"));
/// # Ok::<(), palpate_cli::pictures::plot::PlotError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Chart {
    heading: Heading,
    labels: [String; 2],
    series: Vec<Series>,
    levels: Vec<(f64, String)>,
    instants: Vec<(f64, String)>,
    y_span_min: f64,
}

#[derive(Clone, Debug)]
enum Series {
    Curve {
        points: Vec<[f64; 2]>,
        stroke: Stroke,
    },
    Dots {
        points: Vec<[f64; 2]>,
        colour: Colour,
    },
    /// x, lower y, upper y.
    Band {
        points: Vec<[f64; 3]>,
        colour: Colour,
    },
}

impl Series {
    fn x(&self) -> Vec<f64> {
        match self {
            Self::Curve { points, .. } | Self::Dots { points, .. } => points.iter().map(|point| point[0]).collect(),
            Self::Band { points, .. } => points.iter().map(|point| point[0]).collect(),
        }
    }

    fn y(&self) -> Vec<f64> {
        match self {
            Self::Curve { points, .. } | Self::Dots { points, .. } => points.iter().map(|point| point[1]).collect(),
            Self::Band { points, .. } => points.iter().flat_map(|point| [point[1], point[2]]).collect(),
        }
    }
}

impl Chart {
    /// An empty chart with its title, which may be empty, and the names of x and y with their units.
    #[must_use]
    pub fn new(title: impl Into<String>, labels: [&str; 2]) -> Self {
        Self {
            heading: Heading { title: title.into(), ..Heading::default() },
            labels: labels.map(str::to_owned),
            series: Vec::new(),
            levels: Vec::new(),
            instants: Vec::new(),
            y_span_min: 0.0,
        }
    }

    /// A line through points; in the legend if it has a name.
    pub fn curve(&mut self, name: &str, points: &[[f64; 2]], stroke: Stroke) {
        self.named(name, Key::Line(stroke));
        self.series.push(Series::Curve { points: points.to_vec(), stroke });
    }

    /// A dot at each point; in the legend if it has a name.
    pub fn dots(&mut self, name: &str, points: &[[f64; 2]], colour: Colour) {
        self.named(name, Key::Dot(colour));
        self.series.push(Series::Dots { points: points.to_vec(), colour });
    }

    /// The area between two lines, given as x, lower y and upper y; in the legend if it has a name.
    pub fn band(&mut self, name: &str, points: &[[f64; 3]], colour: Colour) {
        self.named(name, Key::Area(Style::area(colour, BAND_OPACITY)));
        self.series.push(Series::Band { points: points.to_vec(), colour });
    }

    /// A labelled line across the chart; the chart reaches to it.
    pub fn level(&mut self, y: f64, label: impl Into<String>) {
        self.levels.push((y, label.into()));
    }

    /// A labelled line up the chart, if `x` is within what the curves cover.
    pub fn instant(&mut self, x: f64, label: impl Into<String>) {
        self.instants.push((x, label.into()));
    }

    /// Keeps rounding errors from filling the chart: y covers at least this.
    pub fn y_span_at_least(&mut self, span: f64) {
        self.y_span_min = span;
    }

    fn named(&mut self, name: &str, key: Key) {
        if !name.is_empty() {
            self.heading.legend.entries.push((key, name.to_owned()));
        }
    }

    fn frame(&self, area: Area) -> Frame {
        let x = Range::of(self.series.iter().flat_map(Series::x)).at_least(0.0);
        let has_dots = self.series.iter().any(|series| matches!(series, Series::Dots { .. }));
        let x = if has_dots { x.padded(DOTS_PADDING * x.span()) } else { x };
        let levels = self.levels.iter().map(|(y, _)| *y);
        let y = Range::of(self.series.iter().flat_map(Series::y).chain(levels)).at_least(self.y_span_min);
        Frame { area, x, y: y.padded(PADDING * y.span()) }
    }
}

impl Panel for Chart {
    fn draw(&self, page: &mut Page, panel: Area) {
        let frame = self.frame(self.heading.draw(page, panel));
        frame.draw(page, [&self.labels[0], &self.labels[1]], 1.0);
        self.levels.iter().for_each(|(y, _)| draw_level(page, &frame, *y));
        self.series.iter().for_each(|series| draw_series(page, &frame, series));
        for (x, label) in self.instants.iter().filter(|(x, _)| (frame.x.low..=frame.x.high).contains(x)) {
            draw_instant(page, &frame, *x, label);
        }
        self.levels.iter().for_each(|(y, label)| label_level(page, &frame, *y, label));
    }
}

fn draw_level(page: &mut Page, frame: &Frame, y: f64) {
    let ends = [frame.place(frame.x.low, y), frame.place(frame.x.high, y)];
    page.path(&ends, false, Stroke::solid(Colour::GREY, 1.0).with(Dash::Dashed));
}

/// Writes a level's label on the side of its line that has more room.
fn label_level(page: &mut Page, frame: &Frame, y: f64, label: &str) {
    let upper_half = y > 0.5 * (frame.y.low + frame.y.high);
    let at = frame.place(frame.x.low, y).moved(6.0, if upper_half { LEVEL_GAP } else { -LEVEL_GAP });
    page.text(Text { halo: true, ..Text::new(label, at, TEXT_SIZE - 1.0, Colour::DARK_GREY) });
}

fn draw_instant(page: &mut Page, frame: &Frame, x: f64, label: &str) {
    let top = frame.place(x, frame.y.high);
    page.path(&[frame.place(x, frame.y.low), top], false, Stroke::solid(Colour::GREY, 1.0).with(Dash::Dotted));
    // Toward the middle, so that it stays within the frame.
    let left_half = x < 0.5 * (frame.x.low + frame.x.high);
    let (anchor, gap) = if left_half { (Anchor::Start, 5.0) } else { (Anchor::End, -5.0) };
    let text = Text::new(label, top.moved(gap, 10.0), TEXT_SIZE - 1.0, Colour::DARK_GREY).anchored(anchor);
    page.text(Text { halo: true, ..text });
}

fn draw_series(page: &mut Page, frame: &Frame, series: &Series) {
    match series {
        Series::Curve { points, stroke } => {
            let places: Vec<_> = points.iter().map(|&[x, y]| frame.place(x, y)).collect();
            let pieces = places.split(|place| !(place.x.is_finite() && place.y.is_finite()));
            pieces.for_each(|piece| page.path(piece, false, *stroke));
        }
        Series::Dots { points, colour } => {
            let dot = |&[x, y]: &[f64; 2]| page.circle(frame.place(x, y), DOT_RADIUS, Style::area(*colour, 1.0));
            points.iter().for_each(dot);
        }
        Series::Band { points, colour } => {
            let finite = |point: &[f64; 3]| point.iter().all(|value| value.is_finite());
            let pieces = points.split(|point| !finite(point));
            pieces.for_each(|piece| page.path(&band(frame, piece), true, Style::area(*colour, BAND_OPACITY)));
        }
    }
}

/// The outline of a band: along its lower side and back along the upper.
fn band(frame: &Frame, points: &[[f64; 3]]) -> Vec<PagePoint> {
    let lower = points.iter().map(|&[x, low, _]| frame.place(x, low));
    let upper = points.iter().rev().map(|&[x, _, high]| frame.place(x, high));
    lower.chain(upper).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::plot::page::Item;

    fn paths(chart: &Chart) -> usize {
        let mut page = Page::new(400.0, 200.0, "");
        let area = page.area();
        chart.draw(&mut page, area);
        page.items.iter().filter(|item| matches!(item, Item::Path { .. })).count()
    }

    #[test]
    fn a_curve_has_a_gap_where_a_point_is_missing() {
        let stroke = Stroke::solid(Colour::BLUE, 1.0);
        let chart = |middle: f64| {
            let mut chart = Chart::new("", ["x", "y"]);
            chart.curve("", &[[0.0, 0.0], [1.0, 1.0], [2.0, middle], [3.0, 1.0], [4.0, 2.0]], stroke);
            chart
        };
        assert_eq!(paths(&chart(f64::NAN)), paths(&chart(1.0)) + 1);
    }

    #[test]
    fn a_constant_is_shown_in_the_middle_and_not_as_its_rounding() {
        let mut chart = Chart::new("", ["x", "y"]);
        chart.curve("", &[[0.0, 1e-17], [1.0, -1e-17]], Stroke::solid(Colour::BLUE, 1.0));
        chart.y_span_at_least(2.0);
        let frame = chart.frame(Area { left: 0.0, top: 0.0, width: 100.0, height: 100.0 });
        assert!((frame.place(0.0, 1e-17).y - 50.0).abs() < 1e-6);
        assert!(frame.y.high > 1.0 && frame.y.low < -1.0);
    }

    #[test]
    fn levels_are_within_the_chart() {
        let mut chart = Chart::new("", ["x", "y"]);
        chart.curve("", &[[0.0, 0.0], [1.0, 1.0]], Stroke::solid(Colour::BLUE, 1.0));
        chart.level(5.0, "limit");
        assert!(chart.frame(Area { left: 0.0, top: 0.0, width: 100.0, height: 100.0 }).y.high > 5.0);
    }
}
