//! A push in time, from its start to the last time asked for or to what ends it.
//!
//! Steps are error-controlled ([`super::integrate`]), and linearly implicit while a foot all but rests. Within each step the margins that keep the contact as it is are
//! looked at in several places; where one is used up, the instant is found on exact steps from the step's start, so
//! that events are as accurate as states. A margin that dips below zero and recovers within a step is found by its
//! minimum.
//!
//! The truth among those who follow a push through changes of mode: outlines of any shape, every event, errors of
//! rounding. It carries no derivatives ([`super::switching`] adds them afterwards), and its steps depend on what it
//! finds, so that a cost of its results is not smooth: estimators have paths of their own. Which mode follows is
//! decided in [`super::contact_mode`].
//!
//! Implements: the contact modes of thesis §5.2.1 and §5.4 with Coulomb's law deciding between them.
//! Assumes: what else the finger meets does not push: see [`SecondContact`].
//! Frames: world, unless named. Units: SI, forces per unit mass of the part.
//! Errors: [`PushRunError`], for motions too stiff to follow. Measured error: see [`PushOf::run`].

use nalgebra::{Point2, Rotation2, Vector2};

use super::contact_mode::{ContactForce, ContactFriction, JAM_DENOMINATOR, SLIP_NONE, jams, slip_left};
use super::contact_model::{ContactModel, arm, normal, rest_start};
use super::integrate::{Scale, Step};
use super::mode_change::first_ended;
use super::model::{ContactMode, State};
use super::push::{ContactLaw, EdgeEnd, PushOf, Start, gap};
use super::rest::{RestError, RestStart};
use crate::search::{Halt, Stop, never};

/// Normal force per mass, m/s², below which a contact at a leg's start may be about to end: a thousandth of rounding in
/// g would not show here.
const FORCE_NONE: f64 = 1e-9;

/// How far beyond its edge a contact may start, m: see [`Push::new`](super::Push::new).
const PLACE_NONE: f64 = 1e-9;

/// Time over which to see where a margin goes that is used up at a leg's start, s.
const PROBE_TIME: f64 = 1e-7;

/// The start from rest is followed in closed form for this share of √(ρ/|a|): what is left out is smaller by its
/// square.
const REST_SHARE: f64 = 1e-6;

/// Where in a step to look at the margins. The first and last inner places tell which way they go at the ends.
const LOOKS: [f64; 7] = [0.0, 0.01, 0.25, 0.5, 0.75, 0.99, 1.0];

/// A dip is searched for its minimum if a parabola's is below this share of the lowest place looked at.
const DIP_SHARE: f64 = 0.5;

/// Golden sections: enough to reach rounding from any bracket.
const SEARCHES_MAX: usize = 80;

/// A part that comes to rest this shortly before the finger's acceleration changes does so at the change, s: a finger
/// that brakes to a pause.
const PAUSE_NEAR: f64 = 1e-6;

/// First step, s: the next ones grow or shrink to what is needed.
const STEP_FIRST: f64 = 1e-5;

/// Steps of a push after which it is given up: about two seconds of computing.
const STEPS_MAX: usize = 2_000_000;

/// A push takes stiff steps after so many others that were shorter than this, s, while a foot was slower than this, m/s:
/// a start from rest has a few dozen as short, and soon longer ones.
const STIFF_PATIENCE: usize = 100;
/// See [`STIFF_PATIENCE`].
const STIFF_STEP: f64 = 1e-4;
/// See [`STIFF_PATIENCE`].
const STIFF_SPEED: f64 = 3e-4;

/// Changes between rolling and sliding after which a push is given up.
const CHANGES_MAX: usize = 10_000;

/// The result of a push.
#[derive(Clone, Debug)]
pub struct PushRun {
    /// The part at each time asked for, up to the end.
    pub samples: Vec<Sample>,
    /// What ended the push.
    pub end: End,
    /// The part at the end.
    pub last: Sample,
    /// When rolling and sliding took turns, in order.
    pub changes: Vec<Change>,
    /// How the part began to move, where it started at rest.
    pub rest_start: Option<Acceleration>,
    /// When the finger first reached another edge, if it did: what follows leaves that contact out.
    pub second_contact: Option<SecondContact>,
}

/// The finger reaches a second edge of the part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SecondContact {
    /// Time since the push began at which the disk meets another edge, s.
    pub t: f64,
    /// The edge that it meets: of those that make one straight side the first.
    pub edge: usize,
}

/// A pushed part at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Time since the push began, s.
    pub t: f64,
    /// State of the contact.
    pub state: State,
    /// What the contact does.
    pub contact: ContactMode,
    /// Position of the part frame's origin, m.
    pub position: Point2<f64>,
    /// Turn from world to part axes, rad; in (−π, π] at the start, then continuous.
    pub theta: f64,
    /// Velocity of the centre of mass, m/s.
    pub velocity: Vector2<f64>,
    /// Force on the part; none where it jams, or where part and finger rest and nothing determines it.
    pub force: Option<ContactForce>,
}

