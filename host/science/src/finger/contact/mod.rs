//! Force to contact angle, with its uncertainty.
//!
//! A stream of force readings goes in; for each comes out whether the finger is touched and, if so, in which
//! direction and how hard, each with its standard deviation. The steps are the submodules, in this order:
//!
//! ```text
//! readings -> average (one mains period) -> minus the tare's bias -> touched or not -> direction
//!             average                       tare, noise              detector          direction
//! ```
//!
//! Beside them, [`offline`] finds the bias of recordings that nobody tared, [`friction`] the friction of the contact where
//! pushes slid along known edges, and `arrays` writes vectors and matrices to
//! files.
//!
//! Implements: the contact direction from the bending force on the finger, thesis §6.4 (sensor implementation); the
//! uncertainty is ours.
//! Assumes: the finger is the only thing that bends; noise is Gaussian once averaged, of any spectrum.
//! Frames: `finger` (the sensor's axes). Force is the force **on the finger's disk**. Its unit is the newton, or any
//! unit at all as long as it stays the same: nothing here depends on it but the settings that say so.
//! Sign: the contact angle `u` is the polar angle of the contact seen from the disk's centre, so without friction the
//! force on the finger is `−|F| (cos u, sin u)`, and `u = atan2(−F_y, −F_x)`. Angles are in (−π, π].
//! Errors: [`TareError`] where the stretch without contact was none, [`SettingsError`]. "No contact" is an answer.
//!
//! ```
//! use nalgebra::Vector2;
//! use palpate::finger::contact::{Contact, ContactSense, Reading, ContactSettings, Tare};
//!
//! // A second at rest at 1 kHz, with an offset and 5 mN of (here very regular) noise, then 2 N from the left.
//! let noise = |i: u32| 0.005 * f64::from((i * 7919) % 101) / 50.0 - 0.005;
//! let rest: Vec<Reading> = (0..1000)
//!     .map(|i| Reading::new(f64::from(i) * 1e-3, Vector2::new(0.1 + noise(i), -0.2 + noise(i + 13))))
//!     .collect();
//! let settings = ContactSettings::default();
//! let tare = Tare::estimate(&rest, &settings.tare_settings())?;
//! let mut sense = ContactSense::new(&settings, tare)?;
//! let mut last = None;
//! for i in 1000..1010 {
//!     last = sense.push(&Reading::new(f64::from(i) * 1e-3, Vector2::new(2.1, -0.2)));
//! }
//! let Some(Contact::Touching(touch)) = last.map(|felt| felt.contact) else { panic!("not felt") };
//! assert!((touch.u.abs() - std::f64::consts::PI).abs() < 0.01, "contact on the −x side");
//! assert!((touch.magnitude - 2.0).abs() < 0.02);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod average;
pub mod detector;
pub mod direction;
pub mod friction;
pub mod noise;
pub mod offline;
pub mod tare;

#[cfg(test)]
pub(crate) mod test_noise;

use nalgebra::{Matrix2, Rotation2, Vector2};
use serde::{Deserialize, Serialize};

pub use average::{Averaging, MovingAverage};
pub use detector::{Detector, Event, Thresholds};
pub use direction::{ContactEstimate, Interval};
pub use tare::{Tare, TareError, TareSettings};

use direction::Sensed;

/// One reading of the force on the finger, before the tare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reading {
    /// Time, s, on any clock that runs evenly.
    pub t: f64,
    /// Force on the finger's disk plus the bias, finger axes.
    pub force_finger: Vector2<f64>,
}

impl Reading {
    /// A reading of `force_finger` (bias included) at `t` seconds.
    #[must_use]
    pub fn new(t: f64, force_finger: Vector2<f64>) -> Self {
        Self { t, force_finger }
    }

