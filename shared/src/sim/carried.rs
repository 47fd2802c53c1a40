//! A finger that is carried about: what its gauges feel and where its tip is when its clamp accelerates.
//!
//! Beam and disk have mass, so that a clamp that accelerates by a bends the beam as a force −m a would, and rings it.
//! Gravity, where the finger is not mounted upright, acts the same way.
//!
//! Implements: a clamped round beam of mass per length µ with a disk of mass m and moment of inertia J about its
//! diameter at its end, by its first mode in each axis alone. The mode's shape is that of a force at the end,
//! φ(z) = z² (3ℓ − z) / 2ℓ³ (Rayleigh), so that forces and uniform fields at rest bend the tip exactly as far as beam
//! theory says. With b = g − a, the field in the clamp's frame, the tip's way q obeys M q̈ + 2ζωM q̇ + k q = F + P b,
//! ω² = k/M, M = m + J φ'(ℓ)² + µ ∫φ² = m + 9J/4ℓ² + 33/140 µℓ, P = m + µ ∫φ = m + 3/8 µℓ.
//! The gauges, L from the contact plane, feel the bending moment there. As a force on the tip it is
//! k q + (mₑ − P) b − (m_g − M) q̈: what the mode bends, and what bends beside it at rest (the moment of the mass beyond
//! the gauges, less the mode's share). mₑ = m + µL/2 is the *effective mass*: in slow motion they read F + mₑ b. m_g
//! weighs the mode's own acceleration: m + 3J/2ℓL + µ/L ∫ (z − z_g) φ from the gauges at z_g to the end.
//!
//! Assumes: as `beam`, but for the beam's mass; higher modes (the second is at 2.9 kHz) follow at once; damping acts on
//! the first mode. Held against finite elements in the end-to-end tests: 1 % of the peak up to 300 Hz.
//! Frame: finger; it does not turn. Units: SI. Errors: none.

use super::beam::{Axis, BeamConfig, Propagator};

/// Excitation is held over no more than this, in nanoseconds: the middle of a step stands for it, which at 300 Hz errs by
/// (ω h)²/24 = 1.4e-4.
const STEP_MAX_NS: u32 = 31_250;

/// What a carried finger has beside its beam's stiffness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarriedConfig {
    /// Density of the beam, in kg/m³. Steel: 7850.
    pub density: f32,
    /// Part of gravity across the beam, finger axes, in m/s²: zero for a finger that hangs or stands upright.
    pub gravity: [f32; 2],
}

impl Default for CarriedConfig {
    /// A steel beam that hangs upright.
    fn default() -> Self {
        Self { density: 7850.0, gravity: [0.0; 2] }
    }
}

/// How much of the beam and its disk moves with what, in kilograms; see the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CarriedMasses {
    /// What gauges read of an acceleration in slow motion, mₑ.
    pub effective: f32,
    /// What oscillates in the first mode, measured at the tip, M.
    pub modal: f32,
    /// What of a uniform field drives it, P.
    pub driven: f32,
    /// What gauges read of the mode's own acceleration, m_g.
    pub gauged: f32,
}

impl CarriedMasses {
    /// Those of a finger.
    ///
    /// ```
    /// use palpate_shared::sim::{BeamConfig, CarriedConfig, CarriedMasses};
    /// let masses = CarriedMasses::new(&BeamConfig::default(), CarriedConfig::default().density);
    /// // The disk's 20 g, and half of the 5.9 g of beam beyond the gauges.
    /// assert!((masses.effective - 22.96e-3).abs() < 0.01e-3);
    /// ```
    #[must_use]
    pub fn new(beam: &BeamConfig, density: f32) -> Self {
        let (l, to_gauge, disk) = (beam.clamp_to_contact, beam.gauge_to_contact, beam.disk_mass);
        let per_length = density * 0.25 * core::f32::consts::PI * beam.diameter * beam.diameter;
        let radius = 0.5 * beam.disk_diameter;
        // Of a thin disk about its diameter.
        let inertia = 0.25 * disk * radius * radius;
        let slope = 1.5 / l;
        let at = l - to_gauge;
        // ∫ (z − z_g) φ dz · 2ℓ³, from the clamp to z.
        let weighed = |z: f32| z * z * z * ((0.75 * l - 0.2 * z) * z - at * (l - 0.25 * z));
        let beyond = (weighed(l) - weighed(at)) / (2.0 * l * l * l);
        Self {
            effective: disk + 0.5 * per_length * to_gauge,
            modal: disk + inertia * slope * slope + 33.0 / 140.0 * per_length * l,
            driven: disk + 0.375 * per_length * l,
            gauged: disk + inertia * slope / to_gauge + per_length * beyond / to_gauge,
        }
    }
}

