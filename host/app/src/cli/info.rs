//! `palpate info`.

use std::process::ExitCode;
use std::time::Duration;

use palpate_device::raw_frame::{self, Received};
use palpate_device::{LinkError, Session};
use palpate_shared::wire::{
    BLOCK_SAMPLES, Checks, ClockSource, Counters, Fault, FaultCause, FirmwareVersion, ForceMatrix, FrontEndKind,
    Health, Hello, RAW_FRAME_BYTES, RestartReason, SelfTest, Source,
};

use super::device::DeviceArguments;
use crate::advice::Advise as _;

/// Says who a device is, how it is set, what it counted, and whether its front-end is well.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Switch to this source first
    #[arg(long, value_enum)]
    source: Option<SourceName>,

    /// Also read this register of the front-end (repeatable; decimal or 0x hexadecimal)
    #[arg(long = "register", value_name = "ADDRESS", value_parser = parse_address)]
    registers: Vec<u8>,

    /// Last of all, exchange this frame with the front-end (repeatable; 4 hexadecimal digits of a command word, 8 with
    /// its value, or all 24 digits)
    #[arg(long = "raw-frame", value_name = "HEX", value_parser = raw_frame::parse)]
    raw_frames: Vec<[u8; RAW_FRAME_BYTES]>,

    /// Have the device keep no matrix for forces of its own any more
    #[arg(long)]
    forget_matrix: bool,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    device: DeviceArguments,
}

/// Round trips of which the shortest counts.
const PINGS: u32 = 5;

#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum SourceName {
    /// The front-end on the board
    Hardware,
    /// The simulated finger built into the firmware
    Simulated,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let mut session = arguments.device.open(false)?;
    if let Some(source) = arguments.source {
        session
            .set_source(match source {
                SourceName::Hardware => Source::Hardware,
                SourceName::Simulated => Source::Simulated,
            })
            .advised()?;
    }
    if arguments.forget_matrix {
        session.store_device_matrix(false).advised()?;
        note!("the device keeps no matrix; until it restarts it goes by the one it has");
    }
    let about = About::of(&mut session, &arguments.registers, &arguments.raw_frames).advised()?;
    if arguments.json {
        say!("{}", about.as_json(&session));
    } else {
        about.print(&session);
    }
    Ok(ExitCode::SUCCESS)
}

/// What a device answered.
struct About {
    /// Shortest of a few round trips.
    round_trip: Duration,
    /// The self-test, or why there is none.
    self_test: Result<SelfTest, LinkError>,
    counters: Counters,
    /// The last fault and the use of the board, from devices that know them: simulated ones and older firmware do not.
    board: Option<(Option<Fault>, Health)>,
    /// What the device computes forces by, from firmware that can.
    matrix: Option<ForceMatrix>,
    registers: Vec<(u8, Result<u16, LinkError>)>,
    raw_frames: Vec<RawExchange>,
}

/// A frame that went out, and the one that came in.
struct RawExchange {
    sent: [u8; RAW_FRAME_BYTES],
    received: [u8; RAW_FRAME_BYTES],
}

impl About {
    fn of(session: &mut Session, registers: &[u8], raw_frames: &[[u8; RAW_FRAME_BYTES]]) -> Result<Self, LinkError> {
        let round_trips = (0..PINGS).map(|_| session.ping()).collect::<Result<Vec<_>, _>>()?;
        let self_test = session.self_test();
        let counters = session.device_counters()?;
        let board = session.last_fault().ok().zip(session.health().ok());
        let matrix = session.device_matrix().ok().flatten();
        let registers = registers.iter().map(|&address| (address, session.read_register(address))).collect();
        let round_trip = round_trips.into_iter().min().unwrap_or_default();
        let exchange = |&sent| session.raw_frame(sent).map(|received| RawExchange { sent, received });
        let raw_frames = raw_frames.iter().map(exchange).collect::<Result<_, _>>()?;
        Ok(Self { round_trip, self_test, counters, board, matrix, registers, raw_frames })
    }

