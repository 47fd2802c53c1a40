//! The link over real lines: nothing lost unseen, nothing acted on twice, and back after every mishap.

use std::net::SocketAddr;
use std::time::Duration;

use palpate::finger::Samples;
use palpate::math::random::Draw;
use palpate_device::session::{SessionCounts, SessionOptions};
use palpate_device::simulated::{Config, Line, Pace};
use palpate_device::{Address, Incoming, LinkError, Session};
use palpate_shared::force::ForceMatrix;
use palpate_shared::frame::{FRAME_MAX, encode};
use palpate_shared::sim::{ContactLoad, Faults, FloatingBus, Load};
use palpate_shared::wire::{Checks, EventKind, PROTOCOL, Refusal, Request, RestartReason, Source, Status};
use palpate_tests::rig::{self, Towards};

/// Checks that blocks follow each other, counting what each says is missing before it.
fn assert_in_order(blocks: &[Samples]) {
    for pair in blocks.windows(2) {
        let [a, b] = pair else { unreachable!() };
        assert_eq!(a.first + a.counts.len() as u64 + b.missing_before, b.first);
    }
}

fn tcp_address(device: &palpate_device::simulated::SimulatedDevice) -> SocketAddr {
    let Address::Tcp(host) = device.address() else { panic!("{:?} is not a TCP device", device.address()) };
    host.parse().expect("an address with a port")
}

fn tcp_device(seed: u64) -> std::sync::Arc<palpate_device::simulated::SimulatedDevice> {
    rig::device(seed, Line::Tcp { host: "127.0.0.1:0".to_owned() })
}

#[test]
fn samples_arrive_complete_and_in_order_over_every_kind_of_line() {
    for line in [rig::real_line(), Line::Pipe, Line::Tcp { host: "127.0.0.1:0".to_owned() }] {
        let device = rig::device(1, line);
        let mut session = rig::session(&device);
        session.start().unwrap();
        let blocks = rig::samples(&mut session, 20_000);
        assert_in_order(&blocks);
        let counts = session.counts();
        assert_eq!((counts.missing, counts.repeated, counts.damaged_frames), (0, 0, 0), "{counts:?}");
        assert!(blocks.iter().all(|block| block.status.contains(Status::SIMULATED)));
        assert!(session.is_simulated());
    }
}

#[test]
fn the_same_seed_gives_the_same_samples_over_any_line() {
    let [one, two] = [rig::real_line(), Line::Pipe].map(|line| {
        let device = rig::device(7, line);
        let mut session = rig::session(&device);
        // The first sample that is streamed depends on when the host says so; from its number on all are the same.
        session.start().unwrap();
        rig::samples(&mut session, 4000)
    });
    let flat = |blocks: &[Samples]| -> Vec<_> { blocks.iter().flat_map(|block| block.counts.clone()).collect() };
    let time = |blocks: &[Samples]| blocks[0].time_us / 250;
    let (one_at, two_at) = (time(&one), time(&two));
    let (one, two) = (flat(&one), flat(&two));
    let later = one_at.max(two_at);
    let skip = |at: u64| usize::try_from(later - at).unwrap();
    let (one, two) = (&one[skip(one_at)..], &two[skip(two_at)..]);
    let common = one.len().min(two.len());
    assert!(common > 1000, "{common} samples in common");
    assert_eq!(one[..common], two[..common]);
}

