//! A finger's matrix from readings at known angles, and the force and contact angle of a new reading.
//!
//! `cargo run --example calibrate`

use std::error::Error;

use nalgebra::{Matrix2, Vector2};
use palpate::finger::calibration::{
    CalibrationContact, DwellReading, DwellTare, FitSettings, Fixture, Load, Measurements, fit,
};

/// Noise of a reading, counts: a dwell of a second at 4 kHz.
const NOISE_COUNTS: f64 = 6.0;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    // What nobody knows: the bridges stand askew by 4°, and one is 3 % more sensitive. Counts per newton.
    let (sin, cos) = 4.0_f64.to_radians().sin_cos();
    let truth = Matrix2::new(26_700.0 * cos, -26_700.0 * sin, 27_500.0 * sin, 27_500.0 * cos);
    let offset = Vector2::new(1_200.0, -800.0);
    let reading = |counts: Vector2<f64>| DwellReading {
        counts: counts + offset,
        covariance: Matrix2::identity() * NOISE_COUNTS.powi(2),
    };

    // A weight of 2 N, hung at twelve angles of a dividing head.
    let contact = |k: u32| {
        let angle = f64::from(30 * k).to_radians();
        let force_finger = -2.0 * Vector2::new(angle.cos(), angle.sin());
        CalibrationContact { angle, load: Load::Newtons(2.0), reading: reading(truth * force_finger), tare: None }
    };
    let tare = DwellTare(reading(Vector2::zeros()));
    let measurements = Measurements { contacts: (0..12).map(contact).collect(), tares: vec![tare] };
    let settings = FitSettings { fixture: Fixture::of_a_dividing_head(0.001_79), held_back_every: 4 };
    let found = fit(&measurements, &settings)?;

    // A push of 1.3 N from 75° that was not used.
    let pushed = -1.3 * Vector2::new(75.0_f64.to_radians().cos(), 75.0_f64.to_radians().sin());
    let force = found.calibration.force(&reading(truth * pushed), &tare);
    let (u, variance) = force.contact_angle();
    println!(
        "force ({:.4}, {:.4}) N on the disk; touched at {:.3}° ± {:.3}°",
        force.force_finger.x,
        force.force_finger.y,
        u.to_degrees(),
        variance.sqrt().to_degrees()
    );
    assert!((force.force_finger - pushed).norm() < 1e-3, "within a millinewton");
    assert!((u.to_degrees() - 75.0).abs() < 0.1);
    Ok(())
}
