//! The picture of a roll: the contact's path on the palm with the body's outline above it, and height and force over
//! time.
//!
//! Pure. Frames: palm, seen from above. Units: SI in, millimetres and shares of the weight on the axes.

use nalgebra::{Point2, Vector2, Vector3};
use palpate::rolling::{RollRun, RollSample, RollingBody};

use crate::pictures::plot::{Chart, Colour, Dash, Figure, Key, PlotScene, Stroke, Style};

/// Times of a roll to ask for, for smooth curves.
pub const SAMPLES: u32 = 400;

/// Outlines of the body to show, from start to end.
const OUTLINES: usize = 5;

/// Points of an outline.
const OUTLINE_POINTS: u32 = 96;

/// Size of the page.
const PAGE: [f64; 2] = [1120.0, 720.0];

/// Least extents of the charts, so that rounding stays invisible: mm, shares of the weight.
const CHART_SPANS_MIN: [f64; 2] = [1.0, 0.02];

const BODY: Colour = Colour::BLUE;
const CONTACT: Colour = Colour::VERMILLION;
const CENTRE: Colour = Colour::GREEN;

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct RollPicture<'a> {
    /// The body that rolls.
    pub body: &'a RollingBody,
    /// Its motion, sampled densely.
    pub run: &'a RollRun,
    /// Gravity, m/s².
    pub g: f64,
    /// Title, above everything.
    pub title: &'a str,
    /// Lines below the title.
    pub subtitles: &'a [String],
}

impl RollPicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let figure = Figure::new(self.title, PAGE[0], PAGE[1]).subtitles(self.subtitles);
        let charts = [self.height_chart(), self.force_chart(), self.turning_chart()];
        figure.scene_with_charts(self.scene(), charts)
    }

    /// The samples with the end.
    fn samples(&self) -> Vec<RollSample> {
        let before_end = |sample: &&RollSample| sample.t < self.run.end.t;
        self.run.samples.iter().filter(before_end).chain([&self.run.last]).copied().collect()
    }

    fn scene(&self) -> PlotScene {
        let mut scene = PlotScene::new("On the palm, seen from above");
        let samples = self.samples();
        let shown: Vec<&RollSample> =
            (0..OUTLINES).map(|k| &samples[k * (samples.len() - 1) / (OUTLINES - 1)]).collect();
        for (k, sample) in shown.iter().enumerate() {
            scene.polygon(&self.outline(sample), outline_style(k));
        }
        let path = |place: fn(&RollSample) -> Point2<f64>| samples.iter().map(place).collect::<Vec<_>>();
        scene.polyline(&path(centre), Stroke::solid(CENTRE, 1.2).with(Dash::Dashed));
        scene.polyline(&path(contact), Stroke::solid(CONTACT, 2.0));
        let marks: Vec<_> = shown.iter().map(|sample| (sample.t, contact(sample))).collect();
        scene.time_marks(&marks, Vector2::new(0.0, -1.0), CONTACT);
        scene.key(Key::Area(outline_style(OUTLINES - 1)), "body at the end");
        scene.key(Key::Line(Stroke::solid(BODY, 1.2).with(Dash::Dashed)), "at the start");
        scene.key(Key::Line(Stroke::solid(CONTACT, 2.0)), "contact");
        scene.key(Key::Line(Stroke::solid(CENTRE, 1.2).with(Dash::Dashed)), "centre of mass");
        scene
    }

    /// The body's shadow: its points with level normals.
    fn outline(&self, sample: &RollSample) -> Vec<Point2<f64>> {
        let attitude = sample.state.attitude();
        let edge = |k: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(k) / f64::from(OUTLINE_POINTS)).sin_cos();
            let normal = attitude.inverse() * Vector3::new(cos, sin, 0.0);
            centre(sample) + (attitude * self.body.shape().contact(&normal)).xy()
        };
        (0..OUTLINE_POINTS).map(edge).collect()
    }

    fn height_chart(&self) -> Chart {
        let mut chart = Chart::new("Height of the centre of mass", ["time [s]", "height [mm]"]);
        chart.y_span_at_least(CHART_SPANS_MIN[0]);
        let height = |sample: &RollSample| -(sample.state.attitude() * sample.contact_body).z * 1e3;
        chart.curve("", &self.over_time(height), Stroke::solid(CENTRE, 1.8));
        chart
    }

    fn force_chart(&self) -> Chart {
        let mut chart = Chart::new("Contact force, as a share of the weight", ["time [s]", "force / weight"]);
        chart.y_span_at_least(CHART_SPANS_MIN[1]);
        let weight = if self.g > 0.0 { self.g } else { 1.0 };
        let normal = self.over_time(|sample| sample.contact_force.z / weight);
        let along = self.over_time(|sample| sample.contact_force.xy().norm() / weight);
        chart.curve("upward", &normal, Stroke::solid(CONTACT, 1.8));
        chart.curve("along the palm", &along, Stroke::solid(BODY, 1.8).with(Dash::Dashed));
        chart
    }

    fn turning_chart(&self) -> Chart {
        let mut chart = Chart::new("Turning about palm axes", ["time [s]", "turning [°/s]"]);
        chart.y_span_at_least(2.0);
        let axes = [("x", BODY, Dash::Solid), ("y", CENTRE, Dash::Dashed), ("up", CONTACT, Dash::Dotted)];
        for (axis, (name, colour, dash)) in axes.into_iter().enumerate() {
            let turning = |sample: &RollSample| (sample.state.attitude() * sample.state.omega)[axis].to_degrees();
            chart.curve(name, &self.over_time(turning), Stroke::solid(colour, 1.5).with(dash));
        }
        chart
    }

    fn over_time(&self, quantity: impl Fn(&RollSample) -> f64) -> Vec<[f64; 2]> {
        self.samples().iter().map(|sample| [sample.t, quantity(sample)]).collect()
    }
}

