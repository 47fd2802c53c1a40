//! Linear programs over shares of columns, solved by the dual simplex method on a dense tableau.
//!
//! Minimises the sum of shares, each between bounds, subject to rows `Σ coefficient · share ≥ right`. Rows come and go,
//! and bounds change, while the tableau stays: the next optimum is a few pivots away. Sizes are some hundred rows by
//! some hundred columns, for which a dense tableau is fastest.
//!
//! Rounding grows with pivots, so nothing is concluded from the tableau itself: [`Simplex::bound`] computes from the
//! rows' prices a lower bound that holds whatever the prices are, and that alone proves anything.

use crate::search::Stop;

/// Basic values this far out of bounds are mended by a pivot: far above rounding, far below what decides a bound.
const INFEASIBLE: f64 = 1e-7;

/// Entries of the tableau below this are no pivots: they would blow up rounding.
const PIVOT_MIN: f64 = 1e-7;

/// Entries below this are rounding.
const ZERO: f64 = 1e-12;

/// Least slack of a row that is dropped.
const SLACK: f64 = 1e-6;

/// A row: `Σ coefficient · share ≥ right`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Row {
    /// Columns and their coefficients.
    pub terms: Vec<(u32, f64)>,
    /// What the sum must at least be.
    pub right: f64,
}

/// A linear program with a basis.
#[derive(Clone, Debug)]
pub(super) struct Simplex {
    columns: usize,
    /// Bounds of each column's share.
    bounds: Vec<[f64; 2]>,
    rows: Vec<Row>,
    /// What is basic in each line of the tableau: below `columns` a column, otherwise the slack of a row.
    basic: Vec<u32>,
    /// What is not basic, at each place of a line.
    nonbasic: Vec<u32>,
    /// Whether it is at its upper bound.
    at_upper: Vec<bool>,
    /// `basic = … − Σ entry · nonbasic`, line by line.
    tableau: Vec<Vec<f64>>,
    /// Values of what is basic.
    value: Vec<f64>,
    /// Reduced costs of what is not.
    cost: Vec<f64>,
    /// Pivots made so far.
    pub pivots: u64,
}

/// How a solution ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Optimal,
    Infeasible,
    /// Rounding or the limit of pivots; what is there is still a bound.
    GivenUp,
}

impl Simplex {
    pub(super) fn new(columns: usize) -> Self {
        Self {
            columns,
            bounds: vec![[0.0, 1.0]; columns],
            rows: Vec::new(),
            basic: Vec::new(),
            nonbasic: (0..number(columns)).collect(),
            at_upper: vec![false; columns],
            tableau: Vec::new(),
            value: Vec::new(),
            cost: vec![1.0; columns],
            pivots: 0,
        }
    }

    pub(super) fn bounds(&self, column: usize) -> [f64; 2] {
        self.bounds[column]
    }

    /// The shares of columns that have any, as they are now.
    pub(super) fn shares(&self) -> Vec<(usize, f64)> {
        let mut share: Vec<f64> = self.bounds.iter().map(|[low, _]| *low).collect();
        let mut set = |variable: u32, value: f64| {
            if let Some(share) = share.get_mut(variable as usize) {
                *share = value;
            }
        };
        self.basic.iter().zip(&self.value).for_each(|(&variable, &value)| set(variable, value));
        self.nonbasic.iter().enumerate().for_each(|(place, &variable)| set(variable, self.level(place)));
        share.into_iter().enumerate().filter(|&(_, share)| share > ZERO).collect()
    }

    /// Forgets the places of columns that are fixed and not basic: they never change again.
    pub(super) fn drop_fixed(&mut self) {
        let keep: Vec<bool> = (0..self.nonbasic.len()).map(|place| !self.is_fixed(place)).collect();
        if keep.iter().all(|&keep| keep) {
            return;
        }
        retain(&mut self.nonbasic, &keep);
        retain(&mut self.at_upper, &keep);
        retain(&mut self.cost, &keep);
        self.tableau.iter_mut().for_each(|line| retain(line, &keep));
    }

