//! What both ends of a palpate link agree on.
//!
//! - [`units`]: counts, device time and sample numbers, each a type of its own; [`status`]: what qualifies samples;
//! - [`force`]: counts to force in integers, the same on both ends;
//! - [`front_ends`]: what is known of each kind of converter, by table;
//! - `wire`: the messages; `frame`: the frames that carry them over a serial line (feature `wire`, on by default);
//! - `sim` (feature `sim`): the simulated finger and its front-end.
//!
//! Nothing here knows mechanics, allocates, or needs an operating system.

#![forbid(unsafe_code)]
#![no_std]

#[cfg(test)]
extern crate std;

pub mod force;
#[cfg(feature = "wire")]
pub mod frame;
pub mod front_ends;
#[cfg(feature = "sim")]
pub mod sim;
pub mod status;
pub mod units;
#[cfg(feature = "wire")]
pub mod wire;
