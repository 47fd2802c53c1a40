//! `palpate import` as a user runs it: recorded pushes become files that other commands read.
//!
//! The recordings are `../shared/data/mlab_point_push`, which is not part of the project: where it is absent, these
//! tests say so and check the rest.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use palpate_tests::force_logs;
use serde_json::Value;
use tempfile::TempDir;

use crate::PALPATE;

/// What gaps may leave, m, of all logs together.
const RMS_MAX_M: f64 = 0.45e-3;
/// The disk's place to the side, m, as fits of a model of pushing to the end poses have it, and how far apart the two may
/// be: the fits that leave out one log differ by as much.
const LEFT_M: f64 = -0.88e-3;
const LEFT_APART_M: f64 = 0.1e-3;
/// A log alone may be off by so many of its standard deviations (of a tenth left out).
const SDS: f64 = 3.0;
/// Two readings, s.
const ONSET_S: f64 = 0.021;

fn palpate(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(PALPATE).args(arguments).current_dir(folder).output().unwrap()
}

fn logs() -> Option<Vec<(String, PathBuf)>> {
    let logs = force_logs::logs();
    if logs.is_none() {
        eprintln!("NOT CHECKED: ../shared/data/mlab_point_push is absent, so no real recording was imported");
    }
    logs
}

fn json(output: &Output) -> Value {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn gaps_of_recorded_pushes_tell_where_the_disk_is() {
    let Some(logs) = logs() else { return };
    let folder = TempDir::new().unwrap();
    let files = logs.iter().map(|(_, log)| log.to_str().unwrap());
    let arguments: Vec<_> = ["import", "--format", "mlab", "--json"].into_iter().chain(files).collect();
    let told = json(&palpate(folder.path(), &arguments));
    let number = |value: &Value| value.as_f64().unwrap();
    let tip = &told["tip"];
    assert!(number(&tip["rms"]) < RMS_MAX_M && number(&tip["rms_left_out"]) < RMS_MAX_M, "{tip}");
    assert!(number(&tip["rms_uncalibrated"]) > number(&tip["rms_left_out"]), "{tip}");
    assert!((number(&tip["left"]["value"]) - LEFT_M).abs() < LEFT_APART_M, "{tip}");
    assert!(number(&tip["left"]["sd"]) < LEFT_APART_M, "{tip}");
    for log in told["logs"].as_array().unwrap() {
        let left = &log["tip"]["left"];
        let off = (number(&left["value"]) - LEFT_M) / number(&left["sd"]);
        assert!(off.abs() < SDS, "{log}");
        assert_eq!(log["pushes"], 50);
    }
}

#[test]
fn what_is_imported_is_read_by_other_commands_and_never_overwritten() {
    let Some(logs) = logs() else { return };
    let folder = TempDir::new().unwrap();
    let (name, log) = &logs[0];
    let import = ["import", "--format", "mlab", "--into", "new", log.to_str().unwrap()];
    let output = palpate(folder.path(), &import);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let printed = String::from_utf8(output.stdout).unwrap();
    assert!(printed.contains("left of the logged point") && printed.contains("left out"), "{printed}");
    let made = folder.path().join("new").join(name);
    assert_eq!(fs::read_dir(&made).unwrap().count(), 2 + 2 * 50);

    // The contact of a push alone is that of the push in its log.
    let all = palpate(folder.path(), &["contact", "--json", log.to_str().unwrap()]);
    let of_log: Vec<Value> =
        String::from_utf8(all.stdout).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let mut compared = 0;
    for number in [2, 9, 30] {
        let file = made.join(format!("push-{:02}.force.csv", number + 1));
        let text = fs::read_to_string(&file).unwrap();
        let Some((_, tare)) = text.lines().nth(1).unwrap().split_once("--tare ") else { continue };
        let alone = json(&palpate(folder.path(), &["contact", "--json", "--tare", tare, file.to_str().unwrap()]));
        let onset = |report: &Value| report["onset"].as_f64().unwrap();
        assert!((onset(&alone) - onset(&of_log[number])).abs() < ONSET_S, "{alone}");
        // In the robot's axes both.
        let u = |report: &Value| report["touch"]["u_mean"].as_f64().unwrap();
        let turn = (u(&alone) - u(&of_log[number])).rem_euclid(std::f64::consts::TAU);
        assert!(turn.min(std::f64::consts::TAU - turn) < 0.02, "{alone}");
        compared += 1;
    }
    assert!(compared >= 2, "{compared} pushes begin free");

    let part = made.join("part.toml");
    let pushed = palpate(folder.path(), &["push", part.to_str().unwrap(), "--edge", "0", "--speed-mm-s", "50"]);
    assert!(pushed.status.success(), "{}", String::from_utf8_lossy(&pushed.stderr));

    let before = fs::read(&part).unwrap();
    let again = palpate(folder.path(), &import);
    let complaint = String::from_utf8(again.stderr).unwrap();
    assert_eq!(again.status.code(), Some(1), "{complaint}");
    assert!(complaint.contains("never overwritten") && complaint.contains("--into"), "{complaint}");
    assert_eq!(fs::read(&part).unwrap(), before);
}

#[test]
fn what_cannot_be_imported_is_said_and_nothing_is_written() {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("table.csv"), "t,Fx,Fy\n0,1,2\n").unwrap();
    fs::write(folder.path().join("empty.txt"), "3\n").unwrap();
    let cases =
        [("table.csv", "expected the number of pushes"), ("empty.txt", "none of its 3 pushes"), ("no.txt", "no.txt")];
    for (file, reason) in cases {
        let output = palpate(folder.path(), &["import", "--format", "mlab", "--face", file]);
        let complaint = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(1), "{complaint}");
        assert!(complaint.contains(reason), "{complaint}");
    }
    let wrong = [vec!["table.csv"], vec!["--format", "mlab", "--foot", "1", "table.csv"]];
    for arguments in wrong {
        let arguments: Vec<_> = ["import"].into_iter().chain(arguments).collect();
        assert_eq!(palpate(folder.path(), &arguments).status.code(), Some(64), "{arguments:?}");
    }
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
}
