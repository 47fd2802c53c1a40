//! Pushes between outlines of any curvature: a disk, an ellipse or a line pushes an edge or an ellipse.
//!
//! The general model beside the fast one of a disk on an edge ([`super::disk_on_edge`]), with the same states and
//! contacts.
//!
//! Implements: thesis §5.1, eqs. (5.7) to (5.17), and §5.4, in a form that never divides by a curvature. Let finger and
//! part have outlines with parameters u and s, lengths g_F du and g_P ds, and normals that turn by k_F du and k_P ds.
//! At the contact, N is the part's outward normal, t = ẑ × N its counter-clockwise direction, T = −t the finger's, c =
//! c_N N + c_t t the contact seen from the centre of mass, and σ = (v + ω ẑ × c − v_F)·t the slip. Both outlines share
//! contact and normal:
//!
//! ```text
//! g_F u̇ + g_P ṡ = −σ     k_F u̇ − k_P ṡ = ω     D = g_F k_P + g_P k_F
//! u̇ = (g_P ω − k_P σ)/D   ṡ = −(g_F ω + k_F σ)/D     the normal turns at φ̇ = k_F u̇
//! ```
//!
//! With (f, τ) the drag of support friction and m = µ_c times the sign of the slip, as there:
//!
//! ```text
//! without friction (m = 0), or sliding:
//!   K = a_F·N + ω² c_N + ω g_P ṡ − φ̇ σ       λ = (−K − f_N + c_t τ/ρ²)/(1 + c_t (c_t − m c_N)/ρ²)
//!   ω̇ = (λ (c_t − m c_N) − τ)/ρ²              v̇_T = φ̇ v_N + mλ − f_T
//! rolling (σ = 0):
//!   ω̇ = (c_N (a_F·t + f_t) − c_t (a_F·N + f_N + ω g_P ṡ) − τ)/(ρ² + c_N² + c_t²)
//!   force on the part a + f with a = a_F + ω̇ (c_t N − c_N t) + ω² c + ω g_P ṡ N
//! ```
//!
//! A disk of radius r that turns at Ω about its centre keeps its outline, but its rim goes by at rΩ along T: what slips
//! is σ + rΩ, and a part that rolls has σ = −rΩ above. Then its acceleration has −rΩ̇ t + rΩ φ̇ N more, and ω̇ follows from
//! that.
//!
//! Assumes: the finger translates, and turns only if it is a disk; one contact, which lasts; at least one of the outlines
//! bends there.
//! Frames: world; forces and accelerations per unit mass on the part. Units: SI.
//! Errors: [`ShapeError`] for outlines that cannot touch at one point.

use nalgebra::{Point2, Rotation2, Vector2};

use super::body::Body;
use super::curve::{CurvePoint, FingerShape, PartSide, dot, left};
use super::disk_on_edge::Motion;
use super::model::{Arm, ContactMode, FingerPath, State};
use super::scalar::Scalar;

/// A part pushed by a finger of any shape. Parameters of type `T` can carry derivatives.
#[derive(Clone, Copy, Debug)]
pub struct ShapedModel<'p, T: nalgebra::Scalar = f64> {
    /// Mass and support of the part.
    pub body: &'p Body,
    /// Where it is touched; for an ellipse, `middle` must be as seen from this body's centre of mass.
    pub side: PartSide,
    /// µ g: what support friction decelerates a sliding part by, m/s².
    pub mu_g: T,
    /// Outline of the finger.
    pub shape: FingerShape,
    /// Motion of the finger.
    pub path: FingerPath<T>,
    /// How a disk turns about its centre; other outlines do not turn.
    pub turning: Turning<T>,
}

/// How a finger's disk turns about its centre.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Turning<T = f64> {
    /// Ω at t = 0, counter-clockwise, rad/s.
    pub rate0: T,
    /// Ω̇, rad/s².
    pub acceleration: f64,
}

impl<T: Scalar> Turning<T> {
    /// Ω at a time (s), rad/s.
    fn rate(&self, time: f64) -> T {
        self.rate0 + T::from(self.acceleration * time)
    }
}

/// Outlines that cannot touch at one point.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum ShapeError {
    /// Finger and part are both straight where they touch.
    #[error(
        "a straight finger touches a straight edge along a line, not at a point: give the finger or the part a curved outline"
    )]
    BothStraight,
    /// A size that cannot be.
    #[error("{what} of {size:?} m must be a finite length {limit}")]
    Size {
        /// Which length it is.
        what: &'static str,
        /// The length as given, m.
        size: f64,
        /// What it must be.
        limit: &'static str,
    },
}

