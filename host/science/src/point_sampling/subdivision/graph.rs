//! The cut edges as a planar graph of half-edges, each with a loop on its left.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use nalgebra::Vector2;

use super::crossings::{Cuts, index};
use crate::geometry::exact::cross_sign;
use crate::search::Halt;

/// Directions whose pseudo-angles are nearer than this are compared exactly: a hundred times what rounding does to
/// them.
const PSEUDO_ANGLE_ERROR: f64 = 1e-13;

/// A planar graph. Half-edges `2 i` and `2 i + 1` are the two directions of piece `i`.
#[derive(Debug)]
pub(super) struct Graph {
    /// Where each half-edge starts.
    pub origin: Vec<u32>,
    /// The half-edge that follows on the loop to the left.
    pub next: Vec<u32>,
    /// The loop to the left.
    pub loop_of: Vec<u32>,
    /// One half-edge of every loop.
    pub loops: Vec<u32>,
    /// The edge that each piece was cut from.
    pub edge_of: Vec<u32>,
    /// Further edges that the same piece is cut from: pairs of piece and edge, sorted.
    pub also: Vec<[u32; 2]>,
    /// Pieces of each edge in order, and where each edge's begin.
    pieces: Vec<u32>,
    first_piece: Vec<u32>,
    /// Half-edges by the node they start at, counter-clockwise from the direction of +x.
    around: Vec<u32>,
    first_around: Vec<u32>,
}

/// The half-edge in the other direction.
pub(super) fn twin(half_edge: u32) -> u32 {
    half_edge ^ 1
}

impl Graph {
    /// None where one should halt before it is done.
    pub(super) fn new(cuts: &Cuts, halt: &Halt<'_>) -> Option<Self> {
        let mut graph = Self::pieces_of(cuts, halt)?;
        graph.sort_around(cuts, halt)?;
        graph.link(halt)?;
        graph.label_loops(halt)?;
        Some(graph)
    }

    /// A piece of an edge as the half-edge in the edge's direction.
    pub(super) fn half_edge_along(&self, cuts: &Cuts, edge: usize, piece: usize) -> u32 {
        let number = 2 * self.pieces[self.first_piece[edge] as usize + piece];
        let start = cuts.along(edge).nth(piece);
        if start == Some(self.origin[number as usize]) { number } else { twin(number) }
    }

    /// The half-edges that start at a node, counter-clockwise from the direction of +x.
    pub(super) fn around(&self, node: u32) -> &[u32] {
        &self.around[self.first_around[node as usize] as usize..self.first_around[node as usize + 1] as usize]
    }

