//! A whole device on the bench: firmware core, simulated front-ends, and a host that listens.
//!
//! Shared by the tests of this package and by fuzz targets (include it with `#[path]`). Time is
//! simulated: [`Rig::step`] lets one conversion period pass.
//!
//! ```text
//! let mut world = World::new(FingerConfig::ideal(), 1);
//! let mut rig = Rig::new(&mut world, Bench::default());
//! rig.run_us(10_000);
//! assert_eq!(rig.ask(Request::Start), Outcome::Done);
//! ```
#![allow(dead_code, unreachable_pub, reason = "each test and fuzz target uses a part of it")]

pub mod chip;

use std::cell::RefCell;
use std::collections::HashMap;

use embedded_hal::delay::DelayNs;
use embedded_hal::spi::{ErrorType, Operation, SpiDevice};
use palpate_firmware_core::ads131m::Ads131m;
use palpate_firmware_core::device::Identity;
use palpate_firmware_core::{ConverterClock, Device, DeviceSettings, Queues, Sampler, SelectSource, SourceNotPossible};
use palpate_shared::frame::{FRAME_MAX, FrameReader, encode};
use palpate_shared::sim::{Faults, FingerConfig, PortBusy, SimulatedFrontEnd, SpiPort, SyncResetPin};
use palpate_shared::units::{Counts, DeviceTime, Seq};
use palpate_shared::wire::{
    Axis, Block, Bridge, Channel, ClockSource, Command, CommandId, DeviceId, Event, EventKind, FrameBuffer, FromDevice,
    Hello, Outcome, Reply, Request, RestartReason, Source, Status,
};

/// Room for outgoing bytes: 24 ms at 4 kHz.
pub const OUTBOX: usize = 2048;

/// How often the sampler's `idle` is called, in µs.
const IDLE_EVERY_US: u64 = 1000;

/// How long [`Rig::ask`] waits for a reply, in µs of device time; longer than any wait in the firmware.
const REPLY_WAIT_US: u64 = 400_000;

/// Channels of both chips, by what the test's module is called ([`chip`]).
pub const CHANNELS: usize = chip::channels(module_path!());

/// What the upper byte of the chip's ID register holds.
#[expect(clippy::cast_possible_truncation, reason = "2 or 4")]
pub const ID_HIGH: u16 = 0x20 | CHANNELS as u16;

/// All that the rig's parts borrow.
pub struct World {
    /// The chip on the board.
    hardware: RefCell<SimulatedFrontEnd>,
    /// The simulated finger built into the firmware.
    simulation: RefCell<SimulatedFrontEnd>,
    queues: Queues,
}

impl World {
    /// Two front-ends of the same kind with different noise.
    ///
    /// The chip on the board behaves as the test's module is called ([`chip`]); the built-in one is known.
    pub fn new(config: FingerConfig, seed: u64) -> Self {
        let on_board = chip::on_chip_of(module_path!(), config);
        Self {
            hardware: RefCell::new(SimulatedFrontEnd::new(on_board, seed)),
            simulation: RefCell::new(SimulatedFrontEnd::new(
                FingerConfig { channels: on_board.channels, ..config },
                seed.wrapping_add(1),
            )),
            queues: Queues::new(),
        }
    }
}

/// What is on the bench, apart from the world.
#[derive(Clone, Copy, Debug)]
pub struct Bench {
    pub link_baud: u32,
    /// Whether the firmware has a simulated finger.
    pub has_simulation: bool,
    /// The converter's clock, as the firmware is told; the chip on the board has it too.
    pub converter_clock: ConverterClock,
    /// The device's clock at the start.
    pub start: DeviceTime,
}

impl Default for Bench {
    fn default() -> Self {
        Self {
            link_baud: 921_600,
            has_simulation: true,
            converter_clock: ConverterClock::NOMINAL,
            start: DeviceTime(0),
        }
    }
}

/// The bus: either chip behind it.
pub struct Bus<'w> {
    hardware: SpiPort<'w>,
    simulation: Option<SpiPort<'w>>,
    is_simulated: bool,
    pub transactions: u64,
}

impl ErrorType for Bus<'_> {
    type Error = PortBusy;
}

impl SpiDevice for Bus<'_> {
    fn transaction(&mut self, operations: &mut [Operation<'_, u8>]) -> Result<(), PortBusy> {
        self.transactions += 1;
        match &mut self.simulation {
            Some(simulation) if self.is_simulated => simulation.transaction(operations),
            _ => self.hardware.transaction(operations),
        }
    }
}

