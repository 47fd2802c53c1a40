//! The effective mass of a finger, from what it feels while it is waved in the air.
//!
//! Nothing touches the finger, so that all that its gauges read beside bias and weight is its own inertia, −m a. The motion
//! is told; when it began by the readings' clock is found, and so is how the motion's axes lie in the finger's, for a
//! finger that is mounted turned. Bias and weight are one constant, which may drift evenly; of a finger that is mounted
//! tilted [`WaveFit::bias`] takes the weight out, since that is the mass times a part of gravity.
//!
//! Implements: least squares of the means under the windows of
//! [`hann_windows`], which hum and ringing do not reach:
//! F = c + d t − m R(ψ) a(t − t₀), unknown m, ψ, c, d, t₀. The search begins at the best of all t₀ a hundredth of a second
//! apart. The noise is what the fit leaves. Standard deviations count overlapping windows for what they are worth.
//! The last third of the motion is held back from a first fit and judges it.
//!
//! Assumes: a wrist that does not turn; nothing touches disk or wires. Frames: readings in finger axes, the motion in its
//! own. Units: SI, or the calibration's unit of force for N. Errors: [`WaveError`].

use nalgebra::{SVector, Vector2};

use crate::finger::contact::Reading;
use crate::math::least_squares::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};
use crate::pushing::estimation::from_rest::hann_windows::{self, LENGTH_S, NEIGHBOUR_CORRELATION};
use crate::pushing::finger_motion::{FingerMotion, Segment};

/// Unknowns: m cos ψ, m sin ψ (kg), c (N), d (N/s), t₀ (s).
const UNKNOWNS: usize = 7;

/// Where among them the motion's beginning is.
const BEGAN: usize = 6;

/// Starts are tried so far apart, s: a quarter of a window, within which a fit finds its way.
const START_STEP_S: f64 = 0.01;

/// A difference of t₀ that stands for a derivative, s: a thousandth of a window.
const DIFFERENCE_S: f64 = 4e-5;

/// A window counts that has this share of the readings of the fullest.
const COVERED_MIN: f64 = 0.9;

/// Share of the motion, from its beginning, that the judged fit is made from.
const FITTED_SHARE: f64 = 2.0 / 3.0;

/// A mass known worse than this share of itself is not worth keeping: a prior from drawings is as good.
const SHARE_MAX: f64 = 0.05;

/// Held-back windows may be off by so many times what the fit leaves: by chance never, a wire that pulls makes ten.
const HELD_BACK_TIMES: f64 = 3.0;

/// Or by this share of the inertia that was felt, rms: the prior from drawings again.
const HELD_BACK_SHARE: f64 = 0.05;

/// A motion to wave a finger with, in its plane and back to where it was: five swings along each axis, up to `peak` m/s².
///
/// Each takes 0.4 s and goes `peak` × 10 ms² to the side: 3 cm at 3 m/s².
///
/// # Errors
/// As [`FingerMotion::new`]: a peak that is 0 or no number.
pub fn swings(peak: f64) -> Result<FingerMotion, crate::pushing::finger_motion::MotionError> {
    let swing = |axis: Vector2<f64>| {
        [(0.1, 1.0), (0.2, -1.0), (0.1, 1.0)]
            .map(|(seconds, sign)| Segment { seconds, acceleration: axis * (sign * peak) })
    };
    let axes = [Vector2::x(), Vector2::y()];
    let segments: Vec<_> = (0..5).flat_map(|_| axes).flat_map(swing).collect();
    FingerMotion::new(nalgebra::Point2::origin(), &segments)
}

/// A number with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Measured {
    /// The number.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// What a wave says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WaveFit {
    /// Effective mass, kg.
    pub effective_mass: Measured,
    /// Angle of the motion's x axis in finger axes, rad.
    pub mounting: Measured,
    /// When the motion began, by the readings' clock, s.
    pub began: Measured,
    /// Bias and weight in the middle of the readings, finger axes, N.
    pub constant: Vector2<f64>,
    /// Standard deviation of either component, N.
    pub constant_sd: f64,
    /// How fast they changed, N/s.
    pub drift: Vector2<f64>,
    /// What is left of a window, rms, N.
    pub left: f64,
    /// What the held-back part says.
    pub held_back: HeldBackWave,
}

