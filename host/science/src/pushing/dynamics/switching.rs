//! Derivatives of a push across its changes between rolling and sliding, and of the instants of these.
//!
//! Follows a run that is done and decides nothing: the modes and when they change are that run's record
//! ([`super::run`], whose steps control their error, which does not go with derivatives). What it shares with others
//! who carry derivatives across a change is [`super::mode_change`].
//!
//! Assumes: as [`super::mode_change`].
//! Units: SI. Errors: [`PushRunError`].

use super::contact_mode::ContactFriction;
use super::mode_change::{Margin, StateWithRates, across};
use super::model::{ContactMode, PushModel, State};
use super::push::{Push, Start};
use super::run::{EndReason, PushRun, PushRunError};
use super::sensitivity::{Parameter, Seeded};
use crate::math::Jet;

/// Step of the Runge–Kutta method that carries the derivatives, s: see [`PushModel::step`] for its error.
const STEP: f64 = 5e-4;

/// Steps in the first such step of a stretch, and how each next is longer: friction changes fastest after a change of
/// contact.
const STEP_FIRST: f64 = 5e-6;
const STEP_GROWTH: f64 = 1.5;

/// A push with its derivatives by `N` parameters.
#[derive(Clone, Debug)]
pub struct DerivedRun<const N: usize> {
    /// The same push without derivatives.
    pub run: PushRun,
    /// States at the times of the run's samples.
    pub states: Vec<State<Jet<N>>>,
    /// When rolling and sliding took turns, s, in the order of the run's changes.
    pub changes: Vec<Jet<N>>,
    /// When the push ended, s; constant if the time was up. Not derived for a jam or a second contact.
    pub end: Option<Jet<N>>,
}

/// A seeded push under way.
struct DerivedSimulation<'p, const N: usize> {
    model: PushModel<'p, Jet<N>>,
    friction: ContactFriction<Jet<N>>,
    contact: ContactMode<Jet<N>>,
    time: f64,
    state: State<Jet<N>>,
}

impl Push<'_> {
    /// [`PushOf::run`](super::PushOf::run) with derivatives by `parameters`, through every change of contact.
    ///
    /// # Errors
    /// [`PushRunError`]; not derivable are starts from rest and fingers that change their acceleration.
    pub fn run_derived<const N: usize>(
        &self,
        times: &[f64],
        parameters: [Parameter; N],
    ) -> Result<DerivedRun<N>, PushRunError> {
        let Start::Moving(start) = self.start else { return Err(PushRunError::NotDerivable { what: "from rest" }) };
        if self.track.change_after(0.0).is_finite() {
            return Err(PushRunError::NotDerivable { what: "by a finger that changes its acceleration" });
        }
        let run = self.run(times)?;
        let first = self.run(&[0.0])?.last;
        let mut simulation = self.simulation(&first.contact, &start, parameters);
        let (mut states, mut changes) = (Vec::new(), Vec::new());
        let mut asked = run.samples.iter().map(|sample| sample.t).peekable();
        for change in &run.changes {
            while let Some(t) = asked.next_if(|t| *t < change.t) {
                states.push(simulation.at(t));
            }
            changes.push(simulation.change(change.t, &change.to));
        }
        states.extend(asked.map(|t| simulation.at(t)));
        simulation.go(run.end.t);
        let end = simulation.end(run.end.reason, run.end.t);
        Ok(DerivedRun { run, states, changes, end })
    }

    fn simulation<const N: usize>(
        &self,
        contact: &ContactMode,
        start: &State,
        parameters: [Parameter; N],
    ) -> DerivedSimulation<'_, N> {
        let friction = self.law.friction();
        let row = parameters.iter().position(|&parameter| parameter == Parameter::ContactFriction);
        let Seeded { model, contact, start } = Seeded::new(&self.model, contact, start, parameters);
        let friction = row.map_or_else(|| Jet::constant(friction), |row| Jet::variable(friction, row));
        let mut simulation =
            DerivedSimulation { model, friction: ContactFriction::same(friction), contact, time: 0.0, state: start };
        simulation.keep_rolling(0.0);
        simulation
    }
}

impl<'p, const N: usize> DerivedSimulation<'p, N> {
    /// In rolling v_T follows from the rest.
    fn keep_rolling(&mut self, time: f64) {
        if matches!(self.contact, ContactMode::Rolling) {
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
    fn change(&mut self, time: f64, to: &ContactMode) -> Jet<N> {
        self.go(time);
        let late = self.late(&Margin::of_mode(&self.contact, self.friction));
        let before = self.model.motion(&self.contact, time, &self.state).rates;
        self.contact = to.map(|_| self.friction.sliding);
        self.state =
            across(&self.model, &self.contact, time, StateWithRates { state: &self.state, rates: &before }, late);
        self.keep_rolling(time);
        late + time
    }

    fn end(&self, reason: EndReason, time: f64) -> Option<Jet<N>> {
        let margin = match reason {
            EndReason::Break => Margin::Force,
            EndReason::Stick => Margin::Slip,
            EndReason::Slip => Margin::Friction(self.friction),
            EndReason::EdgeMin | EndReason::EdgeMax => Margin::Place,
            EndReason::Time => return Some(Jet::constant(time)),
            EndReason::Jam | EndReason::SecondContact => return None,
        };
        Some(self.late(&margin) + time)
    }

    /// When the margin is used up, about now.
    fn late(&self, margin: &Margin<Jet<N>>) -> Jet<N> {
        margin.late(&self.model, &self.contact, self.time, &self.state)
    }
}
