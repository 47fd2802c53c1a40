//! How a finger moves whose places come one by one: a motion from rest that grows, so long after.
//!
//! The acceleration wanders as a random walk. A Kalman filter takes each place, and when a tenth of a second of later ones
//! have come, what they all say of a moment (Rauch, Tung and Striebel's smoother) is told for good. How fast the
//! acceleration wanders is chosen by the evidence of the places lately: one filter each, side by side. When the motion began
//! is what all filters together say of the first places.
//!
//! A whole path is looked at in [`super::measured_path`], which asks the forces of it too; here nothing waits for its end.
//!
//! Implements: state (p, v, a) of each axis, da a Wiener process of intensity q, p measured with variance σ².
//! Frames: world axes. Units: SI. Errors: [`StreamError`].

use std::collections::VecDeque;

use nalgebra::{Matrix3, Matrix3x2, Point2, RowVector2, Vector2, Vector3};

use super::finger_motion::{FingerMotion, MotionError, Segment};

/// A motion is told so long after it was measured, s: of robots' paths, three times as long as the smoother looks to each
/// side, and more.
pub const LAG_S: f64 = 0.1;

/// Intensities with which an acceleration may wander, (m/s²)²/s: from a robot that creeps to one that jerks.
const INTENSITIES: [f64; 9] = [1e-3, 1e-2, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0, 1000.0];

/// What the acceleration may be at once when the motion begins, standard deviation, m/s²: robots ramp it up, or step.
const FIRST_STEPS: [f64; 3] = [0.0, 0.1, 1.0];

/// For so long places tell how fast the acceleration wanders, s.
const REMEMBERED_S: f64 = 0.5;

/// A finger so many standard deviations of a place from its rest has moved.
const MOVED_SDS: f64 = 20.0;

/// When it began is looked for so long after that, s: nothing is told before anyway, and the more is seen of how it began.
const LOOKED_AFTER_S: f64 = 0.06;

/// So long before that, and not earlier, the motion may have begun, s; the places of so much rest are kept.
const BEFORE_S: f64 = 0.6;

/// Beginnings so far apart are compared, s.
const BEGINNING_STEP_S: f64 = 1e-3;

/// Fewest places at rest.
pub const AT_REST_MIN: usize = 8;

/// Steps of the motion are no shorter, s: an acceleration changes by a few per cent over one.
const STEP_S: f64 = 5e-3;

/// What the motion is off in place, because old places are told for good, is made up for in so long, s.
const CAUGHT_UP_S: f64 = 0.25;

/// Why a place cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum StreamError {
    /// A time that is not later than the one before.
    #[error("a place at t = {time:?} s comes after one at {last:?} s: times must increase")]
    OutOfOrder {
        /// As told, s.
        time: f64,
        /// The one before, s.
        last: f64,
    },
    /// A time or place that is no number.
    #[error("a place [{x:?}, {y:?}] m at t = {time:?} s: all three must be finite")]
    NotFinite {
        /// As told, s.
        time: f64,
        /// As told, m.
        x: f64,
        /// As told, m.
        y: f64,
    },
    /// The finger moves from the first place on.
    #[error(
        "the finger has moved by {:.2} mm at t = {time:.3} s, after {count} places: at least {AT_REST_MIN} are needed while it is at rest",
        moved * 1e3
    )]
    NotAtRest {
        /// s.
        time: f64,
        /// From the first place, m.
        moved: f64,
        /// Places until then.
        count: usize,
    },
    /// The motion cannot go on.
    #[error(transparent)]
    Motion(#[from] MotionError),
}

/// What is not known of a motion that was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionDoubts {
    /// Standard deviation of when it began, s.
    pub begins_sd: f64,
    /// Of a coordinate, m.
    pub place_sd: f64,
    /// Of the acceleration along an axis, on average, m/s².
    pub acceleration_sd: f64,
    /// So far to each side places tell of an acceleration, and a step of it is smeared, s.
    pub smeared_s: f64,
}

