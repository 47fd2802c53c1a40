//! Whether the block means of one window are at rest, and if not, how they move.
//!
//! A difference counts as movement if it exceeds both its limit and what noise explains. Noise comes from neighbouring
//! blocks, which a slow movement hardly sets apart.
//!
//! Frames: counts (x, y). Units: counts; degrees, per cent and microstrain in refusals. Errors: [`Refusal`].

use nalgebra::{Matrix2, Vector2};

use super::dwell::{DwellChange, DwellSettings, Expected, NO_LOAD_MICROSTRAIN, Refusal};
use super::force::DwellReading;
use crate::math::statistics::{mean, median};

/// A change below this many of its standard deviations is chance: one dwell in 16 000 for each axis.
const SIGNIFICANT: f64 = 4.0;

/// Median of χ² with one degree of freedom.
const CHI2_MEDIAN: f64 = 0.4549;

/// Variance of a rounded code, counts²: keeps noise-free samples from claiming perfect means.
const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;
/// Covariance of one block mean from neighbouring ones: a slow trend hardly enters differences of neighbours.
fn block_noise(blocks: &[Vector2<f64>]) -> Matrix2<f64> {
    let squares: Matrix2<f64> =
        blocks.windows(2).map(|pair| (pair[1] - pair[0]) * (pair[1] - pair[0]).transpose()).sum();
    let pairs = blocks.len().saturating_sub(1).max(1) as f64;
    squares / (2.0 * pairs) + Matrix2::identity() * ROUNDING_VARIANCE
}

/// The same for each bridge from the middle squared difference: one step or a few do not hide behind it.
fn quiet_noise(blocks: &[Vector2<f64>]) -> Vector2<f64> {
    let variance = |axis: usize| {
        let squares = blocks.windows(2).map(|pair| (pair[1][axis] - pair[0][axis]).powi(2));
        median(squares).unwrap_or(0.0) / (2.0 * CHI2_MEDIAN) + ROUNDING_VARIANCE
    };
    Vector2::new(variance(0), variance(1)).map(f64::sqrt)
}

/// Block means of one window and what they are compared with.
pub(super) struct Rest<'a> {
    settings: &'a DwellSettings,
    expected: Expected,
    blocks: &'a [Vector2<f64>],
    /// Covariance of one block mean, counts².
    noise: Matrix2<f64>,
    /// Standard deviation of a block mean on each bridge, counts, that a single jump does not enlarge.
    quiet_noise: Vector2<f64>,
}

impl<'a> Rest<'a> {
    pub(super) fn new(settings: &'a DwellSettings, expected: Expected, blocks: &'a [Vector2<f64>]) -> Self {
        Self { settings, expected, blocks, noise: block_noise(blocks), quiet_noise: quiet_noise(blocks) }
    }

    /// Refuses a window in which something moves.
    pub(super) fn check(&self) -> Result<(), Refusal> {
        let seconds = self.settings.duration_s;
        let trend = self.halves_apart();
        let change = self.change(trend);
        if change.of_limit() > 1.0 && self.is_significant(trend, 4.0 / self.count()) {
            return Err(match self.step_at() {
                Some(at) => Refusal::Stepped { change, at_s: at * seconds, seconds },
                None => Refusal::Drifts { change, seconds },
            });
        }
        let swing = self.widest_swing();
        let change = self.change(swing);
        // The widest of all pairs of blocks: chance reaches further than for one pair given beforehand.
        if change.of_limit() > 2.0 && self.is_significant(swing, 4.0) {
            return Err(Refusal::Swings { change, seconds });
        }
        Ok(())
    }

    /// Mean of all blocks, with the noise of the blocks and what a trend within the limits may hide.
    pub(super) fn reading(&self) -> DwellReading {
        let trend = self.halves_apart();
        let counts = average(self.blocks);
        // An even trend of twice that size over the dwell has this variance about its middle; chance has it too.
        let excess = trend * trend.transpose() / 12.0;
        let significant = self.is_significant(trend, 4.0 / self.count());
        let covariance = self.noise / self.count() + if significant { excess } else { Matrix2::zeros() };
        DwellReading { counts, covariance }
    }

