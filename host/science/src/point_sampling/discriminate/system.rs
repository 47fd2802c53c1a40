//! A collection of sets over some elements, and what is enough to tell the sets apart.

use std::collections::HashMap;

use crate::math::bits::{BitRow, BitSet};
use crate::search::{Halt, never};

/// Sets to tell apart, and the elements that can be asked for.
///
/// ```
/// use palpate::point_sampling::SetSystem;
///
/// // The sets {a}, {a, b} and {}, by their elements.
/// let system = SetSystem::from_sets(2, &[vec![0], vec![0, 1], vec![]]);
/// assert!(system.tells_apart(&[0, 1]));
/// assert!(!system.tells_apart(&[0]));
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SetSystem {
    sets: usize,
    /// Of each element, the sets that have it.
    holders: Vec<BitSet>,
}

impl SetSystem {
    /// A system of so many sets, by the sets that have each element.
    #[must_use]
    pub fn new(sets: usize, holders: Vec<BitSet>) -> Self {
        Self { sets, holders }
    }

    /// A system by the elements, below `elements`, that each set has.
    #[must_use]
    pub fn from_sets(elements: usize, sets: &[Vec<usize>]) -> Self {
        let mut holders = vec![BitSet::new(sets.len()); elements];
        for (number, set) in sets.iter().enumerate() {
            set.iter().for_each(|&element| holders[element].insert(number));
        }
        Self { sets: sets.len(), holders }
    }

    /// How many sets there are.
    #[must_use]
    pub fn sets(&self) -> usize {
        self.sets
    }

    /// How many elements there are.
    #[must_use]
    pub fn elements(&self) -> usize {
        self.holders.len()
    }

    /// The sets that have an element.
    #[must_use]
    pub fn holders(&self, element: usize) -> BitRow<'_> {
        self.holders[element].row()
    }

    /// Whether some of these elements are in one set and not in the other, for any two sets.
    #[must_use]
    pub fn tells_apart(&self, elements: &[usize]) -> bool {
        self.separation(elements).is_none_or(|least| least > 0)
    }

    /// The least number of these elements by which two sets differ; none for fewer than two sets.
    #[must_use]
    pub fn separation(&self, elements: &[usize]) -> Option<usize> {
        let codes: Vec<_> = (0..self.sets).map(|set| self.code(set, elements)).collect();
        let distance = |a: &BitSet, b: &BitSet| distance_up_to(a, b, usize::MAX);
        let pairs = codes.iter().enumerate().flat_map(|(i, a)| codes[..i].iter().map(move |b| distance(a, b)));
        pairs.min()
    }

    /// Pairs of sets, the lesser number first, that differ by fewer than `least` of these elements, and by how many.
    #[must_use]
    pub fn shortfalls(&self, elements: &[usize], least: usize) -> Vec<([usize; 2], usize)> {
        self.halting_shortfalls(elements, least, &Halt::new(&never)).unwrap_or_default()
    }

    /// The same; none where it should halt before.
    pub(super) fn halting_shortfalls(
        &self,
        elements: &[usize],
        least: usize,
        halt: &Halt<'_>,
    ) -> Option<Vec<([usize; 2], usize)>> {
        let codes: Vec<_> = (0..self.sets).map(|set| self.halting_code(set, elements, halt)).collect::<Option<_>>()?;
        let mut short = Vec::new();
        for (i, a) in codes.iter().enumerate() {
            for (j, b) in codes.iter().enumerate().skip(i + 1) {
                // A code may be as long as there are regions.
                halt.goes_on()?;
                let count = distance_up_to(a, b, least);
                if count < least {
                    short.push(([i, j], count));
                }
            }
        }
        Some(short)
    }

    /// Whether any two sets differ by `least` of these elements, or by as many as they differ by at all.
    #[must_use]
    pub fn keeps_apart(&self, elements: &[usize], least: usize) -> bool {
        self.halting_keeps_apart(elements, least, &Halt::new(&never)).unwrap_or(false)
    }

    /// The same; none where it should halt before.
    pub(in crate::point_sampling) fn halting_keeps_apart(
        &self,
        elements: &[usize],
        least: usize,
        halt: &Halt<'_>,
    ) -> Option<bool> {
        let all = self.halting_shortfalls(&self.all(), least, halt)?;
        Some(self.halting_shortfalls(elements, least, halt)? == all)
    }

    fn all(&self) -> Vec<usize> {
        (0..self.elements()).collect()
    }

    /// Which of these elements a set has.
    #[must_use]
    pub fn code(&self, set: usize, elements: &[usize]) -> BitSet {
        self.halting_code(set, elements, &Halt::new(&never)).unwrap_or_else(|| unreachable!("nobody wishes it to halt"))
    }

    /// The same; none where it should halt before.
    fn halting_code(&self, set: usize, elements: &[usize], halt: &Halt<'_>) -> Option<BitSet> {
        let mut looks = halt.now_and_then();
        let mut code = BitSet::new(elements.len());
        halt.goes_on()?;
        for (place, &element) in elements.iter().enumerate() {
            looks.goes_on()?;
            if self.holders[element].row().has(set) {
                code.insert(place);
            }
        }
        Some(code)
    }

    /// Pairs of sets, the lesser number first, that differ by fewer than `least` elements of all.
    #[must_use]
    pub fn closer_than(&self, least: usize) -> Vec<[usize; 2]> {
        self.halting_closer_than(least, &Halt::new(&never)).unwrap_or_default()
    }

    /// The same; none where it should halt before.
    pub(in crate::point_sampling) fn halting_closer_than(
        &self,
        least: usize,
        halt: &Halt<'_>,
    ) -> Option<Vec<[usize; 2]>> {
        let short = self.halting_shortfalls(&self.all(), least, halt)?;
        Some(short.into_iter().map(|(pair, _)| pair).collect())
    }
}

