//! The kind `support_friction`: friction integrals of a polygon with uniform pressure.

use nalgebra::Vector2;
use palpate::pushing::dynamics::support::{SupportFriction, Twist};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::solve::fields::Polygon;
use crate::solve::{InvalidInput, Problem, SolveError};

/// How a part slides on a plane.
///
/// ```
/// use palpate_files::solve::Problem;
/// use palpate_files::solve::kinds::support_friction::SupportFrictionProblem;
///
/// let line = r#"{"polygon": [[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]], "velocity": [0.1, 0], "omega": 0}"#;
/// let answer = serde_json::from_str::<SupportFrictionProblem>(line)?.solve()?;
/// assert!((answer.i1[0] - 0.0024).abs() < 1e-15); // m²: all of it slides along x
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SupportFrictionProblem {
    /// Outline of the part.
    pub polygon: Polygon,
    /// Velocity of the origin of the polygon's frame, in the part's axes, m/s.
    pub velocity: [f64; 2],
    /// Rate of turning, rad/s.
    pub omega: f64,
}

/// The friction integrals: force `−mu·g·(m/area)·i1`, moment about the frame's origin `−mu·g·(m/area)·i2`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct SupportFrictionAnswer {
    /// Area of the support, m².
    pub area: f64,
    /// Area centroid of the polygon, m.
    pub centroid: [f64; 2],
    /// Integral of the direction of sliding over the area, part axes, m².
    pub i1: [f64; 2],
    /// Integral of the moment of the direction of sliding about the frame's origin, m³.
    pub i2: f64,
}

impl Problem for SupportFrictionProblem {
    const KIND: &'static str = "support_friction";
    type Answer = SupportFrictionAnswer;

    fn solve(&self) -> Result<SupportFrictionAnswer, SolveError> {
        let twist = Twist::new(Vector2::from(self.velocity), self.omega);
        if twist.velocity == Vector2::zeros() && twist.omega == 0.0 {
            let message =
                "`velocity` and `omega` are both zero: a part at rest has no direction of sliding, give it a motion";
            return Err(InvalidInput::at("velocity", message).into());
        }
        let (area, centroid) = (self.polygon.area(), self.polygon.centroid());
        let mean = SupportFriction::uniform(&self.polygon).mean_sliding(&twist);
        let (i1, i2) = (area * mean.direction, area * mean.moment);
        Ok(SupportFrictionAnswer { area, centroid: [centroid.x, centroid.y], i1: [i1.x, i1.y], i2 })
    }
}
