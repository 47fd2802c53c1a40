//! Dwells of a simulated finger that rests, drifts, slips, swings, rings down or loses its load.

use nalgebra::Vector2;
use palpate_shared::status::Status;
use palpate_shared::units::Counts;

use super::dwell::*;
use super::front_end::{FrontEnd, FrontEndSettings};
use super::test_world::{COUNTS_PER_MICROSTRAIN, Noise};
use crate::finger::Samples;

const RATE_HZ: f64 = 4000.0;

/// Noise of a single sample, microstrain, and hum from peak to peak, of the default finger.
const NOISE: f64 = 0.48;
const HUM: f64 = 1.0;

fn settings() -> DwellSettings {
    let front_end =
        FrontEnd::new(FrontEndSettings { gain: 32, excitation_v: 2.5, full_scale_v: 1.2, gauge_factor: 2.0 }).unwrap();
    DwellSettings::new(front_end, RATE_HZ)
}

/// Blocks of eight samples of microstrain(t) with the default finger's noise and hum, for `seconds`.
fn stream(seed: u64, mains_hz: f64, seconds: f64, microstrain: impl Fn(f64) -> [f64; 2]) -> Vec<Samples> {
    let mut noise = Noise::new(seed);
    let phases = [noise.uniform(), noise.uniform()].map(|turn| turn * std::f64::consts::TAU);
    let mut sample = |seq: u64| {
        let t = seq as f64 / RATE_HZ;
        let clean = microstrain(t);
        [0, 1].map(|axis| {
            let hum = 0.5 * HUM * (std::f64::consts::TAU * mains_hz * t + phases[axis]).sin();
            let counts = COUNTS_PER_MICROSTRAIN * (clean[axis] + hum + NOISE * noise.normal());
            #[expect(clippy::cast_possible_truncation, reason = "far below 2^23")]
            Counts(counts.round() as i32)
        })
    };
    (0..whole(seconds * RATE_HZ) as u64 / 8)
        .map(|block| Samples {
            first: 8 * block,
            missing_before: 0,
            time_us: 2000 * block,
            period_us: 250.0,
            status: Status::default(),
            counts: (0..8).map(|index| sample(8 * block + index)).collect(),
        })
        .collect()
}

fn samples_of(block: &Samples) -> Vec<RawSample> {
    (block.first..).zip(&block.counts).map(|(seq, &counts)| RawSample { seq, t_us: 250 * seq, counts }).collect()
}

fn watch(blocks: &[Samples], settings: DwellSettings, expected: Expected) -> DwellVerdict {
    let mut watcher = Watcher::new(settings, expected);
    let mut verdict = DwellVerdict::NeedsMoreTime(None);
    for block in blocks {
        verdict = watcher.push(block);
        if !matches!(verdict, DwellVerdict::NeedsMoreTime(_)) {
            break;
        }
    }
    verdict
}

/// The dwell, without printing thousands of samples if it was another verdict.
fn accepted(blocks: &[Samples], settings: DwellSettings, expected: Expected) -> Dwell {
    match watch(blocks, settings, expected) {
        DwellVerdict::Accepted(dwell) => dwell,
        DwellVerdict::Refused(refusal) | DwellVerdict::NeedsMoreTime(Some(refusal)) => {
            panic!("not accepted: {refusal}")
        }
        DwellVerdict::NeedsMoreTime(None) => panic!("not decided"),
    }
}

fn refused(blocks: &[Samples], settings: DwellSettings, expected: Expected) -> Refusal {
    match watch(blocks, settings, expected) {
        DwellVerdict::Accepted(dwell) => panic!("accepted after {} s: {:?}", dwell.waited_s, dwell.reading),
        DwellVerdict::Refused(refusal) => refusal,
        DwellVerdict::NeedsMoreTime(reason) => panic!("not decided: {reason:?}"),
    }
}

const LOADED: Expected = Expected::Load { tare: Vector2::new(0.0, 0.0) };

fn short_of_patience() -> DwellSettings {
    DwellSettings { patience_s: 3.0, ..settings() }
}

