//! Fitting a guess to what was felt by damped [`least_squares`], the mass found in closed form at every step.
//!
//! The force is the part's mass times what a guess predicts, so that for every guess the best mass follows at once. A
//! contact beyond its edge's end, or one that takes more friction than can be, adds to the cost instead of ending the
//! search: the minimum may lie at the limit. Where the friction of the plane is not known well, it is one more
//! parameter, and how far it is from what it is taken for adds to the cost too.
//!
//! Units: SI. Errors: none; a guess that cannot be played through has no fit.

use std::f64::consts::{PI, TAU};
use std::ops::AddAssign as _;

use nalgebra::{
    DMatrix, DVector, Isometry2, Matrix2, Matrix3, Matrix4, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector4,
    Vector6,
};

use super::felt::{Compared, Felt, OfNumber, Predicted};
use super::path::{Changed, Course, CourseStart, Guess, Path};
use super::valley::Valley;
use super::windowed_force::ONSET_RANGE;
use crate::math::least_squares::profile::Held;
use crate::math::least_squares::{self, Damping, Enough, Floor, LeastSquaresSettings, NormalEquations, minimise};
use crate::math::unscented::Gaussian;
use crate::pushing::dynamics::State;
use crate::pushing::estimation::observation::MU_G_LOG_MAX;

/// Largest friction coefficient between finger and part that is considered: rubber on a clean part.
pub(super) const MU_C_MAX: f64 = 1.0;

/// Least one: no dry contact has less.
pub(super) const MU_C_MIN: f64 = 0.02;

/// Places looked at on the border of what is likely.
const BORDER_PLACES: usize = 12;

/// A contact so far beyond its edge's end costs 1, m: a rounded corner.
const EDGE_SLACK_M: f64 = 1e-4;

/// Friction so far above the largest costs 1.
const FRICTION_SLACK: f64 = 0.01;

/// Steps of a fit.
const STEPS_MAX: usize = 30;

/// The friction that rolling needs is stated so many of its standard deviations below the best fit's.
const NEEDED_SDS: f64 = 3.0;

/// A step that lowers the cost by less ends the fit: a fiftieth of what one standard deviation does.
const COST_STEP: f64 = 0.02;

/// How a guess goes down. The floor lets what the data say nothing about stay where it is.
const DESCENT: LeastSquaresSettings<COLUMNS> = LeastSquaresSettings {
    damping: Damping {
        first: 1e-3,
        min: 0.0,
        max: 1e8,
        up: 5.0,
        min_after_failure: 0.0,
        down: 0.2,
        trusted_share: 0.0,
    },
    floor: Floor::Relative(1e-15),
    enough: Enough { relative: 0.0, absolute: COST_STEP, damping_max: f64::INFINITY },
    trials_max: usize::MAX,
    steps_max: STEPS_MAX,
};

/// Differences that stand for derivatives: rad, of the radius of gyration, of µ_c, of ln(µ g), s of the onset, rad/s, and
/// of the radius of gyration a second for what slides. Forces
/// change by some 1e-4 over them, a thousand times what rounding and the bisection of events leave.
const DIFFERENCES: [f64; PARAMETERS] = [1e-4, 1e-4, 1e-4, 1e-4, 1e-4, 1e-3, 1e-3];

/// Parameters of a guess: contact angle, place, friction of the contact, friction of the plane, delay of the onset; of a
/// part that moves at the start its angular velocity, and how it slides. The mass's logarithm follows them.
pub(super) const PARAMETERS: usize = 7;

/// Columns of the derivatives: the parameters and the mass's logarithm.
pub(super) const COLUMNS: usize = PARAMETERS + 1;

/// Where among them the friction of the contact is, and that of the plane.
const MU_C: usize = 2;
/// Column of ln(µ g) among the parameters.
const MU_G: usize = 3;

/// Column of the onset's delay among the parameters.
const DELAY: usize = 4;

/// Numbers of a push under way: u, s, ω, how it slides, µ_c, ln of µ g over what it is taken for, ln of the mass, and by how
/// much the finger's effective mass is off what it is taken for.
pub(super) const BELIEF: usize = 8;
/// Where among them the angular velocity is.
pub(super) const BELIEF_OMEGA: usize = 2;
/// By how much v_T is off that of a part that rolls.
pub(super) const BELIEF_SLIDE: usize = 3;
/// µ_c.
pub(super) const BELIEF_MU_C: usize = 4;
/// ln(µ g).
pub(super) const BELIEF_MU_G: usize = 5;
/// ln m.
pub(super) const BELIEF_MASS: usize = 6;
/// The finger's effective mass.
pub(super) const BELIEF_FINGER: usize = 7;

