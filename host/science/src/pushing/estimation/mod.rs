//! Pose and motion of a pushed part from what the finger feels (thesis ch. 5 and 6). Pure: no files, clocks or threads.
//!
//! A finger pushes a known part across a table and feels only where it is touched, or only the force. Where is the
//! part, and how does it move? Any edge may be in contact, anywhere. An [`Observer`] answers with a **set**, an
//! [`Estimate`]: every pose and motion that its observation cannot exclude, each a [`Hypothesis`] with its covariance
//! and probability, and nothing that is excluded.
//!
//! The observers are siblings: one observation in, one set of hypotheses out.
//!
//! | observer | felt | begins | |
//! |---|---|---|---|
//! | [`Known`] (`contact_angles`) | contact angles, or direction and magnitude of the force | in motion or at rest | every local minimum of the cost |
//! | [`from_rest::KnownFromRest`] | the force in newtons, from its onset | at rest | where, and mass and friction too |
//! | [`RestingPush`], [`Table`] (`initial_pose`) | a few contacts | at rest, without friction at the finger | thesis §5.3.2, §6.2, §8.2.2 |
//! | [`GhoBank`] (`thesis_gho`) | contact angles | in motion, about known | the thesis's observers of §5.2, §5.4.2, §6.1 |
//!
//! What is done with their answers is the same for all: [`planning`] (which motion tells hypotheses apart),
//! [`which_part()`] (several parts), [`in_sequence`] (two pushes, `sequence`), `hypotheses` (the answer itself, the
//! gate, when two are one).
//!
//! To add one: see `docs/ARCHITECTURE.md`.
//!
//! Frames: world, unless named. Units: SI.

mod contact_angles;
pub mod friction;
pub mod from_rest;
mod hypotheses;
mod initial_pose;
mod observation;
pub mod planning;
mod sequence;
pub mod slow_pushes;
mod thesis_gho;
mod which_part;

pub use contact_angles::{Tracker, TrackerSettings, estimate, estimate_until};
pub use hypotheses::{
    Belief, Estimate, Fit, FromForce, GATE, Hypothesis, Nearness, Observer, SAME_END_M, Status, centre_covariance,
};
pub use initial_pose::{
    Contacts, InitialPoseError, Object, RestingPose, RestingPoses, RestingPush, Table, TimedContact,
};
pub use observation::{Channel, Known, Measured, Observation, Prior, Touch};
pub use sequence::{Agreement, PoseBelief, Slack, in_sequence};
pub use thesis_gho::{Gho, GhoBank, GhoFollower, GhoKnown, GhoRun, GhoSettings, GhoStart, GhoTold};
pub use which_part::{PartBelief, PartEstimate, PossiblePart, Shortlist, mixed, which_part};
