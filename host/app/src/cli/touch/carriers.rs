//! Who moves the finger: a robot, or a person who is told where to.

use std::collections::VecDeque;
use std::sync::mpsc::{Receiver, TryRecvError};

use nalgebra::{Point2, Vector2};
use palpate::finger::force_guard::ForceStop;
use palpate::gravity::GRAVITY_ASSUMED;
use palpate::inscription::{Approach, Met, NextTouch, PressedFinger, TRUSTED_SD, way_round};
use palpate::pushing::approach_speed::{ApproachLimits, Holding};
use palpate_device::robot::RobotError;
use palpate_files::part::PolygonFile;
use thiserror::Error;

use super::{Ground, MotionArguments};
use crate::live::guided::{GuidedError, GuidedFinger, Stand, Went};
use crate::live::interrupt;
use crate::live::listening::{ListenError, ListeningFinger};
use crate::thesis::demonstration::compliance_by_design;
use crate::width::folded;

/// Why touching ended before its time.
#[derive(Debug, Error)]
pub(crate) enum CarryError {
    /// The robot or the finger.
    #[error(transparent)]
    Guided(#[from] GuidedError),
    /// The finger in a person's hand.
    #[error(transparent)]
    Finger(#[from] ListenError),
    /// Touched where no part can be.
    #[error("the finger touched something at ({:.1}, {:.1}) mm, outside of where the part is said to be", at.x * 1e3, at.y * 1e3)]
    Outside {
        /// The disk's centre, m.
        at: Point2<f64>,
    },
    /// Touched where no pose that is left would be.
    #[error(
        "the finger touched something at ({:.1}, {:.1}) mm, {early_mm:.1} mm before any pose that is left: the part was moved, or it is \
         another", at.x * 1e3, at.y * 1e3
    )]
    Early {
        /// The disk's centre, m.
        at: Point2<f64>,
        /// Before the first pose, mm.
        early_mm: f64,
    },
    /// Touches that end by themselves.
    #[error("the finger touched something at ({:.1}, {:.1}) mm {times} times, and each time it came free while it stopped", at.x * 1e3, at.y * 1e3)]
    CameFree {
        /// Where the robot stood, m.
        at: Point2<f64>,
        /// How often it was tried.
        times: u32,
    },
    /// The robot begins where the part may be.
    #[error("the finger is at ({:.1}, {:.1}) mm, where the part may be", at.x * 1e3, at.y * 1e3)]
    BeginsInside {
        /// The disk's centre, m.
        at: Point2<f64>,
    },
    /// So far away that it counts in another unit.
    #[error("the robot says that it is at ({:.1}, {:.1}) m, {off_m:.0} m from where the part is said to be", at.x, at.y)]
    FarAway {
        /// The disk's centre, m.
        at: Point2<f64>,
        /// How far, m.
        off_m: f64,
    },
    /// Nobody types any more.
    #[error("nobody is at the keyboard any more")]
    Nobody,
}

/// Who moves the finger.
pub(crate) trait Carrier {
    /// Makes an approach. `is_bounded`: what is told of free travel rests on bounds.
    fn make(&mut self, task: Ground, next: &NextTouch, is_bounded: bool) -> Result<Met, CarryError>;
}

/// How fast the finger comes, and what a touch then means.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Speeds {
    /// Of an approach, m/s.
    approach: f64,
    /// Where nothing is, m/s.
    travel: f64,
    /// By how much a touch may move the part, m; none where nobody knows what holds it.
    moved: Option<f64>,
    /// The finger presses with no more than this, N.
    force: f64,
    /// Whether the part may be moved farther than was allowed.
    is_told: bool,
    pub(super) compliance: f64,
    place_sd: f64,
    friction_angle: f64,
}

/// From a force to its being felt: the average over 4 ms, three readings of it, a block of 2 ms, s.
const FELT_AFTER_S: f64 = 8e-3;

/// Readings are averaged over this, s.
pub(super) const AVERAGE_S: f64 = 4e-3;

/// Fastest approach, m/s.
const SPEED_MAX: f64 = 0.02;

/// A touch presses with no more than this share of the force limit: it rings a little.
const LIMIT_SHARE: f64 = 0.7;

/// Friction between finger and part at most, where nothing is said of it.
const MU_C_MAX: f64 = 0.5;

/// How well a compliance is known.
const COMPLIANCE_LOG_SD: f64 = 0.1;