/// Places of a finger, and the motion that they tell.
///
/// ```
/// use nalgebra::Point2;
/// use palpate::pushing::streamed_path::StreamedPath;
///
/// let mut path = StreamedPath::new(5e-6); // m
/// for time in (0..125).map(|k| 0.004 * f64::from(k)) {
///     let since: f64 = (time - 0.1_f64).max(0.0);
///     path.take(time, Point2::new(0.5 * 0.1 * since * since, 0.0))?; // 0.1 m/s² from 0.1 s on
/// }
/// path.end()?;
/// let motion = path.motion().ok_or("it never moved")?;
/// assert!((motion.duration() - 0.396).abs() < 5e-3);
/// assert!((motion.acceleration(0.2).x - 0.1).abs() < 5e-3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct StreamedPath {
    /// Of one coordinate, m.
    sigma: f64,
    /// Places while the finger may be at rest; then the last only.
    waiting: VecDeque<(f64, Point2<f64>)>,
    /// When it has moved first, s.
    moved: Option<f64>,
    begun: Option<Begun>,
}

/// A motion that has begun.
#[derive(Clone, Debug)]
struct Begun {
    /// When, s.
    at: f64,
    /// Its standard deviation, s.
    sd: f64,
    /// From where filters count places, m.
    origin: Point2<f64>,
    filters: Vec<Filter>,
    motion: Option<FingerMotion>,
    /// Where the motion is told to: when, m, m/s.
    told: (f64, Point2<f64>, Vector2<f64>),
    /// Of each segment: until when, s since the motion began, and what is not known of it.
    doubts: Vec<(f64, MotionDoubts)>,
}

/// Of each axis: place (from an origin), velocity, acceleration, with one covariance for both.
#[derive(Clone, Copy, Debug)]
struct State {
    mean: Matrix3x2<f64>,
    covariance: Matrix3<f64>,
}

/// A place that was taken.
#[derive(Clone, Copy, Debug)]
struct Step {
    time: f64,
    /// From the one before, s.
    since: f64,
    /// Without it.
    before: State,
    /// With it.
    after: State,
}

/// A Kalman filter of an acceleration that wanders with one intensity.
#[derive(Clone, Debug)]
struct Filter {
    /// (m/s²)²/s.
    intensity: f64,
    state: State,
    /// Log of the probability of the places lately, but for a constant.
    evidence: f64,
    /// What is not told for good yet, and the last that is.
    steps: VecDeque<Step>,
}

fn transition(seconds: f64) -> Matrix3<f64> {
    Matrix3::new(1.0, seconds, 0.5 * seconds * seconds, 0.0, 1.0, seconds, 0.0, 0.0, 1.0)
}

impl State {
    /// At rest at a place that is known so well, m.
    fn at_rest(place: Vector2<f64>, sd: f64) -> Self {
        let mut mean = Matrix3x2::zeros();
        mean.row_mut(0).copy_from(&place.transpose());
        Self { mean, covariance: Matrix3::from_diagonal(&Vector3::new(sd * sd, 0.0, 0.0)) }
    }

    fn later(&self, seconds: f64, intensity: f64) -> Self {
        let transition = transition(seconds);
        let power = |n: i32| seconds.powi(n);
        let wandered = Matrix3::new(
            power(5) / 20.0,
            power(4) / 8.0,
            power(3) / 6.0,
            power(4) / 8.0,
            power(3) / 3.0,
            power(2) / 2.0,
            power(3) / 6.0,
            power(2) / 2.0,
            seconds,
        );
        Self {
            mean: transition * self.mean,
            covariance: transition * self.covariance * transition.transpose() + wandered * intensity,
        }
    }

