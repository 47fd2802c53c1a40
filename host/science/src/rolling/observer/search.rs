//! The global search: every attitude and spin is a candidate; those that fit the first derivatives of the contact path
//! go on.
//!
//! 1. Cubics through the middle of the window give the contact's velocity `u'` and acceleration `u''`.
//! 2. Each attitude of a spread over SO(3), modulo the body's symmetry, gets the angular velocity that makes `u'`
//!    right; the spin about the normal, which `u'` does not see, is where `u''` comes nearest (a quartic to minimise),
//!    and where `u''` hardly depends on it, spins all over its range. Those are within reach from which the measured
//!    `u''` can be had by a turn of no more than a cell of the spread.
//! 3. All within reach take one step of Gauss and Newton over a short horizon, those that promise a cost as low as the
//!    best could have over one half as long again, and then are fitted. The best few go on whatever they promise: one
//!    step from afar may promise a hundred times what the truth costs, and less than another place can hold. While no
//!    promise is plausible, another step is taken over the same horizon. What comes together goes on as one.
//! 4. The survivors are fitted over ever longer horizons, and at last to their minimum over the whole window.
//!
//! What could not be excluded and was not followed, because there is a limit to all lists, is counted ([`Coverage`]): a
//! search that left out nothing knows of every minimum within a cell of the spread.
//!
//! Units: SI. Errors: none; nothing found is an empty list.

use std::cmp::Ordering;
use std::f64::consts::PI;

use nalgebra::{Matrix2, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::super::body::RollingBody;
use super::super::mechanics::{Instant, Model, RollState, RotationMatrix, Spin};
use super::super::shape::Scaled;
use super::super::symmetry::Symmetry;
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

/// Starts nearer to each other than this are one: rad, and the same share of √(g/size) in angular velocity. After one
/// step from the spread, and after another.
const SAME_START: [f64; 2] = [0.15, 0.1];

/// So many of the best promises are kept however much lower the best is, since that may come to little, and the truth be
/// promised a hundred times what it costs; and so many where none is plausible. Without them seven of 2,040
/// drawn truths were lost.
const KEPT_MIN: [usize; 2] = [8, 32];

/// Further steps over the shortest stretch, at most, while no promise is plausible.
const AGAIN_MAX: usize = 2;

/// Standard deviations by which the acceleration may be off.
const ACCELERATION_SIGMAS: f64 = 3.5;

/// Radii of a cell of the spread of attitudes within which the acceleration must come right for the cell to be within
/// reach: more than one because the acceleration bends.
const REACH_CELLS: f64 = 1.5;

/// Turn with which the slopes of the acceleration are taken, rad.
const SLOPE_TURN: f64 = 1e-3;

/// Spins at which an attitude is tried are no further apart than this share of [`SPIN_RANGE`] where all of them fit.
const SPIN_CELL: f64 = 0.3;

/// Fits nearer to each other than this have met in one minimum: rad and the like.
const SAME_FIT: f64 = 0.02;

/// So are fits of the same readings this many standard deviations apart: along valleys descents end anywhere.
pub(super) const SAME_DEVIATIONS: f64 = 0.5;

/// A fit whose cost exceeds the best by this share and this much is left behind from one stage to the next.
const LEFT_BEHIND: (f64, f64) = (1.0, 60.0);

/// Iterations of the last fits of the search; most take five, along a valley it may be dozens.
const ITERATIONS_LAST: usize = 60;

/// Prior of the palm's unknown acceleration in the search, m/s²: short stretches cannot tell it from the attitude.
const PALM_SIGMA: f64 = 1.0;

/// How wide to search.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Width {
    /// Attitudes over all of SO(3).
    pub(super) attitudes: usize,
    /// Candidates to approach at most, the nearest of those within reach.
    pub(super) approached: usize,
    /// Starts to approach again, at most, and to fit.
    pub(super) starts: [usize; 2],
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
    /// Turn after which the acceleration would be right, over the radius of a cell of attitudes.
    cells: f64,
}

/// A place to fit from, with the cost that is promised there.
#[derive(Clone, Debug)]
struct Promise {
    point: Point,
    cost: f64,
}

