//! A conversation with one device: handshake, commands, samples in order, reconnection.
//!
//! What comes is stamped with its time of arrival, however late it is taken (`link`). Commands go out on the caller's
//! thread and are repeated with the same id until the reply comes; what arrives meanwhile is kept in order. A reply that
//! only a newer version can read is a reply: the command is not repeated, and the error says what to update.
//!
//! When the link breaks, [`Session::next`] reopens it, restores the settings and goes on; the gap is counted in
//! samples like any other, unless the device itself restarted and began to count anew.
//!
//! A session has the settings that it was opened with until it sets others, and gives them back to a device that
//! restarted or that another host has set otherwise. What such a device sends before it has them is dropped and counted
//! as missing; if it does not take them, the session ends with [`LinkError::OtherSettings`].
//!
//! Whatever decides what a session hands on, it notes for a recorder ([`crate::trace`]): the bytes, and what it made of its
//! clock. A session of such notes ([`Session::open_recorded`]) takes its decisions from them and hands on the same.

use std::collections::VecDeque;
use std::fmt;
use std::hash::{BuildHasher, RandomState};
use std::io;
use std::sync::Arc;
use std::time::{Duration, Instant};

use palpate::finger::Samples;
use palpate_shared::units::{Counts, Seq};
use palpate_shared::wire::{
    Block, Command, CommandId, Counters, Event, Failure, Fault, ForceMatrix, FromDevice, Health, Hello, NewerMessage,
    Outcome, PROTOCOL, ProtocolVersion, RAW_FRAME_BYTES, Refusal, Reply, Request, SelfTest, SlowChannels, Source,
    Status, Temperature,
};

use crate::clock_map::{ClockEstimate, ClockMap};
use crate::device_forces::DeviceForces;
use crate::error::{LinkError, Opened};
use crate::link::{Heard, Link, gone};
use crate::sample_sequence::{Continuity, Sequence};
use crate::simulated::{Pace, SimulatedDevice};
use crate::slow_channels::SlowReadings;
use crate::tape::{PlaySpeed, Tape};
use crate::trace::{Entry, Input, LinkEvent, Recorder, Stamp, nanoseconds};
use crate::transport::address::Address;
use crate::transport::{BAUD, BAUD_FALLBACK, READ_WAIT};

/// How long to wait for a reply before the command is repeated. A reply takes a few milliseconds over a serial
/// line, and up to a second through an emulator's.
const REPLY_WAIT: Duration = Duration::from_millis(250);

/// How often a command is sent before the device counts as silent.
const TRIES: u32 = 6;

/// How often the handshake is sent at one speed; a board that is still starting answers the second or third.
const HANDSHAKE_TRIES: u32 = 4;

/// How long to wait between attempts to reopen a link that broke.
const REOPEN_WAIT: Duration = Duration::from_millis(100);

/// A stream is told to be silent after this ...
const SILENCE: Duration = Duration::from_millis(100);

/// ... and after so many of its blocks, if they take longer.
const SILENCE_BLOCKS: u32 = 5;

/// A stream that is silent for this long is asked whether it is still one: the hello of a device that restarted may
/// have been damaged on its way.
const QUIET: Duration = Duration::from_millis(500);

/// After a gap longer than this the device's time may have wrapped unseen, so that samples cannot be counted
/// across it: half of its 71.6 minutes, less a margin.
const COUNTABLE_GAP: Duration = Duration::from_secs(30 * 60);

/// What a session hands on, in order of arrival.
#[derive(Clone, Debug)]
pub enum Incoming {
    /// Consecutive samples, in counts.
    Samples(Samples),
    /// Something the device noticed.
    Event(Event),
    /// Temperature of the board.
    Temperature(Temperature),
    /// Excitation and NTC, where the front-end has channels for them.
    SlowChannels(SlowChannels),
    /// Digital inputs, as they changed or stood at the start of the stream.
    Inputs(InputLevels),
    /// A force that the device computed, checked against the samples that it is of.
    Force(DeviceForce),
    /// The device started anew: its settings were restored, its sample numbers begin again at 0.
    Restarted(Hello),
    /// The device streams and its samples have stopped coming, though the link stands. Told once until they come again.
    Silent {
        /// How long ago the last samples came.
        after: Duration,
    },
    /// The link broke, or cannot be opened again for another reason than before.
    Disconnected {
        /// How that was noticed.
        reason: String,
    },
    /// The link is back and the settings are restored.
    Reconnected {
        /// How long the link was down.
        after: Duration,
        /// Whether the samples that were missed can be counted. After half an hour the device's clock may have
        /// wrapped unseen.
        countable: bool,
    },
}

/// Levels of a board's digital inputs, placed on the device's time line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InputLevels {
    /// Device time, in µs and without wrap, of the sample with which they were first read so; what changed last changed
    /// since the sample before.
    pub time_us: u64,
    /// A bit for each input, 1 for high.
    pub levels: u8,
    /// Changes since the message before; more than 1 where several came at once or faster than they are told, 0 at the
    /// start of the stream.
    pub changes: u16,
}

/// A force as the device computed it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceForce {
    /// Device time of the middle of its samples' stamps, in µs and without wrap.
    pub time_us: u64,
    /// Mean force on x and y of the finger, in N.
    pub force_finger: [f64; 2],
    /// What holds for its samples; of saturated or unsettled ones it says nothing.
    pub status: Status,
    /// Whether it is, bit for bit, what the samples before it give; `None` where these did not come.
    pub agrees: Option<bool>,
}

/// How often forces that the device computed were held against its samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ForceCheck {
    /// Forces that were what the samples give.
    pub equal: u64,
    /// Forces that were not.
    pub different: u64,
    /// Forces whose samples did not come.
    pub unchecked: u64,
}

/// What a session has counted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SessionCounts {
    /// Samples received, each once.
    pub samples: u64,
    /// Samples that never came, or that came while the device was not known to be set as before. After a restart of the
    /// device all from its number 0 on; those lost in the restart itself have no numbers and are not here.
    pub missing: u64,
    /// Samples that came again, or too late, and were dropped.
    pub repeated: u64,
    /// Frames damaged on the way, or whose contents make no sense, such as a number far from all others.
    pub damaged_frames: u64,
    /// Messages of a newer device that this version cannot read, skipped.
    pub unknown_messages: u64,
    /// Commands that had to be repeated.
    pub commands_repeated: u64,
    /// Times the link broke.
    pub disconnections: u64,
    /// Times the device started anew.
    pub restarts: u64,
}

/// How a session is opened.
#[derive(Clone, Debug)]
pub struct SessionOptions {
    /// Speed of the serial line; by default both speeds that boards use are tried.
    pub baud: Option<u32>,
    /// Reopen the link by itself when it breaks.
    pub reconnect: bool,
}

impl Default for SessionOptions {
    fn default() -> Self {
        Self { baud: None, reconnect: true }
    }
}

/// How a device is set: what its samples mean depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings {
    /// Samples a second.
    pub rate_hz: u32,
    /// Gain of the front-end's amplifiers.
    pub gain: u8,
    /// Where the samples come from.
    pub source: Source,
}

impl Settings {
    /// As a device states them.
    #[must_use]
    pub fn of(hello: &Hello) -> Self {
        Self { rate_hz: hello.rate_hz, gain: hello.gain, source: hello.source }
    }