    /// The same along axes of which x lies at this angle in the finger's, rad: those of the robot that carries it.
    ///
    /// ```
    /// use nalgebra::Vector2;
    /// use palpate::finger::contact::Reading;
    ///
    /// // The robot's x axis is the finger's y axis.
    /// let felt = Reading::new(0.0, Vector2::new(0.0, 2.0)).mounted(90.0_f64.to_radians()); // N
    /// assert!((felt.force_finger - Vector2::new(2.0, 0.0)).norm() < 1e-12);
    /// ```
    #[must_use]
    pub fn mounted(self, mounting: f64) -> Self {
        Self { force_finger: Rotation2::new(-mounting) * self.force_finger, ..self }
    }

    fn is_finite(&self) -> bool {
        self.t.is_finite() && self.force_finger.iter().all(|value| value.is_finite())
    }
}

/// Whether the finger is touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contact {
    /// The force does not stand out of its own noise.
    Free {
        /// Tared force, finger axes.
        force_finger: Vector2<f64>,
        /// Its size in standard deviations of its own noise (Mahalanobis norm).
        sigmas: f64,
    },
    /// Something presses on the disk.
    Touching(ContactEstimate),
}

impl Contact {
    /// The touch, if there is one.
    #[must_use]
    pub fn touch(&self) -> Option<&ContactEstimate> {
        match self {
            Self::Free { .. } => None,
            Self::Touching(touch) => Some(touch),
        }
    }
}

/// What [`ContactSense`] says after one reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactReading {
    /// Mean time of the readings averaged, s.
    pub t: f64,
    /// Whether the finger is touched, and how.
    pub contact: Contact,
    /// Set on the reading at which contact is found to have begun or ended.
    pub event: Option<Event>,
}

/// How force becomes contact. Lives in a TOML file; every field has a default.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ContactSettings {
    /// Polar angle in finger axes, rad, of the direction that shall read `u = 0`.
    pub mounting_angle: f64,
    /// Friction coefficient between finger and part, `mu_c ≥ 0`; 0 for a frictionless contact.
    ///
    /// The contact normal is within `±atan(mu_c)` of the force; the sense states that, it cannot resolve it.
    pub contact_friction: f64,
    /// How many readings are averaged into one.
    pub averaging: Averaging,
    /// When contact begins and ends.
    pub thresholds: Thresholds,
    /// Random walk of the bias after the tare, force per √s: after `t` seconds the bias has spread by
    /// `bias_walk √t` on each axis. 0 for a bias that stays.
    pub bias_walk: f64,
    /// Largest standard deviation of a single reading at rest, force units, that a tare accepts; `None` accepts any.
    pub noise_max: Option<f64>,
}

impl Default for ContactSettings {
    fn default() -> Self {
        Self {
            mounting_angle: 0.0,
            contact_friction: 0.0,
            averaging: Averaging::Off,
            thresholds: Thresholds::default(),
            bias_walk: 0.0,
            noise_max: None,
        }
    }
}

impl ContactSettings {
    /// The part of the settings that a tare needs.
    #[must_use]
    pub fn tare_settings(&self) -> TareSettings {
        TareSettings { averaging: self.averaging, noise_max: self.noise_max }
    }

    /// `atan(mu_c)`, rad: how far the contact normal may be from the force.
    #[must_use]
    pub fn friction_half_angle(&self) -> f64 {
        self.contact_friction.atan()
    }

    /// Checks every field.
    ///
    /// # Errors
    /// [`SettingsError`] names the first field out of range.
    pub fn check(&self) -> Result<(), SettingsError> {
        let at_least_zero = [
            ("contact_friction", self.contact_friction),
            ("bias_walk", self.bias_walk),
            ("noise_max", self.noise_max.unwrap_or(0.0)),
            ("thresholds.force_min", self.thresholds.force_min),
        ];
        for (field, value) in at_least_zero {
            require(value.is_finite() && value >= 0.0, field, value, "finite and ≥ 0")?;
        }
        require(self.mounting_angle.is_finite(), "mounting_angle", self.mounting_angle, "finite, in rad")?;
        let Thresholds { on_sigmas, off_sigmas, .. } = self.thresholds;
        require(off_sigmas > 0.0, "thresholds.off_sigmas", off_sigmas, "above 0")?;
        require(
            on_sigmas.is_finite() && on_sigmas >= off_sigmas,
            "thresholds.on_sigmas",
            on_sigmas,
            "finite and ≥ off_sigmas",
        )?;
        self.averaging.check()
    }
}