/// How far a number of outline or motion is moved to see what it changes, standard deviations: far enough for what rounding
/// and events leave, and near enough that edges do not cross.
pub(super) const SHARE_OF_SD: f64 = 0.3;

/// Numbers of pose and motion at the end: x, y, θ, velocity of the centre of mass, ω.
const MOTION: usize = 6;

/// The same with contact angle and place there.
const SAID: usize = MOTION + 2;

/// Differences of contact angle (rad) and place (m) that stand for second derivatives of a pose.
const SECOND_DIFFERENCES: [f64; 2] = [1e-3, 1e-4];

/// Column of the angular velocity at the start among the parameters.
const OMEGA: usize = 5;

/// Column of how the part slides at the start.
const SLIDE: usize = 6;

/// Fastest that a part may turn at the start, rad/s: more than a turn a second.
pub(super) const OMEGA_MAX: f64 = 10.0;

/// Fastest that it may slide, m/s.
pub(super) const SLIDE_MAX: f64 = 0.2;

/// What slides slower rolls, m/s.
pub(super) const SLIDE_MIN: f64 = 1e-6;

/// What adds to the cost beside the residuals: a contact beyond its edge, friction beyond reason, the plane's prior, the
/// onset's.
const PENALTIES: usize = 4;

/// Where among them the onset's is.
const DELAY_PENALTY: usize = 3;

/// What was felt and what is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Problem<'a, 'p> {
    pub(super) course: &'a Course<'p>,
    pub(super) measured: &'a dyn Felt,
    /// The part's mass, where it is known, kg.
    pub(super) mass: Option<f64>,
}

/// A guess with what came of it.
#[derive(Clone, Debug)]
pub(super) struct Tried {
    pub(super) guess: Guess,
    pub(super) path: Path,
    /// Best mass, kg.
    pub(super) mass: f64,
    /// Squared whitened residuals and penalties.
    pub(super) cost: f64,
    /// Whitened force per unit mass, and what is unsure about it.
    predicted: Predicted,
    /// What is felt and not explained, standard deviations.
    rest: DVector<f64>,
    /// What is asked too much.
    penalties: [f64; PENALTIES],
}

