//! Samples from the chip model through the firmware to a host: numbers, staleness, settling, losses.

mod rig;

use palpate_firmware_core::ConverterClock;
use palpate_shared::sim::{Faults, FingerConfig, FloatingBus};
use palpate_shared::units::DeviceTime;
use palpate_shared::wire::{Checks, EventKind, Outcome, Refusal, Request, Source, Status};
use rig::{Bench, Rig, World};

/// Bytes of a ping's frame, with an id of three bytes.
const PING_FRAME: usize = 11;

/// Damage that spoils about one frame in eleven: 88 bits count.
const BIT_ERROR_RATE: f32 = 1e-3;

/// Runs a test on a device that streams.
fn streaming(bench: Bench, test: impl FnOnce(&mut Rig<'_>)) {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, bench);
    rig.start_streaming();
    test(&mut rig);
}

/// Stops, waits for the last report of losses, and checks that numbers, counters and events agree.
fn stop_and_settle_accounts(rig: &mut Rig<'_>) -> u32 {
    assert_eq!(rig.ask(Request::Stop), Outcome::Done);
    rig.run_us(300_000);
    let delivered = u32::try_from(rig.heard.samples().count()).expect("a test is not that long");
    let counters = rig.device.counters();
    let lost: u32 = rig.heard.losses().iter().sum();
    assert_eq!(counters.samples, delivered + lost, "{counters:?}");
    let [missed, damaged, dropped] = rig.heard.losses();
    assert_eq!([missed, damaged], [counters.samples_missed, counters.samples_damaged]);
    assert!(dropped >= counters.samples_dropped);
    // A loss after the last sample leaves no gap that a host could see.
    let after_last = counters.samples - rig.heard.samples().last().map_or(0, |sample| sample.seq.0 + 1);
    assert_eq!(rig.heard.gaps() + after_last, lost);
    delivered
}

#[test]
fn a_second_of_samples_arrives_whole_and_in_order() {
    streaming(Bench::default(), |rig| {
        rig.run(4000);
        assert!(stop_and_settle_accounts(rig) >= 4000);
        assert!(rig.heard.samples().map(|sample| sample.seq.0).eq(0..rig.device.counters().samples));
        assert!(rig.heard.blocks().all(|block| block.status == Status::default()));
        assert_eq!(rig.wrong_samples(), 0);
    });
}

#[test]
fn every_rate_streams_without_loss() {
    for rate_hz in [500, 1000, 2000, 4000, 8000] {
        streaming(Bench::default(), |rig| {
            assert_eq!(rig.ask(Request::SetRate { rate_hz }), Outcome::Done);
            rig.run(2000);
            stop_and_settle_accounts(rig);
            assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0), "{rate_hz} Hz");
            assert_eq!(rig.front_end().borrow().period_ns(), 1_000_000_000 / rate_hz);
        });
    }
}

#[test]
fn every_rate_of_another_converter_clock_streams_without_loss() {
    let converter_clock = ConverterClock::from_hz(8_000_000).expect("within the range");
    // By hand: 2 · 512 cycles of 125 ns, and doubled four times.
    for (rate_hz, period_ns) in [(7813, 128_000), (3906, 256_000), (1953, 512_000), (977, 1_024_000), (488, 2_048_000)]
    {
        streaming(Bench { converter_clock, ..Bench::default() }, |rig| {
            assert_eq!(rig.ask(Request::SetRate { rate_hz }), Outcome::Done);
            rig.run(2000);
            let Outcome::SelfTest(result) = rig.ask(Request::SelfTest) else { panic!("no self-test") };
            assert!(result.failed == Checks::default() && result.checked.contains(Checks::RATE), "{result:?}");
            assert!(result.period_ns.abs_diff(period_ns) <= period_ns / 1000, "{result:?}");
            stop_and_settle_accounts(rig);
            assert_eq!((rig.heard.gaps(), rig.wrong_samples(), rig.heard.faults()), (0, 0, vec![]), "{rate_hz} Hz");
            assert_eq!(rig.front_end().borrow().period_ns(), period_ns);
            let refusal = Refusal::RateNotPossible { slowest_hz: 488, fastest_hz: 7813 };
            assert_eq!(rig.ask(Request::SetRate { rate_hz: 4000 }), Outcome::Refused(refusal));
        });
    }
}

