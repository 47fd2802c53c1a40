//! The thesis's experiment with the sensor (§6.4): static contacts round the disk, felt and compared with the truth.
//!
//! The truth is the simulated world's: the angle at which it was told to press. Each contact is held while the beam
//! stops ringing, then read for a thousand samples; every reading is turned into an angle by the chain that the live
//! commands use, once by itself and once for each averaging asked for.
//!
//! The thesis reports 1000 readings of static contacts: mean within 1°, standard deviation below 0.5°.

use std::f64::consts::TAU;

use palpate::finger::Samples;
use palpate::finger::calibration::Calibration;
use palpate::finger::contact::{Averaging, ContactEstimate, ContactSettings, SettingsError};
use palpate::finger::judge::{CountsJudge, Judged};
use palpate::finger::sense::{self, FingerSense, Sensed};
use palpate::math::angle::wrap_angle;
use palpate::math::statistics::mean;
use palpate_device::simulated::SimulatedDevice;
use palpate_device::{Incoming, Session};
use palpate_shared::sim::{ContactLoad, Load};

use crate::live::{self, LiveError};

/// Time from a new load to the first reading used, in s: the default beam's ringing falls by 1/e in 43 ms, so to
/// a thousandth of the load's step.
const SETTLE_S: f64 = 0.3;

/// Time without contact from which the tare is taken, in s: fifty mains periods.
const TARE_S: f64 = 1.0;

/// Probability with which the interval stated for a contact shall hold it.
pub const COVERAGE: f64 = 0.99;

/// Contacts that are felt one after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Contacts {
    /// Contact angles, rad.
    pub angles: Vec<f64>,
    /// Force along the contact's normal, N.
    pub normal_force: f64,
    /// Angles between force and normal, rad; contacts take them in turn. `[0.0]` is a contact without friction.
    pub friction_angles: Vec<f64>,
    /// Friction coefficient that the host is told.
    pub mu_c: f64,
    /// Readings of each contact.
    pub readings: usize,
}

impl Contacts {
    /// `count` contacts without friction, evenly round the disk, beginning half a step from 0.
    #[must_use]
    pub fn round_the_disk(count: u32, normal_force: f64) -> Self {
        let angles = (0..count).map(|i| wrap_angle((f64::from(i) + 0.5) * TAU / f64::from(count))).collect();
        Self { angles, normal_force, friction_angles: vec![0.0], mu_c: 0.0, readings: 1000 }
    }

    /// The same contacts with a part that sticks, or slides one way or the other, in turn.
    #[must_use]
    pub fn with_friction(self, mu_c: f64) -> Self {
        let limit = mu_c.atan();
        Self { friction_angles: vec![limit, 0.0, -limit, limit / 2.0, -limit / 2.0], mu_c, ..self }
    }
}

/// What was felt of one contact with one averaging.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactAccuracy {
    /// True contact angle, rad.
    pub angle: f64,
    /// Mean of the felt angles, minus the true one, rad.
    pub error: f64,
    /// Standard deviation of single felt angles, rad.
    pub sd: f64,
    /// Mean of the standard deviations that the sense stated, rad.
    pub stated_sd: f64,
    /// Share of readings whose stated interval ([`COVERAGE`], friction included) held the true angle.
    pub covered: f64,
    /// Mean of the felt force, in the calibration's unit.
    pub magnitude: f64,
    /// Readings that were felt.
    pub readings: usize,
}

