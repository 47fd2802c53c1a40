//! The picture of a sampling plan, like the thesis's figures 3.1, 3.5 and 3.6: outlines and points, with the fences if
//! there are any, and beside them the regions that the points are in the middle of.
//!
//! Pure. Frames: world. Units: SI in, millimetres on the axes.

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::point_sampling::Circle;

use super::strip::strip;
use crate::pictures::plot::{Colour, Dash, Figure, Key, PlotScene, Stroke, Style};

/// Size of the page.
const PAGE: [f64; 2] = [1120.0, 620.0];

/// Polygons up to which areas are filled and coloured in turn; more are outlines.
const FILLED_MAX: usize = 24;

/// Points up to which each has its number.
const NUMBERED_MAX: usize = 40;

const POINT: Colour = Colour::VERMILLION;
const OUTLINE: Colour = Colour::BLUE;

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct SamplingPicture<'a> {
    /// Outlines of the polygons, m.
    pub polygons: &'a [SimplePolygon],
    /// Points with their clearances.
    pub points: &'a [Circle],
    /// Lines from the corner along the fences.
    pub fences: &'a [[Point2<f64>; 2]],
    /// Title, above everything.
    pub title: &'a str,
    /// Lines below the title.
    pub subtitles: &'a [String],
}

impl SamplingPicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let figure = Figure::new(self.title, PAGE[0], PAGE[1]).subtitles(self.subtitles);
        figure.panel(self.shapes()).panel(self.regions())
    }

    /// Outlines and numbered points.
    fn shapes(&self) -> PlotScene {
        let mut scene = PlotScene::new(if self.points.is_empty() { "the outlines" } else { "what is told apart" });
        for (number, polygon) in self.polygons.iter().enumerate() {
            scene.polygon(polygon.vertices(), self.style(number));
        }
        self.add_fences(&mut scene);
        for (number, point) in self.points.iter().enumerate() {
            scene.dot(point.centre, POINT);
            if self.points.len() <= NUMBERED_MAX {
                scene.label(point.centre, Vector2::new(1.0, 1.0), (number + 1).to_string(), Colour::BLACK);
            }
        }
        if !self.points.is_empty() {
            scene.key(Key::Dot(POINT), "point");
        }
        if !self.fences.is_empty() {
            scene.key(Key::Line(fence()), "fence");
        }
        scene
    }

    /// The subdivision, with the room around each point.
    fn regions(&self) -> PlotScene {
        let none = self.points.is_empty();
        let title = if none { "their regions" } else { "their regions, and the room around each point" };
        let mut scene = PlotScene::new(title);
        for polygon in self.polygons {
            scene.polygon(polygon.vertices(), Stroke::solid(Colour::DARK_GREY, 0.6));
        }
        self.add_fences(&mut scene);
        for point in self.points {
            scene.disk(point.centre, point.radius, Style::area(POINT, 0.8));
        }
        scene
    }

    fn style(&self, number: usize) -> Style {
        if self.polygons.len() > FILLED_MAX {
            return Stroke::solid(OUTLINE, 0.7).into();
        }
        let colour = Colour::SERIES[number % Colour::SERIES.len()];
        Style::area(colour, 0.10).outlined(Stroke::solid(colour, 1.2))
    }

    fn add_fences(&self, scene: &mut PlotScene) {
        self.fences.iter().for_each(|line| scene.polyline(line, fence()));
    }
}

/// What the points of a plan read once.
#[derive(Clone, Debug, Default)]
pub struct Answered {
    /// Whether each point is covered; none where it could not be read.
    pub readings: Vec<Option<bool>>,
    /// The polygons that fit best.
    pub nearest: Vec<usize>,
    /// Points that misread, if it is the first of these.
    pub misread: Vec<usize>,
    /// A few words above its panel.
    pub words: String,
}

/// What points read, an answer a panel: the outlines that fit are filled, covered points are full and free ones empty.
#[must_use]
pub fn answered(
    title: &str,
    subtitles: &[String],
    polygons: &[SimplePolygon],
    points: &[Circle],
    answers: &[Answered],
) -> Figure {
    let misread = if answers.iter().any(|answer| !answer.misread.is_empty()) { "; red: misread" } else { "" };
    let legend = format!("full: a point that is covered; empty: one that is free{misread}; blue: what fits");
    let subtitles: Vec<_> = subtitles.iter().cloned().chain([legend]).collect();
    strip(title, &subtitles, ["answer", "answers"], answers.len(), |place| answer(polygons, points, &answers[place]))
}

