//! Least squares: the state in the middle, and what else is unknown, that explain the readings best.
//!
//! Damped [`least_squares`] on the rotation group, with sensitivities from [`flow`](super::super::flow).
//!
//! Units: residuals over their standard deviation. Errors: none; a fit that fails has an infinite cost.

use nalgebra::{DMatrix, DVector, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::super::body::RollingBody;
use super::super::flow::{Columns, STATE_COLUMNS, StateWithTangent, Tangent};
use super::super::mechanics::{Model, RollState, Spin};
use super::super::shape::{Ellipsoid, Shape};
use super::track::{IntegrationStep, Track};
use crate::math::least_squares::profile::{self, Beside};
use crate::math::least_squares::{
    self, Damping, Enough, Floor, LeastSquaresProblem, LeastSquaresSettings, NormalEquations, Trial,
};
use crate::search::Halt;

/// Column of the spin among those of a state: fixed where there is none.
pub(super) const SPIN_COLUMN: usize = 5;

/// Longest step of an iteration, rad: beyond it the linear model says nothing.
const TURN_MAX: f64 = 0.6;

/// How far steps go: the damping and its change.
const DAMPING: Damping =
    Damping { first: 1e-3, min: 1e-12, max: 1e9, up: 6.0, min_after_failure: 0.0, down: 0.2, trusted_share: 0.0 };

/// Trials of a fit beside a minimum, and what its last step may bring: a hundredth of the cost of one standard deviation.
const ITERATIONS_BESIDE: usize = 12;
/// See [`ITERATIONS_BESIDE`].
const ENOUGH_BESIDE: Enough = Enough { relative: 0.0, absolute: 0.01, damping_max: 1.0 };

/// Angular velocity that no rolling body has, rad/s: the fit has run away.
const OMEGA_MAX: f64 = 1e3;

/// What a fit looks for.
#[derive(Clone, Debug)]
pub(super) struct Point {
    /// State in the middle of the window.
    pub(super) state: RollState,
    pub(super) body: RollingBody,
    /// Constant acceleration of the palm beside the known one, m/s².
    pub(super) palm: Vector3<f64>,
}

/// What is unknown, and within which limits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Unknowns {
    pub(super) spin: Spin,
    pub(super) columns: Columns,
    /// Least and greatest semi-axis, m.
    pub(super) range: [f64; 2],
}

/// How hard to try.
#[derive(Clone, Copy, Debug)]
pub(super) struct Effort<'a> {
    /// Readings away from the middle to explain.
    pub(super) ranks: usize,
    pub(super) iterations: usize,
    /// Decrease of the cost at which to stop.
    pub(super) enough: Enough,
    /// Standard deviation of a zero-mean prior of the palm's unknown acceleration, m/s²; infinite for none.
    pub(super) palm_sigma: f64,
    pub(super) norm: Norm,
    /// Every cost is infinite once this is wished.
    pub(super) halt: &'a Halt<'a>,
}

impl Effort<'_> {
    fn settings<const P: usize>(&self) -> LeastSquaresSettings<P> {
        LeastSquaresSettings {
            damping: DAMPING,
            // Far below anything that readings tell.
            floor: Floor::Relative(1e-15),
            enough: self.enough,
            trials_max: self.iterations,
            steps_max: usize::MAX,
        }
    }
}

/// What is summed over the residuals.
#[derive(Clone, Copy, Debug)]
pub(super) enum Norm {
    /// Squares over the variance: best for normal errors.
    Squares,
    /// Eighth powers over that of a bound, m: errors of rounding are uniform up to it, and the variance of this
    /// estimate is a fifth of that of least squares (1/(2p − 1) against 1/3 of the bound's square, for power p).
    Bounded(f64),
}

/// Where a fit ended.
#[derive(Clone, Debug)]
pub(super) struct RollFit {
    pub(super) point: Point,
    pub(super) cost: f64,
    /// Half the second derivatives of the cost by the state's columns, the further columns and `u`.
    pub(super) information: DMatrix<f64>,
}

/// A first look at what a fit from a place would come to.
#[derive(Clone, Debug)]
pub(super) struct Approach {
    /// One step nearer.
    pub(super) point: Point,
    /// The cost there if the cost were a parabola.
    pub(super) promised: f64,
}

