//! `palpate record`.

use std::path::PathBuf;
use std::process::ExitCode;

use palpate::finger::judge::CountsJudge;
use palpate_device::Incoming;

use super::calibrated::CalibrationArguments;
use super::device::DeviceChoice;
use crate::advice::Advise as _;
use crate::live::{self, interrupt};
use crate::recording;

const LONG_HELP: &str = "\
The file is MCAP, complete after every flush (twice a second), so that neither a crash nor a full disk costs more than
the last second. It plays as a device:
  palpate monitor -d file:run.mcap --json

With a calibration (-c, or the newest of this device under ./calibration) forces are kept beside the bytes, for other tools.
The commands that take samples record themselves with --record, which also keeps what they make of them.";

/// Keeps everything that a device sends in a file, to be played later.
///
/// Exit status: 0, 1 if something cannot be used or the recording ended before its time, 64 wrong command line.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The file, which must not exist
    #[arg(value_name = "RUN.mcap")]
    file: PathBuf,

    /// Keep the force of every sample beside the bytes, not of every block
    #[arg(long)]
    full: bool,

    /// Stop after so many seconds [default: until Ctrl-C]
    #[arg(long, value_name = "S", allow_negative_numbers = true, value_parser = super::positive)]
    seconds: Option<f64>,

    #[command(flatten)]
    device: DeviceChoice,

    #[command(flatten)]
    calibration: CalibrationArguments,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    interrupt::listen();
    recording::begin(&arguments.file, arguments.full)?;
    let mut session = arguments.device.open(true)?;
    let calibration = arguments.calibration.load(&session)?;
    live::start(&mut session).advised()?;
    session.ping().advised()?;
    let until = arguments.seconds.map_or(String::new(), |seconds| format!(" for {seconds} s"));
    note!("{}recording{until}; Ctrl-C ends it", super::simulated_note(&session));
    let (seconds, mut until_s) = (arguments.seconds.unwrap_or(f64::INFINITY), None);
    let mut is_wanted = |incoming: &Incoming| {
        super::tell(incoming);
        if !recording::goes_on() {
            return false;
        }
        let Incoming::Samples(samples) = incoming else { return true };
        let end_s = samples.device_time_s(samples.counts.len());
        let begun_s = samples.device_time_s(0);
        end_s < *until_s.get_or_insert(begun_s + seconds)
    };
    let recorded = match &calibration {
        Some(calibration) => {
            recording::tared(calibration.unit().symbol(), None);
            let mut judge = CountsJudge::new(calibration);
            live::judged(&mut session, &mut judge, |_, incoming, _| is_wanted(incoming))
        }
        None => live::stream(&mut session, |session, incoming| {
            recording::taken(session, incoming, &[]);
            is_wanted(incoming)
        }),
    };
    // Whatever ended it, nobody listens any more.
    let stopped = session.stop();
    recorded.advised()?;
    stopped.advised()?;
    let counts = session.counts();
    note!("{} samples, {} missing, {} damaged frames", counts.samples, counts.missing, counts.damaged_frames);
    if recording::goes_on() {
        Ok(ExitCode::SUCCESS)
    } else {
        Err(miette::miette!("the recording ended before its time"))
    }
}
