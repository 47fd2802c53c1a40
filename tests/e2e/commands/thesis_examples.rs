//! `examples/thesis.jsonl`: a problem for each numbered result of the thesis that one kind answers, and what its answer
//! must show. `docs/SOLVE.md` says the same in words.

use std::collections::BTreeMap;
use std::process::Command;

use nalgebra::{Quaternion, Vector3};
use palpate_tests::project;
use serde_json::Value;

use crate::PALPATE;

/// The problems of the example, and their answers, by `id`.
fn solved() -> BTreeMap<String, [Value; 2]> {
    let path = project::folder().join("examples/thesis.jsonl");
    let output = Command::new(PALPATE).arg("solve").arg(&path).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let lines = |text: &str| text.lines().map(|line| serde_json::from_str(line).unwrap()).collect::<Vec<Value>>();
    let (problems, answers) =
        (lines(&std::fs::read_to_string(path).unwrap()), lines(&String::from_utf8(output.stdout).unwrap()));
    assert_eq!(problems.len(), answers.len());
    let named = problems.into_iter().zip(answers).map(|(problem, answer)| {
        assert_eq!(problem["id"], answer["id"]);
        (problem["id"].as_str().unwrap().to_owned(), [problem, answer])
    });
    named.collect()
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value} is no number"))
}

fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    std::array::from_fn(|i| number(&value[i]))
}

fn count(value: &Value) -> usize {
    value.as_array().unwrap_or_else(|| panic!("{value} is no list")).len()
}

/// Which states do not show, each by itself.
fn unseen(answer: &Value) -> Vec<&str> {
    let directions = answer["unobservable_directions"].as_array().unwrap();
    let alone = |direction: &Value| {
        let weights = direction.as_object().unwrap();
        weights.iter().map(|(_, weight)| number(weight).abs()).sum::<f64>() < 1.0 + 1e-6
    };
    assert!(directions.iter().all(alone), "{answer}");
    let mut names: Vec<&str> = directions
        .iter()
        .flat_map(|direction| direction.as_object().unwrap())
        .filter(|(_, weight)| number(weight).abs() > 0.5)
        .map(|(name, _)| name.as_str())
        .collect();
    names.sort_unstable();
    names
}

/// What the answer to one problem must show.
type Check = fn(&Value, &Value);

