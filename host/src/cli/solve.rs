//! `palpate solve`.

use std::process::ExitCode;

/// Answers machine-readable problems: JSON Lines in, JSON Lines out.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {}

pub(crate) fn run(_arguments: &Arguments) -> miette::Result<ExitCode> {
    Err(miette::miette!("not built yet"))
}
