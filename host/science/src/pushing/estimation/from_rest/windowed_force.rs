//! The force that was felt over a push, window by window, with everything that is uncertain about it.
//!
//! Noise is independent between samples, hence nearly so between windows. The rest is common to all windows: the tare's
//! bias and what the calibration left open (four numbers of the finger's matrix). Together they are one covariance of
//! all windows, and what is compared is whitened by it. The moment of the onset is uncertain too: it is found with the
//! rest of the unknowns where it is known when readings were taken ([`WindowedForce::with_readings`]), and otherwise part
//! of the covariance, to first order.
//!
//! A window's mean is a sum over readings. Where there are few of them it is no integral: a force that jumps between
//! two of a hundred readings a second moves it by a tenth of the jump. So what is predicted is summed over the same
//! readings. A reading sees a jump or does not, where a mean over its period would see some of it: what it may have seen
//! is one more unknown, found in closed form (`Predicted`).
//!
//! Frames: finger axes; force is the force on the finger's disk. Units: SI, or the calibration's relative unit of
//! force.
//! Errors: [`WindowedForce::new`] gives none where there is nothing to compare.

use std::f64::consts::TAU;

use nalgebra::{DVector, Matrix2, Matrix2x4, Matrix4, Vector2};

use super::felt::{Felt, Predicted, drift_weights};
use super::hann_windows::{self, HOP_S, LENGTH_S, NEIGHBOUR_CORRELATION};
use super::path::Path;
use super::whitener::{CommonShares, Uncertain, Whitener};
use crate::math::unscented::square_root;
use crate::pushing::finger_motion::FingerMotion;

/// What a prediction may be off by, as a share of the force: the disk's ringing, which a window lets through by 8e-4 at
/// first, sums over a grid where the times of the readings are not known; both are mostly a quarter of their most. With
/// twice as much truths cost half of what chance would have them cost, with half as much ringing ones too much.
const MODEL_SHARE: f64 = 2e-4;

/// Of what a window lets through of a finger's ringing at the most, so much counts: it dies down, and is at any phase.
const RINGING_SHARE: f64 = 0.2;

/// How uncertain the windows' means are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertainty {
    /// Covariance of one window's mean by noise, N².
    pub noise: Matrix2<f64>,
    /// Independent values of each axis that `noise` was estimated from; infinite where it is known.
    pub noise_freedom: f64,
    /// Covariance of the bias that was taken off, N².
    pub bias: Matrix2<f64>,
    /// How fast the bias may drift, along either axis: standard deviations, N/s.
    pub drift_sd: Vector2<f64>,
    /// From so long before the onset on, s.
    pub drift_before: f64,
    /// What the calibration left open, if it is known.
    pub calibration: Option<CalibrationUncertainty>,
    /// Standard deviation of the moment of the onset, s.
    pub onset_sd: f64,
    /// What a prediction may be off by, as a share of the force: [`CarriedFinger::model_share`].
    pub model_share: f64,
}

/// The finger's matrix and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationUncertainty {
    /// A = B⁻¹, N per count.
    pub inverse: Matrix2<f64>,
    /// Covariance of B's entries, row by row, counts² per N².
    pub covariance: Matrix4<f64>,
}

/// How a carried finger alters what is felt of a contact.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct CarriedFinger {
    /// Of disk, and what of the beam bends with it, kg: where the clamp accelerates by a the gauges read −m a beside the
    /// contact's force.
    pub effective_mass: f64,
    /// Its standard deviation, kg.
    pub effective_mass_sd: f64,
    /// How far the disk gives way to a force on it, m/N.
    pub compliance: f64,
    /// Its standard deviation, m/N.
    pub compliance_sd: f64,
    /// Standard deviation of each coordinate of where the disk is on its robot, m.
    pub place_sd: f64,
}

impl CarriedFinger {
    /// One that feels nothing of itself and does not bend, such as a sensor whose readings are free of that already.
    pub const RIGID: Self =
        Self { effective_mass: 0.0, effective_mass_sd: 0.0, compliance: 0.0, compliance_sd: 0.0, place_sd: 0.0 };

