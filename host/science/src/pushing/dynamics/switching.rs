//! Derivatives of a push across its changes between rolling and sliding, and of the instants of these.
//!
//! A change at the instant t(p) moves with the parameters p. To first order the state there is that just before, moved by
//! ẋ₋ dt; the contact changes (a slip that has come to zero stays zero); and back at a fixed time it is moved by −ẋ₊ dt. With
//! dt/dp = −(∂g/∂p)/ġ for the margin g that is used up, this is the saltation matrix I + (ẋ₊ − ẋ₋) ∇g/ġ, times the change's own.
//!
//! Assumes: each margin is used up transversally; a push that only touches one has no derivative there.
//! Units: SI. Errors: [`RunError`].

use super::model::{Contact, PushModel, State};
use super::push::{ContactLaw, Push, Start};
use super::run::{EndReason, Run, RunError};
use super::scalar::Scalar;
use super::sensitivity::{Parameter, Seeded};
use crate::math::Jet;

/// Step of the Runge–Kutta method that carries the derivatives, s: see [`PushModel::step`] for its error.
const STEP: f64 = 5e-4;

/// Steps in the first such step of a stretch, and how each next is longer: friction changes fastest after a change of contact.
const STEP_FIRST: f64 = 5e-6;
const STEP_GROWTH: f64 = 1.5;

/// A push with its derivatives by `N` parameters.
#[derive(Clone, Debug)]
pub struct DerivedRun<const N: usize> {
    /// The push.
    pub run: Run,
    /// States at the times of the run's samples.
    pub states: Vec<State<Jet<N>>>,
    /// When rolling and sliding took turns, s, in the order of the run's changes.
    pub changes: Vec<Jet<N>>,
    /// When the push ended, s; constant if the time was up. Not derived for a jam or a second contact.
    pub end: Option<Jet<N>>,
}

/// What is used up at a change.
#[derive(Clone, Copy, Debug)]
enum Margin<T> {
    Force,
    Slip,
    /// Friction that is left, with µ_c.
    Cone(T),
    Place,
}

/// A seeded push under way.
struct Carrier<'p, const N: usize> {
    model: PushModel<'p, Jet<N>>,
    friction: Jet<N>,
    contact: Contact<Jet<N>>,
    time: f64,
    state: State<Jet<N>>,
}

impl Push<'_> {
    /// [`PushOf::run`](super::PushOf::run) with derivatives by `parameters`, through every change of contact.
    ///
    /// # Errors
    /// [`RunError`]; not derivable are starts from rest and fingers that change their acceleration.
    pub fn run_derived<const N: usize>(
        &self,
        times: &[f64],
        parameters: [Parameter; N],
    ) -> Result<DerivedRun<N>, RunError> {
        let Start::Moving(start) = self.start else { return Err(RunError::NotDerivable { what: "from rest" }) };
        if self.track.change_after(0.0).is_finite() {
            return Err(RunError::NotDerivable { what: "by a finger that changes its acceleration" });
        }
        let run = self.run(times)?;
        let first = self.run(&[0.0])?.last;
        let mut carrier = self.carrier(&first.contact, &start, parameters);
        let (mut states, mut changes) = (Vec::new(), Vec::new());
        let mut asked = run.samples.iter().map(|sample| sample.t).peekable();
        for change in &run.changes {
            while let Some(t) = asked.next_if(|t| *t < change.t) {
                states.push(carrier.at(t));
            }
            changes.push(carrier.change(change.t, &change.to));
        }
        states.extend(asked.map(|t| carrier.at(t)));
        carrier.go(run.end.t);
        let end = carrier.end(run.end.reason, run.end.t);
        Ok(DerivedRun { run, states, changes, end })
    }

    fn carrier<const N: usize>(&self, contact: &Contact, start: &State, parameters: [Parameter; N]) -> Carrier<'_, N> {
        let friction = match self.law {
            ContactLaw::Frictionless => 0.0,
            ContactLaw::Rolling { friction } => friction.unwrap_or(0.0),
            ContactLaw::Sliding { friction, .. } | ContactLaw::Coulomb { friction } => friction,
        };
        let row = parameters.iter().position(|&parameter| parameter == Parameter::ContactFriction);
        let Seeded { model, contact, start } = Seeded::new(&self.model, contact, start, parameters);
        let friction = row.map_or_else(|| Jet::constant(friction), |row| Jet::variable(friction, row));
        let mut carrier = Carrier { model, friction, contact, time: 0.0, state: start };
        carrier.keep_rolling(0.0);
        carrier
    }
}

impl<'p, const N: usize> Carrier<'p, N> {
    /// In rolling v_T follows from the rest.
    fn keep_rolling(&mut self, time: f64) {
        if matches!(self.contact, Contact::Rolling) {
            self.state.v_t = self.model.rolling_v_t(time, &self.state);
        }
    }

    /// Carries the state to `until`, s.
    fn go(&mut self, until: f64) {
        let mut step = STEP_FIRST;
        while self.time < until {
            let dt = step.min(until - self.time);
            self.state = self.model.step(&self.contact, self.time, &self.state, dt);
            self.time = if dt < step { until } else { self.time + dt };
            step = (step * STEP_GROWTH).min(STEP);
        }
        self.keep_rolling(self.time);
    }

