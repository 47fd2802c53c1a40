//! A good choice by local search: rows are pairs of sets, and those that stay open gain weight ("row weighting local
//! search", Gao, Weise and Li 2015, for unicost set covering).
//!
//! Deterministic: the same columns give the same choice.

use super::system::{Columns, pair_number};
use crate::search::Stop;

/// Entries of the list of columns that separate each pair, at most: beyond it the search would take gigabytes.
const ENTRIES_MAX: usize = 60_000_000;

/// The state of the search.
pub(super) struct Local<'a> {
    columns: &'a Columns,
    /// By how many chosen columns each pair is to differ.
    least: Vec<u32>,
    /// Columns that separate each pair.
    separators: Vec<Vec<u32>>,
    /// Pairs that each column separates.
    pairs: Vec<Vec<u32>>,
    weight: Vec<i64>,
    /// How many chosen columns separate each pair.
    count: Vec<u32>,
    chosen: Vec<bool>,
    /// What adding a column gains, or what taking it out loses.
    score: Vec<i64>,
    /// When each column last changed.
    changed: Vec<u64>,
    open: Vec<u32>,
    /// Where each pair stands in `open`.
    place: Vec<u32>,
    random: u64,
    step: u64,
    /// Scores changed so far: the measure of work done.
    work: u64,
}

const NOWHERE: u32 = u32::MAX;

/// Columns gone through between two questions whether to stop: less than a millisecond of work.
const LOOK_EACH: u64 = 1 << 16;

impl<'a> Local<'a> {
    /// A search from a choice that separates every pair; none if the problem is too large to be held, or where it should
    /// stop before it begins.
    pub(super) fn new(columns: &'a Columns, start: &[usize], stop: Stop<'_>) -> Option<Self> {
        let n = columns.sets;
        let entries: usize = columns.sides.iter().map(|side| side.row().count()).map(|side| side * (n - side)).sum();
        if entries > ENTRIES_MAX {
            return None;
        }
        let count = n * n.saturating_sub(1) / 2;
        let (mut separators, mut pairs) = (vec![Vec::new(); count], Vec::with_capacity(columns.len()));
        for (column, side) in columns.sides.iter().enumerate() {
            if stop.stops() {
                return None;
            }
            let numbers = pairs_of(n, side);
            numbers.iter().for_each(|&pair| separators[pair as usize].push(to_u32(column)));
            pairs.push(numbers);
        }
        let width = columns.len();
        let mut search = Self {
            columns,
            least: (0..count).map(|pair| to_u32(columns.demands.of(pair))).collect(),
            separators,
            pairs,
            weight: vec![1; count],
            count: vec![0; count],
            chosen: vec![false; width],
            score: vec![0; width],
            changed: vec![0; width],
            open: Vec::new(),
            place: vec![NOWHERE; count],
            random: 0x9E37_79B9_7F4A_7C15,
            step: 1,
            work: 0,
        };
        let open: Vec<usize> = (0..count).filter(|&pair| search.least[pair] > 0).collect();
        open.into_iter().for_each(|pair| search.reopen(pair));
        search.score = (0..width).map(|column| search.score_of(column)).collect();
        start.iter().for_each(|&column| search.add(column));
        Some(search)
    }

    /// Searches until so many more scores have changed, or a choice of the size `target` is found; gives a choice
    /// smaller than the last found, if there is one.
    pub(super) fn run(&mut self, work: u64, target: usize, stop: Stop<'_>) -> Option<Vec<usize>> {
        let mut best = None;
        let end = self.work + work;
        // A step goes through all columns, once or twice.
        let look_each = (LOOK_EACH / self.columns.len().max(1) as u64).clamp(1, 256);
        while self.work < end {
            while self.open.is_empty() {
                best = Some(self.choice());
                if best.as_ref().is_some_and(|best: &Vec<usize>| best.len() <= target) {
                    return best;
                }
                let Some(column) = self.cheapest(false) else { return best };
                self.remove(column);
            }
            if self.step % look_each < 2 && stop.stops() {
                break;
            }
            let Some(column) = self.cheapest(true) else { break };
            self.remove(column);
            self.repair();
        }
        best
    }

    fn choice(&self) -> Vec<usize> {
        (0..self.columns.len()).filter(|&column| self.chosen[column]).collect()
    }

