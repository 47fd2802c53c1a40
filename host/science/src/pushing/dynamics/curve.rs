//! Outlines that touch: what a contact must know of finger and part.
//!
//! Every outline runs counter-clockwise around its inside and has a parameter `p`: the finger's is called u, the part's
//! s.
//!
//! | outline | parameter | point |
//! |---|---|---|
//! | disk | polar angle, rad | r (cos u, sin u) |
//! | ellipse | eccentric angle, rad | (a cos p, b sin p) |
//! | line | length, m | (−u, 0): the finger lies below, the part above |
//! | edge of a part | s, m, from the foot of the perpendicular through the centre of mass | h n + s ẑ × n |
//!
//! Assumes: the finger's axes are the world's, because it only translates.
//! Frames: finger from its centre, world axes; part from its centre of mass, its own axes (`body`). Units: SI.
//! Errors: none.

use nalgebra::Vector2;

use super::model::Edge;
use super::scalar::Scalar;

/// Outline of a finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FingerShape {
    /// A disk; of radius 0 it is a point.
    Disk {
        /// Radius, m.
        radius: f64,
    },
    /// An ellipse with its axes along the world's.
    Ellipse {
        /// Along x and y, m.
        semi_axes: [f64; 2],
    },
    /// Everything below a line along the world's x.
    Line,
}

/// Outline of a part where it is touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PartSide {
    /// A straight edge of a polygon.
    Edge(Edge),
    /// All around an ellipse with its axes along the part's.
    Ellipse {
        /// Along x and y, m.
        semi_axes: [f64; 2],
        /// Its middle as seen from the centre of mass, part axes, m.
        middle: Vector2<f64>,
    },
}

/// An outline around one of its points.
#[derive(Clone, Copy, Debug)]
pub(super) struct CurvePoint<T> {
    /// The point, in the outline's axes, from its middle (finger) or the centre of mass (part), m.
    pub(super) place: [T; 2],
    /// Outward unit normal, the outline's axes.
    pub(super) normal: [T; 2],
    /// Length of the outline by its parameter.
    pub(super) pace: T,
    /// Turn of the normal by the parameter, rad; the curvature is this over `pace`.
    pub(super) bend: T,
}

impl FingerShape {
    pub(super) fn at<T: Scalar>(&self, u: T) -> CurvePoint<T> {
        match *self {
            Self::Disk { radius } => {
                let (sin, cos) = u.sin_cos();
                CurvePoint {
                    place: [cos * radius, sin * radius],
                    normal: [cos, sin],
                    pace: T::from(radius),
                    bend: T::from(1.0),
                }
            }
            Self::Ellipse { semi_axes } => ellipse(semi_axes, u),
            Self::Line => {
                let [zero, one] = [0.0, 1.0].map(T::from);
                CurvePoint { place: [-u, zero], normal: [zero, one], pace: one, bend: zero }
            }
        }
    }

    /// The point at parameter `u`, from the finger's own point, world axes, m.
    #[must_use]
    pub fn point(&self, u: f64) -> Vector2<f64> {
        self.at(u).place.into()
    }

    /// The parameter at which the outward normal has a polar angle (rad), with its whole turns; a line's, whose normal does
    /// not turn, stays as it is.
    #[must_use]
    pub fn with_normal(&self, angle: f64) -> f64 {
        match *self {
            Self::Disk { .. } | Self::Line => angle,
            Self::Ellipse { semi_axes: [a, b] } => {
                let (sin, cos) = angle.sin_cos();
                // Within a right angle of it, as in the other direction.
                angle + ((b - a) * sin * cos).atan2(a * cos * cos + b * sin * sin)
            }
        }
    }

    /// Turn of the outward normal by the parameter.
    pub(crate) fn normal_rate(&self, u: f64) -> f64 {
        self.at(u).bend
    }

    /// Angle of the outward normal at parameter `u`, rad; continuous along the outline.
    #[must_use]
    pub fn normal_angle(&self, u: f64) -> f64 {
        match *self {
            Self::Disk { .. } => u,
            Self::Ellipse { semi_axes } => ellipse_normal_angle(semi_axes, u),
            Self::Line => std::f64::consts::FRAC_PI_2,
        }
    }

    /// Parameter at which the outward normal points at an angle, both rad; of a line, which has one normal, its own point.
    #[must_use]
    pub fn facing(&self, angle: f64) -> f64 {
        match *self {
            Self::Disk { .. } => angle,
            Self::Ellipse { semi_axes: [a, b] } => (b * angle.sin()).atan2(a * angle.cos()),
            Self::Line => 0.0,
        }
    }
}

