//! Parts with a piecewise smooth convex outline, by their support function (thesis §2.3 leaves this open).
//!
//! Nothing in g(θ) = Σ λ_k h(β_k − θ) − C is special to polygons (see [`triple`](super::triple)): any convex outline
//! has a support function h, and h' is how far the touching point lies along the line. Between the directions at which
//! an edge is flat g is smooth, and |g''| ≤ max |h''| bounds how far a value and a slope reach: an interval without a
//! root, with one, or too close to a tangency to tell is recognised for certain, or halved.
//!
//! Frames: world; touching points from the outline's own origin. Units: m, rad.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector2, Vector3};

use super::exact::{MISS_MAX_RELATIVE, full_turn};
use super::readings::HalfPlane;
use crate::geometry::ConvexPolygon;
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;

/// A convex outline, as supporting lines touch it.
pub trait Boundary {
    /// The outermost point in a direction (polar angle, part axes), from the part's origin, m.
    fn touch(&self, angle: f64) -> Vector2<f64>;
    /// Directions of the normals of straight edges, in which there is no single outermost point.
    fn flat(&self) -> Vec<f64>;
    /// At least the largest |h''| between those: distance of the points from the origin plus radius of curvature, m.
    fn bend_max(&self) -> f64;
    /// How large the part is, m.
    fn size(&self) -> f64;
}

/// A polygon whose corners are rounded with one radius outward: all points within that of it.
#[derive(Clone, Debug)]
pub struct Rounded {
    /// The centres of the corners' arcs are its corners.
    pub polygon: ConvexPolygon,
    /// Radius of the arcs, m.
    pub radius: f64,
}

/// An ellipse about its own origin, axes along x and y.
#[derive(Clone, Copy, Debug)]
pub struct Ellipse {
    /// Half its length along x, m.
    pub a: f64,
    /// Half its length along y, m.
    pub b: f64,
}

impl Boundary for Rounded {
    fn touch(&self, angle: f64) -> Vector2<f64> {
        let corner = self.polygon.corners()[self.polygon.support(wrap_angle(angle))];
        self.polygon.centre().coords + corner + self.radius * direction(angle)
    }

    fn flat(&self) -> Vec<f64> {
        self.polygon.angles().to_vec()
    }

    fn bend_max(&self) -> f64 {
        self.polygon.centre().coords.norm() + self.polygon.reach() + 2.0 * self.radius
    }

    fn size(&self) -> f64 {
        self.polygon.size() + 2.0 * self.radius
    }
}

impl Boundary for Ellipse {
    fn touch(&self, angle: f64) -> Vector2<f64> {
        let (sin, cos) = angle.sin_cos();
        let height = (self.a * cos).hypot(self.b * sin);
        Vector2::new(self.a * self.a * cos, self.b * self.b * sin) / height
    }

    fn flat(&self) -> Vec<f64> {
        Vec::new()
    }

    fn bend_max(&self) -> f64 {
        let (long, short) = (self.a.max(self.b), self.a.min(self.b));
        long + long * long / short
    }

    fn size(&self) -> f64 {
        2.0 * self.a.max(self.b)
    }
}

