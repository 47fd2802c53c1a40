//! A slow push as it was felt: the finger's way, when it began to touch, and the force on the part.
//!
//! Frames: world. Units: SI. Travel is along the way, from wherever its origin is put; nothing here knows where a part
//! lies.

use nalgebra::{Point2, Vector2};

/// What was felt of the first touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Onset {
    /// It began at this travel, m.
    At(f64),
    /// It touched already at this travel, m.
    Before(f64),
    /// It did not touch up to this travel, m.
    Never(f64),
    /// Forces are not known.
    Unknown,
}

/// Mean force over a stretch of the way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeltForce {
    /// The stretch's middle, m.
    pub travel: f64,
    /// On the part, world axes, N.
    pub force: Vector2<f64>,
}

/// One straight, slow push.
#[derive(Clone, Debug, PartialEq)]
pub struct FeltPush {
    /// The logged point of the finger at travel 0, m.
    pub origin: Point2<f64>,
    /// Direction of the way, length 1.
    pub direction: Vector2<f64>,
    /// Angle of the tool's x axis, rad.
    pub tool_yaw: f64,
    /// Travel of the last logged point, m.
    pub end: f64,
    /// The first touch.
    pub onset: Onset,
    /// Forces in contact, in order of travel, in stretches as long as asked for.
    pub forces: Vec<FeltForce>,
}
