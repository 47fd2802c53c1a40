//! The link to a device: from a name on the command line to samples in order.
//!
//! [`transport::address`] says what a device may be called, [`transport`] moves bytes to and from it, [`wire_reader`]
//! turns bytes into messages and never loses its place, [`sample_sequence`] counts every missing sample, [`clock_map`]
//! maps the device's time to the host's, and [`session`] puts them together: handshake, commands that are repeated
//! until answered, and reconnection when the cable comes back. [`trace`] is what a session goes by, for a recording, which
//! is a device like any other.
//!
//! `slow_channels`: excitation and NTC of a front-end that measures them; counts are handed on as at the nominal excitation.
//!
//! `device_forces`: forces that a device computes, held against its samples.
//!
//! [`dfu`] puts an image onto a board through the chip's own loader.
//!
//! [`raw_frame`] is for a person at a board that was never run before.
//!
//! [`robot`] is the link to what moves the finger, [`simulated`] a device without hardware that all of this talks to as to a real one; [`error`] is what can go
//! wrong on the way.
//!
//! This is the rim: threads, clocks and I/O live here and nowhere further in. What depends on the operating
//! system is in `transport::platform`.

#![forbid(unsafe_code)]

pub mod clock_map;
mod device_forces;
pub mod dfu;
pub mod error;
mod link;
pub mod raw_frame;
pub mod robot;
pub mod sample_sequence;
pub mod session;
pub mod simulated;
mod slow_channels;
mod tape;
pub mod trace;
pub mod transport;
pub mod wire_reader;

pub use error::{LinkError, Opened};
pub use session::{Incoming, Session};
pub use tape::PlaySpeed;
pub use transport::Address;
