//! The simulated finger in motion against finite elements: what the gauges feel and where the tip is; and when a sample
//! of it was taken.

use std::f64::consts::{PI, TAU};
use std::sync::Arc;
use std::time::Duration;

use palpate_device::session::SessionOptions;
use palpate_device::simulated::{CarriedCourse, Config, Pace, SimulatedDevice};
use palpate_device::{Incoming, Session};
use palpate_shared::sim::{BeamConfig, Carriage, CarriedBeam, CarriedConfig, FingerConfig};
use palpate_tests::beam_oracle::{self, Finger, Moment, STEP_S, Seen};

/// Time over which the simulated finger averages, ns: short, so that averaging itself costs (ω h)²/24 = 1e-5 at 300 Hz.
const PERIOD_NS: u32 = 10_000;

/// Largest departure, as a share of the peak: what the first mode alone leaves out of bending at 300 Hz, a tenth of the
/// second mode's frequency.
const SHARE_OF_PEAK: f64 = 0.01;

/// How long each motion is followed, s: the ringing falls by half meanwhile.
const SECONDS: f64 = 0.06;

/// The default finger, for the oracle.
fn finger(beam: &BeamConfig, density: f32) -> Finger {
    let [diameter, disk_mass, disk_diameter] = [beam.diameter, beam.disk_mass, beam.disk_diameter].map(f64::from);
    Finger {
        stiffness: f64::from(beam.youngs_modulus) * PI * diameter.powi(4) / 64.0,
        mass_per_length: f64::from(density) * PI * diameter.powi(2) / 4.0,
        length: f64::from(beam.clamp_to_contact),
        disk_mass,
        disk_inertia: disk_mass * disk_diameter.powi(2) / 16.0,
        damping_ratio: f64::from(beam.damping_ratio),
    }
}

/// Both, moment by moment, on the same times.
fn both(beam: BeamConfig, moment: impl Fn(f64) -> Moment) -> (Vec<Seen>, Vec<Seen>) {
    let carried = CarriedConfig::default();
    let steps = (SECONDS / STEP_S) as usize;
    let expected = beam_oracle::simulate(&finger(&beam, carried.density), steps, &moment);
    let mut simulated = CarriedBeam::new(beam, carried);
    let mut found = Vec::new();
    for step in 0..steps {
        let felt = simulated.advance(PERIOD_NS, |after_ns| {
            let now = moment(step as f64 * STEP_S + f64::from(after_ns) * 1e-9);
            Carriage { force: [0.0, now.force as f32], acceleration: [0.0, now.clamp[2] as f32] }
        });
        found.push(Seen { gauge_force: f64::from(felt[1]), tip: f64::from(simulated.tip()[1]) });
    }
    // A mean over a step is the value at its middle; the oracle's are at ends.
    let middles = expected
        .windows(2)
        .map(|two| Seen { gauge_force: 0.5 * (two[0].gauge_force + two[1].gauge_force), tip: two[1].tip });
    (found[1..].to_vec(), middles.collect())
}

/// Largest departure of one value, as a share of its peak.
fn off(found: &[Seen], expected: &[Seen], of: impl Fn(&Seen) -> f64) -> f64 {
    let peak = expected.iter().map(|seen| of(seen).abs()).fold(0.0, f64::max);
    let worst = found.iter().zip(expected).map(|(a, b)| (of(a) - of(b)).abs()).fold(0.0, f64::max);
    worst / peak
}

fn agrees(name: &str, moment: impl Fn(f64) -> Moment) {
    let (found, expected) = both(BeamConfig::default(), moment);
    let (force, tip) = (off(&found, &expected, |seen| seen.gauge_force), off(&found, &expected, |seen| seen.tip));
    println!("{name}: force off by {:.3} % of its peak, the tip by {:.3} %", force * 100.0, tip * 100.0);
    assert!(force < SHARE_OF_PEAK, "{name}: force off by {force} of its peak, at most {SHARE_OF_PEAK}");
    assert!(tip < SHARE_OF_PEAK, "{name}: tip off by {tip} of its peak, at most {SHARE_OF_PEAK}");
}

/// A clamp that swings at a frequency, in from rest over two periods: place, velocity, acceleration.
fn harmonic(hertz: f64, amplitude: f64) -> impl Fn(f64) -> Moment {
    // a(t) = A (1 − cos(ωt/4))/2 · sin ωt until 2 periods, then A sin ωt; integrated by Simpson's rule once and kept.
    let omega = TAU * hertz;
    let acceleration = move |t: f64| {
        let envelope = if omega * t < 4.0 * PI { 0.5 * (1.0 - (0.25 * omega * t).cos()) } else { 1.0 };
        amplitude * envelope * (omega * t).sin()
    };
    tabulated(acceleration)
}

/// An acceleration with the places and velocities that it leads to, by Simpson's rule between the oracle's steps.
fn tabulated(acceleration: impl Fn(f64) -> f64) -> impl Fn(f64) -> Moment {
    let (mut place, mut velocity) = (0.0, 0.0);
    let mut table = vec![[0.0, 0.0]];
    for step in 0..(SECONDS / STEP_S) as usize + 2 {
        let t = step as f64 * STEP_S;
        let [a, b, c] = [0.0, 0.5, 1.0].map(|share| acceleration(t + share * STEP_S));
        place += STEP_S * velocity + STEP_S * STEP_S * (a + 2.0 * b) / 6.0;
        velocity += STEP_S * (a + 4.0 * b + c) / 6.0;
        table.push([place, velocity]);
    }
    move |t: f64| {
        let [place, velocity] = table[(t / STEP_S).round() as usize];
        Moment { clamp: [place, velocity, acceleration(t)], force: 0.0 }
    }
}

