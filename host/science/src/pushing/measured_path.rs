//! How a finger moves whose places were measured: a motion from rest whose acceleration wanders smoothly.
//!
//! Places are told with white noise, some tens a second. Second differences of them would be noise; so the acceleration
//! is one of short steps that wanders: itself, as where a robot jerks, or by its rate, as where it ramps up and down. Which
//! of all such motions fits best follows in closed form. What wanders, and how fast, is chosen by the evidence of the
//! places themselves (MacKay 1992).
//!
//! Implements: with places y = B a + e, e of variance σ², and first differences of a of variance q h, or second ones of
//! variance q h³, the posterior of a is normal with precision A = Bᵀ B / σ² + Dᵀ D / variance; the evidence is that of y.
//! Frames: world axes. Units: SI. Errors: none is found where fewer than [`PLACES_MIN`] places are told.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Point2, Vector2};

use super::finger_motion::{FingerMotion, Segment};

/// Fewest places that tell of an acceleration.
pub const PLACES_MIN: usize = 8;

/// Longest step of the acceleration, s: it changes by a few per cent over one.
const STEP_S: f64 = 5e-3;

/// Most steps.
const STEPS_MAX: usize = 400;

/// A velocity of so many standard deviations of one between two places tells which way the finger goes: within 6°.
const TELLING: f64 = 10.0;

/// How an acceleration may wander: from a robot that creeps to one that jerks, and from one that hardly ramps to one whose
/// ramps are of milliseconds.
const WAYS: [Way; 22] = [
    Way::Acceleration(1e-3),
    Way::Acceleration(1e-2),
    Way::Acceleration(0.1),
    Way::Acceleration(0.3),
    Way::Acceleration(1.0),
    Way::Acceleration(3.0),
    Way::Acceleration(10.0),
    Way::Acceleration(100.0),
    Way::Acceleration(1000.0),
    Way::Jerk(1e-2),
    Way::Jerk(0.1),
    Way::Jerk(1.0),
    Way::Jerk(10.0),
    Way::Jerk(30.0),
    Way::Jerk(100.0),
    Way::Jerk(300.0),
    Way::Jerk(1e3),
    Way::Jerk(3e3),
    Way::Jerk(1e4),
    Way::Jerk(1e5),
    Way::Jerk(1e6),
    Way::Jerk(1e7),
];

/// What of a motion wanders, as a random walk, and how fast.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Way {
    /// The acceleration, (m/s²)²/s.
    Acceleration(f64),
    /// Its rate, (m/s³)²/s.
    Jerk(f64),
}

impl Way {
    /// Weights of a step's acceleration and of those before it in what is as likely small as large, and its variance, for
    /// steps of a length, s.
    fn differences(self, length: f64) -> (&'static [f64], f64) {
        match self {
            Self::Acceleration(rate) => (&[1.0, -1.0], rate * length),
            Self::Jerk(rate) => (&[1.0, -2.0, 1.0], rate * length.powi(3)),
        }
    }
}

/// Places of a finger's clamp.
#[derive(Clone, Debug, PartialEq)]
pub struct MeasuredPath {
    /// When each was taken, s, ascending.
    pub times: Vec<f64>,
    /// m.
    pub places: Vec<Point2<f64>>,
    /// Standard deviation of one coordinate, m.
    pub sigma: f64,
}

/// A motion that fits a path.
#[derive(Clone, Debug)]
pub struct FittedPath {
    /// Since it begins.
    pub motion: FingerMotion,
    /// Squared residuals in standard deviations.
    pub misfit: f64,
}

/// How smooth a motion is, and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wandering {
    /// What wanders, and how fast.
    pub way: Way,
    /// Standard deviation of the acceleration, each axis, on average, m/s².
    pub acceleration_sd: f64,
    /// Values less those that the motion takes up.
    pub degrees_of_freedom: f64,
}

/// Steps of an acceleration, and where they lead.
struct Steps {
    /// Of each, s.
    length: f64,
    /// Places by where the motion begins and by the acceleration of each step, in standard deviations.
    of_places: DMatrix<f64>,
}

