//! What a sensor says about a part that it sees from outside: supporting lines.
//!
//! A view from an apex gives a cone, two lines on which the part lies; a fence or a jaw gives a half-plane. All of them
//! end up as [`HalfPlane`]s that hold the part and touch it.
//!
//! Frame: world. Units: m, rad, angles counter-clockwise from +x. Errors: [`ConeError`].

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Isometry2, Point2, Vector2};

use crate::math::angle::wrap_angle;

/// A half-plane that holds the part and whose line touches it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HalfPlane {
    /// Unit normal that points away from the part.
    pub normal: Vector2<f64>,
    /// Its polar angle, in (−π, π].
    pub angle: f64,
    /// A point on the line.
    pub point: Point2<f64>,
}

impl HalfPlane {
    /// The points q with q·(cos, sin)(`normal_angle`) ≤ `offset`, m.
    #[must_use]
    pub fn new(normal_angle: f64, offset: f64) -> Self {
        let (sin, cos) = normal_angle.sin_cos();
        let normal = Vector2::new(cos, sin);
        Self { normal, angle: wrapped(normal_angle), point: Point2::from(normal * offset) }
    }

    /// How far a point lies beyond the line, m; negative inside.
    #[must_use]
    pub fn beyond(&self, point: Point2<f64>) -> f64 {
        self.normal.dot(&(point - self.point))
    }

    /// The same half-plane after a motion of the plane.
    #[must_use]
    pub fn moved(&self, motion: &Isometry2<f64>) -> Self {
        Self {
            normal: motion * self.normal,
            angle: wrapped(self.angle + motion.rotation.angle()),
            point: motion * self.point,
        }
    }
}

/// The side of a cone, or of the part as its sensor sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The ray that is met first when sweeping counter-clockwise.
    Right,
    /// The ray that is met last.
    Left,
}

/// One tangent from a sensor to the part: the side of a cone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bearing {
    /// Place of the sensor, world, m.
    pub apex: Point2<f64>,
    /// Polar angle of the ray from the sensor.
    pub angle: f64,
    /// On which side of the part the ray passes.
    pub side: Side,
}

impl Bearing {
    /// The half-plane on the part's side of the ray.
    #[must_use]
    pub fn half_plane(&self) -> HalfPlane {
        let (sin, cos) = self.angle.sin_cos();
        let (normal, angle) = match self.side {
            Side::Right => (Vector2::new(sin, -cos), self.angle - FRAC_PI_2),
            Side::Left => (Vector2::new(-sin, cos), self.angle + FRAC_PI_2),
        };
        HalfPlane { normal, angle: wrapped(angle), point: self.apex }
    }

    /// The same after a motion of the plane.
    #[must_use]
    pub fn moved(&self, motion: &Isometry2<f64>) -> Self {
        Self { apex: motion * self.apex, angle: wrapped(self.angle + motion.rotation.angle()), side: self.side }
    }
}

/// What a sensor sees of a part: the cone swept counter-clockwise from `right` to `left`.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::inscription::Cone;
///
/// let cone = Cone::new(Point2::new(-0.3, 0.1), -0.2, 0.4)?;
/// assert!((cone.opening() - 0.6).abs() < 1e-15); // rad
/// assert!(Cone::new(Point2::new(-0.3, 0.1), 0.4, -0.2).is_err()); // reversed
/// # Ok::<(), palpate::inscription::ConeError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cone {
    apex: Point2<f64>,
    right: f64,
    left: f64,
}

/// Why two rays do not bound a view of a part.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ConeError {
    /// A number that is not finite.
    #[error("the apex and the angles must be finite")]
    NotFinite,
    /// The two rays coincide.
    #[error(
        "the cone has no opening: `right` and `left` are both {right:.4} rad ({:.2}°); a part has a width, so `left` is further counter-clockwise",
        .right.to_degrees()
    )]
    Closed {
        /// Angle of both rays.
        right: f64,
    },
    /// A half-plane or more.
    #[error(
        "the cone opens by {opening:.4} rad ({:.2}°) counter-clockwise from `right` to `left`, it must be below π (180°): {}",
        .opening.to_degrees(),
        if *reversed { "they seem to be swapped" } else { "a part seen from outside spans less than half a turn" }
    )]
    TooWide {
        /// Swept counter-clockwise, rad.
        opening: f64,
        /// Whether the cone the other way round would do.
        reversed: bool,
    },
}

/// Least opening of a cone, rad: narrower ones are rounding errors of equal angles.
const OPENING_MIN: f64 = 1e-12;

impl Cone {
    /// Checks a cone.
    ///
    /// # Errors
    /// [`ConeError`] if its opening is outside (0, π).
    pub fn new(apex: Point2<f64>, right: f64, left: f64) -> Result<Self, ConeError> {
        if ![apex.x, apex.y, right, left].iter().all(|value| value.is_finite()) {
            return Err(ConeError::NotFinite);
        }
        let opening = if left > right && left - right < TAU { left - right } else { (left - right).rem_euclid(TAU) };
        if !(OPENING_MIN..=TAU - OPENING_MIN).contains(&opening) {
            return Err(ConeError::Closed { right });
        }
        if opening > PI - OPENING_MIN {
            return Err(ConeError::TooWide { opening, reversed: opening > PI + OPENING_MIN && left < right });
        }
        Ok(Self { apex, right, left })
    }

    /// Place of the sensor, world, m.
    #[must_use]
    pub fn apex(&self) -> Point2<f64> {
        self.apex
    }

    /// Angle between the sides, rad.
    #[must_use]
    pub fn opening(&self) -> f64 {
        (self.left - self.right).rem_euclid(TAU)
    }

    /// Its sides, right first.
    #[must_use]
    pub fn bearings(&self) -> [Bearing; 2] {
        let side = |angle, side| Bearing { apex: self.apex, angle, side };
        [side(self.right, Side::Right), side(self.left, Side::Left)]
    }

    /// The half-planes whose intersection it is, the right side's first.
    #[must_use]
    pub fn half_planes(&self) -> [HalfPlane; 2] {
        self.bearings().map(|bearing| bearing.half_plane())
    }
}

/// The angle in (−π, π], quickly where it is there already.
pub(super) fn wrapped(angle: f64) -> f64 {
    if angle > -PI && angle <= PI { angle } else { wrap_angle(angle) }
}
