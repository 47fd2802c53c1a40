//! The resting pose of a part from a few contacts during a push that starts from rest.
//!
//! Before the push the finger touches the part at a known place u₀ of its own outline; where on the part, s₀, is the
//! only unknown. Each s₀ leads to one motion and so to one contact at each time: those that agree with the contacts
//! felt are the answer. The first contact leaves a few candidates, later ones tell them apart.
//!
//! In reading order: `event_free` (the push as if its contact lasted, at a twentieth of the cost), `root_polishing`
//! (from places that roughly fit the first contact to those that do), `table` (motions looked up).
//!
//! Implements: the initial pose observer of thesis §5.3.2 and §6.2, by a scan of all s₀ instead of Newton's method from
//! a few guesses, so that no candidate is lost (of pushes up to some dozen sizes of the part: beyond, motions part too
//! fast); `table`: the variant that looks motions up instead of simulating them (§8.2.2).
//! Assumes: contact without friction; part and finger at rest at t = 0.
//! Frames: world; s₀ on the part as [`PartSide`] has it. Units: SI, u and its tolerance in the unit of the finger's
//! outline.
//! Errors: [`InitialPoseError`]; "no pose fits" is an answer.

mod event_free;
mod root_polishing;
mod table;
#[cfg(test)]
mod tests;

use std::f64::consts::PI;
use std::ops::Deref;

use nalgebra::{Point2, Vector2};

use self::event_free::{EventFree, SCAN_ERROR};
use self::root_polishing::{EXACT, Rough};
pub use self::table::Table;
use crate::geometry::{Pose, SimplePolygon, distance_to_segment};
use crate::math::angle::wrap_angle;
use crate::math::roots::{NearZero, near_zeros};
use crate::pushing::dynamics::{
    Body, ContactLaw, ContactMode, EdgeEnd, FingerPath, FingerShape, Mass, Part, PartSide, PushRun, ShapeError,
    ShapedModel, ShapedPush, Start, State,
};
use crate::pushing::estimation::hypotheses::{Estimate, Fit, Hypothesis, Observer};
use crate::search::{Halt, Searched, Stop, never};

/// Places looked at on each edge. Motions change with s₀ on the scale of the part, so that folds are wide against a
/// 32nd of an edge.
const LOOKS_ON_EDGE: u32 = 32;

/// Places looked at on half an ellipse.
const LOOKS_ON_ELLIPSE: u32 = 160;

/// How far a finger goes in a push of usual length, in radii of gyration of the part.
const USUAL_TRAVEL: f64 = 4.0;

/// See [`RestingPush::refinement`]: from a few dozen radii on a part near an unstable balance goes any way, and a place
/// may be missed.
const REFINEMENT_MAX: u32 = 16;

/// Steps by which a candidate is moved to where all contacts fit best.
const POLISH_STEPS: usize = 12;

/// Step of the difference by which a candidate is moved, as a share of the interval's length.
const POLISH_DIFFERENCE: f64 = 1e-6;

/// Tolerances that a later contact may be off by before a candidate is moved: motions part by less than a thousandfold.
const HOPELESS: f64 = 1e3;

/// Candidates nearer than this share of the interval's length are one.
const SAME_PLACE: f64 = 1e-7;

/// So are candidates nearer than this share between which the angle fits to rounding: where it hardly depends on the
/// place, as on an ellipse that is nearly a circle, one place is found from either side.
const SAME_STRETCH: f64 = 1e-3;

/// How deep a finger may reach into the part elsewhere, as a share of its size: rounding of the input.
const OVERLAP_TOLERANCE: f64 = 1e-6;

/// Outline and mass of what is pushed.
#[derive(Clone, Debug)]
pub enum Object {
    /// A polygon of uniform density.
    Polygon(SimplePolygon),
    /// An ellipse with its semi-axes along the part's x and y, m.
    Ellipse([f64; 2]),
}

