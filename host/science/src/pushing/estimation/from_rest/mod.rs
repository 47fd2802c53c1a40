//! Pose of a part that a finger begins to push, from the force that the finger feels.
//!
//! Finger and part touch, both at rest, and the finger begins to move. Nothing is known of where on the part it touches, at
//! what angle, with what friction, nor of the part's mass: only the part's shape, µ of the plane, and how the finger moves. From
//! rest these unknowns fix all that follows ([`crate::pushing::dynamics`]), and so the force over the push says which they are: its
//! direction and its course say where the part is, its size says the mass. Where µ of the plane is not known well, it is found with the
//! rest. But a slow part feels its mass only through µ m g: then the answer says that the two cannot be told apart.
//!
//! - [`windows`]: how force is averaged; [`felt`]: what was felt and how uncertain it is;
//! - `path`: what a guess would feel; `seeds`: guesses to begin with; `fit`: going down from each to a minimum;
//! - `symmetry`: turns of the part that nobody can tell apart.
//!
//! The answer is a set: every minimum whose cost is within 16 of the best one's, four standard deviations, each with its
//! covariance. If the best does not fit, there is no answer.
//!
//! Assumes: Coulomb friction everywhere, one constant µ_c; contact with one edge throughout.
//! Frames: finger axes, with the origin of the motion's file; force is the force on the finger's disk. Units: SI.
//! Errors: none. "No pose explains the force" and "several do" are answers.

pub mod felt;
mod fit;
pub mod onset;
mod path;
mod seeds;
mod symmetry;
pub mod trial;
pub mod windows;

use nalgebra::{Isometry2, Matrix2x3, Matrix3, Matrix4, Vector2};

pub use felt::{CalibrationError, FeltForce, Uncertainty};
use fit::{EndCovariance, Problem, Tried, difference};
use path::{Course, Guess};

use super::planning::{Belief, Present};
use super::which_part::{PartEstimate, Weight, log_evidence, ranked};
use crate::pushing::dynamics::{ContactLaw, EdgeEnd, Part, Push, Start, State};
use crate::pushing::finger_motion::FingerMotion;
use crate::search::{Halt, Searched, Stop, never};

/// A minimum is listed if its cost is at most this much above the best one's: four standard deviations.
pub const COST_MARGIN: f64 = 16.0;

/// Steps of every fit at first; those that then are hopeless are given up.
const STEPS_FIRST: usize = 4;

/// A fit that after its first steps is this many times dearer than the best, and more than [`HOPELESS_COST`] above it, is given up.
const HOPELESS: f64 = 3.0;

/// See [`HOPELESS`].
const HOPELESS_COST: f64 = 3000.0;

/// Minima on one edge nearer than this in place and angle, at the end, are one: m, rad.
const SAME_PLACE: (f64, f64) = (5e-4, 0.0175);

/// Ends of fits nearer than this are the same minimum: m, rad.
const ONE_MINIMUM: (f64, f64) = (2e-5, 2e-4);

/// Fewest windows from which an answer is sought: there are up to four unknowns, and two numbers a window.
pub const WINDOWS_MIN: usize = 4;

/// What is known of a push beforehand.
#[derive(Clone, Copy, Debug)]
pub struct Known<'p> {
    /// The part.
    pub part: &'p Part,
    /// µ g of the plane, m/s².
    pub grip: f64,
    /// Standard deviation of ln(µ g): 0.2 where it is known to a fifth; none where it is known.
    pub grip_log_sd: Option<f64>,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// How the finger moves.
    pub motion: &'p FingerMotion,
}

/// What the force says.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Everything that the force cannot exclude, most probable first; empty if it excludes all.
    pub hypotheses: Vec<Hypothesis>,
    /// The best one's cost, listed or not.
    pub cost: Option<f64>,
    /// Above this cost no hypothesis explains the force: the 99.9 % quantile of chi-square.
    pub cost_max: f64,
    /// How many turns take the part to itself: hypotheses stand for as many poses each.
    pub symmetry: usize,
    /// Time since the onset up to which the force was used, s.
    pub duration: f64,
    /// Standard deviation of ln(µ g) beforehand, where it was not known.
    pub grip_log_sd: Option<f64>,
}