/// The end of a push.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct End {
    /// What ended the motion.
    pub reason: EndReason,
    /// Time since the motion began, s.
    pub t: f64,
}

/// Why a push ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EndReason {
    /// The last time asked for.
    Time,
    /// The finger leaves the part.
    Break,
    /// Sliding stopped: the contact sticks.
    Stick,
    /// Rolling needs more friction than there is.
    Slip,
    /// The contact reached the first end of the edge's straight side.
    EdgeMin,
    /// The contact reached the second end of the edge's straight side.
    EdgeMax,
    /// No contact force fits the sliding part (Painlevé).
    Jam,
    /// The finger reached another edge: see [`PushOf::ending_at_second_contact`].
    SecondContact,
}

/// A change between rolling and sliding.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Change {
    /// Time since the push began, s.
    pub t: f64,
    /// What the contact does from then on.
    pub to: ContactMode,
}

/// Acceleration of a part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Acceleration {
    /// Of the centre of mass, m/s².
    pub centre_of_mass: Vector2<f64>,
    /// Angular acceleration, counter-clockwise, rad/s².
    pub alpha: f64,
}

/// A push could not be followed to its end.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PushRunError {
    /// Nothing was asked for.
    #[error("no time is given: give at least one to sample the push at")]
    NoTimes,
    /// The start from rest was not found.
    #[error(transparent)]
    Rest(#[from] RestError),
    /// The steps became too small for the clock.
    #[error("the motion at t = {t:?} s changes too fast to be followed")]
    TooFast {
        /// Time since the push began, s.
        t: f64,
    },
    /// More steps than a run may take.
    #[error(
        "the push needs more than {STEPS_MAX} steps and got to t = {t:?} s: support friction on so slow a part, or on a foot at rest, is too stiff"
    )]
    TooLong {
        /// How far it got, s.
        t: f64,
    },
    /// It was told to stop.
    #[error("the push was stopped at t = {t:?} s")]
    Stopped {
        /// How far it got, s.
        t: f64,
    },
    /// Derivatives were asked for of a push that has none.
    #[error(
        "a push {what} has no derivatives here: derive one that starts in motion, with a finger of one acceleration"
    )]
    NotDerivable {
        /// What stands in the way.
        what: &'static str,
    },
    /// Rolling and sliding took turns without end.
    #[error("rolling and sliding took turns more than {CHANGES_MAX} times up to t = {t:?} s")]
    TooManyChanges {
        /// How far it got, s.
        t: f64,
    },
}

/// What can end a leg. In order: of two at one instant the first counts.
const EVENTS: [EndReason; 8] = [
    EndReason::Jam,
    EndReason::Break,
    EndReason::Stick,
    EndReason::Slip,
    EndReason::Slip,
    EndReason::EdgeMin,
    EndReason::EdgeMax,
    EndReason::SecondContact,
];

/// How far each of [`EVENTS`] is: below 0 it has happened.
type Margins = [f64; EVENTS.len()];

/// A stretch of the push with one kind of contact.
#[derive(Clone, Copy)]
struct Leg {
    contact: ContactMode,
    time: f64,
    state: State,
    /// Margins are lowered by these: a leg may start a rounding error beyond one.
    slack: Margins,
}

/// What a push comes to after a step or an event.
enum Next {
    Leg(Leg),
    End(EndReason),
}

/// An event and when it happens.
struct Found {
    event: usize,
    share: f64,
}

impl<M: ContactModel> PushOf<M> {
    /// Simulates the push, and samples it at `times`: s, increasing, from 0 on, at least one.
    ///
    /// Measured on 200 random pushes over 0.8 s at 5 cm/s, rolling and frictionless, against fixed steps of 20 µs: u
    /// within 3e-11 rad, s within 3e-13 m. A slow part is stiff: a step takes about 3v/(µg), 0.1 ms at 0.1 mm/s. Where a foot
    /// is as slow as that, steps are linearly implicit; against fixed steps of 0.2 µs u is within 1e-7 rad then, s within
    /// 1e-9 m.
    ///
    /// # Errors
    /// [`PushRunError`].
    pub fn run(&self, times: &[f64]) -> Result<PushRun, PushRunError> {
        self.run_until(times, &never)
    }

    /// The same, ended when `stop` says so.
    ///
    /// # Errors
    /// [`PushRunError`]; [`PushRunError::Stopped`] where `stop` ended it: half a push is none.
    pub fn run_until(&self, times: &[f64], stop: Stop<'_>) -> Result<PushRun, PushRunError> {
        self.halting_run(times, &Halt::new(stop))
    }

