//! How far a valley of the cost reaches, where it bends.
//!
//! Where the contact slips little, its friction is hardly felt: places, angles and frictions that explain the force
//! nearly as well lie on a curve, and the ellipsoid that slopes give at its lowest point leaves the curve soon. So the
//! valley is walked: the unknown that the least certain direction of the end depends on most is moved step by step to
//! either side of its best value, all others are fitted again (the profile of the likelihood), until the cost has risen by
//! what the ends of a 95 % interval cost and more. Where it is straight as far as slopes say, nothing changes. Where not, half of
//! what takes the place of that direction in the covariance is the second moments of the places walked over, each as likely
//! as its cost says, and half what the ends of the interval say: so these are within what is stated.
//!
//! Units: SI. Errors: none; where nothing can be walked, the slopes' word stands.

use nalgebra::{DMatrix, Matrix2, SMatrix, SVector, Vector4};

use super::fit::{COLUMNS, PARAMETERS, Problem, Tried, moved, vector};
use super::path::Guess;
use crate::search::Halt;

/// By how much the cost rises to the ends of the 95 % interval of one unknown; a standard deviation costs 1.
const RISE_95: f64 = 3.841;

/// The same in standard deviations.
const SDS_95: f64 = 1.96;

/// What costs so much more is no longer walked over: it weighs a hundredth.
const RISE_LAST: f64 = 9.0;

/// A valley is straight where costs rise as slopes say within this, and ends are off by no more than this share.
const STRAIGHT: (f64, f64) = (0.6, 0.15);

/// A walk's first step, in the standard deviations that slopes say.
const STEP_FIRST: f64 = 0.5;

/// The longest, and the shortest before the walk is given up.
const STEPS_SDS: [f64; 2] = [1.0, 0.02];

/// A step that takes the contact angle further is too long, rad: forces of a part that turns do not follow.
const STEP_RAD: f64 = 0.12;

/// By which a step grows that went well, and shrinks that did not.
const GROWS: f64 = 1.6;
const SHRINKS: f64 = 0.4;

/// A step along which the cost rises by more has left the valley: the next is shorter.
const RISE_OF_STEP: f64 = 2.5;

/// Places walked over to each side at the most.
const PLACES_MAX: usize = 24;

/// Steps tried for them.
const TRIALS: usize = 60;

/// Steps of a refit: it begins near the floor of the valley.
const STEPS: usize = 4;

/// A place in a valley.
pub(super) struct Place {
    /// By how much parameters and the mass's logarithm differ from the lowest point's.
    pub(super) parameters: SVector<f64, COLUMNS>,
    pub(super) there: Tried,
    /// How likely, those of a valley and its lowest point being of one sum.
    pub(super) weight: f64,
}

/// A valley that bends.
pub(super) struct Valley {
    /// What slopes say of its direction: one standard deviation.
    pub(super) straight: SVector<f64, COLUMNS>,
    /// Places in it beside the lowest point.
    pub(super) places: Vec<Place>,
}

impl Valley {
    /// The valley through a minimum, given the covariance of its parameters and how the end follows them; none where it
    /// is straight.
    pub(super) fn through(
        problem: &Problem,
        at: &Tried,
        covariance: &DMatrix<f64>,
        state: &SMatrix<f64, 4, PARAMETERS>,
        halt: &Halt<'_>,
    ) -> Option<Self> {
        let held = held(problem, covariance, state)?;
        let straight: SVector<f64, COLUMNS> =
            SVector::from_fn(|i, _| covariance[(i, held)] / covariance[(held, held)].sqrt());
        let walk = Walk { problem, at, held, straight };
        if [1.0, -1.0].iter().all(|&side| walk.is_straight(side, state)) {
            return None;
        }
        let [up, down] = halt.every(vec![1.0, -1.0], |side| walk.to_side(side)).try_into().ok()?;
        let mut line: Vec<_> = down.into_iter().rev().map(|(along, there)| (-along, Some(there))).collect();
        line.push((0.0, None));
        line.extend(up.into_iter().map(|(along, there)| (along, Some(there))));
        if line.len() == 1 {
            return None;
        }
        Some(Self { straight, places: walk.weighed(line) })
    }

    /// A covariance whose share of this direction is what the places say: from the direction, of one standard deviation, and
    /// the change to each place.
    pub(super) fn covered<const N: usize>(
        &self,
        covariance: SMatrix<f64, N, N>,
        straight: SVector<f64, N>,
        change: impl Fn(&Place) -> Option<SVector<f64, N>>,
    ) -> SMatrix<f64, N, N> {
        let changes = self.places.iter().filter_map(|place| Some((place.weight, change(place)?)));
        let squares = changes.map(|(weight, change)| change * change.transpose() * weight);
        covariance - straight * straight.transpose() + squares.sum::<SMatrix<f64, N, N>>()
    }
}

/// The parameter that the least certain direction of the end depends on most.
fn held(problem: &Problem, covariance: &DMatrix<f64>, state: &SMatrix<f64, 4, PARAMETERS>) -> Option<usize> {
    // Angle and place at the end, the angle as a length.
    let arm = problem.course.part.inertia_per_mass().sqrt();
    let mut slopes = state.fixed_rows::<2>(0).into_owned();
    slopes.row_mut(0).scale_mut(arm);
    let parameters = covariance.fixed_view::<PARAMETERS, PARAMETERS>(0, 0);
    let end: Matrix2<f64> = slopes * parameters * slopes.transpose();
    let eigen = end.symmetric_eigen();
    let widest = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let shares = parameters * slopes.transpose() * widest;
    let correlation = |&i: &usize| shares[i].abs() / parameters[(i, i)].sqrt();
    (0..PARAMETERS).filter(|&i| parameters[(i, i)] > 0.0).max_by(|a, b| correlation(a).total_cmp(&correlation(b)))
}

