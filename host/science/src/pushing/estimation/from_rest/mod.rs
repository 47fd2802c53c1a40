//! Pose of a part that a finger begins to push, from the force that the finger feels.
//!
//! Finger and part touch, both at rest, and the finger begins to move. Nothing is known of where on the part it
//! touches, at what angle, with what friction, nor of the part's mass: only the part's shape, µ of the plane, and how
//! the finger moves. From rest these unknowns fix all that follows ([`crate::pushing::dynamics`]), and so the force
//! over the push says which they are: its direction and its course say where the part is, its size says the mass. Where
//! µ of the plane is not known well, it is found with the rest. But a slow part feels its mass only through µ m g: then
//! the answer says that the two cannot be told apart.
//!
//! In reading order:
//! - [`hann_windows`]: how force is averaged; [`windowed_force`]: what was felt and how uncertain it is; [`onset`]:
//!   from readings to that, once the push is felt to begin;
//! - `path`: what a guess would feel; `seeds`: guesses to begin with, and `between`, what lies between them; `fit`: going down from
//!   each to a minimum;
//! - `valley`: how far a minimum reaches where its valley bends; `numbers`, `samples`: fits that find what is not known of part and
//!   motion too, and how far these reach;
//! - `symmetry`: turns of the part that nobody can tell apart;
//! - `explained`: what an answer leaves of what was felt;
//! - [`misfit`]: what may have been told wrong where no pose fits;
//! - [`watch`]: a push from its first sample to the answer, live or recorded;
//! - [`trial`]: random pushes and a judge.
//!
//! The answer is a set: every minimum whose cost is within 16 of the best one's, four standard deviations, each with
//! its covariance; where the noise was estimated from a short rest and the best fits badly, both are wider by as much.
//! If the best does not fit, the guesses are spread closer once; if it still does not, there is no answer. From what is
//! found others are sought: on other edges, at other places, with a contact that slips for a moment, with another onset.
//!
//! Assumes: Coulomb friction everywhere, one constant µ_c; contact with one edge throughout.
//! Frames: finger axes, with the origin of the motion's file; force is the force on the finger's disk. Units: SI.
//! Errors: none. "No pose explains the force" and "several do" are answers.

mod between;
mod end;
mod explained;
mod felt;
mod first_look;
mod fit;
mod friction_along;
pub mod hann_windows;
pub mod misfit;
mod model;
mod moving_seeds;
mod numbers;
pub mod onset;
mod part_errors;
mod path;
pub mod readings;
mod samples;
mod seeds;
pub mod symmetry;
pub mod trial;
mod valley;
pub mod watch;
mod whitener;
pub mod windowed_force;

use std::collections::BTreeMap;

use nalgebra::Translation2;

use end::{EndCovariance, Reach};
pub use explained::ExplainedForce;
use felt::Felt;
pub use first_look::first_look;
use fit::{MU_C_MAX, MU_C_MIN, Problem, Tried};
use friction_along::FrictionAlong;
use model::range;
use numbers::{NUMBERED_LEADS, NumberedMinimum, Unknown};
pub use part_errors::PartErrors;
use path::{Course, CourseStart, Guess, Resolution};
use samples::{EVIDENCE_LOG_SD, samples_of};
use seeds::Cover;
pub use windowed_force::{CalibrationUncertainty, CarriedFinger, Uncertainty, WindowedForce};

use super::hypotheses::{
    Estimate, Fit, FromForce, GATE, Hypothesis, Nearness, Observer, SAME_END_M, normalise, of_valleys,
};
use super::planning::Present;
use crate::math::statistics::fisher_quantile;
use crate::pushing::dynamics::{ContactLaw, FingerShape, Part, State};
use crate::pushing::finger_motion::FingerMotion;
use crate::search::{Halt, Searched, Stop, never};

/// Steps of every fit, by coarse steps of time, and how many times dearer than the best one a fit is given up after them, if
/// it is also more than [`HOPELESS_COST`] above it. What leads nowhere shows after one. The last go on to the minimum.
const STAGES: [(usize, f64); 3] = [(1, 30.0), (2, 3.0), (usize::MAX, 3.0)];

/// The same before any step: of missed explanations the nearest guess was at most fifty times dearer.
const HOPELESS_AT_FIRST: f64 = 100.0;

/// Least difference of costs at which a fit is given up; see [`STAGES`]. Coarse steps of time change a cost by some hundreds
/// where noise is a thousandth of the force; at 1000 pushes of parts that move are lost.
const HOPELESS_COST: f64 = 3000.0;

/// After their first steps guesses this near each other end in one minimum: rad, radii of gyration, of µ_c.
const ON_ONE_WAY: f64 = 3e-3;

/// Minima on one edge nearer than this at the end are one: half a millimetre, a degree. The contact angle is not felt
/// by itself.
pub const SAME_PLACE: Nearness = Nearness { place: SAME_END_M, angle: 0.0175 };

