//! The kind `roll`: a smooth convex body rolling on a palm that translates. See [`palpate::rolling`].

use nalgebra::Vector3;
use palpate::rolling::{self, BodyError, Egg, PalmAcceleration, RollEndReason, RollError, RollingBody};
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::solve::fields::{NonNegative, Positive, Times, default_gravity};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// A smooth convex body that rolls on a palm.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Roll {
    /// The body that rolls.
    pub body: BodyFields,
    /// Whether the contact lets the body spin about the normal.
    pub spin: Spin,
    /// Gravity, m/s², against the palm's normal.
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// State at t = 0.
    pub initial: RollStartFields,
    /// Of the palm; null for a palm at rest or at constant velocity.
    #[serde(deserialize_with = "Option::deserialize")]
    pub palm_acceleration: Option<PalmFields>,
    /// When to sample, s. The run ends at the last, or with the lift-off.
    pub times: Times,
}

/// What the contact transmits beside a force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Spin {
    /// Nothing: a point contact. The body spins about the normal as it likes.
    Free,
    /// A torque about the normal, which keeps the spin at zero.
    None,
}

impl From<Spin> for rolling::Spin {
    fn from(spin: Spin) -> Self {
        match spin {
            Spin::Free => Self::Free,
            Spin::None => Self::NoSpin,
        }
    }
}

impl From<rolling::Spin> for Spin {
    fn from(spin: rolling::Spin) -> Self {
        match spin {
            rolling::Spin::Free => Self::Free,
            rolling::Spin::NoSpin => Self::None,
        }
    }
}

/// A body: one of three families of smooth convex bodies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Body")]
pub enum BodyFields {
    /// Semi-axes of an ellipsoid of uniform density, m.
    Ellipsoid([Positive; 3]),
    /// An ellipsoid whose ends along z differ.
    Egg(EggFields),
    /// A body with nearly flat faces.
    Rounded(RoundedFields),
}

/// Support function `|diag(a) p| + e·p₃³/|p|² − zc·p₃`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EggFields {
    /// Semi-axes a, m.
    pub semi_axes: [Positive; 3],
    /// Skew e along z, m.
    pub e: f64,
    /// Shift zc of the origin along z, m.
    pub zc: f64,
    /// Principal moments of inertia over the mass, m²; those of uniform density where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia_per_mass: Option<[Positive; 3]>,
}

/// Support function `r|p| + (Σ (aᵢ pᵢ)⁴)^¼`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RoundedFields {
    /// Semi-axes a of the part that r is added to, m.
    pub semi_axes: [Positive; 3],
    /// Least radius of curvature, m.
    pub r: Positive,
    /// Principal moments of inertia over the mass, m²; those of uniform density where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia_per_mass: Option<[Positive; 3]>,
}

/// A rolling body at t = 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Initial")]
pub struct RollStartFields {
    /// Quaternion `[w, x, y, z]` of length 1, body → palm.
    pub orientation: [f64; 4],
    /// Angular velocity, body axes, rad/s.
    pub omega: [f64; 3],
    /// The contact on the palm, m.
    pub u: [f64; 2],
}

/// The acceleration of a palm over time, palm axes, e₃ up along its normal, m/s².
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Acceleration")]
pub enum PalmFields {
    /// Always the same.
    Constant([f64; 3]),
    /// Σ amplitude·sin(2π·frequency_hz·t + phase).
    Harmonic(Vec<HarmonicFields>),
    /// Constant from each instant to the next.
    Piecewise(Piecewise),
}

/// One harmonic.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Harmonic")]
pub struct HarmonicFields {
    /// Amplitude, palm axes, m/s².
    pub amplitude: [f64; 3],
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Phase at t = 0, rad.
    pub phase: f64,
}

/// Accelerations and when each begins; the last lasts.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "PiecewiseFields", into = "PiecewiseFields")]
pub struct Piecewise(rolling::Pieces, PiecewiseFields);

