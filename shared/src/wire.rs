//! Messages between device and host: raw integers only.
//!
//! Each message is the payload of one frame ([`crate::frame`]), encoded by postcard: a variant's number
//! and every integer wider than a byte as a varint (signed ones zigzag first), bytes and booleans as they
//! are. `docs/PROTOCOL.md` describes the same bytes for clients in other languages; the golden tests below
//! pin them.
//!
//! Versions: a peer whose *major* version differs is refused, whichever side notices first. Two layouts
//! therefore hold for every major version: a hello message begins with bytes `0, major, minor`, and every
//! command begins with byte `major`, then its id. A *minor* version may append variants, also to the enums
//! within a message, and append fields at a message's end. Receivers ignore trailing bytes; a message with a
//! variant that they do not know is counted, and told as far as it can be read: [`NewerMessage`].
//!
//! `decode` reads them, as far as an older version can.
//!
//! Numbers: [`Seq`] and [`DeviceTime`] wrap; the host unwraps them.

use core::fmt;

use heapless::{String, Vec};
use serde::de::IntoDeserializer;
use serde::{Deserialize, Deserializer, Serialize};

pub use self::decode::{CommandRead, DecodeError, NewerMessage};
pub use crate::force::ForceMatrix;
pub use crate::front_ends::FrontEndKind;
pub use crate::status::Status;

use crate::frame;
use crate::status::bit_set;
use crate::units::{Counts, DeviceTime, Seq};

mod decode;

/// The version that this code speaks.
pub const PROTOCOL: ProtocolVersion = ProtocolVersion { major: 1, minor: 7 };

/// Bytes of a frame on the front-end's bus, as [`Request::RawFrame`] has it. Of a front-end with longer frames these are
/// the first; zeros follow them, and what comes in beyond them is left out.
pub const RAW_FRAME_BYTES: usize = 12;

/// Samples in a full block: 2 ms at 4 kHz, and 65 bytes on the line for a typical load.
pub const BLOCK_SAMPLES: usize = 8;

/// Version of the protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ProtocolVersion {
    /// Differs: the two sides do not understand each other.
    pub major: u8,
    /// Differs: the newer side knows messages that the older one skips.
    pub minor: u8,
}

impl fmt::Display for ProtocolVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.major, self.minor)
    }
}

/// What a device sends.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FromDevice {
    /// Sent once at start-up, unasked: the device has (re)started and forgot every setting.
    Hello(Hello),
    /// Samples in a row.
    Block(Block),
    /// Something happened that no command asked for.
    Event(Event),
    /// The answer to a command.
    Reply(Reply),
    /// The board's temperature, about once a second where the board has a sensor.
    Temperature(Temperature),
    /// Slow channels of a front-end that has such, a mean of [`SLOW_CONVERSIONS`]. Since version 1.3.
    SlowChannels(SlowChannels),
    /// Digital inputs that changed while streaming, and what they were at its start. Since version 1.4.
    Inputs(Inputs),
    /// The mean force over a block that was sent just before, where a host asked for forces. Since version 1.5.
    Force(MeanForce),
}

/// Who the device is and how it is set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Hello {
    /// Always the first field, in every version.
    pub protocol: ProtocolVersion,
    /// Version of the firmware.
    pub firmware: FirmwareVersion,
    /// Unique to the device.
    pub device: DeviceId,
    /// Name of the board, as its firmware has it; what would not print there reads as `?`.
    #[serde(deserialize_with = "printable")]
    pub board: String<24>,
    /// The analogue front-end and its ID word (0 if nothing answers).
    pub front_end: FrontEnd,
    /// What each of a sample's two counts measures.
    pub channels: [Channel; 2],
    /// Samples a second, each of both channels.
    pub rate_hz: u32,
    /// Gain of the front-end's amplifiers.
    pub gain: u8,
    /// Input voltage of the largest code at gain 1, in µV.
    pub full_scale_uv: u32,
    /// Bridge excitation, in mV.
    pub excitation_mv: u16,
    /// Where the samples come from.
    pub source: Source,
    /// What the processor's clock runs on.
    pub clock: ClockSource,
    /// Speed of the serial line in baud; 0 where the link has none.
    pub link_baud: u32,
    /// Why the device last started; [`RestartReason::Unknown`] for a reason that only a newer version names.
    #[serde(deserialize_with = "known_reason")]
    pub restart: RestartReason,
    /// Starts since power-on, this one not counted; saturates.
    pub restarts: u16,
    /// Whether samples are being streamed.
    pub streaming: bool,
}

/// Version of a firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FirmwareVersion {
    /// Semantic version, first part.
    pub major: u8,
    /// Semantic version, second part.
    pub minor: u8,
    /// Semantic version, third part.
    pub patch: u8,
}

impl fmt::Display for FirmwareVersion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}.{}", self.major, self.minor, self.patch)
    }
}

/// A device's unique number: 96 bits, as the microcontroller's maker assigns them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct DeviceId(pub [u8; 12]);

impl fmt::Display for DeviceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

/// The analogue front-end: the chip that converts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FrontEnd {
    /// Which chip the firmware drives.
    pub kind: FrontEndKind,
    /// What its ID register said at start-up; 0 if it did not answer.
    pub id_word: u16,
}

/// What one of the two counts of a sample measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// The finger's axis along which the gauges bend.
    pub axis: Axis,
    /// How the gauges are wired.
    pub bridge: Bridge,
}

/// An axis of the finger's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Axis {
    /// First axis of the disk.
    X,
    /// Second axis of the disk, a quarter turn counter-clockwise from X.
    Y,
}

