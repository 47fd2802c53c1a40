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
use super::force::{Reading, direction_variance};
use super::front_end::{FrontEnd, counts_vector};
use super::start::median;

/// Largest turn of a contact's direction between the halves of a dwell, degrees: half the bar for a mean.
pub const TURN_MAX_DEG: f64 = 0.1;

/// Largest change of a contact's size between the halves of a dwell, per cent.
pub const SIZE_CHANGE_MAX_PERCENT: f64 = 0.5;

/// Largest change of an unloaded reading between the halves of a dwell, microstrain: 0.1° of a 2 N contact.
pub const TARE_CHANGE_MAX_MICROSTRAIN: f64 = 0.17;

/// A change below this many of its standard deviations is chance: one dwell in 16 000 for each axis.
const SIGNIFICANT: f64 = 4.0;

/// Load below which a contact counts as none, microstrain: 0.02 N on the default finger, ten times a tare's error.
const NO_LOAD_MICROSTRAIN: f64 = 1.0;

/// Share of the largest load seen in a dwell below which it has been taken away.
const REMOVED_SHARE: f64 = 0.25;

/// Equal codes in a row that noise never gives (its standard deviation is some 270 codes): 8 ms at 4 kHz.
const STUCK_SAMPLES: usize = 32;

/// Time at the end of the range after which a dwell is given up, s; a knock while a weight is hung is shorter.
const SATURATED_MAX_S: f64 = 0.1;

/// Relative difference between stated and measured sampling rate from which block means no longer cancel hum.
const RATE_TOLERANCE: f64 = 0.02;

/// Fewest block means that tell noise from movement.
const BLOCKS_MIN: usize = 8;

/// At most this many mains periods make a block: enough for one whole number of samples at 60 Hz and 4 kHz (3).
const PERIODS_MAX: u32 = 12;

/// Samples by which a block may miss a whole number of mains periods, relative to the block.
const PERIOD_MISFIT: f64 = 1e-3;

/// Median of χ² with one degree of freedom.
const CHI2_MEDIAN: f64 = 0.4549;

/// Variance of a rounded code, counts²: keeps noise-free samples from claiming perfect means.
const ROUNDING_VARIANCE: f64 = 1.0 / 12.0;

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
    /// What counts mean.
    pub front_end: FrontEnd,
}

impl DwellSettings {
    /// One second at rest, as long as a weight on a 25 cm thread takes for one swing, within half a minute.
    #[must_use]
    pub fn new(front_end: FrontEnd, rate_hz: f64) -> Self {
        Self { rate_hz, mains_hz: 50.0, duration_s: 1.0, patience_s: 30.0, front_end }
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
        if self.rate_hz < 2.0 * self.mains_hz {
            return Err(DwellSettingsError::Impossible {
                name: "sampling rate in Hz (at least twice the mains')",
                value: self.rate_hz,
            });
        }
        #[expect(clippy::cast_precision_loss, reason = "a few thousand samples")]
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
fn whole(samples: f64) -> usize {
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "positive, and a dwell is below 1e12 samples"
    )]
    let rounded = samples.round().max(1.0) as usize;
    rounded
}

/// Why settings for dwells are refused.
#[derive(Clone, Copy, Debug, PartialEq, Error, miette::Diagnostic)]
pub enum DwellSettingsError {
    /// Not a quantity that can be.
    #[error("the {name} is {value}, which is not above 0 and finite")]
    #[diagnostic(help("50 or 60 Hz mains, 1 s dwell and 4000 Hz are usual"))]
    Impossible {
        /// Which one.
        name: &'static str,
        /// Its value.
        value: f64,
    },
    /// Too short to tell movement from noise.
    #[error("a dwell of {duration_s} s is too short: {BLOCKS_MIN} blocks of whole mains periods take {needed_s} s")]
    #[diagnostic(help("make the dwell at least {needed_s} s"))]
    TooShort {
        /// Given.
        duration_s: f64,
        /// Needed.
        needed_s: f64,
    },
}