impl PartSide {
    pub(super) fn at<T: Scalar>(&self, s: T) -> CurvePoint<T> {
        match self {
            Self::Edge(Edge { normal, height, .. }) => {
                let (x, y) = (normal.x, normal.y);
                let place = [T::from(x * height) - s * y, T::from(y * height) + s * x];
                CurvePoint { place, normal: [x, y].map(T::from), pace: T::from(1.0), bend: T::from(0.0) }
            }
            Self::Ellipse { semi_axes, middle } => {
                let mut point = ellipse(*semi_axes, s);
                point.place = [0, 1].map(|axis| point.place[axis] + middle[axis]);
                point
            }
        }
    }

    /// Angle of the outward normal in part axes, rad; continuous along the outline.
    pub(super) fn normal_angle(&self, s: f64) -> f64 {
        match self {
            Self::Edge(edge) => edge.normal.y.atan2(edge.normal.x),
            Self::Ellipse { semi_axes, .. } => ellipse_normal_angle(*semi_axes, s),
        }
    }

    /// Where the outline begins and ends; an ellipse goes on for ever.
    pub(crate) fn range(&self) -> [f64; 2] {
        match self {
            Self::Edge(edge) => [edge.s_min, edge.s_max],
            Self::Ellipse { .. } => [f64::NEG_INFINITY, f64::INFINITY],
        }
    }
}

/// An ellipse about its middle at an eccentric angle.
fn ellipse<T: Scalar>([a, b]: [f64; 2], angle: T) -> CurvePoint<T> {
    let (sin, cos) = angle.sin_cos();
    let (x, y) = (cos * b, sin * a);
    let pace = (x * x + y * y).sqrt();
    CurvePoint { place: [cos * a, sin * b], normal: [x / pace, y / pace], pace, bend: (pace * pace).recip() * (a * b) }
}

/// The normal's angle is never a right angle from the eccentric one, which makes it continuous.
fn ellipse_normal_angle([a, b]: [f64; 2], angle: f64) -> f64 {
    let (sin, cos) = angle.sin_cos();
    angle + ((a - b) * sin * cos).atan2(b * cos * cos + a * sin * sin)
}

/// A vector turned by a right angle counter-clockwise.
pub(super) fn left<T: Scalar>([x, y]: [T; 2]) -> [T; 2] {
    [-y, x]
}

pub(super) fn dot<T: Scalar>(a: [T; 2], b: [T; 2]) -> T {
    a[0] * b[0] + a[1] * b[1]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Of a central difference over 1e-5 of a parameter, relative to sizes of a few cm or rad.
    const DIFFERENCE: f64 = 1e-8;

    fn vector(v: [f64; 2]) -> Vector2<f64> {
        v.into()
    }

    fn shapes() -> impl Strategy<Value = FingerShape> {
        prop_oneof![
            (0.0..0.05).prop_map(|radius| FingerShape::Disk { radius }),
            [0.005..0.05, 0.005..0.05].prop_map(|semi_axes| FingerShape::Ellipse { semi_axes }),
            Just(FingerShape::Line),
        ]
    }

    proptest! {
        #[test]
        fn parameters_come_back_from_their_normals(shape in shapes(), u in -7.0..7.0) {
            prop_assume!(shape != FingerShape::Line);
            let back = shape.with_normal(shape.normal_angle(u));
            prop_assert!((back - u).abs() < 1e-12, "{u} {back}"); // rounding of two angles
        }

        #[test]
        fn normal_pace_and_bend_are_the_outlines_derivatives(shape in shapes(), u in -7.0..7.0) {
            let at = |change: f64| shape.at(u + change);
            let (here, before, after) = (at(0.0), at(-1e-5), at(1e-5));
            let by_difference = (vector(after.place) - vector(before.place)) / 2e-5;
            let wanted = vector(left(here.normal)) * here.pace;
            prop_assert!((by_difference - wanted).norm() < DIFFERENCE, "{by_difference} {wanted}");
            let turned = (shape.normal_angle(u + 1e-5) - shape.normal_angle(u - 1e-5)) / 2e-5;
            prop_assert!((turned - here.bend).abs() < DIFFERENCE * (1.0 + here.bend), "{turned} {here:?}");
            let angle = shape.normal_angle(u);
            prop_assert!((vector(here.normal) - Vector2::new(angle.cos(), angle.sin())).norm() < 1e-12);
        }
    }
}
