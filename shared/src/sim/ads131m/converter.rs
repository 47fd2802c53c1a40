//! The chip's analogue half: input multiplexer, noise, digital filter, codes.
//!
//! Implements:
//! - filter: sinc³ (SBAS853A §8.3.7). Its impulse response is a quadratic B-spline three conversion periods long.
//!   The input here is constant over each period, so the output is the sum of the last three periods weighted by the
//!   B-spline's area over each: 1/6, 4/6, 1/6. With an oversampling ratio OSR ≥ 2048 the chip runs the sinc³ at 1024
//!   and averages n = OSR/1024 of its outputs; the same areas then give 1 − 1/n and 1/n over the last two periods.
//!   After power-up or reset the first two outputs come from the fast filter, which is the last period alone.
//! - noise: white noise through a sinc³ is coloured, because successive outputs share input. Its autocorrelation is
//!   the B-spline's with itself: 66, 26, 1 (of 120) at lags 0, 1, 2, which a moving average of three terms
//!   reproduces. That the chip's noise is like this shows in its datasheet: averages of n outputs at 4 kSPS
//!   predict the published noise at 2 and 1 kSPS to about 1 % and at 250 SPS to about 5 %, which white noise
//!   misses by 15 to 30 %.
//! - codes: LSB = 2.4 V / gain / 2²⁴, offset correction subtracted, gain correction multiplied, clipped at each step.
//!
//! Assumes: infinite input impedance, no distortion, no channel phase shift, DC block, global chop or current
//! detection. The fast filter's larger noise is not modelled.
//! Units: volts at the chip's pins. Errors: none.

use super::registers::{CHANNELS_MAX, Registers};
use crate::sim::noise::{Source, Stream};
use crate::units::Counts;

/// Span of the input at gain 1, in volts: ±1.2 V (SBAS853A, electrical characteristics).
const SPAN_V: f32 = 2.4;

/// Codes in the span.
const CODES: f32 = 16_777_216.0;

/// How far beyond full scale the modulator still follows, as a multiple of full scale.
///
/// The digital output clips at 1. A little headroom keeps an overdriven code still at its end instead of
/// letting the noise move it.
const MODULATOR_LIMIT: f32 = 1.1;

/// The internal test signal as a part of full scale (SBAS853A, internal test signals: 2/15).
const TEST_SIGNAL: f32 = 2.0 / 15.0;

/// Noise at 4 kSPS referred to the input, in volts rms, by exponent of the gain.
///
/// Datasheet noise table at OSR 1024: gains 1, 8, 16, 32, 64, 128. Gains 2 and 4 are interpolated geometrically.
const NOISE_4KSPS_V: [f32; 8] = [5.35e-6, 4.26e-6, 3.39e-6, 2.70e-6, 1.82e-6, 1.20e-6, 1.20e-6, 1.20e-6];

/// Oversampling ratio up to which the sinc³ filter works alone.
const SINC3_OVERSAMPLING_MAX: u32 = 1024;

/// Volts in one code at a gain.
///
/// ```
/// use palpate_shared::sim::ads131m::volts_per_count;
/// assert!((volts_per_count(32) - 4.47e-9).abs() < 0.01e-9);
/// ```
#[must_use]
pub fn volts_per_count(gain: u8) -> f32 {
    SPAN_V / CODES / f32::from(gain)
}

/// Noise of the chip referred to its input, in volts rms, at a gain and an oversampling ratio.
///
/// A gain that the chip does not have counts as the next power of two below it, 0 as 1.
/// At 4 kSPS this is the datasheet's table. Averaging gives the slower rates (see the module), and white noise
/// the faster ones: below OSR 512 the real chip is noisier, as its quantisation noise is not modelled.
///
/// ```
/// use palpate_shared::sim::ads131m::noise_rms;
/// assert!((noise_rms(32, 1024) - 1.20e-6).abs() < 1e-9);
/// ```
#[must_use]
pub fn noise_rms(gain: u8, oversampling: u32) -> f32 {
    let row = gain.max(1).ilog2() as usize;
    NOISE_4KSPS_V[row] * NoiseShape::new(oversampling).relative_rms
}

/// How the noise at one oversampling ratio differs from white noise of the size it has at OSR 1024.
#[derive(Clone, Copy, Debug, PartialEq)]
struct NoiseShape {
    /// Standard deviation, as a multiple of that at OSR 1024.
    relative_rms: f32,
    /// Weights of the last three white numbers; their squares sum to 1.
    weights: [f32; 3],
}

impl NoiseShape {
    /// The shape at an oversampling ratio.
    fn new(oversampling: u32) -> Self {
        if oversampling > SINC3_OVERSAMPLING_MAX {
            return Self::averaged(oversampling as f32 / SINC3_OVERSAMPLING_MAX as f32);
        }
        // (1 − z₁/z)(1 − z₂/z), with z₁ = −0.430575 and z₂ = −0.043096 the roots inside the unit circle of
        // z⁴ + 26 z³ + 66 z² + 26 z + 1, scaled to unit sum of squares.
        Self {
            relative_rms: libm::sqrtf(SINC3_OVERSAMPLING_MAX as f32 / oversampling as f32),
            weights: [0.903_615, 0.428_016, 0.016_768],
        }
    }

    /// The shape of averages of `n` successive sinc³ outputs.
    fn averaged(n: f32) -> Self {
        let variance = (66.0 * n + 52.0 * (n - 1.0) + 2.0 * (n - 2.0)) / (66.0 * n * n);
        let correlation = 28.0 / (66.0 * n * n) / variance;
        let ratio = (1.0 - libm::sqrtf(1.0 - 4.0 * correlation * correlation)) / (2.0 * correlation);
        let scale = 1.0 / libm::sqrtf(1.0 + ratio * ratio);
        Self { relative_rms: libm::sqrtf(variance), weights: [scale, scale * ratio, 0.0] }
    }
}

