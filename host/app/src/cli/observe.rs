//! `palpate observe`.

use std::io::{self, BufRead as _};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::finger::calibration::Calibration;
use palpate::finger::contact::Reading;
use palpate::finger::sense;
use palpate::pushing::estimation::Estimate;
use palpate::pushing::estimation::from_rest::onset::{PushSense, RestNoise};
use palpate::pushing::estimation::from_rest::{self, hann_windows};
use palpate::pushing::finger_motion::{FingerMotion, Segment};
use palpate_device::Session;
use palpate_files::motion::{self, MotionFileError};
use palpate_files::part::PolygonFile;

use super::calibrated::CalibrationArguments;
use super::device::DeviceArguments;
use super::read::read;
use super::recorded_push::{FeltPushArguments, not_at_rest, read_forces, tell_contacts};
use super::{pose, positive};
use crate::advice::Advise as _;
use crate::live;
use crate::live::interrupt;

/// Times since the onset at which the whole part is searched, s; in between only what was found then is followed. At
/// the end all is searched once more.
const SEARCHES_S: [f64; 3] = [0.1, 0.2, 0.4];

const LONG_HELP: &str = "\
The finger first rests, touching nothing or the part without force, while the tare is taken; then it begins to push. The
force that rises starts the clock of the motion.

The motion file is TOML; every length in it is in its `unit`:
  unit = \"mm\"              # m, cm, mm or in
  start = [0, 0]           # the disk's centre when it begins to move
                           # (optional): where poses count from
  [[segment]]              # one after the other
  seconds = 0.3
  acceleration = [150, 0]  # mm/s² along the finger's axes: those of the force

With --motion - segments are read from standard input as they come, one JSON object a line, in SI units:
  {\"seconds\": 0.3, \"acceleration\": [0.15, 0]}

The part file is that of `palpate push`; its mu_c is not needed. If its mu is a guess, say how good a one with
--mu-uncertainty: mu is then found with the rest. A slow push tells only mu times the mass, and the answer says so.

The forces' file is a table of t, Fx, Fy: force on the finger's disk along its axes, in newtons.

Finger and part start at rest here: that is what makes the force alone enough. For a push of which the beginning is not
known, or contact angles instead of forces, see the problem kind `observe_push` of `palpate solve`.

Exit status: 0, 1 if nothing was felt or something cannot be used, 64 wrong command line.";

/// Names the pose of a known part from the force on the finger that begins to push it.
///
/// Live from a device, or from a file of forces. Prints where the part may be, how certain that is, and what cannot be
/// told apart, as it changes; ends when the finger's motion does, or the contact.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// Forces on the finger from a file instead of a device: t, Fx, Fy, with the finger at rest at its beginning
    #[arg(value_name = "FORCES", conflicts_with_all = ["device", "baud", "calibration"])]
    forces: Option<PathBuf>,

    /// The part file
    #[arg(long, value_name = "PART.toml")]
    part: PathBuf,

    /// How the finger moves: a motion file, or - for segments from standard input
    #[arg(long, value_name = "MOTION.toml")]
    motion: PathBuf,

    #[command(flatten)]
    felt: FeltPushArguments,

    /// Print an estimate every so many seconds of the push
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = positive)]
    every: f64,

    /// Print one JSON object a line: SI units, radians
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let file = read(&arguments.part, PolygonFile::parse)?;
    let motion = MotionSource::open(&arguments.motion)?;
    let observer = Observer { arguments, file: &file, motion, last: None, next_s: 0.0 };
    match &arguments.forces {
        Some(path) => from_file(observer, path),
        None => from_device(observer),
    }
}

fn from_file(mut observer: Observer, path: &Path) -> miette::Result<ExitCode> {
    let named = || format!("cannot use the forces {}", path.display());
    let readings = read_forces(path)?;
    observer.motion.read_all()?;
    let Some(motion) = observer.motion.known() else { return Err(without_motion()) };
    let (mut sense, push) = observer.arguments.felt.sense(&readings, motion).wrap_err_with(named)?;
    for reading in push {
        sense.push(reading);
        if observer.look(&sense)?.is_break() {
            break;
        }
    }
    observer.finish(&sense)
}

