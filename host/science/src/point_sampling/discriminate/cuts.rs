//! Rows that every choice of columns fulfils, as far as given shares violate them.
//!
//! - A **pair** of sets differs by one chosen column at least (by what is demanded of it, if misreads are to be
//!   survived).
//! - Of three sets a column that separates any separates exactly two of the three pairs, so **three sets** need two
//!   columns. This is half the sum of the pairs' rows with its right side rounded up.
//! - **Counting**: chosen columns that touch a group T of sets give each a code, the columns that it is in. At most one
//!   code is empty and at most one is {p} for each p; all others have two members. So
//!   `Σ_p (|T ∩ p| + [T touches p]) x_p ≥ 2 (|T| − 1)`. This decides sparse scenes, where plain pairs bound only half
//!   of what is needed. The group that violates it most is a closure of largest weight, that is, a minimum cut.

use super::simplex::Row;
use super::system::{Columns, pair_number};
use crate::math::bits::BitSet;

/// A row counts as violated by more than this: rows violated by less cost more than they bring.
const VIOLATION: f64 = 1e-3;

/// Rows of a kind to add at a time.
const ROWS_MAX: usize = 60;

/// The same below the root, for rows that are dear to find.
const VIOLATION_BELOW: f64 = 0.05;
const ROWS_MAX_BELOW: usize = 25;

/// Largest number of sets among which all triples are looked at.
const TRIPLE_SETS_MAX: usize = 160;

/// Finds rows that given shares violate.
#[derive(Debug)]
pub(super) struct Cuts<'a> {
    columns: &'a Columns,
}

impl<'a> Cuts<'a> {
    pub(super) fn new(columns: &'a Columns) -> Self {
        Self { columns }
    }

    /// Rows that these shares violate.
    pub(super) fn violated(&self, shares: &[(usize, f64)], thorough: bool) -> Vec<Row> {
        let distances = self.distances(shares);
        let mut rows = self.pairs(&distances);
        rows.extend(self.triples(&distances));
        // Counting asks that any two sets differ at all.
        if self.columns.demands.fewest > 0 {
            rows.extend(self.counting(shares, thorough));
        }
        rows
    }

    /// How much of the shares separates each pair.
    fn distances(&self, shares: &[(usize, f64)]) -> Vec<f64> {
        let n = self.columns.sets;
        let mut distances = vec![0.0; n * n.saturating_sub(1) / 2];
        let mut of_set = vec![0.0; n];
        for &(column, share) in shares {
            let side: Vec<usize> = self.columns.sides[column].row().iter().collect();
            for (place, &a) in side.iter().enumerate() {
                of_set[a] += share;
                side[..place].iter().for_each(|&b| distances[pair_number(a, b)] -= 2.0 * share);
            }
        }
        for a in 0..n {
            (0..a).for_each(|b| distances[pair_number(a, b)] += of_set[a] + of_set[b]);
        }
        distances
    }

    fn pairs(&self, distances: &[f64]) -> Vec<Row> {
        let mut found = Vec::new();
        for a in 0..self.columns.sets {
            for b in 0..a {
                let distance = distances[pair_number(a, b)];
                let missing = real(self.columns.demands.of(pair_number(a, b))) - distance;
                if missing > VIOLATION {
                    found.push((missing, [a, b]));
                }
            }
        }
        found.sort_by(|a, b| b.0.total_cmp(&a.0));
        // Of the worst, each set once or twice: rows of one set say nearly the same.
        let mut used = vec![0; self.columns.sets];
        let mut rows = Vec::new();
        for (_, [a, b]) in found {
            if used[a] < 2 && used[b] < 2 && rows.len() < 2 * ROWS_MAX {
                (used[a], used[b]) = (used[a] + 1, used[b] + 1);
                rows.push(self.pair_row(a, b));
            }
        }
        rows
    }

    /// The row of a pair.
    pub(super) fn pair_row(&self, a: usize, b: usize) -> Row {
        let separating = (0..self.columns.len()).filter(|&column| self.columns.separates(column, a, b));
        Row {
            terms: separating.map(|column| (number(column), 1.0)).collect(),
            right: real(self.columns.demands.of(pair_number(a, b))),
        }
    }