/// Ends of fits nearer than this are the same minimum: m, rad.
const ONE_MINIMUM: (f64, f64) = (2e-5, 2e-4);

/// Fewest windows from which an answer is sought: there are up to four unknowns, and two numbers a window.
pub const WINDOWS_MIN: usize = 4;

/// What is known of a push beforehand.
#[derive(Clone, Copy, Debug)]
pub struct KnownFromRest<'p> {
    /// The part on its plane.
    pub part: &'p Part,
    /// What is not known of it; none where all is.
    pub errors: Option<PartErrors>,
    /// µ g of the plane, m/s².
    pub mu_g: f64,
    /// Standard deviation of ln(µ g): 0.2 where it is known to a fifth; none where it is known.
    pub mu_g_log_sd: Option<f64>,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Its outline where it is no disk.
    pub shape: Option<FingerShape>,
    /// What the readings contain of the finger's own inertia, and how it bends.
    pub finger: CarriedFinger,
    /// How the finger moves.
    pub motion: &'p FingerMotion,
}

impl<'p> KnownFromRest<'p> {
    /// Finger and part at the time up to which the force was used: what a motion planner starts from.
    #[must_use]
    pub fn present(&self, estimate: &Estimate) -> Present<'p> {
        let legs: Vec<_> = self.motion.legs(self.radius).collect();
        // A motion has at least one segment.
        let leg = legs.iter().rev().find(|leg| leg.from < estimate.time_end).unwrap_or(&legs[0]);
        let since = estimate.time_end - leg.from;
        Present {
            part: self.part,
            mu_g: estimate.hypotheses.first().map_or(self.mu_g, |best| best.mu_g),
            radius: self.radius,
            centre: leg.finger.centre(since),
            velocity: leg.finger.velocity(since),
        }
    }
}

impl Observer for KnownFromRest<'_> {
    type Observation = WindowedForce;

    fn estimate_until(&self, measured: &WindowedForce, stop: Stop<'_>) -> Searched<Estimate> {
        estimate_until(self, measured, stop)
    }
}

/// Every pose that explains what was felt, sought all over the part.
#[must_use]
pub fn estimate(known: &KnownFromRest, measured: &WindowedForce) -> Estimate {
    estimate_until(known, measured, &never).found
}

/// The same, ended when `stop` says so: then with the poses found by then.
#[must_use]
pub fn estimate_until(known: &KnownFromRest, measured: &WindowedForce, stop: Stop<'_>) -> Searched<Estimate> {
    let halt = Halt::new(stop);
    let estimate = halting_estimate(known, measured, &halt);
    halt.searched(estimate)
}

fn halting_estimate(known: &KnownFromRest, measured: &WindowedForce, halt: &Halt<'_>) -> Estimate {
    let symmetry = symmetry::order(known.part);
    let edges = symmetry::distinct(known.part, symmetry);
    let measured = &measured.of_contact(known.motion, known.finger);
    let course = course(known, measured);
    let Some(errors) = known.errors else {
        let problem = Problem { course: &course, measured, mass: None };
        return conclude(&problem, search(&problem, &edges, halt), symmetry, halt).bent(known, measured);
    };
    let roughly = measured.roughly(errors.share(known.part));
    // What is known nearly leads to its minimum by itself; what is far from what is told only where that counts as noise.
    let found = |measured: &WindowedForce| {
        let problem = Problem { course: &course, measured, mass: None };
        let mut tried = search(&problem, &edges, halt);
        tried.retain(|tried| is_possible(&problem, tried));
        leads_of_edges(&problem, &tried, NUMBERED_LEADS).into_iter().map(|lead| lead.guess)
    };
    let leads = found(measured).chain(found(&roughly));
    let part_unknown = PartUnknown { errors, course: &course, roughly: &roughly, measured };
    part_unknown.estimate(leads, symmetry, halt).bent(known, measured)
}

/// A push of a part of which not all is known.
struct PartUnknown<'a, 'p> {
    errors: PartErrors,
    course: &'a Course<'p>,
    /// With what is not known taken for noise.
    roughly: &'a WindowedForce,
    measured: &'a WindowedForce,
}