/// A push from rest of which only the place on the part is unknown.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::pushing::dynamics::{FingerPath, FingerShape};
/// use palpate::pushing::estimation::{Contacts, Object, TimedContact};
/// use palpate::{Observer, RestingPush, SimplePolygon};
///
/// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03]].map(Point2::from))?;
/// let (velocity0, acceleration) = (Vector2::zeros(), Vector2::new(0.01, 0.1)); // m/s, m/s²
/// let path = FingerPath { centre0: Point2::origin(), velocity0, acceleration };
/// let push = RestingPush::new(Object::Polygon(block), 0.0, FingerShape::Disk { radius: 0.01 }, path, 1.5)?;
/// let angles = push.predicted(Some(0), 0.005, &[0.6, 0.9]); // rad
/// let felt = vec![TimedContact { t: 0.6, u: angles[0] }, TimedContact { t: 0.9, u: angles[1] }];
/// let estimate = push.estimate(&Contacts { measured: felt, tolerance: 1e-6 });
/// assert!((estimate.hypotheses[0].start.s - 0.005).abs() < 1e-9); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct RestingPush {
    object: Object,
    /// None for an ellipse.
    part: Option<Part>,
    body: Body,
    contact_intervals: Vec<ContactInterval>,
    shape: FingerShape,
    path: FingerPath,
    mu_g: f64,
    u0: f64,
}

/// Where the part may be touched.
#[derive(Clone, Copy, Debug)]
struct ContactInterval {
    /// Of a straight side the first edge.
    edge: Option<usize>,
    side: PartSide,
    /// Least and greatest s₀: m on an edge, rad around an ellipse.
    range: [f64; 2],
}

/// A place that fits all contacts.
struct FittingPlace {
    interval: ContactInterval,
    near: NearZero,
    misfits: Vec<f64>,
}

/// The finger's place on its own outline at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedContact {
    /// Time since the push began, s.
    pub t: f64,
    /// Polar angle on a disk, eccentric angle on an ellipse, rad; on a line m.
    pub u: f64,
}

/// The contacts that were felt and how well.
#[derive(Clone, Debug, PartialEq)]
pub struct Contacts {
    /// Times increasing, above 0; at least one.
    pub measured: Vec<TimedContact>,
    /// Predictions this near agree, in the unit of u.
    pub tolerance: f64,
}

/// A pose in which the part may have rested.
#[derive(Clone, Debug, PartialEq)]
pub struct RestingPose {
    /// The edge that holds the contact at the last one that is explained; none on an ellipse. `s0` is on the same side.
    pub edge: Option<usize>,
    /// Where it is touched: m along an edge, eccentric angle in [0, π) on an ellipse.
    pub s0: f64,
    /// Pose of the part in the world, m and rad.
    pub pose: Pose,
    /// u as predicted less u as felt, for each contact that it has to explain.
    pub residuals: Vec<f64>,
    /// Whether every place of this side fits: nothing tells where it is touched.
    pub anywhere: bool,
}

/// What some contacts say.
#[derive(Clone, Debug, PartialEq)]
pub struct RestingPoses {
    /// Poses that explain all contacts, best first.
    pub solutions: Vec<RestingPose>,
    /// Poses that explain the first contact.
    pub candidates: Vec<RestingPose>,
}

/// A push that cannot be.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum InitialPoseError {
    /// Two straight outlines, or an impossible size.
    #[error(transparent)]
    Shape(#[from] ShapeError),
    /// The finger is not driven into whatever it touches.
    #[error(
        "the finger accelerates away from where it touches at u0, or along it ({toward:?} m/s² outward there, it must be > 0): nothing would be pushed"
    )]
    MovesAway {
        /// Component of the acceleration along the finger's outward normal, m/s².
        toward: f64,
    },
}

