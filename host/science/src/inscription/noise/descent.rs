//! Descent to a minimum of χ² by damped [`least_squares`], with corners free to change.

use nalgebra::Vector3;

use super::Settled;
use super::objective::{Objective, Placed};
use crate::math::least_squares::{
    self, Damping, Enough, Floor, LeastSquaresProblem, LeastSquaresSettings, NormalEquations,
};

/// How far steps go. Ten trials are usual.
const DESCENT: LeastSquaresSettings<3> = LeastSquaresSettings {
    damping: Damping {
        first: 1e-3,
        min: 0.0,
        max: 1e12,
        up: 10.0,
        min_after_failure: 0.0,
        down: 0.1,
        trusted_share: 0.0,
    },
    floor: Floor::NONE,
    enough: Enough { relative: 0.0, absolute: 0.0, damping_max: f64::INFINITY },
    trials_max: 120,
    steps_max: usize::MAX,
};

/// A minimum is reached when a Newton step is predicted to lower χ² by less than this share of 1 + χ².
///
/// The pose is then within about 1e-6 standard deviations of the minimum.
pub(super) const PREDICTED_REDUCTION_MIN: f64 = 1e-12;

/// Where descent stalls, a predicted reduction up to this share is rounding: σ may be as small as 1e-6 rad.
const PREDICTED_REDUCTION_ROUNDING: f64 = 1e-7;

/// Descents from one start, along valleys and across them, at most.
const DESCENTS_MAX: usize = 24;

impl Objective<'_> {
    /// The minima that descent from a place leads to: one, or those of the valleys in which it stalls; none if it stalls
    /// elsewhere.
    pub(super) fn settle(&self, start: &Placed) -> Vec<Settled> {
        let (mut settled, mut open) = (Vec::new(), vec![*start]);
        for _ in 0..DESCENTS_MAX {
            let Some(start) = open.pop() else { break };
            let Some(quadratic) = self.quadratic(&start) else { continue };
            let (placed, quadratic) = least_squares::minimise(self, (start, quadratic), &DESCENT, |_| false).place;
            let (chi2, information) = (quadratic.cost, quadratic.curvature);
            match newton_predicted_reduction(&quadratic) {
                Some(predicted_reduction) if predicted_reduction <= PREDICTED_REDUCTION_ROUNDING * (1.0 + chi2) => {
                    settled.push(Settled { placed, chi2, information, at_corner_change: false });
                }
                Some(_) => {
                    let along = self.along_valleys(&placed, 0.0);
                    settled.extend(along.minima);
                    open.extend(along.lower);
                }
                None => {}
            }
        }
        settled
    }
}

impl LeastSquaresProblem<3> for Objective<'_> {
    type Place = (Placed, NormalEquations<3>);

    fn cost(&self, (_, quadratic): &Self::Place) -> f64 {
        quadratic.cost
    }

    fn normal_equations(&self, (_, quadratic): &Self::Place) -> NormalEquations<3> {
        *quadratic
    }

    fn moved(&self, (placed, _): &Self::Place, step: &Vector3<f64>) -> Option<Self::Place> {
        let next = self.stepped(placed, step);
        Some((next, self.quadratic(&next)?))
    }

    fn is_minimum(&self, _: &Self::Place, quadratic: &NormalEquations<3>) -> bool {
        newton_predicted_reduction(quadratic)
            .is_some_and(|predicted_reduction| predicted_reduction <= PREDICTED_REDUCTION_MIN * (1.0 + quadratic.cost))
    }
}

/// How much an undamped step would lower χ², if χ² were what it is to second order.
fn newton_predicted_reduction(quadratic: &NormalEquations<3>) -> Option<f64> {
    Some(-quadratic.gauss_newton_step()?.dot(&quadratic.gradient))
}
