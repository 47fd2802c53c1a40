//! Rolling as its users meet it: `palpate solve` on the reference cases and on the documentation's worked lines.
//!
//! The reference cases are beside the project; without them the tests say so and check the documentation alone.

use std::num::NonZeroUsize;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use palpate_files::solve::{KINDS, run};
use palpate_tests::project;
use serde_json::Value;

/// Answers to problems, in order.
fn solve<'a>(problems: impl Iterator<Item = &'a Value>) -> Vec<Value> {
    let input: String = problems.map(|problem| format!("{problem}\n")).collect();
    let mut output = Vec::new();
    run(KINDS, NonZeroUsize::MIN, std::io::Cursor::new(input.into_bytes()), &mut output).unwrap();
    String::from_utf8(output).unwrap().lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// The reference cases of a file that are about rolling.
fn cases(name: &str) -> Vec<Value> {
    let all = project::reference_cases(name).unwrap_or_default().into_iter();
    all.filter(|case| case["problem"]["system"].as_str().is_none_or(|system| system == "roll")).collect()
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap_or(&Vec::new()).iter().map(|number| number.as_f64().unwrap()).collect()
}

fn attitude(value: &Value) -> UnitQuaternion<f64> {
    let [w, x, y, z] = numbers(value)[..] else { panic!("no quaternion: {value}") };
    UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z))
}

#[test]
fn rolls_are_those_of_the_reference() {
    let cases = cases("roll");
    let answers = solve(cases.iter().map(|case| &case["problem"]));
    for (case, answer) in cases.iter().zip(&answers) {
        let (wanted, got) = (&case["expected"]["samples"], &answer["samples"]);
        assert_eq!(got.as_array().unwrap().len(), wanted.as_array().unwrap().len(), "{}", case["problem"]["id"]);
        for (wanted, got) in wanted.as_array().unwrap().iter().zip(got.as_array().unwrap()) {
            for field in ["u", "omega", "contact_body", "contact_force"] {
                let tolerance = case["tolerance"][field].as_f64().unwrap();
                for (wanted, got) in numbers(&wanted[field]).iter().zip(numbers(&got[field])) {
                    assert!((wanted - got).abs() <= tolerance, "{} {field}: {got} {wanted}", case["problem"]["id"]);
                }
            }
        }
    }
}

#[test]
fn ranks_are_those_of_the_reference() {
    let cases = cases("observability");
    let answers = solve(cases.iter().map(|case| &case["problem"]));
    for (case, answer) in cases.iter().zip(&answers) {
        for field in ["dimension", "rank", "observable"] {
            assert_eq!(answer[field], case["expected"][field], "{field}: {case} {answer}");
        }
    }
}

/// The attitude error modulo a group given by its name, rad.
fn error(got: &UnitQuaternion<f64>, wanted: &UnitQuaternion<f64>, symmetry: &str) -> f64 {
    let half = |axis: usize| UnitQuaternion::from_axis_angle(&Vector3::ith_axis(axis), std::f64::consts::PI);
    let still = UnitQuaternion::identity();
    let turns = match symmetry {
        "D2" => vec![still, half(0), half(1), half(2)],
        "C2" => vec![still, half(2)],
        "revolution" => {
            let [a, b] = [got, wanted].map(|attitude| attitude * Vector3::z());
            return a.cross(&b).norm().asin();
        }
        other => panic!("{other}"),
    };
    turns.iter().map(|turn| got.angle_to(&(wanted * turn))).fold(f64::INFINITY, f64::min)
}

#[test]
fn attitudes_are_found_from_the_paths_of_the_reference() {
    let cases = cases("observe_roll");
    let answers = solve(cases.iter().map(|case| &case["problem"]));
    for (case, answer) in cases.iter().zip(&answers) {
        let (expected, first) = (&case["expected"], &answer["hypotheses"][0]);
        assert_eq!(answer["symmetry"], expected["symmetry"], "{}", case["problem"]["id"]);
        let symmetry = expected["symmetry"]["name"].as_str().unwrap();
        let error = error(&attitude(&first["orientation0"]), &attitude(&expected["orientation0"]), symmetry);
        let tolerance = case["tolerance"]["rotation"].as_f64().unwrap();
        assert!(error <= tolerance, "{}: {error} rad, {tolerance} allowed", case["problem"]["id"]);
        let spinning = attitude(&first["orientation0"]) * Vector3::from_vec(numbers(&first["omega0"]));
        let wanted = Vector3::from_vec(numbers(&expected["omega0_palm"]));
        let tolerance = case["tolerance"]["omega"].as_f64().unwrap();
        assert!((spinning - wanted).amax() <= tolerance, "{}: {spinning} {wanted}", case["problem"]["id"]);
    }
}

