//! The whole device: what a host reads against what the world holds true.

use core::cell::RefCell;
use std::vec::Vec;

use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::spi::{Operation, SpiDevice};
use proptest::prelude::*;

use super::*;
use crate::sim::ads131m::registers::{CLOCK, GAIN1};
use crate::sim::{ContactLoad, DataReadyPin, MICROSTRAIN, PortBusy, SpiPort, SyncResetPin};

/// Bytes in a frame of four 24-bit words.
const FRAME: usize = 12;
/// Conversions in a second at the rate after a reset.
const SECOND: usize = 4000;

/// One NULL frame on the bus.
fn frame(front_end: &mut SimulatedFrontEnd) -> [u8; FRAME] {
    front_end.select();
    let bytes = [0; FRAME].map(|byte: u8| front_end.exchange(byte));
    front_end.deselect();
    bytes
}

/// Writes a register.
fn write(front_end: &mut SimulatedFrontEnd, address: u8, value: u16) {
    let [c0, c1] = (0x6000 | u16::from(address) << 7).to_be_bytes();
    let [v0, v1] = value.to_be_bytes();
    front_end.select();
    for byte in [c0, c1, 0, v0, v1, 0, 0, 0, 0, 0, 0, 0] {
        front_end.exchange(byte);
    }
    front_end.deselect();
}

/// Both codes in a frame.
fn codes(frame: [u8; FRAME]) -> [i32; 2] {
    [3, 6].map(|at| i32::from_be_bytes([frame[at], frame[at + 1], frame[at + 2], 0]) >> 8)
}

/// One conversion and its codes.
fn sample(front_end: &mut SimulatedFrontEnd) -> [i32; 2] {
    front_end.step();
    codes(frame(front_end))
}

/// A front-end at gain 32 with its filter settled.
fn at_gain_32(config: FingerConfig, seed: u64) -> SimulatedFrontEnd {
    let mut front_end = SimulatedFrontEnd::new(config, seed);
    write(&mut front_end, GAIN1, 0x0055);
    (0..3).for_each(|_| {
        sample(&mut front_end);
    });
    front_end
}

/// Strains that codes at gain 32 stand for.
fn strains(codes: [i32; 2], config: &FingerConfig) -> [f32; 2] {
    codes.map(|code| code as f32 * config.bridges.strain_per_count(32))
}

/// Both strains over a number of conversions.
fn record(front_end: &mut SimulatedFrontEnd, config: &FingerConfig, n: usize) -> Vec<[f32; 2]> {
    (0..n).map(|_| strains(sample(front_end), config)).collect()
}

proptest! {
    #[test]
    fn an_ideal_finger_reads_the_strain_and_the_angle_of_the_truth(angle in -3.1f32..3.1, force in 0.5f32..5.0) {
        let config = FingerConfig::ideal();
        let mut front_end = at_gain_32(config, 1);
        front_end.set_load(Load::Static(ContactLoad::frictionless(angle, force)));
        let [x, y] = *record(&mut front_end, &config, 3).last().unwrap();
        let truth = front_end.truth();
        prop_assert_eq!(truth.contact_angle, Some(angle));
        // One count is 0.0018 microstrain, and 7e-5 rad of 24 microstrain.
        prop_assert!((x - truth.strain[0]).abs() < 2e-3 * MICROSTRAIN);
        prop_assert!((y - truth.strain[1]).abs() < 2e-3 * MICROSTRAIN);
        prop_assert!(((-y).atan2(-x) - angle).abs() < 1e-4);
        prop_assert!((truth.force_finger[0].hypot(truth.force_finger[1]) - force).abs() < 1e-5);
    }

    #[test]
    fn the_same_seed_gives_the_same_bytes(seed: u64) {
        let run = || {
            let mut front_end = SimulatedFrontEnd::new(FingerConfig::default(), seed);
            front_end.set_faults(Faults { bit_error_rate: 1e-2, ..Faults::default() });
            front_end.set_load(Load::Force([1.0, -2.0]));
            (0..50).map(|_| { front_end.step(); frame(&mut front_end) }).collect::<Vec<_>>()
        };
        prop_assert_eq!(run(), run());
    }
}