/// All poses in which a part with this outline touches every line; none if they do not determine one, as those of a
/// disk never do.
///
/// Roots nearer to each other than 1e-6 rad are one.
///
/// ```
/// use palpate::inscription::{Ellipse, HalfPlane, boundary_poses};
///
/// // Jaws 70 mm apart and a floor: an ellipse of 80 by 60 mm stands askew, four ways.
/// let ellipse = Ellipse { a: 0.04, b: 0.03 };
/// let lines = [(0.0, 0.07), (3.141592653589793, 0.0), (-1.570796326794897, 0.0)];
/// let lines = lines.map(|(angle, offset)| HalfPlane::new(angle, offset));
/// assert_eq!(boundary_poses(&ellipse, &lines).unwrap().len(), 4);
/// ```
#[must_use]
pub fn boundary_poses(part: &impl Boundary, lines: &[HalfPlane]) -> Option<Vec<Pose>> {
    let miss_max = MISS_MAX_RELATIVE * part.size();
    // Σ λ u = 0 takes the position out: g(θ) = Σ λ h(β − θ) − C, here with its slope.
    let (three, weights, offset) = widest_triple(lines).filter(|triple| triple.2.abs() > 1e-3 * miss_max)?;
    let g = |theta: f64| {
        let terms = three.iter().zip(weights).map(|(line, weight)| {
            let out = part.touch(line.angle - theta);
            let normal = direction(line.angle - theta);
            (weight * out.dot(&normal), weight * out.perp(&normal))
        });
        let (height, slope) = terms.fold((0.0, 0.0), |sum, term| (sum.0 + term.0, sum.1 + term.1));
        (height - offset, slope)
    };
    // All roots of g between the turns at which it has kinks, by halving intervals.
    let mut turns = Vec::new();
    for [from, to] in smooth_intervals(part, &three) {
        let mut search = Search { bend: part.bend_max(), miss_max, intervals_left: INTERVALS_MAX, span: [from, to] };
        isolate(&g, [from, to], &mut search, &mut turns);
        if search.intervals_left == 0 {
            return None;
        }
    }
    // A root of the widest three is a pose if the position that follows fits all lines.
    let mut poses: Vec<Pose> = Vec::new();
    for pose in turns.into_iter().filter_map(|theta| placed(part, lines, theta, miss_max)) {
        let is_same = |other: &Pose| wrap_angle(other.theta - pose.theta).abs() < SAME_TURN;
        if !poses.iter().any(is_same) {
            poses.push(pose);
        }
    }
    poses.sort_by(|a, b| a.theta.total_cmp(&b.theta));
    Some(poses)
}

/// Roots nearer than this are one, rad: at a tangency rounding moves them by the root of 1e-16.
const SAME_TURN: f64 = 1e-6;

/// Intervals are halved down to this, rad; what is then within reach of zero is judged by its miss.
const WIDTH_MIN: f64 = 1e-9;

/// Intervals looked at between two flat edges: a root takes about 50 of them, so only a part that can turn freely
/// exhausts them.
const INTERVALS_MAX: usize = 100_000;

/// How roots are searched for.
pub(super) struct Search {
    /// At least the largest |g''|.
    pub bend: f64,
    /// |g| up to this may be a root.
    pub miss_max: f64,
    /// Intervals that may still be looked at.
    pub intervals_left: usize,
    /// Where g begins and ends to be this function: a near miss there counts, since the next one may miss on its side.
    pub span: [f64; 2],
}

fn direction(angle: f64) -> Vector2<f64> {
    let (sin, cos) = angle.sin_cos();
    Vector2::new(cos, sin)
}

/// The three lines that are farthest from meeting in one point, with λ (Σ |λ| = 1) and C.
fn widest_triple(lines: &[HalfPlane]) -> Option<([HalfPlane; 3], [f64; 3], f64)> {
    let m = lines.len();
    let triples = (0..m).flat_map(|a| (a + 1..m).flat_map(move |b| (b + 1..m).map(move |c| [a, b, c])));
    let judged = triples.filter_map(|three| {
        let three = three.map(|line| lines[line]);
        let [a, b, c] = three.map(|line| line.normal);
        let weights = [b.perp(&c), c.perp(&a), a.perp(&b)];
        let sum: f64 = weights.iter().map(|weight| weight.abs()).sum();
        let weights = weights.map(|weight| weight / sum);
        let offset: f64 =
            three.iter().zip(weights).map(|(line, weight)| weight * line.normal.dot(&line.point.coords)).sum();
        (sum > super::triple::PARALLEL).then_some((three, weights, offset))
    });
    judged.max_by(|a, b| a.2.abs().total_cmp(&b.2.abs()))
}