#[test]
fn what_is_unknown_is_found_on_the_reference() {
    let cases = cases("blind");
    let answers = solve(cases.iter().map(|case| &case["problem"]));
    for (case, answer) in cases.iter().zip(&answers) {
        let (expected, tolerance, first) = (&case["expected"], &case["tolerance"], &answer["hypotheses"][0]);
        let id = &case["problem"]["id"];
        if let Some(index) = expected.get("body_index") {
            assert_eq!(&first["body_index"], index, "{id}");
        }
        if let Some(acceleration) = expected.get("palm_acceleration") {
            let limits = numbers(&tolerance["palm_acceleration"]);
            for ((got, wanted), limit) in
                numbers(&first["palm_acceleration"]).iter().zip(numbers(acceleration)).zip(limits)
            {
                assert!((got - wanted).abs() <= limit, "{id}: {got} {wanted}");
            }
        }
        if let Some(axes) = expected.get("semi_axes") {
            let sorted = |value: &Value| {
                let mut axes = numbers(value);
                axes.sort_by(f64::total_cmp);
                axes
            };
            let limit = numbers(&tolerance["semi_axes"]).into_iter().fold(0.0, f64::max);
            for (got, wanted) in sorted(&first["semi_axes"]).iter().zip(sorted(axes)) {
                assert!((got / wanted - 1.0).abs() <= limit, "{id}: {got} {wanted}");
            }
        }
    }
}

/// Numbers agree to this, relative to 1 or to themselves: another processor rounds otherwise, and a minimum of least
/// squares is found to about the root of rounding.
const PRINTED: f64 = 1e-6;

#[test]
fn worked_lines_are_answered_as_documented() {
    for id in ["pebble", "seen", "tip"] {
        let [problem, documented] = project::documented(|line| line["id"] == id);
        let answers = solve(std::iter::once(&problem));
        assert!(project::alike(&answers[0], &documented, PRINTED), "{}", answers[0]);
    }
}

#[test]
fn what_cannot_be_is_refused_at_its_place() {
    let roll = |body: &str, rest: &str| {
        format!(
            r#"{{"problem":"roll","body":{body},"spin":"none","initial":{{"orientation":[1,0,0,0],"omega":[0.1,0,0],"u":[0,0]}},"palm_acceleration":null,"times":[0,0.1]{rest}}}"#
        )
    };
    let observe = |change: &str| {
        format!(
            r#"{{"problem":"observe_roll","spin":"free","palm_acceleration":null,"noise":null,"dt":0.002{change}}}"#
        )
    };
    let pebble = r#"{"ellipsoid":[0.02,0.03,0.04]}"#;
    let cases = [
        (roll(r#"{"ellipsoid":[0.02,0,0.04]}"#, ""), "/body/ellipsoid/1", "> 0"),
        (roll(r#"{"egg":{"semi_axes":[0.025,0.03,0.04],"e":0.004,"zc":0}}"#, ""), "/body/egg/zc", "centroid"),
        (
            roll(r#"{"egg":{"semi_axes":[0.025,0.03,0.04],"e":0.05,"zc":0.02,"inertia_per_mass":[1,1,1]}}"#, ""),
            "/body/egg/e",
            "convex",
        ),
        (roll(r#"{"rounded":{"semi_axes":[0.02,0.03,0.04],"r":1e-12}}"#, ""), "/body/rounded/r", "convex"),
        (
            roll(r#"{"rounded":{"semi_axes":[0.02,0.03,0.04],"r":0.01,"inertia_per_mass":[1e-4,0,1e-4]}}"#, ""),
            "/body/rounded/inertia_per_mass/1",
            "> 0",
        ),
        (roll(pebble, "").replace("[1,0,0,0]", "[1,1,0,0]"), "/initial/orientation", "length"),
        (roll(pebble, "").replace("[0.1,0,0]", "[0.1,0,1]"), "/initial/omega", "spin"),
        (roll(pebble, "").replace("[0,0.1]}", "[0.1,0]}"), "/times/1", "increase"),
        (
            roll(pebble, "").replace("null", r#"{"piecewise":{"t":[0,2,1],"a":[[0,0,0],[0,0,0],[0,0,0]]}}"#),
            "/palm_acceleration/piecewise/t/2",
            "increase",
        ),
        (observe(&format!(r#","body":{pebble},"u":[[0,0],[0,0.001]]"#)), "/u", "too few"),
        (observe(&format!(r#","body":{pebble},"u":[[0,0],[0,0],[0,0],[0,0],[0,0],[0,0],[0,0]]"#)), "/u", "too short"),
        (observe(r#","u":[]"#), "/body", "missing"),
        (observe(r#","bodies":[],"u":[]"#), "/bodies", "empty"),
        (observe(r#","body":{"ellipsoid":"any"},"u":[]"#), "/body/ellipsoid", "unknown"),
    ];
    let problems: Vec<Value> = cases.iter().map(|(line, _, _)| serde_json::from_str(line).unwrap()).collect();
    for ((_, field, word), answer) in cases.iter().zip(solve(problems.iter())) {
        assert_eq!(answer["error"]["field"], *field, "{answer}");
        assert!(answer["error"]["message"].as_str().unwrap().contains(word), "{word}: {answer}");
    }
}
