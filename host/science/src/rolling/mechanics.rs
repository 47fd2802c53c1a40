//! How a body rolls on a palm: rates, contact force, energy.
//!
//! With `n = −Aᵀe₃` the body's outward normal at the contact, `β` the contact and `H` the Hessian of the support
//! function, `f = Aᵀ(a_P + g e₃)` what the body feels, `J` the inertia over the mass and `D = J + |β|²1 − ββᵀ`:
//!
//! ```text
//! β' = H (n × ω)       u' = first two components of A β'       A' = A [ω]×
//! r  = β × (f − ω × (ω × β) − ω × β') − ω × J ω
//! point contact:  ω' = D⁻¹ r
//! no spin:        ω' = D⁻¹ (r + n τ)   with τ such that n·ω' = 0, a torque about the normal
//! contact force on the body, over mass:  f − ω × (ω × β) − ω' × β − ω × β'
//! ```
//!
//! Speed: a step takes as long as its chain of operations that wait for each other. An ellipsoid's `β = w/√η`,
//! `η = w·n`, is therefore kept without root and quotient, `ηD` is inverted by its adjugate, and its determinant, `1/η`
//! and `√η` are computed side by side: one division deep a stage instead of three.
//!
//! Implements: thesis §7.1, in a form without charts, and with its errors put right: (7.15) counts the rotation of the
//! frame twice, which breaks Galilean invariance; (7.17) has no torque that would keep the spin at zero as (7.4)
//! demands.
//! Assumes: rigid, one point of contact, never slips.
//! Frames: `omega`, `β`, `n`, `f` in body axes; `u` and `a_P` in palm axes, e₃ up. Units: SI; all forces over the mass.
//! Errors: none; that a contact cannot pull is for [`run`](super::run) to see.

use std::ops::{Add, Mul};

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector2, Vector3};

use super::body::RollingBody;
use super::shape::{Scaled, cross, dot};
use crate::math::Algebraic;
use crate::math::ode::{self, Moment, Moves};

/// Up to here the series of 1/√(1 + x) to the third power of x is exact: what follows is 0.27 x⁴.
const SERIES_MAX: f64 = 1e-4;

/// What the contact transmits beside a force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Spin {
    /// Nothing: a point contact. The body spins about the normal as it likes.
    Free,
    /// A torque about the normal, which keeps the spin at zero.
    NoSpin,
}

/// A rolling body at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollState {
    /// Body → palm; of length 1 up to rounding.
    pub orientation: Quaternion<f64>,
    /// Angular velocity, body axes, rad/s.
    pub omega: Vector3<f64>,
    /// The contact on the palm, m.
    pub u: Vector2<f64>,
}

/// How fast a [`RollState`] changes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollRates {
    /// Rate of the quaternion, 1/s.
    pub orientation: Quaternion<f64>,
    /// Angular acceleration, body axes, rad/s².
    pub omega: Vector3<f64>,
    /// Velocity of the contact on the palm, m/s.
    pub u: Vector2<f64>,
}

/// A body and the way it touches the palm.
#[derive(Clone, Copy, Debug)]
pub struct Model<'a> {
    /// Shape and inertia of the body.
    pub body: &'a RollingBody,
    /// What the contact transmits.
    pub spin: Spin,
}

/// `η D = diag(d) − wwᵀ`, for a contact `β = w/√η`, and how to solve with it.
#[derive(Clone, Copy, Debug)]
pub(super) struct ContactPointInertia {
    diagonal: Vector3<f64>,
    point: Vector3<f64>,
}

/// Orientation as a matrix, by rows, times the square of the quaternion's length.
#[derive(Clone, Copy, Debug)]
pub(super) struct RotationMatrix(pub(super) [Vector3<f64>; 3]);

/// Everything about one instant that rates, forces and sensitivities share.
#[derive(Clone, Copy, Debug)]
pub(super) struct Instant {
    pub(super) rotation: RotationMatrix,
    /// Outward normal at the contact `n`, body axes.
    pub(super) normal: Vector3<f64>,
    /// `n' = n × ω`, body axes, 1/s.
    pub(super) turning: Vector3<f64>,
    /// `f = Aᵀ(a_P + g e₃)`, body axes, m/s².
    pub(super) specific_force: Vector3<f64>,
}

