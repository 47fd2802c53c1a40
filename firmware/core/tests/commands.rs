//! The host's commands: what each answers, refusals, repetition, garbage, silence.

mod rig;

use palpate_firmware_core::ads131m::{Ads131m, frame_of};
use palpate_shared::frame::{DELIMITER, FRAME_MAX, encode};
use palpate_shared::sim::{Faults, FingerConfig, FloatingBus, StatusLatch};
use palpate_shared::units::DeviceTime;
use palpate_shared::wire::{
    Checks, Command, CommandId, FrameBuffer, FromDevice, Outcome, PROTOCOL, Refusal, Request, SelfTest, Source, Status,
};
use proptest::prelude::*;
use rig::{Bench, Rig, World};

/// One request of every kind.
const EVERY_REQUEST: [Request; 10] = [
    Request::Hello,
    Request::Start,
    Request::Stop,
    Request::SetRate { rate_hz: 2000 },
    Request::SetGain { gain: 64 },
    Request::SetSource { source: Source::Simulated },
    Request::ReadRegister { address: 0 },
    Request::Ping,
    Request::SelfTest,
    Request::Counters,
];

/// Runs a test on a device that has found its chip.
fn started(bench: Bench, test: impl FnOnce(&mut Rig<'_>)) {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, bench);
    rig.run_us(5000);
    test(&mut rig);
}

fn refused(refusal: Refusal) -> Outcome {
    Outcome::Refused(refusal)
}

fn self_test(rig: &mut Rig<'_>) -> SelfTest {
    match rig.ask(Request::SelfTest) {
        Outcome::SelfTest(result) => result,
        other => panic!("{other:?}"),
    }
}

/// RAM of everything but the stack, in bytes: a quarter of what a board has for it.
const RAM_MAX: usize = 8 * 1024;

#[test]
fn the_whole_fits_into_a_small_board() {
    // Pointers here are twice as large as a board's.
    let parts = [
        size_of::<palpate_firmware_core::Queues>(),
        size_of::<palpate_firmware_core::Sampler<'_, Ads131m<rig::Bus<'_>, { rig::CHANNELS }>>>(),
        size_of::<palpate_firmware_core::Device<'_, { rig::OUTBOX }>>(),
    ];
    assert!(parts.iter().sum::<usize>() <= RAM_MAX, "{parts:?}");
}

#[test]
fn the_first_message_is_an_unasked_hello() {
    started(Bench::default(), |rig| {
        let [FromDevice::Hello(hello)] = &rig.heard.messages.clone()[..] else { panic!("{:?}", rig.heard.messages) };
        assert_eq!((hello.protocol, hello.front_end.id_word >> 8), (PROTOCOL, rig::ID_HIGH));
        assert_eq!((hello.rate_hz, hello.gain, hello.streaming), (4000, 32, false));
        assert_eq!(hello.board.as_str(), "test rig");
        assert_eq!(rig.ask(Request::Hello), Outcome::Hello(hello.clone()));
    });
}

#[test]
fn every_setting_is_made_and_told() {
    started(Bench::default(), |rig| {
        for rate_hz in [500, 8000, 1000, 2000, 4000] {
            assert_eq!(rig.ask(Request::SetRate { rate_hz }), Outcome::Done);
            assert_eq!(rig.front_end().borrow().period_ns(), 1_000_000_000 / rate_hz);
            assert!(matches!(rig.ask(Request::Hello), Outcome::Hello(hello) if hello.rate_hz == rate_hz));
        }
        for gain in [1, 2, 4, 8, 16, 32, 64, 128] {
            assert_eq!(rig.ask(Request::SetGain { gain }), Outcome::Done);
            assert_eq!([0, 1].map(|channel| rig.front_end().borrow().chip().gain(channel)), [gain; 2]);
            assert!(matches!(rig.ask(Request::Hello), Outcome::Hello(hello) if hello.gain == gain));
        }
    });
}

#[test]
fn what_the_front_end_cannot_do_is_refused_with_what_it_can() {
    started(Bench::default(), |rig| {
        for rate_hz in [0, 250, 3999, 16_000, u32::MAX] {
            let wanted = refused(Refusal::RateNotPossible { slowest_hz: 500, fastest_hz: 8000 });
            assert_eq!(rig.ask(Request::SetRate { rate_hz }), wanted);
        }
        for gain in [0, 3, 129, 255] {
            assert_eq!(rig.ask(Request::SetGain { gain }), refused(Refusal::GainNotPossible { largest: 128 }));
        }
        for address in [64, 255] {
            assert_eq!(rig.ask(Request::ReadRegister { address }), refused(Refusal::AddressNotPossible { last: 63 }));
        }
        assert_eq!(rig.device.counters().commands_refused, 11);
    });
}

#[test]
fn a_slow_line_limits_the_rate() {
    started(Bench { link_baud: 115_200, ..Bench::default() }, |rig| {
        assert!(matches!(rig.ask(Request::Hello), Outcome::Hello(hello) if hello.rate_hz == 1000));
        assert_eq!(rig.ask(Request::SetRate { rate_hz: 2000 }), refused(Refusal::LinkTooSlow { fastest_hz: 1000 }));
        assert_eq!(rig.ask(Request::SetRate { rate_hz: 500 }), Outcome::Done);
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
    });
    started(Bench { link_baud: 9600, ..Bench::default() }, |rig| {
        assert_eq!(rig.ask(Request::Start), refused(Refusal::LinkTooSlow { fastest_hz: 0 }));
    });
    started(Bench { link_baud: 0, ..Bench::default() }, |rig| {
        assert_eq!(rig.ask(Request::SetRate { rate_hz: 8000 }), Outcome::Done);
    });
}

#[test]
fn a_board_without_a_simulation_refuses_that_source_and_goes_on() {
    started(Bench { has_simulation: false, ..Bench::default() }, |rig| {
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        assert_eq!(rig.ask(Request::SetSource { source: Source::Simulated }), refused(Refusal::SourceNotPossible));
        rig.run(100);
        assert_eq!(rig.heard.gaps(), 0);
        assert!(rig.heard.blocks().count() > 10);
    });
}

#[test]
fn the_simulation_can_stand_in_for_a_missing_chip() {
    let mut world = World::new(FingerConfig::default(), 1);
    let mut rig = Rig::new(&mut world, Bench::default());
    let absent = Faults { chip_absent: Some(palpate_shared::sim::FloatingBus::High), ..Faults::default() };
    rig.set_faults(absent);
    rig.run_us(5000);
    assert_eq!(rig.ask(Request::Start), refused(Refusal::NoFrontEnd));
    assert_eq!(rig.ask(Request::SetSource { source: Source::Simulated }), Outcome::Done);
    assert_eq!(rig.ask(Request::Start), Outcome::Done);
    rig.run(100);
    assert!(rig.heard.blocks().count() > 10);
    assert!(rig.heard.blocks().all(|block| block.status.contains(Status::SIMULATED)));
    // Back to the empty socket: the stream ends with a fault, not with data.
    assert_eq!(rig.ask(Request::SetSource { source: Source::Hardware }), Outcome::Done);
    let blocks = rig.heard.blocks().count();
    rig.run_us(100_000);
    assert_eq!(rig.heard.blocks().count(), blocks);
    assert!(matches!(rig.ask(Request::Hello), Outcome::Hello(hello) if !hello.streaming));
    assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
}

#[test]
fn every_register_is_read_while_streaming_and_no_sample_is_lost() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        for address in 0..64 {
            let wanted = rig.front_end().borrow().chip().peek(address.into());
            match rig.ask(Request::ReadRegister { address }) {
                // What is being read decides over STATUS's data-ready bits.
                Outcome::Register { address: 1, value } => assert_eq!(value & !0xF, wanted & !0xF),
                outcome => assert_eq!(outcome, Outcome::Register { address, value: wanted }),
            }
        }
        assert_eq!(rig.ask(Request::Stop), Outcome::Done);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
        assert_eq!(rig.heard.blocks().filter(|block| block.status != Status::default()).count(), 0);
    });
}