impl PartUnknown<'_, '_> {
    /// What guesses lead to with the part's numbers found too.
    fn estimate(&self, guesses: impl Iterator<Item = Guess>, symmetry: usize, halt: &Halt<'_>) -> Estimate {
        let measured = &self.measured.roughly(self.errors.fast_share()).and_drift(self.errors.left_share());
        let unknown = Unknown {
            course: self.course,
            mass: None,
            errors: Some(self.errors),
            motion: None,
            mu_c_wander_log_sd: 0.0,
        };
        let limit = limit(measured);
        let explains = |tried: &Tried| tried.cost <= limit;
        let starts: Vec<_> = guesses.collect();
        let found =
            halt.each(starts.clone(), |guess| unknown.found(guess, measured, self.roughly, explains, false, halt));
        let mut found: Vec<_> = found.into_iter().flatten().collect();
        found.retain(|found| unknown.is_possible(found, measured));
        let edges: Vec<_> = found.iter().map(|found| found.tried.guess.edge).collect();
        let of_edge = |edge: usize| edges.iter().filter(|of| **of == edge).count();
        let said = |found: &NumberedMinimum, best: f64, excess: f64, _| {
            let count = samples_of(of_edge(found.tried.guess.edge));
            let sampled = unknown.sampled(found, measured, &starts, count, halt);
            let found = sampled.lower.as_ref().unwrap_or(found);
            let course = found.numbered.course(self.course);
            let problem = Problem { course: &course, measured, mass: None };
            hypothesis(&problem, &found.tried, best, excess, Reach::Sampled(&sampled))
        };
        let problem = Problem { course: self.course, measured, mass: None };
        let mut estimate = conclude_of(&problem, found, |found| &found.tried, said, symmetry, halt);
        normalise(&mut estimate.hypotheses, EVIDENCE_LOG_SD, |of| &mut of.probability);
        Estimate { can_exclude_others: self.errors.can_exclude_others(), ..estimate }
    }
}

/// Minima all over some edges.
fn search(problem: &Problem, edges: &[usize], halt: &Halt<'_>) -> Vec<Tried> {
    let course = problem.course.coarse();
    let coarse = Problem { course: &course, ..*problem };
    let search = |cover: Cover| descend_all(problem, begun(&coarse, edges, cover, halt), halt);
    let mut tried = search(Cover::Dense);
    // What nothing explains, though something nearly does, may have its explanation between the guesses.
    let limit = limit(problem.measured);
    if least_cost(&tried) >= NEARLY * limit {
        return tried;
    }
    if least_cost(&tried) >= limit {
        tried.extend(search(Cover::Denser));
    }
    tried.extend(on_other_edges(problem, edges, &tried, halt));
    tried.extend(at_other_places(problem, &tried, halt));
    tried.extend(from_other_onsets(problem, &tried, halt));
    tried
}

/// Guesses that may explain a push: of a long one those that explain its beginning, and then more and more of it. A minimum is
/// the wider the shorter the push, and what cannot explain the beginning cannot explain the whole.
fn begun(problem: &Problem, edges: &[usize], cover: Cover, halt: &Halt<'_>) -> Vec<Tried> {
    let whole = problem.course.duration;
    let mut tried = Vec::new();
    let mut until = BEGINNING_S;
    while problem.course.start == CourseStart::Rest && whole >= MUCH_LONGER * until && !halt.is_wished() {
        let Some(felt) = problem.measured.beginning(until) else { break };
        if felt.data().len() >= BEGINNING_VALUES_MIN {
            let course = Course { duration: until, ..problem.course.clone() };
            let beginning = Problem { course: &course, measured: &*felt, mass: problem.mass };
            tried = begin_all(&beginning, guesses(&beginning, &tried, edges, cover, halt), halt);
            tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
            let far = FAR_FROM_BEGINNING * limit(&*felt);
            tried.truncate(tried.partition_point(|tried| tried.cost <= far).max(BEGINNINGS_MIN));
        }
        until *= LONGER;
    }
    guesses(problem, &tried, edges, cover, halt)
}

/// The most that noise leaves of what was felt.
fn limit(measured: &dyn Felt) -> f64 {
    misfit_limit(measured.data().len(), measured.freedom())
}

/// Guesses for a push: those that were followed over some of it gone on, or, where there are none, all over some edges.
fn guesses(problem: &Problem, before: &[Tried], edges: &[usize], cover: Cover, halt: &Halt<'_>) -> Vec<Tried> {
    if before.is_empty() {
        return starts(problem, edges, cover, halt);
    }
    before.iter().flat_map(|tried| gone_on(problem, tried)).collect()
}

/// The beginning of a push that is searched first, s.
const BEGINNING_S: f64 = 0.9;

/// Values of a beginning that is looked at by itself: fewer, of a sparse sensor or with a hole, leave the unknowns open.
const BEGINNING_VALUES_MIN: usize = 60;

/// So many times as much is looked at next.
const LONGER: f64 = 1.5;

/// A push that is not so many times as long as what was looked at is looked at as a whole.
const MUCH_LONGER: f64 = 1.3;

/// What costs so many times the most that noise leaves does not explain a beginning: coarse steps of time are off by less.
const FAR_FROM_BEGINNING: f64 = 30.0;

/// So many are followed in any case: where nothing explains a push, a person wants to know what comes nearest.
const BEGINNINGS_MIN: usize = 3;

