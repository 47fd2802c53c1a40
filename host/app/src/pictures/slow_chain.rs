//! The picture of slow pushes one after another: a frame a push, with what is believed after it.
//!
//! Pure. Frames: world. Units: SI in, millimetres on the axes.

use nalgebra::{Isometry2, Point2, Vector2};
use palpate::Pose;

use super::push::{FINGER, FORCE, PART, TRACK};
use crate::pictures::plot::{Colour, Dash, Figure, PlotScene, Stroke, Style};

/// Poses that are drawn of what is believed.
const DRAWN: usize = 40;

/// Frames beside each other, and below each other.
const COLUMNS: usize = 5;
const ROWS: usize = 2;

/// Size of a frame, and what titles take.
const FRAME: [f64; 2] = [250.0, 270.0];
const TITLES: f64 = 80.0;

/// What a frame shows.
#[derive(Clone, Debug)]
pub struct ChainPush {
    /// The disk's centre at travel 0, m.
    pub origin: Point2<f64>,
    /// Of its way, length 1.
    pub direction: Vector2<f64>,
    /// Travel at the way's end, m.
    pub end: f64,
    /// Travel where it first met the part, m, if that was felt.
    pub onset: Option<f64>,
    /// What is believed: poses of the centre of mass.
    pub poses: Vec<Pose>,
    /// The one that is stated.
    pub middle: Pose,
    /// Where the part was, if somebody saw.
    pub truth: Option<Pose>,
    /// Above the frame.
    pub title: String,
}

/// A picture of the last of these pushes, ten at most.
///
/// `outline` is the part's about its centre of mass, m, and `radius` the finger's, m.
#[must_use]
pub fn figure(title: &str, outline: &[Point2<f64>], radius: f64, pushes: &[ChainPush]) -> Figure {
    let rows = if pushes.len() > COLUMNS { ROWS } else { 1 };
    // Whole rows only.
    let count = pushes.len().min(ROWS * COLUMNS) / rows * rows;
    let shown = &pushes[pushes.len() - count..];
    let columns = count / rows;
    let [width, height] = FRAME;
    let seen = shown.iter().any(|push| push.truth.is_some());
    let words = format!(
        "light: poses that are believed; blue: the one that is stated{}; green: the finger's way, with its first touch",
        if seen { "; red, dashed: where the part was" } else { "" }
    );
    let figure = Figure::new(title, width * columns as f64 + 40.0, height * rows as f64 + TITLES).subtitle(words);
    (0..columns).fold(figure, |figure, column| {
        let frames = shown.iter().skip(column).step_by(columns);
        figure.column(1.0, frames.map(|push| frame(outline, radius, push).into()).collect())
    })
}

fn frame(outline: &[Point2<f64>], radius: f64, push: &ChainPush) -> PlotScene {
    let mut scene = PlotScene::new(push.title.as_str());
    let placed = |pose: &Pose| {
        let isometry: Isometry2<f64> = pose.isometry();
        outline.iter().map(|p| isometry * p).collect::<Vec<_>>()
    };
    let every = push.poses.len().div_ceil(DRAWN).max(1);
    for pose in push.poses.iter().step_by(every) {
        scene.polygon(&placed(pose), Stroke::solid(Colour::SKY_BLUE, 0.5));
    }
    scene.polygon(&placed(&push.middle), Style::area(Colour::SKY_BLUE, 0.2).outlined(Stroke::solid(PART, 1.8)));
    if let Some(truth) = &push.truth {
        scene.polygon(&placed(truth), Stroke::solid(FORCE, 1.4).with(Dash::Dashed));
    }
    let at = |travel: f64| push.origin + push.direction * travel;
    let begin = push.onset.map_or(push.end - 0.02, |onset| onset.min(push.end) - 0.01);
    scene.polyline(&[at(begin), at(push.end)], Stroke::solid(TRACK, 1.4));
    if let Some(onset) = push.onset {
        scene.dot(at(onset), TRACK);
    }
    scene.disk(at(push.end), radius, Stroke::solid(FINGER, 1.2));
    scene
}

#[cfg(test)]
mod tests {
    use super::*;

    fn push(number: usize, truth: Option<Pose>) -> ChainPush {
        let middle = Pose { x: 0.1, y: 0.01 * number as f64, theta: 0.2 };
        ChainPush {
            origin: Point2::new(0.1, -0.1),
            direction: Vector2::y(),
            end: 0.05,
            onset: Some(0.04),
            poses: vec![middle; 100],
            middle,
            truth,
            title: format!("push {number}"),
        }
    }

    #[test]
    fn frames_are_the_last_pushes_in_whole_rows() {
        let outline = [[-0.03, -0.02], [0.03, -0.02], [0.0, 0.04]].map(Point2::from);
        let svg = |count: usize, truth: Option<Pose>| {
            let pushes: Vec<_> = (1..=count).map(|number| push(number, truth)).collect();
            figure("a chain", &outline, 0.001, &pushes).to_page().to_svg()
        };
        let shows = |svg: &str, number: usize| svg.contains(&format!("aria-label=\"push {number}\""));
        let one = svg(1, None);
        assert!(shows(&one, 1) && !one.contains("dashed"), "{one}");
        let seven = svg(7, Some(Pose { x: 0.1, y: 0.0, theta: 0.0 }));
        assert!(!shows(&seven, 1) && (2..=7).all(|number| shows(&seven, number)));
        assert!(seven.contains("red, dashed"));
        let many = svg(14, None);
        assert!(!shows(&many, 4) && (5..=14).all(|number| shows(&many, number)));
    }
}
