//! How far a part is from explaining a push, seen quickly: of a library of hundreds most are far.
//!
//! Guesses are spread thinly, played in coarse steps against the beginning of the force with some of itself as noise, and only the
//! best are followed, over more and more of it. What then is near is fitted as closely as the search does it, from there: a part
//! that explains the push does so here too, but for the few whose minimum no guess led to.
//!
//! Units: costs in squared standard deviations. Errors: none; a part that no guess can be played with has no cost.

use super::felt::Felt as _;
use super::fit::{Problem, Tried};
use super::path::Course;
use super::seeds::Cover;
use super::windowed_force::WindowedForce;
use super::{KnownFromRest, apart, course, guesses, least_cost, limit, symmetry};
use crate::pushing::estimation::hypotheses::Fit;
use crate::search::{Halt, never};

/// What coarse steps, and an onset that is taken for where it was felt, are off by: as a share of the force.
pub(super) const LOOK_SHARE: f64 = 3e-3;

/// A stage of a first look.
#[derive(Clone, Copy, Debug)]
struct Stage {
    /// How much of the push is looked at: so many windows from its beginning.
    windows: usize,
    /// How many fits are begun, the best: with a step each.
    followed: usize,
    /// Steps of the [better](better_of) of them.
    steps: usize,
    /// What then costs so many times the most that noise leaves is far.
    far: f64,
}

/// The beginning comes first: it is quicker to play, and a minimum is the wider the shorter the push. Over the whole of 1.8 s as
/// many guesses lose six of a hundred true parts. Of a longer push the last stage is repeated, each time with half as much again.
///
/// Of 1,200 drawn pushes of 0.8, 1.3 and 1.8 s with 4 mN of noise at 2 kHz two true parts are lost, of as many with 0.5 mN
/// seven. None that is found costs more than 3.8, 3.8, 4.8 and 3.4 times the most after the stages.
const STAGES: [Stage; 4] = [
    Stage { windows: 30, followed: 25, steps: 2, far: 20.0 },
    Stage { windows: 30, followed: 10, steps: 3, far: 8.0 },
    Stage { windows: 45, followed: 8, steps: 3, far: 8.0 },
    Stage { windows: 67, followed: 6, steps: 4, far: FAR },
];

/// The same of fits that count all noise.
const FAR: f64 = 5.0;

/// The same of fits by coarse steps that count all of the force: where noise is a ten-thousandth of it, these misfit by themselves.
const FAR_BY_COARSE_STEPS: f64 = 50.0;

/// How far a part is from explaining what was felt: what does so comes below the most that noise leaves, but for two
/// to six in a thousand. Of what is far a rough cost is told, of the beginning of the force where that is far already.
#[must_use]
pub fn first_look(known: &KnownFromRest, measured: &WindowedForce) -> Fit {
    looked(known, measured).0
}

/// The same with the best, where it was followed to the end.
pub(super) fn looked(known: &KnownFromRest, measured: &WindowedForce) -> (Fit, Option<Tried>) {
    let edges = symmetry::distinct(known.part, symmetry::order(known.part));
    let measured = measured.of_contact(known.motion, known.finger);
    // What is not known of the part counts as noise.
    let share = known.errors.map_or(0.0, |errors| errors.share(known.part));
    let looked_at = measured.without_times().roughly(share.hypot(LOOK_SHARE));
    let measured = measured.roughly(share);
    let fine = course(known, &measured);
    let coarse = fine.coarse();
    let mut tried: Vec<Tried> = Vec::new();
    for Stage { windows, followed, steps, far } in stages(measured.span()) {
        let beginning = looked_at.beginning_of(windows);
        let course = Course { duration: beginning.duration(), ..coarse.clone() };
        let problem = Problem { course: &course, measured: &beginning, mass: None };
        tried = guesses(&problem, &tried, &edges, Cover::Sparse, &Halt::new(&never));
        tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        tried.truncate(followed);
        tried = descended(&problem, tried, 1);
        tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        tried.truncate(better_of(followed));
        tried = apart(&problem, descended(&problem, tried, steps - 1));
        let so_far = fit(&tried, &beginning);
        if so_far.cost.is_none_or(|cost| cost > far * so_far.cost_max) {
            return (so_far, None);
        }
    }
    let whole = fit(&[], &measured);
    let mut last = whole;
    for (course, far) in [(&coarse, FAR), (&fine, FAR_BY_COARSE_STEPS)] {
        tried.retain(|tried| tried.cost <= far * whole.cost_max);
        if tried.is_empty() {
            break;
        }
        let problem = Problem { course, measured: &measured, mass: None };
        let begun = tried.into_iter().filter_map(|tried| problem.try_onsets(tried.guess));
        tried = descended(&problem, begun.collect(), usize::MAX);
        last = fit(&tried, &measured);
    }
    (last, tried.into_iter().min_by(|a, b| a.cost.total_cmp(&b.cost)))
}

/// Fits that go on of so many: after a step their costs tell the way to a minimum from what only began near. With two in five
/// four of 2,400 drawn pushes more are lost.
fn better_of(followed: usize) -> usize {
    (3 * followed).div_ceil(5)
}

fn descended(problem: &Problem, tried: Vec<Tried>, steps: usize) -> Vec<Tried> {
    tried.into_iter().map(|tried| problem.descend(tried, steps)).collect()
}

/// The stages of a push of so many windows.
fn stages(windows: usize) -> impl Iterator<Item = Stage> {
    let [.., last] = STAGES;
    let longer = std::iter::successors(Some(last), |stage| Some(Stage { windows: stage.windows * 3 / 2, ..*stage }));
    // Until one has seen all.
    let longer = longer.skip(1).take_while(move |stage| stage.windows * 2 / 3 < windows);
    STAGES.into_iter().chain(longer)
}

/// How well the best fits.
fn fit(tried: &[Tried], measured: &WindowedForce) -> Fit {
    let cost = Some(least_cost(tried)).filter(|cost| cost.is_finite());
    Fit { cost, degrees_of_freedom: measured.data().len(), cost_max: limit(measured) }
}
