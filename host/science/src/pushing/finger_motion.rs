//! How a finger moves that begins at rest: stretches of constant acceleration.
//!
//! A motion is given at once, or piece by piece by whoever moves the finger. Robots limit their jerk: where an acceleration
//! is told to rise from the one before, it does so in steps of a millisecond or less.
//!
//! Frames: finger axes, which the disk keeps because it does not turn; the origin is wherever `start` counts from.
//! Units: SI. Errors: [`MotionError`] names the segment, the value, the limit and what to do.

use nalgebra::{Point2, Vector2};
use serde::Deserialize;

use crate::pushing::dynamics::Finger;

/// Most segments: an hour of a robot's commands at 100 Hz.
pub const SEGMENTS_MAX: usize = 360_000;

/// A motion from rest.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::FingerMotion;
/// use palpate::pushing::finger_motion::Segment;
///
/// let turn = [Vector2::new(0.15, 0.0), Vector2::new(0.0, 0.15)];
/// let segments = turn.map(|acceleration| Segment { seconds: 0.3, acceleration });
/// let motion = FingerMotion::new(Point2::origin(), &segments)?; // ahead, then aside
/// assert!((motion.duration() - 0.6).abs() < 1e-15); // s
/// # Ok::<(), palpate::pushing::finger_motion::MotionError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct FingerMotion {
    start: Point2<f64>,
    segments: Vec<Segment>,
}

/// A stretch of constant acceleration.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Segment {
    /// How long it lasts, s.
    pub seconds: f64,
    /// Along the finger's axes, m/s².
    #[serde(deserialize_with = "crate::math::arrays::vector::deserialize")]
    pub acceleration: Vector2<f64>,
}

/// A stretch as one tells it: its acceleration is reached from the one before, steadily, and then constant.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RisingSegment {
    /// How long it lasts, its rise included, s.
    pub seconds: f64,
    /// In the end, along the finger's axes, m/s².
    #[serde(deserialize_with = "crate::math::arrays::vector::deserialize")]
    pub acceleration: Vector2<f64>,
    /// How long its acceleration takes to go over from the one before (of the first segment from none), s; 0 by default.
    #[serde(default)]
    pub rise_seconds: f64,
}

/// In steps as long as this an acceleration rises, s: the finger is within `a h²/12` (h this step) of a steady rise, tens of
/// nanometres, and what a sensor averages over is longer.
const RISE_STEP_S: f64 = 1e-3;

/// A stretch of the motion with what went before it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leg {
    /// When it begins, s.
    pub from: f64,
    /// When it ends, s.
    pub to: f64,
    /// The finger, in time since `from`.
    pub finger: Finger,
    /// How it turns about the disk's centre, and the sensor with it, in time since `from`.
    pub turn: LegTurn,
}

/// How a finger turns meanwhile; by default it does not.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LegTurn {
    /// From the world's axes to the sensor's at the beginning, rad.
    pub angle0: f64,
    /// Its rate then, rad/s.
    pub rate0: f64,
    /// Of the rate, rad/s².
    pub acceleration: f64,
}

impl LegTurn {
    /// Whether the sensor's axes stay as they are.
    pub(in crate::pushing) fn is_still(&self) -> bool {
        self.rate0 == 0.0 && self.acceleration == 0.0
    }

    /// The turn at a time (s) since the beginning, rad.
    pub(in crate::pushing) fn angle(&self, time: f64) -> f64 {
        self.angle0 + self.rate0 * time + 0.5 * self.acceleration * time * time
    }
}

