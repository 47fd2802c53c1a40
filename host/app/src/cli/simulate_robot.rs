//! `palpate simulate-robot`.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::geometry::Pose;
use palpate_device::simulated::robot::{RobotConfig, SimulatedRobot};
use palpate_device::simulated::{Config, Line, SimulatedDevice};

use super::simulate_device::lines_of_input;
use super::touch_world::{WorldArguments, pose_mm};
use super::{not_negative, positive};
use crate::advice::Advise as _;
use crate::live::interrupt;

/// Runs a robot without hardware that carries a simulated finger to a simulated part.
///
/// Prints the path of the robot's line (docs/ROBOT.md), then that of the finger's, and runs until interrupted: for
/// `palpate touch -d FINGER --robot ROBOT`. The finger is that of `sim:SEED` with the same seed, so that
/// `palpate calibrate -d sim:SEED` calibrates it. The part yields to what friction does not hold. A line `part X,Y,DEG` on
/// standard input lays it elsewhere (mm, degrees), as somebody would who moves it unseen.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    #[command(flatten)]
    world: WorldArguments,

    /// The part file [default: a part of five corners]
    #[arg(long, value_name = "PART.toml")]
    part: Option<PathBuf>,

    /// Seed of everything random
    #[arg(long, default_value_t = 0)]
    seed: u64,

    /// The robot listens on a TCP port instead of a pseudo-terminal: tcp:HOST:PORT (port 0 takes any free one)
    #[arg(long, value_name = "ADDRESS")]
    listen: Option<String>,

    /// So does the finger
    #[arg(long, value_name = "ADDRESS")]
    listen_finger: Option<String>,

    /// From an order being given to its acting, and from a place to its being told, in ms
    #[arg(long, value_name = "MS", default_value_t = 4.0, value_parser = not_negative)]
    latency_ms: f64,

    /// Acceleration, m/s²
    #[arg(long, value_name = "M/S2", default_value_t = 2.0, value_parser = positive)]
    acceleration: f64,

    /// Jerk, m/s³
    #[arg(long, value_name = "M/S3", default_value_t = 100.0, value_parser = positive)]
    jerk: f64,

    /// Standard deviation of each coordinate that it tells
    #[arg(long, value_name = "MM", default_value_t = 0.02, value_parser = not_negative)]
    robot_sd_mm: f64,

    /// Where the robot begins, beside the area
    #[arg(long, value_name = "X,Y", default_value = "-40,-40", value_parser = super::touch_world::point_mm, allow_hyphen_values = true)]
    start_mm: Point2<f64>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let config = RobotConfig {
        start: arguments.start_mm,
        acceleration: arguments.acceleration,
        jerk: arguments.jerk,
        latency: arguments.latency_ms * 1e-3,
        position_sd: arguments.robot_sd_mm * 1e-3,
        seed: arguments.seed,
        ..RobotConfig::default()
    };
    let part = arguments.part.as_deref().map(super::touch_world::read_part).transpose()?;
    let world = arguments.world.world(part.as_ref(), arguments.seed)?;
    interrupt::listen();
    let robot = SimulatedRobot::new(config, world);
    let line = |listen: &Option<String>| match listen {
        Some(address) => Line::Tcp { host: address.strip_prefix("tcp:").unwrap_or(address).to_owned() },
        None => Line::Pty { link: None },
    };
    // The finger's conversions are the world's time.
    let finger = Config {
        seed: arguments.seed,
        line: line(&arguments.listen_finger),
        carried_by: Some(robot.clone()),
        ..Config::default()
    };
    let finger = SimulatedDevice::start(finger).advised().wrap_err("cannot start the simulated finger")?;
    let served = robot.serve(&line(&arguments.listen), false);
    let server = served.into_diagnostic().wrap_err("cannot start the simulated robot")?;
    say!("{}\n{}", server.address(), finger.address());
    let orders = lines_of_input()?;
    let mut stopped = None;
    while !interrupt::requested() {
        std::thread::sleep(LOOK_EVERY);
        for line in orders.try_iter() {
            match line.and_then(|line| laid(&line)) {
                Ok(Some(pose)) => robot.lay(pose),
                Ok(None) => {}
                Err(why) => note!("{why}"),
            }
        }
        let truth = robot.truth();
        if truth.stopped != stopped {
            stopped = truth.stopped;
            note!(
                "t = {:.3} s: told to stop; at ({:.2}, {:.2}) mm, {:.2} N, at most {:.2} N so far",
                truth.t,
                truth.clamp.x * 1e3,
                truth.clamp.y * 1e3,
                truth.force.norm(),
                truth.force_max
            );
        }
    }
    Ok(ExitCode::SUCCESS)
}

/// The pose that an order lays the part in; none of an empty line.
fn laid(line: &str) -> Result<Option<Pose>, String> {
    let line = line.trim();
    if line.is_empty() {
        return Ok(None);
    }
    let pose = line.strip_prefix("part ").ok_or_else(|| format!("`{line}` is no order: write `part X,Y,DEG`"))?;
    pose_mm(pose.trim()).map(Some)
}

/// How often it looks for what to tell, and whether the user wants to stop.
const LOOK_EVERY: Duration = Duration::from_millis(100);
