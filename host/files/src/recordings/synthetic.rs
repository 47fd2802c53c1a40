//! Pushing logs made up for tests, with a truth that is known.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2};
use std::fmt::Write;

use nalgebra::Vector2;
use palpate::math::random::Draw;

/// Sampling period of force rows, s.
const PERIOD: f64 = 0.01;
/// Duration of a push, s.
const DURATION: f64 = 6.0;

/// One push: a tip moves along +y of the world into the lower edge (from (0,0) to (150,0) mm) of a triangle.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PushSpec {
    pub(crate) t0: f64,
    /// Sensor axes, N.
    pub(crate) bias: [f64; 2],
    /// When contact begins, s after the first row; 0 for a push that begins in contact.
    pub(crate) onset: f64,
    /// Angle of the force on the part from the inward normal, rad.
    pub(crate) friction: f64,
    /// Size of the force in contact, N.
    pub(crate) force: f64,
    /// Yaw of tool and part in the world, rad.
    pub(crate) yaw: f64,
    pub(crate) noise: f64,
    /// Way of the tip along the edge over the push, mm.
    pub(crate) slide: f64,
}

impl Default for PushSpec {
    fn default() -> Self {
        let bias = [0.03, -0.08];
        Self { t0: 0.0, bias, onset: 1.5, friction: 0.2, force: 3.0, yaw: 0.0, noise: 0.004, slide: 0.0 }
    }
}

/// A log with these pushes.
pub(crate) fn log(pushes: &[PushSpec]) -> String {
    let mut text = format!("{}\n", pushes.len());
    for (seed, push) in pushes.iter().enumerate() {
        push.write(&mut text, &mut Draw::case(seed as u64 + 1, 0)).unwrap();
    }
    text
}

/// `n` pushes, one a minute, each with the same onset.
pub(crate) fn session(n: u32) -> Vec<PushSpec> {
    (0..n).map(|i| PushSpec { t0: 1.4e9 + 60.0 * f64::from(i), ..PushSpec::default() }).collect()
}

impl PushSpec {
    fn write(&self, text: &mut String, random: &mut Draw) -> std::fmt::Result {
        let moved = 2.5 * (DURATION - self.onset);
        writeln!(text, "{}", self.pose(Vector2::zeros()))?;
        writeln!(text, "{}", self.pose(Vector2::new(0.0, moved)))?;
        self.forces(text, random)?;
        self.tips(text)
    }

    /// `x y z qw qx qy qz` of a frame at `offset` mm before the scene is turned by the yaw.
    fn pose(&self, offset: Vector2<f64>) -> String {
        let (sin, cos) = self.yaw.sin_cos();
        let (x, y) = (cos * offset.x - sin * offset.y, sin * offset.x + cos * offset.y);
        format!("{x:.4} {y:.4} 8.5 {:.9} 0 0 {:.9}", (self.yaw / 2.0).cos(), (self.yaw / 2.0).sin())
    }

    fn forces(&self, text: &mut String, random: &mut Draw) -> std::fmt::Result {
        let n = (DURATION / PERIOD).round();
        writeln!(text, "{n}")?;
        let mut t = 0.0;
        while t < DURATION - PERIOD / 2.0 {
            let size = if t < self.onset { 0.0 } else { self.force * ((t - self.onset) / 0.1 + 0.1).min(1.0) };
            // The force on the part is along the inward normal, +y of the part, turned by the friction. With
            // A = [[k, k], [k, -k]] its own transpose and inverse, F_sensor = −A F_tool.
            let angle = FRAC_PI_2 + self.friction;
            let (fx, fy) = (size * angle.cos(), size * angle.sin());
            let sensor = Vector2::new(-(fx + fy), -(fx - fy)) * FRAC_1_SQRT_2;
            let force = sensor + Vector2::from(self.bias) + Vector2::new(random.normal(), random.normal()) * self.noise;
            writeln!(text, "{:.6} {:.6} {:.6}", self.t0 + t, force.x, force.y)?;
            t += PERIOD;
        }
        Ok(())
    }

    /// The tip has a radius of 1 mm and is 2.5 mm/s from touching, before the onset.
    fn tips(&self, text: &mut String) -> std::fmt::Result {
        writeln!(text, "{}", 200)?;
        for i in 0..200 {
            let t = f64::from(i) * 0.03;
            let tip = Vector2::new(60.0 + self.slide * t / DURATION, -1.0 + 2.5 * (t - self.onset));
            writeln!(text, "{:.6} {}", self.t0 + t, self.pose(tip))?;
        }
        Ok(())
    }
}