/// Why a motion is none.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MotionError {
    /// A motion without any segment.
    #[error("the motion has no segments: give at least one [[segment]] with `seconds` and `acceleration`")]
    Empty,
    /// More segments than [`SEGMENTS_MAX`].
    #[error("the motion has {count} segments: at most {SEGMENTS_MAX} are possible")]
    TooMany {
        /// How many segments were given.
        count: usize,
    },
    /// A length of time that cannot be.
    #[error("segment {index}: seconds = {seconds:?}, but a time is finite and above 0")]
    Seconds {
        /// Place of the segment in the motion, from 0.
        index: usize,
        /// Duration as given, s.
        seconds: f64,
    },
    /// An acceleration that is no number.
    #[error("segment {index}: acceleration = [{:?}, {:?}] must be finite", .acceleration.x, .acceleration.y)]
    Acceleration {
        /// Place of the segment in the motion, from 0.
        index: usize,
        /// Components as given, world axes, m/s².
        acceleration: Vector2<f64>,
    },
    /// An acceleration that is reached when its segment is over, or before it begins.
    #[error(
        "segment {index}: rise_seconds = {rise_seconds:?}, but the acceleration is reached within the segment: from 0 to {seconds:?}"
    )]
    Rise {
        /// Place of the segment in the motion, from 0.
        index: usize,
        /// As given, s.
        rise_seconds: f64,
        /// Of the segment, s.
        seconds: f64,
    },
    /// The finger would stay at rest.
    #[error(
        "segment 0 has no acceleration: the motion starts at rest, and its clock starts when the finger begins to push"
    )]
    AtRest,
    /// A start that is no number.
    #[error("start = [{:?}, {:?}] must be finite", .0.x, .0.y)]
    Start(Point2<f64>),
}

impl Segment {
    /// Whether it can be the `index`-th of a motion.
    fn check(&self, index: usize) -> Result<(), MotionError> {
        let Self { seconds, acceleration } = *self;
        if !(seconds.is_finite() && seconds > 0.0) {
            return Err(MotionError::Seconds { index, seconds });
        }
        if !acceleration.iter().all(|value| value.is_finite()) {
            return Err(MotionError::Acceleration { index, acceleration });
        }
        if index == 0 && acceleration == Vector2::zeros() {
            return Err(MotionError::AtRest);
        }
        Ok(())
    }
}

impl FingerMotion {
    /// A motion that begins at rest at `start`, m.
    ///
    /// ```
    /// use nalgebra::{Point2, Vector2};
    /// use palpate::pushing::finger_motion::{FingerMotion, Segment};
    ///
    /// let ahead = Segment { seconds: 0.5, acceleration: Vector2::new(0.1, 0.0) };
    /// let motion = FingerMotion::new(Point2::origin(), &[ahead])?;
    /// assert!((motion.centre(0.5).x - 0.0125).abs() < 1e-12); // a t²/2, m
    /// # Ok::<(), palpate::pushing::finger_motion::MotionError>(())
    /// ```
    ///
    /// # Errors
    /// [`MotionError`] names the first thing found wrong.
    pub fn new(start: Point2<f64>, segments: &[Segment]) -> Result<Self, MotionError> {
        if !start.iter().all(|value| value.is_finite()) {
            return Err(MotionError::Start(start));
        }
        let mut motion = Self { start, segments: Vec::new() };
        segments.iter().try_for_each(|&segment| motion.append(segment))?;
        if motion.segments.is_empty() { Err(MotionError::Empty) } else { Ok(motion) }
    }

    /// The same of segments whose accelerations may rise.
    ///
    /// ```
    /// use nalgebra::{Point2, Vector2};
    /// use palpate::FingerMotion;
    /// use palpate::pushing::finger_motion::RisingSegment;
    ///
    /// let ahead = RisingSegment { seconds: 0.5, acceleration: Vector2::new(0.1, 0.0), rise_seconds: 0.02 };
    /// let motion = FingerMotion::rising(Point2::origin(), &[ahead])?;
    /// assert!((motion.acceleration(0.01).x - 0.05).abs() < 3e-3); // m/s², half way
    /// # Ok::<(), palpate::pushing::finger_motion::MotionError>(())
    /// ```
    ///
    /// # Errors
    /// [`MotionError`] names the first thing found wrong.
    pub fn rising(start: Point2<f64>, segments: &[RisingSegment]) -> Result<Self, MotionError> {
        let mut motion = Self { start, segments: Vec::new() };
        segments.iter().enumerate().try_for_each(|(index, &segment)| motion.append_rising(index, segment))?;
        Self::new(start, &motion.segments)
    }

    /// A motion for who asks none of it: the finger's places are measured.
    #[must_use]
    pub fn untold() -> Self {
        Self { start: Point2::origin(), segments: vec![Segment { seconds: 1.0, acceleration: Vector2::x() }] }
    }

