//! palpate's second link: a serial port over USB.
//!
//! - [`port`]: the port (CDC-ACM) on whatever USB bus there is; tested on a PC against a bus in memory;
//! - `unit`: the STM32F405's bus, and whether it is there; only on the target.
//!
//! A package of its own, so that it can be optimised for size while the sampling path is optimised for speed: the
//! types of the USB stack are generic, and are compiled where they become concrete.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod port;

#[cfg(target_os = "none")]
pub mod unit;