impl Speeds {
    /// For a part that may be any of these.
    pub(crate) fn of(motion: &MotionArguments, files: &[PolygonFile], mass: Option<f64>) -> miette::Result<Self> {
        motion.check_limit()?;
        let limits = motion.limits();
        let held =
            |mass: f64| files.iter().map(move |file| Holding::of_part(&file.part, file.mu * mass * GRAVITY_ASSUMED));
        // The part that is moved most easily counts.
        let holding =
            mass.and_then(|mass| held(mass).min_by(|a, b| a.least_moving_force().total_cmp(&b.least_moving_force())));
        let motion_max = motion.motion_max_mm * 1e-3;
        let safe = match (motion.speed_mm_s, &holding) {
            (Some(speed), Some(holding)) => Some(limits.at_speed(speed * 1e-3, holding)),
            // Nor so fast that the limit ends what is a touch.
            (None, Some(holding)) => limits
                .speed_for(LIMIT_SHARE * motion.force_limit / limits.stiffness)
                .and_then(|fastest| limits.safe_speed(holding, motion_max, fastest.min(SPEED_MAX))),
            (_, None) => None,
        };
        let (approach, force) = match (safe, motion.speed_mm_s) {
            (Some(safe), _) => (safe.speed, safe.force),
            (None, Some(speed)) => (speed * 1e-3, limits.stiffness * limits.overtravel(speed * 1e-3)),
            (None, None) => return Err(no_speed(&limits, holding.as_ref(), motion)),
        };
        motion.check_force(approach, force)?;
        // Of parts whose files say different things, the largest; none where one says nothing.
        let mu_c = files.iter().map(|file| file.mu_c).reduce(|a, b| Some(a?.max(b?))).flatten();
        Ok(Self {
            approach,
            travel: motion.travel_mm_s * 1e-3,
            moved: safe.map(|safe| safe.motion),
            force,
            is_told: motion.speed_mm_s.is_some(),
            compliance: motion.compliance(),
            place_sd: motion.place_sd_mm * 1e-3,
            friction_angle: motion.mu_c_max.or(mu_c).unwrap_or(MU_C_MAX).atan(),
        })
    }

    /// For a part that is held still, whatever it is.
    pub(super) fn held(motion: &MotionArguments) -> miette::Result<Self> {
        motion.check_limit()?;
        let limits = motion.limits();
        let fastest = limits.speed_for(LIMIT_SHARE * motion.force_limit / limits.stiffness);
        let Some(approach) = motion.speed_mm_s.map(|speed| speed * 1e-3).or(fastest.map(|most| most.min(SPEED_MAX)))
        else {
            return Err(no_speed(&limits, None, motion));
        };
        let force = limits.stiffness * limits.overtravel(approach);
        motion.check_force(approach, force)?;
        Ok(Self {
            approach,
            travel: motion.travel_mm_s * 1e-3,
            moved: Some(0.0),
            force,
            is_told: motion.speed_mm_s.is_some(),
            compliance: motion.compliance(),
            place_sd: motion.place_sd_mm * 1e-3,
            friction_angle: motion.mu_c_max.unwrap_or(MU_C_MAX).atan(),
        })
    }

    fn comes(&self) -> String {
        format!("the finger comes at {:.1} mm/s and presses with {:.2} N at most", self.approach * 1e3, self.force)
    }

    /// Says how the finger comes, and whether that is safe.
    pub(crate) fn tell(&self) {
        let holds = match self.moved {
            Some(moved) if moved > 0.0 => format!("that may move the part by {:.3} mm", moved * 1e3),
            Some(_) => "friction holds the part".to_owned(),
            None => "without --mass-kg nobody knows whether that moves the part".to_owned(),
        };
        note!("{}", folded(&format!("{}; {holds}", self.comes())));
    }

    /// Says how the finger comes to a part that is held.
    pub(super) fn tell_held(&self) {
        note!("{}", folded(&format!("{}; the part is to be held still", self.comes())));
    }

    /// What is said where the finger presses.
    fn touch(&self, stand: &Stand) -> Met {
        let pressed = PressedFinger {
            place: stand.place,
            place_sd: self.place_sd,
            force: stand.force,
            compliance: self.compliance,
            compliance_log_sd: COMPLIANCE_LOG_SD,
            friction_angle: self.friction_angle,
            angle_sd: stand.angle_sd,
            moved: self.moved.unwrap_or(0.0),
        };
        Met::Part(pressed.touch())
    }
}