    /// [`Self::run_until`], for several runs that halt together.
    pub(crate) fn halting_run(&self, times: &[f64], halt: &Halt<'_>) -> Result<PushRun, PushRunError> {
        let &time_end = times.last().ok_or(PushRunError::NoTimes)?;
        let mut simulation = Simulation::new(self, times, time_end, halt);
        let mut next = simulation.begin()?;
        loop {
            if halt.is_wished() {
                return Err(PushRunError::Stopped { t: simulation.last.t });
            }
            next = match next {
                Next::End(reason) => return Ok(simulation.finish(reason)),
                Next::Leg(leg) => simulation.follow(leg)?,
            }
        }
    }

    /// Margins of a state in a leg, without slack.
    fn margins(&self, model: &M, contact: &ContactMode, time: f64, state: &State) -> Margins {
        const NEVER: f64 = f64::INFINITY;
        let motion = model.motion(contact, time, state);
        let (mut jam, mut stick, mut cone) = (NEVER, NEVER, [NEVER, NEVER]);
        match (*contact, self.law.deciding_friction()) {
            (ContactMode::Sliding { friction, slip }, _) => {
                jam = model.sliding_denominator(friction * slip.sign(), state) - JAM_DENOMINATOR;
                stick = slip_left(model.slip(time, state), slip);
            }
            (ContactMode::Rolling, Some(friction)) => cone = friction.unused_each_way(&motion.force()),
            _ => {}
        }
        let edge = match self.edge_end {
            EdgeEnd::Stop => {
                let [s_min, s_max] = model.side().range();
                [state.s - s_min, s_max - state.s]
            }
            EdgeEnd::Extend => [NEVER; 2],
        };
        let clear = self.obstacles.iter().map(|obstacle| gap(model, state, &obstacle.ends)).fold(NEVER, f64::min);
        [jam, motion.normal_force, stick, cone[0], cone[1], edge[0], edge[1], clear]
    }

    /// The edge that the finger is nearest to, of those that it does not push.
    fn nearest_obstacle(&self, state: &State) -> Option<usize> {
        let gaps = self.obstacles.iter().map(|obstacle| (obstacle.edge, gap(&self.model, state, &obstacle.ends)));
        gaps.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(edge, _)| edge)
    }
}

/// A push under way.
struct Simulation<'a, M> {
    halt: &'a Halt<'a>,
    push: &'a PushOf<M>,
    /// With the finger's present path.
    model: M,
    times: &'a [f64],
    time_end: f64,
    /// What brings θ into (−π, π] at the start, rad.
    theta_offset: f64,
    /// Length of the next step, s.
    step: f64,
    steps: usize,
    /// Steps so far, one after another, that were too short for what they do.
    short: usize,
    /// Whether steps are stiff ones.
    stiff: bool,
    samples: Vec<Sample>,
    changes: Vec<Change>,
    rest_start: Option<Acceleration>,
    second_contact: Option<SecondContact>,
    last: Sample,
}

impl<'a, M: ContactModel> Simulation<'a, M> {
    fn new(push: &'a PushOf<M>, times: &'a [f64], time_end: f64, halt: &'a Halt<'a>) -> Self {
        let (u, s) = push.start.contact();
        let state = State { u, s, omega: 0.0, v_t: 0.0 };
        let theta = push.model.theta(&state);
        let theta_offset = Rotation2::new(theta).angle() - theta;
        Self {
            halt,
            push,
            model: push.model,
            times,
            time_end,
            theta_offset,
            step: STEP_FIRST,
            steps: 0,
            short: 0,
            stiff: false,
            samples: Vec::with_capacity(times.len()),
            changes: Vec::new(),
            rest_start: None,
            second_contact: None,
            last: sample(&push.model, 0.0, &ContactMode::Frictionless, &state, theta_offset),
        }
    }

    fn model(&self) -> &M {
        &self.model
    }

    /// Up to when the finger keeps its path, s.
    fn horizon(&self, time: f64) -> f64 {
        self.push.track.change_after(time).min(self.time_end)
    }

    /// Begins the first leg, from rest or in motion.
    fn begin(&mut self) -> Result<Next, PushRunError> {
        let state = match self.push.start {
            Start::Rest { u, s } => State { u, s, omega: 0.0, v_t: 0.0 },
            Start::Moving(state) => state,
        };
        let at_rest = matches!(self.push.start, Start::Rest { .. }) || self.speed_is_none(&state);
        if at_rest { self.begin_at_rest(0.0, state) } else { Ok(self.begin_moving(state)) }
    }

    fn speed_is_none(&self, state: &State) -> bool {
        let contact = if self.push.law.rolls() { ContactMode::Rolling } else { ContactMode::Frictionless };
        state.omega == 0.0 && self.model().velocity(&contact, 0.0, state) == Vector2::zeros()
    }

