//! `palpate calibrate`.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{SystemTime, UNIX_EPOCH};

use miette::{IntoDiagnostic, WrapErr};
use nalgebra::Vector2;
use palpate::FingerMotion;
use palpate::finger::calibration::dwell::Refusal;
use palpate::finger::calibration::plan::{CalibrationPlan, Step, TareMode};
use palpate::finger::calibration::session::{
    Bench, BenchError, CalibrationRun, Ending, SampleSource, StepSummary, Taken, Wish,
};
use palpate::finger::calibration::{FrontEndSettings, Load, session};
use palpate::pushing::wave::swings;
use palpate_device::Session;
use palpate_files::calibration::carried::WaveRecord;
use palpate_files::calibration::conclusion::{Conclusion, HELD_BACK_ERROR_MAX_DEG, conclude};
use palpate_files::calibration::file::{
    CalibrationFile, CalibrationFileError, save_completed, save_raw, save_result, save_unfinished,
};
use palpate_files::calibration::plan::from_toml;
use palpate_files::calibration::raw::{Provenance, RawRun};
use palpate_files::motion;

use super::device::DeviceArguments;
use super::read::{read, read_text};
use super::wave;
use crate::advice::{self, Advise as _};
use crate::live::person::Person;
use crate::live::{self, GAUGE_FACTOR, LinkSource, SimulatedBench, interrupt};
use crate::progress::Progress;

/// Finds the finger's matrix from contacts at known angles, step by step.
///
/// Every step says what to set up, waits for Enter, and accepts the reading by itself once it is at rest. Contacts kept
/// out of the fit judge the result; it is written only if they are felt where they are. See calibration/PROCEDURE.md.
#[derive(Clone, Debug, clap::Args)]
pub(crate) struct Arguments {
    /// Name of the finger: letters, digits, - and _; results go to a folder of that name
    #[arg(long, value_name = "NAME", default_value = "finger-a")]
    finger: String,

    /// Contacts evenly all round
    #[arg(long, value_name = "N", default_value_t = 12, value_parser = clap::value_parser!(u32).range(4..=360), conflicts_with = "plan")]
    contacts: u32,

    /// Load of every contact: "2 N", "204 g" hung, "same" (one weight nobody weighed) or "unknown"
    #[arg(long, value_name = "LOAD", default_value = "unknown", conflicts_with = "plan")]
    load: Load,

    /// Tare once before and once after instead of before each contact: for an upright finger that does not turn
    #[arg(long, conflicts_with = "plan")]
    tare_once: bool,

    /// Take contacts, loads and settings from this plan instead
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,

    /// Print the plan as a file to start from, and stop
    #[arg(long)]
    print_plan: bool,

    /// Fit kept raw samples again instead of taking new ones; the result goes beside them
    #[arg(long, value_name = "FILE", conflicts_with_all = ["plan", "keep", "out"])]
    from_raw: Option<PathBuf>,

    /// Keep the raw samples of the accepted steps when the run is stopped with `q`; a run that ends otherwise always
    /// leaves them
    #[arg(long)]
    keep: bool,

    /// Largest error of a held-back contact, degrees
    #[arg(long, value_name = "DEG", default_value_t = HELD_BACK_ERROR_MAX_DEG)]
    max_error_deg: f64,

    /// Wave the finger too once it is calibrated, as `palpate wave` does: what it weighs on itself goes into the result. The
    /// motion is that of `palpate wave --print-motion`, or --wave-motion
    #[arg(long, conflicts_with = "from_raw")]
    wave: bool,

    /// How the finger is waved: a motion file, as for `palpate observe` [default: five swings along each axis]
    #[arg(long, value_name = "MOTION.toml", requires = "wave")]
    wave_motion: Option<PathBuf>,

    /// Gauge factor from the gauges' data sheet
    #[arg(long, value_name = "GF", default_value_t = GAUGE_FACTOR)]
    gauge_factor: f64,

    /// Temperature of the finger, °C, for the record [default: what the board's sensor says, if it has one]
    #[arg(long, value_name = "CELSIUS")]
    temperature_c: Option<f64>,

    /// Folder of the results
    #[arg(long, value_name = "DIR", default_value = "calibration")]
    out: PathBuf,

