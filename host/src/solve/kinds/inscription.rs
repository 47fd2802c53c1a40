//! The kind `inscription`: a convex part's pose from supporting lines. See [`crate::inscription`].

use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::geometry::ConvexPolygon;
use crate::inscription::{self, HalfPlane};
use crate::solve::fields::{Polygon, Pose, Sigma};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// Lines that a convex part touches, and on whose inner side it lies.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Inscription {
    /// The part's outline, convex unless `hull` is set.
    pub polygon: Polygon,
    /// Views of the part.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub cones: Vec<Cone>,
    /// Fences and jaws that the part touches.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub half_planes: Vec<HalfPlaneFields>,
    /// Standard deviation of every bearing of a cone, rad.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sigma: Option<Sigma>,
    /// Takes the convex hull of the polygon.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub hull: bool,
}

/// What a sensor sees of the part: swept counter-clockwise from `right` to `left`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Cone {
    /// The sensor, world, m.
    pub apex: [f64; 2],
    /// Angle of the right side, rad.
    pub right: f64,
    /// Angle of the left side, rad.
    pub left: f64,
}

/// The points q with q·(cos, sin)(`normal_angle`) ≤ `offset`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HalfPlaneFields {
    /// Angle of the normal that points away from the part, rad.
    pub normal_angle: f64,
    /// Distance of the line from the world's origin along the normal, m.
    pub offset: f64,
}

/// Where the part can be.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct InscriptionAnswer {
    /// Whether there are poses.
    pub status: Status,
    /// Why not, where the status is not `ok`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// All poses that touch every line, by increasing theta in [0, 2π).
    pub poses: Vec<Pose>,
}

/// What lines say about the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// There are poses.
    Ok,
    /// There is none.
    NoPose,
    /// The lines leave a continuum of poses.
    Underdetermined,
}

impl From<inscription::Pose> for Pose {
    fn from(pose: inscription::Pose) -> Self {
        Self { x: pose.x, y: pose.y, theta: pose.theta }
    }
}

impl Problem for Inscription {
    const KIND: &'static str = "inscription";
    type Answer = InscriptionAnswer;

    fn solve(&self) -> Result<InscriptionAnswer, SolveError> {
        let part = self.part()?;
        let lines = self.lines()?;
        let found = match inscription::poses(&part, &lines) {
            inscription::Inscription::Poses(poses) => poses,
            inscription::Inscription::Underdetermined(continuum) => {
                let reason = Some(continuum.to_string());
                return Ok(InscriptionAnswer { status: Status::Underdetermined, reason, poses: Vec::new() });
            }
        };
        let status = if found.is_empty() { Status::NoPose } else { Status::Ok };
        Ok(InscriptionAnswer { status, reason: None, poses: found.into_iter().map(Pose::from).collect() })
    }
}

impl Inscription {
    fn part(&self) -> Result<ConvexPolygon, InvalidInput> {
        if self.hull {
            return Ok(ConvexPolygon::hull(&self.polygon));
        }
        ConvexPolygon::new(&self.polygon).map_err(|error| {
            InvalidInput::at(
                Pointer::from("polygon").index(error.vertex),
                format!("{error}; `\"hull\": true` takes the hull"),
            )
        })
    }

    fn lines(&self) -> Result<Vec<HalfPlane>, InvalidInput> {
        let mut lines = Vec::with_capacity(2 * self.cones.len() + self.half_planes.len());
        for (index, cone) in self.cones.iter().enumerate() {
            let cone = inscription::Cone::new(Point2::from(cone.apex), cone.right, cone.left).map_err(|error| {
                InvalidInput::at(Pointer::from("cones").index(index), format!("cone {index}: {error}"))
            })?;
            lines.extend(cone.half_planes());
        }
        lines.extend(self.half_planes.iter().map(|line| HalfPlane::new(line.normal_angle, line.offset)));
        if lines.is_empty() {
            return Err(InvalidInput::missing("cones", "give at least one cone or half-plane that the part touches"));
        }
        Ok(lines)
    }
}