impl<'p> Problem<'_, 'p> {
    /// Plays a guess through.
    pub(super) fn try_guess(&self, guess: Guess) -> Option<Tried> {
        self.try_path(guess, self.course.play(&guess).ok()?)
    }

    /// The same, at the likeliest onset.
    pub(super) fn try_onsets(&self, guess: Guess) -> Option<Tried> {
        self.at_best_onset(self.try_guess(guess)?)
    }

    /// A guess with the likeliest of the onsets that are worth a try.
    fn at_best_onset(&self, tried: Tried) -> Option<Tried> {
        let onsets = self.measured.onsets_tried().into_iter().map(|delay| (self.cost_at(&tried, delay), delay));
        match onsets.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(cost, _)| *cost < tried.cost) {
            Some((_, delay)) => self.try_path(Guess { delay, ..tried.guess }, tried.path),
            None => Some(tried),
        }
    }

    /// Cost of a guess with another onset.
    fn cost_at(&self, tried: &Tried, delay: f64) -> f64 {
        let compared = self.measured.predicted(&tried.path, delay).compared(self.measured.data(), self.mass);
        let others = tried.penalties[..DELAY_PENALTY].iter().map(|value| value * value).sum::<f64>();
        if compared.mass > 0.0 { compared.cost + others + self.unlikely_delay(delay).powi(2) } else { f64::INFINITY }
    }

    fn unlikely_delay(&self, delay: f64) -> f64 {
        self.measured.onset_sd().map_or(0.0, |sd| delay / sd)
    }

    fn try_path(&self, guess: Guess, path: Path) -> Option<Tried> {
        let edge = self.course.part.edge(guess.edge).ok()?;
        let mut predicted = self.measured.predicted(&path, guess.delay);
        predicted.numbers = self.of_numbers(&guess, &path, &predicted);
        predicted.off = self.course.off.to_vec();
        let compared = predicted.compared(self.measured.data(), self.mass);
        let Compared { mass, rest, .. } = compared;
        if mass.is_nan() || mass <= 0.0 {
            return None;
        }
        let beyond = (edge.s_min - path.s_span[0]).max(path.s_span[1] - edge.s_max).max(0.0) / EDGE_SLACK_M;
        let needed = if guess.mu_c.is_finite() { 0.0 } else { (path.friction_needed - MU_C_MAX).max(0.0) };
        let unlikely = self.course.mu_g_log_sd.map_or(0.0, |sd| guess.mu_g_log / sd);
        let penalties = [beyond, needed / FRICTION_SLACK, unlikely, self.unlikely_delay(guess.delay)];
        let squares = |values: [f64; PENALTIES]| values.iter().map(|value| value * value).sum::<f64>();
        let cost = compared.cost + squares(penalties);
        Some(Tried { guess, path, mass, cost, predicted, rest, penalties })
    }

    /// What each number of outline and motion changes, one standard deviation off; nothing where that cannot be played.
    fn of_numbers(&self, guess: &Guess, path: &Path, predicted: &Predicted) -> Vec<OfNumber> {
        let per_mass = |changed: &'p Changed| {
            if let Changed::Friction(along) = changed
                && !(path.slipped && along.differs_within(&self.course.friction_along, path.s_span))
            {
                return None;
            }
            let path = self.course.with(changed).play(guess).ok()?;
            Some((self.measured.predicted(&path, guess.delay).shape - &predicted.shape) / SHARE_OF_SD)
        };
        let none = || DVector::zeros(predicted.shape.len());
        let carried = |changed: &Changed| match changed {
            Changed::Part(_) | Changed::Friction(_) => None,
            Changed::Motion(legs) => {
                let [before, after] = [&self.course.legs, legs].map(|legs| self.measured.carried(legs));
                // The finger's mass takes its part of what is read.
                before.zip(after).map(|(before, after)| (before - after) / SHARE_OF_SD)
            }
        };
        let of = |changed| OfNumber { per_mass: per_mass(changed).unwrap_or_else(none), carried: carried(changed) };
        self.course.changed.iter().map(of).collect()
    }

    /// Goes down to the nearest minimum.
    pub(super) fn descend(&self, start: Tried, steps_max: usize) -> Tried {
        let settings = LeastSquaresSettings { steps_max: steps_max.min(STEPS_MAX), ..DESCENT };
        let found = minimise(self, start, &settings, |_| false).place;
        // A jump of the force on the other side of a reading is a minimum of its own.
        let cost = found.cost;
        match self.at_best_onset(found.clone()) {
            Some(better) if better.cost < cost - COST_STEP => minimise(self, better, &settings, |_| false).place,
            _ => found,
        }
    }

    /// Goes down with one parameter held where it is.
    pub(super) fn fitted_beside(&self, held: usize, start: Tried, steps_max: usize) -> Tried {
        let settings = LeastSquaresSettings { steps_max, ..DESCENT };
        minimise(&Held { problem: self, unknown: held }, start, &settings, |_| false).place
    }

    fn differences(&self) -> [f64; PARAMETERS] {
        let [u, s, mu_c, mu_g_log, delay, omega, slide] = DIFFERENCES;
        let arm = self.course.part.inertia_per_mass().sqrt();
        [u, s * arm, mu_c, mu_g_log, delay, omega, slide * arm]
    }

    /// Whether a parameter is to be found, and changes anything.
    fn is_free(&self, at: &Tried, parameter: usize) -> bool {
        match parameter {
            MU_C => at.path.slipped && self.course.mu_c.is_none(),
            MU_G => self.course.mu_g_log_sd.is_some(),
            DELAY => self.measured.onset_sd().is_some(),
            OMEGA => self.course.start == CourseStart::Moving,
            SLIDE => at.guess.slide != 0.0,
            _ => true,
        }
    }

    /// Derivatives of the whitened residuals, penalties included, by the parameters and the mass's logarithm.
    fn slopes(&self, at: &Tried) -> DMatrix<f64> {
        let size = at.predicted.shape.len();
        let mut slopes = DMatrix::zeros(size + PENALTIES, COLUMNS);
        if self.mass.is_none() {
            slopes.view_mut((0, PARAMETERS), (size, 1)).copy_from(&(&at.predicted.shape * -at.mass));
        }
        for (column, difference) in self.differences().into_iter().enumerate() {
            if !self.is_free(at, column) {
                continue;
            }
            if column == DELAY {
                // The push is the same, read at other times.
                let moved = self.measured.predicted(&at.path, at.guess.delay + difference).shape;
                slopes
                    .view_mut((0, DELAY), (size, 1))
                    .copy_from(&((&at.predicted.shape - moved) * (at.mass / difference)));
                slopes[(size + DELAY_PENALTY, DELAY)] = self.unlikely_delay(1.0);
                continue;
            }
            let course = self.course.sure();
            let sure = Problem { course: &course, measured: self.measured, mass: self.mass };
            let aside =
                beside(&at.guess, column, difference).find_map(|(step, guess)| Some((step, sure.try_guess(guess)?)));
            let Some((step, moved)) = aside else { continue };
            let change = (&at.predicted.shape - &moved.predicted.shape) * (at.mass / step);
            slopes.view_mut((0, column), (size, 1)).copy_from(&change);
            for (row, (after, before)) in moved.penalties.iter().zip(at.penalties).enumerate() {
                slopes[(size + row, column)] = (after - before) / step;
            }
        }
        slopes
    }

    /// Of slopes, that of the cost, all nuisances being found for every guess.
    fn curvature(&self, at: &Tried, slopes: &DMatrix<f64>) -> DMatrix<f64> {
        let all = slopes.tr_mul(slopes);
        let nuisances: Vec<_> = at.predicted.nuisances(at.mass).collect();
        if nuisances.is_empty() {
            return all;
        }
        let nuisances = DMatrix::from_columns(&nuisances);
        let across = nuisances.tr_mul(&slopes.rows(0, nuisances.nrows()));
        let own = nuisances.tr_mul(&nuisances) + DMatrix::identity(nuisances.ncols(), nuisances.ncols());
        // Positive definite, being a square and one.
        own.cholesky().map_or_else(|| all.clone(), |own| &all - across.tr_mul(&own.solve(&across)))
    }

    /// Standard deviations of the parameters before anything is felt, each being anywhere in its range.
    fn ranges(&self, at: &Tried) -> [f64; PARAMETERS] {
        let length = self.course.part.edge(at.guess.edge).map_or(f64::INFINITY, |edge| edge.s_max - edge.s_min);
        // The plane's friction and the onset have priors of their own.
        let (omega, slide) = (2.0 * OMEGA_MAX, 2.0 * SLIDE_MAX);
        [PI, length, MU_C_MAX - MU_C_MIN, f64::INFINITY, f64::INFINITY, omega, slide]
            .map(|range| range / 12.0_f64.sqrt())
    }

    /// Covariance of the guess's parameters. Those that no slope tells of, since they make no difference or are held,
    /// count as known.
    fn covariance(&self, at: &Tried) -> Option<DMatrix<f64>> {
        self.covariance_near(at, f64::INFINITY)
    }

    /// The same where the contact angle at the start is known so well beside, rad.
    fn covariance_near(&self, at: &Tried, u_sd: f64) -> Option<DMatrix<f64>> {
        let slopes = self.slopes(at);
        let mut normal = self.curvature(at, &slopes);
        // What slopes say nothing about is still within its range: a contact that slips for a moment tells little of
        // its friction.
        for (i, deviation) in self.ranges(at).into_iter().enumerate() {
            normal[(i, i)] += if normal[(i, i)] > 0.0 { 1.0 / (deviation * deviation) } else { 0.0 };
        }
        normal[(0, 0)] += u_sd.powi(-2);
        let silent: Vec<_> = (0..normal.nrows()).filter(|&i| normal[(i, i)] <= 0.0).collect();
        silent.iter().for_each(|&i| normal[(i, i)] = 1.0);
        let mut covariance = normal.cholesky()?.inverse();
        silent.iter().for_each(|&i| covariance[(i, i)] = 0.0);
        Some(covariance)
    }

    /// The valley of a minimum, where it bends.
    #[cfg(test)]
    pub(super) fn valley(&self, at: &Tried) -> Option<Valley> {
        let slopes = self.end_slopes(at)?;
        Valley::through(self, at, &self.covariance(at)?, &slopes.state)
    }

    /// Contact angles and places so many standard deviations from a minimum, all round it.
    pub(super) fn border(&self, at: &Tried, sds: f64) -> Option<[[f64; 2]; BORDER_PLACES]> {
        let covariance = self.covariance(at)?.fixed_view::<2, 2>(0, 0).into_owned();
        let lower = covariance.cholesky()?.unpack();
        let place = |index: usize| {
            let (sin, cos) = (TAU * index as f64 / BORDER_PLACES as f64).sin_cos();
            let off: Vector2<f64> = lower * Vector2::new(cos, sin) * sds;
            [at.guess.u + off.x, at.guess.s + off.y]
        };
        Some(std::array::from_fn(place))
    }

    /// How the end follows the parameters, by differences to the side that can be played.
    fn end_slopes(&self, at: &Tried) -> Option<EndSlopes> {
        let end = self.course.pose_at_end(&at.guess, &at.path)?;
        let mut pose = SMatrix::<f64, 3, PARAMETERS>::zeros();
        let mut state = SMatrix::<f64, 4, PARAMETERS>::zeros();
        let mut needed = SVector::<f64, PARAMETERS>::zeros();
        for (column, step) in self.differences().into_iter().enumerate() {
            // The end is a time of the motion: when it began elsewhere changes nothing of it.
            if column == DELAY || !self.is_free(at, column) {
                continue;
            }
            let played = |(step, guess)| Some((step, guess, self.course.play(&guess).ok()?));
            let (step, guess, path) = beside(&at.guess, column, step).find_map(played)?;
            pose.set_column(column, &(difference(&end, &self.course.pose_at_end(&guess, &path)?) / step));
            state.set_column(column, &((vector(&path.end) - vector(&at.path.end)) / step));
            needed[column] = (path.friction_needed - at.path.friction_needed) / step;
        }
        Some(EndSlopes { pose, state, needed })
    }

    /// What is uncertain at the end.
    pub(super) fn end_covariance(&self, at: &Tried) -> Option<EndCovariance> {
        let parameters = self.covariance(at)?;
        let end = self.course.pose_at_end(&at.guess, &at.path)?;
        let EndSlopes { pose, state, needed } = self.end_slopes(at)?;
        let valley = Valley::through(self, at, &parameters, &state);
        let mut all = parameters.fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned();
        let held = all.fixed_view::<PARAMETERS, PARAMETERS>(0, 0).into_owned();
        // J C Jᵀ.
        let mut pose_covariance = pose * held * pose.transpose();
        let mut state_covariance = state * held * state.transpose();
        let needed_sd = (needed.transpose() * held * needed)[0].max(0.0).sqrt();
        if let Some(valley) = valley {
            let straight = valley.straight.fixed_rows::<PARAMETERS>(0).into_owned();
            all = valley.covered(all, valley.straight, |side| Some(side.parameters));
            state_covariance = valley.covered(state_covariance, state * straight, |side| {
                Some((vector(&side.end.path.end) - vector(&at.path.end)) / side.sds)
            });
            pose_covariance = valley.covered(pose_covariance, pose * straight, |side| {
                let there = self.course.pose_at_end(&side.end.guess, &side.end.path)?;
                Some(difference(&end, &there) / side.sds)
            });
        }
        let deviation = |parameter: usize| all[(parameter, parameter)].max(0.0).sqrt();
        let (mu_g_log_sd, mass_log_sd) = (deviation(MU_G), deviation(PARAMETERS));
        // Variance of ln(µ g) + ln m, which a slow push feels as one number.
        let weight_variance = deviation(MU_G).powi(2) + deviation(PARAMETERS).powi(2) + 2.0 * all[(MU_G, PARAMETERS)];
        Some(EndCovariance {
            mu_c_sd: at.path.slipped.then(|| deviation(MU_C)),
            friction_needed: (at.path.friction_needed - NEEDED_SDS * needed_sd).max(0.0),
            mu_g_log_sd,
            mass_log_sd,
            resistance_log_sd: weight_variance.max(0.0).sqrt(),
            pose: pose_covariance,
            state: state_covariance,
            spread: all.fixed_view::<2, 2>(0, 0).determinant().max(0.0).sqrt(),
        })
    }
}

