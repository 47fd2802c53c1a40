//! A request to the front-end, spread over the frames that read samples anyway.
//!
//! In frame k a step's command goes out, in frame k + 1 its response comes in. A damaged response, or one
//! that says that the command came damaged, sends the job back to that step; after [`FAILURES_MAX`] of
//! these it gives up.

use crate::ads131m::{Command, may_be_refusal, register, setting_words};
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
const SELF_TEST_READS: [u8; STEPS_MAX] =
    [register::ID, register::MODE, register::CLOCK, register::GAIN1, register::STATUS];

/// Registers that hold the settings.
const VERIFY_READS: [u8; 3] = [register::MODE, register::CLOCK, register::GAIN1];

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
    pub(crate) fn of(request: FrontEndRequest, present: DeviceSettings) -> Option<Self> {
        let goal = match request.kind {
            RequestKind::Apply(settings) => Goal::Apply { settings, changes_rate: settings.rate != present.rate },
            RequestKind::ReadRegister(address) => Goal::Read(address),
            RequestKind::SelfTest => Goal::SelfTest,
            RequestKind::Stream(_) | RequestKind::Select(_) | RequestKind::RawFrame(_) => return None,
        };
        Some(Self::new(Some(request.ticket), goal))
    }

    /// A job to read the settings.
    pub(crate) fn verify() -> Self {
        Self::new(None, Goal::Verify)
    }

    fn new(ticket: Option<u8>, goal: Goal) -> Self {
        let mut job = Self {
            ticket,
            goal,
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
            Goal::Apply { settings, changes_rate: true } => Some(settings.rate),
            _ => None,
        }
    }

    /// The command that goes out with the next frame.
    pub(crate) fn command(&self) -> Command {
        self.step(self.next).unwrap_or(Command::Null)
    }

    /// How the job stands.
    pub(crate) fn progress(&self) -> Progress {
        self.progress
    }

    /// Begins again, as after the front-end was reset.
    pub(crate) fn restart(&mut self) {
        self.fail(self.first());
    }

    /// A frame was exchanged: this response came in, or a damaged one; [`Self::command`] went out if `sent`.
    pub(crate) fn advance(&mut self, sent: bool, response: Option<u16>) {
        let sent = self.step(self.next).filter(|_| sent).map(|_| self.next);
        if let Some(step) = self.awaited.take() {
            match response.filter(|&word| self.accepts(step, word)) {
                Some(word) => self.words[step % STEPS_MAX] = word,
                None => {
                    self.may_have_strayed |= matches!(self.step(step), Some(Command::Write(..)));
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

    /// The command of a step; none after the last.
    fn step(&self, step: usize) -> Option<Command> {
        match self.goal {
            Goal::Apply { settings, .. } => apply_step(settings, step),
            Goal::Read(address) => (step == 0).then_some(Command::Read(address)),
            Goal::SelfTest => SELF_TEST_READS.get(step).copied().map(Command::Read),
            Goal::Verify => VERIFY_READS.get(step).copied().map(Command::Read),
        }
    }

    /// Whether a response can be the answer to a step.
    fn accepts(&mut self, step: usize, response: u16) -> bool {
        match self.step(step) {
            Some(Command::Write(address, _)) => response == Command::write_done(address),
            _ if may_be_refusal(response) && self.suspicions < SUSPICIONS_MAX => {
                self.suspicions += 1;
                false
            }
            _ => true,
        }
    }

    /// Whether what was written reads back.
    fn is_right(&self) -> bool {
        let Goal::Apply { settings, .. } = self.goal else { return true };
        let [_, _, clock, gain, _] = self.words;
        setting_words(settings).map(|(_, word)| word) == [clock, gain]
    }
}

/// First both writes, then both reads.
fn apply_step(settings: DeviceSettings, step: usize) -> Option<Command> {
    let [clock, gain] = setting_words(settings);
    let steps = [
        Command::Write(clock.0, clock.1),
        Command::Write(gain.0, gain.1),
        Command::Read(clock.0),
        Command::Read(gain.0),
    ];
    steps.get(step).copied()
}
