//! Numbers for verdicts that must not rest on rounding: twofold precision and power series.
//!
//! [`Twofold`] is an unevaluated sum of two `f64`, some 31 digits. A [`Jet`](super::Jet) carries first derivatives, a [`Series`]
//! the coefficients of a power series; both are made of any [`Arithmetic`], so a solution of a differential equation can be
//! expanded to high order, with its derivatives by the start, in either precision. What is 0 but for rounding then shrinks
//! by 16 digits, what is not stays.
//!
//! Implements: T. J. Dekker, *A floating-point technique for extending the available precision* (1971), with fused
//! multiply-add for products. Units: the caller's. Errors: none; what is divided by 0 is not finite.

use std::ops::{Add, Div, Mul, Neg, Sub};

use super::{Algebraic, Arithmetic};

/// A number as the sum of two: its nearest `f64`, and what is left.
///
/// ```
/// use palpate::math::{Arithmetic, twofold::Twofold};
///
/// // 1/3 of one and three of them are one, to 1e-32.
/// let third = Twofold::from(1.0) / Twofold::from(3.0);
/// let miss = third + third + third - Twofold::from(1.0);
/// assert!(miss.re().abs() < 1e-31);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twofold {
    high: f64,
    low: f64,
}

impl Twofold {
    /// A sum of two numbers, the first not smaller than the second.
    fn settled(high: f64, low: f64) -> Self {
        let sum = high + low;
        Self { high: sum, low: low - (sum - high) }
    }
}

impl From<f64> for Twofold {
    fn from(value: f64) -> Self {
        Self { high: value, low: 0.0 }
    }
}

impl Neg for Twofold {
    type Output = Self;

    fn neg(self) -> Self {
        Self { high: -self.high, low: -self.low }
    }
}

impl Add for Twofold {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        let sum = self.high + other.high;
        let part = sum - self.high;
        let lost = (self.high - (sum - part)) + (other.high - part);
        Self::settled(sum, lost + self.low + other.low)
    }
}

impl Sub for Twofold {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        self + -other
    }
}

impl Mul for Twofold {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        let product = self.high * other.high;
        let lost = self.high.mul_add(other.high, -product);
        Self::settled(product, self.high.mul_add(other.low, self.low.mul_add(other.high, lost)))
    }
}

impl Div for Twofold {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        let first = self.high / other.high;
        let left = self - other * Self::from(first);
        let second = left.high / other.high;
        let left = left - other * Self::from(second);
        Self::settled(first, second) + Self::from(left.high / other.high)
    }
}

impl Add<f64> for Twofold {
    type Output = Self;

    fn add(self, other: f64) -> Self {
        self + Self::from(other)
    }
}

impl Sub<f64> for Twofold {
    type Output = Self;

    fn sub(self, other: f64) -> Self {
        self - Self::from(other)
    }
}

impl Mul<f64> for Twofold {
    type Output = Self;

    fn mul(self, other: f64) -> Self {
        self * Self::from(other)
    }
}

impl Div<f64> for Twofold {
    type Output = Self;

    fn div(self, other: f64) -> Self {
        self / Self::from(other)
    }
}

impl Arithmetic for Twofold {
    fn sqrt(&self) -> Self {
        let first = self.high.sqrt();
        if first == 0.0 {
            return Self::from(0.0);
        }
        // One step of Newton's doubles the digits.
        let left = *self - Self::from(first) * Self::from(first);
        Self::settled(first, left.high / (2.0 * first))
    }

    fn re(&self) -> f64 {
        self.high
    }

    fn recip(&self) -> Self {
        Self::from(1.0) / *self
    }
}

/// The first `K` coefficients of a power series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Series<A, const K: usize>(pub [A; K]);

impl<A: Arithmetic, const K: usize> Series<A, K> {
    /// Coefficients in order, each from those before it.
    fn one_by_one(next: impl Fn(usize, &[A; K]) -> A) -> Self {
        let mut found = [A::from(0.0); K];
        for k in 0..K {
            found[k] = next(k, &found);
        }
        Self(found)
    }
}