    /// Adds a row, its slack basic.
    pub(super) fn add(&mut self, row: Row) {
        let mut place_of = vec![None; self.columns];
        self.nonbasic
            .iter()
            .enumerate()
            .filter(|(_, variable)| (**variable as usize) < self.columns)
            .for_each(|(place, &variable)| place_of[variable as usize] = Some(place));
        let mut line_of = vec![None; self.columns];
        self.basic
            .iter()
            .enumerate()
            .filter(|(_, variable)| (**variable as usize) < self.columns)
            .for_each(|(line, &variable)| line_of[variable as usize] = Some(line));
        let (mut entries, mut value) = (vec![0.0; self.nonbasic.len()], -row.right);
        for &(column, coefficient) in &row.terms {
            if let Some(place) = place_of[column as usize] {
                entries[place] -= coefficient;
                value += coefficient * self.level(place);
            } else if let Some(line) = line_of[column as usize] {
                entries.iter_mut().zip(&self.tableau[line]).for_each(|(entry, part)| *entry += coefficient * part);
                value += coefficient * self.value[line];
            } else {
                value += coefficient * self.bounds[column as usize][0];
            }
        }
        self.basic.push(number(self.columns + self.rows.len()));
        self.rows.push(row);
        self.tableau.push(entries);
        self.value.push(value);
    }

    /// Drops rows that hold with room to spare.
    pub(super) fn drop_slack_rows(&mut self) {
        let mut line = 0;
        while line < self.basic.len() {
            let row = (self.basic[line] as usize).checked_sub(self.columns);
            match row {
                Some(row) if self.value[line] > SLACK => self.drop_row(line, row),
                _ => line += 1,
            }
        }
    }

    fn drop_row(&mut self, line: usize, row: usize) {
        self.basic.swap_remove(line);
        self.tableau.swap_remove(line);
        self.value.swap_remove(line);
        self.rows.swap_remove(row);
        // The last row has the number of the one dropped now.
        let (moved, freed) = (number(self.columns + self.rows.len()), number(self.columns + row));
        for variable in self.basic.iter_mut().chain(&mut self.nonbasic) {
            if *variable == moved {
                *variable = freed;
            }
        }
    }

    /// Sets a column's share to 0 or 1.
    pub(super) fn fix(&mut self, column: usize, share: f64) {
        self.bounds[column] = [share, share];
        let Some(place) = self.nonbasic.iter().position(|&variable| variable as usize == column) else { return };
        let before = if self.at_upper[place] { 1.0 } else { 0.0 };
        self.at_upper[place] = share > 0.5;
        let change = share - before;
        if change != 0.0 {
            self.value.iter_mut().zip(&self.tableau).for_each(|(value, line)| *value -= line[place] * change);
        }
    }

    /// Pivots until all values are within their bounds, or until it should stop.
    pub(super) fn solve(&mut self, pivots_max: u64, stop: Stop<'_>) -> End {
        for _ in 0..pivots_max {
            if stop.stops() {
                break;
            }
            let Some((line, below)) = self.worst() else { return End::Optimal };
            let Some(place) = self.entering(line, below) else {
                return if self.is_hopeless(line, below) { End::Infeasible } else { End::GivenUp };
            };
            let bound = self.bounds_of(self.basic[line])[usize::from(!below)];
            self.pivot(line, place, bound);
        }
        End::GivenUp
    }

    /// The line whose value is farthest out of its bounds, and whether below.
    fn worst(&self) -> Option<(usize, bool)> {
        let mut worst = (INFEASIBLE, None);
        for (line, (&variable, &value)) in self.basic.iter().zip(&self.value).enumerate() {
            let [low, high] = self.bounds_of(variable);
            if low - value > worst.0 {
                worst = (low - value, Some((line, true)));
            }
            if value - high > worst.0 {
                worst = (value - high, Some((line, false)));
            }
        }
        worst.1
    }

    /// What can take the place of a line's value at the least cost.
    fn entering(&self, line: usize, below: bool) -> Option<usize> {
        let mut best: Option<(f64, f64, usize)> = None;
        for (place, &entry) in self.tableau[line].iter().enumerate() {
            if entry.abs() < PIVOT_MIN || self.is_fixed(place) {
                continue;
            }
            // A value below its bound grows where what is at its lower bound grows against a negative entry.
            let helps = (entry < 0.0) == (below != self.at_upper[place]);
            if !helps {
                continue;
            }
            let ratio = self.cost[place].abs() / entry.abs();
            let better = best
                .is_none_or(|(least, size, _)| ratio < least - ZERO || (ratio < least + ZERO && entry.abs() > size));
            if better {
                best = Some((ratio, entry.abs(), place));
            }
        }
        best.map(|(_, _, place)| place)
    }

