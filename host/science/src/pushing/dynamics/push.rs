//! A push from its start: what is asked, checked once.
//!
//! Assumes, frames, units: see [`super::model`]. Errors: [`PushError`] names what is impossible from the start. What
//! ends a push later, or at once, is an [`End`](super::End), not an error.

use nalgebra::{Point2, Vector2};

use super::contact_mode::{ContactFriction, SLIP_NONE, slip_left};
use super::contact_model::{ContactModel, normal as normal_of};
use super::curve::{FingerShape, PartSide};
use super::model::{ContactMode, FingerPath, Part, PushModel, Slip, State};
use super::shaped::ShapedModel;
use crate::geometry::distance_to_segment;

/// How far beyond an edge's end, or into the part, is put down to rounding of the input, m: printed micrometres pass
/// exactly.
const PLACE_TOLERANCE: f64 = 1e-9;

/// What happens at the contact, and what ends it. Friction is µ_c between finger and part.
///
/// ```
/// use palpate::ContactLaw;
///
/// let law = ContactLaw::Coulomb { friction: 0.3 }; // sticks within the cone of 17°, slides outside of it
/// assert_ne!(law, ContactLaw::Rolling { friction: Some(0.3) }); // which ends where it would slide
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactLaw {
    /// Without friction between finger and part.
    Frictionless,
    /// Rolling, until the force leaves the friction cone if there is one.
    Rolling {
        /// µ_c; none for a contact that never slips.
        friction: Option<f64>,
    },
    /// Sliding in one direction, until that stops.
    Sliding {
        /// µ_c, between finger and part.
        friction: f64,
        /// Where the part slides.
        slip: Slip,
    },
    /// Rolls and slides as Coulomb's law demands.
    Coulomb {
        /// µ_c, between finger and part.
        friction: f64,
    },
}

/// How a push starts, at t = 0.
///
/// ```
/// use palpate::{Start, State};
///
/// let at_rest = Start::Rest { u: 1.5, s: 0.005 }; // rad, m
/// let moving = Start::Moving(State { u: 1.5, s: 0.005, omega: 0.2, v_t: 0.0 });
/// assert_ne!(at_rest, moving);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Start {
    /// In motion. `v_t` is ignored for [`ContactLaw::Rolling`].
    Moving(State),
    /// Part and finger at rest, the finger accelerating into the part.
    Rest {
        /// Contact angle, rad.
        u: f64,
        /// Contact on the edge, m.
        s: f64,
    },
}

impl Start {
    /// Contact angle and place on the edge.
    pub(super) fn contact(&self) -> (f64, f64) {
        match *self {
            Self::Moving(State { u, s, .. }) | Self::Rest { u, s } => (u, s),
        }
    }
}

/// A push to simulate: see [`PushOf::run`].
#[derive(Clone, Debug)]
pub struct PushOf<M> {
    pub(super) model: M,
    pub(super) law: ContactLaw,
    pub(super) start: Start,
    pub(super) edge_end: EdgeEnd,
    pub(super) track: FingerTrack,
    pub(super) obstacles: Vec<Obstacle>,
    pub(super) ends_at_second_contact: bool,
}

/// Another edge that the finger can reach while it pushes one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Obstacle {
    pub(super) edge: usize,
    /// From the centre of mass, part axes, m.
    pub(super) ends: [Vector2<f64>; 2],
}

/// A disk that pushes an edge of a polygon.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, SimplePolygon, Start};
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::zeros(), Vector2::new(0.0, 0.2)); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 0.3 * 9.81, finger };
/// // Straight at the middle, from rest: the block goes along without turning.
/// let start = Start::Rest { u: std::f64::consts::FRAC_PI_2, s: 0.0 };
/// let run = Push::new(model, ContactLaw::Coulomb { friction: 0.3 }, start, EdgeEnd::Stop)?.run(&[0.0, 0.5])?;
/// assert!((run.last.position.y - run.samples[0].position.y - 0.2 * 0.5 * 0.5 / 2.0).abs() < 1e-9); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub type Push<'p> = PushOf<PushModel<'p>>;

/// A finger of any shape that pushes an edge or an ellipse.
pub type ShapedPush<'p> = PushOf<ShapedModel<'p>>;