    /// The requests that make of a device that is set like this one that is set like `other`.
    fn requests_to(self, other: Self) -> impl Iterator<Item = Request> {
        let source = (self.source != other.source).then_some(Request::SetSource { source: other.source });
        let rate = (self.rate_hz != other.rate_hz).then_some(Request::SetRate { rate_hz: other.rate_hz });
        let gain = (self.gain != other.gain).then_some(Request::SetGain { gain: other.gain });
        [source, rate, gain].into_iter().flatten()
    }
}

impl fmt::Display for Settings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let source = match self.source {
            Source::Hardware => "own front-end",
            Source::Simulated => "simulated finger",
        };
        write!(f, "{} Hz, gain {}, {source}", self.rate_hz, self.gain)
    }
}

/// What a session gives back to a device that restarted.
#[derive(Clone, Copy, Debug)]
struct Wanted {
    settings: Settings,
    streaming: bool,
}

/// What is known of the device that sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Standing {
    /// It is the one that was opened, set as it shall be.
    Known,
    /// It counts anew without having said why.
    CountsAnew,
    /// It started anew or was set otherwise; its settings are still to be restored.
    Unrestored,
}

/// What is known of the next sample's number after a device was found anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Numbers {
    /// They begin at 0: the device said that it started, or its numbers did.
    FromZero,
    /// It may as well have been stopped, or set otherwise, by another host.
    Unknown,
}

/// A conversation with one device.
#[derive(Debug)]
pub struct Session {
    address: Address,
    options: SessionOptions,
    simulated: Option<Arc<SimulatedDevice>>,
    link: Link,
    /// What a recorded program took in beside the link, and this one has not yet.
    inputs: Vec<Input>,
    /// What came from a simulated device that was asked to go on, or asked whether this is all, and is not taken yet.
    asked_for: VecDeque<(Heard, Vec<Entry>)>,
    /// What is to be noted of the answer to that question, before the next one: it is heard on the way to what comes then.
    answer: Vec<Entry>,
    /// Whether such a device may have sent more than has arrived.
    owes: bool,
    baud: u32,
    hello: Hello,
    next_id: u32,
    wanted: Wanted,
    standing: Standing,
    /// How often the device was found anew: a restoration that this overtakes is void.
    findings: u64,
    /// What is to be handed on, and when it came.
    backlog: VecDeque<(Incoming, Instant)>,
    /// When what was handed on last came.
    arrival: Instant,
    /// The newest block's arrival, on both of the computer's clocks.
    wall: Option<Stamp>,
    sequence: Sequence,
    clock: ClockMap,
    counts: SessionCounts,
    down_since: Option<Instant>,
    last_heard: Instant,
    /// When samples last came, or were asked for.
    last_samples: Instant,
    /// How long the last block took to take.
    block: Duration,
    silence_told: bool,
    last_status: Status,
    temperature_c: Option<f64>,
    slow: SlowReadings,
    input_levels: Option<InputLevels>,
    device_forces: DeviceForces,
    /// Added to the device's time, so that it goes on over the device's restarts.
    time_base_us: u64,
    /// Found while taking in a message; told by the next call.
    pending_error: Option<LinkError>,
    /// Why the link could not be opened again, as last told.
    still_down: String,
}

impl Session {
    /// Opens the device at `address` and greets it.
    ///
    /// For a [`Address::Simulated`] address a simulated device is started, which lives as long as the session.
    ///
    /// # Errors
    /// [`LinkError`]: the port cannot be opened, nobody answers, or the device speaks another protocol or says in its
    /// hello what only a newer version knows.
    pub fn open(address: &Address, options: SessionOptions) -> Result<Self, LinkError> {
        Self::open_noted(address, options, None)
    }

    /// The same, with everything that it goes by noted for `recorder`.
    ///
    /// # Errors
    /// As [`Session::open`].
    pub fn open_noted(
        address: &Address,
        options: SessionOptions,
        recorder: Option<Box<dyn Recorder>>,
    ) -> Result<Self, LinkError> {
        let cannot = |what, source| LinkError::Open { address: address.to_string(), what, source };
        let simulated = match address {
            Address::Simulated { seed } => {
                let started = SimulatedDevice::start_default(*seed);
                Some(Arc::new(started.map_err(|source| cannot(Opened::Simulation, source))?))
            }
            Address::Recording(_) => return Err(cannot(Opened::Recording, io::ErrorKind::Unsupported.into())),
            _ => None,
        };
        Self::open_with(address, options, simulated, Link::live(Instant::now(), recorder))
    }

    /// Opens what another session went by. `scanned` and `entries` are the same entries, from the beginning: the first are
    /// gone through at once.
    ///
    /// # Errors
    /// As [`Session::open`]; [`LinkError::Unplugged`] where no device answers in the recording.
    pub fn open_recorded(
        address: &Address,
        options: SessionOptions,
        scanned: impl Iterator<Item = Entry>,
        entries: Box<dyn Iterator<Item = Entry> + Send>,
        speed: PlaySpeed,
        recorder: Option<Box<dyn Recorder>>,
    ) -> Result<Self, LinkError> {
        let link = Link::taped(Instant::now(), Tape::new(scanned, entries, speed), recorder);
        Self::open_with(address, options, None, link)
    }

    /// Opens a simulated device that the caller has set up, through whatever line it has.
    ///
    /// # Errors
    /// As [`Session::open`].
    pub fn open_simulated(device: Arc<SimulatedDevice>, options: SessionOptions) -> Result<Self, LinkError> {
        Self::open_simulated_noted(device, options, None)
    }

    /// The same, with everything that it goes by noted for `recorder`.
    ///
    /// # Errors
    /// As [`Session::open`].
    pub fn open_simulated_noted(
        device: Arc<SimulatedDevice>,
        options: SessionOptions,
        recorder: Option<Box<dyn Recorder>>,
    ) -> Result<Self, LinkError> {
        Self::open_with(&device.address().clone(), options, Some(device), Link::live(Instant::now(), recorder))
    }

    fn open_with(
        address: &Address,
        options: SessionOptions,
        simulated: Option<Arc<SimulatedDevice>>,
        mut link: Link,
    ) -> Result<Self, LinkError> {
        let epoch = link.epoch();
        // A first id that no earlier host is likely to have used; see `CommandId`.
        #[expect(clippy::cast_possible_truncation, reason = "any 32 bits will do")]
        let mut next_id = RandomState::new().hash_one(epoch) as u32;
        let greeted = greet(&mut link, address, &options, simulated.as_deref(), &mut next_id)?;
        let mut session = Self {
            address: address.clone(),
            options,
            simulated,
            link,
            inputs: Vec::new(),
            asked_for: VecDeque::new(),
            answer: Vec::new(),
            owes: true,
            baud: greeted.baud,
            wanted: Wanted { settings: Settings::of(&greeted.hello), streaming: false },
            standing: Standing::Known,
            findings: 0,
            hello: greeted.hello,
            next_id,
            backlog: VecDeque::new(),
            arrival: epoch,
            wall: None,
            sequence: Sequence::default(),
            clock: ClockMap::default(),
            counts: SessionCounts::default(),
            down_since: None,
            last_heard: epoch,
            last_samples: epoch,
            block: Duration::ZERO,
            silence_told: false,
            last_status: Status::default(),
            temperature_c: None,
            slow: SlowReadings::default(),
            input_levels: None,
            device_forces: DeviceForces::default(),
            time_base_us: 0,
            pending_error: None,
            still_down: String::new(),
        };
        session.take_early(greeted.early);
        let hello = &session.hello;
        tracing::info!("{address}: device {}, {} Hz, gain {}", hello.device, hello.rate_hz, hello.gain);
        Ok(session)
    }

