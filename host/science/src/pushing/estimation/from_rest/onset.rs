//! From force readings to what was felt of a push: noise at rest, the onset, and the windows' means.
//!
//! The finger begins at rest, touching the part or nothing. [`RestNoise`] is what it then reads. [`PushSense`] takes
//! reading after reading; where the force leaves the noise, the push has begun, and from then on it is averaged under
//! the windows of [`from_rest`](crate::pushing::estimation::from_rest). The push is over when the finger loses the
//! part; windows that lack readings are left out. A knock, over before it could say anything, is kept as a [`Touch`] and waited out.
//!
//! Assumes: the force is there at once when the finger begins to move, as support friction makes it. A stiff sensor
//! shows it so, a disk rings about it: the scatter of the first readings tells which. The onset is found on the first
//! rise, as exactly as the time between two readings allows; the estimate finds it with the other unknowns.
//! Frames: finger axes; force is the force on the finger's disk. Units: s, and the calibration's unit of force.
//! Errors: [`TareError`] where the finger was not at rest.

use nalgebra::{Matrix2, Matrix4, Vector2};

use crate::finger::calibration::Calibration;
use crate::finger::contact::{Averaging, Reading, Tare, TareError, TareSettings, noise};
use crate::math::statistics::mean;
use crate::pushing::estimation::from_rest::hann_windows::{self, HOP_S, LENGTH_S, NEIGHBOUR_CORRELATION};
use crate::pushing::estimation::from_rest::{
    CalibrationUncertainty, CarriedFinger, Uncertainty, WINDOWS_MIN, WindowedForce,
};

/// The force has left the noise when it is this many standard deviations of a reading, for [`CONFIRMED`] readings of
/// [`ATTEMPTS`] in a row: by chance once in a year.
const ONSET_SIGMAS: f64 = 8.0;

/// Readings that must stand out; see [`ONSET_SIGMAS`].
const CONFIRMED: usize = 6;

/// See [`ONSET_SIGMAS`]. The ringing disk comes back to no force once a period, 23 readings of the default finger.
const ATTEMPTS: usize = 8;

/// A force that stands less far out of the noise of a reading is looked for in means over this long, s: a period of the mains.
const MEAN_S: f64 = 0.02;

/// Such a mean has left the one [`APART_S`] earlier when it differs by so many standard deviations of a reading, for two in a row,
/// which a bias that drifts does not. Means of weaker forces tell little of a push.
const MEAN_SIGMAS: f64 = 3.0;

/// And by so many of a mean's, √2 [`ONSET_SIGMAS`] of a difference: at less than 500 readings a second that is the more.
const MEAN_OWN_SIGMAS: f64 = 11.3;

/// And by more than the finger's own mass makes of so much, m/s²: a finger that comes near pushes nothing yet.
const COMES_NEAR: f64 = 1.0;

/// From one mean to another that it is compared with, s: what lies between may be either.
const APART_S: f64 = 3.0 * MEAN_S;

/// A mean's variance over [`MEAN_S`] in those of a window's: as many independent readings as a half of it, of two thirds.
const MEAN_VARIANCE: f64 = 4.0 / 3.0;

/// A first force of less than so many standard deviations of a reading is noisy: no single one tells when it rose.
const NOISY_SIGMAS: f64 = 2.0 * ONSET_SIGMAS;

/// Standard deviation of the change between two levels d standard deviations of a reading apart, found as the one that explains
/// most: √26/d² readings (that of where a random walk with drift is highest; D. V. Hinkley, Biometrika 57, 1970).
const CHANGE_READINGS: f64 = 5.1;

/// Whether a noisy force is there is told by a mean over so many readings that it stands out by this in [`GONE_SHARE`] of it.
const PRESENCE_SIGMAS: f64 = 4.0;

/// Readings kept from before the force leaves the noise, s: the rise begins there.
const BEFORE_S: f64 = 0.01;

/// The same in readings, beside those that must stand out: at a hundred a second 10 ms hold one.
const BEFORE_READINGS: f64 = 4.0;

/// Readings over which the size of the first force is averaged, s: seven periods of the disk's ringing.
const FIRST_S: f64 = 0.04;

/// Share of the first force whose crossing marks the rise.
const RISE: f64 = 0.5;

/// From the onset to that crossing, s, where the disk rings: a sixth of a period of the default finger's, 177.3 Hz.
const RISE_TIME_S: f64 = 0.94e-3;

/// Standard deviation of the onset's moment beside that from the time between readings, s: another finger's disk may
/// ring at half or twice the frequency, a robot takes a millisecond to accelerate.
const ONSET_SD_S: f64 = 0.3e-3;

