//! How a finger moves whose places were measured: a motion from rest whose acceleration wanders smoothly.
//!
//! Places are told with white noise, some tens a second. Second differences of them would be noise; so the acceleration
//! is one of short steps that wanders: itself, as where a robot jerks, or by its rate, as where it ramps up and down. Which
//! of all such motions fits best follows in closed form. What wanders, and how fast, is chosen by the evidence of the
//! places themselves (MacKay 1992). What is not known of it is told by the few modes of the motion of which most is felt.
//!
//! Implements: with places y = B a + e, e of variance σ², and first differences of a of variance q h, or second ones of
//! variance q h³, the posterior of a is normal with precision A = Bᵀ B / σ² + Dᵀ D / variance; the evidence is that of y.
//! Frames: world axes. Units: SI. Errors: none is found where fewer than [`PLACES_MIN`] places are told.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Point2, RowDVector, Vector2};

use super::finger_motion::{FingerMotion, Segment};

/// Fewest places that tell of an acceleration.
pub const PLACES_MIN: usize = 8;

/// Longest step of the acceleration, s: it changes by a few per cent over one.
const STEP_S: f64 = 5e-3;

/// Most steps.
const STEPS_MAX: usize = 400;

/// Where the way of the finger is known to this, rad, forces are compared with it in earnest.
pub(in crate::pushing) const TOLD_RAD: f64 = 0.1;

/// Rounds in which modes are found: each leaves of what is not a mode a share of at most the ratio of their effects squared.
const MODE_ROUNDS: usize = 12;

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

/// The likeliest motion of a path that begins at a time, and what is not known of it.
#[derive(Clone, Debug)]
pub struct FittedPath {
    /// Where it begins, m.
    start: Point2<f64>,
    /// Of each step, m/s².
    accelerations: Vec<Vector2<f64>>,
    /// Of a step, s.
    length: f64,
    /// Root of the covariance of a step's acceleration along one axis, m/s²: a column a step, and one of where it begins.
    root: DMatrix<f64>,
    /// Squared residuals in standard deviations.
    pub misfit: f64,
    /// Log of the probability of the places, but for a constant, times −2.
    pub surprise: f64,
}

/// What forces tell of a motion: how much is felt of a change of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathEffects {
    /// Readings a second.
    pub rate: f64,
    /// Standard deviation of one, per mass of the part, m/s².
    pub noise: f64,
    /// µ g of the plane: friction turns with the velocity, m/s².
    pub mu_g: f64,
    /// Until when there are readings, since the motion began, s.
    pub until: f64,
}

