//! `palpate roll`.

use std::f64;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueEnum;
use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::{UnitQuaternion, Vector3};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::rolling::{OnPalm, PalmAcceleration, Roll, RollEndReason, RollRun, RollSample, Spin};
use palpate_files::body::BodyFile;
use palpate_files::solve::kinds::roll::{RollAnswer, wxyz};

use super::palm_motion::{self, PalmMotionArguments};
use super::plot::PlotArguments;
use super::read::read;
use super::{equal_steps, finite, not_negative, positive};
use crate::pictures::plot::Figure;
use crate::pictures::roll::{RollPicture, SAMPLES};

/// Most rows of the table.
const ROWS_MAX: i64 = 100_000;

const LONG_HELP: &str = "\
The body file is TOML; every length in it is in its `unit`:
  unit = \"mm\"                       # m, cm, mm or in
  shape = \"ellipsoid\"               # or egg (with e and zc), rounded (with r)
  semi_axes = [20, 30, 40]
  radii_of_gyration = [22, 20, 15]  # egg, rounded: about the three axes
                                    # (optional: else uniform density)

Palm axes: x and y in the palm, z up. The body's axes start along the palm's and are then turned by --attitude-deg. It
stands on its contact, which starts at the palm's origin and never slips; how much friction that takes is printed.

What can be felt of a roll:
  palpate roll BODY --contacts-hz 500 --grid-mm 1 |
    palpate palm BODY --grid-mm 1

Exit status: 0, 1 if the roll is impossible or a file cannot be read or written, 64 wrong command line.";

/// Simulates how a smooth body rolls on a palm that may accelerate.
///
/// Prints where the contact goes, how high the body is and how hard it presses, up to when it would lift off or the
/// time is up.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(&format!("{}\n{LONG_HELP}", palm_motion::FILE_HELP)))]
pub(crate) struct Arguments {
    /// The body file
    #[arg(value_name = "BODY.toml")]
    body: PathBuf,
    /// Attitude at the start: turns about the palm's x, then y, then z
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    attitude_deg: [f64; 3],
    /// Angular velocity at the start about the palm's axes; the third is spin
    #[arg(long, value_name = "X,Y,Z", value_parser = triple, default_value = "0,0,0", allow_hyphen_values = true)]
    turning_deg_s: [f64; 3],
    /// Whether the contact lets the body spin about the palm's normal
    #[arg(long, value_enum, default_value_t = SpinChoice::Free)]
    spin: SpinChoice,
    #[command(flatten)]
    palm: PalmMotionArguments,
    /// How long to roll
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 1.0)]
    time_s: f64,
    /// Rows of the table after the first
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=ROWS_MAX), default_value_t = 10)]
    rows: u32,
    /// Print one JSON object as `palpate solve` does for the problem `roll`
    #[arg(long, conflicts_with = "contacts_hz")]
    json: bool,
    /// Print the contacts alone, so many a second, a JSON object a line: what `palpate palm` reads
    #[arg(long, value_name = "HZ", value_parser = positive)]
    contacts_hz: Option<f64>,
    /// Round the contacts to a tactile grid of this pitch
    #[arg(long, value_name = "MM", value_parser = not_negative, default_value_t = 0.0, requires = "contacts_hz")]
    grid_mm: f64,
    #[command(flatten)]
    plot: PlotArguments,
}

/// What the contact transmits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SpinChoice {
    /// A point contact: no torque
    Free,
    /// A torque that keeps the spin at 0
    #[value(name = "none")]
    NoSpin,
}

/// Three finite numbers with commas between.
pub(crate) fn triple(text: &str) -> Result<[f64; 3], String> {
    let numbers = text.split(',').map(|part| finite(part.trim())).collect::<Result<Vec<_>, _>>()?;
    <[f64; 3]>::try_from(numbers).map_err(|all| format!("{} numbers, it must be three: X,Y,Z", all.len()))
}

