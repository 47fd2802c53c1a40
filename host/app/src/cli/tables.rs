//! `palpate tables`.

use std::fs;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _, miette};
use serde_json::json;

use super::plot::draw_to;
use super::read::report_problems;
use crate::pictures::plot::Figure;
use crate::thesis::real::{self, Recordings, Seeds};
use crate::thesis::{self, EXPERIMENTS, Experiment, ILLUSTRATIONS, Illustration, TableSettings, progress};
use crate::width::folded;

/// Most cases of a row: beyond it only mistakes are asked for.
const CASES_MAX: u64 = 10_000_000;

/// Runs the thesis's experiments again and prints its numbers beside ours.
///
/// Without a name it lists the experiments. Some take minutes, a few hours: rows are named on standard error as they
/// are done, and how long the one under way will take. `real DIR...` judges the estimator of slow pushes by recordings:
/// folders of pushing logs, named after the part's feet (`x1_x2_x3_y1_y2_y3` in mm) or `patch`.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Tables to run: numbers of the thesis's tables, or names from the list; or `real` and folders of recordings
    #[arg(value_name = "NAME")]
    names: Vec<String>,
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
    /// With figures and the tables that have some: draw them into this folder
    #[arg(long, value_name = "DIR")]
    plot: Option<PathBuf>,
    /// List all tables and figures with their chapters and cases
    #[arg(long)]
    list: bool,
}

/// The tables that have figures.
const FIGURES: [&str; 4] = ["6", "basin", "finger-shapes", "observability"];

/// The table that is made of recordings.
const REAL: &str = "real";

/// Of figures that are computed by themselves, all at once.
const ALL_FIGURES: &str = "figures";

/// Computes one figure of the thesis, prints what it shows, and draws it where that is asked for.
fn illustrate(arguments: &Arguments, illustration: &Illustration) -> miette::Result<()> {
    let cases = arguments.cases.map_or(Ok(illustration.cases), usize::try_from);
    let cases = cases.map_err(|_| miette!("--cases is too large for this machine"))?;
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
    arguments.check_figures()?;
    if let Some((REAL, folders)) = arguments.names.split_first().map(|(first, rest)| (first.as_str(), rest)) {
        return real(arguments, folders);
    }
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
        progress::begin(experiment.name, settings.cases);
        let table = (experiment.run)(&settings);
        progress::end();
        if arguments.json {
            let object =
                json!({"table": experiment.name, "title": experiment.title, "seed": arguments.seed, "result": table});
            say!("{}", serde_json::to_string(&object).into_diagnostic()?);
        } else {
            say!("Table {}: {}\n{table}", experiment.name, experiment.title);
        }
        if let (Some(folder), Some(figures)) = (&arguments.plot, thesis::figures(experiment, &settings)) {
            draw(folder, &figures)?;
        }
    }
    Ok(ExitCode::SUCCESS)
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
    let jobs = arguments.jobs.or(std::thread::available_parallelism().ok()).unwrap_or(NonZeroUsize::MIN);
    let seeds = Seeds { first: arguments.seed, count: usize::from(arguments.seeds) };
    progress::begin(REAL, recordings.units(seeds));
    let answers = recordings.answers(seeds, jobs, |answers| {
        for line in answers.iter().filter(|_| arguments.json).filter_map(|answer| serde_json::to_string(answer).ok()) {
            say!("{line}");
        }
    });
    progress::end();
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
        let help = "those with figures are 6, basin, finger-shapes and observability; a figure by itself: palpate tables figure-2.4 --plot DIR";
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
const NAMES: usize = 15;

fn list() {
    let entry = |name: &str, title: &str, cases: usize| {
        let chapter = thesis::chapter(name).map_or_else(String::new, |chapter| format!("chapter {chapter}, "));
        let counted = if cases == 1 { "1 case".to_owned() } else { format!("{cases} cases") };
        // The names' column; what a title goes on with stands beside it.
        let title = folded(&format!("{:NAMES$}{title} ({chapter}{counted})", ""));
        say!("{name:<NAMES$}{}", title.trim_start());
    };
    EXPERIMENTS.iter().for_each(|experiment| entry(experiment.name, experiment.title, experiment.cases));
    ILLUSTRATIONS.iter().for_each(|one| entry(one.name, one.title, one.cases));
    say!("{ALL_FIGURES:<NAMES$}all of these figures");
    say!("{REAL:<NAMES$}recorded slow pushes: where the part is, blind (real DIR...)");
}