    /// Date and time of the run, RFC 3339 [default: now]
    #[arg(long, value_name = "DATE")]
    date: Option<String>,

    #[command(flatten)]
    device: DeviceArguments,
}

/// A device that is ready to stream.
pub(crate) struct Device<'a> {
    /// The samples that it streams.
    pub(crate) source: &'a mut dyn SampleSource,
    /// Its name, as it gives it.
    pub(crate) name: String,
    /// Its sampling rate, Hz.
    pub(crate) rate_hz: f64,
    /// Gain of its front-end.
    pub(crate) gain: u8,
    /// Voltage across its bridges, V.
    pub(crate) excitation_v: f64,
    /// Input of its converter at full scale and gain 1, V.
    pub(crate) full_scale_v: f64,
    /// Temperature there, °C, where it is known.
    pub(crate) temperature_c: Option<f64>,
}

/// Fits kept samples, or takes new ones: with a person at the terminal, or with the hand of a device simulated here.
pub(crate) fn run(arguments: &Arguments) -> miette::Result<ExitCode> {
    if let Some(path) = &arguments.from_raw {
        return recalculate(arguments, path);
    }
    let plan = arguments.plan()?;
    if arguments.print_plan {
        super::write_out(format_args!("{}", toml::to_string(&plan).into_diagnostic()?));
        return Ok(ExitCode::SUCCESS);
    }
    let wave = arguments.wave_motion()?;
    let mut link = arguments.device.open(true)?;
    if link.is_simulated() {
        note!("{}", super::simulated_note(&link).trim_end());
    }
    let (hello, hand) = (link.hello().clone(), link.simulated().cloned());
    let temperature_c = match arguments.temperature_c {
        Some(celsius) => Some(celsius),
        None => live::temperature(&mut link).advised()?,
    };
    let device = Device {
        source: &mut LinkSource::new(&mut link),
        name: hello.device.to_string(),
        rate_hz: f64::from(hello.rate_hz),
        gain: hello.gain,
        excitation_v: f64::from(hello.excitation_mv) * 1e-3,
        full_scale_v: f64::from(hello.full_scale_uv) * 1e-6,
        temperature_c,
    };
    let written = match hand {
        Some(hand) => {
            note!("a simulated hand sets every angle exactly: a reduced chi² near 0 is right for it");
            let mut bench = SimulatedBench::new(&hand, SIMULATED_FORCE_N, tell_step);
            calibrate(arguments, &plan, device, &mut Shown { bench: &mut bench, sampling: None })
        }
        None => {
            let mut person = Person::new(io::stdin().lock(), io::stderr(), |refusal| advice::help(refusal));
            calibrate(arguments, &plan, device, &mut Shown { bench: &mut person, sampling: None })
        }
    }?;
    let Some(path) = written else { return Ok(ExitCode::FAILURE) };
    if let Some(motion) = wave {
        add_wave(&mut link, &path, &motion)
            .wrap_err_with(|| format!("{} is written, but has no wave: palpate wave -c {0} adds it", path.display()))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// The last step: the finger is waved in the air, and what it weighs on itself goes into the result.
fn add_wave(link: &mut Session, path: &Path, motion: &FingerMotion) -> miette::Result<()> {
    let (mut file, _) = CalibrationFile::read(path).advised()?;
    if link.simulated().is_none() {
        note!(
            "the wave: put the finger on its robot, free in the air. Press Enter, then let the robot make the motion within \
             {WAVE_WAIT_S} s; s and Enter leaves it out"
        );
        let mut answer = String::new();
        let read = io::stdin().read_line(&mut answer).into_diagnostic()?;
        if read == 0 || answer.trim().eq_ignore_ascii_case("s") {
            note!("the finger was not waved: palpate wave -c {} does it later", path.display());
            return Ok(());
        }
        link.forget_waiting();
    }
    let waved = wave::take(link, &file, motion, WAVE_WAIT_S)?;
    let kept = wave::keep(path, &file, motion, waved.samples)?;
    let fit = wave::identified(&file, &waved.readings, motion)?;
    wave::report(&fit, Vector2::zeros());
    file.wave = Some(WaveRecord { raw: Some(kept), ..WaveRecord::from(&fit) });
    save_completed(path, &file).advised()?;
    say!("added    the wave, to {}", path.display());
    Ok(())
}

/// In this time a wave is to begin, s.
const WAVE_WAIT_S: f64 = 5.0;

/// Force with which a simulated hand presses where the plan leaves it open, N.
const SIMULATED_FORCE_N: f64 = 2.0;

/// A bench with the person told that samples are being taken, while they are.
struct Shown<'a> {
    bench: &'a mut dyn Bench,
    sampling: Option<Progress>,
}

impl Shown<'_> {
    fn begin(&mut self, what: &str, wish: Result<Wish, BenchError>) -> Result<Wish, BenchError> {
        let samples = matches!(wish, Ok(Wish::Sample));
        self.sampling = samples.then(|| Progress::begin(what));
        wish
    }
}

