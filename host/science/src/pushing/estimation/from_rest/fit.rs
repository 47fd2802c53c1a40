//! Fitting a guess to what was felt by damped [`least_squares`], the mass found in closed form at every step.
//!
//! The force is the part's mass times what a guess predicts, so that for every guess the best mass follows at once. A
//! contact beyond its edge's end, or one that takes more friction than can be, adds to the cost instead of ending the
//! search: the minimum may lie at the limit. Where the friction of the plane is not known well, it is one more
//! parameter, and how far it is from what it is taken for adds to the cost too.
//!
//! Units: SI. Errors: none; a guess that cannot be played through has no fit.

use std::f64::consts::{PI, TAU};

use nalgebra::{DMatrix, DVector, Matrix2, SMatrix, SVector, Vector2, Vector4};

use super::felt::{Compared, Felt, NumberOff, OfNumber, Predicted};
use super::model::{range, sought};
use super::path::{Changed, Course, CourseStart, Guess, Path};
use super::symmetry::ROUND;
use super::windowed_force::ONSET_RANGE;
use crate::math::least_squares::profile::Held;
use crate::math::least_squares::{self, Damping, Enough, Floor, LeastSquaresSettings, NormalEquations, minimise};
use crate::pushing::dynamics::{FingerShape, PartSide, State};
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

/// Where among them the contact angle is.
const CONTACT_ANGLE: usize = 0;

/// The place.
const PLACE: usize = 1;

/// Where among them the friction of the contact is, and that of the plane.
pub(super) const MU_C: usize = 2;
/// Column of ln(µ g) among the parameters.
pub(super) const MU_G: usize = 3;

/// Column of the onset's delay among the parameters.
pub(super) const DELAY: usize = 4;

/// How far a number of outline or motion is moved to see what it changes, standard deviations: far enough for what rounding
/// and events leave, and near enough that what it changes is straight. With 0.3 fits end beside their minimum where a centre
/// of mass 3 mm off changes the force by hundreds of its deviations.
pub(super) const SHARE_OF_SD: f64 = 0.02;

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

/// A contact that rolls although that takes nearly the largest friction is not excluded.
const ROLLING_SHARE_MIN: f64 = 1e-3;

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
    pub(super) predicted: Predicted,
    /// What is felt and not explained, standard deviations.
    rest: DVector<f64>,
    /// What is asked too much.
    penalties: [f64; PENALTIES],
}

impl Tried {
    /// What is felt and not explained, standard deviations.
    pub(super) fn rest(&self) -> &DVector<f64> {
        &self.rest
    }
}