/// A fit of the first part of a motion against the rest of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldBackWave {
    /// Windows that were held back.
    pub windows: usize,
    /// What of them is not foretold, rms, N.
    pub off: f64,
    /// The inertia that was foretold there, rms, N.
    pub inertia: f64,
}

/// Why a wave says nothing.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum WaveError {
    /// The motion is longer than the readings.
    #[error(
        "the readings last {readings:.2} s and the motion {motion:.2} s: record from before it begins to after its end"
    )]
    TooShort {
        /// From the first reading to the last, s.
        readings: f64,
        /// Duration of the motion, s.
        motion: f64,
    },
    /// The motion never changes how fast the finger is, or along no two windows alike.
    #[error("the motion does not tell mass from bias: accelerate both ways, for longer than {LENGTH_S} s each")]
    SaysNothing,
    /// The mass comes out too poorly.
    #[error("the effective mass comes out as {mass:.2e} kg, give or take {sd:.1e}: wave faster, or for longer")]
    TooWeak {
        /// kg.
        mass: f64,
        /// Its standard deviation, kg.
        sd: f64,
    },
    /// The held-back part of the motion is not foretold.
    #[error(
        "the last third of the motion is felt {off:.4} N off what the first two foretell, and {allowed:.4} N is allowed: \
         does a wire pull, does something touch, was the motion another one?"
    )]
    HeldBack {
        /// rms, N.
        off: f64,
        /// N.
        allowed: f64,
    },
}

impl WaveFit {
    /// The bias alone, of a finger across which gravity has this part, finger axes, m/s²; and its standard deviation, N.
    #[must_use]
    pub fn bias(&self, gravity_finger: Vector2<f64>) -> (Vector2<f64>, f64) {
        let bias = self.constant - gravity_finger * self.effective_mass.value;
        (bias, self.constant_sd.hypot(gravity_finger.norm() * self.effective_mass.sd))
    }
}

/// Finds the effective mass from readings (tared or not) of a finger in the air that moved so at some time.
///
/// ```
/// use nalgebra::Vector2;
/// use palpate::finger::contact::Reading;
/// use palpate::pushing::wave::{identify, swings};
///
/// let motion = swings(3.0)?;
/// let end = motion.duration();
/// // 23 g, a motion that begins after half a second, and no noise.
/// let felt = |t: f64| if (0.0..end).contains(&t) { motion.acceleration(t) * -0.023 } else { Vector2::zeros() };
/// let readings: Vec<_> = (0..5000).map(|n| Reading::new(f64::from(n) * 1e-3, felt(f64::from(n) * 1e-3 - 0.5))).collect();
/// let found = identify(&readings, &motion)?;
/// assert!((found.effective_mass.value - 0.023).abs() < 1e-5); // kg
/// assert!((found.began.value - 0.5).abs() < 1e-3); // s
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`WaveError`] says what to do otherwise.
pub fn identify(readings: &[Reading], motion: &FingerMotion) -> Result<WaveFit, WaveError> {
    let (Some(first), Some(last)) = (readings.first(), readings.last()) else {
        return Err(WaveError::TooShort { readings: 0.0, motion: motion.duration() });
    };
    let span = last.t - first.t;
    if span < motion.duration() {
        return Err(WaveError::TooShort { readings: span, motion: motion.duration() });
    }
    let all = Windows::new(readings, motion);
    let begun = all.begun(span).ok_or(WaveError::SaysNothing)?;
    let whole = all.descended(begun);
    let held_from = whole[BEGAN] + FITTED_SHARE * motion.duration();
    let (fitted, held) = all.split(held_from, whole[BEGAN] + motion.duration());
    let held_back = held.judged(&fitted.descended(whole));
    let (variance, covariance) = all.uncertainty(&whole).ok_or(WaveError::SaysNothing)?;
    let fit = fit(first.t, &whole, &covariance, variance.sqrt(), held_back);
    let Measured { value: mass, sd } = fit.effective_mass;
    // A number that is none is no mass either.
    if sd.is_nan() || sd > SHARE_MAX * mass {
        return Err(WaveError::TooWeak { mass, sd });
    }
    let allowed = (HELD_BACK_TIMES * fit.left).max(HELD_BACK_SHARE * held_back.inertia);
    if held_back.off.is_nan() || held_back.off > allowed {
        return Err(WaveError::HeldBack { off: held_back.off, allowed });
    }
    Ok(fit)
}

