//! The global search: every attitude and spin is a candidate; those that fit the first derivatives of the contact path
//! go on.
//!
//! 1. Cubics through the middle of the window give the contact's velocity `u'` and acceleration `u''`.
//! 2. Each attitude of a spread over SO(3), modulo the body's symmetry, gets the angular velocity that makes `u'`
//!    right; the spin about the normal, which `u'` does not see, is where `u''` comes nearest (a quartic to minimise).
//! 3. The attitudes nearest in `u''` are rolled over a short horizon; the best and most different become starts.
//! 4. Starts are fitted over the short horizon, the survivors over twice that, and so on to the whole window.
//!
//! Units: SI. Errors: none; nothing found is an empty list.

use std::cmp::Ordering;

use nalgebra::{Matrix2, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::super::body::RollingBody;
use super::super::mechanics::{Instant, Model, RollState, RotationMatrix, Spin};
use super::super::shape::Scaled;
use super::fit::{Effort, Norm, Point, RollFit, Unknowns};
use super::rotations::spread;
use super::track::Track;
use crate::math::least_squares::Enough;
use crate::search::Halt;

/// Half the stretch that the derivatives are taken from, in units of √(size/g).
const CUBIC_HORIZON: f64 = 0.9;

/// By what a horizon grows from one stage to the next.
const HORIZON_GROWTH: f64 = 1.7;

/// Spins to try, rad/s, as a multiple of √(g/size): the range and the step of the scan.
const SPIN_RANGE: f64 = 1.6;
const SPIN_STEPS: i32 = 24;

/// Starts nearer to each other than this are one: rad, and the same share of √(g/size) in angular velocity.
const SAME_START: f64 = 0.08;

/// Fits nearer to each other than this have met in one minimum: rad and the like.
const SAME_FIT: f64 = 0.02;

/// A fit whose cost exceeds the best by this share and this much is left behind from one stage to the next.
const LEFT_BEHIND: (f64, f64) = (1.0, 60.0);

/// Prior of the palm's unknown acceleration in the search, m/s²: short stretches cannot tell it from the attitude.
const PALM_SIGMA: f64 = 1.0;

/// How wide to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Width {
    /// Attitudes over all of SO(3).
    pub(super) attitudes: usize,
    /// Candidates to roll, best of the attitudes.
    pub(super) rolled: usize,
    /// Starts to fit, best of the rolled.
    pub(super) starts: usize,
    /// Fits to take along from stage to stage.
    pub(super) kept: usize,
    /// Half the horizon of the first fits, in units of √(size/g): long enough for gravity to show, short enough to be
    /// nearly linear. What is long enough depends on how unlike a sphere the body is, so the wider searches try others.
    pub(super) horizon: f64,
}

/// A body's state in the middle of the window that may be.
#[derive(Clone, Debug)]
struct Candidate {
    state: RollState,
    body: usize,
    /// Mismatch of `u''`, then cost of the roll.
    score: f64,
}

/// Place, velocity and acceleration of the contact in the middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Derivatives {
    u: Vector2<f64>,
    velocity: Vector2<f64>,
    acceleration: Vector2<f64>,
}

/// Everything a search needs beside its width.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ground<'a> {
    pub(super) unknowns: Unknowns,
    /// Bodies to start from: the one, or a spread of those that may be.
    pub(super) bodies: &'a [RollingBody],
    pub(super) track: &'a Track,
    /// What the body feels in the middle of the window, palm axes, m/s².
    pub(super) specific_force: Vector3<f64>,
    /// Share of a round body's times in which this one does as much.
    pub(super) pace: f64,
    /// Whether the search is to end early.
    pub(super) halt: &'a Halt<'a>,
}

