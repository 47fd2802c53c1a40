//! The thesis's observer of a push, after Gauthier, Hammouri and Othman: a simulation that the felt contact pulls
//! along.
//!
//! With χ(x) = (u, ω, L_f ω[, L_f² ω]) the contact angle and its derivatives along the drift f, and all poles at −ζ:
//!
//! ```text
//! rolling                    x̂' = f(x̂) + inputs − (∂χ/∂x)⁻¹ (3ζ, 3ζ², ζ³) (û − u)            x = (u, s, ω)
//! frictionless, or sliding   x̂' = f(x̂) + inputs − (∂χ/∂x)⁻¹ (4ζ, 6ζ², 4ζ³, ζ⁴) (û − u)       x = (u, s, ω, v_T)
//! ```
//!
//! This module is one observer, on one edge; `bank` runs one for each edge that may be in contact, `follower` as the finger feels,
//! reading by reading.
//!
//! Implements: thesis §4.2.2, (5.29), (5.40) and §5.4.2, with the misprints put right: s₁₁ = +1/ζ in (4.9), a plus
//! before the finger's acceleration, everything at the estimate, a minus before the correction. The thesis multiplies u
//! and what follows from it by r; here u is an angle and r drops out. Correction is on for a while and off for a while
//! (§6.1), so that the error can grow to where it says something. f is the motion with the finger at its present
//! velocity, not accelerating. L_f ω is derived exactly, by dual numbers; L_f² ω is that gradient's change along f, by
//! a difference of the fourth order.
//! Assumes: the contact lasts; nothing keeps the estimate on its edge.
//! Frames: world. Units: SI. Errors: none; an estimate that has diverged ends a trace.

mod bank;
mod follower;
#[cfg(test)]
mod tests;

use std::f64::consts::{PI, TAU};

pub use bank::{GhoBank, GhoRun};
pub use follower::{GhoFollower, GhoKnown, GhoStart, GhoTold};
use nalgebra::{Const, Matrix3, Matrix4, RowVector4, SMatrix, Vector2, Vector3, Vector4};

use crate::math::angle::wrap_angle;
use crate::math::ode;
use crate::pushing::dynamics::{ContactMode, Finger, Parameter, PushModel, Seeded, State};
use crate::search::{Halt, never};

/// How far along the drift to look for the change of a gradient, as a share of the state's own scales.
///
/// Truncation is of its fourth power, rounding 1e-13 over it: both are below 1e-10 of the gradient.
const LOOK_SHARE: f64 = 1e-3;

/// How near its end a stretch of correction counts as over, as a share of the cycle: times are sums of decimals.
const CLOCK_ROUNDING: f64 = 1e-9;

/// An estimate of more than this in any state has diverged: turns of the contact, radii of gyration along the edge,
/// rad/s, m/s. No part that a finger pushes comes near; an observer that came back from there was not seen.
const DIVERGED: f64 = 1e3;

/// A part that turns faster than this, rad/s, or slides faster, m/s, does not: the estimate is set back.
const RANGES: (f64, f64) = (10.0, 0.2);

/// How an observer corrects itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GhoSettings {
    /// ζ: minus the poles of the linearised errors, 1/s.
    pub zeta: f64,
    /// For how long the correction is on, s.
    pub correction_on: f64,
    /// For how long it is then off, s.
    pub correction_off: f64,
}

impl GhoSettings {
    /// The thesis's: on for 0.06 s, off for 0.04 s, which it found better than always on.
    #[must_use]
    pub fn new(zeta: f64) -> Self {
        Self { zeta, correction_on: 0.06, correction_off: 0.04 }
    }

    /// Whether the correction is on in a step that starts at `time` (s).
    #[must_use]
    pub fn corrects(&self, time: f64) -> bool {
        let (on, off) = (self.correction_on, self.correction_off);
        let cycle = on + off;
        // Both zero: never on, never off; on is what an observer is for.
        if off <= 0.0 || cycle <= 0.0 {
            return true;
        }
        let phase = (time / cycle + CLOCK_ROUNDING).fract();
        phase * cycle < on
    }
}

