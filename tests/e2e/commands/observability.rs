//! The kind `observability`.

use palpate_tests::project::reference_cases;
use serde_json::Value;

use crate::solving::{assert_documented, solve};

#[test]
fn the_shared_cases_of_pushes_have_their_rank() {
    let Some(cases) = reference_cases("observability") else { return };
    let pushes: Vec<_> = cases.into_iter().filter(|case| case["problem"]["system"] == "push").collect();
    assert!(!pushes.is_empty());
    let answers = solve(&pushes.iter().map(|case| case["problem"].to_string()).collect::<Vec<_>>());
    for (case, answer) in pushes.iter().zip(&answers) {
        for field in ["dimension", "rank", "observable"] {
            assert_eq!(answer[field], case["expected"][field], "{field} of {}: {answer}", case["problem"]["id"]);
        }
        let unseen = answer["unobservable_directions"].as_array().unwrap().len();
        let lost = answer["dimension"].as_u64().unwrap() - answer["rank"].as_u64().unwrap();
        assert_eq!(unseen as u64, lost, "{answer}");
    }
}

#[test]
fn the_documented_line_is_answered_as_documented() {
    assert_documented("observability", |problem| problem["system"] == "push");
}

#[test]
fn what_has_no_answer_is_refused_at_its_place() {
    let line = |change: (&str, Value)| {
        let mut problem: Value = serde_json::from_str(
            r#"{"problem":"observability","system":"push","polygon":[[-0.03,-0.02],[0.03,-0.02],[0.03,0.02],[-0.03,0.02]],
            "edge":0,"mu":0.25,"mode":"frictionless","finger":{"radius":0.01,"centre0":[0,0],"velocity0":[0,0.05],
            "acceleration":[0,0]},"initial":{"u":1.5,"s":0.005,"omega":0,"vT":0}}"#,
        )
        .unwrap();
        problem[change.0] = change.1;
        problem.to_string()
    };
    let still = serde_json::json!({"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0], "acceleration": [0, 0.1]});
    let cases = [
        (line(("system", "pull".into())), "/system", "pull"),
        (line(("mode", "coulomb".into())), "/mode", "rolling"),
        (line(("mode", "sliding".into())), "/mu_c", "is missing"),
        (line(("edge", 7.into())), "/edge", "no edge"),
        (line(("times", serde_json::json!([0]))), "/times", "times"),
        (line(("finger", still)), "/initial", "at rest"),
        (line(("initial", serde_json::json!({"u": 1.5, "s": 0.005, "at_rest": true}))), "/", "at rest"),
        (line(("polygon", serde_json::json!([[0, 0], [0, 1], [1, 0]]))), "/polygon", "clockwise"),
    ];
    let answers = solve(&cases.iter().map(|(line, _, _)| line.clone()).collect::<Vec<_>>());
    for ((line, field, word), answer) in cases.iter().zip(&answers) {
        let error = &answer["error"];
        assert!(error["field"].as_str().is_some_and(|place| place.starts_with(field)), "{line}: {answer}");
        assert!(error["message"].as_str().unwrap().contains(word), "{line}: {answer}");
    }
}

/// A body may turn fast, but not so fast that its motion could not be followed.
#[test]
fn bodies_that_turn_too_fast_are_refused() {
    let line = |omega: f64| {
        let problem = serde_json::json!({
            "problem": "observability", "system": "roll", "body": {"ellipsoid": [0.02, 0.03, 0.04]}, "spin": "free",
            "orientation": [1, 0, 0, 0], "omega": [0.3, omega, 0.7], "inputs": "zero",
        });
        problem.to_string()
    };
    let answers = solve(&[line(1.0), line(3e3), line(3e6)]);
    assert!(answers[..2].iter().all(|answer| answer["rank"].as_u64() == Some(8)), "{answers:?}");
    let error = &answers[2]["error"];
    assert_eq!(error["field"], "/omega");
    assert!(error["message"].as_str().unwrap().contains("the limit is 2000"), "{error}");
}
