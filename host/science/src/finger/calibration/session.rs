//! A calibration run, step by step: what to do next, whether it worked, again, back, or stop.
//!
//! A state machine without input or output of its own. [`run`] drives it with a [`SampleSource`] (a device) and a
//! [`Bench`] (a person, or a script that moves a simulated load). Only accepted dwells are kept; stopping leaves what
//! was accepted so far.
//!
//! Frames: finger. Units: counts, degrees in prompts. Errors: [`CalibrationRunError`].

use nalgebra::Vector2;
use thiserror::Error;

use super::dwell::{Dwell, DwellSettings, DwellVerdict, Expected, RawSample, Refusal, Watcher};
use super::force::{DwellReading, DwellTare};
use super::measurements::{CalibrationContact, Measurements};
use super::plan::Step;
use crate::finger::Samples;

/// What a source has next.
#[derive(Clone, Debug, PartialEq)]
pub enum Delivered {
    /// Consecutive samples, in counts.
    Samples(Samples),
    /// What the device says is wrong, in words for the person at the bench; no sample around it counts.
    Trouble(String),
}

/// Where samples come from.
pub trait SampleSource {
    /// The next block, waiting for it as long as that makes sense.
    ///
    /// # Errors
    /// The device is gone or silent.
    fn next_block(&mut self) -> Result<Delivered, SourceError>;

    /// Drops everything that was measured before now: a person takes half a minute between two steps.
    ///
    /// # Errors
    /// The device is gone.
    fn discard_waiting(&mut self) -> Result<(), SourceError>;
}

/// Why no samples come. The text is the link's own.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("no samples from the device: {0}")]
pub struct SourceError(pub String);

/// What the bench wants next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wish {
    /// The step is set up (again): sample.
    Sample,
    /// Go back and take the step before again.
    Back,
    /// End the run here; what was accepted stays.
    Quit,
}

/// Who sets up the steps.
pub trait Bench {
    /// Sets up a step and says what to do. `number` counts from 1.
    ///
    /// # Errors
    /// The bench cannot go on (its input ended, its script failed).
    fn place(&mut self, step: &Step, number: usize, of: usize) -> Result<Wish, BenchError>;

    /// Tells of an accepted dwell.
    fn accepted(&mut self, step: &Step, summary: &StepSummary);

    /// Tells why a dwell was refused and asks what to do.
    ///
    /// # Errors
    /// The bench cannot go on.
    fn refused(&mut self, step: &Step, refusal: &Refusal) -> Result<Wish, BenchError>;
}

/// Why the bench cannot go on.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("the bench cannot go on: {0}")]
pub struct BenchError(pub String);

/// Why a run ended without an ending.
#[derive(Clone, Debug, PartialEq, Error)]
pub enum CalibrationRunError {
    /// No samples come from the device.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The bench cannot say what to do next.
    #[error(transparent)]
    Bench(#[from] BenchError),
}

/// How a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// All steps are accepted.
    Complete,
    /// The person ended it before all steps were accepted.
    Quit,
}

/// What to tell about an accepted dwell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSummary {
    /// Load as it shows in the bridges, microstrain; `None` for a tare.
    pub load_microstrain: Option<[f64; 2]>,
    /// Noise of a single sample on each bridge, microstrain rms.
    pub noise_microstrain: [f64; 2],
    /// Time it took, s.
    pub waited_s: f64,
    /// Samples lost in that time.
    pub lost: u64,
}

impl std::fmt::Display for StepSummary {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let [x, y] = self.noise_microstrain;
        match self.load_microstrain {
            Some([x, y]) => write!(f, "accepted: load ({x:+.2}, {y:+.2}) microstrain")?,
            None => write!(f, "accepted: unloaded")?,
        }
        write!(f, ", noise ({x:.2}, {y:.2}) rms, {:.1} s", self.waited_s)?;
        if self.lost > 0 {
            write!(f, ", {} samples lost", self.lost)?;
        }
        Ok(())
    }
}

/// An accepted step with its samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Taken {
    /// The step of the plan.
    pub step: Step,
    /// The mean reading and the samples it is of.
    pub dwell: Dwell,
}

/// The steps of a calibration at the finger, with the dwells that have been accepted.
#[derive(Clone, Debug)]
pub struct CalibrationRun {
    steps: Vec<Step>,
    taken: Vec<Taken>,
    settings: DwellSettings,
    watcher: Option<Watcher>,
}

