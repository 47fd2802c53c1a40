//! Poses that a part may have, each as likely as the others, and how a cloud of them is kept alive.
//!
//! Frames: world. Units: SI.

use std::f64::consts::TAU;

use super::constants::FilterSettings;
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;

/// Poses of the centre of mass, all of one weight.
#[derive(Clone, Debug, PartialEq)]
pub struct Cloud {
    /// At least one.
    pub poses: Vec<Pose>,
}

/// A kernel: normal, with a share that is wider.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Kernel {
    /// Standard deviation of a place along each axis, m.
    pub place: f64,
    /// Standard deviation of the angle, rad.
    pub angle: f64,
    /// Share that is wider.
    pub tail_share: f64,
    /// How many times as wide.
    pub tail_width: f64,
}

impl Kernel {
    /// That of these settings.
    #[must_use]
    pub fn of(settings: &FilterSettings) -> Self {
        Self {
            place: settings.kernel,
            angle: settings.kernel_angle,
            tail_share: settings.tail_share,
            tail_width: settings.tail_width,
        }
    }

    /// A pose drawn about another.
    pub(super) fn drawn(&self, about: &Pose, draw: &mut Draw) -> Pose {
        let width = if draw.chance(self.tail_share) { self.tail_width } else { 1.0 };
        Pose {
            x: about.x + width * self.place * draw.normal(),
            y: about.y + width * self.place * draw.normal(),
            theta: about.theta + width * self.angle * draw.normal(),
        }
    }

    /// Its density at a pose that is off by so much, per m² rad.
    pub(super) fn density(&self, off: [f64; 3]) -> f64 {
        let [x, y, theta] = off;
        let square = (x * x + y * y) / (self.place * self.place) + (theta / self.angle).powi(2);
        let peak = 1.0 / (TAU.powf(1.5) * self.place * self.place * self.angle);
        let wide = self.tail_width * self.tail_width;
        peak * ((1.0 - self.tail_share) * (-0.5 * square).exp()
            + self.tail_share * (-0.5 * square / wide).exp() / (wide * self.tail_width))
    }
}

impl Cloud {
    /// The middle pose: medians of the places and of the angles about the mean direction, which is right for one heap.
    #[must_use]
    pub fn median(&self) -> Pose {
        middle(&self.poses)
    }
}

/// Medians of places, and of angles about the mean direction.
pub(super) fn middle(poses: &[Pose]) -> Pose {
    let (sin, cos) = poses.iter().fold((0.0, 0.0), |(s, c), pose| (s + pose.theta.sin(), c + pose.theta.cos()));
    let about = sin.atan2(cos);
    let median = |value: &dyn Fn(&Pose) -> f64| crate::math::statistics::median(poses.iter().map(value)).unwrap_or(0.0);
    let theta = about + median(&|pose| wrap_angle(pose.theta - about));
    Pose { x: median(&|pose| pose.x), y: median(&|pose| pose.y), theta: wrap_angle(theta) }
}

/// Numbers of `count` of those with these weights, each as often as its weight says (systematic resampling: one random
/// number, and no more chance than that); all alike if no weight is above 0.
pub(super) fn resampled(weights: &[f64], count: usize, draw: &mut Draw) -> Vec<usize> {
    let sum: f64 = weights.iter().sum();
    // Written so that NaN counts as none.
    if !(sum > 0.0 && sum.is_finite()) {
        return (0..count).map(|i| i * weights.len() / count).collect();
    }
    let step = sum / count as f64;
    let mut goal = step * draw.unit();
    let mut reached = 0.0;
    let mut taken = Vec::with_capacity(count);
    for (number, weight) in weights.iter().enumerate() {
        reached += weight;
        while goal < reached && taken.len() < count {
            taken.push(number);
            goal += step;
        }
    }
    // Rounding may leave the last one out.
    let last = weights.iter().rposition(|weight| *weight > 0.0).unwrap_or(0);
    taken.resize(count, last);
    taken
}

/// How many equally weighted ones these are worth (Kish).
pub(super) fn effective_number(weights: &[f64]) -> f64 {
    let (sum, squares) = weights.iter().fold((0.0, 0.0), |(sum, squares), w| (sum + w, squares + w * w));
    if squares > 0.0 { sum * sum / squares } else { 0.0 }
}
