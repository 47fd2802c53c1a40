//! Bounded fuzzing on stable Rust: mutations of a kept corpus, against the laws in `palpate_tests::fuzz`.
//!
//! The seed is fixed, so that a failure repeats; it prints the bytes that broke the law. `PALPATE_FUZZ_SEEDS=2000` adds as
//! many seeds of the moment, with fewer mutations each. For an unbounded search with
//! coverage, see `fuzz/`. A file that libFuzzer finds goes into the corpus.

use std::fs;
use std::path::PathBuf;

use palpate::math::random::Draw;
use palpate_tests::project;

/// Mutations of each target of bytes: some seconds in all.
const MUTATIONS: usize = 20_000;

/// Of each target of text, which costs more: some seconds in all.
const MUTATIONS_OF_TEXT: usize = 4_000;

/// Longest input, in bytes: several frames.
const INPUT_MAX: usize = 1200;

/// The same for text: a short file.
const TEXT_MAX: usize = 6000;

/// Bytes that mean something to a device: delimiter, full groups, small codes.
const TELLING: &[u8] = &[0, 0, 0xFF, 0xFE, 1, 2, 0x80, 0x7F];

/// Letters that mean something in files.
const TELLING_IN_TEXT: &[u8] = b"0019-.eE[]{}\"',;:=# \n\t_\xc3";

fn corpus(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = project::folder().join("tests/golden/fuzz").join(target);
    let mut files: Vec<PathBuf> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 8, "the corpus in {} is kept", folder.display());
    files.into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

/// Random numbers for mutations, and the bytes that mean something.
struct Random(Draw, &'static [u8]);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0.index(limit)
    }

    fn byte(&mut self) -> u8 {
        // Half of the time one that means something.
        match self.below(2) {
            0 => self.1[self.below(self.1.len())],
            _ => self.0.bits().to_le_bytes()[0],
        }
    }

    /// One change to `bytes`, or a piece of `other` let in.
    fn mutate(&mut self, bytes: &mut Vec<u8>, other: &[u8]) {
        let at = self.below(bytes.len() + 1);
        let end = (at + 1 + self.below(16)).min(bytes.len());
        match self.below(6) {
            0 if at < bytes.len() => bytes[at] ^= 1_u8 << self.below(8),
            1 if at < bytes.len() => bytes[at] = self.byte(),
            2 => bytes.insert(at, self.byte()),
            3 if at < end => drop(bytes.drain(at..end)),
            4 if at < end => {
                let again = bytes[at..end].to_vec();
                bytes.splice(at..at, again);
            }
            _ => {
                let from = self.below(other.len());
                let to = from + self.below(other.len() - from + 1);
                bytes.splice(at..at, other[from..to].iter().copied());
            }
        }
    }
}

fn fuzz(target: &str, law: fn(&[u8])) {
    fuzz_with(target, law, MUTATIONS, INPUT_MAX, TELLING);
}

fn fuzz_text(target: &str, law: fn(&[u8])) {
    fuzz_with(target, law, MUTATIONS_OF_TEXT, TEXT_MAX, TELLING_IN_TEXT);
}

fn fuzz_with(target: &str, law: fn(&[u8]), mutations: usize, input_max: usize, telling: &'static [u8]) {
    let corpus = corpus(target);
    for (path, bytes) in &corpus {
        eprintln!("{}", path.display());
        law(bytes);
    }
    let search = |draw: Draw, mutations: usize| {
        let mut random = Random(draw, telling);
        mutated(&corpus, &mut random, mutations, input_max, law);
    };
    search(Draw::new(0x7061_6c70_6174_6521), mutations);
    if let Some(seeds) = std::env::var("PALPATE_FUZZ_SEEDS").ok().and_then(|seeds| seeds.parse::<usize>().ok()) {
        let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs();
        (0..seeds).for_each(|seed| search(Draw::case(now, seed), mutations / FRESH_SHARE));
        println!("{target}: {seeds} seeds of {now} with {} mutations each", mutations / FRESH_SHARE);
    }
}

/// One in so many mutations is enough of each fresh seed.
const FRESH_SHARE: usize = 200;

/// Holds a law to mutations of a corpus.
fn mutated(corpus: &[(PathBuf, Vec<u8>)], random: &mut Random, mutations: usize, input_max: usize, law: fn(&[u8])) {
    for _ in 0..mutations {
        let mut bytes = corpus[random.below(corpus.len())].1.clone();
        let other = &corpus[random.below(corpus.len())].1;
        for _ in 0..=random.below(6) {
            random.mutate(&mut bytes, other);
        }
        bytes.truncate(input_max);
        // Not caught: the bytes are printed and the test fails where the law does.
        let shown = Shown(&bytes);
        law(&bytes);
        std::mem::forget(shown);
    }
}

/// Prints the input if the law that looks at it panics.
struct Shown<'a>(&'a [u8]);

impl Drop for Shown<'_> {
    fn drop(&mut self) {
        eprintln!("the input was {:02x?}: {:?}", self.0, String::from_utf8_lossy(self.0));
    }
}

#[test]
fn no_bytes_from_a_device_mislead_the_decoder() {
    fuzz("decoder", palpate_tests::fuzz::decoder);
}

#[test]
fn no_bytes_from_a_host_mislead_the_firmware() {
    fuzz("commands", palpate_tests::fuzz::commands);
}

#[test]
fn no_text_misleads_the_reader_of_a_part() {
    fuzz_text("part", palpate_tests::fuzz_files::part);
}

#[test]
fn no_text_misleads_the_reader_of_a_body() {
    fuzz_text("body", palpate_tests::fuzz_files::body);
}

#[test]
fn no_text_misleads_the_reader_of_a_scene() {
    fuzz_text("scene", palpate_tests::fuzz_files::scene);
}

#[test]
fn no_text_misleads_the_reader_of_a_view() {
    fuzz_text("views", palpate_tests::fuzz_files::views);
}

#[test]
fn no_text_misleads_the_reader_of_touches() {
    fuzz_text("touches", palpate_tests::fuzz_files::touches);
}

#[test]
fn no_text_misleads_the_reader_of_a_motion() {
    fuzz_text("motion", palpate_tests::fuzz_files::motion);
}

#[test]
fn no_text_misleads_the_reader_of_a_calibration() {
    fuzz_text("calibration", palpate_tests::fuzz_files::calibration);
}

#[test]
fn no_text_misleads_the_reader_of_a_force_log() {
    fuzz_text("force_log", palpate_tests::fuzz_files::force_log);
}

#[test]
fn no_line_misleads_solve() {
    fuzz_text("solve", palpate_tests::fuzz_files::solve);
}
