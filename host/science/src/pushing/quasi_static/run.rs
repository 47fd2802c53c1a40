//! A slow push along the finger's path.
//!
//! While it touches, the part's turn `θ` and the place `ζ` of the disk's centre on its curve about the outline
//! (`geometry::disk_curve`) say where the part is, for the disk's centre is known. Per length of the finger's way
//! they change by `θ' = ω` and `ζ' = −slip − r ω`, on sides and about corners alike. Steps are error-controlled and end
//! where something happens: slip begins or stops, the finger leaves, the centre's curve bends or crosses itself, a foot
//! lifts that cannot be spared.
//!
//! Frames: world, unless named. Units: SI; forces per mass. Time is the finger's way, m.

use nalgebra::{Point2, Rotation2, Vector2};

use super::instant::{Asked, Instant, Near, Touching};
use super::support::{Ground, Support};
use crate::geometry::disk_curve::{DiskCurve, Element, INTO_LEAST, Place, TOUCHES_M};
use crate::geometry::{Pose, SimplePolygon};
use crate::math::dormand_prince::{ERROR, NODES, STAGES, growth, moved};
use crate::point_sampling::contains;
use crate::search::{Halt, Stop};

/// Error of a step that is accepted, in rad and in sizes of the part: some hundred of them, even where they grow, leave
/// more than a hundred times less than the millionth that matters.
const STEP_TOLERANCE: f64 = 1e-11;

/// Shorter steps than this, in sizes of the part, are not taken: what fails there fails.
const STEP_LEAST: f64 = 1e-12;

/// An event is located to this, in sizes of the part.
const EVENT_PLACE: f64 = 1e-13;

/// Steps are not shortened below this, in sizes of the part, for what happens at their stages and not at their end.
const GLIMPSE_LEAST: f64 = 1e-6;

/// What happens at a stage by less than this is the stage's own error.
const GLIMPSE: f64 = 1e-9;

/// A motion that cannot be followed farther while the finger goes into the part by less than this is one that it leaves:
/// where the part would slide along the finger, the part gets ever faster for the little that the finger goes into it.
const INTO_LOST: f64 = 1e-6;

/// Where the finger goes into the part by no more than this it leaves: a turn of so much is lost, and nearer to none
/// the motion is one rounding divided by another.
const INTO_LEAVES: f64 = 1e-9;

/// Directions of a path that differ by less than this make no corner, rad: places on a line are rounded.
const STRAIGHT_RAD: f64 = 1e-9;

/// A force this share beyond its cone still sticks: rounding.
const CONE_ROUNDING: f64 = 1e-10;

/// Slip this much the wrong way has just begun: the finger's speed is 1.
const SLIP_ROUNDING: f64 = 1e-6;

/// So many changes at one place are a quarrel of roundings; a short step is then taken in either mode.
const CHANGES_AT_A_PLACE: usize = 6;

/// Length of such a step, in sizes of the part.
const SETTLING_STEP: f64 = 1e-7;

/// So many such steps on one straight piece of the path are no rounding: no motion lasts.
const SETTLING_STEPS: usize = 1000;

/// A slow push: all that decides how it goes.
#[derive(Clone, Debug)]
pub struct SlowPush {
    /// The part.
    pub outline: SimplePolygon,
    /// What it stands on.
    pub support: Support,
    /// Where its weight acts, part frame, m; none: where the support says.
    pub centre_of_mass: Option<Point2<f64>>,
    /// Gravity, m/s².
    pub gravity: f64,
    /// Of the contact above the plane, m.
    pub height: f64,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Friction between finger and part while it slides, and the largest while it sticks.
    pub contact_friction: [f64; 2],
    /// The disk's centre, straight between, m.
    pub path: Vec<Point2<f64>>,
    /// Where the part lies before.
    pub pose: Pose,
    /// The longest step, m.
    pub step_max: f64,
}

