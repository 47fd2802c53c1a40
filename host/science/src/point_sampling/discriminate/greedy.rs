//! The greedy choice: again and again the column that separates most of the pairs not yet separated (thesis §3.4).
//!
//! It needs at most 1 + ln(n²/4) < 2 ln n times as many columns as are needed at all.

use super::system::{Columns, pair_number};
use crate::math::bits::BitSet;
use crate::search::Halt;

/// Columns whose gains are looked at between two questions whether to go on.
const LOOK_EACH: usize = 16;

/// Columns that separate every pair, or as many pairs as can be; the first of equals is taken. None where it should
/// halt before.
pub(super) fn greedy(columns: &Columns, halt: &Halt<'_>) -> Option<Vec<usize>> {
    let mut classes = vec![BitSet::full(columns.sets)];
    let mut chosen = Vec::new();
    classes.retain(|class| class.row().count() > 1);
    while !classes.is_empty() {
        let gain = |column: usize| classes.iter().map(|class| split_gain(columns, column, class)).sum::<usize>();
        let best = most((0..columns.len()).map(|column| (gain(column), column)), halt)?;
        let Some((1.., column)) = best else { break };
        classes = classes.iter().flat_map(|class| split(columns, column, class)).collect();
        chosen.push(column);
    }
    Some(chosen)
}

/// The largest gain with its column, the first of equals; none where it should halt before.
fn most(gains: impl Iterator<Item = (usize, usize)>, halt: &Halt<'_>) -> Option<Option<(usize, usize)>> {
    let mut best: Option<(usize, usize)> = None;
    for (number, (gain, column)) in gains.enumerate() {
        if number.is_multiple_of(LOOK_EACH) {
            halt.goes_on()?;
        }
        if best.is_none_or(|(most, _)| gain > most) {
            best = Some((gain, column));
        }
    }
    Some(best)
}

/// The pairs in a class that a column separates.
fn split_gain(columns: &Columns, column: usize, class: &BitSet) -> usize {
    let inside = columns.sides[column].row().count_common(class.row());
    inside * (class.row().count() - inside)
}

/// The two parts of a class, those with one member left out.
fn split(columns: &Columns, column: usize, class: &BitSet) -> impl Iterator<Item = BitSet> {
    let (mut inside, mut outside) = (class.clone(), class.clone());
    inside.keep(columns.sides[column].row());
    outside.drop_all(columns.sides[column].row());
    [inside, outside].into_iter().filter(|class| class.row().count() > 1)
}

/// As [`greedy`], until every pair is separated by so many different columns as are demanded, or as there are.
pub(super) fn greedy_multiple(columns: &Columns, halt: &Halt<'_>) -> Option<Vec<usize>> {
    if columns.demands.most <= 1 {
        return greedy(columns, halt);
    }
    let pairs: Vec<[usize; 2]> = (0..columns.sets).flat_map(|i| (0..i).map(move |j| [i, j])).collect();
    let mut missing: Vec<usize> = pairs.iter().map(|&[a, b]| columns.demands.of(pair_number(a, b))).collect();
    let (mut free, mut chosen) = (vec![true; columns.len()], Vec::new());
    loop {
        let gain = |column: usize| {
            let open = pairs.iter().zip(&missing).filter(|(_, missing)| **missing > 0);
            open.filter(|([a, b], _)| columns.separates(column, *a, *b)).count()
        };
        let candidates = (0..columns.len()).filter(|&column| free[column]);
        let best = most(candidates.map(|column| (gain(column), column)), halt)?;
        let Some((1.., column)) = best else { return Some(chosen) };
        for (missing, [a, b]) in missing.iter_mut().zip(&pairs) {
            *missing -= usize::from(*missing > 0 && columns.separates(column, *a, *b));
        }
        free[column] = false;
        chosen.push(column);
    }
}
