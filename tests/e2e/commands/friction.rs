//! Friction measured by a push, axes of a finger that is mounted turned, and live pushes that are kept: by the real binary.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use palpate::gravity::GRAVITY_ASSUMED;
use palpate::pushing::pushed_world::PushedWorld;
use serde_json::Value;

use crate::PALPATE;
use crate::observe::{
    assert_fits_a_terminal, assert_names, check, example, forces, last_answer, observe, pushed, text, unfolded,
};

/// What the push of [`pushed`] was made with: µ_c and mass (kg); µ is the example part's.
const MU_C: f64 = 0.25;
const MASS_KG: f64 = 0.5;

/// Rest before the push, s, and noise of each value, N.
const REST_S: f64 = 1.2;
const NOISE_N: f64 = 5e-3;

/// The example part's µ.
fn mu() -> f64 {
    palpate_files::part::PolygonFile::parse(&std::fs::read_to_string(example("part.toml")).unwrap()).unwrap().mu
}

/// The example part in a file with another µ.
fn guessed(folder: &Path, factor: f64) -> PathBuf {
    let text = std::fs::read_to_string(example("part.toml")).unwrap();
    let (told, wrong) = (format!("mu = {}", mu()), format!("mu = {}", factor * mu()));
    assert!(text.contains(&told), "{text}");
    let path = folder.join("guessed.toml");
    std::fs::write(&path, text.replace(&told, &wrong)).unwrap();
    path
}

fn friction(part: &Path, table: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.args(["friction", "--effective-mass-g", "0"]).args(arguments).arg("--part").arg(part);
    command.arg("--motion").arg(example("motion.toml")).arg(table).output().unwrap()
}

/// Whether an answer's quantity holds the truth within twice its 95 % interval, and how wide that is.
fn holds(told: &Value, truth: f64) -> (bool, f64) {
    let sd = told["log_sd"].as_f64().unwrap();
    ((told["value"].as_f64().unwrap() / truth).ln().abs() < 4.0 * sd, sd)
}

#[test]
fn a_push_measures_friction_that_was_guessed_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&pushed(), REST_S, NOISE_N)).unwrap();
    let part = guessed(folder.path(), 1.6);
    let alone = last_answer(&friction(&part, &table, &["--json"]));
    let (is_held, sd) = holds(&alone["mu"], mu());
    assert!(is_held && sd < 0.1, "{alone}");
    let (is_held, sd) = holds(&alone["mu_c"], MU_C);
    assert!(is_held && sd < 0.05, "{alone}");
    assert!(holds(&alone["mass"], MASS_KG).0 && holds(&alone["mu_times_mass"], mu() * MASS_KG).0, "{alone}");

    // A balance tells them apart.
    let weighed = last_answer(&friction(&part, &table, &["--json", "--mass-g", "500,2.5"]));
    let (is_held, of_weighed) = holds(&weighed["mu"], mu());
    assert!(is_held && of_weighed < 0.01 && of_weighed < alone["mu"]["log_sd"].as_f64().unwrap(), "{weighed}");

    let shown = text(&friction(&part, &table, &[]).stdout);
    assert_fits_a_terminal(&shown);
    assert!(shown.starts_with("mu = 0.") && shown.contains("\nmu_c = 0.") && shown.contains("95 %"), "{shown}");
    for (arguments, says) in [
        (["--mass-g", "5000"], "has a mass of 5000.0 g: the likeliest one has"),
        (["--mu-uncertainty", "exact"], "is not measured"),
    ] {
        let output = friction(&part, &table, &arguments);
        let said = unfolded(&text(&output.stderr).replace('│', ""));
        assert!(output.status.code() == Some(1) && said.contains(says), "{said}");
    }
}

