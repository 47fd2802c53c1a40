//! The thesis's observers on a finger that feels: contact angles come one after the other, at whatever times.
//!
//! One observer an edge, as [`super::GhoBank`] has them, each a step further with every reading. The finger is told as a
//! [`FingerMotion`], whose acceleration changes from segment to segment. An estimate that leaves its range, the edge, is set back to
//! it, as for Tables 6.1 and 6.2.
//!
//! Nothing is observed of a finger that hardly moves: friction under a part at rest has no direction, and the thesis's
//! observer no drift. The first reading of a finger that goes at 5 mm/s begins.
//!
//! Implements: the parallel hypotheses of thesis §6.1, by (5.29) and (5.40). Assumes: the contact lasts, rolls or slides without
//! friction throughout, and µ is exact. Frames: that of the motion. Units: SI. Errors: none; an observer that has diverged is not
//! told of.

use std::collections::VecDeque;

use nalgebra::Vector2;

use super::{Gho, GhoSettings};
use crate::geometry::Pose;
use crate::math::angle::wrap_angle;
use crate::pushing::dynamics::{ContactMode, Finger, Part, PushModel, State};
use crate::pushing::estimation::hypotheses::pose;
use crate::pushing::finger_motion::FingerMotion;

/// Slower fingers are not observed, m/s: a tenth of the thesis's.
const SPEED_MIN: f64 = 5e-3;

/// Observers are compared by their misses of so many readings, the thesis's 0.2 s at 100 a second.
const COMPARED: usize = 20;

/// Longest step, s: the thesis's.
const STEP_S: f64 = 0.01;

/// What is known of the push.
#[derive(Clone, Copy, Debug)]
pub struct GhoKnown<'p> {
    /// The part on its plane.
    pub part: &'p Part,
    /// µ g of the plane, m/s².
    pub mu_g: f64,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// How the finger moves, at least to the next reading.
    pub motion: &'p FingerMotion,
    /// How finger and part touch.
    pub contact: ContactMode,
}

/// Where the observers begin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct GhoStart {
    /// The only edge that may be in contact; each has an observer where none is told.
    pub edge: Option<usize>,
    /// Contact angle, rad; the first that is felt where it is not told.
    pub u: Option<f64>,
    /// Place on the edge, m; its middle where it is not told.
    pub s: Option<f64>,
    /// rad/s.
    pub omega: f64,
    /// m/s; of no concern where the contact rolls.
    pub v_t: f64,
}

/// An observer of one edge.
#[derive(Clone, Debug)]
struct OnEdge {
    edge: usize,
    estimate: State,
    /// û − u at the last readings, rad.
    misses: VecDeque<f64>,
}

/// What one observer believes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GhoTold {
    /// The edge it takes to be in contact.
    pub edge: usize,
    /// Its estimate.
    pub state: State,
    /// The part by it.
    pub pose: Pose,
    /// Velocity of its centre of mass, m/s.
    pub velocity: Vector2<f64>,
    /// How far its contact angle was from the felt one of late, rms, rad.
    pub missed: f64,
}

/// Observers that follow a push.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::pushing::dynamics::{ContactMode, Part};
/// use palpate::pushing::estimation::{GhoFollower, GhoKnown, GhoSettings, GhoStart};
/// use palpate::pushing::finger_motion::{FingerMotion, Segment};
/// use palpate::pushing::pushed_world::PushedWorld;
/// use palpate::SimplePolygon;
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.025], [-0.03, 0.01]].map(Point2::from))?);
/// let motion = FingerMotion::new(Point2::origin(), &[Segment { seconds: 0.9, acceleration: Vector2::new(0.0, 0.1) }])?;
/// let (mu_g, radius, edge) = (0.3 * 9.81, 0.01, 0);
/// // So rough a finger that the part rolls on it.
/// let world = PushedWorld { part: &part, mu_g, mass: 0.2, mu_c: 1.0, radius, motion: &motion, edge, u: 1.6, s: 0.006 };
/// let played = world.play()?;
/// let known = GhoKnown { part: &part, mu_g, radius, motion: &motion, contact: ContactMode::Rolling };
/// // An observer that knows the edge and begins in its middle, 6 mm off.
/// let mut follower = GhoFollower::new(GhoStart { edge: Some(edge), ..GhoStart::default() }, GhoSettings::new(10.0));
/// for sample in played.samples.iter().step_by(40) {
///     follower.take(&known, sample.t, sample.state.u);
/// }
/// let (told, truth) = (follower.told(&known)[0], played.samples[played.samples.len() - 1].state);
/// assert!((told.state.s - truth.s).abs() < 1e-3); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct GhoFollower {
    start: GhoStart,
    settings: GhoSettings,
    /// Begun with the first reading that counts: its time and angle.
    begun: Option<(f64, f64)>,
    /// Of the last reading.
    time: f64,
    angle: f64,
    observers: Vec<OnEdge>,
}

