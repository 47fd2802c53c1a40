//! The finger: counts → strain → force → contact.
//!
//! [`calibration`] finds and applies the finger's matrix, [`contact`] turns force into contact angles, [`sense`] joins
//! the two, [`diagnosis`] judges a stretch of samples at rest.
//!
//! Frames: finger axes; force is the force on the finger's disk. Units: counts, SI.

pub mod calibration;
pub mod contact;
pub mod diagnosis;
mod samples;
pub mod sense;

pub use samples::{STUCK_SAMPLES, Samples};
