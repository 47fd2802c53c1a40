//! Finding a part by touch: what approaches of a finger say about its pose, and which approach to make next.
//!
//! A finger's disk goes along straight lines. Either it meets the part, and then its centre is on the curve at the disk's
//! radius from the outline, with a normal within the friction angle of the force that was felt; or it passes, and then
//! the part is nowhere on its way. Of the part only its outline is known, and a rectangle that holds it.
//!
//! - Before the first touch poses are tried that spread evenly over the rectangle and all turns (`cells`).
//! - The first touch leaves a surface of poses: where on the outline, and which turn. It is covered by cells; a cell is
//!   dropped where a bound on its motion shows that some touch or some way passed cannot be there ([`cells`]).
//! - What is left falls into groups; in each, least squares finds the pose and its covariance ([`fit`]).
//! - Of several parts each has its own cover; one whose cover is empty is not it ([`PartsSearch`]).
//! - The next approach is the line after which the least is expected to be left ([`plan`]). How fast it may go follows
//!   from what holds the part in place ([`crate::pushing::approach_speed`]); between approaches the finger goes round the
//!   rectangle ([`way_round`]).
//!
//! Nothing is sampled once something was touched: a pose that is left out is so by a bound, at [`TRUSTED_SD`] standard
//! deviations.
//!
//! Source: expected remaining probability as a choice of action is that of the touch localisation of Hsiao, Kaelbling
//! and Lozano-Pérez (2008); covers by cells with Lipschitz bounds are standard. Symbols in `docs/NOTATION.md`.
//! Pure. Frames: world, unless named. Units: m, rad. Errors: none; "no pose" and "touch cannot tell" are answers.

mod cells;
mod fit;
mod parts;
mod plan;
mod route;
#[cfg(test)]
mod tests;

use nalgebra::{Point2, Vector2};

use super::noise::PoseMode;
use crate::geometry::disk_curve::DiskCurve;
use crate::geometry::{Pose, SimplePolygon, distance_to_segment};
use cells::{Cells, Way};
pub use parts::{PartLeft, PartsSearch, PartsVerdict};
pub use plan::NextTouch;
pub(in crate::inscription) use plan::across;
pub use route::way_round;

/// A reading is believed to be within so many standard deviations: one in 16,000 is not.
pub const TRUSTED_SD: f64 = 4.0;

/// What is stated of a pose is to hold at so many standard deviations.
const STATED_SD: f64 = 3.0;

/// What is known before the first touch.
#[derive(Clone, Debug, PartialEq)]
pub struct TouchTask {
    /// The part.
    pub outline: SimplePolygon,
    /// Of the finger's disk, m.
    pub radius: f64,
    /// Two corners of the rectangle that holds all of the part, the lesser coordinates first.
    pub area: [Point2<f64>; 2],
    /// When a pose is good enough.
    pub tolerance: TouchTolerance,
}

/// When a pose is good enough, and when two are the same to touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TouchTolerance {
    /// Of the outline's centroid, m; outlines nowhere farther apart than this are one to touch.
    pub distance: f64,
    /// Of the turn, rad.
    pub angle: f64,
}

impl Default for TouchTolerance {
    /// 0.2 mm and 0.3°.
    fn default() -> Self {
        Self { distance: 2e-4, angle: 0.3_f64.to_radians() }
    }
}

/// A straight way of the disk's centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Approach {
    /// Where it begins.
    pub from: Point2<f64>,
    /// Length 1.
    pub direction: Vector2<f64>,
    /// m.
    pub length: f64,
}

impl Approach {
    /// The centre after a travel (m).
    #[must_use]
    pub fn at(&self, travel: f64) -> Point2<f64> {
        self.from + self.direction * travel
    }
}

/// A touch as a finger with a disk feels it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerTouch {
    /// The disk's centre, the beam's bending taken into account.
    pub centre: Point2<f64>,
    /// Standard deviation of the distance between centre and outline, m.
    pub sigma: f64,
    /// Polar angle of the force on the finger, rad: the part's outward normal but for friction.
    pub force_angle: f64,
    /// The normal is no farther from it than this, rad.
    pub half_width: f64,
}

/// A finger that stands and presses: what its robot and its gauges say.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PressedFinger {
    /// Where the robot says that the disk's centre would be without force, m.
    pub place: Point2<f64>,
    /// Standard deviation of each coordinate of that, m.
    pub place_sd: f64,
    /// On the finger, N.
    pub force: Vector2<f64>,
    /// Of the tip, m/N: the beam's bending.
    pub compliance: f64,
    /// Standard deviation of its logarithm.
    pub compliance_log_sd: f64,
    /// Friction with the part, and how well the force's direction is known, rad.
    pub friction_angle: f64,
    /// Standard deviation, rad.
    pub angle_sd: f64,
    /// The part may have been moved by so much since it was touched, m.
    pub moved: f64,
}

