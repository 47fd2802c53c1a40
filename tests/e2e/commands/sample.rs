//! `palpate corner` and `palpate sample` as a person uses them: from a part or a scene to a plan, and back to a name.

use std::path::Path;
use std::process::Command;

use palpate_files::sampling_plan::PlanFile;

use crate::PALPATE;

/// What a command that succeeds prints.
fn printed(folder: &Path, arguments: &[&str]) -> String {
    let output = Command::new(PALPATE).args(arguments).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Figure 3.1 of the thesis, on the command line; and every pose is known again by what its points read.
#[test]
fn a_part_file_becomes_twelve_corner_poses_and_a_plan_of_four_points() {
    let folder = tempfile::TempDir::new().unwrap();
    let part =
        "unit = 'mm'\nvertices = [[0, 0], [52, -4], [71, 23], [49, 58], [21, 37], [-9, 49], [-17, 21]]\nmu = 0.3\n";
    std::fs::write(folder.path().join("part.toml"), part).unwrap();
    let run = |arguments: &[&str]| printed(folder.path(), arguments);
    let json = run(&["corner", "part.toml", "--sample", "--json"]);
    let plan: PlanFile = serde_json::from_str(&json).unwrap();
    assert_eq!((plan.names.len(), plan.answer.points.len(), plan.answer.lower_bound), (12, 4, 4));
    std::fs::write(folder.path().join("plan.json"), &json).unwrap();
    for (signature, name) in plan.answer.signatures.iter().zip(&plan.names) {
        let readings: String = signature.iter().map(u8::to_string).collect();
        assert!(run(&["sample", "--decode", "plan.json", &readings]).starts_with(name.as_str()));
    }
}

#[test]
fn a_plan_made_on_the_command_line_decodes_there() {
    let folder = tempfile::TempDir::new().unwrap();
    let scene = "unit = 'mm'\n[[shape]]\nname = 'bar'\nvertices = [[0, 0], [60, 0], [60, 10], [0, 10]]\n\
                 poses = [[0, 0, 0], [30, 0, 0], [10, 0, 90]]\n[[shape]]\nname = 'disk'\nvertices = [[0, 0, 1], [40, 0, 1]]";
    std::fs::write(folder.path().join("scene.toml"), scene).unwrap();
    let run = |arguments: &[&str]| printed(folder.path(), arguments);
    let json = run(&["sample", "scene.toml", "--notice", "1", "--json"]);
    let plan: PlanFile = serde_json::from_str(&json).unwrap();
    std::fs::write(folder.path().join("plan.json"), &json).unwrap();
    for (signature, name) in plan.answer.signatures.iter().zip(&plan.names) {
        let readings: String = signature.iter().map(u8::to_string).collect();
        assert!(run(&["sample", "--decode", "plan.json", &readings]).starts_with(name.as_str()));
        let unreadable = format!("?{}", &readings[1..]);
        assert!(run(&["sample", "--decode", "plan.json", &unreadable]).starts_with(name.as_str()));
    }
    std::fs::write(folder.path().join("sets.txt"), "x: a b\ny: a\nz: b c\nnone:\n").unwrap();
    let found = run(&["sample", "--sets", "sets.txt", "--tree"]);
    assert!(
        found.contains("2 of them tell the sets apart (proven fewest): a b") && found.contains("at most 2 questions"),
        "{found}"
    );
}
