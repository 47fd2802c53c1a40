//! How a pushed part accelerates, and the force at its contact.
//!
//! Implements: thesis §5.2.1 (frictionless), §5.4.1 (rolling), §5.4.2 (sliding), in a form that is regular everywhere:
//! no division by s, signed h. With N = −(cos u, sin u) the part's outward normal at the contact, T = (−sin u, cos u),
//! c = hN − sT the contact seen from the centre of mass, v_N = v_FN + sω, m = µ_c times the sign of the slip along the
//! edge, and (f, τ) = µg · (mean direction of motion under the part, its moment):
//!
//! ```text
//! u̇ = ω                 ṡ = v_T − v_FT − ω(r + h)
//! without friction (m = 0), or sliding:
//!   K = a_FN − 2ω(v_FT − v_T) − ω²(r + h)        D = 1 + s(s − mh)/ρ²
//!   λ = (−K − f_N + sτ/ρ²)/D                      force on the part −λN + mλT
//!   ω̇ = (λ(s − mh) − τ)/ρ²                       v̇_T = ωv_N + mλ − f_T
//! rolling, where v_T = v_FT + hω:
//!   ω̇ = (rsω² − h a_FT − s a_FN − h f_T − s f_N − τ)/(ρ² + h² + s²)
//!   force on the part a + f with a = a_F + ω̇(hT + sN) + ω²(hN − sT) − rω²N
//! ```
//!
//! Assumes: the contact lasts. What would end it shows in [`Motion`]: see [`super::run`].
//! Frames: world; forces and accelerations per unit mass on the part. Units: SI.
//! Errors: none. At rest the direction of friction is undefined; see [`super::rest`] for that start.

use nalgebra::{Point2, Vector2};

use super::contact_mode::ContactForce;
use super::model::{ContactMode, EdgeTwist, PushModel, State};
use super::scalar::Scalar;
use crate::math::Jet;

/// What a state leads to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion<T = f64> {
    /// Time derivative of each state, per second. In rolling, v_T is not integrated and its rate is 0.
    pub rates: State<T>,
    /// −F·N/m ≥ 0 while pushing, m/s².
    pub normal_force: T,
    /// −F·T/m, m/s²: along the edge's counter-clockwise direction.
    pub tangential_force: T,
}

impl<T: Copy> Motion<T> {
    /// The force on the part.
    pub(crate) fn force(&self) -> ContactForce<T> {
        ContactForce { normal: self.normal_force, tangential: self.tangential_force }
    }
}

impl<const N: usize> Motion<Jet<N>> {
    /// Without derivatives.
    pub(in crate::pushing) fn plain(&self) -> Motion {
        let State { u, s, omega, v_t } = self.rates;
        Motion {
            rates: State { u: u.value, s: s.value, omega: omega.value, v_t: v_t.value },
            normal_force: self.normal_force.value,
            tangential_force: self.tangential_force.value,
        }
    }
}

/// Components along N and T.
#[derive(Clone, Copy)]
struct Components<T> {
    n: T,
    t: T,
}

impl<T: Scalar> Components<T> {
    /// Those of a world vector at contact angle u, given sin u and cos u.
    fn of(vector: Vector2<T>, (sin, cos): (T, T)) -> Self {
        let [x, y] = vector.into();
        Self { n: -(cos * x + sin * y), t: cos * y - sin * x }
    }
}

/// Force and moment of support friction, per unit mass: (f, τ). They act on the part with a minus sign.
#[derive(Clone, Copy)]
struct Drag<T> {
    n: T,
    t: T,
    moment: T,
}

/// Everything the formulas share.
struct Instant<T> {
    finger_velocity: Components<T>,
    finger_acceleration: Components<T>,
    /// Velocity of the centre of mass.
    velocity: Components<T>,
    drag: Drag<T>,
}