/// In how many places two codes differ; `most` where they differ in so many or more.
fn distance_up_to(a: &BitSet, b: &BitSet, most: usize) -> usize {
    let mut count = 0;
    for (p, q) in a.row().words().iter().zip(b.row().words()) {
        count += (p ^ q).count_ones() as usize;
        if count >= most {
            return most;
        }
    }
    count
}

/// By how many columns each pair of sets is to differ.
///
/// That two sets differ by fewer elements than are asked for says nothing about a third set: being close is not
/// transitive, so each pair has a demand of its own.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Demands {
    /// What is asked for.
    pub most: usize,
    /// The least of all pairs.
    pub fewest: usize,
    /// Of each pair, by [`pair_number`]; empty where it is `most` for all.
    of_pair: Vec<usize>,
}

impl Demands {
    /// `separation` of any two sets that differ by so many elements of the system; all by which they differ of others.
    /// None where it should halt before.
    pub(super) fn new(system: &SetSystem, separation: usize, halt: &Halt<'_>) -> Option<Self> {
        // Sets that nothing tells apart are told from what is chosen: see `Rounds`.
        let short =
            if separation > 1 { system.halting_shortfalls(&system.all(), separation, halt)? } else { Vec::new() };
        let fewest = short.iter().map(|(_, count)| *count).min().unwrap_or(separation);
        let mut of_pair = Vec::new();
        if !short.is_empty() {
            of_pair = vec![separation; system.sets * system.sets.saturating_sub(1) / 2];
            short.iter().for_each(|&([i, j], count)| of_pair[pair_number(i, j)] = count);
        }
        Some(Self { most: separation, fewest, of_pair })
    }

    /// Of a pair, by its [`pair_number`].
    pub(super) fn of(&self, pair: usize) -> usize {
        self.of_pair.get(pair).copied().unwrap_or(self.most)
    }

    /// The largest of any pair.
    pub(super) fn largest(&self) -> usize {
        self.of_pair.iter().copied().max().unwrap_or(self.most)
    }
}

/// The number of a pair of different sets.
pub(super) fn pair_number(a: usize, b: usize) -> usize {
    let (low, high) = (a.min(b), a.max(b));
    high * (high - 1) / 2 + low
}

/// The elements that matter, as columns: none that is in all sets or in none, and of those that separate the same pairs
/// only as many as can be of use.
#[derive(Clone, Debug)]
pub(super) struct Columns {
    pub sets: usize,
    /// Of each column, the sets on the side without set 0.
    pub sides: Vec<BitSet>,
    /// Of each column, the sets that have the element.
    pub holders: Vec<BitSet>,
    /// The element that each column stands for.
    pub elements: Vec<usize>,
    /// By how many chosen columns each pair of sets is to differ.
    pub demands: Demands,
}

impl Columns {
    /// Of elements that separate the same pairs keeps those that come first in `order`, as many as any two sets are to
    /// differ by.
    /// None where it should halt before.
    pub(super) fn new(system: &SetSystem, order: &[usize], demands: Demands, halt: &Halt<'_>) -> Option<Self> {
        let copies = demands.most;
        let all = BitSet::full(system.sets);
        let mut known: HashMap<BitSet, usize> = HashMap::new();
        let (sides, holders, elements) = (Vec::new(), Vec::new(), Vec::new());
        let mut columns = Self { sets: system.sets, sides, holders, elements, demands };
        for &element in order {
            halt.goes_on()?;
            let mut side = system.holders[element].clone();
            if system.sets > 0 && side.row().has(0) {
                side.toggle(all.row());
            }
            if !side.row().any() {
                continue;
            }
            let count = known.entry(side.clone()).or_insert(0);
            if *count < copies {
                *count += 1;
                columns.sides.push(side);
                columns.holders.push(system.holders[element].clone());
                columns.elements.push(element);
            }
        }
        Some(columns)
    }

    /// The same for separation 1, however long it takes.
    pub(super) fn of_all(system: &SetSystem, order: &[usize]) -> Self {
        let halt = Halt::new(&never);
        let columns = Demands::new(system, 1, &halt).and_then(|demands| Self::new(system, order, demands, &halt));
        columns.unwrap_or_else(|| unreachable!("nobody wishes it to halt"))
    }

    /// How many columns there are.
    pub(super) fn len(&self) -> usize {
        self.sides.len()
    }

    /// Whether a column separates two sets.
    pub(super) fn separates(&self, column: usize, a: usize, b: usize) -> bool {
        let side = self.sides[column].row();
        side.has(a) != side.has(b)
    }

    /// Whether these columns separate every pair as often as is demanded.
    pub(super) fn are_separated_by(&self, chosen: &[usize]) -> bool {
        self.halting_are_separated_by(chosen, &Halt::new(&never)).unwrap_or(false)
    }

    /// The same; none where it should halt before.
    pub(super) fn halting_are_separated_by(&self, chosen: &[usize], halt: &Halt<'_>) -> Option<bool> {
        let apart = |a: usize, b: usize| {
            let separating = chosen.iter().filter(|&&column| self.separates(column, a, b)).count();
            separating >= self.demands.of(pair_number(a, b))
        };
        for a in 0..self.sets {
            halt.goes_on()?;
            if !(0..a).all(|b| apart(a, b)) {
                return Some(false);
            }
        }
        Some(true)
    }
}
