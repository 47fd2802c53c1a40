//! The kinds of problem, one module each.

pub mod corner_poses;
pub mod point_sampling;
pub mod push;
pub mod support_friction;