fn answer(polygons: &[SimplePolygon], points: &[Circle], answer: &Answered) -> PlotScene {
    let mut scene = PlotScene::new(answer.words.clone());
    for polygon in polygons {
        scene.polygon(polygon.vertices(), Stroke::solid(Colour::GREY, 0.6));
    }
    for polygon in answer.nearest.iter().filter_map(|polygon| polygons.get(*polygon)) {
        scene.polygon(polygon.vertices(), Style::area(OUTLINE, 0.2).outlined(Stroke::solid(OUTLINE, 1.4)));
    }
    // Of one size, which the outlines give.
    let corners = polygons.iter().flat_map(SimplePolygon::vertices);
    let [low, high] = corners
        .fold([Point2::from([f64::MAX; 2]), Point2::from([f64::MIN; 2])], |[low, high], corner| {
            [low.inf(corner), high.sup(corner)]
        });
    let radius = READING_SHARE * (high - low).max();
    for (number, (point, reading)) in points.iter().zip(&answer.readings).enumerate() {
        let colour = if answer.misread.contains(&number) { POINT } else { Colour::BLACK };
        let edge = Stroke::solid(colour, 1.6);
        match reading {
            Some(true) => scene.disk(point.centre, radius, Style::area(colour, 1.0).outlined(edge)),
            Some(false) => scene.disk(point.centre, radius, Style::area(Colour::WHITE, 1.0).outlined(edge)),
            None => scene.disk(point.centre, radius, Style::line(edge.with(Dash::Dotted))),
        }
        scene.label(point.centre, Vector2::new(1.0, 1.0), (number + 1).to_string(), colour);
    }
    scene
}

/// Radius of a point that was read, by the size of all outlines.
const READING_SHARE: f64 = 0.018;

fn fence() -> Stroke {
    Stroke::solid(Colour::BLACK, 2.0).with(Dash::Dashed)
}

#[cfg(test)]
mod tests {
    use palpate::point_sampling::{Request, plan};

    use super::*;

    #[test]
    fn a_picture_without_points_speaks_of_none() {
        let square = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]].map(Point2::from);
        let polygons = [SimplePolygon::new(square).unwrap()];
        let picture =
            SamplingPicture { polygons: &polygons, points: &[], fences: &[], title: "a corner", subtitles: &[] };
        let svg = picture.figure().to_page().to_svg();
        assert!(svg.contains("the outlines") && !svg.contains("point"), "{svg}");
    }

    #[test]
    fn an_answer_fills_what_fits_and_shows_what_was_misread() {
        let square = [[0.0, 0.0], [0.1, 0.0], [0.1, 0.1], [0.0, 0.1]].map(Point2::from);
        let polygons = [SimplePolygon::new(square).unwrap()];
        let points = [0.02, 0.05].map(|x| Circle { centre: Point2::new(x, 0.05), radius: 0.01 });
        let drawn = |misread: Vec<usize>| {
            let readings = vec![Some(true), Some(false)];
            let answers = [Answered { readings, nearest: vec![0], misread, words: "a square".to_owned() }];
            answered("read", &[], &polygons, &points, &answers).to_page().to_svg()
        };
        let (good, bad) = (drawn(Vec::new()), drawn(vec![1]));
        assert!(good.contains("aria-label=\"a square\"") && good.contains("empty: one that is free; blue"), "{good}");
        assert!(!good.contains("misread") && bad.contains("red: misread"), "{bad}");
        let red = |svg: &str| svg.matches("#d55e00").count();
        assert!(red(&good) == 0 && red(&bad) > 0, "{bad}");
    }

    #[test]
    fn a_picture_numbers_its_points() {
        let block = |x: f64| {
            SimplePolygon::new([[x, 0.0], [x + 0.06, 0.0], [x + 0.06, 0.04], [x, 0.04]].map(Point2::from)).unwrap()
        };
        let polygons: Vec<_> = [0.0, 0.02, 0.04].map(block).into();
        let plan = plan(&polygons, &Request::default(), &|| false);
        let fences = [[Point2::origin(), Point2::new(0.2, 0.0)]];
        let subtitles = ["2 points".to_owned()];
        let picture = SamplingPicture {
            polygons: &polygons,
            points: &plan.points,
            fences: &fences,
            title: "blocks",
            subtitles: &subtitles,
        };
        let svg = picture.figure().to_page().to_svg();
        for words in ["blocks", "2 points", "fence", "point", "x [mm]"] {
            assert!(svg.contains(&format!("aria-label=\"{words}\"")), "{words}");
        }
    }
}
