//! Pose and motion of a part that a carried finger begins to push, from each reading of its force sensor.
//!
//! The sensor sits between the robot and the finger. What it reads is the force of the contact on the disk less what the
//! finger's own effective mass takes, −m a. The motion and the readings share one clock, so that the moment of the onset
//! is known: it is when the finger begins to move. Unknown may be the part's mass, µ_c, and, each with a prior, µ of the
//! plane, the finger's effective mass and the part's outline: an offset of every edge along its normal.
//!
//! The search is that of [`super`]; readings take the place of windows. Effective mass and outline are numbers of which
//! the force is a linear function, nearly: they are found in closed form for every guess (`felt`), the search itself being
//! done with the outline as told and noise that is larger by what the outline may change.
//!
//! The motion is told, or measured by a clock of its own: then the clock's offset is sought too, and what the places leave
//! open of the motion is part of the covariance.
//!
//! Assumes: white noise; bending that moves the disk, but adds nothing to its speed. Frames: world axes. Units: SI.
//! Errors: none. "No pose explains the readings" and "several do" are answers.

use nalgebra::{DVector, Isometry2, Matrix6, Translation2, Vector2, Vector6};

use super::felt::{Felt, Predicted};
use super::fit::{OUTLINE_SHARE_OF_SD, Problem, Tried};
use super::path::{Course, CourseStart, Guess, Path};
use super::{GATE, distinct, is_one_place, is_possible, leads, misfit_limit, search, symmetry};
use crate::geometry::{Pose, SimplePolygon};
use crate::pushing::dynamics::{Part, State};
use crate::pushing::estimation::hypotheses;
use crate::pushing::finger_motion::{FingerMotion, Leg};
use crate::pushing::measured_path::{FittedPath, MeasuredPath, Wandering};
use crate::search::{Halt, Searched, Stop};

/// A force read.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceReading {
    /// Since the finger began to move, s.
    pub time: f64,
    /// On the finger as the sensor gives it, world axes, N.
    pub force: Vector2<f64>,
}

/// What is known of a push beforehand.
#[derive(Clone, Copy, Debug)]
pub struct KnownOfFinger<'p> {
    /// The part on its plane.
    pub part: &'p Part,
    /// What is not known of its outline; none where that is exact.
    pub outline: Option<OutlineErrors<'p>>,
    /// The part's mass, kg, where it is known.
    pub mass: Option<f64>,
    /// µ g of the plane, m/s².
    pub mu_g: f64,
    /// Standard deviation of ln(µ g); none where it is known.
    pub mu_g_log_sd: Option<f64>,
    /// µ_c, where it is known.
    pub mu_c: Option<f64>,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Of the finger, as the sensor feels it accelerate, kg.
    pub effective_mass: f64,
    /// Standard deviation of that, kg.
    pub effective_mass_sd: f64,
    /// Whether the finger pushes the part when the first reading is taken; otherwise both are at rest until it moves.
    pub is_moving: bool,
    /// How far the disk gives way to a force on it, m/N.
    pub compliance: f64,
    /// How the finger moves, from rest.
    pub motion: &'p FingerMotion,
    /// Standard deviation of one reading, each axis, N.
    pub noise: f64,
}

/// What is not known of an outline.
#[derive(Clone, Copy)]
pub struct OutlineErrors<'p> {
    /// Standard deviation of the offset of each edge's line along its normal, independent, m.
    pub sigma: f64,
    /// The part whose outline this is.
    pub part: &'p dyn Fn(SimplePolygon) -> Part,
}

impl std::fmt::Debug for OutlineErrors<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("OutlineErrors").field("sigma", &self.sigma).finish_non_exhaustive()
    }
}

impl OutlineErrors<'_> {
    /// The part with each edge so many standard deviations further out; none where edges then cross.
    fn moved(&self, part: &Part, off: &[f64]) -> Option<Part> {
        part.polygon().with_edges_moved(|edge| off[edge] * self.sigma).map(self.part)
    }
}

