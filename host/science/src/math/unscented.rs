//! A Gaussian through a function that is not straight, by points that have its mean and covariance.
//!
//! Implements: the cubature rule of third degree (Arasaratnam and Haykin, IEEE Trans. Autom. Control 54(6), 2009): 2 n points at
//! ±√n standard deviations along the columns of a square root of the covariance, all of one weight. All weights being
//! positive, no covariance that comes of them is anything but one.
//! What is known exactly has no points, so that a covariance may be singular.
//!
//! Units: as given. Errors: none; what has no square root has no points.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

/// A variance that is this share of its own before the columns so far were taken off counts as none.
const SINGULAR: f64 = 1e-12;

/// A mean and what is uncertain about it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Gaussian<const N: usize> {
    pub(crate) mean: SVector<f64, N>,
    pub(crate) covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> Gaussian<N> {
    /// The points less the mean, those in front of it; the others are opposite. None where nothing is uncertain.
    pub(crate) fn offsets(&self) -> Vec<SVector<f64, N>> {
        let columns = square_root(&self.covariance);
        let scale = (columns.len() as f64).sqrt();
        columns.into_iter().map(|column| column * scale).collect()
    }

    /// Of points of one weight.
    pub(crate) fn of_points(points: &[SVector<f64, N>]) -> Self {
        let share = 1.0 / points.len().max(1) as f64;
        let mean = points.iter().sum::<SVector<f64, N>>() * share;
        let covariance = points.iter().map(|point| (point - mean) * (point - mean).transpose() * share).sum();
        Self { mean, covariance }
    }

    /// Mean and covariance of several, each of a share of them all. What is exact and the same in all stays so.
    pub(crate) fn of_mixture(members: &[(f64, Self)]) -> Self {
        let first = members.first().map_or_else(SVector::zeros, |(_, first)| first.mean);
        let mean = first + members.iter().map(|(share, of)| (of.mean - first) * *share).sum::<SVector<f64, N>>();
        let covariance = members.iter().map(|(share, of)| {
            let off = of.mean - mean;
            (of.covariance + off * off.transpose()) * *share
        });
        Self { mean, covariance: covariance.sum() }
    }

    /// Without what a number being known to be its mean would tell: it has no part in anything any more.
    pub(crate) fn fix(&mut self, place: usize, at: f64) {
        self.mean[place] = at;
        self.covariance.row_mut(place).fill(0.0);
        self.covariance.column_mut(place).fill(0.0);
    }
}

/// Columns whose squares add up to a covariance: Cholesky's, those of no length left out.
pub(crate) fn square_root<const N: usize>(covariance: &SMatrix<f64, N, N>) -> Vec<SVector<f64, N>> {
    let mut left = *covariance;
    let mut columns = Vec::new();
    for place in 0..N {
        let variance = left[(place, place)];
        if variance <= SINGULAR * covariance[(place, place)] {
            continue;
        }
        let column: SVector<f64, N> = left.column(place) / variance.sqrt();
        left -= column * column.transpose();
        columns.push(column);
    }
    columns
}

/// What two values measured say of a Gaussian.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Measured<const N: usize> {
    pub(crate) after: Gaussian<N>,
    /// Squared difference of measured and expected in standard deviations; of two degrees of freedom.
    pub(crate) misfit: f64,
    /// ln of the determinant of the covariance of what was expected, noise included.
    pub(crate) log_determinant: f64,
}

