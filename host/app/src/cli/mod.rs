//! The commands, one file each. They parse, call the library and print; they compute nothing.

/// Prints a line to standard output, as `println!` does, but ends in order when nobody reads it any more.
macro_rules! say {
    ($($argument:tt)*) => { $crate::cli::write_out(format_args!("{}\n", format_args!($($argument)*))) };
}

/// As `eprintln!` of the standard library, but a standard error that nobody reads is no reason to stop.
macro_rules! eprintln {
    ($($argument:tt)*) => {{
        use std::io::Write as _;
        let _ = $crate::progress::apart(|| writeln!(std::io::stderr(), $($argument)*));
    }};
}

/// A line on standard error for the person at the terminal, which `--quiet` leaves out.
macro_rules! note {
    ($($argument:tt)*) => { $crate::cli::note_down(format_args!($($argument)*)) };
}

mod calibrate;
mod calibrated;
mod completions;
mod contact;
mod corner;
mod demo;
mod device;
mod diagnose;
mod export;
#[cfg(feature = "flash")]
mod flash;
mod follow;
mod friction;
mod help;
mod import;
mod info;
mod inscribe;
mod kept_push;
mod lacking;
mod latency;
mod library;
mod locate_tip;
mod man;
mod measured_motion;
mod misfit;
mod monitor;
mod motion_source;
mod observe;
mod observe_gho;
mod observe_slow;
mod observed_plot;
mod palm;
mod palm_motion;
mod part;
mod passing;
mod plan_push;
mod plot;
mod ports;
mod pose;
mod push;
mod read;
mod record;
mod recover;
mod replay;
mod report;
mod roll;
mod sample;
mod sample_live;
mod semi_axes;
#[cfg(feature = "web")]
mod serve;
mod simulate_device;
mod simulate_passing;
mod simulate_robot;
mod slow_push;
mod solve;
mod static_demo;
mod switches;
mod tables;
mod tared;
mod tasks;
mod told_tables;
mod touch;
mod touch_world;
mod watched_push;
mod wave;
mod which_part;
mod zero_drift;

pub(crate) use calibrate::rfc3339;
pub(crate) use touch::advice as touch_advice;

use std::f64::consts::PI;
use std::io::Write as _;
use std::process::ExitCode;

use clap::{CommandFactory as _, FromArgMatches as _, Parser, Subcommand};
use palpate::math::angle::wrap_angle;
use palpate_device::{Incoming, Session};

use crate::live;
use crate::messages::{self, Loudness};
use crate::progress::{self, Progress};
use crate::recording::{self, LogLevel};

/// Exit status for a wrong command line (`EX_USAGE` of BSD's sysexits; fixed by the `solve` interface).
const EXIT_USAGE: u8 = 64;

/// Feel where a known part is and how it moves, with a strain-gauge finger.
#[derive(Debug, Parser)]
#[command(name = "palpate", version, propagate_version = true, arg_required_else_help = true)]
struct Arguments {
    #[command(flatten)]
    loudness: Loudness,

    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    Demo(demo::Arguments),
    Ports(ports::Arguments),
    Info(info::Arguments),
    #[cfg(feature = "flash")]
    Flash(flash::Arguments),
    Diagnose(diagnose::Arguments),
    Calibrate(calibrate::Arguments),
    Wave(wave::Arguments),
    LocateTip(locate_tip::Arguments),
    ZeroDrift(zero_drift::Arguments),
    Monitor(monitor::Arguments),
    #[cfg(feature = "web")]
    Serve(serve::Arguments),
    Record(record::Arguments),
    Replay(replay::Arguments),
    Recover(recover::Arguments),
    Report(report::Arguments),
    Export(export::Arguments),
    Observe(Box<observe::Arguments>),
    PlanPush(plan_push::Arguments),
    WhichPart(which_part::Arguments),
    Friction(friction::Arguments),
    Contact(contact::Arguments),
    Import(import::Arguments),
    Part(part::Arguments),
    Push(push::Arguments),
    Inscribe(inscribe::Arguments),
    Sample(sample::Arguments),
    Touch(touch::Arguments),
    Corner(corner::Arguments),
    Roll(roll::Arguments),
    Palm(palm::Arguments),
    Tables(tables::Arguments),
    Solve(solve::Arguments),
    SimulateDevice(simulate_device::Arguments),
    SimulatePassing(simulate_passing::Arguments),
    SimulateRobot(simulate_robot::Arguments),
    Completions(completions::Arguments),
    Man(man::Arguments),
}

