//! Which finger feels best (thesis §8.2.2, "good sensor shapes"): how well disks, ellipses and a flat finger can tell pose
//! and motion of what they push, by the information in what they feel.
//!
//! No estimator is judged: the covariance is the inverse of the information (Cramér and Rao), which no unbiased estimator
//! beats and those here come near. Derivatives are differences of simulated pushes.
//!
//! Units: SI inside; millimetres, degrees and rad/s in the table. Errors: none; a state that is not told counts as such.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix4, Point2, Vector2};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::dynamics::{
    Body, ContactLaw, EdgeEnd, FingerPath, FingerShape, Part, PartSide, ShapedModel, ShapedPush, Start, State,
};

use super::cases::of_each;
use super::figures::captioned;
use super::{Cell, Experiment, Table, TableSettings};
use crate::pictures::plot::{Chart, Colour, Dash, Figure, Stroke};

/// Fingers compared.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "finger-shapes",
    title: "which finger feels best: errors of pose and motion by shape, motion, part and mode",
    cases: 200,
    run,
};

/// Errors of one reading: of the contact's place on the finger (m), of the force's direction (rad), and of its size
/// (relative). Taxels of half a millimetre; the thesis's finger's half degree; the calibration's 2 %.
const PLACE_SD: f64 = 0.2e-3;
/// See [`PLACE_SD`].
const DIRECTION_SD: f64 = 0.5 * std::f64::consts::PI / 180.0;
/// See [`PLACE_SD`].
const SIZE_SD: f64 = 0.02;

/// A place that is known no better than this is not told, m: about the size of the parts.
const NOT_TOLD: f64 = 0.03;

/// Readings, and the time from one to the next, s.
const READINGS: u32 = 20;
/// See [`READINGS`].
const APART: f64 = 0.02;

/// Steps of the differences: of u (rad or, of a flat finger, m), s (m or rad), ω and v_T.
const STEPS: [f64; 4] = [1e-5, 1e-6, 1e-5, 1e-6];

const FINGERS: [(&str, FingerShape); 9] = [
    ("disk 2 mm", FingerShape::Disk { radius: 0.002 }),
    ("disk 5 mm", FingerShape::Disk { radius: 0.005 }),
    ("disk 10 mm", FingerShape::Disk { radius: 0.01 }),
    ("disk 15 mm", FingerShape::Disk { radius: 0.015 }),
    ("disk 25 mm", FingerShape::Disk { radius: 0.025 }),
    ("disk 50 mm", FingerShape::Disk { radius: 0.05 }),
    ("ellipse 30 x 10 mm", FingerShape::Ellipse { semi_axes: [0.03, 0.01] }),
    ("ellipse 10 x 30 mm", FingerShape::Ellipse { semi_axes: [0.01, 0.03] }),
    ("flat", FingerShape::Line),
];

/// What is pushed.
enum Object {
    Polygon(Part),
    Ellipse(Body, [f64; 2]),
}

/// How it is pushed.
#[derive(Clone, Copy)]
struct Way {
    rolling: bool,
    accelerated: bool,
}

const WAYS: [Way; 4] = [
    Way { rolling: false, accelerated: false },
    Way { rolling: false, accelerated: true },
    Way { rolling: true, accelerated: false },
    Way { rolling: true, accelerated: true },
];

/// Standard deviations of s (m; of an ellipse along its outline) and ω (rad/s), if told: by the contact's path, and by the
/// force.
type Errors = [Option<[f64; 2]>; 2];

struct Case {
    object: Object,
    shape: FingerShape,
    way: Way,
    state: State,
    mu_g: f64,
    aside: f64,
    edge: usize,
}

impl Case {
    /// The same part and motion for every finger, so that fingers are compared on the same pushes.
    fn drawn(seed: u64, number: usize, shape: FingerShape, ellipse: bool, way: Way) -> Option<Self> {
        let mut draw = Draw::case(seed, number);
        let mu_g = draw.uniform(0.15, 0.5) * GRAVITY_ASSUMED;
        let (tilt, turn, slip, along) =
            (draw.uniform(-0.4, 0.4), draw.uniform(-0.8, 0.8), draw.uniform(-0.01, 0.01), draw.uniform(-0.6, 0.6));
        let aside = draw.uniform(-0.02, 0.02);
        let (object, edge, s) = if ellipse {
            let semi_axes = [draw.uniform(0.025, 0.04), draw.uniform(0.015, 0.022)];
            (Object::Ellipse(Body::ellipse(semi_axes), semi_axes), 0, draw.uniform(0.0, std::f64::consts::TAU))
        } else {
            let part = Part::uniform(draw.convex_polygon(7, 0.035));
            let edge = draw.index(part.polygon().vertices().len());
            let side = part.edge(edge).ok()?;
            let s = 0.5 * (side.s_min + side.s_max) + along * 0.5 * (side.s_max - side.s_min);
            (Object::Polygon(part), edge, s)
        };
        let u = if matches!(shape, FingerShape::Line) { 0.01 * tilt } else { FRAC_PI_2 + tilt };
        Some(Self { object, shape, way, state: State { u, s, omega: turn, v_t: slip }, mu_g, aside, edge })
    }

