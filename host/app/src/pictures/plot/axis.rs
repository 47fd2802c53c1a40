//! Round numbers along an axis, and a frame with them.

use super::page::{Anchor, Area, Margins, Page, PagePoint, Text};
use super::style::{Colour, Stroke, Style};

/// Height of the font of tick labels, axis labels and legends.
pub(super) const TEXT_SIZE: f64 = 12.0;

/// Height of the font of a panel's title.
pub(super) const TITLE_SIZE: f64 = 14.0;

/// Space for a line of the title or the legend.
pub(super) const LINE_HEIGHT: f64 = 20.0;

/// Room around a frame for tick and axis labels.
pub(super) const FRAME_MARGINS: Margins = Margins { left: 64.0, top: 8.0, right: 14.0, bottom: 44.0 };

/// Length of a tick, and its distance from its label.
const TICK_LENGTH: f64 = 5.0;

/// Page units that a tick of the horizontal and of the vertical axis needs, so that labels stay apart.
const TICK_SPACE: [f64; 2] = [55.0, 30.0];

/// A tick this share of a step beyond its range is put down to rounding: 0.3 is 5.999… steps of 0.05.
const ROUNDING_STEPS: f64 = 1e-9;

/// Numbers from here on, or steps below the other, are written with a power of ten beside the axis.
const PLAIN_MAX: f64 = 1e5;
const PLAIN_STEP_MIN: f64 = 1e-4;

/// A range of numbers along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Range {
    pub(super) low: f64,
    pub(super) high: f64,
}

impl Range {
    /// The least range with all these numbers that are finite; from 0 to 1 without any.
    pub(super) fn of(values: impl IntoIterator<Item = f64>) -> Self {
        let finite = values.into_iter().filter(|value| value.is_finite());
        let none = Self { low: f64::INFINITY, high: f64::NEG_INFINITY };
        let range = finite.fold(none, |range, value| Self { low: range.low.min(value), high: range.high.max(value) });
        if range.low <= range.high { range } else { Self { low: 0.0, high: 1.0 } }
    }

    pub(super) fn span(self) -> f64 {
        self.high - self.low
    }

    /// The range about the same middle, this much wider on each side.
    pub(super) fn padded(self, by: f64) -> Self {
        Self { low: self.low - by, high: self.high + by }
    }

    /// The range about the same middle, at least so wide. A range too narrow for its own numbers' rounding is widened
    /// too.
    pub(super) fn at_least(self, span: f64) -> Self {
        let rounding = 1e-9 * self.low.abs().max(self.high.abs());
        let span = span.max(rounding).max(f64::MIN_POSITIVE);
        if self.span() < span { self.padded(0.5 * (span - self.span())) } else { self }
    }
}

/// The ticks of an axis.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Ticks {
    /// Where, and what is written there.
    pub(super) ticks: Vec<(f64, String)>,
    /// The power of ten that what is written must be multiplied by.
    pub(super) exponent: Option<i32>,
}

impl Ticks {
    /// Multiples of 1, 2 or 5 times a power of ten in a range, about `count_max` at most.
    pub(super) fn new(range: Range, count_max: f64) -> Self {
        let step = round_step(range.span() / count_max.max(1.0));
        let largest = range.low.abs().max(range.high.abs());
        let plain = largest < PLAIN_MAX && step >= PLAIN_STEP_MIN;
        let exponent = (!plain).then(|| floor_log10(largest));
        let unit = 10_f64.powi(exponent.unwrap_or(0));
        let decimals = usize::try_from(-floor_log10(step / unit)).unwrap_or(0);
        let first = (range.low / step - ROUNDING_STEPS).ceil();
        let last = (range.high / step + ROUNDING_STEPS).floor();
        let multiples = std::iter::successors(Some(first), |k| Some(k + 1.0)).take_while(|k| *k <= last);
        let tick = |k: f64| (k * step, signed(&format!("{:.decimals$}", k * step / unit)));
        Self { ticks: multiples.map(tick).collect(), exponent }
    }

    /// An axis label with the power of ten.
    fn label(&self, label: &str) -> String {
        let superscript = |exponent: i32| exponent.to_string().chars().map(raised).collect::<String>();
        self.exponent.map_or_else(|| label.to_owned(), |exponent| format!("{label}, in 10{}", superscript(exponent)))
    }
}

/// The least of 1, 2 and 5 times a power of ten that is not below this.
fn round_step(least: f64) -> f64 {
    let power = 10_f64.powi(floor_log10(least));
    // The slack lets 0.2 be a step for 0.2000…01.
    let fits = |multiple: &f64| multiple * power >= least * (1.0 - 1e-9);
    [1.0, 2.0, 5.0].into_iter().find(fits).unwrap_or(10.0) * power
}

#[expect(clippy::cast_possible_truncation, reason = "the logarithm of an f64 is within ±324")]
fn floor_log10(value: f64) -> i32 {
    // The slack lets 10⁻³ have the logarithm −3, whichever way it was rounded.
    (value.max(f64::MIN_POSITIVE).log10() + 1e-9).floor() as i32
}

