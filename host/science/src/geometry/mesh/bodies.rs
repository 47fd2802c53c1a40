//! Whether the closed bodies of a surface have room in common.
//!
//! A body is what hangs together by edges of two facets. Each facet is moved a little into its body. A facet of another body
//! that cuts it has a point inside, so that the two overlap; bodies that only touch are not reached. Where no body cuts
//! another, each is wholly in or wholly outside of every other, and one point of it tells which: just within the surface the
//! surface goes round once, twice in a body within a body, and not at all in one that is inside out. In a cavity's wall it is once.
//!
//! Implements: the winding number as the sum of solid angles (Van Oosterom and Strackee, IEEE Trans. Biomed. Eng. 30, 1983).
//! Complexity: O(n log n) for n facets of which few are near to each other, and O(n) for each body.

use std::f64::consts::TAU;

use nalgebra::{Point3, Vector3};

use super::{Mesh, MeshError, root, sides};

/// Bodies that are no deeper in each other than this share of the longest side of the box around touch: it is a
/// hundred times what single precision rounds, and no mass that matters.
const TOUCHING_RELATIVE: f64 = 1e-5;

/// A moved facet keeps so many times what it is moved from its own sides, so that it stays in a body whose faces meet there
/// at 15° or more.
const MARGIN: f64 = 4.0;

/// Facets in a leaf of the tree.
const LEAF: usize = 4;

impl Mesh {
    /// Whether what is enclosed is enclosed once.
    pub(super) fn check_apart(&self, places: &[usize]) -> Result<(), MeshError> {
        let bodies = self.bodies();
        if bodies.iter().all(|body| *body == bodies[0]) {
            return Ok(());
        }
        let depth = TOUCHING_RELATIVE * self.extent();
        let within: Vec<_> = self.facets.iter().map(|facet| moved_in(&self.corners(facet), depth)).collect();
        let tree = Tree::of(self.facets.iter().map(|facet| bounds(&self.corners(facet))).collect());
        for (facet, moved) in within.iter().enumerate() {
            let other = tree.find(&bounds(&moved.corners), &|other| {
                bodies[other] != bodies[facet] && cross(&moved.corners, &self.corners(&self.facets[other]))
            });
            if let Some(other) = other {
                return Err(MeshError::Overlap { facet: places[facet], other: places[other] });
            }
        }
        // The widest facet of each body is the best to stand behind.
        let mut widest: Vec<Option<usize>> = vec![None; self.facets.len()];
        for (facet, moved) in within.iter().enumerate() {
            let best = &mut widest[bodies[facet]];
            if best.is_none_or(|best| within[best].radius < moved.radius) {
                *best = Some(facet);
            }
        }
        for facet in widest.into_iter().flatten() {
            let facet_number = places[facet];
            match self.winding_number(middle(&within[facet].corners)) {
                turns if turns > 1 => return Err(MeshError::Inside { facet: facet_number }),
                turns if turns < 1 => return Err(MeshError::InsideOut { facet: facet_number }),
                _ => {}
            }
        }
        Ok(())
    }

    /// For each facet the number of its body.
    fn bodies(&self) -> Vec<usize> {
        let mut edges: Vec<_> = Vec::with_capacity(3 * self.facets.len());
        for (number, facet) in self.facets.iter().enumerate() {
            edges.extend(sides(facet).map(|(from, to)| (from.min(to), from.max(to), number)));
        }
        edges.sort_unstable();
        let mut group: Vec<usize> = (0..self.facets.len()).collect();
        // Where four meet it is not known which belong together.
        for edge in edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(|edge| edge.len() == 2) {
            let (a, b) = (root(&mut group, edge[0].2), root(&mut group, edge[1].2));
            group[a] = b;
        }
        (0..self.facets.len()).map(|facet| root(&mut group, facet)).collect()
    }

    /// How often the surface goes round a point that is not on it.
    fn winding_number(&self, point: Point3<f64>) -> i64 {
        let angle = |facet| {
            let [a, b, c] = self.corners(facet).map(|corner| corner - point);
            let [na, nb, nc] = [a, b, c].map(|side| side.norm());
            let below = na * nb * nc + a.dot(&b) * nc + b.dot(&c) * na + c.dot(&a) * nb;
            // Half of the solid angle.
            a.dot(&b.cross(&c)).atan2(below)
        };
        let turns = self.facets.iter().map(angle).sum::<f64>() / TAU;
        #[expect(clippy::cast_possible_truncation, reason = "a surface goes round no more often than it has facets")]
        let turns = turns.round() as i64;
        turns
    }
}

/// A facet moved into its body.
struct Moved {
    corners: [Point3<f64>; 3],
    /// Of the circle inside the facet, m.
    radius: f64,
}

