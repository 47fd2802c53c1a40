//! `palpate touch`.
//!
//! `demo`: the same as a demonstration; `explore`: an unknown part; `setup`: finger, robot and world from the command line; `carriers`: who moves the finger; `told`: what is printed.

mod carriers;
pub(super) mod demo;
mod explore;
mod setup;
mod told;

use std::path::PathBuf;
use std::process::ExitCode;

use nalgebra::Point2;
use palpate::geometry::Pose;
use palpate::inscription::{Met, NextTouch, PartsSearch, TouchSearch, TouchTask, TouchTolerance};
use palpate_files::part::PolygonFile;

use super::calibrated::FingerArguments;
use super::library::read_library;
use super::plot::PlotArguments;
use super::touch_world::{Area, area_mm, pose_mm, read_part};
use super::{not_negative, positive};
use crate::advice::Advise as _;
use crate::live::guided::GuidedError;
use crate::live::interrupt;
use crate::pictures::touch::{TouchLeft, TouchPicture, TouchStep};
use crate::progress::Progress;
pub(crate) use carriers::advice;
use carriers::{Carrier, CarryError, Speeds};
use told::{SoughtPart, Told};

const LONG_HELP: &str = "\
The finger is moved along straight lines across the area in which the part lies. Where it touches it stops, and is drawn
back; where it passes without a touch there is no part. After each approach the poses that are left are told, and the line to
take next. With --robot palpate moves the finger itself (docs/ROBOT.md has the lines that a robot speaks); without it a person
does, and types where the disk's centre is.

How fast the finger may come so that friction holds the part follows from --mass-kg and the file's mu, unless --speed-mm-s says
it. -d sim:SEED --robot sim: plays all of it on a simulated part.

With --library DIR it says which of the parts of a folder it is, or none of these: what is left in the end is confirmed by touches
far from the others.

With --explore the part is unknown: it is held still, touched all around, each time where its outline is known least, and
written as a part file with the outline's uncertainty. The disk does not come into notches narrower than itself: there the
sides are taken to go on straight.

--plot draws a panel for each approach: what it met, the poses that are left, and the approach chosen next; with --explore the
outline that was found.

Exit status: 0 if one pose is left, or several that no touch can tell apart; 1 if something cannot be used or was lost; 2 if no
pose of any part fits what was felt; 3 if too many approaches left it open; 130 if it was interrupted: the robot was then stopped,
and with --explore what was felt so far is written; 64 wrong command line.";

/// Finds where a known part lies by touching it.
///
/// Prints after each approach the poses that are left, with their uncertainty, and which approach to make next.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The part file
    #[arg(long, value_name = "PART.toml", required_unless_present_any = ["library", "explore"])]
    part: Option<PathBuf>,

    /// A folder of part files: says which of them it is, or that it is none of these
    #[arg(long, value_name = "DIR", conflicts_with = "part")]
    library: Option<PathBuf>,

    /// Where all of the part is: two corners of a rectangle in the robot's frame, in mm
    #[arg(long, value_name = "X,Y,X,Y", value_parser = area_mm, allow_hyphen_values = true)]
    area_mm: Area,

    /// Radius of the finger's disk
    #[arg(long, value_name = "MM", default_value_t = 15.0, value_parser = positive)]
    radius_mm: f64,

    /// The part's mass: with the file's mu it tells what holds the part
    #[arg(long, value_name = "KG", value_parser = positive)]
    mass_kg: Option<f64>,

    /// Good enough: the outline's centroid within so much, at three standard deviations
    #[arg(long, value_name = "MM", default_value_t = 0.2, value_parser = positive)]
    tolerance_mm: f64,

    /// Good enough: the turn within so much
    #[arg(long, value_name = "DEG", default_value_t = 0.3, value_parser = positive)]
    tolerance_deg: f64,

    /// Give up after so many approaches [default: 40; with --explore four for each of --touches]
    #[arg(long, value_name = "N")]
    approaches_max: Option<usize>,

    /// Print a JSON object for each approach and one at the end: m, rad, N, SI throughout
    #[arg(long)]
    json: bool,

    /// Take the tare over so many seconds at the start
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = super::stretch)]
    tare: f64,

    /// With --robot sim: where the simulated part lies: X,Y of its file's origin and its turn [default: by the seed]
    #[arg(long, value_name = "X_MM,Y_MM,DEG", value_parser = pose_mm, allow_hyphen_values = true)]
    simulated_pose: Option<Pose>,

    /// With --robot sim: and --library: which of its parts lies there [default: the first]; with --explore: the file of
    /// the part that does [default: one of five corners]
    #[arg(long, value_name = "NAME")]
    simulated_part: Option<String>,

    #[command(flatten)]
    plot: PlotArguments,

    #[command(flatten)]
    finger: FingerArguments,

    #[command(flatten)]
    motion: MotionArguments,

    #[command(flatten)]
    exploration: explore::ExplorationArguments,
}

