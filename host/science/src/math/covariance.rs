//! Covariances of one thing from several sources.
//!
//! Units: the caller's, mixed as they come. Errors: none.

use nalgebra::{DMatrix, SMatrix};

/// Directions with less than this share of the whole have no variance but rounding's.
const NONE: f64 = 1e-12;

/// A covariance that in every direction is at least as wide as each of two: in the directions in which both are diagonal, the larger
/// variance. It does not depend on units, and either may be singular.
pub(crate) fn wider<const N: usize>(a: &SMatrix<f64, N, N>, b: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    let both = a + b;
    // Of what is no number there are no directions.
    if both.iter().any(|value| !value.is_finite()) {
        return both;
    }
    let scale = both.diagonal().map(|variance| variance.max(0.0).sqrt());
    let inverse_scale = scale.map(|sd| if sd > 0.0 { 1.0 / sd } else { 0.0 });
    let correlation = |of: &SMatrix<f64, N, N>| {
        let of = SMatrix::<f64, N, N>::from_diagonal(&inverse_scale) * of * SMatrix::from_diagonal(&inverse_scale);
        DMatrix::from_fn(N, N, |row, column| of[(row, column)])
    };
    // Where their sum is the identity, both are diagonal in the same directions, and their variances add up to 1.
    let whole = correlation(&both).symmetric_eigen();
    let open: Vec<_> = (0..N).filter(|&i| whole.eigenvalues[i] > NONE * N as f64).collect();
    if open.is_empty() {
        return SMatrix::zeros();
    }
    let columns = |power: f64| {
        let column =
            |row: usize, of: usize| whole.eigenvectors[(row, open[of])] * whole.eigenvalues[open[of]].powf(power);
        DMatrix::from_fn(N, open.len(), column)
    };
    let to_identity = columns(-0.5);
    let share = (to_identity.tr_mul(&correlation(a)) * &to_identity).symmetric_eigen();
    let root = columns(0.5) * share.eigenvectors;
    let larger = DMatrix::from_diagonal(&share.eigenvalues.map(|of_a| of_a.max(1.0 - of_a)));
    let joined = &root * larger * root.transpose();
    SMatrix::from_fn(|row, column| joined[(row, column)] * scale[row] * scale[column])
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;

    use super::*;
    use crate::math::random::Draw;

    /// Rounding of variances of order 1, and what the square root of a singular one makes of it.
    const ROUNDING: f64 = 1e-9;

    /// Of a rank, with units as far apart as metres and radians.
    fn drawn(draw: &mut Draw, rank: usize) -> Matrix3<f64> {
        let columns = (0..rank).map(|_| Vector3::from_fn(|_, _| draw.normal()));
        columns.map(|column| column * column.transpose()).sum()
    }

    proptest! {
        #[test]
        fn what_is_wider_is_as_wide_as_each_in_every_direction(seed in any::<u64>(), ranks in (0_usize..=4, 0_usize..=4)) {
            let mut draw = Draw::case(seed, 0);
            let (a, b) = (drawn(&mut draw, ranks.0), drawn(&mut draw, ranks.1));
            let joined = wider(&a, &b);
            for of in [a, b] {
                let least = (joined - of).symmetric_eigenvalues().min();
                prop_assert!(least > -ROUNDING * (a + b).trace().max(1.0), "{least}: {joined} {of}");
            }
            // No wider than both together.
            let least = (a + b - joined).symmetric_eigenvalues().min();
            prop_assert!(least > -ROUNDING * (a + b).trace().max(1.0), "{least}");
            prop_assert!((wider(&b, &a) - joined).norm() < ROUNDING * (a + b).trace().max(1.0));
        }

        #[test]
        fn units_do_not_matter_and_one_that_is_wider_anyway_is_it(seed in any::<u64>(), size in -6.0..6.0_f64) {
            let mut draw = Draw::case(seed, 0);
            let (a, more) = (drawn(&mut draw, 2), drawn(&mut draw, 3));
            let b = a + more;
            prop_assert!((wider(&a, &b) - b).norm() < ROUNDING * b.trace().max(1.0));
            let other = drawn(&mut draw, 3);
            let unit = Matrix3::from_diagonal(&Vector3::new(10.0_f64.powf(size), 1.0, 1.0));
            let scaled = wider(&(unit * other * unit), &(unit * b * unit));
            let expected = unit * wider(&other, &b) * unit;
            for i in 0..3 {
                prop_assert!((scaled[(i, i)] / expected[(i, i)] - 1.0).abs() < ROUNDING, "{scaled} {expected}");
            }
        }
    }

    #[test]
    fn of_diagonal_ones_it_is_the_larger_variances() {
        let [a, b, expected] =
            [[4.0, 1e-8, 0.0], [1.0, 9e-8, 0.0], [4.0, 9e-8, 0.0]].map(|it| Matrix3::from_diagonal(&Vector3::from(it)));
        assert!(
            (wider(&a, &b) - expected).component_div(&(expected + Matrix3::repeat(1e-30))).diagonal().abs().max()
                < ROUNDING
        );
        assert_eq!(wider(&Matrix3::zeros(), &Matrix3::zeros()), Matrix3::zeros());
        assert!(wider(&Matrix3::repeat(f64::NAN), &Matrix3::identity())[(0, 0)].is_nan());
    }
}
