//! Lines mixed with points that the part's outline passes through, such as probed contacts (thesis figure 1.1).
//!
//! A part turned by θ whose centre is at t holds a line or a point where a row·t = right side: u·t = c − u·Rv for a
//! line with the normal u that a corner v touches, and (R n)·t = (R n)·q − h for a point q on the edge with the normal
//! n at the distance h. Three of these leave no t but where their determinant is zero: a trigonometric polynomial in θ,
//! of degree 2 at most, for each choice of corners and edges. Its roots are isolated for certain, as those of smooth
//! outlines are; the pose of each is improved over all lines and points before it is judged.
//!
//! Three edges can only hold three points that are as far apart as places on these edges can be, which leaves few
//! choices: for n edges O(n) of two points, found in O(n²).
//!
//! Frames: world; corners and edges from the part's centre. Units: m, rad.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Matrix2, Matrix3, Point2, Rotation2, Vector2, Vector3};

use super::boundary::{Search, isolate};
use super::exact::{Continuum, Inscription, MISS_MAX_RELATIVE, determined, full_turn, miss_gradient, poses};
use super::readings::HalfPlane;
use super::triple::PARALLEL;
use crate::geometry::{ConvexPolygon, Pose, distance_to_segment};
use crate::math::angle::wrap_angle;

/// Points nearer to each other than this share of the part's size are one.
const SAME_POINT_RELATIVE: f64 = 1e-9;

/// Poses nearer than this, in part sizes and rad, are one: at a tangency rounding moves them by the root of 1e-16.
const SAME_POSE: f64 = 1e-6;

/// A determinant below this share of the part's size for every turn is zero but for rounding.
const VANISHING_RELATIVE: f64 = 1e-13;

/// Steps of improvement over all readings.
const STEPS_MAX: usize = 6;

/// Candidates that miss by more than this share of the size belong to other corners or edges.
const WORTH_IMPROVING_RELATIVE: f64 = 1e-4;

/// Intervals looked at for one choice of corners and edges; a root takes about 50.
const INTERVALS_MAX: usize = 20_000;

/// Turns looked at where any turn might do.
const TURNS_SAMPLED: u32 = 16;

/// Of the information of translations: below this the part slides freely.
const SLIDING: f64 = 1e-12;

/// All poses in which the part touches every line from its inner side and its outline passes through every point.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::{ConvexPolygon, SimplePolygon};
/// use palpate::inscription::{HalfPlane, Inscription, poses_through};
///
/// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
/// let block = ConvexPolygon::new(&block)?;
/// // On the floor, against a stop on the left, and a probe has felt its right side.
/// let lines = [(-1.570796326794897, 0.0), (3.141592653589793, 0.0)].map(|(angle, offset)| HalfPlane::new(angle, offset));
/// let Inscription::Poses(poses) = poses_through(&block, &lines, &[Point2::new(0.06, 0.015)]) else { unreachable!() };
/// assert!(poses.iter().any(|pose| pose.x.hypot(pose.y) < 1e-9 && pose.theta < 1e-9));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn poses_through(part: &ConvexPolygon, lines: &[HalfPlane], points: &[Point2<f64>]) -> Inscription {
    if points.is_empty() {
        return poses(part, lines);
    }
    let problem = Mixed::new(part, lines, points);
    if determined(part, lines).is_ok() {
        let Inscription::Poses(candidates) = poses(part, lines) else { return Inscription::Poses(Vec::new()) };
        return problem.judged(candidates.iter().map(|pose| problem.placed_at(pose)).collect());
    }
    problem.poses()
}

/// The information about (x, y, size·θ) of a pose's centre in what a part touches: the sum of squared gradients of its
/// misses.
pub(super) fn information(
    part: &ConvexPolygon,
    lines: &[HalfPlane],
    points: &[Point2<f64>],
    pose: &Pose,
) -> Matrix3<f64> {
    let problem = Mixed::new(part, lines, points);
    problem.judge(&problem.placed_at(pose)).information
}