/// A pose and motion that explain the readings.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceHypothesis {
    /// The edge that holds the contact at the last reading.
    pub edge: usize,
    /// At the first.
    pub start: State,
    /// At the last.
    pub end: State,
    /// The part at the first reading.
    pub pose_start: Pose,
    /// At the last.
    pub pose_end: Pose,
    /// Velocity of the centre of mass at the last, m/s.
    pub velocity_end: Vector2<f64>,
    /// Of `pose_end` (x, y, theta), that velocity, and ω.
    pub covariance: Matrix6<f64>,
    /// kg.
    pub mass: f64,
    /// None where it is unknown and the contact never slipped.
    pub mu_c: Option<f64>,
    /// m/s².
    pub mu_g: f64,
    /// kg.
    pub effective_mass: f64,
    /// Squared residuals in standard deviations, prior terms included.
    pub cost: f64,
    /// Data and prior terms less fitted parameters.
    pub degrees_of_freedom: usize,
    /// Among the hypotheses, by Laplace's approximation; before the push every place of the perimeter is as likely.
    pub probability: f64,
}

impl ForceHypothesis {
    /// Standard deviations at the end: of the centre of mass (m, both directions together) and of the angle (rad).
    #[must_use]
    pub fn spread(&self, part: &Part) -> (f64, f64) {
        hypotheses::spread(part, &self.pose_end, &self.covariance.fixed_view::<3, 3>(0, 0).into_owned())
    }
}

/// Everything that explains the readings, the likeliest first.
#[must_use]
pub fn estimate_until(
    known: &KnownOfFinger,
    readings: &[ForceReading],
    stop: Stop<'_>,
) -> Searched<Vec<ForceHypothesis>> {
    let halt = Halt::new(stop);
    let found = halting_estimate(known, readings, &halt);
    halt.searched(found)
}

/// How a push may have begun, to be fitted from: at the onset, or at the first reading of a part that moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beginning {
    /// The edge that the finger touches.
    pub edge: usize,
    /// There.
    pub state: State,
    /// Whether the contact then rolls; of no concern at rest.
    pub is_rolling: bool,
    /// µ_c.
    pub mu_c: f64,
}

/// What a fit leads to which begins with what is given, and what an explanation of these readings may cost at the most:
/// what a search is judged by. None where the push cannot have begun so.
#[must_use]
pub fn follow(known: &KnownOfFinger, readings: &[ForceReading], from: &Beginning) -> Option<(ForceHypothesis, f64)> {
    let push = FeltPush::new(known, readings)?;
    let followed = push.followed(push.guess(from)?)?;
    Some((followed.found, followed.cost_max + push.felt.before.0))
}

fn halting_estimate(known: &KnownOfFinger, readings: &[ForceReading], halt: &Halt<'_>) -> Vec<ForceHypothesis> {
    let (edges, symmetry) = distinct_edges(known.part);
    let Some(push) = FeltPush::new(known, readings) else { return Vec::new() };
    let found = push.leads(&edges, usize::MAX, halt).into_iter().take_while(|_| !halt.is_wished());
    let found = found.filter_map(|lead| push.followed(lead));
    conclude(found.collect(), known.part, symmetry)
}

/// The edges of which no two look the same, and how many turns take the part to itself.
fn distinct_edges(part: &Part) -> (Vec<usize>, usize) {
    let symmetry = symmetry::order(part);
    let sides = part.sides();
    let distinct = sides.len() / symmetry;
    (sides.take(distinct).map(|(edge, _)| edge).collect(), symmetry)
}

/// A push as it was felt, of a finger that is known to move so.
struct FeltPush<'a, 'p> {
    known: &'a KnownOfFinger<'p>,
    course: Course<'p>,
    /// With what the outline may change as noise: for the search.
    roughly: ReadForce,
    felt: ReadForce,
}

impl<'a, 'p> FeltPush<'a, 'p> {
    /// None without readings of the push.
    fn new(known: &'a KnownOfFinger<'p>, readings: &[ForceReading]) -> Option<Self> {
        let first = readings.first()?;
        let (start, from) = if known.is_moving { (CourseStart::Moving, first.time) } else { (CourseStart::Rest, 0.0) };
        let legs = legs_since(known.motion.legs(known.radius), from);
        let readings: Vec<_> = readings.iter().map(|it| ForceReading { time: it.time - from, ..*it }).collect();
        let end = readings.last().map(|reading| reading.time).filter(|end| *end > 0.0)?;
        let of_outline = if known.outline.is_none() { 0.0 } else { OUTLINE_SHARE };
        let roughly = ReadForce::new(known, &legs, &readings, of_outline)?;
        let felt = ReadForce::new(known, &legs, &readings, 0.0)?;
        let course = Course {
            part: known.part,
            mu_g: known.mu_g,
            mu_g_log_sd: known.mu_g_log_sd,
            mu_c: known.mu_c,
            outlines: &[],
            outline_off: &[],
            start,
            legs,
            duration: end,
        };
        Some(Self { known, course, roughly, felt })
    }