/// What is at an edge's vertices.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, SimplePolygon, Start, State};
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.1), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 1.0, finger };
/// // Touched 1 mm beyond the vertex: only the edge's line reaches so far.
/// let start = Start::Moving(State { u: 1.6, s: 0.031, omega: 0.0, v_t: 0.1 });
/// let push = |end| Push::new(model, ContactLaw::Frictionless, start, end);
/// assert!(push(EdgeEnd::Stop).is_err() && push(EdgeEnd::Extend).is_ok());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeEnd {
    /// The push ends there.
    Stop,
    /// The edge's line goes on for ever.
    Extend,
}

/// A start, or a motion of the finger, that is impossible.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PushError {
    /// The contact is not on the edge.
    #[error(
        "the contact at s = {s:?} m is beyond the edge, which runs from {s_min:?} to {s_max:?} m: s is measured from the foot of the perpendicular through the centre of mass"
    )]
    BeyondEdge {
        /// Place of the contact on the edge, m.
        s: f64,
        /// The edge's first end, m.
        s_min: f64,
        /// The edge's second end, m.
        s_max: f64,
    },
    /// The finger reaches into the part elsewhere.
    #[error(
        "the finger overlaps the part: it reaches {depth:?} m into edge {edge}; a finger this large cannot touch here, make it smaller or touch elsewhere"
    )]
    Overlap {
        /// The edge that it reaches into: of those that make one straight side the first.
        edge: usize,
        /// How far the disk reaches into the part, m.
        depth: f64,
    },
    /// At rest, but the finger moves.
    #[error("the start is at rest, but the finger moves at {speed:?} m/s: at rest its velocity must be 0")]
    FingerMoves {
        /// Speed of the finger, m/s.
        speed: f64,
    },
    /// At rest, and the finger is not driven into the part.
    #[error(
        "the finger accelerates away from the part or along its edge ({toward:?} m/s² into it, it must be > 0): nothing would be pushed"
    )]
    MovesAway {
        /// Component of the finger's acceleration into the part, m/s².
        toward: f64,
    },
    /// Changes of the finger's motion out of order.
    #[error(
        "the finger's acceleration changes at {t:?} s, which must be a time after {after:?} s: give the changes in order"
    )]
    ChangesOutOfOrder {
        /// The time as given, s.
        t: f64,
        /// Of the change before, s.
        after: f64,
    },
    /// The given direction of sliding is not that of the given velocities.
    #[error(
        "the part slides at {slip:?} m/s relative to the finger along the edge, against the sliding sign: reverse the sign or correct vT or omega"
    )]
    SlipAgainstSign {
        /// Part relative to finger, along the edge's counter-clockwise direction, m/s.
        slip: f64,
    },
}

impl<'p> Push<'p> {
    /// Checks that the start is possible.
    ///
    /// # Errors
    /// [`PushError`].
    pub fn new(model: PushModel<'p>, law: ContactLaw, start: Start, edge_end: EdgeEnd) -> Result<Self, PushError> {
        let push = Self::checked(model, law, start, edge_end)?;
        let s = start.contact().1;
        if !(model.edge.s_min..=model.edge.s_max).contains(&s) {
            // On an edge's extension there is nothing to overlap with that would mean anything.
            return Ok(push);
        }
        push.around(model.part)
    }
}

impl<'p> ShapedPush<'p> {
    /// Checks that the start is possible. Of a polygon's other edges it knows nothing: see [`PushOf::around`].
    ///
    /// # Errors
    /// [`PushError`].
    pub fn new(model: ShapedModel<'p>, law: ContactLaw, start: Start, edge_end: EdgeEnd) -> Result<Self, PushError> {
        Self::checked(model, law, start, edge_end)
    }
}

impl<M: ContactModel> PushOf<M> {
    fn checked(model: M, law: ContactLaw, start: Start, edge_end: EdgeEnd) -> Result<Self, PushError> {
        let track = FingerTrack::new(model.path());
        let push = Self { model, law, start, edge_end, track, obstacles: Vec::new(), ends_at_second_contact: false };
        push.check()?;
        Ok(push)
    }

