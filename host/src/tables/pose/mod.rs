//! Pose of a pushed part from contact angles, edge unknown: how often it is named, and how often it could be.
//!
//! Truth comes from the error-controlled simulation, not from the estimator's own steps. Whether a case is inherently ambiguous
//! is decided by `rivals`, a search of its own on the noise-free angles. Every member of the returned set is simulated
//! again from its start and must reproduce the data.
//!
//! Units: SI inside, as the headings say in the table. Errors: none.

mod rivals;
mod world;

use crate::observing::{Estimate, Hypothesis, estimate};

use self::world::{Case, Kind};
use super::{Cell, Experiment, Settings, Table};

/// rad: 0.5° each 0.5 ms, averaged over 10 ms.
const SIGMA_RAD: f64 = 0.112 / 180.0 * std::f64::consts::PI;

/// Costs above the truth's from which on a rival is told from it (a wrong choice by noise: 0.13 %).
const CLEAR: f64 = 36.0;

/// How near to the truth an estimate from exact data is: 0.2 mm, 1 mrad.
const EXACT: (f64, f64) = (2e-4, 1e-3);

/// The same from noisy data, on the same edge: 2 mm; a turn follows from the measured angle.
const NOISY: (f64, f64) = (2e-3, 2e-2);

/// What a member's cost may differ by when it is simulated again with other steps.
const REPRODUCED: f64 = 1.0;

/// Each row: what is pushed how, and the noise.
const ROWS: [(&str, Kind, f64); 8] = [
    ("rolling, exact", Kind::Rolling, 0.0),
    ("rolling, noisy", Kind::Rolling, SIGMA_RAD),
    ("frictionless, exact", Kind::Frictionless, 0.0),
    ("frictionless, noisy", Kind::Frictionless, SIGMA_RAD),
    ("sliding, exact", Kind::Sliding, 0.0),
    ("sliding, noisy", Kind::Sliding, SIGMA_RAD),
    ("coulomb, exact", Kind::Coulomb, 0.0),
    ("coulomb, noisy", Kind::Coulomb, SIGMA_RAD),
];

/// What came of one case.
#[derive(Clone, Copy, Debug, Default)]
struct Outcome {
    ambiguous: bool,
    first: bool,
    in_set: bool,
    members: usize,
    false_members: usize,
}

/// The table `pose`.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "pose",
    title: "pose of a pushed part from contact angles, edge unknown: how often it is named",
    cases: 200,
    run,
};

/// Runs it.
fn run(settings: &Settings) -> Table {
    let mut table = Table::new([
        "contact",
        "cases",
        "ambiguous",
        "first right",
        "of clear ones",
        "truth in set",
        "mean set",
        "false members",
    ]);
    table.definitions = vec![
        "60 % hulls of 3 to 9 random points, 40 % star-shaped polygons, all within 5 cm; mu 0.3, disk of 1 cm at 5 cm/s, every other one accelerating by 2.5 cm/s2; 0.8 s at 100 Hz; drawn until the contact lasts.".to_owned(),
        format!("noise {:.3} deg a value; exact: none. Prior of the start: omega N(0, 1 rad/s), vT N(0, 4 mm/s).", SIGMA_RAD.to_degrees()),
        "ambiguous: another edge, or an end more than 2 mm away, explains the exact angles with D2 < 36 at the noise (of exact data: at 1e-6 rad).".to_owned(),
        "right: the edge, and the end within 0.2 mm and 1 mrad (exact) or 2 mm and 20 mrad (noisy).".to_owned(),
        "false member: simulated again, it does not have the cost it claims.".to_owned(),
    ];
    for (name, kind, sigma) in ROWS {
        let outcomes = outcomes(settings, kind, sigma);
        table.failures.extend(failures(name, &outcomes, sigma));
        table.push(row(name, &outcomes));
    }
    table
}

/// The outcome of each case, on all processors.
fn outcomes(settings: &Settings, kind: Kind, sigma: f64) -> Vec<Outcome> {
    let threads = std::thread::available_parallelism().map_or(1, usize::from);
    let mut outcomes = vec![Outcome::default(); settings.cases];
    let chunk = settings.cases.div_ceil(threads).max(1);
    std::thread::scope(|scope| {
        for (i, chunk_outcomes) in outcomes.chunks_mut(chunk).enumerate() {
            scope.spawn(move || {
                for (j, outcome) in chunk_outcomes.iter_mut().enumerate() {
                    *outcome = try_case(&Case::draw(settings.seed, i * chunk + j, kind, sigma));
                }
            });
        }
    });
    outcomes
}

fn try_case(case: &Case) -> Outcome {
    let known = case.known();
    let estimate: Estimate = estimate(&known, &case.observation());
    let tolerance = if case.sigma > 0.0 { NOISY } else { EXACT };
    let right = |hypothesis: &Hypothesis| case.is_truth(hypothesis, tolerance);
    let false_members =
        estimate.hypotheses.iter().filter(|hypothesis| !case.reproduces(hypothesis, REPRODUCED)).count();
    Outcome {
        ambiguous: rivals::nearest(case) < CLEAR,
        first: estimate.hypotheses.first().is_some_and(right),
        in_set: estimate.hypotheses.iter().any(right),
        members: estimate.hypotheses.len(),
        false_members,
    }
}

fn row(name: &str, outcomes: &[Outcome]) -> Vec<Cell> {
    let count = |is: fn(&Outcome) -> bool| outcomes.iter().filter(|outcome| is(outcome)).count();
    let all = outcomes.len();
    let members: usize = outcomes.iter().map(|outcome| outcome.members).sum();
    #[expect(clippy::cast_precision_loss, reason = "counts of cases")]
    let mean = members as f64 / all.max(1) as f64;
    vec![
        name.into(),
        Cell::count(all),
        Cell::share(count(|outcome| outcome.ambiguous), all),
        Cell::share(count(|outcome| outcome.first), all),
        Cell::share(count(|outcome| outcome.first && !outcome.ambiguous), count(|outcome| !outcome.ambiguous)),
        Cell::share(count(|outcome| outcome.in_set), all),
        Cell::number(mean, 2),
        Cell::count(outcomes.iter().map(|outcome| outcome.false_members).sum()),
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
