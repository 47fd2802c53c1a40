//! Where to take another view: what it would add to what is known.
//!
//! Two cones have one reading more than a pose has unknowns, so that with noise several modes often fit. A third view
//! both narrows the pose and tells the modes apart. For every place where a sensor may stand, the covariance after a
//! view from there follows from the Jacobian alone, and the expected misfit of every other mode from the difference of
//! what it would show.
//!
//! Frames: world. Units: m, rad.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::noise::{NoisyReadings, Objective, PoseMode, view};
use super::readings::Bearing;
use crate::geometry::ConvexPolygon;
use crate::search::{Halt, never};

/// Places round the part that are tried.
const SITES: u32 = 360;

/// A misfit of this much (χ², one reading of the two being enough) tells two modes apart with 99.7 % certainty.
const TELLS_APART: f64 = 9.0;

/// What one more view from a place would do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PlannedView {
    /// Where the sensor stands.
    pub site: Point2<f64>,
    /// Standard deviation of the position (root of both variances' sum) now, m.
    pub position_sd_before: f64,
    /// With this view, m.
    pub position_sd: f64,
    /// Standard deviation of the orientation now, rad.
    pub theta_sd_before: f64,
    /// With this view, rad.
    pub theta_sd: f64,
    /// The least misfit that another mode would have after it if the best is the truth, χ²; none if there is no other.
    pub separation: Option<f64>,
}

impl PlannedView {
    /// Whether this view is expected to leave one mode.
    #[must_use]
    pub fn tells_apart(&self) -> bool {
        self.separation.is_none_or(|chi2| chi2 >= TELLS_APART)
    }

    /// Large is good: what matters first is telling modes apart, then the larger of the two errors, size·θ and
    /// position.
    fn rank(&self, size: f64) -> (bool, f64) {
        (self.tells_apart(), -self.position_sd.hypot(self.theta_sd * size))
    }
}

/// The best place for another view on a circle of this radius (m) round where the part most likely is; none without a
/// mode, or where every place is inside the part.
#[must_use]
pub fn plan_view(
    part: &ConvexPolygon,
    readings: &NoisyReadings,
    modes: &[PoseMode],
    radius: f64,
) -> Option<PlannedView> {
    let best = modes.first()?;
    let centre = nalgebra::Isometry2::new(Vector2::new(best.pose.x, best.pose.y), best.pose.theta) * part.centre();
    let site = |k: u32| {
        let angle = TAU * f64::from(k) / f64::from(SITES);
        centre + radius * Vector2::new(angle.cos(), angle.sin())
    };
    let views = (0..SITES).filter_map(|k| expected_view(part, readings, modes, site(k)));
    views.max_by(|a, b| {
        let ((a_tells, a_rank), (b_tells, b_rank)) = (a.rank(part.size()), b.rank(part.size()));
        a_tells.cmp(&b_tells).then(a_rank.total_cmp(&b_rank))
    })
}

/// What a view from one place would do; none from inside the part.
#[must_use]
pub fn expected_view(
    part: &ConvexPolygon,
    readings: &NoisyReadings,
    modes: &[PoseMode],
    site: Point2<f64>,
) -> Option<PlannedView> {
    let best = modes.first()?;
    let seen = view(part, &best.pose, site)?;
    let after = covariance_after(part, readings, best, &seen)?;
    let separation = |other: &PoseMode| {
        let shown = view(part, &other.pose, site)?;
        let apart = |k: usize| crate::math::angle::wrap_angle(shown[k].angle - seen[k].angle) / readings.sigma;
        // Both modes move toward each other to share the misfit, and each carries its own uncertainty.
        let certainty = 1.0 / (1.0 + certainty_loss(part, readings, other, &shown)?);
        Some((apart(0).powi(2) + apart(1).powi(2)) * certainty + other.chi2 - best.chi2)
    };
    let is_other = |other: &&PoseMode| !looks_the_same(part, best, other);
    let separation = modes[1..].iter().filter(is_other).filter_map(separation).reduce(f64::min);
    let (position, theta) = deviations(part, best, &best.covariance);
    let (position_after, theta_after) = deviations(part, best, &after);
    Some(PlannedView {
        site,
        position_sd_before: position,
        position_sd: position_after,
        theta_sd_before: theta,
        theta_sd: theta_after,
        separation,
    })
}

