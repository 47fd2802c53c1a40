//! Naming the pose of a pushed octagon, edge unknown, from 0.8 s of contact angles at 100 Hz; and the update of a
//! tracker. Run with `cargo bench --bench observe`.
//!
//! The bars: 5 ms and fewer than 60 simulations for the median push; 1 ms an update.

mod yardstick;

use std::hint::black_box;

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::pushing::dynamics::{ContactMode, Finger, Part, PushModel, State};
use palpate::pushing::estimation::{
    Channel, Known, Measured, Observation, Prior, Touch, Tracker, TrackerSettings, estimate,
};
use yardstick::best_of_runs;

/// An octagon of some centimetres without two edges alike, m.
const OCTAGON: [[f64; 2]; 8] = [
    [0.034, 0.004],
    [0.022, 0.025],
    [0.001, 0.036],
    [-0.021, 0.024],
    [-0.031, -0.002],
    [-0.024, -0.023],
    [0.003, -0.031],
    [0.025, -0.021],
];

/// Standard deviation of a value, rad: 0.112°.
const SIGMA: f64 = 1.95e-3;

/// Time between values, s, and their number.
const DT: f64 = 0.01;
const VALUES: usize = 81;

fn main() {
    let outline = SimplePolygon::new(OCTAGON.map(Point2::from)).unwrap_or_else(|error| panic!("{error}"));
    let part = Part::uniform(outline);
    for (name, touch, contact) in [
        ("rolling", Touch::Rolling { friction: None }, ContactMode::Rolling),
        ("frictionless", Touch::Frictionless, ContactMode::Frictionless),
    ] {
        let mut pushes: Vec<_> = (0..8).map(|edge| time_push(&part, edge, touch, contact)).collect();
        pushes.sort_by(|a, b| a.seconds.total_cmp(&b.seconds));
        let simulations: Vec<_> = pushes.iter().map(|push| push.simulations).collect();
        println!(
            "{name}: median {:.2} ms, slowest {:.2} ms; simulations {simulations:?}; a simulation {:.1} µs; tracker {:.2} ms a value",
            pushes[4].seconds * 1e3,
            pushes[7].seconds * 1e3,
            pushes[4].simulation * 1e6,
            pushes[4].update * 1e3,
        );
    }
}

/// Best times of one push, s.
struct Timed {
    seconds: f64,
    simulations: usize,
    simulation: f64,
    update: f64,
}

fn time_push(part: &Part, edge: usize, touch: Touch, contact: ContactMode) -> Timed {
    let finger = Finger {
        radius: 0.01,
        centre0: Point2::origin(),
        velocity0: Vector2::new(0.0, 0.05),
        acceleration: Vector2::zeros(),
    };
    let known = Known { part, mu_g: 0.3 * 9.81, finger, touch };
    let edge = part.edge(edge).unwrap_or_else(|error| panic!("{error}"));
    let model = PushModel { part, edge, mu_g: known.mu_g, finger };
    let start = State { u: 1.6, s: 0.25 * edge.s_min + 0.75 * edge.s_max, omega: 0.1, v_t: 0.0 };
    let path = std::iter::once(start).chain(model.rollout(&contact, &start, DT / 5.0)).step_by(5).take(VALUES);
    // An error of one standard deviation, up and down.
    let values: Vec<_> = path.enumerate().map(|(i, state)| state.u + if i % 2 == 0 { SIGMA } else { -SIGMA }).collect();
    let prior = Prior { omega0_sigma: Some(1.0), v_t0_sigma: Some(0.004), mu_g_log_sigma: None };
    let measured = Measured::ContactAngle(Channel { values: values.clone(), sigma: SIGMA });
    let observation = Observation { dt: DT, measured, prior };
    let simulations = estimate(&known, &observation).simulations;
    let seconds = best_of_runs(|| {
        black_box(estimate(&known, &observation));
    });
    let simulation = best_of_runs(|| {
        black_box(model.rollout(&contact, &start, DT).nth(VALUES - 2));
    });
    let tracked = best_of_runs(|| {
        let mut tracker = Tracker::new(known, TrackerSettings { dt: DT, sigma: SIGMA, prior, window: VALUES });
        for value in &values {
            black_box(tracker.push_sample(Some(*value)));
        }
    });
    Timed { seconds, simulations, simulation, update: tracked / values.len() as f64 }
}
