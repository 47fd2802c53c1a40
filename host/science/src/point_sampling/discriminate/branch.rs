//! The fewest columns by branch and bound on linear programs: for sparse scenes, where many points are needed.

use super::cuts::Cuts;
use super::simplex::{End, Simplex};
use super::system::Columns;
use crate::search::Stop;

/// A bound this far above a whole number proves the next one: rounding in the bound's own sum is far smaller.
const ROUNDING: f64 = 1e-6;

/// Rounds of adding rows at the root and below.
const ROUNDS_ROOT: usize = 200;
const ROUNDS_BELOW: usize = 20;

/// Improvement of the bound, over a few rounds, below which no more rows are added.
const TAIL: f64 = 0.01;

/// Pivots that one solution may take.
const PIVOTS_MAX: u64 = 5000;

/// Columns to try before branching, and pivots to try each with.
const CANDIDATES: usize = 8;
const PIVOTS_TRIAL: u64 = 30;

/// Least rise of the bound that counts, so that a branch without any does not make the other worthless.
const GAIN_MIN: f64 = 1e-4;

/// Shares nearer than this to 0 or 1 are whole.
const WHOLE: f64 = 1e-6;

/// The search with what it has found so far.
pub(super) struct Branch<'a> {
    columns: &'a Columns,
    cuts: Cuts<'a>,
    budget: u64,
    stop: Stop<'a>,
    /// Linear programs solved so far.
    pub nodes: u64,
    /// The best choice known.
    pub best: Vec<usize>,
    /// Choices from this size on are of no interest.
    limit: usize,
    /// What the root proves.
    pub root_bound: usize,
}

impl<'a> Branch<'a> {
    /// A search for less than `best`, which separates all; ends after so many programs.
    pub(super) fn new(columns: &'a Columns, best: Vec<usize>, budget: u64, stop: Stop<'a>) -> Self {
        Self { columns, cuts: Cuts::new(columns), budget, stop, nodes: 0, best, limit: 0, root_bound: 0 }
    }

    /// The least number of columns that is proven to be needed; `best` is then as good as was found.
    ///
    /// Smaller numbers are refuted first: that takes little beside the largest, and leaves a bound if the search is
    /// broken off. A choice no larger than `target`, or a bound above it, is good enough; what is below `known` is
    /// refuted already.
    pub(super) fn run(&mut self, known: usize, target: usize) -> usize {
        let mut root = Simplex::new(self.columns.len());
        self.limit = if target > 0 { self.best.len().min(target + 1) } else { self.best.len() };
        let goal = self.limit;
        let Some(bound) = self.tighten(&mut root, ROUNDS_ROOT) else {
            self.root_bound = goal;
            return goal;
        };
        self.root_bound = bound;
        let mut proven = bound.max(known);
        while proven < goal && self.best.len() > target && self.best.len() > proven {
            self.limit = proven + 1;
            let mut program = root.clone();
            let finished = self.tighten(&mut program, ROUNDS_BELOW).is_none() || self.descend(program);
            if self.best.len() <= proven {
                break;
            }
            if !finished {
                return proven;
            }
            proven += 1;
        }
        proven
    }

    /// Solves with rows added as they are violated. The bound, rounded up; none if nothing better than `best` is here.
    fn tighten(&mut self, program: &mut Simplex, rounds: usize) -> Option<usize> {
        let mut history = Vec::new();
        loop {
            if program.solve(PIVOTS_MAX, self.stop) == End::Infeasible {
                return None;
            }
            let (bound, reduced) = program.bound();
            let proven = whole_above(bound);
            if proven >= self.limit {
                return None;
            }
            self.fix_by_cost(program, bound, &reduced);
            let stalled = history.len() >= 5 && bound - history[history.len() - 5] < TAIL;
            history.push(bound);
            if history.len() > rounds || stalled || self.stop.stops() {
                return Some(proven);
            }
            let rows = self.cuts.violated(&program.shares(), rounds == ROUNDS_ROOT);
            if rows.is_empty() {
                return Some(proven);
            }
            program.drop_slack_rows();
            rows.into_iter().for_each(|row| program.add(row));
        }
    }

