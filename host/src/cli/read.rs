//! Files that commands take, read whole and understood.

use std::error::Error;
use std::fs;
use std::path::Path;

use miette::{IntoDiagnostic as _, WrapErr as _};

/// Reads a file and understands it; what goes wrong is told with the file's name.
pub(super) fn read<T, E>(path: &Path, parse: impl FnOnce(&str) -> Result<T, E>) -> miette::Result<T>
where
    E: Error + Send + Sync + 'static,
{
    let cannot = || format!("cannot use {}", path.display());
    let text = fs::read_to_string(path).into_diagnostic().wrap_err_with(cannot)?;
    parse(&text).into_diagnostic().wrap_err_with(cannot)
}
