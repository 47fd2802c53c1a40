//! What a pose is worth: how errors of the lines carry over to it, and which poses only repeat each other.
//!
//! Frames: world. Units: m, rad.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::readings::HalfPlane;
use crate::geometry::ConvexPolygon;
use crate::geometry::Pose;

/// Corners that a symmetry takes onto each other agree to this share of the size, as poses touch their lines.
const SYMMETRIC_RELATIVE: f64 = 1e-9;

/// Poses of one group agree to this, in part sizes and rad; found separately, each has its own rounding errors.
const CONGRUENT: f64 = 1e-6;

/// How well lines hold a part: the least σ such that some small motion (x, y, size·θ) of length 1 moves no line by more
/// than σ in all (root of the sum of squares).
///
/// An error e of the lines moves the pose by about e/σ. 1 is well held; 0 is a pose that can move, at a tangency,
/// without leaving the lines to first order.
#[must_use]
pub fn conditioning(part: &ConvexPolygon, lines: &[HalfPlane], pose: &Pose) -> f64 {
    super::mixed::information(part, lines, &[], pose).symmetric_eigenvalues().min().max(0.0).sqrt()
}

/// How many turns about its centre leave a part the same: 1 if it has no symmetry, 4 for a square.
#[must_use]
pub fn symmetry_order(part: &ConvexPolygon) -> usize {
    let corners = part.corners();
    let n = corners.len();
    let is_symmetric = |order: &usize| {
        let (sin, cos) = (TAU / f64::from(u32::try_from(*order).unwrap_or(u32::MAX))).sin_cos();
        let turned = |v: &Vector2<f64>| Vector2::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y);
        (0..n).all(|k| (turned(&corners[k]) - corners[(k + n / order) % n]).norm() <= SYMMETRIC_RELATIVE * part.size())
    };
    (1..=n).rev().filter(|order| n.is_multiple_of(*order)).find(is_symmetric).unwrap_or(1)
}

/// Poses by their indices, those together in which a symmetric part looks the same.
#[must_use]
pub fn congruent_groups(part: &ConvexPolygon, poses: &[Pose]) -> Vec<Vec<usize>> {
    let order = f64::from(u32::try_from(symmetry_order(part)).unwrap_or(u32::MAX));
    let centre = |pose: &Pose| nalgebra::Isometry2::new(Vector2::new(pose.x, pose.y), pose.theta) * part.centre();
    let looks_the_same = |a: &Pose, b: &Pose| {
        let turns = (a.theta - b.theta) / (TAU / order);
        let apart = (turns - turns.round()).abs() * TAU / order;
        apart <= CONGRUENT && (centre(a) - centre(b)).norm() <= CONGRUENT * part.size()
    };
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (index, pose) in poses.iter().enumerate() {
        match groups.iter_mut().find(|group| looks_the_same(&poses[group[0]], pose)) {
            Some(group) => group.push(index),
            None => groups.push(vec![index]),
        }
    }
    groups
}
