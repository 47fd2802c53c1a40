//! What the tool tells beside its answers, and where: warnings and crash reports on standard error, answers on standard
//! output.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use palpate_files::solve::{Kind, Problem, Registry, SolveError};
use serde_json::{Value, json};

use crate::PALPATE;

/// The simulated finger of these tests, and its calibration's.
const DEVICE: &str = "sim:5";

/// What is said of a calibration whose raw file is gone.
const NO_RAW_SAMPLES: &str = "its raw samples do not lie beside it";

fn palpate(arguments: &[&str]) -> Command {
    let mut command = Command::new(PALPATE);
    command.args(arguments).stdin(Stdio::null());
    for variable in ["PALPATE_DEVICE", "PALPATE_CALIBRATION", "RUST_LOG"] {
        command.env_remove(variable);
    }
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A calibration of the simulated finger, as a person makes it.
fn calibration(folder: &Path) -> PathBuf {
    let output = palpate(&["calibrate", "-d", DEVICE, "--load", "2 N", "--contacts", "8", "--out"])
        .arg(folder)
        .output()
        .unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    let said = text(&output.stdout);
    PathBuf::from(said.lines().find_map(|line| line.strip_prefix("written")).unwrap().trim())
}

/// A look at the finger with that calibration, which ends by itself.
fn monitor(calibration: &Path, set_up: impl Fn(&mut Command)) -> Output {
    let arguments = ["monitor", "--json", "--print-hz", "5", "--tare", "0.2", "--seconds", "0.5", "-d", DEVICE, "-c"];
    let mut command = palpate(&arguments);
    command.arg(calibration);
    set_up(&mut command);
    let output = command.output().unwrap();
    assert!(output.status.success(), "{}", text(&output.stderr));
    output
}

#[test]
fn a_calibration_without_its_raw_samples_is_used_with_a_warning_that_quiet_leaves_out() {
    let folder = tempfile::tempdir().unwrap();
    let calibration = calibration(folder.path());
    let whole = monitor(&calibration, |_| ());
    assert!(!text(&whole.stderr).contains("warning"), "{}", text(&whole.stderr));
    std::fs::remove_file(calibration.with_extension("csv")).unwrap();

    let warned = monitor(&calibration, |_| ());
    let said = text(&warned.stderr);
    let line = said.lines().find(|line| line.contains(NO_RAW_SAMPLES)).unwrap_or_else(|| panic!("{said}"));
    // Plain text where it is no terminal; which calibration it is about.
    assert!(line.starts_with("warning: calibration /") && !said.contains('\u{1b}'), "{said}");
    for answer in text(&warned.stdout).lines() {
        assert!(serde_json::from_str::<Value>(answer).is_ok(), "{answer}");
    }

    let quiet = monitor(&calibration, |command| _ = command.arg("-q"));
    assert_eq!(text(&quiet.stderr), "");
    let less = monitor(&calibration, |command| _ = command.env("RUST_LOG", "error"));
    assert!(!text(&less.stderr).contains(NO_RAW_SAMPLES), "{}", text(&less.stderr));
}

#[test]
fn verbose_tells_what_happens_and_the_command_line_outweighs_the_environment() {
    let said = |arguments: &[&str]| {
        let output = palpate(arguments).env("RUST_LOG", "error").output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stderr)
    };
    assert_eq!(said(&["info", "-d", DEVICE]), "");
    let told = said(&["info", "-d", DEVICE, "-v"]);
    assert!(told.starts_with("info: sim:5: device ") && !told.contains("debug: "), "{told}");
    assert!(said(&["-vv", "info", "-d", DEVICE]).contains("debug: palpate_device::session: "));
}

#[test]
fn a_filter_in_the_environment_that_cannot_be_read_is_told() {
    let output = palpate(&["tables"]).env("RUST_LOG", "palpate=loud").output().unwrap();
    assert!(output.status.success());
    assert!(
        text(&output.stderr).starts_with("warning: RUST_LOG=palpate=loud cannot be read"),
        "{}",
        text(&output.stderr)
    );
}

/// A kind of problem whose solver crashes. None that the tool has is known to.
#[derive(serde::Deserialize, schemars::JsonSchema)]
#[serde(deny_unknown_fields)]
struct Crash {}

impl Problem for Crash {
    const KIND: &'static str = "crash";
    type Answer = Value;

    fn solve(&self) -> Result<Value, SolveError> {
        panic!("index 7 is out of bounds")
    }
}

/// Set for the process that crashes.
const CRASHING: &str = "PALPATE_TEST_CRASHES";

/// The tool's own messages and the tool's own solving, in a process of their own, with a kind that the tool does not have.
#[test]
fn a_crash_of_a_solver_is_reported_on_standard_error_and_answered_on_standard_output() {
    if std::env::var_os(CRASHING).is_some() {
        // From here on messages are told as the tool tells them.
        palpate_cli::run(["palpate", "tables"]);
        let registry = Registry::new(const { &[Kind::of::<Crash>()] });
        let input = b"{\"problem\": \"fly\"}\n{\"problem\": \"crash\", \"id\": 3}\n";
        let mut answers = Vec::new();
        palpate_files::solve::run(registry, NonZeroUsize::MIN, &input[..], &mut answers).unwrap();
        let crashed: Value = serde_json::from_str(text(&answers).lines().nth(1).unwrap()).unwrap();
        assert_eq!((&crashed["id"], &crashed["error"]["code"]), (&json!(3), &json!("internal")), "{crashed}");
        return;
    }
    let me = "warnings::a_crash_of_a_solver_is_reported_on_standard_error_and_answered_on_standard_output";
    let mut command = Command::new(std::env::current_exe().unwrap());
    let command = command.args(["--exact", me, "--nocapture"]).env(CRASHING, "").env_remove("RUST_LOG");
    let output = command.output().unwrap();
    let said = text(&output.stderr);
    assert!(output.status.success(), "{said}");
    let report = said.lines().find(|line| line.starts_with("error: line 2: the solver crashed at "));
    let report = report.unwrap_or_else(|| panic!("{said}"));
    assert!(report.contains("warnings.rs:") && report.ends_with(": index 7 is out of bounds"), "{said}");
}