    fn begin_moving(&mut self, state: State) -> Next {
        let rolling = State { v_t: self.model().rolling_v_t(0.0, &state), ..state };
        let slip = self.model().slip(0.0, &state);
        let no_slip = slip.abs() < SLIP_NONE;
        let (contact, state) = match self.push.law {
            ContactLaw::Frictionless => (ContactMode::Frictionless, state),
            ContactLaw::Rolling { .. } => (ContactMode::Rolling, rolling),
            law @ ContactLaw::Sliding { slip, .. } => (law.sliding(slip), if no_slip { rolling } else { state }),
            ContactLaw::Coulomb { friction } => {
                let state = if no_slip { rolling } else { state };
                (ContactFriction::same(friction).at_slip(slip, || self.rolling_force(0.0, &state)), state)
            }
        };
        let decided = matches!(self.push.law, ContactLaw::Coulomb { .. });
        let next = self.start_leg(contact, 0.0, state, decided && no_slip);
        self.sample_start(&next, contact, state);
        next
    }

    /// The force that rolling needs.
    fn rolling_force(&self, time: f64, state: &State) -> ContactForce {
        self.model().motion(&ContactMode::Rolling, time, state).force()
    }

    /// Samples time 0, where no step leads to.
    fn sample_start(&mut self, next: &Next, contact: ContactMode, state: State) {
        let mut sample = self.sample(0.0, &contact, &state);
        if matches!(next, Next::End(EndReason::Jam)) {
            sample.force = None;
        }
        self.record(sample);
    }

    /// Starts a leg, unless it ends at once. `slips` for a contact known to begin to slip, or to roll, just now.
    fn start_leg(&mut self, contact: ContactMode, time: f64, state: State, slips: bool) -> Next {
        let margins = self.push.margins(self.model(), &contact, time, &state);
        // What is used up at the start tells by its course whether the leg ends at once: the margins a moment later.
        let probe = Step::take(self.model(), &contact, time, state, PROBE_TIME).end();
        let after = self.push.margins(self.model(), &contact, time + PROBE_TIME, &probe);
        let mut slack = [0.0; EVENTS.len()];
        for (i, event) in EVENTS.into_iter().enumerate() {
            if event == EndReason::SecondContact && self.second_contact.is_some() {
                slack[i] = f64::INFINITY;
                continue;
            }
            // A margin within this of 0 is 0 but for rounding.
            let none = match event {
                EndReason::Stick => SLIP_NONE,
                EndReason::EdgeMin | EndReason::EdgeMax | EndReason::SecondContact => PLACE_NONE,
                _ => FORCE_NONE,
            };
            // A contact that has just begun to slip has no slip yet.
            let fresh_slip = slips && event == EndReason::Stick;
            let used_up = margins[i] < -none || (margins[i] < none && after[i] < margins[i] && !fresh_slip);
            // A jam always ends the leg; a second contact may only be noted; a margin that starts within rounding gets
            // that much slack.
            match event {
                EndReason::Jam if margins[i] <= 0.0 => return Next::End(event),
                EndReason::SecondContact if used_up && !self.push.ends_at_second_contact => {
                    self.second_contact =
                        self.push.nearest_obstacle(&state).map(|edge| SecondContact { t: time, edge });
                    slack[i] = f64::INFINITY;
                }
                _ if used_up => return Next::End(event),
                _ if margins[i] < none => slack[i] = none,
                _ => {}
            }
        }
        Next::Leg(Leg { contact, time, state, slack })
    }

    /// Follows a leg for one step.
    fn follow(&mut self, leg: Leg) -> Result<Next, PushRunError> {
        let step = self.step(&leg)?;
        let (found, time) = (self.first_event(&leg, &step), step.time + step.length);
        let Some(Found { event, share }) = found else {
            self.sample_step(&leg, &step, 1.0);
            let state = step.end();
            return self.after_step(leg, time, state);
        };
        let stopped = step.again(self.model(), &leg.contact, share * step.length);
        self.sample_step(&leg, &step, share);
        let (time, state) = (step.time + stopped.length, stopped.end());
        if EVENTS[event] == EndReason::SecondContact {
            return Ok(self.after_second_contact(&leg, event, time, state));
        }
        self.last = self.sample(time, &leg.contact, &state);
        self.after_event(&leg, event, time, state)
    }

    /// Notes the second contact, and ends or goes on without it.
    fn after_second_contact(&mut self, leg: &Leg, event: usize, time: f64, state: State) -> Next {
        let edge = self.push.nearest_obstacle(&state);
        self.second_contact = edge.map(|edge| SecondContact { t: time, edge });
        if self.push.ends_at_second_contact {
            self.last = self.sample(time, &leg.contact, &state);
            return Next::End(EndReason::SecondContact);
        }
        let mut slack = leg.slack;
        slack[event] = f64::INFINITY;
        Next::Leg(Leg { time, state, slack, ..*leg })
    }

