//! Random numbers of the simulation: one stream per source, each from the one seed.
//!
//! Every source of noise or of faults owns a [`Stream`]. Streams of one seed are independent sequences of the
//! generator, so switching one source on or off leaves the others' numbers as they were.
//!
//! Assumes: PCG32, whose streams are independent enough for noise; it is no cipher. Units: none.
//! Errors: none. The same seed gives the same numbers on every machine.

use rand_core::Rng as _;
use rand_pcg::Pcg32;

use super::trig::sin_cos;

/// 2⁻³², the step of a uniform number made of 32 bits.
const UNIFORM_STEP: f32 = 1.0 / 4_294_967_296.0;

/// What a stream of random numbers is for. The number picks the generator's sequence: never reuse one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// Noise of the converter.
    Converter = 1,
    /// Phases of the temperature's course.
    Temperature = 2,
    /// Noise of a bridge with an open gauge.
    OpenGauge = 3,
    /// Bit errors on the bus.
    Bus = 4,
}

/// One independent sequence of random numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Stream(Pcg32);

impl Stream {
    /// The sequence that belongs to a source under a seed.
    pub(crate) fn new(seed: u64, source: Source) -> Self {
        Self(Pcg32::new(seed, source as u64))
    }

    /// 32 random bits, all equally likely.
    pub(crate) fn bits(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// A number uniform in (0, 1]: never 0, so that its logarithm is finite.
    pub(crate) fn uniform(&mut self) -> f32 {
        (self.bits() as f32 + 1.0) * UNIFORM_STEP
    }

    /// A number from the exponential distribution, mean 1.
    pub(crate) fn exponential(&mut self) -> f32 {
        -ln(self.uniform())
    }

    /// Two independent numbers from the normal distribution, mean 0, standard deviation 1 (Box and Muller 1958).
    pub(crate) fn normal_pair(&mut self) -> [f32; 2] {
        let radius = libm::sqrtf(2.0 * self.exponential());
        let (sin, cos) = sin_cos(self.bits());
        [radius * cos, radius * sin]
    }
}

/// −ln(1 − p), to 2e-5 of itself.
pub(crate) fn minus_ln_of_rest(p: f32) -> f32 {
    if p < SMALL_PROBABILITY { p + 0.5 * p * p } else { -ln(1.0 - p) }
}

/// Here p² / 3, the next term of the series in shares of its sum, is 2e-5; the rounding of 1 − p is less.
const SMALL_PROBABILITY: f32 = 1.0 / 128.0;

/// Out of line: a small board has no room for it twice.
#[inline(never)]
fn ln(x: f32) -> f32 {
    libm::logf(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn normal_numbers_have_the_moments_of_the_normal_distribution() {
        let mut stream = Stream::new(1, Source::Converter);
        let numbers: Vec<f64> = (0..100_000).flat_map(|_| stream.normal_pair()).map(f64::from).collect();
        let n = numbers.len() as f64;
        let moment = |k: i32| numbers.iter().map(|x| x.powi(k)).sum::<f64>() / n;
        // Five standard deviations of each estimate for n = 200 000: var(x^k) is 1, 2, 15, 96.
        let five_sigma = |variance: f64| 5.0 * (variance / n).sqrt();
        assert!(moment(1).abs() < five_sigma(1.0));
        assert!((moment(2) - 1.0).abs() < five_sigma(2.0));
        assert!(moment(3).abs() < five_sigma(15.0));
        assert!((moment(4) - 3.0).abs() < five_sigma(96.0));
    }

    #[test]
    fn logarithms_of_the_rest_are_those_of_double_precision() {
        for n in 1..2000 {
            let p = f32::powf(10.0, -8.0 * n as f32 / 2000.0);
            let exact = -(-f64::from(p)).ln_1p();
            assert!((f64::from(minus_ln_of_rest(p)) / exact - 1.0).abs() < 2.2e-5, "{p}");
        }
    }

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let first = |seed, source| {
            let mut stream = Stream::new(seed, source);
            [stream.bits(), stream.bits(), stream.bits()]
        };
        assert_eq!(first(7, Source::Bus), first(7, Source::Bus));
        assert_ne!(first(7, Source::Bus), first(7, Source::OpenGauge));
        assert_ne!(first(7, Source::Bus), first(8, Source::Bus));
    }
}
