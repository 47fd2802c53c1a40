//! Which of many parts was pushed, or none of them, through the whole chain: is it named rightly, and in what time?
//!
//! What `palpate which-part --library` does with a push of a carried finger: a first look at every part, then a search with
//! those that come near.
//!
//! Units: as the columns' headings say. Errors: none; a chain that broke is a failure.

use std::time::Instant;

use palpate::math::random::Draw;
use palpate::math::statistics::{median, percentile};
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::from_rest::trial::{Drawn, Ranges, random_part};
use palpate::pushing::estimation::from_rest::{self, WindowedForce};
use palpate::pushing::estimation::{Observer as _, Shortlist, none_of_these, which_part};
use palpate_device::simulated::Line;

use super::carried::{felt, ranges};
use super::cases::of_each_in_order;
use super::chain::{finger_seed, known_of};
use super::demonstration::Rig;
use super::parts::DOUBT;
use super::touched_parts::{LIBRARY, LIBRARY_SEED};
use super::{Cell, Experiment, Table, TableSettings};

/// What `palpate tables pushed-parts` runs.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "pushed-parts",
    title: "which of 500 parts is pushed by a carried finger, or none of them",
    cases: 100,
    run: table,
};

/// What came of a push.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Named {
    /// The part that was pushed is the likeliest; or nothing explains one that is not in the library.
    Right,
    /// The same where another part is likelier, though not certain.
    Open,
    /// Another part is certain.
    Wrong,
}

struct Trial {
    named: Named,
    /// Whether one answer only is possible.
    is_certain: bool,
    /// In words.
    said: String,
    searched: usize,
    /// Of the answer, on one thread.
    seconds: f64,
}

fn table(settings: &TableSettings) -> Table {
    let columns = [
        "row",
        "pushes",
        "right",
        "certain",
        "right of those",
        "wrong and certain",
        "searched",
        "s an answer",
        "slowest",
    ];
    let mut table = Table::new(columns);
    table.definitions.extend([
        format!(
            "A library of {LIBRARY} parts, drawn as in the table `chain`, and a part that is one of them, or is drawn in the \
             same way and is none of them; pushed from rest with a turn, felt by a finger of its own with the datasheet's \
             noise and hum, calibrated and waved. Any edge of any part may have been touched, anywhere; mass and mu_c are \
             found."
        ),
        format!(
            "right: the part is the likeliest; of one that is not in the library: no part explains the push, or none of \
             these is the likeliest. certain: what speaks against that answer is less probable than {DOUBT}. searched: parts \
             that came near at a first look (median). s an answer: first look and searches, on one thread."
        ),
    ]);
    let parts = library(settings.seed, LIBRARY);
    let ranges = ranges(Ranges::default().motion);
    for is_known in [true, false] {
        let of = |case| trial(&ranges, settings.seed, case, &parts, is_known);
        let trials = of_each_in_order(settings.cases, settings.jobs(), of, |_| ());
        let name = if is_known { "in the library" } else { "not in it" };
        for (case, trial) in trials.iter().enumerate() {
            match trial {
                Ok(trial) if trial.named == Named::Right => {}
                Ok(trial) => table.failures.push(format!("{name}, case {case}: {}", trial.said)),
                Err(error) => table.failures.push(format!("{name}, case {case}: {error}")),
            }
        }
        table.push(row(name, trials.len(), &trials.into_iter().flatten().collect::<Vec<_>>()));
    }
    table
}

fn row(name: &str, all: usize, trials: &[Trial]) -> Vec<Cell> {
    let count = |of: &dyn Fn(&Trial) -> bool| trials.iter().filter(|trial| of(trial)).count();
    let certain = count(&|trial| trial.is_certain);
    let number = |value: Option<f64>, decimals: usize| Cell::number(value.unwrap_or(f64::NAN), decimals);
    let seconds = || trials.iter().map(|trial| trial.seconds);
    vec![
        name.into(),
        Cell::count(all),
        Cell::share(count(&|trial| trial.named == Named::Right), all),
        Cell::share(certain, all),
        Cell::share(count(&|trial| trial.is_certain && trial.named == Named::Right), certain),
        Cell::share(count(&|trial| trial.named == Named::Wrong), all),
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
    let begun = Instant::now();
    let known = |part: usize| known_of(ranges, &parts[part], rig.finger());
    let misfits: Vec<_> = (0..parts.len()).map(|part| from_rest::coarse_misfit(&known(part), measured)).collect();
    let shortlist = Shortlist::new(&misfits);
    let searched = shortlist.kept.iter().map(|&part| known(part));
    let ranked = which_part(searched.map(|known| (known.part, known.estimate(measured))));
    let none = none_of_these(&ranked);
    let seconds = begun.elapsed().as_secs_f64();
    let of = |part: usize| {
        let listed = ranked.iter().find(|ranked| shortlist.kept[ranked.part] == part);
        (1.0 - none) * listed.map_or(0.0, |listed| listed.probability)
    };
    let true_share = truth.map_or(none, of);
    // The likeliest of the others.
    let others = ranked.iter().map(|ranked| shortlist.kept[ranked.part]).filter(|&part| Some(part) != truth);
    let other = others.map(of).fold(if truth.is_some() { none } else { 0.0 }, f64::max);
    let named = match () {
        () if true_share > other => Named::Right,
        () if true_share > DOUBT => Named::Open,
        () => Named::Wrong,
    };
    let said = format!(
        "probability of the truth {true_share:.3}, of the likeliest other answer {other:.3}, of none of these {none:.3}; \
         its misfit at a first look {:.2}",
        truth.map_or(f64::NAN, |truth| misfits[truth])
    );
    let is_certain = true_share.max(other) > 1.0 - DOUBT;
    Trial { named, is_certain, said, searched: shortlist.kept.len(), seconds }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pushed_part_of_a_library_is_named_and_a_stranger_is_none_of_it() {
        let parts = library(1, 8);
        let ranges = ranges(Ranges::default().motion);
        for is_known in [true, false] {
            let trial = trial(&ranges, 1, 0, &parts, is_known).unwrap();
            assert_eq!(trial.named, Named::Right, "{is_known}: {}", trial.said);
        }
    }
}
