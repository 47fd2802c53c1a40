//! The cost of a hypothesis, and how to lower it.
//!
//! The cost is the sum of squared residuals in standard deviations, terms of the prior included. Its derivatives come
//! with the simulation itself, so the step of Gauss and Newton is exact; [`least_squares`] keeps it from going too far.
//! What a contact cannot do (leave its stretch of the edge, pull, slip the other way) is held off by stiff springs: a
//! minimum that leans against such a constraint is found on it. The springs' energy is a penalty beside the cost, not
//! part of it.
//!
//! Frames: world. Units: SI; costs of no dimension. Errors: none; unknowns that lead to no motion have no evaluation.

use nalgebra::{Matrix4x5, Matrix5, RowVector5, SMatrix, SVector, Vector2, Vector5};

use super::clock::{Clock, Fineness, ValueTimes};
use super::data::Data;
use super::initial_state::{
    MU_G, PLACE, StartGuess, StartMode, UNKNOWNS, Unknowns, Variable, initial_state, rest_span,
};
use super::path::{CONSTRAINTS, ContactInterval, Seen, follow, plain_contact, plain_state};
use crate::math::Jet;
use crate::math::angle::wrap_angle;
use crate::math::least_squares::{
    self, Damping, Enough, Floor, LeastSquaresProblem, LeastSquaresSettings, NormalEquations,
};
use crate::pushing::dynamics::{ContactMode, Scalar, State};
use crate::pushing::estimation::observation::{Channel, Known, MU_G_LOG_MAX, Prior, Touch};
use crate::search::Effort;

/// |ω| at t = 0 at most, where there is no prior, rad/s. Fixed by the interface.
const OMEGA0_MAX: f64 = 10.0;

/// |v_T| at t = 0 at most, where there is no prior, m/s. Fixed by the interface.
const V_T0_MAX: f64 = 0.2;

/// How far each constraint gives way to one unit of penalty: place (m), twice; force (m/s², per µg), twice; slip (m/s).
const CONSTRAINT_COMPLIANCE: [f64; CONSTRAINTS] = [1e-5, 1e-5, 1e-3, 1e-3, 1e-4];

/// Support friction added to µg in the scale of a force, m/s²: without friction the finger pushes about so hard.
const FORCE_FLOOR: f64 = 1e-2;

/// Longest step of each unknown: a tenth of what it can be.
pub(super) const STEP_MAX: Unknowns = [0.3, 0.02, 3.0, 0.1, 0.3];

/// Curvature that holds an unknown without any influence in place: in inverse squares of [`STEP_MAX`], a millionth.
pub(super) const CURVATURE_MIN: [f64; UNKNOWNS] = {
    let [u, s, omega, v_t, mu_g_log] = STEP_MAX;
    [1e-6 / (u * u), 1e-6 / (s * s), 1e-6 / (omega * omega), 1e-6 / (v_t * v_t), 1e-6 / (mu_g_log * mu_g_log)]
};

/// How descents go down. Who follows them decides when they have gone far enough.
const DESCENT: LeastSquaresSettings<UNKNOWNS> = LeastSquaresSettings {
    damping: Damping {
        first: 1e-3,
        min: 0.0,
        max: 1e8,
        up: 10.0,
        min_after_failure: 1e-2,
        down: 0.1,
        trusted_share: 0.5,
    },
    floor: Floor::Absolute(CURVATURE_MIN),
    enough: Enough { relative: 0.0, absolute: 0.0, damping_max: f64::INFINITY },
    trials_max: usize::MAX,
    steps_max: usize::MAX,
};

/// A step that lowers the cost by less than this share of it leads nowhere: sixty of them would not change what is
/// listed.
pub(super) const STALLED_SHARE: f64 = 1e-3;

/// A part that slides along the finger moves no slower than this share of the finger's speed, as far as steps are
/// concerned.
const SPEED_SHARE_MIN: f64 = 0.1;

/// The same where it is not known how the finger moves to the contact.
const SPEED_SHARE: f64 = 0.7;

