//! What a calibration is made from: contacts at known angles, their loads as far as known, and unloaded readings.
//!
//! Frames: angles are contact angles `u` in finger axes, as in [`push_direction`](crate::math::angle::push_direction);
//! the mounting angle is zero.
//! Units: radians, newtons, counts.

use nalgebra::Vector2;

use super::force::{DwellReading, DwellTare};

/// How much is known of the force of one contact besides its direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Load {
    /// Nothing: pressed by hand, or a weight that nobody weighed and that was changed between contacts.
    Unknown,
    /// The same load as every other contact marked so, whatever it is: one weight, never weighed.
    Same,
    /// A known load of so many newtons.
    Newtons(f64),
}

/// One contact held still.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationContact {
    /// Contact angle `u` in the finger's frame, rad.
    pub angle: f64,
    /// What is known of its size.
    pub load: Load,
    /// Mean counts under load.
    pub reading: DwellReading,
    /// Reading at the same position just before, unloaded; without it the tares of the whole session serve.
    ///
    /// A finger lying in a dividing head needs it: the weight of its own disk turns with respect to the gauges.
    pub tare: Option<DwellTare>,
}

/// A whole calibration run.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measurements {
    /// Loaded contacts in the order taken.
    pub contacts: Vec<CalibrationContact>,
    /// Unloaded readings that serve every contact without its own.
    pub tares: Vec<DwellTare>,
}

impl Measurements {
    /// Counts due to the load of a contact: its reading without its tare.
    pub(super) fn loaded_counts(&self, contact: &CalibrationContact) -> Vector2<f64> {
        contact.reading.counts - contact.tare.map_or_else(|| self.mean_tare_counts(), |tare| tare.0.counts)
    }

    /// Mean of the session's tares, zero if there are none.
    pub(super) fn mean_tare_counts(&self) -> Vector2<f64> {
        let sum: Vector2<f64> = self.tares.iter().map(|tare| tare.0.counts).sum();
        let count = self.tares.len().max(1) as f64;
        sum / count
    }
}

/// What the fixture can be trusted with, as standard deviations.
///
/// After half a second the reading's own noise turns a 2 N contact by less than 0.01°, so it is the fixture that
/// decides how far a good contact may lie from the fitted matrix. Stating it keeps the robust weights honest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fixture {
    /// Setting of the contact angle, rad.
    pub angle_sigma: f64,
    /// Size of a load that is called known or the same, relative (friction of the thread, swing of the weight).
    pub load_sigma: f64,
    /// Drift of either bridge between a reading and the tare it is compared with, counts.
    pub drift_sigma: f64,
}

impl Fixture {
    /// Setting of a workshop's dividing head or index plate, and of a thread laid over the disk: 0.05°.
    pub const ANGLE_SIGMA: f64 = 0.05 * std::f64::consts::PI / 180.0;
    /// A laboratory weight on a thread that has come to rest: 0.1 %.
    pub const LOAD_SIGMA: f64 = 1e-3;
    /// A tenth of a kelvin between tare and contact at 0.5 microstrain per kelvin: 0.05 microstrain.
    pub const DRIFT_SIGMA_MICROSTRAIN: f64 = 0.05;

    /// The constants above for a front-end of this resolution.
    #[must_use]
    pub fn of_a_dividing_head(microstrain_per_count: f64) -> Self {
        let drift_sigma = Self::DRIFT_SIGMA_MICROSTRAIN / microstrain_per_count;
        Self { angle_sigma: Self::ANGLE_SIGMA, load_sigma: Self::LOAD_SIGMA, drift_sigma }
    }
}
