//! What the finger would feel: the force over a push from rest, for one guess of how it began.
//!
//! A simulation of its own because it is asked for means of a force under windows, thousands of times: forces on the
//! windows' grid, with a finger of many accelerations, but no derivatives (by differences of whole paths) and no
//! positions in between. Shared with the others who follow a push are the equations, the start, the rule which mode
//! follows and the search for its instant ([`crate::pushing::dynamics::contact_mode`],
//! [`crate::pushing::dynamics::mode_change`]).
//!
//! Coulomb's law decides between rolling and sliding; where that changes, the instant is found by bisection. Steps
//! follow the time in which friction forgets a slow part's speed, v/(µg), so that the first milliseconds cost no more
//! than the rest; where the finger nearly stops they are as short as its way turns. A force that jumps (where the finger's
//! acceleration does, or where sliding stops) is kept apart from its smooth course: sums over a coarse grid are then as good
//! as integrals.
//!
//! Assumes: the contact stays on its edge's line. Frames: finger axes; forces are those on the finger's disk, per unit
//! mass of the part. Units: SI. Errors: [`Lost`].

use std::cell::LazyCell;

use nalgebra::{Isometry2, Vector2};

use super::felt::NumberOff;
use super::friction_along::FrictionAlong;
use super::hann_windows;
use super::model::{PlayedModel, SettlingMotion};
use super::symmetry::ROUND;
use crate::pushing::dynamics::contact_mode::ContactFriction;
use crate::pushing::dynamics::mode_change::first_ended;
use crate::pushing::dynamics::{ContactForce, ContactMode, FingerShape, Motion, Part, PartSide, State};
use crate::pushing::finger_motion::Leg;

/// The start is followed in closed form for this long, s: a part turns by less than 1e-4 rad meanwhile, even at 10
/// rad/s².
const REST_S: f64 = 4e-3;

/// Longest step times the fastest rate at which the motion settles: the method of Runge and Kutta is stable up to 2.8, and
/// at 2 leaves a third of what has not settled.
/// Poses come out within a micrometre of an error-controlled integration; see the tests.
const STEP_OF_MEMORY: f64 = 2.0;

/// Where steps would be shorter than this, s, they are implicit and as long as the grid: of a part that hardly moves yet,
/// or nearly stops, what turns and slides settles meanwhile.
const STEP_STIFF_S: f64 = 1e-4;

/// An implicit step is halved over which the rate grows by more than this factor, the part coming to a stop: what it takes for the
/// rate leaves the force off by a hundredth where it grows threefold.
const GROWTH_MAX: f64 = 1.1;

/// The same of coarse steps, s: an implicit one costs as much as two explicit ones.
const STEP_STIFF_COARSE_S: f64 = 0.01;

/// A step in which the finger's way turns by more than this, rad, is shorter: friction turns with a part that follows, quickly
/// where the finger nearly stops.
const STEP_TURN_RAD: f64 = 0.05;

/// The same of coarse steps.
const STEP_TURN_COARSE_RAD: f64 = 0.3;

/// But no shorter than this for that, s.
const STEP_TURNING_S: f64 = 2e-4;

/// How exactly a change of the contact is found, as a share of a step: 25 ns of a step of 5 ms, so that forces are
/// smooth in the guess.
const CHANGE_SHARE: f64 = 5e-6;

/// A contact that is lost over a longer step than this, s, is followed over half of it: where sliding ends within, what comes
/// behind its end is not the part's way.
const LOST_S: f64 = 1e-3;

/// Changes between rolling and sliding after which a guess is given up.
const CHANGES_MAX: usize = 100;

/// Times nearer than this are one, s.
const SAME_TIME_S: f64 = 1e-9;

/// How a push may have begun.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Guess {
    /// The edge that the finger touches.
    pub(super) edge: usize,
    /// Contact angle at the start, rad.
    pub(super) u: f64,
    /// Contact on the edge at the start, m.
    pub(super) s: f64,
    /// µ_c; infinite for a contact that never slips.
    pub(super) mu_c: f64,
    /// ln of the plane's µ g over what it is taken for.
    pub(super) mu_g_log: f64,
    /// How much later the push began than it was taken to, s.
    pub(super) delay: f64,
    /// Angular velocity at the start of a part that moves, rad/s.
    pub(super) omega: f64,
    /// By how much v_T then is off that of a part that rolls, m/s; 0 for one that rolls.
    pub(super) slide: f64,
}

impl Guess {
    /// A part at rest, µ g and the onset being what they are taken for; the rest is to be filled in.
    pub(super) const AT_REST: Self =
        Self { edge: 0, u: 0.0, s: 0.0, mu_c: f64::INFINITY, mu_g_log: 0.0, delay: 0.0, omega: 0.0, slide: 0.0 };
}

