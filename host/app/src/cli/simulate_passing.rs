//! `palpate simulate-passing`.

use std::path::PathBuf;
use std::process::ExitCode;

use palpate::geometry::{Pose, SimplePolygon};
use palpate::inscription::{BeamChange, changes, noisy};
use palpate::math::random::Draw;
use palpate_files::passing::PassingFile;
use palpate_files::views::NamedPart;

use super::not_negative;
use super::read::{read, read_beside};
use super::switches::BOARD_INPUTS;
use super::touch_world::pose_mm;

/// Tells what light barriers and turning beams would tell of parts that are carried past them.
///
/// Prints lines `T ID 0|1` for `palpate inscribe PART.toml --passing BEAMS.toml`; or, with --orders-after, orders for the inputs
/// of `palpate simulate-device`. Times have the errors that the file states; orders act some milliseconds late beside: state
/// time_sigma_ms accordingly.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The part file
    #[arg(value_name = "PART.toml")]
    part: PathBuf,
    /// The file of the beams
    #[arg(long, value_name = "BEAMS.toml")]
    passing: PathBuf,
    /// Where a part is at the time 0: of its file's frame x, y in mm and the turn in degrees; once for each part
    #[arg(long, value_name = "X,Y,DEG", required = true, allow_hyphen_values = true, value_parser = pose_mm)]
    pose: Vec<Pose>,
    /// Seed of the errors
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Print orders for the inputs of `palpate simulate-device`, the time 0 being so long after it starts
    #[arg(long, value_name = "S", value_parser = not_negative)]
    orders_after: Option<f64>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let file = read(&arguments.passing, PassingFile::parse)?;
    let part = read_beside(&arguments.part, |text, open| NamedPart::parse_beside("part", text, true, open))?;
    let mut draw = Draw::case(arguments.seed, 0);
    let mut all: Vec<BeamChange> = Vec::new();
    for pose in &arguments.pose {
        let corners: Vec<_> = part.outline.vertices().iter().map(|corner| pose.isometry() * corner).collect();
        // A pose moves the outline by rounding alone, so what was a polygon is one.
        let Ok(placed) = SimplePolygon::new(corners) else { continue };
        let exact = changes(&file.beams, &placed, file.velocity);
        all.extend(noisy(exact, &file.beams, file.velocity, file.bearing_sigma, &mut draw));
    }
    all.sort_by(|a, b| a.time.total_cmp(&b.time));
    if let Some(first) = all.first().filter(|first| first.time < 0.0) {
        let help = "give --pose further back along the velocity";
        return Err(miette::miette!(
            help = help,
            "a beam is covered {:.3} s before the time 0: the part is among the beams already",
            -first.time
        ));
    }
    match arguments.orders_after {
        None => {
            for BeamChange { time, beam, is_covered } in all {
                say!("{time:.6} {} {}", file.ids[beam], u8::from(is_covered));
            }
        }
        Some(after) => orders(&all, &file, after)?,
    }
    Ok(ExitCode::SUCCESS)
}

fn orders(all: &[BeamChange], file: &PassingFile, after: f64) -> miette::Result<()> {
    if let Some(id) = file.ids.iter().find(|id| **id > BOARD_INPUTS) {
        return Err(miette::miette!(
            help = "number the beams from 1",
            "id = {id} is no input: a board has {BOARD_INPUTS}"
        ));
    }
    let (mut levels, mut before) = (0_u8, -after);
    for BeamChange { time, beam, is_covered } in all {
        let bit = 1 << (file.ids[*beam] - 1);
        levels = if *is_covered { levels | bit } else { levels & !bit };
        say!("wait {:.6}", time - before);
        say!("inputs {levels:08b}");
        before = *time;
    }
    say!("wait 1");
    Ok(())
}
