//! palpate's firmware without a board.
//!
//! ```text
//!  interrupt side                                     main side
//!  DRDY ─▶ Sampler ──▶ FrontEnd (Ads131m ─ SPI)        bytes from the host ─▶ Device ─▶ bytes to the host
//!             │                                                               ▲  │ BlockBuilder, Outbox
//!             └──── readings, notices ───────────── Queues ───────────────────┘  │
//!             ▲──── requests ──────────────────────────────────────────────────── ┘
//! ```
//!
//! - [`front_end`]: what the sampler asks of a converter; [`ads131m`]: the ADS131M02 and M04, over `embedded-hal`;
//! - [`settings`]: rates and gains, and which rate a serial line carries;
//! - [`sampler`]: reads a frame at each data-ready edge, numbers it (`clock`: how many conversions have passed), serves
//!   requests in the same frames (`job`);
//! - [`queues`]: all that the two sides share, without locks;
//! - [`block`], [`outbox`]: samples into messages, messages into bytes;
//! - [`link`]: which of two ways to a host is in use;
//! - [`device`]: the host's commands, events, counters;
//! - `forces`: the matrix that a host has the device keep, and forces by it; [`store`]: how a flash keeps it over a restart;
//! - `inputs`: which changes of the digital inputs are told;
//! - `log`: log lines, where `defmt` is on.
//!
//! Nothing here allocates, blocks, uses floating point or panics on input. Time is an argument, so the
//! same calls give the same bytes. What is dropped is counted and reported.

#![forbid(unsafe_code)]
#![no_std]
#![cfg_attr(test, allow(clippy::duplicate_mod, reason = "the same tests run on every chip that the datasheet allows"))]

#[cfg(test)]
extern crate std;

mod log;

pub mod ads131m;
pub mod block;
pub mod device;
pub mod front_end;
pub mod link;
pub mod outbox;
pub mod queues;
pub mod sampler;
pub mod settings;
pub mod store;

mod clock;
mod forces;
mod inputs;
mod job;
/// The chips of the tests, for those in the modules too.
#[cfg(test)]
#[path = "../tests/rig/chip.rs"]
mod test_chip;

pub use device::{Device, Identity};
pub use front_end::{FrontEnd, SelectSource, SourceNotPossible};
pub use link::Link;
pub use queues::Queues;
pub use sampler::Sampler;
pub use settings::{ConverterClock, DeviceSettings, Gain, Rate};