impl RollFit {
    /// Squared distance of another state of the same body from this one, in standard deviations of this fit, modulo the
    /// body's symmetry.
    pub(super) fn squared_deviations(&self, other: &Point) -> f64 {
        let step = self.step_to(other);
        (step.transpose() * &self.information * step)[0]
    }

    /// The step to another state of the same body, by column, modulo the body's symmetry.
    pub(super) fn step_to(&self, other: &Point) -> DVector<f64> {
        let (here, there) = (&self.point.state, &other.state);
        let attitude = self.point.body.symmetry().nearest(&here.attitude(), &there.attitude());
        let theta = (here.attitude().inverse() * attitude).scaled_axis();
        let turning = there.attitude() * there.omega - here.attitude() * here.omega;
        let (palm, u) = (other.palm - self.point.palm, there.u - here.u);
        let size = self.information.nrows();
        let mut step = DVector::zeros(size);
        step.rows_mut(0, 3).copy_from(&theta);
        step.rows_mut(3, 3).copy_from(&turning);
        if size > STATE_COLUMNS + 2 {
            step.rows_mut(size - 5, 3).copy_from(&palm);
        }
        step.rows_mut(size - 2, 2).copy_from(&u);
        step
    }
}

impl Unknowns {
    /// Numbers that are fitted.
    pub(super) fn count(&self) -> usize {
        self.columns.count() + 2 - usize::from(self.spin == Spin::NoSpin)
    }

    /// The best fit near `start`; what it had come to where it should halt before.
    pub(super) fn fit(&self, track: &Track, start: Point, effort: &Effort<'_>) -> RollFit {
        match self.columns.count() {
            6 => self.fit_columns::<6, 8>(track, start, effort),
            9 => self.fit_columns::<9, 11>(track, start, effort),
            _ => self.fit_columns::<12, 14>(track, start, effort),
        }
    }

    /// One step of Gauss and Newton from `start`, for a fraction of the time of a fit; none where the cost is infinite.
    pub(super) fn approach(&self, track: &Track, start: &Point, effort: &Effort<'_>) -> Option<Approach> {
        match self.columns.count() {
            6 => self.approach_columns::<6, 8>(track, start, effort),
            9 => self.approach_columns::<9, 11>(track, start, effort),
            _ => self.approach_columns::<12, 14>(track, start, effort),
        }
    }

    fn approach_columns<const N: usize, const P: usize>(
        &self,
        track: &Track,
        start: &Point,
        effort: &Effort<'_>,
    ) -> Option<Approach> {
        let equations = self.weigh::<N, P>(track, start, effort);
        let mut damped = equations;
        for i in 0..P {
            damped.curvature[(i, i)] += DAMPING.first * equations.curvature[(i, i)];
        }
        if self.spin == Spin::NoSpin {
            damped.curvature.row_mut(SPIN_COLUMN).fill(0.0);
            damped.curvature.column_mut(SPIN_COLUMN).fill(0.0);
            damped.curvature[(SPIN_COLUMN, SPIN_COLUMN)] = 1.0;
            damped.gradient[SPIN_COLUMN] = 0.0;
        }
        let step = shortened(damped.gauss_newton_step()?);
        let promised = equations.cost - equations.predicted_reduction(&step).max(0.0);
        promised.is_finite().then(|| Approach { point: self.moved(start, &step), promised })
    }