    fn triples(&self, distances: &[f64]) -> Vec<Row> {
        let n = self.columns.sets;
        if n > TRIPLE_SETS_MAX || self.columns.demands.most > 1 {
            return Vec::new();
        }
        let mut found = Vec::new();
        for a in 0..n {
            for b in 0..a {
                let ab = distances[pair_number(a, b)];
                if ab > 2.0 {
                    continue;
                }
                for c in 0..b {
                    let around = ab + distances[pair_number(a, c)] + distances[pair_number(b, c)];
                    if around < 4.0 - 2.0 * VIOLATION {
                        found.push((around, [a, b, c]));
                    }
                }
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut used = vec![0; n];
        let mut rows = Vec::new();
        for (_, triple) in found {
            if triple.iter().all(|&set| used[set] < 4) && rows.len() < ROWS_MAX {
                triple.iter().for_each(|&set| used[set] += 1);
                rows.push(self.triple_row(triple));
            }
        }
        rows
    }

    fn triple_row(&self, [a, b, c]: [usize; 3]) -> Row {
        let splits = |&column: &usize| self.columns.separates(column, a, b) || self.columns.separates(column, b, c);
        Row { terms: (0..self.columns.len()).filter(splits).map(|column| (number(column), 1.0)).collect(), right: 2.0 }
    }

    /// Counting rows: of the group that plain counting violates most, and of groups grown from single sets.
    fn counting(&self, shares: &[(usize, f64)], thorough: bool) -> Vec<Row> {
        let plain = Closure::new(self.columns, shares).best(2.0 + VIOLATION);
        let growth = Growth::new(self.columns, shares);
        let seeds = (0..self.columns.sets).filter(|seed| thorough || seed % 2 == 0);
        let mut grown: Vec<_> = seeds.filter_map(|seed| growth.from(seed)).collect();
        grown.sort_by(|a, b| b.0.total_cmp(&a.0).then_with(|| a.1.cmp(&b.1)));
        grown.dedup();
        grown.truncate(if thorough { ROWS_MAX } else { ROWS_MAX_BELOW });
        let least = if thorough { VIOLATION } else { VIOLATION_BELOW };
        let grown = grown.into_iter().filter(|(violation, _)| *violation > least).map(|(_, group)| group);
        plain.into_iter().chain(grown).map(|group| self.counting_row(&group)).collect()
    }

    /// The counting row of a group of sets.
    pub(super) fn counting_row(&self, group: &BitSet) -> Row {
        let size = group.row().count();
        let touched = |column: usize| {
            let inside = self.columns.sides[column].row().count_common(group.row());
            let fewer = inside.min(size - inside);
            (fewer > 0).then(|| (number(column), real(fewer + 1)))
        };
        let terms = (0..self.columns.len()).filter_map(touched).collect();
        Row { terms, right: 2.0 * real(size) - 2.0 }
    }
}

/// Groups of sets that violate counting, grown one set at a time.
struct Growth<'a> {
    columns: &'a Columns,
    shares: &'a [(usize, f64)],
    /// Shares with each set on their side.
    of_set: Vec<Vec<usize>>,
}

/// Sets in a grown group, at most.
const GROUP_MAX: usize = 14;

impl<'a> Growth<'a> {
    fn new(columns: &'a Columns, shares: &'a [(usize, f64)]) -> Self {
        let mut of_set = vec![Vec::new(); columns.sets];
        for (place, &(column, _)) in shares.iter().enumerate() {
            columns.sides[column].row().iter().for_each(|set| of_set[set].push(place));
        }
        Self { columns, shares, of_set }
    }

    /// The group that violates counting most of those passed while the best set is added each time.
    fn from(&self, seed: usize) -> Option<(f64, BitSet)> {
        let mut inside = vec![0_usize; self.shares.len()];
        let mut group = vec![seed];
        self.of_set[seed].iter().for_each(|&place| inside[place] += 1);
        let (mut best, mut best_size) = (VIOLATION, 0);
        while group.len() < GROUP_MAX.min(self.columns.sets) {
            let size = group.len() + 1;
            let now: Vec<f64> = (0..inside.len()).map(|place| self.weight(place, inside[place], size)).collect();
            let base: f64 = now.iter().sum();
            let cost = |set: usize| {
                let change = |&place: &usize| self.weight(place, inside[place] + 1, size) - now[place];
                base + self.of_set[set].iter().map(change).sum::<f64>()
            };
            // Sets that share nothing with the group bring nothing.
            let touches = |set: usize| self.of_set[set].iter().any(|&place| inside[place] > 0);
            let free = (0..self.columns.sets).filter(|&set| !group.contains(&set) && touches(set));
            let Some((cost, set)) = free.map(|set| (cost(set), set)).min_by(|a, b| a.0.total_cmp(&b.0)) else { break };
            group.push(set);
            self.of_set[set].iter().for_each(|&place| inside[place] += 1);
            let violation = 2.0 * real(size) - 2.0 - cost;
            if violation > best && size > 2 {
                (best, best_size) = (violation, size);
            }
        }
        (best_size > 0).then(|| (best, BitSet::of(self.columns.sets, group[..best_size].iter().copied())))
    }

