//! From force readings to what was felt of a push: noise at rest, the onset, and the windows' means.
//!
//! The finger begins at rest, touching the part or nothing. [`RestNoise`] is what it then reads. [`PushSense`] takes
//! reading after reading; where the force leaves the noise, the push has begun, and from then on it is averaged under
//! the windows of [`from_rest`](crate::pushing::estimation::from_rest). The push is over when the finger loses the
//! part, or readings are missing.
//!
//! Assumes: the force is there at once when the finger begins to move, as support friction makes it. The disk then
//! rings about it; the onset is found on the first rise.
//! Frames: finger axes; force is the force on the finger's disk. Units: s, and the calibration's unit of force.
//! Errors: [`TareError`] where the finger was not at rest.

use nalgebra::{Matrix2, Matrix4, Vector2};

use crate::finger::calibration::Calibration;
use crate::finger::contact::{Averaging, Reading, Tare, TareError, TareSettings};
use crate::pushing::estimation::from_rest::hann_windows::{self, HOP_S, LENGTH_S};
use crate::pushing::estimation::from_rest::{CalibrationUncertainty, Uncertainty, WindowedForce};

/// The force has left the noise when it is this many standard deviations of a reading, for [`CONFIRMED`] readings of
/// [`ATTEMPTS`] in a row: by chance once in a year.
const ONSET_SIGMAS: f64 = 8.0;

/// Readings that must stand out; see [`ONSET_SIGMAS`].
const CONFIRMED: usize = 6;

/// See [`ONSET_SIGMAS`]. The ringing disk comes back to no force once a period, 21 readings of the default finger.
const ATTEMPTS: usize = 8;

/// Readings kept from before the force leaves the noise, s: the rise begins there.
const BEFORE_S: f64 = 0.01;

/// Readings over which the size of the first force is averaged, s: seven periods of the disk's ringing.
const FIRST_S: f64 = 0.04;

/// Share of the first force whose crossing marks the rise.
const RISE: f64 = 0.5;

/// From the onset to that crossing, s: a sixth of a period of the default finger's disk, 186.5 Hz.
const RISE_TIME_S: f64 = 0.9e-3;

/// Standard deviation of the onset's moment, s: another finger's disk may ring at half or twice the frequency, a robot
/// takes a millisecond to accelerate.
const ONSET_SD_S: f64 = 0.3e-3;

/// A window whose mean is below this share of the first one's is no contact any more.
const LOST_SHARE: f64 = 0.1;

/// A window is worth something if this share of its weight has readings.
const COVERED_MIN: f64 = 0.9;

/// What the finger reads at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestNoise {
    /// Mean reading, finger axes, N.
    pub bias: Vector2<f64>,
    /// Covariance of that mean, N².
    pub bias_covariance: Matrix2<f64>,
    /// Covariance of a window's mean.
    pub window: Matrix2<f64>,
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
        let means: Vec<_> = windows.complete(tare.period, tare.t_to).collect();
        let count = f64::from(u32::try_from(means.len()).unwrap_or(u32::MAX));
        let window = means.iter().map(|mean| mean * mean.transpose()).sum::<Matrix2<f64>>() / count.max(1.0);
        Ok(Self {
            bias: tare.bias,
            bias_covariance: tare.bias_covariance,
            window,
            single: tare.single_covariance,
            period: tare.period,
        })
    }

    /// How far a tared reading is out of the noise, in standard deviations.
    fn sigmas(&self, force: &Vector2<f64>) -> f64 {
        crate::finger::contact::noise::mahalanobis(force, &self.single)
    }
}

/// Weighted sums under windows, reading after reading.
#[derive(Clone, Debug)]
struct Windows {
    onset: f64,
    sums: Vec<(f64, Vector2<f64>)>,
}

impl Windows {
    fn new(onset: f64) -> Self {
        Self { onset, sums: Vec::new() }
    }

    fn push(&mut self, reading: &Reading, bias: &Vector2<f64>) {
        let time = reading.t - self.onset;
        if time < 0.0 {
            return;
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative; hops of a session")]
        let last = (time / HOP_S) as usize;
        self.sums.resize(self.sums.len().max(last + 1), (0.0, Vector2::zeros()));
        for window in last.saturating_sub(1)..=last {
            let weight = hann_windows::weight(window, time);
            self.sums[window].0 += weight;
            self.sums[window].1 += (reading.force_finger - bias) * weight;
        }
    }

    /// Means of the windows that are over by `now`, up to the first that lacks readings.
    fn complete(&self, period: f64, now: f64) -> impl Iterator<Item = Vector2<f64>> + '_ {
        let full = LENGTH_S / period;
        let over = hann_windows::count(now - self.onset);
        let covered = self.sums.iter().take(over).take_while(move |(weight, _)| *weight >= COVERED_MIN * full);
        covered.map(|(weight, sum)| sum / *weight)
    }
}

/// Where a push is.
#[derive(Clone, Debug)]
enum Stage {
    /// Waiting for the force to leave its noise.
    Waiting,
    /// Begun; what is needed to say exactly when is not there yet.
    Rising,
    /// Under way, with the windows so far.
    Pushing(Windows),
}

/// A tared finger that waits for a push and feels it.
#[derive(Clone, Debug)]
pub struct PushSense {
    rest: RestNoise,
    calibration: Option<CalibrationUncertainty>,
    stage: Stage,
    /// Readings from just before the onset on, until it is known.
    recent: Vec<Reading>,
    now: f64,
}