/// A pose that explains the force.
#[derive(Clone, Copy, Debug)]
pub struct Hypothesis {
    /// The edge that the finger touches: of parts that look the same turned, the first such.
    pub edge: usize,
    /// Contact angle at the start, rad.
    pub u0: f64,
    /// Contact on the edge at the start, m.
    pub s0: f64,
    /// Contact angle at the end, rad.
    pub u_end: f64,
    /// Contact on the edge at the end, m.
    pub s_end: f64,
    /// µ_c, if the contact slipped; otherwise it is `friction_needed` or more.
    pub mu_c: Option<f64>,
    /// Friction that rolling took.
    pub friction_needed: f64,
    /// The part's mass, kg (or relative, as the force).
    pub mass: f64,
    /// Standard deviation of its logarithm.
    pub mass_log_sd: f64,
    /// µ g of the plane, m/s²: as known, or as found.
    pub grip: f64,
    /// Standard deviation of ln(µ g); 0 where it is known.
    pub grip_log_sd: f64,
    /// Standard deviation of ln(µ m g), the force that the plane can resist with.
    pub resistance_log_sd: f64,
    /// Pose of the part frame in the motion's frame when the finger began to move.
    pub pose_start: Isometry2<f64>,
    /// The same at the end.
    pub pose_end: Isometry2<f64>,
    /// Covariance of `pose_end`: x, y, θ.
    pub covariance: Matrix3<f64>,
    /// How the part moves at the end.
    pub state_end: State,
    /// Covariance of `state_end`: u, s, ω, v_T; in rolling, v_T follows from the others.
    pub state_covariance: Matrix4<f64>,
    /// Squared whitened residuals.
    pub cost: f64,
    /// Share of probability among those listed (Laplace's approximation; every place on the outline alike).
    pub probability: f64,
}

impl Hypothesis {
    /// Standard deviations at the end: of the centre of mass (m, both directions together) and of the angle (rad).
    #[must_use]
    pub fn spread(&self, part: &Part) -> (f64, f64) {
        let arm = self.pose_end.rotation * part.centre_of_mass().coords;
        let to_centre = Matrix2x3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x);
        let centre = to_centre * self.covariance * to_centre.transpose();
        (centre.trace().max(0.0).sqrt(), self.covariance[(2, 2)].max(0.0).sqrt())
    }
}

impl Hypothesis {
    /// What a motion planner starts from. A contact that never slipped is taken to roll on: its friction is not known.
    #[must_use]
    pub fn belief(&self) -> Belief {
        let rolling = ContactLaw::Rolling { friction: None };
        Belief {
            edge: self.edge,
            law: self.mu_c.map_or(rolling, |friction| ContactLaw::Coulomb { friction }),
            state: self.state_end,
            covariance: self.state_covariance,
            probability: self.probability,
        }
    }
}

/// What the answer is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// One pose.
    Unique,
    /// Several.
    Ambiguous,
    /// None explains the force.
    None,
}

/// The plane's friction counts as found if its standard deviation is less than this share of what it was beforehand.
const FOUND_SHARE: f64 = 0.9;

/// Mass and friction of the plane are known together where their product's standard deviation is less than this share of each one's.
const TOGETHER_SHARE: f64 = 0.5;

impl Estimate {
    /// Whether the force tells µ m g but neither µ nor m, beyond what was known beforehand.
    #[must_use]
    pub fn mass_and_friction_are_one(&self) -> bool {
        let Some(beforehand) = self.grip_log_sd else { return false };
        self.hypotheses.first().is_some_and(|best| {
            best.grip_log_sd > FOUND_SHARE * beforehand && best.resistance_log_sd < TOGETHER_SHARE * best.mass_log_sd
        })
    }

    /// Finger and part at the time up to which the force was used: what a motion planner starts from.
    #[must_use]
    pub fn present<'p>(&self, known: &Known<'p>) -> Present<'p> {
        let legs: Vec<_> = known.motion.legs(known.radius).collect();
        // A motion has at least one segment.
        let leg = legs.iter().rev().find(|leg| leg.from < self.duration).unwrap_or(&legs[0]);
        let since = self.duration - leg.from;
        Present {
            part: known.part,
            grip: self.hypotheses.first().map_or(known.grip, |best| best.grip),
            radius: known.radius,
            centre: leg.finger.centre(since).coords.into(),
            velocity: leg.finger.velocity(since),
        }
    }

    fn weights(&self) -> impl Iterator<Item = Weight> + '_ {
        self.hypotheses.iter().map(|hypothesis| {
            let covariance = hypothesis.state_covariance.fixed_view::<2, 2>(0, 0).into();
            Weight { cost: hypothesis.cost, covariance }
        })
    }

    /// What the answer is.
    #[must_use]
    pub fn status(&self) -> Status {
        match self.hypotheses.len() {
            0 => Status::None,
            1 => Status::Unique,
            _ => Status::Ambiguous,
        }
    }
}

/// Every pose that explains what was felt, sought all over the part.
#[must_use]
pub fn estimate(known: &Known, felt: &FeltForce) -> Estimate {
    estimate_until(known, felt, &never).found
}

/// The same, ended when `stop` says so: then with the poses found by then.
#[must_use]
pub fn estimate_until(known: &Known, felt: &FeltForce, stop: Stop<'_>) -> Searched<Estimate> {
    let halt = Halt::new(stop);
    let estimate = halting_estimate(known, felt, &halt);
    halt.searched(estimate)
}

