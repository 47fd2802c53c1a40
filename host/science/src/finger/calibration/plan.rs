//! Which contacts a calibration takes, in which order, and how its data are fitted.
//!
//! The default: twelve contacts every 30°, each with its tare, every fourth held back. Nine fitted contacts, none more
//! than 60° from the next, leave a later contact √(3/9) = 0.6 times as uncertain as one of them; the three held back
//! lie a third of a turn apart (why that matters: [`super::held_back`]); and 24 dwells of a second take an unhurried
//! person a quarter of an hour, short against the drift of a room.
//!
//! Units: degrees and per cent in the file, rad inside. Errors: [`PlanError`].

use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::dwell::{DwellSettings, DwellSettingsError};
use super::fit::FitSettings;
use super::front_end::FrontEnd;
use super::measurements::{Fixture, Load};

/// Format of plan files.
pub const PLAN_FORMAT: u32 = 1;

/// Most contacts in a plan: an evening's work, and more than any finger needs.
pub const CONTACTS_MAX: usize = 360;

/// When unloaded readings are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TareMode {
    /// Before every contact, at its position: for a finger that turns in a dividing head.
    Each,
    /// Before the first and after the last contact: for an upright finger that does not move.
    Once,
}

/// One contact of a plan.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannedContact {
    /// Contact angle in the finger's frame, degrees.
    pub angle_deg: f64,
    /// What is known of the load.
    pub load: Load,
}

/// A plan as it stands in a file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CalibrationPlan {
    /// Format of the file.
    pub format: u32,
    /// When an unloaded reading is taken.
    #[serde(default = "default_tare")]
    pub tare: TareMode,
    /// Length of a dwell, s.
    #[serde(default = "default_dwell_s")]
    pub dwell_s: f64,
    /// How long to wait for rest, s.
    #[serde(default = "default_patience_s")]
    pub patience_s: f64,
    /// Mains frequency, Hz.
    #[serde(default = "default_mains_hz")]
    pub mains_hz: f64,
    /// Every how many angles one is held back; 0 for none.
    #[serde(default = "default_held_back_every")]
    pub held_back_every: usize,
    /// Standard deviation of the angle settings, degrees.
    #[serde(default = "default_angle_sigma_deg")]
    pub angle_sigma_deg: f64,
    /// Standard deviation of known and same loads, per cent.
    #[serde(default = "default_load_sigma_percent")]
    pub load_sigma_percent: f64,
    /// Standard deviation of the drift between contact and tare, microstrain.
    #[serde(default = "default_drift_sigma_microstrain")]
    pub drift_sigma_microstrain: f64,
    /// The contacts in order.
    #[serde(rename = "contact")]
    pub contacts: Vec<PlannedContact>,
}

fn default_tare() -> TareMode {
    TareMode::Each
}

fn default_dwell_s() -> f64 {
    1.0
}

fn default_patience_s() -> f64 {
    30.0
}

fn default_mains_hz() -> f64 {
    50.0
}

fn default_held_back_every() -> usize {
    4
}

fn default_angle_sigma_deg() -> f64 {
    Fixture::ANGLE_SIGMA.to_degrees()
}

fn default_load_sigma_percent() -> f64 {
    100.0 * Fixture::LOAD_SIGMA
}

fn default_drift_sigma_microstrain() -> f64 {
    Fixture::DRIFT_SIGMA_MICROSTRAIN
}

/// What is wrong with a plan.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum PlanError {
    /// The file is of another format, with this number.
    #[error("the plan has format {0}, this program reads format {PLAN_FORMAT}")]
    Format(u32),
    /// No or far too many contacts.
    #[error("the plan has {0} contacts, 1 to {CONTACTS_MAX} can be taken")]
    Contacts(usize),
    /// A number that cannot be.
    #[error("{name} is {value}")]
    Value {
        /// Name of the key.
        name: String,
        /// The number as given.
        value: f64,
        /// What it may be.
        wanted: &'static str,
    },
    /// Dwell settings that do not work.
    #[error(transparent)]
    Dwell(#[from] DwellSettingsError),
}

/// One thing to do at the bench.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "lowercase", deny_unknown_fields)]
pub enum Step {
    /// Take an unloaded reading.
    Tare {
        /// Position of the head as contact angle, degrees; `None` where the finger does not turn.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        angle_deg: Option<f64>,
    },
    /// Take a reading with this contact.
    Contact(PlannedContact),
}

impl Step {
    /// What to do, for the person at the bench.
    #[must_use]
    pub fn prompt(&self) -> String {
        match self {
            Self::Tare { angle_deg: Some(angle) } => format!("turn the finger to {angle}° and take every load off it"),
            Self::Tare { angle_deg: None } => "take every load off the finger".to_owned(),
            Self::Contact(PlannedContact { angle_deg, load: Load::Newtons(newtons) }) => {
                let grams = newtons / crate::gravity::GRAVITY_STANDARD * 1e3;
                format!("load the finger at {angle_deg}° with {newtons:.4} N ({grams:.1} g hung)")
            }
            Self::Contact(PlannedContact { angle_deg, load: Load::Same }) => {
                format!("load the finger at {angle_deg}° with the same weight as always")
            }
            Self::Contact(PlannedContact { angle_deg, load: Load::Unknown }) => {
                format!("load the finger at {angle_deg}°")
            }
        }
    }
}

