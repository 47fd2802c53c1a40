//! Random pushes and a judge: what the estimate from rest is tried on.
//!
//! [`Ranges`] says what problems are drawn from, [`Drawn`] is one of them with what became of it, [`TrialOutcome`]
//! compares an estimate with that truth. The same seed gives the same problem on every machine.
//!
//! Frames: finger axes. Units: SI. Errors: none; a part that cannot be pushed for so long is no problem.

use std::f64::consts::{PI, TAU};
use std::ops::RangeInclusive;

use nalgebra::{Isometry2, Point2, Vector2};

use crate::geometry::{Pose, SimplePolygon};
use crate::gravity::GRAVITY_ASSUMED;
use crate::math::random::Draw;
use crate::pushing::dynamics::{EndReason, FingerShape, Part};
use crate::pushing::estimation::hypotheses::{Estimate, Hypothesis, Status};
use crate::pushing::finger_motion::{FingerMotion, Segment};
use crate::pushing::pushed_world::{Played, PushedWorld};

/// Radius of the default finger's disk, m.
pub const RADIUS_M: f64 = 0.015;

/// A pose counts as right within this many of its stated standard deviations, of distance and of angle. A Gaussian's
/// distance in the plane is beyond five once in 270,000 times.
const RIGHT_SDS: f64 = 5.0;

/// Nearer than this to the truth a pose is right, whatever it states: m, rad.
const RIGHT: PoseError = PoseError { distance: 2e-4, angle: 3e-3 };

/// What random problems are drawn from.
#[derive(Clone, Debug)]
pub struct Ranges {
    /// µ of the plane, as known.
    pub mu: f64,
    /// µ_c between finger and part.
    pub mu_c: RangeInclusive<f64>,
    /// The part's mass, kg.
    pub mass: RangeInclusive<f64>,
    /// Greatest angle between where the finger goes and the contact's normal, rad.
    pub angle: f64,
    /// How far the finger's tip gives way, m/N.
    pub compliance: f64,
    /// The finger's outline where it is not the default disk.
    pub shape: Option<FingerShape>,
    /// How the finger moves.
    pub motion: FingerMotion,
}

/// The finger first goes along x, then turns towards y: its path bends, so that poses that feel alike in a straight
/// push part.
///
/// # Panics
/// Never: the segments are constants.
#[must_use]
pub fn default_motion() -> FingerMotion {
    turning_motion(1)
}

/// So many turns after the straight beginning, three at the most, each to the other side than the one before; of half a second
/// each.
///
/// # Panics
/// Never: the segments are constants.
#[must_use]
pub fn turning_motion(turns: usize) -> FingerMotion {
    let straight = Segment { seconds: 0.3, acceleration: Vector2::new(0.15, 0.0) };
    let turn = |[x, y]: [f64; 2]| Segment { seconds: 0.5, acceleration: Vector2::new(x, y) };
    let turns = [[0.0, 0.15], [0.15, -0.3], [0.0, 0.3]].map(turn).into_iter().take(turns);
    let segments: Vec<_> = std::iter::once(straight).chain(turns).collect();
    FingerMotion::new(Point2::origin(), &segments).expect("constant segments are sound")
}

/// As long and as fast as [`default_motion`], but straight.
///
/// # Panics
/// Never: the segments are constants.
#[must_use]
pub fn straight_motion() -> FingerMotion {
    let segments = [Segment { seconds: 0.8, acceleration: Vector2::new(0.12, 0.0) }];
    FingerMotion::new(Point2::origin(), &segments).expect("constant segments are sound")
}

impl Default for Ranges {
    fn default() -> Self {
        Self {
            mu: 0.3,
            mu_c: 0.1..=0.5,
            mass: 0.2..=0.8,
            angle: 0.8,
            compliance: 0.0,
            shape: None,
            motion: default_motion(),
        }
    }
}

/// A random problem and what became of it.
#[derive(Clone, Debug)]
pub struct Drawn {
    /// µ_c, between finger and part.
    pub mu_c: f64,
    /// Mass of the part, kg.
    pub mass: f64,
    /// The edge that is touched.
    pub edge: usize,
    /// Contact angle at the start, rad: of an elliptic finger the eccentric one.
    pub u: f64,
    /// Contact on the edge at the start, m: of an elliptic part its eccentric angle, rad.
    pub s: f64,
    /// The push as it was simulated.
    pub played: Played,
    /// Starts that were drawn before this one and could not be: the finger does not fit, or the contact leaves the
    /// edge.
    pub redrawn: usize,
}

/// Starts drawn before a part is given up as one that the finger cannot push for so long.
const REDRAWS_MAX: usize = 2000;

/// A random part: two of three are convex, one is a star.
#[must_use]
pub fn random_part(draw: &mut Draw) -> Part {
    let convex = draw.chance(2.0 / 3.0);
    let polygon: SimplePolygon = if convex {
        draw.convex_polygon(8, 0.05)
    } else {
        let n = 5 + draw.index(4);
        draw.star_polygon(n, 0.025, 0.055)
    };
    Part::uniform(polygon)
}

