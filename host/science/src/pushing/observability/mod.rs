//! What the contact angle tells about a pushed part.
//!
//! The state is u, s, ω and, unless the contact rolls, v_T; the finger's motion is known. A change of state shows if it
//! changes u(t) over a short window, to first order. For these analytic equations that is the rank of du, du̇, dü, …
//! (thesis §4.2.1): a window weighs all orders at once, where each by itself would need its own scale.
//!
//! [`constant_velocity`] takes the orders one by one, for a finger that does not accelerate, in two precisions.
//!
//! Implements: the question of thesis Theorems 19, 21 and 23 for the actual motion of the finger instead of for
//! arbitrary ones.
//! Assumes: the contact lasts in its mode, whatever its force; the window ends before the part comes to rest or,
//! sliding, jams.
//! Frames: as [`crate::pushing::dynamics`]. Units: SI; state changes scaled by [`Scales`].
//! Errors: [`PushObservabilityError`], where there is no window at all.

pub mod constant_velocity;

use nalgebra::{DMatrix, RowDVector};

use crate::math::{Jet, Spectrum};
use crate::pushing::dynamics::contact_mode::JAM_DENOMINATOR;
use crate::pushing::dynamics::{ContactMode, Parameter, PushModel, Seeded, State};

/// Length of the window in √(L/g): about 0.2 s for a part of 3 cm, ten times as long as friction takes to forget speed.
const WINDOW: f64 = 4.0;

/// The first look at u after the start, as a share of the time in which anything changes.
const LOOK_FIRST: f64 = 0.01;

/// Factor from one look to the next: fast changes show early, slow ones late, and each gets its share of looks.
const LOOK_GROWTH: f64 = 1.25;

/// Length of a step as a share of the time in which anything changes: a Runge–Kutta step then errs by 1e-8 of what it
/// adds.
const STEP_SHARE: f64 = 0.05;

/// Steps after which the window ends: a part at a tenth of a millimetre a second is that stiff.
const STEPS_MAX: usize = 20_000;

/// The window ends where the part is slower than this share of its speed at the start: friction has no direction at
/// rest.
const SPEED_SHARE_MIN: f64 = 0.02;

/// Sliding denominator, of its value at the start, at which the window ends: the force grows without bound (Painlevé).
const DENOMINATOR_SHARE_MIN: f64 = 0.05;

/// Names of the states, in the order of the columns.
pub const STATE_NAMES: [&str; 4] = ["u", "s", "omega", "vT"];

/// What a change of each state is measured by, so that all are numbers of order 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scales {
    /// L, the radius of gyration, m.
    pub length: f64,
    /// Unit of time, √(L/g), s.
    pub time: f64,
}

impl Scales {
    /// Of u, s, ω and v_T: 1 rad, L, √(g/L) and √(gL).
    #[must_use]
    pub fn of_states(&self) -> [f64; 4] {
        [1.0, self.length, 1.0 / self.time, self.length / self.time]
    }
}

/// Nothing can be said about a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PushObservabilityError {
    /// Friction has no direction there.
    #[error("the part is at rest, where friction has no direction: give it a motion")]
    AtRest,
    /// There is no force that keeps the contact.
    #[error("no contact force fits this sliding part (Painlevé): change s or mu_c")]
    Jammed,
}

/// Which changes of a push's state show in its contact angle.
///
/// # Errors
/// [`PushObservabilityError`].
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::observability::{Scales, spectrum};
/// use palpate::pushing::dynamics::{ContactMode, Finger, Part, PushModel, State};
///
/// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?;
/// let part = Part::uniform(block);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 0.3 * 9.81, finger };
/// let state = State { u: 1.6, s: 0.005, omega: 0.2, v_t: 0.0 };
/// let scales = Scales { length: 0.02, time: 0.045 };
/// assert!(spectrum(&model, &ContactMode::Rolling, &state, &scales)?.observable());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn spectrum(
    model: &PushModel,
    contact: &ContactMode,
    state: &State,
    scales: &Scales,
) -> Result<Spectrum, PushObservabilityError> {
    let state = match contact {
        ContactMode::Rolling => State { v_t: model.rolling_v_t(0.0, state), ..*state },
        ContactMode::Frictionless | ContactMode::Sliding { .. } => *state,
    };
    let pace = Pace::new(model, contact, &state, scales)?;
    let parameters = [Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT];
    let looks = Window { seeded: Seeded::new(model, contact, &state, parameters), pace }.looks();
    let states = if *contact == ContactMode::Rolling { 3 } else { 4 };
    let scaled = scales.of_states();
    let outputs = DMatrix::from_fn(looks.len().max(states), states, |row, column| {
        looks.get(row).map_or(0.0, |look| look[column] * scaled[column])
    });
    Ok(Spectrum::of(outputs))
}

