//! The kind `observe_push` with the thesis's observer.

use std::f64::consts::PI;

use palpate_tests::project::reference_cases;
use serde_json::{Value, json};

use crate::solving::{assert_documented, solve};

const NAMES: [&str; 4] = ["u", "s", "omega", "vT"];

#[test]
fn the_shared_cases_are_followed() {
    let Some(cases) = reference_cases("gho") else { return };
    assert!(!cases.is_empty());
    let answers = solve(&cases.iter().map(|case| case["problem"].to_string()).collect::<Vec<_>>());
    for (case, answer) in cases.iter().zip(&answers) {
        let (expected, tolerance) = (&case["expected"], &case["tolerance"]["estimate"]);
        let trace = answer["trace"].as_array().unwrap();
        for (index, t) in expected["t"].as_array().unwrap().iter().enumerate() {
            let t = t.as_f64().unwrap();
            let at = trace.iter().find(|point| (point["t"].as_f64().unwrap() - t).abs() < 1e-9).unwrap();
            for (column, wanted) in expected["estimate"][index].as_array().unwrap().iter().enumerate() {
                let Some(tolerance) = tolerance[index][column].as_f64() else { continue };
                let off = at[NAMES[column]].as_f64().unwrap() - wanted.as_f64().unwrap();
                let off = if column == 0 { (off + PI).rem_euclid(2.0 * PI) - PI } else { off };
                assert!(off.abs() <= tolerance, "{} at {t} s: off by {off}", case["problem"]["id"]);
            }
        }
    }
}

#[test]
fn the_documented_line_is_answered_as_documented() {
    assert_documented("observe_push", |problem| problem["method"] == "gho");
}

fn problem(changes: Value) -> String {
    let angles: Vec<_> = (0..40).map(|index| 1.6 + 0.002 * f64::from(index)).collect();
    let mut problem = json!({
        "problem": "observe_push", "polygon": [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]], "mu": 0.3,
        "mode": "frictionless", "finger": {"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [0, 0]},
        "dt": 0.01, "contact_angle": angles, "sigma": 0, "method": "gho", "zeta": 10,
        "initial_estimate": {"u": 1.6, "s": 0.005, "omega": 0.1, "vT": 0},
    });
    for (key, value) in changes.as_object().unwrap() {
        problem[key] = value.clone();
    }
    problem.to_string()
}

#[test]
fn without_an_edge_each_edge_has_its_observer() {
    let sliding = json!({"mode": "sliding", "mu_c": 0.2});
    let answers = solve(&[problem(json!({})), problem(sliding)]);
    // An observer may diverge; a rectangle's sides come in equal pairs.
    for (answer, most) in answers.iter().zip([4, 8]) {
        let hypotheses = answer["hypotheses"].as_array().unwrap();
        assert!((2..=most).contains(&hypotheses.len()), "{answer}");
        let costs: Vec<_> = hypotheses.iter().map(|hypothesis| hypothesis["cost"].as_f64().unwrap()).collect();
        assert!(costs.is_sorted(), "{costs:?}");
        assert!(hypotheses.iter().all(|h| h["trace"].as_array().unwrap().len() == 40 && h["covariance"].is_null()));
        assert_eq!(answer["trace"], hypotheses[0]["trace"]);
    }
}

#[test]
fn what_the_observer_cannot_do_is_refused_at_its_place() {
    let estimate = json!({"u": 1.6, "s": 0.005, "omega": 0.1});
    let beyond = json!({"u": 1.6, "s": 0.005, "omega": 0.1, "vT": 0, "edge": 9});
    let cases = [
        (problem(json!({"mode": "coulomb", "mu_c": 0.2})), "/mode", "rolling"),
        (problem(json!({"initial_estimate": estimate})), "/initial_estimate/vT", "is missing"),
        (problem(json!({"initial_estimate": beyond})), "/initial_estimate/edge", "no edge"),
        (problem(json!({"zeta": 0})), "/zeta", "must be > 0"),
        (problem(json!({"correction": [-1, 1]})), "/correction/0", "must be ≥ 0"),
    ];
    let answers = solve(&cases.iter().map(|(line, _, _)| line.clone()).collect::<Vec<_>>());
    for ((line, field, word), answer) in cases.iter().zip(&answers) {
        assert_eq!(answer["error"]["field"], *field, "{line}: {answer}");
        assert!(answer["error"]["message"].as_str().unwrap().contains(word), "{line}: {answer}");
    }
}