    /// Fixes the columns that cannot change without making the bound as large as what is known.
    fn fix_by_cost(&self, program: &mut Simplex, bound: f64, reduced: &[f64]) {
        let room = real(self.limit) - 1.0 + ROUNDING - bound;
        for (column, &cost) in reduced.iter().enumerate() {
            let [low, high] = program.bounds(column);
            if high - low > 0.5 && cost.abs() > room {
                program.fix(column, if cost > 0.0 { 0.0 } else { 1.0 });
            }
        }
    }

    /// Whether all below a solved program was looked at.
    fn descend(&mut self, program: Simplex) -> bool {
        self.nodes += 1;
        if self.nodes > self.budget || self.stop.stops() {
            return false;
        }
        let shares = program.shares();
        if shares.iter().all(|&(_, share)| share > 1.0 - WHOLE) {
            return self.take(program, shares.iter().map(|&(column, _)| column).collect());
        }
        let (column, program) = match self.choose(program) {
            Choice::Branch(column, program) => (column, program),
            Choice::Changed(mut program) => {
                return self.tighten(&mut program, ROUNDS_BELOW).is_none() || self.descend(*program);
            }
            Choice::Closed => return true,
        };
        for share in [1.0, 0.0] {
            let mut child = (*program).clone();
            child.fix(column, share);
            if self.tighten(&mut child, ROUNDS_BELOW).is_some() && !self.descend(child) {
                return false;
            }
        }
        true
    }

    /// A whole solution: the best so far, if rows that are still missing do not forbid it.
    fn take(&mut self, mut program: Simplex, choice: Vec<usize>) -> bool {
        let rows = self.cuts.violated(&program.shares(), true);
        if !rows.is_empty() {
            rows.into_iter().for_each(|row| program.add(row));
            return self.tighten(&mut program, ROUNDS_BELOW).is_none() || self.descend(program);
        }
        if choice.len() < self.limit && self.columns.are_separated_by(&choice) {
            self.limit = choice.len();
            self.best = choice;
        }
        true
    }

    /// The column to branch on: of some that look good, the one whose both branches raise the bound most, tried for
    /// some pivots. A branch that closes fixes the column the other way.
    fn choose(&mut self, mut program: Simplex) -> Choice {
        program.drop_fixed();
        let (bound, _) = program.bound();
        let score = |[down, up]: [f64; 2]| down.max(GAIN_MIN) * up.max(GAIN_MIN);
        let mut candidates = program.penalties();
        candidates.sort_by(|a, b| score(b.2).total_cmp(&score(a.2)).then(a.0.cmp(&b.0)));
        candidates.truncate(CANDIDATES);
        let (mut best, mut changed) = (None, false);
        for (column, ..) in candidates {
            let [down, up] = [0.0, 1.0].map(|share| self.gain(&program, column, share, bound));
            match (down, up) {
                (None, None) => return Choice::Closed,
                (None, Some(_)) => program.fix(column, 1.0),
                (Some(_), None) => program.fix(column, 0.0),
                (Some(down), Some(up)) => {
                    let score = score([down, up]);
                    if best.is_none_or(|(most, _)| score > most) {
                        best = Some((score, column));
                    }
                    continue;
                }
            }
            changed = true;
        }
        match best {
            _ if changed => Choice::Changed(Box::new(program)),
            Some((_, column)) => Choice::Branch(column, Box::new(program)),
            None => Choice::Closed,
        }
    }

    /// How much the bound rises if a column is fixed; none if nothing better than `best` is there.
    fn gain(&self, program: &Simplex, column: usize, share: f64, bound: f64) -> Option<f64> {
        let mut child = program.clone();
        child.fix(column, share);
        let end = child.solve(PIVOTS_TRIAL, self.stop);
        let (risen, _) = child.bound();
        (end != End::Infeasible && whole_above(risen) < self.limit).then_some(risen - bound)
    }
}

/// What is to be done at a program with fractional shares.
enum Choice {
    Branch(usize, Box<Simplex>),
    Changed(Box<Simplex>),
    Closed,
}

/// The least whole number not below a bound.
fn whole_above(bound: f64) -> usize {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of columns, far below 2^52")]
    let whole = (bound - ROUNDING).ceil().max(0.0) as usize;
    whole
}

fn real(count: usize) -> f64 {
    f64::from(u32::try_from(count).unwrap_or(u32::MAX))
}