    /// Whether no values within bounds can bring a line's value within its own: checked against the row itself.
    fn is_hopeless(&self, line: usize, below: bool) -> bool {
        let reach: f64 = self.tableau[line]
            .iter()
            .enumerate()
            .filter(|(place, _)| !self.is_fixed(*place))
            .map(|(place, &entry)| {
                let helps = (entry < 0.0) == (below != self.at_upper[place]);
                let width = if (self.nonbasic[place] as usize) < self.columns { 1.0 } else { f64::from(u16::MAX) };
                if helps { entry.abs() * width } else { 0.0 }
            })
            .sum();
        let [low, high] = self.bounds_of(self.basic[line]);
        let missing = if below { low - self.value[line] } else { self.value[line] - high };
        missing > reach + INFEASIBLE
    }

    fn is_fixed(&self, place: usize) -> bool {
        let [low, high] = self.bounds_of(self.nonbasic[place]);
        high - low < 0.5
    }

    fn bounds_of(&self, variable: u32) -> [f64; 2] {
        self.bounds.get(variable as usize).copied().unwrap_or([0.0, f64::INFINITY])
    }

    /// The value of what is not basic.
    fn level(&self, place: usize) -> f64 {
        let [low, high] = self.bounds_of(self.nonbasic[place]);
        if self.at_upper[place] { high } else { low }
    }

    /// Makes what is at `place` basic in `line`, whose value goes to `bound`.
    fn pivot(&mut self, line: usize, place: usize, bound: f64) {
        self.pivots += 1;
        let mut row = std::mem::take(&mut self.tableau[line]);
        let pivot = row[place];
        let step = (self.value[line] - bound) / pivot;
        let entering_value = self.level(place) + step;
        row.iter_mut().for_each(|entry| *entry /= pivot);
        row[place] = 1.0 / pivot;
        for (other, value) in self.tableau.iter_mut().zip(&mut self.value) {
            if other.is_empty() || other[place].abs() < ZERO {
                continue;
            }
            let factor = std::mem::take(&mut other[place]);
            *value -= factor * step;
            other.iter_mut().zip(&row).for_each(|(entry, part)| *entry -= factor * part);
        }
        let factor = std::mem::take(&mut self.cost[place]);
        self.cost.iter_mut().zip(&row).for_each(|(cost, part)| *cost -= factor * part);
        self.tableau[line] = row;
        self.value[line] = entering_value;
        let leaving = std::mem::replace(&mut self.basic[line], self.nonbasic[place]);
        self.nonbasic[place] = leaving;
        let [low, high] = self.bounds_of(leaving);
        self.at_upper[place] = bound >= high && high > low || (high - low < 0.5 && low > 0.5);
    }

    /// A lower bound on the sum of shares that holds whatever rounding did, and the reduced cost of every column, by
    /// which the bound grows at least if the column changes from the share it has in the bound.
    pub(super) fn bound(&self) -> (f64, Vec<f64>) {
        let (mut total, mut reduced) = (0.0, vec![1.0; self.columns]);
        for (place, &variable) in self.nonbasic.iter().enumerate() {
            let Some(row) = (variable as usize).checked_sub(self.columns) else { continue };
            let price = self.cost[place].max(0.0);
            if price > 0.0 {
                let row = &self.rows[row];
                total += price * row.right;
                row.terms.iter().for_each(|&(column, coefficient)| reduced[column as usize] -= price * coefficient);
            }
        }
        for (&cost, [low, high]) in reduced.iter().zip(&self.bounds) {
            total += if cost > 0.0 { cost * low } else { cost * high };
        }
        (total, reduced)
    }

    /// The lines of columns whose shares are not whole, with their values.
    fn fractional(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        let is_fractional = |value: f64| value > 1e-6 && value < 1.0 - 1e-6;
        let lines = self.basic.iter().zip(&self.value).enumerate();
        lines
            .filter(move |(_, (variable, value))| (**variable as usize) < self.columns && is_fractional(**value))
            .map(|(line, (_, value))| (line, *value))
    }

    /// What branching on a basic column's share costs at least, down to 0 and up to 1: the first pivot's part of it.
    pub(super) fn penalties(&self) -> Vec<(usize, f64, [f64; 2])> {
        self.fractional()
            .map(|(line, value)| {
                let ratio = |below: bool| {
                    self.entering(line, below).map_or(1e3, |place| (self.cost[place] / self.tableau[line][place]).abs())
                };
                (self.basic[line] as usize, value, [value * ratio(false), (1.0 - value) * ratio(true)])
            })
            .collect()
    }
}

fn retain<T: Copy>(items: &mut Vec<T>, keep: &[bool]) {
    let mut keep = keep.iter();
    items.retain(|_| keep.next().copied().unwrap_or(true));
}

fn number(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}
