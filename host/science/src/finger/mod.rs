//! The finger: counts → strain → force → contact.
//!
//! [`calibration`] finds and applies the finger's matrix, [`judge`] tells which samples are measurements, [`contact`] turns
//! force into contact angles, [`sense`] joins them; [`rest`] gathers a stretch for a tare, [`ringing`] takes out how the finger
//! rings, [`monitor`] says what to tell and when, [`diagnosis`] judges a stretch of samples at rest.
//!
//! Frames: finger axes; force is the force on the finger's disk. Units: counts, SI.

pub mod calibration;
pub mod contact;
pub mod diagnosis;
pub mod force_guard;
pub mod judge;
pub mod monitor;
pub mod rest;
pub mod ringing;
mod samples;
pub mod sense;

pub use samples::{STUCK_SAMPLES, Samples};
