//! A part is pushed, and the real binary names its pose: live over a pseudo-terminal, and from files.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use nalgebra::Isometry2;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::EndReason;
use palpate::pushing::estimation::Shortlist;
use palpate::pushing::pushed_world::{Played, PushedWorld};
use palpate_files::part::PolygonFile;
use palpate_tests::project;
use serde_json::{Value, json};

use crate::PALPATE;

/// Seed of the simulated finger, whose calibration is that of another one with the same seed.
const SEED: &str = "7";

/// Largest error of the centre of mass, m, and of the angle, rad: five times what is stated of half a kilogram felt
/// through a finger (0.08 mm and 3.8 mrad), whose noise is another one in each run. The part's frame is at a corner, 60 mm
/// from the centre of mass, and so is off with every error of the angle: nothing is held to where that is.
const POSE_ERROR: (f64, f64) = (4e-4, 0.019);

pub(super) fn example(name: &str) -> PathBuf {
    project::folder().join("examples").join(name)
}

fn palpate(arguments: &[&str]) -> Command {
    let mut command = Command::new(PALPATE);
    command.args(arguments).env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION");
    command
}

pub(super) fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Prose as it was before it was broken into lines.
pub(super) fn unfolded(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Nothing is wider than eighty columns.
pub(super) fn assert_fits_a_terminal(text: &str) {
    for line in text.lines() {
        assert!(line.chars().count() <= 80, "{} columns: {line}", line.chars().count());
    }
}

/// A picture was drawn that shows these words.
pub(super) fn assert_names(picture: &Path, words: &[&str]) {
    let svg = std::fs::read_to_string(picture).unwrap_or_else(|error| panic!("{}: {error}", picture.display()));
    for word in words {
        assert!(svg.contains(&format!("aria-label=\"{word}\"")), "{word} is not in {}", picture.display());
    }
}

/// The example part, pushed at its edge 3 as the example motion says; half a kilogram.
pub(super) fn pushed() -> Played {
    pushed_by(&std::fs::read_to_string(example("motion.toml")).unwrap())
}

/// The same as another motion file says.
fn pushed_by(motion: &str) -> Played {
    let file = PolygonFile::parse(&std::fs::read_to_string(example("part.toml")).unwrap()).unwrap();
    let motion = palpate_files::motion::parse(motion).unwrap();
    let (part, mu_g) = (&file.part, file.mu * GRAVITY_ASSUMED);
    let world =
        PushedWorld { part, mu_g, mass: 0.5, mu_c: 0.25, radius: 0.015, motion: &motion, edge: 3, u: 0.3, s: -0.004 };
    let played = world.play().unwrap();
    assert_eq!(played.end, EndReason::Time);
    played
}

/// A table of forces: `rest` seconds without, then the push; noise of `sd` N on every value.
pub(super) fn forces(played: &Played, rest: f64, sd: f64) -> String {
    let mut draw = Draw::case(1, 0);
    let mut table = "t [s], Fx [N], Fy [N]\n".to_owned();
    let mut line = |t: f64, x: f64, y: f64| {
        let (x, y) = (x + sd * draw.normal(), y + sd * draw.normal());
        writeln!(table, "{t:.6}, {x:.6}, {y:.6}").unwrap();
    };
    let step = 250e-6;
    let at_rest =
        std::iter::successors(Some(0.0), |k| Some(k + 1.0)).map(|k| k * step).take_while(|t| *t < rest - 1e-9);
    at_rest.for_each(|t| line(t, 0.0, 0.0));
    let mut last = -1.0;
    for (sample, force) in played.samples.iter().zip(&played.forces_finger) {
        // Where the finger's acceleration changes there are two.
        if sample.t > last + 0.5 * step {
            line(rest + sample.t, force.x, force.y);
            last = sample.t;
        }
    }
    table
}

/// Checks the only pose that an answer lists.
pub(super) fn check(answer: &Value, played: &Played) {
    assert_eq!(answer["status"], "unique", "{answer}");
    let pose: Vec<f64> =
        answer["hypotheses"][0]["pose_end"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    check_pose(&Isometry2::new([pose[0], pose[1]].into(), pose[2]), played, answer["t"].as_f64().unwrap(), answer);
}

/// Checks a pose of the example part, `t` s after a push of it began.
pub(super) fn check_pose(found: &Isometry2<f64>, played: &Played, t: f64, said: &Value) {
    let centre =
        PolygonFile::parse(&std::fs::read_to_string(example("part.toml")).unwrap()).unwrap().part.centre_of_mass();
    let truth = played.pose(t).unwrap();
    let distance = (found * centre - truth * centre).norm();
    let angle = found.rotation.angle_to(&truth.rotation).abs();
    assert!(distance < POSE_ERROR.0 && angle < POSE_ERROR.1, "off by {distance:e} m, {angle:e} rad: {said}");
}

pub(super) fn last_answer(output: &Output) -> Value {
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    serde_json::from_str(said.lines().last().unwrap()).unwrap()
}

/// `palpate observe` on the example part.
pub(super) fn observe(arguments: &[&str]) -> Command {
    let mut command = palpate(&["observe", "--part"]);
    command
        .arg(example("part.toml"))
        .args(arguments)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

#[cfg(unix)]
#[test]
fn a_push_felt_live_over_a_terminal_names_the_pose() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, 0.0, 0.0)).unwrap();
    let both = format!("{} {}", table.display(), example("motion.toml").display());
    let picture = folder.path().join("push.svg");
    let plot = [Path::new("--plot"), &picture];
    let output = observed_live(folder.path(), &both, &example("part.toml"), &example("motion.toml"), &plot);
    check(&last_answer(&output), &played);
    assert_names(&picture, &["x, explained", "Felt and not explained, with two standard deviations", "0.8 s"]);
    // Estimates came as the push went on, not only at its end.
    assert!(text(&output.stdout).lines().count() > 3, "{}", text(&output.stdout));
}

