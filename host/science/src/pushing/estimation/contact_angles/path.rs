//! The way a part takes from a hypothetical start, as the data see it, with derivatives by the start where wanted.
//!
//! The hot path of the search, hence a simulation of its own: numbers with or without derivatives, at knots that do not
//! depend on the start, so that costs are smooth in it; values interpolated between few knots; what a contact cannot do
//! is a constraint and no end. Shared with the others who follow a push are the equations, the rule which mode follows,
//! the search for its instant and the derivatives' way across ([`crate::pushing::dynamics::contact_mode`],
//! [`crate::pushing::dynamics::mode_change`]).
//!
//! Implements: the classical Runge–Kutta method of order 4 between the knots of a [`Clock`]; the contact angle between
//! knots by the quintic through angle, rate and acceleration at both ends; Coulomb's changes between rolling and
//! sliding, located within a step, where the derivatives jump by (f₋ − f₊) ∂t/∂p (f₋ and f₊ the rates on both sides, t
//! the instant).
//! Assumes: the contact lasts. Where it would not, shows in the path's [`ConstraintMargins`].
//! Frames: world. Units: SI, forces per unit mass. Errors: none; a motion without a physical force is no path.

use super::clock::Clock;
use crate::math::ode;
use crate::pushing::dynamics::contact_mode::{ContactFriction, jams, slip_left};
use crate::pushing::dynamics::mode_change::{Margin, StateWithRates, across, first_ended};
use crate::pushing::dynamics::{ContactMode, Edge, Motion, PushModel, Scalar, State};
use crate::pushing::estimation::observation::{Known, Touch};
use crate::search::Halt;

/// Changes between rolling and sliding in one path: more are chatter of a motion that no real contact makes.
const CHANGES_MAX: usize = 20;

/// How near to a step's ends an instant of change is taken for the end itself, as a share of the step.
const SHARE_NONE: f64 = 1e-10;

/// The first step after a change, as a share of the usual one; the following double.
const SHARE_AFTER_CHANGE: f64 = 0.125;

/// What a contact must stay within, in the order of [`ConstraintMargins`].
pub(in crate::pushing::estimation) const CONSTRAINTS: usize = 5;

/// How far inside each limit the path stayed, at the least: from the allowed stretch of the edge (m, two ends), force
/// into the part (m/s²), friction left unused (m/s²), slip in the assumed direction (m/s).
pub(in crate::pushing::estimation) type ConstraintMargins<T> = [T; CONSTRAINTS];

/// Where on an edge the disk can be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::pushing::estimation) struct ContactInterval {
    /// Of a straight side the first edge.
    pub(in crate::pushing::estimation) index: usize,
    /// The edge itself, body axes.
    pub(in crate::pushing::estimation) edge: Edge,
    /// Least s that the disk reaches, m.
    pub(in crate::pushing::estimation) low: f64,
    /// Greatest s that the disk reaches, m.
    pub(in crate::pushing::estimation) high: f64,
}

impl ContactInterval {
    /// m.
    pub(in crate::pushing::estimation) fn length(&self) -> f64 {
        self.high - self.low
    }
}

/// How a path begins.
#[derive(Clone, Copy, Debug)]
pub(in crate::pushing::estimation) struct InitialState<T> {
    /// When, s: later than 0 only from rest.
    pub(in crate::pushing::estimation) time: f64,
    /// The state at that time.
    pub(in crate::pushing::estimation) state: State<T>,
    /// The contact from that time on.
    pub(in crate::pushing::estimation) contact: ContactMode<T>,
    /// From rest: contact angle at t = 0 and half the angular acceleration since then.
    pub(in crate::pushing::estimation) rest: Option<(T, T)>,
    /// µ g of the plane, m/s².
    pub(in crate::pushing::estimation) mu_g: T,
}

