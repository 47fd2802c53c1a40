//! Pose of a pushed part from contact angles or forces, edge unknown: how often it is named, and how often it could be.
//!
//! Here are the tables `pose`, `pose-friction` and `force`; `world` draws the pushes, `magnitude` and `model_error` are
//! two more tables of them.
//!
//! Truth comes from the error-controlled simulation, not from the estimator's own steps. Whether a case is inherently
//! ambiguous is decided by [`super::rivals`], a search of its own on the noise-free angles. Every member of the
//! returned set is simulated again from its start and must reproduce the data.
//!
//! Units: SI inside, as the headings say in the table. Errors: none.

mod magnitude;
mod model_error;
mod world;

use palpate::math::statistics::mean;
use palpate::pushing::estimation::{Hypothesis, estimate};

use self::world::{Case, Kind, Sense, Setting, Tolerance};
use super::{Cell, Experiment, Table, TableSettings, cases};

/// What `palpate tables pose` runs.
pub(super) const CONTACTS: Experiment = Experiment {
    name: "pose",
    title: "pose of a pushed part from contact angles, edge unknown: how often it is named",
    cases: 200,
    run: pose,
};

/// What `palpate tables pose-friction` runs.
pub(super) const FRICTION: Experiment = Experiment {
    name: "pose-friction",
    title: "the same where the contact slides, or rolls and slides",
    cases: 100,
    run: pose_friction,
};

/// What `palpate tables force` runs.
pub(super) const FORCES: Experiment = Experiment {
    name: "force",
    title: "pose of a pushed part from the direction of the force alone",
    cases: 100,
    run: force,
};

pub(super) use self::magnitude::EXPERIMENT as MAGNITUDE;
pub(super) use self::model_error::EXPERIMENT as MODEL_ERROR;

/// rad: 0.5° each 0.5 ms, averaged over 10 ms.
const SIGMA_RAD: f64 = 0.112 / 180.0 * std::f64::consts::PI;

/// Costs above the truth's from which on a rival is told from it (a wrong choice by noise: 0.13 %).
const CLEAR: f64 = 36.0;

/// How near to the truth an estimate from exact data is: 0.2 mm, 1 mrad.
const EXACT: Tolerance = Tolerance { place: 2e-4, turn: 1e-3 };

/// The same from noisy data, on the same edge: 2 mm; a turn follows from the measured angle.
const NOISY: Tolerance = Tolerance { place: 2e-3, turn: 2e-2 };

/// How near to the truth an estimate from forces is: so many metres, or of its own standard deviations.
const FORCE_PLACE_M: f64 = 1e-3;
/// In standard deviations; see [`FORCE_PLACE_M`].
const FORCE_DEVIATIONS: f64 = 4.0;

/// What is pushed: text below the tables.
const PUSHES: &str = "60 % hulls of 3 to 9 random points, 40 % star-shaped polygons, all within 5 cm; mu 0.3, mu_c 0.2, disk of 1 cm at 5 cm/s, every other one accelerating by 2.5 cm/s2; 0.8 s at 100 Hz (sliding: 0.3 s, the finger also goes 8 to 20 cm/s across); drawn until the disk fits and the contact lasts.";

/// What a member's cost may differ by when it is simulated again with other steps.
const REPRODUCED: f64 = 1.0;

