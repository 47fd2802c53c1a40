//! Which motion of the finger tells best apart the poses that are still possible.
//!
//! Straight pushes often leave several poses that predict the same contacts: edges of nearly equal height turn alike.
//! Another motion of the finger makes them differ. For each motion on offer every hypothesis is pushed ahead, with its
//! derivatives by the state that the data so far left uncertain, and each pair is compared:
//!
//! ```text
//! D² = rᵀ (σ² 1 + J_a P_a J_aᵀ + J_b P_b J_bᵀ)⁻¹ r     r: difference of the predicted angles
//! ```
//!
//! with P the covariance of a hypothesis's present state and J the derivatives of its prediction. A wrong choice
//! between the two then has the probability Q(D/2). A hypothesis by itself may leave open where on its edge the part is
//! touched: what its covariance becomes with the data to come says how far off that place still may be. The best motion
//! is the one with the least probability of naming the wrong hypothesis or a wrong place, bounded by the sum over all
//! pairs and all hypotheses. Pairs that no motion separates (a symmetric part) add the same to every motion, so they do
//! not hide what can be told.
//!
//! Assumes: predictions are linear in what is uncertain; one angle is felt, that of the contact or of the force; it is
//! compared as long as both hypotheses keep the contact, so losing it is never taken as evidence. Frames: world. Units:
//! SI, rad. Errors: none; a motion that a hypothesis does not survive counts as telling nothing.

use nalgebra::{DMatrix, DVector, Matrix4, Point2, Vector2, Vector4};

use super::hypotheses::Belief;
use crate::math::least_squares::{
    self, Damping, Enough, Floor, LeastSquaresProblem, LeastSquaresSettings, NormalEquations,
};
use crate::math::statistics::normal_tail;
use crate::pushing::dynamics::{EdgeEnd, Finger, Part, Push, PushModel, PushRun, Sample, Start, State};
use crate::pushing::finger_motion::Segment;
use crate::search::{Halt, Searched, Stop, never};

/// Distance D² of two hypotheses below which they count as ambiguous: a wrong choice in one case of 740.
pub const AMBIGUOUS_BELOW: f64 = 36.0;

/// Places on one edge that differ by less are one, m.
pub const ONE_PLACE_M: f64 = 2e-3;

/// How a hypothesis is fitted to what was felt: predictions are nearly linear in what is uncertain, so by Gauss's and
/// Newton's steps as long as they help. The prior bounds the curvature from below.
const FIT: LeastSquaresSettings<4> = LeastSquaresSettings {
    damping: Damping {
        first: 0.0,
        min: 0.0,
        max: 1e6,
        up: 10.0,
        // Half a step.
        min_after_failure: 1.0,
        down: 0.1,
        trusted_share: 0.0,
    },
    floor: Floor::NONE,
    enough: Enough { relative: 0.0, absolute: 0.0, damping_max: f64::INFINITY },
    trials_max: 5,
    steps_max: usize::MAX,
};

/// A step of the fit that is none, in standard deviations.
const FIT_STEP: f64 = 1e-2;

/// A hypothesis less probable than this after a motion is given up: D² is then some 28 above the best one's.
const PROBABILITY_MIN: f64 = 1e-6;

/// Share of a motion to one side and over to the other that the first side takes: the finger then ends as far over on
/// the other.
const OVER_AFTER: f64 = 1.0 / 3.0;

/// Steps of the central differences, in units of the state: far above rounding, far below what bends the prediction.
const DIFFERENCE_STEPS: [f64; 4] = [1e-5, 1e-6, 1e-4, 1e-5];

/// Which angle the finger senses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SensedAngle {
    /// Where it is touched.
    ContactAngle,
    /// The direction of the force, which is that of the contact only without friction.
    ForceDirection,
}

/// How it is sensed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// The angle that is compared.
    pub sensed: SensedAngle,
    /// Time between values, s.
    pub dt: f64,
    /// Standard deviation of one, rad.
    pub sigma: f64,
}

/// The push as it is now.
#[derive(Clone, Copy, Debug)]
pub struct Present<'p> {
    /// The part on its plane.
    pub part: &'p Part,
    /// µ g of the plane, m/s².
    pub mu_g: f64,
    /// Radius of the disk, m.
    pub radius: f64,
    /// Centre of the disk, world axes, m.
    pub centre: Point2<f64>,
    /// Velocity of the disk, world axes, m/s.
    pub velocity: Vector2<f64>,
}

/// A hypothesis, with the part that it is of.
#[derive(Clone, Copy, Debug)]
pub struct Rival<'p> {
    /// The push by it.
    pub present: Present<'p>,
    /// Where the part is then.
    pub belief: Belief,
}

/// A way for the finger to go on.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedMotion {
    /// What to call it.
    pub name: &'static str,
    /// Accelerations in world axes, one after the other.
    pub segments: Vec<Segment>,
}

