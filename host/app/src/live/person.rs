//! The person at the bench: prompts in a terminal, answers by keyboard.
//!
//! Generic over its two ends, so that a test can play both.

use std::io::{BufRead, Write};

use palpate::finger::calibration::dwell::Refusal;
use palpate::finger::calibration::plan::Step;
use palpate::finger::calibration::session::{Bench, BenchError, StepSummary, Wish};
use palpate_files::lines::{Lines, TEXT_BYTES_MAX};

/// A person who reads prompts and types answers.
#[derive(Debug)]
pub struct Person<R, W> {
    keyboard: Lines<R>,
    screen: W,
    /// What to do about a refusal.
    advise: fn(&Refusal) -> Option<String>,
}

impl<R: BufRead, W: Write> Person<R, W> {
    /// Talks through these two, and says what `advise` has to say about a refusal.
    pub fn new(keyboard: R, screen: W, advise: fn(&Refusal) -> Option<String>) -> Self {
        Self { keyboard: Lines::new(keyboard, TEXT_BYTES_MAX), screen, advise }
    }

    fn say(&mut self, text: &str) -> Result<(), BenchError> {
        let written = write!(self.screen, "{text}").and_then(|()| self.screen.flush());
        written.map_err(|error| BenchError(format!("cannot write to the terminal: {error}")))
    }

    /// Asks until the answer is one of those offered. At the end of input nobody is there any more, and nobody has said
    /// that what was measured may go.
    fn ask(&mut self, question: &str) -> Result<Wish, BenchError> {
        loop {
            self.say(&format!("{question} [Enter = sample, r = the step before again, q = quit] "))?;
            let Some(line) = self.keyboard.next() else {
                return Err(BenchError("nobody is at the keyboard any more".to_owned()));
            };
            let line = line.map_err(|error| BenchError(format!("cannot read the keyboard: {error}")))?;
            let text = match line.content.into_text() {
                Ok(text) => text,
                Err(why) => {
                    self.say(&format!("that is none of the answers: {why}\n"))?;
                    continue;
                }
            };
            match text.trim() {
                "" => return Ok(Wish::Sample),
                "r" => return Ok(Wish::Back),
                "q" => return Ok(Wish::Quit),
                other => self.say(&format!("\"{other}\" is none of the answers\n"))?,
            }
        }
    }
}

impl<R: BufRead, W: Write> Bench for Person<R, W> {
    fn place(&mut self, step: &Step, number: usize, of: usize) -> Result<Wish, BenchError> {
        self.say(&format!("\nstep {number} of {of}: {}\n", step.prompt()))?;
        self.ask("ready?")
    }

    fn accepted(&mut self, _step: &Step, summary: &StepSummary) {
        // What was measured is kept whether or not it can be shown.
        let _ = self.say(&format!("  {summary}\n"));
    }

    fn refused(&mut self, _step: &Step, refusal: &Refusal) -> Result<Wish, BenchError> {
        self.say(&format!("  refused: {refusal}\n"))?;
        if let Some(help) = (self.advise)(refusal) {
            self.say(&format!("  {help}\n"))?;
        }
        self.ask("again?")
    }
}