/// What `observe` says of forces that a simulated device plays once it is ready.
#[cfg(unix)]
pub(super) fn observed_live(folder: &Path, played: &str, part: &Path, motion: &Path, more: &[&Path]) -> Output {
    let of_push = [Path::new("observe"), Path::new("--json"), Path::new("--part"), part, Path::new("--motion"), motion];
    felt_live(folder, played, &[&of_push, more].concat())
}

/// What a command that watches a push says of forces that a simulated device plays once it is ready.
#[cfg(unix)]
pub(super) fn felt_live(folder: &Path, played: &str, words: &[&Path]) -> Output {
    felt_live_beside(folder, played, words, Stdio::null())
}

/// The same with a standard input.
#[cfg(unix)]
pub(super) fn felt_live_beside(folder: &Path, played: &str, words: &[&Path], input: Stdio) -> Output {
    use std::io::{BufRead as _, BufReader};

    let calibrate = palpate(&["calibrate", "-d", &format!("sim:{SEED}"), "--load", "2 N", "--contacts", "6", "--out"])
        .arg(folder)
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let report = text(&calibrate.stdout);
    let calibration =
        report.lines().find_map(|line| line.strip_prefix("written")).unwrap_or_else(|| panic!("{report}"));

    let mut device =
        palpate(&["simulate-device", "--seed", SEED]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let (mut orders, mut answers) =
        (device.stdin.take().unwrap(), BufReader::new(device.stdout.take().unwrap()).lines());
    let path = answers.next().unwrap().unwrap();
    let mut command = palpate(&[]);
    command.args(words).args(["-d", &path, "-c", calibration.trim()]);
    command.stdin(input).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut observer = command.spawn().unwrap();
    let mut told = BufReader::new(observer.stderr.take().unwrap()).lines().map_while(Result::ok);
    let mut said = Vec::new();
    while !said.last().is_some_and(|line: &String| line.contains("ready")) {
        said.push(told.next().unwrap_or_else(|| panic!("it never got ready: {said:?}")));
    }
    // What else it says is read, or it would wait for that.
    let rest = std::thread::spawn(move || said.into_iter().chain(told).collect::<Vec<_>>().join("\n"));
    writeln!(orders, "play {played}").unwrap();
    let mut output = observer.wait_with_output().unwrap();
    output.stderr = rest.join().unwrap().into_bytes();
    let _ = writeln!(orders, "quit");
    let _ = device.wait();
    output
}

/// Of another finger than the demo's, which feels it with its own noise.
#[cfg(unix)]
#[test]
fn a_push_that_a_demo_kept_can_be_played_and_observed_again() {
    let folder = tempfile::tempdir().unwrap();
    let kept = folder.path().join("kept");
    let mut demo = palpate(&["demo", "--seed", "3", "--part"]);
    let demo = demo.arg(example("part.toml")).arg("--keep").arg(&kept).output().unwrap();
    let said = unfolded(&text(&demo.stdout));
    let [part, motion, forces] = ["part.toml", "motion.toml", "played.csv"].map(|name| kept.join(name));
    // The finger that feels it again is moved as the first one was.
    let both = format!("{} {}", forces.display(), motion.display());
    let answer = last_answer(&observed_live(folder.path(), &both, &part, &motion, &[]));
    assert_eq!(answer["status"], "unique", "{answer}");
    // "edge 2, centre of mass at (81.06, 31.04) mm, turned 136.03°; ..."
    let truth = said.split("The truth").nth(1).unwrap();
    let number = |before: &str, after: char| -> f64 {
        truth.split(before).nth(1).unwrap().split(after).next().unwrap().parse().unwrap()
    };
    let [x, y, turned] = [
        number("mass at (", ','),
        truth.split("mass at (").nth(1).unwrap().split([' ', ')']).nth(1).unwrap().parse().unwrap(),
        number("turned ", '°'),
    ];
    let truth = Isometry2::new([x * 1e-3, y * 1e-3].into(), turned.to_radians());
    let file = PolygonFile::parse(&std::fs::read_to_string(part).unwrap()).unwrap();
    let pose: Vec<f64> =
        answer["hypotheses"][0]["pose_end"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    let found = Isometry2::new([pose[0], pose[1]].into(), pose[2]);
    let distance = (found * file.part.centre_of_mass() - truth.translation.vector).coords.norm();
    let angle = found.rotation.angle_to(&truth.rotation).abs();
    assert!(distance < POSE_ERROR.0 && angle < POSE_ERROR.1, "off by {distance:e} m, {angle:e} rad: {said} {answer}");
}

#[test]
fn forces_from_a_file_and_a_motion_from_standard_input_name_the_pose() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, 1.5, 0.01)).unwrap();
    let mut child = observe(&["--json", "--motion", "-"]).arg(&table).stdin(Stdio::piped()).spawn().unwrap();
    let mut motion = child.stdin.take().unwrap();
    writeln!(motion, "{{\"seconds\": 0.3, \"acceleration\": [0.15, 0]}}").unwrap();
    writeln!(motion, "{{\"seconds\": 0.5, \"acceleration\": [0, 0.15]}}").unwrap();
    drop(motion);
    check(&last_answer(&child.wait_with_output().unwrap()), &played);
}

