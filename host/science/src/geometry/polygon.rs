//! A polygon that has been checked once: simple and counter-clockwise.
//!
//! [`SimplePolygon::new`] is the only way to one, so nothing behind it checks again. Nothing is repaired:
//! an outline that is clockwise, crosses or touches itself, turns back on itself or lists a point twice is
//! refused, and the error names the vertex or the edges. A flat vertex (straight on) is fine.
//!
//! Orientation and crossing are decided by exact predicates (Shewchuk's, from the `robust` crate), so the
//! verdict does not depend on a tolerance. The only tolerances here say which outlines are too small, too large or
//! too thin to compute with.
//!
//! Frames: the vertices' own (`part`). Units: m, m². Edge `i` runs from vertex `i` to vertex `i + 1`, cyclic.
//! Errors: [`PolygonError`].

use std::cmp::Ordering;
use std::collections::BTreeSet;
use std::ops::Bound;

use nalgebra::{Point2, Vector2};

use super::segment::distance_to_segment;

/// Pieces of an edge at whose middles its distance from another outline is taken.
const PIECES: u32 = 100;

/// Least extent (the longer side of the bounding box) of a polygon, in metres.
///
/// A nanometre is smaller than anything a finger can feel, so such a polygon has its units wrong; and products of
/// coordinates far below it would underflow, where the predicates stop being exact.
const EXTENT_MIN_M: f64 = 1e-9;

/// Largest magnitude of a coordinate, in metres.
///
/// Generous enough for a polygon in arbitrary units; beyond it only mistakes are found, and at the far end overflow.
const COORDINATE_MAX_M: f64 = 1e9;

/// Neighbouring vertices nearer to each other than this, as a share of the extent, count as one point listed twice.
///
/// Vertices carry rounding of about 1e-16 of the extent; at 1e-12 an edge's direction still has four good digits.
const EDGE_MIN_RELATIVE: f64 = 1e-12;

/// Least area as a share of the extent squared.
///
/// At 1e-12 the rounding of the coordinates (1e-16) leaves the area about four good digits; a thinner sliver has no
/// centroid or moment worth computing.
const AREA_MIN_RELATIVE: f64 = 1e-12;

/// A simple polygon, counter-clockwise, in metres.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::SimplePolygon;
///
/// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
/// assert!((block.area() - 0.0024).abs() < 1e-15); // m²
/// assert!(block.first_reflex_vertex().is_none()); // convex
/// # Ok::<(), palpate::geometry::PolygonError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SimplePolygon {
    vertices: Vec<Point2<f64>>,
}

/// Why an outline is not a [`SimplePolygon`]. Vertices and edges count from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum PolygonError {
    /// Fewer than three vertices.
    #[error("a polygon needs at least 3 vertices and has {count}: list its corners in order")]
    TooFewVertices {
        /// How many were given.
        count: usize,
    },
    /// A coordinate that is NaN, infinite or out of range.
    #[error("vertex {vertex} has the coordinate {value:?}, beyond the limit of ±{COORDINATE_MAX_M:e}: check its units")]
    CoordinateOutOfRange {
        /// Number of the vertex, from 0.
        vertex: usize,
        /// The coordinate, m.
        value: f64,
    },
    /// Everything lies within a nanometre.
    #[error(
        "the polygon is {extent:e} across, below the limit of {EXTENT_MIN_M:e}: check its units, lengths are in metres"
    )]
    TooSmall {
        /// Longer side of the bounding box, m.
        extent: f64,
    },
    /// The outline was closed by hand.
    #[error("the last vertex ({last}) repeats the first: leave it out, the outline closes by itself")]
    Closed {
        /// Number of the last vertex, from 0.
        last: usize,
    },
    /// One point is listed twice.
    #[error("vertex {second} repeats vertex {first}: list every corner once")]
    Repeated {
        /// The earlier of the two vertices.
        first: usize,
        /// The later of the two vertices.
        second: usize,
    },
    /// The outline turns back on itself.
    #[error("the outline turns straight back at vertex {vertex} (a spike): remove the spike")]
    Spike {
        /// Number of the vertex at the spike's tip, from 0.
        vertex: usize,
    },
    /// No three vertices span an area.
    #[error("all {count} vertices lie on one line: a part has an area, list the corners round its outline")]
    OnOneLine {
        /// How many vertices there are.
        count: usize,
    },
    /// Two edges that are not neighbours meet.
    #[error("edge {first} crosses or touches edge {second}: list the corners in order round the outline")]
    Crossing {
        /// The earlier of the two edges.
        first: usize,
        /// The later of the two edges.
        second: usize,
    },
    /// The vertices run the wrong way round.
    #[error("the vertices run clockwise: list them counter-clockwise (reverse their order)")]
    Clockwise,
    /// The area is too small for the extent.
    #[error(
        "the area {area:e} is below the limit of {limit:e} for a polygon of this length: it is too thin to be a part"
    )]
    TooThin {
        /// Area, m².
        area: f64,
        /// The least area for this extent, m².
        limit: f64,
    },
}

