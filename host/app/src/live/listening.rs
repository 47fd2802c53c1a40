//! A finger that is listened to block by block while it is moved: what touches it, and what must end the motion.
//!
//! A touch begins at a force and lasts until less than half of it is felt.
//!
//! Frames: those of the calibration. Units: SI. Errors: [`ListenError`]; whoever moves the finger stops at each of them.

use std::time::Duration;

use palpate::finger::contact::ContactEstimate;
use palpate::finger::force_guard::{ForceGuard, ForceStop};
use palpate::finger::judge::{CountsJudge, Judged};
use palpate::finger::sense::{FingerSense, Sensed};
use palpate_device::trace::Input;
use palpate_device::{Incoming, LinkError, Session};
use thiserror::Error;

use crate::recording;

/// How long one wait for samples lasts: what else goes wrong is noticed that much later at most.
const WAIT: Duration = Duration::from_millis(10);

/// How long the first samples may take.
const FIRST_SAMPLES: Duration = Duration::from_secs(2);

/// Ends a touch: this share of the force that begins it.
const RELEASE_SHARE: f64 = 0.5;

/// Why the finger must not be moved on.
#[derive(Debug, Error)]
pub enum ListenError {
    /// The link to the finger.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The force, or that it is not known.
    #[error("stopped: {0}")]
    Force(ForceStop),
    /// No more samples.
    #[error("stopped: the finger sends no samples any more ({0})")]
    NoSamples(String),
}

/// A tared finger that is moved.
#[derive(Debug)]
pub struct ListeningFinger {
    session: Session,
    judge: CountsJudge,
    sense: FingerSense,
    guard: ForceGuard,
    touch_force: f64,
    touch: Option<ContactEstimate>,
}

impl ListeningFinger {
    /// A tared finger that feels a touch from one force on, and must not be moved on above another (N).
    #[must_use]
    pub fn new(session: Session, judge: CountsJudge, sense: FingerSense, touch_force: f64, force_limit: f64) -> Self {
        recording::sensing(&sense);
        let guard = ForceGuard::new(force_limit, sense.tare().bias);
        Self { session, judge, sense, guard, touch_force, touch: None }
    }

    /// What touches now.
    #[must_use]
    pub fn touch(&self) -> Option<&ContactEstimate> {
        self.touch.as_ref()
    }

    /// Whether it is one of a recording.
    #[must_use]
    pub fn is_recorded(&self) -> bool {
        self.session.is_recorded()
    }

    /// Notes what came in from elsewhere, at its place among the samples.
    pub fn note_input(&mut self, source: &str, line: String) {
        self.session.note_input(Input { source: source.to_owned(), line: Some(line) });
    }

    /// What came in from there when it was recorded, up to this place.
    pub fn recorded_inputs(&mut self, source: &str) -> Vec<String> {
        self.session.recorded_inputs(source).into_iter().flatten().collect()
    }

    /// Notes that the person at the keyboard wishes it to end.
    pub fn note_interruption(&mut self) {
        self.session.note_interruption();
    }

    /// Begins to listen: what the finger sent while nobody did is of no use, and its converter settles first.
    ///
    /// # Errors
    /// [`ListenError`].
    pub fn listen(&mut self) -> Result<(), ListenError> {
        self.session.stop()?;
        self.session.forget_waiting();
        self.session.start()?;
        self.touch = None;
        let begun = self.session.now();
        while self.session.now().saturating_duration_since(begun) < FIRST_SAMPLES && !self.session.is_over() {
            if let Some(incoming @ Incoming::Samples(samples)) = &self.session.next(WAIT)? {
                let judged: Vec<_> = self.judge.judge(samples).collect();
                recording::taken(&self.session, incoming, &judged);
                if let Some(first) = judged.iter().position(|item| matches!(item, Judged::Measured(_))) {
                    return self.feel(judged.into_iter().skip(first).collect());
                }
            }
        }
        Err(ListenError::NoSamples(format!("none that measure within {} s", FIRST_SAMPLES.as_secs())))
    }

    /// Takes what came next, if anything did.
    ///
    /// # Errors
    /// [`ListenError`].
    pub fn take(&mut self) -> Result<(), ListenError> {
        match &self.session.next(WAIT)? {
            Some(incoming @ Incoming::Samples(samples)) => {
                let judged: Vec<_> = self.judge.judge(samples).collect();
                recording::taken(&self.session, incoming, &judged);
                self.feel(judged)
            }
            Some(Incoming::Temperature(_) | Incoming::SlowChannels(_)) => {
                super::feel_temperature(&self.session, &mut self.judge);
                Ok(())
            }
            None if self.session.is_over() => Err(ListenError::NoSamples("the recording ends here".to_owned())),
            Some(Incoming::Silent { after }) => {
                Err(ListenError::NoSamples(format!("none for {:.2} s", after.as_secs_f64())))
            }
            Some(Incoming::Disconnected { reason }) => Err(ListenError::NoSamples(reason.clone())),
            Some(Incoming::Restarted(_) | Incoming::Reconnected { .. }) => {
                Err(ListenError::NoSamples("the device started anew, or its link did".to_owned()))
            }
            Some(Incoming::Event(_) | Incoming::Inputs(_) | Incoming::Force(_)) | None => Ok(()),
        }
    }

    /// Holds readings against the limit, then feels what touches.
    fn feel(&mut self, judged: Vec<Judged>) -> Result<(), ListenError> {
        if let Some(stop) = judged.iter().find_map(|item| self.guard.take(item)) {
            return Err(ListenError::Force(stop));
        }
        for sensed in self.sense.feel(judged) {
            let Sensed::Contact(reading) = sensed else { continue };
            let least = if self.touch.is_some() { RELEASE_SHARE * self.touch_force } else { self.touch_force };
            self.touch = reading.contact.touch().filter(|touch| touch.magnitude >= least).copied();
        }
        Ok(())
    }
}
