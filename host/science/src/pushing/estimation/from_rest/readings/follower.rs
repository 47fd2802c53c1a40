//! A push followed from its first sample on: what a [`PushWatch`] feels goes in, pose and motion at each reading come out.
//!
//! A reading is what was steady over [`STRETCH_S`]: the finger's ringing, found in what is felt first, is taken out
//! (`finger::ringing`), and stretches in which the finger's acceleration jumps are left out. The noise of a reading is that
//! of the same stretches at rest, whatever its colour. The clock of the motion begins where the push is felt to, or where it
//! is told to; what it may be off moves the disk along its path, and with it the part: that is in the covariance told. It also
//! has the force of another moment read: that counts as noise, more of it where the force changes faster.
//!
//! A motion may be measured while it goes ([`StreamedPath`]). What its acceleration may be off counts as noise, by the mass
//! that plane and finger let feel; steps of it are smeared, and stretches in them left out.
//!
//! Frames: world axes. Units: SI. Errors: none.

use std::ops::AddAssign as _;

use nalgebra::{Matrix2, Vector2, Vector6};

use super::tracker::{ForceTracker, Found, SearchTask, TrackedHypothesis};
use super::{ForceReading, KnownOfFinger};
use crate::finger::contact::Reading;
use crate::finger::ringing::{Ringing, mean_reading};
use crate::math::statistics::mean;
use crate::pushing::estimation::from_rest::watch::PushWatch;
use crate::pushing::finger_motion::FingerMotion;
use crate::pushing::streamed_path::{MotionDoubts, StreamedPath};

/// A reading each so long, s: in less a push changes by a line.
const STRETCH_S: f64 = 8e-3;

/// And no less than so many periods of the ringing, or a line and ringing cannot be told apart.
const PERIODS: f64 = 1.2;

/// The ringing is sought in what is felt for so long, s: ten periods, of which the last is a fifth of the first.
const RUNG_S: f64 = 0.06;

/// After a jump nothing is read for so long, s: a robot takes a millisecond to accelerate, and the clock may be off.
const JUMP_S: f64 = 1.5e-3;

/// An acceleration that changes by less than this share of its greatest does not jump, but rises.
const JUMP_SHARE: f64 = 0.1;

/// What a wrong clock adds lasts for so many readings, which err alike: as white noise it counts for so many.
const ALIKE: f64 = 10.0;

/// A measured acceleration that changes about a stretch by so many times what it may be off steps there.
const STEPS_SDS: f64 = 6.0;

/// A stretch counts that has this share of its readings.
const FILLED: f64 = 0.5;

/// When the finger's motion began, on the clock of what is felt.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionClock {
    /// s.
    pub begins: f64,
    /// Its standard deviation, s.
    pub sd: f64,
}

/// Follows a push that is watched.
#[derive(Clone, Debug)]
pub struct PushFollower {
    clock: Option<MotionClock>,
    push: Option<FollowedPush>,
}

/// A push from its onset on.
#[derive(Clone, Debug)]
struct FollowedPush {
    /// When force was first felt, on the clock of what is felt, s.
    onset: f64,
    clock: MotionClock,
    /// What is known of its readings once the ringing was sought.
    reader: Option<Reader>,
    /// Where the next stretch begins, s since the onset.
    next: f64,
    last: Option<ForceReading>,
    /// Of a measured motion at the last reading.
    doubts: MotionDoubts,
    /// Squares of the noise of all readings, N², and how many there are.
    noises: (f64, f64),
    tracker: Option<ForceTracker>,
}

impl FollowedPush {
    /// Standard deviation of a reading, what the clock and the motion may be off included, N.
    fn noise(&mut self, reading: &ForceReading, reader: &Reader, known: &KnownOfFinger) -> f64 {
        let rate = self
            .last
            .replace(*reading)
            .map_or(0.0, |last| (reading.force - last.force).norm() / (reading.time - last.time).max(reader.stretch_s));
        let MotionDoubts { acceleration_sd, smeared_s, .. } = self.doubts;
        let contact = reading.force + known.motion.acceleration(reading.time) * known.effective_mass;
        // Friction of the plane is most of what is felt of a part.
        let carried = contact.norm() / known.mu_g.max(f64::MIN_POSITIVE) + known.effective_mass;
        let alike = (2.0 * smeared_s / reader.stretch_s).max(1.0);
        let of_motion = alike.sqrt() * carried * acceleration_sd;
        let noise = reader.noise.hypot(ALIKE.sqrt() * rate * self.clock_sd()).hypot(of_motion);
        self.noises.0 += noise * noise;
        self.noises.1 += 1.0;
        noise
    }

    /// Of when the motion began, s.
    fn clock_sd(&self) -> f64 {
        self.clock.sd.hypot(self.doubts.begins_sd)
    }
}

