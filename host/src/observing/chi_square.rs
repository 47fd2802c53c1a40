//! Quantiles of the chi-square distribution.
//!
//! The distribution function is the regularised lower incomplete gamma function P(k/2, x/2): a series below its bulk and Lentz's
//! continued fraction above (Press et al., *Numerical Recipes*, 3rd ed., §6.2). The quantile is found by bisection.
//!
//! Errors: none. Accuracy: 1e-9 of the quantile.

/// Terms of series and fraction: far more than the square root of any count of data that they grow with.
const TERMS_MAX: usize = 100_000;

/// Relative size of a term that no longer counts.
const TERM_NONE: f64 = 1e-15;

/// Halvings of the bracket.
const HALVINGS: usize = 60;

/// The value that chi-square with this many degrees of freedom stays below with probability `p` in (0, 1); 0 for none.
pub(super) fn quantile(p: f64, degrees_of_freedom: usize) -> f64 {
    if degrees_of_freedom == 0 {
        return 0.0;
    }
    let k = super::clock::count(degrees_of_freedom);
    // Chebyshev's inequality: the quantile of 1 − q is within √(2k/q) of the mean.
    let (mut low, mut high) = (0.0, k + (2.0 * k / (1.0 - p)).sqrt());
    for _ in 0..HALVINGS {
        let middle = 0.5 * (low + high);
        if gamma_p(0.5 * k, 0.5 * middle) < p { low = middle } else { high = middle }
    }
    0.5 * (low + high)
}

/// Regularised lower incomplete gamma function.
fn gamma_p(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let scale = (a * x.ln() - x - ln_gamma(a)).exp();
    if x < a + 1.0 { scale * series(a, x) } else { 1.0 - scale * fraction(a, x) }
}

fn series(a: f64, x: f64) -> f64 {
    let (mut term, mut sum, mut n) = (1.0 / a, 1.0 / a, a);
    for _ in 0..TERMS_MAX {
        n += 1.0;
        term *= x / n;
        sum += term;
        if term < sum * TERM_NONE {
            break;
        }
    }
    sum
}

fn fraction(a: f64, x: f64) -> f64 {
    let mut b = x + 1.0 - a;
    let (mut c, mut d) = (1.0 / f64::MIN_POSITIVE, 1.0 / b);
    let mut value = d;
    for i in 1..TERMS_MAX {
        let i = super::clock::count(i);
        let an = -i * (i - a);
        b += 2.0;
        d = 1.0 / (an * d + b);
        c = b + an / c;
        value *= d * c;
        if (d * c - 1.0).abs() < TERM_NONE {
            break;
        }
    }
    value
}

/// ln Γ for halves and wholes from 1/2 on: by Stirling's series, after the recurrence up to where it is exact to rounding.
fn ln_gamma(mut a: f64) -> f64 {
    let mut product = 1.0;
    while a < 15.0 {
        product *= a;
        a += 1.0;
    }
    let inverse = 1.0 / (a * a);
    let series = (1.0 / 12.0 - inverse * (1.0 / 360.0 - inverse * (1.0 / 1260.0 - inverse / 1680.0))) / a;
    (a - 0.5) * a.ln() - a + 0.5 * (2.0 * std::f64::consts::PI).ln() + series - f64::ln(product)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tables print so many digits.
    const PRINTED: f64 = 5e-4;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // NIST/SEMATECH e-Handbook of Statistical Methods, §1.3.6.7.4, upper critical values for 0.001.
        for (k, value) in [(1, 10.828), (2, 13.816), (10, 29.588), (78, 122.348), (100, 149.449)] {
            assert!((quantile(0.999, k) - value).abs() < PRINTED, "{k}: {}", quantile(0.999, k));
        }
        // Two degrees of freedom are an exponential distribution.
        assert!((quantile(0.5, 2) - 2.0 * std::f64::consts::LN_2).abs() < 1e-9);
    }

    #[test]
    fn many_degrees_of_freedom_are_nearly_normal() {
        let k = 100_000.0_f64;
        let wilson_hilferty = k * (1.0 - 2.0 / (9.0 * k) + 3.090_232 * (2.0 / (9.0 * k)).sqrt()).powi(3);
        assert!((quantile(0.999, 100_000) / wilson_hilferty - 1.0).abs() < 1e-6);
    }
}