/// Rows of a table.
type Rows<'a> = &'a [(&'static str, Setting)];

const fn measured(kind: Kind, sense: Sense, sigma: f64) -> Setting {
    Setting { kind, sense, sigma }
}

const POSE: Rows = &[
    ("rolling, exact", measured(Kind::Rolling, Sense::Angle, 0.0)),
    ("rolling, noisy", measured(Kind::Rolling, Sense::Angle, SIGMA_RAD)),
    ("frictionless, exact", measured(Kind::Frictionless, Sense::Angle, 0.0)),
    ("frictionless, noisy", measured(Kind::Frictionless, Sense::Angle, SIGMA_RAD)),
];

const POSE_FRICTION: Rows = &[
    ("sliding, exact", measured(Kind::Sliding, Sense::Angle, 0.0)),
    ("sliding, noisy", measured(Kind::Sliding, Sense::Angle, SIGMA_RAD)),
    ("coulomb, exact", measured(Kind::Coulomb, Sense::Angle, 0.0)),
    ("coulomb, noisy", measured(Kind::Coulomb, Sense::Angle, SIGMA_RAD)),
];

const FORCE: Rows = &[
    ("rolling, direction", measured(Kind::Rolling, Sense::Direction, SIGMA_RAD)),
    ("rolling, direction and magnitude", measured(Kind::Rolling, Sense::Force, SIGMA_RAD)),
    ("sliding, direction", measured(Kind::Sliding, Sense::Direction, SIGMA_RAD)),
];

/// What came of one case.
#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    ambiguous: bool,
    first: bool,
    in_set: bool,
    members: usize,
    false_members: usize,
    squared_error: Option<f64>,
    sign: bool,
}

/// Contacts without friction or without slip: the thesis's.
fn pose(settings: &TableSettings) -> Table {
    of_angles(settings, POSE)
}

/// Contacts that slide, and that roll or slide.
fn pose_friction(settings: &TableSettings) -> Table {
    of_angles(settings, POSE_FRICTION)
}

fn of_angles(settings: &TableSettings, rows: Rows) -> Table {
    let mut table = Table::new([
        "contact",
        "cases",
        "ambiguous",
        "first right",
        "of clear ones",
        "truth in set",
        "mean set",
        "false members",
        "mean error²",
    ]);
    table.definitions = vec![
        PUSHES.to_owned(),
        format!("noise {:.3} deg a value; exact: none. Prior of the start: omega N(0, 1 rad/s), vT N(0, 4 mm/s).", SIGMA_RAD.to_degrees()),
        "ambiguous: another edge, or an end more than 2 mm away, explains the exact angles with D2 < 36 at the noise (of exact data: at 1e-6 rad).".to_owned(),
        "right: the edge, and the end within 0.2 mm and 1 mrad (exact) or 2 mm and 20 mrad (noisy).".to_owned(),
        "false member: simulated again with error control, it does not have the cost it claims.".to_owned(),
        "mean error²: of the first pose, where it is right, by its own covariance: 3 if that is right.".to_owned(),
    ];
    for &(name, setting) in rows {
        let outcomes = outcomes(settings, setting, angles_case);
        table.failures.extend(failures(name, &outcomes, setting.sigma));
        table.push(row(name, &outcomes));
    }
    table
}

/// Force instead of angle.
fn force(settings: &TableSettings) -> Table {
    let mut table = Table::new(["felt", "cases", "first right", "truth in set", "sign right", "mean set"]);
    table.definitions = vec![
        PUSHES.to_owned(),
        format!(
            "noise {:.3} deg a direction, 1 % a magnitude; the contact angle is known to be within 10 deg of straight ahead.",
            SIGMA_RAD.to_degrees()
        ),
        "right: the edge, and the end within 1 mm or 4 of its standard deviations.".to_owned(),
        "sign right: the first pose slides the way the part did.".to_owned(),
    ];
    for &(name, setting) in FORCE {
        let outcomes = outcomes(settings, setting, force_case);
        for (case, outcome) in outcomes.iter().enumerate() {
            if !outcome.in_set || !outcome.sign {
                let what = if outcome.in_set { "slides the other way" } else { "truth not in the set" };
                table.failures.push(format!("{name}, case {case}: {what}"));
            }
        }
        let share = |is: fn(&Outcome) -> bool| Cell::share(outcomes.iter().filter(|o| is(o)).count(), outcomes.len());
        table.push([
            name.into(),
            Cell::count(outcomes.len()),
            share(|outcome| outcome.first),
            share(|outcome| outcome.in_set),
            if setting.kind == Kind::Sliding { share(|outcome| outcome.sign) } else { Cell::Empty },
            Cell::number(mean_count(outcomes.iter().map(|outcome| outcome.members)), 2),
        ]);
    }
    table
}

/// The outcome of each case, on all processors.
fn outcomes(settings: &TableSettings, setting: Setting, judge: fn(&Case) -> Outcome) -> Vec<Outcome> {
    cases::of_each(settings.cases, |number| judge(&Case::draw(settings.seed, number, setting)))
}

fn angles_case(case: &Case) -> Outcome {
    let estimate = estimate(&case.known(), &case.observation());
    let tolerance = if case.sigma > 0.0 { NOISY } else { EXACT };
    let right = |hypothesis: &Hypothesis| case.is_truth(hypothesis, tolerance);
    let first = estimate.hypotheses.first().filter(|first| right(first));
    Outcome {
        ambiguous: case.truth().has_rival(CLEAR),
        first: first.is_some(),
        in_set: estimate.hypotheses.iter().any(right),
        members: estimate.hypotheses.len(),
        false_members: estimate.hypotheses.iter().filter(|member| !case.reproduces(member, REPRODUCED)).count(),
        squared_error: first.and_then(|first| case.squared_error(first)),
        sign: true,
    }
}

fn force_case(case: &Case) -> Outcome {
    let estimate = estimate(&case.known(), &case.observation());
    let right = |hypothesis: &Hypothesis| {
        let deviation = hypothesis.state_covariance.map_or(0.0, |covariance| covariance.m22.sqrt());
        let off = (hypothesis.end.s - case.end().state.s).abs();
        hypothesis.edge == case.edge && off < FORCE_PLACE_M.max(FORCE_DEVIATIONS * deviation)
    };
    let first = estimate.hypotheses.first();
    Outcome {
        first: first.is_some_and(right),
        in_set: estimate.hypotheses.iter().any(right),
        members: estimate.hypotheses.len(),
        sign: first.is_some_and(|first| first.contact_end == case.end().contact),
        ..Outcome::default()
    }
}

/// Mean of the counts; 0 of none.
fn mean_count(counts: impl Iterator<Item = usize>) -> f64 {
    mean(counts.map(|count| count as f64)).unwrap_or(0.0)
}

fn row(name: &str, outcomes: &[Outcome]) -> Vec<Cell> {
    let count = |is: fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| is(outcome)).count();
    let all = outcomes.len();
    let error = mean(outcomes.iter().filter_map(|outcome| outcome.squared_error)).unwrap_or(0.0);
    vec![
        name.into(),
        Cell::count(all),
        Cell::share(count(|outcome| outcome.ambiguous), all),
        Cell::share(count(|outcome| outcome.first), all),
        Cell::share(count(|outcome| outcome.first && !outcome.ambiguous), count(|outcome| !outcome.ambiguous)),
        Cell::share(count(|outcome| outcome.in_set), all),
        Cell::number(mean_count(outcomes.iter().map(|outcome| outcome.members)), 2),
        Cell::count(outcomes.iter().map(|outcome| outcome.false_members).sum()),
        Cell::number(error, 2),
    ]
}

