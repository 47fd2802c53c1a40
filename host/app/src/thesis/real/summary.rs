//! The answers of all seeds as a table: by task, all logs together and each by itself.

use palpate::math::statistics::{median, percentile};

use super::super::{Cell, Table};
use super::Answer;

/// Pushes of a blind chain that do not count: it begins in a box.
const BLIND_FROM: usize = 6;

/// A task, what it is, and what is asked of it on the board and elsewhere.
struct Task {
    name: &'static str,
    bar: &'static str,
}

const TASKS: [Task; 9] = [
    Task { name: "a", bar: "0.68/0.38, 2.0/1.9, 90-99 %, axis 3; 0.80/0.55, 2.6/2.6, 82-99 % a log, axis 3" },
    Task { name: "a_learned", bar: "0.66/0.36; 0.75/0.48" },
    Task { name: "b1", bar: "4.7/2.8, 90-99 %; 4.3/2.5, 90-99 %" },
    Task { name: "b3", bar: "1.6/1.1, 90-99 %; 1.6/1.2, 90-99 %" },
    Task { name: "c1", bar: "88 %, 1200 cells" },
    Task { name: "c2", bar: "88 %, 90 cells" },
    Task { name: "c3", bar: "88 %, 30 cells" },
    Task { name: "c4", bar: "88 %, 15 cells, 2.2/1.8" },
    Task { name: "d", bar: "1.4/0.8, 3.0/2.6, 90-99 %; 1.6/1.1, 4.5/4.5, 90-99 %" },
];

/// Of some answers of one seed.
struct Figures {
    medians: [f64; 2],
    tails: [f64; 2],
    covered: f64,
    semi_axis: f64,
    cells: Option<f64>,
}

impl Figures {
    fn of(answers: &[&Answer]) -> Option<Self> {
        let of_all = |figure: &dyn Fn(&Answer) -> f64| answers.iter().map(|answer| figure(answer)).collect::<Vec<_>>();
        let (place, angle) = (of_all(&|a| a.error[0] * 1e3), of_all(&|a| a.error[1].to_degrees()));
        Some(Self {
            medians: [median(place.iter().copied())?, median(angle.iter().copied())?],
            tails: [percentile(place, 90)?, percentile(angle, 90)?],
            covered: answers.iter().filter(|answer| answer.covered).count() as f64 / answers.len() as f64,
            semi_axis: median(of_all(&|answer| answer.semi_axes[0] * 1e3))?,
            cells: median(answers.iter().filter_map(|answer| answer.cells.map(|cells| cells as f64))),
        })
    }
}

/// The table: of each figure the worst of the seeds; of coverage the least.
pub(crate) fn table<'a>(
    answers: &[Answer],
    logs: impl Iterator<Item = &'a str> + Clone,
    ablation: &[(&'static str, Vec<[f64; 2]>)],
) -> Table {
    let mut table = Table::new([
        "task",
        "log",
        "answers",
        "mm",
        "deg",
        "mm, 90 %",
        "deg, 90 %",
        "covered",
        "semi-axis mm",
        "cells",
        "bar: board; elsewhere",
    ]);
    table.definitions = vec![
        "a: the start pose is given; a_learned: with what earlier pushes of the log taught; b1, b3: a start within 10 mm and 10 degrees, one push, three in a row; c1 to c4: no start, one to four pushes in a row; d: 50 pushes in a row from a start within 10 mm and 10 degrees, blind, from the sixth on.".to_owned(),
        "mm, deg: median error of the centre of mass and of the angle; covered: truths within the stated 95 % region. Of the seeds the worst.".to_owned(),
        "prediction: from the pose before, without any force, and with one thing of the model changed.".to_owned(),
        "semi-axis: of the ellipsoid of the region's volume with as many mm as degrees; cells: 5 mm x 5 mm x 5 degrees, in the 95 % set.".to_owned(),
    ];
    for Task { name, bar } in TASKS {
        for log in std::iter::once(None).chain(logs.clone().map(Some)) {
            let counts = |answer: &&Answer| {
                answer.task == name
                    && log.is_none_or(|log| answer.log == log)
                    && (name != "d" || answer.push >= BLIND_FROM)
            };
            let kept: Vec<_> = answers.iter().filter(counts).collect();
            let mut seeds: Vec<_> = kept.iter().map(|answer| answer.seed).collect();
            seeds.sort_unstable();
            seeds.dedup();
            let of_seed = |seed: &u64| {
                let own: Vec<_> = kept.iter().copied().filter(|answer| answer.seed == *seed).collect();
                Figures::of(&own)
            };
            let figures: Vec<_> = seeds.iter().filter_map(of_seed).collect();
            if figures.is_empty() {
                continue;
            }
            let worst = |figure: &dyn Fn(&Figures) -> f64| figures.iter().map(figure).fold(f64::NEG_INFINITY, f64::max);
            let covered = figures.iter().map(|figures| figures.covered).fold(f64::INFINITY, f64::min);
            let cells = figures.iter().filter_map(|figures| figures.cells).reduce(f64::max);
            table.push([
                Cell::from(name),
                Cell::from(log.unwrap_or("all")),
                Cell::count(kept.len()),
                Cell::number(worst(&|f| f.medians[0]), 2),
                Cell::number(worst(&|f| f.medians[1]), 2),
                Cell::number(worst(&|f| f.tails[0]), 2),
                Cell::number(worst(&|f| f.tails[1]), 2),
                Cell::Share(covered),
                Cell::number(worst(&|f| f.semi_axis), 2),
                cells.map_or(Cell::Empty, |cells| Cell::number(cells, 0)),
                if log.is_none() { Cell::from(bar) } else { Cell::Empty },
            ]);
        }
    }
    for (change, errors) in ablation {
        let of = |part: usize, unit: f64| errors.iter().map(move |error| error[part] * unit);
        let (place, angle) = (|| of(0, 1e3), || of(1, 1.0_f64.to_degrees()));
        let number = |value: Option<f64>| value.map_or(Cell::Empty, |value| Cell::number(value, 2));
        table.push([
            Cell::from("prediction"),
            Cell::from(*change),
            Cell::count(errors.len()),
            number(median(place())),
            number(median(angle())),
            number(percentile(place(), 90)),
            number(percentile(angle(), 90)),
        ]);
    }
    table
}
