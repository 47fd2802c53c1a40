//! What both ends of a palpate link agree on.
//!
//! - [`units`]: counts, device time and sample numbers, each a type of its own;
//! - [`wire`]: the messages; [`frame`]: the frames that carry them over a serial line;
//! - [`sim`] (feature `sim`): the simulated finger and its front-end.
//!
//! Nothing here knows mechanics, allocates, or needs an operating system.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod frame;
#[cfg(feature = "sim")]
pub mod sim;
pub mod units;
pub mod wire;
