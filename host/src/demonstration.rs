//! The whole chain in one place: a simulated world pushes a part, a simulated finger feels it, the host names the pose.
//!
//! [`Rig`] is a finger of its own, calibrated through its own firmware and wire; [`Rig::push`] lets a world's force act on it and
//! gives what was felt. [`Drawn`] is a random part, pushed somewhere. Nothing of the truth reaches the host but through samples.
//!
//! Frames: finger axes. Units: SI. Errors: [`RigError`].

use std::f64::consts::PI;
use std::io;
use std::sync::Arc;

use miette::Diagnostic;
use nalgebra::{Isometry2, Rotation2, Vector2};
use palpate_shared::sim::Draw;
use palpate_shared::sim::{BridgesConfig, FingerConfig, Load};

use crate::calibration::plan::PlanError;
use crate::calibration::plan::{Plan, TareMode};
use crate::calibration::session::RunError;
use crate::calibration::{self, Fit, FitError};
use crate::contact::{Reading, TareError};
use crate::finger_motion::{FingerMotion, Segment};
use crate::geometry::SimplePolygon;
use crate::gravity::GRAVITY_ASSUMED;
use crate::link::session::Options;
use crate::link::{LinkError, Session};
use crate::live::{self, LinkSource, LiveError, SimulatedBench};
use crate::push_sense::{PushSense, RestNoise};
use crate::pushed_world::{Played, PushedWorld};
use crate::pushing::{EndReason, Part};
use crate::sensing;
use crate::simulated_device::{Config, ForceCourse, Line, Pace, SimulatedDevice};
use crate::tables::random::{convex_polygon, star_polygon};

/// Radius of the default finger's disk, m.
pub const RADIUS_M: f64 = 0.015;

/// Force of the calibration weight, N. A noisier finger takes one as many times heavier, or its directions would be refused.
pub const CALIBRATION_FORCE_N: f64 = 2.0;

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
    fit: Fit,
}

/// A push as the host felt it.
#[derive(Clone, Debug)]
pub struct FeltPush {
    /// What it makes of it.
    pub sense: PushSense,
    /// Every reading, those at rest before included.
    pub readings: Vec<Reading>,
}

