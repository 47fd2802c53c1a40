//! Damped least squares (Levenberg and Marquardt): one owner of the iteration for every fit.
//!
//! Lowers a cost `c`, mostly a sum of squares Σ rᵢ², that near a place is taken for a parabola in a step `s`:
//!
//! ```text
//! c(s) ≈ c + 2 gᵀ s + sᵀ H s        g = Jᵀ r, H = Jᵀ J, J = ∂r/∂s
//! (H + F + λ diag H) s = −g         a trial step: damping λ, floor F
//! ```
//!
//! **Damping** is Marquardt's: a multiple of each unknown's own curvature. Levenberg's multiple of the identity would
//! make the path depend on the units, and here metres, radians and logarithms stand side by side. A trial that lowers
//! the cost is kept and λ falls; one that does not is taken back and λ grows, so that steps turn downhill and shorten.
//! The **floor** stands for measurements too poor to show: it keeps an unknown without any influence where it is.
//!
//! What a place is stays with the [`LeastSquaresProblem`]: how a step moves it (rotations, wrapped angles, bounds), how
//! far the parabola can be trusted ([`LeastSquaresProblem::limited`]), which unknowns rest against a bound
//! ([`LeastSquaresProblem::held`]), what constraints and priors add to the cost. The constants are data
//! ([`LeastSquaresSettings`]).
//!
//! Source: D. W. Marquardt, "An Algorithm for Least-Squares Estimation of Nonlinear Parameters", J. SIAM 11 (1963)
//! 431–441.
//! Assumes: `H` has no negative eigenvalue. Units: any; a cost is mostly in squared standard deviations. Errors: none;
//! a place that has no evaluation is a trial that failed, and the [`Outcome`] says how a descent ended.

pub mod profile;

use nalgebra::{SMatrix, SVector};

/// A trial that fails although less than this share of the cost was to be gained fails by rounding: sums of squares
/// keep some 14 digits, and no damping finds what lies below.
const ROUNDING_SHARE: f64 = 1e-12;

/// A cost near a place, to second order: what a linearisation of residuals gives.
///
/// ```
/// use nalgebra::Vector2;
/// use palpate::math::least_squares::NormalEquations;
///
/// // A line `a + b t` (m) through readings 1.0, 1.5 and 2.1 at 0, 1 and 2 s: residuals at a = b = 0.
/// let mut equations = NormalEquations::zero();
/// for (t, reading) in [(0.0, 1.0), (1.0, 1.5), (2.0, 2.1)] {
///     equations.add(-reading, Vector2::new(1.0, t));
/// }
/// let line = equations.gauss_newton_step().unwrap();
/// assert!((line - Vector2::new(0.983_333, 0.55)).norm() < 1e-6);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NormalEquations<const N: usize> {
    /// Σ r², mostly in squared standard deviations.
    pub cost: f64,
    /// Jᵀ r: half the gradient of the cost.
    pub gradient: SVector<f64, N>,
    /// Jᵀ J: half the curvature of the cost, after Gauss.
    pub curvature: SMatrix<f64, N, N>,
}

impl<const N: usize> NormalEquations<N> {
    /// Those of no residuals.
    #[must_use]
    pub fn zero() -> Self {
        Self { cost: 0.0, gradient: SVector::zeros(), curvature: SMatrix::zeros() }
    }

    /// Adds a residual with its derivatives by the unknowns.
    #[inline]
    pub fn add(&mut self, residual: f64, slopes: SVector<f64, N>) {
        self.cost += residual * residual;
        self.gradient += slopes * residual;
        self.curvature += slopes * slopes.transpose();
    }

    /// By how much a step lowers the cost, if the cost is the parabola that this says; negative where it raises it.
    #[must_use]
    pub fn predicted_reduction(&self, step: &SVector<f64, N>) -> f64 {
        -(2.0 * self.gradient.dot(step) + (step.transpose() * self.curvature * step)[0])
    }

    /// The step to the parabola's lowest place: Gauss's and Newton's, without damping. None where the curvature is
    /// singular.
    #[must_use]
    pub fn gauss_newton_step(&self) -> Option<SVector<f64, N>> {
        Some(-self.curvature.cholesky()?.solve(&self.gradient))
    }

    /// The same with some unknowns held where they are, as if they were not there.
    pub(crate) fn hold(&mut self, held: [bool; N]) {
        for i in (0..N).filter(|&i| held[i]) {
            self.curvature.row_mut(i).fill(0.0);
            self.curvature.column_mut(i).fill(0.0);
            self.curvature[(i, i)] = 1.0;
            self.gradient[i] = 0.0;
        }
    }
}

