//! The picture of a push that was observed: the part wherever it may be, how it came there, and the force that tells it.
//!
//! Every pose is drawn as faint as it is unlikely; of the likeliest one there is also the way of its centre of mass, where the
//! part was at first, and how uncertain its place is. Beside it the force on the finger over time, what the likeliest
//! explanation has instead, and what that leaves.
//!
//! Pure. Frames: finger axes, with the origin of the motion. Units: SI in; millimetres, newtons and millinewtons on the axes.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point2, Vector2};
use palpate::geometry::Pose;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::centre_covariance;

use crate::pictures::plot::{Chart, Colour, Dash, Figure, Key, PlotScene, Stroke, Style};

/// Poses that are drawn at the most: a hundredth ink each beyond.
const POSES_MAX: usize = 60;

/// Poses as likely as this have their probability written beside them, and so many at the most.
const WRITTEN: (f64, usize) = (0.05, 5);

/// Opacity of a pose that is certain, and least one.
const OPACITY: [f64; 2] = [0.40, 0.004];

/// Least share of its colour that an outline keeps: of one that is unlikely.
const INK_MIN: f64 = 0.15;

/// Moments marked along the way of the centre of mass.
const MARKS: usize = 6;

/// Points of an ellipse.
const ELLIPSE_POINTS: u32 = 60;

/// The region drawn about the likeliest place, in standard deviations: 95 % of a Gaussian in the plane.
const REGION_SDS: f64 = 2.448;

/// What is not explained is shown beside so many standard deviations.
const BAND_SDS: f64 = 2.0;

/// Least extents of the charts: N, mN, squared deviations.
const CHART_SPANS_MIN: [f64; 3] = [0.01, 1.0, 6.0];

/// Size of the page, and height of a line below the title.
const PAGE: [f64; 2] = [1120.0, 640.0];

const PART: Colour = Colour::BLUE;
const FINGER: Colour = Colour::DARK_GREY;
const TRACK: Colour = Colour::GREEN;
const ALONG: [Colour; 2] = [Colour::VERMILLION, Colour::PURPLE];

/// Where the part may be at the end.
#[derive(Clone, Copy, Debug)]
pub struct PossiblePose {
    /// Between 0 and 1.
    pub probability: f64,
    /// Of the part.
    pub pose: Pose,
    /// Of x, y, theta; none where none is stated.
    pub covariance: Option<Matrix3<f64>>,
}

/// Force on the finger at a moment.
#[derive(Clone, Copy, Debug)]
pub struct ShownForce {
    /// s.
    pub time: f64,
    /// Of the contact, N.
    pub felt: Vector2<f64>,
    /// What the likeliest explanation leaves of it, and its standard deviation along each axis, N.
    pub left: Option<[Vector2<f64>; 2]>,
}

/// What of the force is not explained, where it is not told in newtons.
#[derive(Clone, Debug, Default)]
pub struct Misfits {
    /// Time (s) and squared deviations of one reading.
    pub over_time: Vec<[f64; 2]>,
    /// What chance exceeds once in a hundred readings.
    pub usual_max: f64,
}

/// What a picture shows.
#[derive(Clone, Debug)]
pub struct ObservedPicture<'a> {
    /// The part with its outline.
    pub part: &'a Part,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// The disk's centre over time, to the end of what was felt: s, m.
    pub finger: Vec<(f64, Point2<f64>)>,
    /// Everywhere that the part may be at the end, the likeliest first.
    pub poses: Vec<PossiblePose>,
    /// The part over time by the likeliest explanation.
    pub trail: Vec<(f64, Pose)>,
    /// What was felt.
    pub force: Vec<ShownForce>,
    /// Of a push that was followed from reading to reading.
    pub misfits: Option<Misfits>,
    /// Title, above everything.
    pub title: String,
    /// Lines below the title.
    pub subtitles: Vec<String>,
}

