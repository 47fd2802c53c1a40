//! One dwell: decides from the stream of samples whether the finger is at rest, and takes the mean when it is.
//!
//! Samples are averaged over whole mains periods, so that hum cancels whatever its phase. A window of such means slides
//! along; the first window in which nothing moves is taken. What does not come to rest in time is refused with the
//! number that kept it from resting: a drift, a step, a swing, a load that slips or falls off, lost samples.
//!
//! Directions are judged in counts, before any matrix is known: gains that differ by a fifth make an angle there wrong
//! by at most a fifth of itself, which is enough to say whether something moves.
//!
//! Assumes: samples evenly spaced at the stated rate. Frames: counts (x, y). Units: counts, microstrain, s, degrees in
//! messages. Errors: [`Refusal`]. No clock: time is the number of samples.

use std::collections::VecDeque;

use nalgebra::{Matrix2, Vector2};
use palpate_shared::units::Counts;
use thiserror::Error;

use super::fit::CONTACT_ANGLE_SIGMA_MAX;
use super::force::DwellReading;
use super::front_end::{FrontEnd, counts_vector};
use super::measurements::Fixture;
use super::steadiness::Rest;
use crate::finger::{STUCK_SAMPLES, Samples};
use crate::math::angle::direction_variance;
use crate::math::statistics::mean;

/// Largest turn of a contact's direction between the halves of a dwell, degrees: half the bar for a mean.
pub const TURN_MAX_DEG: f64 = 0.1;

/// Largest change of a contact's size between the halves of a dwell, per cent.
pub const SIZE_CHANGE_MAX_PERCENT: f64 = 0.5;

/// Largest change of an unloaded reading between the halves of a dwell, microstrain: 0.1° of a 2 N contact.
pub const TARE_CHANGE_MAX_MICROSTRAIN: f64 = 0.17;

/// Load below which a contact counts as none, microstrain: 0.02 N on the default finger, ten times a tare's error.
pub(super) const NO_LOAD_MICROSTRAIN: f64 = 1.0;

/// Share of the largest load seen in a dwell below which it has been taken away.
const REMOVED_SHARE: f64 = 0.25;

/// Time at the end of the range after which a dwell is given up, s; a knock while a weight is hung is shorter.
const SATURATED_MAX_S: f64 = 0.1;

/// Relative difference between stated and measured sampling rate from which block means no longer cancel hum.
const RATE_TOLERANCE: f64 = 0.02;

/// Longest dwell, s: beyond it the drift of a room decides, and memory.
const DURATION_MAX_S: f64 = 600.0;

/// Fewest block means that tell noise from movement.
const BLOCKS_MIN: usize = 8;

/// At most this many mains periods make a block: enough for one whole number of samples at 60 Hz and 4 kHz (3).
const PERIODS_MAX: u32 = 12;

/// Samples by which a block may miss a whole number of mains periods, relative to the block.
const PERIOD_MISFIT: f64 = 1e-3;

/// How a dwell is taken.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DwellSettings {
    /// Stated sampling rate, Hz.
    pub rate_hz: f64,
    /// Mains frequency, Hz (50 or 60).
    pub mains_hz: f64,
    /// Length of the window that is averaged, s.
    pub duration_s: f64,
    /// How long to wait for a window at rest, s.
    pub patience_s: f64,
    /// Drift to be expected between a reading and its tare, standard deviation, counts.
    pub drift_sigma: f64,
    /// Gain, excitation and gauges: what turns counts into strain.
    pub front_end: FrontEnd,
}

impl DwellSettings {
    /// One second at rest, as long as a weight on a 25 cm thread takes for one swing, within half a minute.
    #[must_use]
    pub fn new(front_end: FrontEnd, rate_hz: f64) -> Self {
        let drift_sigma = Fixture::of_a_dividing_head(front_end.microstrain_per_count()).drift_sigma;
        Self { rate_hz, mains_hz: 50.0, duration_s: 1.0, patience_s: 30.0, drift_sigma, front_end }
    }

