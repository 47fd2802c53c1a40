//! A finger that a robot carries: what both say, and the stop where a force is too large or nobody knows it.
//!
//! Every block of samples is judged as it comes. The first reading above the limit, a sample that is no measurement or never
//! came, a device that falls silent and a robot that is lost each send `stop` before anything else is done.
//!
//! Frames: the finger's axes, which are the robot's. Units: SI. Errors: [`GuidedError`].

use std::time::Duration;

use nalgebra::{Point2, Vector2};
use palpate::finger::contact::ContactEstimate;
use palpate::finger::force_guard::{ForceGuard, ForceStop};
use palpate::finger::judge::CountsJudge;
use palpate::finger::sense::{FingerSense, Sensed};
use palpate_device::robot::protocol::{RobotOrder, RobotPlace};
use palpate_device::robot::{RobotError, RobotLink};
use palpate_device::{Incoming, LinkError, Session};
use thiserror::Error;

use super::interrupt;

/// How long one wait for samples lasts: a robot that is lost is noticed that much later at most.
const WAIT: Duration = Duration::from_millis(10);

/// A robot stands where its places of this long are one, s of its own time.
const STANDS_S: f64 = 0.06;

/// Places that differ by less than so many standard deviations are one.
const STANDS_SD: f64 = 6.0;

/// Beyond what a way takes at its speed a robot may take so long, s of its own time.
const LATE_S: f64 = 5.0;

/// Why a guided finger was stopped.
#[derive(Debug, Error)]
pub enum GuidedError {
    /// The robot or the link to it.
    #[error(transparent)]
    Robot(#[from] RobotError),
    /// The link to the finger.
    #[error(transparent)]
    Link(#[from] LinkError),
    /// The force.
    #[error("the robot was stopped: {0}")]
    Force(ForceStop),
    /// No more samples.
    #[error("the robot was stopped: the finger sends no samples any more ({0})")]
    NoSamples(String),
    /// A robot that does not come to where it was sent.
    #[error("the robot was stopped: it is {off_mm:.2} mm from where it was sent, {late_s:.0} s after it was due")]
    NotThere {
        /// Distance, mm.
        off_mm: f64,
        /// Its own time beyond what the way takes, s.
        late_s: f64,
    },
    /// By the person.
    #[error("interrupted; the robot was stopped")]
    Interrupted,
}

/// A finger on a robot.
#[derive(Debug)]
pub struct GuidedFinger {
    session: Session,
    judge: CountsJudge,
    sense: FingerSense,
    guard: ForceGuard,
    robot: RobotLink,
    /// Standard deviation of each coordinate that the robot tells, m.
    place_sd: f64,
    places: Vec<RobotPlace>,
    touch: Option<ContactEstimate>,
    stop_told: bool,
}

/// How a way ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Went {
    /// It is there, and nothing was touched.
    There,
    /// Something is touched, and it stands.
    Touched(Stand),
}

/// A robot and a finger that stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stand {
    /// Mean of the places told.
    pub place: Point2<f64>,
    /// What is felt, mean force.
    pub force: Vector2<f64>,
    /// How well its direction is known, rad.
    pub angle_sd: f64,
}

impl GuidedFinger {
    /// A tared finger and its robot, with a limit for the force.
    #[must_use]
    pub fn new(
        session: Session,
        judge: CountsJudge,
        sense: FingerSense,
        robot: RobotLink,
        place_sd: f64,
        force_limit: f64,
    ) -> Self {
        let guard = ForceGuard::new(force_limit, sense.tare().bias);
        Self { session, judge, sense, guard, robot, place_sd, places: Vec::new(), touch: None, stop_told: false }
    }

    /// Where the robot last said that it is.
    ///
    /// # Errors
    /// [`GuidedError::Robot`].
    pub fn place(&mut self) -> Result<Point2<f64>, GuidedError> {
        if let Some(place) = self.places.last() {
            return Ok(place.at);
        }
        Ok(self.robot.place()?.at)
    }

    /// The robot.
    #[must_use]
    pub fn robot(&self) -> &RobotLink {
        &self.robot
    }

    /// The session with the finger.
    #[must_use]
    pub fn session(&self) -> &Session {
        &self.session
    }

