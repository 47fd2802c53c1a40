//! The device's clock on the host's time line.
//!
//! A block can only arrive after its last sample was taken, so every arrival bounds the offset between the two
//! clocks from one side, and the least delayed arrivals lie on a straight line: its slope is the drift. The map
//! keeps the earliest arrival of every half second and fits the line through those minima. A ping
//! bounds the offset from the other side as well: the device took its time between our sending and receiving.
//!
//! Times are seconds on either clock, each from its own arbitrary zero.

use std::collections::VecDeque;

use palpate::math::statistics::mean;

/// Length of the intervals whose earliest arrival is kept, in seconds of device time: long enough that some
/// block in it was not delayed, short enough to follow a drift that changes with temperature.
const BIN_S: f64 = 0.5;

/// How many intervals the line is fitted through: half a minute, over which a crystal's drift is constant.
const BINS: usize = 64;

/// Below this many intervals the drift is not told from jitter, and is taken as zero.
const BINS_FOR_DRIFT: usize = 8;

/// The relation between device time and host time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ClockEstimate {
    /// Host time minus device time, in s, at `at_device_s`.
    pub offset_s: f64,
    /// Seconds that the host's clock gains per second of the device's.
    pub drift: f64,
    /// Device time that the offset refers to, in s.
    pub at_device_s: f64,
    /// How much later or earlier than `host_time` the truth may be, in s, where a ping bounded it.
    pub uncertainty_s: Option<f64>,
}

impl ClockEstimate {
    /// Host time of a moment on the device's clock, in s.
    #[must_use]
    pub fn host_time(&self, device_s: f64) -> f64 {
        device_s + self.offset_s + self.drift * (device_s - self.at_device_s)
    }
}

/// Learns the relation between the clocks from arrivals and pings.
#[derive(Clone, Debug, Default)]
pub struct ClockMap {
    /// Device time and offset of the earliest arrival in each interval, oldest first.
    minima: VecDeque<(f64, f64)>,
    /// The ping with the shortest round trip: device time, offset's lower and upper bound.
    ping: Option<(f64, f64, f64)>,
}

impl ClockMap {
    /// Takes in that the sample of `device_s` arrived at `host_s`.
    pub fn arrived(&mut self, device_s: f64, host_s: f64) {
        let offset = host_s - device_s;
        match self.minima.back_mut() {
            Some((start, least)) if same_bin(*start, device_s) => {
                if offset < *least {
                    (*start, *least) = (device_s, offset);
                }
            }
            _ => {
                self.minima.push_back((device_s, offset));
                if self.minima.len() > BINS {
                    self.minima.pop_front();
                }
            }
        }
    }

    /// Takes in that the device read `device_s` between `sent_s` and `received_s`.
    pub fn ping(&mut self, sent_s: f64, device_s: f64, received_s: f64) {
        let (low, high) = (sent_s - device_s, received_s - device_s);
        // Half a minute of drift at 100 ppm is 3 ms: a ping that old is replaced by any new one.
        let better = self.ping.is_none_or(|(at, best_low, best_high)| {
            high - low < best_high - best_low || device_s - at > BIN_S * BINS as f64
        });
        if better {
            self.ping = Some((device_s, low, high));
        }
    }

    /// Forgets everything, as after a restart of the device.
    pub fn restart(&mut self) {
        *self = Self::default();
    }

    /// The relation as far as it is known; `None` before the first arrival.
    #[must_use]
    pub fn estimate(&self) -> Option<ClockEstimate> {
        let &(at_device_s, newest) = self.minima.back()?;
        let drift = if self.minima.len() >= BINS_FOR_DRIFT { slope(&self.minima) } else { 0.0 };
        // The line lies below all minima: no arrival comes before its sample.
        let lowest = |(at, offset): &(f64, f64)| offset - drift * (at - at_device_s);
        let from_arrivals = self.minima.iter().map(lowest).fold(newest, f64::min);
        let Some((ping_at, low, high)) = self.ping else {
            return Some(ClockEstimate { offset_s: from_arrivals, drift, at_device_s, uncertainty_s: None });
        };
        let carried = drift * (at_device_s - ping_at);
        let (low, high) = (low + carried, (high + carried).min(from_arrivals));
        let uncertainty_s = Some(((high - low) / 2.0).max(0.0));
        Some(ClockEstimate { offset_s: f64::midpoint(low, high), drift, at_device_s, uncertainty_s })
    }
}

