//! Rest poses of a part that is pushed into a corner between two fences (thesis §3, figure 3.1).
//!
//! Fence A runs from the origin along +x, fence B from the origin at the corner's angle; the part lies between them. A
//! pose is a candidate for rest if both fences are touched and an edge of the convex hull lies flush on one of them.
//!
//! That is necessary, not sufficient. A frictionless push through the centre of mass (the area centroid, unless another
//! is given) does the work −U(θ) with `U = −push · centre of mass`; between flush poses U is a sum of sinusoids without a minimum where it holds the part, so
//! the part rests where U has a minimum, and that is at a flush pose: stable exactly if `U′ < 0` before it and `U′ > 0`
//! after it.
//!
//! Frames: world, as above; the part's own for its vertices. Units: m, rad. Errors: [`CornerError`].

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Isometry2, Matrix2, Point2, Rotation2, Vector2};

use crate::geometry::{SimplePolygon, convex_hull, corners, corners_to_rounding, distance_to_segment, extent_of};
use crate::search::{Halt, Searched, Stop, never};

/// Flush poses on A and on B that are nearer than this are one, flush on both, rad: rounding of angles is 1e-15, and
/// parts whose right angles are this good do not exist.
const SAME_POSE_RAD: f64 = 1e-9;

/// A slope of U below this share of the part's size is 0, and the pose not stable: rounding leaves about 1e-16.
const LEVEL: f64 = 1e-13;

/// Turn over which the slope of U is measured, rad. A minimum narrower than this microradian holds nothing.
const BASIN_RAD: f64 = 1e-6;

/// Outlines nowhere further apart than this share of their extent are one: a symmetric part that was drawn to a
/// micrometre comes back to itself within some micrometres, and no point is placed or read nearer to an edge than that.
pub const SAME_OUTLINE_RELATIVE: f64 = 1e-4;

/// Bits kept of a direction and of a distance along it, so that their product is exact.
const HALF_BITS: i32 = 26;

/// Two fences and a push.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Corner {
    angle: f64,
    push: Vector2<f64>,
}

/// Why there is no such corner.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum CornerError {
    /// The angle between the fences.
    #[error("the corner's angle {0} rad is out of range, it must be in (0, π): check its unit")]
    Angle(f64),
    /// A push without direction.
    #[error("the push has no direction: give a vector that is not zero")]
    Push,
}

/// The fences that an edge lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Flush {
    /// The one along +x.
    A,
    /// The one at the corner's angle.
    B,
    /// An edge on each.
    Both,
}

/// A pose at rest, or at the point of tipping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CornerPose {
    /// Where the part's origin is, m.
    pub origin: Point2<f64>,
    /// Turn of the part, in [0, 2π).
    pub theta: f64,
    /// Which fences an edge of the part lies on.
    pub flush: Flush,
    /// The smaller slope of U on the two sides, uphill, m/rad: positive exactly where the pose is stable. Slopes are
    /// means over the first microradian; the slopes at the pose itself are larger by half a millionth of U.
    pub margin: f64,
}

impl CornerPose {
    /// Whether the part comes back to it.
    #[must_use]
    pub fn is_stable(&self) -> bool {
        self.margin > 0.0
    }

    /// The pose as a transformation.
    #[must_use]
    pub fn world_from_part(&self) -> Isometry2<f64> {
        Isometry2::new(self.origin.coords, self.theta)
    }
}

impl Corner {
    /// A corner of this angle, with a push in a direction.
    ///
    /// # Errors
    /// [`CornerError`] for an angle outside (0, π) or a push of zero.
    pub fn new(angle: f64, push: Vector2<f64>) -> Result<Self, CornerError> {
        if !(angle > 0.0 && angle < PI) {
            return Err(CornerError::Angle(angle));
        }
        // Scaled before it is squared, so that no size of push under- or overflows.
        let largest = push.amax();
        let push = (push / largest).try_normalize(0.0).filter(|push| push.iter().all(|value| value.is_finite()));
        Ok(Self { angle, push: push.ok_or(CornerError::Push)? })
    }

