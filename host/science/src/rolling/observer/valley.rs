//! How uncertain a motion is whose attitude is known poorly: what the bend of its valley adds to the covariances.
//!
//! Attitudes that explain the readings nearly as well as the best lie on a curve, and the ellipsoid that slopes give
//! leaves it soon. So the unknown that the least certain turn depends on most is held on either side of its best value,
//! and all others are fitted again ([`profile`](crate::math::least_squares::profile)).
//!
//! Units: SI. Errors: none; where a side is not found, the slopes' word stands.

use nalgebra::{DMatrix, DVector};

use super::super::flow::STATE_COLUMNS;
use super::super::mechanics::RollState;
use super::fit::{Ends, Point, RollFit, Unknowns};
use super::track::Track;
use super::verdict::covariance_of;
use crate::math::least_squares::profile::Beside;
use crate::search::Halt;

/// Standard deviation of attitude, rad, from which on a valley is followed: up to it the slopes change by no more than a
/// hundredth or two, and no certified answer has as much.
const WIDE_RAD: f64 = 0.015;

/// What the bend of a valley adds to the covariances that slopes give: of the unknowns, and of attitude, angular
/// velocity and further unknowns at both ends.
#[derive(Clone, Debug)]
pub(super) struct Valley {
    pub(super) middle: DMatrix<f64>,
    pub(super) ends: [DMatrix<f64>; 2],
}

impl Valley {
    /// That of a fit with its ends; none where the attitude is known well, or symmetry leaves it free.
    pub(super) fn through(
        unknowns: &Unknowns,
        track: &Track,
        fit: &RollFit,
        ends: &Ends,
        halt: &Halt<'_>,
    ) -> Option<Self> {
        fit.point.body.symmetry().order()?;
        let covariance = covariance_of(unknowns, fit)?;
        let widest = ends.columns.iter().map(|columns| widest(columns, &covariance));
        let (unknown, sigma) = widest.max_by(|a, b| a.1.total_cmp(&b.1))?;
        if sigma.is_nan() || sigma < WIDE_RAD {
            return None;
        }
        let along = covariance.column(unknown) / covariance[(unknown, unknown)].sqrt();
        let found = [-1.0, 1.0].into_iter().flat_map(|side| unknowns.beside(track, fit, (unknown, &along), side, halt));
        let excess = |beside: Beside<Point>| {
            let there = unknowns.ends(track, &beside.place);
            let straight = &along * beside.deviations;
            let change = unknowns.change(&fit.point, &beside.place);
            let end = |index: usize| {
                let [from, to] = [ends, &there].map(|ends| if index == 0 { &ends.start } else { &ends.end });
                let carried = carried(&ends.columns[index]);
                let mut off = &carried * &change;
                off.rows_mut(0, STATE_COLUMNS).copy_from(&state_change(from, to));
                beside.excess(&off, &(carried * &straight))
            };
            Self { middle: beside.excess(&change, &straight), ends: [end(0), end(1)] }
        };
        found.map(excess).reduce(Self::and)
    }

    fn and(self, other: Self) -> Self {
        let ([start, end], [other_start, other_end]) = (self.ends, other.ends);
        Self { middle: self.middle + other.middle, ends: [start + other_start, end + other_end] }
    }
}

/// The unknown that the least certain turn at an end depends on most, and that turn's standard deviation, rad.
fn widest(columns: &DMatrix<f64>, covariance: &DMatrix<f64>) -> (usize, f64) {
    let turns = columns.rows(0, 3);
    let shares = turns * covariance.view((0, 0), (columns.ncols(), columns.ncols()));
    let eigen = (&shares * turns.transpose()).symmetric_eigen();
    let index = eigen.eigenvalues.imax();
    let by_unknown = shares.tr_mul(&eigen.eigenvectors.column(index));
    let correlation = |unknown: usize| {
        let variance = covariance[(unknown, unknown)];
        if variance > 0.0 { by_unknown[unknown].abs() / variance.sqrt() } else { 0.0 }
    };
    let all = 0..columns.ncols();
    let unknown = all.max_by(|a, b| correlation(*a).total_cmp(&correlation(*b))).unwrap_or(0);
    (unknown, eigen.eigenvalues[index].max(0.0).sqrt())
}

/// From a change of the unknowns to that of attitude and angular velocity at an end, and of the further unknowns.
pub(super) fn carried(columns: &DMatrix<f64>) -> DMatrix<f64> {
    let count = columns.ncols();
    // The contact in the middle moves no end.
    let mut carried = DMatrix::zeros(count, count + 2);
    carried.view_mut((0, 0), (STATE_COLUMNS, count)).copy_from(columns);
    for further in STATE_COLUMNS..count {
        carried[(further, further)] = 1.0;
    }
    carried
}

/// Turn (rad) and change of the angular velocity (rad/s), body axes.
fn state_change(from: &RollState, to: &RollState) -> DVector<f64> {
    let turn = (from.attitude().inverse() * to.attitude()).scaled_axis();
    DVector::from_iterator(STATE_COLUMNS, turn.iter().chain(&(to.omega - from.omega)).copied())
}
