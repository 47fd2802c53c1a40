//! χ² of a pose, term by term, and how far each term can be from its parabola within a box of poses.
//!
//! Coordinates of a pose here: the place P in the part frame of one point that is fixed in the world, the anchor, and
//! the turn θ. A touch at D from the anchor (world) is then felt at p = P + R(−θ) D of the part: linear in P. For the
//! residual r of any term
//!
//! ```text
//! ½ ∂(r²) at a step s = r ∇r + (∇r ∇rᵀ + r H) s + rest
//! ```
//!
//! with H the second derivatives of r; a [`Share`] holds all of these, with bounds of |rest| over the box for the place
//! and for the turn. They are sums over terms, so a choice of pieces for all terms is judged by adding up shares.
//!
//! Units: m, rad; residuals in standard deviations. Errors: none.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::chain::{Chain, Piece, Place};
use crate::geometry::Pose;
use crate::inscription::readings::Side;
use crate::math::angle::wrap_angle;

/// A touch as the search sees it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Felt {
    /// Where it was felt, from the anchor, world.
    pub from_anchor: Vector2<f64>,
    /// Its distance from the anchor, m.
    pub lever: f64,
    /// One over its standard deviation, 1/m.
    pub weight: f64,
    /// The outward normal felt, world, and one over its standard deviation, 1/rad.
    pub normal: Option<(f64, f64)>,
}

/// A line that the part's hull touches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Line {
    pub kind: LineKind,
    /// One over the standard deviation, 1/m or 1/rad.
    pub weight: f64,
}

#[derive(Clone, Copy, Debug)]
pub(super) enum LineKind {
    /// Normal away from the part and how far the line is beyond the anchor, m.
    Fence { normal: Vector2<f64>, beyond: f64 },
    /// The anchor from the sensor, world, and the angle of one side of the part.
    Bearing { anchor: Vector2<f64>, angle: f64, side: Side },
}

/// A pose in the coordinates of the search.
#[derive(Clone, Copy, Debug)]
pub(super) struct At {
    /// The anchor in the part frame.
    pub place: Vector2<f64>,
    pub theta: f64,
    cos: f64,
    sin: f64,
}

/// What a box spans: how far places are from its middle, m, and turns, rad.
#[derive(Clone, Copy, Debug)]
pub(super) struct Span {
    pub reach: f64,
    pub turn: f64,
}

/// What one term, held by one piece, adds to χ² at a pose and near it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Share {
    pub cost: f64,
    /// Half the gradient of χ².
    pub gradient: Vector3<f64>,
    /// Half its second derivatives after Gauss.
    pub gauss: Matrix3<f64>,
    /// What is missing of them.
    pub bend: Matrix3<f64>,
    /// Rows of unit length, turns in part sizes, squared: their rank is that of the Jacobian whatever the weights.
    pub directions: Matrix3<f64>,
    /// How far half the gradient can be from linear: by place and by turn, over each span that was asked for.
    pub rest: [Rest; 2],
}

/// Bounds of what is left of half a gradient beyond its linear part.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rest {
    pub place: f64,
    pub turn: f64,
}

/// A residual with its derivatives.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    pub value: f64,
    pub slope: Vector3<f64>,
    pub bend: Matrix3<f64>,
}

/// How a residual, in units of its scale, can change over a span.
#[derive(Clone, Copy, Debug)]
pub(super) struct Change {
    /// Of the residual's linear part, and of what is left of it.
    pub value: f64,
    pub value_rest: f64,
    /// Of its slope's linear part by place and by turn, and what is left of these.
    pub bent: [f64; 2],
    pub bent_rest: [f64; 2],
    /// The slopes themselves at most.
    pub slope: [f64; 2],
}

impl At {
    pub(super) fn new(place: Vector2<f64>, theta: f64) -> Self {
        let (sin, cos) = theta.sin_cos();
        Self { place, theta, cos, sin }
    }

