//! Turns that lay an outline nearly on itself, or on its mirror image: poses that touches confuse.
//!
//! Looked for by turning about the centroid in small steps; what is found is settled in angle and place until the outlines
//! are nowhere further apart than anywhere near. Distances are those of [`shapes_apart`], from corners of either outline.
//! Frames: the part's own. Units: m, rad. Errors: none.

use std::f64::consts::TAU;

use nalgebra::{Isometry2, Point2, Vector2};

use super::shapes_apart;
use crate::geometry::{Pose, SimplePolygon, bounding_box, simplified};

/// Steps of a whole turn.
const STEPS: u32 = 180;

/// Turns by no more than so many steps are the part itself, a little off.
const SAME_STEPS: u32 = 2;

/// Most corners that are compared: an outline with more is simplified.
const CORNERS_MAX: usize = 120;

/// Halvings of the steps in which a turn is settled.
const HALVINGS: u32 = 18;

/// One turn that lays the outline nearly on itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Likeness {
    /// The part's pose, as seen from its own frame, in which it looks nearly the same.
    pub pose: Pose,
    /// How far the outlines are apart there at most, m.
    pub apart: f64,
}

/// All of them.
#[derive(Clone, Debug, PartialEq)]
pub enum Likenesses {
    /// No turn changes the outline by more than was asked for.
    AnyTurn,
    /// The alikest first.
    Turns(Vec<Likeness>),
}

/// The turns after which an outline, or with `mirrored` the part lying on its other face, is nowhere further from itself
/// than `within` (m).
///
/// ```
/// use nalgebra::Point2;
/// use palpate::geometry::SimplePolygon;
/// use palpate::inscription::likeness::{Likenesses, likenesses};
///
/// let block = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from))?;
/// let Likenesses::Turns(turns) = likenesses(&block, false, 1e-3) else { unreachable!() };
/// assert_eq!(turns.len(), 1);
/// assert!((turns[0].pose.theta.abs() - std::f64::consts::PI).abs() < 1e-6 && turns[0].apart < 1e-6);
/// # Ok::<(), palpate::geometry::PolygonError>(())
/// ```
#[must_use]
pub fn likenesses(outline: &SimplePolygon, mirrored: bool, within: f64) -> Likenesses {
    let still = few_corners(outline);
    let moved = if mirrored { mirror(&still) } else { Some(still.clone()) };
    let Some(moved) = moved else { return Likenesses::Turns(Vec::new()) };
    let (from, to) = (moved.centroid(), still.centroid());
    let pose = |theta: f64, shift: Vector2<f64>| {
        let turned = Isometry2::rotation(theta) * from;
        let by = to - turned + shift;
        Pose { x: by.x, y: by.y, theta }
    };
    let origin = Pose { x: 0.0, y: 0.0, theta: 0.0 };
    let apart = |theta: f64, shift: Vector2<f64>| shapes_apart((&moved, &pose(theta, shift)), (&still, &origin));
    let step = TAU / f64::from(STEPS);
    let at: Vec<f64> = (0..STEPS).map(|k| apart(step * f64::from(k), Vector2::zeros())).collect();
    if at.iter().all(|apart| *apart <= within) {
        return Likenesses::AnyTurn;
    }
    let n = at.len();
    let is_least = |k: &usize| at[*k] <= at[(k + 1) % n] && at[*k] < at[(k + n - 1) % n];
    let (low, high) = bounding_box(still.vertices());
    let size = (high - low).norm();
    // Further off than a step can be from a turn that is alike.
    let worth = |k: &usize| at[*k] <= within + step * size;
    let settle = |k: usize| {
        let mut best = [step * f64::from(u32::try_from(k).unwrap_or(0)), 0.0, 0.0];
        let value = |[theta, x, y]: [f64; 3]| apart(theta, Vector2::new(x, y));
        let (mut least, mut reach) = (at[k], 1.0);
        for _ in 0..HALVINGS {
            loop {
                let spans = [step * reach, step * size * reach, step * size * reach];
                let tries = (0..3).flat_map(|axis| [1.0, -1.0].map(|sign| (axis, sign)));
                let tried = tries.map(|(axis, sign)| {
                    let mut place = best;
                    place[axis] += sign * spans[axis];
                    (place, value(place))
                });
                match tried.min_by(|a, b| a.1.total_cmp(&b.1)) {
                    Some((place, found)) if found < least * (1.0 - 1e-9) => (best, least) = (place, found),
                    _ => break,
                }
            }
            reach /= 2.0;
        }
        Likeness { pose: pose(crate::math::angle::wrap_angle(best[0]), Vector2::new(best[1], best[2])), apart: least }
    };
    let same = step * f64::from(SAME_STEPS);
    let mut turns: Vec<Likeness> = (0..n).filter(is_least).filter(worth).map(settle).collect();
    turns.retain(|turn| turn.apart <= within && (mirrored || turn.pose.theta.abs() > same));
    turns.sort_by(|a, b| a.apart.total_cmp(&b.apart));
    // Two steps may settle in one place.
    let mut kept: Vec<Likeness> = Vec::new();
    for turn in turns {
        let is_new = |other: &Likeness| crate::math::angle::wrap_angle(other.pose.theta - turn.pose.theta).abs() > same;
        if kept.iter().all(is_new) {
            kept.push(turn);
        }
    }
    Likenesses::Turns(kept)
}

