//! Whether so many columns are enough, by search over partitions: for dense scenes, where few points tell many polygons
//! apart.
//!
//! A state is the classes of sets not yet told apart, and the columns that may still be chosen. With `r` columns to go
//! it is hopeless if a class has more than 2^r members, if the `r` columns that separate most separate too little, or
//! if pairs that no column separates two of are more than `r` (`packing`). Otherwise some pair has fewest columns that
//! separate it, one of which must be chosen: each is tried, and left out of what is tried after it. Columns that split
//! all classes alike count once; which leave no class too large is found for 64 at a time, and so are the last two
//! (`splits`).
//!
//! Masks of 64 bits hold the sets, so at most 64 can be told apart here.

use super::packing::Packing;
use super::splits::{Split, Splits, distinct};
use super::system::Columns;
use crate::search::Stop;

/// Sets that fit a mask.
pub(super) const SETS_MAX: usize = 64;

/// With fewer columns to go what columns separate is not summed up: packing finds nearly all that this would, in less
/// time.
const SUM_FROM: usize = 5;

/// What a search came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Outcome {
    /// These columns are enough.
    Found(Vec<usize>),
    /// No so many columns are enough.
    Refuted,
    /// The search was broken off.
    Open,
}

/// What is tried first at a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Order {
    /// The splits that separate most pairs: to find a choice soon.
    Most,
    /// Those that separate fewest, which are refuted soonest, so that the others are tried without them: to refute all
    /// soon.
    Fewest,
}

/// The search with what it has chosen so far.
pub(super) struct Partition<'a> {
    /// States that may still be looked at.
    budget: u64,
    order: Order,
    stop: Stop<'a>,
    /// States looked at so far.
    pub states: u64,
    chosen: Vec<u32>,
}

impl<'a> Partition<'a> {
    pub(super) fn new(budget: u64, order: Order, stop: Stop<'a>) -> Self {
        Self { budget, order, stop, states: 0, chosen: Vec::new() }
    }

    /// Whether `size` columns are enough to separate all sets, of which there are at most [`SETS_MAX`].
    pub(super) fn search(&mut self, columns: &Columns, size: usize) -> Outcome {
        let mask = |column: usize| columns.sides[column].row().words().first().copied().unwrap_or(0);
        let splits: Vec<_> =
            (0..columns.len()).map(|column| Split { side: mask(column), column: number(column) }).collect();
        let all = if columns.sets == SETS_MAX { u64::MAX } else { (1 << columns.sets) - 1 };
        let classes = if columns.sets > 1 { vec![all] } else { Vec::new() };
        self.chosen.clear();
        match self.descend(&classes, &splits, size) {
            Some(true) => Outcome::Found(self.chosen.iter().map(|&column| column as usize).collect()),
            Some(false) => Outcome::Refuted,
            None => Outcome::Open,
        }
    }

    /// Whether `left` more columns are enough; none if the search was broken off.
    fn descend(&mut self, classes: &[u64], splits: &[Split], left: usize) -> Option<bool> {
        if classes.is_empty() {
            return Some(true);
        }
        if are_too_large(classes, left) {
            return Some(false);
        }
        let splits = distinct(classes, splits, left);
        if left >= SUM_FROM && !enough(classes, &splits, left) {
            return Some(false);
        }
        let splits = Splits::new(splits);
        let all = splits.all();
        if left <= 2 {
            return Some(splits.last(classes, &splits.fitting(classes, &all, left), left, &mut self.chosen));
        }
        let packing = Packing::new(classes, &splits, &all);
        if packing.exceeds(left) { Some(false) } else { self.branch(classes, &splits, &packing, left) }
    }

