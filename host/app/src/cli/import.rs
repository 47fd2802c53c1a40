//! `palpate import`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::ValueEnum;
use miette::{Context as _, IntoDiagnostic as _, miette};
use nalgebra::Point2;
use palpate::geometry::SimplePolygon;
use palpate::pushing::estimation::slow_pushes::{
    FilterSettings, KnownPush, SlowConstants, Standing, TipFromGaps, tip_from_gaps,
};
use palpate::pushing::wave::Measured;
use palpate_files::output::write_new;
use palpate_files::recordings::export::{self, Pushed};
use palpate_files::recordings::mlab::{self, Log};
use palpate_files::recordings::part::RecordedPart;
use palpate_files::recordings::session::{MLAB_TOOL_FROM_SENSOR, RecordingOptions, of_log};
use palpate_files::recordings::slow_pushes::{of_pushes, standing};
use palpate_files::recordings::text;
use serde_json::{Value, json};

use super::contact::{outline_near, read_part};
use super::positive;
use super::read::report_problems;

/// Exit status when every file was read, but not every push in them.
const EXIT_SOME_BAD: u8 = 2;

const LONG_HELP: &str = "\
Each log gets a folder of its own, named after what the part stood on if its folder is, else after the log:
  part.toml            outline, friction, feet; for `push`, `observe`, `solve`
  poses.csv            of the part's frame, before and after each push
  push-01.force.csv    t, Fx, Fy on the finger; for `contact` and `observe`
  push-01.path.csv     t, x, y of the disk's centre
All are in the robot's frame; t counts from the push's first reading of force. Forces are not tared: each table's comment
says where it is free, as `contact --tare` takes it.

What the part stood on is told by the log's folder, `patch` for its face or x1_x2_x3_y1_y2_y3 for feet in mm, or by --face
or --foot.

From where the logged point was while disk and part touched, before and after each push, follows the disk's place on the
tool, and how far the finger goes on after the log ends. Standard deviations are those of leaving out each tenth of a log;
so is the second rms.

Exit status: 0, 1 if a file gives nothing or something is there already, 2 if pushes had to be skipped, 64 wrong command
line.";

/// Turns recorded pushes into files that the other commands read, and finds the finger's disk on its tool.
///
/// Reads the pushing logs of CMU's Manipulation Lab. Files that are there already are never overwritten: nothing is
/// written then.
#[derive(Debug, clap::Args)]
#[command(after_long_help = super::help::flowing(LONG_HELP))]
pub(crate) struct Arguments {
    /// The logs
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,

    /// The logs' format
    #[arg(long, value_enum)]
    format: ImportFormat,

    /// Folder in which each log's folder is made
    #[arg(long, value_name = "FOLDER", default_value = ".")]
    into: PathBuf,

    /// Outline of the pushed part (`obj_geo_*.txt`) [default: the only one in the log's folder or the one above]
    #[arg(long, value_name = "FILE")]
    part: Option<PathBuf>,

    /// The part stood on its whole face
    #[arg(long, conflicts_with = "foot")]
    face: bool,

    /// A foot that it stood on, in its frame; three or more
    #[arg(long, value_name = "X,Y", value_parser = foot, allow_hyphen_values = true)]
    foot: Vec<[f64; 2]>,

    /// Radius of the finger's disk
    #[arg(long, value_name = "MM", value_parser = positive, default_value_t = 1.0)]
    radius_mm: f64,

    /// Friction between part and plane, for part.toml; logs of a hard board had the default
    #[arg(long, value_name = "MU", value_parser = positive, default_value_t = SlowConstants::BOARD.friction)]
    mu: f64,

    /// Friction between part and finger, for part.toml; logs of a steel tip on aluminium had the default
    #[arg(long, value_name = "MU", value_parser = super::not_negative, default_value_t = SlowConstants::BOARD.contact_friction)]
    mu_c: f64,

