//! How uncertain what was found is: covariances of state and pose at the last value.
//!
//! Implements: the inverse of Gauss's information, taken to the end by the derivatives of the motion; the pose to second
//! order in the contact's angle and place; along valleys that a parabola does not describe, the profile of the cost by
//! the place.
//! Frames: world. Units: SI. Errors: none; what the data leave free has no covariance.

use nalgebra::{Matrix2, Matrix3, Matrix3x2, Matrix4, Matrix5, Vector2, Vector5};

use super::fit::{Candidate, Descent, Evaluation, Fitting};
use super::initial_state::{ANGLE, MU_G, PLACE, UNKNOWNS};
use crate::geometry::Pose;
use crate::pushing::estimation::hypotheses::pose;

/// A place is unknown if its standard deviation is more than this many lengths of its stretch of the edge: along it,
/// the cost then changes by less than a hundredth.
const UNKNOWN_PLACE: f64 = 10.0;

/// Curvature that makes a matrix invertible, relative to the inverse squares of natural sizes.
const CURVATURE_NONE: f64 = 1e-9;

/// Standard deviation of what the last, finer steps leave, over that of a value: they are chosen by it.
const STEP_ERROR: f64 = 1e-3;

/// An angle is known well to this, rad, a place to this share of the radius of gyration: over it the motion's
/// derivatives change by as much.
const WIDE: f64 = 0.02;

/// Nodes of the Gauss–Hermite rule of three points on either side of its middle: √3 standard deviations.
const NODE: f64 = 1.732_050_807_568_877_2;

/// A side on which the edge leaves less than this, in standard deviations, is none.
const SHORT: f64 = 0.3;

/// Steps of a fit beside the minimum, and what a step must still be predicted to bring.
const FITS_MAX: usize = 8;
/// See [`FITS_MAX`]: a hundredth of the cost of one deviation.
const FITTED: f64 = 0.01;

/// The valley is longer than its parabola says by no more than the square root of this.
const LONGER_MAX: f64 = 9.0;

/// The information about the unknowns, the identity for those not free.
fn information(fitting: &Fitting, descent: &Descent) -> Matrix5<f64> {
    let (mut information, free) = (descent.evaluation.information, fitting.free(descent));
    for i in (0..UNKNOWNS).filter(|i| !free[*i]) {
        information.row_mut(i).fill(0.0);
        information.column_mut(i).fill(0.0);
        information[(i, i)] = 1.0;
    }
    information
}

/// Covariance of the unknowns, zero for those not free.
fn covariance_of_unknowns(fitting: &Fitting, descent: &Descent) -> Option<Matrix5<f64>> {
    let length = descent.evaluation.candidate.interval.length();
    let mut information = information(fitting, descent);
    let sizes = [1.0, length, 1.0, 0.1, 1.0];
    for (i, size) in sizes.iter().enumerate() {
        information[(i, i)] += CURVATURE_NONE / (size * size);
    }
    let mut covariance = information.cholesky()?.inverse();
    for i in (0..UNKNOWNS).filter(|i| !fitting.free(descent)[*i]) {
        covariance[(i, i)] = 0.0;
    }
    Some(covariance)
}

/// Covariance of the state at the end, and the standard deviation of ln(µg); none where the data leave the place free.
pub(super) fn state_covariance(fitting: &Fitting, descent: &Descent) -> Option<(Matrix4<f64>, f64)> {
    let (evaluation, length) = (&descent.evaluation, descent.evaluation.candidate.interval.length());
    let unknowns = covariance_of_unknowns(fitting, descent)?;
    let mut covariance: Matrix4<f64> = evaluation.end_by_start * unknowns * evaluation.end_by_start.transpose();
    let unknown = covariance.m22.sqrt() > UNKNOWN_PLACE * length || covariance.m11.sqrt() > UNKNOWN_PLACE;
    // What steps leave, of the angle and, over the part's size, of the place.
    let left = STEP_ERROR * fitting.data.sigma_min();
    let radius = fitting.known.part.inertia_per_mass().sqrt();
    covariance.m11 += left * left;
    covariance.m22 += (left * radius).powi(2);
    let mu_g_log_sd = unknowns[(MU_G, MU_G)].max(0.0).sqrt();
    (!unknown && covariance.iter().all(|c| c.is_finite())).then_some((covariance, mu_g_log_sd))
}

/// Mean squares of the errors of the pose at the end.
///
/// Where angle and place are well known, to second order from the covariance of the state. Where one is not, what fits
/// the data lies along a curved valley: the other unknowns are fitted again on either side, at the nodes of the
/// Gauss–Hermite rule of three points, and their poses say how the valley runs.
pub(super) fn pose_covariance(fitting: &Fitting, descent: &Descent, state: &Matrix4<f64>) -> Matrix3<f64> {
    let contact = state.fixed_view::<2, 2>(0, 0).into();
    let bent = bend_of_the_valley(fitting, descent).unwrap_or_else(Matrix3::zeros);
    second_order(fitting, descent, &contact) + bent
}

