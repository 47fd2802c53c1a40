//! Numbers that the dynamics is written for: `f64`, and numbers that carry derivatives along.
//!
//! Units and frames: those of the values. Errors: none.

use std::ops::{Add, Div, Mul, Neg, Sub};

use nalgebra::{Const, Matrix3, SMatrix, Vector2, Vector3};
use num_dual::{Derivative, DualNum, DualSVec64};

use super::support::{MeanSliding, SupportFriction, Twist};
use crate::math::Jet;

/// A number of the dynamics: [`f64`], a [`Jet`], or a dual vector of `num_dual`.
pub trait Scalar:
    Copy
    + From<f64>
    + Neg<Output = Self>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// The number without derivatives.
    fn re(&self) -> f64;
    /// Its square root.
    #[must_use]
    fn sqrt(&self) -> Self;
    /// Its sine and cosine, as an angle in rad.
    fn sin_cos(&self) -> (Self, Self);
    /// 1 over it.
    #[must_use]
    fn recip(&self) -> Self;
    /// [`SupportFriction::mean_sliding`] as (direction x, direction y, moment), for a twist (velocity x, y, omega).
    fn mean_sliding(support: &SupportFriction, twist: [Self; 3]) -> [Self; 3];
}

impl Scalar for f64 {
    #[inline]
    fn re(&self) -> f64 {
        *self
    }

    #[inline]
    fn sqrt(&self) -> f64 {
        f64::sqrt(*self)
    }

    #[inline]
    fn sin_cos(&self) -> (f64, f64) {
        f64::sin_cos(*self)
    }

    #[inline]
    fn recip(&self) -> f64 {
        f64::recip(*self)
    }

    #[inline]
    fn mean_sliding(support: &SupportFriction, [x, y, omega]: [f64; 3]) -> [f64; 3] {
        values(&support.mean_sliding(&Twist::new(Vector2::new(x, y), omega)))
    }
}

impl<const N: usize> Scalar for Jet<N> {
    #[inline]
    fn re(&self) -> f64 {
        self.value
    }

    #[inline]
    fn sqrt(&self) -> Self {
        let root = self.value.sqrt();
        self.chain(root, 0.5 / root)
    }

    #[inline]
    fn sin_cos(&self) -> (Self, Self) {
        let (sin, cos) = self.value.sin_cos();
        (self.chain(sin, cos), self.chain(cos, -sin))
    }

    #[inline]
    fn recip(&self) -> Self {
        let value = self.value.recip();
        self.chain(value, -value * value)
    }

    #[inline]
    fn mean_sliding(support: &SupportFriction, twist: [Self; 3]) -> [Self; 3] {
        let [x, y, omega] = twist.map(|component| component.value);
        let (sliding, gradient) = support.mean_sliding_and_gradient(&Twist::new(Vector2::new(x, y), omega));
        let values = values(&sliding);
        std::array::from_fn(|row| Self { value: values[row], slopes: row_of_chain(&gradient, row, &twist) })
    }
}

/// The chain rule: the friction's own gradient is in closed form.
#[inline]
fn row_of_chain<const N: usize>(gradient: &Matrix3<f64>, row: usize, twist: &[Jet<N>; 3]) -> [f64; N] {
    let [x, y, omega] = twist;
    let (a, b, c) = (gradient[(row, 0)], gradient[(row, 1)], gradient[(row, 2)]);
    std::array::from_fn(|i| a * x.slopes[i] + b * y.slopes[i] + c * omega.slopes[i])
}

impl<const N: usize> Scalar for DualSVec64<N> {
    fn re(&self) -> f64 {
        self.re
    }

    fn sqrt(&self) -> Self {
        DualNum::sqrt(self)
    }

    fn sin_cos(&self) -> (Self, Self) {
        DualNum::sin_cos(self)
    }

    fn recip(&self) -> Self {
        DualNum::recip(self)
    }

    fn mean_sliding(support: &SupportFriction, twist: [Self; 3]) -> [Self; 3] {
        let [x, y, omega] = twist.map(|component| component.re);
        let (sliding, gradient) = support.mean_sliding_and_gradient(&Twist::new(Vector2::new(x, y), omega));
        let values = Vector3::from(values(&sliding));
        let seeds: SMatrix<f64, N, 3> = SMatrix::from_columns(&twist.map(|part| part.eps.unwrap_generic(Const, Const)));
        let slopes = seeds * gradient.transpose();
        [0, 1, 2].map(|row| Self::new(values[row], Derivative::some(slopes.column(row).into_owned())))
    }
}

#[inline]
fn values(sliding: &MeanSliding) -> [f64; 3] {
    [sliding.direction.x, sliding.direction.y, sliding.moment]
}
