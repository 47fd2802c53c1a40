//! Which samples are measurements: the one way from what a source delivers to readings of force.
//!
//! A source delivers counts of two bridges ([`CountsJudge`]; a calibration makes them force) or newtons
//! ([`ForceJudge`]; any other force sensor). Either way out come the same items in order: readings, samples that are
//! no measurements and why, gaps, restarts. Whoever wants force takes it from here and nowhere else, so that nobody
//! takes an unsettled, saturated or repeated value for one; and whoever folds the items into a [`Tally`] can say what
//! an answer lacks.
//!
//! Frames: finger axes; force on the finger's disk. Units: s, counts, the calibration's unit of force. Errors: none.

use std::fmt;
use std::ops::Sub;

use nalgebra::{Matrix2, Vector2};
use palpate_shared::status::Status;
use palpate_shared::units::Counts;

use super::calibration::zero_drift::Thermal;
use super::calibration::{Calibration, counts_vector};
use super::contact::Reading;
use super::{STUCK_SAMPLES, Samples};
use crate::math::statistics::median;

/// A sensor of force repeats itself where both axes do for so long, s, and for [`STUCK_FORCES_MIN`] readings: one axis
/// alone may rest below its resolution.
const STUCK_FORCES_S: f64 = 0.1;

/// See [`STUCK_FORCES_S`].
const STUCK_FORCES_MIN: usize = 8;

/// Rows of a recording come evenly where the time from one to the next is within this share of its median ...
const EVEN: f64 = 0.1;

/// ... for this share of them: losses are rarer.
const EVEN_SHARE: f64 = 0.8;

/// Even rows further apart than so many times the median lack some between them.
const EVEN_GAP: f64 = 1.5;

/// Uneven rows further apart have a gap, of which nobody can say how many rows it took.
const UNEVEN_GAP: f64 = 2.5;

/// Why a sample says nothing about the force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleFault {
    /// The converter's filter had not settled after a start or a change of rate or gain.
    Settling,
    /// This channel is at the end of the converter's range: a broken gauge or too large a load.
    Saturated {
        /// 0 for x, 1 for y.
        channel: usize,
    },
    /// This channel repeats itself.
    Stuck {
        /// 0 for x, 1 for y.
        channel: usize,
    },
}

impl fmt::Display for SampleFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let bridge = |channel: usize| ["x", "y"][channel.min(1)];
        match *self {
            Self::Settling => f.write_str("the converter's filter is settling"),
            Self::Saturated { channel } => write!(f, "bridge {} is at the end of its range", bridge(channel)),
            Self::Stuck { channel } => write!(f, "the converter repeats itself on bridge {}", bridge(channel)),
        }
    }
}

/// What came of a source's samples, in order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Judged {
    /// A measurement, tare included.
    Measured(Reading),
    /// A sample that is none.
    NotMeasured {
        /// When it was taken, s.
        t: f64,
        /// Why.
        fault: SampleFault,
    },
    /// Samples that never came; none where they cannot be counted.
    Missing(Option<u64>),
    /// The device started anew: what it measured before and after is one stream, its settings were restored.
    Restarted,
}

impl Judged {
    /// When the sample was taken, s; none for what is no sample.
    #[must_use]
    pub fn time(&self) -> Option<f64> {
        match self {
            Self::Measured(reading) => Some(reading.t),
            Self::NotMeasured { t, .. } => Some(*t),
            Self::Missing(_) | Self::Restarted => None,
        }
    }

    /// The same along axes of which x lies at this angle in the finger's, rad: those of the robot that carries it.
    #[must_use]
    pub fn mounted(self, mounting: f64) -> Self {
        match self {
            Self::Measured(reading) => Self::Measured(reading.mounted(mounting)),
            other => other,
        }
    }

    /// The reading, where it is one.
    #[must_use]
    pub fn reading(self) -> Option<Reading> {
        match self {
            Self::Measured(reading) => Some(reading),
            _ => None,
        }
    }
}