/// Σ a(i) b(k − i) for i in a range.
fn products<A: Arithmetic, const K: usize>(a: &[A; K], b: &[A; K], k: usize, range: std::ops::Range<usize>) -> A {
    range.fold(A::from(0.0), |sum, i| sum + a[i] * b[k - i])
}

impl<A: Arithmetic, const K: usize> From<f64> for Series<A, K> {
    fn from(value: f64) -> Self {
        Self(std::array::from_fn(|k| A::from(if k == 0 { value } else { 0.0 })))
    }
}

impl<A: Arithmetic, const K: usize> Neg for Series<A, K> {
    type Output = Self;

    fn neg(self) -> Self {
        Self(self.0.map(Neg::neg))
    }
}

impl<A: Arithmetic, const K: usize> Add for Series<A, K> {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] + other.0[k]))
    }
}

impl<A: Arithmetic, const K: usize> Sub for Series<A, K> {
    type Output = Self;

    fn sub(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| self.0[k] - other.0[k]))
    }
}

impl<A: Arithmetic, const K: usize> Mul for Series<A, K> {
    type Output = Self;

    fn mul(self, other: Self) -> Self {
        Self(std::array::from_fn(|k| products(&self.0, &other.0, k, 0..k + 1)))
    }
}

impl<A: Arithmetic, const K: usize> Div for Series<A, K> {
    type Output = Self;

    fn div(self, other: Self) -> Self {
        Self::one_by_one(|k, found| (self.0[k] - products(found, &other.0, k, 0..k)) / other.0[0])
    }
}

impl<A: Algebraic, const K: usize> Add<f64> for Series<A, K> {
    type Output = Self;

    fn add(mut self, other: f64) -> Self {
        self.0[0] = self.0[0] + other;
        self
    }
}

impl<A: Algebraic, const K: usize> Sub<f64> for Series<A, K> {
    type Output = Self;

    fn sub(mut self, other: f64) -> Self {
        self.0[0] = self.0[0] - other;
        self
    }
}

impl<A: Algebraic, const K: usize> Mul<f64> for Series<A, K> {
    type Output = Self;

    fn mul(self, other: f64) -> Self {
        Self(self.0.map(|own| own * other))
    }
}

impl<A: Algebraic, const K: usize> Div<f64> for Series<A, K> {
    type Output = Self;

    fn div(self, other: f64) -> Self {
        Self(self.0.map(|own| own / other))
    }
}

impl<A: Arithmetic, const K: usize> Arithmetic for Series<A, K> {
    fn sqrt(&self) -> Self {
        let first = self.0[0].sqrt();
        Self::one_by_one(
            |k, found| {
                if k == 0 { first } else { (self.0[k] - products(found, found, k, 1..k)) / (first + first) }
            },
        )
    }

    fn re(&self) -> f64 {
        self.0[0].re()
    }

    fn recip(&self) -> Self {
        Self::from(1.0) / *self
    }
}

/// The solution of `ẋ = rates(x)` as power series of time. Each pass makes one more coefficient right.
#[must_use]
pub fn expanded<A: Arithmetic, const S: usize, const K: usize>(
    start: [A; S],
    rates: impl Fn(&[Series<A, K>; S]) -> [Series<A, K>; S],
) -> [Series<A, K>; S] {
    let mut states = start.map(|value| {
        let mut series = Series::from(0.0);
        series.0[0] = value;
        series
    });
    for k in 1..K {
        let rates = rates(&states);
        for (state, rate) in states.iter_mut().zip(rates) {
            state.0[k] = rate.0[k - 1] / A::from(k as f64);
        }
    }
    states
}

