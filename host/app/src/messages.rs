//! What the tool tells a person beside its answers: warnings, and more or less than those if asked.
//!
//! Everything here goes to standard error; standard output belongs to the answers. `-v` and `-q` decide how much is
//! told, then the variable `RUST_LOG`, else warnings and errors are. Errors: none. What cannot be written is not told.

use std::collections::VecDeque;
use std::env;
use std::fmt;
use std::io::{self, IsTerminal as _, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

use tracing::level_filters::LevelFilter;
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::format::Writer;
use tracing_subscriber::fmt::{FmtContext, FormatEvent, FormatFields};
use tracing_subscriber::registry::LookupSpan;

use crate::progress;

/// Levels for each part of the program, as `tracing` and `env_logger` read them: `debug`, `palpate_device=trace,warn`.
const FILTER_VARIABLE: &str = "RUST_LOG";

/// Lines that are held back while a screen stands where they would be written; none where they are written at once.
static HELD: Mutex<Option<VecDeque<String>>> = Mutex::new(None);

/// Most lines held back: the oldest go first, as they would from a terminal.
const HELD_MAX: usize = 200;

/// Whether notes are left out; see [`notes_wanted`].
static QUIET: AtomicBool = AtomicBool::new(false);

/// How much a person wants to be told.
#[derive(Clone, Copy, Debug, Default, clap::Args)]
pub(crate) struct Loudness {
    /// Tell more on standard error: -v what happens, -vv how, -vvv everything
    #[arg(long, short, global = true, action = clap::ArgAction::Count, conflicts_with = "quiet")]
    #[arg(help_heading = "Messages", display_order = 1000)]
    verbose: u8,

    /// Tell nothing on standard error but errors
    #[arg(long, short, global = true, help_heading = "Messages", display_order = 1001)]
    quiet: bool,
}

impl Loudness {
    /// The level that was asked for on the command line; `None` if nothing was said of it.
    fn level(self) -> Option<LevelFilter> {
        match (self.quiet, self.verbose) {
            (true, _) => Some(LevelFilter::ERROR),
            (false, 0) => None,
            (false, 1) => Some(LevelFilter::INFO),
            (false, 2) => Some(LevelFilter::DEBUG),
            (false, _) => Some(LevelFilter::TRACE),
        }
    }
}

/// Has warnings and the like written to standard error from now on. Only the first call in a process decides which;
/// every call decides about notes.
pub(crate) fn listen(loudness: Loudness) {
    QUIET.store(loudness.quiet, Ordering::Relaxed);
    let told = env::var(FILTER_VARIABLE).unwrap_or_default();
    let (filter, unreadable) = filter(loudness, &told);
    let colours = io::stderr().is_terminal() && env::var_os("NO_COLOR").is_none_or(|set| set.is_empty());
    let subscriber = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(|| StandardError)
        .with_ansi(colours)
        // Otherwise a standard error that nobody reads any more would end the program.
        .log_internal_errors(false)
        .event_format(Plain)
        .finish();
    // A program that calls the tool may have a subscriber of its own, or have called it before.
    let _ = tracing::subscriber::set_global_default(subscriber);
    if let Some(error) = unreadable {
        tracing::warn!("{FILTER_VARIABLE}={told} cannot be read ({error}); warnings and errors are told");
    }
}

/// Whether a person wants to read notes: where a picture went, that the finger is being tared.
pub(crate) fn notes_wanted() -> bool {
    !QUIET.load(Ordering::Relaxed)
}

fn held_lines() -> MutexGuard<'static, Option<VecDeque<String>>> {
    HELD.lock().unwrap_or_else(PoisonError::into_inner)
}

/// From now on nothing is written to standard error: a screen is where it would show.
pub(crate) fn hold() {
    held_lines().get_or_insert_default();
}

/// Writes what was held back, and from now on everything at once.
pub(crate) fn release() {
    let lines = held_lines().take();
    for line in lines.into_iter().flatten() {
        // Whether or not anybody reads it.
        let _ = writeln!(io::stderr(), "{line}");
    }
}

/// Whether lines are held back.
pub(crate) fn is_held() -> bool {
    held_lines().is_some()
}

/// The last so many lines that are held back, the newest at the end.
pub(crate) fn held(count: usize) -> Vec<String> {
    let held = held_lines();
    let lines = held.iter().flatten();
    let all = lines.clone().count();
    lines.skip(all.saturating_sub(count)).cloned().collect()
}

/// Tells a person a line, where notes are wanted.
pub(crate) fn note(text: fmt::Arguments<'_>) {
    if notes_wanted() {
        // Whether or not anybody reads it.
        let _ = writeln!(StandardError, "{text}");
    }
}

