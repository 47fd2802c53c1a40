//! A part with everything that was felt and seen of it, and χ² of a pose.

use nalgebra::{Matrix3, Point2, Vector2};

use super::chain::{Chain, Piece, Place};
use super::terms::{At, Change, Felt, Line, LineKind, Row, Share, Span};
use super::{FreeDisk, TouchReadings};
use crate::geometry::{ConvexPolygon, SimplePolygon};
use crate::inscription::noise::FENCE_SD_RELATIVE;
use crate::search::Halt;

/// Pieces of touches and corners of lines looked at between two questions whether to go on: a fraction of a millisecond.
const LOOK_EACH: usize = 20_000;

/// Of a line, what the part touches it with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Support {
    /// A corner of the hull.
    Corner(usize),
    /// The side of the hull that begins at this corner lies on it.
    Flush(usize),
}

/// By what each term is held: touches first, then lines.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Hold {
    pub touches: Vec<Piece>,
    pub lines: Vec<Support>,
}

/// What is minimised.
pub(super) struct Objective<'a> {
    pub chain: Chain,
    /// Corners of the hull, part frame, counter-clockwise.
    pub hull: Vec<Vector2<f64>>,
    pub convex: ConvexPolygon,
    pub touches: Vec<Felt>,
    pub lines: Vec<Line>,
    pub free: &'a [FreeDisk],
    /// The point of the world whose place in the part is searched for.
    pub anchor: Point2<f64>,
    /// What is the anchor: a touch, or nothing that the part touches.
    pub anchored: Option<usize>,
    halt: &'a Halt<'a>,
}

impl<'a> Objective<'a> {
    pub(super) fn new(outline: &SimplePolygon, readings: &'a TouchReadings, gate: f64, halt: &'a Halt<'a>) -> Self {
        let chain = Chain::new(outline);
        let convex = ConvexPolygon::hull(outline);
        let anchored = anchored(readings, gate);
        let anchor = match (anchored, readings.bearings.first(), readings.fences.first()) {
            (Some(touch), _, _) => readings.touches[touch].point,
            (None, Some(bearing), _) => bearing.apex,
            (None, None, Some(fence)) => fence.line.point,
            (None, None, None) => Point2::origin(),
        };
        let felt = |touch: &super::Touch| {
            let from_anchor = touch.point - anchor;
            let normal = touch.normal.map(|normal| (normal.angle, 1.0 / normal.sigma));
            Felt { from_anchor, lever: from_anchor.norm(), weight: 1.0 / touch.sigma, normal }
        };
        let exact = FENCE_SD_RELATIVE * convex.size();
        let fences = readings.fences.iter().map(|fence| Line {
            kind: LineKind::Fence { normal: fence.line.normal, beyond: -fence.line.beyond(anchor) },
            weight: 1.0 / fence.sigma.unwrap_or(exact),
        });
        let bearings = readings.bearings.iter().map(|bearing| Line {
            kind: LineKind::Bearing { anchor: anchor - bearing.apex, angle: bearing.angle, side: bearing.side },
            weight: 1.0 / readings.bearing_sigma,
        });
        Self {
            hull: convex.corners().iter().map(|corner| convex.centre().coords + corner).collect(),
            touches: readings.touches.iter().map(felt).collect(),
            lines: fences.chain(bearings).collect(),
            free: &readings.free,
            chain,
            convex,
            anchor,
            anchored,
            halt,
        }
    }

    pub(super) fn halt(&self) -> &'a Halt<'a> {
        self.halt
    }

    /// Before the work on one touch of many: none where one should not go on.
    #[inline]
    pub(super) fn goes_on_at(&self, touch: usize) -> Option<()> {
        let each = (LOOK_EACH / self.chain.edges.len()).max(1);
        if touch % each == each - 1 { self.halt.goes_on() } else { Some(()) }
    }

    /// What a touch adds to χ² at the least, and the piece that it is held by.
    pub(super) fn nearest(&self, felt: &Felt, at: &At) -> (f64, Piece) {
        let point = felt.on_part(at);
        let weight = felt.weight * felt.weight;
        let count = self.chain.edges.len();
        let mut best = (f64::INFINITY, Piece { place: Place::Corner(0), normal: None });
        let mut offer = |cost: f64, place: Place, normal: Option<usize>| {
            if cost < best.0 {
                best = (cost, Piece { place, normal });
            }
        };
        for (index, edge) in self.chain.edges.iter().enumerate() {
            let (along, off) = edge.along_and_off(point);
            let beyond = along - along.clamp(0.0, edge.length);
            let place = if along < 0.0 {
                Place::Corner(index)
            } else if along > edge.length {
                Place::Corner(if index + 1 == count { 0 } else { index + 1 })
            } else {
                Place::Edge(index)
            };
            let apart = (off * off + beyond * beyond) * weight;
            if felt.normal.is_some() {
                let miss = felt.normal_miss(edge.angle, at.theta);
                offer(apart + miss * miss, place, Some(index));
            } else {
                offer(apart, place, None);
            }
        }
        if let Some((angle, _)) = felt.normal {
            for (index, corner) in self.chain.corners.iter().enumerate().filter(|(_, corner)| corner.is_convex()) {
                if corner.beyond(angle - at.theta) <= 0.0 {
                    offer((point - corner.at).norm_squared() * weight, Place::Corner(index), None);
                }
            }
        }
        best
    }