/// What to expect of one motion.
#[derive(Clone, Debug, PartialEq)]
pub struct Prospect {
    /// How the finger would go on.
    pub motion: PlannedMotion,
    /// Bound of the probability of naming the wrong hypothesis, or a place more than half [`ONE_PLACE_M`] off,
    /// afterwards.
    pub risk: f64,
    /// D² of each pair of hypotheses, first index below second.
    pub pairs: Vec<Pair>,
    /// How long each hypothesis keeps the contact, s; the horizon at most.
    pub contact_s: Vec<f64>,
    /// Standard deviation of each hypothesis's place on its edge when its contact ends, m.
    pub place_sd: Vec<f64>,
}

/// How far two hypotheses come apart.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Their places in the list.
    pub hypotheses: [usize; 2],
    /// D², with respect to noise and what is uncertain of both.
    pub distance_squared: f64,
    /// How long both keep the contact, s.
    pub shared_s: f64,
}

impl Prospect {
    /// The pair that comes apart least; none if there are fewer than two hypotheses.
    #[must_use]
    pub fn nearest(&self) -> Option<&Pair> {
        self.pairs.iter().min_by(|a, b| a.distance_squared.total_cmp(&b.distance_squared))
    }

    /// Pairs that stay ambiguous.
    pub fn ambiguous(&self) -> impl Iterator<Item = &Pair> {
        self.pairs.iter().filter(|pair| pair.distance_squared < AMBIGUOUS_BELOW)
    }
}

impl PlannedMotion {
    /// One acceleration (m/s²) for some time (s).
    #[must_use]
    pub fn steady(name: &'static str, acceleration: Vector2<f64>, seconds: f64) -> Self {
        Self { name, segments: vec![Segment { seconds, acceleration }] }
    }

    /// The greatest speed (m/s) of a finger that does this from a velocity (m/s) on.
    #[must_use]
    pub fn top_speed(&self, velocity: Vector2<f64>) -> f64 {
        // Within a segment speed squared is a parabola that opens upwards: greatest at an end.
        let ends = self.segments.iter().scan(velocity, |velocity, segment| {
            *velocity += segment.acceleration * segment.seconds;
            Some(*velocity)
        });
        std::iter::once(velocity).chain(ends).map(|v| v.x.hypot(v.y)).fold(0.0, f64::max)
    }

    /// Whether the finger goes on as it does.
    #[must_use]
    pub fn is_straight(&self) -> bool {
        self.segments.iter().all(|segment| segment.acceleration == Vector2::zeros())
    }
}

/// The motions that a finger under way can be asked for within `seconds`: straight on, to either side, ahead and
/// between, and to one side and back over to the other.
///
/// `ahead` is where the finger goes, of any length above 0; `acceleration` is in m/s².
#[must_use]
pub fn motions(ahead: Vector2<f64>, acceleration: f64, seconds: f64) -> Vec<PlannedMotion> {
    let length = ahead.x.hypot(ahead.y);
    let ahead = ahead.map(|component| component / length * acceleration);
    let (left, right) = (Vector2::new(-ahead.y, ahead.x), Vector2::new(ahead.y, -ahead.x));
    let between = |side: Vector2<f64>| std::f64::consts::FRAC_1_SQRT_2 * (ahead + side);
    let over = |name, first: Vector2<f64>, then: Vector2<f64>| {
        let turn = OVER_AFTER * seconds;
        let segments = [(turn, first), (seconds - turn, then)];
        PlannedMotion {
            name,
            segments: segments.map(|(seconds, acceleration)| Segment { seconds, acceleration }).to_vec(),
        }
    };
    let steady = |name, acceleration| PlannedMotion::steady(name, acceleration, seconds);
    vec![
        steady("straight on", Vector2::zeros()),
        steady("to the left", left),
        steady("to the right", right),
        steady("faster ahead", ahead),
        steady("ahead and left", between(left)),
        steady("ahead and right", between(right)),
        over("left, then right", left, right),
        over("right, then left", right, left),
    ]
}

/// Pairs of hypotheses that stay ambiguous whatever the motion.
#[must_use]
pub fn inseparable(prospects: &[Prospect]) -> Vec<[usize; 2]> {
    let Some((first, others)) = prospects.split_first() else { return Vec::new() };
    let stays = |pair: &&Pair| others.iter().all(|other| other.ambiguous().any(|p| p.hypotheses == pair.hypotheses));
    first.ambiguous().filter(stays).map(|pair| pair.hypotheses).collect()
}

/// What each motion would tell, the best first.
#[must_use]
pub fn prospects(
    present: &Present<'_>,
    beliefs: &[Belief],
    motions: &[PlannedMotion],
    sampling: Sampling,
) -> Vec<Prospect> {
    prospects_until(present, beliefs, motions, sampling, &never).found
}