#[test]
fn a_contact_at_rest_is_accepted_after_one_second_with_an_honest_covariance() {
    let truth = [80.0, -50.0];
    let mut sum = 0.0;
    let dwells = 150;
    for seed in 0..dwells {
        let dwell = accepted(&stream(seed, 50.0, 1.0, |_| truth), settings(), LOADED);
        let error = dwell.reading.counts - Vector2::from(truth) * COUNTS_PER_MICROSTRAIN;
        sum += error.dot(&(dwell.reading.covariance.try_inverse().unwrap() * error)) / 2.0;
        assert_eq!(dwell.samples.len(), 4000);
        assert!((dwell.noise_microstrain[0] - NOISE.hypot(0.5 * HUM / f64::sqrt(2.0))).abs() < 0.03);
    }
    let got = sum / dwells as f64;
    // Its own scatter over 150 dwells of two components is 0.08; 49 degrees of freedom in each covariance add 5 %.
    assert!((0.75..1.3).contains(&got), "mean normalised squared error {got}, wanted 1");
}

#[test]
fn hum_cancels_at_60_hertz_too() {
    let settings = DwellSettings { mains_hz: 60.0, ..settings() };
    let variance =
        |seed| accepted(&stream(seed, 60.0, 1.0, |_| [80.0, -50.0]), settings, LOADED).reading.covariance.trace() / 2.0;
    let mean_variance = (0..20).map(variance).sum::<f64>() / 20.0;
    // Noise alone: 0.48 microstrain over √4000. Twenty dwells of twenty blocks and two axes know it to 5 %.
    let sigma = mean_variance.sqrt() / COUNTS_PER_MICROSTRAIN;
    assert!((sigma / 0.00759 - 1.0).abs() < 0.15, "got {sigma} microstrain, wanted 0.0076");
}

#[test]
fn ring_down_is_waited_for() {
    let ringing = |t: f64| [80.0 + 30.0 * (-t / 0.2).exp() * (std::f64::consts::TAU * 3.0 * t).sin(), -50.0];
    let dwell = accepted(&stream(4, 50.0, 10.0, ringing), settings(), LOADED);
    assert!(dwell.waited_s > 1.5, "accepted after {} s, still ringing", dwell.waited_s);
    let error = (dwell.reading.counts.x / COUNTS_PER_MICROSTRAIN - 80.0).abs();
    assert!(error < 0.1, "mean off by {error} microstrain");
}

#[test]
fn a_drifting_tare_is_refused_with_its_size() {
    let refusal = refused(&stream(5, 50.0, 4.0, |t| [0.8 * t, 0.0]), short_of_patience(), Expected::Nothing);
    let Refusal::Drifts { change: DwellChange::Tare { microstrain }, .. } = refusal else { panic!("{refusal}") };
    assert!((microstrain - 0.4).abs() < 0.1, "halves are 0.4 microstrain apart, got {microstrain}");
}

#[test]
fn a_slowly_turning_contact_is_refused_in_degrees() {
    let turning = |t: f64| [95.0 * (0.02 * t).cos(), 95.0 * (0.02 * t).sin()];
    let refusal = refused(&stream(6, 50.0, 4.0, turning), short_of_patience(), LOADED);
    let Refusal::Drifts { change: DwellChange::Contact { turn_deg, .. }, .. } = refusal else { panic!("{refusal}") };
    assert!((turn_deg - 0.573).abs() < 0.05, "0.01 rad in half a second, got {turn_deg}°");
}

#[test]
fn a_slip_is_told_from_a_drift() {
    let slip = |t: f64| if t < 0.4 || t.fract() < 0.5 { [95.0, 0.0] } else { [95.0, 1.0] };
    let blocks = stream(7, 50.0, 1.01, slip);
    let samples: Vec<RawSample> = blocks.iter().flat_map(samples_of).collect();
    let refusal = measure(&samples, &settings(), LOADED).unwrap_err();
    let Refusal::Stepped { at_s, .. } = refusal else { panic!("{refusal}") };
    assert!((at_s - 0.5).abs() < 0.05, "{at_s}");
}

#[test]
fn a_swinging_weight_is_refused() {
    let swing = |t: f64| [95.0, 1.5 * (std::f64::consts::TAU * 2.0 * t).sin()];
    let refusal = refused(&stream(8, 50.0, 4.0, swing), short_of_patience(), LOADED);
    assert!(matches!(refusal, Refusal::Swings { .. } | Refusal::Drifts { .. }), "{refusal}");
}