    /// Adds a segment at the end.
    ///
    /// # Errors
    /// [`MotionError`] if it cannot be.
    pub fn append(&mut self, segment: Segment) -> Result<(), MotionError> {
        let index = self.segments.len();
        segment.check(index)?;
        if index >= SEGMENTS_MAX {
            return Err(MotionError::TooMany { count: index + 1 });
        }
        self.segments.push(segment);
        Ok(())
    }

    /// Adds a segment whose acceleration may rise, the `index`-th of those told, counted from 0.
    ///
    /// # Errors
    /// [`MotionError`] if it cannot be.
    pub fn append_rising(&mut self, index: usize, segment: RisingSegment) -> Result<(), MotionError> {
        let RisingSegment { seconds, acceleration, rise_seconds } = segment;
        Segment { seconds, acceleration }.check(index)?;
        if !(0.0..=seconds).contains(&rise_seconds) {
            return Err(MotionError::Rise { index, rise_seconds, seconds });
        }
        let before = self.segments.last().map_or_else(Vector2::zeros, |last| last.acceleration);
        let steps = (rise_seconds / RISE_STEP_S).ceil();
        let shares = std::iter::successors(Some(0.5), |step| Some(step + 1.0)).take_while(|step| *step < steps);
        for share in shares.map(|step| step / steps) {
            self.append(Segment { seconds: rise_seconds / steps, acceleration: before.lerp(&acceleration, share) })?;
        }
        let rest = seconds - rise_seconds;
        if rest > 0.0 { self.append(Segment { seconds: rest, acceleration }) } else { Ok(()) }
    }

    /// The same motion, were every acceleration reached in so many seconds; none where one does not last as long.
    pub(in crate::pushing) fn with_rise(&self, rise_seconds: f64) -> Option<Self> {
        let risen = |&Segment { seconds, acceleration }| RisingSegment { seconds, acceleration, rise_seconds };
        Self::rising(self.start, &self.segments.iter().map(risen).collect::<Vec<_>>()).ok()
    }