#[test]
fn a_finger_that_swings_up_to_300_hertz_feels_and_bends_as_finite_elements_do() {
    for hertz in [20.0, 60.0, 120.0, 250.0, 300.0] {
        agrees(&format!("harmonic, {hertz} Hz"), harmonic(hertz, 1.0));
    }
}

#[test]
fn a_finger_on_an_s_curve_feels_and_bends_as_finite_elements_do() {
    // Jerk 50 m/s³ up and down again, twice: 0.15 m/s² after 3 ms, held for 12 ms.
    let acceleration = |t: f64| {
        let ramp = |from: f64, to: f64| ((t - from) / (to - from)).clamp(0.0, 1.0);
        0.15 * (ramp(0.005, 0.008) - ramp(0.02, 0.023) - ramp(0.03, 0.033) + ramp(0.045, 0.048))
    };
    agrees("S-curve", tabulated(acceleration));
}

#[test]
fn a_finger_whose_acceleration_rises_in_2_milliseconds_feels_and_bends_as_finite_elements_do() {
    let acceleration = |t: f64| {
        let share = ((t - 0.002) / 0.002).clamp(0.0, 1.0);
        0.15 * share * share * (3.0 - 2.0 * share)
    };
    agrees("step with a rise of 2 ms", tabulated(acceleration));
}

#[test]
fn a_force_that_rises_on_a_finger_that_moves_is_felt_as_finite_elements_feel_it() {
    let motion = harmonic(40.0, 0.5);
    let moment = move |t: f64| {
        let share = ((t - 0.01) / 0.002).clamp(0.0, 1.0);
        Moment { force: -0.6 * share * share * (3.0 - 2.0 * share), ..motion(t) }
    };
    agrees("force of 0.6 N on a swinging finger", moment);
}

#[test]
fn an_oracle_at_rest_bends_as_beam_theory_says() {
    let beam = BeamConfig { damping_ratio: 0.7, ..BeamConfig::default() };
    let finger = finger(&beam, 7850.0);
    let steps = (SECONDS / STEP_S) as usize;
    let seen = beam_oracle::simulate(&finger, steps, |_| Moment { force: 1.0, ..Moment::default() });
    let last = seen.last().unwrap();
    // ℓ³/3EI, once the ringing is down by e⁻⁴⁷.
    let expected = finger.length.powi(3) / (3.0 * finger.stiffness);
    assert!((last.tip / expected - 1.0).abs() < 1e-9, "{} {expected}", last.tip);
    assert!((last.gauge_force - 1.0).abs() < 1e-9, "{}", last.gauge_force);
}

/// How long the force below rises, s, and to what, N.
const RISE: (f64, f32) = (0.2, 1.0);

/// A sample's time may be off by so much, s: rounding of codes, and straight lines between forces.
const TIME_ERROR_S: f64 = 2e-6;

#[test]
fn a_sample_tells_of_the_moment_that_its_filter_weighs_most_at_every_rate() {
    for rate_hz in [8000, 4000, 2000, 500] {
        let config = Config {
            finger: FingerConfig::ideal(),
            carried: CarriedConfig { density: 0.0, ..CarriedConfig::default() },
            pace: Pace::AsAsked,
            ..Config::default()
        };
        let hand = Arc::new(SimulatedDevice::start(config).unwrap());
        let mut session = Session::open_simulated(Arc::clone(&hand), SessionOptions::default()).unwrap();
        session.set_rate(rate_hz).unwrap();
        session.start().unwrap();
        let forces = [0.0, RISE.1].map(|x| Carriage { force: [x, 0.0], ..Carriage::default() });
        let begun = hand.set_course(CarriedCourse::new(RISE.0, forces.to_vec())).unwrap().truth.time_ns as f64 * 1e-9;
        // Codes over time while the force rises evenly: a straight line that begins when the force does.
        let mut points: Vec<[f64; 2]> = Vec::new();
        while points.last().is_none_or(|[t, _]| *t < begun + RISE.0) {
            let Some(Incoming::Samples(samples)) = session.next(Duration::from_secs(10)).unwrap() else { continue };
            let code = |index: usize| f64::from(samples.counts[index][0].0);
            points.extend((0..samples.counts.len()).map(|index| [samples.measured_time_s(index), code(index)]));
        }
        let within = |[t, _]: &&[f64; 2]| (begun + 0.02..begun + RISE.0 - 0.02).contains(t);
        let rising: Vec<_> = points.iter().filter(within).copied().collect();
        let mean = |n: usize| rising.iter().map(|point| point[n]).sum::<f64>() / rising.len() as f64;
        let [t, code] = [mean(0), mean(1)];
        let slope = rising.iter().map(|p| (p[0] - t) * (p[1] - code)).sum::<f64>()
            / rising.iter().map(|p| (p[0] - t).powi(2)).sum::<f64>();
        let starts = t - code / slope;
        assert!((starts - begun).abs() < TIME_ERROR_S, "{rate_hz} Hz: {:.1} us late", (starts - begun) * 1e6);
    }
}