/// A part with lines and points, seen from one of them.
struct Mixed<'a> {
    part: &'a ConvexPolygon,
    lines: &'a [HalfPlane],
    /// Those that differ, from the origin.
    points: Vec<Vector2<f64>>,
    origin: Point2<f64>,
    miss_max: f64,
}

/// The part's centre from the origin, and its turn.
#[derive(Clone, Copy, Debug)]
struct Placed {
    centre: Vector2<f64>,
    theta: f64,
}

/// How all readings judge a pose.
struct Judgement {
    /// The largest miss, m.
    miss: f64,
    information: Matrix3<f64>,
    gradient: Vector3<f64>,
}

/// One of the three readings that are solved for.
#[derive(Clone, Copy, Debug)]
enum Reading {
    Line(HalfPlane),
    Point(Vector2<f64>),
}

/// A reading with what touches it: the corner on a line, the edge through a point.
type Held = (Reading, usize);

impl<'a> Mixed<'a> {
    fn new(part: &'a ConvexPolygon, lines: &'a [HalfPlane], points: &[Point2<f64>]) -> Self {
        let origin = points.first().copied().or(lines.first().map(|line| line.point)).unwrap_or_default();
        let mut distinct: Vec<Vector2<f64>> = Vec::with_capacity(points.len());
        for point in points.iter().map(|point| point - origin) {
            if distinct.iter().all(|other| (other - point).norm() > SAME_POINT_RELATIVE * part.size()) {
                distinct.push(point);
            }
        }
        Self { part, lines, points: distinct, origin, miss_max: MISS_MAX_RELATIVE * part.size() }
    }

    fn poses(&self) -> Inscription {
        let Some(three) = self.three() else {
            return Inscription::Underdetermined(Continuum::TooFewReadings {
                lines: self.distinct_lines().len(),
                points: self.points.len(),
            });
        };
        let mut candidates = Vec::new();
        for edges in self.edges_through(&three) {
            if self.collect(&three, &edges, &mut candidates).is_none() {
                return Inscription::Underdetermined(Continuum::Loose);
            }
        }
        self.judged(candidates)
    }

    /// Lines that differ in direction or place.
    fn distinct_lines(&self) -> Vec<HalfPlane> {
        let mut distinct: Vec<HalfPlane> = Vec::new();
        for line in self.lines {
            let same = |other: &HalfPlane| {
                (other.normal - line.normal).norm() < PARALLEL.sqrt() && other.beyond(line.point).abs() < self.miss_max
            };
            if !distinct.iter().any(same) {
                distinct.push(*line);
            }
        }
        distinct
    }

    /// Three readings that fix the part as well as may be: lines before points, those least parallel; points far apart.
    fn three(&self) -> Option<[Reading; 3]> {
        let lines = self.distinct_lines();
        let first = lines.first();
        let sine = |line: &&HalfPlane| first.map_or(0.0, |first| first.normal.perp(&line.normal).abs());
        // Two lines meet best where they are least parallel.
        let second = lines.iter().skip(1).max_by(|a, b| sine(a).total_cmp(&sine(b)));
        // Two lines and the point farthest off their meeting; one line and two points; or three points far apart.
        match (first, second) {
            (Some(&a), Some(&b)) => {
                let off = |point: &Vector2<f64>| self.off_meeting(a, b, point);
                let point = self.points.iter().max_by(|p, q| off(p).total_cmp(&off(q)))?;
                Some([Reading::Line(a), Reading::Line(b), Reading::Point(*point)])
            }
            (Some(&line), None) => {
                let [a, b] = self.far_pair()?;
                Some([Reading::Line(line), Reading::Point(a), Reading::Point(b)])
            }
            _ => {
                let [a, b] = self.far_pair()?;
                let beside = |p: &&Vector2<f64>| (b - a).perp(&(*p - a)).abs();
                let others = self.points.iter().filter(|p| **p != a && **p != b);
                let third = others.max_by(|p, q| beside(p).total_cmp(&beside(q)))?;
                Some([a, b, *third].map(Reading::Point))
            }
        }
    }

