//! A finger that a robot carries: what both say, and the stop where a force is too large or nobody knows it.
//!
//! Every block of samples is judged as it comes ([`super::listening`]). The first reading above the limit, a sample that is no measurement or never
//! came, a device that falls silent and a robot that is lost each send `stop` before anything else is done.
//!
//! Frames: the robot's axes, along which the finger's calibration is to give its forces. Units: SI. Errors: [`GuidedError`].

use std::collections::VecDeque;

use nalgebra::{Point2, Vector2};
use palpate_device::robot::protocol::{RobotLine, RobotOrder, RobotPlace};
use palpate_device::robot::{RobotError, RobotLink};
use thiserror::Error;

use super::interrupt;
use super::listening::{ListenError, ListeningFinger};

/// What a robot's places are called in a recording: those that it told, and those that were waited for.
const ROBOT: &str = "robot";
const ASKED: &str = "robot_asked";

/// And what it was told.
const ORDERED: &str = "robot_told";

/// The places in a robot's lines.
fn told(lines: Vec<String>) -> Result<Vec<RobotPlace>, RobotError> {
    let place = |line: String| match RobotLine::parse(&line)? {
        RobotLine::Place(place) => Ok(place),
        RobotLine::Error(words) => Err(RobotError::Refused(words)),
    };
    lines.into_iter().map(place).collect()
}

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
    /// The force, or that nobody knows it.
    #[error(transparent)]
    Finger(#[from] ListenError),
    /// A robot that does not come to where it was sent.
    #[error("the robot was stopped: it is {off_mm:.2} mm from where it was sent, {late_s:.0} s after it was due")]
    NotThere {
        /// Distance, mm.
        off_mm: f64,
        /// Its own time beyond what the way takes, s.
        late_s: f64,
    },
    /// A robot that does not stop.
    #[error("the robot was told to stop, and {after_s:.1} s later its places still differ")]
    DoesNotStand {
        /// Its own time since the order, s.
        after_s: f64,
    },
    /// By the person.
    #[error("interrupted; the robot was stopped")]
    Interrupted,
}

/// A finger on a robot.
#[derive(Debug)]
pub struct GuidedFinger {
    finger: ListeningFinger,
    robot: RobotLink,
    /// Standard deviation of each coordinate that the robot tells, m.
    place_sd: f64,
    places: Vec<RobotPlace>,
    /// Of a recording, and not asked for yet.
    asked: VecDeque<RobotPlace>,
    stop_told: bool,
}

/// How a way ended.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Went {
    /// It is there, and nothing was touched.
    There,
    /// Something is touched, and it stands.
    Touched(Stand),
    /// Something was touched, and is not any more.
    CameFree,
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
    /// A finger and its robot, each of whose coordinates has this standard deviation (m).
    #[must_use]
    pub fn new(finger: ListeningFinger, robot: RobotLink, place_sd: f64) -> Self {
        Self { finger, robot, place_sd, places: Vec::new(), asked: VecDeque::new(), stop_told: false }
    }

    /// The finger, let go of by the robot.
    #[must_use]
    pub fn into_finger(self) -> ListeningFinger {
        self.finger
    }

    /// Where the robot says that it is.
    ///
    /// # Errors
    /// [`GuidedError::Robot`].
    pub fn place(&mut self) -> Result<Point2<f64>, GuidedError> {
        if self.finger.is_recorded() {
            self.asked.extend(told(self.finger.recorded_inputs(ASKED))?);
            let over = || ListenError::NoSamples("the recording does not say where the robot is".to_owned());
            return Ok(self.asked.pop_front().ok_or_else(over)?.at);
        }
        let place = self.robot.place()?;
        self.note(ASKED, &place);
        Ok(place.at)
    }

    /// Where the robot said that it is, since this was last asked; now, or when it was recorded.
    fn heard(&mut self) -> Result<Vec<RobotPlace>, GuidedError> {
        if !self.finger.is_recorded() {
            let places: Vec<_> = self.robot.places()?.into_iter().map(|(place, _)| place).collect();
            places.iter().for_each(|place| self.note(ROBOT, place));
            return Ok(places);
        }
        Ok(told(self.finger.recorded_inputs(ROBOT))?)
    }

    /// Has a recording keep a place, with all its digits.
    fn note(&mut self, source: &str, place: &RobotPlace) {
        self.finger.note_input(source, format!("{} {} {}", place.t, place.at.x, place.at.y));
    }

    /// The robot.
    #[must_use]
    pub fn robot(&self) -> &RobotLink {
        &self.robot
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
            let _ = self.order(RobotOrder::Stop);
        }
    }

    fn order(&mut self, order: RobotOrder) -> Result<(), GuidedError> {
        if !self.finger.is_recorded() {
            self.finger.note_input(ORDERED, order.to_string());
        }
        Ok(self.robot.order(order)?)
    }

    fn try_going(&mut self, to: Point2<f64>, speed: f64, until_touched: bool) -> Result<Went, GuidedError> {
        self.finger.listen()?;
        let from = self.place()?;
        self.places.clear();
        self.stop_told = false;
        self.order(RobotOrder::Move { to, speed })?;
        let due = (to - from).norm() / speed + LATE_S;
        let mut begun = None;
        loop {
            self.take()?;
            if until_touched && self.finger.touch().is_some() {
                self.stop();
                return self.stand_touching();
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

    /// Waits until the robot stands, and tells place and force there.
    fn stand_touching(&mut self) -> Result<Went, GuidedError> {
        self.wait_until_standing()?;
        // Once more, for all that is told is then of a finger that stands.
        let (mut force, mut readings, mut angle_sd) = (Vector2::zeros(), 0.0, 0.0_f64);
        self.places.clear();
        while !self.stands() {
            self.take()?;
            let Some(touch) = self.finger.touch() else { return Ok(Went::CameFree) };
            force += touch.force_finger;
            readings += 1.0;
            angle_sd = angle_sd.max(touch.u_sd);
        }
        let places = self.places.iter().map(|place| place.at.coords);
        let place = Point2::from(places.sum::<Vector2<f64>>() / self.places.len() as f64);
        Ok(Went::Touched(Stand { place, force: force / readings, angle_sd }))
    }

    fn wait_until_standing(&mut self) -> Result<(), GuidedError> {
        self.places.clear();
        loop {
            self.take()?;
            if self.stands() {
                return Ok(());
            }
            if let Some((first, last)) = self.places.first().zip(self.places.last())
                && last.t - first.t > LATE_S
            {
                return Err(GuidedError::DoesNotStand { after_s: last.t - first.t });
            }
        }
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
            self.finger.note_interruption();
            return Err(GuidedError::Interrupted);
        }
        self.finger.take()?;
        let places = self.heard()?;
        self.places.extend(places);
        Ok(())
    }
}
