//! The commands as a person uses them: the real binary, in two terminals, over a real pseudo-terminal.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Output, Stdio};
use std::sync::mpsc::{Receiver, channel};

use palpate_tests::rig::PATIENCE;
use serde_json::Value;

use crate::PALPATE;

/// Exit status of a wrong command line.
const EXIT_USAGE: i32 = 64;

fn palpate(arguments: &[&str]) -> Command {
    let mut command = Command::new(PALPATE);
    command.args(arguments).env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION");
    command
}

fn run(arguments: &[&str]) -> Output {
    palpate(arguments).stdin(Stdio::null()).output().unwrap()
}

pub(super) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// A simulated device in a terminal of its own.
pub(super) struct Terminal {
    child: Child,
    orders: ChildStdin,
    answers: BufReader<ChildStdout>,
    pub(super) path: String,
}

impl Terminal {
    pub(super) fn simulate_device(arguments: &[&str]) -> Self {
        let mut command = palpate(&["simulate-device"]);
        let mut child = command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
        let (orders, mut answers) = (child.stdin.take().unwrap(), BufReader::new(child.stdout.take().unwrap()));
        let mut path = String::new();
        answers.read_line(&mut path).unwrap();
        Self { child, orders, answers, path: path.trim().to_owned() }
    }

    /// Types an order and reads its one-line answer.
    fn order(&mut self, order: &str) -> String {
        writeln!(self.orders, "{order}").unwrap();
        let mut answer = String::new();
        self.answers.read_line(&mut answer).unwrap();
        answer.trim().to_owned()
    }
}

impl Drop for Terminal {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Everything a child writes, a line or prompt at a time, so that a test can wait for a prompt without a line end.
fn pieces(mut from: impl Read + Send + 'static) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let mut buffer = [0; 4096];
        while let Ok(length @ 1..) = from.read(&mut buffer) {
            if sender.send(text(&buffer[..length])).is_err() {
                return;
            }
        }
    });
    receiver
}

/// A person who calibrates: does at the simulated bench what each prompt says, then presses Enter.
fn calibrate_by_hand(device: &mut Terminal, out: &Path) -> (PathBuf, String) {
    let mut child = palpate(&["calibrate", "-d", &device.path, "--load", "2 N", "--contacts", "8", "--out"])
        .arg(out)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut keyboard, screen) = (child.stdin.take().unwrap(), pieces(child.stderr.take().unwrap()));
    let (mut seen, mut done) = (String::new(), 0);
    while let Ok(piece) = screen.recv_timeout(PATIENCE) {
        seen.push_str(&piece);
        while let Some(prompt) = seen[done..].find("q = quit] ") {
            let asked = &seen[done..done + prompt];
            assert!(!asked.contains("refused"), "{seen}");
            let order = match asked.split("load the finger at ").nth(1) {
                Some(rest) => format!("press {} 2", rest.split('°').next().unwrap()),
                None => "release".to_owned(),
            };
            done += prompt + "q = quit] ".len();
            device.order(&order);
            writeln!(keyboard).unwrap();
        }
    }
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{seen}\n{}", text(&output.stdout));
    let report = text(&output.stdout);
    let written = report.lines().find_map(|line| line.strip_prefix("written")).unwrap().trim();
    (PathBuf::from(written), report)
}

