//! What a cloud of poses states: a middle, the region of highest density, and the cells it fills.
//!
//! The density is the cloud's through its kernel. The 95 % region is where the density is at least what 95 % of poses
//! drawn from it have; its volume is the mean of one over the density over those poses (importance sampling). Frames:
//! world. Units: SI.

use std::collections::HashMap;

use super::cloud::{Cloud, Kernel};
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;

/// What is outside the stated region.
const OUTSIDE: f64 = 0.05;

/// Poses at which a cloud's density is looked up: the threshold is then good to 0.7 % of coverage.
const LOOKED_UP: usize = 1000;

/// Sides of a cell: m and rad.
pub const CELL: [f64; 2] = [5e-3, 5.0 * std::f64::consts::PI / 180.0];

/// Poses drawn from the kernel about each of a cloud, to count cells.
const DRAWN_PER_POSE: usize = 20;

/// A region of highest density.
#[derive(Clone, Debug)]
pub struct Region {
    cloud: Cloud,
    kernel: Kernel,
    threshold: f64,
    /// m² rad.
    pub volume: f64,
}

impl Region {
    /// The 95 % region of a cloud.
    #[must_use]
    pub fn of(cloud: &Cloud, kernel: Kernel, draw: &mut Draw) -> Self {
        let density = |pose: &Pose| density(cloud, &kernel, pose);
        let looked_up = (0..LOOKED_UP).map(|_| {
            let about = cloud.poses[draw.index(cloud.poses.len())];
            density(&kernel.drawn(&about, draw))
        });
        let mut densities: Vec<_> = looked_up.collect();
        densities.sort_by(f64::total_cmp);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a small count")]
        let outside = (OUTSIDE * LOOKED_UP as f64) as usize;
        let inside = &densities[outside..];
        let volume = inside.iter().map(|density| 1.0 / density).sum::<f64>() / LOOKED_UP as f64;
        Self { cloud: cloud.clone(), kernel, threshold: densities[outside], volume }
    }

    /// Whether a pose is inside.
    #[must_use]
    pub fn holds(&self, pose: &Pose) -> bool {
        density(&self.cloud, &self.kernel, pose) >= self.threshold
    }

    /// Semi-axes (m, m, rad) of the ellipsoid of the region's volume that has as many millimetres as degrees.
    #[must_use]
    pub fn semi_axes(&self) -> [f64; 3] {
        // 4/3 π a² b with b/1° = a/1 mm.
        let degrees_per_millimetre = 1.0_f64.to_radians() / 1e-3;
        let a = (self.volume * 0.75 / std::f64::consts::PI / degrees_per_millimetre).cbrt();
        [a, a, a * degrees_per_millimetre]
    }
}

fn density(cloud: &Cloud, kernel: &Kernel, pose: &Pose) -> f64 {
    let each = cloud.poses.iter().map(|about| {
        let off = pose.minus(about);
        kernel.density([off.x, off.y, off.z])
    });
    each.sum::<f64>() / cloud.poses.len() as f64
}

/// The cells that hold 95 % of a cloud, fullest first.
#[derive(Clone, Debug)]
pub struct Cells {
    /// Numbers of cells along x, y and the angle.
    held: HashMap<[i64; 3], ()>,
    /// The middle of the largest heap.
    pub pose: Pose,
}

#[expect(clippy::cast_possible_truncation, reason = "tables are metres wide, cells millimetres")]
fn cell(pose: &Pose) -> [i64; 3] {
    let number = |value: f64, side: f64| (value / side).floor() as i64;
    [number(pose.x, CELL[0]), number(pose.y, CELL[0]), number(wrap_angle(pose.theta), CELL[1])]
}

impl Cells {
    /// Of a cloud, through this kernel.
    #[must_use]
    pub fn of(cloud: &Cloud, kernel: &Kernel, draw: &mut Draw) -> Self {
        let mut counts: HashMap<[i64; 3], usize> = HashMap::new();
        for about in &cloud.poses {
            for _ in 0..DRAWN_PER_POSE {
                *counts.entry(cell(&kernel.drawn(about, draw))).or_default() += 1;
            }
        }
        let mut cells: Vec<_> = counts.into_iter().collect();
        // Fullest first; numbers break ties, so that the order is the same everywhere.
        cells.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        let goal = (1.0 - OUTSIDE) * (cloud.poses.len() * DRAWN_PER_POSE) as f64;
        let mut reached = 0.0;
        let mut held = HashMap::new();
        for (cell, count) in &cells {
            if reached >= goal {
                break;
            }
            held.insert(*cell, ());
            reached += *count as f64;
        }
        Self { held, pose: cloud.middle() }
    }

    /// How many they are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.held.len()
    }

    /// Whether a pose is in one of them.
    #[must_use]
    pub fn holds(&self, pose: &Pose) -> bool {
        self.held.contains_key(&cell(pose))
    }
}
