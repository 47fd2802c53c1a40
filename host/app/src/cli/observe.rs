//! `palpate observe`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use palpate::pushing::estimation::from_rest::KnownFromRest;
use palpate::pushing::estimation::from_rest::readings::MotionClock;
use palpate::pushing::estimation::from_rest::watch::PushAnswer;
use palpate_files::part::PolygonFile;

use super::follow::{Following, MotionBegins};
use super::measured_motion::{self, MeasuredMotionArguments};
use super::motion_source::AskedMotion;
use super::observe_gho::{GhoArguments, GhoPush};
use super::observe_slow::{self, SlowArguments, SlowObserving};
use super::observed_plot::{self, Heading};
use super::plot::PlotArguments;
use super::read::{read, read_beside, tell_part};
use super::switches::BOARD_INPUTS;
use super::watched_push::{Ongoing, Watched, WatchedPushArguments, Watching, too_short};
use super::{lacking, misfit, pose, positive};
use crate::recording::{self, Believed, Seen};
use crate::threads::PATIENT;

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
  rise_seconds = 0.02      # how long it takes from the one before (optional: 0)

With --motion - segments are read from standard input as they come, one JSON object a line, in SI units:
  {\"seconds\": 0.3, \"acceleration\": [0.15, 0]}

Instead of a motion --path gives the disk's places as a robot measured them beside the forces, by a clock of its own: the
push is then looked at as a whole, up to 1.2 s of it, and what places and clock leave open is part of the uncertainty. With
--method follow places may come while they are measured (--path - for rows from standard input, as in the file): what the
finger did is then told a tenth of a second later.

With --method gho the thesis's observers follow the contact angle, which is taken for the direction opposite to the force: for who
wants to see chapter 5 run. They give no uncertainty, and say what they assume.

With --method follow pose and motion are told at each reading: what explains the first readings is searched beside, and then
followed. A push that has told too little is said to be ambiguous until the finger turns aside.

With --method slow nothing rests on inertia: where the finger first met the part, and with caution the direction and size of
the force, move and weigh a cloud of poses through the mechanics of slow pushing (`palpate push --quasi-static`). Friction
is not what it was a millimetre ago, and this knows it; so one push tells little, and a chain of them much: --next adds
pushes that came after, --belief keeps what is believed from one run to the next. --near tells where the part is about;
without it, it may be anywhere on the table. Each push goes straight on. Recordings are a file of forces and --path, such
as `palpate import` writes; live, the finger moves by --motion from rest in contact. Unless --method says how, a push is
slow where friction would stop the part within 0.02 mm.

The part file is that of `palpate push`; its mu_c is not needed. Its mu is taken for known to 20 % and found with the
rest; --mu-uncertainty says how well it is known, or that it is exact. A slow push tells only mu times the mass, and the
answer says so. What else is not known exactly the file may say: outline_sigma and centre_of_mass_sigma (one standard
deviation, in its unit) and support = \"unknown\"; then the answer is the less certain, and takes longer. --method follow
takes the part as it is told.

An elliptic part is found too, and by an elliptic finger (--semi-axes-mm); --method follow and gho know edges and disks only. A
disk's angle nobody can feel: it is told as anything.

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

    /// How the finger moves: a motion file as below, or - for segments from standard input
    #[arg(long, value_name = "MOTION.toml", required_unless_present = "path")]
    motion: Option<PathBuf>,

    #[command(flatten)]
    measured: MeasuredMotionArguments,

    /// How the push is observed [default: slow where the finger goes slowly, search otherwise]
    #[arg(long, value_enum)]
    method: Option<Method>,

    /// When the finger's motion began: S on the clock of a file of forces, or live input:N, where the board's digital input N
    /// (0 to 7) changes after the tare, as by a robot's "moving" line. Then the finger may be on its way when it meets the
    /// part, and mind another contact before; with --method follow [default: where force is first felt, finger and part
    /// being at rest in contact]
    #[arg(long, value_name = "S|input:N", allow_negative_numbers = true, value_parser = BeginsArgument::parse)]
    motion_begins: Option<BeginsArgument>,

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

    #[command(flatten)]
    push: WatchedPushArguments,

    #[command(flatten)]
    gho: GhoArguments,

    #[command(flatten)]
    slow: SlowArguments,
}

/// What tells that the finger's motion begins.
#[derive(Clone, Copy, Debug, PartialEq)]
enum BeginsArgument {
    /// On the clock of the forces, s.
    At(f64),
    /// A digital input of the board.
    Input(usize),
}