/// Relaxation time v/(µg), in which friction makes the part forget its speed, s: infinite without friction or motion.
///
/// A part that rolls on the finger moves about as fast as it does; one that slides along it, as fast as it moves into
/// the part.
pub(super) fn relaxation_time(known: &Known, data: &Data, time: f64) -> f64 {
    let velocity = known.finger.velocity(time);
    let angle = || {
        let angle = data.angle_near(time)?;
        Some(Vector2::new(angle.cos(), angle.sin()))
    };
    let speed = match (known.touch, angle()) {
        (Touch::Rolling { .. }, _) => velocity.norm(),
        (_, Some(toward)) => velocity.dot(&toward).abs().max(SPEED_SHARE_MIN * velocity.norm()),
        (_, None) => SPEED_SHARE * velocity.norm(),
    };
    if speed > 0.0 && known.mu_g > 0.0 { speed / known.mu_g } else { f64::INFINITY }
}

/// What to fit to what.
#[derive(Clone, Debug)]
pub(super) struct Fitting<'a, 'p> {
    pub(super) known: &'a Known<'p>,
    pub(super) data: Data,
    pub(super) prior: Prior,
    pub(super) clock: Clock,
    /// How long a start from rest is followed in closed form, s.
    pub(super) rest_span: f64,
    /// By how much the constraints are stiffer than [`CONSTRAINT_COMPLIANCE`].
    pub(super) constraint_stiffness: f64,
    /// What is taken as it is, of the unknowns.
    pub(super) held_unknown: Option<usize>,
    /// Counts the forward simulations, and ends them.
    pub(super) effort: &'a Effort<'a>,
}

/// What hypotheses are judged by.
pub(super) struct Given<'a, 'p> {
    pub(super) known: &'a Known<'p>,
    pub(super) data: Data,
    pub(super) prior: Prior,
}

/// A hypothesis with the values of its unknowns.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) interval: ContactInterval,
    pub(super) start_mode: StartMode,
    pub(super) unknowns: Unknowns,
    /// In place of the prior: what values before t = 0 say.
    pub(super) past: Option<Past>,
}

/// What values that are no longer kept said about the unknowns: their cost, near its minimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Past {
    /// Where it is least.
    pub(super) best: Vector5<f64>,
    /// Half its curvature there.
    pub(super) information: Matrix5<f64>,
    /// What it is there.
    pub(super) cost: f64,
    /// Values and prior terms that went into it.
    pub(super) terms: usize,
}

/// A candidate with its cost and what comes with it.
#[derive(Clone, Debug)]
pub(super) struct Evaluation {
    pub(super) candidate: Candidate,
    /// Squared residuals, those of the prior included.
    pub(super) cost: f64,
    /// Energy of the springs.
    pub(super) penalty: f64,
    /// Half the gradient of cost and penalty.
    pub(super) gradient: Vector5<f64>,
    /// Half their curvature, after Gauss.
    curvature: Matrix5<f64>,
    /// The same of the cost alone: the information that the data hold about the unknowns.
    pub(super) information: Matrix5<f64>,
    /// At the last value.
    pub(super) end: State,
    /// At the last value.
    pub(super) contact_end: ContactMode,
    /// At t = 0.
    pub(super) start: State,
    /// At t = 0.
    pub(super) contact_start: ContactMode,
    /// Derivatives of the state at the end by the unknowns.
    pub(super) end_by_start: Matrix4x5<f64>,
    /// The most that a constraint gave way: in [`CONSTRAINT_COMPLIANCE`].
    pub(super) overrun: f64,
}

impl Evaluation {
    /// What is lowered: squared residuals and penalties together.
    pub(super) fn total(&self) -> f64 {
        self.cost + self.penalty
    }
}

/// A candidate on its way down.
#[derive(Clone, Debug)]
pub(super) struct Descent {
    pub(super) evaluation: Evaluation,
    damping: f64,
    /// What the next step is predicted to lower the cost by.
    pub(super) predicted_reduction: f64,
    /// The total after the last step over that before it; 1 before the first.
    pub(super) last_ratio: f64,
    /// Steps in a row that lowered the cost by less than [`STALLED_SHARE`] of it.
    pub(super) stalled: usize,
}

/// Adds a residual that carries its derivatives.
#[inline]
fn add<const N: usize>(sums: &mut NormalEquations<N>, residual: Jet<N>) {
    sums.add(residual.value, SVector::from(residual.slopes));
}

