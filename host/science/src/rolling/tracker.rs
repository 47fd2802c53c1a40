//! Live: contacts in, estimates out.
//!
//! Contacts are collected until the global observer gives one answer; from then on an extended Kalman filter on the
//! rotation group follows the body, contact by contact. When its innovations grow beyond their noise the track is lost,
//! and collecting begins anew.
//!
//! Assumes: contacts at nearly equal steps of time; a gap starts anew.
//! Frames: errors of attitude about body axes, of angular velocity in palm axes. Units: SI. Errors: none; what is not
//! known yet is a [`Report`] of its own.

use nalgebra::{Matrix2, Matrix3, SMatrix, UnitQuaternion, Vector2, Vector3};

use super::body::RollingBody;
use super::flow::{Columns, STATE_COLUMNS, StateWithTangent, Tangent};
use super::mechanics::{Model, RollState, Spin, specific_force};
use super::observer::{BodyKnowledge, PalmKnowledge, RollEstimate, RollHypothesis, RollQuestion, RollVerdict};
use super::palm::PalmAcceleration;

/// Longest step of the filter, s.
const STEP_MAX_S: f64 = 4e-3;

/// Random walk of the angular velocity that the filter allows for, rad/s per √s: what a real contact adds to the model.
const WALK: f64 = 0.05;

/// Contacts that innovations are averaged over, and the mean normalised square (1 if all is well) at which a track is
/// lost.
const LOST_AFTER: f64 = 40.0;
const LOST_ABOVE: f64 = 4.0;

/// How far from the usual step a contact may come, as a share of it.
const STEP_TOLERANCE: f64 = 0.2;

/// Longest stretch collected, in windows; then the older half is forgotten.
const WINDOWS_MAX: f64 = 3.0;

/// New contacts before the observer is asked again, as a share of a window.
const RETRY: f64 = 0.25;

/// Follows a body on the palm.
#[derive(Clone, Debug)]
pub struct RollTracker {
    question: RollQuestion,
    /// Shortest stretch of contacts that the observer is asked about, s.
    window: f64,
    phase: Phase,
}

#[derive(Clone, Debug)]
enum Phase {
    Collecting(Collection),
    Tracking(Box<Track>),
}

/// Contacts not yet explained.
#[derive(Clone, Debug, Default)]
struct Collection {
    times: Vec<f64>,
    u: Vec<Vector2<f64>>,
    /// Contacts when the observer was last asked.
    asked: usize,
}

/// A body that the filter follows.
#[derive(Clone, Debug)]
struct Track {
    body: RollingBody,
    spin: Spin,
    palm: PalmAcceleration,
    g: f64,
    sigma: f64,
    t: f64,
    dt: f64,
    state: RollState,
    /// θ (body), W (palm), u.
    covariance: SMatrix<f64, 8, 8>,
    /// Mean normalised square of the innovations.
    normalised_innovation: f64,
}

/// What is known after a contact.
#[derive(Clone, Debug)]
pub enum Report {
    /// Too few contacts for an answer.
    Collecting {
        /// From the first contact to this one, s.
        seconds: f64,
    },
    /// The observer was asked and has no single answer.
    Undecided(Box<RollEstimate>),
    /// The observer found the body; the filter begins.
    Found(Box<RollEstimate>),
    /// The filter's estimate after this contact.
    Tracking(Tracked),
    /// Contacts and filter disagree; collecting begins anew.
    Lost,
}

/// What the filter knows of a body that it follows.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tracked {
    /// Attitude, motion and contact.
    pub state: RollState,
    /// Largest standard deviation of the attitude, rad.
    pub attitude_sigma: f64,
    /// Largest standard deviation of the angular velocity, rad/s.
    pub omega_sigma: f64,
}

impl RollTracker {
    /// A tracker that asks `question` of every stretch of `window` s; times count from the palm's own zero.
    #[must_use]
    pub fn new(question: RollQuestion, window: f64) -> Self {
        Self { question, window, phase: Phase::Collecting(Collection::default()) }
    }