fn moved_in(corners: &[Point3<f64>; 3], depth: f64) -> Moved {
    let [a, b, c] = *corners;
    let lengths = [(c - b).norm(), (a - c).norm(), (b - a).norm()];
    let around: f64 = lengths.iter().sum();
    let normal = (b - a).cross(&(c - a));
    let radius = normal.norm() / around;
    let middle = Point3::from((a.coords * lengths[0] + b.coords * lengths[1] + c.coords * lengths[2]) / around);
    // A facet narrower than the margin keeps half of its width.
    let margin = (MARGIN * depth).min(radius / 2.0);
    let share = if radius > 0.0 { 1.0 - margin / radius } else { 0.0 };
    let inward = normal.try_normalize(0.0).unwrap_or_else(Vector3::zeros) * (-margin / MARGIN);
    Moved { corners: corners.map(|corner| middle + (corner - middle) * share + inward), radius }
}

fn middle([a, b, c]: &[Point3<f64>; 3]) -> Point3<f64> {
    a + ((b - a) + (c - a)) / 3.0
}

/// Whether two triangles have a point in common; not said of those in one plane.
fn cross(one: &[Point3<f64>; 3], other: &[Point3<f64>; 3]) -> bool {
    pierces(one, other) || pierces(other, one)
}

/// Whether a side of one triangle meets the other.
fn pierces(one: &[Point3<f64>; 3], [a, b, c]: &[Point3<f64>; 3]) -> bool {
    let volume =
        |p: &Point3<f64>, q: &Point3<f64>, r: &Point3<f64>, s: &Point3<f64>| (q - p).dot(&(r - p).cross(&(s - p)));
    let heights = one.map(|corner| volume(&corner, a, b, c));
    (0..3).any(|i| {
        let (from, to) = (one[i], one[(i + 1) % 3]);
        let (low, high) = (heights[i], heights[(i + 1) % 3]);
        if low.min(high) > 0.0 || low.max(high) < 0.0 || (low == 0.0 && high == 0.0) {
            return false;
        }
        let turns = [volume(&from, &to, a, b), volume(&from, &to, b, c), volume(&from, &to, c, a)];
        turns.iter().all(|turn| *turn >= 0.0) || turns.iter().all(|turn| *turn <= 0.0)
    })
}

/// The box around: its lowest and its highest corner.
type Bounds = [Point3<f64>; 2];

fn bounds([a, b, c]: &[Point3<f64>; 3]) -> Bounds {
    [a.inf(b).inf(c), a.sup(b).sup(c)]
}

fn is_near(a: &Bounds, b: &Bounds) -> bool {
    (0..3).all(|axis| a[0][axis] <= b[1][axis] && b[0][axis] <= a[1][axis])
}

/// Boxes of facets in halves of halves.
struct Tree {
    facets: Vec<Bounds>,
    order: Vec<usize>,
    /// Around all of a node's facets; the halves of node k are 2 k + 1 and 2 k + 2.
    nodes: Vec<Bounds>,
}

impl Tree {
    fn of(facets: Vec<Bounds>) -> Self {
        let order = (0..facets.len()).collect();
        let mut tree = Self { facets, order, nodes: Vec::new() };
        tree.build(0, 0, tree.order.len());
        tree
    }

    fn build(&mut self, node: usize, begin: usize, end: usize) {
        let facets = &self.facets;
        let around = self.order[begin..end].iter().fold(facets[self.order[begin]], |[low, high], facet| {
            [low.inf(&facets[*facet][0]), high.sup(&facets[*facet][1])]
        });
        if self.nodes.len() <= node {
            self.nodes.resize(node + 1, around);
        }
        self.nodes[node] = around;
        if end - begin <= LEAF {
            return;
        }
        let axis = (around[1] - around[0]).imax();
        let middle = usize::midpoint(begin, end);
        let key = |facet: &usize| facets[*facet][0][axis] + facets[*facet][1][axis];
        self.order[begin..end].select_nth_unstable_by(middle - begin, |a, b| key(a).total_cmp(&key(b)));
        self.build(2 * node + 1, begin, middle);
        self.build(2 * node + 2, middle, end);
    }

    /// A facet whose box meets this one and that is wanted.
    fn find(&self, near: &Bounds, is_wanted: &dyn Fn(usize) -> bool) -> Option<usize> {
        let mut open = vec![(0, 0, self.order.len())];
        while let Some((node, begin, end)) = open.pop() {
            if !is_near(near, &self.nodes[node]) {
                continue;
            }
            if end - begin <= LEAF {
                let mut facets = self.order[begin..end].iter().copied();
                if let Some(found) = facets.find(|facet| is_near(near, &self.facets[*facet]) && is_wanted(*facet)) {
                    return Some(found);
                }
                continue;
            }
            let middle = usize::midpoint(begin, end);
            open.extend([(2 * node + 1, begin, middle), (2 * node + 2, middle, end)]);
        }
        None
    }
}
