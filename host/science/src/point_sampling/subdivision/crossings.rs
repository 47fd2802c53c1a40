//! Where the edges of polygons cut each other: nodes, and the nodes along every edge.
//!
//! Edges meet in every way that edges of parts in a tray do: they cross, end on one another, share ends, lie on one
//! another, and several cross in one point. All of it comes down to two kinds of node, a vertex or the crossing of two
//! edges; equal nodes are found where they stand beside each other along an edge, and made one.
//!
//! Two collinear edges that overlap need no case of their own: the ends of each lie on the other, cut it there, and
//! leave pieces between the same two nodes.

use std::cmp::Ordering;
use std::collections::HashMap;
use std::ops::Range;

use nalgebra::Point2;

use super::grid::Grid;
use crate::geometry::SimplePolygon;
use crate::geometry::exact::{COORDINATE_MIN_M, Cut, Segment, quotient, turn};
use crate::search::Halt;

/// An edge of a polygon.
#[derive(Clone, Copy, Debug)]
pub(super) struct Edge {
    pub segment: Segment,
    pub polygon: u32,
    /// Vertices at its start and end.
    pub ends: [u32; 2],
}

/// The cut edges: what is needed to walk along them.
#[derive(Debug)]
pub(super) struct Cuts {
    pub edges: Vec<Edge>,
    /// Where each node is; exact for vertices, rounded for crossings.
    pub places: Vec<Point2<f64>>,
    /// Nodes below this number are vertices of polygons.
    pub vertices: usize,
    /// Edges that lie on another for a stretch.
    pub overlapping: Vec<bool>,
    /// Polygons that touch or cross, put together.
    pub components: UnionFind,
    marks: Vec<Mark>,
    first_mark: Vec<u32>,
    /// Which edges cross at each node that is a crossing.
    crossing: Vec<[u32; 2]>,
    same: Option<UnionFind>,
}

/// A node on the interior of an edge.
#[derive(Clone, Copy, Debug)]
struct Mark {
    node: u32,
    /// Where along the edge, from 0 to 1, and a bound on its error.
    at: f64,
    error: f64,
}

/// A crossing or touch of two edges, as found.
#[derive(Clone, Copy, Debug)]
struct Found {
    edge: u32,
    mark: Mark,
}

impl Cuts {
    /// None where one should halt before it is done.
    pub(super) fn new(polygons: &[SimplePolygon], halt: &Halt<'_>) -> Option<Self> {
        let (edges, places) = edges_of(polygons, halt)?;
        let vertices = places.len();
        let overlapping = vec![false; edges.len()];
        let components = UnionFind::new(polygons.len());
        let (marks, first_mark, crossing) = Default::default();
        let mut cuts =
            Self { edges, places, vertices, overlapping, components, marks, first_mark, crossing, same: None };
        let found = cuts.find(halt)?;
        cuts.sort(found, halt)?;
        Some(cuts)
    }

