//! The kinds of problem, one module each.

pub mod observe_push;
pub mod push;
pub mod support_friction;