#[test]
fn a_missed_edge_leaves_a_gap_and_no_staleness() {
    for missed in [1, 2, 3, 50] {
        streaming(Bench::default(), |rig| {
            for pause in [1, 2, 5, 100] {
                rig.overlook_edges = missed;
                rig.run(missed + pause);
            }
            stop_and_settle_accounts(rig);
            assert_eq!(rig.heard.losses(), [4 * missed, 0, 0]);
            assert_eq!(rig.wrong_samples(), 0, "{missed} missed");
            assert!(rig.unnumbered_conversions().windows(2).all(|pair| pair[0] == pair[1]));
            assert!(rig.heard.blocks().all(|block| !block.status.contains(Status::SETTLING)));
        });
    }
}

#[test]
fn samples_are_fresh_from_the_first_one_on() {
    // Conversions pile up in the chip before the firmware looks at it for the first time.
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    for _ in 0..10 {
        rig.front_end().borrow_mut().step();
    }
    rig.start_streaming();
    rig.run(100);
    stop_and_settle_accounts(&mut rig);
    assert_eq!(rig.wrong_samples(), 0);
}

#[test]
fn a_glitch_on_the_data_ready_line_is_no_sample() {
    streaming(Bench::default(), |rig| {
        for _ in 0..100 {
            rig.step();
            let just_after = DeviceTime(rig.now().0.wrapping_add(30));
            rig.sampler.data_ready(just_after);
        }
        stop_and_settle_accounts(rig);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
    });
}

#[test]
fn damaged_frames_cost_their_numbers_and_nothing_wrong_gets_through() {
    streaming(Bench::default(), |rig| {
        rig.set_faults(Faults { bit_error_rate: BIT_ERROR_RATE, ..Faults::default() });
        rig.run(40_000);
        rig.set_faults(Faults::default());
        rig.run(10);
        let delivered = stop_and_settle_accounts(rig);
        let [missed, damaged, dropped] = rig.heard.losses();
        println!("{delivered} delivered, {missed} missed, {damaged} damaged, {dropped} dropped");
        println!("faults told: {:?}", rig.heard.faults());
        // 1 − (1 − 10⁻³)⁸⁸ is 8.4 %, in 136 bits 12.7 %; far from it means that frames are lost for another reason.
        let bits = 24 * (rig::CHANNELS + 2) - 8;
        let expected = 40_000.0 * (1.0 - (1.0 - f64::from(BIT_ERROR_RATE)).powf(bits as f64));
        assert!((0.83..=1.34).contains(&(f64::from(damaged) / expected)), "{damaged} of {expected}");
        // A damaged frame passes its CRC once in 65536: with 3400 of them none is expected.
        assert_eq!(rig.wrong_samples(), 0);
        assert!(rig.unnumbered_conversions().windows(2).all(|pair| pair[0] == pair[1]));
    });
}

#[test]
fn settings_change_and_stay_right_on_a_bus_that_damages_half_the_frames() {
    // One bit in 125: damaged writes go astray, change the word length, turn channels off.
    let faults = Faults { bit_error_rate: 8e-3, ..Faults::default() };
    for seed in 0..40 {
        let mut world = World::new(FingerConfig::default(), seed);
        let mut rig = Rig::new(&mut world, Bench::default());
        rig.start_streaming();
        for (rate_hz, gain) in [(8000, 1), (500, 128), (4000, 32), (4000, 1), (1000, 64)] {
            rig.set_faults(faults);
            for request in [Request::SetRate { rate_hz }, Request::SetGain { gain }] {
                let outcome = rig.ask(request);
                let is_honest = matches!(outcome, Outcome::Done | Outcome::Refused(_));
                assert!(is_honest, "seed {seed}: {request:?}: {outcome:?}");
            }
            rig.run(200);
            rig.set_faults(Faults::default());
            // A chip given up on is looked for every 200 ms.
            rig.run_us(300_000);
            let Outcome::Hello(hello) = rig.ask(Request::Hello) else { panic!("no hello") };
            let front_end = rig.front_end().borrow();
            assert_eq!(hello.rate_hz, 1_000_000_000 / front_end.period_ns(), "seed {seed}");
            assert_eq!([hello.gain; 2], [0, 1].map(|channel| front_end.chip().gain(channel)), "seed {seed}");
        }
        stop_and_settle_accounts(&mut rig);
        // Seeded; at this rate about one of these runs in a hundred has a frame that passes its CRC by chance.
        assert_eq!(rig.wrong_samples(), 0, "seed {seed}");
    }
}

