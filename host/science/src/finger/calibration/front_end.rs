//! What turns a raw code into strain: the one place where counts stop being counts.
//!
//! Two half bridges of two opposite active gauges, so a bending strain ε unbalances a bridge by `V = V_ex · GF · ε / 2`
//! (one gauge stretches by ε while the other shrinks by it; the other two resistors are fixed). The converter gives
//! `V = code · full_scale / gain / 2²³` (ADS131M02 data sheet SBAS853A, "Data format").
//!
//! Units: volts, strain (dimensionless; 1 microstrain = 1e-6). Frames: none, each bridge by itself.
//! Errors: a front-end that cannot be real is refused when it is built.

use nalgebra::Vector2;
use palpate_shared::units::Counts;
use thiserror::Error;

/// Codes on either side of zero in a 24 bit two's complement converter.
const HALF_RANGE_CODES: f64 = 8_388_608.0;

/// What the front-end was set to while samples were taken; the device's hello message states all but the gauge factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrontEnd {
    gain: u8,
    excitation_v: f64,
    full_scale_v: f64,
    gauge_factor: f64,
}

/// The four numbers of a [`FrontEnd`], unchecked.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrontEndSettings {
    /// Gain of the converter's amplifier, 1 to 128.
    pub gain: u8,
    /// Voltage across each bridge, V.
    pub excitation_v: f64,
    /// Input that reaches the largest code at gain 1, V (1.2 for the ADS131M02).
    pub full_scale_v: f64,
    /// Relative change of a gauge's resistance per strain, from the gauge's data sheet (about 2 for foil).
    pub gauge_factor: f64,
}

/// Why a front-end is refused.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum FrontEndError {
    /// The gain is not one the converter has.
    #[error("gain {0} is not one of 1, 2, 4, 8, 16, 32, 64, 128")]
    Gain(u8),
    /// A voltage or the gauge factor is zero, negative or not a number.
    #[error("{name} is {value}, which is not above 0 and finite")]
    NotPositive {
        /// Which quantity, with its unit.
        name: &'static str,
        /// The number as given.
        value: f64,
    },
}

impl FrontEnd {
    /// Checks the settings once, so that every conversion after it is finite.
    ///
    /// # Errors
    /// A gain the converter does not have, or a quantity that is not positive and finite.
    ///
    /// ```
    /// use palpate::finger::calibration::{FrontEnd, FrontEndSettings};
    /// let settings = FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 };
    /// let front_end = FrontEnd::new(settings)?;
    /// // 2.5 µV per microstrain, 4.47 nV per code.
    /// assert!((1e-6 / front_end.strain_per_count() - 559.24).abs() < 0.01);
    /// # Ok::<(), palpate::finger::calibration::FrontEndError>(())
    /// ```
    pub fn new(settings: FrontEndSettings) -> Result<Self, FrontEndError> {
        let FrontEndSettings { gain, excitation_v, full_scale_v, gauge_factor } = settings;
        if !gain.is_power_of_two() {
            return Err(FrontEndError::Gain(gain));
        }
        let positive =
            [("excitation in V", excitation_v), ("full scale in V", full_scale_v), ("gauge factor", gauge_factor)];
        for (name, value) in positive {
            if !(value.is_finite() && value > 0.0) {
                return Err(FrontEndError::NotPositive { name, value });
            }
        }
        Ok(Self { gain, excitation_v, full_scale_v, gauge_factor })
    }

    /// The settings it was built from.
    #[must_use]
    pub fn settings(&self) -> FrontEndSettings {
        let Self { gain, excitation_v, full_scale_v, gauge_factor } = *self;
        FrontEndSettings { gain, excitation_v, full_scale_v, gauge_factor }
    }

    /// Bridge voltage of one code, V.
    #[must_use]
    pub fn volts_per_count(&self) -> f64 {
        self.full_scale_v / f64::from(self.gain) / HALF_RANGE_CODES
    }

    /// Bending strain of one code; positive where the bridge's voltage is.
    #[must_use]
    pub fn strain_per_count(&self) -> f64 {
        2.0 * self.volts_per_count() / (self.excitation_v * self.gauge_factor)
    }

    /// Microstrain of one code, for messages.
    #[must_use]
    pub fn microstrain_per_count(&self) -> f64 {
        self.strain_per_count() * 1e6
    }
}

/// One sample of both bridges as numbers to calculate with, (x, y) in counts.
#[must_use]
pub fn counts_vector(counts: [Counts; 2]) -> Vector2<f64> {
    Vector2::new(f64::from(counts[0].0), f64::from(counts[1].0))
}

#[cfg(test)]
mod tests {
    use super::*;

    const DEFAULT: FrontEndSettings =
        FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 };

    #[test]
    fn one_code_at_gain_32_is_4_47_nanovolt() {
        let front_end = FrontEnd::new(DEFAULT).unwrap();
        let nanovolt = front_end.volts_per_count() * 1e9;
        assert!((nanovolt - 4.470_348).abs() < 1e-6, "got {nanovolt} nV, wanted 2.4 V / 32 / 2^24");
    }

    #[test]
    fn a_microstrain_unbalances_the_bridge_by_2_5_microvolt() {
        let front_end = FrontEnd::new(DEFAULT).unwrap();
        let volts = front_end.volts_per_count() / front_end.strain_per_count() * 1e-6;
        assert!((volts - 2.5e-6).abs() < 1e-18, "got {volts} V");
    }

    #[test]
    fn impossible_settings_are_refused_by_name() {
        assert_eq!(FrontEnd::new(FrontEndSettings { gain: 3, ..DEFAULT }), Err(FrontEndError::Gain(3)));
        assert_eq!(FrontEnd::new(FrontEndSettings { gain: 0, ..DEFAULT }), Err(FrontEndError::Gain(0)));
        let error = FrontEnd::new(FrontEndSettings { excitation_v: f64::NAN, ..DEFAULT }).unwrap_err();
        assert!(error.to_string().contains("excitation"), "{error}");
        assert!(FrontEnd::new(FrontEndSettings { gauge_factor: 0.0, ..DEFAULT }).is_err());
    }
}
