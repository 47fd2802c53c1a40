//! The main side: the host's commands, blocks, events, counters.
//!
//! Call [`Device::receive`] (or [`Device::receive_by`], on a board with two links) with what the host sent,
//! [`Device::poll`] as often as possible (every few milliseconds at least), and put out what
//! [`Device::transmit`] shows, on [`Device::link`]. None of them waits; each does bounded work.
//!
//! - A command gets at most one reply. One that came before (the last [`REMEMBERED`] are kept) is answered
//!   again, not acted on again.
//! - What the front-end must do is asked of the sampler, one request at a time; meanwhile other such
//!   commands are refused as [`Refusal::Busy`]. After [`ANSWER_WAIT_US`] the reply is
//!   [`Refusal::FrontEndSilent`].
//! - Whatever finds no room is dropped whole, counted, and reported by [`EventKind::SamplesLost`], at most
//!   once in [`LOSS_REPORT_US`]. The gaps that the host sees in the samples' numbers add up to what these
//!   events say.
//!
//! Errors: none; a command that cannot be obeyed gets a [`Refusal`].

use heapless::{HistoryBuf, String};
use palpate_shared::units::DeviceTime;
use palpate_shared::wire::{
    Block, Channel, ClockSource, Command, CommandId, CommandRead, Counters, DeviceId, Event, EventKind, Failure, Fault,
    FirmwareVersion, ForceMatrix, FromDevice, FrontEnd, FrontEndKind, Health, Hello, Outcome, PROTOCOL, Refusal, Reply,
    Request, RestartReason, Source, Temperature,
};

use crate::block::BlockBuilder;
use crate::forces::Forces;
use crate::link::{Link, Links};
use crate::log::{info, warning};
use crate::outbox::Outbox;
use crate::queues::{DeviceEnd, Finding, FrontEndRequest, Notice, READINGS, RequestKind, SamplerState, Tally};
use crate::settings::{ConverterClock, DeviceSettings, Gain, Rate, WithBlocks};
use crate::store::NotStored;

/// Version of this firmware.
pub const FIRMWARE: FirmwareVersion = FirmwareVersion {
    major: number(env!("CARGO_PKG_VERSION_MAJOR")),
    minor: number(env!("CARGO_PKG_VERSION_MINOR")),
    patch: number(env!("CARGO_PKG_VERSION_PATCH")),
};

/// Replies kept for commands that come again.
pub const REMEMBERED: usize = 4;

/// How long the sampler has for a request, in µs: twelve conversions at 500 Hz take 24 ms, and
/// [`crate::sampler::Sampler::idle`] may be 10 ms away.
pub const ANSWER_WAIT_US: u32 = 250_000;

/// How long the first hello waits for the front-end's identity, in µs.
const HELLO_WAIT_US: u32 = 50_000;

/// Least time between two reports of losses, in µs.
pub const LOSS_REPORT_US: u32 = 250_000;

/// Notices taken up in one poll: as many as can wait.
const NOTICES_PER_POLL: usize = 16;

/// Microseconds in a second.
const US_PER_S: u32 = 1_000_000;

/// A part of a version, 255 at most.
const fn number(digits: &str) -> u8 {
    match u8::from_str_radix(digits, 10) {
        Ok(number) => number,
        Err(_) => u8::MAX,
    }
}

/// What the board knows about itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Unique to the device.
    pub device: DeviceId,
    /// The board's name; what exceeds 24 bytes is cut off.
    pub board: &'static str,
    /// What the processor's clock runs on.
    pub clock: ClockSource,
    /// Speed of the serial line in baud; 0 where the link has none, and then no limit.
    pub link_baud: u32,
    /// Why the processor started.
    pub restart: RestartReason,
    /// Starts since power-on, this one not counted.
    pub restarts: u16,
    /// Which converter its sampler drives.
    pub front_end: FrontEndKind,
    /// The clock that the converter gets.
    pub converter_clock: ConverterClock,
    /// Bridge excitation, in mV.
    pub excitation_mv: u16,
    /// What the two channels measure.
    pub channels: [Channel; 2],
    /// Where samples come from until a host chooses.
    pub source: Source,
}

/// What only the board can do. Its reply is on its way already.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Order {
    /// Restart the processor.
    Reboot,
    /// Restart it into the chip's own loader.
    EnterLoader,
    /// Fail on purpose, in this way.
    Fail(Failure),
}