impl PolygonError {
    /// The vertex to look at first, where the error has a place.
    #[must_use]
    pub fn vertex(&self) -> Option<usize> {
        match *self {
            Self::CoordinateOutOfRange { vertex, .. } | Self::Spike { vertex } => Some(vertex),
            Self::Closed { last } => Some(last),
            Self::Repeated { second, .. } | Self::Crossing { second, .. } => Some(second),
            Self::TooFewVertices { .. }
            | Self::TooSmall { .. }
            | Self::OnOneLine { .. }
            | Self::Clockwise
            | Self::TooThin { .. } => None,
        }
    }
}

/// Sine of the angle between edges below which their lines do not meet anywhere near.
const FLAT_TURN: f64 = 1e-6;

impl SimplePolygon {
    /// Checks an outline.
    ///
    /// # Errors
    /// [`PolygonError`] names the first thing found wrong; the direction is judged only once the outline is simple.
    pub fn new(vertices: impl Into<Vec<Point2<f64>>>) -> Result<Self, PolygonError> {
        let vertices = vertices.into();
        if vertices.len() < 3 {
            return Err(PolygonError::TooFewVertices { count: vertices.len() });
        }
        check_coordinates(&vertices)?;
        let extent = extent_of(&vertices);
        if extent < EXTENT_MIN_M {
            return Err(PolygonError::TooSmall { extent });
        }
        check_neighbours(&vertices, extent)?;
        check_repeats(&vertices)?;
        check_crossings(&vertices)?;
        if !is_counter_clockwise(&vertices) {
            return Err(PolygonError::Clockwise);
        }
        let (polygon, limit) = (Self { vertices }, AREA_MIN_RELATIVE * extent * extent);
        let area = polygon.area();
        if area < limit { Err(PolygonError::TooThin { area, limit }) } else { Ok(polygon) }
    }

    /// The vertices, counter-clockwise, part frame, m.
    #[must_use]
    pub fn vertices(&self) -> &[Point2<f64>] {
        &self.vertices
    }

