//! Friction measured by a push: µ of the plane and µ_c at the finger, from what explains the force.
//!
//! Every explanation of a push has a friction and a mass of its own, each with a standard deviation of its logarithm and that
//! of their product, which a slow push tells far better than either. A mass that was weighed therefore tells µ too. The
//! explanations are weighed by their probability, and by how well each agrees with the weighed mass.
//!
//! Units: SI. Errors: none; a push that explains nothing, or that agrees with no such mass, tells no friction.

use nalgebra::{Matrix2, Vector2};

use super::hypotheses::{Estimate, Hypothesis};
use crate::gravity::GRAVITY_ASSUMED;

/// Friction is told of a contact at the finger that slipped with at least this probability.
const SLIPPED: f64 = 0.5;

/// A weighed mass and what a push says may be so many standard deviations apart; further, one of them is wrong.
const AGREES_SDS: f64 = 5.0;

/// A positive quantity and how well it is known.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// Its value.
    pub value: f64,
    /// Standard deviation of its logarithm.
    pub log_sd: f64,
}

impl Told {
    /// What several explanations tell together: each with its weight, the logarithm of its value, and the variance of that. No
    /// number where no weight is above 0.
    #[must_use]
    pub fn mixed(explanations: impl Iterator<Item = (f64, f64, f64)> + Clone) -> Self {
        let sum = |of: &dyn Fn(f64, f64) -> f64| -> f64 {
            explanations.clone().map(|(weight, mean, variance)| weight * of(mean, variance)).sum()
        };
        let total = sum(&|_, _| 1.0);
        let mean = sum(&|mean, _| mean) / total;
        let variance = sum(&|own, variance| variance + (own - mean).powi(2)) / total;
        Self { value: mean.exp(), log_sd: variance.max(0.0).sqrt() }
    }

    /// Where it is with a probability of 95 %.
    #[must_use]
    pub fn interval(&self) -> [f64; 2] {
        /// Standard deviations to either side.
        const SDS: f64 = 1.959_964;
        [-SDS, SDS].map(|sds| self.value * (sds * self.log_sd).exp())
    }
}

/// Friction at the finger.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactFrictionTold {
    /// The contact slipped.
    Slipped(Told),
    /// It rolled or stuck, which took so much at the least.
    AtLeast(f64),
}

/// What a push tells of friction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionTold {
    /// µ of the plane.
    pub mu: Told,
    /// The part's mass, kg.
    pub mass: Told,
    /// µ times the mass, kg: what the plane resists with, over g.
    pub resistance: Told,
    /// µ_c at the finger.
    pub mu_c: ContactFrictionTold,
}

/// One explanation: ln µ and ln m with their covariance.
struct Explained<'e> {
    of: &'e Hypothesis,
    weight: f64,
    mean: Vector2<f64>,
    covariance: Matrix2<f64>,
}

impl<'e> Explained<'e> {
    fn new(of: &'e Hypothesis) -> Option<Self> {
        let force = of.from_force?;
        let (mu, mass, both) = (of.mu_g_log_sd?.powi(2), force.mass_log_sd.powi(2), force.resistance_log_sd.powi(2));
        // Var(a + b) = Var a + Var b + 2 Cov; rounding must not make it none.
        let most = 0.999_999 * (mu * mass).sqrt();
        let across = (0.5 * (both - mu - mass)).clamp(-most, most);
        let mean = Vector2::new((of.mu_g / GRAVITY_ASSUMED).ln(), force.mass.ln());
        Some(Self { of, weight: of.probability, mean, covariance: Matrix2::new(mu, across, across, mass) })
    }

    /// The same with a mass that was weighed; none where they disagree.
    fn weighed(self, mass: Told) -> Option<Self> {
        let (off, own) = (mass.value.ln() - self.mean.y, self.covariance[(1, 1)]);
        let variance = own + mass.log_sd.powi(2);
        if off.abs() > AGREES_SDS * variance.sqrt() {
            return None;
        }
        let gain = self.covariance.column(1) / variance;
        Some(Self {
            weight: self.weight * (-0.5 * off * off / variance).exp() / variance.sqrt(),
            mean: self.mean + gain * off,
            covariance: self.covariance - gain * self.covariance.row(1),
            ..self
        })
    }
}