    /// Where the search comes to, the best first: without what the outline takes up.
    fn leads(&self, edges: &[usize], most: usize, halt: &Halt<'_>) -> Vec<Guess> {
        let problem = Problem { course: &self.course, measured: &self.roughly, mass: self.known.mass };
        let mut tried = search(&problem, edges, halt);
        // Where the finger cannot be, it leads nowhere.
        tried.retain(|tried| is_possible(&problem, tried));
        let most = if self.known.outline.is_some() { most.min(OUTLINE_LEADS) } else { most };
        leads(&tried, most).into_iter().map(|lead| lead.guess).collect()
    }

    /// As a guess; none of an edge that the part has not.
    fn guess(&self, from: &Beginning) -> Option<Guess> {
        let State { u, s, omega, v_t } = from.state;
        let at_rest = Guess { edge: from.edge, u, s, mu_c: from.mu_c, ..Guess::AT_REST };
        if !self.known.is_moving {
            return Some(at_rest);
        }
        let model = self.course.first_model(self.known.part.edge(from.edge).ok()?);
        let rolling = model.rolling_v_t(-self.course.legs[0].from, &from.state);
        Some(Guess { omega, slide: if from.is_rolling { 0.0 } else { v_t - rolling }, ..at_rest })
    }

    /// The minimum that a guess leads to, with all that is unknown.
    fn followed(&self, guess: Guess) -> Option<Concluded> {
        if let Some(outline) = &self.known.outline {
            return with_outline(&self.course, outline, guess, self.known, &self.felt);
        }
        let problem = Problem { course: &self.course, measured: &self.felt, mass: self.known.mass };
        let tried = problem.descend(problem.try_guess(guess)?, usize::MAX);
        concluded(&problem, vec![tried], self.known, &self.felt).pop()
    }
}

/// A finger whose places were measured, by a clock of its own.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredFinger<'a> {
    /// Of the clamp, in time of the path's clock.
    pub path: &'a MeasuredPath,
    /// Standard deviation of what that clock lags behind the force's, s; 0 where it is the same.
    pub clock_offset_sd: f64,
}

/// What readings say of a push of a finger whose places were measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredEstimate {
    /// When the push began, by the force's clock, s; none of a part that moves already, and where none was felt.
    pub onset: Option<f64>,
    /// What explains the readings, the likeliest first, each with what the path's clock then is early, s.
    pub hypotheses: Vec<(f64, ForceHypothesis)>,
}

/// The same as [`estimate_until`] for a finger whose places were measured; readings are in time of their own clock, and
/// the motion in `known` is left aside.
#[must_use]
pub fn estimate_measured_until(
    known: &KnownOfFinger,
    finger: &MeasuredFinger,
    readings: &[ForceReading],
    stop: Stop<'_>,
) -> Searched<MeasuredEstimate> {
    let halt = Halt::new(stop);
    let (edges, symmetry) = distinct_edges(known.part);
    let onset = if known.is_moving { None } else { force_onset(readings, known.noise) };
    if onset.is_none() && !known.is_moving {
        return halt.searched(MeasuredEstimate::default());
    }
    let sd = finger.clock_offset_sd;
    let begins = onset.or_else(|| finger.path.times.first().copied()).and_then(|begins| finger.path.wandering(begins));
    let Some(wandering) = begins else {
        return halt.searched(MeasuredEstimate { onset, ..MeasuredEstimate::default() });
    };
    let at = |offset: f64| OffsetPush { known, finger, wandering: &wandering, readings, onset, offset };
    let mut begun: Vec<(f64, f64, Guess)> = Vec::new();
    for offset in if sd > 0.0 { OFFSETS_TRIED.map(|place| place * sd).to_vec() } else { vec![0.0] } {
        let leads = at(offset).solved(|push| push.leads(&edges, OFFSET_LEADS, &halt)).unwrap_or_default();
        let leads = leads.into_iter().take_while(|_| !halt.is_wished());
        begun.extend(leads.filter_map(|lead| Some((at(offset).followed(lead)?.cost, offset, lead))));
    }
    begun.sort_by(|a, b| a.0.total_cmp(&b.0));
    let least = begun.first().map_or(0.0, |begun| begun.0);
    begun.retain(|begun| begun.0 <= OFFSET_HOPELESS * least.max(2.0 * readings.len() as f64));
    let mut found: Vec<(f64, Concluded)> = Vec::new();
    for (_, offset, guess) in begun.into_iter().take(OFFSET_FOLLOWED).take_while(|_| !halt.is_wished()) {
        let Some((offset, next)) = best_offset(&at, offset, guess, sd, &halt) else { continue };
        let is_known = |(_, other): &(f64, Concluded)| is_one_place(&other.guess, &other.end, &next.guess, &next.end);
        match found.iter_mut().find(|other| is_known(other)) {
            Some(other) if next.cost < other.1.cost => *other = (offset, next),
            Some(_) => {}
            None => found.push((offset, next)),
        }
    }
    for (offset, found) in found.iter_mut().take_while(|_| !halt.is_wished()) {
        found.found.covariance += at(*offset).of_path(found);
    }
    let (offsets, found): (Vec<_>, Vec<_>) = found.into_iter().unzip();
    let costs: Vec<_> = found.iter().map(|found| found.found.cost).collect();
    let listed = conclude(found, known.part, symmetry);
    let of = |listed: &ForceHypothesis| {
        let same = costs.iter().position(|cost| cost.to_bits() == listed.cost.to_bits());
        same.map_or(0.0, |place| offsets[place])
    };
    let hypotheses = listed.into_iter().map(|listed| (of(&listed), listed)).collect();
    halt.searched(MeasuredEstimate { onset, hypotheses })
}