/// How a Wheatstone bridge is made up.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Bridge {
    /// Two active gauges on opposite sides of the beam, two fixed resistors.
    Half,
    /// Four active gauges, two on each side of the beam.
    Full,
}

/// Where the samples come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Source {
    /// The front-end on the board.
    Hardware,
    /// The simulated finger built into the firmware; [`Status::SIMULATED`] is set in every block.
    Simulated,
}

/// What the processor's clock runs on.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ClockSource {
    /// The board's crystal oscillator.
    Crystal,
    /// The internal oscillator through the PLL: up to 1 % off.
    InternalPll,
    /// The bare internal oscillator.
    Internal,
    /// The clock of the computer that the device is simulated on.
    Host,
}

/// Why a device started.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum RestartReason {
    /// The power came up.
    PowerOn,
    /// The reset pin was pulled.
    Pin,
    /// The supply dipped below what the processor needs.
    BrownOut,
    /// The firmware hung and the watchdog ended it.
    Watchdog,
    /// The firmware met a bug, recorded it and restarted.
    Panic,
    /// It was asked to.
    Requested,
    /// The processor did not say.
    Unknown,
}

/// Reads a [`RestartReason`], a newer version's as [`RestartReason::Unknown`].
///
/// A device that restarts for a new reason can be given its settings back all the same; all else that is new in a
/// hello may alter what the samples mean.
fn known_reason<'de, D: Deserializer<'de>>(deserializer: D) -> Result<RestartReason, D::Error> {
    let number = u32::deserialize(deserializer)?;
    let known = RestartReason::deserialize(IntoDeserializer::<D::Error>::into_deserializer(number));
    Ok(known.unwrap_or(RestartReason::Unknown))
}

/// Reads a text, with `?` for what would steer a terminal instead of printing: control characters, and those that
/// reverse, join or hide others.
///
/// Whoever shows a name need not know that it came over a wire.
fn printable<'de, D: Deserializer<'de>, const N: usize>(deserializer: D) -> Result<String<N>, D::Error> {
    let text = String::<N>::deserialize(deserializer)?;
    let mut shown = String::new();
    for character in text.chars() {
        let steers = character.is_control()
            || matches!(character, '\u{ad}' | '\u{200b}'..='\u{200f}' | '\u{2028}'..='\u{202e}')
            || matches!(character, '\u{2060}'..='\u{206f}' | '\u{feff}');
        // A question mark takes no more room than what it stands for.
        let _ = shown.push(if steers { '?' } else { character });
    }
    Ok(shown)
}

/// Consecutive samples of both channels.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Block {
    /// Number of the first sample, given by the sampler; the others follow without a gap.
    pub first: Seq,
    /// When the first sample's data became ready.
    pub time: DeviceTime,
    /// What the reader of these samples has to know about them.
    pub status: Status,
    /// Counts of channels 0 and 1, sample by sample.
    pub samples: Vec<[Counts; 2], BLOCK_SAMPLES>,
}

bit_set!(Checks);

/// Something that the device noticed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Event {
    /// When the device noticed.
    pub time: DeviceTime,
    /// What was noticed, with its numbers.
    pub kind: EventKind,
}

/// What a device tells of its own accord.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum EventKind {
    /// Fault: no front-end answers; the ID register read as this.
    FrontEndMissing {
        /// The word read where the chip's ID should be.
        id_word: u16,
    },
    /// Fault: the front-end has announced no data for this long, in µs.
    FrontEndSilent {
        /// Time since the last data, in µs.
        quiet_us: u32,
    },
    /// The front-end announces data again.
    FrontEndRecovered,
    /// Fault: the front-end lost its settings (a dip of its supply); they were written again.
    FrontEndReset,
    /// Samples were lost inside the device since the last such event.
    SamplesLost {
        /// Data ready, but not read in time.
        missed: u32,
        /// Read, but damaged on the front-end's bus.
        damaged: u32,
        /// Read, but no room to keep or to send them.
        dropped: u32,
    },
}

/// A reading of the device's temperature.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Temperature {
    /// When it was read.
    pub time: DeviceTime,
    /// Hundredths of a degree Celsius.
    pub centi_celsius: i16,
}

/// Conversions that a [`SlowChannels`] message is the mean of.
pub const SLOW_CONVERSIONS: u16 = 256;

/// What the slow channels of a front-end gave on average; [`crate::front_ends::SlowCircuit`] says what they are wired to.
///
/// Sent whether or not samples are streamed. Conversions that are not settled are left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SlowChannels {
    /// When the last of the conversions became ready.
    pub time: DeviceTime,
    /// What holds for them: [`Status::SIMULATED`] or nothing.
    pub status: Status,
    /// Mean code of the channel that sees the bridges' excitation, rounded to zero.
    pub excitation: Counts,
    /// Mean code of the channel that sees the NTC.
    pub ntc: Counts,
}

/// The mean force over a block's samples, as the device computes it from its matrix ([`ForceMatrix::force_un`]).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeanForce {
    /// Number of the block's first sample.
    pub first: Seq,
    /// When the block's first sample became ready.
    pub time: DeviceTime,
    /// How many samples it is the mean of.
    pub samples: u8,
    /// What holds for the samples; of saturated or unsettled ones the force says nothing.
    pub status: Status,
    /// Force on x and y of the finger, in µN.
    pub force_un: [i32; 2],
}

/// Levels of the board's eight digital inputs, read with each sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Inputs {
    /// When the sample became ready with which they were first read so. The last change happened since the sample before.
    pub time: DeviceTime,
    /// A bit for each input, 1 for high.
    pub levels: u8,
    /// Changes since the message before, at least one of each input that changed: more than 1 where several came at once, or
    /// faster than they are told. 0 at the start of the stream.
    pub changes: u16,
}

