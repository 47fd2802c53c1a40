//! Taking stretches of samples from a session: the rim of everything that measures for a while.
//!
//! `listening`: a finger that is moved, block by block; `guided`: one that a robot carries; `interrupt`: the wish to stop;
//! `person`: prompts and answers at the bench.

pub mod guided;
pub mod interrupt;
pub mod listening;
pub mod person;
#[cfg(test)]
mod run_tests;

use std::time::Duration;

use palpate::finger::calibration::dwell::Refusal;
use palpate::finger::calibration::plan::{PlannedContact, Step};
use palpate::finger::calibration::session::{
    Bench, BenchError, Delivered, SampleSource, SourceError, StepSummary, Wish,
};
use palpate::finger::calibration::{self, Calibration, FrontEnd, FrontEndError, FrontEndSettings};
use palpate::finger::contact::{ContactSettings, Tare, TareError};
use palpate::finger::judge::{CountsJudge, Judged};
use palpate::finger::rest::{RestStretch, check_offset};
use palpate_device::simulated::SimulatedDevice;
use palpate_device::{Incoming, LinkError, Session};
use palpate_shared::sim::{ContactLoad, Load};
use palpate_shared::wire::{EventKind, Hello};
use thiserror::Error;

use crate::recording;

/// Gauge factor of metal foil gauges, which the board cannot know.
pub const GAUGE_FACTOR: f64 = 2.0;

/// How long a stream may be silent before it counts as broken: many blocks, and longer than a busy host pauses.
const SILENCE: Duration = Duration::from_secs(2);

/// How long a board with a temperature sensor may take to tell: it does so about once a second.
const TEMPERATURE_WAIT: Duration = Duration::from_millis(1500);