    fn at(&mut self, time: f64) -> State<Jet<N>> {
        self.go(time);
        self.state
    }

    /// Changes the contact at the instant that has the value `time` and returns it with its derivatives.
    fn change(&mut self, time: f64, to: &Contact) -> Jet<N> {
        self.go(time);
        let margin = match self.contact {
            Contact::Sliding { .. } => Margin::Slip,
            _ => Margin::Cone(self.friction),
        };
        let instant = self.instant(&margin);
        let late = instant - time;
        let before = self.model.motion(&self.contact, time, &self.state).rates;
        self.state = moved(&self.state, &before, late);
        self.contact = match *to {
            Contact::Sliding { slip, .. } => Contact::Sliding { friction: self.friction, slip },
            Contact::Rolling => Contact::Rolling,
            Contact::Frictionless => Contact::Frictionless,
        };
        // There is no slip at the change; the finger is as fast as it is then.
        let shifted = self.later(late);
        self.state.v_t = shifted.rolling_v_t(time, &self.state);
        let after = shifted.motion(&self.contact, time, &self.state).rates;
        self.state = moved(&self.state, &after, -late);
        self.keep_rolling(time);
        instant
    }

    fn end(&self, reason: EndReason, time: f64) -> Option<Jet<N>> {
        let margin = match reason {
            EndReason::Break => Margin::Force,
            EndReason::Stick => Margin::Slip,
            EndReason::Slip => Margin::Cone(self.friction),
            EndReason::EdgeMin | EndReason::EdgeMax => Margin::Place,
            EndReason::Time => return Some(Jet::constant(time)),
            EndReason::Jam | EndReason::SecondContact => return None,
        };
        Some(self.instant(&margin))
    }

    /// When the margin is used up, about now.
    fn instant(&self, margin: &Margin<Jet<N>>) -> Jet<N> {
        let now = margin.of(&self.model, &self.contact, self.time, &self.state);
        let rate = self.rate(margin);
        Jet::constant(self.time) + now.chain(0.0, -1.0 / rate)
    }

    /// How fast the margin changes along the motion.
    fn rate(&self, margin: &Margin<Jet<N>>) -> f64 {
        let flat = |jet: Jet<N>| Jet::<1>::constant(jet.value);
        let finger = &self.model.finger;
        let late = Jet::<1>::variable(0.0, 0);
        let model = PushModel {
            part: self.model.part,
            edge: self.model.edge,
            grip: flat(self.model.grip),
            finger: super::Finger {
                radius: finger.radius,
                centre0: finger.centre0,
                velocity0: [0, 1].map(|i| flat(finger.velocity0[i]) + flat(finger.acceleration[i]) * late),
                acceleration: finger.acceleration.map(flat),
            },
        };
        let contact = match self.contact {
            Contact::Sliding { friction, slip } => Contact::Sliding { friction: flat(friction), slip },
            Contact::Rolling => Contact::Rolling,
            Contact::Frictionless => Contact::Frictionless,
        };
        let State { u, s, omega, v_t } = self.state;
        let plain = State { u: flat(u), s: flat(s), omega: flat(omega), v_t: flat(v_t) };
        let rates = model.motion(&contact, self.time, &plain).rates;
        let mut ahead = moved(&plain, &rates, late);
        if matches!(contact, Contact::Rolling) {
            ahead.v_t = model.rolling_v_t(self.time, &ahead);
        }
        let margin = match margin {
            Margin::Cone(friction) => Margin::Cone(flat(*friction)),
            Margin::Force => Margin::Force,
            Margin::Slip => Margin::Slip,
            Margin::Place => Margin::Place,
        };
        margin.of(&model, &contact, self.time, &ahead).slopes[0]
    }

    /// The model with a finger as fast as it will be so much later.
    fn later(&self, late: Jet<N>) -> PushModel<'p, Jet<N>> {
        let mut model = self.model;
        let acceleration = model.finger.acceleration;
        model.finger.velocity0 = [0, 1].map(|i| model.finger.velocity0[i] + acceleration[i] * late);
        model
    }
}

impl<T: Scalar> Margin<T> {
    fn of(&self, model: &PushModel<T>, contact: &Contact<T>, time: f64, state: &State<T>) -> T {
        let motion = || model.motion(contact, time, state);
        match self {
            Self::Force => motion().normal_force,
            Self::Slip => model.slip(time, state),
            Self::Place => state.s,
            Self::Cone(friction) => {
                let motion = motion();
                let along = motion.tangential_force;
                *friction * motion.normal_force - if along.re() < 0.0 { -along } else { along }
            }
        }
    }
}

/// A state so much later at these rates.
fn moved<T: Scalar>(state: &State<T>, rates: &State<T>, late: T) -> State<T> {
    State {
        u: state.u + rates.u * late,
        s: state.s + rates.s * late,
        omega: state.omega + rates.omega * late,
        v_t: state.v_t + rates.v_t * late,
    }
}
