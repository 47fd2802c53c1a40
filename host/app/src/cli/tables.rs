//! `palpate tables`.

use std::process::ExitCode;

use miette::{IntoDiagnostic as _, miette};
use serde_json::json;

use crate::thesis::{self, EXPERIMENTS, Experiment, TableSettings, progress};
use crate::width::folded;

/// Most cases of a row: beyond it only mistakes are asked for.
const CASES_MAX: u64 = 10_000_000;

/// Runs the thesis's experiments again and prints its numbers beside ours.
///
/// Without a name it lists the experiments. Some take minutes, a few hours: rows are named on standard error as they
/// are done, and how long the one under way will take.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Tables to run: numbers of the thesis's tables, or names from the list
    #[arg(value_name = "NAME", value_parser = experiment)]
    experiments: Vec<&'static Experiment>,
    /// Cases of each row [default: the experiment's own]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=CASES_MAX))]
    cases: Option<u64>,
    /// Seed of everything drawn
    #[arg(long, value_name = "SEED", default_value_t = 1, allow_negative_numbers = true)]
    seed: u64,
    /// Print one JSON object a table
    #[arg(long)]
    json: bool,
}

fn experiment(name: &str) -> Result<&'static Experiment, String> {
    let names = || EXPERIMENTS.iter().map(|experiment| experiment.name).collect::<Vec<_>>().join(", ");
    thesis::find(name).ok_or_else(|| format!("there is no such table; known: {}", names()))
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    if arguments.experiments.is_empty() {
        list();
    }
    for experiment in &arguments.experiments {
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
    }
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn settings(&self, experiment: &Experiment) -> miette::Result<TableSettings> {
        let cases = self.cases.map(usize::try_from).transpose();
        let cases = cases.map_err(|_| miette!("--cases is too large for this machine"))?.unwrap_or(experiment.cases);
        Ok(TableSettings { cases, seed: self.seed })
    }
}

/// Width of the column of names, the longest and a gap.
const NAMES: usize = 15;

fn list() {
    for Experiment { name, title, cases, .. } in EXPERIMENTS {
        // The names' column; what a title goes on with stands beside it.
        let title = folded(&format!("{:NAMES$}{title} ({cases} cases)", ""));
        say!("{name:<NAMES$}{}", title.trim_start());
    }
}
