//! Sensitivities: how the motion changes with the state it starts from, and with the body and the palm.
//!
//! Each column is a small change: `θ` turns the attitude to `A exp[θ]×`, `ω` and `u` change by themselves. A column
//! starts as a change of the attitude (palm-axis angular velocity `W = A ω` kept), of `W`, of the logarithm of a
//! semi-axis or of the palm's acceleration, and is carried along by the linearised equations of motion, in closed form,
//! by the same Runge–Kutta steps as the motion itself. The method of [`ode`] is written out here once more, because the
//! columns want it differently: the motion's stages leave their linearised equations behind, and each column is then
//! taken through all four from beginning to end, so that the compiler can put several columns side by side.
//!
//! Implements: the derivatives of [`mechanics`](super::mechanics); with `W` kept, "no spin" only drops the change of
//! `W₃`.
//! Frames: `θ`, `ω` body axes; `u` palm axes. Units: SI per rad, per rad/s, per 1, per m/s².
//! Errors: none.

use nalgebra::{Matrix3, Vector2, Vector3};
use pulp::{Arch, NullaryFnOnce};

use super::mechanics::{ContactPointInertia, Instant, Model, RollRates, RollState, RotationMatrix, Spin};
use super::shape::{Local, Scaled, Shape};
use crate::math::ode::{self, Moves};

/// Columns of a state alone: three of attitude, three of angular velocity.
pub const STATE_COLUMNS: usize = 6;

/// Changes of attitude, angular velocity and contact, `N` of them side by side.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tangent<const N: usize> {
    /// Body axes, rad per unit.
    pub theta: [[f64; N]; 3],
    /// Body axes, rad/s per unit.
    pub omega: [[f64; N]; 3],
    /// Palm axes, m per unit. The change of the initial `u`, which is carried along as it is, is not among the columns.
    pub u: [[f64; N]; 2],
}

/// A state and how it changes with what it started from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StateWithTangent<const N: usize> {
    /// The state at that time.
    pub state: RollState,
    /// Derivatives of the state, a column for each unknown.
    pub tangent: Tangent<N>,
}

impl<const N: usize> StateWithTangent<N> {
    /// A state that is itself what the motion starts from.
    #[must_use]
    pub fn seed(state: &RollState) -> Self {
        Self { state: *state, tangent: Tangent::seed(state) }
    }
}

/// What the columns beyond those of the state stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns {
    /// Three columns for the logarithms of an ellipsoid's semi-axes, its density uniform.
    pub semi_axes: bool,
    /// Then three columns for a constant acceleration of the palm.
    pub palm: bool,
}

impl Columns {
    /// No columns but those of the state.
    pub const STATE: Self = Self { semi_axes: false, palm: false };

    /// How many columns the sensitivity has.
    #[must_use]
    pub fn count(self) -> usize {
        STATE_COLUMNS + 3 * (usize::from(self.semi_axes) + usize::from(self.palm))
    }
}

impl<const N: usize> Tangent<N> {
    /// The columns at the instant at which their changes are made.
    #[must_use]
    pub fn seed(state: &RollState) -> Self {
        let mut seed = Self { theta: [[0.0; N]; 3], omega: [[0.0; N]; 3], u: [[0.0; N]; 2] };
        let rotation = RotationMatrix::of(&state.orientation);
        // ω = AᵀW: keeping W while A turns by θ changes ω by ω × θ.
        let kept = state.omega.cross_matrix();
        for i in 0..3 {
            seed.theta[i][i] = 1.0;
            for j in 0..3 {
                seed.omega[i][j] = kept[(i, j)];
                seed.omega[i][3 + j] = rotation.0[j][i];
            }
        }
        seed
    }
}

/// The linearised equations at one instant.
#[derive(Clone, Copy, Debug)]
struct Linear {
    omega: Vector3<f64>,
    torque_by_theta: Matrix3<f64>,
    torque_by_omega: Matrix3<f64>,
    u_by_theta: [Vector3<f64>; 2],
    u_by_omega: [Vector3<f64>; 2],
    inverse_inertia: InverseContactInertia,
    /// `ω' × n`: without spin, as the normal turns, so does the plane of the angular acceleration.
    turned: Vector3<f64>,
}