    /// Goes on where the finger changes its acceleration.
    fn change_path(&mut self, leg: &Leg, time: f64, state: State) -> Result<Next, PushRunError> {
        // The state goes on as it is; only the acceleration jumps, and with it the force.
        self.model = self.model.with_path(self.push.track.path(time));
        if self.rests(&leg.contact, time, &state) {
            return self.begin_at_rest(time, State { omega: 0.0, ..state });
        }
        // Under Coulomb's law a rolling contact may slip under the new force (5.30).
        let contact = match (self.push.law, leg.contact) {
            (ContactLaw::Coulomb { friction }, ContactMode::Rolling) => {
                ContactFriction::same(friction).without_slip(&self.rolling_force(time, &state))
            }
            (_, contact) => contact,
        };
        let changed = contact != leg.contact;
        if changed {
            self.changes.push(Change { t: time, to: contact });
        }
        // The error control knows nothing of the new acceleration: it begins with a small step.
        self.step = STEP_FIRST;
        let next = self.start_leg(contact, time, state, changed);
        if let Next::End(_) = next {
            self.last = self.sample(time, &contact, &state);
        }
        Ok(next)
    }

    /// Whether the part is as good as at rest.
    fn rests(&self, contact: &ContactMode, time: f64, state: &State) -> bool {
        let spin = self.model().body().inertia_per_mass().sqrt() * state.omega.abs();
        self.model().velocity(contact, time, state).norm() + spin < SLIP_NONE
    }

    /// Lets part and finger rest until the finger moves again, if ever.
    fn wait(&mut self, time: f64, state: State) -> Result<Next, PushRunError> {
        let until = self.horizon(time);
        let contact = self.push.law.at_rest();
        loop {
            if self.halt.is_wished() {
                return Err(PushRunError::Stopped { t: time });
            }
            let asked = self.times.get(self.samples.len()).copied().filter(|&asked| asked <= until);
            let still = Sample { force: None, ..self.sample(asked.unwrap_or(until), &contact, &state) };
            self.record(still);
            if asked.is_none() {
                break;
            }
        }
        if until >= self.time_end {
            return Ok(Next::End(EndReason::Time));
        }
        self.model = self.model.with_path(self.push.track.path(until));
        self.begin_at_rest(until, state)
    }

    fn after_step(&mut self, leg: Leg, time: f64, state: State) -> Result<Next, PushRunError> {
        if time >= self.time_end {
            self.last = self.sample(self.time_end, &leg.contact, &state);
            return Ok(Next::End(EndReason::Time));
        }
        if time >= self.horizon(leg.time) {
            return self.change_path(&leg, time, state);
        }
        let speed = |time, state| self.model().velocity(&leg.contact, time, state).norm();
        if self.rests(&leg.contact, time, &state) && speed(time, &state) < speed(leg.time, &leg.state) {
            let horizon = self.horizon(leg.time);
            if horizon < self.time_end && horizon - time < PAUSE_NEAR {
                return self.change_path(&leg, horizon, state);
            }
            return self.begin_at_rest(time, State { omega: 0.0, ..state });
        }
        let margins = self.push.margins(self.model(), &leg.contact, time, &state);
        let mut slack = leg.slack;
        // What has become large enough to be told from rounding is held to zero from here on.
        slack
            .iter_mut()
            .zip(margins)
            .filter(|(slack, margin)| *margin > 0.0 && slack.is_finite())
            .for_each(|(slack, _)| *slack = 0.0);
        Ok(Next::Leg(Leg { time, state, slack, ..leg }))
    }

    fn after_event(&mut self, leg: &Leg, event: usize, time: f64, state: State) -> Result<Next, PushRunError> {
        let ContactLaw::Coulomb { friction } = self.push.law else { return Ok(Next::End(EVENTS[event])) };
        let state = State { v_t: self.model().rolling_v_t(time, &state), ..state };
        let to = match EVENTS[event] {
            EndReason::Stick | EndReason::Slip => {
                ContactFriction::same(friction).after(&leg.contact, &self.rolling_force(time, &state))
            }
            reason => return Ok(Next::End(reason)),
        };
        if self.changes.len() >= CHANGES_MAX {
            return Err(PushRunError::TooManyChanges { t: time });
        }
        self.changes.push(Change { t: time, to });
        let next = self.start_leg(to, time, state, true);
        if let Next::End(_) = next {
            self.last = self.sample(time, &to, &state);
        }
        Ok(next)
    }

