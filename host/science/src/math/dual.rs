//! Numbers that formulas are written for: `f64`, and numbers that carry their derivatives along.
//!
//! A [`Jet`] has its derivatives by `N` variables in a plain array, which the compiler turns into vector instructions.
//! Its numbers may be jets themselves: `Jet<1, Jet<1>>` has second derivatives, and so on, which is how Lie derivatives
//! and the slope of a support function's Hessian are had. One family serves everything; a dual vector of the crate
//! `num-dual`, whose option of having no derivatives costs a branch an operation, took 1.6 times as long to carry three
//! derivatives of a push as a jet to carry four (11.8 and 7.3 times the yardstick of `cargo bench --bench push`). It
//! stays in the tests, as what jets are compared with.
//!
//! Implements: forward differentiation with dual numbers; the name is that of Ceres Solver.
//! Units: slopes in units of the number over those of the variable. Errors: none.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// What every number has: enough for rational functions and roots.
pub trait Arithmetic:
    Copy
    + Debug
    + PartialEq
    + 'static
    + From<f64>
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
{
    /// The number without derivatives, the nearest there is.
    fn re(&self) -> f64;
    /// Its square root, derivatives included.
    #[must_use]
    fn sqrt(&self) -> Self;
    /// 1 over it, derivatives included.
    #[must_use]
    fn recip(&self) -> Self;
}

/// A number that formulas of sums, products, quotients and roots are written for, with plain numbers in them.
pub trait Algebraic:
    Arithmetic + Add<f64, Output = Self> + Sub<f64, Output = Self> + Mul<f64, Output = Self> + Div<f64, Output = Self>
{
}

impl<T> Algebraic for T where
    T: Arithmetic + Add<f64, Output = T> + Sub<f64, Output = T> + Mul<f64, Output = T> + Div<f64, Output = T>
{
}

/// A number that formulas are written for.
pub trait Number: Algebraic + Sum {
    /// Its sine and cosine, as an angle in rad.
    fn sin_cos(&self) -> (Self, Self);
    /// Its power by a whole number.
    #[must_use]
    fn powi(&self, exponent: i32) -> Self;
}

impl Arithmetic for f64 {
    #[inline]
    fn re(&self) -> f64 {
        *self
    }

    #[inline]
    fn sqrt(&self) -> f64 {
        f64::sqrt(*self)
    }

    #[inline]
    fn recip(&self) -> f64 {
        f64::recip(*self)
    }
}

impl Number for f64 {
    #[inline]
    fn sin_cos(&self) -> (f64, f64) {
        f64::sin_cos(*self)
    }

    #[inline]
    fn powi(&self, exponent: i32) -> f64 {
        f64::powi(*self, exponent)
    }
}

/// A number with its derivatives.
///
/// ```
/// use palpate::math::{Arithmetic, Jet};
///
/// let [x, y] = [Jet::variable(3.0, 0), Jet::<2>::variable(4.0, 1)];
/// let distance = (x * x + y * y).sqrt();
/// assert!((distance.value - 5.0).abs() < 1e-15);
/// assert!((distance.slopes[0] - 0.6).abs() < 1e-15 && (distance.slopes[1] - 0.8).abs() < 1e-15);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Jet<const N: usize, T = f64> {
    /// The number itself.
    pub value: T,
    /// Its derivatives by the N parameters.
    pub slopes: [T; N],
}

impl<const N: usize, T: Arithmetic> Jet<N, T> {
    /// A number that depends on nothing.
    #[must_use]
    #[inline]
    pub fn constant(value: T) -> Self {
        Self { value, slopes: [T::from(0.0); N] }
    }

    /// The variable of this index; beyond `N`, a constant.
    #[must_use]
    pub fn variable(value: T, index: usize) -> Self {
        Self { value, slopes: std::array::from_fn(|i| T::from(if i == index { 1.0 } else { 0.0 })) }
    }

    /// The image under a function with this value and derivative here.
    #[must_use]
    #[inline]
    pub fn chain(self, value: T, slope: T) -> Self {
        Self { value, slopes: self.slopes.map(|own| own * slope) }
    }
}

/// Slopes `a·p + b·q`.
#[inline]
fn blend<const N: usize, T: Arithmetic>(a: [T; N], p: T, b: [T; N], q: T) -> [T; N] {
    let mut sum = a;
    for (sum, b) in sum.iter_mut().zip(b) {
        *sum = *sum * p + b * q;
    }
    sum
}

impl<const N: usize, T: Arithmetic> Arithmetic for Jet<N, T> {
    #[inline]
    fn re(&self) -> f64 {
        self.value.re()
    }

    #[inline]
    fn sqrt(&self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, T::from(0.5) / root)
    }

    #[inline]
    fn recip(&self) -> Self {
        let value = self.value.recip();
        self.chain(value, -value * value)
    }
}

impl<const N: usize, T: Number> Number for Jet<N, T> {
    #[inline]
    fn sin_cos(&self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }

    #[inline]
    fn powi(&self, exponent: i32) -> Self {
        self.chain(self.value.powi(exponent), self.value.powi(exponent - 1) * f64::from(exponent))
    }
}

impl<const N: usize, T: Arithmetic> From<f64> for Jet<N, T> {
    #[inline]
    fn from(value: f64) -> Self {
        Self::constant(T::from(value))
    }
}

impl<const N: usize, T: Arithmetic> Neg for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn neg(self) -> Self {
        Self { value: -self.value, slopes: self.slopes.map(|slope| -slope) }
    }
}

