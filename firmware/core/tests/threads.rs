//! Sampler and device on two threads, as an interrupt and a main loop that really run at once.

mod rig;

use std::cell::RefCell;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::thread;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use palpate_firmware_core::ads131m::Ads131m;
use palpate_firmware_core::queues::SamplerEnd;
use palpate_firmware_core::{ConverterClock, Device, DeviceSettings, Queues, Sampler, SelectSource, SourceNotPossible};
use palpate_shared::frame::{FRAME_MAX, FrameReader, encode};
use palpate_shared::sim::{FingerConfig, PortBusy, SimulatedFrontEnd, SpiPort};
use palpate_shared::units::{DeviceTime, Seq};
use palpate_shared::wire::{Command, CommandId, EventKind, FrameBuffer, FromDevice, Outcome, Request, Source, Status};

/// Conversions that the sampler's thread makes while the stream is on.
const CONVERSIONS: u32 = 200_000;

struct Bus<'a>(SpiPort<'a>);

impl ErrorType for Bus<'_> {
    type Error = PortBusy;
}

impl SpiDevice for Bus<'_> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), PortBusy> {
        self.0.transaction(operations)
    }
}

impl DelayNs for Bus<'_> {
    fn delay_ns(&mut self, duration_ns: u32) {
        self.0.delay_ns(duration_ns);
    }
}

impl SelectSource for Bus<'_> {
    fn select(&mut self, _: Source) -> Result<(), SourceNotPossible> {
        Err(SourceNotPossible)
    }

    fn is_simulated(&self) -> bool {
        false
    }
}

/// The interrupt side: conversions as fast as they go, until told to end.
fn sample(end: SamplerEnd<'_>, time_us: &AtomicU32, over: &AtomicBool) {
    let finger = rig::chip::on_chip_of(module_path!(), FingerConfig::ideal());
    let front_end = RefCell::new(SimulatedFrontEnd::new(finger, 1));
    let chip = Ads131m::<_, { rig::CHANNELS }>::new(Bus(SpiPort::new(&front_end)));
    let mut sampler = Sampler::new(chip, end, DeviceSettings::at_start(0, ConverterClock::NOMINAL));
    while !over.load(Ordering::Acquire) {
        let now = DeviceTime(time_us.fetch_add(250, Ordering::AcqRel).wrapping_add(250));
        if front_end.borrow_mut().step() {
            sampler.data_ready(now);
        }
    }
}

/// The host's end of a device.
struct Host<'q> {
    device: Device<'q, 2048>,
    reader: FrameReader,
    next_id: u32,
    delivered: u32,
    gaps: u32,
    next: Seq,
    lost: u32,
    last_outcome: Option<(CommandId, Outcome)>,
}

impl Host<'_> {
    fn turn(&mut self, now: DeviceTime) {
        self.device.poll(now);
        while !self.device.transmit().is_empty() {
            let bytes = self.device.transmit().to_vec();
            self.device.transmitted(bytes.len());
            let mut rest = &bytes[..];
            while !rest.is_empty() {
                let (taken, payload) = self.reader.push(rest);
                let message = payload.map(|payload| payload.map(FromDevice::from_payload));
                rest = &rest[taken..];
                if let Some(message) = message {
                    self.hear(message.expect("a sound frame").expect("a known message"));
                }
            }
        }
    }

    fn hear(&mut self, message: FromDevice) {
        match message {
            FromDevice::Block(block) => {
                let gap = block.first.since(self.next);
                assert_eq!(gap > 0, block.status.contains(Status::GAP_BEFORE));
                let count = u32::try_from(block.samples.len()).expect("eight at most");
                self.next = block.first.plus(count);
                self.gaps += gap;
                self.delivered += count;
            }
            FromDevice::Reply(reply) => self.last_outcome = Some((reply.id, reply.outcome)),
            FromDevice::Event(event) => {
                if let EventKind::SamplesLost { missed, damaged, dropped } = event.kind {
                    self.lost += missed + damaged + dropped;
                }
            }
            _ => {}
        }
    }

    /// Repeats a command until it is done: the sampler's time runs ahead of this thread's.
    fn insist(&mut self, request: Request, time_us: &AtomicU32) {
        let now = || DeviceTime(time_us.load(Ordering::Acquire));
        loop {
            self.next_id += 1;
            let id = CommandId(self.next_id);
            let mut line: FrameBuffer = [0; FRAME_MAX + 1];
            let frame = encode(&Command::new(id, request), &mut line).expect("a buffer for any frame");
            self.device.receive(frame, now());
            while self.last_outcome.as_ref().is_none_or(|(answered, _)| *answered != id) {
                self.turn(now());
                thread::yield_now();
            }
            if self.last_outcome == Some((id, Outcome::Done)) {
                return;
            }
        }
    }
}

#[test]
fn samples_are_delivered_or_counted_when_both_sides_run_at_once() {
    let mut queues = Queues::new();
    let (sampler_end, device_end) = queues.split();
    let (time_us, over) = (AtomicU32::new(0), AtomicBool::new(false));
    let mut host = Host {
        device: Device::new(rig::identity(0), device_end),
        reader: FrameReader::new(),
        next_id: 0,
        delivered: 0,
        gaps: 0,
        next: Seq(0),
        lost: 0,
        last_outcome: None,
    };
    thread::scope(|scope| {
        scope.spawn(|| sample(sampler_end, &time_us, &over));
        host.insist(Request::Start, &time_us);
        while host.device.counters().samples < CONVERSIONS {
            host.turn(DeviceTime(time_us.load(Ordering::Acquire)));
        }
        host.insist(Request::Stop, &time_us);
        over.store(true, Ordering::Release);
    });
    let end = time_us.load(Ordering::Acquire);
    host.turn(DeviceTime(end.wrapping_add(1_000_000))); // the last report of losses is due
    let samples = host.device.counters().samples;
    println!("{samples} samples: {} delivered, {} lost in gaps of {}", host.delivered, host.lost, host.gaps);
    assert_eq!(samples, host.delivered + host.lost);
    let after_last = Seq(samples).since(host.next);
    assert_eq!(host.gaps + after_last, host.lost);
}