#[test]
fn noise_on_the_line_costs_frames_but_never_the_place() {
    let device = rig::device(2, rig::real_line());
    let mut session = rig::session(&device);
    session.start().unwrap();
    let mut blocks = rig::samples(&mut session, 100);
    for round in 0..50_u8 {
        // Bytes without and with delimiters, and one run longer than any frame.
        let noise: Vec<u8> = (0..u32::from(round) * 9)
            .map(|i| (i.wrapping_mul(u32::from(round) * 37 + 11) >> 3).to_le_bytes()[0])
            .collect();
        device.disturb(noise).unwrap();
        blocks.extend(rig::samples(&mut session, 64));
    }
    blocks.extend(rig::samples(&mut session, 5000));
    assert_in_order(&blocks);
    let counts = session.counts();
    assert!(counts.damaged_frames > 0, "{counts:?}");
    let received: u64 = blocks.iter().map(|block| block.counts.len() as u64).sum();
    let span = blocks.last().map_or(0, |last| last.first + last.counts.len() as u64) - blocks[0].first;
    assert_eq!(received + counts.missing, span, "every missing sample is counted");
    assert!(counts.missing <= 8 * 8 * 50, "noise costs the frames that it hits: {counts:?}");
}

#[test]
fn a_cable_that_comes_back_is_noticed_and_the_gap_is_counted() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("finger");
    let lines = [Line::Pipe, if cfg!(unix) { Line::Pty { link: Some(link) } } else { Line::Pipe }];
    for line in lines {
        let device = rig::device_of(Config { seed: 3, line, pace: Pace::RealTime, ..Config::default() });
        let mut session = rig::session(&device);
        session.start().unwrap();
        let before = rig::samples(&mut session, 400);
        let out = device.unplug().unwrap();
        rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Disconnected { .. }).then_some(()));
        std::thread::sleep(Duration::from_millis(200));
        let back = device.plug_in().unwrap();
        rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Reconnected { .. }).then_some(()));
        let after = rig::samples(&mut session, 400);
        let counts = session.counts();
        assert_eq!((counts.disconnections, counts.restarts), (1, 0));
        // At least what was converted while the cable was out: some 800 samples, by the device's own count. A block may
        // have been under way.
        let while_out = back.conversion - out.conversion;
        assert!(while_out > 100 && counts.missing + 8 >= while_out, "{counts:?} {while_out}");
        let span = after.last().map_or(0, |last| last.first + last.counts.len() as u64) - before[0].first;
        assert_eq!(counts.samples + counts.missing, span, "{counts:?}");
    }
}

#[test]
fn a_device_that_restarts_gets_its_settings_back() {
    let device = rig::device(4, rig::real_line());
    let mut session = rig::session(&device);
    session.set_rate(2000).unwrap();
    session.set_gain(16).unwrap();
    session.start().unwrap();
    rig::samples(&mut session, 100);
    device.restart().unwrap();
    let hello = rig::wait_for(&mut session, |incoming| match incoming {
        Incoming::Restarted(hello) => Some(hello),
        _ => None,
    });
    assert_eq!((hello.restart, hello.restarts), (RestartReason::Requested, 1));
    let blocks = rig::samples(&mut session, 100);
    assert_in_order(&blocks);
    assert_eq!((session.hello().rate_hz, session.hello().gain), (2000, 16));
    assert_eq!(session.counts().restarts, 1);
}

#[test]
fn a_device_that_is_left_to_its_loader_answers_and_is_silent_until_it_restarts() {
    let device = rig::device(4, rig::real_line());
    let mut session = rig::session(&device);
    session.set_rate(2000).unwrap();
    session.start().unwrap();
    rig::samples(&mut session, 100);
    session.enter_loader().unwrap();
    rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Silent { .. }).then_some(()));
    assert!(matches!(session.ping(), Err(LinkError::Unanswered { .. })), "a loader knows no ping");
    device.restart().unwrap();
    rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Restarted(_)).then_some(()));
    rig::samples(&mut session, 100);
    assert_eq!(session.hello().rate_hz, 2000);
    // By its own, as a board that is asked to.
    session.reboot().unwrap();
    rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Restarted(_)).then_some(()));
    assert_eq!((session.hello().restart, session.hello().restarts), (RestartReason::Requested, 2));
}

