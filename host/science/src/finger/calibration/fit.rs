//! The finger's matrix from contacts at known angles, known loads or both: what is refused, fitted and reported.
//!
//! Checks the contacts, holds some back, fits the matrix to the rest by robust least squares (`least_squares.rs`), and
//! compares every contact with the result.
//!
//! Frames: finger. Units: rad, newtons (or relative), counts.
//! Errors: [`FitError`]; data that cannot tell the matrix are refused with what to add.

use nalgebra::{Matrix2, Matrix6, Vector2};
use thiserror::Error;

use super::force::{Calibration, CalibrationError, CalibrationParts, DwellReading, DwellTare, Force};
use super::held_back;
use super::least_squares::{Problem, STEPS_MAX, Solution, solve};
use super::measurements::{CalibrationContact, Fixture, Load, Measurements};
use super::offset;
use super::span::{self, SPAN_MAX};
use crate::math::angle::{contact_angle, direction_variance, push_direction, wrap_angle};
use crate::math::statistics::median;

/// Fewest contacts the matrix is fitted to: one more than three directions determine, so that the fit checks itself.
pub const FITTED_MIN: usize = 4;

/// Largest standard deviation that noise may give the direction of one contact, rad (0.1°, half the bar for a mean).
pub const CONTACT_ANGLE_SIGMA_MAX: f64 = 0.1 * std::f64::consts::PI / 180.0;

/// What the fit is told besides the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FitSettings {
    /// Trust in the fixture.
    pub fixture: Fixture,
    /// Every how many different angles one is held back from the fit to judge it; 0 for none.
    pub held_back_every: usize,
}

/// What the fit found.
#[derive(Clone, Debug, PartialEq)]
pub struct CalibrationFit {
    /// The matrix, ready for use.
    pub calibration: Calibration,
    /// How well the fitted contacts agree.
    pub quality: Quality,
    /// One result for each contact, in the order given.
    pub contacts: Vec<ContactResult>,
    /// Force with which the finger's own weight bends it when it lies in the dividing head, in the unit of force.
    ///
    /// Known only where contacts have their own tares at different angles; near zero for an upright finger.
    pub own_weight: Option<f64>,
}

/// Agreement of the fitted contacts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Quality {
    /// Degrees of freedom left: weighted measured components minus unknowns. Below 1 the fit cannot check itself.
    pub degrees_of_freedom: f64,
    /// χ² over degrees of freedom; the covariance is multiplied by it where it exceeds 1.
    pub reduced_chi2: f64,
    /// How much larger than noise and fixture explain the typical misfit is; 1 where they explain it.
    pub robust_scale: f64,
    /// Steps until it converged.
    pub steps: usize,
}

/// What became of a contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Role {
    /// The matrix was fitted to it, with this weight between 0 and 1. Below 1 it is an outlier and is reported.
    Fitted {
        /// Weight in the robust fit, from 0 for a contact that is left out to 1 for one that agrees.
        weight: f64,
    },
    /// It was kept out of the fit and judges it.
    HeldBack,
}

/// How one contact agrees with the matrix.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactResult {
    /// Angle it was set to, rad.
    pub angle: f64,
    /// What was known of its load.
    pub load: Load,
    /// Whether it was fitted or held back.
    pub role: Role,
    /// Force on the finger that the matrix finds, in finger axes.
    pub force_finger: Vector2<f64>,
    /// Felt angle minus the angle it was set to, rad in (−π, π].
    pub angle_error: f64,
    /// What noise, drift and fixture (and, if held back, the calibration) let one expect of that error, 1 σ, rad.
    pub angle_sigma: f64,
    /// Counts that the matrix does not explain.
    pub residual_counts: Vector2<f64>,
    /// Distance of the contact from the matrix in standard deviations of noise and fixture (times the robust scale).
    pub sigmas: f64,
}

