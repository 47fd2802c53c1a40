//! Pose and motion of a pushed part from what the finger feels. Pure: no files, clocks or threads.
//!
//! A finger pushes a known part across a table and feels only where it is touched (or only the force). Where is the part, and how does
//! it move? Any edge may be in contact, anywhere, and the start is known only vaguely. [`estimate`] answers with a **set**:
//! every pose and motion that the data cannot exclude, each with its covariance and probability, and nothing that they
//! exclude.
//!
//! A hypothesis is an edge and up to four numbers at t = 0: contact angle, place on the edge, angular velocity, velocity
//! along the contact. Simulated forward it predicts every value; its cost is the sum of squared residuals. Finding all
//! local minima of the cost over all edges, fast, takes some ideas:
//! - friction makes a part forget how it started within v/(µg), some 20 ms. From then on it moves on a slow manifold, where contact
//!   angle and place fix its velocities. So the measured angles tell at each place of each edge how fast the angle
//!   should change, without any simulation, and one number an edge is left to search: see `seed` and `manifold`;
//! - a simulation on dual numbers gives the exact derivatives of all it predicts, and with them Gauss–Newton steps: a handful
//!   from seed to minimum: see `fit` and `path`;
//! - where the friction of the plane is not known well ([`Prior::grip_log_sigma`]), its logarithm is one more unknown of every hypothesis;
//! - all candidates go down side by side, and those that cannot come near the best are given up early: see `select`.
//!
//! In reading order: [`Known`], [`Observation`], [`Estimate`] (`observation`); `data`; `sites`: where the disk can touch; `launch`:
//! how a push can begin; `clock`, `path`: simulation; `fit`; `manifold`, `seed`; `select`: the judgement; `track`: the same while the
//! push goes on; `planning`: what to do next; `sequence`: two pushes; `which_part`: several parts.
//!
//! The thesis's own observers are beside it: [`Gho`], with one for each edge in [`observe_gho`]; and [`RestingPush`], the pose
//! before a push from rest, with [`Table`], looked up instead of simulated.
//!
//! Implements: MAP estimation beside the observers of thesis chapters 5 and 6. Frames: world, unless named. Units: SI.

mod clock;
mod data;
mod fit;
pub mod from_rest;
mod gho;
mod gho_bank;
mod initial_pose;
mod launch;
mod manifold;
mod observation;
mod path;
pub mod planning;
mod seed;
mod select;
mod sequence;
mod sites;
#[cfg(test)]
mod tests;
mod track;
mod which_part;

pub use gho::{Gho, GhoSettings};
pub use gho_bank::{Felt, GhoRun, observe_gho};
pub use initial_pose::{InitialPoseError, Object, RestingPose, RestingPoses, RestingPush, Table, TimedContact};
pub use observation::{Channel, Estimate, Fit, Hypothesis, Known, Measured, Observation, Prior, Touch};
pub use select::{estimate, estimate_until};
pub use sequence::{Agreement, PoseBelief, Slack, in_sequence};
pub use track::{Tracker, TrackerSettings};
pub use which_part::{PartEstimate, Weight, log_evidence, mixed, ranked, which_part, which_part_until};
