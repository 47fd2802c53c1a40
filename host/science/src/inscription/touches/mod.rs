//! Poses from touches: points that a finger felt on the outline, with noise, perhaps with the normal there; mixed with
//! lines that the part's hull touches, and with disks that it does not reach into.
//!
//! χ² of a pose is a sum over what was felt and seen: of a touch the least over the outline of (distance/σ)² plus, where
//! a normal was felt, (angle between normals/σ_n)²; of a line the miss of the hull's outermost corner. All local minima
//! inside the gate are wanted. χ² is a minimum over choices of a piece of the outline for each touch, smooth for each
//! choice; so a local minimum of χ² is one of every choice that holds there.
//!
//! The search covers all poses by boxes (`cover`). A box is dropped where bounds show that χ² exceeds the gate in it, or
//! that no choice that can hold in it has a critical point there; where each choice left has at most one, Newton's
//! method finds it; otherwise the box is halved. Nothing is sampled. What is found is judged by χ² itself (`settle`).
//!
//! In reading order: `chain`, the outline in pieces; `terms`, residuals with bounds; `objective`, χ² of a pose; `cover`;
//! `settle`.
//!
//! Source: the thesis asks for it (figure 1.1, §2.3); interval Newton: R. Krawczyk, Computing 4 (1969) 187–201.
//! Pure. Frames: world, and the part's own. Units: m, rad. Errors: none; "not determined" is an answer.

mod chain;
mod cover;
mod objective;
mod settle;
mod terms;
#[cfg(test)]
mod tests;

use nalgebra::Point2;

use super::noise::{GATE, PoseMode};
use super::readings::{Bearing, HalfPlane};
use crate::geometry::SimplePolygon;
use crate::math::statistics::chi_square_quantile;
use crate::search::{Halt, Searched, Stop, never};

/// A free disk may reach into the part by so much, m: rounding errors of an exact contact.
const OVERLAP_MAX_M: f64 = 1e-9;

/// Unknowns of a pose.
const UNKNOWNS: usize = 3;

/// A point of the outline that was felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// Where, world.
    pub point: Point2<f64>,
    /// Standard deviation of each coordinate, m.
    pub sigma: f64,
    /// The outline's normal there, if it was felt.
    pub normal: Option<FeltNormal>,
}

/// A normal that was felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeltNormal {
    /// Polar angle of the part's outward normal, world.
    pub angle: f64,
    /// Standard deviation, rad.
    pub sigma: f64,
}

/// A line that the part's hull touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fence {
    /// The part is on its inner side.
    pub line: HalfPlane,
    /// Standard deviation of its offset, m; none where it is exact, which counts as [`super::FENCE_SD_RELATIVE`].
    pub sigma: Option<f64>,
}

/// A disk that the part does not reach into.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FreeDisk {
    /// World.
    pub centre: Point2<f64>,
    /// m.
    pub radius: f64,
}

/// What was felt and seen of a part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TouchReadings {
    /// Points of the outline.
    pub touches: Vec<Touch>,
    /// Lines that touch the hull.
    pub fences: Vec<Fence>,
    /// Sides of the part as sensors see them.
    pub bearings: Vec<Bearing>,
    /// Standard deviation of each bearing, rad.
    pub bearing_sigma: f64,
    /// Where the part is not.
    pub free: Vec<FreeDisk>,
}

/// What touches say about a part's pose.
#[derive(Clone, Debug, PartialEq)]
pub struct TouchEstimate {
    /// All isolated minima inside the gate that are clear of the free disks, best first.
    pub modes: Vec<PoseMode>,
    /// The best minimum that is not isolated, if there is one inside the gate and clear of the disks: the part can slide
    /// or turn from there.
    pub loose: Option<crate::geometry::Pose>,
    /// Readings less the three unknowns; negative where there are not as many.
    pub dof: i64,
    /// The largest χ² that is accepted.
    pub gate: f64,
}

