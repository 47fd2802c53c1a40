//! Friction measured by a push, axes of a finger that is mounted turned, and live pushes that are kept: by the real binary.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;

use crate::PALPATE;
use crate::observe::{assert_fits_a_terminal, check, example, forces, last_answer, observe, pushed, text, unfolded};

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
        let poses = |answer: &Value| -> Vec<f64> {
            let hypotheses = answer.pointer(best).unwrap_or_else(|| panic!("{answer}"))["hypotheses"].as_array().unwrap();
            let pose = hypotheses[0]["pose_end"].as_array().unwrap();
            pose.iter().map(|value| value.as_f64().unwrap()).collect()
        };
        // The table has micronewtons and no calibration's uncertainty: a hundredth of a millimetre, a minute of arc.
        let [live, again] = [poses(&answer), poses(&again)];
        let near = live.iter().zip(&again).all(|(a, b)| (a - b).abs() < 3e-4);
        assert!(near, "{command}: {live:?} {again:?}");
    }
}