/// What is done about a push, live or from a file.
const FEELING: &str = "feeling the push and searching poses";

impl Command {
    /// What is being done meanwhile, where a command may compute for long and nobody types into it. Those that sample for long say
    /// themselves when, `tables` how far it is.
    fn takes_long(&self) -> Option<&'static str> {
        match self {
            Self::Demo(_) => Some("pushing and searching"),
            Self::Diagnose(_) => Some("sampling at rest"),
            Self::Record(_) => Some("recording"),
            Self::ZeroDrift(_) => Some("watching the finger at rest"),
            Self::Recover(_) => Some("looking for what is whole"),
            Self::Report(_) | Self::Export(_) => Some("reading"),
            Self::Contact(_) | Self::Import(_) => Some("reading"),
            Self::Push(_) | Self::Roll(_) => Some("simulating"),
            Self::Inscribe(_) => Some("searching poses"),
            Self::Sample(_) | Self::Corner(_) => Some("searching points and their proof"),
            Self::PlanPush(_) | Self::WhichPart(_) | Self::Friction(_) => Some(FEELING),
            Self::Observe(arguments) if !arguments.reads_keyboard() => Some(FEELING),
            _ => None,
        }
    }
}

/// The command line that is understood, with all that its help says.
fn command() -> clap::Command {
    tasks::described(Arguments::command())
}

