//! Pose and motion of a rolling body from the path of its contact, without a prior.
//!
//! A global search over attitude, modulo the body's symmetry, and spin (`search`, over the attitudes of `rotations`);
//! fits over ever longer horizons, and a last one of all readings at full accuracy (`fit`, along the steps of `track`);
//! where that knows the attitude poorly, how its valley bends (`valley`); then a verdict: what explains the readings
//! within their noise, and nothing else (`verdict`). Parts of the model may be unknown too: which of several bodies, the
//! semi-axes of an ellipsoid, a constant acceleration of the palm, whether the contact transmits spin.
//!
//! Implements: the observer that thesis §7.3 leaves to future work.
//! Assumes: contact kept, no slip; readings at equal steps of time from t = 0.
//! Frames: as in [`mechanics`](super::mechanics). Units: SI.
//! Errors: [`ObserveError`] for readings too few or too short. That nothing fits, or several hypotheses do, is an
//! answer.

mod fit;
mod rotations;
mod search;
mod track;
mod valley;
mod verdict;

use std::ops::RangeInclusive;

use nalgebra::{DMatrix, Vector2, Vector3};

pub use track::{Noise, Readings};
pub use verdict::{RollEstimate, RollHypothesis, RollVerdict};

use self::fit::{Effort, Norm, Point, RollFit, Unknowns};
use self::search::{Ground, Width};
use self::track::Track;
use self::valley::Valley;
use self::verdict::{Gate, LISTED, Quality, Solution};
use super::body::RollingBody;
use super::flow::Columns;
use super::mechanics::{Model, Spin, specific_force};
use super::palm::PalmAcceleration;
use crate::math::least_squares::Enough;
use crate::search::{Halt, Searched, Stop, never};
pub use search::Coverage;

/// The largest ratio of semi-axes to search: a body with such axes is a needle or a blade, and still strictly convex.
const AXIS_RATIO_MAX: f64 = 100.0;

/// Least window, in units of √(size/g): before that gravity has moved nothing.
const WINDOW_MIN: f64 = 0.25;

/// Widths of the search, tried in turn until one explains the readings well; what the others found is kept.
const WIDTHS: [Width; 3] = [
    Width { attitudes: 2400, approached: 700, starts: [200, 30], kept: 20, horizon: 1.1 },
    Width { attitudes: 6000, approached: 2500, starts: [500, 100], kept: 60, horizon: 2.0 },
    Width { attitudes: 12_000, approached: 4000, starts: [600, 150], kept: 60, horizon: 0.6 },
];

/// Widths for a search over shapes too: `attitudes` for each of [`shapes`].
const WIDTHS_SHAPE: [Width; 3] = [
    Width { attitudes: 1200, approached: 1500, starts: [300, 60], kept: 24, horizon: 1.1 },
    Width { attitudes: 1200, approached: 3000, starts: [600, 100], kept: 40, horizon: 2.0 },
    Width { attitudes: 3000, approached: 6000, starts: [1000, 200], kept: 60, horizon: 1.1 },
];

/// What a set of contacts is asked for.
#[derive(Clone, Debug)]
pub struct RollQuestion {
    /// The body, or what it may be.
    pub body: BodyKnowledge,
    /// What the contact transmits; both where that is unknown.
    pub spins: Vec<Spin>,
    /// How the palm accelerates.
    pub palm: PalmKnowledge,
    /// Gravity, m/s².
    pub g: f64,
    /// How the readings err.
    pub noise: Noise,
}

/// What is known of the body.
#[derive(Clone, Debug)]
pub enum BodyKnowledge {
    /// One of these; usually one alone.
    OneOf(Vec<RollingBody>),
    /// An ellipsoid of uniform density with semi-axes in this range, m.
    Ellipsoid {
        /// Least and greatest semi-axis, m.
        range: RangeInclusive<f64>,
    },
}

impl BodyKnowledge {
    /// The lowest and the highest semi-axis, m, where they are to be found.
    fn semi_axes_range(&self) -> Option<[f64; 2]> {
        match self {
            Self::OneOf(_) => None,
            Self::Ellipsoid { range } => Some([*range.start(), *range.end()]),
        }
    }
}

/// What is known of the palm's acceleration.
#[derive(Clone, Debug, PartialEq)]
pub enum PalmKnowledge {
    /// The acceleration over time, palm axes, m/s².
    Known(PalmAcceleration),
    /// That it is constant.
    Constant,
}