/// A guess that was followed over some of the push, over more of it; and, where it rolled so far, the same with frictions at
/// which it slips later.
fn gone_on(problem: &Problem, tried: &Tried) -> Vec<Tried> {
    let whole = problem.try_guess(tried.guess);
    let mut all: Vec<_> = whole.into_iter().collect();
    if !tried.path.slipped {
        let needed = all.first().map_or(MU_C_MAX, |rolling| rolling.path.friction_needed);
        let least = SLIPS_LATER * tried.path.friction_needed;
        let frictions = Cover::Dense.frictions().into_iter().chain(SLIPPING.map(|share| share * needed));
        let later = frictions.filter(|mu_c| (least..needed).contains(mu_c));
        all.extend(later.filter_map(|mu_c| problem.try_guess(Guess { mu_c, ..tried.guess })));
    }
    all
}

/// What rolled so far may slip further on, with a friction down to this share of what rolling took so far: the guess is rough.
const SLIPS_LATER: f64 = 0.85;

/// Guesses all over some edges.
fn starts(problem: &Problem, edges: &[usize], cover: Cover, halt: &Halt<'_>) -> Vec<Tried> {
    match problem.course.start {
        CourseStart::Rest => seeds::on_edges(problem, edges, cover, halt),
        CourseStart::Moving => {
            let guesses = halt.each(edges.to_vec(), |edge| moving_seeds::on_edge(problem, edge, cover));
            guesses.into_iter().flatten().collect()
        }
    }
}

/// The best minima that may be listed, or lead to one that is: no two nearer than those that are one in an answer.
fn leads(tried: &[Tried], count: usize) -> Vec<Tried> {
    let mut likely: Vec<_> = tried.iter().filter(|it| it.cost <= least_cost(tried) + MAY_BE_LISTED * GATE).collect();
    likely.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let mut leads: Vec<Tried> = Vec::new();
    for next in likely {
        let is_one = |lead: &Tried| is_one_place(&lead.guess, &lead.path.end, &next.guess, &next.path.end);
        if leads.len() < count && !leads.iter().any(is_one) {
            leads.push(next.clone());
        }
    }
    leads
}

/// All of them, each with how many on its edge are better.
fn ranked_leads(tried: &[Tried]) -> Vec<(usize, Tried)> {
    let mut ranked: Vec<(usize, Tried)> = Vec::new();
    for lead in leads(tried, usize::MAX) {
        let better = ranked.iter().filter(|(_, better)| better.guess.edge == lead.guess.edge).count();
        ranked.push((better, lead));
    }
    ranked
}

/// As many of them, those of every edge in turn: what is not known of the part may make another edge's the lowest in the end,
/// or another valley's. Of an edge first the best, then of all that explain as well what is farthest from those chosen, so
/// that a long flat valley is seen from end to end; then the others, pieces of one valley last. What is much dearer than the best,
/// and explains what was felt all the same, is followed from the best of its edge: to take what is not known for noise says little
/// of what it may do in the end.
fn leads_of_edges(problem: &Problem, tried: &[Tried], count: usize) -> Vec<Tried> {
    let arm = problem.course.part.inertia_per_mass().sqrt();
    let mut of_edges: BTreeMap<usize, Vec<Tried>> = BTreeMap::new();
    for lead in leads(tried, usize::MAX) {
        of_edges.entry(lead.guess.edge).or_default().push(lead);
    }
    let cost_max = limit(problem.measured);
    let mut others: Vec<_> = tried.iter().filter(|tried| tried.cost <= cost_max).collect();
    others.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    for other in others {
        of_edges.entry(other.guess.edge).or_insert_with(|| vec![other.clone()]);
    }
    let ordered = of_edges.into_values().flat_map(|leads| spread_out(leads, arm).into_iter().enumerate());
    let mut ordered: Vec<_> = ordered.collect();
    ordered
        .sort_by(|(place, lead), (other_place, other)| place.cmp(other_place).then(lead.cost.total_cmp(&other.cost)));
    ordered.into_iter().take(count).map(|(_, lead)| lead).collect()
}

/// The leads of one edge, the best first, in that order.
fn spread_out(mut leads: Vec<Tried>, arm: f64) -> Vec<Tried> {
    let others = leads.split_off(leads.partition_point(|lead| lead.cost <= leads[0].cost + ALIKE_COST));
    let apart = |one: &Tried, other: &Tried| {
        ((one.path.end.u - other.path.end.u) * arm).hypot(one.path.end.s - other.path.end.s)
    };
    let mut alike = leads;
    let mut ordered = vec![alike.remove(0)];
    while !alike.is_empty() {
        let nearest = |lead: &Tried| ordered.iter().map(|chosen| apart(chosen, lead)).fold(f64::INFINITY, f64::min);
        let far: Vec<_> = alike.iter().map(nearest).collect();
        let farthest = (0..far.len()).max_by(|&a, &b| far[a].total_cmp(&far[b])).unwrap_or_default();
        ordered.push(alike.swap_remove(farthest));
    }
    let is_piece = |index: usize| ordered.iter().chain(&others[..index]).any(|it| is_one_valley(it, &others[index]));
    let pieces: Vec<_> = (0..others.len()).map(is_piece).collect();
    let of =
        |wanted: bool| others.iter().zip(&pieces).filter(move |(_, is)| **is == wanted).map(|(lead, _)| lead.clone());
    let others: Vec<_> = of(false).chain(of(true)).collect();
    ordered.into_iter().chain(others).collect()
}