/// Different places to go on from.
struct Starts {
    points: Vec<Point>,
    /// Whether the best promise is a cost that the truth may have: if not, steps were too long to say much.
    is_plausible: bool,
}

/// What a search covered.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Coverage {
    /// Radius of the cell of each attitude, rad; the largest of all bodies.
    pub cell: f64,
    /// Attitudes tried, over all bodies, modulo their symmetries.
    pub attitudes: usize,
    /// Attitudes and spins from which the contact's acceleration can be reached within a cell.
    pub within_reach: usize,
    /// Different descents followed over the shortest stretch.
    pub followed: usize,
    /// Of all these those that could not be excluded and were not followed for lack of time.
    pub left_out: usize,
}

impl Coverage {
    /// That of two searches, each over its own part of all there is.
    pub(super) fn add(&mut self, other: &Self) {
        self.cell = self.cell.max(other.cell);
        self.attitudes += other.attitudes;
        self.within_reach += other.within_reach;
        self.followed += other.followed;
        self.left_out += other.left_out;
    }
}

/// What a search found, best first, and where it looked.
#[derive(Debug, Default)]
pub(super) struct Sought {
    pub(super) fits: Vec<RollFit>,
    pub(super) coverage: Coverage,
}

/// Place, velocity and acceleration of the contact in the middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Derivatives {
    u: Vector2<f64>,
    velocity: Vector2<f64>,
    acceleration: Vector2<f64>,
    /// Standard deviation of a coordinate of the acceleration, m/s².
    acceleration_sigma: f64,
}

/// Everything a search needs beside its width.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ground<'a> {
    pub(super) unknowns: Unknowns,
    /// Bodies to start from: the one, or a spread of those that may be.
    pub(super) bodies: &'a [RollingBody],
    pub(super) track: &'a Track,
    /// The same readings in longer steps, for the first step from every candidate.
    pub(super) first_look: &'a Track,
    /// What the body feels in the middle of the window, palm axes, m/s².
    pub(super) specific_force: Vector3<f64>,
    /// Share of a round body's times in which this one does as much.
    pub(super) pace: f64,
    /// Whether the search is to end early.
    pub(super) halt: &'a Halt<'a>,
}

