//! A push is followed: the real binary tells pose and motion at each reading, from files and live.

use std::fmt::Write as _;
use std::path::Path;

use nalgebra::{Isometry2, Matrix3, Vector3};
use palpate::math::random::Draw;
use palpate::math::statistics::chi_square_quantile;
use palpate::pushing::pushed_world::Played;
use serde_json::Value;

use crate::observe::{assert_fits_a_terminal, assert_names, example, forces, observe, pushed, text, unfolded};
#[cfg(unix)]
use crate::observe::{felt_live_beside, observed_live};
use crate::observe_path;

/// Rest before the push, s, and noise of a value, N.
const REST_S: f64 = 1.2;
const FORCE_SD_N: f64 = 5e-3;

/// A finger that is on its way meets the part then, s since the motion began.
const MET_S: f64 = 0.15;

/// What simulations, and means of them, are off by where an exact contact leaves a covariance singular: m, m, rad.
const SLACK: [f64; 3] = [2e-5, 2e-5, 2e-4];

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// Squared error of the nearest pose that an answer lists, in its own standard deviations.
fn squared_error(answer: &Value, played: &Played) -> f64 {
    let truth = played.pose(answer["t"].as_f64().unwrap() - answer["behind"].as_f64().unwrap()).unwrap();
    let squared = |told: &Value| {
        let pose = numbers(&told["pose"]);
        let found = Isometry2::new([pose[0], pose[1]].into(), pose[2]);
        let off = found.translation.vector - truth.translation.vector;
        let off = Vector3::new(off.x, off.y, truth.rotation.rotation_to(&found.rotation).angle());
        let rows: Vec<_> = told["covariance"].as_array().unwrap().iter().map(numbers).collect();
        let slack = Matrix3::from_diagonal(&Vector3::from(SLACK.map(|sd| sd * sd)));
        let covariance = Matrix3::from_fn(|row, column| rows[row][column]) + slack;
        (off.transpose() * covariance.try_inverse().unwrap() * off)[0]
    };
    answer["hypotheses"].as_array().unwrap().iter().map(squared).min_by(f64::total_cmp).unwrap_or(f64::INFINITY)
}

/// Velocity of the part's frame in the truth, m/s, m/s, rad/s, by differences; the answer's is of the centre of mass.
fn speed(played: &Played, t: f64) -> f64 {
    let step = 1e-3;
    let (before, after) = (played.pose(t - step).unwrap(), played.pose(t + step).unwrap());
    before.rotation.rotation_to(&after.rotation).angle() / (2.0 * step)
}