    /// The same with the part's other edges in the finger's way: a push at one edge of `part` notices when it reaches
    /// another.
    ///
    /// # Errors
    /// [`PushError::Overlap`] if the finger reaches into one from the start.
    pub fn around(mut self, part: &Part) -> Result<Self, PushError> {
        self.obstacles = obstacles(part, &self.model.side());
        let (u, s) = self.start.contact();
        let state = State { u, s, omega: 0.0, v_t: 0.0 };
        let gaps = self.obstacles.iter().map(|obstacle| (obstacle.edge, gap(&self.model, &state, &obstacle.ends)));
        let inside = gaps.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(_, gap)| *gap < -PLACE_TOLERANCE);
        inside.map_or(Ok(self), |(edge, gap)| Err(PushError::Overlap { edge, depth: -gap }))
    }

    /// The same, ended where the finger reaches a second edge. Otherwise a run only notes that, and goes on as if it
    /// did not.
    #[must_use]
    pub fn ending_at_second_contact(self) -> Self {
        Self { ends_at_second_contact: true, ..self }
    }

    /// The same with a finger that changes its acceleration (m/s², world axes) at times after 0 (s), its velocity
    /// running on.
    ///
    /// # Errors
    /// [`PushError::ChangesOutOfOrder`].
    pub fn with_changes(mut self, changes: &[(f64, Vector2<f64>)]) -> Result<Self, PushError> {
        let mut after = 0.0;
        for &(t, acceleration) in changes {
            if !(t > after && t.is_finite()) {
                return Err(PushError::ChangesOutOfOrder { t, after });
            }
            self.track.turn(t, acceleration);
            after = t;
        }
        Ok(self)
    }

    /// The finger's motion over time, world axes.
    #[must_use]
    pub fn track(&self) -> &FingerTrack {
        &self.track
    }
}

/// The finger's motion in pieces of constant acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct FingerTrack {
    /// When each piece begins, s, and the parabola that it is a piece of.
    pieces: Vec<(f64, FingerPath)>,
}

impl FingerTrack {
    /// One piece from time 0 on.
    #[must_use]
    pub fn new(path: FingerPath) -> Self {
        Self { pieces: vec![(0.0, path)] }
    }

    /// Changes the acceleration (m/s², world axes) at `t` (s), later than any change so far.
    fn turn(&mut self, t: f64, acceleration: Vector2<f64>) {
        let path = self.path(t);
        let velocity = path.velocity(t);
        let centre0 = path.centre(t) - velocity * t + acceleration * (0.5 * t * t);
        let path = FingerPath { centre0, velocity0: velocity - acceleration * t, acceleration };
        self.pieces.push((t, path));
    }

    /// The parabola followed at time `t`, s.
    #[must_use]
    pub fn path(&self, t: f64) -> FingerPath {
        let begun = self.pieces.iter().rev().find(|(from, _)| *from <= t);
        begun.unwrap_or(&self.pieces[0]).1
    }

    /// The finger's own point at time `t` (s), m.
    #[must_use]
    pub fn centre(&self, t: f64) -> Point2<f64> {
        self.path(t).centre(t)
    }

    /// When the acceleration changes next after `t`, s; never is infinite.
    pub(super) fn change_after(&self, t: f64) -> f64 {
        self.pieces.iter().map(|(from, _)| *from).find(|from| *from > t).unwrap_or(f64::INFINITY)
    }
}

/// Edges that reach beyond the line of the one in contact: none on a convex part.
fn obstacles(part: &Part, side: &PartSide) -> Vec<Obstacle> {
    let PartSide::Edge(edge) = side else { return Vec::new() };
    let centre = part.centre_of_mass();
    let sides = part.sides().zip(part.side_ends());
    let beyond = |p: &Vector2<f64>| edge.normal.dot(p) > edge.height + PLACE_TOLERANCE;
    let all = sides.map(|((edge, _), ends)| Obstacle { edge, ends: ends.map(|end| end - centre) });
    all.filter(|obstacle| obstacle.ends.iter().any(beyond)).collect()
}