/// The disk rings where the first readings scatter along their mean by more than this share of it: ringing makes a half,
/// noise at most an eighth ([`ONSET_SIGMAS`]).
const RINGS: f64 = 0.25;

/// A period of the ringing disk, s: over it the mean of the ringing alone is nothing.
const RING_PERIOD_S: f64 = 1.0 / 177.3;

/// Over so long a stiff sensor's force is averaged to tell whether it is there, s.
const SHORT_S: f64 = 1e-3;

/// A touch is a knock if the force of its last two periods of ringing is below this share of the greatest: a force that
/// stays is half of its first overshoot.
const KNOCK_SHARE: f64 = 0.2;

/// The contact has ended when the mean force is below this share of the first window's.
const GONE_SHARE: f64 = 0.2;

/// Shorter pushes say nothing, s: [`WINDOWS_MIN`] windows.
const KNOCK_S: f64 = LENGTH_S + HOP_S * (WINDOWS_MIN - 1) as f64;

/// An onset may be wrong by so little that a window beyond the motion's end does no harm, s: it lets through 1e-4.
const END_SLACK_S: f64 = 1e-3;

/// A window whose mean is below this share of the first one's is no contact any more.
const LOST_SHARE: f64 = 0.1;

/// A window is worth something if this share of its weight has readings: one of the four that a hundred a second give
/// may be missing, which is up to 0.5 of the weight.
const COVERED_MIN: f64 = 0.45;

/// A drift at rest is one where chance would have it so once in two hundred rests, in standard deviations.
const DRIFT_SIGMAS: f64 = 3.0;

/// A bias that seems not to drift may do so by this share of a window's noise in a second: of the default finger 0.25 mN/s, half as
/// much again as where it warms by a kelvin a minute. With twice as much one or two pushes of a hundred (0.2 kg, 2 mN) have a
/// second pose listed that have none, with eight times four.
const DRIFT_SHARE: f64 = 0.25;

/// What the finger reads at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestNoise {
    /// Mean reading, finger axes, N.
    pub bias: Vector2<f64>,
    /// Covariance of that mean, N².
    pub bias_covariance: Matrix2<f64>,
    /// How fast the bias may drift, along either axis: standard deviations, N/s.
    pub drift_sd: Vector2<f64>,
    /// Since when it does, where it drifted at rest already, s: the middle of the rest. Else it may begin to with the push.
    pub drifts_since: Option<f64>,
    /// Covariance of a window's mean.
    pub window: Matrix2<f64>,
    /// Independent values of each axis that it was estimated from.
    pub window_freedom: f64,
    /// Covariance of a single reading.
    pub single: Matrix2<f64>,
    /// Time between readings, s.
    pub period: f64,
}

impl RestNoise {
    /// From a stretch at rest; half a second is enough, two are better.
    ///
    /// # Errors
    /// [`TareError`] if the finger was not at rest.
    pub fn estimate(readings: &[Reading]) -> Result<Self, TareError> {
        let tare = Tare::estimate(readings, &TareSettings { averaging: Averaging::Off, noise_max: None })?;
        let mut windows = Windows::new(tare.t_from);
        readings.iter().for_each(|reading| windows.push(reading, &tare.bias));
        let means: Vec<_> = windows.means(tare.period, tare.t_to).flatten().collect();
        let count = f64::from(u32::try_from(means.len()).unwrap_or(u32::MAX));
        let window = means.iter().map(|mean| mean * mean.transpose()).sum::<Matrix2<f64>>() / count.max(1.0);
        // Neighbours are alike a little, and the mean was taken off.
        let window_freedom = (count / (1.0 + 2.0 * NEIGHBOUR_CORRELATION.powi(2)) - 1.0).max(1.0);
        let window_sd = window.diagonal().map(f64::sqrt);
        let seconds = tare.t_to - tare.t_from;
        // A line's, through so many values.
        let by_chance = window_sd * ((12.0 / window_freedom).sqrt() / seconds);
        let is_drift = |drift: f64, by_chance: f64| drift.abs() > DRIFT_SIGMAS * by_chance;
        let measured =
            tare.drift.zip_map(&by_chance, |drift, chance| if is_drift(drift, chance) { drift } else { 0.0 });
        let drift_sd = measured.zip_map(&window_sd, |measured, window_sd| measured.hypot(DRIFT_SHARE * window_sd));
        Ok(Self {
            bias: tare.bias,
            bias_covariance: tare.bias_covariance,
            window,
            drift_sd,
            drifts_since: (measured.amax() > 0.0).then_some(0.5 * (tare.t_from + tare.t_to)),
            window_freedom,
            single: tare.single_covariance,
            period: tare.period,
        })
    }