/// What turns samples into readings.
#[derive(Clone, Copy, Debug)]
struct Reader {
    ringing: Option<Ringing>,
    /// Length of a stretch, s.
    stretch_s: f64,
    /// Between samples, s.
    period: f64,
    /// Of a reading, each axis, N.
    noise: f64,
}

impl Reader {
    /// For a finger that reads so at rest, tared, and so just after something jumped.
    fn new(rest: &[Reading], bias: Vector2<f64>, jumped: &[Reading], period: f64) -> Option<Self> {
        let ringing = Ringing::found_in(jumped);
        let stretch_s =
            ringing.map_or(STRETCH_S, |ringing| STRETCH_S.max(PERIODS / ringing.frequency_hz())).max(period);
        let reader = Self { ringing, stretch_s, period, noise: 0.0 };
        let begin = rest.first()?.t;
        let mut quiet = Vec::new();
        for stretch in rest.chunk_by(|a, b| reader.number(a.t - begin) == reader.number(b.t - begin)) {
            quiet.extend(reader.read(stretch).map(|read| (read.force_finger - bias).norm_squared()));
        }
        let squared: f64 = mean(quiet)?;
        // Of two axes each.
        Some(Self { noise: (0.5 * squared).sqrt(), ..reader })
    }

    /// Of the stretch in which a time is.
    fn number(&self, time: f64) -> u64 {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "times since the beginning")]
        let number = (time / self.stretch_s) as u64;
        number
    }

    /// What was steady in a stretch; none of one that lacks readings.
    fn read(&self, stretch: &[Reading]) -> Option<Reading> {
        let is_filled = stretch.len() as f64 >= FILLED * self.stretch_s / self.period;
        if !is_filled {
            return None;
        }
        self.ringing.map_or_else(|| mean_reading(stretch), |ringing| ringing.steady(stretch))
    }
}

/// Where the acceleration jumps between two times of a motion, the first of them, s.
fn first_jump(motion: &FingerMotion, from: f64, to: f64) -> Option<f64> {
    let most = motion.segments().iter().map(|segment| segment.acceleration.norm()).fold(0.0, f64::max);
    let mut ends = motion.segments().iter().scan(0.0, |end, segment| {
        *end += segment.seconds;
        Some(*end)
    });
    let mut pairs = motion.segments().windows(2).map(|pair| (pair[1].acceleration - pair[0].acceleration).norm());
    std::iter::from_fn(|| Some((ends.next()?, pairs.next()?)))
        .find(|(time, change)| (from..to).contains(time) && *change > JUMP_SHARE * most)
        .map(|(time, _)| time)
}

/// Whether a measured acceleration steps in a stretch or so near that it is smeared into it, s since the motion began.
fn steps(motion: &FingerMotion, doubts: &MotionDoubts, from: f64, to: f64) -> bool {
    let [before, after] =
        [from - doubts.smeared_s, to + doubts.smeared_s].map(|time| motion.acceleration(time.max(0.0)));
    (after - before).norm() > STEPS_SDS * doubts.acceleration_sd
}

impl PushFollower {
    /// Waits for a push. Without a clock the finger begins to move where force is first felt: it and the part are at rest,
    /// in contact. With one it may be on its way when it meets the part.
    #[must_use]
    pub fn new(clock: Option<MotionClock>) -> Self {
        Self { clock, push: None }
    }

    /// Tells when the motion began, of a push that is not felt yet.
    pub fn set_clock(&mut self, clock: MotionClock) {
        self.clock = Some(clock);
    }

    /// When the motion began, where that was told.
    #[must_use]
    pub fn clock(&self) -> Option<MotionClock> {
        self.clock
    }