/// Why readings cannot be used.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ObserveError {
    /// Fewer numbers than unknowns.
    #[error("{count} contacts are too few for {unknowns} unknowns: give at least {least}")]
    TooFew {
        /// Contacts that were given.
        count: usize,
        /// Numbers that are to be found.
        unknowns: usize,
        /// Fewest contacts that would do.
        least: usize,
    },
    /// A window in which gravity moves nothing.
    #[error(
        "the contacts span {duration:.4} s, too short to see anything: at least {least:.4} s are needed, {good:.2} s are good"
    )]
    TooShort {
        /// From the first reading to the last, s.
        duration: f64,
        /// The shortest span that is accepted, s.
        least: f64,
        /// A span that is long enough, s.
        good: f64,
    },
    /// Nothing holds the body on the palm.
    #[error("without gravity nothing presses the body onto the palm: g must be above 0")]
    NoGravity,
    /// Ellipsoids that are none in practice.
    #[error(
        "semi-axes from {low} to {high} m differ by more than a factor of {AXIS_RATIO_MAX}: give the range of the body itself"
    )]
    AxisRange {
        /// Least semi-axis, m.
        low: f64,
        /// Greatest semi-axis, m.
        high: f64,
    },
}

impl RollQuestion {
    /// Everything that explains contacts `u` (m), `dt` seconds apart from t = 0 on.
    ///
    /// # Errors
    /// [`ObserveError`] for readings too few or too short, without gravity, and for semi-axes of too wide a range.
    pub fn answer(&self, dt: f64, u: &[Vector2<f64>]) -> Result<RollEstimate, ObserveError> {
        self.answer_until(dt, u, &never).map(|searched| searched.found)
    }

    /// The same, ended when `stop` says so: then with the explanations found by then, and never certified.
    ///
    /// # Errors
    /// As for [`RollQuestion::answer`].
    pub fn answer_until(
        &self,
        dt: f64,
        u: &[Vector2<f64>],
        stop: Stop<'_>,
    ) -> Result<Searched<RollEstimate>, ObserveError> {
        let halt = Halt::new(stop);
        let readings = Readings { start: 0.0, dt, u: u.to_vec(), sigma: self.noise.sigma() };
        self.check(&readings)?;
        let mut solutions = Vec::new();
        let mut coverage = Coverage::default();
        for width in 0..WIDTHS.len() {
            coverage = Coverage::default();
            solutions.extend(self.solve(&readings, width, &halt, &mut coverage));
            solutions.sort_by(|a: &Solution, b| a.fit.cost.total_cmp(&b.fit.cost));
            if halt.is_wished() {
                break;
            }
            // No width covers an unknown ellipsoid: looking again would leave something out as well.
            let is_spread = matches!(self.body, BodyKnowledge::Ellipsoid { .. });
            match self.gate(&readings).quality(&solutions) {
                Quality::Good if is_spread => break,
                Quality::Good | Quality::Weak if coverage.left_out == 0 || width > 0 => break,
                _ => {}
            }
        }
        let mut searched = halt.searched(self.gate(&readings).judge(solutions, coverage));
        searched.found.certified &= searched.complete;
        searched.found.complete &= searched.complete;
        if !searched.complete && searched.found.verdict == RollVerdict::Unique {
            // What was not looked at may explain the readings as well.
            searched.found.verdict = RollVerdict::Ambiguous;
        }
        Ok(searched)
    }

    fn gate(&self, readings: &Readings) -> Gate {
        Gate { readings: readings.u.len(), noise: self.noise }
    }

    fn check(&self, readings: &Readings) -> Result<(), ObserveError> {
        if self.g <= 0.0 {
            return Err(ObserveError::NoGravity);
        }
        if let Some([low, high]) = self.body.semi_axes_range()
            && high > low * AXIS_RATIO_MAX
        {
            return Err(ObserveError::AxisRange { low, high });
        }
        let unknowns = self.columns().count() + 2 - usize::from(!self.spins.contains(&Spin::Free));
        let (count, least) = (readings.u.len(), unknowns / 2 + 1);
        if count < least.max(7) {
            return Err(ObserveError::TooFew { count, unknowns, least: least.max(7) });
        }
        let size = match &self.body {
            BodyKnowledge::OneOf(bodies) => bodies.iter().map(RollingBody::size).fold(f64::INFINITY, f64::min),
            BodyKnowledge::Ellipsoid { range } => *range.start(),
        };
        let (duration, time) = (readings.duration(), (size / self.g).sqrt());
        if duration < WINDOW_MIN * time {
            return Err(ObserveError::TooShort { duration, least: WINDOW_MIN * time, good: 7.0 * time });
        }
        Ok(())
    }