/// Offsets at which everything is sought, in standard deviations.
const OFFSETS_TRIED: [f64; 5] = [0.0, -0.8, 0.8, -1.7, 1.7];

/// Minima of each that are followed.
const OFFSET_LEADS: usize = 8;

/// Minima of all that are followed to their best offset.
const OFFSET_FOLLOWED: usize = 10;

/// What costs so many times the best there is, or what chance would have it cost, leads nowhere.
const OFFSET_HOPELESS: f64 = 8.0;

/// First step to a better offset, in standard deviations, and the last, s.
const OFFSET_STEP: (f64, f64) = (0.2, 1e-4);

/// Trials on the way to the best offset.
const OFFSET_TRIALS: usize = 24;

/// The offset at which a minimum is lowest, and what it is there with the offset's own uncertainty.
fn best_offset<'a>(
    at: &impl Fn(f64) -> OffsetPush<'a>,
    offset: f64,
    guess: Guess,
    sd: f64,
    halt: &Halt<'_>,
) -> Option<(f64, Concluded)> {
    let mut best = at(offset).followed(guess)?;
    if sd == 0.0 {
        return Some((offset, best));
    }
    let (mut offset, mut step) = (offset, OFFSET_STEP.0 * sd);
    for _ in 0..OFFSET_TRIALS {
        if halt.is_wished() {
            break;
        }
        let there = [step, -step].map(|by| Some((offset + by, at(offset + by).followed(best.guess)?)));
        let better = there.into_iter().flatten().min_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        match better.filter(|(_, better)| better.cost < best.cost) {
            Some(better) => (offset, best) = better,
            None if step < 2.0 * OFFSET_STEP.1 => break,
            None => step *= 0.4,
        }
    }
    // By differences that raise the cost by about one.
    let step = (0.05 * sd).max(OFFSET_STEP.1);
    let sides = [step, -step].map(|by| at(offset + by).followed(best.guess));
    if let [Some(after), Some(before)] = sides {
        let curvature = (after.cost + before.cost - 2.0 * best.cost) / (step * step);
        // The prior alone is that curved.
        let variance = 2.0 / curvature.max(2.0 / (sd * sd));
        let slope = end_change(&before.found, &after.found) / (2.0 * step);
        best.found.covariance += slope * slope.transpose() * variance;
    }
    Some((offset, best))
}

/// How pose and motion at the end differ: x, y, θ, velocity, ω.
fn end_change(from: &ForceHypothesis, to: &ForceHypothesis) -> Vector6<f64> {
    let off = to.pose_end.minus(&from.pose_end);
    let velocity = to.velocity_end - from.velocity_end;
    Vector6::new(off.x, off.y, off.z, velocity.x, velocity.y, to.end.omega - from.end.omega)
}

/// Modes of a measured motion whose uncertainty counts.
const PATH_MODES: usize = 10;

