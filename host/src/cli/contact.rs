//! `palpate contact`.

use std::process::ExitCode;

/// Reads force recordings and says when, where and how hard the finger was touched.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {}

pub(crate) fn run(_arguments: &Arguments) -> miette::Result<ExitCode> {
    Err(miette::miette!("not built yet"))
}