    /// The edges in order, each as its start and end.
    pub fn edges(&self) -> impl ExactSizeIterator<Item = (Point2<f64>, Point2<f64>)> + '_ {
        let n = self.vertices.len();
        (0..n).map(move |i| (self.vertices[i], self.vertices[(i + 1) % n]))
    }

    /// Root mean square distance of this outline from another, along its length, m: by the middles of a hundred pieces of each
    /// edge.
    #[must_use]
    pub fn distance_rms(&self, other: &Self) -> f64 {
        let (mut sum, mut length) = (0.0, 0.0);
        for (start, end) in self.edges() {
            let piece = (end - start).norm() / f64::from(PIECES);
            for k in 0..PIECES {
                let at = start + (end - start) * ((f64::from(k) + 0.5) / f64::from(PIECES));
                let distances = other.edges().map(|(start, end)| distance_to_segment(at, start, end));
                sum += piece * distances.fold(f64::INFINITY, f64::min).powi(2);
                length += piece;
            }
        }
        (sum / length).sqrt()
    }

    /// The area, m².
    #[must_use]
    pub fn area(&self) -> f64 {
        // Measured from a vertex, so that a polygon far from the origin loses no digits.
        let corner = self.vertices[0];
        self.edges().map(|(a, b)| (a - corner).perp(&(b - corner))).sum::<f64>() / 2.0
    }

    /// The area centroid, m.
    #[must_use]
    pub fn centroid(&self) -> Point2<f64> {
        centroid_of(&self.vertices)
    }

    /// The same with each edge's line moved outwards along its normal by so much, m; vertices are where the lines then
    /// meet. None where that is no simple polygon.
    ///
    /// Where two edges go straight on, their lines do not meet: the vertex moves by the mean of both.
    #[must_use]
    pub fn with_edges_moved(&self, by: impl Fn(usize) -> f64) -> Option<Self> {
        let count = self.vertices.len();
        let at = |index: usize| self.vertices[index % count];
        let along = |edge: usize| (at(edge + 1) - at(edge)).normalize();
        let moved = |vertex: usize| {
            let (before, after) = ((vertex + count - 1) % count, vertex);
            let (one, other) = (along(before), along(after));
            let turn = one.perp(&other);
            let out = |way: Vector2<f64>| Vector2::new(way.y, -way.x);
            // The change of the vertex along either normal is that of the line.
            let change = if turn.abs() > FLAT_TURN {
                (one * by(after) - other * by(before)) / turn
            } else {
                out(one) * (0.5 * (by(before) + by(after)))
            };
            at(vertex) + change
        };
        let vertices: Vec<_> = (0..count).map(moved).collect();
        // A short edge between two that move on turns round.
        let is_same_way = |edge: usize| (vertices[(edge + 1) % count] - vertices[edge]).dot(&along(edge)) > 0.0;
        (0..count).all(is_same_way).then(|| Self::new(vertices.clone()).ok()).flatten()
    }

    /// The first vertex with an inner angle over 180°, decided exactly; `None` for a convex polygon.
    #[must_use]
    pub fn first_reflex_vertex(&self) -> Option<usize> {
        (0..self.vertices.len()).find(|&i| {
            let [before, here, after] = around(&self.vertices, i);
            turn(before, here, after) < 0.0
        })
    }
}

/// Positive where `a → b → c` turns left, negative where it turns right, zero exactly where it goes straight.
pub(super) fn turn(a: Point2<f64>, b: Point2<f64>, c: Point2<f64>) -> f64 {
    let coordinates = |p: Point2<f64>| robust::Coord { x: p.x, y: p.y };
    robust::orient2d(coordinates(a), coordinates(b), coordinates(c))
}

/// A vertex between its neighbours.
pub(super) fn around(vertices: &[Point2<f64>], i: usize) -> [Point2<f64>; 3] {
    let n = vertices.len();
    [vertices[(i + n - 1) % n], vertices[i], vertices[(i + 1) % n]]
}

fn check_coordinates(vertices: &[Point2<f64>]) -> Result<(), PolygonError> {
    let out_of_range = |value: &&f64| value.is_nan() || value.abs() > COORDINATE_MAX_M;
    let bad = vertices.iter().enumerate().find_map(|(i, p)| Some((i, *p.coords.iter().find(out_of_range)?)));
    bad.map_or(Ok(()), |(vertex, value)| Err(PolygonError::CoordinateOutOfRange { vertex, value }))
}