    /// A vector of the world in part axes.
    #[inline]
    pub(super) fn in_part(&self, v: Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.cos * v.x + self.sin * v.y, self.cos * v.y - self.sin * v.x)
    }

    /// A vector of the part in world axes.
    #[inline]
    pub(super) fn in_world(&self, v: Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.cos * v.x - self.sin * v.y, self.sin * v.x + self.cos * v.y)
    }

    pub(super) fn stepped(&self, step: &Vector3<f64>) -> Self {
        Self::new(self.place + step.xy(), wrap_angle(self.theta + step.z))
    }

    /// How far it is from another.
    pub(super) fn minus(&self, other: &Self) -> Vector3<f64> {
        let place = self.place - other.place;
        Vector3::new(place.x, place.y, wrap_angle(self.theta - other.theta))
    }

    /// With theta in [0, 2π).
    pub(super) fn pose(&self, anchor: Point2<f64>) -> Pose {
        let at = anchor - self.in_world(self.place);
        Pose { x: at.x, y: at.y, theta: crate::inscription::exact::full_turn(wrap_angle(self.theta)) }
    }

    /// A covariance in these coordinates as that of x, y, theta of the part frame.
    pub(super) fn pose_covariance(&self, covariance: &Matrix3<f64>) -> Matrix3<f64> {
        let lever = self.in_world(self.place);
        let transfer = Matrix3::new(-self.cos, self.sin, lever.y, -self.sin, -self.cos, -lever.x, 0.0, 0.0, 1.0);
        transfer * covariance * transfer.transpose()
    }
}

impl Share {
    pub(super) fn zero() -> Self {
        Self {
            cost: 0.0,
            gradient: Vector3::zeros(),
            gauss: Matrix3::zeros(),
            bend: Matrix3::zeros(),
            directions: Matrix3::zeros(),
            rest: [Rest::default(); 2],
        }
    }

    #[inline]
    pub(super) fn add(&mut self, other: &Self) {
        self.cost += other.cost;
        self.gradient += other.gradient;
        self.gauss += other.gauss;
        self.bend += other.bend;
        self.directions += other.directions;
        for (rest, more) in self.rest.iter_mut().zip(&other.rest) {
            rest.place += more.place;
            rest.turn += more.turn;
        }
    }

    /// Adds a row; `size` makes turns and places alike.
    #[inline]
    pub(super) fn add_row(&mut self, row: &Row, size: f64) {
        self.cost += row.value * row.value;
        self.gradient += row.slope * row.value;
        self.gauss += row.slope * row.slope.transpose();
        self.bend += row.bend * row.value;
        let unit = Vector3::new(row.slope.x, row.slope.y, row.slope.z / size);
        let squared = unit.norm_squared();
        if squared > 0.0 {
            self.directions += unit * unit.transpose() / squared;
        }
    }

    /// Adds what a row of this value (over `weight`) can leave beyond the parabola.
    #[inline]
    pub(super) fn add_rest(&mut self, value: f64, weight: f64, changes: &[Change; 2]) {
        for (rest, change) in self.rest.iter_mut().zip(changes) {
            let added = change.rest(value);
            rest.place += weight * weight * added.place;
            rest.turn += weight * weight * added.turn;
        }
    }
}

impl Change {
    /// Of half the gradient of the square of a residual with this value in the middle.
    #[inline]
    fn rest(&self, value: f64) -> Rest {
        let of = |axis: usize| {
            (value.abs() + self.value) * self.bent_rest[axis]
                + self.value * self.bent[axis]
                + self.value_rest * (self.slope[axis] + self.bent[axis] + self.bent_rest[axis])
        };
        Rest { place: of(0), turn: of(1) }
    }

    /// Of a residual that is a length along a fixed direction of the part, of a point with this lever.
    #[inline]
    fn of_touch(lever: f64, span: &Span) -> Self {
        let swung = lever * span.turn;
        let curved = swung * span.turn / 2.0;
        Self {
            value: span.reach + swung,
            value_rest: curved,
            bent: [0.0, swung],
            bent_rest: [0.0, curved],
            slope: [1.0, lever],
        }
    }

