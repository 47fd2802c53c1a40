//! Files that commands take, read whole and understood.

use std::error::Error;
use std::fmt::Display;
use std::fs;
use std::io::Read as _;
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
    let text = read_text(path).wrap_err_with(cannot)?;
    parse(&text).advised().wrap_err_with(cannot)
}

/// Longest file read, in bytes: some twenty minutes of forces at 4 kHz.
const FILE_BYTES_MAX: u64 = 256 << 20;

/// The text of a file without its byte-order mark.
pub(super) fn read_text(path: &Path) -> miette::Result<String> {
    let mut text = String::new();
    let file = fs::File::open(path).into_diagnostic()?;
    file.take(FILE_BYTES_MAX + 1).read_to_string(&mut text).into_diagnostic()?;
    if text.len() as u64 > FILE_BYTES_MAX {
        let help = "give a shorter recording, or the right file";
        return Err(miette::miette!(help = help, "it is longer than {} MiB", FILE_BYTES_MAX >> 20));
    }
    if text.starts_with(BYTE_ORDER_MARK) {
        text.drain(..BYTE_ORDER_MARK.len_utf8());
    }
    Ok(text)
}

/// What some programs write before the text.
const BYTE_ORDER_MARK: char = '\u{feff}';

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_order_mark_is_no_text_and_an_endless_file_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        fs::write(&path, "\u{feff}t,Fx,Fy\n").unwrap();
        assert_eq!(read_text(&path).unwrap(), "t,Fx,Fy\n");
        #[cfg(target_os = "linux")]
        assert!(read_text(Path::new("/dev/zero")).unwrap_err().to_string().contains("longer than 256 MiB"));
    }
}