/// Looks for neighbours at one point and for spikes: after this, two neighbouring edges share their vertex and no more.
fn check_neighbours(vertices: &[Point2<f64>], extent: f64) -> Result<(), PolygonError> {
    let n = vertices.len();
    let repeats = |i: usize| (vertices[(i + 1) % n] - vertices[i]).norm() < EDGE_MIN_RELATIVE * extent;
    match (0..n).find(|&i| repeats(i)) {
        Some(last) if last + 1 == n => return Err(PolygonError::Closed { last }),
        Some(first) => return Err(PolygonError::Repeated { first, second: first + 1 }),
        None => {}
    }
    if (0..n).all(|i| turn_is_straight(around(vertices, i))) {
        return Err(PolygonError::OnOneLine { count: n });
    }
    let spike = (0..n).find(|&i| is_spike(around(vertices, i)));
    spike.map_or(Ok(()), |vertex| Err(PolygonError::Spike { vertex }))
}

/// Whether three points lie on one line, decided exactly.
fn turn_is_straight([before, here, after]: [Point2<f64>; 3]) -> bool {
    turn(before, here, after) == 0.0
}

/// Whether the second of three points is a turn straight back. Exact: on one line, order is order in either coordinate.
fn is_spike([before, here, after]: [Point2<f64>; 3]) -> bool {
    let beyond_both = |a: f64, b: f64, c: f64| (b > a && b > c) || (b < a && b < c);
    turn(before, here, after) == 0.0
        && (beyond_both(before.x, here.x, after.x) || beyond_both(before.y, here.y, after.y))
}

/// Whether a simple polygon runs counter-clockwise: the sense of the turn at its leftmost (then lowest) vertex,
/// exactly.
fn is_counter_clockwise(vertices: &[Point2<f64>]) -> bool {
    let leftmost = (0..vertices.len()).min_by(|&i, &j| sweep_order(vertices[i], vertices[j])).unwrap_or(0);
    let [before, here, after] = around(vertices, leftmost);
    turn(before, here, after) > 0.0
}

/// The area centroid of an outline, m.
pub(super) fn centroid_of(vertices: &[Point2<f64>]) -> Point2<f64> {
    // Measured from a vertex, as the area is; that vertex's own two edges add nothing then.
    let corner = vertices[0];
    let (mut twice_area, mut moment) = (0.0, Vector2::zeros());
    for pair in vertices.windows(2) {
        let (a, b) = (pair[0] - corner, pair[1] - corner);
        let cross = a.perp(&b);
        twice_area += cross;
        moment += cross * (a + b);
    }
    corner + moment / (3.0 * twice_area)
}

/// The lower left and the upper right corner of the box around points, m.
///
/// # Panics
/// Without points.
#[must_use]
pub fn bounding_box(points: &[Point2<f64>]) -> (Point2<f64>, Point2<f64>) {
    points.iter().fold((points[0], points[0]), |(low, high), p| (low.inf(p), high.sup(p)))
}

/// The longer side of the bounding box, m.
pub(crate) fn extent_of(points: &[Point2<f64>]) -> f64 {
    let (low, high) = bounding_box(points);
    (high - low).max()
}

/// Looks for a point listed twice anywhere in the outline.
fn check_repeats(vertices: &[Point2<f64>]) -> Result<(), PolygonError> {
    let mut order: Vec<usize> = (0..vertices.len()).collect();
    order.sort_by(|&i, &j| sweep_order(vertices[i], vertices[j]).then(i.cmp(&j)));
    let pair = order.windows(2).find(|pair| sweep_order(vertices[pair[0]], vertices[pair[1]]).is_eq());
    pair.map_or(Ok(()), |pair| Err(PolygonError::Repeated { first: pair[0], second: pair[1] }))
}

/// The order in which a sweep meets points: from left to right, those on one vertical from the bottom up.
pub(super) fn sweep_order(a: Point2<f64>, b: Point2<f64>) -> Ordering {
    // As numbers, where -0 is 0; NaN was refused before.
    let compare = |a: f64, b: f64| a.partial_cmp(&b).unwrap_or(Ordering::Equal);
    compare(a.x, b.x).then(compare(a.y, b.y))
}

