//! Fitting a guess to what was felt by damped [`least_squares`], the mass found in closed form at every step.
//!
//! The force is the part's mass times what a guess predicts, so that for every guess the best mass follows at once. A
//! contact beyond its edge's end, or one that takes more friction than can be, adds to the cost instead of ending the
//! search: the minimum may lie at the limit. Where the friction of the plane is not known well, it is one more
//! parameter, and how far it is from what it is taken for adds to the cost too.
//!
//! Units: SI. Errors: none; a guess that cannot be played through has no fit.

use std::f64::consts::{PI, TAU};

use nalgebra::{DMatrix, DVector, Isometry2, Matrix3, Matrix4, SMatrix, SVector, Vector2, Vector3, Vector4};

use super::path::{Course, Guess, Path};
use super::valley::Valley;
use super::windowed_force::{Compared, ONSET_RANGE, WindowedForce};
use crate::math::least_squares::profile::Held;
use crate::math::least_squares::{self, Damping, Enough, Floor, LeastSquaresSettings, NormalEquations, minimise};
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

/// Differences that stand for derivatives: rad, of the radius of gyration, of µ_c, of ln(µ g), s of the onset. Forces
/// change by some 1e-4 over them, a thousand times what rounding and the bisection of events leave.
const DIFFERENCES: [f64; PARAMETERS] = [1e-4, 1e-4, 1e-4, 1e-4, 1e-4];

/// Parameters of a guess: contact angle, place, friction of the contact, friction of the plane, delay of the onset. The
/// mass's logarithm follows them.
pub(super) const PARAMETERS: usize = 5;

/// Columns of the derivatives: the parameters and the mass's logarithm.
pub(super) const COLUMNS: usize = PARAMETERS + 1;

/// Where among them the friction of the contact is, and that of the plane.
const MU_C: usize = 2;
/// Column of ln(µ g) among the parameters.
const MU_G: usize = 3;

/// Column of the onset's delay among the parameters.
const DELAY: usize = 4;

/// What adds to the cost beside the residuals: a contact beyond its edge, friction beyond reason, the plane's prior, the
/// onset's.
const PENALTIES: usize = 4;

/// Where among them the onset's is.
const DELAY_PENALTY: usize = 3;

/// What was felt and what is known.
#[derive(Clone, Copy, Debug)]
pub(super) struct Problem<'a, 'p> {
    pub(super) course: &'a Course<'p>,
    pub(super) measured: &'a WindowedForce,
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
    /// Whitened force per unit mass.
    shape: DVector<f64>,
    /// What is felt and not explained, standard deviations.
    rest: DVector<f64>,
    /// What is asked too much.
    penalties: [f64; PENALTIES],
}

