//! The planar subdivision that polygons form, with the polygons that contain each of its faces (thesis §3.1).
//!
//! Topology is exact: it comes from signs that are decided exactly, so shared edges, touching vertices, identical
//! polygons and several edges through one point are no special cases and need no tolerance. Coordinates of crossings
//! are rounded.
//!
//! In reading order: `crossings` cuts the edges where they meet, with a `grid` that finds which may; `graph` makes the
//! pieces a planar graph; this module finds which loops are faces, which lie inside which, and what contains them.
//!
//! Memory: a few words for each piece of an edge, and one bit for each polygon and loop.
//! Frames: that of the polygons. Units: m, m². Errors: none.

mod crossings;
mod graph;
mod grid;
#[cfg(test)]
mod tests;

use crossings::{Cuts, index};
use graph::{Graph, twin};
use nalgebra::{Point2, Vector2};

use crate::geometry::exact::{order_above, turn};
use crate::geometry::{SimplePolygon, bounding_box};
use crate::math::bits::{BitMatrix, BitRow};
use crate::search::{Halt, Stop, never};

/// A planar subdivision.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::SimplePolygon;
/// use palpate::point_sampling::Subdivision;
///
/// let block = |x: f64| SimplePolygon::new([[x, 0.0], [x + 0.06, 0.0], [x + 0.06, 0.04], [x, 0.04]].map(Point2::from));
/// let subdivision = Subdivision::new(&[block(0.0)?, block(0.02)?]); // both on one fence
/// assert_eq!(subdivision.regions().count(), 3);
/// # Ok::<(), palpate::geometry::PolygonError>(())
/// ```
#[derive(Debug)]
pub struct Subdivision {
    cuts: Cuts,
    graph: Graph,
    /// Which polygons contain what lies to the left of each loop.
    inside: BitMatrix,
    /// Loops that go round a component from outside, each with the loop whose face holds the component.
    outer: Vec<(u32, Option<u32>)>,
    /// The same, by loop.
    is_outer: Vec<bool>,
}

/// A bounded face that lies in at least one polygon.
#[derive(Clone, Copy, Debug)]
pub struct Region<'a> {
    subdivision: &'a Subdivision,
    number: u32,
}

impl Subdivision {
    /// The subdivision formed by polygons.
    #[must_use]
    pub fn new(polygons: &[SimplePolygon]) -> Self {
        Self::new_until(polygons, &never).unwrap_or_else(|| unreachable!("nobody wishes it to stop"))
    }

    /// The same, ended when `stop` says so: then there is none, because of half a subdivision nothing is true.
    #[must_use]
    pub fn new_until(polygons: &[SimplePolygon], stop: Stop<'_>) -> Option<Self> {
        let halt = Halt::new(stop);
        let cuts = Cuts::new(polygons, &halt)?;
        let graph = Graph::new(&cuts, &halt)?;
        let inside = BitMatrix::new(graph.loops.len(), polygons.len());
        let is_outer = vec![false; graph.loops.len()];
        let mut subdivision = Self { cuts, graph, inside, outer: Vec::new(), is_outer };
        subdivision.fill(polygons, &halt);
        (!halt.was_wished()).then_some(subdivision)
    }