/// How closely a push is followed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Resolution {
    /// Steps of the windows' grid: poses come out within a micrometre.
    Fine,
    /// Steps of a window's hop, implicit ones wherever what turns and slides settles within: forces come out within three
    /// thousandths, three times as quickly. When the contact changes within a step is read off a cubic. For a first look.
    Coarse,
}

impl Resolution {
    /// Periods of the windows' grid to a step, at the most.
    fn stride(self) -> usize {
        match self {
            Self::Fine => 1,
            Self::Coarse => hann_windows::GRID_HOP,
        }
    }

    /// Where explicit steps would be shorter than this, s, they are implicit.
    fn stiff_s(self) -> f64 {
        match self {
            Self::Fine => STEP_STIFF_S,
            Self::Coarse => STEP_STIFF_COARSE_S,
        }
    }

    /// By how much the rate at which the motion settles may grow in an implicit step.
    fn growth(self) -> f64 {
        match self {
            Self::Fine => GROWTH_MAX,
            Self::Coarse => f64::INFINITY,
        }
    }

    /// The most by which the finger's way may turn in a step, rad.
    fn turn_rad(self) -> f64 {
        match self {
            Self::Fine => STEP_TURN_RAD,
            Self::Coarse => STEP_TURN_COARSE_RAD,
        }
    }
}

/// How the part is at the start.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum CourseStart {
    /// At rest, as the finger.
    Rest,
    /// Pushed by the finger.
    Moving,
}

/// A guess played through.
#[derive(Clone, Debug)]
pub(super) struct Path {
    /// Smooth part of the force at each [`hann_windows::GRID_S`], from 0 on, m/s².
    smooth: Vec<Vector2<f64>>,
    /// The onset first.
    jumps: Vec<Jump>,
    /// The force where it was computed, in order of time, s and m/s²: each grid point, and before and after each jump.
    knots: Vec<(f64, Vector2<f64>)>,
    /// The state at the end.
    pub(super) end: State,
    /// The contact at the start.
    pub(super) contact_start: ContactMode,
    /// The contact at the end.
    pub(super) contact: ContactMode,
    /// Least and greatest place on the edge's line, m.
    pub(super) s_span: [f64; 2],
    /// Largest |tangential| over normal force while rolling: the friction that it takes.
    pub(super) friction_needed: f64,
    /// Whether the contact slipped at any time.
    pub(super) slipped: bool,
    /// What the contact did, one after the other.
    pub(super) course: ModeCourse,
}

/// A jump of the force.
#[derive(Clone, Copy, Debug)]
struct Jump {
    /// When it happens, s.
    time: f64,
    /// By how much, m/s².
    by: Vector2<f64>,
    cause: Cause,
}

/// What makes the force jump.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Cause {
    /// The finger's motion, which says when: the onset, and where its acceleration changes.
    Finger,
    /// The contact, which changes.
    Contact,
    /// None: the force turns within a step that is short beside the windows' grid.
    Turning,
}

/// The modes of a contact in their order, as digits of base 4, the last one lowest; of a long course the last sixteen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ModeCourse(u32);

impl ModeCourse {
    fn of(contact: &ContactMode) -> Self {
        Self(1 + Self::digit(contact))
    }

    fn digit(contact: &ContactMode) -> u32 {
        contact.signed_friction().map_or(0, |m| if m > 0.0 { 1 } else { 2 })
    }

    fn then(self, contact: &ContactMode) -> Self {
        let digit = 1 + Self::digit(contact);
        if self.0 % 4 == digit { self } else { Self(self.0.wrapping_mul(4).wrapping_add(digit)) }
    }
}

impl Path {
    /// When the contact changed, or the finger its acceleration, s.
    #[cfg(test)]
    pub(super) fn changes(&self) -> Vec<f64> {
        self.jumps.iter().skip(1).map(|jump| jump.time).collect()
    }

    /// Means of the force under the first `count` windows, m/s².
    pub(super) fn windows(&self, count: usize) -> impl Iterator<Item = Vector2<f64>> + '_ {
        (0..count).map(|window| {
            let jumped = self.jumps.iter().map(|jump| jump.by * hann_windows::share_after(window, jump.time));
            hann_windows::mean_of_grid(window, &self.smooth) + jumped.sum::<Vector2<f64>>()
        })
    }
}

