//! Descent to a minimum of χ² (Levenberg and Marquardt), with corners free to change.

use super::Settled;
use super::objective::{Objective, Placed, Quadratic};

/// Steps tried in one descent; ten are usual.
const STEPS_MAX: usize = 120;

/// Damping at the start, as a share of the information.
const DAMPING_START: f64 = 1e-3;

/// Damping at which a step is as good as none: descent has stalled.
const DAMPING_MAX: f64 = 1e12;

/// A minimum is reached when a Newton step promises to lower χ² by less than this share of 1 + χ².
///
/// The pose is then within about 1e-6 standard deviations of the minimum.
pub(super) const PROMISE_MIN: f64 = 1e-12;

/// Where descent stalls, a promise up to this share is rounding: σ may be as small as 1e-6 rad.
const PROMISE_ROUNDING: f64 = 1e-7;

impl Objective<'_> {
    /// The minima that descent from a place leads to: one, or those of the valley in which it stalls; none if it stalls elsewhere.
    pub(super) fn settle(&self, start: &Placed) -> Vec<Settled> {
        let Some((placed, quadratic)) = self.descend(start) else { return Vec::new() };
        let promise = newton_promise(&quadratic);
        let smooth =
            || Settled { placed, chi2: quadratic.chi2, information: quadratic.information, at_corner_change: false };
        match promise {
            Some(promise) if promise <= PROMISE_ROUNDING * (1.0 + quadratic.chi2) => vec![smooth()],
            Some(_) => self.valley_minima(&placed),
            None => Vec::new(),
        }
    }

    /// Where descent ends.
    fn descend(&self, start: &Placed) -> Option<(Placed, Quadratic)> {
        let mut placed = *start;
        let mut here = self.quadratic(&placed)?;
        let mut damping = DAMPING_START;
        for _ in 0..STEPS_MAX {
            if damping > DAMPING_MAX || newton_promise(&here).is_some_and(|p| p <= PROMISE_MIN * (1.0 + here.chi2)) {
                break;
            }
            let mut damped = here.information;
            (0..3).for_each(|k| damped[(k, k)] *= 1.0 + damping);
            let Some(factors) = damped.cholesky() else {
                damping *= 10.0;
                continue;
            };
            let next = self.stepped(&placed, &-factors.solve(&here.gradient));
            match self.quadratic(&next).filter(|there| there.chi2 < here.chi2) {
                Some(there) => (placed, here, damping) = (next, there, damping * 0.1),
                None => damping *= 10.0,
            }
        }
        Some((placed, here))
    }
}

/// How much an undamped step would lower χ², if χ² were what it is to second order.
fn newton_promise(quadratic: &Quadratic) -> Option<f64> {
    let step = quadratic.information.cholesky()?.solve(&quadratic.gradient);
    Some(step.dot(&quadratic.gradient))
}
