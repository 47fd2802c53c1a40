//! What commands print, on a terminal of eighty columns; their help is in `help`.

use std::io::Write as _;
use std::process::{Command, Output, Stdio};

use palpate_tests::project;

use crate::PALPATE;

/// The narrowest terminal that is still common.
const COLUMNS: usize = 80;

fn palpate(words: &[&str], input: &str) -> Output {
    let mut palpate = Command::new(PALPATE);
    palpate.args(words).current_dir(project::folder()).env_remove("PALPATE_DEVICE").env_remove("PALPATE_CALIBRATION");
    let mut child = palpate.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    child.stdin.take().unwrap().write_all(input.as_bytes()).unwrap();
    child.wait_with_output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

#[test]
fn tables_and_sentences_fit_a_terminal() {
    let commands = [
        "push examples/part.toml --edge 0 --speed-mm-s 50",
        "inscribe examples/part.toml --views examples/views.toml --resolve",
        "sample examples/scene.toml",
        "corner examples/part.toml --sample",
        "roll examples/pebble.toml",
        "tables",
        "tables 2.1 --cases 3",
        "tables 2-noise --cases 2",
    ];
    for command in commands {
        let words: Vec<_> = command.split(' ').collect();
        let output = palpate(&words, "");
        let said = text(&output.stdout);
        assert!(output.status.success() && said.lines().count() > 1, "`palpate {command}`: {}", text(&output.stderr));
        for line in said.lines() {
            let width = line.chars().count();
            assert!(width <= COLUMNS, "`palpate {command}` has {width} columns: {line}");
        }
    }
}

/// Turns are told from −180° to 180° everywhere.
#[test]
fn turns_of_a_part_in_a_corner_are_half_a_turn_at_most() {
    let said = text(&palpate(&["corner", "examples/part.toml"], "").stdout);
    let turns: Vec<f64> =
        said.lines().skip(2).map(|line| line.split_whitespace().nth(3).unwrap().parse().unwrap()).collect();
    assert!(turns.len() > 3 && turns.iter().all(|turn| (-180.0..=180.0).contains(turn)), "{said}");
    assert!(turns.iter().any(|turn| *turn < 0.0), "{said}");
}

/// How far a table is shows on terminals; whoever wants it in a pipe says so.
#[test]
fn a_table_tells_of_its_rows_in_a_pipe_only_if_it_is_asked() {
    let told = |more: &[&str]| text(&palpate(&[&["tables", "2.1", "--cases", "3"], more].concat(), "").stderr);
    assert_eq!((told(&[]), told(&["-q"])), (String::new(), String::new()));
    assert!(told(&["-v"]).contains("info: row 1: "), "{}", told(&["-v"]));
}

/// One line in a stream that nobody can use is named, and the others are answered.
#[test]
fn palm_goes_on_after_a_bad_line() {
    let contacts = "{\"t\": 0.002, \"u\": [0.001, 0.0]}\nnonsense\n[0.004]\n{\"t\": 0.001, \"u\": [0.001, 0.0]}\n\
                    {\"t\": 0.004, \"u\": [0.0011, 0.0]}\n";
    let long = format!("{contacts}{}\n{{\"t\": 0.006, \"u\": [0.0012, 0.0]}}\n", "x".repeat(3 << 20));
    let output = palpate(&["palm", "examples/pebble.toml"], &long);
    let (answers, told) = (text(&output.stdout), text(&output.stderr));
    assert_eq!(output.status.code(), Some(2), "{told}");
    assert_eq!(answers.lines().count(), 3, "{answers}");
    for wanted in [
        "line 2 is passed over",
        "line 3 is passed over",
        "expected an object with t and u",
        "line 4 is passed over",
        "not come after",
        "line 6 is passed over: it is longer than 1 MiB",
        "4 lines passed over",
    ] {
        assert!(told.contains(wanted), "`{wanted}` in:\n{told}");
    }
}