impl Path {
    /// The force at times that are asked for in ascending order, its jumps spread over `spread`, s.
    pub(super) fn forces(&self, spread: f64) -> ForceReader<'_> {
        self.reader(spread, |cause| cause != Cause::Turning)
    }

    /// The same where times are those of the finger's motion: jumps of which that says when are not spread.
    pub(super) fn forces_in_finger_time(&self, spread: f64) -> ForceReader<'_> {
        self.reader(spread, |cause| cause == Cause::Contact)
    }

    fn reader(&self, spread: f64, is_spread: impl Fn(Cause) -> bool) -> ForceReader<'_> {
        let jumps = self.jumps.iter().filter(|jump| is_spread(jump.cause)).copied().collect();
        ForceReader::new(self, jumps, spread)
    }
}

/// Reads a path's force from its beginning to its end.
pub(super) struct ForceReader<'a> {
    path: &'a Path,
    /// Those that are spread.
    jumps: Vec<Jump>,
    spread: f64,
    /// The first knot after the time asked for last; knots at one time are before and after a jump.
    next: usize,
    /// The force up to there.
    piece: Piece,
    /// The first jump that is not over at the time asked for last.
    jump: usize,
}

/// The force between two knots: by Newton's polynomial through them and those next to them with no jump between.
#[derive(Clone, Copy)]
struct Piece {
    before: (f64, Vector2<f64>),
    after: f64,
    slope: Vector2<f64>,
    /// Half of the second derivative.
    bend: Vector2<f64>,
    /// Where that is so, s, and a sixth of the third.
    twist: (f64, Vector2<f64>),
}

impl Piece {
    /// Up to a knot; the last force after the last.
    fn up_to(knots: &[(f64, Vector2<f64>)], next: usize) -> Self {
        let zero = Vector2::zeros();
        let before = knots[next - 1];
        let Some(&after) = knots.get(next) else {
            return Self { before, after: f64::MAX, slope: zero, bend: zero, twist: (0.0, zero) };
        };
        let steep = |a: (f64, Vector2<f64>), b: (f64, Vector2<f64>)| (b.1 - a.1) / (b.0 - a.0);
        let slope = steep(before, after);
        let further = knots.get(next + 1).filter(|further| further.0 > after.0);
        let earlier = next.checked_sub(2).map(|index| knots[index]).filter(|earlier| earlier.0 < before.0);
        let after_bend = further.map(|&further| (further.0, (steep(after, further) - slope) / (further.0 - before.0)));
        let before_bend = earlier.map(|earlier| (earlier.0, (slope - steep(earlier, before)) / (after.0 - earlier.0)));
        let (bend, twist) = match (before_bend, after_bend) {
            (Some((earlier, one)), Some((further, other))) => (one, (earlier, (other - one) / (further - earlier))),
            (Some((_, bend)), None) | (None, Some((_, bend))) => (bend, (0.0, zero)),
            (None, None) => (zero, (0.0, zero)),
        };
        Self { before, after: after.0, slope, bend, twist }
    }

    fn at(&self, time: f64) -> Vector2<f64> {
        let (from, twist) = self.twist;
        let bend = self.bend + twist * (time - from);
        self.before.1 + (self.slope + bend * (time - self.after)) * (time - self.before.0)
    }
}

impl<'a> ForceReader<'a> {
    fn new(path: &'a Path, jumps: Vec<Jump>, spread: f64) -> Self {
        Self { path, jumps, spread, next: 1, piece: Piece::up_to(&path.knots, 1), jump: 0 }
    }

    /// The force on the finger's disk, per unit mass of the part; nothing before the start, and the last one after the
    /// end.
    pub(super) fn at(&mut self, time: f64) -> Vector2<f64> {
        if self.piece.after <= time {
            let knots = &self.path.knots;
            while self.next < knots.len() && knots[self.next].0 <= time {
                self.next += 1;
            }
            self.piece = Piece::up_to(knots, self.next);
        }
        let force = if time < 0.0 { Vector2::zeros() } else { self.piece.at(time) };
        self.with_spread_jumps(force, time)
    }

    /// The jump that spreading reaches at the time asked for last: which one, and a standard deviation of what a sensor
    /// reads beside its mean, since it reads before the jump or behind it and nothing between.
    pub(super) fn unsure(&self, time: f64) -> Option<(usize, Vector2<f64>)> {
        let jump = self.jumps.get(self.jump)?;
        let share = 0.5 + (time - jump.time) / self.spread;
        (0.0..1.0).contains(&share).then(|| (self.jump, jump.by * (share * (1.0 - share)).sqrt()))
    }

