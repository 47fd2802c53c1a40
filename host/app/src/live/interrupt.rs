//! The wish of the person at the keyboard to stop: Ctrl-C, or a polite kill.
//!
//! Long-running commands look at it between two blocks of samples, so that they end in order: the device is told to
//! stop, the summary is printed, links are removed.

use std::io::Write as _;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, Once, PoisonError};

use crate::progress;
use crate::screen::terminal;

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// What is done when an interruption ends the process; none where it is a wish.
static AT_END: Mutex<Option<Box<dyn FnOnce() + Send>>> = Mutex::new(None);

/// From now on an interruption is a wish that [`requested`] tells, and not the process's immediate end; a second one
/// ends it all the same.
///
/// Where no handler can be installed, an interruption still ends the process at once.
pub fn listen() {
    // A process has one handler; a second command in it uses the first one's.
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        let installed = ctrlc::set_handler(|| {
            let at_end = AT_END.lock().unwrap_or_else(PoisonError::into_inner).take();
            if let Some(at_end) = at_end {
                REQUESTED.store(true, Ordering::Relaxed);
                at_end();
                std::process::exit(INTERRUPTED.into());
            }
            if REQUESTED.swap(true, Ordering::Relaxed) {
                terminal::restore();
                progress::clear();
                std::process::exit(INTERRUPTED.into());
            }
        });
        if let Err(error) = installed {
            tracing::warn!("cannot listen for Ctrl-C ({error}): it will end the program at once, without a summary");
        }
    });
}

/// From now on an interruption says this and ends the process at once, even while it waits for the keyboard.
pub fn end_saying(words: String) {
    end_with(move || {
        // Whether or not anybody reads it.
        let _ = writeln!(std::io::stderr(), "\n{words}");
    });
}

/// From now on an interruption does this, beside whatever is under way, and ends the process; a second one ends it at once.
pub fn end_with(act: impl FnOnce() + Send + 'static) {
    *AT_END.lock().unwrap_or_else(PoisonError::into_inner) = Some(Box::new(act));
    listen();
}

/// From now on an interruption is a wish again.
pub fn wish_again() {
    *AT_END.lock().unwrap_or_else(PoisonError::into_inner) = None;
}

/// Exit status of a process that an interruption ended: what shells give for a signal 2.
pub const INTERRUPTED: u8 = 130;

/// The wish to stop, from somewhere else than a signal.
pub fn request() {
    REQUESTED.store(true, Ordering::Relaxed);
}

/// Whether the user wants the program to stop.
#[must_use]
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
