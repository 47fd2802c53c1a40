//! `palpate contact`: the contact sense on force recordings.

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use clap::ValueEnum;
use miette::{Context, IntoDiagnostic, miette};
use nalgebra::Matrix2;
use palpate::finger::contact::friction::{FrictionUnknown, SlidingFriction};
use palpate::finger::contact::offline::{BiasOrigin, RecordingStart};
use palpate::finger::contact::{Averaging, ContactSettings};
use palpate_files::recordings::csv::RecordedTable;
use palpate_files::recordings::part::RecordedPart;
use palpate_files::recordings::session::{
    self, CONE_DEG, COVERAGE, RecordingOptions, RecordingReport, RecordingSummary, START_FORCE_N,
};
use palpate_files::recordings::{Format, RecordingProblem, friction, mlab, stamped, text};
use serde::Serialize;

use super::read::report_problems;
use super::told_tables::TableArguments;
use crate::advice;
use crate::width::folded;

/// Exit status when every file was read, but not every line or push in them.
const EXIT_SOME_BAD: u8 = 2;
/// Most pushes that a summary lists by number.
const NUMBERS_SHOWN: usize = 20;
/// How far `--sensor-frame` times its transpose may be from the identity: three digits in each number.
const ORTHOGONAL: f64 = 1e-2;

/// Says when, where and how hard the finger was touched, from recordings of its force.
///
/// Reads any table of `t, Fx, Fy` and the pushing logs of CMU's Manipulation Lab. The exit status is 0 if all could be
/// read, 2 if lines or pushes had to be skipped, 1 if a file gave nothing.
#[derive(Debug, clap::Args)]
pub(crate) struct Arguments {
    /// The recordings.
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// The files' format.
    #[arg(long, value_enum, default_value_t = FormatChoice::Auto)]
    format: FormatChoice,
    /// Print one JSON object a push (or table) instead of a table.
    #[arg(long)]
    json: bool,
    /// With `--json`: add every reading.
    #[arg(long, requires = "json")]
    series: bool,
    /// Write every reading to this new CSV file: file, push, time, force, direction and its uncertainty.
    #[arg(long, value_name = "FILE")]
    csv_out: Option<PathBuf>,
    /// A stretch without contact, in s after the first reading, from which to take the bias. Without it the bias is
    /// found by comparing pushes with their neighbours in time; a single table has none.
    #[arg(long, value_name = "T0:T1")]
    tare: Option<Span>,
    /// Friction coefficient between finger and part, at most. Without it that of a pushing log is found from the pushes
    /// in which the finger slid along an edge, with what it scatters; a table's intervals then hold noise alone.
    #[arg(long, value_name = "MU", allow_negative_numbers = true, value_parser = super::not_negative)]
    mu_c: Option<f64>,
    /// Polar angle in finger axes that shall read 0.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true, value_parser = super::finite)]
    mounting_deg: f64,
    /// Average readings over this time; 20 ms is one mains period at 50 Hz.
    #[arg(long, value_name = "MS")]
    average_ms: Option<f64>,
    /// Difference from its neighbours with which a push began in contact, N.
    #[arg(long, value_name = "N", default_value_t = START_FORCE_N)]
    start_force: f64,
    /// Outline of the pushed part (`obj_geo_*.txt`). Without it the file of that name in the log's folder or the one
    /// above is used.
    #[arg(long, value_name = "FILE")]
    part: Option<PathBuf>,
    /// Half angle about the edge's inward normal in which the force is expected.
    #[arg(long, value_name = "DEGREES", default_value_t = CONE_DEG)]
    cone_deg: f64,
    /// Matrix, by rows, that turns the file's force components into finger axes. Pushing logs have their own, tables
    /// are in finger axes already.
    #[arg(long, value_name = "XX,XY,YX,YY", allow_hyphen_values = true)]
    sensor_frame: Option<SensorFrame>,
    #[command(flatten)]
    tables: TableArguments,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum FormatChoice {
    Auto,
    Mlab,
    Csv,
}

/// `T0:T1` in s.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Span([f64; 2]);

impl FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (from, to) = text.split_once(':').ok_or("expected two times with a colon between, like 0:1.2")?;
        let time = |field: &str| field.trim().parse::<f64>().map_err(|_| format!("`{field}` is not a time in s"));
        let span = [time(from)?, time(to)?];
        if span.iter().all(|t| t.is_finite()) && span[0] < span[1] {
            Ok(Self(span))
        } else {
            Err(format!("the stretch {text} must end after it begins"))
        }
    }
}

