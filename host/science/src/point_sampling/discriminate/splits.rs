//! The ways in which columns split classes of sets, 64 of them in a word.

use std::ops::Index;

use super::partition::{number, parts};
use crate::math::bits::Bits;

/// A way to split the classes of a state, and a column that does it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Split {
    /// In each class, the side without the class's least member.
    pub side: u64,
    pub column: u32,
}

/// The different splits of some classes that leave no part too large.
pub(super) fn distinct(classes: &[u64], splits: &[Split], left: usize) -> Vec<Split> {
    let largest = 1_u64.checked_shl(number(left - 1)).unwrap_or(u64::MAX);
    let rewritten = splits.iter().filter_map(|split| {
        let mut side = 0;
        for &class in classes {
            let within = split.side & class;
            let has_least = within & class & class.wrapping_neg() != 0;
            let part = if has_least { class & !within } else { within };
            if u64::from(part.count_ones().max((class & !part).count_ones())) > largest {
                return None;
            }
            side |= part;
        }
        (side != 0).then_some(Split { side, ..*split })
    });
    let mut rewritten: Vec<_> = rewritten.collect();
    rewritten.sort_unstable();
    rewritten.dedup_by_key(|split| split.side);
    rewritten
}

/// Splits, and for each set those that have it on their side.
#[derive(Debug)]
pub(super) struct Splits {
    splits: Vec<Split>,
    /// For each 64 splits a word for each set.
    rows: Vec<[u64; 64]>,
}

impl Index<usize> for Splits {
    type Output = Split;

    fn index(&self, place: usize) -> &Split {
        &self.splits[place]
    }
}

impl Splits {
    pub(super) fn new(splits: Vec<Split>) -> Self {
        let rows = splits.chunks(64).map(|chunk| {
            let mut words = [0; 64];
            words.iter_mut().zip(chunk).for_each(|(word, split)| *word = split.side);
            transpose(&mut words);
            words
        });
        Self { rows: rows.collect(), splits }
    }

    /// All of them, as bits.
    pub(super) fn all(&self) -> Vec<u64> {
        let mut all = vec![u64::MAX; self.rows.len()];
        if let Some(last) = all.last_mut() {
            *last >>= 64 * self.rows.len() - self.splits.len();
        }
        all
    }

    /// The splits whose bits are set.
    pub(super) fn among(&self, allowed: &[u64]) -> Vec<Split> {
        places(allowed.iter().copied()).map(|place| self.splits[place]).collect()
    }

    /// Those allowed that separate a pair.
    pub(super) fn separating(&self, pair: u64, allowed: &[u64]) -> impl Iterator<Item = usize> {
        places(self.separating_words(pair, allowed))
    }

    /// The same, as bits.
    pub(super) fn separating_words(&self, pair: u64, allowed: &[u64]) -> impl Iterator<Item = u64> {
        self.rows.iter().zip(allowed).map(move |(rows, allowed)| allowed & separating(rows, pair))
    }

    /// Those allowed that leave no part with more than 2^(left − 1) members of classes with up to 2^left.
    pub(super) fn fitting(&self, classes: &[u64], allowed: &[u64], left: usize) -> Vec<u64> {
        match left {
            1 => self.fitting_counted::<1>(classes, allowed),
            2 => self.fitting_counted::<2>(classes, allowed),
            3 => self.fitting_counted::<3>(classes, allowed),
            4 => self.fitting_counted::<4>(classes, allowed),
            5 => self.fitting_counted::<5>(classes, allowed),
            6 => self.fitting_counted::<6>(classes, allowed),
            _ => allowed.to_vec(),
        }
    }

    /// The same, counting with numbers of `LEFT` bits. That all of 2^LEFT members are on a side is then taken for none,
    /// which does not fit either.
    fn fitting_counted<const LEFT: usize>(&self, classes: &[u64], allowed: &[u64]) -> Vec<u64> {
        let half = 1 << (LEFT - 1);
        let large: Vec<u64> = classes.iter().copied().filter(|class| class.count_ones() > half).collect();
        let fitting = self.rows.iter().zip(allowed).map(|(rows, &allowed)| {
            let fits = |fitting: u64, &class: &u64| {
                let count: [u64; LEFT] = count_on_side(rows, class);
                fitting & at_least(&count, class.count_ones() - half) & !at_least(&count, half + 1)
            };
            large.iter().fold(allowed, fits)
        });
        fitting.collect()
    }

