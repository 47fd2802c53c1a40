//! `palpate info`.

use std::process::ExitCode;

use palpate::link::Session;
use palpate_shared::wire::{
    Checks, ClockSource, Counters, Fault, FaultCause, FrontEndKind, Hello, RestartReason, SelfTest, Source,
};

use super::device::DeviceArguments;

/// Says who a device is, how it is set, what it counted, and whether its front-end is well.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    device: DeviceArguments,

    /// Switch to this source first
    #[arg(long, value_enum)]
    source: Option<SourceName>,

    /// Also read this register of the front-end (repeatable; decimal or 0x hexadecimal)
    #[arg(long = "register", value_name = "ADDRESS", value_parser = parse_address)]
    registers: Vec<u8>,
}

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
        session.set_source(match source {
            SourceName::Hardware => Source::Hardware,
            SourceName::Simulated => Source::Simulated,
        })?;
    }
    print_hello(&session);
    let round_trip = (0..5).map(|_| session.ping()).collect::<Result<Vec<_>, _>>()?.into_iter().min();
    row("round trip", &format!("{:.1} ms", round_trip.unwrap_or_default().as_secs_f64() * 1e3));
    match session.self_test() {
        Ok(result) => print_self_test(&result),
        Err(error) => row("self-test", &error.to_string()),
    }
    print_counters(&session.device_counters()?);
    // Simulated devices and older firmware do not know these.
    if let Ok(fault) = session.last_fault() {
        row("last fault", &fault.as_ref().map_or_else(|| "none since power-on".to_owned(), fault_in_words));
    }
    if let Ok(health) = session.health() {
        row("stack", &format!("{} of {} bytes at most", health.stack_used_max, health.stack_bytes));
    }
    for &address in &arguments.registers {
        let value = session.read_register(address)?;
        row(&format!("register {address:#04x}"), &format!("{value:#06x}"));
    }
    Ok(ExitCode::SUCCESS)
}

fn row(name: &str, value: &str) {
    println!("{name:<14} {value}");
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
    row("clock", &clock(hello));
    row("last start", &format!("{}, {} restarts since power-on", restart(hello.restart), hello.restarts));
}

fn front_end(hello: &Hello) -> String {
    let FrontEndKind::Ads131m02 = hello.front_end.kind;
    match hello.front_end.id_word {
        0 => "ADS131M02: none answers".to_owned(),
        word => format!("ADS131M02, ID {word:#06x}"),
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

fn print_counters(counters: &Counters) {
    let lost = counters.samples_missed + counters.samples_damaged + counters.samples_dropped;
    row(
        "samples",
        &format!(
            "{} in {} s; lost {lost}: {} not read in time, {} damaged on the bus, {} without room",
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