    /// With what spreading the jumps adds: half of one that is about to come, less half of one that has just been.
    fn with_spread_jumps(&mut self, mut force: Vector2<f64>, time: f64) -> Vector2<f64> {
        let half = 0.5 * self.spread;
        while self.jumps.get(self.jump).is_some_and(|jump| jump.time < time - half) {
            self.jump += 1;
        }
        for jump in self.jumps[self.jump..].iter().take_while(|jump| jump.time < time + half) {
            let share = 0.5 + (time - jump.time) / self.spread;
            force += jump.by * if time < jump.time { share } else { share - 1.0 };
        }
        force
    }
}

/// Why a guess cannot be played through.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Lost {
    /// The start was not found.
    Start,
    /// The finger loses the part, or jams against it.
    Contact,
}

/// What of a push may be changed.
#[derive(Clone, Debug)]
pub(super) enum Changed {
    /// The part: its outline, where its mass is, or its pressure.
    Part(Part),
    /// µ_c along the edge.
    Friction(FrictionAlong),
    /// The finger's motion, as [`Course::legs`].
    Motion(Vec<Leg>),
}

/// What every guess shares.
#[derive(Clone, Debug)]
pub(super) struct Course<'p> {
    pub(super) part: &'p Part,
    /// The finger's outline where it is no disk.
    pub(super) shape: Option<FingerShape>,
    /// How many turns take the part to itself: an ellipse is sought over one of them.
    pub(super) symmetry: usize,
    /// What µ g is taken for, m/s².
    pub(super) mu_g: f64,
    /// Standard deviation of ln(µ g), where it is not known.
    pub(super) mu_g_log_sd: Option<f64>,
    /// µ_c, where it is known.
    pub(super) mu_c: Option<f64>,
    /// How that differs from place to place of the edge of a guess.
    pub(super) friction_along: FrictionAlong,
    /// Where part, motion or friction along the edge are not known exactly: what changes with each number of them off by
    /// `fit::SHARE_OF_SD` more.
    pub(super) changed: &'p [Changed],
    /// How far each of these numbers is off here.
    pub(super) off: &'p [NumberOff],
    pub(super) start: CourseStart,
    /// In time since the start, at which the first is under way; of a push from rest it begins then.
    pub(super) legs: Vec<Leg>,
    /// When the data end, s.
    pub(super) duration: f64,
    pub(super) resolution: Resolution,
}