/// Runs the command named on the command line and returns the process's exit status.
///
/// Answers go to standard output. Warnings go to standard error, unless the program has a `tracing` subscriber already.
pub fn run<I, T>(arguments: I) -> ExitCode
where
    I: IntoIterator<Item = T>,
    T: Into<std::ffi::OsString> + Clone,
{
    let words: Vec<std::ffi::OsString> = arguments.into_iter().map(Into::into).collect();
    recording::remember_command_line(&words);
    let parsed = command().try_get_matches_from(words).and_then(|matches| Arguments::from_arg_matches(&matches));
    let arguments = match parsed {
        Ok(arguments) => arguments,
        Err(error) => {
            let failed = error.use_stderr();
            // Nothing is left to do if even this cannot be written.
            let _ = error.print();
            return if failed { ExitCode::from(EXIT_USAGE) } else { ExitCode::SUCCESS };
        }
    };
    messages::listen(arguments.loudness);
    tracing::debug!("palpate {} on {} {}", env!("CARGO_PKG_VERSION"), std::env::consts::OS, std::env::consts::ARCH);
    let progress = arguments.command.takes_long().map(Progress::begin);
    let outcome = match arguments.command {
        Command::Demo(arguments) => demo::run(&arguments),
        Command::Ports(arguments) => ports::run(&arguments),
        Command::Info(arguments) => info::run(&arguments),
        #[cfg(feature = "flash")]
        Command::Flash(arguments) => flash::run(&arguments),
        Command::Diagnose(arguments) => diagnose::run(&arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Wave(arguments) => wave::run(&arguments),
        Command::LocateTip(arguments) => locate_tip::run(&arguments),
        Command::ZeroDrift(arguments) => zero_drift::run(&arguments),
        Command::Monitor(arguments) => monitor::run(&arguments),
        #[cfg(feature = "web")]
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Record(arguments) => record::run(&arguments),
        Command::Replay(arguments) => replay::run(&arguments),
        Command::Recover(arguments) => recover::run(&arguments),
        Command::Report(arguments) => report::run(&arguments),
        Command::Export(arguments) => export::run(&arguments),
        Command::Observe(arguments) => observe::run(&arguments),
        Command::PlanPush(arguments) => plan_push::run(&arguments),
        Command::WhichPart(arguments) => which_part::run(&arguments),
        Command::Friction(arguments) => friction::run(&arguments),
        Command::Contact(arguments) => contact::run(&arguments),
        Command::Import(arguments) => import::run(&arguments),
        Command::Part(arguments) => part::run(&arguments),
        Command::Push(arguments) => push::run(&arguments),
        Command::Inscribe(arguments) => inscribe::run(&arguments),
        Command::Sample(arguments) => sample::run(&arguments),
        Command::Touch(arguments) => touch::run(&arguments),
        Command::Corner(arguments) => corner::run(&arguments),
        Command::Roll(arguments) => roll::run(&arguments),
        Command::Palm(arguments) => palm::run(&arguments),
        Command::Tables(arguments) => tables::run(&arguments),
        Command::Solve(arguments) => solve::run(&arguments),
        Command::SimulateDevice(arguments) => simulate_device::run(&arguments),
        Command::SimulatePassing(arguments) => simulate_passing::run(&arguments),
        Command::SimulateRobot(arguments) => simulate_robot::run(&arguments),
        Command::Completions(arguments) => completions::run(&arguments),
        Command::Man(arguments) => man::run(&arguments),
    };
    drop(progress);
    let status = outcome.unwrap_or_else(|report| {
        eprintln!("{report:?}");
        recording::log(LogLevel::Error, &report.to_string());
        ExitCode::FAILURE
    });
    recording::end();
    status
}

/// A note: for the person, and for the recording.
fn note_down(text: std::fmt::Arguments<'_>) {
    messages::note(text);
    if recording::is_active() {
        recording::log(LogLevel::Info, &text.to_string());
    }
}

/// A number of things, such as "1 point" or "2 points".
fn counted(count: usize, thing: &str) -> String {
    format!("{count} {thing}{}", if count == 1 { "" } else { "s" })
}

/// Exit status where nobody reads standard output any more: as of the tools that the system ends by SIGPIPE (128 + 13),
/// so that a script sees that not everything was written.
const EXIT_BROKEN_PIPE: i32 = 141;

/// A turn as people are told it everywhere: above −180° and up to 180°.
fn turn_deg(theta: f64) -> f64 {
    /// Half a turn that was rounded up is half a turn, rad.
    const ROUNDING: f64 = 1e-9;
    let turn = wrap_angle(theta);
    (if turn < ROUNDING - PI { PI } else { turn }).to_degrees()
}

/// Writes to standard output. If that fails the program ends: without a word where the reader has seen enough, and with
/// a complaint where the disk is full.
fn write_out(text: std::fmt::Arguments<'_>) {
    let mut out = std::io::stdout().lock();
    match progress::apart(|| out.write_fmt(text).and_then(|()| out.flush())) {
        Ok(()) => {}
        Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => {
            recording::end();
            std::process::exit(EXIT_BROKEN_PIPE)
        }
        Err(error) => {
            eprintln!("cannot write the output: {error}");
            recording::end();
            std::process::exit(1);
        }
    }
}

/// The words that go before anything shown of a simulated device; empty for a real one.
fn simulated_note(session: &Session) -> &'static str {
    if session.is_simulated() { "SIMULATED device: nothing that it sends was measured\n" } else { "" }
}