/// How far the finger is from a segment of the part, m; for an ellipse less than that, but with the right sign.
pub(super) fn gap(model: &impl ContactModel, state: &State, ends: &[Vector2<f64>; 2]) -> f64 {
    let (finger, part) = (model.shape().at(state.u), model.side().at(state.s));
    let (normal, place) = (Vector2::from(part.normal), Vector2::from(part.place));
    let [out, along] = [normal_of(model, state), turned(normal_of(model, state))];
    let from_finger = |p: &Vector2<f64>| {
        let d = p - place;
        Vector2::from(finger.place) + out * normal.dot(&d) + along * turned(normal).dot(&d)
    };
    let [start, end] = [from_finger(&ends[0]), from_finger(&ends[1])];
    let origin = Point2::origin();
    match model.shape() {
        FingerShape::Disk { radius } => distance_to_segment(origin, start.into(), end.into()) - radius,
        FingerShape::Ellipse { semi_axes: [a, b] } => {
            let round = |p: Vector2<f64>| Point2::new(p.x / a, p.y / b);
            (distance_to_segment(origin, round(start), round(end)) - 1.0) * a.min(b)
        }
        FingerShape::Line => start.y.min(end.y),
    }
}

/// A quarter turn counter-clockwise.
fn turned(v: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

impl<M: ContactModel> PushOf<M> {
    fn check(&self) -> Result<(), PushError> {
        self.check_place()?;
        match self.start {
            Start::Rest { u, s } => self.check_rest(&State { u, s, omega: 0.0, v_t: 0.0 }),
            Start::Moving(state) => self.check_slip(&state),
        }
    }

    fn check_place(&self) -> Result<(), PushError> {
        let (_, s) = self.start.contact();
        let [s_min, s_max] = self.model.side().range();
        let beyond = (s_min - s).max(s - s_max);
        if self.edge_end == EdgeEnd::Stop && beyond > PLACE_TOLERANCE {
            return Err(PushError::BeyondEdge { s, s_min, s_max });
        }
        Ok(())
    }

    fn check_rest(&self, state: &State) -> Result<(), PushError> {
        let FingerPath { velocity0, acceleration, .. } = self.model.path();
        let speed = velocity0.x.hypot(velocity0.y);
        let toward = -normal_of(&self.model, state).dot(&acceleration);
        match () {
            () if speed > 0.0 => Err(PushError::FingerMoves { speed }),
            () if toward <= 0.0 => Err(PushError::MovesAway { toward }),
            () => Ok(()),
        }
    }

    fn check_slip(&self, state: &State) -> Result<(), PushError> {
        let ContactLaw::Sliding { slip: direction, .. } = self.law else { return Ok(()) };
        let slip = self.model.slip(0.0, state);
        if slip_left(slip, direction) < -SLIP_NONE { Err(PushError::SlipAgainstSign { slip }) } else { Ok(()) }
    }
}

impl ContactLaw {
    /// Whether the contact rolls throughout.
    pub(super) fn rolls(self) -> bool {
        matches!(self, Self::Rolling { .. })
    }

    /// The contact of part and finger at rest.
    pub(super) fn at_rest(self) -> ContactMode {
        match self {
            Self::Rolling { .. } | Self::Coulomb { .. } => ContactMode::Rolling,
            Self::Frictionless => ContactMode::Frictionless,
            Self::Sliding { slip, .. } => self.sliding(slip),
        }
    }

    /// The friction that decides between rolling and sliding, or limits rolling; none where the contact is what it is.
    pub(super) fn deciding_friction(self) -> Option<ContactFriction> {
        match self {
            Self::Coulomb { friction } | Self::Rolling { friction: Some(friction) } => {
                Some(ContactFriction::same(friction))
            }
            Self::Frictionless | Self::Rolling { friction: None } | Self::Sliding { .. } => None,
        }
    }

    /// The contact while it slides.
    pub(super) fn sliding(self, slip: Slip) -> ContactMode {
        match self {
            Self::Frictionless => ContactMode::Frictionless,
            law => ContactMode::Sliding { friction: law.friction(), slip },
        }
    }

    /// µ_c; 0 without friction, or where it has no limit.
    pub(super) fn friction(self) -> f64 {
        match self {
            Self::Frictionless => 0.0,
            Self::Rolling { friction } => friction.unwrap_or(0.0),
            Self::Sliding { friction, .. } | Self::Coulomb { friction } => friction,
        }
    }
}
