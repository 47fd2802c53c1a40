//! Direction of the contact from a force and its covariance.
//!
//! `u = atan2(−F_y, −F_x) − mounting`, in (−π, π]; force on the finger, finger axes. Its standard deviation is the
//! covariance propagated to first order, `σ_u² = J C Jᵀ` with `J = (−F_y, F_x)/|F|²`. For a force hardly larger than
//! its noise that is too small a figure, so [`ContactEstimate::interval`] does not use it: it solves for the angle exactly, as
//! Fieller did for ratios (E. C. Fieller, J. R. Stat. Soc. B 16, 1954), and says "any angle" where that is the answer.
//!
//! Friction turns the force away from the normal by an unknown angle of up to `atan(mu_c)`. That is not noise: it does
//! not average away, and is kept apart from the standard deviation as [`ContactEstimate::friction_half_angle`].

use std::f64::consts::PI;

use nalgebra::{Matrix2, Vector2};
use serde::Serialize;

use super::noise;
use crate::math::angle::{contact_angle, wrap_angle};
use crate::math::statistics::normal_quantile;

/// Standard deviation of an angle about which nothing is known, rad: of a uniform one, π/√3. None is ever larger.
const UNIFORM_SD: f64 = 1.813_799_364_234_217_8;

/// A contact that presses on the disk.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ContactEstimate {
    /// Polar angle of the contact seen from the disk's centre, rad in (−π, π], less the mounting angle. Exact only
    /// without friction; the direction opposite to the force in any case.
    pub u: f64,
    /// Standard deviation of `u` from noise, tare and calibration, rad, to first order; at most π/√3.
    pub u_sd: f64,
    /// `atan(mu_c)`: the contact's own angle may differ from `u` by this much, rad, besides the noise.
    pub friction_half_angle: f64,
    /// Tared force on the finger, finger axes.
    #[serde(with = "crate::math::arrays::vector")]
    pub force_finger: Vector2<f64>,
    /// Its covariance: noise, tare and calibration.
    #[serde(with = "crate::math::arrays::matrix")]
    pub force_covariance: Matrix2<f64>,
    /// Size of the force.
    pub magnitude: f64,
    /// Its standard deviation, to first order.
    pub magnitude_sd: f64,
    /// When this contact began, s.
    pub onset: f64,
}

/// A stretch of the circle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Interval {
    /// Its middle, rad in (−π, π].
    pub centre: f64,
    /// Half its width, rad; π is the whole circle.
    pub half_width: f64,
}

impl Interval {
    /// Whether `angle` (rad, any turn) lies in it.
    #[must_use]
    pub fn contains(&self, angle: f64) -> bool {
        wrap_angle(angle - self.centre).abs() <= self.half_width
    }
}

/// A tared force that has been found to be a touch.
pub(super) struct Sensed {
    pub(super) force_finger: Vector2<f64>,
    pub(super) force_covariance: Matrix2<f64>,
    pub(super) onset: f64,
}

impl ContactEstimate {
    pub(super) fn new(sensed: &Sensed, mounting_angle: f64, friction_half_angle: f64) -> Self {
        let Sensed { force_finger, force_covariance, onset } = *sensed;
        let magnitude = force_finger.norm();
        let axes = Axes::of(&force_finger, &force_covariance);
        Self {
            u: angle(&force_finger, mounting_angle),
            u_sd: (axes.across.sqrt() / magnitude).min(UNIFORM_SD),
            friction_half_angle,
            force_finger,
            force_covariance,
            magnitude,
            magnitude_sd: axes.along.sqrt(),
            onset,
        }
    }

    /// Where the contact is, with at least the given probability: noise and friction together.
    ///
    /// `coverage` in (0, 1). The friction part covers whatever the friction does; the noise part is
    /// [`ContactEstimate::noise_half_width`]. A contact without friction is covered with `mu_c = 0`.
    #[must_use]
    pub fn interval(&self, coverage: f64) -> Interval {
        let half_width = (self.friction_half_angle + self.noise_half_width(coverage)).min(PI);
        Interval { centre: self.u, half_width }
    }

    /// Half width, rad, of an interval about `u` that holds the force's true direction with probability at least
    /// `coverage`; π where the force is too small to say.
    ///
    /// With `z` the normal quantile that leaves `(1 − coverage)/2` on each side, the true force's line through the
    /// origin is within the angles `a` with `|F|² tan² a = z² (C_tt − 2 C_ft tan a + C_ff tan² a)`, `t` across and `f`
    /// along `F`; the larger of the two is taken for both sides. A line has two ends: which of them it is, only a
    /// force says that no force at all would exceed with probability above `1 − coverage`.
    #[must_use]
    pub fn noise_half_width(&self, coverage: f64) -> f64 {
        let nothing_squared = -2.0 * (1.0 - coverage).ln();
        if noise::mahalanobis(&self.force_finger, &self.force_covariance).powi(2) < nothing_squared {
            return PI;
        }
        let z_squared = normal_quantile(0.5 + 0.5 * coverage).powi(2);
        let axes = Axes::of(&self.force_finger, &self.force_covariance);
        let a = self.magnitude.powi(2) - z_squared * axes.along;
        let b = z_squared * axes.both.abs();
        let c = z_squared * axes.across;
        if a > 0.0 { ((b + (b * b + a * c).sqrt()) / a).atan() } else { PI }
    }