/// Why a slow push cannot be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SlowPushError {
    /// The finger begins inside the part.
    #[error(
        "the finger overlaps the part by {depth:?} m where the path begins, at most {TOUCHES_M:e} m may be rounding: begin farther away, or check the radius"
    )]
    Overlap {
        /// How deep, m.
        depth: f64,
    },
    /// Nothing resists.
    #[error("nothing resists the part, whose slow motion is then not determined: give friction and gravity above 0")]
    NoFriction,
    /// The load of feet on a line does not follow a push above the plane.
    #[error(
        "feet on one line do not hold a part that is pushed above the plane: add a foot beside it, or take height 0"
    )]
    FeetOnALine,
    /// Asked to end.
    #[error("ended after {length:?} m of the path, as asked")]
    Stopped {
        /// How far the finger has gone, m.
        length: f64,
    },
    /// Changes without end at one place.
    #[error("the contact changes without end after {length:?} m of the path")]
    Stuck {
        /// How far the finger has gone, m.
        length: f64,
    },
}

/// What the contact does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlowMode {
    /// No slip.
    Sticking,
    /// Slip.
    Sliding,
}

/// The contact at a sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlowContact {
    /// m.
    pub at: Point2<f64>,
    /// Direction of the part's outward normal, rad, in (−π, π].
    pub normal_angle: f64,
    /// Edge or vertex.
    pub element: Element,
    /// What it does.
    pub mode: SlowMode,
    /// On the part per mass, m/s².
    pub force: Vector2<f64>,
}

/// The part where the finger passes a point of its path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlowSample {
    /// Its turn counts on from the start.
    pub pose: Pose,
    /// None where the finger is free.
    pub contact: Option<SlowContact>,
}

/// Why a slow push ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlowEnd {
    /// The path is over.
    Path,
    /// The disk meets a second point of the outline.
    SecondContact,
    /// No load fits: the part tips.
    Tip,
}

/// A change of what the contact does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlowChange {
    /// How far the finger had gone, m.
    pub length: f64,
    /// What it does from there on; none where the finger leaves.
    pub to: Option<SlowMode>,
}

/// How a slow push went.
#[derive(Clone, Debug, PartialEq)]
pub struct SlowRun {
    /// One at each point of the path up to the end, of the motion that arrives there.
    pub samples: Vec<SlowSample>,
    /// Touches, slip and partings, in order; what lasts no longer than rounding is left out.
    pub changes: Vec<SlowChange>,
    /// Why it ended.
    pub end: SlowEnd,
    /// How far the finger has gone, m.
    pub length: f64,
}

/// How the contact moves on.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Mode {
    Stick,
    /// With the sign of the part's velocity along `t` relative to the finger.
    Slide(f64),
}

impl Mode {
    fn told(self) -> SlowMode {
        match self {
            Self::Stick => SlowMode::Sticking,
            Self::Slide(_) => SlowMode::Sliding,
        }
    }
}

/// While it touches.
#[derive(Clone, Copy, Debug)]
struct Contact {
    mode: Mode,
    place: Place,
    theta: f64,
    instant: Instant,
}

#[derive(Clone, Copy, Debug)]
enum State {
    Free(Pose),
    Touching(Contact),
}

/// What may happen, as numbers that are not negative until it does.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Watched {
    /// The finger's motion into the part, beyond that with which it leaves.
    into: f64,
    /// What is left before slip begins or stops.
    mode: f64,
    /// The least load that cannot be spared.
    load: f64,
    /// To the ends of the feature, m.
    back: f64,
    on: f64,
}

impl Watched {
    fn least(&self) -> f64 {
        [self.into, self.mode, self.load, self.back, self.on].into_iter().fold(f64::INFINITY, f64::min)
    }
}

/// An instant within a step.
#[derive(Clone, Copy)]
struct Look {
    slope: [f64; 2],
    instant: Instant,
    watched: Watched,
}

/// A step and what it came to.
struct Step {
    end: [f64; 2],
    last: Look,
    error: f64,
    /// The least of what is left before slip changes, at the stages between.
    glimpsed: f64,
}

/// A stretch of the path in one direction with one contact: what a step needs.
struct Stretch<'a> {
    push: &'a SlowPush,
    ground: &'a Ground,
    outline: &'a DiskCurve,
    centre: Point2<f64>,
    direction: Vector2<f64>,
    mode: Mode,
    place: Place,
    ends: [f64; 2],
}

