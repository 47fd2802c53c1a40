//! Rolling on a palm that moves otherwise than steadily: as `palpate solve` does, and felt again from the contacts.

use std::fs;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};

use serde_json::{Value, json};

use crate::PALPATE;

const BODY: &str = "unit = 'mm'\nshape = 'ellipsoid'\nsemi_axes = [20, 30, 40]\n";
const SHAKEN: &str = "unit = 'mm'\n[[harmonic]]\namplitude = [900, 400, 0]\nfrequency_hz = 2\nphase_deg = 60\n";

fn palpate(folder: &Path, words: &[&str], input: &str) -> (String, String) {
    let mut child = Command::new(PALPATE)
        .args(words)
        .current_dir(folder)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // Who ends early, as on a wrong command line, need not read.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    let output = child.wait_with_output().unwrap();
    (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("body.toml"), BODY).unwrap();
    fs::write(folder.path().join("shaken.toml"), SHAKEN).unwrap();
    folder
}

const ROLL: [&str; 6] = ["roll", "body.toml", "--attitude-deg", "40,20,0", "--turning-deg-s", "200,-250,50"];

#[test]
fn a_shaken_palm_rolls_as_solve_does() {
    let folder = folder();
    let words = [&ROLL[..], &["--palm", "shaken.toml", "--time-s", "0.4", "--rows", "4", "--json"]].concat();
    let rolled: Value = serde_json::from_str(&palpate(folder.path(), &words, "").0).unwrap();
    let first = &rolled["samples"][0];
    let problem = json!({
        "problem": "roll", "body": {"ellipsoid": [0.02, 0.03, 0.04]}, "spin": "free",
        "initial": {"orientation": first["orientation"], "omega": first["omega"], "u": [0, 0]},
        "palm_acceleration": {"harmonic": [
            {"amplitude": [0.9, 0.4, 0], "frequency_hz": 2, "phase": 60_f64.to_radians()}]},
        "times": [0, 0.1, 0.2, 0.3, 0.4],
    });
    let solved: Value = serde_json::from_str(&palpate(folder.path(), &["solve"], &problem.to_string()).0).unwrap();
    let last = |answer: &Value| answer["samples"].as_array().unwrap().last().unwrap()["u"].clone();
    for axis in 0..2 {
        let [here, there] = [&rolled, &solved].map(|answer| last(answer)[axis].as_f64().unwrap());
        assert!((here - there).abs() < 1e-9, "{here} m, {there} m");
    }
}

/// The same motion, shaken: known, the body is found and followed; unknown, nothing explains its contacts for long.
#[test]
fn a_body_on_a_shaken_palm_is_found_by_who_knows_how() {
    let folder = folder();
    let words = [&ROLL[..], &["--palm", "shaken.toml", "--contacts-hz", "500", "--grid-mm", "1"]].concat();
    let (contacts, _) = palpate(folder.path(), &words, "");
    let last_status = |palm: &[&str]| {
        let words = [&["palm", "body.toml", "--grid-mm", "1", "--spin", "free"], palm].concat();
        let (told, _) = palpate(folder.path(), &words, &contacts);
        let statuses = told.lines().map(|line| serde_json::from_str::<Value>(line).unwrap()["status"].clone());
        statuses.map(|status| status.as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    let known = last_status(&["--palm", "shaken.toml"]);
    assert_eq!(known.last().map(String::as_str), Some("tracking"));
    let unknown = last_status(&[]);
    let share =
        |statuses: &[String]| statuses.iter().filter(|status| *status == "tracking").count() * 100 / statuses.len();
    assert!(share(&unknown) + 20 < share(&known), "{} % and {} %", share(&unknown), share(&known));
}

/// The harmonic as an accelerometer has it, a hundred times a second: nearly the same roll, and a word where it ends.
#[test]
fn a_measured_palm_is_nearly_the_true_one() {
    let folder = folder();
    let row = |k: i32| {
        let t = f64::from(k) * 0.01;
        let wave = (std::f64::consts::TAU * 2.0 * t + 60_f64.to_radians()).sin();
        format!("{t},{},{},0\n", 0.9 * wave, 0.4 * wave)
    };
    let table = format!("t,ax,ay,az\n{}", (0..=40).map(row).collect::<String>());
    fs::write(folder.path().join("measured.csv"), table).unwrap();
    let ends = |palm: &str, seconds: &str| {
        let words = [&ROLL[..], &["--palm", palm, "--time-s", seconds, "--json"]].concat();
        let (answer, told) = palpate(folder.path(), &words, "");
        let answer: Value = serde_json::from_str(&answer).unwrap();
        let last = answer["samples"].as_array().unwrap().last().unwrap()["u"].clone();
        ([0, 1].map(|axis| last[axis].as_f64().unwrap()), told)
    };
    let ((truth, _), (measured, quiet)) = (ends("shaken.toml", "0.4"), ends("measured.csv", "0.4"));
    let apart = (truth[0] - measured[0]).hypot(truth[1] - measured[1]);
    assert!(apart < 5e-5 && !quiet.contains("measured up to"), "{apart} m; {quiet}");
    assert!(ends("measured.csv", "0.5").1.contains("measured up to 0.4 s"));
}