    fn fit_columns<const N: usize, const P: usize>(&self, track: &Track, start: Point, effort: &Effort<'_>) -> RollFit {
        let settings = effort.settings();
        let fitting = Fitting::<N> { unknowns: self, track, effort };
        // A cost that hardly grows is at its minimum.
        let is_flat = |trial: &Trial<'_, Weighed<P>>| {
            effort.halt.is_wished() || !trial.is_lower && trial.cost_after - trial.cost_before < effort.enough.absolute
        };
        let Weighed { point, equations } =
            least_squares::minimise(&fitting, fitting.weighed(start), &settings, is_flat).place;
        let information = DMatrix::from_column_slice(P, P, equations.curvature.as_slice());
        RollFit { point, cost: equations.cost, information }
    }

    /// The best fits where one unknown is held beside that of a fit, on one side (1 or −1); `along`: the step of one
    /// standard deviation of it, with all others as they follow on the parabola.
    pub(super) fn beside(
        &self,
        track: &Track,
        fit: &RollFit,
        along: (usize, &DVector<f64>),
        side: f64,
        halt: &Halt<'_>,
    ) -> Vec<Beside<Point>> {
        match self.columns.count() {
            6 => self.beside_columns::<6, 8>(track, fit, along, side, halt),
            9 => self.beside_columns::<9, 11>(track, fit, along, side, halt),
            _ => self.beside_columns::<12, 14>(track, fit, along, side, halt),
        }
    }

    fn beside_columns<const N: usize, const P: usize>(
        &self,
        track: &Track,
        fit: &RollFit,
        (unknown, along): (usize, &DVector<f64>),
        side: f64,
        halt: &Halt<'_>,
    ) -> Vec<Beside<Point>> {
        let effort = Effort {
            ranks: track.ranks_max(),
            iterations: ITERATIONS_BESIDE,
            enough: ENOUGH_BESIDE,
            palm_sigma: f64::INFINITY,
            norm: Norm::Squares,
            halt,
        };
        let fitting = Fitting::<N> { unknowns: self, track, effort: &effort };
        let along = SVector::<f64, P>::from_fn(|i, _| along[i]);
        let minimum = fitting.weighed(fit.point.clone());
        let found = profile::beside(&fitting, &minimum, (unknown, &along), side, &effort.settings());
        found.into_iter().map(|beside| beside.map(|weighed| weighed.point)).collect()
    }

    /// The step from one place to another, as [`RollFit::information`] has the columns; of unknown ellipsoids the
    /// logarithms of the semi-axes change.
    pub(super) fn change(&self, here: &Point, there: &Point) -> DVector<f64> {
        let (before, after) = (&here.state, &there.state);
        let theta = (before.attitude().inverse() * after.attitude()).scaled_axis();
        let turning = after.attitude() * after.omega - before.attitude() * before.omega;
        let mut change: Vec<f64> = theta.iter().chain(&turning).copied().collect();
        if let (true, Shape::Ellipsoid(here), Shape::Ellipsoid(there)) =
            (self.columns.semi_axes, here.body.shape(), there.body.shape())
        {
            change.extend(there.semi_axes.iter().zip(here.semi_axes).map(|(there, here)| (there / here).ln()));
        }
        if self.columns.palm {
            change.extend(&(there.palm - here.palm));
        }
        change.extend(&(after.u - before.u));
        change.into()
    }

    fn moved<const P: usize>(&self, point: &Point, step: &SVector<f64, P>) -> Point {
        let Point { state, body, palm } = point;
        let attitude = state.attitude();
        let turned = attitude * UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(0).into_owned());
        let spinning = attitude * state.omega + step.fixed_rows::<3>(3);
        let state = RollState {
            orientation: turned.into_inner(),
            omega: turned.inverse() * spinning,
            u: state.u + Vector2::new(step[P - 2], step[P - 1]),
        };
        let body = match (self.columns.semi_axes, body.shape()) {
            (true, Shape::Ellipsoid(ellipsoid)) => {
                self.reshaped(body, ellipsoid, &step.fixed_rows::<3>(STATE_COLUMNS).into())
            }
            _ => body.clone(),
        };
        let palm = if self.columns.palm { palm + step.fixed_rows::<3>(P - 5) } else { *palm };
        Point { state, body, palm }
    }

    fn reshaped(&self, body: &RollingBody, ellipsoid: &Ellipsoid, longer: &[f64; 3]) -> RollingBody {
        let [low, high] = self.range;
        let axis = |i: usize| (ellipsoid.semi_axes[i] * longer[i].clamp(-0.5, 0.5).exp()).clamp(low, high);
        RollingBody::ellipsoid([axis(0), axis(1), axis(2)]).unwrap_or_else(|_| body.clone())
    }

    /// Cost, gradient and normal matrix.
    fn weigh<const N: usize, const P: usize>(
        &self,
        track: &Track,
        point: &Point,
        effort: &Effort<'_>,
    ) -> NormalEquations<P> {
        let model = Model { body: &point.body, spin: self.spin };
        let mut normal = Normal::<P> { norm: effort.norm, sums: NormalEquations::zero() };
        // The reading in the middle shows u alone.
        normal.add(&[[0.0; N]; 2], point.state.u - track.centre);
        let mut looks = effort.halt.now_and_then();
        let mut is_broken_off = effort.halt.is_wished();
        // From there forward and backward in time, each reading with the columns carried to it.
        for integration_steps in [&track.forward, &track.backward] {
            let mut here = StateWithTangent::<N>::seed(&point.state);
            for IntegrationStep { dt, specific_force, reading, rank } in integration_steps {
                is_broken_off |= looks.goes_on().is_none();
                if *rank > effort.ranks || is_broken_off {
                    break;
                }
                let specific_force = specific_force.map(|specific_force| specific_force + point.palm);
                here = model.step_with(self.columns, &here, &specific_force, *dt);
                if let Some(reading) = reading {
                    normal.add(&here.tangent.u, here.state.u - reading);
                }
            }
            // A body that turns beyond reason, or whose numbers are none, is no explanation.
            let is_slow = here.state.omega.norm_squared() < OMEGA_MAX * OMEGA_MAX;
            if is_broken_off || !is_slow {
                normal.sums.cost = f64::INFINITY;
            }
        }
        // Squares are counted in σ²; a bounded norm counts in its bound already.
        normal.finish(match effort.norm {
            Norm::Squares => 1.0 / (track.sigma * track.sigma),
            Norm::Bounded(_) => 1.0,
        });
        if self.columns.palm && effort.palm_sigma.is_finite() {
            normal.prior(P - 5, &point.palm, effort.palm_sigma);
        }
        normal.sums
    }

    /// The states at the first and the last reading, and the columns there.
    pub(super) fn ends(&self, track: &Track, point: &Point) -> Ends {
        match self.columns.count() {
            6 => self.ends_of::<6>(track, point),
            9 => self.ends_of::<9>(track, point),
            _ => self.ends_of::<12>(track, point),
        }
    }

    fn ends_of<const N: usize>(&self, track: &Track, point: &Point) -> Ends {
        let model = Model { body: &point.body, spin: self.spin };
        let go = |integration_steps: &[IntegrationStep]| {
            let start = StateWithTangent::<N>::seed(&point.state);
            integration_steps.iter().fold(start, |here, integration_step| {
                let specific_force = integration_step.specific_force.map(|specific_force| specific_force + point.palm);
                model.step_with(self.columns, &here, &specific_force, integration_step.dt)
            })
        };
        let columns = |tangent: &Tangent<N>| {
            let rows = tangent.theta.iter().chain(&tangent.omega);
            let columns = SMatrix::<f64, STATE_COLUMNS, N>::from_row_iterator(rows.flatten().copied());
            DMatrix::from_column_slice(STATE_COLUMNS, N, columns.as_slice())
        };
        let [start, end] = [&track.backward, &track.forward].map(|integration_steps| go(integration_steps));
        Ends { start: start.state, end: end.state, columns: [columns(&start.tangent), columns(&end.tangent)] }
    }

    /// What is left over after a fit.
    pub(super) fn residuals(&self, track: &Track, point: &Point) -> Residuals {
        let model = Model { body: &point.body, spin: self.spin };
        let first = point.state.u - track.centre;
        let (mut max, mut squares, mut products) = (first.amax(), first.norm_squared(), 0.0);
        for integration_steps in [&track.forward, &track.backward] {
            let (mut state, mut before) = (point.state, first);
            for integration_step in integration_steps {
                state = model.step(
                    &state,
                    &integration_step.specific_force.map(|specific_force| specific_force + point.palm),
                    integration_step.dt,
                );
                if let Some(reading) = integration_step.reading {
                    let residual = state.u - reading;
                    max = residual.amax().max(max);
                    squares += residual.norm_squared();
                    // Neighbours in time, from the middle outward.
                    products += residual.dot(&before);
                    before = residual;
                }
            }
        }
        Residuals { max, correlation: products / squares.max(f64::MIN_POSITIVE) }
    }
}

