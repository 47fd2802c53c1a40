//! `palpate push`.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::ValueEnum;
use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::pushing::dynamics::{
    ContactForce, ContactLaw, ContactMode, EndReason, FingerShape, PartSide, PushRun, Sample,
};
use palpate_files::part::{DescribedPart, PartFile};
use palpate_files::solve::kinds::push::{InitialAcceleration, Meeting, PushAnswer, PushEnd, PushSample, Transition};

use super::plot::{PlotArguments, draw_to, picture_file};
use super::read::{read_beside, tell_part};
use super::slow_push::{SlowArguments, SlowlyPushing};
use super::{equal_steps, finite, not_negative, positive};
use crate::pictures::limit_surface;
use crate::pictures::plot::Figure;
use crate::pictures::push::{PushPicture, SAMPLES};
use crate::push_scenario::{Place, PushPlan, Pushed, Turn, to_world};
use crate::width::folded;
use palpate::gravity::GRAVITY_ASSUMED;

/// Most rows of the table; far beyond what anybody reads, and short of what would exhaust memory.
const ROWS_MAX: i64 = 100_000;

const LONG_HELP: &str = "\
The part file is TOML; every length in it is in its `unit`:
  unit = \"mm\"                # m, cm, mm or in
  vertices = [[0, 0], [90, 0], [90, 40], [30, 60]]  # counter-clockwise
  mu = 0.25                  # friction between part and table
  mu_c = 0.3                 # friction between part and finger (optional)
  feet = [[5, 5, 1], [85, 5, 1], [45, 45, 2]]
                             # x, y, weight on it in any unit (optional: else
                             # all of the base)
  centre_of_mass = [48, 25]  # both or neither of these two; without them the
  radius_of_gyration = 28    # part is a uniform plate
Instead of feet, `[[support]]` lists what the part may stand on, for `palpate which-part`. An elliptic part has `ellipse = {a = 40, b = 25}` instead of vertices: semi-axes along x and y, middle at the origin.

At first the part lies as drawn and the finger touches it. Without --speed-mm-s both are at rest; with it the part
already goes along with the finger. Forces are those on the part, as shares of its weight. --then changes the finger's
acceleration on the way, as often as given: `--acceleration-mm-s2 50 --then 0.5,-50 --then 1,0` pushes, brakes and rests.

With --quasi-static the finger goes so slowly that friction alone decides, as at some mm/s it does: no speed, no time, but
a way, --distance-mm or --path. It touches edges and vertices as it comes to them, sticks and slides, leaves and touches
again; feet that come to rest hold as friction does. The load moves with a push above the table (--height-mm).

Exit status: 0, 1 if the push is impossible or a file cannot be read or written, 64 wrong command line.";

