//! On which chip a module's tests run: the datasheet leaves open what [`Behaviour`] says, so each test runs on every one.
#![allow(dead_code, unreachable_pub, reason = "each test uses a part of it")]

use palpate_shared::front_ends::FrontEndKind;
use palpate_shared::sim::{Behaviour, Channels, FingerConfig, ResetMoment, StatusLatch};

/// How many channels the chip of a test has, by what the test's module is called.
pub const fn channels(module: &str) -> usize {
    if contains(module.as_bytes(), b"four_channels") { 4 } else { 2 }
}

/// Which chip that is.
pub const fn kind(channels: usize) -> FrontEndKind {
    if channels == 4 { FrontEndKind::Ads131m04 } else { FrontEndKind::Ads131m02 }
}

/// Whether a text holds another one; the standard library's own is not `const`.
const fn contains(text: &[u8], part: &[u8]) -> bool {
    let mut at = 0;
    while at + part.len() <= text.len() {
        let mut same = 0;
        while same < part.len() && text[at + same] == part[same] {
            same += 1;
        }
        if same == part.len() {
            return true;
        }
        at += 1;
    }
    false
}

/// How the chip of a test behaves, by what the test's module is called.
pub fn behaviour(module: &str) -> Behaviour {
    let status_latch =
        if module.contains("status_at_frame_end") { StatusLatch::FrameEnd } else { StatusLatch::FrameStart };
    let reset_at =
        if module.contains("reset_at_last_clock") { ResetMoment::LastClock } else { ResetMoment::ChipSelectRise };
    Behaviour { status_latch, reset_at, ..Behaviour::default() }
}

/// The same finger with that chip.
pub fn on_chip_of(module: &str, finger: FingerConfig) -> FingerConfig {
    let channels = if channels(module) == 4 { Channels::Four } else { Channels::Two };
    FingerConfig { converter: behaviour(module), channels, ..finger }
}
