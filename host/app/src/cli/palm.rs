//! `palpate palm`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueEnum;
use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::{Quaternion, Vector2};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::rolling::{
    BodyKnowledge, Noise, PalmKnowledge, Report, RollEstimate, RollQuestion, RollState, RollTracker, RollVerdict, Spin,
    Tracked,
};
use palpate_device::Address;
use palpate_files::body::BodyFile;
use palpate_files::solve::kinds::roll::{self, wxyz};
use serde::Deserialize;
use serde_json::{Value, json};

use super::palm_motion::{self, PalmMotion, PalmMotionArguments};
use super::read::{lines_of_stdin, read};
use super::{counted, positive};
use crate::live::interrupt;
use crate::recording;

const LONG_HELP: &str = "\
Reads a contact a line from standard input, at equal steps of time, in s and m:
  {\"t\": 0.002, \"u\": [0.0112, -0.0034]}
and prints what is known after it, a JSON object a line:
  status              collecting: too short a stretch yet
                      undecided: several or no hypotheses explain it
                      found: one does
                      tracking: a filter follows the body
                      lost: contacts and filter disagree; it collects anew
  orientation         quaternion [w, x, y, z], body to palm
  omega               angular velocity, body axes, rad/s
  u                   the contact, m
  attitude_sigma_deg  standard deviation of the attitude, degrees
  omega_sigma         standard deviation of the angular velocity, rad/s

Attitudes are known up to the body's symmetry. With several body files, `body` says which it is, from 0.

Lines that cannot be used are named on standard error and passed over.

With --record the contacts are kept as they come, and what is made of them; -d file:RUN.mcap takes them from there.

Exit status: 0 at the end of the input, 1 if a file or the input cannot be read, 2 if lines were passed over, 64 wrong
command line.";

/// Exit status when some lines could not be used.
const EXIT_SOME_BAD: u8 = 2;

/// Feels, live, where a body rolling on the palm is and how it moves, from its contacts alone.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(&format!("{}\n{LONG_HELP}", palm_motion::FILE_HELP)))]
pub(crate) struct Arguments {
    /// The body file; several if it may be one of them
    #[arg(value_name = "BODY.toml", required = true)]
    bodies: Vec<PathBuf>,
    /// Pitch of the tactile grid that the contacts are rounded to
    #[arg(long, value_name = "MM", value_parser = positive, conflicts_with = "sigma_mm")]
    grid_mm: Option<f64>,
    /// Standard deviation of a contact's coordinate, where it is no grid
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 0.3)]
    sigma_mm: f64,
    /// Whether the contact lets the body spin about the palm's normal
    #[arg(long, value_enum, default_value_t = SpinChoice::Unknown)]
    spin: SpinChoice,
    #[command(flatten)]
    palm: PalmMotionArguments,
    /// The palm is tilted or accelerates steadily, nobody knows how
    #[arg(long, conflicts_with_all = ["palm_m_s2", "palm"])]
    unknown_tilt: bool,
    /// Time to collect before the first answer
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 0.4)]
    window_s: f64,
    /// Print only changes of the status and every N-th contact
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), default_value_t = 1)]
    every: u64,
    /// Take the contacts of a recording, file:RUN.mcap [default: those of standard input]
    #[arg(long, short = 'd', value_name = "DEVICE", value_parser = recorded_run, help_heading = "Recording")]
    device: Option<PathBuf>,
    /// Play a recording so many times as fast as it was recorded [default: as fast as it is read]
    #[arg(long, value_name = "TIMES", value_parser = positive, requires = "device", help_heading = "Recording")]
    speed: Option<f64>,
    /// Keep all contacts in this file, which must not exist: MCAP, to be played with -d file:FILE
    #[arg(long, value_name = "FILE", help_heading = "Recording")]
    record: Option<PathBuf>,
}

