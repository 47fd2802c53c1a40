//! A whole roll: sampled at given times, ended by the lift-off if there is one.
//!
//! Implements: the classical Runge–Kutta method with step doubling and extrapolation (Hairer, Nørsett, Wanner, *Solving
//! Ordinary Differential Equations I*, 2nd ed., II.4), as the reference for the fixed steps of the observers.
//! Assumes: unlimited friction; the friction that rolling needs is reported.
//! Frames: as in [`mechanics`](super::mechanics). Units: SI.
//! Errors: [`RollError`] for a start that contradicts the model. Lift-off is an answer.

use nalgebra::{Quaternion, Vector2, Vector3};

use super::body::RollingBody;
use super::mechanics::{Model, RollState, Spin, specific_force};
use super::palm::PalmAcceleration;
use crate::search::{Stop, never};

/// Error of one step that is accepted: rad, and the same share of angular velocity and size.
///
/// A thousand steps a second then stay below 1e-9 rad where the motion itself does not amplify errors.
const STEP_TOLERANCE: f64 = 1e-13;

/// Longest step, s: far shorter than any swing of the contact force, so that no lift-off hides between two looks.
const STEP_MAX_S: f64 = 2e-3;

/// Shortest step, s. It takes an angular velocity of 1e6 rad/s to ask for less.
const STEP_MIN_S: f64 = 1e-9;

/// Most steps of a run: some hours of rolling.
const STEPS_MAX: usize = 10_000_000;

/// Halvings with which a lift-off is located: to 2 ms / 2⁴⁰.
const HALVINGS: usize = 40;

/// A spin above this, rad/s, contradicts a contact that allows none.
pub const SPIN_MAX: f64 = 1e-9;

/// How far from 1 the length of a given quaternion may be: four decimals a component. It is then put right.
pub const QUATERNION_TOLERANCE: f64 = 1e-3;

/// Least |ω|, rad/s, that a step's error is measured by.
const OMEGA_FLOOR: f64 = 1.0;

/// What rolls, on what: all that the motion depends on besides its start.
#[derive(Clone, Copy, Debug)]
pub struct OnPalm<'a> {
    /// The body that rolls.
    pub body: &'a RollingBody,
    /// Whether it may spin about the contact normal.
    pub spin: Spin,
    /// How the palm accelerates.
    pub palm: &'a PalmAcceleration,
    /// Gravity, m/s².
    pub g: f64,
}

/// A body on a palm from its start on.
///
/// ```
/// use palpate::rolling::{OnPalm, PalmAcceleration, Spin};
/// use palpate::{Roll, RollingBody};
///
/// let pebble = RollingBody::ellipsoid([0.02, 0.03, 0.04])?;
/// let on = OnPalm { body: &pebble, spin: Spin::Free, palm: &PalmAcceleration::Rest, g: 9.81 };
/// // It stands upright on its longest axis and stays there: a balance, if an unstable one.
/// let run = Roll::new(on, [1.0, 0.0, 0.0, 0.0], [0.0; 3], [0.0; 2])?.run(&[0.0, 0.05])?;
/// assert!((run.samples[1].contact_body.z + 0.04).abs() < 1e-9); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Roll<'a> {
    model: Model<'a>,
    palm: &'a PalmAcceleration,
    g: f64,
    start: RollState,
}

/// How a roll went.
#[derive(Clone, Debug, PartialEq)]
pub struct RollRun {
    /// At each time asked for, up to the end.
    pub samples: Vec<RollSample>,
    /// Why and when the roll ended.
    pub end: RollEnd,
    /// The motion at the end.
    pub last: RollSample,
    /// The largest ratio of tangential to normal contact force seen at the samples and the end: rolling needs at least
    /// this coefficient of friction. Infinite at a lift-off with a tangential force.
    pub friction_needed: f64,
}

/// A rolling body at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollSample {
    /// Time since the roll began, s.
    pub t: f64,
    /// Attitude, motion and place.
    pub state: RollState,
    /// The contact, body axes, m.
    pub contact_body: Vector3<f64>,
    /// Contact force on the body over its mass, palm axes, m/s².
    pub contact_force: Vector3<f64>,
    /// Torque about the palm's normal that the contact transmits, over the mass, m²/s²; 0 for a point contact.
    pub contact_torque: f64,
    /// Over the mass, relative to the palm, m²/s².
    pub energy: f64,
}

/// The end of a roll.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RollEnd {
    /// What ended the roll.
    pub reason: RollEndReason,
    /// Time since the roll began, s.
    pub t: f64,
}

/// Why a roll ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RollEndReason {
    /// The last time asked for.
    Time,
    /// The contact would have to pull.
    LiftOff,
}