impl MotionArguments {
    /// How far the finger's tip gives way, m/N.
    fn compliance(&self) -> f64 {
        self.compliance_um_per_n.map_or_else(compliance_by_design, |um| um * 1e-6)
    }

    fn limits(&self) -> ApproachLimits {
        ApproachLimits {
            stiffness: 1.0 / self.compliance().max(f64::MIN_POSITIVE),
            threshold: self.touch_force,
            latency: self.robot_latency_ms * 1e-3 + FELT_AFTER_S,
            deceleration: self.robot_deceleration,
        }
    }

    /// A touch is to be felt before the robot is stopped.
    fn check_limit(&self) -> miette::Result<()> {
        if self.touch_force < self.force_limit {
            return Ok(());
        }
        Err(miette::miette!(
            help = "allow more (--force-limit), or feel less (--touch-force)",
            "the robot is stopped above {} N, before a touch begins at {} N",
            self.force_limit,
            self.touch_force
        ))
    }

    /// A speed (m/s) with which the finger presses (N) above the limit is refused.
    fn check_force(&self, approach: f64, force: f64) -> miette::Result<()> {
        if force <= self.force_limit {
            return Ok(());
        }
        Err(miette::miette!(
            help = "come slower (--speed-mm-s), or allow more (--force-limit)",
            "at {:.1} mm/s the finger presses with up to {force:.1} N before it stands, above the limit of {} N",
            approach * 1e3,
            self.force_limit
        ))
    }
}

/// Where no speed can be had.
fn no_speed(limits: &ApproachLimits, holding: Option<&Holding>, motion: &MotionArguments) -> miette::Report {
    match holding {
        None => miette::miette!(
            help = "tell its mass with --mass-kg, or a speed with --speed-mm-s",
            "how fast the finger may come is not known: nothing is said of what holds the part"
        ),
        Some(holding) => miette::miette!(
            help = "fix the part and tell --speed-mm-s, or feel less (--touch-force), or let it move (--motion-max-mm)",
            "no speed is safe: {:.2} N move the part, and only {:.2} N are felt; it would move by {:.3} mm, above {} mm",
            holding.least_moving_force(),
            motion.touch_force,
            limits.at_speed(0.0, holding).motion * 1e3,
            motion.motion_max_mm
        ),
    }
}

/// How often a touch that came free is tried again.
const TRIES: u32 = 3;

/// Beyond what may be touched, m: between approaches the finger goes round this far outside.
const AROUND_M: f64 = 2e-3;

/// Told free travel is left so far before its end, m.
const BEFORE_M: f64 = 3e-3;

/// A robot.
#[derive(Debug)]
pub(crate) struct RobotCarrier {
    finger: GuidedFinger,
    speeds: Speeds,
    has_begun: bool,
}

impl RobotCarrier {
    pub(crate) fn new(finger: GuidedFinger, speeds: Speeds) -> Self {
        Self { finger, speeds, has_begun: false }
    }

    /// To a place where nothing may be.
    fn travel(&mut self, to: Point2<f64>) -> Result<(), CarryError> {
        match self.finger.go(to, self.speeds.travel, true)? {
            Went::There => Ok(()),
            Went::Touched(stand) => Err(CarryError::Outside { at: stand.place }),
            Went::CameFree => Err(CarryError::Outside { at: self.finger.place()? }),
        }
    }
}

/// No arm begins farther from what it touches, m: one that tells millimetres for metres does.
const FAR_M: f64 = 20.0;

/// Refuses a robot at a place that is far from where the part is.
pub(super) fn check_unit(area: [Point2<f64>; 2], at: Point2<f64>) -> Result<(), CarryError> {
    let off_m = outside(area, at);
    if off_m > FAR_M { Err(CarryError::FarAway { at, off_m }) } else { Ok(()) }
}

/// By how much a place is outside of a rectangle, m.
fn outside([low, high]: [Point2<f64>; 2], place: Point2<f64>) -> f64 {
    let beyond = |axis: usize| (low[axis] - place[axis]).max(place[axis] - high[axis]);
    let [x, y] = [beyond(0), beyond(1)];
    if x > 0.0 && y > 0.0 { x.hypot(y) } else { x.max(y) }
}