impl<'p> Course<'p> {
    fn model(&self, place: usize, leg: &Leg, mu_g: f64) -> Option<PlayedModel<'p>> {
        PlayedModel::new(self.part, place, self.shape, mu_g, leg)
    }

    /// Where a guess's finger touches the part; none where the part is not.
    pub(super) fn side(&self, place: usize) -> Option<PartSide> {
        self.part.touched(place).ok()
    }

    /// The same with everything known.
    pub(super) fn sure(&self) -> Self {
        Self { changed: &[], off: &[], ..self.clone() }
    }

    /// The same for a first look. Of a part that moves already much happens within a window's hop: one of thirty was lost.
    pub(super) fn coarse(&self) -> Self {
        let resolution = match self.start {
            CourseStart::Rest => Resolution::Coarse,
            CourseStart::Moving => Resolution::Fine,
        };
        Self { resolution, ..self.clone() }
    }

    /// The same with something changed.
    pub(super) fn with(&self, changed: &'p Changed) -> Self {
        match changed {
            Changed::Part(part) => Self { part, ..self.sure() },
            Changed::Friction(along) => Self { friction_along: along.clone(), ..self.sure() },
            Changed::Motion(legs) => Self { legs: legs.clone(), ..self.sure() },
        }
    }

    /// µ g by a guess, m/s².
    pub(super) fn mu_g_of(&self, guess: &Guess) -> f64 {
        self.mu_g * guess.mu_g_log.exp()
    }

    /// The model at the start, with what µ g is taken for.
    pub(super) fn first_model(&self, place: usize) -> Option<PlayedModel<'p>> {
        self.model(place, &self.legs[0], self.mu_g)
    }

    /// Plays a guess through.
    pub(super) fn play(&self, guess: &Guess) -> Result<Path, Lost> {
        let mu_g = self.mu_g_of(guess);
        let model = |leg: &Leg| self.model(guess.edge, leg, mu_g).ok_or(Lost::Start);
        let first = model(&self.legs[0])?;
        let mut simulation = match self.start {
            CourseStart::Rest => PathSimulation::begin(self, first, guess)?,
            CourseStart::Moving => PathSimulation::begin_moving(self, first, guess)?,
        };
        for (index, leg) in self.legs.iter().enumerate() {
            if leg.from >= self.duration - SAME_TIME_S {
                break;
            }
            if index > 0 {
                simulation.enter(model(leg)?, leg.from)?;
            }
            let last = index + 1 == self.legs.len();
            let until = if last { self.duration } else { leg.to.min(self.duration) };
            simulation.follow(until)?;
        }
        simulation.note_end();
        Ok(simulation.path)
    }

    /// Pose of the part frame in the motion's frame at the end of a path that began with this guess.
    pub(super) fn pose_at_end(&self, guess: &Guess, path: &Path) -> Option<Isometry2<f64>> {
        self.pose_of_end(guess, &path.end)
    }

    /// The same where the path has ended so.
    pub(super) fn pose_of_end(&self, guess: &Guess, end: &State) -> Option<Isometry2<f64>> {
        let (model, leg_from) = self.last_model(guess)?;
        Some(model.pose(self.duration - leg_from, end))
    }

    /// Velocity of the centre of mass at the end of a path that began with this guess, m/s.
    pub(super) fn velocity_at_end(&self, guess: &Guess, path: &Path) -> Option<Vector2<f64>> {
        let (model, leg_from) = self.last_model(guess)?;
        Some(model.velocity(&path.contact, self.duration - leg_from, &path.end))
    }

    /// The model at the end, and when its leg began, s.
    fn last_model(&self, guess: &Guess) -> Option<(PlayedModel<'p>, f64)> {
        let leg = self.legs.iter().rev().find(|leg| leg.from < self.duration - SAME_TIME_S)?;
        Some((self.model(guess.edge, leg, self.mu_g_of(guess))?, leg.from))
    }

    /// Whether other places explain all the same: round a disk, and along a straight finger.
    pub(super) fn is_continuum(&self) -> bool {
        self.symmetry == ROUND || self.shape == Some(FingerShape::Line)
    }

    /// A state in the outlines' own parameters.
    pub(super) fn told(&self, place: usize, state: &State) -> State {
        self.first_model(place).map_or(*state, |model| model.told(state))
    }

    /// By how much v_T at the end of a path is off that of a part that rolls, m/s.
    pub(super) fn slide_at_end(&self, guess: &Guess, path: &Path) -> Option<f64> {
        if path.contact == ContactMode::Rolling {
            return Some(0.0);
        }
        let (model, leg_from) = self.last_model(guess)?;
        Some(path.end.v_t - model.rolling_v_t(self.duration - leg_from, &path.end))
    }

    /// Pose of the part frame and velocity of the centre of mass (m/s) of a part that moves, at the start.
    pub(super) fn motion_of(&self, guess: &Guess, contact: &ContactMode) -> Option<(Isometry2<f64>, Vector2<f64>)> {
        let model = self.model(guess.edge, &self.legs[0], self.mu_g_of(guess))?;
        let time = -self.legs[0].from;
        let mut state = State { u: guess.u, s: guess.s, omega: guess.omega, v_t: 0.0 };
        state.v_t = model.rolling_v_t(time, &state) + guess.slide;
        Some((model.pose(time, &state), model.velocity(contact, time, &state)))
    }

    /// Pose of the part frame in the motion's frame at the start.
    pub(super) fn pose_at_start(&self, guess: &Guess) -> Option<Isometry2<f64>> {
        let state = State { u: guess.u, s: guess.s, omega: guess.omega, v_t: 0.0 };
        Some(self.first_model(guess.edge)?.pose(-self.legs[0].from, &state))
    }
}

/// How far a contact is from changing.
struct Margin {
    /// Below 0 it has changed.
    left: f64,
    /// The friction that rolling takes; 0 in sliding.
    needed: f64,
}

/// A push under way.
struct PathSimulation<'a, 'p> {
    model: PlayedModel<'p>,
    leg_from: f64,
    mu_c: f64,
    along: &'a FrictionAlong,
    /// The place where the contact began, from which friction along the edge is told.
    begun_at: f64,
    resolution: Resolution,
    time: f64,
    state: State,
    contact: ContactMode,
    /// What these lead to.
    now: SettlingMotion,
    path: Path,
}