/// The turns between which no flat edge lies on one of the lines.
fn smooth_intervals(part: &impl Boundary, lines: &[HalfPlane]) -> Vec<[f64; 2]> {
    let flat = part.flat();
    let mut ends: Vec<f64> =
        lines.iter().flat_map(|line| flat.iter().map(|edge| wrap_angle(line.angle - edge))).collect();
    ends.extend([-PI, PI]);
    ends.sort_by(f64::total_cmp);
    ends.windows(2).map(|pair| [pair[0], pair[1]]).filter(|[from, to]| to > from).collect()
}

/// Roots in an interval in which |g''| ≤ `bend`.
pub(super) fn isolate(g: &impl Fn(f64) -> (f64, f64), [from, to]: [f64; 2], search: &mut Search, roots: &mut Vec<f64>) {
    if search.intervals_left == 0 {
        return;
    }
    search.intervals_left -= 1;
    let (middle, half) = (f64::midpoint(from, to), (to - from) / 2.0);
    let (value, slope) = g(middle);
    let reach = slope.abs() * half + search.bend * half * half / 2.0;
    if value.abs() > reach + search.miss_max {
        return;
    }
    let found = if half < WIDTH_MIN {
        Some(middle)
    } else if slope.abs() > search.bend * half {
        monotone_root(g, [from, to], search)
    } else {
        isolate(g, [from, middle], search, roots);
        isolate(g, [middle, to], search, roots);
        return;
    };
    roots.extend(found.filter(|&found| !is_between_roots(g, found)));
}

/// Whether |g| falls to both sides of a place that is within reach of zero: the roots are there, and each is found by itself. Where
/// it rises the curve passes by nearly, at a tangency.
fn is_between_roots(g: &impl Fn(f64) -> (f64, f64), at: f64) -> bool {
    let value = g(at).0;
    let falls = |beside: f64| beside * value > 0.0 && beside.abs() < value.abs();
    [-SAME_TURN, SAME_TURN].into_iter().all(|aside| falls(g(at + aside).0))
}

/// The root of a function that only rises or only falls, by bisection; an end that is within the miss if there is none.
fn monotone_root(g: &impl Fn(f64) -> (f64, f64), [mut low, mut high]: [f64; 2], search: &Search) -> Option<f64> {
    // The ends belong to two intervals and to the flat edge between them, so they are looked at from within.
    let inward = f64::EPSILON * TAU;
    let (at_low, at_high) = (g(low + inward).0, g(high - inward).0);
    if (at_low > 0.0) == (at_high > 0.0) {
        let (end, value, outward) =
            if at_low.abs() < at_high.abs() { (low, at_low, -inward) } else { (high, at_high, inward) };
        // Where |g| goes on to fall beyond the end, the neighbour has what is nearest to a root, unless it is at the
        // end itself.
        let (beyond, slope) = g(end + outward);
        let rises = value * slope * outward >= 0.0 || value * beyond <= 0.0;
        let outermost = search.span.iter().any(|limit| limit.to_bits() == end.to_bits());
        return (value.abs() <= search.miss_max && (rises || outermost)).then_some(end);
    }
    while high - low > f64::EPSILON * (1.0 + high.abs()) {
        let middle = f64::midpoint(low, high);
        if middle <= low || middle >= high {
            break;
        }
        if (g(middle).0 > 0.0) == (at_low > 0.0) { low = middle } else { high = middle }
    }
    Some(f64::midpoint(low, high))
}