impl ContactResult {
    /// Whether the robust weights turned it down.
    #[must_use]
    pub fn is_outlier(&self) -> bool {
        matches!(self.role, Role::Fitted { weight } if weight < 1.0)
    }
}

/// Why contacts do not give a matrix. Contacts are numbered from 1 in the order given.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum FitError {
    /// Neither a tare of its own nor one for the session.
    #[error(
        "contact {contact} at {angle_deg:.1}° has no tare: no unloaded reading at its position, and none for the whole run"
    )]
    NoTare {
        /// Number of the contact.
        contact: usize,
        /// Contact angle that was set, degrees.
        angle_deg: f64,
    },
    /// Fewer contacts than a matrix needs.
    #[error("{fitted} contacts to fit the matrix to, at least {FITTED_MIN} are needed")]
    TooFew {
        /// Contacts to fit the matrix to.
        fitted: usize,
    },
    /// The directions leave part of the matrix open.
    #[error(
        "the contacts push along {lines} line(s) through the disk's centre, which leaves contact angles near {worst_deg:.0}° {} (limit {SPAN_MAX})",
        how_uncertain(*worst)
    )]
    DoesNotSpan {
        /// Different lines through the disk's centre that the contacts push along.
        lines: usize,
        /// Where it is worst.
        worst_deg: f64,
        /// Uncertainty there over that of one contact.
        worst: f64,
        /// Angles to add, as text.
        add: String,
    },
    /// A number that cannot be.
    #[error("contact {contact} at {angle_deg:.1}° has {what}")]
    BadContact {
        /// Number of the contact.
        contact: usize,
        /// Contact angle that was set, degrees.
        angle_deg: f64,
        /// What is wrong with it.
        what: String,
    },
    /// A bridge at the end of its range.
    #[error("contact {contact} at {angle_deg:.1}° has a saturated bridge (|counts| ≥ 8388607)")]
    Saturated {
        /// Number of the contact.
        contact: usize,
        /// Contact angle that was set, degrees.
        angle_deg: f64,
    },
    /// Too little load for its direction to show.
    #[error(
        "contact {contact} at {angle_deg:.1}° is too weak: noise and drift leave its direction uncertain by {sigma_deg:.2}° (limit {limit_deg:.2}°)",
        limit_deg = CONTACT_ANGLE_SIGMA_MAX.to_degrees()
    )]
    LoadTooSmall {
        /// Number of the contact.
        contact: usize,
        /// Contact angle that was set, degrees.
        angle_deg: f64,
        /// Standard deviation of its direction.
        sigma_deg: f64,
        /// By what to multiply the load.
        factor: f64,
        /// The load needed in newtons, if the present one is known.
        needed: Option<f64>,
    },
    /// No two or three contacts determine a matrix.
    #[error("no two axes show in the counts: the contacts change both bridges in the same proportion")]
    NoTwoAxes,
    /// So many outliers that the rest no longer spans.
    #[error(
        "{outliers} of {fitted} contacts disagree with the others (contacts {named}), and the others are not enough alone"
    )]
    Disagree {
        /// How many were turned down.
        outliers: usize,
        /// Contacts fitted, those turned down included.
        fitted: usize,
        /// Their numbers, as text.
        named: String,
    },
    /// The steps did not come to rest.
    #[error("the fit did not come to rest in {STEPS_MAX} steps (last step {last_step:.1e})")]
    NotConverged {
        /// Largest change of a parameter in the last step, relative.
        last_step: f64,
    },
    /// The matrix found is not usable.
    #[error("the contacts give no usable matrix")]
    Unusable(#[from] CalibrationError),
}

/// A number of times, or that there is none.
fn how_uncertain(times: f64) -> String {
    if times.is_finite() {
        format!("{times:.1} times as uncertain as one contact")
    } else {
        "altogether open".to_owned()
    }
}