    /// Goes straight to a place (m) with a speed (m/s). With `until_touched` a touch ends it; without, what the finger
    /// feels below the limit does not.
    ///
    /// # Errors
    /// [`GuidedError`]; the robot was then told to stop.
    pub fn go(&mut self, to: Point2<f64>, speed: f64, until_touched: bool) -> Result<Went, GuidedError> {
        let gone = self.try_going(to, speed, until_touched);
        if gone.is_err() {
            self.stop();
        }
        gone
    }

    /// Tells the robot to stop; a link that is broken cannot carry it, which was told as an error before.
    pub fn stop(&mut self) {
        if !std::mem::replace(&mut self.stop_told, true) {
            let _ = self.robot.order(RobotOrder::Stop);
        }
    }

    fn try_going(&mut self, to: Point2<f64>, speed: f64, until_touched: bool) -> Result<Went, GuidedError> {
        let from = self.place()?;
        self.places.clear();
        self.stop_told = false;
        self.robot.order(RobotOrder::Move { to, speed })?;
        let due = (to - from).norm() / speed + LATE_S;
        let mut begun = None;
        loop {
            self.take()?;
            if until_touched && self.touch.is_some() {
                self.stop();
                return self.stand_touching().map(Went::Touched);
            }
            let Some(last) = self.places.last() else { continue };
            let since = last.t - *begun.get_or_insert(last.t);
            let off = (last.at - to).norm();
            if self.stands() && off <= STANDS_SD * self.place_sd {
                return Ok(Went::There);
            }
            if since > due {
                return Err(GuidedError::NotThere { off_mm: off * 1e3, late_s: since - due + LATE_S });
            }
        }
    }

    /// Waits until the robot stands, and tells place and force there; nothing is touched any more where the finger came
    /// free again, and then the force is what it last was.
    fn stand_touching(&mut self) -> Result<Stand, GuidedError> {
        self.places.clear();
        while !self.stands() {
            self.take()?;
        }
        // Once more, for all that is told is then of a finger that stands.
        self.places.clear();
        let (mut force, mut readings, mut angle_sd) = (Vector2::zeros(), 0.0, 0.0);
        while !self.stands() {
            self.take()?;
            if let Some(touch) = &self.touch {
                force += touch.force_finger;
                readings += 1.0;
                angle_sd = touch.u_sd;
            }
        }
        let places = self.places.iter().map(|place| place.at.coords);
        let place = Point2::from(places.sum::<Vector2<f64>>() / self.places.len() as f64);
        Ok(Stand { place, force: if readings > 0.0 { force / readings } else { force }, angle_sd })
    }

    /// Whether the places of the last while are one.
    fn stands(&self) -> bool {
        let Some(last) = self.places.last() else { return false };
        let recent = || self.places.iter().rev().take_while(|place| last.t - place.t <= STANDS_S);
        let covers = self.places.first().is_some_and(|first| last.t - first.t >= STANDS_S);
        covers && recent().all(|place| (place.at - last.at).norm() <= STANDS_SD * self.place_sd)
    }

    /// Takes what came from finger and robot.
    fn take(&mut self) -> Result<(), GuidedError> {
        if interrupt::requested() {
            return Err(GuidedError::Interrupted);
        }
        let incoming = self.session.next(WAIT)?;
        match &incoming {
            Some(Incoming::Samples(samples)) => {
                let judged: Vec<_> = self.judge.judge(samples).collect();
                if let Some(stop) = judged.iter().find_map(|item| self.guard.take(item)) {
                    self.stop();
                    return Err(GuidedError::Force(stop));
                }
                for sensed in self.sense.feel(judged) {
                    if let Sensed::Contact(reading) = sensed {
                        self.touch = reading.contact.touch().copied();
                    }
                }
            }
            Some(Incoming::Silent { after }) => {
                return Err(GuidedError::NoSamples(format!("none for {:.2} s", after.as_secs_f64())));
            }
            Some(Incoming::Disconnected { reason }) => return Err(GuidedError::NoSamples(reason.clone())),
            Some(Incoming::Restarted(_) | Incoming::Reconnected { .. }) => {
                return Err(GuidedError::NoSamples("the device started anew, or its link did".to_owned()));
            }
            Some(Incoming::Event(_) | Incoming::Temperature(_)) | None => {}
        }
        let places = self.robot.places()?;
        self.places.extend(places.into_iter().map(|(place, _)| place));
        Ok(())
    }
}