impl PressedFinger {
    /// The touch that this is: the tip is where the beam, bent by the force, leaves it.
    #[must_use]
    pub fn touch(&self) -> FingerTouch {
        let bent = self.force * self.compliance;
        FingerTouch {
            centre: self.place + bent,
            sigma: self.place_sd.hypot(bent.norm() * self.compliance_log_sd).hypot(self.moved),
            force_angle: self.force.y.atan2(self.force.x),
            half_width: self.friction_angle + TRUSTED_SD * self.angle_sd,
        }
    }
}

/// What came of an approach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Met {
    /// The finger came to its end without a touch.
    Nothing,
    /// It was stopped by the part.
    Part(FingerTouch),
}

/// What is known by now.
#[derive(Clone, Debug, PartialEq)]
pub enum TouchVerdict {
    /// Several poses are left, or one that is not known well enough: touch again.
    Open {
        /// Those found so far, best first: all of them where there are three touches or more.
        modes: Vec<PoseMode>,
    },
    /// One pose is left, within the tolerance.
    One(PoseMode),
    /// Poses in which the outline is the same within the tolerance: no touch tells them apart.
    Alike(Vec<PoseMode>),
    /// No pose of this part explains what was felt.
    NoPose,
}

/// The search for one part by touch.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::inscription::{Approach, Met, TouchSearch, TouchTask, TouchTolerance, TouchVerdict};
///
/// let outline = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.02, 0.04]].map(Point2::from))?;
/// let area = [Point2::origin(), Point2::new(0.2, 0.2)];
/// let task = TouchTask { outline, radius: 0.015, area, tolerance: TouchTolerance::default() };
/// let mut search = TouchSearch::new(task);
/// let next = search.next().ok_or("nowhere to go")?;
/// search.take(&next.approach, &Met::Nothing); // across the square, and nothing was there
/// assert!(matches!(search.verdict(), TouchVerdict::Open { .. }));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct TouchSearch {
    task: TouchTask,
    curve: DiskCurve,
    touches: Vec<FingerTouch>,
    passed: Vec<Way>,
    /// Ways that met nothing since the last touch.
    barren: i32,
    /// Before the first touch so many poses stand for all.
    spread: u32,
    belief: Belief,
}

/// The poses that are left.
#[derive(Clone, Debug)]
enum Belief {
    /// Nothing was touched: poses spread evenly.
    Spread(Vec<Pose>),
    /// A cover of all that is left, with what fits best in each group of it.
    Covered { cells: Cells, modes: Vec<PoseMode> },
}

impl TouchSearch {
    /// Nothing was touched yet.
    #[must_use]
    pub fn new(task: TouchTask) -> Self {
        Self::with_spread(task, cells::SPREAD)
    }

    /// The same, where so many poses stand for all before the first touch.
    fn with_spread(task: TouchTask, spread: u32) -> Self {
        let curve = DiskCurve::new(&task.outline, task.radius);
        let belief = Belief::Spread(cells::spread(&task, &[], spread));
        Self { task, curve, touches: Vec::new(), passed: Vec::new(), barren: 0, spread, belief }
    }

    /// How many poses stand for what is left.
    fn left(&self) -> usize {
        match &self.belief {
            Belief::Spread(poses) => poses.len(),
            Belief::Covered { cells, modes } if modes.is_empty() => cells.len(),
            Belief::Covered { modes, .. } => modes.len(),
        }
    }

    /// The poses found so far, best first.
    fn modes(&self) -> &[PoseMode] {
        match &self.belief {
            Belief::Spread(_) => &[],
            Belief::Covered { modes, .. } => modes,
        }
    }

    /// Some of the poses that are left since the first touch, spread over them, at most so many: those found, or, where they are
    /// not told apart yet, what stands for them.
    #[must_use]
    pub fn some_poses(&self, most: usize) -> Vec<Pose> {
        match &self.belief {
            Belief::Spread(_) => Vec::new(),
            Belief::Covered { cells, modes } if modes.is_empty() => {
                let stride = cells.len().div_ceil(most.max(1)).max(1);
                cells.middles(&self.task, &self.curve, 0, stride).map(|middle| middle.pose).collect()
            }
            Belief::Covered { modes, .. } => modes.iter().take(most).map(|mode| mode.pose).collect(),
        }
    }

    /// What was told beforehand.
    #[must_use]
    pub fn task(&self) -> &TouchTask {
        &self.task
    }

    /// The touches so far.
    #[must_use]
    pub fn touches(&self) -> &[FingerTouch] {
        &self.touches
    }

