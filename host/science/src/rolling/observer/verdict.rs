//! What a set of minima means: one answer, several, or none.
//!
//! Listed are all physically possible minima whose cost is within [`LISTED`] of the best; `unique` is one of them
//! alone, found by a search that left out nothing. The certificate says whether one may rely on it: residuals as small as the noise, no rival, and a Cramér–Rao
//! bound small enough for the guarantee of [`GUARANTEED_RAD`].
//!
//! Units: costs are sums of squared residuals over their variances. Errors: none.

use nalgebra::{DMatrix, UnitQuaternion, Vector3};

use super::super::flow::STATE_COLUMNS;
use super::super::mechanics::{RollState, Spin};
use super::super::shape::Shape;
use super::super::symmetry::Symmetry;
use super::covariance;
use super::fit::{Ends, Residuals, RollFit, SPIN_COLUMN, Unknowns};
use super::search::{Coverage, SAME_DEVIATIONS};
use super::track::Noise;
use super::valley::{Valley, carried};
use crate::math::statistics::chi_square_quantile;

/// Cost above the best up to which a minimum is listed.
pub(super) const LISTED: f64 = 16.0;

/// Attitude error that a certified estimate stays below from the first reading to the last, rad.
pub(super) const GUARANTEED_RAD: f64 = 0.034_906_585;

/// Standard deviations of attitude for which [`GUARANTEED_RAD`] must leave room, at the end of the window where they
/// are larger and in the worst direction.
///
/// The largest error of 4500 rolls of a 2-3-4 ellipsoid was 3.56 of them; with 2.5 no certified one was off by 2° yet.
const GUARANTEED_SIGMAS: f64 = 3.5;

/// Share of right models whose cost stays below the limit.
const EXPLAINED: f64 = 0.999;

/// Standard deviations of the expected cost above which a wider search is worth its time.
const WIDER_SIGMAS: f64 = 1.3;

/// Half a pitch, with room for a fit that is not the best possible in this respect.
const HALF_PITCH: f64 = 0.505;

/// Residual, in pitches, up to which a certified answer explains rounded readings: half a pitch for the truth, more because
/// the bounds are met in the mean of eighth powers only.
const ROUNDED_MAX: f64 = 0.75;

/// Residual of exact readings that whoever computed them may have left, m: errors of a nanometre grow with the motion.
const EXACT_RESIDUAL_MAX: f64 = 1e-8;

/// Standard deviation of attitude, rad, above which a minimum may have neighbours that a narrow search misses.
const WEAK_RAD: f64 = 0.02;

/// Minima nearer than this are one: rad; or nearer than [`SAME_DEVIATIONS`].
const SAME_RAD: f64 = 0.01;

/// Continua whose contacts' normals are nearer than this are one, rad.
const SAME_NORMAL_RAD: f64 = 0.1;

/// How much more angular velocities of one minimum may differ, 1/s over rad.
const SAME_TURNING: f64 = 3.0;

/// Standard deviation of attitude, rad, beyond which a continuum of attitudes fits.
const UNSEEN_RAD: f64 = 1.0;

/// Whether an attitude of this standard deviation, rad, stays below [`GUARANTEED_RAD`].
fn is_guaranteed(sigma: f64) -> bool {
    sigma * GUARANTEED_SIGMAS <= GUARANTEED_RAD
}

/// A minimum with all that follows from it.
#[derive(Clone, Debug)]
pub(super) struct Solution {
    pub(super) body: usize,
    pub(super) unknowns: Unknowns,
    pub(super) fit: RollFit,
    pub(super) ends: Ends,
    /// What its bend adds to the covariances, where it has one.
    pub(super) valley: Option<Valley>,
    /// Residuals after the last fit.
    pub(super) residuals: Residuals,
    /// Of a coordinate after the last fit, m.
    pub(super) residual_max: f64,
}

/// What the readings say.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RollVerdict {
    /// One hypothesis explains them.
    Unique,
    /// Several hypotheses explain them; or one does, and the search left out what may explain them as well.
    Ambiguous,
    /// No hypothesis explains them.
    Unexplained,
}

/// Everything that explains the readings.
#[derive(Clone, Debug)]
pub struct RollEstimate {
    /// Whether one hypothesis explains the readings, several or none.
    pub verdict: RollVerdict,
    /// Best first. Empty where none explains the readings.
    pub hypotheses: Vec<RollHypothesis>,
    /// Cost of the best minimum, listed or not; infinite where the search found none.
    pub cost: f64,
    /// Numbers read less numbers fitted.
    pub degrees_of_freedom: usize,
    /// Cost up to which the readings count as explained.
    pub cost_max: f64,
    /// Whether the answer may be relied on to 2°.
    pub certified: bool,
    /// Whether the search knows that it left out nothing.
    pub complete: bool,
    /// Where it looked.
    pub coverage: Coverage,
}