/// What a board that takes orders has told about itself.
#[derive(Clone, Debug)]
struct BoardReport {
    last_fault: Option<Fault>,
    health: Health,
}

/// What the main side knows of the front-end.
#[derive(Clone, Copy, Debug)]
struct FrontEndView {
    /// 0 if it does not answer.
    id_word: u16,
    is_missing: bool,
    state: SamplerState,
}

/// A command, told apart from those of another host that happens to count alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Asked {
    by: Link,
    id: CommandId,
}

/// A command that waits for the sampler.
#[derive(Clone, Copy, Debug)]
struct Pending {
    ticket: u8,
    command: Asked,
    since: DeviceTime,
}

/// What came of a command at once.
enum Taken {
    Answered(Outcome),
    Asked,
    /// The board is to keep this in its flash.
    Store(Option<ForceMatrix>),
}

/// A command that waits for the board's flash.
#[derive(Clone, Copy, Debug)]
struct Storing {
    command: Asked,
    matrix: Option<ForceMatrix>,
}

/// What was counted on the main side; each counter wraps.
#[derive(Clone, Copy, Debug, Default)]
struct MainTally {
    blocks_sent: u32,
    blocks_dropped: u32,
    /// Samples in the dropped blocks.
    samples_dropped: u32,
    notices_dropped: u32,
    commands: u32,
    commands_repeated: u32,
    commands_refused: u32,
    frames_damaged: u32,
}

/// Samples lost since start-up.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Losses {
    missed: u32,
    damaged: u32,
    dropped: u32,
}

/// Seconds since start-up, beyond the wrap of the device's time.
#[derive(Clone, Copy, Debug)]
struct Uptime {
    last: DeviceTime,
    rest_us: u32,
    seconds: u32,
}

impl Uptime {
    /// Follows the clock; right if called within its wrap of 71 minutes.
    fn advance(&mut self, now: DeviceTime) {
        // In 32 bits throughout: a division of 64 takes a small processor longer than all else here.
        let passed_us = now.since(self.last);
        let rest_us = passed_us % US_PER_S + self.rest_us;
        self.last = now;
        self.seconds = self.seconds.wrapping_add(passed_us / US_PER_S + rest_us / US_PER_S);
        self.rest_us = rest_us % US_PER_S;
    }
}

/// The device as the host sees it. `OUTBOX` is the room for outgoing bytes.
pub struct Device<'q, const OUTBOX: usize> {
    identity: Identity,
    end: DeviceEnd<'q>,
    links: Links,
    outbox: Outbox<OUTBOX>,
    blocks: BlockBuilder,
    front_end: FrontEndView,
    pending: Option<Pending>,
    /// The number that the next request's answer will carry.
    ticket: u8,
    remembered: HistoryBuf<(Asked, Outcome), REMEMBERED>,
    tally: MainTally,
    /// Losses that events have told.
    reported: Losses,
    reported_at: DeviceTime,
    /// None before the first call that tells the time.
    uptime: Option<Uptime>,
    /// When the first call came, until the unasked hello went out.
    hello_due: Option<DeviceTime>,
    /// Whether the board can restart by itself.
    takes_restarts: bool,
    /// `None` on a board that cannot fail on purpose, nor tell of itself.
    board: Option<BoardReport>,
    order: Option<Order>,
    forces: Forces,
    /// Whether the board's flash can keep the matrix of forces.
    has_store: bool,
    storing: Option<Storing>,
}

impl<'q, const OUTBOX: usize> Device<'q, OUTBOX> {
    /// A device that has just started.
    #[must_use]
    pub fn new(identity: Identity, end: DeviceEnd<'q>) -> Self {
        let settings = DeviceSettings::at_start(identity.link_baud, identity.converter_clock);
        let state = SamplerState { settings, source: identity.source, streaming: false };
        let mut outbox = Outbox::new();
        outbox.push_delimiter();
        Self {
            identity,
            end,
            links: Links::default(),
            outbox,
            blocks: BlockBuilder::new(),
            front_end: FrontEndView { id_word: 0, is_missing: false, state },
            pending: None,
            ticket: 0,
            remembered: HistoryBuf::new(),
            tally: MainTally::default(),
            reported: Losses::default(),
            reported_at: DeviceTime(0),
            uptime: None,
            hello_due: None,
            takes_restarts: false,
            board: None,
            order: None,
            forces: Forces::default(),
            has_store: false,
            storing: None,
        }
    }

