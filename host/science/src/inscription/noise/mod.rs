//! Poses from bearings with noise: maximum likelihood, every mode that the bearings cannot exclude, with its
//! covariance.
//!
//! What is measured is a bearing: the angle b_k under which a sensor sees one side of the part, with a normal error of
//! standard deviation σ. So the misfit of a pose is χ² = Σ (b_k − β_k)²/σ², with β_k the bearing of the corner that is
//! the outermost from there. Distances from the lines are no measure of it: they grow with the distance of the sensor
//! (the thesis's tolerance on orientations, §2.3, is not consistent for this reason). Fences and jaws are exact: their
//! misses are weighed as if they were known to [`FENCE_SD_RELATIVE`] of the part's size.
//!
//! χ² has a kink wherever another corner becomes the outermost. On the side where the sensor sees more of the part than
//! it should, the kink is a valley: there may be a minimum on it, and descent may also come to rest on it where there
//! is none. So where descent stalls, the minimum along the valley is sought and its multipliers decide whether it is
//! one (`valley`).
//!
//! In reading order: `objective`, χ² and its derivatives; `starts`, where to begin so that no mode is missed;
//! `descent`; `valley`.
//!
//! Source: thesis §2.3 asks for this; the form is that of any bearing-only localisation (Gauss-Newton, Cramér-Rao).

mod descent;
mod objective;
mod starts;
mod valley;

use nalgebra::{Matrix3, Point2};

use super::exact::{Continuum, determined};
use super::readings::{Bearing, HalfPlane};
use crate::geometry::ConvexPolygon;
use crate::geometry::Pose;
use crate::math::statistics::chi_square_quantile;
use crate::search::{Halt, Searched, Stop, never};
pub use objective::FENCE_SD_RELATIVE;
pub(super) use objective::{Objective, Placed};
pub(super) use valley::covering;

/// The true pose is among the modes with this probability.
pub const GATE: f64 = 0.99;

/// Without any redundancy every exact pose fits with χ² = 0, but for rounding.
const GATE_WITHOUT_DOF: f64 = 1e-6;

/// Modes up to this many times the gate are places to look for others beside: χ² is shallow between some.
const EXPLORED_GATES: f64 = 2.0;

/// Modes within this many standard deviations of each other are one.
const SAME_MODE_SD: f64 = 1e-2;

/// Readings of a part, with noise.
#[derive(Clone, Debug, PartialEq)]
pub struct NoisyReadings {
    /// Sides of the part as sensors see them.
    pub bearings: Vec<Bearing>,
    /// Lines that the part touches exactly.
    pub fences: Vec<HalfPlane>,
    /// Standard deviation of each bearing, rad.
    pub sigma: f64,
}

/// A pose that explains the bearings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseMode {
    /// The most likely pose hereabouts.
    pub pose: Pose,
    /// Squared residuals of the bearings over σ², summed.
    pub chi2: f64,
    /// Of x, y, theta of the pose: m², m rad, rad². The Cramér-Rao bound.
    pub covariance: Matrix3<f64>,
    /// Two corners are outermost at once, so that errors are not normally distributed: take the covariance as a hint.
    pub at_corner_change: bool,
}

/// What bearings say about a part's pose.
#[derive(Clone, Debug, PartialEq)]
pub struct InscriptionEstimate {
    /// All modes inside the gate, best first.
    pub modes: Vec<PoseMode>,
    /// Readings less the three unknowns.
    pub dof: usize,
    /// The largest χ² that is accepted: the 99 % quantile.
    pub gate: f64,
}

impl NoisyReadings {
    /// All lines as if they were exact, bearings first.
    #[must_use]
    pub fn lines(&self) -> Vec<HalfPlane> {
        self.bearings.iter().map(Bearing::half_plane).chain(self.fences.iter().copied()).collect()
    }

    /// Readings less the three unknowns of a pose.
    #[must_use]
    pub fn dof(&self) -> usize {
        (self.bearings.len() + self.fences.len()).saturating_sub(3)
    }
}

/// The poses that explain bearings with noise.
///
/// # Errors
/// [`Continuum`] if the lines do not determine the pose.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::{ConvexPolygon, SimplePolygon};
/// use palpate::inscription::{Cone, NoisyReadings, estimate};
///
/// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
/// let block = ConvexPolygon::new(&block)?;
/// let views = [(-0.2, 0.0, 0.001, 0.199), (0.0, -0.2, 1.279, 1.569), (0.3, 0.1, 3.341, 3.535)]; // about 1 mrad off
/// let cones = views.map(|(x, y, right, left)| Cone::new(Point2::new(x, y), right, left));
/// let bearings = cones.into_iter().flat_map(|cone| cone.map(|cone| cone.bearings()).into_iter().flatten()).collect();
/// let estimate = estimate(&block, &NoisyReadings { bearings, fences: Vec::new(), sigma: 1e-3 })?;
/// // A rectangle looks the same after half a turn.
/// assert_eq!((estimate.dof, estimate.modes.len() % 2), (3, 0));
/// assert!(estimate.modes.iter().any(|mode| mode.pose.x.hypot(mode.pose.y) < 1e-3)); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn estimate(part: &ConvexPolygon, readings: &NoisyReadings) -> Result<InscriptionEstimate, Continuum> {
    estimate_until(part, readings, &never).map(|searched| searched.found)
}

