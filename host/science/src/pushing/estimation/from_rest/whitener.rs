//! Whitens means of windows: noise that is correlated with the next window's, under a few uncertain numbers that are common to all.
//!
//! Their covariance is C = N + V Vᵀ. N is noise: 2×2 blocks on the diagonal and beside it. V has a column for each common number: what
//! one standard deviation of it does to every window. Whitened is y = L⁻¹ x with C = L Lᵀ, from the first window on, so that what
//! is whitened of the first windows does not depend on those after.
//!
//! L is not written down, which would take the square of the windows. With N = B Bᵀ, of which B has as few blocks, it is
//! B K with I + P Pᵀ = K Kᵀ and P = B⁻¹ V; and K⁻¹ z are the innovations of a recursive least-squares fit of the common numbers
//! to z, in their standard deviations (T. Kailath, *An innovations approach to least-squares estimation*, IEEE Trans. Automatic
//! Control 13, 1968): each value less what those before have told of the common numbers.
//!
//! Units: of the values; whitened ones have none. Errors: [`Whitener::new`] gives none where the noise is no covariance.

use nalgebra::{DVector, Matrix2, SMatrix, Vector2};

/// Numbers that may be common to all windows: two of the bias, two of its drift, four of the calibration and the onset.
pub(super) const COMMON: usize = 9;

/// What one standard deviation of each common number does to a window's mean.
pub(super) type CommonShares = SMatrix<f64, 2, COMMON>;

/// What is uncertain about the mean of a window.
#[derive(Clone, Copy, Debug)]
pub(super) struct Uncertain {
    /// Covariance of its noise.
    pub(super) noise: Matrix2<f64>,
    /// Covariance of its noise with that of the one before.
    pub(super) with_previous: Matrix2<f64>,
    /// Zero for numbers that are not uncertain.
    pub(super) common: CommonShares,
}

/// See the [module](self).
#[derive(Clone, Debug)]
pub(super) struct Whitener {
    windows: Vec<Window>,
    /// How many numbers are common: the first.
    rank: usize,
    /// Noise, and all else that is uncertain, is so many times as large.
    times: f64,
}

#[derive(Clone, Copy, Debug)]
struct Window {
    /// Diagonal of C.
    variances: Vector2<f64>,
    noise: Factor,
    /// Block of B beside the diagonal.
    with_previous: Matrix2<f64>,
    /// By common number: what one standard deviation of it does, by rows of P.
    shares: [Vector2<f64>; COMMON],
    /// By common number: what it is corrected by, for an innovation of one.
    gains: [Vector2<f64>; COMMON],
    innovation: Factor,
}

/// Of a covariance L Lᵀ.
#[derive(Clone, Copy, Debug)]
struct Factor {
    /// L.
    lower: Matrix2<f64>,
    inverse: Matrix2<f64>,
}

impl Factor {
    fn new(covariance: Matrix2<f64>) -> Option<Self> {
        let lower = covariance.cholesky()?.unpack();
        Some(Self { lower, inverse: lower.solve_lower_triangular(&Matrix2::identity())? })
    }
}