    /// The half-edges of a loop.
    pub(super) fn walk(&self, number: u32) -> impl Iterator<Item = u32> + '_ {
        let first = self.loops[number as usize];
        let after = move |&half_edge: &u32| Some(self.next[half_edge as usize]).filter(|&next| next != first);
        std::iter::successors(Some(first), after)
    }

    /// The edges that a half-edge lies on.
    pub(super) fn edges_at(&self, half_edge: u32) -> impl Iterator<Item = u32> + '_ {
        let piece = half_edge / 2;
        let begin = if self.also.is_empty() { 0 } else { self.also.partition_point(|also| also[0] < piece) };
        let more = self.also[begin..].iter().take_while(move |also| also[0] == piece).map(|also| also[1]);
        std::iter::once(self.edge_of[piece as usize]).chain(more)
    }

    /// Cuts edges into pieces; pieces that lie on each other are one.
    fn pieces_of(cuts: &Cuts, halt: &Halt<'_>) -> Option<Self> {
        let mut looks = halt.now_and_then();
        let mut shared: HashMap<[u32; 2], u32> = HashMap::new();
        let (mut origin, mut edge_of, mut also) = (Vec::new(), Vec::new(), Vec::new());
        let (mut pieces, mut first_piece) = (Vec::new(), vec![0]);
        for edge in 0..cuts.edges.len() {
            let mut nodes = cuts.along(edge);
            let mut start = nodes.next();
            for end in nodes {
                looks.goes_on()?;
                let from = start.replace(end).unwrap_or(end);
                let piece = index(edge_of.len());
                let entry = cuts.overlapping[edge].then(|| shared.entry([from.min(end), from.max(end)]));
                if let Some(Entry::Occupied(known)) = entry {
                    also.push([*known.get(), index(edge)]);
                    pieces.push(*known.get());
                    continue;
                }
                if let Some(Entry::Vacant(free)) = entry {
                    free.insert(piece);
                }
                origin.extend([from, end]);
                edge_of.push(index(edge));
                pieces.push(piece);
            }
            first_piece.push(index(pieces.len()));
        }
        // No two are equal.
        halt.sort_by(&mut also, Ord::cmp)?;
        let (next, loop_of, loops, around, first_around) = Default::default();
        Some(Self { origin, next, loop_of, loops, edge_of, also, pieces, first_piece, around, first_around })
    }

    /// Sorts the half-edges around every node.
    fn sort_around(&mut self, cuts: &Cuts, halt: &Halt<'_>) -> Option<()> {
        let mut looks = halt.now_and_then();
        let mut first = vec![0_u32; cuts.places.len() + 1];
        for &node in &self.origin {
            looks.goes_on()?;
            first[node as usize + 1] += 1;
        }
        for node in 1..first.len() {
            looks.goes_on()?;
            first[node] += first[node - 1];
        }
        let (mut place, mut around) = (first.clone(), vec![0; self.origin.len()]);
        for (half_edge, &node) in self.origin.iter().enumerate() {
            looks.goes_on()?;
            around[place[node as usize] as usize] = index(half_edge);
            place[node as usize] += 1;
        }
        let directions = Directions::new(self, cuts);
        for node in 0..cuts.places.len() {
            looks.goes_on()?;
            let range = first[node] as usize..first[node + 1] as usize;
            around[range].sort_unstable_by(|&a, &b| directions.order(a, b));
        }
        (self.around, self.first_around) = (around, first);
        Some(())
    }

    /// Finds what follows each half-edge: having come to a node, the first to the right of the way back.
    fn link(&mut self, halt: &Halt<'_>) -> Option<()> {
        let mut looks = halt.now_and_then();
        let mut next = vec![0; self.origin.len()];
        for node in 0..index(self.first_around.len() - 1) {
            looks.goes_on()?;
            let around = self.around(node);
            let before = around.iter().cycle().skip(around.len().saturating_sub(1));
            around.iter().zip(before).for_each(|(&back, &follows)| next[twin(back) as usize] = follows);
        }
        self.next = next;
        Some(())
    }

    fn label_loops(&mut self, halt: &Halt<'_>) -> Option<()> {
        const UNKNOWN: u32 = u32::MAX;
        let mut looks = halt.now_and_then();
        let mut loop_of = vec![UNKNOWN; self.origin.len()];
        for first in 0..self.origin.len() {
            if loop_of[first] != UNKNOWN {
                continue;
            }
            let number = index(self.loops.len());
            self.loops.push(index(first));
            let mut half_edge = first;
            while loop_of[half_edge] == UNKNOWN {
                looks.goes_on()?;
                loop_of[half_edge] = number;
                half_edge = self.next[half_edge] as usize;
            }
        }
        self.loop_of = loop_of;
        Some(())
    }
}

/// The directions of half-edges, comparable.
struct Directions<'a> {
    graph: &'a Graph,
    cuts: &'a Cuts,
    /// Of each edge, in its own direction.
    pseudo_angle: Vec<f64>,
}

impl<'a> Directions<'a> {
    fn new(graph: &'a Graph, cuts: &'a Cuts) -> Self {
        let direction = |edge: &super::crossings::Edge| pseudo_angle(edge.segment.end - edge.segment.start);
        Self { graph, cuts, pseudo_angle: cuts.edges.iter().map(direction).collect() }
    }

    fn of(&self, half_edge: u32) -> f64 {
        let angle = self.pseudo_angle[self.graph.edge_of[half_edge as usize / 2] as usize];
        // A piece starts out in the direction of the edge that it was first cut from.
        match half_edge % 2 {
            0 => angle,
            _ if angle < 2.0 => angle + 2.0,
            _ => angle - 2.0,
        }
    }

    /// Counter-clockwise from the direction of +x.
    fn order(&self, a: u32, b: u32) -> std::cmp::Ordering {
        let (p, q) = (self.of(a), self.of(b));
        if (p - q).abs() > PSEUDO_ANGLE_ERROR {
            return p.total_cmp(&q);
        }
        let segment = |half_edge: u32| self.cuts.edges[self.graph.edge_of[half_edge as usize / 2] as usize].segment;
        let sign = if (a ^ b).is_multiple_of(2) { 1 } else { -1 };
        0.cmp(&(sign * cross_sign(segment(a), segment(b))))
    }
}

/// A number that grows with the direction's angle, from 0 at +x to 4; exact in its quadrant.
fn pseudo_angle(direction: Vector2<f64>) -> f64 {
    let [x, y]: [f64; 2] = direction.into();
    let share = |part: f64, other: f64| part.abs() / (part.abs() + other.abs());
    match (x > 0.0, y > 0.0) {
        (true, _) if y >= 0.0 => share(y, x),
        (_, true) => 1.0 + share(x, y),
        (_, false) if x < 0.0 => 2.0 + share(y, x),
        _ => 3.0 + share(x, y),
    }
}