/// Takes off what the mean of some residuals costs: they are right but for a number that is the same in all.
fn without_mean<const N: usize>(sums: &mut NormalEquations<N>, Common { count, sum }: Common<Jet<N>>) {
    if count <= 0.0 {
        return;
    }
    let slope = SVector::from(sum.slopes);
    sums.cost -= sum.value * sum.value / count;
    sums.gradient -= slope * (sum.value / count);
    sums.curvature -= slope * slope.transpose() / count;
}

fn add_past<const N: usize>(sums: &mut NormalEquations<N>, past: &Past, unknowns: &Unknowns, slots: Slots<N>) {
    let (cost, slope) = past.at(unknowns);
    sums.cost += cost;
    sums.gradient += SVector::<f64, N>::from_fn(|i, _| slope[slots.unknown(i)]);
    sums.curvature += SMatrix::<f64, N, N>::from_fn(|i, j| past.information[(slots.unknown(i), slots.unknown(j))]);
}

/// Residuals that share an unknown number: how many, and their sum.
#[derive(Clone, Copy)]
struct Common<T> {
    count: f64,
    sum: T,
}

impl<T: Scalar> Common<T> {
    fn none() -> Self {
        Self { count: 0.0, sum: T::from(0.0) }
    }

    fn add(&mut self, residual: T) {
        self.count += 1.0;
        self.sum = self.sum + residual;
    }
}

impl Past {
    /// Cost and half its gradient.
    fn at(&self, unknowns: &Unknowns) -> (f64, Vector5<f64>) {
        let off = Vector5::from(*unknowns) - self.best;
        let slope = self.information * off;
        (self.cost + off.dot(&slope), slope)
    }
}

impl<'a, 'p> Fitting<'a, 'p> {
    /// With steps of a fineness and starts from rest that leave out no more than `rest_error` rad.
    pub(super) fn new(
        Given { known, data, prior }: Given<'a, 'p>,
        fineness: Fineness,
        rest_error: f64,
        effort: &'a Effort<'a>,
    ) -> Self {
        let duration = data.duration();
        // The direction of the first move changes with the way gone, so angles err by its square.
        let rest_span =
            if known.starts_at_rest() { rest_span(known, rest_error.sqrt()).min(0.5 * duration) } else { 0.0 };
        let fineness = Fineness { on_values: data.angle.is_none(), ..fineness };
        let clock = Clock::new(ValueTimes { dt: data.dt, values: data.values }, rest_span, fineness, |time| {
            relaxation_time(known, &data, time)
        });
        Self { known, data, prior, clock, rest_span, constraint_stiffness: 1.0, held_unknown: None, effort }
    }

    /// The same with the place as it is.
    pub(super) fn holding_the_place(&self) -> Self {
        Self { held_unknown: Some(PLACE), ..self.clone() }
    }

    /// The same for the first so many values alone, with the same steps: what it costs is no more than what all cost.
    pub(super) fn of_first(&self, values: usize) -> Self {
        Self { data: self.data.first(values), clock: self.clock.first(values), ..self.clone() }
    }

    /// Whether the search shall go on: none where it should not, for `?`.
    pub(super) fn goes_on(&self) -> Option<()> {
        self.effort.halt().goes_on()
    }

    /// The range of each unknown.
    pub(super) fn bounds(&self, Candidate { interval, start_mode, .. }: &Candidate) -> [[f64; 2]; UNKNOWNS] {
        // Slip has a direction of its own; how fast it is follows from the bounds of the velocity, which are
        // constraints then.
        let slip_or = |start_mode: &StartMode, bounds| {
            if matches!(start_mode, StartMode::Slips(_)) { [0.0, f64::INFINITY] } else { bounds }
        };
        let free = [f64::NEG_INFINITY, f64::INFINITY];
        let unless = |sigma: Option<f64>, most: f64| if sigma.is_some() { free } else { [-most, most] };
        [
            self.data.u0_range.unwrap_or(free),
            [interval.low, interval.high],
            unless(self.prior.omega0_sigma, OMEGA0_MAX),
            slip_or(start_mode, unless(self.prior.v_t0_sigma, V_T0_MAX)),
            if self.mu_g_is_unknown() { [-MU_G_LOG_MAX, MU_G_LOG_MAX] } else { [0.0; 2] },
        ]
    }