impl<const N: usize, T: Arithmetic> Add for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn add(self, other: Self) -> Self {
        let mut slopes = self.slopes;
        slopes.iter_mut().zip(other.slopes).for_each(|(slope, other)| *slope = *slope + other);
        Self { value: self.value + other.value, slopes }
    }
}

impl<const N: usize, T: Arithmetic> Sub for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn sub(self, other: Self) -> Self {
        let mut slopes = self.slopes;
        slopes.iter_mut().zip(other.slopes).for_each(|(slope, other)| *slope = *slope - other);
        Self { value: self.value - other.value, slopes }
    }
}

impl<const N: usize, T: Arithmetic> Mul for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn mul(self, other: Self) -> Self {
        let slopes = blend(self.slopes, other.value, other.slopes, self.value);
        Self { value: self.value * other.value, slopes }
    }
}

impl<const N: usize, T: Arithmetic> Div for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn div(self, other: Self) -> Self {
        let (value, reciprocal) = (self.value / other.value, other.value.recip());
        Self { value, slopes: blend(self.slopes, reciprocal, other.slopes, -value * reciprocal) }
    }
}

impl<const N: usize, T: Algebraic> Add<f64> for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn add(self, other: f64) -> Self {
        Self { value: self.value + other, ..self }
    }
}

impl<const N: usize, T: Algebraic> Sub<f64> for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn sub(self, other: f64) -> Self {
        Self { value: self.value - other, ..self }
    }
}

impl<const N: usize, T: Algebraic> Mul<f64> for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn mul(self, other: f64) -> Self {
        Self { value: self.value * other, slopes: self.slopes.map(|slope| slope * other) }
    }
}

impl<const N: usize, T: Algebraic> Div<f64> for Jet<N, T> {
    type Output = Self;

    #[inline]
    fn div(self, other: f64) -> Self {
        let reciprocal = 1.0 / other;
        Self { value: self.value / other, slopes: self.slopes.map(|slope| slope * reciprocal) }
    }
}

impl<const N: usize, T: Number> Sum for Jet<N, T> {
    fn sum<I: Iterator<Item = Self>>(numbers: I) -> Self {
        numbers.fold(Self::from(0.0), |sum, number| sum + number)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Const;
    use num_dual::{Derivative, DualNum, DualSVec64, HyperHyperDual64};
    use proptest::prelude::*;

    use super::*;

    /// All carry derivatives exactly, but round in another order.
    const ROUNDING: f64 = 1e-12;

    /// Every operation there is.
    fn formula<T: Number>(x: T, y: T) -> T {
        let (sin, cos) = (x * y).sin_cos();
        let root = (x * x + y * y + 1.0).sqrt();
        [(sin - cos / root) * 2.0, (-x) / 3.0 * -1.0, (y - 0.5).recip() * T::from(0.1), x.powi(3)].into_iter().sum()
    }

    /// The same with numbers of `num-dual`.
    fn wanted<T: DualNum<f64> + Copy>(x: T, y: T) -> T {
        let (sin, cos) = (x * y).sin_cos();
        let root = (x * x + y * y + 1.0).sqrt();
        (sin - cos / root) * 2.0 - (-x) / 3.0 + (y - 0.5).recip() * 0.1 + x.powi(3)
    }

    proptest! {
        #[test]
        fn a_jet_is_a_dual_number(x in -2.0..2.0, y in -2.0..0.4) {
            let dual = |value, row| DualSVec64::<2>::new(value, Derivative::derivative_generic(Const, Const, row));
            let wanted = wanted(dual(x, 0), dual(y, 1));
            let got = formula(Jet::<2>::variable(x, 0), Jet::variable(y, 1));
            prop_assert!((got.value - wanted.re).abs() < ROUNDING);
            let slopes = wanted.eps.unwrap_generic(Const, Const);
            let scale = 1.0 + slopes.amax();
            for i in 0..2 {
                prop_assert!((got.slopes[i] - slopes[i]).abs() < ROUNDING * scale, "{got:?} {wanted}");
            }
        }

        #[test]
        fn a_jet_of_jets_has_higher_derivatives(x in -2.0..2.0, y in -2.0..0.4) {
            let third = |value, along: [f64; 3]| {
                HyperHyperDual64::new(value, along[0], along[1], along[2], 0.0, 0.0, 0.0, 0.0)
            };
            let wanted = wanted(third(x, [1.0, 0.0, 1.0]), third(y, [0.0, 1.0, 1.0]));
            let nested = |value: f64, [a, b, c]: [f64; 3]| {
                let first = Jet { value, slopes: [a] };
                let second = Jet { value: first, slopes: [Jet::from(b)] };
                Jet { value: second, slopes: [Jet::from(c)] }
            };
            let got: Jet<1, Jet<1, Jet<1>>> = formula(nested(x, [1.0, 0.0, 1.0]), nested(y, [0.0, 1.0, 1.0]));
            let [by_c] = got.slopes;
            let pairs = [
                (got.value.value.slopes[0], wanted.eps1),
                (got.value.slopes[0].value, wanted.eps2),
                (by_c.value.value, wanted.eps3),
                (got.value.slopes[0].slopes[0], wanted.eps1eps2),
                (by_c.slopes[0].slopes[0], wanted.eps1eps2eps3),
            ];
            // The pole at y = 0.5 multiplies rounding by up to 10⁴ in the third derivative.
            let scale = pairs.iter().map(|(_, wanted)| wanted.abs()).fold(1.0, f64::max);
            for (got, wanted) in pairs {
                prop_assert!((got - wanted).abs() < 10.0 * ROUNDING * scale, "{got} {wanted}");
            }
        }
    }
}
