//! Devices that restart, change their settings or count wrongly: no sample of which it is not known what it means is
//! handed on, and what is lost is counted.

use std::sync::Mutex;
use std::time::{Duration, Instant};

use palpate_device::session::{SessionOptions, Settings};
use palpate_device::simulated::Line;
use palpate_device::{Incoming, LinkError, Session};
use palpate_shared::units::{Counts, DeviceTime, Seq};
use palpate_shared::wire::{
    Axis, Block, Bridge, Channel, ClockSource, Command, Counters, DeviceId, FirmwareVersion, FromDevice, FrontEnd,
    FrontEndKind, Hello, Outcome, PROTOCOL, ProtocolVersion, Refusal, Reply, Request, RestartReason, Source, Status,
};
use palpate_tests::newer::{frame_of, payload_of};
use palpate_tests::rig::{self, Peer};

fn hello() -> Hello {
    Hello {
        protocol: PROTOCOL,
        firmware: FirmwareVersion { major: 0, minor: 2, patch: 0 },
        device: DeviceId(*b"strange-peer"),
        board: "a peer".try_into().unwrap(),
        front_end: FrontEnd { kind: FrontEndKind::Ads131m02, id_word: 0x2283 },
        channels: [Axis::X, Axis::Y].map(|axis| Channel { axis, bridge: Bridge::Half }),
        rate_hz: 4000,
        gain: 32,
        full_scale_uv: 1_200_000,
        excitation_mv: 2500,
        source: Source::Hardware,
        clock: ClockSource::Crystal,
        link_baud: 0,
        restart: RestartReason::PowerOn,
        restarts: 0,
        streaming: false,
    }
}

fn reply(command: &Command, outcome: Outcome) -> Vec<u8> {
    frame_of(&payload_of(&FromDevice::Reply(Reply { id: command.id, outcome })))
}

fn unasked(hello: Hello) -> Vec<u8> {
    frame_of(&payload_of(&FromDevice::Hello(hello)))
}

/// Blocks of eight samples with these first numbers, 250 µs a sample from the device's start, whose counts are their
/// numbers.
fn blocks(numbers: impl IntoIterator<Item = u32>) -> Vec<u8> {
    let block = |first: u32| {
        let samples = (first..first + 8).map(|number| [Counts(number.cast_signed()), Counts(0)]).collect();
        let (seq, time) = (Seq(first), DeviceTime(1000 + first * 250));
        frame_of(&payload_of(&FromDevice::Block(Block { first: seq, time, status: Status::default(), samples })))
    };
    numbers.into_iter().flat_map(block).collect()
}

/// A peer that answers a command with these frames, given how many other commands of its kind came before it.
fn peer(answer: impl Fn(&Command, usize) -> Vec<u8> + Send + 'static) -> Peer {
    let heard: Mutex<Vec<Command>> = Mutex::default();
    Peer::that_answers(move |_, command| {
        let mut heard = heard.lock().unwrap();
        let is_alike = |other: &&Command| {
            std::mem::discriminant(&other.request) == std::mem::discriminant(&command.request) && other.id != command.id
        };
        // A repetition stands where its first time stood.
        let at = heard.iter().position(|other| other.id == command.id).unwrap_or(heard.len());
        let before = heard[..at].iter().filter(is_alike).count();
        heard.push(*command);
        Some(answer(command, before))
    })
}

/// What a device that is set like this answers to what it is not otherwise to answer.
fn obedient(command: &Command, hello: Hello) -> Vec<u8> {
    let outcome = match command.request {
        Request::Hello => Outcome::Hello(hello),
        Request::Counters => Outcome::Counters(Counters::default()),
        _ => Outcome::Done,
    };
    reply(command, outcome)
}

fn open(peer: &Peer) -> Session {
    let address = format!("tcp:{}", peer.address).parse().unwrap();
    Session::open(&address, SessionOptions::default()).unwrap()
}

/// All that comes until `count` samples are there.
fn until(session: &mut Session, count: u64) -> Vec<Incoming> {
    let (begun, mut all) = (Instant::now(), Vec::new());
    while session.counts().samples < count {
        assert!(begun.elapsed() < rig::PATIENCE, "{:?}", session.counts());
        all.extend(session.next(Duration::from_millis(50)).unwrap());
    }
    all
}