impl<'a, 'p> PathSimulation<'a, 'p> {
    /// From rest, a short time later.
    fn begin(course: &'a Course<'p>, model: PlayedModel<'p>, guess: &Guess) -> Result<Self, Lost> {
        let &Guess { u, s, mu_c, .. } = guess;
        let (along, later) = (&course.friction_along, REST_S.min(course.legs[0].to));
        // At rest Coulomb's law decides whether the contact rolls or slips; the force must push.
        let friction = ContactFriction::same(mu_c * along.factor(0.0));
        let start = |contact: &ContactMode| model.rest_start(contact, u, s);
        let state = State { u, s, omega: 0.0, v_t: 0.0 };
        // A finger that turns already goes by.
        let slip = model.slip(0.0, &state);
        let (contact, start) = friction.begun(slip, start).map_err(|_| Lost::Start)?;
        if !start.force().pushes() || model.is_jammed(&contact, &state) {
            return Err(Lost::Contact);
        }
        // From nothing the force jumps to that of the first accelerations; the state a moment later is α t, a t.
        let force = on_finger(model.normal_angle(u), start.normal_force, start.tangential_force);
        let state = model.after_rest([u, s], &start, later);
        let path = Path {
            smooth: vec![Vector2::zeros()],
            jumps: vec![Jump { time: 0.0, by: force, cause: Cause::Finger }],
            knots: vec![(0.0, force)],
            end: state,
            contact_start: contact,
            contact,
            s_span: [s, s],
            friction_needed: if contact == ContactMode::Rolling { needed(&start.force()) } else { 0.0 },
            slipped: contact != ContactMode::Rolling,
            course: ModeCourse::of(&contact),
        };
        // What hardly moves yet needs implicit steps.
        let now = model.linearised(&contact, later, &state);
        let resolution = course.resolution;
        Ok(Self { model, leg_from: 0.0, mu_c, along, begun_at: s, resolution, time: later, state, contact, now, path })
    }

    fn begin_moving(course: &'a Course<'p>, model: PlayedModel<'p>, guess: &Guess) -> Result<Self, Lost> {
        let &Guess { u, s, mu_c, omega, slide, .. } = guess;
        let (along, leg_from) = (&course.friction_along, course.legs[0].from);
        let friction = ContactFriction::same(mu_c * along.factor(0.0));
        let mut state = State { u, s, omega, v_t: 0.0 };
        let rolling_v_t = model.rolling_v_t(-leg_from, &state);
        state.v_t = rolling_v_t + slide;
        let slip = if slide == 0.0 { 0.0 } else { model.slip(-leg_from, &state) };
        let rolling = || {
            let state = State { v_t: rolling_v_t, ..state };
            model.motion(&ContactMode::Rolling, -leg_from, &state).force()
        };
        if mu_c.is_infinite() && slip != 0.0 {
            return Err(Lost::Start);
        }
        let contact = friction.at_slip(slip, rolling);
        let now = model.settling(&contact, -leg_from, &state);
        let motion = now.motion;
        if !motion.force().pushes() || model.is_jammed(&contact, &state) {
            return Err(Lost::Contact);
        }
        let force = on_finger(model.normal_angle(u), motion.normal_force, motion.tangential_force);
        let path = Path {
            smooth: vec![force],
            jumps: Vec::new(),
            knots: vec![(0.0, force)],
            end: state,
            contact_start: contact,
            contact,
            s_span: [s, s],
            friction_needed: if contact == ContactMode::Rolling { needed(&motion.force()) } else { 0.0 },
            slipped: contact != ContactMode::Rolling,
            course: ModeCourse::of(&contact),
        };
        let resolution = course.resolution;
        Ok(Self { model, leg_from, mu_c, along, begun_at: s, resolution, time: 0.0, state, contact, now, path })
    }

    /// The friction at a place on the edge, m.
    fn friction(&self, s: f64) -> ContactFriction {
        ContactFriction::same(self.mu_c * self.along.factor(s - self.begun_at))
    }

    /// A contact as it is at a place on the edge, m.
    fn contact_at(&self, s: f64) -> ContactMode {
        match self.contact {
            ContactMode::Sliding { slip, .. } => self.friction(s).slides(slip),
            other => other,
        }
    }

    /// A contact as it is on the way over a step, s: that of its middle.
    fn contact_over(&self, length: f64) -> ContactMode {
        let is_one = self.along.is_constant() || self.contact == ContactMode::Rolling;
        if is_one { self.contact } else { self.contact_at(self.state.s + 0.5 * length * self.now.motion.rates.s) }
    }

    /// Sees what time, state and contact lead to, one of which has changed.
    fn look(&mut self) {
        let is_linearised = self.now.begin.is_some();
        self.now = seen(&self.model, &self.contact, self.time - self.leg_from, &self.state, is_linearised);
    }

    fn force(&self) -> Vector2<f64> {
        let Motion { normal_force, tangential_force, .. } = self.now.motion;
        on_finger(self.model.normal_angle(self.state.u), normal_force, tangential_force)
    }