impl RestingPush {
    /// A push of `object` on a plane with µ g = `mu_g` (m/s²), by a finger that moves on `path` from rest and touches
    /// at `u0`.
    ///
    /// # Errors
    /// [`InitialPoseError`].
    pub fn new(
        object: Object,
        mu_g: f64,
        shape: FingerShape,
        path: FingerPath,
        u0: f64,
    ) -> Result<Self, InitialPoseError> {
        let (part, body, contact_intervals) = match &object {
            Object::Polygon(polygon) => of_polygon(polygon, mu_g),
            Object::Ellipse(semi_axes) => of_ellipse(*semi_axes, mu_g),
        };
        let push = Self { object, part, body, contact_intervals, shape, path, mu_g, u0 };
        push.contact_intervals.iter().try_for_each(|interval| push.model(interval).map(|_| ()))?;
        let angle = push.normal_angle();
        let toward = path.acceleration.dot(&Vector2::new(angle.cos(), angle.sin()));
        // Written so that NaN is refused.
        if toward > 0.0 { Ok(push) } else { Err(InitialPoseError::MovesAway { toward }) }
    }

    /// Of the finger's outward normal at u₀, rad.
    fn normal_angle(&self) -> f64 {
        match self.shape {
            FingerShape::Disk { .. } => self.u0,
            FingerShape::Ellipse { semi_axes: [a, b] } => (a * self.u0.sin()).atan2(b * self.u0.cos()),
            FingerShape::Line => PI / 2.0,
        }
    }

    fn model(&self, interval: &ContactInterval) -> Result<ShapedModel<'_>, ShapeError> {
        ShapedModel::new(&self.body, interval.side, self.mu_g, self.shape, self.path)
    }

    /// Every resting pose that agrees with contacts (times increasing, above 0; at least one) within `tolerance`.
    ///
    /// Of a disk and an ellipse whole turns of u do not count.
    ///
    /// ```
    /// use nalgebra::{Point2, Vector2};
    /// use palpate::geometry::SimplePolygon;
    /// use palpate::pushing::estimation::{Object, RestingPush, TimedContact};
    /// use palpate::pushing::dynamics::{FingerPath, FingerShape};
    ///
    /// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03]].map(Point2::from))?;
    /// let (velocity0, acceleration) = (Vector2::zeros(), Vector2::new(0.01, 0.1)); // m/s, m/s²
    /// let path = FingerPath { centre0: Point2::origin(), velocity0, acceleration };
    /// let push = RestingPush::new(Object::Polygon(block), 0.0, FingerShape::Disk { radius: 0.01 }, path, 1.5)?;
    /// // A disk pushes the lower edge 5 mm beside the middle.
    /// let measured = push.predicted(Some(0), 0.005, &[0.6, 0.9]);
    /// let contacts = [TimedContact { t: 0.6, u: measured[0] }, TimedContact { t: 0.9, u: measured[1] }];
    /// let poses = push.observe(&contacts, 1e-6);
    /// assert_eq!(poses.solutions.len(), 1);
    /// assert!((poses.solutions[0].s0 - 0.005).abs() < 1e-9); // m
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    #[must_use]
    pub fn observe(&self, contacts: &[TimedContact], tolerance: f64) -> RestingPoses {
        self.observe_until(contacts, tolerance, &never).found
    }

    /// The same, ended when `stop` says so: then with the poses found by then.
    #[must_use]
    pub fn observe_until(&self, contacts: &[TimedContact], tolerance: f64, stop: Stop<'_>) -> Searched<RestingPoses> {
        let halt = Halt::new(stop);
        let poses = self.watched(&halt).observe(contacts, tolerance);
        halt.searched(poses)
    }

    /// The same push, simulated only as long as it should not halt.
    fn watched<'a>(&'a self, halt: &'a Halt<'a>) -> Watched<'a> {
        Watched { push: self, halt }
    }
}

/// A push that is simulated only as long as it should not halt: from then on nothing is known of where it leads to.
pub(super) struct Watched<'a> {
    push: &'a RestingPush,
    halt: &'a Halt<'a>,
}

impl Deref for Watched<'_> {
    type Target = RestingPush;

    fn deref(&self) -> &RestingPush {
        self.push
    }
}