/// The error with which a session ends.
fn end_of(session: &mut Session) -> LinkError {
    let begun = Instant::now();
    loop {
        assert!(begun.elapsed() < rig::PATIENCE);
        match session.next(Duration::from_millis(50)) {
            Ok(Some(Incoming::Samples(samples))) => {
                panic!("samples of a device that is not set as before: {samples:?}")
            }
            Ok(_) => {}
            Err(error) => return error,
        }
    }
}

#[test]
fn a_restarted_device_gets_the_settings_that_the_session_never_set() {
    let device = rig::device(30, Line::Pipe);
    let mut first = rig::session(&device);
    first.set_gain(64).unwrap();
    first.set_rate(2000).unwrap();
    drop(first);
    let mut session = rig::session(&device);
    let before = Settings::of(session.hello());
    assert_eq!((before.gain, before.rate_hz), (64, 2000));
    session.start().unwrap();
    rig::samples(&mut session, 100);
    device.restart().unwrap();
    let hello = rig::wait_for(&mut session, |incoming| match incoming {
        Incoming::Restarted(hello) => Some(hello),
        Incoming::Samples(samples) => {
            assert!((samples.period_us - 500.0).abs() < 1e-9);
            None
        }
        _ => None,
    });
    assert_eq!((hello.gain, hello.rate_hz), (32, 4000), "as it started");
    rig::samples(&mut session, 100);
    assert_eq!(Settings::of(session.hello()), before);
    assert_eq!(session.read_register(4).unwrap(), 0x66, "gain 64 in both channels");
}

#[test]
fn a_session_ends_with_both_settings_where_a_restarted_device_does_not_take_its_own() {
    let other = |gain, rate_hz, source| Hello { gain, rate_hz, source, restarts: 1, ..hello() };
    let cases = [
        (other(64, 4000, Source::Hardware), "4000 Hz, gain 64, own front-end"),
        (other(1, 4000, Source::Hardware), "4000 Hz, gain 1, own front-end"),
        (other(32, 2000, Source::Hardware), "2000 Hz, gain 32, own front-end"),
        (other(32, 4000, Source::Simulated), "4000 Hz, gain 32, simulated finger"),
    ];
    for refuses in [true, false] {
        for (restarted, words) in cases.clone() {
            let peer = peer(move |command, before| match command.request {
                Request::Start => {
                    [reply(command, Outcome::Done), unasked(restarted.clone()), blocks([0, 8, 16])].concat()
                }
                Request::SetGain { .. } | Request::SetRate { .. } | Request::SetSource { .. } if refuses => {
                    reply(command, Outcome::Refused(Refusal::FrontEndSilent))
                }
                Request::Hello if before > 0 => reply(command, Outcome::Hello(restarted.clone())),
                _ => obedient(command, hello()),
            });
            let mut session = open(&peer);
            session.start().unwrap();
            let error = end_of(&mut session);
            let LinkError::OtherSettings { was, is, refusal } = &error else { panic!("{error:?}") };
            assert_eq!((was.gain, was.rate_hz, was.source), (32, 4000, Source::Hardware));
            assert_eq!((is.to_string().as_str(), refusal.is_some()), (words, refuses));
            let said = error.to_string();
            assert!(said.contains(words) && said.contains("4000 Hz, gain 32, own front-end"), "{said}");
        }
    }
}

/// Another host set the gain while the cable was out, and left.
#[test]
fn a_device_that_another_host_has_set_otherwise_is_set_back() {
    let device = rig::device(31, rig::real_line());
    let mut session = rig::session(&device);
    session.start().unwrap();
    rig::samples(&mut session, 100);
    device.unplug().unwrap();
    rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Disconnected { .. }).then_some(()));
    device.plug_in().unwrap();
    let mut other = Session::open(device.address(), SessionOptions::default()).unwrap();
    other.set_gain(1).unwrap();
    drop(other);
    rig::wait_for(&mut session, |incoming| matches!(incoming, Incoming::Restarted(_)).then_some(()));
    rig::samples(&mut session, 100);
    assert_eq!((session.hello().gain, session.read_register(4).unwrap()), (32, 0x55));
}