/// What a fit leaves over.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Residuals {
    /// The largest of a coordinate, m.
    pub(super) max: f64,
    /// Of each residual with its neighbour: 0 for independent errors.
    pub(super) correlation: f64,
}

/// The two ends of a fitted motion.
#[derive(Clone, Debug)]
pub(super) struct Ends {
    pub(super) start: RollState,
    pub(super) end: RollState,
    /// Changes of attitude and angular velocity (body axes) at the start and at the end, by column.
    pub(super) columns: [DMatrix<f64>; 2],
}

/// A point with its cost and the derivatives of that.
struct Weighed<const P: usize> {
    point: Point,
    equations: NormalEquations<P>,
}

/// A fit whose states have so many columns.
struct Fitting<'a, const N: usize> {
    unknowns: &'a Unknowns,
    track: &'a Track,
    effort: &'a Effort<'a>,
}

impl<const N: usize> Fitting<'_, N> {
    fn weighed<const P: usize>(&self, point: Point) -> Weighed<P> {
        Weighed { equations: self.unknowns.weigh::<N, P>(self.track, &point, self.effort), point }
    }
}

impl<const N: usize, const P: usize> LeastSquaresProblem<P> for Fitting<'_, N> {
    type Place = Weighed<P>;

    fn cost(&self, weighed: &Weighed<P>) -> f64 {
        weighed.equations.cost
    }

    fn normal_equations(&self, weighed: &Weighed<P>) -> NormalEquations<P> {
        weighed.equations
    }

    fn moved(&self, weighed: &Weighed<P>, step: &SVector<f64, P>) -> Option<Weighed<P>> {
        Some(self.weighed(self.unknowns.moved(&weighed.point, step)))
    }

    fn held(&self, _: &Weighed<P>, _: &NormalEquations<P>) -> [bool; P] {
        std::array::from_fn(|i| i == SPIN_COLUMN && self.unknowns.spin == Spin::NoSpin)
    }

    /// No turn beyond the longest.
    fn limited(&self, step: SVector<f64, P>) -> SVector<f64, P> {
        shortened(step)
    }
}