    /// With a place, m, and log of its probability, but for a constant.
    fn with(&self, place: Vector2<f64>, sigma: f64) -> (Self, f64) {
        let variance = self.covariance[(0, 0)] + sigma * sigma;
        let gain = self.covariance.column(0) / variance;
        let off: RowVector2<f64> = place.transpose() - self.mean.row(0);
        let after = Self { mean: self.mean + gain * off, covariance: self.covariance - gain * self.covariance.row(0) };
        (after, -0.5 * off.norm_squared() / variance - variance.ln())
    }
}

impl Filter {
    /// From rest until a time, s, and with all places until now; its evidence is that of all of them.
    fn begun(places: &[(f64, Point2<f64>)], at: f64, intensity: f64, sigma: f64) -> Self {
        let [mut best, others @ ..] = FIRST_STEPS.map(|step| Self::begun_with(places, at, intensity, step, sigma));
        for other in others {
            // They are as likely as each other.
            let both = best.evidence.max(other.evidence) + (-(best.evidence - other.evidence).abs()).exp().ln_1p();
            best = Self { evidence: both, ..if other.evidence > best.evidence { other } else { best } };
        }
        best
    }

    /// The same where the acceleration begins with a step of this standard deviation, m/s².
    fn begun_with(places: &[(f64, Point2<f64>)], at: f64, intensity: f64, step: f64, sigma: f64) -> Self {
        let origin = places.first().map_or_else(Point2::origin, |(_, place)| *place);
        let moving = places.partition_point(|(time, _)| *time <= at);
        let mut state = State::at_rest(Vector2::zeros(), sigma);
        let mut evidence = 0.0;
        for (_, place) in places.iter().take(moving).skip(1) {
            let (after, told) = state.with(place - origin, sigma);
            state = after;
            evidence += told;
        }
        state.covariance[(2, 2)] = step * step;
        let first = Step { time: at, since: 0.0, before: state, after: state };
        let mut filter = Self { intensity, state, evidence, steps: VecDeque::from([first]) };
        let mut last = at;
        for (time, place) in places.iter().skip(moving) {
            // All of it counts for when the motion began.
            let before = filter.evidence;
            filter.take(*time, *time - last, place - origin, sigma);
            filter.evidence += before * (1.0 - (-(*time - last) / REMEMBERED_S).exp());
            last = *time;
        }
        filter
    }

    fn take(&mut self, time: f64, since: f64, place: Vector2<f64>, sigma: f64) {
        let before = self.state.later(since, self.intensity);
        let (after, evidence) = before.with(place, sigma);
        self.evidence = self.evidence * (-since / REMEMBERED_S).exp() + evidence;
        self.state = after;
        self.steps.push_back(Step { time, since, before, after });
    }

    /// What all places say of each that is not told for good, the oldest first.
    fn smoothed(&self) -> Vec<(f64, State)> {
        let Some(last) = self.steps.back() else { return Vec::new() };
        let mut smoothed = vec![(last.time, last.after)];
        let mut next = last.after;
        for (step, later) in self.steps.iter().zip(self.steps.iter().skip(1)).rev() {
            let Some(inverse) = later.before.covariance.try_inverse() else { break };
            let gain = step.after.covariance * transition(later.since).transpose() * inverse;
            next = State {
                mean: step.after.mean + gain * (next.mean - later.before.mean),
                covariance: step.after.covariance
                    + gain * (next.covariance - later.before.covariance) * gain.transpose(),
            };
            smoothed.push((step.time, next));
        }
        smoothed.reverse();
        smoothed
    }

    /// What is told for good is forgotten.
    fn forget(&mut self, until: f64) {
        while self.steps.get(1).is_some_and(|step| step.time <= until) {
            self.steps.pop_front();
        }
    }

    /// So far to each side places tell of an acceleration, s: where what wanders and what is measured are as loud, of places
    /// so far apart, s.
    fn reach(&self, sigma: f64, apart: f64) -> f64 {
        (sigma * sigma * apart / self.intensity).powf(1.0 / 6.0)
    }
}