/// An orthogonal matrix by rows.
#[derive(Clone, Copy, Debug, PartialEq)]
struct SensorFrame(Matrix2<f64>);

impl FromStr for SensorFrame {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let number = |field: &str| field.trim().parse::<f64>().map_err(|_| format!("`{field}` is not a number"));
        let values = text.split(',').map(number).collect::<Result<Vec<_>, _>>()?;
        let [xx, xy, yx, yy] = values[..] else {
            return Err(format!("{} numbers, where 4 are needed: XX,XY,YX,YY", values.len()));
        };
        let matrix = Matrix2::new(xx, xy, yx, yy);
        if (matrix * matrix.transpose() - Matrix2::identity()).amax() <= ORTHOGONAL {
            Ok(Self(matrix))
        } else {
            Err("the rows must have length 1 and be at right angles, so that newtons stay newtons".to_owned())
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    if let Some(folder) = arguments.files.iter().find(|file| file.is_dir()) {
        return Err(miette!(
            help = format!("name its files, for example {}/*.txt", folder.display()),
            "{} is a folder",
            folder.display()
        ));
    }
    let mut csv_out = arguments.csv_out.as_deref().map(SeriesFile::create).transpose()?;
    let mut all = Vec::new();
    let mut some_bad = false;
    for file in &arguments.files {
        let measured =
            feel(file, arguments).wrap_err_with(|| format!("cannot read contact from {}", file.display()))?;
        some_bad |= measured.report_problems(file);
        if let Some(out) = &mut csv_out {
            out.write(file, &measured.reports)?;
        }
        print(file, &measured, arguments).or_else(ignore_closed_pipe).into_diagnostic()?;
        all.extend(measured.reports);
    }
    if !arguments.json && arguments.files.len() > 1 {
        print_summary(&RecordingSummary::of(&all), None, arguments).or_else(ignore_closed_pipe).into_diagnostic()?;
    }
    Ok(if some_bad { ExitCode::from(EXIT_SOME_BAD) } else { ExitCode::SUCCESS })
}

/// Whoever reads our output may stop (`| head`): then this ends.
fn ignore_closed_pipe(error: io::Error) -> io::Result<()> {
    if error.kind() == io::ErrorKind::BrokenPipe { std::process::exit(super::EXIT_BROKEN_PIPE) } else { Err(error) }
}

/// What a file gave.
struct FileReports {
    reports: Vec<RecordingReport>,
    problems: Vec<String>,
    force_unit: &'static str,
    friction: Friction,
}

/// What is known of the friction between finger and part.
#[derive(Clone, Copy, Debug, Serialize)]
#[serde(tag = "from", rename_all = "snake_case")]
enum Friction {
    /// As `--mu-c` says.
    Given { mu_c: f64 },
    /// From pushes that slid.
    Slips {
        #[serde(flatten)]
        found: SlidingFriction,
    },
    /// Nothing: intervals hold noise alone.
    Unknown {
        /// Pushes that slid, where that could be seen.
        slid: usize,
    },
}

impl Friction {
    /// The coefficient within which the normal is taken to be.
    fn cone(&self) -> f64 {
        match self {
            Self::Given { mu_c } => *mu_c,
            Self::Slips { found } => found.cone(),
            Self::Unknown { .. } => 0.0,
        }
    }
}

impl std::fmt::Display for Friction {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Given { mu_c } => write!(f, "mu_c {mu_c}, as told"),
            Self::Slips { found: SlidingFriction { mu_c, edge, slid } } => write!(
                f,
                "mu_c {:.3} ± {:.3} from {slid} pushes that slid; 95 % of them below {:.2} ± {:.2}",
                mu_c.value, mu_c.sd, edge.value, edge.sd
            ),
            Self::Unknown { slid } => write!(f, "mu_c unknown, taken as 0: {}", FrictionUnknown { slid: *slid }),
        }
    }
}

impl FileReports {
    /// Prints what was skipped; whether anything was.
    fn report_problems(&self, file: &Path) -> bool {
        report_problems(file, &self.problems);
        !self.problems.is_empty()
    }
}

