//! Nothing is lost without being counted, whatever happens, at every moment.

mod rig;

use palpate_firmware_core::queues::READINGS;
use palpate_shared::sim::{Faults, FingerConfig, FloatingBus};
use palpate_shared::units::DeviceTime;
use palpate_shared::wire::{BLOCK_SAMPLES, Counters, EventKind, Outcome, Request, Source};
use proptest::prelude::*;
use rig::{Bench, Rig, World};

/// Most samples between sampler and outbox: the queue, and a block that is not full.
const IN_FLIGHT_MAX: usize = READINGS - 1 + BLOCK_SAMPLES - 1;

/// Something that goes wrong, or a setting.
#[derive(Clone, Debug)]
enum Happening {
    Nothing,
    Faults(Faults),
    Reset,
    Overlooked(u32),
    /// The main loop hangs for so many conversions.
    MainLoopHangs(u32),
    LinkStalls(u32),
    Command(Request),
}

fn any_happening() -> impl Strategy<Value = Happening> {
    let absent = prop_oneof![Just(FloatingBus::High), Just(FloatingBus::Low)];
    let faults = prop_oneof![
        Just(Faults::default()),
        // Beyond, four damaged bits in one frame, the least that can pass its CRC, would be too common.
        (0.0_f32..0.004).prop_map(|bit_error_rate| Faults { bit_error_rate, ..Faults::default() }),
        Just(Faults { data_ready_stuck: true, ..Faults::default() }),
        absent.prop_map(|floating| Faults { chip_absent: Some(floating), ..Faults::default() }),
        Just(Faults { saturated: [true, false], ..Faults::default() }),
    ];
    let request = prop_oneof![
        Just(Request::Start),
        Just(Request::Stop),
        prop::sample::select(vec![500, 1000, 2000, 4000, 8000]).prop_map(|rate_hz| Request::SetRate { rate_hz }),
        prop::sample::select(vec![1, 32, 128]).prop_map(|gain| Request::SetGain { gain }),
        (0_u8..64).prop_map(|address| Request::ReadRegister { address }),
        prop::sample::select(vec![Source::Hardware, Source::Simulated])
            .prop_map(|source| Request::SetSource { source }),
        Just(Request::SelfTest),
    ];
    prop_oneof![
        2 => Just(Happening::Nothing),
        3 => faults.prop_map(Happening::Faults),
        1 => Just(Happening::Reset),
        2 => (1_u32..200).prop_map(Happening::Overlooked),
        1 => (1_u32..400).prop_map(Happening::MainLoopHangs),
        1 => (1_u32..2000).prop_map(Happening::LinkStalls),
        4 => request.prop_map(Happening::Command),
    ]
}

/// Makes it happen.
fn happen(rig: &mut Rig<'_>, happening: Happening) {
    match happening {
        Happening::Nothing => {}
        Happening::Faults(faults) => rig.set_faults(faults),
        Happening::Reset => rig.reset_chip(),
        Happening::Overlooked(edges) => rig.overlook_edges = edges,
        Happening::MainLoopHangs(steps) => {
            rig.main_loop_hangs = true;
            rig.run(steps);
            rig.main_loop_hangs = false;
        }
        Happening::LinkStalls(steps) => {
            rig.link_open = false;
            rig.run(steps);
            rig.link_open = true;
        }
        Happening::Command(request) => {
            rig.send(request);
        }
    }
}

