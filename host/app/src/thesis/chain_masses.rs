//! The whole chain with light and heavy parts and fingers: whether what the finger feels of its own mass hides anything.
//!
//! Each case is a finger of its own, as heavy as its row says, calibrated, waved in the air and pushed as in
//! [`super::chain`]; the simulated world accelerates beam and disk, rings them and bends them.
//!
//! Units: as the columns' headings say. Errors: none; a chain that broke is a failure.

use std::time::Instant;

use palpate::math::statistics::percentile;
use palpate::pushing::dynamics::ContactMode;
use palpate::pushing::estimation::Status;
use palpate::pushing::estimation::from_rest::trial::{Ranges, TrialOutcome};
use palpate_device::simulated::Line;
use palpate_shared::sim::{BeamConfig, CarriedConfig, CarriedMasses, FingerConfig};

use super::cases::of_each_in_order;
use super::chain::{drawn, felt, finger_seed};
use super::demonstration::{Rig, compliance_by_design, finger};
use super::judged::{PoseClaim, rate};
use super::{Cell, Experiment, Table, TableSettings};

/// What `palpate tables chain-masses` runs.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "chain-masses",
    title: "the same with light and heavy parts and fingers, and more noise",
    cases: 300,
    run,
};

/// Masses of parts, kg.
const PARTS: [f64; 3] = [0.05, 0.2, 1.0];

/// Effective masses of fingers, kg.
const FINGERS: [f64; 3] = [0.005, 0.02, 0.06];

/// Noise of a value, N.
const NOISES: [f64; 3] = [2e-3, 5e-3, 1e-2];

/// What a mean over 8 ms of the default finger is off by, N: its white noise, without the hum that means over 40 ms have none of.
const DEFAULT_NOISE: f64 = 2e-3;

/// Errors beyond these are of another pose, where they are beyond five stated deviations too: m, rad.
const OFF: (f64, f64) = (3e-4, 0.3 * std::f64::consts::PI / 180.0);

/// Who acts on a pose may take the likeliest for the only one where it is as probable as this.
const SURE: f64 = 0.99;

/// What came of a case.
#[derive(Clone, Debug)]
struct Outcome {
    trial: TrialOutcome,
    /// Whether the part slipped along the finger.
    slipped: bool,
    is_covered: bool,
    /// Of the likeliest pose.
    probability: f64,
    milliseconds: f64,
}

impl Outcome {
    fn is_unique(&self) -> bool {
        self.trial.status == Status::Unique
    }

    fn is_wrong_and_certain(&self) -> bool {
        let is_off = self.trial.best.is_none_or(|error| error.distance > OFF.0 || error.angle > OFF.1);
        self.is_unique() && !self.trial.holds_truth && is_off
    }

    fn is_sure(&self) -> bool {
        self.probability >= SURE
    }
}

fn run(settings: &TableSettings) -> Table {
    let mut table = Table::new([
        "part, finger, noise",
        "cases",
        "slipped",
        "unique of those",
        "sure of those",
        "unique of others",
        "none",
        "wrong and certain",
        "in all's 95 %",
        "median mm",
        "median deg",
        "longest ms",
    ]);
    table.definitions = definitions();
    for noise in NOISES {
        for mass in PARTS {
            for finger in FINGERS {
                add_row(settings, mass, finger, noise, &mut table);
            }
        }
    }
    table
}

fn add_row(settings: &TableSettings, mass: f64, effective_mass: f64, noise: f64, table: &mut Table) {
    let ranges = Ranges { mass: mass..=mass, compliance: compliance_by_design(), ..Ranges::default() };
    let times = noise / DEFAULT_NOISE;
    let of_finger = heavy(effective_mass, times);
    let case = |number| case(&ranges, of_finger, times, settings.seed, number);
    let outcomes = of_each_in_order(settings.cases, settings.jobs(), case, |_| ());
    let name = format!("{mass} kg, {} g, {} mN", effective_mass * 1e3, noise * 1e3);
    let sound: Vec<_> = outcomes.iter().filter_map(|outcome| outcome.as_ref().ok()).collect();
    let count = |is: &dyn Fn(&Outcome) -> bool| sound.iter().filter(|outcome| is(outcome)).count();
    let slipped = count(&|outcome| outcome.slipped);
    let median = |of: &dyn Fn(&Outcome) -> Option<f64>| {
        percentile(sound.iter().filter_map(|outcome| of(outcome)), 50).map_or(Cell::Empty, |at| Cell::number(at, 3))
    };
    let longest = sound.iter().map(|outcome| outcome.milliseconds).fold(0.0, f64::max);
    table.failures.extend(outcomes.iter().enumerate().filter_map(|(number, outcome)| match outcome {
        Ok(outcome) if outcome.trial.holds_truth && outcome.is_covered => None,
        Ok(outcome) => Some(format!("{name}, case {number}: {outcome:?}")),
        Err(error) => Some(format!("{name}, {error}")),
    }));
    table.push([
        name.into(),
        Cell::count(outcomes.len()),
        Cell::count(slipped),
        Cell::share(count(&|outcome| outcome.slipped && outcome.is_unique()), slipped),
        Cell::share(count(&|outcome| outcome.slipped && outcome.is_sure()), slipped),
        Cell::share(count(&|outcome| !outcome.slipped && outcome.is_unique()), sound.len() - slipped),
        Cell::count(count(&|outcome| outcome.trial.status == Status::Unexplained)),
        Cell::count(count(&Outcome::is_wrong_and_certain)),
        rate(count(&|outcome| outcome.is_covered), sound.len()),
        median(&|outcome| outcome.trial.best.map(|error| error.distance * 1e3)),
        median(&|outcome| outcome.trial.best.map(|error| error.angle.to_degrees())),
        Cell::number(longest, 0),
    ]);
}

