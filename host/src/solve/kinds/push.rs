//! The kind `push`: forward simulation of a part that a finger pushes. See [`crate::pushing`].

use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pushing::support::SupportFriction;
use crate::pushing::{
    Contact, ContactForce, ContactLaw, EdgeEnd, EndReason, Finger as Disk, Mass, Part, Push as Simulation, PushError,
    PushModel, Run, Sample, Slip, Start, State,
};
use crate::solve::fields::{Finger, NonNegative, Polygon, Pose, Positive, Times, default_gravity};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError};

/// A part pushed at one of its edges by a disk that only translates.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Push {
    /// The part's outline.
    pub polygon: Polygon,
    /// The edge in contact, from vertex `edge` to the next.
    pub edge: usize,
    /// Friction between part and plane.
    pub mu: NonNegative,
    /// Gravity, m/s².
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// What happens at the contact.
    pub mode: Mode,
    /// Friction between finger and part: required for `sliding` and `coulomb`; in `rolling` it bounds the force.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mu_c: Option<NonNegative>,
    /// The finger and its motion.
    pub finger: Finger,
    /// State at t = 0.
    pub initial: Initial,
    /// When to sample, s. The run ends at the last, if nothing ends it before.
    pub times: Times,
    /// Where the weight rests; uniform over the polygon where not given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub support: Option<Support>,
    /// Part frame, m; the area centroid where not given. Together with `inertia_per_mass`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub centre_of_mass: Option<[f64; 2]>,
    /// Moment of inertia about `centre_of_mass` over the mass, m².
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub inertia_per_mass: Option<Positive>,
    /// Whether the run ends where the contact reaches a vertex; otherwise the edge's line goes on.
    #[serde(default = "default_stop_at_edge_end")]
    pub stop_at_edge_end: bool,
}

fn default_stop_at_edge_end() -> bool {
    true
}

/// What happens at the contact.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Mode {
    /// No contact friction.
    Frictionless,
    /// No slip.
    Rolling,
    /// Slip in one direction.
    Sliding,
    /// Rolling and sliding by Coulomb's law.
    Coulomb,
}

/// State at t = 0: in motion (`omega`, `vT`), or at rest (`at_rest`).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Initial {
    /// Polar angle of the contact seen from the disk's centre, rad.
    pub u: f64,
    /// Contact along the edge, from the foot of the perpendicular through the centre of mass, m.
    pub s: f64,
    /// Angular velocity of the part, rad/s.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub omega: Option<f64>,
    /// Velocity of the part's centre of mass along T = (−sin u, cos u), m/s; not for `rolling`.
    #[serde(default, rename = "vT", skip_serializing_if = "Option::is_none")]
    pub v_t: Option<f64>,
    /// `sliding` only: the sign of the contact velocity (part − finger) along the edge.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sliding_sign: Option<f64>,
    /// Part and finger at rest, the finger accelerating into the part.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub at_rest: bool,
}

/// Where a part's weight rests.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "SupportFields", into = "SupportFields")]
pub struct Support {
    feet: Vec<[f64; 3]>,
}

/// The JSON form of [`Support`].
#[derive(Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SupportFields {
    /// `[x, y, share]`: part frame, m; share of the weight. The shares sum to 1.
    feet: Vec<[f64; 3]>,
}

/// How far the shares of the feet may be from adding up to 1: shares rounded to four decimals pass for a dozen feet.
const SHARES_SUM_TOLERANCE: f64 = 1e-3;

impl TryFrom<SupportFields> for Support {
    type Error = InvalidInput;

    fn try_from(SupportFields { feet }: SupportFields) -> Result<Self, InvalidInput> {
        let at = |index: usize| Pointer::from("feet").index(index);
        if feet.is_empty() {
            return Err(InvalidInput::at("feet", "is empty: give at least one foot, or leave `support` out"));
        }
        if let Some(index) = feet.iter().position(|[_, _, share]| *share < 0.0) {
            let message = format!("the share {:?} of the weight is negative: check its sign", feet[index][2]);
            return Err(InvalidInput::at(at(index).index(2), message));
        }
        let sum: f64 = feet.iter().map(|[_, _, share]| share).sum();
        if (sum - 1.0).abs() > SHARES_SUM_TOLERANCE {
            let message =
                format!("the shares of the weight sum to {sum:?}, they must sum to 1: divide each by the sum");
            return Err(InvalidInput::at("feet", message));
        }
        Ok(Self { feet })
    }
}

impl From<Support> for SupportFields {
    fn from(Support { feet }: Support) -> Self {
        Self { feet }
    }
}

impl Support {
    /// Its friction, in the part's frame.
    #[must_use]
    pub fn friction(&self) -> SupportFriction {
        let feet: Vec<_> = self.feet.iter().map(|&[x, y, share]| (Point2::new(x, y), share)).collect();
        SupportFriction::feet(&feet)
    }
}