    /// How far a tared reading is out of the noise, in standard deviations.
    fn sigmas(&self, force: &Vector2<f64>) -> f64 {
        noise::mahalanobis(force, &self.single)
    }
}

/// Weighted sums under windows, reading after reading.
#[derive(Clone, Debug)]
struct Windows {
    onset: f64,
    /// Of the onset, s.
    onset_sd: f64,
    /// Over so long a force is averaged to tell whether it is there, s.
    presence_s: f64,
    sums: Vec<(f64, Vector2<f64>)>,
    /// Tared, with times since the onset.
    readings: Vec<Reading>,
}

impl Windows {
    fn new(onset: f64) -> Self {
        Self { onset, onset_sd: 0.0, presence_s: RING_PERIOD_S, sums: Vec::new(), readings: Vec::new() }
    }

    fn push(&mut self, reading: &Reading, bias: &Vector2<f64>) {
        let time = reading.t - self.onset;
        if time < 0.0 {
            return;
        }
        self.readings.push(Reading::new(time, reading.force_finger - bias));
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative; hops of a session")]
        let last = (time / HOP_S) as usize;
        self.sums.resize(self.sums.len().max(last + 1), (0.0, Vector2::zeros()));
        for window in last.saturating_sub(1)..=last {
            let weight = hann_windows::weight(window, time);
            self.sums[window].0 += weight;
            self.sums[window].1 += (reading.force_finger - bias) * weight;
        }
    }

    /// Means of the windows that are over by `now`; none of one that lacks readings.
    fn means(&self, period: f64, now: f64) -> impl Iterator<Item = Option<Vector2<f64>>> + '_ {
        let full = LENGTH_S / period;
        let over = hann_windows::count(now - self.onset);
        let window = move |window| self.sums.get(window).filter(|(weight, _)| *weight >= COVERED_MIN * full);
        (0..over).map(move |index| window(index).map(|(weight, sum)| sum / *weight))
    }

    /// Since when the force is gone for good up to a time, s; none where it is not, or was never there.
    fn gone_since(&self, period: f64, until: f64) -> Option<f64> {
        let readings = &self.readings[..self.readings.partition_point(|reading| reading.t <= until)];
        let least = GONE_SHARE * self.sums.first().map(|(weight, sum)| sum.norm() / weight)?;
        let length = self.presence_s.max(period);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a handful of readings")]
        let count = (length / period).round().max(1.0) as usize;
        let means = readings.windows(count).enumerate().rev();
        let mut means = means.map(|(first, some)| (first, some.iter().map(|r| r.force_finger).sum::<Vector2<f64>>()));
        let there = means.find(|(_, sum)| sum.norm() >= least * count as f64)?.0;
        // The stretch that still had some force may have seen most of it go.
        (there + count < readings.len()).then(|| readings[there].t)
    }
}

/// A contact that was felt: when the force rose and when it had gone, on the readings' clock, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// When it began, s.
    pub from: f64,
    /// When it was over, s.
    pub to: f64,
}

/// Where a push is.
#[derive(Clone, Debug)]
enum Stage {
    /// Waiting for the force to leave its noise.
    Waiting,
    /// Begun by then, s; what is needed to say exactly when is not there yet.
    Rising(f64),
    /// Under way, with the windows so far.
    Pushing(Windows),
}

/// A tared finger that waits for a push and feels it.
#[derive(Clone, Debug)]
pub struct PushSense {
    rest: RestNoise,
    calibration: Option<CalibrationUncertainty>,
    /// What a prediction of a window may be off by, as a share of the force.
    model_share: f64,
    /// What the finger's own mass makes as it comes near, N: see [`COMES_NEAR`].
    inertia: f64,
    stage: Stage,
    /// Readings from just before the onset on, until it is known.
    recent: Vec<Reading>,
    now: f64,
    /// Contacts that were too short to be a push.
    knocks: Vec<Touch>,
}

impl PushSense {
    /// A finger that reads `rest` without force. Without a calibration its matrix counts as exact.
    #[must_use]
    pub fn new(rest: RestNoise, calibration: Option<&Calibration>) -> Self {
        let calibration = calibration.map(|calibration| CalibrationUncertainty {
            inverse: *calibration.inverse(),
            covariance: Matrix4::from(calibration.parts().covariance.fixed_view::<4, 4>(0, 0)),
        });
        Self {
            rest,
            calibration,
            model_share: CarriedFinger::RIGID.model_share(),
            inertia: 0.0,
            stage: Stage::Waiting,
            recent: Vec::new(),
            now: f64::NEG_INFINITY,
            knocks: Vec::new(),
        }
    }