fn halting_estimate(known: &Known, felt: &FeltForce, halt: &Halt<'_>) -> Estimate {
    let symmetry = symmetry::order(known.part);
    let edges = known.part.polygon().vertices().len() / symmetry;
    let course = course(known, felt);
    let problem = Problem { course: &course, felt };
    let edges = (0..edges).take_while(|_| !halt.is_wished());
    let starts = edges.flat_map(|edge| seeds::on_edge(&problem, edge)).collect();
    conclude(&problem, descend_all(&problem, starts, halt), symmetry)
}

/// Which of several parts explains what was felt, the likeliest first; `known` differs in the part.
#[must_use]
pub fn which_part(known: &[Known], felt: &FeltForce) -> Vec<PartEstimate<Estimate>> {
    which_part_until(known, felt, &never).found
}

/// The same, ended when `stop` says so: then parts that were not looked at explain nothing yet, and others too little.
#[must_use]
pub fn which_part_until(known: &[Known], felt: &FeltForce, stop: Stop<'_>) -> Searched<Vec<PartEstimate<Estimate>>> {
    let halt = Halt::new(stop);
    let parts = ranked(known.iter().map(|known| {
        let estimate = halting_estimate(known, felt, &halt);
        let evidence = log_evidence(known.part, estimate.weights());
        (estimate, evidence)
    }));
    halt.searched(parts)
}

/// What several parts of one outline leave possible together, whichever it is: poses of different parts that are one are joined, and
/// its covariance covers them all. None where no part explains the force, or those that do differ in their symmetry, so that
/// their poses do not stand for the same.
#[must_use]
pub fn mixed(parts: &[PartEstimate<Estimate>]) -> Option<Estimate> {
    let possible = || parts.iter().filter(|part| part.probability > 0.0);
    let first = possible().next()?;
    if possible().any(|part| part.estimate.symmetry != first.estimate.symmetry) {
        return None;
    }
    let by_part = |part: &PartEstimate<Estimate>| {
        let share = part.probability;
        part.estimate
            .hypotheses
            .clone()
            .into_iter()
            .map(move |found| Hypothesis { probability: share * found.probability, ..found })
    };
    let mut all: Vec<_> = possible().flat_map(by_part).collect();
    all.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    let mut hypotheses = joined(all);
    hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    Some(Estimate { hypotheses, ..first.estimate.clone() })
}

/// The same, sought only where an earlier answer from the beginning of the same push had found something: what was excluded then
/// stays excluded.
#[must_use]
pub fn follow(known: &Known, felt: &FeltForce, earlier: &Estimate) -> Estimate {
    let course = course(known, felt);
    let problem = Problem { course: &course, felt };
    let starts = earlier.hypotheses.iter().filter_map(|hypothesis| problem.try_guess(hypothesis.guess(&course)));
    let starts = starts.collect::<Vec<_>>();
    conclude(&problem, descend_all(&problem, starts, &Halt::new(&never)), earlier.symmetry)
}

fn course<'p>(known: &Known<'p>, felt: &FeltForce) -> Course<'p> {
    Course {
        part: known.part,
        grip: known.grip,
        grip_log_sd: known.grip_log_sd,
        legs: known.motion.legs(known.radius).collect(),
        duration: windows::end(felt.count() - 1),
    }
}

/// Goes down from every start, giving up what stays far above the best. Only what came to its minimum before the wish to halt is kept.
fn descend_all(problem: &Problem, starts: Vec<Tried>, halt: &Halt<'_>) -> Vec<Tried> {
    let starts = starts.into_iter().take_while(|_| !halt.is_wished());
    let mut tried: Vec<_> = starts.map(|start| problem.descend(start, STEPS_FIRST)).collect();
    let best = least_cost(&tried);
    tried.retain(|tried| tried.cost <= HOPELESS * best || tried.cost <= best + HOPELESS_COST);
    let tried = tried.into_iter().take_while(|_| !halt.is_wished());
    tried.map(|tried| problem.descend(tried, usize::MAX)).collect()
}

fn least_cost(tried: &[Tried]) -> f64 {
    tried.iter().map(|tried| tried.cost).fold(f64::INFINITY, f64::min)
}

