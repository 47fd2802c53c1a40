//! A push from its start: what is asked, checked once.
//!
//! Assumes, frames, units: see [`super::model`]. Errors: [`PushError`] names what is impossible from the start. What ends a
//! push later, or at once, is an [`End`](super::End), not an error.

use nalgebra::{Point2, Vector2};

use super::contact_model::{ContactModel, normal};
use super::model::{Contact, FingerPath, PushModel, Slip, State};
use super::shaped::ShapedModel;

/// Slip and speed that count as none, m/s: an atom's width a second. Rounding in the velocities is a million times less.
pub(super) const SLIP_NONE: f64 = 1e-9;

/// How far beyond an edge's end, or into the part, is put down to rounding of the input, m: printed micrometres pass exactly.
const PLACE_TOLERANCE: f64 = 1e-9;

/// What happens at the contact, and what ends it. Friction is µ_c between finger and part.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactLaw {
    /// No contact friction.
    Frictionless,
    /// Rolling, until the force leaves the friction cone if there is one.
    Rolling {
        /// µ_c; none for a contact that never slips.
        friction: Option<f64>,
    },
    /// Sliding in one direction, until that stops.
    Sliding {
        /// µ_c.
        friction: f64,
        /// Where the part slides.
        slip: Slip,
    },
    /// Rolls and slides as Coulomb's law demands.
    Coulomb {
        /// µ_c.
        friction: f64,
    },
}

/// How a push starts, at t = 0.
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
}

/// A disk that pushes an edge of a polygon.
pub type Push<'p> = PushOf<PushModel<'p>>;

/// A finger of any shape that pushes an edge or an ellipse.
pub type ShapedPush<'p> = PushOf<ShapedModel<'p>>;

/// What is at an edge's vertices.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EdgeEnd {
    /// The push ends there.
    Stop,
    /// The edge's line goes on for ever.
    Extend,
}

/// A start that is impossible.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum PushError {
    /// The contact is not on the edge.
    #[error(
        "the contact at s = {s:?} m is beyond the edge, which runs from {s_min:?} to {s_max:?} m: s is measured from the foot of the perpendicular through the centre of mass"
    )]
    BeyondEdge {
        /// The contact, m.
        s: f64,
        /// The edge's first end, m.
        s_min: f64,
        /// The edge's second end, m.
        s_max: f64,
    },
    /// The disk reaches into the part elsewhere.
    #[error(
        "the finger overlaps the part: its centre is {distance:?} m from edge {edge}, less than its radius of {radius:?} m; a finger this large cannot touch here"
    )]
    Overlap {
        /// The edge that is too near.
        edge: usize,
        /// From the disk's centre, m.
        distance: f64,
        /// The disk's, m.
        radius: f64,
    },
    /// At rest, but the finger moves.
    #[error("the start is at rest, but the finger moves at {speed:?} m/s: at rest its velocity must be 0")]
    FingerMoves {
        /// The finger's, m/s.
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
        let push = Self { model, law, start, edge_end };
        push.check()?;
        push.check_overlap()?;
        Ok(push)
    }

    fn check_overlap(&self) -> Result<(), PushError> {
        let s = self.start.contact().1;
        if !(self.model.edge.s_min..=self.model.edge.s_max).contains(&s) {
            // On an edge's extension there is nothing to overlap with that would mean anything.
            return Ok(());
        }
        let (part, edge, radius) = (self.model.part, self.model.edge, self.model.finger.radius);
        let along = Vector2::new(-edge.normal.y, edge.normal.x);
        let centre = part.centre_of_mass() + edge.normal * (edge.height + radius) + along * s;
        let distances = part.polygon().edges().map(|(start, end)| distance_to_segment(centre, start, end));
        let near = distances.enumerate().find(|(_, distance)| *distance < radius - PLACE_TOLERANCE);
        near.map_or(Ok(()), |(edge, distance)| Err(PushError::Overlap { edge, distance, radius }))
    }
}

impl<'p> ShapedPush<'p> {
    /// Checks that the start is possible.
    ///
    /// # Errors
    /// [`PushError`].
    pub fn new(model: ShapedModel<'p>, law: ContactLaw, start: Start, edge_end: EdgeEnd) -> Result<Self, PushError> {
        let push = Self { model, law, start, edge_end };
        push.check()?;
        Ok(push)
    }
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
        let FingerPath { velocity0: [v_x, v_y], acceleration, .. } = self.model.path();
        let (speed, toward) = (v_x.hypot(v_y), -normal(&self.model, state).dot(&Vector2::from(acceleration)));
        match () {
            () if speed > 0.0 => Err(PushError::FingerMoves { speed }),
            () if toward <= 0.0 => Err(PushError::MovesAway { toward }),
            () => Ok(()),
        }
    }

    fn check_slip(&self, state: &State) -> Result<(), PushError> {
        let ContactLaw::Sliding { slip: direction, .. } = self.law else { return Ok(()) };
        let slip = self.model.slip(0.0, state);
        if slip * direction.sign() < -SLIP_NONE { Err(PushError::SlipAgainstSign { slip }) } else { Ok(()) }
    }
}

impl ContactLaw {
    /// Whether the contact rolls throughout.
    pub(super) fn rolls(self) -> bool {
        matches!(self, Self::Rolling { .. })
    }

    /// The contact while it slides.
    pub(super) fn sliding(self, slip: Slip) -> Contact {
        let friction = match self {
            Self::Frictionless => return Contact::Frictionless,
            Self::Rolling { friction } => friction.unwrap_or(0.0),
            Self::Sliding { friction, .. } | Self::Coulomb { friction } => friction,
        };
        Contact::Sliding { friction, slip }
    }
}

/// From a point to the nearest point between two others, m.
fn distance_to_segment(point: Point2<f64>, start: Point2<f64>, end: Point2<f64>) -> f64 {
    let (along, to_point) = (end - start, point - start);
    let share = (to_point.dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
    (to_point - along * share).norm()
}