impl StreamedPath {
    /// Of places with this standard deviation of a coordinate, m.
    #[must_use]
    pub fn new(sigma: f64) -> Self {
        Self { sigma, waiting: VecDeque::new(), moved: None, begun: None }
    }

    /// Takes the next place: where the disk's centre is without force, m, at a time of the path's own clock, s.
    ///
    /// # Errors
    /// [`StreamError`] if it cannot be used; what came before stays.
    pub fn take(&mut self, time: f64, place: Point2<f64>) -> Result<(), StreamError> {
        let last = self.waiting.back().map(|(last, _)| *last);
        if ![time, place.x, place.y].iter().all(|value| value.is_finite()) {
            return Err(StreamError::NotFinite { time, x: place.x, y: place.y });
        }
        if let Some(last) = last.filter(|last| time <= *last) {
            return Err(StreamError::OutOfOrder { time, last });
        }
        let Some(begun) = &mut self.begun else {
            self.waiting.push_back((time, place));
            return self.wait();
        };
        self.waiting.clear();
        self.waiting.push_back((time, place));
        let since = last.map_or(0.0, |last| time - last);
        let place = place - begun.origin;
        begun.filters.iter_mut().for_each(|filter| filter.take(time, since, place, self.sigma));
        begun.tell(time - LAG_S, self.sigma)
    }

    /// No more places come: the motion is told to the last.
    ///
    /// # Errors
    /// [`StreamError`] if the motion cannot go on.
    pub fn end(&mut self) -> Result<(), StreamError> {
        match &mut self.begun {
            Some(begun) => begun.tell(f64::INFINITY, self.sigma),
            None => Ok(()),
        }
    }

    /// The motion, from where it began; none before anything of it is told.
    #[must_use]
    pub fn motion(&self) -> Option<&FingerMotion> {
        self.begun.as_ref()?.motion.as_ref()
    }

    /// When the motion began, on the path's own clock, s.
    #[must_use]
    pub fn begun_at(&self) -> Option<f64> {
        Some(self.begun.as_ref()?.at)
    }

    /// What is not known of the motion at a time since it began, s; none before anything of it is told.
    #[must_use]
    pub fn doubts(&self, time: f64) -> Option<MotionDoubts> {
        let doubts = &self.begun.as_ref()?.doubts;
        let at = doubts.partition_point(|(until, _)| *until < time);
        doubts.get(at).or(doubts.last()).map(|(_, doubts)| *doubts)
    }

    /// Looks whether the finger has begun to move.
    fn wait(&mut self) -> Result<(), StreamError> {
        let (Some((first, at_rest)), Some((time, place))) = (self.waiting.front(), self.waiting.back()) else {
            return Ok(());
        };
        let (moved, time) = ((place - at_rest).norm(), *time);
        if moved < MOVED_SDS * self.sigma {
            // It may have been jolted.
            self.moved = None;
            if time - first > 2.0 * BEFORE_S {
                let old = self.waiting.partition_point(|(kept, _)| *kept < time - BEFORE_S);
                self.waiting.drain(..old);
            }
            return Ok(());
        }
        if time < *self.moved.get_or_insert(time) + LOOKED_AFTER_S {
            return Ok(());
        }
        let count = self.waiting.len();
        let not_at_rest = StreamError::NotAtRest { time, moved, count };
        let begun = Begun::found(self.waiting.make_contiguous(), self.sigma).ok_or(not_at_rest)?;
        self.begun = Some(begun);
        Ok(())
    }
}

