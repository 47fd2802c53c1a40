//! How a rigid part presses on what it stands on, where statics alone do not say.
//!
//! Assumes: a bed that gives way in proportion to the pressure (Winkler 1867), the same everywhere, and a rigid part. The
//! pressure is then linear in x and y where it is not 0, and its resultant goes through the centre of mass.
//! Frames: the part's own. Units: m. Errors: none; a part that would tip over has no weights.

use nalgebra::{Matrix3, Point2, Vector3};

/// A resultant nearer to the centre of mass than this share of the size goes through it: rounding.
const THROUGH: f64 = 1e-6;

/// The share of the weight on each of several places with their areas (in any unit), under a centre of mass.
///
/// Places that would have to be pulled bear nothing. None where no shares carry the part.
#[must_use]
pub fn weights(places: &[(Point2<f64>, f64)], centre_of_mass: Point2<f64>) -> Option<Vec<f64>> {
    let reach = places.iter().map(|(at, _)| (at - centre_of_mass).norm()).fold(0.0, f64::max);
    let scale = if reach > 0.0 { reach } else { 1.0 };
    let arm = |at: &Point2<f64>| {
        let offset = (at - centre_of_mass) / scale;
        Vector3::new(1.0, offset.x, offset.y)
    };
    let mut bears = vec![true; places.len()];
    // Each time round one place at least bears no more.
    for _ in 0..=places.len() {
        let borne = || places.iter().zip(&bears).filter(|(_, bears)| **bears).map(|(place, _)| place);
        let total: f64 = borne().map(|(_, area)| area).sum();
        let stiffness: Matrix3<f64> = borne().map(|(at, area)| arm(at) * arm(at).transpose() * (area / total)).sum();
        let pressure = stiffness.svd(true, true).solve(&Vector3::x(), THROUGH * THROUGH).ok()?;
        let share = |(at, area): &(Point2<f64>, f64)| area / total * pressure.dot(&arm(at));
        let shares: Vec<f64> =
            places.iter().zip(&bears).map(|(place, bears)| if *bears { share(place) } else { 0.0 }).collect();
        if shares.iter().all(|share| *share >= 0.0) {
            let resultant: Vector3<f64> = places.iter().zip(&shares).map(|((at, _), share)| arm(at) * *share).sum();
            return ((resultant - Vector3::x()).norm() <= THROUGH).then_some(shares);
        }
        bears.iter_mut().zip(&shares).for_each(|(bears, share)| *bears &= *share >= 0.0);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(places: &[[f64; 3]], centre: [f64; 2]) -> Option<Vec<f64>> {
        let places: Vec<_> = places.iter().map(|[x, y, area]| (Point2::new(*x, *y), *area)).collect();
        weights(&places, Point2::from(centre))
    }

    fn are_near(found: Option<Vec<f64>>, wanted: &[f64]) -> bool {
        found.is_some_and(|found| found.iter().zip(wanted).all(|(a, b)| (a - b).abs() < 1e-9))
    }

    #[test]
    fn three_feet_bear_what_statics_say_whatever_their_areas() {
        let feet = [[0.0, 0.0, 1.0], [4.0, 0.0, 7.0], [0.0, 4.0, 2.0]];
        assert!(are_near(told(&feet, [1.0, 2.0]), &[0.25, 0.25, 0.5]));
    }

    #[test]
    fn four_equal_feet_share_evenly_and_a_far_one_lifts_off() {
        let feet = [[-1.0, -1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]];
        assert!(are_near(told(&feet, [0.0, 0.0]), &[0.25; 4]));
        let lifted = told(&feet, [0.6, 0.6]).unwrap();
        assert!(lifted[0] == 0.0 && lifted[2] > 0.5, "{lifted:?}");
        assert!(told(&feet, [1.2, 0.0]).is_none());
    }

    #[test]
    fn two_feet_carry_what_is_in_line_with_them() {
        let feet = [[0.0, 0.0, 1.0], [4.0, 0.0, 1.0]];
        assert!(are_near(told(&feet, [1.0, 0.0]), &[0.75, 0.25]));
        assert!(told(&feet, [1.0, 0.1]).is_none());
        assert!(are_near(told(&feet[..1], [0.0, 0.0]), &[1.0]));
        assert!(told(&[], [0.0, 0.0]).is_none());
    }
}
