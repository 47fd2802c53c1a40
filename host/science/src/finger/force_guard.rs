//! When a finger that is moved must be stopped: at the first reading above a limit, and when there are none.
//!
//! Goes by single readings, without an average: what is late is too late. A sample that is no measurement stops too, for
//! then nobody knows the force; so does one that never came.
//!
//! Units: N (or the calibration's unit), s. Errors: none; a stop is an answer.

use std::fmt;

use nalgebra::Vector2;

use super::judge::{Judged, SampleFault};

/// Why the finger was stopped.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ForceStop {
    /// A force above the limit.
    Above {
        /// Device time, s.
        t: f64,
        /// The force.
        force: f64,
        /// The limit.
        limit: f64,
    },
    /// A sample that says nothing about the force.
    NotMeasured(SampleFault),
    /// Samples that never came, or a device that started anew: the link is not what it was.
    Lost,
}

impl fmt::Display for ForceStop {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Above { t, force, limit } => {
                write!(f, "the force was {force:.2} N at t = {t:.3} s, above the limit of {limit:.2} N")
            }
            Self::NotMeasured(fault) => write!(f, "the force is not known: {fault}"),
            Self::Lost => f.write_str("the force is not known: samples were lost"),
        }
    }
}

/// A limit for a tared finger. Once it stopped it stays so.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ForceGuard {
    limit: f64,
    bias: Vector2<f64>,
    stopped: Option<ForceStop>,
}

impl ForceGuard {
    /// A limit (N) on the force beyond what the free finger reads.
    #[must_use]
    pub fn new(limit: f64, bias: Vector2<f64>) -> Self {
        Self { limit, bias, stopped: None }
    }

    /// Takes what came next; why to stop, if so.
    pub fn take(&mut self, judged: &Judged) -> Option<ForceStop> {
        self.stopped = self.stopped.or_else(|| match judged {
            Judged::Measured(reading) => {
                let force = (reading.force_finger - self.bias).norm();
                // What is no number is above every limit.
                let is_within = force <= self.limit;
                (!is_within).then_some(ForceStop::Above { t: reading.t, force, limit: self.limit })
            }
            Judged::NotMeasured { fault, .. } => Some(ForceStop::NotMeasured(*fault)),
            Judged::Missing(_) | Judged::Restarted => Some(ForceStop::Lost),
        });
        self.stopped
    }
}

#[cfg(test)]
mod tests {
    use super::super::contact::Reading;
    use super::*;

    fn reading(t: f64, x: f64) -> Judged {
        Judged::Measured(Reading::new(t, Vector2::new(x, 1.0)))
    }

    #[test]
    fn the_first_reading_above_the_limit_stops_and_nothing_takes_that_back() {
        let mut guard = ForceGuard::new(2.0, Vector2::new(0.5, 1.0));
        assert_eq!([2.4, -1.4].map(|x| guard.take(&reading(0.0, x))), [None; 2]);
        let stop = guard.take(&reading(0.1, 2.6));
        assert!(
            matches!(stop, Some(ForceStop::Above { t, force, .. }) if (t - 0.1).abs() < 1e-12 && (force - 2.1).abs() < 1e-12)
        );
        assert_eq!(guard.take(&reading(0.2, 0.5)), stop);
    }

    #[test]
    fn what_is_not_known_stops() {
        let not = |judged: Judged| ForceGuard::new(2.0, Vector2::zeros()).take(&judged).is_some();
        assert!(not(Judged::Missing(Some(1))) && not(Judged::Missing(None)) && not(Judged::Restarted));
        assert!(not(Judged::NotMeasured { t: 0.0, fault: SampleFault::Saturated { channel: 0 } }));
        assert!(not(reading(0.0, f64::NAN)));
    }
}