    /// The bounded faces that lie in at least one polygon.
    pub fn regions(&self) -> impl Iterator<Item = Region<'_>> {
        let bounded = |&number: &u32| !self.is_outer[number as usize] && self.inside.row(number as usize).any();
        let regions = (0..index(self.graph.loops.len())).filter(bounded);
        regions.map(|number| Region { subdivision: self, number })
    }

    /// The number of bounded faces that lie in no polygon.
    #[must_use]
    pub fn holes(&self) -> usize {
        let loops = 0..self.graph.loops.len();
        loops.filter(|&number| !self.is_outer[number] && !self.inside.row(number).any()).count()
    }

    /// Finds for every loop what contains the face on its left: from the outside of each component inwards, one edge at
    /// a time. Ends where one should halt.
    fn fill(&mut self, polygons: &[SimplePolygon], halt: &Halt<'_>) {
        let components = self.components(polygons);
        let boxes: Vec<_> = polygons.iter().map(Extent::of).collect();
        // From left to right, so that what encloses a component comes before it.
        for (component, node) in components {
            if halt.is_wished() {
                return;
            }
            let outer = self.loop_outside(node);
            let around = self.face_below(component, node, &boxes);
            if let Some(around) = around {
                self.inside.copy_row(around as usize, outer as usize);
            }
            self.is_outer[outer as usize] = true;
            self.outer.push((outer, around));
            self.spread(outer, halt);
        }
    }

    /// Components with their leftmost vertices, from left to right.
    fn components(&self, polygons: &[SimplePolygon]) -> Vec<(u32, u32)> {
        let mut leftmost: Vec<Option<u32>> = vec![None; polygons.len()];
        for edge in &self.cuts.edges {
            let component = self.cuts.components.root_of(edge.polygon) as usize;
            let node = edge.ends[0];
            if leftmost[component].is_none_or(|known| self.is_left_of(node, known)) {
                leftmost[component] = Some(node);
            }
        }
        let found = leftmost.into_iter().enumerate().filter_map(|(component, node)| Some((index(component), node?)));
        let mut found: Vec<_> = found.collect();
        found.sort_unstable_by(|a, b| self.sweep_key(a.1).partial_cmp(&self.sweep_key(b.1)).unwrap_or(a.cmp(b)));
        found
    }

    fn sweep_key(&self, node: u32) -> [f64; 2] {
        self.cuts.places[node as usize].into()
    }

    fn is_left_of(&self, a: u32, b: u32) -> bool {
        self.sweep_key(a) < self.sweep_key(b)
    }

    /// The loop around a component from outside, given its leftmost, then lowest, vertex: nothing leads from there to
    /// the left, so the outside is to the left of the half-edge that comes last from straight down to straight up.
    fn loop_outside(&self, node: u32) -> u32 {
        let around = self.graph.around(node);
        let is_upward = |&&half_edge: &&u32| self.direction(half_edge).y >= 0.0;
        // They are sorted from +x on: first those that go up, then those that go down.
        let last_upward = around.iter().rfind(is_upward);
        let half_edge = last_upward.or(around.last()).copied().unwrap_or(0);
        self.graph.loop_of[half_edge as usize]
    }

    /// The direction of the edge that a half-edge lies on, along the half-edge; not a unit vector.
    fn direction(&self, half_edge: u32) -> Vector2<f64> {
        let segment = self.cuts.edges[self.graph.edge_of[half_edge as usize / 2] as usize].segment;
        let along = segment.end - segment.start;
        if half_edge.is_multiple_of(2) { along } else { -along }
    }

    fn half_edge_place(&self, half_edge: u32) -> Point2<f64> {
        self.cuts.places[self.graph.origin[half_edge as usize] as usize]
    }

    /// The loop whose face holds a component, given the component's leftmost vertex: it lies on the edge that is met
    /// first straight down from just right of the vertex. None where no edge is met.
    fn face_below(&self, component: u32, node: u32, boxes: &[Extent]) -> Option<u32> {
        let from = self.cuts.places[node as usize];
        let mut highest: Option<usize> = None;
        for (edge, candidate) in self.cuts.edges.iter().enumerate() {
            let spans = boxes[candidate.polygon as usize].is_over(from) && candidate.spans(from.x);
            if !spans || self.cuts.components.root_of(candidate.polygon) == component || !candidate.is_below(from) {
                continue;
            }
            let segment = candidate.segment;
            let higher = |known: usize| order_above(segment, self.cuts.edges[known].segment, from.x).is_gt();
            if highest.is_none_or(higher) {
                highest = Some(edge);
            }
        }
        let edge = highest?;
        let half_edge = self.graph.half_edge_along(&self.cuts, edge, self.cuts.piece_at(edge, from.x));
        let segment = self.cuts.edges[edge].segment;
        // What is above lies to the left of a half-edge that runs to the right.
        let upper = if segment.end.x > segment.start.x { half_edge } else { twin(half_edge) };
        Some(self.graph.loop_of[upper as usize])
    }

    /// From one loop to all of its component: across an edge of a polygon one is in it if one was not.
    fn spread(&mut self, first: u32, halt: &Halt<'_>) {
        let (mut known, mut looks) = (vec![first], halt.now_and_then());
        let mut seen = std::mem::take(&mut self.is_outer);
        seen[first as usize] = true;
        let mut reached = vec![first];
        while let Some(number) = known.pop().filter(|_| !halt.is_wished()) {
            let start = self.graph.loops[number as usize];
            let mut half_edge = start;
            loop {
                let across = self.graph.loop_of[twin(half_edge) as usize];
                if !seen[across as usize] {
                    seen[across as usize] = true;
                    self.inside.copy_row(number as usize, across as usize);
                    for edge in self.graph.edges_at(half_edge) {
                        self.inside.flip(across as usize, self.cuts.edges[edge as usize].polygon as usize);
                    }
                    known.push(across);
                    reached.push(across);
                }
                half_edge = self.graph.next[half_edge as usize];
                if half_edge == start {
                    break;
                }
            }
        }
        for &number in reached.iter().skip(1) {
            // Half of it is never looked at.
            if looks.goes_on().is_none() {
                break;
            }
            seen[number as usize] = false;
        }
        self.is_outer = seen;
    }
}