#[test]
fn a_matrix_that_is_stored_outlives_restarts_and_no_other_does() {
    let device = rig::device(5, Line::Pipe);
    let mut session = rig::session(&device);
    let matrix = |tare| ForceMatrix::new([[-37.45e-6, 1e-6], [0.0, 37e-6]], [tare, 0.0]).unwrap();
    let give = |session: &mut Session, matrix: ForceMatrix| {
        session.request(Request::SetForceMatrix { matrix, checksum: matrix.checksum() }).unwrap();
    };
    let restart = |session: &mut Session| {
        device.restart().unwrap();
        rig::wait_for(session, |incoming| matches!(incoming, Incoming::Restarted(_)).then_some(()));
        session.device_matrix().unwrap()
    };
    assert_eq!(session.device_matrix().unwrap(), None);
    give(&mut session, matrix(100.0));
    assert!(session.store_device_matrix(true).unwrap() > Duration::ZERO);
    give(&mut session, matrix(200.0));
    assert_eq!(session.device_matrix().unwrap(), Some(matrix(200.0)));
    assert_eq!(restart(&mut session), Some(matrix(100.0)), "the one that was stored");
    session.start().unwrap();
    rig::samples(&mut session, 100);
    let refused = session.store_device_matrix(false).unwrap_err();
    assert!(matches!(refused, LinkError::Refused { refusal: Refusal::Streaming, .. }), "{refused}");
    session.stop().unwrap();
    session.store_device_matrix(false).unwrap();
    assert_eq!(restart(&mut session), None);
}

#[test]
fn time_goes_on_over_a_restart() {
    let device = rig::device(13, rig::real_line());
    let mut session = rig::session(&device);
    session.start().unwrap();
    let before = rig::samples(&mut session, 20_000);
    device.restart().unwrap();
    rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Restarted(_)).then_some(()));
    let after = rig::samples(&mut session, 1000);
    let times: Vec<u64> = before.iter().chain(&after).map(|block| block.time_us).collect();
    assert!(times.is_sorted(), "a monitor that waits for its next line must not wait for an old time to come round");
}

#[cfg(unix)]
#[test]
fn another_finger_on_the_same_port_is_not_taken_for_the_first() {
    let folder = tempfile::tempdir().unwrap();
    let link = folder.path().join("finger");
    let line = Line::Pty { link: Some(link.clone()) };
    let first = rig::device(14, line.clone());
    let mut session = Session::open(first.address(), SessionOptions::default()).unwrap();
    session.start().unwrap();
    rig::samples(&mut session, 100);
    drop(first);
    rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Disconnected { .. }).then_some(()));
    let _second = rig::device(15, line);
    let begun = std::time::Instant::now();
    let error = loop {
        match session.next(Duration::from_millis(100)) {
            Ok(Some(Incoming::Samples(_))) => panic!("samples of another finger"),
            Ok(_) => assert!(begun.elapsed() < rig::PATIENCE),
            Err(error) => break error,
        }
    };
    assert!(matches!(error, LinkError::OtherDevice { .. }), "{error:?}");
}

#[test]
fn a_lost_command_is_repeated_and_acted_on_once() {
    let device = tcp_device(5);
    // Every second command is lost on its way, and every second reply: each needs two or three tries. (Blocks carry the
    // same first byte as commands, but none are streamed here.)
    let line = rig::lossy_line(tcp_address(&device), |towards, number| match towards {
        Towards::Device => number % 2 == 1,
        Towards::Host => number % 2 == 1,
    });
    let mut session = rig::open_tcp(line).unwrap();
    session.set_rate(1000).unwrap();
    session.set_gain(64).unwrap();
    let counters = session.device_counters().unwrap();
    assert_eq!((session.hello().rate_hz, session.hello().gain), (1000, 64));
    assert!(session.counts().commands_repeated > 0);
    assert!(counters.commands_repeated > 0, "a reply was lost, so the device heard a command again: {counters:?}");
    // Hello, rate, hello, gain, hello, counters: six commands were acted on, whatever was repeated.
    assert_eq!(counters.commands - counters.commands_repeated, 6, "{counters:?}");
}

