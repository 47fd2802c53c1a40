//! The same push said otherwise: its answer must be the same.
//!
//! A push drawn at random ([`drawn_pushes`](super::drawn_pushes)) is turned, mirrored, scaled, renamed, its outline
//! split; the answers are compared by what they say of the part's points in the world. Nothing here knows which answer
//! is right.
//!
//! A hypothesis whose cost is within [`UNDECIDED`] of the most that is listed may be listed or not, and data whose fit
//! is as near to its limit may be explained or not: such differences are none.
//!
//! Units: SI. Errors: none; what differs is named.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix2, Point2, Rotation2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::{Finger, Mass, Part};
use palpate::pushing::estimation::{
    Channel, Estimate, GATE, Hypothesis, Known, Measured, Observation, Observer as _, SAME_END_M, Status,
};

use super::drawn_pushes::{Case, Problem, ROWS};
use super::{Cell, Experiment, Table, TableSettings, cases};

/// The table.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "invariances",
    title: "the same push said otherwise: turned, mirrored, scaled, renamed, its edges split; the answer must stay",
    cases: 70,
    run,
};

/// Costs so near to a limit are on either side of it, squared standard deviations: descents end that near to their
/// minimum, and steps follow a push that well.
const UNDECIDED: f64 = 0.3;

/// Lengths and times are made longer or shorter by this factor at most.
const SCALE_MAX: f64 = 1.5;

/// Relative change of data that is none.
const DATA_CHANGE: f64 = 1e-12;

impl Problem {
    fn estimate(&self) -> Estimate {
        let known = Known { part: &self.part, mu_g: self.mu_g, finger: self.finger, touch: self.touch };
        known.estimate(&self.observation)
    }

    /// The same with the outline of a part, and its mass, seen in other coordinates.
    fn with_part(&self, vertices: Vec<Point2<f64>>, frame: &Similarity, lengths: f64) -> Self {
        let polygon = SimplePolygon::new(vertices).unwrap_or_else(|error| panic!("a sound outline stays one: {error}"));
        let centre_of_mass = frame.of_point(self.part.centre_of_mass());
        let inertia_per_mass = self.part.inertia_per_mass() * lengths * lengths;
        Self { part: Part::with_mass(polygon, Mass { centre_of_mass, inertia_per_mass }), ..self.clone() }
    }

    /// The same with the finger's motion and the angles seen in other coordinates; `times` of a second is one.
    fn with_world(mut self, world: &Similarity, times: f64, angle: impl Fn(f64) -> f64) -> Self {
        let Finger { radius, centre0, velocity0, acceleration } = self.finger;
        let lengths = world.scale();
        self.finger = Finger {
            radius: radius * lengths,
            centre0: world.of_point(centre0),
            velocity0: world.of_vector(velocity0) / times,
            acceleration: world.of_vector(acceleration) / (times * times),
        };
        self.mu_g *= lengths / (times * times);
        let Observation { dt, measured, prior } = &mut self.observation;
        *dt *= times;
        prior.omega0_sigma = prior.omega0_sigma.map(|sigma| sigma / times);
        prior.v_t0_sigma = prior.v_t0_sigma.map(|sigma| sigma * lengths / times);
        let turned = |channel: &mut Channel| channel.values.iter_mut().for_each(|value| *value = angle(*value));
        match measured {
            Measured::ContactAngle(channel) => turned(channel),
            Measured::Force { direction, magnitude, u0_range, .. } => {
                direction.iter_mut().for_each(turned);
                let accelerations = (lengths / (times * times)).ln();
                let values = magnitude.iter_mut().flat_map(|channel| &mut channel.values);
                values.for_each(|value| *value += accelerations);
                *u0_range = u0_range.take().map(|range| {
                    let [a, b] = [angle(*range.start()), angle(*range.end())];
                    a.min(b)..=a.max(b)
                });
            }
        }
        self
    }
}

/// A change of coordinates: turned or mirrored, scaled, shifted.
#[derive(Clone, Copy, Debug)]
struct Similarity {
    matrix: Matrix2<f64>,
    shift: Vector2<f64>,
}

impl Similarity {
    const NONE: Self = Self { matrix: Matrix2::new(1.0, 0.0, 0.0, 1.0), shift: Vector2::new(0.0, 0.0) };

    fn scaled(factor: f64) -> Self {
        Self { matrix: Matrix2::identity() * factor, shift: Vector2::zeros() }
    }

