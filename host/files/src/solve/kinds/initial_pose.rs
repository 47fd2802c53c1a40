//! The kind `initial_pose`: the resting pose of a part from a few contacts of a push from rest. See
//! [`palpate::pushing::estimation`].

use nalgebra::Vector2;
use palpate::pushing::dynamics::{FingerPath, FingerShape, ShapeError};
use palpate::pushing::estimation::{InitialPoseError, Object, RestingPose, RestingPush, TimedContact};
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use crate::solve::fields::{
    NonNegative, Polygon, PoseFields, Positive, check_travel, default_gravity, plane_friction, size,
};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError, tagged};

/// A finger that pushes a resting part and feels where it is touched at some times: how did the part lie?
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct InitialPose {
    /// Outline and motion of the finger.
    pub finger: ShapedFinger,
    /// The part that is pushed, in its own frame.
    pub object: PushedObject,
    /// Friction between part and plane.
    #[serde(deserialize_with = "plane_friction")]
    pub mu: NonNegative,
    /// Gravity, m/s².
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// Where the finger is touched at t = 0: polar angle of a disk, eccentric angle of an ellipse, rad; m on a line.
    pub u0: f64,
    /// `[t, u]`: where it is touched later; times in s, increasing. Whole turns of an angle do not count.
    pub contacts: Vec<[f64; 2]>,
    /// How far a prediction may be from a contact, in the unit of `u0`.
    #[serde(default = "default_tolerance")]
    pub tolerance: Positive,
}

/// The default of `tolerance`, rad or m.
const TOLERANCE_DEFAULT: f64 = 1e-4;

/// The most that `tolerance` may be on a finger's curve, rad: contacts farther apart than that are on its other side.
const TOLERANCE_MAX_RAD: f64 = 1.0;

fn default_tolerance() -> Positive {
    // Above 0, so the other branch is never taken.
    Positive::try_from(TOLERANCE_DEFAULT).unwrap_or_else(|_| unreachable!("the default tolerance is above 0"))
}

/// A finger at rest at t = 0 that accelerates without turning; its axes are the world's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(tag = "type", rename_all = "snake_case")]
pub enum ShapedFinger {
    /// A disk.
    Disk(DiskFinger),
    /// An ellipse with its axes along the world's.
    Ellipse(EllipseFinger),
    /// A straight edge along the world's x; the part is above it.
    Line(LineFinger),
}

/// A disk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct DiskFinger {
    /// Radius of the disk, m; 0 for a point.
    pub radius: NonNegative,
    /// Centre at t = 0, m.
    #[serde(default)]
    pub centre0: [f64; 2],
    /// Acceleration, constant, world axes, m/s².
    pub acceleration: [f64; 2],
}

/// An ellipse.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EllipseFinger {
    /// Semi-axis along x, m.
    pub a: Positive,
    /// Semi-axis along y, m.
    pub b: Positive,
    /// Centre at t = 0, m.
    #[serde(default)]
    pub centre0: [f64; 2],
    /// Acceleration, constant, world axes, m/s².
    pub acceleration: [f64; 2],
}

/// A straight edge: at (−u, 0) from its point.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LineFinger {
    /// Its point at t = 0, m.
    #[serde(default)]
    pub centre0: [f64; 2],
    /// Acceleration, constant, world axes, m/s².
    pub acceleration: [f64; 2],
}

impl<'de> Deserialize<'de> for ShapedFinger {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        tagged(
            deserializer,
            "type",
            &[
                ("disk", |fields| fields.read().map(Self::Disk)),
                ("ellipse", |fields| fields.read().map(Self::Ellipse)),
                ("line", |fields| fields.read().map(Self::Line)),
            ],
        )
    }
}

impl ShapedFinger {
    fn shape(self) -> FingerShape {
        match self {
            Self::Disk(DiskFinger { radius, .. }) => FingerShape::Disk { radius: radius.get() },
            Self::Ellipse(EllipseFinger { a, b, .. }) => FingerShape::Ellipse { semi_axes: [a.get(), b.get()] },
            Self::Line(_) => FingerShape::Line,
        }
    }

    fn path(self) -> FingerPath {
        let (centre0, acceleration) = match self {
            Self::Disk(DiskFinger { centre0, acceleration, .. })
            | Self::Ellipse(EllipseFinger { centre0, acceleration, .. })
            | Self::Line(LineFinger { centre0, acceleration }) => (centre0, acceleration),
        };
        FingerPath { centre0: centre0.into(), velocity0: Vector2::zeros(), acceleration: acceleration.into() }
    }
}

/// What is pushed: a plate of uniform density and pressure.
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(tag = "type", rename_all = "snake_case")]
pub enum PushedObject {
    /// A polygon.
    Polygon(PolygonObject),
    /// An ellipse with its axes along the part's.
    Ellipse(EllipseObject),
}

/// A polygon.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PolygonObject {
    /// Its outline, part frame, m.
    pub vertices: Polygon,
}

/// An ellipse.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct EllipseObject {
    /// Semi-axis along the part's x, m.
    pub a: Positive,
    /// Semi-axis along the part's y, m.
    pub b: Positive,
}

impl<'de> Deserialize<'de> for PushedObject {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        tagged(
            deserializer,
            "type",
            &[
                ("polygon", |fields| fields.read().map(Self::Polygon)),
                ("ellipse", |fields| fields.read().map(Self::Ellipse)),
            ],
        )
    }
}

