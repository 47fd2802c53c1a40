//! The windows under which force is averaged: raised cosines, each 40 ms long and 20 ms after the one before.
//!
//! Such a window takes out the hum of the mains at 50 Hz altogether (and at 60 Hz nearly), and the ringing of the
//! finger's disk at some 180 Hz to a thousandth, so that neither has to be known. Neighbours overlap by half:
//! independent noise has a correlation of 1/6 between them.
//!
//! Times are since the onset, s. Errors: none.

use std::f64::consts::{PI, TAU};

use nalgebra::Vector2;

/// Length of a window, s: two periods of the mains.
pub const LENGTH_S: f64 = 0.04;

/// From one window to the next, s.
pub const HOP_S: f64 = 0.02;

/// Spacing of the grid on which predicted forces are summed, s. Where the finger's acceleration changes, force bends
/// within some 10 ms: sums are then off by up to a thousandth of it.
pub(super) const GRID_S: f64 = 0.005;

/// Grid points in a window.
const GRID_POINTS: usize = 8;

/// Grid points from one window to the next.
pub(super) const GRID_HOP: usize = 4;

/// Correlation of neighbouring windows under independent noise.
pub(crate) const NEIGHBOUR_CORRELATION: f64 = 1.0 / 6.0;

/// How many windows are over by a time.
#[must_use]
pub fn count(duration: f64) -> usize {
    let past = (duration - LENGTH_S) / HOP_S + SAME;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not below 0; seconds over a hop")]
    let count = if past < 0.0 { 0 } else { past as usize + 1 };
    count
}

/// What a window lets through of an oscillation at the most, as a share of it; of slower ones than two in a window, all.
pub(super) fn let_through(frequency_hz: f64) -> f64 {
    let periods = frequency_hz * LENGTH_S;
    if periods < 2.0 { 1.0 } else { 1.0 / (PI * periods * (periods * periods - 1.0)) }
}

/// A share of a hop that rounding of times can reach.
const SAME: f64 = 1e-6;

/// When a window is over, s.
#[must_use]
pub fn end(window: usize) -> f64 {
    start(window) + LENGTH_S
}

/// When a window begins, s.
pub(crate) fn start(window: usize) -> f64 {
    f64::from(u32::try_from(window).unwrap_or(u32::MAX)) * HOP_S
}

/// Of a window, s.
pub(super) fn middle(window: usize) -> f64 {
    start(window) + 0.5 * LENGTH_S
}

/// Weight of a time in a window, relative to its mean; 0 outside.
pub(crate) fn weight(window: usize, time: f64) -> f64 {
    let share = (time - start(window)) / LENGTH_S;
    if (0.0..1.0).contains(&share) { 1.0 - (TAU * share).cos() } else { 0.0 }
}

/// The windows of the first `count` that hold a time, with its weight in each.
pub(crate) fn weights_at(time: f64, count: usize) -> impl Iterator<Item = (usize, f64)> {
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "negative times become 0, weight 0")]
    let last = (time / HOP_S) as usize;
    (last.saturating_sub(1)..(last + 1).min(count)).map(move |window| (window, weight(window, time)))
}

/// Share of a window's weight that is after a time.
pub(crate) fn share_after(window: usize, time: f64) -> f64 {
    match (time - start(window)) / LENGTH_S {
        share if share <= 0.0 => 1.0,
        share if share >= 1.0 => 0.0,
        share => 1.0 - share + (TAU * share).sin() / TAU,
    }
}

/// Mean under a window of what is given on the grid.
pub(super) fn mean_of_grid(window: usize, grid: &[Vector2<f64>]) -> Vector2<f64> {
    /// Weights of the grid points of a window after its start, where it is 0: (1 − cos(k π/4))/8.
    const WEIGHTS: [f64; GRID_POINTS - 1] = [
        0.036_611_652_351_681_56,
        0.125,
        0.213_388_347_648_318_44,
        0.25,
        0.213_388_347_648_318_44,
        0.125,
        0.036_611_652_351_681_56,
    ];
    let first = GRID_HOP * window + 1;
    WEIGHTS.iter().zip(&grid[first..]).map(|(weight, value)| value * *weight).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Against sums over the window of oscillations at all phases: never more, and at its most no less.
    #[test]
    fn a_window_lets_through_what_it_does_of_an_oscillation() {
        const STEPS: u32 = 4000;
        let most = |frequency: f64| {
            let times = (0..STEPS).map(|step| (f64::from(step) + 0.5) * LENGTH_S / f64::from(STEPS));
            let [along, across] = times.fold([0.0, 0.0], |[along, across], time| {
                let (sin, cos) = (TAU * frequency * time).sin_cos();
                [along + weight(0, time) * cos, across + weight(0, time) * sin]
            });
            along.hypot(across) / f64::from(STEPS)
        };
        let mut nearest = f64::INFINITY;
        for frequency in (60..400).map(f64::from) {
            let (all, told) = (most(frequency), let_through(frequency));
            assert!(all <= 1.001 * told, "{frequency} Hz: {all} of {told}");
            nearest = nearest.min(told / all);
        }
        assert!(nearest < 1.01, "{nearest}");
        // The default finger rings at 177 Hz: see the module's beginning.
        assert!((let_through(177.3) - 9e-4).abs() < 5e-5);
    }
}
