//! The thesis's experiments, run again: its numbers beside ours.
//!
//! An experiment draws random problems from a seed, solves them with the library and returns a [`Table`]. To add one:
//! write `fn run(&TableSettings) -> Table` in a module of its own here, describe it by an
//! [`Experiment`] beside it, and list that in [`EXPERIMENTS`]. It says in
//! `definitions` what was drawn and what counts as a success, and lists every case that failed, so that each can be
//! looked at by itself: case `k` of a seed is always the same problem, whatever the number of cases.
//! Only in `chain`, `chain_masses` and `chain_curved` a simulated device runs beside the host, and when it is pushed differs by milliseconds from run to run.
//!
//! The thesis's figures are in `figures`, each with a table of what it shows.
//!
//! By chapter: `inscription` (2), `sampling` (3), `gho` and `initial_pose` (6), `static_contacts` (§6.4), `rolling`
//! (7); beyond the thesis: `pose` and `plan` (`rivals` decides what is ambiguous), `parts`, `chain` (`demonstration`,
//! many times, in the world as it is and in one without the finger's mass), `chain_masses` and `chain_curved`, `carried` (planning and telling parts apart through it), `drawn_pushes`, `drawn_rest` and `drawn_rolls` (is the search to blame?), `invariances`, `touches`, `touch`. `cases` runs
//! them on all processors, `progress` tells how far they are, `streamed` prints rows as they are done, `durations` has how long it takes, `processor_time` measures it, `judged` holds what answers state against the truth.
//!
//! Units: as the columns' headings say. Errors: none, a case that cannot be solved is a row of the count of failures.

mod carried;
mod cases;
pub(crate) mod chain;
mod chain_curved;
mod chain_masses;
pub mod demonstration;
mod drawn_forces;
mod drawn_pushes;
mod drawn_rest;
mod drawn_rolls;
mod durations;
mod explore;
mod figures;
mod finger_shapes;
mod gho;
mod initial_pose;
mod inscription;
mod invariances;
mod judged;
mod observability;
mod parts;
mod plan;
mod pose;
mod processor_time;
pub(crate) mod progress;
mod pushed_parts;
pub(crate) mod real;
mod rivals;
mod rolling;
mod sampling;
pub mod static_contacts;
pub(crate) mod streamed;
mod touch;
mod touched_parts;
mod touches;

use std::fmt;
use std::num::NonZeroUsize;

pub use figures::{FIGURE_S, ILLUSTRATIONS, Illustration, illustration};

use serde::Serialize;
use serde::ser::{SerializeMap, Serializer};

use crate::pictures::plot::Figure;
use crate::threads::processors;
use crate::width::{COLUMNS, folded};

/// The experiments, in the order of the thesis.
pub const EXPERIMENTS: &[Experiment] = &[
    inscription::HALF_PLANES,
    inscription::TWO_CONES,
    inscription::MORE_CONES,
    inscription::WORST_CASE,
    inscription::NOISE,
    touches::EXPERIMENT,
    touch::EXPERIMENT,
    touched_parts::EXPERIMENT,
    explore::EXPERIMENT,
    sampling::SPARSE,
    sampling::DENSE,
    gho::FIGURES,
    gho::KNOWN_EDGE,
    gho::UNKNOWN_EDGE,
    gho::SIDE_BY_SIDE,
    gho::BASIN,
    finger_shapes::EXPERIMENT,
    initial_pose::FRICTIONLESS,
    initial_pose::FRICTION,
    pose::CONTACTS,
    pose::FRICTION,
    pose::FORCES,
    pose::MODEL_ERROR,
    pose::MAGNITUDE,
    drawn_pushes::EXPERIMENT,
    invariances::EXPERIMENT,
    drawn_rest::EXPERIMENT,
    drawn_forces::EXPERIMENT,
    drawn_forces::MODEL_ERROR,
    chain::EXPERIMENT,
    chain::WORLDS,
    chain_masses::EXPERIMENT,
    chain_curved::EXPERIMENT,
    plan::EXPERIMENT,
    carried::PLAN,
    parts::EXPERIMENT,
    carried::PARTS,
    pushed_parts::EXPERIMENT,
    rolling::ATTITUDE,
    rolling::SEMI_AXES,
    rolling::WHICH,
    rolling::GHO,
    observability::PUSHES,
    observability::EXCEPTIONS,
    observability::ROLLS,
    drawn_rolls::EXPERIMENT,
];