/// The pose with this turn that fits all lines best, if it touches them.
fn placed(part: &impl Boundary, lines: &[HalfPlane], theta: f64, miss_max: f64) -> Option<Pose> {
    let turned = |line: &HalfPlane| nalgebra::Rotation2::new(theta) * part.touch(line.angle - theta);
    let (mut normal, mut right) = (Matrix3::identity(), Vector3::zeros());
    for line in lines {
        let row = Vector3::new(line.normal.x, line.normal.y, 0.0);
        normal += row * row.transpose();
        right += row * line.normal.dot(&(line.point.coords - turned(line)));
    }
    // The identity above only filled the third row; it is taken off the others.
    normal[(0, 0)] -= 1.0;
    normal[(1, 1)] -= 1.0;
    let at = normal.try_inverse()? * right;
    let touches = |line: &HalfPlane| line.beyond((turned(line) + at.xy()).into()).abs() <= miss_max;
    lines.iter().all(touches).then_some(Pose { x: at.x, y: at.y, theta: full_turn(theta) })
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;
    use proptest::prelude::*;

    use super::*;
    use crate::inscription::{Inscription, poses};

    fn polygon(points: &[(f64, f64)]) -> Option<ConvexPolygon> {
        ConvexPolygon::hull_of_points(&points.iter().map(|&(x, y)| Point2::new(x, y)).collect::<Vec<_>>())
    }

    /// Lines that a boundary touches in a pose.
    fn tangents(part: &impl Boundary, pose: [f64; 3], angles: &[f64]) -> Vec<HalfPlane> {
        let height = |angle: f64| {
            let out = nalgebra::Rotation2::new(pose[2]) * part.touch(angle - pose[2]) + Vector2::new(pose[0], pose[1]);
            out.dot(&direction(angle))
        };
        angles.iter().map(|&angle| HalfPlane::new(angle, height(angle))).collect()
    }

    #[test]
    fn a_disk_is_not_determined_by_any_turn_and_an_ellipse_repeats_after_half_a_turn() {
        let disk = Ellipse { a: 1.0, b: 1.0 };
        assert_eq!(boundary_poses(&disk, &tangents(&disk, [0.3, 0.2, 0.5], &[0.1, 1.9, 4.0])), None);
        let ellipse = Ellipse { a: 2.0, b: 1.0 };
        let lines = tangents(&ellipse, [0.3, 0.2, 0.5], &[0.1, 1.9, 4.0, 5.0]);
        let found = boundary_poses(&ellipse, &lines).unwrap();
        assert!(found.len() >= 2 && found.iter().any(|pose| (pose.theta - 0.5).abs() < 1e-6), "{found:?}");
        assert!(found.iter().any(|pose| (pose.theta - 0.5 - PI).abs() < 1e-6), "{found:?}");
    }

    /// Jaws exactly as wide as the part touch it at a tangency, which is one pose and not a cloud of near ones.
    #[test]
    fn a_tangency_is_one_pose() {
        let polygon = polygon(&[(0.0, 0.0), (0.06, 0.0), (0.06, 0.04), (0.01, 0.05)]).unwrap();
        let rounded = Rounded { polygon, radius: 0.005 };
        let lines = [(-PI / 2.0, 0.0), (PI, 0.0), (0.0, 0.07)].map(|(angle, offset)| HalfPlane::new(angle, offset));
        let found = boundary_poses(&rounded, &lines).unwrap();
        assert_eq!(found.len(), 8, "{found:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        /// A rounded part touches lines where the polygon touches those moved inward by the radius.
        #[test]
        fn rounding_moves_the_lines(
            points in proptest::collection::vec((-1.0..1.0, -1.0..1.0_f64), 4..9),
            pose in [-1.0..1.0, -1.0..1.0, 0.0..6.2_f64], angles in [0.0..2.0, 2.2..4.0, 4.3..6.0_f64], radius in 0.0..0.5_f64,
        ) {
            let Some(polygon) = polygon(&points) else { return Ok(()) };
            let rounded = Rounded { polygon: polygon.clone(), radius };
            let lines = tangents(&rounded, pose, &angles);
            let moved: Vec<_> = lines.iter().map(|l| HalfPlane { point: l.point - l.normal * radius, ..*l }).collect();
            let (Some(found), Inscription::Poses(wanted)) = (boundary_poses(&rounded, &lines), poses(&polygon, &moved)) else {
                return Ok(());
            };
            // Tight pairs may be one here.
            prop_assume!(wanted.windows(2).all(|pair| pair[1].theta - pair[0].theta > 1e-4));
            prop_assert_eq!(found.len(), wanted.len(), "{:?} {:?}", found, wanted);
            for (a, b) in found.iter().zip(&wanted) {
                prop_assert!((a.theta - b.theta).abs() < 1e-7 && (a.x - b.x).hypot(a.y - b.y) < 1e-7, "{a:?} {b:?}");
            }
        }
    }
}
