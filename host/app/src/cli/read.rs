//! Files that commands take, read whole and understood.

use std::error::Error;
use std::fmt::Display;
use std::fs;
use std::path::Path;

use miette::{IntoDiagnostic as _, WrapErr as _};

use crate::advice::Advise as _;

/// Most problems of a file that are printed; their number always is.
const PROBLEMS_SHOWN: usize = 10;

/// Prints what of a file was skipped.
pub(super) fn report_problems(path: &Path, problems: &[impl Display]) {
    for problem in problems.iter().take(PROBLEMS_SHOWN) {
        tracing::warn!("{}: {problem}", path.display());
    }
    if problems.len() > PROBLEMS_SHOWN {
        tracing::warn!("{}: … {} problems in all", path.display(), problems.len());
    }
}

/// Reads a file and understands it; what goes wrong is told with the file's name.
pub(super) fn read<T, E>(path: &Path, parse: impl FnOnce(&str) -> Result<T, E>) -> miette::Result<T>
where
    E: Error + Send + Sync + 'static,
{
    let cannot = || format!("cannot use {}", path.display());
    let text = fs::read_to_string(path).into_diagnostic().wrap_err_with(cannot)?;
    parse(&text).advised().wrap_err_with(cannot)
}