    /// Whether one or two of those allowed, all of which fit, split all classes; adds their columns to those chosen.
    pub(super) fn last(&self, classes: &[u64], fitting: &[u64], left: usize, chosen: &mut Vec<u32>) -> bool {
        let live: Vec<(usize, u64)> = fitting.iter().copied().enumerate().filter(|&(_, word)| word != 0).collect();
        let splitting_all = |pairs: &[u64]| {
            live.iter().find_map(|&(chunk, word)| {
                let word = pairs.iter().fold(word, |word, &pair| word & separating(&self.rows[chunk], pair));
                (word != 0).then(|| self.splits[64 * chunk + word.trailing_zeros() as usize])
            })
        };
        if left == 1 {
            return splitting_all(&[]).inspect(|split| chosen.push(split.column)).is_some();
        }
        let count = |pair: u64| self.separating_words(pair, fitting).map(u64::count_ones).sum::<u32>();
        let Some(scarcest) = classes.iter().flat_map(|&class| pairs_in(class)).min_by_key(|&pair| count(pair)) else {
            return true;
        };
        self.separating(scarcest, fitting).any(|place| {
            let first = self.splits[place];
            let pairs: Vec<u64> = classes.iter().flat_map(|&class| parts(class, first.side)).collect();
            splitting_all(&pairs).inspect(|second| chosen.extend([first.column, second.column])).is_some()
        })
    }
}

/// For 64 splits at once how many members of a class are on their side: the numbers' bits, lowest first.
fn count_on_side<const BITS: usize>(rows: &[u64; 64], class: u64) -> [u64; BITS] {
    let mut count = [0; BITS];
    for set in Bits(class) {
        let mut carry = rows[set as usize];
        for bit in &mut count {
            (*bit, carry) = (*bit ^ carry, *bit & carry);
        }
    }
    count
}

/// Where numbers, given by their bits, are at least so large.
fn at_least<const BITS: usize>(numbers: &[u64; BITS], least: u32) -> u64 {
    if least >> BITS != 0 {
        return 0;
    }
    let (mut larger, mut equal) = (0, u64::MAX);
    for (place, bit) in numbers.iter().enumerate().rev() {
        if least >> place & 1 == 1 {
            equal &= bit;
        } else {
            larger |= equal & bit;
            equal &= !bit;
        }
    }
    larger | equal
}

/// The splits, of 64, that separate a pair.
fn separating(rows: &[u64; 64], pair: u64) -> u64 {
    rows[pair.trailing_zeros() as usize] ^ rows[63 - pair.leading_zeros() as usize]
}

/// The places of bits in words.
fn places(words: impl Iterator<Item = u64>) -> impl Iterator<Item = usize> {
    words.enumerate().flat_map(|(chunk, word)| Bits(word).map(move |bit| 64 * chunk + bit as usize))
}

/// The pairs of members of a class, as masks.
pub(super) fn pairs_in(class: u64) -> impl Iterator<Item = u64> {
    Bits(class).flat_map(move |high| Bits(class & ((1 << high) - 1)).map(move |low| 1 << high | 1 << low))
}

/// Swaps rows and columns of a matrix of bits: its quarters, then theirs, down to single bits.
fn transpose(words: &mut [u64; 64]) {
    let mut width = 32;
    let mut mask = u64::MAX >> 32;
    while width > 0 {
        for low in (0..64).filter(|row| row & width == 0) {
            let swapped = ((words[low] >> width) ^ words[low + width]) & mask;
            words[low] ^= swapped << width;
            words[low + width] ^= swapped;
        }
        width /= 2;
        mask ^= mask << width;
    }
}
