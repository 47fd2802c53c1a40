//! Shapes in the plane. Pure: no files, clocks or threads.
//!
//! In reading order: `polygon` (checked once: simple and counter-clockwise), `sides` (its straight sides, however they
//! were typed), `convex` (prepared for questions about its support), `pose` (where a part lies), `segment` (distances to
//! a straight piece), `curve` (curves of drawings as chords), `mesh` (a solid's surface: its outlines, mass and base), `disk_curve` (where a disk can be that touches an outline), `exact` (decisions about such pieces without a
//! tolerance).

mod convex;
pub mod curve;
pub(crate) mod disk_curve;
pub(crate) mod exact;
pub mod mesh;
mod polygon;
mod pose;
mod segment;
mod sides;

pub use convex::{ConvexPolygon, NotConvex, convex_hull};
pub use disk_curve::Element;
pub(crate) use polygon::extent_of;
pub use polygon::{PolygonError, SimplePolygon, bounding_box};
pub use pose::Pose;
pub use segment::distance_to_segment;
pub(crate) use segment::is_crossed_by_ray;
pub(crate) use sides::corners_to_rounding;
pub use sides::{FLAT_RELATIVE, FLAT_ROUNDED_RELATIVE, FLAT_TURN_RAD, corners, simplified};