fn require(ok: bool, field: &'static str, value: f64, limit: &'static str) -> Result<(), SettingsError> {
    if ok { Ok(()) } else { Err(SettingsError { field, value, limit }) }
}

/// A setting out of its range.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("`{field}` is {value}, which must be {limit}")]
pub struct SettingsError {
    /// Name of the field in [`ContactSettings`].
    pub field: &'static str,
    /// The setting as given, in its own unit.
    pub value: f64,
    /// What it must be.
    pub limit: &'static str,
}

/// The whole sense for one finger: readings in, contact out. Cheap enough for every reading at 4 kHz.
///
/// ```
/// use nalgebra::Vector2;
/// use palpate::ContactSense;
/// use palpate::finger::contact::{ContactSettings, Reading, Tare};
///
/// let noise = |i: u32| 0.005 * f64::from((i * 7919) % 101) / 50.0 - 0.005; // N
/// let reading = |i: u32, x: f64| Reading::new(f64::from(i) * 1e-3, Vector2::new(x + noise(i), noise(i + 13)));
/// let settings = ContactSettings::default();
/// let tare = Tare::estimate(&(0..1000).map(|i| reading(i, 0.0)).collect::<Vec<_>>(), &settings.tare_settings())?;
/// let mut sense = ContactSense::new(&settings, tare)?;
/// assert!(sense.push(&reading(1000, 0.0)).is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct ContactSense {
    settings: ContactSettings,
    tare: Tare,
    average: MovingAverage,
    detector: Detector,
}

impl ContactSense {
    /// A sense that subtracts `tare` and averages as many readings as the tare's noise is stated for.
    ///
    /// # Errors
    /// [`SettingsError`] if a setting is out of range.
    pub fn new(settings: &ContactSettings, tare: Tare) -> Result<Self, SettingsError> {
        settings.check()?;
        Ok(Self {
            settings: *settings,
            average: MovingAverage::new(tare.averaging_samples, tare.gap_max()),
            detector: Detector::new(settings.thresholds),
            tare,
        })
    }

    /// The tare in use.
    #[must_use]
    pub fn tare(&self) -> &Tare {
        &self.tare
    }

    /// Puts another tare in use; the average and the contact state start afresh.
    pub fn set_tare(&mut self, tare: Tare) {
        self.average = MovingAverage::new(tare.averaging_samples, tare.gap_max());
        self.detector = Detector::new(self.settings.thresholds);
        self.tare = tare;
    }

    /// Takes one reading of a force that is calibrated exactly. See [`ContactSense::push_calibrated`].
    pub fn push(&mut self, reading: &Reading) -> Option<ContactReading> {
        self.push_calibrated(reading, |_| Matrix2::zeros())
    }

    /// Takes one reading; `None` while the averaging window fills: at the start, after a gap, after a reading that is
    /// not finite.
    ///
    /// `calibration_covariance` gives, for a **tared** force, the covariance that the calibration's own uncertainty
    /// adds to it. It is not averaged away, and it does not count in the on/off decision: without force it is zero.
    pub fn push_calibrated(
        &mut self,
        reading: &Reading,
        calibration_covariance: impl FnOnce(&Vector2<f64>) -> Matrix2<f64>,
    ) -> Option<ContactReading> {
        let mean = self.average.push(reading)?;
        let force_finger = mean.force_finger - self.tare.bias;
        let noise = self.noise_at(mean.t);
        let sigmas = noise::mahalanobis(&force_finger, &noise);
        let event = self.detector.push(mean.t, sigmas, force_finger.norm());
        let contact = match self.detector.onset() {
            None => Contact::Free { force_finger, sigmas },
            Some(onset) => {
                let force_covariance = noise + calibration_covariance(&force_finger);
                let sensed = Sensed { force_finger, force_covariance, onset };
                Contact::Touching(ContactEstimate::new(
                    &sensed,
                    self.settings.mounting_angle,
                    self.settings.friction_half_angle(),
                ))
            }
        };
        Some(ContactReading { t: mean.t, contact, event })
    }

