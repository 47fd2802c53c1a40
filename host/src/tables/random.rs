//! Random polygons for experiments, reproducible on every machine. Units: the caller's.

use std::f64::consts::TAU;

use nalgebra::Point2;
use palpate_shared::sim::Draw;

use crate::geometry::{SimplePolygon, convex_hull};

/// The convex hull of points drawn uniformly from a disk of this radius: at least a triangle, at most `points` vertices.
pub fn convex_polygon(draw: &mut Draw, points: usize, radius: f64) -> SimplePolygon {
    loop {
        let cloud: Vec<_> = (0..points).map(|_| in_disk(draw, radius)).collect();
        let corners: Vec<_> = convex_hull(&cloud).into_iter().map(|corner| cloud[corner]).collect();
        if let Ok(polygon) = SimplePolygon::new(corners) {
            return polygon;
        }
    }
}

/// A polygon that is star-shaped about its frame's origin, seldom convex: one vertex a sector, at distances uniform in
/// [`low`, `high`).
pub fn star_polygon(draw: &mut Draw, vertices: usize, low: f64, high: f64) -> SimplePolygon {
    loop {
        let sector = TAU / vertices as f64;
        let outline: Vec<_> = (0..vertices)
            .map(|index| {
                let angle = TAU * index as f64 / vertices as f64 + draw.uniform(0.1, 0.9) * sector;
                let distance = draw.uniform(low, high);
                Point2::new(distance * angle.cos(), distance * angle.sin())
            })
            .collect();
        if let Ok(polygon) = SimplePolygon::new(outline) {
            return polygon;
        }
    }
}

fn in_disk(draw: &mut Draw, radius: f64) -> Point2<f64> {
    let (distance, angle) = (radius * draw.unit().sqrt(), TAU * draw.unit());
    Point2::new(distance * angle.cos(), distance * angle.sin())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn drawn_polygons_are_as_asked() {
        for case in 0..100 {
            let mut draw = Draw::case(2, case);
            let hull = convex_polygon(&mut draw, 8, 0.05);
            assert!((3..=8).contains(&hull.vertices().len()));
            assert!(hull.first_reflex_vertex().is_none(), "case {case}");
            let star = star_polygon(&mut draw, 7, 0.02, 0.05);
            assert_eq!(star.vertices().len(), 7);
            assert!(star.vertices().iter().all(|point| (0.02..0.05).contains(&point.coords.norm())));
        }
    }
}