/// The contact seen from the centre of mass and from both outlines.
pub(super) struct Touch<T> {
    /// N, world axes.
    normal: [T; 2],
    /// Part's outline, from the centre of mass, part axes.
    part: CurvePoint<T>,
    /// Finger's outline, from its centre.
    finger: CurvePoint<T>,
    /// c_N and c_t, m.
    pub(super) arm: Arm<T>,
}

/// Components along N and t.
#[derive(Clone, Copy)]
struct Components<T> {
    n: T,
    t: T,
}

/// Drag of support friction per unit mass.
#[derive(Clone, Copy)]
struct Drag<T> {
    n: T,
    t: T,
    moment: T,
}

/// How the contact travels.
struct Travel<T> {
    u: T,
    s: T,
    /// φ̇, rate at which N turns, world axes, rad/s.
    normal: T,
}

impl<T: Scalar> Touch<T> {
    fn components(&self, v: Vector2<T>) -> Components<T> {
        let v = v.into();
        Components { n: dot(v, self.normal), t: dot(v, left(self.normal)) }
    }

    /// How the contact travels where the part turns at `omega` and slips at `slip`.
    fn travel(&self, omega: T, slip: T) -> Travel<T> {
        let (finger, part) = (&self.finger, &self.part);
        // The normals stay opposite (5.6), and the lengths that the contact covers differ by the slip: two equations
        // for u̇ and ṡ, (5.7) and (5.8), solved without a division by a curvature.
        let together = finger.pace * part.bend + part.pace * finger.bend;
        let u = (part.pace * omega - part.bend * slip) / together;
        let s = -(finger.pace * omega + finger.bend * slip) / together;
        Travel { u, s, normal: finger.bend * u }
    }
}

/// Everything the formulas share.
struct Instant<T> {
    touch: Touch<T>,
    /// Relative to the finger's outline, whether that turns or not.
    slip: T,
    velocity: Components<T>,
    finger_acceleration: Components<T>,
    drag: Drag<T>,
    travel: Travel<T>,
}

impl<'p> ShapedModel<'p> {
    /// A model of a finger that touches `side` of a part with this `body`.
    ///
    /// # Errors
    /// [`ShapeError`].
    pub fn new(
        body: &'p Body,
        side: PartSide,
        mu_g: f64,
        shape: FingerShape,
        path: FingerPath,
    ) -> Result<Self, ShapeError> {
        check_shape(&shape)?;
        if let PartSide::Ellipse { semi_axes, .. } = side {
            check_sizes("a semi-axis of the part", &semi_axes)?;
        }
        if matches!((shape, side), (FingerShape::Line, PartSide::Edge(_))) {
            return Err(ShapeError::BothStraight);
        }
        Ok(Self { body, side, mu_g, shape, path, turning: Turning::default() })
    }
}

fn check_shape(shape: &FingerShape) -> Result<(), ShapeError> {
    match shape {
        FingerShape::Disk { radius } if !(*radius >= 0.0 && radius.is_finite()) => {
            Err(ShapeError::Size { what: "the finger's radius", size: *radius, limit: "of 0 or more" })
        }
        FingerShape::Ellipse { semi_axes } => check_sizes("a semi-axis of the finger", semi_axes),
        _ => Ok(()),
    }
}

fn check_sizes(what: &'static str, sizes: &[f64]) -> Result<(), ShapeError> {
    let bad = sizes.iter().find(|size| !(**size > 0.0 && size.is_finite()));
    bad.map_or(Ok(()), |&size| Err(ShapeError::Size { what, size, limit: "above 0" }))
}