impl Carrier for RobotCarrier {
    fn make(&mut self, task: Ground, next: &NextTouch, is_bounded: bool) -> Result<Met, CarryError> {
        let around = Vector2::repeat(task.radius + AROUND_M);
        let round = [task.area[0] - around, task.area[1] + around];
        let approach = &next.approach;
        let at = self.finger.place()?;
        let slack = TRUSTED_SD * self.speeds.place_sd;
        if !self.has_begun && outside(round, at) < -slack {
            return Err(CarryError::BeginsInside { at });
        }
        self.has_begun = true;
        for place in way_round(round, at, approach.from) {
            self.travel(place)?;
        }
        let free = next.free_travel - BEFORE_M;
        if is_bounded && free > 0.0 {
            let early = |at: Point2<f64>| early(at, approach, next.free_travel);
            match self.finger.go(approach.at(free), self.speeds.travel, true) {
                Ok(Went::There) => {}
                Ok(Went::Touched(Stand { place: at, .. })) => return Err(early(at)),
                // At this speed a touch is above the limit at once: what stands there is the news.
                Ok(Went::CameFree) | Err(GuidedError::Finger(ListenError::Force(ForceStop::Above { .. }))) => {
                    return Err(early(self.finger.place()?));
                }
                Err(error) => return Err(error.into()),
            }
        }
        for _ in 0..TRIES {
            match self.finger.go(approach.at(approach.length), self.speeds.approach, true)? {
                Went::There => return Ok(Met::Nothing),
                Went::Touched(stand) => {
                    let back = self.finger.go(approach.from, self.speeds.travel, false)?;
                    debug_assert_eq!(back, Went::There, "a way without touches leads there");
                    let met = self.speeds.touch(&stand);
                    return match &met {
                        Met::Part(touch) if outside(task.area, touch.centre) > task.radius + slack + AROUND_M => {
                            Err(CarryError::Outside { at: touch.centre })
                        }
                        _ => Ok(met),
                    };
                }
                Went::CameFree => {
                    note!("the touch ended while the robot stopped; once more");
                    self.finger.go(approach.from, self.speeds.travel, false)?;
                }
            }
        }
        Err(CarryError::CameFree { at: self.finger.place()?, times: TRIES })
    }
}

/// A touch where every pose that is left has the way free so far (m).
fn early(at: Point2<f64>, approach: &Approach, free: f64) -> CarryError {
    let travel = (at - approach.from).dot(&approach.direction);
    CarryError::Early { at, early_mm: (free - travel) * 1e3 }
}

/// A person.
pub(crate) struct PersonCarrier {
    finger: ListeningFinger,
    speeds: Speeds,
    /// None where a recording has what was typed.
    lines: Option<Receiver<Result<String, String>>>,
    /// Recorded lines that are still to be looked at.
    before: VecDeque<String>,
}

/// What the person's lines are called in a recording.
const TYPED: &str = "typed";

impl PersonCarrier {
    pub(crate) fn new(
        finger: ListeningFinger,
        speeds: Speeds,
        lines: Option<Receiver<Result<String, String>>>,
    ) -> Self {
        Self { finger, speeds, lines, before: VecDeque::new() }
    }

    /// What was typed since, if anything.
    fn typed(&mut self) -> Result<Option<String>, CarryError> {
        let Some(lines) = &self.lines else {
            self.before.extend(self.finger.recorded_inputs(TYPED));
            return Ok(self.before.pop_front());
        };
        match lines.try_recv() {
            Ok(Ok(line)) => {
                self.finger.note_input(TYPED, line.clone());
                Ok(Some(line))
            }
            Ok(Err(why)) => {
                note!("that cannot be used: {why}");
                Ok(None)
            }
            Err(TryRecvError::Empty) => Ok(None),
            Err(TryRecvError::Disconnected) => Err(CarryError::Nobody),
        }
    }
}

