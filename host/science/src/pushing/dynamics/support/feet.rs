//! Support on a few points.
//!
//! Frames: the support's own. Units: SI. Errors: none.

use nalgebra::{Point2, Vector2};

use super::{MeanSliding, SlidingGradient, Twist, turn_left};

/// Points and the share of the weight on each.
#[derive(Clone, Debug)]
pub(super) struct Feet(Vec<Foot>);

#[derive(Clone, Copy, Debug)]
struct Foot {
    at: Vector2<f64>,
    share: f64,
}

impl Feet {
    pub(super) fn new(feet: &[(Point2<f64>, f64)]) -> Self {
        Self(feet.iter().map(|&(at, share)| Foot { at: at.coords, share }).collect())
    }

    pub(super) fn centre_of_pressure(&self) -> Vector2<f64> {
        let weight: f64 = self.0.iter().map(|foot| foot.share).sum();
        let moment: Vector2<f64> = self.0.iter().map(|foot| foot.share * foot.at).sum();
        if weight == 0.0 { Vector2::zeros() } else { moment / weight }
    }

    pub(super) fn mean_sliding(&self, twist: &Twist) -> MeanSliding {
        let mut sum = MeanSliding::NONE;
        for foot in &self.0 {
            if let Some(direction) = twist.velocity_at(foot.at).try_normalize(0.0) {
                sum.direction += foot.share * direction;
                sum.moment += foot.share * foot.at.perp(&direction);
            }
        }
        sum
    }

    /// With `n` across the direction in which a foot slides at speed `v`, its part of the gradient is `w wᵀ/v`, where
    /// `w = (n, p × n)`.
    pub(super) fn mean_sliding_and_gradient(&self, twist: &Twist) -> (MeanSliding, SlidingGradient) {
        let mut gradient = SlidingGradient::default();
        for foot in &self.0 {
            let velocity = twist.velocity_at(foot.at);
            let speed = velocity.norm();
            if speed > 0.0 {
                let across = turn_left(velocity / speed);
                gradient.add_outer(across, foot.at.perp(&across), foot.share / speed);
            }
        }
        (self.mean_sliding(twist), gradient)
    }
}