impl Watched<'_> {
    fn observe(&self, contacts: &[TimedContact], tolerance: f64) -> RestingPoses {
        let contacts = self.without_turns(contacts);
        let Some(first) = contacts.first() else {
            return RestingPoses { solutions: Vec::new(), candidates: Vec::new() };
        };
        let contact_intervals = self.contact_intervals.iter().take_while(|_| !self.halt.is_wished());
        let places = contact_intervals.flat_map(|interval| self.scanned(*interval, *first, tolerance));
        let places: Vec<_> = places.collect();
        let last = contacts[contacts.len() - 1];
        // With friction a look at the last contact costs as much as all of them.
        let hopeless = |interval: &ContactInterval, s0: f64| {
            let u = if self.mu_g > 0.0 { None } else { self.angle(interval, s0, last.t) };
            u.is_some_and(|u| (u - last.u).abs() > HOPELESS * tolerance)
        };
        self.judged(&places, &Contacts { measured: contacts, tolerance }, &hopeless)
    }

    /// Places of an interval that fit a contact. Without friction a rough simulation looks around.
    fn scanned(
        &self,
        interval: ContactInterval,
        first: TimedContact,
        tolerance: f64,
    ) -> Vec<(ContactInterval, NearZero)> {
        let grid = interval.grid(self.refinement(first.t));
        let found = if self.mu_g > 0.0 {
            near_zeros(&|s0| self.misfit(&interval, s0, first), &grid, tolerance)
        } else {
            let misfit = |s0: f64| Some(self.scanned_angle(&interval, s0, first.t)? - first.u);
            self.places(&Rough { interval, misfit: &misfit, grid: &grid, error: SCAN_ERROR }, first, tolerance)
        };
        found.into_iter().map(|near| (interval, near)).collect()
    }
}

impl RestingPush {
    /// How much more closely to look than at a push of usual length: motions part as it goes on. No closer than
    /// [`REFINEMENT_MAX`].
    fn refinement(&self, time: f64) -> u32 {
        let radius = self.body.inertia_per_mass().sqrt();
        let gone = 0.5 * self.path.acceleration.norm() * time * time;
        let wanted = (gone / (USUAL_TRAVEL * radius)).sqrt().ceil();
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a few")]
        let whole = wanted.clamp(1.0, f64::from(REFINEMENT_MAX)) as u32;
        whole
    }

    /// Where the finger feels the contact at some times (s, increasing) if it starts at `s0` of an edge (of the
    /// ellipse: none); fewer if the contact ends before.
    #[must_use]
    pub fn predicted(&self, edge: Option<usize>, s0: f64, times: &[f64]) -> Vec<f64> {
        self.interval_of(edge)
            .map_or_else(Vec::new, |interval| self.watched(&Halt::new(&never)).angles(interval, s0, times))
    }

    /// The pose that goes with a place on the part.
    #[must_use]
    pub fn resting_pose(&self, edge: Option<usize>, s0: f64) -> Option<Pose> {
        let interval = self.interval_of(edge)?;
        let (model, state) = (self.model(interval).ok()?, self.start(s0));
        let origin = model.position(0.0, &state);
        Some(Pose { x: origin.x, y: origin.y, theta: model.theta(&state) })
    }

    /// Where an edge, or an ellipse, may be touched.
    fn interval_of(&self, edge: Option<usize>) -> Option<&ContactInterval> {
        let edges = self.part.as_ref().map_or(0, |part| part.polygon().vertices().len());
        let side = match (edge, &self.part) {
            (Some(edge), Some(part)) if edge < edges => Some(part.side(edge)),
            (None, None) => None,
            _ => return None,
        };
        self.contact_intervals.iter().find(|interval| interval.edge == side)
    }

    /// The edge that holds the contact at a time, from a start at `s0`; the last that did, where it ends before.
    fn edge_at(&self, interval: &ContactInterval, s0: f64, time: f64) -> Option<usize> {
        let (part, first) = (self.part.as_ref()?, interval.edge?);
        if part.sides().len() == part.polygon().vertices().len() {
            return Some(first); // Each edge is a side.
        }
        let s = self.watched(&Halt::new(&never)).run(interval, s0, &[time]).map_or(s0, |run| run.last.state.s);
        Some(part.edge_at(first, s))
    }

