//! Random numbers that are the same on every machine.

use rand_core::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg32;

/// A sequence of random numbers.
pub struct Draw(Pcg32);

impl Draw {
    /// The sequence of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self(Pcg32::seed_from_u64(seed))
    }

    /// Uniform between two limits.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.whole()) / f64::from(u32::MAX)
    }

    /// Any whole number of 32 bits.
    pub fn whole(&mut self) -> u32 {
        self.0.next_u32()
    }
}