impl Bench for Shown<'_> {
    fn place(&mut self, step: &Step, number: usize, of: usize) -> Result<Wish, BenchError> {
        self.sampling = None;
        let wish = self.bench.place(step, number, of);
        self.begin(&format!("step {number} of {of}, sampling until it is at rest"), wish)
    }

    fn accepted(&mut self, step: &Step, summary: &StepSummary) {
        self.sampling = None;
        self.bench.accepted(step, summary);
    }

    fn refused(&mut self, step: &Step, refusal: &Refusal) -> Result<Wish, BenchError> {
        self.sampling = None;
        let wish = self.bench.refused(step, refusal);
        self.begin("sampling once more", wish)
    }
}

/// Says what a simulated hand did.
fn tell_step(step: &Step, outcome: Result<&StepSummary, &Refusal>) {
    match outcome {
        Ok(summary) => note!("[simulated hand] {}: accepted after {:.1} s", step.prompt(), summary.waited_s),
        Err(refusal) => note!("[simulated hand] {}: {refusal}", step.prompt()),
    }
}

/// Takes the plan's contacts on any bench, fits, judges and writes; where the result is, or none where it was stopped.
pub(crate) fn calibrate(
    arguments: &Arguments,
    plan: &CalibrationPlan,
    device: Device<'_>,
    bench: &mut dyn Bench,
) -> miette::Result<Option<PathBuf>> {
    let mut provenance = Provenance {
        device: device.name,
        finger: arguments.finger.clone(),
        date: arguments.date.clone().unwrap_or_else(now),
        temperature_c: device.temperature_c,
        rate_hz: device.rate_hz,
        front_end: FrontEndSettings {
            gain: device.gain,
            excitation_v: device.excitation_v,
            full_scale_v: device.full_scale_v,
            gauge_factor: arguments.gauge_factor,
        },
    };
    // Whatever is wrong with names, settings and folders is said before a quarter of an hour of work, not after.
    check_writable(&arguments.out.join(&provenance.finger))?;
    let settings = plan.dwell_settings(provenance.check().advised()?, provenance.rate_hz).advised()?;
    let mut run = CalibrationRun::new(plan.steps(), settings);
    let mut unfinished = Unfinished::new(&arguments.out, &provenance, plan);
    let ending = session::run_keeping(&mut run, device.source, bench, &mut |taken| unfinished.keep(taken));
    provenance.date = arguments.date.clone().unwrap_or_else(now);
    let raw = RawRun::new(provenance, plan.clone(), run.taken());
    match ending {
        Ok(Ending::Complete) => match save_raw(&arguments.out, &raw) {
            Ok(raw_path) => {
                unfinished.remove();
                conclude_and_write(arguments, &raw, &raw_path)
            }
            Err(error) => Err(not_kept(arguments, &raw, &unfinished, error)),
        },
        Ok(Ending::Quit) => {
            keep_if_wished(arguments, &raw)?;
            unfinished.remove();
            note!("stopped after {} of {} steps; no calibration written", raw.dwells.len(), run.len());
            Ok(None)
        }
        Err(error) => Err(match &unfinished.kept {
            Some(_) => advice::report(error).wrap_err(unfinished.in_words()),
            None => advice::report(error),
        }),
    }
}