#[test]
fn seeds_differ() {
    let first = |seed| {
        (0..10)
            .map({
                let mut front_end = at_gain_32(FingerConfig::default(), seed);
                move |_| sample(&mut front_end)
            })
            .collect::<Vec<_>>()
    };
    assert_ne!(first(1), first(2));
}

#[test]
fn the_default_finger_in_the_default_world_feels_2_newtons_as_configured() {
    let config = FingerConfig::default();
    let mut front_end = at_gain_32(config, 1);
    let rest = mean(&record(&mut front_end, &config, SECOND));
    front_end.set_load(Load::Force([2.0, 0.0]));
    record(&mut front_end, &config, SECOND); // the ringing dies down by e⁻²³
    let pressed = mean(&record(&mut front_end, &config, SECOND));
    // By hand: 95.49 µε · 1.03 · (cos 1.5° + 0.02 cos 89°), and · 0.98 · (cos 89° − 0.015 cos 1.5°) on the other axis.
    let expected = [98.36 * MICROSTRAIN, 0.26 * MICROSTRAIN];
    for axis in 0..2 {
        // Noise 0.48 µε over √4000 and colour 1.35 is 0.010; drift in 2 s below 0.003; sensitivity ±300 ppm 0.03.
        assert!((pressed[axis] - rest[axis] - expected[axis]).abs() < 0.1 * MICROSTRAIN, "{pressed:?} {rest:?}");
    }
    // The offset itself: 180 and −120 µε, ±1 K of 0.5 µε/K.
    assert!((rest[0] - 180.0 * MICROSTRAIN).abs() < 0.6 * MICROSTRAIN);
    assert!((rest[1] + 120.0 * MICROSTRAIN).abs() < 0.6 * MICROSTRAIN);
}

/// Means of both axes.
fn mean(record: &[[f32; 2]]) -> [f32; 2] {
    // Differences from the first are small, so that their sum keeps its digits.
    [0, 1].map(|axis| {
        let first = record[0][axis];
        first + record.iter().map(|s| s[axis] - first).sum::<f32>() / record.len() as f32
    })
}

/// Frequency of a wave of both axes' x, from its rising zeros, in cycles per sample; and how well it is known.
fn frequency(wave: &[[f32; 2]]) -> (f32, f32) {
    let zeros: Vec<usize> = (1..wave.len()).filter(|&i| wave[i - 1][0] < 0.0 && wave[i][0] >= 0.0).collect();
    let samples = (zeros[zeros.len() - 1] - zeros[0]) as f32;
    // Both ends are known to one sample.
    ((zeros.len() - 1) as f32 / samples, 2.0 / samples)
}

/// Frequency at which the default finger rings, in hertz.
fn damped_hz(config: &FingerConfig) -> f32 {
    config.beam.angular_frequency() / core::f32::consts::TAU * (1.0f32 - 0.02 * 0.02).sqrt()
}

#[test]
fn ringing_and_hum_keep_their_frequency_when_the_rate_changes() {
    let mut config = FingerConfig::ideal();
    config.beam.resonance = true;
    let mut front_end = at_gain_32(config, 1);
    write(&mut front_end, CLOCK, 0x0312); // OSR 2048: 2 kSPS
    front_end.set_load(Load::Force([2.0, 0.0]));
    record(&mut front_end, &config, SECOND);
    front_end.set_load(Load::Released);
    let (cycles_per_sample, error) = frequency(&record(&mut front_end, &config, 200));
    assert!((cycles_per_sample * 2000.0 / damped_hz(&config) - 1.0).abs() < error);

    let mut config = FingerConfig::ideal();
    config.bridges.hum_peak_to_peak = MICROSTRAIN;
    let mut front_end = at_gain_32(config, 1);
    write(&mut front_end, CLOCK, 0x0312);
    record(&mut front_end, &config, 3);
    let [x, _] = mean(&record(&mut front_end, &config, 40)); // one mains period
    assert!(x.abs() < 1e-3 * MICROSTRAIN, "{x}");
}

