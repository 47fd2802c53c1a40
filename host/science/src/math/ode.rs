//! One step in time of an ordinary differential equation, by the classical Runge–Kutta method of order 4.
//!
//! With the rates k₁ at the start, k₂ and k₃ at the middle and k₄ at the end of a step of `dt`, each at the state that
//! the rates before it lead to, the state moves by `(k₁ + 2 (k₂ + k₃) + k₄) dt/6`.
//!
//! A state and its rates may be of different kinds: an attitude moves along a turning rate. How a state [`Moves`] is
//! its own affair, and so is what brings it back where it belongs after a step (an orientation's length, say).
//!
//! Implements: Hairer, Nørsett, Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., II.1, table 1.2.
//! Assumes: rates smooth within the step; events are the caller's.
//! Units: those of the state; time in s. Errors: only those that the rates have; no error is estimated.

use std::convert::Infallible;
use std::ops::{Add, Mul};

use nalgebra::SVector;

/// Where in a step rates are asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moment {
    /// At the step's beginning.
    Start,
    /// Half-way through the step.
    Middle,
    /// At the step's end.
    End,
}

impl Moment {
    /// The share of the step that is over.
    #[must_use]
    #[inline(always)]
    pub fn share(self) -> f64 {
        match self {
            Self::Start => 0.0,
            Self::Middle => 0.5,
            Self::End => 1.0,
        }
    }

    /// The time in a step of `dt` that begins at `time`, s.
    #[must_use]
    #[inline(always)]
    pub fn time(self, time: f64, dt: f64) -> f64 {
        time + self.share() * dt
    }
}

/// A state that changes at rates `R`.
pub trait Moves<R> {
    /// The state after `dt` (s) at constant rates.
    #[must_use]
    fn moved(&self, rates: &R, dt: f64) -> Self;
}

impl<const N: usize> Moves<Self> for SVector<f64, N> {
    #[inline(always)]
    fn moved(&self, rates: &Self, dt: f64) -> Self {
        self + rates * dt
    }
}

/// Rates, of which a step takes a mean.
pub trait Rates: Copy + Add<Output = Self> + Mul<f64, Output = Self> {}

impl<R: Copy + Add<Output = Self> + Mul<f64, Output = Self>> Rates for R {}

/// The state one step of `dt` (s) later.
///
/// ```
/// use nalgebra::Vector2;
/// use palpate::math::ode;
///
/// // A pendulum of 1 m swings through small angles: (angle, rad; its rate, rad/s).
/// let rates = |_, state: &Vector2<f64>| Vector2::new(state.y, -9.81 * state.x);
/// let end = (0..100).fold(Vector2::new(0.1, 0.0), |state, _| ode::step(&state, 0.01, rates));
/// assert!((end.x - 0.1 * 9.81_f64.sqrt().cos()).abs() < 1e-7);
/// ```
#[must_use]
#[inline(always)]
pub fn step<S: Moves<R>, R: Rates>(state: &S, dt: f64, mut rates: impl FnMut(Moment, &S) -> R) -> S {
    let first = rates(Moment::Start, state);
    step_from(state, &first, dt, rates)
}

/// [`step`] where the rates at its start, `first`, are known.
#[must_use]
#[inline(always)]
pub fn step_from<S: Moves<R>, R: Rates>(state: &S, first: &R, dt: f64, mut rates: impl FnMut(Moment, &S) -> R) -> S {
    let Ok(end) = try_step_from(state, first, dt, |moment, state| Ok::<_, Infallible>(rates(moment, state)));
    end
}

/// [`step`] with rates that may fail to exist.
///
/// # Errors
/// The first of the rates' own.
pub fn try_step<S: Moves<R>, R: Rates, E>(
    state: &S,
    dt: f64,
    mut rates: impl FnMut(Moment, &S) -> Result<R, E>,
) -> Result<S, E> {
    let first = rates(Moment::Start, state)?;
    try_step_from(state, &first, dt, rates)
}

#[inline(always)]
fn try_step_from<S: Moves<R>, R: Rates, E>(
    state: &S,
    first: &R,
    dt: f64,
    mut rates: impl FnMut(Moment, &S) -> Result<R, E>,
) -> Result<S, E> {
    let half = 0.5 * dt;
    let second = rates(Moment::Middle, &state.moved(first, half))?;
    let third = rates(Moment::Middle, &state.moved(&second, half))?;
    let fourth = rates(Moment::End, &state.moved(&third, dt))?;
    Ok(end(state, &[*first, second, third, fourth], dt))
}

/// Where a step of `dt` (s) ends whose stages had these rates.
#[must_use]
#[inline(always)]
pub fn end<S: Moves<R>, R: Rates>(state: &S, &[first, second, third, fourth]: &[R; 4], dt: f64) -> S {
    state.moved(&(first + (second + third) * 2.0 + fourth), dt / 6.0)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector1;

    use super::*;

    /// Error at 1 of y' = t y from y(0) = 1, in `steps` steps; the solution is e^{t²/2}.
    fn error(steps: u32) -> f64 {
        let dt = 1.0 / f64::from(steps);
        let end = (0..steps).fold(Vector1::new(1.0), |y, k| {
            step(&y, dt, |moment, y: &Vector1<f64>| y * moment.time(f64::from(k) * dt, dt))
        });
        (end.x - 0.5_f64.exp()).abs()
    }

    #[test]
    fn half_the_step_leaves_a_sixteenth_of_the_error() {
        let ratio = error(40) / error(80);
        assert!((ratio - 16.0).abs() < 1.0, "{ratio}");
    }

    #[test]
    fn a_polynomial_of_the_third_degree_is_integrated_exactly() {
        let end = step(&Vector1::new(0.0), 2.0, |moment, _: &Vector1<f64>| Vector1::new(moment.time(1.0, 2.0).powi(3)));
        assert!((end.x - 20.0).abs() < 1e-14, "{}", end.x);
    }

    #[test]
    fn rates_that_do_not_exist_end_the_step() {
        let rates =
            |moment, _: &Vector1<f64>| if moment == Moment::End { Err("beyond") } else { Ok(Vector1::new(1.0)) };
        assert_eq!(try_step(&Vector1::new(0.0), 1.0, rates), Err("beyond"));
    }
}
