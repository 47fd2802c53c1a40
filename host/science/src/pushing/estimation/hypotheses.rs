//! What an observer of a pushed part answers: the set of all that the data cannot exclude. Plain data.
//!
//! Every observer here answers in this form, so that whatever judges, shows, plans on or compares answers is written
//! once.
//!
//! Frames: that of the finger's motion, called world. Units: SI. Errors: none; an empty set is an answer.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix2x3, Matrix3, Matrix4, Point2, Rotation2, Vector2, Vector3, Vector4};

use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::pushing::dynamics::{ContactLaw, ContactMode, Part, PushModel, State};
use crate::search::{Searched, Stop, never};

/// Costs up to this above the best belong to the set: four standard deviations. Fixed by the interface.
pub const GATE: f64 = 16.0;

/// Minima on one edge whose ends are nearer than this are one, m. Fixed by the interface.
pub const SAME_END_M: f64 = 5e-4;

/// Ends so near each other that two explanations on one edge are one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearness {
    /// Of the places on the edge, m.
    pub place: f64,
    /// Of the contact angles, rad.
    pub angle: f64,
}

impl Nearness {
    /// Where the contact angle is felt or follows from what is: the place decides. Fixed by the interface.
    pub const BY_PLACE: Self = Self { place: SAME_END_M, angle: f64::INFINITY };

    /// Whether two contacts (angle, rad, and place, m) on one edge are so near.
    pub(super) fn holds(self, [u, s]: [f64; 2], [other_u, other_s]: [f64; 2]) -> bool {
        (s - other_s).abs() < self.place && (u - other_u).abs() < self.angle
    }
}

/// An observer of a pushed part: one observation in, one set of hypotheses out.
///
/// What is known beforehand (the part, the friction, the finger's motion) is in the observer; what was felt is the
/// observation.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::*;
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let known = Known { part: &part, mu_g: 0.3 * GRAVITY_ASSUMED, finger, touch: Touch::Rolling { friction: None } };
/// let measured = Measured::ContactAngle(Channel { values: vec![1.6, 1.605, 1.62, 1.64, 1.67], sigma: 2e-3 }); // rad
/// let observation = Observation { dt: 0.05, measured, prior: Prior::default() };
///
/// /// Whatever the observer, whatever it takes in.
/// fn edges<O: Observer>(observer: &O, observation: &O::Observation) -> Vec<usize> {
///     observer.estimate(observation).hypotheses.iter().map(|hypothesis| hypothesis.edge).collect()
/// }
/// assert!(!edges(&known, &observation).is_empty());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub trait Observer {
    /// What was felt, in the form in which this observer takes it.
    type Observation: ?Sized;

    /// Everything that the observation cannot exclude.
    fn estimate(&self, observation: &Self::Observation) -> Estimate {
        self.estimate_until(observation, &never).found
    }

    /// The same, ended when `stop` says so: then hypotheses may be missing, and the best one with them.
    fn estimate_until(&self, observation: &Self::Observation, stop: Stop<'_>) -> Searched<Estimate>;
}

/// What an observation says.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::{Channel, Finger, Known, Measured, Observation, Observer, Part, Prior, SimplePolygon, Touch};
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let known = Known { part: &part, mu_g: 0.3 * 9.81, finger, touch: Touch::Rolling { friction: None } };
/// let values = vec![1.6, 1.605, 1.62, 1.64, 1.67]; // rad
/// let measured = Measured::ContactAngle(Channel { values, sigma: 2e-3 });
/// let estimate = known.estimate(&Observation { dt: 0.05, measured, prior: Prior::default() });
/// let sum: f64 = estimate.hypotheses.iter().map(|hypothesis| hypothesis.probability).sum();
/// assert!((sum - 1.0).abs() < 1e-9 && (estimate.time_end - 0.2).abs() < 1e-12); // s
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// Everything that the data cannot exclude, most probable first; empty if they exclude all.
    pub hypotheses: Vec<Hypothesis>,
    /// Whether what is not listed is excluded; otherwise a single hypothesis is not certain.
    pub can_exclude_others: bool,
    /// How well the best one fits.
    pub fit: Fit,
    /// How many turns take the part to itself, where each hypothesis stands for as many poses; 1 where every pose is
    /// listed.
    pub symmetry: usize,
    /// Up to when data were used, s.
    pub time_end: f64,
    /// Standard deviation of ln(µ g) beforehand, where the friction of the plane was not known.
    pub mu_g_log_sd: Option<f64>,
    /// Values that no smooth motion passes through, by their place; left out where nothing explains the data with them.
    pub outliers: Vec<usize>,
    /// Forward simulations that it took, those with derivatives included; 0 where they were not counted.
    pub simulations: usize,
}