    /// Whether the plane's friction is one of the unknowns.
    fn mu_g_is_unknown(&self) -> bool {
        self.prior.mu_g_log_sigma.is_some()
    }

    /// Whether a hypothesis has an unknown at all.
    pub(super) fn has(&self, start_mode: StartMode, unknown: usize) -> bool {
        if unknown == MU_G { self.mu_g_is_unknown() } else { unknown < start_mode.unknowns() }
    }

    /// What is known, if a candidate is right about the plane's friction.
    pub(super) fn known_by(&self, candidate: &Candidate) -> Known<'p> {
        Known { mu_g: self.known.mu_g * candidate.unknowns[MU_G].exp(), ..*self.known }
    }

    /// µ g where it is one of the unknowns, m/s², and the logarithm of what it is over what it is taken for.
    fn mu_g<T: Variable>(&self, candidate: &Candidate) -> Option<(T, T)> {
        let log = T::variable(candidate.unknowns[MU_G], candidate.start_mode.unknowns());
        let mu_g = self.known_by(candidate).mu_g;
        // d(µg) = µg d(ln µg).
        self.mu_g_is_unknown().then(|| ((log - log.re()) * mu_g + mu_g, log))
    }

    /// Terms of the prior, or values in its place, that a hypothesis has.
    pub(super) fn prior_terms(&self, Candidate { start_mode, past, .. }: &Candidate) -> usize {
        if let Some(past) = past {
            return past.terms;
        }
        let sigmas = [self.prior.omega0_sigma, self.prior.v_t0_sigma];
        sigmas.iter().take(start_mode.unknowns() - 2).chain([&self.prior.mu_g_log_sigma]).flatten().count()
    }

    pub(super) fn evaluate(&self, candidate: &Candidate) -> Option<Evaluation> {
        match candidate.start_mode.unknowns() + usize::from(self.mu_g_is_unknown()) {
            2 => self.evaluate_with::<2>(candidate),
            3 => self.evaluate_with::<3>(candidate),
            4 => self.evaluate_with::<4>(candidate),
            _ => self.evaluate_with::<5>(candidate),
        }
    }

    /// The cost alone, without derivatives.
    pub(super) fn cost(&self, candidate: &Candidate) -> Option<f64> {
        let Candidate { interval, start_mode, unknowns, past } = candidate;
        self.effort.simulate()?;
        // The start of the path that the unknowns name.
        let mu_g = self.mu_g::<f64>(candidate);
        let known = self.known_by(candidate);
        let start = StartGuess { start_mode: *start_mode, unknowns, mu_g: mu_g.map(|(mu_g, _)| mu_g) };
        let initial_state = initial_state(&known, interval, &start, self.rest_span)?;
        let (mut cost, mut common) = (0.0, Common::none());
        // Along the path: one residual a value. An unknown mass, an offset of all logarithms, is taken out: Σ(r − r̄)²
        // = Σr² − (Σr)²/n.
        let path = follow(&known, interval, &initial_state, &self.clock, self.effort.halt(), |value, seen| {
            self.residuals(value, &seen, &mut common, |residual: f64| cost += residual * residual);
        })?;
        cost -= common.sum * common.sum / common.count.max(1.0);
        // The prior, or what values said that are no longer kept.
        match past {
            Some(past) => cost += past.at(unknowns).0,
            None => {
                let log = mu_g.map(|(_, log)| log);
                self.prior_residuals(*start_mode, &initial_state.state, log, |residual: f64| {
                    cost += residual * residual;
                });
            }
        }
        // Penalties: how far the path left the limits of its contact.
        for residual in self
            .constraint_residuals(&path.constraint_margins)
            .into_iter()
            .chain([self.fast(*start_mode, &initial_state.state)])
        {
            cost += residual * residual;
        }
        Some(cost)
    }

    fn evaluate_with<const N: usize>(&self, candidate: &Candidate) -> Option<Evaluation> {
        let Candidate { interval, start_mode, unknowns, past } = candidate;
        self.effort.simulate()?;
        // The start of the path that the unknowns name, with derivatives by them.
        let mu_g = self.mu_g::<Jet<N>>(candidate);
        let slots = Slots::<N> { mu_g: mu_g.is_some() };
        let known = self.known_by(candidate);
        let start = StartGuess { start_mode: *start_mode, unknowns, mu_g: mu_g.map(|(mu_g, _)| mu_g) };
        let initial_state = initial_state(&known, interval, &start, self.rest_span)?;
        let (mut sums, mut common) = (NormalEquations::<N>::zero(), Common::none());
        // Residuals along the path, summed to Jᵀr and JᵀJ; an unknown offset of all logarithms is taken out.
        let path = follow(&known, interval, &initial_state, &self.clock, self.effort.halt(), |value, seen| {
            self.residuals(value, &seen, &mut common, |residual| add(&mut sums, residual));
        })?;
        without_mean(&mut sums, common);
        // The prior, or what values said that are no longer kept.
        match past {
            Some(past) => add_past(&mut sums, past, unknowns, slots),
            None => {
                let log = mu_g.map(|(_, log)| log);
                self.prior_residuals(*start_mode, &initial_state.state, log, |residual| add(&mut sums, residual));
            }
        }
        // Up to here the cost is statistics; what follows are penalties that hold the path within physics.
        let (cost, information) = (sums.cost, slots.widened(&sums.curvature));
        let [low, high, push, cone, slip] = self.constraint_residuals(&path.constraint_margins);
        let constraint_residuals = [low, high, push, cone, slip, self.fast(*start_mode, &initial_state.state)];
        constraint_residuals.iter().for_each(|residual| add(&mut sums, *residual));
        // The columns of unknowns that this start has not are zeros.
        let slopes = |value: &Jet<N>| slots.widened_row(&SVector::from(value.slopes));
        let evaluation = Evaluation {
            candidate: *candidate,
            cost,
            penalty: sums.cost - cost,
            gradient: slots.widened_row(&sums.gradient).transpose(),
            curvature: slots.widened(&sums.curvature),
            information,
            end: plain_state(&path.end),
            contact_end: plain_contact(&path.contact),
            start: self.start(candidate, plain_state(&initial_state.state)),
            contact_start: plain_contact(&initial_state.contact),
            end_by_start: Matrix4x5::from_rows(
                &[path.end.u, path.end.s, path.end.omega, path.end.v_t].map(|value| slopes(&value)),
            ),
            overrun: constraint_residuals.iter().map(|constraint| constraint.value.abs()).fold(0.0, f64::max)
                / self.constraint_stiffness,
        };
        evaluation.total().is_finite().then_some(evaluation)
    }

    /// The state at t = 0, whatever the path starts from.
    fn start(&self, candidate: &Candidate, started: State) -> State {
        let [u, s, ..] = candidate.unknowns;
        match candidate.start_mode {
            StartMode::Rest(_) => State { u, s, omega: 0.0, v_t: 0.0 },
            _ => started,
        }
    }

    fn residuals<T: Scalar>(&self, value: usize, seen: &Seen<T>, common: &mut Common<T>, mut add: impl FnMut(T)) {
        let Seen { u, normal_force, tangential_force } = *seen;
        let Data { angle, direction, log_magnitude, .. } = &self.data;
        if let Some(Channel { values, sigma }) = angle
            && values[value].is_finite()
        {
            add((u - values[value]) / *sigma);
        }
        if let Some(Channel { values, sigma }) = direction
            && values[value].is_finite()
        {
            let off = u - direction_of(normal_force, tangential_force) - values[value];
            // Whole turns do not count.
            add((off - (off.re() - wrap_angle(off.re()))) / *sigma);
        }
        if let Some(Channel { values, sigma }) = log_magnitude
            && values[value].is_finite()
        {
            let squared = normal_force * normal_force + tangential_force * tangential_force;
            let residual = (ln(squared) * 0.5 - values[value]) / *sigma;
            if self.data.mass_is_unknown {
                common.add(residual);
            }
            add(residual);
        }
    }

    fn prior_residuals<T: Variable>(
        &self,
        start_mode: StartMode,
        start: &State<T>,
        mu_g_log: Option<T>,
        mut add: impl FnMut(T),
    ) {
        let terms = [(self.prior.omega0_sigma, start.omega), (self.prior.v_t0_sigma, start.v_t)];
        for (sigma, value) in terms.into_iter().take(start_mode.unknowns() - 2) {
            if let Some(sigma) = sigma {
                add(value / sigma);
            }
        }
        if let (Some(sigma), Some(log)) = (self.prior.mu_g_log_sigma, mu_g_log) {
            add(log / sigma);
        }
    }

    /// The constraint at the greatest velocity along the contact, where the slip is the unknown.
    fn fast<T: Variable>(&self, start_mode: StartMode, start: &State<T>) -> T {
        let over = start.v_t.re().abs() - V_T0_MAX;
        if !matches!(start_mode, StartMode::Slips(_)) || self.prior.v_t0_sigma.is_some() || over <= 0.0 {
            return T::from(0.0);
        }
        (start.v_t - V_T0_MAX.copysign(start.v_t.re()))
            * (self.constraint_stiffness / CONSTRAINT_COMPLIANCE[CONSTRAINTS - 1])
    }

    fn constraint_residuals<T: Scalar>(&self, margins: &[T; CONSTRAINTS]) -> [T; CONSTRAINTS] {
        let force = self.known.mu_g + FORCE_FLOOR;
        let units = [1.0, 1.0, force, force, 1.0];
        std::array::from_fn(|constraint| {
            let scale = CONSTRAINT_COMPLIANCE[constraint] * units[constraint] / self.constraint_stiffness;
            if margins[constraint].re() < 0.0 { margins[constraint] / scale } else { T::from(0.0) }
        })
    }

    /// Begins a descent; none where the candidate leads to no motion.
    pub(super) fn descend(&self, mut candidate: Candidate) -> Option<Descent> {
        let bounds = self.bounds(&candidate);
        for (unknown, [low, high]) in candidate.unknowns.iter_mut().zip(bounds) {
            *unknown = unknown.clamp(low, high);
        }
        let evaluation = self.evaluate(&candidate)?;
        Some(Descent {
            predicted_reduction: self.predicted_reduction(&evaluation),
            evaluation,
            damping: DESCENT.damping.first,
            last_ratio: 1.0,
            stalled: 0,
        })
    }

    /// One step down. False if none helps.
    pub(super) fn improve(&self, descent: &mut Descent) -> bool {
        let lower = least_squares::lowered(self, &descent.evaluation, &DESCENT, &mut descent.damping);
        let Ok(evaluation) = lower else { return false };
        descent.predicted_reduction = self.predicted_reduction(&evaluation);
        descent.last_ratio = evaluation.total() / descent.evaluation.total();
        descent.stalled = if descent.last_ratio > 1.0 - STALLED_SHARE { descent.stalled + 1 } else { 0 };
        descent.evaluation = evaluation;
        true
    }

    /// Steps down until the next is predicted to bring less than `enough`, none helps, or there were so many.
    pub(super) fn improve_until(&self, descent: &mut Descent, enough: f64, steps_max: usize) {
        for _ in 0..steps_max {
            if descent.predicted_reduction < enough || !self.improve(descent) {
                break;
            }
        }
    }

    fn predicted_reduction(&self, evaluation: &Evaluation) -> f64 {
        least_squares::predicted_reduction(self, evaluation, &DESCENT)
    }

    /// Covariance of the unknowns, and what is left to their minimum, by the data and prior alone.
    pub(super) fn spread(&self, descent: &Descent) -> Option<(Matrix5<f64>, Vector5<f64>)> {
        let start_mode = descent.evaluation.candidate.start_mode;
        let (mut information, mut slope) = (descent.evaluation.information, descent.evaluation.gradient);
        for i in 0..UNKNOWNS {
            information[(i, i)] += CURVATURE_MIN[i];
            if !self.has(start_mode, i) {
                (information[(i, i)], slope[i]) = (1.0, 0.0);
            }
        }
        let mut covariance = information.cholesky()?.inverse();
        for i in (0..UNKNOWNS).filter(|i| !self.has(start_mode, *i)) {
            covariance[(i, i)] = 0.0;
        }
        Some((covariance, -(covariance * slope)))
    }

    /// Which unknowns are fitted: neither absent nor at a bound of the motion.
    pub(super) fn free(&self, descent: &Descent) -> [bool; UNKNOWNS] {
        let Evaluation { candidate, gradient, .. } = &descent.evaluation;
        let (held, start_mode) = (self.pressed(candidate, gradient), candidate.start_mode);
        // A place or angle at its limit is still uncertain by what the data say.
        std::array::from_fn(|i| self.has(start_mode, i) && (i < 2 || !held[i]))
    }
}

