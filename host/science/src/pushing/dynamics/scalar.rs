//! Numbers that the dynamics is written for: those that support friction can be computed of.
//!
//! Units and frames: those of the values. Errors: none.

use nalgebra::{Matrix3, Vector2};

use super::support::{MeanSliding, SupportFriction, Twist};
use crate::math::{Jet, Number};

/// A number of the dynamics: [`f64`], or a [`Jet`], whose derivatives support friction has in closed form.
pub trait Scalar: Number {
    /// [`SupportFriction::mean_sliding`] as (direction x, direction y, moment), for a twist (velocity x, y, omega).
    fn mean_sliding(support: &SupportFriction, twist: [Self; 3]) -> [Self; 3];
}

impl Scalar for f64 {
    #[inline]
    fn mean_sliding(support: &SupportFriction, [x, y, omega]: [f64; 3]) -> [f64; 3] {
        values(&support.mean_sliding(&Twist::new(Vector2::new(x, y), omega)))
    }
}

impl<const N: usize> Scalar for Jet<N> {
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

#[inline]
fn values(sliding: &MeanSliding) -> [f64; 3] {
    [sliding.direction.x, sliding.direction.y, sliding.moment]
}
