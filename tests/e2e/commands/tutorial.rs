//! The pages of the tutorial: every command in them runs, and prints what they quote.
//!
//! A block marked `sh` has commands, one a line. A block marked `text` behind it quotes lines of what they print; spaces
//! between words do not count. A picture in `pictures` is what a command of its page draws.

use std::fs::File;
use std::path::Path;
use std::process::{Command, Stdio};

use palpate_tests::project;

use crate::PALPATE;

/// Pages by chapter.
const PAGES: [&str; 8] = [
    "README.md",
    "inscription.md",
    "point-sampling.md",
    "touching.md",
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

/// What a command prints. DIR is the page's folder; `> FILE` keeps what is printed there, `< FILE` is read.
fn run(command: &str, folder: &Path) -> String {
    let told = command.strip_prefix("palpate ").unwrap_or_else(|| panic!("`{command}` is no command of ours"));
    let mut words: Vec<_> = told.split(' ').map(|word| word.replace("DIR", &folder.display().to_string())).collect();
    let mut behind = |mark: &str| {
        let place = words.iter().position(|word| word == mark)?;
        words.drain(place..place + 2).next_back()
    };
    let (kept, read) = (behind(">"), behind("<"));
    let input = read.map_or_else(Stdio::null, |file| {
        File::open(project::folder().join(&file)).unwrap_or_else(|error| panic!("{file}: {error}")).into()
    });
    let output = Command::new(PALPATE)
        .args(&words)
        .current_dir(project::folder())
        .env_remove("PALPATE_DEVICE")
        .env_remove("PALPATE_CALIBRATION")
        .stdin(input)
        .output()
        .unwrap();
    assert!(output.status.success(), "`{command}`: {}", String::from_utf8_lossy(&output.stderr));
    if let Some(file) = kept {
        std::fs::write(file, &output.stdout).unwrap();
    }
    String::from_utf8(output.stdout).unwrap()
}

/// Runs every command of a page, and holds what they print against what it quotes and what they draw against its
/// pictures: so many commands, lines and pictures.
fn follow(page: &str) -> [usize; 3] {
    let pages = project::folder().join("docs/tutorial");
    let text = std::fs::read_to_string(pages.join(page)).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let (mut last, mut counts) = (String::new(), [0; 3]);
    for block in blocks(&text) {
        match block.mark.as_str() {
            "sh" => {
                last = block.lines.iter().map(|line| run(line, folder.path())).collect::<Vec<_>>().join("\n");
                counts[0] += block.lines.len();
            }
            "text" => {
                let lines: Vec<_> = last.lines().map(words).collect();
                for line in block.lines.iter().map(|line| words(line)).filter(|line| !line.is_empty()) {
                    assert!(lines.contains(&line), "{page} quotes `{line}`; printed:\n{last}");
                    counts[1] += 1;
                }
            }
            mark => panic!("{page}: a block marked `{mark}` is neither `sh` nor `text`"),
        }
    }
    for file in text.split("](pictures/").skip(1).filter_map(|rest| rest.split_once(')')).map(|(file, _)| file) {
        let drawn = std::fs::read_to_string(folder.path().join(file));
        let drawn = drawn.unwrap_or_else(|error| panic!("{page}: no command draws {file}: {error}"));
        let kept = std::fs::read_to_string(pages.join("pictures").join(file)).unwrap();
        assert!(drawn_alike(&kept, &drawn), "{page} draws another {file}: keep that one");
        counts[2] += 1;
    }
    counts
}

#[test]
fn every_command_of_the_tutorial_prints_and_draws_what_its_page_shows() {
    let counts = PAGES.map(follow);
    let [commands, quoted, pictures] = [0, 1, 2].map(|kind| counts.iter().map(|counts| counts[kind]).sum::<usize>());
    assert!(commands >= 20 && quoted >= 12, "{commands} commands, {quoted} lines quoted");
    let kept = std::fs::read_dir(project::folder().join("docs/tutorial/pictures")).unwrap().count();
    assert!(pictures == kept && pictures >= 10, "{pictures} of {kept} pictures are shown");
}

/// Whether two drawings are one but for rounding: numbers to a fifth of a page unit, all else to the letter.
fn drawn_alike(a: &str, b: &str) -> bool {
    let near = |a: f64, b: f64| (a - b).abs() <= 0.2;
    project::texts_alike(a, b, |a, b| a.parse().ok().zip(b.parse().ok()).is_some_and(|(a, b)| near(a, b)))
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
