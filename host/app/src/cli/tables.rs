//! `palpate tables`.

use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use miette::{IntoDiagnostic as _, WrapErr as _, miette};
use serde_json::json;

use super::plot::draw_to;
use super::read::report_problems;
use crate::live::interrupt;
use crate::pictures::plot::Figure;
use crate::progress::Progress;
use crate::thesis::real::{self, Recordings, Seeds};
use crate::thesis::streamed::Streamed;
use crate::thesis::{self, EXPERIMENTS, Experiment, ILLUSTRATIONS, Illustration, Table, TableSettings, progress};
use crate::threads::processors;
use crate::width::folded;

/// Most cases of a row: beyond it only mistakes are asked for.
const CASES_MAX: u64 = 10_000_000;

/// Runs the thesis's experiments again and prints its numbers beside ours.
///
/// Without a name it lists the experiments and how long they take. Rows are printed as they are done; of tables wider than a
/// terminal the first columns, and the others at the end. Ctrl-C ends a table with the rows that are done and exit status 130,
/// `-v` tells on standard error how long each took. `real DIR...` judges the estimator of slow pushes by recordings:
/// folders of pushing logs, named after the part's feet (`x1_x2_x3_y1_y2_y3` in mm) or `patch`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Tables to run: numbers of the thesis's tables, or names from the list; or `real` and folders of recordings
    #[arg(value_name = "NAME")]
    names: Vec<String>,
    /// List the tables and figures with their chapters, and how long they take on one processor with their own numbers of cases
    #[arg(long, conflicts_with_all = ["names", "json", "plot"])]
    list: bool,
    /// Cases of each row [default: the experiment's own]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=CASES_MAX))]
    cases: Option<u64>,
    /// Seed of everything drawn
    #[arg(long, value_name = "SEED", default_value_t = 1, allow_negative_numbers = true)]
    seed: u64,
    /// Print one JSON object a table; of `real`, one a push and task
    #[arg(long)]
    json: bool,
    /// With `real`, `touch` and `chain-masses`: work on so many logs or cases at a time [default: one a processor]
    #[arg(long, value_name = "N")]
    jobs: Option<NonZeroUsize>,
    /// With `real`: draw everything with so many seeds, from --seed on; the table shows the worst
    #[arg(long, value_name = "N", default_value_t = 5, value_parser = clap::value_parser!(u16).range(1..=100))]
    seeds: u16,
    /// With `real`: fit the set-up's constants anew for each log, from the poses in the others
    #[arg(long)]
    leave_one_out: bool,
    /// With figures and the tables that have some: draw them into this folder; with `real`, what is not explained by direction,
    /// place and log, and a blind chain as a film strip
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
}

/// The tables that have figures.
const FIGURES: [&str; 5] = ["6", "basin", "finger-shapes", "observability", "observability-exceptions"];

/// The table that is made of recordings.
const REAL: &str = "real";

/// Of figures that are computed by themselves, all at once.
const ALL_FIGURES: &str = "figures";

/// Computes one figure of the thesis, prints what it shows, and draws it where that is asked for.
fn illustrate(arguments: &Arguments, illustration: &Illustration) -> miette::Result<()> {
    let cases = arguments.cases.map_or(Ok(illustration.cases), usize::try_from);
    let cases = cases.map_err(|_| miette!("--cases is too large for this machine"))?;
    let _shown = Progress::begin(&format!("computing {}", illustration.name));
    let (table, figure) = (illustration.make)(&TableSettings { cases, seed: arguments.seed, jobs: arguments.jobs });
    let Illustration { name, title, .. } = illustration;
    if arguments.json {
        let object = json!({"table": name, "title": title, "seed": arguments.seed, "result": table});
        say!("{}", serde_json::to_string(&object).into_diagnostic()?);
    } else {
        say!("{}", folded(&format!("Figure {}: {title}", name.trim_start_matches("figure-"))));
        say!("{table}");
    }
    arguments.plot.as_ref().map_or(Ok(()), |folder| draw(folder, &[((*name).to_owned(), figure)]))
}

