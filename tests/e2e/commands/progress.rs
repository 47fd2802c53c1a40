//! What long commands tell while they are at it, and what they keep when they are interrupted.

use std::io::{BufRead as _, BufReader, Read as _};
use std::path::Path;
use std::process::{Child, Command, Stdio};

use rustix::process::{Pid, Signal, kill_process};

use crate::PALPATE;
use crate::screen::Terminal;

/// A table of eight rows; so many cases a row take longer than a line of progress waits.
const TABLE: [&str; 4] = ["tables", "2-noise", "--cases", "3000"];

/// What Ctrl-C sends.
pub(super) fn interrupt(child: &Child) {
    kill_process(Pid::from_child(child), Signal::INT).unwrap();
}

#[test]
fn rows_are_printed_as_they_are_done_and_an_interruption_keeps_them() {
    let mut command = Command::new(PALPATE);
    let mut child =
        command.args(TABLE).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let mut lines = BufReader::new(child.stdout.take().unwrap()).lines().map(Result::unwrap);
    // The first row is there while the others are made.
    let first = lines.by_ref().find(|line| line.starts_with("0.1 ")).unwrap();
    assert!(first.contains(" 3000 "), "{first}");
    interrupt(&child);
    let rest: Vec<_> = lines.collect();
    // The columns that did not fit beside the others come too, for the rows that are done.
    let headings = rest.iter().position(|line| line.starts_with("sigma deg") && line.ends_with("sd angle deg"));
    let (more, others) = rest.split_at(headings.unwrap_or_else(|| panic!("{rest:?}")));
    let rows = |lines: &[String]| lines.iter().filter(|line| line.starts_with("0.")).count();
    let done = 1 + rows(more);
    assert_eq!(rows(others), done, "{rest:?}");
    assert!(done < 8, "it was not interrupted");
    let mut told = String::new();
    child.stderr.take().unwrap().read_to_string(&mut told).unwrap();
    let plural = if done == 1 { "" } else { "s" };
    // Nothing else: a pipe has no line of progress.
    assert_eq!(told, format!("interrupted: {done} finished row{plural} of table 2-noise\n"));
    assert_eq!(child.wait().unwrap().code(), Some(130));
}

#[test]
fn a_program_is_told_that_its_object_is_of_an_interrupted_table() {
    let mut command = Command::new(PALPATE);
    command.args(TABLE).args(["--json", "-v"]).stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut child = command.spawn().unwrap();
    // With -v each row is told also where nobody looks.
    let mut told = BufReader::new(child.stderr.take().unwrap()).lines().map(Result::unwrap);
    told.by_ref().find(|line| line.starts_with("info: row 1: ")).unwrap();
    interrupt(&child);
    told.for_each(drop);
    let output = child.wait_with_output().unwrap();
    let object: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(object["interrupted"], true);
    let rows = object["result"]["rows"].as_array().unwrap();
    assert!((1..8).contains(&rows.len()) && rows[0]["tests"] == 3000, "{object}");
    assert_eq!(output.status.code(), Some(130));
}

#[test]
fn a_terminal_shows_how_far_it_is_and_quiet_shows_nothing() {
    // A table that counts its cases.
    let mut terminal = Terminal::run(Path::new("."), &["tables", "pose", "--cases", "3000"]);
    terminal.wait_until_seen("row 1, cases: ");
    terminal.wait_until_seen(" of 3000 in");
    terminal.kill();
    let words = [&TABLE[..], &["-q", "--seed", "2"]].concat();
    let mut terminal = Terminal::run(Path::new("."), &words);
    // Its first row is later than a line of progress would be.
    terminal.wait_until_seen("0.1 ");
    assert!(!terminal.seen().contains("cases "), "{}", terminal.seen());
    terminal.kill();
}

#[test]
fn the_list_of_tables_says_how_long_they_take() {
    let list = |words: &[&str]| String::from_utf8(Command::new(PALPATE).args(words).output().unwrap().stdout).unwrap();
    let listed = list(&["tables", "--list"]);
    assert_eq!(listed, list(&["tables"]));
    // However a title is broken: every table's entry ends with its time.
    let entries = listed.split_whitespace().collect::<Vec<_>>().join(" ");
    let timed = ["seconds)", "s)", "min)", "h)"].map(|unit| entries.matches(&format!(" {unit}")).count());
    assert_eq!(
        timed.iter().sum::<usize>(),
        entries.matches(" cases, ").count() + entries.matches(" case, ").count(),
        "{listed}"
    );
    assert!(timed.iter().sum::<usize>() > 30, "{listed}");
}
