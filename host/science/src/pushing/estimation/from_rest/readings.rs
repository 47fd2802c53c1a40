//! Pose and motion of a part that a carried finger begins to push, from each reading of its force sensor.
//!
//! The sensor sits between the robot and the finger. What it reads is the force of the contact on the disk less what the
//! finger's own effective mass takes, −m a. The motion and the readings share one clock, so that the moment of the onset
//! is known: it is when the finger begins to move. Unknown may be the part's mass, µ_c, and, each with a prior, µ of the
//! plane, the finger's effective mass, and of the part its outline, where its mass is and where it presses ([`PartErrors`]).
//!
//! The search is that of [`super`]; readings take the place of windows. Effective mass and what is not
//! known of the part are numbers of which the force is a linear function, nearly: they are found in closed form for every
//! guess (`felt`), the search itself being done with the part as told and noise that is larger by what they may change.
//!
//! The motion is told, or measured by a clock of its own: then the clock's offset is sought too, and what the places leave
//! open of the motion is part of the covariance.
//!
//! Assumes: white noise; bending that moves the disk, but adds nothing to its speed. Frames: world axes. Units: SI.
//! Errors: none. "No pose explains the readings" and "several do" are answers.

mod follower;
mod measured;
mod read_force;
mod sensed;
mod tracker;

use std::f64::consts::TAU;
use std::ops::AddAssign as _;

pub use follower::{MotionClock, PushFollower};
use measured::PathNumbers;
pub use measured::{MeasuredEstimate, MeasuredFinger, estimate_measured_until};
use nalgebra::{Isometry2, Matrix2, Matrix3, Matrix6, Translation2, UnitComplex, Vector2, Vector6};
pub use sensed::{SensedPush, sensed};
pub use tracker::{ForceTracker, Found, SearchTask, TrackedHypothesis, TrackerState};

use read_force::{Doubts, ReadForce};

use super::end::{BELIEF, EndCovariance, Reach};
use super::fit::{Around, Problem, Tried};
use super::friction_along::FrictionAlong;
use super::numbers::{MotionNumbers, NUMBERED_LEADS, NumberedMinimum, Unknown};
use super::part_errors::PartErrors;
use super::path::{Course, CourseStart, Guess, Resolution};
use super::samples::{EVIDENCE_LOG_SD, samples_of};
use super::windowed_force::place_covariance;
use super::{GATE, WALKED_MAX, is_one_place, is_possible, leads, leads_of_edges, misfit_limit, search, symmetry};
use crate::geometry::Pose;
use crate::math::unscented::Gaussian;
use crate::pushing::dynamics::{ContactMode, FingerShape, Part, State};
use crate::pushing::estimation::hypotheses::{self, apart_squared, normalise, valleys};
use crate::pushing::finger_motion::{FingerMotion, Leg};
use crate::search::{Halt, Searched, Stop, never};

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
    /// What is not known of it; none where all is.
    pub errors: Option<PartErrors>,
    /// The part's mass, kg, where it is known.
    pub mass: Option<f64>,
    /// µ g of the plane, m/s².
    pub mu_g: f64,
    /// Standard deviation of ln(µ g); none where it is known.
    pub mu_g_log_sd: Option<f64>,
    /// µ_c, where it is known: where it wanders along an edge, its mean.
    pub mu_c: Option<f64>,
    /// Standard deviation of ln µ_c along an edge, from one place to others 5 mm away and more; 0 where it is the same everywhere.
    pub mu_c_wander_log_sd: f64,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Its outline where it is no disk.
    pub shape: Option<FingerShape>,
    /// Of the finger, as the sensor feels it accelerate, kg.
    pub effective_mass: f64,
    /// Standard deviation of that, kg.
    pub effective_mass_sd: f64,
    /// Whether the finger pushes the part when the first reading is taken; otherwise both are at rest until it moves.
    pub is_moving: bool,
    /// How far the disk gives way to a force on it, m/N.
    pub compliance: f64,
    /// Its standard deviation, m/N.
    pub compliance_sd: f64,
    /// Standard deviation of each coordinate of where the disk is on its robot, m.
    pub place_sd: f64,
    /// How the finger moves, from rest.
    pub motion: &'p FingerMotion,
    /// Standard deviation of one reading, each axis, N.
    pub noise: f64,
}

