//! A push of a finger whose places a robot measured, by a clock of its own: the real binary names the pose and the clock.

use std::fmt::Write as _;
use std::path::PathBuf;

use nalgebra::{Isometry2, Matrix3, Vector3};
use palpate::math::random::Draw;
use palpate::math::statistics::chi_square_quantile;
use palpate::pushing::pushed_world::Played;
use serde_json::Value;

use crate::observe::{assert_fits_a_terminal, assert_names, example, forces, observe, pushed, text, unfolded};

/// Rest before the push, s.
pub(crate) const REST_S: f64 = 1.2;

/// Noise of the places, m, and of the forces, N.
pub(crate) const PLACE_SD_M: f64 = 5e-6;
const FORCE_SD_N: f64 = 2e-3;

/// What the path's clock is early, s.
const EARLY_S: f64 = 7e-3;

/// What a robot's clock shows when the finger's shows 0, s.
const ROBOT_CLOCK_S: f64 = 4321.5;

/// How far poses of one push may differ whose times are rounded otherwise, standard deviations: a fit ends where a step
/// lowers the cost by less than 0.02, which a place √0.02 deviations from the minimum does.
const ROUNDED_SDS: f64 = 0.14;

/// Some hundred places a second at uneven times, from before the push to the end of its motion.
pub(crate) fn places(noise: f64) -> String {
    places_of(noise, EARLY_S, 0.009)
}

/// The same by a clock that is early by so much, s, a place each so long, s, or a third more or less.
fn places_of(noise: f64, early: f64, apart: f64) -> String {
    let motion = std::fs::read_to_string(example("motion.toml")).unwrap();
    let motion = palpate_files::motion::parse(&motion).unwrap();
    let (mut draw, mut table, mut t) = (Draw::case(2, 0), "t [s], x [mm], y [mm]\n".to_owned(), 0.5);
    while t + early < REST_S + motion.duration() {
        let place = motion.centre((t + early - REST_S).max(0.0));
        let [x, y] = [place.x, place.y].map(|value| 1e3 * (value + noise * draw.normal()));
        writeln!(table, "{t:.5}, {x:.6}, {y:.6}").unwrap();
        t += apart * draw.uniform(2.0 / 3.0, 4.0 / 3.0);
    }
    table
}

fn files(folder: &tempfile::TempDir, played: &Played, places: &str) -> [PathBuf; 2] {
    let [table, path] = ["forces.csv", "path.csv"].map(|name| folder.path().join(name));
    std::fs::write(&table, forces(played, REST_S, FORCE_SD_N)).unwrap();
    std::fs::write(&path, places).unwrap();
    [table, path]
}

/// What is told of the finger, whose disk has no mass in this world.
const FINGER: [&str; 4] = ["--effective-mass-g", "0", "--path-sigma-mm", "0.005"];

