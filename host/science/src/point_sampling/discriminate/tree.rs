//! Asking one element at a time, the next depending on the answers so far (Arkin et al. 1993): a tree of questions.
//!
//! The depth is what is asked in the worst case: fewer questions than a fixed choice has elements, or as many. A tree
//! of least depth may need more elements in all than the smallest fixed choice, and the other way round (thesis §3.4,
//! footnote 7, whose own example does not show it; `few_elements_and_shallow_questions_may_exclude_each_other` does).

use std::collections::{HashMap, HashSet};

use super::solve::Search;
use super::system::{Columns, SetSystem};
use crate::math::bits::BitSet;

/// States that the search for less depth may look at.
const STATES_MAX: usize = 200_000;

/// A tree of questions.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Question {
    /// Only these sets are left; more than one only if nothing tells them apart.
    Answer(Vec<usize>),
    /// Ask for an element next.
    Ask {
        /// Number of the element to ask for.
        element: usize,
        /// If the set has it.
        yes: Box<Question>,
        /// If it has not.
        no: Box<Question>,
    },
}

impl Question {
    /// The most questions that may have to be asked.
    #[must_use]
    pub fn depth(&self) -> usize {
        match self {
            Self::Answer(_) => 0,
            Self::Ask { yes, no, .. } => 1 + yes.depth().max(no.depth()),
        }
    }

    /// The elements asked for anywhere.
    #[must_use]
    pub fn elements(&self) -> Vec<usize> {
        let mut elements = match self {
            Self::Answer(_) => Vec::new(),
            Self::Ask { element, yes, no } => [vec![*element], yes.elements(), no.elements()].concat(),
        };
        elements.sort_unstable();
        elements.dedup();
        elements
    }
}

/// A tree of questions of small depth, and the least depth that is proven to be needed.
#[must_use]
pub fn questions(system: &SetSystem, order: &[usize], search: &Search<'_>) -> (Question, usize) {
    let columns = Columns::of_all(system, order);
    let all = BitSet::full(columns.sets);
    let mut asker = Asker { columns: &columns, hopeless: HashSet::new(), states: 0, search };
    let mut best = asker.balanced(&all);
    let mut depth = super::partition::log2_ceil(u32::try_from(columns.sets).unwrap_or(u32::MAX));
    while depth < best.depth() {
        match asker.within(&all, depth) {
            Some(Some(found)) => best = found,
            Some(None) => depth += 1,
            None => break,
        }
    }
    (best, depth)
}

struct Asker<'a> {
    columns: &'a Columns,
    /// Sets that cannot be told apart within so many questions.
    hopeless: HashSet<(BitSet, usize)>,
    states: usize,
    search: &'a Search<'a>,
}

impl Asker<'_> {
    /// Always asks what divides most evenly.
    fn balanced(&self, sets: &BitSet) -> Question {
        let size = sets.row().count();
        let larger = |column: usize| {
            let inside = self.columns.sides[column].row().count_common(sets.row());
            inside.max(size - inside)
        };
        let best = (0..self.columns.len()).map(|column| (larger(column), column)).min();
        match best {
            Some((larger, column)) if size > 1 && larger < size => {
                let [yes, no] = self.answers(sets, column);
                self.ask(column, self.balanced(&yes), self.balanced(&no))
            }
            _ => Question::Answer(sets.row().iter().collect()),
        }
    }

    fn ask(&self, column: usize, yes: Question, no: Question) -> Question {
        Question::Ask { element: self.columns.elements[column], yes: Box::new(yes), no: Box::new(no) }
    }

    /// The sets with the column's element, and those without.
    fn answers(&self, sets: &BitSet, column: usize) -> [BitSet; 2] {
        let (mut yes, mut no) = (sets.clone(), sets.clone());
        yes.keep(self.columns.holders[column].row());
        no.drop_all(self.columns.holders[column].row());
        [yes, no]
    }

    /// A tree of at most this depth if there is one; none if the search took too long.
    fn within(&mut self, sets: &BitSet, depth: usize) -> Option<Option<Question>> {
        let size = sets.row().count();
        if size <= 1 {
            return Some(Some(Question::Answer(sets.row().iter().collect())));
        }
        let most = 1_usize.checked_shl(u32::try_from(depth).unwrap_or(u32::MAX)).unwrap_or(usize::MAX);
        if size > most || self.hopeless.contains(&(sets.clone(), depth)) {
            return Some(None);
        }
        self.states += 1;
        if self.states > STATES_MAX || (self.states.is_multiple_of(256) && self.search.stop.stops()) {
            return None;
        }
        for column in self.divisions(sets, most / 2) {
            let [yes, no] = self.answers(sets, column);
            let (first, second) = if yes.row().count() >= no.row().count() { (&yes, &no) } else { (&no, &yes) };
            let Some(_) = self.within(first, depth - 1)? else { continue };
            let Some(_) = self.within(second, depth - 1)? else { continue };
            let (Some(yes), Some(no)) = (self.within(&yes, depth - 1)?, self.within(&no, depth - 1)?) else { continue };
            return Some(Some(self.ask(column, yes, no)));
        }
        self.hopeless.insert((sets.clone(), depth));
        Some(None)
    }

    /// The columns that divide sets differently, into parts of at most `most`; the most even first.
    fn divisions(&self, sets: &BitSet, most: usize) -> Vec<usize> {
        let size = sets.row().count();
        let mut seen: HashMap<BitSet, ()> = HashMap::new();
        let mut found = Vec::new();
        for column in 0..self.columns.len() {
            let mut inside = self.columns.sides[column].clone();
            inside.keep(sets.row());
            let count = inside.row().count();
            if count == 0 || count == size || count.max(size - count) > most {
                continue;
            }
            if seen.insert(inside, ()).is_none() {
                found.push((count.max(size - count), column));
            }
        }
        found.sort_unstable();
        found.into_iter().map(|(_, column)| column).collect()
    }
}