#[test]
fn a_change_of_gain_settles_in_three_conversions_and_loses_nothing() {
    streaming(Bench::default(), |rig| {
        rig.run(100);
        let before = rig.device.counters().samples;
        assert_eq!(rig.ask(Request::SetGain { gain: 1 }), Outcome::Done);
        rig.run(100);
        stop_and_settle_accounts(rig);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
        let settling: Vec<u32> =
            rig.heard.samples().filter(|s| s.status.contains(Status::SETTLING)).map(|s| s.seq.0).collect();
        // The request may wait for the next edge; then the conversion at hand and three more are marked.
        assert_eq!(settling.len(), 4, "{settling:?} after {before}");
        assert!((before..before + 3).contains(&settling[0]), "{settling:?} after {before}");
        // The default finger's offset is 1e5 codes at gain 32, so 3e3 at gain 1.
        let last_marked = settling[3];
        for sample in rig.heard.samples() {
            let size = sample.counts[0].0;
            let is_amplified = size > 50_000;
            let is_marked = settling.contains(&sample.seq.0);
            assert!(is_marked || is_amplified == (sample.seq.0 < last_marked), "{size} in sample {}", sample.seq.0);
        }
    });
}

#[test]
fn saturation_is_marked_on_its_channel() {
    streaming(Bench::default(), |rig| {
        rig.run(20);
        rig.set_faults(Faults { saturated: [false, true], ..Faults::default() });
        rig.run(40);
        stop_and_settle_accounts(rig);
        for block in rig.heard.blocks() {
            let [first, second] = [0, 1].map(|channel| block.samples.iter().any(|codes| codes[channel].is_saturated()));
            assert_eq!(block.status.contains(Status::SATURATED_0), first);
            assert_eq!(block.status.contains(Status::SATURATED_1), second);
        }
        assert!(rig.heard.blocks().any(|block| block.status.contains(Status::SATURATED_1)));
    });
}

#[test]
fn a_stuck_data_ready_line_is_reported_once_and_counted() {
    streaming(Bench::default(), |rig| {
        rig.run(100);
        rig.set_faults(Faults { data_ready_stuck: true, ..Faults::default() });
        rig.run(12_000);
        rig.set_faults(Faults::default());
        rig.run(100);
        stop_and_settle_accounts(rig);
        let [silent, recovered] = rig.heard.faults()[..] else { panic!("{:?}", rig.heard.faults()) };
        assert!(matches!(silent, EventKind::FrontEndSilent { quiet_us: 25_000..=27_000 }), "{silent:?}");
        assert_eq!(recovered, EventKind::FrontEndRecovered);
        assert_eq!((rig.wrong_samples(), rig.heard.gaps()), (0, 12_000));
        assert!(rig.unnumbered_conversions().windows(2).all(|pair| pair[0] == pair[1]));
    });
}

#[test]
fn a_chip_whose_clock_stops_is_silent_and_never_data() {
    streaming(Bench::default(), |rig| {
        rig.run(100);
        rig.set_faults(Faults { clock_stopped: true, ..Faults::default() });
        rig.run(4000);
        let Outcome::SelfTest(result) = rig.ask(Request::SelfTest) else { panic!("no self-test") };
        assert!(result.failed == Checks::RATE && !result.checked.contains(Checks::RANGE), "{result:?}");
        let heard = rig.heard.samples().count();
        rig.run(1000);
        assert_eq!(rig.heard.samples().count(), heard);
        assert!(matches!(rig.heard.faults()[..], [EventKind::FrontEndSilent { .. }]), "{:?}", rig.heard.faults());
        rig.set_faults(Faults::default());
        rig.run(4000);
        stop_and_settle_accounts(rig);
        assert_eq!(rig.heard.faults().last(), Some(&EventKind::FrontEndRecovered));
        assert!(rig.heard.samples().count() >= heard + 3000);
        assert!(rig.heard.gaps() >= 5000, "{}", rig.heard.gaps());
    });
}

#[test]
fn a_chip_that_resets_itself_gets_its_settings_again() {
    streaming(Bench::default(), |rig| {
        rig.run(100);
        rig.reset_chip();
        rig.run(100);
        stop_and_settle_accounts(rig);
        assert_eq!(rig.heard.faults(), [EventKind::FrontEndReset]);
        assert_eq!(rig.front_end().borrow().chip().gain(0), 32);
        // Two edges lost with the supply, and the first after it, which has neither gain nor rate.
        assert_eq!(rig.heard.losses(), [2, 1, 0]);
        assert_eq!(rig.wrong_samples(), 0);
        let amplified = |sample: &rig::Delivered| sample.counts[0].0 > 50_000;
        let wrong: Vec<_> =
            rig.heard.samples().filter(|s| !s.status.contains(Status::SETTLING) && !amplified(s)).collect();
        assert_eq!(wrong, []);
    });
}