/// Costs with what is not known taken for noise that differ by less say nothing: less than half a standard deviation of noise that
/// is several times too large.
const ALIKE_COST: f64 = 1.0;

/// Whether two minima end as near as numbers of the part take them, the contact slipping in both or in neither.
fn is_one_valley(one: &Tried, other: &Tried) -> bool {
    let (end, other_end) = (&one.path.end, &other.path.end);
    one.guess.edge == other.guess.edge
        && one.path.slipped == other.path.slipped
        && ONE_VALLEY.holds([end.u, end.s], [other_end.u, other_end.s])
}

/// Where numbers of the part are not known, minima nearer than this on one edge come to one: of pushes that were drawn, a
/// tenth and a third of what they then state.
const ONE_VALLEY: Nearness = Nearness { place: 1e-3, angle: 0.08 };

/// Whether two minima end at one place, as an answer has it.
fn is_one_place(one: &Guess, end: &State, other: &Guess, other_end: &State) -> bool {
    one.edge == other.edge && SAME_PLACE.holds([end.u, end.s], [other_end.u, other_end.s])
}

/// Minima on other edges, begun where the best are on theirs: edges as far from the centre of mass feel alike at the
/// same angle, place and friction, and there the grid may have passed between two places.
fn on_other_edges(problem: &Problem, edges: &[usize], tried: &[Tried], halt: &Halt<'_>) -> Vec<Tried> {
    // The best of each edge.
    let leads = ranked_leads(tried).into_iter().filter(|(better, _)| *better == 0).map(|(_, lead)| lead);
    let guesses = leads.take(OTHER_EDGES_OF).flat_map(|lead| {
        let others = edges.iter().filter(move |&&edge| edge != lead.guess.edge);
        others.map(move |&edge| Guess { edge, ..lead.guess })
    });
    let begun = halt.each(guesses.collect(), |guess| problem.try_onsets(guess)).into_iter().flatten();
    descend_all(problem, begun.filter(is_hopeful(least_cost(tried))).collect(), halt)
}

/// Minima at other places of the same edge, and of a contact that slipped for a moment where one that rolled needed most
/// friction: that costs less only near the friction that it needs, between two of the grid's.
fn at_other_places(problem: &Problem, tried: &[Tried], halt: &Halt<'_>) -> Vec<Tried> {
    let leads = leads(tried, OTHER_PLACES_OF);
    // Where friction is known there is no other.
    let rolling = leads.iter().filter(|lead| !lead.path.slipped && problem.course.mu_c.is_none());
    let slipping = rolling.flat_map(|lead| {
        SLIPPING.map(|share| Guess { mu_c: (share * lead.path.friction_needed).max(MU_C_MIN), ..lead.guess })
    });
    let slipping = halt.each(slipping.collect(), |guess| problem.try_guess(guess)).into_iter().flatten();
    let aside = halt.each(leads.iter().collect(), |lead| seeds::along_edge(problem, lead, halt)).into_iter().flatten();
    let begun = aside.chain(slipping).filter(is_hopeful(least_cost(tried)));
    descend_all(problem, begun.collect(), halt)
}

/// What leads somewhere, where the best costs so much.
fn is_hopeful(best: f64) -> impl Fn(&Tried) -> bool {
    move |tried| tried.cost <= HOPELESS_ELSEWHERE * best || tried.cost <= best + HOPELESS_COST
}

/// What costs so many times the best there is leads nowhere; see [`STAGES`].
const HOPELESS_ELSEWHERE: f64 = 30.0;

/// Of how many edges the best minimum is tried on the others.
const OTHER_EDGES_OF: usize = 3;

/// Of how many other places are tried on the same edge.
const OTHER_PLACES_OF: usize = 3;

/// Shares of the friction that rolling needs at which a contact slips for some or most of the time.
const SLIPPING: [f64; 3] = [0.98, 0.93, 0.85];