#[test]
fn the_finger_rings_at_its_resonance_when_it_is_let_go() {
    let mut config = FingerConfig::ideal();
    config.beam.resonance = true;
    let mut front_end = at_gain_32(config, 1);
    front_end.set_load(Load::Force([2.0, 0.0]));
    record(&mut front_end, &config, 2 * SECOND);
    front_end.set_load(Load::Released);
    let wave = record(&mut front_end, &config, 400);
    let (cycles_per_sample, error) = frequency(&wave);
    let hertz = cycles_per_sample * SECOND as f32;
    assert!((hertz / damped_hz(&config) - 1.0).abs() < error, "{hertz} Hz");
    // Damping ratio 0.02 loses a factor e^(−2π·0.02) a cycle: what is left of the swing after 15 cycles is 0.152.
    let swing = |range: core::ops::Range<usize>| wave[range].iter().fold(0.0f32, |m, s| m.max(s[0].abs()));
    // A cycle is 21.45 samples.
    let left = swing(343..364) / swing(21..42);
    // The crest falls between samples: 21 to a cycle miss by up to 1 − cos(π/21) = 0.011 of it.
    assert!((left - 0.152).abs() < 0.005, "{left}");
}

#[test]
fn hum_reads_one_microstrain_peak_to_peak_and_cancels_over_80_samples() {
    let mut config = FingerConfig::ideal();
    config.bridges = BridgesConfig {
        hum_peak_to_peak: MICROSTRAIN,
        bridges: [0, 1].map(|i| crate::sim::BridgeConfig {
            hum_phase: BridgesConfig::default().bridges[i].hum_phase,
            ..config.bridges.bridges[i]
        }),
        ..config.bridges
    };
    let wave = record(&mut at_gain_32(config, 1), &config, 80);
    let [x, y] = mean(&wave);
    assert!(x.abs() < 1e-3 * MICROSTRAIN && y.abs() < 1e-3 * MICROSTRAIN); // half a count
    let peak_to_peak = |axis: usize| {
        let (low, high) = wave.iter().fold((0.0f32, 0.0f32), |(l, h), s| (l.min(s[axis]), h.max(s[axis])));
        high - low
    };
    for axis in 0..2 {
        // Two counts, 8e-4 for the missed crest and 1e-3 that the filter takes at 50 Hz.
        assert!((peak_to_peak(axis) / MICROSTRAIN - 1.0).abs() < 0.006, "{}", peak_to_peak(axis));
    }
    assert!((0..80).any(|i| (wave[i][0] - wave[i][1]).abs() > 0.5 * MICROSTRAIN), "the phases differ");
}

#[test]
fn temperature_drift_shows_in_the_codes_and_in_the_truth() {
    let mut config = FingerConfig::ideal();
    config.thermal.swing_k = 1.0;
    config.bridges.bridges[0].offset_per_kelvin = 0.5 * MICROSTRAIN;
    let mut front_end = at_gain_32(config, 4);
    write(&mut front_end, CLOCK, 0x031E); // 252 SPS: half an hour in 450 000 conversions
    let mut span = (f32::MAX, f32::MIN);
    for n in 0..450_000 {
        let [x, _] = strains(sample(&mut front_end), &config);
        let kelvin = front_end.truth().temperature_c - config.thermal.reference_c;
        span = (span.0.min(kelvin), span.1.max(kelvin));
        // A count of 0.0018 µε, and the filter's two conversions of delay.
        assert!(n < 3 || (x - 0.5 * MICROSTRAIN * kelvin).abs() < 4e-3 * MICROSTRAIN);
    }
    assert!(span.1 - span.0 > 0.5, "the temperature moved by {} K", span.1 - span.0);
}