impl<'p> Problem<'_, 'p> {
    /// The end of a push of a part: x, y, θ of its frame, velocity of its centre of mass, ω.
    fn end_of(course: &Course<'p>, guess: &Guess, path: &Path) -> Option<End> {
        let pose = course.pose_at_end(guess, path)?;
        Some(End { pose, velocity: course.velocity_at_end(guess, path)?, omega: path.end.omega })
    }

    /// Covariance of pose and motion at the end (x, y, θ, velocity of the centre of mass, ω), with everything that is
    /// not known, outline, motion and what adds to the force included.
    pub(super) fn motion_covariance(&self, at: &Tried) -> Option<Matrix6<f64>> {
        let course = self.course.sure();
        let end = Self::end_of(&course, &at.guess, &at.path)?;
        let to = |course: &Course<'p>, guess: &Guess, path: &Path| {
            let said = end.to(&Self::end_of(course, guess, path)?);
            let contact = Vector2::new(path.end.u - at.path.end.u, path.end.s - at.path.end.s);
            Some(SVector::<f64, SAID>::from_fn(|row, _| if row < MOTION { said[row] } else { contact[row - MOTION] }))
        };
        let parameters = self.covariance(at)?;
        let OfEnd { slopes, of_nuisances, covariance } = self.of_end(at, to, &SMatrix::zeros(), None, &parameters)?;
        let state = self.end_slopes(at)?.state;
        if let Some(valley) = Valley::through(self, at, &parameters, &state) {
            let taken = self.taken_of_nuisances(at);
            let covered = valley.covered(covariance, slopes * valley.straight, |side| {
                // Along the valley the numbers are found anew, too.
                let more = DVector::from_vec(self.taken_of_nuisances(&side.end)) - DVector::from_column_slice(&taken);
                let of_numbers = (&of_nuisances * more).fixed_view::<SAID, 1>(0, 0).into_owned();
                Some((to(&course, &side.end.guess, &side.end.path)? + of_numbers) / side.sds)
            });
            return Some(covered.fixed_view::<MOTION, MOTION>(0, 0).into_owned());
        }
        let contact = covariance.fixed_view::<2, 2>(MOTION, MOTION).into_owned();
        let mut covariance = covariance.fixed_view::<MOTION, MOTION>(0, 0).into_owned();
        let bent = self.bent_away(at, &contact)?;
        covariance.fixed_view_mut::<3, 3>(0, 0).add_assign(&bent);
        Some(covariance)
    }

    /// Second moments of what slopes leave out of the pose at the end (x, y, θ), for a covariance of contact angle and
    /// place there: poses with one edge in contact lie on a surface that bends, and what is hardly known is far along it.
    fn bent_away(&self, at: &Tried, contact: &Matrix2<f64>) -> Option<Matrix3<f64>> {
        let course = self.course.sure();
        let there = |u: f64, s: f64| {
            let end = State { u: at.path.end.u + u, s: at.path.end.s + s, ..at.path.end };
            course.pose_of_end(&at.guess, &end)
        };
        let here = there(0.0, 0.0)?;
        let to = |u: f64, s: f64| Some(difference(&here, &there(u, s)?));
        let [h_u, h_s] = SECOND_DIFFERENCES;
        let second_u = (to(h_u, 0.0)? + to(-h_u, 0.0)?) / (h_u * h_u);
        let both = (to(h_u, h_s)? + to(-h_u, -h_s)? - to(h_u, -h_s)? - to(-h_u, h_s)?) / (4.0 * h_u * h_s);
        // Straight along the edge: nothing of second order by s alone.
        let (uu, us, ss) = (contact[(0, 0)], contact[(0, 1)], contact[(1, 1)]);
        // x = ½ a u² + b u s of a normal (u, s): E[u⁴] = 3 uu², E[u³ s] = 3 uu us, E[u² s²] = uu ss + 2 us².
        let product = |a: &Vector3<f64>, b: &Vector3<f64>| a * b.transpose();
        Some(
            product(&second_u, &second_u) * (0.75 * uu * uu)
                + (product(&second_u, &both) + product(&both, &second_u)) * (1.5 * uu * us)
                + product(&both, &both) * (uu * ss + 2.0 * us * us),
        )
    }

    /// State and unknown numbers at the end, as one who follows the push goes on from them.
    /// For the contact angle at the start within so much of what it is there, rad.
    pub(super) fn belief_at_end(&self, at: &Tried, effective_mass_sd: f64, u_sd: f64) -> Option<Gaussian<BELIEF>> {
        let course = self.course.sure();
        let end = Self::followed_of(&course, &at.guess, &at.path)?;
        let to = |course: &Course<'p>, guess: &Guess, path: &Path| {
            let after = Self::followed_of(course, guess, path)? - end;
            Some(SVector::from_fn(|row, _| if row < 4 { after[row] } else { 0.0 }))
        };
        let mut own = SMatrix::<f64, BELIEF, COLUMNS>::zeros();
        own[(BELIEF_MU_C, MU_C)] = 1.0;
        own[(BELIEF_MU_G, MU_G)] = 1.0;
        own[(BELIEF_MASS, PARAMETERS)] = 1.0;
        let mut mean = SVector::<f64, BELIEF>::zeros();
        mean.fixed_rows_mut::<4>(0).copy_from(&end);
        mean[BELIEF_MU_C] = at.guess.mu_c;
        mean[BELIEF_MU_G] = at.guess.mu_g_log;
        mean[BELIEF_MASS] = at.mass.ln();
        mean[BELIEF_FINGER] = effective_mass_sd * self.taken_beside(at);
        let of_beside = SVector::from_fn(|row, _| if row == BELIEF_FINGER { effective_mass_sd } else { 0.0 });
        let parameters = self.covariance_near(at, u_sd)?;
        let covariance = self.of_end(at, to, &own, Some(of_beside), &parameters)?.covariance;
        Some(Gaussian { mean, covariance })
    }

    /// u, s, ω and how it slides at the end.
    fn followed_of(course: &Course<'p>, guess: &Guess, path: &Path) -> Option<Vector4<f64>> {
        Some(Vector4::new(path.end.u, path.end.s, path.end.omega, course.slide_at_end(guess, path)?))
    }

    /// How what is said of the end follows the parameters, and its covariance with everything that is not known: `to` is how
    /// that of another push differs, `own` what follows the parameters whatever the push does, `of_beside` the same for
    /// a standard deviation of what adds to the force.
    fn of_end<const N: usize>(
        &self,
        at: &Tried,
        to: impl Fn(&Course<'p>, &Guess, &Path) -> Option<SVector<f64, N>>,
        own: &SMatrix<f64, N, COLUMNS>,
        of_beside: Option<SVector<f64, N>>,
        parameters: &DMatrix<f64>,
    ) -> Option<OfEnd<N>> {
        let course = self.course.sure();
        let nuisances: Vec<_> = at.predicted.nuisances(at.mass).collect();
        let mut of_end = *own;
        for (column, step) in self.differences().into_iter().enumerate() {
            if column == DELAY || !self.is_free(at, column) {
                continue;
            }
            let played = |(step, guess)| Some((step, to(&course, &guess, &course.play(&guess).ok()?)?));
            let (step, there) = beside(&at.guess, column, step).find_map(played)?;
            of_end.column_mut(column).add_assign(&(there / step));
        }
        let parameters = parameters.fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned();
        if nuisances.is_empty() {
            let covariance = of_end * parameters * of_end.transpose();
            return Some(OfEnd { slopes: of_end, of_nuisances: DMatrix::zeros(N, 0), covariance });
        }
        let mut of_nuisances = vec![SVector::<f64, N>::zeros(); nuisances.len()];
        for (changed, of_nuisance) in self.course.changed.iter().zip(&mut of_nuisances) {
            let course = course.with(changed);
            let there = course.play(&at.guess).ok().and_then(|path| to(&course, &at.guess, &path));
            *of_nuisance = there.map_or_else(SVector::zeros, |there| there / SHARE_OF_SD);
        }
        let beside = of_nuisances.iter_mut().skip(self.course.changed.len()).zip(of_beside);
        beside.for_each(|(of_nuisance, of_beside)| *of_nuisance = of_beside);
        // J C Jᵀ, nuisances eliminated: what they are for given parameters, and what that leaves open.
        let by_parameters = self.slopes(at);
        let columns = DMatrix::from_columns(&nuisances);
        let curvature = columns.tr_mul(&columns) + DMatrix::identity(columns.ncols(), columns.ncols());
        let curvature = curvature.cholesky()?;
        let of_nuisances = DMatrix::from_fn(N, of_nuisances.len(), |row, column| of_nuisances[column][row]);
        // Residuals are data less prediction: the nuisances' slopes have the other sign.
        let across = columns.tr_mul(&by_parameters.rows(0, columns.nrows()));
        let slopes = of_end + (&of_nuisances * curvature.solve(&across)).fixed_view::<N, COLUMNS>(0, 0);
        let open = &of_nuisances * curvature.solve(&of_nuisances.transpose());
        let covariance = slopes * parameters * slopes.transpose() + open.fixed_view::<N, N>(0, 0);
        Some(OfEnd { slopes, of_nuisances, covariance })
    }
}