    /// One of which nothing is known: about what a disk of steel or a fingertip of plastic with its beam weighs.
    pub const UNKNOWN: Self = Self { effective_mass: 0.02, effective_mass_sd: 0.02, ..Self::RIGID };

    /// What a prediction of a window may be off by, as a share of the force: a heavy finger on a soft beam rings slowly, and a
    /// window takes less out of that.
    #[must_use]
    pub fn model_share(&self) -> f64 {
        // One that does not bend does not ring.
        let ringing_s = TAU * (self.effective_mass * self.compliance).max(0.0).sqrt();
        let rings = if ringing_s > 0.0 { hann_windows::let_through(ringing_s.recip()) } else { 0.0 };
        MODEL_SHARE.max(RINGING_SHARE * rings)
    }

    /// What is not known of where the disk is under a force (N): covariance of its place, and of a part's beside it, m².
    #[must_use]
    pub fn place_covariance(&self, force_finger: Vector2<f64>) -> Matrix2<f64> {
        place_covariance(self.place_sd, self.compliance_sd, force_finger)
    }
}

/// Covariance of the place of a disk that is known to `place_sd` (m) without force, and gives way to one (N) by what is known to
/// `compliance_sd` (m/N); m².
pub(super) fn place_covariance(place_sd: f64, compliance_sd: f64, force_finger: Vector2<f64>) -> Matrix2<f64> {
    let way = force_finger * compliance_sd;
    Matrix2::identity() * place_sd.powi(2) + way * way.transpose()
}

/// Means of the force under the windows, and what whitens them.
#[derive(Clone, Debug)]
pub struct WindowedForce {
    /// By window; none where too few readings are under it.
    forces_finger: Vec<Option<Vector2<f64>>>,
    /// The means times L⁻¹, in standard deviations.
    data: DVector<f64>,
    /// L⁻¹ of the covariance L Lᵀ of the windows that have a mean.
    whitener: Whitener,
    /// Independent values that the size of the covariance is known from.
    freedom: f64,
    onset_sd: f64,
    readings: Option<WindowReadings>,
    /// What one standard deviation of each adds to `data`: of the finger's effective mass, where it has one, first; of each thing
    /// that the model is off by; of a bias that is thought to drift, along either axis.
    beside: Vec<DVector<f64>>,
}

/// When the readings under the windows were taken.
#[derive(Clone, Debug)]
struct WindowReadings {
    /// In order of time.
    groups: Vec<ReadingGroup>,
    /// Time between two of them, s.
    period: f64,
}

/// A reading, or several within [`JUMP_S`] of each other, as one.
#[derive(Clone, Copy, Debug)]
struct ReadingGroup {
    /// Mean time since the onset as it was taken for, s.
    time: f64,
    /// The window of the first weight; the second is of the next.
    window: usize,
    /// Shares of the two windows' means.
    weights: [f64; 2],
}

impl WindowReadings {
    /// None where a window that has a mean has no reading.
    fn new(times: &[f64], period: f64, means: &[Option<Vector2<f64>>]) -> Option<Self> {
        let windows = means.len();
        let mut sums = vec![0.0; windows];
        for &time in times {
            for (window, weight) in hann_windows::weights_at(time, windows) {
                sums[window] += weight;
            }
        }
        if !(period > 0.0 && sums.iter().zip(means).all(|(sum, mean)| *sum > 0.0 || mean.is_none())) {
            return None;
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a handful; 0 counts as 1")]
        let together = ((JUMP_S / period + 1e-6) as usize).max(1);
        let group = |times: &[f64]| {
            let time = times.iter().sum::<f64>() / times.len() as f64;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "negative times become 0")]
            let window = ((time / HOP_S) as usize).saturating_sub(1);
            let weight = |window: usize| {
                let weights = times.iter().map(|time| hann_windows::weight(window, *time)).sum::<f64>();
                sums.get(window).filter(|sum| **sum > 0.0).map_or(0.0, |sum| weights / sum)
            };
            ReadingGroup { time, window, weights: [weight(window), weight(window + 1)] }
        };
        Some(Self { groups: times.chunks(together).map(group).collect(), period: period * together as f64 })
    }
}