/// Samples in a row as they come from the device.
#[derive(Clone, Debug, PartialEq)]
pub struct SampleBlock {
    /// Number of the first sample, counted by the device without wrap.
    pub first: u64,
    /// Device time of the first sample, µs, without wrap.
    pub time_us: u64,
    /// Time between samples, µs.
    pub period_us: f64,
    /// Counts of both bridges.
    pub counts: Vec<[Counts; 2]>,
    /// What the device says is wrong with them, in words for the person at the bench.
    pub trouble: Option<String>,
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
        /// The tare.
        tare: Vector2<f64>,
    },
}

/// A dwell that was accepted.
#[derive(Clone, Debug, PartialEq)]
pub struct Dwell {
    /// Mean with its covariance.
    pub reading: Reading,
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
pub enum Change {
    /// An unloaded reading.
    Tare {
        /// By how much, microstrain.
        microstrain: f64,
    },
    /// A contact.
    Contact {
        /// Turn of its direction in counts, degrees.
        turn_deg: f64,
        /// Change of its size, per cent.
        size_percent: f64,
    },
}

impl Change {
    /// Share of the limit that is used up; above 1 it is too much.
    fn of_limit(&self) -> f64 {
        match *self {
            Self::Tare { microstrain } => microstrain.abs() / TARE_CHANGE_MAX_MICROSTRAIN,
            Self::Contact { turn_deg, size_percent } => {
                (turn_deg.abs() / TURN_MAX_DEG).max(size_percent.abs() / SIZE_CHANGE_MAX_PERCENT)
            }
        }
    }
}

impl std::fmt::Display for Change {
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
#[derive(Clone, Debug, PartialEq, Error, miette::Diagnostic)]
pub enum Refusal {
    /// A steady trend.
    #[error("the reading drifts: {change} between the two halves of {seconds:.1} s")]
    #[diagnostic(help(
        "let the finger warm up for ten minutes away from draughts; if loaded, see that nothing creeps or slips"
    ))]
    Drifts {
        /// How far.
        change: Change,
        /// Over what time.
        seconds: f64,
    },
    /// A jump.
    #[error("the reading stepped by {change} after {at_s:.2} s of {seconds:.1} s")]
    #[diagnostic(help(
        "something slipped or was touched: settle the load and do not touch the bench while it samples"
    ))]
    Stepped {
        /// How far.
        change: Change,
        /// When.
        at_s: f64,
        /// Within what time.
        seconds: f64,
    },
    /// To and fro.
    #[error("the reading swings by {change} within {seconds:.1} s")]
    #[diagnostic(help("let the weight come to rest; a shorter thread or a finger under the weight damps it"))]
    Swings {
        /// How far, peak to peak.
        change: Change,
        /// Within what time.
        seconds: f64,
    },
    /// The load was there and went.
    #[error("the load went from {before_microstrain:.1} to {after_microstrain:.1} microstrain while sampling")]
    #[diagnostic(help("hang the weight again and leave it until the step is accepted"))]
    LoadRemoved {
        /// Largest load seen.
        before_microstrain: f64,
        /// Load at the end.
        after_microstrain: f64,
    },
    /// Nothing hangs on the finger.
    #[error("no load: {microstrain:.2} microstrain from the unloaded reading (at least {NO_LOAD_MICROSTRAIN} needed)")]
    #[diagnostic(help("hang the weight or press the finger before going on"))]
    NoLoad {
        /// Difference to the tare.
        microstrain: f64,
    },
    /// A load whose direction is lost in the noise.
    #[error("the load is too small: noise leaves its direction uncertain by {sigma_deg:.2}° (limit {limit_deg:.2}°)",
        limit_deg = CONTACT_ANGLE_SIGMA_MAX.to_degrees())]
    #[diagnostic(help("use {factor:.1} times the load, or a dwell {:.0} times as long", (factor * factor).ceil()))]
    TooWeak {
        /// Standard deviation of the direction.
        sigma_deg: f64,
        /// By what to multiply the load.
        factor: f64,
    },
    /// A bridge at the end of its range.
    #[error("bridge {bridge} is saturated in sample {seq} (|counts| ≥ 8388607)")]
    #[diagnostic(help("lower the gain or the load; if nothing is loaded, look for a torn gauge or a loose wire"))]
    Saturated {
        /// Which bridge, x or y.
        bridge: char,
        /// Which sample.
        seq: u64,
    },
    /// The same code over and over.
    #[error("bridge {bridge} gave the code {code} {STUCK_SAMPLES} times in a row, up to sample {seq}")]
    #[diagnostic(help("a live bridge is never that quiet: check its wiring and run palpate diagnose"))]
    Stuck {
        /// Which bridge, x or y.
        bridge: char,
        /// The code.
        code: i32,
        /// Where it was noticed.
        seq: u64,
    },
    /// Never a window without a gap.
    #[error("{lost} samples were lost in {waited_s:.1} s, never {needed_s:.1} s without a gap")]
    #[diagnostic(help("use a shorter cable or a faster link; palpate diagnose shows where samples are lost"))]
    LostSamples {
        /// How many.
        lost: u64,
        /// In what time.
        waited_s: f64,
        /// The gapless time needed.
        needed_s: f64,
    },
    /// Sample numbers went backwards.
    #[error("the device started anew: sample {after} came after sample {before}")]
    #[diagnostic(help("check the supply and the cable, then repeat this step"))]
    Restarted {
        /// Last number before.
        before: u64,
        /// First number after.
        after: u64,
    },
    /// Samples do not come at the stated rate.
    #[error("samples come every {period_us:.2} µs, but {rate_hz} Hz were stated ({:.2} µs)", 1e6 / rate_hz)]
    #[diagnostic(help("state the rate the device runs at (palpate info)"))]
    WrongRate {
        /// Measured.
        period_us: f64,
        /// Stated.
        rate_hz: f64,
    },
    /// The device complains.
    #[error("the device reports: {0}")]
    #[diagnostic(help("palpate diagnose tells more"))]
    Trouble(String),
    /// Too few samples to judge anything.
    #[error("{samples} samples are not the {needed} of a whole dwell")]
    #[diagnostic(help("the raw file is cut short; take the data again"))]
    Incomplete {
        /// There.
        samples: usize,
        /// Needed.
        needed: usize,
    },
}

