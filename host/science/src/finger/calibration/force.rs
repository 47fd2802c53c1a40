//! Counts to force: the finger's matrix, with the uncertainty that its calibration leaves.
//!
//! Strain model: `counts − tare = B · F` with `F` the force **on the finger's disk** in finger axes and `B` a 2×2
//! matrix in counts per newton (or per relative unit). `B` holds everything linear: unequal gains, gauges not square to
//! the axes, cross-talk. `F = A · (counts − tare)` with `A = B⁻¹`.
//!
//! Source: thesis §6.4 (four gauges on the beam's upper end measure the two components of the contact force).
//! Assumes: strain linear in force and all forces in the disk's plane. Bending of the default finger is below 100
//! microstrain per 2 N, far from where steel or gauges stop being linear.
//! Frames: finger (x and y of the disk as marked on it, z along the beam, origin at the disk's centre).
//! Units: newtons if a load was known, otherwise the calibration's own relative unit; radians; counts.
//! Errors: a calibration that cannot be inverted or has no proper covariance is refused when it is built.

use nalgebra::{Matrix2, Matrix2x4, Rotation2, SMatrix, Vector2, Vector4};
use thiserror::Error;

use super::zero_drift::ZeroDrift;
use crate::math::angle::{contact_angle, direction_variance};

/// Largest ratio of the matrix's singular values that still counts as two axes.
///
/// A finger with two equal, square bridges has 1. At 50 the two bridges measure directions within 2.3° of each other
/// (or one has a fiftieth of the other's gain): the weak direction is then mostly noise. Above it, refused.
pub const CONDITION_MAX: f64 = 50.0;

/// Covariance of `[b11, b12, b21, b22, offset_x, offset_y]`; counts² per unit², counts² per unit, counts².
pub type ParameterCovariance = SMatrix<f64, 6, 6>;

/// What a force is measured in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ForceUnit {
    /// At least one load of the calibration was known in newtons.
    Newton,
    /// No load was known: 1 is the load that contacts share or, if none do, the mean load of the fitted contacts.
    Relative,
}

impl ForceUnit {
    /// How it is written after a number.
    #[must_use]
    pub fn symbol(self) -> &'static str {
        match self {
            Self::Newton => "N",
            Self::Relative => "rel",
        }
    }
}

/// Mean counts of both bridges over a stretch of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DwellReading {
    /// Mean (x, y), counts.
    pub counts: Vector2<f64>,
    /// Covariance of that mean (not of one sample), counts².
    pub covariance: Matrix2<f64>,
}

/// The reading with nothing touching the disk. A type of its own: a loaded reading in its place would look plausible.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DwellTare(pub DwellReading);

/// Force on the finger's disk with its uncertainty, split by cause because only one part shrinks by averaging.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Force {
    /// Force on the disk in finger axes, in [`Force::unit`].
    pub force_finger: Vector2<f64>,
    /// Unit of the force.
    pub unit: ForceUnit,
    /// Covariance from the noise of the reading and of the tare, unit².
    pub noise: Matrix2<f64>,
    /// Covariance from what the calibration left open, unit²; the same error in every reading.
    pub systematic: Matrix2<f64>,
}

impl Force {
    /// Contact angle `u` that this force means without friction, in `(-π, π]`, and its variance in rad² (both causes).
    #[must_use]
    pub fn contact_angle(&self) -> (f64, f64) {
        let variance = direction_variance(self.force_finger, &(self.noise + self.systematic));
        (contact_angle(self.force_finger), variance)
    }
}

/// A finger's matrix as it is used: checked, with its inverse at hand.
///
/// ```
/// use nalgebra::{Matrix2, Vector2};
/// use palpate::finger::calibration::{CalibrationContact, DwellReading, DwellTare, FitSettings, Fixture, Load, Measurements, fit};
///
/// let reading = |x: f64, y: f64| DwellReading { counts: Vector2::new(x, y), covariance: Matrix2::identity() * 36.0 };
/// let contact = |degrees: f64| {
///     let (sin, cos) = degrees.to_radians().sin_cos();
///     let reading = reading(-53_400.0 * cos, -53_400.0 * sin); // 2 N at 26 700 counts/N
///     CalibrationContact { angle: degrees.to_radians(), load: Load::Newtons(2.0), reading, tare: None }
/// };
/// let contacts = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0].map(contact).to_vec();
/// let tare = DwellTare(reading(0.0, 0.0));
/// let settings = FitSettings { fixture: Fixture::of_a_dividing_head(0.001_79), held_back_every: 0 };
/// let calibration = fit(&Measurements { contacts, tares: vec![tare] }, &settings)?.calibration;
/// let force = calibration.force(&reading(26_700.0, 0.0), &tare);
/// assert!((force.force_finger - Vector2::new(1.0, 0.0)).norm() < 1e-6); // N
/// # Ok::<(), palpate::finger::calibration::FitError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Calibration {
    parts: CalibrationParts,
    inverse: Matrix2<f64>,
    zero_drift: Option<ZeroDrift>,
}