impl SlowPush {
    /// Follows the push.
    ///
    /// # Errors
    /// [`SlowPushError`].
    pub fn run(&self, stop: Stop<'_>) -> Result<SlowRun, SlowPushError> {
        let halt = Halt::new(stop);
        let ground = self.checked()?;
        let outline = DiskCurve::new(&self.outline, self.radius);
        let mut run = Following {
            push: self,
            ground: &ground,
            outline: &outline,
            halt: &halt,
            state: State::Free(self.pose),
            gone: 0.0,
            into_least: INTO_LEAST,
            changes: Vec::new(),
        };
        run.follow()
    }

    /// The support, if a slow push on it is one.
    fn checked(&self) -> Result<Ground, SlowPushError> {
        if self.support.friction_max() * self.gravity == 0.0 {
            return Err(SlowPushError::NoFriction);
        }
        let ground = Ground::new(&self.support, &self.outline, self.height, self.centre_of_mass);
        if self.height > 0.0 && self.support.is_on_a_line(ground.size) {
            return Err(SlowPushError::FeetOnALine);
        }
        let centre = self.pose.isometry().inverse_transform_point(&self.path[0]);
        let outline = DiskCurve::new(&self.outline, self.radius);
        let distance = outline.distance(centre);
        let inside = contains(&self.outline, centre) == Some(true);
        let depth = self.radius + if inside { distance } else { -distance };
        if depth > TOUCHES_M {
            return Err(SlowPushError::Overlap { depth });
        }
        Ok(ground)
    }
}

/// A push on its way.
struct Following<'a> {
    push: &'a SlowPush,
    ground: &'a Ground,
    outline: &'a DiskCurve,
    halt: &'a Halt<'a>,
    state: State,
    gone: f64,
    /// By how much the finger has to go into the part for a touch: more, up to the next corner of the path, where it
    /// has just left with what is lost in rounding.
    into_least: f64,
    changes: Vec<SlowChange>,
}

impl<'a> Following<'a> {
    fn follow(&mut self) -> Result<SlowRun, SlowPushError> {
        let path = &self.push.path;
        let mut samples = Vec::with_capacity(path.len());
        let mut before: Option<Vector2<f64>> = None;
        let mut waiting = 1;
        for pair in path.windows(2) {
            let way = pair[1] - pair[0];
            let length = way.norm();
            if length == 0.0 {
                match samples.last().copied() {
                    Some(sample) => samples.push(sample),
                    None => waiting += 1,
                }
                continue;
            }
            let direction = way / length;
            let turns =
                before.is_none_or(|before| before.perp(&direction).atan2(before.dot(&direction)).abs() > STRAIGHT_RAD);
            before = Some(direction);
            if turns {
                self.into_least = INTO_LEAST;
            }
            let mut begun = turns.then(|| self.turn(pair[0], direction)).flatten();
            self.note_change();
            if samples.is_empty() {
                // The motion that begins; a finger that touches from the first shows it.
                if begun.is_none() && matches!(self.state, State::Free(_)) {
                    begun = self.touch(pair[0], direction, 0.0, TOUCHES_M).and_then(|(_, end)| end);
                    self.note_change();
                }
                let sample = self.sample(pair[0]);
                samples.extend(std::iter::repeat_n(sample, waiting));
            }
            let end = match begun {
                Some(end) => Some(end),
                None => self.go(pair[0], direction, length)?,
            };
            if let Some(end) = end {
                return Ok(self.ended(samples, end));
            }
            samples.push(self.sample(pair[1]));
        }
        if samples.is_empty() {
            samples.extend(std::iter::repeat_n(self.sample(path[0]), waiting));
        }
        Ok(self.ended(samples, SlowEnd::Path))
    }

    fn ended(&mut self, samples: Vec<SlowSample>, end: SlowEnd) -> SlowRun {
        SlowRun { samples, changes: std::mem::take(&mut self.changes), end, length: self.gone }
    }

