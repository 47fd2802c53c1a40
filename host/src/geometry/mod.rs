//! Shapes in the plane. Pure: no files, clocks or threads.

pub mod angle;
mod convex;
mod polygon;

pub use convex::{ConvexPolygon, NotConvex};
pub use polygon::{PolygonError, SimplePolygon};
