//! The kinds of problem, one module each.

pub mod push;
pub mod support_friction;
