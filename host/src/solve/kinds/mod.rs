//! The kinds of problem, one module each.

pub mod push;
