//! The picture of an inscription: the sensors, what they see, and the part in every pose that fits.
//!
//! Frames: world. Units: m.

use nalgebra::{Isometry2, Point2, Vector2};
use palpate::inscription::{PlannedView, Pose};
use palpate::point_sampling::Circle;
use palpate_files::views::{NamedPart, Views};

use super::strip::strip;
use crate::pictures::plot::{Colour, Dash, Figure, Key, PlotScene, Stroke, Style};

/// Size of the page.
const PAGE: [f64; 2] = [900.0, 720.0];

/// Rays are drawn past the part's middle by this share of their length up to there, and at least by the part's size.
const RAY_BEYOND: f64 = 0.15;

/// Of points on the outline.
const PROBED: Colour = Colour::BLACK;

/// Of points that tell poses apart, as in the picture of a sampling plan.
const ASKED: Colour = Colour::VERMILLION;

/// A pose with the part that has it.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// The part that has the pose.
    pub part: &'a NamedPart,
    /// Pose of the part in the world.
    pub pose: Pose,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct InscribePicture<'a> {
    /// What the sensors saw.
    pub views: &'a Views,
    /// The poses, best first.
    pub poses: &'a [Shown<'a>],
    /// Where to look from next.
    pub next: Option<PlannedView>,
    /// Points that tell the poses apart, numbered as in the plan.
    pub points: &'a [Circle],
    /// What a line that the part touches is called.
    pub fences: &'a str,
    /// Title, above everything.
    pub title: &'a str,
    /// Lines below the title.
    pub subtitles: &'a [String],
}

/// A part that went by: what its barriers and beams saw, and its poses.
#[derive(Clone, Debug)]
pub struct Passed {
    /// What was seen.
    pub views: Views,
    /// The poses with the parts that have them, best first.
    pub poses: Vec<(NamedPart, Pose)>,
    /// A few words above its panel.
    pub words: String,
}

/// The parts that went by, a panel for each.
#[must_use]
pub fn passed(title: &str, subtitles: &[String], passed: &[Passed]) -> Figure {
    strip(title, subtitles, ["part", "parts"], passed.len(), |place| {
        let Passed { views, poses, words } = &passed[place];
        let poses: Vec<_> = poses.iter().map(|(part, pose)| Shown { part, pose: *pose }).collect();
        let fences = "side of a light barrier";
        let picture =
            InscribePicture { views, poses: &poses, next: None, points: &[], fences, title: "", subtitles: &[] };
        picture.scene(words)
    })
}