/// How well the best hypothesis fits the data.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Fit {
    /// The least cost of anything that is physically possible, even if it is too large; none where nothing is.
    pub cost: Option<f64>,
    /// Data and prior terms less fitted parameters.
    pub degrees_of_freedom: usize,
    /// Above this cost nothing explains the data: the 99.9 % quantile of chi-square.
    pub cost_max: f64,
}

/// What kind of answer a set of hypotheses is.
///
/// ```
/// use palpate::Status;
///
/// let told = |status| match status {
///     Status::Unique => "move the robot",
///     Status::Ambiguous => "push again, aside",
///     Status::Unexplained => "is it this part?",
/// };
/// assert_eq!(told(Status::Ambiguous), "push again, aside");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Status {
    /// One hypothesis explains the data, and no other does.
    Unique,
    /// Several hypotheses explain the data, or one does and others cannot be excluded.
    Ambiguous,
    /// Nothing explains the data.
    Unexplained,
}

impl Status {
    /// Of so many hypotheses.
    #[must_use]
    pub fn of(hypotheses: usize, can_exclude_others: bool) -> Self {
        match hypotheses {
            0 => Self::Unexplained,
            1 if can_exclude_others => Self::Unique,
            _ => Self::Ambiguous,
        }
    }
}

/// One explanation of the data: a local minimum of the cost.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::*;
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let known = Known { part: &part, mu_g: 0.3 * GRAVITY_ASSUMED, finger, touch: Touch::Rolling { friction: None } };
/// let measured = Measured::ContactAngle(Channel { values: vec![1.6, 1.605, 1.62, 1.64, 1.67], sigma: 2e-3 }); // rad
/// let observation = Observation { dt: 0.05, measured, prior: Prior::default() };
///
/// let estimate = known.estimate(&observation);
/// let best = &estimate.hypotheses[0];
/// let (distance_sd, angle_sd) = best.spread(&part).ok_or("the place is open")?; // m, rad
/// assert!(distance_sd > 0.0 && angle_sd > 0.0 && best.cost <= estimate.fit.cost_max);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Hypothesis {
    /// The edge that holds the contact at the last value; 0 on an ellipse, which has no others.
    pub edge: usize,
    /// The straight side that it is on, by its first edge ([`Part::side`]): the same for every edge of one side.
    pub side: usize,
    /// At the first value.
    pub start: State,
    /// What the contact does then.
    pub contact_start: ContactMode,
    /// At the last value.
    pub end: State,
    /// What the contact does then.
    pub contact_end: ContactMode,
    /// By which law the contact goes on, as far as it is known now.
    pub law: ContactLaw,
    /// The part at the first value.
    pub pose_start: Pose,
    /// The part at the last value.
    pub pose_end: Pose,
    /// Velocity of the centre of mass at the last value, m/s.
    pub velocity_end: Vector2<f64>,
    /// Of `pose_end` (x, y, theta); none where the data leave the pose free, or the observer gives none.
    pub covariance: Option<Matrix3<f64>>,
    /// Of `end`: u, s, ω, v_T; none where `covariance` is none. In rolling, v_T follows from the others.
    pub state_covariance: Option<Matrix4<f64>>,
    /// µ g, m/s²: as known, or as found where it was not.
    pub mu_g: f64,
    /// Standard deviation of ln(µg), 0 where that is known; none where `covariance` is none.
    pub mu_g_log_sd: Option<f64>,
    /// What only the force's size and direction tell; none where they were not felt.
    pub from_force: Option<FromForce>,
    /// Squared residuals in standard deviations, prior terms included.
    pub cost: f64,
    /// Among the hypotheses, by Laplace's approximation; before the push every place of the perimeter is as likely.
    pub probability: f64,
}