#[test]
fn every_command_is_answered_while_samples_stream() {
    let device = rig::device(6, rig::real_line());
    let mut session = rig::session(&device);
    session.start().unwrap();
    let mut blocks = rig::samples(&mut session, 1000);
    assert_eq!(session.read_register(0).unwrap() >> 8, 0x22, "the ID of the ADS131 family with two channels");
    let test = session.self_test().unwrap();
    assert_eq!(test.failed, Checks::default(), "{test:?}");
    for (check, words) in Checks::ALL {
        assert!(test.checked.contains(check), "{words} is checked while streaming");
    }
    session.ping().unwrap();
    session.request(Request::Hello).unwrap();
    session.start().unwrap();
    blocks.extend(rig::samples(&mut session, 1000));
    let counters = session.device_counters().unwrap();
    assert_eq!(counters.samples_missed + counters.samples_damaged + counters.samples_dropped, 0, "{counters:?}");
    session.stop().unwrap();
    while let Some(incoming) = session.next(Duration::from_millis(100)).unwrap() {
        if let Incoming::Samples(block) = incoming {
            blocks.push(block);
        }
    }
    assert_in_order(&blocks);
    assert_eq!(session.counts().missing, 0, "commands cost no sample");
}

/// What a host hears that presses, sets the rate and stops between samples, and dawdles at random in between.
fn heard_at_the_hosts_leisure(line: Line, mut dawdle: impl FnMut()) -> Vec<Samples> {
    let device = rig::device_of(Config { seed: 21, line, pace: Pace::AsAsked, ..Config::default() });
    let mut session = rig::session(&device);
    dawdle();
    session.set_rate(2000).unwrap();
    let mut heard = Vec::new();
    for newtons in [1.0, 2.0] {
        device.set_load(Load::Static(ContactLoad::frictionless(0.3, newtons))).unwrap();
        dawdle();
        session.start().unwrap();
        dawdle();
        heard.extend(rig::samples(&mut session, 100));
        device.set_load(Load::Released).unwrap();
        dawdle();
        heard.extend(rig::samples(&mut session, 1500));
        dawdle();
        session.stop().unwrap();
        session.forget_waiting();
    }
    heard
}

/// Samples, their numbers, times and marks: the simulated device's time does not pass but when its host waits for it.
#[test]
fn a_device_whose_time_its_host_asks_for_repeats_to_the_digit() {
    let hasty = heard_at_the_hosts_leisure(Line::Pipe, || ());
    let mut draw = Draw::new(5);
    for line in [rig::real_line(), Line::Pipe] {
        let slow = heard_at_the_hosts_leisure(line, || {
            std::thread::sleep(Duration::from_secs_f64(draw.uniform(0.0, 0.05)));
        });
        let as_text = |blocks: &[Samples]| blocks.iter().map(|block| format!("{block:?}")).collect::<Vec<_>>();
        assert_eq!(as_text(&slow), as_text(&hasty));
    }
}

#[test]
fn refusals_say_what_is_possible() {
    let device = rig::device(7, Line::Pipe);
    let mut session = rig::session(&device);
    let refusal = |result: Result<(), LinkError>| match result {
        Err(LinkError::Refused { refusal, .. }) => refusal,
        other => panic!("not refused: {other:?}"),
    };
    assert!(matches!(refusal(session.set_rate(3000)), Refusal::RateNotPossible { fastest_hz: 8000, .. }));
    assert_eq!(refusal(session.set_gain(3)), Refusal::GainNotPossible { largest: 128 });
    assert_eq!(refusal(session.read_register(0x7F).map(drop)), Refusal::AddressNotPossible { last: 0x3F });
    assert_eq!(refusal(session.set_source(Source::Hardware)), Refusal::SourceNotPossible);
    assert_eq!(session.device_counters().unwrap().commands_refused, 4);
}