    /// Whether first-order propagation is good: the force is at least [`LINEAR_SIGMAS`] standard deviations.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        let sd_max_squared = self.force_covariance.symmetric_eigenvalues().max();
        self.magnitude.powi(2) >= LINEAR_SIGMAS.powi(2) * sd_max_squared
    }
}

/// Size of the force in standard deviations from which `u_sd` is right to 5 %.
pub const LINEAR_SIGMAS: f64 = 5.0;

/// The covariance along and across the force.
struct Axes {
    along: f64,
    across: f64,
    both: f64,
}

impl Axes {
    fn of(force: &Vector2<f64>, covariance: &Matrix2<f64>) -> Self {
        let along = force.try_normalize(0.0).unwrap_or_else(Vector2::x);
        let across = Vector2::new(-along.y, along.x);
        let form = |a: &Vector2<f64>, b: &Vector2<f64>| a.dot(&(covariance * b));
        // Rounding may leave a variance a hair below zero.
        Self {
            along: form(&along, &along).max(0.0),
            across: form(&across, &across).max(0.0),
            both: form(&along, &across),
        }
    }
}

/// Contact angle of a force on the finger, rad in (−π, π], less the mounting angle.
#[must_use]
pub fn angle(force_finger: &Vector2<f64>, mounting_angle: f64) -> f64 {
    wrap_angle(contact_angle(*force_finger) - mounting_angle)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::test_noise::Random;
    use super::*;

    /// Rounding of angles, rad.
    const ROUNDING: f64 = 1e-9;

    fn touch(force_finger: Vector2<f64>, force_covariance: Matrix2<f64>) -> ContactEstimate {
        ContactEstimate::new(&Sensed { force_finger, force_covariance, onset: 0.0 }, 0.0, 0.0)
    }

    fn rotation(angle: f64) -> Matrix2<f64> {
        Matrix2::new(angle.cos(), -angle.sin(), angle.sin(), angle.cos())
    }

    /// A covariance with the given standard deviations along axes turned by `turn`.
    fn covariance(sd: [f64; 2], turn: f64) -> Matrix2<f64> {
        let r = rotation(turn);
        r * Matrix2::from_diagonal(&Vector2::new(sd[0] * sd[0], sd[1] * sd[1])) * r.transpose()
    }

    #[test]
    fn the_contact_is_opposite_to_the_force_on_the_finger() {
        for (force, u) in [([-1.0, 0.0], 0.0), ([0.0, -2.0], PI / 2.0), ([0.5, 0.0], PI), ([0.0, 1.0], -PI / 2.0)] {
            let got = angle(&Vector2::from(force), 0.0);
            assert!((got - u).abs() < ROUNDING, "{force:?}: {got}, wanted {u}");
        }
    }

    #[test]
    fn no_force_at_all_says_any_angle() {
        let touch = touch(Vector2::zeros(), covariance([0.01, 0.01], 0.0));
        assert!((touch.u_sd - UNIFORM_SD).abs() < ROUNDING);
        assert!((touch.noise_half_width(0.9) - PI).abs() < ROUNDING);
        assert!(!touch.is_linear());
    }

    /// Senses a known force `n` times and gives the share of intervals that hold its direction.
    fn covered(force: Vector2<f64>, sd: [f64; 2], coverage: f64, seed: u64) -> f64 {
        let covariance = covariance(sd, 0.6);
        let spread = rotation(0.6) * Matrix2::from_diagonal(&Vector2::from(sd));
        let truth = angle(&force, 0.0);
        let mut random = Random(seed);
        let held = (0..TRIALS)
            .filter(|_| {
                let sensed = force + spread * random.normal2();
                touch(sensed, covariance).interval(coverage).contains(truth)
            })
            .count();
        held as f64 / f64::from(TRIALS)
    }

    const TRIALS: u32 = 20_000;
    /// Four standard errors of a share near 0.9 of [`TRIALS`].
    const SHARE_ERROR: f64 = 0.0085;

    #[test]
    fn intervals_cover_the_truth_as_often_as_stated_however_weak_the_force() {
        for (i, sigmas) in [0.1, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 10.0, 100.0].into_iter().enumerate() {
            for coverage in [0.6827, 0.9, 0.99] {
                let share = covered(Vector2::new(0.6, -0.8) * sigmas, [1.0, 0.5], coverage, i as u64);
                assert!(share > coverage - SHARE_ERROR, "{sigmas} sigmas: {share}, stated {coverage}");
            }
        }
    }

    #[test]
    fn intervals_of_strong_forces_are_not_wider_than_needed() {
        // With equal noise on both axes nothing is lost to making the interval symmetric.
        for coverage in [0.6827, 0.95] {
            let share = covered(Vector2::new(30.0, 10.0), [1.0, 1.0], coverage, 77);
            assert!((share - coverage).abs() < SHARE_ERROR, "{share}, stated {coverage}");
        }
    }

    #[test]
    fn friction_of_any_sign_is_covered() {
        let mu_c: f64 = 0.2;
        let mut random = Random(5);
        let noise = covariance([0.02, 0.02], 0.0);
        let held = (0..TRIALS)
            .filter(|_| {
                let (truth, slope) = (PI * (2.0 * random.uniform() - 1.0), mu_c * (2.0 * random.uniform() - 1.0));
                let normal = Vector2::new(-truth.cos(), -truth.sin());
                let force = normal + Vector2::new(-normal.y, normal.x) * slope + random.normal2() * 0.02;
                let sensed = Sensed { force_finger: force, force_covariance: noise, onset: 0.0 };
                ContactEstimate::new(&sensed, 0.0, mu_c.atan()).interval(0.9).contains(truth)
            })
            .count();
        assert!(held as f64 / f64::from(TRIALS) > 0.9, "{held} of {TRIALS}");
    }

    proptest! {
        #[test]
        fn turning_the_force_turns_the_contact_and_nothing_else(
            force in [-5.0..5.0, -5.0..5.0_f64], sd in [0.001..0.1, 0.001..0.1_f64], turn in -10.0..10.0_f64
        ) {
            let force = Vector2::from(force);
            prop_assume!(force.norm() > 0.01);
            let c = covariance(sd, 0.3);
            let (here, there) = (touch(force, c), touch(rotation(turn) * force, rotation(turn) * c * rotation(-turn)));
            prop_assert!(wrap_angle(there.u - here.u - turn).abs() < ROUNDING);
            prop_assert!((there.u_sd - here.u_sd).abs() < ROUNDING * (1.0 + here.u_sd));
            prop_assert!((there.magnitude_sd - here.magnitude_sd).abs() < ROUNDING);
        }

        #[test]
        fn the_mounting_angle_is_subtracted(force in [-5.0..5.0, -5.0..5.0_f64], mounting in -10.0..10.0_f64) {
            let force = Vector2::from(force);
            prop_assert!(wrap_angle(angle(&force, mounting) - angle(&force, 0.0) + mounting).abs() < ROUNDING);
        }

        #[test]
        fn units_of_force_do_not_matter(
            force in [-5.0..5.0, -5.0..5.0_f64], sd in [0.001..0.1, 0.001..0.1_f64], scale in 1e-6..1e6_f64
        ) {
            let force = Vector2::from(force);
            prop_assume!(force.norm() > 0.01);
            let c = covariance(sd, 1.1);
            let (here, there) = (touch(force, c), touch(force * scale, c * scale * scale));
            prop_assert!(wrap_angle(there.u - here.u).abs() < ROUNDING);
            prop_assert!((there.u_sd / here.u_sd - 1.0).abs() < ROUNDING);
            let (wide, wide_there) = (here.noise_half_width(0.95), there.noise_half_width(0.95));
            prop_assert!((wide - wide_there).abs() < 1e-6);
        }

        #[test]
        fn wrapped_angles_are_in_range_and_a_whole_number_of_turns_away(angle in -1e3..1e3_f64) {
            let wrapped = wrap_angle(angle);
            prop_assert!(wrapped > -PI && wrapped <= PI);
            let turns = (angle - wrapped) / std::f64::consts::TAU;
            prop_assert!((turns - turns.round()).abs() < ROUNDING);
        }

        #[test]
        fn first_order_agrees_with_many_noisy_copies(
            direction in -3.0..3.0_f64, sd in [0.01..0.1, 0.01..0.1_f64], turn in -3.0..3.0_f64, seed in any::<u64>()
        ) {
            let force = Vector2::new(direction.cos(), direction.sin());
            let c = covariance(sd, turn);
            let spread = rotation(turn) * Matrix2::from_diagonal(&Vector2::from(sd));
            let (mut random, n, u) = (Random(seed), 8000, angle(&force, 0.0));
            let square: f64 =
                (0..n).map(|_| wrap_angle(angle(&(force + spread * random.normal2()), 0.0) - u).powi(2)).sum();
            let seen = (square / f64::from(n)).sqrt();
            let said = touch(force, c).u_sd;
            // A standard deviation from 8000 copies is known to 0.8 %; six of those for the many cases run, and what
            // the second order adds: up to 3 % where the force itself is known to a tenth.
            prop_assert!((seen / said - 1.0).abs() < 0.1, "seen {seen}, said {said}");
        }
    }
}
