//! The force that was felt over a push, window by window, with everything that is uncertain about it.
//!
//! Noise is independent between samples, hence nearly so between windows. The rest is common to all windows: the tare's
//! bias, what the calibration left open (four numbers of the finger's matrix) and the moment of the onset. Together
//! they are one covariance of all windows, and what is compared is whitened by it.
//!
//! Frames: finger axes; force is the force on the finger's disk. Units: SI, or the calibration's relative unit of
//! force.
//! Errors: [`WindowedForce::new`] gives none where there is nothing to compare.

use nalgebra::{DMatrix, DVector, Matrix2, Matrix2x4, Matrix4, Vector2};

use super::hann_windows::{HOP_S, NEIGHBOUR_CORRELATION};

/// What a prediction may be off by, as a share of the force: sums over windows up to 9e-4 where the force bends (see
/// the tests of `path`) and typically a fifth of that, the disk's ringing, which a window lets through by 8e-4 at
/// first.
const MODEL_SHARE: f64 = 4e-4;

/// How uncertain the windows' means are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uncertainty {
    /// Covariance of one window's mean by noise, N².
    pub noise: Matrix2<f64>,
    /// Covariance of the bias that was taken off, N².
    pub bias: Matrix2<f64>,
    /// What the calibration left open, if it is known.
    pub calibration: Option<CalibrationUncertainty>,
    /// Standard deviation of the moment of the onset, s.
    pub onset_sd: f64,
}

/// The finger's matrix and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CalibrationUncertainty {
    /// A = B⁻¹, N per count.
    pub inverse: Matrix2<f64>,
    /// Covariance of B's entries, row by row, counts² per N².
    pub covariance: Matrix4<f64>,
}

/// Means of the force under the windows, and what whitens them.
#[derive(Clone, Debug)]
pub struct WindowedForce {
    forces_finger: Vec<Vector2<f64>>,
    /// The means times L⁻¹, in standard deviations.
    data: DVector<f64>,
    /// Lower triangle L⁻¹ of the covariance L Lᵀ.
    whitener: DMatrix<f64>,
}

impl WindowedForce {
    /// From the means of the windows, tared, of a contact that began at time 0.
    ///
    /// None without a window, or where the covariance is none.
    #[must_use]
    pub fn new(forces_finger: Vec<Vector2<f64>>, uncertainty: &Uncertainty) -> Option<Self> {
        if forces_finger.is_empty() || forces_finger.iter().any(|force| !force.iter().all(|value| value.is_finite())) {
            return None;
        }
        let lower = covariance(&forces_finger, uncertainty).cholesky()?.unpack();
        let size = lower.nrows();
        let whitener = lower.solve_lower_triangular(&DMatrix::identity(size, size))?;
        let data = &whitener * stacked(forces_finger.iter().copied(), size);
        Some(Self { forces_finger, data, whitener })
    }

    /// The means, N.
    #[must_use]
    pub fn forces_finger(&self) -> &[Vector2<f64>] {
        &self.forces_finger
    }

    /// How many windows there are.
    #[must_use]
    pub fn count(&self) -> usize {
        self.forces_finger.len()
    }

    /// The means times L⁻¹, in standard deviations.
    pub(super) fn data(&self) -> &DVector<f64> {
        &self.data
    }

    /// Predicted means (N) times L⁻¹, in standard deviations.
    pub(super) fn whiten(&self, forces: impl Iterator<Item = Vector2<f64>>) -> DVector<f64> {
        let plain = stacked(forces, self.data.len());
        let rows =
            (0..plain.len()).map(|row| self.whitener.view((row, 0), (1, row + 1)).tr_dot(&plain.rows(0, row + 1)));
        DVector::from_iterator(plain.len(), rows)
    }
}

fn stacked(forces: impl Iterator<Item = Vector2<f64>>, size: usize) -> DVector<f64> {
    DVector::from_iterator(size, forces.flat_map(|force| [force.x, force.y]))
}

fn covariance(forces: &[Vector2<f64>], uncertainty: &Uncertainty) -> DMatrix<f64> {
    let count = forces.len();
    let rates: Vec<_> = (0..count).map(|window| rate(forces, window)).collect();
    let mut covariance = DMatrix::zeros(2 * count, 2 * count);
    for row in 0..count {
        for column in 0..count {
            let mut block = uncertainty.bias + rates[row] * rates[column].transpose() * uncertainty.onset_sd.powi(2);
            block += uncertainty.noise * correlation(row.abs_diff(column));
            if let Some(calibration) = &uncertainty.calibration {
                block += calibration.between(&forces[row], &forces[column]);
            }
            if row == column {
                block += Matrix2::identity() * (MODEL_SHARE * forces[row].norm()).powi(2);
            }
            covariance.view_mut((2 * row, 2 * column), (2, 2)).copy_from(&block);
        }
    }
    covariance
}

/// Correlation of the noise of windows so many hops apart.
fn correlation(hops: usize) -> f64 {
    match hops {
        0 => 1.0,
        1 => NEIGHBOUR_CORRELATION,
        _ => 0.0,
    }
}

/// How fast the force changes at a window, N/s.
fn rate(forces: &[Vector2<f64>], window: usize) -> Vector2<f64> {
    let (before, after) = (window.saturating_sub(1), (window + 1).min(forces.len() - 1));
    let hops = f64::from(u32::try_from(after - before).unwrap_or(u32::MAX));
    if hops > 0.0 { (forces[after] - forces[before]) / (hops * HOP_S) } else { Vector2::zeros() }
}

impl CalibrationUncertainty {
    /// Covariance of the errors of two forces: δF = −A δB F.
    fn between(&self, first: &Vector2<f64>, second: &Vector2<f64>) -> Matrix2<f64> {
        let by_matrix = |force: &Vector2<f64>| {
            let (x, y) = (force.x, force.y);
            -self.inverse * Matrix2x4::new(x, y, 0.0, 0.0, 0.0, 0.0, x, y)
        };
        by_matrix(first) * self.covariance * by_matrix(second).transpose()
    }
}
