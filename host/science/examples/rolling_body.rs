//! A pebble rolls on a palm; where it is and how it turns, from where it touches.
//!
//! `cargo run --release --example rolling_body`

use std::error::Error;

use palpate::rolling::{
    BodyKnowledge, Noise, OnPalm, PalmAcceleration, PalmKnowledge, Roll, RollQuestion, RollingBody, Spin,
};

/// Gravity, m/s².
const G: f64 = 9.81;

/// Time between contacts, s.
const DT: f64 = 2e-3;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let pebble = RollingBody::ellipsoid([0.02, 0.03, 0.04])?;
    let orientation = [0.5, 0.5, -0.1, 0.7]; // w, x, y, z: a unit quaternion, body → palm

    // What happens: the palm lies still.
    let times: Vec<_> = (0..=200).map(|k| DT * f64::from(k)).collect();
    let on = OnPalm { body: &pebble, spin: Spin::Free, palm: &PalmAcceleration::Rest, g: G };
    let run = Roll::new(on, orientation, [2.0, -1.0, 0.5], [0.0, 0.0])?.run(&times)?;
    let contacts: Vec<_> = run.samples.iter().map(|sample| sample.state.u).collect();
    println!("after {:.1} s the pebble touches the palm at {:.2?} mm", 0.4, (contacts[200] * 1e3).as_slice());

    // What a palm that feels contacts to a tenth of a millimetre makes of it.
    let question = RollQuestion {
        body: BodyKnowledge::OneOf(vec![pebble.clone()]),
        spins: vec![Spin::Free],
        palm: PalmKnowledge::Known(PalmAcceleration::Rest),
        g: G,
        noise: Noise::Gauss(1e-4),
    };
    let answer = question.answer(DT, &contacts)?;
    println!(
        "{} explanations, one for each class of the body's symmetry {}",
        answer.hypotheses.len(),
        pebble.symmetry().name()
    );

    let truth = run.samples[200].state.omega;
    let off = answer.hypotheses.iter().map(|found| {
        // An ellipsoid looks the same after half turns about its axes: the turning speed, axis by axis, up to sign.
        (found.end.omega.abs() - truth.abs()).norm()
    });
    let least = off.fold(f64::INFINITY, f64::min);
    println!("turning speed known within {least:.4} rad/s");
    assert!(least < 0.05, "{least} rad/s");
    Ok(())
}
