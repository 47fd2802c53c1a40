//! What a contact path can tell: which changes of a state show in it. Pure: no files, clocks or threads.
//!
//! - [`Spectrum`]: rank, singular values and unseen directions of any system's outputs;
//! - [`push`]: a part that a finger pushes.
//!
//! To add a system: give the derivatives of its outputs by its state, one row an output, columns scaled to comparable sizes.

pub mod push;
mod spectrum;

pub use spectrum::{RANK_THRESHOLD, Spectrum};
