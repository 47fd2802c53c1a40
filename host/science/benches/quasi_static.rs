//! A slow push, as its limit of small steps: how long one takes. Run with `cargo bench --bench quasi_static`.
//!
//! Bar: 2 ms a push whatever the part stands on, 0.1 ms on three feet. Pushes of 15 mm, of a right-angled block with legs of
//! 150 mm, 17 mm above the plane, towards points near its centre of mass from all sides, as the recordings are. The yardstick is the
//! square roots that the friction of three feet cannot do without, in a hundred steps of seven looks, each with four
//! tries.

mod yardstick;

use std::hint::black_box;

use nalgebra::{Point2, Vector2};
use palpate::geometry::{SimplePolygon, distance_to_segment};
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::quasi_static::{Foot, SlowPush, Support};
use palpate::{Pose, never};
use yardstick::best_of_runs;

/// ms that one push may take, on anything and on three feet.
const BARS_MS: [f64; 2] = [2.0, 0.1];

/// Pushes of each kind.
const PUSHES: usize = 60;

/// Times that the same one is run for the clock's grain.
const AGAIN: u32 = 4;

fn main() {
    let yardstick_s = best_of_runs(|| yardstick(black_box(1.0)));
    println!("yardstick: 3 square roots and 3 divisions in 2800 looks: {:.1} µs", yardstick_s * 1e6);
    println!(
        "ms a push of 15 mm, least of 30 runs each, over {PUSHES} pushes; bars {} and {} ms",
        BARS_MS[0], BARS_MS[1]
    );
    println!("{:>22} {:>8} {:>8} {:>8} {:>22}", "stands on", "median", "90 %", "most", "median, × yardstick");
    let foot = |at: [f64; 2], share: f64| Foot { at: at.into(), share, friction: 0.3 };
    let feet = |places: [[f64; 2]; 3], ring_radius: f64| Support::Feet {
        feet: places.map(|at| foot(at, 1.0 / 3.0)).to_vec(),
        ring_radius,
    };
    let far = [[0.01, 0.01], [0.13, 0.01], [0.01, 0.13]];
    let six: Vec<_> =
        (0..6).map(|k| foot([0.01 + 0.02 * f64::from(k), 0.01 + 0.02 * f64::from(k % 3)], 1.0 / 6.0)).collect();
    let kinds = [
        ("three far feet", feet(far, 1e-3)),
        ("three far points", feet(far, 0.0)),
        ("three near feet", feet([[0.03, 0.03], [0.063, 0.043], [0.043, 0.063]], 1e-3)),
        ("six feet", Support::Feet { feet: six, ring_radius: 1e-3 }),
        ("face", Support::Uniform { friction: 0.3 }),
    ];
    for (name, support) in kinds {
        let mut times = Vec::new();
        for number in 0..PUSHES {
            let push = pushed(&support, number);
            let seconds = best_of_runs(|| {
                for _ in 0..AGAIN {
                    let _ = black_box(black_box(&push).run(&never));
                }
            });
            times.push(1e3 * seconds / f64::from(AGAIN));
        }
        let at = |per_cent| percentile(times.iter().copied(), per_cent).unwrap_or(f64::NAN);
        println!("{name:>22} {:>8.3} {:>8.3} {:>8.3} {:>22.2}", at(50), at(90), at(100), at(50) * 1e-3 / yardstick_s);
    }
}

/// Towards the block's middle, or 20 mm beside it, from any side.
fn pushed(support: &Support, number: usize) -> SlowPush {
    let mut draw = Draw::case(7, number);
    let outline = SimplePolygon::new([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Point2::from)).expect("a triangle");
    let angle = draw.uniform(-3.1, 3.1);
    let direction = Vector2::new(angle.cos(), angle.sin());
    let aside = Vector2::new(-direction.y, direction.x) * draw.uniform(-0.02, 0.02);
    let through = outline.centroid() + aside;
    let radius = 1e-3;
    // From half a millimetre or less before it touches, on the far side.
    let near = |back: &f64| {
        let at = through - direction * *back;
        outline.edges().any(|(a, b)| distance_to_segment(at, a, b) <= radius)
    };
    let back = (1..400).rev().map(|k| 5e-4 * f64::from(k)).find(near).unwrap_or(0.0) + 5e-4;
    let begin = through - direction * back;
    SlowPush {
        outline,
        support: support.clone(),
        centre_of_mass: None,
        gravity: 9.81,
        height: 17e-3,
        radius,
        contact_friction: [0.46, 0.6],
        path: vec![begin, begin + direction * 15e-3],
        pose: Pose { x: 0.0, y: 0.0, theta: 0.0 },
        step_max: 5e-4,
    }
}

fn yardstick(seed: f64) {
    let mut sum = 0.0;
    for i in 0..2800 {
        for foot in 0..3 {
            let x = seed + f64::from(i) + f64::from(foot);
            sum += x.sqrt() + 1.0 / x;
        }
    }
    black_box(sum);
}