/// Standard error, or the lines that are held back in its place.
struct StandardError;

impl Write for StandardError {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.write_all(bytes).map(|()| bytes.len())
    }

    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        let mut held = held_lines();
        let Some(lines) = held.as_mut() else {
            drop(held);
            return progress::apart(|| io::stderr().write_all(bytes));
        };
        let text = String::from_utf8_lossy(bytes);
        lines.extend(text.lines().map(without_colours));
        lines.drain(..lines.len().saturating_sub(HELD_MAX));
        Ok(())
    }

    /// As one piece: what is written to a terminal or held back is a line.
    fn write_fmt(&mut self, text: fmt::Arguments<'_>) -> io::Result<()> {
        self.write_all(text.to_string().as_bytes())
    }

    fn flush(&mut self) -> io::Result<()> {
        io::stderr().flush()
    }
}

/// A line without the sequences that set a terminal's colours.
fn without_colours(line: &str) -> String {
    let mut pieces = line.split("\u{1b}[");
    let first = pieces.next().unwrap_or_default().to_owned();
    pieces.fold(first, |text, piece| text + piece.split_once('m').map_or(piece, |(_, rest)| rest))
}

/// What is to be told, and what is wrong with the variable if it cannot be read.
fn filter(loudness: Loudness, variable: &str) -> (EnvFilter, Option<String>) {
    let by_default = |level: LevelFilter| EnvFilter::builder().with_default_directive(level.into());
    if let Some(level) = loudness.level() {
        return (by_default(level).parse_lossy(""), None);
    }
    match by_default(LevelFilter::WARN).parse(variable) {
        Ok(filter) => (filter, None),
        Err(error) => (by_default(LevelFilter::WARN).parse_lossy(""), Some(error.to_string())),
    }
}

/// One line for an event, as compilers and other tools write it: `warning: what is the matter`. What is of use to
/// programmers only also says where it comes from.
struct Plain;

impl<S, N> FormatEvent<S, N> for Plain
where
    S: Subscriber + for<'a> LookupSpan<'a>,
    N: for<'a> FormatFields<'a> + 'static,
{
    fn format_event(&self, context: &FmtContext<'_, S, N>, mut to: Writer<'_>, event: &Event<'_>) -> fmt::Result {
        let level = *event.metadata().level();
        let (word, colour) = word_and_colour(level);
        match to.has_ansi_escapes() {
            true => write!(to, "\u{1b}[1;{colour}m{word}\u{1b}[0m: ")?,
            false => write!(to, "{word}: ")?,
        }
        if level > Level::INFO {
            write!(to, "{}: ", event.metadata().target())?;
        }
        context.field_format().format_fields(to.by_ref(), event)?;
        writeln!(to)
    }
}

/// A level's name for people, and its colour on a terminal (ECMA-48, "select graphic rendition").
fn word_and_colour(level: Level) -> (&'static str, u8) {
    match level {
        Level::ERROR => ("error", 31),
        Level::WARN => ("warning", 33),
        Level::INFO => ("info", 32),
        Level::DEBUG => ("debug", 34),
        Level::TRACE => ("trace", 35),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn loudness(verbose: u8, quiet: bool) -> Loudness {
        Loudness { verbose, quiet }
    }

    fn told(loudness: Loudness, variable: &str) -> String {
        filter(loudness, variable).0.to_string()
    }

    #[test]
    fn warnings_are_told_unless_the_command_line_or_else_the_environment_says_otherwise() {
        assert_eq!(told(Loudness::default(), ""), "warn");
        assert_eq!(told(Loudness::default(), "debug"), "debug");
        assert_eq!(told(Loudness::default(), "palpate_device=trace"), "palpate_device=trace");
        assert_eq!(told(loudness(0, true), "debug"), "error");
        let louder = [1, 2, 3, 9].map(|times| told(loudness(times, false), "error"));
        assert_eq!(louder, ["info", "debug", "trace", "trace"]);
    }

    #[test]
    fn lines_without_their_colours_are_what_was_to_be_read() {
        assert_eq!(without_colours("\u{1b}[1;33mwarning\u{1b}[0m: a [b] m"), "warning: a [b] m");
    }

    #[test]
    fn a_filter_that_cannot_be_read_is_told_and_warnings_still_are() {
        let (filter, unreadable) = filter(Loudness::default(), "palpate=loud");
        assert_eq!(filter.to_string(), "warn");
        assert!(unreadable.is_some());
    }
}