/// Accelerations that a robot reaches in 20 ms, told so, and told as steps.
#[test]
fn accelerations_that_rise_are_told_or_named_as_the_cause() {
    let folder = tempfile::tempdir().unwrap();
    let steps = std::fs::read_to_string(example("motion.toml")).unwrap();
    let risen = steps.replace("[[segment]]", "[[segment]]\nrise_seconds = 0.02");
    let (motion, table) = (folder.path().join("motion.toml"), folder.path().join("forces.csv"));
    let played = pushed_by(&risen);
    std::fs::write(&motion, &risen).unwrap();
    std::fs::write(&table, forces(&played, 1.5, 0.003)).unwrap();
    check(&last_answer(&observe(&["--json", "--motion"]).arg(&motion).arg(&table).output().unwrap()), &played);

    let mut child = observe(&["--json", "--motion", "-"]).arg(&table).stdin(Stdio::piped()).spawn().unwrap();
    let mut lines = child.stdin.take().unwrap();
    writeln!(lines, "{{\"seconds\": 0.3, \"acceleration\": [0.15, 0], \"rise_seconds\": 0.02}}").unwrap();
    writeln!(lines, "{{\"seconds\": 0.5, \"acceleration\": [0, 0.15], \"rise_seconds\": 0.02}}").unwrap();
    drop(lines);
    check(&last_answer(&child.wait_with_output().unwrap()), &played);

    let part = std::fs::read_to_string(example("part.toml")).unwrap();
    let said = told_wrong(&part, &std::fs::read_to_string(&table).unwrap(), &[]);
    let rise = said.split_once("every acceleration is reached in ").and_then(|(_, rest)| rest.split_once(" ms"));
    let rise: f64 = rise.unwrap_or_else(|| panic!("{said}")).0.parse().unwrap();
    // What noise of 3 mN leaves open, ms.
    assert!((rise - 20.0).abs() < 2.0, "{said}");
}

/// Rows left out are told with every answer, and what a sensor repeats is no force: exit status 3.
#[test]
fn what_samples_of_a_push_lack_is_said_by_every_answer() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let table = forces(&played, 1.2, 1e-3);
    let rows: Vec<&str> = table.lines().collect();
    // The push begins in row 4801, behind the headings; this is 0.3 s later.
    let there = 6001;
    let answer = |name: &str, rows: Vec<&str>| {
        let file = folder.path().join(name);
        std::fs::write(&file, rows.join("\n")).unwrap();
        let mut command = observe(&["--json", "--motion"]);
        let output = command.arg(example("motion.toml")).arg(&file).output().unwrap();
        let last = text(&output.stdout).lines().last().map(str::to_owned).unwrap();
        (serde_json::from_str::<Value>(&last).unwrap(), output.status.code(), text(&output.stderr))
    };
    let kept = rows.iter().enumerate().filter(|(row, _)| !(there..there + 16).contains(row)).map(|(_, row)| *row);
    let (lossy, status, told) = answer("lost.csv", kept.collect());
    check(&lossy, &played);
    assert_eq!((lossy["samples"]["missing"].as_u64(), status), (Some(16), Some(0)), "{lossy}");
    assert!(told.contains("since the push began: 16 missing"), "{told}");
    // The time goes on, the values do not.
    let frozen: Vec<String> = rows
        .iter()
        .enumerate()
        .map(|(row, line)| match row {
            row if row > there => {
                let time = line.split(',').next().unwrap();
                format!("{time}{}", &rows[there][rows[there].find(',').unwrap()..])
            }
            _ => (*line).to_owned(),
        })
        .collect();
    let (stuck, status, told) = answer("stuck.csv", frozen.iter().map(String::as_str).collect());
    let count = stuck["samples"]["stuck"][0].as_u64().unwrap();
    assert!((1500..2000).contains(&count) && status == Some(3), "{stuck}");
    assert!(told.contains("stuck on x"), "{told}");
    assert!(stuck["t"].as_f64().unwrap() < 0.45, "nothing behind the fault is used: {stuck}");
}

#[test]
fn another_part_explains_nothing_and_that_is_said() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let (table, part) = (folder.path().join("forces.csv"), folder.path().join("part.toml"));
    std::fs::write(&table, forces(&played, 1.5, 0.003)).unwrap();
    std::fs::write(&part, "unit = 'mm'\nvertices = [[0, 0], [30, 0], [30, 22], [0, 20]]\nmu = 0.25").unwrap();
    let mut command = palpate(&["observe", "--part"]);
    let output = command.arg(&part).arg(&table).arg("--motion").arg(example("motion.toml")).output().unwrap();
    let said = text(&output.stdout);
    assert!(said.contains("No pose of this part explains what was felt"), "{said}{}", text(&output.stderr));
}