/// What changes the slopes of columns directly.
#[derive(Clone, Copy, Debug)]
struct Forced<const N: usize> {
    omega: [[f64; N]; 3],
    u: [[f64; N]; 2],
}

/// How the angular acceleration answers a change of torque.
#[derive(Clone, Copy, Debug)]
struct InverseContactInertia {
    /// The answer itself; without spin across the normal.
    matrix: Matrix3<f64>,
    /// Without spin: where a torque about the normal leads, as far as to have 1 along the normal; else 0.
    held: Vector3<f64>,
}

/// What an instant needs to change its equations by more than the state.
struct Parts {
    state: RollState,
    instant: Instant,
    local: Local,
    moving: Vector3<f64>,
    turn: Vector3<f64>,
    inverse_inertia: InverseContactInertia,
}

/// `v × m`, column by column.
#[inline]
fn cross_columns(v: &Vector3<f64>, m: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |j: usize| v.cross(&Vector3::new(m[(0, j)], m[(1, j)], m[(2, j)]));
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// `m [v]×`, where `[v]× x = v × x`.
#[inline]
fn times_cross(m: &Matrix3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
    // (m [v]×)ᵀ = −[v]× mᵀ: each row becomes row × v.
    let row = |i: usize| Vector3::new(m[(i, 0)], m[(i, 1)], m[(i, 2)]).cross(v).transpose();
    Matrix3::from_rows(&[row(0), row(1), row(2)])
}

impl Parts {
    #[inline(always)]
    fn rates(&self) -> RollRates {
        let RotationMatrix([first, second, _]) = self.instant.rotation;
        let u = Vector2::new(first.dot(&self.moving), second.dot(&self.moving));
        RollRates { orientation: self.state.turning(), omega: self.turn, u }
    }
}

impl Model<'_> {
    /// One step as [`Model::step`] takes it, with the columns.
    #[inline]
    #[must_use]
    pub fn step_with<const N: usize>(
        &self,
        columns: Columns,
        from: &StateWithTangent<N>,
        specific_force: &[Vector3<f64>; 3],
        dt: f64,
    ) -> StateWithTangent<N> {
        let StateWithTangent { state, tangent } = from;
        let half = 0.5 * dt;
        let mut forced = [Forced { omega: [[0.0; N]; 3], u: [[0.0; N]; 2] }; 4];
        // Each stage gives the rates and their derivatives at the same point.
        let mut stage = |index: usize, state: &RollState, specific_force: &Vector3<f64>| {
            let parts = self.parts(state, specific_force);
            if N > STATE_COLUMNS {
                self.force(columns, &parts, &mut forced[index]);
            }
            (parts.rates(), self.linearise(&parts))
        };
        // Classical Runge–Kutta of order 4, for the state; `carry` does the same with the columns.
        let (k1, l1) = stage(0, state, &specific_force[0]);
        let (k2, l2) = stage(1, &state.moved(&k1, half), &specific_force[1]);
        let (k3, l3) = stage(2, &state.moved(&k2, half), &specific_force[1]);
        let (k4, l4) = stage(3, &state.moved(&k3, dt), &specific_force[2]);
        StateWithTangent {
            state: ode::end(state, &[k1, k2, k3, k4], dt).normalized(),
            tangent: Arch::new().dispatch(Carrying { stages: &[l1, l2, l3, l4], forced: &forced, tangent, dt }),
        }
    }

    /// The motion itself by way of the short chain of [`Scaled`]; everything else may wait.
    #[inline(always)]
    fn parts(&self, state: &RollState, specific_force: &Vector3<f64>) -> Parts {
        let instant = Instant::of(state, specific_force);
        let shape = self.body.shape();
        let scaled = shape.roll_scaled(&instant.normal, &instant.turning);
        let turn = self.turn_scaled(state, &instant, &scaled);
        let local = shape.local(&instant.normal, &instant.turning);
        let moving = local.hessian * instant.turning;
        let inverse_inertia = self.inverse_inertia(&instant.normal, &scaled);
        Parts { state: *state, instant, local, moving, turn, inverse_inertia }
    }

    #[inline(always)]
    fn inverse_inertia(&self, normal: &Vector3<f64>, scaled: &Scaled) -> InverseContactInertia {
        let free =
            ContactPointInertia::scaled(&self.body.inertia(), &scaled.point, scaled.square).inverse() * scaled.square;
        match self.spin {
            Spin::Free => InverseContactInertia { matrix: free, held: Vector3::zeros() },
            Spin::NoSpin => {
                let answer = free * normal;
                let held = answer * (1.0 / normal.dot(&answer));
                InverseContactInertia { matrix: free - held * answer.transpose(), held }
            }
        }
    }

    /// The derivatives of the torque and of `u'` by attitude and angular velocity.
    ///
    /// With the contact force `F = f − ω' × β − ω × y`, `y = ω × β + β'`, the torque that is missing is
    /// `β × F − J ω' − ω × J ω`. Its derivative is written out with `δβ = H δn`, `δβ' = S δn + H δ(n × ω)`,
    /// `δn = n × θ`, `δf = f × θ` and `a × (b × v) = b (a·v) − v (a·b)`, which leaves no product of two matrices.
    #[inline(always)]
    fn linearise(&self, parts: &Parts) -> Linear {
        let Parts { state, instant, local: Local { contact, hessian, slope }, moving, turn, inverse_inertia } = parts;
        let (omega, normal, specific_force) = (&state.omega, &instant.normal, &instant.specific_force);
        // Products that occur several times: n·ω, β·ω, H β, y, F.
        let (spin, roll) = (normal.dot(omega), contact.dot(omega));
        let bent = hessian * contact;
        let y = omega.cross(contact) + moving;
        let force = specific_force - turn.cross(contact) - omega.cross(&y);
        // ∂torque/∂n, by β, β' and H; then by θ through δn = n × θ and δf = f × θ.
        let swept = hessian * contact.cross(omega) + slope.tr_mul(contact);
        let by_normal =
            cross_columns(&(force - omega * roll), hessian) + turn * bent.transpose() + omega * swept.transpose()
                - hessian * contact.dot(turn)
                - slope * roll;
        let mut by_theta = specific_force * contact.transpose()
            - times_cross(&by_normal, normal)
            - (omega * bent.transpose() - hessian * roll) * spin
            - Matrix3::from_diagonal_element(contact.dot(specific_force));
        if self.spin == Spin::NoSpin {
            let momentum = self.body.inertia().component_mul(omega);
            // It lies along the normal and turns with it.
            let needed = self.body.inertia().component_mul(turn) + omega.cross(&momentum) - contact.cross(&force);
            by_theta += needed.cross_matrix();
        }
        // ∂torque/∂ω at a fixed attitude, through y and δ(n × ω).
        let by_omega = y * contact.transpose() - omega * bent.cross(normal).transpose()
            + (times_cross(hessian, normal) - contact.cross_matrix()) * roll
            - Matrix3::from_diagonal_element(contact.dot(&y))
            - self.gyroscopic(omega);
        // u' = A β', by rows of A: δu' = A(δβ' + θ × β').
        let rows = [instant.rotation.0[0], instant.rotation.0[1]];
        let bends = rows.map(|row| hessian * row);
        let drift = |i: usize| slope.tr_mul(&rows[i]).cross(normal) + bends[i] * spin + moving.cross(&rows[i]);
        Linear {
            omega: *omega,
            torque_by_theta: by_theta,
            torque_by_omega: by_omega,
            u_by_theta: [drift(0), drift(1)],
            u_by_omega: bends.map(|bend| bend.cross(normal)),
            inverse_inertia: *inverse_inertia,
            turned: turn.cross(normal),
        }
    }

    /// The derivative of `ω × J ω`.
    #[inline]
    fn gyroscopic(&self, omega: &Vector3<f64>) -> Matrix3<f64> {
        let ([p, q, r], [a, b, c]) = ((*omega).into(), self.body.inertia().into());
        let [d, e, f]: [f64; 3] = [c - b, a - c, b - a];
        Matrix3::new(0.0, d * r, d * q, e * r, 0.0, e * p, f * q, f * p, 0.0)
    }

    /// Adds what the body's shape and the palm's acceleration change directly.
    fn force<const N: usize>(&self, columns: Columns, parts: &Parts, slopes: &mut Forced<N>) {
        let mut put = |column: usize, omega: Vector3<f64>, moving: Vector3<f64>| {
            for i in 0..3 {
                slopes.omega[i][column] += omega[i];
            }
            for i in 0..2 {
                slopes.u[i][column] += parts.instant.rotation.0[i].dot(&moving);
            }
        };
        if let (true, Shape::Ellipsoid(ellipsoid)) = (columns.semi_axes, self.body.shape()) {
            for axis in 0..3 {
                // δω' = D⁻¹ δtorque and δu' = A δβ', per unit of ln a.
                let (torque, moving) = self.reshape(parts, axis, ellipsoid.semi_axes[axis]);
                put(STATE_COLUMNS + axis, parts.inverse_inertia.matrix * torque, moving);
            }
        }
        if columns.palm {
            let first = columns.count() - 3;
            for axis in 0..3 {
                // Input fields of (7.18): D⁻¹ β × Aᵀe for each axis e of the palm; β' does not change.
                let torque = parts.local.contact.cross(&parts.instant.rotation.0[axis]);
                put(first + axis, parts.inverse_inertia.matrix * torque, Vector3::zeros());
            }
        }
    }

    /// Torque and motion of the contact that come of a longer semi-axis, per unit of its logarithm.
    fn reshape(&self, parts: &Parts, axis: usize, semi_axis: f64) -> (Vector3<f64>, Vector3<f64>) {
        let Parts { state, instant, local, moving, turn, .. } = parts;
        let (omega, contact, square) = (&state.omega, &local.contact, semi_axis * semi_axis);
        let unit = Vector3::ith(axis, 1.0);
        // h = β·n; of an ellipsoid β = diag(a²) n/h. `longer` is δ ln h.
        let height = contact.dot(&instant.normal);
        let longer = contact[axis] * instant.normal[axis] / height;
        let contact_change = unit * (2.0 * contact[axis]) - contact * longer;
        let sway = instant.turning;
        // β' = H(n × ω) with H = (diag(a²) − β βᵀ)/h, term by term.
        let moving_change = (unit * (2.0 * square * sway[axis])
            - contact_change * contact.dot(&sway)
            - contact * contact_change.dot(&sway))
            / height
            - moving * longer;
        // J of uniform density is (b² + c²)/5 and so on: the other two moments grow by 2a²/5.
        let inertia_change = (Vector3::repeat(1.0) - unit) * (0.4 * square);
        // δ of β × F − D ω' − ω × Jω at fixed ω', which is what D⁻¹ has to make up for.
        let push = instant.specific_force - omega.cross(&(omega.cross(contact) + moving));
        let push_change = -omega.cross(&(omega.cross(&contact_change) + moving_change));
        let heavy = inertia_change.component_mul(turn) + turn * (2.0 * contact.dot(&contact_change))
            - contact_change * contact.dot(turn)
            - contact * contact_change.dot(turn);
        let torque = contact_change.cross(&push) + contact.cross(&push_change)
            - omega.cross(&inertia_change.component_mul(omega))
            - heavy;
        (torque, moving_change)
    }
}

