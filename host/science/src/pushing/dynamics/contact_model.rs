//! What a push in time asks of a model, whatever touches what.
//!
//! Most methods only lead to the method of the same name that the model has itself, and that is on purpose. The models'
//! own are written over any scalar, since observers ask `PushModel<'_, T>` with numbers that carry derivatives; a run
//! in time has events, outlines and ends, which are plain numbers, so this trait is of `f64`. Any way to have the list
//! once costs more than the list:
//! - the models' formulas as methods of a trait of any scalar: whoever asks a model for anything must import it;
//! - an enum of both: its branch is in the innermost loop, and the run is no longer compiled for the disk on an edge;
//! - the disk on an edge as a [`ShapedModel`]: the slower formulas, which round otherwise.
//!
//! Units: SI. Frames: world, unless named. Errors: none of its own.

use nalgebra::{Point2, Vector2};

use super::body::Body;
use super::curve::{FingerShape, PartSide};
use super::disk_on_edge::Motion;
use super::model::{Arm, ContactMode, FingerPath, PushModel, State};
use super::rest::{AtRest, RestError, RestStart};
use super::scalar::Scalar;
use super::shaped::ShapedModel;

/// A model of a finger that pushes a part: [`PushModel`] or [`ShapedModel`].
pub trait ContactModel: Copy {
    /// Rates and contact force.
    fn motion(&self, contact: &ContactMode, time: f64, state: &State) -> Motion;
    /// Slip of the part relative to the finger along the part's counter-clockwise direction, m/s.
    fn slip(&self, time: f64, state: &State) -> f64;
    /// v_T of a part that rolls, m/s.
    fn rolling_v_t(&self, time: f64, state: &State) -> f64;
    /// At 0 and below, no contact force fits a sliding part.
    fn sliding_denominator(&self, signed_friction: f64, state: &State) -> f64;
    /// Velocity of the centre of mass, m/s.
    fn velocity(&self, contact: &ContactMode, time: f64, state: &State) -> Vector2<f64>;
    /// The centre of mass, m.
    fn centre_of_mass(&self, time: f64, state: &State) -> Point2<f64>;
    /// Turn from world to part axes, rad, continuous in the state.
    fn theta(&self, state: &State) -> f64;
    /// Rates of u and s where the part turns at `omega` and slips at `slip`.
    fn contact_rates(&self, state: &State, omega: f64, slip: f64) -> [f64; 2];
    /// Mass and support of the part.
    fn body(&self) -> &Body;
    /// Where the part is touched.
    fn side(&self) -> PartSide;
    /// Outline of the finger.
    fn shape(&self) -> FingerShape;
    /// µ g, m/s².
    fn mu_g(&self) -> f64;
    /// Motion of the finger.
    fn path(&self) -> FingerPath;
    /// The same with another motion of the finger.
    #[must_use]
    fn with_path(self, path: FingerPath) -> Self;
    /// How fast the finger's rim goes by along T because it turns (m/s), ever faster by so much (m/s²).
    fn rim(&self, _state: &State) -> [f64; 2] {
        [0.0; 2]
    }
}

impl ContactModel for PushModel<'_> {
    fn motion(&self, contact: &ContactMode, time: f64, state: &State) -> Motion {
        self.motion(contact, time, state)
    }

    fn slip(&self, time: f64, state: &State) -> f64 {
        self.slip(time, state)
    }

    fn rolling_v_t(&self, time: f64, state: &State) -> f64 {
        self.rolling_v_t(time, state)
    }

    fn sliding_denominator(&self, signed_friction: f64, state: &State) -> f64 {
        self.sliding_denominator(signed_friction, state.s)
    }

    fn velocity(&self, contact: &ContactMode, time: f64, state: &State) -> Vector2<f64> {
        self.velocity(contact, time, state)
    }

    fn centre_of_mass(&self, time: f64, state: &State) -> Point2<f64> {
        self.centre_of_mass(time, state)
    }

    fn theta(&self, state: &State) -> f64 {
        state.u + std::f64::consts::PI - self.side().normal_angle(state.s)
    }

    fn contact_rates(&self, _state: &State, omega: f64, slip: f64) -> [f64; 2] {
        [omega, -self.finger.radius * omega - slip]
    }

    fn body(&self) -> &Body {
        self.part.body()
    }

    fn side(&self) -> PartSide {
        PartSide::Edge(self.edge)
    }

    fn shape(&self) -> FingerShape {
        FingerShape::Disk { radius: self.finger.radius }
    }

    fn mu_g(&self) -> f64 {
        self.mu_g
    }

    fn path(&self) -> FingerPath {
        self.finger.path()
    }

    fn with_path(mut self, path: FingerPath) -> Self {
        let FingerPath { centre0, velocity0, acceleration } = path;
        self.finger = super::model::Finger { radius: self.finger.radius, centre0, velocity0, acceleration };
        self
    }
}