    /// Checks what comes from outside.
    ///
    /// # Errors
    /// A quantity that is not positive and finite, or a window too short for eight blocks of whole mains periods.
    pub fn check(&self) -> Result<(), DwellSettingsError> {
        let positive = [
            ("sampling rate in Hz", self.rate_hz),
            ("mains frequency in Hz", self.mains_hz),
            ("dwell in s", self.duration_s),
            ("patience in s", self.patience_s),
        ];
        if let Some(&(name, value)) =
            positive.iter().find(|(_, value)| !(value.is_finite() && *value > 0.0 && *value < 1e6))
        {
            return Err(DwellSettingsError::Impossible { name, value });
        }
        if self.duration_s > DURATION_MAX_S {
            return Err(DwellSettingsError::Impossible {
                name: "dwell in s (at most ten minutes)",
                value: self.duration_s,
            });
        }
        if self.patience_s < self.duration_s {
            return Err(DwellSettingsError::Impossible {
                name: "patience in s (at least the dwell)",
                value: self.patience_s,
            });
        }
        if self.rate_hz < 2.0 * self.mains_hz {
            return Err(DwellSettingsError::Impossible {
                name: "sampling rate in Hz (at least twice the mains')",
                value: self.rate_hz,
            });
        }
        let needed_s = (BLOCKS_MIN * self.block_samples()) as f64 / self.rate_hz;
        // Half a sample of slack: 0.16 s at 4 kHz are 640 samples only up to rounding.
        if self.duration_s + 0.5 / self.rate_hz < needed_s {
            return Err(DwellSettingsError::TooShort { duration_s: self.duration_s, needed_s });
        }
        Ok(())
    }

    /// Samples in the fewest whole mains periods that are a whole number of samples.
    fn block_samples(&self) -> usize {
        let period = self.rate_hz / self.mains_hz;
        let misfit = |periods: u32| {
            let samples = period * f64::from(periods);
            (samples - samples.round()).abs() / samples
        };
        let fits = (1..=PERIODS_MAX).find(|&periods| misfit(periods) < PERIOD_MISFIT);
        whole(period * f64::from(fits.unwrap_or(PERIODS_MAX)))
    }

    fn window_blocks(&self) -> usize {
        whole(self.duration_s * self.rate_hz) / self.block_samples()
    }
}

/// The nearest whole number of samples, at least 1.
pub(super) fn whole(samples: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, and a dwell is below 1e12 samples"
    )]
    let rounded = samples.round().max(1.0) as usize;
    rounded
}

/// Why settings for dwells are refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum DwellSettingsError {
    /// Not a quantity that can be.
    #[error("the {name} is {value}, which cannot be")]
    Impossible {
        /// Which of the settings.
        name: &'static str,
        /// The setting as given.
        value: f64,
    },
    /// Too short to tell movement from noise.
    #[error("a dwell of {duration_s} s is too short: {BLOCKS_MIN} blocks of whole mains periods take {needed_s} s")]
    TooShort {
        /// Length of the dwell as set, s.
        duration_s: f64,
        /// Least length for these blocks, s.
        needed_s: f64,
    },
}

/// One sample as it is kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RawSample {
    /// Number counted by the device.
    pub seq: u64,
    /// Device time, µs.
    pub t_us: u64,
    /// Counts of both bridges.
    pub counts: [Counts; 2],
}

/// What is being measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Expected {
    /// Nothing touches the disk.
    Nothing,
    /// A load, to be compared with this unloaded reading in counts.
    Load {
        /// The unloaded reading, counts.
        tare: Vector2<f64>,
    },
}

