//! Sample numbers and device time without wrap, and an exact count of what is missing.
//!
//! The device numbers every conversion with 32 bits and stamps every block with 32 bits of microseconds. Both
//! wrap. Blocks come in order, so each difference to the block before is read as the one nearest to zero.

use palpate_shared::units::{DeviceTime, Seq};

/// What a block's number says about the samples before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// So many samples are missing between the block before and this one; 0 is the normal case.
    Missing(u64),
    /// The block lies before the end of the one before: so many of its samples came already.
    Repeated(u64),
}

/// Where a block stands, counted from the device's start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Number of the block's first sample.
    pub first: u64,
    /// Device time of the block's first sample, in µs.
    pub time_us: u64,
    /// How it joins the block before.
    pub continuity: Continuity,
}

/// Follows the blocks of one device from one start to the next.
#[derive(Clone, Debug, Default)]
pub struct Sequence {
    /// Number after the last sample so far, and time of the last block; `None` before the first.
    last: Option<(u64, u64)>,
    /// Samples received, repeated ones included.
    received: u64,
    /// Samples that never came.
    missing: u64,
    /// Samples received more than once.
    repeated: u64,
}

impl Sequence {
    /// Places the next block and counts what is missing before it.
    pub fn place(&mut self, first: Seq, time: DeviceTime, samples: usize) -> Place {
        let samples = samples as u64;
        let (expected, last_time_us) = self.last.unwrap_or((u64::from(first.0), u64::from(time.0)));
        let first = unwrap_near(expected, first.0);
        let time_us = unwrap_near(last_time_us, time.0);
        let continuity = if first >= expected {
            Continuity::Missing(first - expected)
        } else {
            Continuity::Repeated((expected - first).min(samples))
        };
        match continuity {
            Continuity::Missing(missing) => self.missing += missing,
            Continuity::Repeated(repeated) => self.repeated += repeated,
        }
        self.received += samples;
        self.last = Some((expected.max(first + samples), last_time_us.max(time_us)));
        Place { first, time_us, continuity }
    }

    /// A moment near the last block's time, in µs, without wrap.
    #[must_use]
    pub fn unwrap_time(&self, time: DeviceTime) -> u64 {
        self.last.map_or(u64::from(time.0), |(_, last_time_us)| unwrap_near(last_time_us, time.0))
    }

    /// Device time of the last block, in µs; 0 before the first.
    #[must_use]
    pub fn last_time_us(&self) -> u64 {
        self.last.map_or(0, |(_, last_time_us)| last_time_us)
    }

    /// Samples received so far, repeated ones included.
    #[must_use]
    pub fn received(&self) -> u64 {
        self.received
    }

    /// Samples that never came.
    #[must_use]
    pub fn missing(&self) -> u64 {
        self.missing
    }

    /// Samples that came more than once.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    /// Forgets the place, as after a restart of the device; the counts stay.
    pub fn restart(&mut self) {
        self.last = None;
    }
}

/// The number nearest to `reference` whose lower 32 bits are `low`.
fn unwrap_near(reference: u64, low: u32) -> u64 {
    #[expect(clippy::cast_possible_truncation, reason = "the lower half is wanted")]
    let ahead = low.wrapping_sub(reference as u32).cast_signed();
    reference.saturating_add_signed(i64::from(ahead))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn numbers_and_time_go_on_across_their_wrap() {
        let mut sequence = Sequence::default();
        sequence.place(Seq(u32::MAX - 7), DeviceTime(u32::MAX - 1000), 8);
        let place = sequence.place(Seq(0), DeviceTime(999), 8);
        assert_eq!(place, Place { first: 1 << 32, time_us: (1 << 32) + 999, continuity: Continuity::Missing(0) });
        assert_eq!((sequence.received(), sequence.missing()), (16, 0));
    }

    #[test]
    fn a_repeated_block_is_counted_as_repeated_and_not_as_lost() {
        let mut sequence = Sequence::default();
        sequence.place(Seq(0), DeviceTime(0), 8);
        assert_eq!(sequence.place(Seq(0), DeviceTime(0), 8).continuity, Continuity::Repeated(8));
        assert_eq!(sequence.place(Seq(8), DeviceTime(2000), 8).continuity, Continuity::Missing(0));
        assert_eq!((sequence.repeated(), sequence.missing()), (8, 0));
    }

    proptest! {
        #[test]
        fn every_dropped_sample_is_counted(
            start in any::<u32>(), blocks in prop::collection::vec((1_usize..=8, any::<bool>()), 2..200),
        ) {
            let (mut sequence, mut next) = (Sequence::default(), u64::from(start));
            let (mut sent, mut dropped, mut pending) = (0_u64, 0_u64, None);
            for (samples, arrives) in blocks {
                #[expect(clippy::cast_possible_truncation, reason = "the wire's numbers wrap")]
                let (seq, time) = (Seq(next as u32), DeviceTime((next * 250) as u32));
                if arrives {
                    // Blocks dropped before the first one to arrive, or after the last, leave no trace.
                    dropped += pending.replace(0).unwrap_or(0);
                    sent += samples as u64;
                    let place = sequence.place(seq, time, samples);
                    prop_assert_eq!(place.first, next);
                } else {
                    pending = pending.map(|pending: u64| pending + samples as u64);
                }
                next += samples as u64;
            }
            prop_assert_eq!((sequence.received(), sequence.missing()), (sent, dropped));
        }
    }
}