    /// Every pose with both fences touched and an edge of the hull flush on one, by its turn.
    ///
    /// ```
    /// use nalgebra::{Point2, Vector2};
    /// use palpate::corner::{Corner, Flush};
    /// use palpate::geometry::SimplePolygon;
    ///
    /// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
    /// let corner = Corner::new(std::f64::consts::FRAC_PI_2, Vector2::new(-1.0, -1.0))?;
    /// let poses = corner.poses(&block);
    /// assert_eq!(poses.len(), 4);
    /// assert!(poses.iter().all(|pose| pose.flush == Flush::Both && pose.is_stable()));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn poses(&self, part: &SimplePolygon) -> Vec<CornerPose> {
        self.poses_of_mass_at(part, part.centroid())
    }

    /// The same, ended when `stop` says so: then with the poses found by then.
    #[must_use]
    pub fn poses_until(&self, part: &SimplePolygon, stop: Stop<'_>) -> Searched<Vec<CornerPose>> {
        let halt = Halt::new(stop);
        let poses = self.halting_poses(part, part.centroid(), &halt);
        halt.searched(poses)
    }

    /// The same for a part whose centre of mass is at this place of its own frame, m: where it rests depends on it.
    #[must_use]
    pub fn poses_of_mass_at(&self, part: &SimplePolygon, centre_of_mass: Point2<f64>) -> Vec<CornerPose> {
        self.halting_poses(part, centre_of_mass, &Halt::new(&never))
    }

    fn halting_poses(&self, part: &SimplePolygon, centre_of_mass: Point2<f64>, halt: &Halt<'_>) -> Vec<CornerPose> {
        let vertices = part.vertices();
        let hull: Vec<_> = convex_hull(vertices).into_iter().map(|corner| vertices[corner]).collect();
        // A vertex within rounding of an edge must not make two poses of one; one that a drawing rounded does: parts
        // rest on it.
        let hull: Vec<_> = corners_to_rounding(&hull).into_iter().map(|corner| hull[corner]).collect();
        let edges = hull.iter().zip(hull.iter().cycle().skip(1));
        let turns = edges.flat_map(|(start, end)| {
            let along = end - start;
            let normal = (-along.x).atan2(along.y);
            self.outward().map(|fence| (fence.y.atan2(fence.x) - normal).rem_euclid(TAU))
        });
        // Flush on A, then on B, for each edge in turn.
        let fences = [Flush::A, Flush::B].into_iter().cycle();
        let mut flush: Vec<(f64, Flush)> =
            turns.map(|theta| if theta < TAU { theta } else { 0.0 }).zip(fences).collect();
        if halt.sort_by(&mut flush, |a, b| a.0.total_cmp(&b.0)).is_none() {
            return Vec::new();
        }
        // Each takes a look at every corner.
        let flush = merged(flush).into_iter().take_while(|_| !halt.is_wished());
        flush.map(|(theta, flush)| self.pose(&hull, centre_of_mass, theta, flush)).collect()
    }

    /// The outline of a part in a pose, with what touches the fences exactly on them.
    ///
    /// Parts at the same fence then share the line of their edges, and no slivers arise between them. On fence B points
    /// go to exact multiples of a direction of few bits, which moves them by some nanometres at most.
    ///
    /// # Errors
    /// As [`SimplePolygon::new`], for a part that is hardly larger than that.
    pub fn placed(
        &self,
        part: &SimplePolygon,
        pose: &CornerPose,
    ) -> Result<SimplePolygon, crate::geometry::PolygonError> {
        let motion = pose.world_from_part();
        let points: Vec<_> = part.vertices().iter().map(|p| motion * p).collect();
        let near = 1e-9 * extent_of(part.vertices());
        let [a, b] = self.outward();
        let snapped = |p: Point2<f64>| match (a.dot(&p.coords).abs() < near, b.dot(&p.coords).abs() < near) {
            (true, true) => Point2::origin(),
            (true, false) => Point2::new(p.x, 0.0),
            (false, true) => self.on_b(p),
            (false, false) => p,
        };
        SimplePolygon::new(points.into_iter().map(snapped).collect::<Vec<_>>())
    }

    /// A point on fence B, exactly.
    fn on_b(&self, p: Point2<f64>) -> Point2<f64> {
        // For a right angle the cosine is 6e-17 and not 0.
        let direction = Vector2::new(self.angle.cos(), self.angle.sin())
            .map(|value| if value.abs() < 1e-15 { 0.0 } else { rounded(value) });
        let along = rounded(p.coords.dot(&direction) / direction.norm_squared());
        Point2::from(along * direction)
    }

    /// The outward unit normals of the fences A and B, away from the part.
    fn outward(&self) -> [Vector2<f64>; 2] {
        [Vector2::new(0.0, -1.0), Vector2::new(-self.angle.sin(), self.angle.cos())]
    }

    fn pose(&self, hull: &[Point2<f64>], centre_of_mass: Point2<f64>, theta: f64, flush: Flush) -> CornerPose {
        let rotation = Rotation2::new(theta);
        let turned: Vec<_> = hull.iter().map(|p| rotation * p).collect();
        let [a, b] = self.outward();
        let [at_a, at_b] = [a, b].map(|fence| touching(&turned, fence));
        let fences = Fences::new(a, b);
        let origin = fences.meet(-a.dot(&turned[at_a[0]].coords), -b.dot(&turned[at_b[0]].coords));
        let about = rotation * centre_of_mass;
        let slope = |side: usize| {
            let turning = |p: Point2<f64>| Vector2::new(-p.y, p.x);
            let moves = fences.meet(-a.dot(&turning(turned[at_a[side]])), -b.dot(&turning(turned[at_b[side]])));
            -self.push.dot(&(moves.coords + turning(about)))
        };
        // On either side U is a sinusoid about 0, so over a small turn its mean slope lags by U times half the turn.
        let bend = -self.push.dot(&(origin.coords + about.coords)) * BASIN_RAD / 2.0;
        let margin = (-slope(0)).min(slope(1)) - bend;
        let margin = if margin.abs() < LEVEL * extent_of(hull) { 0.0 } else { margin };
        CornerPose { origin, theta, flush, margin }
    }
}

