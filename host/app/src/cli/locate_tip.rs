//! `palpate locate-tip`.

use std::path::PathBuf;
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::pushing::tip::locate;
use palpate_files::calibration::carried::TipRecord;
use palpate_files::calibration::file::{CalibrationFile, save_beside};
use palpate_files::touches;

use super::calibrate;
use super::read::read;
use crate::advice::Advise as _;

const LONG_HELP: &str = "\
The file of touches: unit, the disk's radius, the block's outline and pose in the robot's frame, and for each touch
the wrist's place (and turn, where it turned) and the face that was touched. See calibration/PROCEDURE.md.";

/// Finds where the disk is on the robot's wrist, from touches on a block of known outline.
///
/// An error of the tip's place is an error of every pose. Bring the disk up to the block until `monitor` just shows a
/// contact, note where the wrist is, and do so on several faces. Prints the way from the wrist's point to the disk's
/// centre, with what the touches leave; with -c it goes to a new file beside the calibration.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The touches
    #[arg(value_name = "TOUCHES.toml")]
    touches: PathBuf,

    /// Add the result to this calibration, in a new file
    #[arg(long, short = 'c', value_name = "FILE")]
    calibration: Option<PathBuf>,

    /// Date and time of the touches, RFC 3339 [default: now]
    #[arg(long, value_name = "DATE")]
    date: Option<String>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let (block, touches) = read(&arguments.touches, touches::parse)?;
    let named = || format!("cannot find the tip from {}", arguments.touches.display());
    let fit = locate(&block, &touches).into_diagnostic().wrap_err_with(named)?;
    let record = TipRecord::from(&fit);
    let ([x, y], [x_sd, y_sd]) = (record.offset_mm, record.sigma_mm);
    say!("tip      ({x:.3} ± {x_sd:.3}, {y:.3} ± {y_sd:.3}) mm from the wrist's point, the wrist's axes");
    if block.is_sought {
        let (place, turn) = (fit.block.translation.vector * 1e3, fit.block.rotation.angle().to_degrees());
        say!("block    at ({:.3}, {:.3}) mm, turned {turn:.3}°", place.x, place.y);
    }
    say!("left     {:.3} mm rms, of {} touches", record.rms_mm, record.touches);
    if let Some(path) = &arguments.calibration {
        let named = || format!("cannot use the calibration {}", path.display());
        let (mut file, _) = CalibrationFile::read(path).advised().wrap_err_with(named)?;
        file.tip = Some(record);
        file.measured_with.date = arguments.date.clone().unwrap_or_else(calibrate::now);
        let written = save_beside(path, &file).advised()?;
        for lacking in file.lacks() {
            note!("the calibration does not have the {lacking} yet");
        }
        say!("written  {}", written.display());
    }
    Ok(ExitCode::SUCCESS)
}
