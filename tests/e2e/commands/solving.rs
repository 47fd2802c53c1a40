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

/// Solves the worked line of a kind in `docs/SOLVE.md` and compares it with the answer printed after it.
pub(crate) fn assert_documented(kind: &str, chosen: impl Fn(&Value) -> bool) {
    let [problem, documented] = project::documented(|line| line["problem"] == kind && chosen(line));
    let [answer] = &solve(&[problem.to_string()])[..] else { panic!("one answer") };
    assert!(project::alike(answer, &documented, PRINTED), "{answer}");
}
