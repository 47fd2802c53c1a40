//! Seeded noise for the tests of this module: white noise, mains hum, drift and steps, with known sizes.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::Reading;

/// A small generator of its own (SplitMix64), so that the numbers of the finger's tests never change with a dependency;
/// what else draws, draws with [`crate::math::random::Draw`].
#[derive(Clone, Debug)]
pub(crate) struct Random(pub(crate) u64);

impl Random {
    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in (0, 1): in the middle of each step.
    pub(crate) fn uniform(&mut self) -> f64 {
        self.unit() + 0.5 / (1_u64 << 53) as f64
    }

    /// Two independent standard normal values (Box and Muller).
    pub(crate) fn normal2(&mut self) -> Vector2<f64> {
        let radius = (-2.0 * self.uniform().ln()).sqrt();
        let angle = TAU * self.uniform();
        Vector2::new(radius * angle.cos(), radius * angle.sin())
    }
}

/// A force signal at rest.
#[derive(Clone, Debug)]
pub(crate) struct Noise {
    pub(crate) random: Random,
    pub(crate) bias: Vector2<f64>,
    /// Standard deviation of the white noise on each axis.
    pub(crate) white: f64,
    /// Amplitude of 50 Hz hum; y lags by 1 rad.
    pub(crate) hum: f64,
    /// Standard deviation of slow noise on each axis, which forgets itself in 10 ms.
    pub(crate) red: f64,
    pub(crate) red_now: Vector2<f64>,
    /// Drift on x, per second.
    pub(crate) drift: f64,
    pub(crate) rate_hz: f64,
    pub(crate) t: f64,
}

impl Noise {
    pub(crate) fn white(seed: u64, white: f64) -> Self {
        let bias = Vector2::new(0.3, -0.7);
        let red_now = Vector2::zeros();
        Self { random: Random(seed), bias, white, hum: 0.0, red: 0.0, red_now, drift: 0.0, rate_hz: 1000.0, t: 0.0 }
    }

    pub(crate) fn sampled(self, rate_hz: f64) -> Self {
        Self { rate_hz, ..self }
    }

    pub(crate) fn reading(&mut self) -> Reading {
        let phase = TAU * 50.0 * self.t;
        let hum = Vector2::new(phase.sin(), (phase - 1.0).sin()) * self.hum;
        let drift = Vector2::new(self.drift * self.t, 0.0);
        let keep = (-100.0 / self.rate_hz).exp();
        self.red_now = self.red_now * keep + self.random.normal2() * self.red * (1.0 - keep * keep).sqrt();
        let noise = self.random.normal2() * self.white + self.red_now;
        let reading = Reading::new(self.t, self.bias + noise + hum + drift);
        self.t += 1.0 / self.rate_hz;
        reading
    }

    pub(crate) fn readings(&mut self, n: usize) -> Vec<Reading> {
        (0..n).map(|_| self.reading()).collect()
    }

    /// Forces on the finger of the next `n` readings, finger axes.
    pub(crate) fn take(mut self, n: usize) -> Vec<Vector2<f64>> {
        (0..n).map(|_| self.reading().force_finger).collect()
    }
}
