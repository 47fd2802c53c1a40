//! How much noise a force signal has, counted honestly.
//!
//! Strain gauges hum at the mains frequency and drift, so readings are correlated and the mean of N of them does not
//! have the variance `σ²/N`. What a mean of N readings really varies by is therefore measured, from means of N
//! readings; `σ/√N` is nowhere assumed.
//!
//! Errors: none; too few values give `None`.

use nalgebra::{Matrix2, Vector2};

use crate::math::statistics::mean;

/// Covariance, and how many independent values it is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scatter {
    /// The covariance, finger axes, force units squared.
    pub covariance: Matrix2<f64>,
    /// Degrees of freedom that it was estimated with.
    pub freedom: f64,
}

/// Covariance of single values about their mean; `None` of fewer than two.
#[must_use]
pub fn of_values(values: &[Vector2<f64>]) -> Option<Scatter> {
    of_window_mean(values, 1)
}

/// Covariance of the mean of `samples` consecutive values, whatever their correlation: from all overlapping windows.
///
/// The windows' scatter about the mean of all values misses the part `samples/n` of the variance, which is put back.
/// `None` if fewer than two windows fit side by side.
#[must_use]
pub fn of_window_mean(values: &[Vector2<f64>], samples: usize) -> Option<Scatter> {
    let n = values.len();
    if samples == 0 || n < 2 * samples {
        return None;
    }
    let centre: Vector2<f64> = mean(values)?;
    let mut sum: Vector2<f64> = values[..samples].iter().map(|value| value - centre).sum();
    let mut total = Matrix2::zeros();
    for start in 0..=n - samples {
        if start > 0 {
            sum += values[start + samples - 1] - values[start - 1];
        }
        let deviation = sum / samples as f64;
        total += deviation * deviation.transpose();
    }
    let windows = (n - samples + 1) as f64;
    let independent = n as f64 / samples as f64;
    Some(Scatter { covariance: total / windows / (1.0 - 1.0 / independent), freedom: independent - 1.0 })
}

/// Means of `blocks` blocks of equal length (the remainder goes to the last block).
#[must_use]
pub fn block_means(values: &[Vector2<f64>], blocks: usize) -> Vec<Vector2<f64>> {
    let length = values.len() / blocks.max(1);
    (0..blocks)
        .map(|block| {
            let end = if block + 1 == blocks { values.len() } else { (block + 1) * length };
            mean(&values[block * length..end]).unwrap_or_default()
        })
        .collect()
}

/// Size of `value` in standard deviations: `√(vᵀ C⁻¹ v)`. Infinite where `C` has no inverse, unless `v` is zero.
#[must_use]
pub fn mahalanobis(value: &Vector2<f64>, covariance: &Matrix2<f64>) -> f64 {
    match covariance.try_inverse() {
        Some(inverse) => value.dot(&(inverse * value)).max(0.0).sqrt(),
        None if *value == Vector2::zeros() => 0.0,
        None => f64::INFINITY,
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_noise::Noise;
    use super::*;

    const SIGMA: f64 = 0.01;
    const RATE_HZ: f64 = 4000.0;

    fn sd(scatter: Option<Scatter>) -> f64 {
        (0.5 * scatter.unwrap().covariance.trace()).sqrt()
    }

    #[test]
    fn white_noise_averages_as_the_square_root() {
        let values = Noise::white(3, SIGMA).take(40_000);
        // 500 independent windows: the standard deviation is known to 1/√(2·2·500) = 2.2 %; four of those.
        for samples in [1, 4, 80] {
            let ratio = sd(of_window_mean(&values, samples)) * (samples as f64).sqrt() / SIGMA;
            assert!((ratio - 1.0).abs() < 0.09, "{samples} samples: {ratio}");
        }
    }

    #[test]
    fn few_windows_do_not_make_the_noise_look_smaller() {
        let variance = |seed| of_window_mean(&Noise::white(seed, SIGMA).take(40), 10).unwrap().covariance.trace() / 2.0;
        let mean = (0..2000).map(variance).sum::<f64>() / 2000.0;
        // Four windows' worth of scatter misses a quarter of the variance, unless put back. Each estimate is good to
        // about 60 %, the mean of 2000 to 1.3 %: four of those.
        let ratio = mean / (SIGMA * SIGMA / 10.0);
        assert!((ratio - 1.0).abs() < 0.06, "{ratio}");
    }

    #[test]
    fn hum_does_not_average_away_in_half_a_period_and_does_in_a_whole_one() {
        let values = Noise { hum: 0.03, ..Noise::white(5, SIGMA) }.sampled(RATE_HZ).take(40_000);
        let blind = |samples: f64| sd(of_values(&values)) / samples.sqrt();
        let half = sd(of_window_mean(&values, 40));
        let whole = sd(of_window_mean(&values, 80));
        // Mean of half a period of a sine of amplitude a varies by a·(2/π)/√2: here 13.5 mN.
        assert!((half / 0.0135 - 1.0).abs() < 0.05, "half a period: {half}");
        assert!(half > 3.0 * blind(40.0), "σ/√N would have claimed {}", blind(40.0));
        assert!((whole / (SIGMA / 80_f64.sqrt()) - 1.0).abs() < 0.12, "whole period: {whole}");
    }

    #[test]
    fn correlated_axes_and_no_covariance_at_all_have_a_norm() {
        let covariance = Matrix2::new(4.0, 0.0, 0.0, 1.0);
        let norm = mahalanobis(&Vector2::new(2.0, 1.0), &covariance);
        assert!((norm - 2_f64.sqrt()).abs() < 1e-12);
        assert!(mahalanobis(&Vector2::new(1.0, 0.0), &Matrix2::zeros()).is_infinite());
        assert!(mahalanobis(&Vector2::zeros(), &Matrix2::zeros()) < f64::MIN_POSITIVE);
    }
}