/// A guess and what is beside it: all that is said of how certain it is rests on these.
pub(super) struct Around<'t> {
    pub(super) at: &'t Tried,
    /// Derivatives of the whitened residuals, penalties included, by the parameters and the mass's logarithm.
    pub(super) slopes: DMatrix<f64>,
    /// With each parameter a little more, by how much; none where it is not to be found, is the onset, or cannot be played.
    pub(super) neighbours: [Option<(f64, Tried)>; PARAMETERS],
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

    /// The same of one that was played.
    pub(super) fn try_path(&self, guess: Guess, path: Path) -> Option<Tried> {
        let [s_min, s_max] = range(&self.course.side(guess.edge)?);
        let mut predicted = self.measured.predicted(&path, guess.delay);
        if !self.course.changed.is_empty() {
            predicted.numbers = self.of_numbers(&guess, &path, &predicted);
        }
        let compared = predicted.compared(self.measured.data(), self.mass);
        let Compared { mass, rest, .. } = compared;
        if mass.is_nan() || mass <= 0.0 {
            return None;
        }
        let beyond = (s_min - path.s_span[0]).max(path.s_span[1] - s_max).max(0.0) / EDGE_SLACK_M;
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
                && !(path.slipped
                    && along.differs_within(&self.course.friction_along, path.s_span.map(|s| s - guess.s)))
            {
                return None;
            }
            let path = self.course.with(changed).play(guess).ok()?;
            Some((self.measured.predicted(&path, guess.delay).shape - &predicted.shape) / SHARE_OF_SD)
        };
        let none = || DVector::zeros(predicted.shape.len());
        let before = std::cell::LazyCell::new(|| self.measured.carried(&self.course.legs));
        let carried = |changed: &Changed| match changed {
            Changed::Part(_) | Changed::Friction(_) => None,
            Changed::Motion(legs) => {
                // The finger's mass takes its part of what is read.
                Some((before.as_ref()? - self.measured.carried(legs)?) / SHARE_OF_SD)
            }
        };
        let of = |(changed, &off): (&'p Changed, &NumberOff)| OfNumber {
            per_mass: per_mass(changed).unwrap_or_else(none),
            carried: carried(changed),
            off,
        };
        self.course.changed.iter().zip(self.course.off).map(of).collect()
    }

    /// Goes down to the nearest minimum.
    pub(super) fn descend(&self, start: Tried, steps_max: usize) -> Tried {
        let settings = LeastSquaresSettings { steps_max: steps_max.min(STEPS_MAX), ..DESCENT };
        let found = minimise(self, start, &settings, |_| false).place;
        // A jump of the force on the other side of a reading is a minimum of its own.
        let cost = found.cost;
        let found = match self.at_best_onset(found.clone()) {
            Some(better) if better.cost < cost - COST_STEP => minimise(self, better, &settings, |_| false).place,
            _ => found,
        };
        self.in_one_turn(found)
    }

    /// The same on an outline that goes round, where each place has one number.
    fn in_one_turn(&self, mut tried: Tried) -> Tried {
        let Some(side @ PartSide::Ellipse { .. }) = self.course.side(tried.guess.edge) else { return tried };
        let [from, to] = sought(&side, self.course.symmetry);
        if to > from {
            let turns = ((tried.guess.s - from) / (to - from)).floor() * (to - from);
            tried.guess.s -= turns;
            tried.path.end.s -= turns;
            tried.path.s_span = tried.path.s_span.map(|s| s - turns);
        }
        tried
    }

    /// Goes down with one parameter held where it is.
    pub(super) fn fitted_beside(&self, held: usize, start: Tried, steps_max: usize) -> Tried {
        let settings = LeastSquaresSettings { steps_max, ..DESCENT };
        minimise(&Held { problem: self, unknown: held }, start, &settings, |_| false).place
    }

    pub(super) fn differences(&self) -> [f64; PARAMETERS] {
        let [u, s, mu_c, mu_g_log, delay, omega, slide] = DIFFERENCES;
        let arm = self.course.part.inertia_per_mass().sqrt();
        [u, s * arm, mu_c, mu_g_log, delay, omega, slide * arm]
    }

    /// Whether a parameter is to be found, and changes anything.
    pub(super) fn is_free(&self, at: &Tried, parameter: usize) -> bool {
        match parameter {
            MU_C => at.path.slipped && self.course.mu_c.is_none(),
            MU_G => self.course.mu_g_log_sd.is_some(),
            DELAY => self.measured.onset_sd().is_some(),
            OMEGA => self.course.start == CourseStart::Moving,
            SLIDE => at.guess.slide != 0.0,
            // Along a straight finger, and round a disk, all places are alike.
            CONTACT_ANGLE => !matches!(self.course.shape, Some(FingerShape::Line)),
            PLACE => self.course.symmetry != ROUND,
            _ => true,
        }
    }

    /// A guess with what is beside it.
    pub(super) fn around<'t>(&self, at: &'t Tried) -> Around<'t> {
        let size = at.predicted.shape.len();
        let mut slopes = DMatrix::zeros(size + PENALTIES, COLUMNS);
        if self.mass.is_none() {
            slopes.view_mut((0, PARAMETERS), (size, 1)).copy_from(&(&at.predicted.shape * -at.mass));
        }
        let course = self.course.sure();
        let sure = Problem { course: &course, measured: self.measured, mass: self.mass };
        let mut neighbours = [const { None }; PARAMETERS];
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
            let aside =
                beside(&at.guess, column, difference).find_map(|(step, guess)| Some((step, sure.try_guess(guess)?)));
            let Some((step, moved)) = aside else { continue };
            let change = (&at.predicted.shape - &moved.predicted.shape) * (at.mass / step);
            slopes.view_mut((0, column), (size, 1)).copy_from(&change);
            for (row, (after, before)) in moved.penalties.iter().zip(at.penalties).enumerate() {
                slopes[(size + row, column)] = (after - before) / step;
            }
            neighbours[column] = Some((step, moved));
        }
        Around { at, slopes, neighbours }
    }

    /// Standard deviations of the parameters before anything is felt, each being anywhere in its range.
    fn ranges(&self, at: &Tried) -> [f64; PARAMETERS] {
        let length = self.course.side(at.guess.edge).map_or(f64::INFINITY, |side| {
            let [from, to] = sought(&side, self.course.symmetry);
            to - from
        });
        // The plane's friction and the onset have priors of their own.
        let (omega, slide) = (2.0 * OMEGA_MAX, 2.0 * SLIDE_MAX);
        [PI, length, MU_C_MAX - MU_C_MIN, f64::INFINITY, f64::INFINITY, omega, slide]
            .map(|range| range / 12.0_f64.sqrt())
    }

    /// Covariance of the guess's parameters. Those that no slope tells of, since they make no difference or are held,
    /// count as known.
    pub(super) fn covariance(&self, around: &Around) -> Option<DMatrix<f64>> {
        self.covariance_near(around, f64::INFINITY)
    }

    /// The same where the contact angle at the start is known so well beside, rad.
    pub(super) fn covariance_near(&self, around: &Around, u_sd: f64) -> Option<DMatrix<f64>> {
        let at = around.at;
        let mut normal = curvature(around);
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

    /// Contact angles and places so many standard deviations from a minimum, all round it.
    pub(super) fn border(&self, at: &Tried, sds: f64) -> Option<[[f64; 2]; BORDER_PLACES]> {
        let covariance = self.covariance(&self.around(at))?.fixed_view::<2, 2>(0, 0).into_owned();
        let lower = covariance.cholesky()?.unpack();
        let place = |index: usize| {
            let (sin, cos) = (TAU * index as f64 / BORDER_PLACES as f64).sin_cos();
            let off: Vector2<f64> = lower * Vector2::new(cos, sin) * sds;
            [at.guess.u + off.x, at.guess.s + off.y]
        };
        Some(std::array::from_fn(place))
    }
}