impl TouchReadings {
    /// How many numbers are known of the pose.
    #[must_use]
    pub fn constraints(&self) -> usize {
        let normals = self.touches.iter().filter(|touch| touch.normal.is_some()).count();
        self.touches.len() + normals + self.fences.len() + self.bearings.len()
    }

    /// Whether there are enough readings for a pose.
    #[must_use]
    pub fn are_enough(&self) -> bool {
        self.constraints() >= UNKNOWNS
    }
}

/// The poses that explain touches and lines with noise, of a part that may have notches.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::SimplePolygon;
/// use palpate::inscription::{Touch, TouchReadings, touched_poses};
///
/// let wedge = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.02, 0.04]].map(Point2::from))?;
/// let points = [[0.01, 0.0], [0.05, 0.0], [0.01, 0.02], [0.03, 0.03], [0.05, 0.01]]; // m
/// let touch = |point| Touch { point: Point2::from(point), sigma: 1e-4, normal: None };
/// let readings = TouchReadings { touches: points.map(touch).to_vec(), ..TouchReadings::default() };
/// let estimate = touched_poses(&wedge, &readings);
/// assert_eq!((estimate.dof, estimate.modes.len()), (2, 1));
/// assert!(estimate.modes[0].pose.x.hypot(estimate.modes[0].pose.y) < 1e-9); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn touched_poses(outline: &SimplePolygon, readings: &TouchReadings) -> TouchEstimate {
    touched_poses_until(outline, readings, &never).found
}

/// The same, ended when `stop` says so: then with the modes found by then, any of which may be missing.
#[must_use]
pub fn touched_poses_until(
    outline: &SimplePolygon,
    readings: &TouchReadings,
    stop: Stop<'_>,
) -> Searched<TouchEstimate> {
    let halt = Halt::new(stop);
    let constraints = readings.constraints();
    let signed = |count: usize| i64::try_from(count).unwrap_or(i64::MAX);
    let dof = signed(constraints) - signed(UNKNOWNS);
    let gate = chi_square_quantile(GATE, constraints.saturating_sub(UNKNOWNS).max(1));
    let mut estimate = TouchEstimate { modes: Vec::new(), loose: None, dof, gate };
    if readings.are_enough() {
        let objective = objective::Objective::new(outline, readings, gate, &halt);
        let found = match loosened(readings, &objective) {
            None => cover::minima(&objective, gate),
            Some(loosened) => {
                let near = objective::Objective::new(outline, &loosened, gate, &halt);
                cover::minima(&near, gate).settled(&objective, gate)
            }
        };
        estimate.modes = found.modes(&objective);
        estimate.loose = found.loose.map(|(at, _)| at.pose(objective.anchor));
    }
    halt.searched(estimate)
}

/// An exact fence is searched for with this share of the least standard deviation of all else: so stiff a term that the
/// bounds of a box are lost in it would make the search long.
const LOOSENED: f64 = 0.01;

/// The same share of the part's size at the most.
const LOOSENED_RELATIVE: f64 = 1e-5;

/// The same readings with exact fences known a little less exactly, and no disks to keep clear of: its minima lie beside
/// those that are wanted, by less than a thousandth of a standard deviation. None where no fence is exact.
fn loosened(readings: &TouchReadings, objective: &objective::Objective<'_>) -> Option<TouchReadings> {
    readings.fences.iter().find(|fence| fence.sigma.is_none())?;
    let touches = readings.touches.iter().map(|touch| touch.sigma);
    let least = touches.chain(readings.fences.iter().filter_map(|fence| fence.sigma)).fold(f64::INFINITY, f64::min);
    let size = objective.convex.size();
    let sigma = (LOOSENED * least).clamp(super::FENCE_SD_RELATIVE * size, LOOSENED_RELATIVE * size);
    let fences = readings.fences.iter().map(|fence| Fence { sigma: fence.sigma.or(Some(sigma)), ..*fence });
    Some(TouchReadings { fences: fences.collect(), free: Vec::new(), ..readings.clone() })
}
