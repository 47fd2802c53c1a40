//! Where a pushed part is, from nothing but the contact angle: every pose that the data cannot exclude.
//!
//! `cargo run --release --example estimate_pose`

use std::error::Error;

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, Start, State};
use palpate::pushing::estimation::{Channel, Known, Measured, Observation, Observer, Prior, Status, Touch};

/// Standard deviation of an angle, rad.
const SIGMA: f64 = 2e-3;

/// Time between angles, s.
const DT: f64 = 0.01;

pub(crate) fn main() -> Result<(), Box<dyn Error>> {
    let outline = [[-0.027, -0.022], [-0.002, -0.024], [0.027, 0.001], [0.03, 0.022], [0.003, 0.046]];
    let part = Part::uniform(SimplePolygon::new(outline.map(Point2::from))?);
    let finger = Finger {
        radius: 0.01,
        centre0: Point2::origin(),
        velocity0: Vector2::new(0.0, 0.05),
        acceleration: Vector2::new(0.05, 0.0),
    };
    let mu_g = 0.3 * GRAVITY_ASSUMED;

    // What happens, and what the finger feels of it.
    let model = PushModel { part: &part, edge: part.edge(1)?, mu_g, finger };
    let start = Start::Moving(State { u: 1.5, s: -0.004, omega: 0.0, v_t: 0.0 });
    let times: Vec<_> = (0..=60).map(|k| DT * f64::from(k)).collect();
    let truth = Push::new(model, ContactLaw::Rolling { friction: None }, start, EdgeEnd::Stop)?.run(&times)?;
    let mut draw = Draw::case(1, 0);
    let values = truth.samples.iter().map(|sample| sample.state.u + SIGMA * draw.normal()).collect();

    // What the host makes of it: it knows the part and the finger's motion, not the edge, the place or the speed.
    let known = Known { part: &part, mu_g, finger, touch: Touch::Rolling { friction: None } };
    let measured = Measured::ContactAngle(Channel { values, sigma: SIGMA });
    let estimate = known.estimate(&Observation { dt: DT, measured, prior: Prior::default() });

    for found in &estimate.hypotheses {
        let (pose, (distance_sd, angle_sd)) = (found.pose_end, found.spread(&part).ok_or("the place is open")?);
        println!(
            "p {:.3}: edge {}, part's origin at ({:.2}, {:.2}) mm, turned {:.2}°; its centre within {:.2} mm, {:.2}°",
            found.probability,
            found.edge,
            pose.x * 1e3,
            pose.y * 1e3,
            pose.theta.to_degrees(),
            distance_sd * 1e3,
            angle_sd.to_degrees()
        );
    }
    let end = truth.last;
    println!(
        "The truth: edge 1, ({:.2}, {:.2}) mm, {:.2}°",
        end.position.x * 1e3,
        end.position.y * 1e3,
        end.theta.to_degrees()
    );

    assert_ne!(estimate.status(), Status::Unexplained);
    let near = estimate.hypotheses.iter().filter(|found| (found.pose_end.origin() - end.position).norm() < 2e-3);
    assert!(near.count() >= 1, "the truth is in the set, within 2 mm");
    Ok(())
}
