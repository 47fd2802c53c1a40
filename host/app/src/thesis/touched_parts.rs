//! Which of many parts was touched, or none of them: is it named rightly, and how long is each approach thought about?

use palpate::geometry::SimplePolygon;
use palpate::inscription::{Met, PartLeft, PartsSearch, PartsVerdict, TouchTolerance};
use palpate::math::random::Draw;
use palpate::math::statistics::{median, percentile};

use super::cases::{of_each_in_order, random_part};
use super::processor_time::ProcessorTime;
use super::touch::{APPROACHES_MAX, Ending, PLANNED_ROBOT_MM, RADIUS, area, judged, placed, safe_speed, widened};
use super::{Cell, Experiment, Table, TableSettings};

/// Which of many parts it is.
pub(super) const EXPERIMENT: Experiment = Experiment {
    name: "touched-parts",
    title: "which of 500 parts is touched, or none of them",
    cases: 200,
    run: table,
};

/// Parts of the library.
pub(super) const LIBRARY: usize = 500;

/// What tells the library's draws from those of the cases.
pub(super) const LIBRARY_SEED: u64 = 0x006c_6962_7261_7279;

/// What came of a part that is one of many, or none of them.
struct Trial {
    ending: Ending,
    /// In words.
    said: String,
    touches: usize,
    approaches: usize,
    /// From each approach to what is left and the next one, s.
    answers: Vec<f64>,
}

fn table(settings: &TableSettings) -> Table {
    let columns = [
        "row",
        "parts",
        "right",
        "wrong",
        "not decided",
        "touches",
        "touches 90 %",
        "approaches",
        "s an answer",
        "90 %",
        "slowest",
    ];
    let mut table = Table::new(columns);
    table.definitions.extend([
        format!(
            "A library of {LIBRARY} parts and a part that is one of them, or is drawn in the same way and is none of \
             them; parts, square, finger and robot as in the first row of `touch`."
        ),
        "Right: the part is named and its pose within 0.2 mm and 0.3°, or it is among those that are said to be alike; of a \
         part that is none of them: none of these. Wrong: another part, or a pose beyond that; of a part of the library: \
         none of these. An answer is what is left after an approach, and the next one: the median of all approaches on \
         one thread, what 90 % stay below, and the slowest."
            .to_owned(),
    ]);
    let parts = library(settings.seed, LIBRARY);
    for is_known in [true, false] {
        let of = |case| trial(settings.seed, case, &parts, is_known);
        let trials = of_each_in_order(settings.cases, settings.jobs(), of, |_| ());
        let (name, good) = if is_known { ("in the library", Ending::Right) } else { ("not in it", Ending::NoPose) };
        for (case, trial) in trials.iter().enumerate().filter(|(_, trial)| trial.ending != good) {
            table.failures.push(format!("{name}, case {case}: {}", trial.said));
        }
        table.push(row(name, good, &trials));
    }
    table
}

fn row(name: &str, good: Ending, trials: &[Trial]) -> Vec<Cell> {
    let share =
        |of: &dyn Fn(&Trial) -> bool| Cell::share(trials.iter().filter(|trial| of(trial)).count(), trials.len());
    let number = |value: Option<f64>, decimals: usize| Cell::number(value.unwrap_or(f64::NAN), decimals);
    let touches = || trials.iter().map(|trial| trial.touches as f64);
    let answers = || trials.iter().flat_map(|trial| trial.answers.iter().copied());
    vec![
        name.into(),
        Cell::count(trials.len()),
        share(&|trial| trial.ending == good),
        share(&|trial| trial.ending != good && trial.ending != Ending::GivenUp),
        share(&|trial| trial.ending == Ending::GivenUp),
        number(median(touches()), 0),
        number(percentile(touches(), 90), 0),
        number(median(trials.iter().map(|trial| trial.approaches as f64)), 0),
        number(median(answers()), 2),
        number(percentile(answers(), 90), 2),
        Cell::number(answers().fold(0.0, f64::max), 2),
    ]
}

fn library(seed: u64, count: usize) -> Vec<SimplePolygon> {
    (0..count).map(|number| random_part(&mut Draw::case(seed ^ LIBRARY_SEED, number)).polygon().clone()).collect()
}

fn trial(seed: u64, case: usize, parts: &[SimplePolygon], is_known: bool) -> Trial {
    let mut draw = Draw::case(seed, case);
    let number = draw.index(parts.len());
    let stranger = random_part(&mut draw).polygon().clone();
    let outline = if is_known { &parts[number] } else { &stranger };
    let mut world = placed(outline, PLANNED_ROBOT_MM, &mut draw);
    let speed = safe_speed(outline);
    let begun = ProcessorTime::now();
    let mut search = PartsSearch::new(parts, RADIUS, area(), TouchTolerance::default());
    let mut next = search.next();
    let mut answers = vec![begun.seconds()];
    let mut touches = 0;
    let (ending, said) = loop {
        let found = |left: &PartLeft| {
            let poses: Vec<_> = left.modes.iter().map(|mode| mode.pose).collect();
            if is_known && left.part == number {
                judged(outline, &poses, &world.pose, Ending::Right)
            } else {
                Ending::Wrong
            }
        };
        match (search.verdict(), &next) {
            (PartsVerdict::One(left), _) => break (found(&left), format!("part {}, and it is {number}", left.part)),
            (PartsVerdict::Alike(all), _) => {
                let is_right = all.iter().any(|left| found(left) == Ending::Right);
                break (if is_right { Ending::Right } else { Ending::Wrong }, "parts that are alike".to_owned());
            }
            (PartsVerdict::NoneOfThese, _) => break (Ending::NoPose, "none of these".to_owned()),
            (PartsVerdict::Open(_), Some(planned)) if answers.len() <= APPROACHES_MAX => {
                let approach = planned.approach;
                let Ok(met) = world.make(&approach, speed, &mut draw) else {
                    break (Ending::GivenUp, "the part cannot be touched".to_owned());
                };
                touches += usize::from(matches!(met, Met::Part(_)));
                let begun = ProcessorTime::now();
                search.take(&approach, &widened(met));
                next = search.next();
                answers.push(begun.seconds());
            }
            (PartsVerdict::Open(_), _) => break (Ending::GivenUp, format!("{} parts left", search.parts_left())),
        }
    };
    Trial { ending, said, touches, approaches: answers.len() - 1, answers }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_of_a_library_is_named_and_a_stranger_is_none_of_it() {
        let parts = library(1, 12);
        for (is_known, good) in [(true, Ending::Right), (false, Ending::NoPose)] {
            let trials: Vec<_> = (0..3).map(|case| trial(1, case, &parts, is_known)).collect();
            for (case, trial) in trials.iter().enumerate() {
                assert_eq!(trial.ending, good, "{is_known}, case {case}: {}", trial.said);
            }
        }
    }
}