#[test]
fn what_cannot_be_used_is_named_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, content: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, content).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let motion = example("motion.toml").to_str().unwrap().to_owned();
    let quiet =
        file("quiet.csv", &forces(&Played { samples: vec![], forces_finger: vec![], end: EndReason::Time }, 3.0, 0.01));
    let late = file("late.csv", &forces(&pushed(), 0.3, 0.01));
    let standing = file("standing.toml", "unit = 'mm'\n[[segment]]\nseconds = 1\nacceleration = [0, 0]");
    let cases = [
        (vec![quiet.as_str(), "--motion", &motion], "no push was felt"),
        (vec![&late, "--motion", &motion], "not at rest while the tare was taken"),
        (vec![&quiet, "--motion", &standing], "segment 0 has no acceleration"),
        (vec![&quiet, "--motion", "nowhere.toml"], "nowhere.toml"),
    ];
    for (arguments, wanted) in cases {
        let output = observe(&arguments).output().unwrap();
        let said = text(&output.stderr);
        // The message may be broken over lines.
        let said = said.replace("\n  │ ", " ").split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(!output.status.success() && said.contains(wanted), "wanted `{wanted}` in: {said}");
    }
}

#[test]
fn the_demo_reveals_the_truth_and_what_it_keeps_says_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (part, kept) = (example("part.toml"), folder.path().join("kept"));
    let mut demo = palpate(&["demo", "--seed", "3", "--part"]);
    let output = demo.arg(&part).arg("--keep").arg(&kept).output().unwrap();
    let said = text(&output.stdout);
    assert!(output.status.success(), "{said}{}", text(&output.stderr));
    let off = said
        .lines()
        .find_map(|line| line.strip_prefix("The likeliest pose is off by "))
        .unwrap_or_else(|| panic!("{said}"));
    let millimetres: f64 = off.split(' ').next().unwrap().parse().unwrap();
    assert!(millimetres < POSE_ERROR.0 * 1e3, "{said}");
    assert!(said.contains("One pose explains what was felt") && said.contains("Nothing here was measured"), "{said}");

    let mut again = palpate(&["observe", "--json", "--part"]);
    let again = again.arg(kept.join("part.toml")).arg("--motion").arg(kept.join("motion.toml"));
    let answer = last_answer(&again.arg(kept.join("forces.csv")).output().unwrap());
    let best = &answer["hypotheses"][0];
    let [mass, sd] = ["mass", "mass_log_sd"].map(|name| best[name].as_f64().unwrap());
    let said = unfolded(&said);
    let truth = said.split("The truth").nth(1).unwrap();
    let wanted: f64 = truth.split("°; ").nth(1).unwrap().split(' ').next().unwrap().parse().unwrap();
    // The friction of the plane counts as known to 20 %, and the mass is told by what resists beside it.
    assert!((mass / wanted).ln().abs() < 4.0 * sd && sd < 0.1, "{mass} kg within {sd}, {wanted} wanted");
}

/// The push that the manual names as one of several poses: what is felt repeats to the digit, so that it always is.
#[test]
fn a_demo_that_is_quoted_repeats() {
    let folder = tempfile::tempdir().unwrap();
    let mut told = ["once", "again"].map(|name| {
        let kept = folder.path().join(name);
        let output = palpate(&["demo", "--straight", "--seed", "21", "--keep"]).arg(&kept).output().unwrap();
        let said = text(&output.stdout);
        // Its terminal has another number each time.
        let said = said.lines().skip(1).collect::<Vec<_>>().join("\n");
        (said, std::fs::read_to_string(kept.join("forces.csv")).unwrap())
    });
    assert_eq!(told[0], told[1]);
    let said = unfolded(&std::mem::take(&mut told[0].0));
    assert!(said.contains("poses explain what was felt"), "{said}");
}

/// Whether two numbers, as printed, are one but for what differs from processor to processor: a search that ends where
/// it gains no more ends elsewhere by a hundredth of what it finds, and rounding moves the last place.
fn told_alike(a: &str, b: &str) -> bool {
    const ELSEWHERE: f64 = 0.01;
    let places = |text: &str| text.split_once('.').map_or(0, |(_, places)| places.len());
    let last_place = 0.1_f64.powi(i32::try_from(places(a)).unwrap());
    let near = |a: f64, b: f64| (a - b).abs() <= (ELSEWHERE * a.abs()).max(1.5 * last_place);
    places(a) == places(b) && a.parse().ok().zip(b.parse().ok()).is_some_and(|(a, b)| near(a, b))
}

#[test]
fn numbers_that_are_told_alike_have_as_many_places() {
    assert!(told_alike("-1.00", "-1.01") && told_alike("0.360", "0.363") && told_alike("300", "302"));
    assert!(!told_alike("-1.00", "1.00") && !told_alike("0.360", "0.367") && !told_alike("0.3", "0.30"));
}

