//! `palpate solve` as a process: pipes, exit statuses, streaming.

use std::io::{BufRead, BufReader, Read, Write};
use std::process::{Child, Command, Output, Stdio};
use std::thread;

use palpate_tests::project::reference_cases;
use serde_json::{Value, json};

use crate::PALPATE;

const EXIT_UNREADABLE: i32 = 1;
const EXIT_SOME_FAILED: i32 = 2;
const EXIT_USAGE: i32 = 64;

fn palpate(arguments: &[&str]) -> Command {
    let mut command = Command::new(PALPATE);
    command.args(arguments).stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn solve(arguments: &[&str], input: &[u8]) -> Output {
    let mut child = palpate(&[&["solve"], arguments].concat()).spawn().unwrap();
    let (mut stdin, input) = (child.stdin.take().unwrap(), input.to_vec());
    let feeder = thread::spawn(move || {
        // A wrong command line ends the process before it reads.
        let _ = stdin.write_all(&input);
    });
    let output = child.wait_with_output().unwrap();
    feeder.join().unwrap();
    output
}

fn answers(output: &Output) -> Vec<Value> {
    let text = std::str::from_utf8(&output.stdout).unwrap();
    assert!(text.is_empty() || text.ends_with('\n'), "{text}");
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

fn stderr(output: &Output) -> String {
    let text = String::from_utf8(output.stderr.clone()).unwrap();
    assert!(!text.contains("panicked"), "{text}");
    text
}

/// The code of every answer with its line.
fn codes(output: &Output) -> Vec<(u64, String)> {
    let code =
        |answer: &Value| (answer["line"].as_u64().unwrap(), answer["error"]["code"].as_str().unwrap().to_owned());
    answers(output).iter().map(code).collect()
}

#[test]
fn an_unknown_kind_is_an_error_of_its_line() {
    let output = solve(&["-"], b"{\"problem\": \"fly\", \"id\": [7]}\n");
    assert_eq!(output.status.code(), Some(EXIT_SOME_FAILED));
    let [answer] = &answers(&output)[..] else { panic!("{output:?}") };
    assert_eq!((&answer["id"], &answer["line"]), (&json!([7]), &json!(1)));
    assert_eq!((&answer["error"]["code"], &answer["error"]["field"]), (&json!("unknown_problem"), &json!("/problem")));
    assert_eq!(stderr(&output), "");
}

#[test]
fn every_sort_of_line_is_answered_in_order() {
    let mut input = b"\xef\xbb\xbf{\"problem\":\"fly\"}\r\n\r\n \t\n{\"problem\":\xff}\n".to_vec();
    input.extend(format!("{{\"id\":1,\"a\":{}}}\n", "[".repeat(200) + &"]".repeat(200)).bytes());
    input.extend(b"42\nNaN\n{\"problem\":\"fly\",\"x\":1e999}\n{\"problem\":\"fly\"}".iter());
    for jobs in ["1", "3"] {
        let output = solve(&["--jobs", jobs], &input);
        let expected = [
            (1, "unknown_problem"),
            (4, "invalid_json"),
            (5, "invalid_json"),
            (6, "invalid_input"),
            (7, "invalid_json"),
            (8, "invalid_json"),
            (9, "unknown_problem"),
        ];
        assert_eq!(codes(&output), expected.map(|(line, code)| (line, code.to_owned())));
        assert_eq!(output.status.code(), Some(EXIT_SOME_FAILED));
        assert_eq!(stderr(&output), "");
    }
}

#[test]
fn nothing_to_answer_is_success() {
    for input in [&b""[..], b"\n", b"\n  \n\t\r\n\n", b"\xef\xbb\xbf"] {
        let output = solve(&[], input);
        assert_eq!((output.status.code(), output.stdout.len()), (Some(0), 0), "{input:?}");
    }
}

#[test]
fn a_hundred_thousand_lines_stay_in_order() {
    const LINES: u64 = 100_000;
    let input: String = (1..=LINES).map(|i| format!("{{\"problem\":\"fly\",\"id\":{i}}}\n")).collect();
    let output = solve(&["--jobs", "2"], input.as_bytes());
    let answers = answers(&output);
    assert_eq!(answers.len() as u64, LINES);
    for (answer, i) in answers.iter().zip(1..) {
        assert_eq!((&answer["id"], &answer["line"]), (&json!(i), &json!(i)));
    }
}

fn start(arguments: &[&str]) -> Child {
    palpate(&[&["solve"], arguments].concat()).spawn().unwrap()
}

#[test]
fn an_answer_comes_before_the_next_line_is_sent() {
    for jobs in ["1", "2", "8"] {
        let mut child = start(&["-", "--jobs", jobs]);
        let mut stdin = child.stdin.take().unwrap();
        let mut stdout = BufReader::new(child.stdout.take().unwrap());
        for i in 1..=3 {
            writeln!(stdin, "{{\"problem\":\"fly\",\"id\":{i}}}").unwrap();
            let mut answer = String::new();
            // Hangs here if the answer waits for more input.
            stdout.read_line(&mut answer).unwrap();
            assert_eq!(serde_json::from_str::<Value>(&answer).unwrap()["id"], json!(i));
        }
        drop(stdin);
        assert_eq!(stdout.read_to_end(&mut Vec::new()).unwrap(), 0);
        assert_eq!(child.wait().unwrap().code(), Some(EXIT_SOME_FAILED));
    }
}

#[test]
fn a_closed_output_ends_the_run_though_the_input_stays_open() {
    let mut child = start(&["--jobs", "2"]);
    let mut stdin = child.stdin.take().unwrap();
    drop(child.stdout.take());
    stdin.write_all(b"{\"problem\":\"fly\"}\n").unwrap();
    // The input is still open, so a run that only ends with its input hangs here.
    let status = child.wait().unwrap();
    drop(stdin);
    assert!(status.code().is_some(), "ended by a signal: {status}");
    let mut said = String::new();
    child.stderr.take().unwrap().read_to_string(&mut said).unwrap();
    assert_eq!(said, "");
}

#[test]
fn a_file_is_read_as_standard_input_is() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("problems.jsonl");
    std::fs::write(&file, "{\"problem\":\"fly\",\"id\":\"a\"}\n").unwrap();
    let output = solve(&[file.to_str().unwrap()], b"");
    assert_eq!(answers(&output)[0]["id"], json!("a"));
    assert_eq!(output.status.code(), Some(EXIT_SOME_FAILED));
}

#[test]
fn input_that_cannot_be_read_is_told_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let missing = folder.path().join("missing.jsonl");
    for path in [missing.as_path(), folder.path()] {
        let output = solve(&[path.to_str().unwrap()], b"");
        assert_eq!((output.status.code(), output.stdout.len()), (Some(EXIT_UNREADABLE), 0), "{}", path.display());
        let name = path.file_name().unwrap().to_str().unwrap();
        let said: String = stderr(&output).split_whitespace().collect();
        assert!(said.contains(&name[..4]) && said.contains("cannot"), "{said}");
    }
}