/// Samples numbered, less those that were delivered and those that the counters name as lost.
fn unaccounted(counters: &Counters, delivered: usize) -> i64 {
    let lost = counters.samples_missed + counters.samples_damaged + counters.samples_dropped;
    i64::from(counters.samples) - i64::from(lost) - i64::try_from(delivered).unwrap_or(i64::MAX)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    #[test]
    fn samples_are_delivered_or_counted_as_lost(
        seed in any::<u64>(), start in any::<u32>(),
        happenings in prop::collection::vec((any_happening(), 1_u32..400), 0..25),
    ) {
        let mut world = World::new(FingerConfig::default(), seed);
        let mut rig = Rig::new(&mut world, Bench { start: DeviceTime(start), ..Bench::default() });
        rig.start_streaming();
        for (happening, steps) in happenings {
            happen(&mut rig, happening);
            for _ in 0..steps {
                rig.step();
            }
            // While the link is open all that is in the outbox is heard at once.
            let counters = rig.device.counters();
            let left = unaccounted(&counters, rig.heard.samples().count());
            let most = i64::try_from(IN_FLIGHT_MAX).unwrap();
            prop_assert!((0..=most).contains(&left), "{left} of at most {most} in flight: {counters:?}");
        }
        rig.set_faults(Faults::default());
        rig.overlook_edges = 0;
        // A chip given up on is looked for again within 200 ms; then all commands are through.
        rig.run_us(600_000);
        prop_assert_eq!(rig.ask(Request::Stop), Outcome::Done);
        // The last report of losses may be 250 ms away.
        rig.run_us(300_000);
        let counters = rig.device.counters();
        let delivered = u32::try_from(rig.heard.samples().count()).unwrap();
        let [missed, damaged, dropped] = rig.heard.losses();
        prop_assert_eq!(counters.samples, delivered + missed + damaged + dropped);
        let counted = [counters.samples_missed, counters.samples_damaged, counters.samples_dropped];
        prop_assert_eq!([missed, damaged, dropped], counted);
        let after_last = counters.samples - rig.heard.samples().last().map_or(0, |sample| sample.seq.0 + 1);
        prop_assert_eq!(rig.heard.gaps() + after_last, missed + damaged + dropped);
        prop_assert_eq!(rig.heard.frames_bad, 0);
        prop_assert_eq!(rig.wrong_samples(), 0);
    }

    /// After any faults the device is as good as new.
    #[test]
    fn a_device_recovers_from_anything(
        seed in any::<u64>(), happenings in prop::collection::vec((any_happening(), 1_u32..400), 0..25),
    ) {
        let mut world = World::new(FingerConfig::default(), seed);
        let mut rig = Rig::new(&mut world, Bench::default());
        rig.run_us(5000);
        for (happening, steps) in happenings {
            happen(&mut rig, happening);
            rig.run(steps);
        }
        rig.set_faults(Faults::default());
        rig.overlook_edges = 0;
        rig.run_us(600_000);
        for request in [Request::SetSource { source: Source::Hardware }, Request::SetRate { rate_hz: 4000 }, Request::SetGain { gain: 32 }, Request::Start] {
            prop_assert_eq!(rig.ask(request), Outcome::Done);
        }
        let before = rig.device.counters();
        let heard = rig.heard.samples().count();
        rig.run(4000);
        let after = rig.device.counters();
        prop_assert_eq!(after.samples - before.samples, 4000);
        prop_assert_eq!(after.samples_missed + after.samples_damaged + after.samples_dropped, before.samples_missed + before.samples_damaged + before.samples_dropped);
        prop_assert!(rig.heard.samples().count() - heard + BLOCK_SAMPLES > 4000);
        let Outcome::SelfTest(result) = rig.ask(Request::SelfTest) else { panic!("no self-test") };
        prop_assert_eq!(result.failed.0, 0);
        prop_assert_eq!(rig.wrong_samples(), 0);
        // Each fault that was told is followed by the news that it is over.
        let last = rig.heard.faults().into_iter().rfind(|kind| *kind != EventKind::FrontEndReset);
        prop_assert!(matches!(last, None | Some(EventKind::FrontEndRecovered)), "{:?}", rig.heard.faults());
    }
}

/// A chip that was away and comes back, with its settings lost, on a bus that damages bits.
fn returns_on_a_bad_bus(rig: &mut Rig<'_>, bit_error_rate: f32) {
    rig.set_faults(Faults { chip_absent: Some(FloatingBus::High), ..Faults::default() });
    rig.run(1);
    rig.set_faults(Faults { bit_error_rate, ..Faults::default() });
}

/// Lets all that is broken be mended and heard of: each sample is right, and each number is accounted for.
fn settle_accounts(rig: &mut Rig<'_>) {
    rig.set_faults(Faults::default());
    rig.overlook_edges = 0;
    rig.run_us(600_000);
    assert_eq!(rig.ask(Request::Stop), Outcome::Done);
    rig.run_us(300_000);
    assert_eq!(rig.wrong_samples(), 0);
    let counters = rig.device.counters();
    assert_eq!(unaccounted(&counters, rig.heard.samples().count()), 0, "{counters:?}");
    let [missed, damaged, dropped] = rig.heard.losses();
    let after_last = counters.samples - rig.heard.samples().last().map_or(0, |sample| sample.seq.0 + 1);
    assert_eq!(rig.heard.gaps() + after_last, missed + damaged + dropped);
}

/// A host that stops reading: blocks find no room, and their samples are in the counters that it reads afterwards.
#[test]
fn the_samples_of_dropped_blocks_are_in_the_counters() {
    let mut world = World::new(FingerConfig::default(), 0);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    happen(&mut rig, Happening::LinkStalls(4000));
    settle_accounts(&mut rig);
    let Outcome::Counters(counters) = rig.ask(Request::Counters) else { panic!("no counters") };
    assert!(counters.blocks_dropped > 100, "{counters:?}");
    assert_eq!(counters.samples_dropped, counters.blocks_dropped * 8, "{counters:?}");
}

