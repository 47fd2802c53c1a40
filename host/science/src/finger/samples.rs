//! What a finger's converter gives, before anybody says what it means: samples in a row, as a device numbers and times
//! them.
//!
//! Knows device time only: no clock of the host, no link. Who needs to know when a block arrived asks the session.
//!
//! Stamps are those of the converter's data-ready signal; what its filter delays is taken out where samples become
//! readings.
//!
//! Units: counts; µs of device time where a name says so. Errors: none.

use palpate_shared::status::Status;
use palpate_shared::units::Counts;

/// Equal codes of a bridge in a row that no working converter gives: 5 ms at 4 kHz.
///
/// Noise of some 270 codes makes two neighbours equal once in a thousand, and even a noise of two codes makes twenty
/// equal only once in 10¹⁴ samples, which is eight hundred years. Until they are that many, a stuck converter passes
/// for a contact at rest.
pub const STUCK_SAMPLES: usize = 20;

/// Samples in a row, placed on the device's time line.
#[derive(Clone, Debug, PartialEq)]
pub struct Samples {
    /// Number of the first sample, counted from the device's start, without wrap.
    pub first: u64,
    /// Samples missing before the first; repeated samples are never handed on.
    pub missing_before: u64,
    /// Device time of the first sample, in µs, without wrap.
    pub time_us: u64,
    /// Time between samples, in µs.
    pub period_us: f64,
    /// The device's status word.
    pub status: Status,
    /// Counts of both channels.
    pub counts: Vec<[Counts; 2]>,
}

/// Shortest time of which the converter's third-order filter makes a value by itself, µs: at an oversampling of 1024 and
/// its clock of 8.192 MHz. At lower rates it averages such values.
const FILTER_PERIOD_MAX_US: f64 = 250.0;

/// How far behind the middle of what it weighs a sample's stamp is, s.
///
/// A sample is stamped when the converter says that it is ready. Its filter weighs the last three periods of up to 250 µs
/// about their middle; at slower rates it averages such values (SBAS853A §8.3.7). So a sample tells of a moment 1.5
/// periods before its stamp at 4 kHz and above, and of half a period and 250 µs before it below.
fn filter_delay_s(period_us: f64) -> f64 {
    (0.5 * period_us + period_us.min(FILTER_PERIOD_MAX_US)) * 1e-6
}

impl Samples {
    /// Device time of sample `index` of this block, in s.
    #[must_use]
    pub fn device_time_s(&self, index: usize) -> f64 {
        (self.time_us as f64 + self.period_us * index as f64) * 1e-6
    }

    /// The moment, in device time, that sample `index` tells of, in s: its stamp less what the converter's filter delays.
    #[must_use]
    pub fn measured_time_s(&self, index: usize) -> f64 {
        self.device_time_s(index) - filter_delay_s(self.period_us)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_filter_delays_by_half_of_what_it_weighs() {
        for (rate_hz, delay_us) in [(16_000.0, 93.75), (4000.0, 375.0), (2000.0, 500.0), (250.0, 2250.0)] {
            assert!((filter_delay_s(1e6 / rate_hz) * 1e6 - delay_us).abs() < 1e-9, "{rate_hz} Hz");
        }
    }
}
