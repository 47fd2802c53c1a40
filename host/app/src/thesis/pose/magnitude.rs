//! Pose of a part that a point pushes which feels how hard, and neither where it touches nor which way.
//!
//! The thesis expects that this suffices, without having tried it (ch. 8): a point finger leaves two freedoms of the
//! resting pose open, so that "at least four intermediate contacts" should single out the motion. Here the part moves
//! from the start, edge and contact angle are not known, and 81 magnitudes are felt with noise.
//!
//! Units: SI inside, as the headings say in the table. Errors: none.

use palpate::math::statistics::percentile;
use palpate::pushing::estimation::{Hypothesis, estimate};

use super::world::{Case, Kind, Sense, Setting};
use super::{FORCE_DEVIATIONS, FORCE_PLACE_M, PUSHES, mean_count};
use crate::thesis::{Cell, Experiment, Table, TableSettings, cases};

/// What `palpate tables magnitude` runs.
pub(in crate::thesis) const EXPERIMENT: Experiment = Experiment {
    name: "magnitude",
    title: "pose of a pushed part from how hard a point finger pushes, and nothing else",
    cases: 10,
    run,
};

const ROWS: &[(&str, Kind, Sense)] = &[
    ("frictionless, mass known", Kind::Frictionless, Sense::Magnitude),
    ("frictionless, mass unknown", Kind::Frictionless, Sense::Course),
    ("rolling, mass known", Kind::Rolling, Sense::Magnitude),
    ("rolling, mass unknown", Kind::Rolling, Sense::Course),
];

/// How near to the truth a contact angle is: so many rad, or of its own standard deviations.
const TURN_RAD: f64 = 0.02;

/// What came of one case.
#[derive(Clone, Copy, Debug)]
struct Outcome {
    members: usize,
    first: bool,
    /// Errors of the member that is the truth: m, rad.
    errors: Option<(f64, f64)>,
}

fn run(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "contact",
        "cases",
        "truth in set",
        "first right",
        "unique",
        "mean set",
        "median error [mm]",
        "median error [deg]",
    ]);
    table.definitions = vec![
        PUSHES.to_owned(),
        "But: the finger is a point (a disk of 1 mm), the contact angle is within 45 deg of straight ahead and not known better; felt is the magnitude of the force with 1 % of noise a value, over the mass or, mass unknown, but for a factor.".to_owned(),
        "right: the edge, and the end within 1 mm and 20 mrad or 4 of its standard deviations. Errors: of the member of the set that is right.".to_owned(),
        "thesis (ch. 8): with a point finger that feels the magnitude of force, \"the above principle of sensing is expected to still work\", \"we generally need at least four intermediate contacts\"; not tried there.".to_owned(),
    ];
    for &(name, kind, sense) in ROWS {
        let setting = Setting { kind, sense, sigma: 0.0 };
        let outcomes = cases::of_each(settings.cases, |number| outcome(&Case::draw(settings.seed, number, setting)));
        let lost = outcomes.iter().enumerate().filter(|(_, outcome)| outcome.errors.is_none());
        table.failures.extend(lost.map(|(case, _)| format!("{name}, case {case}: truth not in the set")));
        table.push(row(name, &outcomes));
    }
    table
}

fn outcome(case: &Case) -> Outcome {
    let estimate = estimate(&case.known(), &case.observation());
    let errors = |found: &Hypothesis| {
        let deviations = found.state_covariance.map_or((0.0, 0.0), |c| (c.m22.sqrt(), c.m11.sqrt()));
        let truth = case.end().state;
        let (place, turn) = ((found.end.s - truth.s).abs(), (found.end.u - truth.u).abs());
        let is_right = found.edge == case.edge
            && place < FORCE_PLACE_M.max(FORCE_DEVIATIONS * deviations.0)
            && turn < TURN_RAD.max(FORCE_DEVIATIONS * deviations.1);
        is_right.then_some((place, turn))
    };
    Outcome {
        members: estimate.hypotheses.len(),
        first: estimate.hypotheses.first().is_some_and(|first| errors(first).is_some()),
        errors: estimate.hypotheses.iter().find_map(errors),
    }
}

fn row(name: &str, outcomes: &[Outcome]) -> Vec<Cell> {
    let share = |is: fn(&Outcome) -> bool| Cell::share(outcomes.iter().filter(|o| is(o)).count(), outcomes.len());
    let median = |of: fn((f64, f64)) -> f64, decimals: usize| {
        let errors = outcomes.iter().filter_map(|outcome| outcome.errors.map(of));
        percentile(errors, 50).map_or(Cell::Empty, |error| Cell::number(error, decimals))
    };
    vec![
        name.into(),
        Cell::count(outcomes.len()),
        share(|outcome| outcome.errors.is_some()),
        share(|outcome| outcome.first),
        share(|outcome| outcome.members == 1),
        Cell::number(mean_count(outcomes.iter().map(|outcome| outcome.members)), 2),
        median(|(place, _)| place * 1e3, 2),
        median(|(_, turn)| turn.to_degrees(), 2),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A short run; the full one is `palpate tables magnitude`.
    #[test]
    fn the_truth_is_among_what_magnitudes_leave_possible() {
        let setting = Setting { kind: Kind::Frictionless, sense: Sense::Magnitude, sigma: 0.0 };
        for number in 0..2 {
            let outcome = outcome(&Case::draw(1, number, setting));
            assert!(outcome.errors.is_some(), "case {number}: {outcome:?}");
        }
    }
}
