//! Finding the bias of recordings made one after the other, such as the pushes of one log.
//!
//! A recording by itself cannot tell a bias from a steady touch: it may begin in contact. Recordings close in time can,
//! since the bias moves slowly. So each recording's first moments are compared with those of its neighbours in time;
//! one that differs by more than a stated force began in contact, and its bias is interpolated between the neighbours
//! that began free. How good that is, is measured: by doing the same for recordings whose bias is known.
//!
//! Assumes: fewer than half of the recordings close in time began in contact. If most of them began under the same
//! steady force, that force would be taken for the bias: nothing in the readings tells the two apart.
//! Errors: none. A bias that cannot be known is an answer, [`BiasUnknown`].

use std::f64::consts::LN_2;
use std::ops::RangeInclusive;

use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use super::detector::Event;
use super::{Averaging, ContactReading, ContactSense, ContactSettings, Reading, Tare, TareError, noise};
use crate::math::statistics::{mean, median};

/// The first moments of a recording, s, whose mean tells whether it began in contact.
pub const LEAD_S: f64 = 0.2;
/// Longer first stretches to start from where noise makes the tare refuse that one by chance, s.
const LEADS_S: [f64; 3] = [LEAD_S, 0.3, 0.45];
/// Time before a found onset that is kept out of the tare, s: a force that grows at first from within the noise.
const GUARD_S: f64 = 0.05;
/// A free stretch refused by the tare is tried again this much shorter, from its end.
const SHORTER: f64 = 0.75;
/// Neighbours in time (as many before as after) whose median says where the bias roughly is.
const NEIGHBOURS: usize = 6;
/// Fewest neighbours for that: of three, one may have begun in contact and the median is still good.
const NEIGHBOURS_MIN: usize = 3;
/// Recordings further apart in time than this, s, say nothing of each other's bias: strain gauges wander by tens of mN
/// in this time.
const NEIGHBOUR_AGE_MAX_S: f64 = 900.0;
/// Fewest free recordings from which to tell how well neighbours predict a bias.
const PREDICTIONS_MIN: usize = 3;

/// A deviation from the neighbours this many times the usual one is doubtful. A bias jumps now and then, so this is not
/// chosen from Gaussian tails: of 247 real pushes that began free the largest was 6.0.
pub const DOUBT_SIGMAS: f64 = 10.0;

/// How a recording began.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RecordingStart {
    /// Without contact: its first moments agree with its neighbours'.
    Free,
    /// In contact: its first moments differ from its neighbours'.
    InContact,
    /// There is nothing to compare it with.
    Unknown,
}

/// How a bias was found.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "how", rename_all = "snake_case")]
pub enum BiasOrigin {
    /// From the stretch of time that the caller named.
    Given,
    /// From the recording's own time before the first contact.
    OwnFreeInterval,
    /// Interpolated in time between neighbours that began free (numbers of the recordings). The tare's other figures
    /// (noise, drift, samples) are the nearest neighbour's.
    Neighbours {
        /// The nearest earlier one.
        before: Option<usize>,
        /// The nearest later one.
        after: Option<usize>,
        /// Why the recording's own start will not do; `None` if it began in contact.
        #[serde(serialize_with = "in_words")]
        refusal: Option<TareError>,
    },
}

#[expect(clippy::ref_option, reason = "the signature that serde asks for")]
fn in_words<S: serde::Serializer>(refusal: &Option<TareError>, serializer: S) -> Result<S::Ok, S::Error> {
    refusal.map(|refusal| refusal.to_string()).serialize(serializer)
}

/// A bias, its noise, and where it came from.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bias {
    /// The tare to use.
    pub tare: Tare,
    /// Where it came from.
    pub found: BiasOrigin,
}

/// Why there is no bias.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum BiasUnknown {
    /// The recording has too few neighbours to tell whether it began free.
    #[error("bias unknown: {neighbours} recordings close in time, where {NEIGHBOURS_MIN} tell a bias from a steady touch{}",
        candidate.map(|[from, to]| format!("; {from:.2} s to {to:.2} s is quiet, and may be free")).unwrap_or_default())]
    NothingToCompare {
        /// Recordings close enough in time.
        neighbours: usize,
        /// A stretch from the start that looks free, s after the first reading, if there is one.
        candidate: Option<[f64; 2]>,
    },
    /// It has no free time of its own, and too few neighbours do.
    #[error(
        "bias unknown: no free time of its own, and {free} neighbours with some, where {PREDICTIONS_MIN} are needed"
    )]
    NoFreeNeighbours {
        /// Free recordings close enough in time.
        free: usize,
    },
    /// The stretch that the caller named is not free.
    #[error("bias unknown: the stretch given cannot serve as a tare: {0}")]
    Refused(TareError),
}