#[test]
fn a_register_is_never_read_wrong_on_a_damaged_bus() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        // One frame in eleven is damaged, in either direction.
        rig.set_faults(Faults { bit_error_rate: 1e-3, ..Faults::default() });
        for _ in 0..300 {
            for address in [0, 2, 3, 4, 12] {
                let wanted = rig.front_end().borrow().chip().peek(address.into());
                let outcome = rig.ask(Request::ReadRegister { address });
                assert_eq!(outcome, Outcome::Register { address, value: wanted });
            }
        }
    });
}

#[test]
fn the_self_test_of_a_sound_device_passes_and_disturbs_nothing() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        rig.run(2000);
        for _ in 0..10 {
            let result = self_test(rig);
            assert_eq!((result.checked, result.failed), (Checks(31), Checks(0)));
            assert_eq!((result.id_word >> 8, result.period_ns), (rig::ID_HIGH, 250_000));
        }
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
    });
}

#[test]
fn the_self_test_names_what_is_wrong() {
    let cases: [(Checks, Faults); 3] = [
        (Checks::BUS, Faults { bit_error_rate: 1e-3, ..Faults::default() }),
        (Checks::RATE, Faults { data_ready_stuck: true, ..Faults::default() }),
        (Checks::RANGE, Faults { saturated: [true, false], ..Faults::default() }),
    ];
    for (wanted, faults) in cases {
        started(Bench::default(), |rig| {
            rig.run(2000);
            rig.set_faults(faults);
            rig.run(2000);
            let result = self_test(rig);
            assert!(result.checked.contains(wanted));
            assert_eq!(result.failed, wanted, "{result:?}");
            rig.set_faults(Faults::default());
            rig.run(3000);
            assert_eq!(self_test(rig).failed, Checks(0));
        });
    }
}