/// The same, ended when `stop` says so: then of the motions that were judged by then, in the order given.
#[must_use]
pub fn prospects_until(
    present: &Present<'_>,
    beliefs: &[Belief],
    motions: &[PlannedMotion],
    sampling: Sampling,
    stop: Stop<'_>,
) -> Searched<Vec<Prospect>> {
    let rivals: Vec<_> = beliefs.iter().map(|&belief| Rival { present: *present, belief }).collect();
    prospects_among_until(&rivals, motions, sampling, stop)
}

/// The same of hypotheses of several parts.
#[must_use]
pub fn prospects_among(rivals: &[Rival<'_>], motions: &[PlannedMotion], sampling: Sampling) -> Vec<Prospect> {
    prospects_among_until(rivals, motions, sampling, &never).found
}

fn prospects_among_until(
    rivals: &[Rival<'_>],
    motions: &[PlannedMotion],
    sampling: Sampling,
    stop: Stop<'_>,
) -> Searched<Vec<Prospect>> {
    let halt = Halt::new(stop);
    let prospect = |motion: &PlannedMotion| {
        let foreseen = |Rival { present, belief }: &Rival<'_>| {
            (!halt.is_wished()).then(|| Foreseen::of(&Ahead { present, belief, motion, sampling }))
        };
        let foreseen = rivals.iter().map(foreseen).collect::<Option<Vec<_>>>()?;
        let probabilities: Vec<_> = rivals.iter().map(|rival| rival.belief.probability).collect();
        Some(judge(motion, &probabilities, &foreseen, sampling))
    };
    let mut prospects: Vec<_> = motions.iter().map_while(prospect).collect();
    prospects.sort_by(|a, b| a.risk.total_cmp(&b.risk));
    halt.searched(prospects)
}

/// dt, 2 dt, … up to an instant, at least one.
fn times(dt: f64, until: f64) -> Vec<f64> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a count of samples, at least 1")]
    let count = (until / dt).round().max(1.0) as u32;
    (1..=count).map(|step| f64::from(step) * dt).collect()
}

/// A hypothesis and what the finger goes on to do.
struct Ahead<'a, 'p> {
    present: &'a Present<'p>,
    belief: &'a Belief,
    motion: &'a PlannedMotion,
    sampling: Sampling,
}

/// What is felt at an instant, and the state (u, s, ω, v_T) then; or the derivatives of both.
#[derive(Clone, Copy)]
struct Seen {
    angle: f64,
    state: Vector4<f64>,
}

impl Ahead<'_, '_> {
    /// What is felt if the motion starts from a state, as long as the contact lasts; nothing where such a push is
    /// impossible.
    fn seen(&self, state: State) -> Vec<Seen> {
        let mut all = Vec::new();
        let Present { radius, centre, velocity, .. } = *self.present;
        let (mut state, mut finger) =
            (state, Finger { radius, centre0: centre, velocity0: velocity, acceleration: Vector2::zeros() });
        for &Segment { seconds, acceleration } in &self.motion.segments {
            finger.acceleration = acceleration;
            let times = times(self.sampling.dt, seconds);
            let Some(run) = self.run(finger, state, &times) else { break };
            let seen = run.samples.iter().map_while(|sample| {
                Some(Seen { angle: angle(sample, self.sampling.sensed)?, state: vector(sample.state) })
            });
            let before = all.len();
            all.extend(seen);
            match run.samples.last() {
                Some(last) if all.len() - before == times.len() => {
                    (state, finger) = (last.state, after(&finger, last.t))
                }
                _ => break,
            }
        }
        all
    }

    fn run(&self, finger: Finger, state: State, times: &[f64]) -> Option<PushRun> {
        let Present { part, mu_g, .. } = *self.present;
        let model = PushModel { part, edge: part.edge(self.belief.edge).ok()?, mu_g, finger };
        let push = Push::new(model, self.belief.law, Start::Moving(state), EdgeEnd::Stop).ok()?;
        push.run(times).ok()
    }
}

/// What a hypothesis predicts, and how that depends on what is uncertain of it.
struct Foreseen {
    angles: Vec<f64>,
    /// J P^½ of the angles: one column a direction of uncertainty, scaled to one standard deviation.
    spread: DMatrix<f64>,
    /// The same of the last place on the edge.
    place: DVector<f64>,
}

impl Ahead<'_, '_> {
    /// What is felt from a state on, and its derivatives along four directions, as far as all of them keep the contact.
    fn sensitive(&self, state: State, directions: &Matrix4<f64>) -> (Vec<Seen>, [Vec<Seen>; 4]) {
        let mut nominal = self.seen(state);
        let mut columns = [0, 1, 2, 3].map(|index| {
            let direction = directions.column(index);
            if direction.norm() == 0.0 {
                return vec![Seen { angle: 0.0, state: Vector4::zeros() }; nominal.len()];
            }
            // One standard deviation along this direction may be far: a small step has the derivative.
            let step = step_along(&direction);
            let moved = |sign: f64| self.seen(shifted(state, &(direction * (sign * step))));
            slopes(&moved(1.0), &moved(-1.0), 2.0 * step)
        });
        let kept = columns.iter().map(Vec::len).chain([nominal.len()]).min().unwrap_or(0);
        nominal.truncate(kept);
        columns.iter_mut().for_each(|column| column.truncate(kept));
        (nominal, columns)
    }
}

