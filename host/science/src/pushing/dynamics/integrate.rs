//! Steps in time: a fixed one for observers, an error-controlled one for truth.
//!
//! Implements: the classical Runge–Kutta method of order 4 ([`ode`]); Dormand and Prince's pair
//! ([`dormand_prince`](crate::math::dormand_prince)); a linearly implicit one for what is stiff ([`rosenbrock`]).
//! Assumes: the contact stays as it is during a step.
//! Units: SI. Errors: none; a step too large shows in its error estimate.

use std::ops::{Add, Mul};

use nalgebra::{SMatrix, SVector};

use super::contact_model::ContactModel;
use super::disk_on_edge::Motion;
use super::model::{ContactMode, PushModel, State};
use super::scalar::Scalar;
use super::shaped::ShapedModel;
use crate::math::Jet;
use crate::math::dormand_prince::{ERROR, INTERPOLANT, NODES, STAGES, growth, moved};
use crate::math::ode::{self, Moves};
use crate::math::rosenbrock::{self, Estimated, Linearised};

/// Error of one adaptive step that is accepted, relative to the scales of [`Scale`].
///
/// Errors of some hundred steps then stay below 3e-11 of these scales after a second of pushing (measured, see
/// [`Push::run`](super::Push::run)): far below any sensor, near what rounding leaves.
pub(super) const STEP_TOLERANCE: f64 = 1e-11;

/// Error of a stiff step that is accepted, relative to the same scales: a foot at rest creeps by a micrometre a second
/// ([`FOOT_AT_REST`](super::FOOT_AT_REST)), which is some hundred times what a hundred such errors come to.
const STIFF_TOLERANCE: f64 = 1e-8;

/// Differences by which rates are derived, m, s and m/s: the stiffest, of a foot at rest, are linear up to a speed ten
/// thousand times this, and rounding is a millionth of them.
const NUDGE: [f64; 3] = [1e-9, 1e-7, 1e-10];

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
    /// The motion with its derivatives by the state, and by the time, which only the finger's velocity knows.
    pub(in crate::pushing) fn linearised(&self, contact: &ContactMode, time: f64, state: &State) -> LinearisedMotion {
        let mut lifted = self.lifted::<Jet<5>>();
        let finger = &mut lifted.finger;
        finger.velocity0 = finger.velocity0.zip_map(&self.finger.acceleration, |velocity, acceleration| Jet {
            slopes: [0.0, 0.0, 0.0, 0.0, acceleration],
            ..velocity
        });
        LinearisedMotion::of(state, |state| lifted.motion(&contact.map(Jet::constant), time, state))
    }
}

impl ShapedModel<'_> {
    /// [`PushModel::step`] of any two outlines.
    #[must_use]
    pub(in crate::pushing) fn step(&self, contact: &ContactMode, time: f64, state: &State, dt: f64) -> State {
        ode::step(state, dt, |moment, state| self.motion(contact, moment.time(time, dt), state).rates)
    }

    /// [`PushModel::linearised`] of any two outlines.
    pub(in crate::pushing) fn linearised(&self, contact: &ContactMode, time: f64, state: &State) -> LinearisedMotion {
        let mut lifted = self.lifted::<Jet<5>>();
        let by_time = |value: Jet<5>, rate: f64| Jet { slopes: [0.0, 0.0, 0.0, 0.0, rate], ..value };
        lifted.path.velocity0 = lifted.path.velocity0.zip_map(&self.path.acceleration, by_time);
        lifted.turning.rate0 = by_time(lifted.turning.rate0, self.turning.acceleration);
        LinearisedMotion::of(state, |state| lifted.motion(&contact.map(Jet::constant), time, state))
    }
}

