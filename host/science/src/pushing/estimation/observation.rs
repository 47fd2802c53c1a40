//! What is known of a push, what was felt of it, and what that says: plain data.
//!
//! Frames: world, unless named. Units: SI, forces per unit mass of the part. Errors: none; the caller has checked the values.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Matrix4, Point2, Rotation2, Vector2};

use super::planning::Belief;
use crate::math::angle::wrap_angle;
use crate::pushing::dynamics::{Contact, ContactLaw, Edge, Finger, Part, PushModel, State};

/// What is known of a push beforehand.
#[derive(Clone, Copy, Debug)]
pub struct Known<'p> {
    /// The part.
    pub part: &'p Part,
    /// µ g, m/s².
    pub grip: f64,
    /// The finger and its motion from t = 0 on.
    pub finger: Finger,
    /// How finger and part touch.
    pub touch: Touch,
}

/// A finger slower than this starts at rest, m/s: it would go a micrometre in a second, and friction would stop it within a third of a
/// microsecond.
const REST_SPEED: f64 = 1e-6;

impl<'p> Known<'p> {
    /// Whether the finger is at rest at t = 0, and with it the part.
    pub(super) fn starts_at_rest(&self) -> bool {
        Vector2::from(self.finger.velocity0).norm() <= REST_SPEED
    }

    /// The dynamics with one edge in contact.
    pub(super) fn model(&self, edge: Edge) -> PushModel<'p> {
        PushModel { part: self.part, edge, grip: self.grip, finger: self.finger }
    }
}

/// What is known of the contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Touch {
    /// No contact friction.
    Frictionless,
    /// No slip; with a friction, only where that suffices.
    Rolling {
        /// µ_c.
        friction: Option<f64>,
    },
    /// Slip throughout, in one direction that is to be found.
    Sliding {
        /// µ_c.
        friction: f64,
    },
    /// Rolls and slides as Coulomb's law demands.
    Coulomb {
        /// µ_c.
        friction: f64,
    },
}

/// Values of one kind, one each `dt`.
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// At 0, dt, 2 dt, …; at least one. NaN for one that is missing.
    pub values: Vec<f64>,
    /// Standard deviation of one, above 0.
    pub sigma: f64,
}

/// What was felt.
#[derive(Clone, Debug, PartialEq)]
pub enum Measured {
    /// Polar angles of the contact seen from the disk's centre, rad.
    ContactAngle(Channel),
    /// The force on the part; at least one of the two, of one length.
    Force {
        /// World angles, rad.
        direction: Option<Channel>,
        /// Natural logarithms of the force per mass in m/s².
        magnitude: Option<Channel>,
        /// Where the contact angle at t = 0 can be, rad, in order; anywhere if none.
        u0_range: Option<[f64; 2]>,
        /// The part's mass is not known, or the force's unit: magnitudes are right but for a factor that they share.
        mass_is_unknown: bool,
    },
}

/// The plane's friction is within e³, a factor of twenty, of what it is taken for, however little is known of it.
pub(super) const GRIP_LOG_MAX: f64 = 3.0;

/// What is known of the motion at t = 0: standard deviations about zero, what is not given is bounded instead; and of the plane.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Prior {
    /// Of ω, rad/s.
    pub omega0_sigma: Option<f64>,
    /// Of v_T, m/s.
    pub v_t0_sigma: Option<f64>,
    /// Of ln(µg) about that of [`Known::grip`]: 0.2 where it is known to a fifth. Every hypothesis then has a friction of its own.
    /// None where the friction is known.
    pub grip_log_sigma: Option<f64>,
}

/// Data of a push and what is known of its start.
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Time between values, s.
    pub dt: f64,
    /// The values.
    pub measured: Measured,
    /// The start.
    pub prior: Prior,
}