impl Foreseen {
    fn of(ahead: &Ahead) -> Self {
        let root = root(&ahead.belief.covariance);
        let (nominal, columns) = ahead.sensitive(ahead.belief.state, &root);
        let spread = DMatrix::from_fn(nominal.len(), columns.len(), |row, column| columns[column][row].angle);
        // Where nothing is felt the place stays as it is.
        let place = |index: usize| columns[index].last().map_or(root[(1, index)], |seen| seen.state[1]);
        let place = DVector::from_fn(columns.len(), |index, _| place(index));
        Self { angles: nominal.iter().map(|seen| seen.angle).collect(), spread, place }
    }

    /// Standard deviation of the last place, m, with all angles felt (noise `sigma`).
    fn place_sd(&self, sigma: f64) -> f64 {
        let scaled = &self.spread / sigma;
        let inner = DMatrix::identity(scaled.ncols(), scaled.ncols()) + scaled.tr_mul(&scaled);
        inner.cholesky().map_or(f64::INFINITY, |inner| self.place.dot(&inner.solve(&self.place)).max(0.0).sqrt())
    }
}

impl Foreseen {
    /// Predictions that stand for all: with what is most uncertain at its mean and √3 standard deviations off, by
    /// Gauss's and Hermite's rule; with their weights.
    fn likely(&self) -> Vec<(f64, Vec<f64>)> {
        let main = (self.spread.nrows() > 0 && self.spread.ncols() > 0).then(|| {
            let eigen = self.spread.tr_mul(&self.spread).symmetric_eigen();
            &self.spread * eigen.eigenvectors.column(eigen.eigenvalues.imax())
        });
        let Some(main) = main else { return vec![(1.0, self.angles.clone())] };
        let off = |share: f64| self.angles.iter().zip(&main).map(|(angle, off)| angle + share * off).collect();
        let far = 3.0_f64.sqrt();
        vec![(2.0 / 3.0, off(0.0)), (1.0 / 6.0, off(far)), (1.0 / 6.0, off(-far))]
    }

    /// D² of felt angles from this: their distance in standard deviations of the noise and of what is uncertain.
    fn misfit(&self, angles: &[f64], sigma: f64) -> f64 {
        let shared = self.angles.len().min(angles.len());
        let difference = DVector::from_fn(shared, |row, _| (angles[row] - self.angles[row]) / sigma);
        unexplained(&difference, &(self.spread.rows(0, shared) / sigma))
    }
}

/// Where the hypotheses stand after a motion that was made, by what was felt of it (`sensed` at dt, 2 dt, …, not longer
/// than the motion): each moved to where it fits best, those that cannot explain it left out.
///
/// Every hypothesis is fitted by [`least_squares`], with its covariance before the motion as prior.
#[must_use]
pub fn updated(
    present: &Present<'_>,
    beliefs: &[Belief],
    motion: &PlannedMotion,
    sensed: &[f64],
    sampling: Sampling,
) -> Vec<Belief> {
    let fits = beliefs.iter().filter_map(|belief| Ahead { present, belief, motion, sampling }.fitted(sensed));
    let fits: Vec<_> = fits.collect();
    let best = fits.iter().map(|fit| fit.log_probability).fold(f64::NEG_INFINITY, f64::max);
    let sum: f64 = fits.iter().map(|fit| (fit.log_probability - best).exp()).sum();
    let named =
        fits.into_iter().map(|fit| Belief { probability: (fit.log_probability - best).exp() / sum, ..fit.belief });
    named.filter(|belief| belief.probability > PROBABILITY_MIN).collect()
}

/// A hypothesis after a motion.
struct Fitted {
    belief: Belief,
    log_probability: f64,
}

impl Ahead<'_, '_> {
    /// The hypothesis moved to where it and what was felt agree best; none if the contact would not have lasted.
    fn fitted(&self, sensed: &[f64]) -> Option<Fitted> {
        let updating = Updating { ahead: self, sensed, root: root(&self.belief.covariance) };
        let start = updating.linear(Vector4::zeros())?;
        let best = least_squares::minimise(&updating, start, &FIT, |_| false).place;
        let cholesky = best.equations.curvature.cholesky()?;
        let log_probability = self.belief.probability.ln() - 0.5 * (best.equations.cost + cholesky.ln_determinant());
        let covariance = best.end_along * cholesky.inverse() * best.end_along.transpose();
        Some(Fitted { belief: Belief { state: best.end, covariance, ..*self.belief }, log_probability })
    }
}

