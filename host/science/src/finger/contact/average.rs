//! Moving averages that know about gaps.
//!
//! Averaging over one mains period removes the hum whatever its phase. How much noise is left is not `σ/√N`, since
//! hum and drift are correlated: [`super::noise::of_window_mean`] measures it.
//!
//! Assumes: readings come at an even rate; a gap restarts the window, so that no average spans one.

use std::collections::VecDeque;

use nalgebra::Vector2;
use serde::{Deserialize, Serialize};

use super::{Reading, SettingsError};

/// Longest window, in readings: 1 s at the front-end's fastest rate, 32 kHz.
///
/// A longer one is surely a mistake in a settings file, and its buffer would be large.
const SAMPLES_MAX: usize = 32_000;

/// How many readings are averaged into one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Averaging {
    /// Each reading stands for itself.
    #[default]
    Off,
    /// The mean of so many readings.
    Samples(usize),
    /// As many readings as come in this time, s. One mains period is 0.02 (50 Hz) or 1/60.
    Seconds(f64),
}

impl Averaging {
    /// The number of readings at a sampling period of `period` seconds: the nearest whole number, at least 1.
    #[must_use]
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to 1..=SAMPLES_MAX before")]
    pub fn samples(self, period: f64) -> usize {
        match self {
            Self::Off => 1,
            Self::Samples(samples) => samples.clamp(1, SAMPLES_MAX),
            Self::Seconds(seconds) => (seconds / period).round().clamp(1.0, SAMPLES_MAX as f64) as usize,
        }
    }

    pub(super) fn check(self) -> Result<(), SettingsError> {
        let (ok, value) = match self {
            Self::Off => (true, 1.0),
            Self::Samples(samples) => ((1..=SAMPLES_MAX).contains(&samples), samples as f64),
            Self::Seconds(seconds) => (seconds.is_finite() && seconds > 0.0, seconds),
        };
        super::require(ok, "averaging", value, "above 0 (1 to 32000 samples, or a time in s)")
    }
}

/// The mean of the last `samples` readings.
#[derive(Clone, Debug)]
pub struct MovingAverage {
    samples: usize,
    gap_max: f64,
    window: VecDeque<Reading>,
    /// Sum over the window of (time since the window's start of summing, force).
    sum_t: f64,
    sum_force: Vector2<f64>,
    /// Times are summed relative to this one, since Unix times would lose digits.
    t_origin: f64,
    since_resum: usize,
    restarts: u64,
}

impl MovingAverage {
    /// Averages `samples` readings (at least 1) and starts again when two of them are more than `gap_max` seconds
    /// apart, or out of order.
    #[must_use]
    pub fn new(samples: usize, gap_max: f64) -> Self {
        let samples = samples.clamp(1, SAMPLES_MAX);
        Self {
            samples,
            gap_max,
            window: VecDeque::with_capacity(samples),
            sum_t: 0.0,
            sum_force: Vector2::zeros(),
            t_origin: 0.0,
            since_resum: 0,
            restarts: 0,
        }
    }

    /// Readings in a full window.
    #[must_use]
    pub fn samples(&self) -> usize {
        self.samples
    }

    /// How often the window was emptied by a gap, a clock that went back, or a reading that was not finite.
    #[must_use]
    pub fn restarts(&self) -> u64 {
        self.restarts
    }

    /// Takes a reading and gives the window's mean (of time too) once the window is full.
    pub fn push(&mut self, reading: &Reading) -> Option<Reading> {
        if !reading.is_finite() {
            self.restart();
            return None;
        }
        if self.window.back().is_some_and(|last| !self.follows(last, reading)) {
            self.restart();
        }
        if self.window.len() == self.samples {
            self.drop_oldest();
        }
        self.add(reading);
        (self.window.len() == self.samples).then(|| self.mean())
    }

    fn follows(&self, last: &Reading, reading: &Reading) -> bool {
        let step = reading.t - last.t;
        step > 0.0 && step <= self.gap_max
    }

    fn restart(&mut self) {
        self.restarts += u64::from(!self.window.is_empty());
        self.window.clear();
        self.resum();
    }

    fn add(&mut self, reading: &Reading) {
        if self.window.is_empty() {
            self.t_origin = reading.t;
        }
        self.window.push_back(*reading);
        self.sum_t += reading.t - self.t_origin;
        self.sum_force += reading.force_finger;
        self.since_resum += 1;
        if self.since_resum >= self.samples {
            self.resum();
        }
    }