/// A Gaussian by values measured with noise, `expected` at its points, where more is uncertain of it than its points show.
/// None where the covariance of what is measured has no inverse.
pub(crate) fn measured<const N: usize>(
    before: &Gaussian<N>,
    points: &[SVector<f64, N>],
    expected: &[Vector2<f64>],
    value: &Vector2<f64>,
    noise: &Matrix2<f64>,
) -> Option<Measured<N>> {
    let of_points = Gaussian::of_points(points);
    let of_expected = Gaussian::of_points(expected);
    let share = 1.0 / points.len().max(1) as f64;
    let across: SMatrix<f64, N, 2> = points
        .iter()
        .zip(expected)
        .map(|(point, expected)| (point - of_points.mean) * (expected - of_expected.mean).transpose() * share)
        .sum();
    let total = of_expected.covariance + noise;
    let root = total.cholesky()?;
    let gain: SMatrix<f64, N, 2> = root.solve(&across.transpose()).transpose();
    let off = value - of_expected.mean;
    let covariance = before.covariance - gain * across.transpose();
    Some(Measured {
        after: Gaussian { mean: before.mean + gain * off, covariance: (covariance + covariance.transpose()) * 0.5 },
        misfit: off.dot(&root.solve(&off)),
        log_determinant: total.determinant().ln(),
    })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Vector3};

    use super::*;

    /// Of three numbers one is known, and two are correlated.
    fn gaussian() -> Gaussian<3> {
        let covariance = Matrix3::new(4.0, 0.0, 1.2, 0.0, 0.0, 0.0, 1.2, 0.0, 0.5);
        Gaussian { mean: Vector3::new(1.0, 2.0, -1.0), covariance }
    }

    fn points(of: &Gaussian<3>) -> Vec<Vector3<f64>> {
        of.offsets().iter().flat_map(|offset| [of.mean + offset, of.mean - offset]).collect()
    }

    #[test]
    fn points_have_the_mean_and_covariance_that_they_stand_for() {
        let points = points(&gaussian());
        assert_eq!(points.len(), 4);
        let of_points = Gaussian::of_points(&points);
        assert!((of_points.mean - gaussian().mean).norm() < 1e-12);
        assert!((of_points.covariance - gaussian().covariance).norm() < 1e-12);
    }

    /// As of the points of them all; what is known in all stays known to the last bit.
    #[test]
    fn a_mixture_has_the_mean_and_covariance_of_all() {
        let one = gaussian();
        let other = Gaussian { mean: one.mean + Vector3::new(3.0, 0.0, -0.7), covariance: one.covariance * 0.1 };
        let mixture = Gaussian::of_mixture(&[(0.5, one), (0.5, other)]);
        let all = Gaussian::of_points(&[points(&one), points(&other)].concat());
        assert!((mixture.mean - all.mean).norm() < 1e-12 && (mixture.covariance - all.covariance).norm() < 1e-12);
        assert_eq!((mixture.mean.y, mixture.covariance[(1, 1)]), (2.0, 0.0));
        assert_eq!(Gaussian::of_mixture(&[(1.0, one)]), one);
        let thirds = Gaussian::of_mixture(&[(0.1, one), (0.2, one), (0.7, other)]);
        assert_eq!((thirds.mean.y, thirds.covariance[(1, 1)]), (2.0, 0.0));
    }

    /// Where all is straight, the answer is that of Bayes: (C⁻¹ + Hᵀ R⁻¹ H)⁻¹ of the two that are uncertain.
    #[test]
    fn of_a_straight_function_it_is_bayes() {
        let (before, noise) = (gaussian(), Matrix2::new(0.3, 0.1, 0.1, 0.2));
        let slopes = Matrix2::new(1.0, 0.5, -0.3, 2.0);
        let expected = |at: &Vector3<f64>| slopes * Vector2::new(at.x, at.z);
        let (points, value) = (points(&before), Vector2::new(0.4, -1.0));
        let expectations: Vec<_> = points.iter().map(expected).collect();
        let found = measured(&before, &points, &expectations, &value, &noise).unwrap();

        let own = Matrix2::new(4.0, 1.2, 1.2, 0.5).try_inverse().unwrap();
        let weight = noise.try_inverse().unwrap();
        let covariance = (own + slopes.transpose() * weight * slopes).try_inverse().unwrap();
        let off = value - expected(&before.mean);
        let mean = Vector2::new(1.0, -1.0) + covariance * slopes.transpose() * weight * off;
        assert!((Vector2::new(found.after.mean.x, found.after.mean.z) - mean).norm() < 1e-12);
        assert!((found.after.covariance[(0, 0)] - covariance[(0, 0)]).abs() < 1e-12);
        assert!((found.after.covariance[(0, 2)] - covariance[(0, 1)]).abs() < 1e-12);
        assert!((found.after.mean.y, found.after.covariance[(1, 1)]) == (2.0, 0.0));
        let total = slopes * Matrix2::new(4.0, 1.2, 1.2, 0.5) * slopes.transpose() + noise;
        assert!((found.misfit - off.dot(&(total.try_inverse().unwrap() * off))).abs() < 1e-12);
    }
}
