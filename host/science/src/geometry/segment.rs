//! How far a point is from a straight piece.
//!
//! Units: those of the coordinates. Errors: none; of a piece without length its one point counts.

use nalgebra::Point2;

/// From a point to the nearest point between two others.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::distance_to_segment;
///
/// let [start, end] = [Point2::new(0.0, 0.0), Point2::new(1.0, 0.0)];
/// assert_eq!(distance_to_segment(Point2::new(0.4, 0.5), start, end), 0.5);
/// assert_eq!(distance_to_segment(Point2::new(4.0, 4.0), start, end), 5.0); // its end is nearest
/// ```
#[must_use]
pub fn distance_to_segment(point: Point2<f64>, start: Point2<f64>, end: Point2<f64>) -> f64 {
    let (along, to_point) = (end - start, point - start);
    let length_squared = along.norm_squared();
    if length_squared == 0.0 {
        return to_point.norm();
    }
    let share = (to_point.dot(&along) / length_squared).clamp(0.0, 1.0);
    (to_point - along * share).norm()
}

/// Whether a ray from a point along x crosses an edge: so it does an odd number of times from inside a polygon. Points on
/// the outline fall on either side; [`crate::point_sampling::contains`] decides them.
pub(crate) fn is_crossed_by_ray(point: Point2<f64>, start: Point2<f64>, end: Point2<f64>) -> bool {
    (start.y > point.y) != (end.y > point.y)
        && point.x < start.x + (point.y - start.y) / (end.y - start.y) * (end.x - start.x)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn no_place_on_the_piece_is_nearer(p in [-1.0..1.0, -1.0..1.0], a in [-1.0..1.0, -1.0..1.0], b in [-1.0..1.0, -1.0..1.0]) {
            let [p, a, b] = [p, a, b].map(Point2::from);
            let found = distance_to_segment(p, a, b);
            let tried = (0..=1000).map(|k| (p - (a + (b - a) * (f64::from(k) / 1000.0))).norm()).fold(f64::INFINITY, f64::min);
            prop_assert!(found <= tried + 1e-12);
            // Places tried are half a thousandth of the length apart at most.
            prop_assert!(found >= tried - (b - a).norm() * 5e-4 - 1e-12);
        }
    }

    #[test]
    fn a_piece_without_length_is_its_point() {
        let at = Point2::new(3.0, 4.0);
        assert!((distance_to_segment(Point2::origin(), at, at) - 5.0).abs() < 1e-15);
    }
}
