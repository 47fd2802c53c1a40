//! The resting pose from three contacts, simulated and looked up. Run with `cargo bench --bench initial_pose`.
//!
//! The bar: 0.5 ms with a table, where the push is without friction.

mod yardstick;

use std::hint::black_box;

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::pushing::dynamics::{FingerPath, FingerShape};
use palpate::pushing::estimation::{Object, RestingPush, Table, TimedContact};
use yardstick::best_of_runs;

/// A heptagon of some centimetres, m.
const HEPTAGON: [[f64; 2]; 7] = [
    [0.00275, -0.0391],
    [0.02168, 0.02685],
    [-0.00418, 0.04305],
    [-0.02147, 0.0354],
    [-0.02697, 0.02909],
    [-0.03307, 0.01079],
    [-0.03138, -0.02718],
];

/// An exact contact's tolerance, rad or m.
const TOLERANCE: f64 = 1e-6;

fn main() {
    let yardstick_s = best_of_runs(yardstick);
    println!("yardstick: 10,000 square roots, logarithms and divisions: {:.1} µs", yardstick_s * 1e6);
    let heptagon = || {
        let outline = SimplePolygon::new(HEPTAGON.map(Point2::from)).unwrap_or_else(|error| panic!("{error}"));
        Object::Polygon(outline)
    };
    let ellipse = FingerShape::Ellipse { semi_axes: [0.0114, 0.0217] };
    let slow = Plan { acceleration: [-0.05, 0.06], times: [0.59, 0.91], mu_g: 0.0 };
    let fast = Plan { acceleration: [0.1, 1.2], times: [0.1278, 0.213], mu_g: 0.3 * 9.81 };
    let rows = [
        ("ellipse on ellipse", ellipse, Object::Ellipse([0.0256, 0.0481]), None, 2.12, slow),
        ("line on ellipse", FingerShape::Line, Object::Ellipse([0.0367, 0.0195]), None, 1.39, slow),
        ("ellipse on a heptagon", ellipse, heptagon(), Some(4), -0.003, slow),
        ("disk on a heptagon with friction", FingerShape::Disk { radius: 0.01 }, heptagon(), Some(0), 0.01, fast),
    ];
    for (name, shape, object, edge, s0, plan) in rows {
        measure(name, &plan.push(object, shape), edge, s0, plan.times, yardstick_s);
    }
}

/// How the finger moves and when it is asked.
#[derive(Clone, Copy)]
struct Plan {
    acceleration: [f64; 2],
    times: [f64; 2],
    mu_g: f64,
}

impl Plan {
    fn push(&self, object: Object, shape: FingerShape) -> RestingPush {
        let path = FingerPath {
            centre0: Point2::origin(),
            velocity0: Vector2::zeros(),
            acceleration: self.acceleration.into(),
        };
        let u0 = if shape == FingerShape::Line { 0.0 } else { 1.7 };
        RestingPush::new(object, self.mu_g, shape, path, u0).unwrap_or_else(|error| panic!("{error}"))
    }
}

fn measure(name: &str, push: &RestingPush, edge: Option<usize>, s0: f64, times: [f64; 2], yardstick_s: f64) {
    let measured = push.predicted(edge, s0, &times);
    let contacts: Vec<_> = times.iter().zip(&measured).map(|(&t, &u)| TimedContact { t, u }).collect();
    assert_eq!(contacts.len(), times.len(), "{name}: the contact does not last");
    let table = Table::new(push, 1.1 * times[1]);
    let found = table.observe(&contacts, TOLERANCE);
    assert!(found.solutions.iter().any(|pose| pose.edge == edge && (pose.s0 - s0).abs() < 1e-5), "{name}: {found:?}");
    let candidates = found.candidates.len();
    let report = |what: &str, seconds: f64| {
        println!(
            "{name}, {what} ({candidates} candidates): {:.3} ms, {:.2} × yardstick",
            seconds * 1e3,
            seconds / yardstick_s
        );
    };
    report("one simulation", best_of_runs(|| drop(black_box(push.predicted(edge, s0, &times)))));
    report("scanned", best_of_runs(|| drop(black_box(push.observe(black_box(&contacts), TOLERANCE)))));
    report("looked up", best_of_runs(|| drop(black_box(table.observe(black_box(&contacts), TOLERANCE)))));
}

fn yardstick() {
    let sum: f64 = (1..10_000).map(f64::from).map(|x| black_box(x).sqrt() + x.ln() + 1.0 / x).sum();
    black_box(sum);
}