    /// The board can keep the matrix of forces over a restart ([`Self::take_store`]), and this one it found.
    pub fn accept_store(&mut self, kept: Option<ForceMatrix>) {
        self.has_store = true;
        self.forces.found(kept);
    }

    /// What the board is to keep from now on, at once, and then to tell [`Self::stored`]. Nothing is streamed meanwhile, so
    /// the board may stand still.
    #[must_use]
    pub fn take_store(&self) -> Option<Option<ForceMatrix>> {
        self.storing.map(|storing| storing.matrix)
    }

    /// The board keeps it, and stood still for so many microseconds; or the flash did not take it.
    pub fn stored(&mut self, stalled_us: Result<u32, NotStored>) {
        if let Some(Storing { command, .. }) = self.storing.take() {
            let outcome =
                stalled_us.map_or(Outcome::Refused(Refusal::NotStored), |stalled_us| Outcome::Stored { stalled_us });
            self.conclude(command, outcome);
        }
    }

    /// The board takes orders to restart ([`Self::take_order`]).
    pub fn accept_restarts(&mut self) {
        self.takes_restarts = true;
    }

    /// The board takes every order ([`Self::take_order`]), and this is what it recorded of its last fault.
    pub fn accept_orders(&mut self, last_fault: Option<Fault>) {
        self.accept_restarts();
        self.board = Some(BoardReport { last_fault, health: Health::default() });
    }

    /// What the board uses now, on a board that takes orders; a few times a second.
    pub fn report_health(&mut self, health: Health) {
        if let Some(board) = &mut self.board {
            board.health = health;
        }
    }

    /// What the board is to do once all of [`Self::transmit`] has gone out, or after a short while.
    pub fn take_order(&mut self) -> Option<Order> {
        self.order.take()
    }

    /// Takes bytes from the host on the serial line, in pieces of any size.
    pub fn receive(&mut self, bytes: &[u8], now: DeviceTime) {
        self.receive_by(Link::Serial, bytes, now);
    }

    /// Takes bytes from a host, in pieces of any size, that came by this link.
    pub fn receive_by(&mut self, link: Link, bytes: &[u8], now: DeviceTime) {
        self.follow_clock(now);
        let mut rest = bytes;
        while !rest.is_empty() {
            let (taken, read) = self.links.listen(link, rest);
            rest = rest.get(taken..).unwrap_or_default();
            match read {
                None => {}
                Some(Ok(read)) => self.take_up(link, read, now),
                Some(Err(_)) => count(&mut self.tally.frames_damaged),
            }
        }
    }

    /// The link that [`Self::transmit`]'s bytes are for.
    #[must_use]
    pub fn link(&self) -> Link {
        self.links.in_use()
    }

    /// Moves samples into blocks and blocks into the outbox, passes on what the sampler told, watches the time.
    pub fn poll(&mut self, now: DeviceTime) {
        self.follow_clock(now);
        for _ in 0..NOTICES_PER_POLL {
            let Some(notice) = self.end.notice() else { break };
            self.take_notice(notice);
        }
        self.move_readings();
        self.greet_when_due(now);
        self.give_up_when_due(now);
        self.report_losses_when_due(now);
    }

    /// Bytes for the host, as many as lie in a row; empty only if there are none.
    #[must_use]
    pub fn transmit(&self) -> &[u8] {
        self.outbox.readable()
    }

    /// The first `n` bytes of [`Self::transmit`] are on their way.
    pub fn transmitted(&mut self, n: usize) {
        self.outbox.consume(n);
    }

    /// Forwards the board's temperature, in hundredths of a degree Celsius; about once a second.
    pub fn temperature(&mut self, centi_celsius: i16, now: DeviceTime) {
        // What finds no room is not missed: the next one comes soon.
        let _ = self.outbox.push_message(&FromDevice::Temperature(Temperature { time: now, centi_celsius }));
    }

