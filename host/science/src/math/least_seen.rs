//! Where a system tells least: a descent to the place at which a matrix of derivatives comes nearest to losing rank.
//!
//! Lowered is σ², the square of the least singular value of a matrix M that depends on a place x. It is the least of
//! `|M(x) v|²` over directions v of length 1, so σ and its direction follow from x and only x is varied (variable
//! projection): the residuals are M v, their slopes (∂M/∂x) v less what a turn of v takes back.
//!
//! Implements: G. H. Golub and V. Pereyra, "The differentiation of pseudo-inverses and nonlinear least squares problems
//! whose variables separate" (1973), with L. Kaufman's simplification; descends with
//! [`least_squares`](super::least_squares).
//! Assumes: at least as many rows as columns. Units: the caller's; unknowns scaled to order 1. Errors: none; where there is
//! no matrix the descent does not go.

use nalgebra::{DMatrix, DVector, SVector};

use super::least_squares::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};

/// Step of the differences, of unknowns of order 1: truncation and rounding of what 16 digits give are both below 1e-9.
const STEP: f64 = 1e-5;

/// A descent goes no further than this at once, in unknowns of order 1: matrices bend.
const FAR: f64 = 0.3;

/// The place that a descent ended in.
#[derive(Clone, Debug, PartialEq)]
pub struct LeastSeen<const N: usize> {
    /// The unknowns.
    pub place: SVector<f64, N>,
    /// The least singular value there, as a share of the largest.
    pub least: f64,
    /// The change of state that shows least there, of length 1.
    pub unseen: DVector<f64>,
    /// Which unknowns ended at a bound.
    pub at_bound: [bool; N],
}

/// Descends from a place, every unknown kept within ±its bound, over matrices that `rows` gives; none where there is none
/// at the start.
///
/// ```
/// use nalgebra::{DMatrix, SVector};
/// use palpate::math::least_seen;
///
/// // Two rows that are parallel where x = 0.3.
/// let rows = |x: &SVector<f64, 1>| Some(DMatrix::from_row_slice(2, 2, &[1.0, 1.0, 1.0, 0.7 + x[0]]));
/// let found = least_seen(rows, SVector::from([-0.8]), SVector::from([1.0])).unwrap();
/// assert!(found.least < 1e-9 && (found.place[0] - 0.3).abs() < 1e-8);
/// ```
pub fn least_seen<const N: usize>(
    rows: impl Fn(&SVector<f64, N>) -> Option<DMatrix<f64>>,
    start: SVector<f64, N>,
    bounds: SVector<f64, N>,
) -> Option<LeastSeen<N>> {
    let descent = Descent { rows, bounds };
    let start = descent.at(start)?;
    let end = minimise(&descent, start, &LeastSquaresSettings::default(), |_| false).place;
    let at_bound = std::array::from_fn(|i| end.x[i].abs() >= descent.bounds[i]);
    Some(LeastSeen { place: end.x, least: end.least(), unseen: end.direction, at_bound })
}

struct Descent<F, const N: usize> {
    rows: F,
    bounds: SVector<f64, N>,
}

struct Place<const N: usize> {
    x: SVector<f64, N>,
    /// Largest and least singular value.
    values: [f64; 2],
    /// What shows least.
    direction: DVector<f64>,
    /// Columns that span what all other directions show.
    others: DMatrix<f64>,
    residuals: DVector<f64>,
}

impl<const N: usize> Place<N> {
    fn least(&self) -> f64 {
        if self.values[0] > 0.0 { self.values[1] / self.values[0] } else { 0.0 }
    }
}

impl<F: Fn(&SVector<f64, N>) -> Option<DMatrix<f64>>, const N: usize> Descent<F, N> {
    fn at(&self, x: SVector<f64, N>) -> Option<Place<N>> {
        let matrix = (self.rows)(&x).filter(|matrix| matrix.iter().all(|entry| entry.is_finite()))?;
        let svd = matrix.clone().svd(true, true);
        let (u, v_t) = (svd.u?, svd.v_t?);
        let (last, least) = svd.singular_values.argmin();
        let direction = v_t.row(last).transpose();
        let residuals = &matrix * &direction;
        Some(Place {
            x,
            values: [svd.singular_values.max(), least],
            direction,
            others: u.remove_column(last),
            residuals,
        })
    }
}

impl<F: Fn(&SVector<f64, N>) -> Option<DMatrix<f64>>, const N: usize> LeastSquaresProblem<N> for Descent<F, N> {
    type Place = Place<N>;

    fn cost(&self, place: &Place<N>) -> f64 {
        place.values[1] * place.values[1]
    }

    fn normal_equations(&self, place: &Place<N>) -> NormalEquations<N> {
        let slopes: Vec<DVector<f64>> = (0..N)
            .map(|i| {
                let moved = |sign: f64| {
                    let mut x = place.x;
                    x[i] += sign * STEP;
                    Some((self.rows)(&x)? * &place.direction)
                };
                // Beside the edge of what there is, nothing is known of this unknown.
                let Some((up, down)) = moved(1.0).zip(moved(-1.0)) else {
                    return DVector::zeros(place.residuals.len());
                };
                let slope = (up - down) / (2.0 * STEP);
                &slope - &place.others * place.others.tr_mul(&slope)
            })
            .collect();
        let mut equations = NormalEquations::zero();
        for (row, &residual) in place.residuals.iter().enumerate() {
            equations.add(residual, SVector::from_fn(|i, _| slopes[i][row]));
        }
        equations
    }

    fn moved(&self, place: &Place<N>, step: &SVector<f64, N>) -> Option<Place<N>> {
        let x = SVector::from_fn(|i, _| (place.x[i] + step[i]).clamp(-self.bounds[i], self.bounds[i]));
        self.at(x)
    }

    fn held(&self, place: &Place<N>, equations: &NormalEquations<N>) -> [bool; N] {
        // A bound towards which the cost falls.
        std::array::from_fn(|i| place.x[i].abs() >= self.bounds[i] && place.x[i] * equations.gradient[i] < 0.0)
    }

    fn limited(&self, step: SVector<f64, N>) -> SVector<f64, N> {
        let length = step.norm();
        if length > FAR { step * (FAR / length) } else { step }
    }
}