/// A dwell that was accepted.
#[derive(Clone, Debug, PartialEq)]
pub struct Dwell {
    /// Mean with its covariance.
    pub reading: DwellReading,
    /// The samples it is the mean of, without a gap.
    pub samples: Vec<RawSample>,
    /// Noise of a single sample on each bridge (hum and drift included), microstrain rms.
    pub noise_microstrain: [f64; 2],
    /// Time from the first sample seen to the last, s.
    pub waited_s: f64,
    /// Samples that were missing while waiting.
    pub lost: u64,
}

/// How far something moved between the halves of a dwell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DwellChange {
    /// Of an unloaded reading.
    Tare {
        /// By how much, microstrain.
        microstrain: f64,
    },
    /// Of a reading in contact.
    Contact {
        /// Turn of its direction in counts, degrees.
        turn_deg: f64,
        /// Change of its size, per cent.
        size_percent: f64,
    },
}

impl DwellChange {
    /// Share of the limit that is used up; above 1 it is too much.
    pub(super) fn of_limit(&self) -> f64 {
        match *self {
            Self::Tare { microstrain } => microstrain.abs() / TARE_CHANGE_MAX_MICROSTRAIN,
            Self::Contact { turn_deg, size_percent } => {
                (turn_deg.abs() / TURN_MAX_DEG).max(size_percent.abs() / SIZE_CHANGE_MAX_PERCENT)
            }
        }
    }
}

impl std::fmt::Display for DwellChange {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Tare { microstrain } => {
                write!(f, "{microstrain:.2} microstrain (limit {TARE_CHANGE_MAX_MICROSTRAIN})")
            }
            Self::Contact { turn_deg, size_percent } => write!(
                f,
                "{turn_deg:+.2}° and {size_percent:+.2} % in size (limits {TURN_MAX_DEG}° and {SIZE_CHANGE_MAX_PERCENT} %)"
            ),
        }
    }
}

/// Why a dwell is refused.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum Refusal {
    /// The mean moved steadily.
    #[error("the reading drifts: {change} between the two halves of {seconds:.1} s")]
    Drifts {
        /// How far the mean moved between the halves of the dwell.
        change: DwellChange,
        /// Length of the dwell, s.
        seconds: f64,
    },
    /// The mean moved at once.
    #[error("the reading stepped by {change} after {at_s:.2} s of {seconds:.1} s")]
    Stepped {
        /// How far the mean moved.
        change: DwellChange,
        /// Time of the step since the dwell began, s.
        at_s: f64,
        /// Length of the dwell, s.
        seconds: f64,
    },
    /// The mean went to and fro.
    #[error("the reading swings by {change} within {seconds:.1} s")]
    Swings {
        /// How far, peak to peak.
        change: DwellChange,
        /// Length of the dwell, s.
        seconds: f64,
    },
    /// The load was there and went.
    #[error("the load went from {before_microstrain:.1} to {after_microstrain:.1} microstrain while sampling")]
    LoadRemoved {
        /// Largest load seen in the dwell, microstrain.
        before_microstrain: f64,
        /// Load at the end.
        after_microstrain: f64,
    },
    /// Nothing hangs on the finger.
    #[error("no load: {microstrain:.2} microstrain from the unloaded reading (at least {NO_LOAD_MICROSTRAIN} needed)")]
    NoLoad {
        /// Difference to the tare.
        microstrain: f64,
    },
    /// A load whose direction is lost in the noise.
    #[error("the load is too small: noise and drift leave its direction uncertain by {sigma_deg:.2}° (limit {limit_deg:.2}°)",
        limit_deg = CONTACT_ANGLE_SIGMA_MAX.to_degrees())]
    TooWeak {
        /// Standard deviation of the direction.
        sigma_deg: f64,
        /// By what to multiply the load.
        factor: f64,
    },
    /// A bridge at the end of its range.
    #[error("bridge {bridge} is saturated in sample {seq} (|counts| ≥ 8388607)")]
    Saturated {
        /// Which bridge, x or y.
        bridge: char,
        /// Number of the sample.
        seq: u64,
    },
    /// The same code over and over.
    #[error("bridge {bridge} gave the code {code} {STUCK_SAMPLES} times in a row, up to sample {seq}")]
    Stuck {
        /// Which bridge, x or y.
        bridge: char,
        /// The code that repeats, counts.
        code: i32,
        /// Where it was noticed.
        seq: u64,
    },
    /// Never a window without a gap.
    #[error("{lost} samples were lost in {waited_s:.1} s, never {needed_s:.1} s without a gap")]
    LostSamples {
        /// Samples that are missing from the dwell.
        lost: u64,
        /// Time waited until then, s.
        waited_s: f64,
        /// The gapless time needed.
        needed_s: f64,
    },
    /// Sample numbers went backwards.
    #[error("the device started anew: sample {after} came after sample {before}")]
    Restarted {
        /// Number of the last sample before.
        before: u64,
        /// Number of the first sample after.
        after: u64,
    },
    /// Samples do not come at the stated rate.
    #[error("samples come every {period_us:.2} µs, but {rate_hz} Hz were stated ({:.2} µs)", 1e6 / rate_hz)]
    WrongRate {
        /// Measured time between samples, µs.
        period_us: f64,
        /// Sampling rate as stated, Hz.
        rate_hz: f64,
    },
    /// The device reports a fault, in its own words.
    #[error("the device reports: {0}")]
    Trouble(String),
    /// Too few samples to judge anything.
    #[error("{samples} samples are not the {needed} of a whole dwell")]
    Incomplete {
        /// Samples that came.
        samples: usize,
        /// Samples of a whole dwell.
        needed: usize,
    },
}