/// Forces as a finger feels them in which the robot's x axis lies at so many degrees.
fn mounted(table: &str, degrees: f64) -> String {
    let (sin, cos) = degrees.to_radians().sin_cos();
    table.lines().fold(String::new(), |mut all, line| {
        let values: Vec<f64> = line.split(',').filter_map(|value| value.trim().parse().ok()).collect();
        match values.as_slice() {
            [t, x, y] => writeln!(all, "{t:.6}, {:.6}, {:.6}", x * cos - y * sin, x * sin + y * cos).unwrap(),
            _ => writeln!(all, "{line}").unwrap(),
        }
        all
    })
}

#[test]
fn a_finger_that_is_mounted_turned_names_the_pose_along_the_robots_axes() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, mounted(&forces(&played, REST_S, NOISE_N), 130.0)).unwrap();
    let seen = |mounting: &[&str]| {
        let mut command = observe(&["--json", "--effective-mass-g", "0"]);
        command.args(mounting).arg("--motion").arg(example("motion.toml")).arg(&table).output().unwrap()
    };
    check(&last_answer(&seen(&["--mounting-deg", "130"])), &played);
    // Untold it is no push of this part.
    assert_ne!(last_answer(&seen(&[]))["status"], "unique");
}

/// What is felt live and what is kept of it are no farther apart, in standard deviations that are stated: of one noise an
/// estimate that weighs readings less differs from the best by the root of the difference of their variances (Hausman), and the
/// calibration's uncertainty makes variances up to 1.6 times as large. The noise is another one in each run.
const NEAR_SD: f64 = 0.6;

/// The planner and the judge of several parts, live over a pseudo-terminal: what they keep says the same from its files.
#[cfg(unix)]
#[test]
fn live_pushes_are_planned_on_and_kept() {
    use crate::observe::felt_live;

    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, 0.0, 0.0)).unwrap();
    let [part, motion] = ["part.toml", "motion.toml"].map(example);
    let both = format!("{} {}", table.display(), motion.display());
    for (command, best) in [("plan-push", "/estimate"), ("which-part", "/parts/0/estimate")] {
        let kept = folder.path().join(command);
        let words = ["--json", "--part"].map(Path::new);
        let mut all = vec![Path::new(command), words[0], words[1], &part, Path::new("--motion"), &motion];
        all.extend([Path::new("--keep"), &kept]);
        let live = felt_live(folder.path(), &both, &all);
        let answer = last_answer(&live);
        // Options that repeat what was known of the finger stand in what is said of the kept files.
        let said = text(&live.stderr);
        let told = said.lines().find(|line| line.starts_with("kept;")).unwrap_or_else(|| panic!("{said}"));
        let options: Vec<_> = told.split("motion.toml").nth(1).unwrap().split_whitespace().collect();
        assert!(options.contains(&"--effective-mass-g"), "{told}");
        let mut again = Command::new(PALPATE);
        again.args([command, "--json", "--part"]).arg(&part).arg("--motion").arg(kept.join("motion.toml"));
        let again = last_answer(&again.args(options).arg(kept.join("forces.csv")).output().unwrap());
        let likeliest =
            |answer: &Value| answer.pointer(best).unwrap_or_else(|| panic!("{answer}"))["hypotheses"][0].clone();
        let [live, again] = [likeliest(&answer), likeliest(&again)];
        // The table has micronewtons and no calibration's uncertainty, by which readings weigh less: the two are no farther
        // apart than a part of what is stated.
        let is_near = |k: usize| {
            let [a, b] = [&live, &again].map(|found| found["pose_end"][k].as_f64().unwrap());
            (a - b).abs() < NEAR_SD * live["covariance"][k][k].as_f64().unwrap().sqrt()
        };
        let near = (0..3).all(is_near);
        assert!(near, "{command}: {live:?} {again:?}");
    }
}