impl Problem<'_, '_> {
    /// How many standard deviations each number of outline and motion is off what it is taken for, of a guess.
    pub(super) fn taken_of_numbers(&self, at: &Tried) -> Vec<f64> {
        let mut taken = self.taken_of_nuisances(at);
        taken.truncate(at.predicted.numbers.len());
        taken
    }

    /// How many standard deviations each of [`Predicted::nuisances`] is off, of a guess.
    pub(super) fn taken_of_nuisances(&self, at: &Tried) -> Vec<f64> {
        // What remains of a residual is whitened by it: a column's share of the rest is what was taken.
        at.predicted.nuisances(at.mass).map(|column| column.dot(&at.rest)).collect()
    }

    /// How many standard deviations what adds to the force whatever the part's mass is off, of a guess.
    pub(super) fn taken_beside(&self, at: &Tried) -> f64 {
        at.predicted.beside.first().map_or(0.0, |column| column.dot(&at.rest))
    }

    /// By how much the volume of what is likely about a minimum makes it likelier, up to what all minima share (Laplace's
    /// approximation): of all that is found, with the share of µ_c's range where the contact rolls, and of what is not known of part
    /// and motion.
    pub(super) fn evidence(&self, around: &Around) -> Option<f64> {
        let (at, covariance) = (around.at, self.covariance(around)?);
        let of_found = volume(&covariance.fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned())?;
        let nuisances: Vec<_> = at.predicted.nuisances(at.mass).collect();
        let of_unknown = if nuisances.is_empty() {
            1.0
        } else {
            let columns = DMatrix::from_columns(&nuisances);
            root_of_determinant(columns.tr_mul(&columns) + DMatrix::identity(columns.ncols(), columns.ncols()))?
        };
        let range = MU_C_MAX - MU_C_MIN;
        let of_mu_c = match (self.course.mu_c, at.path.slipped) {
            (Some(_), _) => 1.0,
            (None, true) => TAU.sqrt() / range,
            (None, false) => ((MU_C_MAX - at.path.friction_needed) / range).max(ROLLING_SHARE_MIN),
        };
        let of_slide = if at.guess.slide == 0.0 { 1.0 } else { TAU.sqrt() / (2.0 * SLIDE_MAX) };
        Some(of_found / of_unknown * of_mu_c * of_slide)
    }