/// What a push tells of friction, with a mass of the part that was weighed where it was; none where nothing explains the push
/// and that mass.
#[must_use]
pub fn friction_told(estimate: &Estimate, weighed: Option<Told>) -> Option<FrictionTold> {
    let explained = estimate.hypotheses.iter().filter_map(Explained::new);
    let explained: Vec<_> = match weighed {
        Some(mass) => explained.filter_map(|it| it.weighed(mass)).collect(),
        None => explained.collect(),
    };
    let total: f64 = explained.iter().map(|it| it.weight).sum();
    if total.is_nan() || total <= 0.0 {
        return None;
    }
    let along = |axis: Vector2<f64>| {
        let told = |it: &Explained| (it.weight, axis.dot(&it.mean), (it.covariance * axis).dot(&axis));
        Told::mixed(explained.iter().map(told))
    };
    let slipped = explained.iter().filter_map(|it| {
        let force = it.of.from_force?;
        let mu_c = force.mu_c?;
        Some((it.weight, mu_c.ln(), (force.mu_c_sd? / mu_c).powi(2)))
    });
    let has_slipped: f64 = slipped.clone().map(|(weight, ..)| weight).sum::<f64>() / total;
    let needed = explained.iter().filter_map(|it| it.of.from_force.map(|force| force.friction_needed));
    Some(FrictionTold {
        mu: along(Vector2::x()),
        mass: along(Vector2::y()),
        resistance: along(Vector2::repeat(1.0)),
        mu_c: if has_slipped >= SLIPPED {
            ContactFrictionTold::Slipped(Told::mixed(slipped))
        } else {
            ContactFrictionTold::AtLeast(needed.fold(f64::INFINITY, f64::min))
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Pose;
    use crate::pushing::dynamics::{ContactLaw, ContactMode, State};
    use crate::pushing::estimation::{Fit, FromForce};

    /// µ and mass, their deviations and that of the product; µ_c where it slipped.
    fn hypothesis(
        probability: f64,
        [mu, mass]: [f64; 2],
        [mu_sd, mass_sd, both]: [f64; 3],
        mu_c: Option<f64>,
    ) -> Hypothesis {
        let state = State { u: 0.1, s: 0.01, omega: 0.0, v_t: 0.0 };
        let pose = Pose { x: 0.0, y: 0.0, theta: 0.0 };
        Hypothesis {
            edge: 0,
            side: 0,
            start: state,
            contact_start: ContactMode::Rolling,
            end: state,
            contact_end: ContactMode::Rolling,
            law: ContactLaw::Rolling { friction: None },
            pose_start: pose,
            pose_end: pose,
            velocity_end: Vector2::zeros(),
            covariance: None,
            state_covariance: None,
            mu_g: mu * GRAVITY_ASSUMED,
            mu_g_log_sd: Some(mu_sd),
            from_force: Some(FromForce {
                mass,
                mass_log_sd: mass_sd,
                resistance_log_sd: both,
                mu_c,
                mu_c_sd: mu_c.map(|mu_c| 0.05 * mu_c),
                friction_needed: 0.12,
            }),
            cost: 1.0,
            probability,
        }
    }

    fn estimate(hypotheses: Vec<Hypothesis>) -> Estimate {
        let fit = Fit { cost: Some(1.0), degrees_of_freedom: 20, cost_max: 45.0 };
        Estimate { hypotheses, ..Estimate::unexplained(fit, 0.8) }
    }

    #[test]
    fn a_slow_push_tells_friction_once_the_part_is_weighed() {
        // Each alone within 20 %, the product within 1 %.
        let slow = estimate(vec![hypothesis(1.0, [0.25, 0.5], [0.2, 0.2, 0.01], None)]);
        let alone = friction_told(&slow, None).unwrap();
        assert!((alone.mu.value - 0.25).abs() < 1e-12 && (alone.mu.log_sd - 0.2).abs() < 1e-6, "{alone:?}");
        assert!((alone.resistance.value - 0.125).abs() < 1e-12 && (alone.resistance.log_sd - 0.01).abs() < 1e-6);
        assert_eq!(alone.mu_c, ContactFrictionTold::AtLeast(0.12));
        let weighed = friction_told(&slow, Some(Told { value: 0.4, log_sd: 1e-3 })).unwrap();
        assert!((weighed.mu.value - 0.125 / 0.4).abs() < 2e-3 && weighed.mu.log_sd < 0.012, "{weighed:?}");
        let [low, high] = weighed.mu.interval();
        assert!(low < 0.3125 && 0.3125 < high && high / low < 1.05, "{low} {high}");
    }

    #[test]
    fn explanations_that_a_weighed_mass_excludes_do_not_count() {
        let hypotheses = vec![
            hypothesis(0.6, [0.2, 0.6], [0.02, 0.02, 0.01], Some(0.4)),
            hypothesis(0.4, [0.3, 0.4], [0.02, 0.02, 0.01], Some(0.2)),
        ];
        let both = friction_told(&estimate(hypotheses.clone()), None).unwrap();
        assert!((0.2..0.3).contains(&both.mu.value) && both.mu.log_sd > 0.15, "{both:?}");
        let one = friction_told(&estimate(hypotheses.clone()), Some(Told { value: 0.4, log_sd: 1e-3 })).unwrap();
        assert!((one.mu.value - 0.3).abs() < 2e-3, "{one:?}");
        let ContactFrictionTold::Slipped(mu_c) = one.mu_c else { panic!("{one:?}") };
        assert!((mu_c.value - 0.2).abs() < 1e-9 && (mu_c.log_sd - 0.05).abs() < 1e-9, "{mu_c:?}");
        assert_eq!(friction_told(&estimate(hypotheses), Some(Told { value: 4.0, log_sd: 1e-3 })), None);
        assert_eq!(friction_told(&estimate(Vec::new()), None), None);
    }
}
