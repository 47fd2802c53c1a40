//! Pose of a pushed part where the model is wrong, or some values are.
//!
//! The truth is as in [`super`]; what the estimator is told of it differs.
//!
//! Units: SI inside, as the headings say in the table. Errors: none.

use nalgebra::Vector2;
use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::{Channel, Estimate, Known, Measured, Observation, estimate};

use super::world::{Case, Kind, Sense, Setting};
use super::{NOISY, PUSHES, SIGMA_RAD};
use crate::thesis::{Cell, Experiment, Table, TableSettings, cases};

/// What `palpate tables model-error-angles` runs.
pub(in crate::thesis) const EXPERIMENT: Experiment = Experiment {
    name: "model-error-angles",
    title: "pose of a pushed part where friction, outline or some of the angles are wrong",
    cases: 200,
    run,
};

/// How far off a vertex is, m.
const VERTEX_M: f64 = 5e-4;

/// One value in so many is wrong.
const WRONG_SHARE: f64 = 0.05;

/// Wrong values are off by so much, rad.
const WRONG_RAD: (f64, f64) = (0.05, 1.0);

/// What the estimator is told wrongly.
#[derive(Clone, Copy, Debug)]
enum Wrong {
    Nothing,
    /// µ, by a factor.
    Friction(f64),
    /// Every vertex, in a random direction.
    Outline,
    /// Some of the values.
    Values,
}

const ROWS: &[(&str, Wrong)] = &[
    ("nothing", Wrong::Nothing),
    ("mu 10 % too high", Wrong::Friction(1.1)),
    ("mu 10 % too low", Wrong::Friction(0.9)),
    ("mu 20 % too high", Wrong::Friction(1.2)),
    ("mu 20 % too low", Wrong::Friction(0.8)),
    ("each vertex by 0.5 mm", Wrong::Outline),
    ("5 % of the angles", Wrong::Values),
];

/// What came of one case.
#[derive(Clone, Copy, Debug)]
struct Outcome {
    in_set: bool,
    first: bool,
    none: bool,
}

fn run(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "contact",
        "wrong",
        "cases",
        "truth in set",
        "first right",
        "nothing explains",
        "else: truth lost",
    ]);
    table.definitions = vec![
        PUSHES.to_owned(),
        format!("noise {:.3} deg a value; prior of the start as in `pose`.", SIGMA_RAD.to_degrees()),
        "right: the edge, and the end within 2 mm and 20 mrad.".to_owned(),
        format!("wrong angles: 5 % of them, by {} to {} rad to either side.", WRONG_RAD.0, WRONG_RAD.1),
        "nothing explains: the estimator says that the model is wrong. truth lost: it lists poses, and the true one is not among them.".to_owned(),
    ];
    for (contact, kind) in [("rolling", Kind::Rolling), ("frictionless", Kind::Frictionless)] {
        let setting = Setting { kind, sense: Sense::Angle, sigma: SIGMA_RAD };
        for &(name, wrong) in ROWS {
            let outcomes = cases::of_each(settings.cases, |number| outcome(settings.seed, number, setting, wrong));
            let share =
                |is: fn(&Outcome) -> bool| Cell::share(outcomes.iter().filter(|o| is(o)).count(), outcomes.len());
            table.push([
                contact.into(),
                name.into(),
                Cell::count(outcomes.len()),
                share(|outcome| outcome.in_set),
                share(|outcome| outcome.first),
                share(|outcome| outcome.none),
                share(|outcome| !outcome.none && !outcome.in_set),
            ]);
        }
    }
    table
}

fn outcome(seed: u64, number: usize, setting: Setting, wrong: Wrong) -> Outcome {
    let case = Case::draw(seed, number, setting);
    // Of another seed than the case, which has used up some of its own.
    let found = told(&case, wrong, &mut Draw::case(!seed, number));
    let right = |hypothesis: &_| case.is_truth(hypothesis, NOISY);
    Outcome {
        in_set: found.hypotheses.iter().any(right),
        first: found.hypotheses.first().is_some_and(right),
        none: found.hypotheses.is_empty(),
    }
}

/// The estimate of one who was told something wrong.
fn told(case: &Case, wrong: Wrong, draw: &mut Draw) -> Estimate {
    let (known, observation) = (case.known(), case.observation());
    match wrong {
        Wrong::Nothing => estimate(&known, &observation),
        Wrong::Friction(factor) => estimate(&Known { mu_g: known.mu_g * factor, ..known }, &observation),
        Wrong::Outline => {
            let part = moved(&case.part, draw);
            estimate(&Known { part: part.as_ref().unwrap_or(known.part), ..known }, &observation)
        }
        Wrong::Values => estimate(&known, &spoilt(&observation, draw).0),
    }
}

/// The part with its vertices moved; none where its edges cross then.
fn moved(part: &Part, draw: &mut Draw) -> Option<Part> {
    let vertices = part.polygon().vertices().iter().map(|vertex| {
        let angle = draw.uniform(0.0, std::f64::consts::TAU);
        vertex + Vector2::new(angle.cos(), angle.sin()) * VERTEX_M
    });
    SimplePolygon::new(vertices.collect::<Vec<_>>()).ok().map(Part::uniform)
}

/// The same angles with some of them wrong, and which.
pub(super) fn spoilt(observation: &Observation, draw: &mut Draw) -> (Observation, Vec<usize>) {
    let Measured::ContactAngle(Channel { values, sigma }) = &observation.measured else {
        return (observation.clone(), Vec::new());
    };
    let (mut values, mut wrong) = (values.clone(), Vec::new());
    for (i, value) in values.iter_mut().enumerate() {
        if draw.chance(WRONG_SHARE) {
            let off = draw.uniform(WRONG_RAD.0, WRONG_RAD.1);
            *value += if draw.chance(0.5) { off } else { -off };
            wrong.push(i);
        }
    }
    let measured = Measured::ContactAngle(Channel { values, sigma: *sigma });
    (Observation { measured, ..observation.clone() }, wrong)
}
