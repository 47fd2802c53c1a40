//! What both ends of a palpate link agree on.
#![no_std]

#[cfg(test)]
extern crate std;

#[cfg(feature = "sim")]
pub mod sim;
pub mod units;
