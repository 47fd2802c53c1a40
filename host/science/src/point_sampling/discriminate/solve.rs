//! The fewest elements that tell sets apart: several methods in turn, until what is found is proven or time is up.

use super::branch::Branch;
use super::greedy::greedy_multiple;
use super::local::Local;
use super::partition::{Order, Outcome, Partition, SETS_MAX, log2_ceil};
use super::system::{Columns, Demands, SetSystem};
use crate::search::{Halt, Stop, never};

/// What is asked for.
#[derive(Clone, Copy)]
pub struct Search<'a> {
    /// By how many chosen elements any two sets must differ: 1 to tell them apart, `t + 1` to notice `t` wrong answers
    /// or to do without `t` answers, `2 t + 1` to correct `t` wrong answers. Sets that differ by fewer elements of the
    /// system differ by all of these.
    pub separation: usize,
    /// A choice of this size is good enough: 0 to look for the smallest.
    pub target: usize,
    /// How long to search.
    pub effort: Effort,
    /// Asked now and then whether to end.
    pub stop: Stop<'a>,
}

/// How long to search, in steps, so that it does not depend on the computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Effort {
    /// Only the greedy choice.
    Greedy,
    /// As long as a decision about one threshold of clearance is worth.
    Brief,
    /// Until proven, or until `stop`.
    Full,
}

/// A choice of elements that tells sets apart, and how good it is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Choice {
    /// The elements chosen, ascending.
    pub elements: Vec<usize>,
    /// No choice has fewer elements.
    pub lower_bound: usize,
    /// What proves the bound.
    pub proof: Proof,
}

/// What a lower bound rests on. Either search can be repeated with the library: it is deterministic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Proof {
    /// Sets need as many elements as it takes binary digits to number them.
    pub digits: usize,
    /// What one linear program proves, with the rows of `cuts`: the dual solution is the certificate.
    pub program: usize,
    /// Further linear programs solved by branching.
    pub branches: u64,
    /// Partitions of the sets looked at.
    pub partitions: u64,
}

impl Choice {
    /// Whether no choice has fewer elements.
    #[must_use]
    pub fn is_fewest(&self) -> bool {
        self.lower_bound >= self.elements.len()
    }
}

/// What a method may do in one round. Each round allows more than the one before, and a method begins anew: so much
/// more that what was done before matters little.
#[derive(Clone, Copy, Debug)]
struct Budget {
    /// Scores that local search may change at first; each round twice as many.
    scores: u64,
    /// Partitions after the first local search, to refute all that is smaller than what it found.
    refuted: u64,
    /// Partitions at first, and the binary logarithm of their growth.
    partitions: u64,
    partitions_growth: u32,
    /// Linear programs at first, beside that of the root; each round twice as many.
    programs: u64,
}

/// The first round takes some ten to a hundred milliseconds of each method.
const SPARSE: Budget = Budget { scores: 20_000_000, refuted: 0, partitions: 5_000, partitions_growth: 1, programs: 20 };

/// In dense scenes search over partitions ends long before branching on programs does: it gets a second or so at once,
/// and some more in the second round.
const DENSE: Budget =
    Budget { scores: 80_000_000, refuted: 400_000, partitions: 50_000, partitions_growth: 4, programs: 20 };

/// Partitions before anything else: what a few refute, no other method need try to find.
const REFUTED_AT_ONCE: u64 = 5_000;

/// A scene is dense if no more elements are known to be needed than these beyond what it takes to number the sets.
const DENSE_EXTRA: usize = 3;

/// Doublings of a budget, at most.
const DOUBLINGS_MAX: u32 = 20;

/// Rounds of a search that is not to be long.
const ROUNDS_BRIEF: u32 = 2;