impl Ground<'_> {
    /// The best fits of the search's readings, best first, all different; none where it was to halt before it had them.
    pub(super) fn search(&self, width: &Width) -> Sought {
        let time = self.time_unit();
        let derivatives = self.derivatives(self.track.ranks(CUBIC_HORIZON * time * self.pace));
        let mut horizon = width.horizon * time;
        let mut coverage = Coverage::default();
        let candidates = self.candidates(width, &derivatives, &mut coverage);
        let points = candidates.iter().map(|candidate| self.point(candidate)).collect();
        let mut near = self.approach(self.first_look, points, horizon, SAME_START[0], width.starts[0], &mut coverage);
        for _ in 0..AGAIN_MAX {
            if near.is_plausible {
                break;
            }
            near = self.approach(self.track, near.points, horizon, SAME_START[0], width.starts[0], &mut coverage);
        }
        coverage.followed = near.points.len();
        let longer = horizon * HORIZON_GROWTH;
        let starts = self.approach(self.track, near.points, longer, SAME_START[1], width.starts[1], &mut coverage);
        let mut fits = self.fit_all(starts.points, longer, 4, width, &mut coverage);
        horizon = longer;
        while self.track.ranks(horizon) < self.track.ranks_max() {
            horizon *= HORIZON_GROWTH;
            fits = self.fit_all(fits.into_iter().map(|fit| fit.point).collect(), horizon, 6, width, &mut coverage);
        }
        // Costs are compared at minima alone: until nothing is gained.
        let to_the_end = Effort {
            enough: Enough { relative: 0.0, absolute: 1e-3, damping_max: 1.0 },
            ..self.effort(horizon, ITERATIONS_LAST)
        };
        fits = self.fit_all_with(fits.into_iter().map(|fit| fit.point).collect(), &to_the_end, width, &mut coverage);
        // Fits of a part of the window would pass for more than they are.
        if self.halt.is_wished() {
            return Sought::default();
        }
        Sought { fits, coverage }
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
        let cholesky = normal.cholesky();
        let fitted = cholesky.as_ref().map_or_else(SMatrix::zeros, |cholesky| cholesky.solve(&right));
        let bend_variance = cholesky.map_or(0.0, |cholesky| cholesky.inverse()[(2, 2)]);
        // Back to seconds: u' = c₁/T, u'' = 2c₂/T² at the middle.
        let seconds = reach * self.track.dt;
        Derivatives {
            u: fitted.row(0).transpose(),
            velocity: fitted.row(1).transpose() / seconds,
            acceleration: fitted.row(2).transpose() * (2.0 / (seconds * seconds)),
            acceleration_sigma: self.track.sigma * bend_variance.sqrt() * 2.0 / (seconds * seconds),
        }
    }

    /// Attitudes and spins from which the acceleration is within reach, nearest first.
    ///
    /// Attitudes are spread from the heading of the contact on, so that turning readings and palm turns all that follows.
    fn candidates(&self, width: &Width, derivatives: &Derivatives, coverage: &mut Coverage) -> Vec<Candidate> {
        let heading = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), {
            derivatives.velocity.y.atan2(derivatives.velocity.x)
        });
        let mut candidates = Vec::new();
        for (index, body) in self.bodies.iter().enumerate().take_while(|_| !self.halt.is_wished()) {
            let model = Model { body, spin: self.unknowns.spin };
            let attitudes = spread(body.symmetry(), width.attitudes);
            coverage.attitudes += attitudes.len();
            let cell = cell_radius(body.symmetry(), attitudes.len());
            coverage.cell = coverage.cell.max(cell);
            for attitude in attitudes.iter().take_while(|_| !self.halt.is_wished()) {
                self.spins(model, &(heading * attitude), cell, derivatives, |state, cells| {
                    candidates.push(Candidate { state, body: index, cells });
                });
            }
        }
        candidates.retain(|candidate| candidate.cells.is_finite());
        let reached = candidates.iter().filter(|candidate| candidate.cells <= REACH_CELLS).count();
        coverage.within_reach = reached;
        coverage.left_out += reached.saturating_sub(width.approached);
        nearest(candidates, reached.clamp(width.approached / 4, width.approached))
    }

    /// The spins at which an attitude comes nearest to the acceleration, each with the turn after which it would be
    /// right, over the radius of a cell of attitudes.
    fn spins(
        &self,
        model: Model,
        attitude: &UnitQuaternion<f64>,
        cell: f64,
        derivatives: &Derivatives,
        mut found: impl FnMut(RollState, f64),
    ) {
        let Some(here) = Swaying::new(model, attitude, derivatives) else { return };
        let miss =
            |swaying: &Swaying, spin: f64| self.acceleration(model, &swaying.state(spin)) - derivatives.acceleration;
        // How the acceleration changes with the attitude, for the reach of a cell.
        let turned: Vec<Swaying> = (0..3)
            .filter_map(|axis| {
                let turn = UnitQuaternion::from_scaled_axis(Vector3::ith(axis, SLOPE_TURN));
                Swaying::new(model, &(turn * attitude), derivatives)
            })
            .collect();
        let cells = |spin: f64, miss_here: Vector2<f64>| {
            let off = miss_here.norm();
            let beyond = off - ACCELERATION_SIGMAS * derivatives.acceleration_sigma;
            if beyond <= 0.0 {
                return 0.0;
            }
            let slopes = turned.iter().map(|swaying| (miss(swaying, spin) - miss_here).dot(&miss_here) / off);
            let slope = slopes.map(|slope| slope * slope).sum::<f64>().sqrt() / SLOPE_TURN;
            beyond / (slope * cell).max(f64::MIN_POSITIVE)
        };
        if self.unknowns.spin == Spin::NoSpin {
            let miss = miss(&here, 0.0);
            return found(here.state(0.0), cells(0.0, miss));
        }
        // u'' is quadratic in the spin: three values give it everywhere.
        let range = SPIN_RANGE * (self.specific_force.norm() / model.body.size()).sqrt();
        let [low, middle, high] = [-range, 0.0, range].map(|spin| miss(&here, spin));
        let (slope, bend) = ((high - low) * 0.5, (high + low) * 0.5 - middle);
        let at = |x: f64| middle + slope * x + bend * (x * x);
        let score = |x: f64| at(x).norm_squared();
        let place = |k: i32| f64::from(k) / f64::from(SPIN_STEPS);
        let fits = (ACCELERATION_SIGMAS * derivatives.acceleration_sigma).powi(2);
        let mut last = f64::NEG_INFINITY;
        for k in -SPIN_STEPS..=SPIN_STEPS {
            let x = place(k);
            let [before, here_score, after] = [k - 1, k, k + 1].map(|k| score(place(k)));
            let is_least = here_score <= before && here_score < after;
            // Where the acceleration hardly shows the spin, spins all over the range fit.
            let is_due = here_score <= fits && x - last >= SPIN_CELL;
            if is_least || is_due {
                last = x;
                found(here.state(range * x), cells(range * x, at(x)));
            }
        }
        if last == f64::NEG_INFINITY {
            // A sphere's path does not show its spin.
            found(here.state(0.0), cells(0.0, middle));
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

    fn point(&self, candidate: &Candidate) -> Point {
        Point { state: candidate.state, body: self.bodies[candidate.body].clone(), palm: Vector3::zeros() }
    }

    /// One step nearer from each, over a horizon; those that promise most, all different.
    fn approach(
        &self,
        track: &Track,
        points: Vec<Point>,
        horizon: f64,
        same: f64,
        count: usize,
        coverage: &mut Coverage,
    ) -> Starts {
        let effort = Effort { ranks: track.ranks(horizon), ..self.effort(horizon, 1) };
        let points = points.into_iter().take_while(|_| !self.halt.is_wished());
        let approached = points.filter_map(|point| self.unknowns.approach(track, &point, &effort));
        let mut promises: Vec<Promise> =
            approached.map(|approach| Promise { point: approach.point, cost: approach.promised }).collect();
        promises.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let best = promises.first().map_or(0.0, |promise| promise.cost);
        // Of unknown shapes there is always more than can be followed.
        let is_plausible = self.bodies.len() > 1 || best <= left_behind(track.numbers(effort.ranks) as f64);
        let least = if is_plausible { KEPT_MIN[0] } else { KEPT_MIN[1] };
        let mut kept: Vec<Point> = Vec::new();
        // Each is compared with all that are kept.
        for Promise { point, cost } in promises.into_iter().take_while(|_| !self.halt.is_wished()) {
            let is_hopeful = cost <= left_behind(best);
            if !is_hopeful && kept.len() >= least {
                break;
            }
            if kept.iter().any(|other| self.differ_points(other, &point) < same) {
                continue;
            }
            if kept.len() < count {
                kept.push(point);
            } else if is_hopeful {
                coverage.left_out += 1;
            }
        }
        Starts { points: kept, is_plausible }
    }

    fn differ_points(&self, a: &Point, b: &Point) -> f64 {
        let axes = (a.body.inertia() - b.body.inertia()).norm() / a.body.inertia().norm();
        self.differ(&a.body, &a.state, &b.state).max(axes)
    }

    /// How different two states are: the angle modulo symmetry, and the angular velocity in palm axes in units of
    /// √(g/size).
    fn differ(&self, body: &RollingBody, a: &RollState, b: &RollState) -> f64 {
        let (x, y) = (a.attitude(), b.attitude());
        let rate = (self.specific_force.norm() / body.size()).sqrt();
        body.symmetry().angle(&x, &y).hypot((x * a.omega - y * b.omega).norm() / rate)
    }

    fn effort(&self, horizon: f64, iterations: usize) -> Effort<'_> {
        let palm_sigma = if self.unknowns.columns.palm { PALM_SIGMA } else { f64::INFINITY };
        Effort {
            ranks: self.track.ranks(horizon),
            iterations,
            enough: Enough { relative: 1e-3, absolute: 0.02, damping_max: 1.0 },
            palm_sigma,
            norm: Norm::Squares,
            halt: self.halt,
        }
    }

    /// Fits each over a horizon; leaves behind what is hopeless and what has met another.
    fn fit_all(
        &self,
        points: Vec<Point>,
        horizon: f64,
        iterations: usize,
        width: &Width,
        coverage: &mut Coverage,
    ) -> Vec<RollFit> {
        self.fit_all_with(points, &self.effort(horizon, iterations), width, coverage)
    }

    fn fit_all_with(
        &self,
        points: Vec<Point>,
        effort: &Effort<'_>,
        width: &Width,
        coverage: &mut Coverage,
    ) -> Vec<RollFit> {
        let points = points.into_iter();
        let mut fits: Vec<RollFit> = points
            .take_while(|_| !self.halt.is_wished())
            .map(|point| self.unknowns.fit(self.track, point, effort))
            .collect();
        fits.retain(|fit| fit.cost.is_finite());
        fits.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let best = fits.first().map_or(0.0, |fit| fit.cost);
        let mut kept: Vec<RollFit> = Vec::new();
        for fit in fits {
            if fit.cost > left_behind(best) || kept.iter().any(|other| self.met(other, &fit)) {
                continue;
            }
            if kept.len() < width.kept { kept.push(fit) } else { coverage.left_out += 1 }
        }
        kept
    }

    fn met(&self, a: &RollFit, b: &RollFit) -> bool {
        let is_one_body = self.bodies.len() == 1;
        self.differ_points(&a.point, &b.point) < SAME_FIT
            || is_one_body && a.squared_deviations(&b.point) < SAME_DEVIATIONS * SAME_DEVIATIONS
    }
}

