//! How a finger gets from one approach to the next without meeting anything: round the rectangle that holds the part.
//!
//! Frames: world. Units: m. Errors: none.

use nalgebra::Point2;

/// The places to go to in turn, straight between, from one place on or beyond a rectangle's sides to another, the shorter
/// way round.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::inscription::way_round;
///
/// let area = [Point2::new(0.0, 0.0), Point2::new(2.0, 1.0)];
/// let way = way_round(area, Point2::new(0.0, 0.4), Point2::new(1.9, 0.0));
/// assert_eq!(way, [Point2::new(0.0, 0.4), Point2::new(0.0, 0.0), Point2::new(1.9, 0.0)]);
/// ```
#[must_use]
pub fn way_round(area: [Point2<f64>; 2], from: Point2<f64>, to: Point2<f64>) -> Vec<Point2<f64>> {
    let [low, high] = area;
    let corners = [low, Point2::new(high.x, low.y), high, Point2::new(low.x, high.y)];
    let [start, end] = [from, to].map(|place| along(&corners, place));
    let perimeter = 2.0 * (high - low).sum();
    let onwards = (end - start).rem_euclid(perimeter);
    let is_onwards = onwards <= 0.5 * perimeter;
    let mut passed: Vec<(f64, Point2<f64>)> = corners
        .iter()
        .filter_map(|corner| {
            let at = (along(&corners, *corner) - start).rem_euclid(perimeter);
            let after = if is_onwards { at } else { perimeter - at };
            let length = if is_onwards { onwards } else { perimeter - onwards };
            (0.0 < after && after < length).then_some((after, *corner))
        })
        .collect();
    passed.sort_by(|a, b| a.0.total_cmp(&b.0));
    let entered = nearest(&corners, from);
    let left = nearest(&corners, to);
    let mut way = vec![entered];
    way.extend(passed.into_iter().map(|(_, corner)| corner));
    way.extend([left, to]);
    way.dedup();
    way
}

/// The nearest point on the sides.
fn nearest(corners: &[Point2<f64>; 4], place: Point2<f64>) -> Point2<f64> {
    side(corners, place).1
}

/// How far along the sides, counter-clockwise from the first corner, the nearest point is.
fn along(corners: &[Point2<f64>; 4], place: Point2<f64>) -> f64 {
    let (k, at) = side(corners, place);
    let before: f64 = (0..k).map(|k| (corners[(k + 1) % 4] - corners[k]).norm()).sum();
    before + (at - corners[k]).norm()
}

/// The nearest side and the nearest point on it.
fn side(corners: &[Point2<f64>; 4], place: Point2<f64>) -> (usize, Point2<f64>) {
    let on = |k: usize| {
        let (start, end) = (corners[k], corners[(k + 1) % 4]);
        let way = end - start;
        start + way * ((place - start).dot(&way) / way.norm_squared()).clamp(0.0, 1.0)
    };
    let sides = (0..4).map(|k| (k, on(k)));
    sides.min_by(|a, b| (a.1 - place).norm().total_cmp(&(b.1 - place).norm())).unwrap_or((0, corners[0]))
}

#[cfg(test)]
mod tests {
    use nalgebra::center;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn no_way_leads_through_the_rectangle_and_none_is_longer_than_half_round(a in 0.0..6.0_f64, b in 0.0..6.0_f64) {
            let area = [Point2::new(0.0, 0.0), Point2::new(2.0, 1.0)];
            let at = |s: f64| match s {
                s if s < 2.0 => Point2::new(s, 0.0),
                s if s < 3.0 => Point2::new(2.0, s - 2.0),
                s if s < 5.0 => Point2::new(5.0 - s, 1.0),
                s => Point2::new(0.0, 6.0 - s),
            };
            let way = way_round(area, at(a), at(b));
            prop_assert_eq!(way.first(), Some(&at(a)));
            prop_assert_eq!(way.last(), Some(&at(b)));
            let mut length = 0.0;
            for pair in way.windows(2) {
                let middle = center(&pair[0], &pair[1]);
                let depth = middle.x.min(2.0 - middle.x).min(middle.y).min(1.0 - middle.y);
                prop_assert!(depth <= 1e-12, "{way:?}");
                length += (pair[1] - pair[0]).norm();
            }
            prop_assert!(length <= 3.0 + 1e-12, "{way:?}");
        }
    }
}