/// Finds the finger's matrix.
///
/// # Errors
/// [`FitError`] says which contact or which missing angle is the reason.
///
/// ```
/// use nalgebra::{Matrix2, Vector2};
/// use palpate::finger::calibration::{CalibrationContact, FitSettings, Fixture, Load, Measurements, DwellReading, DwellTare, fit};
///
/// // A finger of 26 700 counts/N on both axes, loaded with 2 N at six angles.
/// let reading = |x: f64, y: f64| DwellReading { counts: Vector2::new(x, y), covariance: Matrix2::identity() * 36.0 };
/// let contact = |degrees: f64| {
///     let (sin, cos) = degrees.to_radians().sin_cos();
///     let reading = reading(-53_400.0 * cos, -53_400.0 * sin);
///     CalibrationContact { angle: degrees.to_radians(), load: Load::Newtons(2.0), reading, tare: None }
/// };
/// let contacts = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0].map(contact).to_vec();
/// let measurements = Measurements { contacts, tares: vec![DwellTare(reading(0.0, 0.0))] };
/// let settings = FitSettings { fixture: Fixture::of_a_dividing_head(0.00179), held_back_every: 0 };
/// let calibration = fit(&measurements, &settings)?.calibration;
/// let force = calibration.force(&reading(0.0, 26_700.0), &DwellTare(reading(0.0, 0.0)));
/// let (u, variance) = force.contact_angle();
/// assert!((force.force_finger - Vector2::new(0.0, 1.0)).norm() < 1e-6);
/// assert!((u.to_degrees() + 90.0).abs() < 1e-6, "pushed up from below");
/// assert!(variance.sqrt().to_degrees() < 0.1);
/// # Ok::<(), palpate::finger::calibration::FitError>(())
/// ```
pub fn fit(measurements: &Measurements, settings: &FitSettings) -> Result<CalibrationFit, FitError> {
    check_contacts(measurements, &settings.fixture)?;
    let held_back = held_back::choose(&measurements.contacts, settings.held_back_every);
    check_span(&fitted_directions(measurements, &held_back))?;
    let problem = Problem::new(measurements, &held_back, &settings.fixture);
    let solution = solve(&problem)?;
    check_outliers(measurements, &solution)?;
    let (calibration, own_weight) = calibration_of(measurements, &problem, &solution, &settings.fixture)?;
    let comparison =
        Comparison { calibration: &calibration, problem: &problem, solution: &solution, fixture: &settings.fixture };
    let contacts =
        measurements.contacts.iter().enumerate().map(|(index, contact)| comparison.result(index, contact)).collect();
    Ok(CalibrationFit { calibration, quality: solution.quality, contacts, own_weight })
}

fn check_contacts(measurements: &Measurements, fixture: &Fixture) -> Result<(), FitError> {
    for (index, contact) in measurements.contacts.iter().enumerate() {
        check_contact(index + 1, contact, fixture, !measurements.tares.is_empty())?;
    }
    // The weakness of a load shows only against its tare, which the checks above have made sure of.
    let typical = median(measurements.contacts.iter().map(|contact| measurements.loaded_counts(contact).norm()));
    for (index, contact) in measurements.contacts.iter().enumerate() {
        check_strength(index + 1, contact, measurements, fixture, typical.unwrap_or(0.0))?;
    }
    Ok(())
}

