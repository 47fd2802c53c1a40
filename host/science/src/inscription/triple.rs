//! Three supporting lines: the turns of the part at which it touches all of them.
//!
//! A part turned by θ whose reference point is at t touches line k, {q : u_k·q = c_k}, where h(β_k − θ) + u_k·t = c_k;
//! h is the part's support function and β_k the polar angle of u_k. With λ such that Σ λ_k u_k = 0 the position drops
//! out:
//!
//! ```text
//! g(θ) = Σ λ_k h(β_k − θ) − Σ λ_k c_k = 0,   λ = (sin(β₃ − β₂), sin(β₁ − β₃), sin(β₂ − β₁))
//! ```
//!
//! Between two turns at which an edge is flush with a line the same three corners touch, and g is Re(z W) − C with z =
//! e^{iθ}, W = Σ λ_k ū_k v_k and C = Σ λ_k c_k: a sinusoid with at most two roots. There are at most 3n such stretches,
//! so at most 6n poses (thesis, theorem 2; this form has none of its special cases). One sweep over the stretches
//! visits all of them in O(n), without an angle function: z at a flush edge is ū_k times the edge's normal.
//!
//! With many corners most stretches are far from a root. No corner is farther than r from the reference point, so g
//! cannot change by more than r|Δθ|, and a stretch of |g|/r ahead has no root: where that is worth a binary search, the
//! sweep leaps.
//!
//! Whether g changes its sign is decided by its values at the ends, computed once for the two stretches they belong to.
//! So crossings come in pairs, as they must for a periodic function, whatever the rounding errors are.
//!
//! Complex numbers are vectors (re, im). Units: m, rad.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::readings::{HalfPlane, wrapped};
use crate::geometry::ConvexPolygon;

/// Where |g| is below this share of the part's size, it may be zero: a tangency, or a flush edge at a kink.
///
/// Sums of some products, each rounded at 1e-16 of the size; a hundred roundings leave room for lines from far away.
const ROUNDING_RELATIVE: f64 = 1e-14;

/// Where the sweep ends, rad: late enough that an edge flush at θ = 0 is met at a full turn, whatever rounding makes of
/// it.
const SWEEP_END: f64 = TAU + 1e-9;

/// Room for the roots of most parts.
const ROOTS_USUAL: usize = 16;

/// A leap must be worth so many stretches: what three binary searches and a sine cost.
const LEAP_STRETCHES: f64 = 8.0;

/// Share of the way to the nearest possible root that a leap goes, so that rounding never takes it past one.
const LEAP_SHARE: f64 = 0.999;

/// Three lines by their numbers, with what makes the position drop out.
#[derive(Clone, Copy, Debug)]
pub(super) struct Triple {
    pub lines: [usize; 3],
    /// λ, scaled so that Σ |λ| = 1: then |g| is the largest distance by which the part must miss one of the lines.
    pub weights: [f64; 3],
    /// C, m. How far the lines are from meeting in one point.
    pub offset: f64,
}

impl Triple {
    /// None if the lines are parallel.
    pub(super) fn new(half_planes: &[HalfPlane], offsets: &[f64], lines: [usize; 3]) -> Option<Self> {
        let (weights, sum, offset) = Self::unscaled(half_planes, offsets, lines);
        if sum < PARALLEL {
            return None;
        }
        Some(Self { lines, weights: weights.map(|weight| weight / sum), offset: offset / sum })
    }

    /// How far three lines are from meeting in one point, as |C|, m.
    #[inline]
    pub(super) fn apartness(half_planes: &[HalfPlane], offsets: &[f64], lines: [usize; 3]) -> f64 {
        let (_, sum, offset) = Self::unscaled(half_planes, offsets, lines);
        if sum < PARALLEL { 0.0 } else { offset.abs() / sum }
    }

    /// λ, Σ |λ| and C before they are scaled.
    #[inline]
    fn unscaled(half_planes: &[HalfPlane], offsets: &[f64], lines: [usize; 3]) -> ([f64; 3], f64, f64) {
        let [a, b, c] = lines.map(|line| half_planes[line].normal);
        let weights = [b.perp(&c), c.perp(&a), a.perp(&b)];
        let sum = weights[0].abs() + weights[1].abs() + weights[2].abs();
        let [c, d, e] = lines.map(|line| offsets[line]);
        (weights, sum, weights[0] * c + weights[1] * d + weights[2] * e)
    }
}

/// Lines whose directions differ by less than this count as parallel, rad: ten times what is left of an angle when a
/// turn is added to it and taken off again.
pub(super) const PARALLEL: f64 = 1e-14;

/// Turns of the part at which it may touch three lines.
pub(super) struct Turns {
    /// Unit complex numbers e^{iθ}.
    pub found: Vec<Vector2<f64>>,
    /// Near misses up to this count too, m.
    miss_max: f64,
    /// |g| below this may be 0, m.
    rounding: f64,
}