#[test]
fn switching_one_source_of_noise_leaves_the_others_as_they_were() {
    let run = |change: fn(&mut FingerConfig), faults: Faults| {
        let mut config = FingerConfig::default();
        change(&mut config);
        let mut front_end = at_gain_32(config, 9);
        front_end.set_faults(faults);
        (0..100).map(|_| sample(&mut front_end)).collect::<Vec<_>>()
    };
    let plain = run(|_| (), Faults::default());
    let quiet = run(|config| config.converter_noise = 0.0, Faults::default());
    let no_hum = run(|config| config.bridges.hum_peak_to_peak = 0.0, Faults::default());
    let quiet_no_hum = run(
        |config| {
            config.converter_noise = 0.0;
            config.bridges.hum_peak_to_peak = 0.0;
        },
        Faults::default(),
    );
    for i in 0..100 {
        // Noise is the same with and without hum, up to the rounding of two codes.
        let with_hum = plain[i][0] - quiet[i][0];
        assert!((with_hum - (no_hum[i][0] - quiet_no_hum[i][0])).abs() <= 2);
    }
    let open = run(|_| (), Faults { open_gauge: [true, false], ..Faults::default() });
    assert!(open.iter().zip(&plain).all(|(open, plain)| open[1] == plain[1]));
}

// Faults

#[test]
fn without_a_chip_the_bus_floats_and_drdy_never_falls() {
    for (floating, byte) in [(FloatingBus::High, 0xFF), (FloatingBus::Low, 0x00)] {
        let mut front_end = at_gain_32(FingerConfig::default(), 1);
        front_end.set_faults(Faults { chip_absent: Some(floating), ..Faults::default() });
        assert!(!front_end.step() && !front_end.is_data_ready());
        assert_eq!(frame(&mut front_end), [byte; FRAME]);
        front_end.set_faults(Faults::default());
        assert!(front_end.step(), "it can be plugged in again");
        assert_eq!(frame(&mut front_end)[..2], [0xFF, 0x22], "and has been powered up anew");
        assert_eq!(front_end.chip().gain(0), 1);
    }
}

#[test]
fn a_stuck_drdy_hides_conversions_that_can_still_be_read() {
    let mut front_end = at_gain_32(FingerConfig::default(), 1);
    let before = sample(&mut front_end);
    front_end.set_faults(Faults { data_ready_stuck: true, ..Faults::default() });
    assert!(!front_end.step() && !front_end.is_data_ready());
    assert_ne!(codes(frame(&mut front_end)), before);
}

#[test]
fn an_open_gauge_saturates_its_own_channel_only() {
    let mut front_end = at_gain_32(FingerConfig::default(), 1);
    front_end.set_faults(Faults { open_gauge: [false, true], ..Faults::default() });
    let record: Vec<[i32; 2]> = (0..100).map(|_| sample(&mut front_end)).collect();
    assert!(record[3..].iter().all(|codes| codes[1] == 0x7F_FFFF && codes[0].abs() < 0x10_0000));
}

#[test]
fn saturation_can_be_forced_or_pressed() {
    let config = FingerConfig::ideal();
    let mut front_end = at_gain_32(config, 1);
    front_end.set_faults(Faults { saturated: [true, false], ..Faults::default() });
    (0..3).for_each(|_| {
        sample(&mut front_end);
    });
    assert_eq!(sample(&mut front_end), [0x7F_FFFF, 0]);
    front_end.set_faults(Faults::default());
    front_end.set_load(Load::Force([-400.0, 0.0])); // full scale at gain 32 is 15 000 µε: 314 N
    (0..3).for_each(|_| {
        sample(&mut front_end);
    });
    assert_eq!(sample(&mut front_end)[0], -0x80_0000);
}

#[test]
fn stuck_codes_repeat_while_drdy_goes_on() {
    let mut front_end = at_gain_32(FingerConfig::default(), 1);
    let before = sample(&mut front_end);
    front_end.set_faults(Faults { stuck_codes: true, ..Faults::default() });
    for _ in 0..10 {
        assert!(front_end.step());
        assert_eq!(codes(frame(&mut front_end)), before);
    }
}

#[test]
fn drift_grows_while_it_lasts_and_is_gone_when_mended() {
    let config = FingerConfig::ideal();
    let mut front_end = at_gain_32(config, 1);
    record(&mut front_end, &config, 10);
    front_end.set_faults(Faults { drift_per_s: 5.0 * MICROSTRAIN, ..Faults::default() });
    let [x, y] = *record(&mut front_end, &config, 2 * SECOND).last().unwrap();
    for strain in [x, y] {
        // Less what the filter is behind, half a conversion or so, and two codes.
        assert!((strain / MICROSTRAIN - 10.0).abs() < 0.01, "{strain}");
    }
    front_end.set_faults(Faults::default());
    let [x, y] = *record(&mut front_end, &config, 10).last().unwrap();
    assert!(x.abs() < 0.01 * MICROSTRAIN && y.abs() < 0.01 * MICROSTRAIN, "{x} {y}");
}