type Unknowns = SVector<f64, UNKNOWNS>;

/// What the unknowns and their covariance mean; times count from the first reading's.
fn fit(
    first_t: f64,
    found: &Unknowns,
    covariance: &nalgebra::SMatrix<f64, UNKNOWNS, UNKNOWNS>,
    left: f64,
    held_back: HeldBackWave,
) -> WaveFit {
    let inertia = Vector2::new(found[0], found[1]);
    let mass = inertia.norm();
    let block = covariance.fixed_view::<2, 2>(0, 0);
    // Along the vector its length is uncertain, across it its angle.
    let along = inertia / mass;
    let across = Vector2::new(-along.y, along.x);
    let sd_along = |way: Vector2<f64>| (way.transpose() * block * way)[0].max(0.0).sqrt();
    WaveFit {
        effective_mass: Measured { value: mass, sd: sd_along(along) },
        mounting: Measured { value: inertia.y.atan2(inertia.x), sd: sd_along(across) / mass },
        began: Measured { value: first_t + found[BEGAN], sd: covariance[(BEGAN, BEGAN)].max(0.0).sqrt() },
        constant: Vector2::new(found[2], found[3]),
        constant_sd: covariance[(2, 2)].max(covariance[(3, 3)]).max(0.0).sqrt(),
        drift: Vector2::new(found[4], found[5]),
        left,
        held_back,
    }
}

/// Means of the readings under windows, and the motion that they are compared with.
struct Windows<'m> {
    motion: &'m FingerMotion,
    /// Number, and mean force, N.
    means: Vec<(usize, Vector2<f64>)>,
    /// Middle of all, s since the first reading.
    middle: f64,
}

impl<'m> Windows<'m> {
    fn new(readings: &[Reading], motion: &'m FingerMotion) -> Self {
        let (first, last) = (readings[0].t, readings[readings.len() - 1].t);
        let count = hann_windows::count(last - first);
        let mut sums = vec![(0.0, Vector2::zeros()); count];
        for reading in readings {
            for (window, weight) in hann_windows::weights_at(reading.t - first, count) {
                sums[window].0 += weight;
                sums[window].1 += reading.force_finger * weight;
            }
        }
        let fullest = sums.iter().map(|(weight, _)| *weight).fold(0.0, f64::max);
        let full = sums.iter().enumerate().filter(|(_, (weight, _))| *weight >= COVERED_MIN * fullest);
        let means = full.map(|(window, (weight, sum))| (window, sum / *weight)).collect();
        Self { motion, means, middle: 0.5 * (last - first) }
    }

    /// Those that end before a time, and those between it and another, s since the first reading.
    fn split(&self, from: f64, to: f64) -> (Self, Self) {
        let of = |within: &dyn Fn(usize) -> bool| Self {
            means: self.means.iter().filter(|(window, _)| within(*window)).copied().collect(),
            ..*self
        };
        (
            of(&|window| hann_windows::end(window) <= from),
            of(&|window| hann_windows::start(window) >= from && hann_windows::end(window) <= to + LENGTH_S),
        )
    }

    /// Mean acceleration under a window of a motion that begins at a time.
    fn acceleration(&self, window: usize, began: f64) -> Vector2<f64> {
        let mut from = began;
        let under = |segment: &Segment| {
            let to = from + segment.seconds;
            let share = hann_windows::share_after(window, from) - hann_windows::share_after(window, to);
            from = to;
            segment.acceleration * share
        };
        self.motion.segments().iter().map(under).sum()
    }