/// The numbers of a [`Calibration`], unchecked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationParts {
    /// Unit of force in which the other fields are.
    pub unit: ForceUnit,
    /// `B`: counts per unit of force, rows x and y bridge, columns x and y force.
    pub matrix: Matrix2<f64>,
    /// Unloaded reading when it was calibrated, counts. A later tare far from it means a bent beam or a torn gauge.
    pub offset: Vector2<f64>,
    /// Covariance of matrix and offset together.
    pub covariance: ParameterCovariance,
}

/// Why numbers do not make a calibration.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum CalibrationError {
    /// A number is infinite or not a number.
    #[error("the {0} holds a number that is not finite")]
    NotFinite(&'static str),
    /// The two bridges measure almost the same direction.
    #[error(
        "the matrix has condition number {condition:.0} (limit {CONDITION_MAX}): both bridges measure nearly the same direction"
    )]
    NotTwoAxes {
        /// Largest over smallest singular value; infinite for a singular matrix.
        condition: f64,
    },
    /// The covariance is not symmetric or has an eigenvalue that is not above zero.
    #[error("the covariance of the calibration is not symmetric and positive definite")]
    Covariance,
}

impl Calibration {
    /// Checks the numbers once; every later conversion is then finite.
    ///
    /// # Errors
    /// Numbers that are not finite, a matrix of one axis, a covariance that is none.
    pub fn new(parts: CalibrationParts) -> Result<Self, CalibrationError> {
        check_finite(&parts)?;
        let condition = condition_number(&parts.matrix);
        let inverse = parts.matrix.try_inverse().filter(|_| condition <= CONDITION_MAX);
        let inverse = inverse.ok_or(CalibrationError::NotTwoAxes { condition })?;
        if !is_covariance(&parts.covariance) {
            return Err(CalibrationError::Covariance);
        }
        Ok(Self { parts, inverse, zero_drift: None })
    }

    /// The same for forces along axes of which x lies at this angle in the finger's, rad: those of the robot that carries it.
    #[must_use]
    pub fn mounted(&self, mounting: f64) -> Self {
        // F_finger = R F, hence B R; its rows turn with it, and the offset is in counts.
        let turn = *Rotation2::new(mounting).matrix();
        let mut by = ParameterCovariance::identity();
        [0, 2].into_iter().for_each(|row| by.fixed_view_mut::<2, 2>(row, row).copy_from(&turn.transpose()));
        let covariance = by * self.parts.covariance * by.transpose();
        let parts = CalibrationParts { matrix: self.parts.matrix * turn, covariance, ..self.parts };
        Self { parts, inverse: turn.transpose() * self.inverse, zero_drift: self.zero_drift }
    }

    /// The same with a scale that is uncertain too, by this share (standard deviation): all gauges drift alike.
    #[must_use]
    pub fn with_scale_sd(&self, share: f64) -> Self {
        let matrix = &self.parts.matrix;
        let entries = Vector4::new(matrix[(0, 0)], matrix[(0, 1)], matrix[(1, 0)], matrix[(1, 1)]) * share;
        let mut parts = self.parts;
        let mut block = parts.covariance.fixed_view_mut::<4, 4>(0, 0);
        block += entries * entries.transpose();
        Self { parts, inverse: self.inverse, zero_drift: self.zero_drift }
    }

    /// The same, knowing how its reading without load goes with temperature, or not.
    #[must_use]
    pub fn with_zero_drift(self, zero_drift: Option<ZeroDrift>) -> Self {
        Self { zero_drift, ..self }
    }

    /// How its reading without load goes with temperature, where that is known.
    #[must_use]
    pub fn zero_drift(&self) -> Option<&ZeroDrift> {
        self.zero_drift.as_ref()
    }

    /// The numbers it was built from.
    #[must_use]
    pub fn parts(&self) -> &CalibrationParts {
        &self.parts
    }

    /// Unit of the forces it gives.
    #[must_use]
    pub fn unit(&self) -> ForceUnit {
        self.parts.unit
    }

    /// `A = B⁻¹`: unit of force per count.
    #[must_use]
    pub fn inverse(&self) -> &Matrix2<f64> {
        &self.inverse
    }

    /// Force on the disk in finger axes from one sample or mean, both in counts: no uncertainty, for every sample.
    #[must_use]
    pub fn force_finger(&self, counts: Vector2<f64>, tare: &DwellTare) -> Vector2<f64> {
        self.inverse * (counts - tare.0.counts)
    }

