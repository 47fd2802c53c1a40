//! The tare: the sensor's bias, from a stretch of time that the caller says was free of contact.
//!
//! An explicit step whose result is kept and reported. [`Tare::estimate`] does not take the caller's word: a stretch
//! that drifts, steps, is stuck or is noisier than it should be is refused, with the numbers.
//!
//! The bias is a mean with outliers pulled in. Its covariance comes from the scatter of block means, each at least one
//! mains period long, so hum and slow noise are counted as what they are (see [`super::noise`]).

use nalgebra::{Matrix2, Vector2};
use serde::{Deserialize, Serialize};

use super::average::Averaging;
use super::{Reading, noise};
use crate::finger::judge::SampleFault;
use crate::math::statistics::{mean, median};

/// Shortest block whose mean is used to judge the stretch, s: one mains period at 50 Hz, so that hum averages out.
const BLOCK_S: f64 = 0.02;
/// Fewest blocks: with fewer the scatter of their means is known to worse than 30 %.
const BLOCKS_MIN: usize = 8;
/// Most blocks: more add nothing to the judgement.
const BLOCKS_MAX: usize = 32;
/// Fewest readings in a block, so that a mean is one.
const BLOCK_READINGS_MIN: usize = 2;
/// Shortest stretch, s.
const DURATION_MIN_S: f64 = BLOCK_S * BLOCKS_MIN as f64;
/// Fewest windows of the averaging in use that must fit side by side: their scatter is the noise we state.
const WINDOWS_MIN: usize = 8;
/// Readings further than this many robust standard deviations from the median are pulled in to that distance.
///
/// Gaussian noise gets there once in five hundred million readings, hum never; a spike or a touch does.
const OUTLIER_SIGMAS: f64 = 6.0;
/// Largest share of outliers that still counts as rest (one is always allowed): spikes of a bad cable, not a touch.
const OUTLIER_SHARE_MAX: f64 = 0.01;
/// A drift or step below this Student t is chance. With [`BLOCKS_MIN`] blocks, chance exceeds it once in 5000 tares.
const SIGNIFICANT_T: f64 = 8.0;
/// A drift or step below this many standard deviations of one averaged reading does no harm and is accepted.
const HARMFUL_SIGMAS: f64 = 1.5;
/// Median absolute deviation to standard deviation, for Gaussian values: 1/Φ⁻¹(3/4).
const MAD_TO_SD: f64 = 1.482_602_218_505_602;
/// Two readings further apart than this many sampling periods have a gap between them.
const GAP_PERIODS: f64 = 2.5;

/// What a tare needs to know.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TareSettings {
    /// The averaging that the sense will use: the noise is stated for it.
    pub averaging: Averaging,
    /// Largest standard deviation of a single reading on either axis, force units; `None` accepts any.
    pub noise_max: Option<f64>,
}

/// The bias of the force sensor, and its noise at rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tare {
    /// What the sensor reads without contact, finger axes; subtracted from every reading.
    #[serde(with = "crate::math::arrays::vector")]
    pub bias: Vector2<f64>,
    /// Covariance of `bias`, finger axes, force units squared.
    #[serde(with = "crate::math::arrays::matrix")]
    pub bias_covariance: Matrix2<f64>,
    /// Covariance of one reading averaged over `averaging_samples`.
    #[serde(with = "crate::math::arrays::matrix")]
    pub sample_covariance: Matrix2<f64>,
    /// Covariance of a single reading.
    #[serde(with = "crate::math::arrays::matrix")]
    pub single_covariance: Matrix2<f64>,
    /// Readings averaged into one.
    pub averaging_samples: usize,
    /// Independent values that `sample_covariance` is worth, less one.
    pub freedom: f64,
    /// Drift over the stretch, force/s: the slope of the block means.
    #[serde(with = "crate::math::arrays::vector")]
    pub drift: Vector2<f64>,
    /// Readings that the bias was estimated from.
    pub samples: usize,
    /// Readings pulled in because they were far off.
    pub outliers: usize,
    /// First and last time of the stretch, s.
    pub t_from: f64,
    /// Last time of the stretch, s.
    pub t_to: f64,
    /// Median time between readings, s.
    pub period: f64,
}

