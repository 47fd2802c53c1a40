//! `palpate monitor`.

use std::io::{self, Write as _};
use std::process::ExitCode;
use std::time::Instant;

use miette::IntoDiagnostic as _;
use palpate::finger::contact::{Averaging, Contact, ContactReading, ContactSettings, Tare, detector};
use palpate::finger::judge::CountsJudge;
use palpate::finger::monitor::{ContactMonitor, MonitorLine};
use palpate::finger::sense::{self, FingerSense, Sensed};
use palpate_device::{Incoming, Session};
use serde_json::{Value, json};

use super::calibrated::{CalibrationArguments, KeptTare, OffsetArguments};
use super::device::DeviceArguments;
use super::lacking;
use super::latency::Latency;
use crate::advice::{self, Advise as _};
use crate::live::interrupt;
use crate::live::{self, LiveError};
use crate::recording;

/// Shows live what the finger feels: one line a reading.
///
/// Begins with a tare, for which the finger must be free: it is refused if it was not. With --tare-file the kept
/// one is used instead.
///
/// Exit status: 0, 1 if something cannot be used, 3 if samples were no measurements (saturated, stuck, settling) or the
/// device started anew, 64 wrong command line.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,

    #[command(flatten)]
    offset: OffsetArguments,

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

    /// Print so many readings a second; 0 prints every one
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

    /// Print one JSON object a line
    #[arg(long)]
    json: bool,

    /// Say at the end how long samples took to become angles
    #[arg(long)]
    latency: bool,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    interrupt::listen();
    arguments.device.begin_recording()?;
    let mut session = arguments.device.open(true)?;
    let calibration = arguments.calibration.require(&session)?;
    let front_end = live::front_end(session.hello()).advised()?;
    let settings = ContactSettings { bias_walk: sense::bias_walk(&calibration, &front_end), ..settings(arguments) };
    settings.check().into_diagnostic()?;
    live::start(&mut session).advised()?;
    session.ping().advised()?;
    let unit = calibration.unit().symbol();
    let mut judge = CountsJudge::new(&calibration);
    let tare = match &arguments.tare_file {
        Some(file) => KeptTare::load(file, &session, unit)?,
        None => {
            note!("{}taring for {} s: keep the finger free", super::simulated_note(&session), arguments.tare);
            let offset = arguments.offset.expected(&calibration, &front_end);
            live::tare(&mut session, &mut judge, arguments.tare, &settings, offset, super::tell).advised()?
        }
    };
    report_tare(&tare, unit);
    let kept = KeptTare::new(&session, unit, tare);
    kept.attach();
    if let Some(file) = &arguments.keep_tare {
        kept.save(file)?;
    }
    let finger = FingerSense::new(Some(calibration), tare, &settings).into_diagnostic()?;
    recording::tared(unit, Some(tare.bias));
    recording::sensing(&finger);
    let period_s = if arguments.print_hz > 0.0 { arguments.print_hz.recip() } else { 0.0 };
    let mut shown = Shown { arguments, unit, monitor: ContactMonitor::new(finger, period_s), judge };
    let watched = shown.show(&mut session);
    // Whatever ended it, nobody listens any more.
    let stopped = session.stop();
    let is_read = watched?;
    stopped.advised()?;
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
    let tally = shown.monitor.tally();
    lacking::tell("since the tare", &tally);
    if !is_read {
        recording::end();
        std::process::exit(super::EXIT_BROKEN_PIPE);
    }
    Ok(lacking::status(&tally))
}

fn settings(arguments: &Arguments) -> ContactSettings {
    ContactSettings {
        mounting_angle: arguments.mounting_deg.to_radians(),
        contact_friction: arguments.mu_c,
        averaging: if arguments.average_ms > 0.0 {
            Averaging::Seconds(arguments.average_ms * 1e-3)
        } else {
            Averaging::Off
        },
        ..ContactSettings::default()
    }
}

fn report_tare(tare: &Tare, unit: &str) {
    note!(
        "tare ({:.4}, {:.4}) {unit} from {} samples; noise of one reading ({:.4}, {:.4}) {unit}",
        tare.bias.x,
        tare.bias.y,
        tare.samples,
        tare.sample_covariance[(0, 0)].sqrt(),
        tare.sample_covariance[(1, 1)].sqrt(),
    );
}

/// The stream of lines.
struct Shown<'a> {
    arguments: &'a Arguments,
    unit: &'static str,
    monitor: ContactMonitor,
    judge: CountsJudge,
}

