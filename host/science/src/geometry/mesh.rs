//! A solid by its surface of triangles: what it weighs, its outline at a height, and what it stands on.
//!
//! [`Mesh::new`] is the only way to one: every edge of the surface is passed as often one way as the other, so the surface
//! is closed, and closed bodies in one file have no room in common (`bodies`), so volume, centre of mass and slices are those of
//! a solid. A surface that is inside out is turned. That one body does not cut through itself is not checked.
//!
//! Implements: volume, first and second moments by sums over the tetrahedra from one corner to each facet.
//! Frames: x and y of the table, z up. Units: m. A slice goes counter-clockwise round material, clockwise round holes.
//! Errors: [`MeshError`].

mod bodies;

use std::collections::HashMap;

use nalgebra::{Point2, Point3, Vector3};

/// Most facets of a mesh: a finger feels nothing of what a hundredth of them leave out, and memory stays below 300 MB.
pub const FACETS_MAX: usize = 1_000_000;

/// So near to the lowest point, as a share of the longest side of the box around, the surface touches the table: files
/// round to 1e-7, and no table is flatter.
pub const BASE_RELATIVE: f64 = 1e-4;

/// Least volume as a share of the longest side cubed: below it rounding decides where the mass is.
const VOLUME_MIN_RELATIVE: f64 = 1e-9;

/// A closed surface of triangles around material.
#[derive(Clone, Debug, PartialEq)]
pub struct Mesh {
    points: Vec<Point3<f64>>,
    /// Corners counter-clockwise as seen from outside.
    facets: Vec<[usize; 3]>,
}

/// Why triangles are no solid. Facets count from 0.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// No triangle with an area.
    #[error("the mesh has no facet")]
    Empty,
    /// More than is taken.
    #[error("the mesh has {count} facets, the limit is {FACETS_MAX}: export it coarser")]
    TooManyFacets {
        /// How many.
        count: usize,
    },
    /// A corner that is no place.
    #[error("facet {facet} has a corner that is not finite")]
    NotFinite {
        /// Number of the facet.
        facet: usize,
    },
    /// An edge with material on one side only.
    #[error("the surface is open at {open} of its edges, the first on facet {facet}: repair the mesh")]
    Open {
        /// A facet at such an edge.
        facet: usize,
        /// How many edges are.
        open: usize,
    },
    /// A surface that encloses nothing.
    #[error("the mesh encloses no volume: it is a sheet, not a solid")]
    NoVolume,
    /// Bodies with room in common, which would weigh twice.
    #[error(
        "closed bodies of the mesh overlap, at facet {facet} and facet {other}: what they share would weigh twice; join them in the CAD program"
    )]
    Overlap {
        /// A facet of one.
        facet: usize,
        /// A facet of the other.
        other: usize,
    },
    /// A body within another that is no cavity.
    #[error("the closed body of facet {facet} is inside another: it would weigh twice; join them in the CAD program")]
    Inside {
        /// A facet of the inner one.
        facet: usize,
    },
    /// A body of less than nothing.
    #[error("the closed body of facet {facet} is inside out: repair the mesh")]
    InsideOut {
        /// A facet of it.
        facet: usize,
    },
}

/// A part of what a solid stands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BasePatch {
    /// Of the patch, or of its points where it has no area, m.
    pub centroid: Point2<f64>,
    /// m²; 0 for an edge or a point.
    pub area: f64,
    /// Second moments of the area about the centroid over the area: xx, xy, yy, m².
    pub spread: [f64; 3],
}

impl Mesh {
    /// Checks a surface.
    ///
    /// Corners are one where they are the same to the last digit; triangles with a corner listed twice have no area and
    /// are left out.
    ///
    /// # Errors
    /// [`MeshError`] names the first thing found wrong.
    pub fn new(triangles: &[[Point3<f64>; 3]]) -> Result<Self, MeshError> {
        if triangles.len() > FACETS_MAX {
            return Err(MeshError::TooManyFacets { count: triangles.len() });
        }
        let mut mesh = Self { points: Vec::new(), facets: Vec::new() };
        let mut known = HashMap::new();
        // Where each facet that is kept stood.
        let mut places = Vec::new();
        for (facet, corners) in triangles.iter().enumerate() {
            if corners.iter().any(|corner| corner.coords.iter().any(|value| !value.is_finite())) {
                return Err(MeshError::NotFinite { facet });
            }
            let indices = corners.map(|corner| {
                // As bits, where −0 is 0.
                let key: [u64; 3] = corner.coords.map(|value| (value + 0.0).to_bits()).into();
                *known.entry(key).or_insert_with(|| {
                    mesh.points.push(corner);
                    mesh.points.len() - 1
                })
            });
            let [a, b, c] = indices;
            if a != b && b != c && c != a {
                mesh.facets.push(indices);
                places.push(facet);
            }
        }
        if mesh.facets.is_empty() {
            return Err(MeshError::Empty);
        }
        mesh.check_closed(&places)?;
        let volume = mesh.volume();
        if volume.abs() <= VOLUME_MIN_RELATIVE * mesh.extent().powi(3) {
            return Err(MeshError::NoVolume);
        }
        if volume < 0.0 {
            mesh.facets.iter_mut().for_each(|facet| facet.swap(1, 2));
        }
        mesh.check_apart(&places)?;
        Ok(mesh)
    }