fn check_contact(
    number: usize,
    contact: &CalibrationContact,
    fixture: &Fixture,
    common_tare: bool,
) -> Result<(), FitError> {
    let angle_deg = contact.angle.to_degrees();
    let bad = |what: &str| Err(FitError::BadContact { contact: number, angle_deg, what: what.to_owned() });
    if !contact.angle.is_finite()
        || !is_plausible(&contact.reading)
        || contact.tare.is_some_and(|tare| !is_plausible(&tare.0))
    {
        return bad("a number that is not finite, or a negative variance");
    }
    if matches!(contact.load, Load::Newtons(newtons) if !(newtons.is_finite() && newtons > 0.0)) {
        return bad("a load that is not above 0 N");
    }
    if contact.tare.is_none() && !common_tare {
        return Err(FitError::NoTare { contact: number, angle_deg });
    }
    let fixture_is_sound = [fixture.angle_sigma, fixture.load_sigma, fixture.drift_sigma]
        .iter()
        .all(|sigma| sigma.is_finite() && *sigma >= 0.0);
    assert!(fixture_is_sound, "a fixture's standard deviations are finite and not negative: {fixture:?}");
    let limit = f64::from(palpate_shared::units::Counts::MAX.0);
    if contact.reading.counts.amax() >= limit {
        return Err(FitError::Saturated { contact: number, angle_deg });
    }
    Ok(())
}

fn is_plausible(reading: &DwellReading) -> bool {
    let finite = reading.counts.iter().chain(reading.covariance.iter()).all(|number| number.is_finite());
    finite && reading.covariance.diagonal().min() >= 0.0
}

/// Refuses a contact whose noise and drift turn it by more than the limit.
///
/// `typical` is the middle size of all contacts in counts: a contact that is small because its weight fell off is an
/// outlier, but a session of weak contacts needs more load.
fn check_strength(
    number: usize,
    contact: &CalibrationContact,
    all: &Measurements,
    fixture: &Fixture,
    typical: f64,
) -> Result<(), FitError> {
    let counts = all.loaded_counts(contact);
    let size = counts.norm().max(typical);
    let direction = counts.try_normalize(0.0).unwrap_or_else(Vector2::x);
    let tare_noise = contact.tare.map_or_else(Matrix2::zeros, |tare| tare.0.covariance);
    let noise = contact.reading.covariance + tare_noise + Matrix2::identity() * fixture.drift_sigma.powi(2);
    let sigma = direction_variance(direction * size, &noise).sqrt();
    if sigma <= CONTACT_ANGLE_SIGMA_MAX {
        return Ok(());
    }
    let factor = sigma / CONTACT_ANGLE_SIGMA_MAX;
    let needed = if let Load::Newtons(newtons) = contact.load { Some(newtons * factor) } else { None };
    let angle_deg = contact.angle.to_degrees();
    Err(FitError::LoadTooSmall { contact: number, angle_deg, sigma_deg: sigma.to_degrees(), factor, needed })
}

/// Directions of the contacts that are not held back.
fn fitted_directions(measurements: &Measurements, held_back: &[bool]) -> Vec<(f64, Load)> {
    let fitted = measurements.contacts.iter().zip(held_back).filter(|(_, held)| !**held);
    fitted.map(|(contact, _)| (contact.angle, contact.load)).collect()
}

fn check_span(directions: &[(f64, Load)]) -> Result<(), FitError> {
    let span = span::span(directions);
    if !span.is_enough() {
        let add = angles_text(&span::angles_to_add(directions));
        return Err(FitError::DoesNotSpan {
            lines: span.lines,
            worst_deg: span.worst_angle.to_degrees(),
            worst: span.worst,
            add,
        });
    }
    if directions.len() < FITTED_MIN {
        return Err(FitError::TooFew { fitted: directions.len() });
    }
    Ok(())
}

/// The angles (rad) as text in degrees: "45°, 135°".
fn angles_text(angles: &[f64]) -> String {
    let texts: Vec<String> = angles.iter().map(|angle| format!("{:.0}°", angle.to_degrees())).collect();
    texts.join(", ")
}

