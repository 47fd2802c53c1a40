//! `palpate monitor`.

mod device_force;
mod lines;
pub(super) mod watch;

use std::process::ExitCode;

use miette::IntoDiagnostic as _;
use palpate::finger::judge::CountsJudge;
use palpate_device::Session;

use super::calibrated::{FingerArguments, KeptTare};
use super::lacking;
use super::tared::{self, Untared};
use crate::advice::Advise as _;
use crate::live::{self, interrupt};
use crate::recording;
use crate::screen::state::{Finger, Recorded, State};
use crate::screen::terminal::{self, Screen};
use watch::{Ended, Tared, Watch};

/// Shows live what the finger feels: full screen on a terminal, one line a reading elsewhere.
///
/// On the screen: the disk with the contact, force, strain of both bridges, noise, losses, alarms. Its keys: t takes a
/// new tare, r begins and ends a recording, m sets a mark in it, q quits. --plain prints lines instead.
///
/// Begins with a tare, for which the finger must be free: it is refused if it was not. With --tare-file the kept
/// one is used instead.
///
/// Exit status: 0, 1 if something cannot be used, 3 if samples were no measurements (saturated, stuck, settling) or the
/// device started anew, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Take the tare over so many seconds at the start
    #[arg(long, default_value_t = 1.0, value_name = "S", allow_negative_numbers = true, value_parser = super::stretch)]
    tare: f64,

    /// Use the tare kept in this file instead of taking one
    #[arg(long, value_name = "FILE", conflicts_with = "tare")]
    tare_file: Option<std::path::PathBuf>,

    /// Keep the tare in this file
    #[arg(long, value_name = "FILE")]
    keep_tare: Option<std::path::PathBuf>,

    /// Average over so many milliseconds: 20 is a mains period at 50 Hz, 0 is every sample by itself. A kept tare
    /// brings its own
    #[arg(long, default_value_t = 20.0, conflicts_with = "tare_file", value_name = "MS", allow_negative_numbers = true, value_parser = super::not_negative)]
    average_ms: f64,

    /// Print so many lines a second; 0 prints every reading
    #[arg(long, default_value_t = 10.0, value_name = "HZ", allow_negative_numbers = true, value_parser = super::not_negative)]
    print_hz: f64,

    /// Friction coefficient between finger and part
    #[arg(long, default_value_t = 0.0, value_name = "MU", allow_negative_numbers = true, value_parser = super::not_negative)]
    mu_c: f64,

    /// Polar angle in finger axes that shall read 0, in degrees
    #[arg(long, default_value_t = 0.0, value_name = "DEG", allow_negative_numbers = true, value_parser = super::finite)]
    mounting_deg: f64,

    /// Stop after so many seconds [default: until Ctrl-C]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = super::positive)]
    seconds: Option<f64>,

    /// Print lines on a terminal too
    #[arg(long)]
    plain: bool,

    /// Print one JSON object a line
    #[arg(long)]
    json: bool,

    /// Say at the end how long samples took to become angles
    #[arg(long)]
    latency: bool,

    /// Have the device compute forces as well, and hold each against its samples
    #[arg(long)]
    device_force: bool,

    /// Have the device keep matrix and tare for its forces in its flash, over restarts
    #[arg(long, requires = "device_force")]
    store: bool,

    #[command(flatten)]
    finger: FingerArguments,
}

