//! What a finger's converter gives, before anybody says what it means: samples in a row, as a device numbers and times
//! them.
//!
//! Knows device time only: no clock of the host, no link. Who needs to know when a block arrived asks the session.
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

impl Samples {
    /// Device time of sample `index` of this block, in s.
    #[must_use]
    pub fn device_time_s(&self, index: usize) -> f64 {
        (self.time_us as f64 + self.period_us * index as f64) * 1e-6
    }
}
