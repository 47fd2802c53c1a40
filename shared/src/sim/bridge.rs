//! From the force in the beam to the voltages of the two half bridges.
//!
//! Implements, for bridge i with its sensitive axis at angle αᵢ in the finger frame:
//! - strain along the axis: εᵢ = c (Fx cos αᵢ + Fy sin αᵢ), c from beam theory (`beam`);
//! - cross-talk: ε₀ + χ₀ ε₁ and ε₁ + χ₁ ε₀ (gauge width, bonding, shared wiring);
//! - sensitivity (1 + gᵢ)(1 + sᵢ ΔT), offset oᵢ + dᵢ ΔT, both as strain; ΔT above the reference temperature;
//! - mains hum picked up by the wires, as strain, with its own phase on each axis;
//! - half bridge with two opposite active gauges: V = Vex · GF · ε / 2, which is linear because one gauge lengthens
//!   by what the other shortens.
//!
//! Assumes: excitation without noise or drift of its own (its drift and the reference's are part of sᵢ).
//! At 2.5 V excitation the bridge's mid-point is at 1.25 V, inside the chip's limit of AVDD − 1.8 V = 1.5 V for
//! gains of 8 and above at AVDD = 3.3 V; at 3.3 V excitation it would not be.
//! Frame: finger. Units: SI; strain as a plain ratio. Errors: none.

use super::ads131m::volts_per_count;
use super::noise::{Source, Stream};
use super::trig::{phase_of, sin_cos};

/// One microstrain, as a strain.
pub const MICROSTRAIN: f32 = 1e-6;

/// Noise of a bridge with an open gauge, in volts rms, on top of the rail it sits at: an open wire is an antenna.
const OPEN_GAUGE_NOISE_V: f32 = 0.05;

/// One half bridge and its gauges.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BridgeConfig {
    /// Direction in which a force gives the largest positive strain, in radians from the finger's x axis.
    pub axis_angle: f32,
    /// Departure of the sensitivity from nominal, as a ratio.
    pub gain_error: f32,
    /// Part of the other bridge's strain that this one shows, as a ratio.
    pub crosstalk: f32,
    /// Reading without load at the reference temperature, as strain.
    pub offset: f32,
    /// Change of the offset with temperature, as strain per kelvin.
    pub offset_per_kelvin: f32,
    /// Change of the sensitivity with temperature, as a ratio per kelvin.
    pub gain_per_kelvin: f32,
    /// Phase of the hum on this bridge, in radians.
    pub hum_phase: f32,
}

impl BridgeConfig {
    /// A bridge without errors, sensitive at an angle in radians from the finger's x axis.
    #[must_use]
    pub const fn ideal(axis_angle: f32) -> Self {
        Self {
            axis_angle,
            gain_error: 0.0,
            crosstalk: 0.0,
            offset: 0.0,
            offset_per_kelvin: 0.0,
            gain_per_kelvin: 0.0,
            hum_phase: 0.0,
        }
    }
}

/// Both bridges and what they share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BridgesConfig {
    /// Excitation of the bridges, in volts.
    pub excitation_v: f32,
    /// Gauge factor: relative change of resistance per strain.
    pub gauge_factor: f32,
    /// The bridges on the finger's x and y axes.
    pub bridges: [BridgeConfig; 2],
    /// Hum from peak to peak, as strain; 0 switches it off.
    pub hum_peak_to_peak: f32,
    /// Frequency of the mains, in hertz.
    pub hum_hz: f32,
}

impl Default for BridgesConfig {
    /// The default finger: 2.5 V, gauge factor 2.0, hum of 1 microstrain peak to peak at 50 Hz, and hand-made errors.
    ///
    /// Gauges bonded by hand sit within 1 to 2° of where they should; gauge factor and bonding scatter by a few per
    /// cent; cross-talk of 1 to 2 % is that of gauges 3 mm wide on a 4 mm beam; untrimmed bridges are off by 100 to
    /// 300 microstrain; half bridges of gauges matched to steel drift by about 0.5 microstrain/K. Sensitivity rises
    /// by 300 ppm/K: steel softens by 250 to 300, the gauge factor rises by about 100, the chip's reference adds 20.
    fn default() -> Self {
        let x = BridgeConfig {
            axis_angle: 1.5_f32.to_radians(),
            gain_error: 0.03,
            crosstalk: 0.02,
            offset: 180.0 * MICROSTRAIN,
            offset_per_kelvin: 0.5 * MICROSTRAIN,
            gain_per_kelvin: 300e-6,
            hum_phase: 0.4,
        };
        let y = BridgeConfig {
            axis_angle: 89.0_f32.to_radians(),
            gain_error: -0.02,
            crosstalk: -0.015,
            offset: -120.0 * MICROSTRAIN,
            offset_per_kelvin: -0.4 * MICROSTRAIN,
            gain_per_kelvin: 300e-6,
            hum_phase: 1.9,
        };
        Self {
            excitation_v: 2.5,
            gauge_factor: 2.0,
            bridges: [x, y],
            hum_peak_to_peak: 1.0 * MICROSTRAIN,
            hum_hz: 50.0,
        }
    }
}

