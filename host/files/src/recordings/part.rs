//! The outline of the part that was pushed.
//!
//! File: the number of vertices, then that many lines `x y z` in mm, then (not needed) the height, as in the pushing
//! logs' `obj_geo_*.txt`. `#` starts a comment.
//!
//! Frames: vertices in the part's frame; `world` where a pose places it. Units: SI.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Rotation2, Vector2};
use palpate::geometry::distance_to_segment;

use super::mlab::BlockPose;
use super::{ReadError, RecordingProblem, number, shorten};

/// A simple polygon, counter-clockwise; edge `i` runs from vertex `i` to the next.
#[derive(Clone, Debug, PartialEq)]
pub struct RecordedPart {
    vertices: Vec<Vector2<f64>>,
}

/// The edge nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Number of the edge.
    pub edge: usize,
    /// Distance to it, m.
    pub distance: f64,
}

impl RecordedPart {
    /// A part with these vertices in m, in either order round.
    ///
    /// # Errors
    /// A message if there are fewer than three, two neighbours coincide, or the area is 0.
    pub fn new(mut vertices: Vec<Vector2<f64>>) -> Result<Self, String> {
        if vertices.len() < 3 {
            return Err(format!("{} vertices, where at least 3 are needed", vertices.len()));
        }
        if let Some(i) = (0..vertices.len()).find(|&i| vertices[i] == vertices[(i + 1) % vertices.len()]) {
            return Err(format!("vertex {i} and the next coincide"));
        }
        let area = doubled_area(&vertices);
        if area == 0.0 {
            return Err("the outline encloses no area".to_owned());
        }
        if area < 0.0 {
            vertices.reverse();
        }
        Ok(Self { vertices })
    }

    /// The vertices, part frame, m, counter-clockwise.
    #[must_use]
    pub fn vertices(&self) -> &[Vector2<f64>] {
        &self.vertices
    }

    /// Reads an outline.
    ///
    /// # Errors
    /// [`ReadError::Part`] with the place.
    pub fn parse(text: &str) -> Result<Self, ReadError> {
        let mut lines = text
            .lines()
            .enumerate()
            .map(|(i, line)| (i + 1, line.split('#').next().unwrap_or_default().trim()))
            .filter(|(_, line)| !line.is_empty());
        let (line, field) = lines.next().ok_or(ReadError::Empty)?;
        let problem = |line, message| ReadError::Part(RecordingProblem { line, column: None, message });
        let bad_count = || problem(line, format!("expected the number of vertices, found `{}`", shorten(field)));
        let count: usize = field.parse().map_err(|_| bad_count())?;
        let mut vertices = Vec::new();
        for _ in 0..count {
            let ended = || problem(line, format!("{count} vertices announced, {} found", vertices.len()));
            let (line, text) = lines.next().ok_or_else(ended)?;
            vertices.push(vertex(text).map_err(|message| problem(line, message))?);
        }
        Self::new(vertices).map_err(|message| problem(line, message))
    }

    /// Polar angle of the inward normal of an edge, rad, in the part's frame.
    #[must_use]
    pub fn inward_normal(&self, edge: usize) -> f64 {
        let (start, end) = self.edge(edge);
        let along = end - start;
        along.y.atan2(along.x) + FRAC_PI_2
    }

    /// Where on an edge a point in the part's frame is: its way along the edge from the edge's first vertex, m.
    #[must_use]
    pub fn along(&self, edge: usize, point_part: &Vector2<f64>) -> f64 {
        let (start, end) = self.edge(edge);
        (point_part - start).dot(&(end - start).normalize())
    }

    /// The edge nearest to a point in the part's frame.
    #[must_use]
    pub fn nearest(&self, point_part: &Vector2<f64>) -> Nearest {
        let edges = (0..self.vertices.len()).map(|edge| Nearest { edge, distance: self.distance(edge, point_part) });
        let far = Nearest { edge: 0, distance: f64::INFINITY };
        edges.fold(far, |best, next| if next.distance < best.distance { next } else { best })
    }

    fn edge(&self, edge: usize) -> (Vector2<f64>, Vector2<f64>) {
        (self.vertices[edge], self.vertices[(edge + 1) % self.vertices.len()])
    }

    fn distance(&self, edge: usize, point_part: &Vector2<f64>) -> f64 {
        let (start, end) = self.edge(edge);
        distance_to_segment((*point_part).into(), start.into(), end.into())
    }
}

fn vertex(text: &str) -> Result<Vector2<f64>, String> {
    let values = text.split_whitespace().map(number).collect::<Result<Vec<_>, _>>()?;
    match values[..] {
        [x, y] | [x, y, _] => Ok(Vector2::new(x, y) * 1e-3),
        _ => Err(format!("expected a vertex `x y z` in mm, found {} numbers", values.len())),
    }
}

fn doubled_area(vertices: &[Vector2<f64>]) -> f64 {
    (0..vertices.len()).map(|i| vertices[i].perp(&vertices[(i + 1) % vertices.len()])).sum()
}

impl BlockPose {
    /// A point of the world in this pose's frame.
    #[must_use]
    pub fn from_world(&self, point_world: &Vector2<f64>) -> Vector2<f64> {
        Rotation2::new(-self.yaw) * (point_world - self.position_world)
    }

    /// The pose a share of the way from here to `end`, along a straight line and the shorter turn.
    #[must_use]
    pub fn interpolate(&self, end: &Self, share: f64) -> Self {
        let turn = palpate::math::angle::wrap_angle(end.yaw - self.yaw);
        Self { position_world: self.position_world.lerp(&end.position_world, share), yaw: self.yaw + share * turn }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use palpate::math::angle::wrap_angle;

    use super::*;

    const TRIANGLE: &str = "3\n0 0 0 \n150 0 0\n0 150 0\n50\n";

    #[test]
    fn inward_normals_point_inward_whichever_way_round_the_file_goes() {
        let clockwise = "3\n0 150 0\n150 0 0\n0 0 0\n50\n";
        for text in [TRIANGLE, clockwise] {
            let part = RecordedPart::parse(text).unwrap();
            let below = part.nearest(&Vector2::new(0.05, -0.001));
            assert!((below.distance - 0.001).abs() < 1e-12);
            assert!((part.inward_normal(below.edge) - PI / 2.0).abs() < 1e-12);
            let slanted = part.nearest(&Vector2::new(0.08, 0.08));
            assert!(wrap_angle(part.inward_normal(slanted.edge) + 0.75 * PI).abs() < 1e-12);
        }
    }

    #[test]
    fn poses_interpolate_the_shorter_way_round() {
        let start = BlockPose { position_world: Vector2::new(0.0, 0.0), yaw: 3.0 };
        let end = BlockPose { position_world: Vector2::new(1.0, 2.0), yaw: -3.0 };
        let middle = start.interpolate(&end, 0.5);
        assert!(wrap_angle(middle.yaw - PI).abs() < 1e-12, "{middle:?}");
        assert!((middle.from_world(&middle.position_world)).norm() < 1e-12);
    }

    #[test]
    fn outlines_that_cannot_be_are_refused() {
        for text in [
            "",
            "x\n",
            "3\n0 0\n1 1\n",
            "3\n0 0 0\n1 1 0\n2 2 0\n",
            "2\n0 0\n1 1\n",
            "3\n0 0\n0 0\n1 1\n",
            "3\n0 0 0 0\n1 0\n0 1\n",
        ] {
            assert!(RecordedPart::parse(text).is_err(), "{text}");
        }
    }
}
