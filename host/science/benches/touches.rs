//! Poses from touches: how long it takes to find all of them. Run with `cargo bench --bench touches`.
//!
//! Bars: five touches on a 10-gon ≤ 1 ms in the median; more touches in proportion. From touches to modes; every part and
//! pose is new.

mod yardstick;

use std::f64::consts::TAU;

use nalgebra::Vector2;
use palpate::geometry::{Pose, SimplePolygon};
use palpate::inscription::{FeltNormal, Touch, TouchReadings, touched_poses};
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use yardstick::best_of_runs_within;

/// Corners of the parts and how often each is touched.
const SIZES: [(usize, usize); 10] =
    [(10, 3), (10, 5), (10, 10), (10, 20), (10, 50), (10, 100), (10, 200), (10, 500), (50, 5), (200, 5)];

/// Problems of each size.
const PROBLEMS: usize = 40;

/// What takes longer is run once, s.
const LONG_S: f64 = 0.05;

/// Standard deviation of touches on parts about 8 cm across, m: a good probe's, a finger's.
const SIGMAS: [f64; 2] = [5e-5, 5e-4];

fn main() {
    println!("ms a problem, least of some runs each, over {PROBLEMS} problems");
    println!(
        "{:>8} {:>8} {:>10} {:>8} {:>10} {:>10} {:>10}",
        "corners", "touches", "sigma mm", "normals", "median", "90 %", "modes"
    );
    for (corners, touches) in SIZES {
        for sigma in SIGMAS {
            for with_normals in [false, true] {
                measure(corners, touches, sigma, with_normals);
            }
        }
    }
}

fn measure(corners: usize, touches: usize, sigma: f64, with_normals: bool) {
    let mut times = Vec::with_capacity(PROBLEMS);
    let mut modes = 0;
    for index in 0..PROBLEMS {
        let (part, readings) = problem(corners, touches, sigma, with_normals, index);
        let mut found = 0;
        times.push(1e3 * best_of_runs_within(LONG_S, || found = touched_poses(&part, &readings).modes.len()));
        modes += found;
    }
    let at = |per_cent: usize| percentile(times.iter().copied(), per_cent).unwrap_or(f64::NAN);
    println!(
        "{corners:>8} {touches:>8} {:>10} {:>8} {:>10.3} {:>10.3} {:>10.2}",
        1e3 * sigma,
        if with_normals { "yes" } else { "no" },
        at(50),
        at(90),
        modes as f64 / PROBLEMS as f64
    );
}

fn problem(
    corners: usize,
    count: usize,
    sigma: f64,
    with_normals: bool,
    index: usize,
) -> (SimplePolygon, TouchReadings) {
    let mut draw = Draw::case(corners as u64, index);
    let part = if index.is_multiple_of(2) {
        draw.convex_polygon(corners, 0.04)
    } else {
        draw.star_polygon(corners, 0.025, 0.045)
    };
    let pose = Pose { x: 0.3, y: -0.1, theta: draw.uniform(0.0, TAU) };
    let edges: Vec<_> = part.edges().map(|(a, b)| (pose.isometry() * a, pose.isometry() * b)).collect();
    let touch = |_| {
        let (a, b) = edges[draw.index(edges.len())];
        let error = Vector2::new(draw.normal(), draw.normal()) * sigma;
        let normal_sigma = 0.03;
        let angle = (a.x - b.x).atan2(b.y - a.y) + normal_sigma * draw.normal();
        let normal = with_normals.then_some(FeltNormal { angle, sigma: normal_sigma });
        Touch { point: a + (b - a) * draw.unit() + error, sigma, normal }
    };
    (part, TouchReadings { touches: (0..count).map(touch).collect(), ..TouchReadings::default() })
}