impl MeasuredPath {
    /// How the motion wanders that begins at a time, s; none with too few places or none after it.
    #[must_use]
    pub fn wandering(&self, onset: f64) -> Option<Wandering> {
        let steps = self.steps(onset)?;
        let information = steps.of_places.tr_mul(&steps.of_places);
        let fits = WAYS.iter().filter_map(|&way| Some((way, self.fitted_with(&steps, &information, way)?)));
        let (way, best) = fits.max_by(|a, b| a.1.evidence.total_cmp(&b.1.evidence))?;
        let inverse = best.precision.inverse();
        let count = inverse.nrows() - 1;
        Some(Wandering {
            way,
            acceleration_sd: (inverse.diagonal().rows(1, count).sum() / count as f64).max(0.0).sqrt(),
            degrees_of_freedom: 2.0 * (self.times.len() as f64 - (&information * &inverse).trace()),
        })
    }

    /// The likeliest motion that wanders so, begins at a time, s, and rests before; none with too few places or none
    /// after it.
    #[must_use]
    pub fn fitted(&self, onset: f64, wandering: &Wandering) -> Option<FittedPath> {
        self.fitted_beside(onset, wandering, None)
    }

    /// The same off by something along an axis, of [`Self::modes`].
    #[must_use]
    pub fn fitted_beside(
        &self,
        onset: f64,
        wandering: &Wandering,
        off: Option<(usize, &DVector<f64>)>,
    ) -> Option<FittedPath> {
        let steps = self.steps(onset)?;
        let information = steps.of_places.tr_mul(&steps.of_places);
        let Fit { mut found, misfit, .. } = self.fitted_with(&steps, &information, wandering.way)?;
        if let Some((axis, off)) = off.filter(|(_, off)| off.len() == found[0].len()) {
            found[axis] += off;
        }
        let [x, y] = found;
        let accelerations: Vec<_> = (1..x.len()).map(|row| Vector2::new(x[row], y[row])).collect();
        let (segments, ahead) = self.begun(&accelerations, steps.length);
        Some(FittedPath { motion: FingerMotion::new(Point2::new(x[0], y[0]) + ahead, &segments).ok()?, misfit })
    }

    /// What is not known of the accelerations of a motion that begins at a time, s: by its largest modes, each one
    /// standard deviation, of either axis.
    #[must_use]
    pub fn modes(&self, onset: f64, wandering: &Wandering, count: usize) -> Vec<DVector<f64>> {
        let Some(steps) = self.steps(onset) else { return Vec::new() };
        let information = steps.of_places.tr_mul(&steps.of_places);
        let Some(fit) = self.fitted_with(&steps, &information, wandering.way) else { return Vec::new() };
        let eigen = fit.precision.inverse().symmetric_eigen();
        let mut order: Vec<_> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let mode = |&n: &usize| eigen.eigenvectors.column(n) * eigen.eigenvalues[n].max(0.0).sqrt();
        order.iter().take(count).map(mode).collect()
    }

    /// Segments of which the first is so long that it tells which way the finger goes, and how much further on a motion
    /// must begin to be where it is after it.
    fn begun(&self, accelerations: &[Vector2<f64>], length: f64) -> (Vec<Segment>, Vector2<f64>) {
        let span = self.times[self.times.len() - 1] - self.times[0];
        let noise = std::f64::consts::SQRT_2 * self.sigma * (self.times.len() - 1) as f64 / span;
        let (mut velocity, mut way, mut count) = (Vector2::zeros(), Vector2::zeros(), 0);
        for acceleration in accelerations {
            way += velocity * length + acceleration * (0.5 * length * length);
            velocity += acceleration * length;
            count += 1;
            if velocity.norm() > TELLING * noise {
                break;
            }
        }
        let seconds = length * f64::from(u32::try_from(count).unwrap_or(u32::MAX));
        let first = Segment { seconds, acceleration: velocity / seconds };
        let rest = accelerations[count..].iter().map(|&acceleration| Segment { seconds: length, acceleration });
        (std::iter::once(first).chain(rest).collect(), way - velocity * (0.5 * seconds))
    }