    fn model(&self) -> Option<ShapedModel<'_>> {
        let acceleration = if self.way.accelerated { Vector2::new(4.0 * self.aside, 0.15) } else { Vector2::zeros() };
        let path = FingerPath { centre0: Point2::origin(), velocity0: Vector2::new(self.aside, 0.05), acceleration };
        let (body, side) = match &self.object {
            Object::Polygon(part) => (part.body(), PartSide::Edge(part.edge(self.edge).ok()?)),
            Object::Ellipse(body, semi_axes) => {
                (body, PartSide::Ellipse { semi_axes: *semi_axes, middle: Vector2::zeros() })
            }
        };
        ShapedModel::new(body, side, self.mu_g, self.shape, path).ok()
    }

    /// What is felt from a state on: place on the finger, direction and log of the size of the force, in their standard
    /// deviations.
    fn felt(&self, state: State) -> Option<Vec<[f64; 4]>> {
        let law = if self.way.rolling { ContactLaw::Rolling { friction: None } } else { ContactLaw::Frictionless };
        let push = ShapedPush::new(self.model()?, law, Start::Moving(state), EdgeEnd::Extend).ok()?;
        let times: Vec<f64> = (0..READINGS).map(|k| APART * f64::from(k)).collect();
        let run = push.run(&times).ok()?;
        let of = |sample: &palpate::pushing::dynamics::Sample| {
            let place = self.shape.point(sample.state.u) / PLACE_SD;
            let force = sample.force?;
            let normal = if matches!(self.shape, FingerShape::Line) {
                FRAC_PI_2
            } else {
                self.shape.normal_angle(sample.state.u)
            };
            let direction = normal + force.tangential.atan2(force.normal);
            Some([place.x, place.y, direction / DIRECTION_SD, force.normal.hypot(force.tangential).ln() / SIZE_SD])
        };
        let felt: Option<Vec<_>> = run.samples.iter().map(of).collect();
        felt.filter(|felt| felt.len() >= READINGS as usize / 2)
    }

    /// Errors from what is felt while the contact lasts; none where it does not for half of the readings.
    fn errors(&self) -> Option<Errors> {
        let unknowns = if self.way.rolling { 3 } else { 4 };
        self.felt(self.state)?;
        let differences: Vec<Vec<[f64; 4]>> = (0..unknowns)
            .map(|k| {
                let moved = |sign: f64| {
                    let mut state = self.state;
                    *[&mut state.u, &mut state.s, &mut state.omega, &mut state.v_t][k] += sign * STEPS[k];
                    self.felt(state)
                };
                let (up, down) = (moved(1.0)?, moved(-1.0)?);
                Some(
                    up.iter()
                        .zip(&down)
                        .map(|(a, b)| std::array::from_fn(|i| (a[i] - b[i]) / (2.0 * STEPS[k])))
                        .collect(),
                )
            })
            .collect::<Option<_>>()?;
        // In units of the deviations that count: degrees, mm, 0.1 rad/s, mm/s, so that the matrix is well scaled.
        let units = [0.02, 1e-3, 0.1, 1e-3];
        let information = |outputs: std::ops::Range<usize>| {
            let mut matrix = Matrix4::identity();
            for i in 0..unknowns {
                for j in 0..unknowns {
                    let count = differences[i].len().min(differences[j].len());
                    let sum: f64 = (0..count)
                        .flat_map(|t| outputs.clone().map(move |o| (t, o)))
                        .map(|(t, o)| differences[i][t][o] * differences[j][t][o])
                        .sum();
                    matrix[(i, j)] = sum * units[i] * units[j];
                }
            }
            matrix
        };
        let error = |outputs| {
            let covariance = information(outputs).try_inverse()?;
            let place = covariance[(1, 1)].max(0.0).sqrt() * units[1] * self.pace();
            let turn = covariance[(2, 2)].max(0.0).sqrt() * units[2];
            (place < NOT_TOLD && turn.is_finite()).then_some([place, turn])
        };
        Some([error(0..2), error(2..4)])
    }

    /// Metres of the part's outline by s.
    fn pace(&self) -> f64 {
        match self.object {
            Object::Polygon(_) => 1.0,
            Object::Ellipse(_, [a, b]) => (a * self.state.s.sin()).hypot(b * self.state.s.cos()),
        }
    }
}

/// Median errors of so many pushes: of those told, and the share of those.
struct Summary {
    place: f64,
    turn: f64,
    told: usize,
    pushes: usize,
}

/// By the path and by the force; none where the finger cannot push the part.
fn summaries(settings: &TableSettings, shape: FingerShape, ellipse: bool, way: Way) -> Option<[Summary; 2]> {
    let errors: Vec<Errors> =
        of_each(settings.cases, |case| Case::drawn(settings.seed, case, shape, ellipse, way)?.errors())
            .into_iter()
            .flatten()
            .collect();
    (!errors.is_empty()).then(|| {
        [0, 1].map(|sense| {
            let told: Vec<[f64; 2]> = errors.iter().filter_map(|errors| errors[sense]).collect();
            let median = |which: usize| percentile(told.iter().map(|told| told[which]), 50).unwrap_or(f64::NAN);
            Summary { place: median(0), turn: median(1), told: told.len(), pushes: errors.len() }
        })
    })
}

