//! The kind `corner_poses`: rest poses of a part pushed into a corner.

use nalgebra::Vector2;
use palpate::corner::{Corner, CornerError, CornerPose, Flush};
use palpate::{Searched, Stop, never};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::solve::fields::{Polygon, PoseFields};
use crate::solve::{InvalidInput, Problem, SolveError};

/// A part in a corner: fence A from the origin along +x, fence B from the origin at `corner_angle`.
///
/// ```
/// use palpate_files::solve::Problem;
/// use palpate_files::solve::kinds::corner_poses::CornerPoses;
///
/// let line = r#"{"polygon": [[0, 0], [0.06, 0], [0, 0.04]], "corner_angle": 1.5707963267948966, "push": [-1, -1]}"#;
/// let answer = serde_json::from_str::<CornerPoses>(line)?.solve()?;
/// assert_eq!(answer.poses.len(), 5); // the right angle fits the corner: there both legs lie flush at once
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CornerPoses {
    /// Outline of the part.
    pub polygon: Polygon,
    /// Angle between the fences, rad, in (0, π).
    pub corner_angle: f64,
    /// Direction of the push, world axes; its length does not matter.
    pub push: [f64; 2],
}

/// Every pose with both fences touched and one edge of the hull flush.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct CornerPosesAnswer {
    /// By `theta`, in [0, 2π).
    pub poses: Vec<RestPose>,
}

/// One of the poses.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RestPose {
    /// `[x, y, theta]`, m and rad.
    pub pose: PoseFields,
    /// The fence that an edge lies on: `A`, `B` or `AB`.
    pub flush: FlushName,
    /// Whether the part comes back to it: a strict local minimum of −push·centroid.
    pub stable: bool,
    /// The smaller uphill slope of −push·centroid on the two sides, m/rad, for a push of length 1; the mean over the first
    /// microradian.
    pub margin: f64,
}

/// Which fences an edge lies flush on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub enum FlushName {
    /// The fence along +x.
    A,
    /// The fence at the corner's angle.
    B,
    /// An edge on each.
    #[serde(rename = "AB")]
    Both,
}

impl From<Flush> for FlushName {
    fn from(flush: Flush) -> Self {
        match flush {
            Flush::A => Self::A,
            Flush::B => Self::B,
            Flush::Both => Self::Both,
        }
    }
}

impl From<&CornerPose> for RestPose {
    fn from(pose: &CornerPose) -> Self {
        let place = PoseFields { x: pose.origin.x, y: pose.origin.y, theta: pose.theta };
        Self { pose: place, flush: pose.flush.into(), stable: pose.is_stable(), margin: pose.margin }
    }
}

impl Problem for CornerPoses {
    const KIND: &'static str = "corner_poses";
    type Answer = CornerPosesAnswer;

    fn solve(&self) -> Result<CornerPosesAnswer, SolveError> {
        Ok(self.solve_until(&never)?.found)
    }

    fn solve_until(&self, stop: Stop<'_>) -> Result<Searched<CornerPosesAnswer>, SolveError> {
        let corner = Corner::new(self.corner_angle, Vector2::from(self.push)).map_err(|error| {
            let field = match error {
                CornerError::Angle(_) => "corner_angle",
                CornerError::Push => "push",
            };
            InvalidInput::at(field, error.to_string())
        })?;
        let Searched { found: poses, complete } = corner.poses_until(&self.polygon, stop);
        if !complete && poses.is_empty() {
            return Err(SolveError::Stopped);
        }
        Ok(Searched { found: CornerPosesAnswer { poses: poses.iter().map(RestPose::from).collect() }, complete })
    }
}
