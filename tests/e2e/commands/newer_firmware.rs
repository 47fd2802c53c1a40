//! A device of a newer minor version: what it says that this version does not know is counted as such, never taken
//! for damage, and told with the remedy.

#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::time::{Duration, Instant};

use palpate_device::session::SessionOptions;
use palpate_device::wire_reader::{MessageReader, ReaderCounts};
use palpate_device::{Incoming, LinkError, Session};
use palpate_shared::units::{Counts, DeviceTime, Seq};
use palpate_shared::wire::{
    Axis, BLOCK_SAMPLES, Block, Bridge, Channel, Checks, ClockSource, Command, CommandId, CommandRead, Counters,
    DecodeError, DeviceId, Event, EventKind, Failure, Fault, FaultCause, FirmwareVersion, FromDevice, FrontEnd,
    FrontEndKind, Health, Hello, NewerMessage, Outcome, PROTOCOL, ProtocolVersion, RAW_FRAME_BYTES, Refusal, Reply,
    Request, RestartReason, SelfTest, Source, Status, Temperature,
};
use palpate_tests::newer::{frame_of, numbers_in_command, numbers_in_message, payload_of, with_newer};
use palpate_tests::rig::{self, Peer};
use proptest::prelude::*;
use proptest::sample::select;

/// The version that the devices here speak.
const NEWER: ProtocolVersion = ProtocolVersion { major: PROTOCOL.major, minor: PROTOCOL.minor + 1 };