    /// What was counted since start-up.
    #[must_use]
    #[inline(never)]
    pub fn counters(&self) -> Counters {
        let (sampled, main) = (self.end.tally(), &self.tally);
        Counters {
            uptime_s: self.uptime.map_or(0, |uptime| uptime.seconds),
            samples: sampled.samples,
            samples_missed: sampled.missed,
            samples_damaged: sampled.damaged,
            samples_dropped: sampled.dropped.wrapping_add(main.samples_dropped),
            blocks_sent: main.blocks_sent,
            blocks_dropped: main.blocks_dropped,
            notices_dropped: main.notices_dropped.wrapping_add(sampled.notices_dropped),
            commands: main.commands,
            commands_repeated: main.commands_repeated,
            commands_refused: main.commands_refused,
            frames_damaged: main.frames_damaged,
        }
    }

    /// Who the device is and how it is set.
    #[must_use]
    #[inline(never)]
    pub fn hello(&self) -> Hello {
        let (identity, SamplerState { settings, source, streaming }) = (&self.identity, self.front_end.state);
        Hello {
            protocol: PROTOCOL,
            firmware: FIRMWARE,
            device: identity.device,
            board: name(identity.board),
            front_end: FrontEnd { kind: identity.front_end, id_word: self.front_end.id_word },
            channels: identity.channels,
            rate_hz: settings.rate.hz(),
            gain: settings.gain.factor(),
            full_scale_uv: identity.front_end.facts().full_scale_uv,
            excitation_mv: identity.excitation_mv,
            source,
            clock: identity.clock,
            link_baud: self.link_baud(),
            restart: identity.restart,
            restarts: identity.restarts,
            streaming,
        }
    }

    /// Speed of the line in use, in baud; 0 where it has none.
    fn link_baud(&self) -> u32 {
        match self.link() {
            Link::Serial => self.identity.link_baud,
            Link::Usb => 0,
        }
    }

    /// Takes up a command, new or repeated. Whoever sent it is talked to from now on.
    fn take_up(&mut self, by: Link, read: CommandRead, now: DeviceTime) {
        count(&mut self.tally.commands);
        if self.links.heard(by) {
            self.outbox.redirect();
        }
        match read {
            CommandRead::Refuse(id, refusal) => self.reply(id, Outcome::Refused(refusal)),
            CommandRead::Command(Command { id, request, .. }) => self.take_command(Asked { by, id }, request, now),
        }
    }

    /// Takes up a sound command.
    #[inline(never)]
    fn take_command(&mut self, command: Asked, request: Request, now: DeviceTime) {
        if self.is_pending(command) {
            // Its one reply is still to come.
            count(&mut self.tally.commands_repeated);
            return;
        }
        match self.remembered_outcome(command) {
            Some(outcome) => {
                count(&mut self.tally.commands_repeated);
                self.send_notice(&FromDevice::Reply(Reply { id: command.id, outcome }));
            }
            None => self.act(command, request, now),
        }
    }

    /// Does what a new command asks for, or has it done.
    fn act(&mut self, command: Asked, request: Request, now: DeviceTime) {
        match self.decide(request, now) {
            Ok(Taken::Answered(outcome)) => self.conclude(command, outcome),
            Ok(Taken::Store(matrix)) => self.storing = Some(Storing { command, matrix }),
            Ok(Taken::Asked) => self.pending = Some(Pending { ticket: self.ticket, command, since: now }),
            // Repeated with the same id, it shall be acted on, so it is not remembered.
            Err(Refusal::Busy) => self.reply(command.id, Outcome::Refused(Refusal::Busy)),
            Err(refusal) => self.conclude(command, Outcome::Refused(refusal)),
        }
    }

