//! Random polygons in a square, drawn as for the thesis's tables 3.1 and 3.2 (§3.6).
//!
//! A polygon is a cycle of a random walk on the arrangement of random lines: the first that has at least some small
//! random number of corners. It is then scaled to a perimeter, turned and put anywhere in a square where it fits.
//!
//! Lengths are shares of the side of the thesis's larger square.

use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

use nalgebra::{Point2, Rotation2, Vector2};

use crate::geometry::{SimplePolygon, bounding_box};
use crate::math::random::Draw;

/// Lines in an arrangement, as in the thesis.
const LINES: usize = 100;

/// A cycle must have this many corners or one to three more. Corners then number 5.5 with a standard deviation of about
/// 3 on average, as in the thesis, which does not say how it drew this.
const CORNERS_MIN: usize = 3;
const CORNERS_MIN_SPREAD: usize = 3;

/// Steps of a walk after which it begins anew.
const STEPS_MAX: usize = 100_000;

/// Orientations to try before a polygon counts as too large for the square.
const ORIENTATIONS_MAX: usize = 1000;

/// The scenes of one of the thesis's groups of tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SceneKind {
    /// Side of the square.
    pub side: f64,
    /// Least perimeter.
    pub perimeter_min: f64,
    /// Largest perimeter.
    pub perimeter_max: f64,
    /// Whether all are one polygon in different poses.
    pub one_polygon: bool,
}

impl SceneKind {
    /// Different polygons, sparse (table 3.1 a).
    pub const SPARSE_SHAPES: Self = Self { side: 1.0, perimeter_min: 0.25, perimeter_max: 0.75, one_polygon: false };
    /// Poses of one polygon, sparse (table 3.1 b).
    pub const SPARSE_POSES: Self = Self { side: 1.0, perimeter_min: 0.625, perimeter_max: 0.625, one_polygon: true };
    /// Different polygons, dense (table 3.2 a).
    pub const DENSE_SHAPES: Self = Self { side: 0.25, perimeter_min: 0.125, perimeter_max: 0.5, one_polygon: false };
    /// Poses of one polygon, dense (table 3.2 b).
    pub const DENSE_POSES: Self = Self { side: 0.25, perimeter_min: 0.625, perimeter_max: 0.625, one_polygon: true };

    /// A scene of this many polygons.
    #[must_use]
    pub fn draw(&self, draw: &mut Draw, count: usize) -> Vec<SimplePolygon> {
        let lines = Arrangement::draw(draw);
        let mut one = None;
        let mut scene = Vec::with_capacity(count);
        while scene.len() < count {
            let shape = one.take().unwrap_or_else(|| lines.polygon(draw));
            let scale = draw.uniform(self.perimeter_min, self.perimeter_max) / perimeter(&shape);
            let shape: Vec<_> = shape.iter().map(|p| p * scale).collect();
            let placed = self.place(draw, &shape);
            if self.one_polygon && (placed.is_some() || !scene.is_empty()) {
                one = Some(shape);
            }
            scene.extend(placed);
        }
        scene
    }

    /// Turns a polygon at random and puts it where it fits; none if it does not fit, or is too thin to be one.
    fn place(&self, draw: &mut Draw, shape: &[Point2<f64>]) -> Option<SimplePolygon> {
        for _ in 0..ORIENTATIONS_MAX {
            let rotation = Rotation2::new(draw.uniform(0.0, TAU));
            let turned: Vec<_> = shape.iter().map(|p| rotation * p).collect();
            let (low, high) = bounding_box(&turned);
            let room = Vector2::repeat(self.side) - (high - low);
            if room.min() < 0.0 {
                continue;
            }
            let shift = Vector2::new(draw.uniform(0.0, room.x), draw.uniform(0.0, room.y)) - low.coords;
            return SimplePolygon::new(turned.iter().map(|p| p + shift).collect::<Vec<_>>()).ok();
        }
        None
    }
}

fn perimeter(outline: &[Point2<f64>]) -> f64 {
    let next = outline.iter().cycle().skip(1);
    outline.iter().zip(next).map(|(a, b)| (b - a).norm()).sum()
}

/// Random lines and where they cross.
struct Arrangement {
    /// Of each line, the lines that cross it, in order along it.
    crossed_by: Vec<Vec<usize>>,
    /// Unit normal and offset of each line.
    lines: Vec<(Vector2<f64>, f64)>,
}

impl Arrangement {
    fn draw(draw: &mut Draw) -> Self {
        let line = |draw: &mut Draw| {
            let angle = draw.uniform(0.0, PI);
            (Vector2::new(angle.cos(), angle.sin()), draw.uniform(-1.0, 1.0))
        };
        let lines: Vec<_> = (0..LINES).map(|_| line(draw)).collect();
        let mut arrangement = Self { crossed_by: Vec::new(), lines };
        arrangement.crossed_by = (0..LINES).map(|line| arrangement.sorted_along(line)).collect();
        arrangement
    }