/// Minima found from those that may be listed with the push begun at another time: where readings are few, a jump of the
/// force on the other side of one is a minimum of its own, and the other unknowns have to come along to be lower.
fn from_other_onsets(problem: &Problem, tried: &[Tried], halt: &Halt<'_>) -> Vec<Tried> {
    let guesses = leads(tried, OTHER_ONSETS_OF).into_iter().flat_map(|tried| {
        let onsets: Vec<_> = problem.measured.onsets_tried();
        // The one that it has found lies nearest.
        let off = |delay: &f64| (delay - tried.guess.delay).abs();
        let nearest = onsets.iter().copied().min_by(|a, b| off(a).total_cmp(&off(b)));
        let others = onsets.into_iter().filter(move |delay| Some(*delay) != nearest);
        others.map(move |delay| Guess { delay, ..tried.guess })
    });
    descended(problem, guesses.collect(), halt)
}

/// Minima so many times the gate above the best may lead to one that is listed, with another onset.
const MAY_BE_LISTED: f64 = 3.0;

/// Of how many minima other onsets are tried, the best ones.
const OTHER_ONSETS_OF: usize = 3;

/// A best cost below so many times the limit is worth another search: of missed explanations the next best had up to
/// thirty times the limit, other parts mostly have more.
const NEARLY: f64 = 40.0;

/// The same, sought only where an earlier answer from the beginning of the same push had found something: what was
/// excluded then stays excluded.
#[must_use]
pub fn follow(known: &KnownFromRest, measured: &WindowedForce, earlier: &Estimate) -> Estimate {
    let measured = &measured.of_contact(known.motion, known.finger);
    let course = course(known, measured);
    if let Some(errors) = known.errors {
        let roughly = &measured.roughly(errors.share(known.part));
        let guesses = earlier.hypotheses.iter().map(|hypothesis| guess(hypothesis, &course));
        let part_unknown = PartUnknown { errors, course: &course, roughly, measured };
        return part_unknown.estimate(guesses, earlier.symmetry, &Halt::new(&never)).bent(known, measured);
    }
    let problem = Problem { course: &course, measured, mass: None };
    let starts = earlier.hypotheses.iter().filter_map(|hypothesis| problem.try_onsets(guess(hypothesis, &course)));
    let starts = starts.collect::<Vec<_>>();
    let halt = Halt::new(&never);
    conclude(&problem, descend_all(&problem, starts, &halt), earlier.symmetry, &halt).bent(known, measured)
}

impl Estimate {
    /// The same with the finger's disk, and the part with it, where the finger's bending takes them in the end: by the
    /// compliance times the last force; what is not known of that, and of the disk's place, is added to the covariance. Until then
    /// bending changes nothing that is felt.
    fn bent(mut self, known: &KnownFromRest, measured: &WindowedForce) -> Self {
        let last = measured.forces_finger().iter().flatten().next_back().copied().unwrap_or_default();
        let way = Translation2::from(last * known.finger.compliance);
        let unsure = known.finger.place_covariance(last);
        for hypothesis in &mut self.hypotheses {
            hypothesis.pose_end = (way * hypothesis.pose_end.isometry()).into();
            if let Some(covariance) = &mut hypothesis.covariance {
                let mut place = covariance.fixed_view_mut::<2, 2>(0, 0);
                place += unsure;
            }
        }
        self
    }
}

fn course<'p>(known: &KnownFromRest<'p>, measured: &WindowedForce) -> Course<'p> {
    Course {
        part: known.part,
        shape: known.shape,
        symmetry: symmetry::order(known.part),
        mu_g: known.mu_g,
        mu_g_log_sd: known.mu_g_log_sd,
        mu_c: None,
        friction_along: FrictionAlong::default(),
        changed: &[],
        off: &[],
        start: CourseStart::Rest,
        legs: known.motion.legs(known.radius).collect(),
        duration: measured.duration(),
        resolution: Resolution::Fine,
    }
}

/// Goes down from every start, giving up what stays far above the best; by coarse steps of time at first. Only what came to its
/// minimum before the wish to halt is kept.
fn descend_all(problem: &Problem, starts: Vec<Tried>, halt: &Halt<'_>) -> Vec<Tried> {
    let course = problem.course.coarse();
    let begun = begin_all(&Problem { course: &course, ..*problem }, starts, halt);
    descended(problem, begun.into_iter().map(|begun| begun.guess).collect(), halt)
}

/// The minima that guesses lead to.
fn descended(problem: &Problem, guesses: Vec<Guess>, halt: &Halt<'_>) -> Vec<Tried> {
    let minimum = |guess| Some(problem.descend(problem.try_guess(guess)?, usize::MAX));
    halt.each(guesses, minimum).into_iter().flatten().collect()
}

/// The minima of that by coarse steps of time from which it is worth going on.
fn begin_all(problem: &Problem, starts: Vec<Tried>, halt: &Halt<'_>) -> Vec<Tried> {
    let mut tried = hopeful(starts, HOPELESS_AT_FIRST);
    for (steps, hopeless) in STAGES {
        let gone = halt.each(tried, |tried| problem.descend(tried, steps));
        tried = apart(problem, hopeful(gone, hopeless));
    }
    tried
}

