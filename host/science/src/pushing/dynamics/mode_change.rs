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

/// Looks at a margin, at the most: halving alone comes from any bracket to rounding with 60.
const LOOKS_MAX: i32 = 100;

/// Looks that the search may take beyond halving's.
const SLACK: i32 = 2;

/// How far from the zero of a straight line towards the middle is looked, as a share of the first bracket: so many times the
/// square of the bracket's share of it.
const TRUNCATION: f64 = 0.2;

/// The first instant at which a mode has ended, in `(0, beyond]`, to `resolution`: its margin is used up there, or is none
/// any more. At 0 the mode lasts, at `beyond` it has ended. Times are from wherever, in s or as shares of a step.
///
/// Implements: the ITP method (Oliveira and Takahashi 2021, An enhancement of the bisection method average performance preserving
/// minmax optimality): half the looks of halving where the margin is smooth, and two more at the worst.
pub(crate) fn first_ended(margin: impl Fn(f64) -> f64, beyond: f64, resolution: f64) -> f64 {
    let (mut lasts, mut over) = (0.0, beyond);
    let (mut left, mut missing) = (margin(lasts), margin(over));
    let half_width = 0.5 * resolution.max(f64::EPSILON * beyond);
    #[expect(clippy::cast_possible_truncation, reason = "some dozens")]
    let halvings = (0.5 * beyond / half_width).log2().ceil() as i32;
    for look in 0..LOOKS_MAX {
        let (middle, width) = (0.5 * (lasts + over), over - lasts);
        if width <= 2.0 * half_width || middle <= lasts || middle >= over {
            break;
        }
        // After a change the margin of the other side may be 0 by rounding; where there is none, nothing is interpolated.
        let is_straight = left > 0.0 && left.is_finite() && missing.is_finite();
        let zero = if is_straight { lasts + width * left / (left - missing) } else { middle };
        let aside = TRUNCATION * width * (width / beyond);
        let towards = (middle - zero).signum();
        let inner = if aside <= (middle - zero).abs() { zero + towards * aside } else { middle };
        let reach = half_width * 2.0_f64.powi(halvings + SLACK - look) - 0.5 * width;
        let at = if (inner - middle).abs() <= reach { inner } else { middle - towards * reach };
        let at = if at > lasts && at < over { at } else { middle };
        let value = margin(at);
        // What is not a number has ended.
        if value >= 0.0 { (lasts, left) = (at, value) } else { (over, missing) = (at, value) }
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

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Margins that bend either way, or have no value once they are used up.
        #[test]
        fn a_mode_ends_where_its_margin_is_used_up(
            end in 0.001_f64..0.999,
            bend in -0.9_f64..0.9,
            size in 1e-6_f64..1e6,
            resolution in prop::sample::select(vec![1e-3, 5e-6, 1e-10, 0.0]),
            breaks in any::<bool>(),
        ) {
            let looks = Cell::new(0);
            let margin = |at: f64| {
                looks.set(looks.get() + 1);
                let off = end - at;
                if breaks && off < 0.0 { f64::NEG_INFINITY } else { size * off * (1.0 + bend * at) }
            };
            let found = first_ended(margin, 1.0, resolution);
            prop_assert!(found >= end && found - end <= resolution.max(1e-15), "{} {}", found, end);
            // Halving alone takes 18 looks for 5e-6, beside those at both ends.
            prop_assert!(breaks || resolution < 5e-6 || looks.get() <= 11, "{} looks", looks.get());
        }
    }
}