/// What a stretch of samples lacks. Folded from [`Judged`] items; the difference of two is the stretch between.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Samples that were measurements.
    pub measured: u64,
    /// Samples that never came.
    pub missing: u64,
    /// Gaps that could not be counted.
    pub uncountable_gaps: u64,
    /// Samples not measured because channel x, or y, was at the end of its range; x is told where both were.
    pub saturated: [u64; 2],
    /// Samples not measured because channel x, or y, repeated itself; x is told where both did.
    pub stuck: [u64; 2],
    /// Samples not measured because the filter was settling.
    pub settling: u64,
    /// Times the device started anew.
    pub restarts: u64,
}

impl Tally {
    /// Counts an item.
    pub fn add(&mut self, judged: &Judged) {
        match judged {
            Judged::Measured(_) => self.measured += 1,
            Judged::NotMeasured { fault: SampleFault::Settling, .. } => self.settling += 1,
            Judged::NotMeasured { fault: SampleFault::Saturated { channel }, .. } => self.saturated[*channel] += 1,
            Judged::NotMeasured { fault: SampleFault::Stuck { channel }, .. } => self.stuck[*channel] += 1,
            Judged::Missing(Some(count)) => self.missing += count,
            Judged::Missing(None) => self.uncountable_gaps += 1,
            Judged::Restarted => self.restarts += 1,
        }
    }

    /// Samples that came and were no measurements.
    #[must_use]
    pub fn not_measured(&self) -> u64 {
        self.settling + self.saturated.iter().chain(&self.stuck).sum::<u64>()
    }

    /// Whether every sample came and was a measurement.
    #[must_use]
    pub fn is_whole(&self) -> bool {
        *self == Self { measured: self.measured, ..Self::default() }
    }

    /// Whether the sensor failed, as opposed to the line: samples were no measurements, or the device started anew.
    #[must_use]
    pub fn has_faults(&self) -> bool {
        self.not_measured() > 0 || self.restarts > 0
    }
}

impl Sub for Tally {
    type Output = Self;

    /// What came after `earlier`, a tally of the same stream.
    fn sub(self, earlier: Self) -> Self {
        let pair = |now: [u64; 2], then: [u64; 2]| [now[0] - then[0], now[1] - then[1]];
        Self {
            measured: self.measured - earlier.measured,
            missing: self.missing - earlier.missing,
            uncountable_gaps: self.uncountable_gaps - earlier.uncountable_gaps,
            saturated: pair(self.saturated, earlier.saturated),
            stuck: pair(self.stuck, earlier.stuck),
            settling: self.settling - earlier.settling,
            restarts: self.restarts - earlier.restarts,
        }
    }
}

impl fmt::Display for Tally {
    /// Only what is not 0: `12 missing, 3 saturated on x`; `none missing` where all is well.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let counts = [
            (self.missing, "missing"),
            (self.uncountable_gaps, "gaps of unknown length"),
            (self.saturated[0], "saturated on x"),
            (self.saturated[1], "saturated on y"),
            (self.stuck[0], "stuck on x"),
            (self.stuck[1], "stuck on y"),
            (self.settling, "settling"),
            (self.restarts, "restarts"),
        ];
        let told: Vec<_> =
            counts.iter().filter(|(count, _)| *count > 0).map(|(n, what)| format!("{n} {what}")).collect();
        if told.is_empty() { f.write_str("none missing") } else { f.write_str(&told.join(", ")) }
    }
}

/// Runs of equal values on one channel.
#[derive(Clone, Copy, Debug)]
struct Repeats<T> {
    last: Option<T>,
    /// Values in a row that equal the last, itself included.
    run: usize,
}

impl<T: Copy + PartialEq> Repeats<T> {
    const NEW: Self = Self { last: None, run: 0 };

    /// How many values in a row are this one.
    fn take(&mut self, value: T) -> usize {
        self.run = if self.last == Some(value) { self.run + 1 } else { 1 };
        self.last = Some(value);
        self.run
    }
}

/// Judges counts of two bridges.
#[derive(Clone, Debug)]
pub struct CountsJudge {
    /// Force per count.
    inverse: Matrix2<f64>,
    repeats: [Repeats<Counts>; 2],
    /// Where the calibration knows what temperature does.
    thermal: Option<Thermal>,
}

impl CountsJudge {
    /// A judge that makes counts force by this calibration.
    #[must_use]
    pub fn new(calibration: &Calibration) -> Self {
        let thermal = calibration.zero_drift().map(|drift| Thermal::new(*drift));
        Self { inverse: *calibration.inverse(), repeats: [Repeats::NEW; 2], thermal }
    }