#[test]
fn a_person_calibrates_and_then_sees_where_the_finger_is_touched() {
    let folder = tempfile::tempdir().unwrap();
    let mut device = Terminal::simulate_device(&["--as-read", "--seed", "5"]);
    let (calibration, report) = calibrate_by_hand(&mut device, folder.path());
    assert!(report.contains("held back"), "{report}");
    assert!(std::fs::read_to_string(&calibration).unwrap().contains("temperature"), "the board's sensor is on record");
    drop(device);

    // The same finger again, in real time. Pressed evenly it is at rest, and its tare is refused all the same.
    let mut device = Terminal::simulate_device(&["--seed", "5"]);
    let calibration = calibration.to_str().unwrap();
    device.order("press 30 2");
    device.order("wait 1");
    let pressed = run(&["monitor", "--seconds", "0.2", "--tare", "0.5", "-d", &device.path, "-c", calibration]);
    assert_eq!(pressed.status.code(), Some(1));
    let said = text(&pressed.stderr).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("microstrain from where they did") && said.contains("free the finger"), "{said}");
    // Tared free and then pressed.
    device.order("release");
    device.order("wait 1");
    // The device computes the same forces, to the bit.
    let with_forces = ["monitor", "--device-force", "--json", "--seconds", "0.5", "--tare", "0.5"];
    let forces = run(&[&with_forces[..], &["-d", &device.path, "-c", calibration]].concat());
    let said = text(&forces.stderr);
    assert!(forces.status.success() && said.contains(" 0 different, 0 without samples"), "{said}");
    let is_force = |line: &&str| line.contains("\"device_force\"") && line.contains("\"agrees\":true");
    assert!(text(&forces.stdout).lines().filter(is_force).count() > 100, "{}", text(&forces.stdout));
    let mut monitor = palpate(&["monitor", "--json", "--print-hz", "0", "--tare", "0.5", "--mu-c", "0.2"])
        .args(["-d", &device.path, "-c", calibration])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(monitor.stdout.take().unwrap()).lines().map(|line| line.unwrap());
    let first: Value = serde_json::from_str(&lines.next().unwrap()).unwrap();
    assert_eq!((first["contact"].as_bool(), first["simulated"].as_bool()), (Some(false), Some(true)), "{first}");
    assert!(device.order("press -120 2").contains("-120.000 deg"));
    let angle = |line: &str| -> Option<Value> {
        let felt: Value = serde_json::from_str(line).unwrap();
        // Once it presses in full, not while it comes up.
        (felt["magnitude"].as_f64()? > 1.99).then_some(felt)
    };
    let felt = lines.find_map(|line| angle(&line)).unwrap();
    let error_deg = felt["u"].as_f64().unwrap().to_degrees() + 120.0;
    // The beam still rings by some per cent when the force first reaches its size: a degree.
    assert!(error_deg.abs() < 2.0, "{felt}");
    assert!((felt["friction_half_angle"].as_f64().unwrap() - 0.2_f64.atan()).abs() < 1e-12);
    assert!(felt["unix_time"].as_f64().unwrap() > 1.6e9, "host time is Unix time");
    let _ = monitor.kill();
    let _ = monitor.wait();
}

#[test]
fn a_monitor_survives_a_restart_and_tells_a_broken_bridge_from_no_contact() {
    let folder = tempfile::tempdir().unwrap();
    let mut device = Terminal::simulate_device(&["--as-read", "--seed", "6"]);
    let (calibration, _) = calibrate_by_hand(&mut device, folder.path());
    drop(device);
    let mut device = Terminal::simulate_device(&["--seed", "6"]);
    let mut monitor = palpate(&["monitor", "--json", "--print-hz", "50", "--tare", "0.5"])
        .args(["-d", &device.path, "-c", calibration.to_str().unwrap()])
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(monitor.stdout.take().unwrap())
        .lines()
        .map(|line| -> Value { serde_json::from_str(&line.unwrap()).unwrap() });
    let measured = |line: &Value| line["contact"].is_boolean();
    assert!(lines.any(|line| measured(&line)));
    device.order("restart");
    assert!(lines.any(|line| line["device"].as_str().is_some_and(|what| what.contains("started anew"))));
    assert!(lines.any(|line| measured(&line)), "it goes on");
    device.order("fault saturate0");
    assert!(lines.any(|line| line["fault"].as_str().is_some_and(|fault| fault.contains("bridge x"))));
    device.order("fault none");
    assert!(lines.any(|line| measured(&line)), "and on");
    device.order("fault stuck");
    assert!(lines.any(|line| line["fault"].as_str().is_some_and(|fault| fault.contains("repeats"))));
    let _ = monitor.kill();
    let _ = monitor.wait();
}