/// What acts on a carried finger at a moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Carriage {
    /// Force of the contact on the disk, finger axes, in newtons.
    pub force: [f32; 2],
    /// Acceleration of the clamp, finger axes, in m/s².
    pub acceleration: [f32; 2],
}

/// A carried finger in motion.
#[derive(Clone, Debug, PartialEq)]
pub struct CarriedBeam {
    config: BeamConfig,
    gravity: [f32; 2],
    masses: CarriedMasses,
    /// Length of a step, in nanoseconds, and how many make a period.
    step_ns: u32,
    steps: u32,
    solution: Propagator,
    axes: [Axis; 2],
}

impl CarriedBeam {
    /// A finger at rest under its own weight.
    #[must_use]
    pub fn new(beam: BeamConfig, carried: CarriedConfig) -> Self {
        let masses = CarriedMasses::new(&beam, carried.density);
        let axes = carried.gravity.map(|gravity| Axis::at_rest(masses.driven * gravity));
        Self {
            config: beam,
            gravity: carried.gravity,
            masses,
            step_ns: STEP_MAX_NS,
            steps: 1,
            solution: solution(&beam, &masses, STEP_MAX_NS),
            axes,
        }
    }

    /// Its masses.
    #[must_use]
    pub fn masses(&self) -> CarriedMasses {
        self.masses
    }

    /// Where the tip is, finger axes, in metres from where it is without load and weight at rest.
    ///
    /// A finger without resonance bends as far as the force of the last period bends it at rest.
    #[must_use]
    pub fn tip(&self) -> [f32; 2] {
        self.axes.map(|axis| axis.force() / self.config.tip_stiffness())
    }

    /// Advances one period of so many nanoseconds; `carriage` says what acts so many nanoseconds after its start. Returns
    /// the mean over the period of what the gauges feel, as a force on the tip, finger axes, in newtons.
    pub fn advance(&mut self, period_ns: u32, mut carriage: impl FnMut(u32) -> Carriage) -> [f32; 2] {
        self.divide(period_ns);
        let mut sums = [0.0; 2];
        for step in 0..self.steps {
            // Rounding is below a nanosecond.
            let acts = carriage(step * self.step_ns + self.step_ns / 2);
            for (axis, sum) in sums.iter_mut().enumerate() {
                let field = self.gravity[axis] - acts.acceleration[axis];
                *sum += self.step_axis(axis, acts.force[axis], field);
            }
        }
        sums.map(|sum| sum / self.steps as f32)
    }

    /// One axis under a force and a field, held over a step; the mean of what the gauges feel.
    fn step_axis(&mut self, axis: usize, force: f32, field: f32) -> f32 {
        let masses = &self.masses;
        let held = force + masses.driven * field;
        if !self.config.resonance {
            self.axes[axis] = Axis::at_rest(held);
            return force + masses.effective * field;
        }
        let before = self.axes[axis].rate();
        let elastic = self.axes[axis].step(held, &self.solution);
        // M q̈ on average, as a force.
        let swing = (self.axes[axis].rate() - before) / self.solution.angle();
        elastic + (masses.effective - masses.driven) * field - (masses.gauged / masses.modal - 1.0) * swing
    }

    /// Adopts a period.
    fn divide(&mut self, period_ns: u32) {
        let steps = period_ns.div_ceil(STEP_MAX_NS).max(1);
        if self.steps != steps || self.step_ns != period_ns / steps {
            (self.steps, self.step_ns) = (steps, period_ns / steps);
            self.solution = solution(&self.config, &self.masses, self.step_ns);
        }
    }
}