    /// Notes what the contact does now, if that is new.
    fn note_change(&mut self) {
        let to = match &self.state {
            State::Free(_) => None,
            State::Touching(contact) => Some(contact.mode.told()),
        };
        let (length, rounding) = (self.gone, SETTLING_STEP * self.ground.size);
        // What was begun here a rounding ago was nothing.
        while self.changes.last().is_some_and(|last| last.to != to && length - last.length <= rounding) {
            self.changes.pop();
        }
        if self.changes.last().and_then(|last| last.to) != to {
            self.changes.push(SlowChange { length, to });
        }
    }

    /// At a corner of the path the contact begins anew, or ends.
    fn turn(&mut self, centre: Point2<f64>, direction: Vector2<f64>) -> Option<SlowEnd> {
        let State::Touching(contact) = self.state else { return None };
        let touched = self.outline.touched(contact.place);
        let normal = Rotation2::new(contact.theta) * touched.normal;
        if -normal.dot(&direction) <= INTO_LEAST {
            self.state = State::Free(self.pose(centre));
            return None;
        }
        self.decide(centre, direction, contact.place, contact.theta, Some(&Near::from(&contact.instant)))
    }

    /// Follows the finger straight on from a point, and says what ended the push on the way.
    fn go(
        &mut self,
        from: Point2<f64>,
        direction: Vector2<f64>,
        length: f64,
    ) -> Result<Option<SlowEnd>, SlowPushError> {
        let begun = self.gone;
        let mut done = 0.0;
        let (mut changes, mut settled) = (0, 0);
        loop {
            let State::Touching(contact) = self.state else {
                let Some((after, end)) = self.touch(from + direction * done, direction, done, length - done) else {
                    break;
                };
                done = after;
                self.gone = begun + done;
                self.note_change();
                if end.is_some() {
                    return Ok(end);
                }
                continue;
            };
            if done >= length {
                break;
            }
            let before = done;
            let end = self.push_on(contact, from, direction, &mut done, length, changes)?;
            self.gone = begun + done;
            self.note_change();
            if end.is_some() {
                return Ok(end);
            }
            settled += usize::from(changes > CHANGES_AT_A_PLACE);
            changes = if done - before > STEP_LEAST * self.ground.size { 0 } else { changes + 1 };
            if settled > SETTLING_STEPS || changes > 2 * CHANGES_AT_A_PLACE {
                return Err(SlowPushError::Stuck { length: self.gone });
            }
        }
        self.gone = begun + length;
        Ok(None)
    }

    /// The finger goes on, free, up to a touch within `length`: after how much of the way, and whether that ends it.
    fn touch(
        &mut self,
        centre: Point2<f64>,
        direction: Vector2<f64>,
        done: f64,
        length: f64,
    ) -> Option<(f64, Option<SlowEnd>)> {
        let State::Free(pose) = self.state else { return None };
        let isometry = pose.isometry();
        let [centre_part, direction_part] =
            [isometry.inverse_transform_point(&centre).coords, isometry.rotation.inverse() * direction];
        let (after, place) =
            self.outline.first_touch(Point2::from(centre_part), direction_part, length, self.into_least)?;
        let end = self.decide(centre + direction * after, direction, place, pose.theta, None);
        Some((done + after, end))
    }

    /// Sticks if it can, slides otherwise; without a motion of either kind the part tips.
    fn decide(
        &mut self,
        centre: Point2<f64>,
        direction: Vector2<f64>,
        place: Place,
        theta: f64,
        near: Option<&Near>,
    ) -> Option<SlowEnd> {
        let stretch = |mode| self.stretch(centre, direction, mode, place);
        let state = [theta, place.along];
        let stick = stretch(Mode::Stick).look_anew(state, near);
        let cone = CONE_ROUNDING * self.ground.friction;
        let found = match &stick {
            Some(look) if look.watched.mode >= -cone => Some((Mode::Stick, *look)),
            Some(look) => self.slide(centre, direction, place, theta, look),
            None => [1.0, -1.0].into_iter().find_map(|sign| {
                let look = stretch(Mode::Slide(sign)).look_anew(state, near)?;
                (look.watched.mode >= 0.0).then_some((Mode::Slide(sign), look))
            }),
        };
        let found = found.filter(|(_, look)| look.watched.load >= 0.0);
        let contact = |(mode, look): (Mode, Look)| Contact { mode, place, theta, instant: look.instant };
        match found {
            Some(found) => {
                self.state = State::Touching(contact(found));
                None
            }
            None => self.leave_or(SlowEnd::Tip, centre, direction, place, theta),
        }
    }