#[test]
fn a_silent_front_end_still_answers_and_stops() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        rig.set_faults(Faults { data_ready_stuck: true, ..Faults::default() });
        rig.run(1000);
        assert_eq!(rig.ask(Request::SetGain { gain: 8 }), Outcome::Done);
        assert_eq!(rig.ask(Request::SetRate { rate_hz: 1000 }), Outcome::Done);
        assert_eq!(rig.ask(Request::ReadRegister { address: 4 }), Outcome::Register { address: 4, value: 0x33 });
        assert_eq!(rig.ask(Request::Stop), Outcome::Done);
    });
}

#[test]
fn a_sampler_that_hangs_gets_a_bounded_wait() {
    started(Bench::default(), |rig| {
        let id = rig.send(Request::SelfTest);
        let sent = rig.now();
        let later = |us: u32| DeviceTime(sent.0.wrapping_add(us));
        rig.device.poll(later(249_999));
        rig.listen();
        assert_eq!(rig.outcomes(id), []);
        let busy = rig.send(Request::SelfTest);
        rig.device.poll(later(250_000));
        rig.listen();
        assert_eq!(rig.outcomes(id), [refused(Refusal::FrontEndSilent)]);
        assert_eq!(rig.outcomes(busy), [refused(Refusal::Busy)]);
        // The late answer is nobody's.
        rig.run(100);
        assert_eq!(rig.outcomes(id).len(), 1);
        assert!(matches!(rig.ask(Request::SelfTest), Outcome::SelfTest(_)));
    });
}

#[test]
fn what_was_busy_is_done_when_repeated_with_the_same_id() {
    started(Bench::default(), |rig| {
        rig.send(Request::SelfTest);
        let id = rig.send(Request::SetGain { gain: 1 });
        rig.listen();
        assert_eq!(rig.outcomes(id), [refused(Refusal::Busy)]);
        rig.run(20);
        rig.send_as(id, Request::SetGain { gain: 1 });
        rig.run(20);
        assert_eq!(rig.outcomes(id), [refused(Refusal::Busy), Outcome::Done]);
    });
}

#[test]
fn a_repeated_command_is_answered_again_and_not_acted_on_again() {
    started(Bench::default(), |rig| {
        let id = rig.send(Request::SetGain { gain: 8 });
        // The host loses patience before the first reply: still one reply.
        rig.send_as(id, Request::SetGain { gain: 8 });
        rig.run(20);
        assert_eq!(rig.outcomes(id), [Outcome::Done]);
        assert_eq!(rig.ask(Request::SetGain { gain: 16 }), Outcome::Done);
        rig.send_as(id, Request::SetGain { gain: 8 });
        rig.run(20);
        assert_eq!(rig.outcomes(id), [Outcome::Done, Outcome::Done]);
        assert_eq!(rig.front_end().borrow().chip().gain(0), 16);
        let counters = rig.device.counters();
        assert_eq!((counters.commands, counters.commands_repeated, counters.commands_refused), (4, 2, 0));
    });
}

#[test]
fn the_last_four_replies_are_remembered() {
    started(Bench::default(), |rig| {
        let ping = rig.send(Request::Ping);
        let first = rig.now();
        for _ in 0..3 {
            rig.run(10);
            rig.ask(Request::Counters);
        }
        rig.send_as(ping, Request::Ping);
        rig.listen();
        assert_eq!(rig.outcomes(ping), [Outcome::Pong { time: first }, Outcome::Pong { time: first }]);
        rig.ask(Request::Counters);
        rig.send_as(ping, Request::Ping);
        rig.listen();
        assert_eq!(rig.outcomes(ping)[2], Outcome::Pong { time: rig.now() });
    });
}

