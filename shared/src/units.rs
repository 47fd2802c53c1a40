//! Quantities that would look plausible if swapped, each as a type of its own.

use serde::{Deserialize, Serialize};

/// One raw code of one bridge: 24 bit two's complement, sign-extended.
///
/// Not a voltage: its size in volts depends on the gain, which the hello message states.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Counts(pub i32);

impl Counts {
    /// The largest code the converter gives; a bridge that shows it is saturated.
    pub const MAX: Self = Self(0x7F_FFFF);
    /// The smallest code the converter gives; a bridge that shows it is saturated.
    pub const MIN: Self = Self(-0x80_0000);

    /// Whether the converter clipped this reading, so that it says nothing about the load.
    #[must_use]
    pub fn is_saturated(self) -> bool {
        self <= Self::MIN || self >= Self::MAX
    }
}

/// Microseconds on the device's clock since it started; wraps after 71.6 minutes.
///
/// Not host time: the two clocks differ in offset and in rate.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct DeviceTime(pub u32);

impl DeviceTime {
    /// Microseconds from `earlier` to `self`, right across one wrap.
    #[must_use]
    pub fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }
}

/// Number of a sample, counted by the sampler from 0 at start-up; wraps after 12.4 days at 4 kHz.
///
/// While streaming it counts conversions of the front-end, not samples delivered, so every loss leaves a gap. It
/// rests while the stream is stopped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Seq(pub u32);

impl Seq {
    /// The number `n` samples later.
    #[must_use]
    pub fn plus(self, n: u32) -> Self {
        Self(self.0.wrapping_add(n))
    }

    /// Samples from `earlier` to `self`, right across one wrap.
    #[must_use]
    pub fn since(self, earlier: Self) -> u32 {
        self.0.wrapping_sub(earlier.0)
    }
}
