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

/// A rectangle lies upright or on its side, each either way round: four poses, two outlines, one point; and where the
/// corner is sharp too no point is without room.
#[test]
fn poses_of_a_symmetric_part_with_one_outline_are_one() {
    let folder = tempfile::TempDir::new().unwrap();
    let part = "unit = 'mm'\nvertices = [[0, 0], [120, 0], [120, 80], [0, 80]]\n";
    std::fs::write(folder.path().join("part.toml"), part).unwrap();
    let plan = |angle: &str| -> PlanFile {
        let json = printed(folder.path(), &["corner", "part.toml", "--angle-deg", angle, "--sample", "--json"]);
        serde_json::from_str(&json).unwrap()
    };
    let upright = plan("90");
    assert_eq!((upright.names.len(), upright.answer.points.len()), (2, 1));
    assert!(upright.names[0].ends_with("flush on both at 0.00° or flush on both at 180.00°"), "{:?}", upright.names);
    assert!(plan("60").answer.clearances.iter().all(|room| *room > 1e-3));
    let words = printed(folder.path(), &["corner", "part.toml", "--sample"]);
    assert!(words.contains("2 outlines to tell apart") && words.contains("4 poses"), "{words}");
}

/// The weight outside of one end of a bar: it stands on other sides.
#[test]
fn a_part_in_a_corner_rests_by_its_centre_of_mass() {
    let folder = tempfile::TempDir::new().unwrap();
    let bar = "unit = 'mm'\nvertices = [[0, 0], [60, 0], [60, 40], [0, 40]]\n";
    let margins = |more: &str| -> Vec<f64> {
        std::fs::write(folder.path().join("part.toml"), format!("{bar}{more}")).unwrap();
        let answer: serde_json::Value =
            serde_json::from_str(&printed(folder.path(), &["corner", "part.toml", "--json"])).unwrap();
        answer["poses"].as_array().unwrap().iter().map(|pose| pose["margin"].as_f64().unwrap()).collect()
    };
    let differ = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
    let [uniform, middle, aside] = ["", "[30, 20]", "[50, 20]"].map(|centre| {
        let given = if centre.is_empty() { "" } else { "radius_of_gyration = 20\ncentre_of_mass = " };
        margins(&format!("{given}{centre}\n"))
    });
    // m/rad: where the weight is in the middle, rounding alone.
    assert!(differ(&uniform, &middle) < 1e-12 && differ(&uniform, &aside) > 1e-3, "{uniform:?} {middle:?} {aside:?}");
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
