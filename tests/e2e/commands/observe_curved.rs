//! Elliptic parts and elliptic fingers: the real binary names the pose, and says what it cannot do with them.
//!
//! The push is played by the error-controlled simulation. Frames: finger axes. Units: SI, of files and options as they say.

use std::f64::consts::PI;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use nalgebra::{Matrix3, Vector3};
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::statistics::chi_square_quantile;
use palpate::pushing::dynamics::{EndReason, FingerShape};
use palpate::pushing::pushed_world::{Played, PushedWorld};
use palpate_files::part::PolygonFile;
use serde_json::Value;

use crate::PALPATE;
use crate::observe::{example, forces, last_answer, text, unfolded};

/// Turned by half a turn it is the same.
const PART: &str = "unit = 'mm'\nellipse = {a = 38, b = 24}\nmu = 0.25\n";

/// Of the finger that is no disk, along x and y, m.
const SEMI_AXES_M: [f64; 2] = [12e-3, 7e-3];

/// Rest before the push, s, and noise of every value, N.
const REST_S: f64 = 1.2;
const FORCE_SD_N: f64 = 0.01;

/// Longer than the push: the answer at its end alone is judged, and each before takes as long.
const EVERY_S: &str = "10";

/// A pose within its own uncertainty may be off in such a place of chi-square: noise is the same in every run.
const CHANCE: f64 = 0.999;

/// What the simulations of both sides are off by, m and rad: a contact that is exact leaves a covariance singular.
const SLACK: [f64; 3] = [5e-6, 5e-6, 5e-5];

/// Largest error of a pose, m and rad: five times what is stated of half a kilogram.
const POSE_ERROR: (f64, f64) = (4e-4, 0.02);

/// A part file, and a table of forces of the example motion with a finger of this outline: half a kilogram, touched off its
/// axes.
fn pushed(folder: &Path, shape: FingerShape) -> (Played, [PathBuf; 2]) {
    let file = PolygonFile::parse_curved(PART).unwrap();
    let motion = palpate_files::motion::parse(&std::fs::read_to_string(example("motion.toml")).unwrap()).unwrap();
    let (part, mu_g, motion) = (&file.part, file.mu * GRAVITY_ASSUMED, &motion);
    let world = PushedWorld { part, mu_g, mass: 0.5, mu_c: 0.25, radius: 0.015, motion, edge: 0, u: 0.3, s: 2.2 };
    let played = world.play_by(shape).unwrap();
    assert_eq!(played.end, EndReason::Time);
    let [part, table] = ["part.toml", "forces.csv"].map(|name| folder.join(name));
    std::fs::write(&part, PART).unwrap();
    std::fs::write(&table, forces(&played, REST_S, FORCE_SD_N)).unwrap();
    (played, [part, table])
}

/// What `palpate observe` says of a push, the disk having no mass in this world.
fn observe([part, table]: &[PathBuf; 2], more: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION").args(["observe", "--json", "--part"]);
    command.arg(part).arg("--motion").arg(example("motion.toml")).args(["--effective-mass-g", "0"]);
    command.args(["--every", EVERY_S]).args(more).arg(table).output().unwrap()
}

/// The only pose is the true one, or that with half a turn more, as far as it states itself.
fn check(answer: &Value, played: &Played) {
    assert_eq!((&answer["status"], &answer["symmetry"]), (&"unique".into(), &2.into()), "{answer}");
    let numbers = |value: &Value| value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>();
    let best = &answer["hypotheses"][0];
    let pose = numbers(&best["pose_end"]);
    let truth = played.pose(answer["t"].as_f64().unwrap()).unwrap();
    // From a quarter of a turn below to a quarter above: half a turn counts for nothing.
    let turned = (pose[2] - truth.rotation.angle() + 0.5 * PI).rem_euclid(PI) - 0.5 * PI;
    let off = Vector3::new(pose[0] - truth.translation.x, pose[1] - truth.translation.y, turned);
    let stated = Matrix3::from_fn(|row, column| numbers(&best["covariance"][row])[column]);
    let covariance = stated + Matrix3::from_diagonal(&Vector3::from(SLACK).map(|sd| sd * sd));
    let squared = off.dot(&(covariance.try_inverse().unwrap() * off));
    assert!(squared < chi_square_quantile(CHANCE, 3), "{squared} in its own deviations: {off} {answer}");
    assert!(off.xy().norm() < POSE_ERROR.0 && off.z.abs() < POSE_ERROR.1, "{off} {answer}");
}

#[test]
fn an_ellipse_pushed_by_the_disk_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (played, files) = pushed(folder.path(), FingerShape::Disk { radius: 0.015 });
    check(&last_answer(&observe(&files, &[])), &played);
}

#[test]
fn an_ellipse_pushed_by_an_elliptic_finger_is_found() {
    let folder = tempfile::tempdir().unwrap();
    let (played, files) = pushed(folder.path(), FingerShape::Ellipse { semi_axes: SEMI_AXES_M });
    check(&last_answer(&observe(&files, &["--semi-axes-mm", "12,7"])), &played);
}

#[test]
fn what_knows_no_ellipses_refuses_them_and_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let (_, files) = pushed(folder.path(), FingerShape::Ellipse { semi_axes: SEMI_AXES_M });
    let refused = |more: &[&str], status: i32, wanted: &str| {
        let output = observe(&files, more);
        let said = unfolded(&text(&output.stderr));
        assert!(output.status.code() == Some(status) && said.contains(wanted), "{more:?}: {said}");
    };
    for method in ["follow", "gho", "slow"] {
        let with_disk = "this works with a finger's disk only, not with an ellipse";
        refused(&["--method", method, "--semi-axes-mm", "12,7"], 1, with_disk);
        refused(&["--method", method], 1, "the part is an ellipse, and this works on polygons only");
    }
    refused(&["--semi-axes-mm", "12"], 64, "`12` is not two lengths: write for example 20,10");
    refused(&["--semi-axes-mm", "12,0"], 64, "it must be above 0");
    refused(&["--semi-axes-mm", "12,wide"], 64, "wide");
    refused(&["--semi-axes-mm", "12,7", "--radius-mm", "15"], 64, "cannot be used with");
}