    /// Whether every edge is passed as often one way as the other.
    fn check_closed(&self, places: &[usize]) -> Result<(), MeshError> {
        let mut edges: Vec<(usize, usize, i8, usize)> = Vec::with_capacity(3 * self.facets.len());
        for (facet, place) in self.facets.iter().zip(places) {
            for (from, to) in sides(facet) {
                edges.push((from.min(to), from.max(to), if from < to { 1 } else { -1 }, *place));
            }
        }
        edges.sort_unstable();
        let open = |edge: &&[(usize, usize, i8, usize)]| edge.iter().map(|edge| i32::from(edge.2)).sum::<i32>() != 0;
        let broken: Vec<_> = edges.chunk_by(|a, b| (a.0, a.1) == (b.0, b.1)).filter(open).collect();
        match broken.iter().flat_map(|edge| edge.iter()).map(|edge| edge.3).min() {
            None => Ok(()),
            Some(facet) => Err(MeshError::Open { facet, open: broken.len() }),
        }
    }

    /// Corners of a facet.
    fn corners(&self, facet: &[usize; 3]) -> [Point3<f64>; 3] {
        facet.map(|index| self.points[index])
    }

    /// The lowest and the highest z, m.
    #[must_use]
    pub fn heights(&self) -> [f64; 2] {
        let heights = || self.points.iter().map(|point| point.z);
        [heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max)]
    }

    /// Longest side of the box around, m.
    #[must_use]
    pub fn extent(&self) -> f64 {
        let (low, high) = self
            .points
            .iter()
            .fold((self.points[0], self.points[0]), |(low, high), point| (low.inf(point), high.sup(point)));
        (high - low).max()
    }

    /// m³.
    #[must_use]
    pub fn volume(&self) -> f64 {
        // From a corner, so that a solid far from the origin loses no digits.
        let corner = self.points[0];
        let six_volumes = |facet| {
            let [a, b, c] = self.corners(facet).map(|point| point - corner);
            a.dot(&b.cross(&c))
        };
        self.facets.iter().map(six_volumes).sum::<f64>() / 6.0
    }

    /// The centre of mass of a uniform solid, m.
    #[must_use]
    pub fn centre_of_mass(&self) -> Point3<f64> {
        let corner = self.points[0];
        let moment = |facet| {
            let [a, b, c] = self.corners(facet).map(|point| point - corner);
            (a + b + c) * a.dot(&b.cross(&c))
        };
        corner + self.facets.iter().map(moment).sum::<Vector3<f64>>() / (24.0 * self.volume())
    }

    /// The moment of inertia of a uniform solid about the vertical through its centre of mass, over its mass, m².
    #[must_use]
    pub fn inertia_per_mass(&self) -> f64 {
        let centre = self.centre_of_mass();
        let moment = |facet| {
            let corners = self.corners(facet).map(|point| point - centre);
            let [a, b, c] = corners;
            // ∫ x² over a tetrahedron with a corner at the origin is its volume / 10 × the sum over pairs of corners.
            let squares: f64 = [0, 1]
                .into_iter()
                .map(|axis| {
                    let x = corners.map(|corner| corner[axis]);
                    x[0] * x[0] + x[1] * x[1] + x[2] * x[2] + x[0] * x[1] + x[1] * x[2] + x[2] * x[0]
                })
                .sum();
            a.dot(&b.cross(&c)) * squares
        };
        self.facets.iter().map(moment).sum::<f64>() / (60.0 * self.volume())
    }

    /// The outlines at a height z, m: loops with the material on their left. None where the solid is not.
    ///
    /// Corners at this very height count as above it, so a slice at a shelf is the one just below.
    #[must_use]
    pub fn slice(&self, z: f64) -> Vec<Vec<Point2<f64>>> {
        let is_above = |index: usize| self.points[index].z >= z;
        // A facet is crossed from the edge at which its round comes down to that at which it goes up. On the edge of two
        // facets the one goes up where the other comes down, which chains them.
        let mut starts: HashMap<(usize, usize), Vec<(usize, usize)>> = HashMap::new();
        let mut order = Vec::new();
        for facet in &self.facets {
            let (mut down, mut up) = (None, None);
            for (from, to) in sides(facet) {
                match (is_above(from), is_above(to)) {
                    (true, false) => down = Some((to, from)),
                    (false, true) => up = Some((from, to)),
                    _ => {}
                }
            }
            if let (Some(down), Some(up)) = (down, up) {
                starts.entry(down).or_default().push(up);
                order.push(down);
            }
        }
        let crossing = |(below, above): (usize, usize)| {
            let (low, high) = (self.points[below], self.points[above]);
            (low + (high - low) * ((z - low.z) / (high.z - low.z))).xy()
        };
        let mut loops = Vec::new();
        for first in order {
            let (mut outline, mut edge) = (Vec::new(), first);
            while let Some(next) = starts.get_mut(&edge).and_then(Vec::pop) {
                let point = crossing(edge);
                if outline.last() != Some(&point) {
                    outline.push(point);
                }
                edge = next;
            }
            while outline.len() > 1 && outline.last() == outline.first() {
                outline.pop();
            }
            if outline.len() > 2 {
                loops.push(outline);
            }
        }
        loops
    }

    /// The facets that are seen from above, as triangles that run counter-clockwise. Together they are the solid's shadow.
    pub fn seen_from_above(&self) -> impl Iterator<Item = [Point2<f64>; 3]> + '_ {
        let seen = self.facets.iter().map(|facet| self.corners(facet).map(|point| point.xy()));
        seen.filter(|[a, b, c]| (b - a).perp(&(c - a)) > 0.0)
    }

    /// What the solid stands on: what is lowest, in pieces that hang together.
    #[must_use]
    pub fn base(&self) -> Vec<BasePatch> {
        let limit = self.heights()[0] + BASE_RELATIVE * self.extent();
        let is_low = |index: usize| self.points[index].z <= limit;
        let mut group: Vec<usize> = (0..self.points.len()).collect();
        for (from, to) in self.facets.iter().flat_map(sides) {
            if is_low(from) && is_low(to) {
                let (a, b) = (root(&mut group, from), root(&mut group, to));
                group[a] = b;
            }
        }
        let mut members: HashMap<usize, (Vec<usize>, Vec<[usize; 3]>)> = HashMap::new();
        for index in (0..self.points.len()).filter(|index| is_low(*index)) {
            members.entry(root(&mut group, index)).or_default().0.push(index);
        }
        for facet in self.facets.iter().filter(|facet| facet.iter().all(|index| is_low(*index))) {
            members.entry(root(&mut group, facet[0])).or_default().1.push(*facet);
        }
        let mut patches: Vec<(usize, BasePatch)> = members
            .into_values()
            .map(|(points, facets)| (points.iter().copied().min().unwrap_or(0), self.patch(&points, &facets)))
            .collect();
        patches.sort_by_key(|(first, _)| *first);
        patches.into_iter().map(|(_, patch)| patch).collect()
    }

    /// The piece with these low corners and facets.
    fn patch(&self, points: &[usize], facets: &[[usize; 3]]) -> BasePatch {
        let mean = points.iter().map(|index| self.points[*index].xy().coords).sum::<nalgebra::Vector2<f64>>()
            / f64::from(u32::try_from(points.len()).unwrap_or(u32::MAX));
        let none = BasePatch { centroid: Point2::from(mean), area: 0.0, spread: [0.0; 3] };
        // Seen from below, so that the area is positive.
        let triangles = || {
            facets.iter().map(|facet| {
                let [a, b, c] = self.corners(facet).map(|point| point.xy());
                ([a, b, c], (c - a).perp(&(b - a)) / 2.0)
            })
        };
        let area: f64 = triangles().map(|(_, area)| area).sum();
        if area <= (BASE_RELATIVE * self.extent()).powi(2) {
            return none;
        }
        let middle = |corners: &[Point2<f64>; 3]| centroid_of_corners(corners);
        let centroid =
            triangles().map(|(corners, share)| middle(&corners).coords * share).sum::<nalgebra::Vector2<f64>>() / area;
        let centroid = Point2::from(centroid);
        let spread = triangles().fold([0.0; 3], |sum, (corners, share)| {
            let at = corners.map(|corner| corner - centroid);
            let total = at[0] + at[1] + at[2];
            // ∫ over a triangle is its area / 12 × (the sum over corners, and that of the corners' sum).
            let term = |i: usize, j: usize| {
                share / 12.0 * (at.iter().map(|corner| corner[i] * corner[j]).sum::<f64>() + total[i] * total[j])
            };
            [sum[0] + term(0, 0), sum[1] + term(0, 1), sum[2] + term(1, 1)]
        });
        BasePatch { centroid, area, spread: spread.map(|value| value / area) }
    }
}