impl Carrier for PersonCarrier {
    fn make(&mut self, _: Ground, next: &NextTouch, _: bool) -> Result<Met, CarryError> {
        let Approach { from, .. } = next.approach;
        let to = next.approach.at(next.approach.length);
        let [from, to] = [from, to].map(|place| place.coords * 1e3);
        note!(
            "lift the finger over to ({:.1}, {:.1}) mm and move it straight towards ({:.1}, {:.1}) mm, no faster than {:.1} mm/s, until \
             TOUCHED is said. Type `end` if you came there without",
            from.x,
            from.y,
            to.x,
            to.y,
            self.speeds.approach * 1e3
        );
        self.finger.listen()?;
        let mut was_touched = false;
        loop {
            if interrupt::requested() {
                self.finger.note_interruption();
                return Err(GuidedError::Interrupted.into());
            }
            self.finger.take()?;
            let touch = self.finger.touch().copied();
            if touch.is_some() != was_touched {
                was_touched = touch.is_some();
                if let Some(touch) = &touch {
                    let force = touch.magnitude;
                    note!("TOUCHED with {force:.2} N: hold still, and type where the disk's centre is: X Y in mm");
                } else {
                    note!("free again");
                }
            }
            let Some(line) = self.typed()? else { continue };
            match (answered(&line), touch) {
                (Some(Answer::End), None) => return Ok(Met::Nothing),
                (Some(Answer::At(place)), Some(touch)) => {
                    let stand = Stand { place, force: touch.force_finger, angle_sd: touch.u_sd };
                    return Ok(self.speeds.touch(&stand));
                }
                (Some(Answer::Quit), _) => return Err(GuidedError::Interrupted.into()),
                (Some(Answer::End), Some(_)) => note!("the finger still touches: type where it is"),
                (Some(Answer::At(_)), None) => note!("nothing touches the finger: press again, or type `end`"),
                (None, _) => note!("`{line}` is neither two numbers in mm, nor `end`, nor `quit`"),
            }
        }
    }
}

/// What a person says.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Answer {
    At(Point2<f64>),
    End,
    Quit,
}

fn answered(line: &str) -> Option<Answer> {
    match line.split([' ', ',']).filter(|word| !word.is_empty()).collect::<Vec<_>>().as_slice() {
        ["end"] => Some(Answer::End),
        ["quit"] => Some(Answer::Quit),
        [x, y] => {
            let mm = |word: &str| word.parse().ok().filter(|value: &f64| value.is_finite());
            Some(Answer::At(Point2::new(mm(x)?, mm(y)?) * 1e-3))
        }
        _ => None,
    }
}

/// What to do about it.
pub(crate) fn advice(error: &CarryError) -> Option<String> {
    let words = match error {
        CarryError::Guided(error) => return guided(error),
        CarryError::Finger(error) => return listening(error),
        CarryError::Outside { .. } => {
            "is --area-mm in the robot's frame, and is nothing else within the finger's reach? A larger --area-mm holds a part that lies there"
        }
        CarryError::Early { .. } => {
            "hold the part, come slower (--speed-mm-s), or name the right part; then begin anew"
        }
        CarryError::CameFree { .. } => {
            "does the part rock or spring? Come slower (--speed-mm-s), or feel less (--touch-force)"
        }
        CarryError::BeginsInside { .. } => {
            "move the finger beside --area-mm, by its radius and 2 mm at least, before you begin; `palpate simulate-robot` begins where \
             --start-mm says"
        }
        CarryError::FarAway { .. } => "lengths are in metres (docs/ROBOT.md): does it tell millimetres?",
        CarryError::Nobody => return None,
    };
    Some(words.to_owned())
}

fn guided(error: &GuidedError) -> Option<String> {
    let words = match error {
        GuidedError::Robot(RobotError::Silent { .. } | RobotError::Broken { .. }) => {
            "is the robot's program running? It must stop by itself when its line breaks; look before you begin anew"
        }
        GuidedError::Robot(RobotError::Clock { .. }) => {
            "T is a time in seconds by a clock that goes on, in every line (docs/ROBOT.md)"
        }
        GuidedError::Robot(RobotError::NotARobot(_)) => "docs/ROBOT.md says what a robot sends",
        GuidedError::Robot(RobotError::Link(error)) => return crate::advice::help(error),
        GuidedError::Robot(RobotError::Refused(_)) | GuidedError::Interrupted => return None,
        GuidedError::Finger(error) => return listening(error),
        GuidedError::NotThere { .. } | GuidedError::DoesNotStand { .. } => {
            "does the robot carry out `move` and `stop` while it moves? docs/ROBOT.md"
        }
    };
    Some(words.to_owned())
}

fn listening(error: &ListenError) -> Option<String> {
    match error {
        ListenError::Link(error) => crate::advice::help(error),
        ListenError::Force(_) => {
            Some("draw the finger back by hand; come slower (--speed-mm-s), or allow more (--force-limit)".to_owned())
        }
        ListenError::NoSamples(_) => Some("`palpate info` shows what the device and its front-end say".to_owned()),
    }
}
