//! Counts to strain to force, and how the finger's matrix is found.
//!
//! In reading order:
//! - [`front_end`]: counts to strain; [`force`]: counts to force, by the matrix that is to be found;
//! - [`measurements`]: what a calibration is made from; [`load_text`]: how people write a load;
//! - [`mod@fit`]: the matrix from that, with [`span`] (whether the angles can tell it), `start` (a first matrix that
//!   wrong contacts do not spoil) and `least_squares` (the robust fit from there);
//! - `offset`: the unloaded reading from tares at each position; [`held_back`]: what contacts kept out of the fit say;
//! - [`dwell`]: whether a reading is at rest, by `steadiness` of its block means; [`plan`]: which contacts to take;
//!   [`session`]: one after the other; [`zero_drift`]: how the unloaded reading goes with temperature.
//!
//! In `palpate-files`, `raw` keeps the samples, `conclusion` draws the result from them and `file` keeps it.
//!
//! Frames: finger axes throughout; force is the force on the finger's disk. Units: counts, newtons (or the
//! calibration's relative unit), radians.

pub mod dwell;
pub mod fit;
pub mod force;
pub mod front_end;
pub mod held_back;
mod least_squares;
pub mod load_text;
pub mod measurements;
mod offset;
pub mod plan;
pub mod session;
pub mod span;
mod start;
mod steadiness;
pub mod zero_drift;

pub use fit::{CalibrationFit, ContactResult, FitError, FitSettings, Quality, Role, fit};
pub use force::{Calibration, CalibrationError, CalibrationParts, DwellReading, DwellTare, Force, ForceUnit};
pub use front_end::{FrontEnd, FrontEndError, FrontEndSettings, counts_vector};
pub use held_back::HeldBack;
pub use measurements::{CalibrationContact, Fixture, Load, Measurements};

#[cfg(test)]
mod dwell_tests;
#[cfg(test)]
mod fit_tests;
#[cfg(test)]
mod test_world;