    /// Who the device is and how it is set.
    #[must_use]
    pub fn hello(&self) -> &Hello {
        &self.hello
    }

    /// Where the device is.
    #[must_use]
    pub fn address(&self) -> &Address {
        &self.address
    }

    /// The simulated device behind this session, if it is one of this process: the hand that presses.
    #[must_use]
    pub fn simulated(&self) -> Option<&Arc<SimulatedDevice>> {
        self.simulated.as_ref()
    }

    /// Whether what this device sends is made up: it says so itself, or a block of samples did.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.hello.source == Source::Simulated || self.last_status.contains(Status::SIMULATED)
    }

    /// The finger's temperature, in °C, where the front-end has an NTC at its clamp, or the board's as it last told;
    /// `None` where neither has a sensor.
    #[must_use]
    pub fn temperature_c(&self) -> Option<f64> {
        self.slow.ntc_c().or(self.temperature_c)
    }

    /// The digital inputs as last told; `None` before the first stream, and from firmware before protocol 1.4.
    #[must_use]
    pub fn inputs(&self) -> Option<InputLevels> {
        self.input_levels
    }

    /// The bridges' excitation as last measured, in V; `None` where the front-end has no channel for it.
    ///
    /// Where there is one, counts are handed on as they would be at the excitation of [`Self::hello`]: what the bridges
    /// give is proportional to it.
    #[must_use]
    pub fn excitation_v(&self) -> Option<f64> {
        self.slow.excitation_v()
    }

    /// What was counted so far.
    #[must_use]
    pub fn counts(&self) -> SessionCounts {
        let read = self.link.counts();
        SessionCounts {
            samples: self.sequence.received() - self.sequence.repeated(),
            missing: self.sequence.missing(),
            repeated: self.sequence.repeated(),
            damaged_frames: read.unusable() + self.sequence.strays(),
            unknown_messages: read.unknown,
            ..self.counts
        }
    }

    /// How the device's clock relates to [`Session::epoch`].
    #[must_use]
    pub fn clock(&self) -> Option<ClockEstimate> {
        self.clock.estimate()
    }

    /// Zero of the host times that [`Session::clock`] gives.
    #[must_use]
    pub fn epoch(&self) -> Instant {
        self.link.epoch()
    }

    /// Now, on the clock of [`Session::epoch`]: in a recording, where it is played to.
    #[must_use]
    pub fn now(&self) -> Instant {
        self.link.now()
    }

    /// When what [`Session::next`] handed on last came from the link.
    #[must_use]
    pub fn arrival(&self) -> Instant {
        self.arrival
    }

    /// A moment on the device's clock as Unix time, in s: by [`Session::clock`], and by this computer's clocks when the
    /// newest block came. `None` before the first.
    #[must_use]
    pub fn unix_time_s(&self, device_s: f64) -> Option<f64> {
        let (clock, wall) = (self.clock()?, self.wall?);
        let epoch_unix_ns = i128::from(wall.unix_ns) - i128::from(wall.since(self.epoch()));
        Some(epoch_unix_ns as f64 * 1e-9 + clock.host_time(device_s))
    }

    /// Unix time at which the newest block came, ns; `None` before the first.
    #[must_use]
    pub fn unix_time_of_arrival_ns(&self) -> Option<u64> {
        self.wall.map(|wall| wall.unix_ns)
    }

    /// When the device's clock showed so many seconds: exactly for a simulated device in real time that has not started
    /// anew, otherwise by [`Session::clock`].
    #[must_use]
    pub fn moment(&self, device_s: f64) -> Option<Instant> {
        match (self.link.simulated_epoch(), self.clock()) {
            (Some(epoch), _) if self.counts.restarts == 0 => Some(epoch + Duration::from_secs_f64(device_s)),
            (_, Some(clock)) => Some(self.epoch() + Duration::from_secs_f64(clock.host_time(device_s).max(0.0))),
            (_, None) => None,
        }
    }

    /// Whether this is a recording that is played.
    #[must_use]
    pub fn is_recorded(&self) -> bool {
        self.link.is_taped()
    }

    /// Whether a recording has no more to give: it was played to its end, or to where somebody stopped its program.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.link.is_over()
    }

    /// Notes that the person at the keyboard wishes the program to stop: a recording ends here.
    pub fn note_interruption(&mut self) {
        self.link.note(LinkEvent::Interrupted);
    }

    /// Notes what the program takes in beside the link, at its place among the samples.
    pub fn note_input(&mut self, input: Input) {
        self.link.note_input(input);
    }

    /// What the recorded program took in by this place beside the link from one source, line by line, `None` where it
    /// ended; nothing on a live link. What is of other sources waits for who asks for it.
    pub fn recorded_inputs(&mut self, source: &str) -> Vec<Option<String>> {
        let inputs = self.link.recorded_inputs();
        inputs.iter().for_each(|input| self.link.note_input(input.clone()));
        self.inputs.extend(inputs);
        let (wanted, rest): (Vec<_>, Vec<_>) = self.inputs.drain(..).partition(|input| input.source == source);
        self.inputs = rest;
        wanted.into_iter().map(|input| input.line).collect()
    }
}

/// Commands and their replies.
impl Session {
    /// Sends `request` until its reply comes.
    ///
    /// # Errors
    /// [`LinkError::Refused`], [`LinkError::Unanswered`], [`LinkError::Unplugged`]; [`LinkError::NewerAnswer`] or
    /// [`LinkError::NewerHello`], at the first such answer, if only a newer version can read it: whether the device
    /// obeyed is then not known.
    pub fn request(&mut self, request: Request) -> Result<Outcome, LinkError> {
        let id = CommandId(self.next_id);
        self.next_id = self.next_id.wrapping_add(1);
        let (begun, command) = (self.now(), Command::new(id, request));
        for attempt in 0..TRIES {
            if attempt > 0 {
                self.counts.commands_repeated += 1;
                tracing::debug!("{}: repeating a command: {}", self.address, in_words(request));
            }
            self.send(&command)?;
            if let Some(outcome) = self.wait_for_reply(&command)? {
                let outcome = accepted(request, outcome)?;
                self.take_note(request);
                return Ok(outcome);
            }
        }
        Err(LinkError::Unanswered {
            request: in_words(request),
            times: TRIES,
            within: self.now().saturating_duration_since(begun),
        })
    }

    /// What the device has done by request, a restart does not undo.
    fn take_note(&mut self, request: Request) {
        let now = self.now();
        let settings = &mut self.wanted.settings;
        match request {
            Request::SetRate { rate_hz } => settings.rate_hz = rate_hz,
            Request::SetGain { gain } => settings.gain = gain,
            Request::SetSource { source } => settings.source = source,
            Request::SetForceMatrix { matrix, .. } => self.device_forces.matrix = Some(matrix),
            Request::SetForceTare { tare } => self.device_forces.tare(tare),
            Request::StreamForces { on } => self.device_forces.is_on = on,
            Request::Start => {
                self.wanted.streaming = true;
                self.samples_came(now);
            }
            Request::Stop => self.wanted.streaming = false,
            _ => {}
        }
    }

    /// Starts streaming.
    ///
    /// # Errors
    /// As [`Session::request`]; refused where no front-end answers.
    pub fn start(&mut self) -> Result<(), LinkError> {
        self.expect_first_number()?;
        self.request(Request::Start).map(drop)
    }