    /// Goes on to a time, s.
    fn follow(&mut self, until: f64) -> Result<(), Lost> {
        let resolution = self.resolution;
        let turn_tangent = resolution.turn_rad().tan();
        while self.time < until - SAME_TIME_S {
            let next = self.path.smooth.len() + resolution.stride() - 1;
            let left = (hann_windows::GRID_S * as_f64(next) - self.time).min(until - self.time);
            let turning = self.model.turns_after(self.time - self.leg_from, turn_tangent).max(STEP_TURNING_S);
            let turned = (turning < left).then(|| (self.time, self.force(), self.path.jumps.len()));
            let left = left.min(turning);
            let explicit = STEP_OF_MEMORY / fastest_rate(&self.now, &self.contact);
            // An explicit one is cheaper where it reaches as far.
            let stiff = explicit < resolution.stiff_s().min(left);
            self.step(if stiff { left } else { explicit.min(left) }, stiff)?;
            if let Some((from, before, jumps)) = turned
                && jumps == self.path.jumps.len()
            {
                self.note_turn(from, before);
            }
            self.note(next);
        }
        self.path.end = State { v_t: self.v_t(), ..self.state };
        self.path.contact = self.contact;
        Ok(())
    }

    fn v_t(&self) -> f64 {
        match self.contact {
            ContactMode::Rolling => self.model.rolling_v_t(self.time - self.leg_from, &self.state),
            ContactMode::Frictionless | ContactMode::Sliding { .. } => self.state.v_t,
        }
    }

    /// Keeps what belongs to the path at this time, up to a point of the grid where that is it; straight lines lead there from
    /// the last one.
    fn note(&mut self, next: usize) {
        let [low, high] = self.path.s_span;
        self.path.s_span = [low.min(self.state.s), high.max(self.state.s)];
        if self.time >= hann_windows::GRID_S * as_f64(next) - SAME_TIME_S {
            let jumped: Vector2<f64> = self.path.jumps.iter().map(|jump| jump.by).sum();
            let force = self.force();
            let smooth = &mut self.path.smooth;
            let (from, before) = (smooth.len() - 1, smooth[smooth.len() - 1]);
            let share = |point: usize| as_f64(point - from) / as_f64(next - from);
            smooth.extend((from + 1..next).map(|point| before.lerp(&(force - jumped), share(point))));
            smooth.push(force - jumped);
            self.path.knots.push((self.time, force));
        }
    }

    /// Keeps what the force was before a short step over which it turned: under a window as good as a jump midway.
    fn note_turn(&mut self, from: f64, before: Vector2<f64>) {
        let force = self.force();
        self.path.knots.push((self.time, force));
        let jump = Jump { time: 0.5 * (from + self.time), by: force - before, cause: Cause::Turning };
        self.path.jumps.push(jump);
    }

    /// Takes a step, or the part of it that ends in a change of the contact.
    fn step(&mut self, length: f64, stiff: bool) -> Result<(), Lost> {
        let (before, local) = (self.state, self.time - self.leg_from);
        let (model, contact) = (self.model, self.contact_over(length));
        let rates =
            if contact == self.contact { self.now.motion } else { model.motion(&contact, local, &before) }.rates;
        let begin = LazyCell::new(|| {
            let seen = self.now.begin.filter(|_| contact == self.contact);
            seen.or_else(|| model.linearised(&contact, local, &before).begin)
        });
        let at = |length: f64| {
            let begin = stiff.then(|| begin.as_ref()).flatten();
            let settled = begin.and_then(|begin| model.stiff_step(&contact, local, &before, length, begin));
            settled.unwrap_or_else(|| model.step(&contact, local, &before, &rates, length))
        };
        let after = at(length);
        // After an implicit step the next is likely one too.
        let there = seen(&model, &self.contact, local + length, &after, stiff);
        let grows = || fastest_rate(&there, &contact) > self.resolution.growth() * fastest_rate(&self.now, &contact);
        if stiff && length > STEP_TURNING_S && grows() {
            return self.step(0.5 * length, stiff);
        }
        let Margin { left, needed } = match self.margin(local + length, &after, &there.motion) {
            Err(Lost::Contact) if length > LOST_S => return self.step(0.5 * length, stiff),
            margin => margin?,
        };
        if left >= 0.0 {
            self.path.friction_needed = self.path.friction_needed.max(needed);
            (self.state, self.time, self.now) = (after, self.time + length, there);
            let contact = self.contact_at(after.s);
            if contact != self.contact {
                self.contact = contact;
                self.look();
            }
            return Ok(());
        }
        let within = |part: f64| {
            if self.resolution == Resolution::Coarse && !stiff {
                between([(&before, &rates), (&after, &there.motion.rates)], length, part / length)
            } else {
                at(part)
            }
        };
        let left = |part: f64| {
            let (time, within) = (local + part, within(part));
            let margin = self.margin(time, &within, &model.motion(&self.contact, time, &within));
            margin.map_or(f64::NEG_INFINITY, |margin| margin.left)
        };
        let change = first_ended(left, length, CHANGE_SHARE * length);
        (self.state, self.time) = (at(change), self.time + change);
        self.contact = self.contact_at(self.state.s);
        self.look();
        self.change()
    }

