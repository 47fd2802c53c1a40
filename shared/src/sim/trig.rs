//! Sine and cosine of a phase, in single precision.
//!
//! A phase is a `u32` that counts turns in units of 2⁻³²: it wraps by itself, and adding a constant to it every
//! sample loses nothing however long the simulation runs. `libm::sinf` is not used because it computes in `f64`,
//! which a Cortex-M4F emulates in software.
//!
//! Implements: the single-precision polynomials of Moshier's Cephes library (`sinf`, `cosf`), after an exact
//! integer reduction to an eighth of a turn. Units: turns · 2³² for phases, radians where a name says `angle`.
//! Errors: none. Absolute error below 2e-7 for every phase (tested).

/// Radians in one unit of phase, 2π / 2³².
const RAD_PER_PHASE: f32 = core::f32::consts::TAU / 4_294_967_296.0;

/// Units of phase in one radian, 2³² / 2π.
const PHASE_PER_RAD: f32 = 4_294_967_296.0 / core::f32::consts::TAU;

/// Half of a quarter turn, so that rounding to the nearest quarter is a shift.
const EIGHTH_TURN: u32 = 1 << 29;

/// The phase of an angle in radians, whole turns dropped.
///
/// Angles beyond ±13 million turns all give the same phase.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "dropping whole turns is the meaning of a phase"
)]
pub(crate) fn phase_of(angle: f32) -> u32 {
    (angle * PHASE_PER_RAD) as i64 as u32
}

/// Sine and cosine of a phase.
pub(crate) fn sin_cos(phase: u32) -> (f32, f32) {
    let quarter = phase.wrapping_add(EIGHTH_TURN) >> 30;
    #[expect(clippy::cast_possible_wrap, reason = "the rest is signed, within ±1/8 turn")]
    let rest = phase.wrapping_sub(quarter << 30) as i32;
    let x = rest as f32 * RAD_PER_PHASE;
    let z = x * x;
    let sin = x + x * z * (-1.666_665_5e-1 + z * (8.332_161e-3 - z * 1.951_529_6e-4));
    let cos = 1.0 - 0.5 * z + z * z * (4.166_664_6e-2 + z * (-1.388_731_6e-3 + z * 2.443_315_7e-5));
    match quarter {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Largest error allowed in a sine, of 1: three roundings of `f32`.
    const SINE_ERROR: f64 = 2e-7;

    proptest! {
        #[test]
        fn a_phase_has_the_sine_and_cosine_of_its_angle(phase: u32) {
            let angle = f64::from(phase) * core::f64::consts::TAU / 4_294_967_296.0;
            let (sin, cos) = sin_cos(phase);
            prop_assert!((f64::from(sin) - angle.sin()).abs() < SINE_ERROR);
            prop_assert!((f64::from(cos) - angle.cos()).abs() < SINE_ERROR);
        }

        #[test]
        fn an_angle_keeps_its_sine_through_its_phase(angle in -20.0f32..20.0) {
            // An `f32` angle of up to 20 rad is itself only good to 1e-6 rad, and so is its product with a constant.
            let (sin, _) = sin_cos(phase_of(angle));
            prop_assert!((f64::from(sin) - f64::from(angle).sin()).abs() < 4e-6);
        }
    }
}