    /// Covariance of one averaged and tared reading at time `t`: its noise, the tare's, and the bias's walk since.
    fn noise_at(&self, t: f64) -> Matrix2<f64> {
        let age = (t - self.tare.t_to).max(self.tare.t_from - t).max(0.0);
        let walk = self.settings.bias_walk.powi(2) * age;
        self.tare.sample_covariance + self.tare.bias_covariance + Matrix2::identity() * walk
    }
}

#[cfg(test)]
mod tests {
    use super::test_noise::Noise;
    use super::*;

    const SIGMA: f64 = 0.005;

    /// A sense tared on one second of the noise at 1 kHz.
    fn tared(noise: &mut Noise, settings: &ContactSettings) -> ContactSense {
        let tare = Tare::estimate(&noise.readings(1000), &settings.tare_settings()).unwrap();
        ContactSense::new(settings, tare).unwrap()
    }

    #[test]
    fn a_press_is_felt_when_it_comes_and_gone_when_it_goes() {
        let mut noise = Noise::white(1, SIGMA);
        let mut sense = tared(&mut noise, &ContactSettings::default());
        let mut events = Vec::new();
        for i in 0..3000 {
            let mut reading = noise.reading();
            if (1000..2000).contains(&i) {
                reading.force_finger += Vector2::new(0.0, -0.5);
            }
            let felt = sense.push(&reading).unwrap();
            events.extend(felt.event);
            if let Some(touch) = felt.contact.touch() {
                assert!((touch.u - std::f64::consts::FRAC_PI_2).abs() < 6.0 * touch.u_sd, "{touch:?}");
            }
        }
        let [Event::Onset { t: on, .. }, Event::Release { t: off, .. }] = events[..] else { panic!("{events:?}") };
        assert!((on - 2.0).abs() < 1.5e-3 && (off - 3.0).abs() < 1.5e-3, "{on} {off}");
    }

    #[test]
    fn nothing_is_felt_in_a_quarter_of_a_million_readings_at_rest() {
        let mut noise = Noise { hum: 0.003, ..Noise::white(2, SIGMA) };
        let settings = ContactSettings { averaging: Averaging::Seconds(0.02), ..ContactSettings::default() };
        let mut sense = tared(&mut noise, &settings);
        let felt =
            (0..250_000).filter_map(|_| sense.push(&noise.reading())).filter(|felt| felt.event.is_some()).count();
        assert_eq!(felt, 0);
    }

    #[test]
    fn a_bias_that_walks_as_the_settings_say_is_not_a_touch() {
        let settings = ContactSettings { bias_walk: 0.02, ..ContactSettings::default() };
        let mut noise = Noise { drift: 0.0, ..Noise::white(3, SIGMA) };
        let (mut patient, mut hasty) = (tared(&mut noise, &settings), tared(&mut noise, &ContactSettings::default()));
        noise.drift = 0.002;
        let (mut false_touches, mut wrong) = (0, 0);
        for _ in 0..100_000 {
            let reading = noise.reading();
            wrong += usize::from(patient.push(&reading).unwrap().event.is_some());
            false_touches += usize::from(hasty.push(&reading).unwrap().event.is_some());
        }
        assert_eq!(wrong, 0);
        assert!(false_touches > 0, "0.2 of drift is 40 standard deviations");
    }