/// The cost above which a fit of some readings is none of all of them, if the best of some costs so much.
fn left_behind(best: f64) -> f64 {
    best * (1.0 + LEFT_BEHIND.0) + LEFT_BEHIND.1
}

/// An attitude with the angular velocity that makes the contact's velocity right, but for the spin.
struct Swaying<'a> {
    orientation: nalgebra::Quaternion<f64>,
    rotation: RotationMatrix,
    sway: Vector2<f64>,
    derivatives: &'a Derivatives,
}

impl<'a> Swaying<'a> {
    fn new(model: Model, attitude: &UnitQuaternion<f64>, derivatives: &'a Derivatives) -> Option<Self> {
        let orientation = attitude.into_inner();
        let rotation = RotationMatrix::of(&orientation);
        let hessian = model.body.shape().local(&-rotation.0[2], &Vector3::zeros()).hessian;
        let across = |i: usize, j: usize| rotation.0[i].dot(&(hessian * rotation.0[j]));
        // u' = (A H Aᵀ) (W_y, −W_x), because n × ω is (W_y, −W_x, 0) in palm axes.
        let inverse = Matrix2::new(across(0, 0), across(0, 1), across(1, 0), across(1, 1)).try_inverse()?;
        Some(Self { orientation, rotation, sway: inverse * derivatives.velocity, derivatives })
    }

