//! A simulated world in which a finger that begins at rest pushes a part: the truth behind demonstrations and tests.
//!
//! The finger touches the part, both at rest; then it moves as a [`FingerMotion`] says, and Coulomb's law decides at
//! every moment whether the contact rolls or slides. What comes out is the part's motion and the force on the finger's
//! disk.
//!
//! A part may be elliptic and a finger of any outline, too: [`PushedWorld::play_by`].
//!
//! Assumes: as [`crate::pushing::dynamics`]; the contact stays on its edge. Frames: finger axes, with the origin of the
//! motion's file; **force is the force on the finger's disk**. Units: SI.
//! Errors: [`WorldError`] for a start that cannot be. A push that ends early is an answer.

use nalgebra::{Isometry2, Vector2};

use crate::math::angle::wrap_angle;
use crate::pushing::dynamics::{
    ContactLaw, Edge, EdgeEnd, EndReason, FingerShape, ModelError, Part, PartSide, Push, PushError, PushModel, PushRun,
    PushRunError, Sample, ShapeError, ShapedModel, ShapedPush, Start, State,
};
use crate::pushing::finger_motion::{FingerMotion, Leg, Segment};

/// Time between two states that are kept, s: the time of one conversion. A force that jumps, where sliding stops or the
/// finger's acceleration changes, comes late or early by no more than the converter would have it.
pub const STEP_S: f64 = 250e-6;

/// How long a µ_c that wanders along an edge stays what it is, s: a contact slides by a tenth of a millimetre meanwhile.
pub const WANDER_STEP_S: f64 = 2e-3;

/// A part, a finger, and how they touch.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::pushing::finger_motion::Segment;
/// use palpate::{FingerMotion, GRAVITY_ASSUMED, Part, PushedWorld, SimplePolygon};
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let ahead = Segment { seconds: 0.3, acceleration: Vector2::new(0.0, 0.15) };
/// let motion = FingerMotion::new(Point2::origin(), &[ahead])?;
/// let (mu_g, mass, mu_c) = (0.3 * GRAVITY_ASSUMED, 0.2, 0.3);
/// let (edge, u, s) = (0, std::f64::consts::FRAC_PI_2, 0.0);
/// let played = PushedWorld { part: &part, mu_g, mass, mu_c, radius: 0.01, motion: &motion, edge, u, s }.play()?;
/// // The finger feels friction and inertia: 0.2 kg · (0.3 g + 0.15 m/s²), against its motion.
/// assert!((played.forces_finger[0].y + mass * (mu_g + 0.15)).abs() < 1e-6); // N
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PushedWorld<'p> {
    /// The part on its plane.
    pub part: &'p Part,
    /// µ g of the plane, m/s².
    pub mu_g: f64,
    /// The part's mass, kg.
    pub mass: f64,
    /// µ_c between finger and part.
    pub mu_c: f64,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// How the finger moves.
    pub motion: &'p FingerMotion,
    /// The edge that it touches.
    pub edge: usize,
    /// Contact angle at the start, rad.
    pub u: f64,
    /// Contact on the edge at the start, m.
    pub s: f64,
}

/// A push as it was simulated.
#[derive(Clone, Debug)]
pub struct Played {
    /// The part each [`STEP_S`]; where the finger's acceleration changes twice, before and after.
    pub samples: Vec<Sample>,
    /// Force on the disk in finger axes at the same times, N.
    pub forces_finger: Vec<Vector2<f64>>,
    /// What ended the push: `Time` is the end of the motion.
    pub end: EndReason,
}