/// How the finger is moved, and what it may do.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Motion")]
pub(super) struct MotionArguments {
    /// The robot: a serial port, tcp:HOST:PORT, or sim: for one beside a simulated part [default: a person]
    #[arg(long, value_name = "ADDRESS")]
    robot: Option<String>,

    /// At which angle the robot's x axis lies in the finger's, in degrees, as `palpate wave` says ("mounted")
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_negative_numbers = true, value_parser = crate::cli::finite)]
    mounting_deg: f64,

    /// Stop the robot at the first reading above this force
    #[arg(long, value_name = "N", default_value_t = 5.0, value_parser = positive)]
    force_limit: f64,

    /// A touch begins at this force, and lasts until half of it is left
    #[arg(long, value_name = "N", default_value_t = 0.1, value_parser = positive)]
    touch_force: f64,

    /// Come with this speed, whether or not the part is moved
    #[arg(long, value_name = "MM/S", value_parser = positive)]
    speed_mm_s: Option<f64>,

    /// Speed where nothing can be touched
    #[arg(long, value_name = "MM/S", default_value_t = 50.0, value_parser = positive)]
    travel_mm_s: f64,

    /// The part may be moved by so much in a touch
    #[arg(long, value_name = "MM", default_value_t = 0.01, value_parser = positive)]
    motion_max_mm: f64,

    /// Standard deviation of each coordinate of the finger's place
    #[arg(long, value_name = "MM", default_value_t = 0.03, value_parser = positive)]
    place_sd_mm: f64,

    /// From an order to stop to the robot's braking, with half of the time in which its deceleration rises
    #[arg(long, value_name = "MS", default_value_t = 15.0, value_parser = not_negative)]
    robot_latency_ms: f64,

    /// With which it brakes
    #[arg(long, value_name = "M/S2", default_value_t = 1.0, value_parser = positive)]
    robot_deceleration: f64,

    /// Friction between finger and part at most [default: the file's mu_c, or 0.5]
    #[arg(long, value_name = "MU", value_parser = not_negative)]
    mu_c_max: Option<f64>,

    /// How far the finger's tip gives way, µm/N [default: that of the finger's drawings]
    #[arg(long, value_name = "UM/N", value_parser = not_negative)]
    compliance_um_per_n: Option<f64>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    arguments.finger.device.begin_recording()?;
    let told = Told { json: arguments.json };
    if arguments.exploration.is_asked() {
        return explore::run(arguments, told);
    }
    let named = match (&arguments.part, &arguments.library) {
        (Some(part), _) => vec![(part.display().to_string(), read_part(part)?)],
        (None, Some(folder)) => read_library(folder)?,
        (None, None) => {
            return Err(miette::miette!("say which part it is: --part PART.toml, --library DIR, or --explore"));
        }
    };
    let (names, files): (Vec<_>, Vec<_>) = named.into_iter().unzip();
    let speeds = Speeds::of(&arguments.motion, &files, arguments.mass_kg)?;
    speeds.tell();
    let there = arguments.there(&names)?;
    let mut carrier = arguments.carrier(&files[there], &speeds)?;
    let mut sought: Box<dyn Sought> = if arguments.library.is_some() {
        let outlines: Vec<_> = files.iter().map(|file| file.part.polygon().clone()).collect();
        let Area(area) = arguments.area_mm;
        let search = PartsSearch::new(&outlines, arguments.radius_mm * 1e-3, area, arguments.tolerance());
        Box::new(SoughtPart::new(search, names))
    } else {
        Box::new(TouchSearch::new(arguments.task(&files[there])))
    };
    let mut steps = Vec::new();
    let most = arguments.approaches_max.unwrap_or(APPROACHES_MAX);
    let ended = locate(sought.as_mut(), carrier.as_mut(), told, most, &mut steps);
    // Up to where it ended early, too: that shows why.
    arguments.plot.draw(|| {
        let Ground { radius, area } = sought.ground();
        let path = arguments.part.as_ref().or(arguments.library.as_ref());
        let name = path.and_then(|path| path.file_name()).unwrap_or_default().to_string_lossy();
        let title = format!("{name} by touch, approach by approach");
        Ok(TouchPicture { steps: &steps, area, radius, title: &title, subtitles: &[] }.figure())
    })?;
    ended
}

