//! The picture of a slow push: part, finger and force on the table, and what happens at the contact along the finger's way.
//!
//! Pure. Frames: world. Units: SI in, millimetres, degrees and shares of the weight on the axes.

use nalgebra::{Point2, Vector2};
use palpate::geometry::Element;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::quasi_static::{SlowMode, SlowSample};
use palpate_files::part::PartFile;

use super::push::{
    CHART_SPANS_MIN, FINGER, FORCE, FORCE_SHARE, Moment, OUTLINES, PAGE, PART, TRACK, finger_style, part_style, size,
};
use crate::pictures::plot::{Chart, Colour, Dash, Figure, Key, PlotScene, Stroke};
use crate::push_scenario::slow::SlowlyPushed;

/// Parts of the way to ask for, for smooth curves.
pub const SAMPLES: u32 = 300;

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct SlowPushPicture<'a> {
    /// The part with its outline.
    pub file: &'a PartFile,
    /// Its motion, sampled densely.
    pub pushed: &'a SlowlyPushed,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Friction between part and finger while it slides.
    pub friction: f64,
    /// Title, above everything.
    pub title: &'a str,
    /// Lines below the title.
    pub subtitles: &'a [String],
}

impl SlowPushPicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let figure = Figure::new(self.title, PAGE[0], PAGE[1]).subtitles(self.subtitles);
        let charts = [self.place_chart(), self.turn_chart(), self.force_chart()];
        figure.scene_with_charts(self.scene(), charts)
    }

    fn samples(&self) -> &[SlowSample] {
        &self.pushed.run.samples
    }

    fn centre(&self, sample: &SlowSample) -> Point2<f64> {
        sample.pose.isometry() * self.file.part.centre_of_mass()
    }

    fn scene(&self) -> PlotScene {
        let mut scene = PlotScene::new("");
        let last = self.samples().len() - 1;
        let shown: Vec<usize> = (0..OUTLINES).map(|k| k * last / (OUTLINES - 1)).collect();
        for (k, &index) in shown.iter().enumerate() {
            let (isometry, moment) = (self.samples()[index].pose.isometry(), Moment::of(k));
            let outline: Vec<_> = self.file.part.outline().iter().map(|p| isometry * p).collect();
            scene.polygon(&outline, part_style(moment));
            scene.disk(self.pushed.centres[index], self.radius, finger_style(moment));
        }
        let centres: Vec<_> = self.samples().iter().map(|sample| self.centre(sample)).collect();
        scene.polyline(&centres, Stroke::solid(TRACK, 1.5));
        scene.polyline(&self.pushed.centres, Stroke::solid(FINGER, 1.0).with(Dash::Dotted));
        self.forces(&mut scene, &shown);
        let beside = self.beside_track();
        for &index in &shown {
            scene.dot(centres[index], TRACK);
        }
        // The first and last; between, places along a straight way say themselves.
        for index in [0, last] {
            scene.label(centres[index], beside, format!("{:.1} mm", self.pushed.lengths[index] * 1e3), TRACK);
        }
        scene.key(Key::Area(part_style(Moment::End)), "part");
        scene.key(Key::Line(Stroke::solid(FINGER, 1.5)), "finger");
        scene.key(Key::Line(Stroke::solid(FINGER, 1.0).with(Dash::Dashed)), "start");
        scene.key(Key::Arrow(FORCE), "force on the part");
        scene.key(Key::Dot(TRACK), "centre of mass");
        scene
    }

    /// The force at each moment, all to one scale.
    fn forces(&self, scene: &mut PlotScene, shown: &[usize]) {
        let contacts = shown.iter().filter_map(|&index| self.samples()[index].contact);
        let contacts: Vec<_> = contacts.collect();
        let largest = contacts.iter().map(|contact| contact.force.norm()).fold(0.0, f64::max);
        let length = FORCE_SHARE * size(&self.file.part) / largest.max(f64::MIN_POSITIVE);
        for contact in contacts {
            scene.arrow(contact.at, contact.force * length, FORCE);
        }
    }

    /// Across the track of the centre of mass, away from the contact.
    fn beside_track(&self) -> Vector2<f64> {
        let samples = self.samples();
        let along = self.centre(&samples[samples.len() - 1]) - self.centre(&samples[0]);
        let across = Vector2::new(along.y, -along.x);
        let from_contact = |sample: &SlowSample| {
            sample.contact.map_or_else(Vector2::zeros, |contact| self.centre(sample) - contact.at)
        };
        let side = samples.iter().map(from_contact).sum::<Vector2<f64>>().dot(&across);
        if side < 0.0 { -across } else { across }
    }

    /// A chart along the finger's way with a line at each change of the contact.
    fn chart(&self, title: &str, label: &str, named: bool) -> Chart {
        let mut chart = Chart::new(title, ["way [mm]", label]);
        for change in &self.pushed.run.changes {
            let name = match change.to {
                Some(SlowMode::Sticking) => "sticks",
                Some(SlowMode::Sliding) => "slides",
                None => "leaves",
            };
            chart.instant(change.length * 1e3, if named { name } else { "" });
        }
        chart
    }

    /// Where along the whole outline the contact is, from vertex 0 on.
    fn place_chart(&self) -> Chart {
        let outline = self.file.part.outline();
        let mut starts = vec![0.0];
        for (i, vertex) in outline.iter().enumerate() {
            starts.push(starts[i] + (outline[(i + 1) % outline.len()] - vertex).norm());
        }
        let place = |sample: &SlowSample| {
            let contact = sample.contact?;
            Some(match contact.element {
                Element::Vertex(vertex) => starts[vertex],
                Element::Edge(edge) => {
                    let at = sample.pose.isometry().inverse_transform_point(&contact.at);
                    starts[edge] + (at - outline[edge]).norm()
                }
            })
        };
        let mut chart = self.chart("Contact along the outline, from vertex 0 on", "place [mm]", true);
        chart.y_span_at_least(CHART_SPANS_MIN[0]);
        let points = self.along(|sample| place(sample).map(|place| place * 1e3));
        chart.curve("", &points, Stroke::solid(PART, 1.8));
        let touched = |place: f64| points.iter().any(|point| (point[1] - place).abs() < f64::EPSILON * 1e3);
        for (vertex, start) in starts[..outline.len()].iter().enumerate() {
            if touched(start * 1e3) {
                chart.level(start * 1e3, format!("vertex {vertex}"));
            }
        }
        chart
    }

    fn turn_chart(&self) -> Chart {
        let mut chart = self.chart("Turn of the part", "turned [°]", false);
        chart.y_span_at_least(1.0);
        let first = self.samples()[0].pose.theta;
        let points = self.along(|sample| Some((sample.pose.theta - first).to_degrees()));
        chart.curve("", &points, Stroke::solid(TRACK, 1.8));
        chart
    }

    fn force_chart(&self) -> Chart {
        let mut chart = self.chart("Force on the part, as a share of its weight", "force / weight", false);
        chart.y_span_at_least(CHART_SPANS_MIN[2]);
        let part = |turn: bool| {
            self.along(|sample| {
                let contact = sample.contact?;
                let (sin, cos) = contact.normal_angle.sin_cos();
                let axis = if turn { Vector2::new(-sin, cos) } else { Vector2::new(-cos, -sin) };
                Some(contact.force.dot(&axis) / GRAVITY_ASSUMED)
            })
        };
        let normal = part(false);
        if self.friction > 0.0 {
            let cone: Vec<_> = normal.iter().map(|&[t, f]| [t, -self.friction * f, self.friction * f]).collect();
            chart.band("friction cone", &cone, Colour::ORANGE);
        }
        chart.curve("into the part", &normal, Stroke::solid(FORCE, 1.8));
        chart.curve("along the edge", &part(true), Stroke::solid(PART, 1.8).with(Dash::Dashed));
        chart
    }

    /// A quantity along the way; NaN, a gap in the curve, where there is none.
    fn along(&self, quantity: impl Fn(&SlowSample) -> Option<f64>) -> Vec<[f64; 2]> {
        let each = self.pushed.lengths.iter().zip(self.samples());
        each.map(|(length, sample)| [length * 1e3, quantity(sample).unwrap_or(f64::NAN)]).collect()
    }
}