impl<'p> KnownOfFinger<'p> {
    /// A part at rest of unknown mass and µ_c, and a stiff finger without a mass of its own: the rest is to be filled in.
    #[must_use]
    pub const fn new(part: &'p Part, mu_g: f64, radius: f64, motion: &'p FingerMotion, noise: f64) -> Self {
        Self {
            part,
            errors: None,
            mass: None,
            mu_g,
            mu_g_log_sd: None,
            mu_c: None,
            mu_c_wander_log_sd: 0.0,
            radius,
            shape: None,
            effective_mass: 0.0,
            effective_mass_sd: 0.0,
            is_moving: false,
            compliance: 0.0,
            compliance_sd: 0.0,
            place_sd: 0.0,
            motion,
            noise,
        }
    }
}

impl KnownOfFinger<'_> {
    /// What is not known of where the disk is under a force (N), m².
    fn place_covariance(&self, force: Vector2<f64>) -> Matrix2<f64> {
        place_covariance(self.place_sd, self.compliance_sd, force)
    }

    /// Whether more is unknown than a search finds: numbers of the part, or of the friction along its edges.
    fn has_numbers(&self) -> bool {
        self.errors.is_some() || self.mu_c_wander_log_sd > 0.0
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
    /// Of `pose_end` (x, y, theta), that velocity, and ω; of a continuum for the one place that stands for all.
    pub covariance: Matrix6<f64>,
    /// Whether it is one of a continuum: other places round a disk, or along a straight finger, explain all the same.
    pub is_continuum: bool,
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
    let push = FeltPush::new(known, readings, None)?;
    let followed = push.followed(push.guess(from)?, true, &Halt::new(&never))?;
    Some((followed.found, followed.cost_max + push.felt.before().0))
}

fn halting_estimate(known: &KnownOfFinger, readings: &[ForceReading], halt: &Halt<'_>) -> Vec<ForceHypothesis> {
    let Some(push) = FeltPush::new(known, readings, None) else { return Vec::new() };
    conclude(push.all(true, halt), known, symmetry::order(known.part))
}

/// The edges of which no two look the same, and how many turns take the part to itself.
fn distinct_edges(part: &Part) -> (Vec<usize>, usize) {
    let symmetry = symmetry::order(part);
    (symmetry::distinct(part, symmetry), symmetry)
}

/// A push as it was felt, of a finger that is taken to move so.
struct FeltPush<'a, 'p> {
    known: &'a KnownOfFinger<'p>,
    course: Course<'p>,
    /// With what outline and motion may change as noise: for the search.
    roughly: ReadForce,
    felt: ReadForce,
    path: Option<PathNumbers<'a>>,
}

impl<'a, 'p> FeltPush<'a, 'p> {
    /// None without readings of the push.
    fn new(known: &'a KnownOfFinger<'p>, readings: &[ForceReading], path: Option<PathNumbers<'a>>) -> Option<Self> {
        let first = readings.first()?;
        let (start, from) = if known.is_moving { (CourseStart::Moving, first.time) } else { (CourseStart::Rest, 0.0) };
        let legs = match &path {
            Some(path) => path.legs(&path.taken_for())?,
            None => legs_since(known.motion.legs(known.radius), from),
        };
        let readings: Vec<_> = readings.iter().map(|it| ForceReading { time: it.time - from, ..*it }).collect();
        let end = readings.last().map(|reading| reading.time).filter(|end| *end > 0.0)?;
        let of_part = known.errors.map_or(0.0, |errors| errors.share(known.part));
        let of_part = of_part.hypot(WANDER_SHARE * known.mu_c_wander_log_sd);
        let roughly = path.as_ref().map_or(Doubts::none(), |path| path.doubts_of_all(from)).and_share(of_part);
        let (drift, fast) = known.errors.map_or((0.0, 0.0), |errors| (errors.left_share(), errors.fast_share()));
        let doubts = path.as_ref().map_or(Doubts::none(), |path| path.doubts_of_rest(from));
        let doubts = doubts.and_share(fast).and_drift(drift);
        let roughly = ReadForce::new(known, &legs, &readings, &roughly)?;
        let felt = ReadForce::new(known, &legs, &readings, &doubts)?;
        let course = Course {
            part: known.part,
            shape: known.shape,
            symmetry: symmetry::order(known.part),
            mu_g: known.mu_g,
            mu_g_log_sd: known.mu_g_log_sd,
            mu_c: known.mu_c,
            friction_along: FrictionAlong::default(),
            changed: &[],
            off: &[],
            start,
            legs,
            duration: end,
            resolution: Resolution::Fine,
        };
        Some(Self { known, course, roughly, felt, path })
    }