#[test]
fn hum_can_be_added_to_the_fingers_own() {
    let config = FingerConfig::ideal();
    let mut front_end = at_gain_32(config, 1);
    record(&mut front_end, &config, 10);
    front_end.set_faults(Faults { hum_peak_to_peak: 20.0 * MICROSTRAIN, ..Faults::default() });
    record(&mut front_end, &config, 10);
    let wave = record(&mut front_end, &config, 80);
    let (low, high) = wave.iter().fold((0.0_f32, 0.0_f32), |(low, high), s| (low.min(s[0]), high.max(s[0])));
    // The crest between two samples and the filter take some thousandths.
    assert!(((high - low) / MICROSTRAIN - 20.0).abs() < 0.1, "{}", high - low);
}

#[test]
fn bits_are_inverted_at_the_rate_asked_for() {
    for rate in [1e-4f32, 1e-2, 0.3] {
        let mut bus = BitErrors::new(5);
        bus.set_rate(rate);
        let bits = 8.0 * 200_000.0;
        let errors: u32 = (0..200_000).map(|_| bus.pass(0x5A) ^ 0x5A).map(u8::count_ones).sum();
        let (expected, p) = (bits * f64::from(rate), f64::from(rate));
        // Five standard deviations of the binomial distribution.
        assert!((f64::from(errors) - expected).abs() < 5.0 * (expected * (1.0 - p)).sqrt(), "{errors} for {expected}");
    }
}

#[test]
fn bit_errors_hit_every_bit_and_their_ends_are_exact() {
    let count = |rate| {
        let mut bus = BitErrors::new(5);
        bus.set_rate(rate);
        (0..4000).fold([0u32; 8], |mut by_bit, _| {
            let flipped = bus.pass(0);
            (0..8).for_each(|bit| by_bit[bit] += u32::from(flipped >> bit & 1));
            by_bit
        })
    };
    assert_eq!(count(0.0), [0; 8]);
    assert_eq!(count(1.0), [4000; 8]);
    // 400 expected of 4000; five standard deviations are 95.
    assert!(count(0.1).iter().all(|&n| n.abs_diff(400) < 95), "{:?}", count(0.1));
}

#[test]
fn bit_errors_reach_the_chip_too() {
    let mut front_end = at_gain_32(FingerConfig::default(), 1);
    front_end.set_faults(Faults { bit_error_rate: 1.0, ..Faults::default() });
    // Every bit is inverted, so the complement of WREG GAIN1 = 0x0011 is understood.
    front_end.select();
    for byte in [!0x62, !0x00, !0, !0x00, !0x11, !0] {
        front_end.exchange(byte);
    }
    front_end.deselect();
    assert_eq!(front_end.chip().gain(0), 2);
}

#[test]
fn bit_errors_spoil_frames_in_both_directions() {
    let mut front_end = at_gain_32(FingerConfig::default(), 1);
    front_end.set_faults(Faults { bit_error_rate: 0.02, ..Faults::default() });
    let oracle = crc::Crc::<u16>::new(&crc::CRC_16_IBM_3740);
    let bad = (0..200)
        .filter(|_| {
            front_end.step();
            let bytes = frame(&mut front_end);
            oracle.checksum(&bytes[..9]).to_be_bytes() != bytes[9..11]
        })
        .count();
    // A frame of 96 bits is sound with probability 0.98⁹⁶ = 0.14.
    assert!(bad > 100, "{bad}");
}

// Pins and port

#[test]
fn the_rate_follows_the_chip() {
    let mut front_end = SimulatedFrontEnd::new(FingerConfig::default(), 1);
    assert_eq!(front_end.period_ns(), 250_000);
    front_end.step();
    write(&mut front_end, CLOCK, 0x0312); // OSR 2048
    front_end.step();
    assert_eq!(front_end.truth().time_ns, 750_000);
}