fn from_device(mut observer: Observer) -> miette::Result<ExitCode> {
    interrupt::listen();
    let mut session = observer.arguments.device.open(true)?;
    let calibration = observer.arguments.calibration.require(&session)?;
    session.start().advised()?;
    let sense = watch(&mut observer, &mut session, &calibration);
    // Whatever ended it, nobody listens any more.
    let stopped = session.stop();
    let sense = sense?;
    stopped.advised()?;
    observer.finish(&sense)
}

/// Takes the tare, waits for the push and follows it to its end.
fn watch(observer: &mut Observer, session: &mut Session, calibration: &Calibration) -> miette::Result<PushSense> {
    let seconds = observer.arguments.felt.tare;
    note!("{}taring for {seconds} s: no force on the finger", super::simulated_note(session));
    let blocks = live::collect(session, seconds, super::tell).advised()?;
    let rest: Vec<Reading> = blocks.iter().flat_map(|samples| sense::readings(samples, calibration)).collect();
    let mut sense = PushSense::new(RestNoise::estimate(&rest).map_err(not_at_rest)?, Some(calibration));
    note!("ready: push");
    let mut failed = Ok(());
    live::stream(
        session,
        |_, samples| {
            sense::readings(samples, calibration).for_each(|reading| sense.push(&reading));
            match observer.look(&sense) {
                Ok(flow) => flow.is_continue(),
                Err(error) => {
                    failed = Err(error);
                    false
                }
            }
        },
        super::tell,
    )
    .advised()?;
    failed.map(|()| sense)
}

/// What goes on from look to look.
struct Observer<'a> {
    arguments: &'a Arguments,
    file: &'a PolygonFile,
    motion: MotionSource,
    last: Option<Estimate>,
    /// Time since the onset of the next estimate, s.
    next_s: f64,
}