    /// What a share counts for in the row of a group of this size with so many sets on the share's side.
    fn weight(&self, place: usize, inside: usize, size: usize) -> f64 {
        let fewer = inside.min(size - inside);
        if fewer == 0 { 0.0 } else { real(fewer + 1) * self.shares[place].1 }
    }
}

/// The group T of sets for which `Σ_{i ∈ T} (2 − x(i)) − Σ_{p touches T} x_p` is largest, by maximum flow.
struct Closure {
    sets: usize,
    /// What each set brings: 2 − the shares in it.
    gains: Vec<f64>,
    /// What each share costs, once.
    costs: Vec<f64>,
    /// The sets with each share.
    holders: Vec<Vec<usize>>,
}

impl Closure {
    fn new(columns: &Columns, shares: &[(usize, f64)]) -> Self {
        let holders: Vec<Vec<usize>> =
            shares.iter().map(|&(column, _)| columns.holders[column].row().iter().collect()).collect();
        let mut gains = vec![2.0; columns.sets];
        for (sets, &(_, share)) in holders.iter().zip(shares) {
            sets.iter().for_each(|&set| gains[set] -= share);
        }
        Self { sets: columns.sets, gains, costs: shares.iter().map(|&(_, share)| share).collect(), holders }
    }

    /// The group, if it brings more than this.
    fn best(&self, more_than: f64) -> Option<BitSet> {
        let brings: f64 = self.gains.iter().filter(|gain| **gain > 0.0).sum();
        if brings <= more_than {
            return None;
        }
        let mut network = Network::new(self.sets + self.costs.len() + 2);
        let (source, sink) = (self.sets + self.costs.len(), self.sets + self.costs.len() + 1);
        for (set, &gain) in self.gains.iter().enumerate().filter(|(_, gain)| **gain > 0.0) {
            network.connect(source, set, gain);
        }
        for (place, (sets, &cost)) in self.holders.iter().zip(&self.costs).enumerate() {
            network.connect(self.sets + place, sink, cost);
            sets.iter()
                .filter(|&&set| self.gains[set] > 0.0)
                .for_each(|&set| network.connect(set, self.sets + place, f64::INFINITY));
        }
        let flow = network.fill(source, sink);
        (brings - flow > more_than).then(|| {
            let reached = network.reached(source);
            BitSet::of(self.sets, (0..self.sets).filter(|&set| self.gains[set] > 0.0 && reached[set]))
        })
    }
}

/// Capacities below this are rounding.
const EMPTY: f64 = 1e-9;

/// A network of arcs with capacities, filled by shortest paths in layers (Dinic 1970).
struct Network {
    arcs: Vec<(usize, f64)>,
    from: Vec<Vec<usize>>,
}

impl Network {
    fn new(nodes: usize) -> Self {
        Self { arcs: Vec::new(), from: vec![Vec::new(); nodes] }
    }

    fn connect(&mut self, a: usize, b: usize, capacity: f64) {
        self.from[a].push(self.arcs.len());
        self.arcs.push((b, capacity));
        self.from[b].push(self.arcs.len());
        self.arcs.push((a, 0.0));
    }

    fn fill(&mut self, source: usize, sink: usize) -> f64 {
        let mut total = 0.0;
        loop {
            let layers = self.layers(source);
            if layers[sink] == usize::MAX {
                return total;
            }
            let mut next = vec![0; self.from.len()];
            loop {
                let sent = self.send(source, sink, f64::INFINITY, &layers, &mut next);
                if sent <= EMPTY {
                    break;
                }
                total += sent;
            }
        }
    }

    fn layers(&self, source: usize) -> Vec<usize> {
        let mut layers = vec![usize::MAX; self.from.len()];
        layers[source] = 0;
        let mut queue = std::collections::VecDeque::from([source]);
        while let Some(node) = queue.pop_front() {
            for &arc in &self.from[node] {
                let (to, capacity) = self.arcs[arc];
                if capacity > EMPTY && layers[to] == usize::MAX {
                    layers[to] = layers[node] + 1;
                    queue.push_back(to);
                }
            }
        }
        layers
    }

    fn send(&mut self, node: usize, sink: usize, most: f64, layers: &[usize], next: &mut [usize]) -> f64 {
        if node == sink {
            return most;
        }
        while let Some(&arc) = self.from[node].get(next[node]) {
            let (to, capacity) = self.arcs[arc];
            if capacity > EMPTY && layers[to] == layers[node] + 1 {
                let sent = self.send(to, sink, most.min(capacity), layers, next);
                if sent > EMPTY {
                    self.arcs[arc].1 -= sent;
                    self.arcs[arc ^ 1].1 += sent;
                    return sent;
                }
            }
            next[node] += 1;
        }
        0.0
    }

    fn reached(&self, source: usize) -> Vec<bool> {
        self.layers(source).into_iter().map(|layer| layer != usize::MAX).collect()
    }
}

fn real(count: usize) -> f64 {
    f64::from(number(count))
}

fn number(value: usize) -> u32 {
    u32::try_from(value).unwrap_or(u32::MAX)
}
