//! Which approach to make next: the line after which the least is expected to be left.
//!
//! Poses that are left stand for what may be. An approach is foreseen for each: where it meets the part, and with which
//! normal, or that it passes. Two poses go on looking the same as far as what they foresee cannot be told apart; the mean
//! of that over all pairs is the share of what is left that the approach is expected to leave. Where one pose is left, or
//! several that no approach tells apart, the line counts that makes the best of them known best.
//!
//! Lines of evenly spread directions and offsets across all that is left are tried, then the neighbours of the best.
//!
//! Frames: world. Units: m, rad. Errors: none.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point2, Rotation2, Vector2};

use super::super::noise::PoseMode;
use super::{Approach, Belief, TRUSTED_SD, TouchSearch, TouchTask, fit};
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;

/// Poses that stand for what is left.
const POSES: usize = 100;

/// Directions of lines that are tried.
const DIRECTIONS: u32 = 16;

/// Lines of each direction.
const OFFSETS: u32 = 16;

/// Of the lines tried, so many are looked around.
const REFINED: usize = 6;

/// Where nothing was touched, places of a touch nearer than this cannot be told apart, m: that is as near as poses that
/// stand for all are.
const SPREAD_M: f64 = 8e-3;

/// What a touch is taken to be uncertain by while there was none, m.
const SIGMA_FIRST: f64 = 5e-5;

/// Normals are told apart where they differ by more than this while there was no touch, rad.
const NORMAL_FIRST: f64 = 0.6;

/// A finger that goes into the outline by less than this share of its way slides along rather than stops.
const GRAZING: f64 = 0.35;

/// A grazing touch is somewhere within this, m.
const GRAZING_M: f64 = 5e-3;

/// The finger begins so far outside of what the part may fill, m.
const MARGIN_M: f64 = 2e-3;

/// What is left undecided counts so much more than how well a pose is known.
const SHARPNESS: f64 = 0.05;

/// The approach to make next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NextTouch {
    /// From outside of all that the part may fill to beyond it.
    pub approach: Approach,
    /// The least travel at which some pose that is left would be met, m: until then the finger may go fast.
    pub free_travel: f64,
    /// With which probability it meets the part.
    pub meets: f64,
    /// The share of what is left that is expected to be left after it.
    pub leaves: f64,
}

/// A pose that may be.
#[derive(Clone, Copy, Debug)]
struct Possible<'a> {
    /// That of its part.
    search: &'a TouchSearch,
    pose: Pose,
    /// How far points of the part may be from there, m.
    reach: f64,
}

/// What an approach would do in one pose.
#[derive(Clone, Copy, Debug)]
struct Foreseen {
    travel: f64,
    /// By how much of its way the finger goes into the outline.
    into: f64,
    /// Polar angle of the outward normal.
    normal: f64,
    /// How well the travel is known, m.
    width: f64,
}

/// A line and what is expected of it.
#[derive(Clone, Copy, Debug)]
struct Rated {
    angle: f64,
    /// Of the line from the middle of the rectangle, to the left of its direction, m.
    offset: f64,
    loss: f64,
    next: NextTouch,
}

struct Plan<'a> {
    task: &'a TouchTask,
    possible: Vec<Possible<'a>>,
    /// The pose that fits best, and the search of its part.
    best: Option<(&'a TouchSearch, PoseMode)>,
    sigma: f64,
    /// Normals that differ by less may be one.
    normals: f64,
}

/// The best approach for parts that were felt by the same touches, any of which it may be; none where no pose is left.
pub(super) fn next(searches: &[&TouchSearch]) -> Option<NextTouch> {
    let plan = Plan::new(searches)?;
    let mut rated = Vec::new();
    for k in 0..DIRECTIONS {
        let angle = TAU * f64::from(k) / f64::from(DIRECTIONS);
        let [low, high] = plan.breadth(angle)?;
        let step = (high - low) / f64::from(OFFSETS);
        let offsets = (0..OFFSETS).map(|k| low + step * (f64::from(k) + 0.5));
        rated.extend(offsets.map(|offset| (plan.rate(angle, offset), step)));
    }
    rated.sort_by(|a, b| a.0.loss.total_cmp(&b.0.loss));
    let turn = TAU / f64::from(DIRECTIONS) / 3.0;
    let around = rated.iter().take(REFINED).flat_map(|(rated, step)| {
        let aside = [-turn, 0.0, turn].map(|by| [-step / 3.0, 0.0, step / 3.0].map(|off| [by, off]));
        aside.into_iter().flatten().map(|[by, off]| (rated.angle + by, rated.offset + off))
    });
    let refined = around.map(|(angle, offset)| plan.rate(angle, offset));
    refined.min_by(|a, b| a.loss.total_cmp(&b.loss)).map(|rated| rated.next)
}

