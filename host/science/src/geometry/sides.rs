//! The straight sides of an outline: what it encloses, not how it was typed.
//!
//! A drawing may put a vertex anywhere along a straight side, or one point twice but for rounding. Such vertices are
//! no corners: nothing that touches the outline feels them. [`corners`] finds the vertices that are, whatever the
//! others: between two of them in turn the outline is straight, by [`FLAT_RELATIVE`] or by [`FLAT_ROUNDED_RELATIVE`] and
//! [`FLAT_TURN_RAD`], and none of them can be left out.
//!
//! Implements: Douglas and Peucker 1973, from two vertices that are corners for certain, then leaves out what lies
//! straight between the corners beside it: of equal distances their method may take a vertex that is flat.
//! Frames: the vertices' own. Units: m. Errors: none; an outline thinner than the tolerance keeps every vertex.

use nalgebra::Point2;

use super::polygon::{centroid_of, extent_of};
use super::segment::distance_to_segment;

/// A vertex nearer to the straight line between the corners beside it than this share of the extent is flat, whichever
/// way the outline turns there: computed points are rounded to 1e-16, and a corner may be there twice.
pub const FLAT_RELATIVE: f64 = 1e-7;

/// So is one nearer than this share if the outline hardly turns there, see [`FLAT_TURN_RAD`]: drawings are rounded to a
/// micrometre.
pub const FLAT_ROUNDED_RELATIVE: f64 = 2e-5;

/// An outline that turns off the straight line by no more than this hardly turns, rad: contact angles are known to half
/// a milliradian at best, and a vertex on a side of some millimetres that was rounded to a micrometre turns by less.
pub const FLAT_TURN_RAD: f64 = 5e-4;

/// The vertices of an outline that are corners, in order, by their indices.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::corners;
///
/// // Vertex 1 lies on the bottom side.
/// let block = [[0.0, 0.0], [0.021, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from);
/// assert_eq!(corners(&block), [0, 2, 3, 4]);
/// ```
///
/// # Panics
/// Without vertices.
#[must_use]
pub fn corners(vertices: &[Point2<f64>]) -> Vec<usize> {
    corners_within(vertices, FLAT_ROUNDED_RELATIVE)
}

/// The same where only rounding in the computer is forgiven, not that of drawings: by [`FLAT_RELATIVE`] alone.
pub(crate) fn corners_to_rounding(vertices: &[Point2<f64>]) -> Vec<usize> {
    corners_within(vertices, FLAT_RELATIVE)
}

/// The vertices that are enough to stay within a distance (m) of an outline, in order, by their indices, and how far the
/// others are from the straight pieces between these, m.
///
/// # Panics
/// Without vertices.
#[must_use]
pub fn simplified(vertices: &[Point2<f64>], within: f64) -> (Vec<usize>, f64) {
    let line = Outline { vertices, flat: within, flat_rounded: within };
    let kept = line.corners();
    let next = kept.iter().cycle().skip(1);
    let off = kept.iter().zip(next).filter_map(|(from, to)| line.farthest_off(*from, *to)).map(|(_, off)| off);
    let off = off.fold(0.0, f64::max);
    (kept, off)
}

fn corners_within(vertices: &[Point2<f64>], flat_rounded_relative: f64) -> Vec<usize> {
    let extent = extent_of(vertices);
    Outline { vertices, flat: FLAT_RELATIVE * extent, flat_rounded: flat_rounded_relative * extent }.corners()
}

/// The vertex farthest from a point.
fn farthest(vertices: &[Point2<f64>], from: Point2<f64>) -> usize {
    let distance = |i: &usize| (vertices[*i] - from).norm_squared();
    (0..vertices.len()).max_by(|i, j| distance(i).total_cmp(&distance(j))).unwrap_or(0)
}

struct Outline<'a> {
    vertices: &'a [Point2<f64>],
    /// So far off a straight line a vertex is flat, m.
    flat: f64,
    /// And so far where the outline hardly turns, m.
    flat_rounded: f64,
}