    /// Takes a contact `u` (m) felt at `t` (s).
    pub fn feel(&mut self, t: f64, u: Vector2<f64>) -> Report {
        match &mut self.phase {
            Phase::Tracking(track) => match track.feel(t, u) {
                Some(tracked) => Report::Tracking(tracked),
                None => {
                    self.phase = Phase::Collecting(Collection { times: vec![t], u: vec![u], asked: 0 });
                    Report::Lost
                }
            },
            Phase::Collecting(collection) => {
                collection.add(t, u);
                let estimate = collection.ask(&self.question, self.window);
                let seconds = collection.seconds();
                let Some((estimate, dt)) = estimate else { return Report::Collecting { seconds } };
                match estimate.hypotheses.first() {
                    Some(best) if estimate.verdict == RollVerdict::Unique => {
                        self.phase = Phase::Tracking(Box::new(Track::new(&self.question, best, t, dt)));
                        Report::Found(Box::new(estimate))
                    }
                    _ => Report::Undecided(Box::new(estimate)),
                }
            }
        }
    }
}

impl Collection {
    fn add(&mut self, t: f64, u: Vector2<f64>) {
        let regular = match self.times.as_slice() {
            [.., before, last] => ((t - last) - (last - before)).abs() <= STEP_TOLERANCE * (last - before),
            [last] => t > *last,
            [] => true,
        };
        if !regular {
            *self = Self::default();
        }
        self.times.push(t);
        self.u.push(u);
    }