    /// What is felt beyond what the unknowns say of a window, and how that changes with them, by component.
    fn residual(&self, (window, mean): (usize, Vector2<f64>), at: &Unknowns) -> [(f64, Unknowns); 2] {
        let [p, q, cx, cy, dx, dy, began] = (*at).into();
        let a = self.acceleration(window, began);
        let late = self.acceleration(window, began + DIFFERENCE_S) - self.acceleration(window, began - DIFFERENCE_S);
        let rate = late / (2.0 * DIFFERENCE_S);
        let t = hann_windows::start(window) + 0.5 * LENGTH_S - self.middle;
        let along = |a: &Vector2<f64>| p * a.x - q * a.y;
        let aside = |a: &Vector2<f64>| q * a.x + p * a.y;
        [
            (mean.x - (cx + dx * t - along(&a)), Unknowns::from([a.x, -a.y, -1.0, 0.0, -t, 0.0, along(&rate)])),
            (mean.y - (cy + dy * t - aside(&a)), Unknowns::from([a.y, a.x, 0.0, -1.0, 0.0, -t, aside(&rate)])),
        ]
    }

    /// The unknowns at the best of all beginnings, with that; none where they cannot be told apart anywhere.
    fn begun(&self, span: f64) -> Option<Unknowns> {
        let latest = span - self.motion.duration();
        let begins = (0_u32..).map(|n| f64::from(n) * START_STEP_S).take_while(|began| *began <= latest);
        let tried = begins.filter_map(|began| {
            let mut start = Unknowns::zeros();
            start[BEGAN] = began;
            // Linear in all others: one step is the minimum.
            let mut equations = self.normal_equations(&start);
            equations.hold(std::array::from_fn(|unknown| unknown == BEGAN));
            let there = start + equations.gauss_newton_step()?;
            Some((self.cost(&there), there))
        });
        tried.min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, there)| there)
    }

    fn descended(&self, from: Unknowns) -> Unknowns {
        minimise(self, from, &LeastSquaresSettings::default(), |_| false).place
    }

    /// Variance of a mean, N², and covariance of the unknowns.
    fn uncertainty(&self, at: &Unknowns) -> Option<(f64, nalgebra::SMatrix<f64, UNKNOWNS, UNKNOWNS>)> {
        let equations = self.normal_equations(at);
        let freedom = (2 * self.means.len()).checked_sub(UNKNOWNS).filter(|freedom| *freedom > 0)?;
        let variance = equations.cost / freedom as f64;
        // Every value is alike to both its neighbours, which makes sums of slow terms that much less certain.
        let overlap = 1.0 + 2.0 * NEIGHBOUR_CORRELATION;
        Some((variance, equations.curvature.cholesky()?.inverse() * (variance * overlap)))
    }

    /// What unknowns from elsewhere say of these.
    fn judged(&self, by: &Unknowns) -> HeldBackWave {
        let count = (2 * self.means.len()).max(1) as f64;
        let mass = Vector2::new(by[0], by[1]).norm();
        let felt = |window: usize| (self.acceleration(window, by[BEGAN]) * mass).norm_squared();
        let inertia = self.means.iter().map(|(window, _)| felt(*window)).sum::<f64>();
        HeldBackWave {
            windows: self.means.len(),
            off: (self.cost(by) / count).sqrt(),
            inertia: (inertia / count).sqrt(),
        }
    }
}