    /// Print the disk's place as one JSON object: SI units
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum ImportFormat {
    /// Pushing logs of CMU's Manipulation Lab
    Mlab,
}

/// `X,Y` in mm, as m.
fn foot(text: &str) -> Result<[f64; 2], String> {
    let number = |text: &str| text.trim().parse::<f64>().ok().filter(|number| number.is_finite());
    let (x, y) =
        text.split_once(',').ok_or_else(|| format!("`{text}` is not two numbers with a comma, like 10,130"))?;
    let both = number(x).zip(number(y)).ok_or_else(|| format!("`{text}` is not two numbers in mm"))?;
    Ok([both.0 * 1e-3, both.1 * 1e-3])
}

/// A log that was read.
struct Imported {
    file: PathBuf,
    log: Log,
    part: RecordedPart,
    standing: Standing,
    folder: PathBuf,
    /// Poses are of the outline's centroid.
    outline: SimplePolygon,
    known: Vec<KnownPush>,
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    let ImportFormat::Mlab = arguments.format;
    let mut logs = Vec::new();
    let mut some_bad = false;
    for file in &arguments.files {
        let log = imported(file, arguments).wrap_err_with(|| format!("cannot import {}", file.display()))?;
        let problems: Vec<_> = log.log.bad().map(ToString::to_string).collect();
        report_problems(file, &problems);
        some_bad |= !problems.is_empty();
        logs.push(log);
    }
    apart(&mut logs)?;
    let radius = arguments.radius_mm * 1e-3;
    let found: Vec<_> = logs.iter().map(|log| calibrated(std::slice::from_ref(log), radius)).collect();
    let together = if logs.len() > 1 { calibrated(&logs, radius) } else { found[0].clone() };
    let tip = together.as_ref().map_or([0.0; 2], |tip| [tip.ahead.value, tip.left.value]);
    let files = logs.iter().map(|log| files_of(log, tip, arguments)).collect::<miette::Result<Vec<_>>>()?;
    // All or nothing.
    if let Some((there, _)) = files.iter().flatten().find(|(path, _)| path.exists()) {
        let help = "name another folder with --into, or move what is there";
        return Err(miette!(help = help, "{} exists already and is never overwritten", there.display()));
    }
    for (path, text) in files.iter().flatten() {
        write_new(path, text.as_bytes()).into_diagnostic()?;
    }
    tell(&logs, &found, &together, arguments);
    Ok(if some_bad { ExitCode::from(EXIT_SOME_BAD) } else { ExitCode::SUCCESS })
}

/// Gives logs from one folder a folder each within it.
fn apart(logs: &mut [Imported]) -> miette::Result<()> {
    let folders: Vec<_> = logs.iter().map(|log| log.folder.clone()).collect();
    let count = |folder: &Path| folders.iter().filter(|other| *other == folder).count();
    for (log, folder) in logs.iter_mut().zip(&folders).filter(|(_, folder)| count(folder) > 1) {
        log.folder = folder.join(log.file.file_stem().unwrap_or_default());
    }
    match logs.iter().enumerate().find(|(i, log)| logs[..*i].iter().any(|other| other.folder == log.folder)) {
        Some((_, twice)) => Err(miette!("two logs would go into {}", twice.folder.display())),
        None => Ok(()),
    }
}

fn imported(file: &Path, arguments: &Arguments) -> miette::Result<Imported> {
    let bytes = fs::read(file).into_diagnostic()?;
    let log = mlab::parse(&text(&bytes).map_err(|error| miette!("{error}"))?).map_err(|error| miette!("{error}"))?;
    if log.good().next().is_none() {
        return Err(miette!("none of its {} pushes can be read", log.declared));
    }
    let no_outline = || {
        miette!(
            help = "name it with --part FILE",
            "the part's outline is not known: there is not one `obj_geo_*.txt` in the log's folder or the one above"
        )
    };
    let part = read_part(&arguments.part.clone().or_else(|| outline_near(file)).ok_or_else(no_outline)?)?;
    let vertices: Vec<_> = part.vertices().iter().map(|vertex| Point2::from(*vertex)).collect();
    let polygon = SimplePolygon::new(vertices.clone()).into_diagnostic()?;
    let centre = polygon.centroid();
    let body: Vec<_> = vertices.iter().map(|vertex| Point2::from(vertex - centre)).collect();
    // A path like `log.txt` has no folder's name of its own.
    let canonical = file.canonicalize().into_diagnostic()?;
    let named =
        canonical.parent().and_then(|folder| folder.file_name()).map(|name| name.to_string_lossy().into_owned());
    let told = named.as_deref().map(standing);
    let (standing, name) = match (arguments.face, arguments.foot.as_slice(), told) {
        (true, ..) => (Standing::Face, None),
        (false, [], Some(Ok(standing))) => (standing, named.clone()),
        (false, [], told) => {
            let help = "say what the part stood on: --face, or --foot X,Y for each of three feet or more";
            let why =
                told.and_then(Result::err).map_or_else(|| "the log is in no folder".to_owned(), |why| why.to_string());
            return Err(miette!(help = help, "{why}"));
        }
        (false, feet @ [_, _, _, ..], _) => (Standing::Feet(feet.iter().copied().map(Point2::from).collect()), None),
        (false, feet, _) => return Err(miette!("{} feet, at least 3 are needed", feet.len())),
    };
    let stem = || file.file_stem().map_or_else(|| "log".to_owned(), |stem| stem.to_string_lossy().into_owned());
    let known = of_pushes(&log, centre, &FilterSettings::STANDARD).into_iter().map(|push| push.known).collect();
    Ok(Imported {
        file: file.to_owned(),
        log,
        part,
        standing,
        folder: arguments.into.join(name.unwrap_or_else(stem)),
        outline: SimplePolygon::new(body).into_diagnostic()?,
        known,
    })
}

fn calibrated(logs: &[Imported], radius: f64) -> Result<TipFromGaps, String> {
    if let Some(other) = logs.iter().find(|log| log.outline != logs[0].outline) {
        return Err(format!("{} is of another part", other.file.display()));
    }
    let pushes: Vec<_> = logs.iter().map(|log| log.known.as_slice()).collect();
    tip_from_gaps(&logs[0].outline, radius, &pushes).map_err(|error| error.to_string())
}

/// Paths and texts.
fn files_of(log: &Imported, tip: [f64; 2], arguments: &Arguments) -> miette::Result<Vec<(PathBuf, String)>> {
    let options = RecordingOptions { finger_from_sensor: MLAB_TOOL_FROM_SENSOR, ..RecordingOptions::default() };
    let reports = of_log(&log.log, &options).map_err(|error| miette!("{error}"))?;
    let pushed = Pushed {
        vertices: log.part.vertices(),
        standing: &log.standing,
        mu: arguments.mu,
        mu_c: arguments.mu_c,
        radius: arguments.radius_mm * 1e-3,
    };
    let part = export::part_file(&pushed)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot make a part file of {}", log.file.display()))?;
    let mut files = vec![("part.toml".to_owned(), part), ("poses.csv".to_owned(), export::poses_table(&log.log))];
    for ((push, known), report) in log.log.good().zip(&log.known).zip(&reports) {
        let stem = export::stem(push);
        let force = export::force_table(push, &known.felt, report, &MLAB_TOOL_FROM_SENSOR);
        files.push((format!("{stem}.force.csv"), force));
        files.push((format!("{stem}.path.csv"), export::path_table(push, report.t0, tip)));
    }
    Ok(files.into_iter().map(|(name, text)| (log.folder.join(name), text)).collect())
}

fn tell(
    logs: &[Imported],
    found: &[Result<TipFromGaps, String>],
    together: &Result<TipFromGaps, String>,
    arguments: &Arguments,
) {
    if arguments.json {
        let each = logs.iter().zip(found).map(|(log, found)| {
            json!({"file": log.file, "folder": log.folder, "pushes": log.known.len(), "tip": as_json(found)})
        });
        say!(
            "{}",
            json!({"radius": arguments.radius_mm * 1e-3, "logs": each.collect::<Vec<_>>(), "tip": as_json(together)})
        );
        return;
    }
    for (log, found) in logs.iter().zip(found) {
        say!("{}: {} pushes into {}", log.file.display(), log.known.len(), log.folder.display());
        in_words(found);
    }
    if logs.len() > 1 {
        say!("all logs together");
        in_words(together);
    }
    if together.is_err() {
        note!("the paths are those of the logged point");
    }
}

fn in_words(found: &Result<TipFromGaps, String>) {
    let tip = match found {
        Ok(tip) => tip,
        Err(why) => {
            say!("{}", crate::width::folded(&format!("  the disk's place on the tool is not known: {why}")));
            return;
        }
    };
    let mm = |found: Measured| format!("{:.2} ± {:.2} mm", found.value * 1e3, found.sd * 1e3);
    say!("  disk     {} ahead, {} left of the logged point", mm(tip.ahead), mm(tip.left));
    say!("  end      {} beyond the last logged point", mm(tip.beyond_log));
    let [left, out, raw] = [tip.rms, tip.rms_left_out, tip.rms_uncalibrated].map(|rms| rms * 1e3);
    say!("  gaps     {left:.2} mm rms of {}; left out {out:.2} mm; as logged {raw:.2} mm", tip.gaps);
}

fn as_json(found: &Result<TipFromGaps, String>) -> Value {
    let tip = match found {
        Ok(tip) => tip,
        Err(why) => return json!({"unknown": why}),
    };
    let number = |found: Measured| json!({"value": found.value, "sd": found.sd});
    json!({
        "ahead": number(tip.ahead), "left": number(tip.left), "beyond_log": number(tip.beyond_log),
        "rms": tip.rms, "rms_left_out": tip.rms_left_out, "rms_uncalibrated": tip.rms_uncalibrated, "gaps": tip.gaps,
    })
}
