//! What a finger pushes with and where, as the observers by force see it: a disk on an edge, or any two outlines.
//!
//! All of a search is in one kind of numbers, whatever the outlines: the contact angle u is the polar angle of the finger's
//! outward normal, and s is a length. On an ellipse s is the eccentric angle times the root mean square of the semi-axes,
//! about the length along the outline. On a straight finger, whose normal does not turn, u is the place along it. What
//! is told outside is in the parameters of [`FingerShape`] and [`PartSide`]: see [`PlayedModel::told`].
//!
//! A disk that does not turn on an edge has the fast model of its own.
//!
//! Frames: world. Units: SI, forces per unit mass of the part. Errors: none.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Point2, Rotation2, Vector2};

use super::symmetry::ROUND;
use crate::math::Jet;
use crate::math::ode::{self, Moment};
use crate::math::rosenbrock::Linearised;
use crate::pushing::dynamics::contact_mode::jams;
use crate::pushing::dynamics::{
    ContactLaw, ContactMode, EdgeEnd, FingerPath, FingerShape, LinearisedMotion, Motion, Part, PartSide, Push,
    PushModel, RestError, RestStart, ShapedModel, ShapedPush, Start, State, Turning, stiff_step,
};
use crate::pushing::finger_motion::Leg;

/// A model of a push with states in the numbers of a search.
#[derive(Clone, Copy, Debug)]
pub(super) enum PlayedModel<'p> {
    /// A disk on an edge.
    Edge(PushModel<'p>),
    /// Outlines of any curvature, or a disk that turns.
    Shaped(Shaped<'p>),
}

/// Outlines of any curvature.
#[derive(Clone, Copy, Debug)]
pub(super) struct Shaped<'p> {
    part: &'p Part,
    model: ShapedModel<'p>,
    /// A unit of the part's own parameter, m.
    unit: f64,
}

/// Length of a unit of a part's own parameter, m: 1 where that is a length.
fn unit(side: &PartSide) -> f64 {
    match side {
        PartSide::Edge(_) => 1.0,
        PartSide::Ellipse { semi_axes: [a, b], .. } => (0.5 * (a * a + b * b)).sqrt(),
    }
}

/// Where among the components of a state the angular velocity is.
const OMEGA: usize = 2;

/// v_T.
const V_T: usize = 3;

/// A motion, and how what turns and slides settles in it.
#[derive(Clone, Copy, Debug)]
pub(super) struct SettlingMotion {
    pub(super) motion: Motion,
    /// Derivatives of the accelerations of turning and sliding by their speeds, row by row, 1/s where lengths cancel.
    pub(super) settling: [[f64; 2]; 2],
    /// What an implicit step begins with, where that was asked for: in the outlines' own parameters.
    pub(super) begin: Option<Linearised<4>>,
}

/// Where s may be on a side, m; without end on an ellipse.
pub(super) fn range(side: &PartSide) -> [f64; 2] {
    match side {
        PartSide::Edge(edge) => [edge.s_min, edge.s_max],
        PartSide::Ellipse { .. } => [f64::NEG_INFINITY, f64::INFINITY],
    }
}

/// Where an ellipse is sought from, as a share of its outline: pushes along an axis are not at an end of that.
const ELLIPSE_FROM: f64 = -0.043;

/// Each place of a side once, m, where `symmetry` turns take the part to itself.
pub(super) fn sought(side: &PartSide, symmetry: usize) -> [f64; 2] {
    match side {
        PartSide::Edge(edge) => [edge.s_min, edge.s_max],
        PartSide::Ellipse { .. } => {
            let round = TAU * unit(side);
            let share = if symmetry == ROUND { 0.0 } else { 1.0 / symmetry as f64 };
            [ELLIPSE_FROM, ELLIPSE_FROM + share].map(|share| share * round)
        }
    }
}