    /// Force on the disk with the uncertainty from noise, tare and calibration.
    #[must_use]
    pub fn force(&self, reading: &DwellReading, tare: &DwellTare) -> Force {
        let force_finger = self.force_finger(reading.counts, tare);
        let noise = self.inverse * (reading.covariance + tare.0.covariance) * self.inverse.transpose();
        Force { force_finger, unit: self.parts.unit, noise, systematic: self.systematic(force_finger) }
    }

    /// Covariance of a force due to what the calibration left open, unit²: `δF = −A δB F` for counts held fixed.
    #[must_use]
    pub fn systematic(&self, force_finger: Vector2<f64>) -> Matrix2<f64> {
        let (x, y) = (force_finger.x, force_finger.y);
        let counts_by_matrix = Matrix2x4::new(x, y, 0.0, 0.0, 0.0, 0.0, x, y);
        let jacobian = -self.inverse * counts_by_matrix;
        jacobian * self.parts.covariance.fixed_view::<4, 4>(0, 0) * jacobian.transpose()
    }

    /// Variance of the contact angle due to the calibration alone, rad²; depends on the direction, not on the size.
    #[must_use]
    pub fn direction_variance(&self, force_finger: Vector2<f64>) -> f64 {
        direction_variance(force_finger, &self.systematic(force_finger))
    }

    /// The offset it was calibrated with, as a tare: only for where nobody can take a fresh one.
    #[must_use]
    pub fn offset_as_tare(&self) -> DwellTare {
        let covariance = self.parts.covariance.fixed_view::<2, 2>(4, 4).into_owned();
        DwellTare(DwellReading { counts: self.parts.offset, covariance })
    }
}

fn check_finite(parts: &CalibrationParts) -> Result<(), CalibrationError> {
    let finite = |mut numbers: std::slice::Iter<'_, f64>| numbers.all(|number| number.is_finite());
    let groups = [
        ("matrix", finite(parts.matrix.as_slice().iter())),
        ("offset", finite(parts.offset.as_slice().iter())),
        ("covariance", finite(parts.covariance.as_slice().iter())),
    ];
    match groups.iter().find(|(_, finite)| !finite) {
        Some((name, _)) => Err(CalibrationError::NotFinite(name)),
        None => Ok(()),
    }
}

/// Largest over smallest singular value; infinite for a singular matrix.
fn condition_number(matrix: &Matrix2<f64>) -> f64 {
    let values = matrix.singular_values();
    if values.min() > 0.0 { values.max() / values.min() } else { f64::INFINITY }
}

/// Relative difference of mirrored entries that rounding explains; a typing error is larger.
const SYMMETRY: f64 = 1e-9;