/// An experiment that `palpate tables` can run.
#[derive(Clone, Copy, Debug)]
pub struct Experiment {
    /// What it is called on the command line: the number of the thesis's table, or a word.
    pub name: &'static str,
    /// What it shows, one line.
    pub title: &'static str,
    /// Cases of each row unless the person asks for another number.
    pub cases: usize,
    /// Runs all its cases.
    pub run: fn(&TableSettings) -> Table,
}

/// How to run an experiment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableSettings {
    /// Cases of each row.
    pub cases: usize,
    /// Seed of everything drawn.
    pub seed: u64,
    /// Cases at a time; none for one a processor.
    pub jobs: Option<NonZeroUsize>,
}

impl Experiment {
    /// How long it takes with its own number of cases, s of one processor; none where nobody measured.
    #[must_use]
    pub fn processor_s(&self) -> Option<f64> {
        durations::processor_s(self.name)
    }
}

impl TableSettings {
    /// Threads for cases.
    fn jobs(&self) -> NonZeroUsize {
        self.jobs.unwrap_or_else(processors)
    }
}

/// What came of an experiment.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Table {
    /// What was drawn, what was counted as what: a sentence each.
    pub definitions: Vec<String>,
    /// Headings of the columns, with units.
    pub columns: Vec<&'static str>,
    /// As many cells a row as there are columns.
    #[serde(serialize_with = "rows_by_heading")]
    rows: Vec<Row>,
    /// What else stands out: a sentence each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Cases that failed, with their numbers: a sentence each.
    pub failures: Vec<String>,
}

/// One row: cells that know their headings.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    columns: Vec<&'static str>,
    cells: Vec<Cell>,
}

/// What stands at one place of a table.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(untagged)]
pub enum Cell {
    /// Nothing is known or was measured here.
    Empty,
    /// A text, printed as it is.
    Text(String),
    /// A count, printed without decimals.
    Count(u64),
    /// A number, printed with so many decimals.
    Number(#[serde(serialize_with = "number_only")] (f64, usize)),
    /// A share of 1, printed in per cent with one decimal.
    Share(f64),
    /// A share of 1 with the interval that chance allows it, printed in per cent with two decimals.
    Rate {
        /// What was found.
        share: f64,
        /// Least that it may be.
        low: f64,
        /// Most that it may be.
        high: f64,
    },
}

impl Table {
    /// A table without rows.
    #[must_use]
    pub fn new(columns: impl IntoIterator<Item = &'static str>) -> Self {
        Self { columns: columns.into_iter().collect(), ..Self::default() }
    }

    /// Adds a row; cells that are missing at its end are empty.
    pub fn push(&mut self, cells: impl IntoIterator<Item = Cell>) {
        let mut cells: Vec<_> = cells.into_iter().collect();
        cells.resize(self.columns.len(), Cell::Empty);
        self.rows.push(Row { columns: self.columns.clone(), cells });
        progress::row_done(self);
    }

    /// The cells, row by row.
    pub fn rows(&self) -> impl Iterator<Item = &[Cell]> {
        self.rows.iter().map(|row| row.cells.as_slice())
    }
}

impl Cell {
    /// A share `part / whole`; empty where there is no whole.
    #[must_use]
    pub fn share(part: usize, whole: usize) -> Self {
        let share = |part: usize, whole: usize| part as f64 / whole as f64;
        if whole == 0 { Self::Empty } else { Self::Share(share(part, whole)) }
    }

    /// A number with so many decimals.
    #[must_use]
    pub fn number(value: f64, decimals: usize) -> Self {
        Self::Number((value, decimals))
    }