    /// Answers a request, passes it on to the sampler, or refuses it.
    #[inline(never)]
    fn decide(&mut self, request: Request, now: DeviceTime) -> Result<Taken, Refusal> {
        let kind = match request {
            Request::Hello => return Ok(Taken::Answered(Outcome::Hello(self.hello()))),
            Request::Ping => return Ok(Taken::Answered(Outcome::Pong { time: now })),
            Request::Counters => return Ok(Taken::Answered(Outcome::Counters(self.counters()))),
            Request::LastFault => return Ok(Taken::Answered(Outcome::LastFault(self.board()?.last_fault.clone()))),
            Request::Health => return Ok(Taken::Answered(Outcome::Health(self.board()?.health))),
            Request::Reboot => return self.order(Order::Reboot),
            Request::EnterLoader => return self.order(Order::EnterLoader),
            Request::Fail { failure } => {
                self.board()?;
                return self.order(Order::Fail(failure));
            }
            Request::Start => self.check_start()?,
            Request::Stop => RequestKind::Stream(false),
            Request::SetRate { rate_hz } => RequestKind::Apply(self.with_rate(rate_hz)?),
            Request::SetGain { gain } => RequestKind::Apply(self.with_gain(gain)?),
            Request::SetSource { source } => RequestKind::Select(source),
            Request::ReadRegister { address } => RequestKind::ReadRegister(self.check_address(address)?),
            Request::SelfTest => RequestKind::SelfTest,
            Request::RawFrame { bytes } => RequestKind::RawFrame(bytes),
            Request::SetForceMatrix { matrix, checksum } => {
                self.check_at_rest()?;
                return self.forces.keep(matrix, checksum).map(|()| Taken::Answered(Outcome::Done));
            }
            Request::SetForceTare { tare } => {
                return self.forces.tare(tare).map(|()| Taken::Answered(Outcome::Done));
            }
            Request::StreamForces { on } => {
                if on {
                    self.check_line_with(self.front_end.state.settings.rate, WithBlocks::Forces)?;
                }
                return self.forces.stream(on).map(|()| Taken::Answered(Outcome::Done));
            }
            Request::ForceMatrix => return Ok(Taken::Answered(Outcome::ForceMatrix(self.forces.matrix()))),
            Request::StoreForceMatrix { keep } => return self.check_store(keep),
        };
        self.ask(kind)
    }

    /// What the board told about itself.
    fn board(&self) -> Result<&BoardReport, Refusal> {
        self.board.as_ref().ok_or(Refusal::NotOnThisBoard)
    }

    /// Leaves an order for the board.
    fn order(&mut self, order: Order) -> Result<Taken, Refusal> {
        if !self.takes_restarts {
            return Err(Refusal::NotOnThisBoard);
        }
        self.order = Some(order);
        Ok(Taken::Answered(Outcome::Done))
    }

    /// What the board is to keep, if it can, and may now.
    fn check_store(&self, keep: bool) -> Result<Taken, Refusal> {
        if !self.has_store {
            return Err(Refusal::NotOnThisBoard);
        }
        self.check_at_rest()?;
        let matrix = if keep { Some(self.forces.matrix().ok_or(Refusal::NoForceMatrix)?) } else { None };
        Ok(Taken::Store(matrix))
    }

    /// Passes a request on to the sampler.
    #[inline(never)]
    fn ask(&mut self, kind: RequestKind) -> Result<Taken, Refusal> {
        // Raw frames are there to find out why none answers.
        let needs_front_end =
            !matches!(kind, RequestKind::Stream(false) | RequestKind::Select(_) | RequestKind::RawFrame(_));
        if needs_front_end && self.front_end.is_missing {
            return Err(Refusal::NoFrontEnd);
        }
        let ticket = self.ticket.wrapping_add(1);
        if self.pending.is_some() || !self.end.request(FrontEndRequest { ticket, kind }) {
            return Err(Refusal::Busy);
        }
        self.ticket = ticket;
        Ok(Taken::Asked)
    }

    /// Whether the link carries the present rate.
    fn check_start(&self) -> Result<RequestKind, Refusal> {
        if self.storing.is_some() {
            return Err(Refusal::Busy);
        }
        self.check_line(self.front_end.state.settings.rate)?;
        Ok(RequestKind::Stream(true))
    }

    /// The present settings with another rate.
    fn with_rate(&self, rate_hz: u32) -> Result<DeviceSettings, Refusal> {
        let clock = self.identity.converter_clock;
        let (slowest_hz, fastest_hz) = (Rate::slowest(clock).hz(), Rate::fastest(clock).hz());
        let rate = Rate::from_hz(rate_hz, clock).ok_or(Refusal::RateNotPossible { slowest_hz, fastest_hz })?;
        self.check_line(rate)?;
        Ok(DeviceSettings { rate, ..self.front_end.state.settings })
    }

    /// The present settings with another gain.
    fn with_gain(&self, factor: u8) -> Result<DeviceSettings, Refusal> {
        let largest = self.identity.front_end.facts().gain_largest;
        let gain = Gain::from_factor(factor).ok_or(Refusal::GainNotPossible { largest })?;
        Ok(DeviceSettings { gain, ..self.front_end.state.settings })
    }