impl<'p> PlayedModel<'p> {
    /// The finger being a disk but where it has another `shape`. None where they cannot touch at one point, or are not
    /// there.
    pub(super) fn new(part: &'p Part, place: usize, shape: Option<FingerShape>, mu_g: f64, leg: &Leg) -> Option<Self> {
        let side = part.touched(place).ok()?;
        if let (PartSide::Edge(edge), None, true) = (side, shape, leg.turn.is_still()) {
            return Some(Self::Edge(PushModel { part, edge, mu_g, finger: leg.finger }));
        }
        let shape = shape.unwrap_or(FingerShape::Disk { radius: leg.finger.radius });
        let model = ShapedModel::new(part.body(), side, mu_g, shape, leg.finger.path()).ok()?;
        let turning = Turning { rate0: leg.turn.rate0, acceleration: leg.turn.acceleration };
        Some(Self::Shaped(Shaped { part, model: ShapedModel { turning, ..model }, unit: unit(&side) }))
    }

    /// Where the part is touched.
    pub(super) fn side(&self) -> PartSide {
        match self {
            Self::Edge(model) => PartSide::Edge(model.edge),
            Self::Shaped(shaped) => shaped.model.side,
        }
    }

    /// A state in the outlines' own parameters; that of an ellipse in [0, 2π).
    pub(super) fn told(&self, state: &State) -> State {
        match self {
            Self::Edge(_) => *state,
            Self::Shaped(shaped) => {
                let told = shaped.own(state);
                let is_round = matches!(shaped.model.side, PartSide::Ellipse { .. });
                State { s: if is_round { told.s.rem_euclid(TAU) } else { told.s }, ..told }
            }
        }
    }

    /// A state in the numbers of a search, from one in the outlines' own parameters.
    pub(super) fn sought(&self, told: &State) -> State {
        match self {
            Self::Edge(_) => *told,
            Self::Shaped(Shaped { model, unit, .. }) => {
                let u = match model.shape {
                    FingerShape::Line => told.u,
                    shape => shape.normal_angle(told.u),
                };
                State { u, s: told.s * unit, ..*told }
            }
        }
    }

    /// Of the finger, m/s².
    pub(super) fn acceleration(&self) -> Vector2<f64> {
        self.finger_path().acceleration
    }

    /// How long after a time the finger's way has turned by an angle below a right one, of which this is the tangent, s;
    /// without end where it never does.
    pub(super) fn turns_after(&self, time: f64, tangent: f64) -> f64 {
        let path = self.finger_path();
        let velocity = path.velocity(time);
        let (across, along) = (velocity.perp(&path.acceleration).abs(), velocity.dot(&path.acceleration));
        let toward = across - along * tangent;
        if toward > 0.0 { velocity.norm_squared() * tangent / toward } else { f64::INFINITY }
    }

    fn finger_path(&self) -> FingerPath {
        match self {
            Self::Edge(model) => model.finger.path(),
            Self::Shaped(shaped) => shaped.model.path,
        }
    }

    /// Polar angle of the finger's outward normal at a contact, rad.
    pub(super) fn normal_angle(&self, u: f64) -> f64 {
        match self {
            Self::Shaped(Shaped { model: ShapedModel { shape: FingerShape::Line, .. }, .. }) => 0.5 * PI,
            _ => u,
        }
    }

    /// Whether it makes a difference where the finger is touched: along a straight one all places are alike.
    pub(super) fn turns_with_u(&self) -> bool {
        !matches!(self, Self::Shaped(Shaped { model: ShapedModel { shape: FingerShape::Line, .. }, .. }))
    }

    pub(super) fn motion(&self, contact: &ContactMode, time: f64, state: &State) -> Motion {
        match self {
            Self::Edge(model) => model.motion(contact, time, state),
            Self::Shaped(shaped) => {
                let own = shaped.own(state);
                shaped.sought_motion(own.u, shaped.model.motion(contact, time, &own))
            }
        }
    }

    /// Slip of the part along the finger, m/s.
    pub(super) fn slip(&self, time: f64, state: &State) -> f64 {
        match self {
            Self::Edge(model) => model.slip(time, state),
            Self::Shaped(shaped) => shaped.model.slip(time, &shaped.own(state)),
        }
    }