/// A step that turns by no more than [`TURN_MAX`].
fn shortened<const P: usize>(step: SVector<f64, P>) -> SVector<f64, P> {
    let turn = step.fixed_rows::<3>(0).norm();
    if turn > TURN_MAX { step * (TURN_MAX / turn) } else { step }
}

/// Normal equations being summed up.
struct Normal<const P: usize> {
    norm: Norm,
    sums: NormalEquations<P>,
}

impl<const P: usize> Normal<P> {
    /// One reading's residual (m) and its slopes; those by `u` are 1.
    #[inline]
    fn add<const N: usize>(&mut self, slopes: &[[f64; N]; 2], residual: Vector2<f64>) {
        match self.norm {
            Norm::Squares => {
                self.sums.cost += residual.norm_squared();
                self.accumulate(slopes, residual.into(), [1.0; 2]);
            }
            Norm::Bounded(bound) => {
                let shares: [f64; 2] = (residual / bound).into();
                let sixths = shares.map(|share| share.powi(6));
                self.sums.cost += sixths[0] * shares[0] * shares[0] + sixths[1] * shares[1] * shares[1];
                // Halves of the derivatives of the eighth power, as those of squares are.
                let pull = |axis: usize| 4.0 * sixths[axis] * shares[axis] / bound;
                let bends = sixths.map(|sixth| 28.0 * sixth / (bound * bound));
                self.accumulate(slopes, [pull(0), pull(1)], bends);
            }
        }
    }

    #[inline]
    fn accumulate<const N: usize>(&mut self, [x, y]: &[[f64; N]; 2], [px, py]: [f64; 2], [bx, by]: [f64; 2]) {
        for i in 0..N {
            self.sums.gradient[i] += x[i] * px + y[i] * py;
            let (bent_x, bent_y) = (x[i] * bx, y[i] * by);
            for j in 0..=i {
                self.sums.curvature[(j, i)] += bent_x * x[j] + bent_y * y[j];
            }
            self.sums.curvature[(i, P - 2)] += bent_x;
            self.sums.curvature[(i, P - 1)] += bent_y;
        }
        self.sums.gradient[P - 2] += px;
        self.sums.gradient[P - 1] += py;
        self.sums.curvature[(P - 2, P - 2)] += bx;
        self.sums.curvature[(P - 1, P - 1)] += by;
    }

    /// Weighs everything and completes the matrix.
    fn finish(&mut self, weight: f64) {
        self.sums.cost *= weight;
        self.sums.gradient *= weight;
        self.sums.curvature *= weight;
        self.sums.curvature.fill_lower_triangle_with_upper_triangle();
    }

    fn prior(&mut self, first: usize, value: &Vector3<f64>, sigma: f64) {
        let weight = 1.0 / (sigma * sigma);
        self.sums.cost += value.norm_squared() * weight;
        for i in 0..3 {
            self.sums.gradient[first + i] += value[i] * weight;
            self.sums.curvature[(first + i, first + i)] += weight;
        }
    }
}
