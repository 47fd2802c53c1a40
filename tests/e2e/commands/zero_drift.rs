//! How a finger's zero goes with temperature, found at a simulated one, whose room warms and cools by a kelvin in tens of minutes.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use serde_json::Value;

use crate::PALPATE;

fn palpate(folder: &Path, words: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.args(words).current_dir(folder).env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION");
    command.stdin(Stdio::null()).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
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

    // Too short: the room stays as it was.
    let output = palpate(folder.path(), &["zero-drift", "-d", "sim:3", "-c", name, "--minutes", "1.2"]);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stdout));
    assert!(text(&output.stderr).contains("the temperature changed by"), "{}", text(&output.stderr));

    let words =
        ["zero-drift", "-d", "sim:3", "-c", name, "--minutes", "20", "--json", "--date", "2099-01-02T03:04:05Z"];
    let output = palpate(folder.path(), &words);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let drift = &answer["zero_drift"];
    // The simulation's 0.5 and -0.4 microstrain/K, and 300 ppm/K of offsets of 180 and -120 microstrain.
    for (axis, truth) in [(0, 0.5 + 0.054), (1, -0.4 - 0.036)] {
        let (found, sigma) = (
            drift["microstrain_per_k"][axis].as_f64().unwrap(),
            drift["sigma_microstrain_per_k"][axis].as_f64().unwrap(),
        );
        assert!(
            (found - truth).abs() < 4.0 * sigma + 0.03 && sigma < 0.05,
            "axis {axis}: {found} ± {sigma} for {truth}: {answer}"
        );
    }
    let after = PathBuf::from(answer["written"].as_str().unwrap());
    let [old, new] = [&before, &folder.path().join(after)].map(|path| fs::read_to_string(path).unwrap());
    assert!(!old.contains("[zero_drift]") && new.contains("[zero_drift]\nmicrostrain_per_k = ["), "{new}");
    // It is a calibration like any other, and one whose zero drifts impossibly is none.
    let newer = folder.path().join("cal/a/2099-01-02T030405Z.toml");
    assert_eq!(result_in(&folder.path().join("cal/a")), newer);
    let newer = newer.to_str().unwrap();
    let monitor = ["monitor", "-d", "sim:3", "-c", newer, "--seconds", "1", "--tare", "1", "--json"];
    let output = palpate(folder.path(), &monitor);
    assert!(output.status.success(), "{}", text(&output.stderr));
}