impl Ground<'_> {
    /// The best fits of the search's readings, best first, all different; none where it was to halt before it had them.
    pub(super) fn search(&self, width: &Width) -> Vec<RollFit> {
        let time = self.time_unit();
        let derivatives = self.derivatives(self.track.ranks(CUBIC_HORIZON * time * self.pace));
        let mut horizon = width.horizon * time;
        let candidates = self.roll(self.candidates(width, &derivatives), horizon, width);
        let starts: Vec<Point> = self.starts(candidates, width.starts);
        let mut fits = self.fit_all(starts, horizon, 8, width);
        while self.track.ranks(horizon) < self.track.ranks_max() {
            horizon *= HORIZON_GROWTH;
            fits = self.fit_all(fits.into_iter().map(|fit| fit.point).collect(), horizon, 6, width);
        }
        // Fits of a part of the window would pass for more than they are.
        if self.halt.is_wished() { Vec::new() } else { fits }
    }

    /// √(size/g): how long the body takes to roll, s.
    fn time_unit(&self) -> f64 {
        let size = self.bodies.iter().map(RollingBody::size).fold(f64::INFINITY, f64::min);
        (size / self.specific_force.norm().max(1e-3)).sqrt()
    }

    /// Cubics through the readings around the middle.
    fn derivatives(&self, ranks: usize) -> Derivatives {
        let (mut normal, mut right) = (SMatrix::<f64, 4, 4>::zeros(), SMatrix::<f64, 4, 2>::zeros());
        let reach = ranks as f64;
        // Normal equations of u(x) = c₀ + c₁x + c₂x² + c₃x³ over x in [−1, 1], so that powers stay of order 1.
        let mut add = |x: f64, u: &Vector2<f64>| {
            let powers = SVector::<f64, 4>::new(1.0, x, x * x, x * x * x);
            normal += powers * powers.transpose();
            right += powers * u.transpose();
        };
        add(0.0, &self.track.centre);
        for (integration_steps, sign) in [(&self.track.forward, 1.0), (&self.track.backward, -1.0)] {
            for integration_step in
                integration_steps.iter().take_while(|integration_step| integration_step.rank <= ranks)
            {
                let x = integration_step.rank as f64 / reach;
                if let Some(reading) = &integration_step.reading {
                    add(sign * x, reading);
                }
            }
        }
        let fitted = normal.cholesky().map_or_else(SMatrix::zeros, |cholesky| cholesky.solve(&right));
        // Back to seconds: u' = c₁/T, u'' = 2c₂/T² at the middle.
        let seconds = reach * self.track.dt;
        Derivatives {
            u: fitted.row(0).transpose(),
            velocity: fitted.row(1).transpose() / seconds,
            acceleration: fitted.row(2).transpose() * (2.0 / (seconds * seconds)),
        }
    }

    /// Attitudes and spins, those nearest in acceleration.
    fn candidates(&self, width: &Width, derivatives: &Derivatives) -> Vec<Candidate> {
        let mut candidates = Vec::new();
        for (index, body) in self.bodies.iter().enumerate().take_while(|_| !self.halt.is_wished()) {
            let model = Model { body, spin: self.unknowns.spin };
            for attitude in spread(body.symmetry(), width.attitudes).iter() {
                self.spins(model, attitude, derivatives, |state, score| {
                    candidates.push(Candidate { state, body: index, score });
                });
            }
        }
        nearest(candidates, width.rolled)
    }

    /// The spins at which an attitude comes nearest to the acceleration.
    fn spins(
        &self,
        model: Model,
        attitude: &UnitQuaternion<f64>,
        derivatives: &Derivatives,
        mut found: impl FnMut(RollState, f64),
    ) {
        let orientation = attitude.into_inner();
        let rotation = RotationMatrix::of(&orientation);
        let hessian = model.body.shape().local(&-rotation.0[2], &Vector3::zeros()).hessian;
        let across = |i: usize, j: usize| rotation.0[i].dot(&(hessian * rotation.0[j]));
        // u' = (A H Aᵀ) (W_y, −W_x), because n × ω is (W_y, −W_x, 0) in palm axes.
        let Some(inverse) = Matrix2::new(across(0, 0), across(0, 1), across(1, 0), across(1, 1)).try_inverse() else {
            return;
        };
        let sway = inverse * derivatives.velocity;
        let state = |spin: f64| {
            let omega = rotation.to_body(&Vector3::new(-sway.y, sway.x, spin));
            RollState { orientation, omega, u: derivatives.u }
        };
        let miss = |spin: f64| self.acceleration(model, &state(spin)) - derivatives.acceleration;
        if self.unknowns.spin == Spin::NoSpin {
            return found(state(0.0), miss(0.0).norm_squared());
        }
        // u'' is quadratic in the spin: three values give it everywhere.
        let range = SPIN_RANGE * (self.specific_force.norm() / model.body.size()).sqrt();
        let [low, middle, high] = [-range, 0.0, range].map(miss);
        let (slope, bend) = ((high - low) * 0.5, (high + low) * 0.5 - middle);
        let score = |x: f64| (middle + slope * x + bend * (x * x)).norm_squared();
        let place = |k: i32| f64::from(k) / f64::from(SPIN_STEPS);
        let mut any = false;
        for k in -SPIN_STEPS..=SPIN_STEPS {
            let [before, here, after] = [k - 1, k, k + 1].map(|k| score(place(k)));
            if here <= before && here < after {
                any = true;
                found(state(range * place(k)), here);
            }
        }
        if !any {
            // A sphere's path does not show its spin.
            found(state(0.0), score(0.0));
        }
    }

    /// `u''` of the contact on the palm, palm axes, m/s².
    fn acceleration(&self, model: Model, state: &RollState) -> Vector2<f64> {
        let instant = Instant::of(state, &self.specific_force);
        let local = model.body.shape().local(&instant.normal, &instant.turning);
        let moving = local.hessian * instant.turning;
        let contact = Scaled { point: local.contact, motion: moving, square: 1.0 };
        let turn = model.turn_scaled(state, &instant, &contact);
        let turning = instant.turning.cross(&state.omega) + instant.normal.cross(&turn);
        let bending = state.omega.cross(&moving) + local.slope * instant.turning + local.hessian * turning;
        Vector2::new(instant.rotation.0[0].dot(&bending), instant.rotation.0[1].dot(&bending))
    }

    /// Rolls candidates over a horizon, best first.
    fn roll(&self, mut candidates: Vec<Candidate>, horizon: f64, width: &Width) -> Vec<Candidate> {
        let ranks = self.track.ranks(horizon);
        for candidate in &mut candidates {
            if self.halt.is_wished() {
                return Vec::new();
            }
            candidate.score = self.unknowns.cost(self.track, &self.point(candidate), ranks);
        }
        nearest(candidates, 8 * width.starts)
    }

    fn point(&self, candidate: &Candidate) -> Point {
        Point { state: candidate.state, body: self.bodies[candidate.body].clone(), palm: Vector3::zeros() }
    }

    /// The best candidates that differ.
    fn starts(&self, candidates: Vec<Candidate>, count: usize) -> Vec<Point> {
        let mut starts: Vec<Candidate> = Vec::new();
        for candidate in candidates {
            let known = |start: &Candidate| {
                start.body == candidate.body
                    && self.differ(&self.bodies[start.body], &start.state, &candidate.state) < SAME_START
            };
            if starts.len() < count && !starts.iter().any(known) {
                starts.push(candidate);
            }
        }
        starts.iter().map(|start| self.point(start)).collect()
    }

    /// How different two states are: the angle modulo symmetry, and the angular velocity in palm axes in units of
    /// √(g/size).
    fn differ(&self, body: &RollingBody, a: &RollState, b: &RollState) -> f64 {
        let (x, y) = (a.attitude(), b.attitude());
        let rate = (self.specific_force.norm() / body.size()).sqrt();
        body.symmetry().angle(&x, &y).hypot((x * a.omega - y * b.omega).norm() / rate)
    }

    /// Fits each over a horizon; leaves behind what is hopeless and what has met another.
    fn fit_all(&self, points: Vec<Point>, horizon: f64, iterations: usize, width: &Width) -> Vec<RollFit> {
        let palm_sigma = if self.unknowns.columns.palm { PALM_SIGMA } else { f64::INFINITY };
        let effort = Effort {
            ranks: self.track.ranks(horizon),
            iterations,
            enough: Enough { relative: 1e-3, absolute: 0.02, damping_max: 1.0 },
            palm_sigma,
            norm: Norm::Squares,
        };
        let points = points.into_iter();
        let mut fits: Vec<RollFit> = points
            .take_while(|_| !self.halt.is_wished())
            .map(|point| self.unknowns.fit(self.track, point, &effort))
            .collect();
        fits.retain(|fit| fit.cost.is_finite());
        fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let best = fits.first().map_or(0.0, |fit| fit.cost);
        let mut kept: Vec<RollFit> = Vec::new();
        for fit in fits {
            let hopeless = fit.cost > best * (1.0 + LEFT_BEHIND.0) + LEFT_BEHIND.1;
            if !hopeless && kept.len() < width.kept && !kept.iter().any(|other| self.met(other, &fit)) {
                kept.push(fit);
            }
        }
        kept
    }

    fn met(&self, a: &RollFit, b: &RollFit) -> bool {
        let axes = (a.point.body.inertia() - b.point.body.inertia()).norm() / a.point.body.inertia().norm();
        self.differ(&a.point.body, &a.point.state, &b.point.state) < SAME_FIT && axes < SAME_FIT
    }
}

/// The `count` with the lowest scores, in order.
fn nearest(mut candidates: Vec<Candidate>, count: usize) -> Vec<Candidate> {
    // Rolls that ran away are no candidates; a NaN would even sort before all numbers.
    candidates.retain(|candidate| candidate.score.is_finite());
    let by_score = |a: &Candidate, b: &Candidate| -> Ordering { a.score.total_cmp(&b.score) };
    if candidates.len() > count && count > 0 {
        candidates.select_nth_unstable_by(count - 1, by_score);
        candidates.truncate(count);
    }
    candidates.sort_by(by_score);
    candidates
}