/// The screen is told of readings at this rate, Hz: twice as often as it is drawn.
const SCREEN_HZ: f64 = 30.0;

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    interrupt::listen();
    arguments.finger.device.begin_recording()?;
    let mut session = arguments.finger.device.open(true)?;
    let calibration = arguments.finger.calibration.require(&session)?;
    let settings = tared::settings(arguments.mounting_deg.to_radians(), arguments.mu_c, arguments.average_ms);
    let finger = Untared::new(&session, calibration, settings, arguments.finger.offset)?;
    live::start(&mut session).advised()?;
    session.ping().advised()?;
    let unit = finger.unit();
    let mut judge = CountsJudge::new(&finger.calibration);
    let kept = match &arguments.tare_file {
        Some(file) => Some(KeptTare::load(file, &session, unit)?),
        None => None,
    };
    // Only now: what went wrong before is told on the terminal as it is.
    let screen = if arguments.is_screen() { Some(shown(&session, &finger)?) } else { None };
    let tare = match kept {
        Some(kept) => kept,
        None => {
            note!("{}taring for {} s: keep the finger free", super::simulated_note(&session), arguments.tare);
            let offset = finger.expected_offset();
            live::tare(&mut session, &mut judge, arguments.tare, &finger.settings, offset, super::tell).advised()?
        }
    };
    tared::report(&tare, unit);
    let kept = KeptTare::new(&session, unit, tare);
    kept.attach();
    if let Some(file) = &arguments.keep_tare {
        kept.save(file)?;
    }
    if arguments.device_force {
        let matrix = device_force::matrix(&finger.calibration, &tare)?;
        session.stop().advised()?;
        session.set_device_forces(Some(matrix)).advised()?;
        if arguments.store {
            let stalled = session.store_device_matrix(true).advised()?;
            note!("the device keeps matrix and tare; it stood still for {:.1} ms", 1e3 * stalled.as_secs_f64());
        }
        live::start(&mut session).advised()?;
    }
    let tared = Tared::new(finger, tare)?;
    let mut watch = Watch::new(arguments, tared, judge, screen)?;
    let is_read = loop {
        let watched = watch.watch(&mut session);
        // Whatever ended it, nobody listens any more.
        let stopped = session.stop();
        let ended = watched?;
        stopped.advised()?;
        match ended {
            Ended::Over => break true,
            Ended::NobodyReads => break false,
            Ended::ToRecord => session = watch.recorded_from_here(session)?,
        }
    };
    if arguments.device_force {
        session.set_device_forces(None).advised()?;
    }
    let lacked = watch.tally();
    // What is told from here on is for the terminal as it was.
    drop(watch);
    tell_counts(&session);
    let forces_hold = !arguments.device_force || device_force::holds(&session);
    lacking::tell("since the tare", &lacked);
    if !is_read {
        recording::end();
        std::process::exit(super::EXIT_BROKEN_PIPE);
    }
    Ok(if forces_hold { lacking::status(&lacked) } else { ExitCode::FAILURE })
}

/// A screen for this device, before anything is felt.
fn shown(session: &Session, finger: &Untared) -> miette::Result<Screen> {
    let finger = Finger::of(session, finger.unit(), finger.front_end.microstrain_per_count());
    let recording = recording::file().map(|file| Recorded {
        file: file.display().to_string(),
        since: None,
        marks: 0,
        goes_on: true,
    });
    let state = State { finger, is_taring: true, recording, ..State::default() };
    Screen::start(state).into_diagnostic()
}

/// Tells what the session counted.
pub(super) fn tell_counts(session: &Session) {
    let counts = session.counts();
    let newer = match counts.unknown_messages {
        0 => String::new(),
        skipped => format!(", {skipped} messages skipped that only a newer palpate can read"),
    };
    let lost_link = match counts.disconnections {
        0 => String::new(),
        times => format!(", {times} disconnections"),
    };
    let restarts = match counts.restarts {
        0 => String::new(),
        times => format!(", {times} restarts of the device (what it lost in them has no numbers)"),
    };
    note!(
        "{} samples, {} missing, {} repeated, {} damaged frames{newer}{lost_link}{restarts}",
        counts.samples,
        counts.missing,
        counts.repeated,
        counts.damaged_frames
    );
}

impl Arguments {
    /// Whether to show a screen: on a terminal, and of a recording only if it is played at some speed.
    fn is_screen(&self) -> bool {
        let is_played = self.finger.device.is_recording() && !self.finger.device.has_speed();
        !self.plain && !self.json && !is_played && terminal::is_there()
    }
}
