//! A page as SVG text.
//!
//! Texts are outlines, with the words beside them for programs that read to people: no viewer's fonts come into it.
//! Numbers are rounded to a hundredth of a page unit, so the same page gives the same bytes on every machine.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use super::font::{self, Segment};
use super::page::{Item, Page, PagePoint, Text};
use super::style::{Colour, Fill, Stroke, Style};

/// Units of an outline for one font height: outlines keep the font's own precision.
const OUTLINE_UNITS: f64 = 2048.0;

/// Width of a halo on each side, as a share of the font height.
pub(super) const HALO_SHARE: f64 = 0.2;

impl Page {
    /// The page as an SVG file: the same bytes on every machine, and no fonts needed to see it.
    #[must_use]
    pub fn to_svg(&self) -> String {
        let (width, height) = (number(self.width), number(self.height));
        let mut svg = format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" xmlns:xlink=\"http://www.w3.org/1999/xlink\" width=\"{width}\" \
             height=\"{height}\" viewBox=\"0 0 {width} {height}\" role=\"img\">\n<title>{}</title>\n",
            escaped(&self.title)
        );
        svg += &self.glyph_definitions();
        let _ = writeln!(svg, "<rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>");
        self.items.iter().for_each(|item| write_item(&mut svg, item));
        svg + "</svg>\n"
    }

    /// The outline of every character on the page, once.
    fn glyph_definitions(&self) -> String {
        let glyphs: BTreeSet<u16> = self.texts().flat_map(|text| text.text.chars().map(font::glyph)).collect();
        let mut definitions = "<defs>\n".to_owned();
        for glyph in glyphs {
            let outline = outline_data(&font::outline(glyph));
            if !outline.is_empty() {
                let _ = writeln!(definitions, "<path id=\"g{glyph}\" d=\"{outline}\"/>");
            }
        }
        definitions + "</defs>\n"
    }
}

fn write_item(svg: &mut String, item: &Item) {
    let _ = match item {
        Item::Path { points, closed, style } => {
            writeln!(svg, "<path d=\"{}\"{}/>", path_data(points, *closed), style_attributes(style))
        }
        Item::Circle { centre, radius, style } => {
            let (x, y, r) = (number(centre.x), number(centre.y), number(*radius));
            writeln!(svg, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{r}\"{}/>", style_attributes(style))
        }
        Item::Text(text) => {
            *svg += &text_element(text);
            Ok(())
        }
    };
}

fn text_element(text: &Text) -> String {
    let (x, y) = (number(text.at.x), number(text.at.y));
    let turn = if text.upward { " rotate(-90)" } else { "" };
    let scale = shortest(text.size / OUTLINE_UNITS, 6);
    let colour = hexadecimal(text.colour);
    let letters = letters(text);
    let halo = if text.halo {
        let width = number(2.0 * HALO_SHARE * OUTLINE_UNITS);
        format!("<g stroke=\"#ffffff\" stroke-width=\"{width}\" stroke-linejoin=\"round\">{letters}</g>")
    } else {
        String::new()
    };
    format!(
        "<g role=\"text\" aria-label=\"{}\" transform=\"translate({x} {y}){turn} scale({scale} -{scale})\" fill=\"{colour}\">\
         {halo}{letters}</g>\n",
        escaped(&text.text)
    )
}

/// References to the outlines of a text's characters, in outline units from the text's place.
fn letters(text: &Text) -> String {
    let (mut x, y) = (-text.lead() / text.size, -0.5 * font::X_HEIGHT);
    let mut letters = String::new();
    for glyph in text.text.chars().map(font::glyph) {
        if !font::outline(glyph).is_empty() {
            let (x, y) = (shortest(x * OUTLINE_UNITS, 0), shortest(y * OUTLINE_UNITS, 0));
            let _ = write!(letters, "<use xlink:href=\"#g{glyph}\" x=\"{x}\" y=\"{y}\"/>");
        }
        x += font::advance(glyph);
    }
    letters
}

fn path_data(points: &[PagePoint], closed: bool) -> String {
    let mut data = String::new();
    for (i, point) in points.iter().enumerate() {
        let _ = write!(data, "{}{} {}", if i == 0 { 'M' } else { 'L' }, number(point.x), number(point.y));
    }
    if closed { data + "Z" } else { data }
}

fn outline_data(outline: &[Segment]) -> String {
    let at = |point: &[f64; 2]| point.map(|value| shortest(value * OUTLINE_UNITS, 0)).join(" ");
    let word = |segment: &Segment| match segment {
        Segment::Move(end) => format!("M{}", at(end)),
        Segment::Line(end) => format!("L{}", at(end)),
        Segment::Quadratic(control, end) => format!("Q{} {}", at(control), at(end)),
        Segment::Close => "Z".to_owned(),
    };
    outline.iter().map(word).collect()
}

fn style_attributes(style: &Style) -> String {
    let mut attributes = match style.fill {
        None => " fill=\"none\"".to_owned(),
        Some(Fill { colour, opacity }) if opacity >= 1.0 => format!(" fill=\"{}\"", hexadecimal(colour)),
        Some(Fill { colour, opacity }) => {
            format!(" fill=\"{}\" fill-opacity=\"{}\"", hexadecimal(colour), number(opacity))
        }
    };
    if let Some(Stroke { colour, width, dash }) = style.stroke {
        let (colour, wide) = (hexadecimal(colour), number(width));
        let _ = write!(attributes, " stroke=\"{colour}\" stroke-width=\"{wide}\" stroke-linejoin=\"round\"");
        if let Some(pattern) = dash.pattern() {
            let [drawn, left_out] = pattern.map(|length| number(length * width));
            let _ = write!(attributes, " stroke-dasharray=\"{drawn} {left_out}\"");
        }
    }
    attributes
}

fn hexadecimal(colour: Colour) -> String {
    let [red, green, blue] = colour.rgb;
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// A length to a hundredth of a page unit.
fn number(value: f64) -> String {
    shortest(value, 2)
}

/// A number with at most so many decimals, without the zeros that say nothing.
fn shortest(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let short = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if short == "-0" { "0".to_owned() } else { short.to_owned() }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_short_and_never_minus_zero() {
        let written = [1.0, -0.001, 0.125, 10.0, 99.999, -2.5].map(number);
        assert_eq!(written, ["1", "0", "0.12", "10", "100", "-2.5"]);
    }

    #[test]
    fn words_cannot_break_out_of_the_file() {
        let mut page = Page::new(10.0, 10.0, "a < b & c");
        page.text(Text::new("\"<script>\"", PagePoint::new(1.0, 1.0), 10.0, Colour::BLACK));
        let svg = page.to_svg();
        assert!(svg.contains("<title>a &lt; b &amp; c</title>"), "{svg}");
        assert!(svg.contains("aria-label=\"&quot;&lt;script&gt;&quot;\""), "{svg}");
    }
}