/// The sweep over θ.
struct Sweep<'a> {
    part: &'a ConvexPolygon,
    half_planes: [HalfPlane; 3],
    weights: [f64; 3],
    lines: [Line; 3],
    offset: f64,
    /// For each metre of |g|, the angle ahead without a root, rad.
    clear_a_metre: f64,
    /// A leap over this angle is cheaper than going from edge to edge, rad.
    leap_min: f64,
}

/// One line in the sweep.
#[derive(Clone, Copy)]
struct Line {
    conjugate: Vector2<f64>,
    weighted_conjugate: Vector2<f64>,
    corner: usize,
    /// λ_k ū_k v_k for that corner.
    term: Vector2<f64>,
    /// θ at which the edge before the corner lies on the line.
    next: f64,
    /// θ = `base` − the normal's angle there.
    base: f64,
}

/// g at a turn: its value and slope, and the sinusoid it belongs to.
#[derive(Clone, Copy)]
struct End {
    turn: Vector2<f64>,
    value: f64,
    slope: f64,
}

impl Turns {
    /// All turns at which the part touches three lines, and those at which it misses them by no more than `miss_max`
    /// (m).
    pub(super) fn of(part: &ConvexPolygon, half_planes: &[HalfPlane], triple: &Triple, miss_max: f64) -> Self {
        let sweep = Sweep::new(part, half_planes, triple);
        let rounding = ROUNDING_RELATIVE * (part.size() + triple.offset.abs());
        let mut turns = Self { found: Vec::with_capacity(ROOTS_USUAL), miss_max: miss_max.max(rounding), rounding };
        turns.collect(sweep);
        turns
    }

    fn collect(&mut self, mut sweep: Sweep<'_>) {
        let mut wave = sweep.wave();
        let first = sweep.end(wave, Vector2::x());
        let mut start = first;
        let mut theta = 0.0;
        loop {
            // |g| changes by at most r|Δθ|: far from zero a stretch ahead is without a root.
            let clear = (start.value.abs() - self.miss_max) * sweep.clear_a_metre;
            if clear > sweep.leap_min {
                theta += clear;
                if theta > SWEEP_END {
                    return;
                }
                sweep.leap(theta);
                wave = sweep.wave();
                start = sweep.end(wave, Vector2::new(theta.cos(), theta.sin()));
            }
            // Otherwise up to the next turn at which an edge lies flush on one of the lines.
            let line = sweep.next_line();
            if sweep.lines[line].next > SWEEP_END {
                break;
            }
            theta = sweep.lines[line].next;
            let turn = sweep.flush_turn(line);
            let end = sweep.end(wave, turn);
            self.stretch(&start, &end, wave, sweep.offset);
            // There the corner changes: g is continuous, its slope jumps.
            sweep.advance(line);
            wave = sweep.wave();
            let after = End { slope: slope(wave, turn), ..end };
            self.kink(&end, &after);
            start = after;
        }
        // The last stretch ends where the first began: g(2π) = g(0), to the same digits.
        let last = End { value: first.value, ..sweep.end(wave, Vector2::x()) };
        self.stretch(&start, &last, wave, sweep.offset);
    }

    /// Roots between two flush turns.
    #[inline(always)]
    fn stretch(&mut self, start: &End, end: &End, wave: Vector2<f64>, offset: f64) {
        let (above, ends_above) = (start.value >= 0.0, end.value >= 0.0);
        let toward_zero = (start.slope < 0.0) == above;
        let from_zero = (end.slope > 0.0) == ends_above;
        // Without a short circuit: one branch, seldom taken.
        if (above != ends_above) | (toward_zero & from_zero) {
            self.roots(above, ends_above, wave, offset);
        }
    }

    #[cold]
    fn roots(&mut self, above: bool, ends_above: bool, wave: Vector2<f64>, offset: f64) {
        match (above, ends_above) {
            (true, false) => self.found.push(crossing(wave, offset, 1.0)),
            (false, true) => self.found.push(crossing(wave, offset, -1.0)),
            (true, true) => self.bottom(wave, offset, -1.0),
            (false, false) => self.bottom(wave, offset, 1.0),
        }
    }

    /// An extremum that points toward zero: of g = Re(zW) − C the least where `sign` is −1, the largest where it is 1.
    fn bottom(&mut self, wave: Vector2<f64>, offset: f64, sign: f64) {
        // Positive once g is past zero there.
        let past = wave.norm() - sign * offset;
        if past > self.rounding {
            self.found.extend([crossing(wave, offset, 1.0), crossing(wave, offset, -1.0)]);
        } else if past >= -self.miss_max {
            self.found.push(sign * Vector2::new(wave.x, -wave.y) / wave.norm());
        }
    }

    /// A flush turn at which g comes near zero without crossing it, or is zero but for rounding.
    #[inline(always)]
    fn kink(&mut self, before: &End, after: &End) {
        let miss = before.value.abs();
        if miss > self.miss_max {
            return;
        }
        let sign = before.value.signum();
        if miss <= self.rounding || (sign * before.slope <= 0.0 && sign * after.slope >= 0.0) {
            self.found.push(before.turn);
        }
    }
}

