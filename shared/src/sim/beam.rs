//! The finger's beam: a force on the disk bends it, and the disk's mass makes it ring.
//!
//! Implements: a clamped round beam with a point load at its end. Second moment of area I = π d⁴ / 64; strain at the
//! gauges ε = F L (d/2) / (E I) with L from the gauges to the contact plane; stiffness k = 3 E I / ℓ³ with ℓ from the
//! clamp to the contact plane. The disk's mass m on that stiffness oscillates in each axis alone:
//! q̈ + 2ζω q̇ + ω² q = F/m, ω² = k/m. What the gauges feel is the elastic force k q.
//! A step uses the exact solution for a force held over the step, so it is stable and free of integration error for
//! any step; the mean over the step follows exactly from the same equation.
//!
//! Assumes: a clamp at rest, small deflections, a massless beam and a point for the disk (the beam's 6 g and the disk's
//! turning lower the resonance by 5 %), one mode, rigid disk and clamp. This is what a board simulates; hosts use
//! `carried`, which has all of that. Frame: finger. Units: SI. Errors: none.

use super::trig::{phase_of, sin_cos};

/// Dimensions and material of the beam and its disk.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamConfig {
    /// Diameter of the beam, in metres.
    pub diameter: f32,
    /// Young's modulus, in pascals.
    pub youngs_modulus: f32,
    /// From the gauges to the contact plane, in metres.
    pub gauge_to_contact: f32,
    /// From the clamp to the contact plane, in metres: the length that bends.
    pub clamp_to_contact: f32,
    /// Diameter of the disk, in metres. The strain does not depend on it; whoever places contacts needs it.
    pub disk_diameter: f32,
    /// Mass of the disk, in kilograms.
    pub disk_mass: f32,
    /// Damping ratio of the resonance, 0 ≤ ζ < 1. Structural steel in a clamp: 0.01 to 0.03.
    pub damping_ratio: f32,
    /// Whether the disk's mass counts. Without it the gauges feel the force at once.
    pub resonance: bool,
}

impl Default for BeamConfig {
    /// The default finger: round steel beam, 4 mm; gauges 60 mm above the contact plane; disk 3 cm across, 20 g.
    ///
    /// The clamp is 5 mm above the gauges' centre, where a 6 mm gauge just clears it.
    fn default() -> Self {
        Self {
            diameter: 4e-3,
            youngs_modulus: 200e9,
            gauge_to_contact: 60e-3,
            clamp_to_contact: 65e-3,
            disk_diameter: 30e-3,
            disk_mass: 20e-3,
            damping_ratio: 0.02,
            resonance: true,
        }
    }
}

impl BeamConfig {
    /// Bending stiffness E I, in N·m².
    #[must_use]
    pub fn bending_stiffness(&self) -> f32 {
        let d2 = self.diameter * self.diameter;
        self.youngs_modulus * core::f32::consts::PI * d2 * d2 / 64.0
    }

    /// Strain at a gauge in line with the force, per newton.
    ///
    /// ```
    /// use palpate_shared::sim::BeamConfig;
    /// let strain_2n = 2.0 * BeamConfig::default().strain_per_newton();
    /// assert!((strain_2n - 95.5e-6).abs() < 0.05e-6); // 2 N give 95.5 microstrain
    /// ```
    #[must_use]
    pub fn strain_per_newton(&self) -> f32 {
        self.gauge_to_contact * 0.5 * self.diameter / self.bending_stiffness()
    }

    /// Stiffness of the tip, in N/m.
    #[must_use]
    pub fn tip_stiffness(&self) -> f32 {
        let l = self.clamp_to_contact;
        3.0 * self.bending_stiffness() / (l * l * l)
    }

    /// Undamped angular frequency of the disk on the beam, in rad/s.
    #[must_use]
    pub fn angular_frequency(&self) -> f32 {
        libm::sqrtf(self.tip_stiffness() / self.disk_mass)
    }
}

/// The exact solution over one step: the departure from rest at the held force, before to after.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Propagator {
    /// Row 1 acts to give the elastic force's departure, row 2 its rate over ω.
    matrix: [[f32; 2]; 2],
    /// ω times the step.
    angle: f32,
    damping_ratio: f32,
}

impl Propagator {
    /// The solution for a step, in seconds.
    fn new(config: &BeamConfig, step_s: f32) -> Self {
        Self::of_mode(config.angular_frequency() * step_s, config.damping_ratio)
    }

    /// The solution for a step over which the undamped oscillation turns by so many radians.
    #[inline(always)]
    pub(super) fn of_mode(angle: f32, zeta: f32) -> Self {
        let root = libm::sqrtf(1.0 - zeta * zeta);
        let decay = libm::expf(-zeta * angle);
        let (sin, cos) = sin_cos(phase_of(angle * root));
        let s = sin / root;
        let matrix = [[decay * (cos + zeta * s), decay * s], [-decay * s, decay * (cos - zeta * s)]];
        Self { matrix, angle, damping_ratio: zeta }
    }

    /// What the undamped oscillation turns by in a step, in radians.
    pub(super) fn angle(&self) -> f32 {
        self.angle
    }
}

/// One axis of the oscillation.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Axis {
    /// Elastic force, in newtons.
    force: f32,
    /// Its rate over ω, in newtons.
    rate: f32,
}

impl Axis {
    /// At rest under a force, in newtons.
    pub(super) fn at_rest(force: f32) -> Self {
        Self { force, rate: 0.0 }
    }

    /// Elastic force, in newtons.
    pub(super) fn force(&self) -> f32 {
        self.force
    }

    /// Its rate over ω, in newtons.
    pub(super) fn rate(&self) -> f32 {
        self.rate
    }

