//! Poses that a part may have, each as likely as the others, and how a cloud of them is kept alive.
//!
//! Frames: world. Units: SI.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::constants::FilterSettings;
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;
use crate::math::statistics::mean;

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

    /// The same, so many times as wide.
    pub(super) fn widened(&self, factor: f64) -> Self {
        Self { place: factor * self.place, angle: factor * self.angle, ..*self }
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
        // Most poses of a cloud are far from most others, and exponentials are what a density takes.
        let bell = |square: f64| if square < FAR_SQUARE { (-0.5 * square).exp() } else { 0.0 };
        peak * ((1.0 - self.tail_share) * bell(square)
            + self.tail_share * bell(square / wide) / (wide * self.tail_width))
    }
}

/// Squared distance, in standard deviations, from which a kernel counts as 0: a sum of thousands then lacks less than
/// rounding takes from one that is near.
const FAR_SQUARE: f64 = 90.0;

/// Poses within this of each other along the plane, m, and in angle, rad, are of one heap: what a chain of pushes leaves
/// of a part is within.
const HEAP: [f64; 2] = [10e-3, 10.0 * std::f64::consts::PI / 180.0];

/// Of so many poses the one that has most near it is sought.
const SEEN: usize = 250;

/// Poses of a cloud that lie together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Heap {
    /// Their mean.
    pub pose: Pose,
    /// Share of the cloud.
    pub share: f64,
    /// Standard deviations about the mean, of x, y (m) and the angle (rad).
    pub sd: [f64; 3],
}

impl Cloud {
    /// The mean of the largest heap: of the poses near the one that has most near it. Where a slip may or may not have
    /// been, a mean is off by less than a median, which takes the likelier for sure.
    #[must_use]
    pub fn middle(&self) -> Pose {
        largest_heap(&self.poses).0.pose
    }

    /// Heaps, largest first, until what is left of the cloud is less than this share of it.
    #[must_use]
    pub fn heaps(&self, left_over: f64) -> Vec<Heap> {
        let mut rest = self.poses.clone();
        let mut heaps = Vec::new();
        while rest.len() as f64 > left_over * self.poses.len() as f64 && !rest.is_empty() {
            let (heap, others) = largest_heap(&rest);
            let share = heap.share * rest.len() as f64 / self.poses.len() as f64;
            heaps.push(Heap { share, ..heap });
            rest = others;
        }
        heaps
    }
}

/// The poses near the one that has most near it, and the others.
fn largest_heap(poses: &[Pose]) -> (Heap, Vec<Pose>) {
    let near = |a: &Pose, b: &Pose| {
        let off = a.minus(b);
        off.x.hypot(off.y) < HEAP[0] && off.z.abs() < HEAP[1]
    };
    let neighbours = |pose: &Pose| poses.iter().filter(|other| near(pose, other)).count();
    let seen = poses.iter().step_by(poses.len().div_ceil(SEEN));
    let best = seen.max_by_key(|pose| neighbours(pose)).copied().unwrap_or(poses[0]);
    let (within, others): (Vec<_>, Vec<_>) = poses.iter().copied().partition(|other| near(&best, other));
    let off: Vector3<f64> = mean(within.iter().map(|other| other.minus(&best))).unwrap_or_default();
    let squares = within.iter().map(|other| (other.minus(&best) - off).map(|part| part * part));
    let sd: Vector3<f64> = mean(squares).unwrap_or_default();
    let pose = Pose { x: best.x + off.x, y: best.y + off.y, theta: wrap_angle(best.theta + off.z) };
    (Heap { pose, share: within.len() as f64 / poses.len() as f64, sd: sd.map(f64::sqrt).into() }, others)
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