/// A walk along a valley.
struct Walk<'a, 'p> {
    problem: &'a Problem<'a, 'p>,
    at: &'a Tried,
    held: usize,
    straight: SVector<f64, COLUMNS>,
}

impl Walk<'_, '_> {
    /// A guess so many standard deviations along a direction from another.
    fn beside(&self, from: &Tried, direction: &SVector<f64, COLUMNS>, sds: f64) -> Option<Tried> {
        let guess = (0..PARAMETERS).fold(from.guess, |guess, i| moved(&guess, i, direction[i] * sds));
        self.problem.try_guess(guess)
    }

    fn is_straight(&self, side: f64, state: &SMatrix<f64, 4, PARAMETERS>) -> bool {
        let Some(there) = self.beside(self.at, &self.straight, side * SDS_95) else { return false };
        let wanted = state * self.straight.fixed_rows::<PARAMETERS>(0) * (side * SDS_95);
        let off = vector(&there.path.end) - vector(&self.at.path.end) - wanted;
        let arm = self.problem.course.part.inertia_per_mass().sqrt();
        let length = |of: &Vector4<f64>| (of[0] * arm).hypot(of[1]);
        (there.cost - self.at.cost - RISE_95).abs() < STRAIGHT.0 && length(&off) < STRAIGHT.1 * length(&wanted)
    }

    /// Places to one side, each with how far the unknown that is held is there, in standard deviations.
    fn to_side(&self, side: f64) -> Vec<(f64, Tried)> {
        let mut places: Vec<(f64, Tried)> = Vec::new();
        let longest = STEPS_SDS[0].min(STEP_RAD / self.straight[0].abs().max(f64::MIN_POSITIVE));
        let (mut step, mut direction) = (STEP_FIRST.min(longest), self.straight);
        for _ in 0..TRIALS {
            let (at, from) = places.last().map_or((0.0, self.at), |(at, from)| (*at, from));
            let begun = self.beside(from, &direction, side * step);
            let there = begun.map(|begun| self.problem.fitted_beside(self.held, begun, STEPS));
            let rise = |tried: &Tried| (tried.cost - self.at.cost).max(0.0);
            let last = rise(from);
            match there.filter(|there| there.guess != from.guess && rise(there) < last + RISE_OF_STEP) {
                Some(there) => {
                    direction = change(from, &there) / (side * step);
                    let is_last = rise(&there) > RISE_LAST;
                    places.push((at + step, there));
                    // Along the line through the last two.
                    let longest = STEPS_SDS[0].min(STEP_RAD / direction[0].abs().max(f64::MIN_POSITIVE));
                    step = (GROWS * step).min(longest);
                    if is_last || places.len() == PLACES_MAX {
                        break;
                    }
                }
                None => step *= SHRINKS,
            }
            if step < STEPS_SDS[1] {
                break;
            }
        }
        places
    }

    /// Places in a row with their weights: each stands for half the way to its neighbours. Without the lowest point.
    fn weighed(&self, line: Vec<(f64, Option<Tried>)>) -> Vec<Place> {
        let along: Vec<_> = line.iter().map(|(along, _)| *along).collect();
        let last = along.len() - 1;
        let raw = |(index, (_, there)): (usize, &(f64, Option<Tried>))| {
            let rise = there.as_ref().map_or(0.0, |there| there.cost - self.at.cost);
            0.5 * (along[(index + 1).min(last)] - along[index.saturating_sub(1)]) * (-0.5 * rise).exp()
        };
        let weights: Vec<_> = line.iter().enumerate().map(raw).collect();
        let sum: f64 = weights.iter().sum();
        let ends = self.ends(&line);
        let places = line.into_iter().zip(weights).enumerate().filter_map(|(index, ((_, there), weight))| {
            let there = there?;
            let of_end = ends.iter().flatten().filter(|(end, _)| *end == index).map(|(_, sds)| 0.5 / (sds * sds));
            let weight = 0.5 * weight / sum + 0.5 * of_end.sum::<f64>();
            Some(Place { parameters: change(self.at, &there), there, weight })
        });
        places.collect()
    }

    /// The ends of the 95 % interval of places in a row, with how many standard deviations away they are.
    fn ends(&self, line: &[(f64, Option<Tried>)]) -> [Option<(usize, f64)>; 2] {
        let of = |index: usize| line[index].1.as_ref().map(|there| (index, (there.cost - self.at.cost).max(0.0)));
        let lowest = line.iter().position(|(_, there)| there.is_none()).unwrap_or_default();
        let off = |rise: f64| (rise - RISE_95).abs();
        let nearest = |places: std::ops::Range<usize>| {
            let (index, rise) = places.filter_map(of).min_by(|a, b| off(a.1).total_cmp(&off(b.1)))?;
            // A limit of the parameters ends the interval where it is.
            Some((index, rise.sqrt().max(SDS_95)))
        };
        [nearest(0..lowest), nearest(lowest + 1..line.len())]
    }
}

/// By how much parameters and the mass's logarithm of two guesses differ.
pub(super) fn change(from: &Tried, to: &Tried) -> SVector<f64, COLUMNS> {
    let [from, to] = [from, to].map(|tried| {
        let guess = tried.guess;
        let mu_c = if guess.mu_c.is_finite() { guess.mu_c } else { 0.0 };
        let Guess { u, s, mu_g_log, delay, omega, slide, .. } = guess;
        SVector::from([u, s, mu_c, mu_g_log, delay, omega, slide, tried.mass.ln()])
    });
    to - from
}