impl BridgesConfig {
    /// Bridges without any error or hum, exactly on the axes.
    #[must_use]
    pub fn ideal() -> Self {
        Self {
            bridges: [BridgeConfig::ideal(0.0), BridgeConfig::ideal(core::f32::consts::FRAC_PI_2)],
            hum_peak_to_peak: 0.0,
            ..Self::default()
        }
    }

    /// Volts that a strain of 1 gives: half the excitation times the gauge factor.
    ///
    /// ```
    /// use palpate_shared::sim::{BridgesConfig, MICROSTRAIN};
    /// assert!((BridgesConfig::default().volts_per_strain() * MICROSTRAIN - 2.5e-6).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn volts_per_strain(&self) -> f32 {
        0.5 * self.excitation_v * self.gauge_factor
    }

    /// Strain in one code at a gain.
    ///
    /// ```
    /// use palpate_shared::sim::{BridgesConfig, MICROSTRAIN};
    /// let microstrain = BridgesConfig::default().strain_per_count(32) / MICROSTRAIN;
    /// assert!((microstrain - 0.001788).abs() < 1e-6); // 559 counts to the microstrain
    /// ```
    #[must_use]
    pub fn strain_per_count(&self, gain: u8) -> f32 {
        volts_per_count(gain) / self.volts_per_strain()
    }
}

/// The hum's wave: one phase for both axes, advanced by a constant every sample.
#[derive(Clone, Debug, PartialEq)]
struct Hum {
    hertz: f32,
    /// Amplitude of the mean over a step, as strain.
    amplitude: f32,
    phase: u32,
    phase_per_step: u32,
    /// Cosine and sine of each axis' phase.
    axes: [(f32, f32); 2],
}

impl Hum {
    /// A hum at rest; `set_step` sets it going.
    fn new(config: &BridgesConfig) -> Self {
        let axes = config.bridges.map(|bridge| {
            let (sin, cos) = sin_cos(phase_of(bridge.hum_phase));
            (cos, sin)
        });
        Self { hertz: config.hum_hz, amplitude: 0.0, phase: 0, phase_per_step: 0, axes }
    }

    /// Sets the step. Its mean over a step of angle 2x is the wave at mid-step times sin x / x.
    fn set_step(&mut self, peak_to_peak: f32, step_ns: u32) {
        self.phase_per_step = phase_per_step(self.hertz, step_ns);
        let x = core::f32::consts::PI * self.hertz * step_ns as f32 * 1e-9;
        let shrink = if x > 0.0 { sin_cos(phase_of(x)).0 / x } else { 1.0 };
        self.amplitude = 0.5 * peak_to_peak * shrink;
    }

    /// The mean over the next step on both axes, as strain.
    fn step(&mut self) -> [f32; 2] {
        let (sin, cos) = sin_cos(self.phase.wrapping_add(self.phase_per_step / 2));
        self.phase = self.phase.wrapping_add(self.phase_per_step);
        self.axes.map(|(axis_cos, axis_sin)| self.amplitude * (sin * axis_cos + cos * axis_sin))
    }
}

/// Turns · 2³² that a frequency makes in a step. Rounded: the frequency is off by at most 1 ppm at 4 kSPS.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole turns and signs do not matter")]
fn phase_per_step(hertz: f32, step_ns: u32) -> u32 {
    let millihertz = (hertz * 1e3) as u64;
    // · 2³² / 10¹² in integers: 2³² / 10¹² = 2²⁰ / 5¹².
    ((millihertz.wrapping_mul(step_ns.into()) << 20) / 244_140_625) as u32
}

/// Both bridges at work.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Bridges {
    config: BridgesConfig,
    /// Strain per newton along each finger axis, by bridge, cross-talk and sensitivity included.
    matrix: [[f32; 2]; 2],
    hum: Hum,
    /// Hum beside the configured one, from peak to peak, as strain.
    foreign_hum: f32,
    open_noise: Stream,
}