impl CalibrationRun {
    /// Starts with nothing taken. The settings must have passed [`DwellSettings::check`].
    #[must_use]
    pub fn new(steps: Vec<Step>, settings: DwellSettings) -> Self {
        Self { steps, taken: Vec::new(), settings, watcher: None }
    }

    /// The step to do now; `None` when all are accepted.
    #[must_use]
    pub fn step(&self) -> Option<&Step> {
        self.steps.get(self.taken.len())
    }

    /// How many steps there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there is nothing to do at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    /// What has been accepted so far, in order.
    #[must_use]
    pub fn taken(&self) -> &[Taken] {
        &self.taken
    }

    /// Begins to sample the present step, forgetting an unfinished attempt.
    pub fn begin(&mut self) {
        let expected = self.step().map(|step| expected(step, &self.taken));
        self.watcher = expected.map(|expected| Watcher::new(self.settings, expected));
    }

    /// Takes samples of the present step. After a verdict other than "needs more time" the attempt is over.
    pub fn feed(&mut self, delivered: &Delivered) -> DwellVerdict {
        let Some(watcher) = &mut self.watcher else { return DwellVerdict::NeedsMoreTime(None) };
        let verdict = match delivered {
            Delivered::Samples(samples) => watcher.push(samples),
            Delivered::Trouble(words) => DwellVerdict::Refused(Refusal::Trouble(words.clone())),
        };
        match &verdict {
            DwellVerdict::NeedsMoreTime(_) => {}
            DwellVerdict::Refused(_) => self.watcher = None,
            DwellVerdict::Accepted(dwell) => {
                self.watcher = None;
                if let Some(&step) = self.step() {
                    self.taken.push(Taken { step, dwell: dwell.clone() });
                }
            }
        }
        verdict
    }

    /// Forgets the last accepted step, so that it is the present one again.
    pub fn back(&mut self) {
        self.watcher = None;
        self.taken.pop();
    }

    /// What to tell about the step accepted last.
    #[must_use]
    pub fn summary(&self) -> Option<StepSummary> {
        let (last, before) = self.taken.split_last()?;
        let per_count = self.settings.front_end.microstrain_per_count();
        let load_microstrain = match expected(&last.step, before) {
            Expected::Nothing => None,
            Expected::Load { tare } => Some(((last.dwell.reading.counts - tare) * per_count).into()),
        };
        let Dwell { noise_microstrain, waited_s, lost, .. } = last.dwell;
        Some(StepSummary { load_microstrain, noise_microstrain, waited_s, lost })
    }
}

/// What a step expects, with the tare that came before it.
fn expected(step: &Step, before: &[Taken]) -> Expected {
    match step {
        Step::Tare { .. } => Expected::Nothing,
        // Without any tare (a plan cannot make that) every reading counts as loaded, and the fit refuses the data.
        Step::Contact(_) => {
            Expected::Load { tare: tare_before(before).map_or_else(Vector2::zeros, |tare| tare.0.counts) }
        }
    }
}

fn tare_before(taken: &[Taken]) -> Option<DwellTare> {
    taken.iter().rev().find(|taken| matches!(taken.step, Step::Tare { .. })).map(|taken| DwellTare(taken.dwell.reading))
}

/// Puts accepted steps together for the fit.
///
/// Where one tare serves all contacts, the drift between the tares before and after is taken off in proportion to the
/// time: a room that warms by half a kelvin in a quarter of an hour would otherwise turn 2 N contacts by 0.1°.
#[must_use]
pub fn measurements(taken: &[Taken]) -> Measurements {
    let drift = Drift::between_tares(taken);
    let mut measurements = Measurements::default();
    for (index, Taken { step, dwell }) in taken.iter().enumerate() {
        match step {
            Step::Tare { angle_deg: None } => measurements.tares.push(DwellTare(drift.taken_off(dwell))),
            Step::Tare { angle_deg: Some(_) } => {}
            Step::Contact(planned) => {
                let tare = own_tare(planned.angle_deg, &taken[..index]);
                let reading = if tare.is_some() { dwell.reading } else { drift.taken_off(dwell) };
                measurements.contacts.push(CalibrationContact {
                    angle: planned.angle_deg.to_radians(),
                    load: planned.load,
                    reading,
                    tare,
                });
            }
        }
    }
    measurements
}

/// How far the unloaded reading drifted from the first tare of the session to the last, counts.
#[must_use]
pub fn drift_between_tares(taken: &[Taken]) -> Option<Vector2<f64>> {
    let drift = Drift::between_tares(taken);
    (drift.end_us > drift.start_us).then_some(drift.counts)
}

