//! The cases of an experiment, on all processors.
//!
//! Errors: none.

use std::num::NonZeroUsize;
use std::sync::Mutex;

use palpate::math::random::Draw;
use palpate::pushing::dynamics::Part;

use super::progress;
use crate::threads::{processors, shared};

/// A part as the experiments on pushes in motion draw it: three of five are convex, the others stars.
pub(super) fn random_part(draw: &mut Draw) -> Part {
    let polygon = if draw.chance(0.6) {
        let points = 3 + draw.index(7);
        draw.convex_polygon(points, 0.05)
    } else {
        let vertices = 4 + draw.index(6);
        draw.star_polygon(vertices, 0.02, 0.05)
    };
    Part::uniform(polygon)
}

/// The first that can be of those drawn in turn.
pub(super) fn until_possible<T>(draw: &mut Draw, mut try_draw: impl FnMut(&mut Draw) -> Option<T>) -> T {
    loop {
        if let Some(drawn) = try_draw(draw) {
            return drawn;
        }
    }
}

/// What comes of each case from 0 to `cases`, in order.
pub(super) fn of_each<O: Send>(cases: usize, outcome: impl Fn(usize) -> O + Sync) -> Vec<O> {
    of_each_in_order(cases, processors(), outcome, |_| ())
}

/// The same on so many threads; `tell` gets each outcome as soon as it and all before it are there.
pub(super) fn of_each_in_order<O: Send>(
    cases: usize,
    threads: NonZeroUsize,
    outcome: impl Fn(usize) -> O + Sync,
    tell: impl FnMut(&O) + Send,
) -> Vec<O> {
    struct Told<O, T> {
        outcomes: Vec<Option<O>>,
        told: usize,
        done: usize,
        tell: T,
    }
    let told = Mutex::new(Told { outcomes: (0..cases).map(|_| None).collect(), told: 0, done: 0, tell });
    shared(cases, threads, |number| {
        let outcome = outcome(number);
        if let Ok(mut told) = told.lock() {
            let Told { outcomes, told, done, tell } = &mut *told;
            outcomes[number] = Some(outcome);
            *done += 1;
            progress::cases_done(*done, cases);
            while let Some(Some(outcome)) = outcomes.get(*told) {
                tell(outcome);
                *told += 1;
            }
        }
    });
    told.into_inner().map(|told| told.outcomes.into_iter().flatten().collect()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_are_in_the_order_of_their_cases() {
        let mut told = Vec::new();
        let two = NonZeroUsize::new(2).unwrap();
        of_each_in_order(100, two, |number| number, |number| told.push(*number));
        assert_eq!(told, (0..100).collect::<Vec<_>>());
        assert_eq!(of_each(100, |number| number * number), (0..100).map(|number| number * number).collect::<Vec<_>>());
    }
}