    /// Stiff steps or others: where a foot comes to rest its friction settles a million times faster than the part moves.
    fn choose_steps(&mut self, leg: &Leg) {
        if self.stiff {
            self.stiff = self.slowest_foot(leg) < 2.0 * STIFF_SPEED;
            if !self.stiff {
                self.step = self.step.min(STEP_FIRST);
            }
            return;
        }
        self.short = if self.step < STIFF_STEP { self.short + 1 } else { 0 };
        if self.short > STIFF_PATIENCE && self.slowest_foot(leg) < STIFF_SPEED {
            (self.stiff, self.short) = (true, 0);
        }
    }

    /// How fast the slowest foot is, m/s; infinitely where there are none.
    fn slowest_foot(&self, leg: &Leg) -> f64 {
        let Some(feet) = self.model().body().feet() else { return f64::INFINITY };
        let velocity = self.model().velocity(&leg.contact, leg.time, &leg.state);
        let turn = Rotation2::new(self.model().theta(&leg.state));
        let centre = self.model().body().centre_of_mass();
        let speed = |(at, _): (Point2<f64>, f64)| {
            let arm = turn * (at - centre);
            (velocity + Vector2::new(-arm.y, arm.x) * leg.state.omega).norm()
        };
        feet.map(speed).fold(f64::INFINITY, f64::min)
    }

    /// One step that is accurate enough.
    fn step(&mut self, leg: &Leg) -> Result<Step, PushRunError> {
        let scale = Scale::of(self.model(), &leg.contact, leg.time, &leg.state);
        self.choose_steps(leg);
        loop {
            self.steps += 1;
            if self.halt.is_wished() {
                return Err(PushRunError::Stopped { t: leg.time });
            }
            if self.steps > STEPS_MAX {
                return Err(PushRunError::TooLong { t: leg.time });
            }
            let left = self.horizon(leg.time) - leg.time;
            let length = self.step.min(left);
            if leg.time + length <= leg.time && left > 0.0 {
                return Err(PushRunError::TooFast { t: leg.time });
            }
            let take = if self.stiff {
                Step::take_stiff
            } else {
                |model: &M, contact: &ContactMode, time, state, length| {
                    Some(Step::take(model, contact, time, state, length))
                }
            };
            let Some(step) = take(self.model(), &leg.contact, leg.time, leg.state, length) else {
                self.step = 0.5 * length;
                continue;
            };
            let error = step.error(&scale);
            let length_next = step.length_next(error);
            if error <= 1.0 {
                // The last step, cut to the end, says nothing about the next.
                self.step = if length < self.step { self.step } else { length_next };
                return Ok(step);
            }
            self.step = length_next.min(length * 0.9);
        }
    }

    /// The first event in a step.
    fn first_event(&self, leg: &Leg, step: &Step) -> Option<Found> {
        let looks =
            LOOKS.map(|share| self.margins_at(leg, step, share, &step.within(self.model(), &leg.contact, share)));
        let crossing = |event: usize| self.crossing(leg, step, event, &looks.map(|margins| margins[event]));
        let found = (0..EVENTS.len()).filter_map(|event| Some(Found { event, share: crossing(event)? }));
        found.min_by(|a, b| a.share.total_cmp(&b.share))
    }

    fn margins_at(&self, leg: &Leg, step: &Step, share: f64, state: &State) -> Margins {
        let mut margins = self.push.margins(self.model(), &leg.contact, step.time + share * step.length, state);
        margins.iter_mut().zip(leg.slack).for_each(|(margin, slack)| *margin += slack);
        margins
    }

    /// Where in a step a margin is first used up, given its values at [`LOOKS`].
    fn crossing(&self, leg: &Leg, step: &Step, event: usize, looks: &[f64; LOOKS.len()]) -> Option<f64> {
        let used_up = (1..LOOKS.len()).find(|&i| looks[i] < 0.0).map(|i| LOOKS[i]);
        let dip = || (1..LOOKS.len() - 1).find_map(|i| self.dip(leg, step, event, i, looks));
        let beyond = match used_up {
            Some(share) => dip().filter(|dip| *dip < share).unwrap_or(share),
            None => dip()?,
        };
        let exact = |share: f64| {
            let state = step.again(self.model(), &leg.contact, share * step.length).end();
            self.margins_at(leg, step, share, &state)[event]
        };
        if exact(beyond) < 0.0 { Some(first_ended(exact, beyond, 0.0)) } else { None }
    }

    /// Where a margin is below zero around the look `i`, if it is lowest there.
    fn dip(&self, leg: &Leg, step: &Step, event: usize, i: usize, looks: &[f64; LOOKS.len()]) -> Option<f64> {
        let near = [i - 1, i, i + 1].map(|i| (LOOKS[i], looks[i]));
        if !may_dip(near) {
            return None;
        }
        let margin =
            |share: f64| self.margins_at(leg, step, share, &step.within(self.model(), &leg.contact, share))[event];
        golden_section(margin, near[0].0, near[2].0)
    }