    fn margin(&self, local: f64, state: &State, motion: &Motion) -> Result<Margin, Lost> {
        if !motion.force().pushes() || self.model.is_jammed(&self.contact, state) {
            return Err(Lost::Contact);
        }
        let left = self.friction(state.s).left(&self.contact, || self.model.slip(local, state), || motion.force());
        let needed = if self.contact == ContactMode::Rolling { needed(&motion.force()) } else { 0.0 };
        Ok(Margin { left, needed })
    }

    /// Changes between rolling and sliding, here.
    fn change(&mut self) -> Result<(), Lost> {
        let force_before = self.force();
        let local = self.time - self.leg_from;
        self.state.v_t = self.model.rolling_v_t(local, &self.state);
        let rolling = self.model.motion(&ContactMode::Rolling, local, &self.state);
        self.contact = self.friction(self.state.s).after(&self.contact, &rolling.force());
        self.look();
        self.jump(force_before, Cause::Contact)
    }

    /// Goes over to another acceleration of the finger: what rolled may slip at once.
    fn enter(&mut self, model: PlayedModel<'p>, leg_from: f64) -> Result<(), Lost> {
        let force_before = self.force();
        (self.model, self.leg_from) = (model, leg_from);
        self.look();
        if self.contact == ContactMode::Rolling {
            self.state.v_t = self.v_t();
            self.contact = self.friction(self.state.s).without_slip(&self.now.motion.force());
            self.look();
        }
        self.jump(force_before, Cause::Finger)
    }

    /// Keeps the force where its course ends.
    fn note_end(&mut self) {
        if self.path.knots.last().is_none_or(|(time, _)| *time < self.time - SAME_TIME_S) {
            let force = self.force();
            self.path.knots.push((self.time, force));
        }
    }

    fn jump(&mut self, force_before: Vector2<f64>, cause: Cause) -> Result<(), Lost> {
        self.path.slipped |= self.contact != ContactMode::Rolling;
        self.path.course = self.path.course.then(&self.contact);
        let force = self.force();
        self.path.knots.extend([(self.time, force_before), (self.time, force)]);
        self.path.jumps.push(Jump { time: self.time, by: force - force_before, cause });
        let changes = self.path.jumps.iter().filter(|jump| jump.cause == Cause::Contact).count();
        if changes > CHANGES_MAX { Err(Lost::Contact) } else { Ok(()) }
    }
}

/// The state at a share of a step of `length` s, of which states and rates at both ends are known: Hermite's cubic.
fn between([(start, start_rates), (end, end_rates)]: [(&State, &State); 2], length: f64, share: f64) -> State {
    let rest = 1.0 - share;
    let bend =
        (*end + *start * -1.0) * (1.0 - 2.0 * share) + *end_rates * (share * length) + *start_rates * (-rest * length);
    *start * rest + *end * share + bend * (-share * rest)
}

/// The fastest rate at which turning and sliding settle, 1/s: the largest eigenvalue of the derivatives of
/// their accelerations by them. Friction resists a slow part the harder the slower it is, and a contact that slides
/// near its jam multiplies what it feels.
fn fastest_rate(motion: &SettlingMotion, contact: &ContactMode) -> f64 {
    let [[a, b], sliding] = motion.settling;
    // A contact that rolls has no velocity along it of its own.
    let [c, d] = if *contact == ContactMode::Rolling { [0.0; 2] } else { sliding };
    let (half, determinant) = (0.5 * (a + d), a * d - b * c);
    let discriminant = half * half - determinant;
    if discriminant >= 0.0 { half.abs() + discriminant.sqrt() } else { determinant.sqrt() }
}

/// What a contact leads to.
fn seen(model: &PlayedModel, contact: &ContactMode, local: f64, state: &State, is_linearised: bool) -> SettlingMotion {
    if is_linearised { model.linearised(contact, local, state) } else { model.settling(contact, local, state) }
}

fn as_f64(count: usize) -> f64 {
    f64::from(u32::try_from(count).unwrap_or(u32::MAX))
}

/// The friction that rolling takes, as a coefficient.
fn needed(rolling: &ContactForce) -> f64 {
    rolling.tangential.abs() / rolling.normal
}

/// Force on the finger's disk from its components on the part.
fn on_finger(u: f64, normal: f64, tangential: f64) -> Vector2<f64> {
    let (sin, cos) = u.sin_cos();
    Vector2::new(-cos * normal - sin * tangential, cos * tangential - sin * normal)
}