#[test]
fn the_front_page_shows_what_the_demos_say() {
    let page = std::fs::read_to_string(palpate_tests::project::folder().join("README.md")).unwrap();
    let said = text(&palpate(&["demo"]).output().unwrap().stdout);
    let shown = said.find("The part, in mm").zip(said.find("Nothing here was measured"));
    let shown = shown.map(|(begin, end)| said[begin..end].trim_end()).unwrap_or_else(|| panic!("{said}"));
    let quoted = page.split("```").find(|block| block.contains("The part, in mm")).expect("it is there");
    let quoted = quoted[quoted.find("The part, in mm").unwrap()..].trim_end();
    let is_alike = palpate_tests::project::texts_alike(quoted, shown, told_alike);
    assert!(is_alike, "README.md shows no longer what `palpate demo` says:\n{shown}");
    let said = text(&palpate(&["demo", "--static"]).output().unwrap().stdout);
    let block = page.split("```").find(|block| block.contains("Felt with 2 N")).expect("it is there");
    for line in block.lines().filter(|line| !line.trim().is_empty() && line.trim() != "...") {
        assert!(said.lines().any(|told| told == line), "README.md: no `{line}` in:\n{said}");
    }
}

#[test]
fn the_demo_says_what_cannot_be_told_apart() {
    let folder = tempfile::tempdir().unwrap();
    let square = folder.path().join("square.toml");
    std::fs::write(&square, "unit = 'mm'\nvertices = [[0, 0], [80, 0], [80, 80], [0, 80]]\nmu = 0.3").unwrap();
    let output = palpate(&["demo", "--seed", "2", "--part"]).arg(&square).output().unwrap();
    let said = text(&output.stdout);
    assert!(unfolded(&said).contains("looks the same in 4 orientations"), "{said}{}", text(&output.stderr));
}

/// A rectangle of two kinds of edge, pushed straight through its centre of mass: whichever edge it is, it does not
/// turn.
const RECTANGLE: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 30], [0, 30]]\nmu = 0.25";

/// See [`RECTANGLE`].
const STRAIGHT: &str = "unit = 'mm'\n[[segment]]\nseconds = 0.5\nacceleration = [120, 0]";

/// Files of a straight push of the rectangle: part, motion and forces.
fn pushed_straight(folder: &Path) -> [PathBuf; 3] {
    let file = PolygonFile::parse(RECTANGLE).unwrap();
    let motion = palpate_files::motion::parse(STRAIGHT).unwrap();
    let (part, mu_g) = (&file.part, file.mu * GRAVITY_ASSUMED);
    let world =
        PushedWorld { part, mu_g, mass: 0.5, mu_c: 0.3, radius: 0.015, motion: &motion, edge: 0, u: 0.0, s: 0.0 };
    let contents = [RECTANGLE.to_owned(), STRAIGHT.to_owned(), forces(&world.play().unwrap(), 1.5, 0.003)];
    let paths = ["part.toml", "motion.toml", "forces.csv"].map(|name| folder.join(name));
    paths.iter().zip(contents).for_each(|(path, content)| std::fs::write(path, content).unwrap());
    paths
}

fn plan_push([part, motion, forces]: &[PathBuf; 3], arguments: &[&str]) -> Output {
    let mut command = palpate(&["plan-push", "--part"]);
    command.arg(part).arg("--motion").arg(motion).arg(forces).args(arguments).output().unwrap()
}

#[test]
fn the_planner_turns_aside_where_a_straight_push_leaves_edges_alike() {
    let folder = tempfile::tempdir().unwrap();
    let files = pushed_straight(folder.path());
    let answer = last_answer(&plan_push(&files, &["--json", "--acceleration-mm-s2", "150"]));
    assert_eq!(answer["estimate"]["status"], "ambiguous", "{answer}");
    let motions = answer["motions"].as_array().unwrap();
    let risks: Vec<_> = motions.iter().map(|motion| motion["risk"].as_f64().unwrap()).collect();
    assert!(motions.len() == 8 && risks.is_sorted(), "{answer}");
    assert_eq!(answer["recommended"], motions[0]["motion"]);
    let straight = motions.iter().position(|motion| motion["motion"] == "straight on").unwrap();
    assert!(risks[0] < 0.5 * risks[straight], "{answer}");
    // The segments of every motion take the time asked for.
    for motion in motions {
        let seconds = motion["segments"].as_array().unwrap().iter().map(|part| part["seconds"].as_f64().unwrap());
        assert!((seconds.sum::<f64>() - 0.5).abs() < 1e-12, "{motion}");
    }
    let said = text(&plan_push(&files, &["--acceleration-mm-s2", "150"]).stdout);
    let recommended = format!("Go {}: accelerate by (", answer["recommended"].as_str().unwrap());
    assert!(unfolded(&said).contains("If the finger goes on for 0.5 s"), "{said}");
    assert!(unfolded(&said).contains(&recommended), "{said}");
    assert_fits_a_terminal(&said);
}

