//! Numbers that the dynamics is written for: `f64`, and dual numbers that carry derivatives along.
//!
//! Units and frames: those of the values. Errors: none.

use nalgebra::{Const, SMatrix, Vector2, Vector3};
use num_dual::{Derivative, DualNum, DualSVec64};

use super::support::{SupportFriction, Twist};

/// A number of the dynamics.
pub trait Scalar: DualNum<f64> + Copy {
    /// [`SupportFriction::mean_sliding`] as (direction x, direction y, moment), for a twist (velocity x, y, omega).
    fn mean_sliding(support: &SupportFriction, twist: [Self; 3]) -> [Self; 3];
}

impl Scalar for f64 {
    #[inline]
    fn mean_sliding(support: &SupportFriction, [x, y, omega]: [f64; 3]) -> [f64; 3] {
        let sliding = support.mean_sliding(&Twist::new(Vector2::new(x, y), omega));
        [sliding.direction.x, sliding.direction.y, sliding.moment]
    }
}

impl<const N: usize> Scalar for DualSVec64<N> {
    fn mean_sliding(support: &SupportFriction, twist: [Self; 3]) -> [Self; 3] {
        let [x, y, omega] = twist.map(|component| component.re);
        let (sliding, gradient) = support.mean_sliding_and_gradient(&Twist::new(Vector2::new(x, y), omega));
        let values = Vector3::new(sliding.direction.x, sliding.direction.y, sliding.moment);
        // The chain rule: the friction's own gradient is in closed form.
        let seeds: SMatrix<f64, N, 3> = SMatrix::from_columns(&twist.map(|part| part.eps.unwrap_generic(Const, Const)));
        let slopes = seeds * gradient.transpose();
        [0, 1, 2].map(|row| Self::new(values[row], Derivative::some(slopes.column(row).into_owned())))
    }
}