/// An observer that takes one edge to be in contact.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::estimation::{Gho, GhoSettings};
/// use palpate::pushing::dynamics::{ContactMode, Finger, Part, PushModel, State};
///
/// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?;
/// let part = Part::uniform(block);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 0.3 * 9.81, finger };
/// // What the finger feels of a block pushed 5 mm off its middle ...
/// let truth = State { u: 1.6, s: 0.005, omega: 0.0, v_t: 0.0 };
/// let measured: Vec<_> = model.rollout(&ContactMode::Rolling, &truth, 0.01).take(120).map(|state| state.u).collect();
/// // ... lets an observer that thinks of 15 mm find the place within a millimetre.
/// let observer = Gho { model, contact: ContactMode::Rolling, settings: GhoSettings::new(10.0) };
/// let trace = observer.trace(State { s: 0.015, ..truth }, &measured, 0.01);
/// let true_end = model.rollout(&ContactMode::Rolling, &truth, 0.01).nth(119).unwrap();
/// assert!((trace.last().unwrap().s - true_end.s).abs() < 0.001); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Gho<'p> {
    /// Part, edge and finger.
    pub model: PushModel<'p>,
    /// How finger and part touch.
    pub contact: ContactMode,
    /// Poles of the observer, and when it corrects.
    pub settings: GhoSettings,
}

/// The motion at an estimate and what the correction needs of it.
struct Drift {
    /// f, the rates of u, s, ω and v_T.
    rates: Vector4<f64>,
    /// ∂f/∂x; row i is the gradient of the rate of state i.
    jacobian: Matrix4<f64>,
}

const U: usize = 0;
const OMEGA: usize = 2;

