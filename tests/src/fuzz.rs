//! What must hold for any bytes at all: the bodies of the fuzz targets.
//!
//! Each takes bytes and panics if a law is broken. `tests/e2e/libraries/fuzz.rs` runs them on mutations of a kept corpus with
//! stable Rust; `fuzz/` hands them to libFuzzer where there is a nightly compiler.

use std::cell::RefCell;
use std::collections::BTreeMap;

use palpate_device::simulated::SimulatedOnly;
use palpate_device::wire_reader::{MessageReader, ReaderCounts};
use palpate_firmware_core::ads131m::Ads131m02;
use palpate_firmware_core::{ConverterClock, Device, DeviceSettings, Identity, Queues, Sampler};
use palpate_shared::sim::{FingerConfig, SimulatedFrontEnd};
use palpate_shared::units::DeviceTime;
use palpate_shared::wire::{
    Axis, Bridge, Channel, ClockSource, Command, CommandRead, Counters, DeviceId, FromDevice, FrontEndKind,
    RestartReason, Source,
};

use crate::oracle;

/// Bytes from a device: the reader accepts exactly the frames that a slow, separate decoder accepts, whatever
/// pieces they come in, and counts the others.
///
/// # Panics
/// If that is not so.
pub fn decoder(bytes: &[u8]) {
    let (whole, counts) = read_in_pieces(bytes, bytes.len().max(1));
    for step in [1, 7, 64] {
        assert_eq!(read_in_pieces(bytes, step), (whole.clone(), counts), "in pieces of {step}");
    }
    let payloads = oracle::good_payloads(bytes);
    let accepted: Vec<FromDevice> =
        payloads.iter().filter_map(|payload| FromDevice::from_payload(payload).ok()).collect();
    assert_eq!(whole, accepted);
    let frames = oracle::frames(bytes).count() as u64;
    assert!(counts.messages + counts.damaged + counts.unknown + counts.malformed <= frames);
}

fn read_in_pieces(bytes: &[u8], step: usize) -> (Vec<FromDevice>, ReaderCounts) {
    let (mut reader, mut messages) = (MessageReader::default(), Vec::new());
    bytes.chunks(step).for_each(|piece| reader.read(piece, |message| messages.push(message)));
    (messages, reader.counts())
}

/// Bytes from a host, fed to the firmware on a simulated front-end while it samples: it never panics, never answers
/// what was not asked, answers nothing more often than it was asked, and loses no count of its samples.
///
/// # Panics
/// If that is not so.
pub fn commands(bytes: &[u8]) {
    let asked = asked(bytes);
    let mut board = Board::new();
    let answered = board.converse(bytes);
    for (id, answers) in &answered {
        let times = asked.get(id).copied().unwrap_or(0);
        assert!(*answers <= times, "{id:?} was asked {times} times and answered {answers} times");
    }
    let counters = board.counters;
    assert_eq!(u64::from(counters.commands), asked.values().sum::<u64>(), "every good command is counted");
    assert_eq!(
        u64::from(counters.frames_damaged) + asked.values().sum::<u64>(),
        oracle::frames(bytes).count() as u64,
        "every other frame is counted as damaged"
    );
    let lost = counters.samples_missed + counters.samples_damaged + counters.samples_dropped;
    assert!(board.delivered + u64::from(lost) <= u64::from(counters.samples));
}

/// How often each command id stands in a good frame.
fn asked(bytes: &[u8]) -> BTreeMap<u32, u64> {
    let mut asked = BTreeMap::new();
    for payload in oracle::good_payloads(bytes) {
        if let Ok(CommandRead::Command(Command { id, .. }) | CommandRead::Refuse(id, _)) =
            Command::from_payload(&payload)
        {
            *asked.entry(id.0).or_insert(0) += 1;
        }
    }
    asked
}

/// The firmware on a simulated front-end, with a host that reads everything.
struct Board {
    delivered: u64,
    counters: Counters,
}

impl Board {
    fn new() -> Self {
        Self { delivered: 0, counters: Counters::default() }
    }

    /// Feeds `bytes` eight at a time, a conversion between; gives the number of answers by command id.
    fn converse(&mut self, bytes: &[u8]) -> BTreeMap<u32, u64> {
        let front_end = RefCell::new(SimulatedFrontEnd::new(FingerConfig::default(), 1));
        let mut queues = Queues::new();
        let (sampler_end, device_end) = queues.split();
        let mut sampler = Sampler::new(
            Ads131m02::new(SimulatedOnly::new(&front_end)),
            sampler_end,
            DeviceSettings::at_start(0, ConverterClock::NOMINAL),
        );
        let mut device: Device<'_, 4096> = Device::new(identity(), device_end);
        let (mut reader, mut answered) = (MessageReader::default(), BTreeMap::new());
        // After the last byte the device gets the time to answer: 50 ms.
        let pieces = bytes.chunks(8).chain(std::iter::repeat_n(&[][..], 200));
        for piece in pieces {
            let ready = front_end.borrow_mut().step();
            #[expect(clippy::cast_possible_truncation, reason = "the device's clock wraps")]
            let now = DeviceTime((front_end.borrow().truth().time_ns / 1000) as u32);
            if ready {
                sampler.data_ready(now);
            } else {
                sampler.idle(now);
            }
            device.receive(piece, now);
            device.poll(now);
            while !device.transmit().is_empty() {
                let sent = device.transmit().to_vec();
                device.transmitted(sent.len());
                reader.read(&sent, |message| match message {
                    FromDevice::Reply(reply) => *answered.entry(reply.id.0).or_insert(0) += 1,
                    FromDevice::Block(block) => self.delivered += block.samples.len() as u64,
                    _ => {}
                });
            }
        }
        assert_eq!(reader.counts().damaged + reader.counts().malformed, 0, "what it sends is whole");
        self.counters = device.counters();
        answered
    }
}

fn identity() -> Identity {
    Identity {
        device: DeviceId(*b"fuzz-target0"),
        board: "fuzz target",
        clock: ClockSource::Host,
        link_baud: 0,
        restart: RestartReason::PowerOn,
        restarts: 0,
        front_end: FrontEndKind::Ads131m02,
        converter_clock: ConverterClock::NOMINAL,
        excitation_mv: 2500,
        channels: [Axis::X, Axis::Y].map(|axis| Channel { axis, bridge: Bridge::Half }),
        source: Source::Simulated,
    }
}