impl RollState {
    /// The orientation as what it is.
    #[must_use]
    pub fn attitude(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::new_normalize(self.orientation)
    }

    /// The body's outward normal at the contact, body axes.
    #[must_use]
    pub fn normal(&self) -> Vector3<f64> {
        -(self.attitude().inverse() * Vector3::z())
    }

    /// `q' = q ω/2`, 1/s.
    #[inline(always)]
    pub(super) fn turning(&self) -> Quaternion<f64> {
        let [x, y, z, w] = self.orientation.coords.into();
        let [p, q, r] = (self.omega * 0.5).into();
        Quaternion::new(-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p)
    }

    /// The same with an orientation of length 1.
    #[inline(always)]
    pub(super) fn normalized(self) -> Self {
        let excess = self.orientation.norm_squared() - 1.0;
        // After a step of ordinary length three terms of 1/√(1 + x) are exact, and sooner there than root and quotient.
        let per_length = if excess.abs() < SERIES_MAX {
            1.0 + excess * (-0.5 + excess * (0.375 - excess * 0.3125))
        } else {
            1.0 / (1.0 + excess).sqrt()
        };
        Self { orientation: self.orientation * per_length, ..self }
    }
}

impl Moves<RollRates> for RollState {
    #[inline(always)]
    fn moved(&self, rates: &RollRates, dt: f64) -> Self {
        Self {
            orientation: self.orientation + rates.orientation * dt,
            omega: self.omega + rates.omega * dt,
            u: self.u + rates.u * dt,
        }
    }
}

impl Add for RollRates {
    type Output = Self;

    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let orientation = self.orientation + other.orientation;
        Self { orientation, omega: self.omega + other.omega, u: self.u + other.u }
    }
}

impl Mul<f64> for RollRates {
    type Output = Self;

    #[inline(always)]
    fn mul(self, factor: f64) -> Self {
        Self { orientation: self.orientation * factor, omega: self.omega * factor, u: self.u * factor }
    }
}

impl RotationMatrix {
    #[inline(always)]
    pub(super) fn of(q: &Quaternion<f64>) -> Self {
        let [x, y, z, w] = q.coords.into();
        let (xx, yy, zz, ww) = (x * x, y * y, z * z, w * w);
        let (xy, xz, yz) = (2.0 * x * y, 2.0 * x * z, 2.0 * y * z);
        let (wx, wy, wz) = (2.0 * w * x, 2.0 * w * y, 2.0 * w * z);
        Self([
            Vector3::new(ww + xx - yy - zz, xy - wz, xz + wy),
            Vector3::new(xy + wz, ww - xx + yy - zz, yz - wx),
            Vector3::new(xz - wy, yz + wx, ww - xx - yy + zz),
        ])
    }

    /// Palm axes → body axes.
    #[inline(always)]
    pub(super) fn to_body(self, v: &Vector3<f64>) -> Vector3<f64> {
        self.0[0] * v.x + self.0[1] * v.y + self.0[2] * v.z
    }
}

impl Instant {
    #[inline(always)]
    pub(super) fn of(state: &RollState, specific_force_palm: &Vector3<f64>) -> Self {
        let rotation = RotationMatrix::of(&state.orientation);
        let normal = -rotation.0[2];
        Self {
            rotation,
            normal,
            turning: normal.cross(&state.omega),
            specific_force: rotation.to_body(specific_force_palm),
        }
    }
}

impl ContactPointInertia {
    #[inline(always)]
    pub(super) fn new(inertia: &Vector3<f64>, contact: &Vector3<f64>) -> Self {
        Self::scaled(inertia, contact, 1.0)
    }

    #[inline(always)]
    pub(super) fn scaled(inertia: &Vector3<f64>, point: &Vector3<f64>, square: f64) -> Self {
        let reach = point.norm_squared();
        Self { diagonal: inertia.map(|moment| moment * square + reach), point: *point }
    }

    #[inline(always)]
    fn times(&self, v: &Vector3<f64>) -> Vector3<f64> {
        self.diagonal.component_mul(v) - self.point * self.point.dot(v)
    }

