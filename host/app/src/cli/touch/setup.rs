//! Finger, robot and simulated world from the command line.

use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use miette::{IntoDiagnostic as _, WrapErr as _};
use nalgebra::Point2;
use palpate::finger::calibration::Calibration;
use palpate::finger::contact::{Averaging, ContactSettings, Thresholds};
use palpate::finger::judge::CountsJudge;
use palpate::finger::sense::{self, FingerSense};
use palpate::math::random::Draw;
use palpate::pushing::touched_world::TouchedWorld;
use palpate_device::robot::RobotLink;
use palpate_device::session::SessionOptions;
use palpate_device::simulated::robot::{RobotConfig, SimulatedRobot};
use palpate_device::simulated::{Config, Line, Pace, SimulatedDevice};
use palpate_device::{Address, Session};
use palpate_files::part::PolygonFile;

use super::carriers::{AVERAGE_S, Carrier, CarryError, PersonCarrier, RobotCarrier, Speeds, check_unit};
use super::explore::HELD_MASS;
use super::{Arguments, MotionArguments};
use crate::advice::Advise as _;
use crate::cli::simulate_device::lines_of_input;
use crate::cli::touch_world::{MU_C, anywhere, simulated};
use crate::live;
use crate::live::guided::{GuidedError, GuidedFinger};
use crate::live::interrupt;
use crate::live::listening::ListeningFinger;
use crate::recording;
use crate::thesis::demonstration::Rig;

/// A simulated finger on a simulated robot, whose time passes as the host asks.
pub(crate) struct RobotWorld {
    pub(crate) robot: SimulatedRobot,
    pub(crate) session: Session,
    pub(crate) calibration: Calibration,
}

/// The calibration of the simulated finger of a seed, taken by it beforehand.
pub(crate) fn calibrated_in_place(seed: u64) -> miette::Result<Calibration> {
    Ok(Rig::start(seed, 1.0, Line::Pipe).advised()?.fit().calibration.clone())
}

impl RobotWorld {
    /// A world with a finger of this seed.
    pub(crate) fn new(
        world: TouchedWorld,
        start: Point2<f64>,
        seed: u64,
        calibration: Option<Calibration>,
    ) -> miette::Result<Self> {
        let calibration = calibration.map_or_else(|| calibrated_in_place(seed), Ok)?;
        let robot = SimulatedRobot::new(RobotConfig { start, seed, ..RobotConfig::default() }, world);
        let config = Config { seed, pace: Pace::AsAsked, carried_by: Some(robot.clone()), ..Config::default() };
        let device = SimulatedDevice::start(config).advised().wrap_err("cannot start the simulated finger")?;
        let options = SessionOptions::default();
        let session = Session::open_simulated_noted(Arc::new(device), options, recording::recorder()).advised()?;
        Ok(Self { robot, session, calibration })
    }
}

impl MotionArguments {
    /// A finger that has been tared.
    pub(crate) fn listening(
        &self,
        mut session: Session,
        calibration: Calibration,
        tare_s: f64,
        is_checked: bool,
    ) -> miette::Result<ListeningFinger> {
        let front_end = live::front_end(session.hello()).advised()?;
        // From here on forces are along the robot's axes.
        let calibration = calibration.mounted(self.mounting_deg.to_radians());
        let settings = ContactSettings {
            averaging: Averaging::Seconds(AVERAGE_S),
            bias_walk: sense::bias_walk(&calibration, &front_end),
            thresholds: Thresholds { force_min: 0.5 * self.touch_force, ..Thresholds::default() },
            ..ContactSettings::default()
        };
        let unit = calibration.unit().symbol();
        recording::tared(unit, None);
        live::start(&mut session).advised()?;
        let mut judge = CountsJudge::new(&calibration);
        note!("{}taring for {tare_s} s: keep the finger free", crate::cli::simulated_note(&session));
        let offset = is_checked.then_some((&calibration, &front_end));
        let tare = live::tare(&mut session, &mut judge, tare_s, &settings, offset, crate::cli::tell).advised()?;
        recording::tared(unit, Some(tare.bias));
        let sense = FingerSense::new(Some(calibration), tare, &settings).into_diagnostic()?;
        Ok(ListeningFinger::new(session, judge, sense, self.touch_force, self.force_limit))
    }