/// Why a world cannot be played.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WorldError {
    /// The part has fewer edges.
    #[error(transparent)]
    Edge(#[from] ModelError),
    /// Outlines that do not touch at a point.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// Impossible from the start.
    #[error(transparent)]
    Push(#[from] PushError),
    /// Could not be followed.
    #[error(transparent)]
    Run(#[from] PushRunError),
}

impl PushedWorld<'_> {
    /// Lets the finger move.
    ///
    /// # Errors
    /// [`WorldError`].
    pub fn play(&self) -> Result<Played, WorldError> {
        self.play_legs_along(self.motion, |_| 1.0)
    }

    /// The same with a finger of this outline in place of the disk, and of a part that may be elliptic: the edge is one of
    /// [`Part::touchable`], `u` and `s` are the outlines' own parameters, of an ellipse its eccentric angle, rad.
    ///
    /// ```
    /// use std::f64::consts::FRAC_PI_2;
    ///
    /// use nalgebra::{Point2, Vector2};
    /// use palpate::pushing::dynamics::{Body, FingerShape};
    /// use palpate::pushing::finger_motion::Segment;
    /// use palpate::{FingerMotion, GRAVITY_ASSUMED, Part, PushedWorld};
    ///
    /// let part = Part::elliptic([0.03, 0.02], Body::ellipse([0.03, 0.02]));
    /// let ahead = Segment { seconds: 0.3, acceleration: Vector2::new(0.0, 0.15) };
    /// let motion = FingerMotion::new(Point2::origin(), &[ahead])?;
    /// let (mu_g, mass, mu_c) = (0.3 * GRAVITY_ASSUMED, 0.2, 0.3);
    /// let (edge, u, s) = (0, FRAC_PI_2, -FRAC_PI_2);
    /// let world = PushedWorld { part: &part, mu_g, mass, mu_c, radius: 0.01, motion: &motion, edge, u, s };
    /// let played = world.play_by(FingerShape::Ellipse { semi_axes: [0.01, 0.006] })?;
    /// // Both stand with their long sides across: their centres are the short semi-axes apart.
    /// assert!((played.samples[0].position - Point2::new(0.0, 0.026)).norm() < 1e-9); // m
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// [`WorldError`].
    pub fn play_by(&self, shape: FingerShape) -> Result<Played, WorldError> {
        let side = self.part.touched(self.edge)?;
        self.play_legs(self.motion, shape, |leg, start| self.run_shaped(side, shape, leg, start))
    }

    /// The same with a µ_c that is so many times as much at a place on the edge, m: kept over each [`WANDER_STEP_S`].
    ///
    /// # Errors
    /// [`WorldError`].
    ///
    /// # Panics
    /// Never: a motion in pieces is one.
    pub fn play_along(&self, factor: impl Fn(f64) -> f64) -> Result<Played, WorldError> {
        let pieces = self.motion.segments().iter().flat_map(|segment| {
            let pieces = (segment.seconds / WANDER_STEP_S).ceil().max(1.0);
            let piece = Segment { seconds: segment.seconds / pieces, ..*segment };
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "pieces of a push")]
            std::iter::repeat_n(piece, pieces as usize)
        });
        let motion = FingerMotion::new(self.motion.centre(0.0), &pieces.collect::<Vec<_>>());
        self.play_legs_along(&motion.expect("pieces of a motion are one"), factor)
    }

    fn play_legs_along(&self, motion: &FingerMotion, factor: impl Fn(f64) -> f64) -> Result<Played, WorldError> {
        let edge = self.part.edge(self.edge)?;
        let disk = FingerShape::Disk { radius: self.radius };
        self.play_legs(motion, disk, |leg, start| {
            let (Start::Rest { s, .. } | Start::Moving(State { s, .. })) = start;
            self.run(edge, leg, start, self.mu_c * factor(s))
        })
    }

    fn play_legs(
        &self,
        motion: &FingerMotion,
        shape: FingerShape,
        run: impl Fn(&Leg, Start) -> Result<PushRun, WorldError>,
    ) -> Result<Played, WorldError> {
        let mut start = Start::Rest { u: self.u, s: self.s };
        let mut played = Played { samples: Vec::new(), forces_finger: Vec::new(), end: EndReason::Time };
        for leg in motion.legs(self.radius) {
            let run = run(&leg, start)?;
            start = Start::Moving(run.last.state);
            played.take(&run, &leg, &shape, self.mass);
            if run.end.reason != EndReason::Time {
                played.end = run.end.reason;
                break;
            }
        }
        Ok(played)
    }

    fn run(&self, edge: Edge, leg: &Leg, start: Start, mu_c: f64) -> Result<PushRun, WorldError> {
        let model = PushModel { part: self.part, edge, mu_g: self.mu_g, finger: leg.finger };
        let law = ContactLaw::Coulomb { friction: mu_c };
        Ok(Push::new(model, law, start, EdgeEnd::Stop)?.run(&times(leg))?)
    }

    fn run_shaped(&self, side: PartSide, shape: FingerShape, leg: &Leg, start: Start) -> Result<PushRun, WorldError> {
        let model = ShapedModel::new(self.part.body(), side, self.mu_g, shape, leg.finger.path())?;
        let law = ContactLaw::Coulomb { friction: self.mu_c };
        Ok(ShapedPush::new(model, law, start, EdgeEnd::Stop)?.around(self.part)?.run(&times(leg))?)
    }
}

/// A leg's start, the common grid's times in it, and its end, since its start.
fn times(leg: &Leg) -> Vec<f64> {
    let grid = std::iter::successors(Some((leg.from / STEP_S).floor() + 1.0), |step| Some(step + 1.0));
    let length = leg.to - leg.from;
    let within = grid.map(|step| step * STEP_S - leg.from).filter(|t| *t > SAME_TIME_S);
    [0.0].into_iter().chain(within.take_while(|t| *t < length - SAME_TIME_S)).chain([length]).collect()
}

/// Times nearer than this are one: rounding of sums of segments, s.
const SAME_TIME_S: f64 = 1e-9;