/// A whole run that could not be written where it should: what it says is shown, and its samples go where there is room.
fn not_kept(
    arguments: &Arguments,
    raw: &RawRun,
    unfinished: &Unfinished<'_>,
    error: CalibrationFileError,
) -> miette::Report {
    let elsewhere = std::env::temp_dir();
    let kept = match save_raw(&elsewhere, raw) {
        Ok(path) => format!(
            "the samples are kept in {}: move them to {} and run `palpate calibrate --from-raw` on them",
            path.display(),
            arguments.out.join(&raw.provenance.finger).display()
        ),
        Err(_) if unfinished.kept.is_some() => unfinished.in_words(),
        Err(_) => format!("the samples could be kept neither there nor in {}", elsewhere.display()),
    };
    if let Ok(conclusion) = conclude(raw) {
        super::write_out(format_args!("{conclusion}"));
    }
    advice::report(error).wrap_err(kept)
}

/// The samples of a run that is not over, on disk after every step: a killed program or a pulled cable loses none.
struct Unfinished<'a> {
    root: &'a Path,
    provenance: Provenance,
    plan: &'a CalibrationPlan,
    /// Where they are, and of how many steps.
    kept: Option<(PathBuf, usize)>,
    /// Whether the last attempt failed.
    fails: bool,
}

impl<'a> Unfinished<'a> {
    fn new(root: &'a Path, provenance: &Provenance, plan: &'a CalibrationPlan) -> Self {
        Self { root, provenance: provenance.clone(), plan, kept: None, fails: false }
    }

    /// Keeps what was taken so far. A failure is said once and is no reason to stop: the end of the run writes again.
    fn keep(&mut self, taken: &[Taken]) {
        match save_unfinished(self.root, &RawRun::new(self.provenance.clone(), self.plan.clone(), taken)) {
            Ok(path) => {
                self.fails = false;
                self.kept = Some((path, taken.len()));
                interrupt::end_saying(format!("stopped; {}", self.in_words()));
            }
            Err(error) => {
                if !self.fails {
                    tracing::warn!(
                        "the samples so far cannot be kept ({error}); the run goes on, and its end tries again"
                    );
                }
                self.fails = true;
            }
        }
    }

    /// Says what is kept where.
    fn in_words(&self) -> String {
        match &self.kept {
            Some((path, steps)) => {
                format!("the first {} are kept in {}", super::counted(*steps, "step"), path.display())
            }
            None => "nothing is kept".to_owned(),
        }
    }

    /// Removes them: they are not wanted, or in their own file by now.
    fn remove(self) {
        if let Some((path, _)) = self.kept {
            if let Err(error) = fs::remove_file(&path) {
                tracing::warn!("{} is left over and may be removed: {error}", path.display());
            }
            // Only an empty folder goes.
            let _ = path.parent().map(fs::remove_dir);
        }
    }
}

/// Makes sure that results can be written to a folder, and leaves nothing there.
fn check_writable(folder: &Path) -> miette::Result<()> {
    let trial = folder.join(".palpate-can-write");
    let written =
        fs::create_dir_all(folder).and_then(|()| fs::write(&trial, "")).and_then(|()| fs::remove_file(&trial));
    // A folder with results in it stays; that is what this call refuses to remove.
    let _ = fs::remove_dir(folder);
    written
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write results to {}", folder.display()))
        .map_err(|error| error.context("choose another folder with --out"))
}

fn conclude_and_write(arguments: &Arguments, raw: &RawRun, raw_path: &Path) -> miette::Result<Option<PathBuf>> {
    let conclusion = conclude(raw)
        .advised()
        .and_then(|conclusion| judge(arguments, conclusion))
        .wrap_err_with(|| format!("no calibration; the samples are kept in {}", raw_path.display()))?;
    let path = save_result(&arguments.out, &conclusion.fit, &conclusion.taken, &raw.provenance, raw_path).advised()?;
    say!("written  {}\nsamples  {}", path.display(), raw_path.display());
    Ok(Some(path))
}