impl Whitener {
    pub(super) fn new(windows: &[Uncertain]) -> Option<Self> {
        // What is known of the common numbers so far, and of the window before L⁻¹ and rows of P.
        let mut covariance = SMatrix::<f64, COMMON, COMMON>::identity();
        let mut before = (Matrix2::identity(), CommonShares::zeros());
        let all = windows.iter().map(|window| {
            let (inverse_before, shares_before) = before;
            let with_previous = window.with_previous * inverse_before.transpose();
            let noise = Factor::new(window.noise - with_previous * with_previous.transpose())?;
            let shares = noise.inverse * (window.common - with_previous * shares_before);
            before = (noise.inverse, shares);
            let known = covariance * shares.transpose();
            let innovation = Factor::new(Matrix2::identity() + shares * known)?;
            let gains = known * innovation.inverse.transpose() * innovation.inverse;
            // Joseph's form, which rounding leaves a covariance.
            let left = SMatrix::<f64, COMMON, COMMON>::identity() - gains * shares;
            covariance = left * covariance * left.transpose() + gains * gains.transpose();
            Some(Window {
                variances: (window.noise + window.common * window.common.transpose()).diagonal(),
                noise,
                with_previous,
                shares: std::array::from_fn(|number| shares.column(number).into_owned()),
                gains: std::array::from_fn(|number| gains.row(number).transpose()),
                innovation,
            })
        });
        let is_uncertain = |number: &usize| windows.iter().any(|window| window.common.column(*number).amax() > 0.0);
        let rank = (0..COMMON).rev().find(is_uncertain).map_or(0, |last| last + 1);
        Some(Self { windows: all.collect::<Option<_>>()?, rank, times: 1.0 })
    }

    /// The same of the first windows alone.
    pub(super) fn beginning(&self, windows: usize) -> Self {
        Self { windows: self.windows[..windows].to_vec(), ..*self }
    }

    /// The same where all that is uncertain is so many times as large.
    pub(super) fn with_noise(&self, times: f64) -> Self {
        Self { times: self.times * times, ..self.clone() }
    }

    /// L⁻¹ times means of the windows.
    pub(super) fn whiten(&self, means: impl Iterator<Item = Vector2<f64>>) -> DVector<f64> {
        let mut told = Told::new(self.rank);
        let mut before = Vector2::zeros();
        let mut whitened = Vec::with_capacity(2 * self.windows.len());
        for (mean, window) in means.zip(&self.windows) {
            before = window.noise.inverse * (mean - window.with_previous * before);
            let innovation = before - told.expected(window);
            told.correct(window, innovation);
            whitened.extend((window.innovation.inverse * innovation / self.times).iter());
        }
        DVector::from_vec(whitened)
    }

    /// The means of which these are the whitened values: L times them.
    pub(super) fn unwhiten(&self, whitened: &DVector<f64>) -> Vec<Vector2<f64>> {
        let mut told = Told::new(self.rank);
        let mut before = Vector2::zeros();
        let mean = |(pair, window): (&[f64], &Window)| {
            let innovation = window.innovation.lower * Vector2::new(pair[0], pair[1]) * self.times;
            let value = told.expected(window) + innovation;
            told.correct(window, innovation);
            let mean = window.noise.lower * value + window.with_previous * before;
            before = value;
            mean
        };
        whitened.as_slice().chunks(2).zip(&self.windows).map(mean).collect()
    }

    /// Standard deviation of each mean along each axis.
    pub(super) fn deviations(&self) -> Vec<Vector2<f64>> {
        self.windows.iter().map(|window| window.variances.map(f64::sqrt) * self.times).collect()
    }
}

/// What the windows so far tell of the common numbers, in their standard deviations.
struct Told {
    numbers: [f64; COMMON],
    rank: usize,
}

impl Told {
    const fn new(rank: usize) -> Self {
        Self { numbers: [0.0; COMMON], rank }
    }

    fn expected(&self, window: &Window) -> Vector2<f64> {
        self.numbers[..self.rank].iter().zip(&window.shares).map(|(number, share)| share * *number).sum()
    }

