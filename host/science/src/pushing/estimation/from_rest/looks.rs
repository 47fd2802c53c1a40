//! Looks at one of many parts, each at more of a push than the one before: how far is the part from explaining it? Of hundreds
//! of parts few are worth a search.
//!
//! The first look tries guesses all over the part, three times as far apart as a search does, on the first fifth of a second,
//! and follows the best of them for a few steps; each further one begins with what is left of them. What a model is off by
//! counts as more than it is ([`SHARE`]), so that a grid so wide does not pass between two places.
//!
//! Units: SI. Errors: none; a part that cannot be pushed so misfits without end.

use super::felt::Felt as _;
use super::path::Guess;
use super::seeds::Cover;
use super::{KnownFromRest, Problem, Tried, WindowedForce, apart, course, least_cost, misfit_limit, starts, symmetry};
use crate::search::{Halt, never};

/// Windows of each look: up to 0.2 s, 0.4 s and the end.
const WINDOWS: [usize; 3] = [9, 19, usize::MAX];

/// What a model is off by at each look, as a share of the force: at the first as much as a grid so wide leaves.
const SHARE: [f64; 3] = [0.02, 0.01, 0.0];

/// Guesses that are followed at each look, at the most.
const FOLLOWED: [usize; 3] = [10, 6, 4];

/// As many of one edge, at the most.
const FOLLOWED_OF_EDGE: usize = 3;

/// A guess so many times dearer than the limit is not followed.
const HOPELESS: f64 = 300.0;

/// Steps that each of them goes down.
const STEPS: [usize; 3] = [3, 3, 4];

/// How far a part is from explaining the beginning of a push.
#[derive(Clone, Debug)]
pub struct Look {
    /// The least cost over the largest that noise leaves once in a thousand times.
    pub misfit: f64,
    /// Where the next look begins.
    guesses: Vec<Guess>,
    /// How many looks there were.
    looks: usize,
}

impl Look {
    /// After so many looks all of the push was looked at.
    pub const COUNT: usize = WINDOWS.len();

    /// The first look at a part.
    #[must_use]
    pub fn first(known: &KnownFromRest, measured: &WindowedForce) -> Self {
        let edges = symmetry::distinct(known.part, symmetry::order(known.part));
        looked(known, measured, 0, |problem| starts(problem, &edges, Cover::Wide, &Halt::new(&never)))
    }

    /// A look at more of the same push.
    #[must_use]
    pub fn further(&self, known: &KnownFromRest, measured: &WindowedForce) -> Self {
        let number = self.looks.min(WINDOWS.len() - 1);
        looked(known, measured, number, |problem| {
            self.guesses.iter().filter_map(|guess| problem.try_onsets(*guess)).collect()
        })
    }
}

fn looked(
    known: &KnownFromRest,
    measured: &WindowedForce,
    number: usize,
    starts: impl FnOnce(&Problem) -> Vec<Tried>,
) -> Look {
    let is_rough = SHARE[number] > 0.0;
    let measured = measured.beginning(WINDOWS[number], is_rough).of_contact(known.motion, known.finger);
    // What is not known of the part counts as noise.
    let share = known.errors.map_or(0.0, |errors| errors.share(known.part));
    let measured = measured.roughly(share.max(SHARE[number]));
    let course = course(known, &measured);
    let problem = Problem { course: &course, measured: &measured, mass: None };
    let limit = misfit_limit(measured.data().len(), measured.freedom());
    let mut best = starts(&problem);
    best.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let at_first = least_cost(&best);
    best.retain(|tried| tried.cost <= HOPELESS * limit);
    let mut chosen: Vec<Tried> = Vec::new();
    for tried in best {
        let of_edge = chosen.iter().filter(|other| other.guess.edge == tried.guess.edge).count();
        if of_edge < FOLLOWED_OF_EDGE {
            chosen.push(tried);
        }
        if chosen.len() == FOLLOWED[number] {
            break;
        }
    }
    let gone: Vec<_> = chosen.into_iter().map(|tried| problem.descend(tried, STEPS[number])).collect();
    let gone = apart(&problem, gone);
    Look {
        misfit: least_cost(&gone).min(at_first) / limit,
        guesses: gone.iter().map(|tried| tried.guess).collect(),
        looks: number + 1,
    }
}
