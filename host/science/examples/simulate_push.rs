//! How a part moves when a finger pushes it: Coulomb friction on the table and at the finger.
//!
//! `cargo run --example simulate_push`

use std::error::Error;

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, Start};

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let outline = [[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03]].map(Point2::from); // m, counter-clockwise
    let part = Part::uniform(SimplePolygon::new(outline)?);
    let finger = Finger {
        radius: 0.01,
        centre0: Point2::origin(),
        velocity0: Vector2::zeros(),
        acceleration: Vector2::new(0.0, 0.15),
    };
    let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 0.3 * GRAVITY_ASSUMED, finger };

    // Part and finger at rest; the finger touches the lower edge 5 mm beside the middle, from below, and accelerates
    // up.
    let start = Start::Rest { u: 1.5, s: 0.005 };
    let push = Push::new(model, ContactLaw::Coulomb { friction: 0.3 }, start, EdgeEnd::Stop)?;
    let times: Vec<_> = (0..=8).map(|k| 0.1 * f64::from(k)).collect();
    let run = push.run(&times)?;

    println!("   t [s]  x [mm]  y [mm]  turned [°]  contact angle [°]  on edge [mm]  contact");
    for sample in &run.samples {
        let (place, state) = (sample.position * 1e3, sample.state);
        let (turned, u) = (sample.theta.to_degrees(), state.u.to_degrees());
        let contact = sample.contact;
        println!(
            "{:8.1}{:8.2}{:8.2}{turned:12.2}{u:19.2}{:14.2}  {contact:?}",
            sample.t,
            place.x,
            place.y,
            state.s * 1e3
        );
    }
    println!("It ended at {:.3} s: {:?}.", run.end.t, run.end.reason);

    assert!(run.samples.len() > 1, "the push lasts");
    let (first, last) = (&run.samples[0], &run.last);
    assert!((last.position - first.position).norm() > 0.01, "the part goes along: by more than 10 mm");
    Ok(())
}
