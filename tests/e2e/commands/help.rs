//! The help of every command on a terminal of eighty columns: nothing too wide, and prose breaks at the margin only.

use std::process::{Command, Stdio};

use crate::PALPATE;

/// The narrowest terminal that is still common.
const COLUMNS: usize = 80;

/// Where prose stands that clap lays out: at the margin, and at this column below an option. At others are the rows of
/// lists, files and command lines, which stand as they were written.
const OPTION_TEXT: usize = 10;

fn help(words: &[&str]) -> String {
    let mut palpate = Command::new(PALPATE);
    palpate.args(words).env("COLUMNS", COLUMNS.to_string()).stdin(Stdio::null());
    let output = palpate.output().unwrap();
    assert!(output.status.success(), "{words:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// The commands that the tool lists, under whichever heading.
fn commands() -> Vec<String> {
    let text = help(&["--help"]);
    let listed = text.lines().skip_while(|line| !line.starts_with("Usage: ")).take_while(|line| *line != "Options:");
    let rows = listed.filter_map(|line| line.strip_prefix("  ").filter(|row| !row.starts_with(' ')));
    rows.filter_map(|row| row.split_whitespace().next()).map(str::to_owned).collect()
}

/// Every help text and the words that ask for it.
fn pages() -> Vec<(String, String)> {
    let commands = commands();
    let of_commands = commands.iter().flat_map(|command| [vec![command.as_str(), "-h"], vec![command, "--help"]]);
    let asked = of_commands.filter(|words| words[0] != "help").chain([vec!["-h"], vec!["--help"]]);
    asked.map(|words| (words.join(" "), help(&words))).collect()
}

fn width(line: &str) -> usize {
    line.chars().count()
}

fn indent(line: &str) -> usize {
    line.len() - line.trim_start().len()
}

/// Whether a line ends before the margin although the first word of the next, in the same paragraph, had room on it.
fn is_ragged(line: &str, next: &str) -> bool {
    let is_prose = indent(line) == 0 || indent(line) == OPTION_TEXT;
    let goes_on = !line.trim().is_empty() && indent(line) == indent(next);
    let begins_anew = next.trim_start().starts_with(['-', '[']) || line.trim_start().starts_with('-');
    let first = next.split_whitespace().next().map_or(COLUMNS, width);
    is_prose && goes_on && !begins_anew && width(line) + 1 + first <= COLUMNS
}

#[test]
fn no_help_is_wider_than_the_terminal() {
    let pages = pages();
    assert!(pages.len() > 30, "the commands are not found in the help");
    for (words, text) in pages {
        // How a command is called is one line, which clap does not break.
        for line in text.lines().filter(|line| !line.starts_with("Usage: ")) {
            assert!(width(line) <= COLUMNS, "`palpate {words}` has {} columns: {line}", width(line));
        }
    }
}

#[test]
fn prose_in_help_breaks_at_the_margin_only() {
    for (words, text) in pages() {
        let lines: Vec<_> = text.lines().collect();
        for pair in lines.windows(2) {
            assert!(!is_ragged(pair[0], pair[1]), "`palpate {words}` breaks early:\n{}\n{}", pair[0], pair[1]);
        }
    }
}

/// What a group of options holds stands under its heading in every command, and nothing else does.
#[test]
fn options_stand_under_the_headings_that_they_belong_to() {
    let groups: [(&str, &[&str]); 3] = [
        ("Device:", &["--device", "--baud", "--speed"]),
        // Of `palm`, which has no device, a recording stands in for it.
        ("Recording:", &["--record", "--full", "--device", "--speed"]),
        ("Calibration:", &["--calibration"]),
    ];
    let mut found = 0;
    for command in commands() {
        let text = help(&[&command, "-h"]);
        let mut heading = "";
        for line in text.lines() {
            if indent(line) == 0 && !line.is_empty() {
                heading = line;
            }
            let Some((_, members)) = groups.iter().find(|(group, _)| *group == heading) else { continue };
            let option = line.split_whitespace().find(|word| word.starts_with("--"));
            let option = option.filter(|_| line.trim_start().starts_with('-'));
            assert!(option.is_none_or(|option| members.contains(&option)), "`palpate {command} -h`: {heading} {line}");
            found += usize::from(option.is_some());
        }
    }
    assert!(found > 60, "{found} options under these headings");
}

/// A row of a file or a table that is broken is no row any more: clap would set its rest at the row's own indent.
#[test]
fn rows_of_files_and_tables_are_whole() {
    for file in ["inscribe", "observe", "palm", "plan-push", "push", "roll", "sample", "solve"] {
        let wide = Command::new(PALPATE).args([file, "--help"]).env("COLUMNS", "400").output().unwrap();
        let rows = |text: &str| text.lines().filter(|line| indent(line) > 0).map(str::to_owned).collect::<Vec<_>>();
        let after = |text: &str| text.rsplit_once("Tell nothing on standard error").unwrap().1.to_owned();
        let wide = String::from_utf8(wide.stdout).unwrap();
        assert_eq!(rows(&after(&help(&[file, "--help"]))), rows(&after(&wide)), "{file}");
    }
}

#[test]
fn a_break_by_hand_is_found() {
    let broken = "Prints where the part may be, how certain that is, and what cannot be told";
    assert!(is_ragged("and optionally an", "\"id\" of any JSON value"));
    assert!(!is_ragged(broken, "apart, as it changes"));
    assert!(!is_ragged("  vertices = [[0, 0]]", "  mu = 0.25"));
}
