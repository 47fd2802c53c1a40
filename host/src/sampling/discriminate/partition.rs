//! Whether so many columns are enough, by search over partitions: for dense scenes, where few points tell many polygons apart.
//!
//! A state is the classes of sets not yet told apart. It is hopeless with `r` columns to go if a class has more than 2^r
//! members, or if the `r` columns that separate most separate too little. Otherwise some pair has fewest columns that
//! separate it, one of which must be chosen: each is tried, and left out of what is tried after it. Columns that split all
//! classes alike count once, which leaves very few near the end.
//!
//! Masks of 64 bits hold the sets, so at most 64 can be told apart here.

use super::system::Columns;

/// Sets that fit a mask.
pub(super) const SETS_MAX: usize = 64;

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

/// The search.
pub(super) struct Partition<'a> {
    /// States that may still be looked at.
    budget: u64,
    stop: &'a dyn Fn() -> bool,
    /// States looked at.
    pub states: u64,
}

/// A way to split the classes of a state, and a column that does it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Split {
    /// In each class, the side without the class's least member.
    side: u64,
    column: u32,
}

impl<'a> Partition<'a> {
    pub(super) fn new(budget: u64, stop: &'a dyn Fn() -> bool) -> Self {
        Self { budget, stop, states: 0 }
    }

    /// Whether `size` columns are enough to separate all sets, of which there are at most [`SETS_MAX`].
    pub(super) fn search(&mut self, columns: &Columns, size: usize) -> Outcome {
        let mask = |column: usize| columns.sides[column].row().words().first().copied().unwrap_or(0);
        let splits: Vec<_> =
            (0..columns.len()).map(|column| Split { side: mask(column), column: number(column) }).collect();
        let all = if columns.sets == SETS_MAX { u64::MAX } else { (1 << columns.sets) - 1 };
        let classes = if columns.sets > 1 { vec![all] } else { Vec::new() };
        let mut chosen = Vec::new();
        match self.descend(&classes, &splits, size, &mut chosen) {
            Some(true) => Outcome::Found(chosen.into_iter().map(|column| column as usize).collect()),
            Some(false) => Outcome::Refuted,
            None => Outcome::Open,
        }
    }

    /// Whether `left` more columns are enough; none if the search was broken off.
    fn descend(&mut self, classes: &[u64], splits: &[Split], left: usize, chosen: &mut Vec<u32>) -> Option<bool> {
        if classes.is_empty() {
            return Some(true);
        }
        if left == 0 || classes.iter().any(|class| log2_ceil(class.count_ones()) > left) {
            return Some(false);
        }
        self.states += 1;
        if self.states > self.budget || (self.states.is_multiple_of(256) && (self.stop)()) {
            return None;
        }
        if left == 1 {
            let last = splits.iter().find(|split| classes.iter().all(|class| (split.side & class).count_ones() == 1));
            chosen.extend(last.map(|split| split.column));
            return Some(last.is_some());
        }
        let splits = distinct(classes, splits, left);
        if !enough(classes, &splits, left) {
            return Some(false);
        }
        let splits: Vec<Split> = splits.into_iter().map(|(_, split)| split).collect();
        let Some(pair) = scarcest_pair(classes, &splits) else { return Some(false) };
        // What separates the pair comes last, the best at the very end, so that each is tried with those before it.
        let (mut order, tried): (Vec<Split>, Vec<Split>) =
            splits.into_iter().partition(|split| (split.side & pair).count_ones() != 1);
        let others = order.len();
        order.extend(tried.into_iter().rev());
        for place in (others..order.len()).rev() {
            let split = order[place];
            let finer: Vec<u64> = classes.iter().flat_map(|class| parts(*class, split.side)).collect();
            chosen.push(split.column);
            if self.descend(&finer, &order[..place], left - 1, chosen)? {
                return Some(true);
            }
            chosen.pop();
        }
        Some(false)
    }
}

/// The parts of a class with more than one member.
fn parts(class: u64, side: u64) -> impl Iterator<Item = u64> {
    [class & side, class & !side].into_iter().filter(|part| part.count_ones() > 1)
}

/// The least number of bits that tell so many apart.
pub(super) fn log2_ceil(count: u32) -> usize {
    (u32::BITS - count.saturating_sub(1).leading_zeros()) as usize
}

