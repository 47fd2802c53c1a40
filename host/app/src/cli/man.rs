//! `palpate man`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Command;
use clap_mangen::Man;
use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate_files::output;

/// Writes the manual pages of all commands into a folder, in place of those that are there.
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
    let mut command = super::command().disable_help_subcommand(true);
    command.build();
    write_pages(&command, folder).wrap_err_with(place)?;
    note!("the manual pages are in {}", folder.display());
    Ok(ExitCode::SUCCESS)
}

fn write_pages(command: &Command, folder: &Path) -> miette::Result<()> {
    for below in command.get_subcommands().filter(|below| !below.is_hide_set()) {
        write_pages(below, folder)?;
    }
    let (page, mut bytes) = (Man::new(command.clone()), Vec::new());
    page.render(&mut bytes).into_diagnostic()?;
    output::replace(&folder.join(page.get_filename()), &bytes).into_diagnostic()
}