/// What is fitted, and to what.
///
/// ```
/// use nalgebra::Vector1;
/// use palpate::math::least_squares::{NormalEquations, Outcome, LeastSquaresProblem, LeastSquaresSettings, minimise};
///
/// /// The heading (rad) from which beacons lie at the bearings measured.
/// struct Compass([[f64; 2]; 3]);
///
/// impl Compass {
///     fn misses(&self, heading: f64) -> [f64; 3] {
///         // Half a sine: smooth across the cut of angles, and an angle where it is small.
///         self.0.map(|[beacon, bearing]| 2.0 * (0.5 * (heading + bearing - beacon)).sin())
///     }
/// }
///
/// impl LeastSquaresProblem<1> for Compass {
///     type Place = f64;
///
///     fn cost(&self, heading: &f64) -> f64 {
///         self.misses(*heading).iter().map(|miss| miss * miss).sum()
///     }
///
///     fn normal_equations(&self, heading: &f64) -> NormalEquations<1> {
///         let mut equations = NormalEquations::zero();
///         for (miss, [beacon, bearing]) in self.misses(*heading).into_iter().zip(self.0) {
///             equations.add(miss, Vector1::new((0.5 * (heading + bearing - beacon)).cos()));
///         }
///         equations
///     }
///
///     fn moved(&self, heading: &f64, step: &Vector1<f64>) -> Option<f64> {
///         Some((heading + step[0]).rem_euclid(std::f64::consts::TAU))
///     }
/// }
///
/// let compass = Compass([[0.1, 6.2], [1.0, 0.82], [2.0, 1.8]]);
/// let found = minimise(&compass, 6.0, &LeastSquaresSettings::default(), |_| false);
/// assert_eq!(found.outcome, Outcome::Converged);
/// assert!((found.place - 0.1878).abs() < 1e-4);
/// ```
pub trait LeastSquaresProblem<const N: usize> {
    /// Values of the unknowns, with whatever came of evaluating them.
    type Place;

    /// What is lowered. A place whose cost is not a number or infinite is never moved to.
    fn cost(&self, place: &Self::Place) -> f64;

    /// The cost near a place. Asked for once for each place that is moved from.
    fn normal_equations(&self, place: &Self::Place) -> NormalEquations<N>;

    /// The place that a step leads to, within bounds; none where nothing can be evaluated.
    fn moved(&self, place: &Self::Place, step: &SVector<f64, N>) -> Option<Self::Place>;

    /// The unknowns that no step may change: at a bound that the cost presses them against, or not there at all.
    fn held(&self, _place: &Self::Place, _equations: &NormalEquations<N>) -> [bool; N] {
        [false; N]
    }

    /// A step, shortened to what the parabola can be trusted with.
    fn limited(&self, step: SVector<f64, N>) -> SVector<f64, N> {
        step
    }

    /// Whether a place needs no further step.
    fn is_minimum(&self, _place: &Self::Place, _equations: &NormalEquations<N>) -> bool {
        false
    }
}

/// How the damping λ changes from trial to trial.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// λ of the first trial; 0 for a step of Gauss and Newton.
    pub first: f64,
    /// Least λ that success leads to.
    pub min: f64,
    /// λ at which a step is as good as none: from here on the descent has stalled.
    pub max: f64,
    /// Factor of λ after a failure.
    pub up: f64,
    /// Least λ after a failure: saves trials that hardly differ, and is needed where λ may be 0.
    pub min_after_failure: f64,
    /// Factor of λ after a success.
    pub down: f64,
    /// A success must bring more than this share of what was predicted for λ to fall.
    pub trusted_share: f64,
}

/// What is added to the diagonal of the curvature beside the damping.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Floor<const N: usize> {
    /// For each unknown, in its own unit: a scale far above what it can be, squared and inverted.
    Absolute([f64; N]),
    /// A share of the largest entry on the diagonal: at 1e-15, what rounding leaves of it.
    Relative(f64),
}

impl<const N: usize> Floor<N> {
    /// Nothing: every unknown has curvature of its own.
    pub const NONE: Self = Self::Relative(0.0);

    fn of(&self, curvature: &SMatrix<f64, N, N>) -> [f64; N] {
        match *self {
            Self::Absolute(each) => each,
            Self::Relative(share) => {
                let largest = (0..N).map(|i| curvature[(i, i)].abs()).fold(0.0, f64::max);
                [share * largest; N]
            }
        }
    }
}