    /// Whether more is found than a search finds, which takes it for noise: numbers of part, friction or motion.
    fn has_numbers(&self) -> bool {
        self.known.has_numbers() || self.path.is_some()
    }

    /// Every minimum found; whether it is looked how far each reaches: who follows the push sees that.
    fn all(&self, looks: bool, halt: &Halt<'_>) -> Vec<Concluded> {
        let (edges, _) = distinct_edges(self.known.part);
        let Leads { followed, all } = self.leads(&edges, usize::MAX, halt);
        let found = |thoroughly: bool| {
            let minima = halt.each(followed.iter().collect(), |(_, lead)| self.minimum(*lead, thoroughly, halt));
            within_gate(minima.into_iter().flatten().collect(), Minimum::place)
        };
        let mut minima = found(false);
        if minima.is_empty() && self.known.has_numbers() {
            minima = found(true);
        }
        // Only what is listed is worth a walk.
        let is_walked = minima.len() <= WALKED_MAX;
        let of_edge = |edge: usize| minima.iter().filter(|minimum| minimum.found.tried().guess.edge == edge).count();
        let samples = |edge: usize| if looks { samples_of(of_edge(edge)) } else { 0 };
        let reach = |minimum: &Minimum| Looked {
            is_walked: is_walked && looks,
            leads: &all,
            samples: samples(minimum.found.tried().guess.edge),
        };
        let concluded =
            halt.every(minima.iter().collect(), |minimum| self.concluded(&minimum.found, &reach(minimum), halt));
        concluded.into_iter().flatten().collect()
    }

    /// Where the search comes to, the best first; where numbers are found later, those of every edge in turn.
    fn leads(&self, edges: &[usize], most: usize, halt: &Halt<'_>) -> Leads {
        let problem = Problem { course: &self.course, measured: &self.roughly, mass: self.known.mass };
        let mut tried = search(&problem, edges, halt);
        // Where the finger cannot be, it leads nowhere.
        tried.retain(|tried| is_possible(&problem, tried));
        let priced = |lead: Tried| (lead.cost, lead.guess);
        let all: Vec<_> = leads_of_edges(&problem, &tried, usize::MAX).into_iter().map(priced).collect();
        let followed = if self.has_numbers() {
            all.iter().copied().take(most.min(NUMBERED_LEADS)).collect()
        } else {
            leads(&tried, most).into_iter().map(priced).collect()
        };
        Leads { followed, all: all.into_iter().map(|(_, guess)| guess).collect() }
    }

    /// As a guess; none of an edge that the part has not.
    fn guess(&self, from: &Beginning) -> Option<Guess> {
        let model = self.course.first_model(from.edge)?;
        let State { u, s, omega, v_t } = model.sought(&from.state);
        let at_rest = Guess { edge: from.edge, u, s, mu_c: from.mu_c, ..Guess::AT_REST };
        if !self.known.is_moving {
            return Some(at_rest);
        }
        let rolling = model.rolling_v_t(-self.course.legs[0].from, &State { u, s, omega, v_t });
        Some(Guess { omega, slide: if from.is_rolling { 0.0 } else { v_t - rolling }, ..at_rest })
    }

