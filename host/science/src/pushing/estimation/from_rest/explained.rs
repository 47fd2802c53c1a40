//! What an explanation leaves of the force that was felt: for who looks at it.
//!
//! The explanation is fitted once more, from itself, because an answer does not keep what is found in closed form (the
//! onset, and of the finger's own mass what was not known beforehand).
//!
//! Frames: finger axes; force is the force on the finger's disk. Units: SI, times since the onset. Errors: none; of what
//! cannot be played there is nothing.

use nalgebra::Vector2;

use super::fit::Problem;
use super::{Hypothesis, KnownFromRest, WindowedForce, course, guess, hann_windows};
use crate::pushing::pushed_world::{Played, PushedWorld};

/// A contact that never slipped is played with this µ_c, or with what rolling took: rubber on a clean part.
const STICKS: f64 = 1.0;

/// The mean force under one window, and what of it is explained.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExplainedForce {
    /// Middle of the window, s.
    pub time: f64,
    /// Of the contact: what the finger's own mass takes is put back, N.
    pub felt: Vector2<f64>,
    /// What is felt and not explained, N.
    pub left: Vector2<f64>,
    /// Standard deviation of the mean along each axis, everything uncertain about it included, N.
    pub sd: Vector2<f64>,
}

impl KnownFromRest<'_> {
    /// The push as an answer has it, played to the end of the motion; none where it cannot be played: that world has edges
    /// and disks only.
    #[must_use]
    pub fn played(&self, hypothesis: &Hypothesis) -> Option<Played> {
        let force = hypothesis.from_force.filter(|_| self.shape.is_none())?;
        let world = PushedWorld {
            part: self.part,
            mu_g: hypothesis.mu_g,
            mass: force.mass,
            mu_c: force.mu_c.unwrap_or_else(|| STICKS.max(2.0 * force.friction_needed)),
            radius: self.radius,
            motion: self.motion,
            edge: hypothesis.side,
            u: hypothesis.start.u,
            s: hypothesis.start.s,
        };
        Some(world.play().ok()?.bent(self.finger.compliance))
    }

    /// The contact's mean force under each window, with the window's middle, s and N: where nothing explains it.
    #[must_use]
    pub fn explainable(&self, measured: &WindowedForce) -> Vec<(f64, Vector2<f64>)> {
        let of_contact = measured.of_contact(self.motion, self.finger);
        let windows = of_contact.forces_finger().iter().enumerate();
        windows.filter_map(|(window, felt)| Some((hann_windows::middle(window), (*felt)?))).collect()
    }

    /// What an answer leaves of the force that it was found from, window by window; where not all is known of the part, what
    /// that may change counts as uncertain.
    #[must_use]
    pub fn explained(&self, measured: &WindowedForce, hypothesis: &Hypothesis) -> Vec<ExplainedForce> {
        let of_contact = measured.of_contact(self.motion, self.finger);
        let measured = match &self.errors {
            Some(errors) => &of_contact.roughly(errors.share(self.part)),
            None => &of_contact,
        };
        let course = course(self, measured);
        let problem = Problem { course: &course, measured, mass: None };
        let Some(tried) = problem.try_onsets(guess(hypothesis, &course)) else { return Vec::new() };
        let tried = problem.descend(tried, usize::MAX);
        let lefts = measured.in_newtons(tried.rest());
        let windows = measured.forces_finger().iter().enumerate().filter_map(|(window, felt)| Some((window, (*felt)?)));
        let left_and_sd = lefts.into_iter().zip(measured.deviations());
        let explained = windows.zip(left_and_sd);
        explained
            .map(|((window, felt), (left, sd))| ExplainedForce { time: hann_windows::middle(window), felt, left, sd })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;

    use super::super::trial::{RADIUS_M, Ranges, random_part};
    use super::super::{CarriedFinger, Uncertainty, estimate};
    use super::*;
    use crate::gravity::GRAVITY_ASSUMED;
    use crate::math::random::Draw;

    /// Of one window's mean, N.
    const NOISE: f64 = 2e-3;

    /// What is left of a push that is explained is its noise, and of one with 20 mN more in one window these.
    #[test]
    fn what_an_explanation_leaves_is_noise_and_what_does_not_belong() {
        let mut draw = Draw::case(5, 0);
        let (part, ranges) = (random_part(&mut draw), Ranges::default());
        let drawn = ranges.draw(&mut draw, &part).unwrap();
        let uncertainty = Uncertainty {
            noise: Matrix2::identity() * NOISE.powi(2),
            noise_freedom: f64::INFINITY,
            bias: Matrix2::zeros(),
            drift_sd: Vector2::zeros(),
            drift_before: 0.0,
            calibration: None,
            onset_sd: 0.0,
            model_share: CarriedFinger::RIGID.model_share(),
        };
        let own = 0.02;
        let felt: Vec<_> = (0..hann_windows::count(drawn.played.duration()))
            .map(|window| {
                let times = (1..160).map(|k| hann_windows::start(window) + 2.5e-4 * f64::from(k));
                let force = |t: f64| drawn.played.force_finger(t) - ranges.motion.acceleration(t) * own;
                let weighed = times.map(|t| force(t) * hann_windows::weight(window, t)).sum::<Vector2<f64>>() / 160.0;
                weighed + Vector2::new(draw.normal(), draw.normal()) * NOISE
            })
            .collect();
        let measured = WindowedForce::new(felt.clone(), &uncertainty).unwrap();
        let known = KnownFromRest {
            part: &part,
            errors: None,
            mu_g: ranges.mu * GRAVITY_ASSUMED,
            mu_g_log_sd: None,
            radius: RADIUS_M,
            shape: None,
            finger: CarriedFinger { effective_mass: own, ..CarriedFinger::RIGID },
            motion: &ranges.motion,
        };
        let best = &estimate(&known, &measured).hypotheses[0];
        let explained = known.explained(&measured, best);
        assert_eq!(explained.len(), felt.len());
        let squares: f64 = explained.iter().map(|it| it.left.component_div(&it.sd).norm_squared()).sum();
        let per_value = squares / (2.0 * explained.len() as f64);
        assert!((0.4..1.6).contains(&per_value), "{per_value} squared deviations a value");
        assert!(explained.iter().all(|it| (it.sd.x - NOISE).abs() < 0.1 * NOISE), "{:?}", explained[0]);
        let peak = explained.iter().map(|it| it.felt.norm()).fold(0.0, f64::max);
        assert!(peak > 50.0 * NOISE, "{peak} N");

        let mut odd = felt;
        odd[12] += Vector2::new(0.02, 0.0);
        let measured = WindowedForce::new(odd, &uncertainty).unwrap();
        let most = |of: &ExplainedForce| of.left.norm();
        let explained = known.explained(&measured, best);
        let worst = explained.iter().max_by(|a, b| most(a).total_cmp(&most(b))).unwrap();
        assert!((worst.time - (0.24 + 0.02)).abs() < 1e-9 && worst.left.x > 0.01, "{worst:?}");

        let (played, truth) = (known.played(best).unwrap(), &drawn.played);
        let off =
            |t: f64| (played.pose(t).unwrap().translation.vector - truth.pose(t).unwrap().translation.vector).norm();
        assert!(off(0.1) < 2e-3 && off(0.7) < 2e-3, "{} m, {} m", off(0.1), off(0.7));
    }
}