/// The same, ended when `stop` says so: then with the modes found by then, any of which may be missing.
///
/// # Errors
/// [`Continuum`] if the lines do not determine the pose.
pub fn estimate_until(
    part: &ConvexPolygon,
    readings: &NoisyReadings,
    stop: Stop<'_>,
) -> Result<Searched<InscriptionEstimate>, Continuum> {
    let halt = Halt::new(stop);
    let lines = readings.lines();
    determined(part, &lines)?;
    let objective = Objective::new(part, readings, &halt);
    let dof = readings.dof();
    let gate = chi_square_quantile(GATE, dof).max(GATE_WITHOUT_DOF);
    let mut modes: Vec<Settled> = Vec::new();
    let mut starts = starts::starts(&objective, &lines, gate);
    while let Some(start) = starts.pop() {
        if halt.is_wished() {
            break;
        }
        // Valleys between this turn and the next have minima to which not every descent comes.
        let beside = objective.along_valleys(&start, starts::STEP_MAX).minima;
        for settled in objective.settle(&start).into_iter().chain(beside) {
            if settled.chi2 <= EXPLORED_GATES * gate && !modes.iter().any(|mode| objective.is_same(mode, &settled)) {
                starts.extend(starts::beside(&objective, &lines, &settled));
                modes.push(settled);
            }
        }
    }
    modes.retain(|mode| mode.chi2 <= gate);
    modes.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
    let modes = modes.iter().filter_map(|settled| objective.mode(settled)).collect();
    Ok(halt.searched(InscriptionEstimate { modes, dof, gate }))
}

/// A local minimum of χ².
#[derive(Clone, Copy, Debug)]
struct Settled {
    placed: Placed,
    chi2: f64,
    /// JᵀJ in the objective's coordinates.
    information: Matrix3<f64>,
    at_corner_change: bool,
}

impl Objective<'_> {
    fn is_same(&self, a: &Settled, b: &Settled) -> bool {
        let apart = self.difference(&a.placed, &b.placed);
        (apart.transpose() * a.information * apart)[0] < SAME_MODE_SD * SAME_MODE_SD
    }

    /// None where the readings do not fix the pose, to the last digit.
    fn mode(&self, settled: &Settled) -> Option<PoseMode> {
        let covariance = self.covariance(&settled.placed, &settled.information)?;
        let Settled { chi2, at_corner_change, .. } = *settled;
        Some(PoseMode { pose: self.pose(&settled.placed), chi2, covariance, at_corner_change })
    }
}

/// The bearings of a part's sides from a sensor, right and left; none from inside.
#[must_use]
pub fn view(part: &ConvexPolygon, pose: &Pose, apex: Point2<f64>) -> Option<[Bearing; 2]> {
    objective::view(part, pose, apex)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::inscription::Cone;

    const OUTLINE: [[f64; 2]; 7] = [
        [-0.08622, 0.08317],
        [-0.07493, 0.01135],
        [-0.05773, -0.05474],
        [0.01442, -0.05521],
        [0.07201, -0.02397],
        [0.08696, 0.0043],
        [0.0728, 0.074],
    ];

    /// Apex, right and left side of views in which several minima have two corners outermost.
    const VIEWS: [[f64; 4]; 3] = [
        [-0.10135475508002206, 0.26235834818613474, -1.0424409574719777, -0.6964502053310082],
        [0.5571293557481021, -0.6089518203392756, 2.0297940649710453, 2.298577056742249],
        [0.703173373123456, -0.4009780026468746, 2.433149576959958, 2.7124956468160235],
    ];

    /// χ², turn relative to the frame and its standard deviation of all modes, with the views turned and in another order.
    fn modes(turn: f64, first: usize) -> Vec<[f64; 3]> {
        let part = SimplePolygon::new(OUTLINE.map(Point2::from)).unwrap();
        let part = ConvexPolygon::new(&part).unwrap();
        let cones = (0..VIEWS.len()).map(|k| {
            let [x, y, right, left] = VIEWS[(k + first) % VIEWS.len()];
            let apex = nalgebra::Rotation2::new(turn) * Point2::new(x, y);
            Cone::new(apex, right + turn, left + turn).unwrap()
        });
        let bearings = cones.flat_map(|cone| cone.bearings()).collect();
        let found = estimate(&part, &NoisyReadings { bearings, fences: Vec::new(), sigma: 0.01 }).unwrap();
        let mut modes: Vec<_> = found
            .modes
            .iter()
            .map(|mode| {
                let theta = (mode.pose.theta - turn).rem_euclid(std::f64::consts::TAU);
                [mode.chi2, theta, mode.covariance[(2, 2)].sqrt()]
            })
            .collect();
        // Two modes with one χ² come in any order.
        modes.sort_by(|a, b| a[1].total_cmp(&b[1]));
        modes
    }

    /// The one at 3.8755 rad lies behind a corner change, to which not every descent comes; between it and the next the
    /// profile has a ridge that solves the equations of a valley.
    #[test]
    fn turning_the_frame_changes_no_mode() {
        let plain = modes(0.0, 0);
        assert_eq!(plain.len(), 7, "{plain:?}");
        for (k, first) in (0..40).zip([0, 1, 2].into_iter().cycle()) {
            let turned = modes(0.013 + 0.157 * f64::from(k), first);
            assert_eq!(turned.len(), 7, "{k}: {turned:?}");
            let same = |a: &[f64; 3]| plain.iter().find(|b| (a[1] - b[1]).abs() < 1e-6).map(|b| (*a, *b));
            let pairs: Vec<_> = turned.iter().filter_map(same).collect();
            assert_eq!(pairs.len(), 7, "{k}: {turned:?} {plain:?}");
            for (a, b) in pairs {
                assert!((a[0] - b[0]).abs() < 1e-5 && (a[2] - b[2]).abs() < 1e-4 * a[2], "{k}: {a:?} {b:?}");
            }
        }
    }
}