impl<T: Scalar> ShapedModel<'_, T> {
    pub(super) fn touch(&self, state: &State<T>) -> Touch<T> {
        let (finger, part) = (self.shape.at(state.u), self.side.at(state.s));
        let arm = Arm { height: dot(part.place, part.normal), along: dot(part.place, left(part.normal)) };
        Touch { normal: finger.normal.map(|component| -component), part, finger, arm }
    }

    /// Rates and contact force at time `time` (s).
    #[must_use]
    pub fn motion(&self, contact: &ContactMode<T>, time: f64, state: &State<T>) -> Motion<T> {
        let instant = self.instant(contact, time, state);
        match contact.signed_friction() {
            Some(m) => self.sliding(m, state, &instant),
            None => self.rolling(state, &instant),
        }
    }

    /// Slip of the part relative to the finger along the part's counter-clockwise direction, m/s.
    #[must_use]
    pub fn slip(&self, time: f64, state: &State<T>) -> T {
        self.rolling_v_t(time, state) - state.v_t
    }

    /// v_T of a part that rolls, m/s.
    #[must_use]
    pub fn rolling_v_t(&self, time: f64, state: &State<T>) -> T {
        let touch = self.touch(state);
        touch.arm.height * state.omega - touch.components(self.path.velocity(time)).t + self.rim_speed(&touch, time)
    }

    /// How fast the finger's rim goes by along T because it turns, m/s.
    fn rim_speed(&self, touch: &Touch<T>, time: f64) -> T {
        touch.finger.pace * self.turning.rate(time)
    }

    /// 1 + c_t (c_t − m c_N)/ρ²: at 0 and below, no contact force fits a sliding part (Painlevé).
    #[must_use]
    pub fn sliding_denominator(&self, signed_friction: T, state: &State<T>) -> T {
        self.denominator(signed_friction, &self.touch(state).arm)
    }

    fn denominator(&self, m: T, arm: &Arm<T>) -> T {
        arm.along * (arm.along - m * arm.height) / self.body.inertia_per_mass() + 1.0
    }

    /// Velocity of the centre of mass, world axes, m/s.
    #[must_use]
    pub fn velocity(&self, contact: &ContactMode<T>, time: f64, state: &State<T>) -> Vector2<T> {
        let touch = self.touch(state);
        let (velocity, _) = self.velocity_and_slip(&touch, contact, time, state);
        let along = left(touch.normal);
        [0, 1].map(|axis| touch.normal[axis] * velocity.n + along[axis] * velocity.t).into()
    }

    fn velocity_and_slip(
        &self,
        touch: &Touch<T>,
        contact: &ContactMode<T>,
        time: f64,
        state: &State<T>,
    ) -> (Components<T>, T) {
        let finger = touch.components(self.path.velocity(time));
        // As if the contact point of the part moved with the finger's outline.
        let along =
            Components { n: finger.n + touch.arm.along * state.omega, t: finger.t - touch.arm.height * state.omega };
        match contact {
            // Without slip it moves with the rim.
            ContactMode::Rolling => {
                let rim = self.rim_speed(touch, time);
                (Components { t: along.t - rim, ..along }, -rim)
            }
            ContactMode::Frictionless | ContactMode::Sliding { .. } => {
                (Components { t: -state.v_t, ..along }, -state.v_t - along.t)
            }
        }
    }

    fn instant(&self, contact: &ContactMode<T>, time: f64, state: &State<T>) -> Instant<T> {
        let touch = self.touch(state);
        let (velocity, slip) = self.velocity_and_slip(&touch, contact, time, state);
        Instant {
            finger_acceleration: touch.components(self.path.acceleration),
            drag: self.drag(&touch, velocity, state.omega),
            travel: touch.travel(state.omega, slip),
            touch,
            slip,
            velocity,
        }
    }

    /// Turns to part axes and back: there N is the part's own normal.
    fn drag(&self, touch: &Touch<T>, velocity: Components<T>, omega: T) -> Drag<T> {
        let normal = touch.part.normal;
        let along = left(normal);
        let body = [0, 1].map(|axis| normal[axis] * velocity.n + along[axis] * velocity.t);
        let [x, y, moment] = self.body.sliding([body[0], body[1], omega]);
        Drag { n: dot([x, y], normal) * self.mu_g, t: dot([x, y], along) * self.mu_g, moment: moment * self.mu_g }
    }

    fn sliding(&self, m: T, state: &State<T>, instant: &Instant<T>) -> Motion<T> {
        let Instant { touch, slip, velocity, finger_acceleration, drag, travel } = instant;
        let (rho_squared, omega) = (self.body.inertia_per_mass(), state.omega);
        let Arm { height, along } = touch.arm;
        // K: (5.1) along N by time, less its terms in ω̇ and in the part's acceleration.
        let closing =
            finger_acceleration.n + omega * omega * height + omega * touch.part.pace * travel.s - travel.normal * *slip;
        // Newton and Euler (5.2), (5.3) put into K leave λ alone: λ D = −K − f_N + c_t τ/ρ².
        let push = along * drag.moment / rho_squared - closing - drag.n;
        let normal_force = push / self.denominator(m, &touch.arm);
        // Euler with the arm c_t − m c_N; along T Newton, in axes that turn at φ̇: (5.42), (5.43).
        let rates = State {
            u: travel.u,
            s: travel.s,
            omega: (normal_force * (along - m * height) - drag.moment) / rho_squared,
            v_t: travel.normal * velocity.n + m * normal_force + drag.t,
        };
        Motion { rates, normal_force, tangential_force: -(m * normal_force) }
    }

    fn rolling(&self, state: &State<T>, instant: &Instant<T>) -> Motion<T> {
        let Instant { touch, slip, finger_acceleration, drag, travel, .. } = instant;
        let (rho_squared, omega) = (self.body.inertia_per_mass(), state.omega);
        let Arm { height, along } = touch.arm;
        // The contact travels along the part's outline at pace · ṡ, and along the finger's rim where that turns: what
        // both add to (5.36).
        let wander = omega * touch.part.pace * travel.s - travel.normal * *slip;
        let rim = touch.finger.pace * self.turning.acceleration;
        let along_acceleration = finger_acceleration.t - rim;
        // Euler (5.3) about the contact, with Newton and the acceleration of (5.36) put in: (5.37), ω̇ of (5.35).
        let moment =
            height * (along_acceleration + drag.t) - along * (finger_acceleration.n + drag.n + wander) - drag.moment;
        let alpha = moment / (height * height + along * along + rho_squared);
        let spin = omega * omega;
        // The part's acceleration (5.36); the contact force is a + f.
        let a_n = finger_acceleration.n + alpha * along + spin * height + wander;
        let a_t = along_acceleration - alpha * height + spin * along;
        let rates = State { u: travel.u, s: travel.s, omega: alpha, v_t: T::from(0.0) };
        Motion { rates, normal_force: -(a_n + drag.n), tangential_force: a_t + drag.t }
    }

    /// Rates of u and s where the part turns at `omega` and slips at `slip`.
    pub(super) fn contact_rates(&self, state: &State<T>, omega: T, slip: T) -> [T; 2] {
        let Travel { u, s, .. } = self.touch(state).travel(omega, slip);
        [u, s]
    }
}