/// What only the force on the finger tells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FromForce {
    /// The part's mass, kg (or relative, as the force).
    pub mass: f64,
    /// Standard deviation of its logarithm.
    pub mass_log_sd: f64,
    /// Standard deviation of ln(µ m g), the force that the plane can resist with.
    pub resistance_log_sd: f64,
    /// µ_c, if the contact slipped; otherwise it is `friction_needed` or more.
    pub mu_c: Option<f64>,
    /// Its standard deviation, where it is told.
    pub mu_c_sd: Option<f64>,
    /// Friction that rolling took, at the least: three standard deviations below the best fit's.
    pub friction_needed: f64,
}

/// A pose and motion that is still possible: what a motion planner starts from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Belief {
    /// The edge in contact.
    pub edge: usize,
    /// How finger and part touch.
    pub law: ContactLaw,
    /// Where it is and how it moves.
    pub state: State,
    /// Of u, s, ω, v_T; a row of zeros for what is known or follows from the others.
    pub covariance: Matrix4<f64>,
    /// Between 0 and 1.
    pub probability: f64,
}

/// The plane's friction counts as found if its standard deviation is less than this share of what it was beforehand.
const FOUND_SHARE: f64 = 0.9;

/// Mass and friction of the plane are known together where their product's standard deviation is less than this share
/// of each one's.
const TOGETHER_SHARE: f64 = 0.5;

impl Estimate {
    /// An answer without hypotheses.
    #[must_use]
    pub fn unexplained(fit: Fit, time_end: f64) -> Self {
        Self {
            hypotheses: Vec::new(),
            can_exclude_others: true,
            fit,
            symmetry: 1,
            time_end,
            mu_g_log_sd: None,
            outliers: Vec::new(),
            simulations: 0,
        }
    }

    /// What kind of answer it is.
    #[must_use]
    pub fn status(&self) -> Status {
        Status::of(self.hypotheses.len(), self.can_exclude_others)
    }

    /// Whether the force tells µ m g but neither µ nor m, beyond what was known beforehand.
    #[must_use]
    pub fn mass_and_friction_are_one(&self) -> bool {
        let Some(beforehand) = self.mu_g_log_sd else { return false };
        let best = self.hypotheses.first();
        best.and_then(|best| best.from_force.zip(best.mu_g_log_sd)).is_some_and(|(force, mu_g_log_sd)| {
            mu_g_log_sd > FOUND_SHARE * beforehand && force.resistance_log_sd < TOGETHER_SHARE * force.mass_log_sd
        })
    }
}

/// Covariance of the centre of mass (world axes, m²) by that of a pose's x, y, theta.
#[must_use]
pub fn centre_covariance(part: &Part, pose: &Pose, covariance: &Matrix3<f64>) -> Matrix2<f64> {
    let arm = pose.isometry().rotation * part.centre_of_mass().coords;
    let to_centre = Matrix2x3::new(1.0, 0.0, -arm.y, 0.0, 1.0, arm.x);
    to_centre * covariance * to_centre.transpose()
}

/// Standard deviations of a pose by the covariance of its x, y, theta: of the centre of mass (m, both directions together)
/// and of the angle (rad).
pub(super) fn spread(part: &Part, pose: &Pose, covariance: &Matrix3<f64>) -> (f64, f64) {
    let centre = centre_covariance(part, pose, covariance);
    (centre.trace().max(0.0).sqrt(), covariance[(2, 2)].max(0.0).sqrt())
}

impl Hypothesis {
    /// What a motion planner starts from, where the pose is known at all: the same at the last value's time.
    #[must_use]
    pub fn belief(&self) -> Option<Belief> {
        let Self { edge, law, end: state, probability, .. } = *self;
        Some(Belief { edge, law, state, covariance: self.state_covariance?, probability })
    }

    /// Standard deviations at the end: of the centre of mass (m, both directions together) and of the angle (rad). None
    /// where the pose has none.
    #[must_use]
    pub fn spread(&self, part: &Part) -> Option<(f64, f64)> {
        Some(spread(part, &self.pose_end, &self.covariance?))
    }

    /// Whether it ends as near to another as that, on the same side.
    fn is_near(&self, other: &Self, near: Nearness) -> bool {
        other.side == self.side && near.holds([self.end.u, self.end.s], [other.end.u, other.end.s])
    }