#[test]
fn a_push_with_measured_places_names_the_pose_and_the_clock() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let [table, path] = files(&folder, &played, &places(PLACE_SD_M));
    let output = observe(&FINGER).arg("--json").arg(&table).arg("--path").arg(&path).output().unwrap();
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output.stderr)));
    let best = &answer["hypotheses"][0];
    assert!(best["probability"].as_f64().unwrap() > 0.99, "{answer}");
    let numbers = |value: &Value| value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>();
    let pose = numbers(&best["pose_end"]);
    let truth = played.pose(answer["t"].as_f64().unwrap()).unwrap();
    let found = Isometry2::new([pose[0], pose[1]].into(), pose[2]);
    let distance = (found.translation.vector - truth.translation.vector).norm();
    let angle = found.rotation.angle_to(&truth.rotation).abs();
    assert!(distance < 1e-3 && angle < 0.015, "off by {distance:e} m, {angle:e} rad: {answer}");
    // Inside its own uncertainty, which is some 0.8° with places to 5 µm and a clock to find.
    let sd = |k: usize| numbers(&best["covariance"][k])[k].sqrt();
    assert!(sd(2) < 0.02 && angle < 4.0 * sd(2), "{angle} of {} rad", sd(2));
    let clock_early = best["clock_offset"].as_f64().unwrap();
    assert!((clock_early - EARLY_S).abs() < 2e-3, "{clock_early} s");
    assert!((answer["hypotheses"][0]["onset"].as_f64().unwrap() - REST_S).abs() < 5e-3, "{answer}");

    // By the robot's own clock, which a pulse on a digital input ties to the finger's.
    let late = std::fs::read_to_string(&path).unwrap().lines().enumerate().fold(String::new(), |table, (row, line)| {
        let (t, rest) = line.split_once(',').unwrap();
        let t = t.parse::<f64>().map_or_else(|_| t.to_owned(), |t| format!("{:.5}", t + ROBOT_CLOCK_S));
        table + &if row == 0 { format!("{line}\n") } else { format!("{t},{rest}\n") }
    });
    let by_robot = folder.path().join("robot.csv");
    std::fs::write(&by_robot, late).unwrap();
    let clock = ["--path-clock-s", &ROBOT_CLOCK_S.to_string()];
    let tied = observe(&FINGER).args(clock).arg("--json").arg(&table).arg("--path").arg(&by_robot).output().unwrap();
    let tied: Value = serde_json::from_slice(&tied.stdout).unwrap_or_else(|_| panic!("{}", text(&tied.stderr)));
    let tied = &tied["hypotheses"][0];
    let (late, tied) = (tied["clock_offset"].as_f64().unwrap(), numbers(&tied["pose_end"]));
    assert!((late - EARLY_S).abs() < 2e-3, "{late} s");
    assert!((0..3).all(|k| (pose[k] - tied[k]).abs() < ROUNDED_SDS * sd(k)), "{pose:?} {tied:?}");

    let picture = folder.path().join("push.svg");
    let shown = observe(&FINGER).arg(&table).arg("--path").arg(&path).arg("--plot").arg(&picture).output().unwrap();
    assert_names(&picture, &["x, felt", "its centre of mass"]);
    assert_fits_a_terminal(&text(&shown.stdout));
    let said = unfolded(&text(&shown.stdout));
    let told = format!("The path's clock is {:.1} ms early", 1e3 * clock_early);
    assert!(said.contains("One pose explains forces and places") && said.contains(&told), "{said}");
}

/// At the ends of what is asked of a path: a clock that is off by 50 ms to either side, and 20 places a second.
#[test]
fn a_clock_far_off_and_places_far_apart_are_taken_for_what_they_are() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    // How early the clock is, s, from place to place, s, and how well the clock is found, s.
    for (early, apart, within) in [(0.05, 0.009, 2e-3), (-0.05, 0.009, 2e-3), (EARLY_S, 0.05, 8e-3)] {
        let [table, path] = files(&folder, &played, &places_of(PLACE_SD_M, early, apart));
        let unsure = ["--clock-offset-ms", "25", "--json"];
        let output = observe(&FINGER).args(unsure).arg(&table).arg("--path").arg(&path).output().unwrap();
        let answer: Value =
            serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output.stderr)));
        let truth = played.pose(answer["t"].as_f64().unwrap()).unwrap();
        let numbers = |value: &Value| value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect::<Vec<_>>();
        let errors = answer["hypotheses"].as_array().unwrap().iter().map(|told| {
            let pose = numbers(&told["pose_end"]);
            let found = Isometry2::new([pose[0], pose[1]].into(), pose[2]);
            let off = found.translation.vector - truth.translation.vector;
            let off = Vector3::new(off.x, off.y, truth.rotation.rotation_to(&found.rotation).angle());
            let rows: Vec<_> = told["covariance"].as_array().unwrap().iter().map(numbers).collect();
            let covariance = Matrix3::from_fn(|row, column| rows[row][column]);
            (off.transpose() * covariance.try_inverse().unwrap() * off)[0]
        });
        let nearest = errors.min_by(f64::total_cmp).unwrap();
        assert!(nearest < chi_square_quantile(0.9999, 3), "{early} s, {apart} s: {nearest} of {answer}");
        let best = &answer["hypotheses"][0];
        let clock = best["clock_offset"].as_f64().unwrap();
        assert!((clock - early).abs() < within, "{early} s, {apart} s: {clock} s");
        // It tells something.
        let [place_sd, angle_sd] = [0, 2].map(|k| numbers(&best["covariance"][k])[k].sqrt());
        let is_one = best["probability"].as_f64().unwrap() > 0.99;
        assert!(is_one && place_sd < 2e-3 && angle_sd < 0.04, "{early} s, {apart} s: {answer}");
    }
}

/// A wrist turned to the left by this, degrees: its sensor's axes are, too.
const TURNED_DEG: f64 = 40.0;

