//! Sensitivities: how the motion changes with the state it starts from, and with the body and the palm.
//!
//! Each column is a small change: `θ` turns the attitude to `A exp[θ]×`, `ω` and `u` change by themselves. A column starts
//! as a change of the attitude (palm-axis angular velocity `W = A ω` kept), of `W`, of the logarithm of a semi-axis or of the
//! palm's acceleration, and is carried along by the linearised equations of motion, in closed form, by the same Runge–Kutta
//! steps as the motion itself.
//!
//! Implements: the derivatives of [`mechanics`](super::mechanics); with `W` kept, "no spin" only drops the change of `W₃`.
//! Frames: `θ`, `ω` body axes; `u` palm axes. Units: SI per rad, per rad/s, per 1, per m/s².
//! Errors: none.

use nalgebra::{Matrix3, Vector2, Vector3};

use super::mechanics::{Instant, Mobility, Model, Rates, Rows, Spin, State};
use super::shape::{Local, Shape};

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

/// What the columns beyond those of the state stand for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Columns {
    /// Three columns for the logarithms of an ellipsoid's semi-axes, its density uniform.
    pub semi_axes: bool,
    /// Then three columns for a constant acceleration of the palm.
    pub palm: bool,
}

impl Columns {
    /// The state alone.
    pub const STATE: Self = Self { semi_axes: false, palm: false };

    /// How many there are.
    #[must_use]
    pub fn count(self) -> usize {
        STATE_COLUMNS + 3 * (usize::from(self.semi_axes) + usize::from(self.palm))
    }
}

impl<const N: usize> Tangent<N> {
    /// The columns at the instant at which their changes are made.
    #[must_use]
    pub fn seed(state: &State) -> Self {
        let mut seed = Self { theta: [[0.0; N]; 3], omega: [[0.0; N]; 3], u: [[0.0; N]; 2] };
        let rows = Rows::of(&state.orientation);
        // ω = AᵀW: keeping W while A turns by θ changes ω by ω × θ.
        let kept = state.omega.cross_matrix();
        for i in 0..3 {
            seed.theta[i][i] = 1.0;
            for j in 0..3 {
                seed.omega[i][j] = kept[(i, j)];
                seed.omega[i][3 + j] = rows.0[j][i];
            }
        }
        seed
    }

    #[inline]
    fn moved(&self, rates: &Self, dt: f64) -> Self {
        let mut moved = *self;
        for i in 0..3 {
            for j in 0..N {
                moved.theta[i][j] += rates.theta[i][j] * dt;
                moved.omega[i][j] += rates.omega[i][j] * dt;
            }
        }
        for i in 0..2 {
            for j in 0..N {
                moved.u[i][j] += rates.u[i][j] * dt;
            }
        }
        moved
    }

    #[inline]
    fn add(&mut self, rates: &Self, weight: f64) {
        *self = self.moved(rates, weight);
    }
}

/// The linearised equations at one instant.
#[derive(Clone, Copy, Debug)]
struct Linear {
    omega: Vector3<f64>,
    omega_by_theta: Matrix3<f64>,
    omega_by_omega: Matrix3<f64>,
    u_by_theta: [Vector3<f64>; 2],
    u_by_omega: [Vector3<f64>; 2],
}

/// What an instant needs to change its equations by more than the state.
struct Parts<'a> {
    state: &'a State,
    instant: Instant,
    local: Local,
    moving: Vector3<f64>,
    turn: Vector3<f64>,
    mobility: Mobility,
    held: Vector3<f64>,
    along: f64,
}

/// `v × m`, column by column.
#[inline]
fn cross_columns(v: &Vector3<f64>, m: &Matrix3<f64>) -> Matrix3<f64> {
    let column = |j: usize| v.cross(&Vector3::new(m[(0, j)], m[(1, j)], m[(2, j)]));
    Matrix3::from_columns(&[column(0), column(1), column(2)])
}

/// `m [v]×`.
#[inline]
fn times_cross(m: &Matrix3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
    // (m [v]×)ᵀ = −[v]× mᵀ: each row becomes row × v.
    let row = |i: usize| Vector3::new(m[(i, 0)], m[(i, 1)], m[(i, 2)]).cross(v).transpose();
    Matrix3::from_rows(&[row(0), row(1), row(2)])
}