/// The state one step of `dt` (s) later of a part so slow that what it turns and slides settles within the step
/// ([`rosenbrock`]): where friction forgets speed, v/(µg), much faster than the finger changes its own. It begins with
/// what is linearised there, by [`PushModel::linearised`] or [`ShapedModel::linearised`]. None where the step has no
/// solution.
///
/// No error control, no events.
#[must_use]
pub(in crate::pushing) fn stiff_step(
    model: &impl ContactModel,
    contact: &ContactMode,
    time: f64,
    state: &State,
    dt: f64,
    begin: &Linearised<4>,
) -> Option<State> {
    let at = |share: f64, components: &SVector<f64, 4>| {
        let state = State::from(Components::from(*components));
        SVector::from(Components::from(model.motion(contact, time + share * dt, &state).rates))
    };
    let stepped = rosenbrock::step(&Components::from(*state).into(), dt, begin, at)?;
    stepped.iter().all(|value| value.is_finite()).then(|| Components::from(stepped).into())
}

/// A motion, and what a stiff step begins with.
#[derive(Clone, Copy, Debug)]
pub(in crate::pushing) struct LinearisedMotion {
    pub(in crate::pushing) motion: Motion,
    /// Its rates with their derivatives, in the order of a state's fields.
    pub(in crate::pushing) begin: Linearised<4>,
}

impl LinearisedMotion {
    /// Of a motion that has the derivatives by the time as its fifth slopes.
    fn of(state: &State, motion: impl Fn(&State<Jet<5>>) -> Motion<Jet<5>>) -> Self {
        let [u, s, omega, v_t] = Components::from(*state);
        let state = State {
            u: Jet::variable(u, 0),
            s: Jet::variable(s, 1),
            omega: Jet::variable(omega, 2),
            v_t: Jet::variable(v_t, 3),
        };
        let motion = motion(&state);
        let State { u, s, omega, v_t } = motion.rates;
        let rates = [u, s, omega, v_t];
        let begin = Linearised {
            rates: SVector::from(rates.map(|rate| rate.value)),
            by_state: SMatrix::from_fn(|row, column| rates[row].slopes[column]),
            by_time: SVector::from(rates.map(|rate| rate.slopes[4])),
        };
        Self { motion: motion.plain(), begin }
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

/// One step, with what it takes to look inside it: of the explicit pair, or linearly implicit where that is too stiff.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) time: f64,
    pub(super) length: f64,
    start: Components,
    end: Components,
    way: Way,
}

/// How a step is taken.
#[derive(Clone, Copy, Debug)]
enum Way {
    Explicit { slopes: [Components; 7] },
    Stiff { begin: Linearised<4>, error: Components },
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
        Self { time, length, start, end, way: Way::Explicit { slopes } }
    }

    /// The same where what the part turns and slides settles much faster than it changes; none where the step has no
    /// solution.
    pub(super) fn take_stiff(
        model: &impl ContactModel,
        contact: &ContactMode,
        time: f64,
        state: State,
        length: f64,
    ) -> Option<Self> {
        let begin = differences(model, contact, time, &state);
        Self::stiff(model, contact, (time, state), length, begin)
    }

    fn stiff(
        model: &impl ContactModel,
        contact: &ContactMode,
        (time, state): (f64, State),
        length: f64,
        begin: Linearised<4>,
    ) -> Option<Self> {
        let start = Components::from(state);
        let at = |share: f64, components: &SVector<f64, 4>| rates(model, contact, time + share * length, *components);
        let Estimated { end, error } = rosenbrock::estimated_step(&start.into(), length, &begin, at)?;
        let (end, error) = (Components::from(end), Components::from(error));
        let is_finite = end.iter().all(|value| value.is_finite());
        is_finite.then_some(Self { time, length, start, end, way: Way::Stiff { begin, error } })
    }