    /// The same, of a finger that is as heavy, and rings as softly, as it is.
    #[must_use]
    pub fn carried(self, finger: &CarriedFinger) -> Self {
        Self { model_share: finger.model_share(), inertia: COMES_NEAR * finger.effective_mass, ..self }
    }

    /// Takes a reading, bias included.
    pub fn push(&mut self, reading: &Reading) {
        self.now = reading.t;
        if let Stage::Pushing(windows) = &mut self.stage {
            let before = windows.sums.len();
            windows.push(reading, &self.rest.bias);
            // Once a window, while it may still turn out to be a knock.
            if windows.sums.len() > before && self.now < windows.onset + KNOCK_S + 2.0 * LENGTH_S {
                self.forget_knock();
            }
            return;
        }
        self.recent.push(*reading);
        match self.stage {
            Stage::Rising(begun) => self.rise(begun),
            _ => self.wait(),
        }
    }

    /// Time goes on without a reading: what was sampled was no measurement.
    pub fn pass(&mut self, t: f64) {
        self.now = t;
    }

    /// Keeps a contact that was none; one at once after another is the same, ringing on.
    fn note_knock(&mut self, from: f64, to: f64) {
        match self.knocks.last_mut() {
            Some(last) if from < last.to + KNOCK_S => last.to = to,
            _ => self.knocks.push(Touch { from, to }),
        }
    }

    /// Waits for another contact where this one was over too early to be a push.
    fn forget_knock(&mut self) {
        let Stage::Pushing(windows) = &self.stage else { return };
        let gone = windows.gone_since(self.rest.period, f64::INFINITY).filter(|gone| *gone < KNOCK_S);
        // What rings on, or comes back at once, is the same contact.
        if let Some(gone) = gone.filter(|gone| self.now - windows.onset > gone + LENGTH_S) {
            let (from, to) = (windows.onset, windows.onset + gone);
            self.note_knock(from, to);
            self.stage = Stage::Waiting;
        }
    }

    fn wait(&mut self) {
        let is_out = |reading: &&Reading| self.rest.sigmas(&(reading.force_finger - self.rest.bias)) > ONSET_SIGMAS;
        let tail = self.recent.iter().rev().take(ATTEMPTS);
        let begun = if tail.filter(is_out).count() >= CONFIRMED {
            self.recent[self.index(self.now - self.before_s())..].iter().find(is_out).map(|reading| reading.t)
        } else {
            self.means_are_out().then_some(self.now - MEAN_S)
        };
        if let Some(begun) = begun {
            self.stage = Stage::Rising(begun);
            return;
        }
        // Not one by one, which would move the whole buffer for every reading.
        let kept = self.before_s().max(APART_S + 2.0 * MEAN_S);
        if self.recent.first().is_some_and(|first| first.t < self.now - 2.0 * kept) {
            self.recent.drain(..self.index(self.now - kept));
        }
    }

    /// What is looked at from before a reading that stands out, s.
    fn before_s(&self) -> f64 {
        (2.0 * BEFORE_S).max((ATTEMPTS as f64 + BEFORE_READINGS) * self.rest.period)
    }

    /// Of the first reading at or after a time.
    fn index(&self, t: f64) -> usize {
        self.recent.partition_point(|reading| reading.t < t)
    }

    /// Whether the last two means have left those before.
    fn means_are_out(&self) -> bool {
        let mean_before = |ago: f64| -> Option<Vector2<f64>> {
            let [from, to] = [ago + MEAN_S, ago].map(|ago| self.index(self.now + 0.5 * self.rest.period - ago));
            let full = (to - from) as f64 * self.rest.period > COVERED_MIN * MEAN_S;
            full.then(|| mean(self.recent[from..to].iter().map(|reading| reading.force_finger)))?
        };
        let own = self.rest.window * MEAN_VARIANCE;
        let is_out = |ago: f64| {
            // Soon after the rest there is none before.
            let then = mean_before(ago + APART_S).unwrap_or(self.rest.bias);
            let change = mean_before(ago).map(|now| now - then);
            change.is_some_and(|change| {
                change.norm() > self.inertia
                    && noise::mahalanobis(&change, &self.rest.single) > MEAN_SIGMAS
                    && noise::mahalanobis(&change, &own) > MEAN_OWN_SIGMAS
            })
        };
        is_out(0.0) && is_out(MEAN_S)
    }

