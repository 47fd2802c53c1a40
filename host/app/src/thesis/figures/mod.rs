//! The thesis's figures, each computed from its problem by the library and drawn: `palpate tables figure-2.4 --plot DIR`.
//!
//! Where the thesis prints a figure without the numbers behind it, a problem with what the figure shows is drawn from the
//! seed. Each comes with a table of what is to be seen and a caption that says what to look at; pictures are as wide as half
//! a page needs. Figures 6.1 to 6.4 are with the observer that they show, in `gho`, which draws them together, too.
//!
//! By chapter: `inscription` (1.1, 2, A), `sampling` (3, B), `pushing` (1.2, 5, 6, C), `rolling` (7).
//!
//! Units: SI inside; millimetres and degrees on axes and in tables. Errors: a seed that draws no such problem has a failure
//! and a picture of what there is.

mod inscription;
mod pushing;
mod rolling;
mod sampling;

use nalgebra::{Point2, Vector2};
use palpate::inscription::HalfPlane;

use super::{Table, TableSettings, gho};
use crate::pictures::plot::{Colour, Figure, PlotScene, Stroke, Style, text_length};

/// A figure of the thesis as a command.
#[derive(Clone, Copy, Debug)]
pub struct Illustration {
    /// What it is called on the command line, and its file.
    pub name: &'static str,
    /// What it shows, one line.
    pub title: &'static str,
    /// Problems to draw until one is like it.
    pub cases: usize,
    /// Computes it.
    pub make: fn(&TableSettings) -> (Table, Figure),
}

/// What a figure takes at most, s of one processor: 3.1 and 6.6 take half a second, all others less.
pub const FIGURE_S: f64 = 0.6;

/// All figures, in the order of the thesis.
pub const ILLUSTRATIONS: &[Illustration] = &[
    inscription::FIGURE_1_1,
    pushing::FIGURE_1_2,
    inscription::FIGURE_2_1,
    inscription::FIGURE_2_2,
    inscription::FIGURE_2_3,
    inscription::FIGURE_2_4,
    inscription::FIGURE_2_5,
    sampling::FIGURE_3_1,
    sampling::FIGURE_3_2,
    sampling::FIGURE_3_3,
    sampling::FIGURE_3_4,
    sampling::FIGURE_3_5,
    sampling::FIGURE_3_6,
    pushing::FIGURE_5_2,
    pushing::FIGURE_5_3,
    pushing::FIGURE_5_4,
    pushing::FIGURE_5_5,
    pushing::FIGURE_5_6,
    gho::FIGURE_6_1,
    gho::FIGURE_6_2,
    gho::FIGURE_6_3,
    gho::FIGURE_6_4,
    pushing::FIGURE_6_6,
    pushing::FIGURE_6_8,
    rolling::FIGURE_7_2,
    rolling::FIGURE_7_3,
    inscription::FIGURE_A_1,
    sampling::FIGURE_B_1,
    pushing::FIGURE_C_1,
];

/// Height of a line of a caption, its font and what is free beside it, page units: as figures draw subtitles.
const LINE: f64 = 20.0;
/// See [`LINE`].
const CAPTION_SIZE: f64 = 13.0;
/// See [`LINE`].
const BESIDE: f64 = 44.0;

/// A page of so much below its caption, which is folded to its width.
pub(super) fn captioned(title: &str, [width, height]: [f64; 2], caption: &str) -> Figure {
    let mut lines = vec![String::new()];
    for word in caption.split_whitespace() {
        let last = lines.len() - 1;
        let longer = format!("{} {word}", lines[last]);
        if text_length(&longer, CAPTION_SIZE) > width - BESIDE {
            lines.push(word.to_owned());
        } else {
            longer.trim_start().clone_into(&mut lines[last]);
        }
    }
    Figure::new(title, width, height + LINE * lines.len() as f64).subtitles(&lines)
}

/// An outline, filled a little.
fn area(colour: Colour) -> Style {
    Style::area(colour, 0.15).outlined(Stroke::solid(colour, 1.4))
}

/// An outline alone.
fn thin(colour: Colour) -> Stroke {
    Stroke::solid(colour, 0.9)
}

/// The line of a half-plane on both sides of the point of it that is nearest to another.
fn draw_line(scene: &mut PlotScene, line: &HalfPlane, near: Point2<f64>, reach: f64) {
    let foot = near - line.normal * line.beyond(near);
    let along = Vector2::new(-line.normal.y, line.normal.x) * reach;
    scene.polyline(&[foot - along, foot + along], Stroke::solid(Colour::BLACK, 1.6));
}

/// The figure of this name.
#[must_use]
pub fn illustration(name: &str) -> Option<&'static Illustration> {
    ILLUSTRATIONS.iter().find(|illustration| illustration.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every figure shows what its table says it shows, fits its page, and is the same each time.
    #[test]
    fn every_figure_is_drawn_without_failures() {
        for Illustration { name, cases, make, .. } in ILLUSTRATIONS {
            let settings = TableSettings { cases: *cases, seed: 1, jobs: None };
            let (table, figure) = make(&settings);
            assert!(table.failures.is_empty(), "{name}: {table}");
            assert!(table.rows().count() > 0 && !table.definitions.is_empty(), "{name}: {table}");
            let svg = figure.to_page().to_svg();
            assert!(svg.len() > 5_000 && !svg.contains("NaN"), "{name}: {} bytes", svg.len());
            let number = name.trim_start_matches("figure-");
            assert!(svg.contains(&format!("Figure {number}")), "{name}");
            assert_eq!(svg, make(&settings).1.to_page().to_svg(), "{name}");
        }
    }
}