    #[test]
    fn the_force_s_covariance_is_noise_plus_tare_plus_the_bias_s_walk_since() {
        let settings = ContactSettings { bias_walk: 0.01, ..ContactSettings::default() };
        let mut tare = Tare::estimate(&Noise::white(6, SIGMA).readings(1000), &settings.tare_settings()).unwrap();
        tare.bias_covariance = Matrix2::new(4e-6, 1e-6, 1e-6, 9e-6);
        let known = tare.sample_covariance + tare.bias_covariance;
        for age in [0.0, 4.0] {
            let mut sense = ContactSense::new(&settings, tare).unwrap();
            let mut felt = None;
            for i in 0..3 {
                let t = tare.t_to + age + f64::from(i) * 1e-6;
                felt = sense.push(&Reading::new(t, Vector2::new(5.0, 0.0)));
            }
            let covariance = felt.unwrap().contact.touch().unwrap().force_covariance;
            let want = known + Matrix2::identity() * (1e-4 * age);
            // The last reading is 2 µs older than the age says.
            assert!((covariance - want).amax() < 1e-9, "{covariance}, wanted {want}");
        }
    }

    #[test]
    fn calibration_uncertainty_widens_the_angle_and_is_not_averaged_away() {
        let settings = ContactSettings { averaging: Averaging::Samples(50), ..ContactSettings::default() };
        let mut noise = Noise::white(4, SIGMA);
        let mut sense = tared(&mut noise, &settings);
        let mut felt = None;
        for _ in 0..200 {
            let mut reading = noise.reading();
            reading.force_finger.x += 2.0;
            // One per cent of the force, across it.
            felt = sense.push_calibrated(&reading, |force| Matrix2::new(0.0, 0.0, 0.0, (0.01 * force.x).powi(2)));
        }
        let touch = *felt.unwrap().contact.touch().unwrap();
        assert!((touch.u_sd / 0.01 - 1.0).abs() < 0.02, "{}", touch.u_sd);
    }

    #[test]
    fn the_window_fills_again_after_a_gap() {
        let settings = ContactSettings { averaging: Averaging::Samples(10), ..ContactSettings::default() };
        let mut noise = Noise::white(5, SIGMA);
        let mut sense = tared(&mut noise, &settings);
        let given = |sense: &mut ContactSense, noise: &mut Noise| {
            (0..20).filter(|_| sense.push(&noise.reading()).is_some()).count()
        };
        assert_eq!(given(&mut sense, &mut noise), 11);
        noise.t += 0.1;
        assert_eq!(given(&mut sense, &mut noise), 11);
    }

    #[test]
    fn settings_read_from_toml_and_keep_defaults_for_what_is_left_out() {
        let text = "mounting_angle = 0.5\naveraging = { seconds = 0.02 }\n[thresholds]\non_sigmas = 8.0\n";
        let settings: ContactSettings = toml::from_str(text).unwrap();
        let thresholds = Thresholds { on_sigmas: 8.0, ..Thresholds::default() };
        let averaging = Averaging::Seconds(0.02);
        assert_eq!(
            settings,
            ContactSettings { mounting_angle: 0.5, averaging, thresholds, ..ContactSettings::default() }
        );
        assert_eq!(toml::from_str::<ContactSettings>(&toml::to_string(&settings).unwrap()).unwrap(), settings);
        assert!(toml::from_str::<ContactSettings>("friction = 0.3").is_err(), "an unknown name is refused");
    }

    #[test]
    fn impossible_settings_are_refused_by_name() {
        let default = ContactSettings::default();
        let thresholds = |on_sigmas, off_sigmas| Thresholds { on_sigmas, off_sigmas, ..Thresholds::default() };
        let cases = [
            (ContactSettings { contact_friction: -0.1, ..default }, "contact_friction"),
            (ContactSettings { mounting_angle: f64::NAN, ..default }, "mounting_angle"),
            (ContactSettings { bias_walk: f64::INFINITY, ..default }, "bias_walk"),
            (ContactSettings { averaging: Averaging::Samples(0), ..default }, "averaging"),
            (ContactSettings { averaging: Averaging::Seconds(-1.0), ..default }, "averaging"),
            (ContactSettings { thresholds: thresholds(3.0, 4.0), ..default }, "thresholds.on_sigmas"),
            (ContactSettings { thresholds: thresholds(3.0, 0.0), ..default }, "thresholds.off_sigmas"),
        ];
        for (settings, field) in cases {
            assert_eq!(settings.check().unwrap_err().field, field);
        }
        assert!(default.check().is_ok());
    }
}
