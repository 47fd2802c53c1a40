//! `palpate touch`.
//!
//! `demo`: the same as a demonstration; `setup`: finger, robot and world from the command line; `carriers`: who moves the finger; `told`: what is printed.

mod carriers;
pub(super) mod demo;
mod setup;
mod told;

use std::path::PathBuf;
use std::process::ExitCode;

use nalgebra::Point2;
use palpate::geometry::Pose;
use palpate::inscription::{Met, TouchSearch, TouchTask, TouchTolerance, TouchVerdict};
use palpate_files::part::PolygonFile;

use super::calibrated::{CalibrationArguments, OffsetArguments};
use super::device::DeviceArguments;
use super::touch_world::{Area, area_mm, pose_mm, read_part};
use super::{not_negative, positive};
use crate::advice::Advise as _;
pub(crate) use carriers::advice;
use carriers::{Carrier, Speeds};
use told::Told;

const LONG_HELP: &str = "\
The finger is moved along straight lines across the area in which the part lies. Where it touches it stops, and is drawn
back; where it passes without a touch there is no part. After each approach the poses that are left are told, and the line to
take next. With --robot palpate moves the finger itself (docs/ROBOT.md has the lines that a robot speaks); without it a person
does, and types where the disk's centre is.

How fast the finger may come so that friction holds the part follows from --mass-kg and the file's mu, unless --speed-mm-s says
it. -d sim:SEED --robot sim: plays all of it on a simulated part.

Exit status: 0 if one pose is left, or several that no touch can tell apart; 1 if something cannot be used or was lost; 2 if no
pose fits what was felt; 3 if too many approaches left it open; 64 wrong command line.";

/// Exit status where no pose fits.
const EXIT_NO_POSE: u8 = 2;

/// Exit status where the approaches did not decide.
const EXIT_OPEN: u8 = 3;

/// Finds where a known part lies by touching it.
///
/// Prints after each approach the poses that are left, with their uncertainty, and which approach to make next.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,

    #[command(flatten)]
    offset: OffsetArguments,

    #[command(flatten)]
    motion: MotionArguments,

    /// The part file
    #[arg(long, value_name = "PART.toml")]
    part: PathBuf,

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

    /// Give up after so many approaches
    #[arg(long, value_name = "N", default_value_t = 40)]
    approaches_max: usize,

    /// Print a JSON object for each approach and one at the end: m, rad, N, SI throughout
    #[arg(long)]
    json: bool,

    /// Take the tare over so many seconds at the start
    #[arg(long, value_name = "S", default_value_t = 1.0, value_parser = super::stretch)]
    tare: f64,

    /// With --robot sim: where the simulated part lies: X,Y of its file's origin and its turn [default: by the seed]
    #[arg(long, value_name = "X_MM,Y_MM,DEG", value_parser = pose_mm, allow_hyphen_values = true)]
    simulated_pose: Option<Pose>,
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
    let file = read_part(&arguments.part)?;
    let speeds = Speeds::of(&arguments.motion, &file, arguments.mass_kg)?;
    let told = Told { json: arguments.json };
    speeds.tell();
    let mut carrier = arguments.carrier(&file, &speeds)?;
    let mut search = TouchSearch::new(arguments.task(&file));
    locate(&mut search, carrier.as_mut(), &told, arguments.approaches_max)
}

impl Arguments {
    fn task(&self, file: &PolygonFile) -> TouchTask {
        let tolerance = TouchTolerance { distance: self.tolerance_mm * 1e-3, angle: self.tolerance_deg.to_radians() };
        let outline = file.part.polygon().clone();
        TouchTask { outline, radius: self.radius_mm * 1e-3, area: self.area_mm.0, tolerance }
    }

    /// Where the robot of a simulated world begins: beside the area.
    fn start(&self) -> Point2<f64> {
        let [low, _] = self.area_mm.0;
        low - nalgebra::Vector2::repeat(self.radius_mm * 1e-3 + START_M)
    }
}

/// A simulated robot begins so far beyond where it could touch, m.
const START_M: f64 = 0.01;

/// Touches until the pose is known, or it is known that touch cannot tell.
pub(super) fn locate(
    search: &mut TouchSearch,
    carrier: &mut dyn Carrier,
    told: &Told,
    approaches_max: usize,
) -> miette::Result<ExitCode> {
    for number in 1.. {
        let verdict = search.verdict();
        let next = match &verdict {
            TouchVerdict::Open { .. } if number <= approaches_max => search.next(),
            _ => None,
        };
        let Some(next) = next else {
            told.end(search, &verdict, number - 1);
            return Ok(ExitCode::from(match verdict {
                TouchVerdict::One(_) | TouchVerdict::Alike(_) => 0,
                TouchVerdict::Open { .. } if number > approaches_max => EXIT_OPEN,
                TouchVerdict::Open { .. } | TouchVerdict::NoPose => EXIT_NO_POSE,
            }));
        };
        told.next(number, &next);
        let is_bounded = !search.touches().is_empty();
        let met = carrier.make(search.task(), &next, is_bounded).advised()?;
        search.take(&next.approach, &met);
        told.met(search, number, &next, &met);
    }
    unreachable!("approaches are counted to the end")
}

/// Whether something was touched.
fn is_touch(met: &Met) -> bool {
    matches!(met, Met::Part(_))
}
