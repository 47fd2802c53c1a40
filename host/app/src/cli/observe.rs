//! `palpate observe`.

use std::path::PathBuf;
use std::process::ExitCode;

use palpate::never;
use palpate::pushing::estimation::from_rest::watch::PushAnswer;
use palpate_files::part::PolygonFile;

use super::measured_motion::{self, MeasuredMotionArguments};
use super::read::{read, tell_part};
use super::watched_push::{WatchedPushArguments, too_short};
use super::{lacking, misfit, pose, positive};
use crate::recording;

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

Instead of a motion --path gives the disk's places as a robot measured them beside the forces, by a clock of its own: the
push is then looked at as a whole, up to 1.2 s of it, and what places and clock leave open is part of the uncertainty.

The part file is that of `palpate push`; its mu_c is not needed. Its mu is taken for known to 20 % and found with the
rest; --mu-uncertainty says how well it is known, or that it is exact. A slow push tells only mu times the mass, and the
answer says so.

The forces' file is a table of t, Fx, Fy: force on the finger's disk along its axes, in newtons.

Finger and part start at rest here: that is what makes the force alone enough. For a push of which the beginning is not
known, or contact angles instead of forces, see the problem kind `observe_push` of `palpate solve`.

Exit status: 0, 1 if nothing was felt or something cannot be used, 3 if samples of the push were no measurements
(saturated, stuck, settling) or the device started anew, 64 wrong command line.";

/// Names the pose of a known part from the force on the finger that begins to push it.
///
/// Live from a device, or from a file of forces. Prints where the part may be, how certain that is, and what cannot be
/// told apart, as it changes; ends when the finger's motion does, or the contact.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The part file
    #[arg(long, value_name = "PART.toml")]
    part: PathBuf,

    #[command(flatten)]
    push: WatchedPushArguments,

    /// How the finger moves: a motion file as below, or - for segments from standard input
    #[arg(long, value_name = "MOTION.toml", required_unless_present = "path")]
    motion: Option<PathBuf>,

    #[command(flatten)]
    measured: MeasuredMotionArguments,

    /// Print an estimate every so many seconds of the push
    #[arg(long, value_name = "S", default_value_t = 0.1, value_parser = positive)]
    every: f64,

    /// Print one JSON object a line: SI units, radians
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    arguments.push.begin_recording()?;
    let file = read(&arguments.part, PolygonFile::parse)?;
    tell_part(&arguments.part, file.part.polygon().vertices(), file.part.body(), &file.doubts());
    if let (Some(forces), Some(path)) = (&arguments.push.forces, arguments.measured.path()) {
        let push = measured_motion::observe(&file, forces, path, &arguments.measured, arguments.push.felt)?;
        if arguments.json {
            say!("{}", push.as_json(&file, arguments.push.felt));
        } else {
            push.print(&file);
        }
        return Ok(ExitCode::SUCCESS);
    }
    let Some(motion) = &arguments.motion else {
        unreachable!("required unless there is a path, which requires forces")
    };
    let mut shown = Shown { json: arguments.json, file: &file, is_headed: false };
    let mut push = arguments.push.watch(motion, arguments.every, &mut |watch, felt, motion| {
        if let Some(answer) = watch.look(&felt.known(&file, motion), &never) {
            shown.print(&answer);
        }
    })?;
    push.was_felt()?;
    let answer = push.conclude(&file).ok_or_else(too_short)?;
    shown.print(&answer);
    if !arguments.json {
        say!("{}\n{}", pose::legend(), pose::in_words(&file.part, &answer.estimate));
        if answer.estimate.hypotheses.is_empty() {
            say!("{}", misfit::explain(&push.known(&file), &push.force()?));
        }
    }
    Ok(lacking::status(&answer.since_onset))
}

/// What was printed so far.
struct Shown<'a> {
    json: bool,
    file: &'a PolygonFile,
    is_headed: bool,
}

impl Shown<'_> {
    fn print(&mut self, answer: &PushAnswer) {
        let PushAnswer { estimate, since_onset } = answer;
        recording::believed(0, estimate);
        if self.json {
            let mut told = pose::as_json(estimate);
            told["samples"] = lacking::as_json(since_onset);
            say!("{told}");
            return;
        }
        self.head();
        pose::lines(&self.file.part, estimate).iter().for_each(|line| say!("{line}"));
    }

    fn head(&mut self) {
        if !self.is_headed {
            say!("{}", pose::headings());
        }
        self.is_headed = true;
    }
}
