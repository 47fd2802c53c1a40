//! `palpate push` as a user runs it: exit status, what is printed where, the picture, and a message for each mistake.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use tempfile::TempDir;

use crate::PALPATE;

const BLOCK: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\nmu = 0.3\nmu_c = 0.25\n";

fn palpate(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(PALPATE).args(arguments).current_dir(folder).output().unwrap()
}

/// A folder with the block, and what `palpate push block.toml` says there.
fn push(arguments: &[&str]) -> (TempDir, Output) {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("block.toml"), BLOCK).unwrap();
    let output = palpate(folder.path(), &[&["push", "block.toml"], arguments].concat());
    (folder, output)
}

fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// The complaint without the frame that is drawn round it and its line breaks.
fn complaint(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).replace(['│', '\n'], " ");
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn a_push_through_the_middle_is_a_straight_line_in_the_table() {
    let (_folder, output) = push(&["--edge", "0", "--acceleration-mm-s2", "100", "--time-s", "0.5", "--rows", "2"]);
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    let table = printed(&output);
    // After half a second at 0.1 m/s² the centre (30, 20) mm is 12.5 mm further; the finger bears friction 0.3 and
    // 0.1/g.
    let last: Vec<&str> = table.lines().nth(4).unwrap().split_whitespace().collect();
    assert_eq!(last[..4], ["0.5000", "30.00", "32.50", "0.00"], "{table}");
    assert_eq!((last[7], last[9]), ("0.3102", "rolls"), "{table}");
    assert!(table.ends_with("ended after 0.5000 s: the time was up\n"), "{table}");
}

#[test]
fn json_is_what_solve_answers_to_the_same_problem() {
    let arguments = ["--edge", "0", "--s-mm", "10", "--acceleration-mm-s2", "100", "--rows", "3", "--time-s", "0.6"];
    let (folder, output) = push(&[&arguments[..], &["--json"]].concat());
    let pushed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let problem = r#"{"problem": "push", "polygon": [[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]], "edge": 0, "mu": 0.3,
        "mode": "coulomb", "mu_c": 0.25,
        "finger": {"radius": 0.015, "centre0": [0.04, -0.015], "velocity0": [0, 0], "acceleration": [0, 0.1]},
        "initial": {"u": 1.5707963267948966, "s": 0.01, "at_rest": true}, "times": [0, 0.2, 0.4, 0.6]}"#;
    fs::write(folder.path().join("problem.jsonl"), problem.replace('\n', " ")).unwrap();
    let solved = palpate(folder.path(), &["solve", "problem.jsonl"]);
    let solved: serde_json::Value = serde_json::from_slice(&solved.stdout).unwrap();
    let (got, wanted) = (numbers(&pushed["samples"]), numbers(&solved["samples"]));
    assert_eq!((got.len(), got.is_empty()), (wanted.len(), false), "{solved}");
    // The two starts differ by rounding of the contact angle and the finger's place.
    let worst = got.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-6, "{worst:e}: {pushed} {solved}");
}

/// All numbers in a JSON value, in order.
fn numbers(value: &serde_json::Value) -> Vec<f64> {
    match value {
        serde_json::Value::Number(number) => vec![number.as_f64().unwrap()],
        serde_json::Value::Array(values) => values.iter().flat_map(numbers).collect(),
        serde_json::Value::Object(fields) => fields.values().flat_map(numbers).collect(),
        _ => Vec::new(),
    }
}

#[test]
fn pictures_are_drawn_in_both_formats() {
    for name in ["push.svg", "push.png"] {
        let (folder, output) = push(&["--edge", "1", "--speed-mm-s", "40", "--s-mm", "8", "--plot", name]);
        assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
        let bytes = fs::read(folder.path().join(name)).unwrap();
        let start: &[u8] = if name.ends_with("svg") { b"<svg" } else { b"\x89PNG" };
        assert!(bytes.starts_with(start) && bytes.len() > 10_000, "{name}: {} bytes", bytes.len());
        assert!(complaint(&output).contains(name), "{}", complaint(&output));
    }
}

#[test]
fn the_same_push_draws_the_same_bytes() {
    let draw = || {
        let (folder, _) = push(&["--edge", "0", "--s-mm", "12", "--speed-mm-s", "50", "--plot", "a.svg"]);
        fs::read(folder.path().join("a.svg")).unwrap()
    };
    assert_eq!(draw(), draw());
}