    /// Tries every split that separates the scarcest pair.
    fn branch(&mut self, classes: &[u64], splits: &Splits, packing: &Packing, left: usize) -> Option<bool> {
        let mut allowed = splits.all();
        let mut tried: Vec<usize> = splits.separating(packing.scarcest(), &allowed).collect();
        tried.sort_by_key(|&place| gain(classes, splits[place].side));
        if self.order == Order::Most {
            tried.reverse();
        }
        for place in tried {
            let split = splits[place];
            allowed[place / 64] &= !(1 << (place % 64));
            self.count_state()?;
            let finer: Vec<u64> = classes.iter().flat_map(|class| parts(*class, split.side)).collect();
            let fitting = splits.fitting(&finer, &allowed, left - 1);
            // The pairs in the order that is known already are enough in most states.
            if packing.exceeds_after(split.side, &fitting, left - 1)
                || Packing::new(&finer, splits, &fitting).exceeds(left - 1)
            {
                continue;
            }
            self.chosen.push(split.column);
            let found = if left == 3 {
                splits.last(&finer, &fitting, 2, &mut self.chosen)
            } else {
                self.descend(&finer, &splits.among(&fitting), left - 1)?
            };
            if found {
                return Some(true);
            }
            self.chosen.pop();
        }
        Some(false)
    }

    /// None if the search is to be broken off.
    fn count_state(&mut self) -> Option<()> {
        self.states += 1;
        let over = self.states > self.budget || (self.states.is_multiple_of(256) && self.stop.stops());
        (!over).then_some(())
    }
}

/// Whether some class has too many members for so many columns.
fn are_too_large(classes: &[u64], left: usize) -> bool {
    classes.iter().any(|class| log2_ceil(class.count_ones()) > left)
}

/// The parts of a class with more than one member.
pub(super) fn parts(class: u64, side: u64) -> impl Iterator<Item = u64> {
    [class & side, class & !side].into_iter().filter(|part| part.count_ones() > 1)
}

/// The least number of bits that tell so many apart.
pub(in crate::point_sampling) fn log2_ceil(count: u32) -> usize {
    (u32::BITS - count.saturating_sub(1).leading_zeros()) as usize
}

/// Whether the `left` columns that separate most could separate all that is left.
fn enough(classes: &[u64], splits: &[Split], left: usize) -> bool {
    let open: u32 = classes.iter().map(|class| distances(class.count_ones(), left)).sum();
    let mut gains: Vec<u32> = splits.iter().map(|split| gain(classes, split.side)).collect();
    gains.sort_unstable_by(|a, b| b.cmp(a));
    gains.iter().take(left).sum::<u32>() >= open
}

/// The pairs in classes that a split separates.
fn gain(classes: &[u64], side: u64) -> u32 {
    classes.iter().map(|class| (class & side).count_ones() * (class & !side).count_ones()).sum()
}

/// The least sum of distances between all pairs of so many different codes of `bits` bits.
///
/// More than the number of pairs, because codes at distance 1 from each other are few, and much more where few codes
/// are left out. If that are `t` of 2H, and `j` of these have a bit set, then the bit adds (H − j)(H − t + j) = H (H −
/// t) + j (t − j): the first for every bit, and the second sums up to the distances of those left out.
pub(super) fn distances(count: u32, bits: usize) -> u32 {
    let half = 1_u64.checked_shl(number(bits.saturating_sub(1))).unwrap_or(u64::MAX);
    let any_bits = distances_of_any(count);
    match u32::try_from(half) {
        Ok(half) if bits > 0 && count > half && count <= 2 * half => {
            let without = 2 * half - count;
            any_bits.max(number(bits) * half * (half - without) + distances(without, bits))
        }
        _ => any_bits,
    }
}

/// The same for codes of any number of bits. Up to 8 exact, by exhaustion over partitions (see the test). Beyond, a
/// bound: with every bit turned so that fewer codes have it set, the codes' weights sum up to `count − 1` at least, and
/// a bit set in `k` codes adds `k (count − k)`, which for given sum is least where bits are set in none or in half.
fn distances_of_any(count: u32) -> u32 {
    const EXACT: [u32; 9] = [0, 0, 1, 4, 8, 16, 25, 36, 48];
    if let Some(&exact) = EXACT.get(count as usize) {
        return exact;
    }
    let half = count / 2;
    let (full, rest) = ((count - 1) / half, (count - 1) % half);
    (full * half * (count - half) + rest * (count - rest)).max(count * (count - 1) / 2)
}

pub(super) fn number(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}