/// Why a roll cannot begin.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum RollError {
    /// An orientation that is none.
    #[error(
        "the quaternion's length is {length:?}, it must be 1 within {QUATERNION_TOLERANCE}: divide it by its length"
    )]
    Quaternion {
        /// Length of the quaternion as given; 1 is wanted.
        length: f64,
    },
    /// Spin where the contact allows none.
    #[error(
        "omega has a spin of {spin:?} rad/s about the contact normal, without spin it must be 0 within {SPIN_MAX:e} rad/s: \
         take omega·n out, or choose the spin `free`"
    )]
    Spins {
        /// Spin about the normal ω·n, rad/s.
        spin: f64,
    },
    /// It was told to stop.
    #[error("the roll was stopped at {t:?} s")]
    Stopped {
        /// How far it got, s.
        t: f64,
    },
    /// The integration could not keep its accuracy.
    #[error("the integration ends at {t:?} s: {steps} steps were not enough; the body turns too fast")]
    Stuck {
        /// Time since the roll began, s.
        t: f64,
        /// Steps taken until then.
        steps: usize,
    },
}

/// A quaternion `[w, x, y, z]` of length 1.
///
/// # Errors
/// [`RollError::Quaternion`] if its length is not 1 within [`QUATERNION_TOLERANCE`].
pub fn unit_quaternion([w, x, y, z]: [f64; 4]) -> Result<Quaternion<f64>, RollError> {
    let q = Quaternion::new(w, x, y, z);
    let length = q.norm();
    // Written so that NaN fails.
    if (length - 1.0).abs() <= QUATERNION_TOLERANCE { Ok(q / length) } else { Err(RollError::Quaternion { length }) }
}

impl<'a> Roll<'a> {
    /// Puts a body on a palm at t = 0: orientation `[w, x, y, z]` body → palm, angular velocity in body axes (rad/s),
    /// contact on the palm (m).
    ///
    /// ```
    /// use palpate::rolling::{OnPalm, PalmAcceleration, Roll, RollingBody, Spin};
    ///
    /// let pebble = RollingBody::ellipsoid([0.02, 0.03, 0.04])?;
    /// let on = OnPalm { body: &pebble, spin: Spin::Free, palm: &PalmAcceleration::Rest, g: 9.81 };
    /// let run = Roll::new(on, [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0])?.run(&[0.0, 0.05])?;
    /// assert!((run.samples[0].contact_body.z + 0.04).abs() < 1e-12); // it stands on its tip
    /// assert!(run.samples[1].state.u.y < -0.001); // and falls over
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`RollError`] for a quaternion that is none and a spin where there can be none.
    pub fn new(
        OnPalm { body, spin, palm, g }: OnPalm<'a>,
        orientation: [f64; 4],
        omega: [f64; 3],
        u: [f64; 2],
    ) -> Result<Self, RollError> {
        let orientation = unit_quaternion(orientation)?;
        let start = RollState { orientation, omega: Vector3::from(omega), u: Vector2::from(u) };
        let model = Model { body, spin };
        if spin == Spin::NoSpin {
            let rate = start.omega.dot(&start.normal());
            if rate.abs() > SPIN_MAX {
                return Err(RollError::Spins { spin: rate });
            }
        }
        Ok(Self { model, palm, g, start })
    }

    /// Rolls on to the last of `times` (s, increasing from 0), or to the lift-off.
    ///
    /// # Errors
    /// [`RollError::Stuck`] where no step is short enough.
    pub fn run(&self, times: &[f64]) -> Result<RollRun, RollError> {
        self.run_until(times, &never)
    }

    /// The same, ended when `stop` says so.
    ///
    /// # Errors
    /// As [`Self::run`]; [`RollError::Stopped`] where `stop` ended it: half a roll is none.
    pub fn run_until(&self, times: &[f64], stop: Stop<'_>) -> Result<RollRun, RollError> {
        let mut walk = Walk { roll: self, stop, t: 0.0, state: self.start, step: STEP_MAX_S, steps: 0 };
        let mut samples = Vec::with_capacity(times.len());
        let mut end = self.lifts(0.0, &self.start).then_some(RollEnd { reason: RollEndReason::LiftOff, t: 0.0 });
        let mut last = self.sample(0.0, &self.start);
        for &time in times {
            walk.goes_on()?;
            if end.is_none() {
                end = walk.to(time)?;
            }
            last = self.sample(walk.t, &walk.state);
            match end {
                Some(RollEnd { t, .. }) if t < time => break,
                _ => samples.push(RollSample { t: time, ..last }),
            }
        }
        let end = end.unwrap_or(RollEnd { reason: RollEndReason::Time, t: walk.t });
        let friction = samples.iter().chain([&last]).map(RollSample::friction_needed).fold(0.0, f64::max);
        Ok(RollRun { samples, end, last, friction_needed: friction })
    }

    /// The state at t = 0.
    #[must_use]
    pub fn start(&self) -> &RollState {
        &self.start
    }

    fn specific_force(&self, t: f64, inside: f64) -> Vector3<f64> {
        specific_force(self.palm.at_within(t, inside), self.g)
    }

    fn lifts(&self, t: f64, state: &RollState) -> bool {
        self.model.contact_force(state, &self.specific_force(t, t)).z <= 0.0
    }

    fn sample(&self, t: f64, state: &RollState) -> RollSample {
        let specific_force = self.specific_force(t, t);
        RollSample {
            t,
            state: *state,
            contact_body: self.model.contact(state),
            contact_force: self.model.contact_force(state, &specific_force),
            contact_torque: self.model.contact_torque(state, &specific_force),
            energy: self.model.energy(state, self.g),
        }
    }

    /// One Runge–Kutta step, then the spin put back to 0 where there is none.
    fn integrated(&self, t: f64, state: &RollState, dt: f64) -> RollState {
        let inside = t + 0.5 * dt;
        let specific_force = [t, inside, t + dt].map(|time| self.specific_force(time, inside));
        self.model.step(state, &specific_force, dt)
    }

    /// A step in two halves, extrapolated; with the state at its middle and the error estimated.
    fn doubled(&self, t: f64, state: &RollState, dt: f64) -> (RollState, RollState, f64) {
        let whole = self.integrated(t, state, dt);
        let middle = self.integrated(t, state, 0.5 * dt);
        let end = self.integrated(t + 0.5 * dt, &middle, 0.5 * dt);
        let size = self.model.body.size();
        let omega = (end.omega - whole.omega).norm() / (end.omega.norm() + OMEGA_FLOOR);
        let error = (end.orientation - whole.orientation).norm() + omega + (end.u - whole.u).norm() / size;
        let better = RollState {
            orientation: end.orientation + (end.orientation - whole.orientation) / 15.0,
            omega: end.omega + (end.omega - whole.omega) / 15.0,
            u: end.u + (end.u - whole.u) / 15.0,
        };
        (middle, self.without_spin(better.normalized()), error / 15.0)
    }

    fn without_spin(&self, mut state: RollState) -> RollState {
        if self.model.spin == Spin::NoSpin {
            let normal = state.normal();
            state.omega -= normal * normal.dot(&state.omega);
        }
        state
    }
}