    /// A register's address, if the front-end has it.
    fn check_address(&self, address: u8) -> Result<u8, Refusal> {
        let last = self.identity.front_end.facts().last_register;
        if address <= last { Ok(address) } else { Err(Refusal::AddressNotPossible { last }) }
    }

    /// Whether nothing is streamed, nor about to be.
    fn check_at_rest(&self) -> Result<(), Refusal> {
        match (self.front_end.state.streaming, self.pending.is_some() || self.storing.is_some()) {
            (true, _) => Err(Refusal::Streaming),
            (false, true) => Err(Refusal::Busy),
            (false, false) => Ok(()),
        }
    }

    /// Whether the serial line carries a rate; the refusal says 0 Hz if it carries none.
    fn check_line(&self, rate: Rate) -> Result<(), Refusal> {
        self.check_line_with(rate, self.forces.with_blocks())
    }

    /// The same with what is sent beside the blocks.
    fn check_line_with(&self, rate: Rate, with: WithBlocks) -> Result<(), Refusal> {
        let link_baud = self.link_baud();
        let fastest_hz = Rate::fastest_on_line(link_baud, self.identity.converter_clock, with).map_or(0, Rate::hz);
        if rate.fits_line(link_baud, with) { Ok(()) } else { Err(Refusal::LinkTooSlow { fastest_hz }) }
    }

    /// Whether a command still waits for the sampler, or for the board's flash.
    fn is_pending(&self, command: Asked) -> bool {
        self.pending.is_some_and(|pending| pending.command == command)
            || self.storing.is_some_and(|storing| storing.command == command)
    }

    /// What came of a command that came before.
    fn remembered_outcome(&self, command: Asked) -> Option<Outcome> {
        self.remembered.as_slice().iter().find(|(known, _)| *known == command).map(|(_, outcome)| outcome.clone())
    }

    /// Replies, and remembers the reply. A host that is no longer talked to gets it when it asks again.
    #[inline(never)]
    fn conclude(&mut self, command: Asked, outcome: Outcome) {
        self.remembered.write((command, outcome.clone()));
        if command.by == self.link() {
            self.reply(command.id, outcome);
        }
    }

    /// Puts the reply to a command into the outbox.
    #[inline(never)]
    fn reply(&mut self, id: CommandId, outcome: Outcome) {
        if matches!(outcome, Outcome::Refused(_)) {
            count(&mut self.tally.commands_refused);
        }
        self.send_notice(&FromDevice::Reply(Reply { id, outcome }));
    }

    /// Takes note of what the sampler told.
    fn take_notice(&mut self, notice: Notice) {
        // All samples from before the notice are queued; they go first.
        self.move_readings();
        match notice {
            Notice::Found { id_word } => {
                (self.front_end.id_word, self.front_end.is_missing) = (id_word, false);
                self.greet();
            }
            Notice::Event { time, kind } => self.take_event(Event { time, kind }),
            Notice::Inputs(inputs) => _ = self.send_notice(&FromDevice::Inputs(inputs)),
            // What finds no room is not missed: the next one comes soon.
            Notice::Slow(means) => _ = self.outbox.push_message(&FromDevice::SlowChannels(means)),
            Notice::Answer { ticket, finding, state } => self.take_answer(ticket, finding, state),
        }
    }

    /// Passes an event on.
    #[inline(never)]
    fn take_event(&mut self, event: Event) {
        match event.kind {
            EventKind::FrontEndMissing { .. } => {
                (self.front_end.id_word, self.front_end.is_missing) = (0, true);
                self.greet();
                self.finish_block();
            }
            EventKind::FrontEndSilent { .. } => self.finish_block(),
            _ => {}
        }
        self.send_notice(&FromDevice::Event(event));
    }

    /// Replies with the sampler's answer, if anyone still waits for it.
    #[inline(never)]
    fn take_answer(&mut self, ticket: u8, finding: Finding, state: SamplerState) {
        self.front_end.state = state;
        if !state.streaming {
            self.finish_block();
        }
        if let Some(pending) = self.pending.take_if(|pending| pending.ticket == ticket) {
            info!("command {=u32} answered", pending.command.id.0);
            self.conclude(pending.command, outcome_of(finding));
        }
    }

    /// Moves the queued samples into blocks.
    fn move_readings(&mut self) {
        for _ in 0..READINGS {
            let Some(reading) = self.end.reading() else { break };
            if let Some(block) = self.blocks.push(reading) {
                self.send_block(block);
            }
        }
    }

