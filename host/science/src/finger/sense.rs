//! From judged samples to contact: the pure chain between a source of force and whoever wants to know what is touched.
//!
//! The force of a reading minus the tare becomes a contact. A sample that is no measurement is told as such: it is
//! neither contact nor its absence.
//!
//! Frames: finger. Units: device time in s, force in the calibration's unit.

use nalgebra::Matrix2;

use crate::finger::calibration::zero_drift::ZeroDrift;
use crate::finger::calibration::{Calibration, FrontEnd};
use crate::finger::contact::{ContactReading, ContactSense, ContactSettings, SettingsError, Tare};
use crate::finger::judge::{Judged, SampleFault};

/// How far a bridge's offset wanders after the tare, in microstrain per √s.
///
/// A half bridge of compensated foil gauges drifts by half a microstrain per kelvin, and a finger in a room changes by
/// about 0.15 K in a minute: 0.08 microstrain then, which is 0.05° of a 2 N contact.
pub const BIAS_WALK_MICROSTRAIN: f64 = 0.01;

/// The drift that [`BIAS_WALK_MICROSTRAIN`] is of, microstrain per kelvin.
const DRIFT_UNKNOWN: f64 = 0.5;

/// [`BIAS_WALK_MICROSTRAIN`] as force per √s in a calibration's unit, for [`ContactSettings::bias_walk`]. Where the calibration knows
/// how the zero goes with temperature, it wanders by what that leaves.
#[must_use]
pub fn bias_walk(calibration: &Calibration, front_end: &FrontEnd) -> f64 {
    // Both axes alike: the mean of the matrix over directions.
    let force_per_count = calibration.inverse().determinant().abs().sqrt();
    let left = |drift: &ZeroDrift| (drift.left_per_k() * front_end.microstrain_per_count() / DRIFT_UNKNOWN).min(1.0);
    calibration.zero_drift().map_or(1.0, left) * BIAS_WALK_MICROSTRAIN / front_end.microstrain_per_count()
        * force_per_count
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
        fault: SampleFault,
    },
}

/// A tared finger, of ours or another sensor of force.
#[derive(Clone, Debug)]
pub struct FingerSense {
    /// None where the sensor counts as exact.
    calibration: Option<Calibration>,
    sense: ContactSense,
}

impl FingerSense {
    /// A finger with this tare and these settings; with a calibration, its uncertainty is part of every contact's.
    ///
    /// # Errors
    /// [`SettingsError`] if a setting is out of range.
    pub fn new(
        calibration: Option<Calibration>,
        tare: Tare,
        settings: &ContactSettings,
    ) -> Result<Self, SettingsError> {
        Ok(Self { calibration, sense: ContactSense::new(settings, tare)? })
    }

    /// The calibration in use, if the finger has one.
    #[must_use]
    pub fn calibration(&self) -> Option<&Calibration> {
        self.calibration.as_ref()
    }

    /// The tare in use.
    #[must_use]
    pub fn tare(&self) -> &Tare {
        self.sense.tare()
    }

    /// What is felt at each item of a stream that says anything of a contact; nothing while an averaging window fills.
    pub fn feel(&mut self, judged: impl IntoIterator<Item = Judged>) -> Vec<Sensed> {
        judged.into_iter().filter_map(|item| self.feel_item(&item)).collect()
    }

    fn feel_item(&mut self, judged: &Judged) -> Option<Sensed> {
        match judged {
            Judged::Measured(reading) => {
                let calibration = self.calibration.as_ref();
                let systematic = |force: &_| calibration.map_or_else(Matrix2::zeros, |known| known.systematic(*force));
                self.sense.push_calibrated(reading, systematic).map(Sensed::Contact)
            }
            Judged::NotMeasured { t, fault } => {
                self.forget();
                Some(Sensed::NotMeasured { t: *t, fault: *fault })
            }
            Judged::Restarted => {
                self.forget();
                None
            }
            // The readings' times tell of a gap.
            Judged::Missing(_) => None,
        }
    }

    /// Neither the window nor the state of contact outlives what was not measured.
    fn forget(&mut self) {
        let tare = *self.sense.tare();
        self.sense.set_tare(tare);
    }
}

#[cfg(test)]
mod tests {

    use palpate_shared::status::Status;
    use palpate_shared::units::Counts;

    use super::*;
    use crate::finger::judge::CountsJudge;
    use crate::finger::judge::tests::calibration;
    use crate::finger::{STUCK_SAMPLES, Samples};

    /// Samples from number `first` on whose last digits never repeat, on top of `force` N along −x.
    fn samples(first: u64, count: u64, force: f64) -> Samples {
        let noise = |i: u64, k: u64| i32::try_from((first + i) * k % 211).unwrap() - 105;
        #[expect(clippy::cast_possible_truncation, reason = "a few ten thousand counts")]
        let load = (-27_000.0 * force) as i32;
        let counts = (0..count).map(|i| [Counts(load + noise(i, 37)), Counts(noise(i, 61))]).collect();
        Samples { first, missing_before: 0, time_us: 250 * first, period_us: 250.0, status: Status::default(), counts }
    }

    /// A tared finger behind its judge.
    struct Finger(CountsJudge, FingerSense);

    impl Finger {
        fn feel(&mut self, samples: &Samples) -> Vec<Sensed> {
            self.1.feel(self.0.judge(samples))
        }
    }

    fn tared() -> Finger {
        let calibration = calibration();
        let mut judge = CountsJudge::new(&calibration);
        let rest: Vec<_> = judge.judge(&samples(0, 4000, 0.0)).filter_map(|judged| judged.reading()).collect();
        let tare = Tare::estimate(&rest, &ContactSettings::default().tare_settings()).unwrap();
        Finger(judge, FingerSense::new(Some(calibration), tare, &ContactSettings::default()).unwrap())
    }

    fn touches(sensed: &[Sensed]) -> usize {
        sensed.iter().filter(|sensed| matches!(sensed, Sensed::Contact(felt) if felt.contact.touch().is_some())).count()
    }

    #[test]
    fn a_zero_that_is_known_to_drift_wanders_less() {
        use crate::finger::calibration::FrontEndSettings;
        use nalgebra::Vector2;
        let settings = FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 };
        let front_end = FrontEnd::new(settings).unwrap();
        let per_count = front_end.microstrain_per_count();
        let walk = |drift| bias_walk(&calibration().with_zero_drift(drift), &front_end);
        let of = |microstrain: f64, sd: f64| {
            let both = |value: f64| Vector2::new(value, -value) / per_count;
            Some(ZeroDrift { counts_per_k: both(microstrain), sd: both(sd).abs() })
        };
        // 0.03 and a tenth of 0.4 microstrain/K are 0.05 of the 0.5 that are taken for an unknown one; a bad fit is no better than none.
        assert!((walk(of(0.4, 0.03)) / walk(None) - 0.1).abs() < 1e-9);
        assert!((walk(of(0.4, 3.0)) / walk(None) - 1.0).abs() < 1e-12);
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
        let fault = SampleFault::Saturated { channel: 1 };
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
            .filter(|sensed| matches!(sensed, Sensed::NotMeasured { fault: SampleFault::Stuck { .. }, .. }))
            .count();
        assert_eq!(faults, 100 - (STUCK_SAMPLES - 1));
    }
}