/// Simulates how a part moves on the table when the finger pushes it.
///
/// Prints where the part is, where the finger touches it and what force it takes, up to when the finger loses the part,
/// the contact reaches the end of the edge, or the time is up.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The part file
    #[arg(value_name = "PART.toml")]
    part: PathBuf,
    /// The edge of a polygon to push at: from this vertex to the next, counted from 0
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    edge: Option<usize>,
    /// Where to push at an elliptic part: eccentric angle, 0 at the end of its axis a, counter-clockwise
    #[arg(long, value_name = "DEGREES", value_parser = finite, allow_negative_numbers = true, conflicts_with_all = ["edge", "s_mm"])]
    around_deg: Option<f64>,
    /// Where on the edge: counter-clockwise from the foot of the perpendicular through the centre of mass [default: the
    /// edge's middle]
    #[arg(long, value_name = "MM", value_parser = finite, allow_negative_numbers = true)]
    s_mm: Option<f64>,
    /// Outline of the finger
    #[arg(long, value_enum, default_value_t = FingerChoice::Disk)]
    finger: FingerChoice,
    /// Radius of the finger's disk
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 15.0)]
    radius_mm: f64,
    /// Semi-axes of an elliptic finger along x and y
    #[arg(long, value_name = "MM,MM", value_parser = semi_axes, default_value = "20,10")]
    semi_axes_mm: SemiAxes,
    /// The finger's speed at the start; 0 starts from rest
    #[arg(long, value_name = "MM/S", value_parser = not_negative, allow_negative_numbers = true, default_value_t = 0.0)]
    speed_mm_s: f64,
    /// Where the finger moves: 0 is straight into the edge, counter-clockwise
    #[arg(long, value_name = "DEGREES", value_parser = finite, default_value_t = 0.0, allow_negative_numbers = true)]
    direction_deg: f64,
    /// The finger's acceleration; negative brakes
    #[arg(long, value_name = "MM/S²", value_parser = finite, default_value_t = 0.0, allow_negative_numbers = true)]
    acceleration_mm_s2: f64,
    /// Where the finger accelerates, counted like the direction [default: the direction]
    #[arg(long, value_name = "DEGREES", value_parser = finite, allow_negative_numbers = true)]
    acceleration_direction_deg: Option<f64>,
    /// From a time on (s), another acceleration (mm/s²) in a direction (degrees) [default: the acceleration's]
    #[arg(long, value_name = "S,MM/S²[,DEGREES]", value_parser = turn, allow_hyphen_values = true)]
    then: Vec<TurnArgument>,
    /// How fast the part turns at the start, counter-clockwise; only with a speed
    #[arg(long, value_name = "DEGREES/S", value_parser = finite, default_value_t = 0.0, allow_negative_numbers = true)]
    turning_deg_s: f64,
    /// What happens at the contact
    #[arg(long, value_enum, default_value_t = ContactChoice::Auto)]
    contact: ContactChoice,
    /// Friction between part and finger [default: the part file's]
    #[arg(long, value_name = "MU", value_parser = not_negative, allow_negative_numbers = true)]
    mu_c: Option<f64>,
    /// How long to push
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 1.0)]
    time_s: f64,
    /// Rows of the table after the first
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=ROWS_MAX), default_value_t = 10)]
    rows: u32,
    /// Print one JSON object as `palpate solve` does for the problem `push`: m, rad, SI throughout
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    plot: PlotArguments,
    /// Draw the part's limit surface with the friction during the push to this file, .svg or .png
    #[arg(long, value_name = "FILE", value_parser = picture_file)]
    limit_surface: Option<PathBuf>,
    #[command(flatten)]
    slow: SlowArguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ContactChoice {
    /// Coulomb friction if a coefficient is given, otherwise none
    Auto,
    /// No friction
    Frictionless,
    /// Never slips
    Rolling,
    /// Rolls or slides as Coulomb's law demands
    Coulomb,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FingerChoice {
    /// --radius-mm
    Disk,
    /// --semi-axes-mm, along x and y whatever it touches
    Ellipse,
    /// Everything below a line along x; touches elliptic parts from below (--around-deg -90)
    Line,
}

/// The value of `--semi-axes-mm`.
#[derive(Clone, Copy, Debug)]
struct SemiAxes([f64; 2]);

fn semi_axes(text: &str) -> Result<SemiAxes, String> {
    let Some((a, b)) = text.split_once(',') else {
        return Err(format!("`{text}` is not two lengths: write for example 20,10"));
    };
    Ok(SemiAxes([positive(a)?, positive(b)?]))
}

/// The value of `--then`.
#[derive(Clone, Copy, Debug)]
struct TurnArgument {
    t: f64,
    acceleration_mm_s2: f64,
    direction_deg: Option<f64>,
}

fn turn(text: &str) -> Result<TurnArgument, String> {
    let numbers = text.split(',').map(finite).collect::<Result<Vec<_>, _>>()?;
    match numbers[..] {
        [t, acceleration_mm_s2] => Ok(TurnArgument { t, acceleration_mm_s2, direction_deg: None }),
        [t, acceleration_mm_s2, direction] => {
            Ok(TurnArgument { t, acceleration_mm_s2, direction_deg: Some(direction) })
        }
        _ => Err(format!("`{text}` is not a time and an acceleration: write for example 0.5,-50 or 0.5,-50,20")),
    }
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let file = read_beside(&arguments.part, PartFile::parse_beside)?;
    tell_part(&arguments.part, &file.part.outline(), file.part.body(), &file.doubts());
    if arguments.slow.is_asked() {
        return arguments.push_slowly(&file);
    }
    let plan = arguments.plan(&file)?;
    let cannot = || format!("cannot push {}", arguments.part.display());
    let run = |times: &[f64]| plan.run(&file, times).into_diagnostic().wrap_err_with(cannot);
    let pushed = run(&equal_steps(arguments.time_s, f64::from(arguments.rows)))?;
    let text = if arguments.json { json(&file, &plan, &pushed)? } else { table(&file, &plan, &pushed) };
    let smooth = || -> miette::Result<Pushed> {
        // Not beyond the end: all that is drawn is what happened.
        let smooth = run(&equal_steps(pushed.run.end.t, f64::from(u32::try_from(SAMPLES).unwrap_or(u32::MAX))))?;
        Ok(Pushed { run: PushRun { end: pushed.run.end, ..smooth.run }, ..smooth })
    };
    arguments.plot.draw(|| Ok(arguments.figure(&file, &plan, &smooth()?)))?;
    if let Some(path) = &arguments.limit_surface {
        let title = format!("Limit surface of {}", arguments.name());
        draw_to(path, &limit_surface::figure(&title, file.part.body(), &smooth()?.run.samples))?;
    }
    print(&text)
}

impl Arguments {
    fn push_slowly(&self, file: &PartFile) -> miette::Result<ExitCode> {
        let help = "leave --finger out: a disk of --radius-mm pushes slowly";
        if self.finger != FingerChoice::Disk {
            return Err(miette::miette!(help = help, "slow pushes are by a disk"));
        }
        let pushing = SlowlyPushing {
            name: self.name(),
            part: &self.part,
            file,
            edge: self.edge,
            s: self.s_mm.map(|s| s * 1e-3),
            direction: self.direction_deg.to_radians(),
            radius: self.radius_mm * 1e-3,
            mu_c: self.mu_c.or(file.mu_c),
            rows: self.rows,
            json: self.json,
        };
        pushing.run(&self.slow, &self.plot)
    }

    fn plan(&self, file: &PartFile) -> miette::Result<PushPlan> {
        let direction_deg = self.acceleration_direction_deg.unwrap_or(self.direction_deg);
        let then = self.then.iter().map(|turn| Turn {
            t: turn.t,
            acceleration: turn.acceleration_mm_s2 * 1e-3,
            direction: turn.direction_deg.unwrap_or(direction_deg).to_radians(),
        });
        Ok(PushPlan {
            place: self.place(&file.part)?,
            shape: self.shape(),
            speed: self.speed_mm_s * 1e-3,
            direction: self.direction_deg.to_radians(),
            acceleration: self.acceleration_mm_s2 * 1e-3,
            acceleration_direction: direction_deg.to_radians(),
            then: then.collect(),
            omega: self.turning_deg_s.to_radians(),
            contact: self.law(self.mu_c.or(file.mu_c))?,
        })
    }

    fn place(&self, part: &DescribedPart) -> miette::Result<Place> {
        let name = self.name();
        match part {
            DescribedPart::Ellipse { .. } => {
                let help = "give --around-deg: the eccentric angle, 0 at the end of its axis a";
                match (self.around_deg, self.edge.is_some() || self.s_mm.is_some()) {
                    (Some(angle), _) => Ok(Place::Around { angle: angle.to_radians() }),
                    (None, true) => {
                        Err(miette::miette!(help = help, "{name} is an ellipse and has no edge for --edge and --s-mm"))
                    }
                    (None, false) => Err(miette::miette!(help = help, "where to push at {name} is not said")),
                }
            }
            DescribedPart::Polygon(part) => {
                let last = part.polygon().vertices().len() - 1;
                let help = format!("give --edge, from 0 to {last}: from this vertex to the next");
                match (self.edge, self.around_deg) {
                    (Some(index), _) => Ok(Place::Edge { index, s: self.s_mm.map(|s| s * 1e-3) }),
                    (None, Some(_)) => {
                        Err(miette::miette!(help = help, "--around-deg is for ellipses, and {name} has edges"))
                    }
                    (None, None) => Err(miette::miette!(help = help, "where to push at {name} is not said")),
                }
            }
        }
    }

    fn shape(&self) -> FingerShape {
        match self.finger {
            FingerChoice::Disk => FingerShape::Disk { radius: self.radius_mm * 1e-3 },
            FingerChoice::Ellipse => FingerShape::Ellipse { semi_axes: self.semi_axes_mm.0.map(|mm| mm * 1e-3) },
            FingerChoice::Line => FingerShape::Line,
        }
    }

    fn law(&self, friction: Option<f64>) -> miette::Result<ContactLaw> {
        match (self.contact, friction) {
            (ContactChoice::Auto | ContactChoice::Coulomb, Some(friction)) => Ok(ContactLaw::Coulomb { friction }),
            (ContactChoice::Auto, None) | (ContactChoice::Frictionless, _) => Ok(ContactLaw::Frictionless),
            (ContactChoice::Rolling, _) => Ok(ContactLaw::Rolling { friction: None }),
            (ContactChoice::Coulomb, None) => Err(miette::miette!(
                help = "give --mu-c, or mu_c in the part file",
                "a contact by Coulomb's law needs its coefficient of friction"
            )),
        }
    }

    /// The part file's, without its folder.
    fn name(&self) -> String {
        self.part.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
    }

    fn figure(&self, file: &PartFile, plan: &PushPlan, pushed: &Pushed) -> Figure {
        let name = self.name();
        let friction = if let ContactLaw::Coulomb { friction } = plan.contact { Some(friction) } else { None };
        let subtitles = [self.setting(file, plan), end_in_words(file, plan, pushed)];
        let title = match plan.place {
            Place::Edge { index, .. } => format!("Pushing {name} at edge {index}"),
            Place::Around { angle } => format!("Pushing {name} at {:.0}°", angle.to_degrees()),
        };
        PushPicture { file, pushed, edge: self.edge, friction, title: &title, subtitles: &subtitles }.figure()
    }

    /// Friction and motion in a line.
    fn setting(&self, file: &PartFile, plan: &PushPlan) -> String {
        let contact = match plan.contact {
            ContactLaw::Coulomb { friction } => format!("µ {friction} at the finger"),
            ContactLaw::Rolling { .. } => "no slip at the finger".to_owned(),
            _ => "no friction at the finger".to_owned(),
        };
        let motion = match (self.speed_mm_s > 0.0, self.acceleration_mm_s2) {
            (false, acceleration) => format!("from rest with {acceleration} mm/s²"),
            (true, 0.0) => format!("{} mm/s", self.speed_mm_s),
            (true, acceleration) => format!("{} mm/s and {acceleration} mm/s²", self.speed_mm_s),
        };
        let changes = if self.then.is_empty() { "" } else { ", then changing" };
        let finger = match plan.shape {
            FingerShape::Disk { .. } => format!("radius {} mm", self.radius_mm),
            FingerShape::Ellipse { semi_axes: [a, b] } => format!("ellipse of {} × {} mm", a * 2e3, b * 2e3),
            FingerShape::Line => "straight".to_owned(),
        };
        format!("µ {} on the table, {contact}; finger: {finger}, {motion}{changes}", file.mu)
    }
}

/// The head of the table; where the contact is, on finger and part, is an angle or a length.
fn header(pushed: &Pushed) -> String {
    let [u, s] = [is_straight_finger(pushed), is_straight_side(pushed)].map(|length| if length { "mm" } else { "°" });
    let (u, s) = (format!("u [{u}]"), format!("s [{s}]"));
    let (above, below) = ("centre of mass", "force / weight");
    format!("{:>7} {above:>15} {:>7} {:>16} {:>7} {below:>15}\n", "time", "turned", "contact", "turning")
        + &line(["[s]", "x [mm]", "y [mm]", "[°]", &u, &s, "[°/s]", "into", "along", "contact"])
}

fn is_straight_finger(pushed: &Pushed) -> bool {
    matches!(pushed.shape, FingerShape::Line)
}

fn is_straight_side(pushed: &Pushed) -> bool {
    matches!(pushed.side, PartSide::Edge(_))
}

/// A place along an outline in mm or degrees.
fn place(value: f64, straight: bool) -> f64 {
    if straight { value * 1e3 } else { value.to_degrees() }
}

fn table(file: &PartFile, plan: &PushPlan, pushed: &Pushed) -> String {
    let run = &pushed.run;
    let before_end = run.samples.iter().filter(|sample| sample.t < run.end.t);
    let rows = before_end.chain([&run.last]).map(|sample| row(file, pushed, sample));
    let mut text = header(pushed) + &rows.collect::<String>();
    for change in &run.changes {
        text += &format!("{:.4} s: the contact begins to {}\n", change.t, verb(&change.to));
    }
    text + &folded(&end_in_words(file, plan, pushed)) + "\n"
}

fn row(file: &PartFile, pushed: &Pushed, sample: &Sample) -> String {
    let centre = to_world(sample, file.part.centre_of_mass()) * 1e3;
    let force = |component: fn(ContactForce) -> f64| match sample.force {
        Some(force) => fixed(component(force) / GRAVITY_ASSUMED, 4),
        None => "--".to_owned(),
    };
    line([
        &fixed(sample.t, 4),
        &fixed(centre.x, 2),
        &fixed(centre.y, 2),
        &fixed(sample.theta.to_degrees(), 2),
        &fixed(place(sample.state.u, is_straight_finger(pushed)), 2),
        &fixed(place(sample.state.s, is_straight_side(pushed)), 3),
        &fixed(sample.state.omega.to_degrees(), 2),
        &force(|force| force.normal),
        &force(|force| force.tangential),
        &state_in_words(sample),
    ])
}

/// Cells in their columns.
fn line([t, x, y, turned, u, s, turning, into, along, contact]: [&str; 10]) -> String {
    format!("{t:>7} {x:>7} {y:>7} {turned:>7} {u:>7} {s:>8} {turning:>7} {into:>7} {along:>7} {contact}\n")
}

/// What the contact does now.
fn state_in_words(sample: &Sample) -> String {
    let rests = sample.force.is_none() && sample.velocity.norm() == 0.0;
    if rests { "rests".to_owned() } else { format!("{}s", verb(&sample.contact)) }
}

/// A number with so many decimals, and no minus sign before a zero.
pub(super) fn fixed(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(zero) if zero.chars().all(|c| c == '0' || c == '.') => zero.to_owned(),
        _ => text,
    }
}

