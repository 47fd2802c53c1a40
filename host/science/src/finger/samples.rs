//! Samples in a row, as a device numbers and times them.

use palpate_shared::status::Status;
use palpate_shared::units::Counts;

/// Samples in a row, placed on the device's time line.
#[derive(Clone, Debug)]
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