    fn seconds(&self) -> f64 {
        self.times.last().zip(self.times.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// Asks the observer if enough is new.
    fn ask(&mut self, question: &RollQuestion, window: f64) -> Option<(RollEstimate, f64)> {
        let count = self.times.len();
        let steps = (count.max(2) - 1) as f64;
        let dt = self.seconds() / steps;
        let fresh = (count - self.asked) as f64 * dt;
        if count < 2 || self.seconds() < window || self.asked > 0 && fresh < RETRY * window {
            return None;
        }
        self.asked = count;
        let estimate = self.shifted(question).answer(dt, &self.u).ok()?;
        if estimate.verdict != RollVerdict::Unique && self.seconds() > WINDOWS_MAX * window {
            self.times.drain(..count / 2);
            self.u.drain(..count / 2);
            self.asked = self.times.len();
        }
        Some((estimate, dt))
    }

    /// The question with the palm's time counted from the first contact.
    fn shifted(&self, question: &RollQuestion) -> RollQuestion {
        let palm = match &question.palm {
            PalmKnowledge::Known(palm) => PalmKnowledge::Known(palm.from(self.times.first().copied().unwrap_or(0.0))),
            PalmKnowledge::Constant => PalmKnowledge::Constant,
        };
        RollQuestion { palm, ..question.clone() }
    }
}

impl Track {
    fn new(question: &RollQuestion, best: &RollHypothesis, t: f64, dt: f64) -> Self {
        let body = match &question.body {
            BodyKnowledge::OneOf(bodies) => bodies[best.body].clone(),
            BodyKnowledge::Ellipsoid { range } => {
                let axes = best.semi_axes.unwrap_or([*range.start(); 3]);
                RollingBody::ellipsoid(axes)
                    .unwrap_or_else(|_| unreachable!("the observer keeps semi-axes in their range"))
            }
        };
        let palm = match (&question.palm, best.palm_acceleration) {
            (PalmKnowledge::Known(palm), _) => palm.clone(),
            (PalmKnowledge::Constant, acceleration) => PalmAcceleration::Constant(acceleration.unwrap_or_default()),
        };
        let sigma = question.noise.sigma().max(SIGMA_MIN);
        let covariance = start_covariance(best, sigma);
        Self {
            body,
            spin: best.spin,
            palm,
            g: question.g,
            sigma,
            t,
            dt,
            state: best.end,
            covariance,
            normalised_innovation: 1.0,
        }
    }

    /// `None` once the track is lost.
    fn feel(&mut self, t: f64, u: Vector2<f64>) -> Option<Tracked> {
        let dt = t - self.t;
        // Written so that NaN is a gap.
        if !(dt > 0.0 && dt < 10.0 * self.dt) {
            return None;
        }
        self.predict(dt);
        self.correct(u);
        let block = |first: usize| self.covariance.fixed_view::<3, 3>(first, first).symmetric_eigenvalues().max();
        let [attitude_sigma, omega_sigma] = [0, 3].map(|first| block(first).max(0.0).sqrt());
        (self.normalised_innovation < LOST_ABOVE).then_some(Tracked { state: self.state, attitude_sigma, omega_sigma })
    }

    fn predict(&mut self, dt: f64) {
        let parts = (dt / STEP_MAX_S).ceil().max(1.0);
        let (step, mut done) = (dt / parts, 0.0);
        let mut here = StateWithTangent::<STATE_COLUMNS>::seed(&self.state);
        while done < parts {
            let start = self.t + done * step;
            let middle = start + 0.5 * step;
            let feel = |time: f64| specific_force(self.palm.at_within(time, middle), self.g);
            let specific_force = [feel(start), feel(middle), feel(start + step)];
            let model = Model { body: &self.body, spin: self.spin };
            here = model.step_with(Columns::STATE, &here, &specific_force, step);
            done += 1.0;
        }
        let transition = transition(&here.state, &here.tangent);
        self.covariance = transition * self.covariance * transition.transpose();
        for axis in 3..6 {
            self.covariance[(axis, axis)] += WALK * WALK * dt;
        }
        (self.state, self.t) = (here.state, self.t + dt);
    }

    fn correct(&mut self, u: Vector2<f64>) {
        let innovation = u - self.state.u;
        let spread = self.covariance.fixed_view::<2, 2>(6, 6) + Matrix2::from_diagonal_element(self.sigma * self.sigma);
        let Some(inverse) = spread.try_inverse() else { return };
        let gain = self.covariance.fixed_view::<8, 2>(0, 6) * inverse;
        self.normalised_innovation +=
            ((innovation.transpose() * inverse * innovation)[0] * 0.5 - self.normalised_innovation) / LOST_AFTER;
        let change = gain * innovation;
        self.covariance -= gain * self.covariance.fixed_view::<2, 8>(6, 0).into_owned();
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        let attitude = self.state.attitude();
        let turned = attitude * UnitQuaternion::from_scaled_axis(change.fixed_rows::<3>(0).into_owned());
        let mut spinning: Vector3<f64> = attitude * self.state.omega + change.fixed_rows::<3>(3);
        if self.spin == Spin::NoSpin {
            spinning.z = 0.0;
        }
        self.state = RollState {
            orientation: turned.into_inner(),
            omega: turned.inverse() * spinning,
            u: self.state.u + change.fixed_rows::<2>(6),
        };
    }
}

/// Least standard deviation of a contact that the filter reckons with, m.
const SIGMA_MIN: f64 = 1e-5;

/// Of θ, W and u, from the observer's of θ and ω; wide where symmetry leaves the observer without one.
fn start_covariance(best: &RollHypothesis, sigma: f64) -> SMatrix<f64, 8, 8> {
    const WIDE: [f64; 2] = [0.05, 0.3];
    let mut start = SMatrix::<f64, 8, 8>::zeros();
    let rows = best.end.attitude().to_rotation_matrix().into_inner();
    match &best.covariance {
        Some(covariance) => {
            let known = SMatrix::<f64, 6, 6>::from_fn(|i, j| covariance[(i, j)]);
            let mut to_palm = SMatrix::<f64, 6, 6>::identity();
            to_palm.fixed_view_mut::<3, 3>(3, 0).copy_from(&(rows * -best.end.omega.cross_matrix()));
            to_palm.fixed_view_mut::<3, 3>(3, 3).copy_from(&rows);
            start.fixed_view_mut::<6, 6>(0, 0).copy_from(&(to_palm * known * to_palm.transpose()));
        }
        None => (0..6).for_each(|i| start[(i, i)] = WIDE[i / 3] * WIDE[i / 3]),
    }
    for axis in 6..8 {
        start[(axis, axis)] = sigma * sigma;
    }
    start
}

/// From errors of (θ, W, u) before to those after.
fn transition(state: &RollState, tangent: &Tangent<STATE_COLUMNS>) -> SMatrix<f64, 8, 8> {
    let block = |rows: &[[f64; STATE_COLUMNS]; 3]| SMatrix::<f64, 3, STATE_COLUMNS>::from_fn(|i, j| rows[i][j]);
    let (theta, omega) = (block(&tangent.theta), block(&tangent.omega));
    let rows: Matrix3<f64> = state.attitude().to_rotation_matrix().into_inner();
    // ω = AᵀW: a change of ω beyond ω × θ is one of W.
    let spinning = rows * (omega - state.omega.cross_matrix() * theta);
    let mut transition = SMatrix::<f64, 8, 8>::identity();
    transition.fixed_view_mut::<3, STATE_COLUMNS>(0, 0).copy_from(&theta);
    transition.fixed_view_mut::<3, STATE_COLUMNS>(3, 0).copy_from(&spinning);
    transition
        .fixed_view_mut::<2, STATE_COLUMNS>(6, 0)
        .copy_from(&SMatrix::<f64, 2, STATE_COLUMNS>::from_fn(|i, j| tangent.u[i][j]));
    transition
}

#[cfg(test)]
mod tests {
    use super::super::observer::Noise;
    use super::super::tests::{bodies, state_of};
    use super::*;
    use crate::gravity::GRAVITY_ASSUMED;

    fn question(body: &RollingBody, spin: Spin) -> RollQuestion {
        RollQuestion {
            body: BodyKnowledge::OneOf(vec![body.clone()]),
            spins: vec![spin],
            palm: PalmKnowledge::Known(PalmAcceleration::Rest),
            g: GRAVITY_ASSUMED,
            noise: Noise::Grid(1e-3),
        }
    }

    /// Contacts of a roll on a 1 mm grid with the states behind them.
    fn path(body: &RollingBody, spin: Spin, count: usize) -> Vec<(f64, Vector2<f64>, RollState)> {
        let model = Model { body, spin };
        let start = state_of(spin, [0.4, -0.2, 0.7, 0.3], [2.0, -3.0, 1.5]);
        let specific_force = [specific_force(Vector3::zeros(), GRAVITY_ASSUMED); 3];
        let states = std::iter::successors(Some(start), |state| Some(model.step(state, &specific_force, 0.002)));
        let rounded = |state: &RollState| state.u.map(|x| (x * 1e3).round() * 1e-3);
        let times = std::iter::successors(Some(0.0), |t| Some(t + 0.002));
        states.zip(times).take(count).map(|(state, t)| (t, rounded(&state), state)).collect()
    }

    #[test]
    fn a_body_is_found_and_followed() {
        let body = &bodies()[0];
        for spin in [Spin::Free, Spin::NoSpin] {
            let mut tracker = RollTracker::new(question(body, spin), 0.4);
            let (mut found, mut followed) = (0, 0);
            for (t, u, truth) in path(body, spin, 600) {
                match tracker.feel(t, u) {
                    Report::Found(_) => found += 1,
                    Report::Tracking(tracked) => {
                        followed += 1;
                        let error = body.symmetry().angle(&tracked.state.attitude(), &truth.attitude());
                        assert!(error < 0.03, "{spin:?} at {t} s: {error} rad, sigma {}", tracked.attitude_sigma);
                    }
                    Report::Collecting { .. } => assert_eq!((found, followed), (0, 0), "{spin:?} at {t} s"),
                    other => panic!("{spin:?} at {t} s: {other:?}"),
                }
            }
            assert_eq!(found, 1);
            assert!(followed > 350, "{followed}");
        }
    }

    #[test]
    fn a_body_that_was_pushed_is_lost_and_found_again() {
        let body = &bodies()[0];
        let mut tracker = RollTracker::new(question(body, Spin::NoSpin), 0.4);
        let first = path(body, Spin::NoSpin, 260);
        let push = first[259].0;
        let second = path(body, Spin::NoSpin, 400).into_iter().skip(60).map(|(t, u, _)| (push + t - 0.118, -u));
        let all = first.into_iter().map(|(t, u, _)| (t, u)).chain(second);
        let mut words = Vec::new();
        for (t, u) in all {
            let word = match tracker.feel(t, u) {
                Report::Collecting { .. } => "collecting",
                Report::Undecided(_) => "undecided",
                Report::Found(_) => "found",
                Report::Tracking(_) => "tracking",
                Report::Lost => "lost",
            };
            if words.last() != Some(&word) {
                words.push(word);
            }
        }
        let usual = ["collecting", "found", "tracking", "lost", "collecting", "found", "tracking"];
        assert!(words.starts_with(&usual[..4]) && words.contains(&"lost"), "{words:?}");
        assert_eq!(words.iter().filter(|word| **word == "found").count(), 2, "{words:?}");
    }
}
