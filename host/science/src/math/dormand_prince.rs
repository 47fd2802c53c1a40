//! Dormand and Prince's pair of orders 5 and 4, with its interpolant of order 4.
//!
//! Implements: Hairer, Nørsett, Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., II.5 and II.6.
//! Units: the caller's. Errors: none; a step too large shows in its error estimate.

/// Share of the step that the error estimate suggests: a rejected step costs as much as an accepted one.
const SAFETY: f64 = 0.9;

/// Least and greatest change from one step's length to the next.
const GROWTH: (f64, f64) = (0.2, 5.0);

/// Where the stages of a step are, as shares of its length.
pub(crate) const NODES: [f64; 7] = [0.0, 0.2, 0.3, 0.8, 8.0 / 9.0, 1.0, 1.0];

/// What each stage starts from; the last row is the step itself, of order 5.
pub(crate) const STAGES: [[f64; 6]; 7] = [
    [0.0; 6],
    [0.2, 0.0, 0.0, 0.0, 0.0, 0.0],
    [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0],
    [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0],
    [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0],
    [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0],
    [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
];

/// The step of order 5 minus that of order 4.
pub(crate) const ERROR: [f64; 7] =
    [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0];

/// The fourth-order term of the interpolant.
pub(crate) const INTERPOLANT: [f64; 7] = [
    -12_715_105_075.0 / 11_282_082_432.0,
    0.0,
    87_487_479_700.0 / 32_700_410_799.0,
    -10_690_763_975.0 / 1_880_347_072.0,
    701_980_252_875.0 / 199_316_789_632.0,
    -1_453_857_185.0 / 822_651_844.0,
    69_997_945.0 / 29_380_423.0,
];

/// `start` plus `length` times the weighted slopes.
pub(crate) fn moved<const C: usize, const N: usize>(
    start: [f64; C],
    slopes: &[[f64; C]; 7],
    weights: &[f64; N],
    length: f64,
) -> [f64; C] {
    let mut moved = start;
    for (slope, weight) in slopes.iter().zip(weights).filter(|(_, weight)| **weight != 0.0) {
        for (component, rate) in moved.iter_mut().zip(slope) {
            *component += length * weight * rate;
        }
    }
    moved
}

/// How many times as long the next step, or another try of this one, should be; an error of 1 is just allowed.
pub(crate) fn growth(error: f64) -> f64 {
    let growth = SAFETY * error.powf(-0.2);
    if growth.is_nan() { GROWTH.0 } else { growth.clamp(GROWTH.0, GROWTH.1) }
}