/// Outlines in one frame by what they enclose: the first of each kind, with the places of all that are the same within
/// [`SAME_OUTLINE_RELATIVE`]. A part that looks the same after a turn rests in several poses with one outline, which no
/// points tell apart.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::corner::{Corner, different_outlines};
/// use palpate::geometry::SimplePolygon;
///
/// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
/// let corner = Corner::new(std::f64::consts::FRAC_PI_2, Vector2::new(-1.0, -1.0))?;
/// let placed: Result<Vec<_>, _> = corner.poses(&block).iter().map(|pose| corner.placed(&block, pose)).collect();
/// // Upright and on its side, each either way round.
/// assert_eq!(different_outlines(&placed?), [[0, 2], [1, 3]]);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn different_outlines(outlines: &[SimplePolygon]) -> Vec<Vec<usize>> {
    let mut kinds: Vec<Vec<usize>> = Vec::new();
    for (place, outline) in outlines.iter().enumerate() {
        match kinds.iter_mut().find(|kind| are_one_outline(&outlines[kind[0]], outline)) {
            Some(kind) => kind.push(place),
            None => kinds.push(vec![place]),
        }
    }
    kinds
}

/// So far apart outlines of a part are still one, m: points need more room than that around them.
#[must_use]
pub fn same_outline_within(part: &SimplePolygon) -> f64 {
    SAME_OUTLINE_RELATIVE * extent_of(part.vertices())
}

/// Whether two outlines are nowhere further apart than [`SAME_OUTLINE_RELATIVE`] allows: their corners, and the middles
/// of the sides between these, lie on each other's sides.
fn are_one_outline(a: &SimplePolygon, b: &SimplePolygon) -> bool {
    let near = same_outline_within(a);
    let lies_on = |outline: &SimplePolygon, p: Point2<f64>| {
        outline.edges().any(|(start, end)| distance_to_segment(p, start, end) <= near)
    };
    let covers = |outline: &SimplePolygon, other: &SimplePolygon| {
        let places: Vec<_> = corners(other.vertices()).into_iter().map(|corner| other.vertices()[corner]).collect();
        let sides = places.iter().zip(places.iter().cycle().skip(1));
        sides.into_iter().all(|(start, end)| lies_on(outline, *start) && lies_on(outline, nalgebra::center(start, end)))
    };
    covers(a, b) && covers(b, a)
}

/// Two lines through the origin by their normals.
struct Fences {
    inverse: Matrix2<f64>,
}

impl Fences {
    fn new(a: Vector2<f64>, b: Vector2<f64>) -> Self {
        // The fences are not parallel.
        let inverse = Matrix2::new(b.y, -a.y, -b.x, a.x) / a.perp(&b);
        Self { inverse }
    }

    /// The point at these distances along the normals.
    fn meet(&self, a: f64, b: f64) -> Point2<f64> {
        Point2::from(self.inverse * Vector2::new(a, b))
    }
}

