//! Three supporting lines: the turns of the part at which it touches all of them.
//!
//! A part turned by θ whose reference point is at t touches line k, {q : u_k·q = c_k}, where h(β_k − θ) + u_k·t = c_k; h is the
//! part's support function and β_k the polar angle of u_k. With λ such that Σ λ_k u_k = 0 the position drops out:
//!
//! ```text
//! g(θ) = Σ λ_k h(β_k − θ) − Σ λ_k c_k = 0,   λ = (sin(β₃ − β₂), sin(β₁ − β₃), sin(β₂ − β₁))
//! ```
//!
//! Between two turns at which an edge is flush with a line the same three corners touch, and g is Re(z W) − C with z = e^{iθ},
//! W = Σ λ_k ū_k v_k and C = Σ λ_k c_k: a sinusoid with at most two roots. There are at most 3n such stretches, so at most 6n
//! poses (thesis, theorem 2; this form has none of its special cases). One sweep over the stretches visits all of them in O(n),
//! without an angle function: z at a flush edge is ū_k times the edge's normal.
//!
//! Whether g changes its sign is decided by its values at the ends, computed once for the two stretches they belong to. So
//! crossings come in pairs, as they must for a periodic function, whatever the rounding errors are.
//!
//! Complex numbers are vectors (re, im). Units: m, rad.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::readings::HalfPlane;
use crate::geometry::ConvexPolygon;

/// Where |g| is below this share of the part's size, it may be zero: a tangency, or a flush edge at a kink.
///
/// Sums of some products, each rounded at 1e-16 of the size; a hundred roundings leave room for lines from far away.
const ROUNDING_RELATIVE: f64 = 1e-14;

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
        let [a, b, c] = lines.map(|line| half_planes[line].normal);
        let weights = [b.perp(&c), c.perp(&a), a.perp(&b)];
        let sum: f64 = weights.iter().map(|weight| weight.abs()).sum();
        if sum < PARALLEL {
            return None;
        }
        let weights = weights.map(|weight| weight / sum);
        let offset = lines.iter().zip(weights).map(|(&line, weight)| weight * offsets[line]).sum();
        Some(Self { lines, weights, offset })
    }
}

/// Lines whose directions differ by less than this count as parallel, rad: ten times what is left of an angle when a turn is
/// added to it and taken off again.
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
    lines: [Line; 3],
    offset: f64,
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
    /// All turns at which the part touches three lines, and those at which it misses them by no more than `miss_max` (m).
    pub(super) fn of(part: &ConvexPolygon, half_planes: &[HalfPlane], triple: &Triple, miss_max: f64) -> Self {
        let sweep = Sweep::new(part, half_planes, triple);
        let rounding = ROUNDING_RELATIVE * (part.size() + triple.offset.abs());
        let mut turns = Self { found: Vec::new(), miss_max, rounding };
        turns.collect(sweep);
        turns
    }

    fn collect(&mut self, mut sweep: Sweep<'_>) {
        let mut wave = sweep.wave();
        let first = sweep.end(wave, Vector2::x());
        let mut start = first;
        for _ in 0..3 * sweep.part.corners().len() {
            let line = sweep.next_line();
            let turn = sweep.flush_turn(line);
            let end = sweep.end(wave, turn);
            self.stretch(&start, &end, wave, sweep.offset);
            sweep.advance(line);
            wave = sweep.wave();
            let after = End { slope: slope(wave, turn), ..end };
            self.kink(&end, &after);
            start = after;
        }
        let last = End { value: first.value, ..sweep.end(wave, Vector2::x()) };
        self.stretch(&start, &last, wave, sweep.offset);
    }

    /// Roots strictly between two flush turns.
    #[inline]
    fn stretch(&mut self, start: &End, end: &End, wave: Vector2<f64>, offset: f64) {
        match (start.value >= 0.0, end.value >= 0.0) {
            (true, false) => self.found.push(crossing(wave, offset, 1.0)),
            (false, true) => self.found.push(crossing(wave, offset, -1.0)),
            (true, true) if start.slope < 0.0 && end.slope > 0.0 => self.bottom(wave, offset, -1.0),
            (false, false) if start.slope > 0.0 && end.slope < 0.0 => self.bottom(wave, offset, 1.0),
            _ => {}
        }
    }

    /// An extremum that points toward zero: of g = Re(zW) − C the least where `sign` is −1, the largest where it is 1.
    #[cold]
    fn bottom(&mut self, wave: Vector2<f64>, offset: f64, sign: f64) {
        // Positive once g is past zero there.
        let past = wave.norm() - sign * offset;
        if past > self.rounding {
            self.found.extend([crossing(wave, offset, 1.0), crossing(wave, offset, -1.0)]);
        } else if past >= -self.miss_max.max(self.rounding) {
            self.found.push(sign * Vector2::new(wave.x, -wave.y) / wave.norm());
        }
    }

    /// A flush turn at which g comes near zero without crossing it, or is zero but for rounding.
    #[inline]
    fn kink(&mut self, before: &End, after: &End) {
        let miss = before.value.abs();
        if miss > self.miss_max.max(self.rounding) {
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
        let line = |k: usize| Line::new(part, &half_planes[triple.lines[k]], triple.weights[k]);
        Self { part, lines: [line(0), line(1), line(2)], offset: triple.offset }
    }

    /// W.
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

    /// e^{iθ} there.
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
    fn new(part: &ConvexPolygon, half_plane: &HalfPlane, weight: f64) -> Self {
        let conjugate = Vector2::new(half_plane.normal.x, -half_plane.normal.y);
        let corner = part.support(half_plane.angle);
        let edge = before(corner, part.corners().len());
        // The flush turn is at most one turn ahead.
        let ahead = half_plane.angle - part.angles()[edge];
        let base = if ahead < 0.0 { half_plane.angle + TAU } else { half_plane.angle };
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

/// dg/dθ = −Im(zW).
#[inline]
fn slope(wave: Vector2<f64>, turn: Vector2<f64>) -> f64 {
    -(turn.x * wave.y + turn.y * wave.x)
}

/// The turn at which Re(zW) = C, downward (g falls with θ) for `side` 1 and upward for −1: zW = C + i·side·√(|W|² − C²).
fn crossing(wave: Vector2<f64>, offset: f64, side: f64) -> Vector2<f64> {
    let squared = wave.norm_squared();
    // (|W| − C)(|W| + C) keeps its digits near a tangency.
    let norm = squared.sqrt();
    let across = ((norm - offset) * (norm + offset)).max(0.0).sqrt();
    let conjugate = Vector2::new(wave.x, -wave.y);
    let turn = product(Vector2::new(offset, side * across), conjugate) / squared;
    // No longer a unit where C exceeds |W| by rounding.
    turn / turn.norm()
}