impl Played {
    fn take(&mut self, run: &PushRun, leg: &Leg, shape: &FingerShape, mass: f64) {
        for sample in &run.samples {
            let sample = Sample { t: leg.from + sample.t, ..*sample };
            self.samples.push(sample);
            self.forces_finger.push(force_finger(&sample, shape, mass));
        }
    }

    /// The same with a finger whose tip gives way by so much, m/N: its disk, and the part with it, are that much of the
    /// force behind where the clamp would have them. Bending follows the force at once and stores no motion; what it
    /// takes at the very start, until friction is overcome, is left out.
    #[must_use]
    pub fn bent(mut self, compliance: f64) -> Self {
        for (sample, force) in self.samples.iter_mut().zip(&self.forces_finger) {
            sample.position += force * compliance;
        }
        self
    }

    /// How long the push lasted, s.
    #[must_use]
    pub fn duration(&self) -> f64 {
        self.samples.last().map_or(0.0, |sample| sample.t)
    }

    /// Pose of the part (part frame to the motion's) at a time, s, between the states kept; before the first and after the
    /// last that of these.
    #[must_use]
    pub fn pose(&self, t: f64) -> Option<Isometry2<f64>> {
        let after = self.samples.partition_point(|sample| sample.t <= t).min(self.samples.len().checked_sub(1)?);
        let (from, to) = (&self.samples[after.saturating_sub(1)], &self.samples[after]);
        let share = share_of(t, from.t, to.t);
        let angle = from.theta + share * wrap_angle(to.theta - from.theta);
        Some(Isometry2::new(from.position.coords.lerp(&to.position.coords, share), angle))
    }

    /// Force on the disk each [`STEP_S`] from the start to the end, finger axes, N.
    #[must_use]
    pub fn forces_evenly(&self) -> Vec<Vector2<f64>> {
        let steps = std::iter::successors(Some(0.0), |step| Some(step + 1.0));
        let duration = self.duration();
        steps
            .take_while(|step| step * STEP_S <= duration + SAME_TIME_S)
            .map(|step| self.force_finger(step * STEP_S))
            .collect()
    }

    /// Force on the disk at a time, s, between the states kept; before the first and after the last that of these. Finger
    /// axes, N.
    ///
    /// # Panics
    /// Never of what was played: it has states.
    #[must_use]
    pub fn force_finger(&self, t: f64) -> Vector2<f64> {
        let after = self.samples.partition_point(|sample| sample.t <= t).min(self.samples.len() - 1);
        let before = after.saturating_sub(1);
        let share = share_of(t, self.samples[before].t, self.samples[after].t);
        self.forces_finger[before].lerp(&self.forces_finger[after], share)
    }
}

/// How far a time is from one to another, from 0 to 1; 0 where they are the same.
fn share_of(t: f64, from: f64, to: f64) -> f64 {
    if to > from { ((t - from) / (to - from)).clamp(0.0, 1.0) } else { 0.0 }
}

/// Force on the disk, finger axes, N; none where the part jams.
fn force_finger(sample: &Sample, shape: &FingerShape, mass: f64) -> Vector2<f64> {
    let (sin, cos) = shape.normal_angle(sample.state.u).sin_cos();
    let on_part = |normal: f64, along: f64| Vector2::new(cos, sin) * normal + Vector2::new(sin, -cos) * along;
    sample.force.map_or_else(Vector2::zeros, |force| -on_part(force.normal, force.tangential) * mass)
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::gravity::GRAVITY_ASSUMED;

    /// What the integrations of both models, each to its own error, may be apart, m and N.
    const APART: (f64, f64) = (1e-8, 1e-6);

    #[test]
    fn a_disk_plays_alike_by_its_own_model_and_by_that_of_any_outline() {
        let corners = [[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03], [-0.03, 0.02]];
        let part = Part::uniform(SimplePolygon::new(corners.map(Point2::from)).unwrap());
        let stretch = |seconds, x, y| Segment { seconds, acceleration: Vector2::new(x, y) };
        let motion = FingerMotion::new(Point2::origin(), &[stretch(0.3, 0.0, 0.15), stretch(0.3, 0.15, 0.0)]).unwrap();
        let (part, mu_g, radius, motion) = (&part, 0.3 * GRAVITY_ASSUMED, 0.01, &motion);
        let world = PushedWorld { part, mu_g, mass: 0.3, mu_c: 0.2, radius, motion, edge: 0, u: 1.4, s: 0.005 };
        let (own, any) = (world.play().unwrap(), world.play_by(FingerShape::Disk { radius }).unwrap());
        assert_eq!((own.end, own.samples.len()), (any.end, any.samples.len()));
        for t in [0.1, 0.29, 0.31, 0.6] {
            let off = (own.pose(t).unwrap().translation.vector - any.pose(t).unwrap().translation.vector).norm();
            let force_off = (own.force_finger(t) - any.force_finger(t)).norm();
            assert!(off < APART.0 && force_off < APART.1, "{t} s: {off} m, {force_off} N");
        }
    }
}