/// What a contact does.
fn verb(contact: &ContactMode) -> &'static str {
    match contact {
        ContactMode::Rolling => "roll",
        ContactMode::Frictionless | ContactMode::Sliding { .. } => "slide",
    }
}

fn end_in_words(file: &PartFile, plan: &PushPlan, pushed: &Pushed) -> String {
    let [from, to] = match (&plan.place, &file.part) {
        (Place::Edge { index, .. }, DescribedPart::Polygon(part)) => part.side_vertices(*index),
        _ => [0; 2], // An ellipse has no ends.
    };
    let why = match pushed.run.end.reason {
        EndReason::Time => "the time was up".to_owned(),
        EndReason::Break => "the finger lost the part: no force is left at the contact".to_owned(),
        EndReason::Stick => "sliding stopped".to_owned(),
        EndReason::Slip => "rolling needs more friction than there is".to_owned(),
        EndReason::EdgeMin => format!("the contact reached vertex {from}"),
        EndReason::EdgeMax => format!("the contact reached vertex {to}"),
        EndReason::Jam => "the contact jams: no finite force fits (Painlevé's paradox)".to_owned(),
        EndReason::SecondContact => match pushed.run.second_contact {
            Some(second) => format!("the finger reached edge {} as well: two contacts are not simulated", second.edge),
            None => "the finger reached a second edge".to_owned(),
        },
    };
    format!("ended after {:.4} s: {why}", pushed.run.end.t)
}

fn json(file: &PartFile, plan: &PushPlan, pushed: &Pushed) -> miette::Result<String> {
    let run = &pushed.run;
    let edge = |sample: &Sample| match (&plan.place, &file.part) {
        (Place::Edge { index, .. }, DescribedPart::Polygon(part)) => Some(part.edge_at(*index, sample.state.s)),
        _ => None,
    };
    let sampled = |sample: &Sample| PushSample::of(sample, edge(sample));
    let start =
        run.rest_start.map(|start| InitialAcceleration { centroid: start.centre_of_mass.into(), alpha: start.alpha });
    let answer = PushAnswer {
        samples: run.samples.iter().map(sampled).collect(),
        end: PushEnd { reason: run.end.reason.into(), t: run.end.t },
        last: sampled(&run.last),
        initial_acceleration: start,
        second_contact: run.second_contact.map(Meeting::from),
        transitions: Some(run.changes.iter().map(|change| Transition { t: change.t, to: change.to.into() }).collect()),
    };
    Ok(serde_json::to_string(&answer).into_diagnostic()? + "\n")
}

fn print(text: &str) -> miette::Result<ExitCode> {
    super::write_out(format_args!("{text}"));
    Ok(ExitCode::SUCCESS)
}
