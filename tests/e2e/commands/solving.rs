//! `palpate solve` as a process, and the worked lines of the documentation.

use std::io::Write;
use std::process::{Command, Stdio};

use palpate_tests::project;
use serde_json::Value;

use crate::PALPATE;

/// The answers to some lines, in order. Newlines within a line are taken out.
pub(crate) fn solve(lines: &[String]) -> Vec<Value> {
    let mut command = Command::new(PALPATE);
    let mut child = command.args(["solve", "-"]).stdin(Stdio::piped()).stdout(Stdio::piped()).spawn().unwrap();
    let input: Vec<_> = lines.iter().map(|line| line.replace('\n', " ")).collect();
    let (mut stdin, input) = (child.stdin.take().unwrap(), input.join("\n"));
    let feeder = std::thread::spawn(move || stdin.write_all(input.as_bytes()).unwrap());
    let output = child.wait_with_output().unwrap();
    feeder.join().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let answers: Vec<_> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(answers.len(), lines.len());
    answers
}

/// Numbers that differ in their last digits on another processor, relative to 1 or to themselves.
const PRINTED: f64 = 1e-9;

fn alike(a: &Value, b: &Value) -> bool {
    match (a, b) {
        (Value::Number(a), Value::Number(b)) => {
            let pair = a.as_f64().zip(b.as_f64());
            pair.is_some_and(|(a, b)| (a - b).abs() <= PRINTED * a.abs().max(1.0))
        }
        (Value::Array(a), Value::Array(b)) => a.len() == b.len() && a.iter().zip(b).all(|(a, b)| alike(a, b)),
        (Value::Object(a), Value::Object(b)) => {
            a.len() == b.len() && a.iter().all(|(key, a)| b.get(key).is_some_and(|b| alike(a, b)))
        }
        _ => a == b,
    }
}

/// Solves the worked line of a kind in `docs/SOLVE.md` and compares it with the answer printed after it.
pub(crate) fn assert_documented(kind: &str, chosen: impl Fn(&Value) -> bool) {
    let page = project::folder().join("docs/SOLVE.md");
    let page = std::fs::read_to_string(page).unwrap();
    let mut lines = page.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    let problem = lines.find(|line| line["problem"] == kind && chosen(line)).unwrap();
    let documented = lines.find(|line| line["problem"] == kind).unwrap();
    let [answer] = &solve(&[problem.to_string()])[..] else { panic!("one answer") };
    assert!(alike(answer, &documented), "{answer}");
}