/// Elements that tell any two sets apart, as few as can be found.
///
/// Among elements that separate the same sets those that come first in `order` are taken; elements that are not in
/// `order` are not used. Sets that no elements tell apart stay so: see [`SetSystem::closer_than`].
///
/// ```
/// use palpate::point_sampling::{Effort, Search, SetSystem, fewest};
///
/// // Six sets, one of which is empty, over four elements.
/// let system = SetSystem::from_sets(4, &[vec![0, 1], vec![0], vec![1], vec![2], vec![3], vec![]]);
/// let search = Search { separation: 1, target: 0, effort: Effort::Full, stop: &|| false };
/// let choice = fewest(&system, &[0, 1, 2, 3], &search);
/// assert_eq!(choice.elements, [0, 1, 2, 3]);
/// assert!(choice.is_fewest());
/// ```
#[must_use]
pub fn fewest(system: &SetSystem, order: &[usize], search: &Search<'_>) -> Choice {
    halting_fewest(system, order, search, &Halt::new(&never)).unwrap_or_default()
}

/// The same; none where `halt` ends what comes before the first choice, which `search.stop` does not end.
pub(in crate::point_sampling) fn halting_fewest(
    system: &SetSystem,
    order: &[usize],
    search: &Search<'_>,
    halt: &Halt<'_>,
) -> Option<Choice> {
    let separation = search.separation.max(1);
    let columns = Columns::new(system, order, Demands::new(system, separation, halt)?, halt)?;
    let parts = if separation == 1 && search.target == 0 && search.effort == Effort::Full {
        components(&columns, halt)?
    } else {
        Vec::new()
    };
    let found = if parts.len() > 1 {
        by_components(&columns, &parts, search, halt)?
    } else {
        Rounds::new(&columns, search, halt)?.run(halt)?
    };
    // A component's own bound may be one more than what it takes beside the others.
    let proof = Proof { program: found.proof.program.min(found.lower_bound), ..found.proof };
    let mut elements: Vec<usize> = found.columns.iter().map(|&column| columns.elements[column]).collect();
    elements.sort_unstable();
    Some(Choice { elements, lower_bound: found.lower_bound, proof })
}

/// A choice of columns.
#[derive(Clone, Debug, Default)]
struct Found {
    columns: Vec<usize>,
    lower_bound: usize,
    proof: Proof,
}

/// The methods in turn.
struct Rounds<'a> {
    columns: &'a Columns,
    search: &'a Search<'a>,
    found: Found,
}

impl<'a> Rounds<'a> {
    /// With the greedy choice; none where it should halt before.
    fn new(columns: &'a Columns, search: &'a Search<'a>, halt: &Halt<'_>) -> Option<Self> {
        let demands = &columns.demands;
        let digits = match columns.sets {
            0 | 1 => 0,
            // Without all but one of the columns by which the nearest sets differ the codes still differ (Singleton).
            sets if demands.fewest > 0 => {
                let digits = log2_ceil(u32::try_from(sets).unwrap_or(u32::MAX)) + demands.fewest - 1;
                digits.max(demands.largest())
            }
            _ => demands.largest(),
        };
        let proof = Proof { digits, ..Proof::default() };
        let greedy = greedy_multiple(columns, halt)?;
        Some(Self { columns, search, found: Found { columns: greedy, lower_bound: digits, proof } })
    }