/// Why a stretch cannot serve as a tare.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TareError {
    /// Too few readings to know the noise of the averaging in use.
    #[error("{samples} readings are too few for a tare, which needs {needed} (8 windows of {window})")]
    TooFew {
        /// Readings in the stretch.
        samples: usize,
        /// Fewest readings from which the noise is known.
        needed: usize,
        /// Readings in one window of the averaging in use.
        window: usize,
    },
    /// Too short to tell hum from bias.
    #[error("{duration} s are too short for a tare, which needs {DURATION_MIN_S} s (8 mains periods)")]
    TooShort {
        /// Length of the stretch, s.
        duration: f64,
    },
    /// A reading is NaN or infinite.
    #[error("the reading at t = {t} s is not finite")]
    NotFinite {
        /// Time of the reading, s.
        t: f64,
    },
    /// A sample was no measurement.
    #[error("at t = {t} s {fault}")]
    NotMeasured {
        /// Time of the sample, s.
        t: f64,
        /// Why it was none.
        fault: SampleFault,
    },
    /// Far from the reading without load that the calibration knows.
    #[error(
        "without load the bridges read {shift:.0} microstrain from where they did when the finger was calibrated; weight and warmth make up to {limit:.0}"
    )]
    Loaded {
        /// How far, microstrain, the larger of the two bridges.
        shift: f64,
        /// How far they may be, microstrain.
        limit: f64,
    },
    /// Time does not increase.
    #[error("time does not increase after t = {t} s")]
    NotInOrder {
        /// The last good time, s.
        t: f64,
    },
    /// Every reading of one axis is the same: a dead channel.
    #[error("all {samples} readings of axis {axis} are {value}: the channel is stuck")]
    Stuck {
        /// `x` or `y`, finger axes.
        axis: char,
        /// The value it is stuck at, force units.
        value: f64,
        /// Readings in the stretch.
        samples: usize,
    },
    /// The force changed steadily.
    #[error("the force drifted by {change} between t = {t_from} s and {t_to} s, where at most {limit} is rest")]
    Drift {
        /// Size of the change over the stretch, force units.
        change: f64,
        /// Largest change that counts as rest, force units.
        limit: f64,
        /// Start of the stretch, s.
        t_from: f64,
        /// End of the stretch, s.
        t_to: f64,
    },
    /// The force changed at once: contact began or ended, or the load slipped.
    #[error("the force stepped by {change} near t = {t} s, where at most {limit} is rest")]
    Step {
        /// Size of the step, force units.
        change: f64,
        /// Largest step that counts as rest, force units.
        limit: f64,
        /// Time of the step, s, to within a block (a 32nd of the stretch or one mains period).
        t: f64,
    },
    /// Too many readings are far from the others.
    #[error("{outliers} of {samples} readings are far from the others, the first at t = {t} s; rest has {allowed}")]
    Outliers {
        /// Readings more than 6 robust standard deviations off.
        outliers: usize,
        /// Readings in the stretch.
        samples: usize,
        /// How many are accepted.
        allowed: usize,
        /// Time of the first, s.
        t: f64,
    },
    /// Noisier than the sensor should be.
    #[error("axis {axis} has noise of {sd} rms, above the limit of {limit}")]
    Noisy {
        /// `x` or `y`, finger axes.
        axis: char,
        /// Standard deviation of a single reading, force units.
        sd: f64,
        /// The limit given, force units.
        limit: f64,
    },
}

impl Tare {
    /// Estimates bias and noise from a stretch that should be free of contact, and judges whether it was.
    ///
    /// # Errors
    /// [`TareError`] with the numbers if the stretch cannot serve.
    pub fn estimate(readings: &[Reading], settings: &TareSettings) -> Result<Self, TareError> {
        let stretch = Stretch::new(readings, settings)?;
        stretch.judge(settings)?;
        Ok(stretch.tare())
    }