    /// v_T of a part that rolls, m/s.
    pub(super) fn rolling_v_t(&self, time: f64, state: &State) -> f64 {
        match self {
            Self::Edge(model) => model.rolling_v_t(time, state),
            Self::Shaped(shaped) => shaped.model.rolling_v_t(time, &shaped.own(state)),
        }
    }

    /// Velocity of the centre of mass, m/s.
    pub(super) fn velocity(&self, contact: &ContactMode, time: f64, state: &State) -> Vector2<f64> {
        match self {
            Self::Edge(model) => model.velocity(contact, time, state),
            Self::Shaped(shaped) => shaped.model.velocity(contact, time, &shaped.own(state)),
        }
    }

    /// Whether a contact finds no force to slide with.
    pub(super) fn is_jammed(&self, contact: &ContactMode, state: &State) -> bool {
        contact.signed_friction().is_some_and(|m| {
            jams(match self {
                Self::Edge(model) => model.sliding_denominator(m, state.s),
                Self::Shaped(shaped) => shaped.model.sliding_denominator(m, &shaped.own(state)),
            })
        })
    }

    /// Pose of the part frame.
    pub(super) fn pose(&self, time: f64, state: &State) -> Isometry2<f64> {
        let (part, centre, theta): (_, Point2<f64>, _) = match self {
            Self::Edge(model) => {
                let inward = Vector2::new(-state.u.cos(), -state.u.sin());
                let turn = Rotation2::rotation_between(&model.edge.normal, &inward);
                (model.part, model.centre_of_mass(time, state), turn.angle())
            }
            Self::Shaped(Shaped { part, model, .. }) => {
                let own = self.own(state);
                (*part, model.centre_of_mass(time, &own), model.theta(&own))
            }
        };
        let turn = Rotation2::new(theta);
        Isometry2::new(centre.coords - turn * part.centre_of_mass().coords, turn.angle())
    }

    fn own(&self, state: &State) -> State {
        match self {
            Self::Edge(_) => *state,
            Self::Shaped(shaped) => shaped.own(state),
        }
    }

    /// How the part begins to move from rest.
    pub(super) fn rest_start(&self, contact: &ContactMode, u: f64, s: f64) -> Result<RestStart, RestError> {
        match self {
            Self::Edge(model) => model.rest_start(contact, u, s),
            Self::Shaped(shaped) => {
                let State { u, s, .. } = shaped.own(&State { u, s, omega: 0.0, v_t: 0.0 });
                shaped.model.rest_start(contact, u, s)
            }
        }
    }

    /// The state so shortly (s) after a start from rest that its accelerations still hold.
    pub(super) fn after_rest(&self, [u, s]: [f64; 2], start: &RestStart, span: f64) -> State {
        let accelerations = [start.alpha, start.a_t];
        match self {
            Self::Edge(model) => model.after_rest([u, s], accelerations, span),
            Self::Shaped(shaped) => {
                let own = shaped.own(&State { u, s, omega: 0.0, v_t: 0.0 });
                let after = self.sought(&shaped.model.after_rest([own.u, own.s], accelerations, span));
                // An angle comes back as it was, whole turns included.
                let back = self.sought(&own);
                State { u: u + (after.u - back.u), ..after }
            }
        }
    }

    /// The state a step later, s, of which the rates at its start are known.
    pub(super) fn step(&self, contact: &ContactMode, time: f64, state: &State, rates: &State, dt: f64) -> State {
        match self {
            Self::Edge(model) => ode::step(state, dt, |moment, state| match moment {
                Moment::Start => *rates,
                Moment::Middle | Moment::End => model.motion(contact, moment.time(time, dt), state).rates,
            }),
            Self::Shaped(shaped) => self.sought_near(state, &shaped.model.step(contact, time, &shaped.own(state), dt)),
        }
    }

