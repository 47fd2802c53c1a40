//! From samples to contact: the pure chain between the converter and whoever wants to know what is touched.
//!
//! Counts become force by the calibration's matrix; the force minus the tare becomes a contact. A sample at the end
//! of the converter's range, or one of many equal ones in a row, is no measurement and is told as such: it is neither
//! contact nor its absence.
//!
//! Frames: finger. Units: device time in s, force in the calibration's unit.

use nalgebra::Vector2;
use palpate_shared::units::Counts;

use crate::finger::calibration::{Calibration, FrontEnd, counts_vector};
use crate::finger::contact::{ContactReading, ContactSense, ContactSettings, Reading, SettingsError, Tare};
use crate::finger::{STUCK_SAMPLES, Samples};

/// How far a bridge's offset wanders after the tare, in microstrain per √s.
///
/// A half bridge of compensated foil gauges drifts by half a microstrain per kelvin, and a finger in a room changes by
/// about 0.15 K in a minute: 0.08 microstrain then, which is 0.05° of a 2 N contact.
pub const BIAS_WALK_MICROSTRAIN: f64 = 0.01;

/// [`BIAS_WALK_MICROSTRAIN`] as force per √s in a calibration's unit, for [`ContactSettings::bias_walk`].
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

/// Why a sample says nothing about the force.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SenseFault {
    /// This channel is at the end of the converter's range: a broken gauge or too large a load.
    Saturated {
        /// 0 for x, 1 for y.
        channel: usize,
    },
    /// The converter repeats itself.
    Stuck,
}

impl std::fmt::Display for SenseFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Saturated { channel: 0 } => f.write_str("bridge x is at the end of its range"),
            Self::Saturated { .. } => f.write_str("bridge y is at the end of its range"),
            Self::Stuck => f.write_str("the converter repeats itself"),
        }
    }
}

/// What a sample was worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Sensed {
    /// A contact, or none.
    Contact(ContactReading),
    /// The sample is no measurement: neither a contact nor its absence follows from it.
    NotMeasured {
        /// Device time, s.
        t: f64,
        /// What kept the sample from being a measurement.
        fault: SenseFault,
    },
}

/// A calibrated, tared finger.
#[derive(Clone, Debug)]
pub struct FingerSense {
    calibration: Calibration,
    sense: ContactSense,
    last: Option<[Counts; 2]>,
    /// Samples that equal the one before, in a row.
    repeats: usize,
}

impl FingerSense {
    /// A finger with this matrix, tare and settings.
    ///
    /// # Errors
    /// [`SettingsError`] if a setting is out of range.
    pub fn new(calibration: Calibration, tare: Tare, settings: &ContactSettings) -> Result<Self, SettingsError> {
        Ok(Self { calibration, sense: ContactSense::new(settings, tare)?, last: None, repeats: 0 })
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
    pub fn feel(&mut self, samples: &Samples) -> Vec<Sensed> {
        samples
            .counts
            .iter()
            .enumerate()
            .filter_map(|(index, &counts)| self.feel_sample(samples.device_time_s(index), counts))
            .collect()
    }

    fn feel_sample(&mut self, t: f64, counts: [Counts; 2]) -> Option<Sensed> {
        if let Some(fault) = self.fault(counts) {
            // Neither the window nor the state of contact outlives what was not measured.
            let tare = *self.sense.tare();
            self.sense.set_tare(tare);
            return Some(Sensed::NotMeasured { t, fault });
        }
        let reading = Reading::new(t, self.calibration.inverse() * counts_vector(counts));
        let calibration = &self.calibration;
        self.sense.push_calibrated(&reading, |force| calibration.systematic(*force)).map(Sensed::Contact)
    }

    fn fault(&mut self, counts: [Counts; 2]) -> Option<SenseFault> {
        self.repeats = if self.last == Some(counts) { self.repeats + 1 } else { 0 };
        self.last = Some(counts);
        match counts.iter().position(|count| count.is_saturated()) {
            Some(channel) => Some(SenseFault::Saturated { channel }),
            None => (self.repeats + 1 >= STUCK_SAMPLES).then_some(SenseFault::Stuck),
        }
    }
}

#[cfg(test)]
mod tests {

    use nalgebra::{Matrix2, SMatrix};
    use palpate_shared::status::Status;

    use super::*;
    use crate::finger::calibration::{CalibrationParts, ForceUnit};

    /// 27,000 counts per newton on both axes.
    fn calibration() -> Calibration {
        let matrix = Matrix2::identity() * 27_000.0;
        let covariance = SMatrix::identity();
        let parts = CalibrationParts { unit: ForceUnit::Newton, matrix, offset: Vector2::zeros(), covariance };
        Calibration::new(parts).unwrap()
    }

    /// Samples from number `first` on whose last digits never repeat, on top of `force` N along −x.
    fn samples(first: u64, count: u64, force: f64) -> Samples {
        let noise = |i: u64, k: u64| i32::try_from((first + i) * k % 211).unwrap() - 105;
        #[expect(clippy::cast_possible_truncation, reason = "a few ten thousand counts")]
        let load = (-27_000.0 * force) as i32;
        let counts = (0..count).map(|i| [Counts(load + noise(i, 37)), Counts(noise(i, 61))]).collect();
        Samples { first, missing_before: 0, time_us: 250 * first, period_us: 250.0, status: Status::default(), counts }
    }

    fn tared() -> FingerSense {
        let calibration = calibration();
        let rest: Vec<_> = readings(&samples(0, 4000, 0.0), &calibration).collect();
        let tare = Tare::estimate(&rest, &ContactSettings::default().tare_settings()).unwrap();
        FingerSense::new(calibration, tare, &ContactSettings::default()).unwrap()
    }

    fn touches(sensed: &[Sensed]) -> usize {
        sensed.iter().filter(|sensed| matches!(sensed, Sensed::Contact(felt) if felt.contact.touch().is_some())).count()
    }

    #[test]
    fn a_press_is_felt() {
        assert!(touches(&tared().feel(&samples(4000, 100, 2.0))) > 90);
    }

    #[test]
    fn a_saturated_bridge_is_a_fault_and_ends_the_contact() {
        let mut finger = tared();
        finger.feel(&samples(4000, 100, 2.0));
        let mut broken = samples(4100, 100, 2.0);
        broken.counts.iter_mut().for_each(|counts| counts[1] = Counts::MAX);
        let sensed = finger.feel(&broken);
        assert_eq!(sensed.len(), 100);
        let fault = SenseFault::Saturated { channel: 1 };
        assert!(sensed.iter().all(|sensed| matches!(sensed, Sensed::NotMeasured { fault: f, .. } if *f == fault)));
        assert_eq!(touches(&finger.feel(&samples(4200, 100, 0.0))), 0, "the old contact is forgotten");
    }

    #[test]
    fn a_converter_that_repeats_itself_is_a_fault_and_no_contact() {
        let mut finger = tared();
        let mut stuck = samples(4000, 100, 2.0);
        stuck.counts.fill([Counts(-54_000), Counts(12)]);
        let sensed = finger.feel(&stuck);
        let faults = sensed
            .iter()
            .filter(|sensed| matches!(sensed, Sensed::NotMeasured { fault: SenseFault::Stuck, .. }))
            .count();
        assert_eq!(faults, 100 - (STUCK_SAMPLES - 1));
    }
}