/// What is said of the end.
struct OfEnd<const N: usize> {
    /// Its derivatives by the parameters and the mass's logarithm, all else being the best for these.
    slopes: SMatrix<f64, N, COLUMNS>,
    /// By a standard deviation of each of [`Predicted::nuisances`].
    of_nuisances: DMatrix<f64>,
    covariance: SMatrix<f64, N, N>,
}

impl Problem<'_, '_> {
    /// How many standard deviations each number of outline and motion is off what it is taken for, of a guess.
    pub(super) fn taken_of_numbers(&self, at: &Tried) -> Vec<f64> {
        let mut taken = self.taken_of_nuisances(at);
        taken.truncate(at.predicted.numbers.len());
        taken
    }

    /// How many standard deviations each of [`Predicted::nuisances`] is off, of a guess.
    fn taken_of_nuisances(&self, at: &Tried) -> Vec<f64> {
        // What remains of a residual is whitened by it: a column's share of the rest is what was taken.
        at.predicted.nuisances(at.mass).map(|column| column.dot(&at.rest)).collect()
    }

    /// How many standard deviations what adds to the force whatever the part's mass is off, of a guess.
    pub(super) fn taken_beside(&self, at: &Tried) -> f64 {
        at.predicted.beside.first().map_or(0.0, |column| column.dot(&at.rest))
    }