/// A push whose path's clock lags by a known time.
struct OffsetPush<'a> {
    known: &'a KnownOfFinger<'a>,
    finger: &'a MeasuredFinger<'a>,
    wandering: &'a Wandering,
    readings: &'a [ForceReading],
    /// When the force begins; none of a part that moves.
    onset: Option<f64>,
    offset: f64,
}

impl OffsetPush<'_> {
    /// Something of the push with the motion that goes with this offset.
    fn with<T>(&self, off: Option<(usize, &DVector<f64>)>, of: impl FnOnce(&FeltPush, &FittedPath) -> T) -> Option<T> {
        let path = self.finger.path;
        let onset = self.path_onset()?;
        let fitted = path.fitted_beside(onset, self.wandering, off)?;
        let heavy = self.known.mass.unwrap_or_else(|| self.mass_felt()) + self.known.effective_mass;
        let noise = self.known.noise.hypot(heavy * self.wandering.acceleration_sd);
        let known = KnownOfFinger { motion: &fitted.motion, noise, ..*self.known };
        let moved = |reading: &ForceReading| ForceReading { time: reading.time - self.offset - onset, ..*reading };
        let readings: Vec<_> = self.readings.iter().map(moved).collect();
        FeltPush::new(&known, &readings).map(|push| of(&push, &fitted))
    }

    fn solved<T>(&self, of: impl FnOnce(&FeltPush) -> T) -> Option<T> {
        self.with(None, |push, _| of(push))
    }

    /// When the finger begins to move, by the path's clock: of a part that moves already since who knows when.
    fn path_onset(&self) -> Option<f64> {
        Some(self.onset.map_or(*self.finger.path.times.first()?, |onset| onset - self.offset))
    }

    /// What the path leaves open of the end of a minimum: how it moves with each mode of the motion.
    fn of_path(&self, found: &Concluded) -> Matrix6<f64> {
        let Some(onset) = self.path_onset() else { return Matrix6::zeros() };
        let modes = self.finger.path.modes(onset, self.wandering, PATH_MODES);
        let there = |axis: usize, mode: &DVector<f64>| {
            let there = self.with(Some((axis, mode)), |push, _| push.followed(found.guess))??;
            let change = end_change(&found.found, &there.found);
            Some(change * change.transpose())
        };
        let changes = [0, 1].into_iter().flat_map(|axis| modes.iter().filter_map(move |mode| there(axis, mode)));
        changes.sum()
    }

    /// The minimum that a guess leads to, the path's misfit and the offset's prior included.
    fn followed(&self, guess: Guess) -> Option<Concluded> {
        let sd = self.finger.clock_offset_sd;
        self.with(None, |push, fitted| {
            let mut found = push.followed(guess)?;
            let prior = if sd > 0.0 { (self.offset / sd).powi(2) } else { 0.0 };
            let of_path = to_count(self.wandering.degrees_of_freedom);
            let freedom = found.found.degrees_of_freedom;
            found.cost += prior + fitted.misfit;
            found.found.cost += prior + fitted.misfit;
            found.found.degrees_of_freedom += of_path;
            found.cost_max += misfit_limit(freedom + of_path, f64::INFINITY) - misfit_limit(freedom, f64::INFINITY);
            Some(found)
        })?
    }

    /// About the part's mass, from how the plane's friction is felt, kg.
    fn mass_felt(&self) -> f64 {
        let felt = self.readings.iter().map(|reading| reading.force.norm()).fold(0.0, f64::max);
        felt / self.known.mu_g.max(f64::MIN_POSITIVE)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of values")]
fn to_count(values: f64) -> usize {
    values.max(0.0).round() as usize
}

/// When the force begins: between the last quiet reading and the first of two that are not; none where it never does.
fn force_onset(readings: &[ForceReading], noise: f64) -> Option<f64> {
    let is_loud = |reading: &ForceReading| reading.force.norm() > LOUD * noise;
    let first = readings.windows(2).position(|two| two.iter().all(is_loud))?;
    let before = readings[..first].last().map_or(readings[first].time, |quiet| quiet.time);
    Some(0.5 * (before + readings[first].time))
}

/// A force of so many standard deviations is one.
const LOUD: f64 = 6.0;

/// What a guess leads to with the outline found too: what its numbers change of the force is straight only near them, so
/// that each step begins where the one before came to.
fn with_outline<'p>(
    course: &Course<'p>,
    outline: &OutlineErrors<'_>,
    mut guess: Guess,
    known: &KnownOfFinger,
    felt: &ReadForce,
) -> Option<Concluded> {
    let edges = known.part.polygon().vertices().len();
    let mut off = vec![0.0; edges];
    let mut last: Option<Concluded> = None;
    for _ in 0..OUTLINE_STEPS {
        let part = outline.moved(known.part, &off)?;
        let one_more = |edge: usize| {
            let more = |n: usize| if n == edge { OUTLINE_SHARE_OF_SD } else { 0.0 };
            let off: Vec<_> = off.iter().enumerate().map(|(n, off)| off + more(n)).collect();
            // An edge so short that it vanishes changes nothing.
            outline.moved(known.part, &off).unwrap_or_else(|| part.clone())
        };
        let outlines: Vec<_> = (0..edges).map(one_more).collect();
        let course = Course { part: &part, outlines: &outlines, outline_off: &off, ..course.clone() };
        let problem = Problem { course: &course, measured: felt, mass: known.mass };
        let tried = problem.descend(problem.try_guess(guess)?, usize::MAX);
        guess = tried.guess;
        let (before, taken) = (last.map(|last| last.cost), problem.taken_of_outline(&tried));
        // The cost by straight lines; where nothing changes any more, it is the cost.
        last = Some(concluded(&problem, vec![tried], known, felt).pop()?);
        let cost = last.as_ref().map(|last| last.cost);
        if before.zip(cost).is_some_and(|(before, after)| (before - after).abs() < OUTLINE_STEP) {
            break;
        }
        off = taken;
    }
    last
}