/// What is not known of the finger's bending and of its place is stated with the rest: exactly that much.
#[test]
fn an_uncertain_finger_makes_the_pose_as_uncertain() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, REST_S, NOISE_N)).unwrap();
    let seen = |told: &[&str]| {
        let mut command = observe(&["--json", "--effective-mass-g", "0"]);
        last_answer(&command.args(told).arg("--motion").arg(example("motion.toml")).arg(&table).output().unwrap())
    };
    let covariance = |answer: &Value, row: usize, column: usize| {
        answer["hypotheses"][0]["covariance"][row][column].as_f64().unwrap_or_else(|| panic!("{answer}"))
    };
    let sure = seen(&["--compliance-um-per-n", "36,0"]);
    let unsure = seen(&["--compliance-um-per-n", "36,20", "--tip-sigma-mm", "0.1"]);
    // Means of the last 40 ms, of a force that changes by a fifth a second.
    let force = played.force_finger(sure["t"].as_f64().unwrap() - 0.02);
    for (row, column) in [(0, 0), (0, 1), (1, 1), (0, 2), (2, 2)] {
        let axis = |index: usize| if index < 2 { 20e-6 * force[index] } else { 0.0 };
        let place = if row == column && row < 2 { 1e-8 } else { 0.0 };
        let wanted = place + axis(row) * axis(column);
        let got = covariance(&unsure, row, column) - covariance(&sure, row, column);
        assert!((got - wanted).abs() < 0.05 * wanted.abs() + 1e-12, "{row}, {column}: {got:e}, {wanted:e}");
    }
}

/// Without friction at the finger the force points along the normal, and the thesis's observer that begins near the truth
/// follows the part; it says what it assumes.
#[test]
fn the_thesis_observer_follows_a_part_that_slides_without_friction() {
    let folder = tempfile::tempdir().unwrap();
    let file =
        palpate_files::part::PolygonFile::parse(&std::fs::read_to_string(example("part.toml")).unwrap()).unwrap();
    let motion = palpate_files::motion::parse(&std::fs::read_to_string(example("motion.toml")).unwrap()).unwrap();
    let (part, mu_g) = (&file.part, file.mu * GRAVITY_ASSUMED);
    let (edge, u, s) = (3, 0.1, -0.004);
    let world = PushedWorld { part, mu_g, mass: 0.5, mu_c: 1e-3, radius: 0.015, motion: &motion, edge, u, s };
    let played = world.play().unwrap();
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, REST_S, 1e-3)).unwrap();
    let follow = |arguments: &[&str]| {
        let mut command = observe(&["--method", "gho", "--effective-mass-g", "0"]);
        command.args(arguments).arg("--motion").arg(example("motion.toml")).arg(&table).output().unwrap()
    };
    let answer = last_answer(&follow(&["--json", "--edge", "3", "--initial-estimate", "5.7,2"]));
    let best = &answer["hypotheses"][0];
    let truth = played.pose(answer["t"].as_f64().unwrap()).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let off = (number(&best["pose"][0]) - truth.translation.x).hypot(number(&best["pose"][1]) - truth.translation.y);
    assert!(off < 2e-3, "off by {off} m: {answer}");
    assert!(best["probability"].is_null() && best["covariance"].is_null(), "{best}");
    assert!(answer["assumed"][0].as_str().unwrap().contains("without friction"), "{answer}");

    let picture = folder.path().join("gho.svg");
    let shown = text(&follow(&["--plot", picture.to_str().unwrap()]).stdout);
    assert_fits_a_terminal(&shown);
    let said = unfolded(&shown);
    assert!(said.contains("give no uncertainty") && said.contains("missed") && said.contains("and 2 more"), "{said}");
    assert_names(&picture, &["x, felt"]);
    for (arguments, says) in
        [(["--edge", "9", "--method", "gho"], "no edge 9"), (["--zeta", "5", "--method", "search"], "not asked for")]
    {
        let mut command = observe(&arguments);
        let output = command.arg("--motion").arg(example("motion.toml")).arg(&table).output().unwrap();
        assert!(text(&output.stderr).contains(says), "{}", text(&output.stderr));
    }
}