    /// The first leg from rest, or from coming to rest.
    fn begin_at_rest(&mut self, time: f64, state: State) -> Result<Next, PushRunError> {
        let state = State { omega: 0.0, v_t: 0.0, ..state };
        // A finger at rest that stays at rest pushes nothing: wait for its next change.
        let path = self.model().path();
        if path.acceleration == Vector2::zeros() && path.velocity(time).norm() < SLIP_NONE {
            return self.wait(time, state);
        }
        // The accelerations at the start, in place of (5.21) and (5.22), and the first leg.
        let (contact, start) = self.start_from_rest(time, &state)?;
        let pushed = self.after_rest(time, &contact, &start, &state);
        // The sample at rest has the force of these accelerations; a jammed contact has none.
        let mut sample = self.sample(time, &contact, &state);
        sample.force = Some(start.force());
        if let Next::End(EndReason::Jam) = pushed {
            sample.force = None;
        }
        self.record(sample);
        if let (Start::Rest { .. }, true) = (self.push.start, time == 0.0) {
            // World axes: along N and T, T a quarter turn clockwise from N.
            let normal = normal(self.model(), &state);
            let centre_of_mass = normal * start.a_n + Vector2::new(normal.y, -normal.x) * start.a_t;
            self.rest_start = Some(Acceleration { centre_of_mass, alpha: start.alpha });
        }
        Ok(pushed)
    }

    /// Contact and accelerations of the start from rest.
    fn start_from_rest(&self, time: f64, state: &State) -> Result<(ContactMode, RestStart), RestError> {
        let start = |contact: &ContactMode| rest_start(self.model(), contact, state.u, state.s);
        let law = self.push.law;
        let contact = match law {
            ContactLaw::Frictionless => ContactMode::Frictionless,
            ContactLaw::Rolling { .. } => ContactMode::Rolling,
            ContactLaw::Sliding { slip, .. } => law.sliding(slip),
            ContactLaw::Coulomb { friction } => {
                return ContactFriction::same(friction).begun(self.model().slip(time, state), start);
            }
        };
        Ok((contact, start(&contact)?))
    }

    /// The leg that a start from rest leads to.
    fn after_rest(&mut self, time: f64, contact: &ContactMode, start: &RestStart, state: &State) -> Next {
        let model = self.model();
        // How the slip grows from the finger's own speed.
        let (slip, slip_rate) = (model.slip(time, state), self.slip_rate(start, state));
        match (*contact, self.push.law) {
            (ContactMode::Sliding { friction, slip: direction }, law) => {
                let m = friction * direction.sign();
                let slips = slip_left(slip, direction) >= SLIP_NONE || slip_left(slip_rate, direction) > 0.0;
                if jams(model.sliding_denominator(m, state)) {
                    return Next::End(EndReason::Jam);
                } else if !slips && matches!(law, ContactLaw::Sliding { .. }) {
                    return Next::End(EndReason::Stick);
                }
            }
            (ContactMode::Rolling, law)
                if law.deciding_friction().is_some_and(|friction| friction.unused(&start.force()) < 0.0) =>
            {
                return Next::End(EndReason::Slip);
            }
            _ => {}
        }
        if !start.force().pushes() {
            return Next::End(EndReason::Break);
        }
        let span = REST_SHARE * (model.body().inertia_per_mass().sqrt() / start.a_n.hypot(start.a_t)).sqrt();
        let span = span.min(self.horizon(time) - time);
        let [slipping, starting] =
            [(0.0, slip), (start.alpha, slip_rate)].map(|(omega, slip)| model.contact_rates(state, omega, slip));
        let at = |span: f64| {
            let travelled = |i: usize| slipping[i] * span + 0.5 * span * span * starting[i];
            let (u, s) = (state.u + travelled(0), state.s + travelled(1));
            State { u, s, omega: start.alpha * span, v_t: start.a_t * span }
        };
        while let Some(&asked) =
            self.times.get(self.samples.len()).filter(|&&asked| asked > time && asked < time + span)
        {
            self.record(self.sample(asked, contact, &at(asked - time)));
        }
        self.step = span;
        let none = [SLIP_NONE; EVENTS.len()];
        Next::Leg(Leg { contact: *contact, time: time + span, state: at(span), slack: none })
    }

    /// How the slip begins to grow in a start from rest, m/s².
    fn slip_rate(&self, start: &RestStart, state: &State) -> f64 {
        let (model, normal) = (self.model(), normal(self.model(), state));
        let finger = -normal.perp(&model.path().acceleration);
        finger + arm(model, state).height * start.alpha - start.a_t
    }

