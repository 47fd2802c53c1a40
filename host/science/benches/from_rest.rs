//! Naming the pose of a part that a finger began to push 0.8 s ago, by the force, edge and place unknown. Run with
//! `cargo bench --bench from_rest`.
//!
//! The bar: 50 ms for an answer from 0.8 s of values, in the median; one thread.

#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "a benchmark reads the clock; the library does not"
)]

mod yardstick;

use nalgebra::Vector2;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::never;
use palpate::pushing::estimation::from_rest::readings::{ForceReading, KnownOfFinger, estimate_until};
use palpate::pushing::estimation::from_rest::trial::{RADIUS_M, Ranges, random_part};
use yardstick::{best_of_runs, worked};

/// Pushes; each is new to what answers.
const PUSHES: usize = 40;

/// Time between readings, s.
const DT: f64 = 8e-3;

/// Of a reading, each axis, N.
const NOISE_N: f64 = 2e-3;

/// What is known of the part's mass and of µ_c.
const KNOWN: [(&str, bool, bool); 4] = [
    ("mass and mu_c known", true, true),
    ("mass unknown", false, true),
    ("mu_c unknown", true, false),
    ("mass and mu_c unknown", false, false),
];

fn main() {
    let ranges = Ranges::default();
    let mut sum = 0.0;
    let yardstick = best_of_runs(|| sum += (0..10_000_u32).map(|index| f64::from(index).sin()).sum::<f64>());
    println!(
        "{PUSHES} pushes of 0.8 s, a reading each 8 ms; yardstick (10,000 sines) {:.3} ms; {sum:.0}",
        1e3 * yardstick
    );
    for (name, knows_mass, knows_mu_c) in KNOWN {
        let mut times = Vec::with_capacity(PUSHES);
        let mut unique = 0;
        for number in 0..PUSHES {
            let mut draw = Draw::case(11, number);
            let part = random_part(&mut draw);
            let Some(drawn) = ranges.draw(&mut draw, &part) else { continue };
            let mu_g = ranges.mu * GRAVITY_ASSUMED;
            let known = KnownOfFinger {
                mass: knows_mass.then_some(drawn.mass),
                mu_c: knows_mu_c.then_some(drawn.mu_c),
                ..KnownOfFinger::new(&part, mu_g, RADIUS_M, &ranges.motion, NOISE_N)
            };
            let times_read = (1_u32..).map(|index| f64::from(index) * DT);
            let readings: Vec<_> = times_read
                .take_while(|time| *time < drawn.played.duration())
                .map(|time| {
                    let noise = Vector2::new(draw.normal(), draw.normal()) * NOISE_N;
                    ForceReading { time, force: drawn.played.force_finger(time) + noise }
                })
                .collect();
            let begun = worked();
            let found = estimate_until(&known, &readings, &never).found;
            times.push(1e3 * (worked() - begun));
            unique += usize::from(found.len() == 1);
        }
        let [median, most] = [50, 90].map(|share| percentile(times.iter().copied(), share).unwrap_or(f64::NAN));
        println!(
            "{name}: median {median:.1} ms ({:.0} yardsticks), of 90 in 100 {most:.1} ms; one pose in {unique}",
            1e-3 * median / yardstick
        );
    }
}