/// What a watcher says after more samples.
#[derive(Clone, Debug, PartialEq)]
pub enum DwellVerdict {
    /// Keep on sampling; so far this keeps it from resting, if the window is full.
    NeedsMoreTime(Option<Refusal>),
    /// At rest: here is the mean.
    Accepted(Dwell),
    /// The dwell is given up, for this reason.
    Refused(Refusal),
}

/// Watches one dwell sample by sample until it is at rest or given up.
#[derive(Clone, Debug)]
pub struct Watcher {
    settings: DwellSettings,
    expected: Expected,
    /// Samples since the last gap, at most one window and one block.
    window: VecDeque<RawSample>,
    seen: u64,
    lost: u64,
    last_seq: Option<u64>,
    saturated: usize,
    equal_in_a_row: [usize; 2],
    largest_load: f64,
    reason: Option<Refusal>,
}

impl Watcher {
    /// Starts with no samples. The settings must have passed [`DwellSettings::check`].
    #[must_use]
    pub fn new(settings: DwellSettings, expected: Expected) -> Self {
        Self {
            settings,
            expected,
            window: VecDeque::new(),
            seen: 0,
            lost: 0,
            last_seq: None,
            saturated: 0,
            equal_in_a_row: [1; 2],
            largest_load: 0.0,
            reason: None,
        }
    }

    /// Takes the next samples; stops at the first that decides.
    pub fn push(&mut self, block: &Samples) -> DwellVerdict {
        let rate_hz = self.settings.rate_hz;
        if (block.period_us * rate_hz * 1e-6 - 1.0).abs() > RATE_TOLERANCE || !block.period_us.is_finite() {
            return DwellVerdict::Refused(Refusal::WrongRate { period_us: block.period_us, rate_hz });
        }
        for (index, &counts) in (0_u64..).zip(&block.counts) {
            let after_us = whole_us(block.period_us * index as f64);
            let sample = RawSample { seq: block.first + index, t_us: block.time_us + after_us, counts };
            match self.push_sample(sample) {
                DwellVerdict::NeedsMoreTime(_) => {}
                decided => return decided,
            }
        }
        DwellVerdict::NeedsMoreTime(self.reason.clone())
    }