#[test]
fn starting_and_stopping_twice_is_no_error() {
    started(Bench::default(), |rig| {
        for request in [Request::Start, Request::Start, Request::Stop, Request::Stop, Request::Start] {
            assert_eq!(rig.ask(request), Outcome::Done);
            rig.run(100);
        }
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
    });
}

#[test]
fn what_is_queued_at_a_stop_comes_before_the_reply() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        rig.run(1003);
        assert_eq!(rig.ask(Request::Stop), Outcome::Done);
        rig.run(1000);
        let last = rig.heard.messages.iter().rfind(|message| !matches!(message, FromDevice::SlowChannels(_)));
        assert!(matches!(last, Some(FromDevice::Reply(reply)) if reply.outcome == Outcome::Done), "{last:?}");
        assert_eq!(rig.heard.samples().count(), rig.device.counters().samples as usize);
    });
}

#[test]
fn other_versions_and_unknown_requests_are_refused_by_id() {
    started(Bench::default(), |rig| {
        let send = |payload: &[u8], rig: &mut Rig<'_>| {
            let mut line: FrameBuffer = [0; FRAME_MAX + 1];
            // A tuple of bytes is encoded as these bytes.
            let frame = match *payload {
                [a, b, c] => encode(&(a, b, c), &mut line),
                [a] => encode(&a, &mut line),
                _ => panic!("not used"),
            };
            rig.device.receive(frame.unwrap(), rig.now());
            rig.listen();
        };
        send(&[2, 77, 0], rig);
        send(&[1, 78, 200], rig);
        assert_eq!(rig.outcomes(CommandId(77)), [refused(Refusal::OtherProtocol { device: PROTOCOL })]);
        assert_eq!(rig.outcomes(CommandId(78)), [refused(Refusal::UnknownRequest)]);
        send(&[1], rig); // no id, so no reply
        let counters = rig.device.counters();
        assert_eq!((counters.commands, counters.commands_refused, counters.frames_damaged), (2, 2, 1));
    });
}

#[test]
fn garbage_before_a_command_costs_only_itself() {
    started(Bench::default(), |rig| {
        for garbage in [&[7; 1000][..], &[0; 50], &[3, 1, 2, 0, 0xFF, 0xFE], &[0xFF; FRAME_MAX]] {
            rig.device.receive(garbage, rig.now());
            rig.device.receive(&[DELIMITER], rig.now());
            assert!(matches!(rig.ask(Request::Ping), Outcome::Pong { .. }));
        }
        assert_eq!(rig.device.counters().frames_damaged, 4);
    });
}

#[test]
fn a_host_that_does_not_listen_loses_replies_and_they_are_counted() {
    started(Bench::default(), |rig| {
        rig.link_open = false;
        let ids: Vec<CommandId> = (0..500).map(|_| rig.send(Request::Counters)).collect();
        rig.link_open = true;
        rig.listen();
        let answered = ids.iter().filter(|&&id| rig.outcomes(id).len() == 1).count();
        assert_eq!(answered + rig.device.counters().notices_dropped as usize, 500);
        assert!(answered > 50, "{answered}");
    });
}

/// Any request, sensible or not.
fn any_request() -> impl Strategy<Value = Request> {
    prop_oneof![
        prop::sample::select(&EVERY_REQUEST[..]),
        prop::sample::select(vec![500, 1000, 2000, 4000, 8000, 3]).prop_map(|rate_hz| Request::SetRate { rate_hz }),
        any::<u8>().prop_map(|gain| Request::SetGain { gain }),
        any::<u8>().prop_map(|address| Request::ReadRegister { address }),
        any::<bool>().prop_map(|simulated| Request::SetSource {
            source: if simulated { Source::Simulated } else { Source::Hardware }
        }),
    ]
}

/// What a host, or a bad cable, may do.
#[derive(Clone, Debug)]
enum Input {
    Command(Request),
    Repeat,
    Garbage(Vec<u8>),
    Wait(u32),
}