/// Steps in which an outline is found.
const OUTLINE_STEPS: usize = 12;

/// A step that changes the cost by less is the last.
const OUTLINE_STEP: f64 = 0.01;

/// The legs of a motion in time since a moment, the first being under way then.
fn legs_since(legs: impl Iterator<Item = Leg>, from: f64) -> Vec<Leg> {
    let moved = legs.map(|leg| Leg { from: leg.from - from, to: leg.to - from, ..leg });
    moved.filter(|leg| leg.to > 0.0).collect()
}

/// What an outline that is not known exactly changes of the force, as a share, at the most: noise of the search.
const OUTLINE_SHARE: f64 = 0.02;

/// Minima that are followed with the outline's numbers found too.
const OUTLINE_LEADS: usize = 12;

/// Readings whose mean is the first force, s: a part that begins to turn does so by a millirad meanwhile.
const FIRST_S: f64 = 0.01;

/// What a simulated force may be off by, as a share of it.
const MODEL_SHARE: f64 = 2e-4;

/// A reading this near a change of the finger's acceleration is after it, s.
const AFTER_S: f64 = 1e-9;

/// A jump of the force at a moment that is not known is spread over no more than this, s.
const JUMP_S: f64 = 5e-3;

/// Readings since the onset, in standard deviations.
#[derive(Clone, Debug)]
struct ReadForce {
    /// Since the onset, s.
    times: Vec<f64>,
    /// Time from one to the next, s.
    period: f64,
    /// Of each, N.
    deviations: Vec<f64>,
    data: DVector<f64>,
    /// What one standard deviation of the effective mass adds.
    of_mass: Option<DVector<f64>>,
    first: Vector2<f64>,
    /// Squared readings before the onset, in standard deviations, and how many values they are.
    before: (f64, usize),
}

impl ReadForce {
    /// None without readings after the onset.
    fn new(known: &KnownOfFinger, legs: &[Leg], readings: &[ForceReading], of_outline: f64) -> Option<Self> {
        let acceleration = |time: f64| {
            let leg = legs.iter().rev().find(|leg| leg.from <= time + AFTER_S);
            leg.map_or_else(Vector2::zeros, |leg| leg.finger.acceleration)
        };
        // A reading at the onset itself may be of either side.
        let (skip, take) = if known.is_moving { (0.0, -AFTER_S) } else { (-AFTER_S, AFTER_S) };
        let before = &readings[..readings.partition_point(|reading| reading.time < skip)];
        let after = &readings[readings.partition_point(|reading| reading.time <= take)..];
        let [first, .., last] = after else { return None };
        let contact = |reading: &ForceReading| reading.force + known.effective_mass * acceleration(reading.time);
        let early: Vec<_> =
            after.iter().take_while(|reading| reading.time <= first.time + FIRST_S).map(contact).collect();
        let deviations: Vec<_> = after
            .iter()
            .map(|reading| known.noise.hypot((MODEL_SHARE + of_outline) * contact(reading).norm()))
            .collect();
        let stacked = |of: &dyn Fn(&ForceReading) -> Vector2<f64>| {
            let values = after.iter().zip(&deviations).flat_map(|(reading, deviation)| {
                let of = of(reading) / *deviation;
                [of.x, of.y]
            });
            DVector::from_iterator(2 * after.len(), values)
        };
        let of_mass = (known.effective_mass_sd > 0.0)
            .then(|| stacked(&|reading| -known.effective_mass_sd * acceleration(reading.time)));
        let squares = before.iter().map(|reading| reading.force.norm_squared()).sum::<f64>();
        Some(Self {
            times: after.iter().map(|reading| reading.time + AFTER_S).collect(),
            period: (last.time - first.time) / (after.len() - 1) as f64,
            data: stacked(&contact),
            of_mass,
            first: early.iter().sum::<Vector2<f64>>() / early.len() as f64,
            before: (squares / known.noise.powi(2), 2 * before.len()),
            deviations,
        })
    }
}