impl Outline<'_> {
    /// The vertices that are no flat ones, in order.
    fn corners(&self) -> Vec<usize> {
        let middle = centroid_of(self.vertices);
        // The vertex that is farthest from any point is a corner.
        let first = farthest(self.vertices, middle);
        let second = farthest(self.vertices, self.vertices[first]);
        let mut found = vec![first];
        self.split(first, second, &mut found);
        self.split(second, first, &mut found);
        self.leave_out_flat(&mut found);
        found.sort_unstable();
        if found.len() < 3 { (0..self.vertices.len()).collect() } else { found }
    }

    /// The vertices strictly between two, counter-clockwise.
    fn between(&self, from: usize, to: usize) -> impl Iterator<Item = usize> + use<> {
        let n = self.vertices.len();
        let count = (to + n - from - 1) % n;
        (1..=count).map(move |step| (from + step) % n)
    }

    /// How far a vertex is from the straight piece between two others, m.
    fn off(&self, vertex: usize, from: usize, to: usize) -> f64 {
        distance_to_segment(self.vertices[vertex], self.vertices[from], self.vertices[to])
    }

    /// The vertex between two others that is farthest off the straight piece between them, and how far, m.
    fn farthest_off(&self, from: usize, to: usize) -> Option<(usize, f64)> {
        let off = self.between(from, to).map(|i| (i, self.off(i, from, to)));
        off.max_by(|(_, a), (_, b)| a.total_cmp(b))
    }

    /// Whether the outline is straight from one vertex to another, from which it is `off` at most, m.
    fn is_straight(&self, from: usize, to: usize, off: f64) -> bool {
        off <= self.flat || off <= self.flat_rounded && self.hardly_turns(from, to)
    }

    /// Whether no piece from one vertex to another turns off the straight line by more than [`FLAT_TURN_RAD`], but for
    /// pieces that are there by rounding alone.
    fn hardly_turns(&self, from: usize, to: usize) -> bool {
        let along = (self.vertices[to] - self.vertices[from]).normalize();
        let ends = self.between(from, to).chain([to]);
        let starts = [from].into_iter().chain(self.between(from, to));
        starts.zip(ends).all(|(start, end)| {
            let piece = self.vertices[end] - self.vertices[start];
            let across = along.perp(&piece).abs();
            across <= self.flat || across <= FLAT_TURN_RAD * along.dot(&piece)
        })
    }

    /// Adds the corners from one vertex to another, in order, without the one it begins with; a corner that is there
    /// already is not added again.
    fn split(&self, from: usize, to: usize, found: &mut Vec<usize>) {
        // By hand, not by recursion: an outline of a million vertices may be split as often.
        let mut open = vec![(from, to)];
        while let Some((from, to)) = open.pop() {
            match self.farthest_off(from, to).filter(|(_, off)| !self.is_straight(from, to, *off)) {
                Some((corner, _)) => open.extend([(corner, to), (from, corner)]),
                None if to != found[0] => found.push(to),
                None => {}
            }
        }
    }

    /// Leaves out what lies straight between the corners beside it, with every vertex that was left out before.
    fn leave_out_flat(&self, corners: &mut Vec<usize>) {
        let mut at = 0;
        // So many before `at` stay, as their neighbours are.
        let mut kept = 0;
        while kept < corners.len() && corners.len() > 3 {
            let n = corners.len();
            let (before, after) = (corners[(at + n - 1) % n], corners[(at + 1) % n]);
            if self.farthest_off(before, after).is_none_or(|(_, off)| self.is_straight(before, after, off)) {
                corners.remove(at);
                // Those beside it have new neighbours.
                let left = n - 1;
                kept = kept.saturating_sub(1).min(left - 2);
                at = (at + left - 1) % left;
            } else {
                kept += 1;
                at = (at + 1) % n;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation2, Vector2};
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::math::random::Draw;

    /// Corners of drawn outlines are at least so far off the straight line between their neighbours, as a share of the
    /// extent: five times what may be flat.
    const CORNER_MIN_RELATIVE: f64 = 5.0 * FLAT_ROUNDED_RELATIVE;

    /// Whether every vertex of a drawn outline is a corner beyond doubt.
    fn is_cornered(outline: &SimplePolygon) -> bool {
        let vertices = outline.vertices();
        let n = vertices.len();
        (0..n).all(|i| {
            let [before, at, after] = [i + n - 1, i, i + 1].map(|i| vertices[i % n]);
            let off = (after - before).perp(&(at - before)).abs() / (after - before).norm();
            off > CORNER_MIN_RELATIVE * extent_of(vertices)
        })
    }

    /// A random outline, vertices put along its sides, rounded to `f64` by a turn and a shift, and which of them are
    /// corners.
    fn split(seed: u64, points: usize, splits: usize) -> (Vec<Point2<f64>>, Vec<usize>) {
        let mut draw = Draw::new(seed);
        let mut outlines = std::iter::repeat_with(|| {
            if draw.chance(0.5) {
                draw.convex_polygon(points, 0.05)
            } else {
                draw.star_polygon(points.max(4), 0.02, 0.05)
            }
        });
        let outline = outlines.find(is_cornered).unwrap();
        let mut pieces: Vec<Vec<Point2<f64>>> = outline.vertices().iter().map(|corner| vec![*corner]).collect();
        let n = pieces.len();
        for _ in 0..splits {
            let side = draw.index(n);
            let (from, to) = (pieces[side][0], outline.vertices()[(side + 1) % n]);
            // Now and then within rounding of a corner.
            let share = if draw.chance(0.2) { 1e-10 } else { draw.unit() };
            pieces[side].push(from + (to - from) * share);
        }
        for side in &mut pieces {
            let from = side[0];
            side.sort_by(|a, b| (a - from).norm().total_cmp(&(b - from).norm()));
        }
        let motion = |p: &Point2<f64>| Rotation2::new(1.0) * p + Vector2::new(0.3, -0.2);
        let corners = pieces.iter().scan(0, |at, side| Some(std::mem::replace(at, *at + side.len())));
        (pieces.iter().flatten().map(motion).collect(), corners.collect())
    }

    proptest! {
        #[test]
        fn vertices_along_the_sides_are_no_corners(seed: u64, points in 3..12_usize, splits in 0..8_usize) {
            let (vertices, wanted) = split(seed, points, splits);
            let found = corners(&vertices);
            // Of a corner and a point within rounding of it, either will do.
            prop_assert_eq!(found.len(), wanted.len());
            for (found, wanted) in found.iter().zip(&wanted) {
                prop_assert!((vertices[*found] - vertices[*wanted]).norm() < 1e-9);
            }
        }

        #[test]
        fn where_the_list_begins_does_not_matter(seed: u64, points in 3..12_usize, splits in 0..8_usize, by: usize) {
            let (mut vertices, _) = split(seed, points, splits);
            let same = |vertices: &[Point2<f64>]| {
                let mut places: Vec<_> = corners(vertices).iter().map(|i| vertices[*i]).collect();
                places.sort_by(|a, b| (a.x, a.y).partial_cmp(&(b.x, b.y)).unwrap());
                places
            };
            let before = same(&vertices);
            let n = vertices.len();
            vertices.rotate_left(by % n);
            prop_assert_eq!(before, same(&vertices));
        }
    }

    #[test]
    fn a_vertex_on_a_side_that_was_rounded_to_a_micrometre_is_flat() {
        // m: the lower side runs through (1.85, -15.65) mm, which is 0.45 µm off.
        let outline = [[-0.027, -0.022], [0.001_850, -0.015_650], [0.0307, -0.0093], [0.025, 0.030], [-0.020, 0.028]];
        assert_eq!(corners(&outline.map(Point2::from)), [0, 2, 3, 4]);
        // A bend of a milliradian is one.
        let bent = [[-0.03, 0.0], [0.0, -1.6e-5], [0.03, 0.0], [0.03, 0.04], [-0.03, 0.04]];
        assert_eq!(corners(&bent.map(Point2::from)).len(), 5);
    }

    #[test]
    fn a_fine_circle_keeps_what_makes_it_round() {
        let count = 20_000;
        let at = |i: u32| f64::from(i) / f64::from(count) * std::f64::consts::TAU;
        let circle: Vec<_> = (0..count).map(|i| Point2::new(at(i).cos(), at(i).sin())).collect();
        let kept: Vec<_> = corners(&circle).iter().map(|i| circle[*i]).collect();
        let area = SimplePolygon::new(kept).unwrap().area();
        assert!((area / std::f64::consts::PI - 1.0).abs() < 1e-6, "{area}");
    }

    #[test]
    fn a_fine_circle_is_simplified_to_within_what_is_allowed() {
        let at = |i: u32| f64::from(i) / 720.0 * std::f64::consts::TAU;
        let circle: Vec<_> = (0..720).map(|i| Point2::new(at(i).cos(), at(i).sin()) * 0.03).collect();
        let (kept, off) = simplified(&circle, 5e-5);
        assert!(off <= 5e-5 && off > 1e-6, "{off}");
        // Equal chords would be 55.
        assert!((55..130).contains(&kept.len()), "{}", kept.len());
        let kept: Vec<_> = kept.iter().map(|i| circle[*i]).collect();
        let n = kept.len();
        for point in &circle {
            let near = (0..n).map(|i| distance_to_segment(*point, kept[i], kept[(i + 1) % n])).fold(1.0, f64::min);
            assert!(near <= off + 1e-15, "{near} {off}");
        }
    }

    #[test]
    fn a_sliver_thinner_than_the_tolerance_is_left_as_it_is() {
        let sliver = [[0.0, 0.0], [1.0, 0.0], [0.5, 1e-9]].map(Point2::from);
        assert_eq!(corners(&sliver), [0, 1, 2]);
    }
}