/// What is known of a recording's bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Judged {
    /// Whether it began without contact, in contact, or cannot be told.
    pub start: RecordingStart,
    /// Size of the mean of its first [`LEAD_S`] less the bias expected from its neighbours; force units.
    pub deviation: Option<f64>,
    /// Began free, but differs from its neighbours by more than [`DOUBT_SIGMAS`] times the usual: perhaps lightly
    /// touched.
    pub doubtful: bool,
    /// The bias, or why it cannot be known.
    pub bias: Result<Bias, BiasUnknown>,
}

/// Takes the tare from a stretch, in s after the first reading.
///
/// # Errors
/// [`BiasUnknown::Refused`] if it was not free.
pub fn given(
    readings: &[Reading],
    stretch: &RangeInclusive<f64>,
    settings: &ContactSettings,
) -> Result<Bias, BiasUnknown> {
    let start = readings.first().map_or(0.0, |reading| reading.t);
    let named: Vec<Reading> =
        readings.iter().filter(|reading| stretch.contains(&(reading.t - start))).copied().collect();
    let tare = Tare::estimate(&named, &settings.tare_settings()).map_err(BiasUnknown::Refused)?;
    Ok(Bias { tare, found: BiasOrigin::Given })
}

/// Runs the sense over a recording from its start.
///
/// # Errors
/// [`super::SettingsError`] if a setting is out of range.
pub fn feel(
    readings: &[Reading],
    settings: &ContactSettings,
    tare: Tare,
) -> Result<Vec<ContactReading>, super::SettingsError> {
    let mut sense = ContactSense::new(settings, tare)?;
    Ok(readings.iter().filter_map(|reading| sense.push(reading)).collect())
}

/// Judges recordings (in any order; each with times that increase, all on one clock) by comparing them.
///
/// `start_force` is the deviation, force units, from which a recording began in contact: above the bias's wander
/// between neighbours, below the lightest touch that matters.
#[must_use]
pub fn judge(recordings: &[&[Reading]], settings: &ContactSettings, start_force: f64) -> Vec<Judged> {
    let leads = Leads::of(recordings);
    let rough: Vec<Option<f64>> = (0..recordings.len()).map(|i| leads.deviation_from_median(i)).collect();
    let usual = usual_deviation(&rough);
    let own: Vec<Result<Tare, TareError>> = recordings.iter().map(|r| own_free(r, settings)).collect();
    let free: Vec<Dated> = (0..recordings.len())
        .filter(|&i| rough[i].is_some_and(|deviation| deviation <= start_force))
        .filter_map(|i| own[i].as_ref().ok().map(|tare| Dated { recording: i, tare: *tare }))
        .collect();
    let drift = Drift { free };
    (0..recordings.len())
        .map(|i| match (rough[i], leads.0[i]) {
            (Some(rough), Some(lead)) => {
                let deviation = drift.deviation(i, &lead);
                let size = deviation.map_or(rough, |deviation| deviation.norm());
                let start = if size > start_force { RecordingStart::InContact } else { RecordingStart::Free };
                let doubtful = start == RecordingStart::Free && rough > DOUBT_SIGMAS * usual;
                let own = (start == RecordingStart::Free).then_some(own[i]);
                Judged { start, deviation: Some(size), doubtful, bias: drift.bias(i, lead.t, own) }
            }
            _ => {
                let candidate = own[i].as_ref().ok().and_then(|tare| candidate(recordings[i], tare));
                let unknown = BiasUnknown::NothingToCompare { neighbours: leads.neighbours(i).len(), candidate };
                Judged { start: RecordingStart::Unknown, deviation: None, doubtful: false, bias: Err(unknown) }
            }
        })
        .collect()
}

/// Standard deviation, per axis, of the deviations from the neighbours' median, from the median of their squares, which
/// a few touches do not move. (That of a two-dimensional normal is `2 ln 2` variances.)
fn usual_deviation(deviations: &[Option<f64>]) -> f64 {
    let squares: Vec<f64> = deviations.iter().flatten().map(|deviation| deviation * deviation).collect();
    (median(squares).unwrap_or(0.0) / (2.0 * LN_2)).sqrt()
}