#[test]
fn every_mistake_has_its_own_message() {
    let mistakes: [(&[&str], i32, &str); 10] = [
        (&["--edge", "0", "--s-mm", "31", "--speed-mm-s", "50"], 1, "beyond the edge"),
        (&["--edge", "0", "--speed-mm-s", "50", "--direction-deg", "120"], 1, "the finger moves 120.0° from straight"),
        (&["--edge", "0", "--acceleration-mm-s2", "-5"], 1, "the finger accelerates 180.0° from straight"),
        (&["--edge", "0"], 1, "nothing would move"),
        (&["--edge", "7", "--speed-mm-s", "50"], 1, "7 is no edge of a polygon with 4"),
        (&["--edge", "0", "--mu-c", "-0.2"], 64, "must be finite and not negative"),
        (&["--edge", "0", "--radius-mm", "0"], 64, "it must be above 0"),
        (&["--edge", "0", "--time-s", "nan"], 64, "it must be finite"),
        (&["--edge", "0", "--speed-mm-s", "50", "--plot", "a.pdf"], 64, ".svg or .png"),
        (
            &["--edge", "0", "--speed-mm-s", "50", "--plot", "no/such/folder.png"],
            1,
            "cannot draw to no/such/folder.png",
        ),
    ];
    for (arguments, status, wanted) in mistakes {
        let (_folder, output) = push(arguments);
        let complaint = complaint(&output);
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {complaint}");
        assert!(complaint.contains(wanted), "{arguments:?}: wanted {wanted}, got {complaint}");
    }
}

#[test]
fn mistakes_in_the_part_file_are_named_with_file_and_key() {
    let mistakes = [
        (BLOCK.replace("mu = 0.3", "mu = -0.3"), "mu = -0.3, but friction coefficients are finite and not negative"),
        (BLOCK.replace("[60, 40], [0, 40]", "[0, 40], [60, 40]"), "vertices: edge"),
        (BLOCK.replace("unit", "units"), "units"),
    ];
    for (text, wanted) in mistakes {
        let folder = TempDir::new().unwrap();
        fs::write(folder.path().join("bad.toml"), text).unwrap();
        let output = palpate(folder.path(), &["push", "bad.toml", "--edge", "0", "--speed-mm-s", "50"]);
        assert_eq!(output.status.code(), Some(1));
        let complaint = complaint(&output);
        assert!(complaint.contains("bad.toml") && complaint.contains(wanted), "wanted {wanted}, got {complaint}");
    }
}

#[test]
fn a_finger_that_overlaps_the_part_is_refused() {
    let folder = TempDir::new().unwrap();
    let notch = "unit = 'cm'\nvertices = [[0, 0], [2, 0], [2, 3], [4, 3], [4, 0], [6, 0], [6, 5], [0, 5]]\nmu = 0.3";
    fs::write(folder.path().join("notch.toml"), notch).unwrap();
    let output = palpate(folder.path(), &["push", "notch.toml", "--edge", "2", "--speed-mm-s", "50"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(complaint(&output).contains("the finger overlaps the part"), "{}", complaint(&output));
}

#[test]
fn the_example_part_can_be_pushed_at_every_edge() {
    let part = palpate_tests::project::folder().join("examples/part.toml");
    for edge in ["0", "1", "2", "3", "4"] {
        let output = palpate(Path::new("."), &["push", part.to_str().unwrap(), "--edge", edge, "--speed-mm-s", "50"]);
        assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
        assert!(printed(&output).contains("ended after"), "{}", printed(&output));
    }
}

/// A push that is slow enough not to swing: 20 mm straight on, and around.
#[test]
fn a_slow_push_through_the_middle_is_a_straight_line_in_the_table() {
    let (_folder, output) = push(&["--quasi-static", "--edge", "0", "--rows", "2", "--distance-mm", "30"]);
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    let table = printed(&output);
    let last: Vec<&str> = table.lines().nth(4).unwrap().split_whitespace().collect();
    // The finger bears the friction of the plane, and no more.
    assert_eq!(
        last,
        ["30.000", "30.00", "50.00", "0.00", "edge", "0", "0.000", "0.3000", "0.0000", "sticks"],
        "{table}"
    );
    assert!(table.ends_with("ended after 30.000 mm: the way was over\n"), "{table}");
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");
}

#[test]
fn json_of_a_slow_push_is_what_solve_answers_to_the_same_problem() {
    let arguments = ["--quasi-static", "--edge", "0", "--s-mm", "12", "--direction-deg", "20", "--rows", "3", "--json"];
    let more = ["--radius-mm", "5", "--mu-c-static", "0.3", "--height-mm", "4"];
    let (folder, output) = push(&[&arguments[..], &more].concat());
    let pushed: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let at = |k: f64| {
        let (sin, cos) = 20_f64.to_radians().sin_cos();
        format!("[{:?}, {:?}]", 0.042 - sin * 0.02 * k / 3.0, -0.005 + cos * 0.02 * k / 3.0)
    };
    let problem = format!(
        r#"{{"problem": "push", "mode": "quasi_static", "polygon": [[0, 0], [0.06, 0], [0.06, 0.04], [0, 0.04]], "mu": 0.3,
        "g": 9.80665, "mu_c": 0.25, "mu_c_static": 0.3, "height": 0.004, "initial": {{"pose": [0, 0, 0]}},
        "finger": {{"radius": 0.005, "path": [{}, {}, {}, {}]}}}}"#,
        at(0.0),
        at(1.0),
        at(2.0),
        at(3.0)
    );
    let gravity = palpate::gravity::GRAVITY_ASSUMED;
    let problem = problem.replace("9.80665", &format!("{gravity:?}"));
    fs::write(folder.path().join("problem.jsonl"), problem.replace('\n', " ")).unwrap();
    let solved = palpate(folder.path(), &["solve", "problem.jsonl"]);
    let solved: serde_json::Value = serde_json::from_slice(&solved.stdout).unwrap();
    let (got, wanted) = (numbers(&pushed["samples"]), numbers(&solved["samples"]));
    assert_eq!((got.len(), got.len() > 20), (wanted.len(), true), "{pushed} {solved}");
    let worst = got.iter().zip(&wanted).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    assert!(worst < 1e-9, "{worst:e}: {pushed} {solved}");
}

