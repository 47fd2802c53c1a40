//! A push of a finger whose places were measured instead of told: `palpate observe FORCES --path PATH.csv`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic as _, WrapErr as _};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::dynamics::State;
use palpate::pushing::estimation::from_rest::readings::{
    ForceHypothesis, ForceReading, MeasuredEstimate, MeasuredFinger, SensedPush, estimate_measured_until, sensed,
};
use palpate::pushing::finger_motion::FingerMotion;
use palpate::pushing::measured_path::{MeasuredPath, PLACES_MIN};
use palpate::pushing::measured_turn::MeasuredTurn;
use palpate::pushing::pushed_world::PushedWorld;
use palpate_files::part::PolygonFile;
use palpate_files::recordings::csv::RecordedTable;
use palpate_files::recordings::path::RecordedPath;
use palpate_files::solve::kinds::observe_force::{ForceHypothesisAnswer, OFFSETS_COVERED};
use serde_json::{Value, json};

use super::follow::MotionBegins;
use super::motion_source::AskedMotion;
use super::observed_plot::{self, Heading};
use super::told_tables::TableArguments;
use super::watched_push::{FeltPushArguments, not_at_rest, too_short, without_push};
use super::{finite, not_negative, pose, positive};
use crate::pictures::plot::Figure;
use crate::threads::PATIENT;
use crate::width::folded;

/// Measured places of the finger.
#[derive(Debug, clap::Args)]
pub(super) struct MeasuredMotionArguments {
    /// Measured places of the finger instead of a motion: a table of t, x, y in s and m, and phi in rad where the wrist
    /// turns the disk about its centre and the sensor with it (or as its header says), along
    /// the finger's axes (the robot's, with --mounting-deg), where the disk's centre is without force; 20 a second or more, at
    /// any times. With --method follow also - for rows from standard input as they are measured
    #[arg(long, value_name = "PATH.csv", conflicts_with = "motion")]
    path: Option<PathBuf>,

    /// Standard deviation of one measured coordinate
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 0.02, requires = "path")]
    path_sigma_mm: f64,

    /// By how much the path's clock may be off against the forces', one standard deviation [default: 10]
    #[arg(long, value_name = "MS", value_parser = not_negative, allow_negative_numbers = true, requires = "path")]
    clock_offset_ms: Option<f64>,

    /// What the path's clock shows when that of the forces shows 0: as a robot's pulse on a digital input tells
    /// [default: 0; with --method follow, unless one of these two is said, the motion begins where force is first felt, or
    /// where --motion-begins says]
    #[arg(long, value_name = "S", value_parser = finite, allow_negative_numbers = true, requires = "path")]
    path_clock_s: Option<f64>,
}

/// What the clocks of robot and finger may be off where nothing is said of it, one standard deviation, ms.
const CLOCK_OFFSET_MS: f64 = 10.0;

impl MeasuredMotionArguments {
    /// The file of places, if there is one.
    pub(super) fn path(&self) -> Option<&Path> {
        self.path.as_deref()
    }

    /// The same for who takes places one by one.
    pub(super) fn asked(&self) -> Option<AskedMotion<'_>> {
        Some(AskedMotion::Measured { places: self.path()?, sigma: self.sigma() })
    }

    /// Of one coordinate, m.
    fn sigma(&self) -> f64 {
        self.path_sigma_mm * 1e-3
    }

    /// What the path's clock shows when that of the forces shows 0, s.
    fn clock(&self) -> f64 {
        self.path_clock_s.unwrap_or(0.0)
    }

    /// What it may be off, s.
    fn clock_sd(&self) -> f64 {
        self.clock_offset_ms.unwrap_or(CLOCK_OFFSET_MS) * 1e-3
    }

    /// How clocks are told to tell when the motion of the path begins, if they are.
    pub(super) fn begins(&self) -> Option<MotionBegins> {
        let is_told = self.path_clock_s.is_some() || self.clock_offset_ms.is_some();
        is_told.then(|| MotionBegins::Places { clock: self.clock(), sd: self.clock_sd() })
    }

    fn read(&self, path: &Path, tables: &TableArguments) -> miette::Result<(MeasuredPath, Option<MeasuredTurn>)> {
        let RecordedPath { mut times, places, angles, .. } = tables.places(path)?;
        times.iter_mut().for_each(|time| *time -= self.clock());
        if times.len() < PLACES_MIN {
            let help = "measure twenty places a second or more, from before the push to its end";
            return Err(miette::miette!(
                help = help,
                "{} has {} places: {PLACES_MIN} are needed at least",
                path.display(),
                times.len()
            ));
        }
        let turn = angles.map(|angles| {
            let named = || format!("cannot use phi of {}", path.display());
            MeasuredTurn::new(&times, &angles).into_diagnostic().wrap_err_with(named)
        });
        let turn = turn.transpose()?;
        Ok((MeasuredPath { times, places, sigma: self.sigma() }, turn))
    }
}