impl Felt for ReadForce {
    fn data(&self) -> &DVector<f64> {
        &self.data
    }

    fn freedom(&self) -> f64 {
        f64::INFINITY
    }

    fn first(&self) -> Vector2<f64> {
        self.first
    }

    fn predicted(&self, path: &Path, _delay: f64) -> Predicted {
        let mut force = path.forces_in_finger_time(self.period.min(JUMP_S));
        let mut shape = DVector::zeros(self.data.len());
        let mut unsure: Vec<(usize, DVector<f64>)> = Vec::new();
        for (row, (&time, deviation)) in self.times.iter().zip(&self.deviations).enumerate() {
            let mean = force.at(time) / *deviation;
            shape.fixed_rows_mut::<2>(2 * row).copy_from(&mean);
            if let Some((jump, sd)) = force.unsure(time) {
                if unsure.last().is_none_or(|(last, _)| *last != jump) {
                    unsure.push((jump, DVector::zeros(self.data.len())));
                }
                let column = unsure.last_mut().map(|(_, column)| column);
                column.into_iter().for_each(|column| column.fixed_rows_mut::<2>(2 * row).copy_from(&(sd / *deviation)));
            }
        }
        let unsure = unsure.into_iter().map(|(_, column)| column).collect();
        Predicted { unsure, beside: self.of_mass.iter().cloned().collect(), ..Predicted::exact(shape) }
    }

    fn onset_sd(&self) -> Option<f64> {
        None
    }

    fn onsets_tried(&self) -> Vec<f64> {
        vec![0.0]
    }
}

/// A minimum that may be listed.
struct Concluded {
    /// Of the readings after the onset.
    cost: f64,
    cost_max: f64,
    guess: Guess,
    end: State,
    found: ForceHypothesis,
}

/// The minima at which the finger can be, with what they say; their probabilities are not yet of one sum.
fn concluded(problem: &Problem, mut tried: Vec<Tried>, known: &KnownOfFinger, felt: &ReadForce) -> Vec<Concluded> {
    tried.retain(|tried| is_possible(problem, tried));
    tried.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let Some(least) = tried.first().map(|tried| tried.cost) else { return Vec::new() };
    let listed = leads(&distinct(tried, least + GATE), usize::MAX).into_iter();
    let concluded = |tried: Tried| {
        let freedom = degrees_of_freedom(problem, &tried, known, felt);
        Some(Concluded {
            cost: tried.cost,
            cost_max: misfit_limit(freedom, f64::INFINITY) - felt.before.0,
            guess: tried.guess,
            end: tried.path.end,
            found: hypothesis(problem, &tried, known, felt)?,
        })
    };
    listed.filter_map(concluded).collect()
}

/// The list of what cannot be excluded.
fn conclude(mut concluded: Vec<Concluded>, part: &Part, symmetry: usize) -> Vec<ForceHypothesis> {
    concluded.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let Some(least) = concluded.first().filter(|best| best.cost <= best.cost_max).map(|best| best.cost) else {
        return Vec::new();
    };
    let mut listed: Vec<Concluded> = Vec::new();
    for next in concluded.into_iter().take_while(|next| next.cost <= least + GATE) {
        if !listed.iter().any(|other| is_one_place(&other.guess, &other.end, &next.guess, &next.end)) {
            listed.push(next);
        }
    }
    let found = listed.into_iter().map(|Concluded { cost, found, .. }| ForceHypothesis {
        probability: found.probability * (-0.5 * (cost - least)).exp(),
        ..found
    });
    let mut hypotheses: Vec<_> = found.flat_map(|found| turned(found, part, symmetry)).collect();
    let total: f64 = hypotheses.iter().map(|hypothesis| hypothesis.probability).sum();
    hypotheses.iter_mut().for_each(|hypothesis| hypothesis.probability /= total);
    hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    hypotheses
}

