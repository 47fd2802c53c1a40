//! A finger with known truth for the tests: written from the mechanics, using none of the code under test.

use nalgebra::{Matrix2, Vector2};

/// Counts per newton of a bridge on the default finger: 47.75 microstrain per newton at 559.24 counts per microstrain.
pub(super) const COUNTS_PER_NEWTON: f64 = 26_700.0;

/// Counts of one microstrain.
pub(super) const COUNTS_PER_MICROSTRAIN: f64 = 559.24;

/// Random numbers that are the same on every machine (SplitMix64, Box–Muller). Of its own, because this file is
/// compiled into the tests of two crates.
#[derive(Clone, Debug)]
pub(super) struct Noise(pub(super) u64);

impl Noise {
    pub(super) fn new(seed: u64) -> Self {
        Self(seed)
    }

    pub(super) fn uniform(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        (bits >> 11) as f64 / (1_u64 << 53) as f64
    }

    pub(super) fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.uniform()).cos()
    }

    pub(super) fn pair(&mut self, sigma: f64) -> Vector2<f64> {
        Vector2::new(self.normal(), self.normal()) * sigma
    }
}

/// Gauges that are neither equal nor square nor apart.
#[derive(Clone, Copy, Debug)]
pub(super) struct Finger {
    /// Gain of each bridge relative to the design.
    pub(super) gains: [f64; 2],
    /// Angle by which each pair of gauges is glued off its axis, degrees.
    pub(super) misalignment_deg: [f64; 2],
    /// Share of the other bridge's signal in each.
    pub(super) cross_talk: [f64; 2],
    /// Reading without load, counts.
    pub(super) offset: [f64; 2],
}

impl Finger {
    pub(super) const TYPICAL: Self = Self {
        gains: [1.04, 0.93],
        misalignment_deg: [2.5, -1.5],
        cross_talk: [0.01, -0.015],
        offset: [52_000.0, -31_000.0],
    };

    /// Counts without offset from a force on the disk in newtons.
    pub(super) fn counts_of_force(&self, x: f64, y: f64) -> Vector2<f64> {
        let (a, b) = (self.misalignment_deg[0].to_radians(), self.misalignment_deg[1].to_radians());
        let pure_x = COUNTS_PER_NEWTON * self.gains[0] * (a.cos() * x + a.sin() * y);
        let pure_y = COUNTS_PER_NEWTON * self.gains[1] * (b.cos() * y - b.sin() * x);
        Vector2::new(pure_x + self.cross_talk[0] * pure_y, pure_y + self.cross_talk[1] * pure_x)
    }

    /// Counts without offset from something at polar angle `degrees` that pushes with `newtons`: the force on the
    /// finger points away from it.
    pub(super) fn counts_of_contact(&self, degrees: f64, newtons: f64) -> Vector2<f64> {
        let (sin, cos) = degrees.to_radians().sin_cos();
        self.counts_of_force(-newtons * cos, -newtons * sin)
    }

    pub(super) fn offset(&self) -> Vector2<f64> {
        Vector2::from(self.offset)
    }

    /// The matrix, column by column, as the counts of unit forces.
    pub(super) fn matrix(&self) -> Matrix2<f64> {
        Matrix2::from_columns(&[self.counts_of_force(1.0, 0.0), self.counts_of_force(0.0, 1.0)])
    }
}
