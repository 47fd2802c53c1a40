//! On which chip a module's tests run: the datasheet leaves open what [`Behaviour`] says, so each test runs on every one.
#![allow(dead_code, unreachable_pub, reason = "each test uses a part of it")]

use palpate_shared::sim::{Behaviour, FingerConfig, ResetMoment, StatusLatch};

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
    FingerConfig { converter: behaviour(module), ..finger }
}