/// What the forces and the places of a push have told.
pub(super) struct MeasuredPush {
    estimate: MeasuredEstimate,
    /// The same in the words of `palpate solve`.
    answers: Vec<ForceHypothesisAnswer>,
    /// When the last reading was taken, since the push began, s.
    felt: f64,
    /// What was felt since then.
    readings: Vec<ForceReading>,
    path: MeasuredPath,
    radius: f64,
    /// Whether the push can be played for the picture: a disk that does not turn, and edges.
    is_played: bool,
}

/// The readings for which there are places, wherever the path's clock is.
fn covered(readings: Vec<ForceReading>, path: &MeasuredPath, offset_sd: f64) -> Vec<ForceReading> {
    let beyond = OFFSETS_COVERED * offset_sd;
    let [first, last] = [path.times.first(), path.times.last()].map(|time| time.copied().unwrap_or(f64::NAN));
    let inside = |reading: &ForceReading| first <= reading.time - beyond && reading.time + beyond <= last;
    readings.into_iter().filter(inside).collect()
}

/// Reads forces and places, and seeks what explains them.
pub(super) fn observe(
    file: &PolygonFile,
    forces: &Path,
    path: &Path,
    arguments: &MeasuredMotionArguments,
    tables: &TableArguments,
    felt: FeltPushArguments,
) -> miette::Result<MeasuredPush> {
    let (measured, turn) = arguments.read(path, tables)?;
    if turn.is_some() {
        felt.check_disk()?;
    }
    let named = || format!("cannot use the forces {}", forces.display());
    let RecordedTable { readings, .. } = tables.forces(forces)?;
    let readings: Vec<_> = readings.iter().map(|reading| reading.mounted(felt.mounting())).collect();
    let push = sensed(&readings, felt.tare()).map_err(not_at_rest).wrap_err_with(named)?;
    let SensedPush { readings, noise, lost } = push.ok_or_else(without_push)?;
    if let Some(lost) = lost {
        note!("contact was lost at t = {lost:.3} s; what was felt until then counts");
    }
    let clock_offset_sd = arguments.clock_sd();
    let all = readings.len();
    let readings = covered(readings, &measured, clock_offset_sd);
    if readings.len() < all {
        tracing::warn!(
            "{} of {all} stretches of the force are left out: the path, from {:.3} s to {:.3} s, does not reach {:.0} ms \
             beyond them, which its clock may be off",
            all - readings.len(),
            measured.times[0],
            measured.times[measured.times.len() - 1],
            OFFSETS_COVERED * clock_offset_sd * 1e3
        );
    }
    let motion = FingerMotion::untold();
    let known = felt.with(None).known_of_finger(file, &motion, noise);
    let finger = MeasuredFinger { path: &measured, turn: turn.as_ref(), clock_offset_sd };
    let estimate = estimate_measured_until(&known, &finger, &readings, &PATIENT).found;
    let (Some(onset), Some(last)) = (estimate.onset, readings.last()) else { return Err(too_short()) };
    let answer = |(offset, found): &(f64, ForceHypothesis)| ForceHypothesisAnswer {
        clock_offset: Some(*offset),
        ..ForceHypothesisAnswer::of(found, &known, GRAVITY_ASSUMED, Some(onset))
    };
    let answers = estimate.hypotheses.iter().map(answer).collect();
    let since_onset = |it: &ForceReading| ForceReading { time: it.time - onset, ..*it };
    let felt = last.time - onset;
    let readings = readings.iter().map(since_onset).filter(|reading| reading.time >= 0.0).collect();
    let is_played = turn.is_none() && known.shape.is_none();
    Ok(MeasuredPush { is_played, felt, readings, answers, estimate, radius: known.radius, path: measured })
}