#[test]
fn a_slow_line_refuses_the_rate_that_it_cannot_carry() {
    let device = rig::device_of(Config { seed: 8, baud: Some(115_200), pace: Pace::AsRead, ..Config::default() });
    let mut session = rig::session(&device);
    let Err(LinkError::Refused { refusal: Refusal::LinkTooSlow { fastest_hz }, .. }) = session.set_rate(4000) else {
        panic!("4 kHz does not go through 115,200 baud")
    };
    assert_eq!(session.hello().rate_hz, fastest_hz, "it starts with what the line carries");
    session.start().unwrap();
    rig::samples(&mut session, 2000);
    assert_eq!(session.counts().missing, 0);
}

#[test]
fn without_a_front_end_nothing_is_streamed_and_the_reason_is_told() {
    let faults = Faults { chip_absent: Some(FloatingBus::High), ..Faults::default() };
    let device = rig::device_of(Config { seed: 9, faults, pace: Pace::AsRead, ..Config::default() });
    let mut session = rig::session(&device);
    assert_eq!(session.hello().front_end.id_word, 0);
    let Err(LinkError::Refused { refusal, .. }) = session.start() else { panic!("there is nothing to stream") };
    assert_eq!(refusal, Refusal::NoFrontEnd);
    let kind = rig::wait_for(&mut session, |incoming| match incoming {
        Incoming::Event(event) => Some(event.kind),
        _ => None,
    });
    assert_eq!(kind, EventKind::FrontEndMissing { id_word: 0xFFFF });
    assert_eq!(session.counts(), SessionCounts::default(), "no sample, no loss");
}

#[test]
fn a_front_end_that_falls_silent_is_told_and_so_is_its_return() {
    let device = rig::device(10, rig::real_line());
    let mut session = rig::session(&device);
    session.start().unwrap();
    rig::samples(&mut session, 100);
    device.set_faults(Faults { data_ready_stuck: true, ..Faults::default() }).unwrap();
    let event = |incoming| match incoming {
        Incoming::Event(event) => Some(event.kind),
        _ => None,
    };
    assert!(matches!(rig::wait_for(&mut session, event), EventKind::FrontEndSilent { .. }));
    // The host notices by itself too, on its own clock, and says so once.
    let silent = |incoming| match incoming {
        Incoming::Silent { after } => Some(after),
        _ => None,
    };
    assert!(rig::wait_for(&mut session, silent) >= Duration::from_millis(100));
    assert!(session.next(Duration::from_millis(300)).unwrap().and_then(silent).is_none(), "it is told once");
    device.set_faults(Faults::default()).unwrap();
    assert_eq!(rig::wait_for(&mut session, event), EventKind::FrontEndRecovered);
    rig::samples(&mut session, 100);
    // And again, if it happens again.
    device.set_faults(Faults { data_ready_stuck: true, ..Faults::default() }).unwrap();
    rig::wait_for(&mut session, silent);
}

/// A chip that is back announces data all the time, so nothing may wait for a moment without any.
#[test]
fn a_front_end_that_was_absent_is_found_again() {
    let device = rig::device(16, Line::Pipe);
    let mut session = rig::session(&device);
    session.start().unwrap();
    rig::samples(&mut session, 100);
    let event = |incoming| match incoming {
        Incoming::Event(event) => Some(event.kind),
        _ => None,
    };
    let away = Faults { chip_absent: Some(FloatingBus::High), ..Faults::default() };
    // On a damaged bus it takes a few tries.
    for (floating, back) in [(away, Faults::default()), (away, Faults { bit_error_rate: 1e-3, ..Faults::default() })] {
        device.set_faults(floating).unwrap();
        let missing = |incoming| event(incoming).filter(|kind| matches!(kind, EventKind::FrontEndMissing { .. }));
        rig::wait_for(&mut session, missing);
        device.set_faults(back).unwrap();
        let found = |incoming| event(incoming).filter(|kind| *kind == EventKind::FrontEndRecovered);
        rig::wait_for(&mut session, found);
        rig::samples(&mut session, 1000);
    }
}