fn run(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "finger, part, contact, motion",
        "pushes",
        "path: place mm",
        "ω rad/s",
        "told",
        "force: place mm",
        "force: ω rad/s",
        "force: told",
    ]);
    table.definitions = [
        format!("Drawn: convex polygons of 7 cm and ellipses, µ 0.15 to 0.5 on the table, pushed at 5 cm/s, steadily or accelerating by 0.15 m/s², with or without rolling at the finger; each finger gets the same pushes. Felt: {READINGS} readings, {:.0} ms apart.", 1e3 * APART),
        format!("Least standard deviations that are possible (the inverse of the information), medians of those told: where on the part the contact is, and how fast the part turns. path: the contact's place on the finger is felt to {:.1} mm; force: its direction to 0.5° and its size to {:.0} %. told: the place to 3 cm or better.", 1e3 * PLACE_SD, 1e2 * SIZE_SD),
    ]
    .to_vec();
    for ellipse in [false, true] {
        for way in WAYS {
            let how = format!(
                "{}, {}, {}",
                if ellipse { "ellipse" } else { "polygon" },
                if way.rolling { "rolls" } else { "slides" },
                if way.accelerated { "accelerated" } else { "steady" }
            );
            for (name, shape) in FINGERS {
                let Some([path, force]) = summaries(settings, shape, ellipse, way) else { continue };
                let number = |value: f64, decimals: usize| {
                    if value.is_nan() { Cell::Empty } else { Cell::number(value, decimals) }
                };
                table.push([
                    format!("{name}; {how}").into(),
                    Cell::count(path.pushes),
                    number(1e3 * path.place, 2),
                    number(path.turn, 3),
                    Cell::share(path.told, path.pushes),
                    number(1e3 * force.place, 2),
                    number(force.turn, 3),
                    Cell::share(force.told, force.pushes),
                ]);
            }
        }
    }
    table
}

/// Error of the place by the disk's radius.
pub(super) fn figures(settings: &TableSettings) -> Vec<(String, Figure)> {
    let caption = "Least possible error (median) of the place on a polygon that slides without friction, pushed steadily (lines) or with acceleration (dashes), by the disk's radius: felt by the contact's path on the finger, or by the force's direction and size.";
    let mut chart = Chart::new("", ["radius of the disk [mm]", "error of the place [mm]"]);
    let radii = [0.002, 0.003, 0.005, 0.0075, 0.01, 0.015, 0.02, 0.025, 0.035, 0.05];
    for (way, dash) in [(WAYS[0], Dash::Solid), (WAYS[1], Dash::Dashed)] {
        let found: Vec<_> = radii
            .iter()
            .filter_map(|&radius| Some((radius, summaries(settings, FingerShape::Disk { radius }, false, way)?)))
            .collect();
        for (sense, name, colour) in [(0, "by the path", Colour::BLUE), (1, "by the force", Colour::VERMILLION)] {
            let curve: Vec<_> = found
                .iter()
                .map(|(radius, summary)| [1e3 * radius, 1e3 * summary[sense].place])
                .filter(|point| point[1].is_finite())
                .collect();
            chart.curve(if dash == Dash::Solid { name } else { "" }, &curve, Stroke::solid(colour, 1.8).with(dash));
        }
    }
    let figure = captioned("Which finger feels best", [760.0, 440.0], caption);
    vec![("finger-shapes".to_owned(), figure.column(1.0, vec![chart.into()]))]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A finger that feels its contact's place to a fixed length tells more the more a part moves on it; one that feels
    /// the force's direction tells nothing with a flat finger without friction.
    #[test]
    fn a_flat_finger_without_friction_tells_nothing_by_the_forces_direction_alone() {
        let way = WAYS[1];
        let case = (0..50)
            .find_map(|number| {
                Case::drawn(1, number, FingerShape::Line, true, way).filter(|case| case.felt(case.state).is_some())
            })
            .unwrap();
        let felt = case.felt(case.state).unwrap();
        assert!(felt.iter().all(|reading| (reading[2] - felt[0][2]).abs() < 1e-9), "{felt:?}");
        assert!(felt.iter().any(|reading| (reading[0] - felt[0][0]).abs() > 1.0), "its contact moves");
    }

    #[test]
    fn finer_readings_would_tell_more_in_proportion() {
        let settings = TableSettings { cases: 20, seed: 1, jobs: None };
        let [path, force] = summaries(&settings, FingerShape::Disk { radius: 0.01 }, false, WAYS[1]).unwrap();
        assert!(path.pushes >= 5 && path.told > 0 && force.told > 0);
        assert!(path.place > 1e-6 && path.place < NOT_TOLD && force.place < NOT_TOLD);
    }
}