/// What was felt, and a hypothesis to be moved to it.
struct Updating<'a> {
    ahead: &'a Ahead<'a, 'a>,
    sensed: &'a [f64],
    /// Of the covariance before.
    root: Matrix4<f64>,
}

impl Updating<'_> {
    /// What was felt against what is predicted from a deviation on, linear near it.
    fn linear(&self, deviation: Vector4<f64>) -> Option<Linear> {
        let Self { ahead, sensed, root } = self;
        let sigma = ahead.sampling.sigma;
        let (seen, columns) = ahead.sensitive(shifted(ahead.belief.state, &(root * deviation)), root);
        let last = sensed.len().checked_sub(1)?;
        let end = seen.get(last)?.state;
        // The prior: each deviation is 0, give or take 1.
        let mut equations =
            NormalEquations { cost: deviation.norm_squared(), gradient: deviation, curvature: Matrix4::identity() };
        for (row, sensed) in sensed.iter().enumerate() {
            let slopes = Vector4::from_fn(|column, _| columns[column][row].angle / sigma);
            equations.add((seen[row].angle - sensed) / sigma, slopes);
        }
        Some(Linear {
            deviation,
            equations,
            end: State { u: end[0], s: end[1], omega: end[2], v_t: end[3] },
            end_along: Matrix4::from_fn(|row, column| columns[column][last].state[row]),
        })
    }
}

impl LeastSquaresProblem<4> for Updating<'_> {
    type Place = Linear;

    fn cost(&self, linear: &Linear) -> f64 {
        linear.equations.cost
    }

    fn normal_equations(&self, linear: &Linear) -> NormalEquations<4> {
        linear.equations
    }

    fn moved(&self, linear: &Linear, step: &Vector4<f64>) -> Option<Linear> {
        self.linear(linear.deviation + step)
    }

    fn is_minimum(&self, _: &Linear, equations: &NormalEquations<4>) -> bool {
        equations.gauss_newton_step().is_some_and(|step| step.norm() < FIT_STEP)
    }
}

/// A hypothesis moved by so much, and what a step of a fit needs.
struct Linear {
    /// In standard deviations of the belief, along its principal directions.
    deviation: Vector4<f64>,
    /// Of the angles and the prior.
    equations: NormalEquations<4>,
    end: State,
    /// Derivatives of the end.
    end_along: Matrix4<f64>,
}

/// A matrix whose columns are the principal directions of a covariance, one standard deviation long.
fn root(covariance: &Matrix4<f64>) -> Matrix4<f64> {
    // Units differ by orders of magnitude: scaled to unit variances first, so that none is lost to rounding.
    let scales = covariance.diagonal().map(|variance| variance.max(0.0).sqrt());
    let inverse = scales.map(|scale| if scale > 0.0 { 1.0 / scale } else { 0.0 });
    let scaled = Matrix4::from_diagonal(&inverse) * covariance * Matrix4::from_diagonal(&inverse);
    let eigen = scaled.symmetric_eigen();
    let lengths = eigen.eigenvalues.map(|value| value.max(0.0).sqrt());
    Matrix4::from_diagonal(&scales) * eigen.eigenvectors * Matrix4::from_diagonal(&lengths)
}

/// The share of a direction that moves no component by more than its [`DIFFERENCE_STEPS`].
fn step_along(direction: &nalgebra::VectorView4<'_, f64>) -> f64 {
    let shares = direction.iter().zip(DIFFERENCE_STEPS).map(|(&component, step)| step / component.abs());
    shares.fold(f64::INFINITY, f64::min).min(1.0)
}

fn shifted(state: State, by: &Vector4<f64>) -> State {
    State { u: state.u + by[0], s: state.s + by[1], omega: state.omega + by[2], v_t: state.v_t + by[3] }
}

/// The finger in time since `t`.
fn after(finger: &Finger, t: f64) -> Finger {
    Finger { centre0: finger.centre(t), velocity0: finger.velocity(t), ..*finger }
}

fn slopes(upper: &[Seen], lower: &[Seen], distance: f64) -> Vec<Seen> {
    let slope = |(upper, lower): (&Seen, &Seen)| Seen {
        angle: (upper.angle - lower.angle) / distance,
        state: (upper.state - lower.state) / distance,
    };
    upper.iter().zip(lower).map(slope).collect()
}

fn vector(state: State) -> Vector4<f64> {
    Vector4::new(state.u, state.s, state.omega, state.v_t)
}

/// World angle of the contact or of the force on the part, rad; none where the part jams.
fn angle(sample: &Sample, sensed: SensedAngle) -> Option<f64> {
    match sensed {
        SensedAngle::ContactAngle => Some(sample.state.u),
        // The tangential force is counted along the edge, clockwise about the disk.
        SensedAngle::ForceDirection => sample.force.map(|force| sample.state.u - force.tangential.atan2(force.normal)),
    }
}