    /// The minimum that a guess leads to, with all that is unknown.
    fn followed(&self, guess: Guess, is_walked: bool, halt: &Halt<'_>) -> Option<Concluded> {
        self.concluded(&self.minimum(guess, true, halt)?.found, &Looked { is_walked, ..Looked::ALONE }, halt)
    }

    /// What is at the same place as one that slipped and never did, where that is as possible; the search tells them apart no
    /// more than their poses, but what comes next does. Its probability is relative to that of the best.
    fn rolled_as_well(&self, slipped: &Concluded, best: &Concluded, halt: &Halt<'_>) -> Option<Concluded> {
        if !slipped.at_end.slipped || self.known.mu_c.is_some() || slipped.guess.slide != 0.0 {
            return None;
        }
        let mut rolled = self.followed(Guess { mu_c: f64::INFINITY, ..slipped.guess }, false, halt)?;
        rolled.found.probability *= (-0.5 * (rolled.cost - best.cost)).exp();
        let is_near = is_one_place(&rolled.guess, &rolled.end, &slipped.guess, &slipped.end);
        (is_near && !rolled.at_end.slipped && rolled.cost <= rolled.cost_max.min(best.cost + GATE)).then_some(rolled)
    }

    /// The same before anything is said of it; none where the finger cannot be there.
    fn minimum(&self, guess: Guess, thoroughly: bool, halt: &Halt<'_>) -> Option<Minimum> {
        let found = if self.has_numbers() {
            let explains = |tried: &Tried| tried.cost <= self.cost_max(&self.problem(&self.course), tried);
            let unknown = self.unknown();
            Fitted::Numbered(unknown.found(guess, &self.felt, &self.roughly, explains, thoroughly, halt)?.into())
        } else {
            let problem = self.problem(&self.course);
            Fitted::Plain(problem.descend(problem.try_guess(guess)?, usize::MAX).into())
        };
        let cost_max = {
            let course = self.course_of(&found);
            let problem = self.problem(&course);
            is_possible(&problem, found.tried()).then(|| self.cost_max(&problem, found.tried()))?
        };
        Some(Minimum { found, cost_max })
    }

    /// What it says. How far it reaches is seen with numbers found too by what might have been felt instead, otherwise by a walk
    /// along its valley, if wished.
    fn concluded(&self, found: &Fitted, looked: &Looked<'_>, halt: &Halt<'_>) -> Option<Concluded> {
        let Fitted::Numbered(numbered) = found else {
            return self.told(found, if looked.is_walked { Reach::Valley(halt) } else { Reach::Slopes });
        };
        let Looked { leads, samples, .. } = *looked;
        let mut sampled = self.unknown().sampled(numbered, &self.felt, leads, samples, halt);
        let lower = sampled.lower.take().map(|lower| Fitted::Numbered(lower.into()));
        self.told(lower.as_ref().unwrap_or(found), Reach::Sampled(&sampled))
    }

    /// What a minimum says, how far it reaches being seen so.
    fn told(&self, found: &Fitted, reach: Reach<'_>) -> Option<Concluded> {
        let course = self.course_of(found);
        let (problem, tried) = (self.problem(&course), found.tried());
        let around = problem.around(tried);
        Some(Concluded {
            cost: tried.cost,
            cost_max: self.cost_max(&problem, tried),
            guess: tried.guess,
            end: tried.path.end,
            found: hypothesis(&problem, &around, self.known, &self.felt, reach)?,
            at_end: AtEnd::of(&problem, &around, self.known, f64::INFINITY)?,
        })
    }

    /// With such numbers of part and motion.
    fn course_of<'c>(&'c self, found: &'c Fitted) -> Course<'c> {
        match found {
            Fitted::Plain(_) => self.course.clone(),
            Fitted::Numbered(found) => found.numbered.course(&self.course),
        }
    }

    fn problem<'c, 'q>(&'c self, course: &'c Course<'q>) -> Problem<'c, 'q> {
        Problem { course, measured: &self.felt, mass: self.known.mass }
    }