    /// How far a point is from where two lines meet; 0 beside the point of no return where they are parallel.
    fn off_meeting(&self, a: HalfPlane, b: HalfPlane, point: &Vector2<f64>) -> f64 {
        let at = self.origin + point;
        a.beyond(at).abs().max(b.beyond(at).abs())
    }

    fn far_pair(&self) -> Option<[Vector2<f64>; 2]> {
        let pairs = self.points.iter().enumerate().flat_map(|(k, a)| self.points[..k].iter().map(|b| [*a, *b]));
        pairs.max_by(|[a, b], [c, d]| (a - b).norm_squared().total_cmp(&(c - d).norm_squared()))
    }

    /// The choices of edges for the points of three readings.
    fn edges_through(&self, three: &[Reading; 3]) -> Vec<Vec<usize>> {
        let points: Vec<_> = three.iter().filter_map(Reading::point).collect();
        let n = self.part.corners().len();
        let mut choices: Vec<Vec<usize>> = vec![Vec::new()];
        for (k, point) in points.iter().enumerate() {
            let fits = |choice: &[usize], edge: usize| {
                (0..k).all(|other| self.can_hold([choice[other], edge], (point - points[other]).norm()))
            };
            choices = choices
                .iter()
                .flat_map(|choice| (0..n).map(move |edge| (choice, edge)))
                .filter(|(choice, edge)| fits(choice, *edge))
                .map(|(choice, edge)| [choice.as_slice(), &[edge]].concat())
                .collect();
        }
        choices
    }

    fn edge(&self, edge: usize) -> [Vector2<f64>; 2] {
        let corners = self.part.corners();
        [corners[edge], corners[(edge + 1) % corners.len()]]
    }

    /// Whether points so far apart can be on two edges.
    fn can_hold(&self, [a, b]: [usize; 2], distance: f64) -> bool {
        let ([p, q], [r, s]) = (self.edge(a), self.edge(b));
        let farthest = [p - r, p - s, q - r, q - s].map(|v| v.norm()).into_iter().fold(0.0, f64::max);
        let nearest = if a == b {
            0.0
        } else {
            // Edges of a convex polygon do not cross, so one end is nearest.
            let from = |point: Vector2<f64>, [start, end]: [Vector2<f64>; 2]| {
                distance_to_segment(point.into(), start.into(), end.into())
            };
            from(p, [r, s]).min(from(q, [r, s])).min(from(r, [p, q])).min(from(s, [p, q]))
        };
        let room = WORTH_IMPROVING_RELATIVE * self.part.size();
        (nearest - room..=farthest + room).contains(&distance)
    }

    /// Poses that put these edges on the points; none if any turn does.
    fn collect(&self, three: &[Reading; 3], edges: &[usize], candidates: &mut Vec<Placed>) -> Option<()> {
        if let &[a, b, c] = edges
            && a == b
            && b == c
        {
            candidates.extend(self.along_edge(three, a));
            return Some(());
        }
        for [from, to] in self.intervals(three) {
            let held = self.held(three, edges, f64::midpoint(from, to));
            let wave = Wave::of(|theta| self.determinant(&held, theta));
            if wave.reach() <= VANISHING_RELATIVE * self.part.size() {
                let share = |k: u32| (f64::from(k) + 0.5) / f64::from(TURNS_SAMPLED);
                let mut turns = (0..TURNS_SAMPLED).map(|k| from + (to - from) * share(k));
                if turns.any(|theta| self.accepted(self.place(&held, theta)).is_some()) {
                    return None;
                }
                continue;
            }
            let mut turns = Vec::new();
            let mut search =
                Search { bend: wave.bend(), miss_max: self.miss_max, intervals_left: INTERVALS_MAX, span: [from, to] };
            isolate(&|theta| wave.at(theta), [from, to], &mut search, &mut turns);
            candidates.extend(turns.into_iter().map(|theta| self.place(&held, theta)));
        }
        Some(())
    }