fn experiment(name: &str) -> miette::Result<&'static Experiment> {
    let names = || EXPERIMENTS.iter().map(|experiment| experiment.name).chain([REAL]).collect::<Vec<_>>().join(", ");
    thesis::find(name).ok_or_else(|| miette!("there is no table `{name}`; known: {}", names()))
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    if let Some((REAL, folders)) = arguments.names.split_first().map(|(first, rest)| (first.as_str(), rest)) {
        return real(arguments, folders);
    }
    arguments.check_figures()?;
    if arguments.names.is_empty() || arguments.list {
        list();
        return Ok(ExitCode::SUCCESS);
    }
    if let Some(illustrations) = arguments.illustrations() {
        return illustrations.into_iter().try_for_each(|one| illustrate(arguments, one)).map(|()| ExitCode::SUCCESS);
    }
    let experiments = arguments.names.iter().map(|name| experiment(name)).collect::<miette::Result<Vec<_>>>()?;
    for experiment in experiments {
        let settings = arguments.settings(experiment)?;
        arguments.make(experiment, &settings)?;
        if let (Some(folder), Some(figures)) = (&arguments.plot, thesis::figures(experiment, &settings)) {
            draw(folder, &figures)?;
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// What is printed of a table, by whoever is first: the table when it is done, or an interruption.
type Printed = Arc<Mutex<Streamed>>;

fn locked(printed: &Printed) -> MutexGuard<'_, Streamed> {
    printed.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Arguments {
    /// Makes a table and prints it: each row as it is done, or one object in the end.
    fn make(&self, experiment: &Experiment, settings: &TableSettings) -> miette::Result<()> {
        let _shown = Progress::begin(&format!("table {}, row 1", experiment.name));
        let printed = Printed::default();
        if !self.json {
            say!("Table {}: {}", experiment.name, experiment.title);
        }
        let (told, is_json) = (Arc::clone(&printed), self.json);
        progress::begin(Box::new(move |table| {
            // An interruption waits until the row is printed.
            let mut told = locked(&told);
            let text = told.rows(table);
            if !is_json {
                super::write_out(format_args!("{text}"));
            }
        }));
        let object = Object { table: experiment.name, title: experiment.title, seed: self.seed };
        let interrupted = Arc::clone(&printed);
        interrupt::end_with(move || {
            let mut printed = locked(&interrupted);
            let Some((rest, rows)) = printed.broken_off() else { return };
            match is_json {
                true => object.say(printed.table(), true),
                false => super::write_out(format_args!("{rest}")),
            }
            eprintln!("interrupted: {} of table {}", super::counted(rows, "finished row"), object.table);
        });
        let table = (experiment.run)(settings);
        progress::end();
        // Whoever interrupts now waits until it is printed.
        let mut printed = locked(&printed);
        interrupt::wish_again();
        let rest = printed.rest(table);
        match self.json {
            true => object.say(printed.table(), false),
            false => say!("{rest}"),
        }
        Ok(())
    }
}

/// A table as one JSON object.
#[derive(Clone, Copy, Debug)]
struct Object {
    table: &'static str,
    title: &'static str,
    seed: u64,
}

impl Object {
    fn say(self, table: &Table, is_interrupted: bool) {
        let Self { table: name, title, seed } = self;
        let mut object = json!({"table": name, "title": title, "seed": seed, "result": table});
        if is_interrupted {
            object["interrupted"] = true.into();
        }
        say!("{object}");
    }
}

fn real(arguments: &Arguments, folders: &[String]) -> miette::Result<ExitCode> {
    let folders: Vec<_> = folders.iter().map(PathBuf::from).collect();
    if folders.is_empty() {
        return Err(miette!(
            help = "name folders of pushing logs, for example: palpate tables real recordings/mlab_point_push",
            "`real` needs recordings"
        ));
    }
    let mut recordings = Recordings::read(&folders).map_err(|error| miette!("{error}"))?;
    if arguments.leave_one_out {
        recordings.leave_one_out();
    }
    report_problems(&folders[0], &recordings.problems);
    let jobs = arguments.jobs.unwrap_or_else(processors);
    let seeds = Seeds { first: arguments.seed, count: usize::from(arguments.seeds) };
    let _shown = Progress::begin("judging the recordings");
    let (units, mut done) = (recordings.units(seeds) as u64, 0);
    let answers = recordings.answers(seeds, jobs, |answers| {
        done += 1;
        crate::progress::reached(done, units, "judging, tasks of logs");
        for line in answers.iter().filter(|_| arguments.json).filter_map(|answer| serde_json::to_string(answer).ok()) {
            say!("{line}");
        }
    });
    if let Some(folder) = &arguments.plot {
        draw(folder, &recordings.figures(&answers))?;
    }
    if !arguments.json {
        say!("{}", real::table(&answers, recordings.names(), &recordings.ablation()));
    }
    Ok(ExitCode::SUCCESS)
}

/// Draws each figure into the folder.
fn draw(folder: &Path, figures: &[(String, Figure)]) -> miette::Result<()> {
    fs::create_dir_all(folder).into_diagnostic().wrap_err_with(|| format!("cannot draw into {}", folder.display()))?;
    figures.iter().try_for_each(|(name, figure)| draw_to(&folder.join(format!("{name}.svg")), figure))
}

impl Arguments {
    /// The figures that are asked for, where nothing else is.
    fn illustrations(&self) -> Option<Vec<&'static Illustration>> {
        if self.names == [ALL_FIGURES] {
            return Some(ILLUSTRATIONS.iter().collect());
        }
        self.names.iter().map(|name| thesis::illustration(name)).collect()
    }

    /// Whether there is a table with figures, where they are asked for.
    fn check_figures(&self) -> miette::Result<()> {
        if self.illustrations().is_some_and(|illustrations| !illustrations.is_empty()) {
            return Ok(());
        }
        let is_without = self.names.iter().find(|name| !FIGURES.contains(&name.as_str()));
        let help = "those with figures are 6, basin, finger-shapes, observability and observability-exceptions; a figure by itself: palpate tables figure-2.4 --plot DIR; of recordings: palpate tables real FOLDER --plot DIR";
        match is_without {
            _ if self.plot.is_none() => Ok(()),
            Some(name) => Err(miette!(help = help, "table {name} has no figures")),
            None if self.names.is_empty() => Err(miette!(help = help, "--plot needs the table that has figures")),
            None => Ok(()),
        }
    }

    fn settings(&self, experiment: &Experiment) -> miette::Result<TableSettings> {
        let cases = self.cases.map(usize::try_from).transpose();
        let cases = cases.map_err(|_| miette!("--cases is too large for this machine"))?.unwrap_or(experiment.cases);
        Ok(TableSettings { cases, seed: self.seed, jobs: self.jobs })
    }
}

/// Width of the column of names, the longest and a gap.
const NAMES: usize = 20;

fn list() {
    let entry = |name: &str, title: &str, cases: usize, seconds: Option<f64>| {
        let chapter = thesis::chapter(name).map_or_else(String::new, |chapter| {
            let part = if chapter.starts_with(|c: char| c.is_ascii_digit()) { "chapter" } else { "appendix" };
            format!("{part} {chapter}, ")
        });
        let counted = if cases == 1 { "1 case".to_owned() } else { format!("{cases} cases") };
        let takes = seconds.map(|seconds| format!(", {}", duration(seconds))).unwrap_or_default();
        // The names' column; what a title goes on with stands beside it.
        let title = folded(&format!("{:NAMES$}{title} ({chapter}{counted}{takes})", ""));
        say!("{name:<NAMES$}{}", title.trim_start());
    };
    for experiment in EXPERIMENTS {
        entry(experiment.name, experiment.title, experiment.cases, experiment.processor_s());
    }
    ILLUSTRATIONS.iter().for_each(|one| entry(one.name, one.title, one.cases, Some(thesis::FIGURE_S)));
    say!("{ALL_FIGURES:<NAMES$}all of these figures");
    say!("{REAL:<NAMES$}recorded slow pushes: where the part is, blind (real DIR...)");
    say!("Times: of one processor, good to a factor of two; on several so much less.");
}

/// A time as a person would say it who knows it to a factor of two.
fn duration(seconds: f64) -> String {
    match seconds {
        _ if seconds < 10.0 => "seconds".to_owned(),
        _ if seconds < 90.0 => format!("{:.0} s", (seconds / 10.0).round() * 10.0),
        _ if seconds < 5400.0 => format!("{:.0} min", seconds / 60.0),
        _ => format!("{:.0} h", seconds / 3600.0),
    }
}