/// The number by which a host knows a command's reply.
///
/// Hosts draw their first one at random and count up, so that a device never takes a new host's
/// command for a repetition of an old one's.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(transparent)]
pub struct CommandId(pub u32);

/// What a host sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Command {
    /// Major protocol version of the host; the first byte in every version.
    pub protocol_major: u8,
    /// Repeated with the same id, a command is answered again but not acted on again.
    pub id: CommandId,
    /// What the device shall do, with its arguments.
    pub request: Request,
}

impl Command {
    /// `request` in this version of the protocol.
    #[must_use]
    pub fn new(id: CommandId, request: Request) -> Self {
        Self { protocol_major: PROTOCOL.major, id, request }
    }
}

/// What a host can ask for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Request {
    /// Who are you, and how are you set?
    Hello,
    /// Stream samples. Streaming already is no error.
    Start,
    /// Stop streaming; what is queued still comes before the reply.
    Stop,
    /// Take this many samples a second.
    SetRate {
        /// Samples a second of each channel.
        rate_hz: u32,
    },
    /// Amplify by this much.
    SetGain {
        /// 1, 2, 4 … 128.
        gain: u8,
    },
    /// Take samples from here.
    SetSource {
        /// The front-end on the board or the simulated finger.
        source: Source,
    },
    /// Read a register of the front-end; streaming goes on.
    ReadRegister {
        /// Address of the register.
        address: u8,
    },
    /// Answer with the device's time.
    Ping,
    /// Check the front-end without disturbing it.
    SelfTest,
    /// What was counted since start-up.
    Counters,
    /// What the firmware recorded of its last fault. Since version 1.1, as are the next three.
    LastFault,
    /// How much stack and processor time the firmware uses.
    Health,
    /// Answer, then restart; every setting is forgotten.
    Reboot,
    /// Answer, then fail, so that it can be seen whether the firmware recovers.
    Fail {
        /// In which way to fail.
        failure: Failure,
    },
    /// Exchange one frame with the front-end, byte for byte. Since version 1.2.
    ///
    /// Not while streaming. From the first one on the firmware leaves the front-end alone, so that the next one brings
    /// the answer to it; a second after the last one, or at the next command that needs the front-end, it initialises it
    /// anew.
    RawFrame {
        /// What goes out.
        bytes: [u8; RAW_FRAME_BYTES],
    },
    /// Keep this matrix until the next start. Not while streaming. Since version 1.5, as are the next three.
    SetForceMatrix {
        /// The matrix, its tare included.
        matrix: ForceMatrix,
        /// [`ForceMatrix::checksum`] of it, as the host has it.
        checksum: u32,
    },
    /// Take what both bridges read at rest to be this, also while streaming.
    SetForceTare {
        /// In sixteenths of a count.
        tare: [i32; 2],
    },
    /// Send the mean force with each block, or do not.
    StreamForces {
        /// Whether to.
        on: bool,
    },
    /// Which matrix do you keep?
    ForceMatrix,
    /// Answer, then restart into the loader that the chip was made with, for another image over USB. Since version 1.6.
    EnterLoader,
    /// Keep the matrix over restarts, or no longer: write it into the board's flash, or that there is none. Not while
    /// streaming. Since version 1.7.
    StoreForceMatrix {
        /// Whether there is to be one.
        keep: bool,
    },
}

/// A way to fail on purpose.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// A panic, as after a bug that the firmware notices.
    Panic,
    /// A main loop that stands still.
    Hang,
    /// A read where there is no memory.
    BadAccess,
    /// Calls without end, until the stack is full.
    StackOverflow,
}

/// The one answer to a command.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Reply {
    /// Id of the command that is answered.
    pub id: CommandId,
    /// What came of it.
    pub outcome: Outcome,
}

/// What came of a command.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Outcome {
    /// Done; there is nothing more to say.
    Done,
    /// What [`Request::Hello`] asks for.
    Hello(Hello),
    /// What [`Request::ReadRegister`] asks for.
    Register {
        /// Address of the register.
        address: u8,
        /// Its raw 16 bits.
        value: u16,
    },
    /// What [`Request::Ping`] asks for.
    Pong {
        /// The device's time when it took up the command.
        time: DeviceTime,
    },
    /// What [`Request::SelfTest`] asks for.
    SelfTest(SelfTest),
    /// What [`Request::Counters`] asks for.
    Counters(Counters),
    /// Not done, and why.
    Refused(Refusal),
    /// Answer to [`Request::LastFault`]; `None` if there was none since power-on.
    LastFault(Option<Fault>),
    /// What [`Request::Health`] asks for.
    Health(Health),
    /// What came in with [`Request::RawFrame`]. Since version 1.2.
    RawFrame {
        /// As they came, unchecked.
        bytes: [u8; RAW_FRAME_BYTES],
    },
    /// What [`Request::ForceMatrix`] asks for; `None` if there is none. Since version 1.5.
    ForceMatrix(Option<ForceMatrix>),
    /// [`Request::StoreForceMatrix`] is done. Since version 1.7.
    Stored {
        /// How long the whole device stood still meanwhile, in µs, as a chip does that erases its flash. No samples were due.
        stalled_us: u32,
    },
}

