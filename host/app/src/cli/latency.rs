//! From the moment a sample was taken to the moment its angle is known.

use std::time::Instant;

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
    /// Delays of the earliest and latest arrival, s.
    arrivals_s: Option<(f64, f64)>,
}

impl Latency {
    /// Takes in that what these samples tell was known at `known`.
    pub(crate) fn take(&mut self, session: &Session, samples: &Samples, known: Instant) {
        let last_s = samples.device_time_s(samples.counts.len().saturating_sub(1));
        let Some(taken) = session.moment(last_s) else { return };
        let arrival_s = session.arrival().saturating_duration_since(taken).as_secs_f64();
        let (earliest, latest) = self.arrivals_s.unwrap_or((arrival_s, arrival_s));
        self.arrivals_s = Some((earliest.min(arrival_s), latest.max(arrival_s)));
        // When a recording is looked at says nothing.
        if self.delays_s.len() < DELAYS_MAX && !session.is_recorded() {
            self.delays_s.push(known.saturating_duration_since(taken).as_secs_f64());
        }
    }

    /// How much later the latest arrived than the earliest, s; 0 without samples.
    pub(crate) fn spread_s(&self) -> f64 {
        self.arrivals_s.map_or(0.0, |(earliest, latest)| latest - earliest)
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