#[test]
fn a_chip_that_vanishes_is_missing_until_it_is_back() {
    for damaged_line in [false, true] {
        streaming(Bench::default(), |rig| {
            rig.run(100);
            let gone = Faults {
                chip_absent: (!damaged_line).then_some(FloatingBus::High),
                bit_error_rate: if damaged_line { 0.5 } else { 0.0 },
                ..Faults::default()
            };
            rig.set_faults(gone);
            // In time, not in conversions: damaged writes change the chip's rate too.
            rig.run_us(2_000_000);
            assert_eq!(rig.ask(Request::Start), Outcome::Refused(Refusal::NoFrontEnd));
            rig.set_faults(Faults::default());
            rig.run_us(1_000_000);
            stop_and_settle_accounts(rig);
            let faults = rig.heard.faults();
            assert!(faults.iter().any(|kind| matches!(kind, EventKind::FrontEndMissing { .. })), "{faults:?}");
            assert_eq!(faults.last(), Some(&EventKind::FrontEndRecovered), "{faults:?}");
            assert!(faults.len() <= 3, "{faults:?}");
            assert_eq!(rig.wrong_samples(), 0);
            assert!(rig.heard.gaps() >= 8000);
        });
    }
}

#[test]
fn an_empty_socket_is_a_fault_and_never_data() {
    for floating in [FloatingBus::High, FloatingBus::Low] {
        let mut world = World::new(FingerConfig::default(), 1);
        let mut rig = Rig::new(&mut world, Bench::default());
        rig.set_faults(Faults { chip_absent: Some(floating), ..Faults::default() });
        rig.run_us(500_000);
        let id_word = u16::from_be_bytes([floating.byte(); 2]);
        assert_eq!(rig.heard.faults(), [EventKind::FrontEndMissing { id_word }]);
        assert_eq!(rig.heard.hellos().map(|hello| hello.front_end.id_word).collect::<Vec<_>>(), [0]);
        for request in [Request::Start, Request::SelfTest, Request::ReadRegister { address: 0 }] {
            assert_eq!(rig.ask(request), Outcome::Refused(Refusal::NoFrontEnd));
        }
        // Not even if something twitches on the line.
        for _ in 0..100 {
            let now = rig.now();
            rig.sampler.data_ready(now);
            rig.step();
        }
        assert_eq!((rig.heard.blocks().count(), rig.device.counters().samples), (0, 0));
        rig.set_faults(Faults::default());
        rig.run_us(500_000);
        assert_eq!(rig.heard.faults().last(), Some(&EventKind::FrontEndRecovered));
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        rig.run(100);
        stop_and_settle_accounts(&mut rig);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
    }
}

#[test]
fn every_block_of_the_simulated_source_says_so() {
    streaming(Bench::default(), |rig| {
        rig.run(100);
        assert_eq!(rig.ask(Request::SetSource { source: Source::Simulated }), Outcome::Done);
        rig.run(100);
        assert!(matches!(rig.ask(Request::Hello), Outcome::Hello(hello) if hello.source == Source::Simulated));
        let switched = rig.heard.blocks().count();
        assert_eq!(rig.ask(Request::SetSource { source: Source::Hardware }), Outcome::Done);
        rig.run(100);
        stop_and_settle_accounts(rig);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
        let simulated: Vec<bool> = rig.heard.blocks().map(|block| block.status.contains(Status::SIMULATED)).collect();
        let runs = simulated.windows(2).filter(|pair| pair[0] != pair[1]).count();
        assert!(runs == 2 && !simulated[0] && simulated[switched - 1], "{simulated:?}");
    });
}

#[test]
fn time_may_wrap_while_streaming() {
    let start = DeviceTime(u32::MAX - 500_000);
    streaming(Bench { start, ..Bench::default() }, |rig| {
        rig.run(8000);
        assert!(rig.now().0 < 2_000_000, "{:?}", rig.now());
        stop_and_settle_accounts(rig);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
        assert_eq!(rig.heard.faults(), []);
        assert_eq!(rig.device.counters().uptime_s, 2);
    });
}

