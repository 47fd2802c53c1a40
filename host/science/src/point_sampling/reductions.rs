//! The thesis's constructions that carry one problem into another: from sets to polygons (figures 3.2 and 3.3), from graphs
//! to graphs (figures 3.4 and B.1).
//!
//! Its proofs of hardness rest on them. Here they make instances whose answer is known from the problem they come from:
//! the tests solve both sides, the figures draw them.
//!
//! Implements: the families of Lemma 4 (figure 3.2), Theorem 6 and Corollary 7 (figure 3.3), Lemma 11 (figure 3.4), Lemma 33
//! (figure B.1). *Misprint*: the vertices of figure 3.3 (b) part the circle into 2m arcs, not 2n: one corner of R(a) and
//! one R(x) for each of m elements.
//! Frames: one for all polygons. Units: m. Errors: none; elements that are none of those counted are no region.

use std::f64::consts::TAU;

use nalgebra::Point2;

use super::discriminate::log2_ceil;
use crate::geometry::SimplePolygon;

/// Side of the unnamed unit of the figures, m.
const CELL_M: f64 = 0.01;

/// Fewest corners of R(a) in figure 3.3 (b).
const CORNERS_MIN: usize = 3;

/// Figure 3.3 (a), of Theorem 6: a polygon a set, which is R(a) below and a block above it for each element.
///
/// ```
/// use palpate::point_sampling::{Request, plan, reductions};
///
/// // {x1}, {x2} and {x1, x2}: two elements tell them apart, and so do two points.
/// let polygons = reductions::combs(2, &[vec![0], vec![1], vec![0, 1]]);
/// assert_eq!(plan(&polygons, &Request::default(), &|| false).points.len(), 2);
/// ```
#[must_use]
pub fn combs(elements: usize, sets: &[Vec<usize>]) -> Vec<SimplePolygon> {
    let width = (2 * elements).max(2) - 1;
    sets.iter().filter_map(|set| comb(width, 1, |element| element < elements && set.contains(&element))).collect()
}

/// Figure 3.2 (a), which needs no more than ⌈log₂ n⌉ regions: of polygon i the blocks above are the digits of i, below are
/// i + 1 strips of which each polygon has one more than the one before.
#[must_use]
pub fn digits(count: usize) -> Vec<SimplePolygon> {
    let digits = log2_ceil(u32::try_from(count).unwrap_or(u32::MAX));
    let width = (2 * digits).max(2) - 1;
    (0..count).filter_map(|i| comb(width, i + 1, |digit| digit < digits && i >> digit & 1 == 1)).collect()
}

/// Figure 3.2 (b), which needs n − 1 regions: each polygon lies in the next.
#[must_use]
pub fn nested(count: usize) -> Vec<SimplePolygon> {
    let square = |i: usize| {
        let half = CELL_M * (i + 1) as f64;
        SimplePolygon::new([[-half, -half], [half, -half], [half, half], [-half, half]].map(Point2::from)).ok()
    };
    (0..count).filter_map(square).collect()
}

/// A rectangle so many cells wide and deep below y = 0, with blocks above every other cell where there is one.
fn comb(width: usize, depth: usize, has: impl Fn(usize) -> bool) -> Option<SimplePolygon> {
    let at = |x: usize, y: i8| Point2::new(CELL_M * x as f64, CELL_M * f64::from(y));
    let below = -CELL_M * depth as f64;
    let mut corners = vec![Point2::new(0.0, below), Point2::new(CELL_M * width as f64, below)];
    if !(width % 2 == 1 && has((width - 1) / 2)) {
        corners.push(at(width, 0));
    }
    for block in (0..width.div_ceil(2)).rev().filter(|&block| has(block)) {
        let corner = [at(2 * block + 1, 0), at(2 * block + 1, 1), at(2 * block, 1), at(2 * block, 0)];
        // Where a side goes straight on there is no corner.
        let first = usize::from(2 * block + 1 == width);
        corners.extend(&corner[first..if block == 0 { 3 } else { 4 }]);
    }
    if !has(0) {
        corners.push(at(0, 0));
    }
    SimplePolygon::new(corners).ok()
}

/// Figure 3.3 (b), of Corollary 7: a convex polygon a set, which is R(a) in the middle and a corner on its side for each
/// element. All corners are on one circle.
#[must_use]
pub fn flowers(elements: usize, sets: &[Vec<usize>]) -> Vec<SimplePolygon> {
    let sides = elements.max(CORNERS_MIN);
    let at = |half: usize| {
        let angle = TAU * half as f64 / (2 * sides) as f64;
        Point2::new(angle.cos(), angle.sin()) * (CELL_M * elements.max(CORNERS_MIN) as f64)
    };
    let flower = |set: &Vec<usize>| {
        let has = |half: &usize| half.is_multiple_of(2) || (half / 2 < elements && set.contains(&(half / 2)));
        SimplePolygon::new((0..2 * sides).filter(has).map(at).collect::<Vec<_>>()).ok()
    };
    sets.iter().filter_map(flower).collect()
}

/// A graph by its edges.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Graph {
    /// How many vertices there are, numbered from 0.
    pub vertices: usize,
    /// Pairs of different vertices.
    pub edges: Vec<[usize; 2]>,
}

impl Graph {
    /// Lemma 11, figure 3.4: a midvertex on each edge, those of edges with a common end joined. A set of vertices of the
    /// graph is independent exactly if it is 3-independent there.
    #[must_use]
    pub fn with_midvertices(&self) -> Self {
        let mid = |edge: usize| self.vertices + edge;
        let mut edges = Vec::new();
        for (i, &[u, v]) in self.edges.iter().enumerate() {
            edges.extend([[u, mid(i)], [v, mid(i)]]);
            let adjacent = |other: &[usize; 2]| other.contains(&u) || other.contains(&v);
            edges.extend((0..i).filter(|&j| adjacent(&self.edges[j])).map(|j| [mid(j), mid(i)]));
        }
        Self { vertices: self.vertices + self.edges.len(), edges }
    }

    /// Lemma 33, figure B.1, for k > 3: a path in place of each vertex, its ends joined to those of its neighbours, for odd
    /// k through a vertex in the middle. Paths come first, one after the other.
    #[must_use]
    pub fn with_paths(&self, k: usize) -> Self {
        let length = path_length(k);
        let ends = |v: usize| [v * length, v * length + length - 1];
        let mut edges: Vec<[usize; 2]> =
            (0..self.vertices).flat_map(|v| (1..length).map(move |i| [v * length + i - 1, v * length + i])).collect();
        let mut vertices = self.vertices * length;
        for &[u, v] in &self.edges {
            if k.is_multiple_of(2) {
                edges.extend(ends(u).into_iter().flat_map(|a| ends(v).map(|b| [a, b])));
            } else {
                edges.extend([ends(u), ends(v)].concat().into_iter().map(|end| [end, vertices]));
                vertices += 1;
            }
        }
        Self { vertices, edges }
    }
}

/// Vertices of the path that takes a vertex's place in [`Graph::with_paths`].
#[must_use]
pub fn path_length(k: usize) -> usize {
    if k.is_multiple_of(2) { k - 1 } else { k - 2 }
}