    /// What an explanation may cost after the onset.
    fn cost_max(&self, problem: &Problem, tried: &Tried) -> f64 {
        cost_max(degrees_of_freedom(problem, tried, self.known, &self.felt), &self.felt)
    }
}

impl<'p> FeltPush<'_, 'p> {
    fn unknown(&self) -> Unknown<'_, 'p> {
        Unknown {
            course: &self.course,
            mass: self.known.mass,
            errors: self.known.errors,
            motion: self.path.as_ref().map(|path| path as &dyn MotionNumbers),
            mu_c_wander_log_sd: self.known.mu_c_wander_log_sd,
        }
    }
}

/// What an explanation of so many degrees of freedom may cost after the onset.
fn cost_max(freedom: usize, felt: &ReadForce) -> f64 {
    misfit_limit(freedom, f64::INFINITY) - felt.before().0
}

/// A minimum along which the contact angle is told poorly is looked at this far apart, in standard deviations of the pieces
/// that stand for it: their sum is then smooth.
const PIECES_APART: f64 = 1.2;

/// Pieces to each side at the most.
const PIECES_MAX: usize = 30;

/// Steps of the fit of a piece, which begins beside one.
const PIECE_STEPS: usize = 6;

impl FeltPush<'_, '_> {
    /// A minimum in pieces along its valley, each of a contact angle at the start within `u_sd` (rad), with its share of the
    /// minimum's weight: everything else is found anew for each. None where its numbers are not those of a search.
    fn pieces(&self, of: &Concluded, u_sd: f64) -> Option<Vec<(f64, AtEnd)>> {
        if self.has_numbers() {
            return None;
        }
        let problem = Problem { course: &self.course, measured: &self.felt, mass: self.known.mass };
        let middle = problem.try_guess(of.guess)?;
        let apart = PIECES_APART * u_sd;
        // What as many pieces of a straight valley add up to is the minimum's own weight.
        let unit = apart / (u_sd * TAU.sqrt() * problem.spread(&problem.around(&middle))?);
        let piece = |tried: &Tried| {
            let around = problem.around(tried);
            let weight = unit * problem.spread_near(&around, u_sd)? * (0.5 * (middle.cost - tried.cost)).exp();
            Some((weight, AtEnd::of(&problem, &around, self.known, u_sd)?))
        };
        let mut pieces = vec![piece(&middle)?];
        for way in [apart, -apart] {
            let mut last = middle.clone();
            for _ in 0..PIECES_MAX {
                let beside = Guess { u: last.guess.u + way, ..last.guess };
                let Some(tried) = problem.try_guess(beside) else { break };
                let tried = problem.fitted_beside(0, tried, PIECE_STEPS);
                if tried.cost > middle.cost + GATE {
                    break;
                }
                pieces.extend(is_possible(&problem, &tried).then(|| piece(&tried)).flatten());
                last = tried;
            }
        }
        Some(pieces)
    }
}

/// The legs of a motion in time since a moment, the first being under way then.
fn legs_since(legs: impl Iterator<Item = Leg>, from: f64) -> Vec<Leg> {
    let moved = legs.map(|leg| Leg { from: leg.from - from, to: leg.to - from, ..leg });
    moved.filter(|leg| leg.to > 0.0).collect()
}

/// What a µ_c that wanders changes of the force, as a share of its logarithm: twice that of its tangential part, at a third of
/// the normal one, as the part then turns otherwise, too. With half of it a search misses one in twenty.
const WANDER_SHARE: f64 = 0.6;

/// How it is looked how far a minimum reaches.
struct Looked<'a> {
    /// Along its valley, where no numbers are found.
    is_walked: bool,
    /// Where else on its edge what is drawn again is fitted from.
    leads: &'a [Guess],
    /// How often it is drawn.
    samples: usize,
}

impl Looked<'_> {
    /// Of one that is the only one of its edge.
    const ALONE: Self = Self { is_walked: true, leads: &[], samples: samples_of(1) };
}