/// By `id`, in the order of the thesis.
const CHECKS: &[(&str, Check)] = &[
    ("Theorem 2", |problem, answer| assert_eq!(count(&answer["poses"]), 6 * count(&problem["polygon"]))),
    ("Corollary 3", |problem, answer| {
        assert_eq!(count(&problem["cones"]), 2);
        assert_eq!(count(&answer["poses"]), 6 * count(&problem["polygon"]));
    }),
    ("Figure 2.1", |_, answer| {
        let [pose] = &answer["poses"].as_array().unwrap()[..] else { panic!("{answer}") };
        let [x, y, theta] = numbers(pose);
        assert!((x - 0.01).abs() < 1e-8 && (y - 0.05).abs() < 1e-8 && (theta - 0.5).abs() < 1e-7, "{pose}");
    }),
    ("Lemma 4, fewest", |problem, answer| {
        assert_eq!((count(&problem["polygons"]), count(&answer["points"]), &answer["optimal"]), (8, 3, &true.into()));
    }),
    ("Lemma 4, most", |problem, answer| {
        assert_eq!((count(&problem["polygons"]), count(&answer["points"]), &answer["optimal"]), (8, 7, &true.into()));
    }),
    ("Theorem 6", three_of_four_elements),
    ("Corollary 7", three_of_four_elements),
    ("Lemma 10", |_, answer| {
        // A path of five vertices: two are 3-independent, three are left.
        assert_eq!((count(&answer["points"]), &answer["optimal"]), (5 - 2, &true.into()));
    }),
    ("§3.4", |problem, answer| {
        let n = f64::from(u32::try_from(count(&problem["polygons"])).unwrap());
        assert!(count(&answer["points"]) as f64 <= 3.0 * 2.0 * n.ln(), "{answer}");
    }),
    ("Figure 3.1", |_, answer| assert_eq!(count(&answer["poses"]), 12)),
    ("Theorem 13", |_, answer| {
        assert_eq!((&answer["rank"], &answer["dimension"]), (&3.into(), &4.into()));
        assert_eq!(unseen(answer), ["s"]);
    }),
    ("Theorem 16", |problem, answer| {
        // 10 mm off at first.
        assert!((number(&problem["initial_estimate"]["s"]) - 0.005).abs() > 9e-3);
        let end = number(&answer["hypotheses"][0]["s_end"]);
        assert!((end - TRUE_S_END).abs() < 1e-5, "{end}");
    }),
    ("Corollary 18", |_, answer| {
        // Nothing turns it at first, though the finger pushes with 3 m/s².
        let [first, soon] = [0, 1].map(|k| &answer["samples"][k]);
        assert!(number(&first["normal_force"]) > 2.0 && number(&soon["omega"]).abs() < 1e-5, "{answer}");
    }),
    ("(5.21)", |problem, answer| {
        // The contact is above the disk's centre; there the part takes the finger's acceleration.
        let start = &answer["initial_acceleration"];
        let lever = -number(&answer["samples"][0]["pose"][0]);
        let at_contact = number(&start["centroid"][1]) + number(&start["alpha"]) * lever;
        let wanted = number(&problem["finger"]["acceleration"][1]);
        assert!((at_contact - wanted).abs() < 1e-12 && number(&start["alpha"]) > 1.0, "{answer}");
    }),
    ("Theorem 19", all_shows),
    ("Theorem 21", all_shows),
    ("Theorem 23", all_shows),
    ("§8.2.1, on ice", |problem, answer| {
        assert_eq!(problem["mu"], 0);
        assert_eq!((&answer["rank"], unseen(answer)), (&2.into(), vec!["s", "vT"]));
    }),
    ("§8.2.1, on a table", all_shows),
    ("Proposition 20", |problem, answer| {
        let (start, end) = (&answer["samples"][0], &answer["final"]);
        let [along, turn] = ["s", "u"].map(|name| number(&end[name]) - number(&start[name]));
        let radius = number(&problem["finger"]["radius"]);
        assert!(turn > 0.1 && (along + radius * turn).abs() < 1e-11, "{answer}");
    }),
    ("Proposition 22", |problem, answer| {
        let friction = number(&problem["mu_c"]);
        let needed = |sample: &Value| number(&sample["tangential_force"]) / number(&sample["normal_force"]);
        let [first, last] = [&answer["samples"][0], &answer["final"]];
        assert_eq!([&first["mode"], &last["mode"]], ["sliding", "rolling"]);
        assert!((needed(first) + friction).abs() < 1e-12 && needed(last).abs() < friction, "{answer}");
    }),
    ("Figure 5.5", |_, answer| {
        assert_eq!(answer["status"], "ambiguous");
        assert!(count(&answer["solutions"]) >= 2);
    }),
    ("§5.3.2", |_, answer| {
        let [solution] = &answer["solutions"].as_array().unwrap()[..] else { panic!("{answer}") };
        assert!((number(&solution["s0"]) - 0.008).abs() < 1e-6 && solution["edge"] == 0, "{answer}");
    }),
    ("§5.3, without a first guess", |_, answer| {
        assert_eq!(answer["status"], "unique");
        let best = &answer["hypotheses"][0];
        assert!((number(&best["s_end"]) - TRUE_S_END).abs() < 1e-6 && best["edge"] == 0, "{best}");
    }),
    ("Figure 6.8", |_, answer| {
        assert_eq!(answer["status"], "ambiguous");
        let mut edges: Vec<_> = answer["hypotheses"].as_array().unwrap().iter().map(|h| h["edge"].as_u64()).collect();
        edges.sort_unstable();
        assert_eq!(edges, [Some(0), Some(1), Some(2), Some(3)]);
    }),
    ("(5.18)", |_, answer| {
        let ([x, y], area) = (numbers(&answer["i1"]), number(&answer["area"]));
        assert!((x - area).abs() < 1e-15 && y.abs() < 1e-15 && number(&answer["i2"]).abs() < 1e-15, "{answer}");
    }),
    ("(C.1)", |_, answer| {
        // The sum over the triangles of figure C.1, m².
        let [x, y] = numbers(&answer["i1"]);
        assert!((x - 5.718_80e-4).abs() < 1e-9 && (y - 2.028_365e-3).abs() < 1e-9, "{answer}");
    }),
    ("Theorem 24", |_, answer| {
        let energies: Vec<_> = samples(answer).iter().map(|sample| number(&sample["energy"])).collect();
        assert!(energies.iter().all(|energy| (energy / energies[0] - 1.0).abs() < 1e-9), "{energies:?}");
    }),
    ("(7.4)", |_, answer| {
        for sample in samples(answer) {
            let [w, x, y, z] = numbers(&sample["orientation"]);
            let normal = -Vector3::new(2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z);
            let omega = Vector3::from(numbers::<3>(&sample["omega"]));
            assert!(omega.norm() > 1.0 && omega.dot(&normal).abs() < 1e-8, "{sample}");
        }
    }),
    ("Theorem 32", |_, answer| fulfilled(answer, true, 8)),
    ("Theorem 32, without spin", |_, answer| fulfilled(answer, true, 7)),
    ("Proposition 28, a spheroid", |_, answer| {
        assert!(number(&answer["sufficient_condition"]["det_b1_b2_beta"]).abs() < 1e-9, "{answer}");
        fulfilled(answer, false, 7);
    }),
    ("Lemma 30, a spheroid's pole", |_, answer| {
        let terms = ["curvature_term", "mobility_term", "beta_cross_z"];
        assert!(terms.iter().all(|term| number(&answer["sufficient_condition"][term]).abs() < 1e-9), "{answer}");
        fulfilled(answer, false, 7);
        assert_eq!(unseen(answer), ["rotation_z"]);
    }),
    ("(7.21), a sphere", |_, answer| fulfilled(answer, false, 4)),
    ("Theorem 32, on a tip at rest", |_, answer| {
        // Fulfilled, for it counts on a palm that moves.
        fulfilled(answer, true, 6);
        assert_eq!(unseen(answer), ["omega_palm_z", "rotation_z"]);
    }),
    ("Theorem 32, on a tip, the palm moving", |_, answer| fulfilled(answer, true, 8)),
    ("Theorem 32, silent", |_, answer| {
        assert!(number(&answer["sufficient_condition"]["det_b1_b2_beta"]).abs() < 1e-9, "{answer}");
        fulfilled(answer, false, 8);
    }),
    ("§7.3", |_, answer| {
        assert_eq!((&answer["status"], &answer["certificate"]["certified"]), (&"unique".into(), &true.into()));
        // The attitude that was rolled, or it after half a turn about an axis of the ellipsoid.
        let of = |[w, x, y, z]: [f64; 4]| Quaternion::new(w, x, y, z);
        let turn = of([0.1, -0.7, 0.5, 0.5]).conjugate() * of(numbers(&answer["hypotheses"][0]["orientation0"]));
        assert!((turn.coords.amax() - 1.0).abs() < 1e-9, "{turn}");
    }),
];