/// A number with a real minus sign, and none before zero.
fn signed(text: &str) -> String {
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| c == '0' || c == '.') => zero.to_owned(),
        Some(magnitude) => format!("−{magnitude}"),
        None => text.to_owned(),
    }
}

fn raised(character: char) -> char {
    match character {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        '0' => '⁰',
        digit => digit.to_digit(10).and_then(|digit| char::from_u32(0x2070 + digit)).unwrap_or(digit),
    }
}

/// A rectangle of the page that shows a rectangle of a plane.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Frame {
    pub(super) area: Area,
    /// What the left and right side show.
    pub(super) x: Range,
    /// What the lower and upper side show.
    pub(super) y: Range,
}

impl Frame {
    /// Where a point of the plane is on the page.
    pub(super) fn place(&self, x: f64, y: f64) -> PagePoint {
        let right = (x - self.x.low) / self.x.span() * self.area.width;
        let up = (y - self.y.low) / self.y.span() * self.area.height;
        PagePoint::new(self.area.left + right, self.area.bottom() - up)
    }

    /// Draws grid, ticks and labels. `unit` is what numbers on the axes count, in the plane's own unit.
    pub(super) fn draw(&self, page: &mut Page, labels: [&str; 2], unit: f64) {
        let written = |range: Range| Range { low: range.low / unit, high: range.high / unit };
        let x = Ticks::new(written(self.x), self.area.width / TICK_SPACE[0]);
        let y = Ticks::new(written(self.y), self.area.height / TICK_SPACE[1]);
        for (value, text) in &x.ticks {
            self.x_tick(page, self.place(value * unit, self.y.low), text);
        }
        for (value, text) in &y.ticks {
            self.y_tick(page, self.place(self.x.low, value * unit), text);
        }
        self.draw_edge(page);
        let below = PagePoint::new(self.area.left + 0.5 * self.area.width, self.area.bottom() + 34.0);
        page.text(axis_text(x.label(labels[0]), below));
        let beside = PagePoint::new(self.area.left - 50.0, self.area.top + 0.5 * self.area.height);
        page.text(Text { upward: true, ..axis_text(y.label(labels[1]), beside) });
    }

    /// Draws its edge alone.
    pub(super) fn draw_edge(&self, page: &mut Page) {
        page.path(&self.area.corners(), true, Stroke::solid(Colour::DARK_GREY, 1.0));
    }

    fn x_tick(&self, page: &mut Page, foot: PagePoint, text: &str) {
        let top = PagePoint::new(foot.x, self.area.top);
        page.path(&[foot, top], false, Stroke::solid(Colour::PALE_GREY, 1.0));
        page.path(&[foot, foot.moved(0.0, TICK_LENGTH)], false, Stroke::solid(Colour::DARK_GREY, 1.0));
        page.text(axis_text(text, foot.moved(0.0, 2.0 * TICK_LENGTH + 4.0)));
    }

    fn y_tick(&self, page: &mut Page, foot: PagePoint, text: &str) {
        let right = PagePoint::new(self.area.right(), foot.y);
        page.path(&[foot, right], false, Stroke::solid(Colour::PALE_GREY, 1.0));
        page.path(&[foot, foot.moved(-TICK_LENGTH, 0.0)], false, Stroke::solid(Colour::DARK_GREY, 1.0));
        page.text(axis_text(text, foot.moved(-TICK_LENGTH - 4.0, 0.0)).anchored(Anchor::End));
    }
}

fn axis_text(text: impl Into<String>, at: PagePoint) -> Text {
    Text::new(text, at, TEXT_SIZE, Colour::DARK_GREY).anchored(Anchor::Middle)
}

/// What a legend shows beside a name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Key {
    /// A piece of the line.
    Line(Stroke),
    /// A patch of the area.
    Area(Style),
    /// A dot of this colour.
    Dot(Colour),
    /// An arrow of this colour.
    Arrow(Colour),
}

/// Radius of a dot.
pub(super) const DOT_RADIUS: f64 = 3.0;

/// Width of what a legend shows, and of the gaps after it and after its name.
const KEY_WIDTH: f64 = 26.0;
const KEY_GAP: f64 = 6.0;
const ENTRY_GAP: f64 = 15.0;

/// Names of what is drawn, in rows above the frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Legend {
    pub(super) entries: Vec<(Key, String)>,
}

impl Legend {
    /// The rows into which the entries fit, each entry with its distance from the left.
    fn rows(&self, width: f64) -> Vec<Vec<(f64, &(Key, String))>> {
        let mut rows: Vec<Vec<_>> = Vec::new();
        let mut x = 0.0;
        for entry in &self.entries {
            let length = KEY_WIDTH + KEY_GAP + super::page::text_length(&entry.1, TEXT_SIZE);
            if rows.is_empty() || x + length > width {
                rows.push(Vec::new());
                x = 0.0;
            }
            rows.last_mut().into_iter().for_each(|row| row.push((x, entry)));
            x += length + ENTRY_GAP;
        }
        rows
    }

