//! Which of several parts was pushed: how often contact angles name it.
//!
//! Nothing of the thesis is beside it, which leaves this open (§8.2).
//!
//! Units: SI inside, as the headings say in the table. Errors: none.

use palpate::math::random::Draw;
use palpate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Push, Start};
use palpate::pushing::estimation::{Channel, Known, Measured, Observation, Observer as _, Prior, Touch, which_part};

use super::plan::{Case, DT_S, MU_G, OMEGA_SIGMA, SIGMA_RAD, finger_first, outcomes};
use super::{Cell, Experiment, Table, TableSettings};

/// Values of a push.
const VALUES: u32 = 81;

/// A part is certain, or excluded, if what speaks against it, or for it, is less probable than this.
pub(super) const DOUBT: f64 = 0.01;

/// How many parts are known, and how the finger accelerates, m/s².
const ROWS: [(&str, usize, [f64; 2]); 4] = [
    ("2, straight", 2, [0.0, 0.0]),
    ("2, aside", 2, [0.08, 0.0]),
    ("10, straight", 10, [0.0, 0.0]),
    ("10, aside", 10, [0.08, 0.0]),
];

/// What `palpate tables parts` runs.
pub(super) const EXPERIMENT: Experiment =
    Experiment { name: "parts", title: "which of several known parts was pushed", cases: 200, run };

/// What came of a case.
#[derive(Clone, Debug, Default)]
pub(super) struct Outcome {
    /// The probability of the part that was pushed.
    pub(super) truth: f64,
    /// The largest of another one.
    pub(super) other: f64,
}

impl Outcome {
    pub(super) fn is_first(&self) -> bool {
        self.truth > self.other
    }

    pub(super) fn is_certain(&self) -> bool {
        self.truth.max(self.other) > 1.0 - DOUBT
    }

    /// How often parts were named, not excluded, certain, and wrong though certain: of so many cases.
    pub(super) fn shares(outcomes: &[&Self], all: usize) -> [Cell; 4] {
        let share =
            |is: &dyn Fn(&Self) -> bool| Cell::share(outcomes.iter().filter(|outcome| is(outcome)).count(), all);
        [
            share(&Self::is_first),
            share(&|outcome| outcome.truth > DOUBT),
            share(&Self::is_certain),
            share(&|outcome| outcome.is_certain() && !outcome.is_first()),
        ]
    }
}

/// Headings of a row's name, of its cases, and of [`Outcome::shares`].
pub(super) const COLUMNS: [&str; 6] = ["parts, push", "cases", "named", "not excluded", "certain", "wrong and certain"];

/// What they mean.
pub(super) fn in_words() -> String {
    format!(
        "named: the part that was pushed is the likeliest. not excluded: its probability is above {DOUBT}. certain: that of some part is above {}.",
        1.0 - DOUBT
    )
}

/// Draws, simulates and judges all cases.
fn run(settings: &TableSettings) -> Table {
    let mut table = Table::new(COLUMNS);
    table.definitions = definitions();
    for (name, parts, acceleration) in ROWS {
        let outcomes: Vec<Outcome> = outcomes(settings, |seed, number| outcome(seed, number, parts, acceleration));
        let cells = [name.into(), Cell::count(outcomes.len())];
        let shares = Outcome::shares(&outcomes.iter().collect::<Vec<_>>(), outcomes.len());
        table.push(cells.into_iter().chain(shares));
        let wrong = outcomes.iter().enumerate().filter(|(_, outcome)| outcome.truth <= DOUBT);
        table
            .failures
            .extend(wrong.map(|(case, _)| format!("{name}, case {case}: the part that was pushed is excluded")));
    }
    table
}

fn definitions() -> Vec<String> {
    let text = [
        "Rolling contact, mu 0.3, disk of 1 cm at 5 cm/s, for 0.8 s straight on or accelerating sideways by 8 cm/s2; parts and starts as in the table `plan`, drawn anew until the contact lasts.".to_owned(),
        format!("Felt: contact angles at 100 Hz with {:.3} deg of noise. Known: all parts, the finger's motion, mu. Any edge of any part may have been touched, anywhere.", SIGMA_RAD.to_degrees()),
        in_words(),
    ];
    text.to_vec()
}

fn outcome(seed: u64, number: usize, parts: usize, acceleration: [f64; 2]) -> Outcome {
    let mut draw = Draw::case(seed, number);
    let finger = Finger { acceleration: acceleration.into(), ..finger_first() };
    let (case, values) = loop {
        let Some(case) = Case::try_draw(&mut draw) else { continue };
        if let Some(angles) = angles(&case, finger) {
            break (case, angles.iter().map(|angle| angle + SIGMA_RAD * draw.normal()).collect());
        }
    };
    let others: Vec<_> = std::iter::from_fn(|| Some(Case::try_draw(&mut draw)))
        .flatten()
        .take(parts - 1)
        .map(|case| case.part)
        .collect();
    let touch = Touch::Rolling { friction: None };
    let known: Vec<_> =
        std::iter::once(&case.part).chain(&others).map(|part| Known { part, mu_g: MU_G, finger, touch }).collect();
    let observation = Observation {
        dt: DT_S,
        measured: Measured::ContactAngle(Channel { values, sigma: SIGMA_RAD }),
        prior: Prior { omega0_sigma: Some(OMEGA_SIGMA), v_t0_sigma: None, mu_g_log_sigma: None },
    };
    let ranked = which_part(known.iter().map(|known| (known.part, known.estimate(&observation))));
    let of = |truth: bool| ranked.iter().filter(move |part| (part.part == 0) == truth).map(|part| part.probability);
    Outcome { truth: of(true).sum(), other: of(false).fold(0.0, f64::max) }
}

/// Exact contact angles; none if the contact does not last.
fn angles(case: &Case, finger: Finger) -> Option<Vec<f64>> {
    let law = ContactLaw::Rolling { friction: None };
    let push = Push::new(case.model(case.edge, finger)?, law, Start::Moving(case.start), EdgeEnd::Stop).ok()?;
    let times: Vec<_> = (0..VALUES).map(|i| f64::from(i) * DT_S).collect();
    let samples = push.run(&times).ok()?.samples;
    (samples.len() == times.len()).then(|| samples.iter().map(|sample| sample.state.u).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A short run; the full one is `palpate tables parts`.
    #[test]
    fn the_part_that_was_pushed_is_never_excluded() {
        let table = run(&TableSettings { cases: 4, seed: 1, jobs: None });
        assert!(table.failures.is_empty(), "{table}");
    }
}