    fn rise(&mut self, begun: f64) {
        if self.now < begun + FIRST_S {
            return;
        }
        if let Some(to) = self.knocked(begun) {
            self.note_knock(begun, to);
            self.recent.clear();
            self.stage = Stage::Waiting;
            return;
        }
        let mut windows = self.begun(begun);
        self.recent.iter().for_each(|reading| windows.push(reading, &self.rest.bias));
        self.recent.clear();
        self.stage = Stage::Pushing(windows);
    }

    /// When a contact was over that has gone already; none where its force stays.
    fn knocked(&self, begun: f64) -> Option<f64> {
        let force = |reading: &Reading| reading.force_finger - self.rest.bias;
        let most = self.recent.iter().map(|reading| force(reading).norm()).fold(0.0, f64::max);
        let last: Vec<_> = self.recent.iter().filter(|r| r.t > self.now - 2.0 * RING_PERIOD_S).map(force).collect();
        let left = mean(&last).map_or(0.0, |mean: Vector2<f64>| mean.norm());
        let out = self.recent.iter().rev().find(|reading| force(reading).norm() > 0.5 * most);
        (left < KNOCK_SHARE * most).then(|| out.map_or(begun, |reading| reading.t))
    }

    /// A push that began when the force rose through half of what it is at first, less the time that takes.
    fn begun(&self, begun: f64) -> Windows {
        let along = |reading: &Reading, mean: &Vector2<f64>| {
            (reading.force_finger - self.rest.bias).dot(mean) / mean.norm_squared()
        };
        let first = &self.recent[self.index(begun)..];
        let force = mean(first.iter().map(|reading| reading.force_finger - self.rest.bias)).unwrap_or_default();
        let sigmas = self.rest.sigmas(&force);
        let is_noisy = sigmas < NOISY_SIGMAS;
        let before = if is_noisy { APART_S } else { self.before_s() };
        let recent = &self.recent[self.index(begun - before)..];
        let crossing = if is_noisy {
            let above: Vec<_> = recent.iter().map(|reading| along(reading, &force) - RISE).collect();
            change(&above).map(|at| &recent[at - 1..=at])
        } else {
            recent.windows(2).find(|pair| along(&pair[0], &force) < RISE && along(&pair[1], &force) >= RISE)
        };
        // The first reading that stands out may have been taken while the force rose.
        let settled = first.iter().skip(1).map(|reading| (along(reading, &force) - 1.0).powi(2));
        let scatter: f64 = mean(settled).unwrap_or(0.0);
        let rings = (scatter - sigmas.powi(-2)).max(0.0).sqrt() > RINGS;
        let onset = match crossing {
            Some([before, after]) if rings => {
                let (low, high) = (along(before, &force), along(after, &force));
                before.t + (RISE - low) / (high - low) * (after.t - before.t) - RISE_TIME_S
            }
            // Anywhere between the two.
            Some([before, after]) => 0.5 * (before.t + after.t),
            _ => begun - if rings { RISE_TIME_S } else { 0.5 * self.rest.period },
        };
        let by_noise = if is_noisy { CHANGE_READINGS / sigmas.powi(2) } else { 0.0 };
        // Between two readings it is anywhere.
        let onset_sd = ONSET_SD_S.hypot(self.rest.period / 12.0_f64.sqrt()).hypot(self.rest.period * by_noise);
        let presence_s = if rings { RING_PERIOD_S } else { SHORT_S };
        let noisy_s = self.rest.period * (PRESENCE_SIGMAS / (GONE_SHARE * sigmas)).powi(2);
        Windows { onset_sd, presence_s: presence_s.max(noisy_s.min(LENGTH_S)), ..Windows::new(onset) }
    }

    /// Time of the last reading, s.
    #[must_use]
    pub fn now(&self) -> f64 {
        self.now
    }

    /// What it reads at rest.
    #[must_use]
    pub fn rest(&self) -> &RestNoise {
        &self.rest
    }

    /// What was read since the push began, tared, with times since then.
    #[must_use]
    pub fn readings(&self) -> &[Reading] {
        match &self.stage {
            Stage::Pushing(windows) => &windows.readings,
            Stage::Waiting | Stage::Rising(_) => &[],
        }
    }

    /// When the push began, s.
    #[must_use]
    pub fn onset_time(&self) -> Option<f64> {
        match &self.stage {
            Stage::Pushing(windows) => Some(windows.onset),
            Stage::Waiting | Stage::Rising(_) => None,
        }
    }