/// Of an elimination with full pivoting the pivots in turn, as shares of the first: as many as there are columns counted, 0
/// where nothing is left. Of `rows` the first `columns` entries count.
///
/// Rank is how many are not 0; which are, two precisions tell: what is 0 but for rounding differs between them by many
/// orders of magnitude.
#[must_use]
pub fn pivots<A: Arithmetic, const N: usize>(mut rows: Vec<[A; N]>, columns: usize) -> Vec<f64> {
    let mut left: Vec<usize> = (0..columns).collect();
    let mut found = Vec::new();
    for step in 0..columns {
        let places = (step..rows.len()).flat_map(|row| left.iter().map(move |&column| (row, column)));
        let size = |&(row, column): &(usize, usize)| rows[row][column].re().abs();
        let Some((row, column)) = places.max_by(|a, b| size(a).total_cmp(&size(b))) else { break };
        let pivot = size(&(row, column));
        if pivot == 0.0 {
            break;
        }
        found.push(pivot);
        rows.swap(step, row);
        left.retain(|&other| other != column);
        let pivot = rows[step];
        for row in &mut rows[step + 1..] {
            let factor = row[column] / pivot[column];
            for &other in &left {
                row[other] = row[other] - factor * pivot[other];
            }
        }
    }
    let first = found.first().copied().unwrap_or(1.0);
    found.resize(columns, 0.0);
    found.into_iter().map(|pivot| pivot / first).collect()
}

/// Below this share of the first a pivot in twofold precision is 0 but for rounding, which is at 1e-30; what shows in `f64`
/// at all is above 1e-14.
pub const PIVOT_NONE: f64 = 1e-22;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::math::Jet;

    /// Two ulps of 106 bits, relative.
    const ROUNDING: f64 = 1e-30;

    proptest! {
        #[test]
        fn twofold_numbers_undo_what_they_do(a in 0.1..10.0_f64, b in 0.1..10.0_f64, c in -1.0..1.0_f64) {
            let [a, b, c] = [a, b, c].map(Twofold::from);
            let third = Twofold::from(1.0) / Twofold::from(3.0);
            let number = a * third + c;
            for miss in [number / b * b - number, (number + b) - b - number, (a * third).sqrt() * (a * third).sqrt() - a * third] {
                prop_assert!(miss.re().abs() < 20.0 * ROUNDING, "{miss:?}");
            }
        }

        /// ẋ = x, ẏ = −y²: eᵗ x₀ and y₀/(1 + y₀ t), with their derivatives by the start.
        #[test]
        fn expansions_are_those_of_known_solutions(x in 0.5..2.0_f64, y in 0.5..1.5_f64) {
            type Number = Jet<2, Twofold>;
            let seed = |value: f64, place: usize| Number {
                value: Twofold::from(value),
                slopes: std::array::from_fn(|i| Twofold::from(if i == place { 1.0 } else { 0.0 })),
            };
            let [exponential, quotient] = expanded::<Number, 2, 9>([seed(x, 0), seed(y, 1)], |[x, y]| [*x, -(*y * *y)]);
            let mut factorial = 1.0;
            for k in 0..9 {
                factorial *= f64::max(k as f64, 1.0);
                let power = |exponent: i32| (-1.0_f64).powi(i32::try_from(k).unwrap()) * y.powi(exponent);
                let order = i32::try_from(k).unwrap();
                for (got, wanted) in [
                    (exponential.0[k].value, x / factorial),
                    (exponential.0[k].slopes[0], 1.0 / factorial),
                    (quotient.0[k].value, power(order + 1)),
                    (quotient.0[k].slopes[1], f64::from(order + 1) * power(order)),
                ] {
                    prop_assert!((got.re() - wanted).abs() < 1e-13 * (1.0 + wanted.abs()), "{k}: {got:?} {wanted}");
                }
                prop_assert!(exponential.0[k].slopes[1].re().abs() < f64::MIN_POSITIVE);
            }
        }

        #[test]
        fn roots_of_series_are_roots(a in 0.5..2.0_f64, b in -1.0..1.0_f64, c in -1.0..1.0_f64) {
            let series = Series([a, b, c, 0.3, -0.2, 0.1]);
            let again = series.sqrt() * series.sqrt() - series;
            prop_assert!(again.0.iter().all(|left| left.abs() < 1e-12), "{again:?}");
            let one = series / series - Series::from(1.0);
            prop_assert!(one.0.iter().all(|left| left.abs() < 1e-12), "{one:?}");
        }
    }
}