    /// Advances one step under a held force; returns the elastic force's mean over the step.
    pub(super) fn step(&mut self, held: f32, solution: &Propagator) -> f32 {
        let [[a, b], [c, d]] = solution.matrix;
        let away = self.force - held;
        let next = Self { force: held + a * away + b * self.rate, rate: c * away + d * self.rate };
        // The mean of q̈ + 2ζω q̇ + ω² q = ω² F over the step, solved for the mean of q.
        let inertia = next.rate - self.rate + 2.0 * solution.damping_ratio * (next.force - self.force);
        *self = next;
        held - inertia / solution.angle
    }
}

/// The beam in motion.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Beam {
    config: BeamConfig,
    solution: Propagator,
    axes: [Axis; 2],
}

impl Beam {
    /// A beam at rest, to be advanced in steps of this many seconds.
    pub(super) fn new(config: BeamConfig, step_s: f32) -> Self {
        Self { config, solution: Propagator::new(&config, step_s), axes: [Axis::default(); 2] }
    }

    /// Changes the step; the motion goes on.
    pub(super) fn set_step(&mut self, step_s: f32) {
        self.solution = Propagator::new(&self.config, step_s);
    }

    /// Advances one step under a held force in the finger frame; returns the mean elastic force.
    pub(super) fn step(&mut self, force_finger: [f32; 2]) -> [f32; 2] {
        if !self.config.resonance {
            return force_finger;
        }
        core::array::from_fn(|i| self.axes[i].step(force_finger[i], &self.solution))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// One step at 4 kSPS, in seconds.
    const STEP_S: f32 = 250e-6;

    #[test]
    fn strain_at_2_newtons_is_95_and_a_half_microstrain() {
        // By hand: I = π (4 mm)⁴ / 64 = 12.566 mm⁴; M = 2 N · 60 mm = 120 N·mm;
        // ε = M (d/2) / (E I) = 120 · 2 / (200 000 · 12.566) = 95.49e-6.
        let strain = 2.0 * BeamConfig::default().strain_per_newton();
        assert!((strain - 95.49e-6).abs() < 0.01e-6, "{strain}");
    }

    #[test]
    fn the_disk_resonates_at_186_hertz() {
        // By hand: k = 3 · 2.5133 N·m² / (65 mm)³ = 27.455 kN/m; √(k / 20 g) / 2π = 186.5 Hz.
        let hertz = BeamConfig::default().angular_frequency() / core::f32::consts::TAU;
        assert!((hertz - 186.5).abs() < 0.1, "{hertz}");
    }

    /// Elastic force after a unit step of the load, from the textbook's closed form, in double precision.
    fn step_response(config: &BeamConfig, t: f64) -> f64 {
        let (zeta, w) = (f64::from(config.damping_ratio), f64::from(config.angular_frequency()));
        let wd = w * (1.0 - zeta * zeta).sqrt();
        1.0 - (-zeta * w * t).exp() * ((wd * t).cos() + zeta * w / wd * (wd * t).sin())
    }

    proptest! {
        #[test]
        fn a_load_put_on_at_once_rings_as_the_closed_form_says(
            step_s in 15e-6f32..4e-3, damping_ratio in 0.0f32..0.5, disk_mass in 5e-3f32..0.1
        ) {
            let config = BeamConfig { damping_ratio, disk_mass, ..BeamConfig::default() };
            let mut axis = Axis::default();
            let solution = Propagator::new(&config, step_s);
            for n in 1..=100 {
                axis.step(1.0, &solution);
                let expected = step_response(&config, f64::from(n) * f64::from(step_s));
                // Each step rounds its phase to about 4e-7 rad at up to 5 rad a step, and the force to 1e-7.
                prop_assert!((f64::from(axis.force) - expected).abs() < 1e-6 * f64::from(n) + 1e-5, "step {n}");
            }
        }

        #[test]
        fn without_damping_the_energy_stays(step_s in 15e-6f32..4e-3, force in -5.0f32..5.0) {
            let config = BeamConfig { damping_ratio: 0.0, ..BeamConfig::default() };
            let solution = Propagator::new(&config, step_s);
            let mut axis = Axis { force, rate: 0.0 };
            for _ in 0..1000 {
                axis.step(0.0, &solution);
            }
            let energy = axis.force * axis.force + axis.rate * axis.rate;
            // A thousand steps of a rotation that is rounded to 1e-7 each.
            prop_assert!((energy - force * force).abs() <= 4e-4 * force * force);
        }

        #[test]
        fn the_mean_over_a_long_step_is_that_of_many_short_ones(force in -5.0f32..5.0, rate in -5.0f32..5.0) {
            let config = BeamConfig::default();
            let (mut long, mut short) = (Axis { force, rate }, Axis { force, rate });
            let mean = long.step(1.0, &Propagator::new(&config, 64.0 * STEP_S / 16.0));
            let fine = Propagator::new(&config, STEP_S / 16.0);
            let (mut sum, mut before) = (0.0, short.force);
            for _ in 0..64 {
                short.step(1.0, &fine);
                sum += 0.5 * (before + short.force); // trapezium rule; its error is (ω·16 µs)²/12 = 3e-5 of the swing
                before = short.force;
            }
            prop_assert!((mean - sum / 64.0).abs() < 1e-3, "{mean} {}", sum / 64.0);
        }
    }

    #[test]
    fn a_held_force_is_felt_in_full_once_the_ringing_is_over() {
        let mut beam = Beam::new(BeamConfig::default(), STEP_S);
        let mean = (0..8000).map(|_| beam.step([2.0, -1.0])).last();
        // After 2 s the ringing is down by e⁻⁴⁷.
        let [x, y] = mean.unwrap_or_default();
        assert!((x - 2.0).abs() < 1e-5 && (y + 1.0).abs() < 1e-5);
    }
}
