//! The poses that fit touches best, one in each group of cells that hang together.
//!
//! The residual of a touch is (distance of the disk's centre from the part − radius)/σ. It falls by the normal's
//! component of the part's motion at the point touched.
//!
//! Frames: world. Units: m, rad. Errors: none.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::super::noise::PoseMode;
use super::cells::{Cells, Middle};
use super::{FingerTouch, TouchTask, outlines_apart};
use crate::geometry::Pose;
use crate::geometry::disk_curve::DiskCurve;
use crate::math::angle::wrap_angle;
use crate::math::least_squares::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};
use crate::math::statistics::chi_square_quantile;

/// A pose is left out where χ² exceeds this quantile: about what [`super::TRUSTED_SD`] is for one reading.
const GATE: f64 = 0.9999;

/// Poses whose outlines are nearer than this share of the tolerance are one.
const SAME_SHARE: f64 = 0.25;

/// Descents begin at so many cells of a group.
const STARTS: usize = 4;

/// A group hangs together over gaps of this many cells.
const GAP_CELLS: f64 = 2.0;

/// Variance of a pose that touches leave free, m² and rad²: far beyond any tolerance.
const UNKNOWN: f64 = 1e6;

struct Touches<'a> {
    curve: &'a DiskCurve,
    touches: &'a [FingerTouch],
}

impl LeastSquaresProblem<3> for Touches<'_> {
    type Place = Pose;

    fn cost(&self, pose: &Pose) -> f64 {
        self.touches.iter().map(|touch| miss(self.curve, pose, touch).0.powi(2)).sum()
    }

    fn normal_equations(&self, pose: &Pose) -> NormalEquations<3> {
        let mut equations = NormalEquations::zero();
        for touch in self.touches {
            let (miss, slopes) = miss(self.curve, pose, touch);
            equations.add(miss, slopes);
        }
        equations
    }

    fn moved(&self, pose: &Pose, step: &Vector3<f64>) -> Option<Pose> {
        Some(Pose { x: pose.x + step.x, y: pose.y + step.y, theta: pose.theta + step.z })
    }
}

/// By how much a touch misses the outline, in standard deviations, with its derivatives by x, y, theta of the pose.
fn miss(curve: &DiskCurve, pose: &Pose, touch: &FingerTouch) -> (f64, Vector3<f64>) {
    let isometry = pose.isometry();
    let (distance, nearest) = curve.signed_distance(isometry.inverse() * touch.centre);
    let at = isometry * nearest;
    let outwards = (touch.centre - at) * distance.signum();
    let normal = outwards.try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector2::zeros);
    ((distance - curve.radius()) / touch.sigma, slopes(&normal, at, pose) / touch.sigma)
}

/// How a distance along a normal at a point of the part changes with x, y, theta.
pub(super) fn slopes(normal: &Vector2<f64>, at: Point2<f64>, pose: &Pose) -> Vector3<f64> {
    let lever = at - pose.origin();
    -Vector3::new(normal.x, normal.y, lever.perp(normal))
}

/// The poses of all groups of cells, best first.
pub(super) fn modes(task: &TouchTask, curve: &DiskCurve, touches: &[FingerTouch], cells: &Cells) -> Vec<PoseMode> {
    if !cells.is_fine() {
        return Vec::new();
    }
    let middles: Vec<_> = cells.middles(task, curve, 0, 1).collect();
    let problem = Touches { curve, touches };
    let gate = chi_square_quantile(GATE, touches.len().saturating_sub(3).max(1));
    let size = task.outline.vertices().iter().map(|vertex| vertex.coords.norm()).fold(0.0, f64::max);
    let mut modes: Vec<PoseMode> = Vec::new();
    for group in groups(&middles, size) {
        let mut starts: Vec<_> = group.iter().map(|&member| (problem.cost(&middles[member].pose), member)).collect();
        starts.sort_by(|a, b| a.0.total_cmp(&b.0));
        // The best, and others over all of the group.
        let stride = starts.len().div_ceil(STARTS).max(1);
        for (_, start) in starts.into_iter().step_by(stride) {
            let pose = minimise(&problem, middles[start].pose, &LeastSquaresSettings::default(), |_| false).place;
            let chi2 = problem.cost(&pose);
            let known = |mode: &PoseMode| is_same(task, &mode.pose, &pose);
            if chi2 > gate || !near(&middles, &group, &pose, size) || modes.iter().any(known) {
                continue;
            }
            // Where no touch holds it, it is not known at all.
            let covariance = problem.normal_equations(&pose).curvature.try_inverse();
            let covariance = covariance.unwrap_or_else(|| Matrix3::identity() * UNKNOWN);
            let pose = Pose { theta: wrap_angle(pose.theta), ..pose };
            modes.push(PoseMode { pose, chi2, covariance, at_corner_change: false });
        }
    }
    modes.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    modes
}

/// Whether two poses are one: as near to each other as `SAME_SHARE` of the tolerance, without a symmetry between.
fn is_same(task: &TouchTask, a: &Pose, b: &Pose) -> bool {
    let turn = wrap_angle(a.theta - b.theta).abs();
    turn <= task.tolerance.angle && outlines_apart(&task.outline, a, b) <= SAME_SHARE * task.tolerance.distance
}

/// How far a point of a part of this size is moved between two poses, at most.
fn apart(a: &Pose, b: &Pose, size: f64) -> f64 {
    let by = a.minus(b);
    by.x.hypot(by.y) + size * by.z.abs()
}

/// Whether a descent stayed with its group: others have descents of their own.
fn near(middles: &[Middle], group: &[usize], pose: &Pose, size: f64) -> bool {
    group.iter().any(|&member| {
        let middle = &middles[member];
        apart(&middle.pose, pose, size) <= (GAP_CELLS + 2.0) * 2.0 * middle.reach
    })
}

/// Cells that hang together, by their numbers.
fn groups(middles: &[Middle], size: f64) -> Vec<Vec<usize>> {
    let mut left: Vec<usize> = (0..middles.len()).collect();
    let mut groups = Vec::new();
    while let Some(first) = left.pop() {
        let mut group = vec![first];
        let mut grown = 0;
        while grown < group.len() {
            let from = middles[group[grown]];
            grown += 1;
            left.retain(|&other| {
                let to = &middles[other];
                let joins = apart(&from.pose, &to.pose, size) <= GAP_CELLS * (from.reach + to.reach);
                if joins {
                    group.push(other);
                }
                !joins
            });
        }
        groups.push(group);
    }
    groups
}

/// Standard deviations of the outline's centroid (the larger over all directions, m) and of the turn (rad).
pub(super) fn deviations(task: &TouchTask, pose: &Pose, covariance: &Matrix3<f64>) -> (f64, f64) {
    let lever = pose.isometry() * task.outline.centroid() - pose.origin();
    let by_pose = nalgebra::Matrix2x3::new(1.0, 0.0, -lever.y, 0.0, 1.0, lever.x);
    let of_centroid = by_pose * covariance * by_pose.transpose();
    let largest = of_centroid.symmetric_eigenvalues().max();
    (largest.max(0.0).sqrt(), covariance[(2, 2)].max(0.0).sqrt())
}