/// Weights of the current, the previous and the one before period in the output, at an oversampling ratio.
fn filter_weights(oversampling: u32) -> [f32; 3] {
    if oversampling > SINC3_OVERSAMPLING_MAX {
        let previous = SINC3_OVERSAMPLING_MAX as f32 / oversampling as f32;
        return [1.0 - previous, previous, 0.0];
    }
    [1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0]
}

/// All channels' filters and noise.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Converter {
    /// Input of the previous and the one before period, by channel, in parts of full scale.
    inputs: [[f32; 2]; CHANNELS_MAX],
    /// White numbers of the previous two conversions, by channel.
    whites: [[f32; 2]; CHANNELS_MAX],
    filter: [f32; 3],
    shape: NoiseShape,
    /// Conversions that the fast filter still makes.
    fast_left: u8,
    noise: Stream,
    /// Of the datasheet's noise; 0 is none.
    noise_factor: f32,
}

impl Converter {
    /// A converter just powered up; its noise follows from the seed.
    pub(super) fn new(seed: u64) -> Self {
        Self {
            inputs: [[0.0; 2]; CHANNELS_MAX],
            whites: [[0.0; 2]; CHANNELS_MAX],
            filter: filter_weights(SINC3_OVERSAMPLING_MAX),
            shape: NoiseShape::new(SINC3_OVERSAMPLING_MAX),
            fast_left: 2,
            noise: Stream::new(seed, Source::Converter),
            noise_factor: 1.0,
        }
    }

    /// Multiplies the noise; 0 switches it off. Its stream runs on either way.
    pub(super) fn set_noise_factor(&mut self, factor: f32) {
        self.noise_factor = factor;
    }

    /// Empties the filter, which then takes three conversions to settle.
    pub(super) fn resynchronise(&mut self, registers: &Registers) {
        self.inputs = [[0.0; 2]; CHANNELS_MAX];
        self.fast_left = 0;
        self.filter = filter_weights(registers.oversampling());
        self.shape = NoiseShape::new(registers.oversampling());
    }

    /// Starts again as after power-up, with the fast filter for two conversions.
    pub(super) fn reset(&mut self, registers: &Registers) {
        self.resynchronise(registers);
        self.fast_left = 2;
    }

    /// The codes after one more conversion period over which the pins had these voltages on average.
    pub(super) fn convert<const N: usize>(&mut self, volts: [f32; N], registers: &Registers) -> [Counts; CHANNELS_MAX] {
        let mut codes = [Counts(0); CHANNELS_MAX];
        let mut whites = [0.0; 2];
        for (channel, code_out) in codes.iter_mut().enumerate().take(N) {
            if channel % 2 == 0 {
                whites = self.noise.normal_pair();
            }
            let input = input(volts[channel], channel, registers);
            let part = self.filter(input, channel) + self.noise(whites[channel % 2], channel, registers);
            if registers.is_enabled(channel) {
                *code_out = code(part, channel, registers);
            }
        }
        self.fast_left = self.fast_left.saturating_sub(1);
        codes
    }

    /// The filter's next output for one channel.
    fn filter(&mut self, input: f32, channel: usize) -> f32 {
        let [previous, before] = self.inputs[channel];
        self.inputs[channel] = [input, previous];
        if self.fast_left > 0 {
            return input;
        }
        self.filter[0] * input + self.filter[1] * previous + self.filter[2] * before
    }

    /// The noise of one channel's next output, in parts of full scale.
    fn noise(&mut self, white: f32, channel: usize, registers: &Registers) -> f32 {
        let [previous, before] = self.whites[channel];
        self.whites[channel] = [white, previous];
        let [w0, w1, w2] = self.shape.weights;
        let gain_log2 = registers.gain_log2(channel);
        let rms_v = self.noise_factor * NOISE_4KSPS_V[usize::from(gain_log2)] * self.shape.relative_rms;
        (w0 * white + w1 * previous + w2 * before) * rms_v * full_scales_per_volt(gain_log2)
    }
}

/// What the modulator of a channel sees, in parts of full scale.
fn input(volts: f32, channel: usize, registers: &Registers) -> f32 {
    match registers.input(channel) {
        0 => (volts * full_scales_per_volt(registers.gain_log2(channel))).clamp(-MODULATOR_LIMIT, MODULATOR_LIMIT),
        1 => 0.0,
        2 => TEST_SIGNAL,
        _ => -TEST_SIGNAL,
    }
}

/// Full scales in one volt at a gain.
fn full_scales_per_volt(gain_log2: u8) -> f32 {
    f32::from(1u8 << gain_log2) / (0.5 * SPAN_V)
}

/// The code for a part of full scale, with the channel's corrections.
fn code(part: f32, channel: usize, registers: &Registers) -> Counts {
    let offset = i64::from(registers.offset(channel));
    let gain = i64::from(registers.gain_correction(channel));
    #[expect(clippy::cast_possible_truncation, reason = "rounded; at most 1.1 · 2²³, and clipped next")]
    let rounded = (part * 0.5 * CODES + if part < 0.0 { -0.5 } else { 0.5 }) as i32;
    let raw = clip(i64::from(rounded));
    let without_offset = clip(i64::from(raw.0) - offset);
    clip((i64::from(without_offset.0) * gain) >> 23)
}

/// The nearest code the chip can output.
#[expect(clippy::cast_possible_truncation, reason = "clamped to 24 bits")]
fn clip(code: i64) -> Counts {
    Counts(code.clamp(Counts::MIN.0.into(), Counts::MAX.0.into()) as i32)
}