    /// The same of a part that hardly moves, by what is [linearised](Self::linearised) at its start; none where the step has
    /// no solution.
    pub(super) fn stiff_step(
        &self,
        contact: &ContactMode,
        time: f64,
        state: &State,
        dt: f64,
        begin: &Linearised<4>,
    ) -> Option<State> {
        match self {
            Self::Edge(model) => stiff_step(model, contact, time, state, dt, begin),
            Self::Shaped(shaped) => {
                let after = stiff_step(&shaped.model, contact, time, &shaped.own(state), dt, begin)?;
                Some(self.sought_near(state, &after))
            }
        }
    }

    /// As [`Self::sought`], with the whole turns of a state nearby.
    fn sought_near(&self, near: &State, told: &State) -> State {
        let back = self.sought(&self.own(near));
        let after = self.sought(told);
        State { u: near.u + (after.u - back.u), ..after }
    }

    /// The motion, and how turning and sliding settle.
    pub(super) fn settling(&self, contact: &ContactMode, time: f64, state: &State) -> SettlingMotion {
        let State { u, s, omega, v_t } = self.own(state);
        let lifted = State {
            u: Jet::constant(u),
            s: Jet::constant(s),
            omega: Jet::variable(omega, 0),
            v_t: Jet::variable(v_t, 1),
        };
        let contact = contact.map(Jet::constant);
        let motion = match self {
            Self::Edge(model) => model.lifted::<Jet<2>>().motion(&contact, time, &lifted),
            Self::Shaped(shaped) => shaped.model.lifted::<Jet<2>>().motion(&contact, time, &lifted),
        };
        SettlingMotion {
            motion: self.sought_motion(u, motion.plain()),
            settling: [motion.rates.omega.slopes, motion.rates.v_t.slopes],
            begin: None,
        }
    }

    /// The same with what an implicit step begins with.
    pub(super) fn linearised(&self, contact: &ContactMode, time: f64, state: &State) -> SettlingMotion {
        let own = self.own(state);
        let LinearisedMotion { motion, begin } = match self {
            Self::Edge(model) => model.linearised(contact, time, &own),
            Self::Shaped(shaped) => shaped.model.linearised(contact, time, &own),
        };
        let settling = [OMEGA, V_T].map(|of| [OMEGA, V_T].map(|by| begin.by_state[(of, by)]));
        SettlingMotion { motion: self.sought_motion(own.u, motion), settling, begin: Some(begin) }
    }

    /// A motion in the numbers of a search, from one in the outlines' own parameters.
    fn sought_motion(&self, own_u: f64, motion: Motion) -> Motion {
        match self {
            Self::Edge(_) => motion,
            Self::Shaped(shaped) => shaped.sought_motion(own_u, motion),
        }
    }

    /// Whether the finger can touch there, outside the part, and push.
    pub(super) fn can_begin(&self, u: f64, s: f64, is_moving: bool) -> bool {
        let State { u, s, .. } = self.own(&State { u, s, omega: 0.0, v_t: 0.0 });
        let start = if is_moving { Start::Moving(State { u, s, omega: 0.0, v_t: 0.0 }) } else { Start::Rest { u, s } };
        match self {
            Self::Edge(model) => Push::new(*model, ContactLaw::Frictionless, start, EdgeEnd::Stop).is_ok(),
            Self::Shaped(Shaped { part, model, .. }) => {
                let push = ShapedPush::new(*model, ContactLaw::Frictionless, start, EdgeEnd::Stop);
                match model.side {
                    PartSide::Edge(_) => push.and_then(|push| push.around(part)).is_ok(),
                    PartSide::Ellipse { .. } => push.is_ok(),
                }
            }
        }
    }
}

impl Shaped<'_> {
    /// A state in the outlines' own parameters.
    fn own(&self, state: &State) -> State {
        State { u: self.model.shape.with_normal(state.u), s: state.s / self.unit, ..*state }
    }

    /// A motion in the numbers of a search, from one in the outlines' own parameters.
    fn sought_motion(&self, own_u: f64, motion: Motion) -> Motion {
        let rates = motion.rates;
        let u = match self.model.shape {
            FingerShape::Ellipse { .. } => rates.u * self.model.shape.normal_rate(own_u),
            _ => rates.u,
        };
        Motion { rates: State { u, s: rates.s * self.unit, ..rates }, ..motion }
    }
}