    fn moved(draw: &mut Draw) -> (Self, f64) {
        let angle = draw.uniform(-PI, PI);
        let shift = Vector2::new(draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0));
        (Self { matrix: Rotation2::new(angle).into_inner(), shift }, angle)
    }

    fn of_point(&self, point: Point2<f64>) -> Point2<f64> {
        self.matrix * point + self.shift
    }

    fn of_vector(&self, vector: Vector2<f64>) -> Vector2<f64> {
        self.matrix * vector
    }

    fn scale(&self) -> f64 {
        self.matrix.determinant().abs().sqrt()
    }
}

/// A push said otherwise, and how its coordinates follow from those before.
struct Changed {
    problem: Problem,
    part: Similarity,
    world: Similarity,
}

/// A way to say a push otherwise.
struct Change {
    name: &'static str,
    of: fn(&Problem, &mut Draw) -> Changed,
}

const CHANGES: [Change; 9] = [
    Change { name: "world turned and shifted", of: world_moved },
    Change { name: "part's frame turned and shifted", of: part_moved },
    Change { name: "mirrored", of: mirrored },
    Change { name: "vertices listed from another", of: renamed },
    Change { name: "edges split", of: split },
    Change { name: "lengths scaled", of: lengths_scaled },
    Change { name: "times scaled", of: times_scaled },
    Change { name: "angles a whole turn on", of: turned_on },
    Change { name: "data changed by 1e-12", of: data_changed },
];

fn world_moved(problem: &Problem, draw: &mut Draw) -> Changed {
    let (world, by) = Similarity::moved(draw);
    let problem = problem.clone().with_world(&world, 1.0, |angle| angle + by);
    Changed { problem, part: Similarity::NONE, world }
}

fn part_moved(problem: &Problem, draw: &mut Draw) -> Changed {
    let (part, _) = Similarity::moved(draw);
    let vertices = problem.part.polygon().vertices().iter().map(|vertex| part.of_point(*vertex)).collect();
    Changed { problem: problem.with_part(vertices, &part, 1.0), part, world: Similarity::NONE }
}

fn mirrored(problem: &Problem, _: &mut Draw) -> Changed {
    let mirror = Similarity { matrix: Matrix2::new(-1.0, 0.0, 0.0, 1.0), shift: Vector2::zeros() };
    let vertices = problem.part.polygon().vertices().iter().rev().map(|vertex| mirror.of_point(*vertex)).collect();
    let problem = problem.with_part(vertices, &mirror, 1.0).with_world(&mirror, 1.0, |angle| PI - angle);
    Changed { problem, part: mirror, world: mirror }
}

fn renamed(problem: &Problem, draw: &mut Draw) -> Changed {
    let mut vertices = problem.part.polygon().vertices().to_vec();
    let by = 1 + draw.index(vertices.len() - 1);
    vertices.rotate_left(by);
    let problem = problem.with_part(vertices, &Similarity::NONE, 1.0);
    Changed { problem, part: Similarity::NONE, world: Similarity::NONE }
}

fn split(problem: &Problem, draw: &mut Draw) -> Changed {
    let mut vertices = Vec::new();
    for (from, to) in problem.part.polygon().edges() {
        vertices.push(from);
        if draw.chance(0.5) {
            vertices.push(from + (to - from) * draw.uniform(0.05, 0.95));
        }
    }
    let problem = problem.with_part(vertices, &Similarity::NONE, 1.0);
    Changed { problem, part: Similarity::NONE, world: Similarity::NONE }
}

fn lengths_scaled(problem: &Problem, draw: &mut Draw) -> Changed {
    let factor = SCALE_MAX.powf(draw.uniform(-1.0, 1.0));
    let scaled = Similarity::scaled(factor);
    let vertices = problem.part.polygon().vertices().iter().map(|vertex| scaled.of_point(*vertex)).collect();
    let problem = problem.with_part(vertices, &scaled, factor).with_world(&scaled, 1.0, |angle| angle);
    Changed { problem, part: scaled, world: scaled }
}

fn times_scaled(problem: &Problem, draw: &mut Draw) -> Changed {
    let problem = problem.clone().with_world(&Similarity::NONE, SCALE_MAX.powf(draw.uniform(-1.0, 1.0)), |angle| angle);
    Changed { problem, part: Similarity::NONE, world: Similarity::NONE }
}

fn turned_on(problem: &Problem, _: &mut Draw) -> Changed {
    let problem = problem.clone().with_world(&Similarity::NONE, 1.0, |angle| angle + TAU);
    Changed { problem, part: Similarity::NONE, world: Similarity::NONE }
}

fn data_changed(problem: &Problem, draw: &mut Draw) -> Changed {
    let by: Vec<_> = (0..8).map(|_| 1.0 + DATA_CHANGE * draw.normal()).collect();
    let next = std::cell::Cell::new(0);
    let problem = problem.clone().with_world(&Similarity::NONE, 1.0, |angle| {
        next.set(next.get() + 1);
        angle * by[next.get() % by.len()]
    });
    Changed { problem, part: Similarity::NONE, world: Similarity::NONE }
}