#[test]
fn a_load_that_falls_off_is_noticed() {
    let falls = |t: f64| if t < 0.7 { [95.0, 0.0] } else { [0.2, 0.0] };
    let refusal = refused(&stream(9, 50.0, 4.0, falls), settings(), LOADED);
    assert!(matches!(refusal, Refusal::LoadRemoved { .. }), "{refusal}");
}

#[test]
fn no_load_and_too_little_load_are_different_refusals() {
    let nothing = refused(&stream(10, 50.0, 4.0, |_| [0.1, 0.0]), short_of_patience(), LOADED);
    assert!(matches!(nothing, Refusal::NoLoad { .. }), "{nothing}");
    let little = refused(&stream(11, 50.0, 4.0, |_| [3.0, 0.0]), short_of_patience(), LOADED);
    assert!(matches!(little, Refusal::TooWeak { factor, .. } if factor > 1.0), "{little}");
}

#[test]
fn a_saturated_a_stuck_and_a_restarted_device_are_refused() {
    let mut saturated = stream(12, 50.0, 2.0, |_| [95.0, 0.0]);
    saturated.iter_mut().for_each(|block| block.counts.iter_mut().for_each(|counts| counts[1] = Counts::MAX));
    let refusal = refused(&saturated, settings(), LOADED);
    assert!(matches!(refusal, Refusal::Saturated { bridge: 'y', .. }), "{refusal}");
    let mut stuck = stream(13, 50.0, 2.0, |_| [95.0, 0.0]);
    stuck.iter_mut().skip(100).for_each(|block| block.counts.iter_mut().for_each(|counts| counts[0] = Counts(7)));
    let refusal = refused(&stuck, settings(), LOADED);
    assert!(matches!(refusal, Refusal::Stuck { bridge: 'x', code: 7, .. }), "{refusal}");
    let mut restarted = stream(14, 50.0, 2.0, |_| [95.0, 0.0]);
    restarted.iter_mut().skip(100).for_each(|block| block.first -= 800);
    let refusal = refused(&restarted, settings(), LOADED);
    assert!(matches!(refusal, Refusal::Restarted { .. }), "{refusal}");
}

#[test]
fn a_gap_starts_the_window_anew_and_endless_gaps_are_counted() {
    let mut one_gap = stream(15, 50.0, 3.0, |_| [95.0, 0.0]);
    one_gap.remove(200);
    let dwell = accepted(&one_gap, settings(), LOADED);
    assert_eq!((dwell.lost, dwell.samples[0].seq), (8, 8 * 201));
    let mut many = stream(16, 50.0, 5.0, |_| [95.0, 0.0]);
    let mut index = 0;
    many.retain(|_| {
        index += 1;
        index % 100 != 0
    });
    let refusal = refused(&many, short_of_patience(), LOADED);
    assert!(matches!(refusal, Refusal::LostSamples { lost, .. } if lost > 0 && lost % 8 == 0), "{refusal}");
}

#[test]
fn a_wrong_rate_is_refused() {
    let mut slow = stream(17, 50.0, 1.0, |_| [95.0, 0.0]);
    slow.iter_mut().for_each(|block| block.period_us = 500.0);
    assert!(matches!(refused(&slow, settings(), LOADED), Refusal::WrongRate { .. }));
}

#[test]
fn settings_that_cannot_work_are_refused() {
    assert!(settings().check().is_ok());
    assert!(DwellSettings { duration_s: 0.16, ..settings() }.check().is_ok());
    assert!(matches!(
        DwellSettings { duration_s: 0.1, ..settings() }.check(),
        Err(DwellSettingsError::TooShort { .. })
    ));
    assert!(DwellSettings { mains_hz: f64::NAN, ..settings() }.check().is_err());
    assert!(DwellSettings { rate_hz: 80.0, ..settings() }.check().is_err());
    assert!(DwellSettings { patience_s: 0.5, ..settings() }.check().is_err());
    assert!(DwellSettings { duration_s: 1e5, patience_s: 2e5, ..settings() }.check().is_err());
}

#[test]
fn what_was_accepted_measures_the_same_again() {
    let dwell = accepted(&stream(19, 50.0, 2.0, |_| [95.0, 10.0]), settings(), LOADED);
    assert_eq!(measure(&dwell.samples, &settings(), LOADED).unwrap().reading, dwell.reading);
}