/// Where a search comes to.
struct Leads {
    /// What is worth a fit, with what it costs without what outline and motion take up.
    followed: Vec<(f64, Guess)>,
    all: Vec<Guess>,
}

/// What a fit came to.
enum Fitted {
    /// All numbers are as they are told.
    Plain(Box<Tried>),
    Numbered(Box<NumberedMinimum>),
}

impl Fitted {
    fn tried(&self) -> &Tried {
        match self {
            Self::Plain(tried) => tried,
            Self::Numbered(found) => &found.tried,
        }
    }

    /// How many standard deviations each number is off.
    fn taken(&self) -> &[f64] {
        match self {
            Self::Plain(_) => &[],
            Self::Numbered(found) => &found.taken,
        }
    }
}

/// A minimum, before anything is said of it.
struct Minimum {
    found: Fitted,
    cost_max: f64,
}

impl Minimum {
    fn place(&self) -> MinimumPlace<'_> {
        let tried = self.found.tried();
        MinimumPlace { cost: tried.cost, cost_max: self.cost_max, guess: &tried.guess, end: &tried.path.end }
    }
}

/// By what minima are told apart.
struct MinimumPlace<'a> {
    cost: f64,
    cost_max: f64,
    guess: &'a Guess,
    end: &'a State,
}

/// A minimum that may be listed.
struct Concluded {
    /// Of the readings after the onset.
    cost: f64,
    cost_max: f64,
    guess: Guess,
    end: State,
    found: ForceHypothesis,
    /// Where one goes on from who follows the push.
    at_end: AtEnd,
}

/// A push at the last reading.
#[derive(Clone, Copy, Debug)]
struct AtEnd {
    belief: Gaussian<BELIEF>,
    contact: ContactMode,
    /// Whether the contact has slipped at any time.
    slipped: bool,
    /// The friction that rolling has taken.
    friction_needed: f64,
}

impl AtEnd {
    /// For the contact angle at the start within so much of what it is there, rad.
    fn of(problem: &Problem, around: &Around, known: &KnownOfFinger, u_sd: f64) -> Option<Self> {
        let tried = around.at;
        Some(Self {
            belief: problem.belief_at_end(around, known.effective_mass_sd, u_sd)?,
            contact: tried.path.contact,
            slipped: tried.path.slipped,
            friction_needed: tried.path.friction_needed,
        })
    }
}

/// The list of what cannot be excluded.
fn conclude(concluded: Vec<Concluded>, known: &KnownOfFinger, symmetry: usize) -> Vec<ForceHypothesis> {
    let found = listed(concluded).into_iter().map(|concluded| concluded.found);
    let found: Vec<_> = found.collect();
    let (alike, evidence_log_sd) = if known.has_numbers() { (SAMPLED_ALIKE, EVIDENCE_LOG_SD) } else { (0.0, 0.0) };
    // Minima that overlap are of one valley: the likeliest stands for all of it.
    let valleys = valleys(found, ForceHypothesis::apart, |_, _| false, |of| &mut of.probability);
    let found = valleys.into_iter().filter_map(|valley| ForceHypothesis::of_valley(&valley, alike));
    let mut hypotheses: Vec<_> = found.flat_map(|found| turned(found, known.part, symmetry)).collect();
    normalise(&mut hypotheses, evidence_log_sd, |of| &mut of.probability);
    hypotheses.sort_by(|a, b| b.probability.total_cmp(&a.probability));
    hypotheses
}

/// Of a valley that numbers of the part leave flat and bent, minima are samples: half of what stands for it counts each alike.
const SAMPLED_ALIKE: f64 = 0.5;