impl BeginsArgument {
    fn parse(text: &str) -> Result<Self, String> {
        let Some(input) = text.strip_prefix("input:") else { return super::finite(text).map(Self::At) };
        let input = input.parse().ok().filter(|input| *input < BOARD_INPUTS);
        input.map(Self::Input).ok_or_else(|| format!("a board has inputs 0 to {}, as in input:0", BOARD_INPUTS - 1))
    }
}

/// How a push is observed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Method {
    /// All that was felt from rest until now explained at once: the pose, a few times a second
    Search,
    /// Pushes at some mm/s, one after another: the pose after each, from where the finger first met the part and what it felt
    Slow,
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
    let asked = arguments.method;
    if arguments.gho.is_given() && asked != Some(Method::Gho) {
        let help = "say --method gho, or leave --contact, --zeta, --correction-s, --edge and --initial-estimate out";
        return Err(miette::miette!(help = help, "the thesis's observers are told how to observe, and not asked for"));
    }
    let file = read_beside(&arguments.part, PolygonFile::parse_curved_beside)?;
    tell_part(&arguments.part, file.part.polygon().vertices(), file.part.body(), &file.doubts());
    let method = match asked {
        Some(method) => method,
        None => arguments.chosen(&file)?,
    };
    let file = if method == Method::Search {
        file
    } else {
        arguments.push.felt.check_disk()?;
        read_beside(&arguments.part, PolygonFile::parse_beside)?
    };
    if arguments.motion_begins.is_some() && method != Method::Follow {
        let help = "say --method follow, or leave --motion-begins out";
        return Err(miette::miette!(help = help, "a finger that is on its way when it meets the part is followed"));
    }
    if arguments.slow.is_given() && method != Method::Slow {
        let help = "say --method slow, or leave --near, --near-within, --next, --belief, --mass-g, --height-mm, --beyond-mm and --seed out";
        return Err(miette::miette!(help = help, "slow pushes are told about, and not asked for"));
    }
    if method == Method::Slow {
        let measured = arguments.push.forces.as_deref().zip(arguments.measured.path());
        let plot = arguments.plot.is_asked().then(|| arguments.title());
        let observing = SlowObserving { file: &file, json: arguments.json, slow: &arguments.slow, plot };
        return match (measured, &arguments.motion) {
            (Some(first), _) => observing.recorded(first, &arguments.push.tables, arguments.push.felt, &arguments.plot),
            (None, Some(motion)) => observing.watched(&arguments.push, motion, &arguments.plot),
            (None, None) => Err(without_forces()),
        };
    }
    let every_s = arguments.every.unwrap_or(EVERY_S);
    if method == Method::Follow {
        let every_s = if arguments.json { arguments.every.unwrap_or(0.0) } else { every_s };
        let begins = arguments.begins()?;
        let plot = arguments.plot.is_asked().then(|| arguments.title());
        let following = Following { file: &file, every_s, json: arguments.json, begins, plot };
        let told = arguments.motion.as_deref().map(AskedMotion::Told);
        let Some(motion) = told.or(arguments.measured.asked()) else {
            unreachable!("a motion is required unless there is a path")
        };
        return following.run(&arguments.push, motion, &arguments.plot);
    }
    if let (Some(forces), Some(path)) = (&arguments.push.forces, arguments.measured.path()) {
        if method != Method::Search {
            let help = "leave --method out, or say --method follow, or tell the motion with --motion";
            return Err(miette::miette!(help = help, "the thesis's observers do not know measured places"));
        }
        let WatchedPushArguments { tables, felt, .. } = &arguments.push;
        let push = measured_motion::observe(&file, forces, path, &arguments.measured, tables, *felt)?;
        if arguments.json {
            say!("{}", push.as_json());
        } else {
            push.print(&file);
        }
        arguments.plot.draw(|| Ok(push.figure(&file, arguments.title())))?;
        return Ok(ExitCode::SUCCESS);
    }
    let Some(motion) = &arguments.motion else { return Err(without_forces()) };
    if method == Method::Gho {
        let every_s = if arguments.json { arguments.every.unwrap_or(0.0) } else { every_s };
        let push = GhoPush { file: &file, arguments: arguments.gho, every_s, json: arguments.json };
        return push.run(&arguments.push, motion, &arguments.plot, || arguments.title());
    }
    let mut shown = Shown { json: arguments.json, file: &file, is_headed: false };
    let watching = Watching { every_s, watched: Watched::Push };
    let mut push = arguments.push.watch(AskedMotion::Told(motion), watching, &mut |ongoing| {
        let Ongoing { watch, felt, motion, .. } = ongoing;
        if watch.is_due(motion)
            && let Some(answer) = watch.look(&felt.known(&file, motion), &PATIENT)
        {
            shown.print(&answer, &felt.known(&file, motion));
        }
        ongoing.until_over()
    })?;
    push.was_felt()?;
    let answer = push.conclude(&file).ok_or_else(too_short)?;
    shown.print(&answer, &push.known(&file));
    if !arguments.json {
        say!("{}\n{}", pose::legend(&file.part), pose::in_words(&file.part, &answer.estimate));
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
    /// Whether the finger's motion comes through standard input, which may be a person's keyboard.
    pub(super) fn reads_keyboard(&self) -> bool {
        [self.motion.as_deref(), self.measured.path()].contains(&Some(Path::new("-")))
    }

    /// When the motion begins of a push that is followed.
    fn begins(&self) -> miette::Result<MotionBegins> {
        let sd = self.motion_begins_sigma_ms * 1e-3;
        match (self.motion_begins, &self.push.forces) {
            (None, _) => Ok(self.measured.begins().unwrap_or(MotionBegins::Felt)),
            (Some(_), _) if self.measured.begins().is_some() => Err(miette::miette!(
                help = "say one of them",
                "--path-clock-s and --clock-offset-ms tell when the motion began, and so does --motion-begins"
            )),
            (Some(BeginsArgument::At(begins)), Some(_)) => Ok(MotionBegins::At(MotionClock { begins, sd })),
            (Some(BeginsArgument::Input(input)), None) => Ok(MotionBegins::Input { input, sd }),
            (Some(BeginsArgument::At(_)), None) => Err(miette::miette!(
                help =
                    "let the robot raise a line on one of the board's digital inputs, and say --motion-begins input:N",
                "a live finger's clock begins when its board does: nobody knows then when a motion will begin"
            )),
            (Some(BeginsArgument::Input(_)), Some(_)) => Err(miette::miette!(
                help = "say --motion-begins S, on the clock of the forces",
                "a file of forces has no inputs"
            )),
        }
    }

    /// The method for a finger that goes as fast as this one, told with its reason.
    fn chosen(&self, file: &PolygonFile) -> miette::Result<Method> {
        let fastest = match (self.measured.path(), &self.motion) {
            (Some(_), _) if self.push.forces.is_none() => return Ok(Method::Search),
            (Some(path), _) => match observe_slow::fastest_measured(&self.push.tables.places(path)?) {
                Some(fastest) => fastest,
                None => return Ok(Method::Search),
            },
            (None, Some(motion)) if motion.as_path() != std::path::Path::new("-") => {
                observe_slow::fastest_told(&read(motion, palpate_files::motion::parse)?)
            }
            // What is still to be told may be anything.
            _ => return Ok(Method::Search),
        };
        let stops = observe_slow::stopping_distance(fastest, file.mu);
        let is_slow = stops <= observe_slow::SLOW_STOP_M;
        note!(
            "{} (the finger goes at {:.1} mm/s at most, and friction stops the part within {:.3} mm: {}; --method says otherwise)",
            if is_slow { "observed as a slow push" } else { "observed as a push with inertia" },
            fastest * 1e3,
            stops * 1e3,
            if is_slow { "nothing is felt of inertia" } else { "its inertia is felt" }
        );
        Ok(if is_slow { Method::Slow } else { Method::Search })
    }

    /// Of a picture: what was pushed, and what was felt of it.
    fn title(&self) -> String {
        let part = self.part.display();
        match &self.push.forces {
            Some(forces) => format!("{part}, pushed as in {}", forces.display()),
            None => format!("{part}, pushed"),
        }
    }
}

/// Where measured places have no file of forces beside them.
fn without_forces() -> miette::Report {
    miette::miette!(
        help = "name a file of forces, or say --method follow, which takes places while they are measured",
        "with --path a push is looked at as a whole, once it is over"
    )
}

/// What was printed so far.
struct Shown<'a> {
    json: bool,
    file: &'a PolygonFile,
    is_headed: bool,
}

impl Shown<'_> {
    fn print(&mut self, answer: &PushAnswer, known: &KnownFromRest<'_>) {
        let PushAnswer { estimate, since_onset } = answer;
        let seen = Seen::pushed(known.part, known.motion, known.radius, estimate.time_end);
        recording::believed(seen, estimate.hypotheses.iter().map(Believed::from));
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