    /// Without a motion the finger leaves, if what it goes into the part is lost in rounding; otherwise this ends.
    fn leave_or(
        &mut self,
        end: SlowEnd,
        centre: Point2<f64>,
        direction: Vector2<f64>,
        place: Place,
        theta: f64,
    ) -> Option<SlowEnd> {
        let normal = Rotation2::new(theta) * self.outline.touched(place).normal;
        if -normal.dot(&direction) >= INTO_LOST {
            return Some(end);
        }
        self.state = State::Free(self.pose_at(centre, place, theta));
        // Else it would touch again at once.
        self.into_least = 2.0 * INTO_LOST;
        None
    }

    /// How it slides where it cannot stick: against the force that sticking would take. Above the plane that may be
    /// no motion; then the other way is tried.
    fn slide(
        &self,
        centre: Point2<f64>,
        direction: Vector2<f64>,
        place: Place,
        theta: f64,
        stuck: &Look,
    ) -> Option<(Mode, Look)> {
        let against = -self.tangential(place, stuck);
        let near = Near::from(&stuck.instant);
        [against, -against].into_iter().find_map(|sign| {
            let mode = Mode::Slide(sign);
            let look = self.stretch(centre, direction, mode, place).look_anew([theta, place.along], Some(&near))?;
            (look.watched.mode >= -SLIP_ROUNDING).then_some((mode, look))
        })
    }

    /// The sign of the force along `t`.
    fn tangential(&self, place: Place, look: &Look) -> f64 {
        let normal = self.outline.touched(place).normal;
        normal.perp(&look.instant.force).signum()
    }

