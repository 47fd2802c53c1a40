//! The ringing of a finger: found after a jump of what acts on it, and taken out of what it reads.
//!
//! Beam and disk swing in their first mode whenever the contact's force or the clamp's acceleration jump, a beam of steel for
//! a tenth of a second. What the finger would read without, `f`, is under it:
//!
//! ```text
//! reading(t) = f(t) + e^(−δ t) (a cos ω t + b sin ω t)
//! ```
//!
//! [`Ringing::found_in`] finds ω and δ where something has just jumped, by least squares with f a parabola (variable
//! projection: whatever is linear is solved for at each ω and δ). [`Ringing::steady`] takes a short stretch in which f is a
//! line, fits line and ringing together, and gives the line's value in the middle: the estimate of least variance that
//! ringing cannot move, whatever its phase (Gauss and Markov). A jump inside the stretch moves it.
//!
//! Source: G. H. Golub, V. Pereyra, "The Differentiation of Pseudo-Inverses and Nonlinear Least Squares Problems Whose
//! Variables Separate", SIAM J. Numer. Anal. 10 (1973) 413–432.
//! Assumes: one mode, of the same frequency and damping in both axes. Frames: those of the readings. Units: s, rad/s, the
//! readings' unit of force. Errors: none; where nothing rings there is none.

use std::f64::consts::TAU;

use nalgebra::{SVector, Vector2};

use super::contact::Reading;
use crate::math::least_squares::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};
use crate::math::statistics::{fisher_quantile, mean};

/// Slower fingers could not feel a push, and mains hum does not decay, Hz.
const FREQUENCY_MIN_HZ: f64 = 80.0;

/// Stiffer ones ring too little to be of concern, Hz.
const FREQUENCY_MAX_HZ: f64 = 1500.0;

/// Fewer readings of a period do not show it.
const READINGS_A_PERIOD: f64 = 5.0;

/// Frequencies are tried so far apart, as a share of what a stretch resolves.
const TRIED_APART: f64 = 0.25;

/// What the search begins with, 1/s: of a beam of steel.
const DECAY_TRIED: f64 = 25.0;

/// How noise may pass for ringing, once in so many times.
const CHANCE: f64 = 1e-9;

/// Relative step of the derivatives: errors of the third order are 1e-8 of the signal.
const STEP: f64 = 1e-4;

/// Readings beyond the unknowns without which a fit says nothing.
const SPARE: usize = 2;

/// How a finger rings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ringing {
    /// ω, rad/s.
    pub omega: f64,
    /// δ, 1/s.
    pub decay: f64,
}

impl Ringing {
    /// Hz.
    #[must_use]
    pub fn frequency_hz(&self) -> f64 {
        self.omega / TAU
    }

    /// e^(−δt) cos ωt and e^(−δt) sin ωt.
    fn parts(&self, t: f64) -> [f64; 2] {
        let left = (-self.decay * t).exp();
        [left * (self.omega * t).cos(), left * (self.omega * t).sin()]
    }

    /// The ringing in readings that begin just after a jump; none where nothing rings, or too little to tell.
    ///
    /// ```
    /// use nalgebra::Vector2;
    /// use palpate::finger::contact::Reading;
    /// use palpate::finger::ringing::Ringing;
    ///
    /// let reading = |k: u32| {
    ///     let t = 250e-6 * f64::from(k); // s
    ///     let rung = (-24.0 * t).exp() * (1114.0 * t).cos();
    ///     Reading::new(t, Vector2::new(-0.8 - 0.1 * t, 0.3) + Vector2::new(0.8, -0.3) * rung)
    /// };
    /// let readings: Vec<_> = (0..240).map(reading).collect();
    /// let ringing = Ringing::found_in(&readings).unwrap();
    /// assert!((ringing.omega - 1114.0).abs() < 0.1 && (ringing.decay - 24.0).abs() < 0.1);
    /// let steady = ringing.steady(&readings[..32]).unwrap();
    /// assert!((steady.force_finger - Vector2::new(-0.8 - 0.1 * steady.t, 0.3)).norm() < 1e-5);
    /// ```
    #[must_use]
    pub fn found_in(readings: &[Reading]) -> Option<Self> {
        let stretch = Stretch::of(readings)?;
        let period = 2.0 * stretch.half / (readings.len() - 1) as f64;
        let highest = FREQUENCY_MAX_HZ.min(1.0 / (READINGS_A_PERIOD * period));
        let apart = TRIED_APART / (2.0 * stretch.half);
        let tried = (0..).map(|k| FREQUENCY_MIN_HZ + f64::from(k) * apart).take_while(|frequency| *frequency < highest);
        let tried = tried.map(|frequency| Self { omega: TAU * frequency, decay: DECAY_TRIED });
        let costs = tried.map(|ringing| (stretch.cost(&ringing), ringing));
        let (_, first) = costs.min_by(|a, b| a.0.total_cmp(&b.0))?;
        let found = minimise(&stretch, first, &LeastSquaresSettings::default(), |_| false).place;
        let (without, with) = (norm_squared(&stretch.residuals::<CURVE>(None)), stretch.cost(&found));
        // Two of its own, and two for each axis.
        let (of_ringing, unknowns) = (6.0, 2 * (CURVE + 2) + 2);
        let freedom = (2 * readings.len()).checked_sub(unknowns).filter(|freedom| *freedom > 0)? as f64;
        let ratio = (without - with) / of_ringing / (with / freedom);
        let is_there = ratio > fisher_quantile(1.0 - CHANCE, of_ringing, freedom);
        let is_inside = (FREQUENCY_MIN_HZ..highest).contains(&found.frequency_hz()) && found.decay > 0.0;
        (is_there && is_inside).then_some(found)
    }