/// The JSON form of [`Piecewise`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct PiecewiseFields {
    /// s, increasing, the first not after 0.
    t: Vec<f64>,
    /// Accelerations, palm axes, m/s².
    a: Vec<[f64; 3]>,
}

impl TryFrom<PiecewiseFields> for Piecewise {
    type Error = InvalidInput;

    fn try_from(fields: PiecewiseFields) -> Result<Self, InvalidInput> {
        let values = fields.a.iter().copied().map(Vector3::from).collect();
        let pieces = rolling::Pieces::new(fields.t.clone(), values).map_err(|error| {
            let field = match error {
                rolling::PiecesError::Order { index, .. } => Pointer::from("t").index(index),
                rolling::PiecesError::Lengths { .. } => Pointer::from("a"),
                _ => Pointer::from("t"),
            };
            InvalidInput::at(field, error.to_string())
        })?;
        if pieces.start() > 0.0 {
            let message =
                format!("begins at {:?} s, it must begin at 0 s or before: add its value at 0", pieces.start());
            return Err(InvalidInput::at(Pointer::from("t").index(0), message));
        }
        Ok(Self(pieces, fields))
    }
}

impl From<Piecewise> for PiecewiseFields {
    fn from(Piecewise(_, fields): Piecewise) -> Self {
        fields
    }
}

/// How a body rolled.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct RollAnswer {
    /// The body at each time asked for, up to the end.
    pub samples: Vec<RollSampleAnswer>,
    /// What ended the run.
    pub end: RollEndAnswer,
    /// The largest ratio of tangential to normal contact force at the samples: rolling needs at least this coefficient of
    /// friction. Null where the contact carries nothing.
    pub friction_needed: Option<f64>,
}

/// A rolling body at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "RollSample")]
pub struct RollSampleAnswer {
    /// Time since the roll began, s.
    pub t: f64,
    /// The contact on the palm, m.
    pub u: [f64; 2],
    /// `[w, x, y, z]`, body → palm.
    pub orientation: [f64; 4],
    /// Angular velocity, body axes, rad/s.
    pub omega: [f64; 3],
    /// The contact on the body, body axes, m.
    pub contact_body: [f64; 3],
    /// On the body, over its mass, palm axes, m/s².
    pub contact_force: [f64; 3],
    /// Kinetic energy relative to the palm plus g × height of the centre of mass, over the mass, m²/s².
    pub energy: f64,
}

/// The end of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[schemars(rename = "RollEnd")]
pub struct RollEndAnswer {
    /// Why the run ended.
    pub reason: RollEndReasonAnswer,
    /// Time since the roll began, s.
    pub t: f64,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
#[schemars(rename = "Reason")]
pub enum RollEndReasonAnswer {
    /// The last time asked for.
    Time,
    /// The contact would have to pull.
    LiftOff,
}

impl Problem for Roll {
    const KIND: &'static str = "roll";
    type Answer = RollAnswer;