impl Ranges {
    /// A push of this part: the contact uniform along the outline, friction, mass and angle uniform in their ranges.
    /// Redrawn until the finger fits and the contact stays on its edge throughout.
    ///
    /// None if that never happens.
    #[must_use]
    pub fn draw(&self, draw: &mut Draw, part: &Part) -> Option<Drawn> {
        (0..REDRAWS_MAX).find_map(|redrawn| {
            let (edge, s) = place(draw, part)?;
            let [x, y] = self.motion.first_acceleration().into();
            let shape = self.shape.unwrap_or(FingerShape::Disk { radius: RADIUS_M });
            let u = shape.facing(y.atan2(x) + draw.uniform(-self.angle, self.angle));
            let mu_c = draw.uniform(*self.mu_c.start(), *self.mu_c.end());
            let mass = draw.uniform(*self.mass.start(), *self.mass.end());
            let mu_g = self.mu * GRAVITY_ASSUMED;
            let world = PushedWorld { part, mu_g, mass, mu_c, radius: RADIUS_M, motion: &self.motion, edge, u, s };
            let is_curved = self.shape.is_some() || part.semi_axes().is_some();
            let played = if is_curved { world.play_by(shape) } else { world.play() };
            let played = played.ok().filter(|played| played.end == EndReason::Time)?.bent(self.compliance);
            Some(Drawn { mu_c, mass, edge, u, s, played, redrawn })
        })
    }
}

/// An edge, and a place on it (s, m), drawn uniformly along the outline; of an ellipse uniformly by its eccentric angle (rad).
/// None where rounding leaves no edge.
pub fn place(draw: &mut Draw, part: &Part) -> Option<(usize, f64)> {
    if part.semi_axes().is_some() {
        return Some((0, draw.uniform(0.0, TAU)));
    }
    let lengths: Vec<_> = part.polygon().edges().map(|(from, to)| (to - from).norm()).collect();
    let mut left = draw.uniform(0.0, lengths.iter().sum());
    let edge = lengths.iter().position(|length| {
        left -= length;
        left < 0.0
    })?;
    let line = part.edge(edge).ok()?;
    Some((edge, line.s_max + left))
}

/// How far a pose is from the truth, by the nearest of the poses that look the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseError {
    /// Distance of the centres of mass, m.
    pub distance: f64,
    /// Angle, rad, not negative.
    pub angle: f64,
}

/// Compares two poses of a part that `symmetry` turns take to itself.
#[must_use]
pub fn pose_error(part: &Part, symmetry: usize, pose: &Pose, truth: &Isometry2<f64>) -> PoseError {
    let (centre, pose) = (part.centre_of_mass(), pose.isometry());
    let distance = (pose * centre - truth * centre).norm();
    let step = 2.0 * PI / f64::from(u32::try_from(symmetry.max(1)).unwrap_or(u32::MAX));
    let off = pose.rotation.angle_to(&truth.rotation).rem_euclid(step);
    PoseError { distance, angle: off.min(step - off) }
}

/// What came of one case.
#[derive(Clone, Debug)]
pub struct TrialOutcome {
    /// What the host said.
    pub status: Status,
    /// How far its best answer was from the truth.
    pub best: Option<PoseError>,
    /// The same of the listed answer nearest to the truth.
    pub nearest: Option<PoseError>,
    /// Whether one of the listed is right, within what it states.
    pub holds_truth: bool,
    /// How many were listed.
    pub listed: usize,
    /// Starts drawn before this one that could not be.
    pub redrawn: usize,
}

impl TrialOutcome {
    /// Judges an estimate against the truth.
    #[must_use]
    pub fn new(part: &Part, drawn: &Drawn, estimate: &Estimate) -> Self {
        let truth = drawn.played.pose(estimate.time_end);
        let error = |hypothesis: &Hypothesis| {
            truth.as_ref().map(|truth| pose_error(part, estimate.symmetry, &hypothesis.pose_end, truth))
        };
        let errors: Vec<_> = estimate.hypotheses.iter().filter_map(error).collect();
        let holds_truth =
            estimate.hypotheses.iter().zip(&errors).any(|(hypothesis, error)| is_right(part, hypothesis, error));
        let nearest = errors.iter().copied().min_by(|a, b| a.size(part).total_cmp(&b.size(part)));
        Self {
            status: estimate.status(),
            best: errors.first().copied(),
            nearest,
            holds_truth,
            listed: errors.len(),
            redrawn: drawn.redrawn,
        }
    }
}

impl PoseError {
    /// Whether it is no more than what is stated, given by standard deviations of distance (m) and angle (rad), allows.
    #[must_use]
    pub fn is_within(&self, (distance_sd, angle_sd): (f64, f64)) -> bool {
        self.distance <= (RIGHT_SDS * distance_sd).max(RIGHT.distance)
            && self.angle <= (RIGHT_SDS * angle_sd).max(RIGHT.angle)
    }

    /// As one length, m: the turn counts at the radius of gyration.
    fn size(&self, part: &Part) -> f64 {
        self.distance + self.angle * part.inertia_per_mass().sqrt()
    }
}

/// Whether an answer's pose is the true one, within what it states.
#[must_use]
pub fn is_right_pose(part: &Part, symmetry: usize, hypothesis: &Hypothesis, truth: &Isometry2<f64>) -> bool {
    is_right(part, hypothesis, &pose_error(part, symmetry, &hypothesis.pose_end, truth))
}

/// Whether a pose is right within what it states.
fn is_right(part: &Part, hypothesis: &Hypothesis, error: &PoseError) -> bool {
    hypothesis.spread(part).is_some_and(|spread| error.is_within(spread))
}