/// A motion that explains the readings.
#[derive(Clone, Debug)]
pub struct RollHypothesis {
    /// Which of the bodies asked about.
    pub body: usize,
    /// Turns that leave the body as it is: so many states stand for one.
    pub symmetry: Symmetry,
    /// What the contact transmits.
    pub spin: Spin,
    /// Of the ellipsoid, m, in the order of the body axes that the attitudes refer to; where they were unknown.
    pub semi_axes: Option<[f64; 3]>,
    /// Constant acceleration of the palm, m/s², where it was unknown.
    pub palm_acceleration: Option<Vector3<f64>>,
    /// At the first reading.
    pub start: RollState,
    /// At the last reading.
    pub end: RollState,
    /// Sum of squared residuals over their variances.
    pub cost: f64,
    /// Of attitude (turn about body axes, rad) and angular velocity (body axes, rad/s) at the end, then of the
    /// semi-axes (m) and the palm's acceleration (m/s²). None where a continuum fits.
    pub covariance: Option<DMatrix<f64>>,
    /// Whether a continuum of states explains the readings as well, beside what the symmetry hides.
    pub unobservable: bool,
}

/// How good the best minimum of a search is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Quality {
    /// As good as the truth would be.
    Good,
    /// So too, but so flat that others may fit as well.
    Weak,
    /// The truth would be better.
    Poor,
}

/// The limits a cost is judged by.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gate {
    pub(super) readings: usize,
    pub(super) noise: Noise,
}

impl Gate {
    fn degrees_of_freedom(self, unknowns: usize) -> usize {
        (2 * self.readings).saturating_sub(unknowns).max(1)
    }

    fn cost_max(degrees: usize) -> f64 {
        chi_square_quantile(EXPLAINED, degrees)
    }

    fn explains(self, solution: &Solution) -> bool {
        let degrees = self.degrees_of_freedom(solution.unknowns.count());
        solution.fit.cost <= Self::cost_max(degrees) || self.rounds(solution)
    }

    /// Whether rounding alone explains what is left over. Rounding errors of a slow contact are not independent, so
    /// that chi-square says little, but they never exceed half the pitch.
    fn rounds(self, solution: &Solution) -> bool {
        match self.noise {
            Noise::Grid(pitch) => solution.residual_max <= HALF_PITCH * pitch,
            Noise::Exact => solution.residual_max <= EXACT_RESIDUAL_MAX,
            Noise::Gauss(_) => false,
        }
    }

    /// Whether no reading is off by more than it can be: rounding never errs by more than half the pitch, though least
    /// squares may cost little where it would have to.
    fn may_be(self, solution: &Solution) -> bool {
        match self.noise {
            Noise::Grid(pitch) => solution.residual_max <= ROUNDED_MAX * pitch,
            Noise::Gauss(_) | Noise::Exact => true,
        }
    }

    /// Whether a wider search is worth its time.
    pub(super) fn quality(self, solutions: &[Solution]) -> Quality {
        let Some(best) = solutions.first() else { return Quality::Poor };
        let degrees = self.degrees_of_freedom(best.unknowns.count()) as f64;
        if best.fit.cost > degrees + WIDER_SIGMAS * (2.0 * degrees).sqrt() && !self.rounds(best) {
            return Quality::Poor;
        }
        let weak = best.attitude_sigma().is_some_and(|sigma| sigma > WEAK_RAD);
        if weak { Quality::Weak } else { Quality::Good }
    }

    pub(super) fn judge(self, solutions: Vec<Solution>, coverage: Coverage) -> RollEstimate {
        let cost = solutions.first().map_or(f64::INFINITY, |solution| solution.fit.cost);
        let degrees = solutions.first().map_or(1, |solution| self.degrees_of_freedom(solution.unknowns.count()));
        let explained = solutions.first().is_some_and(|best| self.explains(best));
        // Solutions come best first: of those that are the same the best is listed.
        let mut listed: Vec<Solution> = Vec::new();
        for solution in solutions {
            let near = solution.fit.cost <= cost + LISTED && explained;
            if near && !listed.iter().any(|other| other.is_same(&solution)) {
                listed.push(solution);
            }
        }
        let followed_all = coverage.left_out == 0;
        // Of unknown shapes there is always more than can be followed: `coverage` says how much, and none is certified.
        let is_complete = followed_all || listed.first().is_some_and(|best| best.unknowns.columns.semi_axes);
        let verdict = match listed.len() {
            0 => RollVerdict::Unexplained,
            // What was left out may explain the readings too.
            1 if is_complete => RollVerdict::Unique,
            _ => RollVerdict::Ambiguous,
        };
        // Unique is not yet sure: its attitude must be known better than what is guaranteed, at both ends.
        let sure = |solution: &Solution| match solution.attitude_sigma_at_ends() {
            Some(sigma) => is_guaranteed(sigma * solution.residuals.dilution()),
            None => false,
        };
        let certified =
            followed_all && verdict == RollVerdict::Unique && listed.iter().all(|one| sure(one) && self.may_be(one));
        let hypotheses = listed.iter().map(Solution::hypothesis).collect();
        RollEstimate {
            verdict,
            hypotheses,
            cost,
            degrees_of_freedom: degrees,
            cost_max: Self::cost_max(degrees),
            certified,
            complete: is_complete,
            coverage,
        }
    }
}