/// Approaches after which a search is given up.
const APPROACHES_MAX: usize = 40;

impl Arguments {
    fn tolerance(&self) -> TouchTolerance {
        TouchTolerance { distance: self.tolerance_mm * 1e-3, angle: self.tolerance_deg.to_radians() }
    }

    fn task(&self, file: &PolygonFile) -> TouchTask {
        let outline = file.part.polygon().clone();
        TouchTask { outline, radius: self.radius_mm * 1e-3, area: self.area_mm.0, tolerance: self.tolerance() }
    }

    /// The number of the part that lies in the simulated world.
    fn there(&self, names: &[String]) -> miette::Result<usize> {
        let Some(wanted) = &self.simulated_part else { return Ok(0) };
        if self.library.is_none() {
            return Err(miette::miette!(help = "leave it out", "--simulated-part is for --library and --explore"));
        }
        names.iter().position(|name| name == wanted).ok_or_else(|| {
            miette::miette!(
                help = "name a file of --library without its folder and ending",
                "no part is called {wanted}"
            )
        })
    }

    /// Where the robot of a simulated world begins: beside the area.
    fn start(&self) -> Point2<f64> {
        let [low, _] = self.area_mm.0;
        low - nalgebra::Vector2::repeat(self.radius_mm * 1e-3 + START_M)
    }
}

/// A simulated robot begins so far beyond where it could touch, m.
const START_M: f64 = 0.01;

/// Where the finger may touch something.
#[derive(Clone, Copy, Debug)]
pub(super) struct Ground {
    /// Of the finger's disk, m.
    radius: f64,
    /// All of the part is in this rectangle, m.
    area: [Point2<f64>; 2],
}

/// What is sought by touch: the pose of a part, which part it is, the outline of an unknown one.
pub(super) trait Sought {
    fn ground(&self) -> Ground;
    /// The approach to make; none where it is over.
    fn next(&self) -> Option<NextTouch>;
    fn take(&mut self, next: &NextTouch, met: &Met);
    /// Whether the finger met anything yet.
    fn has_touched(&self) -> bool;
    /// What is left, with its key.
    fn left_json(&self) -> (&'static str, serde_json::Value);
    fn say_left(&self);
    /// What is left in a few words, and the outlines that may lie there.
    fn left(&self) -> (String, Vec<TouchLeft>);
    /// Says how it ended; the exit status.
    fn end(&self, told: Told, approaches: usize, is_given_up: bool) -> miette::Result<u8>;
}

/// Touches until what is sought is known, or it is known that touch cannot tell; adds what came of each approach to `steps`.
pub(super) fn locate(
    sought: &mut dyn Sought,
    carrier: &mut dyn Carrier,
    told: Told,
    approaches_max: usize,
    steps: &mut Vec<TouchStep>,
) -> miette::Result<ExitCode> {
    for number in 1.. {
        let choosing = Progress::begin("choosing the next line");
        let next = sought.next();
        drop(choosing);
        let is_given_up = next.is_some() && number > approaches_max;
        let Some(next) = next.filter(|_| !is_given_up) else {
            return sought.end(told, number - 1, is_given_up).map(ExitCode::from);
        };
        told.next(number, &next);
        let met = match carrier.make(sought.ground(), &next, sought.has_touched()) {
            Err(interrupted @ CarryError::Guided(GuidedError::Interrupted)) => {
                note!("{interrupted}");
                return Ok(ExitCode::from(interrupt::INTERRUPTED));
            }
            met => met.advised()?,
        };
        sought.take(&next, &met);
        told.met(sought, number, &next, &met);
        let (words, left) = sought.left();
        let touched = if let Met::Part(touch) = &met { Some(touch.centre) } else { None };
        steps.push(TouchStep { approach: next.approach, touched, left, words });
    }
    unreachable!("approaches are counted to the end")
}