/// The vertices that touch a fence just before and just after a turn: one, or the two of an edge that is flush.
fn touching(hull: &[Point2<f64>], outward: Vector2<f64>) -> [usize; 2] {
    let reach = |index: usize| outward.dot(&hull[index].coords);
    let farthest = (0..hull.len()).max_by(|&i, &j| reach(i).total_cmp(&reach(j))).unwrap_or(0);
    let flush = |other: usize| reach(farthest) - reach(other) < SAME_POSE_RAD * (hull[farthest] - hull[other]).norm();
    let (next, before) = ((farthest + 1) % hull.len(), (farthest + hull.len() - 1) % hull.len());
    // Seen from inside, an edge runs counter-clockwise; turning clockwise lowers its end onto the fence.
    if flush(next) {
        [next, farthest]
    } else if flush(before) {
        [farthest, before]
    } else {
        [farthest; 2]
    }
}

/// Sorted turns, those of A and B that are the same made one.
fn merged(sorted: Vec<(f64, Flush)>) -> Vec<(f64, Flush)> {
    let mut merged: Vec<(f64, Flush)> = Vec::with_capacity(sorted.len());
    let same = |a: f64, b: f64| (b - a).min(TAU - (b - a)) < SAME_POSE_RAD;
    for (theta, flush) in sorted {
        match merged.last_mut() {
            Some(last) if same(last.0, theta) && last.1 != flush => last.1 = Flush::Both,
            _ => merged.push((theta, flush)),
        }
    }
    // The last and the first may meet across 2π.
    if let [first, .., last] = merged.as_mut_slice()
        && same(first.0, last.0)
        && first.1 != last.1
    {
        first.1 = Flush::Both;
        merged.pop();
    }
    merged
}

/// A number with half of its bits.
fn rounded(value: f64) -> f64 {
    // Adding and subtracting a number so much larger leaves no more (Dekker, Veltkamp).
    let scaled = value * (2.0_f64.powi(53 - HALF_BITS) + 1.0);
    scaled - (scaled - value)
}