#[test]
fn a_link_stalled_for_a_second_costs_blocks_and_no_replies() {
    streaming(Bench::default(), |rig| {
        rig.run(1000);
        rig.link_open = false;
        let ids: Vec<_> = (0..3)
            .map(|_| {
                rig.run(1000);
                rig.send(Request::Ping)
            })
            .collect();
        rig.run(1000);
        rig.link_open = true;
        rig.run(1000);
        stop_and_settle_accounts(rig);
        let counters = rig.device.counters();
        assert!(ids.iter().all(|&id| rig.outcomes(id).len() == 1));
        assert_eq!((counters.notices_dropped, counters.samples_dropped), (0, 8 * counters.blocks_dropped));
        // 4000 samples in 500 blocks, less those that fit into the outbox.
        assert!((450..500).contains(&counters.blocks_dropped), "{counters:?}");
        assert_eq!(rig.heard.losses(), [0, 0, 8 * counters.blocks_dropped]);
        assert_eq!(rig.heard.frames_bad, 0);
        assert_eq!(rig.wrong_samples(), 0);
    });
}

#[test]
fn losses_that_could_not_be_reported_are_reported_later() {
    streaming(Bench::default(), |rig| {
        rig.link_open = false;
        // Fills even the room that blocks leave free, so no report finds any.
        for _ in 0..500 {
            rig.send(Request::Counters);
        }
        rig.run(4000);
        rig.link_open = true;
        rig.run(4000);
        stop_and_settle_accounts(rig);
        assert!(rig.heard.losses()[2] > 3000);
        assert!(rig.device.counters().notices_dropped > 400);
    });
}

/// A host that asks without end, as fast as its line carries it, on a line that carries as much the other way.
#[test]
fn a_flood_of_commands_does_not_crowd_out_samples() {
    // Bytes in a conversion at 4 kHz, either way: 921600 baud, 10 bits a byte; rounded down.
    const LINE: usize = 23;
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    rig.start_streaming();
    rig.link_open = false;
    let (mut waiting, mut sent) = (0, Vec::new());
    for _ in 0..40_000 {
        waiting += LINE;
        while waiting >= PING_FRAME {
            waiting -= PING_FRAME;
            rig.send(Request::Ping);
        }
        rig.step();
        for _ in 0..2 {
            // The box is a ring: what waits may lie in two pieces.
            let piece: Vec<u8> = rig.device.transmit().iter().copied().take(LINE - sent.len()).collect();
            rig.device.transmitted(piece.len());
            sent.extend(piece);
        }
        rig.hear(&sent);
        sent.clear();
    }
    let counters = rig.device.counters();
    assert_eq!((counters.blocks_dropped, counters.samples_dropped), (0, 0), "{counters:?}");
    assert!(rig.heard.samples().count() > 39_000, "{counters:?}");
    // And the host is answered as often as there is room.
    assert!(rig.heard.replies().count() > 1000 && counters.notices_dropped > 0, "{counters:?}");
}

#[test]
fn edges_late_early_doubled_and_missed_in_any_order_keep_the_accounts() {
    streaming(Bench::default(), |rig| {
        // As many as are drawn, by a generator of its own.
        let (mut state, mut missed, mut extra) = (1_u32, 0, 0);
        for _ in 0..20_000 {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            match state >> 28 {
                0 => {
                    rig.overlook_edges = 1;
                    rig.step();
                    missed += 1;
                }
                // The same edge again, as a line that bounces gives it.
                1 | 2 => {
                    rig.step();
                    rig.sampler.data_ready(later(rig, 3));
                    extra += 1;
                }
                // Noise in the middle between two.
                3 => {
                    rig.step();
                    rig.sampler.data_ready(later(rig, 120));
                    extra += 1;
                }
                _ => _ = rig.step(),
            }
        }
        rig.run(10);
        stop_and_settle_accounts(rig);
        assert!(missed > 1000 && extra > 3000, "{missed} missed, {extra} extra");
        assert_eq!(rig.heard.losses(), [missed, 0, 0]);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (missed, 0));
        assert!(rig.unnumbered_conversions().windows(2).all(|pair| pair[0] == pair[1]));
    });
}

/// So many µs after now.
fn later(rig: &Rig<'_>, us: u32) -> DeviceTime {
    DeviceTime(rig.now().0.wrapping_add(us))
}
