//! What is kept of a calibration: the plan, the raw samples, the result.

pub mod conclusion;
pub mod file;
pub mod plan;
pub mod raw;