/// Most contacts printed: a hundred seconds at 10 kHz.
const CONTACTS_MAX: f64 = 1e6;

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let file = read(&arguments.body, BodyFile::parse)?;
    let palm = arguments.palm.read()?;
    let roll = arguments.roll(&file, &palm.acceleration)?;
    let go = |end: f64, steps: f64| {
        let cannot = || format!("cannot roll {}", arguments.body.display());
        roll.run(&equal_steps(end, steps)).into_diagnostic().wrap_err_with(cannot)
    };
    let steps =
        arguments.contacts_hz.map_or(f64::from(arguments.rows), |rate| (rate * arguments.time_s).floor().max(1.0));
    if steps > CONTACTS_MAX {
        let help = "lower --contacts-hz or --time-s";
        return Err(miette::miette!(help = help, "{steps:e} contacts are too many: at most {CONTACTS_MAX:e}"));
    }
    let end = arguments.contacts_hz.map_or(arguments.time_s, |rate| steps / rate);
    let run = go(end, steps)?;
    palm.tell_beyond(run.end.t);
    arguments
        .plot
        .draw(|| Ok(arguments.figure(&file, &RollRun { end: run.end, ..go(run.end.t, f64::from(SAMPLES))? })))?;
    if arguments.contacts_hz.is_some() {
        arguments.print_contacts(&run);
    } else if arguments.json {
        say!("{}", serde_json::to_string(&RollAnswer::from(&run)).into_diagnostic()?);
    } else {
        print_table(&run);
    }
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn roll<'a>(&self, file: &'a BodyFile, palm: &'a PalmAcceleration) -> miette::Result<Roll<'a>> {
        let about = |axis: usize| {
            UnitQuaternion::from_axis_angle(&Vector3::ith_axis(axis), self.attitude_deg[axis].to_radians())
        };
        let attitude = about(2) * about(1) * about(0);
        let omega = attitude.inverse() * Vector3::from(self.turning_deg_s.map(f64::to_radians));
        let spin = match self.spin {
            SpinChoice::Free => Spin::Free,
            SpinChoice::NoSpin => Spin::NoSpin,
        };
        let on = OnPalm { body: &file.body, spin, palm, g: GRAVITY_ASSUMED };
        let cannot = || format!("cannot put {} on the palm", self.body.display());
        Roll::new(on, wxyz(&attitude), omega.into(), [0.0; 2]).into_diagnostic().wrap_err_with(cannot)
    }

    fn figure(&self, file: &BodyFile, run: &RollRun) -> Figure {
        let name = self.body.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let spin = if self.spin == SpinChoice::Free { "free to spin" } else { "no spin" };
        let palm = self.palm.in_words();
        let subtitles = [format!("{spin}; palm {palm}"), end_in_words(run)];
        let title = format!("Rolling {name}");
        RollPicture { body: &file.body, run, g: GRAVITY_ASSUMED, title: &title, subtitles: &subtitles }.figure()
    }

    fn print_contacts(&self, run: &RollRun) {
        let pitch = self.grid_mm * 1e-3;
        let sensed = |x: f64| if pitch > 0.0 { (x / pitch).round() * pitch } else { x };
        for RollSample { t, state, .. } in &run.samples {
            let [x, y] = [sensed(state.u.x), sensed(state.u.y)];
            say!("{}", serde_json::json!({"t": t, "u": [x, y]}));
        }
    }
}

fn print_table(run: &RollRun) {
    say!("   time   contact         height  turning about        force / weight");
    say!("    [s]   x [mm]   y [mm]   [mm]  x, y, up [°/s]            up    along");
    let before_end = run.samples.iter().filter(|sample| sample.t < run.end.t);
    for sample in before_end.chain([&run.last]) {
        print_row(sample);
    }
    say!("{}", end_in_words(run));
}

fn print_row(sample: &RollSample) {
    let attitude = sample.state.attitude();
    let turning = (attitude * sample.state.omega).map(f64::to_degrees);
    let force = sample.contact_force / GRAVITY_ASSUMED;
    say!(
        "{:>7.4} {:>8} {:>8} {:>6} {:>6} {:>6} {:>6} {:>8} {:>8}",
        sample.t,
        fixed(sample.state.u.x * 1e3, 2),
        fixed(sample.state.u.y * 1e3, 2),
        fixed(-(attitude * sample.contact_body).z * 1e3, 2),
        fixed(turning.x, 0),
        fixed(turning.y, 0),
        fixed(turning.z, 0),
        fixed(force.z, 3),
        fixed(force.xy().norm(), 3)
    );
}

/// A number with so many decimals, and no minus sign before a zero.
pub(crate) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| c == '0' || c == '.') => zero.to_owned(),
        _ => text,
    }
}

fn end_in_words(run: &RollRun) -> String {
    let why = match run.end.reason {
        RollEndReason::Time => "the time was up",
        RollEndReason::LiftOff => "the body lifts off: the contact would have to pull",
    };
    let friction = run.friction_needed;
    let needs =
        if friction.is_finite() { format!("; it takes µ ≥ {friction:.2} not to slip") } else { String::new() };
    format!("ended after {:.4} s: {why}{needs}", run.end.t)
}
