//! Sample numbers and device time without wrap, and an exact count of what is missing.
//!
//! The device numbers every conversion with 32 bits and stamps every block with 32 bits of microseconds. Both
//! wrap. Blocks come in order, so each difference to the block before is read as the one nearest to zero.
//!
//! A block that repeats another is dropped. One whose number neither follows nor repeats is held back until the next
//! tells what it was: a stray, if that follows the blocks before; the first of a device that began to count anew
//! without saying so, if that follows it. So no block, however wrong its number, spoils the place for those after it.

use std::collections::VecDeque;

use palpate_shared::units::{DeviceTime, Seq};

/// Blocks that are remembered, to know one that comes again: 128 ms at 4 kHz, longer than any driver's buffer.
const REMEMBERED: usize = 64;

/// No device samples faster, in Hz: the ADS131M02's limit. Numbers that ran ahead of the device's time by more than
/// this allows are not believed until a second block agrees.
const FASTEST_HZ: u64 = 32_000;

/// What a block's number says about the samples before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Continuity {
    /// So many samples are missing between the block before and this one; 0 is the normal case.
    Missing(u64),
    /// The block lies before the end of the one before: so many of its samples came already.
    Repeated(u64),
    /// The number cannot be right, or the device counts anew: nothing of the block can be used. The next one tells.
    Strange,
    /// The second block in a row that begins before the end of those before and is not one of them: the device counts
    /// anew. Nothing of it can be used until it is known what the device is now.
    Anew,
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

/// A block that was set aside.
#[derive(Clone, Copy, Debug)]
struct HeldBack {
    /// Number after its last sample, as the wire has it.
    next: Seq,
    time: DeviceTime,
    samples: u64,
    /// Whether it began before the end of those before it.
    is_behind: bool,
}

/// Follows the blocks of one device from one start to the next.
#[derive(Clone, Debug, Default)]
pub struct Sequence {
    /// Number that the next block begins with if nothing is missing; `None` where any may.
    next: Option<u64>,
    /// Time of the last block, in µs; `None` before the first, unless it is known to be after 0.
    last_time_us: Option<u64>,
    /// The last blocks' first numbers and times.
    recent: VecDeque<(Seq, DeviceTime)>,
    held_back: Option<HeldBack>,
    /// Samples received, repeated ones included.
    received: u64,
    /// Samples that never came.
    missing: u64,
    /// Samples received more than once.
    repeated: u64,
    /// Blocks whose numbers were wrong.
    strays: u64,
}

impl Sequence {
    /// Places the next block and counts what is missing before it.
    pub fn place(&mut self, first: Seq, time: DeviceTime, samples: usize) -> Place {
        let samples = samples as u64;
        let next = self.next.unwrap_or_else(|| u64::from(first.0));
        let last_time_us = self.last_time_us.unwrap_or_else(|| u64::from(time.0));
        let place = Place {
            first: unwrap_near(next, first.0),
            time_us: unwrap_near(last_time_us, time.0),
            continuity: Continuity::Missing(0),
        };
        let continuity = self.continuity(place, next, (first, time), samples);
        match continuity {
            Continuity::Missing(missing) => self.missing += missing,
            Continuity::Repeated(repeated) => self.repeated += repeated,
            Continuity::Strange | Continuity::Anew => return Place { continuity, ..place },
        }
        self.tell_held_back();
        self.received += samples;
        self.next = Some(next.max(place.first + samples));
        self.last_time_us = Some(last_time_us.max(place.time_us));
        self.recent.truncate(REMEMBERED - 1);
        self.recent.push_front((first, time));
        Place { continuity, ..place }
    }

    /// A time of the device in µs, without wrap: the one nearest to the last block's.
    #[must_use]
    pub fn time_us(&self, time: DeviceTime) -> u64 {
        unwrap_near(self.last_time_us.unwrap_or_else(|| u64::from(time.0)), time.0)
    }