    /// Three points on one edge: it lies along them, one way round or the other, with as much of it on either side. The
    /// part slides along them as far as the edge is longer.
    fn along_edge(&self, three: &[Reading; 3], edge: usize) -> Vec<Placed> {
        let points: Vec<_> = three.iter().filter_map(Reading::point).collect();
        let along = points[1] - points[0];
        let [from, to] = self.edge(edge);
        let normal = self.part.normals()[edge];
        let turns =
            [PI / 2.0, -PI / 2.0].map(|turn| wrap_angle(along.y.atan2(along.x) + turn - self.part.angles()[edge]));
        let placed = turns.map(|theta| {
            let turned = Rotation2::new(theta) * normal;
            let tangent = Vector2::new(-turned.y, turned.x);
            let places = || points.iter().map(|point| tangent.dot(point));
            let middle =
                f64::midpoint(places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
            let height = points.iter().map(|point| turned.dot(point)).sum::<f64>() / points.len() as f64;
            let on_edge = Rotation2::new(theta) * ((from + to) / 2.0);
            let centre = tangent * (middle - tangent.dot(&on_edge)) + turned * (height - turned.dot(&on_edge));
            Placed { centre, theta }
        });
        placed.to_vec()
    }

    /// The turns between which the same corners touch the lines.
    fn intervals(&self, three: &[Reading; 3]) -> Vec<[f64; 2]> {
        let lines = three.iter().filter_map(Reading::line);
        let mut ends: Vec<f64> =
            lines.flat_map(|line| self.part.angles().iter().map(move |edge| wrap_angle(line.angle - edge))).collect();
        ends.extend([-PI, PI]);
        ends.sort_by(f64::total_cmp);
        ends.windows(2).map(|pair| [pair[0], pair[1]]).filter(|[from, to]| to > from).collect()
    }

    fn held(&self, three: &[Reading; 3], edges: &[usize], theta: f64) -> Vec<Held> {
        let mut edges = edges.iter();
        let feature = |reading: &Reading| match reading {
            Reading::Line(line) => self.part.support(wrap_angle(line.angle - theta)),
            Reading::Point(_) => edges.next().copied().unwrap_or(0),
        };
        let features: Vec<_> = three.iter().map(feature).collect();
        three.iter().copied().zip(features).collect()
    }

    /// The row and the right side of a reading.
    fn equation(&self, (reading, feature): &Held, theta: f64) -> (Vector2<f64>, f64) {
        let turn = Rotation2::new(theta);
        let corner = self.part.corners()[*feature];
        match reading {
            Reading::Line(line) => {
                (line.normal, line.normal.dot(&(line.point - self.origin)) - line.normal.dot(&(turn * corner)))
            }
            Reading::Point(point) => {
                let normal = self.part.normals()[*feature];
                (turn * normal, (turn * normal).dot(point) - normal.dot(&corner))
            }
        }
    }

    /// Zero where a place fits all three.
    fn determinant(&self, held: &[Held], theta: f64) -> f64 {
        let [(a, p), (b, q), (c, r)] = [0, 1, 2].map(|k| self.equation(&held[k], theta));
        b.perp(&c) * p + c.perp(&a) * q + a.perp(&b) * r
    }

    /// The place that fits three readings best at a turn.
    fn place(&self, held: &[Held], theta: f64) -> Placed {
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for (row, value) in held.iter().map(|held| self.equation(held, theta)) {
            normal += row * row.transpose();
            right += row * value;
        }
        let inverse = normal.pseudo_inverse(SLIDING).unwrap_or_else(|_| Matrix2::zeros());
        Placed { centre: inverse * right, theta }
    }

    fn placed_at(&self, pose: &Pose) -> Placed {
        let centre = Isometry2::new(Vector2::new(pose.x, pose.y), pose.theta) * self.part.centre();
        Placed { centre: centre - self.origin, theta: wrap_angle(pose.theta) }
    }

    /// All readings at a pose, each with what is nearest to it there.
    fn judge(&self, placed: &Placed) -> Judgement {
        let mut judgement = Judgement { miss: 0.0, information: Matrix3::zeros(), gradient: Vector3::zeros() };
        let turn = Rotation2::new(placed.theta);
        let mut add = |miss: f64, row: Vector3<f64>| {
            judgement.miss = judgement.miss.max(miss.abs());
            judgement.information += row * row.transpose();
            judgement.gradient += row * miss;
        };
        for line in self.lines {
            let arm = turn * self.part.corners()[self.part.support(wrap_angle(line.angle - placed.theta))];
            let miss = line.normal.dot(&(arm + placed.centre - (line.point - self.origin)));
            add(miss, miss_gradient(line, arm, self.part.size()));
        }
        for point in &self.points {
            let at = turn.inverse() * (point - placed.centre);
            let (edge, beyond) = self.beyond_edges(at);
            let (normal, turned) = (self.part.normals()[edge], turn * self.part.normals()[edge]);
            add(beyond, Vector3::new(-turned.x, -turned.y, normal.perp(&at) / self.part.size()));
        }
        judgement
    }

    /// How far a point (part axes, from the centre) lies beyond the edge that it is farthest beyond.
    fn beyond_edges(&self, at: Vector2<f64>) -> (usize, f64) {
        let edges = self.part.normals().iter().zip(self.part.corners()).enumerate();
        let beyond = edges.map(|(edge, (normal, corner))| (edge, normal.dot(&(at - corner))));
        beyond.fold((0, f64::NEG_INFINITY), |most, next| if next.1 > most.1 { next } else { most })
    }

    /// The place once it is improved over all readings, if it then fits them; with how they judge it.
    fn accepted(&self, candidate: Placed) -> Option<(Placed, Judgement)> {
        let mut placed = candidate;
        let mut best = self.judge(&placed);
        if best.miss > WORTH_IMPROVING_RELATIVE * self.part.size() {
            return None;
        }
        for _ in 0..STEPS_MAX {
            let here = self.judge(&placed);
            let Ok(inverse) = here.information.pseudo_inverse(SLIDING) else { break };
            let step = inverse * here.gradient;
            let next = Placed { centre: placed.centre - step.xy(), theta: placed.theta - step.z / self.part.size() };
            let there = self.judge(&next);
            if there.miss >= best.miss {
                break;
            }
            (placed, best) = (next, there);
        }
        (best.miss <= self.miss_max).then_some((placed, best))
    }

    /// The candidates that fit everything, each once; a continuum if one of them is free to slide.
    fn judged(&self, candidates: Vec<Placed>) -> Inscription {
        let mut found: Vec<Pose> = Vec::new();
        for (placed, judgement) in candidates.into_iter().filter_map(|candidate| self.accepted(candidate)) {
            let translation = judgement.information.fixed_view::<2, 2>(0, 0).into_owned();
            if translation.symmetric_eigenvalues().min() < SLIDING {
                return Inscription::Underdetermined(Continuum::Loose);
            }
            let pose = self.pose(&placed);
            if !found.iter().any(|other| self.is_same(other, &pose)) {
                found.push(pose);
            }
        }
        found.sort_by(|a, b| a.theta.total_cmp(&b.theta));
        Inscription::Poses(found)
    }

    fn pose(&self, placed: &Placed) -> Pose {
        let carried = Rotation2::new(placed.theta) * self.part.centre().coords;
        let at = self.origin + placed.centre - carried;
        Pose { x: at.x, y: at.y, theta: full_turn(wrap_angle(placed.theta)) }
    }

    fn is_same(&self, a: &Pose, b: &Pose) -> bool {
        let reach = self.part.size() + self.part.centre().coords.norm();
        wrap_angle(a.theta - b.theta).abs() <= SAME_POSE && (a.x - b.x).hypot(a.y - b.y) <= SAME_POSE * reach
    }
}

impl Reading {
    fn point(&self) -> Option<Vector2<f64>> {
        match self {
            Self::Point(point) => Some(*point),
            Self::Line(_) => None,
        }
    }