/// When a descent has come to its end: a success lowered the cost by no more than `relative · cost + absolute`, or a trial failed
/// where no more was to be gained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Enough {
    /// Share of the cost.
    pub relative: f64,
    /// In units of the cost.
    pub absolute: f64,
    /// A strongly damped step gains little wherever it is: gains count only up to this λ.
    pub damping_max: f64,
}

/// The constants of a descent.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LeastSquaresSettings<const N: usize> {
    /// How far steps may go.
    pub damping: Damping,
    /// What holds unknowns without influence.
    pub floor: Floor<N>,
    /// When a descent has come to its end.
    pub enough: Enough,
    /// Trials at most, failures included.
    pub trials_max: usize,
    /// Steps down at most.
    pub steps_max: usize,
}

/// Damping from a thousandth up until steps are no longer than 1e-8 of those without it; enough is what gains 1e-12 of
/// the cost.
impl<const N: usize> Default for LeastSquaresSettings<N> {
    fn default() -> Self {
        Self {
            damping: Damping {
                first: 1e-3,
                min: 0.0,
                max: 1e8,
                up: 10.0,
                min_after_failure: 0.0,
                down: 0.1,
                trusted_share: 0.0,
            },
            floor: Floor::Relative(1e-15),
            enough: Enough { relative: 1e-12, absolute: 0.0, damping_max: 1.0 },
            trials_max: 100,
            steps_max: usize::MAX,
        }
    }
}

/// How a descent ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// The last step gained too little to go on, or the problem says that this is the minimum.
    Converged,
    /// The bound on trials or steps.
    LimitReached,
    /// No step lowers the cost, however short.
    Stalled,
    /// The caller said so.
    Stopped,
}

/// Where a descent ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Found<Place> {
    /// The place of the lowest cost that was found.
    pub place: Place,
    /// Why the descent ended there.
    pub outcome: Outcome,
    /// Steps tried, failures included.
    pub trials: usize,
}

/// A step that was tried: what a caller decides by whether to go on.
#[derive(Clone, Copy, Debug)]
pub struct Trial<'a, Place> {
    /// How many there were, this one included.
    pub count: usize,
    /// Where the descent stands after it.
    pub place: &'a Place,
    /// The cost before the step.
    pub cost_before: f64,
    /// The cost that the step led to; infinite where nothing could be evaluated.
    pub cost_after: f64,
    /// Whether it lowered the cost.
    pub is_lower: bool,
}

/// Goes down from a place until nothing is to be gained, the bounds are reached, or `stop` says so of a trial.
#[must_use]
pub fn minimise<const N: usize, P: LeastSquaresProblem<N>>(
    problem: &P,
    start: P::Place,
    settings: &LeastSquaresSettings<N>,
    mut stop: impl FnMut(&Trial<'_, P::Place>) -> bool,
) -> Found<P::Place> {
    let mut place = start;
    let mut descent = Descent { problem, settings, damping: settings.damping.first, trials: 0 };
    for _ in 0..settings.steps_max {
        match descent.step(&place, &mut stop) {
            Ok(Lower { next, end: None }) => place = next,
            Ok(Lower { next, end: Some(outcome) }) => return Found { place: next, outcome, trials: descent.trials },
            Err(outcome) => return Found { place, outcome, trials: descent.trials },
        }
    }
    Found { place, outcome: Outcome::LimitReached, trials: descent.trials }
}

/// One step down, for callers that take several descents side by side: `damping` goes on from step to step, and begins
/// with that of the settings. The bound on trials is that of this one step; how many steps, and what is enough, the
/// caller decides.
///
/// # Errors
/// The outcome, where no step lowers the cost or none is needed.
pub fn lowered<const N: usize, P: LeastSquaresProblem<N>>(
    problem: &P,
    place: &P::Place,
    settings: &LeastSquaresSettings<N>,
    damping: &mut f64,
) -> Result<P::Place, Outcome> {
    let mut descent = Descent { problem, settings, damping: *damping, trials: 0 };
    let lower = descent.step(place, &mut |_| false);
    *damping = descent.damping;
    lower.map(|lower| lower.next)
}

/// By how much the next step would lower the cost without damping, if the cost is a parabola: 0 at a minimum, and where
/// the curvature is singular.
pub fn predicted_reduction<const N: usize, P: LeastSquaresProblem<N>>(
    problem: &P,
    place: &P::Place,
    settings: &LeastSquaresSettings<N>,
) -> f64 {
    Parabola::at(problem, place, settings).step(0.0).map_or(0.0, |step| step.predicted_reduction)
}

/// A descent between two trials.
struct Descent<'a, P, const N: usize> {
    problem: &'a P,
    settings: &'a LeastSquaresSettings<N>,
    damping: f64,
    trials: usize,
}