impl LeastSquaresProblem<UNKNOWNS> for Windows<'_> {
    type Place = Unknowns;

    fn cost(&self, at: &Unknowns) -> f64 {
        self.means.iter().flat_map(|mean| self.residual(*mean, at)).map(|(residual, _)| residual * residual).sum()
    }

    fn normal_equations(&self, at: &Unknowns) -> NormalEquations<UNKNOWNS> {
        let mut equations = NormalEquations::zero();
        for (residual, slopes) in self.means.iter().flat_map(|mean| self.residual(*mean, at)) {
            equations.add(residual, slopes);
        }
        equations
    }

    fn moved(&self, at: &Unknowns, step: &Unknowns) -> Option<Unknowns> {
        Some(at + step)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    const MASS_KG: f64 = 0.0226;
    const RATE_HZ: f64 = 1000.0;

    /// Readings of a finger that is waved: turned by an angle, with bias, drift, weight and white noise.
    fn waved(seed: usize, motion: &FingerMotion, turned: f64, noise: f64) -> Vec<Reading> {
        let mut draw = Draw::case(3, seed);
        let turn = nalgebra::Rotation2::new(turned);
        let began = 0.7312;
        let mut reading = |since_start: f64| {
            let t = 100.0 + since_start;
            let since = since_start - began;
            let moves = (0.0..motion.duration()).contains(&since);
            let a = if moves { turn * motion.acceleration(since) } else { Vector2::zeros() };
            let constant = Vector2::new(0.2, -0.1) + Vector2::new(0.001, 0.002) * since;
            let noise = Vector2::new(draw.normal(), draw.normal()) * noise;
            Reading::new(t, constant - a * MASS_KG + noise)
        };
        let times = (0_u32..).map(|n| f64::from(n) / RATE_HZ);
        times.take_while(|time| *time < motion.duration() + 1.5).map(&mut reading).collect()
    }

    #[test]
    fn stated_deviations_are_those_of_many_waves() {
        let motion = swings(3.0).unwrap();
        let off: Vec<_> = (0..60)
            .map(|seed| {
                let found = identify(&waved(seed, &motion, 0.3, 0.01), &motion).unwrap();
                assert!((found.began.value - 100.7312).abs() < 5.0 * found.began.sd + 5e-4, "{found:?}");
                let mass = (found.effective_mass.value - MASS_KG) / found.effective_mass.sd;
                let angle = (found.mounting.value - 0.3) / found.mounting.sd;
                assert!(mass.abs() < 5.0 && angle.abs() < 5.0, "seed {seed}: {mass} {angle} {found:?}");
                mass * mass + angle * angle
            })
            .collect();
        let mean = off.iter().sum::<f64>() / (2.0 * off.len() as f64);
        // 120 squares: 1 ± 0.13, one standard deviation; overlap is counted in full, which is too much for fast terms.
        assert!((0.5..1.4).contains(&mean), "{mean}");
    }

    #[test]
    fn the_weight_of_a_tilted_finger_is_told_from_its_bias() {
        let motion = swings(3.0).unwrap();
        let gravity = Vector2::new(4.9, 0.0);
        let readings: Vec<_> = waved(1, &motion, 0.0, 0.005)
            .into_iter()
            .map(|reading| Reading::new(reading.t, reading.force_finger + gravity * MASS_KG))
            .collect();
        let found = identify(&readings, &motion).unwrap();
        let (bias, sd) = found.bias(gravity);
        // In the middle of the readings, where the drift has come to what it is.
        let at_middle = 0.5 * (motion.duration() + 1.5) - 0.7312;
        let wanted = Vector2::new(0.2, -0.1) + Vector2::new(0.001, 0.002) * at_middle;
        assert!((bias - wanted).amax() < 5.0 * sd && sd < 1e-3, "{bias} {wanted} ± {sd}");
    }

    #[test]
    fn another_motion_than_the_one_told_is_refused() {
        let readings = waved(2, &swings(3.0).unwrap(), 0.0, 0.005);
        let other = [(0.3, 1.0), (0.6, -1.0), (0.3, 1.0)]
            .map(|(seconds, sign)| Segment { seconds, acceleration: Vector2::new(sign, 0.0) });
        let told = FingerMotion::new(nalgebra::Point2::origin(), &other.repeat(2)).unwrap();
        assert!(identify(&readings, &told).is_err());
    }

    #[test]
    fn a_wave_lost_in_the_noise_is_refused() {
        let motion = swings(0.01).unwrap();
        let found = identify(&waved(3, &motion, 0.0, 0.01), &motion);
        assert!(matches!(found, Err(WaveError::TooWeak { .. })), "{found:?}");
    }

    #[test]
    fn a_recording_that_ends_early_is_refused() {
        let motion = swings(3.0).unwrap();
        let readings = waved(4, &motion, 0.0, 0.01);
        let found = identify(&readings[..2000], &motion);
        assert!(matches!(found, Err(WaveError::TooShort { .. })), "{found:?}");
    }
}