    fn line(&self) -> Option<HalfPlane> {
        match self {
            Self::Line(line) => Some(*line),
            Self::Point(_) => None,
        }
    }
}

/// A trigonometric polynomial of degree 2: mean, then cosine and sine of θ and of 2θ.
#[derive(Clone, Copy, Debug)]
struct Wave {
    mean: f64,
    first: Vector2<f64>,
    second: Vector2<f64>,
}

impl Wave {
    /// The one with these values, from five of them.
    fn of(value: impl Fn(f64) -> f64) -> Self {
        let mut wave = Self { mean: 0.0, first: Vector2::zeros(), second: Vector2::zeros() };
        for k in 0..5_u8 {
            let theta = TAU * f64::from(k) / 5.0;
            let share = value(theta) / 5.0;
            wave.mean += share;
            wave.first += 2.0 * share * direction(theta);
            wave.second += 2.0 * share * direction(2.0 * theta);
        }
        wave
    }

    fn at(&self, theta: f64) -> (f64, f64) {
        let (one, two) = (direction(theta), direction(2.0 * theta));
        let value = self.mean + self.first.dot(&one) + self.second.dot(&two);
        (value, one.perp(&self.first) + 2.0 * two.perp(&self.second))
    }

    /// At least the largest |value|.
    fn reach(&self) -> f64 {
        self.mean.abs() + self.first.norm() + self.second.norm()
    }

