//! Cost of the contact sense for one reading: `cargo bench --bench contact`. At 4 kHz there are 250 µs for each.

use divan::Bencher;
use divan::counter::ItemsCount;
use nalgebra::Vector2;
use palpate::finger::contact::{Averaging, ContactSense, ContactSettings, Reading, Tare};

/// Readings in one run: a second at 4 kHz.
const READINGS: u32 = 4000;

fn main() {
    divan::main();
}

/// A second of force with a fixed pattern for noise, mN, on top of `force` N along x.
fn readings(from: u32, force: f64) -> Vec<Reading> {
    let noise = |i: u32, k: u32| 0.004 * (f64::from((i * k) % 101) / 50.0 - 1.0);
    let reading = |i| Reading::new(f64::from(i) / 4000.0, Vector2::new(force + noise(i, 37), noise(i, 61)));
    (from..from + READINGS).map(reading).collect()
}

#[divan::bench(args = [0.0, 2.0])]
fn mains_average_to_angle(bencher: Bencher, force: f64) {
    let settings = ContactSettings { averaging: Averaging::Seconds(0.02), ..ContactSettings::default() };
    let tare = Tare::estimate(&readings(0, 0.0), &settings.tare_settings());
    let Ok(Ok(sense)) = tare.map(|tare| ContactSense::new(&settings, tare)) else { return };
    let pressed = readings(READINGS, force);
    bencher.counter(ItemsCount::new(READINGS)).with_inputs(|| sense.clone()).bench_local_values(|mut sense| {
        pressed
            .iter()
            .filter_map(|reading| sense.push(reading))
            .filter(|measured| measured.contact.touch().is_some())
            .count()
    });
}

#[divan::bench]
fn tare_of_a_second(bencher: Bencher) {
    let (rest, settings) = (readings(0, 0.0), ContactSettings::default().tare_settings());
    bencher.counter(ItemsCount::new(READINGS)).bench_local(|| Tare::estimate(&rest, &settings));
}
