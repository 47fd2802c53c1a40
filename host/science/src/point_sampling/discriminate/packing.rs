//! A bound on the columns that a state takes: pairs that no column separates two of take a column each.
//!
//! Three sets take two columns, so such a pair counts for two if a third set of its class can join it: if still no
//! column separates any two of the three sets together with one of the other pairs.

use super::splits::{Splits, pairs_in};

/// The pairs of a state, those that the fewest splits separate first, and the splits, as bits.
#[derive(Debug)]
pub(super) struct Packing<'a> {
    pairs: Vec<u64>,
    splits: &'a Splits,
    allowed: &'a [u64],
}

impl<'a> Packing<'a> {
    /// The pairs in classes that are not single, with the splits allowed.
    pub(super) fn new(classes: &[u64], splits: &'a Splits, allowed: &'a [u64]) -> Self {
        let count = |pair: u64| splits.separating_words(pair, allowed).map(u64::count_ones).sum::<u32>();
        // Count, higher member and lower member in one number: it sorts faster than the three.
        let keyed = |pair: u64| {
            u64::from(count(pair)) << 16 | u64::from(63 - pair.leading_zeros()) << 8 | u64::from(pair.trailing_zeros())
        };
        let mut keys: Vec<u64> = Vec::with_capacity(64);
        keys.extend(classes.iter().flat_map(|&class| pairs_in(class)).map(keyed));
        keys.sort_unstable();
        let pairs = keys.iter().map(|key| 1 << (key >> 8 & 63) | 1 << (key & 63)).collect();
        Self { pairs, splits, allowed }
    }

    /// The pair that the fewest splits separate.
    pub(super) fn scarcest(&self) -> u64 {
        self.pairs.first().copied().unwrap_or(0)
    }

    /// Whether more than `left` columns are needed.
    pub(super) fn exceeds(&self, left: usize) -> bool {
        let (packed, used) = self.pack(self.pairs.iter().copied(), self.allowed, left);
        // A pair that nothing separates is packed, and says it all.
        packed.len() > left
            || packed.first().is_some_and(|&first| self.row(first).all(|word| word == 0))
            || (packed.len() == left && packed.iter().any(|&pair| self.can_grow(pair, &used)))
    }

    /// The splits allowed that separate a pair.
    fn row(&self, pair: u64) -> impl Iterator<Item = u64> {
        self.splits.separating_words(pair, self.allowed)
    }

    /// Whether a third set can join a packed pair.
    fn can_grow(&self, pair: u64, used: &[u64]) -> bool {
        let joins = |&other: &u64| {
            let is_neighbour = (other & pair).count_ones() == 1;
            let mut words = self.splits.separating_words(other, used).zip(self.row(pair));
            is_neighbour && words.all(|(other, own)| other & !own == 0)
        };
        self.pairs.iter().any(joins)
    }

    /// The same once a split with this side is chosen, with fewer splits allowed: without counting anew, so it may find
    /// less.
    pub(super) fn exceeds_after(&self, side: u64, allowed: &[u64], left: usize) -> bool {
        let together = self.pairs.iter().copied().filter(|pair| (pair & side).count_ones() != 1);
        self.pack(together, allowed, left).0.len() > left
    }

    /// Pairs that no split allowed separates two of, taken as they come, up to one more than `left`; and the splits
    /// that separate one.
    fn pack(&self, pairs: impl Iterator<Item = u64>, allowed: &[u64], left: usize) -> (Vec<u64>, Vec<u64>) {
        let (mut packed, mut used) = (Vec::with_capacity(left + 1), vec![0; allowed.len()]);
        for pair in pairs {
            if self.splits.separating_words(pair, &used).all(|word| word == 0) {
                used.iter_mut().zip(self.splits.separating_words(pair, allowed)).for_each(|(used, word)| *used |= word);
                packed.push(pair);
            }
            if packed.len() > left {
                break;
            }
        }
        (packed, used)
    }
}