    /// How long it lasts, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.segments.iter().map(|segment| segment.seconds).sum()
    }

    /// The acceleration with which it begins, m/s².
    #[must_use]
    pub fn first_acceleration(&self) -> Vector2<f64> {
        self.segments.first().map_or_else(Vector2::zeros, |segment| segment.acceleration)
    }

    /// The segments, one after the other from t = 0 on.
    #[must_use]
    pub fn segments(&self) -> &[Segment] {
        &self.segments
    }

    /// The motion of a disk of this radius (m), stretch after stretch.
    pub fn legs(&self, radius: f64) -> impl Iterator<Item = Leg> + '_ {
        let (mut from, mut centre, mut velocity) = (0.0, self.start, Vector2::zeros());
        self.segments.iter().map(move |&Segment { seconds, acceleration }| {
            let finger = Finger { radius, centre0: centre, velocity0: velocity, acceleration };
            let leg = Leg { from, to: from + seconds, finger, turn: LegTurn::default() };
            (from, centre, velocity) = (leg.to, finger.centre(seconds), finger.velocity(seconds));
            leg
        })
    }

    /// Its acceleration from a time (s) on, m/s². Beyond the end the last one goes on.
    #[must_use]
    pub fn acceleration(&self, t: f64) -> Vector2<f64> {
        let mut ends = self.segments.iter().scan(0.0, |end, segment| {
            *end += segment.seconds;
            Some((*end, segment.acceleration))
        });
        let now = ends.find(|(end, _)| t < *end).map(|(_, acceleration)| acceleration);
        now.or_else(|| self.segments.last().map(|last| last.acceleration)).unwrap_or_default()
    }

    /// The disk's centre at a time (s), m. Beyond the end the last acceleration goes on.
    #[must_use]
    pub fn centre(&self, t: f64) -> Point2<f64> {
        let mut legs = self.legs(0.0).peekable();
        while let Some(leg) = legs.next() {
            if t <= leg.to || legs.peek().is_none() {
                return leg.finger.centre(t - leg.from);
            }
        }
        self.start
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of a few sums of lengths of a centimetre, m, and of speeds of centimetres a second, m/s.
    const ROUNDING_M: f64 = 1e-15;

    const TURN: [Segment; 2] = [
        Segment { seconds: 0.5, acceleration: Vector2::new(0.1, 0.0) },
        Segment { seconds: 0.25, acceleration: Vector2::new(0.0, -0.2) },
    ];

    #[test]
    fn segments_follow_each_other_without_a_jump() {
        let motion = FingerMotion::new(Point2::new(0.01, 0.02), &TURN).unwrap();
        let legs: Vec<_> = motion.legs(0.015).collect();
        let [first, second] = legs[..] else { panic!("{legs:?}") };
        assert!((first.finger.centre(0.5) - second.finger.centre(0.0)).norm() < ROUNDING_M);
        let [before, after] = [first.finger.velocity(0.5), second.finger.velocity0];
        assert!((before - after).norm() < ROUNDING_M, "{before} {after} m/s");
        // 1 cm + 10 cm/s² · (0.5 s)²/2, then 5 cm/s for a quarter of a second.
        let wanted = Point2::new(0.01 + 0.0125 + 0.0125, 0.02 - 0.2 * 0.25 * 0.25 / 2.0);
        assert!((motion.centre(0.75) - wanted).norm() < ROUNDING_M, "{}", motion.centre(0.75));
        assert!((motion.duration() - 0.75).abs() < ROUNDING_M);
        for (t, segment) in [(0.0, 0), (0.49, 0), (0.5, 1), (0.7, 1), (2.0, 1)] {
            assert_eq!(motion.acceleration(t), TURN[segment].acceleration, "{t} s");
        }
    }

    /// Against the integral of a steady rise: v = j t²/2, x = j t³/6, and so on from there.
    #[test]
    fn an_acceleration_rises_steadily_from_the_one_before() {
        /// Of rises to 0.1 and by 0.22 m/s²: see [`RISE_STEP_S`].
        const WITHIN_M: f64 = (0.1 + 0.23) * RISE_STEP_S * RISE_STEP_S / 12.0;
        /// At the end of each step it is exact, m/s.
        const ROUNDING_M_PER_S: f64 = 1e-14;
        let rise = 0.0205;
        let told =
            TURN.map(|Segment { seconds, acceleration }| RisingSegment { seconds, acceleration, rise_seconds: rise });
        let motion = FingerMotion::rising(Point2::new(0.01, 0.02), &told).unwrap();
        assert!((motion.duration() - 0.75).abs() < 1e-12);
        let (mut place, mut velocity, mut before) = (Point2::new(0.01, 0.02), Vector2::zeros(), Vector2::zeros());
        let mut from = 0.0;
        for RisingSegment { seconds, acceleration, .. } in told {
            let jerk = (acceleration - before) / rise;
            place += velocity * rise + before * (rise * rise / 2.0) + jerk * rise.powi(3) / 6.0;
            velocity += before * rise + jerk * (rise * rise / 2.0);
            assert!((motion.centre(from + rise) - place).norm() < WITHIN_M, "{} {place}", motion.centre(from + rise));
            let rest = seconds - rise;
            place += velocity * rest + acceleration * (rest * rest / 2.0);
            velocity += acceleration * rest;
            from += seconds;
            before = acceleration;
            assert!((motion.centre(from) - place).norm() < WITHIN_M, "{} {place}", motion.centre(from));
        }
        let last = motion.legs(0.01).last().unwrap();
        assert!((last.finger.velocity(last.to - last.from) - velocity).norm() < ROUNDING_M_PER_S);
        // Without a rise it is the same motion, and one that takes all of its segment is possible.
        let [steps, whole] = [0.0, 0.25].map(|rise_seconds| {
            FingerMotion::rising(Point2::origin(), &told.map(|segment| RisingSegment { rise_seconds, ..segment }))
                .unwrap()
        });
        assert_eq!(steps, FingerMotion::new(Point2::origin(), &TURN).unwrap());
        assert!((whole.duration() - 0.75).abs() < 1e-12);
        for rise_seconds in [-1e-9, 0.3, f64::NAN, f64::INFINITY] {
            let wrong = [told[0], RisingSegment { rise_seconds, ..told[1] }];
            let refused = FingerMotion::rising(Point2::origin(), &wrong).unwrap_err();
            assert!(matches!(refused, MotionError::Rise { index: 1, .. }), "{refused}");
        }
    }
}