    fn print(&self, session: &Session) {
        print_hello(session);
        row("round trip", &format!("{:.1} ms", self.round_trip.as_secs_f64() * 1e3));
        match &self.self_test {
            Ok(result) => print_self_test(result),
            Err(error) => row("self-test", &error.to_string()),
        }
        print_counters(&self.counters, session.hello().firmware);
        if let Some((fault, health)) = &self.board {
            row("last fault", &fault.as_ref().map_or_else(|| "none since power-on".to_owned(), fault_in_words));
            row("stack", &format!("{} of {} bytes at most", health.stack_used_max, health.stack_bytes));
        }
        if let Some(matrix) = &self.matrix {
            let [[xx, xy], [yx, yy]] = matrix.un_per_count();
            row("forces", &format!("by a matrix of its own: {xx:.3} {xy:.3}, {yx:.3} {yy:.3} µN a count"));
        }
        for (address, value) in &self.registers {
            let value = value.as_ref().map_or_else(ToString::to_string, |value| format!("{value:#06x}"));
            row(&format!("register {address:#04x}"), &value);
        }
        for RawExchange { sent, received } in &self.raw_frames {
            let kind = session.hello().front_end.kind;
            let Received { response, counts: [first, second], is_sound } = Received::of(kind, *received);
            let checksum = match is_sound {
                Some(true) => "right",
                Some(false) => "WRONG",
                None => "not among these words",
            };
            row("frame out", &hex(*sent));
            row("frame in", &hex(*received));
            row("", &format!("response {response:#06x}, codes {first} and {second}, checksum {checksum}"));
        }
    }

    /// The fields of `docs/PROTOCOL.md` by their names, with what was measured beside them.
    fn as_json(&self, session: &Session) -> serde_json::Value {
        let self_test = match &self.self_test {
            Ok(result) => serde_json::json!(result),
            Err(error) => serde_json::json!({ "error": error.to_string() }),
        };
        serde_json::json!({
            "address": session.address().to_string(),
            "device": session.hello().device.to_string(),
            "simulated": session.is_simulated(),
            "hello": session.hello(),
            "excitation_v": session.excitation_v(),
            "temperature_c": session.temperature_c(),
            "round_trip_s": self.round_trip.as_secs_f64(),
            "self_test": self_test,
            "counters": self.counters,
            "last_fault": self.board.as_ref().and_then(|(fault, _)| fault.as_ref()),
            "health": self.board.as_ref().map(|(_, health)| health),
            "force_matrix": self.matrix,
            "registers": self.registers.iter().map(register_as_json).collect::<Vec<_>>(),
            "raw_frames": self.raw_frames.iter().map(|frame| raw_frame_as_json(session.hello().front_end.kind, frame)).collect::<Vec<_>>(),
        })
    }
}

fn register_as_json((address, value): &(u8, Result<u16, LinkError>)) -> serde_json::Value {
    match value {
        Ok(value) => serde_json::json!({ "address": address, "value": value }),
        Err(error) => serde_json::json!({ "address": address, "error": error.to_string() }),
    }
}

fn raw_frame_as_json(kind: FrontEndKind, RawExchange { sent, received }: &RawExchange) -> serde_json::Value {
    let Received { response, counts, is_sound } = Received::of(kind, *received);
    serde_json::json!({
        "out": hex(*sent), "in": hex(*received), "response": response, "counts": counts, "checksum_fits": is_sound,
    })
}

/// A frame's four words of three bytes.
fn hex(frame: [u8; RAW_FRAME_BYTES]) -> String {
    let word = |word: &[u8]| word.iter().map(|byte| format!("{byte:02x}")).collect::<String>();
    frame.chunks(3).map(word).collect::<Vec<_>>().join(" ")
}

fn row(name: &str, value: &str) {
    say!("{name:<14} {value}");
}

fn print_hello(session: &Session) {
    let hello = session.hello();
    row("device", &format!("{} on {} at {}", hello.device, hello.board, session.address()));
    row("firmware", &format!("{}, protocol {}", hello.firmware, hello.protocol));
    row("front-end", &front_end(hello));
    row(
        "source",
        match hello.source {
            Source::Hardware => "hardware",
            Source::Simulated => "SIMULATED: nothing that it sends was measured",
        },
    );
    row("sampling", &format!("{} Hz, gain {}, excitation {} mV", hello.rate_hz, hello.gain, hello.excitation_mv));
    if let Some(volts) = session.excitation_v() {
        let celsius =
            session.temperature_c().map_or_else(String::new, |celsius| format!(", finger at {celsius:.2} °C"));
        row("measured", &format!("excitation {:.2} mV{celsius}", 1e3 * volts));
    }
    row("clock", &clock(hello));
    row("last start", &format!("{}, {} restarts since power-on", restart(hello.restart), hello.restarts));
}