    /// Square root of the determinant of the covariance of contact angle and place at the start.
    pub(super) fn spread(&self, at: &Tried) -> Option<f64> {
        self.spread_near(at, f64::INFINITY)
    }

    /// The same where the contact angle is known so well beside, rad.
    pub(super) fn spread_near(&self, at: &Tried, u_sd: f64) -> Option<f64> {
        Some(self.covariance_near(at, u_sd)?.fixed_view::<2, 2>(0, 0).determinant().max(0.0).sqrt())
    }
}

/// Pose and motion at the end.
struct End {
    pose: Isometry2<f64>,
    velocity: Vector2<f64>,
    omega: f64,
}

impl End {
    /// How another differs: x, y, θ, velocity, ω.
    fn to(&self, other: &Self) -> Vector6<f64> {
        let pose = difference(&self.pose, &other.pose);
        let velocity = other.velocity - self.velocity;
        Vector6::new(pose.x, pose.y, pose.z, velocity.x, velocity.y, other.omega - self.omega)
    }
}

/// Derivatives of what is said of the end by the parameters.
struct EndSlopes {
    /// Of x, y, θ.
    pose: SMatrix<f64, 3, PARAMETERS>,
    /// Of u, s, ω, v_T.
    state: SMatrix<f64, 4, PARAMETERS>,
    /// Of the friction that rolling takes.
    needed: SVector<f64, PARAMETERS>,
}

