//! What a person at a terminal sees while nothing is printed yet: what is being done, how long already, how far.
//!
//! One line on standard error, from [`APPEARS_AFTER`] on, which is taken away before anything else is written to a terminal.
//! Silent where standard error is no terminal, with `--quiet`, and below a full screen.
//!
//! Units: s, of the wall's clock. Errors: none; what cannot be written is not told.

use std::io::{self, IsTerminal as _};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::messages;

/// What takes no longer speaks for itself.
const APPEARS_AFTER: Duration = Duration::from_secs(2);

/// How often the line is drawn anew.
const DRAWN_EVERY: Duration = Duration::from_millis(200);

/// How long something is done already, and how far it is.
const SINCE: &str = "{spinner} {msg}: {elapsed}";
const HOW_FAR: &str = "{spinner} {msg}: {wide_bar} {pos} of {len} in {elapsed}, {eta} to go";

/// The line that is on the terminal, or will be.
static LINE: Mutex<Option<ProgressBar>> = Mutex::new(None);

fn line() -> MutexGuard<'static, Option<ProgressBar>> {
    LINE.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Something that may take long; it is done when this is dropped.
#[derive(Debug)]
#[must_use = "it is done when this is dropped"]
pub(crate) struct Progress {
    /// Hangs up when it is done.
    done: Option<Sender<()>>,
    waits: Option<JoinHandle<()>>,
}

impl Progress {
    /// Something begins. Within something else that is shown already it only says [`what`](says) is done.
    pub(crate) fn begin(what: &str) -> Self {
        let mut line = line();
        if line.is_some() || !io::stderr().is_terminal() || !messages::notes_wanted() {
            return Self { done: None, waits: None };
        }
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::hidden());
        bar.set_style(style(SINCE));
        bar.set_message(what.to_owned());
        *line = Some(bar.clone());
        let (done, is_done) = mpsc::channel();
        let appears = move || {
            if matches!(is_done.recv_timeout(APPEARS_AFTER), Err(RecvTimeoutError::Timeout)) && !messages::is_held() {
                bar.set_draw_target(ProgressDrawTarget::stderr());
                bar.enable_steady_tick(DRAWN_EVERY);
            }
        };
        let waits = std::thread::Builder::new().name("progress".to_owned()).spawn(appears).ok();
        Self { done: Some(done), waits }
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        if let Some(done) = self.done.take() {
            drop(done);
            if let Some(waits) = self.waits.take() {
                // A thread that crashed has nothing more to show.
                let _ = waits.join();
            }
            if let Some(bar) = line().take() {
                bar.finish_and_clear();
            }
        }
    }
}

fn style(template: &str) -> ProgressStyle {
    // Only a template that is wrong fails, and these are tested.
    ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_spinner())
}

/// Says what is being done now.
pub(crate) fn says(what: String) {
    if let Some(bar) = line().as_ref() {
        if bar.length().is_some() {
            bar.unset_length();
            bar.set_style(style(SINCE));
        }
        bar.set_message(what);
    }
}

/// Says how far it is: so many of so many, of what `what` counts.
pub(crate) fn reached(done: u64, of: u64, what: &str) {
    let Some(bar) = line().clone() else { return };
    if bar.length() != Some(of) {
        bar.set_style(style(HOW_FAR));
        bar.set_length(of);
        bar.reset_eta();
    }
    bar.set_message(what.to_owned());
    bar.set_position(done);
}

/// Writes to what may be the terminal, while the line is away.
pub(crate) fn apart<R>(write: impl FnOnce() -> R) -> R {
    let bar = line().clone();
    match bar {
        Some(bar) if !bar.is_hidden() => bar.suspend(write),
        _ => write(),
    }
}

/// Takes the line away for good: the process ends.
pub(crate) fn clear() {
    if let Some(bar) = line().take() {
        bar.finish_and_clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_terminal_nothing_is_begun_and_nothing_in_the_way() {
        // Tests have a terminal or not: either way what is done goes on.
        let outer = Progress::begin("searching");
        let inner = Progress::begin("searching within");
        assert!(inner.done.is_none(), "one line at a time");
        says("something else".to_owned());
        reached(1, 2, "cases");
        assert_eq!(apart(|| 7), 7);
        drop(inner);
        drop(outer);
        assert!(line().is_none());
    }

    #[test]
    fn the_templates_are_understood() {
        for template in [SINCE, HOW_FAR] {
            assert!(ProgressStyle::with_template(template).is_ok(), "{template}");
        }
    }
}