/// A lower place, and the outcome if it is the last one.
struct Lower<Place> {
    next: Place,
    end: Option<Outcome>,
}

impl<const N: usize, P: LeastSquaresProblem<N>> Descent<'_, P, N> {
    /// Tries steps from a place until one lowers the cost.
    fn step(
        &mut self,
        place: &P::Place,
        stop: &mut impl FnMut(&Trial<'_, P::Place>) -> bool,
    ) -> Result<Lower<P::Place>, Outcome> {
        let parabola = Parabola::at(self.problem, place, self.settings);
        if self.problem.is_minimum(place, &parabola.equations) {
            return Err(Outcome::Converged);
        }
        let cost_before = self.problem.cost(place);
        while self.trials < self.settings.trials_max {
            if self.damping >= self.settings.damping.max {
                return Err(Outcome::Stalled);
            }
            self.trials += 1;
            let step = parabola.step(self.damping);
            let next = step.as_ref().and_then(|step| self.problem.moved(place, &step.by));
            let cost_after = next.as_ref().map_or(f64::INFINITY, |next| self.problem.cost(next));
            let trial = |place, is_lower| Trial { count: self.trials, place, cost_before, cost_after, is_lower };
            let predicted = step.map_or(f64::INFINITY, |step| step.predicted_reduction);
            // Costs that are not numbers compare as not lower.
            if let Some(next) = next.filter(|_| cost_after < cost_before) {
                let gain = cost_before - cost_after;
                let end = if self.is_enough(gain, cost_after) {
                    Some(Outcome::Converged)
                } else {
                    stop(&trial(&next, true)).then_some(Outcome::Stopped)
                };
                self.succeed(gain, predicted);
                return Ok(Lower { next, end });
            }
            if stop(&trial(place, false)) {
                return Err(Outcome::Stopped);
            }
            if cost_before.is_finite() && predicted <= ROUNDING_SHARE * cost_before {
                return Err(Outcome::Stalled);
            }
            // Shorter steps would gain even less.
            if self.is_enough(predicted, cost_before) {
                return Err(Outcome::Converged);
            }
            self.fail();
        }
        Err(Outcome::LimitReached)
    }

    fn is_enough(&self, gain: f64, cost: f64) -> bool {
        let Enough { relative, absolute, damping_max } = self.settings.enough;
        gain <= relative * cost + absolute && self.damping <= damping_max
    }

    fn succeed(&mut self, gain: f64, predicted: f64) {
        let Damping { down, min, trusted_share, .. } = self.settings.damping;
        if gain > trusted_share * predicted {
            self.damping = (self.damping * down).max(min);
        }
    }

    fn fail(&mut self) {
        let Damping { up, min_after_failure, .. } = self.settings.damping;
        self.damping = (self.damping * up).max(min_after_failure);
    }
}

/// What a place looks like to a step: the cost near it, and what may not move.
struct Parabola<'a, P, const N: usize> {
    problem: &'a P,
    equations: NormalEquations<N>,
    held: [bool; N],
    floor: [f64; N],
}

/// A step, and by how much it lowers the parabola.
struct Step<const N: usize> {
    by: SVector<f64, N>,
    predicted_reduction: f64,
}

impl<'a, const N: usize, P: LeastSquaresProblem<N>> Parabola<'a, P, N> {
    fn at(problem: &'a P, place: &P::Place, settings: &LeastSquaresSettings<N>) -> Self {
        let equations = problem.normal_equations(place);
        let held = problem.held(place, &equations);
        Self { problem, floor: settings.floor.of(&equations.curvature), equations, held }
    }

    /// A damped step; none where even the damped curvature is singular.
    fn step(&self, damping: f64) -> Option<Step<N>> {
        let mut damped = self.equations;
        for i in 0..N {
            let own = damped.curvature[(i, i)];
            damped.curvature[(i, i)] += self.floor[i] + damping * own;
        }
        damped.hold(self.held);
        let by = self.problem.limited(damped.gauss_newton_step()?);
        // Held unknowns do not move, so their gradient does not count.
        let predicted_reduction = self.equations.predicted_reduction(&by).max(0.0);
        Some(Step { by, predicted_reduction })
    }
}

#[cfg(test)]
mod tests;
