//! Means and quantiles of data, and those of the distributions that gates and intervals are made of (from the crate
//! `statrs`).
//!
//! Accuracy: of data, rounding; of distributions, 1e-9 of the value.
//! Errors: none; of no data there is `None`, and the ends of the range are the ends of the distribution.

use std::iter::Sum;
use std::ops::Div;

use statrs::distribution::{ChiSquared, ContinuousCDF, FisherSnedecor, Normal};
use statrs::function::erf::erfc;

/// The arithmetic mean; `None` of nothing.
///
/// ```
/// use palpate::math::statistics::mean;
///
/// assert_eq!(mean(&[1.5, 2.5, 5.0]), Some(3.0)); // N
/// assert_eq!(mean::<f64, [f64; 0]>([]), None);
/// ```
#[must_use]
pub fn mean<T: Sum<I::Item> + Div<f64, Output = T>, I: IntoIterator>(values: I) -> Option<T> {
    let mut count = 0_usize;
    let sum: T = values.into_iter().inspect(|_| count += 1).sum();
    (count > 0).then(|| sum / count as f64)
}

/// The middle value, of an even number the mean of the two middle ones; `None` of nothing. Values must be numbers.
///
/// ```
/// use palpate::math::statistics::median;
///
/// assert_eq!(median([4.0, 1.0, 2.0, 3.0]), Some(2.5));
/// ```
#[must_use]
pub fn median(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    if values.is_empty() {
        return None;
    }
    let (middle, is_odd) = (values.len() / 2, values.len() % 2 == 1);
    let (below, &mut upper, _) = values.select_nth_unstable_by(middle, f64::total_cmp);
    let lower = below.iter().copied().max_by(f64::total_cmp).filter(|_| !is_odd);
    Some(lower.map_or(upper, |lower| 0.5 * (lower + upper)))
}

/// The value that this share of all, in per cent, lie below: of n sorted ones that at place ⌊n · share⌋ from 0, at 100
/// % the last; `None` of nothing. At 50 % it is one of the values, the upper of the two middle ones where [`median`]
/// takes their mean.
///
/// ```
/// use palpate::math::statistics::percentile;
///
/// assert_eq!(percentile([4.0, 1.0, 2.0, 3.0], 50), Some(3.0));
/// ```
#[must_use]
pub fn percentile(values: impl IntoIterator<Item = f64>, per_cent: usize) -> Option<f64> {
    let mut values: Vec<f64> = values.into_iter().collect();
    let place = (values.len() * per_cent / 100).min(values.len().checked_sub(1)?);
    Some(*values.select_nth_unstable_by(place, f64::total_cmp).1)
}

/// The value that a standard normal number stays below with probability `p`; infinite at 0 and 1.
#[must_use]
pub fn normal_quantile(p: f64) -> f64 {
    if p <= 0.0 || p >= 1.0 {
        return if p > 0.5 { f64::INFINITY } else { f64::NEG_INFINITY };
    }
    Normal::standard().inverse_cdf(p)
}

/// The probability that a standard normal number exceeds `x`.
#[must_use]
pub fn normal_tail(x: f64) -> f64 {
    0.5 * erfc(x * std::f64::consts::FRAC_1_SQRT_2)
}

/// The value that a sum of so many squared standard normal numbers stays below with probability `p`; 0 for a sum of
/// none, infinite for p = 1.
#[must_use]
pub fn chi_square_quantile(p: f64, degrees_of_freedom: usize) -> f64 {
    let freedom = degrees_of_freedom as f64;
    match ChiSquared::new(freedom) {
        Ok(_) if p >= 1.0 => f64::INFINITY,
        Ok(distribution) => {
            // Chebyshev's inequality: the quantile is within √(2k/(1 − p)) of the mean. The crate's own search gives up
            // early for many degrees of freedom (0.18: 5e-4 off at 100,000).
            let (mut low, mut high) = (0.0, freedom + (2.0 * freedom / (1.0 - p)).sqrt());
            for _ in 0..HALVINGS {
                let middle = 0.5 * (low + high);
                if distribution.cdf(middle) < p { low = middle } else { high = middle }
            }
            0.5 * (low + high)
        }
        Err(_) => 0.0,
    }
}

