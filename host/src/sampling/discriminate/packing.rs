//! A bound on the columns that a state takes: pairs that no column separates two of take a column each.
//!
//! Three sets take two columns, so such a pair counts for two if a third set of its class can join it: if still no column
//! separates any two of the three sets together with one of the other pairs.

use super::splits::{Splits, pairs_in};

/// The pairs of a state, those that the fewest splits separate first, and the splits, as bits.
#[derive(Debug)]
pub(super) struct Packing {
    pairs: Vec<u64>,
    /// For each pair `width` words.
    separating: Vec<u64>,
    width: usize,
}

impl Packing {
    /// The pairs in classes that are not single, with the splits allowed.
    pub(super) fn new(classes: &[u64], splits: &Splits, allowed: &[u64]) -> Self {
        let words = |pair: u64| splits.separating_words(pair, allowed);
        let counted = classes.iter().flat_map(|&class| pairs_in(class));
        let mut counted: Vec<(u32, u64)> = counted.map(|pair| (words(pair).map(u64::count_ones).sum(), pair)).collect();
        counted.sort_unstable();
        let pairs: Vec<u64> = counted.into_iter().map(|(_, pair)| pair).collect();
        Self { separating: pairs.iter().flat_map(|&pair| words(pair)).collect(), width: allowed.len(), pairs }
    }

    /// The pair that the fewest splits separate.
    pub(super) fn scarcest(&self) -> u64 {
        self.pairs.first().copied().unwrap_or(0)
    }

    /// Whether more than `left` columns are needed.
    pub(super) fn exceeds(&self, left: usize) -> bool {
        let mut used = vec![0; self.width];
        let mut packed = Vec::with_capacity(left + 1);
        for place in 0..self.pairs.len() {
            let row = self.row(place);
            if row.iter().zip(&used).all(|(row, used)| row & used == 0) {
                used.iter_mut().zip(row).for_each(|(used, row)| *used |= row);
                packed.push(place);
            }
            if packed.len() > left {
                return true;
            }
        }
        // A pair that nothing separates is packed, and says it all.
        packed.first().is_some_and(|&first| self.row(first).iter().all(|&word| word == 0))
            || (packed.len() == left && packed.iter().any(|&place| self.can_grow(place, &used)))
    }

    fn row(&self, place: usize) -> &[u64] {
        &self.separating[place * self.width..(place + 1) * self.width]
    }

    /// Whether a third set can join a packed pair.
    fn can_grow(&self, place: usize, used: &[u64]) -> bool {
        let pair = self.pairs[place];
        let joins = |other: usize| {
            let is_neighbour = (self.pairs[other] & pair).count_ones() == 1;
            let mut words = self.row(other).iter().zip(self.row(place)).zip(used);
            is_neighbour && words.all(|((other, own), used)| other & used & !own == 0)
        };
        (0..self.pairs.len()).any(joins)
    }

    /// The same once a split with this side is chosen, with fewer splits allowed: without counting anew, so it may find less.
    pub(super) fn exceeds_after(&self, side: u64, splits: &Splits, allowed: &[u64], left: usize) -> bool {
        let mut used = vec![0; self.width];
        let mut packed = 0;
        for &pair in self.pairs.iter().filter(|&&pair| (pair & side).count_ones() != 1) {
            if splits.separating_words(pair, &used).all(|word| word == 0) {
                used.iter_mut().zip(splits.separating_words(pair, allowed)).for_each(|(used, word)| *used |= word);
                packed += 1;
            }
            if packed > left {
                return true;
            }
        }
        false
    }
}