    /// Square root of the determinant of the covariance of contact angle and place at the start.
    pub(super) fn spread(&self, around: &Around) -> Option<f64> {
        self.spread_near(around, f64::INFINITY)
    }

    /// The same where the contact angle is known so well beside, rad.
    pub(super) fn spread_near(&self, around: &Around, u_sd: f64) -> Option<f64> {
        Some(spread(&self.covariance_near(around, u_sd)?.fixed_view::<2, 2>(0, 0).into_owned()))
    }
}

impl least_squares::LeastSquaresProblem<COLUMNS> for Problem<'_, '_> {
    type Place = Tried;

    fn cost(&self, tried: &Tried) -> f64 {
        tried.cost
    }

    fn normal_equations(&self, tried: &Tried) -> NormalEquations<COLUMNS> {
        let (size, around) = (tried.predicted.shape.len(), self.around(tried));
        let mut residuals = DVector::zeros(size + PENALTIES);
        residuals.rows_mut(0, size).copy_from(&tried.rest);
        residuals.rows_mut(size, PENALTIES).copy_from_slice(&tried.penalties);
        NormalEquations {
            cost: tried.cost,
            gradient: around.slopes.tr_mul(&residuals).fixed_rows::<COLUMNS>(0).into_owned(),
            curvature: curvature(&around).fixed_view::<COLUMNS, COLUMNS>(0, 0).into_owned(),
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

/// Of the cost, all nuisances being found for every guess.
fn curvature(around: &Around) -> DMatrix<f64> {
    let Around { at, slopes, .. } = around;
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

/// Of a positive definite matrix, from its factor: the determinant itself may be too small for a number.
fn root_of_determinant(of: DMatrix<f64>) -> Option<f64> {
    Some(of.cholesky()?.l_dirty().diagonal().iter().map(|it| it.ln()).sum::<f64>().exp())
}

/// Square root of the determinant of a covariance; what is held counts as one.
pub(super) fn volume<const N: usize>(covariance: &SMatrix<f64, N, N>) -> Option<f64> {
    let free: Vec<_> = (0..N).filter(|&i| covariance[(i, i)] > 0.0).collect();
    root_of_determinant(DMatrix::from_fn(free.len(), free.len(), |row, column| covariance[(free[row], free[column])]))
}

/// Square root of the determinant of a covariance of contact angle and place; what is held counts as one.
pub(super) fn spread(covariance: &Matrix2<f64>) -> f64 {
    match [covariance[(0, 0)], covariance[(1, 1)]] {
        [0.0, 0.0] => 1.0,
        [0.0, only] | [only, 0.0] => only.max(0.0).sqrt(),
        _ => covariance.determinant().max(0.0).sqrt(),
    }
}

pub(super) fn vector(state: &State) -> Vector4<f64> {
    Vector4::new(state.u, state.s, state.omega, state.v_t)
}

/// A guess with one parameter changed by a difference, or the other way: at a limit, or where nothing can be played,
/// that will do.
pub(super) fn beside(guess: &Guess, parameter: usize, difference: f64) -> impl Iterator<Item = (f64, Guess)> {
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