fn degrees_of_freedom(problem: &Problem, tried: &Tried, known: &KnownOfFinger, felt: &ReadForce) -> usize {
    // Numbers with a prior add a term and a parameter.
    let free = [known.mass.is_none(), tried.path.slipped && known.mu_c.is_none()];
    let parameters = 2
        + if known.is_moving { 1 + usize::from(tried.guess.slide != 0.0) } else { 0 }
        + free.into_iter().filter(|free| *free).count();
    (problem.measured.data().len() + felt.before.1).saturating_sub(parameters)
}

fn hypothesis(problem: &Problem, tried: &Tried, known: &KnownOfFinger, felt: &ReadForce) -> Option<ForceHypothesis> {
    let Tried { guess, path, mass, cost, .. } = tried;
    let slipped = path.slipped.then_some(guess.mu_c);
    // The disk is where the finger's bending takes it.
    let bent = |time: f64, pose: &Isometry2<f64>| -> Pose {
        let force = path.forces_in_finger_time(felt.period).at(time) * *mass;
        (Translation2::from(force * known.compliance) * pose).into()
    };
    Some(ForceHypothesis {
        edge: problem.course.part.edge_at(guess.edge, path.end.s),
        start: State { u: guess.u, s: guess.s, omega: guess.omega, v_t: 0.0 },
        end: path.end,
        pose_start: bent(if known.is_moving { 0.0 } else { -1.0 }, &problem.course.pose_at_start(guess)?),
        pose_end: bent(problem.course.duration, &problem.course.pose_at_end(guess, path)?),
        velocity_end: problem.course.velocity_at_end(guess, path)?,
        covariance: problem.motion_covariance(tried)?,
        mass: *mass,
        mu_c: known.mu_c.or(slipped),
        mu_g: problem.course.mu_g_of(guess),
        effective_mass: known.effective_mass + known.effective_mass_sd * problem.taken_beside(tried),
        cost: cost + felt.before.0,
        degrees_of_freedom: degrees_of_freedom(problem, tried, known, felt),
        probability: problem.spread(tried)?,
    })
}

/// The same on every turn of the part that nobody can tell apart.
fn turned(found: ForceHypothesis, part: &Part, symmetry: usize) -> Vec<ForceHypothesis> {
    let sides: Vec<_> = part.sides().collect();
    let Some(place) = sides.iter().position(|(side, _)| *side == part.side(found.edge)) else { return vec![found] };
    let normal = |place: usize| sides[place % sides.len()].1.normal;
    let turn = |shift: usize| {
        let to = (place + shift * sides.len() / symmetry) % sides.len();
        let angle = nalgebra::Rotation2::rotation_between(&normal(to), &normal(place));
        // About the centre of mass, of the part first.
        let centre = part.centre_of_mass();
        let moved = |pose: &Pose| -> Pose {
            let world = pose.isometry();
            let rotation = nalgebra::UnitComplex::from(angle);
            let about = nalgebra::Isometry2::from_parts((centre - rotation * centre).into(), rotation);
            (world * about).into()
        };
        let edge = part.edge_at(sides[to].0, found.end.s);
        let covariance = turned_covariance(&found, &moved(&found.pose_end), part);
        ForceHypothesis {
            edge,
            pose_start: moved(&found.pose_start),
            pose_end: moved(&found.pose_end),
            covariance,
            ..found.clone()
        }
    };
    (0..symmetry).map(turn).collect()
}

/// The covariance about another pose of the frame: that of the centre of mass is the same.
fn turned_covariance(found: &ForceHypothesis, to: &Pose, part: &Part) -> Matrix6<f64> {
    let arm = |pose: &Pose| pose.isometry().rotation * part.centre_of_mass().coords;
    let change = arm(&found.pose_end) - arm(to);
    // x_frame = x_centre − arm, and an arm turns by θ: the difference of the arms adds.
    let mut by = Matrix6::identity();
    (by[(0, 2)], by[(1, 2)]) = (-change.y, change.x);
    by * found.covariance * by.transpose()
}

#[cfg(test)]
mod tests;