/// The file of a recording's address.
fn recorded_run(text: &str) -> Result<PathBuf, String> {
    match text.parse() {
        Ok(Address::Recording(path)) => Ok(path.into()),
        _ => Err("contacts come from standard input, or from a recording: file:RUN.mcap".to_owned()),
    }
}

/// What contacts are called in a recording.
const CONTACTS: &str = "palm";

/// Lines with their numbers; what cannot be read of one is no contact.
type Lines = Box<dyn Iterator<Item = miette::Result<(u64, Result<String, String>)>>>;

/// The lines of standard input.
fn told_now() -> Lines {
    let lines = lines_of_stdin().map(|line| {
        let (number, line) = line.into_diagnostic().wrap_err("cannot read standard input")?;
        Ok((number, line.map_err(|why| why.to_string())))
    });
    Box::new(lines)
}

/// The lines that a recorded run was told.
fn told_before(run: &Path, speed: Option<f64>) -> miette::Result<Lines> {
    let lines = recording::play::inputs(run, CONTACTS, speed)?.flatten();
    Ok(Box::new((1..).zip(lines).map(|(number, line)| Ok((number, Ok(line))))))
}

/// What the contact transmits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum SpinChoice {
    /// To be found
    Unknown,
    /// A point contact: no torque
    Free,
    /// A torque that keeps the spin at 0
    #[value(name = "none")]
    NoSpin,
}

/// A line of input.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object with t and u")]
struct Contact {
    /// Time of the contact, s.
    t: f64,
    /// Where the body touches, palm axes, m.
    u: [f64; 2],
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    if let Some(file) = &arguments.record {
        interrupt::listen();
        recording::begin(file, false)?;
    }
    let palm = arguments.palm.read()?;
    let mut tracker = RollTracker::new(arguments.question(&palm)?, arguments.window_s);
    let (mut before, mut last) = (String::new(), None);
    let mut passed_over = 0_u64;
    let lines = match &arguments.device {
        Some(run) => told_before(run, arguments.speed)?,
        None => told_now(),
    };
    for line in lines.take_while(|_| !interrupt::requested()) {
        let (index, line) = line?;
        // A line that is no text has its place in a recording, as one that is no contact.
        recording::note_input(CONTACTS, Some(line.as_deref().unwrap_or(NO_TEXT)));
        let contact = match line {
            Ok(text) if text.trim().is_empty() => continue,
            Ok(text) => contact(&text, last),
            Err(why) => Err(why),
        };
        let Contact { t, u } = match contact {
            Ok(contact) => contact,
            Err(why) => {
                tracing::warn!("line {index} is passed over: {why}");
                passed_over += 1;
                continue;
            }
        };
        if last.is_none_or(|last| !palm.is_beyond(last)) && palm.is_beyond(t) {
            palm.tell_beyond(t);
        }
        last = Some(t);
        let report = tracker.feel(t, Vector2::from(u));
        recording::rolled(Vector2::from(u), attitude(&report));
        let (status, answer) = in_json(&report);
        if status != before || index % arguments.every == 0 {
            let mut object = json!({"t": t, "status": status});
            if let (Some(object), Value::Object(answer)) = (object.as_object_mut(), answer) {
                object.extend(answer);
            }
            say!("{object}");
        }
        status.clone_into(&mut before);
    }
    recording::note_input(CONTACTS, None);
    if passed_over > 0 {
        tracing::warn!("{} passed over", counted(usize::try_from(passed_over).unwrap_or(usize::MAX), "line"));
        return Ok(ExitCode::from(EXIT_SOME_BAD));
    }
    Ok(ExitCode::SUCCESS)
}

/// Stands in a recording for a line that is no text.
const NO_TEXT: &str = "\u{fffd}";

/// How the body is turned, if that is known.
fn attitude(report: &Report) -> Option<Quaternion<f64>> {
    match report {
        Report::Found(estimate) => Some(estimate.hypotheses.first()?.end.orientation),
        Report::Tracking(tracked) => Some(tracked.state.orientation),
        Report::Collecting { .. } | Report::Undecided(_) | Report::Lost => None,
    }
}

