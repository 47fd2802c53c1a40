//! The finger's unloaded reading from tares taken at each position of a dividing head.
//!
//! Lying in the head, the finger is bent by its own weight, which turns with respect to the gauges just as the load
//! does: `tareᵢ = offset + w · B · (−cos uᵢ, −sin uᵢ)`, with `w` the force that bends like disk and beam. Three
//! unknowns, linear, unweighted: what scatters here is drift over the session, the same for every tare.
//!
//! Frames: finger. Units: counts, unit of force. Errors: none; too few positions give the mean and no weight.

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Vector2, Vector3};

use super::measurements::{CalibrationContact, Fixture};
use crate::math::angle::push_direction;

/// Share of the loads' directions that must not cancel out for the weight to be told from the offset.
///
/// It is the spread of the directions about their mean, from 0 (all at one angle) to 1 (all round). Below it, offset
/// and weight would trade against each other ten times more than noise.
const SPREAD_MIN: f64 = 0.1;

/// Offset with the variance of its estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct OwnTares {
    /// Unloaded and weightless reading, counts.
    pub(super) offset: Vector2<f64>,
    /// Covariance of the offset, counts².
    pub(super) covariance: Matrix2<f64>,
    /// Force of the finger's own weight, if the positions tell it.
    pub(super) weight: Option<f64>,
}

/// Fits the offset to the tares that contacts carry.
pub(super) fn from_own_tares(contacts: &[CalibrationContact], matrix: &Matrix2<f64>, fixture: &Fixture) -> OwnTares {
    let tares: Vec<(Vector2<f64>, Vector2<f64>)> =
        contacts.iter().filter_map(|contact| Some((push_direction(contact.angle), contact.tare?.0.counts))).collect();
    let count = tares.len().max(1) as f64;
    let mean_direction: Vector2<f64> = tares.iter().map(|(direction, _)| direction).sum::<Vector2<f64>>() / count;
    let with_weight = 1.0 - mean_direction.norm_squared() > SPREAD_MIN && tares.len() > 1;
    // Counts of a unit weight are made of order 1 so that the three unknowns are of one size.
    let scale = matrix.norm();
    let mut normal = Matrix3::zeros();
    let mut right = Vector3::zeros();
    for (direction, counts) in &tares {
        let jacobian = jacobian(matrix, *direction, if with_weight { scale } else { f64::INFINITY });
        normal += jacobian.transpose() * jacobian;
        right += jacobian.transpose() * counts;
    }
    if !with_weight {
        normal[(2, 2)] = 1.0;
    }
    let Some(inverse) = normal.try_inverse() else {
        return OwnTares { offset: Vector2::zeros(), covariance: Matrix2::identity(), weight: None };
    };
    let unknowns = inverse * right;
    let residual = |(direction, counts): &(Vector2<f64>, Vector2<f64>)| {
        (counts - jacobian(matrix, *direction, scale) * unknowns).norm_squared()
    };
    let free = 2.0 * count - if with_weight { 3.0 } else { 2.0 };
    let scatter = if free > 0.0 { tares.iter().map(residual).sum::<f64>() / free } else { 0.0 };
    let variance = scatter.max(fixture.drift_sigma.powi(2)).max(1.0 / 12.0);
    OwnTares {
        offset: unknowns.xy(),
        covariance: inverse.fixed_view::<2, 2>(0, 0) * variance,
        weight: with_weight.then_some(unknowns.z / scale),
    }
}

/// Counts by offset x, offset y and weight (in units that make it of order 1).
fn jacobian(matrix: &Matrix2<f64>, direction: Vector2<f64>, scale: f64) -> Matrix2x3<f64> {
    let by_weight = matrix * direction / scale;
    Matrix2x3::new(1.0, 0.0, by_weight.x, 0.0, 1.0, by_weight.y)
}
