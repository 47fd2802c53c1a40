//! What a reader of samples has to know about them.

use serde::{Deserialize, Serialize};

/// What sets of bits can do.
macro_rules! bit_set {
    ($set:ident) => {
        impl $set {
            /// Whether every bit of `other` is set.
            #[must_use]
            pub fn contains(self, other: Self) -> bool {
                self.0 & other.0 == other.0
            }

            /// With the bits of `other` set too.
            #[must_use]
            pub fn with(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }
        }
    };
}
#[cfg(feature = "wire")]
pub(crate) use bit_set;

bit_set!(Status);

/// Bits that qualify the samples of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Status(pub u16);

impl Status {
    /// The samples are made up by a simulation.
    pub const SIMULATED: Self = Self(1);
    /// Channel 0 was at the end of its range in at least one sample.
    pub const SATURATED_0: Self = Self(1 << 1);
    /// Channel 1 was at the end of its range in at least one sample.
    pub const SATURATED_1: Self = Self(1 << 2);
    /// At least one sample is missing between the previous block and this one.
    pub const GAP_BEFORE: Self = Self(1 << 3);
    /// The filter had not settled after a start or a change of rate or gain.
    pub const SETTLING: Self = Self(1 << 4);
}