/// The approach that meets the pose of a search that fits best farthest from all that was touched, and stops there: another
/// part would not be where it is foreseen. None where there is no such pose.
pub(super) fn confirm(search: &TouchSearch) -> Option<NextTouch> {
    let plan = Plan::new(&[search])?;
    let (_, best) = plan.best?;
    let possible = Possible { search, pose: best.pose, reach: 0.0 };
    let mut farthest: Option<(f64, NextTouch)> = None;
    for k in 0..DIRECTIONS {
        let angle = TAU * f64::from(k) / f64::from(DIRECTIONS);
        let [low, high] = plan.breadth(angle)?;
        for k in 0..OFFSETS {
            let offset = low + (high - low) * (f64::from(k) + 0.5) / f64::from(OFFSETS);
            let approach = plan.line(angle, offset);
            let Some(met) = plan.foresee(&possible, &approach).filter(|met| met.into >= GRAZING) else { continue };
            let centre = approach.at(met.travel);
            let apart = search.touches.iter().map(|touch| (touch.centre - centre).norm()).fold(f64::INFINITY, f64::min);
            if farthest.is_none_or(|(most, _)| apart > most) {
                farthest = Some((apart, plan.rate(angle, offset).next));
            }
        }
    }
    farthest.map(|(_, next)| next)
}

/// The line through a place, from outside of all that a part in a rectangle may fill to beyond it, for a disk of this
/// radius (m).
pub(in crate::inscription) fn across(
    [low, high]: [Point2<f64>; 2],
    radius: f64,
    foot: Point2<f64>,
    direction: Vector2<f64>,
) -> Approach {
    let around = Vector2::repeat(radius + MARGIN_M);
    let [low, high] = [low - around, high + around];
    // From the foot to where each pair of sides is crossed.
    let mut span = [f64::NEG_INFINITY, f64::INFINITY];
    for axis in 0..2 {
        let (from, way) = (foot[axis], direction[axis]);
        if way != 0.0 {
            let crossed = [(low[axis] - from) / way, (high[axis] - from) / way];
            span = [span[0].max(crossed[0].min(crossed[1])), span[1].min(crossed[0].max(crossed[1]))];
        }
    }
    let length = (span[1] - span[0]).max(0.0);
    Approach { from: foot + direction * span[0], direction, length }
}

