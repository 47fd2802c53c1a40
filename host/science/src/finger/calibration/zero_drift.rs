//! How the reading without load goes with temperature: a coefficient for each bridge, found at rest and taken off.
//!
//! `counts = counts at the first temperature + c (T − T₀)`. Compensated foil gauges leave about half a microstrain per kelvin, which
//! is 0.3° of a 2 N contact: the largest error of a finger that warms up after its tare. Found by a straight line through
//! means at rest while the room or the finger warms; what is left over tells the uncertainty, more of it where it
//! wanders slowly, as a hand's warmth at the beam makes it.
//!
//! Assumes: the sensor follows the gauges' temperature, which it does within minutes and not within seconds ([`FOLLOWED`]).
//! Units: °C, kelvin, counts, s. Errors: [`ZeroDriftError`].

use nalgebra::Vector2;
use thiserror::Error;

use crate::finger::judge::Judged;
use crate::math::statistics::mean;

/// Length of the stretches whose means are fitted, s: hum and noise are gone, and the temperature has not moved.
pub const STRETCH_S: f64 = 5.0;

/// Means that make a line at least: a minute.
pub const MEANS_MIN: usize = 12;

/// Change of temperature that makes a line at least, K. Below it what else wanders is taken for temperature's doing.
pub const SPAN_MIN_K: f64 = 0.5;

/// Share of what was taken off that is counted as uncertain all the same: sensor and gauges are not at one place.
pub const FOLLOWED: f64 = 0.1;

/// Time constant by which temperatures are smoothed, s. Of two neighbouring readings of the chip's own sensor one may be half a kelvin
/// off, and no finger warms so fast.
const SMOOTHING_S: f64 = 10.0;

/// Neighbouring residuals are never taken to be more alike than this.
const LIKENESS_MAX: f64 = 0.95;

/// How the reading without load changes with temperature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroDrift {
    /// Change of both bridges, counts per kelvin.
    pub counts_per_k: Vector2<f64>,
    /// Standard deviations, counts per kelvin.
    pub sd: Vector2<f64>,
}

impl ZeroDrift {
    /// What of a change of temperature stays uncertain once it is taken off, counts per kelvin, 1 σ, of the worse bridge.
    #[must_use]
    pub fn left_per_k(&self) -> f64 {
        let left = |axis: usize| self.sd[axis].hypot(FOLLOWED * self.counts_per_k[axis]);
        left(0).max(left(1))
    }
}

/// Means over a stretch at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RestMean {
    /// Temperature, °C.
    pub celsius: f64,
    /// What both bridges read, counts.
    pub counts: Vector2<f64>,
}

/// A line through means at rest.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroDriftFit {
    /// Its slope.
    pub drift: ZeroDrift,
    /// What it leaves, rms, counts.
    pub left: Vector2<f64>,
    /// Lowest and highest temperature, °C.
    pub celsius: (f64, f64),
    /// Means that it goes through.
    pub means: usize,
}

/// Why means make no line.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum ZeroDriftError {
    /// Too few.
    #[error("{found} stretches of {STRETCH_S} s at rest with a temperature, where at least {MEANS_MIN} are wanted")]
    TooFew {
        /// How many there are.
        found: usize,
    },
    /// The temperature stayed.
    #[error("the temperature changed by {span_k:.2} K, where at least {SPAN_MIN_K} K are wanted")]
    TooEven {
        /// By how much it changed.
        span_k: f64,
    },
}