impl<T: Scalar> PushModel<'_, T> {
    /// Rates and contact force at time `time` (s).
    #[must_use]
    #[inline]
    pub fn motion(&self, contact: &ContactMode<T>, time: f64, state: &State<T>) -> Motion<T> {
        let instant = self.instant(contact, time, state);
        match contact.signed_friction() {
            Some(m) => self.sliding(m, state, &instant),
            None => self.rolling(state, &instant),
        }
    }

    /// Slip of the part relative to the finger along the edge's counter-clockwise direction, m/s.
    #[must_use]
    pub fn slip(&self, time: f64, state: &State<T>) -> T {
        self.rolling_v_t(time, state) - state.v_t
    }

    /// v_T of a part that rolls, m/s: v_FT + hω.
    #[must_use]
    pub fn rolling_v_t(&self, time: f64, state: &State<T>) -> T {
        let finger = Components::of(self.finger.velocity(time), state.u.sin_cos());
        finger.t + state.omega * self.edge.height
    }

    /// D of the module's formulas: at 0 and below, no contact force fits a sliding part (Painlevé).
    #[must_use]
    pub fn sliding_denominator(&self, signed_friction: T, s: T) -> T {
        s * (s - signed_friction * self.edge.height) / self.part.inertia_per_mass() + 1.0
    }

    /// r + h, m: from the disk's centre to the line through the centre of mass along the edge.
    #[must_use]
    pub(super) fn reach(&self) -> f64 {
        self.finger.radius + self.edge.height
    }

    /// Velocity of the centre of mass, world axes, m/s.
    #[must_use]
    pub fn velocity(&self, contact: &ContactMode<T>, time: f64, state: &State<T>) -> Vector2<T> {
        let (sin, cos) = state.u.sin_cos();
        let finger = Components::of(self.finger.velocity(time), (sin, cos));
        let Components { n, t } = self.part_velocity(contact, finger, state);
        Vector2::new(-(cos * n) - sin * t, cos * t - sin * n)
    }

    #[inline]
    fn part_velocity(&self, contact: &ContactMode<T>, finger: Components<T>, state: &State<T>) -> Components<T> {
        let t = match contact {
            ContactMode::Rolling => finger.t + state.omega * self.edge.height,
            ContactMode::Frictionless | ContactMode::Sliding { .. } => state.v_t,
        };
        Components { n: finger.n + state.s * state.omega, t }
    }

    #[inline]
    fn instant(&self, contact: &ContactMode<T>, time: f64, state: &State<T>) -> Instant<T> {
        let turn = state.u.sin_cos();
        let finger_velocity = Components::of(self.finger.velocity(time), turn);
        let velocity = self.part_velocity(contact, finger_velocity, state);
        Instant {
            finger_velocity,
            finger_acceleration: Components::of(self.finger.acceleration, turn),
            velocity,
            drag: self.drag(velocity, state.omega),
        }
    }

    #[inline]
    fn drag(&self, velocity: Components<T>, omega: T) -> Drag<T> {
        // Edge axes are N and −T; Γ of (5.25) is left in its two parts, force and moment.
        let twist = EdgeTwist { normal: velocity.n, along: -velocity.t, turn: omega };
        let sliding = self.part.sliding(&self.edge, twist);
        Drag { n: sliding.normal * self.mu_g, t: -(sliding.along * self.mu_g), moment: sliding.turn * self.mu_g }
    }

    #[inline]
    fn sliding(&self, m: T, state: &State<T>, instant: &Instant<T>) -> Motion<T> {
        let &State { s, omega, .. } = state;
        let Instant { finger_velocity, finger_acceleration, velocity, drag } = instant;
        let (rho_squared, reach) = (self.part.inertia_per_mass(), self.reach());
        // v_T − v_FT; then K of the header, from (5.13).
        let along = velocity.t - finger_velocity.t;
        let closing = finger_acceleration.n + omega * along * 2.0 - omega * omega * reach;
        // Newton and Euler (5.2), (5.3) put into K leave λ alone: λ D = −K − f_N + sτ/ρ².
        let push = s * drag.moment / rho_squared - closing - drag.n;
        let normal_force = push / self.sliding_denominator(m, s);
        // Arm of the contact force −λN + mλT about the centre of mass; then (5.24) and, with m ≠ 0, (5.42), (5.43).
        let lever = s - m * self.edge.height;
        let rates = State {
            u: omega,
            s: along - omega * reach,
            omega: (normal_force * lever - drag.moment) / rho_squared,
            v_t: omega * velocity.n + m * normal_force - drag.t,
        };
        Motion { rates, normal_force, tangential_force: -(m * normal_force) }
    }

    #[inline]
    fn rolling(&self, state: &State<T>, instant: &Instant<T>) -> Motion<T> {
        let &State { s, omega, .. } = state;
        let Instant { finger_acceleration, drag, .. } = instant;
        let (h, r) = (self.edge.height, self.finger.radius);
        let (rho_squared, spin) = (self.part.inertia_per_mass(), omega * omega);
        // Euler (5.3) about the contact, with Newton (5.2) and the acceleration (5.36) put in: ω̇ of (5.39).
        let moment =
            s * spin * r - (finger_acceleration.t + drag.t) * h - s * (finger_acceleration.n + drag.n) - drag.moment;
        let alpha = moment / (s * s + (rho_squared + h * h));
        // The derivative of v = v_F + ω(hT + sN) (5.38) by time, with ṡ = −rω.
        let a_n = finger_acceleration.n + alpha * s + spin * (h - r);
        let a_t = finger_acceleration.t + alpha * h - spin * s;
        // The contact covers the same length on both (5.32); the force on the part is a + f.
        let rates = State { u: omega, s: -(omega * r), omega: alpha, v_t: T::from(0.0) };
        Motion { rates, normal_force: -(a_n + drag.n), tangential_force: -(a_t + drag.t) }
    }
}

impl PushModel<'_> {
    /// The centre of mass, world axes, m.
    #[must_use]
    pub fn centre_of_mass(&self, time: f64, state: &State) -> Point2<f64> {
        let (sin, cos) = state.u.sin_cos();
        let (normal, tangent) = (Vector2::new(-cos, -sin), Vector2::new(-sin, cos));
        self.finger.centre(time) - normal * self.reach() + tangent * state.s
    }
}