/// A symmetric part in another of its turns: no view will ever tell.
fn looks_the_same(part: &ConvexPolygon, a: &PoseMode, b: &PoseMode) -> bool {
    super::quality::congruent_groups(part, &[a.pose, b.pose]).len() == 1
}

/// Standard deviations of the centre's place and of the turn.
fn deviations(part: &ConvexPolygon, mode: &PoseMode, covariance: &Matrix3<f64>) -> (f64, f64) {
    let (sin, cos) = mode.pose.theta.sin_cos();
    let centre = part.centre();
    let carried = Vector2::new(cos * centre.x - sin * centre.y, sin * centre.x + cos * centre.y);
    let x = Vector3::new(1.0, 0.0, -carried.y);
    let y = Vector3::new(0.0, 1.0, carried.x);
    let variance = |v: Vector3<f64>| (v.transpose() * covariance * v)[0];
    ((variance(x) + variance(y)).max(0.0).sqrt(), covariance[(2, 2)].max(0.0).sqrt())
}

/// The mode's covariance once more bearings are read.
fn covariance_after(
    part: &ConvexPolygon,
    readings: &NoisyReadings,
    mode: &PoseMode,
    seen: &[Bearing; 2],
) -> Option<Matrix3<f64>> {
    let information = mode.covariance.try_inverse()? + view_information(part, readings, mode, seen)?;
    information.try_inverse()
}

/// How uncertain a mode leaves the bearings of a view, in variances of a bearing: the larger eigenvalue is at most the
/// trace.
fn certainty_loss(part: &ConvexPolygon, readings: &NoisyReadings, mode: &PoseMode, seen: &[Bearing; 2]) -> Option<f64> {
    Some((mode.covariance * view_information(part, readings, mode, seen)?).trace())
}