/// Whether a matrix is symmetric and positive definite, judged after scaling each variance to 1.
///
/// The parameters' units differ (counts per newton, counts), so without the scaling the factorisation would judge the
/// units instead of the data.
fn is_covariance(covariance: &ParameterCovariance) -> bool {
    let sigmas = covariance.diagonal().map(f64::sqrt);
    if !sigmas.iter().all(|&sigma| sigma.is_finite() && sigma > 0.0) {
        return false;
    }
    let correlation =
        ParameterCovariance::from_fn(|row, column| covariance[(row, column)] / (sigmas[row] * sigmas[column]));
    let symmetric = (correlation - correlation.transpose()).amax() <= SYMMETRY;
    symmetric && correlation.cholesky().is_some()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::math::angle::{push_direction, wrap_angle};

    fn parts(matrix: Matrix2<f64>) -> CalibrationParts {
        let sigmas = SMatrix::<f64, 6, 1>::from([20.0, 10.0, 15.0, 25.0, 3.0, 4.0]);
        let covariance = ParameterCovariance::from_diagonal(&sigmas.component_mul(&sigmas));
        CalibrationParts { unit: ForceUnit::Newton, matrix, offset: Vector2::new(100.0, -200.0), covariance }
    }

    fn default_matrix() -> Matrix2<f64> {
        Matrix2::new(26_700.0, -900.0, 1_400.0, 25_000.0)
    }

    const NO_TARE: DwellTare =
        DwellTare(DwellReading { counts: Vector2::new(0.0, 0.0), covariance: Matrix2::new(0.0, 0.0, 0.0, 0.0) });

    #[test]
    fn a_contact_on_the_right_pushes_left() {
        assert!((push_direction(0.0) - Vector2::new(-1.0, 0.0)).norm() < 1e-15);
        assert!((push_direction(std::f64::consts::FRAC_PI_2) - Vector2::new(0.0, -1.0)).norm() < 1e-15);
    }

    #[test]
    fn the_angle_opposite_to_zero_is_plus_pi() {
        let angle = contact_angle(Vector2::new(1.0, 0.0));
        assert!((angle - std::f64::consts::PI).abs() < 1e-15, "got {angle}");
        assert!((wrap_angle(-std::f64::consts::PI) - std::f64::consts::PI).abs() < 1e-15);
    }

    #[test]
    fn a_matrix_of_one_axis_is_refused() {
        let error = Calibration::new(parts(Matrix2::new(1.0, 1.0, 1.0, 1.001))).unwrap_err();
        assert!(matches!(error, CalibrationError::NotTwoAxes { condition } if condition > CONDITION_MAX), "{error}");
        assert!(Calibration::new(parts(Matrix2::zeros())).is_err());
    }

    #[test]
    fn a_covariance_that_is_none_is_refused() {
        let mut negative = parts(default_matrix());
        negative.covariance[(2, 2)] = -1.0;
        assert_eq!(Calibration::new(negative), Err(CalibrationError::Covariance));
        let mut lopsided = parts(default_matrix());
        lopsided.covariance[(0, 1)] = 30.0;
        assert_eq!(Calibration::new(lopsided), Err(CalibrationError::Covariance));
        let mut infinite = parts(default_matrix());
        infinite.covariance[(0, 1)] = f64::INFINITY;
        assert_eq!(Calibration::new(infinite), Err(CalibrationError::NotFinite("covariance")));
    }

    proptest! {
        #[test]
        fn counts_of_a_force_give_the_force_back(x in -10.0..10.0, y in -10.0..10.0) {
            let calibration = Calibration::new(parts(default_matrix())).unwrap();
            let force = Vector2::new(x, y);
            let back = calibration.force_finger(default_matrix() * force, &NO_TARE);
            prop_assert!((back - force).norm() < 1e-12, "got {back}, wanted {force}");
        }

        /// Counts of a force say the same force along turned axes, and its covariance turns with it.
        #[test]
        fn a_mounted_calibration_gives_forces_along_the_robots_axes(x in -9.0..9.0, y in -9.0..9.0, mounting in -3.1..3.1_f64) {
            let calibration = Calibration::new(parts(default_matrix())).unwrap();
            let mounted = calibration.mounted(mounting);
            let (force, turn) = (Vector2::new(x, y), Rotation2::new(-mounting));
            let counts = default_matrix() * force;
            let along = mounted.force_finger(counts, &NO_TARE);
            prop_assert!((along - turn * force).norm() < 1e-12, "{along}");
            let (own, turned) = (calibration.systematic(force), mounted.systematic(along));
            let wanted = turn.matrix() * own * turn.matrix().transpose();
            prop_assert!((turned - wanted).amax() <= 1e-12 * own.amax(), "{turned} {wanted}");
            prop_assert!(Calibration::new(*mounted.parts()).is_ok());
        }

        /// A scale that drifts makes the force longer or shorter, and does not turn it.
        #[test]
        fn an_uncertain_scale_is_one_along_the_force(x in 0.5..9.0, y in -9.0..9.0) {
            let calibration = Calibration::new(parts(default_matrix())).unwrap();
            let force = Vector2::new(x, y);
            let more = calibration.with_scale_sd(0.01).systematic(force) - calibration.systematic(force);
            prop_assert!((more - force * force.transpose() * 1e-4).amax() < 1e-9, "{more}");
        }

        #[test]
        fn the_angle_of_a_push_is_where_it_came_from(u in -3.1..3.1_f64, load in 0.01..50.0) {
            prop_assert!(wrap_angle(contact_angle(push_direction(u) * load) - u).abs() < 1e-12);
        }

        /// Finite differences of the inversion itself, one parameter at a time, against the propagated variance.
        #[test]
        fn the_direction_variance_is_that_of_perturbed_matrices(u in -3.1..3.1_f64, load in 0.1..10.0) {
            let calibration = Calibration::new(parts(default_matrix())).unwrap();
            let force = push_direction(u) * load;
            let counts = default_matrix() * force;
            let mut variance = 0.0;
            for (index, sigma) in [20.0, 10.0, 15.0, 25.0].into_iter().enumerate() {
                let angle_with = |step: f64| {
                    let mut matrix = default_matrix();
                    matrix[(index / 2, index % 2)] += step;
                    contact_angle(matrix.try_inverse().unwrap() * counts)
                };
                variance += (wrap_angle(angle_with(sigma) - angle_with(-sigma)) / 2.0).powi(2);
            }
            let got = calibration.direction_variance(force);
            prop_assert!((got / variance - 1.0).abs() < 1e-4, "got {got}, wanted {variance} rad²");
        }
    }
}
