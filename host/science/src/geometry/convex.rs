//! A convex polygon, prepared for questions about its support: which corner is the outermost in a direction.
//!
//! Made from an outline that has been checked ([`SimplePolygon`]), or as the hull of one. Flat vertices are no corners;
//! they support nothing that their neighbours do not.
//!
//! Frames: corners are given from the centroid, in the part's axes. Units: m, rad.
//! Errors: [`NotConvex`], where a vertex lies too deep inside the hull to be a rounding error.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point2, Vector2};

use super::polygon::{SimplePolygon, around, centroid_of, extent_of, sweep_order, turn};

/// How deep inside the hull a vertex may lie and still count as flat, as a share of the extent.
///
/// Coordinates rounded to doubles leave a flat vertex about 1e-16 of the extent off its line, on either side; what is
/// computed from a part changes by no more than this depth.
const FLAT_DEPTH_RELATIVE: f64 = 1e-12;

/// A convex polygon without flat vertices.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::{ConvexPolygon, SimplePolygon};
///
/// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
/// let block = ConvexPolygon::new(&block)?;
/// assert_eq!(block.vertex(block.support(0.5)), 2); // outermost at 0.5 rad from x: upper right
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ConvexPolygon {
    centre: Point2<f64>,
    size: f64,
    /// Largest distance of a corner from the centre.
    reach: f64,
    /// From the centre, counter-clockwise; corner 0 starts the edge whose normal has the least angle.
    corners: Vec<Vector2<f64>>,
    /// Outward unit normal of the edge from each corner to the next.
    normals: Vec<Vector2<f64>>,
    /// Polar angles of the normals, in [−π, π], ascending.
    angles: Vec<f64>,
    /// The vertex of the outline that each corner is.
    vertices: Vec<usize>,
}

/// An outline with a vertex inside its hull.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the outline is not convex: vertex {vertex} lies {depth:e} m inside its hull, the limit is {limit:e} m: take the hull, or leave \
     the vertex out"
)]
pub struct NotConvex {
    /// The first such vertex.
    pub vertex: usize,
    /// How deep it lies, m.
    pub depth: f64,
    /// The depth that counts as a rounding error, m.
    pub limit: f64,
}

impl ConvexPolygon {
    /// The polygon of a convex outline.
    ///
    /// # Errors
    /// [`NotConvex`] names the first vertex that is inside the hull.
    pub fn new(outline: &SimplePolygon) -> Result<Self, NotConvex> {
        if outline.first_reflex_vertex().is_none() {
            let vertices = outline.vertices();
            let is_corner = |i: &usize| {
                let [before, here, after] = around(vertices, *i);
                turn(before, here, after) > 0.0
            };
            return Ok(Self::of_corners(vertices, (0..vertices.len()).filter(is_corner).collect(), outline.centroid()));
        }
        let hull = Self::hull(outline);
        let limit = FLAT_DEPTH_RELATIVE * hull.size;
        let depth = |vertex: usize| hull.depth(outline.vertices()[vertex]);
        let inside = |vertex: &usize| !hull.vertices.contains(vertex) && depth(*vertex) > limit;
        match (0..outline.vertices().len()).find(inside) {
            None => Ok(hull),
            Some(vertex) => Err(NotConvex { vertex, depth: depth(vertex), limit }),
        }
    }

    /// The convex hull of an outline.
    #[must_use]
    pub fn hull(outline: &SimplePolygon) -> Self {
        Self::hull_of_points(outline.vertices()).unwrap_or_else(|| unreachable!("a simple polygon has an area"))
    }

    /// The convex hull of points; none if they all lie on one line.
    #[must_use]
    pub fn hull_of_points(points: &[Point2<f64>]) -> Option<Self> {
        let corners = convex_hull(points);
        if corners.len() < 3 {
            return None;
        }
        let outline: Vec<_> = corners.iter().map(|&corner| points[corner]).collect();
        let centre = centroid_of(&outline);
        Some(Self::of_corners(points, corners, centre))
    }

    /// Of vertices that are known to be the corners of a convex polygon, counter-clockwise.
    fn of_corners(points: &[Point2<f64>], mut vertices: Vec<usize>, centre: Point2<f64>) -> Self {
        let n = vertices.len();
        let normal = |corner: usize| {
            let along = points[vertices[(corner + 1) % n]] - points[vertices[corner]];
            Vector2::new(along.y, -along.x).normalize()
        };
        let mut normals: Vec<_> = (0..n).map(normal).collect();
        let mut angles: Vec<_> = normals.iter().map(|normal| normal.y.atan2(normal.x)).collect();
        let first = (0..n).min_by(|&a, &b| angles[a].total_cmp(&angles[b])).unwrap_or(0);
        vertices.rotate_left(first);
        normals.rotate_left(first);
        angles.rotate_left(first);
        // Edges that differ by a rounding error must not change places.
        (1..n).for_each(|edge| angles[edge] = angles[edge].max(angles[edge - 1]));
        let corners: Vec<_> = vertices.iter().map(|&vertex| points[vertex] - centre).collect();
        let reach = corners.iter().map(Vector2::norm_squared).fold(0.0, f64::max).sqrt();
        Self { centre, size: extent_of(points), reach, corners, normals, angles, vertices }
    }

    /// The area centroid, part frame, m.
    #[must_use]
    pub fn centre(&self) -> Point2<f64> {
        self.centre
    }

    /// The longer side of the bounding box, m.
    #[must_use]
    pub fn size(&self) -> f64 {
        self.size
    }