/// How the part may have lain.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct InitialPoseAnswer {
    /// How many poses fit every contact.
    pub status: PoseStatus,
    /// Poses that fit every contact, best first.
    pub solutions: Vec<PoseFit>,
    /// Poses that fit the first contact alone, best first.
    pub candidates: Vec<PoseFit>,
}

/// How many poses there are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PoseStatus {
    /// One.
    Unique,
    /// Several, or one of a continuum.
    Ambiguous,
    /// No pose of this part leads to these contacts.
    #[serde(rename = "none")]
    Unexplained,
}

/// A pose and how well it fits.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PoseFit {
    /// The edge that holds the contact at the last one that is explained; null on an ellipse. `s0` is on the same side.
    pub edge: Option<usize>,
    /// Where it is touched at t = 0: m along the edge from the foot of the perpendicular through the centroid; on an ellipse the
    /// eccentric angle in [0, π).
    pub s0: f64,
    /// At t = 0.
    pub pose0: PoseFields,
    /// u as predicted less u as given, for each contact that it is to fit.
    pub residuals: Vec<f64>,
    /// Whether any other place on this side fits too: this is one of a continuum.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub unobservable: bool,
}

impl Problem for InitialPose {
    const KIND: &'static str = "initial_pose";
    type Answer = InitialPoseAnswer;

    fn solve(&self) -> Result<InitialPoseAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<InitialPoseAnswer>, SolveError> {
        let contacts = self.contacts()?;
        self.check_travel(&contacts)?;
        let object = match &self.object {
            PushedObject::Polygon(PolygonObject { vertices }) => Object::Polygon((**vertices).clone()),
            PushedObject::Ellipse(EllipseObject { a, b }) => Object::Ellipse([a.get(), b.get()]),
        };
        let mu_g = self.mu.get() * self.g.get();
        let push = RestingPush::new(object, mu_g, self.finger.shape(), self.finger.path(), self.u0).map_err(refuse)?;
        let Searched { found: poses, complete } = push.observe_until(&contacts, self.tolerance()?, stop);
        if !complete && poses.solutions.is_empty() {
            return Err(SolveError::Stopped);
        }
        let solutions: Vec<_> = poses.solutions.iter().map(PoseFit::from).collect();
        let status = match &solutions[..] {
            [] => PoseStatus::Unexplained,
            [only] if !only.unobservable && complete => PoseStatus::Unique,
            _ => PoseStatus::Ambiguous,
        };
        let candidates = poses.candidates.iter().map(PoseFit::from).collect();
        Ok(Searched { found: InitialPoseAnswer { status, solutions, candidates }, complete })
    }
}

impl InitialPose {
    fn contacts(&self) -> Result<Vec<TimedContact>, InvalidInput> {
        if self.contacts.is_empty() {
            return Err(InvalidInput::at("contacts", "is empty: give at least one contact [t, u] after the start"));
        }
        let mut before = 0.0;
        for (index, &[t, _]) in self.contacts.iter().enumerate() {
            if t <= before {
                let message = format!("{t:?} s is not after {before:?} s: times must increase from above 0");
                return Err(InvalidInput::at(Pointer::from("contacts").index(index).index(0), message));
            }
            before = t;
        }
        Ok(self.contacts.iter().map(|&[t, u]| TimedContact { t, u }).collect())
    }

    /// In the unit of u, where it is small enough to tell a contact from any other.
    fn tolerance(&self) -> Result<f64, InvalidInput> {
        let (limit, unit) = match self.finger {
            ShapedFinger::Line(_) => (self.object.size(), "m, the part's size"),
            ShapedFinger::Disk(_) | ShapedFinger::Ellipse(_) => (TOLERANCE_MAX_RAD, "rad"),
        };
        let tolerance = self.tolerance.get();
        if tolerance <= limit {
            return Ok(tolerance);
        }
        let message =
            format!("{tolerance:?} is out of range, it must be at most {limit:?} {unit}: with more any pose would fit");
        Err(InvalidInput::at("tolerance", message))
    }

    /// Refuses pushes that could not be followed in a reasonable time.
    fn check_travel(&self, contacts: &[TimedContact]) -> Result<(), InvalidInput> {
        let (path, size) = (self.finger.path(), self.object.size());
        contacts.iter().enumerate().try_for_each(|(index, contact)| {
            let place = || Pointer::from("contacts").index(index).index(0);
            check_travel(&path, contact.t, size).map_err(|message| InvalidInput::at(place(), message))
        })
    }
}

impl PushedObject {
    /// Its largest distance from its centroid, m.
    fn size(&self) -> f64 {
        match self {
            Self::Ellipse(EllipseObject { a, b }) => a.get().max(b.get()),
            Self::Polygon(PolygonObject { vertices }) => size(vertices),
        }
    }
}

fn refuse(error: InitialPoseError) -> InvalidInput {
    let field = match error {
        InitialPoseError::Shape(ShapeError::BothStraight) => Pointer::from("finger").key("type"),
        InitialPoseError::Shape(ShapeError::Size { .. }) => Pointer::from("finger"),
        InitialPoseError::MovesAway { .. } => Pointer::from("finger").key("acceleration"),
    };
    InvalidInput::at(field, error.to_string())
}

impl From<&RestingPose> for PoseFit {
    fn from(RestingPose { edge, s0, pose, residuals, anywhere }: &RestingPose) -> Self {
        Self {
            edge: *edge,
            s0: *s0,
            pose0: PoseFields::from(<[f64; 3]>::from(*pose)),
            residuals: residuals.clone(),
            unobservable: *anywhere,
        }
    }
}