impl CalibrationPlan {
    /// `count` contacts evenly all round from 0°, all with this load.
    #[must_use]
    pub fn all_round(count: u32, load: Load, tare: TareMode) -> Self {
        let contact = |k: u32| PlannedContact { angle_deg: 360.0 * f64::from(k) / f64::from(count), load };
        Self {
            format: PLAN_FORMAT,
            tare,
            dwell_s: default_dwell_s(),
            patience_s: default_patience_s(),
            mains_hz: default_mains_hz(),
            held_back_every: default_held_back_every(),
            angle_sigma_deg: default_angle_sigma_deg(),
            load_sigma_percent: default_load_sigma_percent(),
            drift_sigma_microstrain: default_drift_sigma_microstrain(),
            contacts: (0..count).map(contact).collect(),
        }
    }

    /// Checks every value.
    ///
    /// # Errors
    /// [`PlanError`] with the first that cannot be.
    pub fn check(&self) -> Result<(), PlanError> {
        if self.format != PLAN_FORMAT {
            return Err(PlanError::Format(self.format));
        }
        if self.contacts.is_empty() || self.contacts.len() > CONTACTS_MAX {
            return Err(PlanError::Contacts(self.contacts.len()));
        }
        let sigmas = [
            ("angle_sigma_deg", self.angle_sigma_deg, 10.0),
            ("load_sigma_percent", self.load_sigma_percent, 100.0),
            ("drift_sigma_microstrain", self.drift_sigma_microstrain, 1000.0),
        ];
        for (name, value, limit) in sigmas {
            if !(0.0..=limit).contains(&value) {
                return Err(PlanError::Value {
                    name: name.to_owned(),
                    value,
                    wanted: "a standard deviation, at least 0 and not absurdly large",
                });
            }
        }
        if self.held_back_every == 1 {
            return Err(PlanError::Value {
                name: "held_back_every".to_owned(),
                value: 1.0,
                wanted: "0 for none, or at least 2",
            });
        }
        self.contacts.iter().enumerate().try_for_each(|(index, contact)| check_contact(index + 1, contact))
    }

    /// Everything there is to do, in order.
    #[must_use]
    pub fn steps(&self) -> Vec<Step> {
        match self.tare {
            TareMode::Each => {
                let pair = |contact: &PlannedContact| {
                    [Step::Tare { angle_deg: Some(contact.angle_deg) }, Step::Contact(*contact)]
                };
                self.contacts.iter().flat_map(pair).collect()
            }
            TareMode::Once => {
                let tare = || std::iter::once(Step::Tare { angle_deg: None });
                tare().chain(self.contacts.iter().map(|contact| Step::Contact(*contact))).chain(tare()).collect()
            }
        }
    }

    /// How dwells are taken with a front-end at a sampling rate in Hz.
    ///
    /// # Errors
    /// Settings that do not work together.
    pub fn dwell_settings(&self, front_end: FrontEnd, rate_hz: f64) -> Result<DwellSettings, PlanError> {
        let settings = DwellSettings {
            rate_hz,
            mains_hz: self.mains_hz,
            duration_s: self.dwell_s,
            patience_s: self.patience_s,
            drift_sigma: self.fit_settings(&front_end).fixture.drift_sigma,
            front_end,
        };
        settings.check()?;
        Ok(settings)
    }

    /// How the data are fitted, with a front-end of this resolution.
    #[must_use]
    pub fn fit_settings(&self, front_end: &FrontEnd) -> FitSettings {
        let fixture = Fixture {
            angle_sigma: self.angle_sigma_deg.to_radians(),
            load_sigma: self.load_sigma_percent / 100.0,
            drift_sigma: self.drift_sigma_microstrain / front_end.microstrain_per_count(),
        };
        FitSettings { fixture, held_back_every: self.held_back_every }
    }
}

fn check_contact(number: usize, contact: &PlannedContact) -> Result<(), PlanError> {
    if !(-360.0..=360.0).contains(&contact.angle_deg) {
        let name = format!("angle_deg of contact {number}");
        return Err(PlanError::Value { name, value: contact.angle_deg, wanted: "from -360 to 360" });
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tare_for_all_is_taken_before_and_after() {
        let steps = CalibrationPlan::all_round(12, Load::Same, TareMode::Once).steps();
        assert_eq!(
            (steps.len(), steps[0], steps[13]),
            (14, Step::Tare { angle_deg: None }, Step::Tare { angle_deg: None })
        );
    }
}