impl DelayNs for Bus<'_> {
    fn delay_ns(&mut self, duration_ns: u32) {
        match &mut self.simulation {
            Some(simulation) if self.is_simulated => simulation.delay_ns(duration_ns),
            _ => self.hardware.delay_ns(duration_ns),
        }
    }
}

impl SelectSource for Bus<'_> {
    fn select(&mut self, source: Source) -> Result<(), SourceNotPossible> {
        if source == Source::Simulated && self.simulation.is_none() {
            return Err(SourceNotPossible);
        }
        self.is_simulated = source == Source::Simulated;
        Ok(())
    }

    fn is_simulated(&self) -> bool {
        self.is_simulated
    }

    fn inputs(&self) -> u8 {
        match &self.simulation {
            Some(simulation) if self.is_simulated => simulation.inputs(),
            _ => self.hardware.inputs(),
        }
    }
}

/// A sample as the host got it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Delivered {
    pub seq: Seq,
    pub counts: [Counts; 2],
    pub status: Status,
}

/// A conversion as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Conversion {
    /// When it was ready.
    pub time: DeviceTime,
    /// Its true codes.
    pub codes: [Counts; 2],
    /// Whether both gains were those that the firmware had set.
    pub has_set_gain: bool,
}

/// What the host heard.
#[derive(Debug, Default)]
pub struct Heard {
    pub messages: Vec<FromDevice>,
    pub frames_bad: usize,
}

impl Heard {
    pub fn blocks(&self) -> impl Iterator<Item = &Block> {
        self.messages
            .iter()
            .filter_map(|message| if let FromDevice::Block(block) = message { Some(block) } else { None })
    }

    pub fn replies(&self) -> impl Iterator<Item = &Reply> {
        self.messages
            .iter()
            .filter_map(|message| if let FromDevice::Reply(reply) = message { Some(reply) } else { None })
    }

    pub fn events(&self) -> impl Iterator<Item = &Event> {
        self.messages
            .iter()
            .filter_map(|message| if let FromDevice::Event(event) = message { Some(event) } else { None })
    }

    pub fn hellos(&self) -> impl Iterator<Item = &Hello> {
        self.messages
            .iter()
            .filter_map(|message| if let FromDevice::Hello(hello) = message { Some(hello) } else { None })
    }

    pub fn samples(&self) -> impl Iterator<Item = Delivered> {
        self.blocks().flat_map(|block| {
            block.samples.iter().zip(0..).map(|(&counts, n)| Delivered {
                seq: block.first.plus(n),
                counts,
                status: block.status,
            })
        })
    }

    /// Kinds of the events, those of losses apart.
    pub fn faults(&self) -> Vec<EventKind> {
        let is_fault = |kind: &EventKind| !matches!(kind, EventKind::SamplesLost { .. });
        self.events().map(|event| event.kind).filter(is_fault).collect()
    }

    /// Samples lost, as the events tell: missed, damaged, dropped.
    pub fn losses(&self) -> [u32; 3] {
        self.events().fold([0; 3], |[a, b, c], event| match event.kind {
            EventKind::SamplesLost { missed, damaged, dropped } => [a + missed, b + damaged, c + dropped],
            _ => [a, b, c],
        })
    }

    /// Samples missing between blocks, and before the first one, which is numbered from 0.
    pub fn gaps(&self) -> u32 {
        let mut next = Seq(0);
        self.blocks().fold(0, |gaps, block| {
            let gap = block.first.since(next);
            assert_eq!(gap > 0, block.status.contains(Status::GAP_BEFORE), "{block:?} after {next:?}");
            next = block.first.plus(u32::try_from(block.samples.len()).expect("a block holds eight samples"));
            gaps + gap
        })
    }
}

/// Firmware, front-ends and host.
pub struct Rig<'w> {
    hardware: &'w RefCell<SimulatedFrontEnd>,
    simulation: &'w RefCell<SimulatedFrontEnd>,
    pub sampler: Sampler<'w, Ads131m<Bus<'w>, CHANNELS>>,
    pub device: Device<'w, OUTBOX>,
    pub heard: Heard,
    /// Whether the link takes bytes.
    pub link_open: bool,
    /// Whether the main side's loop is held up.
    pub main_loop_hangs: bool,
    /// How many of the next data-ready edges are overlooked, as with interrupts held off.
    pub overlook_edges: u32,
    /// The conversions of the front-end in use.
    pub conversions: Vec<Conversion>,
    reader: FrameReader,
    start: DeviceTime,
    time_ns: u64,
    idle_at_us: u64,
    next_id: u32,
}

