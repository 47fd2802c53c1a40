//! The temperature at the finger: a slow, seeded course.
//!
//! Two sine waves of 40 and 66 minutes whose phases come from the seed, about a mean: what a room does under a
//! thermostat. Bridge offsets and sensitivities follow it (see `bridge`).
//!
//! Assumes: beam, gauges and chip share one temperature. Units: degrees Celsius; differences in kelvin.
//! Errors: none.

use super::noise::{Source, Stream};
use super::trig::sin_cos;

/// Periods of the two waves, in nanoseconds: 40 min and 66 min, so that they come together only after 22 h.
const PERIODS_NS: [u64; 2] = [2_400_000_000_000, 3_960_000_000_000];

/// Parts that the two waves have in the swing.
const PARTS: [f32; 2] = [0.7, 0.3];

/// How the temperature goes: a mean and a swing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ThermalConfig {
    /// Mean temperature, in degrees Celsius.
    pub mean_c: f32,
    /// Largest departure from the mean, in kelvin; 0 switches the course off.
    pub swing_k: f32,
    /// Temperature at which the bridges have their nominal offset and sensitivity, in degrees Celsius.
    pub reference_c: f32,
}

impl Default for ThermalConfig {
    /// A room at 23 °C, ±1 K over tens of minutes (at most 0.15 K a minute); reference 23 °C.
    fn default() -> Self {
        Self { mean_c: 23.0, swing_k: 1.0, reference_c: 23.0 }
    }
}

/// The temperature over time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Thermal {
    config: ThermalConfig,
    /// Phases at time 0, in units of 2⁻³² turns.
    phases: [u32; 2],
}

impl Thermal {
    /// The course that a seed gives.
    pub(super) fn new(config: ThermalConfig, seed: u64) -> Self {
        let mut stream = Stream::new(seed, Source::Temperature);
        Self { config, phases: [stream.bits(), stream.bits()] }
    }

    /// Temperature at a time, in degrees Celsius.
    pub(super) fn at(&self, time_ns: u64) -> f32 {
        let wave = |i: usize| PARTS[i] * sin_cos(self.phases[i].wrapping_add(phase(time_ns, PERIODS_NS[i]))).0;
        self.config.mean_c + self.config.swing_k * (wave(0) + wave(1))
    }

    /// Departure of a temperature from the bridges' reference, in kelvin.
    pub(super) fn above_reference(&self, temperature_c: f32) -> f32 {
        temperature_c - self.config.reference_c
    }
}

/// Phase of a wave that began at time 0, in units of 2⁻³² turns.
#[expect(clippy::cast_possible_truncation, reason = "the quotient is a part of a turn: below 2³²")]
fn phase(time_ns: u64, period_ns: u64) -> u32 {
    // In steps of 2⁻²⁰ turns, so that the product fits: period · 2²⁰ < 2⁶².
    ((((time_ns % period_ns) << 20) / period_ns) << 12) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// One minute, in nanoseconds.
    const MINUTE_NS: u64 = 60_000_000_000;

    proptest! {
        #[test]
        fn the_temperature_stays_within_its_swing_and_changes_slowly(seed: u64, minute in 0u64..10_000) {
            let config = ThermalConfig::default();
            let thermal = Thermal::new(config, seed);
            let (now, later) = (thermal.at(minute * MINUTE_NS), thermal.at((minute + 1) * MINUTE_NS));
            prop_assert!((now - config.mean_c).abs() <= config.swing_k + 1e-5);
            // 2π (0.7 / 40 + 0.3 / 66) = 0.139 K a minute at most.
            prop_assert!((later - now).abs() <= 0.14);
        }
    }

    #[test]
    fn seeds_give_different_courses_that_do_move() {
        let span = |seed| {
            let thermal = Thermal::new(ThermalConfig::default(), seed);
            let course = |minute: u64| thermal.at(minute * MINUTE_NS);
            (0..240).map(course).fold((f32::MAX, f32::MIN), |(low, high), c| (low.min(c), high.max(c)))
        };
        let (low, high) = span(1);
        assert!(high - low > 1.0);
        assert_ne!(span(1), span(2));
    }

    #[test]
    fn bridges_feel_the_departure_from_their_reference() {
        let config = ThermalConfig { mean_c: 30.0, swing_k: 0.0, reference_c: 20.0 };
        let thermal = Thermal::new(config, 1);
        assert!((thermal.above_reference(thermal.at(0)) - 10.0).abs() < 1e-5);
    }

    #[test]
    fn without_a_swing_the_temperature_is_constant() {
        let thermal = Thermal::new(ThermalConfig { swing_k: 0.0, ..ThermalConfig::default() }, 3);
        assert!((0..100).all(|minute| (thermal.at(minute * MINUTE_NS) - 23.0).abs() < 1e-6));
    }
}