/// An edge under the sweep line of [`check_crossings`], ordered from the bottom up.
#[derive(Clone, Copy)]
struct SweptEdge {
    index: usize,
    left: Point2<f64>,
    right: Point2<f64>,
}

impl SweptEdge {
    fn new(vertices: &[Point2<f64>], index: usize) -> Self {
        let (a, b) = (vertices[index], vertices[(index + 1) % vertices.len()]);
        let (left, right) = if sweep_order(a, b).is_lt() { (a, b) } else { (b, a) };
        Self { index, left, right }
    }

    /// Whether two edges have a point in common, ends included.
    fn meets(&self, other: &Self) -> bool {
        let apart = |line: &Self, p: Point2<f64>, q: Point2<f64>| {
            let (p, q) = (turn(line.left, line.right, p), turn(line.left, line.right, q));
            (p > 0.0 && q > 0.0) || (p < 0.0 && q < 0.0)
        };
        // The boxes decide edges on one line.
        let boxes_overlap = [0, 1].into_iter().all(|axis| {
            let range = |edge: &Self| (edge.left[axis].min(edge.right[axis]), edge.left[axis].max(edge.right[axis]));
            let ((low, high), (other_low, other_high)) = (range(self), range(other));
            low <= other_high && other_low <= high
        });
        boxes_overlap && !apart(self, other.left, other.right) && !apart(other, self.left, self.right)
    }
}

impl Ord for SweptEdge {
    /// Which edge is higher where the sweep meets the later of the two, decided exactly.
    fn cmp(&self, other: &Self) -> Ordering {
        if self.index == other.index {
            return Ordering::Equal;
        }
        if sweep_order(self.left, other.left).is_lt() {
            return other.cmp(self).reverse();
        }
        let above = |p: Point2<f64>| turn(other.left, other.right, p).partial_cmp(&0.0).unwrap_or(Ordering::Equal);
        above(self.left).then_with(|| above(self.right)).then(self.index.cmp(&other.index))
    }
}

impl PartialOrd for SweptEdge {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for SweptEdge {
    fn eq(&self, other: &Self) -> bool {
        self.index == other.index
    }
}

impl Eq for SweptEdge {}

/// Looks for edges that meet without being neighbours, by the sweep of Shamos and Hoey (1976).
///
/// Edges that meet are next to each other under the sweep line before it reaches the first point where any do, so it is
/// enough to compare edges as they become so. The order under the line is right up to there because it is decided
/// exactly. n log n, whatever the outline. Every vertex is known to be listed once.
fn check_crossings(vertices: &[Point2<f64>]) -> Result<(), PolygonError> {
    let n = vertices.len();
    let mut order: Vec<usize> = (0..n).collect();
    order.sort_by(|&i, &j| sweep_order(vertices[i], vertices[j]));
    let mut open = BTreeSet::new();
    for i in order {
        let edges = [(i + n - 1) % n, i].map(|index| SweptEdge::new(vertices, index));
        let starts_here = |edge: &SweptEdge| sweep_order(edge.left, vertices[i]).is_eq();
        // What ends here goes first: it is no neighbour of what comes.
        for edge in edges.iter().filter(|edge| !starts_here(edge)) {
            open.remove(edge);
            check_pair(below(&open, edge), above(&open, edge), n)?;
        }
        for edge in edges.iter().filter(|edge| starts_here(edge)) {
            check_pair(below(&open, edge), Some(edge), n)?;
            check_pair(Some(edge), above(&open, edge), n)?;
            open.insert(*edge);
        }
    }
    Ok(())
}

fn below<'a>(open: &'a BTreeSet<SweptEdge>, edge: &SweptEdge) -> Option<&'a SweptEdge> {
    open.range(..edge).next_back()
}

fn above<'a>(open: &'a BTreeSet<SweptEdge>, edge: &SweptEdge) -> Option<&'a SweptEdge> {
    open.range((Bound::Excluded(edge), Bound::Unbounded)).next()
}

