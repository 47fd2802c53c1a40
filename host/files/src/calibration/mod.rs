//! What is kept of a calibration: the plan (`plan`), the raw samples ([`raw`], of a wave [`raw_wave`]), the result ([`mod@file`], with
//! what it says of a finger that is carried in [`carried`]), and how the
//! result comes from the samples ([`conclusion`]).

pub mod carried;
pub mod conclusion;
pub mod file;
pub mod plan;
pub mod raw;
pub mod raw_wave;
