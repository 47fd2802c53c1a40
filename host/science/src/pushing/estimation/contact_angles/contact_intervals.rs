//! Where on a part's outline the finger's disk can be: stretches of edges that it reaches without overlapping the part.
//!
//! The disk touches an edge with its centre on a parallel at its radius. The other edges keep the centre out of
//! everything nearer than the radius to them; of the parallel that is one interval an edge.
//!
//! Frames: part. Units: SI. Errors: none; an edge in too narrow a notch has no interval.

use nalgebra::{Point2, Vector2};

use super::path::ContactInterval;
use crate::pushing::dynamics::{Edge, Part};
use crate::search::Halt;

/// Overlaps and stretches shorter than this are none, m: rounding of outlines printed to the nanometre.
const LENGTH_NONE_M: f64 = 1e-9;

/// A straight line: points `from + x along`.
struct Line {
    from: Point2<f64>,
    along: Vector2<f64>,
}

/// Every stretch of the outline that a disk of `radius` (m) can touch, edge by edge, as far as one got where one should
/// halt.
pub(super) fn contact_intervals(part: &Part, radius: f64, halt: &Halt<'_>) -> Vec<ContactInterval> {
    let sides = part.sides().enumerate().take_while(|_| !halt.is_wished());
    sides.flat_map(|(side, (index, edge))| contact_intervals_of_side(part, side, index, edge, radius)).collect()
}

/// Of the side that begins with the edge `index`.
fn contact_intervals_of_side(part: &Part, side: usize, index: usize, edge: Edge, radius: f64) -> Vec<ContactInterval> {
    let along = Vector2::new(-edge.normal.y, edge.normal.x);
    let centres = Line { from: part.centre_of_mass() + edge.normal * (edge.height + radius), along };
    let others = part.side_ends().enumerate().filter(|(other, _)| *other != side);
    let mut blocked: Vec<_> = others.filter_map(|(_, [a, b])| near_segment(&centres, a, b, radius)).collect();
    blocked.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let mut stretches = Vec::new();
    let mut low = edge.s_min;
    for [from, to] in blocked {
        stretches.push([low, from.min(edge.s_max)]);
        low = low.max(to);
    }
    stretches.push([low, edge.s_max]);
    let long = stretches.into_iter().filter(|[low, high]| high - low > LENGTH_NONE_M);
    long.map(|[low, high]| ContactInterval { index, edge, low, high }).collect()
}

/// The places on a line that are nearer than the radius to a segment: one interval, as both are convex.
fn near_segment(line: &Line, a: Point2<f64>, b: Point2<f64>, radius: f64) -> Option<[f64; 2]> {
    if radius <= LENGTH_NONE_M {
        return None; // A point is kept out by nothing but the part itself.
    }
    let pieces = [near_point(line, a, radius), near_point(line, b, radius), near_inside(line, a, b, radius)];
    let hull = |x: [f64; 2], y: [f64; 2]| [x[0].min(y[0]), x[1].max(y[1])];
    pieces.into_iter().flatten().reduce(hull).filter(|[low, high]| high - low > LENGTH_NONE_M)
}

/// Near a segment's end.
fn near_point(line: &Line, point: Point2<f64>, radius: f64) -> Option<[f64; 2]> {
    let to_point = point - line.from;
    let (foot, off) = (to_point.dot(&line.along), to_point.perp(&line.along).abs());
    let reach = radius - LENGTH_NONE_M;
    (off < reach).then(|| {
        let half = (reach * reach - off * off).sqrt();
        [foot - half, foot + half]
    })
}

/// Beside a segment: between its ends and within the radius of its line.
fn near_inside(line: &Line, a: Point2<f64>, b: Point2<f64>, radius: f64) -> Option<[f64; 2]> {
    let length = (b - a).norm();
    let direction = (b - a) / length;
    let normal = Vector2::new(-direction.y, direction.x);
    let from_a = line.from - a;
    let lengthwise = strip(from_a.dot(&direction), line.along.dot(&direction), [0.0, length])?;
    let reach = radius - LENGTH_NONE_M;
    let across = strip(from_a.dot(&normal), line.along.dot(&normal), [-reach, reach])?;
    let (low, high) = (lengthwise[0].max(across[0]), lengthwise[1].min(across[1]));
    (low < high).then_some([low, high])
}

/// Where `offset + slope x` lies within limits.
fn strip(offset: f64, slope: f64, [low, high]: [f64; 2]) -> Option<[f64; 2]> {
    if slope == 0.0 {
        return (low < offset && offset < high).then_some([f64::NEG_INFINITY, f64::INFINITY]);
    }
    let ends = [(low - offset) / slope, (high - offset) / slope];
    Some([ends[0].min(ends[1]), ends[0].max(ends[1])])
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::search::never;

    fn stretches(vertices: &[[f64; 2]], radius: f64) -> Vec<(usize, f64, f64)> {
        let part =
            Part::uniform(SimplePolygon::new(vertices.iter().copied().map(Point2::from).collect::<Vec<_>>()).unwrap());
        contact_intervals(&part, radius, &Halt::new(&never))
            .iter()
            .map(|interval| (interval.index, interval.high - interval.low, interval.low - interval.edge.s_min))
            .collect()
    }

    #[test]
    fn a_convex_part_is_reached_everywhere() {
        let block = [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]];
        for (edge, length, offset) in stretches(&block, 0.01) {
            let whole = if edge % 2 == 0 { 0.06 } else { 0.04 };
            assert!((length - whole).abs() < 1e-12 && offset.abs() < 1e-12, "edge {edge}: {length} m from {offset} m");
        }
    }

    #[test]
    fn a_disk_stays_its_radius_away_from_an_inner_corner() {
        let l = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0.0, 0.06]];
        let found = stretches(&l, 0.01);
        assert_eq!(found.len(), 6);
        for (edge, length, _) in found.iter().filter(|(edge, ..)| *edge == 2 || *edge == 3) {
            assert!((length - 0.03).abs() < 1e-8, "edge {edge}: {length} m");
        }
    }

    #[test]
    fn a_notch_too_narrow_has_no_place_at_its_bottom() {
        let notched = [
            [-0.03, -0.02],
            [-0.004, -0.02],
            [-0.004, 0.0],
            [0.004, 0.0],
            [0.004, -0.02],
            [0.03, -0.02],
            [0.03, 0.02],
            [-0.03, 0.02],
        ];
        assert!(stretches(&notched, 0.01).iter().all(|(edge, ..)| *edge != 2));
        assert!(stretches(&notched, 0.003).iter().any(|(edge, ..)| *edge == 2));
    }

    /// Each side is held against all others.
    #[test]
    fn the_clock_is_looked_at_before_every_side() {
        let corner = |k: u32| (std::f64::consts::TAU * f64::from(k) / 300.0).sin_cos();
        let round: Vec<_> = (0..300).map(corner).map(|(sin, cos)| Point2::new(0.03 * cos, 0.03 * sin)).collect();
        let part = Part::uniform(SimplePolygon::new(round).unwrap());
        let looks = AtomicUsize::new(0);
        let found = contact_intervals(&part, 0.01, &Halt::new(&|| looks.fetch_add(1, Relaxed) >= 100));
        assert_eq!((looks.load(Relaxed), found.len()), (101, 100));
    }
}
