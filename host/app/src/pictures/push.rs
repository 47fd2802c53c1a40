//! The picture of a push: part, finger and force on the table, and what happens at the contact over time.
//!
//! Pure. Frames: world. Units: SI in, millimetres, degrees and shares of the weight on the axes.

use std::f64::consts::TAU;

use nalgebra::{Point2, Vector2};
use palpate::pushing::dynamics::{ContactMode, FingerShape, PartSide, Sample};
use palpate_files::part::{DescribedPart, PartFile};

use crate::pictures::plot::{Chart, Colour, Dash, Figure, Key, PlotScene, Stroke, Style};
use crate::push_scenario::{Pushed, to_world};
use palpate::gravity::GRAVITY_ASSUMED;

/// Times of a push to ask for, for smooth curves.
pub const SAMPLES: usize = 300;

/// Outlines of the part to show, from start to end.
pub(super) const OUTLINES: usize = 6;

/// Points in which an elliptic finger is drawn.
const FINGER_POINTS: u32 = 120;

/// Thickness of a straight finger in the picture, as a share of the part's size.
const BAR_SHARE: f64 = 0.08;

/// Length of the longest force arrow, as a share of the part's size.
pub(super) const FORCE_SHARE: f64 = 0.25;

/// Least extents of the charts, so that rounding stays invisible: mm, °/s, shares of the weight.
pub(super) const CHART_SPANS_MIN: [f64; 3] = [1.0, 2.0, 0.02];

/// Size of the page.
pub(super) const PAGE: [f64; 2] = [1120.0, 720.0];

pub(super) const PART: Colour = Colour::BLUE;
pub(super) const FORCE: Colour = Colour::VERMILLION;
pub(super) const TRACK: Colour = Colour::GREEN;
pub(super) const FINGER: Colour = Colour::DARK_GREY;

/// What a picture shows.
#[derive(Clone, Copy, Debug)]
pub struct PushPicture<'a> {
    /// The part with its outline.
    pub file: &'a PartFile,
    /// Its motion, sampled densely.
    pub pushed: &'a Pushed,
    /// The number of the edge pushed, if it is one.
    pub edge: Option<usize>,
    /// Friction between part and finger, where the contact can slip.
    pub friction: Option<f64>,
    /// Title, above everything.
    pub title: &'a str,
    /// Lines below the title.
    pub subtitles: &'a [String],
}