    /// What was read in the middle of a short stretch without the ringing; none of too few readings to tell.
    #[must_use]
    pub fn steady(&self, readings: &[Reading]) -> Option<Reading> {
        let stretch = Stretch::of(readings).filter(|_| readings.len() >= LINE + 2 + SPARE)?;
        let fits = stretch.fits::<{ LINE + 2 }>(LINE, Some(self))?;
        Some(Reading::new(stretch.middle, Vector2::from(fits.map(|fit| fit[0]))))
    }
}

/// The mean of a short stretch, at its mean time: what is steady in readings that do not ring.
#[must_use]
pub fn mean_reading(readings: &[Reading]) -> Option<Reading> {
    let t = mean(readings.iter().map(|reading| reading.t))?;
    Some(Reading::new(t, mean(readings.iter().map(|reading| reading.force_finger))?))
}

/// Coefficients of a line, and of a parabola.
const LINE: usize = 2;
const CURVE: usize = 3;

/// Readings with times since their middle.
struct Stretch<'r> {
    readings: &'r [Reading],
    /// Mean time, s.
    middle: f64,
    /// Half of the time from the first to the last, s.
    half: f64,
}

fn norm_squared(residuals: &[f64]) -> f64 {
    residuals.iter().map(|residual| residual * residual).sum()
}

impl<'r> Stretch<'r> {
    /// None of a single reading.
    fn of(readings: &'r [Reading]) -> Option<Self> {
        let half = 0.5 * (readings.last()?.t - readings.first()?.t);
        let middle = mean(readings.iter().map(|reading| reading.t))?;
        (half > 0.0).then_some(Self { readings, middle, half })
    }

    /// So many powers of the time since the middle, then the ringing's two parts.
    fn columns<const N: usize>(&self, powers: usize, ringing: Option<&Ringing>, reading: &Reading) -> SVector<f64, N> {
        let t = reading.t - self.middle;
        let rung = ringing.map_or([0.0; 2], |ringing| ringing.parts(t));
        let mut power = 1.0;
        SVector::from_fn(|index, _| {
            if index >= powers {
                return rung[index - powers];
            }
            let now = power;
            power *= t / self.half;
            now
        })
    }

    /// The coefficients of both axes; none where they cannot be told apart.
    fn fits<const N: usize>(&self, powers: usize, ringing: Option<&Ringing>) -> Option<[SVector<f64, N>; 2]> {
        let fit = |axis: usize| {
            let mut equations = NormalEquations::zero();
            for reading in self.readings {
                equations.add(-reading.force_finger[axis], self.columns::<N>(powers, ringing, reading));
            }
            equations.gauss_newton_step()
        };
        Some([fit(0)?, fit(1)?])
    }

    /// What a parabola, with ringing or without, leaves of all readings; infinite where it cannot be fitted.
    fn residuals<const N: usize>(&self, ringing: Option<&Ringing>) -> Vec<f64> {
        let Some(fits) = self.fits::<N>(CURVE, ringing) else { return vec![f64::INFINITY] };
        let of_reading = |reading: &Reading| {
            let columns = self.columns::<N>(CURVE, ringing, reading);
            [0, 1].map(|axis| reading.force_finger[axis] - fits[axis].dot(&columns))
        };
        self.readings.iter().flat_map(of_reading).collect()
    }

    fn rung_residuals(&self, ringing: &Ringing) -> Vec<f64> {
        self.residuals::<{ CURVE + 2 }>(Some(ringing))
    }
}