    /// How a block joins those before it, of which `next` would be the next number.
    fn continuity(&mut self, place: Place, next: u64, wire: (Seq, DeviceTime), samples: u64) -> Continuity {
        if let Some(ahead) = place.first.checked_sub(next) {
            let elapsed_us = self.last_time_us.map(|last_time_us| place.time_us.saturating_sub(last_time_us));
            let is_in_time = elapsed_us.is_none_or(|elapsed_us| ahead <= samples_in(elapsed_us));
            // A second block that agrees with a number out of all proportion makes it the device's word.
            if is_in_time || self.follows_held_back(wire) {
                return Continuity::Missing(ahead);
            }
            self.hold_back(wire, samples, false);
            return Continuity::Strange;
        }
        if place.first + samples > next || self.recent.contains(&wire) {
            return Continuity::Repeated((next - place.first).min(samples));
        }
        if self.follows_held_back(wire) {
            self.held_back = None;
            return Continuity::Anew;
        }
        self.hold_back(wire, samples, true);
        Continuity::Strange
    }

    /// Whether a block is what comes after the one set aside, as far as its number and time tell.
    fn follows_held_back(&self, (first, time): (Seq, DeviceTime)) -> bool {
        self.held_back.is_some_and(|held| {
            let (ahead, elapsed_us) = (u64::from(first.since(held.next)), u64::from(time.since(held.time)));
            // Half of the wrap: nearer from behind.
            elapsed_us < 1 << 31 && ahead <= samples_in(elapsed_us)
        })
    }

    fn hold_back(&mut self, (first, time): (Seq, DeviceTime), samples: u64, is_behind: bool) {
        self.tell_held_back();
        let next = first.plus(u32::try_from(samples).unwrap_or(0));
        self.held_back = Some(HeldBack { next, time, samples, is_behind });
    }

    /// Counts the block set aside as what it was: late, or with a wrong number.
    fn tell_held_back(&mut self) {
        match self.held_back.take() {
            Some(held) if held.is_behind => {
                self.received += held.samples;
                self.repeated += held.samples;
            }
            Some(_) => self.strays += 1,
            None => {}
        }
    }

    /// A moment near the last block's time, in µs, without wrap.
    #[must_use]
    pub fn unwrap_time(&self, time: DeviceTime) -> u64 {
        self.last_time_us.map_or(u64::from(time.0), |last_time_us| unwrap_near(last_time_us, time.0))
    }