/// The value that a ratio of two variances stays below with probability `p`, each the mean of so many squared normal
/// numbers of one size: Fisher's F. For infinitely many below the line it is that of chi-square over its freedom; 0
/// where there is no such distribution.
#[must_use]
pub fn fisher_quantile(p: f64, above: f64, below: f64) -> f64 {
    let Ok(distribution) = FisherSnedecor::new(above, below) else { return 0.0 };
    let mut high = 1.0;
    while distribution.cdf(high) < p && high < FISHER_MAX {
        high *= 2.0;
    }
    let mut low = 0.0;
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if distribution.cdf(middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// No ratio of variances is asked for beyond this.
const FISHER_MAX: f64 = 1e9;

/// Halvings of a bracket: to rounding.
const HALVINGS: usize = 60;

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables print so many digits.
    const PRINTED: f64 = 5e-4;

    #[test]
    fn data_have_a_middle_and_nothing_has_none() {
        assert_eq!(mean([[1.0, 2.0], [3.0, 6.0]].map(nalgebra::Vector2::from)), Some(nalgebra::Vector2::new(2.0, 4.0)));
        assert_eq!(median([3.0, 1.0, 2.0]), Some(2.0));
        assert_eq!(median([4.0, 1.0, 2.0, 3.0]), Some(2.5));
        assert_eq!((median([]), percentile([], 50)), (None, None));
        let hundred = || (0..100).rev().map(f64::from);
        let places = [0, 50, 95, 99, 100].map(|per_cent| percentile(hundred(), per_cent));
        assert_eq!(places, [0.0, 50.0, 95.0, 99.0, 99.0].map(Some));
    }

    #[test]
    fn normal_quantiles_are_those_of_the_tables() {
        for (p, z) in
            [(0.5, 0.0), (0.841_344_746_068_543, 1.0), (0.975, 1.959_963_984_540_054), (0.001, -3.090_232_306_167_814)]
        {
            assert!((normal_quantile(p) - z).abs() < 1e-8, "{p}: {}", normal_quantile(p));
            assert!((normal_tail(-z) - p).abs() < 1e-9, "{p}: {}", normal_tail(-z));
        }
        assert!(normal_quantile(1.0).is_infinite() && normal_quantile(0.0).is_infinite());
    }

    #[test]
    fn quantiles_of_a_ratio_of_variances_are_those_of_the_tables() {
        // Tables of F for 0.001: 10 and 20, 60 and 60, 20 and 120 degrees of freedom.
        for (above, below, value) in [(10.0, 20.0, 5.08), (60.0, 60.0, 2.25), (20.0, 120.0, 2.53)] {
            let found = fisher_quantile(0.999, above, below);
            assert!((found - value).abs() < 0.01, "{above}, {below}: {found}");
        }
        let many = fisher_quantile(0.999, 10.0, 1e7) * 10.0;
        assert!((many - 29.588).abs() < 0.01, "{many}");
    }

    #[test]
    fn chi_square_quantiles_are_those_of_the_tables() {
        // NIST/SEMATECH e-Handbook of Statistical Methods, §1.3.6.7.4, upper critical values for 0.001.
        for (freedom, value) in [(1, 10.828), (2, 13.816), (10, 29.588), (78, 122.348), (100, 149.449)] {
            let found = chi_square_quantile(0.999, freedom);
            assert!((found - value).abs() < PRINTED, "{freedom}: {found}");
        }
        // Two degrees of freedom are an exponential distribution.
        assert!((chi_square_quantile(0.5, 2) - 2.0 * std::f64::consts::LN_2).abs() < 1e-8);
        assert!(chi_square_quantile(0.9, 0) == 0.0 && chi_square_quantile(1.0, 3).is_infinite());
    }

    #[test]
    fn many_degrees_of_freedom_are_nearly_normal() {
        let freedom = 100_000.0_f64;
        let wilson_hilferty =
            freedom * (1.0 - 2.0 / (9.0 * freedom) + 3.090_232 * (2.0 / (9.0 * freedom)).sqrt()).powi(3);
        assert!((chi_square_quantile(0.999, 100_000) / wilson_hilferty - 1.0).abs() < 1e-6);
    }
}