/// Two edges next to each other under the sweep line may meet only if they are neighbours in the outline.
fn check_pair(a: Option<&SweptEdge>, b: Option<&SweptEdge>, n: usize) -> Result<(), PolygonError> {
    let (Some(a), Some(b)) = (a, b) else { return Ok(()) };
    let (first, second) = (a.index.min(b.index), a.index.max(b.index));
    let neighbours = second - first == 1 || second - first == n - 1;
    if !neighbours && a.meets(b) { Err(PolygonError::Crossing { first, second }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn polygon(points: &[[f64; 2]]) -> Result<SimplePolygon, PolygonError> {
        SimplePolygon::new(points.iter().map(|&p| Point2::from(p)).collect::<Vec<_>>())
    }

    /// Every vertex of the moved outline is on both moved lines: by their distances.
    #[test]
    fn moved_edges_are_as_far_out_as_asked() {
        let told = [[0.0, 0.0], [0.06, 0.0], [0.07, 0.03], [0.03, 0.02], [-0.01, 0.05]].map(Point2::from);
        let told = SimplePolygon::new(told).unwrap();
        let by = |edge: usize| [1e-3, -2e-3, 5e-4, 0.0, 2e-3][edge];
        let moved = told.with_edges_moved(by).unwrap();
        for (edge, ((from, to), (start, end))) in told.edges().zip(moved.edges()).enumerate() {
            let along = (to - from).normalize();
            let out = Vector2::new(along.y, -along.x);
            for vertex in [start, end] {
                assert!(((vertex - from).dot(&out) - by(edge)).abs() < 1e-15, "edge {edge}");
            }
        }
        assert!(told.with_edges_moved(|_| -0.05).is_none(), "nothing is left");
    }

    #[test]
    fn a_block_has_its_area() {
        let block = polygon(&[[0.01, 0.02], [0.07, 0.02], [0.07, 0.06], [0.01, 0.06]]).unwrap();
        assert!((block.area() - 0.06 * 0.04).abs() < 1e-17, "{}", block.area());
        assert!((block.centroid() - Point2::new(0.04, 0.04)).norm() < 1e-17, "{}", block.centroid());
        assert_eq!(block.edges().len(), 4);
        assert_eq!(block.edges().last().unwrap(), (Point2::new(0.01, 0.06), Point2::new(0.01, 0.02)));
    }

    #[test]
    fn a_flat_vertex_is_allowed() {
        let flat = polygon(&[[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 1.0]]).unwrap();
        assert_eq!(flat.first_reflex_vertex(), None);
    }

    #[test]
    fn a_notch_is_a_reflex_vertex() {
        let notched = polygon(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, 0.2], [0.0, 1.0]]).unwrap();
        assert_eq!(notched.first_reflex_vertex(), Some(3));
    }

    #[test]
    fn each_fault_has_its_own_error() {
        use PolygonError as E;
        let cases: [(&[[f64; 2]], E); 12] = [
            (&[[0.0, 0.0], [1.0, 0.0]], E::TooFewVertices { count: 2 }),
            (&[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0]], E::Clockwise),
            (&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]], E::Crossing { first: 0, second: 2 }),
            (&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]], E::Closed { last: 3 }),
            (&[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [1.0, 1.0]], E::Repeated { first: 1, second: 2 }),
            (
                &[[0.0, 0.0], [1.0, 0.0], [2.0, 1.0], [2.0, -1.0], [1.0, 0.0], [0.0, -1.0]],
                E::Repeated { first: 1, second: 4 },
            ),
            (&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 2.0], [1.0, 1.0], [0.0, 1.0]], E::Spike { vertex: 3 }),
            (&[[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], E::OnOneLine { count: 3 }),
            // A vertex in the middle of another edge.
            (&[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [1.0, 0.0], [0.0, 2.0]], E::Crossing { first: 0, second: 3 }),
            (&[[0.0, 0.0], [1e-300, 0.0], [0.0, 1e-300]], E::TooSmall { extent: 1e-300 }),
            (&[[0.0, 0.0], [1e300, 0.0], [0.0, 1.0]], E::CoordinateOutOfRange { vertex: 1, value: 1e300 }),
            (&[[0.0, 0.0], [1.0, 0.0], [0.5, 1e-13]], E::TooThin { area: 0.5e-13, limit: 1e-12 }),
        ];
        for (points, expected) in cases {
            assert_eq!(polygon(points), Err(expected), "{points:?}");
        }
        let not_a_number = polygon(&[[0.0, 0.0], [f64::NAN, 0.0], [0.0, 1.0]]).unwrap_err();
        assert_eq!(not_a_number.vertex(), Some(1));
    }

    /// The smallest turn a double can make, which floating-point products alone call straight.
    #[test]
    fn the_direction_of_the_thinnest_wedge_is_exact() {
        let (a, b, c) = (Point2::new(0.5, 0.5), Point2::new(12.0, 12.0), Point2::new(24.0, 24.0_f64.next_up()));
        assert!(turn(a, b, c) > 0.0);
        assert!(turn(a, b, Point2::new(24.0, 24.0_f64.next_down())) < 0.0);
        assert!((b - a).perp(&(c - b)).abs() < 1e-13);
    }

    /// Corners at growing angles about a point inside, with enough room between them to survive a rounding.
    fn star() -> impl Strategy<Value = Vec<Point2<f64>>> {
        (3_u32..40).prop_flat_map(|n| {
            proptest::collection::vec((0.5..2.0_f64, -0.2..0.2_f64), n as usize).prop_map(move |corners| {
                let step = std::f64::consts::TAU / f64::from(n);
                let at = |(i, (radius, jitter)): (u32, (f64, f64))| {
                    let angle = step * (f64::from(i) + jitter);
                    Point2::new(radius * angle.cos(), radius * angle.sin())
                };
                (0..n).zip(corners).map(at).collect()
            })
        })
    }

    /// Coarse grid points, where every degeneracy turns up: repeats, spikes, touching and crossing edges.
    fn scribble() -> impl Strategy<Value = Vec<[i32; 2]>> {
        proptest::collection::vec([0..6_i32, 0..6_i32], 3..9)
    }

    /// Whether closed integer segments meet, and where: `None`, one point, or a stretch. By Cramer's rule in integers;
    /// shares nothing with the code above.
    #[derive(PartialEq)]
    enum Meeting {
        None,
        Point,
        Stretch,
    }

    fn integer_meeting(a: [i32; 2], b: [i32; 2], c: [i32; 2], d: [i32; 2]) -> Meeting {
        let difference = |p: [i32; 2], q: [i32; 2]| [q[0] - p[0], q[1] - p[1]];
        let cross = |p: [i32; 2], q: [i32; 2]| p[0] * q[1] - p[1] * q[0];
        let dot = |p: [i32; 2], q: [i32; 2]| p[0] * q[0] + p[1] * q[1];
        let (ab, cd, ac) = (difference(a, b), difference(c, d), difference(a, c));
        let denominator = cross(ab, cd);
        if denominator == 0 {
            if cross(ab, ac) != 0 {
                return Meeting::None;
            }
            let (p, q) = (dot(ac, ab), dot(difference(a, d), ab));
            let (low, high) = (p.min(q).max(0), p.max(q).min(dot(ab, ab)));
            return match high - low {
                ..0 => Meeting::None,
                0 => Meeting::Point,
                _ => Meeting::Stretch,
            };
        }
        let within = |numerator: i32| {
            let numerator = numerator * denominator.signum();
            (0..=denominator.abs()).contains(&numerator)
        };
        if within(cross(ac, cd)) && within(cross(ac, ab)) { Meeting::Point } else { Meeting::None }
    }

    fn integer_is_simple(points: &[[i32; 2]]) -> bool {
        let n = points.len();
        let edge = |i: usize| (points[i], points[(i + 1) % n]);
        (0..n).all(|i| edge(i).0 != edge(i).1)
            && (0..n).all(|i| {
                (i + 1..n).all(|j| {
                    let meeting = integer_meeting(edge(i).0, edge(i).1, edge(j).0, edge(j).1);
                    let adjacent = j == i + 1 || (i == 0 && j == n - 1);
                    meeting == if adjacent { Meeting::Point } else { Meeting::None }
                })
            })
    }

    fn integer_twice_area(points: &[[i32; 2]]) -> i32 {
        let n = points.len();
        (0..n).map(|i| points[i][0] * points[(i + 1) % n][1] - points[(i + 1) % n][0] * points[i][1]).sum()
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(5000))]

        #[test]
        fn exhaustive_integer_search_agrees(points in scribble()) {
            let floats: Vec<_> = points.iter().map(|p| Point2::new(f64::from(p[0]), f64::from(p[1]))).collect();
            let found = SimplePolygon::new(floats);
            match (integer_is_simple(&points), integer_twice_area(&points) > 0) {
                (true, true) => {
                    let twice_area = 2.0 * found.unwrap().area();
                    prop_assert!((twice_area - f64::from(integer_twice_area(&points))).abs() < 1e-9);
                }
                (true, false) => prop_assert_eq!(found, Err(PolygonError::Clockwise)),
                (false, _) => prop_assert!(!matches!(found, Ok(_) | Err(PolygonError::Clockwise)), "{:?}", found),
            }
        }

        /// Larger outlines than the integers above can afford, with one corner moved to where it may cross others.
        #[test]
        fn comparing_all_pairs_of_edges_agrees(points in star(), moved in 0..40_usize, x in -2.0..2.0_f64, y in -2.0..2.0_f64) {
            let mut points = points;
            let n = points.len();
            points[moved % n] = Point2::new(x, y);
            let edges: Vec<_> = (0..n).map(|i| SweptEdge::new(&points, i)).collect();
            let cross = |i: usize, j: usize| check_pair(Some(&edges[i]), Some(&edges[j]), n).is_err();
            let any = (0..n).any(|i| (0..i).any(|j| cross(i, j)));
            prop_assert_eq!(matches!(SimplePolygon::new(points), Err(PolygonError::Crossing { .. })), any);
        }

        #[test]
        fn turning_and_shifting_change_no_verdict(
            points in star(), angle in -10.0..10.0_f64, x in -5.0..5.0_f64, y in -5.0..5.0_f64,
        ) {
            let moved: Vec<_> = points.iter().map(|p| nalgebra::Isometry2::new([x, y].into(), angle) * p).collect();
            let (before, after) = (SimplePolygon::new(points).unwrap(), SimplePolygon::new(moved).unwrap());
            // Relative: forty terms of rounding each, at coordinates up to 9 and areas from 0.1.
            prop_assert!((after.area() / before.area() - 1.0).abs() < 1e-11);
        }

        #[test]
        fn starting_elsewhere_changes_no_verdict(points in scribble(), shift in 0..9_usize) {
            let floats: Vec<_> = points.iter().map(|p| Point2::new(f64::from(p[0]), f64::from(p[1]))).collect();
            let mut turned = floats.clone();
            turned.rotate_left(shift % floats.len());
            prop_assert_eq!(SimplePolygon::new(floats).is_ok(), SimplePolygon::new(turned).is_ok());
        }

        #[test]
        fn the_reverse_of_a_polygon_is_clockwise(points in star()) {
            let reversed: Vec<_> = points.iter().rev().copied().collect();
            prop_assert!(SimplePolygon::new(points).is_ok());
            prop_assert_eq!(SimplePolygon::new(reversed), Err(PolygonError::Clockwise));
        }
    }
}