    /// The nodes along an edge in order, its ends included, none twice.
    pub(super) fn along(&self, edge: usize) -> impl Iterator<Item = u32> + '_ {
        let [start, end] = self.edges[edge].ends;
        let nodes = [start].into_iter().chain(self.marks[self.range(edge)].iter().map(|mark| mark.node)).chain([end]);
        let mut last = None;
        nodes.map(|node| self.node(node)).filter(move |&node| last.replace(node) != Some(node))
    }

    /// The piece of an edge just right of the abscissa `x`, which the edge spans: counted from 0 along the edge.
    pub(super) fn piece_at(&self, edge: usize, x: f64) -> usize {
        let segment = self.edges[edge].segment;
        let line = Cut::At { axis: 0, value: x };
        // An edge that runs to the left comes by what is right of `x` before it comes to `x`.
        let counts = |order: Ordering| if segment.end.x > segment.start.x { order.is_le() } else { order.is_lt() };
        let before = |mark: &&Mark| counts(self.cut(edge, mark.node).exact_order(line, segment));
        let mut last = None;
        let marks = self.marks[self.range(edge)].iter().take_while(before).map(|mark| self.node(mark.node));
        marks.filter(|&node| last.replace(node) != Some(node)).count()
    }

    /// The node that stands for this one and all equal to it.
    fn node(&self, node: u32) -> u32 {
        self.same.as_ref().map_or(node, |same| same.root_of(node))
    }

    fn range(&self, edge: usize) -> Range<usize> {
        self.first_mark[edge] as usize..self.first_mark[edge + 1] as usize
    }

    /// Looks at all pairs of edges that are near each other.
    /// What is found lies in as many heaps as there are edges: one heap is moved each time it outgrows its place.
    fn find(&mut self, halt: &Halt<'_>) -> Option<Vec<Vec<Found>>> {
        let mut heaps = Vec::with_capacity(self.edges.len());
        let mut looks = halt.now_and_then();
        halt.goes_on()?;
        let mut grid = Grid::new(self.edges.iter().map(|edge| edge.segment));
        for edge in 0..self.edges.len() {
            let near = grid.insert(edge, self.edges[edge].segment);
            halt.goes_on()?;
            let mut found = Vec::new();
            for &other in near {
                looks.goes_on()?;
                self.meet(edge, other as usize, &mut found);
            }
            heaps.push(found);
        }
        Some(heaps)
    }

    /// Notes where two edges cut each other.
    fn meet(&mut self, a: usize, b: usize, found: &mut Vec<Found>) {
        let (first, second) = (self.edges[a], self.edges[b]);
        if first.polygon == second.polygon || !boxes_meet(first.segment, second.segment) {
            return;
        }
        let (s, t) = (first.segment, second.segment);
        let t_ends = [turn(s.start, s.end, t.start), turn(s.start, s.end, t.end)];
        if same_side(t_ends) {
            return;
        }
        let s_ends = [turn(t.start, t.end, s.start), turn(t.start, t.end, s.end)];
        if same_side(s_ends) {
            return;
        }
        let on_line = |ends: &[(f64, f64); 2]| ends.map(|(value, _)| value == 0.0);
        if on_line(&s_ends) == [false; 2] && on_line(&t_ends) == [false; 2] {
            self.cross([a, b], [s_ends, t_ends], found);
        } else {
            self.touch([a, b], on_line(&t_ends), found);
            self.touch([b, a], on_line(&s_ends), found);
            if on_line(&s_ends) == [true; 2] {
                (self.overlapping[a], self.overlapping[b]) = (true, true);
            }
        }
    }

    /// A crossing in the interior of both: a node of its own.
    fn cross(&mut self, edges: [usize; 2], ends: [[(f64, f64); 2]; 2], found: &mut Vec<Found>) {
        let node = index(self.places.len());
        let mut place = Point2::origin();
        for (edge, ends) in edges.into_iter().zip(ends) {
            let (at, error) = quotient(ends[0], ends[1]);
            let Segment { start, end } = self.edges[edge].segment;
            place = start + at * (end - start);
            found.push(Found { edge: index(edge), mark: Mark { node, at, error } });
        }
        self.places.push(place);
        self.crossing.push(edges.map(index));
        self.components.unite(self.edges[edges[0]].polygon, self.edges[edges[1]].polygon);
    }

    /// Ends of the second edge on the first: those on its line and not beyond it.
    fn touch(&mut self, [edge, other]: [usize; 2], on_line: [bool; 2], found: &mut Vec<Found>) {
        let (on, by) = (self.edges[edge], self.edges[other]);
        let points = [by.segment.start, by.segment.end];
        for (place, vertex) in
            points.into_iter().zip(by.ends).zip(on_line).filter_map(|(point, on)| on.then_some(point))
        {
            if !in_box(on.segment, place) {
                continue;
            }
            self.components.unite(on.polygon, by.polygon);
            if !on.ends.contains(&vertex) {
                let (at, error) = Cut::point(on.segment, place).parameter(on.segment);
                found.push(Found { edge: index(edge), mark: Mark { node: vertex, at, error } });
            }
        }
    }

    /// Sorts what was found along every edge, and makes equal nodes one.
    fn sort(&mut self, found: Vec<Vec<Found>>, halt: &Halt<'_>) -> Option<()> {
        let (marks, first_mark) = grouped(found, self.edges.len(), halt)?;
        (self.marks, self.first_mark) = (marks, first_mark);
        let mut marks = std::mem::take(&mut self.marks);
        let mut same = None;
        for edge in 0..self.edges.len() {
            let range = self.range(edge);
            // An edge may cross all others.
            let mut along = marks[range.clone()].to_vec();
            halt.sort_by(&mut along, |a, b| self.order(edge, *a, *b))?;
            for pair in along.windows(2) {
                if self.order(edge, pair[0], pair[1]).is_eq() && pair[0].node != pair[1].node {
                    same.get_or_insert_with(|| UnionFind::new(self.places.len())).unite(pair[0].node, pair[1].node);
                }
            }
            marks[range].copy_from_slice(&along);
            halt.goes_on()?;
        }
        (self.marks, self.same) = (marks, same);
        Some(())
    }

    fn order(&self, edge: usize, a: Mark, b: Mark) -> Ordering {
        if (a.at - b.at).abs() > a.error + b.error {
            a.at.total_cmp(&b.at)
        } else if a.node == b.node {
            Ordering::Equal
        } else {
            self.cut(edge, a.node).exact_order(self.cut(edge, b.node), self.edges[edge].segment)
        }
    }

    fn cut(&self, edge: usize, node: u32) -> Cut {
        let segment = self.edges[edge].segment;
        match (node as usize).checked_sub(self.vertices) {
            None => Cut::point(segment, self.places[node as usize]),
            Some(crossing) => {
                let [a, b] = self.crossing[crossing].map(|edge| edge as usize);
                let other = if a == edge { b } else { a };
                Cut::Crossing(self.edges[other].segment)
            }
        }
    }
}