/// A right angle, rad.
pub const RIGHT_ANGLE: f64 = FRAC_PI_2;

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn star(radii: &[f64]) -> SimplePolygon {
        let count = f64::from(u32::try_from(radii.len()).unwrap());
        let at = |i: usize| TAU * f64::from(u32::try_from(i).unwrap()) / count;
        let points: Vec<_> =
            radii.iter().enumerate().map(|(i, r)| Point2::new(r * at(i).cos() + 0.01, r * at(i).sin())).collect();
        SimplePolygon::new(points).unwrap()
    }

    /// The centroid's place along the push at a turn, by sliding the part until it touches both fences.
    fn potential(part: &SimplePolygon, angle: f64, push: Vector2<f64>, theta: f64) -> f64 {
        let turned: Vec<_> = part.vertices().iter().map(|p| Rotation2::new(theta) * p).collect();
        let lowest = turned.iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        // Up onto A, then along A: a point reaches B when it is to the right of B by nothing.
        let beyond = |p: &Point2<f64>| (p.y - lowest) / angle.tan() - p.x;
        let shift = turned.iter().map(beyond).fold(f64::NEG_INFINITY, f64::max);
        let centroid = Rotation2::new(theta) * part.centroid();
        -push.dot(&(centroid.coords + Vector2::new(shift, -lowest)))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(200))]

        #[test]
        fn stable_poses_are_the_minima_of_a_scan(
            radii in proptest::collection::vec(0.02..0.06_f64, 3..9), angle in 0.5..2.6_f64, toward in -0.3..0.3_f64,
        ) {
            let part = star(&radii);
            let direction = angle / 2.0 + PI + toward;
            let push = Vector2::new(direction.cos(), direction.sin());
            let poses = Corner::new(angle, push).unwrap().poses(&part);
            const STEP: f64 = 1e-6;
            for pose in &poses {
                let [before, at, after] = [-STEP, 0.0, STEP].map(|step| potential(&part, angle, push, pose.theta + step));
                let margin = ((before - at) / STEP).min((after - at) / STEP);
                // Rounding of lengths of 0.2 m over the step.
                prop_assert!((margin - pose.margin).abs() < 1e-9, "{} {} at {}", margin, pose.margin, pose.theta);
            }
            // Every minimum of a coarse scan is near a stable pose.
            let at = |k: i32| potential(&part, angle, push, f64::from(k) * 1e-3);
            for k in 0..6283 {
                if at(k) < at(k - 1) && at(k) < at(k + 1) {
                    let theta = f64::from(k) * 1e-3;
                    let near = |pose: &CornerPose| (pose.theta - theta).abs() < 2e-3 || (pose.theta - theta).abs() > TAU - 2e-3;
                    prop_assert!(poses.iter().any(|pose| pose.is_stable() && near(pose)), "a minimum at {}", theta);
                }
            }
        }

        #[test]
        fn parts_at_rest_touch_both_fences_and_pass_neither(
            radii in proptest::collection::vec(0.02..0.06_f64, 3..9), angle in 0.3..2.8_f64,
        ) {
            let part = star(&radii);
            let corner = Corner::new(angle, Vector2::new(-1.0, -1.0)).unwrap();
            for pose in corner.poses(&part) {
                let placed = corner.placed(&part, &pose).unwrap();
                for (fence, edges) in corner.outward().into_iter().zip([[Flush::A, Flush::Both], [Flush::B, Flush::Both]]) {
                    // Placing rounds points on fence B by some nanometres.
                    let beyond = |p: &&Point2<f64>| fence.dot(&p.coords) > -1e-8;
                    let touching = placed.vertices().iter().filter(beyond).count();
                    let least = if edges.contains(&pose.flush) { 2 } else { 1 };
                    prop_assert!(touching >= least);
                    prop_assert!(placed.vertices().iter().all(|p| fence.dot(&p.coords) < 1e-8));
                }
            }
        }
    }

    #[test]
    fn a_hexagon_without_right_angles_has_twelve_poses() {
        let part = star(&[0.05, 0.04, 0.047, 0.052, 0.041, 0.045]);
        assert_eq!(Corner::new(RIGHT_ANGLE, Vector2::new(-1.0, -1.0)).unwrap().poses(&part).len(), 12);
    }

    #[test]
    fn a_symmetric_part_has_fewer_outlines_than_poses() {
        let regular = |sides: u32, rounded_to: f64| {
            let at = |k: u32| TAU * f64::from(k) / f64::from(sides);
            let rounded = |x: f64| (x / rounded_to).round() * rounded_to;
            let point = |k: u32| Point2::new(rounded(0.05 * at(k).cos()), rounded(0.05 * at(k).sin()));
            SimplePolygon::new((0..sides).map(point).collect::<Vec<_>>()).unwrap()
        };
        // Drawn to a micrometre too. A triangle lies flush on one fence and the other alike only after a turn by 30°.
        for (sides, kinds) in [(3, 2), (4, 1), (6, 2)] {
            for rounded_to in [1e-12, 1e-6] {
                let part = regular(sides, rounded_to);
                let corner = Corner::new(RIGHT_ANGLE, Vector2::new(-1.0, -1.0)).unwrap();
                let placed: Vec<_> =
                    corner.poses(&part).iter().map(|pose| corner.placed(&part, pose).unwrap()).collect();
                assert_eq!(different_outlines(&placed).len(), kinds, "{sides} sides to {rounded_to} m");
            }
        }
        // The same corners, joined differently: two outlines.
        let bowl = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.03, 0.02], [0.0, 0.04]];
        let tent = [[0.0, 0.0], [0.03, 0.02], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]];
        let outlines = [bowl, tent].map(|points| SimplePolygon::new(points.map(Point2::from)).unwrap());
        assert_eq!(different_outlines(&outlines).len(), 2);
    }

    #[test]
    fn a_part_rests_by_its_centre_of_mass() {
        let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from)).unwrap();
        let corner = Corner::new(RIGHT_ANGLE, Vector2::new(-1.0, -1.0)).unwrap();
        for (pose, same) in corner.poses(&block).iter().zip(corner.poses_of_mass_at(&block, Point2::new(0.03, 0.02))) {
            assert!((pose.margin - same.margin).abs() < 1e-15);
        }
        // On its long side: turned either way the weight rises by what is written here, in m/rad, shared by both fences.
        for x in [0.03, 0.05, 0.07, 0.09] {
            let margin = corner.poses_of_mass_at(&block, Point2::new(x, 0.02))[0].margin;
            let rises = (0.02 + x).min(0.08 - x) / 2.0_f64.sqrt();
            assert!((margin - rises).abs() < 1e-6, "{x}: {margin} {rises}");
        }
    }

    #[test]
    fn corners_that_are_none_are_refused() {
        let push = Vector2::new(-1.0, 0.0);
        for angle in [0.0, PI, -1.0, f64::NAN] {
            assert!(matches!(Corner::new(angle, push), Err(CornerError::Angle(_))), "{angle}");
        }
        assert_eq!(Corner::new(1.0, Vector2::zeros()), Err(CornerError::Push));
        assert!(Corner::new(1.0, Vector2::new(0.0, 1e-300)).is_ok());
    }
}