fn hello() -> Hello {
    Hello {
        protocol: NEWER,
        firmware: FirmwareVersion { major: 0, minor: 9, patch: 0 },
        device: DeviceId(*b"newer-device"),
        board: "newer board".try_into().unwrap(),
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

/// The payload of a reply.
fn reply(id: CommandId, outcome: Outcome) -> Vec<u8> {
    payload_of(&FromDevice::Reply(Reply { id, outcome }))
}

/// What a device that does all it is asked to answers.
fn obedient(command: &Command) -> Vec<u8> {
    let outcome = match command.request {
        Request::Hello => Outcome::Hello(hello()),
        Request::Ping => Outcome::Pong { time: DeviceTime(1) },
        Request::LastFault => Outcome::LastFault(Some(fault())),
        Request::SetRate { .. } => Outcome::Refused(Refusal::Busy),
        _ => Outcome::Done,
    };
    reply(command.id, outcome)
}

fn fault() -> Fault {
    Fault {
        cause: FaultCause::Panic,
        uptime_s: 60,
        samples: 4000,
        program_counter: 0,
        return_address: 0,
        fault_status: 0,
        place: "main.rs:7".try_into().unwrap(),
    }
}

/// A device that answers `to` with a number of the enum `of` that this version does not know, and all else as usual.
fn device_that_answers(to: Request, of: &'static str) -> Peer {
    Peer::that_answers(move |_, command| {
        let known = obedient(command);
        Some(frame_of(&if command.request == to { with_newer(&known, of) } else { known }))
    })
}

fn help_of(error: &LinkError) -> String {
    palpate_cli::advice::help(error).unwrap_or_default()
}

/// Waits until the session's reading thread has counted `unknown` messages as unknown; none may count as damaged.
fn assert_unknown(session: &Session, unknown: u64) {
    let begun = Instant::now();
    while session.counts().unknown_messages < unknown && begun.elapsed() < rig::PATIENCE {
        std::thread::sleep(Duration::from_millis(1));
    }
    let counts = session.counts();
    assert_eq!((counts.unknown_messages, counts.damaged_frames), (unknown, 0), "{counts:?}");
}

#[test]
fn a_command_that_is_answered_in_a_newer_way_is_sent_once_and_the_error_says_what_to_update() {
    for (request, of) in [
        (Request::SetRate { rate_hz: 3000 }, "Refusal"),
        (Request::SetGain { gain: 16 }, "Outcome"),
        (Request::LastFault, "FaultCause"),
    ] {
        let device = device_that_answers(request, of);
        let mut session = rig::open_tcp(device.address).unwrap();
        let error = session.request(request).unwrap_err();
        assert!(matches!(error, LinkError::NewerAnswer { .. }), "{of}: {error:?}");
        assert!(error.to_string().contains("in a way that this version does not know"), "{error}");
        let remedy = format!("update palpate: the device speaks protocol {NEWER}, this program {PROTOCOL}");
        assert_eq!(help_of(&error), remedy);
        assert_unknown(&session, 1);
        assert_eq!(session.counts().commands_repeated, 0, "{of}");
        assert_eq!(device.requests(), [Request::Hello, request], "{of}: each was sent once");
        session.ping().unwrap();
        assert_eq!(device.requests(), [Request::Hello, request, Request::Ping], "{of}: it was told once and is over");
    }
}

#[test]
fn a_device_whose_hello_is_newer_is_refused_at_once_with_both_versions_and_the_remedy() {
    for of in ["FrontEndKind", "Axis", "Bridge", "Source", "ClockSource"] {
        let device = device_that_answers(Request::Hello, of);
        let error = rig::open_tcp(device.address).map(drop).unwrap_err();
        assert!(matches!(error, LinkError::NewerHello { device: NEWER, host: PROTOCOL }), "{of}: {error:?}");
        assert!(error.to_string().contains(&format!("protocol {NEWER}, this program {PROTOCOL}")), "{error}");
        assert_eq!(help_of(&error), "update palpate: the firmware is newer");
        assert_eq!(device.requests(), [Request::Hello], "{of}: sent once");
    }
}

#[test]
fn a_device_that_refuses_the_greeting_in_a_newer_way_is_not_asked_again() {
    let device =
        Peer::that_answers(|_, command| Some(frame_of(&with_newer(&reply(command.id, Outcome::Done), "Outcome"))));
    let error = rig::open_tcp(device.address).map(drop).unwrap_err();
    assert!(matches!(error, LinkError::NewerAnswer { .. }), "{error:?}");
    assert_eq!(
        help_of(&error),
        format!("update palpate: the firmware is newer than protocol {PROTOCOL}, which this program speaks")
    );
    assert_eq!(device.requests(), [Request::Hello]);
}

#[test]
fn a_device_that_comes_back_with_a_newer_hello_is_told_and_not_asked_again_and_again() {
    let device = Peer::that_answers(|connection, command| {
        let known = obedient(command);
        match (connection, command.request) {
            (0, Request::Ping) => None,
            (0, _) => Some(frame_of(&known)),
            _ => Some(frame_of(&with_newer(&known, "Source"))),
        }
    });
    let address = format!("tcp:{}", device.address).parse().unwrap();
    let mut session = Session::open(&address, SessionOptions::default()).unwrap();
    assert!(matches!(session.ping(), Err(LinkError::Unplugged { .. } | LinkError::Unanswered { .. })));
    let begun = Instant::now();
    let error = loop {
        assert!(begun.elapsed() < rig::PATIENCE);
        if let Err(error) = session.next(Duration::from_millis(100)) {
            break error;
        }
    };
    assert!(matches!(error, LinkError::NewerHello { device: NEWER, .. }), "{error:?}");
    assert_eq!(device.requests(), [Request::Hello, Request::Ping, Request::Hello]);
}

/// A session with a device that sends these frames before its answer to a ping.
fn session_that_hears(unasked: Vec<u8>) -> (Peer, Session) {
    let device = Peer::that_answers(move |_, command| {
        let answer = frame_of(&obedient(command));
        Some(if command.request == Request::Ping { [unasked.clone(), answer].concat() } else { answer })
    });
    let mut session = rig::open_tcp(device.address).unwrap();
    session.ping().unwrap();
    (device, session)
}

#[test]
fn newer_events_and_messages_are_skipped_and_the_rest_comes_through() {
    let event = |kind| FromDevice::Event(Event { time: DeviceTime(7), kind });
    let newer_event = with_newer(&payload_of(&event(EventKind::FrontEndReset)), "EventKind");
    let newer_message = with_newer(&payload_of(&event(EventKind::FrontEndReset)), "FromDevice");
    let known = payload_of(&event(EventKind::FrontEndRecovered));
    let (_device, mut session) =
        session_that_hears([newer_event, newer_message, known].map(|it| frame_of(&it)).concat());
    let kind = rig::wait_for(&mut session, |incoming| match incoming {
        Incoming::Event(event) => Some(event.kind),
        _ => None,
    });
    assert_eq!(kind, EventKind::FrontEndRecovered);
    assert_unknown(&session, 2);
}

#[test]
fn a_restart_with_a_newer_hello_is_told() {
    let (_device, mut session) =
        session_that_hears(frame_of(&with_newer(&payload_of(&FromDevice::Hello(hello())), "FrontEndKind")));
    let error = session.next(rig::PATIENCE).map(drop).unwrap_err();
    assert!(matches!(error, LinkError::NewerHello { device: NEWER, .. }), "{error:?}");
    assert_unknown(&session, 1);
}

#[test]
fn a_restart_for_a_newer_reason_is_a_restart() {
    let mut unasked = payload_of(&FromDevice::Hello(hello()));
    // Why it started stands before the number of starts and whether it streams, a byte each.
    let at = unasked.len() - 3;
    unasked[at] = 7;
    let (_device, mut session) = session_that_hears(frame_of(&unasked));
    let restarted = rig::wait_for(&mut session, |incoming| match incoming {
        Incoming::Restarted(hello) => Some(hello),
        _ => None,
    });
    assert_eq!(restarted, Hello { restart: RestartReason::Unknown, ..hello() });
    assert_eq!((session.counts().restarts, session.counts().unknown_messages), (1, 0));
}

fn hellos() -> impl Strategy<Value = Hello> {
    let words = (
        any::<u8>(),
        select(&[Axis::X, Axis::Y][..]),
        select(&[Bridge::Half, Bridge::Full][..]),
        select(&[Source::Hardware, Source::Simulated][..]),
        select(&[ClockSource::Crystal, ClockSource::InternalPll, ClockSource::Internal, ClockSource::Host][..]),
    );
    let numbers = (any::<[u8; 12]>(), "[ -~]{0,24}", any::<(u16, u32, u8, u32, u16, u32, u16, bool)>());
    (words, numbers).prop_map(|((minor, axis, bridge, source, clock), (device, board, numbers))| {
        let (id_word, rate_hz, gain, full_scale_uv, excitation_mv, link_baud, restarts, streaming) = numbers;
        Hello {
            protocol: ProtocolVersion { major: PROTOCOL.major, minor },
            device: DeviceId(device),
            board: board.as_str().try_into().unwrap(),
            front_end: FrontEnd { kind: FrontEndKind::Ads131m02, id_word },
            channels: [Channel { axis, bridge }, Channel { axis: Axis::Y, bridge }],
            rate_hz,
            gain,
            full_scale_uv,
            excitation_mv,
            source,
            clock,
            link_baud,
            restarts,
            streaming,
            ..hello()
        }
    })
}

fn events() -> impl Strategy<Value = EventKind> {
    let (a, b) = (any::<u32>, any::<u16>);
    prop_oneof![
        b().prop_map(|id_word| EventKind::FrontEndMissing { id_word }),
        a().prop_map(|quiet_us| EventKind::FrontEndSilent { quiet_us }),
        Just(EventKind::FrontEndRecovered),
        Just(EventKind::FrontEndReset),
        (a(), a(), a()).prop_map(|(missed, damaged, dropped)| EventKind::SamplesLost { missed, damaged, dropped }),
    ]
}

fn refusals() -> impl Strategy<Value = Refusal> {
    prop_oneof![
        any::<(u8, u8)>()
            .prop_map(|(major, minor)| Refusal::OtherProtocol { device: ProtocolVersion { major, minor } }),
        any::<(u32, u32)>().prop_map(|(slowest_hz, fastest_hz)| Refusal::RateNotPossible { slowest_hz, fastest_hz }),
        any::<u32>().prop_map(|fastest_hz| Refusal::LinkTooSlow { fastest_hz }),
        any::<u8>().prop_map(|largest| Refusal::GainNotPossible { largest }),
        any::<u8>().prop_map(|last| Refusal::AddressNotPossible { last }),
        select(
            &[
                Refusal::UnknownRequest,
                Refusal::SourceNotPossible,
                Refusal::NoFrontEnd,
                Refusal::FrontEndSilent,
                Refusal::Busy,
                Refusal::NotOnThisBoard,
                Refusal::Streaming,
                Refusal::MatrixDamaged,
                Refusal::NoForceMatrix,
                Refusal::NotStored
            ][..]
        ),
    ]
}

fn faults() -> impl Strategy<Value = Fault> {
    let causes = &[FaultCause::Panic, FaultCause::Processor, FaultCause::StackOverflow, FaultCause::Hang][..];
    (select(causes), any::<[u32; 5]>(), "[ -~]{0,40}").prop_map(|(cause, numbers, place)| {
        let [uptime_s, samples, program_counter, return_address, fault_status] = numbers;
        let place = place.as_str().try_into().unwrap();
        Fault { cause, uptime_s, samples, program_counter, return_address, fault_status, place }
    })
}

fn outcomes() -> impl Strategy<Value = Outcome> {
    prop_oneof![
        Just(Outcome::Done),
        hellos().prop_map(Outcome::Hello),
        any::<(u8, u16)>().prop_map(|(address, value)| Outcome::Register { address, value }),
        any::<u32>().prop_map(|time| Outcome::Pong { time: DeviceTime(time) }),
        any::<(u16, u16, u16, u16, u32)>().prop_map(|(checked, failed, id_word, status_word, period_ns)| {
            let (checked, failed) = (Checks(checked), Checks(failed));
            Outcome::SelfTest(SelfTest { checked, failed, id_word, status_word, period_ns })
        }),
        any::<u32>().prop_map(|samples| Outcome::Counters(Counters { samples, ..Counters::default() })),
        refusals().prop_map(Outcome::Refused),
        prop::option::of(faults()).prop_map(Outcome::LastFault),
        any::<u32>().prop_map(|core_hz| Outcome::Health(Health { core_hz, ..Health::default() })),
        any::<[u8; RAW_FRAME_BYTES]>().prop_map(|bytes| Outcome::RawFrame { bytes }),
    ]
}

fn blocks() -> impl Strategy<Value = Block> {
    let samples = prop::collection::vec(any::<(i32, i32)>(), 0..=BLOCK_SAMPLES);
    (any::<(u32, u32, u16)>(), samples).prop_map(|((first, time, status), samples)| Block {
        first: Seq(first),
        time: DeviceTime(time),
        status: Status(status),
        samples: samples.into_iter().map(|(x, y)| [Counts(x), Counts(y)]).collect(),
    })
}

fn messages() -> impl Strategy<Value = FromDevice> {
    prop_oneof![
        2 => hellos().prop_map(FromDevice::Hello),
        1 => blocks().prop_map(FromDevice::Block),
        2 => (any::<u32>(), events())
            .prop_map(|(time, kind)| FromDevice::Event(Event { time: DeviceTime(time), kind })),
        5 => (any::<u32>(), outcomes())
            .prop_map(|(id, outcome)| FromDevice::Reply(Reply { id: CommandId(id), outcome })),
        1 => any::<(u32, i16)>().prop_map(|(time, centi_celsius)| {
            FromDevice::Temperature(Temperature { time: DeviceTime(time), centi_celsius })
        }),
    ]
}

fn requests() -> impl Strategy<Value = Request> {
    let ways = &[Failure::Panic, Failure::Hang, Failure::BadAccess, Failure::StackOverflow][..];
    prop_oneof![
        any::<u32>().prop_map(|rate_hz| Request::SetRate { rate_hz }),
        any::<u8>().prop_map(|address| Request::ReadRegister { address }),
        select(&[Source::Hardware, Source::Simulated][..]).prop_map(|source| Request::SetSource { source }),
        select(ways).prop_map(|failure| Request::Fail { failure }),
        any::<[u8; RAW_FRAME_BYTES]>().prop_map(|bytes| Request::RawFrame { bytes }),
        select(&[Request::Hello, Request::Start, Request::Ping, Request::Health][..]),
    ]
}

/// What the reader counts of one frame.
fn read(payload: &[u8]) -> ReaderCounts {
    let mut reader = MessageReader::default();
    // A delimiter first: so the frame is known to be whole.
    reader.read(&[vec![0], frame_of(payload)].concat(), |_| ());
    reader.counts()
}

/// What is to be told of `message` if a number within it is newer; the outermost is not within.
fn told_of(message: &FromDevice) -> NewerMessage {
    match message {
        FromDevice::Hello(hello) => NewerMessage::Hello { device: hello.protocol },
        FromDevice::Event(_) => NewerMessage::Event,
        FromDevice::Reply(Reply { id, .. }) => NewerMessage::Reply { id: *id, device: None },
        FromDevice::Block(_)
        | FromDevice::Temperature(_)
        | FromDevice::SlowChannels(_)
        | FromDevice::Inputs(_)
        | FromDevice::Force(_) => {
            panic!("nothing within is numbered")
        }
    }
}

proptest! {
    #[test]
    fn a_number_beyond_the_last_is_unknown_wherever_it_stands_and_never_damage(
        message in messages(), beyond in prop_oneof![Just(0), 0..1000_u32, Just(u32::MAX - 100)],
        rest in prop::option::of(prop::collection::vec(any::<u8>(), 0..90)),
    ) {
        let payload = payload_of(&message);
        prop_assert_eq!(read(&payload), ReaderCounts { messages: 1, ..ReaderCounts::default() });
        for number in numbers_in_message(&payload) {
            // Behind a newer variant stands what stood there, or anything.
            let rest = rest.as_deref().unwrap_or(&payload[number.bytes.end..]);
            let newer = number.replaced(&payload, number.known + beyond, rest);
            let unknown = ReaderCounts { unknown: 1, ..ReaderCounts::default() };
            prop_assert_eq!(read(&newer), unknown, "{} in {:02x?}", number.of, newer);
            let told = match (number.of, &message) {
                ("FromDevice", _) => NewerMessage::Kind { variant: number.known + beyond },
                (of, FromDevice::Reply(Reply { id, outcome: Outcome::Hello(hello) })) if of != "Outcome" => {
                    NewerMessage::Reply { id: *id, device: Some(hello.protocol) }
                }
                _ => told_of(&message),
            };
            prop_assert_eq!(FromDevice::from_payload(&newer), Err(DecodeError::Unknown(told)), "{}", number.of);
        }
    }

    #[test]
    fn a_message_that_is_cut_off_is_malformed_and_not_unknown(
        message in messages(), at in any::<prop::sample::Index>(),
    ) {
        let payload = payload_of(&message);
        let cut = at.index(payload.len());
        let malformed = ReaderCounts { malformed: 1, ..ReaderCounts::default() };
        prop_assert_eq!(read(&payload[..cut]), malformed, "{:02x?} cut to {}", payload, cut);
    }

    #[test]
    fn a_command_with_a_number_beyond_the_last_is_refused_by_its_id(
        id in any::<u32>(), request in requests(), beyond in 0..1000_u32,
    ) {
        let payload = payload_of(&Command::new(CommandId(id), request));
        for number in numbers_in_command(&payload) {
            let newer = number.replaced(&payload, number.known + beyond, &payload[number.bytes.end..]);
            let refused = CommandRead::Refuse(CommandId(id), Refusal::UnknownRequest);
            prop_assert_eq!(Command::from_payload(&newer), Ok(refused), "{} in {:02x?}", number.of, newer);
        }
    }
}