    /// The inverse times `v`.
    #[inline(always)]
    fn solve(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let (adjugate, per_determinant) = self.adjugate();
        adjugate * v * per_determinant
    }

    /// Adjugate and 1/determinant of the matrix.
    #[inline(always)]
    fn adjugate(&self) -> (Matrix3<f64>, f64) {
        let ([d, e, f], [x, y, z]) = (<[f64; 3]>::from(self.diagonal), <[f64; 3]>::from(self.point));
        let (xy, yz, zx) = (x * y, y * z, z * x);
        let (a, b, c) = (d - x * x, e - y * y, f - z * z);
        let (first, second, third) = (b * c - yz * yz, xy * f, zx * e);
        let fourth = yz * d;
        let determinant = a * first - xy * second - zx * third;
        let adjugate =
            Matrix3::new(first, second, third, second, c * a - zx * zx, fourth, third, fourth, a * b - xy * xy);
        (adjugate, 1.0 / determinant)
    }

    /// The inverse with all its entries.
    #[inline(always)]
    pub(super) fn inverse(&self) -> Matrix3<f64> {
        let (adjugate, per_determinant) = self.adjugate();
        adjugate * per_determinant
    }

    /// The inverse times `v` if a torque about `n` keeps the answer across it: the inverse on the plane across `n`,
    /// which in two dimensions is the matrix itself, turned by a right angle, over its determinant.
    #[inline(always)]
    fn solve_across(&self, n: &Vector3<f64>, v: &Vector3<f64>) -> Vector3<f64> {
        let ([d, e, f], [x, y, z]) = (<[f64; 3]>::from(self.diagonal), <[f64; 3]>::from(*n));
        let arm = n.cross(&self.point);
        let determinant =
            x * x * (e * f) + y * y * (f * d) + z * z * (d * e) - self.diagonal.dot(&arm.component_mul(&arm));
        n.cross(&self.times(&v.cross(n))) * (1.0 / determinant)
    }
}

/// What a body feels of a palm's acceleration under gravity: `a_P + g e₃`, palm axes, m/s².
#[must_use]
pub fn specific_force(palm_acceleration: Vector3<f64>, g: f64) -> Vector3<f64> {
    palm_acceleration + Vector3::new(0.0, 0.0, g)
}