fn any_input() -> impl Strategy<Value = Input> {
    prop_oneof![
        4 => any_request().prop_map(Input::Command),
        1 => Just(Input::Repeat),
        2 => prop::collection::vec(any::<u8>(), 0..300).prop_map(Input::Garbage),
        3 => (0_u32..50).prop_map(Input::Wait),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_bytes_are_survived(pieces in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..400), 0..50)) {
        let mut world = World::new(FingerConfig::ideal(), 1);
        let mut rig = Rig::new(&mut world, Bench::default());
        for piece in pieces {
            rig.device.receive(&piece, rig.now());
            rig.step();
        }
        // By chance one frame in 2³² would pass for a command.
        prop_assert_eq!(rig.heard.replies().count(), 0);
    }

    #[test]
    fn every_command_gets_one_reply_for_each_time_it_is_heard_at_most(inputs in prop::collection::vec(any_input(), 0..60)) {
        let mut world = World::new(FingerConfig::ideal(), 1);
        let mut rig = Rig::new(&mut world, Bench::default());
        let (mut sent, mut heard) = (Vec::<(CommandId, Request)>::new(), 0);
        for input in inputs {
            match input {
                Input::Command(request) => {
                    // Ends whatever garbage came before.
                    rig.device.receive(&[DELIMITER], rig.now());
                    sent.push((rig.send(request), request));
                    heard += 1;
                }
                Input::Repeat => if let Some(&(id, request)) = sent.last() {
                    rig.device.receive(&[DELIMITER], rig.now());
                    rig.send_as(id, request);
                    heard += 1;
                },
                Input::Garbage(bytes) => rig.device.receive(&bytes, rig.now()),
                Input::Wait(steps) => rig.run(steps),
            }
        }
        rig.run_us(400_000);
        prop_assert_eq!(rig.device.counters().commands, heard);
        let answered = sent.iter().filter(|(id, _)| !rig.outcomes(*id).is_empty()).count();
        prop_assert_eq!(answered, sent.len(), "every command is answered at last");
        prop_assert!(rig.heard.replies().count() <= heard as usize);
        prop_assert_eq!(rig.device.counters().notices_dropped, 0);
        prop_assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
    }

    /// A command cut out of the wire format of a newer host never makes more than one reply.
    #[test]
    fn damaged_commands_are_not_obeyed(request in any_request(), at in any::<prop::sample::Index>(), bit in 0_u32..8) {
        let mut world = World::new(FingerConfig::ideal(), 1);
        let mut rig = Rig::new(&mut world, Bench::default());
        rig.run_us(5000);
        let mut line: FrameBuffer = [0; FRAME_MAX + 1];
        let mut frame = encode(&Command::new(CommandId(9), request), &mut line).unwrap().to_vec();
        let at = at.index(frame.len());
        frame[at] ^= 1 << bit;
        rig.device.receive(&frame, rig.now());
        rig.device.receive(&[DELIMITER], rig.now());
        rig.run(100);
        prop_assert_eq!(rig.heard.replies().count(), 0);
        prop_assert!(rig.device.counters().frames_damaged >= 1);
    }
}

/// Sixteen notices while the main loop stands still used to leave no place for the answer to the command before them.
#[test]
fn an_answer_finds_a_place_whatever_else_is_told() {
    started(Bench::default(), |rig| {
        rig.main_loop_hangs = true;
        for _ in 0..20 {
            rig.reset_chip();
            rig.run(2);
        }
        let id = rig.send(Request::SetGain { gain: 64 });
        rig.run_us(10_000);
        rig.main_loop_hangs = false;
        rig.run_us(10_000);
        assert_eq!(rig.outcomes(id), [Outcome::Done]);
        assert!(matches!(rig.ask(Request::Hello), Outcome::Hello(hello) if hello.gain == 64));
        let Outcome::Counters(counters) = rig.ask(Request::Counters) else { panic!("no counters") };
        assert!(counters.notices_dropped > 0, "{counters:?}");
    });
}

/// The same for the news that the front-end is back: without it every command would be refused for good.
#[test]
fn a_front_end_that_comes_back_while_the_main_loop_stands_still_is_known_to_be_back() {
    started(Bench::default(), |rig| {
        rig.set_faults(Faults { chip_absent: Some(FloatingBus::High), ..Faults::default() });
        rig.run_us(300_000);
        assert_eq!(rig.ask(Request::Start), refused(Refusal::NoFrontEnd));
        rig.main_loop_hangs = true;
        for _ in 0..20 {
            rig.set_faults(Faults::default());
            rig.run_us(300_000);
            rig.reset_chip();
            rig.run(2);
            rig.set_faults(Faults { chip_absent: Some(FloatingBus::High), ..Faults::default() });
            rig.run_us(300_000);
        }
        rig.set_faults(Faults::default());
        rig.run_us(300_000);
        rig.main_loop_hangs = false;
        rig.run_us(10_000);
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
    });
}