fn judge(motion: &PlannedMotion, probabilities: &[f64], foreseen: &[Foreseen], sampling: Sampling) -> Prospect {
    let pair = |first: usize, second: usize| {
        let (distance_squared, shared) = distance_squared(&foreseen[first], &foreseen[second], sampling.sigma);
        Pair { hypotheses: [first, second], distance_squared, shared_s: span(shared, sampling) }
    };
    let count = foreseen.len();
    let pairs = (0..count).flat_map(|first| (first + 1..count).map(move |second| (first, second)));
    let pairs = pairs.map(|(first, second)| pair(first, second)).collect();
    let place_sd: Vec<_> = foreseen.iter().map(|foreseen| foreseen.place_sd(sampling.sigma)).collect();
    let risks = probabilities.iter().enumerate();
    let risk =
        risks.map(|(truth, probability)| probability * risk(foreseen, truth, place_sd[truth], sampling.sigma)).sum();
    let contact_s = foreseen.iter().map(|foreseen| span(foreseen.angles.len(), sampling)).collect();
    Prospect { motion: motion.clone(), risk, pairs, contact_s, place_sd }
}

/// Bound of the probability of naming anything else, or a wrong place, if one of the hypotheses is true.
fn risk(foreseen: &[Foreseen], truth: usize, place_sd: f64, sigma: f64) -> f64 {
    let misplaced = 2.0 * normal_tail(0.5 * ONE_PLACE_M / place_sd);
    let mistaken = |angles: &[f64]| {
        // How much worse than the truth a rival explains them: both have their share of what was uncertain before.
        let own = foreseen[truth].misfit(angles, sigma);
        let rivals = foreseen.iter().enumerate().filter(|(index, _)| *index != truth);
        let worse = rivals.map(|(_, rival)| (rival.misfit(angles, sigma) - own).max(0.0));
        let doubts: f64 = worse.map(|worse| normal_tail(0.5 * worse.sqrt())).sum();
        (misplaced + doubts).min(1.0)
    };
    foreseen[truth].likely().iter().map(|(weight, angles)| weight * mistaken(angles)).sum()
}

/// How long so many values take, s.
fn span(values: usize, sampling: Sampling) -> f64 {
    let values = values as f64;
    values * sampling.dt
}

/// D² of two predictions, and how many values they share.
fn distance_squared(a: &Foreseen, b: &Foreseen, sigma: f64) -> (f64, usize) {
    let shared = a.angles.len().min(b.angles.len());
    let difference = DVector::from_fn(shared, |row, _| (a.angles[row] - b.angles[row]) / sigma);
    let width = a.spread.ncols() + b.spread.ncols();
    let spread = DMatrix::from_fn(shared, width, |row, column| match column.checked_sub(a.spread.ncols()) {
        None => a.spread[(row, column)] / sigma,
        Some(column) => b.spread[(row, column)] / sigma,
    });
    (unexplained(&difference, &spread), shared)
}