    /// The force up to now, or up to `until` seconds after the onset if that is earlier; none before the first window
    /// is over.
    #[must_use]
    pub fn windowed_force(&self, until: f64) -> Option<WindowedForce> {
        let Stage::Pushing(windows) = &self.stage else { return None };
        // The finger may stop, or the contact end, before the windows are thought to.
        let uncertain = (2.0 * windows.onset_sd - END_SLACK_S).max(0.0);
        let until = (self.now - windows.onset).min(until - uncertain);
        let gone = windows.gone_since(self.rest.period, until);
        let now = windows.onset + gone.map_or(until, |gone| until.min(gone));
        let means: Vec<_> = windows.means(self.rest.period, now).collect();
        let first = means.iter().flatten().next()?.norm();
        let is_there = |mean: &&Option<Vector2<f64>>| mean.is_none_or(|mean| mean.norm() >= LOST_SHARE * first);
        let kept = means.iter().take_while(is_there).count();
        // The window before one without contact saw the contact end.
        let kept = if kept < means.len() { kept.saturating_sub(2) } else { kept };
        let kept = means[..kept].iter().rposition(Option::is_some)? + 1;
        let uncertainty = Uncertainty {
            noise: self.rest.window,
            noise_freedom: self.rest.window_freedom,
            bias: self.rest.bias_covariance,
            drift_sd: self.rest.drift_sd,
            drift_before: self.rest.drifts_since.map_or(0.0, |since| windows.onset - since),
            calibration: self.calibration,
            onset_sd: windows.onset_sd,
            model_share: self.model_share,
        };
        let end = hann_windows::end(kept - 1);
        let times: Vec<_> = windows.readings.iter().map(|reading| reading.t).take_while(|time| *time < end).collect();
        WindowedForce::with_readings(means[..kept].to_vec(), &uncertainty, &times, self.rest.period)
    }

    /// Contacts before the push that were over too early to be one.
    #[must_use]
    pub fn knocks(&self) -> &[Touch] {
        &self.knocks
    }

    /// When the contact ended before so many seconds of the push were over, on the readings' clock; none where it did
    /// not.
    #[must_use]
    pub fn lost_before(&self, until: f64) -> Option<f64> {
        let Stage::Pushing(windows) = &self.stage else { return None };
        let until = until - 2.0 * windows.onset_sd;
        windows.gone_since(self.rest.period, until).map(|gone| windows.onset + gone)
    }

    /// Standard deviation of the moment when the push began, s.
    #[must_use]
    pub fn onset_sd(&self) -> Option<f64> {
        match &self.stage {
            Stage::Pushing(windows) => Some(windows.onset_sd),
            Stage::Waiting | Stage::Rising(_) => None,
        }
    }

    /// Whether the finger has lost the part: nothing that comes is of use.
    #[must_use]
    pub fn is_over(&self) -> bool {
        let Stage::Pushing(windows) = &self.stage else { return false };
        let means: Vec<_> = windows.means(self.rest.period, self.now).flatten().collect();
        let first = means.first().map_or(0.0, Vector2::norm);
        means.last().is_some_and(|last| last.norm() < LOST_SHARE * first)
    }
}