/// Whether two device times lie in the same interval.
#[expect(clippy::float_cmp, reason = "both sides are whole numbers")]
fn same_bin(a: f64, b: f64) -> bool {
    (a / BIN_S).floor() == (b / BIN_S).floor()
}

/// Slope of the least-squares line through `points`.
fn slope(points: &VecDeque<(f64, f64)>) -> f64 {
    let mean_of = |pick: fn(&(f64, f64)) -> f64| mean(points.iter().map(pick)).unwrap_or(f64::NAN);
    let (x_mean, y_mean) = (mean_of(|point| point.0), mean_of(|point| point.1));
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in points {
        xx += (x - x_mean) * (x - x_mean);
        xy += (x - x_mean) * (y - y_mean);
    }
    if xx > 0.0 { xy / xx } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Shortest possible way from sample to host in the tests, in s.
    const LEAST_DELAY_S: f64 = 0.000_3;

    proptest! {
        #[test]
        fn drift_and_offset_are_found_through_random_delays(
            drift_ppm in -200.0..200.0_f64, offset_s in -1e4..1e4_f64,
            delays in prop::collection::vec(0.0..1.0_f64, 4000),
        ) {
            let truth = |device_s: f64| device_s + offset_s + drift_ppm * 1e-6 * device_s;
            let mut map = ClockMap::default();
            for (i, uniform) in delays.iter().enumerate() {
                let device_s = 0.008 * i as f64;
                // Mostly short, at times 20 ms late, as a busy host is.
                let delay = LEAST_DELAY_S + 0.02 * uniform.powi(8);
                map.arrived(device_s, truth(device_s) + delay);
            }
            let estimate = map.estimate().unwrap();
            prop_assert!((estimate.drift * 1e6 - drift_ppm).abs() < 5.0, "{estimate:?}");
            let error = estimate.host_time(31.9) - truth(31.9);
            // Never early, and late by little more than what no arrival can undercut.
            prop_assert!((-1e-4..2.0 * LEAST_DELAY_S).contains(&error), "{error}");
        }

        /// No sample arrives before it was taken: an arrival bounds the offset from above, more closely than a slow ping.
        #[test]
        fn an_arrival_bounds_the_offset_more_closely_than_a_slow_ping(
            offset_s in -10.0..10.0_f64, late in 1e-4..5e-3_f64, there in 0.0..1e-4_f64, back in 0.02..0.2_f64,
        ) {
            let mut map = ClockMap::default();
            map.arrived(1.0, 1.0 + offset_s + late);
            map.ping(2.0 + offset_s - there, 2.0, 2.0 + offset_s + back);
            let estimate = map.estimate().unwrap();
            // Between the ping's way there and the arrival's delay, not its way back.
            prop_assert!(estimate.uncertainty_s.unwrap() <= 0.5 * (there + late) + 1e-9, "{estimate:?}");
            prop_assert!((estimate.host_time(2.0) - 2.0 - offset_s).abs() <= 0.5 * (there + late) + 1e-9, "{estimate:?}");
        }

        #[test]
        fn a_ping_bounds_the_offset_from_both_sides(offset_s in -10.0..10.0_f64, there in 0.0..0.01_f64, back in 0.0..0.01_f64) {
            let mut map = ClockMap::default();
            map.arrived(1.0, 1.0 + offset_s + 0.05);
            map.ping(2.0 + offset_s - there, 2.0, 2.0 + offset_s + back);
            let estimate = map.estimate().unwrap();
            let bound = estimate.uncertainty_s.unwrap();
            prop_assert!((estimate.host_time(2.0) - 2.0 - offset_s).abs() <= bound + 1e-9, "{estimate:?}");
        }
    }
}