    /// Longest time between two readings without a gap, s.
    #[must_use]
    pub fn gap_max(&self) -> f64 {
        GAP_PERIODS * self.period
    }

    /// Standard deviation of one averaged reading, force units: root mean square of the two axes'.
    #[must_use]
    pub fn sample_sd(&self) -> f64 {
        rms_axis(&self.sample_covariance)
    }

    /// Standard deviation of the bias, force units: root mean square of the two axes'.
    #[must_use]
    pub fn bias_sd(&self) -> f64 {
        rms_axis(&self.bias_covariance)
    }

    /// How many independent readings one averaged reading is worth: `averaging_samples` only if the noise is white.
    #[must_use]
    pub fn effective_samples(&self) -> f64 {
        self.single_covariance.trace() / self.sample_covariance.trace()
    }
}

fn rms_axis(covariance: &Matrix2<f64>) -> f64 {
    (0.5 * covariance.trace()).sqrt()
}

/// The stretch with its outliers pulled in, and its block means.
struct Stretch<'a> {
    readings: &'a [Reading],
    forces: Vec<Vector2<f64>>,
    outliers: Vec<usize>,
    blocks: Vec<Vector2<f64>>,
    window: usize,
    period: f64,
    sample: noise::Scatter,
    single: noise::Scatter,
}

impl<'a> Stretch<'a> {
    fn new(readings: &'a [Reading], settings: &TareSettings) -> Result<Self, TareError> {
        check_order(readings)?;
        let period = period(readings).unwrap_or(f64::INFINITY);
        let window = settings.averaging.samples(period);
        let needed = (WINDOWS_MIN * window).max(BLOCKS_MIN * BLOCK_READINGS_MIN);
        let too_few = TareError::TooFew { samples: readings.len(), needed, window };
        if readings.len() < needed {
            return Err(too_few);
        }
        let duration = duration(readings);
        if duration < DURATION_MIN_S {
            return Err(TareError::TooShort { duration });
        }
        let (forces, outliers) = pull_in(readings)?;
        let blocks = noise::block_means(&forces, block_count(duration, forces.len()));
        let sample = noise::of_window_mean(&forces, window).ok_or(too_few)?;
        let single = noise::of_values(&forces).ok_or(too_few)?;
        Ok(Self { readings, forces, outliers, blocks, window, period, sample, single })
    }

    fn t_from(&self) -> f64 {
        self.readings.first().map_or(f64::NAN, |reading| reading.t)
    }

    fn t_to(&self) -> f64 {
        self.readings.last().map_or(f64::NAN, |reading| reading.t)
    }

    fn judge(&self, settings: &TareSettings) -> Result<(), TareError> {
        let limit = HARMFUL_SIGMAS * rms_axis(&self.sample.covariance);
        let (line, step) = (Change::line(&self.blocks), Change::step(&self.blocks));
        let change = if step.left_over < line.left_over { &step } else { &line };
        if change.t > SIGNIFICANT_T && change.size.norm() > limit {
            return Err(self.describe(change, limit));
        }
        self.judge_outliers()?;
        self.judge_noise(settings.noise_max.unwrap_or(f64::INFINITY))
    }

    fn describe(&self, change: &Change, limit: f64) -> TareError {
        let (t_from, t_to, size) = (self.t_from(), self.t_to(), change.size.norm());
        match change.block {
            Some(block) => {
                let reading = block * (self.readings.len() / self.blocks.len());
                TareError::Step { change: size, limit, t: self.readings[reading].t }
            }
            None => TareError::Drift { change: size, limit, t_from, t_to },
        }
    }

    fn judge_outliers(&self) -> Result<(), TareError> {
        let samples = self.readings.len();
        // Rounds down: a share of a reading is none.
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a hundredth of a length")]
        let allowed = ((samples as f64 * OUTLIER_SHARE_MAX) as usize).max(1);
        match self.outliers.first() {
            Some(&first) if self.outliers.len() > allowed => {
                Err(TareError::Outliers { outliers: self.outliers.len(), samples, allowed, t: self.readings[first].t })
            }
            _ => Ok(()),
        }
    }