#[cfg(test)]
mod tests {
    use palpate::geometry::Pose;

    use super::*;
    use crate::push_scenario::slow::{SlowPlan, SlowWay};

    #[test]
    fn a_picture_names_what_it_shows() {
        let text = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3";
        let file = PartFile::parse(text).unwrap();
        let places = [[0.075, -0.02], [0.055, 0.01], [0.02, 0.03]].map(Point2::from).to_vec();
        let way = SlowWay::Along { places, pose: Pose { x: 0.0, y: 0.0, theta: 0.0 } };
        let plan = SlowPlan { way, radius: 6e-3, contact_friction: [0.3; 2], height: 0.0, ring_radius: 1e-3 };
        let pushed = plan.run(&file, SAMPLES).unwrap();
        let picture = SlowPushPicture {
            file: &file,
            pushed: &pushed,
            radius: 6e-3,
            friction: 0.3,
            title: "block",
            subtitles: &["µ 0.3".to_owned()],
        };
        let svg = picture.figure().to_page().to_svg();
        for words in ["block", "µ 0.3", "x [mm]", "turned [°]", "place [mm]", "force on the part", "0.0 mm", "sticks"]
        {
            assert!(svg.contains(&format!("aria-label=\"{words}\"")), "{words}");
        }
    }
}