/// Unknowns: relative changes of ω and δ.
impl LeastSquaresProblem<2> for Stretch<'_> {
    type Place = Ringing;

    fn cost(&self, place: &Ringing) -> f64 {
        norm_squared(&self.rung_residuals(place))
    }

    fn normal_equations(&self, place: &Ringing) -> NormalEquations<2> {
        let beside = |index: usize, step: f64| {
            let step = SVector::<f64, 2>::from_fn(|row, _| if row == index { step } else { 0.0 });
            self.moved(place, &step).map(|place| self.rung_residuals(&place))
        };
        let slopes = [0, 1].map(|index| Some((beside(index, STEP)?, beside(index, -STEP)?)));
        let mut equations = NormalEquations::zero();
        let [Some(of_omega), Some(of_decay)] = slopes else { return equations };
        let slope = |(above, below): &(Vec<f64>, Vec<f64>), row: usize| (above[row] - below[row]) / (2.0 * STEP);
        for (row, residual) in self.rung_residuals(place).into_iter().enumerate() {
            equations.add(residual, SVector::from([slope(&of_omega, row), slope(&of_decay, row)]));
        }
        equations
    }

    fn moved(&self, place: &Ringing, step: &SVector<f64, 2>) -> Option<Ringing> {
        Some(Ringing { omega: place.omega * (1.0 + step[0]), decay: place.decay * step[1].exp() })
    }
}

#[cfg(test)]
mod tests {
    use palpate_shared::sim::{BeamConfig, Carriage, CarriedBeam, CarriedConfig};

    use super::*;
    use crate::math::random::Draw;

    const PERIOD_NS: u32 = 250_000;
    const PERIOD_S: f64 = 250e-6;

    /// What a force would be felt as by a finger without mass, N.
    fn force(t: f64) -> Vector2<f64> {
        Vector2::new(-0.7 - 0.2 * t, 0.3 * (2.0 * t).sin() + 0.1)
    }

    /// The readings of a simulated carried finger on which that force acts from 0 on, with its noise.
    fn readings(noise: f64, seed: u64) -> Vec<Reading> {
        let mut beam = CarriedBeam::new(BeamConfig::default(), CarriedConfig::default());
        let mut draw = Draw::case(seed, 0);
        let read = |index: u32| {
            let from = f64::from(index) * PERIOD_S;
            let felt = beam.advance(PERIOD_NS, |after| {
                let force = force(from + 1e-9 * f64::from(after));
                #[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
                let force = [force.x as f32, force.y as f32];
                Carriage { force, ..Carriage::default() }
            });
            let noise = Vector2::new(draw.normal(), draw.normal()) * noise;
            // A mean over the period.
            Reading::new(from + 0.5 * PERIOD_S, Vector2::from(felt.map(f64::from)) + noise)
        };
        (0..800).map(read).collect()
    }

    #[test]
    fn a_simulated_fingers_ringing_is_found_and_taken_out() {
        for (noise, off) in [(0.0, 5e-4), (2e-3, 4e-3)] {
            let readings = readings(noise, 1);
            let ringing = Ringing::found_in(&readings[4..240]).unwrap();
            // 177.3 Hz by the finite elements of the end-to-end tests.
            assert!((ringing.frequency_hz() - 177.3).abs() < 1.0, "{} Hz", ringing.frequency_hz());
            for stretch in readings.chunks(32) {
                let steady = ringing.steady(stretch).unwrap();
                let error = (steady.force_finger - force(steady.t)).norm();
                assert!(error < off, "{error} N at {} s, noise {noise} N", steady.t);
                // A mean alone is off by a twentieth of the force at first.
                let mean = mean_reading(stretch).unwrap();
                let of_mean = (mean.force_finger - force(mean.t)).norm();
                assert!(steady.t > 0.02 || of_mean > 0.03, "{of_mean} N");
            }
        }
    }

    #[test]
    fn noise_and_hum_are_no_ringing() {
        for seed in 0..20 {
            let mut draw = Draw::case(7, seed);
            let reading = |k: u32| {
                let t = f64::from(k) * PERIOD_S;
                let hum = 0.01 * (TAU * 50.0 * t).sin();
                Reading::new(t, force(t) + Vector2::new(draw.normal() + hum, draw.normal()) * 2e-3)
            };
            assert_eq!(Ringing::found_in(&(0..240).map(reading).collect::<Vec<_>>()), None, "seed {seed}");
        }
    }

    #[test]
    fn too_few_readings_tell_nothing() {
        let readings = readings(0.0, 1);
        let ringing = Ringing { omega: 1114.0, decay: 24.0 };
        assert_eq!(ringing.steady(&readings[..4]), None);
        assert_eq!(ringing.steady(&readings[..1]), None);
        assert_eq!(Ringing::found_in(&readings[..6]), None);
        assert_eq!(mean_reading(&[]), None);
    }
}