    fn solve(&self) -> Result<RollAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<RollAnswer>, SolveError> {
        let body = self.body.build().map_err(|error| error.inside("body"))?;
        let palm = palm_acceleration(self.palm_acceleration.as_ref());
        let RollStartFields { orientation, omega, u } = self.initial;
        let on = rolling::OnPalm { body: &body, spin: self.spin.into(), palm: &palm, g: self.g.get() };
        let roll = rolling::Roll::new(on, orientation, omega, u).map_err(refuse)?;
        let run = roll.run_until(&self.times, stop).map_err(|error| match error {
            RollError::Stopped { .. } => SolveError::Stopped,
            _ => SolveError::Internal(error.to_string()),
        })?;
        Ok(Searched { found: RollAnswer::from(&run), complete: true })
    }
}

fn refuse(error: RollError) -> InvalidInput {
    let key = if matches!(error, RollError::Quaternion { .. }) { "orientation" } else { "omega" };
    InvalidInput::at(Pointer::from("initial").key(key), error.to_string())
}

/// The acceleration of the palm that a problem's field describes.
#[must_use]
pub fn palm_acceleration(field: Option<&PalmFields>) -> PalmAcceleration {
    match field {
        None => PalmAcceleration::Rest,
        Some(PalmFields::Constant(a)) => PalmAcceleration::Constant(Vector3::from(*a)),
        Some(PalmFields::Piecewise(Piecewise(pieces, _))) => PalmAcceleration::Piecewise(pieces.clone()),
        Some(PalmFields::Harmonic(harmonics)) => {
            let harmonic = |harmonic: &HarmonicFields| rolling::Harmonic {
                amplitude: Vector3::from(harmonic.amplitude),
                frequency_hz: harmonic.frequency_hz,
                phase: harmonic.phase,
            };
            PalmAcceleration::Harmonic(harmonics.iter().map(harmonic).collect())
        }
    }
}

impl BodyFields {
    /// The body itself.
    ///
    /// # Errors
    /// [`InvalidInput`], seen from the body's own field, for a body that is not strictly convex or whose centroid is not the
    /// origin.
    pub fn build(&self) -> Result<RollingBody, InvalidInput> {
        let numbers = |values: &[Positive; 3]| values.map(Positive::get);
        match self {
            Self::Ellipsoid(axes) => RollingBody::ellipsoid(numbers(axes)).map_err(|error| at("ellipsoid", &error)),
            Self::Egg(fields) => {
                let egg = Egg { semi_axes: numbers(&fields.semi_axes), skew: fields.e, origin: fields.zc };
                let inertia = fields.inertia_per_mass.as_ref().map(numbers);
                RollingBody::egg(egg, inertia).map_err(|error| at("egg", &error))
            }
            Self::Rounded(fields) => {
                let rounded = rolling::RoundedShape { semi_axes: numbers(&fields.semi_axes), radius: fields.r.get() };
                let inertia = fields.inertia_per_mass.as_ref().map(numbers);
                RollingBody::rounded(rounded, inertia).map_err(|error| at("rounded", &error))
            }
        }
    }
}

/// A body's error at the field to look at first.
fn at(family: &str, error: &BodyError) -> InvalidInput {
    let inside = Pointer::from(family);
    let field = match *error {
        BodyError::Centroid { .. } if family == "egg" => inside.key("zc"),
        BodyError::NotConvex { .. } if family == "egg" => inside.key("e"),
        BodyError::NotConvex { .. } if family == "rounded" => inside.key("r"),
        BodyError::OriginOutside { .. } if family == "egg" => inside.key("zc"),
        BodyError::Inertia { axis, .. } | BodyError::Triangle { axis, .. } => {
            inside.key("inertia_per_mass").index(axis)
        }
        _ => inside,
    };
    InvalidInput::at(field, error.to_string())
}

/// `[w, x, y, z]`.
#[must_use]
pub fn wxyz(q: &nalgebra::Quaternion<f64>) -> [f64; 4] {
    [q.w, q.i, q.j, q.k]
}

impl From<&rolling::RollRun> for RollAnswer {
    fn from(run: &rolling::RollRun) -> Self {
        let reason = match run.end.reason {
            RollEndReason::Time => RollEndReasonAnswer::Time,
            RollEndReason::LiftOff => RollEndReasonAnswer::LiftOff,
        };
        Self {
            samples: run.samples.iter().map(RollSampleAnswer::from).collect(),
            end: RollEndAnswer { reason, t: run.end.t },
            friction_needed: Some(run.friction_needed).filter(|friction| friction.is_finite()),
        }
    }
}

impl From<&rolling::RollSample> for RollSampleAnswer {
    fn from(sample: &rolling::RollSample) -> Self {
        Self {
            t: sample.t,
            u: sample.state.u.into(),
            orientation: wxyz(&sample.state.orientation),
            omega: sample.state.omega.into(),
            contact_body: sample.contact_body.into(),
            contact_force: sample.contact_force.into(),
            energy: sample.energy,
        }
    }
}