/// JᵀJ of a view for x, y, theta of the pose.
fn view_information(
    part: &ConvexPolygon,
    readings: &NoisyReadings,
    mode: &PoseMode,
    seen: &[Bearing; 2],
) -> Option<Matrix3<f64>> {
    let alone = NoisyReadings { bearings: seen.to_vec(), fences: Vec::new(), sigma: readings.sigma };
    Objective::new(part, &alone, &Halt::new(&never)).pose_information(&mode.pose)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::inscription::{Pose, estimate};

    /// Deviations after a view agree to this share: those of the mode once more, which moves by rounding only.
    const SAME_DEVIATION: f64 = 1e-6;

    fn quadrilateral() -> ConvexPolygon {
        let corners = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.01, 0.05]].map(Point2::from);
        ConvexPolygon::new(&SimplePolygon::new(corners).unwrap()).unwrap()
    }

    /// Seen by two sensors with errors of some tenths of a milliradian: two modes, the second of which is the truth.
    fn readings(part: &ConvexPolygon) -> NoisyReadings {
        let pose = Pose { x: 0.02, y: 0.01, theta: 0.7 };
        let exact = [[-0.2, 0.05], [0.05, -0.25]].map(|site| view(part, &pose, Point2::from(site)).unwrap());
        let errors = [3e-4, -2e-4, 1e-4, 4e-4]; // rad
        let bearings = exact.into_iter().flatten().zip(errors);
        let bearings = bearings.map(|(bearing, error)| Bearing { angle: bearing.angle + error, ..bearing }).collect();
        NoisyReadings { bearings, fences: Vec::new(), sigma: 5e-4 }
    }

    /// The readings with those of another view, if the best mode is the truth.
    fn with_view(part: &ConvexPolygon, readings: &NoisyReadings, best: &PoseMode, site: Point2<f64>) -> NoisyReadings {
        let mut more = readings.clone();
        more.bearings.extend(view(part, &best.pose, site).unwrap());
        more
    }

    /// Best modes agree in place, so that only the covariances differ.
    fn again<'a>(modes: &'a [PoseMode], best: &PoseMode) -> &'a PoseMode {
        let near = |mode: &&PoseMode| (mode.pose.x - best.pose.x).hypot(mode.pose.y - best.pose.y) < 1e-7;
        modes.iter().find(near).unwrap()
    }

    #[test]
    fn what_a_view_promises_comes_true_when_it_is_taken() {
        let part = quadrilateral();
        let readings = readings(&part);
        let modes = estimate(&part, &readings).unwrap().modes;
        assert!(modes.len() > 1, "{modes:?}");
        for site in [[0.3, 0.1], [0.0, 0.25], [-0.15, -0.15], [0.1, -0.2]].map(Point2::from) {
            let promised = expected_view(&part, &readings, &modes, site).unwrap();
            let more = with_view(&part, &readings, &modes[0], site);
            let after = estimate(&part, &more).unwrap();
            let (position, theta) = deviations(&part, &modes[0], &again(&after.modes, &modes[0]).covariance);
            assert!((position / promised.position_sd - 1.0).abs() < SAME_DEVIATION, "{site}: {position}, {promised:?}");
            assert!((theta / promised.theta_sd - 1.0).abs() < SAME_DEVIATION, "{site}: {theta}, {promised:?}");
            // Another mode that is still accepted is misfit by no less than was promised, to the digits of a linear
            // bound.
            let others = after.modes.iter().filter(|mode| mode.pose != again(&after.modes, &modes[0]).pose);
            let least = others.map(|mode| mode.chi2 - modes[0].chi2).fold(f64::INFINITY, f64::min);
            assert!(least >= 0.9 * promised.separation.unwrap(), "{site}: {least}, {promised:?}");
        }
    }

    #[test]
    fn no_other_place_round_the_part_is_better() {
        let part = quadrilateral();
        let readings = readings(&part);
        let modes = estimate(&part, &readings).unwrap().modes;
        let planned = plan_view(&part, &readings, &modes, 0.25).unwrap();
        assert!(planned.tells_apart() && planned.position_sd < planned.position_sd_before, "{planned:?}");
        let best = &modes[0];
        let centre = nalgebra::Isometry2::new(Vector2::new(best.pose.x, best.pose.y), best.pose.theta) * part.centre();
        assert!(((planned.site - centre).norm() - 0.25).abs() < 1e-12);
        // By taking each view: those that leave one mode, with its deviations.
        for k in 0..40 {
            let angle = TAU * f64::from(k) / 40.0;
            let site = centre + 0.25 * Vector2::new(angle.cos(), angle.sin());
            let after = estimate(&part, &with_view(&part, &readings, best, site)).unwrap();
            let (position, theta) = deviations(&part, best, &again(&after.modes, best).covariance);
            let planned_rank = planned.position_sd.hypot(planned.theta_sd * part.size());
            let is_better = position.hypot(theta * part.size()) < planned_rank * (1.0 - SAME_DEVIATION);
            let told = expected_view(&part, &readings, &modes, site).unwrap().tells_apart();
            assert!(!(is_better && told), "{site} is better than {planned:?}");
        }
    }

    #[test]
    fn from_inside_the_part_there_is_no_view() {
        let part = quadrilateral();
        let readings = readings(&part);
        let modes = estimate(&part, &readings).unwrap().modes;
        assert_eq!(plan_view(&part, &readings, &modes, 0.001), None);
        assert_eq!(plan_view(&part, &readings, &[], 0.25), None);
    }
}
