//! One slow push after another: a cloud of poses before, what was felt, a cloud of poses after.
//!
//! 1. Start poses are drawn from what is known: a pose with its error, a box, anywhere on the table, or the cloud of
//!    the push before through its kernel, a few of these through one so wide that a part is found again that slid
//!    where all of the cloud stuck.
//! 2. The onset is geometry: the travel at which the finger meets the outline of each, before anything is simulated.
//!    Student's distribution weighs it against the travel felt.
//! 3. Those that remain are given numbers of this push (friction of feet and finger, frame of the force) and simulated.
//! 4. The force weighs them: logarithm of its size and its direction, every stretch of the way.
//!
//! Source: sampling, importance, resampling after Gordon, Salmond and Smith (1993); kernels after Liu and West (2001).
//! Frames: world. Units: SI. Errors: none; a push that explains nothing leaves the cloud as its start poses were moved.

use nalgebra::Vector2;

use super::cloud::{Cloud, Kernel, effective_number, resampled};
use super::constants::{FilterSettings, Spread};
use super::felt::{FeltPush, Onset};
use super::scene::{PushParameters, SlowScene};
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;

/// What is believed of a push's own numbers before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParameterBelief {
    /// Middle.
    pub middle: PushParameters,
    /// Scatter about it.
    pub spread: Spread,
}

impl Default for ParameterBelief {
    fn default() -> Self {
        Self { middle: PushParameters::default(), spread: Spread::PUSH }
    }
}

/// What is known of the pose before a push.
#[derive(Clone, Debug)]
pub enum Before<'a> {
    /// A pose measured with these standard deviations, m and rad, and the kernel's tails.
    Measured(Pose, f64, f64),
    /// Anywhere within this far (m, rad) of a pose, evenly.
    Box(Pose, f64, f64),
    /// Touched anywhere on the outline, from any side: evenly along the outline, and over angles of the push within
    /// 80° of its normal.
    Anywhere,
    /// The poses after the push before.
    After(&'a Cloud),
}

/// What a push leaves.
#[derive(Clone, Debug)]
pub struct AfterPush {
    /// Poses after it.
    pub cloud: Cloud,
    /// Effective number of start poses, given the onset.
    pub effective_onset: f64,
    /// Effective number of simulated pushes, given the force.
    pub effective_force: f64,
    /// Numbers of this push, one for each pose of the cloud.
    pub parameters: Vec<PushParameters>,
}

/// The estimator of slow pushes.
#[derive(Clone, Debug)]
pub struct SlowFilter<'a> {
    /// Part, feet and constants.
    pub scene: &'a SlowScene,
    /// How to weigh and draw.
    pub settings: FilterSettings,
}

/// Largest angle of a push of which nothing is known against the normal of what it touches: 80°.
const ANYWHERE_ANGLE: f64 = 80.0 * std::f64::consts::PI / 180.0;

/// So many times more poses are tried, simulated and kept where the part may be anywhere: half a metre of outline and
/// 160° are otherwise a pose every 5 mm and 5°. Each push after that keeps half as many, down to the usual number.
const ANYWHERE: usize = 2;

/// Start poses are drawn so many times at most. Of a cloud that is centimetres wide one in a hundred meets the onset; fewer
/// than that are an onset that nothing explains.
const DRAWS_MAX: usize = 11;

/// Logarithm of Student's density, without its constant.
fn student_log(deviation: f64, freedom: f64) -> f64 {
    -0.5 * (freedom + 1.0) * (deviation * deviation / freedom).ln_1p()
}