/// What the curved valley of an angle or place that is known poorly adds to the mean squares; none where both are known
/// well, or no motion begins beside them.
fn bend_of_the_valley(fitting: &Fitting, descent: &Descent) -> Option<Matrix3<f64>> {
    let Evaluation { candidate, end_by_start, .. } = &descent.evaluation;
    let covariance = covariance_of_unknowns(fitting, descent)?;
    let axis = wide_axis(fitting, &covariance)?;
    let (variance, bounds) = (covariance[(axis, axis)], fitting.bounds(candidate)[axis]);
    let deviation = variance.sqrt();
    // By how much the unknowns change along the valley, and the pose, were it straight.
    let response = covariance.column(axis) / variance;
    let contact: Vector2<f64> = (end_by_start * response).fixed_rows::<2>(0).into();
    let straight = slopes(fitting, descent) * contact;
    let held = Fitting { held_unknown: Some(axis), ..fitting.clone() };
    let mut bent = Matrix3::zeros();
    let mut sides = 0.0;
    let (middle, there) = (candidate.unknowns[axis], end_pose(fitting, descent));
    for node in [-NODE, NODE] {
        let step = (middle + node * deviation).clamp(bounds[0], bounds[1]) - middle;
        let share = step / deviation;
        if share.abs() < SHORT {
            continue; // The edge ends there.
        }
        let unknowns = (Vector5::from(candidate.unknowns) + response * step).into();
        let mut beside = held.descend(Candidate { unknowns, ..*candidate })?;
        held.improve_until(&mut beside, FITTED, FITS_MAX);
        let off = end_pose(fitting, &beside).minus(&there);
        let aside = off - straight * step;
        // Where the cost rises less than its parabola says the valley is longer, too.
        let square = share * share;
        let rise = (beside.evaluation.total() - descent.evaluation.total()).clamp(square / LONGER_MAX, square);
        bent += aside * aside.transpose() / square + off * off.transpose() * (1.0 / rise - 1.0 / square);
        sides += 1.0;
    }
    (sides > 0.0).then(|| bent / sides)
}

/// Whether angle or place are known so poorly that [`pose_covariance`] goes along their valley.
pub(super) fn is_wide(fitting: &Fitting, descent: &Descent) -> bool {
    covariance_of_unknowns(fitting, descent).is_some_and(|covariance| wide_axis(fitting, &covariance).is_some())
}

/// The worse known of angle and place; none where both are known well.
fn wide_axis(fitting: &Fitting, covariance: &Matrix5<f64>) -> Option<usize> {
    let sizes = [1.0, fitting.known.part.inertia_per_mass().sqrt()];
    let width = |unknown: usize| covariance[(unknown, unknown)].max(0.0).sqrt() / sizes[unknown];
    let axis = if width(ANGLE) > width(PLACE) { ANGLE } else { PLACE };
    (width(axis) > WIDE).then_some(axis)
}

/// The part's pose at the last value.
fn end_pose(fitting: &Fitting, Descent { evaluation, .. }: &Descent) -> Pose {
    let model = fitting.known.model(evaluation.candidate.interval.edge);
    pose(&model, evaluation.start.u, fitting.data.duration(), &evaluation.end)
}

/// The same, from the covariance of the contact's angle and place, to second order.
///
/// The part touches the disk, so to first order the pose has two freedoms, and this would be a singular matrix. What
/// the curved motions add, however little, makes it invertible: of a bend `a` the error xᵀ a x / 2, whose mean is not
/// zero either.
fn second_order(fitting: &Fitting, descent: &Descent, contact: &Matrix2<f64>) -> Matrix3<f64> {
    let (slopes, (sin, cos), arm) =
        (slopes(fitting, descent), descent.evaluation.end.u.sin_cos(), arm(fitting, descent));
    let bends = [Matrix2::new(-arm.x, -cos, -cos, 0.0), Matrix2::new(-arm.y, -sin, -sin, 0.0)];
    let mut covariance = slopes * contact * slopes.transpose();
    for (i, a) in bends.iter().enumerate() {
        for (j, b) in bends.iter().enumerate() {
            let (a, b) = (a * contact, b * contact);
            covariance[(i, j)] += 0.5 * (a * b).trace() + 0.25 * a.trace() * b.trace();
        }
    }
    covariance
}

/// Derivatives of the pose at the end by the contact's angle and place there.
fn slopes(fitting: &Fitting, descent: &Descent) -> Matrix3x2<f64> {
    let ((sin, cos), arm) = (descent.evaluation.end.u.sin_cos(), arm(fitting, descent));
    // The part turns about the disk's centre with the angle, and moves along the tangent with the place.
    Matrix3x2::new(-arm.y, -sin, arm.x, cos, 1.0, 0.0)
}

/// From the disk's centre to the origin of the part at the end, m.
fn arm(fitting: &Fitting, descent: &Descent) -> Vector2<f64> {
    let centre = fitting.known.finger.centre(fitting.data.duration());
    end_pose(fitting, descent).origin() - centre
}