    fn count(&self) -> f64 {
        self.blocks.len() as f64
    }

    /// Mean of the second half minus mean of the first, counts.
    fn halves_apart(&self) -> Vector2<f64> {
        let (first, second) = self.blocks.split_at(self.blocks.len() / 2);
        average(second) - average(first)
    }

    /// Whether a difference exceeds chance, given its variance in units of a block mean's.
    fn is_significant(&self, difference: Vector2<f64>, variance_in_blocks: f64) -> bool {
        difference.component_div(&self.quiet_noise).norm_squared() > SIGNIFICANT.powi(2) * variance_in_blocks
    }

    /// A difference of counts in the words of what is measured.
    fn change(&self, difference: Vector2<f64>) -> DwellChange {
        let microstrain_per_count = self.settings.front_end.microstrain_per_count();
        match self.expected {
            Expected::Nothing => DwellChange::Tare { microstrain: difference.norm() * microstrain_per_count },
            Expected::Load { tare } => {
                let load = average(self.blocks) - tare;
                // Below that load there is no direction to speak of, and the load check refuses it.
                let size = load.norm().max(NO_LOAD_MICROSTRAIN / microstrain_per_count);
                let along = load.normalize();
                let turn_deg = (along.perp(&difference) / size).atan().to_degrees();
                DwellChange::Contact { turn_deg, size_percent: 100.0 * along.dot(&difference) / size }
            }
        }
    }

    /// Where a single step explains the blocks much better than a straight line does, as a share of the window.
    fn step_at(&self) -> Option<f64> {
        let (at, left_by_step) = (1..self.blocks.len())
            .map(|at| (at, scatter(&self.blocks[..at]) + scatter(&self.blocks[at..])))
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        let share = at as f64 / self.count();
        (left_by_step < 0.5 * self.scatter_about_line()).then_some(share)
    }

    /// Sum of squares about the best straight line in time.
    fn scatter_about_line(&self) -> f64 {
        self.about_line().iter().map(Vector2::norm_squared).sum()
    }

    /// Blocks without their mean and linear trend.
    fn about_line(&self) -> Vec<Vector2<f64>> {
        let middle = 0.5 * (self.count() - 1.0);
        let time = |index: usize| {
            let index = index as f64;
            index - middle
        };
        let mean = average(self.blocks);
        let moment: Vector2<f64> =
            self.blocks.iter().enumerate().map(|(index, block)| (block - mean) * time(index)).sum();
        let squares: f64 = (0..self.blocks.len()).map(|index| time(index).powi(2)).sum();
        let slope = moment / squares.max(1.0);
        self.blocks.iter().enumerate().map(|(index, block)| block - mean - slope * time(index)).collect()
    }

    /// Largest difference between block means smoothed over three, after the trend is taken off.
    fn widest_swing(&self) -> Vector2<f64> {
        let detrended = self.about_line();
        let smooth: Vec<Vector2<f64>> = detrended.windows(3).map(average).collect();
        let pairs = smooth.iter().enumerate().flat_map(|(index, a)| smooth[index + 1..].iter().map(move |b| b - a));
        pairs.max_by(|a, b| a.norm_squared().total_cmp(&b.norm_squared())).unwrap_or_else(Vector2::zeros)
    }
}

/// Mean of both bridges, counts; zero of no blocks.
fn average(blocks: &[Vector2<f64>]) -> Vector2<f64> {
    mean(blocks).unwrap_or_default()
}

/// Sum of squares about the mean.
fn scatter(blocks: &[Vector2<f64>]) -> f64 {
    let mean = average(blocks);
    blocks.iter().map(|block| (block - mean).norm_squared()).sum()
}
