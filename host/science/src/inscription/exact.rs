//! All poses of a part inscribed in exact supporting lines.
//!
//! Three of the lines, chosen well apart, leave at most 6n poses ([`triple`](super::triple)); the others, and those
//! three once more, are verified for each by a binary search for the corner that touches. So O(n + m log n) for m
//! lines, as in the thesis's algorithms 1 and 2. A pose that misses by little is improved over all lines before it is
//! judged.
//!
//! Lines that are parallel, or meet in one point, leave a continuum of poses; then nothing is sampled from it.
//!
//! Frames: world; poses are of the outline's own frame. Units: m, rad.

use std::f64::consts::TAU;

use nalgebra::{Point2, Vector2, Vector3};

use super::readings::HalfPlane;
use super::triple::{PARALLEL, Triple, Turns};
use crate::geometry::{ConvexPolygon, Pose};
use crate::math::least_squares::{self, Damping, Enough, Floor, LeastSquaresSettings, NormalEquations};

/// A pose may miss a line by so much, as a share of the part's size (fixed by the interface).
pub const MISS_MAX_RELATIVE: f64 = 1e-9;

/// And by so much for each metre between the lines or to the frame's origin: what doubles lose there, with room for ten
/// roundings.
const MISS_MAX_FAR: f64 = 2e-15;

/// Candidates that miss by no more than this share of the size are improved before they are judged: three lines that
/// are nearly concurrent, or nearly tangent to what the part can do, place it only so well.
const WORTH_IMPROVING_RELATIVE: f64 = 1e-5;

/// Candidates that miss by less than this share of the size need no improvement.
const GOOD_RELATIVE: f64 = 1e-13;

/// How candidates are improved: from so near Gauss's and Newton's steps converge in two. Damping comes in where the
/// lines nearly leave a continuum.
const IMPROVEMENT: LeastSquaresSettings<3> = LeastSquaresSettings {
    damping: Damping {
        first: 0.0,
        min: 0.0,
        max: 1e6,
        up: 10.0,
        min_after_failure: 1e-3,
        down: 0.1,
        trusted_share: 0.0,
    },
    floor: Floor::NONE,
    enough: Enough { relative: 0.0, absolute: 0.0, damping_max: f64::INFINITY },
    trials_max: 4,
    steps_max: usize::MAX,
};

/// Poses nearer to each other than this, in part sizes and in rad, are one: the same root found from both sides of a
/// kink, or the two that rounding makes of a tangency. Those are the root of 1e-14 apart at most, and what is between
/// them touches too.
const SAME_POSE: f64 = 1e-6;

/// Lines that miss a common point by no more than this share of the part's size meet in it.
///
/// Apexes computed as equal differ by about 1e-16 of their distance from the origin; at 1e-12 a pose would be uncertain
/// by 1e-4 of the part's size.
const CONCURRENT_RELATIVE: f64 = 1e-12;

/// What supporting lines say about a part's pose.
#[derive(Clone, Debug, PartialEq)]
pub enum Inscription {
    /// Finitely many poses, perhaps none, by increasing theta.
    Poses(Vec<Pose>),
    /// A continuum of poses, or too little is known to exclude one.
    Underdetermined(Continuum),
}

/// Why lines leave a continuum of poses.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Continuum {
    /// Fewer than three different lines.
    #[error("{distinct} distinct lines leave the part free to move along them: take another view from elsewhere")]
    TooFewLines {
        /// Number of different lines.
        distinct: usize,
    },
    /// All lines have one direction.
    #[error("all lines are parallel: the part is free to move along them; take a view from another direction")]
    Parallel,
    /// All lines meet in one point.
    #[error(
        "all lines meet at ({:?}, {:?}): the part is free to turn in there, and lines through one point cannot tell its distance; \
         take a view from elsewhere",
        at.x, at.y
    )]
    Concurrent {
        /// Where, world, m.
        at: Point2<f64>,
    },
    /// Fewer than three lines and points.
    #[error("{lines} distinct lines and {points} points leave the part free to move: a pose takes three")]
    TooFewReadings {
        /// Number of different lines.
        lines: usize,
        /// Number of different points.
        points: usize,
    },
    /// All readings hold through a motion.
    #[error(
        "the part can slide or turn with every line touched and every point on its outline: add a line or a point elsewhere"
    )]
    Loose,
}

