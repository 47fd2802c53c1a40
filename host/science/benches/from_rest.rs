//! Naming the pose of a part that a finger began to push 0.8 s ago, by the force, edge and place unknown. Run with
//! `cargo bench --bench from_rest`.
//!
//! The bar: 50 ms for an answer from 0.8 s of values, in the median; the work of one thread, and by the clock where as many as the
//! machine has share it. And of pushes of 7 s, in which the finger turns to and fro, 10 s for saying that another part explains
//! none of it.

#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "a benchmark reads the clock; the library does not"
)]

mod yardstick;

use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
use std::thread;
use std::time::Instant;

use nalgebra::{Point2, Vector2};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::estimation::from_rest::readings::{ForceReading, KnownOfFinger, estimate_until};
use palpate::pushing::estimation::from_rest::trial::{Drawn, RADIUS_M, Ranges, random_part};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate::{Caller, Stop, never};
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

/// Pushes of 7 s.
const LONG_PUSHES: usize = 12;

/// So many threads share the work.
struct Threads(usize);

impl Caller for Threads {
    fn stops(&self) -> bool {
        false
    }

    fn work(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        let next = AtomicUsize::new(0);
        let work = || std::iter::repeat_with(|| next.fetch_add(1, Relaxed)).take_while(|k| *k < count).for_each(task);
        thread::scope(|scope| {
            (1..self.0.min(count)).for_each(|_| drop(scope.spawn(work)));
            work();
        });
    }
}

/// Who asks for an answer, and how its time is read, s.
#[derive(Clone, Copy)]
struct Asked<'a> {
    caller: Stop<'a>,
    clock: &'a dyn Fn() -> f64,
}

fn main() {
    let begun = Instant::now();
    let threads = Threads(thread::available_parallelism().map_or(1, NonZeroUsize::get));
    let alone = Asked { caller: &never, clock: &worked };
    let shared = Asked { caller: &threads, clock: &|| begun.elapsed().as_secs_f64() };
    let mut sum = 0.0;
    let yardstick = best_of_runs(|| sum += (0..10_000_u32).map(|index| f64::from(index).sin()).sum::<f64>());
    println!("a reading each 8 ms; yardstick (10,000 sines) {:.3} ms; {sum:.0}", 1e3 * yardstick);
    println!("{PUSHES} pushes of 0.8 s, the work of one thread:");
    pushed(&alone, yardstick);
    println!("the same by the clock, {} threads sharing it:", threads.0);
    pushed(&shared, yardstick);
    println!("{LONG_PUSHES} pushes of 7 s, mass and mu_c unknown, the work of one thread:");
    pushed_long(&alone, yardstick);
}

fn pushed(asked: &Asked<'_>, yardstick: f64) {
    let ranges = Ranges::default();
    for (name, knows_mass, knows_mu_c) in KNOWN {
        let answers = (0..PUSHES).filter_map(|number| {
            let mut draw = Draw::case(11, number);
            let part = random_part(&mut draw);
            let drawn = ranges.draw(&mut draw, &part)?;
            let mu_g = ranges.mu * GRAVITY_ASSUMED;
            let known = KnownOfFinger {
                mass: knows_mass.then_some(drawn.mass),
                mu_c: knows_mu_c.then_some(drawn.mu_c),
                ..KnownOfFinger::new(&part, mu_g, RADIUS_M, &ranges.motion, NOISE_N)
            };
            Some(Answer::new(&known, &readings(&drawn, &mut draw), asked))
        });
        report(name, answers.collect(), yardstick);
    }
}

fn pushed_long(asked: &Asked<'_>, yardstick: f64) {
    let ranges = Ranges { motion: to_and_fro(), ..Ranges::default() };
    for (name, is_another) in [("the part", false), ("another part", true)] {
        let answers = (0..LONG_PUSHES).filter_map(|number| {
            let mut draw = Draw::case(12, number);
            let part = random_part(&mut draw);
            let drawn = ranges.draw(&mut draw, &part)?;
            let readings = readings(&drawn, &mut draw);
            let told = if is_another { random_part(&mut draw) } else { part };
            let mu_g = ranges.mu * GRAVITY_ASSUMED;
            let known = KnownOfFinger::new(&told, mu_g, RADIUS_M, &ranges.motion, NOISE_N);
            Some(Answer::new(&known, &readings, asked))
        });
        report(name, answers.collect(), yardstick);
    }
}

/// Aside for half a second, and from then on to and fro.
fn to_and_fro() -> FingerMotion {
    let begun = [(0.3, [0.15, 0.0]), (0.5, [0.0, 0.15])];
    // No reading falls on a turn, where it is told before or after by rounding.
    let turned = (0..13).map(|turn| (0.4813, [0.0, if turn % 2 == 0 { -0.3 } else { 0.3 }]));
    let segment = |(seconds, acceleration)| Segment { seconds, acceleration: Vector2::from(acceleration) };
    let segments: Vec<_> = begun.into_iter().chain(turned).map(segment).collect();
    FingerMotion::new(Point2::origin(), &segments).expect("a finger's motion")
}

fn readings(drawn: &Drawn, draw: &mut Draw) -> Vec<ForceReading> {
    let times = (1_u32..).map(|index| f64::from(index) * DT).take_while(|time| *time < drawn.played.duration());
    let reading = |time| {
        let noise = Vector2::new(draw.normal(), draw.normal()) * NOISE_N;
        ForceReading { time, force: drawn.played.force_finger(time) + noise }
    };
    times.map(reading).collect()
}

struct Answer {
    milliseconds: f64,
    poses: usize,
}

impl Answer {
    fn new(known: &KnownOfFinger, readings: &[ForceReading], asked: &Asked<'_>) -> Self {
        let begun = (asked.clock)();
        let poses = estimate_until(known, readings, asked.caller).found.len();
        Self { milliseconds: 1e3 * ((asked.clock)() - begun), poses }
    }
}

fn report(name: &str, answers: Vec<Answer>, yardstick: f64) {
    let times = |share| percentile(answers.iter().map(|answer| answer.milliseconds), share).unwrap_or(f64::NAN);
    let of = |poses: usize| answers.iter().filter(|answer| answer.poses == poses).count();
    let [median, most, longest] = [50, 90, 100].map(times);
    println!(
        "{name}: median {median:.1} ms ({:.0} yardsticks), of 90 in 100 {most:.1} ms, longest {longest:.1} ms; one pose in \
         {}, none in {}",
        1e-3 * median / yardstick,
        of(1),
        of(0)
    );
}