    fn columns(&self) -> Columns {
        Columns {
            semi_axes: matches!(self.body, BodyKnowledge::Ellipsoid { .. }),
            palm: self.palm == PalmKnowledge::Constant,
        }
    }

    fn palm(&self) -> &PalmAcceleration {
        match &self.palm {
            PalmKnowledge::Known(palm) => palm,
            PalmKnowledge::Constant => &PalmAcceleration::Rest,
        }
    }

    /// The minima found for every model that may be.
    fn solve(&self, readings: &Readings, width: usize, halt: &Halt<'_>, coverage: &mut Coverage) -> Vec<Solution> {
        let mut solutions = Vec::new();
        for &spin in &self.spins {
            match &self.body {
                BodyKnowledge::OneOf(bodies) => {
                    for (index, body) in bodies.iter().enumerate() {
                        let models = RivalModels { spin, bodies: std::slice::from_ref(body) };
                        let found = self.solve_model(readings, models, &WIDTHS[width], halt, coverage);
                        solutions.extend(found.into_iter().map(|solution| Solution { body: index, ..solution }));
                    }
                }
                BodyKnowledge::Ellipsoid { range } => {
                    let shapes = shapes([*range.start(), *range.end()]);
                    let models = RivalModels { spin, bodies: &shapes };
                    solutions.extend(self.solve_model(readings, models, &WIDTHS_SHAPE[width], halt, coverage));
                }
            }
        }
        solutions
    }

    /// How much shorter steps and averages must be than for a round body: a contact rushes over the sharp ends of long
    /// and flat ones. 1 for a 2-3-4 ellipsoid; for one that is unknown too, because its steps cannot change with the
    /// fit.
    fn pace(&self, bodies: &[RollingBody]) -> f64 {
        match self.body {
            BodyKnowledge::Ellipsoid { .. } => 1.0,
            BodyKnowledge::OneOf(_) => {
                let pace = |body: &RollingBody| (ROUND * body.sharpest() / body.size()).sqrt().clamp(PACE_MIN, 1.0);
                bodies.iter().map(pace).fold(1.0, f64::min)
            }
        }
    }

    fn solve_model(
        &self,
        readings: &Readings,
        RivalModels { spin, bodies }: RivalModels<'_>,
        width: &Width,
        halt: &Halt<'_>,
        coverage: &mut Coverage,
    ) -> Vec<Solution> {
        if halt.is_wished() {
            return Vec::new();
        }
        let range = self.body.semi_axes_range().unwrap_or([0.0, f64::INFINITY]);
        let unknowns = Unknowns { spin, columns: self.columns(), range };
        let pace = self.pace(bodies);
        let coarse = readings.averaged(pace);
        let track = coarse.search_track(self.palm(), self.g, pace);
        let specific_force = specific_force(self.palm().at(track.centre_time), self.g);
        let first_look = &coarse.first_look(self.palm(), self.g, pace);
        let sought = Ground { unknowns, bodies, track: &track, first_look, specific_force, pace, halt }.search(width);
        let fine = readings.fine_track(self.palm(), self.g, pace);
        coverage.add(&sought.coverage);
        let best = sought.fits.first().map_or(0.0, |fit| fit.cost);
        let worth = sought.fits.into_iter().filter(|fit| fit.cost <= best + WORTH_POLISHING);
        let polish = Polish { unknowns: &unknowns, track: &track, fine: &fine, noise: self.noise, halt };
        let mut solutions: Vec<Solution> = Vec::new();
        let mut least = f64::INFINITY;
        for fit in worth.take_while(|_| !halt.is_wished()) {
            let solution = polish.solution(fit, least + LISTED);
            // What was broken off is not at its minimum.
            if halt.is_wished() {
                break;
            }
            if solution.fit.cost.is_finite() {
                least = least.min(solution.fit.cost);
                solutions.push(solution);
            }
        }
        solutions
    }
}

/// What one search tells apart: bodies that all spin or all do not.
#[derive(Clone, Copy)]
struct RivalModels<'a> {
    spin: Spin,
    bodies: &'a [RollingBody],
}

/// Size over least radius of curvature of a body that counts as round: that of a 2-3-4 ellipsoid.
const ROUND: f64 = 3.0;

