//! From samples to contact: the pure chain between the link and whoever wants to know what is touched.
//!
//! Counts become force by the calibration's matrix; the force minus the tare becomes a contact. A sample at the end
//! of the converter's range is no measurement: it becomes a reading that is not a number, which empties the
//! averaging window, so that nothing is ever averaged with it.
//!
//! Frames: finger. Units: device time in s, force in the calibration's unit.

use nalgebra::Vector2;
use palpate_shared::units::Counts;

use crate::calibration::{Calibration, FrontEnd, counts_vector};
use crate::contact::{ContactSense, Felt, Reading, Settings, SettingsError, Tare};
use crate::link::Samples;

/// How far a bridge's offset wanders after the tare, in microstrain per √s.
///
/// A half bridge of compensated foil gauges drifts by half a microstrain per kelvin, and a finger in a room changes by
/// about 0.15 K in a minute: 0.08 microstrain then, which is 0.05° of a 2 N contact.
pub const BIAS_WALK_MICROSTRAIN: f64 = 0.01;

/// [`BIAS_WALK_MICROSTRAIN`] as force per √s in a calibration's unit, for [`Settings::bias_walk`].
#[must_use]
pub fn bias_walk(calibration: &Calibration, front_end: &FrontEnd) -> f64 {
    // Both axes alike: the mean of the matrix over directions.
    let force_per_count = calibration.inverse().determinant().abs().sqrt();
    BIAS_WALK_MICROSTRAIN / front_end.microstrain_per_count() * force_per_count
}

/// Force readings of a block, tare included, oldest first.
pub fn readings<'a>(samples: &'a Samples, calibration: &'a Calibration) -> impl Iterator<Item = Reading> + 'a {
    samples.counts.iter().enumerate().map(move |(index, counts)| {
        let force_finger = if counts.iter().any(|count: &Counts| count.is_saturated()) {
            Vector2::repeat(f64::NAN)
        } else {
            calibration.inverse() * counts_vector(*counts)
        };
        Reading::new(samples.device_time_s(index), force_finger)
    })
}

/// A calibrated, tared finger.
#[derive(Clone, Debug)]
pub struct FingerSense {
    calibration: Calibration,
    sense: ContactSense,
}

impl FingerSense {
    /// A finger with this matrix, tare and settings.
    ///
    /// # Errors
    /// [`SettingsError`] if a setting is out of range.
    pub fn new(calibration: Calibration, tare: Tare, settings: &Settings) -> Result<Self, SettingsError> {
        Ok(Self { calibration, sense: ContactSense::new(settings, tare)? })
    }

    /// The calibration in use.
    #[must_use]
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// The tare in use.
    #[must_use]
    pub fn tare(&self) -> &Tare {
        self.sense.tare()
    }

    /// What is felt at each sample of a block; nothing while an averaging window fills.
    pub fn feel<'a>(&'a mut self, samples: &'a Samples) -> impl Iterator<Item = Felt> + 'a {
        let Self { calibration, sense } = self;
        let calibration = &*calibration;
        readings(samples, calibration)
            .filter_map(move |reading| sense.push_calibrated(&reading, |force| calibration.systematic(*force)))
    }
}