impl Problem<'_, '_> {
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
        let onsets = self.measured.onsets_tried().map(|delay| (self.cost_at(&tried, delay), delay));
        match onsets.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|(cost, _)| *cost < tried.cost) {
            Some((_, delay)) => self.try_path(Guess { delay, ..tried.guess }, tried.path),
            None => Some(tried),
        }
    }

    /// Cost of a guess with another onset.
    fn cost_at(&self, tried: &Tried, delay: f64) -> f64 {
        let compared = self.measured.predicted(&tried.path, delay).compared(self.measured.data());
        let others = tried.penalties[..DELAY_PENALTY].iter().map(|value| value * value).sum::<f64>();
        if compared.mass > 0.0 { compared.cost + others + self.unlikely_delay(delay).powi(2) } else { f64::INFINITY }
    }

    fn unlikely_delay(&self, delay: f64) -> f64 {
        self.measured.onset_sd().map_or(0.0, |sd| delay / sd)
    }

    fn try_path(&self, guess: Guess, path: Path) -> Option<Tried> {
        let edge = self.course.part.edge(guess.edge).ok()?;
        let predicted = self.measured.predicted(&path, guess.delay);
        let compared = predicted.compared(self.measured.data());
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
        Some(Tried { guess, path, mass, cost, shape: predicted.shape, rest, penalties })
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
        let [u, s, mu_c, mu_g_log, delay] = DIFFERENCES;
        [u, s * self.course.part.inertia_per_mass().sqrt(), mu_c, mu_g_log, delay]
    }

    /// Whether a parameter is to be found, and changes anything.
    fn is_free(&self, at: &Tried, parameter: usize) -> bool {
        match parameter {
            MU_C => at.path.slipped,
            MU_G => self.course.mu_g_log_sd.is_some(),
            DELAY => self.measured.onset_sd().is_some(),
            _ => true,
        }
    }

    /// Derivatives of the whitened residuals, penalties included, by the parameters and the mass's logarithm.
    fn slopes(&self, at: &Tried) -> DMatrix<f64> {
        let size = at.shape.len();
        let mut slopes = DMatrix::zeros(size + PENALTIES, COLUMNS);
        slopes.view_mut((0, PARAMETERS), (size, 1)).copy_from(&(&at.shape * -at.mass));
        for (column, difference) in self.differences().into_iter().enumerate() {
            if !self.is_free(at, column) {
                continue;
            }
            if column == DELAY {
                // The push is the same, read at other times.
                let moved = self.measured.predicted(&at.path, at.guess.delay + difference).shape;
                slopes.view_mut((0, DELAY), (size, 1)).copy_from(&((&at.shape - moved) * (at.mass / difference)));
                slopes[(size + DELAY_PENALTY, DELAY)] = self.unlikely_delay(1.0);
                continue;
            }
            let aside =
                beside(&at.guess, column, difference).find_map(|(step, guess)| Some((step, self.try_guess(guess)?)));
            let Some((step, moved)) = aside else { continue };
            let change = (&at.shape - &moved.shape) * (at.mass / step);
            slopes.view_mut((0, column), (size, 1)).copy_from(&change);
            for (row, (after, before)) in moved.penalties.iter().zip(at.penalties).enumerate() {
                slopes[(size + row, column)] = (after - before) / step;
            }
        }
        slopes
    }

    /// Standard deviations of the parameters before anything is felt, each being anywhere in its range.
    fn ranges(&self, at: &Tried) -> [f64; PARAMETERS] {
        let length = self.course.part.edge(at.guess.edge).map_or(f64::INFINITY, |edge| edge.s_max - edge.s_min);
        // The plane's friction and the onset have priors of their own.
        [PI, length, MU_C_MAX - MU_C_MIN, f64::INFINITY, f64::INFINITY].map(|range| range / 12.0_f64.sqrt())
    }

    /// Covariance of the guess's parameters. Those that no slope tells of, since they make no difference or are held,
    /// count as known.
    fn covariance(&self, at: &Tried) -> Option<DMatrix<f64>> {
        let slopes = self.slopes(at);
        let mut normal = slopes.tr_mul(&slopes);
        // What slopes say nothing about is still within its range: a contact that slips for a moment tells little of
        // its friction.
        for (i, deviation) in self.ranges(at).into_iter().enumerate() {
            normal[(i, i)] += if normal[(i, i)] > 0.0 { 1.0 / (deviation * deviation) } else { 0.0 };
        }
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
        let (size, slopes) = (tried.shape.len(), self.slopes(tried));
        let mut residuals = DVector::zeros(size + PENALTIES);
        residuals.rows_mut(0, size).copy_from(&tried.rest);
        residuals.rows_mut(size, PENALTIES).copy_from_slice(&tried.penalties);
        NormalEquations {
            cost: tried.cost,
            gradient: slopes.tr_mul(&residuals).fixed_rows::<COLUMNS>(0).into_owned(),
            curvature: slopes.tr_mul(&slopes).fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned(),
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
    match parameter {
        0 => guess.u += by,
        1 => guess.s += by,
        DELAY => guess.delay += by,
        MU_G => guess.mu_g_log = (guess.mu_g_log + by).clamp(-MU_G_LOG_MAX, MU_G_LOG_MAX),
        _ if guess.mu_c.is_finite() => guess.mu_c = (guess.mu_c + by).clamp(MU_C_MIN, MU_C_MAX),
        _ => {}
    }
    guess
}