/// The end of a path, and how it kept to its limits.
#[derive(Clone, Copy, Debug)]
pub(in crate::pushing::estimation) struct Path<T> {
    /// At the last value.
    pub(in crate::pushing::estimation) end: State<T>,
    /// At the last value.
    pub(in crate::pushing::estimation) contact: ContactMode<T>,
    /// Margins at their least.
    pub(in crate::pushing::estimation) constraint_margins: ConstraintMargins<T>,
}

/// What is seen of a path at the time of a value.
#[derive(Clone, Copy, Debug)]
pub(in crate::pushing::estimation) struct Seen<T> {
    /// Contact angle, rad.
    pub(in crate::pushing::estimation) u: T,
    /// Force into the part and along the edge, m/s²; right only where the value has a knot.
    pub(in crate::pushing::estimation) normal_force: T,
    /// Force along the edge, counter-clockwise, m/s²; right like `normal_force`.
    pub(in crate::pushing::estimation) tangential_force: T,
}

/// A path being followed.
struct PathSimulation<'a, 'p, T: Scalar, F> {
    model: PushModel<'p, T>,
    /// The same without derivatives.
    plain: PushModel<'p>,
    touch: Touch,
    interval: &'a ContactInterval,
    clock: &'a Clock,
    halt: &'a Halt<'a>,
    see: F,
    next_value: usize,
    constraint_margins: ConstraintMargins<T>,
    changes: usize,
}

/// Everything at one instant.
#[derive(Clone, Copy)]
struct Now<T> {
    time: f64,
    state: State<T>,
    contact: ContactMode<T>,
    motion: Motion<T>,
}

impl<T> Now<T> {
    fn state_with_rates(&self) -> StateWithRates<'_, T> {
        StateWithRates { state: &self.state, rates: &self.motion.rates }
    }
}

/// Follows a path to the last value and shows `see` what each value would be. None if no force fits on the way, or if it
/// should halt there.
pub(in crate::pushing::estimation) fn follow<T: Scalar>(
    known: &Known,
    interval: &ContactInterval,
    initial_state: &InitialState<T>,
    clock: &Clock,
    halt: &Halt<'_>,
    see: impl FnMut(usize, Seen<T>),
) -> Option<Path<T>> {
    let plain = PushModel { mu_g: initial_state.mu_g.re(), ..known.model(interval.edge) };
    let model = PushModel { mu_g: initial_state.mu_g, ..plain.lifted() };
    let constraint_margins = [T::from(f64::INFINITY); CONSTRAINTS];
    let mut simulation = PathSimulation {
        model,
        plain,
        touch: known.touch,
        interval,
        clock,
        halt,
        see,
        next_value: 0,
        constraint_margins,
        changes: 0,
    };
    simulation.walk(initial_state)
}

/// The contact without derivatives.
pub(in crate::pushing::estimation) fn plain_contact<T: Scalar>(contact: &ContactMode<T>) -> ContactMode {
    contact.map(|friction| friction.re())
}

/// A state without derivatives.
pub(in crate::pushing::estimation) fn plain_state<T: Scalar>(state: &State<T>) -> State {
    state.map(|number| number.re())
}

/// One step of the Runge–Kutta method from known rates.
fn step<T: Scalar>(
    model: &PushModel<T>,
    contact: &ContactMode<T>,
    time: f64,
    StateWithRates { state, rates }: StateWithRates<'_, T>,
    dt: f64,
) -> State<T> {
    ode::step_from(state, rates, dt, |moment, state| model.motion(contact, moment.time(time, dt), state).rates)
}

impl<T: Scalar, F: FnMut(usize, Seen<T>)> PathSimulation<'_, '_, T, F> {
    fn walk(&mut self, initial_state: &InitialState<T>) -> Option<Path<T>> {
        self.see_rest(initial_state);
        let mut now = self.at(initial_state.time, initial_state.state, initial_state.contact)?;
        self.see_exactly(&now);
        for i in 1..self.clock.knots.len() {
            self.halt.goes_on()?;
            now = self.reach(now, self.clock.knots[i])?;
        }
        let mut end = now.state;
        if matches!(now.contact, ContactMode::Rolling) {
            end.v_t = self.model.rolling_v_t(now.time, &end);
        }
        Some(Path { end, contact: now.contact, constraint_margins: self.constraint_margins })
    }