    /// The finger is so warm from now on, °C: what its zero drifts by that since the first time is taken off.
    pub fn feel_temperature(&mut self, celsius: f64) {
        if let Some(thermal) = &mut self.thermal {
            thermal.feel(celsius);
        }
    }

    /// The samples of a block, and what is missing before it.
    pub fn judge<'a>(&'a mut self, samples: &'a Samples) -> impl Iterator<Item = Judged> + 'a {
        let gap = (samples.missing_before > 0).then_some(Judged::Missing(Some(samples.missing_before)));
        let settling = samples.status.contains(Status::SETTLING);
        let block_s = 1e-6 * samples.period_us * samples.counts.len() as f64;
        let drifted = self.thermal.as_mut().map_or_else(Vector2::zeros, |thermal| thermal.counts(block_s));
        let judged = samples.counts.iter().enumerate().map(move |(index, &counts)| {
            let t = samples.measured_time_s(index);
            match self.fault(counts, settling) {
                Some(fault) => Judged::NotMeasured { t, fault },
                None => Judged::Measured(Reading::new(t, self.inverse * (counts_vector(counts) - drifted))),
            }
        });
        gap.into_iter().chain(judged)
    }

    /// The device started anew.
    pub fn restarted(&mut self) -> Judged {
        self.repeats = [Repeats::NEW; 2];
        Judged::Restarted
    }

    fn fault(&mut self, counts: [Counts; 2], settling: bool) -> Option<SampleFault> {
        let runs = [self.repeats[0].take(counts[0]), self.repeats[1].take(counts[1])];
        let saturated = counts.iter().position(|count| count.is_saturated());
        let stuck = runs.iter().position(|run| *run >= STUCK_SAMPLES);
        // A channel at the end of its range repeats itself too: the cause is told.
        let saturated = saturated.map(|channel| SampleFault::Saturated { channel });
        let stuck = stuck.map(|channel| SampleFault::Stuck { channel });
        if settling { Some(SampleFault::Settling) } else { saturated.or(stuck) }
    }
}

/// Judges readings of a force sensor.
#[derive(Clone, Debug)]
pub struct ForceJudge {
    repeats: Repeats<[f64; 2]>,
    /// When the run of equal readings began, s.
    since: f64,
}

impl Default for ForceJudge {
    fn default() -> Self {
        Self { repeats: Repeats::NEW, since: f64::NEG_INFINITY }
    }
}

impl ForceJudge {
    /// A reading; one that is not finite is missing.
    pub fn judge(&mut self, reading: &Reading) -> Judged {
        let is_finite = reading.force_finger.iter().all(|value| value.is_finite());
        if is_finite { self.judge_finite(reading) } else { Judged::Missing(Some(1)) }
    }