    fn push_sample(&mut self, sample: RawSample) -> DwellVerdict {
        self.seen += 1;
        if let Err(refusal) = self.check_order(&sample).and_then(|()| self.check_codes(&sample)) {
            return DwellVerdict::Refused(refusal);
        }
        self.last_seq = Some(sample.seq);
        self.window.push_back(sample);
        let needed = self.settings.window_blocks() * self.settings.block_samples();
        if self.window.len() >= needed {
            if let Some(verdict) = self.judge() {
                return verdict;
            }
            self.window.drain(..self.settings.block_samples());
        }
        if self.waited_s() >= self.settings.patience_s {
            return DwellVerdict::Refused(self.why_never_at_rest());
        }
        DwellVerdict::NeedsMoreTime(self.reason.clone())
    }

    /// Counts a gap and starts a new window after it: a block across a gap would not cancel hum.
    fn check_order(&mut self, sample: &RawSample) -> Result<(), Refusal> {
        let Some(last) = self.last_seq else { return Ok(()) };
        if sample.seq <= last {
            return Err(Refusal::Restarted { before: last, after: sample.seq });
        }
        let missing = sample.seq - last - 1;
        if missing > 0 {
            self.lost += missing;
            self.window.clear();
        }
        Ok(())
    }

    fn check_codes(&mut self, sample: &RawSample) -> Result<(), Refusal> {
        let previous = self.window.back().map(|last| last.counts);
        for (axis, bridge) in ['x', 'y'].into_iter().enumerate() {
            let code = sample.counts[axis];
            let repeats = previous.is_some_and(|previous| previous[axis] == code) && !code.is_saturated();
            self.equal_in_a_row[axis] = if repeats { self.equal_in_a_row[axis] + 1 } else { 1 };
            if self.equal_in_a_row[axis] >= STUCK_SAMPLES {
                return Err(Refusal::Stuck { bridge, code: code.0, seq: sample.seq });
            }
        }
        let Some(axis) = sample.counts.iter().position(|code| code.is_saturated()) else { return Ok(()) };
        self.saturated += 1;
        self.window.clear();
        if self.saturated >= whole(SATURATED_MAX_S * self.settings.rate_hz) {
            return Err(Refusal::Saturated { bridge: ['x', 'y'][axis], seq: sample.seq });
        }
        Ok(())
    }

    fn waited_s(&self) -> f64 {
        let samples = (self.seen + self.lost) as f64;
        samples / self.settings.rate_hz
    }

    /// A verdict if the present window decides.
    fn judge(&mut self) -> Option<DwellVerdict> {
        let samples: Vec<RawSample> = self.window.iter().copied().collect();
        let judged = measure(&samples, &self.settings, self.expected);
        if let Some(removed) = self.notice_removal(&samples) {
            return Some(DwellVerdict::Refused(removed));
        }
        match judged {
            Ok(mut dwell) => {
                dwell.waited_s = self.waited_s();
                dwell.lost = self.lost;
                Some(DwellVerdict::Accepted(dwell))
            }
            Err(refusal) => {
                self.reason = Some(refusal);
                None
            }
        }
    }

    /// Compares the load in the newest block with the largest so far.
    fn notice_removal(&mut self, samples: &[RawSample]) -> Option<Refusal> {
        let Expected::Load { tare } = self.expected else { return None };
        let microstrain =
            |block: &[RawSample]| (mean_counts(block) - tare).norm() * self.settings.front_end.microstrain_per_count();
        let loads: Vec<f64> = samples.chunks_exact(self.settings.block_samples()).map(microstrain).collect();
        let load = loads.last().copied()?;
        self.largest_load = loads.into_iter().fold(self.largest_load, f64::max);
        let removed =
            self.largest_load >= NO_LOAD_MICROSTRAIN / REMOVED_SHARE && load < REMOVED_SHARE * self.largest_load;
        removed.then_some(Refusal::LoadRemoved { before_microstrain: self.largest_load, after_microstrain: load })
    }

    fn why_never_at_rest(&self) -> Refusal {
        let (lost, waited_s, needed_s) = (self.lost, self.waited_s(), self.settings.duration_s);
        self.reason.clone().unwrap_or(Refusal::LostSamples { lost, waited_s, needed_s })
    }
}