    fn run(mut self, halt: &Halt<'_>) -> Option<Found> {
        // Sets that nothing tells apart have no bound of their own: the greedy choice separates what can be.
        if self.search.effort == Effort::Greedy
            || self.is_over()
            || !self.columns.halting_are_separated_by(&self.found.columns, halt)?
        {
            self.found.lower_bound = self.found.lower_bound.min(self.found.columns.len());
            return Some(self.found);
        }
        let start = self.found.columns.clone();
        let mut local = Local::new(self.columns, &start, self.search.stop);
        // Up to one less than is known: whether that many are enough is asked when local search has found what it can.
        self.refute(REFUTED_AT_ONCE, 1);
        for round in 0.. {
            if self.is_over() {
                break;
            }
            let budget = self.budget();
            if let Some(better) = local.as_mut().and_then(|local| self.run_local(local, grown(budget.scores, round))) {
                self.improve(better);
            }
            if round == 0 {
                self.refute(self.budget().refuted, 0);
            }
            // At first to find fewer, then to prove that there are not.
            let order = if round == 0 { Order::Most } else { Order::Fewest };
            self.partition(grown(budget.partitions, budget.partitions_growth * round), order);
            if round == 0 {
                self.branch(0);
            }
            if round > 0 || !self.is_dense() {
                self.branch(grown(budget.programs, round));
            }
            let brief = self.search.effort == Effort::Brief && round + 1 >= ROUNDS_BRIEF;
            if brief || self.search.stop.stops() {
                break;
            }
        }
        Some(self.found)
    }

    fn is_over(&self) -> bool {
        let size = self.found.columns.len();
        size <= self.found.lower_bound
            || size <= self.search.target
            || (self.found.lower_bound > self.search.target && self.search.target > 0)
    }

    fn budget(&self) -> Budget {
        if self.is_dense() { DENSE } else { SPARSE }
    }

    fn is_dense(&self) -> bool {
        self.found.columns.len() <= self.found.proof.digits + DENSE_EXTRA
    }

    fn improve(&mut self, columns: Vec<usize>) {
        if columns.len() < self.found.columns.len() {
            self.found.columns = columns;
        }
    }

    fn run_local(&self, local: &mut Local<'_>, work: u64) -> Option<Vec<usize>> {
        local.run(work, self.search.target.max(self.found.lower_bound), self.search.stop)
    }

    /// Raises the bound while no so few columns are enough, until the states are used up or it is so far below what is
    /// known.
    fn refute(&mut self, states: u64, below: usize) {
        if self.columns.demands.most > 1 || self.columns.sets > SETS_MAX {
            return;
        }
        let mut partition = Partition::new(states, Order::Fewest, self.search.stop);
        while !self.is_over() && self.found.lower_bound + below < self.found.columns.len() {
            match partition.search(self.columns, self.found.lower_bound) {
                Outcome::Found(columns) => self.improve(columns),
                Outcome::Refuted => self.found.lower_bound += 1,
                Outcome::Open => break,
            }
        }
        self.found.proof.partitions += partition.states;
    }

    /// Looks for one column fewer until there is none, or until the states are used up.
    fn partition(&mut self, states: u64, order: Order) {
        if self.columns.demands.most > 1 || self.columns.sets > SETS_MAX {
            return;
        }
        let mut partition = Partition::new(states, order, self.search.stop);
        while !self.is_over() {
            let size = self.found.columns.len();
            match partition.search(self.columns, size - 1) {
                Outcome::Found(columns) => self.improve(columns),
                Outcome::Refuted => self.found.lower_bound = size,
                Outcome::Open => break,
            }
        }
        self.found.proof.partitions += partition.states;
    }

    fn branch(&mut self, programs: u64) {
        if self.is_over() {
            return;
        }
        let best = self.found.columns.clone();
        let mut branch = Branch::new(self.columns, best, programs, self.search.stop);
        let bound = branch.run(self.found.lower_bound, self.search.target);
        self.found.lower_bound = self.found.lower_bound.max(bound);
        self.found.proof.program = self.found.proof.program.max(branch.root_bound);
        self.found.proof.branches += branch.nodes;
        self.improve(branch.best);
    }
}

/// A budget doubled so many times.
fn grown(budget: u64, doublings: u32) -> u64 {
    budget << doublings.min(DOUBLINGS_MAX)
}

/// Sets that are connected through columns, and the columns that connect them.
#[derive(Clone, Default)]
struct Component {
    sets: Vec<usize>,
    columns: Vec<usize>,
}