/// The least sum of distances between all pairs of so many different codes of `bits` bits.
///
/// More than the number of pairs, because codes at distance 1 from each other are few, and much more where few codes are left
/// out. If that are `t` of 2H, and `j` of these have a bit set, then the bit adds (H − j)(H − t + j) = H (H − t) + j (t − j): the
/// first for every bit, and the second sums up to the distances of those left out.
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

/// The same for codes of any number of bits. Up to 8 exact, by exhaustion over partitions (see the test). Beyond, a bound: with
/// every bit turned so that fewer codes have it set, the codes' weights sum up to `count − 1` at least, and a bit set in `k` codes
/// adds `k (count − k)`, which for given sum is least where bits are set in none or in half.
fn distances_of_any(count: u32) -> u32 {
    const EXACT: [u32; 9] = [0, 0, 1, 4, 8, 16, 25, 36, 48];
    if let Some(&exact) = EXACT.get(count as usize) {
        return exact;
    }
    let half = count / 2;
    let (full, rest) = ((count - 1) / half, (count - 1) % half);
    (full * half * (count - half) + rest * (count - rest)).max(count * (count - 1) / 2)
}

/// The different splits of some classes that leave no part too large, each with the pairs that it separates, most first.
fn distinct(classes: &[u64], splits: &[Split], left: usize) -> Vec<(u32, Split)> {
    let largest = 1_u64.checked_shl(number(left - 1)).unwrap_or(u64::MAX);
    let rewritten = splits.iter().filter_map(|split| {
        let (mut side, mut gain) = (0, 0);
        for &class in classes {
            let within = split.side & class;
            let has_least = within & class & class.wrapping_neg() != 0;
            let part = if has_least { class & !within } else { within };
            let (inside, outside) = (part.count_ones(), (class & !part).count_ones());
            if u64::from(inside.max(outside)) > largest {
                return None;
            }
            side |= part;
            gain += inside * outside;
        }
        (gain > 0).then_some((gain, Split { side, ..*split }))
    });
    let mut rewritten: Vec<_> = rewritten.collect();
    rewritten.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    rewritten.dedup_by_key(|(_, split)| split.side);
    rewritten
}

/// Whether the `left` columns that separate most could separate all that is left.
fn enough(classes: &[u64], splits: &[(u32, Split)], left: usize) -> bool {
    let open: u32 = classes.iter().map(|class| distances(class.count_ones(), left)).sum();
    let most: u32 = splits.iter().take(left).map(|(gain, _)| gain).sum();
    most >= open
}

/// The pair in a class that the fewest splits separate; none if a pair is separated by none.
fn scarcest_pair(classes: &[u64], splits: &[Split]) -> Option<u64> {
    let sides = transposed(splits);
    let row = |set: u32| &sides[set as usize];
    let mut best: Option<(u32, u64)> = None;
    for &class in classes {
        for pair in pairs_in(class) {
            let (a, b) = (row(pair.trailing_zeros()), row(63 - pair.leading_zeros()));
            let count = a.iter().zip(b).map(|(a, b)| (a ^ b).count_ones()).sum();
            if count == 0 {
                return None;
            }
            if best.is_none_or(|(least, _)| count < least) {
                best = Some((count, pair));
            }
        }
    }
    best.map(|(_, pair)| pair)
}

/// For each set the splits that have it on their side, 64 of them in a word.
fn transposed(splits: &[Split]) -> Vec<Vec<u64>> {
    let mut rows = vec![Vec::new(); SETS_MAX];
    for chunk in splits.chunks(64) {
        let mut words = [0; 64];
        words.iter_mut().zip(chunk).for_each(|(word, split)| *word = split.side);
        transpose(&mut words);
        rows.iter_mut().zip(words).for_each(|(row, word)| row.push(word));
    }
    rows
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

/// The pairs of members of a class, as masks.
fn pairs_in(class: u64) -> impl Iterator<Item = u64> {
    let members = |mask: u64| {
        let rest = |&mask: &u64| Some(mask & (mask - 1)).filter(|&mask| mask != 0);
        std::iter::successors(Some(mask).filter(|&mask| mask != 0), rest).map(|mask| mask & mask.wrapping_neg())
    };
    members(class).flat_map(move |a| members(class & !(a | (a - 1))).map(move |b| a | b))
}

fn number(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}