    /// Another step of the same kind from the same start.
    pub(super) fn again(&self, model: &impl ContactModel, contact: &ContactMode, length: f64) -> Self {
        let start = self.start();
        match self.way {
            // A shorter one has a solution as well; explicit ones always have.
            Way::Stiff { begin, .. } if length > 0.0 => Self::stiff(model, contact, (self.time, start), length, begin)
                .unwrap_or_else(|| Self::take(model, contact, self.time, start, length)),
            _ => Self::take(model, contact, self.time, start, length),
        }
    }

    /// The state at the end, of order 5, or 4 of a stiff step.
    pub(super) fn end(&self) -> State {
        self.end.into()
    }

    /// The state at the start.
    pub(super) fn start(&self) -> State {
        self.start.into()
    }

    /// The state at a share of the step in [0, 1], good for finding where to look. Of an explicit step it is that of the
    /// interpolant of order 4; between the ends of a stiff one, where a force follows from speeds far below a micrometre a
    /// second, another step: but near its ends the end will do.
    pub(super) fn within(&self, model: &impl ContactModel, contact: &ContactMode, share: f64) -> State {
        let Way::Explicit { slopes } = &self.way else {
            return match share {
                share if share < NEAR_END => self.start(),
                share if share > 1.0 - NEAR_END => self.end(),
                share => self.again(model, contact, share * self.length).end(),
            };
        };
        let rest = 1.0 - share;
        let quartic = moved([0.0; 4], slopes, &INTERPOLANT, self.length);
        let at = |i: usize| {
            let difference = self.end[i] - self.start[i];
            let bend = self.length * slopes[0][i] - difference;
            let skew = difference - self.length * slopes[6][i] - bend;
            self.start[i] + share * (difference + rest * (bend + share * (skew + rest * quartic[i])))
        };
        [0, 1, 2, 3].map(at).into()
    }

    /// The estimated error of the step: above 1 it is too large.
    pub(super) fn error(&self, scale: &Scale) -> f64 {
        let (error, tolerance) = match &self.way {
            Way::Explicit { slopes } => (moved([0.0; 4], slopes, &ERROR, self.length), STEP_TOLERANCE),
            Way::Stiff { error, .. } => (*error, STIFF_TOLERANCE),
        };
        let worst = error.iter().zip(scale.0).map(|(error, scale)| (error / scale).abs());
        // `max` would drop a NaN, which must count as too large.
        worst.fold(0.0, |worst, error| if error > worst || error.is_nan() { error } else { worst }) / tolerance
    }

    /// The length that the next step, or another try of this one, should have.
    pub(super) fn length_next(&self, error: f64) -> f64 {
        match self.way {
            Way::Explicit { .. } => self.length * growth(error),
            // Of an order less: the fourth root of the error instead of the fifth.
            Way::Stiff { .. } => self.length * growth(error.powf(1.25)),
        }
    }
}

/// Shares of a step that are as good as its end.
const NEAR_END: f64 = 0.05;

fn rates(model: &impl ContactModel, contact: &ContactMode, time: f64, state: SVector<f64, 4>) -> SVector<f64, 4> {
    SVector::from(Components::from(model.motion(contact, time, &Components::from(state).into()).rates))
}

/// The rates with their derivatives, by differences: any model has those.
fn differences(model: &impl ContactModel, contact: &ContactMode, time: f64, state: &State) -> Linearised<4> {
    let [place, moment, speed] = NUDGE;
    let radius = model.body().inertia_per_mass().sqrt();
    let nudges = [place / radius, place, speed / radius, speed];
    let start = SVector::from(Components::from(*state));
    let here = rates(model, contact, time, start);
    let mut by_state = SMatrix::<f64, 4, 4>::zeros();
    for (i, nudge) in nudges.into_iter().enumerate() {
        let mut moved = start;
        moved[i] += nudge;
        // What was added, rounded.
        let nudge = moved[i] - start[i];
        by_state.set_column(i, &((rates(model, contact, time, moved) - here) / nudge));
    }
    let by_time = (rates(model, contact, time + moment, start) - here) / moment;
    Linearised { rates: here, by_state, by_time }
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
