//! Things on the table, seen from above, to scale.
//!
//! Frames: world (or any one plane), x to the right and y up. Units: m; the axes show millimetres where that reads
//! better.
//! Errors: none; what has a coordinate that is not finite is left out.

use nalgebra::{Point2, Vector2};

use super::axis::{DOT_RADIUS, Frame, Heading, Key, Range, TEXT_SIZE, draw_arrow};
use super::figure::Panel;
use super::page::{Anchor, Area, Page, PagePoint, Text};
use super::style::{Colour, Stroke, Style};

/// Free space around what is shown, as a share of its larger extent.
const PADDING: f64 = 0.04;

/// Least extent of what is shown, m: without it a single point would have none.
const EXTENT_MIN_M: f64 = 1e-9;

/// What is smaller than this is labelled in millimetres, m.
const MILLIMETRES_BELOW_M: f64 = 2.0;

/// Distance of a label from its point.
const LABEL_GAP: f64 = 8.0;

/// A picture of the table.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate_cli::pictures::plot::{Colour, Figure, Key, PlotScene, Stroke, Style};
///
/// let mut scene = PlotScene::new("A finger against a block");
/// let block = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from); // m
/// scene.polygon(&block, Style::area(Colour::SKY_BLUE, 0.3).outlined(Stroke::solid(Colour::BLUE, 1.5)));
/// scene.disk(Point2::new(0.03, -0.015), 0.015, Stroke::solid(Colour::BLACK, 1.5));
/// scene.arrow(Point2::new(0.03, 0.0), Vector2::new(0.0, 0.01), Colour::VERMILLION);
/// scene.key(Key::Arrow(Colour::VERMILLION), "force on the part");
/// let svg = Figure::new("block", 480.0, 360.0).column(1.0, vec![scene.into()]).to_page().to_svg();
/// assert!(svg.starts_with("<svg"));
/// ```
#[derive(Clone, Debug)]
pub struct PlotScene {
    heading: Heading,
    axes: Axes,
    marks: Vec<Mark>,
}

/// What the axes of a scene are called.
#[derive(Clone, Debug)]
enum Axes {
    Lengths([String; 2]),
    /// What is shown has no lengths: a graph, or things seen at an angle.
    None,
}

#[derive(Clone, Debug)]
enum Mark {
    Path { points: Vec<Point2<f64>>, closed: bool, style: Style },
    Disk { centre: Point2<f64>, radius: f64, style: Style },
    Arrow { tail: Point2<f64>, tip: Point2<f64>, colour: Colour },
    Dot { at: Point2<f64>, colour: Colour },
    Label(Label),
}

/// A text beside a point.
#[derive(Clone, Debug)]
struct Label {
    at: Point2<f64>,
    toward: Vector2<f64>,
    text: String,
    colour: Colour,
    /// Left out where there is no room for it.
    optional: bool,
}

impl Mark {
    /// The least box around it: lower left and upper right corner.
    fn corners(&self) -> Vec<Point2<f64>> {
        match self {
            Self::Path { points, .. } => points.clone(),
            Self::Disk { centre, radius, .. } => {
                let reach = Vector2::new(*radius, *radius);
                vec![centre - reach, centre + reach]
            }
            Self::Arrow { tail, tip, .. } => vec![*tail, *tip],
            Self::Dot { at, .. } | Self::Label(Label { at, .. }) => vec![*at],
        }
    }
}

impl PlotScene {
    /// An empty scene; the title may be empty.
    #[must_use]
    pub fn new(title: impl Into<String>) -> Self {
        let axes = Axes::Lengths(["x", "y"].map(str::to_owned));
        Self { heading: Heading { title: title.into(), ..Heading::default() }, axes, marks: Vec::new() }
    }

    /// The scene with its axes, lengths across and up, called so.
    #[must_use]
    pub fn with_axes(self, [across, up]: [&str; 2]) -> Self {
        Self { axes: Axes::Lengths([across.to_owned(), up.to_owned()]), ..self }
    }