impl MeasuredPush {
    /// For a person: a line for each pose, and what they mean.
    pub(super) fn print(&self, file: &PolygonFile) {
        say!("{}", pose::headings());
        let found: Vec<_> = self.estimate.hypotheses.iter().map(|(_, found)| found).collect();
        pose::lines_of_readings(&file.part, self.felt, &found).iter().for_each(|line| say!("{line}"));
        say!("{}\n{}", pose::legend(&file.part), folded(&self.in_words()));
    }

    fn in_words(&self) -> String {
        let offset = |(offset, _): &(f64, ForceHypothesis)| {
            format!(
                " The path's clock is {:.1} ms {} then.",
                1e3 * offset.abs(),
                if *offset > 0.0 { "early" } else { "late" }
            )
        };
        match self.estimate.hypotheses.as_slice() {
            [] => "No pose of this part explains forces and places together: is it this part, on this face? Are the places \
                   those of the disk's centre along the axes of the force, as exact as --path-sigma-mm says, and by a clock \
                   as near as --clock-offset-ms? Was the part at rest before?"
                .to_owned(),
            [only] => format!("One pose explains forces and places.{}", offset(only)),
            [best, others @ ..] if best.1.probability >= pose::NEARLY_CERTAIN => format!(
                "One pose explains forces and places far best; {} more cannot be excluded, with a probability of {:.1e} \
                 together.{}",
                others.len(),
                1.0 - best.1.probability,
                offset(best)
            ),
            [best, others @ ..] => format!(
                "{} poses explain forces and places and cannot be told apart by them.{}",
                others.len() + 1,
                offset(best)
            ),
        }
    }

    /// What the places say of the finger's motion since the push began, at the clock's offset of the likeliest pose.
    fn motion(&self) -> Option<FingerMotion> {
        let offset = self.estimate.hypotheses.first().map_or(0.0, |(offset, _)| *offset);
        let begun = self.estimate.onset? - offset;
        let fitted = self.path.fitted(begun, &self.path.wandering(begun)?)?;
        fitted.motion([])
    }

    /// A picture of it.
    pub(super) fn figure(&self, file: &PolygonFile, title: String) -> Figure {
        let motion = self.motion().unwrap_or_else(FingerMotion::untold);
        let hypotheses: Vec<_> = self.estimate.hypotheses.iter().map(|(_, found)| found).collect();
        let played = hypotheses.first().filter(|_| self.is_played).and_then(|best| {
            let (part, State { u, s, .. }) = (&file.part, best.start);
            let ForceHypothesis { mu_g, mass, .. } = **best;
            // A contact that never slipped sticks.
            let mu_c = best.mu_c.unwrap_or(1.0);
            let (radius, edge) = (self.radius, part.side(best.edge));
            PushedWorld { part, mu_g, mass, mu_c, radius, motion: &motion, edge, u, s }.play().ok()
        });
        let heading = Heading { title, words: self.in_words() };
        let part = (&file.part, self.radius);
        observed_plot::measured(part, &motion, &self.readings, &hypotheses, played.as_ref(), &heading)
    }

    /// For a program: SI units and radians, as `palpate solve` answers `observe_force`.
    pub(super) fn as_json(&self) -> Value {
        let status = ["none", "unique", "ambiguous"][self.answers.len().min(2)];
        json!({"t": self.felt, "status": status, "hypotheses": self.answers})
    }
}