fn whole_us(time_us: f64) -> u64 {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a time within one block, not negative"
    )]
    let rounded = time_us.round().max(0.0) as u64;
    rounded
}

/// Mean of both bridges, counts; zero of no samples.
fn mean_counts(samples: &[RawSample]) -> Vector2<f64> {
    mean(samples.iter().map(|sample| counts_vector(sample.counts))).unwrap_or_default()
}

/// Judges exactly these samples, as the watcher does with its window; also for samples kept in a file.
///
/// # Errors
/// [`Refusal`] if the finger was not at rest, the load is missing or too weak, or samples are missing.
pub fn measure(samples: &[RawSample], settings: &DwellSettings, expected: Expected) -> Result<Dwell, Refusal> {
    let needed = settings.window_blocks() * settings.block_samples();
    if samples.len() < needed {
        return Err(Refusal::Incomplete { samples: samples.len(), needed });
    }
    let samples = &samples[..needed];
    check_sound(samples, settings)?;
    let blocks: Vec<Vector2<f64>> = samples.chunks_exact(settings.block_samples()).map(mean_counts).collect();
    let rest = Rest::new(settings, expected, &blocks);
    rest.check()?;
    let reading = rest.reading();
    if let Expected::Load { tare } = expected {
        check_load(&reading, tare, settings)?;
    }
    let waited_s = needed as f64 / settings.rate_hz;
    let noise_microstrain =
        sample_noise(samples, &reading).map(|sigma| sigma * settings.front_end.microstrain_per_count());
    Ok(Dwell { reading, samples: samples.to_vec(), noise_microstrain, waited_s, lost: 0 })
}

/// No gap, nothing saturated. The watcher has made sure of it; a file may have been edited.
fn check_sound(samples: &[RawSample], settings: &DwellSettings) -> Result<(), Refusal> {
    for pair in samples.windows(2) {
        if pair[1].seq <= pair[0].seq {
            return Err(Refusal::Restarted { before: pair[0].seq, after: pair[1].seq });
        }
        if pair[1].seq - pair[0].seq != 1 {
            let (lost, needed_s) = (pair[1].seq - pair[0].seq - 1, settings.duration_s);
            return Err(Refusal::LostSamples { lost, waited_s: needed_s, needed_s });
        }
    }
    for sample in samples {
        if let Some(axis) = sample.counts.iter().position(|code| code.is_saturated()) {
            return Err(Refusal::Saturated { bridge: ['x', 'y'][axis], seq: sample.seq });
        }
    }
    Ok(())
}

/// Standard deviation of a single sample on each bridge, counts.
fn sample_noise(samples: &[RawSample], reading: &DwellReading) -> [f64; 2] {
    let squares: Vector2<f64> = samples
        .iter()
        .map(|sample| (counts_vector(sample.counts) - reading.counts).map(|deviation| deviation * deviation))
        .sum();
    let free = samples.len().saturating_sub(1).max(1) as f64;
    [(squares.x / free).sqrt(), (squares.y / free).sqrt()]
}

fn check_load(reading: &DwellReading, tare: Vector2<f64>, settings: &DwellSettings) -> Result<(), Refusal> {
    let load = reading.counts - tare;
    let microstrain = load.norm() * settings.front_end.microstrain_per_count();
    if microstrain < NO_LOAD_MICROSTRAIN {
        return Err(Refusal::NoLoad { microstrain });
    }
    let drift = Matrix2::identity() * settings.drift_sigma.powi(2);
    let sigma = direction_variance(load, &(reading.covariance + drift)).sqrt();
    if sigma > CONTACT_ANGLE_SIGMA_MAX {
        return Err(Refusal::TooWeak { sigma_deg: sigma.to_degrees(), factor: sigma / CONTACT_ANGLE_SIGMA_MAX });
    }
    Ok(())
}