impl<'a> Sweep<'a> {
    fn new(part: &'a ConvexPolygon, half_planes: &[HalfPlane], triple: &Triple) -> Self {
        let half_planes = triple.lines.map(|line| half_planes[line]);
        let line = |k: usize| Line::new(part, &half_planes[k], triple.weights[k], 0.0);
        let corners = f64::from(u32::try_from(part.corners().len()).unwrap_or(u32::MAX));
        Self {
            part,
            half_planes,
            weights: triple.weights,
            lines: [line(0), line(1), line(2)],
            offset: triple.offset,
            clear_a_metre: LEAP_SHARE / part.reach(),
            leap_min: LEAP_STRETCHES * TAU / (3.0 * corners),
        }
    }

    /// Goes to a turn without looking at what is between.
    fn leap(&mut self, theta: f64) {
        self.lines = [0, 1, 2].map(|k| Line::new(self.part, &self.half_planes[k], self.weights[k], theta));
    }

    /// W of g(θ) = Re(zW) − C, until the next change of a corner, m.
    #[inline]
    fn wave(&self) -> Vector2<f64> {
        self.lines[0].term + self.lines[1].term + self.lines[2].term
    }

    #[inline]
    fn end(&self, wave: Vector2<f64>, turn: Vector2<f64>) -> End {
        End { turn, value: turn.x * wave.x - turn.y * wave.y - self.offset, slope: slope(wave, turn) }
    }

    /// The line on which an edge comes to lie next.
    #[inline]
    fn next_line(&self) -> usize {
        let [a, b, c] = self.lines.map(|line| line.next);
        let ab = usize::from(b < a);
        if c < a.min(b) { 2 } else { ab }
    }

    /// e^{iθ} where the next edge of this line's corner lies flush on the line.
    #[inline]
    fn flush_turn(&self, line: usize) -> Vector2<f64> {
        let Line { conjugate, corner, .. } = self.lines[line];
        let normal = self.part.normals()[before(corner, self.part.corners().len())];
        // u_k times the conjugate of the normal.
        Vector2::new(
            conjugate.x * normal.x - conjugate.y * normal.y,
            -(conjugate.x * normal.y + conjugate.y * normal.x),
        )
    }

    #[inline]
    fn advance(&mut self, line: usize) {
        self.lines[line].advance(self.part);
    }
}

impl Line {
    /// At a turn in [0, 2π).
    fn new(part: &ConvexPolygon, half_plane: &HalfPlane, weight: f64, theta: f64) -> Self {
        let conjugate = Vector2::new(half_plane.normal.x, -half_plane.normal.y);
        let facing = wrapped(half_plane.angle - theta);
        let corner = part.support(facing);
        let edge = before(corner, part.corners().len());
        // The edge before the corner is behind what faces the line; the last edge may be so only a full turn on.
        let turns = if part.angles()[edge] > facing { TAU } else { 0.0 };
        let base = facing + theta + turns;
        let weighted_conjugate = weight * conjugate;
        let term = product(weighted_conjugate, part.corners()[corner]);
        Self { conjugate, weighted_conjugate, corner, term, next: base - part.angles()[edge], base }
    }

    /// Turns the part past the flush edge to the corner before it.
    #[inline]
    fn advance(&mut self, part: &ConvexPolygon) {
        let n = part.corners().len();
        self.corner = before(self.corner, n);
        self.term = product(self.weighted_conjugate, part.corners()[self.corner]);
        if self.corner == 0 {
            self.base += TAU;
        }
        self.next = self.base - part.angles()[before(self.corner, n)];
    }
}

#[inline]
fn before(corner: usize, n: usize) -> usize {
    if corner == 0 { n - 1 } else { corner - 1 }
}

/// The product of two complex numbers.
#[inline]
fn product(a: Vector2<f64>, b: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x)
}

/// dg/dθ = −Im(zW), m/rad.
#[inline]
fn slope(wave: Vector2<f64>, turn: Vector2<f64>) -> f64 {
    -(turn.x * wave.y + turn.y * wave.x)
}

/// The turn at which Re(zW) = C, downward (g falls with θ) for `side` 1 and upward for −1: zW = C + i·side·√(|W|² −
/// C²).
fn crossing(wave: Vector2<f64>, offset: f64, side: f64) -> Vector2<f64> {
    let squared = wave.norm_squared();
    // (|W| − C)(|W| + C) keeps its digits near a tangency.
    let norm = squared.sqrt();
    let across_squared = (norm - offset) * (norm + offset);
    let conjugate = Vector2::new(wave.x, -wave.y);
    if across_squared <= 0.0 {
        // C exceeds |W| by rounding.
        return conjugate * (offset.signum() / norm);
    }
    product(Vector2::new(offset, side * across_squared.sqrt()), conjugate) * squared.recip()
}