impl ContactModel for ShapedModel<'_> {
    fn motion(&self, contact: &ContactMode, time: f64, state: &State) -> Motion {
        self.motion(contact, time, state)
    }

    fn slip(&self, time: f64, state: &State) -> f64 {
        self.slip(time, state)
    }

    fn rolling_v_t(&self, time: f64, state: &State) -> f64 {
        self.rolling_v_t(time, state)
    }

    fn sliding_denominator(&self, signed_friction: f64, state: &State) -> f64 {
        self.sliding_denominator(signed_friction, state)
    }

    fn velocity(&self, contact: &ContactMode, time: f64, state: &State) -> Vector2<f64> {
        self.velocity(contact, time, state)
    }

    fn centre_of_mass(&self, time: f64, state: &State) -> Point2<f64> {
        self.centre_of_mass(time, state)
    }

    fn theta(&self, state: &State) -> f64 {
        self.theta(state)
    }

    fn contact_rates(&self, state: &State, omega: f64, slip: f64) -> [f64; 2] {
        self.contact_rates(state, omega, slip)
    }

    fn body(&self) -> &Body {
        self.body
    }

    fn side(&self) -> PartSide {
        self.side
    }

    fn shape(&self) -> FingerShape {
        self.shape
    }

    fn mu_g(&self) -> f64 {
        self.mu_g
    }

    fn path(&self) -> FingerPath {
        self.path
    }

    fn with_path(mut self, path: FingerPath) -> Self {
        self.path = path;
        self
    }

    fn rim(&self, state: &State) -> [f64; 2] {
        let pace = self.shape.at(state.u).pace;
        [self.turning.rate0, self.turning.acceleration].map(|of| pace * of)
    }
}

/// N, the part's outward normal at the contact, world axes.
pub(super) fn normal(model: &impl ContactModel, state: &State) -> Vector2<f64> {
    -Vector2::from(model.shape().at(state.u).normal)
}

/// The contact seen from the centre of mass.
pub(super) fn arm(model: &impl ContactModel, state: &State) -> Arm {
    let side = model.side().at(state.s);
    let (place, normal) = (Vector2::from(side.place), Vector2::from(side.normal));
    Arm { height: normal.dot(&place), along: normal.perp(&place) }
}

/// How the part begins to move, at rest with the finger's velocity along N zero.
pub(super) fn rest_start(
    model: &impl ContactModel,
    contact: &ContactMode,
    u: f64,
    s: f64,
) -> Result<RestStart, RestError> {
    let state = State { u, s, omega: 0.0, v_t: 0.0 };
    let (normal, acceleration) = (normal(model, &state), model.path().acceleration);
    let at_rest = AtRest {
        body: model.body(),
        mu_g: model.mu_g(),
        normal: model.side().at(s).normal.into(),
        arm: arm(model, &state),
        // T is a quarter turn clockwise from N.
        finger: [normal.dot(&acceleration), model.rim(&state)[1] - normal.perp(&acceleration)],
    };
    at_rest.start(contact)
}

impl PushModel<'_> {
    /// How the part begins to move, at rest with the finger's velocity along the normal zero.
    ///
    /// # Errors
    /// [`RestError`].
    pub fn rest_start(&self, contact: &ContactMode, u: f64, s: f64) -> Result<RestStart, RestError> {
        rest_start(self, contact, u, s)
    }
}

impl<T: Scalar> PushModel<'_, T> {
    /// The state so shortly (`span`, s) after a start from rest at `[u, s]` that the accelerations `[alpha, a_t]` of
    /// the start still hold, with the finger at rest at first too. For starts whose numbers carry derivatives.
    pub(crate) fn after_rest(&self, [u, s]: [T; 2], [alpha, a_t]: [T; 2], span: f64) -> State<T> {
        let ((sin, cos), [x, y]) = (u.sin_cos(), self.finger.acceleration.into());
        let finger_a_t = cos * y - sin * x;
        let half = 0.5 * span * span;
        State {
            u: u + alpha * half,
            s: s + (a_t - finger_a_t - alpha * self.reach()) * half,
            omega: alpha * span,
            v_t: a_t * span,
        }
    }
}

impl ShapedModel<'_> {
    /// How the part begins to move, at rest with the finger's velocity along the normal zero.
    ///
    /// # Errors
    /// [`RestError`].
    pub fn rest_start(&self, contact: &ContactMode, u: f64, s: f64) -> Result<RestStart, RestError> {
        rest_start(self, contact, u, s)
    }
}