/// A quiet stretch, if the recording goes on after it (otherwise it says nothing: all of it may be one touch).
fn candidate(readings: &[Reading], tare: &Tare) -> Option<[f64; 2]> {
    let (first, last) = (readings.first()?, readings.last()?);
    (tare.t_to < last.t).then_some([tare.t_from - first.t, tare.t_to - first.t])
}

/// The tare from the start of a recording to its first onset.
fn own_free(readings: &[Reading], settings: &ContactSettings) -> Result<Tare, TareError> {
    let start = readings.first().map_or(0.0, |reading| reading.t);
    // Averages need longer stretches, and would smear the onset: they come last.
    let single = ContactSettings { averaging: Averaging::Off, ..*settings };
    let lead = first_accepted(LEADS_S.map(|lead| until(readings, start + lead)), &single)?;
    // The second pass knows the noise better, and may find an earlier onset than the first.
    let tare = longest_free(before_onset(readings, &single, lead), &single)?;
    longest_free(before_onset(readings, &single, tare), settings)
}

/// The tare of the first stretch that is accepted, or the first refusal.
fn first_accepted(stretches: [&[Reading]; LEADS_S.len()], settings: &ContactSettings) -> Result<Tare, TareError> {
    let [first, others @ ..] = stretches.map(|stretch| Tare::estimate(stretch, &settings.tare_settings()));
    first.or_else(|refusal| others.into_iter().find_map(Result::ok).ok_or(refusal))
}

/// The readings up to `t`.
fn until(readings: &[Reading], t: f64) -> &[Reading] {
    &readings[..readings.partition_point(|reading| reading.t <= t)]
}

/// The readings that are safely before the first onset.
fn before_onset<'a>(readings: &'a [Reading], settings: &ContactSettings, tare: Tare) -> &'a [Reading] {
    let onset = first_onset(readings, settings, tare);
    until(readings, onset.map_or(f64::INFINITY, |onset| onset - GUARD_S))
}

fn first_onset(readings: &[Reading], settings: &ContactSettings, tare: Tare) -> Option<f64> {
    let mut sense = ContactSense::new(settings, tare).ok()?;
    readings.iter().find_map(|reading| match sense.push(reading)?.event {
        Some(Event::Onset { t, .. }) => Some(t),
        _ => None,
    })
}

/// The tare of all readings or, where that is refused, of ever fewer from the start; the first refusal if none will do.
fn longest_free(readings: &[Reading], settings: &ContactSettings) -> Result<Tare, TareError> {
    let whole = Tare::estimate(readings, &settings.tare_settings());
    if whole.is_ok() {
        return whole;
    }
    let (Some(first), Some(last)) = (readings.first(), readings.last()) else { return whole };
    let mut duration = last.t - first.t;
    loop {
        duration *= SHORTER;
        match Tare::estimate(until(readings, first.t + duration), &settings.tare_settings()) {
            Ok(tare) => return Ok(tare),
            Err(TareError::TooFew { .. } | TareError::TooShort { .. }) => return whole,
            Err(_) => {}
        }
    }
}

/// Mean of each recording's first moments.
struct Leads(Vec<Option<Reading>>);

impl Leads {
    fn of(recordings: &[&[Reading]]) -> Self {
        Self(recordings.iter().map(|readings| Self::lead(readings)).collect())
    }

    fn lead(readings: &[Reading]) -> Option<Reading> {
        let first = readings.first()?;
        let lead: Vec<_> = until(readings, first.t + LEAD_S).iter().map(|reading| reading.force_finger).collect();
        Some(Reading::new(first.t, mean(&lead)?))
    }

    /// The nearest recordings in time other than `i`, as many before as after.
    fn neighbours(&self, i: usize) -> Vec<Reading> {
        let Some(own) = self.0[i] else { return Vec::new() };
        let others = || {
            let others = self.0.iter().enumerate().filter(|(j, _)| *j != i).filter_map(|(_, lead)| *lead);
            others.filter(|lead| (lead.t - own.t).abs() <= NEIGHBOUR_AGE_MAX_S)
        };
        let nearest = |mut side: Vec<Reading>| {
            side.sort_by(|a, b| (a.t - own.t).abs().total_cmp(&(b.t - own.t).abs()));
            side
        };
        let before = nearest(others().filter(|lead| lead.t <= own.t).collect());
        let after = nearest(others().filter(|lead| lead.t > own.t).collect());
        // At the ends of a session one side has fewer, and the other fills up.
        let from_before = before.len().min(NEIGHBOURS - (NEIGHBOURS / 2).min(after.len()));
        let from_after = after.len().min(NEIGHBOURS - from_before);
        before[..from_before].iter().chain(&after[..from_after]).copied().collect()
    }