/// Where the contact of the rolled push was after 1.2 s, m.
const TRUE_S_END: f64 = -0.002_488_557_65;

fn samples(answer: &Value) -> &[Value] {
    answer["samples"].as_array().unwrap()
}

fn three_of_four_elements(_: &Value, answer: &Value) {
    assert_eq!((&answer["regions"], count(&answer["points"]), &answer["optimal"]), (&5.into(), 3, &true.into()));
}

fn all_shows(_: &Value, answer: &Value) {
    assert_eq!((&answer["observable"], &answer["rank"]), (&true.into(), &answer["dimension"]));
}

fn fulfilled(answer: &Value, holds: bool, rank: u64) {
    assert_eq!(answer["sufficient_condition"]["holds"], holds, "{answer}");
    assert_eq!(answer["rank"], rank, "{answer}");
}

#[test]
fn every_example_of_the_thesis_shows_its_result() {
    let solved = solved();
    for (id, check) in CHECKS {
        let [problem, answer] = solved.get(*id).unwrap_or_else(|| panic!("no example `{id}`"));
        check(problem, answer);
    }
    assert_eq!(solved.len(), CHECKS.len(), "{:?}", solved.keys());
}

#[test]
fn every_example_of_the_thesis_is_documented() {
    let page = std::fs::read_to_string(project::folder().join("docs/SOLVE.md")).unwrap();
    let section = page.split("## Results of the thesis").nth(1).expect("the section is there");
    let documented: Vec<_> = section
        .lines()
        .filter_map(|line| line.strip_prefix("| "))
        .filter_map(|row| row.split(" | ").next())
        .filter(|id| *id != "`id`")
        .collect();
    let checked: Vec<_> = CHECKS.iter().map(|(id, _)| *id).collect();
    assert_eq!(documented, checked);
}