    /// Shows the values before a start from rest.
    fn see_rest(&mut self, initial_state: &InitialState<T>) {
        let Some((u, half_alpha)) = initial_state.rest else { return };
        while self.next_value < self.clock.values && self.clock.time_of(self.next_value) < initial_state.time {
            let t = self.clock.time_of(self.next_value);
            let seen = Seen { u: u + half_alpha * (t * t), normal_force: T::from(1.0), tangential_force: T::from(0.0) };
            (self.see)(self.next_value, seen);
            self.next_value += 1;
        }
    }

    /// A state with what it leads to; none where no force fits (a jam, or numbers out of range).
    fn at(&mut self, time: f64, state: State<T>, contact: ContactMode<T>) -> Option<Now<T>> {
        if let ContactMode::Sliding { friction, slip } = contact
            && jams(self.model.sliding_denominator(friction * slip.sign(), state.s).re())
        {
            return None;
        }
        let motion = self.model.motion(&contact, time, &state);
        let now = Now { time, state, contact, motion };
        let sound = motion.rates.omega.re().is_finite() && state.u.re().is_finite() && state.s.re().is_finite();
        sound.then(|| {
            self.note_constraint_margins(&now);
            now
        })
    }

    fn note_constraint_margins(&mut self, now: &Now<T>) {
        let Now { time, state, contact, motion } = now;
        // A margin that the mode has not stays infinite: the cone of (5.30) in rolling, the slip left in sliding.
        let never = T::from(f64::INFINITY);
        let (mut cone, mut slipping) = (never, never);
        match (contact, self.touch) {
            (ContactMode::Rolling, Touch::Rolling { friction: Some(friction) }) => {
                cone = ContactFriction::same(T::from(friction)).unused(&motion.force());
            }
            (ContactMode::Sliding { slip, .. }, Touch::Sliding { .. }) => {
                slipping = slip_left(self.model.slip(*time, state), *slip);
            }
            _ => {}
        }
        // Both ends of the interval, the normal force (5.5), cone and slip: the least of each along the path is kept.
        let margins =
            [state.s - self.interval.low, -(state.s - self.interval.high), motion.normal_force, cone, slipping];
        for (least, margin) in self.constraint_margins.iter_mut().zip(margins) {
            if margin.re() < least.re() {
                *least = margin;
            }
        }
    }

    fn see_exactly(&mut self, now: &Now<T>) {
        let at_value = self.next_value < self.clock.values && self.clock.time_of(self.next_value) <= now.time;
        if at_value {
            self.show(now.state.u, &now.motion);
        }
    }

    fn show(&mut self, u: T, motion: &Motion<T>) {
        let seen = Seen { u, normal_force: motion.normal_force, tangential_force: motion.tangential_force };
        (self.see)(self.next_value, seen);
        self.next_value += 1;
    }

    /// From one instant to another, through changes of the contact. After a change, steps begin small: the force has
    /// jumped.
    fn reach(&mut self, mut now: Now<T>, until: f64) -> Option<Now<T>> {
        let (whole, mut share) = (until - now.time, 1.0);
        loop {
            let left = until - now.time;
            // The last piece may be half as long again, so that none is tiny.
            let length = if left <= 1.5 * share * whole { left } else { share * whole };
            let state = step(&self.model, &now.contact, now.time, now.state_with_rates(), length);
            let there = self.changing(&now, length, &plain_state(&state));
            // Nothing changes within the step: take it, and the next may be twice as long.
            let Some(there) = there else {
                let time = if length < left { now.time + length } else { until };
                let next = self.at(time, state, now.contact)?;
                self.see_between(&now, &next);
                if length >= left {
                    return Some(next);
                }
                (now, share) = (next, 2.0 * share);
                continue;
            };
            // The contact changes at a share of the step: go there, and on in the new mode.
            now = self.change(&now, there, length)?;
            share = SHARE_AFTER_CHANGE;
            if until - now.time <= SHARE_NONE * whole {
                return Some(now);
            }
        }
    }

