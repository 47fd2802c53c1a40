//! `palpate monitor`.

use std::io::{self, Write as _};
use std::process::ExitCode;
use std::time::{Instant, SystemTime};

use miette::IntoDiagnostic as _;
use palpate::contact::{Averaging, Contact, Felt, Settings, Tare};
use palpate::link::Session;
use palpate::live::{self, LiveError};
use palpate::sensing::{self, FingerSense};

use super::calibrated::CalibrationArguments;
use super::device::DeviceArguments;
use super::latency::Latency;

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
    #[arg(long, default_value_t = 1.0, value_name = "S", value_parser = super::positive)]
    tare: f64,

    /// Use the tare kept in this file instead of taking one
    #[arg(long, value_name = "FILE", conflicts_with = "tare")]
    tare_file: Option<std::path::PathBuf>,

    /// Keep the tare in this file
    #[arg(long, value_name = "FILE")]
    keep_tare: Option<std::path::PathBuf>,

    /// Average over so many milliseconds: 20 is a mains period at 50 Hz, 0 is every sample by itself
    #[arg(long, default_value_t = 20.0, value_name = "MS", value_parser = super::not_negative)]
    average_ms: f64,

    /// Print so many readings a second; 0 prints every one
    #[arg(long, default_value_t = 10.0, value_name = "HZ", value_parser = super::not_negative)]
    print_hz: f64,

    /// Friction coefficient between finger and part
    #[arg(long, default_value_t = 0.0, value_name = "MU", value_parser = super::not_negative)]
    mu_c: f64,

    /// Angle of the finger's x axis in the frame of the angles that are shown, in degrees
    #[arg(long, default_value_t = 0.0, value_name = "DEG", allow_negative_numbers = true)]
    mounting_deg: f64,

    /// Stop after so many seconds [default: until Ctrl-C]
    #[arg(long, value_name = "S", value_parser = super::positive)]
    seconds: Option<f64>,

    /// Print one JSON object a line
    #[arg(long)]
    json: bool,

    /// Say at the end how long samples took to become angles
    #[arg(long)]
    latency: bool,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let mut session = arguments.device.open(true)?;
    let calibration = arguments.calibration.require(&session)?;
    let front_end = live::front_end(session.hello())?;
    let settings = Settings { bias_walk: sensing::bias_walk(&calibration, &front_end), ..settings(arguments) };
    settings.check().into_diagnostic()?;
    session.start()?;
    session.ping()?;
    let tare = match &arguments.tare_file {
        Some(file) => super::calibrated::load_tare(file)?,
        None => {
            eprintln!("{}taring for {} s: keep the finger free", super::simulated_note(&session), arguments.tare);
            live::tare(&mut session, arguments.tare, &calibration, &settings, super::tell)?
        }
    };
    report_tare(&tare, calibration.unit().symbol());
    if let Some(file) = &arguments.keep_tare {
        super::calibrated::keep_tare(file, &tare)?;
    }
    let unit = calibration.unit().symbol();
    let mut finger = FingerSense::new(calibration, tare, &settings).into_diagnostic()?;
    show(&mut session, &mut finger, arguments, unit)
}

fn settings(arguments: &Arguments) -> Settings {
    Settings {
        // A finger turned counter-clockwise by the mounting angle feels everything turned clockwise by it.
        mounting_angle: -arguments.mounting_deg.to_radians(),
        contact_friction: arguments.mu_c,
        averaging: if arguments.average_ms > 0.0 {
            Averaging::Seconds(arguments.average_ms * 1e-3)
        } else {
            Averaging::Off
        },
        ..Settings::default()
    }
}

fn report_tare(tare: &Tare, unit: &str) {
    eprintln!(
        "tare ({:.4}, {:.4}) {unit} from {} samples; noise of one reading ({:.4}, {:.4}) {unit}",
        tare.bias.x,
        tare.bias.y,
        tare.samples,
        tare.sample_covariance[(0, 0)].sqrt(),
        tare.sample_covariance[(1, 1)].sqrt(),
    );
}

