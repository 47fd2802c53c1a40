//! What a session went by: every byte of the link in both directions, and what it made of its clock.
//!
//! A session notes an [`Entry`] for each thing that decides what it hands on, in the order in which it took note of it.
//! So a session that is given these entries instead of a link ([`crate::Session::open_recorded`]) hands on the same, to the
//! digit: it decodes the bytes anew and takes from the entries what no byte tells, such as that a reply did not come in
//! time. What a program took in from elsewhere between two entries, such as a line that tells how the finger moves, has its
//! place among them as an [`Input`].
//!
//! Units: nanoseconds; `host_ns` since the session's epoch on a clock that is never set, `unix_ns` since 1970.

use std::fmt;
use std::time::{Duration, Instant, SystemTime};

use serde::{Deserialize, Serialize};

/// A moment on the clocks of this computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stamp {
    /// On the clock that is never set.
    pub at: Instant,
    /// Unix time, ns; 0 where the computer's clock is before 1970.
    pub unix_ns: u64,
}

impl Stamp {
    /// Now.
    #[must_use]
    pub fn now() -> Self {
        let unix = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        Self { at: Instant::now(), unix_ns: nanoseconds(unix) }
    }

    /// Since `epoch`, ns.
    #[must_use]
    pub fn since(self, epoch: Instant) -> u64 {
        nanoseconds(self.at.saturating_duration_since(epoch))
    }
}

/// A duration in whole nanoseconds; the largest number for more than 584 years.
#[must_use]
pub fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}

/// Something that a session went by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Entry {
    /// When, since the session's epoch: for bytes that came, when they came.
    pub host_ns: u64,
    /// The same moment as Unix time.
    pub unix_ns: u64,
    /// What.
    pub what: Traced,
}

/// What a session can go by.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Traced {
    /// Bytes that came from the device: a frame with its delimiter, or a part of one.
    Received(Vec<u8>),
    /// Bytes that went to the device: a command's frame between delimiters.
    Sent(Vec<u8>),
    /// What no byte tells.
    Event(LinkEvent),
    /// What came in beside the link.
    Input(Input),
}

/// What became of a link, or what a session made of its clock.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum LinkEvent {
    /// The link was opened, to be greeted.
    Opened {
        /// Speed of the line, baud; without meaning for lines that have none.
        baud: u32,
        /// Where a simulated device in real time is at the other end: its time 0 on the session's clock, ns.
        simulated_epoch_ns: Option<i64>,
    },
    /// The link could not be opened again.
    NotOpened {
        /// Why.
        reason: String,
        /// Whether that was handed on: once for each reason.
        is_told: bool,
    },
    /// A command could not be sent.
    NotSent {
        /// Why.
        reason: String,
        /// Whether there was only no room in time, so that it is repeated like a command that was lost.
        was_full: bool,
    },
    /// A reply did not come in time.
    NoReply,
    /// Nothing was handed on within the time that the program gave.
    Idle,
    /// The device's samples have stopped coming.
    Silent {
        /// How long ago the last ones came, ns.
        after_ns: u64,
    },
    /// It was asked whether the stream still is one.
    StreamAsked,
    /// When a ping was sent and its answer taken, since the epoch.
    Pinged {
        /// Sent, ns.
        sent_ns: u64,
        /// Taken, ns.
        received_ns: u64,
    },
    /// The link broke.
    Broken {
        /// How that was noticed.
        reason: String,
    },
    /// The link was opened again and its device has answered.
    Reconnected {
        /// How long it was down, ns.
        after_ns: u64,
    },
    /// The person at the keyboard wished the program to stop.
    Interrupted,
}

/// What a program took in beside the link.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Input {
    /// What it tells of, such as `motion`.
    pub source: String,
    /// A line of it; none where it ended.
    pub line: Option<String>,
}

/// Takes entries as a session notes them.
pub trait Recorder: fmt::Debug + Send {
    /// Takes one. Whatever keeps it from being kept is the recorder's to tell: the session goes on.
    fn take(&mut self, entry: Entry);
}