/// Why a device did not do what it was asked to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Refusal {
    /// The host speaks another major version than this device.
    OtherProtocol {
        /// What the device speaks.
        device: ProtocolVersion,
    },
    /// A newer host's request that this firmware does not know.
    UnknownRequest,
    /// The front-end has no such rate.
    RateNotPossible {
        /// The slowest rate, in Hz.
        slowest_hz: u32,
        /// The fastest rate, in Hz; others are this halved once or more.
        fastest_hz: u32,
    },
    /// The serial line cannot carry that many samples.
    LinkTooSlow {
        /// The fastest rate that it carries, in Hz.
        fastest_hz: u32,
    },
    /// The front-end has no such gain.
    GainNotPossible {
        /// The largest gain; others are this halved once or more.
        largest: u8,
    },
    /// This board has no such source.
    SourceNotPossible,
    /// There is no front-end to ask; see [`EventKind::FrontEndMissing`].
    NoFrontEnd,
    /// The front-end does not answer.
    FrontEndSilent,
    /// The front-end has no such register.
    AddressNotPossible {
        /// The last address that there is.
        last: u8,
    },
    /// The front-end is still busy with an earlier command; repeat.
    Busy,
    /// This board cannot do that.
    NotOnThisBoard,
    /// Not while samples are streamed. Since version 1.2.
    Streaming,
    /// The checksum is not the matrix's, or a number of it is larger than the arithmetic bears. Since version 1.5.
    MatrixDamaged,
    /// There is no matrix, and none is kept over a start. Since version 1.5.
    NoForceMatrix,
    /// The flash did not take the matrix; what it keeps is as before. Since version 1.7.
    NotStored,
}

/// What the self-test found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct SelfTest {
    /// Which checks were made.
    pub checked: Checks,
    /// What of it failed.
    pub failed: Checks,
    /// The front-end's ID register.
    pub id_word: u16,
    /// The front-end's status register.
    pub status_word: u16,
    /// Measured time between samples, in ns.
    pub period_ns: u32,
}

/// Checks of the self-test, as bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Checks(pub u16);

impl Checks {
    /// The ID register names the chip that the firmware drives.
    pub const ID: Self = Self(1);
    /// The settings read back as they were written.
    pub const SETTINGS: Self = Self(1 << 1);
    /// No frame from the front-end was damaged lately.
    pub const BUS: Self = Self(1 << 2);
    /// Data come at the rate that was set, within 5 %.
    pub const RATE: Self = Self(1 << 3);
    /// No channel is at the end of its range.
    pub const RANGE: Self = Self(1 << 4);
    /// All of them, with the words a person reads.
    pub const ALL: [(Self, &'static str); 5] = [
        (Self::ID, "chip identity"),
        (Self::SETTINGS, "settings read back"),
        (Self::BUS, "bus free of errors"),
        (Self::RATE, "sample rate"),
        (Self::RANGE, "inputs within range"),
    ];
}

/// What the device has counted since it started; every counter wraps.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Counters {
    /// Time since start-up, s.
    pub uptime_s: u32,
    /// Conversions while streaming, numbered by the sampler whether or not they could be delivered.
    pub samples: u32,
    /// Of these: data ready, but not read in time.
    pub samples_missed: u32,
    /// Of these: damaged on the front-end's bus.
    pub samples_damaged: u32,
    /// Of these: no room to keep or to send them; those in the blocks that found no room on the link too (firmware
    /// before 0.2 left these out).
    pub samples_dropped: u32,
    /// Blocks handed to the link.
    pub blocks_sent: u32,
    /// Blocks with no room on the link.
    pub blocks_dropped: u32,
    /// Events and replies with no room on the link.
    pub notices_dropped: u32,
    /// Good commands received, repetitions included.
    pub commands: u32,
    /// Commands received again, answered again, not acted on again.
    pub commands_repeated: u32,
    /// Commands that were refused.
    pub commands_refused: u32,
    /// Frames from the host that were too long, miscoded, failed their checksum, or held not even a command's id.
    pub frames_damaged: u32,
}

/// What the firmware recorded before it restarted itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Fault {
    /// What kind it was.
    pub cause: FaultCause,
    /// Seconds from start-up to the fault.
    pub uptime_s: u32,
    /// Samples numbered from start-up to the fault.
    pub samples: u32,
    /// Where the processor was; 0 where that is not known.
    pub program_counter: u32,
    /// Where it would have returned to; 0 where that is not known.
    pub return_address: u32,
    /// The processor's fault status (CFSR of a Cortex-M); 0 where it reported none.
    pub fault_status: u32,
    /// For a panic, the end of the source file's path, and the line; as printable as a board's name.
    #[serde(deserialize_with = "printable")]
    pub place: String<40>,
}

/// A kind of fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FaultCause {
    /// The firmware noticed a bug.
    Panic,
    /// The processor met something impossible, such as a read where there is no memory.
    Processor,
    /// The stack had no more room.
    StackOverflow,
    /// The main loop stood still.
    Hang,
}

/// What the firmware uses of its board. The cycles are the processor's, counted since start-up, and wrap.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Health {
    /// Size of the stack, in bytes.
    pub stack_bytes: u32,
    /// The most of it that was ever in use, in bytes.
    pub stack_used_max: u32,
    /// Cycles of the processor in a second.
    pub core_hz: u32,
    /// Cycles in the sampler's interrupt, the simulated finger's included.
    pub sampler_cycles: u32,
    /// Of these: in the simulated finger.
    pub simulation_cycles: u32,
    /// Cycles in the main loop.
    pub main_cycles: u32,
    /// Runs of the sampler's interrupt.
    pub sampler_runs: u32,
}

/// A buffer that holds any frame with its delimiter.
pub type FrameBuffer = [u8; frame::FRAME_MAX + 1];

#[cfg(test)]
mod tests {
    use std::format;
    use std::string::{String as Text, ToString};
    use std::vec::Vec as List;

    use proptest::prelude::*;
    use serde::Serialize;

    use super::*;
    use crate::frame::{FRAME_MAX, FrameReader, encode};

