//! From places that roughly fit the first contact to those that do.
//!
//! Units: SI, u in the unit of the finger's outline. Errors: none.

use super::{ContactInterval, TimedContact, Watched};
use crate::math::roots::{Look, NearZero, border, near_zeros};

/// Corrections of a place by its misfit over the slope: each gains several digits.
const CORRECTIONS: usize = 6;

/// A misfit that needs no further correction, in the unit of u: what the simulation itself is off by.
pub(super) const EXACT: f64 = 1e-10;

/// Places nearer than this, in steps of the grid, may be the two sides of a fold, where the slope says little.
const FOLD_STEPS: f64 = 2.5;

/// Distance over which the slope is taken, as a share of the interval's length.
const SLOPE_SHARE: f64 = 1e-4;

/// Places to either side of a rough one at which to simulate, and how far apart they are, in steps of the grid:
/// together a step and a half, beyond where the rough misfit can have moved the place.
const AROUND: i32 = 4;
const AROUND_STEP: f64 = 0.375;

/// A rough misfit as a function of s₀ on one interval, and how far it may be off.
pub(super) struct Rough<'a> {
    pub(super) interval: ContactInterval,
    pub(super) misfit: &'a dyn Fn(f64) -> Option<f64>,
    pub(super) grid: &'a [f64],
    pub(super) error: f64,
}

impl Watched<'_> {
    /// Places that fit the first contact within `tolerance`, exactly.
    pub(super) fn places(&self, rough: &Rough, first: TimedContact, tolerance: f64) -> Vec<NearZero> {
        let near = near_zeros(rough.misfit, rough.grid, tolerance + rough.error);
        let step = rough.grid[1] - rough.grid[0];
        let alone = |this: &NearZero| {
            let neighbours = near.iter().filter(|other| (other.at - this.at).abs() < FOLD_STEPS * step);
            neighbours.count() == 1
        };
        let closed = |near: &NearZero| {
            let single = alone(near).then(|| self.corrected(rough, near, first)).flatten();
            single.map_or_else(|| self.around(rough, near, first, tolerance), |single| vec![single])
        };
        let fitting = near.iter().flat_map(closed).filter(|near| near.value.abs() <= tolerance);
        fitting.filter_map(|near| self.lasting(rough, near, first, tolerance)).collect()
    }

    /// A place that fits, or, where its contact ends too soon, one beside it that fits too and whose contact lasts.
    fn lasting(&self, rough: &Rough, near: NearZero, first: TimedContact, tolerance: f64) -> Option<NearZero> {
        // With friction under the part a place whose contact ends has no misfit.
        if self.mu_g > 0.0 {
            return Some(near);
        }
        let look = |at: f64| {
            let angles = self.lasting_angles(&rough.interval, at, &[first.t])?;
            Some(Look { at, value: angles[0] - first.u })
        };
        if look(near.at).is_some() {
            return Some(near);
        }
        let step = rough.grid[1] - rough.grid[0];
        // No farther than the slope lets the misfit stay within its tolerance.
        let reach = (2.0 * tolerance / self.slope(rough, near.at)?.abs()).min(step);
        let [low, high] = rough.interval.side.range();
        let inside = [(near.at - reach).max(low), (near.at + reach).min(high)].into_iter().find_map(look)?;
        let Look { at, value } = border(&look, inside, near.at);
        (value.abs() <= tolerance).then_some(NearZero { at, value, ..near })
    }

    /// How the rough misfit changes with s₀.
    fn slope(&self, rough: &Rough, at: f64) -> Option<f64> {
        let look = SLOPE_SHARE * rough.interval.length();
        Some(((rough.misfit)(at + look)? - (rough.misfit)(at - look)?) / (2.0 * look))
    }

    pub(super) fn misfit(&self, interval: &ContactInterval, s0: f64, first: TimedContact) -> Option<f64> {
        Some(self.angle(interval, s0, first.t)? - first.u)
    }

    /// The place moved along the rough slope to where it fits; none where that does not lead there.
    fn corrected(&self, rough: &Rough, near: &NearZero, first: TimedContact) -> Option<NearZero> {
        let misfit = |s0: f64| self.misfit(&rough.interval, s0, first);
        if near.anywhere {
            return Some(NearZero { value: misfit(near.at)?, ..*near });
        }
        let slope = self.slope(rough, near.at)?;
        newton(near.at, slope, &misfit).filter(|found| found.value.abs() <= EXACT)
    }

    /// All that is found around a place by exact simulation.
    fn around(&self, rough: &Rough, near: &NearZero, first: TimedContact, tolerance: f64) -> Vec<NearZero> {
        let step = rough.grid[1] - rough.grid[0];
        let [low, high] = [rough.grid[0], rough.grid[rough.grid.len() - 1]];
        let mut grid: Vec<_> = (-AROUND..=AROUND)
            .map(|index| (near.at + AROUND_STEP * f64::from(index) * step).clamp(low, high))
            .collect();
        grid.dedup();
        near_zeros(&|s0| self.misfit(&rough.interval, s0, first), &grid, tolerance)
    }
}

/// Newton's method with a slope that is kept; ends where it no longer gets nearer.
fn newton(start: f64, slope: f64, misfit: &dyn Fn(f64) -> Option<f64>) -> Option<NearZero> {
    let (mut at, mut value) = (start, misfit(start)?);
    for _ in 0..CORRECTIONS {
        if value.abs() <= EXACT {
            break;
        }
        let next = at - value / slope;
        let Some(better) = misfit(next).filter(|better| better.abs() < value.abs()) else { break };
        (at, value) = (next, better);
    }
    Some(NearZero { at, value, anywhere: false })
}