    /// Finds out which number the first sample will have, so that it shows what is lost before the first block: the
    /// numbers rest while the stream is stopped, and there are as many as samples were numbered.
    fn expect_first_number(&mut self) -> Result<(), LinkError> {
        if !self.sequence.is_open() || self.hello.streaming {
            return Ok(());
        }
        match self.request(Request::Counters) {
            Ok(Outcome::Counters(counters)) => self.sequence.expect(Seq(counters.samples)),
            // Then the first block tells.
            Ok(_) | Err(LinkError::Refused { .. } | LinkError::NewerAnswer { .. } | LinkError::NotRecorded { .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Stops streaming; what was queued before is still handed on.
    ///
    /// # Errors
    /// As [`Session::request`].
    pub fn stop(&mut self) -> Result<(), LinkError> {
        self.wanted.streaming = false;
        self.request(Request::Stop).map(drop)
    }

    /// Sets the sample rate, in Hz.
    ///
    /// # Errors
    /// As [`Session::request`]; refused where the front-end or the line cannot do it.
    pub fn set_rate(&mut self, rate_hz: u32) -> Result<(), LinkError> {
        self.request(Request::SetRate { rate_hz })?;
        self.hello.rate_hz = rate_hz;
        self.refresh_hello()
    }

    /// Sets the gain.
    ///
    /// # Errors
    /// As [`Session::request`]; refused where the front-end has no such gain.
    pub fn set_gain(&mut self, gain: u8) -> Result<(), LinkError> {
        self.request(Request::SetGain { gain })?;
        self.refresh_hello()
    }

    /// Takes samples from the board's front-end or from its built-in simulation.
    ///
    /// # Errors
    /// As [`Session::request`]; refused where the board has no such source.
    pub fn set_source(&mut self, source: Source) -> Result<(), LinkError> {
        self.request(Request::SetSource { source })?;
        self.refresh_hello()
    }

    /// Reads a register of the front-end.
    ///
    /// # Errors
    /// As [`Session::request`].
    pub fn read_register(&mut self, address: u8) -> Result<u16, LinkError> {
        let request = Request::ReadRegister { address };
        match self.request(request)? {
            Outcome::Register { value, .. } => Ok(value),
            _ => Err(LinkError::WrongAnswer { request: in_words(request) }),
        }
    }

    /// Asks the device to check its front-end.
    ///
    /// # Errors
    /// As [`Session::request`].
    pub fn self_test(&mut self) -> Result<SelfTest, LinkError> {
        match self.request(Request::SelfTest)? {
            Outcome::SelfTest(result) => Ok(result),
            _ => Err(LinkError::WrongAnswer { request: in_words(Request::SelfTest) }),
        }
    }

    /// What the device has counted since it started.
    ///
    /// # Errors
    /// As [`Session::request`].
    pub fn device_counters(&mut self) -> Result<Counters, LinkError> {
        match self.request(Request::Counters)? {
            Outcome::Counters(counters) => Ok(counters),
            _ => Err(LinkError::WrongAnswer { request: in_words(Request::Counters) }),
        }
    }

    /// What the device recorded of its last fault; `None` if there was none since power-on.
    ///
    /// # Errors
    /// As [`Session::request`]; refused by devices that keep no record.
    pub fn last_fault(&mut self) -> Result<Option<Fault>, LinkError> {
        match self.request(Request::LastFault)? {
            Outcome::LastFault(fault) => Ok(fault),
            _ => Err(LinkError::WrongAnswer { request: in_words(Request::LastFault) }),
        }
    }

    /// How much stack and processor time the device uses.
    ///
    /// # Errors
    /// As [`Session::request`]; refused by devices that do not know.
    pub fn health(&mut self) -> Result<Health, LinkError> {
        match self.request(Request::Health)? {
            Outcome::Health(health) => Ok(health),
            _ => Err(LinkError::WrongAnswer { request: in_words(Request::Health) }),
        }
    }

    /// Exchanges one frame with the front-end, byte for byte, and gives what came in. The device then leaves its front-end
    /// alone until a second has passed or another command needs it, so that the next frame brings the answer to this one.
    ///
    /// # Errors
    /// As [`Session::request`]; refused while samples are streamed, and by firmware that speaks a protocol before 1.2.
    pub fn raw_frame(&mut self, bytes: [u8; RAW_FRAME_BYTES]) -> Result<[u8; RAW_FRAME_BYTES], LinkError> {
        let request = Request::RawFrame { bytes };
        match self.request(request)? {
            Outcome::RawFrame { bytes } => Ok(bytes),
            _ => Err(LinkError::WrongAnswer { request: in_words(request) }),
        }
    }

    /// Has the device compute forces by this matrix, and send one with each block; or no longer. Not while it streams.
    ///
    /// Forces come beside the samples, and each is held against them: whoever has both goes by the samples. A device that
    /// starts anew gets the matrix again.
    ///
    /// # Errors
    /// As [`Session::request`]; refused while streaming, and where the line does not carry both at this rate.
    pub fn set_device_forces(&mut self, matrix: Option<ForceMatrix>) -> Result<(), LinkError> {
        if let Some(matrix) = matrix {
            self.request(Request::SetForceMatrix { matrix, checksum: matrix.checksum() })?;
        }
        self.request(Request::StreamForces { on: matrix.is_some() }).map(drop)
    }

    /// The matrix by which the device computes forces; from its flash, where nobody gave it another since it started.
    ///
    /// # Errors
    /// As [`Session::request`].
    pub fn device_matrix(&mut self) -> Result<Option<ForceMatrix>, LinkError> {
        match self.request(Request::ForceMatrix)? {
            Outcome::ForceMatrix(matrix) => Ok(matrix),
            _ => Err(LinkError::WrongAnswer { request: in_words(Request::ForceMatrix) }),
        }
    }

    /// Has the device keep its matrix over restarts, in its flash, or no longer; gives for how long it stood still. Not while
    /// it streams.
    ///
    /// # Errors
    /// As [`Session::request`]; refused where it has no matrix, or its flash does not take it, and by firmware that speaks a
    /// protocol before 1.7.
    pub fn store_device_matrix(&mut self, keep: bool) -> Result<Duration, LinkError> {
        let request = Request::StoreForceMatrix { keep };
        match self.request(request)? {
            Outcome::Stored { stalled_us } => Ok(Duration::from_micros(stalled_us.into())),
            _ => Err(LinkError::WrongAnswer { request: in_words(request) }),
        }
    }

    /// How the device's forces compared with its samples so far.
    #[must_use]
    pub fn force_check(&self) -> ForceCheck {
        self.device_forces.check
    }

    /// Restarts the device. [`Session::next`] then hands on [`Incoming::Restarted`] and restores the settings.
    ///
    /// # Errors
    /// As [`Session::request`]; refused by devices that cannot.
    pub fn reboot(&mut self) -> Result<(), LinkError> {
        self.request(Request::Reboot).map(drop)
    }

    /// Restarts the device into its chip's own loader, which speaks DFU over USB and nothing on this link.
    ///
    /// # Errors
    /// As [`Session::request`]; refused by devices that cannot, and by firmware that speaks a protocol before 1.6.
    pub fn enter_loader(&mut self) -> Result<(), LinkError> {
        self.request(Request::EnterLoader).map(drop)
    }

    /// Measures the round trip to the device, and with it the offset between the clocks.
    ///
    /// In a recording that has no ping here nothing is measured, and the round trip is 0.
    ///
    /// # Errors
    /// As [`Session::request`].
    pub fn ping(&mut self) -> Result<Duration, LinkError> {
        let sent = self.now();
        let time = match self.request(Request::Ping) {
            Ok(Outcome::Pong { time }) => time,
            Ok(_) => return Err(LinkError::WrongAnswer { request: in_words(Request::Ping) }),
            Err(LinkError::NotRecorded { .. }) => return Ok(Duration::ZERO),
            Err(error) => return Err(error),
        };
        let received = self.now();
        let since = |at: Instant| nanoseconds(at.saturating_duration_since(self.epoch()));
        let measured = LinkEvent::Pinged { sent_ns: since(sent), received_ns: since(received) };
        let measured = self.link.recorded(|event| matches!(event, LinkEvent::Pinged { .. })).unwrap_or(measured);
        if let LinkEvent::Pinged { sent_ns, received_ns } = measured {
            let [sent, received] = [sent_ns, received_ns].map(|ns| Duration::from_nanos(ns).as_secs_f64());
            let device_s = self.sequence.unwrap_time(time) as f64 * 1e-6;
            self.clock.ping(sent, device_s, received);
        }
        self.link.note(measured);
        Ok(received.saturating_duration_since(sent))
    }

    fn refresh_hello(&mut self) -> Result<(), LinkError> {
        match self.request(Request::Hello)? {
            Outcome::Hello(hello) => self.hello = hello,
            _ => return Err(LinkError::WrongAnswer { request: in_words(Request::Hello) }),
        }
        Ok(())
    }

    fn send(&mut self, command: &Command) -> Result<(), LinkError> {
        if !self.link.is_open() {
            return Err(gone(&self.address, "not connected".to_owned()));
        }
        self.owes = true;
        match self.link.send(command) {
            // Repeated later, like a command that was lost on the way.
            Err(error) if error.kind() == io::ErrorKind::TimedOut => Ok(()),
            Err(error) if self.link.is_taped() && error.kind() == io::ErrorKind::Unsupported => {
                Err(LinkError::NotRecorded { request: in_words(command.request) })
            }
            Err(error) => Err(self.broken(error.to_string())),
            Ok(()) => Ok(()),
        }
    }

    /// Waits for the reply to `command`; everything else that arrives meanwhile goes to the backlog, in order.
    fn wait_for_reply(&mut self, command: &Command) -> Result<Option<Outcome>, LinkError> {
        let deadline = Instant::now() + REPLY_WAIT;
        loop {
            let wait = deadline.saturating_duration_since(Instant::now());
            match self.receive(wait) {
                Heard::Nothing | Heard::Over | Heard::Recorded(LinkEvent::NoReply) => {
                    self.link.note(LinkEvent::NoReply);
                    return Ok(None);
                }
                // Of a program that did something else.
                Heard::Recorded(_) => {}
                Heard::Broken(reason) => return Err(self.broken(reason)),
                Heard::Message(message, came) => match *message {
                    FromDevice::Reply(reply) if reply.id == command.id => return Ok(Some(reply.outcome)),
                    message => self.take_in(message, came),
                },
                Heard::Newer(NewerMessage::Reply { id, device }, _) if id == command.id => {
                    return Err(newer_answer(command, device, Some(self.hello.protocol)));
                }
                Heard::Newer(newer, came) => self.take_in_newer(newer, came),
            }
        }
    }
}

/// Samples, events and changes of the link, as they arrive.
impl Session {
    /// The next samples, event or change of the link; `None` if nothing came within `wait`.
    ///
    /// # Errors
    /// [`LinkError::Unplugged`] if the link broke and may not be reopened; [`LinkError::OtherDevice`],
    /// [`LinkError::OtherSettings`], [`LinkError::OtherProtocol`] or [`LinkError::NewerHello`] if what came back is not
    /// what was there; any other error means that the device refuses what it accepted before.
    pub fn next(&mut self, wait: Duration) -> Result<Option<Incoming>, LinkError> {
        let deadline = Instant::now() + wait;
        loop {
            if let Some(error) = self.pending_error.take() {
                return Err(error);
            }
            if let Some((incoming, came)) = self.backlog.pop_front() {
                self.arrival = came;
                if matches!(incoming, Incoming::Restarted(_)) && !self.restore()? {
                    // Told once it is restored: the device is gone again, or started once more.
                    continue;
                }
                return Ok(Some(incoming));
            }
            if self.link.is_over() {
                return Ok(None);
            }
            if !self.link.is_open() {
                self.reopen()?;
            } else if self.standing == Standing::CountsAnew {
                self.ask_after_numbers()?;
            } else {
                let left = deadline.saturating_duration_since(Instant::now());
                match self.receive(left.min(QUIET).min(self.until_silence())) {
                    Heard::Message(message, came) => self.take_in(*message, came),
                    Heard::Newer(newer, came) => self.take_in_newer(newer, came),
                    Heard::Nothing if self.is_silent() => self.tell_silence(self.last_samples.elapsed()),
                    Heard::Nothing if self.wanted.streaming && self.last_heard.elapsed() > QUIET => {
                        self.ask_after_stream()?;
                    }
                    Heard::Recorded(LinkEvent::Silent { after_ns }) => {
                        self.tell_silence(Duration::from_nanos(after_ns));
                    }
                    Heard::Recorded(LinkEvent::StreamAsked) => self.ask_after_stream()?,
                    Heard::Broken(reason) => {
                        let error = self.broken(reason);
                        if !self.options.reconnect {
                            return Err(error);
                        }
                    }
                    Heard::Nothing | Heard::Over | Heard::Recorded(_) => {}
                }
            }
            if self.backlog.is_empty() && self.is_time_up(deadline) {
                self.link.note(LinkEvent::Idle);
                return Ok(None);
            }
        }
    }

    /// Drops samples that have arrived and were not yet handed on; events and changes of the link stay.
    pub fn forget_waiting(&mut self) {
        self.backlog.retain(|(incoming, _)| {
            !matches!(
                incoming,
                Incoming::Samples(_)
                    | Incoming::Temperature(_)
                    | Incoming::SlowChannels(_)
                    | Incoming::Inputs(_)
                    | Incoming::Force(_)
            )
        });
    }

    /// Whether nothing is handed on this time: on a tape, where nothing was.
    fn is_time_up(&mut self, deadline: Instant) -> bool {
        if self.link.is_taped() {
            return self.link.recorded(|event| *event == LinkEvent::Idle).is_some();
        }
        Instant::now() >= deadline
    }

    fn tell_silence(&mut self, after: Duration) {
        self.link.note(LinkEvent::Silent { after_ns: nanoseconds(after) });
        self.silence_told = true;
        self.hand_on(Incoming::Silent { after });
    }

    /// Puts something behind what is to be handed on, which came now.
    fn hand_on(&mut self, incoming: Incoming) {
        self.backlog.push_back((incoming, self.link.now()));
    }

    fn receive(&mut self, wait: Duration) -> Heard {
        if !self.link.is_open() {
            return Heard::Nothing;
        }
        match self.simulated.clone().filter(|device| device.pace() == Pace::AsAsked) {
            Some(device) => self.receive_as_asked(&device),
            None => self.link.receive(wait),
        }
    }

    /// What a device at its session's pace sent, in order; where there is nothing more, its time goes on for a while.
    fn receive_as_asked(&mut self, device: &SimulatedDevice) -> Heard {
        if self.asked_for.is_empty() && self.owes {
            self.take_what_is_owed();
        }
        if self.asked_for.is_empty() {
            match device.let_time_pass() {
                Ok(_) => self.take_what_is_owed(),
                Err(gone) => return Heard::Broken(gone.to_string()),
            }
        }
        let Some((heard, entries)) = self.asked_for.pop_front() else { return Heard::Nothing };
        // Only now, so that what comes in beside the link is noted between what is taken before it and after.
        self.link.note_held(entries);
        heard
    }

    /// Takes all that a device has sent whose time stands still: on a line that keeps the order, what comes before the
    /// answer to a ping.
    fn take_what_is_owed(&mut self) {
        let answer = std::mem::take(&mut self.answer);
        self.link.note_held(answer);
        self.link.hold();
        self.hear_what_is_owed();
        self.answer = self.link.let_go();
    }

    fn hear_what_is_owed(&mut self) {
        let id = CommandId(self.next_id);
        self.next_id = self.next_id.wrapping_add(1);
        if !self.link.is_open() {
            return;
        }
        if let Err(error) = self.link.send(&Command::new(id, Request::Ping)) {
            self.owed(Heard::Broken(error.to_string()));
            return;
        }
        self.owes = false;
        loop {
            let heard = self.link.receive(REPLY_WAIT);
            match &heard {
                Heard::Nothing => break,
                Heard::Message(message, _) if matches!(&**message, FromDevice::Reply(reply) if reply.id == id) => {
                    return;
                }
                Heard::Broken(_) => return self.owed(heard),
                _ => self.owed(heard),
            }
        }
        // The ping or its answer was lost on the way, or takes long: it is asked again.
        self.owes = true;
    }

    /// Keeps what a device has sent until it is taken, with what is to be noted of it.
    fn owed(&mut self, heard: Heard) {
        let entries = self.link.held();
        self.asked_for.push_back((heard, entries));
    }

    /// How long samples may stay away.
    fn silence(&self) -> Duration {
        SILENCE.max(self.block * SILENCE_BLOCKS)
    }

    /// Whether samples are due and the line was found empty for too long.
    fn is_silent(&self) -> bool {
        let found_nothing = self.link.found_nothing();
        let is_empty =
            found_nothing.is_some_and(|at| at.saturating_duration_since(self.last_samples) >= self.silence());
        self.wanted.streaming && !self.silence_told && self.standing == Standing::Known && is_empty
    }

    /// How long to wait before looking whether the stream is silent.
    fn until_silence(&self) -> Duration {
        if !self.wanted.streaming || self.silence_told {
            return QUIET;
        }
        self.silence().saturating_sub(self.last_samples.elapsed()).max(READ_WAIT)
    }

    /// Finds out why the stream is silent: a device that does not stream any more has started anew.
    fn ask_after_stream(&mut self) -> Result<(), LinkError> {
        self.link.note(LinkEvent::StreamAsked);
        self.last_heard = self.now();
        match self.request(Request::Hello) {
            Ok(Outcome::Hello(hello)) if !self.is_as_left(&hello) => self.restarted(hello, Numbers::Unknown),
            // It is there, or gone: either shows by itself.
            Ok(_) | Err(LinkError::Unplugged { .. } | LinkError::Unanswered { .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Finds out what a device that counts anew is now: its hello did not arrive.
    fn ask_after_numbers(&mut self) -> Result<(), LinkError> {
        match self.request(Request::Hello) {
            Ok(Outcome::Hello(hello)) => self.restarted(hello, Numbers::FromZero),
            // Asked again, or gone.
            Ok(_) | Err(LinkError::Unplugged { .. } | LinkError::Unanswered { .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Whether a device still is as it was left: it did not start anew in between, nobody set it otherwise, and it
    /// streams if it shall.
    fn is_as_left(&self, hello: &Hello) -> bool {
        let same_run = (self.hello.device, self.hello.restarts) == (hello.device, hello.restarts);
        let streams = hello.streaming || !self.wanted.streaming;
        same_run && Settings::of(hello) == self.wanted.settings && streams && self.standing != Standing::Unrestored
    }

    /// Puts a message where it belongs.
    fn take_in(&mut self, message: FromDevice, came: Stamp) {
        self.last_heard = came.at;
        match message {
            FromDevice::Block(block) => self.take_block(block, came),
            FromDevice::Event(event) => self.backlog.push_back((Incoming::Event(event), came.at)),
            FromDevice::Temperature(temperature) => {
                self.temperature_c = Some(f64::from(temperature.centi_celsius) / 100.0);
                self.backlog.push_back((Incoming::Temperature(temperature), came.at));
            }
            FromDevice::Inputs(inputs) => {
                let time_us = self.time_base_us + self.sequence.time_us(inputs.time);
                let levels = InputLevels { time_us, levels: inputs.levels, changes: inputs.changes };
                self.input_levels = Some(levels);
                self.backlog.push_back((Incoming::Inputs(levels), came.at));
            }
            // Forces that a program before this one asked for, and left on, are not this one's.
            FromDevice::Force(_) if !self.device_forces.is_on => {}
            FromDevice::Force(force) => {
                let time_us = self.time_base_us + self.sequence.time_us(force.time);
                let half_us =
                    u64::from(force.samples.saturating_sub(1)) * 500_000 / u64::from(self.hello.rate_hz.max(1));
                let force = self.device_forces.take(&force, time_us + half_us);
                self.backlog.push_back((Incoming::Force(force), came.at));
            }
            FromDevice::SlowChannels(slow) => {
                self.slow.take(&self.hello, slow);
                self.backlog.push_back((Incoming::SlowChannels(slow), came.at));
            }
            FromDevice::Hello(hello) => self.restarted(hello, Numbers::FromZero),
            // The reply to a command that was answered before: the first answer was slow, not lost.
            FromDevice::Reply(_) => {}
        }
    }

    /// Takes note of a message that only a newer version can read. The reading thread has counted it.
    fn take_in_newer(&mut self, newer: NewerMessage, came: Stamp) {
        self.last_heard = came.at;
        match newer {
            // What it is now cannot be told, so neither can what its samples mean.
            NewerMessage::Hello { device } => self.pending_error = Some(LinkError::newer_hello(device)),
            // A reply to a command that was answered before, as in `take_in`.
            NewerMessage::Kind { .. } | NewerMessage::Event | NewerMessage::Reply { .. } => {}
        }
    }

    fn take_block(&mut self, block: Block, came: Stamp) {
        self.device_forces.remember(&block);
        if self.standing != Standing::Known {
            // What its samples mean is not known. They will be missing.
            return;
        }
        let place = self.sequence.place(block.first, block.time, block.samples.len());
        let rate_hz = self.hello.rate_hz.max(1);
        let (missing_before, repeated) = match place.continuity {
            Continuity::Missing(missing) => (missing, 0),
            Continuity::Repeated(repeated) => (0, usize::try_from(repeated).unwrap_or(usize::MAX)),
            Continuity::Strange => return,
            Continuity::Anew => {
                self.standing = Standing::CountsAnew;
                return;
            }
        };
        self.last_status = block.status;
        self.samples_came(came.at);
        let counts = block.samples.into_iter().skip(repeated);
        let counts: Vec<[Counts; 2]> = counts.map(|pair| pair.map(|code| self.slow.at_nominal(code))).collect();
        // What a code means is not known before the excitation is.
        let unknown = self.slow.is_awaited(&self.hello);
        let status = if unknown { block.status.with(Status::SETTLING) } else { block.status };
        if counts.is_empty() {
            return;
        }
        let samples = Samples {
            first: place.first + repeated as u64,
            missing_before,
            time_us: self.time_base_us + place.time_us + repeated as u64 * 1_000_000 / u64::from(rate_hz),
            period_us: 1e6 / f64::from(rate_hz),
            status,
            counts,
        };
        self.block = Duration::from_secs_f64(samples.counts.len() as f64 / f64::from(rate_hz));
        let since_epoch = came.at.saturating_duration_since(self.epoch());
        self.clock.arrived(samples.device_time_s(samples.counts.len() - 1), since_epoch.as_secs_f64());
        self.wall = Some(came);
        self.backlog.push_back((Incoming::Samples(samples), came.at));
    }

    /// Samples came, or are asked for anew.
    fn samples_came(&mut self, at: Instant) {
        self.last_samples = at;
        self.silence_told = false;
    }

    /// Takes note of a device that was found anew; [`Self::next`] restores its settings.
    fn restarted(&mut self, hello: Hello, numbers: Numbers) {
        self.counts.restarts += 1;
        self.found_anew(hello, numbers);
    }

    fn found_anew(&mut self, hello: Hello, numbers: Numbers) {
        self.findings += 1;
        self.standing = Standing::Unrestored;
        if !is_same_finger(&self.hello, &hello) {
            let (was, is) = (self.hello.device.to_string(), hello.device.to_string());
            self.pending_error = Some(LinkError::OtherDevice { was, is });
            return;
        }
        self.time_base_us += self.sequence.last_time_us();
        match numbers {
            Numbers::FromZero => self.sequence.begin_anew(),
            Numbers::Unknown => self.sequence.forget(),
        }
        self.clock.restart();
        self.hello = hello.clone();
        self.hand_on(Incoming::Restarted(hello));
    }

    /// Notes that the link is gone; returns the error that says so.
    fn broken(&mut self, reason: String) -> LinkError {
        if self.link.close() {
            for (_, entries) in std::mem::take(&mut self.asked_for) {
                self.link.note_held(entries);
            }
            let answer = std::mem::take(&mut self.answer);
            self.link.note_held(answer);
            self.owes = true;
            self.counts.disconnections += 1;
            self.down_since = Some(self.now());
            self.hand_on(Incoming::Disconnected { reason: reason.clone() });
        }
        gone(&self.address, reason)
    }

    /// Tries once to open the link again. Not being able to is no error: the cable may come back.
    fn reopen(&mut self) -> Result<(), LinkError> {
        let options = SessionOptions { baud: Some(self.baud), ..self.options.clone() };
        let simulated = self.simulated.as_deref();
        let greeted = match greet(&mut self.link, &self.address, &options, simulated, &mut self.next_id) {
            Ok(greeted) => greeted,
            // To ask again would bring the same answer.
            Err(
                error
                @ (LinkError::OtherProtocol { .. } | LinkError::NewerHello { .. } | LinkError::NewerAnswer { .. }),
            ) => return Err(error),
            Err(error) => {
                tracing::debug!("{}: still down: {error}", self.address);
                self.link.abandon();
                self.tell_still_down(&error);
                if !self.link.is_taped() {
                    std::thread::sleep(REOPEN_WAIT);
                }
                return Ok(());
            }
        };
        let after = self.down_since.take().map(|since| self.now().saturating_duration_since(since));
        let after = match self.link.recorded(|event| matches!(event, LinkEvent::Reconnected { .. })) {
            Some(LinkEvent::Reconnected { after_ns }) => Duration::from_nanos(after_ns),
            _ => after.unwrap_or_default(),
        };
        self.link.note(LinkEvent::Reconnected { after_ns: nanoseconds(after) });
        let (began_anew, is_told) = (!self.is_as_left(&greeted.hello), self.standing == Standing::Unrestored);
        let countable = !began_anew && after <= COUNTABLE_GAP;
        self.samples_came(self.now());
        self.still_down.clear();
        self.hand_on(Incoming::Reconnected { after, countable });
        if began_anew {
            // `next` restores the settings when it hands this on. A restart that was noticed before is the same one.
            self.counts.restarts += u64::from(!is_told);
            self.found_anew(greeted.hello, Numbers::Unknown);
        } else if !countable {
            self.time_base_us += self.sequence.last_time_us();
            self.sequence.forget();
            self.clock.restart();
        }
        self.take_early(greeted.early);
        Ok(())
    }

    /// Says why the link cannot be opened again, once for each reason.
    fn tell_still_down(&mut self, error: &LinkError) {
        if let Some(LinkEvent::NotOpened { reason, is_told }) =
            self.link.recorded(|event| matches!(event, LinkEvent::NotOpened { .. }))
        {
            return self.take_still_down(reason, is_told);
        }
        let reason = error.to_string();
        // That nothing is there is what a pulled cable looks like, and was told when the link broke.
        let expected =
            matches!(error, LinkError::NoSuchPort { .. } | LinkError::Unplugged { .. } | LinkError::Open { .. });
        let is_told = !expected && reason != self.still_down;
        self.take_still_down(reason, is_told);
    }

    fn take_still_down(&mut self, reason: String, is_told: bool) {
        self.link.note(LinkEvent::NotOpened { reason: reason.clone(), is_told });
        if is_told {
            self.hand_on(Incoming::Disconnected { reason: reason.clone() });
        }
        self.still_down = reason;
    }

    /// Takes in what arrived during the greeting, except a hello that was sent unasked: it tells of a start-up
    /// that the greeting has already dealt with.
    fn take_early(&mut self, early: Vec<(FromDevice, Stamp)>) {
        for (message, came) in early {
            if !matches!(message, FromDevice::Hello(_)) {
                self.take_in(message, came);
            }
        }
    }

    /// Gives a device that started anew the settings that it had; whether that is done. If not, it is gone, or started
    /// once more, and there is more to come.
    fn restore(&mut self) -> Result<bool, LinkError> {
        let findings = self.findings;
        let set_back = self.set_back();
        if findings != self.findings {
            // It started again meanwhile: whatever it answered says nothing.
            return Ok(false);
        }
        if !self.is_through(set_back)? {
            return Ok(false);
        }
        self.standing = Standing::Known;
        if self.wanted.streaming {
            let started = self.request(Request::Start);
            if findings == self.findings {
                // Samples may be here already, so that it was restored is told even if it is gone again.
                self.is_through(started.map(drop))?;
            }
        }
        Ok(true)
    }

    /// Whether a request went through; if it did not because the link is down, the next connection begins with a greeting
    /// and restores.
    fn is_through(&mut self, result: Result<(), LinkError>) -> Result<bool, LinkError> {
        match result {
            Ok(()) => Ok(true),
            Err(LinkError::Unplugged { .. }) if self.options.reconnect => Ok(false),
            Err(error @ LinkError::Unanswered { .. }) if self.options.reconnect => {
                self.broken(error.to_string());
                Ok(false)
            }
            Err(error) => Err(error),
        }
    }

    /// Sets the device as it was and asks whether it is.
    fn set_back(&mut self) -> Result<(), LinkError> {
        let (was, is) = (self.wanted.settings, Settings::of(&self.hello));
        for request in is.requests_to(was) {
            match self.request(request) {
                Err(LinkError::Refused { refusal, .. }) => {
                    return Err(LinkError::OtherSettings { was, is, refusal: Some(refusal) });
                }
                other => other.map(drop)?,
            }
        }
        // They are asked for at rest: a device that did not start anew, and streams, has them still.
        if let Some(matrix) = self.device_forces.wanted().filter(|_| !self.hello.streaming) {
            self.set_device_forces(Some(matrix))?;
        }
        self.refresh_hello()?;
        let is = Settings::of(&self.hello);
        if is != was {
            return Err(LinkError::OtherSettings { was, is, refusal: None });
        }
        if self.wanted.streaming { self.expect_first_number() } else { Ok(()) }
    }
}

/// Whether calibration and tare of a device hold for another hello.
fn is_same_finger(a: &Hello, b: &Hello) -> bool {
    (a.device, a.excitation_mv, a.full_scale_uv, a.channels) == (b.device, b.excitation_mv, b.full_scale_uv, b.channels)
}

/// An open link whose device has answered.
struct Greeted {
    baud: u32,
    hello: Hello,
    /// What arrived before the answer.
    early: Vec<(FromDevice, Stamp)>,
}

/// Opens the link and asks the device who it is, at each speed in turn.
fn greet(
    link: &mut Link,
    address: &Address,
    options: &SessionOptions,
    simulated: Option<&SimulatedDevice>,
    next_id: &mut u32,
) -> Result<Greeted, LinkError> {
    let speeds = match (address, options.baud) {
        (Address::Serial(_), None) => vec![BAUD, BAUD_FALLBACK],
        (_, baud) => vec![baud.unwrap_or(BAUD)],
    };
    let (mut damaged, mut tried) = (0, 0);
    while let Some(&baud) = speeds.get(tried).or(speeds.last().filter(|_| link.opens_next())) {
        tracing::debug!("{address}: asking who is there at {baud} baud");
        let baud = link.open(address, baud, simulated)?;
        if let Some((hello, early)) = ask_who(link, address, next_id)? {
            return Ok(Greeted { baud, hello, early });
        }
        damaged += link.unusable_since_opened();
        link.abandon();
        tried += 1;
    }
    let bauds = match address {
        Address::Serial(_) => speeds.iter().map(u32::to_string).collect::<Vec<_>>().join(" or "),
        _ => String::new(),
    };
    Err(LinkError::NoAnswer { address: address.to_string(), bauds, damaged })
}

/// What a greeting brought: the device's hello, and what arrived before it.
type Greeting = (Hello, Vec<(FromDevice, Stamp)>);

/// Sends the handshake until it is answered; `None` if it never is.
fn ask_who(link: &mut Link, address: &Address, next_id: &mut u32) -> Result<Option<Greeting>, LinkError> {
    let command = Command::new(CommandId(*next_id), Request::Hello);
    *next_id = next_id.wrapping_add(1);
    let mut early = Vec::new();
    for _ in 0..HANDSHAKE_TRIES {
        link.send(&command).map_err(|error| gone(address, error.to_string()))?;
        let deadline = Instant::now() + REPLY_WAIT;
        loop {
            match link.receive(deadline.saturating_duration_since(Instant::now())) {
                Heard::Message(message, came) => match *message {
                    FromDevice::Reply(Reply { id, outcome }) if id == command.id => {
                        return greeting(outcome).map(|hello| Some((hello, early)));
                    }
                    message => early.push((message, came)),
                },
                Heard::Newer(NewerMessage::Reply { id, device }, _) if id == command.id => {
                    return Err(newer_answer(&command, device, None));
                }
                // A hello that was sent unasked is what the answer will say too.
                Heard::Newer(..) => {}
                Heard::Broken(reason) => return Err(gone(address, reason)),
                Heard::Over => return Err(gone(address, "the recording ends before the device answers".to_owned())),
                Heard::Nothing | Heard::Recorded(LinkEvent::NoReply) => {
                    link.note(LinkEvent::NoReply);
                    break;
                }
                Heard::Recorded(_) => {}
            }
        }
        if let Some(device) = link.other_protocol() {
            return Err(LinkError::other_protocol(device));
        }
    }
    Ok(None)
}

/// The hello in the answer to a greeting.
fn greeting(outcome: Outcome) -> Result<Hello, LinkError> {
    match accepted(Request::Hello, outcome)? {
        Outcome::Hello(hello) => Ok(hello),
        _ => Err(LinkError::WrongAnswer { request: in_words(Request::Hello) }),
    }
}

/// The error for an answer that only a newer version can read: to a hello, of which at least the version is known, or
/// to another command of a device that speaks `spoken` as far as is known.
fn newer_answer(command: &Command, hello: Option<ProtocolVersion>, spoken: Option<ProtocolVersion>) -> LinkError {
    match hello {
        Some(device) => LinkError::newer_hello(device),
        None => LinkError::newer_answer(command.id, in_words(command.request), spoken),
    }
}

/// Turns a refusal, and the hello of a device of another major version, into an error.
fn accepted(request: Request, outcome: Outcome) -> Result<Outcome, LinkError> {
    match outcome {
        Outcome::Hello(hello) if hello.protocol.major != PROTOCOL.major => {
            Err(LinkError::other_protocol(hello.protocol))
        }
        Outcome::Refused(Refusal::OtherProtocol { device }) => Err(LinkError::other_protocol(device)),
        Outcome::Refused(refusal) => Err(LinkError::Refused { request: in_words(request), refusal }),
        outcome => Ok(outcome),
    }
}

/// A request as an error message names it.
fn in_words(request: Request) -> String {
    match request {
        Request::Hello => "to say who it is".to_owned(),
        Request::Start => "to start streaming".to_owned(),
        Request::Stop => "to stop streaming".to_owned(),
        Request::SetRate { rate_hz } => format!("a rate of {rate_hz} Hz"),
        Request::SetGain { gain } => format!("a gain of {gain}"),
        Request::SetSource { source: Source::Hardware } => "its own front-end as source".to_owned(),
        Request::SetSource { source: Source::Simulated } => "its simulated finger as source".to_owned(),
        Request::ReadRegister { address } => format!("to read register {address:#04x}"),
        Request::Ping => "a ping".to_owned(),
        Request::SelfTest => "a self-test".to_owned(),
        Request::Counters => "its counters".to_owned(),
        Request::LastFault => "its last fault".to_owned(),
        Request::Health => "its use of stack and processor".to_owned(),
        Request::Reboot => "to restart".to_owned(),
        Request::Fail { failure: Failure::Panic } => "to panic".to_owned(),
        Request::Fail { failure: Failure::Hang } => "to hang".to_owned(),
        Request::Fail { failure: Failure::BadAccess } => "to read where no memory is".to_owned(),
        Request::Fail { failure: Failure::StackOverflow } => "to overflow its stack".to_owned(),
        Request::RawFrame { .. } => "to exchange a frame with its front-end".to_owned(),
        Request::SetForceMatrix { .. } => "to keep a matrix of forces".to_owned(),
        Request::SetForceTare { .. } => "to take a tare for its forces".to_owned(),
        Request::StreamForces { on: true } => "to send forces".to_owned(),
        Request::StreamForces { on: false } => "to send no forces".to_owned(),
        Request::ForceMatrix => "for the matrix of its forces".to_owned(),
        Request::EnterLoader => "to restart into its loader".to_owned(),
        Request::StoreForceMatrix { keep: true } => "to store the matrix of its forces".to_owned(),
        Request::StoreForceMatrix { keep: false } => "to store no matrix of its forces".to_owned(),
    }
}
