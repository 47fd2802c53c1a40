//! A collection of sets over some elements, and what is enough to tell the sets apart.

use std::collections::HashMap;

use crate::math::bits::{BitRow, BitSet};

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
        let distance = |a: &BitSet, b: &BitSet| {
            let mut difference = a.clone();
            difference.toggle(b.row());
            difference.row().count()
        };
        let pairs = codes.iter().enumerate().flat_map(|(i, a)| codes[..i].iter().map(move |b| distance(a, b)));
        pairs.min()
    }

    /// Which of these elements a set has.
    #[must_use]
    pub fn code(&self, set: usize, elements: &[usize]) -> BitSet {
        let has = elements.iter().enumerate().filter(|(_, element)| self.holders[**element].row().has(set));
        BitSet::of(elements.len(), has.map(|(place, _)| place))
    }

    /// Pairs of sets, the lesser number first, that differ by fewer than `least` elements of all.
    #[must_use]
    pub fn closer_than(&self, least: usize) -> Vec<[usize; 2]> {
        let all: Vec<usize> = (0..self.elements()).collect();
        let codes: Vec<_> = (0..self.sets).map(|set| self.code(set, &all)).collect();
        let is_close = |a: &BitSet, b: &BitSet| {
            let (a, b) = (a.row().words(), b.row().words());
            let mut count = 0;
            a.iter().zip(b).all(|(p, q)| {
                count += (p ^ q).count_ones() as usize;
                count < least
            })
        };
        let of = |i: usize| (i + 1..codes.len()).map(move |j| [i, j]);
        (0..codes.len()).flat_map(of).filter(|&[i, j]| is_close(&codes[i], &codes[j])).collect()
    }
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
}

impl Columns {
    /// Of elements that separate the same pairs keeps the `copies` that come first in `order`.
    pub(super) fn new(system: &SetSystem, order: &[usize], copies: usize) -> Self {
        let all = BitSet::full(system.sets);
        let mut known: HashMap<BitSet, usize> = HashMap::new();
        let mut columns = Self { sets: system.sets, sides: Vec::new(), holders: Vec::new(), elements: Vec::new() };
        for &element in order {
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
        columns
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
}