#[test]
fn the_planner_leaves_out_what_the_finger_cannot_do() {
    let folder = tempfile::tempdir().unwrap();
    let files = pushed_straight(folder.path());
    // It goes 60 mm/s now.
    let answer = last_answer(&plan_push(&files, &["--json", "--speed-max-mm-s", "61"]));
    let motions = answer["motions"].as_array().unwrap();
    assert!(motions.len() == 1 && motions[0]["motion"] == "straight on", "{answer}");
    let refused = plan_push(&files, &["--speed-max-mm-s", "10"]);
    let said = text(&refused.stderr);
    assert!(!refused.status.success() && said.contains("60.0 mm/s") && said.contains("--speed-max-mm-s"), "{said}");
}

#[test]
fn the_part_that_was_pushed_is_named() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let (table, other) = (folder.path().join("forces.csv"), folder.path().join("other.toml"));
    std::fs::write(&table, forces(&played, 1.5, 0.003)).unwrap();
    std::fs::write(&other, RECTANGLE).unwrap();
    let mut command = palpate(&["which-part", "--json", "--part"]);
    let command = command.arg(&other).arg("--part").arg(example("part.toml"));
    let output = command.arg("--motion").arg(example("motion.toml")).arg(&table).output().unwrap();
    let said = text(&output.stdout);
    let answer: Value = serde_json::from_str(&said).unwrap_or_else(|_| panic!("{said}{}", text(&output.stderr)));
    let named = &answer["parts"][0];
    assert!(named["part"].as_str().unwrap().ends_with("part.toml"), "{answer}");
    assert!(named["probability"].as_f64().unwrap() > 0.99, "{answer}");
    check(&named["estimate"], &played);
}

#[test]
fn how_to_push_on_is_told_where_two_parts_feel_alike() {
    let folder = tempfile::tempdir().unwrap();
    let [part, motion, table] = pushed_straight(folder.path());
    // As long as it goes straight a longer rectangle feels as one of 60 mm.
    let longer = folder.path().join("longer.toml");
    std::fs::write(&longer, RECTANGLE.replace("60", "90")).unwrap();
    let which = |more: &[&str]| {
        let mut command = palpate(&["which-part", "--part"]);
        command
            .arg(&part)
            .arg("--part")
            .arg(&longer)
            .arg("--motion")
            .arg(&motion)
            .args(more)
            .arg(&table)
            .output()
            .unwrap()
    };
    let (answer, said) = (last_answer(&which(&["--json"])), text(&which(&[]).stdout));
    let likely = |part: &Value| part["probability"].as_f64().unwrap() > 0.1;
    assert!(answer["parts"].as_array().unwrap().iter().all(likely), "{answer}");
    // People and programs are told alike, and to turn.
    let name = answer["next_push"]["motion"].as_str().unwrap();
    let turns = |segment: &Value| segment["acceleration"][1].as_f64().unwrap().abs() > 0.05;
    assert!(answer["next_push"]["segments"].as_array().unwrap().iter().any(turns), "{answer}");
    assert!(unfolded(&said).contains(&format!("To tell them apart: Go {name}")), "{said}{answer}");
    assert_fits_a_terminal(&said);
}