impl Residuals {
    /// By what neighbours that err alike widen the bound: readings of a slow contact repeat each other's rounding
    /// error.
    fn dilution(self) -> f64 {
        let correlation = self.correlation.clamp(0.0, 0.99);
        ((1.0 + correlation) / (1.0 - correlation)).sqrt()
    }
}

impl Solution {
    fn symmetry(&self) -> Symmetry {
        self.fit.point.body.symmetry()
    }

    /// Covariance of what is fitted, with zeros for what is fixed; in the middle of the window.
    fn middle_covariance(&self) -> Option<DMatrix<f64>> {
        let straight = covariance_of(&self.unknowns, &self.fit)?;
        Some(self.valley.iter().fold(straight, |covariance, valley| covariance + &valley.middle))
    }

    /// Covariance of attitude and angular velocity at an end, and of the further unknowns.
    fn covariance_at(&self, end: usize) -> Option<DMatrix<f64>> {
        let carried = carried(&self.ends.columns[end]);
        let straight = &carried * covariance_of(&self.unknowns, &self.fit)? * carried.transpose();
        let covariance = self.valley.iter().fold(straight, |covariance, valley| covariance + &valley.ends[end]);
        Some((&covariance + covariance.transpose()) * 0.5)
    }

    /// The largest standard deviation of the attitude in the middle, rad: the Cramér–Rao bound; `None` if symmetry
    /// leaves a continuum or the readings do.
    fn attitude_sigma(&self) -> Option<f64> {
        self.symmetry().order()?;
        let covariance = self.middle_covariance()?;
        let attitude = covariance.fixed_view::<3, 3>(0, 0).into_owned();
        let largest = attitude.symmetric_eigenvalues().max();
        (largest.is_finite() && largest >= 0.0).then(|| largest.sqrt())
    }

    /// The same at the first and the last reading, whichever is larger: errors of the middle have grown there.
    fn attitude_sigma_at_ends(&self) -> Option<f64> {
        self.symmetry().order()?;
        let largest = |end: usize| Some(self.covariance_at(end)?.view((0, 0), (3, 3)).symmetric_eigenvalues().max());
        let worst = largest(0)?.max(largest(1)?);
        worst.is_finite().then(|| worst.max(0.0).sqrt())
    }

    fn unobservable(&self) -> bool {
        self.symmetry().order().is_some() && self.attitude_sigma().is_none_or(|sigma| sigma > UNSEEN_RAD)
    }

    /// Whether two minima are one.
    fn is_same(&self, other: &Self) -> bool {
        let same_model = self.body == other.body && self.unknowns.spin == other.unknowns.spin;
        if !same_model {
            return false;
        }
        if self.unobservable() && other.unobservable() {
            return self.normal_angle(other) < SAME_NORMAL_RAD;
        }
        let sigma = self.attitude_sigma().unwrap_or(0.0);
        let [a, b] = [self, other].map(|solution| solution.fit.point.state.attitude());
        if self.unknowns.columns.semi_axes {
            return self.relabelled_angle(other) < SAME_RAD.max(sigma);
        }
        if self.squared_deviations(other) < SAME_DEVIATIONS * SAME_DEVIATIONS {
            return true;
        }
        let near = self.symmetry().angle(&a, &b) < SAME_RAD;
        let [v, w] = [self, other].map(|solution| solution.fit.point.state.attitude() * solution.fit.point.state.omega);
        // A sphere's spin cannot be seen.
        let seen = if self.symmetry() == Symmetry::Sphere { Vector3::new(1.0, 1.0, 0.0) } else { Vector3::repeat(1.0) };
        near && (v - w).component_mul(&seen).norm() < SAME_RAD * SAME_TURNING * (1.0 + v.norm())
    }

