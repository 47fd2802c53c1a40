//! Which of many parts was pushed, or none of them, through the whole chain: is it named rightly, and in what time?
//!
//! What `palpate which-part --library` does with a push of a carried finger: a first look at every part, then a search with
//! those that come near.
//!
//! Units: as the columns' headings say. Errors: none; a chain that broke is a failure.

use nalgebra::{Point2, Vector2};
use palpate::math::random::Draw;
use palpate::math::statistics::{median, percentile};
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::from_rest::trial::{Drawn, Ranges, default_motion, random_part};
use palpate::pushing::estimation::from_rest::{self, WindowedForce};
use palpate::pushing::estimation::{Fit, Observer as _, PartEstimate, Shortlist, none_of_these, which_part};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate_device::simulated::Line;

use super::carried::{felt, ranges};
use super::cases::of_each_in_order;
use super::chain::{finger_seed, known_of};
use super::demonstration::Rig;
use super::parts::DOUBT;
use super::processor_time::ProcessorTime;
use super::touched_parts::{LIBRARY, LIBRARY_SEED};
use super::{Cell, Experiment, Table, TableSettings};

/// What `palpate tables pushed-parts` runs.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "pushed-parts",
    title: "which of 500 parts is pushed by a carried finger, or none of them",
    cases: 100,
    run: table,
};

/// A row, whether the part is in the library, and whether the finger turns back after its turn.
const ROWS: [(&str, bool, bool); 4] = [
    ("in the library", true, false),
    ("not in it", false, false),
    ("in it, turning back", true, true),
    ("not in it, turning back", false, true),
];

/// The chain's motion with a turn back after it: half as long again.
fn turning_back() -> FingerMotion {
    let more = Segment { seconds: 0.5, acceleration: Vector2::new(0.15, -0.3) };
    let segments = [default_motion().segments(), &[more]].concat();
    FingerMotion::new(Point2::origin(), &segments).expect("constant segments are sound")
}

/// What came of a push.
struct Trial {
    /// Of the part that was pushed, or of none of these where it is not in the library.
    truth: f64,
    /// The largest of another answer.
    other: f64,
    /// How many parts are possible.
    possible: usize,
    searched: usize,
    /// What the true part costs at a first look, and may at the most.
    look: Option<Fit>,
    /// Of the answer, on one thread.
    seconds: f64,
}

impl Trial {
    fn is_right(&self) -> bool {
        self.truth > self.other
    }

    fn in_words(&self) -> String {
        let Self { truth, other, possible, searched, .. } = self;
        let look = self.look.and_then(|look| Some(look.cost? / look.cost_max));
        let look = look.map_or_else(String::new, |misfit| format!("; its misfit at a first look {misfit:.2}"));
        format!(
            "probability of the truth {truth:.3}, of the likeliest other answer {other:.3}; {possible} parts possible of \
             {searched} searched{look}"
        )
    }
}

fn table(settings: &TableSettings) -> Table {
    let columns = [
        "row",
        "pushes",
        "right",
        "truth excluded",
        "one possible",
        "right of those",
        "searched",
        "s an answer",
        "slowest",
    ];
    let mut table = Table::new(columns);
    table.definitions.extend([
        format!(
            "A library of {LIBRARY} parts, drawn as in the table `chain`, and a part that is one of them, or is drawn in the \
             same way and is none of them; pushed from rest with a turn, or with a turn and back, felt by a finger of its own with the datasheet's \
             noise and hum, calibrated and waved. Any edge of any part may have been touched, anywhere; mass and mu_c are \
             found."
        ),
        format!(
            "right: the part is the likeliest; of one that is not in the library: none of these is, since no part explains the \
             push. truth excluded: that answer is less probable than {DOUBT}. one possible: so many parts explain the push, \
             or none where it is not in the library: pushes that tell. searched: parts that came near at a first look \
             (median). s an answer: first look and searches, on one thread."
        ),
    ]);
    let parts = library(settings.seed, LIBRARY);
    for (name, is_known, turns_back) in ROWS {
        let ranges = if turns_back { ranges(turning_back()) } else { ranges(default_motion()) };
        let of = |case| trial(&ranges, settings.seed, case, &parts, is_known);
        let trials = of_each_in_order(settings.cases, settings.jobs(), of, |_| ());
        for (case, trial) in trials.iter().enumerate() {
            match trial {
                Ok(trial) if trial.is_right() => {}
                Ok(trial) => table.failures.push(format!("{name}, case {case}: {}", trial.in_words())),
                Err(error) => table.failures.push(format!("{name}, case {case}: {error}")),
            }
        }
        let told = usize::from(is_known);
        table.push(row(name, trials.len(), told, &trials.into_iter().flatten().collect::<Vec<_>>()));
    }
    table
}

