//! What a finger that is carried learns of itself: its mass by a wave, its tip by touches, in one calibration.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use palpate_files::calibration::file::CalibrationFile;

use crate::PALPATE;

fn palpate(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.current_dir(folder).args(arguments).env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION");
    command.stdin(Stdio::null()).output().unwrap()
}

fn said(output: &Output) -> String {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(output.status.success(), "{}{}", text(&output.stdout), text(&output.stderr));
    text(&output.stdout)
}

/// The file that a command says it has written.
fn written(folder: &Path, said: &str) -> PathBuf {
    let line = said.lines().find_map(|line| line.strip_prefix("written")).unwrap_or_else(|| panic!("{said}"));
    folder.join(line.trim())
}

/// Effective mass of the default finger, g: 20 g, and half of the 5.92 g of beam beyond the gauges.
const MASS_G: f64 = 22.96;

/// A calibration with a weight of 2 N leaves the scale of a force this uncertain, as a share: noise, and 0.1 % of the
/// weight.
const SCALE: f64 = 0.005;

#[test]
fn a_finger_is_calibrated_waved_and_touched_and_one_file_says_it_all() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let matrix = said(&palpate(here, &["calibrate", "-d", "sim:", "--load", "2 N", "--date", "2026-01-01T00:00:00Z"]));
    let matrix = written(here, &matrix);
    let (first, _) = CalibrationFile::read(&matrix).unwrap();
    assert_eq!(first.lacks(), ["effective mass", "compliance", "tip's place"]);
    assert!((first.carried().effective_mass_sd - 0.02).abs() < 1e-12, "a prior that is stated");

    let pressed = ["--pressed", "0.02:0.55", "0.04:1.10", "0.06:1.647"];
    let wave = ["wave", "-d", "sim:", "-c", matrix.to_str().unwrap(), "--date", "2026-01-02T00:00:00Z"];
    let waved = written(here, &said(&palpate(here, &[&wave[..], &pressed[..]].concat())));
    let (second, _) = CalibrationFile::read(&waved).unwrap();
    let wave = second.wave.clone().unwrap();
    let allowed = 5.0 * wave.effective_mass_sigma_g + SCALE * MASS_G;
    assert!((wave.effective_mass_g - MASS_G).abs() < allowed, "{wave:?}");
    assert!(wave.effective_mass_sigma_g < 0.02 * MASS_G && wave.held_back > 20, "{wave:?}");
    assert!(wave.mounting_deg.abs() < 5.0 * wave.mounting_sigma_deg + 0.2, "{wave:?}");
    let compliance = second.compliance.unwrap();
    assert!((compliance.um_per_n - 36.45).abs() < 0.1 && compliance.loads == 3, "{compliance:?}");
    assert_eq!((second.matrix, &second.raw), (first.matrix, &first.raw), "the matrix is the first one's");

    // Two touches on each of two faces; the disk's centre is 5 mm before the wrist's point and 2 mm aside.
    let touches = here.join("touches.toml");
    let lines = [[30.0, 0.0, 1.0], [30.0, 10.0, 1.0], [0.0, 33.0, 2.0], [5.0, 33.0, 2.0]]
        .map(|[x, y, face]| format!("[[touch]]\nwrist = [{x}, {y}]\nface = {face:.0}\n"));
    let block = "unit = 'mm'\nradius = 15\npose = [0, 0, 0]\nblock = [[-20, -20], [20, -20], [20, 20], [-20, 20]]\n";
    std::fs::write(&touches, block.to_owned() + &lines.concat()).unwrap();
    let locate = ["locate-tip", touches.to_str().unwrap(), "-c", waved.to_str().unwrap()];
    let located = said(&palpate(here, &[&locate[..], &["--date", "2026-01-03T00:00:00Z"]].concat()));
    let (third, _) = CalibrationFile::read(&written(here, &located)).unwrap();
    let tip = third.tip.unwrap();
    assert!((tip.offset_mm[0] - 5.0).abs() < 1e-6 && (tip.offset_mm[1] - 2.0).abs() < 1e-6, "{tip:?}");
    assert_eq!((&third.wave, third.lacks()), (&second.wave, Vec::new()));

    // What was felt is kept as counts, and says the same again.
    let raw = waved.with_file_name(&wave.raw.as_ref().unwrap().file);
    let again = ["wave", "--from-raw", raw.to_str().unwrap(), "-c", waved.to_str().unwrap(), "--date"];
    let again = said(&palpate(here, &[&again[..], &["2026-01-04T00:00:00Z"]].concat()));
    let (fourth, _) = CalibrationFile::read(&written(here, &again)).unwrap();
    assert_eq!((fourth.wave, fourth.compliance), (second.wave, second.compliance));
}

#[test]
fn a_calibration_with_a_wave_is_one_file_with_the_samples_of_both() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let line =
        ["calibrate", "-d", "sim:3", "--load", "2 N", "--contacts", "6", "--wave", "--date", "2026-01-01T00:00:00Z"];
    let (file, _) = CalibrationFile::read(&written(here, &said(&palpate(here, &line)))).unwrap();
    let wave = file.wave.clone().unwrap();
    assert!((wave.effective_mass_g - MASS_G).abs() < 5.0 * wave.effective_mass_sigma_g + SCALE * MASS_G, "{wave:?}");
    assert_eq!(file.lacks(), ["compliance", "tip's place"]);
    let mut names: Vec<_> = std::fs::read_dir(here.join("calibration/finger-a"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    assert_eq!(names, ["2026-01-01T000000Z.csv", "2026-01-01T000000Z.toml", "2026-01-01T000000Z.wave.csv"]);
    // A weight that nobody weighed gives no newtons: the calibration stands, the wave is refused with its reason.
    let line = ["calibrate", "-d", "sim:3", "--contacts", "6", "--wave", "--finger", "b"];
    let output = palpate(here, &line);
    let told = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && told.contains("is written, but has no wave"), "{told}");
}