    /// Device time of the last block, in µs; 0 before the first.
    #[must_use]
    pub fn last_time_us(&self) -> u64 {
        self.last_time_us.unwrap_or(0)
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

    /// Samples that came more than once, or too late.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    /// Blocks that were dropped because their numbers cannot be right.
    #[must_use]
    pub fn strays(&self) -> u64 {
        self.strays
    }

    /// Whether it is not known with which number the next block should begin.
    #[must_use]
    pub fn is_open(&self) -> bool {
        self.next.is_none()
    }

    /// Forgets the place: the next block may have any number. The counts stay.
    pub fn forget(&mut self) {
        self.tell_held_back();
        (self.next, self.last_time_us) = (None, None);
        self.recent.clear();
    }

    /// The device started anew, so that numbers and time begin at 0; what is missing before its first block was lost.
    /// The counts stay.
    pub fn begin_anew(&mut self) {
        self.forget();
        (self.next, self.last_time_us) = (Some(0), Some(0));
    }

    /// The next sample that the device takes will have this number.
    pub fn expect(&mut self, next: Seq) {
        self.forget();
        self.next = Some(u64::from(next.0));
    }
}

/// So many samples a device can have taken in this time, at most.
fn samples_in(elapsed_us: u64) -> u64 {
    elapsed_us * FASTEST_HZ / 1_000_000
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

    /// A block of eight samples at 4 kHz that begins with this number.
    fn place(sequence: &mut Sequence, number: u32) -> Continuity {
        sequence.place(Seq(number), DeviceTime(number.wrapping_mul(250)), 8).continuity
    }

    #[test]
    fn what_was_lost_before_the_first_block_is_counted_where_the_number_is_known() {
        let mut sequence = Sequence::default();
        assert_eq!(place(&mut sequence, 800), Continuity::Missing(0), "an earlier host's samples are not missing");
        sequence.begin_anew();
        assert_eq!(place(&mut sequence, 800), Continuity::Missing(800));
        sequence.expect(Seq(1000));
        assert_eq!(place(&mut sequence, 1016), Continuity::Missing(16));
        assert_eq!((sequence.missing(), sequence.received()), (816, 24));
    }

    #[test]
    fn one_block_far_ahead_costs_nothing_but_itself() {
        for ahead in [(1 << 31) - 1, 1 << 31, 1_000_000, u32::MAX - 16] {
            let mut sequence = Sequence::default();
            place(&mut sequence, 0);
            let wrong = sequence.place(Seq(8 + ahead), DeviceTime(2000), 8);
            assert_eq!(wrong.continuity, Continuity::Strange, "{ahead}");
            for number in (16..1000).step_by(8) {
                let continuity = place(&mut sequence, number);
                assert_eq!(continuity, Continuity::Missing(if number == 16 { 8 } else { 0 }), "{ahead}");
            }
            assert_eq!((sequence.missing(), sequence.received() - sequence.repeated()), (8, 124 * 8));
        }
    }

    #[test]
    fn two_blocks_far_ahead_are_believed() {
        let mut sequence = Sequence::default();
        place(&mut sequence, 0);
        let ahead = 1 << 30;
        assert_eq!(sequence.place(Seq(ahead), DeviceTime(2000), 8).continuity, Continuity::Strange);
        let second = sequence.place(Seq(ahead + 8), DeviceTime(4000), 8);
        assert_eq!(second.continuity, Continuity::Missing(u64::from(ahead)));
        assert_eq!(sequence.place(Seq(ahead + 16), DeviceTime(6000), 8).continuity, Continuity::Missing(0));
    }

    #[test]
    fn a_device_that_counts_anew_without_a_word_is_noticed_at_its_second_block() {
        let mut sequence = Sequence::default();
        (0..24_000).step_by(8).for_each(|number| assert_eq!(place(&mut sequence, number), Continuity::Missing(0)));
        assert_eq!(place(&mut sequence, 0), Continuity::Strange);
        assert_eq!(place(&mut sequence, 8), Continuity::Anew);
        sequence.begin_anew();
        assert_eq!(place(&mut sequence, 16), Continuity::Missing(16));
        assert_eq!((sequence.repeated(), sequence.strays()), (0, 0));
    }

    #[test]
    fn a_whole_read_that_comes_twice_is_repeated_and_nothing_new() {
        let mut sequence = Sequence::default();
        (0..400).step_by(8).for_each(|number| _ = place(&mut sequence, number));
        (80..400).step_by(8).for_each(|number| assert_eq!(place(&mut sequence, number), Continuity::Repeated(8)));
        assert_eq!(place(&mut sequence, 400), Continuity::Missing(0));
        assert_eq!((sequence.repeated(), sequence.missing()), (320, 0));
    }

    #[test]
    fn one_late_block_is_dropped_and_the_rest_goes_on() {
        let mut sequence = Sequence::default();
        let _ = [0, 16, 24].map(|number| place(&mut sequence, number));
        assert_eq!(place(&mut sequence, 8), Continuity::Strange);
        assert_eq!(place(&mut sequence, 32), Continuity::Missing(0));
        assert_eq!((sequence.missing(), sequence.repeated(), sequence.strays()), (8, 8, 0));
    }

    #[test]
    fn a_host_that_slept_for_an_hour_believes_the_second_block() {
        let mut sequence = Sequence::default();
        place(&mut sequence, 0);
        // Time has wrapped unseen; the numbers have not.
        let slept = 3600 * 4000;
        assert_eq!(place(&mut sequence, slept), Continuity::Strange);
        assert_eq!(place(&mut sequence, slept + 8), Continuity::Missing(u64::from(slept)));
    }

    proptest! {
        /// Whatever number one block has, of a hundred sound ones none but the next is lost to it.
        #[test]
        fn a_block_with_any_number_spoils_nothing(at in 1_u32..99, number in any::<u32>(), samples in 0_usize..=8) {
            let mut sequence = Sequence::default();
            let mut used = 0;
            for block in 0..100 {
                if block == at {
                    sequence.place(Seq(number), DeviceTime(2000 * block), samples);
                }
                used += u32::from(matches!(place(&mut sequence, 8 * block), Continuity::Missing(_)));
            }
            prop_assert!(used >= 98, "{used} of 100");
        }

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
