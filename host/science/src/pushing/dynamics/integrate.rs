//! Steps in time: a fixed one for observers, an error-controlled one for truth.
//!
//! Implements: the classical Runge–Kutta method of order 4 ([`ode`]); Dormand and Prince's pair
//! ([`dormand_prince`](crate::math::dormand_prince)); a linearly implicit one for what is stiff ([`rosenbrock`]).
//! Assumes: the contact stays as it is during a step.
//! Units: SI. Errors: none; a step too large shows in its error estimate.

use std::ops::{Add, Mul};

use nalgebra::{SMatrix, SVector};

use super::contact_model::ContactModel;
use super::model::{ContactMode, PushModel, State};
use super::scalar::Scalar;
use super::shaped::ShapedModel;
use crate::math::Jet;
use crate::math::dormand_prince::{ERROR, INTERPOLANT, NODES, STAGES, growth, moved};
use crate::math::ode::{self, Moves};
use crate::math::rosenbrock::{self, Linearised};

/// Error of one adaptive step that is accepted, relative to the scales of [`Scale`].
///
/// Errors of some hundred steps then stay below 3e-11 of these scales after a second of pushing (measured, see
/// [`Push::run`](super::Push::run)): far below any sensor, near what rounding leaves.
pub(super) const STEP_TOLERANCE: f64 = 1e-11;

/// Speeds below this, in m/s, count as this in the scale of a step's error: no sensor tells them from rest.
const SPEED_FLOOR: f64 = 1e-11;

/// The rates of a state are kept as another one.
impl<T: Scalar> Moves<Self> for State<T> {
    #[inline]
    fn moved(&self, rates: &Self, dt: f64) -> Self {
        *self + *rates * dt
    }
}

impl<T: Scalar> Add for State<T> {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self { u: self.u + other.u, s: self.s + other.s, omega: self.omega + other.omega, v_t: self.v_t + other.v_t }
    }
}

impl<T: Scalar> Mul<f64> for State<T> {
    type Output = Self;

    #[inline]
    fn mul(self, factor: f64) -> Self {
        Self { u: self.u * factor, s: self.s * factor, omega: self.omega * factor, v_t: self.v_t * factor }
    }
}

impl<T: Scalar> PushModel<'_, T> {
    /// The state one step of `dt` (s) later, by the classical Runge–Kutta method of order 4.
    ///
    /// For observers: no error control, no events. Measured error of u after 0.8 s at 5 cm/s with µ = 0.3, on 100
    /// random pushes each, rolling | frictionless, in rad:
    ///
    /// | step | median | worst |
    /// |---|---|---|
    /// | 10 ms | 7e-7 \| 1e-6 | 9e-6 \| 1e-4 |
    /// | 5 ms | 4e-8 \| 7e-8 | 5e-7 \| 2e-6 |
    /// | 2 ms | 1e-9 \| 1e-9 | 1e-8 \| 4e-8 |
    /// | 1 ms | 6e-11 \| 9e-11 | 8e-10 \| 6e-9 |
    ///
    /// Friction forgets speed within v/(µg), 17 ms there; steps much longer than that diverge.
    #[must_use]
    pub fn step(&self, contact: &ContactMode<T>, time: f64, state: &State<T>, dt: f64) -> State<T> {
        ode::step(state, dt, |moment, state| self.motion(contact, moment.time(time, dt), state).rates)
    }
}

impl PushModel<'_> {
    /// The state one step of `dt` (s) later of a part so slow that what it turns and slides settles within the step
    /// ([`rosenbrock`]): where friction forgets speed, v/(µg), much faster than the finger changes its own. None where the
    /// step has no solution.
    ///
    /// No error control, no events.
    #[must_use]
    pub(in crate::pushing) fn stiff_step(
        &self,
        contact: &ContactMode,
        time: f64,
        state: &State,
        dt: f64,
    ) -> Option<State> {
        stiff_step(self, contact, time, state, dt, self.linearised(contact, time, state))
    }

    /// The rates with their derivatives by the state, and by the time, which only the finger's velocity knows.
    fn linearised(&self, contact: &ContactMode, time: f64, state: &State) -> Linearised<4> {
        let mut lifted = self.lifted::<Jet<5>>();
        let finger = &mut lifted.finger;
        finger.velocity0 = finger.velocity0.zip_map(&self.finger.acceleration, |velocity, acceleration| Jet {
            slopes: [0.0, 0.0, 0.0, 0.0, acceleration],
            ..velocity
        });
        linearised(state, |state| lifted.motion(&contact.map(Jet::constant), time, state).rates)
    }
}

impl ShapedModel<'_> {
    /// [`PushModel::step`] of any two outlines.
    #[must_use]
    pub(in crate::pushing) fn step(&self, contact: &ContactMode, time: f64, state: &State, dt: f64) -> State {
        ode::step(state, dt, |moment, state| self.motion(contact, moment.time(time, dt), state).rates)
    }

    /// [`PushModel::stiff_step`] of any two outlines.
    #[must_use]
    pub(in crate::pushing) fn stiff_step(
        &self,
        contact: &ContactMode,
        time: f64,
        state: &State,
        dt: f64,
    ) -> Option<State> {
        let mut lifted = self.lifted::<Jet<5>>();
        let by_time = |value: Jet<5>, rate: f64| Jet { slopes: [0.0, 0.0, 0.0, 0.0, rate], ..value };
        lifted.path.velocity0 = lifted.path.velocity0.zip_map(&self.path.acceleration, by_time);
        lifted.turning.rate0 = by_time(lifted.turning.rate0, self.turning.acceleration);
        let linearised = linearised(state, |state| lifted.motion(&contact.map(Jet::constant), time, state).rates);
        stiff_step(self, contact, time, state, dt, linearised)
    }
}