/// Why no samples could be taken.
#[derive(Debug, Error)]
pub enum LiveError {
    /// The link to the device failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The device streams nothing.
    #[error("no samples for {} s{}", SILENCE.as_secs(), last_event.map(|kind| format!("; the device last said: {}", in_words(kind))).unwrap_or_default())]
    Silent {
        /// The last thing the device told of its own accord.
        last_event: Option<EventKind>,
    },
    /// The stretch taken for the tare was not at rest.
    #[error("cannot tare")]
    Tare {
        /// What was wrong with it.
        source: TareError,
    },
    /// The device states an impossible front-end.
    #[error(transparent)]
    FrontEnd(#[from] FrontEndError),
}

/// An event of the device in words.
#[must_use]
pub fn in_words(kind: EventKind) -> String {
    match kind {
        EventKind::FrontEndMissing { id_word } => {
            format!("no front-end answers (its ID reads {id_word:#06x}); nothing is streamed")
        }
        EventKind::FrontEndSilent { quiet_us } => {
            format!("the front-end has announced no data for {:.1} ms", f64::from(quiet_us) / 1e3)
        }
        EventKind::FrontEndRecovered => "the front-end announces data again".to_owned(),
        EventKind::FrontEndReset => {
            "the front-end lost its settings (a dip of its supply?); they were restored".to_owned()
        }
        EventKind::SamplesLost { missed, damaged, dropped } => format!(
            "samples lost in the device: {missed} not read in time, {damaged} damaged on the bus, {dropped} without room"
        ),
    }
}

/// The front-end's settings as a device states them.
///
/// # Errors
/// [`FrontEndError`] if they are impossible.
pub fn front_end(hello: &Hello) -> Result<FrontEnd, FrontEndError> {
    FrontEnd::new(FrontEndSettings {
        gain: hello.gain,
        excitation_v: f64::from(hello.excitation_mv) * 1e-3,
        full_scale_v: f64::from(hello.full_scale_uv) * 1e-6,
        gauge_factor: GAUGE_FACTOR,
    })
}

/// Hands what comes to `take`, in order, until that returns `false`, the user interrupts or a recording is over.
///
/// # Errors
/// [`LiveError::Link`], [`LiveError::Silent`].
pub fn stream(session: &mut Session, mut take: impl FnMut(&mut Session, &Incoming) -> bool) -> Result<(), LiveError> {
    let mut last_heard = session.now();
    let mut last_event = None;
    let mut connected = true;
    loop {
        if interrupt::requested() {
            session.note_interruption();
            return Ok(());
        }
        match session.next(Duration::from_millis(100))? {
            Some(incoming) => {
                match &incoming {
                    Incoming::Samples(_) => last_heard = session.now(),
                    // Lost samples are a consequence; what came before is the cause.
                    Incoming::Event(event) if !matches!(event.kind, EventKind::SamplesLost { .. }) => {
                        last_event = Some(event.kind);
                    }
                    Incoming::Disconnected { .. } => connected = false,
                    Incoming::Reconnected { .. } | Incoming::Restarted(_) => {
                        (connected, last_heard) = (true, session.now());
                    }
                    Incoming::Event(_)
                    | Incoming::Temperature(_)
                    | Incoming::SlowChannels(_)
                    | Incoming::Inputs(_)
                    | Incoming::Force(_)
                    | Incoming::Silent { .. } => {}
                }
                if !take(session, &incoming) {
                    return Ok(());
                }
            }
            None if session.is_over() => return Ok(()),
            // A pulled cable may stay out as long as it likes; a device that is there must talk.
            None if connected && session.now().saturating_duration_since(last_heard) > SILENCE => {
                return Err(LiveError::Silent { last_event });
            }
            None => {}
        }
    }
}

/// Starts the stream from now on: what a device that nobody has stopped has sent before is none of it.
///
/// # Errors
/// [`LiveError::Link`].
pub fn start(session: &mut Session) -> Result<(), LiveError> {
    if session.hello().streaming {
        session.stop()?;
    }
    session.forget_waiting();
    session.start()?;
    Ok(())
}

/// The same, judged: with everything that came goes what it says of the force.
///
/// # Errors
/// As [`stream`].
pub fn judged(
    session: &mut Session,
    judge: &mut CountsJudge,
    mut take: impl FnMut(&mut Session, &Incoming, Vec<Judged>) -> bool,
) -> Result<(), LiveError> {
    stream(session, |session, incoming| {
        let judged = match incoming {
            Incoming::Samples(samples) => judge.judge(samples).collect(),
            Incoming::Temperature(_) | Incoming::SlowChannels(_) => {
                feel_temperature(session, judge);
                Vec::new()
            }
            Incoming::Restarted(_) => vec![judge.restarted()],
            Incoming::Reconnected { countable: false, .. } => vec![Judged::Missing(None)],
            _ => Vec::new(),
        };
        recording::taken(session, incoming, &judged);
        take(session, incoming, judged)
    })
}

/// Has the judge know how warm the finger is now.
pub fn feel_temperature(session: &Session, judge: &mut CountsJudge) {
    if let Some(celsius) = session.temperature_c() {
        judge.feel_temperature(celsius);
    }
}

/// The board's temperature in °C; `None` if it tells none within a little more than the second between two of them.
///
/// # Errors
/// [`LinkError`] if the link fails.
pub fn temperature(session: &mut Session) -> Result<Option<f64>, LinkError> {
    let begun = session.now();
    let has_time = |session: &Session| session.now().saturating_duration_since(begun) < TEMPERATURE_WAIT;
    while session.temperature_c().is_none() && has_time(session) && !session.is_over() {
        session.next(Duration::from_millis(50))?;
    }
    Ok(session.temperature_c())
}

/// Takes the tare over `seconds` of sample time at rest; what comes beside samples goes to `tell`.
///
/// # Errors
/// As [`stream`]; [`LiveError::Tare`] if the finger was not at rest, or under load where `offset` is what to expect.
pub fn tare(
    session: &mut Session,
    judge: &mut CountsJudge,
    seconds: f64,
    settings: &ContactSettings,
    offset: Option<(&Calibration, &FrontEnd)>,
    mut tell: impl FnMut(&Incoming),
) -> Result<Tare, LiveError> {
    let mut rest = RestStretch::new(seconds);
    let mut failed = None;
    judged(session, judge, |_, incoming, judged| {
        tell(incoming);
        for item in &judged {
            match rest.take(item) {
                Ok(false) => {}
                Ok(true) => return false,
                Err(error) => {
                    failed = Some(error);
                    return false;
                }
            }
        }
        true
    })?;
    let estimated = failed.map_or_else(|| Tare::estimate(rest.readings(), &settings.tare_settings()), Err);
    let checked = estimated.and_then(|tare| {
        let expected = offset.map_or(Ok(()), |(calibration, end)| check_offset(&tare.bias, calibration, end));
        expected.map(|()| tare)
    });
    checked.map_err(|source| LiveError::Tare { source })
}

/// A session as a calibration's source of samples.
#[derive(Debug)]
pub struct LinkSource<'a> {
    session: &'a mut Session,
}