impl GhoFollower {
    /// Waits for the finger to move.
    #[must_use]
    pub fn new(start: GhoStart, settings: GhoSettings) -> Self {
        Self { start, settings, begun: None, time: 0.0, angle: 0.0, observers: Vec::new() }
    }

    /// Takes the contact angle (rad) at a time (s since the motion began), later than the one before.
    pub fn take(&mut self, known: &GhoKnown, time: f64, angle: f64) {
        let Some((begun, _)) = self.begun else {
            if known.finger(time).velocity(time).norm() >= SPEED_MIN {
                self.begin(known, time, angle);
            }
            return;
        };
        if time <= self.time {
            return;
        }
        // Whole turns do not count.
        let angle = self.angle + wrap_angle(angle - self.angle);
        let (from, from_angle) = (self.time, self.angle);
        let steps = ((time - from) / STEP_S - 1e-6).ceil().max(1.0);
        let dt = (time - from) / steps;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "steps between two readings")]
        let shares = (0..steps as u32).map(|step| f64::from(step) / steps);
        for share in shares {
            let felt = [share, share + 1.0 / steps].map(|share| from_angle + share * (angle - from_angle));
            let at = from + share * (time - from);
            self.observers.retain_mut(|it| it.step(known, self.settings, (at, at - begun), felt, dt));
        }
        for observer in &mut self.observers {
            observer.misses.push_back(wrap_angle(observer.estimate.u - angle));
            if observer.misses.len() > COMPARED {
                observer.misses.pop_front();
            }
        }
        (self.time, self.angle) = (time, angle);
    }

    fn begin(&mut self, known: &GhoKnown, time: f64, angle: f64) {
        (self.begun, self.time, self.angle) = (Some((time, angle)), time, angle);
        let edges =
            known.part.sides().filter(|(edge, _)| self.start.edge.is_none_or(|told| known.part.side(told) == *edge));
        let GhoStart { u, s, omega, v_t, .. } = self.start;
        let begin = |(edge, line): (usize, crate::pushing::dynamics::Edge)| {
            let s = s.unwrap_or(0.5 * (line.s_min + line.s_max)).clamp(line.s_min, line.s_max);
            let u = u.map_or(angle, |u| angle + wrap_angle(u - angle));
            let estimate = State { u, s, omega, v_t };
            OnEdge { edge, estimate, misses: VecDeque::new() }
        };
        self.observers = edges.map(begin).collect();
    }

    /// When the observers begun, s since the motion did; none before.
    #[must_use]
    pub fn begun(&self) -> Option<f64> {
        self.begun.map(|(time, _)| time)
    }

    /// What each believes at the last reading, the one that has followed the contact best of late first; those that have
    /// diverged are left out.
    #[must_use]
    pub fn told(&self, known: &GhoKnown) -> Vec<GhoTold> {
        let told = |it: &OnEdge| {
            let model = known.model(it.edge, self.time)?;
            let squares: f64 = it.misses.iter().map(|miss| miss * miss).sum();
            Some(GhoTold {
                edge: known.part.edge_at(it.edge, it.estimate.s),
                state: it.estimate,
                pose: pose(&model, it.estimate.u, self.time, &it.estimate),
                velocity: model.velocity(&known.contact, self.time, &it.estimate),
                // A sum of nothing is −0.
                missed: (squares / it.misses.len().max(1) as f64).sqrt() + 0.0,
            })
        };
        let mut all: Vec<_> = self.observers.iter().filter_map(told).collect();
        all.sort_by(|a, b| a.missed.total_cmp(&b.missed));
        all
    }
}

impl GhoKnown<'_> {
    /// The finger as it moves at a time (s), in time since the motion began.
    fn finger(&self, time: f64) -> Finger {
        let mut legs = self.motion.legs(self.radius).peekable();
        let mut finger = None;
        while let Some(leg) = legs.next() {
            if time < leg.to || legs.peek().is_none() {
                // Carried back to t = 0 as if it had always accelerated so.
                let Finger { acceleration, .. } = leg.finger;
                let velocity0 = leg.finger.velocity0 - acceleration * leg.from;
                let centre0 = leg.finger.centre0 - velocity0 * leg.from - acceleration * (0.5 * leg.from * leg.from);
                finger = Some(Finger { centre0, velocity0, ..leg.finger });
                break;
            }
        }
        let rest = Finger {
            radius: self.radius,
            centre0: self.motion.centre(0.0),
            velocity0: Vector2::zeros(),
            acceleration: Vector2::zeros(),
        };
        finger.unwrap_or(rest)
    }

    fn model(&self, edge: usize, time: f64) -> Option<PushModel<'_>> {
        let edge = self.part.edge(edge).ok()?;
        Some(PushModel { part: self.part, edge, mu_g: self.mu_g, finger: self.finger(time) })
    }
}

