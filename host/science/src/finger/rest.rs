//! A stretch of samples at rest, for a tare.
//!
//! Sample time alone says when it is over. Samples of a filter that settles come before it; a device that starts anew
//! begins it again; any other sample that is no measurement ends it with an error, since a tare that a fault has
//! touched would be wrong for as long as it is used.
//!
//! A finger that is pressed evenly is at rest too, and its tare would take the force for nothing: what the bridges read
//! without load is known from the calibration, and [`check_offset`] compares.
//!
//! Units: s, microstrain, the calibration's unit of force. Errors: [`TareError::NotMeasured`], [`TareError::Loaded`].

use nalgebra::Vector2;

use super::calibration::{Calibration, FrontEnd};
use super::contact::{Reading, TareError};
use super::judge::{Judged, SampleFault};

/// A bridge without load may read so far from what it did when it was calibrated, microstrain: disk and beam that hang
/// the other way round make up to 28 (0.3 N), thirty kelvins 15. A newton on the disk makes 48.
pub const OFFSET_SHIFT_MAX_MICROSTRAIN: f64 = 45.0;

/// Whether a tare can be of a finger without load.
///
/// # Errors
/// [`TareError::Loaded`] if it is further from the calibration's offset than [`OFFSET_SHIFT_MAX_MICROSTRAIN`].
pub fn check_offset(bias: &Vector2<f64>, calibration: &Calibration, front_end: &FrontEnd) -> Result<(), TareError> {
    let parts = calibration.parts();
    let shift = (parts.matrix * bias - parts.offset).amax() * front_end.microstrain_per_count();
    let limit = OFFSET_SHIFT_MAX_MICROSTRAIN;
    if shift <= limit { Ok(()) } else { Err(TareError::Loaded { shift, limit }) }
}

/// Readings at rest, until they are enough.
#[derive(Clone, Debug)]
pub struct RestStretch {
    seconds: f64,
    readings: Vec<Reading>,
}

impl RestStretch {
    /// A stretch that shall last so long, s.
    #[must_use]
    pub fn new(seconds: f64) -> Self {
        Self { seconds, readings: Vec::new() }
    }

    /// Takes what came next; whether the stretch was over before it, so that it is none of it.
    ///
    /// # Errors
    /// [`TareError::NotMeasured`].
    pub fn take(&mut self, item: &Judged) -> Result<bool, TareError> {
        match *item {
            Judged::Measured(reading) => {
                let since = self.readings.first().map_or(reading.t, |first| first.t);
                let is_over = reading.t >= since + self.seconds;
                if !is_over {
                    self.readings.push(reading);
                }
                Ok(is_over)
            }
            Judged::NotMeasured { fault: SampleFault::Settling, .. } | Judged::Restarted => {
                self.readings.clear();
                Ok(false)
            }
            Judged::NotMeasured { fault, t } => Err(TareError::NotMeasured { t, fault }),
            // Gaps are noise's affair: its windows are weighted by what they hold.
            Judged::Missing(_) => Ok(false),
        }
    }

    /// The readings, in order of time.
    #[must_use]
    pub fn readings(&self) -> &[Reading] {
        &self.readings
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finger::calibration::FrontEndSettings;
    use crate::finger::judge::tests::calibration;

    fn reading(i: u32) -> Judged {
        Judged::Measured(Reading::new(f64::from(i) * 0.01, Vector2::new(f64::from(i), 0.0)))
    }

    #[test]
    fn a_stretch_lasts_as_long_as_its_samples_say() {
        let mut rest = RestStretch::new(0.5);
        let over = (0..100).find(|&i| rest.take(&reading(i)).unwrap());
        assert_eq!((over, rest.readings().len()), (Some(50), 50));
    }

    #[test]
    fn a_device_that_starts_anew_or_settles_begins_it_again() {
        for item in [Judged::Restarted, Judged::NotMeasured { t: 0.2, fault: SampleFault::Settling }] {
            let mut rest = RestStretch::new(0.5);
            (0..20).for_each(|i| assert!(!rest.take(&reading(i)).unwrap()));
            assert!(!rest.take(&item).unwrap());
            assert!(rest.readings().is_empty(), "{item:?}");
        }
    }

    #[test]
    fn a_press_is_no_rest_and_a_warm_finger_is() {
        let calibration = calibration();
        let settings = FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 };
        let front_end = FrontEnd::new(settings).unwrap();
        let free = calibration.inverse() * calibration.parts().offset;
        let pressed = |newtons: f64, angle: f64| {
            let (sin, cos) = angle.sin_cos();
            check_offset(&(free + Vector2::new(cos, sin) * newtons), &calibration, &front_end)
        };
        for angle in [0.0, 0.7, 1.6, 3.0, 4.4] {
            assert_eq!(pressed(0.3, angle), Ok(()));
            assert!(matches!(pressed(2.0, angle), Err(TareError::Loaded { .. })), "{angle}");
        }
    }

    #[test]
    fn a_fault_spoils_it() {
        let fault = SampleFault::Saturated { channel: 1 };
        let error = RestStretch::new(0.5).take(&Judged::NotMeasured { t: 0.3, fault }).unwrap_err();
        assert_eq!(error, TareError::NotMeasured { t: 0.3, fault });
        assert_eq!(error.to_string(), "at t = 0.3 s bridge y is at the end of its range");
    }
}