impl SlowFilter<'_> {
    /// The cloud after a push.
    #[must_use]
    pub fn push(&self, before: &Before<'_>, felt: &FeltPush, belief: &ParameterBelief, draw: &mut Draw) -> AfterPush {
        let settings = &self.settings;
        let particles = match before {
            Before::Anywhere => ANYWHERE * settings.particles,
            Before::After(cloud) => settings.particles.max(cloud.poses.len() / 2),
            Before::Measured(..) | Before::Box(..) => settings.particles,
        };
        let (starts, weights) = self.met(before, felt, particles, draw);
        let taken = resampled(&weights, settings.simulated * particles, draw);
        let mut ends = Vec::with_capacity(taken.len());
        let mut logs = Vec::with_capacity(taken.len());
        for start in taken {
            let parameters = belief.middle.drawn(&belief.spread, draw);
            let simulated = self.scene.simulate(felt, &starts[start], &parameters, settings.stride);
            logs.push(if simulated.is_whole { self.force_log(felt, &simulated.forces) } else { f64::NEG_INFINITY });
            ends.push((simulated.pose, parameters));
        }
        let best = logs.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        let force_weights: Vec<_> =
            logs.iter().map(|log| if best.is_finite() { (log - best).exp() } else { 1.0 }).collect();
        let kept = resampled(&force_weights, particles, draw);
        AfterPush {
            cloud: Cloud { poses: kept.iter().map(|&i| ends[i].0).collect() },
            effective_onset: effective_number(&weights),
            effective_force: effective_number(&force_weights),
            parameters: kept.iter().map(|&i| ends[i].1).collect(),
        }
    }

    /// Start poses with their weights, given the onset: drawn until they are worth as many as are kept.
    fn met(&self, before: &Before<'_>, felt: &FeltPush, particles: usize, draw: &mut Draw) -> (Vec<Pose>, Vec<f64>) {
        let (mut starts, mut weights) = (Vec::new(), Vec::new());
        for _ in 0..DRAWS_MAX {
            let more = self.starts(before, felt, draw);
            weights.extend(more.iter().map(|pose| self.onset_log(felt, pose).exp()));
            starts.extend(more);
            if effective_number(&weights) >= particles as f64 {
                break;
            }
        }
        (starts, weights)
    }

    fn starts(&self, before: &Before<'_>, felt: &FeltPush, draw: &mut Draw) -> Vec<Pose> {
        let kernel = Kernel::of(&self.settings);
        let count = self.settings.candidates * self.settings.particles;
        match before {
            Before::Measured(pose, place, angle) => {
                let kernel = Kernel { place: *place, angle: *angle, ..kernel };
                (0..count).map(|_| kernel.drawn(pose, draw)).collect()
            }
            Before::Box(pose, place, angle) => (0..count)
                .map(|_| Pose {
                    x: pose.x + draw.uniform(-place, *place),
                    y: pose.y + draw.uniform(-place, *place),
                    theta: pose.theta + draw.uniform(-angle, *angle),
                })
                .collect(),
            Before::After(cloud) => {
                let lost = kernel.widened(self.settings.lost_width);
                let drawn = |i: usize| {
                    let kernel = if draw.chance(self.settings.lost_share) { &lost } else { &kernel };
                    kernel.drawn(&cloud.poses[i % cloud.poses.len()], draw)
                };
                (0..count).map(drawn).collect()
            }
            Before::Anywhere => (0..ANYWHERE * count).map(|_| self.anywhere(felt, draw)).collect(),
        }
    }

    /// A pose in which the finger touches where the onset was felt, or somewhere on its way if it was not.
    fn anywhere(&self, felt: &FeltPush, draw: &mut Draw) -> Pose {
        let constants = self.scene.constants();
        let late = constants.felt_late;
        let (low, high) = match felt.onset {
            Onset::At(travel) => (travel - late, travel - late),
            Onset::Before(travel) => (travel - late - self.settings.settle, travel - late),
            Onset::Never(_) | Onset::Unknown => (felt.end - 0.02, felt.end),
        };
        let travel = draw.uniform(low, high) + self.settings.onset_scale * draw.normal();
        let (at, normal) = self.scene.on_outline(draw.unit());
        let angle = draw.uniform(-ANYWHERE_ANGLE, ANYWHERE_ANGLE);
        // The finger comes against the normal, turned by the angle.
        let way = self.scene.way(felt);
        let inward = way.direction.y.atan2(way.direction.x) - angle;
        let theta = wrap_angle(inward - (-normal.y).atan2(-normal.x));
        let turn = nalgebra::Rotation2::new(theta);
        let origin = way.at(travel) - turn * (at.coords + normal * constants.radius);
        Pose { x: origin.x, y: origin.y, theta }
    }

    /// Logarithm of the weight of a start pose, given the onset.
    fn onset_log(&self, felt: &FeltPush, pose: &Pose) -> f64 {
        let settings = &self.settings;
        let touched = self.scene.first_touch(felt, pose).map(|travel| travel + self.scene.constants().felt_late);
        let student = |off: f64| student_log(off / settings.onset_scale, settings.freedom);
        match (felt.onset, touched) {
            (Onset::At(travel), Some(touched)) => student(touched - travel),
            (Onset::Before(travel), Some(touched)) => student((touched - travel).max(0.0)),
            (Onset::Never(travel), Some(touched)) => student((travel - touched).max(0.0)),
            (Onset::At(_) | Onset::Before(_), None) => f64::NEG_INFINITY,
            (Onset::Unknown, _) | (Onset::Never(_), None) => 0.0,
        }
    }

    /// Logarithm of the weight of a simulated push, given the forces.
    fn force_log(&self, felt: &FeltPush, forces: &[Option<Vector2<f64>>]) -> f64 {
        let settings = &self.settings;
        let from = match felt.onset {
            Onset::At(travel) | Onset::Before(travel) => travel + settings.settle,
            Onset::Never(_) | Onset::Unknown => return 0.0,
        };
        let mut sum = 0.0;
        for (felt, force) in felt.forces.iter().zip(forces).filter(|(felt, _)| felt.travel >= from) {
            let off = match force {
                Some(force) => {
                    let size = (felt.force.norm() / force.norm()).ln() / settings.force_scale;
                    let turn = force.perp(&felt.force).atan2(force.dot(&felt.force)) / settings.angle_scale;
                    student_log(size, settings.freedom) + student_log(turn, settings.freedom)
                }
                // As good as a force that is off by ten scales both ways.
                None => 2.0 * student_log(10.0, settings.freedom),
            };
            sum += off;
        }
        sum / settings.tempering
    }
}
