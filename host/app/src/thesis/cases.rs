//! The cases of an experiment, on all processors.
//!
//! Errors: none.

use std::num::NonZeroUsize;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use palpate::math::random::Draw;
use palpate::pushing::dynamics::Part;

use super::progress;

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

/// What comes of each case from 0 to `cases`, in order. Each thread takes the next case when it is done with one.
pub(super) fn of_each<O: Send>(cases: usize, outcome: impl Fn(usize) -> O + Sync) -> Vec<O> {
    let next = AtomicUsize::new(0);
    let done = Mutex::new(Vec::with_capacity(cases));
    let work = || {
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= cases {
                return;
            }
            let outcome = outcome(number);
            if let Ok(mut done) = done.lock() {
                done.push((number, outcome));
                progress::cases_done(done.len(), cases);
            }
        }
    };
    let threads = std::thread::available_parallelism().map_or(1, NonZeroUsize::get);
    std::thread::scope(|scope| (0..threads).for_each(|_| drop(scope.spawn(work))));
    let mut done = done.into_inner().unwrap_or_default();
    done.sort_by_key(|(number, _)| *number);
    done.into_iter().map(|(_, outcome)| outcome).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outcomes_are_in_the_order_of_their_cases() {
        assert_eq!(of_each(100, |number| number * number), (0..100).map(|number| number * number).collect::<Vec<_>>());
    }
}