impl Fitting<'_, '_> {
    /// Which unknowns are at a bound that the cost presses them against, or not there at all.
    fn pressed(&self, candidate: &Candidate, gradient: &Vector5<f64>) -> [bool; UNKNOWNS] {
        let (bounds, unknowns) = (self.bounds(candidate), candidate.unknowns);
        std::array::from_fn(|i| {
            let [low, high] = bounds[i];
            let pressed = (unknowns[i] <= low && gradient[i] > 0.0) || (unknowns[i] >= high && gradient[i] < 0.0);
            !self.has(candidate.start_mode, i) || pressed || self.held_unknown == Some(i)
        })
    }
}

impl LeastSquaresProblem<UNKNOWNS> for Fitting<'_, '_> {
    type Place = Evaluation;

    fn cost(&self, evaluation: &Evaluation) -> f64 {
        evaluation.total()
    }

    fn normal_equations(&self, evaluation: &Evaluation) -> NormalEquations<UNKNOWNS> {
        let Evaluation { gradient, curvature, .. } = *evaluation;
        NormalEquations { cost: evaluation.total(), gradient, curvature }
    }

    fn moved(&self, evaluation: &Evaluation, step: &Vector5<f64>) -> Option<Evaluation> {
        let mut next = evaluation.candidate;
        for (i, [low, high]) in self.bounds(&next).into_iter().enumerate() {
            next.unknowns[i] = (next.unknowns[i] + step[i]).clamp(low, high);
        }
        self.evaluate(&next)
    }