impl Model<'_> {
    /// The rates at a state whose body feels `specific_force` (palm axes, m/s²).
    #[inline(always)]
    #[must_use]
    pub fn rates(&self, state: &RollState, specific_force: &Vector3<f64>) -> RollRates {
        let instant = Instant::of(state, specific_force);
        let scaled = self.body.shape().roll_scaled(&instant.normal, &instant.turning);
        // ω' = D⁻¹ r, (7.15) put right, without a root or a quotient before the inverse.
        let omega = self.turn_scaled(state, &instant, &scaled);
        let RotationMatrix([first, second, _]) = instant.rotation;
        // β' = motion/√η³, and u' = A β' (7.8) has two components on the palm.
        let per_square = 1.0 / scaled.square;
        let per_cube = scaled.square.sqrt() * per_square * per_square;
        let u = Vector2::new(first.dot(&scaled.motion), second.dot(&scaled.motion)) * per_cube;
        RollRates { orientation: state.turning(), omega, u }
    }

    /// `ω'`, given the contact.
    #[inline(always)]
    pub(super) fn turn_scaled(&self, state: &RollState, instant: &Instant, scaled: &Scaled) -> Vector3<f64> {
        let contact_inertia = ContactPointInertia::scaled(&self.body.inertia(), &scaled.point, scaled.square);
        let torque = self.torque(state, instant, scaled);
        match self.spin {
            Spin::Free => contact_inertia.solve(&torque),
            Spin::NoSpin => contact_inertia.solve_across(&instant.normal, &torque),
        }
    }

    /// `η r`, body axes: η times what turns the body about the contact, over the mass.
    #[inline(always)]
    fn torque(&self, state: &RollState, instant: &Instant, scaled: &Scaled) -> Vector3<f64> {
        let Scaled { point, motion, square } = scaled;
        let ([p, q, r], [a, b, c]) = (state.omega.into(), self.body.inertia().into());
        // ω × Jω of Euler's equation (7.13), J diagonal.
        let gyroscopic = Vector3::new((c - b) * (q * r), (a - c) * (r * p), (b - a) * (p * q));
        let per_square = 1.0 / square;
        // w × (ω × y) with y = ω × w + β'√η, where w is across ω × w.
        let along = state.omega * (point.dot(motion) * per_square);
        let back = (state.omega.cross(point) + motion * per_square) * point.dot(&state.omega);
        // η r = √η w × f − w × (ω × y) − η ω × Jω: (7.15) put right.
        point.cross(&instant.specific_force) * square.sqrt() + back - along - gyroscopic * *square
    }

    /// One step of `dt` (s) by the classical Runge–Kutta method of order 4, then the orientation's length put right.
    ///
    /// `specific_force` is what the body feels at the step's start, middle and end. Largest relative error of the
    /// energy over 60 s of a 2-3-4 cm ellipsoid at about 10 rad/s: 5e-5 at 4 ms, 1e-6 at 2 ms, 6e-8 at 1 ms, 3e-9 at
    /// 0.5 ms.
    #[inline]
    #[must_use]
    pub fn step(&self, state: &RollState, specific_force: &[Vector3<f64>; 3], dt: f64) -> RollState {
        let rates = |moment, state: &RollState| match moment {
            Moment::Start => self.rates(state, &specific_force[0]),
            Moment::Middle => self.rates(state, &specific_force[1]),
            Moment::End => self.rates(state, &specific_force[2]),
        };
        ode::step(state, dt, rates).normalized()
    }

    /// The point of contact, body axes, m.
    #[must_use]
    pub fn contact(&self, state: &RollState) -> Vector3<f64> {
        self.body.shape().contact(&state.normal())
    }

    /// The contact's force on the body over its mass, palm axes, m/s². Its third component must stay above 0: a contact
    /// cannot pull.
    #[must_use]
    pub fn contact_force(&self, state: &RollState, specific_force: &Vector3<f64>) -> Vector3<f64> {
        let state = state.normalized();
        let instant = Instant::of(&state, specific_force);
        let (contact, moving) = self.body.shape().roll(&instant.normal, &instant.turning);
        let at = Scaled { point: contact, motion: moving, square: 1.0 };
        let turning = self.turn_scaled(&state, &instant, &at);
        // Acceleration of the centre of mass relative to the palm: −ω' × β − ω × (ω × β + β'), (7.14) put right. The
        // contact gives that and f.
        let spinning = state.omega.cross(&(state.omega.cross(&contact) + moving));
        state.attitude() * (instant.specific_force - spinning - turning.cross(&contact))
    }

    /// The torque about the normal that the contact transmits, over the mass, m²/s²; positive along the palm's e₃.
    #[must_use]
    pub fn contact_torque(&self, state: &RollState, specific_force: &Vector3<f64>) -> f64 {
        let state = state.normalized();
        let instant = Instant::of(&state, specific_force);
        let (contact, moving) = self.body.shape().roll(&instant.normal, &instant.turning);
        let at = Scaled { point: contact, motion: moving, square: 1.0 };
        let turn = self.turn_scaled(&state, &instant, &at);
        // D ω' is what turns the body about the contact; what of it r of a point contact does not give is the torque.
        let needed = ContactPointInertia::new(&self.body.inertia(), &contact).times(&turn);
        let given = self.torque(&state, &instant, &at);
        instant.normal.dot(&(given - needed))
    }

    /// Energy over mass, m²/s²: kinetic relative to the palm, and `g` times the height of the centre of mass.
    #[must_use]
    pub fn energy(&self, state: &RollState, g: f64) -> f64 {
        let normal = state.normal();
        let contact = self.body.shape().contact(&normal);
        let kinetic = state.omega.cross(&contact).norm_squared()
            + state.omega.dot(&self.body.inertia().component_mul(&state.omega));
        0.5 * kinetic + g * contact.dot(&normal)
    }

    /// Spin about the palm's normal, rad/s, positive counter-clockwise seen from above.
    #[must_use]
    pub fn spin_rate(&self, state: &RollState) -> f64 {
        -state.omega.dot(&state.normal())
    }

    /// How many numbers a state has: 8, or 7 where the spin is known to be 0.
    #[must_use]
    pub fn dimension(&self) -> usize {
        match self.spin {
            Spin::Free => 8,
            Spin::NoSpin => 7,
        }
    }
}