impl RollSample {
    /// Tangential over normal contact force.
    #[must_use]
    pub fn friction_needed(&self) -> f64 {
        let tangential = self.contact_force.xy().norm();
        if tangential == 0.0 { 0.0 } else { tangential / self.contact_force.z.max(0.0) }
    }
}

/// A roll on its way.
struct Walk<'a, 'b> {
    roll: &'a Roll<'b>,
    stop: Stop<'a>,
    t: f64,
    state: RollState,
    step: f64,
    steps: usize,
}

impl Walk<'_, '_> {
    fn goes_on(&self) -> Result<(), RollError> {
        if self.stop.stops() { Err(RollError::Stopped { t: self.t }) } else { Ok(()) }
    }

    /// On to `time`, without stepping over a jump of the palm's acceleration.
    fn to(&mut self, time: f64) -> Result<Option<RollEnd>, RollError> {
        let jumps: Vec<_> = self.roll.palm.jumps(self.t, time).collect();
        for stop in jumps.into_iter().chain([time]) {
            while self.t < stop {
                if let Some(end) = self.advance(stop)? {
                    return Ok(Some(end));
                }
            }
            // A jump may lift the palm away at once.
            if self.roll.lifts(self.t, &self.state) {
                return Ok(Some(RollEnd { reason: RollEndReason::LiftOff, t: self.t }));
            }
        }
        Ok(None)
    }

    /// One accepted step, at most to `stop`.
    fn advance(&mut self, stop: f64) -> Result<Option<RollEnd>, RollError> {
        loop {
            self.goes_on()?;
            self.steps += 1;
            let last = self.t + self.step >= stop;
            let dt = if last { stop - self.t } else { self.step };
            let (middle, end, error) = self.roll.doubled(self.t, &self.state, dt);
            let grown = 0.9 * (STEP_TOLERANCE / error).powf(0.2);
            let fits = error <= STEP_TOLERANCE || dt <= STEP_MIN_S;
            if self.steps > STEPS_MAX || !error.is_finite() && dt <= STEP_MIN_S {
                return Err(RollError::Stuck { t: self.t, steps: self.steps });
            }
            let next = dt * if grown.is_nan() { 0.2 } else { grown.clamp(0.2, 4.0) };
            if !(fits && last) {
                self.step = next.clamp(STEP_MIN_S, STEP_MAX_S);
            }
            if fits {
                return Ok(self.arrive(dt, &middle, end, if last { stop } else { self.t + dt }));
            }
        }
    }