    /// How far it is from another of the same side: see [`apart_squared`].
    fn apart(&self, other: &Self) -> Option<f64> {
        let covariances = self.covariance.as_ref().zip(other.covariance.as_ref()).filter(|_| self.side == other.side);
        covariances.and_then(|(own, others)| apart_squared((&self.pose_end, own), (&other.pose_end, others)))
    }

    /// The likeliest of a valley, covering all of it.
    fn of_valley(mut valley: Vec<Self>) -> Option<Self> {
        valley.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        valley.into_iter().reduce(|mut best, other| {
            best.take_in(&other);
            best
        })
    }

    /// Covers another explanation too: the mean squares of the errors of its own pose if either may be true.
    pub(super) fn take_in(&mut self, other: &Self) {
        let both = self.probability + other.probability;
        let share = if both > 0.0 { other.probability / both } else { 0.0 };
        let of_pose = other.pose_end.minus(&self.pose_end);
        let of_state = Vector4::new(
            other.end.u - self.end.u,
            other.end.s - self.end.s,
            other.end.omega - self.end.omega,
            other.end.v_t - self.end.v_t,
        );
        self.covariance = self
            .covariance
            .zip(other.covariance)
            .map(|(own, other)| own * (1.0 - share) + (other + of_pose * of_pose.transpose()) * share);
        self.state_covariance = self
            .state_covariance
            .zip(other.state_covariance)
            .map(|(own, other)| own * (1.0 - share) + (other + of_state * of_state.transpose()) * share);
        let of_mu_g = (other.mu_g / self.mu_g).ln();
        self.mu_g_log_sd =
            self.mu_g_log_sd.zip(other.mu_g_log_sd).map(|(own, other)| of_both(share, own, other, of_mu_g));
        if let Some((own, other)) = self.from_force.as_mut().zip(other.from_force) {
            own.take_in(&other, share, of_mu_g);
        }
        self.probability = both;
    }
}

/// Standard deviation about the first of two of which either may be true, the other with this share, and so far from it.
fn of_both(share: f64, sd: f64, other_sd: f64, off: f64) -> f64 {
    ((1.0 - share) * sd * sd + share * (other_sd * other_sd + off * off)).sqrt()
}

impl FromForce {
    /// Covers another explanation too, as likely as its share, ln(µ g) being so much larger in it.
    fn take_in(&mut self, other: &Self, share: f64, of_mu_g: f64) {
        let of_mass = (other.mass / self.mass).ln();
        self.mass_log_sd = of_both(share, self.mass_log_sd, other.mass_log_sd, of_mass);
        self.resistance_log_sd = of_both(share, self.resistance_log_sd, other.resistance_log_sd, of_mass + of_mu_g);
        if let (Some(own), Some(others)) = (self.mu_c.zip(self.mu_c_sd), other.mu_c.zip(other.mu_c_sd)) {
            self.mu_c_sd = Some(of_both(share, own.1, others.1, others.0 - own.0));
        }
        self.friction_needed = self.friction_needed.min(other.friction_needed);
    }
}

/// Hypotheses that are one answer, being on one side with ends near each other, are joined: each covers all that it
/// stands for.
pub(super) fn joined(hypotheses: impl IntoIterator<Item = Hypothesis>, near: Nearness) -> Vec<Hypothesis> {
    let mut kept: Vec<Hypothesis> = Vec::new();
    for next in hypotheses {
        match kept.iter_mut().find(|other| other.is_near(&next, near)) {
            Some(other) => other.take_in(&next),
            None => kept.push(next),
        }
    }
    kept
}

/// Ends so near each other, or so uncertain, that nobody can tell them apart are one valley's: the likeliest stands for all
/// that hang together, and covers them.
pub(super) fn of_valleys(hypotheses: Vec<Hypothesis>, near: Nearness) -> Vec<Hypothesis> {
    let is_near = |one: &Hypothesis, other: &Hypothesis| one.is_near(other, near);
    let valleys = valleys(hypotheses, Hypothesis::apart, is_near, |of| &mut of.probability).into_iter();
    let mut stand_for: Vec<_> = valleys.filter_map(Hypothesis::of_valley).collect();
    normalise(&mut stand_for, 0.0, |of| &mut of.probability);
    stand_for
}