impl Bridges {
    /// Bridges on a beam of so much strain per newton, advanced in steps of this many nanoseconds.
    pub(super) fn new(config: BridgesConfig, strain_per_newton: f32, step_ns: u32, seed: u64) -> Self {
        let hum = Hum::new(&config);
        let matrix = strain_matrix(&config, strain_per_newton);
        let open_noise = Stream::new(seed, Source::OpenGauge);
        let mut bridges = Self { config, matrix, hum, foreign_hum: 0.0, open_noise };
        bridges.set_step(step_ns);
        bridges
    }

    /// Changes the step, in nanoseconds.
    pub(super) fn set_step(&mut self, step_ns: u32) {
        self.hum.set_step(self.config.hum_peak_to_peak + self.foreign_hum, step_ns);
    }

    /// Adds so much hum to the configured one, from peak to peak, as strain.
    pub(super) fn set_foreign_hum(&mut self, peak_to_peak: f32, step_ns: u32) {
        self.foreign_hum = peak_to_peak;
        self.set_step(step_ns);
    }

    /// Strain that a force gives at the reference temperature, offset and hum left out.
    pub(super) fn strain(&self, force_finger: [f32; 2]) -> [f32; 2] {
        self.matrix.map(|[x, y]| x * force_finger[0] + y * force_finger[1])
    }

    /// Mean voltages over the next step, under this elastic force, so many kelvin above the reference, with so much
    /// strain beside it on both bridges.
    pub(super) fn step(&mut self, force_finger: [f32; 2], kelvin: f32, foreign: f32) -> [f32; 2] {
        let strain = self.strain(force_finger);
        let hum = self.hum.step();
        core::array::from_fn(|i| {
            let bridge = &self.config.bridges[i];
            let offset = bridge.offset + bridge.offset_per_kelvin * kelvin;
            let felt = strain[i] * (1.0 + bridge.gain_per_kelvin * kelvin) + offset + hum[i] + foreign;
            self.config.volts_per_strain() * felt
        })
    }

    /// Voltage of a bridge one of whose gauges is open: at its rail, with what the wire picks up.
    pub(super) fn open_gauge_volts(&mut self) -> [f32; 2] {
        self.open_noise.normal_pair().map(|n| 0.5 * self.config.excitation_v + OPEN_GAUGE_NOISE_V * n)
    }
}