    /// At least the largest second derivative.
    fn bend(&self) -> f64 {
        self.first.norm() + 4.0 * self.second.norm()
    }
}

fn direction(angle: f64) -> Vector2<f64> {
    let (sin, cos) = angle.sin_cos();
    Vector2::new(cos, sin)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const QUARTER: f64 = PI / 2.0;

    fn part(points: &[[f64; 2]]) -> Option<ConvexPolygon> {
        ConvexPolygon::hull_of_points(&points.iter().map(|p| Point2::from(*p)).collect::<Vec<_>>())
    }

    fn square() -> ConvexPolygon {
        part(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]).unwrap()
    }

    fn world(pose: [f64; 3]) -> Isometry2<f64> {
        Isometry2::new(Vector2::new(pose[0], pose[1]), pose[2])
    }

    /// A place on the outline, by its share of the edges.
    fn on_outline(part: &ConvexPolygon, pose: [f64; 3], share: f64) -> Point2<f64> {
        let n = part.corners().len();
        let along = share * f64::from(u32::try_from(n).unwrap());
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a few edges")]
        let edge = (along.floor() as usize).min(n - 1);
        let (a, b) = (part.corners()[edge], part.corners()[(edge + 1) % n]);
        world(pose) * (part.centre() + a + (b - a) * along.fract())
    }

    fn touching(part: &ConvexPolygon, pose: [f64; 3], angle: f64) -> HalfPlane {
        let corner = part.corners()[part.support(wrap_angle(angle - pose[2]))];
        let at = world(pose) * (part.centre() + corner);
        HalfPlane { point: at, ..HalfPlane::new(angle, 0.0) }
    }

    fn is_found(found: &Inscription, pose: [f64; 3]) -> bool {
        let Inscription::Poses(found) = found else { return false };
        let near = |other: &Pose| {
            wrap_angle(other.theta - pose[2]).abs() < 1e-6 && (other.x - pose[0]).hypot(other.y - pose[1]) < 1e-6
        };
        found.iter().any(near)
    }