#[test]
fn sync_reset_synchronises_when_short_and_resets_when_long() {
    let front_end = RefCell::new(at_gain_32(FingerConfig::ideal(), 1));
    let mut pin = SyncResetPin::new(&front_end);
    pin.set_low().unwrap();
    pin.set_high().unwrap();
    assert_eq!(front_end.borrow().chip().gain(0), 32);
    pin.set_low().unwrap();
    front_end.borrow_mut().step(); // 250 µs: 2048 clocks
    pin.set_high().unwrap();
    assert_eq!(front_end.borrow().chip().gain(0), 1);
}

#[test]
fn a_transaction_is_one_frame_however_it_is_divided() {
    let front_end = RefCell::new(at_gain_32(FingerConfig::default(), 1));
    front_end.borrow_mut().step();
    let mut twin = front_end.borrow().clone();
    let (mut head, mut middle, mut tail) = ([0; 2], [0; 4], [0; 5]);
    SpiPort::new(&front_end)
        .transaction(&mut [
            Operation::Transfer(&mut head, &[0]),
            Operation::Write(&[0]),
            Operation::DelayNs(100),
            Operation::TransferInPlace(&mut middle),
            Operation::Read(&mut tail),
        ])
        .unwrap();
    let whole = frame(&mut twin);
    assert_eq!((&head[..], &middle[..], &tail[..]), (&whole[..2], &whole[3..7], &whole[7..]));
    assert_eq!(*front_end.borrow(), twin);
}

#[test]
fn a_borrowed_front_end_makes_its_handles_busy() {
    let front_end = RefCell::new(SimulatedFrontEnd::new(FingerConfig::default(), 1));
    let borrowed = front_end.borrow_mut();
    assert_eq!(SpiPort::new(&front_end).write(&[0]), Err(PortBusy));
    assert_eq!(DataReadyPin::new(&front_end).is_low(), Err(PortBusy));
    assert_eq!(SyncResetPin::new(&front_end).set_low(), Err(PortBusy));
    drop(borrowed);
}

#[test]
fn drdy_is_low_while_data_wait() {
    let front_end = RefCell::new(at_gain_32(FingerConfig::default(), 1));
    let mut pin = DataReadyPin::new(&front_end);
    assert!(pin.is_high().unwrap());
    front_end.borrow_mut().step();
    assert!(pin.is_low().unwrap());
}

#[test]
fn four_channels_have_excitation_and_ntc_on_the_upper_two() {
    let config = FingerConfig { channels: Channels::Four, ..FingerConfig::ideal() };
    let mut front_end = SimulatedFrontEnd::new(config, 1);
    front_end.set_load(Load::Force([1.0, 0.0]));
    let mut read = |excitation_change| {
        front_end.set_faults(Faults { excitation_change, ..Faults::default() });
        let mut bytes = [0; 18];
        for _ in 0..4 {
            front_end.step();
            front_end.select();
            bytes = [0; 18].map(|byte: u8| front_end.exchange(byte));
            front_end.deselect();
        }
        [3, 6, 9, 12].map(|at| f64::from(i32::from_be_bytes([bytes[at], bytes[at + 1], bytes[at + 2], 0]) >> 8))
    };
    let before = read(0.0);
    // 0.4 of 2.5 V. At the mean of 23 °C the NTC has 10 kΩ · exp(3950 K · (1/296.15 K − 1/298.15 K)) = 10.936 kΩ,
    // which is 0.21900 of the whole, 0.54750 V.
    let volts = |code: f64| code * 1.2 / 8_388_608.0;
    assert!((volts(before[2]) - 1.0).abs() < 1e-6, "{}", volts(before[2]));
    assert!((volts(before[3]) - 0.547_50).abs() < 2e-5, "{}", volts(before[3]));
    // The excitation sinks by 1 %: all follow, and what they say together does not.
    let after = read(-0.01);
    assert!((after[2] / before[2] - 0.99).abs() < 1e-6);
    for channel in [0, 3] {
        let (was, is) = (before[channel] / before[2], after[channel] / after[2]);
        // The bridge has 850 codes at gain 1: half a code each time is one in a thousand.
        assert!((is / was - 1.0).abs() < 1.2e-3, "channel {channel}: {was} and {is}");
    }
}