    fn steps(&self, onset: f64) -> Option<Steps> {
        let last = *self.times.last()?;
        let is_told = self.places.len() == self.times.len() && self.times.len() >= PLACES_MIN;
        if !is_told || last <= onset || self.sigma <= 0.0 {
            return None;
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive, and clamped")]
        let count = (((last - onset) / STEP_S).ceil() as usize).clamp(1, STEPS_MAX);
        let length = (last - onset) / count as f64;
        let of_places = DMatrix::from_fn(self.times.len(), count + 1, |row, column| match column {
            0 => 1.0,
            _ => moved(self.times[row] - onset - length * (column - 1) as f64, length),
        });
        Some(Steps { length, of_places: of_places / self.sigma })
    }

    fn fitted_with(&self, steps: &Steps, information: &DMatrix<f64>, way: Way) -> Option<Fit> {
        let Steps { length, of_places } = steps;
        let ((weights, variance), steps) = (way.differences(*length), of_places.ncols() - 1);
        // Before the motion begins there is no acceleration.
        let of_step =
            |step: usize| weights.iter().enumerate().take(step).map(move |(back, weight)| (step - back, *weight));
        let mut precision = information.clone();
        for step in 1..=steps {
            for (row, one) in of_step(step) {
                of_step(step).for_each(|(column, other)| precision[(row, column)] += one * other / variance);
            }
        }
        let precision = precision.cholesky()?;
        let log_determinant = 2.0 * precision.l_dirty().diagonal().iter().map(|value| value.ln()).sum::<f64>();
        // Far from the origin squares would lose digits.
        let origin = self.places[0];
        let (mut misfit, mut evidence) = (0.0, 0.0);
        let found = [0, 1].map(|axis| {
            let places = self.places.iter().map(|place| (place[axis] - origin[axis]) / self.sigma);
            let places = DVector::from_iterator(self.places.len(), places);
            let mut best = precision.solve(&of_places.tr_mul(&places));
            let rest = &places - of_places * &best;
            misfit += rest.norm_squared();
            let walk = (1..=steps).map(|step| of_step(step).map(|(at, weight)| weight * best[at]).sum::<f64>());
            let unlikely = walk.map(|change| change * change).sum::<f64>() / variance;
            evidence -= rest.norm_squared() + unlikely + log_determinant + steps as f64 * variance.ln();
            best[0] += origin[axis];
            best
        });
        Some(Fit { found, precision, misfit, evidence })
    }
}

/// A fit with one way to wander.
struct Fit {
    /// By axis: where it begins, then the acceleration of each step.
    found: [DVector<f64>; 2],
    precision: Cholesky<f64, Dyn>,
    misfit: f64,
    evidence: f64,
}

/// How far unit acceleration for one step leads by a time since it began.
fn moved(since: f64, step: f64) -> f64 {
    if since <= 0.0 {
        0.0
    } else if since < step {
        0.5 * since * since
    } else {
        step * (since - 0.5 * step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    /// An S-curve along a bend: its acceleration is found to a few per cent where noise lets it, and within four of what
    /// is stated everywhere.
    #[test]
    fn a_smooth_motion_is_found_from_noisy_places() {
        let (onset, length) = (0.12, 0.5);
        // a = A sin²(π t/T) along two axes: place and acceleration in closed form.
        let acceleration = |t: f64, most: f64| most * (std::f64::consts::PI * t / length).sin().powi(2);
        let place = |t: f64, most: f64| {
            let rate = std::f64::consts::TAU / length;
            most * (0.25 * t * t - (1.0 - (rate * t).cos()) / (2.0 * rate * rate))
        };
        for seed in 0..8 {
            let mut draw = Draw::case(31, seed);
            let sigma = 2e-6;
            let times: Vec<_> = (0..40).map(|n| 0.015 * f64::from(n) + draw.uniform(0.0, 0.005)).collect();
            let mut at = |t: f64, most: f64| place((t - onset).max(0.0), most) + sigma * draw.normal();
            let places = times.iter().map(|t| Point2::new(1.0 + at(*t, 0.3), at(*t, -0.2))).collect();
            let path = MeasuredPath { times, places, sigma };
            let wandering = path.wandering(onset).unwrap();
            let fitted = path.fitted(onset, &wandering).unwrap();
            let misfit = fitted.misfit / wandering.degrees_of_freedom;
            assert!((0.4..2.0).contains(&misfit), "{misfit} {wandering:?}");
            let mut squares = 0.0;
            let mut from = 0.0;
            for segment in fitted.motion.segments() {
                let middle = from + 0.5 * segment.seconds;
                from += segment.seconds;
                if middle < length {
                    let truth = Vector2::new(acceleration(middle, 0.3), acceleration(middle, -0.2));
                    squares += (segment.acceleration - truth).norm_squared() * segment.seconds / length;
                }
            }
            let rms = (0.5 * squares).sqrt();
            assert!(rms < 2.0 * wandering.acceleration_sd && rms < 0.02, "{rms} {wandering:?}");
        }
    }
}