    fn stretch(&self, centre: Point2<f64>, direction: Vector2<f64>, mode: Mode, place: Place) -> Stretch<'a> {
        let ends = self.outline.bounds(place).map(|bound| bound.along);
        Stretch { push: self.push, ground: self.ground, outline: self.outline, centre, direction, mode, place, ends }
    }

    /// Follows one contact until something happens or `length` is reached.
    fn push_on(
        &mut self,
        contact: Contact,
        from: Point2<f64>,
        direction: Vector2<f64>,
        done: &mut f64,
        length: f64,
        changes: usize,
    ) -> Result<Option<SlowEnd>, SlowPushError> {
        let size = self.ground.size;
        let settle = changes > CHANGES_AT_A_PLACE;
        let mut stretch = self.stretch(from + direction * *done, direction, contact.mode, contact.place);
        let bounds = self.outline.bounds(contact.place);
        let mut state = [contact.theta, contact.place.along];
        let Some(mut look) = stretch.look(state, Some(&Near::from(&contact.instant))) else {
            return Ok(self.leave_or(SlowEnd::Tip, stretch.centre, direction, contact.place, contact.theta));
        };
        let mut step = self.push.step_max;
        loop {
            if self.halt.is_wished() {
                return Err(SlowPushError::Stopped { length: self.gone });
            }
            let rest = length - *done;
            let is_last = step >= rest;
            let tried = if settle { rest.min(SETTLING_STEP * size) } else { step.min(rest) };
            let Some(taken) = stretch.step(state, &look, tried) else {
                step = 0.5 * tried;
                if step < STEP_LEAST * size {
                    self.touching(contact, state, &look);
                    return Ok(self.lost(&stretch, state, &look, changes));
                }
                continue;
            };
            // Written so that NaN is too large.
            let is_exact = taken.error <= 1.0;
            if !is_exact && tried > STEP_LEAST * size {
                step = tried * growth(taken.error);
                continue;
            }
            let happens = taken.last.watched.least() < 0.0;
            if !happens && taken.glimpsed < -GLIMPSE && tried > GLIMPSE_LEAST * size {
                step = 0.5 * tried;
                continue;
            }
            let (tried, taken) =
                if happens && !settle { stretch.event(state, &look, tried, taken) } else { (tried, taken) };
            state = taken.end;
            look = taken.last;
            *done = if is_last && !happens && !settle { length } else { *done + tried };
            stretch.centre = from + direction * *done;
            self.touching(contact, state, &look);
            if settle {
                return Ok(None);
            }
            if happens {
                return Ok(self.change(&stretch, state, &look, &bounds));
            }
            if *done >= length {
                return Ok(None);
            }
            step = (tried * growth(taken.error)).min(self.push.step_max);
        }
    }

    /// What becomes of a motion that cannot be followed farther.
    fn lost(
        &mut self,
        stretch: &Stretch<'_>,
        [theta, along]: [f64; 2],
        look: &Look,
        changes: usize,
    ) -> Option<SlowEnd> {
        let place = Place { along, ..stretch.place };
        // The part may go on in another way; if that leads nowhere, it tips.
        if changes > 0 || look.watched.into < INTO_LOST {
            return self.leave_or(SlowEnd::Tip, stretch.centre, stretch.direction, place, theta);
        }
        self.decide(stretch.centre, stretch.direction, place, theta, None)
    }

    fn touching(&mut self, contact: Contact, [theta, along]: [f64; 2], look: &Look) {
        let place = Place { along, ..contact.place };
        self.state = State::Touching(Contact { place, theta, instant: look.instant, ..contact });
    }

    /// What happens at the end of a stretch.
    fn change(
        &mut self,
        stretch: &Stretch<'_>,
        [theta, along]: [f64; 2],
        look: &Look,
        bounds: &[crate::geometry::disk_curve::Bound; 2],
    ) -> Option<SlowEnd> {
        let watched = look.watched;
        let least = watched.least();
        let place = Place { along, ..stretch.place };
        let near = Near::from(&look.instant);
        if watched.load <= least {
            return Some(SlowEnd::Tip);
        }
        if watched.into <= least {
            return self.leave_or(SlowEnd::Tip, stretch.centre, stretch.direction, place, theta);
        }
        if watched.mode <= least {
            return match stretch.mode {
                Mode::Slide(_) => self.decide(stretch.centre, stretch.direction, place, theta, Some(&near)),
                Mode::Stick => {
                    let slid = self.slide(stretch.centre, stretch.direction, place, theta, look);
                    let Some((mode, look)) = slid else {
                        return self.leave_or(SlowEnd::Tip, stretch.centre, stretch.direction, place, theta);
                    };
                    self.state = State::Touching(Contact { mode, place, theta, instant: look.instant });
                    None
                }
            };
        }
        let bound = if watched.back <= least { bounds[0] } else { bounds[1] };
        let Some(next) = bound.next else { return Some(SlowEnd::SecondContact) };
        self.state = State::Touching(Contact { mode: stretch.mode, place: next, theta, instant: look.instant });
        None
    }

    fn pose(&self, centre: Point2<f64>) -> Pose {
        match &self.state {
            State::Free(pose) => *pose,
            State::Touching(contact) => self.pose_at(centre, contact.place, contact.theta),
        }
    }

    fn pose_at(&self, centre: Point2<f64>, place: Place, theta: f64) -> Pose {
        let touched = self.outline.touched(place);
        let origin = centre - Rotation2::new(theta) * (touched.at.coords + touched.normal * self.push.radius);
        Pose { x: origin.x, y: origin.y, theta }
    }

    fn sample(&self, centre: Point2<f64>) -> SlowSample {
        let pose = self.pose(centre);
        let State::Touching(contact) = &self.state else { return SlowSample { pose, contact: None } };
        let touched = self.outline.touched(contact.place);
        let turn = Rotation2::new(contact.theta);
        let normal = turn * touched.normal;
        let contact = SlowContact {
            at: centre - normal * self.push.radius,
            normal_angle: normal.y.atan2(normal.x),
            element: self.outline.element(contact.place),
            mode: contact.mode.told(),
            force: turn * contact.instant.force * self.push.gravity,
        };
        SlowSample { pose, contact: Some(contact) }
    }
}

