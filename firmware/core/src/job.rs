//! A request to the front-end, spread over the frames that read samples anyway.
//!
//! In frame k a step's command goes out, in frame k + 1 its response comes in. A damaged response, or one
//! that says that the command came damaged, sends the job back to that step; after [`FAILURES_MAX`] of
//! these it gives up.

use crate::front_end::{Answer, Ask, FrontEnd, Registers};
use crate::queues::{FrontEndRequest, RequestKind};
use crate::settings::{DeviceSettings, Rate};

/// Damaged steps after which a job gives up: at one damaged frame in three, one job in a thousand does.
const FAILURES_MAX: u8 = 16;

/// Times that a register's value which looks like a refused read is read again before it is believed.
const SUSPICIONS_MAX: u8 = 3;

/// Steps of the longest job.
const STEPS_MAX: usize = 5;

/// What a job is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Goal {
    /// Write rate (if it changes, as that disturbs the filter's timing) and gain, and read both back.
    Apply {
        /// Rate and gain to write.
        settings: DeviceSettings,
        /// The same as the registers' words.
        words: [u16; 2],
        /// Whether the rate changes.
        changes_rate: bool,
    },
    /// Read the register at this address.
    Read(u8),
    /// Read identity, settings and status.
    SelfTest,
    /// Read the settings, after damage that may have changed them; nobody asked for it.
    Verify,
}

/// Registers that a self-test reads, in the order of its results.
const fn self_test_reads(of: &Registers) -> [u8; STEPS_MAX] {
    [of.id, of.mode, of.rate, of.gain, of.status]
}

/// Registers that hold the settings.
const fn verify_reads(of: &Registers) -> [u8; 3] {
    [of.mode, of.rate, of.gain]
}

/// How a job stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Progress {
    UnderWay,
    Done,
    Failed,
}

/// A request at work.
#[derive(Clone, Debug)]
pub(crate) struct Job {
    /// Whom to answer, if anyone.
    pub(crate) ticket: Option<u8>,
    pub(crate) goal: Goal,
    registers: &'static Registers,
    /// The step whose command goes out next.
    next: usize,
    /// The step whose response comes in next.
    awaited: Option<usize>,
    /// The responses so far.
    pub(crate) words: [u16; STEPS_MAX],
    failures: u8,
    suspicions: u8,
    /// A write was not acknowledged, so it may have gone to another register, or the job gave up halfway.
    pub(crate) may_have_strayed: bool,
    progress: Progress,
}

impl Job {
    /// The job for a request, if it takes one.
    pub(crate) fn of<F: FrontEnd>(request: FrontEndRequest, present: DeviceSettings) -> Option<Self> {
        let goal = match request.kind {
            RequestKind::Apply(settings) => {
                let words = F::setting_words(settings);
                Goal::Apply { settings, words, changes_rate: settings.rate != present.rate }
            }
            RequestKind::ReadRegister(address) => Goal::Read(address),
            RequestKind::SelfTest => Goal::SelfTest,
            RequestKind::Stream(_) | RequestKind::Select(_) | RequestKind::RawFrame(_) => return None,
        };
        Some(Self::new::<F>(Some(request.ticket), goal))
    }

    /// A job to read the settings.
    pub(crate) fn verify<F: FrontEnd>() -> Self {
        Self::new::<F>(None, Goal::Verify)
    }

    fn new<F: FrontEnd>(ticket: Option<u8>, goal: Goal) -> Self {
        let mut job = Self {
            ticket,
            goal,
            registers: &F::REGISTERS,
            next: 0,
            awaited: None,
            words: [0; STEPS_MAX],
            failures: 0,
            suspicions: 0,
            may_have_strayed: false,
            progress: Progress::UnderWay,
        };
        job.next = job.first();
        job
    }

    /// The first step: a rate that stays is not written.
    fn first(&self) -> usize {
        usize::from(matches!(self.goal, Goal::Apply { changes_rate: false, .. }))
    }

    /// Whether conversions may come at another rate than before from now on.
    pub(crate) fn changes_rate(&self) -> bool {
        matches!(self.goal, Goal::Apply { changes_rate: true, .. })
    }

    /// The rate that it sets, if it changes it.
    pub(crate) fn rate_to_be(&self) -> Option<Rate> {
        match self.goal {
            Goal::Apply { settings, changes_rate: true, .. } => Some(settings.rate),
            _ => None,
        }
    }

    /// What the next frame asks.
    pub(crate) fn ask(&self) -> Ask {
        self.step(self.next).unwrap_or(Ask::Nothing)
    }

    /// How the job stands.
    pub(crate) fn progress(&self) -> Progress {
        self.progress
    }

    /// Begins again, as after the front-end was reset.
    pub(crate) fn restart(&mut self) {
        self.fail(self.first());
    }

    /// A frame was exchanged: this answer came in, or a damaged one; [`Self::ask`] went out if `sent`.
    pub(crate) fn advance(&mut self, sent: bool, answer: Option<Answer>) {
        let sent = self.step(self.next).filter(|_| sent).map(|_| self.next);
        if let Some(step) = self.awaited.take() {
            match answer.and_then(|answer| self.accept(answer)) {
                Some(word) => self.words[step % STEPS_MAX] = word,
                None => {
                    self.may_have_strayed |= matches!(self.step(step), Some(Ask::Write(..)));
                    return self.fail(step);
                }
            }
        }
        self.awaited = sent;
        self.next += usize::from(sent.is_some());
        if self.awaited.is_none() && self.step(self.next).is_none() {
            self.conclude();
        }
    }

    /// All responses are in.
    fn conclude(&mut self) {
        if self.is_right() { self.progress = Progress::Done } else { self.fail(self.first()) }
    }

    /// Goes back to a step. The response to what has just gone out, if anything, is not looked at.
    fn fail(&mut self, step: usize) {
        self.failures = self.failures.saturating_add(1);
        self.next = step;
        self.awaited = None;
        if self.failures > FAILURES_MAX {
            self.progress = Progress::Failed;
            // Half done, perhaps.
            self.may_have_strayed |= matches!(self.goal, Goal::Apply { .. });
        }
    }

    /// What a step asks; nothing after the last.
    fn step(&self, step: usize) -> Option<Ask> {
        let read = |addresses: &[u8]| addresses.get(step).copied().map(Ask::Read);
        match self.goal {
            Goal::Apply { words, .. } => self.apply_step(words, step),
            Goal::Read(address) => read(&[address]),
            Goal::SelfTest => read(&self_test_reads(self.registers)),
            Goal::Verify => read(&verify_reads(self.registers)),
        }
    }

    /// First both writes, then both reads.
    fn apply_step(&self, [rate, gain]: [u16; 2], step: usize) -> Option<Ask> {
        let at = self.registers;
        let steps = [Ask::Write(at.rate, rate), Ask::Write(at.gain, gain), Ask::Read(at.rate), Ask::Read(at.gain)];
        steps.get(step).copied()
    }

    /// The word of an answer, if it can be believed.
    fn accept(&mut self, answer: Answer) -> Option<u16> {
        match answer {
            Answer::Doubtful(_) if self.suspicions < SUSPICIONS_MAX => {
                self.suspicions += 1;
                None
            }
            Answer::Value(word) | Answer::Doubtful(word) => Some(word),
            Answer::Written => Some(0),
            Answer::None | Answer::NotWritten => None,
        }
    }

    /// Whether what was written reads back.
    fn is_right(&self) -> bool {
        let Goal::Apply { words, .. } = self.goal else { return true };
        let [_, _, rate, gain, _] = self.words;
        words == [rate, gain]
    }
}
