//! One step in time of a stiff ordinary differential equation: of a state that settles much faster than it changes.
//!
//! A step solves some linear systems with one matrix, 1/(h γ) − J, and asks for rates about as often; nothing is iterated.
//! What settles within the step is settled after it (L-stable), so that its length follows what changes slowly.
//!
//! Implements: RODAS3, order 3 with 4 stages (Sandu, Verwer, Blom, Spee, Carmichael, Potra, *Benchmarking stiff ODE solvers
//! for atmospheric chemistry problems II*, Atmospheric Environment 31, 1997), and RODAS, order 4 with 6 stages and an
//! embedded one of order 3 to estimate its error (Hairer and Wanner, *Solving Ordinary Differential Equations II*, 2nd ed.,
//! IV.7, and their `rodas.f`, method 1), both in the form of (7.25) there.
//! Assumes: rates smooth within the step. Units: those of the state; time in s.
//! Errors: none where the matrix is singular.

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

/// RODAS: γ is 1/4.
const GAMMA_4: f64 = 0.25;

/// Where in the state its stages ask for rates; the last row but the stages' own sum is the step.
const PLACES_4: [[f64; 5]; 6] = [
    [0.0; 5],
    [1.544, 0.0, 0.0, 0.0, 0.0],
    [0.946_678_528_081_582_6, 0.255_701_169_898_328_4, 0.0, 0.0, 0.0],
    [3.314_825_187_068_521, 2.896_124_015_972_201, 0.998_641_913_997_781_7, 0.0, 0.0],
    [1.221_224_509_226_641, 6.019_134_481_288_629, 12.537_083_329_320_87, -0.687_886_036_105_895, 0.0],
    [1.221_224_509_226_641, 6.019_134_481_288_629, 12.537_083_329_320_87, -0.687_886_036_105_895, 1.0],
];

/// What of the stages before is in the next, over h.
const BEFORE_4: [[f64; 5]; 6] = [
    [0.0; 5],
    [-5.6688, 0.0, 0.0, 0.0, 0.0],
    [-2.430_093_356_833_875, -0.206_359_915_709_191_5, 0.0, 0.0, 0.0],
    [-0.107_352_905_815_137_5, -9.594_562_251_023_355, -20.470_286_148_096_16, 0.0, 0.0],
    [7.496_443_313_967_647, -10.246_804_314_643_52, -33.999_903_528_199_05, 11.708_908_932_061_6, 0.0],
    [
        8.083_246_795_921_522,
        -7.981_132_988_064_893,
        -31.521_594_328_743_71,
        16.319_305_431_231_36,
        -6.058_818_238_834_054,
    ],
];

/// Which share of the step is over where stages ask for rates.
const TIMES_4: [f64; 6] = [0.0, 0.386, 0.21, 0.63, 1.0, 1.0];

/// Weights of the rates' own change in time, times h.
const OF_TIME_4: [f64; 6] = [0.25, -0.1043, 0.1035, -0.036_200_000_000_000_23, 0.0, 0.0];

/// A step with its error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Estimated<const N: usize> {
    /// The state after it, of order 4.
    pub(crate) end: SVector<f64, N>,
    /// What it is off the embedded one of order 3.
    pub(crate) error: SVector<f64, N>,
}