/// Where under a window a mean is taken whose readings' times are not known, as shares of its length: a jump moves it by
/// a sixteenth of itself at most.
const MEAN_POINTS: [f64; 16] = {
    let mut points = [0.0; 16];
    let mut n = 0;
    while n < 16 {
        points[n] = (n as f64 + 0.5) / 16.0;
        n += 1;
    }
    points
};

/// Few values tell too little of a noise to divide by: fewer count as so many.
const FREEDOM_MIN: f64 = 4.0;

/// A jump of the force is spread over a reading's period, and over no more than this, s: sums over readings then change
/// evenly with the moment of the jump.
const JUMP_S: f64 = 1e-3;

/// The onset is sought within so many standard deviations of what it was taken for.
pub(super) const ONSET_RANGE: f64 = 3.0;

/// Onsets less certain than this are tried at several places before a fit, s: means of the force bend within 10 ms.
const ONSET_SURE_S: f64 = 4e-4;

/// Where, in standard deviations: all over the time between two readings, which reaches √3 to either side.
const ONSETS_TRIED: [f64; 11] = [0.0, -0.34, 0.34, -0.68, 0.68, -1.02, 1.02, -1.36, 1.36, -1.7, 1.7];

impl Felt for WindowedForce {
    fn data(&self) -> &DVector<f64> {
        &self.data
    }

    fn freedom(&self) -> f64 {
        self.freedom
    }

    fn first(&self) -> Vector2<f64> {
        self.forces_finger.iter().flatten().next().copied().unwrap_or_default()
    }

    fn onset_sd(&self) -> Option<f64> {
        (self.readings.is_some() && self.onset_sd > 0.0).then_some(self.onset_sd)
    }

    fn onsets_tried(&self) -> Vec<f64> {
        let uncertain = self.onset_sd().filter(|sd| *sd > ONSET_SURE_S);
        let count = if uncertain.is_some() { ONSETS_TRIED.len() } else { 1 };
        ONSETS_TRIED.into_iter().take(count).map(move |place| place * self.onset_sd).collect()
    }

    fn beginning(&self, until: f64) -> Option<Box<dyn Felt>> {
        Some(Box::new(self.beginning_of(hann_windows::count(until))))
    }

    fn predicted(&self, path: &Path, delay: f64) -> Predicted {
        let beside = self.beside.clone();
        let Some(readings) = &self.readings else {
            return Predicted { beside, ..Predicted::exact(self.whiten(path.windows(self.span()))) };
        };
        let mut sums = vec![Vector2::zeros(); self.span()];
        let mut unsure: Vec<(usize, Vec<Vector2<f64>>)> = Vec::new();
        let mut force = path.forces(readings.period.min(JUMP_S));
        for group in &readings.groups {
            let time = group.time - delay;
            let mean = force.at(time);
            let add = |sums: &mut Vec<Vector2<f64>>, force: Vector2<f64>| {
                for (sum, weight) in sums.iter_mut().skip(group.window).zip(group.weights) {
                    *sum += force * weight;
                }
            };
            add(&mut sums, mean);
            if let Some((jump, sd)) = force.unsure(time) {
                if unsure.last().is_none_or(|(last, _)| *last != jump) {
                    unsure.push((jump, vec![Vector2::zeros(); self.span()]));
                }
                unsure.last_mut().into_iter().for_each(|(_, sums)| add(sums, sd));
            }
        }
        let unsure = unsure.into_iter().map(|(_, sums)| self.whiten(sums.into_iter())).collect();
        Predicted { unsure, beside, ..Predicted::exact(self.whiten(sums.into_iter())) }
    }
}

impl WindowedForce {
    /// From the means of the windows, tared, of a contact that began at time 0.
    ///
    /// None without a window, or where the covariance is none.
    #[must_use]
    pub fn new(forces_finger: Vec<Vector2<f64>>, uncertainty: &Uncertainty) -> Option<Self> {
        let covered = vec![1.0; forces_finger.len()];
        let means = forces_finger.into_iter().map(Some).collect();
        Self::whitened(means, uncertainty, uncertainty.onset_sd, &covered)
    }