    fn draw(&self, page: &mut Page, area: Area) {
        for (row, entries) in (0_u32..).zip(self.rows(area.width)) {
            let y = area.top + (f64::from(row) + 0.5) * LINE_HEIGHT;
            for (x, (key, name)) in entries {
                let start = PagePoint::new(area.left + x, y);
                draw_key(page, *key, start);
                page.text(Text::new(name.clone(), start.moved(KEY_WIDTH + KEY_GAP, 0.0), TEXT_SIZE, Colour::BLACK));
            }
        }
    }
}

fn draw_key(page: &mut Page, key: Key, start: PagePoint) {
    let end = start.moved(KEY_WIDTH, 0.0);
    match key {
        Key::Line(stroke) => page.path(&[start, end], false, stroke),
        Key::Area(style) => {
            let patch = Area { left: start.x, top: start.y - 6.0, width: KEY_WIDTH, height: 12.0 };
            page.path(&patch.corners(), true, style);
        }
        Key::Dot(colour) => page.circle(start.moved(0.5 * KEY_WIDTH, 0.0), DOT_RADIUS, Style::area(colour, 1.0)),
        Key::Arrow(colour) => draw_arrow(page, [start, end], colour),
    }
}

/// Length and half width of an arrow's head, and the width of its shaft.
const HEAD: [f64; 2] = [9.0, 4.0];
const SHAFT: f64 = 2.0;

/// Draws an arrow. One shorter than its head is drawn as a smaller head.
pub(super) fn draw_arrow(page: &mut Page, [tail, tip]: [PagePoint; 2], colour: Colour) {
    let (dx, dy) = (tip.x - tail.x, tip.y - tail.y);
    let length = dx.hypot(dy);
    if length == 0.0 || !length.is_finite() {
        return;
    }
    let (along, share) = ([dx / length, dy / length], (length / HEAD[0]).min(1.0));
    let [back, wide] = HEAD.map(|size| size * share);
    let neck = tip.moved(-along[0] * back, -along[1] * back);
    let side = |sign: f64| neck.moved(-along[1] * wide * sign, along[0] * wide * sign);
    if length > HEAD[0] {
        page.path(&[tail, neck], false, Stroke::solid(colour, SHAFT));
    }
    page.path(&[tip, side(1.0), side(-1.0)], true, Style::area(colour, 1.0));
}

/// What stands above a panel's frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Heading {
    pub(super) title: String,
    pub(super) legend: Legend,
}

impl Heading {
    /// Draws title and legend at the top of a panel, and gives the area that is left for the frame.
    pub(super) fn draw(&self, page: &mut Page, panel: Area) -> Area {
        let title_height = if self.title.is_empty() { 0.0 } else { LINE_HEIGHT };
        let beside = Margins { left: FRAME_MARGINS.left, right: FRAME_MARGINS.right, ..Margins::default() };
        let strip = panel.inside(Margins { top: title_height, ..beside });
        let at = PagePoint::new(strip.left, panel.top + 0.5 * LINE_HEIGHT);
        page.text(Text::new(self.title.clone(), at, TITLE_SIZE, Colour::BLACK));
        self.legend.draw(page, strip);
        let rows = u32::try_from(self.legend.rows(strip.width).len()).unwrap_or(u32::MAX);
        let top = FRAME_MARGINS.top + title_height + f64::from(rows) * LINE_HEIGHT;
        panel.inside(Margins { top, ..FRAME_MARGINS })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn written(low: f64, high: f64, count: f64) -> Vec<String> {
        Ticks::new(Range { low, high }, count).ticks.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_are_round_numbers() {
        assert_eq!(written(0.0, 1.0, 5.0), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(written(-13.0, 27.0, 4.0), ["−10", "0", "10", "20"]);
        assert_eq!(written(-0.03, 0.031, 3.0), ["0.00"].map(str::to_owned).to_vec().as_slice());
    }

    #[test]
    fn huge_and_tiny_numbers_share_a_power_of_ten() {
        let ticks = Ticks::new(Range { low: 0.0, high: 3e-6 }, 4.0);
        assert_eq!(ticks.exponent, Some(-6));
        assert_eq!(ticks.label("strain"), "strain, in 10⁻⁶");
        assert_eq!(ticks.ticks.last().unwrap().1, "3");
        assert_eq!(Ticks::new(Range { low: 0.0, high: 2e14 }, 4.0).label("n"), "n, in 10¹⁴");
    }

    proptest! {
        #[test]
        fn ticks_stay_in_their_range_and_are_few(low in -1e7..1e7, decades in -6..7, count in 1.0..20.0) {
            let range = Range { low, high: low + 10_f64.powi(decades) };
            let ticks = Ticks::new(range, count).ticks;
            let slack = 1e-9 * range.span();
            prop_assert!(ticks.iter().all(|(value, _)| (range.low - slack..=range.high + slack).contains(value)));
            prop_assert!(ticks.len() as f64 <= count + 1.0, "{ticks:?}");
        }
    }
}
