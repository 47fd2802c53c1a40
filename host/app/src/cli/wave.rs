//! `palpate wave`.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Vector2;
use palpate::FingerMotion;
use palpate::finger::calibration::ForceUnit;
use palpate::finger::calibration::dwell::RawSample;
use palpate::finger::contact::Reading;
use palpate::finger::judge::{CountsJudge, Judged};
use palpate::pushing::wave::{WaveFit, identify, swings};
use palpate_device::{Incoming, Session};
use palpate_files::calibration::carried::{ComplianceRecord, WaveRecord};
use palpate_files::calibration::file::{CalibrationFile, RawRecord, save_beside, save_raw_wave};
use palpate_files::calibration::raw_wave::{RawWave, samples_of};
use palpate_files::motion;
use palpate_files::recordings::csv::RecordedTable;
use palpate_shared::sim::Load;

use super::calibrated::CalibrationArguments;
use super::device::DeviceArguments;
use super::read::read;
use super::told_tables::TableArguments;
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

    /// Identify kept raw samples of a wave again (DATE.wave.csv, which has its motion) instead of taking new ones; needs -c
    #[arg(long, value_name = "FILE", conflicts_with_all = ["forces", "motion", "device", "baud", "record", "speed"])]
    #[arg(requires = "calibration")]
    from_raw: Option<PathBuf>,

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

    /// Date and time of the wave, RFC 3339 [default: now]
    #[arg(long, value_name = "DATE")]
    date: Option<String>,

    #[command(flatten)]
    device: DeviceArguments,

    #[command(flatten)]
    calibration: CalibrationArguments,

    #[command(flatten)]
    tables: TableArguments,
}