/// Strain of both bridges per newton along x and y, with axis angles, cross-talk and sensitivities.
fn strain_matrix(config: &BridgesConfig, strain_per_newton: f32) -> [[f32; 2]; 2] {
    let along = config.bridges.map(|bridge| {
        let (sin, cos) = sin_cos(phase_of(bridge.axis_angle));
        [strain_per_newton * cos, strain_per_newton * sin]
    });
    core::array::from_fn(|i| {
        let (bridge, other) = (&config.bridges[i], along[1 - i]);
        core::array::from_fn(|k| (1.0 + bridge.gain_error) * (along[i][k] + bridge.crosstalk * other[k]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// One step at 4 kSPS, in nanoseconds.
    const STEP_NS: u32 = 250_000;
    /// A round strain per newton, so that the numbers below can be checked by eye.
    const STRAIN_PER_NEWTON: f32 = 50e-6;
    /// Rounding of a strain of a few hundred microstrain.
    const STRAIN_ERROR: f32 = 1e-10;

    fn bridges(config: BridgesConfig) -> Bridges {
        Bridges::new(config, STRAIN_PER_NEWTON, STEP_NS, 1)
    }

    /// The strains that the voltages of one step stand for.
    fn strains(bridges: &mut Bridges, force: [f32; 2], kelvin: f32) -> [f32; 2] {
        let per_volt = 1.0 / bridges.config.volts_per_strain();
        bridges.step(force, kelvin, 0.0).map(|v| v * per_volt)
    }

    fn with_both(change: impl Fn(&mut BridgeConfig)) -> BridgesConfig {
        let mut config = BridgesConfig::ideal();
        config.bridges.iter_mut().for_each(change);
        config
    }

    #[test]
    fn an_ideal_bridge_gives_two_and_a_half_microvolts_per_microstrain() {
        let volts = bridges(BridgesConfig::ideal()).step([1.0, -2.0], 0.0, 0.0);
        assert!((volts[0] - 125e-6).abs() < 1e-9 && (volts[1] + 250e-6).abs() < 1e-9, "{volts:?}");
    }

    #[test]
    fn a_misaligned_gauge_feels_the_force_along_its_own_axis() {
        let mut config = BridgesConfig::ideal();
        config.bridges[0].axis_angle = 30f32.to_radians();
        let [x, y] = strains(&mut bridges(config), [0.0, 2.0], 0.0);
        assert!((x - 50e-6).abs() < STRAIN_ERROR); // 2 N · sin 30° · 50e-6
        assert!((y - 100e-6).abs() < STRAIN_ERROR);
    }

    #[test]
    fn cross_talk_adds_a_part_of_the_other_bridge() {
        let [x, y] = strains(&mut bridges(with_both(|b| b.crosstalk = 0.02)), [1.0, 2.0], 0.0);
        assert!((x - 52e-6).abs() < STRAIN_ERROR && (y - 101e-6).abs() < STRAIN_ERROR);
    }

    #[test]
    fn temperature_moves_offset_and_sensitivity_as_configured() {
        let config = with_both(|b| {
            b.offset = 100.0 * MICROSTRAIN;
            b.offset_per_kelvin = 0.5 * MICROSTRAIN;
            b.gain_per_kelvin = 300e-6;
        });
        let mut bridges = bridges(config);
        let [x, _] = strains(&mut bridges, [0.0; 2], 10.0);
        assert!((x - 105e-6).abs() < STRAIN_ERROR);
        let [x, _] = strains(&mut bridges, [2.0, 0.0], 10.0);
        assert!((x - (105e-6 + 100e-6 * 1.003)).abs() < STRAIN_ERROR);
    }

    #[test]
    fn hum_is_one_microstrain_peak_to_peak_and_cancels_over_one_mains_period() {
        let mut config = BridgesConfig::ideal();
        config.hum_peak_to_peak = MICROSTRAIN;
        config.bridges[1].hum_phase = 1.5;
        let mut bridges = bridges(config);
        let wave: std::vec::Vec<[f32; 2]> = (0..80).map(|_| strains(&mut bridges, [0.0; 2], 0.0)).collect();
        for axis in 0..2 {
            let values = || wave.iter().map(|s| s[axis]);
            let (low, high) = values().fold((0.0f32, 0.0f32), |(low, high), s| (low.min(s), high.max(s)));
            // 80 points miss the crest by up to 1 - cos(π/80) = 8e-4, and the mean over a sample costs 3e-4.
            assert!((high - low - 1e-6).abs() < 2e-3 * 1e-6, "{}", high - low);
            // The phase step is rounded to 2⁻³² turns.
            assert!(values().sum::<f32>().abs() / 80.0 < 1e-6 * 1e-6);
        }
        assert!((wave[0][0] - wave[0][1]).abs() > 0.1e-6, "each axis has its own phase");
    }

    #[test]
    fn the_hum_of_a_long_step_is_the_mean_of_many_short_ones() {
        let mut config = BridgesConfig { hum_peak_to_peak: MICROSTRAIN, ..BridgesConfig::ideal() };
        config.bridges[1].hum_phase = 1.5;
        let (mut long, mut short) = (bridges(config), bridges(config));
        long.set_step(16 * STEP_NS);
        for _ in 0..5 {
            let mean = strains(&mut long, [0.0; 2], 0.0);
            let parts: std::vec::Vec<[f32; 2]> = (0..16).map(|_| strains(&mut short, [0.0; 2], 0.0)).collect();
            for axis in 0..2 {
                let expected = parts.iter().map(|s| s[axis]).sum::<f32>() / 16.0;
                assert!((mean[axis] - expected).abs() < 1e-5 * MICROSTRAIN, "{} {expected}", mean[axis]);
            }
        }
    }

    #[test]
    fn hum_keeps_its_frequency_over_an_hour() {
        // 50 Hz for one hour is 180 000 turns: what is left is the rounding, 14.4 million times.
        let left = phase_per_step(50.0, STEP_NS).wrapping_mul(14_400_000).cast_signed();
        assert!((f64::from(left) / 4_294_967_296.0).abs() < 0.01, "{left}");
    }

    proptest! {
        #[test]
        fn strain_is_linear_in_the_force(fx in -5.0f32..5.0, fy in -5.0f32..5.0, k in -2.0f32..2.0) {
            let bridges = bridges(BridgesConfig::default());
            let (one, scaled) = (bridges.strain([fx, fy]), bridges.strain([k * fx, k * fy]));
            // Each side is rounded a few times, at strains of up to 0.7 millistrain: eight halves of a last place.
            let rounding = 4.0 * f32::EPSILON * k.abs().max(1.0) * fx.hypot(fy) * STRAIN_PER_NEWTON;
            for i in 0..2 {
                prop_assert!((k * one[i] - scaled[i]).abs() <= rounding);
            }
        }
    }
}