#[test]
fn output_that_nobody_reads_is_no_crash() {
    for (arguments, status) in
        [(&["demo"][..], Some(141)), (&["ports"][..], None), (&["info", "-d", "sim:"][..], Some(141))]
    {
        let mut child = palpate(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        assert!(!text(&output.stderr).contains("panicked"), "{arguments:?}: {}", text(&output.stderr));
        // As of tools that the system ends; where there are no ports nothing is written.
        assert!(status.is_none() || output.status.code() == status, "{arguments:?}: {:?}", output.status);
    }
}

#[test]
fn info_tells_who_the_device_is_and_that_it_is_simulated() {
    let device = Terminal::simulate_device(&["--seed", "9"]);
    let output = run(&["info", "-d", &device.path, "--register", "0"]);
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    for wanted in ["SIMULATED", "ADS131M02", "4000 Hz, gain 32", "chip identity: ok", "register 0x00"] {
        assert!(said.contains(wanted), "`{wanted}` in:\n{said}");
    }
    let about: Value = serde_json::from_slice(&run(&["info", "--json", "-d", &device.path]).stdout).unwrap();
    assert_eq!((about["simulated"].as_bool(), about["hello"]["rate_hz"].as_u64()), (Some(true), Some(4000)), "{about}");
}

#[test]
fn info_exchanges_raw_frames_with_the_converter() {
    let device = Terminal::simulate_device(&["--seed", "9"]);
    let ask_id = ["--raw-frame", "a000", "--raw-frame", "000000 cc9c00 000000 000000"];
    let output = run(&[&["info", "-d", &device.path], &ask_id[..]].concat());
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    for wanted in ["frame out      a00000 710000 000000 000000", "response 0x2282, codes", "checksum right"] {
        assert!(said.contains(wanted), "`{wanted}` in:\n{said}");
    }
    let json = run(&[&["info", "--json", "-d", &device.path], &ask_id[..]].concat());
    let about: Value = serde_json::from_slice(&json.stdout).unwrap();
    let second = &about["raw_frames"][1];
    assert_eq!((second["response"].as_u64(), second["checksum_fits"].as_bool()), (Some(0x2282), Some(true)), "{about}");
    assert_eq!(run(&["info", "--raw-frame", "a0"]).status.code(), Some(EXIT_USAGE));
}

#[test]
fn diagnose_passes_a_good_finger_and_fails_one_with_a_broken_gauge() {
    let mut device = Terminal::simulate_device(&["--as-read"]);
    let good = run(&["diagnose", "-d", &device.path, "--seconds", "4"]);
    assert!(good.status.success(), "{}{}", text(&good.stdout), text(&good.stderr));
    // Standard output is the findings; what is told meanwhile goes to standard error, and with -q nowhere.
    let (findings, notes) = (text(&good.stdout), text(&good.stderr));
    assert!(
        findings.contains("noise") && !findings.contains("looking at") && !findings.contains("latency"),
        "{findings}"
    );
    assert!(notes.contains("SIMULATED") && notes.contains("looking at") && notes.contains("latency"), "{notes}");
    device.order("fault open0");
    let broken = run(&["diagnose", "-q", "-d", &device.path, "--seconds", "4"]);
    assert_eq!((broken.status.code(), text(&broken.stderr).as_str()), (Some(1), ""));
    let said = text(&broken.stdout);
    assert!(said.contains("FAULT") && said.contains("a gauge or its wire is broken"), "{said}");
}

#[test]
fn a_device_without_a_front_end_says_so_instead_of_streaming_zeros() {
    let mut device = Terminal::simulate_device(&["--as-read"]);
    device.order("fault absent");
    device.order("restart");
    let output = run(&["diagnose", "-d", &device.path, "--seconds", "2"]);
    assert!(!output.status.success());
    assert!(text(&output.stderr).contains("no front-end"), "{}", text(&output.stderr));
}

#[test]
fn a_second_program_on_the_port_is_told_who_has_it() {
    let mut device = Terminal::simulate_device(&[]);
    let mut first =
        palpate(&["diagnose", "--seconds", "60", "-d", &device.path]).stdout(Stdio::null()).spawn().unwrap();
    // The first has the port as soon as it prints; it answers the truth order only for the sake of waiting.
    device.order("wait 1");
    let second = run(&["info", "-d", &device.path]);
    let said = text(&second.stderr);
    let _ = first.kill();
    let _ = first.wait();
    assert!(!second.status.success());
    assert!(said.contains("in use by palpate"), "{said}");
}

#[test]
fn the_demo_of_static_contacts_ends_with_what_a_person_understands() {
    let output = run(&["demo", "--static", "--seed", "3"]);
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    for wanted in ["true", "felt", "error", "noise sd", "thesis", " 0 lost", "Nothing here was measured"] {
        assert!(said.contains(wanted), "`{wanted}` in:\n{said}");
    }
}

#[test]
fn without_a_calibration_the_monitor_says_how_to_get_one() {
    let folder = tempfile::tempdir().unwrap();
    let output = palpate(&["monitor", "-d", "sim:1"]).current_dir(folder.path()).output().unwrap();
    assert!(!output.status.success());
    assert!(text(&output.stderr).contains("palpate calibrate"), "{}", text(&output.stderr));
}

#[test]
fn a_wrong_command_line_ends_with_64_and_help_with_0() {
    let wrong: [(&[&str], &str); 4] = [
        (&["--no-such-option"], "--no-such-option"),
        (&["monitor", "--tare", "-1"], "must be finite and not negative"),
        (&["info", "--register", "300"], "not a register address"),
        (&["dance"], "dance"),
    ];
    for (arguments, reason) in wrong {
        let output = run(arguments);
        assert_eq!(output.status.code(), Some(EXIT_USAGE), "{arguments:?}");
        assert!(text(&output.stderr).contains(reason), "{}", text(&output.stderr));
    }
    for help in [&["--help"][..], &["monitor", "--help"], &["--version"]] {
        assert_eq!(run(help).status.code(), Some(0), "{help:?}");
    }
}

#[test]
fn a_device_name_that_cannot_be_meant_is_explained() {
    let output = run(&["info", "-d", "tcp:nowhere"]);
    let said = text(&output.stderr);
    assert!(!output.status.success());
    assert!(said.contains("tcp:HOST:PORT") && said.contains("help:"), "{said}");
}
