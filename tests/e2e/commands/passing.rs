//! Parts that are carried past light barriers, and switches that read a plan: lines on standard input, and a
//! board's inputs, become poses and names.

use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use nalgebra::{Isometry2, Vector2};
use serde_json::Value;

use crate::PALPATE;
use crate::observe::{assert_fits_a_terminal, example, text};

/// What a command prints that is given lines.
fn with_lines(folder: &Path, arguments: &[&str], lines: &str) -> Output {
    let mut command = Command::new(PALPATE);
    command.args(arguments).current_dir(folder).env("COLUMNS", "80").env_remove("PALPATE_DEVICE");
    let mut child = command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(lines.as_bytes()).unwrap();
    child.wait_with_output().unwrap()
}

fn path(file: &Path) -> &str {
    file.to_str().unwrap()
}

/// The changes that parts make, in mm and degrees at the time 0.
fn changes(poses: &[&str], more: &[&str]) -> String {
    let (part, beams) = (example("part.toml"), example("passing.toml"));
    let mut arguments = vec!["simulate-passing", path(&part), "--passing", path(&beams)];
    poses.iter().for_each(|pose| arguments.extend(["--pose", pose]));
    arguments.extend(more);
    let output = with_lines(Path::new("."), &arguments, "");
    assert!(output.status.success(), "{}", text(&output.stderr));
    text(&output.stdout)
}

/// Holds an answer against where a part then is that was there at the time 0: its own uncertainty.
fn assert_placed(answer: &Value, start: Isometry2<f64>) {
    let t = answer["t"].as_f64().unwrap();
    let truth = Isometry2::translation(0.12 * t, 0.0) * start;
    let modes = answer["parts"][0]["modes"].as_array().unwrap();
    assert!(!modes.is_empty(), "{answer}");
    let is_truth = |mode: &Value| {
        let number = |index: usize| mode["pose"][index].as_f64().unwrap();
        let sd = |index: usize| mode["covariance"][index][index].as_f64().unwrap().sqrt();
        let off = Vector2::new(number(0) - truth.translation.x, number(1) - truth.translation.y);
        let turn = Isometry2::rotation(number(2)).rotation.angle_to(&truth.rotation);
        // And it tells something.
        sd(0) < 5e-4
            && sd(2) < 0.02
            && off.x.abs() < 5.0 * sd(0)
            && off.y.abs() < 5.0 * sd(1)
            && turn.abs() < 5.0 * sd(2)
    };
    assert!(modes.iter().any(is_truth), "{truth} of {answer}");
}

fn at(x_mm: f64, y_mm: f64, turn_deg: f64) -> Isometry2<f64> {
    Isometry2::new(Vector2::new(x_mm, y_mm) * 1e-3, turn_deg.to_radians())
}