/// Fits a raw file again. The result goes beside it, under its own date unless another is given.
fn recalculate(arguments: &Arguments, path: &Path) -> miette::Result<ExitCode> {
    let text = read_text(path).wrap_err_with(|| format!("cannot read {}", path.display()))?;
    let named = || format!("cannot calibrate from {}", path.display());
    let raw = RawRun::from_text(&text).advised().wrap_err_with(named)?;
    let conclusion =
        conclude(&raw).advised().and_then(|conclusion| judge(arguments, conclusion)).wrap_err_with(named)?;
    let mut provenance = raw.provenance;
    if let Some(date) = &arguments.date {
        provenance.date.clone_from(date);
    }
    // `<root>/<finger>/<date>.csv`: the raw file stays where it is, and a result names a file in its own folder.
    let folder = path.parent().filter(|folder| folder.ends_with(&provenance.finger));
    let root = folder.and_then(Path::parent);
    let root = root.ok_or_else(|| {
        miette::miette!(
            help = "move it there, so that the result can lie beside it",
            "{} does not lie in a folder named {}",
            path.display(),
            provenance.finger
        )
    })?;
    let written = save_result(root, &conclusion.fit, &conclusion.taken, &provenance, path).advised()?;
    say!("written  {}", written.display());
    Ok(ExitCode::SUCCESS)
}

/// Prints the report and asks the held-back contacts.
fn judge(arguments: &Arguments, conclusion: Conclusion) -> miette::Result<Conclusion> {
    super::write_out(format_args!("{conclusion}"));
    conclusion.judge(arguments.max_error_deg).advised()?;
    Ok(conclusion)
}

fn keep_if_wished(arguments: &Arguments, raw: &RawRun) -> miette::Result<()> {
    if arguments.keep && !raw.dwells.is_empty() {
        let path = save_raw(&arguments.out, raw).advised()?;
        note!("samples  {}", path.display());
    }
    Ok(())
}

impl Arguments {
    /// How the finger is waved, where it is.
    fn wave_motion(&self) -> miette::Result<Option<FingerMotion>> {
        match (&self.wave_motion, self.wave) {
            (Some(path), _) => read(path, motion::parse).map(Some),
            (None, true) => swings(wave::PEAK).into_diagnostic().map(Some),
            (None, false) => Ok(None),
        }
    }

    fn plan(&self) -> miette::Result<CalibrationPlan> {
        let Some(path) = &self.plan else {
            let tare = if self.tare_once { TareMode::Once } else { TareMode::Each };
            return Ok(CalibrationPlan::all_round(self.contacts, self.load, tare));
        };
        let text = read_text(path).wrap_err_with(|| format!("cannot read {}", path.display()))?;
        from_toml(&text).advised().wrap_err_with(|| format!("cannot use {}", path.display()))
    }
}

/// Now, as RFC 3339 in UTC to the second.
pub(super) fn now() -> String {
    // A clock before 1970 is not set at all; the epoch says so plainly.
    let seconds = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    rfc3339(seconds)
}