impl Model<'_> {
    /// One step as [`Model::step`] takes it, with the columns.
    #[inline]
    #[must_use]
    pub fn step_with<const N: usize>(
        &self,
        columns: Columns,
        (state, tangent): (&State, &Tangent<N>),
        felt: &[Vector3<f64>; 3],
        dt: f64,
    ) -> (State, Tangent<N>) {
        let half = 0.5 * dt;
        let (k1, l1) = self.rates_and_slopes(columns, (state, tangent), &felt[0]);
        let (k2, l2) = self.rates_and_slopes(columns, (&state.moved(&k1, half), &tangent.moved(&l1, half)), &felt[1]);
        let (k3, l3) = self.rates_and_slopes(columns, (&state.moved(&k2, half), &tangent.moved(&l2, half)), &felt[1]);
        let (k4, l4) = self.rates_and_slopes(columns, (&state.moved(&k3, dt), &tangent.moved(&l3, dt)), &felt[2]);
        let (sixth, third) = (dt / 6.0, dt / 3.0);
        let moved = state.moved(&k1, sixth).moved(&k2, third).moved(&k3, third).moved(&k4, sixth);
        let mut carried = tangent.moved(&l1, sixth);
        carried.add(&l2, third);
        carried.add(&l3, third);
        carried.add(&l4, sixth);
        (moved.normalized(), carried)
    }

    #[inline]
    fn rates_and_slopes<const N: usize>(
        &self,
        columns: Columns,
        (state, tangent): (&State, &Tangent<N>),
        felt: &Vector3<f64>,
    ) -> (Rates, Tangent<N>) {
        let instant = Instant::of(state, felt);
        let local = self.body.shape().local(&instant.normal, &instant.turning);
        let moving = local.hessian * instant.turning;
        let (turn, torque) = self.turn(state, &instant, &local.contact, &moving);
        let mobility = Mobility::new(&self.body.inertia(), &local.contact);
        let held = mobility.times(&instant.normal);
        let parts =
            Parts { state, instant, local, moving, turn, mobility, held, along: 1.0 / instant.normal.dot(&held) };
        let linear = self.linearise(&parts, torque);
        let mut slopes = linear.carry(tangent);
        if N > STATE_COLUMNS {
            self.force(columns, &parts, &mut slopes);
        }
        let Rows([first, second, _]) = instant.rows;
        let q = state.orientation;
        let omega = nalgebra::Quaternion::from_imag(state.omega);
        let u = Vector2::new(first.dot(&moving), second.dot(&moving));
        (Rates { orientation: q * omega * 0.5, omega: turn, u }, slopes)
    }

    /// The derivatives of `ω'` and `u'` by attitude and angular velocity.
    #[inline]
    fn linearise(&self, parts: &Parts, torque: f64) -> Linear {
        let Parts { state, instant, local, moving, turn, .. } = parts;
        let (omega, normal, contact) = (&state.omega, &instant.normal, &local.contact);
        let inertia = self.body.inertia();
        // How β turns with the attitude is also how β' turns with ω.
        let contact_by_theta = times_cross(&local.hessian, normal);
        let moving_by_theta = times_cross(&local.slope, normal) + local.hessian * normal.dot(omega);
        let spun = omega.cross(contact) + moving;
        let push = instant.felt - omega.cross(&spun);
        let push_by_theta = instant.felt.cross_matrix()
            - cross_columns(omega, &(cross_columns(omega, &contact_by_theta) + moving_by_theta));
        let push_by_omega = spun.cross_matrix() + cross_columns(omega, &(contact.cross_matrix() - contact_by_theta));
        let heavy = turn * (2.0 * contact.transpose())
            - Matrix3::from_diagonal_element(contact.dot(turn))
            - contact * turn.transpose();
        let mut by_theta = cross_columns(contact, &push_by_theta) - (push.cross_matrix() + heavy) * contact_by_theta;
        if self.spin == Spin::None {
            by_theta += normal.cross_matrix() * torque;
        }
        let momentum = inertia.component_mul(omega);
        let gyroscopic = momentum.cross_matrix() - cross_columns(omega, &Matrix3::from_diagonal(&inertia));
        let by_omega = cross_columns(contact, &push_by_omega) + gyroscopic;
        let rows = [instant.rows.0[0], instant.rows.0[1]];
        let drift = moving_by_theta - moving.cross_matrix();
        Linear {
            omega: *omega,
            omega_by_theta: self.give_way(parts, &by_theta, &turn.cross(normal)),
            omega_by_omega: self.give_way(parts, &by_omega, &Vector3::zeros()),
            u_by_theta: rows.map(|row| drift.tr_mul(&row)),
            u_by_omega: rows.map(|row| contact_by_theta.tr_mul(&row)),
        }
    }

    /// `D⁻¹` of a change of torque; without spin also the change of the torque about the normal, where the normal itself
    /// changes so that `ω'·δn = normal_turn·δ`.
    #[inline]
    fn give_way(&self, parts: &Parts, torque: &Matrix3<f64>, normal_turn: &Vector3<f64>) -> Matrix3<f64> {
        let free = parts.mobility.matrix() * torque;
        match self.spin {
            Spin::Free => free,
            Spin::None => {
                let along = free.tr_mul(&parts.instant.normal) + normal_turn;
                free - parts.held * (along.transpose() * parts.along)
            }
        }
    }

    /// Adds what the body's shape and the palm's acceleration change directly.
    fn force<const N: usize>(&self, columns: Columns, parts: &Parts, slopes: &mut Tangent<N>) {
        let mut put = |column: usize, omega: Vector3<f64>, moving: Vector3<f64>| {
            for i in 0..3 {
                slopes.omega[i][column] += omega[i];
            }
            for i in 0..2 {
                slopes.u[i][column] += parts.instant.rows.0[i].dot(&moving);
            }
        };
        if let (true, Shape::Ellipsoid(ellipsoid)) = (columns.semi_axes, self.body.shape()) {
            for axis in 0..3 {
                let (torque, moving) = self.reshape(parts, axis, ellipsoid.semi_axes[axis]);
                put(STATE_COLUMNS + axis, self.give_way_once(parts, &torque), moving);
            }
        }
        if columns.palm {
            let first = columns.count() - 3;
            for axis in 0..3 {
                let torque = parts.local.contact.cross(&parts.instant.rows.0[axis]);
                put(first + axis, self.give_way_once(parts, &torque), Vector3::zeros());
            }
        }
    }

    fn give_way_once(&self, parts: &Parts, torque: &Vector3<f64>) -> Vector3<f64> {
        let free = parts.mobility.times(torque);
        match self.spin {
            Spin::Free => free,
            Spin::None => free - parts.held * (parts.instant.normal.dot(&free) * parts.along),
        }
    }

    /// Torque and motion of the contact that come of a longer semi-axis, per unit of its logarithm.
    fn reshape(&self, parts: &Parts, axis: usize, semi_axis: f64) -> (Vector3<f64>, Vector3<f64>) {
        let Parts { state, instant, local, moving, turn, .. } = parts;
        let (omega, contact, square) = (&state.omega, &local.contact, semi_axis * semi_axis);
        let unit = Vector3::ith(axis, 1.0);
        let height = contact.dot(&instant.normal);
        let longer = contact[axis] * instant.normal[axis] / height;
        let contact_change = unit * (2.0 * contact[axis]) - contact * longer;
        let sway = instant.turning;
        let moving_change = (unit * (2.0 * square * sway[axis])
            - contact_change * contact.dot(&sway)
            - contact * contact_change.dot(&sway))
            / height
            - moving * longer;
        let inertia_change = (Vector3::repeat(1.0) - unit) * (0.4 * square);
        let push = instant.felt - omega.cross(&(omega.cross(contact) + moving));
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

impl Linear {
    #[inline]
    fn carry<const N: usize>(&self, tangent: &Tangent<N>) -> Tangent<N> {
        let mut slopes = Tangent { theta: [[0.0; N]; 3], omega: [[0.0; N]; 3], u: [[0.0; N]; 2] };
        let ([a, b, c], [d, e, f]) = (&tangent.theta, &tangent.omega);
        let [p, q, r] = self.omega.into();
        for j in 0..N {
            slopes.theta[0][j] = d[j] - q * c[j] + r * b[j];
            slopes.theta[1][j] = e[j] - r * a[j] + p * c[j];
            slopes.theta[2][j] = f[j] - p * b[j] + q * a[j];
        }
        let (m, n) = (&self.omega_by_theta, &self.omega_by_omega);
        for i in 0..3 {
            let (m0, m1, m2, n0, n1, n2) = (m[(i, 0)], m[(i, 1)], m[(i, 2)], n[(i, 0)], n[(i, 1)], n[(i, 2)]);
            for j in 0..N {
                slopes.omega[i][j] = m0 * a[j] + m1 * b[j] + m2 * c[j] + n0 * d[j] + n1 * e[j] + n2 * f[j];
            }
        }
        for i in 0..2 {
            let (m, n) = (&self.u_by_theta[i], &self.u_by_omega[i]);
            for j in 0..N {
                slopes.u[i][j] = m.x * a[j] + m.y * b[j] + m.z * c[j] + n.x * d[j] + n.y * e[j] + n.z * f[j];
            }
        }
        slopes
    }
}