    /// A finger on a robot.
    pub(crate) fn guided(&self, finger: ListeningFinger, robot: RobotLink, speeds: Speeds) -> RobotCarrier {
        RobotCarrier::new(GuidedFinger::new(finger, robot, self.place_sd_mm * 1e-3), speeds)
    }
}

impl Arguments {
    /// Whoever moves the finger.
    pub(super) fn carrier(&self, file: &PolygonFile, speeds: &Speeds) -> miette::Result<Box<dyn Carrier>> {
        interrupt::listen();
        if self.finger.device.is_recording() {
            return self.recorded(speeds);
        }
        let robot: Option<Address> = self.motion.robot.as_deref().map(str::parse).transpose().advised()?;
        if let Some(Address::Simulated { .. }) = robot {
            return self.simulated(file, speeds);
        }
        if self.simulated_pose.is_some() {
            return Err(miette::miette!(help = "with --robot sim: it is", "no part is simulated here"));
        }
        // A robot that is not there is said before anything is asked of the finger.
        let robot = robot.map(|address| self.robot(&address)).transpose().advised()?;
        let session = self.finger.device.open(false)?;
        let calibration = self.finger.calibration.require(&session)?;
        let finger = self.motion.listening(session, calibration, self.tare, self.finger.offset.is_checked())?;
        Ok(match robot {
            Some(robot) => Box::new(self.motion.guided(finger, robot, *speeds)),
            None => Box::new(PersonCarrier::new(finger, *speeds, Some(lines_of_input()?))),
        })
    }

    /// The robot at an address.
    fn robot(&self, address: &Address) -> Result<RobotLink, CarryError> {
        let mut link = RobotLink::open(address, Instant::now()).map_err(GuidedError::from)?;
        let at = link.place().map_err(GuidedError::from)?.at;
        check_unit(self.area_mm.0, at)?;
        Ok(link)
    }

    /// Who moved the finger when it was recorded.
    fn recorded(&self, speeds: &Speeds) -> miette::Result<Box<dyn Carrier>> {
        let session = self.finger.device.open(false)?;
        let calibration = match recording::play::attachment(SIMULATED) {
            Some(seed) => {
                let seed = String::from_utf8_lossy(&seed.data).parse().into_diagnostic();
                calibrated_in_place(seed.wrap_err("the recording does not say which finger was simulated")?)?
            }
            None => self.finger.calibration.require(&session)?,
        };
        let epoch = session.epoch();
        let finger = self.motion.listening(session, calibration, self.tare, self.finger.offset.is_checked())?;
        Ok(match self.motion.robot {
            Some(_) => Box::new(self.motion.guided(finger, RobotLink::recorded(epoch), *speeds)),
            None => Box::new(PersonCarrier::new(finger, *speeds, None)),
        })
    }

    fn simulated(&self, file: &PolygonFile, speeds: &Speeds) -> miette::Result<Box<dyn Carrier>> {
        let Address::Simulated { seed } = self.finger.device.address()? else {
            return Err(miette::miette!(
                help = "-d sim: is one; or name the real robot",
                "a simulated robot carries a simulated finger only"
            ));
        };
        let outline = file.part.polygon().clone();
        let pose = match self.simulated_pose {
            Some(pose) => pose,
            None => anywhere(&outline, self.area_mm, &mut Draw::new(seed))?,
        };
        let friction = [file.mu, file.mu_c.unwrap_or(MU_C)];
        let mass = if self.exploration.is_asked() { HELD_MASS } else { MASS };
        let world = simulated(outline, friction, self.mass_kg.unwrap_or(mass), pose);
        let named = self.finger.calibration.named_calibration()?;
        if named.is_none() {
            recording::attach(SIMULATED, Path::new("seed"), seed.to_string().as_bytes());
        }
        let RobotWorld { robot, session, calibration } = RobotWorld::new(world, self.start(), seed, named)?;
        let epoch = session.epoch();
        let finger = self.motion.listening(session, calibration, self.tare, self.finger.offset.is_checked())?;
        Ok(Box::new(self.motion.guided(finger, RobotLink::simulated(robot, epoch), *speeds)))
    }
}

/// What the seed of a finger that was calibrated in place is called in a recording.
const SIMULATED: &str = "simulated";

/// Of a simulated part of which nothing is said, kg.
const MASS: f64 = 1.0;