    /// Sends the block under way, full or not.
    fn finish_block(&mut self) {
        if let Some(block) = self.blocks.finish() {
            self.send_block(block);
        }
    }

    /// Sends a block, or drops and counts it.
    fn send_block(&mut self, block: Block) {
        let samples = u32::try_from(block.samples.len()).unwrap_or(0);
        let force = self.forces.of(&block);
        if self.outbox.push_message(&FromDevice::Block(block)) {
            count(&mut self.tally.blocks_sent);
            if let Some(force) = force {
                // Without room it is left out; the block that tells the same went out.
                let _ = self.outbox.push_message(&FromDevice::Force(force));
            }
            return;
        }
        count(&mut self.tally.blocks_dropped);
        self.tally.samples_dropped = self.tally.samples_dropped.wrapping_add(samples);
        self.blocks.lost();
    }

    /// Sends a message that is no block, or drops and counts it; tells whether there was room.
    #[inline(never)]
    fn send_notice(&mut self, message: &FromDevice) -> bool {
        let sent = self.outbox.push_message(message);
        if !sent {
            count(&mut self.tally.notices_dropped);
        }
        sent
    }

    /// Counts the seconds since start-up along the device's time.
    fn follow_clock(&mut self, now: DeviceTime) {
        match &mut self.uptime {
            Some(uptime) => uptime.advance(now),
            None => {
                self.uptime = Some(Uptime { last: now, rest_us: 0, seconds: 0 });
                self.hello_due = Some(now);
                self.reported_at = now;
            }
        }
    }

    /// Sends the unasked hello if it was not sent yet.
    fn greet(&mut self) {
        if self.hello_due.take().is_some() {
            let hello = self.hello();
            self.send_notice(&FromDevice::Hello(hello));
        }
    }

    /// Sends the unasked hello even if the sampler has not told of the front-end in time.
    fn greet_when_due(&mut self, now: DeviceTime) {
        if self.hello_due.is_some_and(|since| now.since(since) >= HELLO_WAIT_US) {
            self.greet();
        }
    }

    /// Gives up on a request that takes too long.
    fn give_up_when_due(&mut self, now: DeviceTime) {
        let overdue = |pending: &mut Pending| now.since(pending.since) >= ANSWER_WAIT_US;
        if let Some(pending) = self.pending.take_if(overdue) {
            warning!("no answer from the front-end for command {=u32}", pending.command.id.0);
            self.conclude(pending.command, Outcome::Refused(Refusal::FrontEndSilent));
        }
    }

    /// Reports losses that were not reported yet. What finds no room is reported later.
    fn report_losses_when_due(&mut self, now: DeviceTime) {
        let losses = self.losses();
        if losses == self.reported || now.since(self.reported_at) < LOSS_REPORT_US {
            return;
        }
        self.reported_at = now;
        let kind = EventKind::SamplesLost {
            missed: losses.missed.wrapping_sub(self.reported.missed),
            damaged: losses.damaged.wrapping_sub(self.reported.damaged),
            dropped: losses.dropped.wrapping_sub(self.reported.dropped),
        };
        if self.send_notice(&FromDevice::Event(Event { time: now, kind })) {
            self.reported = losses;
        }
    }

    /// Samples lost since start-up.
    fn losses(&self) -> Losses {
        let Tally { missed, damaged, dropped, .. } = self.end.tally();
        Losses { missed, damaged, dropped: dropped.wrapping_add(self.tally.samples_dropped) }
    }
}

/// Counts one more; wraps.
fn count(counter: &mut u32) {
    *counter = counter.wrapping_add(1);
}

/// What the host is told of a finding.
fn outcome_of(finding: Finding) -> Outcome {
    match finding {
        Finding::Done => Outcome::Done,
        Finding::Register { address, value } => Outcome::Register { address, value },
        Finding::SelfTest(result) => Outcome::SelfTest(result),
        Finding::RawFrame(bytes) => Outcome::RawFrame { bytes },
        Finding::Refused(refusal) => Outcome::Refused(refusal),
    }
}

/// As much of a name as a hello holds.
fn name(full: &str) -> String<24> {
    let mut name = String::new();
    // Fails at the first character that does not fit, which is where the name ends.
    let _ = full.chars().try_for_each(|character| name.push(character));
    name
}