impl Hypothesis {
    /// What a motion planner starts from, where the pose is known at all: the same at the last value's time.
    #[must_use]
    pub fn belief(&self, known: &Known) -> Option<Belief> {
        let law = match (known.touch, self.contact_end) {
            (Touch::Frictionless, _) => ContactLaw::Frictionless,
            (Touch::Rolling { friction }, _) => ContactLaw::Rolling { friction },
            (Touch::Sliding { friction }, Contact::Sliding { slip, .. }) => ContactLaw::Sliding { friction, slip },
            (Touch::Sliding { friction } | Touch::Coulomb { friction }, _) => ContactLaw::Coulomb { friction },
        };
        let (covariance, probability) = (self.state_covariance?, self.probability);
        Some(Belief { edge: self.edge, law, state: self.end, covariance, probability })
    }
}

impl Observation {
    /// How many instants were measured.
    #[must_use]
    #[expect(clippy::len_without_is_empty, reason = "there is at least one")]
    pub fn len(&self) -> usize {
        match &self.measured {
            Measured::ContactAngle(channel) => channel.values.len(),
            Measured::Force { direction, magnitude, .. } => {
                direction.iter().chain(magnitude).map(|channel| channel.values.len()).min().unwrap_or(0)
            }
        }
    }
}

/// What an observation says.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Everything that the data cannot exclude, most probable first; empty if they exclude all.
    pub hypotheses: Vec<Hypothesis>,
    /// How well the best one fits.
    pub fit: Fit,
    /// Values that no smooth motion passes through, by their place; left out where nothing explains the data with them.
    pub outliers: Vec<usize>,
    /// Forward simulations that it took, those with derivatives included.
    pub simulations: usize,
}

/// Goodness of fit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// The least cost of anything that is physically possible, even if it is too large; none where nothing is.
    pub cost: Option<f64>,
    /// Data and prior terms less fitted parameters.
    pub degrees_of_freedom: usize,
    /// The 99.9 % quantile of chi-square: above it the model is wrong.
    pub cost_max: f64,
}

/// One explanation of the data: a local minimum of the cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// The edge in contact.
    pub edge: usize,
    /// At t = 0.
    pub start: State,
    /// What the contact does at t = 0.
    pub contact_start: Contact,
    /// At the last value.
    pub end: State,
    /// What the contact does at the last value.
    pub contact_end: Contact,
    /// x, y (m) and theta (rad) of the part's frame at the last value.
    pub pose_end: [f64; 3],
    /// Velocity of the centre of mass at the last value, m/s.
    pub velocity_end: Vector2<f64>,
    /// Of `pose_end`; none where the data leave the pose free.
    pub covariance: Option<Matrix3<f64>>,
    /// Of `end`: u, s, ω, v_T; none where `covariance` is none. In rolling, v_T follows from the others.
    pub state_covariance: Option<Matrix4<f64>>,
    /// µ g, m/s²: as known, or with [`Prior::grip_log_sigma`] as the data and the prior have it.
    pub grip: f64,
    /// Standard deviation of ln(µg), 0 where that is known; none where `covariance` is none.
    pub grip_log_sd: Option<f64>,
    /// Squared residuals in standard deviations, prior terms included.
    pub cost: f64,
    /// Among the hypotheses, by Laplace's approximation; before the push every place of the perimeter is as likely.
    pub probability: f64,
}

/// Pose of the part's frame (x, y in m, theta in rad) at a state reached from contact angle `u0`.
///
/// The turn is in (−π, π] at the start and continuous from there.
pub(super) fn pose(model: &PushModel, u0: f64, time: f64, state: &State) -> [f64; 3] {
    let toward = model.edge.normal.y.atan2(model.edge.normal.x);
    let theta = wrap_angle(u0 + PI - toward) + state.u - u0;
    let centre = model.centre_of_mass(time, state);
    let origin: Point2<f64> = centre - Rotation2::new(theta) * model.part.centre_of_mass().coords;
    [origin.x, origin.y, theta]
}
