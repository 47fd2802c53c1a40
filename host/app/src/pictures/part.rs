//! The picture of a part as palpate sees it: outline, hull, what it stands on, and the turned part that looks most like it.
//!
//! Pure. Frames: the part's own. Units: SI in.

use nalgebra::{Point2, Vector2};

use crate::pictures::plot::{Colour, Dash, Figure, Key, PlotScene, Stroke, Style};

/// Size of the page.
const PAGE: [f64; 2] = [760.0, 700.0];

/// Most vertices that are numbered.
const NUMBERED_MAX: usize = 24;

const PART: Colour = Colour::BLUE;
const LIKE: Colour = Colour::VERMILLION;
const FEET: Colour = Colour::DARK_GREY;
const MASS: Colour = Colour::GREEN;

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct PartPicture<'a> {
    /// Points of the outline, m.
    pub outline: &'a [Point2<f64>],
    /// Corners of its hull, m.
    pub hull: &'a [Point2<f64>],
    /// Whether there is a notch.
    pub is_notched: bool,
    /// m.
    pub centre_of_mass: Point2<f64>,
    /// m; none of a base that bears everywhere.
    pub feet: &'a [Point2<f64>],
    /// The outline in the pose that is most like the part, and what it is called.
    pub like: Option<(&'a [Point2<f64>], &'a str)>,
    /// Title, above everything.
    pub title: &'a str,
    /// Lines below the title.
    pub subtitles: &'a [String],
}

impl PartPicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        Figure::new(self.title, PAGE[0], PAGE[1]).subtitles(self.subtitles).panel(self.scene())
    }

    fn scene(&self) -> PlotScene {
        let mut scene = PlotScene::new("");
        let outline = Style::area(PART, 0.15).outlined(Stroke::solid(PART, 1.5));
        scene.polygon(self.outline, outline);
        scene.key(Key::Area(outline), "part");
        if self.is_notched {
            let hull = Stroke::solid(PART, 0.8).with(Dash::Dotted);
            scene.polygon(self.hull, hull);
            scene.key(Key::Line(hull), "hull");
        }
        if let Some((like, name)) = self.like {
            let stroke = Stroke::solid(LIKE, 1.0).with(Dash::Dashed);
            scene.polygon(like, stroke);
            scene.key(Key::Line(stroke), name);
        }
        for foot in self.feet {
            scene.dot(*foot, FEET);
        }
        if !self.feet.is_empty() {
            scene.key(Key::Dot(FEET), "foot");
        }
        scene.dot(self.centre_of_mass, MASS);
        scene.key(Key::Dot(MASS), "centre of mass");
        if self.outline.len() <= NUMBERED_MAX {
            for (number, vertex) in self.outline.iter().enumerate() {
                let away = (vertex - self.centre_of_mass).try_normalize(0.0).unwrap_or_else(Vector2::y);
                scene.label(*vertex, away, number.to_string(), Colour::BLACK);
            }
        }
        scene
    }
}