    /// Takes a step, or finds the lift-off in it.
    fn arrive(&mut self, dt: f64, middle: &RollState, end: RollState, t_end: f64) -> Option<RollEnd> {
        let lifts = |t: f64, state: &RollState| {
            self.roll.model.contact_force(state, &self.roll.specific_force(t, self.t + 0.5 * dt)).z <= 0.0
        };
        let share = match (lifts(self.t + 0.5 * dt, middle), lifts(t_end, &end)) {
            (true, _) => 0.5,
            (false, true) => 1.0,
            (false, false) => {
                (self.t, self.state) = (t_end, end);
                return None;
            }
        };
        let (mut low, mut high) = (0.0, share * dt);
        for _ in 0..HALVINGS {
            let half = 0.5 * (low + high);
            let lifted = lifts(self.t + half, &self.roll.integrated(self.t, &self.state, half));
            *(if lifted { &mut high } else { &mut low }) = half;
        }
        let (_, state, _) = self.roll.doubled(self.t, &self.state, high);
        (self.t, self.state) = (self.t + high, state);
        Some(RollEnd { reason: RollEndReason::LiftOff, t: self.t })
    }
}

#[cfg(test)]
mod tests {
    use super::super::palm::Pieces;
    use super::*;

    fn pebble() -> RollingBody {
        RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap()
    }

    fn go(body: &RollingBody, palm: &PalmAcceleration, omega: [f64; 3], times: &[f64]) -> RollRun {
        let on = OnPalm { body, spin: Spin::Free, palm, g: 9.81 };
        Roll::new(on, [0.6, 0.0, 0.8, 0.0], omega, [0.0; 2]).unwrap().run(times).unwrap()
    }

    #[test]
    fn energy_is_kept_to_rounding() {
        let run = go(&pebble(), &PalmAcceleration::Rest, [3.0, -4.0, 5.0], &[0.0, 0.5, 1.0, 2.0]);
        for sample in &run.samples {
            // Energy of some 1 m²/s² after some 2000 steps.
            assert!((sample.energy / run.samples[0].energy - 1.0).abs() < 1e-10, "{sample:?}");
        }
        assert_eq!(run.end, RollEnd { reason: RollEndReason::Time, t: 2.0 });
    }

    #[test]
    fn a_lift_off_is_where_the_contact_stops_pushing() {
        // Towards its long tip at 30 rad/s it throws itself off.
        let run = go(&pebble(), &PalmAcceleration::Rest, [1.0, 30.0, 1.0], &[0.0, 0.01, 0.02, 5.0]);
        assert_eq!(run.end.reason, RollEndReason::LiftOff, "{run:?}");
        assert!(run.last.contact_force.z.abs() < 1e-8, "{:?}", run.last);
        assert!(run.samples.iter().all(|sample| sample.t <= run.end.t && sample.contact_force.z > 0.0));
    }

    #[test]
    fn a_palm_that_falls_faster_than_the_body_leaves_it_at_once() {
        let values = vec![Vector3::zeros(), Vector3::new(0.0, 0.0, -20.0)];
        let palm = PalmAcceleration::Piecewise(Pieces::new(vec![0.0, 0.25], values).unwrap());
        let run = go(&pebble(), &palm, [0.1, 0.0, 0.0], &[0.0, 0.25, 0.5]);
        assert_eq!(run.end, RollEnd { reason: RollEndReason::LiftOff, t: 0.25 });
        assert_eq!(run.samples.len(), 2);
        let falling = PalmAcceleration::Constant(Vector3::new(0.0, 0.0, -10.0));
        let end = RollEnd { reason: RollEndReason::LiftOff, t: 0.0 };
        assert_eq!(go(&pebble(), &falling, [0.0; 3], &[0.0, 1.0]).end, end);
    }

    #[test]
    fn asking_more_often_changes_nothing() {
        let times: Vec<_> = (0..=100).map(|k| f64::from(k) * 0.007).collect();
        let often = go(&pebble(), &PalmAcceleration::Rest, [3.0, -4.0, 5.0], &times);
        let seldom = go(&pebble(), &PalmAcceleration::Rest, [3.0, -4.0, 5.0], &[0.7]);
        assert!((often.last.state.u - seldom.last.state.u).norm() < 1e-11);
    }

    #[test]
    fn a_start_that_contradicts_the_model_is_refused() {
        let body = pebble();
        let on = |spin| OnPalm { body: &body, spin, palm: &PalmAcceleration::Rest, g: 9.81 };
        let error = Roll::new(on(Spin::Free), [1.0, 0.1, 0.0, 0.0], [0.0; 3], [0.0; 2]).unwrap_err();
        assert!(matches!(error, RollError::Quaternion { .. }), "{error}");
        let error = Roll::new(on(Spin::NoSpin), [1.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.0; 2]).unwrap_err();
        assert!(error.to_string().contains("0.1 rad/s"), "{error}");
    }
}