/// A state in numbers that carry derivatives; for formulas that need higher ones than [`flow`](super::flow) has.
#[derive(Clone, Copy, Debug)]
pub(super) struct StateOf<T> {
    /// `[w, x, y, z]`.
    pub(super) orientation: [T; 4],
    pub(super) omega: [T; 3],
}

impl<T: Algebraic> StateOf<T> {
    /// The orientation as a matrix, by rows.
    fn rotation(&self) -> [[T; 3]; 3] {
        let [w, x, y, z] = self.orientation;
        let two = |a: T, b: T| a * b * 2.0;
        let square = |a: T| a * a;
        // Without the division a derivative across the quaternion's length would be wrong.
        let per = (square(w) + square(x) + square(y) + square(z)).recip();
        [
            [square(w) + square(x) - square(y) - square(z), two(x, y) - two(w, z), two(x, z) + two(w, y)],
            [two(x, y) + two(w, z), square(w) - square(x) + square(y) - square(z), two(y, z) - two(w, x)],
            [two(x, z) - two(w, y), two(y, z) + two(w, x), square(w) - square(x) - square(y) + square(z)],
        ]
        .map(|row| row.map(|entry| entry * per))
    }

    /// Palm axes → body axes.
    pub(super) fn to_body(self, v: [T; 3]) -> [T; 3] {
        let rows = self.rotation();
        [0, 1, 2].map(|i| rows[0][i] * v[0] + rows[1][i] * v[1] + rows[2][i] * v[2])
    }
}

impl Model<'_> {
    /// `u'` and the rates of orientation and angular velocity, with numbers that carry derivatives; `None` for a custom
    /// shape.
    pub(super) fn rates_with<T: Algebraic>(
        &self,
        state: &StateOf<T>,
        specific_force_palm: &Vector3<f64>,
    ) -> Option<([T; 2], StateOf<T>)> {
        let StateOf { orientation: [w, x, y, z], omega } = *state;
        let rows = state.rotation();
        let normal = rows[2].map(|entry| -entry);
        let specific_force = [0, 1, 2].map(|i| {
            rows[0][i] * specific_force_palm.x + rows[1][i] * specific_force_palm.y + rows[2][i] * specific_force_palm.z
        });
        // β and β' = H(n × ω).
        let (contact, moving) = self.body.shape().roll_with(normal, cross(normal, omega))?;
        let inertia = self.body.inertia();
        // r = β × (f − ω × (ω × β + β')) − ω × Jω, (7.15) put right.
        let spun = cross(omega, contact);
        let spinning = cross(omega, [0, 1, 2].map(|i| spun[i] + moving[i]));
        let pushed = cross(contact, [0, 1, 2].map(|i| specific_force[i] - spinning[i]));
        let gyroscopic = cross(omega, [0, 1, 2].map(|i| omega[i] * inertia[i]));
        // D = diag(J + |β|²) − β βᵀ (7.16), inverted by Sherman and Morrison.
        let reach = dot(contact, contact);
        let diagonal = [0, 1, 2].map(|i| (reach + inertia[i]).recip());
        let across = [0, 1, 2].map(|i| diagonal[i] * contact[i]);
        let factor = (-dot(across, contact) + 1.0).recip();
        let times = |v: [T; 3]| [0, 1, 2].map(|i| diagonal[i] * v[i] + across[i] * (dot(across, v) * factor));
        let free = times([0, 1, 2].map(|i| pushed[i] - gyroscopic[i]));
        let turning = match self.spin {
            Spin::Free => free,
            Spin::NoSpin => {
                let held = times(normal);
                let torque = -dot(normal, free) / dot(normal, held);
                [0, 1, 2].map(|i| free[i] + held[i] * torque)
            }
        };
        let [p, q, r] = omega;
        let orientation = [-x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p];
        let u = [dot(rows[0], moving), dot(rows[1], moving)];
        Some((u, StateOf { orientation: orientation.map(|rate| rate * 0.5), omega: turning }))
    }
}
