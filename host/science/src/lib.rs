//! Feel where a known part is and how it moves: the science, without files, clocks, threads or terminals.

pub mod corner;
pub mod finger;
pub mod geometry;
pub mod gravity;
pub mod inscription;
pub mod math;
pub mod point_sampling;
pub mod pushing;
pub mod rolling;
