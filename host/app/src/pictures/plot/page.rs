//! What is on a page, in page units: shapes and texts in the order in which they are drawn.
//!
//! Frames: x to the right and y **down** from the upper left corner, as in SVG; world coordinates become page
//! coordinates in [`super::PlotScene`] and [`super::Chart`]. Errors: none; what has a coordinate that is not finite is
//! left out.

use super::font;
use super::style::{Colour, Style};

/// A place on the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PagePoint {
    /// From the left edge to the right, page units.
    pub x: f64,
    /// From the upper edge down, page units.
    pub y: f64,
}

impl PagePoint {
    /// A place from its coordinates.
    #[must_use]
    pub const fn new(x: f64, y: f64) -> Self {
        Self { x, y }
    }

    /// The place so much to the right and so much further down.
    #[must_use]
    pub fn moved(self, right: f64, down: f64) -> Self {
        Self::new(self.x + right, self.y + down)
    }

    fn is_finite(self) -> bool {
        self.x.is_finite() && self.y.is_finite()
    }
}

/// A rectangle on the page.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Area {
    /// x of the left side, page units.
    pub left: f64,
    /// y of the upper side, page units.
    pub top: f64,
    /// From left to right.
    pub width: f64,
    /// From top to bottom.
    pub height: f64,
}

impl Area {
    /// The rectangle within, less these margins; never narrower or lower than one unit.
    #[must_use]
    pub fn inside(self, margins: Margins) -> Self {
        let Margins { left, top, right, bottom } = margins;
        let (width, height) = ((self.width - left - right).max(1.0), (self.height - top - bottom).max(1.0));
        Self { left: self.left + left, top: self.top + top, width, height }
    }

    /// x of the right side, page units.
    #[must_use]
    pub fn right(self) -> f64 {
        self.left + self.width
    }

    /// y of the lower side, page units.
    #[must_use]
    pub fn bottom(self) -> f64 {
        self.top + self.height
    }

    /// Whether all of another is in it.
    #[must_use]
    pub fn holds(self, other: Self) -> bool {
        self.left <= other.left
            && other.right() <= self.right()
            && self.top <= other.top
            && other.bottom() <= self.bottom()
    }

    /// Whether it has an area in common with another.
    #[must_use]
    pub fn overlaps(self, other: Self) -> bool {
        let across = self.left < other.right() && other.left < self.right();
        across && self.top < other.bottom() && other.top < self.bottom()
    }

    /// Its corners, from the upper left clockwise as seen.
    #[must_use]
    pub fn corners(self) -> [PagePoint; 4] {
        let (left, top, right, bottom) = (self.left, self.top, self.right(), self.bottom());
        [[left, top], [right, top], [right, bottom], [left, bottom]].map(|[x, y]| PagePoint::new(x, y))
    }
}

/// What to leave free on each side.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Margins {
    /// On the left, page units.
    pub left: f64,
    /// Above, page units.
    pub top: f64,
    /// On the right, page units.
    pub right: f64,
    /// Below, page units.
    pub bottom: f64,
}

/// Which point of a text is at its place: along the line of writing; the height is always that of the middle of an x.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The text starts there.
    Start,
    /// Its middle is there.
    Middle,
    /// The text ends there.
    End,
}

/// A line of text.
#[derive(Clone, Debug, PartialEq)]
pub struct Text {
    /// What it says. Characters that the font lacks show as a box.
    pub text: String,
    /// The page point that its anchor is put on.
    pub at: PagePoint,
    /// Which point of it is there.
    pub anchor: Anchor,
    /// Height of the font.
    pub size: f64,
    /// Colour of the letters.
    pub colour: Colour,
    /// Whether it runs upward instead of to the right.
    pub upward: bool,
    /// Whether a white rim sets it off from what is behind.
    pub halo: bool,
}

impl Text {
    /// A text to the right of its place, without a halo.
    #[must_use]
    pub fn new(text: impl Into<String>, at: PagePoint, size: f64, colour: Colour) -> Self {
        Self { text: text.into(), at, anchor: Anchor::Start, size, colour, upward: false, halo: false }
    }

    /// The same held at another point.
    #[must_use]
    pub fn anchored(self, anchor: Anchor) -> Self {
        Self { anchor, ..self }
    }

    /// How long it is along the line of writing, in page units.
    #[must_use]
    pub fn length(&self) -> f64 {
        text_length(&self.text, self.size)
    }

    /// The area of its letters, from the lowest descender to the highest ascender.
    #[must_use]
    pub fn area(&self) -> Area {
        let (along, length, height) = (-self.lead(), self.length(), self.size);
        let half = 0.5 * height;
        if self.upward {
            return Area { left: self.at.x - half, top: self.at.y - along - length, width: height, height: length };
        }
        Area { left: self.at.x + along, top: self.at.y - half, width: length, height }
    }

    /// How far before its place it starts, along the line of writing.
    pub(super) fn lead(&self) -> f64 {
        match self.anchor {
            Anchor::Start => 0.0,
            Anchor::Middle => 0.5 * self.length(),
            Anchor::End => self.length(),
        }
    }
}

/// The length of a text in a font of this height.
#[must_use]
pub fn text_length(text: &str, size: f64) -> f64 {
    font::length(text) * size
}

/// A shape or a text.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Item {
    Path { points: Vec<PagePoint>, closed: bool, style: Style },
    Circle { centre: PagePoint, radius: f64, style: Style },
    Text(Text),
}

/// A page: see [`Page::to_svg`] and [`Page::to_png`].
#[derive(Clone, Debug, PartialEq)]
pub struct Page {
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) title: String,
    pub(super) items: Vec<Item>,
}

impl Page {
    /// An empty white page. The title is for programs that read pages to people; it is not drawn.
    #[must_use]
    pub fn new(width: f64, height: f64, title: impl Into<String>) -> Self {
        Self { width, height, title: title.into(), items: Vec::new() }
    }

    /// The whole page, page units.
    #[must_use]
    pub fn area(&self) -> Area {
        Area { left: 0.0, top: 0.0, width: self.width, height: self.height }
    }

    /// The texts, in the order in which they were written.
    pub(super) fn texts(&self) -> impl Iterator<Item = &Text> {
        self.items.iter().filter_map(|item| if let Item::Text(text) = item { Some(text) } else { None })
    }

    /// Draws a line from point to point, and back to the first if it is closed.
    pub fn path(&mut self, points: &[PagePoint], closed: bool, style: impl Into<Style>) {
        if points.len() > 1 && points.iter().all(|point| point.is_finite()) {
            self.items.push(Item::Path { points: points.to_vec(), closed, style: style.into() });
        }
    }

    /// Draws a circle; not one without a radius.
    pub fn circle(&mut self, centre: PagePoint, radius: f64, style: impl Into<Style>) {
        if centre.is_finite() && radius.is_finite() && radius > 0.0 {
            self.items.push(Item::Circle { centre, radius, style: style.into() });
        }
    }

    /// Writes a line of text.
    pub fn text(&mut self, text: Text) {
        if text.at.is_finite() && !text.text.is_empty() {
            self.items.push(Item::Text(text));
        }
    }
}