/// A push tells where so many parts are possible.
fn row(name: &str, all: usize, told: usize, trials: &[Trial]) -> Vec<Cell> {
    let count = |of: &dyn Fn(&Trial) -> bool| trials.iter().filter(|trial| of(trial)).count();
    let tells = count(&|trial| trial.possible == told);
    let number = |value: Option<f64>, decimals: usize| Cell::number(value.unwrap_or(f64::NAN), decimals);
    let seconds = || trials.iter().map(|trial| trial.seconds);
    vec![
        name.into(),
        Cell::count(all),
        Cell::share(count(&Trial::is_right), all),
        Cell::share(count(&|trial| trial.truth < DOUBT), all),
        Cell::share(tells, all),
        Cell::share(count(&|trial| trial.possible == told && trial.is_right()), tells),
        number(median(trials.iter().map(|trial| trial.searched as f64)), 0),
        number(median(seconds()), 1),
        number(percentile(seconds(), 100), 1),
    ]
}

fn library(seed: u64, count: usize) -> Vec<Part> {
    (0..count).map(|number| random_part(&mut Draw::case(seed ^ LIBRARY_SEED, number))).collect()
}

/// A push of a part of the library, with its number, or of another one.
fn pushed(ranges: &Ranges, parts: &[Part], is_known: bool, draw: &mut Draw) -> (Option<usize>, Drawn) {
    loop {
        let number = draw.index(parts.len());
        let stranger = random_part(draw);
        let (number, part) = if is_known { (Some(number), &parts[number]) } else { (None, &stranger) };
        if let Some(drawn) = ranges.draw(draw, part) {
            return (number, drawn);
        }
    }
}

fn trial(ranges: &Ranges, seed: u64, case: usize, parts: &[Part], is_known: bool) -> Result<Trial, String> {
    let (truth, drawn) = pushed(ranges, parts, is_known, &mut Draw::case(seed, case));
    let mut rig = Rig::start(finger_seed(seed, case), 1.0, Line::Pipe).map_err(|error| error.to_string())?;
    let measured = felt(&mut rig, &drawn.played, &ranges.motion, ranges.motion.duration());
    let measured = measured.map_err(|error| error.to_string())?.ok_or("the push was not felt")?;
    Ok(named(ranges, &rig, parts, &measured, truth))
}

fn named(ranges: &Ranges, rig: &Rig, parts: &[Part], measured: &WindowedForce, truth: Option<usize>) -> Trial {
    let begun = ProcessorTime::now();
    let known = |part: usize| known_of(ranges, &parts[part], rig.finger());
    let looks: Vec<_> = (0..parts.len()).map(|part| from_rest::first_look(&known(part), measured)).collect();
    let Shortlist { kept, .. } = Shortlist::new(&looks);
    let searched = kept.iter().map(|&part| known(part));
    let ranked = which_part(searched.map(|known| (known.part, known.estimate(measured))));
    let none = none_of_these(&ranked, parts.len());
    let seconds = begun.seconds();
    let of = |part: &PartEstimate| (kept[part.part], (1.0 - none) * part.probability);
    let shares: Vec<_> = ranked.iter().map(of).collect();
    let is_true = |(part, _): &&(usize, f64)| Some(*part) == truth;
    let of_truth: f64 = shares.iter().filter(is_true).map(|(_, share)| share).sum();
    let other = shares.iter().filter(|share| !is_true(share)).map(|(_, share)| *share).fold(0.0, f64::max);
    let possible = ranked.iter().filter(|part| part.probability > DOUBT).count();
    let (of_truth, other) = if truth.is_some() { (of_truth, other.max(none)) } else { (none, other) };
    Trial { truth: of_truth, other, possible, searched: kept.len(), look: truth.map(|truth| looks[truth]), seconds }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pushed_part_of_a_library_is_named_and_a_stranger_is_none_of_it() {
        let parts = library(1, 8);
        let ranges = ranges(default_motion());
        for is_known in [true, false] {
            let trial = trial(&ranges, 1, 0, &parts, is_known).unwrap();
            assert!(trial.is_right(), "{is_known}: {}", trial.in_words());
        }
    }
}