/// Fits the line.
///
/// ```
/// use nalgebra::Vector2;
/// use palpate::finger::calibration::zero_drift::{RestMean, fit};
///
/// // 13 counts/K on x, −11 on y, some 0.5 and −0.4 microstrain/K.
/// let at = |k: i32| {
///     let celsius = 22.0 + 0.1 * f64::from(k);
///     RestMean { celsius, counts: Vector2::new(100.0 + 13.0 * celsius, -11.0 * celsius) }
/// };
/// let found = fit(&(0..20).map(at).collect::<Vec<_>>())?;
/// assert!((found.drift.counts_per_k - Vector2::new(13.0, -11.0)).norm() < 1e-6);
/// # Ok::<(), palpate::finger::calibration::zero_drift::ZeroDriftError>(())
/// ```
///
/// # Errors
/// [`ZeroDriftError`].
pub fn fit(means: &[RestMean]) -> Result<ZeroDriftFit, ZeroDriftError> {
    let middle = mean::<f64, _>(means.iter().map(|rest| rest.celsius)).filter(|_| means.len() >= MEANS_MIN);
    let middle = middle.ok_or(ZeroDriftError::TooFew { found: means.len() })?;
    let lowest = means.iter().map(|rest| rest.celsius).fold(f64::INFINITY, f64::min);
    let highest = means.iter().map(|rest| rest.celsius).fold(f64::NEG_INFINITY, f64::max);
    if highest - lowest < SPAN_MIN_K {
        return Err(ZeroDriftError::TooEven { span_k: highest - lowest });
    }
    let count = means.len() as f64;
    let offset = means.iter().map(|rest| rest.counts).sum::<Vector2<f64>>() / count;
    let spread: f64 = means.iter().map(|rest| (rest.celsius - middle).powi(2)).sum();
    let product: Vector2<f64> = means.iter().map(|rest| (rest.counts - offset) * (rest.celsius - middle)).sum();
    let counts_per_k = product / spread;
    let left: Vec<Vector2<f64>> =
        means.iter().map(|rest| rest.counts - offset - counts_per_k * (rest.celsius - middle)).collect();
    let squares: Vector2<f64> = left.iter().map(|left| left.component_mul(left)).sum();
    let neighbours: Vector2<f64> = left.windows(2).map(|pair| pair[0].component_mul(&pair[1])).sum();
    let sd = Vector2::from_fn(|axis, _| {
        // Residuals that wander tell as much as fewer that do not (first-order autoregression).
        let likeness =
            if squares[axis] > 0.0 { (neighbours[axis] / squares[axis]).clamp(0.0, LIKENESS_MAX) } else { 0.0 };
        (squares[axis] / (count - 2.0) / spread * (1.0 + likeness) / (1.0 - likeness)).sqrt()
    });
    let left = (squares / count).map(f64::sqrt);
    Ok(ZeroDriftFit { drift: ZeroDrift { counts_per_k, sd }, left, celsius: (lowest, highest), means: means.len() })
}

/// Makes means of what is felt at rest.
#[derive(Clone, Debug, Default)]
pub struct RestMeans {
    means: Vec<RestMean>,
    /// Of the stretch under way: when it began, the sum of its readings and of their temperatures, how many.
    under_way: Option<(f64, Vector2<f64>, f64, u32)>,
}

impl RestMeans {
    /// A reading, in whatever unit, with the temperature that it was taken at. A stretch with samples that are no measurements is left out.
    pub fn take(&mut self, judged: &Judged, celsius: Option<f64>) {
        let (Judged::Measured(reading), Some(celsius)) = (judged, celsius) else {
            self.under_way = None;
            return;
        };
        let (begun, sum, warmth, count) = self.under_way.get_or_insert((reading.t, Vector2::zeros(), 0.0, 0));
        if reading.t - *begun >= STRETCH_S {
            let count = f64::from(*count);
            self.means.push(RestMean { celsius: *warmth / count, counts: *sum / count });
            self.under_way = Some((reading.t, reading.force_finger, celsius, 1));
            return;
        }
        *sum += reading.force_finger;
        *warmth += celsius;
        *count += 1;
    }

    /// What there is so far.
    #[must_use]
    pub fn means(&self) -> &[RestMean] {
        &self.means
    }
}

/// What a change of temperature does to the readings of a stream, to be taken off.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Thermal {
    drift: ZeroDrift,
    /// The temperature that was told last, °C.
    told: Option<f64>,
    /// It smoothed, and the first of them, by which nothing is taken off: a tare is never far from it, and what is taken off changes
    /// steadily from there.
    smoothed: Option<(f64, f64)>,
}

impl Thermal {
    pub(crate) const fn new(drift: ZeroDrift) -> Self {
        Self { drift, told: None, smoothed: None }
    }

    /// It is so warm now.
    pub(crate) fn feel(&mut self, celsius: f64) {
        self.told = Some(celsius);
    }