/// Those that are not so many times dearer than the best.
fn hopeful(mut tried: Vec<Tried>, hopeless: f64) -> Vec<Tried> {
    let best = least_cost(&tried);
    tried.retain(|tried| tried.cost <= hopeless * best || tried.cost <= best + HOPELESS_COST);
    tried
}

/// Those of which no better one is on its way to the same minimum: as near as [`ON_ONE_WAY`], the contact doing the same.
fn apart(problem: &Problem, mut tried: Vec<Tried>) -> Vec<Tried> {
    tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let arm = problem.course.part.inertia_per_mass().sqrt();
    let mut kept: Vec<Tried> = Vec::new();
    for next in tried {
        let same = |other: &Tried| {
            let (a, b) = (&other.guess, &next.guess);
            let both_roll = a.mu_c.is_infinite() && b.mu_c.is_infinite();
            let mu_c = if both_roll { 0.0 } else { (a.mu_c - b.mu_c).abs() };
            let off = (a.u - b.u).abs().max((a.s - b.s).abs() / arm).max(mu_c);
            a.edge == b.edge && other.path.course == next.path.course && off < ON_ONE_WAY
        };
        if !kept.iter().any(same) {
            kept.push(next);
        }
    }
    kept
}

fn least_cost(tried: &[Tried]) -> f64 {
    tried.iter().map(|tried| tried.cost).fold(f64::INFINITY, f64::min)
}

/// Of more minima than these together the valleys are not walked along: they are samples of one, and stand for it all.
const WALKED_MAX: usize = 12;

/// The list of what cannot be excluded.
fn conclude(problem: &Problem, mut tried: Vec<Tried>, symmetry: usize, halt: &Halt<'_>) -> Estimate {
    tried.retain(|tried| is_possible(problem, tried));
    let said =
        |tried: &Tried, best: f64, excess: f64, reach: Reach<'_>| hypothesis(problem, tried, best, excess, reach);
    conclude_of(problem, tried, |tried| tried, said, symmetry, halt)
}

/// The same of minima at which the finger can be, each with its own way to say what it means for a least cost and an excess
/// of noise.
fn conclude_of<'h, M: Sync>(
    problem: &Problem,
    mut minima: Vec<M>,
    tried: impl Fn(&M) -> &Tried + Sync,
    said: impl Fn(&M, f64, f64, Reach<'h>) -> Option<Hypothesis> + Sync,
    symmetry: usize,
    halt: &'h Halt<'h>,
) -> Estimate {
    let duration = problem.course.duration;
    let (values, freedom) = (problem.measured.data().len(), problem.measured.freedom());
    let cost_max = limit(problem.measured);
    minima.sort_by(|a, b| tried(a).cost.total_cmp(&tried(b).cost));
    let best = minima.first().map(|minimum| tried(minimum).cost);
    let excess = best.map_or(1.0, |best| excess_noise(best, values, freedom));
    let listed: Vec<_> = match best {
        Some(best) if best <= cost_max => distinct(minima, best + GATE * excess, &tried),
        _ => Vec::new(),
    };
    let reach = if listed.len() <= WALKED_MAX { Reach::Valley(halt) } else { Reach::Slopes };
    let said = |minimum: &M| said(minimum, best.unwrap_or(tried(minimum).cost), excess, reach);
    let hypotheses = halt.every(listed.iter().collect(), said).into_iter().flatten().collect();
    let mut hypotheses = of_valleys(hypotheses, SAME_PLACE);
    hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let fit = Fit { cost: best, degrees_of_freedom: problem.measured.data().len(), cost_max };
    let mu_g_log_sd = problem.course.mu_g_log_sd;
    // Of a continuum one stands for all.
    let symmetry = if symmetry == symmetry::ROUND { 1 } else { symmetry };
    Estimate { hypotheses, symmetry, mu_g_log_sd, ..Estimate::unexplained(fit, duration) }
}

/// Whether the finger can be there at all, outside the part: at the minimum or, since that is only about where the
/// contact is, anywhere on the border of what is likely.
fn is_possible(problem: &Problem, tried: &Tried) -> bool {
    let Some(model) = problem.course.first_model(tried.guess.edge) else { return false };
    let [s_min, s_max] = range(&model.side());
    let at = |u: f64, s: f64| {
        let s = s.clamp(s_min, s_max);
        model.can_begin(u, s, problem.course.start == CourseStart::Moving)
    };
    let Guess { u, s, .. } = tried.guess;
    at(u, s) || problem.border(tried, POSSIBLE_SDS).is_some_and(|border| border.into_iter().any(|[u, s]| at(u, s)))
}

/// A contact this many standard deviations from the minimum is still likely.
const POSSIBLE_SDS: f64 = 3.0;