/// Lets probabilities add up to 1. Where the logarithm of each is known with such a deviation only, they are what is then expected
/// of them: moderated (D. J. C. MacKay, "The Evidence Framework Applied to Classification Networks", Neural Computation 4, 1992).
pub(super) fn normalise<T>(all: &mut [T], log_sd: f64, probability: impl Fn(&mut T) -> &mut f64) {
    let variance_of_log_odds = 2.0 * log_sd.powi(2);
    let moderation = 1.0 / (1.0 + PI / 8.0 * variance_of_log_odds).sqrt();
    let mut total = 0.0;
    for one in all.iter_mut() {
        let probability = probability(one);
        *probability = probability.powf(moderation);
        total += *probability;
    }
    all.iter_mut().for_each(|one| *probability(one) /= total);
}

/// What hangs together, since poses so far apart (in deviations of both, squared) overlap or since two are one anyway; what
/// several cover counts once.
pub(super) fn valleys<T>(
    mut all: Vec<T>,
    apart: impl Fn(&T, &T) -> Option<f64>,
    is_one: impl Fn(&T, &T) -> bool,
    probability: impl Fn(&mut T) -> &mut f64,
) -> Vec<Vec<T>> {
    let covered: Vec<_> = all.iter().map(|one| times_covered(all.iter().map(|other| apart(one, other)))).collect();
    all.iter_mut().zip(covered).for_each(|(one, times)| *probability(one) /= times);
    connected(all, |one, other| is_one(one, other) || overlaps(apart(one, other)))
}

/// What hangs together by a relation of two.
fn connected<T>(items: Vec<T>, is_one: impl Fn(&T, &T) -> bool) -> Vec<Vec<T>> {
    let mut groups: Vec<Vec<T>> = Vec::new();
    for next in items {
        let mut group: Vec<T> =
            groups.extract_if(.., |other| other.iter().any(|of| is_one(of, &next))).flatten().collect();
        group.push(next);
        groups.push(group);
    }
    groups
}

/// Poses nearer than this overlap, in deviations of both: three.
const OVERLAP_SQUARED: f64 = 9.0;

/// Exact contacts leave covariances singular where valleys bend. With such deviations more (m, rad) what is surely known
/// overlaps as far as what counts as one end: half a millimetre, a degree.
const OVERLAP_SLACK: Vector3<f64> = Vector3::new(SAME_END_M / 3.0, SAME_END_M / 3.0, 0.0175 / 3.0);

/// Squared distance of two poses, in deviations of both; none where they have no covariance.
pub(super) fn apart_squared(
    (pose, covariance): (&Pose, &Matrix3<f64>),
    (other, other_covariance): (&Pose, &Matrix3<f64>),
) -> Option<f64> {
    let slack = Matrix3::from_diagonal(&OVERLAP_SLACK.component_mul(&OVERLAP_SLACK));
    let off = other.minus(pose);
    let inverse = (covariance + other_covariance + slack).try_inverse()?;
    Some(off.dot(&(inverse * off)))
}

/// Whether poses so far apart (in deviations of both, squared) overlap.
fn overlaps(apart_squared: Option<f64>) -> bool {
    apart_squared.is_some_and(|squared| squared < OVERLAP_SQUARED)
}

/// How many times what a pose covers is covered, by its distances from all, itself among them.
fn times_covered(apart_squared: impl Iterator<Item = Option<f64>>) -> f64 {
    let share =
        |squared: Option<f64>| squared.filter(|_| overlaps(squared)).map_or(0.0, |squared| (-0.5 * squared).exp());
    apart_squared.map(share).sum::<f64>().max(1.0)
}