/// The edges of polygons, and their vertices without repetition.
/// None where one should halt before.
fn edges_of(polygons: &[SimplePolygon], halt: &Halt<'_>) -> Option<(Vec<Edge>, Vec<Point2<f64>>)> {
    let mut numbers = HashMap::new();
    let mut places = Vec::new();
    let mut number = |p: Point2<f64>| {
        *numbers.entry([p.x.to_bits(), p.y.to_bits()]).or_insert_with(|| {
            places.push(p);
            index(places.len() - 1)
        })
    };
    let mut edges = Vec::new();
    let mut looks = halt.now_and_then();
    for (polygon, shape) in polygons.iter().enumerate() {
        let corner = |&p: &Point2<f64>| looks.goes_on().map(|()| cleaned(p)).map(|p| (p, number(p)));
        let corners: Vec<_> = shape.vertices().iter().map(corner).collect::<Option<_>>()?;
        let next = corners.iter().cycle().skip(1);
        edges.extend(corners.iter().zip(next).map(|(&(start, from), &(end, to))| Edge {
            segment: Segment { start, end },
            polygon: index(polygon),
            ends: [from, to],
        }));
    }
    Some((edges, places))
}

/// Without negative zeros and numbers too small to multiply.
fn cleaned(p: Point2<f64>) -> Point2<f64> {
    p.map(|value| if value.abs() < COORDINATE_MIN_M { 0.0 } else { value })
}

/// Sorts by edge, keeping the order otherwise: the marks, and where each edge's begin. None where one should halt before.
fn grouped(found: Vec<Vec<Found>>, edges: usize, halt: &Halt<'_>) -> Option<(Vec<Mark>, Vec<u32>)> {
    let mut looks = halt.now_and_then();
    let mut first = vec![0_u32; edges + 1];
    for one in found.iter().flatten() {
        looks.goes_on()?;
        first[one.edge as usize + 1] += 1;
    }
    (0..edges).for_each(|edge| first[edge + 1] += first[edge]);
    let (mut next, count) = (first.clone(), first[edges] as usize);
    let mut marks = Vec::with_capacity(count);
    for _ in 0..count {
        looks.goes_on()?;
        marks.push(Mark { node: 0, at: 0.0, error: 0.0 });
    }
    for one in found.into_iter().flatten() {
        looks.goes_on()?;
        let place = &mut next[one.edge as usize];
        marks[*place as usize] = one.mark;
        *place += 1;
    }
    Some((marks, first))
}

fn same_side([(p, _), (q, _)]: [(f64, f64); 2]) -> bool {
    (p > 0.0 && q > 0.0) || (p < 0.0 && q < 0.0)
}

fn boxes_meet(a: Segment, b: Segment) -> bool {
    let apart = |a0: f64, a1: f64, b0: f64, b1: f64| a0.max(a1) < b0.min(b1) || b0.max(b1) < a0.min(a1);
    !apart(a.start.x, a.end.x, b.start.x, b.end.x) && !apart(a.start.y, a.end.y, b.start.y, b.end.y)
}

fn in_box(segment: Segment, p: Point2<f64>) -> bool {
    let within = |a: f64, b: f64, value: f64| a.min(b) <= value && value <= a.max(b);
    within(segment.start.x, segment.end.x, p.x) && within(segment.start.y, segment.end.y, p.y)
}

/// A number that counts nodes, edges or polygons.
pub(super) fn index(number: usize) -> u32 {
    // Four thousand million nodes would take hundreds of gigabytes before they are counted here.
    u32::try_from(number).unwrap_or(u32::MAX)
}

/// Things put together in classes.
#[derive(Clone, Debug)]
pub(super) struct UnionFind {
    parent: Vec<u32>,
}

impl UnionFind {
    pub(super) fn new(count: usize) -> Self {
        Self { parent: (0..index(count)).collect() }
    }

    /// The least member of a class.
    pub(super) fn root_of(&self, mut member: u32) -> u32 {
        while self.parent[member as usize] != member {
            member = self.parent[member as usize];
        }
        member
    }

    pub(super) fn unite(&mut self, a: u32, b: u32) {
        let (a, b) = (self.shortened(a), self.shortened(b));
        self.parent[a.max(b) as usize] = a.min(b);
    }

    /// The root, with the way to it halved.
    fn shortened(&mut self, mut member: u32) -> u32 {
        while self.parent[member as usize] != member {
            let above = self.parent[self.parent[member as usize] as usize];
            self.parent[member as usize] = above;
            member = above;
        }
        member
    }
}
