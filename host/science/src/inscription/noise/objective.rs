//! χ² of a pose, with its derivatives.
//!
//! Coordinates of a pose here: the part's centre from the first sensor, m, and size times the turn, m, so that all
//! three are alike. Rows of the Jacobian: the bearing of a corner w from an apex a changes by n·dw/|w − a|, n the unit
//! normal of the ray.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::{Bearing, NoisyReadings};
use crate::geometry::ConvexPolygon;
use crate::geometry::Pose;
use crate::inscription::exact::{full_turn, miss_gradient};
use crate::inscription::readings::{HalfPlane, Side};
use crate::math::angle::wrap_angle;
use crate::math::least_squares::NormalEquations;
use crate::search::Halt;

/// How exactly fences and jaws are taken to be known, as a share of the part's size: exact for every purpose, and still
/// far enough from the rounding errors that descent keeps its digits.
pub const FENCE_SD_RELATIVE: f64 = 1e-7;

/// Readings between two questions whether to go on: each takes a walk round the part at worst.
const LOOK_EACH: usize = 32;

/// A part and its readings.
pub(in crate::inscription) struct Objective<'a> {
    pub part: &'a ConvexPolygon,
    pub readings: &'a NoisyReadings,
    /// Of all coordinates here, world.
    pub origin: Point2<f64>,
    fence_sd: f64,
    halt: &'a Halt<'a>,
}

/// The part's centre from the origin, and its turn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::inscription) struct Placed {
    pub centre: Vector2<f64>,
    pub theta: f64,
    pub turn: Vector2<f64>,
}

impl Placed {
    pub(super) fn new(centre: Vector2<f64>, theta: f64) -> Self {
        let (sin, cos) = theta.sin_cos();
        Self { centre, theta, turn: Vector2::new(cos, sin) }
    }

    /// A vector of the part in world axes.
    #[inline]
    pub(super) fn turned(&self, v: Vector2<f64>) -> Vector2<f64> {
        let (cos, sin) = (self.turn.x, self.turn.y);
        Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y)
    }
}

/// One reading's residual over its standard deviation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Residual {
    /// Measured less expected, in standard deviations.
    pub value: f64,
    /// How it changes with the pose.
    pub row: Vector3<f64>,
    /// The corner that touches.
    pub corner: usize,
}

impl<'a> Objective<'a> {
    /// None of its quadratics is found any more once `halt` is wished.
    pub(in crate::inscription) fn new(
        part: &'a ConvexPolygon,
        readings: &'a NoisyReadings,
        halt: &'a Halt<'a>,
    ) -> Self {
        let first_bearing = readings.bearings.first().map(|bearing| bearing.apex);
        let origin = first_bearing.or(readings.fences.first().map(|fence| fence.point)).unwrap_or_default();
        Self { part, readings, origin, fence_sd: FENCE_SD_RELATIVE * part.size(), halt }
    }

    /// How many readings there are: bearings first, then fences.
    pub(super) fn count(&self) -> usize {
        self.readings.bearings.len() + self.readings.fences.len()
    }

    /// The wish that ends the search.
    pub(super) fn halt(&self) -> &'a Halt<'a> {
        self.halt
    }

    /// Whether the search shall go on: none where it should not, for `?`.
    pub(super) fn goes_on(&self) -> Option<()> {
        self.halt.goes_on()
    }

    /// Before the work on one reading of many.
    pub(super) fn goes_on_at(&self, index: usize) -> Option<()> {
        if index.is_multiple_of(LOOK_EACH) { self.goes_on() } else { Some(()) }
    }

    /// χ² and its derivatives; none where a sensor is inside the part, or where it should halt.
    pub(super) fn quadratic(&self, placed: &Placed) -> Option<NormalEquations<3>> {
        let mut sum = NormalEquations::zero();
        for index in 0..self.count() {
            self.goes_on_at(index)?;
            let Residual { value, row, .. } = self.residual(index, placed)?;
            sum.add(value, row);
        }
        Some(sum)
    }

    pub(super) fn residual(&self, index: usize, placed: &Placed) -> Option<Residual> {
        match self.readings.bearings.get(index) {
            Some(bearing) => {
                let corner = self.tangent(bearing, placed)?;
                Some(self.bearing_residual(bearing, corner, placed))
            }
            None => Some(self.fence_residual(&self.readings.fences[index - self.readings.bearings.len()], placed)),
        }
    }

    /// The residual of a bearing if this corner is the outermost.
    pub(super) fn bearing_residual(&self, bearing: &Bearing, corner: usize, placed: &Placed) -> Residual {
        let arm = placed.turned(self.part.corners()[corner]);
        let away = arm + placed.centre - (bearing.apex - self.origin);
        let squared = away.norm_squared();
        let value = wrap_angle(bearing.angle - away.y.atan2(away.x)) / self.readings.sigma;
        // The bearing's gradient by the corner's place.
        let gradient = Vector2::new(-away.y, away.x) / squared;
        let row = Vector3::new(gradient.x, gradient.y, arm.perp(&gradient) / self.part.size());
        Residual { value, row: -row / self.readings.sigma, corner }
    }

    fn fence_residual(&self, fence: &HalfPlane, placed: &Placed) -> Residual {
        let corner = self.part.support(wrap_angle(fence.angle - placed.theta));
        let arm = placed.turned(self.part.corners()[corner]);
        let miss = fence.normal.dot(&(arm + placed.centre - (fence.point - self.origin)));
        let row = miss_gradient(fence, arm, self.part.size()) / self.fence_sd;
        Residual { value: miss / self.fence_sd, row, corner }
    }