    /// A recording, oldest first, in order of time. Where rows come evenly, those that are not there are counted.
    #[must_use]
    pub fn judge_recording(readings: &[Reading]) -> Vec<Judged> {
        let steps: Vec<_> = readings.windows(2).map(|pair| pair[1].t - pair[0].t).collect();
        let period = median(steps.iter().copied()).unwrap_or(f64::INFINITY);
        let even = steps.iter().filter(|step| (*step - period).abs() <= EVEN * period).count();
        let is_even = even as f64 >= EVEN_SHARE * steps.len() as f64;
        let missing = |step: f64| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not below 0")]
            let count = ((step / period).round() - 1.0).max(0.0) as u64;
            let is_gap = step > if is_even { EVEN_GAP } else { UNEVEN_GAP } * period;
            is_gap.then_some(Judged::Missing(is_even.then_some(count)))
        };
        let mut judge = Self::default();
        let gaps = std::iter::once(None).chain(steps.into_iter().map(missing));
        readings.iter().zip(gaps).flat_map(|(reading, gap)| gap.into_iter().chain([judge.judge(reading)])).collect()
    }

    fn judge_finite(&mut self, reading: &Reading) -> Judged {
        let run = self.repeats.take(reading.force_finger.into());
        if run == 1 {
            self.since = reading.t;
        }
        let is_stuck = run >= STUCK_FORCES_MIN && reading.t - self.since >= STUCK_FORCES_S;
        // Both axes: x is told.
        let fault = SampleFault::Stuck { channel: 0 };
        if is_stuck { Judged::NotMeasured { t: reading.t, fault } } else { Judged::Measured(*reading) }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use nalgebra::SMatrix;
    use proptest::prelude::*;

    use super::*;
    use crate::finger::calibration::zero_drift::ZeroDrift;
    use crate::finger::calibration::{CalibrationParts, ForceUnit};

    /// A bench's calibration: some 27,000 counts per newton on both axes.
    pub(crate) fn calibration() -> Calibration {
        let parts = CalibrationParts {
            unit: ForceUnit::Newton,
            matrix: Matrix2::new(27_000.0, 400.0, -300.0, 26_000.0),
            offset: Vector2::zeros(),
            covariance: SMatrix::identity(),
        };
        Calibration::new(parts).unwrap()
    }

    fn block(first: u64, status: Status, counts: Vec<[Counts; 2]>) -> Samples {
        Samples { first, missing_before: 0, time_us: 250 * first, period_us: 250.0, status, counts }
    }

    /// Counts whose last digits never repeat.
    fn alive(first: u64, count: u64) -> Vec<[Counts; 2]> {
        let noise = |i: u64, k: u64| Counts(i32::try_from((first + i) * k % 211).unwrap() - 105);
        (0..count).map(|i| [noise(i, 37), noise(i, 61)]).collect()
    }

    fn faults(judged: &[Judged]) -> Vec<SampleFault> {
        let fault = |judged: &Judged| match judged {
            Judged::NotMeasured { fault, .. } => Some(*fault),
            _ => None,
        };
        judged.iter().filter_map(fault).collect()
    }

    #[test]
    fn what_the_zero_drifts_with_temperature_is_taken_off() {
        let drift = ZeroDrift { counts_per_k: Vector2::new(13.0, -11.0), sd: Vector2::new(0.3, 0.3) };
        let mut judge = CountsJudge::new(&calibration().with_zero_drift(Some(drift)));
        let mut ignorant = CountsJudge::new(&calibration());
        // A minute at 22 °C, then it warms by 3 K in half an hour; the noise of the counts is the same in every block.
        let mut mean = |k: u32| {
            let celsius = 22.0 + 3.0 * (f64::from(k) - 60.0).max(0.0) / 1800.0;
            judge.feel_temperature(celsius);
            #[expect(clippy::cast_possible_truncation, reason = "some ten counts")]
            let [x, y] = [13.0, -11.0].map(|per_k: f64| (per_k * (celsius - 22.0)).round() as i32);
            let counts = alive(0, 211).into_iter().map(|[a, b]| [Counts(a.0 + x), Counts(b.0 + y)]).collect();
            // A block that stands for a second.
            let samples = Samples { period_us: 1e6 / 211.0, ..block(0, Status::default(), counts) };
            let of = |judge: &mut CountsJudge| {
                let readings: Vec<_> = judge.judge(&samples).filter_map(Judged::reading).collect();
                readings.iter().map(|reading| reading.force_finger).sum::<Vector2<f64>>() / readings.len() as f64
            };
            (of(&mut judge), of(&mut ignorant))
        };
        let (at_first, ignorant_at_first) = mean(0);
        let (mut off, mut ignorant_off) = (0.0_f64, 0.0_f64);
        for k in 1..1860 {
            let (now, ignorant_now) = mean(k);
            off = off.max((now - at_first).norm());
            ignorant_off = ignorant_off.max((ignorant_now - ignorant_at_first).norm());
        }
        // 39 and −33 counts of 27,000 a newton; what is left is the smoothing's delay (17 mK) and the rounding of counts.
        assert!(ignorant_off > 1.8e-3 && off < 5e-5, "{off} N beside {ignorant_off} N");
    }

    #[test]
    fn nothing_of_a_block_whose_filter_settles_is_a_measurement() {
        let mut judge = CountsJudge::new(&calibration());
        let judged: Vec<_> = judge.judge(&block(0, Status::SETTLING, alive(0, 8))).collect();
        assert_eq!(faults(&judged), [SampleFault::Settling; 8]);
        let judged: Vec<_> = judge.judge(&block(8, Status::default(), alive(8, 8))).collect();
        assert_eq!(faults(&judged), []);
    }

    #[test]
    fn one_channel_that_repeats_itself_is_a_fault_after_as_many_samples_as_chance_never_gives() {
        for channel in 0..2 {
            let mut judge = CountsJudge::new(&calibration());
            let mut counts = alive(0, 100);
            counts.iter_mut().for_each(|pair| pair[channel] = Counts(1234));
            let judged: Vec<_> = judge.judge(&block(0, Status::default(), counts)).collect();
            assert_eq!(faults(&judged), vec![SampleFault::Stuck { channel }; 100 - (STUCK_SAMPLES - 1)]);
        }
    }

    #[test]
    fn a_sensor_of_force_is_stuck_only_where_both_axes_are_for_a_tenth_of_a_second() {
        let reading = |i: u32, x: f64, y: f64| Reading::new(f64::from(i) / 64.0, Vector2::new(x, y));
        let mut judge = ForceJudge::default();
        let mut all = Vec::new();
        for i in 0..40 {
            // y moves for the first 20 readings.
            all.push(judge.judge(&reading(i, 0.5, if i < 20 { f64::from(i) } else { 19.0 })));
        }
        let first = all.iter().position(|judged| matches!(judged, Judged::NotMeasured { .. })).unwrap();
        // The run began with reading 19; seven sixty-fourths are more than a tenth.
        assert_eq!((first, faults(&all).len()), (26, 14));
    }

    #[test]
    fn rows_that_are_not_there_are_counted_where_rows_come_evenly() {
        let reading = |t: f64| Reading::new(t, Vector2::new(t.sin(), t.cos()));
        let even = (0..200).filter(|i| ![30, 31, 32, 90].contains(i)).map(|i| reading(f64::from(i) * 0.004));
        let uneven = (0_u32..200).filter(|i| !(30..33).contains(i)).map(|i| {
            let late = [0.0, 0.3, -0.2][i as usize % 3];
            reading((f64::from(i) + late) * 0.004)
        });
        let tally = |readings: Vec<Reading>| {
            let mut tally = Tally::default();
            ForceJudge::judge_recording(&readings).iter().for_each(|item| tally.add(item));
            tally
        };
        assert_eq!(tally(even.collect()), Tally { measured: 196, missing: 4, ..Tally::default() });
        let found = tally(uneven.collect());
        assert_eq!((found.missing, found.uncountable_gaps), (0, 1), "{found:?}");
    }

    proptest! {
        /// Whatever comes, every sample is told once, and the tally adds up.
        #[test]
        fn every_sample_is_told_once_and_counted(
            blocks in prop::collection::vec((0_u64..20, any::<bool>(), prop::collection::vec((0_u8..4, 0_u8..4), 1..9)), 1..60),
        ) {
            let mut judge = CountsJudge::new(&calibration());
            let value = |code: u8| match code { 0 => Counts::MAX, 1 => Counts::MIN, code => Counts(i32::from(code)) };
            let (mut tally, mut sent, mut missing, mut first) = (Tally::default(), 0, 0, 0);
            for (gap, settles, codes) in blocks {
                first += gap;
                let status = if settles { Status::SETTLING } else { Status::default() };
                let counts: Vec<_> = codes.iter().map(|&(x, y)| [value(x), value(y)]).collect();
                let samples = Samples { missing_before: gap, ..block(first, status, counts) };
                let before = tally;
                let judged: Vec<_> = judge.judge(&samples).collect();
                judged.iter().for_each(|item| tally.add(item));
                for (item, counts) in judged.iter().skip(usize::from(gap > 0)).zip(&samples.counts) {
                    if let Judged::Measured(reading) = item {
                        prop_assert!(!settles && counts.iter().all(|count| !count.is_saturated()));
                        let back = calibration().parts().matrix * reading.force_finger;
                        prop_assert!((back - counts_vector(*counts)).norm() < 1e-6);
                    }
                }
                let grown = tally - before;
                prop_assert_eq!(grown.measured + grown.not_measured(), samples.counts.len() as u64);
                prop_assert_eq!(grown.missing, gap);
                sent += samples.counts.len() as u64;
                missing += gap;
                first += samples.counts.len() as u64;
            }
            prop_assert_eq!((tally.measured + tally.not_measured(), tally.missing), (sent, missing));
        }
    }
}