impl<'a> Plan<'a> {
    /// None where there is no part.
    fn new(searches: &[&'a TouchSearch]) -> Option<Self> {
        let first = *searches.first()?;
        let known = |search: &TouchSearch| matches!(&search.belief, Belief::Covered { modes, .. } if !modes.is_empty());
        // Poses that are known stand for themselves; cells and drawn poses only where there are none.
        let count: usize = searches.iter().map(|search| search.left()).sum();
        let stride = count.div_ceil(POSES).max(1);
        let mut possible = Vec::new();
        let mut before = 0;
        for &search in searches {
            // Every `stride`-th of the poses of all parts together.
            let skipped = (stride - before % stride) % stride;
            before += search.left();
            let add = |pose, reach| Possible { search, pose, reach };
            match &search.belief {
                Belief::Spread(poses) => {
                    possible.extend(poses.iter().skip(skipped).step_by(stride).map(|&pose| add(pose, SPREAD_M)));
                }
                Belief::Covered { modes, .. } if !modes.is_empty() => {
                    let within = |mode: &PoseMode| {
                        let (distance, _) = fit::deviations(&search.task, &mode.pose, &mode.covariance);
                        add(mode.pose, distance.min(GRAZING_M))
                    };
                    possible.extend(modes.iter().skip(skipped).step_by(stride).map(within));
                }
                Belief::Covered { cells, .. } => {
                    let middles = cells.middles(&search.task, &search.curve, skipped, stride);
                    possible.extend(middles.map(|middle| add(middle.pose, middle.reach)));
                }
            }
        }
        let best = searches.iter().filter(|search| known(search));
        let best = best.filter_map(|&search| Some((search, search.modes().first().copied()?)));
        let best = best.min_by(|a, b| a.1.chi2.total_cmp(&b.1.chi2));
        let sigma = first.touches.iter().map(|touch| touch.sigma).fold(0.0, f64::max);
        let normals = first.touches.iter().map(|touch| 2.0 * touch.half_width).fold(0.0, f64::max);
        let (sigma, normals) = if first.touches.is_empty() { (SIGMA_FIRST, NORMAL_FIRST) } else { (sigma, normals) };
        Some(Self { task: &first.task, possible, best, sigma, normals })
    }

    fn middle(&self) -> Point2<f64> {
        let [low, high] = self.task.area;
        nalgebra::center(&low, &high)
    }

    /// Offsets between which lines of a direction can meet the part; none without a pose.
    fn breadth(&self, angle: f64) -> Option<[f64; 2]> {
        let left = Vector2::new(-angle.sin(), angle.cos());
        let middle = self.middle();
        let aside = self.possible.iter().flat_map(|possible| {
            let isometry = possible.pose.isometry();
            let vertices = possible.search.task.outline.vertices();
            vertices.iter().map(move |vertex| (isometry * vertex - middle).dot(&left))
        });
        let [low, high] = aside.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], at| [low.min(at), high.max(at)]);
        let radius = self.task.radius;
        (low <= high).then_some([low - radius, high + radius])
    }

    /// The line across the rectangle and the disk's radius about it.
    fn line(&self, angle: f64, offset: f64) -> Approach {
        let direction = Vector2::new(angle.cos(), angle.sin());
        let foot = self.middle() + Vector2::new(-direction.y, direction.x) * offset;
        across(self.task.area, self.task.radius, foot, direction)
    }

    fn rate(&self, angle: f64, offset: f64) -> Rated {
        let approach = self.line(angle, offset);
        let foreseen: Vec<_> = self.possible.iter().map(|possible| self.foresee(possible, &approach)).collect();
        let count = foreseen.len().max(1) as f64;
        let mut alike = 0.0;
        for (k, a) in foreseen.iter().enumerate() {
            alike += foreseen[..k].iter().map(|b| 2.0 * self.likeness(a.as_ref(), b.as_ref())).sum::<f64>() + 1.0;
        }
        let leaves = alike / (count * count);
        let met = foreseen.iter().flatten();
        let free_travel = met.clone().map(|met| met.travel).fold(approach.length, f64::min);
        let meets = met.count() as f64 / count;
        let next = NextTouch { approach, free_travel: (free_travel - self.unsure()).max(0.0), meets, leaves };
        Rated { angle, offset, loss: leaves + SHARPNESS * self.bluntness(&approach), next }
    }

    /// By how much the first touch may come earlier than foreseen, m.
    fn unsure(&self) -> f64 {
        self.possible.iter().map(|possible| possible.reach).fold(MARGIN_M, f64::max)
    }

    fn foresee(&self, possible: &Possible<'_>, approach: &Approach) -> Option<Foreseen> {
        let turn = Rotation2::new(-possible.pose.theta);
        let centre = Point2::from(turn * (approach.from - possible.pose.origin()));
        let way = turn * approach.direction;
        let curve = &possible.search.curve;
        let (travel, place) = curve.first_touch(centre, way, approach.length, 0.0)?;
        let normal = curve.touched(place).normal;
        let into = -normal.dot(&way);
        let width = if into < GRAZING { GRAZING_M } else { (TRUSTED_SD * self.sigma).hypot(possible.reach) / into };
        let normal = turn.inverse() * normal;
        Some(Foreseen { travel, into, normal: normal.y.atan2(normal.x), width })
    }

    /// How alike two outcomes are, 0 to 1.
    fn likeness(&self, a: Option<&Foreseen>, b: Option<&Foreseen>) -> f64 {
        match (a, b) {
            (None, None) => 1.0,
            (Some(a), Some(b)) => {
                if wrap_angle(a.normal - b.normal).abs() > self.normals {
                    return 0.0;
                }
                (-0.5 * (a.travel - b.travel).powi(2) / (a.width.powi(2) + b.width.powi(2))).exp()
            }
            _ => 0.0,
        }
    }

    /// How far the best pose would be from being known well enough, from 0 to 1.
    fn bluntness(&self, approach: &Approach) -> f64 {
        let Some((search, best)) = &self.best else { return 0.0 };
        let turn = Rotation2::new(-best.pose.theta);
        let centre = Point2::from(turn * (approach.from - best.pose.origin()));
        let way = turn * approach.direction;
        let added = search.curve.first_touch(centre, way, approach.length, 0.0).and_then(|(_, place)| {
            let touched = search.curve.touched(place);
            if -touched.normal.dot(&way) < GRAZING {
                return None;
            }
            let (normal, at) = (turn.inverse() * touched.normal, best.pose.isometry() * touched.at);
            let slopes = fit::slopes(&normal, at, &best.pose) / self.sigma;
            Some(slopes * slopes.transpose())
        });
        let information = best.covariance.try_inverse().unwrap_or_else(Matrix3::zeros);
        let after = (information + added.unwrap_or_else(Matrix3::zeros)).try_inverse();
        // What is not known at all is as far as can be; between, less is better even where it is enough.
        after.map_or(1.0, |after| {
            let excess = search.excess(&best.pose, &after);
            excess / (1.0 + excess)
        })
    }
}