fn answers(said: &[u8]) -> Vec<Value> {
    text(said).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Most poses told are within what they state, the last for certain, and so is how fast the part turns.
fn check(answers: &[Value], played: &Played) {
    check_of(answers, played, 50, 1.0);
}

/// The same of a push that is followed for so many readings at least, and told to so many times a millimetre and a degree.
fn check_of(answers: &[Value], played: &Played, least: usize, times: f64) {
    let following: Vec<_> = answers.iter().filter(|answer| answer["state"] == "following").collect();
    assert!(following.len() > least, "{} of {}", following.len(), answers.len());
    let within = following.iter().filter(|it| squared_error(it, played) < chi_square_quantile(0.99, 3)).count();
    assert!(within * 10 >= 9 * following.len(), "{within} of {}", following.len());
    // A hundred a second and more.
    let gaps = answers.windows(2).map(|pair| pair[1]["t"].as_f64().unwrap() - pair[0]["t"].as_f64().unwrap());
    let mut gaps: Vec<_> = gaps.collect();
    gaps.sort_by(f64::total_cmp);
    assert!(gaps[gaps.len() / 2] < 0.01, "{gaps:?}");
    let last = answers.last().unwrap();
    assert!(squared_error(last, played) < chi_square_quantile(0.9999, 3), "{last}");
    let best = &last["hypotheses"][0];
    let turning_sd = numbers(&best["covariance"][5])[5].sqrt();
    let omega = numbers(&best["twist"])[2];
    let truth = speed(played, last["t"].as_f64().unwrap());
    assert!((omega - truth).abs() < 4.0 * turning_sd + 1e-3, "{omega} ± {turning_sd}, {truth} rad/s");
    // It tells something.
    let sd = |k: usize| numbers(&best["covariance"][k])[k].sqrt();
    assert!(sd(0) < 1e-3 * times && sd(2) < 0.02 * times, "{best}");
}

#[test]
fn a_push_in_a_file_is_followed_from_reading_to_reading() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, REST_S, FORCE_SD_N)).unwrap();
    let follow = |arguments: &[&str]| {
        let mut command = observe(&["--method", "follow", "--effective-mass-g", "0"]);
        command.args(arguments).arg("--motion").arg(example("motion.toml")).arg(&table).output().unwrap()
    };
    let output = follow(&["--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    check(&answers(&output.stdout), &played);
    // The same again, to the last digit.
    assert_eq!(follow(&["--json"]).stdout, output.stdout);

    let picture = folder.path().join("push.svg");
    let shown = text(&follow(&["--plot", picture.to_str().unwrap()]).stdout);
    assert_names(&picture, &["Misfit of each reading, by the likeliest", "its centre of mass", "y, felt"]);
    assert_fits_a_terminal(&shown);
    assert!(shown.contains("searching") && shown.contains("turning"), "{shown}");

    // Told when the motion began, it is the same.
    let told = follow(&["--json", "--motion-begins", "1.2", "--motion-begins-sigma-ms", "0.1"]);
    check(&answers(&told.stdout), &played);
}

/// Forces of a push of which nothing is felt before [`MET_S`].
fn blanked(played: &Played, rest: f64, sd: f64) -> String {
    forces(played, rest, sd).lines().fold(String::new(), |mut all, line| {
        let mut draw = Draw::case(9, all.len());
        match line.split(',').next().and_then(|t| t.trim().parse::<f64>().ok()) {
            Some(t) if (rest..rest + MET_S).contains(&t) => {
                writeln!(all, "{t:.6}, {:.6}, {:.6}", sd * draw.normal(), sd * draw.normal()).unwrap();
            }
            _ => writeln!(all, "{line}").unwrap(),
        }
        all
    })
}

/// The recorded push from a while after it began: the finger's rest is there, the part moves when it is first felt.
#[test]
fn a_push_that_is_felt_from_its_middle_on_is_followed() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, blanked(&played, REST_S, FORCE_SD_N)).unwrap();
    let mut command = observe(&["--method", "follow", "--effective-mass-g", "0", "--json", "--motion-begins", "1.2"]);
    let output = command.arg("--motion").arg(example("motion.toml")).arg(&table).output().unwrap();
    let answers = answers(&output.stdout);
    let following = answers.iter().filter(|answer| answer["state"] == "following").count();
    assert!(following > 10, "{}{}", text(&output.stdout), text(&output.stderr));
    assert!(squared_error(answers.last().unwrap(), &played) < chi_square_quantile(0.9999, 3), "{:?}", answers.last());
}

/// Measured places instead of a motion, a hundred a second, by a robot's own clock.
const MEASURED: [&str; 7] = ["--method", "follow", "--effective-mass-g", "0", "--json", "--path-sigma-mm", "0.005"];

#[test]
fn a_push_with_measured_places_is_followed_from_reading_to_reading() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let [table, path] = ["forces.csv", "path.csv"].map(|name| folder.path().join(name));
    std::fs::write(&table, forces(&played, REST_S, FORCE_SD_N)).unwrap();
    std::fs::write(&path, observe_path::places(observe_path::PLACE_SD_M)).unwrap();
    let follow = |arguments: &[&str]| {
        let mut command = observe(&MEASURED);
        command.arg("--path").arg(&path).args(arguments).arg(&table).output().unwrap()
    };
    let output = follow(&[]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    // About steps of the acceleration nothing is read, and what is, is noisier.
    check_of(&answers(&output.stdout), &played, 30, 2.0);
    // Both clocks told: the path's is early by what its sigma allows.
    let tied = follow(&["--path-clock-s", "-0.007", "--clock-offset-ms", "1"]);
    check_of(&answers(&tied.stdout), &played, 30, 2.0);
    let both = follow(&["--clock-offset-ms", "1", "--motion-begins", "1.2"]);
    let said = unfolded(&text(&both.stderr).replace('│', ""));
    assert!(!both.status.success() && said.contains("and so does --motion-begins"), "{said}");
}

