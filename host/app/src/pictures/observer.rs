//! The pictures of an observer at work: what happens beside what it believes, and its states over time.
//!
//! Pure. Frames: world. Units: SI in; millimetres, degrees, rad/s and mm/s on the axes.

use nalgebra::{Point2, Vector2};
use palpate::geometry::Pose;
use palpate::pushing::dynamics::{Part, State};

use crate::pictures::plot::{Chart, Colour, Dash, Figure, Key, PlotScene, Stroke, Style};

/// Size of a page of scenes, of charts, and height of a line below the title.
const SCENES: [f64; 2] = [1160.0, 560.0];
/// See [`SCENES`].
const STATES: [f64; 2] = [1160.0, 640.0];
/// See [`SCENES`].
const LINE: f64 = 20.0;

/// Least extents of the charts, so that rounding stays invisible: degrees, mm, rad/s, mm/s.
const SPANS_MIN: [f64; 4] = [2.0, 2.0, 0.2, 1.0];

const TRUTH: Colour = Colour::BLUE;
const ESTIMATE: Colour = Colour::VERMILLION;
const FINGER: Colour = Colour::DARK_GREY;

/// Truth and belief at one time.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// s.
    pub time: f64,
    /// The disk's centre, m.
    pub finger: Point2<f64>,
    /// As it is.
    pub truth: State,
    /// As it is believed.
    pub estimate: State,
    /// Of the part.
    pub pose: Pose,
    /// As the estimate has it.
    pub believed: Pose,
}

/// What the pictures show.
#[derive(Clone, Copy, Debug)]
pub struct ObserverPicture<'a> {
    /// The part that is pushed.
    pub part: &'a Part,
    /// From where to where the edge in contact reaches, m.
    pub edge: [f64; 2],
    /// Of the disk, m.
    pub radius: f64,
    /// In order of time.
    pub moments: &'a [Moment],
    /// Which of them the scenes show.
    pub snapshots: &'a [usize],
    /// Whether the part slides, so that its tangential velocity is a state of its own.
    pub has_slip: bool,
    /// From when on truth and estimate are one, s.
    pub one: f64,
}

impl ObserverPicture<'_> {
    /// What happens beside what is believed, snapshot by snapshot.
    #[must_use]
    pub fn scenes(&self, title: String, subtitles: &[String]) -> Figure {
        let actual = self.scene("(a) what happens", TRUTH, |moment| (moment.pose, moment.truth.u));
        let believed =
            self.scene("(b) what the observer believes", ESTIMATE, |moment| (moment.believed, moment.estimate.u));
        let figure = headed(title, SCENES, subtitles);
        figure.panel(actual).panel(believed)
    }

    /// States and their estimates over time.
    #[must_use]
    pub fn states(&self, title: String, subtitles: &[String]) -> Figure {
        let angle = self.chart("(c) contact on the disk", "u [°]", SPANS_MIN[0], |state| state.u.to_degrees());
        let mut place = self.chart("(d) contact on the edge", "s [mm]", SPANS_MIN[1], |state| state.s * 1e3);
        for (end, name) in self.edge.into_iter().zip(["begins", "ends"]) {
            place.level(end * 1e3, format!("the edge {name}"));
        }
        let turning = self.chart("(e) turning of the part", "ω [rad/s]", SPANS_MIN[2], |state| state.omega);
        let figure = headed(title, STATES, subtitles);
        if self.has_slip {
            let along = self.chart("(f) speed along the edge", "vT [mm/s]", SPANS_MIN[3], |state| state.v_t * 1e3);
            return figure
                .column(1.0, vec![angle.into(), turning.into()])
                .column(1.0, vec![place.into(), along.into()]);
        }
        figure.column(1.0, vec![angle.into(), turning.into()]).column(1.0, vec![place.into()])
    }

    fn scene(&self, title: &str, colour: Colour, of: impl Fn(&Moment) -> (Pose, f64)) -> PlotScene {
        let mut scene = PlotScene::new(title);
        // To one scale: each reaches as far as both do, unseen.
        scene.polygon(&self.reach(), Style::default());
        let last = self.snapshots.len().saturating_sub(1);
        let shown = self.snapshots.iter().filter_map(|&number| self.moments.get(number));
        let marks = shown.enumerate().map(|(number, moment)| {
            let (pose, u) = of(moment);
            scene.polygon(&self.outline(&pose), part_style(colour, number, last));
            scene.disk(moment.finger, self.radius, finger_style(number, last));
            let contact = moment.finger + Vector2::new(u.cos(), u.sin()) * self.radius;
            let centre = pose.isometry() * self.part.centre_of_mass();
            (moment.time, centre, contact)
        });
        let marks: Vec<_> = marks.collect();
        let centres: Vec<_> = marks.iter().map(|(time, centre, _)| (*time, *centre)).collect();
        scene.polyline(&centres.iter().map(|(_, centre)| *centre).collect::<Vec<_>>(), Stroke::solid(colour, 1.2));
        scene.time_marks(&centres, Vector2::x(), colour);
        marks.iter().for_each(|(.., contact)| scene.dot(*contact, FINGER));
        scene.key(Key::Line(Stroke::solid(colour, 1.0).with(Dash::Dashed)), "part at first");
        scene.key(Key::Area(part_style(colour, last, last)), "at the end");
        scene.key(Key::Dot(FINGER), "contact");
        scene
    }

    /// Everything that both scenes show.
    fn reach(&self) -> Vec<Point2<f64>> {
        let shown = self.snapshots.iter().filter_map(|&number| self.moments.get(number));
        let poses = shown.flat_map(|moment| [moment.pose, moment.believed]);
        let outlines = poses.flat_map(|pose| self.outline(&pose));
        outlines.chain(self.moments.first().map(|first| first.finger - Vector2::repeat(self.radius))).collect()
    }

    fn outline(&self, pose: &Pose) -> Vec<Point2<f64>> {
        self.part.polygon().vertices().iter().map(|vertex| pose.isometry() * vertex).collect()
    }

    fn chart(&self, title: &str, label: &str, span_min: f64, of: impl Fn(&State) -> f64) -> Chart {
        let mut chart = Chart::new(title, ["time [s]", label]);
        chart.y_span_at_least(span_min);
        let over_time = |of_moment: &dyn Fn(&Moment) -> State| -> Vec<[f64; 2]> {
            self.moments.iter().map(|moment| [moment.time, of(&of_moment(moment))]).collect()
        };
        chart.curve("truth", &over_time(&|moment| moment.truth), Stroke::solid(TRUTH, 1.8));
        let dashed = Stroke::solid(ESTIMATE, 1.8).with(Dash::Dashed);
        chart.curve("estimate", &over_time(&|moment| moment.estimate), dashed);
        chart.instant(self.one, "together from here on");
        chart
    }
}

