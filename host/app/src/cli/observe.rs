//! `palpate observe`.

use std::path::PathBuf;
use std::process::ExitCode;

use palpate::never;
use palpate::pushing::estimation::from_rest::readings::MotionClock;
use palpate::pushing::estimation::from_rest::watch::PushAnswer;
use palpate_files::part::PolygonFile;

use super::follow::Following;
use super::measured_motion::{self, MeasuredMotionArguments};
use super::observe_gho::{GhoArguments, GhoPush};
use super::observed_plot::{self, Heading};
use super::plot::PlotArguments;
use super::read::{read_beside, tell_part};
use super::watched_push::{Ongoing, Watched, WatchedPushArguments, Watching, too_short};
use super::{lacking, misfit, pose, positive};
use crate::recording::{self, Believed};

const LONG_HELP: &str = "\
The finger first rests, touching nothing or the part without force, while the tare is taken; then it begins to push. The
force that rises starts the clock of the motion.

The motion file is TOML; every length in it is in its `unit`:
  unit = \"mm\"              # m, cm, mm or in
  start = [0, 0]           # the disk's centre when it begins to move
                           # (optional): where poses count from
  [[segment]]              # one after the other
  seconds = 0.3
  acceleration = [150, 0]  # mm/s² along the finger's axes, those of the force;
                           # with --mounting-deg along the robot's

With --motion - segments are read from standard input as they come, one JSON object a line, in SI units:
  {\"seconds\": 0.3, \"acceleration\": [0.15, 0]}

Instead of a motion --path gives the disk's places as a robot measured them beside the forces, by a clock of its own: the
push is then looked at as a whole, up to 1.2 s of it, and what places and clock leave open is part of the uncertainty.

With --method gho the thesis's observers follow the contact angle, which is taken for the direction opposite to the force: for who
wants to see chapter 5 run. They give no uncertainty, and say what they assume.

With --method follow pose and motion are told at each reading: what explains the first readings is searched beside, and then
followed. A push that has told too little is said to be ambiguous until the finger turns aside.

The part file is that of `palpate push`; its mu_c is not needed. Its mu is taken for known to 20 % and found with the
rest; --mu-uncertainty says how well it is known, or that it is exact. A slow push tells only mu times the mass, and the
answer says so. What else is not known exactly the file may say: outline_sigma and centre_of_mass_sigma (one standard
deviation, in its unit) and support = \"unknown\"; then the answer is the less certain, and takes longer. --method follow
takes the part as it is told.

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

    /// How the push is observed
    #[arg(long, value_enum, default_value_t)]
    method: Method,

    #[command(flatten)]
    gho: GhoArguments,

    /// When the finger's motion began, on the clock of the forces: then it may be on its way when it meets the part, and
    /// mind another contact before [default: where force is first felt, finger and part being at rest in contact]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = super::finite, requires = "forces")]
    motion_begins: Option<f64>,

    /// How well that is known, one standard deviation
    #[arg(long, value_name = "MS", value_parser = super::not_negative, allow_negative_numbers = true)]
    #[arg(default_value_t = 1.0, requires = "motion_begins")]
    motion_begins_sigma_ms: f64,

    /// Print an estimate every so many seconds of the push [default: 0.1; each reading with --method follow --json]
    #[arg(long, value_name = "S", value_parser = positive)]
    every: Option<f64>,

    /// Print one JSON object a line: SI units, radians
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    plot: PlotArguments,
}

/// How a push is observed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
enum Method {
    /// All that was felt from rest until now explained at once: the pose, a few times a second
    #[default]
    Search,
    /// Followed from reading to reading, 125 times a second: pose, velocity and turning, through lost contacts too
    Follow,
    /// The thesis's own observers, after Gauthier, Hammouri and Othman, one an edge: by the contact angle alone, without
    /// uncertainty
    Gho,
}

/// Between two estimates that a person reads, s.
const EVERY_S: f64 = 0.1;

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    arguments.push.begin_recording()?;
    if arguments.gho.is_given() && arguments.method != Method::Gho {
        let help = "say --method gho, or leave --contact, --zeta, --correction-s, --edge and --initial-estimate out";
        return Err(miette::miette!(help = help, "the thesis's observers are told how to observe, and not asked for"));
    }
    let file = read_beside(&arguments.part, PolygonFile::parse_beside)?;
    tell_part(&arguments.part, file.part.polygon().vertices(), file.part.body(), &file.doubts());
    if let (Some(forces), Some(path)) = (&arguments.push.forces, arguments.measured.path()) {
        if arguments.method != Method::Search {
            let help = "leave --method out, or tell the motion with --motion";
            return Err(miette::miette!(help = help, "with --path a push is looked at as a whole"));
        }
        let push = measured_motion::observe(&file, forces, path, &arguments.measured, arguments.push.felt)?;
        if arguments.json {
            say!("{}", push.as_json());
        } else {
            push.print(&file);
        }
        arguments.plot.draw(|| Ok(push.figure(&file, arguments.title())))?;
        return Ok(ExitCode::SUCCESS);
    }
    let Some(motion) = &arguments.motion else {
        unreachable!("required unless there is a path, which requires forces")
    };
    let every_s = arguments.every.unwrap_or(EVERY_S);
    if arguments.method == Method::Follow {
        let every_s = if arguments.json { arguments.every.unwrap_or(0.0) } else { every_s };
        let sd = arguments.motion_begins_sigma_ms * 1e-3;
        let clock = arguments.motion_begins.map(|begins| MotionClock { begins, sd });
        let plot = arguments.plot.is_asked().then(|| arguments.title());
        let following = Following { file: &file, every_s, json: arguments.json, clock, plot };
        return following.run(&arguments.push, motion, &arguments.plot);
    }
    if arguments.method == Method::Gho {
        let every_s = if arguments.json { arguments.every.unwrap_or(0.0) } else { every_s };
        let push = GhoPush { file: &file, arguments: arguments.gho, every_s, json: arguments.json };
        return push.run(&arguments.push, motion, &arguments.plot, || arguments.title());
    }
    let mut shown = Shown { json: arguments.json, file: &file, is_headed: false };
    let watching = Watching { every_s, watched: Watched::Push };
    let mut push = arguments.push.watch(motion, watching, &mut |ongoing| {
        let Ongoing { watch, felt, motion, .. } = ongoing;
        if watch.is_due(motion)
            && let Some(answer) = watch.look(&felt.known(&file, motion), &never)
        {
            shown.print(&answer);
        }
        ongoing.until_over()
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
    arguments.plot.draw(|| {
        let words = pose::in_words(&file.part, &answer.estimate);
        let heading = Heading { title: arguments.title(), words };
        Ok(observed_plot::searched(&push.known(&file), &push.force()?, &answer.estimate, &heading))
    })?;
    Ok(lacking::status(&answer.since_onset))
}

impl Arguments {
    /// Of a picture: what was pushed, and what was felt of it.
    fn title(&self) -> String {
        let part = self.part.display();
        match &self.push.forces {
            Some(forces) => format!("{part}, pushed as in {}", forces.display()),
            None => format!("{part}, pushed"),
        }
    }
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
        recording::believed(0, estimate.time_end, estimate.hypotheses.iter().map(Believed::from));
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
