//! Bounded fuzzing on stable Rust: mutations of a kept corpus, against the laws in `palpate_tests::fuzz`.
//!
//! The seed is fixed, so that a failure repeats; it prints the bytes that broke the law. For an unbounded search with
//! coverage, see `fuzz/`. A file that libFuzzer finds goes into the corpus.

use std::fs;
use std::path::PathBuf;

use palpate::math::random::Draw;
use palpate_tests::project;

/// Mutations of each target: some seconds in all.
const MUTATIONS: usize = 20_000;

/// Longest input, in bytes: several frames.
const INPUT_MAX: usize = 1200;

fn corpus(target: &str) -> Vec<(PathBuf, Vec<u8>)> {
    let folder = project::folder().join("tests/golden/fuzz").join(target);
    let mut files: Vec<PathBuf> = fs::read_dir(&folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 8, "the corpus in {} is kept", folder.display());
    files.into_iter().map(|path| (path.clone(), fs::read(path).unwrap())).collect()
}

/// Random numbers for mutations.
struct Random(Draw);

impl Random {
    fn below(&mut self, limit: usize) -> usize {
        self.0.index(limit)
    }

    fn byte(&mut self) -> u8 {
        // Half of the time one that means something: delimiter, full groups, small codes.
        const TELLING: [u8; 8] = [0, 0, 0xFF, 0xFE, 1, 2, 0x80, 0x7F];
        match self.below(2) {
            0 => TELLING[self.below(TELLING.len())],
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
    let corpus = corpus(target);
    for (path, bytes) in &corpus {
        eprintln!("{}", path.display());
        law(bytes);
    }
    let mut random = Random(Draw::new(0x7061_6c70_6174_6521));
    for _ in 0..MUTATIONS {
        let mut bytes = corpus[random.below(corpus.len())].1.clone();
        let other = &corpus[random.below(corpus.len())].1;
        for _ in 0..=random.below(6) {
            random.mutate(&mut bytes, other);
        }
        bytes.truncate(INPUT_MAX);
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
        eprintln!("the input was {:02x?}", self.0);
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
