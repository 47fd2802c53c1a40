//! `palpate solve`.

use std::fs::File;
use std::io::{self, IsTerminal, Read, Write};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::Duration;

use miette::{IntoDiagnostic, WrapErr};
use palpate_files::solve::{self, KINDS, Registry};

use crate::threads::processors;

/// Exit status if some line had an error (fixed by the interface).
const EXIT_SOME_FAILED: u8 = 2;

/// The name of standard input on the command line.
const STANDARD_INPUT: &str = "-";

/// Most jobs accepted: far beyond any processor, and short of what would exhaust the system's threads.
const JOBS_MAX: NonZeroUsize = NonZeroUsize::new(1024).unwrap();

const LONG_HELP: &str = r#"A line that cannot be solved is answered by an error, and the run goes on:
  $ echo '{"problem": "fly", "id": 7}' | palpate solve
  {"id":7,"line":1,"error":{"code":"unknown_problem",
    "message":"`fly` is not ...","field":"/problem"}}
Codes: invalid_json, unknown_problem, invalid_input, time_limit, internal. "line" counts the lines of the input from 1; "field" is
a JSON Pointer to the field, or null.

Exit status: 0 no line had an error, 2 some had, 1 input or output failed, 64 wrong command line."#;

/// Answers machine-readable problems: JSON Lines in, JSON Lines out.
///
/// One problem a line: a JSON object with "problem": KIND, the fields of that kind, and optionally an "id" of any JSON
/// value, which the answer repeats. One answer a line, in the same order, written as soon as it is ready. Blank lines
/// are skipped. Lengths in metres, angles in radians, SI throughout.
#[derive(Debug, clap::Args)]
#[command(after_long_help = long_help())]
pub(crate) struct Arguments {
    /// File of problems; `-` is standard input.
    #[arg(value_name = "FILE", default_value = STANDARD_INPUT)]
    file: PathBuf,

    /// Problems to solve at the same time; default: one for each processor.
    #[arg(long, value_name = "N", value_parser = number_of_jobs)]
    jobs: Option<NonZeroUsize>,

    /// Longest work on a problem that names no `time_limit` of its own. An answer of which the search was broken off says
    /// `"complete": false`.
    #[arg(long, value_name = "SECONDS", value_parser = time_limit, allow_negative_numbers = true)]
    time_limit: Option<Duration>,

    /// Print the JSON Schema of all kinds of problem, or of one, and stop.
    #[arg(long, value_name = "KIND", num_args = 0..=1, value_parser = known_kind, conflicts_with_all = ["file", "jobs", "time_limit"])]
    schema: Option<Option<&'static str>>,
}

fn long_help() -> String {
    let names: Vec<_> = KINDS.names().collect();
    let kinds = if names.is_empty() { "none built in yet".to_owned() } else { names.join(", ") };
    super::help::flowing(&format!("Kinds: {kinds}.\n\n{LONG_HELP}"))
}

fn known_kind(name: &str) -> Result<&'static str, String> {
    KINDS.find(name).map(|kind| kind.name()).ok_or_else(|| KINDS.unknown(name))
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    match arguments.schema {
        Some(kind) => print_schema(kind),
        None => {
            let kinds = arguments.time_limit.map_or(KINDS, |limit| KINDS.with_time_limit(limit));
            answer(kinds, &arguments.file, arguments.jobs.unwrap_or_else(processors))
        }
    }
}

fn number_of_jobs(text: &str) -> Result<NonZeroUsize, String> {
    let jobs = text.parse().map_err(|_| format!("expected a whole number from 1 to {JOBS_MAX}"))?;
    if jobs > JOBS_MAX { Err(format!("expected at most {JOBS_MAX}")) } else { Ok(jobs) }
}

fn time_limit(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().filter(|seconds: &f64| *seconds >= 0.0);
    let seconds = seconds.ok_or("expected seconds, 0 or more")?;
    Ok(Duration::try_from_secs_f64(seconds).unwrap_or(Duration::MAX))
}

fn answer(kinds: Registry, file: &Path, jobs: NonZeroUsize) -> miette::Result<ExitCode> {
    let summary =
        open(file).and_then(|input| solve::run(kinds, jobs, input, &mut io::stdout().lock()).into_diagnostic());
    let summary = summary.wrap_err_with(|| match file == Path::new(STANDARD_INPUT) {
        true => "cannot answer the problems on standard input".to_owned(),
        false => format!("cannot answer the problems in {}", file.display()),
    })?;
    Ok(if summary.failed == 0 { ExitCode::SUCCESS } else { ExitCode::from(EXIT_SOME_FAILED) })
}

fn open(file: &Path) -> miette::Result<Box<dyn Read + Send>> {
    if file != Path::new(STANDARD_INPUT) {
        return Ok(Box::new(File::open(file).into_diagnostic()?));
    }
    if io::stdin().is_terminal() {
        note!("reading problems from the terminal, one JSON object a line; Ctrl-D ends");
    }
    Ok(Box::new(io::stdin()))
}

fn print_schema(kind: Option<&'static str>) -> miette::Result<ExitCode> {
    let schema = match kind.and_then(|name| KINDS.find(name)) {
        Some(kind) => serde_json::to_string_pretty(&kind.schema()),
        None => serde_json::to_string_pretty(&solve::schema::document(&KINDS)),
    };
    let mut text = schema.into_diagnostic()?;
    text.push('\n');
    match io::stdout().write_all(text.as_bytes()) {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(error).into_diagnostic(),
        _ => Ok(ExitCode::SUCCESS),
    }
}