impl Gho<'_> {
    /// The estimates at 0, `dt`, 2 `dt`, … for as many contact angles (rad), by steps of the classical Runge–Kutta
    /// method.
    ///
    /// Contacts between two are interpolated. Whole turns of the contact angles do not count. Ends before an
    /// estimate that is not finite, or beyond all that a part does.
    #[must_use]
    pub fn trace(&self, start: State, angles: &[f64], dt: f64) -> Vec<State> {
        self.halting_trace(start, angles, dt, &Halt::new(&never)).unwrap_or_default()
    }

    /// The same; none where it should halt before its end.
    fn halting_trace(&self, start: State, angles: &[f64], dt: f64, halt: &Halt<'_>) -> Option<Vec<State>> {
        let mut trace = vec![self.complete(0.0, &start)];
        let angles = without_turns(angles, start.u);
        for (time, pair) in (0_u32..).map(|i| f64::from(i) * dt).zip(angles.windows(2)) {
            halt.goes_on()?;
            let Some(estimate) = trace.last() else { break };
            let next = self.step(time, estimate, [pair[0], pair[1]], dt);
            if self.has_diverged(&next) {
                break;
            }
            trace.push(next);
        }
        Some(trace)
    }

    /// Whether an estimate is no motion of a part: not finite, or beyond [`DIVERGED`].
    fn has_diverged(&self, estimate: &State) -> bool {
        let radius = self.model.part.inertia_per_mass().sqrt();
        let shares = [estimate.u / TAU, estimate.s / radius, estimate.omega, estimate.v_t];
        // Written so that what is not a number has diverged.
        !shares.into_iter().all(|share| share.abs() <= DIVERGED)
    }

    /// The estimate `dt` (s) after `time`, with the contact angles at both ends of the step, rad.
    #[must_use]
    pub fn step(&self, time: f64, estimate: &State, angles: [f64; 2], dt: f64) -> State {
        self.step_towards(time, estimate, self.settings.corrects(time).then_some(angles), dt)
    }

    /// The same with the correction on where there are angles, whatever the settings say, and off where there are none.
    #[must_use]
    pub fn step_towards(&self, time: f64, estimate: &State, angles: Option<[f64; 2]>, dt: f64) -> State {
        let next = ode::step(&vector(estimate), dt, |moment, x| {
            let angle = angles.map(|[from, to]| from + moment.share() * (to - from));
            self.rates(moment.time(time, dt), x, angle)
        });
        self.complete(time + dt, &state(&next))
    }

    /// An estimate set back to its range, as for Tables 6.1 and 6.2: the edge, 10 rad/s and 0.2 m/s.
    #[must_use]
    pub fn set_back(&self, estimate: &State) -> State {
        let edge = &self.model.edge;
        State {
            u: estimate.u,
            s: estimate.s.clamp(edge.s_min, edge.s_max),
            omega: estimate.omega.clamp(-RANGES.0, RANGES.0),
            v_t: estimate.v_t.clamp(-RANGES.1, RANGES.1),
        }
    }

    /// In rolling, v_T follows from the other states.
    fn complete(&self, time: f64, estimate: &State) -> State {
        match self.contact {
            ContactMode::Rolling => State { v_t: self.model.rolling_v_t(time, estimate), ..*estimate },
            ContactMode::Frictionless | ContactMode::Sliding { .. } => *estimate,
        }
    }

    /// Rates of the estimate; with an angle, pulled towards it.
    fn rates(&self, time: f64, x: &Vector4<f64>, angle: Option<f64>) -> Vector4<f64> {
        let motion = vector(&self.model.motion(&self.contact, time, &state(x)).rates);
        angle.map_or(motion, |angle| motion - self.pull(time, x) * (x[U] - angle))
    }

    /// (∂χ/∂x)⁻¹ times the gains. Where χ is singular it is not finite, as the observer is not defined there.
    fn pull(&self, time: f64, x: &Vector4<f64>) -> Vector4<f64> {
        let zeta = self.settings.zeta;
        let drift = self.drift(time, x);
        let turning = drift.jacobian.row(OMEGA).into_owned();
        if self.contact == ContactMode::Rolling {
            let chi = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, turning[0], turning[1], turning[2]);
            let gains = Vector3::new(3.0 * zeta, 3.0 * zeta.powi(2), zeta.powi(3));
            return solved(chi, gains).insert_row(3, 0.0);
        }
        let chi = Matrix4::from_rows(&[
            RowVector4::new(1.0, 0.0, 0.0, 0.0),
            RowVector4::new(0.0, 0.0, 1.0, 0.0),
            turning,
            turning * drift.jacobian + self.bend(time, x, &drift.rates),
        ]);
        solved(chi, Vector4::new(4.0 * zeta, 6.0 * zeta.powi(2), 4.0 * zeta.powi(3), zeta.powi(4)))
    }

    /// f and its derivatives at an estimate.
    fn drift(&self, time: f64, x: &Vector4<f64>) -> Drift {
        let finger =
            Finger { velocity0: self.model.finger.velocity(time), acceleration: Vector2::zeros(), ..self.model.finger };
        let model = PushModel { finger, ..self.model };
        let parameters = [Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT];
        let Seeded { model, contact, start } = Seeded::new(&model, &self.contact, &state(x), parameters);
        let rates = model.motion(&contact, 0.0, &start).rates;
        let rates = [rates.u, rates.s, rates.omega, rates.v_t];
        let jacobian = Matrix4::from_fn(|row, column| rates[row].slopes[column]);
        Drift { rates: rates.map(|rate| rate.value).into(), jacobian }
    }

    /// The change of ∇(L_f ω) along f: what ∇(L_f² ω) has beyond ∇(L_f ω) ∂f/∂x.
    fn bend(&self, time: f64, x: &Vector4<f64>, rates: &Vector4<f64>) -> RowVector4<f64> {
        let pace = self.pace(time, x, rates);
        if pace <= 0.0 {
            return RowVector4::zeros();
        }
        let look = LOOK_SHARE / pace;
        let gradient = |steps: f64| self.drift(time, &(x + rates * (steps * look))).jacobian.row(OMEGA).into_owned();
        ((gradient(1.0) - gradient(-1.0)) * 8.0 - (gradient(2.0) - gradient(-2.0))) / (12.0 * look)
    }

    /// How fast the state moves on its own scales, 1/s: a radian, the radius of gyration, the present speed.
    fn pace(&self, time: f64, x: &Vector4<f64>, rates: &Vector4<f64>) -> f64 {
        let radius = self.model.part.inertia_per_mass().sqrt();
        let [v_x, v_y] = self.model.velocity(&self.contact, time, &state(x)).into();
        let speed = v_x.hypot(v_y) + radius * x[OMEGA].abs();
        let quickening = (rates[3].abs() + radius * rates[OMEGA].abs()) / speed.max(f64::MIN_POSITIVE);
        rates[U].abs() + rates[1].abs() / radius + quickening
    }
}

/// The gains through the inverse of χ's Jacobian.
fn solved<const N: usize>(chi: SMatrix<f64, N, N>, gains: SMatrix<f64, N, 1>) -> SMatrix<f64, N, 1>
where
    Const<N>: nalgebra::DimMin<Const<N>, Output = Const<N>>,
{
    chi.lu().solve(&gains).unwrap_or_else(|| SMatrix::repeat(f64::NAN))
}

fn vector(&State { u, s, omega, v_t }: &State) -> Vector4<f64> {
    Vector4::new(u, s, omega, v_t)
}

fn state(x: &Vector4<f64>) -> State {
    State { u: x[0], s: x[1], omega: x[2], v_t: x[3] }
}

/// Angles made continuous, the first within half a turn of `near` (rad).
pub(super) fn without_turns(angles: &[f64], near: f64) -> Vec<f64> {
    let mut last = near;
    let continuous = |&angle: &f64| {
        // An angle that needs no turn is kept to the last bit.
        last = if (angle - last).abs() <= PI { angle } else { last + wrap_angle(angle - last) };
        last
    };
    angles.iter().map(continuous).collect()
}
