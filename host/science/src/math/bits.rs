//! Sets of small numbers as bits.

const WORD: usize = u64::BITS as usize;

/// The numbers of words that hold so many bits.
fn words_for(count: usize) -> usize {
    count.div_ceil(WORD)
}

/// A set of numbers below a bound.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct BitSet {
    words: Vec<u64>,
}

/// A set of numbers that lives in a [`BitMatrix`] or [`BitSet`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitRow<'a>(&'a [u64]);

/// Sets of numbers below one bound.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BitMatrix {
    words: Vec<u64>,
    words_per_row: usize,
}

impl<'a> BitRow<'a> {
    /// Whether a number is in the set.
    #[must_use]
    pub fn has(self, number: usize) -> bool {
        self.0[number / WORD] >> (number % WORD) & 1 == 1
    }

    /// Whether there is any number in the set.
    #[must_use]
    pub fn any(self) -> bool {
        self.0.iter().any(|&word| word != 0)
    }

    /// How many numbers are in the set.
    #[must_use]
    pub fn count(self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// The numbers in the set, ascending.
    pub fn iter(self) -> impl Iterator<Item = usize> + 'a {
        let words = self.0.iter().enumerate();
        words.flat_map(|(index, &word)| Bits(word).map(move |bit| index * WORD + bit as usize))
    }

    /// How many numbers are in both sets.
    #[must_use]
    pub fn count_common(self, other: BitRow<'_>) -> usize {
        self.0.iter().zip(other.0).map(|(a, b)| (a & b).count_ones() as usize).sum()
    }

    /// The same numbers, on their own.
    #[must_use]
    pub fn to_set(self) -> BitSet {
        BitSet { words: self.0.to_vec() }
    }

    /// The bits, 64 to a word, the least numbers first.
    pub(crate) fn words(self) -> &'a [u64] {
        self.0
    }
}

impl BitSet {
    /// The empty set of numbers below `bound`.
    #[must_use]
    pub fn new(bound: usize) -> Self {
        Self { words: vec![0; words_for(bound)] }
    }

    /// All numbers below `bound`.
    #[must_use]
    pub fn full(bound: usize) -> Self {
        (0..bound).fold(Self::new(bound), |mut set, number| {
            set.insert(number);
            set
        })
    }

    /// These numbers, which are below `bound`.
    #[must_use]
    pub fn of(bound: usize, numbers: impl IntoIterator<Item = usize>) -> Self {
        numbers.into_iter().fold(Self::new(bound), |mut set, number| {
            set.insert(number);
            set
        })
    }

    /// The set to read.
    #[must_use]
    pub fn row(&self) -> BitRow<'_> {
        BitRow(&self.words)
    }

    /// Adds a number to the set.
    pub fn insert(&mut self, number: usize) {
        self.words[number / WORD] |= 1 << (number % WORD);
    }

    /// Takes a number out.
    pub fn remove(&mut self, number: usize) {
        self.words[number / WORD] &= !(1 << (number % WORD));
    }

    /// Keeps what is in the other set too.
    pub(crate) fn keep(&mut self, other: BitRow<'_>) {
        self.words.iter_mut().zip(other.0).for_each(|(word, other)| *word &= other);
    }

    /// Takes out what is in the other set.
    pub(crate) fn drop_all(&mut self, other: BitRow<'_>) {
        self.words.iter_mut().zip(other.0).for_each(|(word, other)| *word &= !other);
    }

    /// Takes out what is in the other set and adds what only that has.
    pub(crate) fn toggle(&mut self, other: BitRow<'_>) {
        self.words.iter_mut().zip(other.0).for_each(|(word, other)| *word ^= other);
    }
}

impl BitMatrix {
    /// Empty sets of numbers below `columns`.
    #[must_use]
    pub fn new(rows: usize, columns: usize) -> Self {
        let words_per_row = words_for(columns).max(1);
        Self { words: vec![0; rows * words_per_row], words_per_row }
    }

    /// One of the sets.
    #[must_use]
    pub fn row(&self, row: usize) -> BitRow<'_> {
        BitRow(&self.words[row * self.words_per_row..(row + 1) * self.words_per_row])
    }

    /// Takes a number out of a set that has it, or adds it.
    pub fn flip(&mut self, row: usize, column: usize) {
        self.words[row * self.words_per_row + column / WORD] ^= 1 << (column % WORD);
    }

    /// Makes one set equal to another.
    pub(crate) fn copy_row(&mut self, from: usize, to: usize) {
        let width = self.words_per_row;
        self.words.copy_within(from * width..(from + 1) * width, to * width);
    }
}

/// The bits of a word, lowest first.
#[derive(Clone, Debug)]
pub(crate) struct Bits(pub(crate) u64);

impl Iterator for Bits {
    type Item = u32;

    #[inline]
    fn next(&mut self) -> Option<u32> {
        let lowest = self.0.trailing_zeros();
        (self.0 != 0).then(|| {
            self.0 &= self.0 - 1;
            lowest
        })
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bits_are_a_set(numbers in proptest::collection::btree_set(0..200_usize, 0..30), other in proptest::collection::btree_set(0..200_usize, 0..30)) {
            let [a, b] = [&numbers, &other].map(|set| BitSet::of(200, set.iter().copied()));
            prop_assert_eq!(a.row().iter().collect::<BTreeSet<_>>(), numbers.clone());
            prop_assert_eq!(a.row().count(), numbers.len());
            prop_assert_eq!(a.row().count_common(b.row()), numbers.intersection(&other).count());
            let changed = |change: fn(&mut BitSet, BitRow<'_>)| {
                let mut set = a.clone();
                change(&mut set, b.row());
                set.row().iter().collect::<BTreeSet<_>>()
            };
            prop_assert_eq!(changed(BitSet::keep), numbers.intersection(&other).copied().collect());
            prop_assert_eq!(changed(BitSet::drop_all), numbers.difference(&other).copied().collect());
            prop_assert_eq!(changed(BitSet::toggle), numbers.symmetric_difference(&other).copied().collect());
        }

        #[test]
        fn rows_of_a_matrix_do_not_touch_each_other(row in 0..5_usize, column in 0..130_usize) {
            let mut matrix = BitMatrix::new(5, 130);
            matrix.flip(row, column);
            for other in 0..5 {
                prop_assert_eq!(matrix.row(other).count(), usize::from(other == row));
            }
            prop_assert!(matrix.row(row).has(column));
            matrix.copy_row(row, 4 - row);
            prop_assert!(matrix.row(4 - row).has(column));
        }
    }
}