/// The first value above 0 after those that are mostly below: what changes there explains most.
fn change(values: &[f64]) -> Option<usize> {
    let mut left = 0.0;
    let sums = values.iter().enumerate().rev().map(|(at, value)| {
        left += value;
        (at, left)
    });
    let (at, _) = sums.max_by(|a, b| a.1.total_cmp(&b.1))?;
    (at > 0).then_some(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finger::contact::test_noise::Noise;

    /// Standard deviation of a reading at 4 kHz, N.
    const SIGMA: f64 = 0.01;

    fn noise(seed: u64) -> Noise {
        Noise { hum: 0.01, ..Noise::white(seed, SIGMA) }.sampled(4000.0)
    }

    #[test]
    fn the_windows_take_the_hum_out() {
        let rest = RestNoise::estimate(&noise(1).readings(8000)).unwrap();
        // Independent readings under a raised cosine of 160: variance 3/2 of a mean's.
        let wanted = SIGMA * (1.5 / 160.0_f64).sqrt();
        for axis in 0..2 {
            let sd = rest.window[(axis, axis)].sqrt();
            assert!((sd / wanted - 1.0).abs() < 0.3, "{sd:e}, wanted {wanted:e}");
        }
    }

    #[test]
    fn a_push_is_felt_from_its_onset_to_its_end() {
        let mut noise = noise(2);
        let rest = RestNoise::estimate(&noise.readings(8000)).unwrap();
        let mut sense = PushSense::new(rest, None);
        let onset = noise.t + 0.5;
        for _ in 0..6000 {
            let mut reading = noise.reading();
            let time = reading.t - onset;
            if (0.0..0.6).contains(&time) {
                // The disk rings about a force that grows.
                let ring = 1.0 - (-time / 0.043).exp() * (1171.8 * time).cos();
                reading.force_finger += Vector2::new(-1.0 - 0.2 * time, 0.3) * ring;
            }
            sense.push(&reading);
        }
        let found = sense.onset_time().unwrap();
        assert!((found - onset).abs() < 2.0 * ONSET_SD_S, "{found}, wanted {onset}");
        assert!(sense.is_over());
        let measured = sense.windowed_force(f64::INFINITY).unwrap();
        // Windows that end before the force does, less one.
        assert!((26..=29).contains(&measured.forces_finger().len()), "{}", measured.forces_finger().len());
        for (window, force) in measured.forces_finger().iter().flatten().enumerate() {
            let error = (force - Vector2::new(-1.0 - 0.2 * hann_windows::middle(window), 0.3)).norm();
            assert!(error < 5e-3, "window {window}: {error} N");
        }
    }

    /// A finger tared at a rate, and the noise that goes on.
    fn tared(seed: u64, rate_hz: f64) -> (PushSense, Noise) {
        let mut noise = Noise::white(seed, SIGMA).sampled(rate_hz);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "two seconds of readings")]
        let rest = RestNoise::estimate(&noise.readings((2.0 * rate_hz) as usize)).unwrap();
        (PushSense::new(rest, None), noise)
    }

    /// Goes on to a time with a force that depends on it.
    fn feel(sense: &mut PushSense, noise: &mut Noise, until: f64, force: impl Fn(f64) -> Vector2<f64>) {
        while noise.t < until {
            let mut reading = noise.reading();
            reading.force_finger += force(reading.t);
            sense.push(&reading);
        }
    }

    /// By a sensor of which no reading stands out of its noise, a push is felt all the same, nearly when it began and when it ended.
    #[test]
    fn a_force_of_few_deviations_is_felt() {
        /// Of a mean over a window, in the least of these forces.
        const NEAR: f64 = 0.25;
        for (sigmas, rate_hz) in [(4.0, 4000.0), (6.0, 4000.0), (8.0, 2000.0), (12.0, 1000.0), (5.0, 1000.0)] {
            let force = PUSH.normalize() * (sigmas * SIGMA);
            let mut beyond = 0;
            for seed in 10..30 {
                let (mut sense, mut noise) = tared(seed, rate_hz);
                // Some at once after the rest.
                let onset = noise.t + if seed % 2 == 0 { 0.5 } else { 0.03 };
                let felt = |t: f64| if (onset..onset + 0.5).contains(&t) { force } else { Vector2::zeros() };
                feel(&mut sense, &mut noise, onset + 0.6, felt);
                let (found, sd) = (sense.onset_time().unwrap(), sense.onset_sd().unwrap());
                beyond += usize::from((found - onset).abs() > 2.5 * sd);
                assert!((found - onset).abs() < 5.0 * sd, "{sigmas}, {seed}: {} of {sd}", found - onset);
                let measured = sense.windowed_force(f64::INFINITY).unwrap();
                assert!(measured.count() >= 20, "{sigmas}, {seed}: {} windows", measured.count());
                for felt in measured.forces_finger().iter().flatten() {
                    assert!((felt - force).norm() < NEAR * force.norm(), "{sigmas}, {seed}: {felt}");
                }
            }
            assert!(beyond <= 2, "{sigmas}: {beyond} of 20");
        }
    }

    /// Nor is a bias that drifts; noise of 10 mN lets 30 mN be felt.
    #[test]
    fn a_heavy_finger_that_comes_near_is_no_push() {
        let finger = CarriedFinger { effective_mass: 0.2, ..CarriedFinger::RIGID };
        let coming = |t: f64| within(t, 2.5, 3.0) / PUSH.norm() * 0.045;
        let drifting = |t: f64| Vector2::new(0.04 * (t - 2.0).max(0.0), 0.0);
        let is_felt = |carried: bool, force: &dyn Fn(f64) -> Vector2<f64>| {
            let (sense, mut noise) = tared(8, 4000.0);
            let mut sense = if carried { sense.carried(&finger) } else { sense };
            feel(&mut sense, &mut noise, 3.5, force);
            sense.onset_time().is_some()
        };
        assert!(!is_felt(true, &coming) && is_felt(false, &coming), "0.045 N");
        assert!(!is_felt(false, &drifting), "0.04 N/s");
    }

    const PUSH: Vector2<f64> = Vector2::new(-1.0, 0.3);

    fn within(time: f64, from: f64, to: f64) -> Vector2<f64> {
        if (from..to).contains(&time) { PUSH } else { Vector2::zeros() }
    }

    #[test]
    fn the_onset_of_a_stiff_sensor_is_as_uncertain_as_its_readings_are_far_apart() {
        for rate_hz in [100.0, 250.0, 1000.0, 4000.0] {
            for phase in 0..6 {
                let (mut sense, mut noise) = tared(4, rate_hz);
                let onset = noise.t + 0.5 + f64::from(phase) / 6.0 / rate_hz;
                feel(&mut sense, &mut noise, onset + 0.5, |t| within(t, onset, f64::INFINITY));
                let (found, sd) = (sense.onset_time().unwrap(), sense.onset_sd().unwrap());
                assert!((found - onset).abs() < 0.51 / rate_hz, "{rate_hz} Hz, phase {phase}: {}", found - onset);
                assert!(sd > 0.28 / rate_hz && sd < 0.3 / rate_hz + ONSET_SD_S, "{rate_hz} Hz: {sd}");
            }
        }
    }

    #[test]
    fn a_knock_before_the_push_is_kept_as_one() {
        for length in [0.012, 0.05] {
            let (mut sense, mut noise) = tared(5, 1000.0);
            let (knock, onset) = (noise.t + 0.4, noise.t + 1.2);
            let force = |t: f64| within(t, knock, knock + length) + within(t, onset, f64::INFINITY);
            feel(&mut sense, &mut noise, onset + 0.5, force);
            let found = sense.onset_time().unwrap();
            assert!((found - onset).abs() < 2e-3, "{length} s: {found}, wanted {onset}");
            let [Touch { from, to }] = sense.knocks() else { panic!("{length} s: {:?}", sense.knocks()) };
            assert!((from - knock).abs() < 5e-3 && (to - knock - length).abs() < 5e-3, "{length} s: {from} {to}");
        }
    }

    #[test]
    fn windows_end_before_the_contact_does() {
        for lost in [5e-3, 0.01, 0.02, 0.04] {
            let (mut sense, mut noise) = tared(6, 1000.0);
            let onset = noise.t + 0.5;
            feel(&mut sense, &mut noise, onset + 0.6, |t| within(t, onset, onset + 0.6 - lost));
            let measured = sense.windowed_force(0.6).unwrap();
            for force in measured.forces_finger().iter().flatten() {
                assert!((force - PUSH).norm() < 0.02, "{lost} s: {force:?}");
            }
            assert!(measured.count() >= 25, "{lost} s: {}", measured.count());
            let found = sense.lost_before(0.6).unwrap();
            assert!((found - (onset + 0.6 - lost)).abs() < 4e-3, "{lost} s: {found}");
        }
    }

    #[test]
    fn a_bias_that_drifts_at_rest_may_go_on_as_fast() {
        /// Force/s; of the noise here a slope over 2 s is known to a tenth of it.
        const DRIFT: f64 = 5e-3;
        let mut still = noise(7);
        let still = RestNoise::estimate(&still.readings(8000)).unwrap();
        let mut drifting = Noise { drift: DRIFT, ..noise(7) };
        let drifting = RestNoise::estimate(&drifting.readings(8000)).unwrap();
        for axis in 0..2 {
            let at_least = DRIFT_SHARE * still.window[(axis, axis)].sqrt();
            assert!((still.drift_sd[axis] / at_least - 1.0).abs() < 1e-9, "{}", still.drift_sd);
        }
        assert!((drifting.drift_sd.x / DRIFT - 1.0).abs() < 0.3, "{}", drifting.drift_sd);
        assert!(drifting.drift_sd.y < 0.5 * DRIFT, "{}", drifting.drift_sd);
        // From the middle of its two seconds on.
        assert!(still.drifts_since.is_none() && (drifting.drifts_since.unwrap() - 1.0).abs() < 1e-3);
    }

    #[test]
    fn noise_alone_is_no_push() {
        let mut noise = noise(3);
        let mut sense = PushSense::new(RestNoise::estimate(&noise.readings(8000)).unwrap(), None);
        (0..100_000).for_each(|_| sense.push(&noise.reading()));
        // A fifth of a second of them at the most.
        assert!(sense.onset_time().is_none() && sense.recent.len() < 1000, "{}", sense.recent.len());
    }
}