impl PushSense {
    /// A finger that reads `rest` without force. Without a calibration its matrix counts as exact.
    #[must_use]
    pub fn new(rest: RestNoise, calibration: Option<&Calibration>) -> Self {
        let calibration = calibration.map(|calibration| CalibrationUncertainty {
            inverse: *calibration.inverse(),
            covariance: Matrix4::from(calibration.parts().covariance.fixed_view::<4, 4>(0, 0)),
        });
        Self { rest, calibration, stage: Stage::Waiting, recent: Vec::new(), now: f64::NEG_INFINITY }
    }

    /// Takes a reading, bias included.
    pub fn push(&mut self, reading: &Reading) {
        self.now = reading.t;
        if let Stage::Pushing(windows) = &mut self.stage {
            return windows.push(reading, &self.rest.bias);
        }
        self.recent.push(*reading);
        match self.stage {
            Stage::Waiting => self.wait(),
            _ => self.rise(),
        }
    }

    fn wait(&mut self) {
        let tail = self.recent.iter().rev().take(ATTEMPTS);
        let out = tail.filter(|reading| self.rest.sigmas(&(reading.force_finger - self.rest.bias)) > ONSET_SIGMAS);
        if out.count() >= CONFIRMED {
            self.stage = Stage::Rising;
            return;
        }
        // Not one by one, which would move the whole buffer for every reading.
        let old = self.recent.iter().take_while(|reading| reading.t < self.now - 2.0 * BEFORE_S).count();
        if self.recent.first().is_some_and(|first| first.t < self.now - 4.0 * BEFORE_S) {
            self.recent.drain(..old);
        }
    }

    fn rise(&mut self) {
        let out = |reading: &&Reading| self.rest.sigmas(&(reading.force_finger - self.rest.bias)) > ONSET_SIGMAS;
        let begun = self.recent.iter().find(out).map_or(self.now, |reading| reading.t);
        if self.now < begun + FIRST_S {
            return;
        }
        let mut windows = Windows::new(self.onset(begun));
        self.recent.iter().for_each(|reading| windows.push(reading, &self.rest.bias));
        self.recent.clear();
        self.stage = Stage::Pushing(windows);
    }

    /// When the force rose through half of what it is at first, less the time that takes.
    fn onset(&self, begun: f64) -> f64 {
        let first: Vec<_> = self.recent.iter().filter(|reading| reading.t >= begun).collect();
        let count = f64::from(u32::try_from(first.len()).unwrap_or(u32::MAX)).max(1.0);
        let mean = first.iter().map(|reading| reading.force_finger - self.rest.bias).sum::<Vector2<f64>>() / count;
        let along = |reading: &Reading| (reading.force_finger - self.rest.bias).dot(&mean) / mean.norm_squared();
        let crossing = self.recent.windows(2).find_map(|pair| {
            let (before, after) = (along(&pair[0]), along(&pair[1]));
            let share = (RISE - before) / (after - before);
            (before < RISE && after >= RISE).then(|| pair[0].t + share * (pair[1].t - pair[0].t))
        });
        crossing.unwrap_or(begun) - RISE_TIME_S
    }

    /// Time of the last reading, s.
    #[must_use]
    pub fn now(&self) -> f64 {
        self.now
    }

    /// When the push began, s.
    #[must_use]
    pub fn onset_time(&self) -> Option<f64> {
        match &self.stage {
            Stage::Pushing(windows) => Some(windows.onset),
            Stage::Waiting | Stage::Rising => None,
        }
    }

    /// The force up to now, or up to `until` seconds after the onset if that is earlier; none before the first window
    /// is over.
    #[must_use]
    pub fn windowed_force(&self, until: f64) -> Option<WindowedForce> {
        let Stage::Pushing(windows) = &self.stage else { return None };
        let now = self.now.min(windows.onset + until);
        let means: Vec<_> = windows.complete(self.rest.period, now).collect();
        let first = means.first()?.norm();
        let kept = means.iter().take_while(|mean| mean.norm() >= LOST_SHARE * first).count();
        // The window before one without contact saw the contact end.
        let kept = if kept < means.len() { kept.saturating_sub(2) } else { kept };
        let uncertainty = Uncertainty {
            noise: self.rest.window,
            bias: self.rest.bias_covariance,
            calibration: self.calibration,
            onset_sd: ONSET_SD_S,
        };
        WindowedForce::new(means[..kept].to_vec(), &uncertainty)
    }

    /// Whether the finger has lost the part, or readings are missing: nothing that comes is of use.
    #[must_use]
    pub fn is_over(&self) -> bool {
        let Stage::Pushing(windows) = &self.stage else { return false };
        let over = hann_windows::count(self.now - windows.onset);
        let means: Vec<_> = windows.complete(self.rest.period, self.now).collect();
        let first = means.first().map_or(0.0, Vector2::norm);
        means.len() < over || means.last().is_some_and(|last| last.norm() < LOST_SHARE * first)
    }
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
        for (window, force) in measured.forces_finger().iter().enumerate() {
            let middle = hann_windows::end(window) - 0.5 * LENGTH_S;
            let error = (force - Vector2::new(-1.0 - 0.2 * middle, 0.3)).norm();
            assert!(error < 5e-3, "window {window}: {error} N");
        }
    }

    #[test]
    fn noise_alone_is_no_push() {
        let mut noise = noise(3);
        let mut sense = PushSense::new(RestNoise::estimate(&noise.readings(8000)).unwrap(), None);
        (0..100_000).for_each(|_| sense.push(&noise.reading()));
        assert!(sense.onset_time().is_none() && sense.recent.len() < 400);
    }
}
