//! Shapes in the plane. Pure: no files, clocks or threads.

mod convex;
pub(crate) mod exact;
mod polygon;
mod pose;

pub use convex::{ConvexPolygon, NotConvex};
pub use polygon::{PolygonError, SimplePolygon};
pub use pose::Pose;