/// All poses in which the part lies in every half-plane and touches its line.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::{ConvexPolygon, SimplePolygon};
/// use palpate::inscription::{HalfPlane, Inscription, poses};
///
/// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
/// let block = ConvexPolygon::new(&block)?;
/// // Flush with the x axis and the y axis, and below a line at 45°.
/// let lines = [(-1.570796326794897, 0.0), (3.141592653589793, 0.0), (0.785398163397448, 0.0707106781186548)];
/// let lines = lines.map(|(angle, offset)| HalfPlane::new(angle, offset));
/// let Inscription::Poses(poses) = poses(&block, &lines) else { unreachable!() };
/// assert!(poses.iter().any(|pose| pose.x.hypot(pose.y) < 1e-9 && pose.theta < 1e-9));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[must_use]
pub fn poses(part: &ConvexPolygon, lines: &[HalfPlane]) -> Inscription {
    let problem = Problem::new(part, lines);
    match problem.triple() {
        Ok(triple) => Inscription::Poses(problem.poses(&triple)),
        Err(continuum) => Inscription::Underdetermined(continuum),
    }
}

/// How far the part in a pose is from touching each line, m: positive where it crosses the line.
#[must_use]
pub fn misses(part: &ConvexPolygon, lines: &[HalfPlane], pose: &Pose) -> Vec<f64> {
    let problem = Problem::new(part, lines);
    let placed = problem.placed_at(pose);
    (0..lines.len()).map(|line| problem.touch(line, &placed).miss).collect()
}

/// The poses that come nearest when there is none: each with the line it misses most and by how much, m, best first.
#[must_use]
pub fn nearest_misses(part: &ConvexPolygon, lines: &[HalfPlane]) -> Vec<(Pose, usize, f64)> {
    let problem = Problem::new(part, lines);
    let Ok(triple) = problem.triple() else { return Vec::new() };
    let turns = Turns::of(part, lines, &triple, f64::INFINITY);
    let judged = turns.found.iter().map(|&turn| {
        let placed = problem.place(turn, &triple);
        let misses = (0..lines.len()).map(|line| (line, problem.touch(line, &placed).miss));
        let (line, miss) = misses.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs())).unwrap_or((0, 0.0));
        (problem.to_pose(&placed), line, miss)
    });
    let mut judged: Vec<_> = judged.collect();
    judged.sort_by(|a, b| a.2.abs().total_cmp(&b.2.abs()));
    judged
}

/// Whether lines can determine a pose at all.
///
/// # Errors
/// [`Continuum`] says why not.
pub fn determined(part: &ConvexPolygon, lines: &[HalfPlane]) -> Result<(), Continuum> {
    Problem::new(part, lines).triple().map(|_| ())
}

/// The poses that touch three of the lines, for every three of them: places to begin from when lines are not exact.
pub(super) fn triple_poses(part: &ConvexPolygon, lines: &[HalfPlane]) -> Vec<Pose> {
    let problem = Problem::new(part, lines);
    let m = lines.len();
    let triples = (0..m).flat_map(|a| (a + 1..m).flat_map(move |b| (b + 1..m).map(move |c| [a, b, c])));
    let triples = triples.filter_map(|three| Triple::new(lines, &problem.offsets, three));
    let poses = triples.flat_map(|triple| {
        let turns = Turns::of(part, lines, &triple, problem.miss_max).found;
        turns.into_iter().map(|turn| problem.to_pose(&problem.place(turn, &triple))).collect::<Vec<_>>()
    });
    poses.filter(|pose| [pose.x, pose.y, pose.theta].iter().all(|value| value.is_finite())).collect()
}