fn feel(file: &Path, arguments: &Arguments) -> miette::Result<FileReports> {
    if stamped::is_mcap(file) {
        return feel_table(&arguments.tables.forces(file)?, arguments);
    }
    let bytes = fs::read(file).into_diagnostic()?;
    let text = text(&bytes).map_err(|error| miette!("{error}"))?;
    let is_mlab = match arguments.format {
        FormatChoice::Auto => Format::detect(&text) == Format::Mlab,
        choice => choice == FormatChoice::Mlab,
    };
    if is_mlab { feel_log(file, &text, arguments) } else { feel_table(&arguments.tables.forces_of(&text)?, arguments) }
}

fn feel_log(file: &Path, text: &str, arguments: &Arguments) -> miette::Result<FileReports> {
    let log = mlab::parse(text).map_err(|error| miette!("{error}"))?;
    let part = arguments.part.clone().or_else(|| outline_near(file));
    let options = RecordingOptions { part: part.as_deref().map(read_part).transpose()?, ..options(arguments, true) };
    let mut reports = session::of_log(&log, &options).map_err(|error| miette!("{error}"))?;
    let friction = match (arguments.mu_c, friction::of_reports(&reports)) {
        (Some(mu_c), _) => Friction::Given { mu_c },
        (None, Ok(found)) => Friction::Slips { found },
        (None, Err(FrictionUnknown { slid })) => Friction::Unknown { slid },
    };
    if arguments.mu_c.is_none() {
        friction::widen(&mut reports, friction.cone());
    }
    let mut problems: Vec<String> = log.bad().map(ToString::to_string).collect();
    if log.declared != log.pushes.len() {
        problems.push(format!("{} pushes announced, {} found", log.declared, log.pushes.len()));
    }
    Ok(FileReports { reports, problems, force_unit: "N", friction })
}

fn feel_table(table: &RecordedTable, arguments: &Arguments) -> miette::Result<FileReports> {
    let report = session::of_table(table, &options(arguments, false)).map_err(|error| miette!("{error}"))?;
    let problems = table.problems.iter().map(RecordingProblem::to_string).collect();
    let friction = arguments.mu_c.map_or(Friction::Unknown { slid: 0 }, |mu_c| Friction::Given { mu_c });
    let force_unit = if table.force_in_newtons { "N" } else { "units" };
    Ok(FileReports { reports: vec![report], problems, force_unit, friction })
}

fn options(arguments: &Arguments, is_log: bool) -> RecordingOptions {
    let settings = ContactSettings {
        mounting_angle: arguments.mounting_deg.to_radians(),
        contact_friction: arguments.mu_c.unwrap_or(0.0),
        averaging: arguments.average_ms.map_or(Averaging::Off, |ms| Averaging::Seconds(ms * 1e-3)),
        ..ContactSettings::default()
    };
    let usual = if is_log { session::MLAB_TOOL_FROM_SENSOR } else { Matrix2::identity() };
    RecordingOptions {
        settings,
        finger_from_sensor: arguments.sensor_frame.map_or(usual, |frame| frame.0),
        tare: arguments.tare.map(|span| span.0),
        start_force: arguments.start_force,
        part: None,
        cone: arguments.cone_deg.to_radians(),
    }
}

pub(super) fn read_part(file: &Path) -> miette::Result<RecordedPart> {
    let bytes = fs::read(file).into_diagnostic().wrap_err_with(|| format!("cannot read {}", file.display()))?;
    let text = text(&bytes).map_err(|error| miette!("{}: {error}", file.display()))?;
    RecordedPart::parse(&text).map_err(|error| miette!("{}: {error}", file.display()))
}

/// The only `obj_geo_*.txt` in the log's folder or, failing that, the one above.
pub(super) fn outline_near(log: &Path) -> Option<PathBuf> {
    let folder = log.parent()?;
    [folder.to_owned(), folder.join("..")].iter().find_map(|folder| {
        let is_outline = |path: &PathBuf| {
            let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
            name.starts_with("obj_geo_") && path.extension().is_some_and(|extension| extension == "txt")
        };
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let mut outlines = fs::read_dir(folder).ok()?.filter_map(|entry| Some(entry.ok()?.path())).filter(is_outline);
        let first = outlines.next()?;
        outlines.next().is_none().then_some(first)
    })
}

