//! What to do when a finger is not at rest or not well.

use std::error::Error;

use palpate::finger::contact::TareError;
use palpate::finger::contact::offline::BiasUnknown;
use palpate::finger::diagnosis::Cause;
use palpate::finger::judge::SampleFault;

/// The help for this very error.
pub(super) fn about(error: &(dyn Error + 'static)) -> Option<String> {
    if let Some(BiasUnknown::Refused(error)) = error.downcast_ref() {
        return Some(tare(error).to_owned());
    }
    error.downcast_ref().map(|error| tare(error).to_owned())
}

fn tare(error: &TareError) -> &'static str {
    match error {
        TareError::TooFew { .. } | TareError::TooShort { .. } => {
            "give a longer stretch without contact, or average less"
        }
        TareError::NotFinite { .. } | TareError::NotInOrder { .. } => "repair or skip these readings",
        TareError::NotMeasured { fault, .. } => match fault {
            SampleFault::Saturated { .. } => remedy(Cause::Saturated),
            SampleFault::Stuck { .. } => remedy(Cause::Stuck),
            SampleFault::Settling => "take the stretch again",
        },
        TareError::Loaded { .. } => {
            "free the finger and try again; if it is free, its beam is bent or a gauge torn: calibrate it again, or say --tare-anyway"
        }
        TareError::Stuck { .. } => "check the wiring and the supply of this axis",
        TareError::Drift { .. } => "let the sensor warm up, or take a shorter stretch",
        TareError::Step { .. } | TareError::Outliers { .. } => "take a stretch in which nothing touches the finger",
        TareError::Noisy { .. } => "check shielding and wiring, or raise `noise_max` if this is the sensor's noise",
    }
}

/// What to do about a finding of the diagnosis.
pub(crate) fn remedy(cause: Cause) -> &'static str {
    match cause {
        Cause::TooShort => "run longer",
        Cause::Clock => "check the converter's 8.192 MHz clock",
        Cause::LateArrivals => "the host was busy: close other programs and look again",
        Cause::PickedUp => "look for a loose wire, an unscreened lead, or something touching the finger",
        Cause::Hum => "screen the leads and ground the finger; average over a mains period",
        Cause::Drift => "let it warm up for ten minutes, keep it out of draughts, tare again",
        Cause::Saturated => "a gauge or its wire is broken, or the load is too large for the gain",
        Cause::Stuck => "the converter repeats itself: check its supply, clock and bus",
        Cause::Lost => "try another cable or port; `palpate info` tells whether the device lost them",
    }
}

#[cfg(test)]
mod tests {
    use super::super::help;
    use super::*;

    #[test]
    fn each_stretch_that_is_no_rest_has_its_advice() {
        let cases = [
            (
                TareError::TooFew { samples: 3, needed: 80, window: 10 },
                "give a longer stretch without contact, or average less",
            ),
            (TareError::TooShort { duration: 0.1 }, "give a longer stretch without contact, or average less"),
            (TareError::NotFinite { t: 1.0 }, "repair or skip these readings"),
            (TareError::NotInOrder { t: 1.0 }, "repair or skip these readings"),
            (
                TareError::Drift { change: 1.0, limit: 0.1, t_from: 0.0, t_to: 1.0 },
                "let the sensor warm up, or take a shorter stretch",
            ),
            (TareError::Stuck { axis: 'x', value: 1.0, samples: 9 }, "check the wiring and the supply of this axis"),
            (TareError::Step { change: 1.0, limit: 0.1, t: 0.5 }, "take a stretch in which nothing touches the finger"),
            (
                TareError::Outliers { outliers: 9, samples: 99, allowed: 1, t: 0.5 },
                "take a stretch in which nothing touches the finger",
            ),
            (
                TareError::Noisy { axis: 'x', sd: 1.0, limit: 0.1 },
                "check shielding and wiring, or raise `noise_max` if this is the sensor's noise",
            ),
        ];
        for (error, wanted) in cases {
            assert_eq!(help(&error).as_deref(), Some(wanted), "{error:?}");
            assert_eq!(help(&BiasUnknown::Refused(error)).as_deref(), Some(wanted), "{error:?}");
        }
    }
}
