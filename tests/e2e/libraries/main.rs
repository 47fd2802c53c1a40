//! The libraries, judged from outside: against slow code that shares nothing with them, recordings of others, hostile
//! bytes and broken lines.

#![allow(clippy::unwrap_used, reason = "clippy exempts tests, but not their helpers")]

mod carried_finger;
mod documented;
mod estimating;
mod force_recordings;
mod four_channels;
mod friction;
mod fuzz;
mod inscription;
mod link;
mod odd_devices;
mod outlines;
mod point_sampling;
mod pushing;
mod pushing_shapes;
mod rolling;