impl ObservedPicture<'_> {
    /// Draws the picture, with its own size.
    #[must_use]
    pub fn figure(&self) -> Figure {
        let figure = Figure::new(self.title.as_str(), PAGE[0], PAGE[1] + 20.0 * self.subtitles.len() as f64);
        let mut charts = vec![self.force_chart().into()];
        if self.force.iter().any(|force| force.left.is_some()) {
            charts.push(self.left_chart().into());
        }
        if let Some(misfits) = &self.misfits {
            charts.push(misfits.chart().into());
        }
        figure.subtitles(&self.subtitles).column(1.15, vec![self.scene().into()]).column(1.0, charts)
    }

    /// How many of the poses are not drawn, being the least likely.
    fn left_out(&self) -> usize {
        self.poses.len().saturating_sub(POSES_MAX)
    }

    fn scene(&self) -> PlotScene {
        let mut scene = PlotScene::new(match self.left_out() {
            0 => String::new(),
            more => format!("the {POSES_MAX} likeliest poses; {more} more are not drawn"),
        });
        // The unlikely ones first, so that they hide nothing.
        for possible in self.poses.iter().take(POSES_MAX).rev() {
            scene.polygon(&self.outline(&possible.pose), pose_style(possible.probability));
        }
        self.likeliest(&mut scene);
        self.fingers(&mut scene);
        let written = |possible: &&PossiblePose| self.poses.len() > 1 && possible.probability >= WRITTEN.0;
        for possible in self.poses.iter().take(WRITTEN.1).filter(written) {
            let away = self.away_from_finger(self.centre(&possible.pose));
            scene.label(self.centre(&possible.pose), away, format!("p {:.2}", possible.probability), PART);
        }
        scene.key(Key::Area(pose_style(1.0)), "part, as faint as unlikely");
        if !self.trail.is_empty() {
            scene.key(Key::Line(Stroke::solid(PART, 1.0).with(Dash::Dashed)), "likeliest, at first");
            scene.key(Key::Dot(TRACK), "its centre of mass");
        }
        if self.poses.first().is_some_and(|best| best.covariance.is_some()) {
            scene.key(Key::Line(Stroke::solid(TRACK, 1.0)), "where that is, 95 %");
        }
        scene.key(Key::Line(Stroke::solid(FINGER, 1.5)), "finger");
        scene
    }

    fn likeliest(&self, scene: &mut PlotScene) {
        if let Some((_, first)) = self.trail.first() {
            scene.polygon(&self.outline(first), Stroke::solid(PART, 1.0).with(Dash::Dashed));
        }
        let way: Vec<_> = self.trail.iter().map(|(time, pose)| (*time, self.centre(pose))).collect();
        scene.polyline(&way.iter().map(|(_, at)| *at).collect::<Vec<_>>(), Stroke::solid(TRACK, 1.5));
        if let Some(last) = way.len().checked_sub(1) {
            let marks: Vec<_> = (0..MARKS).map(|k| way[k * last / (MARKS - 1)]).collect();
            let along = way[last].1 - way[0].1;
            let across = Vector2::new(along.y, -along.x);
            let beside = if self.away_from_finger(way[0].1).dot(&across) < 0.0 { -across } else { across };
            scene.time_marks(&marks, beside, TRACK);
        }
        if let Some((best, covariance)) = self.poses.first().and_then(|best| Some((best, best.covariance?))) {
            scene.polygon(&self.region(&best.pose, &covariance), Stroke::solid(TRACK, 1.0));
        }
    }

    fn fingers(&self, scene: &mut PlotScene) {
        let path: Vec<_> = self.finger.iter().map(|(_, centre)| *centre).collect();
        scene.polyline(&path, Stroke::solid(FINGER, 1.0).with(Dash::Dotted));
        if let (Some(first), Some(last)) = (path.first(), path.last()) {
            scene.disk(*first, self.radius, Stroke::solid(FINGER, 1.2).with(Dash::Dashed));
            scene.disk(*last, self.radius, Style::area(Colour::GREY, 0.35).outlined(Stroke::solid(FINGER, 1.5)));
        }
    }

    /// 95 % of where the centre of mass may be, by a pose's covariance.
    fn region(&self, pose: &Pose, covariance: &Matrix3<f64>) -> Vec<Point2<f64>> {
        let of_centre = centre_covariance(self.part, pose, covariance);
        let Some(lower) = of_centre.cholesky().map(|root| root.unpack()) else { return Vec::new() };
        let at = |k: u32| {
            let (sin, cos) = (TAU * f64::from(k) / f64::from(ELLIPSE_POINTS)).sin_cos();
            self.centre(pose) + lower * Vector2::new(cos, sin) * REGION_SDS
        };
        (0..ELLIPSE_POINTS).map(at).collect()
    }

    fn outline(&self, pose: &Pose) -> Vec<Point2<f64>> {
        self.part.polygon().vertices().iter().map(|vertex| pose.isometry() * vertex).collect()
    }

    fn centre(&self, pose: &Pose) -> Point2<f64> {
        pose.isometry() * self.part.centre_of_mass()
    }

    fn away_from_finger(&self, from: Point2<f64>) -> Vector2<f64> {
        self.finger.last().map_or_else(Vector2::y, |(_, finger)| from - finger)
    }

    fn force_chart(&self) -> Chart {
        let mut chart = Chart::new("Force on the finger", ["time [s]", "N"]);
        chart.y_span_at_least(CHART_SPANS_MIN[0]);
        for (axis, (name, colour)) in ["x", "y"].into_iter().zip(ALONG).enumerate() {
            let explained = |it: &ShownForce| it.left.map(|[left, _]| [it.time, it.felt[axis] - left[axis]]);
            let explained: Vec<_> = self.force.iter().filter_map(explained).collect();
            let felt: Vec<_> = self.force.iter().map(|it| [it.time, it.felt[axis]]).collect();
            if explained.is_empty() {
                chart.curve(&format!("{name}, felt"), &felt, Stroke::solid(colour, 1.6));
            } else {
                chart.dots(&format!("{name}, felt"), &felt, colour);
                chart.curve(&format!("{name}, explained"), &explained, Stroke::solid(colour, 1.2));
            }
        }
        chart
    }

    fn left_chart(&self) -> Chart {
        let title = "Felt and not explained, with two standard deviations";
        let mut chart = Chart::new(title, ["time [s]", "mN"]);
        chart.y_span_at_least(CHART_SPANS_MIN[1]);
        let left: Vec<_> = self.force.iter().filter_map(|it| Some((it.time, it.left?))).collect();
        let band = |(time, [_, sd]): &(f64, [Vector2<f64>; 2])| {
            let most = BAND_SDS * sd.amax() * 1e3;
            [*time, -most, most]
        };
        chart.band("", &left.iter().map(band).collect::<Vec<_>>(), Colour::GREY);
        for (axis, (name, colour)) in ["x", "y"].into_iter().zip(ALONG).enumerate() {
            let points: Vec<_> = left.iter().map(|(time, [left, _])| [*time, left[axis] * 1e3]).collect();
            chart.curve(name, &points, Stroke::solid(colour, 1.2));
        }
        chart
    }
}