/// Fastest acceleration of the swings where nothing is said of it, m/s²: 3 cm to the side, and 70 mN of a finger of 23 g.
pub(super) const PEAK: f64 = 3.0;

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
    let raw = arguments.from_raw.as_deref().map(|path| read(path, RawWave::from_text)).transpose()?;
    let motion = raw.as_ref().map_or_else(|| arguments.motion(), |raw| Ok(raw.motion.clone()))?;
    if arguments.print_motion {
        super::write_out(format_args!("{}", motion::to_text(&motion)));
        return Ok(ExitCode::SUCCESS);
    }
    let (path, mut file, waved) = match (&arguments.forces, &raw) {
        (Some(forces), _) => {
            let RecordedTable { readings, .. } = arguments.tables.forces(forces)?;
            let (path, file) = arguments.calibration.named()?;
            (path, file, Waved { readings, samples: Vec::new() })
        }
        (None, Some(raw)) => {
            let (path, file) = arguments.calibration.named()?;
            let readings = judged_again(raw, &file)?;
            (path, file, Waved { readings, samples: Vec::new() })
        }
        (None, None) => arguments.record(&motion)?,
    };
    file.measured_with.date = arguments.date.clone().unwrap_or_else(calibrate::now);
    let kept = match (&arguments.from_raw, waved.samples.is_empty()) {
        // It lies where it lay.
        (Some(from), _) => file.wave.as_ref().and_then(|wave| wave.raw.clone()).filter(|raw| from.ends_with(&raw.file)),
        (None, true) => None,
        (None, false) => Some(keep(&path, &file, &motion, waved.samples)?),
    };
    let fit = identified(&file, &waved.readings, &motion)
        .wrap_err("the wave does not tell the finger's mass; no calibration was written")?;
    report(&fit, arguments.gravity.into());
    file.wave = Some(WaveRecord { raw: kept, ..WaveRecord::from(&fit) });
    if let Some(compliance) = arguments.compliance()? {
        say!(
            "compliance       {:.2} ± {:.2} µm/N{}",
            compliance.um_per_n,
            compliance.sigma_um_per_n,
            if compliance.loads > 0 { "" } else { ", as stated" }
        );
        file.compliance = Some(compliance);
    }
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
    fn record(&self, motion: &FingerMotion) -> miette::Result<(PathBuf, CalibrationFile, Waved)> {
        interrupt::listen();
        let mut session = self.device.open(true)?;
        let (path, file) = self.calibration.require_file(&session)?;
        let waved = take(&mut session, &file, motion, self.wait)?;
        Ok((path, file, waved))
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

/// A finger that is let go of has rung out after so long, s: by 1/e in 43 ms.
const RUNG_OUT_S: f64 = 0.5;

/// What a finger felt that was waved.
pub(super) struct Waved {
    pub(super) readings: Vec<Reading>,
    /// The same as counts; none of forces from a file.
    pub(super) samples: Vec<RawSample>,
}

/// What a finger feels while it is waved: by the hand of a device simulated here, or within so many seconds by a robot.
pub(super) fn take(
    session: &mut Session,
    file: &CalibrationFile,
    motion: &FingerMotion,
    wait_s: f64,
) -> miette::Result<Waved> {
    let mut judge = CountsJudge::new(&file.calibration().advised()?);
    if let Some(hand) = session.simulated() {
        hand.set_load(Load::Released).into_diagnostic()?;
        live::start(session).advised()?;
        let mut first = None;
        live::judged(session, &mut judge, |_, _, judged| {
            let now = judged.last().and_then(Judged::time);
            first = first.or(now);
            now.zip(first).is_none_or(|(now, first)| now < first + RUNG_OUT_S)
        })
        .advised()?;
        session.stop().advised()?;
        session.forget_waiting();
    }
    live::start(session).advised()?;
    let seconds = motion.duration() + wait_s;
    match session.simulated().cloned() {
        Some(hand) => {
            note!("{}[simulated hand] waves the finger", super::simulated_note(session));
            hand.set_course(in_the_air(motion)).into_diagnostic()?;
        }
        None => note!("recording for {seconds:.1} s: begin the motion within {wait_s:.1} s, in the air"),
    }
    let (mut waved, mut first) = (Waved { readings: Vec::new(), samples: Vec::new() }, None);
    live::judged(session, &mut judge, |_, incoming, judged| {
        super::tell(incoming);
        if let Incoming::Samples(block) = incoming {
            waved.samples.extend(samples_of(block));
        }
        let now = judged.last().and_then(Judged::time);
        waved.readings.extend(judged.into_iter().filter_map(Judged::reading));
        first = first.or(now);
        now.zip(first).is_none_or(|(now, first)| now < first + seconds)
    })
    .advised()?;
    session.stop().advised()?;
    Ok(waved)
}

/// Keeps a wave's raw samples beside the calibration, under its date.
pub(super) fn keep(
    path: &Path,
    file: &CalibrationFile,
    motion: &FingerMotion,
    samples: Vec<RawSample>,
) -> miette::Result<RawRecord> {
    let wave = RawWave { provenance: file.measured_with.clone(), motion: motion.clone(), samples };
    let kept = save_raw_wave(path, &wave).advised()?;
    say!("samples          {}", path.with_file_name(&kept.file).display());
    Ok(kept)
}

/// Readings of kept samples by a calibration.
fn judged_again(raw: &RawWave, file: &CalibrationFile) -> miette::Result<Vec<Reading>> {
    let told =
        [(&raw.provenance.device, &file.measured_with.device), (&raw.provenance.finger, &file.measured_with.finger)];
    if let Some((of_wave, of_calibration)) = told.into_iter().find(|(a, b)| a != b) {
        let help = "name a calibration of the finger that was waved";
        return Err(miette::miette!(help = help, "the wave is of {of_wave}, the calibration of {of_calibration}"));
    }
    let mut judge = CountsJudge::new(&file.calibration().advised()?);
    Ok(raw
        .blocks()
        .iter()
        .flat_map(|block| judge.judge(block).filter_map(Judged::reading).collect::<Vec<_>>())
        .collect())
}

/// The finger's mass by a wave.
pub(super) fn identified(
    file: &CalibrationFile,
    readings: &[Reading],
    motion: &FingerMotion,
) -> miette::Result<WaveFit> {
    if file.unit != ForceUnit::Newton {
        return Err(miette::miette!(
            help = "calibrate with a weight that was weighed, such as --load \"204 g\"",
            "the calibration's force is relative, and a mass needs newtons"
        ));
    }
    identify(readings, motion).into_diagnostic()
}

/// What was found, for a person to judge.
pub(super) fn report(fit: &WaveFit, gravity: Vector2<f64>) {
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