    /// Of a residual that is a length along a fixed direction of the world, of a corner so far from the anchor.
    fn of_fence(lever: f64, span: &Span) -> Self {
        let (reach, turn) = (span.reach, span.turn);
        let curved = reach * turn + (lever + reach) * turn * turn / 2.0;
        Self {
            value: reach + lever * turn,
            value_rest: curved,
            bent: [turn, reach + lever * turn],
            bent_rest: [turn * turn / 2.0, curved],
            slope: [1.0, lever],
        }
    }

    /// Of a bearing to a corner so far from the sensor; infinite where the sensor may come near it.
    fn of_bearing(away: f64, lever: f64, span: &Span) -> Self {
        let (reach, turn) = (span.reach, span.turn);
        let moved = reach + lever * turn;
        let least = away - moved;
        if least < away / 2.0 {
            let all = f64::INFINITY;
            return Self { value: all, value_rest: all, bent: [all; 2], bent_rest: [all; 2], slope: [all; 2] };
        }
        let curved = reach * turn + (lever + reach) * turn * turn / 2.0;
        let square = least * least;
        let place_bent = moved / square + turn / least;
        let place_rest =
            moved * moved / (square * least) + moved * turn / square + (turn * turn / 2.0) / least + curved / square;
        Self {
            value: moved / away,
            value_rest: moved * moved / (2.0 * square) + curved / least,
            bent: [place_bent, (lever + reach) * place_bent + moved / least],
            bent_rest: [place_rest, (lever + reach) * place_rest + reach * place_bent + curved / least],
            slope: [1.0 / least, (lever + reach) / least],
        }
    }
}

impl Felt {
    /// Where it is on the part.
    #[inline]
    pub(super) fn on_part(&self, at: &At) -> Vector2<f64> {
        at.place + at.in_part(self.from_anchor)
    }

    /// The felt normal less one of the part, in standard deviations.
    pub(super) fn normal_miss(&self, angle: f64, theta: f64) -> f64 {
        self.normal.map_or(0.0, |(felt, weight)| wrap_angle(felt - theta - angle) * weight)
    }

    /// What it adds to χ² when held by a piece.
    pub(super) fn share(&self, chain: &Chain, piece: Piece, at: &At, spans: &[Span; 2]) -> Share {
        let arm = at.in_part(self.from_anchor);
        let point = at.place + arm;
        let mut share = Share::zero();
        let weight = self.weight;
        let changes = spans.map(|span| Change::of_touch(self.lever, &span));
        let mut length = |value: f64, direction: Vector2<f64>| {
            let slope = Vector3::new(direction.x, direction.y, direction.perp(&arm)) * weight;
            let mut bend = Matrix3::zeros();
            bend[(2, 2)] = -direction.dot(&arm) * weight;
            share.add_row(&Row { value: value * weight, slope, bend }, chain.size);
        };
        let off = match piece.place {
            Place::Edge(edge) => {
                let edge = &chain.edges[edge];
                let off = edge.normal.dot(&point) - edge.level;
                length(off, edge.normal);
                off
            }
            Place::Corner(corner) => {
                let away = point - chain.corners[corner].at;
                length(away.x, Vector2::x());
                length(away.y, Vector2::y());
                away.norm()
            }
        };
        share.add_rest(off, weight, &changes);
        if let (Some(edge), Some((_, weight))) = (piece.normal, self.normal) {
            let value = self.normal_miss(chain.edges[edge].angle, at.theta);
            let slope = Vector3::new(0.0, 0.0, -weight);
            share.add_row(&Row { value, slope, bend: Matrix3::zeros() }, chain.size);
        }
        share
    }
}

