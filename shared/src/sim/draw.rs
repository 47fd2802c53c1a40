//! Random numbers for experiments and tests, the same on every machine.
//!
//! It stands beside the simulated finger because tables, demonstrations, the tests of every crate and the fuzzing all draw, and
//! this is the one place below all of them that has a generator already; the library that they exercise draws nothing, its
//! randomness is an argument. The device's own noise stays with `Stream`: in `f32` for boards that have no `f64`, one stream
//! a source.
//!
//! [`Draw::case`] gives each case a generator of its own, so that a case stays the same whatever is drawn for others.
//!
//! Assumes: PCG32, whose sequences are independent enough for this; it is no cipher. Logarithm and cosine are of `libm` and not
//! of the operating system, whose last bits differ. Units: the caller's. Errors: none.

use core::f64::consts::TAU;

use rand_core::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg32;

/// 2⁻⁵³, the step of a uniform number made of 53 bits.
const UNIFORM_STEP: f64 = 1.0 / 9_007_199_254_740_992.0;

/// A sequence of random numbers.
///
/// ```
/// use palpate_shared::sim::Draw;
///
/// let mut draw = Draw::new(7);
/// let mass = draw.uniform(0.2, 0.8); // kg
/// assert!((0.2..0.8).contains(&mass) && mass == Draw::new(7).uniform(0.2, 0.8));
/// ```
#[derive(Clone, Debug)]
pub struct Draw(Pcg32);

impl Draw {
    /// The sequence of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self::case(seed, 0)
    }

    /// The sequence of one case under a seed.
    #[must_use]
    pub fn case(seed: u64, case: usize) -> Self {
        // An odd multiplier spreads neighbouring cases and keeps them distinct (Knuth's, from the golden ratio).
        Self(Pcg32::seed_from_u64(seed ^ (case as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)))
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A number uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        // 53 bits fit a double.
        (self.bits() >> 11) as f64 * UNIFORM_STEP
    }

    /// A number uniform in [`low`, `high`).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// A number from the normal distribution with mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        // 1 − unit is never 0, so its logarithm is finite.
        libm::sqrt(-2.0 * libm::log(1.0 - self.unit())) * libm::cos(TAU * self.unit())
    }

    /// An index below `count`; 0 if `count` is 0.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below `count`, which is a usize")]
    pub fn index(&mut self, count: usize) -> usize {
        (self.unit() * count as f64) as usize
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn a_case_is_the_same_whatever_was_drawn_before() {
        let first = Draw::case(3, 7).unit();
        let mut other = Draw::case(3, 6);
        other.normal();
        assert_eq!(first.to_bits(), Draw::case(3, 7).unit().to_bits());
        assert_ne!(first.to_bits(), Draw::case(3, 6).unit().to_bits());
    }

    #[test]
    fn the_normal_distribution_has_its_moments() {
        const COUNT: u32 = 20_000;
        let mut draw = Draw::case(5, 0);
        let numbers: Vec<_> = (0..COUNT).map(|_| draw.normal()).collect();
        let mean = numbers.iter().sum::<f64>() / f64::from(COUNT);
        let variance = numbers.iter().map(|number| number * number).sum::<f64>() / f64::from(COUNT);
        // Five standard deviations of either.
        assert!(mean.abs() < 5.0 / f64::from(COUNT).sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / f64::from(COUNT)).sqrt(), "{variance}");
    }

    #[test]
    fn indices_reach_from_the_first_to_the_last() {
        let mut draw = Draw::new(1);
        let mut seen = [0; 5];
        (0..1000).for_each(|_| seen[draw.index(5)] += 1);
        assert!(seen.iter().all(|count| (130..270).contains(count)), "{seen:?}");
        assert_eq!(draw.index(0), 0);
    }
}