/// A part and lines, seen from a point near the lines.
struct Problem<'a> {
    part: &'a ConvexPolygon,
    lines: &'a [HalfPlane],
    origin: Point2<f64>,
    /// c_k seen from there, m.
    offsets: Vec<f64>,
    miss_max: f64,
}

/// The part's centre seen from the problem's origin, and its turn.
#[derive(Clone, Copy)]
struct Placed {
    centre: Vector2<f64>,
    theta: f64,
    /// e^{iθ} as (cos θ, sin θ).
    turn: Vector2<f64>,
}

/// By how much a place misses the lines.
#[derive(Clone, Copy)]
struct Missed {
    placed: Placed,
    /// The largest miss, m.
    worst: f64,
    /// Sum of all misses squared, m².
    squares: f64,
}

/// A candidate being improved over all lines.
struct Improving<'p, 'a> {
    problem: &'p Problem<'a>,
    triple: &'p Triple,
}

impl least_squares::LeastSquaresProblem<3> for Improving<'_, '_> {
    type Place = Missed;

    fn cost(&self, missed: &Missed) -> f64 {
        missed.squares
    }

    /// By the centre and by size times the turn.
    fn normal_equations(&self, Missed { placed, .. }: &Missed) -> NormalEquations<3> {
        let Problem { part, lines, .. } = self.problem;
        let mut equations = NormalEquations::zero();
        for (index, line) in lines.iter().enumerate() {
            let Touch { miss, arm } = self.problem.touch(index, placed);
            equations.add(miss, miss_gradient(line, arm, part.size()));
        }
        equations
    }

    fn moved(&self, Missed { placed, .. }: &Missed, step: &Vector3<f64>) -> Option<Missed> {
        let theta = placed.theta + step.z / self.problem.part.size();
        let turn = Vector2::new(theta.cos(), theta.sin());
        let moved = Placed { centre: placed.centre + step.xy(), theta, turn };
        Some(self.problem.missed(moved, self.triple, f64::INFINITY))
    }
}

/// How the part meets one line.
struct Touch {
    /// Positive where it crosses the line, m.
    miss: f64,
    /// The touching corner from the centre, world axes.
    arm: Vector2<f64>,
}

impl<'a> Problem<'a> {
    fn new(part: &'a ConvexPolygon, lines: &'a [HalfPlane]) -> Self {
        let origin = lines.first().map_or_else(Point2::origin, |line| line.point);
        let offsets: Vec<_> = lines.iter().map(|line| line.normal.dot(&(line.point - origin))).collect();
        let far = lines.iter().map(|line| (line.point - origin).amax()).fold(origin.coords.amax(), f64::max);
        let miss_max = MISS_MAX_RELATIVE * part.size() + MISS_MAX_FAR * far;
        Self { part, lines, origin, offsets, miss_max }
    }

    /// Three lines far from concurrent.
    ///
    /// The second is the least parallel to the first, the third the farthest from concurrent with both: if there is any
    /// triple that is not concurrent, one like this exists.
    fn triple(&self) -> Result<Triple, Continuum> {
        let count = self.lines.len();
        let across = |line: usize| self.lines[0].normal.perp(&self.lines[line].normal).abs();
        let (second, sine) = largest((1..count).map(|line| (line, across(line))));
        if sine <= PARALLEL {
            return Err(self.continuum(None));
        }
        let apartness = |third: usize| Triple::apartness(self.lines, &self.offsets, [0, second, third]);
        let (third, apart) = largest((1..count).map(|line| (line, apartness(line))));
        let concurrent = CONCURRENT_RELATIVE * self.part.size() + MISS_MAX_FAR * self.origin.coords.amax();
        let triple = Triple::new(self.lines, &self.offsets, [0, second, third]).filter(|_| apart > concurrent);
        triple.ok_or_else(|| self.continuum(Some(second)))
    }