/// The list of what cannot be excluded.
fn conclude(problem: &Problem, mut tried: Vec<Tried>, symmetry: usize) -> Estimate {
    let duration = problem.course.duration;
    let cost_max = chi_square_limit(2 * problem.felt.count());
    tried.retain(|tried| is_possible(problem, tried));
    tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let best = tried.first().map(|tried| tried.cost);
    let listed: Vec<_> = match best {
        Some(best) if best <= cost_max => distinct(tried, best + COST_MARGIN),
        _ => Vec::new(),
    };
    let mut hypotheses: Vec<_> =
        listed.iter().filter_map(|tried| hypothesis(problem, tried, best.unwrap_or(tried.cost))).collect();
    let total: f64 = hypotheses.iter().map(|hypothesis| hypothesis.probability).sum();
    hypotheses.iter_mut().for_each(|hypothesis| hypothesis.probability /= total);
    let mut hypotheses = joined(hypotheses);
    hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    Estimate { hypotheses, cost: best, cost_max, symmetry, duration, grip_log_sd: problem.course.grip_log_sd }
}

/// Whether the finger can be there at all, outside the part.
fn is_possible(problem: &Problem, tried: &Tried) -> bool {
    let Ok(edge) = problem.course.part.edge(tried.guess.edge) else { return false };
    let start = Start::Rest { u: tried.guess.u, s: tried.guess.s.clamp(edge.s_min, edge.s_max) };
    Push::new(problem.course.first_model(edge), ContactLaw::Frictionless, start, EdgeEnd::Stop).is_ok()
}

/// The minima up to a cost, each once: several fits end in the same.
fn distinct(tried: Vec<Tried>, cost_max: f64) -> Vec<Tried> {
    let mut kept: Vec<Tried> = Vec::new();
    for tried in tried.into_iter().take_while(|tried| tried.cost <= cost_max) {
        let same = |other: &Tried| {
            let [a, b] = [&tried, other].map(|tried| tried.path.end);
            other.guess.edge == tried.guess.edge
                && (a.s - b.s).abs() < ONE_MINIMUM.0
                && (a.u - b.u).abs() < ONE_MINIMUM.1
        };
        if !kept.iter().any(same) {
            kept.push(tried);
        }
    }
    kept
}

/// Hypotheses so near each other that they are one answer are joined; its spread covers them all.
fn joined(hypotheses: Vec<Hypothesis>) -> Vec<Hypothesis> {
    let mut kept: Vec<Hypothesis> = Vec::new();
    for hypothesis in hypotheses {
        let near = |other: &&mut Hypothesis| {
            let (place, angle) = ((other.s_end - hypothesis.s_end).abs(), (other.u_end - hypothesis.u_end).abs());
            other.edge == hypothesis.edge && place < SAME_PLACE.0 && angle < SAME_PLACE.1
        };
        match kept.iter_mut().find(near) {
            Some(other) => other.take_in(&hypothesis),
            None => kept.push(hypothesis),
        }
    }
    kept
}

impl Hypothesis {
    fn guess(&self, course: &Course) -> Guess {
        let grip_log = if course.grip_log_sd.is_some() { (self.grip / course.grip).ln() } else { 0.0 };
        Guess { edge: self.edge, u: self.u0, s: self.s0, mu_c: self.mu_c.unwrap_or(f64::INFINITY), grip_log }
    }

    /// Covers another one too, of a greater cost.
    fn take_in(&mut self, other: &Self) {
        let share = other.probability / (self.probability + other.probability);
        let apart = difference(&self.pose_end, &other.pose_end);
        self.covariance = self.covariance * (1.0 - share) + (other.covariance + apart * apart.transpose()) * share;
        let state = Vector2::new(other.state_end.u - self.state_end.u, other.state_end.s - self.state_end.s);
        let mut states = self.state_covariance * (1.0 - share) + other.state_covariance * share;
        let mut of_place = states.fixed_view_mut::<2, 2>(0, 0);
        of_place += state * state.transpose() * share;
        self.state_covariance = states;
        self.probability += other.probability;
    }
}

fn hypothesis(problem: &Problem, tried: &Tried, best: f64) -> Option<Hypothesis> {
    let at_end = problem.end_covariance(tried)?;
    let EndCovariance { pose: covariance, state: state_covariance, spread, .. } = at_end;
    let Tried { guess, path, mass, cost, .. } = tried;
    Some(Hypothesis {
        edge: guess.edge,
        u0: guess.u,
        s0: guess.s,
        u_end: path.end.u,
        s_end: path.end.s,
        mu_c: path.slipped.then_some(guess.mu_c),
        friction_needed: path.friction_needed,
        mass: *mass,
        mass_log_sd: at_end.mass_log_sd,
        grip: problem.course.grip_of(guess),
        grip_log_sd: at_end.grip_log_sd,
        resistance_log_sd: at_end.resistance_log_sd,
        pose_start: problem.course.pose_at_start(guess)?,
        pose_end: problem.course.pose_at_end(guess, path)?,
        covariance,
        state_end: path.end,
        state_covariance,
        cost: *cost,
        // Relative to the others: a cost of hundreds would leave nothing of its exponential.
        probability: spread * (-0.5 * (cost - best)).exp(),
    })
}

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