impl crossings::Edge {
    /// Whether it goes from `x` to the right, or from the left beyond `x`.
    fn spans(&self, x: f64) -> bool {
        let (a, b) = (self.segment.start.x, self.segment.end.x);
        a.min(b) <= x && x < a.max(b)
    }

    /// Whether a point in its range of abscissas lies above it.
    fn is_below(&self, p: Point2<f64>) -> bool {
        let (side, _) = turn(self.segment.start, self.segment.end, p);
        if self.segment.end.x > self.segment.start.x { side > 0.0 } else { side < 0.0 }
    }
}

/// An upright rectangle around something, m.
#[derive(Clone, Copy, Debug)]
struct Extent {
    low: Point2<f64>,
    high: Point2<f64>,
}

impl Extent {
    fn of(polygon: &SimplePolygon) -> Self {
        let (low, high) = bounding_box(polygon.vertices());
        Self { low, high }
    }

    /// Whether part of it is straight below a point or around it.
    fn is_over(&self, p: Point2<f64>) -> bool {
        self.low.x <= p.x && p.x <= self.high.x && self.low.y <= p.y
    }
}

impl<'a> Region<'a> {
    /// The polygons that contain it, one bit each.
    #[must_use]
    pub fn inside(&self) -> BitRow<'a> {
        self.subdivision.inside.row(self.number as usize)
    }

    /// The loops that bound it: the outer one, counter-clockwise, then those around what lies in it, clockwise.
    ///
    /// A loop is given by the edges it runs along, in order; crossings have rounded coordinates.
    pub fn boundary(&self) -> impl Iterator<Item = impl Iterator<Item = Piece> + 'a> + 'a {
        let (subdivision, number) = (self.subdivision, self.number);
        let held = subdivision.outer.iter().filter(move |(_, around)| *around == Some(number)).map(|(outer, _)| *outer);
        std::iter::once(number).chain(held).map(move |number| subdivision.pieces(number))
    }

    /// Its area, m²; rounded like the coordinates of its corners.
    #[must_use]
    pub fn area(&self) -> f64 {
        let origin = self.boundary().next().and_then(|mut pieces| pieces.next()).map(|piece| piece.start);
        let origin = origin.unwrap_or_else(Point2::origin);
        let part = |piece: Piece| (piece.start - origin).perp(&(piece.end - origin));
        self.boundary().flatten().map(part).sum::<f64>() / 2.0
    }
}

/// A piece of a region's boundary, with the region to its left.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Piece {
    /// Where it starts, m.
    pub start: Point2<f64>,
    /// Where it ends, m.
    pub end: Point2<f64>,
    /// The direction of the edge that it lies on, from which its line is known best; not a unit vector.
    pub along: Vector2<f64>,
    /// A point on that edge.
    pub through: Point2<f64>,
}

impl Subdivision {
    fn pieces(&self, number: u32) -> impl Iterator<Item = Piece> + '_ {
        self.graph.walk(number).map(|half_edge| {
            let [start, end] = [half_edge, twin(half_edge)].map(|end| self.half_edge_place(end));
            let through = self.cuts.edges[self.graph.edge_of[half_edge as usize / 2] as usize].segment.start;
            let along = self.direction(half_edge);
            Piece { start, end, along, through }
        })
    }
}