fn front_end(hello: &Hello) -> String {
    let name = hello.front_end.kind.facts().name;
    match hello.front_end.id_word {
        0 => format!("{name}: none answers"),
        word => format!("{name}, ID {word:#06x}"),
    }
}

fn clock(hello: &Hello) -> String {
    let source = match hello.clock {
        ClockSource::Crystal => "crystal",
        ClockSource::InternalPll => "internal oscillator through PLL: up to 1 % off",
        ClockSource::Internal => "bare internal oscillator: up to 1 % off",
        ClockSource::Host => "the simulating computer's",
    };
    if hello.link_baud == 0 { source.to_owned() } else { format!("{source}; line at {} baud", hello.link_baud) }
}

fn restart(reason: RestartReason) -> &'static str {
    match reason {
        RestartReason::PowerOn => "power on",
        RestartReason::Pin => "reset pin",
        RestartReason::BrownOut => "supply dipped",
        RestartReason::Watchdog => "watchdog ended a hang",
        RestartReason::Panic => "firmware bug, recorded",
        RestartReason::Requested => "requested",
        RestartReason::Unknown => "reason unknown",
    }
}

fn fault_in_words(fault: &Fault) -> String {
    let what = match fault.cause {
        FaultCause::Panic => format!("panic at {}", fault.place),
        FaultCause::Processor => format!(
            "processor fault {:#010x} at {:#010x}, called from {:#010x}",
            fault.fault_status, fault.program_counter, fault.return_address
        ),
        FaultCause::StackOverflow => "stack overflow".to_owned(),
        FaultCause::Hang => "hang".to_owned(),
    };
    format!("{what}, {} s and {} samples after the start", fault.uptime_s, fault.samples)
}

fn print_self_test(result: &SelfTest) {
    for (check, words) in Checks::ALL {
        let verdict = match (result.checked.contains(check), result.failed.contains(check)) {
            (false, _) => "not checked",
            (true, false) => "ok",
            (true, true) => "FAILED",
        };
        row("self-test", &format!("{words}: {verdict}"));
    }
}

/// Samples that firmware of this version may have lost beyond what its counters say: before 0.2 it left out those in
/// the blocks that found no room on the link.
fn uncounted_at_most(counters: &Counters, firmware: FirmwareVersion) -> u64 {
    let leaves_out = (firmware.major, firmware.minor) < (0, 2);
    if leaves_out { u64::from(counters.blocks_dropped) * BLOCK_SAMPLES as u64 } else { 0 }
}

fn print_counters(counters: &Counters, firmware: FirmwareVersion) {
    let lost: u64 =
        [counters.samples_missed, counters.samples_damaged, counters.samples_dropped].map(u64::from).iter().sum();
    let uncounted = match uncounted_at_most(counters, firmware) {
        0 => String::new(),
        most => format!("; up to {most} more in blocks without room, which this firmware does not count"),
    };
    row(
        "samples",
        &format!(
            "{} in {} s; lost {lost}: {} not read in time, {} damaged on the bus, {} without room{uncounted}",
            counters.samples,
            counters.uptime_s,
            counters.samples_missed,
            counters.samples_damaged,
            counters.samples_dropped,
        ),
    );
    row(
        "link",
        &format!(
            "{} blocks sent, {} without room; {} commands, {} repeated, {} refused; {} damaged frames",
            counters.blocks_sent,
            counters.blocks_dropped,
            counters.commands,
            counters.commands_repeated,
            counters.commands_refused,
            counters.frames_damaged,
        ),
    );
}

fn parse_address(text: &str) -> Result<u8, String> {
    let parsed = match text.strip_prefix("0x") {
        Some(digits) => u8::from_str_radix(digits, 16),
        None => text.parse(),
    };
    parsed.map_err(|_| format!("`{text}` is not a register address: give 0 to 255 or 0x00 to 0xff"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_older_firmware_does_not_count_is_bounded() {
        let counters = Counters { blocks_dropped: 2617, ..Counters::default() };
        let firmware = |minor| FirmwareVersion { major: 0, minor, patch: 9 };
        assert_eq!([1, 2, 3].map(|minor| uncounted_at_most(&counters, firmware(minor))), [20_936, 0, 0]);
    }
}