fn contact(sample: &RollSample) -> Point2<f64> {
    Point2::from(sample.state.u)
}

/// The centre of mass above the palm.
fn centre(sample: &RollSample) -> Point2<f64> {
    contact(sample) - (sample.state.attitude() * sample.contact_body).xy()
}

fn outline_style(outline: usize) -> Style {
    match outline {
        0 => Stroke::solid(BODY, 1.2).with(Dash::Dashed).into(),
        last if last + 1 == OUTLINES => Style::area(Colour::SKY_BLUE, 0.30).outlined(Stroke::solid(BODY, 1.8)),
        _ => Style::area(Colour::SKY_BLUE, 0.08).outlined(Stroke::solid(Colour::SKY_BLUE, 0.8)),
    }
}

#[cfg(test)]
mod tests {
    use palpate::rolling::{OnPalm, PalmAcceleration, Roll, Spin};

    use super::*;

    #[test]
    fn a_picture_names_what_it_shows_even_of_one_instant() {
        let body = RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap();
        let on = OnPalm { body: &body, spin: Spin::Free, palm: &PalmAcceleration::Rest, g: 9.81 };
        for times in [vec![0.0], (0..=50).map(|k| f64::from(k) * 0.01).collect()] {
            let run = Roll::new(on, [0.6, 0.8, 0.0, 0.0], [1.0, 2.0, 0.0], [0.0; 2]).unwrap().run(&times).unwrap();
            let picture = RollPicture { body: &body, run: &run, g: 9.81, title: "pebble", subtitles: &[] };
            let svg = picture.figure().to_page().to_svg();
            for words in ["pebble", "contact", "centre of mass", "height [mm]", "turning [°/s]", "0.0 s"] {
                assert!(svg.contains(&format!("aria-label=\"{words}\"")), "{words}");
            }
        }
    }

    /// A sphere's shadow is a disk about its centre, which stands above the contact.
    #[test]
    fn the_outline_of_a_sphere_is_a_circle_about_the_contact() {
        let body = RollingBody::ellipsoid([0.03; 3]).unwrap();
        let on = OnPalm { body: &body, spin: Spin::Free, palm: &PalmAcceleration::Rest, g: 9.81 };
        let run = Roll::new(on, [0.6, 0.8, 0.0, 0.0], [1.0, 2.0, 0.0], [0.01, 0.02]).unwrap().run(&[0.1]).unwrap();
        let picture = RollPicture { body: &body, run: &run, g: 9.81, title: "", subtitles: &[] };
        for point in picture.outline(&run.last) {
            assert!(((point - contact(&run.last)).norm() - 0.03).abs() < 1e-12);
        }
    }
}