/// Pose of the part at a state reached from contact angle `u0`.
///
/// The turn is in (−π, π] at the start and continuous from there.
pub(super) fn pose(model: &PushModel, u0: f64, time: f64, state: &State) -> Pose {
    let toward = model.edge.normal.y.atan2(model.edge.normal.x);
    let theta = wrap_angle(u0 + PI - toward) + state.u - u0;
    let centre = model.centre_of_mass(time, state);
    let origin: Point2<f64> = centre - Rotation2::new(theta) * model.part.centre_of_mass().coords;
    Pose { x: origin.x, y: origin.y, theta }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use proptest::prelude::*;

    use super::*;
    use crate::math::random::Draw;

    /// A covariance of a pose: of a millimetre and a degree or less, in any directions.
    fn covariance(draw: &mut Draw) -> Matrix3<f64> {
        let root = Matrix3::from_fn(|row, _| draw.normal() * if row == 2 { 0.0175 } else { 1e-3 });
        root * root.transpose()
    }

    fn pose(draw: &mut Draw) -> Pose {
        Pose { x: 3e-3 * draw.normal(), y: 3e-3 * draw.normal(), theta: 0.1 * draw.normal() }
    }

    /// What the approximation of moderated probabilities is off by at the most.
    const MODERATED_OFF: f64 = 0.03;

    proptest! {
        /// Against quadrature over the logarithm of the odds of two.
        #[test]
        fn probabilities_known_to_a_factor_are_what_is_expected(log_odds in -8.0..8.0_f64, log_sd in 0.0..2.0_f64) {
            let mut two = [log_odds.exp(), 1.0];
            normalise(&mut two, log_sd, |of| of);
            prop_assert!((two[0] + two[1] - 1.0).abs() < 1e-12);
            let deviation = 2.0_f64.sqrt() * log_sd;
            let weighed = (-400..=400).map(|step| {
                let off = f64::from(step) / 50.0;
                let weight = (-0.5 * off * off).exp();
                (weight, weight / (1.0 + (-(log_odds + deviation * off)).exp()))
            });
            let (weights, sum) = weighed.fold((0.0, 0.0), |(weights, sum), (weight, of)| (weights + weight, sum + of));
            prop_assert!((two[0] - sum / weights).abs() < MODERATED_OFF, "{} {}", two[0], sum / weights);
            normalise(&mut two, 0.0, |of| of);
            prop_assert!((two[0] / two[1]).ln().abs() <= log_odds.abs() + 1e-9);
        }

        #[test]
        fn what_hangs_together_is_what_steps_of_two_lead_to(values in prop::collection::vec(0.0..1.0_f64, 1..30), reach in 0.0..0.2) {
            let groups = connected(values.clone(), |a, b| (a - b).abs() < reach);
            prop_assert_eq!(groups.iter().map(Vec::len).sum::<usize>(), values.len());
            // On a line: groups are apart by a step that is too long, and have none within.
            let mut groups = groups;
            groups.iter_mut().for_each(|group| group.sort_by(f64::total_cmp));
            groups.sort_by(|a, b| a[0].total_cmp(&b[0]));
            prop_assert!(groups.iter().all(|group| group.windows(2).all(|two| two[1] - two[0] < reach)));
            prop_assert!(groups.windows(2).all(|two| two[1][0] - two[0][two[0].len() - 1] >= reach));
        }

        #[test]
        fn poses_are_as_far_apart_from_either_and_in_any_world(seed: u64, turn in 0.0..TAU) {
            let mut draw = Draw::new(seed);
            let (one, of_one, other, of_other) =
                (pose(&mut draw), covariance(&mut draw), pose(&mut draw), covariance(&mut draw));
            let here = apart_squared((&one, &of_one), (&other, &of_other)).unwrap();
            let back = apart_squared((&other, &of_other), (&one, &of_one)).unwrap();
            let world = Matrix3::from(Rotation2::new(turn).to_homogeneous());
            let turned = |pose: &Pose| {
                let place = world * Vector3::new(pose.x, pose.y, pose.theta);
                Pose { x: place.x, y: place.y, theta: place.z }
            };
            let of = |covariance: &Matrix3<f64>| world * covariance * world.transpose();
            let elsewhere = apart_squared((&turned(&one), &of(&of_one)), (&turned(&other), &of(&of_other))).unwrap();
            prop_assert!((here - back).abs() < 1e-9 * (1.0 + here) && (here - elsewhere).abs() < 1e-6 * (1.0 + here));
        }

        #[test]
        fn what_is_covered_by_many_alike_counts_once(seed: u64, count in 1..20_usize) {
            let mut draw = Draw::new(seed);
            let (pose, covariance) = (pose(&mut draw), covariance(&mut draw));
            let far = Pose { x: pose.x + 0.1, ..pose };
            let from = |other: &Pose| apart_squared((&pose, &covariance), (other, &covariance));
            let alike = std::iter::repeat_n(from(&pose), count);
            prop_assert!((times_covered(alike.clone().chain([from(&far), None])) - count as f64).abs() < 1e-9);
            prop_assert!((times_covered([None].into_iter()) - 1.0).abs() < 1e-12);
        }
    }
}