    /// The bytes of a frame as hexadecimal digits.
    fn hex_frame(message: &impl Serialize) -> Text {
        let mut line = [0; FRAME_MAX + 1];
        encode(message, &mut line).unwrap().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    /// The bytes of a payload as hexadecimal digits.
    fn hex_payload(message: &impl Serialize) -> Text {
        let mut bytes = [0; FRAME_MAX];
        postcard::to_slice(message, &mut bytes).unwrap().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn bytes_of(hex: &str) -> List<u8> {
        (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
    }

    fn hello() -> Hello {
        Hello {
            protocol: PROTOCOL,
            firmware: FirmwareVersion { major: 0, minor: 1, patch: 2 },
            device: DeviceId(*b"palpate-0001"),
            board: String::try_from("STM32-H405").unwrap(),
            front_end: FrontEnd { kind: FrontEndKind::Ads131m02, id_word: 0x2283 },
            channels: [
                Channel { axis: Axis::X, bridge: Bridge::Half },
                Channel { axis: Axis::Y, bridge: Bridge::Half },
            ],
            rate_hz: 4000,
            gain: 32,
            full_scale_uv: 1_200_000,
            excitation_mv: 2500,
            source: Source::Hardware,
            clock: ClockSource::Crystal,
            link_baud: 921_600,
            restart: RestartReason::PowerOn,
            restarts: 0,
            streaming: false,
        }
    }

    fn block() -> Block {
        Block {
            first: Seq(300),
            time: DeviceTime(75_000),
            status: Status::SIMULATED.with(Status::GAP_BEFORE),
            samples: Vec::from_slice(&[[Counts(-1), Counts(63)], [Counts(53_379), Counts(-8_388_608)]]).unwrap(),
        }
    }

    fn counters() -> Counters {
        Counters {
            uptime_s: 1,
            samples: 2,
            samples_missed: 3,
            samples_damaged: 4,
            samples_dropped: 5,
            blocks_sent: 6,
            blocks_dropped: 7,
            notices_dropped: 8,
            commands: 9,
            commands_repeated: 10,
            commands_refused: 11,
            frames_damaged: 12,
        }
    }

    fn fault() -> Fault {
        Fault {
            cause: FaultCause::Panic,
            uptime_s: 60,
            samples: 4000,
            program_counter: 0,
            return_address: 0,
            fault_status: 0,
            place: String::try_from("main.rs:7").unwrap(),
        }
    }

    fn force_matrix() -> ForceMatrix {
        ForceMatrix { entries: [[1, -2], [3, 4]], tare: [-5, 6] }
    }

    /// Every message a device can send, with its payload worked out by hand from the rules in the header.
    fn from_device_golden() -> List<(FromDevice, &'static str)> {
        let event = |kind| FromDevice::Event(Event { time: DeviceTime(128), kind });
        let reply = |outcome| FromDevice::Reply(Reply { id: CommandId(7), outcome });
        let refused = |refusal| reply(Outcome::Refused(refusal));
        let hello_fields = concat!(
            "0107000102",
            "70616c706174652d30303031",
            "0a53544d33322d48343035",
            "008345",
            "00000100",
            "a01f",
            "20",
            "809f49",
            "c413",
            "00",
            "00",
            "80a038",
            "00",
            "00",
            "00",
        );
        assert_eq!(hex_payload(&hello()), hello_fields);
        std::vec![
            (
                FromDevice::Hello(hello()),
                "000107000102\
              70616c706174652d303030310a53544d33322d4834303500834500000100a01f20809f49c413000080a038000000"
            ),
            (FromDevice::Block(block()), "01ac02f8c904090201 7e86c206ffffff07"),
            (event(EventKind::FrontEndMissing { id_word: 0xFFFF }), "02800100ffff03"),
            (event(EventKind::FrontEndSilent { quiet_us: 1000 }), "02800101e807"),
            (event(EventKind::FrontEndRecovered), "02800102"),
            (event(EventKind::FrontEndReset), "02800103"),
            (event(EventKind::SamplesLost { missed: 1, damaged: 2, dropped: 3 }), "02800104010203"),
            (reply(Outcome::Done), "030700"),
            (reply(Outcome::Register { address: 0, value: 0x2283 }), "03070200 8345"),
            (reply(Outcome::Pong { time: DeviceTime(1) }), "03070301"),
            (
                reply(Outcome::SelfTest(SelfTest {
                    checked: Checks(31),
                    failed: Checks::RATE,
                    id_word: 0x2283,
                    status_word: 0x0503,
                    period_ns: 250_000,
                })),
                "0307041f0883458 30a90a10f",
            ),
            (reply(Outcome::Counters(counters())), "0307050102030405060708090a0b0c"),
            (refused(Refusal::OtherProtocol { device: PROTOCOL }), "030706000107"),
            (refused(Refusal::UnknownRequest), "03070601"),
            (refused(Refusal::RateNotPossible { slowest_hz: 500, fastest_hz: 8000 }), "03070602f403c03e"),
            (refused(Refusal::LinkTooSlow { fastest_hz: 1000 }), "03070603e807"),
            (refused(Refusal::GainNotPossible { largest: 128 }), "0307060480"),
            (refused(Refusal::SourceNotPossible), "03070605"),
            (refused(Refusal::NoFrontEnd), "03070606"),
            (refused(Refusal::FrontEndSilent), "03070607"),
            (refused(Refusal::AddressNotPossible { last: 63 }), "030706083f"),
            (refused(Refusal::Busy), "03070609"),
            (refused(Refusal::NotOnThisBoard), "0307060a"),
            (refused(Refusal::Streaming), "0307060b"),
            (refused(Refusal::MatrixDamaged), "0307060c"),
            (refused(Refusal::NoForceMatrix), "0307060d"),
            (reply(Outcome::ForceMatrix(None)), "03070a00"),
            (reply(Outcome::ForceMatrix(Some(force_matrix()))), "03070a01 02 03 06 08 09 0c"),
            (
                FromDevice::Force(MeanForce {
                    first: Seq(300),
                    time: DeviceTime(128),
                    samples: 8,
                    status: Status::SIMULATED,
                    force_un: [2_000_000, -1],
                }),
                "07ac02800108 01 8092f401 01",
            ),
            (reply(Outcome::LastFault(None)), "03070700"),
            (reply(Outcome::LastFault(Some(fault()))), "030707 01 00 3c a01f 00 00 00 09 6d61696e2e72733a37"),
            (
                reply(Outcome::Health(Health {
                    stack_bytes: 8192,
                    stack_used_max: 300,
                    core_hz: 168_000_000,
                    sampler_cycles: 1,
                    simulation_cycles: 2,
                    main_cycles: 3,
                    sampler_runs: 4,
                })),
                "030708 8040 ac02 80f48d50 01 02 03 04"
            ),
            (
                reply(Outcome::RawFrame { bytes: [5, 0, 0, 0, 0, 1, 255, 255, 254, 0x9F, 0xFC, 0] }),
                "030709 050000 000001 fffffe 9ffc00"
            ),
            (reply(Outcome::Stored { stalled_us: 300 }), "03070bac02"),
            (reply(Outcome::Refused(Refusal::NotStored)), "0307060e"),
            (FromDevice::Temperature(Temperature { time: DeviceTime(1), centi_celsius: -250 }), "0401f303"),
            (
                FromDevice::SlowChannels(SlowChannels {
                    time: DeviceTime(1),
                    status: Status::SIMULATED,
                    excitation: Counts(64),
                    ntc: Counts(-1),
                }),
                "0501018001 01",
            ),
            (FromDevice::Inputs(Inputs { time: DeviceTime(128), levels: 0x85, changes: 300 }), "06800185ac02"),
        ]
    }

    /// Every command, likewise.
    fn to_device_golden() -> List<(Request, &'static str)> {
        std::vec![
            (Request::Hello, "01ac0200"),
            (Request::Start, "01ac0201"),
            (Request::Stop, "01ac0202"),
            (Request::SetRate { rate_hz: 4000 }, "01ac0203a01f"),
            (Request::SetGain { gain: 32 }, "01ac020420"),
            (Request::SetSource { source: Source::Simulated }, "01ac020501"),
            (Request::ReadRegister { address: 0x3E }, "01ac02063e"),
            (Request::Ping, "01ac0207"),
            (Request::SelfTest, "01ac0208"),
            (Request::Counters, "01ac0209"),
            (Request::LastFault, "01ac020a"),
            (Request::Health, "01ac020b"),
            (Request::Reboot, "01ac020c"),
            (Request::Fail { failure: Failure::Panic }, "01ac020d00"),
            (Request::Fail { failure: Failure::Hang }, "01ac020d01"),
            (Request::Fail { failure: Failure::BadAccess }, "01ac020d02"),
            (Request::Fail { failure: Failure::StackOverflow }, "01ac020d03"),
            (
                Request::RawFrame { bytes: [0xA0, 0, 0, 0x71, 0, 0, 0, 0, 0, 0, 0, 0] },
                "01ac020ea00000710000000000000000",
            ),
            (
                Request::SetForceMatrix { matrix: force_matrix(), checksum: 0xA69B_0E0E },
                "01ac020f02030608090c8e9cecb40a",
            ),
            (Request::SetForceTare { tare: [-5, 6] }, "01ac0210090c"),
            (Request::StreamForces { on: true }, "01ac021101"),
            (Request::ForceMatrix, "01ac0212"),
            (Request::EnterLoader, "01ac0213"),
            (Request::StoreForceMatrix { keep: true }, "01ac021401"),
            (Request::StoreForceMatrix { keep: false }, "01ac021400"),
        ]
    }

    #[test]
    fn every_message_of_a_device_has_its_golden_bytes() {
        for (message, hex) in from_device_golden() {
            let hex = hex.replace(' ', "");
            assert_eq!(hex_payload(&message), hex, "{message:?}");
            assert_eq!(FromDevice::from_payload(&bytes_of(&hex)), Ok(message));
        }
    }

    #[test]
    fn every_command_has_its_golden_bytes() {
        for (request, hex) in to_device_golden() {
            let command = Command::new(CommandId(300), request);
            assert_eq!(hex_payload(&command), hex, "{request:?}");
            assert_eq!(Command::from_payload(&bytes_of(hex)), Ok(CommandRead::Command(command)));
        }
    }

    #[test]
    fn the_frame_of_a_ping_has_its_golden_bytes() {
        // Payload 01 05 07; CRC-32 of it, little-endian; COBS's first byte; delimiter.
        assert_eq!(hex_frame(&Command::new(CommandId(5), Request::Ping)), "08010507c3d2901d00");
    }

    #[test]
    fn a_device_of_another_major_version_is_named_even_if_its_hello_is_otherwise_unreadable() {
        let device = ProtocolVersion { major: 2, minor: 7 };
        assert_eq!(FromDevice::from_payload(&[0, 2, 7, 99]), Err(DecodeError::OtherProtocol { device }));
    }

    #[test]
    fn a_command_of_another_major_version_is_refused_by_its_id() {
        let refusal = Refusal::OtherProtocol { device: PROTOCOL };
        assert_eq!(Command::from_payload(&[9, 0xAC, 2, 200, 1]), Ok(CommandRead::Refuse(CommandId(300), refusal)));
        assert_eq!(Command::from_payload(&[1, 5, 100]), Ok(CommandRead::Refuse(CommandId(5), Refusal::UnknownRequest)));
        assert_eq!(Command::from_payload(&[1]), Err(DecodeError::Malformed));
    }

    /// The fields of a version 1.99 device's hello, with these numbers for: front-end, axis and bridge of both channels,
    /// source, clock, restart reason. Two bytes of a field that this version does not have follow.
    fn newer_hello([kind, axis_0, bridge_0, axis_1, bridge_1, source, clock, restart]: [u8; 8]) -> Text {
        format!(
            "0163000102 70616c706174652d30303031 0a53544d33322d48343035 {kind:02x}8345 \
             {axis_0:02x}{bridge_0:02x}{axis_1:02x}{bridge_1:02x} a01f 20 809f49 c413 \
             {source:02x} {clock:02x} 80a038 {restart:02x} 00 00 beef"
        )
    }

    /// Messages of a version 1.99 device that cannot be read here, each with one number beyond the last that is known,
    /// and what can be told of them.
    fn newer_golden() -> List<(&'static str, Text, NewerMessage)> {
        let device = ProtocolVersion { major: 1, minor: 99 };
        let event = NewerMessage::Event;
        let reply = NewerMessage::Reply { id: CommandId(300), device: None };
        let known = std::vec![
            ("message", "64 010203".to_string(), NewerMessage::Kind { variant: 100 }),
            ("message with a number of two bytes", "ac02 01".to_string(), NewerMessage::Kind { variant: 300 }),
            ("event", "02 8001 05".to_string(), event),
            ("event with fields", "02 8001 05 e807 01".to_string(), event),
            ("outcome", "03 ac02 64".to_string(), reply),
            ("outcome with fields", "03 ac02 64 01 02 03".to_string(), reply),
            ("outcome with a number of two bytes", "03 ac02 8001".to_string(), reply),
            ("refusal", "03 ac02 06 64".to_string(), reply),
            ("refusal with fields", "03 ac02 06 64 c03e 01".to_string(), reply),
            ("cause of a fault", "03 ac02 07 01 04 3c a01f 00 00 00 09 6d61696e2e72733a37".to_string(), reply),
        ];
        let words = [
            ("front-end", [2, 0, 0, 1, 0, 0, 0, 0]),
            ("axis of channel 0", [0, 2, 0, 1, 0, 0, 0, 0]),
            ("bridge of channel 0", [0, 0, 2, 1, 0, 0, 0, 0]),
            ("axis of channel 1", [0, 0, 0, 2, 0, 0, 0, 0]),
            ("bridge of channel 1", [0, 0, 0, 1, 2, 0, 0, 0]),
            ("source", [0, 0, 0, 1, 0, 2, 0, 0]),
            ("clock", [0, 0, 0, 1, 0, 0, 4, 0]),
        ];
        let reply = NewerMessage::Reply { id: CommandId(300), device: Some(device) };
        let hellos = words.into_iter().flat_map(|(what, numbers)| {
            let fields = newer_hello(numbers);
            [
                (what, format!("00 {fields}"), NewerMessage::Hello { device }),
                (what, format!("03 ac02 01 {fields}"), reply),
            ]
        });
        known.into_iter().chain(hellos).collect()
    }

    #[test]
    fn a_newer_minor_versions_variants_are_unknown_at_every_depth() {
        for (what, hex, newer) in newer_golden() {
            let payload = bytes_of(&hex.replace(' ', ""));
            assert_eq!(FromDevice::from_payload(&payload), Err(DecodeError::Unknown(newer)), "{what}: {hex}");
        }
    }

    #[test]
    fn fields_that_a_newer_minor_version_appends_are_ignored() {
        for (message, hex) in from_device_golden() {
            let longer = bytes_of(&(hex.replace(' ', "") + "05ff00"));
            assert_eq!(FromDevice::from_payload(&longer), Ok(message), "{hex}");
        }
        let newer = Hello { protocol: ProtocolVersion { major: 1, minor: 99 }, ..hello() };
        let payload = bytes_of(&format!("00{}", newer_hello([0, 0, 0, 1, 0, 0, 0, 0])).replace(' ', ""));
        assert_eq!(FromDevice::from_payload(&payload), Ok(FromDevice::Hello(newer)));
    }

    #[test]
    fn a_restart_for_a_newer_reason_is_a_restart_for_an_unknown_one() {
        let payload = bytes_of(&format!("00{}", newer_hello([0, 0, 0, 1, 0, 0, 0, 7])).replace(' ', ""));
        let Ok(FromDevice::Hello(hello)) = FromDevice::from_payload(&payload) else { panic!("the hello is readable") };
        assert_eq!(hello.restart, RestartReason::Unknown);
    }

    #[test]
    fn what_no_version_can_say_is_malformed() {
        for (what, hex) in [
            ("nothing", ""),
            ("a number without its end", "80"),
            ("a number of more than 32 bits", "ffffffff1f"),
            ("a hello without a version", "0001"),
            ("an event without its time", "0280"),
            ("a reply without its id", "03"),
            ("a reply without its outcome", "0307"),
            ("a pong without its time", "030703"),
            ("an optional record that is neither there nor not", "03070702"),
            ("a block of nine samples", "0100000009 0000 0000 0000 0000 0000 0000 0000 0000 0000"),
            ("a fault in a place of 41 bytes", &format!("03070701 00 00 00 00 00 00 29 {}", "61".repeat(41))),
            ("a fault in a place that is no text", "03070701 00 00 00 00 00 00 01 ff"),
            ("a board's name of 25 bytes", &format!("00 0101000102 {} 19 {}", "00".repeat(12), "61".repeat(25))),
        ] {
            let payload = bytes_of(&hex.replace(' ', ""));
            assert_eq!(FromDevice::from_payload(&payload), Err(DecodeError::Malformed), "{what}: {hex}");
        }
        for (message, hex) in from_device_golden() {
            let whole = bytes_of(&hex.replace(' ', ""));
            for length in 0..whole.len() {
                let cut = FromDevice::from_payload(&whole[..length]);
                assert_eq!(cut, Err(DecodeError::Malformed), "{message:?} cut to {length} bytes");
            }
        }
    }

    #[test]
    fn a_newer_hosts_command_is_refused_by_its_id() {
        for (what, hex) in [
            ("request", "01 ac02 64"),
            ("request with fields", "01 ac02 64 01 02"),
            ("source", "01 ac02 05 02"),
            ("way to fail", "01 ac02 0d 04"),
        ] {
            let refused = CommandRead::Refuse(CommandId(300), Refusal::UnknownRequest);
            assert_eq!(Command::from_payload(&bytes_of(&hex.replace(' ', ""))), Ok(refused), "{what}");
        }
        for (request, hex) in to_device_golden() {
            let command = Command::new(CommandId(300), request);
            let longer = format!("{hex}05ff00");
            assert_eq!(Command::from_payload(&bytes_of(&longer)), Ok(CommandRead::Command(command)), "{longer}");
        }
    }

    #[test]
    fn the_largest_messages_fit_a_payload() {
        let full = [Counts::MIN, Counts::MAX];
        let largest = Block {
            first: Seq(u32::MAX),
            time: DeviceTime(u32::MAX),
            status: Status(u16::MAX),
            samples: Vec::from_slice(&[full; BLOCK_SAMPLES]).unwrap(),
        };
        assert_eq!(hex_payload(&FromDevice::Block(largest)).len() / 2, 79);
        let mut named = hello();
        named.board = String::try_from("x".repeat(24).as_str()).unwrap();
        (named.rate_hz, named.full_scale_uv, named.link_baud) = (u32::MAX, u32::MAX, u32::MAX);
        (named.front_end.id_word, named.excitation_mv, named.restarts) = (u16::MAX, u16::MAX, u16::MAX);
        let reply = FromDevice::Reply(Reply { id: CommandId(u32::MAX), outcome: Outcome::Hello(named) });
        assert!(hex_payload(&reply).len() / 2 <= frame::PAYLOAD_MAX, "{}", hex_payload(&reply).len() / 2);
        let mut fault = fault();
        fault.place = String::try_from("x".repeat(40).as_str()).unwrap();
        (fault.uptime_s, fault.samples, fault.program_counter) = (u32::MAX, u32::MAX, u32::MAX);
        (fault.return_address, fault.fault_status) = (u32::MAX, u32::MAX);
        let reply = FromDevice::Reply(Reply { id: CommandId(u32::MAX), outcome: Outcome::LastFault(Some(fault)) });
        assert!(hex_payload(&reply).len() / 2 <= frame::PAYLOAD_MAX, "{}", hex_payload(&reply).len() / 2);
    }

    #[test]
    fn a_name_that_would_steer_a_terminal_is_read_as_text() {
        let mut named = hello();
        named.board = String::try_from("\u{1b}[2J\u{7}ok\u{202e}é\u{9b}31m").unwrap();
        let bytes = bytes_of(&hex_payload(&FromDevice::Hello(named)));
        let Ok(FromDevice::Hello(read)) = FromDevice::from_payload(&bytes) else { panic!("a hello") };
        assert_eq!(read.board.as_str(), "?[2J?ok?é?31m");
        let mut fault = fault();
        fault.place = String::try_from("\u{1b}]0;main.rs:7").unwrap();
        let reply = FromDevice::Reply(Reply { id: CommandId(7), outcome: Outcome::LastFault(Some(fault)) });
        let read = FromDevice::from_payload(&bytes_of(&hex_payload(&reply)));
        let Ok(FromDevice::Reply(Reply { outcome: Outcome::LastFault(Some(read)), .. })) = read else {
            panic!("a fault")
        };
        assert_eq!(read.place.as_str(), "?]0;main.rs:7");
    }

    #[test]
    fn names_print_as_a_person_reads_them() {
        assert_eq!(hello().device.to_string(), "70616c706174652d30303031");
        assert_eq!(format!("{} {}", hello().firmware, PROTOCOL), "0.1.2 1.7");
    }

    proptest! {
        #[test]
        fn a_block_comes_back_as_it_was_sent(
            first in any::<u32>(), time in any::<u32>(), status in any::<u16>(),
            samples in prop::collection::vec((-8_388_608..=8_388_607_i32, -8_388_608..=8_388_607_i32), 0..=BLOCK_SAMPLES),
        ) {
            let samples = samples.iter().map(|&(x, y)| [Counts(x), Counts(y)]).collect();
            let block =
                FromDevice::Block(Block { first: Seq(first), time: DeviceTime(time), status: Status(status), samples });
            let mut line = [0; FRAME_MAX + 1];
            let mut reader = FrameReader::new();
            let (_, payload) = reader.push(encode(&block, &mut line).unwrap());
            prop_assert_eq!(FromDevice::from_payload(payload.unwrap().unwrap()), Ok(block));
        }

        #[test]
        fn any_payload_is_a_message_or_an_error(payload in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = FromDevice::from_payload(&payload);
            let _ = Command::from_payload(&payload);
        }
    }
}
