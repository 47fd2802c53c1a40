//! The kinds of problem, one module each.

pub mod observe_roll;
pub mod push;
pub mod roll;
pub mod support_friction;
