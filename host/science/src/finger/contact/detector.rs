//! Contact on and off, from the force's own noise, with hysteresis.
//!
//! The force's size is measured in standard deviations of its own noise (Mahalanobis norm; see
//! [`super::noise::mahalanobis`]), so the thresholds mean the same for every sensor.
//!
//! Contact begins when the norm stays at or above `on_sigmas` for `on_readings` readings, and is dated back to the
//! first of the unbroken readings above `off_sigmas` that led there. It ends when the norm stays below `off_sigmas`
//! for `off_readings` readings, dated back to the first of them. Between the thresholds nothing ever changes.

use serde::{Deserialize, Serialize};

/// Norm at which contact begins, standard deviations.
///
/// At rest, one reading in e^(7²/2) = 4·10¹⁰ is above: at 4 kHz once in 3000 hours, if the noise is Gaussian and its
/// covariance well known ([`false_alarms_per_hour`] says how much more often if not). At 6 it would be five times an
/// hour per 100 kHz; at 8 a touch must be 14 % stronger to be felt, for nothing.
const ON_SIGMAS: f64 = 7.0;
/// Norm below which contact ends, standard deviations: at rest a reading is below 99.97 % of the time.
const OFF_SIGMAS: f64 = 4.0;
/// Readings in a row to begin or end: one wild reading (a spike, a bit error that went unseen) is not a touch.
const READINGS: usize = 3;
/// Seconds in an hour.
const HOUR_S: f64 = 3600.0;

/// When contact begins and ends.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Thresholds {
    /// Contact begins at or above this norm, standard deviations.
    pub on_sigmas: f64,
    /// Contact ends below this norm, standard deviations; at most `on_sigmas`.
    pub off_sigmas: f64,
    /// Readings in a row needed to begin; 0 counts as 1.
    pub on_readings: usize,
    /// Readings in a row needed to end; 0 counts as 1.
    pub off_readings: usize,
    /// Contact never begins below this force, force units, and a force below it ends contact, however quiet the
    /// sensor: for drift or shaking that the tare could not know of.
    pub force_min: f64,
}

impl Default for Thresholds {
    fn default() -> Self {
        Self {
            on_sigmas: ON_SIGMAS,
            off_sigmas: OFF_SIGMAS,
            on_readings: READINGS,
            off_readings: READINGS,
            force_min: 0.0,
        }
    }
}

/// A change of the contact state.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "event", rename_all = "snake_case")]
pub enum Event {
    /// A contact began.
    Onset {
        /// When the force left its noise, s.
        t: f64,
        /// When that was certain, s.
        t_detected: f64,
    },
    /// The contact ended.
    Release {
        /// When the force came back into its noise, s.
        t: f64,
        /// When that was certain, s.
        t_detected: f64,
    },
}

/// A run of consecutive readings that satisfy a condition.
#[derive(Clone, Copy, Debug, Default)]
struct Run {
    length: usize,
    t_first: f64,
}

impl Run {
    fn update(&mut self, holds: bool, t: f64) {
        match (holds, self.length) {
            (false, _) => self.length = 0,
            (true, 0) => *self = Self { length: 1, t_first: t },
            (true, _) => self.length += 1,
        }
    }
}

/// The on/off state of one finger.
#[derive(Clone, Debug)]
pub struct Detector {
    thresholds: Thresholds,
    high: Run,
    not_low: Run,
    low: Run,
    onset: Option<f64>,
}

impl Detector {
    /// A detector that starts without contact.
    #[must_use]
    pub fn new(thresholds: Thresholds) -> Self {
        Self { thresholds, high: Run::default(), not_low: Run::default(), low: Run::default(), onset: None }
    }

    /// Time at which the present contact began, s; `None` without contact.
    #[must_use]
    pub fn onset(&self) -> Option<f64> {
        self.onset
    }

    /// Takes the norm (standard deviations) and the size (force units) of one tared force, and says whether the state
    /// changed. A norm that is not a number counts as neither high nor low.
    pub fn push(&mut self, t: f64, sigmas: f64, force: f64) -> Option<Event> {
        let Thresholds { on_sigmas, off_sigmas, force_min, .. } = self.thresholds;
        let low = sigmas < off_sigmas || force < force_min;
        self.high.update(sigmas >= on_sigmas && force >= force_min, t);
        self.not_low.update(!low && !sigmas.is_nan(), t);
        self.low.update(low, t);
        match self.onset {
            None if self.high.length >= self.thresholds.on_readings.max(1) => {
                let onset = self.not_low.t_first;
                self.onset = Some(onset);
                Some(Event::Onset { t: onset, t_detected: t })
            }
            Some(_) if self.low.length >= self.thresholds.off_readings.max(1) => {
                self.onset = None;
                Some(Event::Release { t: self.low.t_first, t_detected: t })
            }
            _ => None,
        }
    }
}