    /// The outermost corner on a bearing's side; none if the sensor is inside the part.
    pub(super) fn tangent(&self, bearing: &Bearing, placed: &Placed) -> Option<usize> {
        tangent(self.part, placed, bearing.apex - self.origin, bearing.side, bearing.half_plane().angle)
    }

    /// The corner's bearing from a sensor relative to another's, positive where the first is further counter-clockwise,
    /// rad.
    pub(super) fn bearing_between(&self, bearing: &Bearing, corners: [usize; 2], placed: &Placed) -> f64 {
        let away = corners.map(|corner| self.away(bearing, corner, placed));
        away[1].perp(&away[0]).atan2(away[1].dot(&away[0]))
    }

    /// A corner from a sensor.
    pub(super) fn away(&self, bearing: &Bearing, corner: usize, placed: &Placed) -> Vector2<f64> {
        placed.turned(self.part.corners()[corner]) + placed.centre - (bearing.apex - self.origin)
    }

    /// One place after a step in these coordinates.
    pub(super) fn stepped(&self, placed: &Placed, step: &Vector3<f64>) -> Placed {
        Placed::new(placed.centre + step.xy(), wrap_angle(placed.theta + step.z / self.part.size()))
    }

    /// One place less another in these coordinates.
    pub(super) fn difference(&self, a: &Placed, b: &Placed) -> Vector3<f64> {
        let centre = a.centre - b.centre;
        Vector3::new(centre.x, centre.y, wrap_angle(a.theta - b.theta) * self.part.size())
    }

    pub(super) fn pose(&self, placed: &Placed) -> Pose {
        let at = self.origin + placed.centre - placed.turned(self.part.centre().coords);
        Pose { x: at.x, y: at.y, theta: full_turn(placed.theta) }
    }

    pub(in crate::inscription) fn placed(&self, pose: &Pose) -> Placed {
        let placed = Placed::new(Vector2::zeros(), wrap_angle(pose.theta));
        Placed {
            centre: Point2::new(pose.x, pose.y) + placed.turned(self.part.centre().coords) - self.origin,
            ..placed
        }
    }

    /// JᵀJ for x, y, theta of the outline's frame; none where a sensor is inside the part.
    pub(in crate::inscription) fn pose_information(&self, pose: &Pose) -> Option<Matrix3<f64>> {
        let placed = self.placed(pose);
        let information = self.quadratic(&placed)?.curvature;
        // The centre moves with the frame's origin, and round it as the part turns.
        let carried = placed.turned(self.part.centre().coords);
        let transfer = Matrix3::new(1.0, 0.0, -carried.y, 0.0, 1.0, carried.x, 0.0, 0.0, self.part.size());
        Some(transfer.transpose() * information * transfer)
    }

    /// Of x, y, theta of the outline's frame.
    pub(super) fn covariance(&self, placed: &Placed, information: &Matrix3<f64>) -> Option<Matrix3<f64>> {
        let inverse = information.cholesky()?.inverse();
        let size = self.part.size();
        // Turning the part moves its frame's origin, which is `−carried` from its centre, by the perpendicular of that.
        let carried = placed.turned(self.part.centre().coords);
        let transfer = Matrix3::new(1.0, 0.0, carried.y / size, 0.0, 1.0, -carried.x / size, 0.0, 0.0, 1.0 / size);
        Some(transfer * inverse * transfer.transpose())
    }
}

/// The outermost corner seen from `apex` (from the same origin as `placed`), found by walking from the one that
/// supports a line with the normal `normal_angle`; none from inside the part.
fn tangent(part: &ConvexPolygon, placed: &Placed, apex: Vector2<f64>, side: Side, normal_angle: f64) -> Option<usize> {
    let n = part.corners().len();
    let away = |corner: usize| placed.turned(part.corners()[corner]) + placed.centre - apex;
    // On the right side the outermost has all others on its left.
    let sign = if side == Side::Right { 1.0 } else { -1.0 };
    let beyond = |corner: usize, other: usize| sign * away(corner).perp(&away(other)) < 0.0;
    let mut corner = part.support(wrap_angle(normal_angle - placed.theta));
    for _ in 0..2 * n {
        let (next, previous) = ((corner + 1) % n, (corner + n - 1) % n);
        corner = match (beyond(corner, next), beyond(corner, previous)) {
            (false, false) => return Some(corner),
            (true, _) => next,
            (false, true) => previous,
        };
    }
    None
}

pub(super) fn view(part: &ConvexPolygon, pose: &Pose, apex: Point2<f64>) -> Option<[Bearing; 2]> {
    let mut placed = Placed::new(Vector2::zeros(), wrap_angle(pose.theta));
    placed.centre = Point2::new(pose.x, pose.y) + placed.turned(part.centre().coords) - apex;
    let toward = placed.centre.y.atan2(placed.centre.x);
    let bearing = |side: Side| {
        let rough = Bearing { apex, angle: toward, side }.half_plane().angle;
        let corner = tangent(part, &placed, Vector2::zeros(), side, rough)?;
        let away = placed.turned(part.corners()[corner]) + placed.centre;
        Some(Bearing { apex, angle: away.y.atan2(away.x), side })
    };
    Some([bearing(Side::Right)?, bearing(Side::Left)?])
}
