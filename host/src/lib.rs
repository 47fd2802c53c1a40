//! Feel where a known part is and how it moves.

pub mod calibration;
pub mod contact;
pub mod link;
pub mod recording;
pub mod simulated_device;
pub mod solve;
