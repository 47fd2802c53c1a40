//! How far a part is from explaining a push, seen quickly: of a library of hundreds most are far.
//!
//! Guesses are spread thinly, played in coarse steps against the force with some of itself as noise, and only the best are
//! followed. What then is near is fitted as closely as the search does it, from there: a part that explains the push does so
//! here too, but for the few whose minimum no guess led to.
//!
//! Units: costs in squared standard deviations. Errors: none; a part that no guess can be played with has no cost.

use super::felt::Felt as _;
use super::fit::{Problem, Tried};
use super::seeds::Cover;
use super::windowed_force::WindowedForce;
use super::{KnownFromRest, apart, course, least_cost, misfit_limit, starts, symmetry};
use crate::pushing::estimation::hypotheses::Fit;
use crate::search::{Halt, never};

/// What coarse steps, and an onset that is taken for where it was felt, are off by: as a share of the force.
pub(super) const LOOK_SHARE: f64 = 3e-3;

/// How many fits take how many steps, the best, and what then costs so many times the most that noise leaves is far. Of 2,400 drawn
/// pushes of 500 parts half as many fits at first lose 2 %, these 0.3 %. Of 400 that are found none costs more than 27 times as
/// much after the first stage, and 4 after the second; of other parts half and three of four do.
const STAGES: [(usize, usize, f64); 3] = [(25, 1, 80.0), (10, 2, 12.0), (5, 4, FAR)];

/// The same of fits that count all noise.
const FAR: f64 = 5.0;

/// The same of fits by coarse steps that count all of the force: where noise is a ten-thousandth of it, these misfit by themselves.
const FAR_BY_COARSE_STEPS: f64 = 50.0;

/// How far a part is from explaining what was felt: what does so comes below the most that noise leaves, but for three in a
/// thousand. Of what is far a rough cost is told.
#[must_use]
pub fn first_look(known: &KnownFromRest, measured: &WindowedForce) -> Fit {
    let edges = symmetry::distinct(known.part, symmetry::order(known.part));
    let measured = measured.of_contact(known.motion, known.finger);
    // What is not known of the part counts as noise.
    let share = known.errors.map_or(0.0, |errors| errors.share(known.part));
    let looked_at = measured.without_times().roughly(share.hypot(LOOK_SHARE));
    let measured = measured.roughly(share);
    let fine = course(known, &measured);
    let coarse = fine.coarse();
    let look = Problem { course: &coarse, measured: &looked_at, mass: None };
    let mut tried = starts(&look, &edges, Cover::Sparse, &Halt::new(&never));
    let values = measured.data().len();
    let cost_max = misfit_limit(values, measured.freedom());
    let fit = |tried: &[Tried]| {
        let cost = Some(least_cost(tried)).filter(|cost| cost.is_finite());
        Fit { cost, degrees_of_freedom: values, cost_max }
    };
    for (followed, steps, far) in STAGES {
        tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        tried.truncate(followed);
        tried = apart(&look, tried.into_iter().map(|tried| look.descend(tried, steps)).collect());
        let so_far = fit(&tried);
        if so_far.cost.is_none_or(|cost| cost > far * cost_max) {
            return so_far;
        }
    }
    let mut last = fit(&tried);
    for (course, far) in [(&coarse, FAR), (&fine, FAR_BY_COARSE_STEPS)] {
        tried.retain(|tried| tried.cost <= far * cost_max);
        if tried.is_empty() {
            break;
        }
        let problem = Problem { course, measured: &measured, mass: None };
        let begun = tried.into_iter().filter_map(|tried| problem.try_onsets(tried.guess));
        tried = begun.map(|tried| problem.descend(tried, usize::MAX)).collect();
        last = fit(&tried);
    }
    last
}