fn headed(title: String, [width, height]: [f64; 2], subtitles: &[String]) -> Figure {
    Figure::new(title, width, height + LINE * subtitles.len() as f64).subtitles(subtitles)
}

fn part_style(colour: Colour, number: usize, last: usize) -> Style {
    match number {
        0 => Stroke::solid(colour, 1.5).with(Dash::Dashed).into(),
        number if number == last => Style::area(colour, 0.25).outlined(Stroke::solid(colour, 1.8)),
        _ => Style::area(colour, 0.04).outlined(Stroke::solid(colour.faded(0.5), 0.8)),
    }
}

fn finger_style(number: usize, last: usize) -> Style {
    match number {
        0 => Stroke::solid(FINGER, 1.2).with(Dash::Dashed).into(),
        number if number == last => Style::area(Colour::GREY, 0.35).outlined(Stroke::solid(FINGER, 1.5)),
        _ => Stroke::solid(Colour::GREY, 0.6).into(),
    }
}

#[cfg(test)]
mod tests {
    use palpate::geometry::SimplePolygon;

    use super::*;

    #[test]
    fn both_scenes_and_all_states_are_shown() {
        let block = [[-0.03, 0.0], [0.03, 0.0], [0.03, 0.04], [-0.03, 0.04]].map(Point2::from);
        let part = Part::uniform(SimplePolygon::new(block).unwrap());
        let state = |s: f64| State { u: 1.6, s, omega: 0.1, v_t: 0.002 };
        let moment = |time: f64| Moment {
            time,
            finger: Point2::new(0.0, -0.01 + 0.05 * time),
            truth: state(0.01),
            estimate: state(0.02 - time * 0.02),
            pose: Pose { x: 0.0, y: 0.05 * time, theta: 0.1 * time },
            believed: Pose { x: 0.01, y: 0.05 * time, theta: 0.1 },
        };
        let moments = [0.0, 0.1, 0.2].map(moment);
        let mut picture = ObserverPicture {
            part: &part,
            edge: [-0.03, 0.03],
            radius: 0.01,
            moments: &moments,
            snapshots: &[0, 2],
            has_slip: true,
            one: 0.1,
        };
        let svg = |figure: Figure| figure.to_page().to_svg();
        let names = |svg: &str, words: &str| svg.contains(&format!("aria-label=\"{words}\""));
        let scenes = svg(picture.scenes("two".to_owned(), &["see".to_owned()]));
        for words in ["two", "see", "(a) what happens", "(b) what the observer believes", "0.2 s", "contact"] {
            assert!(names(&scenes, words), "{words}");
        }
        let states = svg(picture.states("four".to_owned(), &[]));
        for words in ["u [°]", "s [mm]", "ω [rad/s]", "vT [mm/s]", "truth", "estimate", "the edge ends"] {
            assert!(names(&states, words), "{words}");
        }
        picture.has_slip = false;
        assert!(!names(&svg(picture.states("three".to_owned(), &[])), "vT [mm/s]"));
    }
}