/// The middle of a triangle, whatever its area.
fn centroid_of_corners([a, b, c]: &[Point2<f64>; 3]) -> Point2<f64> {
    a + ((b - a) + (c - a)) / 3.0
}

/// The sides of a facet in its round.
fn sides(&[a, b, c]: &[usize; 3]) -> [(usize, usize); 3] {
    [(a, b), (b, c), (c, a)]
}

/// The number under which a point's group goes; what was passed goes there straight from now on.
fn root(group: &mut [usize], mut index: usize) -> usize {
    while group[index] != index {
        group[index] = group[group[index]];
        index = group[index];
    }
    index
}

/// How far an outline goes round counter-clockwise: its area, negative for a clockwise one, m².
#[must_use]
pub fn signed_area(outline: &[Point2<f64>]) -> f64 {
    let Some(corner) = outline.first() else { return 0.0 };
    outline.windows(2).map(|pair| (pair[0] - corner).perp(&(pair[1] - corner))).sum::<f64>() / 2.0
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::math::random::Draw;
    use crate::pushing::dynamics::Mass;

    /// Rounding of sums over some hundred facets.
    const ROUNDING: f64 = 1e-9;

    /// The prism over an outline between two heights, its lids fanned from `apex` inside a star-shaped outline.
    fn prism(outline: &[Point2<f64>], apex: Point2<f64>, [low, high]: [f64; 2]) -> Vec<[Point3<f64>; 3]> {
        let n = outline.len();
        let at = |p: Point2<f64>, z: f64| Point3::new(p.x, p.y, z);
        (0..n)
            .flat_map(|i| {
                let (a, b) = (outline[i], outline[(i + 1) % n]);
                [
                    [at(a, high), at(b, high), at(apex, high)],
                    [at(b, low), at(a, low), at(apex, low)],
                    [at(a, low), at(b, low), at(b, high)],
                    [at(a, low), at(b, high), at(a, high)],
                ]
            })
            .collect()
    }

    proptest! {
        #[test]
        fn a_prism_weighs_like_the_plate_and_is_its_outline_at_every_height(seed: u64, corners in 4..12_usize, share in 0.01..0.99) {
            let polygon = Draw::new(seed).star_polygon(corners, 0.02, 0.05);
            let heights = [0.003, 0.017];
            let mesh = Mesh::new(&prism(polygon.vertices(), Point2::origin(), heights)).unwrap();
            let plate = Mass::uniform(&polygon);
            prop_assert!((mesh.volume() / (polygon.area() * 0.014) - 1.0).abs() < ROUNDING);
            prop_assert!((mesh.centre_of_mass().xy() - plate.centre_of_mass).norm() < ROUNDING * 0.05);
            prop_assert!((mesh.centre_of_mass().z - 0.01).abs() < ROUNDING);
            prop_assert!((mesh.inertia_per_mass() / plate.inertia_per_mass - 1.0).abs() < ROUNDING);
            let loops = mesh.slice(heights[0] + share * 0.014);
            prop_assert_eq!(loops.len(), 1);
            prop_assert!((signed_area(&loops[0]) / polygon.area() - 1.0).abs() < ROUNDING);
            let base = mesh.base();
            prop_assert_eq!(base.len(), 1);
            prop_assert!((base[0].area / polygon.area() - 1.0).abs() < ROUNDING);
            prop_assert!((base[0].centroid - plate.centre_of_mass).norm() < ROUNDING);
            prop_assert!(((base[0].spread[0] + base[0].spread[2]) / plate.inertia_per_mass - 1.0).abs() < ROUNDING);
        }
    }

    fn square(half: f64) -> [Point2<f64>; 4] {
        [[-half, -half], [half, -half], [half, half], [-half, half]].map(Point2::from)
    }

    #[test]
    fn a_block_on_four_feet_stands_on_them_and_is_sliced_into_four() {
        let mut triangles = prism(&square(0.03), Point2::origin(), [0.0, 0.02]);
        for [x, y] in [[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]] {
            let foot = square(0.004).map(|p| Point2::new(p.x + x, p.y + y));
            triangles.extend(prism(&foot, Point2::new(x, y), [-0.005, 0.0]));
        }
        let mesh = Mesh::new(&triangles).unwrap();
        assert_eq!(mesh.slice(-0.002).len(), 4);
        let base = mesh.base();
        assert_eq!(base.len(), 4);
        for patch in base {
            assert!((patch.area - 6.4e-5).abs() < 1e-12, "{patch:?}");
            assert!((patch.centroid.x.abs() - 0.02).abs() < 1e-12, "{patch:?}");
            assert!((patch.spread[0] - 0.004 * 0.004 / 3.0).abs() < 1e-15, "{patch:?}");
        }
    }

    #[test]
    fn a_tube_has_a_hole_and_the_mass_of_its_wall() {
        let ring = |outward: bool| {
            let mut facets = prism(&square(if outward { 0.03 } else { 0.01 }), Point2::origin(), [0.0, 0.02]);
            // The lids of both would lie in the hole.
            facets.retain(|facet| facet.iter().any(|p| p.z > 0.01) && facet.iter().any(|p| p.z < 0.01));
            if !outward {
                facets.iter_mut().for_each(|facet| facet.swap(1, 2));
            }
            facets
        };
        let mut triangles = [ring(true), ring(false)].concat();
        let (outer, inner) = (square(0.03), square(0.01));
        for i in 0..4 {
            let j = (i + 1) % 4;
            for (z, turn) in [(0.02, false), (0.0, true)] {
                let at = |p: Point2<f64>| Point3::new(p.x, p.y, z);
                let quad = [at(outer[i]), at(outer[j]), at(inner[j]), at(inner[i])];
                for [a, b, c] in [[0, 1, 2], [0, 2, 3]] {
                    let (b, c) = if turn { (c, b) } else { (b, c) };
                    triangles.push([quad[a], quad[b], quad[c]]);
                }
            }
        }
        let mesh = Mesh::new(&triangles).unwrap();
        let mut areas: Vec<_> = mesh.slice(0.01).iter().map(|outline| signed_area(outline)).collect();
        areas.sort_by(f64::total_cmp);
        assert!((areas[0] + 4e-4).abs() < 1e-12 && (areas[1] - 3.6e-3).abs() < 1e-12, "{areas:?}");
        assert!((mesh.volume() - 6.4e-5).abs() < 1e-15);
        // (M R² − m r²) / (M − m), where squares of side s have s² / 6.
        let wanted = (3.6e-3 * 3.6e-3 - 4e-4 * 4e-4) / 6.0 / 3.2e-3;
        assert!((mesh.inertia_per_mass() / wanted - 1.0).abs() < ROUNDING);
        // Inside out it is the same solid.
        triangles.iter_mut().for_each(|facet| facet.swap(0, 1));
        assert!((Mesh::new(&triangles).unwrap().volume() - 6.4e-5).abs() < 1e-15);
    }

    #[test]
    fn what_is_no_solid_is_refused() {
        let block = prism(&square(0.03), Point2::origin(), [0.0, 0.02]);
        assert_eq!(Mesh::new(&block[1..]), Err(MeshError::Open { facet: 2, open: 3 }));
        assert_eq!(Mesh::new(&[]), Err(MeshError::Empty));
        let mut endless = block.clone();
        endless[5][1].x = f64::NAN;
        assert_eq!(Mesh::new(&endless), Err(MeshError::NotFinite { facet: 5 }));
        let flat: Vec<_> = block.iter().map(|facet| facet.map(|p| Point3::new(p.x, p.y, 0.0))).collect();
        assert_eq!(Mesh::new(&flat), Err(MeshError::NoVolume));
        assert!(Mesh::new(&block).unwrap().slice(0.05).is_empty());
        // A corner at the height of the slice counts as above.
        let area = signed_area(&Mesh::new(&block).unwrap().slice(0.02)[0]);
        assert!((area - 3.6e-3).abs() < 1e-12);
    }

    /// A block of sides from `low` to `high`, m.
    fn block(low: [f64; 3], high: [f64; 3]) -> Vec<[Point3<f64>; 3]> {
        let outline = [[low[0], low[1]], [high[0], low[1]], [high[0], high[1]], [low[0], high[1]]].map(Point2::from);
        prism(&outline, outline[0] + (outline[2] - outline[0]) / 2.0, [low[2], high[2]])
    }

    #[test]
    fn bodies_that_overlap_are_refused_however_they_lie() {
        let plate = block([0.0; 3], [0.09, 0.05, 0.01]);
        let with = |other: Vec<[Point3<f64>; 3]>| Mesh::new(&[plate.clone(), other].concat());
        let overlaps =
            |found: Result<Mesh, MeshError>| matches!(found, Err(MeshError::Overlap { .. } | MeshError::Inside { .. }));
        for (what, other) in [
            ("the same again", plate.clone()),
            ("moved along its length", block([0.04, 0.0, 0.0], [0.13, 0.05, 0.01])),
            ("moved by a hundredth of a millimetre", block([1e-5, 0.0, 0.0], [0.09001, 0.05, 0.01])),
            ("a boss sunk by 2 mm", block([0.02, 0.01, 0.008], [0.06, 0.03, 0.02])),
            ("within, the same way round", block([0.02, 0.01, 0.003], [0.06, 0.03, 0.006])),
            ("within, on its floor", block([0.02, 0.01, 0.0], [0.06, 0.03, 0.006])),
            ("around", block([-0.01; 3], [0.1, 0.1, 0.1])),
            ("a rod through it", block([0.02, 0.02, -0.03], [0.021, 0.021, 0.03])),
        ] {
            assert!(overlaps(with(other)), "{what}");
        }
        // Rods that cross between all their corners' heights.
        let rod = |lean: f64| -> Vec<_> {
            let upright = block([-0.002, -0.002, -0.05], [0.002, 0.002, 0.05]);
            upright.iter().map(|facet| facet.map(|p| Point3::new(p.x + lean * p.z, p.y, p.z))).collect()
        };
        assert!(overlaps(Mesh::new(&[rod(1.0), rod(-1.0)].concat())));
    }

    #[test]
    fn bodies_that_touch_lie_apart_or_are_cavities_are_taken() {
        let plate = block([0.0; 3], [0.09, 0.05, 0.01]);
        let volume = |other: Vec<[Point3<f64>; 3]>| Mesh::new(&[plate.clone(), other].concat()).unwrap().volume() * 1e6;
        for (what, other, cubic_cm) in [
            ("on it", block([0.02, 0.01, 0.01], [0.06, 0.03, 0.02]), 53.0),
            ("on it, at its edge", block([0.0, 0.0, 0.01], [0.06, 0.05, 0.02]), 75.0),
            ("the same on it", block([0.0, 0.0, 0.01], [0.09, 0.05, 0.02]), 90.0),
            ("beside it", block([0.09, 0.0, 0.0], [0.18, 0.05, 0.01]), 90.0),
            ("corner to corner", block([0.09, 0.05, 0.01], [0.1, 0.06, 0.02]), 46.0),
            ("away", block([0.2, 0.0, 0.0], [0.29, 0.05, 0.01]), 90.0),
        ] {
            assert!((volume(other) - cubic_cm).abs() < 1e-6, "{what}");
        }
        let mut cavity = block([0.02, 0.01, 0.003], [0.06, 0.03, 0.006]);
        cavity.iter_mut().for_each(|facet| facet.swap(1, 2));
        assert!((volume(cavity.clone()) - 42.6).abs() < 1e-6);
        // The same beside the plate encloses less than nothing.
        cavity.iter_mut().flatten().for_each(|p| p.x += 0.1);
        let found = Mesh::new(&[plate.clone(), cavity].concat());
        assert!(matches!(found, Err(MeshError::InsideOut { facet: 16..32 })), "{found:?}");
    }

    #[test]
    fn a_ball_rests_on_one_point() {
        // An octahedron on its tip.
        let tips =
            [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]].map(|p| Point3::from(p) * 0.02);
        let (top, bottom) = (Point3::new(0.0, 0.0, 0.02), Point3::new(0.0, 0.0, -0.02));
        let facets: Vec<_> =
            (0..4).flat_map(|i| [[tips[i], tips[(i + 1) % 4], top], [tips[(i + 1) % 4], tips[i], bottom]]).collect();
        let base = Mesh::new(&facets).unwrap().base();
        assert_eq!(base, [BasePatch { centroid: Point2::origin(), area: 0.0, spread: [0.0; 3] }]);
        let _ = SimplePolygon::new(Mesh::new(&facets).unwrap().slice(0.001).remove(0)).unwrap();
    }
}
