//! Numbers that carry their derivatives by `N` variables in a plain array, which the compiler turns into vector instructions.
//!
//! The same as a dual vector of `num_dual`, without its option of having no derivatives, which costs a branch an operation.
//! Units: slopes in units of the number over those of the variable. Errors: none.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number with its derivatives.
///
/// ```
/// use palpate::math::Jet;
/// use palpate::pushing::dynamics::Scalar;
///
/// let [x, y] = [Jet::variable(3.0, 0), Jet::<2>::variable(4.0, 1)];
/// let distance = (x * x + y * y).sqrt();
/// assert!((distance.value - 5.0).abs() < 1e-15);
/// assert!((distance.slopes[0] - 0.6).abs() < 1e-15 && (distance.slopes[1] - 0.8).abs() < 1e-15);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet<const N: usize> {
    /// The number.
    pub value: f64,
    /// Its derivatives.
    pub slopes: [f64; N],
}

impl<const N: usize> Jet<N> {
    /// A number that depends on nothing.
    #[must_use]
    #[inline]
    pub fn constant(value: f64) -> Self {
        Self { value, slopes: [0.0; N] }
    }

    /// The variable of this index; beyond `N`, a constant.
    #[must_use]
    pub fn variable(value: f64, index: usize) -> Self {
        Self { value, slopes: std::array::from_fn(|i| if i == index { 1.0 } else { 0.0 }) }
    }

    /// The image under a function with this value and derivative here.
    #[must_use]
    #[inline]
    pub fn chain(self, value: f64, slope: f64) -> Self {
        Self { value, slopes: self.slopes.map(|own| own * slope) }
    }
}

/// Slopes `a·p + b·q`.
#[inline]
fn blend<const N: usize>(a: [f64; N], p: f64, b: [f64; N], q: f64) -> [f64; N] {
    let mut sum = a;
    for (sum, b) in sum.iter_mut().zip(b) {
        *sum = *sum * p + b * q;
    }
    sum
}

impl<const N: usize> From<f64> for Jet<N> {
    #[inline]
    fn from(value: f64) -> Self {
        Self::constant(value)
    }
}

impl<const N: usize> Neg for Jet<N> {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Add for Jet<N> {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        Self { value: self.value + other.value, slopes: blend(self.slopes, 1.0, other.slopes, 1.0) }
    }
}

impl<const N: usize> Sub for Jet<N> {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { value: self.value - other.value, slopes: blend(self.slopes, 1.0, other.slopes, -1.0) }
    }
}

impl<const N: usize> Mul for Jet<N> {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        let slopes = blend(self.slopes, other.value, other.slopes, self.value);
        Self { value: self.value * other.value, slopes }
    }
}

impl<const N: usize> Div for Jet<N> {
    type Output = Self;

    #[inline]
    fn div(self, other: Self) -> Self {
        let (value, reciprocal) = (self.value / other.value, 1.0 / other.value);
        Self { value, slopes: blend(self.slopes, reciprocal, other.slopes, -value * reciprocal) }
    }
}

impl<const N: usize> Add<f64> for Jet<N> {
    type Output = Self;

    #[inline]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, ..self }
    }
}

impl<const N: usize> Sub<f64> for Jet<N> {
    type Output = Self;

    #[inline]
    fn sub(self, other: f64) -> Self {
        Self { value: self.value - other, ..self }
    }
}

impl<const N: usize> Mul<f64> for Jet<N> {
    type Output = Self;

    #[inline]
    fn mul(self, other: f64) -> Self {
        self.chain(self.value * other, other)
    }
}

impl<const N: usize> Div<f64> for Jet<N> {
    type Output = Self;

    #[inline]
    fn div(self, other: f64) -> Self {
        self.chain(self.value / other, 1.0 / other)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Const;
    use num_dual::{Derivative, DualSVec64};
    use proptest::prelude::*;

    use super::*;
    use crate::pushing::dynamics::Scalar;

    /// Both carry derivatives exactly, but round in another order.
    const ROUNDING: f64 = 1e-12;

    /// Every operation there is.
    fn formula<T: Scalar>(x: T, y: T) -> T {
        let (sin, cos) = (x * y).sin_cos();
        let root = (x * x + y * y + 1.0).sqrt();
        (sin - cos / root) * 2.0 - (-x) / 3.0 + (y - 0.5).recip() * T::from(0.1)
    }

    proptest! {
        #[test]
        fn a_jet_is_a_dual_number(x in -2.0..2.0, y in -2.0..0.4) {
            let dual = |value, row| DualSVec64::<2>::new(value, Derivative::derivative_generic(Const, Const, row));
            let wanted = formula(dual(x, 0), dual(y, 1));
            let got = formula(Jet::<2>::variable(x, 0), Jet::variable(y, 1));
            prop_assert!((got.value - wanted.re).abs() < ROUNDING);
            let slopes = wanted.eps.unwrap_generic(Const, Const);
            let scale = 1.0 + slopes.amax();
            for i in 0..2 {
                prop_assert!((got.slopes[i] - slopes[i]).abs() < ROUNDING * scale, "{got:?} {wanted}");
            }
        }
    }
}