/// Contacts that count at least half must span without the others.
fn check_outliers(measurements: &Measurements, solution: &Solution) -> Result<(), FitError> {
    let fitted: Vec<(usize, f64)> =
        solution.weights.iter().enumerate().filter_map(|(index, weight)| Some((index, (*weight)?))).collect();
    let counting: Vec<usize> = fitted.iter().filter(|(_, weight)| *weight >= 0.5).map(|(index, _)| *index).collect();
    let directions: Vec<(f64, Load)> =
        counting.iter().map(|&index| (measurements.contacts[index].angle, measurements.contacts[index].load)).collect();
    if span::span(&directions).is_enough() && counting.len() >= FITTED_MIN.min(fitted.len()) {
        return Ok(());
    }
    let named: Vec<String> =
        fitted.iter().filter(|(_, weight)| *weight < 0.5).map(|(index, _)| (index + 1).to_string()).collect();
    Err(FitError::Disagree { outliers: named.len(), fitted: fitted.len(), named: named.join(", ") })
}

/// Back to counts and newtons; the offset from the tares at each position where the fit has none of its own.
fn calibration_of(
    measurements: &Measurements,
    problem: &Problem,
    solution: &Solution,
    fixture: &Fixture,
) -> Result<(Calibration, Option<f64>), FitError> {
    let per_load = problem.counts_scale / problem.load_scale;
    let matrix = solution.unknowns.matrix * per_load;
    let mut units = Matrix6::identity() * per_load;
    units.view_mut((4, 4), (2, 2)).fill_diagonal(problem.counts_scale);
    let mut covariance = units * solution.covariance * units;
    let own = offset::from_own_tares(&measurements.contacts, &matrix, fixture);
    let offset = if problem.has_offset {
        problem.reference_offset + solution.unknowns.offset * problem.counts_scale
    } else {
        covariance.view_mut((4, 4), (2, 2)).copy_from(&own.covariance);
        own.offset
    };
    let calibration = Calibration::new(CalibrationParts { unit: problem.unit, matrix, offset, covariance })?;
    Ok((calibration, own.weight))
}

/// Compares every contact, fitted or held back, with the finished calibration.
struct Comparison<'a> {
    calibration: &'a Calibration,
    problem: &'a Problem,
    solution: &'a Solution,
    fixture: &'a Fixture,
}

impl Comparison<'_> {
    fn result(&self, index: usize, contact: &CalibrationContact) -> ContactResult {
        let tare = contact.tare.unwrap_or_else(|| self.calibration.offset_as_tare());
        let force = self.calibration.force(&contact.reading, &tare);
        let role = self
            .solution
            .weights
            .get(index)
            .copied()
            .flatten()
            .map_or(Role::HeldBack, |weight| Role::Fitted { weight });
        let angle_sigma = self.angle_sigma(&force, role);
        let angle_error = wrap_angle(contact_angle(force.force_finger) - contact.angle);
        let fitted_sigmas = self.solution.sigmas.get(index).copied().flatten();
        ContactResult {
            angle: contact.angle,
            load: contact.load,
            role,
            force_finger: force.force_finger,
            angle_error,
            angle_sigma,
            residual_counts: self.residual_counts(contact, &force, &tare),
            sigmas: fitted_sigmas.unwrap_or(angle_error.abs() / angle_sigma),
        }
    }

    fn angle_sigma(&self, force: &Force, role: Role) -> f64 {
        let inverse = self.calibration.inverse();
        let drift = inverse * inverse.transpose() * self.fixture.drift_sigma.powi(2);
        let systematic = if role == Role::HeldBack { force.systematic } else { Matrix2::zeros() };
        let reading = direction_variance(force.force_finger, &(force.noise + drift + systematic));
        (reading + self.fixture.angle_sigma.powi(2)).sqrt()
    }

    fn residual_counts(&self, contact: &CalibrationContact, force: &Force, tare: &DwellTare) -> Vector2<f64> {
        let direction = push_direction(contact.angle);
        let felt = || direction.dot(&force.force_finger).max(0.0);
        let size = match contact.load {
            Load::Newtons(newtons) => newtons,
            Load::Same => self.solution.shared_load(self.problem).unwrap_or_else(felt),
            Load::Unknown => felt(),
        };
        contact.reading.counts - tare.0.counts - self.calibration.parts().matrix * direction * size
    }
}
