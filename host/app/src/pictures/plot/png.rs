//! A page as PNG bytes.

use tiny_skia::{FillRule, LineJoin, Paint, Path, PathBuilder, Pixmap, StrokeDash, Transform};

use super::PlotError;
use super::font::{self, Segment};
use super::page::{Item, Page, PagePoint, Text};
use super::style::{Colour, Fill, Stroke, Style};
use super::svg::HALO_SHARE;

/// Pixels for a page unit: sharp on screens with small pixels and on paper up to 20 cm across.
const PIXELS_PER_UNIT: f64 = 2.0;

/// Longest side of a picture, pixels: beyond it is a mistake, and memory would be short.
const SIDE_MAX: f64 = 20_000.0;

impl Page {
    /// The page as a PNG file, two pixels for each page unit.
    ///
    /// # Errors
    /// [`PlotError::Size`] for a page of no size or an enormous one, [`PlotError::Encode`] if it cannot be packed.
    pub fn to_png(&self) -> Result<Vec<u8>, PlotError> {
        let mut canvas = Canvas { pixels: self.pixels()?, scale: Transform::from_scale(px(1.0), px(1.0)) };
        self.items.iter().for_each(|item| canvas.draw(item));
        canvas.pixels.encode_png().map_err(|error| PlotError::Encode(error.to_string()))
    }

    fn pixels(&self) -> Result<Pixmap, PlotError> {
        let sides = [self.width, self.height].map(|side| (side * PIXELS_PER_UNIT).round());
        let refuse = || PlotError::Size { width: self.width, height: self.height };
        if !sides.iter().all(|side| (1.0..=SIDE_MAX).contains(side)) {
            return Err(refuse());
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked against SIDE_MAX above")]
        let [width, height] = sides.map(|side| side as u32);
        let mut pixels = Pixmap::new(width, height).ok_or_else(refuse)?;
        pixels.fill(tiny_skia::Color::WHITE);
        Ok(pixels)
    }
}

/// Pixels being drawn on.
struct Canvas {
    pixels: Pixmap,
    scale: Transform,
}

impl Canvas {
    fn draw(&mut self, item: &Item) {
        match item {
            Item::Path { points, closed, style } => self.shape(path(points, *closed), style, self.scale),
            Item::Circle { centre, radius, style } => {
                let circle = PathBuilder::from_circle(f32_of(centre.x), f32_of(centre.y), f32_of(*radius));
                self.shape(circle, style, self.scale);
            }
            Item::Text(text) => self.text(text),
        }
    }

    /// A path of no length has nothing to draw.
    fn shape(&mut self, path: Option<Path>, style: &Style, transform: Transform) {
        let Some(path) = path else { return };
        if let Some(Fill { colour, opacity }) = style.fill {
            self.pixels.fill_path(&path, &paint(colour, opacity), FillRule::Winding, transform, None);
        }
        if let Some(Stroke { colour, width, dash }) = style.stroke {
            let lengths = dash.pattern().map(|pattern| pattern.map(|length| f32_of(length * width)).to_vec());
            let stroke = tiny_skia::Stroke {
                width: f32_of(width),
                line_join: LineJoin::Round,
                dash: lengths.and_then(|lengths| StrokeDash::new(lengths, 0.0)),
                ..tiny_skia::Stroke::default()
            };
            self.pixels.stroke_path(&path, &paint(colour, 1.0), &stroke, transform, None);
        }
    }

    fn text(&mut self, text: &Text) {
        let turn = if text.upward { Transform::from_rotate(-90.0) } else { Transform::identity() };
        let place = Transform::from_translate(f32_of(text.at.x), f32_of(text.at.y));
        let transform = self.scale.pre_concat(place).pre_concat(turn);
        if text.halo {
            let rim = Stroke::solid(Colour::WHITE, 2.0 * HALO_SHARE * text.size);
            self.shape(letters(text), &Style::line(rim), transform);
        }
        self.shape(letters(text), &Style::area(text.colour, 1.0), transform);
    }
}

/// The outline of a whole text, in page units from its place.
fn letters(text: &Text) -> Option<Path> {
    let mut builder = PathBuilder::new();
    let mut x = -text.lead();
    let y = 0.5 * font::X_HEIGHT * text.size;
    for glyph in text.text.chars().map(font::glyph) {
        let at = |[right, up]: [f64; 2]| (f32_of(x + right * text.size), f32_of(y - up * text.size));
        for segment in font::outline(glyph) {
            match segment {
                Segment::Move(end) => builder.move_to(at(end).0, at(end).1),
                Segment::Line(end) => builder.line_to(at(end).0, at(end).1),
                Segment::Quadratic(control, end) => {
                    builder.quad_to(at(control).0, at(control).1, at(end).0, at(end).1);
                }
                Segment::Close => builder.close(),
            }
        }
        x += font::advance(glyph) * text.size;
    }
    builder.finish()
}

fn path(points: &[PagePoint], closed: bool) -> Option<Path> {
    let (first, others) = points.split_first()?;
    let mut builder = PathBuilder::new();
    builder.move_to(f32_of(first.x), f32_of(first.y));
    others.iter().for_each(|point| builder.line_to(f32_of(point.x), f32_of(point.y)));
    if closed {
        builder.close();
    }
    builder.finish()
}

fn paint(colour: Colour, opacity: f64) -> Paint<'static> {
    let [red, green, blue] = colour.rgb;
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "within 0 and 255")]
    let alpha = (opacity.clamp(0.0, 1.0) * 255.0).round() as u8;
    paint.set_color_rgba8(red, green, blue, alpha);
    paint
}

/// Pixels for so many page units.
fn px(units: f64) -> f32 {
    f32_of(units * PIXELS_PER_UNIT)
}

#[expect(clippy::cast_possible_truncation, reason = "a thousandth of a pixel does not show")]
fn f32_of(value: f64) -> f32 {
    value as f32
}
