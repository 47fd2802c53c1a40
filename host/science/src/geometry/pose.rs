//! Where a part lies: the one pose of the library.

use nalgebra::{Isometry2, Point2, Vector2, Vector3};

use crate::math::angle::wrap_angle;

/// Where a part lies: `p_world = R(theta) p_part + (x, y)`, with `p_part` in the frame the outline was given in.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::Pose;
///
/// let pose = Pose { x: 0.1, y: 0.0, theta: std::f64::consts::FRAC_PI_2 };
/// assert!((pose.isometry() * Point2::new(0.02, 0.0) - Point2::new(0.1, 0.02)).norm() < 1e-15); // m
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Of the part frame's origin, m.
    pub x: f64,
    /// Of the part frame's origin, m.
    pub y: f64,
    /// Counter-clockwise, rad. A pose that follows a motion counts whole turns; others say their range where they are
    /// made.
    pub theta: f64,
}

impl Pose {
    /// The same as a transformation of points, part to world. It knows the turn only up to whole turns.
    #[must_use]
    pub fn isometry(&self) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(self.x, self.y), self.theta)
    }

    /// How far it is from another: m, m, rad, the turn within half of one.
    #[must_use]
    pub fn minus(&self, other: &Self) -> Vector3<f64> {
        Vector3::new(self.x - other.x, self.y - other.y, wrap_angle(self.theta - other.theta))
    }

    /// The part frame's origin in the world, m.
    #[must_use]
    pub fn origin(&self) -> Point2<f64> {
        Point2::new(self.x, self.y)
    }
}

impl From<[f64; 3]> for Pose {
    /// From x, y (m) and theta (rad).
    fn from([x, y, theta]: [f64; 3]) -> Self {
        Self { x, y, theta }
    }
}

impl From<Pose> for [f64; 3] {
    fn from(Pose { x, y, theta }: Pose) -> Self {
        [x, y, theta]
    }
}

impl From<Isometry2<f64>> for Pose {
    /// With theta in (−π, π].
    fn from(isometry: Isometry2<f64>) -> Self {
        Self { x: isometry.translation.x, y: isometry.translation.y, theta: isometry.rotation.angle() }
    }
}