impl Shown<'_> {
    /// Prints until it is time to stop, or nobody reads: whether somebody still does.
    fn show(&mut self, session: &mut Session) -> miette::Result<bool> {
        let Self { arguments, unit, monitor, judge } = self;
        let seconds = arguments.seconds.unwrap_or(f64::INFINITY);
        let (mut latency, mut until_s) = (Latency::default(), None);
        let mut written = Ok(());
        let mut silent = false;
        loop {
            let ended = live::judged(session, judge, |session, incoming, judged| {
                let Incoming::Samples(samples) = incoming else {
                    tell(arguments.json, incoming);
                    monitor.take(judged);
                    return true;
                };
                silent = false;
                if arguments.latency {
                    latency.take(session, samples, Instant::now());
                }
                let lines = monitor.take(judged);
                written = lines.iter().try_for_each(|line| {
                    write_line(&if arguments.json {
                        as_json(session, line, unit).to_string()
                    } else {
                        in_words(session, line, unit)
                    })
                });
                let end_s = samples.device_time_s(samples.counts.len());
                written.is_ok() && end_s < *until_s.get_or_insert(end_s + seconds)
            });
            match ended {
                // The device is there and its front-end is not: it may come back as a cable does.
                Err(error @ LiveError::Silent { .. }) => {
                    if !silent {
                        note!("{error}; waiting");
                    }
                    silent = true;
                }
                Err(error) => return Err(advice::report(error)),
                Ok(()) => break,
            }
        }
        match written {
            // Whoever read the lines has seen enough.
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(false),
            other => other.into_diagnostic()?,
        }
        if let Some(latency) = latency.in_words() {
            note!("latency {latency}");
        }
        Ok(true)
    }
}

/// What happened beside the samples: for a person on standard error, for a program in the stream.
fn tell(json: bool, incoming: &Incoming) {
    if !json {
        return super::tell(incoming);
    }
    let what = match incoming {
        Incoming::Event(event) => json!({ "device": live::in_words(event.kind) }),
        Incoming::Silent { after } => json!({ "link": "silent", "after_s": after.as_secs_f64() }),
        Incoming::Disconnected { reason } => json!({ "link": "lost", "reason": reason }),
        Incoming::Reconnected { after, countable } => {
            json!({ "link": "back", "after_s": after.as_secs_f64(), "missing_counted": countable })
        }
        Incoming::Restarted(_) => json!({ "device": "started anew; its settings were restored" }),
        Incoming::Samples(_) | Incoming::Temperature(_) => return,
    };
    // If nobody reads, the next line of samples finds out.
    let _ = write_line(&what.to_string());
}

/// Writes a line at once: somebody waits for it.
fn write_line(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush())
}

/// A line for a person.
fn in_words(session: &Session, line: &MonitorLine, unit: &str) -> String {
    let mark = if session.is_simulated() { "  [simulated]" } else { "" };
    match &line.sensed {
        Sensed::Contact(reading) => format!("{}{mark}", reading_in_words(reading, unit)),
        Sensed::NotMeasured { t, fault } => format!("{t:9.3} s  NOT MEASURING: {fault}{mark}"),
    }
}

fn reading_in_words(reading: &ContactReading, unit: &str) -> String {
    match &reading.contact {
        Contact::Free { sigmas, .. } => format!("{:9.3} s  no contact ({sigmas:.1} sigma)", reading.t),
        Contact::Touching(touch) => {
            let friction = if touch.friction_half_angle > 0.0 {
                format!(" ± {:.1} (friction)", touch.friction_half_angle.to_degrees())
            } else {
                String::new()
            };
            format!(
                "{:9.3} s  at {:7.2}° ± {:.2}{friction}, {:.4} ± {:.4} {unit}",
                reading.t,
                touch.u.to_degrees(),
                touch.u_sd.to_degrees(),
                touch.magnitude,
                touch.magnitude_sd,
            )
        }
    }
}

/// A line for a program: s, rad, and force in `unit` (`N`, or the calibration's relative unit). `t` is on the device's
/// clock, `unix_time` on the host's; `temperature_c` is the board's, null where it has told none; `contact` is null where nothing was measured; `missing_before` counts since the
/// line before, `samples` since the tare.
fn as_json(session: &Session, line: &MonitorLine, unit: &str) -> Value {
    let sensed = &line.sensed;
    let t = match sensed {
        Sensed::Contact(reading) => reading.t,
        Sensed::NotMeasured { t, .. } => *t,
    };
    let mut told = json!({
        "t": t,
        "unix_time": session.unix_time_s(t),
        "simulated": session.is_simulated(),
        "unit": unit,
        "temperature_c": session.temperature_c(),
        "missing_before": line.since_last.missing,
        "samples": lacking::as_json(&line.since_start),
    });
    let more = match sensed {
        Sensed::NotMeasured { fault, .. } => json!({ "contact": null, "fault": fault.to_string() }),
        Sensed::Contact(reading) => contact_as_json(reading),
    };
    if let (Value::Object(told), Value::Object(more)) = (&mut told, more) {
        told.extend(more);
    }
    told
}

fn contact_as_json(reading: &ContactReading) -> Value {
    let event = reading.event.map(|event| match event {
        detector::Event::Onset { .. } => "onset",
        detector::Event::Release { .. } => "release",
    });
    match &reading.contact {
        Contact::Free { force_finger, sigmas } => json!({
            "contact": false, "event": event, "sigmas": sigmas, "force": [force_finger.x, force_finger.y],
        }),
        Contact::Touching(touch) => json!({
            "contact": true, "event": event, "u": touch.u, "u_sd": touch.u_sd,
            "friction_half_angle": touch.friction_half_angle, "force": [touch.force_finger.x, touch.force_finger.y],
            "magnitude": touch.magnitude, "magnitude_sd": touch.magnitude_sd, "onset": touch.onset,
        }),
    }
}