fn definitions() -> Vec<String> {
    let text = [
        "Parts and pushes as in the table chain, with a turn, but that part and finger weigh what the row says: the effective mass, of disk and beam together. noise: white, of a mean over 8 ms; calibration and tare have as much.",
        "slipped: the part slipped along the finger, as with one friction it then must for its pose to be told; where it only sticks, several poses feel alike.",
        "unique: one pose is listed, all others cost 16 more. sure: the likeliest is 99 % probable, whatever is listed beside it.",
        "wrong and certain: one pose is listed, and it is over 5 of its stated standard deviations and 0.3 mm or 0.3 deg from the truth, or none is near it.",
        "in all's 95 %: how often the truth is where what all hypotheses say together is densest, and 95 % of it; in brackets the interval of 99 %.",
        "longest ms: of one case's push, simulated and felt, and its answer together.",
    ];
    text.map(str::to_owned).to_vec()
}

fn case(ranges: &Ranges, of_finger: FingerConfig, noise: f64, seed: u64, number: usize) -> Result<Outcome, String> {
    let (part, drawn) = drawn(ranges, seed, number);
    let rig = Rig::of(finger_seed(seed, number), of_finger, noise, Line::Pipe);
    let begun = Instant::now();
    let estimate = felt(rig, ranges, &part, &drawn, number)?;
    let milliseconds = begun.elapsed().as_secs_f64() * 1e3;
    let truth = drawn.played.pose(estimate.time_end).ok_or_else(|| format!("case {number}: no pose at the end"))?;
    let claims: Vec<_> =
        estimate.hypotheses.iter().map(|found| PoseClaim::of(found, estimate.symmetry, &truth)).collect();
    Ok(Outcome {
        trial: TrialOutcome::new(&part, &drawn, &estimate),
        slipped: drawn.played.samples.iter().any(|sample| sample.contact != ContactMode::Rolling),
        is_covered: PoseClaim::cover(&claims),
        probability: estimate.hypotheses.first().map_or(0.0, |likeliest| likeliest.probability),
        milliseconds,
    })
}

/// The default finger with so many times its noise, and a disk that makes its effective mass what is asked for, kg.
fn heavy(effective_mass: f64, noise: f64) -> FingerConfig {
    let default = finger(noise);
    let bare = BeamConfig { disk_mass: 0.0, ..default.beam };
    #[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
    let disk_mass = effective_mass as f32 - CarriedMasses::new(&bare, CarriedConfig::default().density).effective;
    FingerConfig { beam: BeamConfig { disk_mass, ..default.beam }, ..default }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A value is a mean over so long, and so many make a period of the hum twice, s.
    const VALUE_S: f64 = 8e-3;
    const VALUES: f64 = 5.0;

    #[test]
    fn a_value_of_the_default_finger_is_as_noisy_as_the_table_says() {
        let mut rig = Rig::start(3, 1.0, Line::Pipe).unwrap();
        let readings = rig.rest().unwrap();
        let period = (readings[readings.len() - 1].t - readings[0].t) / (readings.len() - 1) as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some readings")]
        let value = (VALUES * VALUE_S / period).round() as usize;
        let values: Vec<_> = readings
            .chunks_exact(value)
            .map(|of| of.iter().map(|it| it.force_finger.x).sum::<f64>() / value as f64)
            .collect();
        // Neighbours' differences: hum and drift are slower.
        let squares: f64 = values.windows(2).map(|two| (two[1] - two[0]).powi(2)).sum();
        let sd = (VALUES * squares / (2.0 * (values.len() - 1) as f64)).sqrt();
        // Of some fifty values a deviation is known to a tenth.
        assert!((sd / DEFAULT_NOISE - 1.0).abs() < 0.3, "{sd}");
    }

    #[test]
    fn heavy_and_light_fingers_feel_a_light_and_a_heavy_part() {
        let settings = TableSettings { cases: 1, seed: 2, jobs: None };
        let mut table = Table::new(["row"; 12]);
        add_row(&settings, 0.05, 0.06, 2e-3, &mut table);
        add_row(&settings, 1.0, 0.005, 2e-3, &mut table);
        assert!(table.failures.is_empty(), "{:?}", table.failures);
    }
}