/// The outline, simplified as little as leaves few enough corners.
fn few_corners(outline: &SimplePolygon) -> SimplePolygon {
    let (low, high) = bounding_box(outline.vertices());
    let mut within = 1e-5 * (high - low).amax();
    let mut found = outline.clone();
    while found.vertices().len() > CORNERS_MAX && within < 0.05 * (high - low).amax() {
        let (kept, _) = simplified(outline.vertices(), within);
        let vertices: Vec<Point2<f64>> = kept.iter().map(|index| outline.vertices()[*index]).collect();
        found = SimplePolygon::new(vertices).unwrap_or(found);
        within *= 1.5;
    }
    found
}

/// As seen from below.
fn mirror(outline: &SimplePolygon) -> Option<SimplePolygon> {
    let vertices: Vec<_> = outline.vertices().iter().rev().map(|p| Point2::new(-p.x, p.y)).collect();
    SimplePolygon::new(vertices).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn polygon(corners: &[[f64; 2]]) -> SimplePolygon {
        SimplePolygon::new(corners.iter().map(|corner| Point2::from(*corner) * 1e-3).collect::<Vec<_>>()).unwrap()
    }

    fn turns(outline: &SimplePolygon, mirrored: bool, within: f64) -> Vec<(f64, f64)> {
        let Likenesses::Turns(turns) = likenesses(outline, mirrored, within) else { panic!("any turn") };
        let mut turns: Vec<_> = turns.iter().map(|turn| (turn.pose.theta.to_degrees().abs(), turn.apart)).collect();
        turns.sort_by(|a, b| a.0.total_cmp(&b.0));
        turns
    }

    #[test]
    fn a_nearly_square_block_is_told_with_how_far_it_is_from_one() {
        let block = polygon(&[[0.0, 0.0], [60.0, 0.0], [60.0, 59.0], [0.0, 59.0]]);
        let found = turns(&block, false, 1e-3);
        assert_eq!(found.len(), 3, "{found:?}");
        // A quarter turn moves each side by half the millimetre; a slight turn more makes none better.
        for (turn, apart) in [found[0], found[1]] {
            assert!((turn - 90.0).abs() < 1.0 && (apart / 5e-4 - 1.0).abs() < 0.42, "{turn} {apart}");
        }
        assert!((found[2].0 - 180.0).abs() < 1e-3 && found[2].1 < 1e-6, "{found:?}");
        assert_eq!(turns(&block, false, 1e-4).len(), 1);
    }

    #[test]
    fn what_has_no_symmetry_has_no_likeness_and_a_mirror_only_where_there_is_one() {
        let odd = polygon(&[[0.0, 0.0], [60.0, 0.0], [60.0, 25.0], [35.0, 45.0], [0.0, 30.0]]);
        assert_eq!(turns(&odd, false, 1e-3), []);
        assert_eq!(turns(&odd, true, 1e-3), []);
        let arrow = polygon(&[[0.0, 0.0], [60.0, 20.0], [0.0, 40.0]]);
        assert_eq!(turns(&arrow, false, 1e-3), []);
        let mirrored = turns(&arrow, true, 1e-3);
        assert!(mirrored.len() == 1 && mirrored[0].1 < 1e-6, "{mirrored:?}");
    }

    #[test]
    fn a_disk_looks_the_same_after_any_turn() {
        let at = |i: u32| f64::from(i) / 60.0 * TAU;
        let disk: Vec<_> = (0..60).map(|i| [30.0 * at(i).cos(), 30.0 * at(i).sin()]).collect();
        assert_eq!(likenesses(&polygon(&disk), false, 1e-4), Likenesses::AnyTurn);
    }
}
