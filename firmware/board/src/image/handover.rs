//! Gives an interrupt what it owns from then on.

use core::cell::RefCell;

use critical_section::Mutex;

/// A place where start-up leaves something for an interrupt to fetch, once.
pub(super) struct Handover<T: 'static>(Mutex<RefCell<Option<T>>>);

impl<T: Send> Handover<T> {
    /// A place where nothing is yet.
    pub(super) const fn new() -> Self {
        Self(Mutex::new(RefCell::new(None)))
    }

    /// Leaves something; before the interrupt is enabled.
    pub(super) fn leave(&self, owned: T) {
        critical_section::with(|token| self.0.borrow(token).replace(Some(owned)));
    }

    /// Fetches it; the interrupt keeps it in a variable of its own.
    pub(super) fn fetch(&self) -> Option<T> {
        critical_section::with(|token| self.0.borrow(token).take())
    }
}