    /// The largest distance of a corner from the centre, m.
    #[must_use]
    pub fn reach(&self) -> f64 {
        self.reach
    }

    /// The corners from the centre, counter-clockwise, part axes, m.
    #[must_use]
    pub fn corners(&self) -> &[Vector2<f64>] {
        &self.corners
    }

    /// The outward unit normal of the edge from each corner to the next, part axes.
    #[must_use]
    pub fn normals(&self) -> &[Vector2<f64>] {
        &self.normals
    }

    /// The polar angles of [`ConvexPolygon::normals`], ascending from −π.
    #[must_use]
    pub fn angles(&self) -> &[f64] {
        &self.angles
    }

    /// The vertex of the outline that a corner is.
    #[must_use]
    pub fn vertex(&self, corner: usize) -> usize {
        self.vertices[corner]
    }

    /// The corner that is outermost in the direction with this polar angle (part axes, in [−3π, 3π]). O(log n).
    #[must_use]
    pub fn support(&self, angle: f64) -> usize {
        let angle = if angle < -PI {
            angle + TAU
        } else if angle > PI {
            angle - TAU
        } else {
            angle
        };
        let corner = self.angles.partition_point(|&edge| edge < angle);
        if corner == self.angles.len() { 0 } else { corner }
    }

    /// How deep a point of the part frame lies inside, m; negative outside.
    #[must_use]
    pub fn depth(&self, point: Point2<f64>) -> f64 {
        let from_centre = point - self.centre;
        let below = |(corner, normal): (&Vector2<f64>, &Vector2<f64>)| normal.dot(&(corner - from_centre));
        self.corners.iter().zip(&self.normals).map(below).fold(f64::INFINITY, f64::min)
    }
}

/// Which points are the corners of the convex hull: counter-clockwise from the leftmost (then lowest), none of them
/// flat.
///
/// Andrew's monotone chain (1979) with exact turns. Fewer than three where all points lie on one line.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::convex_hull;
///
/// let points = [[0.02, 0.01], [0.06, 0.0], [0.0, 0.0], [0.03, 0.0], [0.06, 0.04]].map(Point2::from); // m
/// assert_eq!(convex_hull(&points), [2, 1, 4]);
/// ```
#[must_use]
pub fn convex_hull(points: &[Point2<f64>]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..points.len()).collect();
    order.sort_unstable_by(|&a, &b| sweep_order(points[a], points[b]));
    order.dedup_by(|a, b| sweep_order(points[*a], points[*b]).is_eq());
    let mut hull = half_hull(points, order.iter().copied());
    hull.pop();
    let mut upper = half_hull(points, order.iter().rev().copied());
    upper.pop();
    hull.append(&mut upper);
    hull
}

fn half_hull(points: &[Point2<f64>], order: impl Iterator<Item = usize>) -> Vec<usize> {
    let mut chain: Vec<usize> = Vec::new();
    for next in order {
        while let [.., a, b] = chain[..] {
            if turn(points[a], points[b], points[next]) > 0.0 {
                break;
            }
            chain.pop();
        }
        chain.push(next);
    }
    chain
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn outline(points: &[[f64; 2]]) -> SimplePolygon {
        SimplePolygon::new(points.iter().map(|p| Point2::from(*p)).collect::<Vec<_>>()).unwrap()
    }

    #[test]
    fn a_notch_is_refused_and_a_flat_vertex_is_not() {
        let notched = outline(&[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.5, 0.2], [0.0, 1.0]]);
        let error = ConvexPolygon::new(&notched).unwrap_err();
        assert!(error.vertex == 3 && (error.depth - 0.5).abs() < 0.5, "{error}");
        assert_eq!(ConvexPolygon::hull(&notched).corners().len(), 4);
        let flat = outline(&[[0.0, 0.0], [0.5, 0.0], [1.0, 0.0], [1.0, 1.0]]);
        assert_eq!(ConvexPolygon::new(&flat).unwrap().corners().len(), 3);
        // A hair inside: a rounding error.
        let nearly = outline(&[[0.0, 0.0], [0.5, 1e-15], [1.0, 0.0], [1.0, 1.0]]);
        assert_eq!(ConvexPolygon::new(&nearly).unwrap().corners().len(), 3);
    }

    #[test]
    fn points_on_a_line_have_no_hull() {
        let points = [[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [1.0, 1.0]].map(Point2::from);
        assert_eq!(ConvexPolygon::hull_of_points(&points), None);
    }

    proptest! {
        #[test]
        fn the_support_is_the_outermost_of_all_points(
            points in proptest::collection::vec((-1.0..1.0, -1.0..1.0_f64), 3..40), angle in -9.0..9.0_f64,
        ) {
            let points: Vec<_> = points.into_iter().map(|(x, y)| Point2::new(x, y)).collect();
            let Some(hull) = ConvexPolygon::hull_of_points(&points) else { return Ok(()) };
            let direction = Vector2::new(angle.cos(), angle.sin());
            let outermost = points.iter().map(|p| p.coords.dot(&direction)).fold(f64::NEG_INFINITY, f64::max);
            let corner = hull.support(angle);
            prop_assert!((points[hull.vertex(corner)].coords.dot(&direction) - outermost).abs() < 1e-14);
            prop_assert!((hull.centre() + hull.corners()[corner] - points[hull.vertex(corner)]).norm() < 1e-14);
            prop_assert!(points.iter().all(|p| hull.depth(*p) > -1e-14) && hull.depth(hull.centre()) > 0.0);
        }
    }
}
