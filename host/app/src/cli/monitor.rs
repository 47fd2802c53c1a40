//! `palpate monitor`.

use std::cell::RefCell;
use std::io::{self, Write as _};
use std::process::ExitCode;
use std::time::{Instant, SystemTime};

use miette::IntoDiagnostic as _;
use palpate::finger::contact::{Averaging, Contact, ContactReading, ContactSettings, Tare, detector};
use palpate::finger::sense::{self, FingerSense, SenseFault, Sensed};
use palpate_device::{Incoming, Session};
use serde_json::{Value, json};

use super::calibrated::{CalibrationArguments, KeptTare};
use super::device::DeviceArguments;
use super::latency::Latency;
use crate::advice::{self, Advise as _};
use crate::live::interrupt;
use crate::live::{self, LiveError};

/// Shows live what the finger feels: one line a reading.
///
/// Begins with a tare, for which the finger must be free: it is refused if it was not. With --tare-file the kept
/// one is used instead.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,

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
    let mut session = arguments.device.open(true)?;
    let calibration = arguments.calibration.require(&session)?;
    let front_end = live::front_end(session.hello()).advised()?;
    let settings = ContactSettings { bias_walk: sense::bias_walk(&calibration, &front_end), ..settings(arguments) };
    settings.check().into_diagnostic()?;
    session.start().advised()?;
    session.ping().advised()?;
    let unit = calibration.unit().symbol();
    let tare = match &arguments.tare_file {
        Some(file) => KeptTare::load(file, &session, unit)?,
        None => {
            note!("{}taring for {} s: keep the finger free", super::simulated_note(&session), arguments.tare);
            live::tare(&mut session, arguments.tare, &calibration, &settings, super::tell).advised()?
        }
    };
    report_tare(&tare, unit);
    if let Some(file) = &arguments.keep_tare {
        KeptTare::new(&session, unit, tare).save(file)?;
    }
    let finger = FingerSense::new(calibration, tare, &settings).into_diagnostic()?;
    let shown = Monitor::new(arguments, finger, unit).show(&mut session);
    // Whatever ended it, nobody listens any more.
    let stopped = session.stop();
    shown?;
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
    Ok(ExitCode::SUCCESS)
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

/// The stream of lines, and what it needs from one to the next.
struct Monitor<'a> {
    arguments: &'a Arguments,
    finger: FingerSense,
    unit: &'static str,
    latency: Latency,
    /// Device time of the next line, s.
    next_s: f64,
    /// Device time at which to stop, s.
    until_s: Option<f64>,
    fault: Option<SenseFault>,
}

impl<'a> Monitor<'a> {
    fn new(arguments: &'a Arguments, finger: FingerSense, unit: &'static str) -> Self {
        let latency = Latency::default();
        Self { arguments, finger, unit, latency, next_s: 0.0, until_s: None, fault: None }
    }

    /// Prints until it is time to stop, or nobody reads.
    fn show(self, session: &mut Session) -> miette::Result<()> {
        let monitor = RefCell::new(self);
        let mut written = Ok(());
        let mut silent = false;
        loop {
            let ended = live::stream(
                session,
                |session, samples| {
                    silent = false;
                    let mut monitor = monitor.borrow_mut();
                    let lines = monitor.lines(session, samples);
                    if monitor.arguments.latency {
                        monitor.latency.take(session, samples, Instant::now());
                    }
                    written = lines.into_iter().try_for_each(|line| write_line(&line));
                    written.is_ok() && !monitor.is_over(samples)
                },
                |incoming| monitor.borrow().tell(incoming),
            );
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
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(()),
            other => other.into_diagnostic()?,
        }
        if let Some(latency) = monitor.borrow().latency.in_words() {
            note!("latency {latency}");
        }
        Ok(())
    }

    fn is_over(&mut self, samples: &palpate::finger::Samples) -> bool {
        let end_s = samples.device_time_s(samples.counts.len());
        let seconds = self.arguments.seconds.unwrap_or(f64::INFINITY);
        end_s >= *self.until_s.get_or_insert(end_s + seconds)
    }

