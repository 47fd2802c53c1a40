//! `palpate solve` on the shared cases of kind `support_friction`, where they are present.

use palpate_tests::project::reference_cases;
use serde_json::Value;

use crate::solving::solve;

/// All numbers of a value, in order.
fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(list) => list.iter().flat_map(numbers).collect(),
        value => vec![value.as_f64().unwrap()],
    }
}

#[test]
fn the_shared_cases_come_out_within_their_tolerances() {
    let Some(cases) = reference_cases("friction") else { return };
    assert!(!cases.is_empty());
    let answers = solve(&cases.iter().map(|case| case["problem"].to_string()).collect::<Vec<_>>());
    for (case, answer) in cases.iter().zip(&answers) {
        assert_eq!((&answer["id"], &answer["problem"]), (&case["problem"]["id"], &case["problem"]["problem"]));
        for name in ["area", "centroid", "i1", "i2"] {
            let tolerance = case["tolerance"][name].as_f64().unwrap();
            for (got, wanted) in numbers(&answer[name]).iter().zip(numbers(&case["expected"][name])) {
                assert!((got - wanted).abs() <= tolerance, "{name}: {got} {wanted} {tolerance:e} in {case}");
            }
        }
    }
}

#[test]
fn a_part_at_rest_is_refused() {
    let line = r#"{"problem":"support_friction","polygon":[[0,0],[1,0],[0,1]],"velocity":[0,-0.0],"omega":0}"#;
    let [answer] = &solve(&[line.to_owned()])[..] else { panic!("one answer") };
    assert_eq!(answer["error"]["code"], "invalid_input");
    assert!(answer["error"]["message"].as_str().unwrap().contains("`omega`"), "{answer}");
}

/// Numbers at the ends of what JSON can hold have answers too.
#[test]
fn the_greatest_and_least_motions_have_answers() {
    let line = |vx: &str, omega: &str| {
        format!(r#"{{"problem":"support_friction","polygon":[[0,0],[1,0],[0,1]],"velocity":[{vx},0],"omega":{omega}}}"#)
    };
    let lines =
        [line("1e308", "0"), line("1e308", "1e308"), line("5e-324", "0"), line("0", "5e-324"), line("1", "5e-324")];
    for answer in solve(&lines) {
        let [x, y] = numbers(&answer["i1"])[..] else { panic!("{answer}") };
        assert!(x.hypot(y) <= 0.5 + 1e-12 && x.hypot(y) > 0.1, "{answer}");
    }
}