impl least_squares::LeastSquaresProblem<COLUMNS> for Problem<'_, '_> {
    type Place = Tried;

    fn cost(&self, tried: &Tried) -> f64 {
        tried.cost
    }

    fn normal_equations(&self, tried: &Tried) -> NormalEquations<COLUMNS> {
        let (size, slopes) = (tried.predicted.shape.len(), self.slopes(tried));
        let mut residuals = DVector::zeros(size + PENALTIES);
        residuals.rows_mut(0, size).copy_from(&tried.rest);
        residuals.rows_mut(size, PENALTIES).copy_from_slice(&tried.penalties);
        NormalEquations {
            cost: tried.cost,
            gradient: slopes.tr_mul(&residuals).fixed_rows::<COLUMNS>(0).into_owned(),
            curvature: self.curvature(tried, &slopes).fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned(),
        }
    }

    /// The mass of a step is not looked at: every guess has its own best one.
    fn moved(&self, tried: &Tried, step: &SVector<f64, COLUMNS>) -> Option<Tried> {
        let mut guess = (0..PARAMETERS).fold(tried.guess, |guess, column| moved(&guess, column, step[column]));
        let latest = self.measured.onset_sd().map_or(0.0, |sd| ONSET_RANGE * sd);
        guess.delay = guess.delay.clamp(-latest, latest);
        self.try_guess(guess)
    }
}

