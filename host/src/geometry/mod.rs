//! Shapes in the plane. Pure: no files, clocks or threads.

mod polygon;

pub use polygon::{PolygonError, SimplePolygon};