    /// The same, with the times of the readings (since the onset as it is taken for, ascending, s) and the time between
    /// two of them: then the onset is found with the other unknowns, and windows that lack readings are noisier. Those
    /// without a mean are left out.
    #[must_use]
    pub fn with_readings(
        forces_finger: Vec<Option<Vector2<f64>>>,
        uncertainty: &Uncertainty,
        times: &[f64],
        period: f64,
    ) -> Option<Self> {
        let readings = Some(WindowReadings::new(times, period, &forces_finger)?);
        let covered = covered(times, period, forces_finger.len());
        let whitened = Self::whitened(forces_finger, uncertainty, 0.0, &covered)?;
        Some(Self { readings, onset_sd: uncertainty.onset_sd, ..whitened })
    }

    fn whitened(
        forces_finger: Vec<Option<Vector2<f64>>>,
        uncertainty: &Uncertainty,
        onset_sd: f64,
        covered: &[f64],
    ) -> Option<Self> {
        let felt: Vec<_> = forces_finger
            .iter()
            .zip(covered)
            .enumerate()
            .filter_map(|(window, (force, covered))| Some(Window { window, force: (*force)?, covered: *covered }))
            .collect();
        let is_finite = |felt: &Window| felt.force.iter().all(|value| value.is_finite());
        if felt.is_empty() || !felt.iter().all(is_finite) {
            return None;
        }
        let uncertain = uncertain(&felt, uncertainty, onset_sd);
        let whitener = Whitener::new(&uncertain)?;
        let noise_share = noise_share(&uncertain, noise(uncertainty).trace());
        let data = whitener.whiten(felt.iter().map(|felt| felt.force));
        // Satterthwaite: only the part of the variance that is noise was estimated from so few values, of two axes.
        let freedom = 2.0 * uncertainty.noise_freedom.max(FREEDOM_MIN) / (noise_share * noise_share);
        Some(Self { forces_finger, data, whitener, freedom, onset_sd: 0.0, readings: None, beside: Vec::new() })
    }

    /// What the contact alone exerted, where these are the readings of a finger of some mass that moved so: with
    /// m a taken out of −m a, and what of m is not known.
    ///
    /// The onset is where it was taken for: a millisecond's error moves the mean of a window by a tenth of m a.
    #[must_use]
    pub fn of_contact(&self, motion: &FingerMotion, finger: CarriedFinger) -> Self {
        if finger.effective_mass == 0.0 && finger.effective_mass_sd == 0.0 {
            return self.clone();
        }
        let accelerations = self.means_of(|t| motion.acceleration(t));
        let whitened = self.whiten(accelerations.iter().copied());
        let forces_finger =
            self.forces_finger.iter().zip(&accelerations).map(|(force, a)| Some((*force)? + a * finger.effective_mass));
        Self {
            forces_finger: forces_finger.collect(),
            data: &self.data + &whitened * finger.effective_mass,
            beside: (finger.effective_mass_sd > 0.0)
                .then(|| whitened * -finger.effective_mass_sd)
                .into_iter()
                .chain(self.beside.iter().cloned())
                .collect(),
            ..self.clone()
        }
    }

    /// The same for a search that does not find what a model is off by: noise is more by a share of the force.
    pub(super) fn roughly(&self, share: f64) -> Self {
        let deviations = (self.data.norm_squared() / self.data.len() as f64).sqrt();
        let noise = (share * deviations).hypot(1.0);
        Self {
            data: &self.data / noise,
            whitener: self.whitener.with_noise(noise),
            beside: self.beside.iter().map(|beside| beside / noise).collect(),
            ..self.clone()
        }
    }

    /// The same for a first look, which is quicker: the onset is taken for where it is, and nothing is known of the times of readings.
    pub(super) fn without_times(&self) -> Self {
        Self { onset_sd: 0.0, readings: None, ..self.clone() }
    }

