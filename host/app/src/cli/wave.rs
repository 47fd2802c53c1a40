//! `palpate wave`.

use std::path::PathBuf;
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Vector2;
use palpate::FingerMotion;
use palpate::finger::calibration::ForceUnit;
use palpate::finger::contact::Reading;
use palpate::finger::judge::{CountsJudge, Judged};
use palpate::pushing::wave::{WaveFit, identify, swings};
use palpate_device::Session;
use palpate_files::calibration::carried::{ComplianceRecord, WaveRecord};
use palpate_files::calibration::file::{CalibrationFile, save_beside};
use palpate_files::motion;
use palpate_files::recordings::csv::{self, RecordedTable};

use super::calibrated::CalibrationArguments;
use super::device::DeviceArguments;
use super::read::{read, report_problems};
use super::{calibrate, positive};
use crate::advice::Advise as _;
use crate::live::{self, interrupt};
use crate::thesis::demonstration::in_the_air;

/// Finds what the finger weighs on itself, by waving it in the air.
///
/// A finger that accelerates by a reads −m a beside the force of the contact, which `observe` takes out once m, its
/// effective mass, is known. Move the finger as the motion file says, with nothing touching it, while this records: when
/// the motion begins is found. The last third of the motion is foretold from the first two and judges the result, which
/// goes to a new file beside the calibration. A finger simulated here is waved by itself.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Forces on the finger from a file instead of a device: a table of t, Fx, Fy in newtons; needs -c
    #[arg(value_name = "FORCES", conflicts_with_all = ["device", "baud", "record", "speed"], requires = "calibration")]
    forces: Option<PathBuf>,

    /// How the finger moves: a motion file, as for `palpate observe` [default: five swings along each axis]
    #[arg(long, value_name = "MOTION.toml")]
    motion: Option<PathBuf>,

    /// Print the swings as a motion file, for a robot or to edit, and stop
    #[arg(long)]
    print_motion: bool,

    /// Fastest acceleration of the swings, m/s²
    #[arg(long, value_name = "M/S2", default_value_t = PEAK, value_parser = positive, conflicts_with = "motion")]
    peak: f64,

    /// Record for so much longer than the motion lasts, s: the time in which it is to begin
    #[arg(long, value_name = "S", default_value_t = 5.0, value_parser = positive)]
    wait: f64,

    /// Part of gravity across the finger, its axes, m/s²: X,Y of a finger that is mounted tilted. The bias is then told
    /// from its weight
    #[arg(long, value_name = "X,Y", value_parser = pair, allow_hyphen_values = true, default_value = "0,0")]
    gravity: [f64; 2],

    /// How far the tip gives way, as known beforehand: VALUE or VALUE,SIGMA in µm/N (3 EI/ℓ³ from the drawings is good
    /// to a tenth, which is what is taken without SIGMA)
    #[arg(long, value_name = "UM/N", value_parser = compliance)]
    compliance: Option<ComplianceRecord>,

    /// Find it instead: from how far (mm) a clamp was advanced against a rigid block, and the force (N) that was then
    /// felt; three or more of MM:N
    #[arg(long, value_name = "MM:N", num_args = 3.., value_parser = pressed, conflicts_with = "compliance")]
    pressed: Vec<[f64; 2]>,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,

    /// Date and time of the wave, RFC 3339 [default: now]
    #[arg(long, value_name = "DATE")]
    date: Option<String>,
}

/// Fastest acceleration of the swings where nothing is said of it, m/s²: 3 cm to the side, and 70 mN of a finger of 23 g.
const PEAK: f64 = 3.0;

/// Two numbers with a comma between.
fn pair(text: &str) -> Result<[f64; 2], String> {
    two(text, ',').ok_or_else(|| format!("{text:?} is not two numbers with a comma between"))
}

fn two(text: &str, between: char) -> Option<[f64; 2]> {
    let (first, second) = text.split_once(between)?;
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|value| value.is_finite());
    Some([number(first)?, number(second)?])
}

/// A stated compliance.
pub(super) fn compliance(text: &str) -> Result<ComplianceRecord, String> {
    let whole = || text.trim().parse::<f64>().ok().map(|value| [value, STATED_SHARE * value]);
    let [um_per_n, sigma_um_per_n] =
        two(text, ',').or_else(whole).ok_or_else(|| format!("{text:?} is neither VALUE nor VALUE,SIGMA"))?;
    if um_per_n.is_finite() && um_per_n >= 0.0 && sigma_um_per_n >= 0.0 {
        Ok(ComplianceRecord { um_per_n, sigma_um_per_n, loads: 0 })
    } else {
        Err(format!("{text:?} is no compliance: it is 0 or more, and so is its standard deviation"))
    }
}

/// What drawings are good for: a clamp gives way too.
const STATED_SHARE: f64 = 0.1;

