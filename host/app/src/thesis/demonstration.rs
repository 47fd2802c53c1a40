//! The whole chain in one place: a simulated world pushes a part, a simulated finger feels it, the host names the pose.
//!
//! [`Rig`] is a finger of its own, calibrated through its own firmware and wire; [`Rig::push`] lets a world's force act
//! on it and gives what was felt. Nothing of the truth reaches the host but through samples.
//!
//! Frames: finger axes. Units: SI. Errors: [`RigError`].

use std::io;
use std::sync::Arc;

use nalgebra::Vector2;
use palpate::finger::calibration::plan::PlanError;
use palpate::finger::calibration::plan::{CalibrationPlan, TareMode};
use palpate::finger::calibration::session::CalibrationRunError;
use palpate::finger::calibration::{self, CalibrationFit, FitError};
use palpate::finger::contact::{Reading, TareError};
use palpate::finger::judge::{CountsJudge, Judged};
use palpate::pushing::estimation::from_rest::CarriedFinger;
use palpate::pushing::estimation::from_rest::onset::{PushSense, RestNoise};
use palpate::pushing::finger_motion::FingerMotion;
use palpate::pushing::pushed_world::{Played, STEP_S};
use palpate::pushing::wave::{self, WaveError, WaveFit, swings};
use palpate_device::session::SessionOptions;
use palpate_device::simulated::{CarriedCourse, Config, Line, Pace, SimulatedDevice};
use palpate_device::{LinkError, Session};
use palpate_shared::sim::{BeamConfig, BridgesConfig, Carriage, FingerConfig, Load};

use crate::live::{self, LinkSource, LiveError, SimulatedBench};

/// Force of the calibration weight, N. A noisier finger takes one as many times heavier, or its directions would be
/// refused.
pub const CALIBRATION_FORCE_N: f64 = 2.0;

/// Fastest that the finger is waved, m/s²: it then feels 70 mN of itself.
pub const WAVE_PEAK: f64 = 3.0;

/// Contacts that the finger is calibrated on, evenly round the disk.
pub const CALIBRATION_CONTACTS: u32 = 12;

/// Time at rest before a push, s: from it come bias and noise.
const REST_S: f64 = 2.0;

/// Time after a released finger has rung out, s: by 1/e in 43 ms.
const SETTLE_S: f64 = 0.5;

/// Stretches at rest that may be refused before a push is given up: one is chance.
const REST_TRIES: u32 = 3;

/// Time after a push until nothing of it is on its way any more, s.
const AFTER_S: f64 = 0.1;

/// A simulated finger behind its own line, calibrated.
#[derive(Debug)]
pub struct Rig {
    hand: Arc<SimulatedDevice>,
    session: Session,
    fit: CalibrationFit,
    finger: CarriedFinger,
}

/// A push as the host felt it.
#[derive(Clone, Debug)]
pub struct SensedPush {
    /// What it makes of it.
    pub sense: PushSense,
    /// Every reading, those at rest before included.
    pub readings: Vec<Reading>,
}