impl PushPicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let figure = Figure::new(self.title, PAGE[0], PAGE[1]).subtitles(self.subtitles);
        let charts = [self.place_chart(), self.spin_chart(), self.force_chart()];
        figure.scene_with_charts(self.scene(), charts)
    }

    /// The samples with the end.
    fn samples(&self) -> Vec<Sample> {
        let run = &self.pushed.run;
        let before_end = |sample: &&Sample| sample.t < run.end.t;
        run.samples.iter().filter(before_end).chain([&run.last]).copied().collect()
    }

    fn scene(&self) -> PlotScene {
        let mut scene = PlotScene::new("");
        let samples = self.samples();
        let shown: Vec<&Sample> = (0..OUTLINES).map(|k| &samples[k * (samples.len() - 1) / (OUTLINES - 1)]).collect();
        for (k, sample) in shown.iter().enumerate() {
            self.outlines(&mut scene, sample, Moment::of(k));
        }
        self.tracks(&mut scene, &samples);
        self.forces(&mut scene, &shown);
        let centre = |sample: &Sample| to_world(sample, self.file.part.centre_of_mass());
        let marks: Vec<_> = shown.iter().map(|sample| (sample.t, centre(sample))).collect();
        scene.time_marks(&marks, self.beside_track(&samples), TRACK);
        scene.key(Key::Area(part_style(Moment::End)), "part");
        scene.key(Key::Line(Stroke::solid(FINGER, 1.5)), "finger");
        scene.key(Key::Line(Stroke::solid(FINGER, 1.0).with(Dash::Dashed)), "start");
        scene.key(Key::Arrow(FORCE), "force on the part");
        scene.key(Key::Dot(TRACK), "centre of mass");
        scene
    }

    /// Part and finger at one moment.
    fn outlines(&self, scene: &mut PlotScene, sample: &Sample, moment: Moment) {
        let outline: Vec<_> = self.file.part.outline().iter().map(|p| to_world(sample, *p)).collect();
        scene.polygon(&outline, part_style(moment));
        let centre = self.pushed.track.centre(sample.t);
        match self.pushed.shape {
            FingerShape::Disk { radius } => scene.disk(centre, radius, finger_style(moment)),
            shape @ FingerShape::Ellipse { .. } => {
                let at = |i: u32| TAU * f64::from(i) / f64::from(FINGER_POINTS);
                let points = (0..FINGER_POINTS).map(|i| centre + shape.point(at(i)));
                scene.polygon(&points.collect::<Vec<_>>(), finger_style(moment));
            }
            FingerShape::Line => self.bar(scene, centre, moment),
        }
    }

    /// A straight finger: as much of it as the part is large, with a thickness to be seen.
    fn bar(&self, scene: &mut PlotScene, centre: Point2<f64>, moment: Moment) {
        let (half, thick) = (size(&self.file.part), BAR_SHARE * size(&self.file.part));
        let corners = [[-half, 0.0], [-half, -thick], [half, -thick], [half, 0.0]];
        scene.polygon(&corners.map(|corner| centre + Vector2::from(corner)), finger_style(moment));
    }

    fn tracks(&self, scene: &mut PlotScene, samples: &[Sample]) {
        let centres: Vec<_> = samples.iter().map(|sample| to_world(sample, self.file.part.centre_of_mass())).collect();
        scene.polyline(&centres, Stroke::solid(TRACK, 1.5));
        let finger: Vec<_> = samples.iter().map(|sample| self.pushed.track.centre(sample.t)).collect();
        scene.polyline(&finger, Stroke::solid(FINGER, 1.0).with(Dash::Dotted));
    }

    /// The force at each moment, all to one scale.
    fn forces(&self, scene: &mut PlotScene, shown: &[&Sample]) {
        let force = |sample: &Sample| self.pushed.force_over_weight(sample).unwrap_or_default();
        let largest = shown.iter().map(|sample| force(sample).norm()).fold(0.0, f64::max);
        let length = FORCE_SHARE * size(&self.file.part) / largest.max(f64::MIN_POSITIVE);
        for sample in shown {
            let tail = self.pushed.contact_point(sample);
            scene.arrow(tail, force(sample) * length, FORCE);
        }
    }

    /// The direction across the track of the centre of mass that leads away from the contact, for labels clear of
    /// arrows.
    fn beside_track(&self, samples: &[Sample]) -> Vector2<f64> {
        let centre = |sample: &Sample| to_world(sample, self.file.part.centre_of_mass());
        let along = centre(&samples[samples.len() - 1]) - centre(&samples[0]);
        let across = Vector2::new(along.y, -along.x);
        let from_contact = |sample: &Sample| centre(sample) - self.pushed.contact_point(sample);
        let side = samples.iter().map(from_contact).sum::<Vector2<f64>>().dot(&across);
        if side < 0.0 { -across } else { across }
    }

    /// A chart over time with a line at each change between rolling and sliding.
    fn chart(&self, title: &str, label: &str, changes: Changes) -> Chart {
        let mut chart = Chart::new(title, ["time [s]", label]);
        self.mark(&mut chart, changes);
        chart
    }

    fn mark(&self, chart: &mut Chart, changes: Changes) {
        for change in &self.pushed.run.changes {
            let name = if matches!(change.to, ContactMode::Rolling) { "rolls" } else { "slides" };
            chart.instant(change.t, if changes == Changes::Named { name } else { "" });
        }
    }

    fn place_chart(&self) -> Chart {
        let label = if matches!(self.pushed.side, PartSide::Edge(_)) { "s [mm]" } else { "s [°]" };
        let scale = if matches!(self.pushed.side, PartSide::Edge(_)) { 1e3 } else { 1f64.to_degrees() };
        let mut chart = Chart::new("Contact on the part", ["time [s]", label]);
        self.mark(&mut chart, Changes::Named);
        chart.y_span_at_least(CHART_SPANS_MIN[0]);
        let points = self.over_time(|sample| Some(sample.state.s * scale));
        chart.curve("", &points, Stroke::solid(PART, 1.8));
        if let (PartSide::Edge(edge), Some(index)) = (self.pushed.side, self.edge) {
            let next = (index + 1) % self.file.part.outline().len();
            chart.level(edge.s_min * scale, format!("vertex {index}"));
            chart.level(edge.s_max * scale, format!("vertex {next}"));
        }
        chart
    }

    fn spin_chart(&self) -> Chart {
        let mut chart = self.chart("Turning of the part", "ω [°/s]", Changes::Marked);
        chart.y_span_at_least(CHART_SPANS_MIN[1]);
        let points = self.over_time(|sample| Some(sample.state.omega.to_degrees()));
        chart.curve("", &points, Stroke::solid(TRACK, 1.8));
        chart
    }

    fn force_chart(&self) -> Chart {
        let mut chart = self.chart("Force on the part, as a share of its weight", "force / weight", Changes::Marked);
        chart.y_span_at_least(CHART_SPANS_MIN[2]);
        let normal = self.over_time(|sample| sample.force.map(|force| force.normal / GRAVITY_ASSUMED));
        if let Some(friction) = self.friction {
            let cone: Vec<_> = normal.iter().map(|&[t, f]| [t, -friction * f, friction * f]).collect();
            chart.band("friction cone", &cone, Colour::ORANGE);
        }
        let along = self.over_time(|sample| sample.force.map(|force| force.tangential / GRAVITY_ASSUMED));
        chart.curve("into the part", &normal, Stroke::solid(FORCE, 1.8));
        chart.curve("along the edge", &along, Stroke::solid(PART, 1.8).with(Dash::Dashed));
        chart
    }

    /// A quantity over time; NaN, a gap in the curve, where there is none.
    fn over_time(&self, quantity: impl Fn(&Sample) -> Option<f64>) -> Vec<[f64; 2]> {
        self.samples().iter().map(|sample| [sample.t, quantity(sample).unwrap_or(f64::NAN)]).collect()
    }
}