    #[test]
    fn too_few_readings_and_loose_parts_are_told_apart() {
        let floor = HalfPlane::new(-QUARTER, 0.0);
        let at = |x: f64, y: f64| Point2::new(x, y);
        let free = |lines: &[HalfPlane], points: &[Point2<f64>]| match poses_through(&square(), lines, points) {
            Inscription::Underdetermined(continuum) => continuum,
            Inscription::Poses(poses) => panic!("{poses:?}"),
        };
        assert_eq!(free(&[floor], &[at(0.0, 0.5)]), Continuum::TooFewReadings { lines: 1, points: 1 });
        assert_eq!(free(&[floor, floor], &[at(0.0, 0.5); 2]), Continuum::TooFewReadings { lines: 1, points: 1 });
        // On the floor, and two more points of that edge.
        assert_eq!(free(&[floor], &[at(0.2, 0.0), at(0.6, 0.0)]), Continuum::Loose);
        assert_eq!(free(&[], &[at(0.2, 0.0), at(0.6, 0.0), at(0.4, 0.0)]), Continuum::Loose);
        // Three points that hardly leave their edge room to slide: the middle of what they leave is not nearest to them.
        let wedge = part(&[
            [0.931116447264682, 0.19167658380801267],
            [-0.9157614963202775, 0.5910915301057573],
            [-0.5984545763734518, -0.06502944614684332],
            [0.0, -0.2111536411477683],
        ]);
        let wedge = wedge.unwrap();
        let pose = [0.0, 0.0, 5.97705634416849];
        let shares = [0.9863924487140547, 0.7805980449117803, 0.9971184703077891];
        let probed = shares.map(|share| on_outline(&wedge, pose, share));
        let Inscription::Underdetermined(continuum) = poses_through(&wedge, &[], &probed) else { panic!("not loose") };
        assert_eq!(continuum, Continuum::Loose);
        // A vertex where two lines meet at an obtuse angle, and a probe that felt the same vertex.
        let wall = HalfPlane::new(PI + 0.5, 0.0);
        assert_eq!(free(&[floor, wall], &[at(0.0, 0.0)]), Continuum::Loose);
        // Jaws as wide as the part, and a probe on one of them.
        let ceiling = HalfPlane::new(QUARTER, 1.0);
        assert_eq!(free(&[floor, ceiling], &[at(0.3, 0.0)]), Continuum::Loose);
    }

    #[test]
    fn a_square_fills_a_right_angle_in_four_turns_only() {
        let corner = [HalfPlane::new(-QUARTER, 0.0), HalfPlane::new(PI, 0.0)];
        let Inscription::Poses(found) = poses_through(&square(), &corner, &[Point2::origin()]) else { panic!() };
        assert_eq!(found.len(), 4, "{found:?}");
    }