    /// A cell that counts.
    #[must_use]
    pub fn count(count: usize) -> Self {
        Self::Count(count as u64)
    }
}

impl From<&str> for Cell {
    fn from(text: &str) -> Self {
        Self::Text(text.to_owned())
    }
}

impl From<String> for Cell {
    fn from(text: String) -> Self {
        Self::Text(text)
    }
}

impl fmt::Display for Cell {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => f.pad("-"),
            Self::Text(text) => f.pad(text),
            Self::Count(count) => f.pad(&count.to_string()),
            Self::Number((value, decimals)) => {
                let text = format!("{value:.decimals$}");
                // No sign before what is rounded to 0.
                let is_zero = text.chars().all(|c| "-0.".contains(c));
                f.pad(if is_zero { text.trim_start_matches('-') } else { &text })
            }
            Self::Share(share) => f.pad(&format!("{:.1} %", share * 100.0)),
            Self::Rate { share, low, high } => {
                let [share, low, high] = [share, low, high].map(|share| share * 100.0);
                f.pad(&format!("{share:.2} % ({low:.2}-{high:.2})"))
            }
        }
    }
}

/// Definitions, then the aligned rows, then what stands out and what failed. What is wider than a terminal stands in
/// blocks of columns, one below the other, each with the rows' names.
impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for definition in &self.definitions {
            writeln!(f, "{}", folded(definition))?;
        }
        let widths = self.widths();
        for (number, block) in blocks(&widths, 1..widths.len(), COLUMNS).into_iter().enumerate() {
            let gap = if number > 0 { "\n" } else { "" };
            write!(f, "{gap}{}\n{}", line(&self.headings(), &widths, &block), self.lines(0, &widths, &block))?;
        }
        write!(f, "{}", self.sentences())
    }
}

/// What is printed of a table.
impl Table {
    /// Widths of the columns for all that they have.
    fn widths(&self) -> Vec<usize> {
        let width = |column: usize, heading: &str| {
            let cells = self.rows().map(|row| row[column].to_string().chars().count());
            cells.max().unwrap_or(0).max(heading.chars().count())
        };
        self.columns.iter().enumerate().map(|(column, heading)| width(column, heading)).collect()
    }

    fn headings(&self) -> Vec<Cell> {
        self.columns.iter().map(|&heading| Cell::from(heading)).collect()
    }

    /// These columns of the rows from this one on.
    fn lines(&self, from: usize, widths: &[usize], block: &[usize]) -> String {
        self.rows().skip(from).fold(String::new(), |text, row| text + &line(row, widths, block) + "\n")
    }

    /// What stands out, and what failed.
    fn sentences(&self) -> String {
        let failures = self.failures.iter().map(|failure| format!("failed: {failure}"));
        let sentences = self.notes.iter().cloned().chain(failures);
        sentences.fold(String::new(), |text, sentence| text + &folded(&sentence) + "\n")
    }
}

/// Between two columns.
const GAP: &str = "  ";

/// Which of these columns stand beside each other: the first of all in every block, and as many as there is room for.
fn blocks(widths: &[usize], columns: impl Iterator<Item = usize>, room: usize) -> Vec<Vec<usize>> {
    let mut blocks: Vec<Vec<usize>> = vec![(0..widths.len().min(1)).collect()];
    let width = |block: &[usize]| block.iter().map(|&column| widths[column] + GAP.len()).sum::<usize>();
    for column in columns {
        match blocks.last_mut() {
            Some(block) if block.len() < 2 || width(block) + widths[column] <= room => block.push(column),
            _ => blocks.push(vec![0, column]),
        }
    }
    blocks
}

/// The first column names the row and stands left; the others are compared and stand right. A cell that is wider than its
/// column takes what room its neighbours leave.
fn line(cells: &[Cell], widths: &[usize], block: &[usize]) -> String {
    let (mut text, mut used, mut end) = (String::new(), 0, 0);
    for (place, &column) in block.iter().enumerate() {
        let cell = cells[column].to_string();
        let length = cell.chars().count();
        end += widths[column];
        if place > 0 {
            end += GAP.len();
            let gap = end.saturating_sub(used + length).max(GAP.len());
            text += &" ".repeat(gap);
            used += gap;
        }
        text += &cell;
        used += length;
    }
    text
}

