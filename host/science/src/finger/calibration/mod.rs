//! Counts to strain to force, and how the finger's matrix is found.
//!
//! In reading order: [`front_end`] turns counts into strain, [`force`] counts into force; [`measurements`] says what a
//! calibration is made from, [`mod@fit`] finds the matrix; [`dwell`] decides when a reading is at rest, [`plan`] and
//! [`session`] take one after the other. In `palpate-files`, `raw` keeps their samples, `conclusion` draws the result from them and
//! `file` keeps it.
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