/// Tells a person what happened on the link, beside the samples.
fn tell(incoming: &Incoming) {
    match incoming {
        Incoming::Event(event) => note!("device: {}", live::in_words(event.kind)),
        Incoming::Silent { after } => note!("no samples for {:.2} s", after.as_secs_f64()),
        Incoming::Disconnected { reason } => note!("link lost ({reason}); waiting for it to come back"),
        Incoming::Reconnected { after, countable: true } => note!("link back after {:.1} s", after.as_secs_f64()),
        Incoming::Reconnected { after, countable: false } => {
            note!("link back after {:.1} s; the samples missed meanwhile cannot be counted", after.as_secs_f64());
        }
        Incoming::Restarted(_) => note!("the device started anew; its settings were restored"),
        Incoming::Samples(_)
        | Incoming::Temperature(_)
        | Incoming::SlowChannels(_)
        | Incoming::Inputs(_)
        | Incoming::Force(_) => {}
    }
}

/// A number above 0.
fn positive(text: &str) -> Result<f64, String> {
    not_negative(text).and_then(|value| if value > 0.0 { Ok(value) } else { Err("it must be above 0".to_owned()) })
}

/// From 0 to the end in equal steps; only 0 for what ends at once.
fn equal_steps(end: f64, steps: f64) -> Vec<f64> {
    if end <= 0.0 {
        return vec![0.0];
    }
    let places = std::iter::successors(Some(0.0), |k| Some(k + 1.0)).take_while(|k| *k <= steps);
    places.map(|k| end * k / steps).collect()
}

/// A stretch of samples that is kept whole, in s: above 0, and no more than ten minutes.
fn stretch(text: &str) -> Result<f64, String> {
    const LONGEST_S: f64 = 600.0;
    positive(text).and_then(|value| match value {
        value if value <= LONGEST_S => Ok(value),
        value => Err(format!("{value} s is too long: at most {LONGEST_S} s")),
    })
}

/// A finite number.
fn finite(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() => Ok(value),
        Ok(value) => Err(format!("{value} is out of range: it must be finite")),
        Err(_) => Err(format!("`{text}` is not a number")),
    }
}

/// A finite number, 0 or above.
fn not_negative(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value.is_finite() && value >= 0.0 => Ok(value),
        Ok(value) => Err(format!("{value} is out of range: it must be finite and not negative")),
        Err(_) => Err(format!("`{text}` is not a number")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_option_of_a_command_has_the_name_of_another_or_of_an_option_of_all() {
        Arguments::command().debug_assert();
    }

    #[test]
    fn half_a_turn_is_told_with_one_sign() {
        let told = [PI, PI + 1e-15, -PI, 1.5 * PI, 0.0].map(|theta| format!("{:.2}", turn_deg(theta)));
        assert_eq!(told, ["180.00", "180.00", "180.00", "-90.00", "0.00"]);
    }

    #[test]
    fn how_much_is_told_may_be_said_before_and_after_the_command() {
        for words in [["palpate", "-v", "ports"], ["palpate", "ports", "-v"], ["palpate", "ports", "--quiet"]] {
            assert!(Arguments::try_parse_from(words).is_ok(), "{words:?}");
        }
        assert!(Arguments::try_parse_from(["palpate", "ports", "-v", "-q"]).is_err());
    }

    #[test]
    fn a_second_run_in_one_process_is_as_good_as_the_first() {
        for _ in 0..2 {
            assert_eq!(run(["palpate", "tables", "-q"]), ExitCode::SUCCESS);
        }
    }

    #[test]
    fn every_command_has_a_page_and_every_shell_knows_it() {
        use clap_complete::Shell;
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(run(["palpate".as_ref(), "man".as_ref(), folder.path().as_os_str()]), ExitCode::SUCCESS);
        let scripts = [Shell::Bash, Shell::Zsh, Shell::Fish].map(completions::script);
        for command in command().get_subcommands() {
            let name = command.get_name();
            let page = std::fs::read_to_string(folder.path().join(format!("palpate-{name}.1"))).unwrap();
            assert!(page.contains(".SH SYNOPSIS"), "{name}: {page}");
            assert!(scripts.iter().all(|script| script.contains(name)), "{name}");
        }
        assert!(folder.path().join("palpate.1").exists());
    }
}