/// The experiment of this name.
#[must_use]
pub fn find(name: &str) -> Option<&'static Experiment> {
    EXPERIMENTS.iter().find(|experiment| experiment.name == name)
}

/// The chapter of the thesis, or its appendix, that a table or figure belongs to, by its name or by the question that it
/// answers; none beyond the thesis.
#[must_use]
pub fn chapter(name: &str) -> Option<&str> {
    const QUESTIONS: [(&str, &str); 4] =
        [("observability", "5"), ("observability-exceptions", "5"), ("basin", "6"), ("finger-shapes", "8")];
    if let Some((_, chapter)) = QUESTIONS.iter().find(|(table, _)| *table == name) {
        return Some(chapter);
    }
    let number = name.strip_prefix("figure-").unwrap_or(name);
    let chapter = number.split(['.', '-']).next()?;
    let is_chapter =
        chapter.len() == 1 && chapter.chars().all(|c| ('1'..='8').contains(&c) || ('A'..='E').contains(&c));
    is_chapter.then_some(chapter)
}

/// The figures of an experiment, with their names; none where it has none.
#[must_use]
pub fn figures(experiment: &Experiment, settings: &TableSettings) -> Option<Vec<(String, Figure)>> {
    match experiment.name {
        name if name == gho::FIGURES.name => Some(gho::figures(settings)),
        name if name == gho::BASIN.name => Some(gho::basin_figures(settings)),
        name if name == finger_shapes::EXPERIMENT.name => Some(finger_shapes::figures(settings)),
        name if name == observability::PUSHES.name => Some(observability::figures(settings)),
        name if name == observability::EXCEPTIONS.name => Some(observability::exception_figures(settings)),
        _ => None,
    }
}

/// Rows as JSON objects with the headings as keys.
fn rows_by_heading<S: Serializer>(rows: &[Row], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(rows)
}

impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(Some(self.cells.len()))?;
        for (heading, cell) in self.columns.iter().zip(&self.cells) {
            map.serialize_entry(heading, cell)?;
        }
        map.end()
    }
}

/// Decimals are for people; a program gets the whole number.
fn number_only<S: Serializer>(number: &(f64, usize), serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_f64(number.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table() -> Table {
        let mut table = Table::new(["rows", "share", "time s"]);
        table.definitions.push("What counts.".to_owned());
        table.push(["known edge".into(), Cell::share(1, 3), Cell::number(0.5, 2)]);
        table.push(["ours".into(), Cell::share(0, 0)]);
        table.failures.push("case 7".to_owned());
        table
    }

    #[test]
    fn columns_are_aligned_and_nothing_measured_is_a_dash() {
        let text = table().to_string();
        let expected = "What counts.\n\
                        rows         share  time s\n\
                        known edge  33.3 %    0.50\n\
                        ours             -       -\n\
                        failed: case 7\n";
        assert_eq!(text, expected);
    }

    #[test]
    fn a_wide_table_stands_in_blocks_no_wider_than_a_terminal() {
        let mut table =
            Table::new(["rows", "a heading of thirty columns ..", "another of thirty columns .....", "last one"]);
        table.definitions.push("word ".repeat(40));
        table.push(["some name".into(), Cell::count(1), Cell::count(2), Cell::count(3)]);
        let text = table.to_string();
        assert!(text.lines().all(|line| line.chars().count() <= COLUMNS), "{text}");
        let named = text.lines().filter(|line| line.starts_with("some name")).count();
        assert!(named == 2 && text.ends_with("last one\nsome name         3\n"), "{text}");
    }

    #[test]
    fn a_program_gets_whole_numbers_under_their_headings() {
        let json = serde_json::to_value(table()).unwrap();
        assert_eq!(json["rows"][0]["share"], 1.0 / 3.0);
        assert_eq!(json["rows"][1], serde_json::json!({"rows": "ours", "share": null, "time s": null}));
    }

    #[test]
    fn names_are_unique() {
        let mut names: Vec<_> = EXPERIMENTS.iter().map(|experiment| experiment.name).collect();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), EXPERIMENTS.len());
    }
}