#[test]
fn a_wrong_command_line_has_its_own_status() {
    let wrong: [&[&str]; 7] = [
        &["--no-such-option"],
        &["--jobs", "0"],
        &["--jobs", "many"],
        &["--jobs", "1000000"],
        &["a.jsonl", "b.jsonl"],
        &["--schema", "fly"],
        &["--schema", "--jobs", "2"],
    ];
    for arguments in wrong {
        let output = solve(arguments, b"");
        assert_eq!((output.status.code(), output.stdout.len()), (Some(EXIT_USAGE), 0), "{arguments:?}");
        assert!(stderr(&output).contains("error"), "{arguments:?}");
    }
}

#[test]
fn the_schema_describes_the_error_that_is_printed() {
    let schema = &answers_of_schema();
    let error = &answers(&solve(&[], b"x\n"))[0];
    let required = schema["error"]["required"].as_array().unwrap();
    assert_eq!(required.len(), error.as_object().unwrap().len());
    assert!(required.iter().all(|name| error.get(name.as_str().unwrap()).is_some()), "{required:?} of {error}");
    assert!(schema["kinds"].is_object() && schema["problem"].is_object(), "{schema}");
}

fn answers_of_schema() -> Value {
    let output = solve(&["--schema"], b"");
    assert_eq!(output.status.code(), Some(0));
    serde_json::from_slice(&output.stdout).unwrap()
}

#[test]
fn the_help_shows_the_interface() {
    let output = solve(&["--help"], b"");
    let text = String::from_utf8(output.stdout).unwrap();
    for word in ["JSON Lines", "unknown_problem", "--jobs", "--schema", "Exit status", "Kinds:"] {
        assert!(text.contains(word), "{word} is not in\n{text}");
    }
}

/// Malformed lines kept beside the project. What they expect of a kind that is not built in is left out, and told.
#[test]
fn malformed_reference_lines_get_the_errors_they_should() {
    let Some(cases) = reference_cases("bad") else { return };
    let lines: Vec<_> = cases.iter().map(|case| case["line"].as_str().unwrap()).collect();
    let output = solve(&["--jobs", "2"], lines.join("\n").as_bytes());
    let schema = answers_of_schema();
    let mut answers = answers(&output).into_iter();
    let mut left_out = 0;
    for (case, number) in cases.iter().zip(1_u64..).filter(|(case, _)| !case["expected"].is_null()) {
        let answer = answers.next().unwrap();
        let problem = serde_json::from_str::<Value>(case["line"].as_str().unwrap()).unwrap_or_default();
        assert_eq!(answer["id"], *problem.get("id").unwrap_or(&Value::Null), "{case}");
        match problem["problem"].as_str().is_none_or(|kind| schema["kinds"].get(kind).is_some()) {
            true => check_answer(&case["expected"], &answer, number),
            false => {
                left_out += 1;
                assert_eq!(answer["error"]["code"], json!("unknown_problem"), "{answer}");
            }
        }
    }
    assert!(answers.next().is_none() && left_out < cases.len());
    eprintln!("{left_out} of {} reference lines are of kinds that are not built in", cases.len());
}

fn check_answer(expected: &Value, answer: &Value, number: u64) {
    let codes = expected["error"].as_array();
    let Some(error) = answer.get("error") else {
        assert!(codes.is_none() || expected["either"] == json!(true), "{answer}");
        return;
    };
    assert!(codes.is_some_and(|codes| codes.contains(&error["code"])), "{expected}: {answer}");
    assert_eq!(answer["line"], json!(number));
    let message = error["message"].as_str().unwrap();
    assert!((1..=2000).contains(&message.chars().count()), "{message}");
    for name in expected["names"].as_array().unwrap() {
        let any = name.as_array().cloned().unwrap_or_else(|| vec![name.clone()]);
        assert!(any.iter().any(|name| message.contains(name.as_str().unwrap())), "{any:?}: {answer}");
    }
}