    /// What is to be taken off a block of samples that is so many seconds long, counts.
    pub(crate) fn counts(&mut self, block_s: f64) -> Vector2<f64> {
        let Some(told) = self.told else { return Vector2::zeros() };
        let (now, first) = self.smoothed.get_or_insert((told, told));
        *now += (told - *now) * -(-block_s / SMOOTHING_S).exp_m1();
        self.drift.counts_per_k * (*now - *first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finger::contact::Reading;
    use crate::math::random::Draw;

    #[test]
    fn too_few_means_and_too_even_ones_are_refused_with_the_limit() {
        let at = |celsius: f64| RestMean { celsius, counts: Vector2::zeros() };
        assert_eq!(fit(&[at(20.0), at(30.0)]), Err(ZeroDriftError::TooFew { found: 2 }));
        let even: Vec<_> = (0..50).map(|k| at(20.0 + 0.009 * f64::from(k))).collect();
        assert!(matches!(fit(&even), Err(ZeroDriftError::TooEven { span_k }) if (span_k - 0.441).abs() < 1e-9));
    }

    /// White noise and noise that wanders, both of known size: the stated uncertainty holds the truth as often as it says.
    #[test]
    fn the_stated_uncertainty_holds_whether_the_rest_wanders_or_not() {
        for wanders in [0.0, 0.8] {
            let mut within = 0;
            let runs = 400;
            for seed in 0..runs {
                let mut random = Draw::new(seed);
                let mut red = 0.0;
                let truth = 12.0;
                let means: Vec<_> = (0..200)
                    .map(|k| {
                        let celsius = 22.0 + 2.0 * f64::from(k) / 200.0;
                        red = wanders * red + random.normal();
                        let counts = Vector2::new(truth * celsius + red, -truth * celsius);
                        RestMean { celsius, counts }
                    })
                    .collect();
                let found = fit(&means).unwrap();
                within += u32::from((found.drift.counts_per_k.x - truth).abs() < 1.96 * found.drift.sd.x);
                assert!((found.drift.counts_per_k.y + truth).abs() < 1e-6);
            }
            // 95 %; the estimate of how alike neighbours are is a little low, which takes some: 92 % for 0.8 (other draws). Three
            // standard deviations of 400 runs are 4 %.
            let share = f64::from(within) / f64::from(u32::try_from(runs).unwrap());
            assert!((0.88..0.985).contains(&share), "{share} for residuals alike by {wanders}");
        }
    }

    #[test]
    fn stretches_are_whole_or_left_out() {
        let mut means = RestMeans::default();
        let reading = |k: u32| {
            let t = 0.01 * f64::from(k);
            Judged::Measured(Reading::new(t, Vector2::new(t, 1.0)))
        };
        // Nothing before the first temperature; then two whole stretches and a broken one.
        (0..100).for_each(|k| means.take(&reading(k), None));
        (100..1101).for_each(|k| means.take(&reading(k), Some(25.0)));
        means.take(&Judged::Missing(Some(1)), Some(25.0));
        (1102..1500).for_each(|k| means.take(&reading(k), Some(25.0)));
        let found = means.means();
        assert_eq!(found.len(), 2);
        assert!((found[0].counts - Vector2::new(1.0 + 4.99 / 2.0, 1.0)).norm() < 1e-9, "{found:?}");
    }

    #[test]
    fn what_is_taken_off_begins_at_nothing_and_follows() {
        let drift = ZeroDrift { counts_per_k: Vector2::new(10.0, -5.0), sd: Vector2::new(1.0, 1.0) };
        let mut thermal = Thermal::new(drift);
        assert_eq!(thermal.counts(0.002), Vector2::zeros());
        thermal.feel(25.0);
        assert_eq!(thermal.counts(0.002), Vector2::zeros(), "the first temperature is what the tare knows");
        thermal.feel(27.0);
        (0..5000).for_each(|_| _ = thermal.counts(0.002));
        // 10 s: a time constant.
        let followed = 1.0 - (-1.0_f64).exp();
        assert!((thermal.counts(0.0) - Vector2::new(20.0, -10.0) * followed).norm() < 1e-2, "{thermal:?}");
        (0..100_000).for_each(|_| _ = thermal.counts(0.002));
        assert!((thermal.counts(0.0) - Vector2::new(20.0, -10.0)).norm() < 1e-6);
        // Its own uncertainty, and a tenth of 10.
        assert!((drift.left_per_k() - 2.0_f64.sqrt()).abs() < 1e-12);
    }
}