    #[test]
    fn a_square_between_jaws_is_stopped_by_a_probe() {
        let jaws = [HalfPlane::new(-QUARTER, 0.0), HalfPlane::new(QUARTER, 1.0)];
        let Inscription::Poses(found) = poses_through(&square(), &jaws, &[Point2::new(1.0, 0.4)]) else { panic!() };
        // Four turns, with the probe on its right side or on its left.
        assert_eq!(found.len(), 8, "{found:?}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        /// The pose that the readings were taken in is found, whatever they are, and all that is found fits them.
        #[test]
        fn the_true_pose_is_found(
            points in proptest::collection::vec([-1.0..1.0, -1.0..1.0_f64], 4..9), pose in [-1.0..1.0, -1.0..1.0, 0.0..6.2_f64],
            angles in proptest::collection::vec(0.0..6.2_f64, 0..4), shares in proptest::collection::vec(0.0..1.0_f64, 1..5),
        ) {
            let Some(part) = part(&points) else { return Ok(()) };
            prop_assume!(angles.len() + shares.len() > 2);
            let lines: Vec<_> = angles.iter().map(|angle| touching(&part, pose, *angle)).collect();
            let probed: Vec<_> = shares.iter().map(|share| on_outline(&part, pose, *share)).collect();
            let found = poses_through(&part, &lines, &probed);
            if let Inscription::Underdetermined(continuum) = &found {
                // Only points of one edge, or that lie where lines meet, can leave the part free.
                prop_assert_eq!(*continuum, Continuum::Loose);
                return Ok(());
            }
            prop_assert!(is_found(&found, pose), "{:?}", found);
            let Inscription::Poses(found) = found else { unreachable!() };
            for pose in found {
                let motion = world([pose.x, pose.y, pose.theta]);
                for point in &probed {
                    let at = motion.inverse() * point - part.centre();
                    let edges = part.normals().iter().zip(part.corners());
                    let beyond = edges.map(|(normal, corner)| normal.dot(&(at - corner))).fold(f64::NEG_INFINITY, f64::max);
                    prop_assert!(beyond.abs() < 1e-8, "{pose:?} leaves a point {beyond}");
                }
            }
        }

        /// A dense search over turns finds no pose that is not listed.
        #[test]
        fn no_pose_is_missed(
            points in proptest::collection::vec([-1.0..1.0, -1.0..1.0_f64], 3..6), pose in [-1.0..1.0, -1.0..1.0, 0.0..6.2_f64],
            angles in [0.0..2.5, 2.6..4.5_f64], share in 0.0..1.0_f64,
        ) {
            let Some(part) = part(&points) else { return Ok(()) };
            let lines = angles.map(|angle| touching(&part, pose, angle));
            let point = on_outline(&part, pose, share);
            let Inscription::Poses(found) = poses_through(&part, &lines, &[point]) else { return Ok(()) };
            // Pushed against both lines at a turn, the part has the point inside or outside.
            let beyond = |theta: f64| {
                let turn = Rotation2::new(theta);
                let reach = |line: &HalfPlane| {
                    let heights = part.corners().iter().map(|corner| line.normal.dot(&(turn * corner)));
                    line.normal.dot(&line.point.coords) - heights.fold(f64::NEG_INFINITY, f64::max)
                };
                let rows = Matrix2::from_rows(&[lines[0].normal.transpose(), lines[1].normal.transpose()]);
                let centre = rows.try_inverse().unwrap() * Vector2::new(reach(&lines[0]), reach(&lines[1]));
                let at = turn.inverse() * (point.coords - centre);
                let edges = part.normals().iter().zip(part.corners());
                edges.map(|(normal, corner)| normal.dot(&(at - corner))).fold(f64::NEG_INFINITY, f64::max)
            };
            const STEPS: u32 = 2000;
            let turn = |k: u32| TAU * f64::from(k) / f64::from(STEPS);
            for k in 0..STEPS {
                if (beyond(turn(k)) > 0.0) != (beyond(turn(k + 1)) > 0.0) {
                    let listed = found.iter().any(|pose| pose.theta >= turn(k) - 1e-9 && pose.theta <= turn(k + 1) + 1e-9);
                    prop_assert!(listed, "between {} and {}: {:?}", turn(k), turn(k + 1), found);
                }
            }
        }

        /// Three points cannot be told from where they were moved to.
        #[test]
        fn poses_move_with_their_points(
            points in proptest::collection::vec([-1.0..1.0, -1.0..1.0_f64], 4..8), shares in [0.0..0.3, 0.35..0.6, 0.7..1.0_f64],
            motion in [-1.0..1.0, -1.0..1.0, 0.0..6.2_f64],
        ) {
            let Some(part) = part(&points) else { return Ok(()) };
            let probed = shares.map(|share| on_outline(&part, [0.0; 3], share));
            let moved = probed.map(|point| world(motion) * point);
            let (Inscription::Poses(still), Inscription::Poses(moved)) =
                (poses_through(&part, &[], &probed), poses_through(&part, &[], &moved)) else { return Ok(()) };
            prop_assume!(still.windows(2).all(|pair| pair[1].theta - pair[0].theta > 1e-4));
            prop_assert_eq!(still.len(), moved.len());
        }
    }
}