    /// χ² and by what each term is held; none where it should halt. Infinite where a sensor is inside the part.
    pub(super) fn held(&self, at: &At) -> Option<(f64, Hold)> {
        let mut hold = Hold::default();
        let mut cost = 0.0;
        for (index, felt) in self.touches.iter().enumerate() {
            self.goes_on_at(index)?;
            let (added, piece) = self.nearest(felt, at);
            cost += added;
            hold.touches.push(piece);
        }
        let mut misses = Vec::new();
        for line in &self.lines {
            line.misses(&self.hull, at, &mut misses);
            let corner = outermost(&misses, line.sense());
            cost += if line.is_seen_from_inside(&misses) { f64::INFINITY } else { misses[corner].powi(2) };
            hold.lines.push(Support::Corner(corner));
        }
        Some((cost, hold))
    }

    pub(super) fn chi2(&self, at: &At) -> Option<f64> {
        self.held(at).map(|(cost, _)| cost)
    }

    /// The row of a line that touches this corner of the hull.
    pub(super) fn line_row(&self, line: usize, corner: usize, at: &At, spans: &[Span; 2]) -> (Row, [Change; 2]) {
        self.lines[line].row(self.hull[corner], at, spans)
    }

    /// What a line adds to χ² where it touches this corner.
    pub(super) fn line_share(&self, line: usize, corner: usize, at: &At, spans: &[Span; 2]) -> Share {
        let (row, changes) = self.line_row(line, corner, at, spans);
        let mut share = Share::zero();
        share.add_row(&row, self.chain.size);
        let weight = self.lines[line].weight;
        share.add_rest(row.value / weight, weight, &changes);
        share
    }

    /// All shares of a choice; of a side that is flush, with its first corner.
    pub(super) fn sum(&self, hold: &Hold, at: &At) -> Option<Share> {
        let spans = [Span { reach: 0.0, turn: 0.0 }; 2];
        let mut sum = Share::zero();
        for (index, (felt, piece)) in self.touches.iter().zip(&hold.touches).enumerate() {
            self.goes_on_at(index)?;
            sum.add(&felt.share(&self.chain, *piece, at, &spans));
        }
        for (line, support) in hold.lines.iter().enumerate() {
            let (Support::Corner(corner) | Support::Flush(corner)) = *support;
            sum.add(&self.line_share(line, corner, at, &spans));
        }
        Some(sum)
    }

    /// The least distance of a free disk from the part, m; negative where they overlap.
    pub(super) fn clearance(&self, at: &At) -> f64 {
        let of = |disk: &FreeDisk| {
            let on_part = at.place + at.in_part(disk.centre - self.anchor);
            self.chain.signed_distance(Point2::from(on_part)) - disk.radius
        };
        self.free.iter().map(of).fold(f64::INFINITY, f64::min)
    }

    /// Corner of the hull after this one.
    pub(super) fn next(&self, corner: usize) -> usize {
        if corner + 1 == self.hull.len() { 0 } else { corner + 1 }
    }
}

impl Line {
    /// Whether corners are seen all round.
    fn is_seen_from_inside(&self, misses: &[f64]) -> bool {
        let low = misses.iter().copied().fold(f64::INFINITY, f64::min);
        let high = misses.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        matches!(self.kind, LineKind::Bearing { .. }) && high - low >= std::f64::consts::PI * self.weight
    }
}

/// The corner whose miss counts.
pub(super) fn outermost(misses: &[f64], sense: f64) -> usize {
    (0..misses.len()).max_by(|a, b| (sense * misses[*a]).total_cmp(&(sense * misses[*b]))).unwrap_or(0)
}

/// The touch to measure from: one known well, and in the midst of the others so that turns move these least.
fn anchored(readings: &TouchReadings, gate: f64) -> Option<usize> {
    let count = readings.touches.len() as f64;
    let middle = readings.touches.iter().map(|touch| touch.point.coords / count).sum::<Vector2<f64>>();
    let badness =
        |touch: &super::Touch| gate.sqrt() * touch.sigma + ANCHOR_LEVER * (touch.point.coords - middle).norm();
    let touches = readings.touches.iter().enumerate();
    touches.min_by(|(_, a), (_, b)| badness(a).total_cmp(&badness(b))).map(|(index, _)| index)
}

/// How much of its distance from the middle of all touches makes a touch as bad an anchor as a standard deviation.
const ANCHOR_LEVER: f64 = 0.1;

/// Whether a curvature has a positive curvature in every direction.
pub(super) fn is_positive(curvature: &Matrix3<f64>) -> bool {
    let scale = Vector3Scale::of(curvature);
    scale.is_some_and(|scale| scale.scaled(curvature).cholesky().is_some())
}

/// The roots of a curvature's diagonal: what makes unknowns with different units alike.
pub(super) struct Vector3Scale(pub nalgebra::Vector3<f64>);

impl Vector3Scale {
    pub(super) fn of(curvature: &Matrix3<f64>) -> Option<Self> {
        let diagonal = curvature.diagonal();
        diagonal.iter().all(|value| *value > 0.0).then(|| Self(diagonal.map(f64::sqrt)))
    }

    pub(super) fn scaled(&self, matrix: &Matrix3<f64>) -> Matrix3<f64> {
        Matrix3::from_fn(|i, j| matrix[(i, j)] / (self.0[i] * self.0[j]))
    }
}