#[test]
fn a_slow_push_along_a_path_goes_round_a_corner_and_is_drawn() {
    let (folder, _) = push(&["--edge", "0", "--speed-mm-s", "50"]);
    // Past the right lower corner, which it turns away, and on.
    let places = "t,x [mm],y [mm]\n0,55,-20\n1,55,-6\n2,52,10\n3,66,30\n";
    fs::write(folder.path().join("path.csv"), places).unwrap();
    let path = ["push", "block.toml", "--quasi-static", "--path", "path.csv", "--radius-mm", "6"];
    let more = ["--pose", "0,0,0", "--rows", "5", "--plot", "path.svg"];
    let output = palpate(folder.path(), &[&path[..], &more].concat());
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    let table = printed(&output);
    assert!(table.contains("14.000 mm: the contact slides from here on") && table.contains("free"), "{table}");
    let picture = fs::read_to_string(folder.path().join("path.svg")).unwrap();
    for words in ["Pushing block.toml slowly along a path", "turned [°]", "force on the part", "way [mm]"] {
        assert!(picture.contains(&format!("aria-label=\"{words}\"")), "{words}");
    }
    // As few straight pieces as stay within 20 mm of it are one or two.
    let coarse = palpate(folder.path(), &[&path[..], &["--within-mm", "20", "--rows", "5"]].concat());
    assert_ne!(printed(&coarse), table);
}

#[test]
fn mistakes_about_slow_pushes_have_their_messages() {
    let mistakes: [(&[&str], i32, &str); 7] = [
        (&["--quasi-static"], 1, "where to push at block.toml is not said"),
        (&["--quasi-static", "--edge", "0", "--speed-mm-s", "5"], 64, "--speed-mm-s"),
        (&["--edge", "0", "--distance-mm", "5"], 64, "--quasi-static"),
        (&["--quasi-static", "--edge", "0", "--direction-deg", "120"], 1, "away from it"),
        (&["--quasi-static", "--edge", "0", "--mu-c-static", "0.1"], 1, "less than the friction of sliding, 0.25"),
        (&["--quasi-static", "--edge", "0", "--finger", "ellipse"], 1, "slow pushes are by a disk"),
        (&["--quasi-static", "--path", "none.csv", "--pose", "1,2"], 64, "a pose has three: X,Y,DEG"),
    ];
    for (arguments, status, wanted) in mistakes {
        let (_folder, output) = push(arguments);
        let complaint = complaint(&output);
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {complaint}");
        assert!(complaint.contains(wanted), "{arguments:?}: wanted {wanted}, got {complaint}");
    }
}
