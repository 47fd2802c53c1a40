//! `palpate report`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_files::mcap::McapError;
use palpate_files::output;

use crate::recording::kept::Kept;
use crate::report::{BEGINS, page};

/// Puts a recorded run on one page: force, contact and pose over time, numbers, what was told.
///
/// The page is HTML with its figures in it, needs nothing else and no network, and is made to be printed. Forces of every block
/// are shown as how far they reach where there are too many to draw.
///
/// Exit status: 0, 1 if the recording cannot be read or the page not be written, 2 if the recording is damaged and the page
/// shows what comes before the damage, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The recording
    #[arg(value_name = "RUN.mcap")]
    run: PathBuf,

    /// The page; only one of these is written anew [default: RUN.html]
    #[arg(long, short = 'o', value_name = "FILE.html")]
    out: Option<PathBuf>,
}

/// Exit status where the recording is damaged.
const EXIT_DAMAGED: u8 = 2;

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let path = &arguments.run;
    let kept = Kept::read(path)
        .map_err(|error| match error {
            McapError::NotMcap => {
                miette::miette!(help = "give a file that --record or `palpate record` wrote", "{error}")
            }
            _ => miette::miette!("{error}"),
        })
        .wrap_err_with(|| format!("cannot report on {}", path.display()))?;
    let out = arguments.out.clone().unwrap_or_else(|| path.with_extension("html"));
    let cannot = || format!("cannot write {}", out.display());
    check_replaceable(&out).wrap_err_with(cannot)?;
    output::replace(&out, page(path, &kept).as_bytes()).into_diagnostic().wrap_err_with(cannot)?;
    note!("written to {}", out.display());
    Ok(match kept.damage {
        Some(damage) => {
            tracing::warn!("{}: {damage}; the page shows what comes before", path.display());
            ExitCode::from(EXIT_DAMAGED)
        }
        None => ExitCode::SUCCESS,
    })
}

/// A report may be written anew; any other file is somebody's.
fn check_replaceable(path: &Path) -> miette::Result<()> {
    match fs::read(path) {
        Ok(there) if !there.is_empty() && !there.starts_with(BEGINS.as_bytes()) => {
            Err(miette::miette!(help = "choose another name with -o", "it is there and is no report"))
        }
        _ => Ok(()),
    }
}