/// How two answers differ.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Difference {
    /// One explains the data, the other does not.
    Explained,
    /// A hypothesis of the one is not in the other.
    Hypotheses,
}

impl Changed {
    fn difference(&self, before: &Problem) -> Option<Difference> {
        let [answer, other] = [before.estimate(), self.problem.estimate()];
        if let [true, false] | [false, true] = [&answer, &other].map(|answer| answer.status() == Status::Unexplained) {
            let explained = if answer.status() == Status::Unexplained { &other } else { &answer };
            let is_near = explained.fit.cost.is_some_and(|cost| (cost - explained.fit.cost_max).abs() < UNDECIDED);
            return (!is_near).then_some(Difference::Explained);
        }
        let has = |a: &Estimate, b: &Estimate, is_one: &dyn Fn(&Hypothesis, &Hypothesis) -> bool| {
            let least = a.hypotheses.iter().map(|hypothesis| hypothesis.cost).fold(f64::INFINITY, f64::min);
            let sure = a.hypotheses.iter().filter(|hypothesis| hypothesis.cost < least + GATE - UNDECIDED);
            sure.into_iter().all(|hypothesis| b.hypotheses.iter().any(|other| is_one(hypothesis, other)))
        };
        let there = |a: &Hypothesis, b: &Hypothesis| self.is_one(before, a, b);
        let same = has(&answer, &other, &there) && has(&other, &answer, &|b, a| there(a, b));
        (!same).then_some(Difference::Hypotheses)
    }

    /// Whether two hypotheses put the part's points in the same places.
    fn is_one(&self, before: &Problem, a: &Hypothesis, b: &Hypothesis) -> bool {
        let [from, to] = [a, b].map(|hypothesis| hypothesis.pose_end.isometry());
        before.part.polygon().vertices().iter().all(|vertex| {
            let wanted = self.world.of_point(from * vertex);
            (to * self.part.of_point(*vertex) - wanted).norm() < NEAR * SAME_END_M * self.world.scale()
        })
    }
}

/// Poses of one hypothesis differ by no more than so many times what makes two of them one: the part's far end moves
/// by more than the contact.
const NEAR: f64 = 4.0;

fn run(settings: &TableSettings) -> Table {
    let mut table = Table::new(["the push said otherwise", "pushes", "explained or not", "other hypotheses"]);
    table.definitions = vec![
        "Pushes as in the table drawn-pushes, its rows in turn; each is estimated as it is and said otherwise."
            .to_owned(),
        format!(
            "explained or not: one of the two is, the other is not, and its cost is not within {UNDECIDED} of the limit."
        ),
        format!(
            "other hypotheses: one is missing that is listed by more than {UNDECIDED} of its cost, or its part is elsewhere by more than {:.0} mm.",
            NEAR * SAME_END_M * 1e3
        ),
    ];
    for (kind, change) in CHANGES.iter().enumerate() {
        let differences = cases::of_each(settings.cases, |number| {
            let mut draw = Draw::case(settings.seed.wrapping_add(kind as u64), number);
            let before = Case::draw(settings.seed, number, ROWS[number % ROWS.len()]).into_problem();
            (change.of)(&before, &mut draw).difference(&before)
        });
        let of = |wanted| differences.iter().filter(|difference| **difference == Some(wanted)).count();
        for (number, difference) in differences.iter().enumerate() {
            if let Some(difference) = difference {
                table.failures.push(format!("{}, case {number}: {difference:?}", change.name));
            }
        }
        table.push([
            change.name.into(),
            Cell::count(differences.len()),
            Cell::count(of(Difference::Explained)),
            Cell::count(of(Difference::Hypotheses)),
        ]);
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_push_said_otherwise_has_the_same_answer() {
        // One of each row of the pushes, each said in every way.
        let table = run(&TableSettings { cases: ROWS.len(), seed: 4, jobs: None });
        assert!(table.failures.is_empty(), "{:?}", table.failures);
        assert_eq!(table.rows().count(), CHANGES.len());
    }

    #[test]
    fn another_push_has_another_answer() {
        let mut draw = Draw::case(1, 0);
        let [one, other] = [0, 1].map(|number| Case::draw(1, number, ROWS[0]).into_problem());
        let mut changed = world_moved(&one, &mut draw);
        assert_eq!(changed.difference(&one), None);
        changed.problem = other.with_world(&changed.world, 1.0, |angle| angle);
        assert!(changed.difference(&one).is_some());
    }
}