/// What the sets fall apart into, the smallest first; none where it should halt before.
fn components(columns: &Columns, halt: &Halt<'_>) -> Option<Vec<Component>> {
    let mut part: Vec<usize> = (0..columns.sets).collect();
    for holders in &columns.holders {
        halt.goes_on()?;
        let least = holders.row().iter().map(|set| part[set]).min().unwrap_or(0);
        let joined: Vec<usize> = holders.row().iter().map(|set| part[set]).collect();
        part.iter_mut().filter(|part| joined.contains(part)).for_each(|part| *part = least);
    }
    let mut parts = vec![Component::default(); columns.sets];
    part.iter().enumerate().for_each(|(set, &part)| parts[part].sets.push(set));
    for (column, holders) in columns.holders.iter().enumerate() {
        if let Some(set) = holders.row().iter().next() {
            parts[part[set]].columns.push(column);
        }
    }
    parts.retain(|part| !part.sets.is_empty());
    parts.sort_by_key(|part| (part.sets.len(), part.columns.len()));
    Some(parts)
}

/// Solves components one by one. Two sets of different components are told apart unless both have no chosen element, so
/// in all components but one no set may be without. That is what an empty set beside the others asks for; leaving it
/// out saves one element at most.
fn by_components(columns: &Columns, parts: &[Component], search: &Search<'_>, halt: &Halt<'_>) -> Option<Found> {
    let mut total = Found {
        proof: Proof { digits: log2_ceil(u32::try_from(columns.sets).unwrap_or(u32::MAX)), ..Proof::default() },
        ..Found::default()
    };
    // A set without any column is the one without a chosen element.
    let mut settled = parts.iter().any(|part| part.columns.is_empty());
    let mut saved = 0;
    for part in parts {
        let with = solve_part(columns, part, true, search, halt)?;
        let mut chosen = with.columns.clone();
        total.lower_bound += with.lower_bound;
        add_proof(&mut total.proof, &with.proof);
        if !settled {
            let target = with.columns.len().saturating_sub(1);
            let without = if part.sets.len() == 1 {
                Found::default()
            } else {
                solve_part(columns, part, false, &Search { target, ..*search }, halt)?
            };
            total.proof.branches += without.proof.branches;
            total.proof.partitions += without.proof.partitions;
            // Something may be saved as long as no bound says otherwise.
            saved |= usize::from(without.lower_bound < with.lower_bound);
            if without.columns.len() < with.columns.len() {
                chosen = without.columns;
                (settled, saved) = (true, 1);
            }
        }
        total.columns.extend(chosen);
    }
    total.lower_bound = total.lower_bound.saturating_sub(saved).max(total.proof.digits);
    total.proof.program = total.proof.program.saturating_sub(saved);
    Some(total)
}

fn add_proof(total: &mut Proof, part: &Proof) {
    total.program += part.program.max(part.digits);
    total.branches += part.branches;
    total.partitions += part.partitions;
}

/// The choice for one component, with an empty set beside its own or without.
fn solve_part(
    columns: &Columns,
    Component { sets, columns: own }: &Component,
    with_empty: bool,
    search: &Search<'_>,
    halt: &Halt<'_>,
) -> Option<Found> {
    let elements = own.iter().map(|&column| {
        let holders = columns.holders[column].row();
        let inside = sets.iter().enumerate().filter(|(_, set)| holders.has(**set)).map(|(place, _)| place);
        crate::math::bits::BitSet::of(sets.len() + 1, inside)
    });
    let system = SetSystem::new(sets.len() + usize::from(with_empty), elements.collect());
    let order: Vec<usize> = (0..own.len()).collect();
    let part = Columns::new(&system, &order, Demands::new(&system, 1, halt)?, halt)?;
    let found = Rounds::new(&part, search, halt)?.run(halt)?;
    let chosen = found.columns.iter().map(|&column| own[part.elements[column]]).collect();
    Some(Found { columns: chosen, ..found })
}
