//! Shapes in the plane. Pure: no files, clocks or threads.

pub mod angle;
mod polygon;

pub use polygon::{PolygonError, SimplePolygon};