#[test]
fn the_part_that_was_pushed_is_named_from_a_library() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let library = folder.path().join("library");
    std::fs::create_dir(&library).unwrap();
    std::fs::copy(example("part.toml"), library.join("part.toml")).unwrap();
    // The library has no other kind of file.
    std::fs::write(library.join("README"), "parts").unwrap();
    for (number, side) in [20, 30, 45, 70].into_iter().enumerate() {
        let square =
            format!("unit = 'mm'\nmu = 0.25\nvertices = [[0, 0], [{side}, 0], [{side}, {side}], [0, {side}]]\n");
        std::fs::write(library.join(format!("square-{number}.toml")), square).unwrap();
    }
    let table = folder.path().join("forces.csv");
    std::fs::write(&table, forces(&played, 1.5, 0.003)).unwrap();
    let which = |library: &Path, more: &[&str]| {
        let mut command = palpate(&["which-part", "--library"]);
        command.arg(library).arg("--motion").arg(example("motion.toml")).args(more).arg(&table).output().unwrap()
    };
    let answer = last_answer(&which(&library, &["--json"]));
    let named = &answer["parts"][0];
    assert!(named["part"].as_str().unwrap().ends_with("part.toml"), "{answer}");
    assert!(named["probability"].as_f64().unwrap() > 0.99, "{answer}");
    check(&named["estimate"], &played);
    // Each part is searched or said to be left out.
    let [searched, left_out] = ["parts", "left_out"].map(|list| answer[list].as_array().unwrap());
    assert_eq!(searched.len() + left_out.len(), 5, "{answer}");
    let is_far = |part: &Value| part["misfit"].as_f64().unwrap() > Shortlist::MISFIT_MAX;
    assert!(!left_out.is_empty() && left_out.iter().all(is_far), "{answer}");
    let said = text(&which(&library, &[]).stdout);
    assert_fits_a_terminal(&said);
    assert!(unfolded(&said).contains(&format!("Left out are {} of 5 parts", left_out.len())), "{said}");
    assert!(unfolded(&said).contains("A part that is not in the library may feel like one of it"), "{said}");
    assert!(answer["next_push"].is_null(), "{answer}");
    // A second push is held to what the first left: to the one part, which it too is explained by.
    let first = folder.path().join("first.json");
    std::fs::write(&first, answer.to_string()).unwrap();
    let earlier = ["--earlier", first.to_str().unwrap()];
    let both = last_answer(&which(&library, &[&earlier[..], &["--json"]].concat()));
    assert_eq!(both["parts"].as_array().unwrap().len(), 1, "{both}");
    let none = |answer: &Value| answer["none_of_these"].as_f64().unwrap();
    assert!(none(&both) < none(&answer), "{both}");
    let said = text(&which(&library, &earlier).stdout);
    assert_fits_a_terminal(&said);
    assert!(unfolded(&said).contains("Left out are 4 of 5, which"), "{said}");
    // Another part was pushed then: this push is none of what that one left.
    let square = answer["left_out"][0]["part"].as_str().unwrap();
    let of = |part: &str, mass: f64| {
        let estimate = json!({ "hypotheses": [{ "probability": 1.0, "mass": mass, "mass_log_sd": 0.01 }] });
        json!({ "parts": [{ "part": part, "probability": 1.0, "estimate": estimate }], "none_of_these": 0.1 })
    };
    let other = of(square, 0.5);
    std::fs::write(&first, other.to_string()).unwrap();
    let neither = last_answer(&which(&library, &[&earlier[..], &["--json"]].concat()));
    assert!((none(&neither) - 1.0).abs() < 1e-9, "{neither}");
    // The same part was, but of another mass.
    let named = named["part"].as_str().unwrap();
    let mass = answer["parts"][0]["estimate"]["hypotheses"][0]["mass"].as_f64().unwrap();
    for (times, told) in [(1.01, 0.0..0.1), (1.5, 0.999..1.1)] {
        std::fs::write(&first, of(named, times * mass).to_string()).unwrap();
        let answer = last_answer(&which(&library, &[&earlier[..], &["--json"]].concat()));
        assert!(told.contains(&none(&answer)), "{times}: {answer}");
    }
    let said = text(&which(&library, &earlier).stdout);
    assert_fits_a_terminal(&said);
    assert!(unfolded(&said).contains("explains this push alone, but not with the"), "{said}");
    for (wrong, why) in [
        (r#"{"parts": [], "none_of_these": 1.0}"#, "by it the part is none of these"),
        (&of("else.toml", 0.5).to_string(), "it may be else.toml"),
        (r#"{"parts": [], "none_of_these": 7}"#, "holds a probability"),
        ("t,fx,fy", "--earlier takes what which-part --json said"),
    ] {
        std::fs::write(&first, wrong).unwrap();
        let refused = which(&library, &earlier);
        assert_eq!(refused.status.code(), Some(1));
        assert!(unfolded(&text(&refused.stderr)).contains(why), "{why}: {}", text(&refused.stderr));
    }
    // Of two names for one part nobody can tell which it is, however the finger goes on.
    std::fs::copy(example("part.toml"), library.join("twin.toml")).unwrap();
    let (answer, said) = (last_answer(&which(&library, &["--json"])), text(&which(&library, &[]).stdout));
    assert!(answer["next_push"].is_null(), "{answer}");
    assert_fits_a_terminal(&said);
    assert!(unfolded(&said).contains("None of the motions that plan-push knows would tell them apart."), "{said}");
    let nothing = which(&folder.path().join("none"), &[]);
    assert_eq!(nothing.status.code(), Some(1));
    assert!(unfolded(&text(&nothing.stderr)).contains("cannot use the library"), "{}", text(&nothing.stderr));
}

/// The table with every force multiplied.
fn multiplied(table: &str, by: f64) -> String {
    let (heading, rows) = table.split_once('\n').unwrap();
    let row = |row: &str| {
        let cells: Vec<f64> = row.split(',').map(|cell| cell.trim().parse().unwrap()).collect();
        format!("{:.6}, {:.6}, {:.6}\n", cells[0], cells[1] * by, cells[2] * by)
    };
    format!("{heading}\n{}", rows.lines().map(row).collect::<String>())
}

/// What `observe` says of the example part's push where something is told wrong.
fn told_wrong(part: &str, table: &str, arguments: &[&str]) -> String {
    let folder = tempfile::tempdir().unwrap();
    let (part_file, forces) = (folder.path().join("part.toml"), folder.path().join("forces.csv"));
    std::fs::write(&part_file, part).unwrap();
    std::fs::write(&forces, table).unwrap();
    let mut command = palpate(&["observe", "--every", "5", "--motion"]);
    let command = command.arg(example("motion.toml")).arg("--part").arg(&part_file).args(arguments).arg(&forces);
    let output = command.output().unwrap();
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}{}", text(&output.stderr));
    assert_fits_a_terminal(&said);
    unfolded(&said)
}

#[test]
fn forces_with_the_wrong_sign_are_named_as_the_cause() {
    let (part, table) = (std::fs::read_to_string(example("part.toml")).unwrap(), forces(&pushed(), 1.5, 0.003));
    let said = told_wrong(&part, &multiplied(&table, -1.0), &[]);
    assert!(said.contains("No pose of this part explains what was felt."), "{said}");
    assert!(said.contains("away from the reverse of its acceleration") && said.contains("forces reversed"), "{said}");
}