impl<'a> LinkSource<'a> {
    /// Takes samples from this session.
    pub fn new(session: &'a mut Session) -> Self {
        Self { session }
    }
}

impl SampleSource for LinkSource<'_> {
    fn next_block(&mut self) -> Result<Delivered, SourceError> {
        let (mut block, mut trouble) = (None, None);
        let taken = stream(self.session, |_, incoming| {
            match incoming {
                Incoming::Samples(samples) => block = Some(samples.clone()),
                other => trouble = trouble.take().or_else(|| trouble_with(other)),
            }
            block.is_none()
        });
        taken.map_err(|error| SourceError(error.to_string()))?;
        let samples = block.ok_or_else(|| SourceError("the stream ended".to_owned()))?;
        Ok(trouble.map_or(Delivered::Samples(samples), Delivered::Trouble))
    }

    /// Stops the stream, drops what is under way, and starts it anew: between two steps a person may take as long
    /// as they like, and nothing piles up meanwhile.
    fn discard_waiting(&mut self) -> Result<(), SourceError> {
        let stopped = self.session.stop();
        self.session.forget_waiting();
        stopped.and_then(|()| self.session.start()).map_err(|error| SourceError(error.to_string()))
    }
}

/// What spoils a dwell, in words; lost samples show by themselves.
fn trouble_with(incoming: &Incoming) -> Option<String> {
    match incoming {
        Incoming::Event(event) if !matches!(event.kind, EventKind::SamplesLost { .. }) => Some(in_words(event.kind)),
        Incoming::Disconnected { reason } => Some(format!("the link broke: {reason}")),
        Incoming::Restarted(_) => Some("the device started anew".to_owned()),
        _ => None,
    }
}

/// The hand of a simulated device as a calibration's bench: every step is set up at once, exactly.
#[derive(Debug)]
pub struct SimulatedBench<'a> {
    hand: &'a SimulatedDevice,
    /// Force along the contact's normal where the plan does not say, in N.
    normal_force: f64,
    /// How often a step may be refused before the bench gives up.
    patience: u32,
    tell: fn(&Step, Result<&StepSummary, &Refusal>),
}

/// Refusals of one step before a simulated bench gives up: its hand does not shake, so one is chance and more are not.
const SIMULATED_PATIENCE: u32 = 3;

impl<'a> SimulatedBench<'a> {
    /// A bench that presses with `normal_force` newtons where the plan does not say, and reports to `tell`.
    pub fn new(hand: &'a SimulatedDevice, normal_force: f64, tell: fn(&Step, Result<&StepSummary, &Refusal>)) -> Self {
        Self { hand, normal_force, patience: SIMULATED_PATIENCE, tell }
    }

    fn press(&self, contact: &PlannedContact) -> Load {
        let force = match contact.load {
            calibration::Load::Newtons(newtons) => newtons,
            calibration::Load::Same | calibration::Load::Unknown => self.normal_force,
        };
        #[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
        Load::Static(ContactLoad::frictionless(contact.angle_deg.to_radians() as f32, force as f32))
    }
}

impl Bench for SimulatedBench<'_> {
    fn place(&mut self, step: &Step, _number: usize, _of: usize) -> Result<Wish, BenchError> {
        let load = match step {
            Step::Tare { .. } => Load::Released,
            Step::Contact(contact) => self.press(contact),
        };
        self.hand.set_load(load).map_err(|error| BenchError(error.to_string()))?;
        Ok(Wish::Sample)
    }

    fn accepted(&mut self, step: &Step, summary: &StepSummary) {
        self.patience = SIMULATED_PATIENCE;
        (self.tell)(step, Ok(summary));
    }

    fn refused(&mut self, step: &Step, refusal: &Refusal) -> Result<Wish, BenchError> {
        (self.tell)(step, Err(refusal));
        self.patience -= 1;
        if self.patience == 0 {
            return Err(BenchError(format!("refused {SIMULATED_PATIENCE} times: {refusal}")));
        }
        Ok(Wish::Sample)
    }
}