impl<'p> ShapedModel<'p> {
    /// The same with numbers that can carry derivatives.
    pub(in crate::pushing) fn lifted<T: Scalar>(&self) -> ShapedModel<'p, T> {
        let FingerPath { centre0, velocity0, acceleration } = self.path;
        let path = FingerPath { centre0, velocity0: velocity0.map(T::from), acceleration: acceleration.map(T::from) };
        let turning = Turning { rate0: T::from(self.turning.rate0), acceleration: self.turning.acceleration };
        ShapedModel { body: self.body, side: self.side, mu_g: T::from(self.mu_g), shape: self.shape, path, turning }
    }
}

impl ShapedModel<'_> {
    /// The state so shortly (`span`, s) after a start from rest at `[u, s]` that the accelerations `[alpha, a_t]` of
    /// the start still hold, with the finger at rest at first too.
    pub(in crate::pushing) fn after_rest(&self, [u, s]: [f64; 2], [alpha, a_t]: [f64; 2], span: f64) -> State {
        let state = State { u, s, omega: alpha * span, v_t: a_t * span };
        // Relative to the outline, which does not turn: it grows as the velocities do.
        let still = Self { turning: Turning::default(), ..*self };
        let [u_rate, s_rate] = still.contact_rates(&state, state.omega, still.slip(span, &state));
        State { u: u + 0.5 * span * u_rate, s: s + 0.5 * span * s_rate, ..state }
    }
}

impl ShapedModel<'_> {
    /// The centre of mass, world axes, m.
    #[must_use]
    pub fn centre_of_mass(&self, time: f64, state: &State) -> Point2<f64> {
        let Touch { normal, finger, arm, .. } = self.touch(state);
        let (normal, along) = (Vector2::from(normal), Vector2::from(left(normal)));
        self.path.centre(time) + Vector2::from(finger.place) - normal * arm.height - along * arm.along
    }

    /// Turn from world to part axes, rad; continuous in u and s.
    #[must_use]
    pub fn theta(&self, state: &State) -> f64 {
        self.shape.normal_angle(state.u) + std::f64::consts::PI - self.side.normal_angle(state.s)
    }

    /// The contact, world axes, m.
    #[must_use]
    pub fn contact_point(&self, time: f64, state: &State) -> Point2<f64> {
        self.path.centre(time) + Vector2::from(self.shape.at(state.u).place)
    }

    /// Position of the part frame's origin, m.
    #[must_use]
    pub fn position(&self, time: f64, state: &State) -> Point2<f64> {
        self.centre_of_mass(time, state) - Rotation2::new(self.theta(state)) * self.body.centre_of_mass().coords
    }
}