    /// Why there is no such triple; `second` is a line that is not parallel to the first.
    fn continuum(&self, second: Option<usize>) -> Continuum {
        let distinct = self.distinct_lines();
        match second {
            _ if distinct < 3 => Continuum::TooFewLines { distinct },
            None => Continuum::Parallel,
            Some(second) => Continuum::Concurrent { at: self.origin + self.meeting([0, second], [0.0; 2]) },
        }
    }

    fn distinct_lines(&self) -> usize {
        let same = |a: usize, b: usize| {
            let (a_line, b_line) = (&self.lines[a], &self.lines[b]);
            (a_line.normal - b_line.normal).norm() <= PARALLEL.sqrt()
                && (self.offsets[a] - self.offsets[b]).abs() <= CONCURRENT_RELATIVE.sqrt() * self.part.size()
                && a_line.normal.perp(&b_line.normal).abs() <= 1e2 * PARALLEL
                && (self.offsets[a] - self.offsets[b]).abs() <= self.miss_max
        };
        (0..self.lines.len()).filter(|&line| !(0..line).any(|earlier| same(earlier, line))).count()
    }

    /// Where two lines meet once each is moved inward by a height, seen from the origin.
    fn meeting(&self, [a, b]: [usize; 2], heights: [f64; 2]) -> Vector2<f64> {
        let (m, n) = (self.lines[a].normal, self.lines[b].normal);
        let (c, d) = (self.offsets[a] - heights[0], self.offsets[b] - heights[1]);
        Vector2::new(c * n.y - d * m.y, d * m.x - c * n.x) / m.perp(&n)
    }

    fn poses(&self, triple: &Triple) -> Vec<Pose> {
        let turns = Turns::of(self.part, self.lines, triple, self.miss_max).found;
        let placed = turns.iter().filter_map(|&turn| self.verified(self.place(turn, triple), triple));
        let mut poses: Vec<Pose> = Vec::with_capacity(4);
        for pose in placed.map(|placed| self.to_pose(&placed)) {
            match poses.iter_mut().find(|other| self.is_same(other, &pose)) {
                Some(other) => *other = halfway(other, &pose),
                None => poses.push(pose),
            }
        }
        poses.sort_by(|a, b| a.theta.total_cmp(&b.theta));
        poses
    }

    /// The position that goes with a turn: from the two lines of the triple that cross at the best angle.
    fn place(&self, turn: Vector2<f64>, triple: &Triple) -> Placed {
        let [a, b, c] = triple.lines;
        let [x, y, z] = triple.weights.map(f64::abs);
        // A weight is the sine of the angle between the two other lines.
        let pair = if z >= x && z >= y {
            [a, b]
        } else if y >= x {
            [a, c]
        } else {
            [b, c]
        };
        let theta = turn.y.atan2(turn.x);
        let turned = Placed { centre: Vector2::zeros(), theta, turn };
        let heights = pair.map(|line| self.lines[line].normal.dot(&self.arm(line, &turned)));
        Placed { centre: self.meeting(pair, heights), ..turned }
    }

    /// The corner that touches a line, from the part's centre, world axes.
    #[inline]
    fn arm(&self, line: usize, placed: &Placed) -> Vector2<f64> {
        let corner = self.part.corners()[self.part.support(self.lines[line].angle - placed.theta)];
        let Vector2 { data: nalgebra::ArrayStorage([[cos, sin]]), .. } = placed.turn;
        Vector2::new(cos * corner.x - sin * corner.y, sin * corner.x + cos * corner.y)
    }

    #[inline]
    fn touch(&self, line: usize, placed: &Placed) -> Touch {
        let arm = self.arm(line, placed);
        Touch { miss: self.lines[line].normal.dot(&(arm + placed.centre)) - self.offsets[line], arm }
    }