/// How fast things change, and when that can no longer be followed.
#[derive(Clone, Copy)]
struct Pace<'a> {
    model: &'a PushModel<'a>,
    contact: &'a ContactMode,
    window: f64,
    time: f64,
    speed: f64,
    denominator: f64,
}

impl<'a> Pace<'a> {
    fn new(
        model: &'a PushModel,
        contact: &'a ContactMode,
        state: &State,
        scales: &Scales,
    ) -> Result<Self, PushObservabilityError> {
        let window = WINDOW * scales.time;
        let mut pace = Self { model, contact, window, time: scales.time, speed: 0.0, denominator: 0.0 };
        pace.speed = pace.speed(0.0, state);
        pace.denominator = pace.denominator(state.s);
        match () {
            () if pace.speed == 0.0 => Err(PushObservabilityError::AtRest),
            () if pace.denominator.abs() < JAM_DENOMINATOR => Err(PushObservabilityError::Jammed),
            () => Ok(pace),
        }
    }

    /// Of the part, its turning counted at the radius of gyration, m/s.
    fn speed(&self, time: f64, state: &State) -> f64 {
        let velocity = self.model.velocity(self.contact, time, state);
        velocity.norm() + self.model.part.inertia_per_mass().sqrt() * state.omega.abs()
    }

    fn denominator(&self, s: f64) -> f64 {
        match *self.contact {
            ContactMode::Sliding { friction, slip } => self.model.sliding_denominator(friction * slip.sign(), s),
            ContactMode::Frictionless | ContactMode::Rolling => 1.0,
        }
    }

    /// The time in which anything changes, s: friction, the turning part, or the window itself.
    fn time_of_change(&self, time: f64, state: &State) -> f64 {
        let friction = self.speed(time, state) / self.model.mu_g;
        let turning = 1.0 / state.omega.abs();
        let near_jam = (self.denominator(state.s) / self.denominator).abs().min(1.0);
        near_jam * self.time.min(friction).min(turning)
    }

    /// Whether the equations still say something.
    fn lasts(&self, time: f64, state: &State) -> bool {
        let moving = self.speed(time, state) > SPEED_SHARE_MIN * self.speed;
        moving && self.denominator(state.s) / self.denominator > DENOMINATOR_SHARE_MIN
    }
}

/// The push over the window, with its derivatives by the state at its start.
struct Window<'a> {
    seeded: Seeded<'a, 4>,
    pace: Pace<'a>,
}

impl Window<'_> {
    /// du at the start and at each look.
    fn looks(&self) -> Vec<RowDVector<f64>> {
        let mut state = self.seeded.start;
        let mut looks = vec![gradient(&state.u)];
        let (mut time, mut look) = (0.0, LOOK_FIRST * self.pace.time_of_change(0.0, &values(&state)));
        for _ in 0..STEPS_MAX {
            let step = (STEP_SHARE * self.pace.time_of_change(time, &values(&state))).min(look - time);
            let next = self.seeded.model.step(&self.seeded.contact, time, &state, step);
            // Written so that NaN ends it too.
            if !(time + step > time && self.pace.lasts(time + step, &values(&next))) {
                break;
            }
            (time, state) = (time + step, next);
            if time >= look {
                looks.push(gradient(&state.u));
                look = time * LOOK_GROWTH;
            }
            if time >= self.pace.window {
                break;
            }
        }
        looks
    }
}

fn values(state: &State<Jet<4>>) -> State {
    State { u: state.u.value, s: state.s.value, omega: state.omega.value, v_t: state.v_t.value }
}

fn gradient(u: &Jet<4>) -> RowDVector<f64> {
    RowDVector::from_row_slice(&u.slopes)
}

#[cfg(test)]
mod tests;
