//! The picture of a search by touch: a panel for each approach with what it met, the poses that are left then, and the
//! approach that is chosen next.
//!
//! Pure. Frames: the robot's. Units: SI in, millimetres on the axes.

use nalgebra::{Point2, Vector2};
use palpate::inscription::Approach;

use super::strip::strip;
use crate::pictures::plot::{Colour, Dash, Figure, PlotScene, Stroke, Style};

/// Poses up to which areas are filled; more are outlines.
const FILLED_MAX: usize = 6;

/// An outline that may lie there.
#[derive(Clone, Debug)]
pub struct TouchLeft {
    /// Its corners in its pose, m.
    pub outline: Vec<Point2<f64>>,
    /// Outlines of one colour are of one kind: of one pose, or of one part.
    pub kind: usize,
    /// What it is called, where it may be one of several parts.
    pub name: Option<String>,
}

/// One approach and what was known after it.
#[derive(Clone, Debug)]
pub struct TouchStep {
    /// As it was made.
    pub approach: Approach,
    /// Where the disk's centre was as it touched; none where it met nothing.
    pub touched: Option<Point2<f64>>,
    /// What may lie there, likeliest first, or what stands for all that may; none before the first touch.
    pub left: Vec<TouchLeft>,
    /// The same in a few words.
    pub words: String,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct TouchPicture<'a> {
    /// The approaches in order.
    pub steps: &'a [TouchStep],
    /// All of the part is in this rectangle, m.
    pub area: [Point2<f64>; 2],
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Title, above everything.
    pub title: &'a str,
    /// Lines below the title.
    pub subtitles: &'a [String],
}

impl TouchPicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let names = ["approach", "approaches"];
        let legend = [
            "black: the disk's way, and the disk where it touched; grey: touches before",
            "colours: what may lie there; orange: the approach chosen next",
        ];
        let subtitles: Vec<_> = self.subtitles.iter().cloned().chain(legend.map(str::to_owned)).collect();
        strip(self.title, &subtitles, names, self.steps.len(), |step| self.scene(step))
    }

    fn scene(&self, number: usize) -> PlotScene {
        let step = &self.steps[number];
        let met = if step.touched.is_some() { "touched" } else { "nothing there" };
        let mut scene = PlotScene::new(format!("{}: {met}; {}", number + 1, step.words));
        let [low, high] = self.area;
        let rectangle = [low, Point2::new(high.x, low.y), high, Point2::new(low.x, high.y)];
        scene.polygon(&rectangle, Stroke::solid(Colour::GREY, 0.8).with(Dash::Dotted));
        for before in self.steps[..number].iter().filter_map(|step| step.touched) {
            scene.disk(before, self.radius, Style::line(Stroke::solid(Colour::GREY.faded(0.6), 0.8)));
        }
        let is_filled = step.left.len() <= FILLED_MAX;
        for left in step.left.iter().rev() {
            let colour = colour(left.kind);
            let edge =
                Stroke::solid(if is_filled { colour } else { colour.faded(0.6) }, if is_filled { 1.4 } else { 0.5 });
            scene.polygon(
                &left.outline,
                if is_filled { Style::area(colour, 0.12).outlined(edge) } else { Style::line(edge) },
            );
        }
        let mut named: Vec<&str> = Vec::new();
        for left in step.left.iter().filter(|_| is_filled) {
            let Some(name) = left.name.as_deref().filter(|name| !named.contains(name)) else { continue };
            named.push(name);
            let middle = left.outline.iter().map(|corner| corner.coords).sum::<Vector2<f64>>();
            let middle = Point2::from(middle / left.outline.len().max(1) as f64);
            scene.label(middle, Vector2::new(0.0, 1.0), name, colour(left.kind));
        }
        let from = step.approach.from;
        scene.polyline(&[from, step.touched.unwrap_or_else(|| end(&step.approach))], made());
        scene.dot(from, Colour::BLACK);
        if let Some(at) = step.touched {
            scene.disk(at, self.radius, Style::line(made()));
        }
        if let Some(next) = self.steps.get(number + 1) {
            scene.arrow(next.approach.from, end(&next.approach) - next.approach.from, NEXT);
        }
        scene
    }
}

const NEXT: Colour = Colour::ORANGE;

fn made() -> Stroke {
    Stroke::solid(Colour::BLACK, 1.0)
}

fn end(approach: &Approach) -> Point2<f64> {
    approach.at(approach.length)
}

fn colour(kind: usize) -> Colour {
    // The approach that is chosen next is orange.
    let kinds = [Colour::BLUE, Colour::VERMILLION, Colour::GREEN, Colour::PURPLE, Colour::SKY_BLUE];
    kinds[kind % kinds.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_approach_has_a_panel_with_what_is_left_and_the_next() {
        let outline = [[0.05, 0.05], [0.11, 0.05], [0.11, 0.08]].map(Point2::from).to_vec();
        let approach = |x: f64| Approach { from: Point2::new(x, -0.02), direction: Vector2::y(), length: 0.2 };
        let left = |kind, name: &str| TouchLeft { outline: outline.clone(), kind, name: Some(name.to_owned()) };
        let steps = [
            TouchStep { approach: approach(0.02), touched: None, left: Vec::new(), words: "2 parts left".to_owned() },
            TouchStep {
                approach: approach(0.08),
                touched: Some(Point2::new(0.08, 0.035)),
                left: vec![left(0, "wedge"), left(1, "block")],
                words: "2 poses left".to_owned(),
            },
        ];
        let area = [Point2::origin(), Point2::new(0.16, 0.16)];
        let picture = TouchPicture { steps: &steps, area, radius: 0.015, title: "a part", subtitles: &[] };
        let svg = picture.figure().to_page().to_svg();
        for words in ["1: nothing there; 2 parts left", "2: touched; 2 poses left", "wedge", "block"] {
            assert!(svg.contains(&format!("aria-label=\"{words}\"")), "{words}");
        }
    }
}