/// A command's frame, as the driver would send it.
fn raw(command: u16, value: Option<u16>) -> Request {
    Request::RawFrame { bytes: frame_of(command, value) }
}

/// The response in the frame that a raw one brings.
fn response_to(rig: &mut Rig<'_>, request: Request) -> u16 {
    let Outcome::RawFrame { bytes } = rig.ask(request) else { panic!("no frame came in") };
    u16::from_be_bytes([bytes[0], bytes[1]])
}

#[test]
fn raw_frames_bring_the_answers_to_each_other() {
    started(Bench::default(), |rig| {
        response_to(rig, raw(0xA000, None));
        assert_eq!(response_to(rig, raw(0x6200, Some(0x0011))), rig::ID_HIGH << 8 | 0x82, "the ID register");
        // However long the host takes, within a second.
        rig.run_us(900_000);
        assert_eq!(response_to(rig, raw(0xA200, None)), 0x4200, "GAIN1 written");
        assert_eq!(response_to(rig, raw(0x0000, None)), 0x0011, "GAIN1");
        assert_eq!(rig.device.counters().samples, 0);
    });
}

#[test]
fn a_second_after_the_last_raw_frame_the_front_end_has_its_settings_again() {
    started(Bench::default(), |rig| {
        response_to(rig, raw(0x0011, None));
        rig.run_us(990_000);
        assert_eq!(rig.front_end().borrow().chip().gain(0), 1);
        rig.run_us(20_000);
        assert_eq!(rig.front_end().borrow().chip().gain(0), 32);
        assert_eq!(rig.heard.faults(), []);
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        rig.run(100);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples()), (0, 0));
        assert!(rig.heard.samples().count() > 80);
    });
}

#[test]
fn a_command_that_needs_the_front_end_takes_it_back_from_the_host() {
    let gain = Request::ReadRegister { address: 4 };
    for request in [Request::Start, Request::SelfTest, gain, Request::SetSource { source: Source::Hardware }] {
        started(Bench::default(), |rig| {
            response_to(rig, raw(0x0011, None));
            assert!(!matches!(rig.ask(request), Outcome::Refused(_)), "{request:?}");
            assert_eq!(rig.front_end().borrow().chip().gain(0), 32, "{request:?}");
        });
    }
}

#[test]
fn no_raw_frame_disturbs_a_stream() {
    started(Bench::default(), |rig| {
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
        assert_eq!(rig.ask(raw(0x0011, None)), refused(Refusal::Streaming));
        rig.run(100);
        assert_eq!(rig.ask(Request::Stop), Outcome::Done);
        assert_eq!((rig.heard.gaps(), rig.wrong_samples(), rig.heard.faults()), (0, 0, vec![]));
    });
}

#[test]
fn raw_frames_show_what_an_empty_socket_reads() {
    for floating in [FloatingBus::High, FloatingBus::Low] {
        let mut world = World::new(FingerConfig::default(), 1);
        let mut rig = Rig::new(&mut world, Bench::default());
        rig.set_faults(Faults { chip_absent: Some(floating), ..Faults::default() });
        rig.run_us(100_000);
        assert_eq!(rig.ask(raw(0, None)), Outcome::RawFrame { bytes: [floating.byte(); 12] });
        assert_eq!(rig.ask(Request::Start), refused(Refusal::NoFrontEnd));
        rig.set_faults(Faults::default());
        rig.run_us(1_300_000);
        assert_eq!(rig.ask(Request::Start), Outcome::Done);
    }
}

/// What the first board shall be asked: `docs/HARDWARE.md`.
#[test]
fn the_status_register_of_a_running_device_tells_when_the_chip_latches_it() {
    started(Bench::default(), |rig| {
        rig.run(100);
        let Outcome::Register { value, .. } = rig.ask(Request::ReadRegister { address: 1 }) else { panic!("no value") };
        let unread = match rig::chip::behaviour(module_path!()).status_latch {
            StatusLatch::FrameStart => 0b11,
            StatusLatch::FrameEnd => 0b00,
        };
        assert_eq!(value & 0b11, unread);
    });
}
