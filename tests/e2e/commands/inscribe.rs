//! `palpate inscribe` as a user runs it: exit status, what is printed, the picture, and a message for each mistake.

use std::fs;
use std::process::{Command, Output};

use tempfile::TempDir;

use crate::PALPATE;

const BLOCK: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [10, 50]]\nmu = 0.3\n";
const WEDGE: &str = "unit = 'mm'\nvertices = [[0, 0], [150, 0], [0, 20]]\nmu = 0.3\n";
/// The block at (20, 10) mm, turned by 40.1°, seen by two sensors to 0.03°.
const VIEWS: &str = "unit = 'mm'\nsigma = 0.03\n[[cone]]\napex = [-200, 50]\nright = -10.28\nleft = 6.93\n\
                     [[cone]]\napex = [50, -250]\nright = 86.92\nleft = 100.16\n";

/// The floor and a stop on the left.
const FENCES: &str = "unit = 'mm'\n[[fence]]\nnormal = -90\noffset = 0\n[[fence]]\nnormal = 180\noffset = 0\n";
const EGG: &str = "unit = 'mm'\nellipse = {a = 40, b = 30}\nmu = 0.3\n";
const ROUNDED: &str = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [10, 50]]\nrounding = 5\n";

fn inscribe(views: &str, arguments: &[&str]) -> (TempDir, Output) {
    let folder = TempDir::new().unwrap();
    let parts = [("block.toml", BLOCK), ("wedge.toml", WEDGE), ("egg.toml", EGG), ("rounded.toml", ROUNDED)];
    for (name, text) in parts.into_iter().chain([("views.toml", views)]) {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let mut command = Command::new(PALPATE);
    let output = command
        .args([&["inscribe", "--views", "views.toml"], arguments].concat())
        .current_dir(folder.path())
        .output()
        .unwrap();
    (folder, output)
}

fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Prose as it was before it was broken into lines.
fn unfolded(text: &str) -> String {
    text.replace('\n', " ")
}

fn complaint(output: &Output) -> String {
    let text = String::from_utf8_lossy(&output.stderr).replace(['│', '\n'], " ");
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[test]
fn two_views_with_errors_leave_two_poses_and_a_third_view_is_advised() {
    let (_folder, output) = inscribe(VIEWS, &["block.toml"]);
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    let text = printed(&output);
    assert!(text.starts_with("block: 2 poses"), "{text}");
    assert!(text.contains("χ² of 1 degree of freedom"), "{text}");
    assert!(unfolded(&text).contains("would tell the poses apart"), "{text}");
}

/// Both poses are known again by what the one point reads, from what was printed for programs.
#[test]
fn points_that_tell_the_poses_apart_are_planned_and_decoded() {
    let (_folder, output) = inscribe(VIEWS, &["block.toml", "--resolve"]);
    let text = printed(&output);
    assert!(text.contains("1 point (proven fewest)"), "{text}");
    let (folder, output) = inscribe(VIEWS, &["block.toml", "--resolve", "--json"]);
    fs::write(folder.path().join("plan.json"), &output.stdout).unwrap();
    let decoded = ["0", "1"].map(|reading| {
        let mut command = Command::new(PALPATE);
        let command = command.args(["sample", "--decode", "plan.json", reading]).current_dir(folder.path());
        printed(&command.output().unwrap())
    });
    let mut named = decoded.map(|text| text.trim().to_owned());
    named.sort();
    assert_eq!(named, ["block, pose 1", "block, pose 2"]);
}

/// The block once more from elsewhere, to two digits.
const THIRD: &str = "[[cone]]\napex = [250, 150]\nright = -161.37\nleft = -148.67\n";

#[test]
fn where_no_pose_fits_the_reason_is_named() {
    let radians = |degrees: &str| format!("{:.5}", degrees.parse::<f64>().unwrap().to_radians());
    let in_radians = ["-10.28", "6.93", "86.92", "100.16"]
        .iter()
        .fold(VIEWS.replace("sigma = 0.03", "sigma = 0.0005"), |text, angle| text.replace(angle, &radians(angle)));
    let exact = VIEWS.replace("sigma = 0.03\n", "");
    let misread = format!("{VIEWS}{}", THIRD.replace("-148.67", "-138.67"));
    let metres = VIEWS.replace("'mm'", "'in'");
    for (views, wanted) in [
        (in_radians, "With its angles in radians a pose fits"),
        (exact + THIRD, "with errors of 0.1° (`sigma = 0.1`) one does"),
        (metres, "With the lengths of the views 0.03937"),
        (misread, "Without cone 2 a pose fits"),
    ] {
        let (_folder, output) = inscribe(&views, &["block.toml"]);
        let said = unfolded(&printed(&output));
        assert!(output.status.code() == Some(2) && said.contains(wanted), "wanted `{wanted}` in: {said}");
    }
}

/// A touch outside of the gate is told with its place, how far it is off, and what would be let pass.
#[test]
fn a_touch_outside_of_the_gate_is_named_with_how_far_it_is_off() {
    // On edge 0 twice, on the left and the right side; the last is 3 mm beside the right side.
    let points = "[[20, 0], [50, 0], [3, 15], [60, 20], [63, 30]]";
    let points = points.trim_matches(['[', ']']).split("], [");
    let points: String = points.map(|point| format!("[[point]]\nat = [{point}]\nsigma = 0.05\n")).collect();
    let views = format!("unit = 'mm'\n{points}[[free]]\ncentre = [30, -20]\nradius = 15\n");
    let (_folder, output) = inscribe(&views, &["block.toml"]);
    let said = unfolded(&printed(&output));
    assert_eq!(output.status.code(), Some(2), "{said}");
    let about = said.split_once("Without point 4 a pose fits, from which it is ").map(|(_, rest)| rest);
    let off: f64 =
        about.and_then(|rest| rest.split_once(" mm off")).unwrap_or_else(|| panic!("{said}")).0.parse().unwrap();
    assert!((off - 3.0).abs() < 0.2, "{said}");
    for words in ["of its standard deviations", "all together may have", "Read it anew, or leave it out"] {
        assert!(said.contains(words), "{words}: {said}");
    }
}

#[test]
fn the_part_is_named_among_several() {
    let (_folder, output) = inscribe(VIEWS, &["wedge.toml", "block.toml"]);
    let text = printed(&output);
    assert!(text.contains("wedge: no pose fits") && text.contains("block: 2 poses"), "{text}");
    let (_folder, output) = inscribe(VIEWS, &["wedge.toml"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn json_holds_the_same_modes_in_metres() {
    let (_folder, output) = inscribe(VIEWS, &["block.toml", "--json"]);
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let modes = value["parts"][0]["modes"].as_array().unwrap();
    let is_truth = |mode: &serde_json::Value| {
        let at = |k: usize| mode["pose"][k].as_f64().unwrap();
        (at(0) - 0.02).abs() < 1e-3 && (at(1) - 0.01).abs() < 1e-3 && (at(2) - 0.7).abs() < 0.03
    };
    assert!(modes.iter().any(is_truth), "{value}");
    assert_eq!(value["next_view"]["tells_apart"], true, "{value}");
}

#[test]
fn one_view_is_no_mistake_but_determines_nothing() {
    let one = VIEWS.split("[[cone]]").take(2).collect::<Vec<_>>().join("[[cone]]");
    let (_folder, output) = inscribe(&one, &["block.toml"]);
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    assert!(unfolded(&printed(&output)).contains("take another view from elsewhere"), "{}", printed(&output));
}

#[test]
fn pictures_are_drawn_and_mistakes_are_named() {
    let (folder, output) = inscribe(VIEWS, &["block.toml", "--plot", "poses.svg"]);
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    assert!(fs::read_to_string(folder.path().join("poses.svg")).unwrap().contains("look from here next"));
    let (_folder, output) = inscribe(&VIEWS.replace("6.93", "-20"), &["block.toml"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(complaint(&output).contains("cone 0: the cone opens by"), "{}", complaint(&output));
    let (_folder, output) = inscribe(VIEWS, &["absent.toml"]);
    assert!(complaint(&output).contains("cannot use absent.toml"), "{}", complaint(&output));
}

#[test]
fn a_probed_contact_takes_the_place_of_a_third_line() {
    let (_folder, output) = inscribe(&format!("{FENCES}[[point]]\nat = [60, 15]\n"), &["block.toml", "--json"]);
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    let value: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    // The outline's vertex 3 is 10 mm off the stop when edge 0 is on the floor, so the part is 10 mm nearer or turned.
    let poses = value["parts"][0]["poses"].as_array().unwrap();
    assert!(!poses.is_empty(), "{value}");
    for pose in poses {
        let [x, y, theta] = [0, 1, 2].map(|k| pose[k].as_f64().unwrap());
        let moved = |[a, b]: [f64; 2]| [x + theta.cos() * a - theta.sin() * b, y + theta.sin() * a + theta.cos() * b];
        let corners = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.01, 0.05]].map(moved);
        let least = |axis: usize| corners.iter().map(|corner| corner[axis]).fold(f64::INFINITY, f64::min);
        assert!(least(0).abs() < 1e-9 && least(1).abs() < 1e-9, "{pose}");
        let sides = (0..4).map(|k| {
            let ([ax, ay], [bx, by]) = (corners[k], corners[(k + 1) % 4]);
            ((bx - ax) * (0.015 - ay) - (by - ay) * (0.06 - ax)) / (bx - ax).hypot(by - ay)
        });
        assert!(sides.fold(f64::INFINITY, f64::min).abs() < 1e-9, "{pose}");
    }
    let (_folder, output) = inscribe(FENCES, &["block.toml"]);
    assert!(printed(&output).contains("2 distinct lines"), "{}", printed(&output));
}

#[test]
fn smooth_parts_are_found_and_drawn() {
    let jaws = format!("{FENCES}[[fence]]\nnormal = 0\noffset = 70\n");
    let (folder, output) = inscribe(&jaws, &["egg.toml", "rounded.toml", "--plot", "poses.svg"]);
    assert_eq!(output.status.code(), Some(0), "{}", complaint(&output));
    let text = printed(&output);
    assert!(text.contains("egg: 4 poses, 2 that look different") && text.contains("rounded:"), "{text}");
    assert!(fs::metadata(folder.path().join("poses.svg")).unwrap().len() > 1000);
    let (_folder, output) = inscribe(VIEWS, &["egg.toml"]);
    assert_eq!(output.status.code(), Some(1));
    assert!(complaint(&output).contains("sigma cannot be used with a smooth part"), "{}", complaint(&output));
}

#[test]
fn poses_are_numbered_through_all_parts_and_parts_of_one_name_by_their_paths() {
    let (folder, _) = inscribe(VIEWS, &["block.toml"]);
    fs::create_dir(folder.path().join("other")).unwrap();
    fs::write(folder.path().join("other/block.toml"), BLOCK).unwrap();
    let arguments = "inscribe --views views.toml block.toml other/block.toml --resolve --plot poses.svg";
    let output = Command::new(PALPATE).args(arguments.split(' ')).current_dir(folder.path()).output().unwrap();
    let text = printed(&output);
    for words in
        ["block.toml: 2 poses", "other/block.toml: 2 poses", "\n     3 ", "\n     4 ", "other/block.toml, pose 4"]
    {
        assert!(text.contains(words), "{words}: {text}");
    }
    // Copies of a pose are not told apart by how they were rounded.
    assert!(text.contains("cannot be told apart: block.toml, pose 1 and other/block.toml, pose 3"), "{text}");
    let picture = fs::read_to_string(folder.path().join("poses.svg")).unwrap();
    assert!(picture.contains("aria-label=\"point that tells poses apart\""));
}

#[test]
fn options_that_would_change_nothing_are_refused() {
    for (words, missing) in [
        ("inscribe --views views.toml block.toml --greedy", "--resolve"),
        ("corner block.toml --correct 1", "--sample"),
        ("corner block.toml --min-clearance-mm 2", "--sample"),
        ("sample --sets views.toml --min-area-mm2 2", "--sets"),
        ("sample block.toml --tree --json", "--json"),
        ("sample --decode plan.json 01 --greedy", "--decode"),
    ] {
        let (folder, _) = inscribe(VIEWS, &["block.toml"]);
        let output = Command::new(PALPATE).args(words.split(' ')).current_dir(folder.path()).output().unwrap();
        assert_eq!(output.status.code(), Some(64), "{words}");
        assert!(complaint(&output).contains(missing), "{words}: {}", complaint(&output));
    }
}

#[test]
fn sets_are_answered_for_programs_too_and_a_corner_needs_no_friction() {
    let (folder, _) = inscribe(VIEWS, &["block.toml"]);
    fs::write(folder.path().join("sets.txt"), "a: x y\nb: y\nc:\n").unwrap();
    let run = |words: &str| {
        let words = words.split(' ');
        Command::new(PALPATE).args(words).current_dir(folder.path()).output().unwrap()
    };
    let sets = printed(&run("sample --sets sets.txt --json"));
    assert!(sets.contains(r#""elements":["x","y"]"#) && sets.contains(r#""signatures":[[1,1],[0,1],[0,0]]"#), "{sets}");
    fs::write(folder.path().join("bare.toml"), BLOCK.replace("mu = 0.3\n", "")).unwrap();
    assert_eq!(run("corner bare.toml").status.code(), Some(0));
    let smooth = run("corner egg.toml");
    assert!(smooth.status.code() == Some(1) && complaint(&smooth).contains("smooth part"), "{}", complaint(&smooth));
    let bad = complaint(&run("sample sets.txt"));
    assert_eq!(bad.matches("TOML parse error").count(), 1, "{bad}");
}
