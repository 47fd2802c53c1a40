//! The kinds of problem, one module each.

pub mod support_friction;