    /// Takes what came of an approach.
    pub fn take(&mut self, approach: &Approach, met: &Met) {
        let slack = TRUSTED_SD * self.touches.iter().map(|touch| touch.sigma).fold(0.0, f64::max);
        match met {
            Met::Nothing => {
                let end = approach.at(approach.length);
                self.passed.push(Way { from: approach.from, to: end, slack });
                self.barren += 1;
            }
            Met::Part(touch) => {
                // The disk came to where it touches without meeting anything.
                let slack = slack.max(TRUSTED_SD * touch.sigma);
                self.passed.push(Way { from: approach.from, to: touch.centre, slack });
                self.touches.push(*touch);
                self.barren = 0;
            }
        }
        self.belief = match std::mem::replace(&mut self.belief, Belief::Spread(Vec::new())) {
            Belief::Covered { cells, .. } => self.covered(cells),
            Belief::Spread(_) => match self.touches.first() {
                Some(first) => self.covered(Cells::about(&self.task, &self.curve, first)),
                None => Belief::Spread(cells::spread(&self.task, &self.passed, self.spread)),
            },
        };
    }

    fn covered(&self, mut cells: Cells) -> Belief {
        cells.refine(&self.task, &self.curve, &self.touches, &self.passed, self.barren);
        let modes = fit::modes(&self.task, &self.curve, &self.touches, &cells);
        Belief::Covered { cells, modes }
    }

    /// What is known by now.
    #[must_use]
    pub fn verdict(&self) -> TouchVerdict {
        let Belief::Covered { cells, modes } = &self.belief else {
            let Belief::Spread(poses) = &self.belief else { unreachable!("a belief is one of two") };
            return if poses.is_empty() { TouchVerdict::NoPose } else { TouchVerdict::Open { modes: Vec::new() } };
        };
        if cells.is_empty() || cells.is_fine() && modes.is_empty() {
            return TouchVerdict::NoPose;
        }
        let is_known = |mode: &PoseMode| self.excess(&mode.pose, &mode.covariance) <= 1.0;
        let Some((best, others)) = modes.split_first().filter(|_| cells.is_fine() && modes.iter().all(is_known)) else {
            return TouchVerdict::Open { modes: modes.clone() };
        };
        if others.is_empty() {
            TouchVerdict::One(*best)
        } else if others.iter().all(|other| self.is_alike(&best.pose, &other.pose)) {
            TouchVerdict::Alike(modes.clone())
        } else {
            TouchVerdict::Open { modes: modes.clone() }
        }
    }

    /// The approach after which the least is expected to be left; none where no pose is.
    #[must_use]
    pub fn next(&self) -> Option<NextTouch> {
        plan::next(&[self])
    }

    /// Standard deviations of a pose: of the outline's centroid in its worst direction (m), and of the turn (rad).
    #[must_use]
    pub fn deviations(&self, mode: &PoseMode) -> [f64; 2] {
        let (distance, angle) = fit::deviations(&self.task, &mode.pose, &mode.covariance);
        [distance, angle]
    }

    /// How far a pose is from being known well enough: at most 1 where it is.
    fn excess(&self, pose: &Pose, covariance: &nalgebra::Matrix3<f64>) -> f64 {
        let (distance, angle) = fit::deviations(&self.task, pose, covariance);
        let TouchTolerance { distance: distance_max, angle: angle_max } = self.task.tolerance;
        STATED_SD * (distance / distance_max).max(angle / angle_max)
    }

    /// Whether the outline is the same in two poses, within the tolerance.
    fn is_alike(&self, a: &Pose, b: &Pose) -> bool {
        outlines_apart(&self.task.outline, a, b) <= self.task.tolerance.distance
    }
}

/// How far the outlines of a part in two poses are apart at most, from corners of either, m.
#[must_use]
pub fn outlines_apart(outline: &SimplePolygon, a: &Pose, b: &Pose) -> f64 {
    shapes_apart((outline, a), (outline, b))
}

/// How far two outlines in their poses are apart at most, from corners of either, m.
#[must_use]
pub fn shapes_apart(a: (&SimplePolygon, &Pose), b: (&SimplePolygon, &Pose)) -> f64 {
    let one_way = |(a, at): (&SimplePolygon, &Pose), (b, other_at): (&SimplePolygon, &Pose)| {
        let between = other_at.isometry().inverse() * at.isometry();
        let to_outline = |corner: &Point2<f64>| {
            let corner = between * corner;
            b.edges().map(|(start, end)| distance_to_segment(corner, start, end)).fold(f64::INFINITY, f64::min)
        };
        a.vertices().iter().map(to_outline).fold(0.0, f64::max)
    };
    one_way(a, b).max(one_way(b, a))
}