/// Why the experiment could not be made.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The samples could not be had.
    #[error(transparent)]
    Live(#[from] LiveError),
    /// A setting is out of range.
    #[error(transparent)]
    Settings(#[from] SettingsError),
    /// The simulated hand is gone.
    #[error("the simulated device has ended")]
    Ended(#[from] std::io::Error),
    /// A contact was not felt.
    #[error("{readings} readings of the contact at {angle_deg:.1}° with {normal_force} N were felt, of {wanted}")]
    NotFelt {
        /// True contact angle, degrees.
        angle_deg: f64,
        /// How hard the contact pushes, N.
        normal_force: f64,
        /// Readings that were contacts.
        readings: usize,
        /// Readings that were taken.
        wanted: usize,
    },
}

/// Presses at each contact in turn and feels it, with each averaging.
///
/// Begins with a tare, the finger free. Gives one list for each averaging.
///
/// # Errors
/// [`ExperimentError`].
pub fn feel(
    session: &mut Session,
    hand: &SimulatedDevice,
    calibration: &Calibration,
    contacts: &Contacts,
    averagings: &[Averaging],
) -> Result<Vec<Vec<ContactAccuracy>>, ExperimentError> {
    let mut fingers = tared(session, hand, calibration, contacts, averagings)?;
    let mut samples = CountsJudge::new(calibration);
    let mut measured = vec![Vec::new(); averagings.len()];
    for (i, &angle) in contacts.angles.iter().enumerate() {
        let friction_angle = contacts.friction_angles[i % contacts.friction_angles.len().max(1)];
        let blocks = press(session, hand, angle, friction_angle, contacts)?;
        let judged: Vec<_> = blocks.iter().flat_map(|block| samples.judge(block).collect::<Vec<_>>()).collect();
        for (finger, measured) in fingers.iter_mut().zip(&mut measured) {
            measured.push(compare(finger, &judged, angle, contacts)?);
        }
    }
    hand.set_load(Load::Released)?;
    Ok(measured)
}

/// One tared finger for each averaging, all from the same second without contact.
fn tared(
    session: &mut Session,
    hand: &SimulatedDevice,
    calibration: &Calibration,
    contacts: &Contacts,
    averagings: &[Averaging],
) -> Result<Vec<FingerSense>, ExperimentError> {
    let rest = after_load(session, hand, Load::Released, TARE_S)?;
    let mut samples = CountsJudge::new(calibration);
    let readings: Vec<_> =
        rest.iter().flat_map(|block| samples.judge(block).collect::<Vec<_>>()).filter_map(Judged::reading).collect();
    let front_end = live::front_end(session.hello()).map_err(LiveError::from)?;
    let bias_walk = sense::bias_walk(calibration, &front_end);
    averagings
        .iter()
        .map(|&averaging| {
            let settings =
                ContactSettings { averaging, contact_friction: contacts.mu_c, bias_walk, ..ContactSettings::default() };
            let tare = palpate::finger::contact::Tare::estimate(&readings, &settings.tare_settings())
                .map_err(|source| LiveError::Tare { source })?;
            Ok(FingerSense::new(Some(calibration.clone()), tare, &settings)?)
        })
        .collect()
}

/// Presses, waits until the beam is still, and takes the readings.
fn press(
    session: &mut Session,
    hand: &SimulatedDevice,
    angle: f64,
    friction_angle: f64,
    contacts: &Contacts,
) -> Result<Vec<Samples>, ExperimentError> {
    #[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
    let load = Load::Static(ContactLoad {
        angle: angle as f32,
        normal_force: contacts.normal_force as f32,
        friction_angle: friction_angle as f32,
    });
    let seconds = contacts.readings as f64 / f64::from(session.hello().rate_hz);
    after_load(session, hand, load, seconds)
}

/// Sets a load and takes samples from when it has settled.
fn after_load(
    session: &mut Session,
    hand: &SimulatedDevice,
    load: Load,
    seconds: f64,
) -> Result<Vec<Samples>, ExperimentError> {
    let from_s = hand.set_load(load)?.truth.time_ns as f64 * 1e-9 + SETTLE_S;
    // What was sampled before is of no use, and a simulated device at its host's pace may have run seconds ahead.
    session.stop().map_err(LiveError::from)?;
    session.forget_waiting();
    session.start().map_err(LiveError::from)?;
    let mut blocks: Vec<Samples> = Vec::new();
    live::stream(session, |_, incoming| {
        let Incoming::Samples(samples) = incoming else { return true };
        if samples.device_time_s(0) >= from_s {
            blocks.push(samples.clone());
        }
        let begun_s = blocks.first().map_or(f64::INFINITY, |first| first.device_time_s(0));
        samples.device_time_s(samples.counts.len()) < begun_s + seconds
    })?;
    Ok(blocks)
}

/// Compares what is felt with the truth.
fn compare(
    finger: &mut FingerSense,
    judged: &[Judged],
    angle: f64,
    contacts: &Contacts,
) -> Result<ContactAccuracy, ExperimentError> {
    let measured: Vec<_> = finger
        .feel(judged.iter().copied())
        .into_iter()
        .filter_map(|sensed| match sensed {
            Sensed::Contact(measured) => Some(measured),
            Sensed::NotMeasured { .. } => None,
        })
        .collect();
    let touches: Vec<_> = measured.iter().filter_map(|measured| measured.contact.touch()).collect();
    // The averaging window, and the detector's confirmation, are still full of the contact before.
    let fresh = finger.tare().averaging_samples + DETECTOR_LAG;
    let touches = touches.get(fresh..).unwrap_or_default();
    if touches.len() + 2 * fresh < measured.len() || touches.is_empty() {
        return Err(ExperimentError::NotFelt {
            angle_deg: angle.to_degrees(),
            normal_force: contacts.normal_force,
            readings: touches.len(),
            wanted: measured.len(),
        });
    }
    let count = touches.len() as f64;
    let errors: Vec<f64> = touches.iter().map(|touch| wrap_angle(touch.u - angle)).collect();
    let mean_of =
        |value: fn(&ContactEstimate) -> f64| mean(touches.iter().map(|touch| value(touch))).unwrap_or(f64::NAN);
    let error = mean(&errors).unwrap_or(f64::NAN);
    let variance = errors.iter().map(|value| (value - error).powi(2)).sum::<f64>() / (count - 1.0).max(1.0);
    Ok(ContactAccuracy {
        angle,
        error,
        sd: variance.sqrt(),
        stated_sd: mean_of(|touch| touch.u_sd),
        covered: touches.iter().filter(|touch| touch.interval(COVERAGE).contains(angle)).count() as f64 / count,
        magnitude: mean_of(|touch| touch.magnitude),
        readings: touches.len(),
    })
}

/// Readings at the start of a contact that are left out because contact may not be confirmed yet.
const DETECTOR_LAG: usize = 8;

/// The worst of a list of contacts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Worst {
    /// Largest size of the mean error of a contact, rad.
    pub error: f64,
    /// Largest standard deviation of a contact's readings, rad.
    pub sd: f64,
    /// Smallest share of covered readings of a contact.
    pub covered: f64,
}

/// The worst error, deviation and coverage among contacts.
#[must_use]
pub fn worst(measured: &[ContactAccuracy]) -> Worst {
    let largest = |pick: fn(&ContactAccuracy) -> f64| measured.iter().map(pick).fold(0.0, f64::max);
    Worst {
        error: largest(|measured| measured.error.abs()),
        sd: largest(|measured| measured.sd),
        covered: measured.iter().map(|measured| measured.covered).fold(1.0, f64::min),
    }
}