impl Stretch<'_> {
    /// The rates at a turn and a place, and what may happen.
    fn look(&self, state: [f64; 2], near: Option<&Near>) -> Option<Look> {
        self.look_by(state, |asked| self.ground.motion(asked, near))
    }

    /// The same, whatever it takes.
    fn look_anew(&self, state: [f64; 2], near: Option<&Near>) -> Option<Look> {
        self.look_by(state, |asked| self.ground.motion_anew(asked, near))
    }

    fn look_by(&self, [theta, along]: [f64; 2], find: impl Fn(&Asked) -> Option<Instant>) -> Option<Look> {
        let place = Place { along, ..self.place };
        let touched = self.outline.touched(place);
        let touching = Touching { at: touched.at - self.ground.centre, normal: touched.normal };
        let velocity = Rotation2::new(-theta) * self.direction;
        let [sliding, sticking] = self.push.contact_friction;
        let force = match self.mode {
            Mode::Stick => None,
            Mode::Slide(sign) => Some((-touched.normal - touching.tangent() * (sign * sliding)).normalize()),
        };
        let instant = find(&Asked { touching, velocity, force })?;
        let mode = match self.mode {
            Mode::Slide(sign) => sign * instant.slip,
            Mode::Stick => {
                let (normal, tangential) = (-touched.normal.dot(&instant.force), touched.normal.perp(&instant.force));
                sticking * normal - tangential.abs()
            }
        };
        let watched = Watched {
            into: -touched.normal.dot(&velocity) - INTO_LEAVES,
            mode,
            load: self.ground.load_least(&instant.load),
            back: along - self.ends[0],
            on: self.ends[1] - along,
        };
        let slope = [instant.omega, -instant.slip - self.push.radius * instant.omega];
        Some(Look { slope, instant, watched })
    }

    /// A step of some length.
    fn step(&self, start: [f64; 2], first: &Look, length: f64) -> Option<Step> {
        let mut slopes = [[0.0; 2]; 7];
        slopes[0] = first.slope;
        let (mut end, mut last, mut glimpsed) = (start, *first, f64::INFINITY);
        for stage in 1..NODES.len() {
            end = moved(start, &slopes, &STAGES[stage], length);
            last = self.look(end, Some(&Near::from(&last.instant)))?;
            slopes[stage] = last.slope;
            if stage + 2 < NODES.len() {
                glimpsed = glimpsed.min(last.watched.mode);
            }
        }
        let error = moved([0.0; 2], &slopes, &ERROR, length);
        let error = error[0].abs().max(error[1].abs() / self.ground.size) / STEP_TOLERANCE;
        Some(Step { end, last, error, glimpsed })
    }

    /// The shortest step, up to one at whose end something has happened, to where it has.
    fn event(&self, start: [f64; 2], first: &Look, length: f64, step: Step) -> (f64, Step) {
        let tight = EVENT_PLACE * self.ground.size;
        let (mut low, mut low_value) = (0.0, first.watched.least().max(0.0));
        let (mut high, mut high_value, mut found) = (length, step.last.watched.least(), step);
        let (mut low_weight, mut high_weight, mut kept) = (1.0, 1.0, 0);
        let mut turn = 0;
        while high - low > tight && turn < 100 {
            let (a, b) = (low_value * low_weight, high_value * high_weight);
            let secant = low + (high - low) * a / (a - b);
            let halves = turn % 3 == 2 || low_value == 0.0 || !(low < secant && secant < high);
            let at = if halves { 0.5 * (low + high) } else { secant };
            turn += 1;
            if at <= low || at >= high {
                break;
            }
            let Some(step) = self.step(start, first, at) else {
                high = at;
                continue;
            };
            let value = step.last.watched.least();
            if value < 0.0 {
                (high, high_value, found) = (at, value, step);
                (high_weight, low_weight) = (1.0, if kept == 1 { 0.5 * low_weight } else { 1.0 });
                kept = 1;
            } else {
                (low, low_value) = (at, value);
                (low_weight, high_weight) = (1.0, if kept == 2 { 0.5 * high_weight } else { 1.0 });
                kept = 2;
            }
        }
        (high, found)
    }
}
