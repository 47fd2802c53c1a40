//! How a long search is ended before it is complete.
//!
//! A search of this library knows no clock: whoever calls it says when to stop. It asks now and then, every few
//! milliseconds, and then ends with what it has found so far, which [`Searched::complete`] tells from all there is.

use std::cell::Cell;

/// Asked now and then by a long search: whether to end.
pub type Stop<'a> = &'a dyn Fn() -> bool;

/// The wish of somebody who waits until a search is complete.
///
/// ```
/// assert!(!palpate::never());
/// ```
#[must_use]
pub fn never() -> bool {
    false
}

/// What a search found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Searched<T> {
    /// All that there is to find if the search is complete; otherwise what had been found, of which nothing follows
    /// about the rest.
    pub found: T,
    /// Whether the search came to its own end. Where it did not, nothing is excluded by not being found.
    pub complete: bool,
}

/// A wish to end that is kept once it was uttered.
pub(crate) struct Halt<'a> {
    stop: Stop<'a>,
    halted: Cell<bool>,
}

impl<'a> Halt<'a> {
    pub(crate) fn new(stop: Stop<'a>) -> Self {
        Self { stop, halted: Cell::new(false) }
    }

    /// Asks whether to end now; once it is so, it stays so.
    pub(crate) fn is_wished(&self) -> bool {
        if !self.halted.get() && (self.stop)() {
            self.halted.set(true);
        }
        self.halted.get()
    }

    /// What was found, with whether anything was left out.
    pub(crate) fn searched<T>(&self, found: T) -> Searched<T> {
        Searched { found, complete: !self.halted.get() }
    }
}

impl std::fmt::Debug for Halt<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Halt").field("halted", &self.halted).finish_non_exhaustive()
    }
}