#[test]
fn parts_that_pass_light_barriers_are_placed_as_they_go_by() {
    let (part, beams) = (example("part.toml"), example("passing.toml"));
    let lines = changes(&["-150,-10,30", "-420,12,205"], &["--seed", "3"]);
    let inscribe = |more: &[&str]| {
        let arguments = [&["inscribe", path(&part), "--passing", path(&beams)], more].concat();
        with_lines(Path::new("."), &arguments, &lines)
    };
    let output = inscribe(&["--json"]);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let answers: Vec<Value> = text(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let [first, second] = &answers[..] else { panic!("{answers:#?}") };
    assert_placed(first, at(-150.0, -10.0, 30.0));
    assert_placed(second, at(-420.0, 12.0, 205.0));

    let shown = text(&inscribe(&[]).stdout);
    assert_fits_a_terminal(&shown);
    assert!(shown.contains("part 2 has gone by") && shown.contains("± turn"), "{shown}");
}

#[test]
fn lines_of_barriers_that_cannot_be_used_are_told_and_lose_nothing_else() {
    let (part, beams) = (example("part.toml"), example("passing.toml"));
    let good = changes(&["-150,-10,30"], &[]);
    let lines = format!("# a comment\nnonsense\n0.1 99 1\n0.1 1 2\n{good}0 1 1\n");
    let arguments = ["inscribe", path(&part), "--passing", path(&beams), "--json"];
    let output = with_lines(Path::new("."), &arguments, &lines);
    assert_eq!(output.status.code(), Some(1));
    let said = text(&output.stderr);
    for complaint in ["`nonsense` is not", "`99` is no switch", "`2` is no reading", "the time 0 s is before"] {
        assert!(said.contains(complaint), "{complaint}: {said}");
    }
    let answer: Value = serde_json::from_str(text(&output.stdout).trim()).unwrap();
    assert_placed(&answer, at(-150.0, -10.0, 30.0));

    // One barrier is dark.
    let dark: String = changes(&["-150,-10,30", "-420,12,205", "-690,0,10"], &[])
        .lines()
        .filter(|line| !line.contains(" 2 "))
        .map(|line| format!("{line}\n"))
        .collect();
    let output = with_lines(Path::new("."), &arguments, &dark);
    assert!(
        text(&output.stderr).contains("barrier 2 has seen no part while others saw several"),
        "{}",
        text(&output.stderr)
    );
    assert!(text(&output.stdout).is_empty());
}

/// What the outlines are called.
const NAMES: [&str; 4] = ["a", "b", "c", "d"];

/// Two bars across two others, three pieces of each being in no other: a plan may correct a point.
fn plan(folder: &Path, more: &[&str]) -> Value {
    let bar = |name: &str, [x, y]: [i32; 2], [w, h]: [i32; 2]| {
        let corners = format!("[[{x}, {y}], [{}, {y}], [{}, {}], [{x}, {}]]", x + w, x + w, y + h, y + h);
        format!("[[shape]]\nname = '{name}'\nvertices = {corners}\n")
    };
    let (flat, upright) = ([60, 10], [10, 60]);
    let places = [([0, 10], flat), ([0, 30], flat), ([10, 0], upright), ([30, 0], upright)];
    let bars = NAMES.iter().zip(places).map(|(name, (at, size))| bar(name, at, size));
    let scene = format!("unit = 'mm'\n{}", bars.collect::<String>());
    std::fs::write(folder.join("scene.toml"), scene).unwrap();
    let arguments = [&["sample", "scene.toml", "--json"], more].concat();
    let output = with_lines(folder, &arguments, "");
    assert!(output.status.success(), "{}", text(&output.stderr));
    std::fs::write(folder.join("plan.json"), &output.stdout).unwrap();
    serde_json::from_slice(&output.stdout).unwrap()
}

/// Lines that set all points of a plan to an outline's signature from a time on, each contact bouncing.
fn readings(plan: &Value, outline: usize, t: f64, stuck: Option<usize>) -> String {
    let signature = plan["signatures"][outline].as_array().unwrap();
    let line = |(point, bit): (usize, &Value)| {
        let bit = if Some(point) == stuck { 0 } else { bit.as_u64().unwrap() };
        let id = point + 1;
        format!("{t:.4} {id} {bit}\n{:.4} {id} {}\n{:.4} {id} {bit}\n", t + 1e-3, 1 - bit, t + 2e-3)
    };
    let mut lines: Vec<String> =
        signature.iter().enumerate().map(line).collect::<String>().lines().map(str::to_owned).collect();
    lines.sort_by(|a, b| a.split(' ').next().cmp(&b.split(' ').next()));
    lines.iter().map(|line| format!("{line}\n")).collect()
}

#[test]
fn switches_that_change_name_each_part_once_they_settle() {
    let folder = tempfile::tempdir().unwrap();
    let plan = plan(folder.path(), &["--correct", "1"]);
    // From the second round on the first point that reads 1 of the first outline is stuck at 0.
    let stuck = plan["signatures"][0].as_array().unwrap().iter().position(|bit| *bit == 1).unwrap();
    let lines: String = (0..8)
        .map(|part| readings(&plan, [0, 1, 2, 3, 0, 1, 0, 0][part], 1.0 + part as f64, (part >= 4).then_some(stuck)))
        .collect();
    let output = with_lines(folder.path(), &["sample", "--decode", "plan.json", "--correct", "1", "--json"], &lines);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let told: Vec<Value> = text(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let found: Vec<_> = told.iter().map(|told| told["name"].as_str().unwrap_or("?")).collect();
    // A part like the one before changes nothing, and is not told again.
    assert_eq!(found, ["a", "b", "c", "d", "a", "b", "a"], "{told:?}");
    assert_eq!(told[4]["misread"][0][0], stuck + 1, "{told:?}");

    // Without a part's name where it is not certain.
    let output = with_lines(folder.path(), &["sample", "--decode", "plan.json", "1?????????????", "--json"], "");
    assert!(!output.status.success(), "{}", text(&output.stdout));
}

/// The same by the digital inputs of a simulated board, which run through the whole protocol.
#[cfg(unix)]
#[test]
fn a_boards_inputs_name_parts() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, link) = (plan(folder.path(), &[]), folder.path().join("finger"));
    let levels = |outline: usize| -> String {
        plan["signatures"][outline].as_array().unwrap().iter().rev().map(ToString::to_string).collect()
    };
    // The first wait is for the program that reads to be there.
    let changes: String = (0..4).map(|outline| format!("wait 1\ninputs {:0>8}\n", levels(outline))).collect();
    let spawn = |arguments: &[&str]| {
        let mut command = Command::new(PALPATE);
        command.args(arguments).current_dir(folder.path());
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap()
    };
    let mut device = spawn(&["simulate-device", "--link", path(&link)]);
    let mut orders = device.stdin.take().unwrap();
    orders.write_all(format!("wait 4\n{changes}wait 1\nquit\n").as_bytes()).unwrap();
    while !link.exists() {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let reader = spawn(&["sample", "--decode", "plan.json", "-d", path(&link), "--json"]);
    device.wait().unwrap();
    // It would wait for the board to come back.
    crate::progress::interrupt(&reader);
    let told = text(&reader.wait_with_output().unwrap().stdout);
    let told: Vec<Value> = told.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let names: Vec<_> = told.iter().filter_map(|told| told["name"].as_str()).collect();
    assert!(names.ends_with(&NAMES), "{told:?}");
}