    fn start(&self, s0: f64) -> State {
        State { u: self.u0, s: s0, omega: 0.0, v_t: 0.0 }
    }
}

impl Watched<'_> {
    /// u at each time until the contact ends.
    fn angles(&self, interval: &ContactInterval, s0: f64, times: &[f64]) -> Vec<f64> {
        let run = self.run(interval, s0, times);
        run.map_or_else(Vec::new, |run| run.samples.iter().map(|sample| sample.state.u).collect())
    }

    /// u at each time, if the contact lasts.
    fn lasting_angles(&self, interval: &ContactInterval, s0: f64, times: &[f64]) -> Option<Vec<f64>> {
        let [low, high] = interval.side.range();
        let event_free = self.mu_g == 0.0 && low <= s0 && s0 <= high;
        match event_free.then(|| self.event_free(interval, s0, times)).flatten() {
            Some(EventFree { angles, lasts: Some(lasts) }) => lasts.then_some(angles),
            _ => Some(self.angles(interval, s0, times)).filter(|angles| angles.len() == times.len()),
        }
    }

    /// u at a time; without friction under the part as if the contact lasted, otherwise none where it does not.
    fn angle(&self, interval: &ContactInterval, s0: f64, time: f64) -> Option<f64> {
        if self.mu_g > 0.0 {
            return self.angles(interval, s0, &[time]).first().copied();
        }
        self.event_free(interval, s0, &[time])?.angles.first().copied()
    }

    /// The push from a place; none where it cannot begin.
    fn run(&self, interval: &ContactInterval, s0: f64, times: &[f64]) -> Option<PushRun> {
        let start = Start::Rest { u: self.u0, s: s0 };
        let push = ShapedPush::new(self.model(interval).ok()?, ContactLaw::Frictionless, start, EdgeEnd::Stop);
        push.ok()?.halting_run(times, self.halt).ok()
    }

    /// Candidates and solutions among places that may fit the first contact; `hopeless` are those that no move within
    /// the tolerance brings to fit the last.
    fn judged(
        &self,
        places: &[(ContactInterval, NearZero)],
        contacts: &Contacts,
        hopeless: &dyn Fn(&ContactInterval, f64) -> bool,
    ) -> RestingPoses {
        let first = contacts.measured.first().copied();
        let mut apart: Vec<(ContactInterval, NearZero)> = Vec::new();
        for &(interval, near) in places {
            let same = |(other, kept): &(ContactInterval, NearZero)| {
                other.is_same_place(&interval, kept.at, near.at)
                    || first.is_some_and(|first| {
                        other.edge == interval.edge && self.is_one_stretch(other, kept, &near, first)
                    })
            };
            if !apart.iter().any(same) && !self.overlaps(&interval, near.at) {
                apart.push((interval, near));
            }
        }
        let possible = apart.iter().filter(|(interval, near)| !hopeless(interval, near.at));
        let fits = possible.take_while(|_| !self.halt.is_wished()).filter_map(|&(interval, near)| {
            let misfits = |s0| self.misfits(&interval, s0, &contacts.measured);
            let (at, misfits) = polished(near.at, interval, &misfits, contacts.tolerance)?;
            Some(FittingPlace { interval, near: NearZero { at, ..near }, misfits })
        });
        let fits = fits.filter(|fit| !self.overlaps(&fit.interval, fit.near.at)).collect();
        let solutions = self.one_each(fits, contacts);
        let time = first.map_or(0.0, |first| first.t);
        let candidate =
            |&(interval, near): &(ContactInterval, NearZero)| self.pose_at(&interval, &near, vec![near.value], time);
        let mut candidates: Vec<_> = apart.iter().take_while(|_| !self.halt.is_wished()).map(candidate).collect();
        // What fits to rounding fits alike, whatever the rounding.
        let misfit = |pose: &RestingPose| squares(&pose.residuals).max(EXACT * EXACT);
        let place = |a: &RestingPose, b: &RestingPose| a.edge.cmp(&b.edge).then(a.s0.total_cmp(&b.s0));
        candidates.sort_by(|a, b| misfit(a).total_cmp(&misfit(b)).then_with(|| place(a, b)));
        RestingPoses { solutions, candidates }
    }

    /// Whether two places that fit the first contact to rounding are one, the places between them fitting too.
    fn is_one_stretch(&self, interval: &ContactInterval, a: &NearZero, b: &NearZero, first: TimedContact) -> bool {
        let fits = |misfit: f64| misfit.abs() <= EXACT;
        let between = || a.at + 0.5 * interval.way(a.at, b.at);
        fits(a.value)
            && fits(b.value)
            && interval.gap(a.at, b.at) < SAME_STRETCH * interval.length()
            && self.misfit(interval, between(), first).is_some_and(fits)
    }

    /// One pose for each stretch of places that all fit, best first.
    fn one_each(&self, mut fits: Vec<FittingPlace>, Contacts { measured, tolerance }: &Contacts) -> Vec<RestingPose> {
        let is_fit = |interval: &ContactInterval, s0: f64| {
            self.misfits(interval, s0, measured).is_some_and(|misfits| all_within(&misfits, *tolerance))
        };
        fits.sort_by(|a, b| squares(&a.misfits).total_cmp(&squares(&b.misfits)));
        let mut kept: Vec<FittingPlace> = Vec::new();
        for fit in fits {
            let joined = |best: &FittingPlace| {
                let (from, way) = (best.near.at, fit.interval.way(best.near.at, fit.near.at));
                best.interval.is_same_place(&fit.interval, from, fit.near.at)
                    || (best.interval.edge == fit.interval.edge
                        && [0.25, 0.5, 0.75].iter().all(|share| is_fit(&fit.interval, from + share * way)))
            };
            if !kept.iter().any(joined) {
                kept.push(fit);
            }
        }
        let last = measured.last().map_or(0.0, |last| last.t);
        kept.into_iter().map(|fit| self.pose_at(&fit.interval, &fit.near, fit.misfits, last)).collect()
    }

    /// u as predicted less u as felt, if the contact lasts as long as the data.
    fn misfits(&self, interval: &ContactInterval, s0: f64, contacts: &[TimedContact]) -> Option<Vec<f64>> {
        let times: Vec<_> = contacts.iter().map(|contact| contact.t).collect();
        let angles = self.lasting_angles(interval, s0, &times)?;
        Some(angles.iter().zip(contacts).map(|(u, contact)| u - contact.u).collect())
    }
}

