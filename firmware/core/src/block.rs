//! Samples into blocks.
//!
//! A block ends when it is full, before a gap in the numbers, before a change of what holds for the samples,
//! and at a stop. Saturation ends no block: its bits say that *some* sample of the block is saturated.
//! Errors: none.

use palpate_shared::units::Seq;
use palpate_shared::wire::{BLOCK_SAMPLES, Block, Status};

use crate::queues::RawReading;

/// Status bits that are gathered over a block.
const GATHERED: Status = Status(Status::SATURATED_0.0 | Status::SATURATED_1.0);

/// Builds blocks.
///
/// ```
/// use palpate_firmware_core::{block::BlockBuilder, queues::RawReading};
/// use palpate_shared::{units::{Counts, DeviceTime, Seq}, wire::Status};
/// let mut builder = BlockBuilder::new();
/// let sample = |n: u32| RawReading {
///     seq: Seq(n), time: DeviceTime(250 * n), counts: [Counts(7); 2], status: Status::default(),
/// };
/// assert_eq!(builder.push(sample(0)), None);
/// let first = builder.push(sample(5)).unwrap(); // a gap ends the first block
/// assert_eq!((first.first, first.samples.len()), (Seq(0), 1));
/// assert!(builder.finish().unwrap().status.contains(Status::GAP_BEFORE));
/// ```
#[derive(Clone, Debug, Default)]
pub struct BlockBuilder {
    open: Option<Block>,
    /// The number that the next block begins with if nothing is missing.
    expected: Seq,
    /// A finished block did not go out.
    lost: bool,
}

impl BlockBuilder {
    /// A builder that expects sample 0.
    #[must_use]
    pub const fn new() -> Self {
        Self { open: None, expected: Seq(0), lost: false }
    }

    /// Adds a sample; returns the block that it ended, if any.
    pub fn push(&mut self, reading: RawReading) -> Option<Block> {
        let ended = if self.continues(&reading) { None } else { self.finish() };
        self.append(reading);
        let is_full = self.open.as_ref().is_some_and(|block| block.samples.len() >= BLOCK_SAMPLES);
        // A block of one sample is not full, so at most one of the two is a block.
        if is_full { self.finish() } else { ended }
    }

    /// Ends the block under way.
    pub fn finish(&mut self) -> Option<Block> {
        let mut block = self.open.take()?;
        if core::mem::take(&mut self.lost) || block.first != self.expected {
            block.status = block.status.with(Status::GAP_BEFORE);
        }
        self.expected = next_after(&block);
        Some(block)
    }

    /// The block returned last did not go out, so the next one has a gap before it.
    pub fn lost(&mut self) {
        self.lost = true;
    }

    /// Whether a sample belongs to the block under way.
    fn continues(&self, reading: &RawReading) -> bool {
        self.open.as_ref().is_none_or(|block| {
            next_after(block) == reading.seq && ungathered(block.status) == ungathered(reading.status)
        })
    }

    /// Adds a sample to the block under way, or begins one with it.
    fn append(&mut self, reading: RawReading) {
        let RawReading { seq, time, counts, status } = reading;
        let new = || Block { first: seq, time, status, samples: heapless::Vec::new() };
        let block = self.open.get_or_insert_with(new);
        block.status = block.status.with(status);
        // There is room: full blocks are finished at once.
        let _ = block.samples.push(counts);
    }
}

const _: () = assert!(BLOCK_SAMPLES >= 2, "a block of one sample could end two blocks at once");

/// The status bits that hold for each sample alike.
fn ungathered(status: Status) -> u16 {
    status.0 & !GATHERED.0
}

/// The number after a block's last sample.
fn next_after(block: &Block) -> Seq {
    // At most BLOCK_SAMPLES.
    block.first.plus(u32::try_from(block.samples.len()).unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use palpate_shared::units::{Counts, DeviceTime};
    use proptest::prelude::*;

    use super::*;

    fn reading(seq: u32, status: Status) -> RawReading {
        let counts = [Counts(seq.cast_signed() >> 8), Counts(0)];
        RawReading { seq: Seq(seq), time: DeviceTime(seq.wrapping_mul(250)), counts, status }
    }

    #[test]
    fn saturation_marks_its_block_and_does_not_end_it() {
        let mut builder = BlockBuilder::new();
        for seq in 0..8 {
            let status = if seq == 3 { Status::SATURATED_1 } else { Status::default() };
            let block = builder.push(reading(seq, status));
            assert_eq!(block.map(|block| block.status), (seq == 7).then_some(Status::SATURATED_1));
        }
        assert_eq!(builder.finish(), None);
    }

    #[test]
    fn a_block_that_did_not_go_out_is_a_gap_before_the_next() {
        let mut builder = BlockBuilder::new();
        let mut blocks = (0..24).filter_map(|seq| {
            let block = builder.push(reading(seq, Status::default()));
            if seq == 7 {
                builder.lost();
            }
            block
        });
        let has_gap: Vec<bool> = blocks.by_ref().map(|block| block.status.contains(Status::GAP_BEFORE)).collect();
        assert_eq!(has_gap, [false, true, false]);
    }

    proptest! {
        /// Whatever the steps in the numbers and the changes of status: all samples come out once, in order, with
        /// their own status, and a gap is marked exactly where one is. Numbers wrap on the way.
        #[test]
        fn blocks_hold_what_went_in(
            start in any::<u32>(), samples in prop::collection::vec((1_u32..4, 0_u16..3, any::<bool>()), 0..200),
        ) {
            let mut builder = BlockBuilder { expected: Seq(start), ..BlockBuilder::new() };
            let mut seq = start;
            let mut given = Vec::new();
            let mut blocks = Vec::new();
            for (n, (step, kind, saturated)) in samples.into_iter().enumerate() {
                // Mostly in a row.
                seq = seq.wrapping_add(if n % 7 == 0 { step } else { u32::from(n > 0) });
                let kind = [Status::default(), Status::SETTLING, Status::SIMULATED][usize::from(if n % 11 == 0 { kind } else { 0 })];
                let status = if saturated { kind.with(Status::SATURATED_0) } else { kind };
                given.push(reading(seq, status));
                blocks.extend(builder.push(reading(seq, status)));
            }
            blocks.extend(builder.finish());
            let mut left = given.iter();
            let mut next = Seq(start);
            for block in &blocks {
                prop_assert_eq!(block.status.contains(Status::GAP_BEFORE), block.first != next);
                prop_assert!((1..=BLOCK_SAMPLES).contains(&block.samples.len()));
                let mut any_saturated = false;
                for (counts, n) in block.samples.iter().zip(0..) {
                    let one = left.next().unwrap();
                    prop_assert_eq!((block.first.plus(n), *counts), (one.seq, one.counts));
                    prop_assert_eq!(block.status.contains(Status::SETTLING), one.status.contains(Status::SETTLING));
                    prop_assert_eq!(block.status.contains(Status::SIMULATED), one.status.contains(Status::SIMULATED));
                    any_saturated |= one.status.contains(Status::SATURATED_0);
                    if n == 0 {
                        prop_assert_eq!(block.time, one.time);
                    }
                }
                prop_assert_eq!(block.status.contains(Status::SATURATED_0), any_saturated);
                next = next_after(block);
            }
            prop_assert_eq!(left.next(), None);
        }
    }
}