/// The contact of a line, felt after the last one; or why it is none.
fn contact(text: &str, last: Option<f64>) -> Result<Contact, String> {
    let contact: Contact = serde_json::from_str(text)
        .map_err(|error| format!("{error}; write {{\"t\": 0.002, \"u\": [x, y]}}, in s and m"))?;
    match last {
        Some(last) if contact.t <= last => {
            Err(format!("the contact at {} s does not come after the one before, at {last} s", contact.t))
        }
        _ => Ok(contact),
    }
}

impl Arguments {
    fn question(&self, palm: &PalmMotion) -> miette::Result<RollQuestion> {
        let bodies = self
            .bodies
            .iter()
            .map(|path| read(path, BodyFile::parse).map(|file| file.body))
            .collect::<miette::Result<_>>()?;
        Ok(RollQuestion {
            body: BodyKnowledge::OneOf(bodies),
            spins: match self.spin {
                SpinChoice::Unknown => vec![Spin::Free, Spin::NoSpin],
                SpinChoice::Free => vec![Spin::Free],
                SpinChoice::NoSpin => vec![Spin::NoSpin],
            },
            palm: match self.unknown_tilt {
                true => PalmKnowledge::Constant,
                false => PalmKnowledge::Known(palm.acceleration.clone()),
            },
            g: GRAVITY_ASSUMED,
            noise: match self.grid_mm {
                Some(pitch) => Noise::Grid(pitch * 1e-3),
                None => Noise::Gauss(self.sigma_mm * 1e-3),
            },
        })
    }
}

/// A report's status and its further fields.
fn in_json(report: &Report) -> (&'static str, Value) {
    match report {
        Report::Collecting { seconds } => ("collecting", json!({"seconds": seconds})),
        Report::Undecided(estimate) => ("undecided", undecided(estimate)),
        Report::Found(estimate) => ("found", found(estimate)),
        Report::Tracking(tracked) => ("tracking", tracking(tracked)),
        Report::Lost => ("lost", json!({})),
    }
}

fn motion(state: &RollState) -> Value {
    let (omega, u): ([f64; 3], [f64; 2]) = (state.omega.into(), state.u.into());
    json!({"orientation": wxyz(&state.orientation), "omega": omega, "u": u})
}

fn undecided(estimate: &RollEstimate) -> Value {
    let why = if estimate.verdict == RollVerdict::Unexplained { "nothing explains the contacts" } else { "several do" };
    let list: Vec<Value> = estimate.hypotheses.iter().map(|hypothesis| motion(&hypothesis.end)).collect();
    json!({"why": why, "cost": finite_or_null(estimate.cost), "cost_max": estimate.cost_max, "hypotheses": list})
}

fn found(estimate: &RollEstimate) -> Value {
    let Some(best) = estimate.hypotheses.first() else { return json!({}) };
    let mut object = motion(&best.end);
    if let Some(object) = object.as_object_mut() {
        object.insert("body".to_owned(), json!(best.body));
        object.insert("spin".to_owned(), json!(roll::Spin::from(best.spin)));
        object.insert("symmetry".to_owned(), json!(best.symmetry.name()));
        object.insert("certified".to_owned(), json!(estimate.certified));
        if let Some(acceleration) = best.palm_acceleration {
            object.insert("palm_acceleration".to_owned(), json!([acceleration.x, acceleration.y, acceleration.z]));
        }
    }
    object
}

fn tracking(tracked: &Tracked) -> Value {
    let mut object = motion(&tracked.state);
    if let Some(object) = object.as_object_mut() {
        object.insert("attitude_sigma_deg".to_owned(), json!(tracked.attitude_sigma.to_degrees()));
        object.insert("omega_sigma".to_owned(), json!(tracked.omega_sigma));
    }
    object
}

fn finite_or_null(value: f64) -> Option<f64> {
    Some(value).filter(|value| value.is_finite())
}