    /// What a place misses, the lines after the first that it misses by more than a limit left out.
    ///
    /// The lines of the triple come last: only the others exclude a candidate.
    fn missed(&self, placed: Placed, triple: &Triple, limit: f64) -> Missed {
        let mut missed = Missed { placed, worst: 0.0, squares: 0.0 };
        let others = (0..self.lines.len()).filter(|line| !triple.lines.contains(line));
        for line in others.chain(triple.lines) {
            let miss = self.touch(line, &placed).miss;
            missed.worst = missed.worst.max(miss.abs());
            missed.squares += miss * miss;
            if missed.worst > limit {
                break;
            }
        }
        missed
    }

    /// The place if it touches all lines, perhaps after improvement.
    fn verified(&self, candidate: Placed, triple: &Triple) -> Option<Placed> {
        let limit = self.miss_max + WORTH_IMPROVING_RELATIVE * self.part.size();
        let mut best = self.missed(candidate, triple, limit);
        if best.worst > limit {
            return None;
        }
        let good = GOOD_RELATIVE * self.part.size();
        if best.worst > good {
            let improving = Improving { problem: self, triple };
            let stop = |trial: &least_squares::Trial<'_, Missed>| trial.place.worst <= good;
            let improved = least_squares::minimise(&improving, best, &IMPROVEMENT, stop).place;
            // What has the smaller squares may still miss one line by more.
            best = if improved.worst < best.worst { improved } else { best };
        }
        (best.worst <= self.miss_max).then_some(best.placed)
    }

    fn to_pose(&self, placed: &Placed) -> Pose {
        let Vector2 { data: nalgebra::ArrayStorage([[cos, sin]]), .. } = placed.turn;
        let centre = self.part.centre();
        let carried = Vector2::new(cos * centre.x - sin * centre.y, sin * centre.x + cos * centre.y);
        let at = self.origin + (placed.centre - carried);
        Pose { x: at.x, y: at.y, theta: full_turn(placed.theta) }
    }

    fn placed_at(&self, pose: &Pose) -> Placed {
        let (sin, cos) = pose.theta.sin_cos();
        let centre = self.part.centre();
        let carried = Vector2::new(cos * centre.x - sin * centre.y, sin * centre.x + cos * centre.y);
        let theta = crate::math::angle::wrap_angle(pose.theta);
        Placed { centre: Point2::new(pose.x, pose.y) + carried - self.origin, theta, turn: Vector2::new(cos, sin) }
    }

    fn is_same(&self, a: &Pose, b: &Pose) -> bool {
        let apart = (a.theta - b.theta).abs();
        let distance = (a.x - b.x).hypot(a.y - b.y);
        // Turning about a far origin moves it by more than it moves the part.
        let reach = self.part.size() + self.part.centre().coords.norm();
        apart.min(TAU - apart) <= SAME_POSE && distance <= SAME_POSE * reach
    }
}

/// Between two poses that are nearly the same.
fn halfway(a: &Pose, b: &Pose) -> Pose {
    let turn = crate::math::angle::wrap_angle(b.theta - a.theta);
    Pose { x: f64::midpoint(a.x, b.x), y: f64::midpoint(a.y, b.y), theta: full_turn(a.theta + turn / 2.0) }
}

/// The first largest of measures, with its index; 0 and 0 of none above 0.
fn largest(measures: impl Iterator<Item = (usize, f64)>) -> (usize, f64) {
    measures.fold((0, 0.0), |best, next| if next.1 > best.1 { next } else { best })
}

/// How a miss changes with the part's centre and with size times its turn.
pub(super) fn miss_gradient(line: &HalfPlane, arm: Vector2<f64>, size: f64) -> Vector3<f64> {
    Vector3::new(line.normal.x, line.normal.y, arm.perp(&line.normal) / size)
}

/// The same angle in [0, 2π).
pub(super) fn full_turn(angle: f64) -> f64 {
    let turned = if angle < 0.0 { angle + TAU } else { angle };
    // A negative rounding error becomes 2π itself.
    if (0.0..TAU).contains(&turned) { turned } else { turned.rem_euclid(TAU) % TAU }
}