    /// The same of the first windows alone: exactly, since whitening goes from the first window on.
    pub(super) fn beginning_of(&self, windows: usize) -> Self {
        let span = windows.min(self.span());
        let forces_finger = self.forces_finger[..span].to_vec();
        let windows = forces_finger.iter().flatten().count();
        let values = 2 * windows;
        Self {
            forces_finger,
            data: self.data.rows(0, values).into_owned(),
            whitener: self.whitener.beginning(windows),
            beside: self.beside.iter().map(|beside| beside.rows(0, values).into_owned()).collect(),
            ..self.clone()
        }
    }

    /// The same of a bias that drifts from the onset on, by a standard deviation along each axis (N/s): the last two of what is
    /// beside.
    pub(super) fn and_bias_drift(&self, sd: f64) -> Self {
        let mut drifting = self.clone();
        drifting.add_along_axes(|t| sd * t);
        drifting
    }

    /// The same with a model that is off by a share of the force, slowly.
    pub(super) fn and_drift(&self, share: f64) -> Self {
        let mut drifting = self.clone();
        if share > 0.0 {
            let size = share * self.rms();
            for weight in drift_weights(0.0, self.duration()) {
                drifting.add_along_axes(|t| size * weight(t));
            }
        }
        drifting
    }

    /// Something more beside, along x and along y: what one standard deviation of either adds at a time, N.
    fn add_along_axes(&mut self, sd: impl Fn(f64) -> f64) {
        for axis in [Vector2::x(), Vector2::y()] {
            let added = self.whiten(self.means_of(|t| axis * sd(t)).into_iter());
            self.beside.push(added);
        }
    }

    /// Means of a function of the time since the onset under every window, over the readings where their times are known.
    fn means_of(&self, of: impl Fn(f64) -> Vector2<f64>) -> Vec<Vector2<f64>> {
        let mut sums = vec![Vector2::zeros(); self.span()];
        match &self.readings {
            Some(readings) => {
                for group in &readings.groups {
                    for (sum, weight) in sums.iter_mut().skip(group.window).zip(group.weights) {
                        *sum += of(group.time) * weight;
                    }
                }
            }
            None => {
                for (window, sum) in sums.iter_mut().enumerate() {
                    let points = MEAN_POINTS.map(|share| hann_windows::start(window) + share * LENGTH_S);
                    let weighed = points.map(|t| (hann_windows::weight(window, t), of(t)));
                    let total: f64 = weighed.iter().map(|(weight, _)| weight).sum();
                    *sum = weighed.iter().map(|(weight, value)| value * *weight).sum::<Vector2<f64>>() / total;
                }
            }
        }
        sums
    }

    /// The means of the windows, N; none where too few readings are under one.
    #[must_use]
    pub fn forces_finger(&self) -> &[Option<Vector2<f64>>] {
        &self.forces_finger
    }

    /// How many windows have a mean.
    #[must_use]
    pub fn count(&self) -> usize {
        self.data.len() / 2
    }

    /// How many windows there are up to the last, those without a mean included.
    #[must_use]
    pub fn span(&self) -> usize {
        self.forces_finger.len()
    }

    /// Root mean square of the windows' forces, N.
    pub(super) fn rms(&self) -> f64 {
        let forces = || self.forces_finger.iter().flatten();
        (forces().map(Vector2::norm_squared).sum::<f64>() / forces().count() as f64).sqrt()
    }

    /// When the last of them is over, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        hann_windows::end(self.span() - 1)
    }

    /// What the whitened values are of the windows that have a mean, N.
    pub(super) fn in_newtons(&self, whitened: &DVector<f64>) -> Vec<Vector2<f64>> {
        self.whitener.unwhiten(whitened)
    }

    /// Standard deviation of each mean along each axis, N.
    pub(super) fn deviations(&self) -> Vec<Vector2<f64>> {
        self.whitener.deviations()
    }

    /// Predicted means of all windows (N), those that were felt times L⁻¹, in standard deviations.
    pub(super) fn whiten(&self, forces: impl Iterator<Item = Vector2<f64>>) -> DVector<f64> {
        let felt = forces.zip(&self.forces_finger).filter(|(_, felt)| felt.is_some());
        self.whitener.whiten(felt.map(|(force, _)| force))
    }
}