impl<'w> Rig<'w> {
    /// A device just switched on.
    pub fn new(world: &'w mut World, bench: Bench) -> Self {
        let World { hardware, simulation, queues } = world;
        let (hardware, simulation) = (&*hardware, &*simulation);
        let (sampler_end, device_end) = queues.split();
        hardware.borrow_mut().set_clock_hz(bench.converter_clock.hz());
        let bus = Bus {
            hardware: SpiPort::new(hardware),
            simulation: bench.has_simulation.then(|| SpiPort::new(simulation)),
            is_simulated: false,
            transactions: 0,
        };
        Self {
            hardware,
            simulation,
            sampler: Sampler::new(
                Ads131m::new(bus),
                sampler_end,
                DeviceSettings::at_start(bench.link_baud, bench.converter_clock),
            ),
            device: Device::new(
                Identity { converter_clock: bench.converter_clock, ..identity(bench.link_baud) },
                device_end,
            ),
            heard: Heard::default(),
            link_open: true,
            main_loop_hangs: false,
            overlook_edges: 0,
            conversions: Vec::new(),
            reader: FrameReader::new(),
            start: bench.start,
            time_ns: 0,
            idle_at_us: 0,
            next_id: 1000,
        }
    }

    /// The front-end behind the bus now.
    pub fn front_end(&mut self) -> &'w RefCell<SimulatedFrontEnd> {
        if self.sampler.bus_mut().is_simulated { self.simulation } else { self.hardware }
    }

    /// Breaks or mends the chip on the board.
    pub fn set_faults(&mut self, faults: Faults) {
        self.hardware.borrow_mut().set_faults(faults);
    }

    /// The chip on the board loses its supply for two conversions, whose edges are lost too.
    pub fn reset_chip(&mut self) {
        use embedded_hal::digital::OutputPin;
        let mut pin = SyncResetPin::new(self.hardware);
        pin.set_low().expect("nothing borrows the front-end");
        // A reset needs 250 µs: at the fastest rate two periods.
        self.overlook_edges = 2;
        self.run(2);
        pin.set_high().expect("nothing borrows the front-end");
    }

    /// The device's time.
    #[expect(clippy::cast_possible_truncation, reason = "the device's time wraps")]
    pub fn now(&self) -> DeviceTime {
        DeviceTime(self.start.0.wrapping_add((self.time_ns / 1000) as u32))
    }

    /// One conversion period passes. Returns whether there was a data-ready edge.
    pub fn step(&mut self) -> bool {
        let front_end = self.front_end();
        let fell = front_end.borrow_mut().step();
        self.time_ns += u64::from(front_end.borrow().period_ns());
        let now = self.now();
        let set = self.sampler.settings().gain.factor();
        let has_set_gain = [0, 1].iter().all(|&channel| front_end.borrow().chip().gain(channel) == set);
        self.conversions.push(Conversion { time: now, codes: newest_codes(&front_end.borrow()), has_set_gain });
        if fell && self.overlook_edges == 0 {
            self.sampler.data_ready(now);
        }
        self.overlook_edges -= u32::from(fell && self.overlook_edges > 0);
        if self.time_ns / 1000 >= self.idle_at_us {
            self.idle_at_us = self.time_ns / 1000 + IDLE_EVERY_US;
            self.sampler.idle(now);
        }
        if !self.main_loop_hangs {
            self.turn_main_loop();
        }
        fell
    }

    /// The main side's loop, once.
    pub fn turn_main_loop(&mut self) {
        self.device.poll(self.now());
        if self.link_open {
            self.listen();
        }
    }

    /// The host takes all that waits.
    pub fn listen(&mut self) {
        while !self.device.transmit().is_empty() {
            let bytes = self.device.transmit().to_vec();
            self.device.transmitted(bytes.len());
            self.hear(&bytes);
        }
    }

    /// The host hears these bytes.
    pub fn hear(&mut self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, frame) = self.reader.push(rest);
            match frame.map(|frame| frame.ok().and_then(|payload| FromDevice::from_payload(payload).ok())) {
                Some(Some(message)) => self.heard.messages.push(message),
                Some(None) => self.heard.frames_bad += 1,
                None => {}
            }
            rest = &rest[taken..];
        }
    }

    /// Lets time pass.
    pub fn run_us(&mut self, duration_us: u64) {
        let end_ns = self.time_ns + duration_us * 1000;
        while self.time_ns < end_ns {
            self.step();
        }
    }

    /// Lets so many conversions pass.
    pub fn run(&mut self, steps: u32) {
        for _ in 0..steps {
            self.step();
        }
    }

    /// Sends a command with a new id, which it returns.
    pub fn send(&mut self, request: Request) -> CommandId {
        self.next_id += 1;
        let id = CommandId(self.next_id);
        self.send_as(id, request);
        id
    }

    /// Sends a command.
    pub fn send_as(&mut self, id: CommandId, request: Request) {
        let mut line: FrameBuffer = [0; FRAME_MAX + 1];
        let frame = encode(&Command::new(id, request), &mut line).expect("a buffer for any frame").to_vec();
        self.device.receive(&frame, self.now());
    }

    /// Every outcome heard so far for a command.
    pub fn outcomes(&self, id: CommandId) -> Vec<Outcome> {
        self.heard.replies().filter(|reply| reply.id == id).map(|reply| reply.outcome.clone()).collect()
    }

    /// Sends a command and waits for its one reply.
    pub fn ask(&mut self, request: Request) -> Outcome {
        let id = self.send(request);
        let end_ns = self.time_ns + REPLY_WAIT_US * 1000;
        while self.outcomes(id).is_empty() && self.time_ns < end_ns {
            self.step();
        }
        let outcomes = self.outcomes(id);
        assert_eq!(outcomes.len(), 1, "replies to {request:?}: {outcomes:?}");
        outcomes[0].clone()
    }

    /// Delivered samples whose codes are not those of the conversion that they stand for, or which another
    /// gain than the one set amplified while nothing was settling.
    ///
    /// A block names its first conversion by its time; the others follow.
    pub fn wrong_samples(&self) -> usize {
        let index: HashMap<u32, usize> = self.conversions.iter().zip(0..).map(|(made, n)| (made.time.0, n)).collect();
        let wrong_in = |block: &Block| {
            let truth = &self.conversions[index[&block.time.0]..];
            let settles = block.status.contains(Status::SETTLING);
            let is_wrong = |got: [Counts; 2], made: &Conversion| got != made.codes || !(made.has_set_gain || settles);
            block.samples.iter().zip(truth).filter(|&(&got, made)| is_wrong(got, made)).count()
        };
        self.heard.blocks().map(wrong_in).sum()
    }

    /// For each block, how many more conversions there were than numbers, up to its first sample.
    pub fn unnumbered_conversions(&self) -> Vec<i64> {
        let index: HashMap<u32, i64> = self.conversions.iter().zip(0..).map(|(made, n)| (made.time.0, n)).collect();
        self.heard.blocks().map(|block| index[&block.time.0] - i64::from(block.first.0)).collect()
    }

    /// Starts a device and its stream.
    pub fn start_streaming(&mut self) {
        self.run_us(5000);
        assert_eq!(self.ask(Request::Start), Outcome::Done);
    }
}