/// How a push went.
#[derive(Clone, Debug, Serialize, JsonSchema)]
pub struct PushAnswer {
    /// The part at each time asked for, up to the end.
    pub samples: Vec<PushSample>,
    /// What ended the run.
    pub end: PushEnd,
    /// The part at the end.
    #[serde(rename = "final")]
    pub last: PushSample,
    /// How the part begins to move; for a start `at_rest`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_acceleration: Option<InitialAcceleration>,
    /// When rolling and sliding took turns; for `coulomb`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub transitions: Option<Vec<Transition>>,
}

/// A part at one instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PushSample {
    /// s.
    pub t: f64,
    /// Polar angle of the contact, rad, not wrapped.
    pub u: f64,
    /// Contact along the edge, m.
    pub s: f64,
    /// Angular velocity, rad/s.
    pub omega: f64,
    /// Velocity of the centre of mass along T, m/s.
    #[serde(rename = "vT")]
    pub v_t: f64,
    /// Of the polygon's own frame.
    pub pose: Pose,
    /// Of the centre of mass, world axes, m/s.
    pub velocity: [f64; 2],
    /// What the contact does.
    pub mode: Mode,
    /// −F·N per unit mass, m/s²; null where the contact jams.
    pub normal_force: Option<f64>,
    /// −F·T per unit mass, m/s²; null where the contact jams.
    pub tangential_force: Option<f64>,
}

/// The end of a run.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct PushEnd {
    /// Why.
    pub reason: Reason,
    /// When, s.
    pub t: f64,
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Reason {
    /// The last time asked for.
    Time,
    /// The finger leaves the part.
    Break,
    /// Sliding stopped.
    Stick,
    /// Rolling needs more friction than there is.
    Slip,
    /// The edge's first vertex.
    EdgeLo,
    /// The edge's second vertex.
    EdgeHi,
    /// No contact force fits (Painlevé).
    Jam,
}

/// Acceleration from rest.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct InitialAcceleration {
    /// Of the centre of mass, world axes, m/s².
    pub centroid: [f64; 2],
    /// rad/s².
    pub alpha: f64,
}

/// A change between rolling and sliding.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct Transition {
    /// s.
    pub t: f64,
    /// The mode from then on.
    pub to: Mode,
}

impl Problem for Push {
    const KIND: &'static str = "push";
    type Answer = PushAnswer;

    fn solve(&self) -> Result<PushAnswer, SolveError> {
        let part = self.part()?;
        let edge = part.edge(self.edge).map_err(|error| InvalidInput::at("edge", error.to_string()))?;
        let Finger { radius, centre0, velocity0, acceleration } = self.finger;
        let finger = Disk { radius: radius.get(), centre0, velocity0, acceleration };
        let model = PushModel { part: &part, edge, grip: self.mu.get() * self.g.get(), finger };
        let edge_end = if self.stop_at_edge_end { EdgeEnd::Stop } else { EdgeEnd::Extend };
        let push = Simulation::new(model, self.law()?, self.start()?, edge_end).map_err(refuse)?;
        let run = push.run(&self.times).map_err(|error| SolveError::Internal(error.to_string()))?;
        Ok(self.answer(&run))
    }
}

/// A start that is impossible, at the field to look at first.
fn refuse(error: PushError) -> InvalidInput {
    let field = match error {
        PushError::BeyondEdge { .. } => Pointer::from("initial").key("s"),
        PushError::Overlap { .. } => Pointer::from("finger").key("radius"),
        PushError::FingerMoves { .. } => Pointer::from("finger").key("velocity0"),
        PushError::MovesAway { .. } => Pointer::from("finger").key("acceleration"),
        PushError::SlipAgainstSign { .. } => Pointer::from("initial").key("sliding_sign"),
    };
    InvalidInput::at(field, error.to_string())
}

impl Push {
    fn part(&self) -> Result<Part, InvalidInput> {
        let polygon = (*self.polygon).clone();
        let mass = match (self.centre_of_mass, self.inertia_per_mass) {
            (None, None) => Mass::uniform(&polygon),
            (Some(centre), Some(inertia)) => Mass { centre_of_mass: centre.into(), inertia_per_mass: inertia.get() },
            (Some(_), None) => return Err(InvalidInput::missing("inertia_per_mass", "`centre_of_mass` needs it")),
            (None, Some(_)) => return Err(InvalidInput::missing("centre_of_mass", "`inertia_per_mass` needs it")),
        };
        let support = self.support.as_ref().map_or_else(|| SupportFriction::uniform(&polygon), Support::friction);
        Ok(Part::new(polygon, support, mass))
    }

