//! From the samples of a run to its result and the report a person judges it by.
//!
//! Live runs and kept raw files go the same way, so that recalculating gives the same numbers to the last digit.

use palpate::finger::calibration::fit::{CalibrationFit, ContactResult, FitError, Role, fit};
use palpate::finger::calibration::force::ForceUnit;
use palpate::finger::calibration::front_end::FrontEnd;
use palpate::finger::calibration::session::{Taken, drift_between_tares, measurements};
use palpate::math::angle::push_direction;
use thiserror::Error;

use super::raw::{RawError, RawRun};

/// Largest error of a held-back contact for which a calibration is kept, degrees: the bar for a mean at 2 N.
pub const HELD_BACK_ERROR_MAX_DEG: f64 = 0.2;

/// A run that gave a matrix.
#[derive(Clone, Debug, PartialEq)]
pub struct Conclusion {
    /// The matrix and how every contact agrees with it.
    pub fit: CalibrationFit,
    /// The dwells it was made from.
    pub taken: Vec<Taken>,
    /// Gain, excitation and gauges: what turns counts into strain.
    pub front_end: FrontEnd,
}

/// Why a run gives none.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum ConclusionError {
    /// The samples cannot be used.
    #[error(transparent)]
    Raw(#[from] RawError),
    /// The contacts give no matrix.
    #[error(transparent)]
    Fit(#[from] FitError),
}

/// A calibration that its held-back contacts speak against.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
#[error(
    "the held-back contact at {angle_deg:.1}° is felt {error_deg:+.2}° off (limit {limit_deg}°, expected ± {sigma_deg:.2}°)"
)]
pub struct HeldBackError {
    /// Contact angle that was set, degrees.
    pub angle_deg: f64,
    /// Angle felt minus angle set, degrees.
    pub error_deg: f64,
    /// Expected standard deviation of that.
    pub sigma_deg: f64,
    /// Largest error that is accepted, degrees.
    pub limit_deg: f64,
}

/// Measures, fits and judges the dwells of a run.
///
/// # Errors
/// Samples that are not at rest, or contacts that give no matrix.
pub fn conclude(run: &RawRun) -> Result<Conclusion, ConclusionError> {
    let front_end = run.dwell_settings()?.front_end;
    let taken = run.measure()?;
    let fit = fit(&measurements(&taken), &run.plan.fit_settings(&front_end))?;
    Ok(Conclusion { fit, taken, front_end })
}

impl Conclusion {
    /// Whether the held-back contacts, if any, are felt within the limit (degrees).
    ///
    /// # Errors
    /// The worst of them.
    pub fn judge(&self, limit_deg: f64) -> Result<(), HeldBackError> {
        let Some(held) = self.fit.held_back() else { return Ok(()) };
        let error_deg = held.worst_error.to_degrees();
        if error_deg.abs() <= limit_deg {
            return Ok(());
        }
        let (angle_deg, sigma_deg) = (held.worst_angle.to_degrees(), held.worst_sigma.to_degrees());
        Err(HeldBackError { angle_deg, error_deg, sigma_deg, limit_deg })
    }

    /// Largest standard deviation that the calibration itself leaves in a contact angle, and where; degrees.
    #[must_use]
    pub fn worst_direction_deg(&self) -> (f64, f64) {
        let sigma = |degrees: u32| {
            let force = push_direction(f64::from(degrees).to_radians());
            (self.fit.calibration.direction_variance(force).sqrt().to_degrees(), f64::from(degrees))
        };
        (0..180).map(sigma).fold((0.0, 0.0), |worst, next| if next.0 > worst.0 { next } else { worst })
    }

    fn write_contact(
        &self,
        f: &mut std::fmt::Formatter<'_>,
        number: usize,
        contact: &ContactResult,
    ) -> std::fmt::Result {
        let residual = contact.residual_counts * self.front_end.microstrain_per_count();
        let role = match contact.role {
            Role::HeldBack => "held back".to_owned(),
            Role::Fitted { weight } if contact.is_outlier() => {
                format!("OUTLIER by {:.1} sigma, counted {:.0} %", contact.sigmas, 100.0 * weight)
            }
            Role::Fitted { .. } => "fitted".to_owned(),
        };
        writeln!(
            f,
            "{number:>7} {:>8.2}° {:>12} {:>+9.3}° ±{:.3}° {:>+9.2} {:>+9.2}   {role}",
            contact.angle.to_degrees(),
            short(contact),
            contact.angle_error.to_degrees(),
            contact.angle_sigma.to_degrees(),
            residual.x,
            residual.y,
        )
    }
}

/// The load in a column.
fn short(contact: &ContactResult) -> String {
    match contact.load {
        palpate::finger::calibration::measurements::Load::Newtons(newtons) => format!("{newtons:.4} N"),
        other => other.to_string(),
    }
}

impl std::fmt::Display for Conclusion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        writeln!(f, "contact    angle         load  felt - set        residual, microstrain")?;
        for (index, contact) in self.fit.contacts.iter().enumerate() {
            self.write_contact(f, index + 1, contact)?;
        }
        let (unit, matrix) = (self.fit.calibration.unit(), self.fit.calibration.parts().matrix);
        let symbol = unit.symbol();
        writeln!(f, "matrix   x: {:+10.1} {:+10.1}   counts per {symbol}", matrix[(0, 0)], matrix[(0, 1)])?;
        writeln!(f, "         y: {:+10.1} {:+10.1}", matrix[(1, 0)], matrix[(1, 1)])?;
        if matrix.determinant() < 0.0 {
            // Data alone cannot tell the two apart: angles counted backwards fit a mirrored matrix exactly.
            writeln!(
                f,
                "         it mirrors: one bridge is reversed (harmless), or the angles were counted the wrong way"
            )?;
            writeln!(f, "         round: touch the disk at its 90° mark and see that it is felt at 90°")?;
        }
        if unit == ForceUnit::Relative {
            writeln!(f, "         no load was known, so force is relative; angles do not need newtons")?;
        }
        if let Some(weight) = self.fit.own_weight {
            writeln!(f, "own weight of disk and beam: bends like {weight:.3} {symbol} at the disk")?;
        }
        if let Some(drift) = drift_between_tares(&self.taken) {
            let drift = drift * self.front_end.microstrain_per_count();
            writeln!(
                f,
                "drift    ({:+.2}, {:+.2}) microstrain from the first tare to the last, taken off by time",
                drift.x, drift.y
            )?;
        }
        let quality = &self.fit.quality;
        writeln!(
            f,
            "fit      {:.1} degrees of freedom, reduced chi² {:.2}",
            quality.degrees_of_freedom, quality.reduced_chi2
        )?;
        let (sigma, at) = self.worst_direction_deg();
        writeln!(f, "leaves   at most {sigma:.3}° (1 sigma) in a contact angle, worst at {at:.0}°")?;
        match self.fit.held_back() {
            Some(held) => writeln!(
                f,
                "held back {}: worst {:+.3}° ± {:.3}° at {:.1}°, rms {:.3}°, mean {:+.3}°",
                held.contacts,
                held.worst_error.to_degrees(),
                held.worst_sigma.to_degrees(),
                held.worst_angle.to_degrees(),
                held.rms_error.to_degrees(),
                held.mean_error.to_degrees(),
            ),
            None => writeln!(f, "held back 0: nothing judges this calibration but its own residuals"),
        }
    }
}
