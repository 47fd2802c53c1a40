//! Recordings of force from files.
//!
//! Three formats: [`csv`], any table of time and two force components ([`path`] has places instead), [`stamped`], the same
//! as messages in MCAP files, and [`mlab`], the pushing logs of CMU's
//! Manipulation Lab, with the block's and the fingertip's poses. A [`mapping`] says what is what in the first two. Files come from others, so nothing in one is trusted:
//! what cannot be read is reported with its place and skipped, and the rest is read.
//!
//! [`session`] runs [`palpate::finger::contact`] over what was read, [`friction`] finds what it needs to know of the
//! contact; [`part`] is the outline of what was pushed; [`export`]
//! writes the pushes of a log as tables.
//!
//! Frames: as in the file (`sensor` axes, robot frame = `world`). Units: SI; files' millimetres are converted on
//! reading.
//! Errors: [`ReadError`] for a file that gives nothing at all; [`RecordingProblem`]s for places in one that gives
//! something.

pub mod csv;
pub mod export;
pub mod friction;
pub mod mapping;
pub mod mlab;
pub mod part;
pub mod path;
pub mod session;
pub mod slow_pushes;
pub mod stamped;
pub(crate) mod table;

#[cfg(test)]
pub(crate) mod synthetic;

use std::borrow::Cow;

use serde::Serialize;

/// A place in a file that could not be read, and was skipped.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, thiserror::Error)]
#[error("line {line}{}: {message}", column.map(|c| format!(", column {c}")).unwrap_or_default())]
pub struct RecordingProblem {
    /// Number of the line, from 1.
    pub line: usize,
    /// Field in that line, from 1, where one is to blame.
    pub column: Option<usize>,
    /// What was found and what was expected.
    pub message: String,
}

/// A file that gives nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ReadError {
    /// Not text in UTF-8 or ASCII.
    #[error("this is UTF-16 text or a binary file, not plain text")]
    NotText,
    /// No line holds data.
    #[error("no line holds data")]
    Empty,
    /// The header lacks a column.
    #[error("line {line}: {}", no_column(column, found))]
    NoColumn {
        /// Line of the header, from 1.
        line: usize,
        /// The column looked for.
        column: &'static str,
        /// Its name in a mapping.
        key: &'static str,
        /// The columns there are.
        found: String,
    },
    /// Several columns of the header may be the one looked for.
    #[error("line {line}: several columns may be the {column}: {found}")]
    SeveralColumns {
        /// Line of the header, from 1.
        line: usize,
        /// The column looked for.
        column: &'static str,
        /// Its name in a mapping.
        key: &'static str,
        /// Those that may be it.
        found: String,
    },
    /// A unit in the header is not known.
    #[error("line {line}: `{unit}` is not a unit of {quantity} known here (known: {known})")]
    UnknownUnit {
        /// Line of the header, from 1.
        line: usize,
        /// The unit as found in the header.
        unit: String,
        /// What it is a unit of: time, force, length or acceleration.
        quantity: &'static str,
        /// What would be understood.
        known: &'static str,
    },
    /// Lines were there, but not one could be read.
    #[error("none of the {lines} lines of data could be read; the first: {first}")]
    AllBad {
        /// Lines of data that were tried.
        lines: usize,
        /// What was wrong with the first.
        first: RecordingProblem,
    },
    /// The first line of a pushing log is not the number of pushes.
    #[error("line {line}: expected the number of pushes, found `{found}`")]
    NoCount {
        /// The line, from 1.
        line: usize,
        /// The words that stand in place of a count.
        found: String,
    },
    /// A part's outline cannot be one.
    #[error("the outline of the part cannot be read: {0}")]
    Part(RecordingProblem),
}

fn no_column(column: &str, found: &str) -> String {
    match found {
        "" => format!("there is no header, and no such column for {column}"),
        found => format!("the header has no column for {column} (it has: {found})"),
    }
}

/// The formats that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Format {
    /// A table of `t, Fx, Fy`: see [`csv`].
    Csv,
    /// A log of pushes by CMU's Manipulation Lab: see [`mlab`].
    Mlab,
}

impl Format {
    /// Tells the formats apart: a pushing log starts with a whole number alone on its line and then a line of seven
    /// numbers; everything else is a table.
    #[must_use]
    pub fn detect(text: &str) -> Self {
        let mut lines = text.lines().filter(|line| !line.trim().is_empty());
        let counts = lines.next().is_some_and(|line| line.trim().parse::<usize>().is_ok());
        let pose = lines.next().is_some_and(|line| line.split_whitespace().count() == mlab::POSE_NUMBERS);
        if counts && pose { Self::Mlab } else { Self::Csv }
    }
}

/// The bytes of a file as text: a byte-order mark is skipped, bytes that are not UTF-8 become `�` (and so make the
/// number that they are in a bad one, but no other).
///
/// # Errors
/// [`ReadError::NotText`] for UTF-16 and for bytes with NULs in them.
pub fn text(bytes: &[u8]) -> Result<Cow<'_, str>, ReadError> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    if bytes.contains(&0) || bytes.starts_with(b"\xFF\xFE") || bytes.starts_with(b"\xFE\xFF") {
        return Err(ReadError::NotText);
    }
    Ok(String::from_utf8_lossy(bytes))
}

/// A finite number, or what is wrong with the field.
fn number(field: &str) -> Result<f64, String> {
    match field.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(_) => Err(format!("`{}` is not finite", shorten(field))),
        Err(_) if field.replacen(',', ".", 1).parse::<f64>().is_ok() => {
            Err(format!("`{}` has a decimal comma, where a point is expected", shorten(field)))
        }
        Err(_) if field.is_empty() => Err("the field is empty, where a number is expected".to_owned()),
        Err(_) => Err(format!("`{}` is not a number", shorten(field))),
    }
}

/// Longest part of a file's text that a message repeats.
const QUOTE_CHARS_MAX: usize = 40;

/// The start of a text from a file, for a message.
fn shorten(text: &str) -> String {
    match text.char_indices().nth(QUOTE_CHARS_MAX) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn formats_are_told_apart() {
        assert_eq!(Format::detect("2\n1 2 3 1 0 0 0\n"), Format::Mlab);
        assert_eq!(Format::detect("t,Fx,Fy\n0,1,2\n"), Format::Csv);
        assert_eq!(Format::detect("0 1 2\n0.1 1 2\n"), Format::Csv);
        assert_eq!(Format::detect(""), Format::Csv);
    }

    #[test]
    fn a_byte_order_mark_is_skipped_and_utf_16_refused() {
        assert_eq!(text(b"\xEF\xBB\xBFt").unwrap(), "t");
        assert_eq!(text(b"\xFF\xFEt\0"), Err(ReadError::NotText));
        assert_eq!(text(b"0,1\xFF,2").unwrap(), "0,1\u{FFFD},2");
    }

    #[test]
    fn a_decimal_comma_is_named() {
        assert_eq!(number("0,5").unwrap_err(), "`0,5` has a decimal comma, where a point is expected");
    }

    #[test]
    fn messages_repeat_only_the_start_of_long_texts() {
        assert!(number(&"9x".repeat(1000)).unwrap_err().chars().count() < 80);
    }
}
