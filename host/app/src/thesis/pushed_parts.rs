//! Which of many parts was pushed, or none of them, through the whole chain: is it named rightly, and in what time?
//!
//! What `palpate which-part --library` does with a push of a carried finger: a first look at every part, then a search with
//! those that come near; and with `--earlier` after a second push at another edge: a search with the parts that the first left.
//!
//! Units: as the columns' headings say. Errors: none; a chain that broke is a failure.

use palpate::math::random::Draw;
use palpate::math::statistics::{median, percentile};
use palpate::pushing::dynamics::Part;
use palpate::pushing::estimation::from_rest::trial::{Drawn, Ranges, random_part, turning_motion};
use palpate::pushing::estimation::from_rest::{self, WindowedForce};
use palpate::pushing::estimation::{Fit, Observer as _, PartBelief, Shortlist};
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

/// What a row is about.
struct Row {
    name: &'static str,
    /// Whether the part is in the library.
    is_known: bool,
    /// How often the finger turns in a push.
    turns: usize,
    /// Whether the part is pushed again at another edge.
    twice: bool,
}

const ROWS: [Row; 6] = [
    Row { name: "in the library", is_known: true, turns: 1, twice: false },
    Row { name: "not in it", is_known: false, turns: 1, twice: false },
    Row { name: "in it, turning back", is_known: true, turns: 2, twice: false },
    Row { name: "not in it, turning back", is_known: false, turns: 2, twice: false },
    Row { name: "in it, pushed twice so", is_known: true, turns: 2, twice: true },
    Row { name: "not in it, pushed twice so", is_known: false, turns: 2, twice: true },
];

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
    /// Of the dearer answer, on one thread.
    seconds: f64,
}

impl Trial {
    /// What is believed, against the truth: a part's place, or none.
    fn judged(belief: &PartBelief, truth: Option<usize>) -> Self {
        let shares = || belief.parts.iter().map(|part| (1.0 - belief.none) * part.probability).enumerate();
        let other = shares().filter(|(part, _)| Some(*part) != truth).map(|(_, share)| share).fold(0.0, f64::max);
        let (of_truth, other) = match truth {
            Some(truth) => ((1.0 - belief.none) * belief.parts[truth].probability, other.max(belief.none)),
            None => (belief.none, other),
        };
        let possible = belief.parts.iter().filter(|part| part.probability > DOUBT).count();
        Self { truth: of_truth, other, possible, searched: 0, look: None, seconds: 0.0 }
    }

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
             found. Pushed twice so: then it lies elsewhere, and is pushed in the same way at another edge."
        ),
        format!(
            "right: the part is the likeliest; of one that is not in the library: none of these is, since no part explains the \
             push. truth excluded: that answer is less probable than {DOUBT}. one possible: so many parts explain the push, \
             or none where it is not in the library: pushes that tell. searched: parts that came near at a first look \
             (median; of two pushes by the first). s an answer: first look and searches, on one thread; of two answers the dearer."
        ),
    ]);
    let parts = library(settings.seed, LIBRARY);
    for of_row in ROWS {
        let name = of_row.name;
        let ranges = ranges(turning_motion(of_row.turns));
        let of = |case| trial(&ranges, settings.seed, case, &parts, &of_row);
        let trials = of_each_in_order(settings.cases, settings.jobs(), of, |_| ());
        for (case, trial) in trials.iter().enumerate() {
            match trial {
                Ok(trial) if trial.is_right() => {}
                Ok(trial) => table.failures.push(format!("{name}, case {case}: {}", trial.in_words())),
                Err(error) => table.failures.push(format!("{name}, case {case}: {error}")),
            }
        }
        let told = usize::from(of_row.is_known);
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

/// A part of the library, with its number, or another one; and how it is pushed at as many edges as are wanted.
fn pushed(ranges: &Ranges, parts: &[Part], of_row: &Row, draw: &mut Draw) -> (Option<usize>, Vec<Drawn>) {
    loop {
        let number = draw.index(parts.len());
        let stranger = random_part(draw);
        let (number, part) = if of_row.is_known { (Some(number), &parts[number]) } else { (None, &stranger) };
        let Some(first) = ranges.draw(draw, part) else { continue };
        if !of_row.twice {
            return (number, vec![first]);
        }
        let of_its_mass = Ranges { mass: first.mass..=first.mass, ..ranges.clone() };
        let again = (0..EDGES_DRAWN).filter_map(|_| of_its_mass.draw(draw, part));
        if let Some(second) = again.into_iter().find(|second| second.edge != first.edge) {
            return (number, vec![first, second]);
        }
    }
}

/// Pushes that are drawn to have one at another edge.
const EDGES_DRAWN: usize = 20;

fn trial(ranges: &Ranges, seed: u64, case: usize, parts: &[Part], of_row: &Row) -> Result<Trial, String> {
    let (truth, drawn) = pushed(ranges, parts, of_row, &mut Draw::case(seed, case));
    let mut rig = Rig::start(finger_seed(seed, case), 1.0, Line::Pipe).map_err(|error| error.to_string())?;
    let mut of_push = |drawn: &Drawn| {
        let measured = felt(&mut rig, &drawn.played, &ranges.motion, ranges.motion.duration());
        measured.map_err(|error| error.to_string())?.ok_or("a push was not felt".to_owned())
    };
    let felt = drawn.iter().map(&mut of_push).collect::<Result<Vec<_>, _>>()?;
    let known = |part: usize| known_of(ranges, &parts[part], rig.finger());
    let [first, others @ ..] = &felt[..] else { return Err("nothing was pushed".to_owned()) };
    let mut begun = ProcessorTime::now();
    let looks: Vec<_> = (0..parts.len()).map(|part| from_rest::first_look(&known(part), first)).collect();
    let after = |belief: &PartBelief, searched: Vec<usize>, measured: &WindowedForce| {
        let searched = searched.into_iter().map(|place| (place, known(place)));
        belief.after(searched.map(|(place, known)| (place, known.part, known.estimate(measured)))).1
    };
    let Shortlist { kept, .. } = Shortlist::new(&looks);
    let searched = kept.len();
    let mut belief = after(&PartBelief::beforehand(parts.len()), kept, first);
    let mut seconds = begun.seconds();
    for measured in others {
        begun = ProcessorTime::now();
        belief = after(&belief, belief.possible().collect(), measured);
        seconds = seconds.max(begun.seconds());
    }
    let look = truth.map(|truth| looks[truth]);
    Ok(Trial { searched, look, seconds, ..Trial::judged(&belief, truth) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pushed_part_of_a_library_is_named_and_a_stranger_is_none_of_it() {
        let parts = library(1, 8);
        for of_row in ROWS {
            let trial = trial(&ranges(turning_motion(of_row.turns)), 1, 0, &parts, &of_row).unwrap();
            assert!(trial.is_right(), "{}: {}", of_row.name, trial.in_words());
        }
    }
}