/// Why the chain broke.
#[derive(Debug, thiserror::Error)]
pub enum RigError {
    /// The simulated finger could not be started, or has ended.
    #[error("the simulated finger is gone")]
    Device(#[from] io::Error),
    /// The link to the simulated device failed.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// No samples came from the simulated device.
    #[error(transparent)]
    Live(#[from] LiveError),
    /// The calibration could not be taken.
    #[error("the simulated finger cannot be calibrated")]
    Calibration(#[from] CalibrationRunError),
    /// Its settings cannot be.
    #[error("the simulated finger cannot be calibrated")]
    Settings(#[from] PlanError),
    /// The wave told nothing of its mass.
    #[error("the simulated finger's mass cannot be found")]
    Wave(#[from] WaveError),
    /// The calibration does not fit.
    #[error("the simulated finger's calibration does not fit")]
    Fit(#[from] FitError),
    /// The finger was not at rest before the push.
    #[error("the simulated finger was refused as not at rest {REST_TRIES} times, at last because {0}")]
    Rest(#[from] TareError),
}

impl Rig {
    /// A finger with so many times the default one's noise, whose time passes as its host asks, calibrated and waved.
    ///
    /// # Errors
    /// [`RigError`].
    pub fn start(seed: u64, noise: f64, line: Line) -> Result<Self, RigError> {
        Self::of(seed, finger(noise), noise, line)
    }

    /// The same with another finger that has so many times the default one's noise.
    ///
    /// # Errors
    /// [`RigError`].
    pub fn of(seed: u64, finger: FingerConfig, noise: f64, line: Line) -> Result<Self, RigError> {
        let config = Config { seed, finger, pace: Pace::AsAsked, line, ..Config::default() };
        let hand = Arc::new(SimulatedDevice::start(config)?);
        let mut session = Session::open_simulated(Arc::clone(&hand), SessionOptions::default())?;
        let fit = calibrate(&mut session, &hand, CALIBRATION_FORCE_N * noise.max(1.0))?;
        let finger = CarriedFinger { compliance: compliance_by_design(), ..CarriedFinger::RIGID };
        let mut rig = Self { hand, session, fit, finger };
        let mass = rig.wave()?.effective_mass;
        rig.finger = CarriedFinger { effective_mass: mass.value, effective_mass_sd: mass.sd, ..rig.finger };
        Ok(rig)
    }

    /// Waves the finger in the air and finds what it weighs.
    fn wave(&mut self) -> Result<WaveFit, RigError> {
        let motion = swings(WAVE_PEAK).map_err(io::Error::other)?;
        let (_, mut readings) = self.rest_noise()?;
        let begun_s = self.hand.set_course(in_the_air(&motion))?.truth.time_ns as f64 * 1e-9;
        readings.extend(self.readings_until(begun_s + motion.duration() + AFTER_S)?);
        Ok(wave::identify(&readings, &motion)?)
    }

    /// What is known of the finger: its effective mass from a wave, its compliance from its drawings.
    #[must_use]
    pub fn finger(&self) -> CarriedFinger {
        self.finger
    }

    /// What the calibration found.
    #[must_use]
    pub fn fit(&self) -> &CalibrationFit {
        &self.fit
    }

    /// The session with the finger.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Lets forces act on the finger after a while at rest, and feels them to their end.
    ///
    /// # Errors
    /// [`RigError`].
    pub fn push(&mut self, course: CarriedCourse) -> Result<SensedPush, RigError> {
        let (rest, mut readings) = self.rest_noise()?;
        let mut sense = PushSense::new(rest, Some(&self.fit.calibration)).carried(&self.finger);
        let duration = course.duration_s();
        let begun_s = self.hand.set_course(course)?.truth.time_ns as f64 * 1e-9;
        let push = self.readings_until(begun_s + duration + AFTER_S)?;
        push.iter().for_each(|reading| sense.push(reading));
        readings.extend(push);
        Ok(SensedPush { sense, readings })
    }

    /// Bias and noise; a stretch that is refused is taken again, as a person would.
    fn rest_noise(&mut self) -> Result<(RestNoise, Vec<Reading>), RigError> {
        for _ in 1..REST_TRIES {
            let readings = self.rest()?;
            match RestNoise::estimate(&readings) {
                Ok(rest) => return Ok((rest, readings)),
                Err(refused) => tracing::info!("the tare is taken again: {refused}"),
            }
        }
        let readings = self.rest()?;
        Ok((RestNoise::estimate(&readings)?, readings))
    }

    /// Readings of the released finger, once it is still.
    pub(super) fn rest(&mut self) -> Result<Vec<Reading>, RigError> {
        let released_s = self.hand.set_load(Load::Released)?.truth.time_ns as f64 * 1e-9;
        // What was sampled before is of no use.
        self.session.stop()?;
        self.session.forget_waiting();
        self.session.start()?;
        let mut readings = self.readings_until(released_s + SETTLE_S + REST_S)?;
        readings.retain(|reading| reading.t >= released_s + SETTLE_S);
        Ok(readings)
    }

    /// Readings up to a moment of device time, s.
    fn readings_until(&mut self, end_s: f64) -> Result<Vec<Reading>, RigError> {
        let (mut judge, mut readings) = (CountsJudge::new(&self.fit.calibration), Vec::new());
        live::judged(&mut self.session, &mut judge, |_, _, judged| {
            let now = judged.last().and_then(Judged::time);
            readings.extend(judged.into_iter().filter_map(Judged::reading));
            now.is_none_or(|now| now < end_s)
        })?;
        Ok(readings)
    }
}

/// A push for a simulated device to play: the forces on its disk, and how its clamp is moved.
#[must_use]
pub fn course(played: &Played, motion: &FingerMotion) -> CarriedCourse {
    carried(STEP_S, played.forces_evenly().into_iter(), motion)
}

/// Forces on the disk (finger axes, N), each `step_s` after the one before, of a finger whose clamp rests: what its own mass adds is
/// not there.
#[must_use]
pub fn unmoved(step_s: f64, forces: impl Iterator<Item = Vector2<f64>>) -> CarriedCourse {
    let at_rest = |force| Carriage { force: single(force), ..Carriage::default() };
    CarriedCourse::new(step_s, forces.map(at_rest).collect())
}

#[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
fn single(of: Vector2<f64>) -> [f32; 2] {
    [of.x as f32, of.y as f32]
}

/// Forces on the disk (finger axes, N), each `step_s` after the one before, of a finger that is moved so.
#[must_use]
pub fn carried(step_s: f64, forces: impl Iterator<Item = Vector2<f64>>, motion: &FingerMotion) -> CarriedCourse {
    let times = (0_u32..).map(|step| f64::from(step) * step_s);
    let carriage =
        |(t, force)| Carriage { force: single(force), acceleration: single(motion.acceleration(t + SAME_TIME_S)) };
    CarriedCourse::new(step_s, times.zip(forces).map(carriage).collect())
}

/// A finger that nothing touches while it is moved so.
#[must_use]
pub fn in_the_air(motion: &FingerMotion) -> CarriedCourse {
    let steps = (0_u32..).map(|step| f64::from(step) * STEP_S).take_while(|t| *t <= motion.duration());
    carried(STEP_S, steps.map(|_| Vector2::zeros()), motion)
}

/// An acceleration that changes within so little is the later one, s: rounding of sums of segments.
const SAME_TIME_S: f64 = 1e-9;

/// How far the default finger's tip gives way by its drawings, m/N.
#[must_use]
pub fn compliance_by_design() -> f64 {
    1.0 / f64::from(BeamConfig::default().tip_stiffness())
}

/// The default finger with so many times its noise and hum.
#[must_use]
pub fn finger(noise: f64) -> FingerConfig {
    #[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
    let noise = noise as f32;
    let default = FingerConfig::default();
    let hum_peak_to_peak = default.bridges.hum_peak_to_peak * noise;
    FingerConfig {
        converter_noise: default.converter_noise * noise,
        bridges: BridgesConfig { hum_peak_to_peak, ..default.bridges },
        ..default
    }
}

/// Calibrates a simulated finger with a weight of so many newtons, all round its disk.
///
/// # Errors
/// [`RigError`].
pub fn calibrate(session: &mut Session, hand: &SimulatedDevice, force: f64) -> Result<CalibrationFit, RigError> {
    let load = calibration::Load::Newtons(force);
    let plan = CalibrationPlan::all_round(CALIBRATION_CONTACTS, load, TareMode::Each);
    let front_end = live::front_end(session.hello()).map_err(LiveError::from)?;
    let settings = plan.dwell_settings(front_end, f64::from(session.hello().rate_hz))?;
    let mut run = calibration::session::CalibrationRun::new(plan.steps(), settings);
    let mut bench = SimulatedBench::new(hand, force, |_, _| ());
    calibration::session::run(&mut run, &mut LinkSource::new(session), &mut bench)?;
    Ok(calibration::fit(&calibration::session::measurements(run.taken()), &plan.fit_settings(&front_end))?)
}
