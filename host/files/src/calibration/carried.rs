//! What a result says of a finger that is carried about: what it weighs on itself, how it bends, where its tip is; and of
//! one that warms up.
//!
//! Each is optional: a result of an older program, or of a finger that nobody waved, says nothing of it, and
//! [`CalibrationFile::carried`] then gives what is taken for it, and [`CalibrationFile::lacks`] what that is.
//!
//! Units: grams, micrometres per newton, millimetres, degrees, microstrain per kelvin, by name. Errors: none.

use nalgebra::Vector2;
use palpate::finger::calibration::FrontEnd;
use palpate::finger::calibration::zero_drift::{ZeroDrift, ZeroDriftFit};
use palpate::pushing::estimation::from_rest::CarriedFinger;
use palpate::pushing::tip::TipFit;
use palpate::pushing::wave::WaveFit;
use serde::{Deserialize, Serialize};

use super::file::{CalibrationFile, RawRecord};

/// A gram, kg.
const GRAM: f64 = 1e-3;

/// A micrometre, m.
const MICROMETRE: f64 = 1e-6;

/// A millimetre, m.
const MILLIMETRE: f64 = 1e-3;

/// What a wave in the air found.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WaveRecord {
    /// Effective mass, g.
    pub effective_mass_g: f64,
    /// Its standard deviation, g.
    pub effective_mass_sigma_g: f64,
    /// Angle of the motion's x axis in finger axes, degrees.
    pub mounting_deg: f64,
    /// Its standard deviation, degrees.
    pub mounting_sigma_deg: f64,
    /// What the fit leaves of a mean over 40 ms, rms, N.
    pub left_n: f64,
    /// Means that were held back from a first fit to judge it.
    pub held_back: usize,
    /// What of them was not foretold, rms, N.
    pub held_back_off_n: f64,
    /// The inertia that was foretold there, rms, N.
    pub held_back_inertia_n: f64,
    /// The samples that it was found from, where they were kept.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub raw: Option<RawRecord>,
}

impl From<&WaveFit> for WaveRecord {
    fn from(fit: &WaveFit) -> Self {
        Self {
            effective_mass_g: fit.effective_mass.value / GRAM,
            effective_mass_sigma_g: fit.effective_mass.sd / GRAM,
            mounting_deg: fit.mounting.value.to_degrees(),
            mounting_sigma_deg: fit.mounting.sd.to_degrees(),
            left_n: fit.left,
            held_back: fit.held_back.windows,
            held_back_off_n: fit.held_back.off,
            held_back_inertia_n: fit.held_back.inertia,
            raw: None,
        }
    }
}

/// How far the tip gives way.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ComplianceRecord {
    /// µm/N.
    pub um_per_n: f64,
    /// Its standard deviation, µm/N.
    pub sigma_um_per_n: f64,
    /// Loads that it was found from; 0 where it was stated.
    pub loads: usize,
}

/// How the reading without load goes with temperature.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ZeroDriftRecord {
    /// Change of the x and y bridge, microstrain per kelvin.
    pub microstrain_per_k: [f64; 2],
    /// Standard deviations, microstrain per kelvin.
    pub sigma_microstrain_per_k: [f64; 2],
    /// What the line leaves of means at rest, rms, microstrain.
    pub left_microstrain: [f64; 2],
    /// Lowest and highest temperature, °C.
    pub celsius: [f64; 2],
    /// Means that it was found from.
    pub means: usize,
}

impl ZeroDriftRecord {
    /// What a fit found, with this front-end.
    #[must_use]
    pub fn new(fit: &ZeroDriftFit, front_end: &FrontEnd) -> Self {
        let microstrain = |counts: Vector2<f64>| (counts * front_end.microstrain_per_count()).into();
        Self {
            microstrain_per_k: microstrain(fit.drift.counts_per_k),
            sigma_microstrain_per_k: microstrain(fit.drift.sd),
            left_microstrain: microstrain(fit.left),
            celsius: fit.celsius.into(),
            means: fit.means,
        }
    }

    /// The same in counts of this front-end.
    #[must_use]
    pub fn drift(&self, front_end: &FrontEnd) -> ZeroDrift {
        let counts = |microstrain: [f64; 2]| Vector2::from(microstrain) / front_end.microstrain_per_count();
        ZeroDrift { counts_per_k: counts(self.microstrain_per_k), sd: counts(self.sigma_microstrain_per_k) }
    }

    /// Whether it can be that of a finger.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        /// No gauge that holds drifts by more, microstrain per kelvin: it is the strain of steel that warms, eight times over.
        const MOST: f64 = 100.0;
        self.microstrain_per_k.iter().chain(&self.sigma_microstrain_per_k).all(|value| value.abs() <= MOST)
            && self.sigma_microstrain_per_k.iter().all(|sigma| *sigma >= 0.0)
    }
}

/// Where the disk's centre is on the wrist.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TipRecord {
    /// From the wrist's point to the disk's centre, the wrist's axes, mm.
    pub offset_mm: [f64; 2],
    /// Standard deviations, mm.
    pub sigma_mm: [f64; 2],
    /// What the touches leave, rms, mm.
    pub rms_mm: f64,
    /// How many touches there were.
    pub touches: usize,
}

impl From<&TipFit> for TipRecord {
    fn from(fit: &TipFit) -> Self {
        Self {
            offset_mm: (fit.offset / MILLIMETRE).into(),
            sigma_mm: (fit.sd / MILLIMETRE).into(),
            rms_mm: fit.rms / MILLIMETRE,
            touches: fit.touches,
        }
    }
}

impl CalibrationFile {
    /// The finger as it is carried: where nothing is known of its mass a prior, and of its bending none.
    #[must_use]
    pub fn carried(&self) -> CarriedFinger {
        let prior = CarriedFinger::UNKNOWN;
        let (effective_mass, effective_mass_sd) =
            self.wave.as_ref().map_or((prior.effective_mass, prior.effective_mass_sd), |wave| {
                (wave.effective_mass_g * GRAM, wave.effective_mass_sigma_g * GRAM)
            });
        let [compliance, compliance_sd] = self.compliance.map_or([prior.compliance, prior.compliance_sd], |found| {
            [found.um_per_n, found.sigma_um_per_n].map(|value| value * MICROMETRE)
        });
        // The wrist may be turned anyhow: the larger of the two in every direction.
        let place_sd = self.tip.map_or(prior.place_sd, |tip| tip.sigma_mm[0].max(tip.sigma_mm[1]) * MILLIMETRE);
        CarriedFinger { effective_mass, effective_mass_sd, compliance, compliance_sd, place_sd }
    }

    /// What the result does not say of a carried finger, in words.
    #[must_use]
    pub fn lacks(&self) -> Vec<&'static str> {
        let parts = [
            (self.wave.is_none(), "effective mass"),
            (self.compliance.is_none(), "compliance"),
            (self.tip.is_none(), "tip's place"),
        ];
        parts.into_iter().filter_map(|(is_lacking, name)| is_lacking.then_some(name)).collect()
    }
}