    /// With this spin, rad/s.
    fn state(&self, spin: f64) -> RollState {
        let omega = self.rotation.to_body(&Vector3::new(-self.sway.y, self.sway.x, spin));
        RollState { orientation: self.orientation, omega, u: self.derivatives.u }
    }
}

/// The radius that a cell of each attitude has, rad: of SO(3), 8π² in all, or of the sphere of axes.
fn cell_radius(symmetry: Symmetry, attitudes: usize) -> f64 {
    let count = attitudes.max(1) as f64;
    match symmetry {
        Symmetry::Sphere => 0.0,
        Symmetry::Revolution { both_ways, .. } => (4.0 / count * if both_ways { 0.5 } else { 1.0 }).sqrt(),
        _ => {
            let order = symmetry.order().unwrap_or(1) as f64;
            (8.0 * PI * PI / order / count * 3.0 / (4.0 * PI)).cbrt()
        }
    }
}

/// The `count` with the least distance, in order.
fn nearest(mut candidates: Vec<Candidate>, count: usize) -> Vec<Candidate> {
    let by_distance = |a: &Candidate, b: &Candidate| -> Ordering { a.cells.total_cmp(&b.cells) };
    if candidates.len() > count && count > 0 {
        candidates.select_nth_unstable_by(count - 1, by_distance);
        candidates.truncate(count);
    }
    candidates.sort_by(by_distance);
    candidates
}