    fn held(&self, evaluation: &Evaluation, equations: &NormalEquations<UNKNOWNS>) -> [bool; UNKNOWNS] {
        self.pressed(&evaluation.candidate, &equations.gradient)
    }

    /// No unknown by more than its longest step.
    fn limited(&self, step: Vector5<f64>) -> Vector5<f64> {
        let too_long = (0..UNKNOWNS).map(|i| step[i].abs() / STEP_MAX[i]).fold(1.0, f64::max);
        step / too_long
    }
}

/// Angle of a vector, rad.
fn direction_of<T: Scalar>(x: T, y: T) -> T {
    let (x_re, y_re) = (x.re(), y.re());
    let squared = x_re * x_re + y_re * y_re;
    // What is left of a number without its value are its derivatives.
    T::from(y_re.atan2(x_re)) + (y - y_re) * (x_re / squared) - (x - x_re) * (y_re / squared)
}

/// Natural logarithm of a number with derivatives.
fn ln<T: Scalar>(x: T) -> T {
    let value = x.re();
    (x - value) / value + value.ln()
}

/// Which of the unknowns the `N` are that derivatives are carried by: the first ones, and the plane's friction last if
/// it is one.
#[derive(Clone, Copy)]
struct Slots<const N: usize> {
    mu_g: bool,
}

impl<const N: usize> Slots<N> {
    fn unknown(self, slot: usize) -> usize {
        if self.mu_g && slot + 1 == N { MU_G } else { slot }
    }

    fn widened(self, matrix: &SMatrix<f64, N, N>) -> Matrix5<f64> {
        let mut wide = Matrix5::zeros();
        for i in 0..N {
            for j in 0..N {
                wide[(self.unknown(i), self.unknown(j))] = matrix[(i, j)];
            }
        }
        wide
    }

    fn widened_row(self, slopes: &SVector<f64, N>) -> RowVector5<f64> {
        let mut wide = RowVector5::zeros();
        for i in 0..N {
            wide[self.unknown(i)] = slopes[i];
        }
        wide
    }
}