/// Why the chain broke.
#[derive(Debug, thiserror::Error, Diagnostic)]
pub enum RigError {
    /// The simulated finger could not be started, or has ended.
    #[error("the simulated finger is gone")]
    Device(#[from] io::Error),
    /// The link failed.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Link(#[from] LinkError),
    /// No samples came.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Live(#[from] LiveError),
    /// The calibration could not be taken.
    #[error("the simulated finger cannot be calibrated")]
    Calibration(#[from] RunError),
    /// Its settings cannot be.
    #[error("the simulated finger cannot be calibrated")]
    Settings(#[from] PlanError),
    /// The calibration does not fit.
    #[error("the simulated finger's calibration does not fit")]
    Fit(#[from] FitError),
    /// The finger was not at rest before the push.
    #[error("the simulated finger was refused as not at rest {REST_TRIES} times, at last because {0}")]
    Rest(#[from] TareError),
}

impl Rig {
    /// A finger with so many times the default one's noise, at its host's pace, and calibrated.
    ///
    /// # Errors
    /// [`RigError`].
    pub fn start(seed: u64, noise: f64, line: Line) -> Result<Self, RigError> {
        let config = Config { seed, finger: finger(noise), pace: Pace::AsRead, line, ..Config::default() };
        let hand = Arc::new(SimulatedDevice::start(config)?);
        let mut session = Session::open_simulated(Arc::clone(&hand), Options::default())?;
        let fit = calibrate(&mut session, &hand, CALIBRATION_FORCE_N * noise.max(1.0))?;
        Ok(Self { hand, session, fit })
    }

    /// What the calibration found.
    #[must_use]
    pub fn fit(&self) -> &Fit {
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
    pub fn push(&mut self, course: ForceCourse) -> Result<FeltPush, RigError> {
        let (rest, mut readings) = self.rest_noise()?;
        let mut sense = PushSense::new(rest, Some(&self.fit.calibration));
        let duration = course.duration_s();
        let begun_s = self.hand.set_course(course)?.truth.time_ns as f64 * 1e-9;
        let push = self.readings_until(begun_s + duration + AFTER_S)?;
        push.iter().for_each(|reading| sense.push(reading));
        readings.extend(push);
        Ok(FeltPush { sense, readings })
    }

    /// Bias and noise; a stretch that is refused is taken again, as a person would.
    fn rest_noise(&mut self) -> Result<(RestNoise, Vec<Reading>), RigError> {
        for _ in 1..REST_TRIES {
            let readings = self.rest()?;
            match RestNoise::estimate(&readings) {
                Ok(rest) => return Ok((rest, readings)),
                Err(refused) => tracing::warn!(%refused, "the tare is taken again"),
            }
        }
        let readings = self.rest()?;
        Ok((RestNoise::estimate(&readings)?, readings))
    }

    fn rest(&mut self) -> Result<Vec<Reading>, RigError> {
        let released_s = self.hand.set_load(Load::Released)?.truth.time_ns as f64 * 1e-9;
        // What was sampled before is of no use, and a device at its host's pace may have run seconds ahead.
        self.session.stop()?;
        self.session.forget_waiting();
        self.session.start()?;
        let mut readings = self.readings_until(released_s + SETTLE_S + REST_S)?;
        readings.retain(|reading| reading.t >= released_s + SETTLE_S);
        Ok(readings)
    }

    /// Readings up to a moment of device time, s.
    fn readings_until(&mut self, end_s: f64) -> Result<Vec<Reading>, RigError> {
        let (calibration, mut readings) = (&self.fit.calibration, Vec::new());
        live::stream(
            &mut self.session,
            |_, samples| {
                readings.extend(sensing::readings(samples, calibration));
                samples.device_time_s(samples.counts.len()) < end_s
            },
            |_| (),
        )?;
        Ok(readings)
    }
}

/// The default finger with so many times its noise and hum.
fn finger(noise: f64) -> FingerConfig {
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
pub fn calibrate(session: &mut Session, hand: &SimulatedDevice, force: f64) -> Result<Fit, RigError> {
    let load = calibration::Load::Newtons(force);
    let plan = Plan::all_round(CALIBRATION_CONTACTS, load, TareMode::Each);
    let front_end = live::front_end(session.hello()).map_err(LiveError::from)?;
    let settings = plan.dwell_settings(front_end, f64::from(session.hello().rate_hz))?;
    let mut run = calibration::session::Session::new(plan.steps(), settings);
    let mut bench = SimulatedBench::new(hand, force, |_, _| ());
    calibration::session::run(&mut run, &mut LinkSource::new(session), &mut bench)?;
    Ok(calibration::fit(&calibration::session::measurements(run.taken()), &plan.fit_settings(&front_end))?)
}

/// What random problems are drawn from.
#[derive(Clone, Debug)]
pub struct Ranges {
    /// µ of the plane, as known.
    pub mu: f64,
    /// µ_c between finger and part.
    pub mu_c: [f64; 2],
    /// The part's mass, kg.
    pub mass: [f64; 2],
    /// Greatest angle between where the finger goes and the contact's normal, rad.
    pub angle: f64,
    /// How the finger moves.
    pub motion: FingerMotion,
}

/// The finger first goes along x, then turns towards y: its path bends, so that poses that feel alike in a straight push part.
///
/// # Panics
/// Never: the segments are constants.
#[must_use]
pub fn default_motion() -> FingerMotion {
    let segments =
        [Segment { seconds: 0.3, acceleration: [0.15, 0.0] }, Segment { seconds: 0.5, acceleration: [0.0, 0.15] }];
    FingerMotion::new([0.0; 2], &segments).expect("constant segments are sound")
}

/// As long and as fast as [`default_motion`], but straight.
///
/// # Panics
/// Never: the segments are constants.
#[must_use]
pub fn straight_motion() -> FingerMotion {
    let segments = [Segment { seconds: 0.8, acceleration: [0.12, 0.0] }];
    FingerMotion::new([0.0; 2], &segments).expect("constant segments are sound")
}

impl Default for Ranges {
    fn default() -> Self {
        Self { mu: 0.3, mu_c: [0.1, 0.5], mass: [0.2, 0.8], angle: 0.8, motion: default_motion() }
    }
}

/// A random problem and what became of it.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// µ_c.
    pub mu_c: f64,
    /// kg.
    pub mass: f64,
    /// The edge that is touched.
    pub edge: usize,
    /// Contact angle at the start, rad.
    pub u: f64,
    /// Contact on the edge at the start, m.
    pub s: f64,
    /// The push.
    pub played: Played,
    /// Starts that were drawn before this one and could not be: the finger does not fit, or the contact leaves the edge.
    pub redrawn: usize,
}

/// Starts drawn before a part is given up as one that the finger cannot push for so long.
const REDRAWS_MAX: usize = 2000;

/// A random part: two of three are convex, one is a star.
#[must_use]
pub fn random_part(draw: &mut Draw) -> Part {
    let convex = draw.chance(2.0 / 3.0);
    let polygon: SimplePolygon = if convex {
        convex_polygon(draw, 8, 0.05)
    } else {
        let n = 5 + draw.index(4);
        star_polygon(draw, n, 0.025, 0.055)
    };
    Part::uniform(polygon)
}

impl Ranges {
    /// A push of this part: the contact uniform along the outline, friction, mass and angle uniform in their ranges. Redrawn until
    /// the finger fits and the contact stays on its edge throughout.
    ///
    /// None if that never happens.
    #[must_use]
    pub fn draw(&self, draw: &mut Draw, part: &Part) -> Option<Drawn> {
        (0..REDRAWS_MAX).find_map(|redrawn| {
            let (edge, s) = place(draw, part)?;
            let [x, y] = self.motion.first_acceleration();
            let u = y.atan2(x) + draw.uniform(-self.angle, self.angle);
            let mu_c = draw.uniform(self.mu_c[0], self.mu_c[1]);
            let mass = draw.uniform(self.mass[0], self.mass[1]);
            let grip = self.mu * GRAVITY_ASSUMED;
            let world = PushedWorld { part, grip, mass, mu_c, radius: RADIUS_M, motion: &self.motion, edge, u, s };
            let played = world.play().ok().filter(|played| played.end == EndReason::Time)?;
            Some(Drawn { mu_c, mass, edge, u, s, played, redrawn })
        })
    }
}

/// A place uniform along the outline.
fn place(draw: &mut Draw, part: &Part) -> Option<(usize, f64)> {
    let lengths: Vec<_> = part.polygon().edges().map(|(from, to)| (to - from).norm()).collect();
    let mut left = draw.uniform(0.0, lengths.iter().sum());
    let edge = lengths.iter().position(|length| {
        left -= length;
        left < 0.0
    })?;
    let line = part.edge(edge).ok()?;
    Some((edge, line.s_max + left))
}

/// How far a pose is from the truth, by the nearest of the poses that look the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Distance of the centres of mass, m.
    pub distance: f64,
    /// Angle, rad, not negative.
    pub angle: f64,
}

/// Compares two poses of a part that `symmetry` turns take to itself.
#[must_use]
pub fn pose_error(part: &Part, symmetry: usize, pose: &Isometry2<f64>, truth: &Isometry2<f64>) -> PoseError {
    let centre = part.centre_of_mass();
    let distance = (pose * centre - truth * centre).norm();
    let step = 2.0 * PI / f64::from(u32::try_from(symmetry.max(1)).unwrap_or(u32::MAX));
    let off = pose.rotation.angle_to(&truth.rotation).rem_euclid(step);
    PoseError { distance, angle: off.min(step - off) }
}

/// A pose turned about the part's centre of mass.
#[must_use]
pub fn turned(part: &Part, pose: &Isometry2<f64>, angle: f64) -> Isometry2<f64> {
    let centre: Vector2<f64> = (pose * part.centre_of_mass()).coords;
    let turn = Rotation2::new(pose.rotation.angle() + angle);
    Isometry2::new(centre - turn * part.centre_of_mass().coords, turn.angle())
}
