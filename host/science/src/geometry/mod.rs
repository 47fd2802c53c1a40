//! Shapes in the plane. Pure: no files, clocks or threads.

mod convex;
pub(crate) mod exact;
mod polygon;

pub use convex::{ConvexPolygon, NotConvex};
pub use polygon::{PolygonError, SimplePolygon};