    fn judge_noise(&self, limit: f64) -> Result<(), TareError> {
        for (axis, variance) in [('x', self.single.covariance.m11), ('y', self.single.covariance.m22)] {
            let sd = variance.sqrt();
            if sd > limit {
                return Err(TareError::Noisy { axis, sd, limit });
            }
        }
        Ok(())
    }

    fn tare(&self) -> Tare {
        let line = Change::line(&self.blocks);
        Tare {
            bias: mean(&self.forces).unwrap_or_default(),
            bias_covariance: self.bias_covariance(&line),
            sample_covariance: self.sample.covariance,
            single_covariance: self.single.covariance,
            averaging_samples: self.window,
            freedom: self.sample.freedom,
            drift: line.size / (self.t_to() - self.t_from()),
            samples: self.readings.len(),
            outliers: self.outliers.len(),
            t_from: self.t_from(),
            t_to: self.t_to(),
            period: self.period,
        }
    }

    /// Scatter of the block means over their number; never less than white noise would leave, since few blocks may
    /// agree by chance. A drift that is real but small makes the bias differ by half of it at the stretch's end.
    fn bias_covariance(&self, line: &Change) -> Matrix2<f64> {
        let blocks = self.blocks.len() as f64;
        let scatter = noise::of_values(&self.blocks).map_or(Matrix2::zeros(), |s| s.covariance / blocks);
        let white = self.single.covariance / self.forces.len() as f64;
        let of_mean = if scatter.trace() > white.trace() { scatter } else { white };
        let half_drift = if line.t > SIGNIFICANT_T { line.size / 2.0 } else { Vector2::zeros() };
        of_mean + half_drift * half_drift.transpose()
    }
}

/// A change of the force along the stretch, fitted to the block means.
struct Change {
    /// Change from the first block to the last (line) or from before to after (step).
    size: Vector2<f64>,
    /// Student t of the axis where it is clearest.
    t: f64,
    /// Sum of squares that the fit leaves over.
    left_over: f64,
    /// First block after the step; `None` for a line.
    block: Option<usize>,
}

impl Change {
    /// The change along a least-squares line through the block means.
    fn line(blocks: &[Vector2<f64>]) -> Self {
        let n = blocks.len() as f64;
        let centre: Vector2<f64> = mean(blocks).unwrap_or_default();
        let at = |i: usize| i as f64 - (n - 1.0) / 2.0;
        let spread = n * (n * n - 1.0) / 12.0;
        let slope: Vector2<f64> =
            blocks.iter().enumerate().map(|(i, b)| (b - centre) * at(i)).sum::<Vector2<f64>>() / spread;
        let left = left_over(blocks, |i| centre + slope * at(i));
        let error = |left: f64| (left / (n - 2.0) / spread).sqrt();
        Self { size: slope * n, t: student(&slope, &left.map(error)), left_over: left.sum(), block: None }
    }

    /// The step that leaves least over.
    fn step(blocks: &[Vector2<f64>]) -> Self {
        let best = (1..blocks.len()).map(|block| Self::step_at(blocks, block));
        let none = Self { size: Vector2::zeros(), t: 0.0, left_over: f64::INFINITY, block: None };
        best.fold(none, |best, step| if step.left_over < best.left_over { step } else { best })
    }

    fn step_at(blocks: &[Vector2<f64>], block: usize) -> Self {
        let side = |blocks: &[Vector2<f64>]| mean(blocks).unwrap_or_default();
        let (before, after) = (side(&blocks[..block]), side(&blocks[block..]));
        let left = left_over(blocks, |i| if i < block { before } else { after });
        let (n, n_before) = (blocks.len() as f64, block as f64);
        let weight = 1.0 / n_before + 1.0 / (n - n_before);
        let error = |left: f64| (left / (n - 2.0) * weight).sqrt();
        let size = after - before;
        Self { size, t: student(&size, &left.map(error)), left_over: left.sum(), block: Some(block) }
    }
}