/// The codes of the newest conversion, by a road that never is behind: two frames on a copy.
fn newest_codes(front_end: &SimulatedFrontEnd) -> [Counts; 2] {
    let copy = RefCell::new(front_end.clone());
    copy.borrow_mut().set_faults(Faults::default());
    let mut frame = [0; 3 * (CHANNELS + 2)];
    for _ in 0..2 {
        frame.fill(0);
        SpiPort::new(&copy).transfer_in_place(&mut frame).expect("nothing else borrows the copy");
    }
    let code = |at: usize| Counts(i32::from_be_bytes([frame[at], frame[at + 1], frame[at + 2], 0]) >> 8);
    [code(3), code(6)]
}

/// Who the device on the bench is.
pub fn identity(link_baud: u32) -> Identity {
    let channel = |axis| Channel { axis, bridge: Bridge::Half };
    Identity {
        device: DeviceId(*b"palpate-rig0"),
        board: "test rig",
        clock: ClockSource::Host,
        link_baud,
        restart: RestartReason::PowerOn,
        restarts: 0,
        front_end: chip::kind(CHANNELS),
        converter_clock: ConverterClock::NOMINAL,
        excitation_mv: 2500,
        channels: [channel(Axis::X), channel(Axis::Y)],
        source: Source::Hardware,
    }
}