/// A robot's places through standard input, a bad row among them, while the push goes on.
#[cfg(unix)]
#[test]
fn a_push_is_followed_live_by_places_that_come_meanwhile() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let [table, path] = ["forces.csv", "path.csv"].map(|name| folder.path().join(name));
    std::fs::write(&table, forces(&played, 0.0, 0.0)).unwrap();
    let mut rows: Vec<_> = observe_path::places(observe_path::PLACE_SD_M).lines().map(str::to_owned).collect();
    rows.insert(20, "0.7, no, number".to_owned());
    std::fs::write(&path, rows.join("\n")).unwrap();
    let both = format!("{} {}", table.display(), example("motion.toml").display());
    let part = example("part.toml");
    let words = ["observe", "--json", "--part", part.to_str().unwrap(), "--method", "follow", "--path", "-"];
    let words: Vec<_> = words.into_iter().chain(["--path-sigma-mm", "0.005"]).map(Path::new).collect();
    let output = felt_live_beside(folder.path(), &both, &words, std::fs::File::open(&path).unwrap().into());
    let answers = answers(&output.stdout);
    let following = answers.iter().filter(|answer| answer["state"] == "following").count();
    assert!(following > 0, "{}{}", text(&output.stdout), text(&output.stderr));
    assert!(squared_error(answers.last().unwrap(), &played) < chi_square_quantile(0.9999, 3), "{:?}", answers.last());
    let said = unfolded(&text(&output.stderr).replace('│', ""));
    assert!(said.contains("a place on standard input is left out") && said.contains("line 21"), "{said}");
}

#[cfg(unix)]
#[test]
fn a_push_is_followed_live_over_a_terminal() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, 0.0, 0.0)).unwrap();
    let both = format!("{} {}", table.display(), example("motion.toml").display());
    let follow: &[&Path] = &[Path::new("--method"), Path::new("follow")];
    let output = observed_live(folder.path(), &both, &example("part.toml"), &example("motion.toml"), follow);
    let answers = answers(&output.stdout);
    let following: Vec<_> = answers.iter().filter(|answer| answer["state"] == "following").collect();
    assert!(!following.is_empty(), "{}{}", text(&output.stdout), text(&output.stderr));
    let last = answers.last().unwrap();
    assert!(squared_error(last, &played) < chi_square_quantile(0.9999, 3), "{last}");
}

/// The robot tells on an input of the board that it moves, 0.15 s before force is felt.
#[cfg(unix)]
#[test]
fn a_finger_that_is_on_its_way_is_followed_live() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let (table, motion) = (folder.path().join("forces.csv"), example("motion.toml"));
    std::fs::write(&table, blanked(&played, 0.0, 0.0)).unwrap();
    let both = format!("{} {}", table.display(), motion.display());
    let words = ["--method", "follow", "--motion-begins", "input:3"].map(Path::new);
    let output = observed_live(folder.path(), &format!("{both} input 3"), &example("part.toml"), &motion, &words);
    let answers = answers(&output.stdout);
    // How many readings pass until a search is done is the machine's affair.
    let following = answers.iter().filter(|answer| answer["state"] == "following").count();
    assert!(following > 0, "{}{}", text(&output.stdout), text(&output.stderr));
    assert!(text(&output.stderr).contains("input 3: the finger moves from t = "), "{}", text(&output.stderr));
    assert!(answers.first().unwrap()["t"].as_f64().unwrap() > MET_S, "{:?}", answers.first());
    assert!(squared_error(answers.last().unwrap(), &played) < chi_square_quantile(0.9999, 3), "{:?}", answers.last());

    let silent = observed_live(folder.path(), &both, &example("part.toml"), &motion, &words);
    assert_eq!(silent.status.code(), Some(1), "{}", text(&silent.stdout));
    let said = unfolded(&text(&silent.stderr).replace('│', ""));
    assert!(said.contains("input 3 has not told that the finger moves"), "{said}");
}

#[test]
fn a_beginning_that_nobody_can_know_is_refused() {
    let refused = |arguments: &[&str]| {
        let mut command = observe(&["--motion-begins"]);
        let output = command.args(arguments).arg("--motion").arg(example("motion.toml")).output().unwrap();
        assert_ne!(output.status.code(), Some(0), "{arguments:?}");
        unfolded(&text(&output.stderr))
    };
    let follow = ["--method", "follow"];
    for (arguments, wanted) in [
        (&["1.2", "forces.csv"][..], "say --method follow"),
        (&["input:8", "forces.csv"], "inputs 0 to 7"),
        (&["input:3", follow[0], follow[1], "forces.csv"], "a file of forces has no inputs"),
        (&["1.2", follow[0], follow[1], "-d", "sim"], "--motion-begins input:N"),
    ] {
        let said = refused(arguments);
        assert!(said.contains(wanted), "{arguments:?}: wanted {wanted}, got {said}");
    }
}