    fn deviation_from_median(&self, i: usize) -> Option<f64> {
        let neighbours = self.neighbours(i);
        if neighbours.len() < NEIGHBOURS_MIN {
            return None;
        }
        let axis = |axis: usize| median(neighbours.iter().map(|n| n.force_finger[axis]));
        Some((self.0[i]?.force_finger - Vector2::new(axis(0)?, axis(1)?)).norm())
    }
}

/// A tare and the recording it comes from.
struct Dated {
    recording: usize,
    tare: Tare,
}

impl Dated {
    fn t(&self) -> f64 {
        0.5 * (self.tare.t_from + self.tare.t_to)
    }
}

/// How the bias moved, from the recordings that began free.
struct Drift {
    free: Vec<Dated>,
}

/// A bias expected from neighbours.
struct Prediction {
    bias: Vector2<f64>,
    before: Option<usize>,
    after: Option<usize>,
}

impl Drift {
    /// The bias at time `t`, from recordings other than `except`: linear between the nearest earlier and later one.
    fn predict(&self, except: usize, t: f64) -> Option<Prediction> {
        let age = |dated: &&Dated| (dated.t() - t).abs();
        let usable = || self.free.iter().filter(|d| d.recording != except && age(d) <= NEIGHBOUR_AGE_MAX_S);
        let nearest = |side: &mut dyn Iterator<Item = &'_ Dated>| -> Option<(usize, f64, Vector2<f64>)> {
            let best = side.min_by(|a, b| age(a).total_cmp(&age(b)))?;
            Some((best.recording, best.t(), best.tare.bias))
        };
        let before = nearest(&mut usable().filter(|d| d.t() <= t));
        let after = nearest(&mut usable().filter(|d| d.t() > t));
        let bias = match (before, after) {
            (Some((_, t0, b0)), Some((_, t1, b1))) => b0.lerp(&b1, (t - t0) / (t1 - t0)),
            (Some((_, _, bias)), None) | (None, Some((_, _, bias))) => bias,
            (None, None) => return None,
        };
        Some(Prediction { bias, before: before.map(|b| b.0), after: after.map(|a| a.0) })
    }

    /// Mean square error of the prediction for recordings whose bias is known: what drift and interpolation leave.
    fn prediction_error(&self) -> Option<noise::Scatter> {
        let error = |d: &Dated| Some(self.predict(d.recording, d.t())?.bias - d.tare.bias);
        let errors: Vec<Vector2<f64>> = self.free.iter().filter_map(error).collect();
        let n = errors.len() as f64;
        let covariance = errors.iter().map(|e| e * e.transpose()).sum::<Matrix2<f64>>() / n;
        (errors.len() >= PREDICTIONS_MIN).then_some(noise::Scatter { covariance, freedom: n })
    }

    /// The first moments of recording `i` less the bias expected from the others.
    fn deviation(&self, i: usize, lead: &Reading) -> Option<Vector2<f64>> {
        Some(lead.force_finger - self.predict(i, lead.t)?.bias)
    }

    /// The bias of recording `i`, which starts at `t`: its own, if it began free and was not refused.
    fn bias(&self, i: usize, t: f64, own: Option<Result<Tare, TareError>>) -> Result<Bias, BiasUnknown> {
        let refusal = match own {
            Some(Ok(tare)) => return Ok(Bias { tare, found: BiasOrigin::OwnFreeInterval }),
            Some(Err(refusal)) => Some(refusal),
            None => None,
        };
        let unknown = BiasUnknown::NoFreeNeighbours { free: self.free.len() };
        let (prediction, error) = (self.predict(i, t).ok_or(unknown)?, self.prediction_error().ok_or(unknown)?);
        let nearest = prediction.before.or(prediction.after);
        let like = self.free.iter().find(|d| Some(d.recording) == nearest).ok_or(unknown)?;
        // The noise is the nearest neighbour's; the bias is good for the time of this recording's start.
        let tare = Tare { bias: prediction.bias, bias_covariance: error.covariance, t_from: t, t_to: t, ..like.tare };
        let found = BiasOrigin::Neighbours { before: prediction.before, after: prediction.after, refusal };
        Ok(Bias { tare, found })
    }
}
