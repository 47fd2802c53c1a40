//! MCAP, the container of recordings that robotics tools read: written so that what is on the disk is a whole file after
//! every flush, and read as it was written.
//!
//! [`Writer`] appends chunks and writes the summary anew behind each; [`Reader`] goes through a file in the order in which it
//! was written, as far as it is whole, and [`Recovery`] finds what a damaged file still has. A file has channels with messages,
//! attachments and metadata. Chunks are compressed with Zstandard (older ones with LZ4) and have checksums, and each says again
//! what its channels are, so that one chunk can be read without the others.
//!
//! Format: MCAP version 0 (magic `\x89MCAP0\r\n`), <https://mcap.dev/spec>. Integers are little-endian; a text is its length
//! in 4 bytes and UTF-8. Times are nanoseconds since 1970.

pub mod cdr;
mod reader;
mod record;
mod recover;
pub mod ros2;
mod writer;

#[cfg(test)]
mod tests;

pub use reader::{Content, McapError, Reader};
pub use recover::{Damage, Recovered, RecoveredMessage, Recovery};
pub use writer::{Channel, ChannelId, Writer};
