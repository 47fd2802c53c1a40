//! The kind `initial_pose`.

use std::f64::consts::PI;

use palpate_tests::project::reference_cases;
use serde_json::{Value, json};

use crate::solving::{assert_documented, solve};

/// How far apart two places on the part are: on an ellipse they repeat after half a turn.
fn gap(a: &Value, b: &Value) -> f64 {
    let gap = a["s0"].as_f64().unwrap() - b["s0"].as_f64().unwrap();
    let gap = if b["edge"].is_null() { (gap + PI / 2.0).rem_euclid(PI) - PI / 2.0 } else { gap };
    if a["edge"] == b["edge"] { gap.abs() } else { f64::INFINITY }
}

#[test]
fn the_shared_cases_are_solved_and_no_candidate_is_lost() {
    let Some(cases) = reference_cases("initial_pose") else { return };
    assert!(!cases.is_empty());
    let answers = solve(&cases.iter().map(|case| case["problem"].to_string()).collect::<Vec<_>>());
    for (case, answer) in cases.iter().zip(&answers) {
        let (expected, tolerance) = (&case["expected"], &case["tolerance"]);
        assert_eq!((&answer["status"], answer["solutions"].as_array().map(Vec::len)), (&json!("unique"), Some(1)));
        assert!(gap(&answer["solutions"][0], expected) <= tolerance["s0"].as_f64().unwrap(), "{case} {answer}");
        for wanted in expected["candidates"].as_array().unwrap() {
            let candidates = answer["candidates"].as_array().unwrap();
            let nearest = candidates.iter().map(|candidate| gap(candidate, wanted)).fold(f64::INFINITY, f64::min);
            assert!(nearest <= tolerance["candidate_s0"].as_f64().unwrap(), "{wanted} of {case}: {answer}");
        }
    }
}

#[test]
fn the_documented_line_is_answered_as_documented() {
    assert_documented("initial_pose", |_| true);
}

#[test]
fn what_cannot_be_is_refused_at_its_place() {
    let line = |changes: Value| {
        let mut problem = json!({
            "problem": "initial_pose", "mu": 0.3, "u0": 1.5, "contacts": [[0.1, 1.51], [0.2, 1.53]],
            "finger": {"type": "disk", "radius": 0.01, "acceleration": [0, 0.5]},
            "object": {"type": "polygon", "vertices": [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]]},
        });
        for (key, value) in changes.as_object().unwrap() {
            problem[key] = value.clone();
        }
        problem.to_string()
    };
    let cases = [
        (line(json!({"contacts": []})), "/contacts", "is empty"),
        (line(json!({"contacts": [[0.2, 1.5], [0.1, 1.5]]})), "/contacts/1/0", "times must increase"),
        (line(json!({"contacts": [[0.0, 1.5]]})), "/contacts/0/0", "above 0"),
        (line(json!({"contacts": [[0.1, 1.5], [1e6, 1.6]]})), "/contacts/1/0", "sizes of the part"),
        (line(json!({"tolerance": 0})), "/tolerance", "must be > 0"),
        (line(json!({"mu": -0.1})), "/mu", "must be ≥ 0"),
        (line(json!({"finger": {"type": "banana"}})), "/finger/type", "banana"),
        (
            line(json!({"finger": {"type": "disk", "radius": -1, "acceleration": [0, 1]}})),
            "/finger/radius",
            "must be ≥ 0",
        ),
        (line(json!({"finger": {"type": "ellipse", "a": 0.01, "acceleration": [0, 1]}})), "/finger/b", "missing"),
        (
            line(json!({"finger": {"type": "disk", "radius": 0.01, "acceleration": [0, -1]}})),
            "/finger/acceleration",
            "away",
        ),
        (line(json!({"finger": {"type": "line", "acceleration": [0, 1]}, "u0": 0})), "/finger/type", "straight"),
        (line(json!({"object": {"type": "ellipse", "a": 0.01, "b": 0}})), "/object/b", "must be > 0"),
        (
            line(json!({"object": {"type": "polygon", "vertices": [[0, 0], [0, 1], [1, 0]]}})),
            "/object/vertices",
            "clockwise",
        ),
    ];
    let answers = solve(&cases.iter().map(|(line, _, _)| line.clone()).collect::<Vec<_>>());
    for ((line, field, word), answer) in cases.iter().zip(&answers) {
        assert_eq!(answer["error"]["field"], *field, "{line}: {answer}");
        assert!(answer["error"]["message"].as_str().unwrap().contains(word), "{line}: {answer}");
    }
}
