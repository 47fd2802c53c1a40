//! The wish of the person at the keyboard to stop: Ctrl-C, or a polite kill.
//!
//! Long-running commands look at it between two blocks of samples, so that they end in order: the device is told to
//! stop, the summary is printed, links are removed.

use std::sync::Once;
use std::sync::atomic::{AtomicBool, Ordering};

static REQUESTED: AtomicBool = AtomicBool::new(false);

/// From now on an interruption is a wish that [`requested`] tells, and not the process's immediate end; a second one
/// ends it all the same.
///
/// Where no handler can be installed, an interruption still ends the process at once.
pub fn listen() {
    // A process has one handler; a second command in it uses the first one's.
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        let installed = ctrlc::set_handler(|| {
            if REQUESTED.swap(true, Ordering::Relaxed) {
                std::process::exit(INTERRUPTED_TWICE);
            }
        });
        if let Err(error) = installed {
            tracing::warn!("cannot listen for Ctrl-C ({error}): it will end the program at once, without a summary");
        }
    });
}

/// Exit status of a process that was interrupted while it was ending: what shells give for a signal 2.
const INTERRUPTED_TWICE: i32 = 130;

/// Whether the user wants the program to stop.
#[must_use]
pub fn requested() -> bool {
    REQUESTED.load(Ordering::Relaxed)
}
