//! What is known of a push and what was felt of it: plain data.
//!
//! Frames: world, unless named. Units: SI, forces per unit mass of the part. Errors: none; the caller has checked the
//! values.

use std::ops::RangeInclusive;

use crate::pushing::dynamics::contact_mode::ContactFriction;
use crate::pushing::dynamics::{ContactLaw, ContactMode, Edge, Finger, Part, PushModel};

/// What is known of a push beforehand.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::{Finger, Known, Part, SimplePolygon, Touch};
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let known = Known { part: &part, mu_g: 0.3 * 9.81, finger, touch: Touch::Rolling { friction: None } };
/// assert_eq!(known.part.polygon().vertices().len(), 4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct Known<'p> {
    /// The part on its plane.
    pub part: &'p Part,
    /// µ g of the plane, m/s².
    pub mu_g: f64,
    /// The finger and its motion from t = 0 on.
    pub finger: Finger,
    /// How finger and part touch.
    pub touch: Touch,
}

/// A finger slower than this starts at rest, m/s: it would go a micrometre in a second, and friction would stop it
/// within a third of a microsecond.
const REST_SPEED: f64 = 1e-6;

impl Touch {
    /// By which law the contact goes on from what it does now.
    pub(super) fn law(self, contact: ContactMode) -> ContactLaw {
        match (self, contact) {
            (Self::Frictionless, _) => ContactLaw::Frictionless,
            (Self::Rolling { friction }, _) => ContactLaw::Rolling { friction },
            (Self::Sliding { friction }, ContactMode::Sliding { slip, .. }) => ContactLaw::Sliding { friction, slip },
            (Self::Sliding { friction } | Self::Coulomb { friction }, _) => ContactLaw::Coulomb { friction },
        }
    }
}

impl<'p> Known<'p> {
    /// Whether the finger is at rest at t = 0, and with it the part.
    pub(super) fn starts_at_rest(&self) -> bool {
        self.finger.velocity0.norm() <= REST_SPEED
    }

    /// The dynamics with one edge in contact.
    pub(super) fn model(&self, edge: Edge) -> PushModel<'p> {
        PushModel { part: self.part, edge, mu_g: self.mu_g, finger: self.finger }
    }
}

/// What is known of the contact.
///
/// ```
/// use palpate::Touch;
///
/// assert_ne!(Touch::Coulomb { friction: 0.3 }, Touch::Sliding { friction: 0.3 }); // may stick; never sticks
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Touch {
    /// Without friction between finger and part.
    Frictionless,
    /// No slip; with a friction, only where that suffices.
    Rolling {
        /// µ_c, between finger and part.
        friction: Option<f64>,
    },
    /// Slip throughout, in one direction that is to be found.
    Sliding {
        /// µ_c, between finger and part.
        friction: f64,
    },
    /// Rolls and slides as Coulomb's law demands.
    Coulomb {
        /// µ_c, between finger and part.
        friction: f64,
    },
}

impl Touch {
    /// The friction that decides between rolling and sliding; none where what the contact does is known.
    pub(super) fn deciding_friction(self) -> Option<ContactFriction> {
        match self {
            Self::Coulomb { friction } => Some(ContactFriction::same(friction)),
            Self::Frictionless | Self::Rolling { .. } | Self::Sliding { .. } => None,
        }
    }
}

/// Values of one kind, one each `dt`.
///
/// ```
/// use palpate::Channel;
///
/// let angles = Channel { values: vec![1.6, f64::NAN, 1.62], sigma: 2e-3 }; // rad; the second was lost
/// assert_eq!(angles.values.iter().filter(|value| value.is_nan()).count(), 1);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Channel {
    /// At 0, dt, 2 dt, …; at least one. NaN for one that is missing.
    pub values: Vec<f64>,
    /// Standard deviation of one, above 0.
    pub sigma: f64,
}

/// Which quantity the finger measured, and its values.
///
/// ```
/// use palpate::{Channel, Measured};
///
/// // A sensor that tells the force's direction, but not where it is touched.
/// let direction = Some(Channel { values: vec![1.5, 1.52], sigma: 5e-3 }); // rad
/// let felt = Measured::Force { direction, magnitude: None, u0_range: Some(1.0..=2.0), mass_is_unknown: false };
/// assert!(matches!(felt, Measured::Force { magnitude: None, .. }));
/// ```
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
        /// Where the contact angle at t = 0 can be, rad; anywhere if none.
        u0_range: Option<RangeInclusive<f64>>,
        /// The part's mass is not known, or the force's unit: magnitudes are right but for a factor that they share.
        mass_is_unknown: bool,
    },
}

/// The plane's friction is within e³, a factor of twenty, of what it is taken for, however little is known of it.
pub(super) const MU_G_LOG_MAX: f64 = 3.0;

/// What is known of the motion at t = 0: standard deviations about zero, what is not given is bounded instead; and of
/// the plane.
///
/// ```
/// use palpate::Prior;
///
/// // The part hardly turns at first, and the table's friction is known to a fifth.
/// let prior = Prior { omega0_sigma: Some(0.1), mu_g_log_sigma: Some(0.2), ..Prior::default() }; // rad/s, 1
/// assert_eq!(prior.v_t0_sigma, None); // bounded instead
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Prior {
    /// Standard deviation of ω, rad/s.
    pub omega0_sigma: Option<f64>,
    /// Standard deviation of v_T, m/s.
    pub v_t0_sigma: Option<f64>,
    /// Of ln(µg) about that of [`Known::mu_g`]: 0.2 where it is known to a fifth. Every hypothesis then has a friction
    /// of its own. None where the friction is known.
    pub mu_g_log_sigma: Option<f64>,
}

/// Data of a push and what is known of its start.
///
/// ```
/// use palpate::{Channel, Measured, Observation, Prior};
///
/// let measured = Measured::ContactAngle(Channel { values: vec![1.6, 1.605, 1.62], sigma: 2e-3 }); // rad
/// let observation = Observation { dt: 0.05, measured, prior: Prior::default() };
/// assert_eq!(observation.len(), 3);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Observation {
    /// Time between values, s.
    pub dt: f64,
    /// What was felt, one value each `dt` from t = 0 on.
    pub measured: Measured,
    /// What is known of the start beforehand.
    pub prior: Prior,
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
