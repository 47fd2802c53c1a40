//! `palpate man`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::CommandFactory as _;
use miette::{IntoDiagnostic as _, WrapErr as _};

/// Writes the manual pages of all commands into a folder.
///
/// Example: palpate man ~/.local/share/man/man1
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Folder for the pages; it is made where there is none
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let folder = &arguments.folder;
    let place = || format!("cannot write the manual pages to {}", folder.display());
    std::fs::create_dir_all(folder).into_diagnostic().wrap_err_with(place)?;
    clap_mangen::generate_to(super::Arguments::command(), folder).into_diagnostic().wrap_err_with(place)?;
    note!("the manual pages are in {}", folder.display());
    Ok(ExitCode::SUCCESS)
}