/// An even drift of the unloaded reading between the session's first and last tare.
struct Drift {
    start_us: f64,
    end_us: f64,
    counts: Vector2<f64>,
}

impl Drift {
    /// No drift at all where there are not two tares in order of time.
    fn between_tares(taken: &[Taken]) -> Self {
        let mut tares =
            taken.iter().filter(|taken| matches!(taken.step, Step::Tare { angle_deg: None })).map(|taken| &taken.dwell);
        let first = tares.next();
        let (Some(first), Some(last)) = (first, tares.next_back()) else {
            return Self { start_us: 0.0, end_us: 0.0, counts: Vector2::zeros() };
        };
        Self { start_us: middle_us(first), end_us: middle_us(last), counts: last.reading.counts - first.reading.counts }
    }

    /// The reading as it would have been halfway between the tares.
    fn taken_off(&self, dwell: &Dwell) -> DwellReading {
        let mut reading = dwell.reading;
        if self.end_us > self.start_us {
            let share = (middle_us(dwell) - self.start_us) / (self.end_us - self.start_us) - 0.5;
            reading.counts -= self.counts * share.clamp(-0.5, 0.5);
        }
        reading
    }
}

/// Device time in the middle of a dwell, µs.
fn middle_us(dwell: &Dwell) -> f64 {
    let times =
        [dwell.samples.first(), dwell.samples.last()].map(|sample| sample.map_or(0.0, |sample| sample.t_us as f64));
    0.5 * (times[0] + times[1])
}

/// The tare taken last at the same position.
fn own_tare(angle_deg: f64, before: &[Taken]) -> Option<DwellTare> {
    let here =
        |step: &Step| matches!(step, Step::Tare { angle_deg: Some(angle) } if angle.to_bits() == angle_deg.to_bits());
    before.iter().rev().find(|taken| here(&taken.step)).map(|taken| DwellTare(taken.dwell.reading))
}

/// Measures kept samples again, as when they were taken.
///
/// # Errors
/// The refusal of the first dwell that would not be accepted now, with its number counted from 1.
pub fn measure_again(
    steps: &[(Step, Vec<RawSample>)],
    settings: &DwellSettings,
) -> Result<Vec<Taken>, (usize, Refusal)> {
    let mut taken = Vec::new();
    for (index, (step, samples)) in steps.iter().enumerate() {
        let dwell =
            super::dwell::measure(samples, settings, expected(step, &taken)).map_err(|refusal| (index + 1, refusal))?;
        taken.push(Taken { step: *step, dwell });
    }
    Ok(taken)
}

/// Drives a session to its end.
///
/// # Errors
/// The device or the bench failed; what was accepted stays in the session.
pub fn run(
    session: &mut CalibrationRun,
    source: &mut dyn SampleSource,
    bench: &mut dyn Bench,
) -> Result<Ending, CalibrationRunError> {
    run_keeping(session, source, bench, &mut |_| {})
}

/// Drives a session to its end and hands out everything accepted so far after each step, to be kept.
///
/// # Errors
/// The device or the bench failed; what was accepted stays in the session.
pub fn run_keeping(
    session: &mut CalibrationRun,
    source: &mut dyn SampleSource,
    bench: &mut dyn Bench,
    keep: &mut dyn FnMut(&[Taken]),
) -> Result<Ending, CalibrationRunError> {
    let mut retry = None;
    while let Some(&step) = session.step() {
        let wish = match retry.take() {
            Some(wish) => wish,
            None => bench.place(&step, session.taken().len() + 1, session.len())?,
        };
        match wish {
            Wish::Quit => return Ok(Ending::Quit),
            Wish::Back => session.back(),
            Wish::Sample => {
                if let Err(refusal) = sample(session, source)? {
                    retry = Some(bench.refused(&step, &refusal)?);
                } else if let Some(summary) = session.summary() {
                    bench.accepted(&step, &summary);
                    keep(session.taken());
                }
            }
        }
    }
    Ok(Ending::Complete)
}

/// Samples the present step until it is decided.
fn sample(session: &mut CalibrationRun, source: &mut dyn SampleSource) -> Result<Result<(), Refusal>, SourceError> {
    source.discard_waiting()?;
    session.begin();
    loop {
        match session.feed(&source.next_block()?) {
            DwellVerdict::NeedsMoreTime(_) => {}
            DwellVerdict::Accepted(_) => return Ok(Ok(())),
            DwellVerdict::Refused(refusal) => return Ok(Err(refusal)),
        }
    }
}
