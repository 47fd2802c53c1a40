//! From the moment a sample was taken to the moment its angle is known.

use std::time::{Duration, Instant};

use palpate::finger::Samples;
use palpate::math::statistics::percentile;
use palpate_device::Session;

/// Most delays kept: half an hour of blocks at 4 kHz.
const DELAYS_MAX: usize = 1_000_000;

/// Delays seen, in s, the first million of them.
///
/// For a simulated device of this process the moment of each sample is known exactly; for any other it is estimated
/// by the clock map, within half a ping's round trip.
#[derive(Clone, Debug, Default)]
pub(crate) struct Latency {
    delays_s: Vec<f64>,
}

impl Latency {
    /// Takes in that what these samples tell was known at `known`.
    pub(crate) fn take(&mut self, session: &Session, samples: &Samples, known: Instant) {
        if self.delays_s.len() == DELAYS_MAX {
            return;
        }
        let last_s = samples.device_time_s(samples.counts.len().saturating_sub(1));
        let taken = match (session.simulated(), session.clock()) {
            (Some(device), _) if session.counts().restarts == 0 => device.epoch() + Duration::from_secs_f64(last_s),
            (_, Some(clock)) => session.epoch() + Duration::from_secs_f64(clock.host_time(last_s).max(0.0)),
            (_, None) => return,
        };
        self.delays_s.push(known.saturating_duration_since(taken).as_secs_f64());
    }

    /// How much later the latest came than the earliest, s; 0 without samples.
    pub(crate) fn spread_s(&self) -> f64 {
        let (earliest, latest) = self
            .delays_s
            .iter()
            .fold((f64::INFINITY, 0.0_f64), |(low, high), &delay| (low.min(delay), high.max(delay)));
        (latest - earliest).max(0.0)
    }

    /// Median, 99th percentile and maximum; `None` without samples.
    pub(crate) fn in_words(&self) -> Option<String> {
        let ms = |per_cent: usize| Some(percentile(self.delays_s.iter().copied(), per_cent)? * 1e3);
        Some(format!(
            "from a block's last sample to its angle: p50 {:.2} ms, p99 {:.2} ms, max {:.2} ms",
            ms(50)?,
            ms(99)?,
            ms(100)?
        ))
    }
}