impl Begun {
    /// By places of which the first are at rest; none if they are not.
    fn found(places: &[(f64, Point2<f64>)], sigma: f64) -> Option<Self> {
        let (origin, first, last) = (places.first()?.1, places.get(AT_REST_MIN - 1)?.0, places.last()?.0);
        let count = ((last - first) / BEGINNING_STEP_S).ceil();
        let beginnings = std::iter::successors(Some(0.0), |step| Some(step + 1.0)).take_while(|step| *step < count);
        let of_all = |at: f64| INTENSITIES.map(|intensity| Filter::begun(places, at, intensity, sigma));
        let tried: Vec<_> = beginnings
            .map(|step| first + step * (last - first) / count)
            .flat_map(|at| of_all(at).map(|filter| (at, filter.evidence)))
            .collect();
        let best = tried.iter().map(|(_, evidence)| *evidence).max_by(f64::total_cmp)?;
        let weight = |evidence: f64| (evidence - best).exp();
        let total: f64 = tried.iter().map(|(_, evidence)| weight(*evidence)).sum();
        let mean = |of: &dyn Fn(f64) -> f64| {
            tried.iter().map(|(at, evidence)| of(*at) * weight(*evidence)).sum::<f64>() / total
        };
        let at = first + mean(&|at| at - first);
        // Between two beginnings nothing was looked at.
        let sd = mean(&|other| (other - at).powi(2)).sqrt().hypot(0.5 * BEGINNING_STEP_S);
        // The finger moved from the first place on: nothing tells of its rest.
        if at - first < sd {
            return None;
        }
        let filters = of_all(at);
        let rest = filters[0].steps.front()?.after.mean.row(0).transpose();
        let told = (at, origin + rest, Vector2::zeros());
        Some(Self { at, sd, origin, filters: filters.into(), motion: None, told, doubts: Vec::new() })
    }