impl RestingPush {
    /// With the edge that holds the contact at `time`, s.
    fn pose_at(&self, interval: &ContactInterval, near: &NearZero, residuals: Vec<f64>, time: f64) -> RestingPose {
        let s0 = interval.principal(near.at);
        let pose = self.resting_pose(interval.edge, s0).unwrap_or(Pose { x: f64::NAN, y: f64::NAN, theta: f64::NAN });
        RestingPose { edge: self.edge_at(interval, s0, time), s0, pose, residuals, anywhere: near.anywhere }
    }

    /// Whether the finger would reach into the part elsewhere; only parts with reflex corners let it.
    fn overlaps(&self, interval: &ContactInterval, s0: f64) -> bool {
        let semi_axes = match self.shape {
            FingerShape::Disk { radius } => [radius; 2],
            FingerShape::Ellipse { semi_axes } => semi_axes,
            FingerShape::Line => return false,
        };
        let (Object::Polygon(polygon), Some(pose)) = (&self.object, self.resting_pose(interval.edge, s0)) else {
            return false;
        };
        let world = pose.isometry();
        // Where the finger is a disk of radius 1 about the origin.
        let seen = |point: Point2<f64>| {
            let from_centre = world * point - self.path.centre(0.0);
            Point2::new(from_centre.x / semi_axes[0], from_centre.y / semi_axes[1])
        };
        let distance = |a, b| distance_to_segment(Point2::origin(), seen(a), seen(b));
        semi_axes[0] > 0.0 && polygon.edges().any(|(a, b)| distance(a, b) < 1.0 - OVERLAP_TOLERANCE)
    }