fn show(
    session: &mut Session,
    finger: &mut FingerSense,
    arguments: &Arguments,
    unit: &str,
) -> miette::Result<ExitCode> {
    let mut out = io::BufWriter::new(io::stdout().lock());
    let mut latency = Latency::default();
    let mut written = Ok(());
    let mut printing =
        Printing { period_s: (arguments.print_hz > 0.0).then(|| arguments.print_hz.recip()), next_s: None };
    let mut until_s = None;
    let ended = live::stream(
        session,
        |session, samples| {
            let simulated = session.is_simulated();
            for felt in finger.feel(samples) {
                if printing.is_due(&felt) {
                    let line = if arguments.json {
                        as_json(&felt, simulated, unix_time(session, felt.t))
                    } else {
                        as_line(&felt, unit, simulated)
                    };
                    written = writeln!(out, "{line}").and_then(|()| out.flush());
                }
            }
            latency.take(session, samples, Instant::now());
            let end_s = samples.device_time_s(samples.counts.len());
            let until_s = until_s.get_or_insert(arguments.seconds.map_or(f64::INFINITY, |seconds| end_s + seconds));
            written.is_ok() && end_s < *until_s
        },
        super::tell,
    );
    drop(out);
    match written {
        // Whoever read the lines has seen enough.
        Err(error) if error.kind() == io::ErrorKind::BrokenPipe => return Ok(ExitCode::SUCCESS),
        other => other.into_diagnostic()?,
    }
    ended.map_err(|error: LiveError| miette::Report::new(error))?;
    let counts = session.counts();
    eprintln!(
        "{} samples, {} missing, {} repeated, {} damaged frames",
        counts.samples, counts.missing, counts.repeated, counts.damaged_frames
    );
    if let Some(latency) = latency.in_words().filter(|_| arguments.latency) {
        eprintln!("{latency}");
    }
    Ok(ExitCode::SUCCESS)
}

/// Decides which readings are printed: those at which contact begins or ends, and otherwise some a second.
struct Printing {
    period_s: Option<f64>,
    next_s: Option<f64>,
}

impl Printing {
    fn is_due(&mut self, felt: &Felt) -> bool {
        let Some(period_s) = self.period_s else { return true };
        let due = self.next_s.is_none_or(|next_s| felt.t >= next_s);
        if due {
            self.next_s = Some(felt.t + period_s);
        }
        due || felt.event.is_some()
    }
}

/// A reading for a person.
fn as_line(felt: &Felt, unit: &str, simulated: bool) -> String {
    let mark = if simulated { "  [simulated]" } else { "" };
    match &felt.contact {
        Contact::None { sigmas, .. } => format!("{:10.4} s  no contact ({sigmas:.1} sigma){mark}", felt.t),
        Contact::Touching(touch) => {
            let friction = if touch.friction_half_angle > 0.0 {
                format!(" +/-{:.1} (friction)", touch.friction_half_angle.to_degrees())
            } else {
                String::new()
            };
            format!(
                "{:10.4} s  contact at {:8.2} deg, sd {:.2}{friction}, force {:.4} {unit}, sd {:.4}{mark}",
                felt.t,
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

/// A reading for a program: SI units and radians; `t` on the device's clock, `unix_time` on the host's.
fn as_json(felt: &Felt, simulated: bool, unix_time: Option<f64>) -> String {
    match &felt.contact {
        Contact::None { force_finger, sigmas } => serde_json::json!({
            "t": felt.t, "unix_time": unix_time, "contact": false, "sigmas": sigmas, "force": [force_finger.x, force_finger.y],
            "simulated": simulated,
        }),
        Contact::Touching(touch) => serde_json::json!({
            "t": felt.t, "unix_time": unix_time, "contact": true, "u": touch.u, "u_sd": touch.u_sd,
            "friction_half_angle": touch.friction_half_angle, "force": [touch.force_finger.x, touch.force_finger.y],
            "magnitude": touch.magnitude, "magnitude_sd": touch.magnitude_sd, "onset": touch.onset,
            "simulated": simulated,
        }),
    }
    .to_string()
}