/// What is uncertain at the end of a fit.
pub(super) struct EndCovariance {
    /// Of x, y, θ.
    pub(super) pose: Matrix3<f64>,
    /// Of u, s, ω, v_T.
    pub(super) state: Matrix4<f64>,
    /// Square root of the determinant for contact angle and place at the start.
    pub(super) spread: f64,
    /// Standard deviation of µ_c, where the contact slipped.
    pub(super) mu_c_sd: Option<f64>,
    /// Friction that rolling took, at the least.
    pub(super) friction_needed: f64,
    /// Standard deviation of ln(µ g); 0 where it is known.
    pub(super) mu_g_log_sd: f64,
    /// Of the mass's logarithm.
    pub(super) mass_log_sd: f64,
    /// Of the logarithm of their product.
    pub(super) resistance_log_sd: f64,
}

pub(super) fn vector(state: &State) -> Vector4<f64> {
    Vector4::new(state.u, state.s, state.omega, state.v_t)
}

/// From one pose to another: x, y, θ.
pub(super) fn difference(from: &Isometry2<f64>, to: &Isometry2<f64>) -> Vector3<f64> {
    let shift = to.translation.vector - from.translation.vector;
    Vector3::new(shift.x, shift.y, from.rotation.angle_to(&to.rotation))
}

/// A guess with one parameter changed by a difference, or the other way: at a limit, or where nothing can be played,
/// that will do.
fn beside(guess: &Guess, parameter: usize, difference: f64) -> impl Iterator<Item = (f64, Guess)> {
    let guess = *guess;
    let changed = [difference, -difference].into_iter().map(move |step| (step, moved(&guess, parameter, step)));
    changed.filter(move |(_, changed)| *changed != guess)
}

/// A guess with one parameter changed, within its limits.
pub(super) fn moved(guess: &Guess, parameter: usize, by: f64) -> Guess {
    let mut guess = *guess;
    if by == 0.0 {
        return guess;
    }
    match parameter {
        0 => guess.u += by,
        1 => guess.s += by,
        DELAY => guess.delay += by,
        OMEGA => guess.omega = (guess.omega + by).clamp(-OMEGA_MAX, OMEGA_MAX),
        // It slides the way that it does.
        SLIDE if guess.slide != 0.0 => {
            guess.slide =
                guess.slide.signum() * ((guess.slide + by) * guess.slide.signum()).clamp(SLIDE_MIN, SLIDE_MAX);
        }
        SLIDE => {}
        MU_G => guess.mu_g_log = (guess.mu_g_log + by).clamp(-MU_G_LOG_MAX, MU_G_LOG_MAX),
        _ if guess.mu_c.is_finite() => guess.mu_c = (guess.mu_c + by).clamp(MU_C_MIN, MU_C_MAX),
        _ => {}
    }
    guess
}