/// What is not known of a motion, by what is felt of it.
#[derive(Clone, Debug, Default)]
pub struct PathModes {
    /// One standard deviation of each: changes of the accelerations, m/s².
    pub modes: Vec<Vec<Vector2<f64>>>,
    /// What is felt of all others, standard deviations of all readings together, squared.
    pub rest: f64,
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
        let steps = self.steps(onset)?;
        let information = steps.of_places.tr_mul(&steps.of_places);
        let Fit { found: [x, y], precision, misfit, evidence } =
            self.fitted_with(&steps, &information, wandering.way)?;
        let accelerations = (1..x.len()).map(|row| Vector2::new(x[row], y[row])).collect();
        // C = (L Lᵀ)⁻¹, so that L⁻ᵀ is a root of it.
        let count = x.len();
        let root = precision.l().tr_solve_lower_triangular(&DMatrix::identity(count, count))?;
        Some(FittedPath {
            start: Point2::new(x[0], y[0]),
            accelerations,
            length: steps.length,
            root: root.rows(1, count - 1).into_owned(),
            misfit,
            surprise: -evidence,
        })
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

impl FittedPath {
    /// The motion, its accelerations changed by so much of some modes; none where there is nothing of it.
    ///
    /// Until its way is known it goes straight on, to where it then is and as fast: noise alone must not turn it.
    #[must_use]
    pub fn motion<'m>(&self, off: impl IntoIterator<Item = (f64, &'m [Vector2<f64>])>) -> Option<FingerMotion> {
        let mut accelerations = self.accelerations.clone();
        for (share, mode) in off {
            accelerations.iter_mut().zip(mode).for_each(|(own, more)| *own += more * share);
        }
        let count = self.ways().into_iter().take_while(|(_, sd)| *sd > TOLD_RAD).count();
        let (begun, rest) = accelerations.split_at((count + 1).min(accelerations.len()));
        let (mut velocity, mut way) = (Vector2::zeros(), Vector2::zeros());
        for acceleration in begun {
            way += velocity * self.length + acceleration * (0.5 * self.length * self.length);
            velocity += acceleration * self.length;
        }
        let seconds = self.length * begun.len() as f64;
        let first = Segment { seconds, acceleration: velocity / seconds };
        let rest = rest.iter().map(|&acceleration| Segment { seconds: self.length, acceleration });
        let segments: Vec<_> = std::iter::once(first).chain(rest).collect();
        FingerMotion::new(self.start + way - velocity * (0.5 * seconds), &segments).ok()
    }

    /// At the end of each step, when that is, s, the velocity, m/s, and how uncertain that is along one axis, m/s.
    fn velocities(&self) -> Vec<(f64, Vector2<f64>, f64)> {
        let mut velocity = Vector2::zeros();
        let mut row = RowDVector::zeros(self.root.ncols());
        let mut time = 0.0;
        let step = |(index, acceleration): (usize, &Vector2<f64>)| {
            velocity += acceleration * self.length;
            row += self.root.row(index) * self.length;
            time += self.length;
            (time, velocity, row.norm())
        };
        self.accelerations.iter().enumerate().map(step).collect()
    }

    /// How uncertain the finger's way is at the end of each step, and when that is, s and rad; at most 1.
    #[must_use]
    pub fn ways(&self) -> Vec<(f64, f64)> {
        let way = |(time, velocity, sd): (f64, Vector2<f64>, f64)| (time, (sd / velocity.norm()).min(1.0));
        self.velocities().into_iter().map(way).collect()
    }

    /// The modes of what is not known of it, as many as matter and no more than `most`, those first of which most is felt.
    #[must_use]
    pub fn modes(&self, effects: &PathEffects, most: usize) -> PathModes {
        let felt = self.felt(effects);
        let total = felt.norm_squared();
        let most = most.min(felt.ncols());
        // Subspace iteration from smooth columns.
        let smooth = |row: usize, column: usize| {
            (std::f64::consts::PI * (row as f64 + 0.5) * (column as f64 + 0.5) / felt.ncols() as f64).cos()
        };
        let mut found = DMatrix::from_fn(felt.ncols(), most, smooth);
        for _ in 0..MODE_ROUNDS {
            found = felt.tr_mul(&(&felt * found)).qr().q();
        }
        let effects = &felt * &found;
        let eigen = effects.tr_mul(&effects).symmetric_eigen();
        let mut order: Vec<_> = (0..eigen.eigenvalues.len()).collect();
        order.sort_by(|a, b| eigen.eigenvalues[*b].total_cmp(&eigen.eigenvalues[*a]));
        let told = order.iter().filter(|n| eigen.eigenvalues[**n] > FELT_MIN);
        let (mut modes, mut rest) = (Vec::new(), total);
        let columns = self.root.ncols();
        for &n in told {
            rest -= eigen.eigenvalues[n];
            let of = &found * eigen.eigenvectors.column(n);
            let [x, y] = [0, 1].map(|axis| &self.root * of.rows(axis * columns, columns));
            modes.push(x.iter().zip(y.iter()).map(|(x, y)| Vector2::new(*x, *y)).collect());
        }
        PathModes { modes, rest: rest.max(0.0) }
    }

    /// What is felt of one standard deviation of everything independent that is not known, in standard deviations of the
    /// readings: inertia, the turn of friction, and where the finger is at the end.
    fn felt(&self, effects: &PathEffects) -> DMatrix<f64> {
        let (steps, columns) = self.root.shape();
        let scale = (effects.rate * self.length).sqrt() / effects.noise;
        let mut felt = DMatrix::zeros(3 * steps + 2, 2 * columns);
        let mut velocity = RowDVector::zeros(columns);
        let mut place = RowDVector::zeros(columns);
        for (index, (time, at, sd)) in self.velocities().into_iter().enumerate() {
            if time > effects.until {
                break;
            }
            let acceleration = self.root.row(index);
            place += &velocity * self.length + acceleration * (0.5 * self.length * self.length);
            velocity += acceleration * self.length;
            for axis in 0..2 {
                felt.view_mut((3 * index + axis, axis * columns), (1, columns)).copy_from(&(acceleration * scale));
            }
            // Before the way is known friction tells nothing of it.
            let speed = at.norm();
            if sd <= TOLD_RAD * speed {
                let turn = Vector2::new(-at.y, at.x) * (effects.mu_g * scale / (speed * speed));
                for axis in 0..2 {
                    let row = &velocity * turn[axis];
                    felt.view_mut((3 * index + 2, axis * columns), (1, columns)).copy_from(&row);
                }
            }
        }
        for axis in 0..2 {
            let row = &place / PLACE_FELT_M;
            felt.view_mut((3 * steps + axis, axis * columns), (1, columns)).copy_from(&row);
        }
        felt
    }
}

/// A mode of which less is felt does not matter: squared, standard deviations of all readings together.
const FELT_MIN: f64 = 0.05;

/// So far off at the end a finger counts as much as one standard deviation of all readings, m: poses are told to 10 µm.
const PLACE_FELT_M: f64 = 1e-5;

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
            let motion = fitted.motion([]).unwrap();
            let misfit = fitted.misfit / wandering.degrees_of_freedom;
            assert!((0.4..2.0).contains(&misfit), "{misfit} {wandering:?}");
            let mut squares = 0.0;
            let mut from = 0.0;
            for segment in motion.segments() {
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
