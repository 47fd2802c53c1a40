//! How far a valley of the cost reaches, where it bends.
//!
//! Where the contact slips little, its friction is hardly felt: places, angles and frictions that explain the force
//! nearly as well lie on a curve, and the ellipsoid that slopes give at its lowest point leaves the curve soon. So the
//! valley is followed: the unknown that the least certain direction of the end depends on most is held to either side
//! of its best value, all others are fitted again (the profile of the likelihood), until the cost has risen by what the
//! ends of a 95 % interval cost. Where the two ends are what the slopes say, nothing changes. Where not, the ends found
//! take the place of that direction in the covariance.
//!
//! Units: SI. Errors: none; where an end is not found, the slopes' word stands.

use nalgebra::{DMatrix, Matrix2, SMatrix, SVector, Vector4};

use super::fit::{COLUMNS, PARAMETERS, Problem, Tried, moved, vector};
use super::path::Guess;

/// By how much the cost rises to the ends of the 95 % interval of one unknown; a standard deviation costs 1.
const RISE_95: f64 = 3.841;

/// The same in standard deviations.
const SDS_95: f64 = 1.96;

/// An end whose cost rose by so much more or less than meant is one, and is scaled by what remains: a tenth of an end's
/// distance.
const RISE_SLACK: f64 = 0.8;

/// A valley is straight where costs rise as slopes say within this, and ends are off by no more than this share.
const STRAIGHT: (f64, f64) = (0.6, 0.15);

/// Refits to find an end.
const TRIALS: usize = 4;

/// From one of them to the next the distance changes by no more than this factor.
const FACTOR: f64 = 2.5;

/// Steps of a refit: it begins near the floor of the valley.
const STEPS: usize = 2;

/// One standard deviation along a valley, to one side: of the parameters with the mass's logarithm, and of the end.
pub(super) struct Side {
    pub(super) parameters: SVector<f64, COLUMNS>,
    pub(super) end: Tried,
    /// How many standard deviations away the end is.
    pub(super) sds: f64,
}

/// A valley that bends.
pub(super) struct Valley {
    /// What slopes say of its direction: one standard deviation.
    pub(super) straight: SVector<f64, COLUMNS>,
    /// Its two ends, where they were found.
    pub(super) sides: [Option<Side>; 2],
}

impl Valley {
    /// The valley through a minimum, given the covariance of its parameters and how the end follows them; none where it
    /// is straight.
    pub(super) fn through(
        problem: &Problem,
        at: &Tried,
        covariance: &DMatrix<f64>,
        state: &SMatrix<f64, 4, PARAMETERS>,
    ) -> Option<Self> {
        let held = held(problem, covariance, state)?;
        let straight: SVector<f64, COLUMNS> =
            SVector::from_fn(|i, _| covariance[(i, held)] / covariance[(held, held)].sqrt());
        let walk = Walk { problem, at, held, straight };
        if [1.0, -1.0].iter().all(|&side| walk.is_straight(side, state)) {
            return None;
        }
        Some(Self { straight, sides: [1.0, -1.0].map(|side| walk.end(side)) })
    }

    /// A covariance whose share of this direction is what the ends say: from the direction and the change to either end,
    /// both of one standard deviation.
    pub(super) fn covered<const N: usize>(
        &self,
        covariance: SMatrix<f64, N, N>,
        straight: SVector<f64, N>,
        change: impl Fn(&Side) -> Option<SVector<f64, N>>,
    ) -> SMatrix<f64, N, N> {
        let sides = self.sides.iter().map(|side| side.as_ref().and_then(&change).unwrap_or(straight));
        let squares = sides.map(|side| side * side.transpose() * 0.5).sum::<SMatrix<f64, N, N>>();
        covariance - straight * straight.transpose() + squares
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

    /// The end of the 95 % interval to one side.
    fn end(&self, side: f64) -> Option<Side> {
        let (mut sds, mut from, mut direction, mut nearest) = (SDS_95, self.at.clone(), self.straight, None);
        let mut at = 0.0;
        for _ in 0..TRIALS {
            let Some(begun) = self.beside(&from, &direction, side * (sds - at)) else {
                // Nothing can be played there: half as far.
                sds = at + 0.5 * (sds - at);
                continue;
            };
            let there = self.problem.fitted_beside(self.held, begun, STEPS);
            let rise = (there.cost - self.at.cost).max(0.0);
            let off = (rise - RISE_95).abs();
            if nearest.as_ref().is_none_or(|(least, _, _)| off < *least) {
                nearest = Some((off, rise, there.clone()));
            }
            if off < RISE_SLACK || there.guess == from.guess {
                break;
            }
            // Along the line from the minimum through what was found.
            direction = self.change(&there) / (side * sds);
            let factor = (RISE_95 / rise.max(1e-6)).sqrt().clamp(1.0 / FACTOR, FACTOR);
            (from, at) = (there, sds);
            sds *= factor;
        }
        let (_, rise, end) = nearest?;
        // A limit of the parameters ends the interval where it is.
        let sds = if rise > RISE_95 { rise.sqrt() } else { SDS_95 };
        Some(Side { parameters: self.change(&end) / sds, end, sds })
    }

    fn change(&self, to: &Tried) -> SVector<f64, COLUMNS> {
        let [from, to] = [self.at, to].map(|tried| {
            let guess = tried.guess;
            let mu_c = if guess.mu_c.is_finite() { guess.mu_c } else { 0.0 };
            let Guess { u, s, mu_g_log, delay, omega, slide, .. } = guess;
            SVector::from([u, s, mu_c, mu_g_log, delay, omega, slide, tried.mass.ln()])
        });
        to - from
    }
}