    /// The scene without axes, for what has no lengths.
    #[must_use]
    pub fn without_axes(self) -> Self {
        Self { axes: Axes::None, ..self }
    }

    /// Adds a closed outline, m.
    pub fn polygon(&mut self, vertices: &[Point2<f64>], style: impl Into<Style>) {
        self.marks.push(Mark::Path { points: vertices.to_vec(), closed: true, style: style.into() });
    }

    /// A line through points.
    pub fn polyline(&mut self, points: &[Point2<f64>], stroke: Stroke) {
        self.marks.push(Mark::Path { points: points.to_vec(), closed: false, style: stroke.into() });
    }

    /// A disk of this radius, m.
    pub fn disk(&mut self, centre: Point2<f64>, radius: f64, style: impl Into<Style>) {
        self.marks.push(Mark::Disk { centre, radius, style: style.into() });
    }

    /// An arrow from a point along a vector, which the caller has scaled to metres.
    pub fn arrow(&mut self, tail: Point2<f64>, vector: Vector2<f64>, colour: Colour) {
        self.marks.push(Mark::Arrow { tail, tip: tail + vector, colour });
    }

    /// Adds a dot at a point, m.
    pub fn dot(&mut self, at: Point2<f64>, colour: Colour) {
        self.marks.push(Mark::Dot { at, colour });
    }

    /// A text beside a point, on the side that `toward` points to, or on another where an earlier one is in the way;
    /// over the point where `toward` is zero.
    pub fn label(&mut self, at: Point2<f64>, toward: Vector2<f64>, text: impl Into<String>, colour: Colour) {
        self.marks.push(Mark::Label(Label { at, toward, text: text.into(), colour, optional: false }));
    }

    /// Points along a path, each with the time (s) at which it was reached, written on the side that `toward` points to
    /// or opposite. Of points too close for that only the first and last have their times.
    pub fn time_marks(&mut self, marks: &[(f64, Point2<f64>)], toward: Vector2<f64>, colour: Colour) {
        marks.iter().for_each(|&(_, at)| self.dot(at, colour));
        let label = |&(time, at): &(f64, Point2<f64>), optional| {
            Mark::Label(Label { at, toward, text: time_text(time), colour, optional })
        };
        // The first and last come first, so that those between give way to them.
        let ends = [marks.first(), marks.last().filter(|_| marks.len() > 1)].into_iter().flatten();
        self.marks.extend(ends.map(|mark| label(mark, false)));
        let between = marks.iter().skip(1).take(marks.len().saturating_sub(2));
        self.marks.extend(between.map(|mark| label(mark, true)));
    }

    /// An entry of the legend.
    pub fn key(&mut self, key: Key, name: impl Into<String>) {
        self.heading.legend.entries.push((key, name.into()));
    }

    /// Writes the labels, each clear of dots and of those before it where it can be.
    fn draw_labels(&self, page: &mut Page, frame: &Frame) {
        let mut taken: Vec<Area> = self.marks.iter().filter_map(|mark| dot_area(frame, mark)).collect();
        let labels =
            self.marks.iter().filter_map(|mark| if let Mark::Label(label) = mark { Some(label) } else { None });
        for label in labels {
            if let Some(text) = label.fitted(frame, &taken) {
                taken.push(text.area());
                page.text(text);
            }
        }
    }

    /// The part of the plane that an area shows: all marks, to one scale in both directions.
    fn frame(&self, area: Area) -> Frame {
        let corners: Vec<_> = self.marks.iter().flat_map(Mark::corners).collect();
        let range = |axis: usize| Range::of(corners.iter().map(|corner| corner[axis])).at_least(EXTENT_MIN_M);
        let (x, y) = (range(0), range(1));
        let padding = PADDING * x.span().max(y.span());
        let (x, y) = (x.padded(padding), y.padded(padding));
        let metres_per_unit = (x.span() / area.width).max(y.span() / area.height);
        Frame { area, x: x.at_least(metres_per_unit * area.width), y: y.at_least(metres_per_unit * area.height) }
    }
}

