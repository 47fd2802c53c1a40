//! Quantiles of the chi-square distribution.

/// Steps of bisection: each halves the interval, so these exhaust a double.
const BISECTIONS: usize = 200;

/// Terms of the series; for the degrees of freedom that readings have, far fewer are needed.
const TERMS_MAX: usize = 100_000;

/// The value that a chi-square variable with so many degrees of freedom stays below with this probability; 0 without any.
#[must_use]
pub fn chi_square_quantile(probability: f64, dof: usize) -> f64 {
    if dof == 0 {
        return 0.0;
    }
    let half_dof = f64::from(u32::try_from(dof).unwrap_or(u32::MAX)) / 2.0;
    let (mut low, mut high) = (0.0, 2.0 * half_dof + 10.0);
    while cumulative(half_dof, high / 2.0) < probability {
        high *= 2.0;
    }
    for _ in 0..BISECTIONS {
        let middle = f64::midpoint(low, high);
        if cumulative(half_dof, middle / 2.0) < probability { low = middle } else { high = middle }
    }
    f64::midpoint(low, high)
}

/// The regularized lower incomplete gamma function P(a, x) for a half-integer a: xᵃ e⁻ˣ / Γ(a + 1) · Σ xⁿ / ((a+1)…(a+n)).
fn cumulative(a: f64, x: f64) -> f64 {
    if x <= 0.0 {
        return 0.0;
    }
    let (mut term, mut sum) = (1.0, 1.0);
    for n in (1_u32..).take(TERMS_MAX) {
        term *= x / (a + f64::from(n));
        sum += term;
        if term < f64::EPSILON * sum {
            break;
        }
    }
    (a * x.ln() - x - ln_gamma_above(a)).exp() * sum
}

/// ln Γ(a + 1) for a half-integer a, by Γ(a + 1) = a Γ(a) from Γ(1) or Γ(1/2).
fn ln_gamma_above(a: f64) -> f64 {
    let (mut rest, mut sum) = (a, 0.0);
    while rest > 0.0 {
        sum += rest.ln();
        rest -= 1.0;
    }
    // What remains is Γ(1) = 1 or Γ(1/2) = √π.
    if rest < -0.25 { sum + std::f64::consts::PI.ln() / 2.0 } else { sum }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_the_tables() {
        // Abramowitz and Stegun, table 26.8.
        let table =
            [(0.99, 1, 6.6349), (0.99, 3, 11.3449), (0.99, 17, 33.4087), (0.5, 2, 1.386_29), (0.999, 4, 18.4668)];
        for (probability, dof, wanted) in table {
            let got = chi_square_quantile(probability, dof);
            assert!((got - wanted).abs() < 5e-4, "{probability} at {dof}: {got}, not {wanted}");
        }
        assert!(chi_square_quantile(0.99, 0).abs() < f64::MIN_POSITIVE);
    }
}