/// What a watcher says after more samples.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// Keep on sampling; so far this keeps it from resting, if the window is full.
    NeedsMoreTime(Option<Refusal>),
    /// At rest: here is the mean.
    Accepted(Dwell),
    /// Given up.
    Refused(Refusal),
}

/// Watches one dwell.
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
    pub fn push(&mut self, block: &SampleBlock) -> Verdict {
        if let Some(trouble) = &block.trouble {
            return Verdict::Refused(Refusal::Trouble(trouble.clone()));
        }
        let rate_hz = self.settings.rate_hz;
        if (block.period_us * rate_hz * 1e-6 - 1.0).abs() > RATE_TOLERANCE || !block.period_us.is_finite() {
            return Verdict::Refused(Refusal::WrongRate { period_us: block.period_us, rate_hz });
        }
        for (index, &counts) in (0_u64..).zip(&block.counts) {
            #[expect(clippy::cast_precision_loss, reason = "an index within a block")]
            let after_us = whole_us(block.period_us * index as f64);
            let sample = RawSample { seq: block.first + index, t_us: block.time_us + after_us, counts };
            match self.push_sample(sample) {
                Verdict::NeedsMoreTime(_) => {}
                decided => return decided,
            }
        }
        Verdict::NeedsMoreTime(self.reason.clone())
    }

    fn push_sample(&mut self, sample: RawSample) -> Verdict {
        self.seen += 1;
        if let Err(refusal) = self.check_order(&sample).and_then(|()| self.check_codes(&sample)) {
            return Verdict::Refused(refusal);
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
            return Verdict::Refused(self.why_never_at_rest());
        }
        Verdict::NeedsMoreTime(self.reason.clone())
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
        #[expect(clippy::cast_precision_loss, reason = "a dwell is far below 2^52 samples")]
        let samples = (self.seen + self.lost) as f64;
        samples / self.settings.rate_hz
    }

    /// A verdict if the present window decides.
    fn judge(&mut self) -> Option<Verdict> {
        let samples: Vec<RawSample> = self.window.iter().copied().collect();
        let judged = measure(&samples, &self.settings, self.expected);
        if let Some(removed) = self.notice_removal(&samples) {
            return Some(Verdict::Refused(removed));
        }
        match judged {
            Ok(mut dwell) => {
                dwell.waited_s = self.waited_s();
                dwell.lost = self.lost;
                Some(Verdict::Accepted(dwell))
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
            |block: &[RawSample]| (mean(block) - tare).norm() * self.settings.front_end.microstrain_per_count();
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

fn mean(samples: &[RawSample]) -> Vector2<f64> {
    let sum: Vector2<f64> = samples.iter().map(|sample| counts_vector(sample.counts)).sum();
    #[expect(clippy::cast_precision_loss, reason = "a dwell is far below 2^52 samples")]
    let count = samples.len().max(1) as f64;
    sum / count
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
    let blocks: Vec<Vector2<f64>> = samples.chunks_exact(settings.block_samples()).map(mean).collect();
    let rest =
        Rest { settings, expected, noise: block_noise(&blocks), quiet_noise: quiet_noise(&blocks), blocks: &blocks };
    rest.check()?;
    let reading = rest.reading();
    if let Expected::Load { tare } = expected {
        check_load(&reading, tare, settings)?;
    }
    #[expect(clippy::cast_precision_loss, reason = "a dwell is far below 2^52 samples")]
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
fn sample_noise(samples: &[RawSample], reading: &Reading) -> [f64; 2] {
    let squares: Vector2<f64> = samples
        .iter()
        .map(|sample| (counts_vector(sample.counts) - reading.counts).map(|deviation| deviation * deviation))
        .sum();
    #[expect(clippy::cast_precision_loss, reason = "a dwell is far below 2^52 samples")]
    let free = samples.len().saturating_sub(1).max(1) as f64;
    [(squares.x / free).sqrt(), (squares.y / free).sqrt()]
}

fn check_load(reading: &Reading, tare: Vector2<f64>, settings: &DwellSettings) -> Result<(), Refusal> {
    let load = reading.counts - tare;
    let microstrain = load.norm() * settings.front_end.microstrain_per_count();
    if microstrain < NO_LOAD_MICROSTRAIN {
        return Err(Refusal::NoLoad { microstrain });
    }
    let sigma = direction_variance(load, &reading.covariance).sqrt();
    if sigma > CONTACT_ANGLE_SIGMA_MAX {
        return Err(Refusal::TooWeak { sigma_deg: sigma.to_degrees(), factor: sigma / CONTACT_ANGLE_SIGMA_MAX });
    }
    Ok(())
}

/// Covariance of one block mean from neighbouring ones: a slow trend hardly enters differences of neighbours.
fn block_noise(blocks: &[Vector2<f64>]) -> Matrix2<f64> {
    let squares: Matrix2<f64> =
        blocks.windows(2).map(|pair| (pair[1] - pair[0]) * (pair[1] - pair[0]).transpose()).sum();
    #[expect(clippy::cast_precision_loss, reason = "a dwell has tens of blocks")]
    let pairs = blocks.len().saturating_sub(1).max(1) as f64;
    squares / (2.0 * pairs) + Matrix2::identity() * ROUNDING_VARIANCE
}

/// The same for each bridge from the middle squared difference: one step or a few do not hide behind it.
fn quiet_noise(blocks: &[Vector2<f64>]) -> Vector2<f64> {
    let variance = |axis: usize| {
        let squares = blocks.windows(2).map(|pair| (pair[1][axis] - pair[0][axis]).powi(2));
        median(squares.collect()).unwrap_or(0.0) / (2.0 * CHI2_MEDIAN) + ROUNDING_VARIANCE
    };
    Vector2::new(variance(0), variance(1)).map(f64::sqrt)
}

/// Block means of one window and what they are compared with.
struct Rest<'a> {
    settings: &'a DwellSettings,
    expected: Expected,
    blocks: &'a [Vector2<f64>],
    /// Covariance of one block mean, counts².
    noise: Matrix2<f64>,
    /// Standard deviation of a block mean on each bridge, counts, that a single jump does not enlarge.
    quiet_noise: Vector2<f64>,
}

impl Rest<'_> {
    fn check(&self) -> Result<(), Refusal> {
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
    fn reading(&self) -> Reading {
        let trend = self.halves_apart();
        let counts = self.blocks.iter().sum::<Vector2<f64>>() / self.count();
        // An even trend of twice that size over the dwell has this variance about its middle; chance has it too.
        let excess = trend * trend.transpose() / 12.0;
        let significant = self.is_significant(trend, 4.0 / self.count());
        let covariance = self.noise / self.count() + if significant { excess } else { Matrix2::zeros() };
        Reading { counts, covariance }
    }

    fn count(&self) -> f64 {
        #[expect(clippy::cast_precision_loss, reason = "a dwell has tens of blocks")]
        let count = self.blocks.len() as f64;
        count
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
    fn change(&self, difference: Vector2<f64>) -> Change {
        let microstrain_per_count = self.settings.front_end.microstrain_per_count();
        match self.expected {
            Expected::Nothing => Change::Tare { microstrain: difference.norm() * microstrain_per_count },
            Expected::Load { tare } => {
                let load = average(self.blocks) - tare;
                // Below that load there is no direction to speak of, and the load check refuses it.
                let size = load.norm().max(NO_LOAD_MICROSTRAIN / microstrain_per_count);
                let along = load.normalize();
                let turn_deg = (along.perp(&difference) / size).atan().to_degrees();
                Change::Contact { turn_deg, size_percent: 100.0 * along.dot(&difference) / size }
            }
        }
    }

    /// Where a single step explains the blocks much better than a straight line does, as a share of the window.
    fn step_at(&self) -> Option<f64> {
        let (at, left_by_step) = (1..self.blocks.len())
            .map(|at| (at, scatter(&self.blocks[..at]) + scatter(&self.blocks[at..])))
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        #[expect(clippy::cast_precision_loss, reason = "a dwell has tens of blocks")]
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
            #[expect(clippy::cast_precision_loss, reason = "a dwell has tens of blocks")]
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

fn average(blocks: &[Vector2<f64>]) -> Vector2<f64> {
    #[expect(clippy::cast_precision_loss, reason = "a dwell has tens of blocks")]
    let count = blocks.len().max(1) as f64;
    blocks.iter().sum::<Vector2<f64>>() / count
}

/// Sum of squares about the mean.
fn scatter(blocks: &[Vector2<f64>]) -> f64 {
    let mean = average(blocks);
    blocks.iter().map(|block| (block - mean).norm_squared()).sum()
}

#[cfg(test)]
mod tests {
    use super::super::front_end::FrontEndSettings;
    use super::super::test_world::{COUNTS_PER_MICROSTRAIN, Noise};
    use super::*;

    const RATE_HZ: f64 = 4000.0;

    /// Noise of a single sample, microstrain, and hum from peak to peak, of the default finger.
    const NOISE: f64 = 0.48;
    const HUM: f64 = 1.0;

    fn settings() -> DwellSettings {
        let front_end =
            FrontEnd::new(FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 })
                .unwrap();
        DwellSettings::new(front_end, RATE_HZ)
    }

    /// Blocks of eight samples of microstrain(t) with the default finger's noise and hum, for `seconds`.
    fn stream(seed: u64, mains_hz: f64, seconds: f64, microstrain: impl Fn(f64) -> [f64; 2]) -> Vec<SampleBlock> {
        let mut noise = Noise(seed);
        let phases = [noise.uniform(), noise.uniform()].map(|turn| turn * std::f64::consts::TAU);
        let mut sample = |seq: u64| {
            let t = seq as f64 / RATE_HZ;
            let clean = microstrain(t);
            [0, 1].map(|axis| {
                let hum = 0.5 * HUM * (std::f64::consts::TAU * mains_hz * t + phases[axis]).sin();
                let counts = COUNTS_PER_MICROSTRAIN * (clean[axis] + hum + NOISE * noise.normal());
                #[expect(clippy::cast_possible_truncation, reason = "far below 2^23")]
                Counts(counts.round() as i32)
            })
        };
        (0..whole(seconds * RATE_HZ) as u64 / 8)
            .map(|block| SampleBlock {
                first: 8 * block,
                time_us: 2000 * block,
                period_us: 250.0,
                counts: (0..8).map(|index| sample(8 * block + index)).collect(),
                trouble: None,
            })
            .collect()
    }

    fn samples_of(block: &SampleBlock) -> Vec<RawSample> {
        (block.first..).zip(&block.counts).map(|(seq, &counts)| RawSample { seq, t_us: 250 * seq, counts }).collect()
    }

    fn watch(blocks: &[SampleBlock], settings: DwellSettings, expected: Expected) -> Verdict {
        let mut watcher = Watcher::new(settings, expected);
        let mut verdict = Verdict::NeedsMoreTime(None);
        for block in blocks {
            verdict = watcher.push(block);
            if !matches!(verdict, Verdict::NeedsMoreTime(_)) {
                break;
            }
        }
        verdict
    }

    /// The dwell, without printing thousands of samples if it was another verdict.
    fn accepted(blocks: &[SampleBlock], settings: DwellSettings, expected: Expected) -> Dwell {
        match watch(blocks, settings, expected) {
            Verdict::Accepted(dwell) => dwell,
            Verdict::Refused(refusal) | Verdict::NeedsMoreTime(Some(refusal)) => panic!("not accepted: {refusal}"),
            Verdict::NeedsMoreTime(None) => panic!("not decided"),
        }
    }

    fn refused(blocks: &[SampleBlock], settings: DwellSettings, expected: Expected) -> Refusal {
        match watch(blocks, settings, expected) {
            Verdict::Accepted(dwell) => panic!("accepted after {} s: {:?}", dwell.waited_s, dwell.reading),
            Verdict::Refused(refusal) => refusal,
            Verdict::NeedsMoreTime(reason) => panic!("not decided: {reason:?}"),
        }
    }

    const LOADED: Expected = Expected::Load { tare: Vector2::new(0.0, 0.0) };

    fn short_of_patience() -> DwellSettings {
        DwellSettings { patience_s: 3.0, ..settings() }
    }

    #[test]
    fn a_contact_at_rest_is_accepted_after_one_second_with_an_honest_covariance() {
        let truth = [80.0, -50.0];
        let mut sum = 0.0;
        let dwells = 150;
        for seed in 0..dwells {
            let dwell = accepted(&stream(seed, 50.0, 1.0, |_| truth), settings(), LOADED);
            let error = dwell.reading.counts - Vector2::from(truth) * COUNTS_PER_MICROSTRAIN;
            sum += error.dot(&(dwell.reading.covariance.try_inverse().unwrap() * error)) / 2.0;
            assert_eq!(dwell.samples.len(), 4000);
            assert!((dwell.noise_microstrain[0] - NOISE.hypot(0.5 * HUM / f64::sqrt(2.0))).abs() < 0.03);
        }
        let got = sum / dwells as f64;
        // Its own scatter over 150 dwells of two components is 0.08; 49 degrees of freedom in each covariance add 5 %.
        assert!((0.75..1.3).contains(&got), "mean normalised squared error {got}, wanted 1");
    }

    #[test]
    fn hum_cancels_at_60_hertz_too() {
        let settings = DwellSettings { mains_hz: 60.0, ..settings() };
        let variance = |seed| {
            accepted(&stream(seed, 60.0, 1.0, |_| [80.0, -50.0]), settings, LOADED).reading.covariance.trace() / 2.0
        };
        let mean_variance = (0..20).map(variance).sum::<f64>() / 20.0;
        // Noise alone: 0.48 microstrain over √4000. Twenty dwells of twenty blocks and two axes know it to 5 %.
        let sigma = mean_variance.sqrt() / COUNTS_PER_MICROSTRAIN;
        assert!((sigma / 0.00759 - 1.0).abs() < 0.15, "got {sigma} microstrain, wanted 0.0076");
    }

    #[test]
    fn ring_down_is_waited_for() {
        let ringing = |t: f64| [80.0 + 30.0 * (-t / 0.2).exp() * (std::f64::consts::TAU * 3.0 * t).sin(), -50.0];
        let dwell = accepted(&stream(4, 50.0, 10.0, ringing), settings(), LOADED);
        assert!(dwell.waited_s > 1.5, "accepted after {} s, still ringing", dwell.waited_s);
        let error = (dwell.reading.counts.x / COUNTS_PER_MICROSTRAIN - 80.0).abs();
        assert!(error < 0.1, "mean off by {error} microstrain");
    }

    #[test]
    fn a_drifting_tare_is_refused_with_its_size() {
        let refusal = refused(&stream(5, 50.0, 4.0, |t| [0.8 * t, 0.0]), short_of_patience(), Expected::Nothing);
        let Refusal::Drifts { change: Change::Tare { microstrain }, .. } = refusal else { panic!("{refusal}") };
        assert!((microstrain - 0.4).abs() < 0.1, "halves are 0.4 microstrain apart, got {microstrain}");
    }

    #[test]
    fn a_slowly_turning_contact_is_refused_in_degrees() {
        let turning = |t: f64| [95.0 * (0.02 * t).cos(), 95.0 * (0.02 * t).sin()];
        let refusal = refused(&stream(6, 50.0, 4.0, turning), short_of_patience(), LOADED);
        let Refusal::Drifts { change: Change::Contact { turn_deg, .. }, .. } = refusal else { panic!("{refusal}") };
        assert!((turn_deg - 0.573).abs() < 0.05, "0.01 rad in half a second, got {turn_deg}°");
    }

    #[test]
    fn a_slip_is_told_from_a_drift() {
        let slip = |t: f64| if t < 0.4 || t.fract() < 0.5 { [95.0, 0.0] } else { [95.0, 1.0] };
        let blocks = stream(7, 50.0, 1.01, slip);
        let samples: Vec<RawSample> = blocks.iter().flat_map(samples_of).collect();
        let refusal = measure(&samples, &settings(), LOADED).unwrap_err();
        let Refusal::Stepped { at_s, .. } = refusal else { panic!("{refusal}") };
        assert!((at_s - 0.5).abs() < 0.05, "{at_s}");
    }

    #[test]
    fn a_swinging_weight_is_refused() {
        let swing = |t: f64| [95.0, 1.5 * (std::f64::consts::TAU * 2.0 * t).sin()];
        let refusal = refused(&stream(8, 50.0, 4.0, swing), short_of_patience(), LOADED);
        assert!(matches!(refusal, Refusal::Swings { .. } | Refusal::Drifts { .. }), "{refusal}");
    }

    #[test]
    fn a_load_that_falls_off_is_noticed() {
        let falls = |t: f64| if t < 0.7 { [95.0, 0.0] } else { [0.2, 0.0] };
        let refusal = refused(&stream(9, 50.0, 4.0, falls), settings(), LOADED);
        assert!(matches!(refusal, Refusal::LoadRemoved { .. }), "{refusal}");
    }

    #[test]
    fn no_load_and_too_little_load_are_different_refusals() {
        let nothing = refused(&stream(10, 50.0, 4.0, |_| [0.1, 0.0]), short_of_patience(), LOADED);
        assert!(matches!(nothing, Refusal::NoLoad { .. }), "{nothing}");
        let little = refused(&stream(11, 50.0, 4.0, |_| [3.0, 0.0]), short_of_patience(), LOADED);
        assert!(matches!(little, Refusal::TooWeak { factor, .. } if factor > 1.0), "{little}");
    }

    #[test]
    fn a_saturated_a_stuck_and_a_restarted_device_are_refused() {
        let mut saturated = stream(12, 50.0, 2.0, |_| [95.0, 0.0]);
        saturated.iter_mut().for_each(|block| block.counts.iter_mut().for_each(|counts| counts[1] = Counts::MAX));
        let refusal = refused(&saturated, settings(), LOADED);
        assert!(matches!(refusal, Refusal::Saturated { bridge: 'y', .. }), "{refusal}");
        let mut stuck = stream(13, 50.0, 2.0, |_| [95.0, 0.0]);
        stuck.iter_mut().skip(100).for_each(|block| block.counts.iter_mut().for_each(|counts| counts[0] = Counts(7)));
        let refusal = refused(&stuck, settings(), LOADED);
        assert!(matches!(refusal, Refusal::Stuck { bridge: 'x', code: 7, .. }), "{refusal}");
        let mut restarted = stream(14, 50.0, 2.0, |_| [95.0, 0.0]);
        restarted.iter_mut().skip(100).for_each(|block| block.first -= 800);
        let refusal = refused(&restarted, settings(), LOADED);
        assert!(matches!(refusal, Refusal::Restarted { .. }), "{refusal}");
    }

    #[test]
    fn a_gap_starts_the_window_anew_and_endless_gaps_are_counted() {
        let mut one_gap = stream(15, 50.0, 3.0, |_| [95.0, 0.0]);
        one_gap.remove(200);
        let dwell = accepted(&one_gap, settings(), LOADED);
        assert_eq!((dwell.lost, dwell.samples[0].seq), (8, 8 * 201));
        let mut many = stream(16, 50.0, 5.0, |_| [95.0, 0.0]);
        let mut index = 0;
        many.retain(|_| {
            index += 1;
            index % 100 != 0
        });
        let refusal = refused(&many, short_of_patience(), LOADED);
        assert!(matches!(refusal, Refusal::LostSamples { lost, .. } if lost > 0 && lost % 8 == 0), "{refusal}");
    }

    #[test]
    fn a_wrong_rate_and_a_complaint_are_refused() {
        let mut slow = stream(17, 50.0, 1.0, |_| [95.0, 0.0]);
        slow.iter_mut().for_each(|block| block.period_us = 500.0);
        assert!(matches!(refused(&slow, settings(), LOADED), Refusal::WrongRate { .. }));
        let mut complaint = stream(18, 50.0, 1.0, |_| [95.0, 0.0]);
        complaint[3].trouble = Some("no front-end answers".to_owned());
        assert!(matches!(refused(&complaint, settings(), LOADED), Refusal::Trouble(_)));
    }

    #[test]
    fn settings_that_cannot_work_are_refused() {
        assert!(settings().check().is_ok());
        assert!(DwellSettings { duration_s: 0.16, ..settings() }.check().is_ok());
        assert!(matches!(
            DwellSettings { duration_s: 0.1, ..settings() }.check(),
            Err(DwellSettingsError::TooShort { .. })
        ));
        assert!(DwellSettings { mains_hz: f64::NAN, ..settings() }.check().is_err());
        assert!(DwellSettings { rate_hz: 80.0, ..settings() }.check().is_err());
    }

    #[test]
    fn what_was_accepted_measures_the_same_again() {
        let dwell = accepted(&stream(19, 50.0, 2.0, |_| [95.0, 10.0]), settings(), LOADED);
        assert_eq!(measure(&dwell.samples, &settings(), LOADED).unwrap().reading, dwell.reading);
    }
}
