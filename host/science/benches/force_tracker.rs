//! Following a push by force, 100 readings a second, mass and µ_c unknown. Run with `cargo bench --bench force_tracker`.
//!
//! The bars, of a reading that at most five hypotheses are taken to: 1 ms in the median, 10 ms of 99 in 100; one thread. With
//! more, what is told is never more than 0.2 s behind what is felt. Searches are made on another thread: what they find is
//! there as long after they are begun as they take.

#![allow(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "a benchmark reads the clock; the library does not"
)]

mod yardstick;

use nalgebra::Vector2;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::never;
use palpate::pushing::estimation::from_rest::readings::{ForceReading, ForceTracker, KnownOfFinger, TrackerState};
use palpate::pushing::estimation::from_rest::trial::{RADIUS_M, Ranges, random_part};
use yardstick::{best_of_runs, worked};

/// Pushes.
const PUSHES: usize = 12;

/// Readings a second.
const RATE_HZ: f64 = 100.0;

/// Of a reading, each axis, N: of a good finger, and of one whose readings leave many poses open.
const NOISES_N: [f64; 2] = [2e-3, 1e-2];

/// Hypotheses up to which the bars hold.
const FEW: usize = 5;

fn main() {
    NOISES_N.into_iter().for_each(follow);
}

fn follow(noise_sd: f64) {
    let ranges = Ranges::default();
    let mut few = Vec::new();
    let mut many = Vec::new();
    let mut searches = Vec::new();
    let mut waits: Vec<f64> = Vec::new();
    let mut arrivals: Vec<f64> = Vec::new();
    for number in 0..PUSHES {
        let mut draw = Draw::case(9, number);
        let part = random_part(&mut draw);
        let Some(drawn) = ranges.draw(&mut draw, &part) else { continue };
        let known = KnownOfFinger::new(&part, ranges.mu * 9.81, RADIUS_M, &ranges.motion, noise_sd);
        let mut tracker = ForceTracker::new(&known);
        let times =
            (1_u32..).map(|index| f64::from(index) / RATE_HZ).take_while(|time| *time < drawn.played.duration());
        let (mut searching, mut wait, mut last) = (None, 0.0_f64, 0.0);
        let mut arriving: Option<f64> = None;
        for time in times {
            // What was not done when this reading came has it wait.
            wait = (wait - (time - last)).max(0.0);
            last = time;
            if let Some((_, found)) = searching.take_if(|(done, _)| *done <= time) {
                let begun = worked();
                tracker.adopt(&known, found);
                wait += worked() - begun;
                arriving = Some(time);
            }
            let noise = Vector2::new(draw.normal(), draw.normal()) * noise_sd;
            let reading = ForceReading { time, force: drawn.played.force_finger(time) + noise };
            let begun = worked();
            tracker.take(&known, reading);
            let told = tracker.hypotheses(&known).len();
            let took = worked() - begun;
            wait += took;
            if tracker.state() == TrackerState::Following {
                if told <= FEW {
                    few.push(took)
                } else {
                    many.push(took)
                }
                waits.push(wait);
                arrivals.extend(arriving.take().map(|since| time - since));
            }
            if let Some(task) = tracker.search_due() {
                let begun = worked();
                let found = task.run(&known, &never);
                let took = worked() - begun;
                searches.push(took);
                searching = Some((time + took, found));
            }
        }
    }
    // A yardstick of some floating-point work.
    let mut sum = 0.0;
    let yardstick = best_of_runs(|| sum += (0..10_000_u32).map(|index| f64::from(index).sin()).sum::<f64>());
    println!("{PUSHES} pushes, {} mN; yardstick (10,000 sines) {:.3} ms; {sum:.0}", 1e3 * noise_sd, 1e3 * yardstick);
    for (name, times) in [("at most five hypotheses", &mut few), ("more", &mut many), ("a search", &mut searches)] {
        let [median, most] = [50, 99].map(|share| percentile(times.iter().copied(), share).unwrap_or(f64::NAN));
        println!(
            "{name}: {} times, median {:.2} ms ({:.1} yardsticks), of 99 in 100 {:.2} ms ({:.1} yardsticks)",
            times.len(),
            1e3 * median,
            median / yardstick,
            1e3 * most,
            most / yardstick,
        );
    }
    let most = |times: &[f64]| times.iter().copied().fold(0.0, f64::max);
    println!(
        "behind: {:.3} s at the most of {} readings that are followed; from what a search finds to the last reading {:.2} s of \
         readings at the most ({} times)",
        most(&waits),
        waits.len(),
        most(&arrivals),
        arrivals.len()
    );
}
