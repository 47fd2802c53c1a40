//! Where to begin the search for modes, so that none is missed.
//!
//! For each turn the best place is a small linear problem, so the turn alone needs a search: at the turns where an edge
//! lies on a line, and between them in steps. Every local minimum along this profile is a start. With few lines the
//! profile has tight pairs of minima between two steps; there the exact poses of all triples of lines are starts as
//! well. The profile takes lines for what bearings are, and so smooths over shallow minima: where it is low every step
//! is a start, and so are some turns on both sides of each mode that is found.

use std::f64::consts::{PI, TAU};

use nalgebra::{Matrix2, Vector2};

use super::Settled;
use super::objective::{Objective, Placed};
use crate::inscription::exact::triple_poses;
use crate::inscription::readings::HalfPlane;
use crate::math::angle::wrap_angle;

/// Largest step of the turn, rad: the profile between two corner changes is a sum of a few squared sinusoids.
pub(super) const STEP_MAX: f64 = 0.035;

/// Rounds of reweighting by distance; the weights change by a few per cent in the second already.
const ROUNDS: usize = 3;

/// The profile at the step nearest to a mode may exceed the gate by this many times what the step changes every bearing
/// by, in σ²: a sensor half the part's size away from it sees the corners move twice as fast as they turn.
const PROFILE_ROOM: f64 = 4.0;

/// Up to so many times the gate, and this much more, the profile is low.
const LOW_GATES: f64 = 2.0;
const LOW_ROOM: f64 = 10.0;

/// Turns on either side of a mode from which others are sought, in its standard deviations.
const BESIDE_SD: [f64; 4] = [1.0, 2.0, 3.0, 4.5];

/// With more lines than this the triples are left out: redundant lines make the profile steep, with minima far apart.
const LINES_MAX_FOR_TRIPLES: usize = 6;

/// Places near every mode; none where it should halt.
pub(super) fn starts(objective: &Objective<'_>, lines: &[HalfPlane], gate: f64) -> Vec<Placed> {
    let Some(turns) = turns(objective, lines) else { return Vec::new() };
    let place = |&theta: &f64| objective.goes_on().map(|()| best_place(objective, lines, theta));
    // Of half a profile nobody knows the minima.
    let Some(profile) = turns.iter().map(place).collect::<Option<Vec<_>>>() else { return Vec::new() };
    let n = profile.len();
    let sigma = objective.readings.sigma;
    let worth_a_start = if objective.readings.fences.is_empty() {
        let readings = f64::from(u32::try_from(lines.len()).unwrap_or(u32::MAX));
        gate + PROFILE_ROOM * readings * (STEP_MAX / sigma).powi(2)
    } else {
        // Fences are so exact that any step off a mode is far from it.
        f64::MAX
    };
    let is_minimum = |k: &usize| {
        let (before, after) = (profile[(k + n - 1) % n].1, profile[(k + 1) % n].1);
        profile[*k].1 <= worth_a_start && profile[*k].1 <= before && profile[*k].1 <= after
    };
    let is_low = |k: &usize| profile[*k].1 <= LOW_GATES * gate + LOW_ROOM;
    let mut found: Vec<Placed> = (0..n).filter(|k| is_minimum(k) || is_low(k)).map(|k| profile[k].0).collect();
    if lines.len() <= LINES_MAX_FOR_TRIPLES {
        found.extend(triple_poses(objective.part, lines).iter().map(|pose| objective.placed(pose)));
    }
    found
}

/// Places on both sides of a mode, at its distance in standard deviations of the turn.
pub(super) fn beside(objective: &Objective<'_>, lines: &[HalfPlane], mode: &Settled) -> Vec<Placed> {
    let Some(covariance) = mode.information.try_inverse() else { return Vec::new() };
    let sd = covariance[(2, 2)].max(0.0).sqrt() / objective.part.size();
    let turns = BESIDE_SD.iter().flat_map(|steps| [steps * sd, -steps * sd]).filter(|turn| turn.abs() < PI);
    let turns = turns.take_while(|_| objective.goes_on().is_some());
    turns.map(|turn| best_place(objective, lines, wrap_angle(mode.placed.theta + turn)).0).collect()
}

/// Turns at which an edge lies on a line, and others between them; none where it should halt.
fn turns(objective: &Objective<'_>, lines: &[HalfPlane]) -> Option<Vec<f64>> {
    let (edges, mut looks) = (objective.part.angles(), objective.halt().now_and_then());
    let mut flush = Vec::with_capacity(lines.len() * edges.len());
    for (line, edge) in lines.iter().flat_map(|line| edges.iter().map(move |edge| (line, edge))) {
        looks.goes_on()?;
        flush.push(wrap_angle(line.angle - edge));
    }
    objective.halt().sort_by(&mut flush, f64::total_cmp)?;
    let mut turns = Vec::with_capacity(flush.len());
    for (k, &from) in flush.iter().enumerate() {
        looks.goes_on()?;
        let to = flush.get(k + 1).copied().unwrap_or(flush[0] + TAU);
        let steps = ((to - from) / STEP_MAX).ceil().clamp(1.0, TAU / STEP_MAX + 1.0);
        let places = std::iter::successors(Some(0.0), |step| Some(step + 1.0)).take_while(|step| *step < steps);
        turns.extend(
            places
                .map(|step| from + (to - from) * step / steps)
                .map(|theta| if theta > PI { theta - TAU } else { theta }),
        );
    }
    Some(turns)
}