/// How many false onsets an hour Gaussian noise causes at most, at `rate_hz` readings a second.
///
/// `freedom` is that of the noise covariance ([`super::Tare::freedom`]): for a two-dimensional normal with a
/// covariance estimated with ν degrees of freedom, `P(norm > s) = (1 + s²/ν)^(−(ν−1)/2)` (Hotelling's T²), which
/// tends to `exp(−s²/2)`. An upper bound, since readings in a row are needed and averaged readings overlap.
#[must_use]
pub fn false_alarms_per_hour(on_sigmas: f64, rate_hz: f64, freedom: f64) -> f64 {
    let log = if freedom.is_infinite() {
        -0.5 * on_sigmas.powi(2)
    } else {
        -0.5 * (freedom - 1.0).max(0.0) * (on_sigmas.powi(2) / freedom).ln_1p()
    };
    rate_hz * HOUR_S * log.exp()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::test_noise::Random;
    use super::*;

    /// Runs the norms at 1 reading a second, with a force as large as the norm.
    fn run(detector: &mut Detector, norms: &[f64]) -> Vec<Event> {
        norms.iter().enumerate().filter_map(|(t, &norm)| detector.push(t as f64, norm, norm)).collect()
    }

    #[test]
    fn onset_is_dated_back_to_where_the_force_left_its_noise() {
        let mut detector = Detector::new(Thresholds::default());
        let events = run(&mut detector, &[1.0, 5.0, 2.0, 4.5, 6.0, 8.0, 9.0, 12.0, 20.0]);
        assert_eq!(events, [Event::Onset { t: 3.0, t_detected: 7.0 }]);
    }

    #[test]
    fn release_is_dated_back_to_the_first_low_reading() {
        let mut detector = Detector::new(Thresholds::default());
        let events = run(&mut detector, &[9.0, 9.0, 9.0, 1.0, 9.0, 3.0, 2.0, 1.0, 1.0]);
        assert_eq!(events[1..], [Event::Release { t: 5.0, t_detected: 7.0 }]);
        assert_eq!(detector.onset(), None);
    }

    #[test]
    fn a_single_wild_reading_is_not_a_touch() {
        let mut detector = Detector::new(Thresholds::default());
        assert!(run(&mut detector, &[1.0, 1e9, 1.0, 1e9, 1e9, 1.0, f64::NAN, 1e9, 1e9]).is_empty());
    }

    #[test]
    fn a_force_below_the_least_is_not_a_touch_however_quiet_the_sensor() {
        let mut detector = Detector::new(Thresholds { force_min: 0.1, ..Thresholds::default() });
        assert!((0..100).all(|t| detector.push(f64::from(t), 50.0, 0.09).is_none()));
        assert!((100..110).any(|t| detector.push(f64::from(t), 50.0, 0.11).is_some()));
    }

    #[test]
    fn the_formula_for_false_alarms_gives_the_rate_seen() {
        // On at 3 sigmas in single readings, so that there is something to count: exp(−4.5) = 1.1 %.
        let mut random = Random(11);
        let n = 200_000;
        let seen = (0..n).filter(|_| random.normal2().norm() >= 3.0).count() as f64 / f64::from(n);
        let said = false_alarms_per_hour(3.0, 1.0 / 3600.0, f64::INFINITY);
        // 2222 expected, standard deviation 47: four of those are 8 %.
        assert!((seen / said - 1.0).abs() < 0.08, "seen {seen}, said {said}");
        assert!(false_alarms_per_hour(7.0, 4000.0, f64::INFINITY) < 1e-3);
        assert!(false_alarms_per_hour(7.0, 100.0, 30.0) > false_alarms_per_hour(7.0, 100.0, 300.0));
    }

    proptest! {
        #[test]
        fn norms_between_the_thresholds_never_change_the_state(
            norms in proptest::collection::vec(4.0_f64..6.999, 1..300), touching in any::<bool>()
        ) {
            let mut detector = Detector::new(Thresholds::default());
            if touching {
                run(&mut detector, &[8.0, 8.0, 8.0]);
            }
            prop_assert_eq!(run(&mut detector, &norms), []);
            prop_assert_eq!(detector.onset().is_some(), touching);
        }

        #[test]
        fn onsets_and_releases_alternate_and_time_never_runs_back(
            norms in proptest::collection::vec(0.0_f64..12.0, 1..400)
        ) {
            let events = run(&mut Detector::new(Thresholds::default()), &norms);
            let mut last = -1.0;
            for (i, event) in events.iter().enumerate() {
                let (t, is_onset) = match *event {
                    Event::Onset { t, .. } => (t, true),
                    Event::Release { t, .. } => (t, false),
                };
                prop_assert_eq!(is_onset, i % 2 == 0);
                prop_assert!(t >= last, "{events:?}");
                last = t;
            }
        }
    }
}