/// A time as time marks show it, to the hundredth of a second.
fn time_text(time: f64) -> String {
    let text = format!("{time:.2}");
    let short = text.strip_suffix('0').unwrap_or(&text);
    format!("{short} s")
}

impl Panel for PlotScene {
    fn draw(&self, page: &mut Page, panel: Area) {
        let frame = self.frame(self.heading.draw(page, panel));
        let millimetres = frame.x.span().min(frame.y.span()) < MILLIMETRES_BELOW_M;
        let (unit, metres) = if millimetres { ("mm", 1e-3) } else { ("m", 1.0) };
        match &self.axes {
            Axes::Lengths(names) => {
                let [across, up] = names.each_ref().map(|name| format!("{name} [{unit}]"));
                frame.draw(page, [&across, &up], metres);
            }
            Axes::None => frame.draw_edge(page),
        }
        self.marks.iter().for_each(|mark| draw_mark(page, &frame, mark));
        self.draw_labels(page, &frame);
    }
}

fn draw_mark(page: &mut Page, frame: &Frame, mark: &Mark) {
    let place = |point: &Point2<f64>| frame.place(point.x, point.y);
    match mark {
        Mark::Path { points, closed, style } => {
            page.path(&points.iter().map(place).collect::<Vec<_>>(), *closed, *style);
        }
        Mark::Disk { centre, radius, style } => {
            page.circle(place(centre), radius / frame.x.span() * frame.area.width, *style);
        }
        Mark::Arrow { tail, tip, colour } => draw_arrow(page, [place(tail), place(tip)], *colour),
        Mark::Dot { at, colour } => {
            let style = Style::area(*colour, 1.0).outlined(Stroke::solid(Colour::WHITE, 1.0));
            page.circle(place(at), DOT_RADIUS, style);
        }
        // These come last, on top of everything: see `draw_labels`.
        Mark::Label(_) => {}
    }
}

/// What a dot covers.
fn dot_area(frame: &Frame, mark: &Mark) -> Option<Area> {
    let Mark::Dot { at, .. } = mark else { return None };
    let PagePoint { x, y } = frame.place(at.x, at.y);
    let width = 2.0 * DOT_RADIUS;
    Some(Area { left: x - DOT_RADIUS, top: y - DOT_RADIUS, width, height: width })
}

impl Label {
    /// Its text on the first side where nothing is in the way, within the frame if it can be; where there is none, on the side it is meant for, or
    /// nowhere if it is optional.
    fn fitted(&self, frame: &Frame, taken: &[Area]) -> Option<Text> {
        let across = Vector2::new(self.toward.y, -self.toward.x);
        let sides = [self.toward, -self.toward, across, -across];
        let sides = if self.optional { &sides[..2] } else { &sides[..] };
        let free = |text: &Text| !taken.iter().any(|area| area.overlaps(text.area()));
        let inside = |text: &Text| frame.area.holds(text.area());
        let fitting =
            |is_good: &dyn Fn(&Text) -> bool| sides.iter().map(|side| self.beside(frame, *side)).find(is_good);
        let found = fitting(&|text| free(text) && inside(text)).or_else(|| fitting(&free));
        found.or_else(|| (!self.optional).then(|| self.beside(frame, self.toward)))
    }