/// Seconds since 1970 as a date (Howard Hinnant, "chrono-compatible low-level date algorithms", `civil_from_days`).
pub(crate) fn rfc3339(unix_s: u64) -> String {
    const DAYS_0000_TO_1970: u64 = 719_468;
    let (days, second) = (unix_s / 86_400 + DAYS_0000_TO_1970, unix_s % 86_400);
    let (era, day_of_era) = (days / 146_097, days % 146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    // Years begin in March here, so that the leap day is the last.
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = era * 400 + year_of_era + u64::from(month <= 2);
    format!("{year:04}-{month:02}-{day:02}T{:02}:{:02}:{:02}Z", second / 3600, second / 60 % 60, second % 60)
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use palpate::finger::Samples;
    use palpate::finger::calibration::session::{Delivered, SourceError};
    use palpate_files::calibration::file::RawState;
    use palpate_shared::units::Counts;
    use palpate_shared::wire::Status;

    use super::*;

    #[derive(Debug, Parser)]
    struct Line {
        #[command(flatten)]
        arguments: Arguments,
    }

    fn arguments(line: &[&str]) -> Arguments {
        Line::try_parse_from(std::iter::once(&"calibrate").chain(line)).unwrap().arguments
    }

    #[test]
    fn dates_are_those_of_the_calendar() {
        assert_eq!(rfc3339(0), "1970-01-01T00:00:00Z");
        assert_eq!(rfc3339(951_782_400), "2000-02-29T00:00:00Z");
        assert_eq!(rfc3339(1_714_644_900), "2024-05-02T10:15:00Z");
        assert_eq!(rfc3339(4_102_444_799), "2099-12-31T23:59:59Z");
    }

    #[test]
    fn wrong_arguments_are_refused_while_parsing() {
        for line in [
            &["--load", "2 stone"][..],
            &["--contacts", "3"],
            &["--plan", "a", "--load", "2 N"],
            &["--from-raw", "a", "--plan", "b"],
        ] {
            assert!(Line::try_parse_from(std::iter::once(&"calibrate").chain(line)).is_err(), "{line:?}");
        }
    }

    /// A finger whose bridges are its axes: 27 000 counts/N, ±2 codes of a fixed pattern, no noise to speak of.
    struct Ideal {
        force: std::rc::Rc<std::cell::Cell<[f64; 2]>>,
        seq: u64,
    }

    impl SampleSource for Ideal {
        fn next_block(&mut self) -> Result<Delivered, SourceError> {
            let first = self.seq;
            let counts = (0..8_u64).map(|index| {
                let dither = i32::try_from((first + index) * 7 % 5).unwrap() - 2;
                #[expect(clippy::cast_possible_truncation, reason = "far below 2^31")]
                self.force.get().map(|newtons| Counts((27_000.0 * newtons).round() as i32 + dither))
            });
            let counts = counts.collect();
            self.seq += 8;
            let (time_us, status) = (250 * first, Status::default());
            Ok(Delivered::Samples(Samples { first, missing_before: 0, time_us, period_us: 250.0, status, counts }))
        }

        fn discard_waiting(&mut self) -> Result<(), SourceError> {
            Ok(())
        }
    }

    /// Puts 2 N where the step says; stops at step `quits_at`, breaks at `lets_go_at`.
    struct Hand {
        force: std::rc::Rc<std::cell::Cell<[f64; 2]>>,
        quits_at: usize,
        lets_go_at: usize,
        /// From this step on nothing can be written to this folder any more.
        full_at: Option<(usize, PathBuf)>,
    }

    impl Default for Hand {
        fn default() -> Self {
            Self { force: std::rc::Rc::default(), quits_at: usize::MAX, lets_go_at: usize::MAX, full_at: None }
        }
    }

    impl Bench for Hand {
        fn place(&mut self, step: &Step, number: usize, _of: usize) -> Result<Wish, BenchError> {
            self.force.set(match step {
                Step::Tare { .. } => [0.0, 0.0],
                Step::Contact(contact) => {
                    let (sin, cos) = contact.angle_deg.to_radians().sin_cos();
                    [-2.0 * cos, -2.0 * sin]
                }
            });
            if let Some((_, folder)) = self.full_at.take_if(|(full_at, _)| number >= *full_at) {
                fs::rename(&folder, folder.with_extension("moved")).unwrap();
                fs::write(&folder, "in the way").unwrap();
            }
            match number {
                _ if number >= self.lets_go_at => Err(BenchError("the hand let go".to_owned())),
                _ if number >= self.quits_at => Ok(Wish::Quit),
                _ => Ok(Wish::Sample),
            }
        }

        fn accepted(&mut self, _step: &Step, _summary: &StepSummary) {}

        fn refused(&mut self, _step: &Step, refusal: &Refusal) -> Result<Wish, BenchError> {
            Err(BenchError(refusal.to_string()))
        }
    }

    fn go(line: &[&str], mut hand: Hand) -> miette::Result<Option<PathBuf>> {
        let arguments = arguments(line);
        let device = Device {
            source: &mut Ideal { force: hand.force.clone(), seq: 0 },
            name: "palpate-0001".to_owned(),
            rate_hz: 4000.0,
            gain: 32,
            excitation_v: 2.5,
            full_scale_v: 1.2,
            temperature_c: Some(23.5),
        };
        calibrate(&arguments, &arguments.plan()?, device, &mut hand)
    }

    #[test]
    fn a_whole_run_writes_a_calibration_that_recalculates() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        go(&["--load", "2 N", "--out", out, "--date", "2024-05-02T10:15:00Z"], Hand::default()).unwrap();
        let (file, state) = CalibrationFile::read(&folder.path().join("finger-a/2024-05-02T101500Z.toml")).unwrap();
        assert_eq!(state, RawState::Verified);
        assert!((file.matrix[0][0] - 27_000.0).abs() < 10.0, "{:?} counts/N", file.matrix);
        let raw = folder.path().join("finger-a/2024-05-02T101500Z.csv");
        let again = arguments(&["--from-raw", raw.to_str().unwrap(), "--date", "2024-06-01T00:00:00Z"]);
        run(&again).unwrap();
        let (recalculated, _) = CalibrationFile::read(&folder.path().join("finger-a/2024-06-01T000000Z.toml")).unwrap();
        assert_eq!((recalculated.matrix, recalculated.raw.file), (file.matrix, "2024-05-02T101500Z.csv".to_owned()));
        // Under its own date it would replace the first result.
        assert!(run(&arguments(&["--from-raw", raw.to_str().unwrap()])).is_err());
    }

    #[test]
    fn a_stopped_run_leaves_nothing_unless_wished() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        go(&["--out", out], Hand { quits_at: 5, ..Hand::default() }).unwrap();
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        go(&["--out", out, "--keep"], Hand { quits_at: 5, ..Hand::default() }).unwrap();
        let kept: Vec<_> =
            fs::read_dir(folder.path().join("finger-a")).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert_eq!((kept.len(), kept[0].extension().unwrap().to_str()), (1, Some("csv")));
        assert_eq!(RawRun::from_text(&fs::read_to_string(&kept[0]).unwrap()).unwrap().dwells.len(), 4);
    }

    #[test]
    fn samples_outlive_a_run_that_is_not_over() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        let line = ["--out", out, "--date", "2024-05-02T10:15:00Z"];
        let error = go(&line, Hand { lets_go_at: 5, ..Hand::default() }).unwrap_err();
        let kept = folder.path().join("finger-a/2024-05-02T101500Z.unfinished.csv");
        assert!(error.to_string().contains(kept.to_str().unwrap()), "{error}");
        assert_eq!(RawRun::from_text(&fs::read_to_string(&kept).unwrap()).unwrap().dwells.len(), 4);
    }

    #[test]
    fn a_run_that_gives_no_result_leaves_its_samples() {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().to_str().unwrap();
        let line = ["--out", out, "--date", "2024-05-02T10:15:00Z", "--max-error-deg", "0"];
        let error = go(&line, Hand::default()).unwrap_err();
        let names: Vec<_> =
            fs::read_dir(folder.path().join("finger-a")).unwrap().map(|entry| entry.unwrap().file_name()).collect();
        assert_eq!(names, ["2024-05-02T101500Z.csv"], "{error}");
    }

    #[test]
    fn a_run_whose_disk_is_gone_says_where_its_samples_are() {
        let folder = tempfile::tempdir().unwrap();
        let name = format!("test-{}", std::process::id());
        let line = ["--out", folder.path().to_str().unwrap(), "--finger", &name, "--load", "2 N"];
        let full_at = Some((6, folder.path().join(&name)));
        let error = go(&line, Hand { full_at, ..Hand::default() }).unwrap_err().to_string();
        let kept = error.split("kept in ").nth(1).and_then(|rest| rest.split(':').next()).unwrap();
        let raw = RawRun::from_text(&fs::read_to_string(kept).unwrap()).unwrap();
        assert_eq!(raw.dwells.len(), raw.plan.steps().len(), "every step of the run: {error}");
        // What was kept before stays too, and is nobody's waste.
        let moved = folder.path().join(&name).with_extension("moved");
        assert_eq!(fs::read_dir(moved).unwrap().count(), 1);
        fs::remove_dir_all(Path::new(kept).parent().unwrap()).unwrap();
    }

    #[test]
    fn a_bad_name_is_said_before_any_step() {
        let error = go(&["--finger", "a/b"], Hand::default()).unwrap_err();
        assert!(error.to_string().contains("a/b"), "{error}");
    }
}