impl Misfits {
    fn chart(&self) -> Chart {
        let mut chart = Chart::new("Misfit of each reading, by the likeliest", ["time [s]", "squared deviations"]);
        chart.y_span_at_least(CHART_SPANS_MIN[2]);
        chart.dots("", &self.over_time, PART);
        chart.level(self.usual_max, "99 of 100 by chance");
        chart
    }
}

/// A part drawn as faint as it is unlikely.
fn pose_style(probability: f64) -> Style {
    let share = probability.clamp(0.0, 1.0);
    let [certain, least] = OPACITY;
    let outline = Stroke::solid(PART.faded(INK_MIN.max(share)), if share > 0.5 { 1.8 } else { 1.0 });
    Style::area(Colour::SKY_BLUE, least.max(certain * share)).outlined(outline)
}

#[cfg(test)]
mod tests {
    use palpate::geometry::SimplePolygon;

    use super::*;

    fn block() -> Part {
        Part::uniform(
            SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from)).unwrap(),
        )
    }

    fn picture(part: &Part, poses: usize) -> ObservedPicture<'_> {
        let pose = |k: usize| Pose { x: 0.01 * k as f64, y: 0.0, theta: 0.3 * k as f64 };
        let share = |k: usize| 0.5_f64.powi(i32::try_from(k).unwrap() + 1);
        let covariance = Some(Matrix3::identity() * 1e-6);
        let poses = (0..poses).map(|k| PossiblePose { probability: share(k), pose: pose(k), covariance }).collect();
        let times = [0.0, 0.1, 0.2];
        ObservedPicture {
            part,
            radius: 0.015,
            finger: times.map(|t| (t, Point2::new(0.03 + t * 0.05, -0.015))).to_vec(),
            poses,
            trail: times.map(|t| (t, Pose { x: t * 0.05, y: 0.0, theta: 0.0 })).to_vec(),
            force: times
                .map(|time| ShownForce {
                    time,
                    felt: Vector2::new(0.1, -0.5),
                    left: Some([Vector2::new(1e-3, 2e-3), Vector2::repeat(2e-3)]),
                })
                .to_vec(),
            misfits: None,
            title: "wedge".to_owned(),
            subtitles: vec!["two poses".to_owned()],
        }
    }

    fn names(svg: &str, words: &str) -> bool {
        svg.contains(&format!("aria-label=\"{words}\""))
    }

    #[test]
    fn a_picture_names_the_poses_by_their_probability_and_shows_what_is_left() {
        let svg = picture(&block(), 2).figure().to_page().to_svg();
        for words in ["wedge", "two poses", "p 0.50", "p 0.25", "x, felt", "y, explained", "mN", "finger"] {
            assert!(names(&svg, words), "{words}");
        }
    }

    #[test]
    fn the_less_likely_a_pose_the_fainter_it_is() {
        let opacity = |probability: f64| pose_style(probability).fill.unwrap().opacity;
        let ink = |probability: f64| u32::from(pose_style(probability).stroke.unwrap().colour.rgb[0]);
        assert!(opacity(0.9) > opacity(0.5) && opacity(0.5) > opacity(0.1) && opacity(0.0) > 0.0);
        assert!(ink(0.9) < ink(0.5) && ink(0.5) < ink(0.1) && ink(0.0) < 255, "white is 255");
    }

    #[test]
    fn hundreds_of_poses_are_drawn_to_a_limit_that_is_told() {
        let part = block();
        let svg = picture(&part, POSES_MAX + 7).figure().to_page().to_svg();
        assert!(names(&svg, "the 60 likeliest poses; 7 more are not drawn"));
    }

    #[test]
    fn a_push_that_nothing_explains_shows_what_was_felt() {
        let part = block();
        let mut picture = picture(&part, 0);
        picture.trail.clear();
        picture.force.iter_mut().for_each(|force| force.left = None);
        picture.misfits = Some(Misfits { over_time: vec![[0.1, 2.0]], usual_max: 9.2 });
        let svg = picture.figure().to_page().to_svg();
        assert!(names(&svg, "x, felt") && !names(&svg, "x, explained") && names(&svg, "99 of 100 by chance"));
    }
}