impl Observer<'_> {
    /// Says what is known by now, if it is time to; breaks when nothing more is to come.
    fn look(&mut self, sense: &PushSense) -> miette::Result<std::ops::ControlFlow<()>> {
        use std::ops::ControlFlow::{Break, Continue};
        self.motion.take()?;
        let (Some(onset), Some(motion)) = (sense.onset_time(), self.motion.known()) else { return Ok(Continue(())) };
        let pushed = sense.now() - onset;
        if sense.is_over() || (self.motion.is_complete() && pushed >= motion.duration()) {
            return Ok(Break(()));
        }
        let over = hann_windows::count(pushed.min(motion.duration()));
        if over < from_rest::WINDOWS_MIN || hann_windows::end(over - 1) < self.next_s {
            return Ok(Continue(()));
        }
        self.next_s = hann_windows::end(over - 1) + self.arguments.every;
        self.estimate(sense, false);
        Ok(Continue(()))
    }

    fn estimate(&mut self, sense: &PushSense, at_end: bool) {
        let Some(motion) = self.motion.known() else { return };
        let Some(measured) =
            sense.windowed_force(motion.duration()).filter(|measured| measured.count() >= from_rest::WINDOWS_MIN)
        else {
            return;
        };
        let known = self.arguments.felt.known(self.file, motion);
        let now = hann_windows::end(measured.count() - 1);
        let estimate = match &self.last {
            Some(last) if !at_end && !search_is_due(last.time_end, now) => from_rest::follow(&known, &measured, last),
            _ => from_rest::estimate(&known, &measured),
        };
        self.print(&estimate);
        self.last = Some(estimate);
    }

    fn print(&self, estimate: &Estimate) {
        if self.arguments.json {
            say!("{}", pose::as_json(estimate));
            return;
        }
        if self.last.is_none() {
            say!("{}", pose::headings(estimate));
        }
        pose::lines(&self.file.part, estimate).iter().for_each(|line| say!("{line}"));
    }

    /// Prints what is known in the end.
    fn finish(mut self, sense: &PushSense) -> miette::Result<ExitCode> {
        if sense.onset_time().is_none() {
            return Err(miette::miette!(
                help = "the force must stand out of the noise by far: is the part too light, or did the finger not touch it?",
                "no push was felt"
            ));
        }
        let Some(duration) = self.motion.known().map(FingerMotion::duration) else { return Err(without_motion()) };
        tell_contacts(sense, duration);
        self.estimate(sense, true);
        match &self.last {
            Some(_) if self.arguments.json => {}
            Some(last) => say!("{}", pose::in_words(&self.file.part, last)),
            None => {
                return Err(miette::miette!(
                    help = "push for longer: a tenth of a second says little, half a second much",
                    "the push was too short to say anything"
                ));
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}

/// Where nobody said how the finger moves.
fn without_motion() -> miette::Report {
    miette::miette!(
        help = "write at least one segment, such as {{\"seconds\": 0.3, \"acceleration\": [0.15, 0]}}",
        "standard input told nothing of the finger's motion"
    )
}

/// Whether one of [`SEARCHES_S`] lies between two times.
fn search_is_due(before: f64, now: f64) -> bool {
    SEARCHES_S.iter().any(|&time| before < time && time <= now)
}

/// Where the finger's motion comes from.
enum MotionSource {
    Whole(FingerMotion),
    Streamed { lines: Receiver<Result<Segment, MotionFileError>>, motion: Option<FingerMotion>, open: bool },
}

impl MotionSource {
    fn open(path: &Path) -> miette::Result<Self> {
        if path != Path::new("-") {
            return Ok(Self::Whole(read(path, motion::parse)?));
        }
        let (sender, lines) = channel();
        let reader = move || {
            for (index, line) in io::stdin().lock().lines().enumerate() {
                let text = line.unwrap_or_else(|error| error.to_string());
                if text.trim().is_empty() {
                    continue;
                }
                let segment = serde_json::from_str(&text)
                    .map_err(|error| MotionFileError::Text(format!("line {}: {error}", index + 1)));
                if sender.send(segment).is_err() {
                    return;
                }
            }
        };
        std::thread::Builder::new().name("motion".to_owned()).spawn(reader).into_diagnostic()?;
        Ok(Self::Streamed { lines, motion: None, open: true })
    }

    /// Takes the segments that have come.
    fn take(&mut self) -> miette::Result<()> {
        let Self::Streamed { lines, motion, open } = self else { return Ok(()) };
        loop {
            match lines.try_recv() {
                Ok(segment) => add(motion, segment)?,
                Err(TryRecvError::Empty) => return Ok(()),
                Err(TryRecvError::Disconnected) => {
                    *open = false;
                    return Ok(());
                }
            }
        }
    }

    /// Waits for all segments: the forces are there already.
    fn read_all(&mut self) -> miette::Result<()> {
        let Self::Streamed { lines, motion, open } = self else { return Ok(()) };
        for segment in lines.iter() {
            add(motion, segment)?;
        }
        *open = false;
        Ok(())
    }

    fn known(&self) -> Option<&FingerMotion> {
        match self {
            Self::Whole(motion) => Some(motion),
            Self::Streamed { motion, .. } => motion.as_ref(),
        }
    }

    fn is_complete(&self) -> bool {
        !matches!(self, Self::Streamed { open: true, .. })
    }
}

fn add(motion: &mut Option<FingerMotion>, segment: Result<Segment, MotionFileError>) -> miette::Result<()> {
    let added = segment.and_then(|segment| match motion {
        Some(motion) => Ok(motion.append(segment)?),
        None => Ok(FingerMotion::new(Point2::origin(), &[segment]).map(|first| *motion = Some(first))?),
    });
    added.into_diagnostic().wrap_err("cannot use the finger's motion on standard input")
}