/// Per axis, the sum of squares that `fit` leaves over.
fn left_over(blocks: &[Vector2<f64>], fit: impl Fn(usize) -> Vector2<f64>) -> Vector2<f64> {
    blocks.iter().enumerate().map(|(i, block)| (block - fit(i)).map(|d| d * d)).sum()
}

/// The larger of the axes' `|value|/error`; 0/0 counts as 0.
fn student(value: &Vector2<f64>, error: &Vector2<f64>) -> f64 {
    value.iter().zip(error.iter()).map(|(v, e)| if *v == 0.0 { 0.0 } else { v.abs() / e }).fold(0.0, f64::max)
}

fn check_order(readings: &[Reading]) -> Result<(), TareError> {
    if let Some(bad) = readings.iter().find(|reading| !reading.is_finite()) {
        return Err(TareError::NotFinite { t: bad.t });
    }
    match readings.windows(2).find(|pair| pair[1].t <= pair[0].t) {
        Some(pair) => Err(TareError::NotInOrder { t: pair[0].t }),
        None => Ok(()),
    }
}

/// Median time between readings, s; `None` of fewer than two.
#[must_use]
pub fn period(readings: &[Reading]) -> Option<f64> {
    let steps: Vec<f64> = readings.windows(2).map(|pair| pair[1].t - pair[0].t).collect();
    median(steps)
}