#[test]
fn a_part_in_the_wrong_unit_is_named_as_the_cause() {
    let (part, table) = (std::fs::read_to_string(example("part.toml")).unwrap(), forces(&pushed(), 1.5, 0.003));
    let said = told_wrong(&part.replace("\"mm\"", "\"in\""), &table, &[]);
    assert!(said.contains("the part's lengths 25.4 times shorter a pose fits"), "{said}");
}

#[test]
fn forces_in_grams_are_doubted_by_the_mass_they_make() {
    let (part, table) = (std::fs::read_to_string(example("part.toml")).unwrap(), forces(&pushed(), 1.5, 0.003));
    let said = told_wrong(&part, &multiplied(&table, 101.97), &[]);
    assert!(said.contains("of steel: are the forces in newtons?"), "{said}");
}

/// The example part with its friction guessed wrong by a fifth.
fn part_guessed_wrong(folder: &Path) -> PathBuf {
    let told = std::fs::read_to_string(example("part.toml")).unwrap();
    let wrong = told.replace("mu = 0.25", "mu = 0.3");
    assert_ne!(told, wrong);
    let path = folder.join("guessed.toml");
    std::fs::write(&path, wrong).unwrap();
    path
}

#[test]
fn a_friction_guessed_wrong_is_found_unless_it_is_said_to_be_exact() {
    let (folder, played) = (tempfile::tempdir().unwrap(), pushed());
    let (part, table) = (part_guessed_wrong(folder.path()), folder.path().join("forces.csv"));
    std::fs::write(&table, forces(&played, 1.5, 0.003)).unwrap();
    let observe = |arguments: &[&str]| {
        let mut command = palpate(&["observe"]);
        // Only the first and the last estimate: each looks over the whole part.
        command.args(["--every", "5"]).args(arguments).arg("--motion").arg(example("motion.toml"));
        command.arg("--part").arg(&part).arg(&table).output().unwrap()
    };
    let answer = last_answer(&observe(&["--json"]));
    check(&answer, &played);
    assert_eq!(answer, last_answer(&observe(&["--json", "--mu-uncertainty", "20%"])));
    let best = &answer["hypotheses"][0];
    let number = |name: &str| best[name].as_f64().unwrap();
    let off = [(number("mu") / 0.25).ln() / number("mu_log_sd"), (number("mass") / 0.5).ln() / number("mass_log_sd")];
    assert!(off.iter().all(|off| off.abs() < 4.0), "{off:?} standard deviations off: {answer}");
    // A guess taken for certain is a wrong mass, or no answer at all.
    let certain = last_answer(&observe(&["--json", "--mu-uncertainty", "exact"]));
    let mass = certain["hypotheses"][0]["mass"].as_f64();
    assert!(mass.is_none_or(|mass| (mass / 0.5 - 1.0).abs() > 0.1), "{certain}");
    let said = text(&observe(&["--mu-uncertainty", "x2"]).stdout);
    assert!(
        unfolded(&said).contains("µ: friction of the plane") && unfolded(&said).contains("The plane's friction mu is"),
        "{said}"
    );
}

#[test]
fn an_uncertainty_that_is_none_is_refused_by_its_words() {
    for (given, wanted) in [("20", "neither"), ("0%", "0.1%"), ("x100", "10"), ("much", "neither"), ("-5%", "0.1%")] {
        let argument = format!("--mu-uncertainty={given}");
        let output =
            palpate(&["observe", "f.csv", "--part", "p.toml", "--motion", "m.toml", &argument]).output().unwrap();
        let said = text(&output.stderr);
        assert!(output.status.code() == Some(64) && said.contains(wanted), "{given}: {said}");
    }
}

#[test]
fn what_the_part_stands_on_is_named_and_its_pose_whatever_it_is() {
    let folder = tempfile::tempdir().unwrap();
    let supports = "[[support]]\nname = 'its base'\n[[support]]\nname = 'three feet'\nfeet = [[10, 5, 1], [85, 5, 1], [55, 65, 1]]\n";
    let told = std::fs::read_to_string(example("part.toml")).unwrap() + "\n" + supports;
    let (part, table) = (folder.path().join("supports.toml"), folder.path().join("forces.csv"));
    let played = pushed();
    std::fs::write(&part, &told).unwrap();
    std::fs::write(&table, forces(&played, 1.5, 0.003)).unwrap();
    let which = |arguments: &[&str]| {
        let mut command = palpate(&["which-part", "--part"]);
        command.arg(&part).arg("--motion").arg(example("motion.toml")).args(arguments).arg(&table).output().unwrap()
    };
    let answer = last_answer(&which(&["--json"]));
    assert_eq!(answer["parts"][0]["support"], "its base", "{answer}");
    assert!(answer["parts"][0]["probability"].as_f64().unwrap() > 0.9, "{answer}");
    check(&answer["whichever"], &played);
    let said = text(&which(&[]).stdout);
    assert!(said.contains("supports.toml on its base") && said.contains("on three feet"), "{said}");
    // Who needs one support says so.
    let output =
        palpate(&["observe", "--motion"]).arg(example("motion.toml")).arg("--part").arg(&part).arg(&table).output();
    let refused = text(&output.unwrap().stderr);
    assert!(refused.contains("lists 2 supports") && refused.contains("which-part"), "{refused}");
}
