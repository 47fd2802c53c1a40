//! The outline with its normals as one closed chain: along an edge the point moves, at a convex corner the normal
//! turns, at a reflex corner it jumps.
//!
//! A touch is compared with *pieces* of the chain. Each piece is smooth: the line of an edge, or a corner as a point,
//! either with one edge's normal, with any normal of the corner's, or with none where none was felt. The least over the
//! chain is the least over its pieces where each counts only on its own stretch.
//!
//! Frame: part. Units: m, rad. Errors: none.

use nalgebra::{Point2, Vector2};

use crate::geometry::SimplePolygon;
use crate::geometry::{corners_to_rounding, extent_of};
use crate::math::angle::wrap_angle;

/// A part's outline without its flat vertices.
#[derive(Clone, Debug)]
pub(super) struct Chain {
    pub edges: Vec<Edge>,
    /// Corner `i` begins edge `i`.
    pub corners: Vec<Corner>,
    /// Longer side of the bounding box, m.
    pub size: f64,
}

/// A straight side, the inside on its left.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub start: Vector2<f64>,
    /// Unit vector from its start to its end.
    pub along: Vector2<f64>,
    pub length: f64,
    /// Outward unit normal.
    pub normal: Vector2<f64>,
    /// Distance of its line from the origin along the normal, m.
    pub level: f64,
    /// Polar angle of the normal.
    pub angle: f64,
}

/// Where two edges meet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Corner {
    pub at: Vector2<f64>,
    /// Polar angle of the normal halfway between those of its edges.
    pub middle: f64,
    /// The normals turn by this to either side of it; not above 0 at a reflex corner.
    pub half: f64,
}

/// A smooth piece of the chain, as far as a touch can tell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Piece {
    pub place: Place,
    /// The edge whose normal is compared with the one felt; none where any will do.
    pub normal: Option<usize>,
}

/// Where on the outline.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Place {
    Edge(usize),
    Corner(usize),
}

impl Edge {
    /// How far along the edge a point is, and how far outside its line, m.
    #[inline]
    pub(super) fn along_and_off(&self, point: Vector2<f64>) -> (f64, f64) {
        ((point - self.start).dot(&self.along), self.normal.dot(&point) - self.level)
    }

    /// The square of a point's distance from the edge between its ends, m².
    #[inline]
    pub(super) fn distance_squared(&self, point: Vector2<f64>) -> f64 {
        let from_start = point - self.start;
        let along = from_start.dot(&self.along);
        let beyond = along - along.clamp(0.0, self.length);
        let off = from_start.dot(&self.normal);
        beyond * beyond + off * off
    }
}

impl Corner {
    /// By how much a normal's polar angle lies outside those of the corner, rad; 0 inside.
    pub(super) fn beyond(&self, angle: f64) -> f64 {
        (wrap_angle(angle - self.middle).abs() - self.half).max(0.0)
    }

    pub(super) fn is_convex(&self) -> bool {
        self.half > 0.0
    }
}

impl Chain {
    pub(super) fn new(outline: &SimplePolygon) -> Self {
        let vertices = outline.vertices();
        let kept = corners_to_rounding(vertices);
        let at = |k: usize| vertices[kept[k % kept.len()]].coords;
        let edge = |k: usize| {
            let (start, whole) = (at(k), at(k + 1) - at(k));
            let length = whole.norm();
            let along = whole / length;
            let normal = Vector2::new(along.y, -along.x);
            Edge { start, along, length, normal, level: normal.dot(&start), angle: normal.y.atan2(normal.x) }
        };
        let edges: Vec<_> = (0..kept.len()).map(edge).collect();
        let corner = |k: usize| {
            let before = edges[(k + edges.len() - 1) % edges.len()].angle;
            let turn = wrap_angle(edges[k].angle - before);
            Corner { at: edges[k].start, middle: before + turn / 2.0, half: turn / 2.0 }
        };
        let corners = (0..edges.len()).map(corner).collect();
        Self { edges, corners, size: extent_of(vertices) }
    }

    /// The edge that ends at a corner.
    pub(super) fn before(&self, corner: usize) -> usize {
        (corner + self.edges.len() - 1) % self.edges.len()
    }

    /// A point's distance from the outline, m; negative inside the part.
    pub(super) fn signed_distance(&self, point: Point2<f64>) -> f64 {
        let point = point.coords;
        let squared = self.edges.iter().map(|edge| edge.distance_squared(point)).fold(f64::INFINITY, f64::min);
        // A ray along +x crosses the outline an odd number of times from inside.
        let crosses = |k: &usize| {
            let (a, b) = (self.corners[*k].at, self.corners[(k + 1) % self.corners.len()].at);
            (a.y > point.y) != (b.y > point.y) && ((b - a).perp(&(point - a)) > 0.0) == (b.y > a.y)
        };
        let is_inside = (0..self.corners.len()).filter(crosses).count() % 2 == 1;
        if is_inside { -squared.sqrt() } else { squared.sqrt() }
    }
}