    /// The same of what is known, with the noise of all readings until now.
    #[must_use]
    pub fn known<'p>(&self, known: &KnownOfFinger<'p>) -> KnownOfFinger<'p> {
        let noises = self.push.as_ref().map(|push| push.noises).filter(|(_, count)| *count > 0.0);
        KnownOfFinger { noise: noises.map_or(known.noise, |(squares, count)| (squares / count).sqrt()), ..*known }
    }

    /// Takes the next reading, if what is felt has come so far; its time since the motion began, s. The motion counts as
    /// far as it is told; where it is measured, `path` is what tells it.
    pub fn next(&mut self, known: &KnownOfFinger, path: Option<&StreamedPath>, watch: &PushWatch) -> Option<f64> {
        let (sense, onset) = (watch.sense()?, watch.onset_time());
        if self.push.as_ref().map(|push| push.onset) != onset {
            // A knock is forgotten, and what follows is another push.
            self.push = onset.map(|onset| self.begun(onset, sense.onset_sd().unwrap_or(0.0)));
        }
        let push = self.push.as_mut()?;
        let felt = sense.readings();
        let now = sense.now() - push.onset;
        if push.reader.is_none() {
            let first = felt.partition_point(|reading| reading.t < JUMP_S);
            let last = felt.partition_point(|reading| reading.t < RUNG_S);
            if now < RUNG_S {
                return None;
            }
            push.reader = Reader::new(watch.rest(), sense.rest().bias, &felt[first..last], sense.rest().period);
        }
        let reader = push.reader?;
        let to_motion = push.onset - push.clock.begins;
        loop {
            let end = push.next + reader.stretch_s;
            if end > now || end + to_motion > known.motion.duration() {
                return None;
            }
            let from = push.next + to_motion;
            if let Some(path) = path {
                push.doubts = path.doubts(from)?;
                if steps(known.motion, &push.doubts, from, end + to_motion) {
                    push.next = end;
                    continue;
                }
            } else if let Some(jump) = first_jump(known.motion, from - JUMP_S, end + to_motion + JUMP_S) {
                push.next = jump - to_motion + JUMP_S;
                // Rounding must not find the same jump again.
                push.next += f64::EPSILON.sqrt() * push.next.abs();
                continue;
            }
            let stretch = felt.partition_point(|it| it.t < push.next)..felt.partition_point(|it| it.t < end);
            push.next = end;
            let Some(read) = reader.read(&felt[stretch]) else { continue };
            let reading = ForceReading { time: read.t + to_motion, force: read.force_finger };
            let known = KnownOfFinger { noise: push.noise(&reading, &reader, known), ..*known };
            push.tracker.get_or_insert_with(|| ForceTracker::new(&known)).take(&known, reading);
            return Some(reading.time);
        }
    }

    fn begun(&self, onset: f64, onset_sd: f64) -> FollowedPush {
        let clock = self.clock.unwrap_or(MotionClock { begins: onset, sd: onset_sd });
        FollowedPush {
            onset,
            clock,
            reader: None,
            next: JUMP_S,
            last: None,
            doubts: MotionDoubts::default(),
            noises: (0.0, 0.0),
            tracker: None,
        }
    }

    /// What follows the push; none before it was felt for a little.
    #[must_use]
    pub fn tracker(&self) -> Option<&ForceTracker> {
        self.push.as_ref()?.tracker.as_ref()
    }

    /// A search that is due; its outcome is to be given to [`Self::adopt`].
    pub fn search_due(&mut self) -> Option<SearchTask> {
        self.push.as_mut()?.tracker.as_mut()?.search_due()
    }

    /// A search of what is felt by now of a push that is over and not followed.
    pub fn search_now(&mut self) -> Option<SearchTask> {
        self.push.as_mut()?.tracker.as_mut()?.search_now()
    }

    /// Takes all hypotheses on to the last reading, however long it takes: for the end of a push.
    pub fn finish(&mut self, known: &KnownOfFinger) {
        let known = self.known(known);
        if let Some(tracker) = self.push.as_mut().and_then(|push| push.tracker.as_mut()) {
            tracker.finish(&known);
        }
    }

    /// Takes what a search found instead of what was followed.
    pub fn adopt(&mut self, known: &KnownOfFinger, found: Found) {
        let known = self.known(known);
        if let Some(tracker) = self.push.as_mut().and_then(|push| push.tracker.as_mut()) {
            tracker.adopt(&known, found);
        }
    }

    /// How the finger rings, where it does.
    #[must_use]
    pub fn ringing(&self) -> Option<Ringing> {
        self.push.as_ref()?.reader?.ringing
    }

    /// What may be at the tracker's time, the likeliest first, the doubt about the clock included.
    #[must_use]
    pub fn hypotheses(&self, known: &KnownOfFinger) -> Vec<TrackedHypothesis> {
        let Some((push, tracker)) = self.push.as_ref().and_then(|push| Some((push, push.tracker.as_ref()?))) else {
            return Vec::new();
        };
        let time = tracker.time();
        let leg = known.motion.legs(known.radius).take_while(|leg| leg.from <= time).last();
        let mut hypotheses = tracker.hypotheses(&self.known(known));
        let last = push.last.map_or_else(Vector2::zeros, |last| last.force);
        let measured = Matrix2::from_diagonal_element(push.doubts.place_sd.powi(2));
        let unsure = known.place_covariance(last) + measured;
        hypotheses.iter_mut().for_each(|it| it.covariance.fixed_view_mut::<2, 2>(0, 0).add_assign(&unsure));
        if let Some(leg) = leg {
            // The disk is elsewhere on its path, at another speed, and the part with it.
            let (velocity, acceleration) = (leg.finger.velocity(time - leg.from), leg.finger.acceleration);
            let moved =
                Vector6::new(velocity.x, velocity.y, 0.0, acceleration.x, acceleration.y, 0.0) * push.clock_sd();
            hypotheses.iter_mut().for_each(|it| it.covariance += moved * moved.transpose());
        }
        hypotheses
    }
}

#[cfg(test)]
mod tests;
