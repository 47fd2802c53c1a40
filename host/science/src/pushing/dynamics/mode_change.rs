//! When a contact mode comes to its end, and what that does to derivatives.
//!
//! Shared by all who follow a push through changes of mode. What follows is for [`super::contact_mode`] to say.
//!
//! A change at the instant t(p) moves with what a push is derived by, p. To first order the state there is that just
//! before, moved by ẋ₋ dt; the mode changes, at no slip; and back at a fixed time it is moved by −ẋ₊ dt. With dt/dp =
//! −(∂g/∂p)/ġ for the margin g that is used up, this is the saltation matrix I + (ẋ₊ − ẋ₋) ∇g/ġ, times the change's
//! own.
//!
//! Assumes: each margin is used up transversally; a push that only touches one has no derivative there.
//! Units: SI. Errors: none.

use super::contact_mode::ContactFriction;
use super::model::{ContactMode, Finger, PushModel, State};
use super::scalar::Scalar;
use crate::math::Jet;

/// Halvings of a bracket: enough to reach rounding from any.
const HALVINGS_MAX: usize = 80;

/// The first instant at which a mode has ended, in `(0, beyond]`, to `resolution`; at 0 it lasts, at `beyond` it has
/// ended. Times are from wherever, in s or as shares of a step.
pub(crate) fn first_ended(ended: impl Fn(f64) -> bool, beyond: f64, resolution: f64) -> f64 {
    let (mut lasts, mut over) = (0.0, beyond);
    for _ in 0..HALVINGS_MAX {
        let middle = 0.5 * (lasts + over);
        if middle <= lasts || middle >= over || over - lasts < resolution {
            break;
        }
        if ended(middle) { over = middle } else { lasts = middle }
    }
    over
}

/// What is used up at a change, or at the end of a push.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Margin<T> {
    /// Force into the part, m/s².
    Force,
    /// The slip, m/s; sliding ends where it is 0.
    Slip,
    /// Friction that is left, m/s².
    Friction(ContactFriction<T>),
    /// Place on the edge, m: from wherever.
    Place,
}

impl<T: Scalar> Margin<T> {
    /// What is used up where a mode gives way to another.
    pub(crate) fn of_mode(mode: &ContactMode<T>, friction: ContactFriction<T>) -> Self {
        match mode {
            ContactMode::Sliding { .. } => Self::Slip,
            ContactMode::Rolling | ContactMode::Frictionless => Self::Friction(friction),
        }
    }

    fn at(&self, model: &PushModel<T>, contact: &ContactMode<T>, time: f64, state: &State<T>) -> T {
        match self {
            Self::Force => model.motion(contact, time, state).normal_force,
            Self::Slip => model.slip(time, state),
            Self::Place => state.s,
            Self::Friction(friction) => friction.unused(&model.motion(contact, time, state).force()),
        }
    }

    /// How much later than now the margin is used up, s, to first order: 0, with the derivatives of the instant.
    pub(crate) fn late(&self, model: &PushModel<T>, contact: &ContactMode<T>, time: f64, state: &State<T>) -> T {
        let now = self.at(model, contact, time, state);
        (now - now.re()) * (-1.0 / self.rate(model, contact, time, state))
    }

    /// How fast the margin changes along the motion.
    fn rate(&self, model: &PushModel<T>, contact: &ContactMode<T>, time: f64, state: &State<T>) -> f64 {
        let flat = |number: T| Jet::<1>::constant(number.re());
        let late = Jet::<1>::variable(0.0, 0);
        let PushModel { part, edge, mu_g, finger } = *model;
        let Finger { radius, centre0, velocity0, acceleration } = finger;
        let (velocity0, acceleration) = (velocity0.map(flat), acceleration.map(flat));
        let finger = Finger { radius, centre0, velocity0, acceleration };
        let model = later(&PushModel { part, edge, mu_g: flat(mu_g), finger }, late);
        let contact = contact.map(flat);
        let now = state.map(flat);
        let rates = model.motion(&contact, time, &now).rates;
        let mut ahead = moved(&now, &rates, late);
        if matches!(contact, ContactMode::Rolling) {
            ahead.v_t = model.rolling_v_t(time, &ahead);
        }
        self.map(flat).at(&model, &contact, time, &ahead).slopes[0]
    }

    fn map<U>(&self, convert: impl Fn(T) -> U) -> Margin<U> {
        match *self {
            Self::Force => Margin::Force,
            Self::Slip => Margin::Slip,
            Self::Friction(friction) => Margin::Friction(friction.map(convert)),
            Self::Place => Margin::Place,
        }
    }
}

/// A state and how fast it changes.
#[derive(Clone, Copy)]
pub(crate) struct StateWithRates<'a, T> {
    /// The state on this side of the change.
    pub(crate) state: &'a State<T>,
    /// Its rates, per second.
    pub(crate) rates: &'a State<T>,
}

/// The state on the other side of a change of mode, given that on this side and its rates: the change is now or, for
/// what carries derivatives, so much `late`.
pub(crate) fn across<T: Scalar>(
    model: &PushModel<T>,
    to: &ContactMode<T>,
    time: f64,
    StateWithRates { state, rates }: StateWithRates<'_, T>,
    late: T,
) -> State<T> {
    let mut there = moved(state, rates, late);
    // There is no slip at the change; the finger is as fast as it is then.
    let model = later(model, late);
    there.v_t = model.rolling_v_t(time, &there);
    let after = model.motion(to, time, &there).rates;
    moved(&there, &after, -late)
}

/// The model with a finger as fast as it will be so much later.
fn later<'p, T: Scalar>(model: &PushModel<'p, T>, late: T) -> PushModel<'p, T> {
    let mut model = *model;
    let acceleration = model.finger.acceleration;
    model.finger.velocity0 = model.finger.velocity0.zip_map(&acceleration, |v, a| v + a * late);
    model
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
