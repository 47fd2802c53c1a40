//! How a finger's zero goes with temperature, found at a simulated one, whose room warms and cools by a kelvin in tens of minutes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::PALPATE;
use crate::devices::{Terminal, text};

fn palpate(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.args(words).current_dir(folder).env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION");
    command.stdin(Stdio::null()).output().unwrap()
}

/// The result in this folder.
fn result_in(folder: &Path) -> PathBuf {
    let files = fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    files.max_by_key(|path| (path.extension().is_some_and(|end| end == "toml"), path.clone())).unwrap()
}

#[test]
fn the_coefficients_of_a_simulated_finger_are_found_and_kept_beside_its_calibration() {
    let folder = tempfile::tempdir().unwrap();
    let calibrated =
        palpate(folder.path(), &["calibrate", "-d", "sim:3", "--load", "2 N", "--out", "cal", "--finger", "a"]);
    assert!(calibrated.status.success(), "{}", text(&calibrated.stderr));
    let before = result_in(&folder.path().join("cal/a"));
    let name = before.to_str().unwrap();
    // The same finger, whose time passes as fast as it is read.
    let device = Terminal::simulate_device(&["--seed", "3", "--as-read"]);
    let watch = |words: &[&str]| {
        let first = ["zero-drift", "-d", &device.path, "-c", name];
        palpate(folder.path(), &[&first[..], words].concat())
    };

    // Too short: the room stays as it was.
    let output = watch(&["--minutes", "1.2"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(text(&output.stderr).contains("the temperature changed by"), "{}", text(&output.stderr));

    let output = watch(&["--minutes", "12", "--json", "--date", "2099-01-02T03:04:05Z"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let drift = &answer["zero_drift"];
    // What the simulated bridges' offsets drift by (`shared/src/sim/bridge.rs`).
    for (axis, truth) in [(0, 0.5), (1, -0.4)] {
        let (found, sigma) = (
            drift["microstrain_per_k"][axis].as_f64().unwrap(),
            drift["sigma_microstrain_per_k"][axis].as_f64().unwrap(),
        );
        assert!(
            (found - truth).abs() < 4.0 * sigma && sigma < 0.01,
            "axis {axis}: {found} ± {sigma} for {truth}: {answer}"
        );
    }
    let after = PathBuf::from(answer["written"].as_str().unwrap());
    let [old, new] = [&before, &folder.path().join(after)].map(|path| fs::read_to_string(path).unwrap());
    assert!(!old.contains("[zero_drift]") && new.contains("[zero_drift]\nmicrostrain_per_k = ["), "{new}");
    // It is a calibration like any other.
    let newer = folder.path().join("cal/a/2099-01-02T030405Z.toml");
    assert_eq!(result_in(&folder.path().join("cal/a")), newer);
    let newer = newer.to_str().unwrap();
    let output = palpate(
        folder.path(),
        &["monitor", "-d", &device.path, "-c", newer, "--seconds", "1", "--tare", "1", "--json"],
    );
    assert!(output.status.success(), "{}", text(&output.stderr));
}