    /// Contacts with whole turns taken out, each within half a turn of the one before; on a line as they are.
    fn without_turns(&self, contacts: &[TimedContact]) -> Vec<TimedContact> {
        let mut last = self.u0;
        let continuous = |&TimedContact { t, u }: &TimedContact| {
            let turns = self.shape != FingerShape::Line && (u - last).abs() > PI;
            last = if turns { last + wrap_angle(u - last) } else { u };
            TimedContact { t, u: last }
        };
        contacts.iter().map(continuous).collect()
    }
}

impl Observer for RestingPush {
    type Observation = Contacts;

    fn estimate_until(&self, contacts: &Contacts, stop: Stop<'_>) -> Searched<Estimate> {
        let Searched { found, complete } = self.observe_until(&contacts.measured, contacts.tolerance, stop);
        Searched { found: self.judged_as(&found.solutions, contacts), complete }
    }
}

impl Observer for Table<'_> {
    type Observation = Contacts;

    fn estimate_until(&self, contacts: &Contacts, stop: Stop<'_>) -> Searched<Estimate> {
        let Searched { found, complete } = self.observe_until(&contacts.measured, contacts.tolerance, stop);
        Searched { found: self.push().judged_as(&found.solutions, contacts), complete }
    }
}

impl RestingPush {
    /// Resting poses in the form of every observer's answer, with the motion to the last contact.
    ///
    /// A tolerance is no standard deviation: what fits within it fits, all alike, so there are no covariances, and the
    /// cost is the largest residual over the tolerance, squared.
    fn judged_as(&self, solutions: &[RestingPose], contacts: &Contacts) -> Estimate {
        let time_end = contacts.measured.last().map_or(0.0, |last| last.t);
        let probability = 1.0 / solutions.len().max(1) as f64;
        // Each pose is simulated again for the motion at the last contact.
        let explained = |found: &RestingPose| {
            let interval = self.interval_of(found.edge)?;
            let end = *self.watched(&Halt::new(&never)).run(interval, found.s0, &[time_end])?.samples.last()?;
            let most = found.residuals.iter().fold(0.0_f64, |most, residual| most.max(residual.abs()));
            Some(Hypothesis {
                edge: found.edge.unwrap_or(0),
                side: interval.edge.unwrap_or(0),
                start: self.start(found.s0),
                contact_start: ContactMode::Frictionless,
                end: end.state,
                contact_end: ContactMode::Frictionless,
                law: ContactLaw::Frictionless,
                pose_start: found.pose,
                pose_end: Pose { x: end.position.x, y: end.position.y, theta: end.theta },
                velocity_end: end.velocity,
                covariance: None,
                state_covariance: None,
                mu_g: self.mu_g,
                mu_g_log_sd: None,
                from_force: None,
                cost: (most / contacts.tolerance).powi(2),
                probability,
            })
        };
        let hypotheses: Vec<_> = solutions.iter().filter_map(explained).collect();
        let cost = hypotheses.iter().map(|found| found.cost).reduce(f64::min);
        // s₀ is the one parameter that was fitted.
        let fit = Fit { cost, degrees_of_freedom: contacts.measured.len().saturating_sub(1), cost_max: 1.0 };
        Estimate { hypotheses, ..Estimate::unexplained(fit, time_end) }
    }
}

/// Without friction under it, what a part rests on does not matter; none is the cheapest to compute with.
fn of_polygon(polygon: &SimplePolygon, mu_g: f64) -> (Option<Part>, Body, Vec<ContactInterval>) {
    let part = Part::uniform(polygon.clone());
    let body = if mu_g > 0.0 { part.body().clone() } else { Body::on_feet(&[], Mass::uniform(polygon)) };
    let interval = |(index, edge): (usize, crate::pushing::dynamics::Edge)| ContactInterval {
        edge: Some(index),
        side: PartSide::Edge(edge),
        range: [edge.s_min, edge.s_max],
    };
    let intervals = part.sides().map(interval).collect();
    (Some(part), body, intervals)
}