    /// Tells the motion up to a time, s, for good.
    fn tell(&mut self, until: f64, sigma: f64) -> Result<(), StreamError> {
        let Some(best) = self.filters.iter().max_by(|a, b| a.evidence.total_cmp(&b.evidence)) else { return Ok(()) };
        let apart = best.steps.iter().map(|step| step.since).sum::<f64>() / best.steps.len().max(1) as f64;
        let smeared_s = best.reach(sigma, apart).max(0.5 * apart);
        for (time, state) in best.smoothed() {
            let (from, place, velocity) = self.told;
            let seconds = time - from;
            if seconds < STEP_S || time > until {
                continue;
            }
            let [wanted, speed] = [0, 1].map(|row| state.mean.row(row).transpose());
            let ahead = place + (velocity + speed) * (0.5 * seconds);
            let speed = speed + (self.origin + wanted - ahead) / CAUGHT_UP_S;
            let segment = Segment { seconds, acceleration: (speed - velocity) / seconds };
            match &mut self.motion {
                Some(motion) => motion.append(segment)?,
                None => self.motion = Some(FingerMotion::new(place, &[segment])?),
            }
            self.told = (time, place + (velocity + speed) * (0.5 * seconds), speed);
            let sd = |row: usize| state.covariance[(row, row)].max(0.0).sqrt();
            let doubts = MotionDoubts { begins_sd: self.sd, place_sd: sd(0), acceleration_sd: sd(2), smeared_s };
            self.doubts.push((time - self.at, doubts));
        }
        let told = self.told.0;
        self.filters.iter_mut().for_each(|filter| filter.forget(told));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    /// Places with noise of a motion of steps, from a rest of 0.3 s, so many a second at uneven times; the stream of them.
    fn streamed(draw: &mut Draw, motion: &FingerMotion, per_second: f64, sigma: f64, seconds: f64) -> StreamedPath {
        let mut path = StreamedPath::new(sigma);
        let mut time = 0.0;
        while time < REST_S + seconds {
            let place = motion.centre((time - REST_S).max(0.0)) + Vector2::new(draw.normal(), draw.normal()) * sigma;
            path.take(time, place).unwrap();
            time += draw.uniform(0.7, 1.3) / per_second;
        }
        path.end().unwrap();
        path
    }

    const REST_S: f64 = 0.3;

    fn turn() -> FingerMotion {
        let ahead = Segment { seconds: 0.4, acceleration: Vector2::new(0.15, 0.0) };
        let aside = Segment { seconds: 60.0, acceleration: Vector2::new(0.0, 0.1) };
        FingerMotion::new(Point2::new(0.4, -0.2), &[ahead, aside]).unwrap()
    }

    /// Of 40 streams: beginning, accelerations away from steps, and places are within what is stated, and that is little.
    #[test]
    fn a_motion_is_told_as_its_places_come() {
        let (mut began, mut accelerations, mut off) = (0.0, (0.0, 0.0), 0.0_f64);
        let count = 40;
        for case in 0..count {
            let mut draw = Draw::case(41, case);
            let (per_second, sigma) = (draw.uniform(60.0, 500.0), draw.uniform(2e-6, 2e-5));
            let truth = turn();
            let path = streamed(&mut draw, &truth, per_second, sigma, 0.8);
            let (motion, doubts) = (path.motion().unwrap(), path.doubts(0.2).unwrap());
            let late = path.begun_at().unwrap() - REST_S;
            began += (late / doubts.begins_sd).powi(2);
            assert!(late.abs() < 0.02, "case {case}: {late} s, {doubts:?}");
            for time in (1..15).map(|k| 0.05 * f64::from(k)) {
                let doubts = path.doubts(time).unwrap();
                let since = time + late;
                if [0.0, 0.4].iter().any(|step| (since - step).abs() < 3.0 * doubts.smeared_s) || time > 0.7 {
                    continue;
                }
                let error = motion.acceleration(time) - truth.acceleration(since);
                accelerations.0 += error.norm_squared() / (2.0 * doubts.acceleration_sd.powi(2));
                accelerations.1 += 1.0;
                off = off.max((motion.centre(time) - truth.centre(since)).norm() / sigma);
            }
        }
        let began = (began / f64::from(u32::try_from(count).unwrap())).sqrt();
        let accelerations = (accelerations.0 / accelerations.1).sqrt();
        println!("beginning {began:.2}, accelerations {accelerations:.2} stated deviations, places {off:.2} σ");
        assert!((0.4..1.5).contains(&began), "{began}");
        assert!((0.3..1.4).contains(&accelerations), "{accelerations}");
        assert!(off < 4.0, "{off}");
    }

    /// A minute and a half of going on: what is told for good stays where the finger is.
    #[test]
    fn a_long_way_does_not_drift() {
        let mut draw = Draw::case(42, 0);
        let (sigma, truth) = (2e-5, turn());
        let path = streamed(&mut draw, &truth, 100.0, sigma, 60.0);
        let late = path.begun_at().unwrap() - REST_S;
        let motion = path.motion().unwrap();
        let off = (motion.centre(motion.duration()) - truth.centre(motion.duration() + late)).norm();
        assert!(off < 4.0 * sigma, "{off} m");
    }

    #[test]
    fn what_cannot_be_used_is_named_and_nothing_is_lost() {
        let mut path = StreamedPath::new(1e-5);
        let at = |time: f64| Point2::new(0.5 * time * time, 0.0);
        path.take(0.0, at(0.0)).unwrap();
        assert_eq!(path.take(0.0, at(0.0)), Err(StreamError::OutOfOrder { time: 0.0, last: 0.0 }));
        assert!(matches!(path.take(0.1, Point2::new(f64::NAN, 0.0)), Err(StreamError::NotFinite { .. })));
        path.take(0.1, at(0.1)).unwrap();
        let moved = path.take(0.2, at(0.2)).unwrap_err();
        assert!(moved.to_string().contains("after 3 places: at least 8 are needed"), "{moved}");
        // A finger that moves from the first place on.
        let mut path = StreamedPath::new(1e-5);
        let first = (1..).map(|k| 0.004 * f64::from(k)).find_map(|time| path.take(time, at(0.5 + time)).err());
        assert!(matches!(first, Some(StreamError::NotAtRest { .. })), "{first:?}");
    }
}
