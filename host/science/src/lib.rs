//! Feel where a known part is and how it moves: the science, without files, clocks, threads or terminals.

#![warn(clippy::print_stdout, clippy::print_stderr)]

pub mod corner;
pub mod finger;
pub mod geometry;
pub mod gravity;
pub mod inscription;
pub mod math;
pub mod point_sampling;
pub mod pushing;
pub mod rolling;
mod search;

pub use search::{Searched, Stop, never};

/// The examples of the crate's page are compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
