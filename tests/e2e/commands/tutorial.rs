//! The pages of the tutorial: every command in them runs, and prints what they quote.
//!
//! A block marked `sh` has commands, one a line. A block marked `text` behind it quotes lines of what they print; spaces
//! between words do not count. A picture in `pictures` is what a command of its page draws.

use std::path::{Path, PathBuf};
use std::process::Command;

use palpate_tests::project;

use crate::PALPATE;

/// Pages by chapter.
const PAGES: [&str; 7] = [
    "README.md",
    "inscription.md",
    "point-sampling.md",
    "observability.md",
    "pushing.md",
    "observers.md",
    "rolling.md",
];

/// One block of code with what it is marked as.
struct Block {
    mark: String,
    lines: Vec<String>,
}

fn blocks(page: &str) -> Vec<Block> {
    let (mut blocks, mut open): (Vec<Block>, Option<Block>) = (Vec::new(), None);
    for line in page.lines() {
        match (line.strip_prefix("```"), open.take()) {
            (Some(_), Some(block)) => blocks.push(block),
            (Some(mark), None) => open = Some(Block { mark: mark.to_owned(), lines: Vec::new() }),
            (None, Some(mut block)) => {
                block.lines.push(line.to_owned());
                open = Some(block);
            }
            (None, None) => {}
        }
    }
    blocks
}

fn words(line: &str) -> String {
    line.split_whitespace().collect::<Vec<_>>().join(" ")
}

/// What a command prints. Pictures go where nobody keeps them.
fn printed(command: &str) -> String {
    let folder: PathBuf = std::env::temp_dir().join(format!("palpate-tutorial-{}", std::process::id()));
    let text = run(command, &folder);
    let _ = std::fs::remove_dir_all(&folder);
    text
}

/// What a command prints that draws into a folder.
fn run(command: &str, folder: &Path) -> String {
    let told = command.strip_prefix("palpate ").unwrap_or_else(|| panic!("`{command}` is no command of ours"));
    let arguments =
        told.split(' ').map(|word| if word == "DIR" { folder.display().to_string() } else { word.to_owned() });
    let output = Command::new(PALPATE)
        .args(arguments)
        .current_dir(project::folder())
        .env_remove("PALPATE_DEVICE")
        .env_remove("PALPATE_CALIBRATION")
        .output()
        .unwrap();
    assert!(output.status.success(), "`{command}`: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn every_command_of_the_tutorial_prints_what_its_page_quotes() {
    let (mut commands, mut quoted) = (0, 0);
    for page in PAGES {
        let text = std::fs::read_to_string(project::folder().join("docs/tutorial").join(page)).unwrap();
        let mut last = String::new();
        for block in blocks(&text) {
            match block.mark.as_str() {
                "sh" => {
                    last = block.lines.iter().map(|command| printed(command)).collect::<Vec<_>>().join("\n");
                    commands += block.lines.len();
                }
                "text" => {
                    let lines: Vec<_> = last.lines().map(words).collect();
                    for line in block.lines.iter().map(|line| words(line)).filter(|line| !line.is_empty()) {
                        assert!(lines.contains(&line), "{page} quotes `{line}`; printed:\n{last}");
                        quoted += 1;
                    }
                }
                mark => panic!("{page}: a block marked `{mark}` is neither `sh` nor `text`"),
            }
        }
    }
    assert!(commands >= 15 && quoted >= 9, "{commands} commands, {quoted} lines quoted");
}

/// Whether two drawings are one but for rounding: numbers to a fifth of a page unit, all else to the letter.
fn drawn_alike(a: &str, b: &str) -> bool {
    let is_numeric = |c: char| c.is_ascii_digit() || c == '.' || c == '-';
    let tokens = |text: &str| -> Vec<(bool, String)> {
        let mut tokens: Vec<(bool, String)> = Vec::new();
        for c in text.chars() {
            match tokens.last_mut() {
                Some((numeric, token)) if *numeric == is_numeric(c) => token.push(c),
                _ => tokens.push((is_numeric(c), c.to_string())),
            }
        }
        tokens
    };
    let (a, b) = (tokens(a), tokens(b));
    let near =
        |a: &str, b: &str| a.parse::<f64>().ok().zip(b.parse::<f64>().ok()).is_some_and(|(a, b)| (a - b).abs() <= 0.2);
    a.len() == b.len()
        && a.iter().zip(&b).all(|((kind, a), (other, b))| kind == other && (a == b || *kind && near(a, b)))
}

#[test]
fn every_picture_of_the_tutorial_is_what_a_command_of_its_page_draws() {
    let mut compared = 0;
    let pages = project::folder().join("docs/tutorial");
    for page in PAGES {
        let text = std::fs::read_to_string(pages.join(page)).unwrap();
        for name in text.split("](pictures/").skip(1).filter_map(|rest| rest.split_once(".svg)")).map(|(name, _)| name)
        {
            let command = text.lines().find(|line| line.starts_with(&format!("palpate tables {name} ")));
            let command = command.unwrap_or_else(|| panic!("{page}: no command draws {name}"));
            let folder = tempfile::tempdir().unwrap();
            run(command, folder.path());
            let file = format!("{name}.svg");
            let drawn = std::fs::read_to_string(folder.path().join(&file)).unwrap();
            let kept = std::fs::read_to_string(pages.join("pictures").join(&file)).unwrap();
            assert!(drawn_alike(&kept, &drawn), "{page}: `{command}` draws another {file}: keep that one");
            compared += 1;
        }
    }
    let kept = std::fs::read_dir(pages.join("pictures")).unwrap().count();
    assert!(compared == kept && compared >= 6, "{compared} of {kept} pictures are shown");
}

#[test]
fn drawings_are_alike_to_a_fifth_of_a_unit() {
    assert!(drawn_alike("<path d=\"M1.0 2\"/>", "<path d=\"M1.1 2\"/>"));
    assert!(!drawn_alike("<path d=\"M1.0 2\"/>", "<path d=\"M1.3 2\"/>"));
    assert!(!drawn_alike("<path d=\"M1.0 2\"/>", "<text d=\"M1.0 2\"/>"));
}

#[test]
fn a_page_falls_into_its_blocks() {
    let found = blocks("a\n```sh\npalpate x\n```\nb\n```text\n1  2\n```\n");
    assert_eq!(
        found.iter().map(|block| (block.mark.as_str(), block.lines.len())).collect::<Vec<_>>(),
        [("sh", 1), ("text", 1)]
    );
}