    fn correct(&mut self, window: &Window, innovation: Vector2<f64>) {
        for (number, gain) in self.numbers[..self.rank].iter_mut().zip(&window.gains) {
            *number += gain.dot(&innovation);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;
    use nalgebra::DMatrix;
    use proptest::prelude::*;

    /// What a triangle and what it whitens are off by for each unit of the covariance's condition number, as a share of the largest:
    /// rounding, of some tens of values.
    const ROUNDING: f64 = 100.0 * f64::EPSILON;

    /// Windows of which some have no neighbour, and numbers that are mostly uncertain.
    fn drawn(draw: &mut Draw, windows: usize) -> Vec<Uncertain> {
        let known: [bool; COMMON] = std::array::from_fn(|_| draw.uniform(0.0, 1.0) < 0.3);
        let size = 10_f64.powf(draw.uniform(-2.0, 3.0));
        let window = |window: usize| {
            let root = Matrix2::from_fn(|_, _| draw.normal());
            let noise = root * root.transpose() + Matrix2::identity();
            let is_apart = window == 0 || draw.uniform(0.0, 1.0) < 0.1;
            // Smaller than half of the least of any noise: a covariance.
            let mut with_previous = Matrix2::from_fn(|_, _| draw.uniform(-0.2, 0.2));
            if is_apart {
                with_previous.fill(0.0);
            }
            let common = CommonShares::from_fn(|_, column| if known[column] { 0.0 } else { size * draw.normal() });
            Uncertain { noise, with_previous, common }
        };
        (0..windows).map(window).collect()
    }

    /// The same written down.
    fn dense(windows: &[Uncertain]) -> DMatrix<f64> {
        let size = 2 * windows.len();
        let mut covariance = DMatrix::zeros(size, size);
        for (row, at_row) in windows.iter().enumerate() {
            for (column, at_column) in windows.iter().enumerate() {
                let noise = match row.abs_diff(column) {
                    0 => at_row.noise,
                    1 if row > column => at_row.with_previous,
                    1 => at_column.with_previous.transpose(),
                    _ => Matrix2::zeros(),
                };
                let block = noise + at_row.common * at_column.common.transpose();
                covariance.view_mut((2 * row, 2 * column), (2, 2)).copy_from(&block);
            }
        }
        covariance
    }

    proptest! {
        #[test]
        fn it_whitens_as_the_triangle_of_the_covariance_does(case in 0..100_000_usize, windows in 1..40_usize) {
            let mut draw = Draw::case(11, case);
            let uncertain = drawn(&mut draw, windows);
            let times = draw.uniform(0.5, 2.0);
            let whitener = Whitener::new(&uncertain).unwrap().with_noise(times);
            let covariance = dense(&uncertain);
            let lower = covariance.clone().cholesky().unwrap().unpack() * times;
            let eigenvalues = covariance.clone().symmetric_eigenvalues();
            let rounding = ROUNDING * eigenvalues.max() / eigenvalues.min();
            let means: Vec<_> = (0..windows).map(|_| Vector2::new(draw.normal(), draw.normal())).collect();
            let plain = DVector::from_iterator(2 * windows, means.iter().flat_map(|mean| [mean.x, mean.y]));
            let whitened = whitener.whiten(means.iter().copied());
            let expected = lower.solve_lower_triangular(&plain).unwrap();
            let error = (&whitened - &expected).amax() / expected.amax();
            prop_assert!(error < rounding, "{error:e} of {rounding:e}");
            // And back.
            for (mean, back) in means.iter().zip(whitener.unwhiten(&whitened)) {
                prop_assert!((mean - back).amax() < rounding * plain.amax());
            }
            for (window, deviations) in whitener.deviations().iter().enumerate() {
                for axis in 0..2 {
                    let at = 2 * window + axis;
                    let expected = times * covariance[(at, at)].sqrt();
                    prop_assert!((deviations[axis] - expected).abs() < rounding * expected);
                }
            }
        }

        #[test]
        fn the_first_windows_are_whitened_alike_alone(case in 0..100_000_usize, first in 1..20_usize) {
            let mut draw = Draw::case(12, case);
            let uncertain = drawn(&mut draw, 20);
            let whitener = Whitener::new(&uncertain).unwrap();
            let means: Vec<_> = (0..20).map(|_| Vector2::new(draw.normal(), draw.normal())).collect();
            let whole = whitener.whiten(means.iter().copied());
            let beginning = whitener.beginning(first).whiten(means.into_iter());
            prop_assert_eq!(beginning, whole.rows(0, 2 * first).into_owned());
        }
    }
}
