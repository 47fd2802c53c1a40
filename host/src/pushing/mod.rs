//! Parts that slide on a plane while a finger pushes them. Pure: no files, clocks or threads.
//!
//! In reading order:
//! - [`support`]: what the plane does to a sliding part.

pub mod support;
