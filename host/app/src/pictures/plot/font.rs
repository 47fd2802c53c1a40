//! The font: outlines and widths of its characters.
//!
//! A subset of DejaVu Sans without hints (Latin, Greek, some signs of mathematics; `font/LICENSE.txt` is its licence),
//! so that pictures look the same on every machine and need nothing installed. Both writers draw its outlines.
//!
//! Made by `pyftsubset DejaVuSans.ttf --no-hinting` from version 2.37. Units: font heights (em).

use std::sync::LazyLock;

use ttf_parser::{Face, GlyphId, OutlineBuilder};

static FONT_BYTES: &[u8] = include_bytes!("font/DejaVuSans-subset.ttf");

/// The font. That it can be read is a property of the program, tested below, not of any input.
static FACE: LazyLock<Option<Face<'static>>> = LazyLock::new(|| Face::parse(FONT_BYTES, 0).ok());

/// Height of the letter x, in font heights.
pub(super) const X_HEIGHT: f64 = 0.547;

/// A piece of an outline, in font heights, y up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Segment {
    Move([f64; 2]),
    Line([f64; 2]),
    /// Control point and end.
    Quadratic([f64; 2], [f64; 2]),
    Close,
}

/// A character's number in the font; 0 is the box that stands for all it lacks.
pub(super) fn glyph(character: char) -> u16 {
    FACE.as_ref().and_then(|face| face.glyph_index(character)).map_or(0, |glyph| glyph.0)
}

/// How far one character moves on the next.
pub(super) fn advance(glyph: u16) -> f64 {
    let Some(face) = FACE.as_ref() else { return 0.0 };
    f64::from(face.glyph_hor_advance(GlyphId(glyph)).unwrap_or(0)) / f64::from(face.units_per_em())
}

/// The length of a text.
pub(super) fn length(text: &str) -> f64 {
    text.chars().map(|character| advance(glyph(character))).sum()
}

/// A character's outline; empty for a space.
pub(super) fn outline(glyph: u16) -> Vec<Segment> {
    let Some(face) = FACE.as_ref() else { return Vec::new() };
    let mut outline = Outline { per_unit: 1.0 / f64::from(face.units_per_em()), segments: Vec::new() };
    // None is what a space has.
    let _ = face.outline_glyph(GlyphId(glyph), &mut outline);
    outline.segments
}

/// Collects an outline, in heights of the font.
struct Outline {
    per_unit: f64,
    segments: Vec<Segment>,
}

impl Outline {
    fn point(&self, x: f32, y: f32) -> [f64; 2] {
        [x, y].map(|value| f64::from(value) * self.per_unit)
    }
}

impl OutlineBuilder for Outline {
    fn move_to(&mut self, x: f32, y: f32) {
        self.segments.push(Segment::Move(self.point(x, y)));
    }

    fn line_to(&mut self, x: f32, y: f32) {
        self.segments.push(Segment::Line(self.point(x, y)));
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        self.segments.push(Segment::Quadratic(self.point(x1, y1), self.point(x, y)));
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        // TrueType outlines have none; its two ends and the middle of its controls stay close to one.
        let control = self.point(0.5 * (x1 + x2), 0.5 * (y1 + y2));
        self.segments.push(Segment::Quadratic(control, self.point(x, y)));
    }

    fn close(&mut self) {
        self.segments.push(Segment::Close);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_has_every_character_that_pictures_use() {
        let used = "ABCXYZabcxyz0123456789 [](){}+-−=·×°²³⁻¹⁴µμαβθφωρσΣ→≤≥±≈∞√…–—äöüé,.:;/%'";
        for character in used.chars() {
            assert_ne!(glyph(character), 0, "{character} (U+{:04X})", u32::from(character));
        }
    }

    #[test]
    fn letters_have_the_sizes_of_dejavu_sans() {
        // From the font's tables in version 2.37: advance of "m" 1995 and height of "x" 1120 of 2048 units.
        assert!((advance(glyph('m')) - 1995.0 / 2048.0).abs() < 1e-12);
        assert!((X_HEIGHT - 1120.0 / 2048.0).abs() < 5e-4);
        assert!(outline(glyph(' ')).is_empty() && outline(glyph('x')).len() > 8);
    }
}
