//! The kinds of problem, one module each.

pub mod corner_poses;
pub mod initial_pose;
pub mod inscription;
pub mod observability;
pub mod observe_push;
pub mod observe_roll;
pub mod point_sampling;
pub mod push;
pub mod pushed;
pub mod roll;
pub mod support_friction;
