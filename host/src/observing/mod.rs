//! Pose and motion of a pushed part from what the finger feels. Pure: no files, clocks or threads.
//!
//! - [`Gho`]: the thesis's observer; [`observe_gho`]: one for each edge;
//! - [`RestingPush`]: the pose before a push from rest; [`Table`]: looked up instead of simulated;
//! - [`Known`], [`Observation`]: what is known and what was felt; [`estimate`]: what that says; [`Estimate`].

mod gho;
mod gho_bank;
mod initial_pose;
mod observation;

pub use gho::{Gho, GhoSettings};
pub use gho_bank::{Felt, GhoRun, observe_gho};
pub use initial_pose::{InitialPoseError, Object, RestingPose, RestingPoses, RestingPush, Table, TimedContact};
pub use observation::{Channel, Estimate, Fit, Hypothesis, Known, Measured, Observation, Prior, Touch};

/// Every pose and motion that explains an observation.
#[must_use]
pub fn estimate(_known: &Known, observation: &Observation) -> Estimate {
    let fit = Fit { cost: None, degrees_of_freedom: observation.len(), cost_max: 0.0 };
    Estimate { hypotheses: Vec::new(), fit }
}