    fn sorted_along(&self, line: usize) -> Vec<usize> {
        let (normal, _) = self.lines[line];
        let along = Vector2::new(-normal.y, normal.x);
        let mut others: Vec<_> = (0..LINES).filter(|&other| other != line).collect();
        let place = |other: usize| self.crossing(line, other).coords.dot(&along);
        others.sort_by(|&a, &b| place(a).total_cmp(&place(b)));
        others
    }

    fn crossing(&self, a: usize, b: usize) -> Point2<f64> {
        let ((n, c), (m, d)) = (self.lines[a], self.lines[b]);
        Point2::new(c * m.y - d * n.y, d * n.x - c * m.x) / n.perp(&m)
    }

    /// The first cycle of a random walk that has corners enough, counter-clockwise.
    fn polygon(&self, draw: &mut Draw) -> Vec<Point2<f64>> {
        loop {
            let corners_min = CORNERS_MIN + draw.index(CORNERS_MIN_SPREAD + 1);
            if let Some(corners) = self.walk(draw, corners_min) {
                return corners;
            }
        }
    }

    fn walk(&self, draw: &mut Draw, corners_min: usize) -> Option<Vec<Point2<f64>>> {
        // A place is a crossing of the line walked on with another; the path holds both.
        let mut line = draw.index(LINES);
        let mut index = draw.index(LINES - 1);
        let mut path: Vec<[usize; 2]> = Vec::new();
        let mut at: HashMap<[usize; 2], usize> = HashMap::new();
        for _ in 0..STEPS_MAX {
            let other = self.crossed_by[line][index];
            let node = [line.min(other), line.max(other)];
            if let Some(&first) = at.get(&node) {
                let corners = self.corners(&path[first..]);
                if corners.len() >= corners_min {
                    return Some(corners);
                }
                path.drain(first..).for_each(|node| {
                    at.remove(&node);
                });
            }
            at.insert(node, path.len());
            path.push(node);
            if draw.chance(0.5) {
                index = self.crossed_by[other].iter().position(|&crossing| crossing == line)?;
                line = other;
            }
            index = if draw.chance(0.5) { index.checked_sub(1)? } else { index + 1 };
            if index + 1 >= LINES {
                return None;
            }
        }
        None
    }

    /// The places on a closed path where it changes its line, counter-clockwise.
    fn corners(&self, path: &[[usize; 2]]) -> Vec<Point2<f64>> {
        let n = path.len();
        let line_between = |a: [usize; 2], b: [usize; 2]| a.into_iter().find(|line| b.contains(line));
        let turns =
            |&i: &usize| line_between(path[(i + n - 1) % n], path[i]) != line_between(path[i], path[(i + 1) % n]);
        let mut corners: Vec<_> = (0..n).filter(turns).map(|i| self.crossing(path[i][0], path[i][1])).collect();
        let doubled: f64 =
            corners.iter().zip(corners.iter().cycle().skip(1)).map(|(a, b)| a.coords.perp(&b.coords)).sum();
        if doubled < 0.0 {
            corners.reverse();
        }
        corners
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_as_described() {
        for (case, kind) in
            [SceneKind::SPARSE_SHAPES, SceneKind::SPARSE_POSES, SceneKind::DENSE_SHAPES, SceneKind::DENSE_POSES]
                .into_iter()
                .enumerate()
        {
            let scene = kind.draw(&mut Draw::case(1, case), 20);
            assert_eq!(scene.len(), 20);
            for polygon in &scene {
                let (low, high) = bounding_box(polygon.vertices());
                assert!(low.x >= -1e-12 && high.x.max(high.y) <= kind.side + 1e-12 && low.y >= -1e-12, "{low} {high}");
                let around = perimeter(polygon.vertices());
                assert!(around >= kind.perimeter_min - 1e-9 && around <= kind.perimeter_max + 1e-9, "{around}");
            }
        }
    }

    #[test]
    fn corners_number_as_many_as_in_the_thesis() {
        let mut draw = Draw::case(3, 0);
        let lines = Arrangement::draw(&mut draw);
        let counts: Vec<_> =
            (0..1000).map(|_| f64::from(u32::try_from(lines.polygon(&mut draw).len()).unwrap())).collect();
        let mean = counts.iter().sum::<f64>() / 1000.0;
        let variance = counts.iter().map(|count| (count - mean).powi(2)).sum::<f64>() / 1000.0;
        // The thesis has 5.545 and 3.225; a standard error of 0.1 each, and a generator that it does not define.
        assert!((mean - 5.5).abs() < 1.0, "{mean}");
        assert!((variance.sqrt() - 3.2).abs() < 1.2, "{}", variance.sqrt());
    }
}
