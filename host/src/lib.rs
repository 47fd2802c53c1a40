//! Feel where a known part is and how it moves.

pub mod calibration;
pub mod contact;
pub mod geometry;
pub mod recording;
pub mod solve;