/// A table of places with a column of the wrist's turn.
fn with_turns(places: &str, turn_deg: impl Fn(usize) -> f64) -> String {
    let of_line = |(row, line): (usize, &str)| match row {
        0 => format!("{line}, phi [deg]\n"),
        _ => format!("{line}, {:.4}\n", turn_deg(row)),
    };
    places.lines().enumerate().map(of_line).collect()
}

#[test]
fn forces_of_a_turned_sensor_are_told_along_the_robots_axes() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let [table, path] = files(&folder, &played, &with_turns(&places(PLACE_SD_M), |_| TURNED_DEG));
    let read = std::fs::read_to_string(&table).unwrap();
    let turned = read.lines().enumerate().map(|(row, line)| {
        let values: Vec<f64> = line.split(',').filter_map(|value| value.trim().parse().ok()).collect();
        let [t, x, y] = values[..] else {
            assert_eq!(row, 0, "{line}");
            return format!("{line}\n");
        };
        let (sin, cos) = TURNED_DEG.to_radians().sin_cos();
        format!("{t:.6}, {:.6}, {:.6}\n", cos * x + sin * y, cos * y - sin * x)
    });
    std::fs::write(&table, turned.collect::<String>()).unwrap();
    let answer = |path: &PathBuf| -> Value {
        let output = observe(&FINGER).arg("--json").arg(&table).arg("--path").arg(path).output().unwrap();
        serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{}", text(&output.stderr)))
    };
    let is_found = |answer: &Value| {
        let truth = played.pose(answer["t"].as_f64().unwrap()).unwrap();
        answer["hypotheses"].as_array().unwrap().iter().any(|found| {
            let [x, y, theta] = [0, 1, 2].map(|index| found["pose_end"][index].as_f64().unwrap());
            let found = Isometry2::new([x, y].into(), theta);
            let distance = (found.translation.vector - truth.translation.vector).norm();
            distance < 1e-3 && found.rotation.angle_to(&truth.rotation).abs() < 0.015
        })
    };
    let told = answer(&path);
    assert!(is_found(&told), "{told}");
    std::fs::write(&path, places(PLACE_SD_M)).unwrap();
    let untold = answer(&path);
    assert!(!is_found(&untold), "{untold}");

    // Ten degrees from one place to the next.
    std::fs::write(&path, with_turns(&places(PLACE_SD_M), |row| 10.0 * row as f64)).unwrap();
    let output = observe(&FINGER).arg(&table).arg("--path").arg(&path).output().unwrap();
    assert!(!output.status.success());
    let said = unfolded(&text(&output.stderr));
    assert!(said.contains("but at most 12 rad/s can be followed"), "{said}");
    std::fs::write(&path, with_turns(&places(PLACE_SD_M), |_| TURNED_DEG)).unwrap();
    let ellipse =
        observe(&FINGER).args(["--semi-axes-mm", "20,10"]).arg(&table).arg("--path").arg(&path).output().unwrap();
    let said = unfolded(&text(&ellipse.stderr));
    assert!(said.contains("works with a finger's disk only"), "{said}");
}

#[test]
fn a_path_that_cannot_be_used_is_named_with_the_reason() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let whole = places(0.0);
    let head = |lines: usize| whole.lines().take(lines).collect::<Vec<_>>().join("\n");
    let says = |places: &str| {
        let [table, path] = files(&folder, &played, places);
        let output = observe(&FINGER).arg(&table).arg("--path").arg(&path).output().unwrap();
        assert!(!output.status.success() || places.len() > 200);
        unfolded(&text(&output.stderr))
    };
    assert!(says(&head(5)).contains("has 4 places: 8 are needed"), "{}", says(&head(5)));
    assert!(says("t, x\n0, 1\n").contains("no column for y"));
    // One that ends in the middle of the push.
    let short = says(&head(110));
    assert!(short.contains("are left out: the path, from 0.500 s to"), "{short}");
    let both = observe(&FINGER).args(["f.csv", "--path", "p.csv", "--motion", "m.toml"]).output().unwrap();
    assert_eq!(both.status.code(), Some(64), "{}", text(&both.stderr));
    let live = observe(&["--path", "p.csv"]).output().unwrap();
    let said = unfolded(&text(&live.stderr));
    assert!(!live.status.success() && said.contains("say --method follow"), "{said}");
    let gho = observe(&["--path", "p.csv", "--method", "gho", "f.csv"]).output().unwrap();
    let said = unfolded(&text(&gho.stderr));
    assert!(said.contains("the thesis's observers do not know measured places"), "{said}");
}