/// One column of a [`Tangent`].
#[derive(Clone, Copy)]
struct Column {
    theta: [f64; 3],
    omega: [f64; 3],
    u: [f64; 2],
}

/// [`carry`] with the machine's widest vectors: nothing is reordered or fused, so all give the same bits.
struct Carrying<'a, const N: usize> {
    stages: &'a [Linear; 4],
    forced: &'a [Forced<N>; 4],
    tangent: &'a Tangent<N>,
    dt: f64,
}

impl<const N: usize> NullaryFnOnce for Carrying<'_, N> {
    type Output = Tangent<N>;

    #[inline(always)]
    fn call(self) -> Tangent<N> {
        carry(self.stages, self.forced, self.tangent, self.dt)
    }
}

/// The columns after a step, given the slopes at its four stages.
///
/// One column after the other from beginning to end, so that the compiler can put several side by side.
#[inline(always)]
fn carry<const N: usize>(stages: &[Linear; 4], forced: &[Forced<N>; 4], tangent: &Tangent<N>, dt: f64) -> Tangent<N> {
    let mut carried = *tangent;
    let (half, sixth) = (0.5 * dt, dt / 6.0);
    for j in 0..N {
        // The columns obey the linearised equations of each stage, with the weights 1, 2, 2, 1.
        let start = Column {
            theta: [tangent.theta[0][j], tangent.theta[1][j], tangent.theta[2][j]],
            omega: [tangent.omega[0][j], tangent.omega[1][j], tangent.omega[2][j]],
            u: [tangent.u[0][j], tangent.u[1][j]],
        };
        let first = stages[0].at(&forced[0], &start, j);
        let second = stages[1].at(&forced[1], &start.moved(&first, half), j);
        let third = stages[2].at(&forced[2], &start.moved(&second, half), j);
        let fourth = stages[3].at(&forced[3], &start.moved(&third, dt), j);
        for i in 0..3 {
            carried.theta[i][j] +=
                (first.theta[i] + (second.theta[i] + third.theta[i]) * 2.0 + fourth.theta[i]) * sixth;
            carried.omega[i][j] +=
                (first.omega[i] + (second.omega[i] + third.omega[i]) * 2.0 + fourth.omega[i]) * sixth;
        }
        for i in 0..2 {
            carried.u[i][j] += (first.u[i] + (second.u[i] + third.u[i]) * 2.0 + fourth.u[i]) * sixth;
        }
    }
    carried
}