#[test]
fn damage_on_the_front_ends_bus_loses_samples_that_are_all_counted() {
    let device = rig::device(11, rig::real_line());
    let mut session = rig::session(&device);
    session.start().unwrap();
    rig::samples(&mut session, 100);
    // A bit in two thousand: of 192 bits on the bus for a sample, one in eleven frames is hit.
    device.set_faults(Faults { bit_error_rate: 5e-4, ..Faults::default() }).unwrap();
    rig::samples(&mut session, 20_000);
    device.set_faults(Faults::default()).unwrap();
    rig::samples(&mut session, 2000);
    session.stop().unwrap();
    while session.next(Duration::from_millis(100)).unwrap().is_some() {}
    let (counts, counters) = (session.counts(), session.device_counters().unwrap());
    let lost = counters.samples_missed + counters.samples_damaged + counters.samples_dropped;
    assert!(counters.samples_damaged > 500, "{counters:?}");
    assert_eq!(counts.missing, u64::from(lost), "{counters:?}");
}

#[test]
fn a_peer_of_another_major_version_is_refused_with_both_versions() {
    let hello = |major: u8| encode(&[0_u8, major, 3, 0, 0, 0], &mut [0; FRAME_MAX + 1]).unwrap().to_vec();
    for major in [PROTOCOL.major + 1, PROTOCOL.major - 1] {
        let address = rig::peer_that_says(hello(major));
        let error = rig::open_tcp(address).map(drop).unwrap_err();
        let LinkError::OtherProtocol { device, host } = error else { panic!("{error:?}") };
        assert_eq!((device.major, host), (major, PROTOCOL));
    }
}

#[test]
fn a_peer_that_says_nothing_sensible_is_told_from_one_that_is_not_there() {
    let chatter = rig::peer_that_says(b"login: \x00\x00garbage\x00more\x00".to_vec());
    let Err(LinkError::NoAnswer { damaged, .. }) = rig::open_tcp(chatter).map(drop) else { panic!("no device") };
    assert!(damaged > 0);
    let nobody: SocketAddr = "127.0.0.1:1".parse().unwrap();
    assert!(matches!(rig::open_tcp(nobody).map(drop), Err(LinkError::Open { .. })));
}

#[cfg(unix)]
#[test]
fn a_port_in_use_is_named_as_such() {
    let device = rig::device(12, Line::Pty { link: None });
    let _first = rig::session(&device);
    let second = Session::open(device.address(), SessionOptions::default()).map(drop);
    let Err(LinkError::Busy { path, .. }) = second else { panic!("the port is taken: {second:?}") };
    assert_eq!(path, device.address().to_string());
}

#[test]
fn a_port_that_is_not_there_is_named_with_those_that_are() {
    let address: Address = "/dev/there-is-no-such-port".parse().unwrap();
    let error = Session::open(&address, SessionOptions::default()).map(drop).unwrap_err();
    assert!(matches!(&error, LinkError::NoSuchPort { path, .. } if path.ends_with("no-such-port")), "{error:?}");
}

#[test]
fn digital_inputs_arrive_on_the_time_line_of_the_samples() {
    let device = rig::device(11, Line::Pipe);
    let mut session = rig::session(&device);
    device.set_inputs(0x80).unwrap();
    session.start().unwrap();
    let inputs = |incoming| if let Incoming::Inputs(inputs) = incoming { Some(inputs) } else { None };
    let first = rig::wait_for(&mut session, inputs);
    assert_eq!((first.levels, first.changes), (0x80, 0));
    rig::samples(&mut session, 2000);
    let moment = device.set_inputs(0x81).unwrap();
    let second = rig::wait_for(&mut session, inputs);
    assert_eq!((second.levels, second.changes), (0x81, 1));
    // The sample after the order saw it; the device's clock counts its conversions of 250 µs.
    assert_eq!(second.time_us, (moment.conversion + 1) * 250);
    assert_eq!(session.inputs(), Some(second));
}
