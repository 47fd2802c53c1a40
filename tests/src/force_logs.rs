//! Slow, obvious readings of the pushing logs, which share no code with palpate.
//!
//! Everything is in the logs' own units and frames: mm, N, s, sensor axes, robot frame.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI, TAU};
use std::fs;
use std::path::PathBuf;

use crate::project;

/// Vertices of the block that was pushed, mm, as the logs' notes give them.
const BLOCK_MM: [[f64; 2]; 3] = [[0.0, 0.0], [150.0, 0.0], [0.0, 150.0]];
/// Cost of leaving a reading out of the constant part, squared standard deviations: one beyond 3.5 on one axis is left
/// out rather than explained by noise.
const LEFT_OUT_COST: f64 = 12.0;
/// Median of the square of a standard normal value.
const MEDIAN_CHI_SQUARED: f64 = 0.4549;
/// Readings at the start of which the noise is taken: 0.15 s.
const NOISE_READINGS: usize = 15;

/// One push, as it stands in the file.
#[derive(Clone, Debug)]
pub struct RawPush {
    /// `x y z qw qx qy qz` of the block after the push.
    pub after: Vec<f64>,
    /// Rows `t Fx Fy`.
    pub forces: Vec<Vec<f64>>,
    /// Rows `t x y z qw qx qy qz`.
    pub tips: Vec<Vec<f64>>,
}

/// The folders of the logs and the log in each; `None` where the data is not there.
#[must_use]
pub fn logs() -> Option<Vec<(String, PathBuf)>> {
    let root = project::folder().join("../shared/data/mlab_point_push");
    let folders = fs::read_dir(&root).ok()?.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| path.is_dir());
    let mut logs: Vec<(String, PathBuf)> = folders
        .filter_map(|folder| {
            let log = fs::read_dir(&folder).ok()?.find_map(|entry| Some(entry.ok()?.path()))?;
            Some((folder.file_name()?.to_string_lossy().into_owned(), log))
        })
        .collect();
    logs.sort();
    Some(logs)
}

/// All pushes of a log, from its numbers in a row.
#[must_use]
pub fn read(text: &str) -> Vec<RawPush> {
    let mut numbers = text.split_whitespace().map(|word| word.parse::<f64>().unwrap_or(f64::NAN));
    let mut take = |n: usize| -> Vec<f64> { numbers.by_ref().take(n).collect() };
    let pushes = count(take(1)[0]);
    (0..pushes)
        .map(|_| {
            let (_before, after) = (take(7), take(7));
            let forces = (0..count(take(1)[0])).map(|_| take(3)).collect();
            let tips = (0..count(take(1)[0])).map(|_| take(8)).collect();
            RawPush { after, forces, tips }
        })
        .collect()
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "counts below a thousand, from a file we know"
)]
fn count(value: f64) -> usize {
    value as usize
}

impl RawPush {
    /// Mean force of the readings at times `from..to` s after the first.
    #[must_use]
    pub fn mean(&self, from: f64, to: f64) -> [f64; 2] {
        let (mut sum, mut n) = ([0.0; 2], 0.0);
        for row in &self.forces {
            let t = row[0] - self.forces[0][0];
            if from <= t && t < to {
                sum = [sum[0] + row[1], sum[1] + row[2]];
                n += 1.0;
            }
        }
        [sum[0] / n, sum[1] / n]
    }

    /// Where the force stops being constant, s after the first reading, by trying every reading: those before cost
    /// their squared distance from their mean, in standard deviations, those after a fixed price each.
    #[must_use]
    pub fn change_point(&self) -> f64 {
        let variance = [self.noise_variance(1), self.noise_variance(2)];
        let cost = |end: usize| {
            let constant: f64 = (0..2)
                .map(|axis| {
                    let values = || self.forces[..end].iter().map(|row| row[axis + 1]);
                    let mean = values().sum::<f64>() / end as f64;
                    values().map(|value| (value - mean).powi(2)).sum::<f64>() / variance[axis]
                })
                .sum();
            constant + LEFT_OUT_COST * (self.forces.len() - end) as f64
        };
        let best = (1..self.forces.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(0);
        self.forces[best][0] - self.forces[0][0]
    }

    /// Variance of the first readings of a column, from the median squared step between neighbours.
    fn noise_variance(&self, column: usize) -> f64 {
        let mut squares: Vec<f64> =
            self.forces[..NOISE_READINGS].windows(2).map(|pair| (pair[1][column] - pair[0][column]).powi(2)).collect();
        squares.sort_by(f64::total_cmp);
        squares[squares.len() / 2] / MEDIAN_CHI_SQUARED / 2.0
    }

    /// Angle, rad, from the inward normal of the nearest edge at the end (the block's pose after is known) to the mean
    /// force on the block over the last 0.1 s, with the bias from the first 0.15 s.
    #[must_use]
    pub fn end_angle(&self) -> f64 {
        let duration = self.forces[self.forces.len() - 1][0] - self.forces[0][0];
        let (bias, last) = (self.mean(0.0, 0.15), self.mean(duration - 0.1, duration + 1.0));
        let force = [last[0] - bias[0], last[1] - bias[1]];
        let tool = [-FRAC_1_SQRT_2 * (force[0] + force[1]), -FRAC_1_SQRT_2 * (force[0] - force[1])];
        let tip = &self.tips[self.tips.len() - 1];
        let direction = tool[1].atan2(tool[0]) + 2.0 * tip[7].atan2(tip[4]);
        let yaw = 2.0 * self.after[6].atan2(self.after[3]);
        let (dx, dy) = (tip[1] - self.after[0], tip[2] - self.after[1]);
        let tip_block = [yaw.cos() * dx + yaw.sin() * dy, yaw.cos() * dy - yaw.sin() * dx];
        turn(direction - yaw - nearest_normal(tip_block))
    }
}

/// Angle of the inward normal of the edge whose line the point is nearest to, from outside or a little inside.
fn nearest_normal(point: [f64; 2]) -> f64 {
    let mut best = (f64::INFINITY, 0.0);
    for i in 0..3 {
        let (a, b) = (BLOCK_MM[i], BLOCK_MM[(i + 1) % 3]);
        let (ex, ey) = (b[0] - a[0], b[1] - a[1]);
        // A thousand points along the edge are 0.2 mm apart.
        for k in 0..=1000 {
            let share = f64::from(k) / 1000.0;
            let distance = (a[0] + share * ex - point[0]).hypot(a[1] + share * ey - point[1]);
            if distance < best.0 {
                best = (distance, ey.atan2(ex) + FRAC_PI_2);
            }
        }
    }
    best.1
}

/// The same angle between −π and π.
#[must_use]
pub fn turn(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// Size of (mean of the first 0.2 s − median of the same of the five pushes nearest in time) for each push, N.
#[must_use]
pub fn start_deviations(pushes: &[RawPush]) -> Vec<f64> {
    let start = |push: &RawPush| push.forces[0][0];
    let deviation = |own: &RawPush| {
        let mut others: Vec<&RawPush> = pushes.iter().filter(|push| (start(push) - start(own)).abs() > 1.0).collect();
        others.sort_by(|a, b| (start(a) - start(own)).abs().total_cmp(&(start(b) - start(own)).abs()));
        let median = |axis: usize| {
            let mut values: Vec<f64> = others[..5].iter().map(|push| push.mean(0.0, 0.2)[axis]).collect();
            values.sort_by(f64::total_cmp);
            values[2]
        };
        let mean = own.mean(0.0, 0.2);
        (mean[0] - median(0)).hypot(mean[1] - median(1))
    };
    pushes.iter().map(deviation).collect()
}
