//! Shapes in the plane. Pure: no files, clocks or threads.

mod convex;
pub(crate) mod exact;
mod polygon;
mod pose;

pub use convex::{ConvexPolygon, NotConvex, convex_hull};
pub(crate) use polygon::extent_of;
pub use polygon::{PolygonError, SimplePolygon, bounding_box};
pub use pose::Pose;
