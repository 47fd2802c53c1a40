//! `palpate demo --touch`: a simulated robot finds a part by touch, and the truth is revealed.

use std::process::ExitCode;

use clap::Parser as _;
use miette::IntoDiagnostic as _;
use palpate::geometry::Pose;
use palpate::inscription::{TouchSearch, TouchTask, TouchTolerance, TouchVerdict, outlines_apart};
use palpate::math::random::Draw;
use palpate_device::robot::RobotLink;
use palpate_files::part::PolygonFile;

use super::carriers::Speeds;
use super::setup::RobotWorld;
use super::told::Told;
use super::{MotionArguments, locate};
use crate::cli::touch_world::{Area, MU_C, RADIUS, anywhere, area_mm, simulated};
use crate::cli::turn_deg;
use crate::width::folded;

/// The part of the demonstration, as a person would write it.
const PART: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 25], [35, 45], [0, 30]]\nmu = 0.3\nmu_c = 0.25\n";

/// Its mass, kg.
const MASS: f64 = 1.0;

/// Where it lies, mm.
const AREA_MM: &str = "0,0,160,160";

/// Rest before the finger moves, s.
const TARE_S: f64 = 1.0;

/// More approaches than any part takes.
const APPROACHES_MAX: usize = 40;

/// What a person who tells nothing of the motion gets.
#[derive(clap::Parser)]
struct AsUsual {
    #[command(flatten)]
    motion: MotionArguments,
}

/// Runs the demonstration.
pub(crate) fn run(seed: u64) -> miette::Result<ExitCode> {
    let file = PolygonFile::parse(PART).into_diagnostic()?;
    let Area(area) = area_mm(AREA_MM).map_err(|error| miette::miette!("{error}"))?;
    let AsUsual { motion } = AsUsual::parse_from(["palpate"]);
    let outline = file.part.polygon().clone();
    let pose = anywhere(&outline, Area(area), &mut Draw::new(seed))?;
    let world = simulated(outline.clone(), [file.mu, file.mu_c.unwrap_or(MU_C)], MASS, pose);
    say!(
        "{}",
        folded(
            "A part of five corners lies somewhere in a square of 160 mm, at any angle. A simulated robot carries a simulated finger, \
             which runs the firmware, along lines across it; the host knows the part's outline and mass, stops the robot when it \
             feels a touch, and plans the next line. Where the finger presses more than friction holds, the part yields."
        )
    );
    let speeds = Speeds::of(&motion, std::slice::from_ref(&file), Some(MASS))?;
    speeds.tell();
    let start = area[0] - nalgebra::Vector2::repeat(RADIUS + super::START_M);
    let RobotWorld { robot, session, calibration } = RobotWorld::new(world, start, seed, None)?;
    let epoch = session.epoch();
    let finger = motion.listening(session, calibration, TARE_S, true)?;
    let mut carrier = motion.guided(finger, RobotLink::simulated(robot.clone(), epoch), speeds);
    let tolerance = TouchTolerance::default();
    let mut search = TouchSearch::new(TouchTask { outline: outline.clone(), radius: RADIUS, area, tolerance });
    let status = locate(&mut search, &mut carrier, Told { json: false }, APPROACHES_MAX, &mut Vec::new())?;
    let truth = robot.truth();
    let moved = outlines_apart(&outline, &pose, &truth.pose);
    let told = format!(
        "The truth: {}; the touches moved it by {:.3} mm, and the finger pressed with {:.2} N at most.",
        in_words(&file, &truth.pose),
        moved * 1e3,
        truth.force_max
    );
    say!("{}", folded(&told));
    if let TouchVerdict::One(mode) = search.verdict() {
        let off = outlines_apart(&outline, &mode.pose, &truth.pose);
        say!("The outline that was found is nowhere more than {:.3} mm from the true one.", off * 1e3);
    }
    say!("Nothing here was measured: finger, robot and part were simulated.");
    Ok(status)
}

fn in_words(file: &PolygonFile, pose: &Pose) -> String {
    let centroid = pose.isometry() * file.part.polygon().centroid();
    format!("centroid ({:.2}, {:.2}) mm, turned {:.2}°", centroid.x * 1e3, centroid.y * 1e3, turn_deg(pose.theta))
}