impl Column {
    #[inline(always)]
    fn moved(&self, slope: &Self, dt: f64) -> Self {
        let ([a, b, c], [d, e, f]) = (self.theta, self.omega);
        let ([p, q, r], [s, t, u]) = (slope.theta, slope.omega);
        Self { theta: [a + p * dt, b + q * dt, c + r * dt], omega: [d + s * dt, e + t * dt, f + u * dt], u: self.u }
    }
}

impl Linear {
    /// The slope of column `j`.
    #[inline(always)]
    fn at<const N: usize>(&self, forced: &Forced<N>, column: &Column, j: usize) -> Column {
        let Linear { omega, torque_by_theta, torque_by_omega, u_by_theta, u_by_omega, inverse_inertia, turned } = self;
        let (&[a, b, c], &[d, e, f]) = (&column.theta, &column.omega);
        // θ' = δω − ω × θ.
        let theta = [d - omega.y * c + omega.z * b, e - omega.z * a + omega.x * c, f - omega.x * b + omega.y * a];
        let (m, n) = (torque_by_theta, torque_by_omega);
        // Change of the torque by θ and ω; D⁻¹ of it is the change of ω', without spin kept across the normal as that
        // turns.
        let row = |i: usize| {
            (m[(i, 0)] * a + m[(i, 1)] * b + m[(i, 2)] * c) + (n[(i, 0)] * d + n[(i, 1)] * e + n[(i, 2)] * f)
        };
        let (x, y, z) = (row(0), row(1), row(2));
        let (p, held) = (&inverse_inertia.matrix, &inverse_inertia.held);
        let out = turned.x * a + turned.y * b + turned.z * c;
        let answer = |i: usize| (p[(i, 0)] * x + p[(i, 1)] * y) + (p[(i, 2)] * z - held[i] * out);
        // Change of u' by θ and ω; then what the body's shape and the palm change directly.
        let drift = |i: usize| {
            let (m, n) = (&u_by_theta[i], &u_by_omega[i]);
            (m.x * a + m.y * b + m.z * c) + (n.x * d + n.y * e + n.z * f)
        };
        let (mut omega, mut u) = ([answer(0), answer(1), answer(2)], [drift(0), drift(1)]);
        if N > STATE_COLUMNS {
            omega.iter_mut().zip(&forced.omega).for_each(|(rate, more)| *rate += more[j]);
            u.iter_mut().zip(&forced.u).for_each(|(rate, more)| *rate += more[j]);
        }
        Column { theta, omega, u }
    }
}
