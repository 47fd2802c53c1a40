//! `palpate zero-drift`.

use std::process::ExitCode;

use palpate::finger::calibration::zero_drift::{self, RestMean, RestMeans, STRETCH_S};
use palpate::finger::judge::CountsJudge;
use palpate_files::calibration::carried::ZeroDriftRecord;
use palpate_files::calibration::file::save_beside;

use super::calibrated::CalibrationArguments;
use super::device::DeviceArguments;
use super::{calibrate, positive};
use crate::advice::Advise as _;
use crate::live;

const LONG_HELP: &str = "\
The temperature is that of the NTC at the clamp where the converter has one (ADS131M04), else that of the board's own chip,
which is warmer and follows the room. Touch nothing meanwhile. A recording of a finger at rest does as well (-d file:RUN.mcap).

Commands that feel with this calibration then take off what the temperature has changed since the tare, and state what that
leaves uncertain. Forces that the device computes by itself are as before.";

/// Finds how the finger's reading without load goes with temperature, at rest, while the room or the finger warms.
///
/// Half a microstrain per kelvin turns a contact of 2 N by 0.3°. A straight line through means of 5 s finds the coefficient of
/// either bridge, with its uncertainty; it goes to a new file beside the calibration.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// How long to watch, minutes of the finger's time; Ctrl-C ends it earlier
    #[arg(long, value_name = "MINUTES", default_value_t = 60.0, value_parser = positive)]
    minutes: f64,

    /// Write no file
    #[arg(long)]
    dry_run: bool,

    /// Date and time of the result, RFC 3339 [default: now]
    #[arg(long, value_name = "DATE")]
    date: Option<String>,

    /// Print one JSON object instead
    #[arg(long)]
    json: bool,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,
}

/// Seconds in a minute.
const MINUTE_S: f64 = 60.0;

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    live::interrupt::listen();
    arguments.device.begin_recording()?;
    let mut session = arguments.device.open(true)?;
    let (path, mut file) = arguments.calibration.require_file(&session)?;
    let front_end = live::front_end(session.hello()).advised()?;
    // What is known already is not to be taken off.
    let calibration = file.calibration().advised()?.with_zero_drift(None);
    let mut judge = CountsJudge::new(&calibration);
    let (mut means, mut begun) = (RestMeans::default(), None);
    live::start(&mut session).advised()?;
    note!("{}at rest for {} min: keep the finger free", super::simulated_note(&session), arguments.minutes);
    live::judged(&mut session, &mut judge, |session, incoming, judged| {
        super::tell(incoming);
        let celsius = session.temperature_c();
        let mut is_over = false;
        for item in &judged {
            means.take(item, celsius);
            if let Some(t) = item.time() {
                is_over = t - *begun.get_or_insert(t) >= MINUTE_S * arguments.minutes;
            }
        }
        !is_over
    })
    .advised()?;
    session.stop().advised()?;
    // From force back to counts, by the matrix that made it force.
    let matrix = calibration.parts().matrix;
    let counts = |rest: &RestMean| RestMean { counts: matrix * rest.counts, ..*rest };
    let means: Vec<_> = means.means().iter().map(counts).collect();
    let fit = zero_drift::fit(&means).map_err(|error| {
        let help = "watch for longer, while the room warms or cools by a kelvin or more";
        miette::miette!(help = help, "{error}").wrap_err("cannot tell how the zero drifts")
    })?;
    let record = ZeroDriftRecord::new(&fit, &front_end);
    let written = if arguments.dry_run {
        None
    } else {
        file.zero_drift = Some(record);
        file.measured_with.date = arguments.date.clone().unwrap_or_else(calibrate::now);
        Some(save_beside(&path, &file).advised()?)
    };
    if arguments.json {
        say!("{}", serde_json::json!({ "zero_drift": record, "written": written }));
        return Ok(ExitCode::SUCCESS);
    }
    let ([x, y], [x_sd, y_sd]) = (record.microstrain_per_k, record.sigma_microstrain_per_k);
    let ([from, to], [x_left, y_left]) = (record.celsius, record.left_microstrain);
    say!("drift    x {x:+.3} ± {x_sd:.3}, y {y:+.3} ± {y_sd:.3} microstrain/K");
    say!("over     {from:.2} to {to:.2} °C, {} means of {STRETCH_S} s", record.means);
    say!("left     ({x_left:.3}, {y_left:.3}) microstrain rms");
    if let Some(written) = written {
        say!("written  {}", written.display());
    }
    Ok(ExitCode::SUCCESS)
}