impl ForceHypothesis {
    fn of_pose(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// How far it is from another of the same edge: see [`apart_squared`].
    fn apart(&self, other: &Self) -> Option<f64> {
        let is_one_edge = self.edge == other.edge && !self.is_continuum;
        let (own, others) = (self.of_pose(), other.of_pose());
        is_one_edge.then(|| apart_squared((&self.pose_end, &own), (&other.pose_end, &others))).flatten()
    }

    /// The likeliest of a valley's minima, covering all of them: what they are together by their probabilities, and for a
    /// share as places of a valley that is as likely everywhere.
    fn of_valley(minima: &[Self], alike: f64) -> Option<Self> {
        let best = minima.iter().max_by(|a, b| a.probability.total_cmp(&b.probability))?;
        let probability: f64 = minima.iter().map(|minimum| minimum.probability).sum();
        let covariance = minima
            .iter()
            .map(|minimum| {
                let pose = minimum.pose_end.minus(&best.pose_end);
                let (velocity, omega) = (minimum.velocity_end - best.velocity_end, minimum.end.omega - best.end.omega);
                let off = Vector6::new(pose.x, pose.y, pose.z, velocity.x, velocity.y, omega);
                let weight = (1.0 - alike) * minimum.probability / probability + alike / minima.len() as f64;
                (minimum.covariance + off * off.transpose()) * weight
            })
            .sum();
        Some(Self { probability, covariance, ..best.clone() })
    }
}

/// What explains the readings, each place once, its probability being what it is relative to the others.
fn listed(concluded: Vec<Concluded>) -> Vec<Concluded> {
    let mut listed = within_gate(concluded, |it| MinimumPlace {
        cost: it.cost,
        cost_max: it.cost_max,
        guess: &it.guess,
        end: &it.end,
    });
    let least = listed.first().map_or(0.0, |best| best.cost);
    listed.iter_mut().for_each(|next| next.found.probability *= (-0.5 * (next.cost - least)).exp());
    listed
}

/// What explains the readings, each place once, the best first; nothing where the best does not.
fn within_gate<T>(minima: Vec<T>, place: impl Fn(&T) -> MinimumPlace<'_>) -> Vec<T> {
    let near = near_best(minima, &place);
    let is_explained = near.first().map(&place).is_some_and(|best| best.cost <= best.cost_max);
    if is_explained { near } else { Vec::new() }
}

/// What costs little more than the best, each place once, that first.
fn near_best<T>(mut minima: Vec<T>, place: impl Fn(&T) -> MinimumPlace<'_>) -> Vec<T> {
    minima.sort_by(|a, b| place(a).cost.total_cmp(&place(b).cost));
    let least = minima.first().map_or(0.0, |best| place(best).cost);
    let mut within: Vec<T> = Vec::new();
    for next in minima {
        let here = place(&next);
        let is_known = |other: &T| is_one_place(place(other).guess, place(other).end, here.guess, here.end);
        if here.cost <= least + GATE && !within.iter().any(is_known) {
            within.push(next);
        }
    }
    within
}

fn degrees_of_freedom(problem: &Problem, tried: &Tried, known: &KnownOfFinger, felt: &ReadForce) -> usize {
    // Numbers with a prior add a term and a parameter.
    let free = [known.mass.is_none(), tried.path.slipped && known.mu_c.is_none()];
    let parameters = 2
        + if known.is_moving { 1 + usize::from(tried.guess.slide != 0.0) } else { 0 }
        + free.into_iter().filter(|free| *free).count();
    (problem.measured.data().len() + felt.before().1).saturating_sub(parameters)
}

fn hypothesis(
    problem: &Problem,
    around: &Around,
    known: &KnownOfFinger,
    felt: &ReadForce,
    reach: Reach<'_>,
) -> Option<ForceHypothesis> {
    let tried = around.at;
    let Tried { guess, path, mass, cost, .. } = tried;
    let slipped = path.slipped.then_some(guess.mu_c);
    // The disk is where the finger's bending takes it.
    let bent = |time: f64, pose: &Isometry2<f64>| -> Pose {
        let force = path.forces_in_finger_time(felt.period()).at(time) * *mass;
        (Translation2::from(force * known.compliance) * pose).into()
    };
    let EndCovariance { motion: mut covariance, sampled_volume, .. } = problem.end_covariance(around, reach)?;
    let last = path.forces_in_finger_time(felt.period()).at(problem.course.duration) * *mass;
    covariance.fixed_view_mut::<2, 2>(0, 0).add_assign(&known.place_covariance(last));
    Some(ForceHypothesis {
        edge: problem.course.part.edge_at(guess.edge, path.end.s),
        start: problem.course.told(guess.edge, &State { u: guess.u, s: guess.s, omega: guess.omega, v_t: 0.0 }),
        end: problem.course.told(guess.edge, &path.end),
        pose_start: bent(if known.is_moving { 0.0 } else { -1.0 }, &problem.course.pose_at_start(guess)?),
        pose_end: bent(problem.course.duration, &problem.course.pose_at_end(guess, path)?),
        velocity_end: problem.course.velocity_at_end(guess, path)?,
        covariance,
        is_continuum: problem.course.is_continuum(),
        mass: *mass,
        mu_c: known.mu_c.or(slipped),
        mu_g: problem.course.mu_g_of(guess),
        effective_mass: known.effective_mass + known.effective_mass_sd * problem.taken_beside(tried),
        cost: cost + felt.before().0,
        degrees_of_freedom: degrees_of_freedom(problem, tried, known, felt),
        // Of the ellipsoid about a valley that bends a part is empty: between that and what slopes say is the geometric mean.
        probability: problem.evidence(around)? * sampled_volume.sqrt(),
    })
}

/// The same on every turn of the part that nobody can tell apart.
fn turned(found: ForceHypothesis, part: &Part, symmetry: usize) -> Vec<ForceHypothesis> {
    let turned = |(edge, about): (usize, Isometry2<f64>)| {
        let moved = |pose: &Pose| -> Pose { (pose.isometry() * about).into() };
        let pose_end = moved(&found.pose_end);
        let covariance = turned_covariance(&found.covariance, &found.pose_end, &pose_end, part);
        ForceHypothesis { edge, pose_start: moved(&found.pose_start), pose_end, covariance, ..found.clone() }
    };
    turns(part, found.edge, found.end.s, symmetry).into_iter().map(turned).collect()
}

/// The edges (or turns of an ellipse) that look like one, and how a part turned to touch there instead lies in its own frame as it was.
fn turns(part: &Part, edge: usize, s: f64, symmetry: usize) -> Vec<(usize, Isometry2<f64>)> {
    if part.semi_axes().is_some() {
        let count = if symmetry == symmetry::ROUND { 1 } else { symmetry };
        let turn = |shift: usize| UnitComplex::new(TAU * shift as f64 / count as f64);
        return (0..count).map(|shift| (edge, turned_about(part, turn(shift)))).collect();
    }
    let sides: Vec<_> = part.sides().collect();
    let Some(place) = sides.iter().position(|(side, _)| *side == part.side(edge)) else {
        return vec![(edge, Isometry2::identity())];
    };
    let normal = |place: usize| sides[place % sides.len()].1.normal;
    let turn = |shift: usize| {
        let to = (place + shift * sides.len() / symmetry) % sides.len();
        let rotation = UnitComplex::rotation_between(&normal(to), &normal(place));
        (part.edge_at(sides[to].0, s), turned_about(part, rotation))
    };
    (0..symmetry).map(turn).collect()
}

/// A turn about the centre of mass.
fn turned_about(part: &Part, rotation: UnitComplex<f64>) -> Isometry2<f64> {
    let centre = part.centre_of_mass();
    Isometry2::from_parts((centre - rotation * centre).into(), rotation)
}

/// The covariance about another pose of the frame: that of the centre of mass is the same.
fn turned_covariance(covariance: &Matrix6<f64>, from: &Pose, to: &Pose, part: &Part) -> Matrix6<f64> {
    let arm = |pose: &Pose| pose.isometry().rotation * part.centre_of_mass().coords;
    let change = arm(from) - arm(to);
    // x_frame = x_centre − arm, and an arm turns by θ: the difference of the arms adds.
    let mut by = Matrix6::identity();
    (by[(0, 2)], by[(1, 2)]) = (-change.y, change.x);
    by * covariance * by.transpose()
}

#[cfg(test)]
mod tests;