#[test]
fn a_sample_missed_while_the_rate_changes_leaves_a_gap() {
    let mut world = World::new(FingerConfig::default(), 0);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    rig.send(Request::SetRate { rate_hz: 2000 });
    rig.run(2);
    rig.overlook_edges = 1;
    rig.run(1);
    settle_accounts(&mut rig);
    assert_eq!(rig.heard.losses(), [1, 0, 0]);
}

#[test]
fn both_samples_missed_while_the_rate_of_the_simulated_source_changes_are_counted() {
    let mut world = World::new(FingerConfig::default(), 0);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.run_us(5000);
    rig.send(Request::Start);
    rig.run(1);
    rig.send(Request::SetSource { source: Source::Simulated });
    rig.run(1);
    rig.send(Request::SetRate { rate_hz: 500 });
    rig.run(2);
    rig.reset_chip();
    rig.run(1);
    settle_accounts(&mut rig);
    assert_eq!(rig.heard.losses(), [2, 0, 0]);
}

#[test]
fn a_rate_changed_in_a_silence_hides_no_gap() {
    let mut world = World::new(FingerConfig::default(), 0);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    rig.set_faults(Faults { data_ready_stuck: true, ..Faults::default() });
    rig.run(150);
    assert_eq!(rig.ask(Request::SetRate { rate_hz: 2000 }), Outcome::Done);
    settle_accounts(&mut rig);
    assert!(rig.heard.losses()[0] > 100, "{:?}", rig.heard.losses());
}

/// A damaged command, which a chip without its settings carries out, leaves a conversion in its memory.
#[test]
fn samples_after_damage_are_neither_old_nor_of_a_chip_without_settings() {
    let mut world = World::new(FingerConfig::default(), 11_440_137_715_991_677_048);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    returns_on_a_bad_bus(&mut rig, 0.003_671_891_5);
    rig.run(4);
    settle_accounts(&mut rig);
}

#[test]
fn samples_are_right_after_a_reset_amid_damage() {
    let mut world = World::new(FingerConfig::default(), 3_642_260_451_982_966_442);
    let mut rig = Rig::new(&mut world, Bench::default());
    let hang = |rig: &mut Rig<'_>, steps| happen(rig, Happening::MainLoopHangs(steps));
    rig.run_us(5000);
    rig.send(Request::Start);
    rig.run(1);
    returns_on_a_bad_bus(&mut rig, 0.001_523_349_2);
    rig.run(233);
    hang(&mut rig, 201);
    rig.run(271);
    hang(&mut rig, 50);
    rig.run(268);
    rig.reset_chip();
    rig.run(88);
    rig.send(Request::Start);
    rig.run(305);
    happen(&mut rig, Happening::LinkStalls(1217));
    rig.run(310);
    rig.set_faults(Faults { data_ready_stuck: true, ..Faults::default() });
    rig.run(258);
    rig.set_faults(Faults { bit_error_rate: 0.003_872_510_5, ..Faults::default() });
    rig.run(25);
    rig.reset_chip();
    rig.run(2);
    settle_accounts(&mut rig);
}

/// A damaged command switches a channel off and quickens the conversions.
#[test]
fn samples_are_right_while_a_damaged_write_is_found_out() {
    let mut world = World::new(FingerConfig::default(), 12_807_640_867_469_596_844);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    rig.set_faults(Faults { bit_error_rate: 0.001_358_953_5, ..Faults::default() });
    rig.run(115);
    rig.send(Request::Start);
    rig.run(290);
    happen(&mut rig, Happening::MainLoopHangs(225));
    rig.run(85);
    rig.overlook_edges = 1;
    rig.run(234);
    rig.overlook_edges = 1;
    rig.run(68);
    settle_accounts(&mut rig);
}

/// Whichever bits of the frames after its return are damaged.
#[test]
fn a_chip_that_comes_back_without_its_settings_gives_no_wrong_sample() {
    for seed in 0..300 {
        let mut world = World::new(FingerConfig::default(), seed);
        let mut rig = Rig::new(&mut world, Bench::default());
        rig.start_streaming();
        returns_on_a_bad_bus(&mut rig, 0.004);
        rig.run(20);
        rig.set_faults(Faults::default());
        rig.run(200);
        assert_eq!(rig.wrong_samples(), 0, "seed {seed}");
    }
}