impl OnEdge {
    /// A step with the contact angles at its ends; false where it diverges. The correction goes by the time since the
    /// observers began, the second of the times.
    fn step(
        &mut self,
        known: &GhoKnown,
        settings: GhoSettings,
        (time, since): (f64, f64),
        felt: [f64; 2],
        dt: f64,
    ) -> bool {
        // The middle of the step says which segment it is in.
        let Some(model) = known.model(self.edge, time + 0.5 * dt) else { return false };
        let observer = Gho { model, contact: known.contact, settings };
        let next = observer.step_towards(time, &self.estimate, settings.corrects(since).then_some(felt), dt);
        if observer.has_diverged(&next) {
            return false;
        }
        self.estimate = observer.set_back(&next);
        true
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::Point2;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::gravity::GRAVITY_ASSUMED;
    use crate::pushing::finger_motion::Segment;
    use crate::pushing::pushed_world::{Played, PushedWorld};

    const RADIUS: f64 = 0.01;
    const MU_G: f64 = 0.3 * GRAVITY_ASSUMED;

    fn part() -> Part {
        let wedge = [[-0.04, -0.02], [0.03, -0.02], [0.02, 0.025], [-0.03, 0.01]].map(Point2::from);
        Part::uniform(SimplePolygon::new(wedge).unwrap())
    }

    /// Ahead, then aside.
    fn motion() -> FingerMotion {
        let segments = [[0.0, 0.15], [0.02, 0.10]].map(Vector2::from);
        let segments = segments.map(|acceleration| Segment { seconds: 0.4, acceleration });
        FingerMotion::new(Point2::origin(), &segments).unwrap()
    }

    fn played(part: &Part, motion: &FingerMotion, mu_c: f64, s: f64) -> Played {
        let world = PushedWorld { part, mu_g: MU_G, mass: 0.3, mu_c, radius: RADIUS, motion, edge: 0, u: FRAC_PI_2, s };
        world.play().unwrap()
    }

    fn followed(
        part: &Part,
        motion: &FingerMotion,
        played: &Played,
        contact: ContactMode,
        start: GhoStart,
    ) -> Vec<GhoTold> {
        let known = GhoKnown { part, mu_g: MU_G, radius: RADIUS, motion, contact };
        let mut follower = GhoFollower::new(start, GhoSettings::new(10.0));
        for sample in played.samples.iter().step_by(40) {
            follower.take(&known, sample.t, sample.state.u);
        }
        follower.told(&known)
    }

    #[test]
    fn an_observer_follows_through_a_turn_of_the_finger() {
        let (part, motion) = (part(), motion());
        let played = played(&part, &motion, 1.0, 0.008);
        let start = GhoStart { edge: Some(0), s: Some(-0.01), ..GhoStart::default() };
        let told = followed(&part, &motion, &played, ContactMode::Rolling, start)[0];
        // The last reading may be just before the end.
        let truth = played.samples[(played.samples.len() - 1) / 40 * 40];
        assert!((told.state.s - truth.state.s).abs() < 1e-3, "{told:?} {truth:?}");
        assert!((told.state.omega - truth.state.omega).abs() < 0.1, "{told:?} {truth:?}");
        let pose = played.pose(truth.t).unwrap();
        assert!((told.pose.isometry().translation.vector - pose.translation.vector).norm() < 1.5e-3, "{told:?}");
        assert!(pose.rotation.angle_to(&told.pose.isometry().rotation).abs() < 0.02, "{told:?}");
    }

    #[test]
    fn each_edge_has_an_observer_and_the_right_one_misses_least_or_hardly_more() {
        let (part, motion) = (part(), motion());
        let played = played(&part, &motion, 1.0, 0.008);
        let told = followed(&part, &motion, &played, ContactMode::Rolling, GhoStart::default());
        assert!(told.len() > 1 && told.windows(2).all(|pair| pair[0].missed <= pair[1].missed), "{told:?}");
        let right = told.iter().find(|it| it.edge == 0).unwrap();
        assert!(right.missed < 0.01, "{told:?}");
    }

    #[test]
    fn nothing_is_believed_of_a_finger_that_hardly_moves() {
        let (part, motion) = (part(), motion());
        let known =
            GhoKnown { part: &part, mu_g: MU_G, radius: RADIUS, motion: &motion, contact: ContactMode::Rolling };
        let mut follower = GhoFollower::new(GhoStart::default(), GhoSettings::new(10.0));
        follower.take(&known, 0.01, 1.6);
        assert!(follower.told(&known).is_empty() && follower.begun().is_none());
        follower.take(&known, 0.04, 1.6);
        assert_eq!(follower.begun(), Some(0.04));
        assert_eq!(follower.told(&known).len(), 4);
    }

    /// The finger of every segment is where the motion has it.
    #[test]
    fn fingers_of_segments_are_those_of_the_motion() {
        let (part, motion) = (part(), motion());
        let known =
            GhoKnown { part: &part, mu_g: MU_G, radius: RADIUS, motion: &motion, contact: ContactMode::Rolling };
        for t in [0.0, 0.1, 0.39, 0.41, 0.7, 0.8] {
            let off = known.finger(t).centre(t) - motion.centre(t);
            assert!(off.norm() < 1e-15, "{t}: {off}");
        }
    }
}