impl InscribePicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        Figure::new(self.title, PAGE[0], PAGE[1]).subtitles(self.subtitles).panel(self.scene(""))
    }

    /// The same as one panel of several.
    fn scene(&self, title: &str) -> PlotScene {
        let mut scene = PlotScene::new(title);
        self.draw_rays(&mut scene);
        for (k, shown) in self.poses.iter().enumerate().rev() {
            draw_part(&mut scene, shown, k);
        }
        for (k, shown) in self.poses.iter().enumerate() {
            let (centre, colour) = (centre(shown), colour(k));
            scene.dot(centre, colour);
            scene.label(centre, Vector2::new(0.0, 1.0), (k + 1).to_string(), colour);
        }
        // Above the parts, whose outlines pass through them.
        for point in &self.views.points {
            scene.dot(*point, PROBED);
        }
        for (k, point) in self.points.iter().enumerate() {
            scene.disk(point.centre, point.radius, Style::area(ASKED, 0.25));
            scene.dot(point.centre, ASKED);
            scene.label(point.centre, Vector2::new(1.0, -1.0), (k + 1).to_string(), ASKED);
        }
        if let Some(next) = self.next {
            scene.dot(next.site, Colour::ORANGE);
            // On the side of the part, so that the text stays inside the frame.
            scene.label(next.site, self.middle() - next.site, "look from here next", Colour::ORANGE);
        }
        if !self.views.readings.bearings.is_empty() {
            scene.key(Key::Dot(Colour::BLACK), "sensor");
            scene.key(Key::Line(ray_stroke()), "side of what it sees");
        }
        if !self.views.readings.fences.is_empty() {
            scene.key(Key::Line(fence_stroke()), self.fences);
        }
        if !self.views.points.is_empty() {
            scene.key(Key::Dot(PROBED), "probed contact");
        }
        if !self.points.is_empty() {
            scene.key(Key::Dot(ASKED), "point that tells poses apart");
        }
        if !self.poses.is_empty() {
            scene
                .key(Key::Area(style(0)), if self.poses.len() > 1 { "part, numbered as in the table" } else { "part" });
        }
        scene
    }

    /// Where the part is, roughly: the mean of the poses, or the middle of what the first sensor sees.
    fn middle(&self) -> Point2<f64> {
        let Some(first) = self.poses.first() else { return self.crossing() };
        centre(first)
    }

    /// Without a pose: where the middles of the first two cones cross, or a little ahead of the only one.
    fn crossing(&self) -> Point2<f64> {
        let axis = |k: usize| {
            let cone = self.views.cones.get(k)?;
            let [right, _] = cone.bearings();
            let angle = right.angle + cone.opening() / 2.0;
            Some((cone.apex(), Vector2::new(angle.cos(), angle.sin())))
        };
        match (axis(0), axis(1)) {
            (Some((a, d)), Some((b, e))) if d.perp(&e).abs() > 1e-3 => a + d * ((b - a).perp(&e) / d.perp(&e)),
            (Some((a, d)), _) => a + d,
            _ => Point2::origin(),
        }
    }

    fn draw_rays(&self, scene: &mut PlotScene) {
        let middle = self.middle();
        let size = self.poses.first().map_or(0.0, |shown| shown.part.convex.size());
        // Where the part had not moved: rays of a moved part are drawn as if the sensor had moved back.
        for bearing in &self.views.readings.bearings {
            let distance = (middle - bearing.apex).norm();
            let end = bearing.apex
                + (distance * (1.0 + RAY_BEYOND) + size) * Vector2::new(bearing.angle.cos(), bearing.angle.sin());
            scene.polyline(&[bearing.apex, end], ray_stroke());
            scene.dot(bearing.apex, Colour::BLACK);
        }
        for fence in &self.views.readings.fences {
            let along = Vector2::new(-fence.normal.y, fence.normal.x);
            let foot = middle - fence.normal * fence.beyond(middle);
            let reach = along * (1.2 * size.max(1e-3));
            scene.polyline(&[foot - reach, foot + reach], fence_stroke());
        }
    }
}

fn ray_stroke() -> Stroke {
    Stroke::solid(Colour::DARK_GREY, 0.8).with(Dash::Dashed)
}

fn fence_stroke() -> Stroke {
    Stroke::solid(Colour::DARK_GREY, 2.0)
}

fn colour(pose: usize) -> Colour {
    Colour::SERIES[pose % Colour::SERIES.len()]
}

fn style(pose: usize) -> Style {
    Style::area(colour(pose), if pose == 0 { 0.25 } else { 0.08 }).outlined(Stroke::solid(colour(pose), 1.6))
}

fn world(shown: &Shown<'_>) -> Isometry2<f64> {
    Isometry2::new(Vector2::new(shown.pose.x, shown.pose.y), shown.pose.theta)
}

fn centre(shown: &Shown<'_>) -> Point2<f64> {
    world(shown) * shown.part.convex.centre()
}

fn draw_part(scene: &mut PlotScene, shown: &Shown<'_>, index: usize) {
    let vertices: Vec<_> = shown.part.outline.vertices().iter().map(|p| world(shown) * p).collect();
    scene.polygon(&vertices, style(index));
    // A mark at the first vertex tells turned copies apart.
    scene.polyline(&[centre(shown), vertices[0]], Stroke::solid(colour(index), 0.8).with(Dash::Dotted));
}
