//! A stretch of samples at rest, for a tare.
//!
//! Sample time alone says when it is over. Samples of a filter that settles come before it; a device that starts anew
//! begins it again; any other sample that is no measurement ends it with an error, since a tare that a fault has
//! touched would be wrong for as long as it is used.
//!
//! Units: s, the calibration's unit of force. Errors: [`TareError::NotMeasured`].

use super::contact::{Reading, TareError};
use super::judge::{Judged, SampleFault};

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
    use nalgebra::Vector2;

    use super::*;

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
    fn a_fault_spoils_it() {
        let fault = SampleFault::Saturated { channel: 1 };
        let error = RestStretch::new(0.5).take(&Judged::NotMeasured { t: 0.3, fault }).unwrap_err();
        assert_eq!(error, TareError::NotMeasured { t: 0.3, fault });
        assert_eq!(error.to_string(), "at t = 0.3 s bridge y is at the end of its range");
    }
}
