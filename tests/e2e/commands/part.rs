//! Outlines from CAD files as a user has them: `palpate part`, and the commands that take a part file which names one.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use serde_json::Value;
use tempfile::TempDir;

use crate::PALPATE;
use crate::observe::{check, example, forces, last_answer, pushed};

fn palpate(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(PALPATE);
    command.args(arguments).current_dir(folder).stdin(Stdio::null());
    command.env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION").output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).replace('│', " ").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// The lines of a drawing in mm, one by one.
fn dxf(outline: &[[f64; 2]]) -> String {
    let mut drawing = "0\nSECTION\n2\nHEADER\n9\n$INSUNITS\n70\n4\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n".to_owned();
    for (i, [x, y]) in outline.iter().enumerate() {
        let [to_x, to_y] = outline[(i + 1) % outline.len()];
        write!(drawing, "0\nLINE\n8\ncut\n10\n{x}\n20\n{y}\n11\n{to_x}\n21\n{to_y}\n").unwrap();
    }
    drawing + "0\nENDSEC\n0\nEOF\n"
}

/// That of `examples/part.toml`, from another corner on.
const PART: [[f64; 2]; 5] = [[0.0, 0.0], [90.0, 0.0], [100.0, 40.0], [55.0, 75.0], [10.0, 45.0]];

/// A folder with a part file that names a drawing in a folder of its own.
fn folder(outline: &[[f64; 2]], keys: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    fs::create_dir(folder.path().join("cad")).unwrap();
    fs::write(folder.path().join("cad/part.dxf"), dxf(outline)).unwrap();
    let part = format!("unit = 'mm'\noutline = 'cad/part.dxf'\n{keys}");
    fs::write(folder.path().join("part.toml"), part).unwrap();
    folder
}

#[test]
fn a_push_of_a_drawn_part_is_that_of_its_vertices() {
    let folder = folder(&PART, "mu = 0.25\nmu_c = 0.3\n");
    let push = ["--edge", "0", "--speed-mm-s", "50", "--json"];
    // From elsewhere, so that the drawing is looked for beside the part file.
    let elsewhere = TempDir::new().unwrap();
    let part = folder.path().join("part.toml");
    let [drawn, listed] = [&part, &example("part.toml")].map(|part| {
        let output = palpate(elsewhere.path(), &[&["push", part.to_str().unwrap()], &push[..]].concat());
        assert!(output.status.success(), "{}", text(&output.stderr));
        serde_json::from_slice::<Value>(&output.stdout).unwrap()
    });
    assert_eq!(drawn["end"]["reason"], listed["end"]["reason"]);
    let at = |answer: &Value| answer["samples"].as_array().unwrap().last().unwrap()["t"].as_f64().unwrap();
    assert!((at(&drawn) - at(&listed)).abs() < 1e-9, "{drawn}\n{listed}");
    let told = palpate(folder.path(), &["push", "part.toml", "--edge", "0", "--speed-mm-s", "50"]);
    assert!(text(&told.stderr).contains("100.0 × 75.0 mm"), "{}", text(&told.stderr));
}

#[test]
fn a_drawn_part_is_observed() {
    let (folder, played) = (folder(&PART, "mu = 0.25\nmu_c = 0.3\n"), pushed());
    fs::write(folder.path().join("forces.csv"), forces(&played, 1.0, 1e-3)).unwrap();
    let motion = example("motion.toml");
    let words = ["observe", "forces.csv", "--part", "part.toml", "--motion", motion.to_str().unwrap(), "--json"];
    check(&last_answer(&palpate(folder.path(), &words)), &played);
}

#[test]
fn a_drawn_part_is_touched() {
    let outline = [[0.0, 0.0], [60.0, 0.0], [60.0, 25.0], [35.0, 45.0], [0.0, 30.0]];
    let folder = folder(&outline, "mu = 0.3\nmu_c = 0.25\n");
    let words = ["touch", "--part", "part.toml", "-d", "sim:3", "--robot", "sim:", "--simulated-pose", "90,70,40"];
    let more = ["--mass-kg", "1", "--json", "--area-mm", "0,0,160,160"];
    let output = palpate(folder.path(), &[&words[..], &more].concat());
    assert!(output.status.success(), "{}", text(&output.stderr));
    let end: Value = serde_json::from_str(String::from_utf8_lossy(&output.stdout).lines().last().unwrap()).unwrap();
    assert_eq!(end["verdict"], "one", "{end}");
    let [x, y] = ["x", "y"].map(|key| end["poses"][0][key].as_f64().unwrap());
    assert!((x - 0.09).hypot(y - 0.07) < 4e-4, "{end}");
}

#[test]
fn a_part_is_shown_with_what_can_be_confused() {
    let block = [[0.0, 0.0], [60.0, 0.0], [60.0, 59.5], [0.0, 59.5]];
    let folder = folder(&block, "mu = 0.3\n");
    let shown = palpate(folder.path(), &["part", "part.toml", "--plot", "part.svg"]);
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    // However its sentences are broken.
    let table = text(&shown.stdout);
    for wanted in [
        "size 60.000 × 59.500 mm",
        "area 35.7000 cm²",
        "perimeter 239.000 mm",
        "centroid (30.000, 29.750) mm",
        "4 corners; convex",
        "stands on all of its base",
        "turned by 180.00°: outlines 0.000 mm apart at most; touches within 0.2 mm confuse them",
        "begin alike at the sides 0 and 2, 1 and 3",
    ] {
        assert!(table.contains(wanted), "{wanted}: {table}");
    }
    let picture = fs::read_to_string(folder.path().join("part.svg")).unwrap();
    assert!(picture.contains("centre of mass") && picture.contains("turned by"), "{picture}");
    for line in String::from_utf8_lossy(&shown.stdout).lines() {
        assert!(line.chars().count() <= 80, "{line}");
    }
    let json = palpate(folder.path(), &["part", "cad/part.dxf", "--json"]);
    let json: Value = serde_json::from_slice(&json.stdout).unwrap();
    assert!((json["area"].as_f64().unwrap() - 3.57e-3).abs() < 1e-12, "{json}");
    assert_eq!(json["push_symmetry"], 2, "{json}");
}

/// A block of 60 × 40 × 20 mm as facets.
fn block_stl() -> String {
    let corner = |k: usize| {
        let [x, y] = [[0, 0], [60, 0], [60, 40], [0, 40]][k % 4];
        format!("vertex {x} {y} {}\n", if k < 4 { 0 } else { 20 })
    };
    let facets = [[0, 2, 1], [0, 3, 2], [4, 5, 6], [4, 6, 7]];
    let sides = (0..4).flat_map(|i| [[i, (i + 1) % 4, 4 + (i + 1) % 4], [i, 4 + (i + 1) % 4, 4 + i]]);
    let facets = facets.into_iter().chain(sides).fold("solid block\n".to_owned(), |mut text, facet| {
        text += "facet normal 0 0 0\nouter loop\n";
        facet.iter().for_each(|k| text += &corner(*k));
        text + "endloop\nendfacet\n"
    });
    facets + "endsolid block\n"
}

#[test]
fn a_solid_tells_its_mass_and_mistakes_are_told_with_what_to_do() {
    let folder = folder(&PART, "mu = 0.3\n");
    fs::write(folder.path().join("block.stl"), block_stl()).unwrap();
    let shown =
        palpate(folder.path(), &["part", "block.stl", "--unit", "mm", "--shadow", "--density-g-cm3", "7.85", "--json"]);
    assert!(shown.status.success(), "{}", text(&shown.stderr));
    let shown: Value = serde_json::from_slice(&shown.stdout).unwrap();
    let number = |key: &str| shown[key].as_f64().unwrap();
    assert!((number("mass") - 0.3768).abs() < 1e-9, "{shown}");
    // (60² + 40²) / 12 mm² times the mass.
    assert!((number("inertia") - 0.3768 * 5.2e-3 / 12.0).abs() < 1e-12, "{shown}");
    let complaint = |words: &[&str]| {
        let output = palpate(folder.path(), words);
        assert_eq!(output.status.code(), Some(1));
        text(&output.stderr)
    };
    let told = complaint(&["part", "block.stl"]);
    assert!(told.contains("STL never does") && told.contains("--unit mm"), "{told}");
    let told = complaint(&["part", "block.stl", "--unit", "mm"]);
    assert!(told.contains("20.000 high") && told.contains("--height-mm") && told.contains("--shadow"), "{told}");
    fs::write(folder.path().join("cad/part.dxf"), dxf(&PART).replacen("LINE", "MTEXT", 1)).unwrap();
    let told = complaint(&["push", "part.toml", "--edge", "0"]);
    assert!(told.contains("outline: MTEXT on layer \"cut\" at line 16"), "{told}");
    fs::remove_file(folder.path().join("cad/part.dxf")).unwrap();
    assert!(complaint(&["push", "part.toml", "--edge", "0"]).contains("outline: cad/part.dxf:"));
}

#[test]
fn options_that_say_nothing_of_a_file_are_refused_by_name() {
    let folder = folder(&PART, "mu = 0.3\n");
    fs::write(folder.path().join("block.stl"), block_stl()).unwrap();
    for (words, options) in [
        (&["cad/part.dxf", "--density-g-cm3", "2"][..], "--density-g-cm3 says nothing"),
        (&["cad/part.dxf", "--shadow", "--up", "z"], "--shadow, --up says nothing"),
        (&["block.stl", "--unit", "mm", "--shadow", "--layer", "cut"], "--layer says nothing"),
        (&["part.toml", "--density-g-cm3", "9"], "--density-g-cm3 says nothing"),
        (
            &["part.toml", "--unit", "in", "--fill-holes", "--height-mm", "3", "--curve-error-mm", "3"],
            "--unit, --curve-error-mm, --fill-holes, --height-mm says nothing",
        ),
    ] {
        let output = palpate(folder.path(), &[&["part"], words].concat());
        assert_eq!(output.status.code(), Some(1), "{words:?}");
        assert!(text(&output.stderr).contains(options), "{words:?}: {}", text(&output.stderr));
    }
    // Of a part file that names a solid the density is used.
    let solid = "unit = 'mm'\nmu = 0.3\noutline = {file = 'block.stl', unit = 'mm', shadow = true}";
    fs::write(folder.path().join("solid.toml"), solid).unwrap();
    let shown = palpate(folder.path(), &["part", "solid.toml", "--density-g-cm3", "7.85"]);
    assert!(text(&shown.stdout).contains("mass 0.37680 kg"), "{}", text(&shown.stderr));
}

#[test]
fn a_file_from_cad_in_place_of_one_that_names_it_is_told() {
    let folder = folder(&PART, "mu = 0.3\n");
    fs::write(folder.path().join("part.svg"), "<svg xmlns='http://www.w3.org/2000/svg'></svg>").unwrap();
    for (words, wanted) in [
        (&["push", "cad/part.dxf", "--edge", "0"][..], "a part file is asked for"),
        (&["sample", "part.svg"], "a scene is asked for: a scene names it in a [[shape]]"),
    ] {
        let told = text(&palpate(folder.path(), words).stderr);
        assert!(told.contains(wanted) && told.contains("outline = { file ="), "{told}");
        assert!(!told.contains("key with no value"), "{told}");
    }
}

#[test]
fn a_part_of_doubtful_size_is_doubted() {
    let folder = folder(&PART.map(|corner| corner.map(|x| 0.02 * x)), "mu = 0.3\n");
    for file in ["part.toml", "cad/part.dxf"] {
        let told = text(&palpate(folder.path(), &["part", file]).stderr);
        assert!(told.contains("2.000 mm across: is its unit right?"), "{file}: {told}");
    }
}
