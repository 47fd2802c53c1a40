//! The slow channels of a front-end that has them: excitation and NTC, as means, whatever else goes on.

mod rig;

use palpate_shared::front_ends::FrontEndKind;
use palpate_shared::sim::{Faults, FingerConfig};
use palpate_shared::wire::{FromDevice, Outcome, Request, SLOW_CONVERSIONS, SlowChannels, Source, Status};
use rig::{Bench, Rig, World};

/// What was heard of them.
fn slow(rig: &Rig<'_>) -> Vec<SlowChannels> {
    let heard = rig.heard.messages.iter();
    heard.filter_map(|message| if let FromDevice::SlowChannels(slow) = message { Some(*slow) } else { None }).collect()
}

#[test]
fn the_hello_names_the_chip() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.run_us(5000);
    let Outcome::Hello(hello) = rig.ask(Request::Hello) else { panic!("a hello") };
    assert_eq!((hello.front_end.kind, hello.front_end.id_word >> 8), (FrontEndKind::Ads131m04, 0x24));
}

#[test]
fn means_of_256_conversions_come_streaming_or_not() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    // One in which the chip is found, three that settle.
    rig.run(5 + 2 * u32::from(SLOW_CONVERSIONS));
    assert_eq!(slow(&rig).len(), 2);
    assert_eq!(rig.ask(Request::Start), Outcome::Done);
    rig.run(4 * u32::from(SLOW_CONVERSIONS));
    let all = slow(&rig);
    assert_eq!(all.len(), 6);
    let facts = FrontEndKind::Ads131m04.facts();
    for pair in all.windows(2) {
        assert_eq!(pair[1].time.since(pair[0].time), u32::from(SLOW_CONVERSIONS) * 250);
    }
    for slow in all {
        assert_eq!(slow.status, Status::default());
        let volts = facts.excitation_v(slow.excitation).expect("it has slow channels");
        assert!((volts - 2.5).abs() < 1e-5, "{volts} V");
        // At 23 °C, by hand: 10 kΩ · exp(3950 · (1/296.15 − 1/298.15)) = 10,935.9 Ω.
        let ohm = facts.ntc_ohm([slow.excitation, slow.ntc]).expect("an NTC");
        assert!((ohm - 10_935.9).abs() < 0.5, "{ohm} Ω");
    }
    assert_eq!((rig.wrong_samples(), rig.heard.gaps()), (0, 0));
}

#[test]
fn a_changed_excitation_shows_within_one_mean_and_the_ntc_does_not_change_with_it() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.run(300);
    rig.set_faults(Faults { excitation_change: -0.01, ..Faults::default() });
    rig.run(2 * u32::from(SLOW_CONVERSIONS));
    let facts = FrontEndKind::Ads131m04.facts();
    let (first, last) = (slow(&rig)[0], *slow(&rig).last().expect("three came"));
    let ratio = f64::from(last.excitation.0) / f64::from(first.excitation.0);
    assert!((ratio - 0.99).abs() < 1e-6, "{ratio}");
    let ohm = |slow: SlowChannels| facts.ntc_ohm([slow.excitation, slow.ntc]).expect("an NTC");
    assert!((ohm(first) - ohm(last)).abs() < 0.1, "{} and {} Ω", ohm(first), ohm(last));
}

#[test]
fn a_damaged_bus_adds_no_wrong_code_to_a_mean() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.set_faults(Faults { bit_error_rate: 3e-4, ..Faults::default() });
    rig.start_streaming();
    rig.run(20_000);
    let all = slow(&rig);
    assert!(all.len() > 20, "{} means", all.len());
    for slow in all {
        let volts = FrontEndKind::Ads131m04.facts().excitation_v(slow.excitation).expect("it has slow channels");
        assert!((volts - 2.5).abs() < 1e-5, "{volts} V");
    }
    let Outcome::Counters(counters) = rig.ask(Request::Counters) else { panic!("counters") };
    assert!(counters.samples_damaged > 100, "{counters:?}");
}

#[test]
fn simulated_ones_say_so_and_begin_anew_with_the_source() {
    let mut world = World::new(FingerConfig::ideal(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.run(200);
    assert_eq!(rig.ask(Request::SetSource { source: Source::Simulated }), Outcome::Done);
    rig.run(300);
    let all = slow(&rig);
    assert_eq!(all.iter().map(|slow| slow.status).collect::<Vec<_>>(), [Status::SIMULATED]);
}