#[test]
fn what_is_lost_before_the_first_block_is_counted() {
    // An earlier host had 5000 samples; 16 of this session's are lost, and after the restart 800.
    let peer = peer(|command, before| match (command.request, before) {
        (Request::Counters, _) => reply(command, Outcome::Counters(Counters { samples: 5000, ..Counters::default() })),
        (Request::Start, 0) => {
            [reply(command, Outcome::Done), blocks([5016]), unasked(Hello { restarts: 1, ..hello() })].concat()
        }
        (Request::Start, _) => [reply(command, Outcome::Done), blocks([800, 808])].concat(),
        (Request::Hello, 0) => reply(command, Outcome::Hello(hello())),
        _ => obedient(command, Hello { restarts: 1, ..hello() }),
    });
    let mut session = open(&peer);
    session.start().unwrap();
    let missing: Vec<u64> = until(&mut session, 24)
        .into_iter()
        .filter_map(
            |incoming| if let Incoming::Samples(samples) = incoming { Some(samples.missing_before) } else { None },
        )
        .collect();
    assert_eq!(missing, [16, 800, 0]);
    let counts = session.counts();
    assert_eq!((counts.samples, counts.missing, counts.restarts), (24, 816, 1), "{counts:?}");
}

/// The hello of a restart was lost, and another host began to stream before this one noticed.
#[test]
fn a_device_that_counts_anew_without_a_hello_is_asked_and_goes_on() {
    let anew = || Hello { gain: 1, streaming: true, restarts: 1, ..hello() };
    let peer = peer(move |command, before| match (command.request, before) {
        (Request::Start, 0) => {
            let counted = (0..24_000).step_by(8).chain((0..4000).step_by(8));
            [reply(command, Outcome::Done), blocks(counted)].concat()
        }
        (Request::Start, _) => [reply(command, Outcome::Done), blocks((4000..28_000).step_by(8))].concat(),
        (Request::Hello, 0) => reply(command, Outcome::Hello(hello())),
        (Request::Hello, 1) => reply(command, Outcome::Hello(anew())),
        _ => obedient(command, Hello { gain: 32, ..anew() }),
    });
    let mut session = open(&peer);
    session.start().unwrap();
    for incoming in until(&mut session, 48_000) {
        let Incoming::Samples(samples) = incoming else { continue };
        assert!(samples.first < 24_000 || samples.first >= 4000);
        assert_eq!(u64::try_from(samples.counts[0][0].0).unwrap(), samples.first);
    }
    let counts = session.counts();
    assert_eq!((counts.missing, counts.repeated, counts.restarts), (4000, 0, 1), "{counts:?}");
    assert!(peer.requests().contains(&Request::SetGain { gain: 32 }), "{:?}", peer.requests());
}

#[test]
fn a_block_with_a_number_far_ahead_costs_itself_alone() {
    let peer = peer(|command, _| match command.request {
        Request::Start => {
            let stray = payload_of(&FromDevice::Block(Block {
                first: Seq((1 << 31) - 1 + 800),
                time: DeviceTime(201_000),
                status: Status::default(),
                samples: [[Counts(-1); 2]; 8].into_iter().collect(),
            }));
            let before = blocks((0..800).step_by(8));
            [reply(command, Outcome::Done), before, frame_of(&stray), blocks((808..25_000).step_by(8))].concat()
        }
        _ => obedient(command, hello()),
    });
    let mut session = open(&peer);
    session.start().unwrap();
    until(&mut session, 24_992);
    let counts = session.counts();
    assert_eq!((counts.missing, counts.repeated, counts.damaged_frames, counts.restarts), (8, 0, 1, 0), "{counts:?}");
}

#[test]
fn a_hello_of_another_major_version_is_refused_in_a_reply_too() {
    for major in [PROTOCOL.major + 1, PROTOCOL.major - 1] {
        let other = Hello { protocol: ProtocolVersion { major, minor: 3 }, ..hello() };
        let peer = peer(move |command, _| obedient(command, other.clone()));
        let error = rig::open_tcp(peer.address).map(drop).unwrap_err();
        let LinkError::OtherProtocol { device, host } = error else { panic!("{error:?}") };
        assert_eq!((device.major, host), (major, PROTOCOL));
    }
}

#[test]
fn messages_without_sense_count_as_damage_where_nobody_answers() {
    // Three replies that end before their outcome.
    let chatter = rig::peer_that_says([vec![0], frame_of(&[3, 7]).repeat(3)].concat());
    let Err(LinkError::NoAnswer { damaged, .. }) = rig::open_tcp(chatter).map(drop) else { panic!("no device") };
    assert_eq!(damaged, 3);
}

#[test]
fn a_boards_name_cannot_steer_the_terminal() {
    let named = Hello { board: "\u{1b}]0;owned\u{7}\u{1b}[31mred".try_into().unwrap(), ..hello() };
    let peer = peer(move |command, _| obedient(command, named.clone()));
    assert_eq!(open(&peer).hello().board.as_str(), "?]0;owned??[31mred");
}