/// The place that fits best with this turn, by linear least squares, and its misfit.
fn best_place(objective: &Objective<'_>, lines: &[HalfPlane], theta: f64) -> (Placed, f64) {
    let turned = Placed::new(Vector2::zeros(), theta);
    // At a fixed turn the touching corners are known, and each line gives one linear equation u·(x + arm) = c.
    let arms: Vec<_> = lines
        .iter()
        .map(|line| turned.turned(objective.part.corners()[objective.part.support(line.angle - theta)]))
        .collect();
    let mut placed = turned;
    let mut misfit = f64::INFINITY;
    // Weights depend on the distance, and so on the place: a few rounds.
    for round in 0..ROUNDS {
        let weights = weights(objective, &arms, &placed, round);
        let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
        for ((line, arm), weight) in lines.iter().zip(&arms).zip(&weights) {
            normal += line.normal * line.normal.transpose() * *weight;
            right += line.normal * (line.normal.dot(&(line.point - objective.origin - arm)) * *weight);
        }
        let Some(inverse) = normal.try_inverse() else { return (turned, f64::INFINITY) };
        // Normal equations of Σ w (u·(x + arm) − c)².
        placed.centre = inverse * right;
        let squared = |((line, arm), weight): ((&HalfPlane, &Vector2<f64>), &f64)| {
            line.normal.dot(&(placed.centre + arm - (line.point - objective.origin))).powi(2) * weight
        };
        misfit = lines.iter().zip(&arms).zip(&weights).map(squared).sum();
    }
    (placed, misfit)
}

/// One over the variance of each line's distance from its corner: that of a bearing grows with the distance from the
/// sensor.
fn weights(objective: &Objective<'_>, arms: &[Vector2<f64>], placed: &Placed, round: usize) -> Vec<f64> {
    let (readings, size) = (objective.readings, objective.part.size());
    let of_bearing = |(bearing, arm): (&super::Bearing, &Vector2<f64>)| {
        let away = placed.centre + arm - (bearing.apex - objective.origin);
        let distance = if round == 0 { size } else { away.norm().max(1e-3 * size) };
        (readings.sigma * distance).powi(-2)
    };
    let fence = (super::FENCE_SD_RELATIVE * size).powi(-2);
    readings.bearings.iter().zip(arms).map(of_bearing).chain(readings.fences.iter().map(|_| fence)).collect()
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use nalgebra::Point2;

    use super::*;
    use crate::geometry::{ConvexPolygon, SimplePolygon};
    use crate::inscription::{Cone, NoisyReadings};
    use crate::search::Halt;

    /// As many turns as there are lines times edges are made and sorted before the first of them is looked at.
    #[test]
    fn many_turns_take_many_looks_at_the_clock() {
        let corner = |k: u32| (TAU * f64::from(k) / 200.0).sin_cos();
        let round: Vec<_> = (0..200).map(corner).map(|(sin, cos)| Point2::new(0.03 * cos, 0.03 * sin)).collect();
        let round = ConvexPolygon::new(&SimplePolygon::new(round).unwrap()).unwrap();
        let cone = |k: u32| {
            let around = TAU * f64::from(k) / 100.0;
            let apex = Point2::new(0.2 * around.cos(), 0.2 * around.sin());
            Cone::new(apex, around + PI - 0.15, around + PI + 0.15).unwrap().bearings()
        };
        let readings = NoisyReadings { bearings: (0..100).flat_map(cone).collect(), fences: Vec::new(), sigma: 1e-3 };
        let (looks, lines) = (AtomicUsize::new(0), readings.lines());
        let count = |limit: usize| {
            looks.store(0, Relaxed);
            let stop = || looks.fetch_add(1, Relaxed) + 1 >= limit;
            turns(&Objective::new(&round, &readings, &Halt::new(&stop)), &lines).is_some()
        };
        assert!(count(usize::MAX));
        let all = looks.load(Relaxed);
        assert!(all > 200 * 200 / 1024 * 3, "{all} looks");
        for limit in [1, all / 3, all / 2, all] {
            assert!(!count(limit) && looks.load(Relaxed) == limit, "{} of {limit} looks", looks.load(Relaxed));
        }
    }
}