    /// The lines that a block gives.
    fn lines(&mut self, session: &Session, samples: &palpate::finger::Samples) -> Vec<String> {
        let mut lines = Vec::new();
        for sensed in self.finger.feel(samples) {
            let (t, fault, event) = match &sensed {
                Sensed::Contact(reading) => (reading.t, None, reading.event),
                Sensed::NotMeasured { t, fault } => (*t, Some(*fault), None),
            };
            let news = event.is_some() || fault != self.fault;
            self.fault = fault;
            if news || t >= self.next_s {
                self.next_s = if self.arguments.print_hz > 0.0 { t + self.arguments.print_hz.recip() } else { t };
                lines.push(self.line(session, &sensed, samples.missing_before));
            }
        }
        lines
    }

    fn line(&self, session: &Session, sensed: &Sensed, missing_before: u64) -> String {
        if self.arguments.json {
            return as_json(session, sensed, self.unit, missing_before).to_string();
        }
        let mark = if session.is_simulated() { "  [simulated]" } else { "" };
        match sensed {
            Sensed::Contact(reading) => format!("{}{mark}", as_words(reading, self.unit)),
            Sensed::NotMeasured { t, fault } => format!("{t:10.4} s  NOT MEASURING: {fault}{mark}"),
        }
    }

    /// What happened beside the samples: for a person on standard error, for a program in the stream.
    fn tell(&self, incoming: &Incoming) {
        if !self.arguments.json {
            return super::tell(incoming);
        }
        let what = match incoming {
            Incoming::Event(event) => json!({ "device": live::in_words(event.kind) }),
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
}

/// Writes a line at once: somebody waits for it.
fn write_line(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}").and_then(|()| out.flush())
}

/// A reading for a person.
fn as_words(reading: &ContactReading, unit: &str) -> String {
    match &reading.contact {
        Contact::Free { sigmas, .. } => format!("{:10.4} s  no contact ({sigmas:.1} sigma)", reading.t),
        Contact::Touching(touch) => {
            let friction = if touch.friction_half_angle > 0.0 {
                format!(" +/-{:.1} (friction)", touch.friction_half_angle.to_degrees())
            } else {
                String::new()
            };
            format!(
                "{:10.4} s  contact at {:8.2} deg, sd {:.2}{friction}, force {:.4} {unit}, sd {:.4}",
                reading.t,
                touch.u.to_degrees(),
                touch.u_sd.to_degrees(),
                touch.magnitude,
                touch.magnitude_sd,
            )
        }
    }
}

/// A moment on the device's clock as Unix time, in s, by the clock map.
fn unix_time(session: &Session, device_s: f64) -> Option<f64> {
    let host_s = session.clock()?.host_time(device_s);
    let since_epoch = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).ok()?.as_secs_f64();
    Some(since_epoch - session.epoch().elapsed().as_secs_f64() + host_s)
}

/// A reading for a program: s, rad, and force in `unit` (`N`, or the calibration's relative unit). `t` is on the
/// device's clock, `unix_time` on the host's; `contact` is null where nothing was measured.
fn as_json(session: &Session, sensed: &Sensed, unit: &str, missing_before: u64) -> Value {
    let t = match sensed {
        Sensed::Contact(reading) => reading.t,
        Sensed::NotMeasured { t, .. } => *t,
    };
    let mut line = json!({
        "t": t,
        "unix_time": unix_time(session, t),
        "simulated": session.is_simulated(),
        "unit": unit,
        "missing_before": missing_before,
    });
    let more = match sensed {
        Sensed::NotMeasured { fault, .. } => json!({ "contact": null, "fault": fault.to_string() }),
        Sensed::Contact(reading) => contact_as_json(reading),
    };
    if let (Value::Object(line), Value::Object(more)) = (&mut line, more) {
        line.extend(more);
    }
    line
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