impl Line {
    /// The residual if this corner (part frame) is the one that touches; `spans` bound its changes.
    pub(super) fn row(&self, corner: Vector2<f64>, at: &At, spans: &[Span; 2]) -> (Row, [Change; 2]) {
        let from_anchor = corner - at.place;
        let lever = from_anchor.norm();
        match self.kind {
            LineKind::Fence { normal, beyond } => {
                let normal = at.in_part(normal);
                let slope = Vector3::new(-normal.x, -normal.y, -normal.perp(&from_anchor));
                let mut bend = Matrix3::zeros();
                // Of −normal by the turn.
                let swung = Vector2::new(-normal.y, normal.x);
                for (axis, value) in [swung.x, swung.y].into_iter().enumerate() {
                    bend[(axis, 2)] = value;
                    bend[(2, axis)] = value;
                }
                bend[(2, 2)] = -normal.dot(&from_anchor);
                let value = normal.dot(&from_anchor) - beyond;
                let row = Row { value: value * self.weight, slope: slope * self.weight, bend: bend * self.weight };
                (row, spans.map(|span| Change::of_fence(lever, &span)))
            }
            LineKind::Bearing { anchor, angle, .. } => {
                let sensor = at.in_part(anchor);
                let away = sensor + from_anchor;
                let squared = away.norm_squared();
                let across = Vector2::new(-away.y, away.x);
                let value = wrap_angle(angle - at.theta - away.y.atan2(away.x));
                let gradient = across / squared;
                // How the corner moves from the sensor, in part axes, with place and turn.
                let turned = Vector2::new(sensor.y, -sensor.x);
                let slope = Vector3::new(gradient.x, gradient.y, -1.0 - gradient.dot(&turned));
                let square = squared * squared;
                let curve = -(away * across.transpose() + across * away.transpose()) / square;
                let mut bend = Matrix3::zeros();
                bend.fixed_view_mut::<2, 2>(0, 0).copy_from(&-curve);
                let mixed = curve * turned;
                for axis in 0..2 {
                    bend[(axis, 2)] = mixed[axis];
                    bend[(2, axis)] = mixed[axis];
                }
                bend[(2, 2)] = -(turned.dot(&(curve * turned)) - gradient.dot(&sensor));
                let row = Row { value: value * self.weight, slope: slope * self.weight, bend: bend * self.weight };
                (row, spans.map(|span| Change::of_bearing(squared.sqrt(), lever, &span)))
            }
        }
    }

    /// Which way the corner that touches is the outermost: of two residuals the larger counts (1), or the smaller (−1).
    pub(super) fn sense(&self) -> f64 {
        match self.kind {
            LineKind::Fence { .. } | LineKind::Bearing { side: Side::Right, .. } => 1.0,
            LineKind::Bearing { side: Side::Left, .. } => -1.0,
        }
    }

    /// The residuals of all corners of the hull in standard deviations, those of a bearing on one branch of the angle.
    pub(super) fn misses(&self, hull: &[Vector2<f64>], at: &At, out: &mut Vec<f64>) {
        out.clear();
        match self.kind {
            LineKind::Fence { normal, beyond } => {
                let normal = at.in_part(normal);
                let level = normal.dot(&at.place) + beyond;
                out.extend(hull.iter().map(|corner| (normal.dot(corner) - level) * self.weight));
            }
            LineKind::Bearing { anchor, angle, .. } => {
                let sensor = at.in_part(anchor) - at.place;
                let away = |corner: &Vector2<f64>| (sensor + corner).y.atan2((sensor + corner).x);
                let first = hull.first().map_or(0.0, away);
                let base = wrap_angle(angle - at.theta - first);
                // Corners seen from outside lie within half a turn of each other.
                out.extend(hull.iter().map(|corner| (base - wrap_quick(away(corner) - first)) * self.weight));
            }
        }
    }
}

/// The angle in [−π, π] of a difference of two such.
fn wrap_quick(angle: f64) -> f64 {
    if angle > TAU / 2.0 {
        angle - TAU
    } else if angle < -TAU / 2.0 {
        angle + TAU
    } else {
        angle
    }
}
