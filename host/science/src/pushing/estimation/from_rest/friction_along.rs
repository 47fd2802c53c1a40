//! A friction of the contact that wanders along an edge.
//!
//! Its logarithm is a cubic spline, of which each coefficient is a number of its own: what wanders is alike from place to
//! place, the more the nearer they are. That it is the same everywhere on an edge but for those is what an estimate takes for
//! granted.
//!
//! It is told from where the contact began, wherever that is: no place of an edge is likelier than another to be rough or
//! smooth, and a contact that may have begun elsewhere then meets the same friction on its way.
//!
//! Units: m along the edge from where the contact began; logarithms. Errors: none.

/// From knot to knot, m. Places so far apart differ with a correlation of a half, twice as far with one of 0.05: a sine of
/// 10 mm is met to a hundredth of its height, and what a smear or the grain of a cut face changes more quickly is not.
const KNOTS_APART_M: f64 = 2.5e-3;

/// Most knots to each side: of longer edges they are further apart.
const KNOTS_MAX: f64 = 20.0;

/// A spline of coefficients with the standard deviation 1 has this root mean square.
const SPLINE_RMS: f64 = 0.69;

/// By what µ_c at a place differs from that of a guess; the default is nowhere.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct FrictionAlong {
    /// The place of the first coefficient.
    from: f64,
    apart: f64,
    /// ln of the factor is the spline of these.
    coefficients: Vec<f64>,
}

/// How far a coefficient counts, in knots.
const REACH: f64 = 2.0;

impl FrictionAlong {
    /// Knots as far to each side as an edge is long (m), at none of which it differs.
    pub(super) fn constant(length: f64) -> Self {
        let stretches = (length / KNOTS_APART_M).ceil().clamp(1.0, KNOTS_MAX);
        let apart = length / stretches;
        // One more beyond each end, of the spline's last piece.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 1 and 20")]
        let count = 2 * stretches as usize + 3;
        Self { from: -length - apart, apart, coefficients: vec![0.0; count] }
    }

    /// Coefficients.
    pub(super) fn count(&self) -> usize {
        self.coefficients.len()
    }

    /// The same with other coefficients, for numbers of the standard deviation that the logarithm shall have.
    pub(super) fn with_numbers(&self, numbers: impl Iterator<Item = f64>) -> Self {
        Self { coefficients: numbers.map(|number| number / SPLINE_RMS).collect(), ..*self }
    }

    /// Whether it is the same everywhere.
    pub(super) fn is_constant(&self) -> bool {
        self.coefficients.iter().all(|coefficient| *coefficient == 0.0)
    }

    /// Whether it differs from another where a contact was, in m from where it began.
    #[expect(clippy::float_cmp, reason = "what was not moved is the same to the bit")]
    pub(super) fn differs_within(&self, other: &Self, [low, high]: [f64; 2]) -> bool {
        let both = self.coefficients.iter().zip(&other.coefficients);
        both.enumerate()
            .filter(|(_, (coefficient, other))| coefficient != other)
            .map(|(knot, _)| self.from + self.apart * knot as f64)
            .any(|at| low - at < REACH * self.apart && at - high < REACH * self.apart)
    }

    /// µ_c so far from where the contact began, over that of the guess; beyond the ends that at the nearest.
    pub(super) fn factor(&self, s: f64) -> f64 {
        let (Some(last), true) = (self.coefficients.len().checked_sub(2), self.apart > 0.0) else { return 1.0 };
        let place = ((s - self.from) / self.apart).clamp(1.0, last as f64);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the knots")]
        let before = (place.floor() as usize).min(last - 1);
        let t = place - before as f64;
        let far = |t: f64| t * t * t / 6.0;
        let near = |t: f64| (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0;
        let weights = [far(1.0 - t), near(t), near(1.0 - t), far(t)];
        let coefficients = &self.coefficients[before - 1..];
        weights.iter().zip(coefficients).map(|(weight, coefficient)| weight * coefficient).sum::<f64>().exp()
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use proptest::prelude::*;

    use super::*;
    use crate::math::random::Draw;

    /// An edge, m.
    const LENGTH: f64 = 0.04;

    fn drawn(seed: usize) -> FrictionAlong {
        let (along, mut draw) = (FrictionAlong::constant(LENGTH), Draw::case(5, seed));
        along.with_numbers((0..along.count()).map(|_| draw.normal()))
    }

    proptest! {
        /// It bends without a jump, and where no coefficient differs, nothing does.
        #[test]
        fn a_friction_is_smooth_and_differs_where_it_says(
            seed in 0..1000_usize, number in 0..35_usize, at in -0.99 * LENGTH..0.99 * LENGTH
        ) {
            let along = drawn(seed);
            let log = |s: f64| along.factor(s).ln();
            let h = 1e-5;
            let bend = |s: f64| (log(s + h) + log(s - h) - 2.0 * log(s)) / (h * h);
            // A coefficient's largest third derivative is 3/h³, and four count.
            let most = 4.0 * 3.0 * 5.0 / SPLINE_RMS / along.apart.powi(3);
            prop_assert!((bend(at + 2.0 * h) - bend(at)).abs() < most * 3.0 * h + 1e-12 / (h * h), "{} {}", bend(at), at);
            let mut other = along.clone();
            other.coefficients[number % along.count()] += 1.0;
            let differs = (other.factor(at) / along.factor(at) - 1.0).abs() > 1e-12;
            prop_assert!(!differs || along.differs_within(&other, [at, at]));
        }
    }

    #[test]
    fn numbers_are_the_standard_deviation_of_the_logarithm() {
        let count = 4000;
        let squares = |s: f64| (0..count).map(|seed| drawn(seed).factor(s).ln().powi(2)).sum::<f64>() / count as f64;
        let over_a_stretch = (0..8).map(|i| squares(0.01 + 0.125 * KNOTS_APART_M * f64::from(i))).sum::<f64>() / 8.0;
        // Sampled with a standard deviation of a forty-fifth at each place.
        assert!((over_a_stretch - 1.0).abs() < 0.06, "{over_a_stretch}");
    }

    /// Against the correlations that are told of knots.
    #[test]
    fn places_far_apart_have_frictions_of_their_own() {
        let count = 4000;
        let correlation = |apart: f64| {
            let both = (0..count).map(drawn).map(|along| along.factor(0.0).ln() * along.factor(apart).ln());
            both.sum::<f64>() / count as f64
        };
        let [near, far, beyond] = [1.0, 2.0, 4.0].map(|knots| correlation(knots * KNOTS_APART_M));
        assert!((near - 0.5).abs() < 0.08 && (far - 0.05).abs() < 0.06 && beyond.abs() < 0.06, "{near} {far} {beyond}");
    }

    /// A sine of the shortest wave that is told, through its own values at the knots.
    #[test]
    fn a_sine_is_met_nearly() {
        let (along, wave) = (FrictionAlong::constant(LENGTH), 0.01);
        let sine = |s: f64| 0.3 * (TAU * s / wave).sin();
        // What a spline makes of a sine's values at its knots is lower by this.
        let lower = (2.0 + (TAU * along.apart / wave).cos()) / 3.0;
        let knots = (0..along.count()).map(|knot| sine(along.from + along.apart * knot as f64));
        let along = along.with_numbers(knots.map(|at| at / lower * SPLINE_RMS));
        let off = (0..200).map(|i| 1e-4 * f64::from(i)).map(|s| (along.factor(s).ln() - sine(s)).abs());
        assert!(off.fold(0.0, f64::max) < 0.03 * 0.3);
    }
}