    /// Records the times asked for within the first `share` of a step.
    fn sample_step(&mut self, leg: &Leg, step: &Step, share: f64) {
        let last = step.time + share * step.length;
        while let Some(&asked) = self.times.get(self.samples.len()).filter(|&&asked| asked <= last) {
            if self.halt.is_wished() {
                return; // The run ends with that, not with a push that lacks samples.
            }
            let inside = step.again(self.model(), &leg.contact, asked - step.time);
            self.record(self.sample(asked, &leg.contact, &inside.end()));
        }
    }

    /// Keeps a sample if its time is asked for next; it is the last one in any case.
    fn record(&mut self, sample: Sample) {
        if self.times.get(self.samples.len()).is_some_and(|&asked| asked <= sample.t) {
            self.samples.push(sample);
        }
        self.last = sample;
    }

    fn sample(&self, t: f64, contact: &ContactMode, state: &State) -> Sample {
        sample(self.model(), t, contact, state, self.theta_offset)
    }

    fn finish(mut self, reason: EndReason) -> PushRun {
        let end = End { reason, t: self.last.t };
        let at_end = self.samples.iter_mut().filter(|sample| sample.t >= end.t).chain([&mut self.last]);
        for sample in at_end {
            match reason {
                EndReason::Jam => sample.force = None,
                EndReason::Break => sample.force = sample.force.map(ContactForce::lost),
                _ => {}
            }
        }
        let Self { samples, last, changes, rest_start, second_contact, .. } = self;
        PushRun { samples, end, last, changes, rest_start, second_contact }
    }
}

impl ContactForce {
    /// What is left of the force that a finger would need to hold a part it is losing: it cannot pull.
    fn lost(self) -> Self {
        if self.pushes() { self } else { Self { normal: 0.0, tangential: 0.0 } }
    }
}

fn sample<M: ContactModel>(model: &M, t: f64, contact: &ContactMode, state: &State, theta_offset: f64) -> Sample {
    let state = match contact {
        ContactMode::Rolling => State { v_t: model.rolling_v_t(t, state), ..*state },
        ContactMode::Frictionless | ContactMode::Sliding { .. } => *state,
    };
    let motion = model.motion(contact, t, &state);
    let theta = model.theta(&state) + theta_offset;
    let centre_of_mass = model.centre_of_mass(t, &state);
    Sample {
        t,
        state,
        contact: *contact,
        position: centre_of_mass - Rotation2::new(theta) * model.body().centre_of_mass().coords,
        theta,
        velocity: model.velocity(contact, t, &state),
        force: Some(motion.force()),
    }
}

/// Whether a margin with these values, the middle one the lowest, may go down to a share [`DIP_SHARE`] of it between them: a
/// parabola through them does.
fn may_dip([(x0, y0), (x1, y1), (x2, y2)]: [(f64, f64); 3]) -> bool {
    if !(y1.is_finite() && y1 >= 0.0 && y1 <= y0 && y1 <= y2) {
        return false;
    }
    let (left, right) = ((y0 - y1) / (x1 - x0), (y2 - y1) / (x2 - x1));
    let curvature = (left + right) / (x2 - x0);
    // Where the parabola has its minimum, and how deep that is.
    let slope = (right * (x1 - x0) - left * (x2 - x1)) / (x2 - x0);
    // Not a number, and no dip, where all three are the same: many margins of a part that goes straight on.
    y1 - slope * slope / (4.0 * curvature) <= DIP_SHARE * y1
}

/// A share between two others at which a margin is below zero, looked for at its minimum.
fn golden_section(margin: impl Fn(f64) -> f64, from: f64, to: f64) -> Option<f64> {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let (mut from, mut to) = (from, to);
    for _ in 0..SEARCHES_MAX {
        let (left, right) = (to - GOLDEN * (to - from), from + GOLDEN * (to - from));
        let (at_left, at_right) = (margin(left), margin(right));
        match at_left < at_right {
            true if at_left < 0.0 => return Some(left),
            false if at_right < 0.0 => return Some(right),
            true => to = right,
            false => from = left,
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_margins_that_may_use_themselves_up_are_searched_for_a_dip() {
        let at = |y: [f64; 3]| may_dip([(0.25, y[0]), (0.5, y[1]), (0.75, y[2])]);
        // A parabola with its minimum between the looks, at a quarter of the value looked at: (x - 0.4)² + 0.0033.
        assert!(at([0.0258, 0.0133, 0.1258]));
        // One that stays above half of it.
        assert!(!at([0.0458, 0.0333, 0.1458]));
        // What stays as it is, falls, or is never used up.
        assert!(!at([0.7; 3]) && !at([0.0; 3]) && !at([0.3, 0.2, 0.1]) && !at([f64::INFINITY; 3]));
    }
}