    /// Adds what gains most of the columns that separate some open pair, and raises the weight of what stays open.
    fn repair(&mut self) {
        let place = self.draw(self.open.len());
        let pair = self.open[place];
        let candidates = self.separators[pair as usize].iter().map(|&column| column as usize);
        let candidates = candidates.filter(|&column| !self.chosen[column] && self.changed[column] + 1 < self.step);
        let key = |&column: &usize| (self.score[column], u64::MAX - self.changed[column]);
        if let Some(column) = candidates.max_by_key(key) {
            self.add(column);
        }
        for place in 0..self.open.len() {
            let pair = self.open[place] as usize;
            self.weight[pair] += 1;
            self.work += self.separators[pair].len() as u64;
            for &column in &self.separators[pair] {
                // An open pair counts for columns that could be added, and, where several are needed, for those chosen.
                self.score[column as usize] += 1;
            }
        }
    }

    /// The chosen column that loses least; not the one just added, if asked so.
    fn cheapest(&self, not_latest: bool) -> Option<usize> {
        let candidates = (0..self.columns.len()).filter(|&column| self.chosen[column]);
        let candidates = candidates.filter(|&column| !not_latest || self.changed[column] + 1 < self.step);
        candidates.min_by_key(|&column| (self.score[column], self.changed[column]))
    }

    fn draw(&mut self, count: usize) -> usize {
        // xorshift64
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        usize::try_from(self.random % count as u64).unwrap_or(0)
    }

    fn add(&mut self, column: usize) {
        self.work += self.pairs[column].len() as u64;
        for index in 0..self.pairs[column].len() {
            let pair = self.pairs[column][index] as usize;
            self.count[pair] += 1;
            let count = self.count[pair];
            if count == self.least[pair] {
                self.close(pair);
                // Nothing is gained here any more; what is chosen loses as much as before.
                self.shift(pair, -self.weight[pair], false, column);
            } else if count == self.least[pair] + 1 {
                self.shift(pair, -self.weight[pair], true, column);
            }
        }
        self.chosen[column] = true;
        self.score[column] = self.score_of(column);
        (self.changed[column], self.step) = (self.step, self.step + 1);
    }

    fn remove(&mut self, column: usize) {
        self.chosen[column] = false;
        self.work += self.pairs[column].len() as u64 + 1;
        for index in 0..self.pairs[column].len() {
            let pair = self.pairs[column][index] as usize;
            self.count[pair] -= 1;
            let count = self.count[pair];
            if count + 1 == self.least[pair] {
                self.reopen(pair);
                self.shift(pair, self.weight[pair], false, column);
            } else if count == self.least[pair] {
                self.shift(pair, self.weight[pair], true, column);
            }
        }
        self.score[column] = self.score_of(column);
        (self.changed[column], self.step) = (self.step, self.step + 1);
    }

    /// What a column gains, or loses if it is chosen: the weight of pairs with too few others.
    fn score_of(&self, column: usize) -> i64 {
        let one = u32::from(!self.chosen[column]);
        let pairs = self.pairs[column].iter().map(|&pair| pair as usize);
        pairs.filter(|&pair| self.count[pair] + one <= self.least[pair]).map(|pair| self.weight[pair]).sum()
    }

    /// Changes the scores of the columns on one side of the choice that separate a pair.
    fn shift(&mut self, pair: usize, by: i64, chosen: bool, but: usize) {
        self.work += self.separators[pair].len() as u64;
        for &column in &self.separators[pair] {
            let column = column as usize;
            if self.chosen[column] == chosen && column != but {
                self.score[column] += by;
            }
        }
    }

    fn close(&mut self, pair: usize) {
        let place = self.place[pair];
        if let Some(last) = self.open.pop()
            && last as usize != pair
        {
            self.open[place as usize] = last;
            self.place[last as usize] = place;
        }
        self.place[pair] = NOWHERE;
    }

    fn reopen(&mut self, pair: usize) {
        self.place[pair] = to_u32(self.open.len());
        self.open.push(to_u32(pair));
    }
}

/// The pairs with one set on a side, by number.
fn pairs_of(sets: usize, side: &crate::math::bits::BitSet) -> Vec<u32> {
    let others: Vec<usize> = (0..sets).filter(|&set| !side.row().has(set)).collect();
    let mut pairs: Vec<u32> =
        side.row().iter().flat_map(|a| others.iter().map(move |&b| to_u32(pair_number(a, b)))).collect();
    pairs.sort_unstable();
    pairs
}

fn to_u32(number: usize) -> u32 {
    u32::try_from(number).unwrap_or(u32::MAX)
}