/// The minima up to a cost, each once: several fits end in the same.
fn distinct<M>(minima: Vec<M>, cost_max: f64, tried: impl Fn(&M) -> &Tried) -> Vec<M> {
    let mut kept: Vec<M> = Vec::new();
    for minimum in minima.into_iter().take_while(|minimum| tried(minimum).cost <= cost_max) {
        if !kept.iter().any(|other| is_same(tried(other), tried(&minimum))) {
            kept.push(minimum);
        }
    }
    kept
}

/// Whether two fits ended in the same minimum.
fn is_same(one: &Tried, other: &Tried) -> bool {
    let [a, b] = [one, other].map(|tried| tried.path.end);
    other.guess.edge == one.guess.edge && (a.s - b.s).abs() < ONE_MINIMUM.0 && (a.u - b.u).abs() < ONE_MINIMUM.1
}

/// The guess that an earlier answer's explanation began with.
fn guess(hypothesis: &Hypothesis, course: &Course) -> Guess {
    let mu_g_log = if course.mu_g_log_sd.is_some() { (hypothesis.mu_g / course.mu_g).ln() } else { 0.0 };
    let mu_c = hypothesis.from_force.and_then(|force| force.mu_c).unwrap_or(f64::INFINITY);
    let start = course.first_model(hypothesis.side).map_or(hypothesis.start, |model| model.sought(&hypothesis.start));
    Guess { edge: hypothesis.side, u: start.u, s: start.s, mu_c, mu_g_log, ..Guess::AT_REST }
}

fn hypothesis(problem: &Problem, tried: &Tried, best: f64, excess: f64, reach: Reach<'_>) -> Option<Hypothesis> {
    let at_end = problem.end_covariance(&problem.around(tried), reach)?;
    let EndCovariance { pose: covariance, state: state_covariance, spread, .. } = at_end;
    let Tried { guess, path, mass, cost, .. } = tried;
    let mu_c = path.slipped.then_some(guess.mu_c);
    Some(Hypothesis {
        edge: problem.course.part.edge_at(guess.edge, path.end.s),
        side: guess.edge,
        start: problem.course.told(guess.edge, &State { u: guess.u, s: guess.s, omega: 0.0, v_t: 0.0 }),
        contact_start: path.contact_start,
        end: problem.course.told(guess.edge, &path.end),
        contact_end: path.contact,
        // A contact that never slipped is taken to roll on: its friction is not known.
        law: mu_c.map_or(ContactLaw::Rolling { friction: None }, |friction| ContactLaw::Coulomb { friction }),
        pose_start: problem.course.pose_at_start(guess)?.into(),
        pose_end: problem.course.pose_at_end(guess, path)?.into(),
        velocity_end: problem.course.velocity_at_end(guess, path)?,
        covariance: (!problem.course.is_continuum()).then(|| covariance * excess),
        state_covariance: Some(state_covariance * excess),
        mu_g: problem.course.mu_g_of(guess),
        mu_g_log_sd: Some(at_end.mu_g_log_sd),
        from_force: Some(FromForce {
            mass: *mass,
            mass_log_sd: at_end.mass_log_sd,
            resistance_log_sd: at_end.resistance_log_sd,
            mu_c,
            mu_c_sd: at_end.mu_c_sd,
            friction_needed: at_end.friction_needed,
        }),
        cost: *cost,
        // Relative to the others: a cost of hundreds would leave nothing of its exponential.
        probability: spread * (-0.5 * (cost - best) / excess).exp(),
    })
}

/// How much larger the noise's variance is than the tare said, by how badly the best explanation fits: the mean of what
/// both say, weighted by the values that each rests on; never less than 1. Costs are compared in units of it: with an
/// unknown variance they follow Student's t instead of a Gaussian.
fn excess_noise(best: f64, values: usize, freedom: f64) -> f64 {
    if !freedom.is_finite() {
        return 1.0;
    }
    ((freedom + best) / (freedom + values as f64)).max(1.0)
}

/// Largest cost that chance gives to so many values, once in a thousand times, where their variance is known from
/// `freedom` values itself.
fn misfit_limit(values: usize, freedom: f64) -> f64 {
    if !freedom.is_finite() {
        return chi_square_limit(values);
    }
    // Both follow chi-square: the ratio of the means is Fisher's F.
    values as f64 * fisher_quantile(CHANCE, values as f64, freedom)
}

/// What chance must stay below.
const CHANCE: f64 = 0.999;

/// The 99.9 % quantile of chi-square (Wilson and Hilferty 1931; within 1 % from 5 degrees of freedom on).
fn chi_square_limit(freedom: usize) -> f64 {
    /// 99.9 % quantile of the normal distribution.
    const Z: f64 = 3.090_232;
    let k = f64::from(u32::try_from(freedom).unwrap_or(u32::MAX));
    let spread = 2.0 / (9.0 * k);
    k * (1.0 - spread + Z * spread.sqrt()).powi(3)
}

#[cfg(test)]
mod tests;