/// Which share of each window's weight has readings.
fn covered(times: &[f64], period: f64, count: usize) -> Vec<f64> {
    let mut sums = vec![0.0; count];
    for &time in times {
        hann_windows::weights_at(time, count).for_each(|(window, weight)| sums[window] += weight);
    }
    sums.into_iter().map(|sum| (sum * period / LENGTH_S).min(1.0)).collect()
}

/// A window that has a mean.
struct Window {
    window: usize,
    force: Vector2<f64>,
    /// Share of its weight that has readings.
    covered: f64,
}

/// What is uncertain about each window's mean.
fn uncertain(felt: &[Window], uncertainty: &Uncertainty, onset_sd: f64) -> Vec<Uncertain> {
    let noise = noise(uncertainty);
    let bias = square_root(&uncertainty.bias);
    // One that surely does not is no column, which would take time.
    let [x, y] = [Vector2::x() * uncertainty.drift_sd.x, Vector2::y() * uncertainty.drift_sd.y];
    let drift = if uncertainty.drift_sd.amax() > 0.0 { vec![x, y] } else { Vec::new() };
    let calibration = uncertainty.calibration.map(|calibration| (calibration, square_root(&calibration.covariance)));
    let window = |(place, at): (usize, &Window)| {
        let of_bias = bias.iter().copied();
        let of_matrix = calibration.iter().flat_map(|(calibration, root)| {
            let by_matrix = calibration.by_matrix(&at.force);
            root.iter().map(move |column| by_matrix * column)
        });
        let of_drift = drift.iter().map(|drift| drift * (uncertainty.drift_before + hann_windows::middle(at.window)));
        let of_onset = std::iter::once(rate(felt, place) * onset_sd);
        let mut common = CommonShares::zeros();
        let of_all = of_bias.chain(of_drift).chain(of_matrix).chain(of_onset);
        for (mut column, of) in common.column_iter_mut().zip(of_all) {
            column.copy_from(&of);
        }
        let covered = |other: &Window| (at.covered * other.covered).sqrt();
        let before = place.checked_sub(1).map(|before| &felt[before]);
        let with_previous = before.filter(|before| before.window + 1 == at.window);
        Uncertain {
            noise: noise / at.covered + Matrix2::identity() * (uncertainty.model_share * at.force.norm()).powi(2),
            with_previous: with_previous
                .map_or_else(Matrix2::zeros, |before| noise * (NEIGHBOUR_CORRELATION / covered(before))),
            common,
        }
    };
    felt.iter().enumerate().map(window).collect()
}

/// The noise of a window's mean that is in full: the inverse of an estimated covariance of two axes is too large on average by this
/// (Wishart).
fn noise(uncertainty: &Uncertainty) -> Matrix2<f64> {
    let values = uncertainty.noise_freedom.max(FREEDOM_MIN);
    if values.is_finite() { uncertainty.noise * (values / (values - 3.0)) } else { uncertainty.noise }
}

/// Which share of all variance is noise, where a window's has so much along both axes.
fn noise_share(uncertain: &[Uncertain], noise: f64) -> f64 {
    let all: f64 = uncertain.iter().map(|window| window.noise.trace() + window.common.norm_squared()).sum();
    (noise * uncertain.len() as f64 / all).clamp(f64::MIN_POSITIVE, 1.0)
}

/// How fast the force changes at a window, N/s.
fn rate(felt: &[Window], place: usize) -> Vector2<f64> {
    let (before, after) = (&felt[place.saturating_sub(1)], &felt[(place + 1).min(felt.len() - 1)]);
    let hops = f64::from(u32::try_from(after.window - before.window).unwrap_or(u32::MAX));
    if hops > 0.0 { (after.force - before.force) / (hops * HOP_S) } else { Vector2::zeros() }
}

impl CalibrationUncertainty {
    /// By what the entries of B move a force: δF = −A δB F.
    fn by_matrix(&self, force: &Vector2<f64>) -> Matrix2x4<f64> {
        let (x, y) = (force.x, force.y);
        -self.inverse * Matrix2x4::new(x, y, 0.0, 0.0, 0.0, 0.0, x, y)
    }
}