fn print(file: &Path, measured: &FileReports, arguments: &Arguments) -> io::Result<()> {
    if arguments.json {
        return measured.reports.iter().try_for_each(|report| print_json(file, measured, report, arguments.series));
    }
    let mut out = io::stdout().lock();
    writeln!(out, "{} (forces in {})", file.display(), measured.force_unit)?;
    writeln!(
        out,
        "{:>4} {:<7} {:>7} {:>8} {:>8} {:>6} {:<11} {:>5} {:>5} {:>6} {:>4}",
        "push", "start", "onset s", "bias x", "bias y", "±", "bias from", "F", "max", "u [°]", "±"
    )?;
    for report in &measured.reports {
        writeln!(out, "{}", Line(report))?;
    }
    drop(out);
    if measured.reports.len() > 1 {
        print_summary(&RecordingSummary::of(&measured.reports), Some(&measured.friction), arguments)
    } else {
        Ok(())
    }
}

#[derive(Serialize)]
struct JsonReport<'a> {
    file: &'a Path,
    force_unit: &'a str,
    friction: &'a Friction,
    #[serde(flatten)]
    report: &'a RecordingReport,
    #[serde(skip_serializing_if = "Option::is_none")]
    series: Option<&'a [session::Row]>,
}

fn print_json(file: &Path, measured: &FileReports, report: &RecordingReport, with_series: bool) -> io::Result<()> {
    let series = with_series.then_some(report.series.as_slice());
    let mut out = io::stdout().lock();
    serde_json::to_writer(
        &mut out,
        &JsonReport { file, force_unit: measured.force_unit, friction: &measured.friction, report, series },
    )?;
    writeln!(out)
}

/// One report in one line.
struct Line<'a>(&'a RecordingReport);

impl std::fmt::Display for Line<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let report = self.0;
        let start = match report.start {
            RecordingStart::Free if report.start_doubtful => "free?",
            RecordingStart::Free => "free",
            RecordingStart::InContact => "contact",
            RecordingStart::Unknown => "unknown",
        };
        let onset = report.onset.map_or("-".to_owned(), |onset| format!("{onset:.3}"));
        write!(f, "{:>4} {start:<7} {onset:>7} ", report.index)?;
        let Some(bias) = &report.bias else {
            let Some(unknown) = &report.bias_unknown else { return write!(f, "bias unknown") };
            let help = advice::help(unknown).map(|help| format!("; {help}")).unwrap_or_default();
            return write!(f, "\n{}", folded(&format!("     {unknown}{help}")));
        };
        let (tare, found) = (&bias.tare, found(bias.found, report));
        write!(f, "{:>8.4} {:>8.4} {:>6.4} {found:<11} ", tare.bias.x, tare.bias.y, tare.bias_sd())?;
        let Some(touch) = &report.touch else { return write!(f, "no contact") };
        let (u, u_sd) = (touch.u_mean.to_degrees(), touch.u_sd_median.to_degrees());
        write!(f, "{:>5.2} {:>5.2} {u:>6.1} {u_sd:>4.2}", touch.force_mean, touch.force_max)?;
        let Some(edge) = &report.edge else { return Ok(()) };
        let (median, worst) = (edge.angle_median.to_degrees(), edge.angle_worst.to_degrees());
        let share = percent(edge.within_cone, edge.samples);
        write!(f, "\n     edge {}: {median:.1}° from its normal (worst {worst:.0}°, {share} in the cone)", edge.edge)
    }
}

fn found(found: BiasOrigin, report: &RecordingReport) -> String {
    match found {
        BiasOrigin::Given => "given".to_owned(),
        BiasOrigin::OwnFreeInterval => {
            let free = report.bias.as_ref().map_or(0.0, |bias| bias.tare.t_to - bias.tare.t_from);
            format!("{free:.2} s free")
        }
        BiasOrigin::Neighbours { before, after, .. } => {
            let number = |push: Option<usize>| push.map_or("-".to_owned(), |push| push.to_string());
            format!("{} and {}", number(before), number(after))
        }
    }
}

fn percent(part: usize, whole: usize) -> String {
    format!("{:.1} %", 100.0 * part as f64 / whole.max(1) as f64)
}