fn of_ellipse(semi_axes: [f64; 2], mu_g: f64) -> (Option<Part>, Body, Vec<ContactInterval>) {
    let body = if mu_g > 0.0 { Body::ellipse(semi_axes) } else { Body::on_feet(&[], Mass::of_ellipse(semi_axes)) };
    let side = PartSide::Ellipse { semi_axes, middle: Vector2::zeros() };
    (None, body, vec![ContactInterval { edge: None, side, range: [0.0, PI] }])
}

impl ContactInterval {
    fn length(&self) -> f64 {
        self.range[1] - self.range[0]
    }

    /// Places to look at, so many times as many as usual; an ellipse's overlap at the seam, so that nothing hides
    /// there.
    fn grid(&self, refinement: u32) -> Vec<f64> {
        let (looks, beyond) = if self.edge.is_some() { (LOOKS_ON_EDGE, 0) } else { (LOOKS_ON_ELLIPSE, 1) };
        let looks = refinement * looks;
        let place = |index: u32| {
            let share = (f64::from(index) - f64::from(beyond)) / f64::from(looks);
            // The ends to the last bit, for the contact must not start beyond.
            if index == looks && beyond == 0 { self.range[1] } else { self.range[0] + share * self.length() }
        };
        (0..=looks + 2 * beyond).map(place).collect()
    }

    /// An ellipse repeats after half a turn.
    fn principal(&self, s0: f64) -> f64 {
        if self.edge.is_some() { s0 } else { s0.rem_euclid(PI) }
    }

    /// From `a` to `b`, on an ellipse the shorter way.
    fn way(&self, a: f64, b: f64) -> f64 {
        if self.edge.is_some() { b - a } else { (b - a + PI / 2.0).rem_euclid(PI) - PI / 2.0 }
    }

    /// Whether a place on this and one on another interval are one.
    fn is_same_place(&self, other: &Self, here: f64, there: f64) -> bool {
        self.edge == other.edge && self.gap(here, there) < SAME_PLACE * self.length()
    }

    fn gap(&self, a: f64, b: f64) -> f64 {
        self.way(a, b).abs()
    }
}

fn squares(values: &[f64]) -> f64 {
    values.iter().map(|value| value * value).sum()
}

fn all_within(misfits: &[f64], tolerance: f64) -> bool {
    misfits.iter().all(|misfit| misfit.abs() <= tolerance)
}

/// The place near a candidate at which all contacts fit best, with what they are off by, if they all fit there.
fn polished(
    s0: f64,
    interval: ContactInterval,
    misfits: &dyn Fn(f64) -> Option<Vec<f64>>,
    tolerance: f64,
) -> Option<(f64, Vec<f64>)> {
    let (mut at, mut here) = (s0, misfits(s0)?);
    for _ in 0..POLISH_STEPS {
        // Exact data fit to a thousandth already.
        if all_within(&here, 1e-3 * tolerance) {
            break;
        }
        let Some((next, there)) = improved(at, &here, interval, misfits) else { break };
        (at, here) = (next, there);
    }
    all_within(&here, tolerance).then_some((at, here))
}

/// A Gauss–Newton step, shortened until it improves; none if it does not.
fn improved(
    at: f64,
    here: &[f64],
    interval: ContactInterval,
    misfits: &dyn Fn(f64) -> Option<Vec<f64>>,
) -> Option<(f64, Vec<f64>)> {
    let look = POLISH_DIFFERENCE * interval.length();
    let beside = misfits(at + look).map(|there| (there, look)).or_else(|| Some((misfits(at - look)?, -look)))?;
    let slopes: Vec<_> = beside.0.iter().zip(here).map(|(there, here)| (there - here) / beside.1).collect();
    let full = -here.iter().zip(&slopes).map(|(misfit, slope)| misfit * slope).sum::<f64>() / squares(&slopes);
    [1.0, 0.3, 0.1, 0.01].iter().find_map(|share| {
        let next = at + share * full;
        let there = misfits(next)?;
        (squares(&there) < squares(here) * (1.0 - 1e-9)).then_some((next, there))
    })
}