fn stiff_step(
    model: &impl ContactModel,
    contact: &ContactMode,
    time: f64,
    state: &State,
    dt: f64,
    linearised: Linearised<4>,
) -> Option<State> {
    let at = |share: f64, components: &SVector<f64, 4>| {
        let state = State::from(Components::from(*components));
        SVector::from(Components::from(model.motion(contact, time + share * dt, &state).rates))
    };
    let stepped = rosenbrock::step(&Components::from(*state).into(), dt, &linearised, at)?;
    stepped.iter().all(|value| value.is_finite()).then(|| Components::from(stepped).into())
}

/// The rates with their derivatives by the state, and by the time as the fifth slope of what is given.
fn linearised(state: &State, rates: impl Fn(&State<Jet<5>>) -> State<Jet<5>>) -> Linearised<4> {
    let [u, s, omega, v_t] = Components::from(*state);
    let state = State {
        u: Jet::variable(u, 0),
        s: Jet::variable(s, 1),
        omega: Jet::variable(omega, 2),
        v_t: Jet::variable(v_t, 3),
    };
    let State { u, s, omega, v_t } = rates(&state);
    let rates = [u, s, omega, v_t];
    Linearised {
        rates: SVector::from(rates.map(|rate| rate.value)),
        by_state: SMatrix::from_fn(|row, column| rates[row].slopes[column]),
        by_time: SVector::from(rates.map(|rate| rate.slopes[4])),
    }
}

/// Components of a state, in the order of its fields.
type Components = [f64; 4];

impl From<State> for Components {
    fn from(State { u, s, omega, v_t }: State) -> Self {
        [u, s, omega, v_t]
    }
}

impl From<Components> for State {
    fn from([u, s, omega, v_t]: Components) -> Self {
        Self { u, s, omega, v_t }
    }
}

/// One step of the pair, with what it takes to look inside it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) time: f64,
    pub(super) length: f64,
    start: Components,
    end: Components,
    slopes: [Components; 7],
}

impl Step {
    /// Takes a step of `length` s from `state`.
    pub(super) fn take(model: &impl ContactModel, contact: &ContactMode, time: f64, state: State, length: f64) -> Self {
        let start = Components::from(state);
        let mut slopes = [[0.0; 4]; 7];
        let mut end = start;
        for stage in 0..7 {
            end = moved(start, &slopes, &STAGES[stage], length);
            slopes[stage] = model.motion(contact, time + NODES[stage] * length, &end.into()).rates.into();
        }
        Self { time, length, start, end, slopes }
    }

    /// The state at the end, of order 5.
    pub(super) fn end(&self) -> State {
        self.end.into()
    }

    /// The state at the start.
    pub(super) fn start(&self) -> State {
        self.start.into()
    }

    /// The interpolant at a share of the step in [0, 1]: of order 4, good for finding where to look.
    pub(super) fn within(&self, share: f64) -> State {
        let rest = 1.0 - share;
        let quartic = moved([0.0; 4], &self.slopes, &INTERPOLANT, self.length);
        let at = |i: usize| {
            let difference = self.end[i] - self.start[i];
            let bend = self.length * self.slopes[0][i] - difference;
            let skew = difference - self.length * self.slopes[6][i] - bend;
            self.start[i] + share * (difference + rest * (bend + share * (skew + rest * quartic[i])))
        };
        [0, 1, 2, 3].map(at).into()
    }

    /// The estimated error of the step: above 1 it is too large.
    pub(super) fn error(&self, scale: &Scale) -> f64 {
        let error = moved([0.0; 4], &self.slopes, &ERROR, self.length);
        let worst = error.iter().zip(scale.0).map(|(error, scale)| (error / scale).abs());
        // `max` would drop a NaN, which must count as too large.
        worst.fold(0.0, |worst, error| if error > worst || error.is_nan() { error } else { worst }) / STEP_TOLERANCE
    }

    /// The length that the next step, or another try of this one, should have.
    pub(super) fn length_next(&self, error: f64) -> f64 {
        self.length * growth(error)
    }
}

/// What an error in each component is measured by: 1 rad, the radius of gyration, and the present speeds.
///
/// Relative to the present speeds because the direction of friction depends on their ratio, however slow the part is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale(Components);

impl Scale {
    pub(super) fn of(model: &impl ContactModel, contact: &ContactMode, time: f64, state: &State) -> Self {
        let radius = model.body().inertia_per_mass().sqrt();
        let [x, y] = model.velocity(contact, time, state).into();
        let speed = x.hypot(y) + radius * state.omega.abs() + SPEED_FLOOR;
        Self([1.0, radius, speed / radius, speed])
    }
}