fn duration(readings: &[Reading]) -> f64 {
    match (readings.first(), readings.last()) {
        (Some(first), Some(last)) => last.t - first.t,
        _ => 0.0,
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped before")]
fn block_count(duration: f64, samples: usize) -> usize {
    let by_time = (duration / BLOCK_S).clamp(BLOCKS_MIN as f64, BLOCKS_MAX as f64) as usize;
    by_time.min(samples / BLOCK_READINGS_MIN)
}

/// The forces with outliers pulled in, per axis, and the numbers of the readings that were outliers.
fn pull_in(readings: &[Reading]) -> Result<(Vec<Vector2<f64>>, Vec<usize>), TareError> {
    let (x, y) = (Range::of(readings, 0)?, Range::of(readings, 1)?);
    let pulled: Vec<_> =
        readings.iter().map(|r| Vector2::new(x.clamp(r.force_finger.x), y.clamp(r.force_finger.y))).collect();
    let outliers = (0..readings.len()).filter(|&i| pulled[i] != readings[i].force_finger).collect();
    Ok((pulled, outliers))
}

/// Where one axis's readings at rest may lie.
struct Range {
    centre: f64,
    half_width: f64,
}

impl Range {
    fn of(readings: &[Reading], axis: usize) -> Result<Self, TareError> {
        let values: Vec<f64> = readings.iter().map(|reading| reading.force_finger[axis]).collect();
        let centre = median(values.iter().copied()).unwrap_or(f64::NAN);
        let distances: Vec<f64> = values.iter().map(|value| (value - centre).abs()).collect();
        let name = if axis == 0 { 'x' } else { 'y' };
        if distances.iter().all(|&distance| distance == 0.0) {
            return Err(TareError::Stuck { axis: name, value: centre, samples: values.len() });
        }
        let robust = MAD_TO_SD * median(distances.iter().copied()).unwrap_or(0.0);
        // Coarse steps of the converter can make the median distance 0: then the plain standard deviation.
        let plain = (distances.iter().map(|d| d * d).sum::<f64>() / values.len() as f64).sqrt();
        let sd = if robust > 0.0 { robust } else { plain };
        Ok(Self { centre, half_width: OUTLIER_SIGMAS * sd })
    }

    fn clamp(&self, value: f64) -> f64 {
        value.clamp(self.centre - self.half_width, self.centre + self.half_width)
    }
}

#[cfg(test)]
mod tests {
    use super::super::test_noise::{Noise, Random};
    use super::*;

    const SIGMA: f64 = 0.005;

    fn plain() -> TareSettings {
        TareSettings::default()
    }

    #[test]
    fn the_stated_covariance_of_the_bias_is_the_one_it_has() {
        // 400 tares: the mean square in sigmas is 2 with a standard error of 2/√400 = 0.1; four of those, and
        // the estimate of the covariance itself, from 32 blocks, makes the ratio 7 % larger on average.
        let mut sum = 0.0;
        for seed in 0..400 {
            let mut noise = Noise::white(seed, SIGMA);
            let tare = Tare::estimate(&noise.readings(200), &plain()).unwrap();
            sum += noise::mahalanobis(&(tare.bias - noise.bias), &tare.bias_covariance).powi(2);
        }
        let mean_square = sum / 400.0;
        assert!((1.4..2.5).contains(&mean_square), "{mean_square}, wanted 2");
    }

    #[test]
    fn slow_noise_makes_the_bias_as_uncertain_as_it_says() {
        // Noise that forgets itself in 10 ms: a second holds 50 independent values, not 1000. Blocks of 31 ms are not
        // quite independent either, which makes up for the 7 % that 32 blocks cost.
        let mut sum = 0.0;
        for seed in 0..400 {
            let mut noise = Noise { red: SIGMA, ..Noise::white(seed, 0.1 * SIGMA) };
            let tare = Tare::estimate(&noise.readings(1000), &plain()).unwrap();
            sum += noise::mahalanobis(&(tare.bias - noise.bias), &tare.bias_covariance).powi(2);
        }
        let mean_square = sum / 400.0;
        // σ/√N would make it 40.
        assert!((1.6..3.6).contains(&mean_square), "{mean_square}, wanted 2 to 3");
    }

    #[test]
    fn a_drift_that_is_accepted_counts_in_the_bias_s_uncertainty() {
        let mut noise = Noise { drift: 0.006, ..Noise::white(2, SIGMA) };
        let tare = Tare::estimate(&noise.readings(1000), &plain()).unwrap();
        let at_the_end = noise.bias + Vector2::new(0.006, 0.0);
        let sigmas = noise::mahalanobis(&(tare.bias - at_the_end), &tare.bias_covariance);
        assert!(sigmas < 2.0, "{sigmas} standard deviations; 10 without the drift");
        assert!((tare.drift.x - 0.006).abs() < 0.001, "{}", tare.drift);
    }

    #[test]
    fn hum_does_not_make_the_stated_noise_too_small() {
        let mut noise = Noise { hum: 0.01, ..Noise::white(8, SIGMA) }.sampled(4000.0);
        let settings = TareSettings { averaging: Averaging::Seconds(0.01), ..plain() };
        let tare = Tare::estimate(&noise.readings(4000), &settings).unwrap();
        // Half a period of hum: amplitude·(2/π)/√2 on each axis.
        assert!((tare.sample_sd() / 0.0045 - 1.0).abs() < 0.1, "{}", tare.sample_sd());
        assert!(tare.effective_samples() < 5.0, "40 readings are worth {}", tare.effective_samples());
        let whole = TareSettings { averaging: Averaging::Seconds(0.02), ..plain() };
        let tare = Tare::estimate(&noise.readings(4000), &whole).unwrap();
        assert!(tare.effective_samples() > 80.0, "hum is gone: worth {}", tare.effective_samples());
    }

    #[test]
    fn quiet_stretches_are_hardly_ever_refused() {
        let refused = (20..520)
            .filter(|&n| Tare::estimate(&Noise::white(n as u64, SIGMA).readings(n), &plain()).is_err())
            .count();
        // At 1 kHz, those of up to 160 readings are shorter than 0.16 s.
        let too_short = (20..520).filter(|&n| n <= 160).count();
        assert_eq!(refused, too_short);
    }

    #[test]
    fn a_touch_inside_the_stretch_is_refused_as_a_step() {
        let mut readings = Noise::white(1, SIGMA).readings(400);
        for reading in &mut readings[320..] {
            reading.force_finger.y += 0.1;
        }
        match Tare::estimate(&readings, &plain()) {
            Err(TareError::Step { change, t, .. }) => {
                assert!((change - 0.1).abs() < 0.09, "{change}");
                assert!((t - 0.32).abs() < 0.03, "{t}");
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_touch_in_the_last_twentieth_is_refused() {
        for seed in 0..50 {
            let mut readings = Noise::white(seed, SIGMA).readings(400);
            for reading in &mut readings[380..] {
                reading.force_finger.x += 0.05;
            }
            let answer = Tare::estimate(&readings, &plain());
            assert!(answer.is_err(), "seed {seed}: {answer:?}");
        }
    }

    #[test]
    fn drift_is_refused_with_its_size() {
        let mut noise = Noise { drift: 0.05, ..Noise::white(2, SIGMA) };
        match Tare::estimate(&noise.readings(1000), &plain()) {
            Err(TareError::Drift { change, limit, .. }) => {
                assert!((change - 0.05).abs() < 0.003, "{change}");
                assert!(limit < change);
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_few_spikes_neither_refuse_nor_move_the_bias() {
        let mut noise = Noise::white(3, SIGMA);
        let mut readings = noise.readings(1000);
        for i in [100, 333, 800] {
            readings[i].force_finger.x += 50.0;
        }
        let tare = Tare::estimate(&readings, &plain()).unwrap();
        assert_eq!(tare.outliers, 3);
        // 4 standard deviations of a mean of 1000.
        assert!((tare.bias - noise.bias).norm() < 4.0 * SIGMA / 1000_f64.sqrt(), "{:?}", tare.bias);
    }

    #[test]
    fn each_kind_of_bad_stretch_has_its_own_error() {
        let quiet = Noise::white(4, SIGMA).readings(400);
        let estimate = |readings: &[Reading], settings: &TareSettings| Tare::estimate(readings, settings).unwrap_err();
        let spoil = |change: &dyn Fn(usize, &mut Reading)| {
            let mut readings = quiet.clone();
            readings.iter_mut().enumerate().for_each(|(i, reading)| change(i, reading));
            estimate(&readings, &plain())
        };
        assert!(matches!(estimate(&[], &plain()), TareError::TooFew { samples: 0, .. }));
        assert!(matches!(estimate(&quiet[..100], &plain()), TareError::TooShort { .. }));
        let averaging = TareSettings { averaging: Averaging::Samples(100), ..plain() };
        assert!(matches!(estimate(&quiet, &averaging), TareError::TooFew { needed: 800, .. }));
        let noisy = TareSettings { noise_max: Some(0.001), ..plain() };
        assert!(matches!(estimate(&quiet, &noisy), TareError::Noisy { axis: 'x', .. }));
        assert!(matches!(spoil(&|_, r| r.force_finger.y = 0.5), TareError::Stuck { axis: 'y', .. }));
        assert!(matches!(spoil(&|i, r| r.t = if i == 9 { 0.0 } else { r.t }), TareError::NotInOrder { .. }));
        let nan = |i: usize, r: &mut Reading| r.force_finger.x = if i == 9 { f64::NAN } else { r.force_finger.x };
        assert!(matches!(spoil(&nan), TareError::NotFinite { .. }));
        let spikes = |i: usize, r: &mut Reading| r.force_finger.x += if i % 40 == 7 { 1.0 } else { 0.0 };
        assert!(matches!(spoil(&spikes), TareError::Outliers { outliers: 10, allowed: 4, .. }));
    }

    #[test]
    fn a_tare_written_to_toml_reads_back_the_same() {
        let tare = Tare::estimate(&Noise::white(6, SIGMA).readings(400), &plain()).unwrap();
        let text = toml::to_string(&tare).unwrap();
        assert_eq!(toml::from_str::<Tare>(&text).unwrap(), tare, "{text}");
    }

    #[test]
    fn coarse_converter_steps_are_not_mistaken_for_outliers() {
        let mut random = Random(7);
        let coarse = |random: &mut Random| if random.uniform() < 0.2 { 0.01 } else { 0.0 };
        let readings: Vec<_> = (0..400)
            .map(|i| Reading::new(f64::from(i) * 1e-3, Vector2::new(coarse(&mut random), coarse(&mut random))))
            .collect();
        let tare = Tare::estimate(&readings, &plain()).unwrap();
        assert_eq!(tare.outliers, 0);
    }
}
