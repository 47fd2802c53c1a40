//! A panic in a solver ends one line, not the run.

use std::any::Any;
use std::cell::{Cell, RefCell};
use std::panic::{self, AssertUnwindSafe};
use std::sync::Once;

thread_local! {
    /// Whether this thread is inside [`catch`].
    static WATCHED: Cell<bool> = const { Cell::new(false) };
    /// Where the last panic inside [`catch`] came from.
    static PLACE: RefCell<Option<String>> = const { RefCell::new(None) };
}

/// A caught panic.
#[derive(Debug)]
pub(super) struct Caught {
    /// Source file and line.
    pub place: String,
    /// What it said.
    pub message: String,
}

/// Runs `work`; a panic becomes an error and prints nothing. Panics elsewhere are reported as before.
pub(super) fn catch<T>(work: impl FnOnce() -> T) -> Result<T, Caught> {
    stay_quiet_while_watched();
    WATCHED.set(true);
    // `work` only owns what it was given, so nothing half-changed outlives it.
    let result = panic::catch_unwind(AssertUnwindSafe(work));
    WATCHED.set(false);
    result.map_err(|payload| Caught {
        place: PLACE.take().unwrap_or_else(|| "an unknown place".to_owned()),
        message: message_of(payload.as_ref()),
    })
}

/// Puts a hook in front of the one in place, once for the process.
fn stay_quiet_while_watched() {
    static INSTALLED: Once = Once::new();
    INSTALLED.call_once(|| {
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| match WATCHED.get() {
            true => PLACE.set(info.location().map(|at| format!("{}:{}", at.file(), at.line()))),
            false => before(info),
        }));
    });
}

fn message_of(payload: &(dyn Any + Send)) -> String {
    let text = payload.downcast_ref::<&str>().map(|text| (*text).to_owned());
    text.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_is_caught_with_its_place_and_what_it_said() {
        let caught = catch(|| panic!("division of {} by nothing", 7)).unwrap_err();
        assert!(caught.place.contains("panics.rs:"), "{}", caught.place);
        assert_eq!(caught.message, "division of 7 by nothing");
        assert_eq!(catch(|| 3).unwrap(), 3);
    }
}