fn failures(name: &str, outcomes: &[Outcome], sigma: f64) -> Vec<String> {
    let mut told = Vec::new();
    for (case, outcome) in outcomes.iter().enumerate() {
        let what = match outcome {
            Outcome { in_set: false, .. } => "truth not in the set",
            Outcome { first: false, ambiguous: false, .. } => "another pose first",
            Outcome { first: false, .. } if sigma == 0.0 => "another pose first, of exact data",
            Outcome { false_members: 1.., .. } => "a member that does not reproduce the data",
            _ => continue,
        };
        told.push(format!("{name}, case {case}: {what}"));
    }
    told
}

#[cfg(test)]
mod tests {
    use palpate::math::random::Draw;

    use super::*;

    /// A short run of each table; the full ones are `palpate tables pose pose-friction force --cases 1000`.
    const SHORT: TableSettings = TableSettings { cases: 6, seed: 1, jobs: None };

    #[test]
    fn random_poses_are_named() {
        let table = pose(&SHORT);
        assert!(table.failures.is_empty(), "{table}");
    }

    #[test]
    fn random_poses_of_parts_that_slide_are_named() {
        let table = pose_friction(&SHORT);
        assert!(table.failures.is_empty(), "{table}");
    }

    #[test]
    fn random_poses_are_named_from_forces() {
        let table = force(&SHORT);
        assert!(table.failures.is_empty(), "{table}");
    }

    /// Starts that are far from what the prior expects, and edges on which two places nearly explain the same: each of
    /// these was once lost, because a minimum of coarse data is two of fine ones.
    #[test]
    fn starts_beside_the_valley_are_found() {
        let angle = |kind, sigma| measured(kind, Sense::Angle, sigma);
        let lost = [
            (angle(Kind::Frictionless, 0.0), [218, 496], EXACT),
            (angle(Kind::Frictionless, SIGMA_RAD), [40, 95], NOISY),
            (angle(Kind::Sliding, 0.0), [71, 72], EXACT),
            (angle(Kind::Coulomb, 0.0), [63, 274], EXACT),
            (angle(Kind::Coulomb, SIGMA_RAD), [52, 172], NOISY),
            (measured(Kind::Rolling, Sense::Direction, SIGMA_RAD), [1, 20], NOISY),
            (measured(Kind::Sliding, Sense::Direction, SIGMA_RAD), [44, 65], NOISY),
        ];
        for (setting, numbers, tolerance) in lost {
            for number in numbers {
                let case = Case::draw(2, number, setting);
                let found = estimate(&case.known(), &case.observation());
                let truth = found.hypotheses.iter().any(|found| case.is_truth(found, tolerance));
                assert!(truth && found.outliers.is_empty(), "{setting:?}, case {number}: {found:?}");
            }
        }
    }

    #[test]
    fn wrong_values_are_named_and_do_not_lose_the_truth() {
        let setting = measured(Kind::Rolling, Sense::Angle, SIGMA_RAD);
        for number in 0..6 {
            let case = Case::draw(1, number, setting);
            let (observation, wrong) = model_error::spoilt(&case.observation(), &mut Draw::case(7, number));
            let found = estimate(&case.known(), &observation);
            assert!(found.hypotheses.iter().any(|found| case.is_truth(found, NOISY)), "case {number}: {:?}", found.fit);
            assert!(
                wrong.iter().all(|value| found.outliers.contains(value)),
                "case {number}: {wrong:?}, {:?}",
                found.outliers
            );
        }
    }
}