fn pressed(text: &str) -> Result<[f64; 2], String> {
    two(text, ':').ok_or_else(|| format!("{text:?} is not MM:N, such as 0.05:1.37"))
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let motion = arguments.motion()?;
    if arguments.print_motion {
        super::write_out(format_args!("{}", motion::to_text(&motion)));
        return Ok(ExitCode::SUCCESS);
    }
    let (path, mut file, readings) = match &arguments.forces {
        Some(forces) => {
            let RecordedTable { readings, problems, .. } = read(forces, csv::parse)?;
            report_problems(forces, &problems);
            let (path, file) = arguments.calibration.named()?;
            (path, file, readings)
        }
        None => arguments.record(&motion)?,
    };
    if file.unit != ForceUnit::Newton {
        return Err(miette::miette!(
            help = "calibrate with a weight that was weighed, such as --load \"204 g\"",
            "the calibration's force is relative, and a mass needs newtons"
        ));
    }
    let fit = identify(&readings, &motion)
        .into_diagnostic()
        .wrap_err("the wave does not tell the finger's mass; nothing was written")?;
    report(&fit, arguments.gravity.into());
    file.wave = Some(WaveRecord::from(&fit));
    if let Some(compliance) = arguments.compliance()? {
        say!(
            "compliance       {:.2} ± {:.2} µm/N{}",
            compliance.um_per_n,
            compliance.sigma_um_per_n,
            if compliance.loads > 0 { "" } else { ", as stated" }
        );
        file.compliance = Some(compliance);
    }
    file.measured_with.date = arguments.date.clone().unwrap_or_else(calibrate::now);
    let written = save_beside(&path, &file).advised()?;
    for lacking in file.lacks() {
        note!("the calibration does not have the {lacking} yet");
    }
    say!("written          {}", written.display());
    Ok(ExitCode::SUCCESS)
}

impl Arguments {
    fn motion(&self) -> miette::Result<FingerMotion> {
        match &self.motion {
            Some(path) => read(path, motion::parse),
            None => swings(self.peak).into_diagnostic(),
        }
    }

    /// The calibration, and what its finger feels while it is waved.
    fn record(&self, motion: &FingerMotion) -> miette::Result<(PathBuf, CalibrationFile, Vec<Reading>)> {
        interrupt::listen();
        let mut session = self.device.open(true)?;
        let (path, file) = self.calibration.require_file(&session)?;
        let calibration = file.calibration().advised()?;
        live::start(&mut session).advised()?;
        let seconds = motion.duration() + self.wait;
        match session.simulated().cloned() {
            Some(hand) => {
                note!("{}[simulated hand] waves the finger", super::simulated_note(&session));
                hand.set_course(in_the_air(motion)).into_diagnostic()?;
            }
            None => note!("recording for {seconds:.1} s: begin the motion within {:.1} s, in the air", self.wait),
        }
        let readings = readings(&mut session, &mut CountsJudge::new(&calibration), seconds)?;
        session.stop().advised()?;
        Ok((path, file, readings))
    }

    /// The compliance that was stated, or a line through what was pressed.
    fn compliance(&self) -> miette::Result<Option<ComplianceRecord>> {
        if self.pressed.is_empty() {
            return Ok(self.compliance);
        }
        let count = self.pressed.len() as f64;
        let mean = |of: fn(&[f64; 2]) -> f64| self.pressed.iter().map(of).sum::<f64>() / count;
        let [way, force] = [mean(|[way, _]| *way), mean(|[_, force]| force.abs())];
        let squares: f64 = self.pressed.iter().map(|[_, f]| (f.abs() - force).powi(2)).sum();
        let products: f64 = self.pressed.iter().map(|[w, f]| (w - way) * (f.abs() - force)).sum();
        let slope = products / squares;
        let left: f64 = self.pressed.iter().map(|[w, f]| (w - way - slope * (f.abs() - force)).powi(2)).sum();
        let sd = (left / (count - 2.0) / squares).sqrt();
        if !(slope > 0.0 && slope.is_finite()) {
            return Err(miette::miette!(
                help = "press with at least three forces that differ, each further than the one before",
                "the presses give no compliance: {slope} mm/N"
            ));
        }
        let [um_per_n, sigma_um_per_n] = [slope, sd].map(|mm| mm * 1e3);
        Ok(Some(ComplianceRecord { um_per_n, sigma_um_per_n, loads: self.pressed.len() }))
    }
}

/// Readings of so many seconds.
fn readings(session: &mut Session, judge: &mut CountsJudge, seconds: f64) -> miette::Result<Vec<Reading>> {
    let (mut readings, mut first) = (Vec::new(), None);
    live::judged(session, judge, |_, incoming, judged| {
        super::tell(incoming);
        let now = judged.last().and_then(Judged::time);
        readings.extend(judged.into_iter().filter_map(Judged::reading));
        first = first.or(now);
        now.zip(first).is_none_or(|(now, first)| now < first + seconds)
    })
    .advised()?;
    Ok(readings)
}

/// What was found, for a person to judge.
fn report(fit: &WaveFit, gravity: Vector2<f64>) {
    let grams = |mass: f64| mass * 1e3;
    say!("effective mass   {:.3} ± {:.3} g", grams(fit.effective_mass.value), grams(fit.effective_mass.sd));
    say!(
        "mounted          the motion's x axis at {:+.2}° ± {:.2}° in the finger's",
        fit.mounting.value.to_degrees(),
        fit.mounting.sd.to_degrees()
    );
    let (bias, sd) = fit.bias(gravity);
    say!("bias             ({:+.4}, {:+.4}) ± {sd:.4} N", bias.x, bias.y);
    say!("left             {:.2} mN of a mean over 40 ms", fit.left * 1e3);
    say!(
        "held back        {} means: {:.2} mN off what the rest foretells, of {:.1} mN of inertia",
        fit.held_back.windows,
        fit.held_back.off * 1e3,
        fit.held_back.inertia * 1e3
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn compliances_are_read_with_and_without_their_deviation() {
        let read = |text: &str| compliance(text).map(|found| [found.um_per_n, found.sigma_um_per_n]);
        assert_eq!(read("36,2"), Ok([36.0, 2.0]));
        let [value, sigma] = read("36").unwrap();
        assert!((value - 36.0).abs() < 1e-12 && (sigma - 3.6).abs() < 1e-12);
        for text in ["", "x", "36,y", "-1", "1,-1", "inf"] {
            assert!(compliance(text).is_err(), "{text}");
        }
    }
}