    fn drop_oldest(&mut self) {
        if let Some(oldest) = self.window.pop_front() {
            self.sum_t -= oldest.t - self.t_origin;
            self.sum_force -= oldest.force_finger;
        }
    }

    /// Sums afresh, once a window: a running sum would gather rounding errors for as long as the stream runs.
    fn resum(&mut self) {
        self.since_resum = 0;
        self.t_origin = self.window.front().map_or(0.0, |oldest| oldest.t);
        self.sum_t = self.window.iter().map(|reading| reading.t - self.t_origin).sum();
        self.sum_force = self.window.iter().map(|reading| reading.force_finger).sum();
    }

    fn mean(&self) -> Reading {
        let n = self.window.len() as f64;
        Reading::new(self.t_origin + self.sum_t / n, self.sum_force / n)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Rounding of a mean of values up to 1e3, a hundred units in the last place.
    const ROUNDING: f64 = 1e-11;

    fn ramp(n: u32) -> Vec<Reading> {
        (0..n).map(|i| Reading::new(f64::from(i) * 0.01, Vector2::new(f64::from(i), -f64::from(i)))).collect()
    }

    #[test]
    fn the_mean_of_a_ramp_is_its_middle() {
        let mut average = MovingAverage::new(5, 0.02);
        let means: Vec<_> = ramp(20).iter().filter_map(|reading| average.push(reading)).collect();
        assert_eq!(means.len(), 16);
        for (i, mean) in means.iter().enumerate() {
            let middle = i as f64 + 2.0;
            assert!((mean.force_finger.x - middle).abs() < ROUNDING, "{mean:?}");
            assert!((mean.t - 0.01 * middle).abs() < ROUNDING, "{mean:?}");
        }
    }

    #[test]
    fn no_mean_spans_a_gap_a_step_back_or_a_value_that_is_not_finite() {
        let bad = [Reading::new(9.0, Vector2::zeros()), Reading::new(0.05, Vector2::zeros())];
        for reading in bad {
            let mut average = MovingAverage::new(3, 0.02);
            for reading in ramp(10) {
                average.push(&reading);
            }
            assert_eq!(average.push(&reading), None);
            assert_eq!(average.restarts(), 1);
        }
        let mut average = MovingAverage::new(1, 0.02);
        assert!(average.push(&Reading::new(0.0, Vector2::new(f64::NAN, 0.0))).is_none());
        assert!(average.push(&Reading::new(0.01, Vector2::zeros())).is_some());
    }

    #[test]
    fn a_wild_value_leaves_no_rounding_behind() {
        let mut average = MovingAverage::new(4, 0.02);
        let mean = (0..20)
            .map(|i| Reading::new(f64::from(i) * 0.01, Vector2::new(if i == 5 { 1e15 } else { 0.1 }, 0.0)))
            .filter_map(|reading| average.push(&reading))
            .last()
            .unwrap();
        assert!((mean.force_finger.x - 0.1).abs() < ROUNDING, "{mean:?}");
    }

    #[test]
    fn one_mains_period_of_readings_depends_on_the_rate() {
        assert_eq!(Averaging::Seconds(0.02).samples(1.0 / 4000.0), 80);
        assert_eq!(Averaging::Seconds(0.02).samples(0.00993), 2);
        assert_eq!(Averaging::Seconds(0.001).samples(0.01), 1);
        assert_eq!(Averaging::Off.samples(0.01), 1);
    }

    proptest! {
        #[test]
        fn running_sums_equal_sums_made_afresh(
            values in proptest::collection::vec(-1e3..1e3, 1..200), samples in 1_usize..20
        ) {
            let readings: Vec<_> = values
                .iter()
                .enumerate()
                .map(|(i, &x)| Reading::new(1.4e9 + i as f64 * 0.01, Vector2::new(x, -x)))
                .collect();
            let mut average = MovingAverage::new(samples, 0.02);
            for (i, reading) in readings.iter().enumerate() {
                let got = average.push(reading);
                let window = (i + 1).checked_sub(samples).map(|start| &values[start..=i]);
                let want = window.map(|w| w.iter().sum::<f64>() / samples as f64);
                match (got, want) {
                    (None, None) => {}
                    (Some(got), Some(want)) => prop_assert!((got.force_finger.x - want).abs() < 1e3 * ROUNDING),
                    other => prop_assert!(false, "{other:?}"),
                }
            }
        }
    }
}