    /// What must stay positive for the contact to stay as it is, where Coulomb's law decides that.
    fn margin(&self, contact: &ContactMode, time: f64, state: &State) -> f64 {
        let Some(friction) = self.touch.deciding_friction() else { return f64::INFINITY };
        friction.left(contact, || self.plain.slip(time, state), || self.plain.motion(contact, time, state).force())
    }

    /// The share of a step after which the contact changes.
    fn changing(&self, now: &Now<T>, length: f64, after: &State) -> Option<f64> {
        let contact = plain_contact(&now.contact);
        let end = self.margin(&contact, now.time + length, after);
        if end >= 0.0 || end.is_nan() {
            return None;
        }
        Some(first_ended(|share| self.margin_within(now, length, share), 1.0, SHARE_NONE))
    }

    /// The margin after a share of a step.
    fn margin_within(&self, now: &Now<T>, length: f64, share: f64) -> f64 {
        let (contact, state) = (plain_contact(&now.contact), plain_state(&now.state));
        let rates = plain_state(&now.motion.rates);
        let dt = share * length;
        let within = step(&self.plain, &contact, now.time, StateWithRates { state: &state, rates: &rates }, dt);
        self.margin(&contact, now.time + dt, &within)
    }

    /// Passes to the next contact after a share of a step.
    fn change(&mut self, now: &Now<T>, share: f64, length: f64) -> Option<Now<T>> {
        let friction = self.touch.deciding_friction()?.map(T::from);
        self.changes += 1;
        if self.changes > CHANGES_MAX {
            return None;
        }
        let time = now.time + share * length;
        let mut state = step(&self.model, &now.contact, now.time, now.state_with_rates(), share * length);
        let before = self.at(time, state, now.contact)?;
        self.see_between(now, &before);
        let rolling = self.model.motion(&ContactMode::Rolling, time, &state).force();
        let contact = friction.after(&now.contact, &rolling);
        if matches!(now.contact, ContactMode::Rolling) {
            // Where rolling ends the force is that of sliding: nothing jumps.
            state.v_t = self.model.rolling_v_t(time, &state);
            return self.at(time, state, contact);
        }
        let late = Margin::of_mode(&now.contact, friction).late(&self.model, &now.contact, time, &state);
        let state =
            across(&self.model, &contact, time, StateWithRates { state: &state, rates: &before.motion.rates }, late);
        self.at(time, state, contact)
    }

    /// Shows the values between two instants.
    fn see_between(&mut self, from: &Now<T>, to: &Now<T>) {
        let length = to.time - from.time;
        while self.next_value < self.clock.values {
            let time = self.clock.time_of(self.next_value);
            if time > to.time + SHARE_NONE * self.clock.dt {
                return;
            }
            let u = if length > 0.0 { quintic(from, to, length, (time - from.time) / length) } else { to.state.u };
            self.show(u, &to.motion);
        }
    }
}

/// The contact angle at a share of a step, by Hermite's interpolation of angle, rate and acceleration.
fn quintic<T: Scalar>(from: &Now<T>, to: &Now<T>, length: f64, x: f64) -> T {
    let (x2, x3) = (x * x, x * x * x);
    let (x4, x5) = (x2 * x2, x2 * x3);
    let rise = 10.0 * x3 - 15.0 * x4 + 6.0 * x5;
    from.state.u * (1.0 - rise)
        + to.state.u * rise
        + from.state.omega * (length * (x - 6.0 * x3 + 8.0 * x4 - 3.0 * x5))
        + to.state.omega * (length * (-4.0 * x3 + 7.0 * x4 - 3.0 * x5))
        + from.motion.rates.omega * (length * length * 0.5 * (x2 - 3.0 * x3 + 3.0 * x4 - x5))
        + to.motion.rates.omega * (length * length * 0.5 * (x3 - 2.0 * x4 + x5))
}
