//! The link to a device: from a name on the command line to samples in order.
//!
//! [`address`] says what a device may be called, [`transport`] moves bytes to and from it, [`reader`] turns
//! bytes into messages and never loses its place, [`sequence`] counts every missing sample, [`clock`] maps the
//! device's time to the host's, and [`session`] puts them together: handshake, commands that are repeated
//! until answered, and reconnection when the cable comes back.
//!
//! This is the rim: threads, clocks and I/O live here and nowhere further in. What depends on the operating
//! system is in [`platform`].

pub mod address;
pub mod clock;
pub mod error;
pub mod platform;
pub mod reader;
pub mod sequence;
pub mod session;
pub mod transport;

pub use address::Address;
pub use error::LinkError;
pub use session::{Incoming, Session};