/// The first mode's motion over a step.
fn solution(beam: &BeamConfig, masses: &CarriedMasses, step_ns: u32) -> Propagator {
    let angular_frequency = libm::sqrtf(beam.tip_stiffness() / masses.modal);
    Propagator::of_mode(angular_frequency * step_ns as f32 * 1e-9, beam.damping_ratio)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One conversion at 4 kSPS, in nanoseconds.
    const PERIOD_NS: u32 = 250_000;

    /// Rounding of a force of a newton over the thousands of steps below, in newtons.
    const ROUNDING_N: f32 = 2e-5;

    fn finger(carried: CarriedConfig) -> CarriedBeam {
        CarriedBeam::new(BeamConfig::default(), carried)
    }

    /// What is felt at the end of two seconds, the ringing being down by e⁻⁴⁵.
    fn settled(beam: &mut CarriedBeam, carriage: Carriage) -> [f32; 2] {
        (0..8000).map(|_| beam.advance(PERIOD_NS, |_| carriage)).last().unwrap_or_default()
    }

    #[test]
    fn in_slow_motion_the_effective_mass_is_missing_from_the_force() {
        let mut beam = finger(CarriedConfig::default());
        let carriage = Carriage { force: [1.0, -0.5], acceleration: [0.15, 2.0] };
        let [x, y] = settled(&mut beam, carriage);
        // By hand: 20 g + 7850 kg/m³ · π/4 · (4 mm)² · 60 mm / 2 = 22.96 g.
        let mass = 22.96e-3;
        assert!((x - (1.0 - mass * 0.15)).abs() < ROUNDING_N, "{x}");
        assert!((y - (-0.5 - mass * 2.0)).abs() < ROUNDING_N, "{y}");
    }

    #[test]
    fn the_tip_gives_way_by_36_micrometres_a_newton() {
        let mut beam = finger(CarriedConfig::default());
        settled(&mut beam, Carriage { force: [1.0, 0.0], acceleration: [0.0; 2] });
        // By hand: 1 N / 27.455 kN/m.
        assert!((beam.tip()[0] - 36.42e-6).abs() < 0.01e-6, "{:?}", beam.tip());
    }

    #[test]
    fn a_tilted_finger_feels_its_own_weight_and_rests_under_it() {
        let gravity = [9.80665 * 0.5, 0.0]; // 30° off upright
        let mut beam = finger(CarriedConfig { gravity, ..CarriedConfig::default() });
        let first = beam.advance(PERIOD_NS, |_| Carriage::default());
        assert!((first[0] - 22.96e-3 * gravity[0]).abs() < ROUNDING_N, "{first:?}");
        // Beam theory by hand: (m + 3/8 · 6.412 g) · g / k.
        let bent = (20e-3 + 0.375 * 6.412e-3) * gravity[0] / 27.455e3;
        assert!((beam.tip()[0] - bent).abs() < 1e-3 * bent, "{:?} {bent}", beam.tip());
    }

    #[test]
    fn a_beam_without_mass_and_a_point_for_a_disk_is_the_beam_at_rest() {
        let beam = BeamConfig { disk_diameter: 0.0, ..BeamConfig::default() };
        let masses = CarriedMasses::new(&beam, 0.0);
        for mass in [masses.effective, masses.modal, masses.driven, masses.gauged] {
            assert!((mass - beam.disk_mass).abs() < 1e-8, "{masses:?}");
        }
    }

    #[test]
    fn the_rate_of_conversions_does_not_change_the_motion() {
        let [mut fast, mut slow] = [0, 1].map(|_| finger(CarriedConfig::default()));
        let carriage = |t_ns: u32| Carriage { force: [t_ns as f32 * 1e-6, 0.0], acceleration: [0.0, 3.0] };
        let slow_felt = slow.advance(16 * PERIOD_NS, carriage);
        let mut sum = [0.0; 2];
        for part in 0..16 {
            let felt = fast.advance(PERIOD_NS, |t_ns| carriage(t_ns + part * PERIOD_NS));
            (0..2).for_each(|i| sum[i] += felt[i] / 16.0);
        }
        for i in 0..2 {
            assert!((slow_felt[i] - sum[i]).abs() < ROUNDING_N, "{slow_felt:?} {sum:?}");
            assert!((slow.tip()[i] - fast.tip()[i]).abs() < 1e-9, "{:?} {:?}", slow.tip(), fast.tip());
        }
    }

    #[test]
    fn without_resonance_everything_follows_at_once() {
        let config = BeamConfig { resonance: false, ..BeamConfig::default() };
        let mut beam = CarriedBeam::new(config, CarriedConfig::default());
        let felt = beam.advance(PERIOD_NS, |_| Carriage { force: [1.0, 0.0], acceleration: [1.0, 0.0] });
        assert!((felt[0] - (1.0 - 22.96e-3)).abs() < ROUNDING_N, "{felt:?}");
    }
}