/// [`step`] of order 4, with its error.
pub(crate) fn estimated_step<const N: usize>(
    state: &SVector<f64, N>,
    dt: f64,
    begin: &Linearised<N>,
    rates: impl Fn(f64, &SVector<f64, N>) -> SVector<f64, N>,
) -> Option<Estimated<N>>
where
    Const<N>: DimMin<Const<N>, Output = Const<N>>,
{
    let system = (SMatrix::identity() / (dt * GAMMA_4) - begin.by_state).lu();
    let mut stages = [SVector::zeros(); 6];
    let sum = |weights: &[f64], stages: &[SVector<f64, N>; 6]| -> SVector<f64, N> {
        weights.iter().zip(stages).map(|(weight, stage)| stage * *weight).sum()
    };
    let mut place = *state;
    for stage in 0..6 {
        place = state + sum(&PLACES_4[stage], &stages);
        let here = if stage == 0 { begin.rates } else { rates(TIMES_4[stage], &place) };
        let right = here + sum(&BEFORE_4[stage], &stages) / dt + begin.by_time * (dt * OF_TIME_4[stage]);
        stages[stage] = system.solve(&right)?;
    }
    // Stiffly accurate: the last stage is what the one before it lacks.
    Some(Estimated { end: place + stages[5], error: stages[5] })
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector2};

    use super::*;

    /// One step of either method.
    #[derive(Clone, Copy, PartialEq)]
    enum Method {
        Order3,
        Order4,
    }

    fn stepped(
        method: Method,
        state: &Vector2<f64>,
        dt: f64,
        begin: &Linearised<2>,
        rates: impl Fn(f64, &Vector2<f64>) -> Vector2<f64>,
    ) -> Vector2<f64> {
        match method {
            Method::Order3 => step(state, dt, begin, rates).unwrap(),
            Method::Order4 => estimated_step(state, dt, begin, rates).unwrap().end,
        }
    }

    const METHODS: [(Method, f64); 2] = [(Method::Order3, 3.0), (Method::Order4, 4.0)];

    /// Prothero and Robinson (1974): what follows a known course with any stiffness, y' = λ (y − sin t) + cos t, beside its
    /// own time.
    fn follow(method: Method, stiffness: f64, steps: u32, start: f64) -> f64 {
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
            state = stepped(method, &state, dt, &begin, rates);
        }
        state.x - 1.0_f64.sin()
    }

    #[test]
    fn the_error_falls_as_the_order_says() {
        for (method, wanted) in METHODS {
            let [coarse, fine] = [20, 40].map(|steps| follow(method, 1.0, steps, 0.0).abs());
            let order = (coarse / fine).log2();
            assert!((order - wanted).abs() < 0.3, "{coarse:e} {fine:e} {order}");
        }
    }

    /// Of a start that is off nothing is left after a few steps, however stiff; an explicit step would grow it by the stiffness times its length.
    #[test]
    fn what_is_stiff_settles() {
        for (stiffness, (method, _)) in [1e3, 1e6, 1e9].into_iter().flat_map(|it| METHODS.map(|method| (it, method))) {
            let off = follow(method, stiffness, 10, 0.5).abs();
            // A step of 0.1 s has errors of a tenth of its cube.
            assert!(off < 1e-4, "{stiffness:e}: {off:e}");
        }
    }

    /// A pendulum, whose Jacobian changes along the step: order 3 against its own limit.
    #[test]
    fn nonlinear_rates_keep_the_order() {
        let swing = |method: Method, steps: u32| {
            let dt = 1.0 / f64::from(steps);
            let mut state = Vector2::new(1.0, 0.0);
            for _ in 0..steps {
                let rates = |_, state: &Vector2<f64>| Vector2::new(state.y, -9.0 * state.x.sin());
                let begin = Linearised {
                    rates: rates(0.0, &state),
                    by_state: Matrix2::new(0.0, 1.0, -9.0 * state.x.cos(), 0.0),
                    by_time: Vector2::zeros(),
                };
                state = stepped(method, &state, dt, &begin, rates);
            }
            state
        };
        let limit = swing(Method::Order4, 4000);
        for (method, wanted) in METHODS {
            let order = ((swing(method, 40) - limit).norm() / (swing(method, 80) - limit).norm()).log2();
            assert!((order - wanted).abs() < 0.3, "{order}");
        }
    }

    /// The stated error is that of the step of order 3, larger than the step's own.
    #[test]
    fn the_error_is_not_stated_too_small() {
        let state = Vector2::new(0.3, 0.0);
        for dt in [0.05, 0.1, 0.2] {
            let rates = |_, state: &Vector2<f64>| Vector2::new(state.y, -9.0 * state.x.sin());
            let begin = |state: &Vector2<f64>| Linearised {
                rates: rates(0.0, state),
                by_state: Matrix2::new(0.0, 1.0, -9.0 * state.x.cos(), 0.0),
                by_time: Vector2::zeros(),
            };
            let whole = estimated_step(&state, dt, &begin(&state), rates).unwrap();
            let fine =
                (0..200).fold(state, |state, _| estimated_step(&state, dt / 200.0, &begin(&state), rates).unwrap().end);
            let off = (whole.end - fine).norm();
            assert!(
                off < whole.error.norm() && whole.error.norm() < 1e3 * off,
                "{dt}: {off:e} {:e}",
                whole.error.norm()
            );
        }
    }
}