    /// Squared distance of another minimum from this one, in standard deviations of this one.
    fn squared_deviations(&self, other: &Self) -> f64 {
        let straight = || self.fit.squared_deviations(&other.fit.point);
        let Some(valley) = &self.valley else { return straight() };
        let Some(covariance) = covariance_of(&self.unknowns, &self.fit) else { return straight() };
        let fitted = fitted(&self.unknowns, covariance.nrows());
        let wide = (covariance + &valley.middle).select_rows(&fitted).select_columns(&fitted);
        let step = self.fit.step_to(&other.fit.point).select_rows(&fitted);
        wide.cholesky().map_or_else(straight, |wide| step.dot(&wide.solve(&step)))
    }

    /// The angle between the contacts' normals, modulo symmetry: what a continuum of headings and spins has in common.
    fn normal_angle(&self, other: &Self) -> f64 {
        let [a, b] = [self, other].map(|solution| solution.fit.point.state.normal());
        let apart = |turn: UnitQuaternion<f64>| a.angle(&(turn * b));
        self.symmetry().turns().into_iter().map(apart).fold(f64::INFINITY, f64::min)
    }

    /// The angle between attitudes of unknown ellipsoids, whose axes may be named in another order.
    fn relabelled_angle(&self, other: &Self) -> f64 {
        let names = Symmetry::O.turns();
        let [a, b] = [self, other].map(|solution| solution.fit.point.state.attitude());
        let apart = |turn: &UnitQuaternion<f64>| {
            let angle = a.angle_to(&(b * turn));
            let axes = |solution: &Self| {
                if let Shape::Ellipsoid(shape) = solution.fit.point.body.shape() {
                    Vector3::from(shape.semi_axes)
                } else {
                    Vector3::zeros()
                }
            };
            let renamed = (turn.inverse() * axes(other)).abs();
            angle + (axes(self) - renamed).norm() / axes(self).norm()
        };
        names.iter().map(apart).fold(f64::INFINITY, f64::min)
    }

    fn hypothesis(&self) -> RollHypothesis {
        let point = &self.fit.point;
        let semi_axes = match (self.unknowns.columns.semi_axes, point.body.shape()) {
            (true, Shape::Ellipsoid(ellipsoid)) => Some(ellipsoid.semi_axes),
            _ => None,
        };
        let unobservable = self.unobservable();
        let hidden = unobservable || self.symmetry().order().is_none();
        RollHypothesis {
            body: self.body,
            symmetry: self.symmetry(),
            spin: self.unknowns.spin,
            semi_axes,
            palm_acceleration: self.unknowns.columns.palm.then_some(point.palm),
            start: self.ends.start,
            end: self.ends.end,
            cost: self.fit.cost,
            covariance: if hidden { None } else { self.end_covariance(semi_axes) },
            unobservable,
        }
    }

    /// Carried from the middle to the end.
    fn end_covariance(&self, semi_axes: Option<[f64; 3]>) -> Option<DMatrix<f64>> {
        let mut covariance = self.covariance_at(1)?;
        for (axis, length) in semi_axes.into_iter().flatten().enumerate() {
            // From the logarithm to the length.
            covariance.row_mut(STATE_COLUMNS + axis).scale_mut(length);
            covariance.column_mut(STATE_COLUMNS + axis).scale_mut(length);
        }
        Some(covariance)
    }
}

/// Covariance of what is fitted as slopes have it, with zeros for what is fixed; in the middle of the window.
pub(super) fn covariance_of(unknowns: &Unknowns, fit: &RollFit) -> Option<DMatrix<f64>> {
    let size = fit.information.nrows();
    let fitted = fitted(unknowns, size);
    let inner = covariance(&fit.information.select_rows(&fitted).select_columns(&fitted))?;
    let mut whole = DMatrix::zeros(size, size);
    for (i, &row) in fitted.iter().enumerate() {
        for (j, &column) in fitted.iter().enumerate() {
            whole[(row, column)] = inner[(i, j)];
        }
    }
    Some(whole)
}

/// Columns of the information that are fitted.
fn fitted(unknowns: &Unknowns, columns: usize) -> Vec<usize> {
    (0..columns).filter(|&column| !(unknowns.spin == Spin::NoSpin && column == SPIN_COLUMN)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two degrees: an error beyond so many standard deviations comes once in two thousand, and three of them are tried.
    #[test]
    fn two_degrees_are_guaranteed_from_a_half_of_a_degree_on() {
        let degrees = |sigma: f64| is_guaranteed(sigma.to_radians());
        assert!(degrees(0.5) && degrees(0.57) && !degrees(0.58) && !degrees(1.0) && !degrees(2.0));
    }
}