/// The part's size: twice the mean distance of its outline's points from the centre of mass, m.
pub(super) fn size(part: &DescribedPart) -> f64 {
    let outline = part.outline();
    let distances = outline.iter().map(|p| (p - part.centre_of_mass()).norm());
    2.0 * distances.sum::<f64>() / outline.len() as f64
}

/// How changes between rolling and sliding are shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Changes {
    Named,
    Marked,
}

/// When in a push an outline is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Moment {
    Start,
    Between,
    End,
}

impl Moment {
    pub(super) fn of(outline: usize) -> Self {
        match outline {
            0 => Self::Start,
            last if last + 1 == OUTLINES => Self::End,
            _ => Self::Between,
        }
    }
}

pub(super) fn part_style(moment: Moment) -> Style {
    match moment {
        Moment::Start => Stroke::solid(PART, 1.5).with(Dash::Dashed).into(),
        Moment::Between => Style::area(Colour::SKY_BLUE, 0.10).outlined(Stroke::solid(Colour::SKY_BLUE, 0.8)),
        Moment::End => Style::area(Colour::SKY_BLUE, 0.30).outlined(Stroke::solid(PART, 1.8)),
    }
}

pub(super) fn finger_style(moment: Moment) -> Style {
    match moment {
        Moment::Start => Stroke::solid(FINGER, 1.2).with(Dash::Dashed).into(),
        Moment::Between => Stroke::solid(Colour::GREY, 0.6).into(),
        Moment::End => Style::area(Colour::GREY, 0.35).outlined(Stroke::solid(FINGER, 1.5)),
    }
}

#[cfg(test)]
mod tests {
    use palpate::pushing::dynamics::ContactLaw;

    use super::*;
    use crate::push_scenario::{Place, PushPlan};

    const BLOCK: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3";

    fn picture(part: &str, shape: FingerShape, times: &[f64], speed: f64) -> String {
        let file = PartFile::parse(part).unwrap();
        let edge = file.part.polygon().map(|_| 0);
        let place = match edge {
            Some(index) => Place::Edge { index, s: Some(0.02) },
            None => Place::Around { angle: -1.4 },
        };
        let plan = PushPlan {
            place,
            shape,
            speed,
            direction: 0.3,
            acceleration: 0.02,
            acceleration_direction: 0.0,
            then: Vec::new(),
            omega: 0.0,
            contact: ContactLaw::Coulomb { friction: 0.3 },
        };
        let pushed = plan.run(&file, times).unwrap();
        let subtitles = ["µ 0.3".to_owned()];
        let (friction, title) = (Some(0.3), "block");
        let picture = PushPicture { file: &file, pushed: &pushed, edge, friction, title, subtitles: &subtitles };
        picture.figure().to_page().to_svg()
    }

    const DISK: FingerShape = FingerShape::Disk { radius: 0.015 };

    #[test]
    fn a_picture_names_what_it_shows() {
        let svg = picture(BLOCK, DISK, &(0..=40).map(|k| f64::from(k) * 0.01).collect::<Vec<_>>(), 0.05);
        for words in
            ["block", "µ 0.3", "x [mm]", "ω [°/s]", "s [mm]", "vertex 1", "force on the part", "0.0 s", "0.4 s"]
        {
            assert!(svg.contains(&format!("aria-label=\"{words}\"")), "{words}");
        }
    }

    #[test]
    fn a_push_of_one_instant_can_be_drawn() {
        assert!(picture(BLOCK, DISK, &[0.0], 0.0).contains("0.0 s"));
    }

    #[test]
    fn an_ellipse_around_an_ellipse_is_told_in_degrees() {
        let egg = "unit = 'mm'\nellipse = {a = 40, b = 30}\nmu = 0.3";
        let svg = picture(egg, FingerShape::Ellipse { semi_axes: [0.02, 0.01] }, &[0.0, 0.2], 0.05);
        assert!(svg.contains("s [°]") && !svg.contains("vertex"));
    }
}
