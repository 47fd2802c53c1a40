//! The slow manifold: the motion that a pushed part settles to within the time in which friction forgets speed.
//!
//! After it, angular velocity and velocity along the contact follow from where the contact is: they are where support
//! friction balances the push, so that neither changes quickly. Newton's method on the rates of the full dynamics finds
//! them.
//!
//! Frames: world. Units: SI. Errors: none; a start from which the iteration does not settle has no motion.

use nalgebra::{SMatrix, SVector};

use crate::math::Jet;
use crate::pushing::dynamics::contact_mode::ContactFriction;
use crate::pushing::dynamics::{ContactForce, ContactMode, PushModel, Slip, State};
use crate::pushing::estimation::observation::Touch;

/// Iterations: the friction law is convex, and from a neighbouring place two or three suffice; from afar it takes more.
const ITERATIONS_MAX: usize = 20;

/// Halvings of a step that does not improve.
const HALVINGS_MAX: u32 = 10;

/// Residual over the friction's deceleration at which it is balanced: seeds need no more.
const BALANCED: f64 = 1e-3;

/// A motion on the slow manifold.
#[derive(Clone, Copy, Debug)]
pub(super) struct Settled {
    /// The state, with its rates of turning and along the contact.
    pub(super) state: State,
    /// Force into the part and along the edge, m/s².
    pub(super) normal_force: f64,
    /// Force along the edge, counter-clockwise, m/s².
    pub(super) tangential_force: f64,
}

impl Settled {
    /// The force on the part.
    fn force(&self) -> ContactForce {
        ContactForce { normal: self.normal_force, tangential: self.tangential_force }
    }
}

/// The settled motion at a contact, sought from a neighbouring one, or else from what a blow would make of a part at
/// rest.
pub(super) fn settled(model: &PushModel, touch: Touch, slip: Option<Slip>, time: f64, near: &State) -> Option<Settled> {
    let from = |near: &State| settled_from(model, touch, slip, time, near);
    let pushed = |found: &Settled| found.normal_force > 0.0;
    // The rates may vanish at a second place, where the part would spin and the finger pull: no part settles to that.
    let near_by = from(near);
    if near_by.as_ref().is_some_and(pushed) {
        return near_by;
    }
    from(&struck(model, time, near)).filter(pushed).or(near_by)
}

/// The motion of a part at rest that a moving finger without friction strikes: near the settled one also where that
/// turns about a point inside the part, which Newton's steps from far away miss.
fn struck(model: &PushModel, time: f64, at: &State) -> State {
    let ((sin, cos), [x, y]) = (at.u.sin_cos(), model.finger.velocity(time).into());
    let into = cos * x + sin * y;
    State { omega: into * at.s / (model.part.inertia_per_mass() + at.s * at.s), v_t: 0.0, ..*at }
}

fn settled_from(model: &PushModel, touch: Touch, slip: Option<Slip>, time: f64, near: &State) -> Option<Settled> {
    match (touch, slip) {
        (Touch::Frictionless, _) => settle::<2>(model, &ContactMode::Frictionless, time, near),
        (Touch::Rolling { .. }, _) => settle::<1>(model, &ContactMode::Rolling, time, near),
        (Touch::Sliding { friction } | Touch::Coulomb { friction }, Some(slip)) => {
            settle::<2>(model, &ContactMode::Sliding { friction, slip }, time, near)
        }
        (Touch::Sliding { .. }, None) => None,
        (Touch::Coulomb { friction }, None) => {
            let rolling = settle::<1>(model, &ContactMode::Rolling, time, near)?;
            match ContactFriction::same(friction).without_slip(&rolling.force()) {
                ContactMode::Rolling => Some(rolling),
                sliding => settle::<2>(model, &sliding, time, &rolling.state),
            }
        }
    }
}

/// Newton's method on the first `K` of ω and v_T.
fn settle<const K: usize>(model: &PushModel, contact: &ContactMode, time: f64, near: &State) -> Option<Settled> {
    let dual = model.lifted::<Jet<K>>();
    let contact = contact.map(Jet::constant);
    // Velocities as the speeds they give the radius of gyration, so that all are alike.
    let radius = model.part.inertia_per_mass().sqrt();
    let place = |x: &SVector<f64, K>| State {
        u: near.u,
        s: near.s,
        omega: x[0] / radius,
        v_t: if K > 1 { x[K - 1] } else { near.v_t },
    };
    // Rates with their derivatives by ω and v_T.
    let motion = |x: &SVector<f64, K>| {
        let State { u, s, omega, v_t } = place(x);
        let state = State {
            u: Jet::constant(u),
            s: Jet::constant(s),
            omega: Jet::variable(omega * radius, 0) / radius,
            v_t: Jet::variable(v_t, 1),
        };
        dual.motion(&contact, time, &state)
    };
    let mut x = SVector::<f64, K>::from_fn(|i, _| if i == 0 { near.omega * radius } else { near.v_t });
    let mut now = motion(&x);
    // On the slow manifold they do not change: ω̇ = 0 and, where the contact can slip, v̇_T = 0.
    let residual = |rates: &State<Jet<K>>| {
        let rows = [rates.omega * radius, rates.v_t];
        let values = SVector::<f64, K>::from_fn(|i, _| rows[i].value);
        let slopes = SMatrix::<f64, K, K>::from_fn(|i, j| rows[i].slopes[j]);
        (values, slopes)
    };
    let (mut off, mut slopes) = residual(&now.rates);
    for _ in 0..ITERATIONS_MAX {
        if off.norm() <= BALANCED * model.mu_g {
            break;
        }
        // Newton's step, halved until the residual falls.
        let newton = slopes.try_inverse()? * off;
        let tries = (0..HALVINGS_MAX).map(|halvings| x - newton * 0.5_f64.powi(halvings.cast_signed()));
        let better = tries.map(|x| (x, motion(&x))).find_map(|(x, motion)| {
            let (values, slopes) = residual(&motion.rates);
            (values.norm() < off.norm()).then_some((x, motion, values, slopes))
        });
        (x, now, off, slopes) = better?;
    }
    if off.norm() > BALANCED.sqrt() * model.mu_g || off.norm().is_nan() {
        return None;
    }
    // Rolling, v_T follows from ω (5.31).
    let state = place(&x);
    let state = if matches!(contact, ContactMode::Rolling) {
        State { v_t: model.rolling_v_t(time, &state), ..state }
    } else {
        state
    };
    Some(Settled { state, normal_force: now.normal_force.value, tangential_force: now.tangential_force.value })
}