/// The square of a difference weighed by (1 + S Sᵀ)⁻¹: what a spread S does not explain of it.
fn unexplained(difference: &DVector<f64>, spread: &DMatrix<f64>) -> f64 {
    // By Woodbury's identity: a matrix as small as what is uncertain, whatever the number of samples.
    let projected = spread.tr_mul(difference);
    let inner = DMatrix::identity(spread.ncols(), spread.ncols()) + spread.tr_mul(spread);
    let explained = inner.cholesky().map_or(0.0, |inner| projected.dot(&inner.solve(&projected)));
    (difference.norm_squared() - explained).max(0.0)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::pushing::dynamics::ContactLaw;
    use crate::search::check_stopping;

    /// One value at 100 Hz of a sensor with 0.5° at 2 kHz, rad.
    const SAMPLING: Sampling = Sampling { sensed: SensedAngle::ContactAngle, dt: 0.01, sigma: 0.001_95 };
    const SPEED: f64 = 0.05; // m/s
    const LATERAL: f64 = 0.08; // m/s²

    fn rectangle(width: f64, height: f64) -> Part {
        let (x, y) = (0.5 * width, 0.5 * height);
        Part::uniform(SimplePolygon::new([[-x, -y], [x, -y], [x, y], [-x, y]].map(Point2::from)).unwrap())
    }

    /// A disk that moves up into whatever it touches.
    fn present(part: &Part) -> Present<'_> {
        Present { part, mu_g: 0.3 * 9.81, radius: 0.01, centre: Point2::origin(), velocity: Vector2::new(0.0, SPEED) }
    }

    /// Touched straight ahead, off the foot by `s`, moving along with the finger.
    fn belief(edge: usize, s: f64, s_sd: f64) -> Belief {
        let mut covariance = Matrix4::zeros();
        covariance[(1, 1)] = s_sd * s_sd;
        let state = State { u: std::f64::consts::FRAC_PI_2, s, omega: 0.0, v_t: 0.0 };
        let law = ContactLaw::Rolling { friction: None };
        Belief { edge, law, state, covariance, probability: 0.5 }
    }

    fn straight() -> PlannedMotion {
        PlannedMotion::steady("straight on", Vector2::zeros(), 0.5)
    }

    #[test]
    fn nothing_separates_edges_that_are_alike() {
        let part = rectangle(0.06, 0.04);
        let beliefs = [belief(0, 0.005, 1e-4), belief(2, 0.005, 1e-4)];
        let all = prospects(&present(&part), &beliefs, &motions(Vector2::new(0.0, SPEED), LATERAL, 0.5), SAMPLING);
        for prospect in &all {
            let pair = prospect.nearest().unwrap();
            assert!(pair.distance_squared < 1e-6, "{pair:?}");
            assert!((prospect.risk - 0.5).abs() < 1e-3, "{}", prospect.risk);
        }
        assert_eq!(inseparable(&all), [[0, 1]]);
    }

    #[test]
    fn a_push_aside_separates_what_a_straight_one_does_not() {
        // Pushed through the centre of mass a straight push turns neither edge: only the height of the edge differs.
        let part = rectangle(0.06, 0.03);
        let beliefs = [belief(0, 0.0, 0.0), belief(1, 0.0, 0.0)];
        let all = prospects(&present(&part), &beliefs, &motions(Vector2::new(0.0, SPEED), LATERAL, 0.5), SAMPLING);
        let straight = all.iter().find(|prospect| prospect.motion.is_straight()).unwrap();
        assert!(straight.nearest().unwrap().distance_squared < 1e-6);
        assert!(!all[0].motion.is_straight() && all[0].ambiguous().count() == 0, "{:?}", all[0]);
        assert!(all.windows(2).all(|pair| pair[0].risk <= pair[1].risk));
        assert!(inseparable(&all).is_empty());
        // A push through the centre of mass keeps the contact for as long as it is asked to.
        assert!(straight.contact_s.iter().all(|seconds| (seconds - 0.5).abs() < 1e-9), "{:?}", straight.contact_s);
    }

    #[test]
    fn without_tangential_force_the_force_points_along_the_contact() {
        // Straight through the centre of mass nothing pulls along the edge; aside, friction has to.
        let part = rectangle(0.06, 0.03);
        let (present, belief) = (present(&part), belief(0, 0.0, 0.0));
        let angles = |acceleration, sensed| {
            let sampling = Sampling { sensed, dt: 0.1, ..SAMPLING };
            let motion = &PlannedMotion::steady("", acceleration, 0.2);
            let seen = Ahead { present: &present, belief: &belief, motion, sampling }.seen(belief.state);
            assert_eq!(seen.len(), 2);
            seen.iter().map(|seen| seen.angle).collect::<Vec<_>>()
        };
        let straight =
            [SensedAngle::ContactAngle, SensedAngle::ForceDirection].map(|sensed| angles(Vector2::zeros(), sensed));
        assert!(straight[0].iter().zip(&straight[1]).all(|(contact, force)| (contact - force).abs() < 1e-9));
        // The finger drags the part to +x: the force on the part turns from straight up towards +x.
        let aside = angles(Vector2::new(LATERAL, 0.0), SensedAngle::ForceDirection);
        let contact = angles(Vector2::new(LATERAL, 0.0), SensedAngle::ContactAngle);
        assert!(aside.iter().zip(&contact).all(|(force, contact)| force < contact), "{aside:?} {contact:?}");
    }

    #[test]
    fn the_top_speed_is_at_the_beginning_or_an_end() {
        let aside = PlannedMotion::steady("", Vector2::new(0.0, 0.24), 0.5);
        assert!((aside.top_speed(Vector2::new(0.05, 0.0)) - 0.13).abs() < 1e-12);
        assert!(
            (PlannedMotion::steady("", Vector2::new(-0.1, 0.0), 0.5).top_speed(Vector2::new(0.05, 0.0)) - 0.05).abs()
                < 1e-12
        );
        let back = PlannedMotion {
            segments: [0.24, -0.24].map(|y| Segment { seconds: 0.5, acceleration: Vector2::new(0.0, y) }).to_vec(),
            ..aside
        };
        assert!((back.top_speed(Vector2::new(0.05, 0.0)) - 0.13).abs() < 1e-12);
    }

    #[test]
    fn what_the_uncertainty_explains_is_no_evidence() {
        // Two places of one edge, a millimetre apart: told apart if known well, and not if either could be the other.
        let part = rectangle(0.06, 0.04);
        let distance = |s_sd: f64| {
            let beliefs = [belief(0, 0.004, s_sd), belief(0, 0.005, s_sd)];
            prospects(&present(&part), &beliefs, &[straight()], SAMPLING)[0].nearest().unwrap().distance_squared
        };
        let (known, vague) = (distance(0.0), distance(1e-3));
        assert!(known > 100.0, "{known}");
        // The difference is a millimetre, the standard deviation of it √2 mm: D² tends to 1/2 as the noise vanishes.
        assert!((vague - 0.5).abs() < 0.02, "{vague}");
    }

    /// Angles that a truth leads to decide between hypotheses, and move the right one onto the truth.
    #[test]
    fn what_was_felt_moves_the_right_hypothesis_and_drops_the_wrong_one() {
        let part = rectangle(0.06, 0.03);
        let beliefs = [belief(0, 0.004, 1e-3), belief(1, 0.004, 1e-3)];
        let present = present(&part);
        let motion = &motions(Vector2::new(0.0, SPEED), LATERAL, 0.3)[7];
        let truth = Belief { state: State { s: 0.0049, ..beliefs[0].state }, ..beliefs[0] };
        let seen = Ahead { present: &present, belief: &truth, motion, sampling: SAMPLING }.seen(truth.state);
        let sensed: Vec<_> = seen.iter().map(|seen| seen.angle).collect();
        let after = updated(&present, &beliefs, motion, &sensed, SAMPLING);
        assert_eq!(after.len(), 1, "{after:?}");
        let (left, end) = (&after[0], seen[seen.len() - 1].state);
        let s_sd = left.covariance[(1, 1)].sqrt();
        assert!(left.edge == 0 && (left.probability - 1.0).abs() < 1e-9);
        // The prior draws the place by a small part of what is left uncertain.
        assert!((left.state.s - end[1]).abs() < s_sd && s_sd < 2e-4, "{left:?} {end}");
        assert!((left.state.u - end[0]).abs() < SAMPLING.sigma);
        // Nothing felt would be another motion; longer than the contact, none explains it.
        assert!(updated(&present, &beliefs, motion, &[sensed.clone(), sensed].concat(), SAMPLING).is_empty());
    }

    #[test]
    fn a_place_that_stays_open_is_a_risk() {
        // Beyond the edge's end nothing is felt, and the place stays as uncertain as it was.
        let part = rectangle(0.06, 0.03);
        let told = |s_sd: f64| prospects(&present(&part), &[belief(1, 0.5, s_sd)], &[straight()], SAMPLING).remove(0);
        for s_sd in [1e-4, 1e-3, 1e-2] {
            let prospect = told(s_sd);
            assert!((prospect.place_sd[0] / s_sd - 1.0).abs() < 1e-9, "{prospect:?}");
            // A millimetre off to either side; the hypothesis itself has the probability ½.
            assert!((prospect.risk - 0.5 * 2.0 * normal_tail(1e-3 / s_sd)).abs() < 1e-9, "{prospect:?}");
        }
    }

    #[test]
    fn correlated_uncertainty_keeps_its_directions() {
        let deviations = [1e-3, 1e-4, 0.05, 0.01];
        let factor = Matrix4::from_fn(|row, column| {
            let entry = if column <= row { 1.0 / f64::from(u32::try_from(1 + row - column).unwrap()) } else { 0.0 };
            deviations[row] * entry
        });
        let covariance = factor * factor.transpose();
        let root = root(&covariance);
        let again = root * root.transpose();
        let relative = |row: usize, column: usize| {
            (again[(row, column)] - covariance[(row, column)])
                / (covariance[(row, row)] * covariance[(column, column)]).sqrt()
        };
        assert!((0..16).all(|index| relative(index / 4, index % 4).abs() < 1e-12));
    }

    #[test]
    fn looking_ahead_can_be_stopped_between_hypotheses() {
        let part = rectangle(0.06, 0.04);
        let beliefs = [belief(0, 0.005, 1e-4), belief(1, 0.005, 1e-4)];
        let offered = motions(Vector2::new(0.0, SPEED), LATERAL, 0.2);
        check_stopping(|stop| prospects_until(&present(&part), &beliefs, &offered, SAMPLING, stop));
        // Two motions were judged when it was asked for the fifth time.
        let asked = AtomicUsize::new(0);
        let stop = || asked.fetch_add(1, Relaxed) == 4;
        let stopped = prospects_until(&present(&part), &beliefs, &offered, SAMPLING, &stop);
        assert_eq!((asked.load(Relaxed), stopped.found.len(), stopped.complete), (5, 2, false));
    }

    #[test]
    fn a_hypothesis_that_cannot_be_pushed_tells_nothing() {
        let part = rectangle(0.06, 0.04);
        let beliefs = [belief(0, 0.005, 1e-4), belief(1, 0.5, 1e-4)]; // far beyond the edge
        let prospect = &prospects(&present(&part), &beliefs, &[straight()], SAMPLING)[0];
        assert_eq!(prospect.pairs[0].distance_squared.to_bits(), 0.0_f64.to_bits());
        assert!((prospect.risk - 0.5).abs() < 1e-9);
    }
}