    fn law(&self) -> Result<ContactLaw, InvalidInput> {
        let needed = || {
            let friction = self.mu_c.ok_or_else(|| {
                InvalidInput::missing("mu_c", "the modes `sliding` and `coulomb` need the friction of the contact")
            });
            friction.map(NonNegative::get)
        };
        match self.mode {
            Mode::Frictionless => Ok(ContactLaw::Frictionless),
            Mode::Rolling => Ok(ContactLaw::Rolling { friction: self.mu_c.map(NonNegative::get) }),
            Mode::Sliding => Ok(ContactLaw::Sliding { friction: needed()?, slip: self.initial.slip()? }),
            Mode::Coulomb => Ok(ContactLaw::Coulomb { friction: needed()? }),
        }
    }

    fn start(&self) -> Result<Start, InvalidInput> {
        let Initial { u, s, omega, v_t, sliding_sign, at_rest } = self.initial;
        let refuse = |key: &str, why: &str| Err(InvalidInput::at(Pointer::from("initial").key(key), why));
        if sliding_sign.is_some() && self.mode != Mode::Sliding {
            return refuse("sliding_sign", "is for the mode `sliding` only: leave it out");
        }
        if at_rest {
            return match (omega, v_t) {
                (None, None) => Ok(Start::Rest { u, s }),
                (Some(_), _) => refuse("omega", "cannot be given with `at_rest`: leave one of them out"),
                (None, Some(_)) => refuse("vT", "cannot be given with `at_rest`: leave one of them out"),
            };
        }
        let missing = |key: &str, remedy: &str| InvalidInput::missing(Pointer::from("initial").key(key), remedy);
        let omega = omega.ok_or_else(|| missing("omega", "give the angular velocity, or `\"at_rest\": true`"))?;
        match (self.mode, v_t) {
            (Mode::Rolling, None) => Ok(Start::Moving(State { u, s, omega, v_t: 0.0 })),
            (Mode::Rolling, Some(_)) => refuse("vT", "follows from `omega` in the mode `rolling`: leave it out"),
            (_, Some(v_t)) => Ok(Start::Moving(State { u, s, omega, v_t })),
            (_, None) => Err(missing("vT", "every mode but `rolling` needs it")),
        }
    }

    fn answer(&self, run: &Run) -> PushAnswer {
        let changes = || run.changes.iter().map(|change| Transition { t: change.t, to: change.to.into() }).collect();
        PushAnswer {
            samples: run.samples.iter().map(PushSample::from).collect(),
            end: PushEnd { reason: run.end.reason.into(), t: run.end.t },
            last: (&run.last).into(),
            initial_acceleration: run.rest_start.filter(|_| self.initial.at_rest).map(|acceleration| {
                InitialAcceleration { centroid: acceleration.centre_of_mass.into(), alpha: acceleration.alpha }
            }),
            transitions: (self.mode == Mode::Coulomb).then(changes),
        }
    }
}

impl Initial {
    fn slip(&self) -> Result<Slip, InvalidInput> {
        let place = || Pointer::from("initial").key("sliding_sign");
        match self.sliding_sign {
            Some(1.0) => Ok(Slip::Forward),
            Some(-1.0) => Ok(Slip::Backward),
            Some(other) => Err(InvalidInput::at(place(), format!("got {other:?}, it must be 1 or -1"))),
            None => Err(InvalidInput::missing(place(), "the mode `sliding` needs 1 or -1")),
        }
    }
}

impl From<Contact> for Mode {
    fn from(contact: Contact) -> Self {
        match contact {
            Contact::Frictionless => Self::Frictionless,
            Contact::Rolling => Self::Rolling,
            Contact::Sliding { .. } => Self::Sliding,
        }
    }
}

impl From<EndReason> for Reason {
    fn from(reason: EndReason) -> Self {
        match reason {
            EndReason::Time => Self::Time,
            EndReason::Break => Self::Break,
            EndReason::Stick => Self::Stick,
            EndReason::Slip => Self::Slip,
            EndReason::EdgeMin => Self::EdgeLo,
            EndReason::EdgeMax => Self::EdgeHi,
            EndReason::Jam => Self::Jam,
        }
    }
}

impl From<&Sample> for PushSample {
    fn from(sample: &Sample) -> Self {
        let State { u, s, omega, v_t } = sample.state;
        let force = |component: fn(ContactForce) -> f64| sample.force.map(component);
        Self {
            t: sample.t,
            u,
            s,
            omega,
            v_t,
            pose: Pose { x: sample.position.x, y: sample.position.y, theta: sample.theta },
            velocity: sample.velocity.into(),
            mode: sample.contact.into(),
            normal_force: force(|force| force.normal),
            tangential_force: force(|force| force.tangential),
        }
    }
}