/// Sums up one file, of which this is known of the friction, or all.
fn print_summary(summary: &RecordingSummary, friction: Option<&Friction>, arguments: &Arguments) -> io::Result<()> {
    let is_one_file = friction.is_some();
    let of = if is_one_file { "this file" } else { "all files" };
    let mut out = io::stdout().lock();
    let list = |numbers: &[usize]| numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ");
    let listed = |numbers: &[usize]| (1..=NUMBERS_SHOWN).contains(&numbers.len()) && is_one_file;
    writeln!(out, "{of}: {} recordings", summary.recordings)?;
    for (what, numbers) in [
        ("began in contact", &summary.began_in_contact),
        ("began free, but perhaps touched (free?)", &summary.start_doubtful),
        ("bias unknown", &summary.bias_unknown),
        ("never touched", &summary.never_touched),
    ] {
        let which = if listed(numbers) { format!(" (push {})", list(numbers)) } else { String::new() };
        writeln!(out, "  {what}: {}{which}", numbers.len())?;
    }
    if summary.halves > 0 {
        let (halves, worst) = (summary.halves, summary.half_difference_max);
        writeln!(
            out,
            "  bias from the first half of the free time against the second's mean: worst {worst:.4} of {halves}"
        )?;
    }
    if let Some(chi) = summary.half_difference_chi {
        writeln!(out, "    mean square in stated standard deviations: {chi:.2} (1 if the tare's covariance is right)")?;
        let share = percent(summary.free_within, summary.free_samples);
        writeln!(out, "    free readings within 2 stated standard deviations: {share} (Gaussian: 86.5 %)")?;
    }
    if summary.edge_samples > 0 {
        let (n, cone) = (summary.edge_samples, arguments.cone_deg);
        writeln!(out, "  readings in contact with a known edge: {n}")?;
        writeln!(out, "    within ±{cone}° of its inward normal: {}", percent(summary.edge_within_cone, n))?;
        let (stated, coverage) = (percent(summary.edge_within_stated, n), COVERAGE * 100.0);
        if let Some(friction) = friction {
            writeln!(out, "    {friction}")?;
        }
        writeln!(out, "    normal in the stated {coverage:.0} % interval: {stated}")?;
        let gap = summary.gap_end_mean.unwrap_or(f64::NAN) * 1e3;
        writeln!(out, "    tip's centre from the edge at the end: mean {gap:.2} mm")?;
    }
    Ok(())
}

/// The file of all readings.
struct SeriesFile {
    out: io::BufWriter<fs::File>,
    path: PathBuf,
}

impl SeriesFile {
    fn create(path: &Path) -> miette::Result<Self> {
        let place = || format!("cannot write {}", path.display());
        // A file that is there stays as it is: it may be the recording itself.
        let file = fs::File::create_new(path).into_diagnostic().wrap_err_with(place)?;
        let mut series = Self { out: io::BufWriter::new(file), path: path.to_owned() };
        let heading = "file,push,t [s],Fx,Fy,u [rad],u_sd [rad],u_half_width [rad],magnitude,magnitude_sd,angle_to_normal [rad],edge";
        writeln!(series.out, "{heading}").into_diagnostic().wrap_err_with(place)?;
        Ok(series)
    }

    fn write(&mut self, file: &Path, reports: &[RecordingReport]) -> miette::Result<()> {
        let written = reports.iter().try_for_each(|report| self.report(file, report)).and_then(|()| self.out.flush());
        written.into_diagnostic().wrap_err_with(|| format!("cannot write {}", self.path.display()))
    }

    fn report(&mut self, file: &Path, report: &RecordingReport) -> io::Result<()> {
        let name = file.display().to_string().replace('"', "\"\"");
        for row in &report.series {
            let [fx, fy] = row.force_finger;
            write!(self.out, "\"{name}\",{},{:.6},{fx:.6},{fy:.6}", report.index, row.t)?;
            match &row.touch {
                None => writeln!(self.out, ",,,,,,,")?,
                Some(touch) => {
                    write!(self.out, ",{:.6},{:.6},{:.6}", touch.u, touch.u_sd, touch.u_half_width)?;
                    let angle = touch.angle_to_normal.map(|angle| format!("{angle:.6}")).unwrap_or_default();
                    let edge = touch.edge.map(|edge| edge.to_string()).unwrap_or_default();
                    writeln!(self.out, ",{:.6},{:.6},{angle},{edge}", touch.magnitude, touch.magnitude_sd)?;
                }
            }
        }
        Ok(())
    }
}