    /// Its text on one side of its point, held at the end or middle that keeps it clear of the point.
    fn beside(&self, frame: &Frame, toward: Vector2<f64>) -> Text {
        let direction = toward.try_normalize(0.0).unwrap_or_default();
        let anchor = match direction.x {
            x if x > 0.4 => Anchor::Start,
            x if x < -0.4 => Anchor::End,
            _ => Anchor::Middle,
        };
        // Above or below, the text's own height comes on top of the gap.
        let gap = [LABEL_GAP * direction.x, -(LABEL_GAP + 0.4 * TEXT_SIZE * direction.y.abs()) * direction.y];
        let at = frame.place(self.at.x, self.at.y).moved(gap[0], gap[1]);
        Text { halo: true, ..Text::new(self.text.clone(), at, TEXT_SIZE, self.colour).anchored(anchor) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA: Area = Area { left: 10.0, top: 20.0, width: 400.0, height: 200.0 };

    fn block() -> PlotScene {
        let mut scene = PlotScene::new("");
        scene.polygon(&[[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]].map(Point2::from), Style::default());
        scene
    }

    #[test]
    fn a_scene_is_to_scale_and_upright() {
        let frame = block().frame(AREA);
        let [origin, right, up] = [[0.0, 0.0], [0.1, 0.0], [0.0, 0.1]].map(|[x, y]| frame.place(x, y));
        assert!((right.x - origin.x - (origin.y - up.y)).abs() < 1e-9, "{origin:?} {right:?} {up:?}");
        assert!(up.y < origin.y && right.x > origin.x);
        // The block's height is what limits: it fills the area but for the padding.
        assert!(((origin.y - up.y) - 200.0 / (1.0 + 2.0 * PADDING)).abs() < 1e-9);
    }

    #[test]
    fn what_is_not_finite_is_left_out() {
        let mut scene = block();
        let bounds = scene.frame(AREA);
        scene.polyline(&[Point2::new(f64::NAN, 0.0), Point2::new(0.05, 0.05)], Stroke::solid(Colour::BLACK, 1.0));
        scene.arrow(Point2::new(0.05, 0.05), Vector2::new(f64::INFINITY, 0.0), Colour::BLACK);
        assert_eq!(scene.frame(AREA), bounds);
        let mut page = Page::new(500.0, 300.0, "");
        let area = page.area();
        scene.draw(&mut page, area);
        let svg = page.to_svg();
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }

    #[test]
    fn labels_get_out_of_each_others_way() {
        let mut scene = block();
        for k in 0..3 {
            scene.label(Point2::new(0.05, 0.05 + 1e-4 * f64::from(k)), Vector2::x(), "one and the same", Colour::BLACK);
        }
        let mut page = Page::new(500.0, 300.0, "");
        let area = page.area();
        scene.draw(&mut page, area);
        let labels: Vec<Area> = page.texts().filter(|text| text.text == "one and the same").map(Text::area).collect();
        assert_eq!(labels.len(), 3);
        for (i, label) in labels.iter().enumerate() {
            assert!(!labels[..i].iter().any(|other| other.overlaps(*label)), "{labels:?}");
        }
    }

    #[test]
    fn times_of_crowded_points_are_left_out_but_for_the_first_and_last() {
        let mut scene = block();
        let marks: Vec<_> = (0..50).map(f64::from).map(|k| (0.1 * k, Point2::new(0.05 + 1e-4 * k, 0.05))).collect();
        scene.time_marks(&marks, Vector2::y(), Colour::GREEN);
        let mut page = Page::new(500.0, 300.0, "");
        let area = page.area();
        scene.draw(&mut page, area);
        let times: Vec<&Text> = page.texts().filter(|text| text.text.ends_with(" s")).collect();
        assert!(times.iter().any(|text| text.text == "0.0 s") && times.iter().any(|text| text.text == "4.9 s"));
        assert!(times.len() < 10, "{times:?}");
    }

    #[test]
    fn an_empty_scene_and_a_single_point_can_be_drawn() {
        let mut scene = PlotScene::new("nothing");
        for _ in 0..2 {
            let mut page = Page::new(300.0, 200.0, "");
            let area = page.area();
            scene.draw(&mut page, area);
            assert!(page.to_png().is_ok());
            scene.dot(Point2::new(0.2, 0.3), Colour::BLACK);
        }
    }
}
