//! One step in time of a stiff ordinary differential equation: of a state that settles much faster than it changes.
//!
//! A step solves four linear systems with one matrix, 1/(h γ) − J, and asks for rates three times; nothing is iterated.
//! What settles within the step is settled after it (L-stable), so that its length follows what changes slowly.
//!
//! Implements: RODAS3, order 3 with 4 stages (Sandu, Verwer, Blom, Spee, Carmichael, Potra, *Benchmarking stiff ODE solvers
//! for atmospheric chemistry problems II*, Atmospheric Environment 31, 1997), in the form of Hairer and Wanner, *Solving
//! Ordinary Differential Equations II*, 2nd ed., IV.7, (7.25).
//! Assumes: rates smooth within the step. Units: those of the state; time in s.
//! Errors: none where the matrix is singular; no error is estimated.

use nalgebra::{Const, DimMin, SMatrix, SVector};

/// γ: of 1/(h γ) − J.
const GAMMA: f64 = 0.5;

/// Where in the state stages ask for rates: weights of the stages before.
const PLACES: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 1.0]];

/// What of the stages before is in the next, over h.
const BEFORE: [[f64; 3]; 4] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [1.0, -1.0, 0.0], [1.0, -1.0, -8.0 / 3.0]];

/// Which share of the step is over where stages ask for rates; the second asks for none of its own.
const TIMES: [f64; 4] = [0.0, 0.0, 1.0, 1.0];

/// Weights of the rates' own change in time, times h.
const OF_TIME: [f64; 4] = [0.5, 1.5, 0.0, 0.0];

/// Weights of the stages in the step.
const WEIGHTS: [f64; 4] = [2.0, 0.0, 1.0, 1.0];

/// The rates at the beginning of a step, and how they change.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Linearised<const N: usize> {
    /// Per second.
    pub(crate) rates: SVector<f64, N>,
    /// Derivatives of each rate by the state's components, one row a rate.
    pub(crate) by_state: SMatrix<f64, N, N>,
    /// Derivatives by the time, with the state as it is.
    pub(crate) by_time: SVector<f64, N>,
}

/// The state one step of `dt` (s) later, with the rates at a share of the step and a state; none where the step has no
/// solution.
pub(crate) fn step<const N: usize>(
    state: &SVector<f64, N>,
    dt: f64,
    begin: &Linearised<N>,
    rates: impl Fn(f64, &SVector<f64, N>) -> SVector<f64, N>,
) -> Option<SVector<f64, N>>
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    let system = (SMatrix::identity() / (dt * GAMMA) - begin.by_state).lu();
    let mut stages = [SVector::zeros(); 4];
    let sum = |weights: &[f64], stages: &[SVector<f64, N>; 4]| -> SVector<f64, N> {
        weights.iter().zip(stages).map(|(weight, stage)| stage * *weight).sum()
    };
    for stage in 0..4 {
        let here = if stage < 2 { begin.rates } else { rates(TIMES[stage], &(state + sum(&PLACES[stage], &stages))) };
        let right = here + sum(&BEFORE[stage], &stages) / dt + begin.by_time * (dt * OF_TIME[stage]);
        stages[stage] = system.solve(&right)?;
    }
    Some(state + sum(&WEIGHTS, &stages))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector2};

    use super::*;

    /// Prothero and Robinson (1974): what follows a known course with any stiffness, y' = λ (y − sin t) + cos t, beside its
    /// own time.
    fn follow(stiffness: f64, steps: u32, start: f64) -> f64 {
        let dt = 1.0 / f64::from(steps);
        let mut state = Vector2::new(start, 0.0);
        for step_number in 0..steps {
            let time = f64::from(step_number) * dt;
            let rates = |share: f64, state: &Vector2<f64>| {
                let t = time + share * dt;
                Vector2::new(-stiffness * (state.x - t.sin()) + t.cos(), state.x)
            };
            let begin = Linearised {
                rates: rates(0.0, &state),
                by_state: Matrix2::new(-stiffness, 0.0, 1.0, 0.0),
                by_time: Vector2::new(stiffness * time.cos() - time.sin(), 0.0),
            };
            state = step(&state, dt, &begin, rates).unwrap();
        }
        state.x - 1.0_f64.sin()
    }

    #[test]
    fn the_error_falls_with_the_cube_of_the_step() {
        let [coarse, fine] = [20, 40].map(|steps| follow(1.0, steps, 0.0).abs());
        let order = (coarse / fine).log2();
        assert!((order - 3.0).abs() < 0.2, "{coarse:e} {fine:e} {order}");
    }

    /// Of a start that is off nothing is left after a few steps, however stiff; an explicit step would grow it by the stiffness times its length.
    #[test]
    fn what_is_stiff_settles() {
        for stiffness in [1e3, 1e6, 1e9] {
            let off = follow(stiffness, 10, 0.5).abs();
            // A step of 0.1 s has errors of a tenth of its cube.
            assert!(off < 1e-4, "{stiffness:e}: {off:e}");
        }
    }

    /// A pendulum, whose Jacobian changes along the step: order 3 against its own limit.
    #[test]
    fn nonlinear_rates_keep_the_order() {
        let swing = |steps: u32| {
            let dt = 1.0 / f64::from(steps);
            let mut state = Vector2::new(1.0, 0.0);
            for _ in 0..steps {
                let rates = |_, state: &Vector2<f64>| Vector2::new(state.y, -9.0 * state.x.sin());
                let begin = Linearised {
                    rates: rates(0.0, &state),
                    by_state: Matrix2::new(0.0, 1.0, -9.0 * state.x.cos(), 0.0),
                    by_time: Vector2::zeros(),
                };
                state = step(&state, dt, &begin, rates).unwrap();
            }
            state
        };
        let limit = swing(4000);
        let order = ((swing(40) - limit).norm() / (swing(80) - limit).norm()).log2();
        assert!((order - 3.0).abs() < 0.2, "{order}");
    }
}