/// Least [`RollQuestion::pace`]: shorter steps would take too long.
const PACE_MIN: f64 = 0.2;

/// Cost above the best of the search up to which a fit may still turn out to be listed: what is listed, and what coarse
/// steps and averages are off by.
const WORTH_POLISHING: f64 = 60.0;

/// Residual, in pitches, up to which a fit of rounded readings may be refined by their bounds: half a pitch if the fit
/// were exact, more because it is not. Least squares may be a pitch off where the contact is slow and its errors alike.
const ROUNDING_MAX: f64 = 1.5;

/// The last fit of all readings.
struct Polish<'a> {
    unknowns: &'a Unknowns,
    /// The search's steps.
    track: &'a Track,
    /// Those of the last fit.
    fine: &'a Track,
    noise: Noise,
    halt: &'a Halt<'a>,
}

impl Polish<'_> {
    /// By least squares; where readings were rounded, then by the bounds of rounding. What costs more than is listed
    /// needs no covariance of a bent valley.
    fn solution(&self, fit: RollFit, listed: f64) -> Solution {
        let Self { unknowns, fine, noise, halt, .. } = *self;
        let squares = Effort {
            ranks: fine.ranks_max(),
            iterations: 40,
            enough: Enough { relative: 1e-12, absolute: 1e-4, damping_max: 1.0 },
            palm_sigma: f64::INFINITY,
            norm: Norm::Squares,
            halt,
        };
        let mut fit = unknowns.fit(fine, self.begun(fit), &squares);
        let residuals = unknowns.residuals(fine, &fit.point);
        let mut residual_max = residuals.max;
        let mut ends = unknowns.ends(fine, &fit.point);
        let valley = (fit.cost <= listed && !halt.is_wished())
            .then(|| Valley::through(unknowns, fine, &fit, &ends, halt))
            .flatten();
        if let Noise::Grid(pitch) = noise
            && residuals.max <= ROUNDING_MAX * pitch
        {
            let enough = Enough { relative: 1e-4, absolute: 0.0, damping_max: 1.0 };
            let bounded = Effort { iterations: 20, enough, norm: Norm::Bounded(0.5 * pitch), ..squares };
            // Cost and information stay those of least squares: the bound they give is on the safe side.
            fit.point = unknowns.fit(fine, fit.point, &bounded).point;
            residual_max = unknowns.residuals(fine, &fit.point).max;
            ends = unknowns.ends(fine, &fit.point);
        }
        Solution { body: 0, unknowns: *unknowns, fit, ends, valley, residuals, residual_max }
    }

    /// Where the search ended, at the middle of the finer steps.
    fn begun(&self, fit: RollFit) -> Point {
        let mut point = fit.point;
        let shift = self.fine.centre_time - self.track.centre_time;
        let first = self.track.forward.first();
        let specific_force = first.map_or(Vector3::zeros(), |step| step.specific_force[0]) + point.palm;
        let model = Model { body: &point.body, spin: self.unknowns.spin };
        point.state = model.step(&point.state, &[specific_force; 3], shift);
        point
    }
}

/// Ellipsoids all over a range of semi-axes, the shortest first: which axis is which is the attitude's business.
fn shapes(range: [f64; 2]) -> Vec<RollingBody> {
    const STEPS: u32 = 6;
    let [low, high] = range;
    let axis = |k: u32| low * (high / low).powf((f64::from(k) + 0.5) / f64::from(STEPS));
    let mut shapes = Vec::new();
    for i in 0..STEPS {
        for j in i..STEPS {
            for k in j..STEPS {
                // Slightly apart where they would be equal: a body of revolution has no third axis to fit.
                let semi_axes = [axis(i) * 0.97, axis(j), axis(k) * 1.03];
                shapes.extend(RollingBody::ellipsoid(semi_axes).ok());
            }
        }
    }
    shapes
}

/// Inverse of a symmetric positive definite matrix, scaled by its diagonal first; `None` where it is singular.
pub(super) fn covariance(information: &DMatrix<f64>) -> Option<DMatrix<f64>> {
    let scale = information.diagonal().map(|entry| 1.0 / entry.max(f64::MIN_POSITIVE).sqrt());
    let scaled = DMatrix::from_diagonal(&scale) * information * DMatrix::from_diagonal(&scale);
    let inverse = scaled.cholesky()?.inverse();
    Some(DMatrix::from_diagonal(&scale) * inverse * DMatrix::from_diagonal(&scale))
}
