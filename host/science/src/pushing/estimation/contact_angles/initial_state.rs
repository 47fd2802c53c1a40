//! How a push can begin: the unknowns of a hypothesis, and the path's start that they make.
//!
//! The unknowns are, in this order, contact angle, place on the edge, angular velocity and the motion along the
//! contact: its velocity where there is no friction, and its slip, from 0 on, where the contact slides. A contact
//! without slip lacks the last; a push from rest has only the first two. Where the plane's friction is not known well,
//! it is one more, the last.
//!
//! A push from rest is followed in closed form until the part has gone a small share of its size: up to then it moves
//! straight, with the acceleration of the start (see [`crate::pushing::dynamics`]), and direction of friction and all.
//!
//! Frames: world. Units: SI. Errors: none; a start without a pushing force is none.

use super::path::{ContactInterval, InitialState};
use crate::math::Jet;
use crate::pushing::dynamics::contact_mode::ContactFriction;
use crate::pushing::dynamics::{ContactMode, PushModel, RestStart, Scalar, Slip, State};
use crate::pushing::estimation::observation::{Known, Touch};

/// Numbers of unknowns that a hypothesis can have at most.
pub(in crate::pushing::estimation) const UNKNOWNS: usize = 5;

/// Number among the unknowns of the contact angle.
pub(in crate::pushing::estimation) const ANGLE: usize = 0;
/// Number among the unknowns of the place on the edge.
pub(in crate::pushing::estimation) const PLACE: usize = 1;

/// Number among the unknowns of the plane's friction.
pub(in crate::pushing::estimation) const MU_G: usize = 4;

/// Contact angle (rad), place on the edge (m), angular velocity (rad/s), velocity or slip along the contact (m/s), all
/// at t = 0; logarithm of µ g over what it is taken for.
pub(in crate::pushing::estimation) type Unknowns = [f64; UNKNOWNS];

/// Differences of angle (rad), place (in radii of gyration) and µ g (of itself) by which a start from rest is derived:
/// the solution is exact to 1e-14, so the derivatives are to 1e-9.
const REST_DIFFERENCE: f64 = 1e-5;

/// Of a finger that stays where it is.
const NO_START: RestStart = RestStart { a_n: 0.0, a_t: 0.0, alpha: 0.0, normal_force: 0.0, tangential_force: 0.0 };

/// What moves at the start, and how the contact slides.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::pushing::estimation) enum StartMode {
    /// Finger and part move; no contact friction.
    Free,
    /// Finger and part move, without slip.
    NoSlip,
    /// Finger and part move, with slip in this direction.
    Slips(Slip),
    /// Finger and part are at rest. Where the contact slides throughout, in this direction.
    Rest(Option<Slip>),
}

impl StartMode {
    /// All the ways in which a push can begin, for what is known of the contact and the finger.
    pub(in crate::pushing::estimation) fn all(known: &Known) -> Vec<Self> {
        let both = [Slip::Forward, Slip::Backward];
        match (known.touch, known.starts_at_rest()) {
            (Touch::Sliding { .. }, true) => both.map(|slip| Self::Rest(Some(slip))).to_vec(),
            (_, true) => vec![Self::Rest(None)],
            (Touch::Frictionless, false) => vec![Self::Free],
            (Touch::Rolling { .. }, false) => vec![Self::NoSlip],
            (Touch::Sliding { .. }, false) => both.map(Self::Slips).to_vec(),
            (Touch::Coulomb { .. }, false) => vec![Self::NoSlip, Self::Slips(both[0]), Self::Slips(both[1])],
        }
    }

    /// How many of the unknowns it has, the plane's friction not counted.
    pub(in crate::pushing::estimation) fn unknowns(self) -> usize {
        match self {
            Self::Rest(_) => 2,
            Self::NoSlip => 3,
            Self::Free | Self::Slips(_) => 4,
        }
    }
}

/// A number that can be made one of the unknowns.
pub(in crate::pushing::estimation) trait Variable: Scalar {
    /// The value, as the unknown of this index where derivatives by it are carried.
    fn variable(value: f64, index: usize) -> Self;
}

impl Variable for f64 {
    fn variable(value: f64, _index: usize) -> Self {
        value
    }
}

impl<const N: usize> Variable for Jet<N> {
    fn variable(value: f64, index: usize) -> Self {
        Self::variable(value, index)
    }
}

/// How a push is taken to begin.
#[derive(Clone, Copy)]
pub(in crate::pushing::estimation) struct StartGuess<'a, T> {
    pub(in crate::pushing::estimation) start_mode: StartMode,
    /// Those that the mode of the start has.
    pub(in crate::pushing::estimation) unknowns: &'a Unknowns,
    /// µ g where it is one of the unknowns, m/s²: of the value in [`Known`].
    pub(in crate::pushing::estimation) mu_g: Option<T>,
}

/// The start of a path; none where the finger would not push, or slip is against its direction.
pub(in crate::pushing::estimation) fn initial_state<T: Variable>(
    known: &Known,
    interval: &ContactInterval,
    &StartGuess { start_mode, unknowns, mu_g }: &StartGuess<'_, T>,
    rest_span: f64,
) -> Option<InitialState<T>> {
    let [u, s, omega, along] = [0, 1, 2, 3].map(|index| T::variable(unknowns[index], index));
    let state = State { u, s, omega, v_t: along };
    let plain = known.model(interval.edge).lifted::<T>();
    let model = PushModel { mu_g: mu_g.unwrap_or(plain.mu_g), ..plain };
    // v_T without slip (5.31).
    let rolling = |state: State<T>| State { v_t: model.rolling_v_t(0.0, &state), ..state };
    let (state, contact) = match start_mode {
        StartMode::Free => (state, ContactMode::Frictionless),
        StartMode::Slips(slip) => {
            // The fourth unknown is the speed of slip: slip is v_FT + hω − v_T.
            let without = rolling(state);
            (State { v_t: without.v_t - along * slip.sign(), ..without }, sliding(known.touch, slip))
        }
        StartMode::NoSlip => {
            let state = rolling(state);
            (state, no_slip(known.touch, &model, &state))
        }
        StartMode::Rest(slip) => return from_rest(known, interval, RestGuess { slip, u, s, mu_g }, rest_span),
    };
    Some(InitialState { time: 0.0, state, contact, rest: None, mu_g: model.mu_g })
}

fn sliding<T: Scalar>(touch: Touch, slip: Slip) -> ContactMode<T> {
    match touch {
        Touch::Sliding { friction } | Touch::Coulomb { friction } => {
            ContactMode::Sliding { friction: T::from(friction), slip }
        }
        Touch::Frictionless | Touch::Rolling { .. } => ContactMode::Frictionless,
    }
}

fn no_slip<T: Scalar>(touch: Touch, model: &PushModel<T>, state: &State<T>) -> ContactMode<T> {
    match touch.deciding_friction() {
        Some(friction) => friction.map(T::from).without_slip(&model.motion(&ContactMode::Rolling, 0.0, state).force()),
        None => ContactMode::Rolling,
    }
}

/// How long a start from rest is followed in closed form, s: until the part has gone this share of its size.
pub(in crate::pushing::estimation) fn rest_span(known: &Known, share: f64) -> f64 {
    let acceleration = known.finger.acceleration.norm();
    (2.0 * share * known.part.inertia_per_mass().sqrt() / acceleration).sqrt()
}

/// How a push from rest is taken to begin.
struct RestGuess<T> {
    /// Where the contact slides at once: in which direction.
    slip: Option<Slip>,
    /// Contact angle, rad.
    u: T,
    /// Place on the edge, m.
    s: T,
    /// µ g where it is one of the unknowns, m/s².
    mu_g: Option<T>,
}

fn from_rest<T: Variable>(
    known: &Known,
    interval: &ContactInterval,
    RestGuess { slip, u, s, mu_g }: RestGuess<T>,
    span: f64,
) -> Option<InitialState<T>> {
    let plain = known.model(interval.edge);
    let (contact, start) = rest_start(known, &plain, slip, u.re(), s.re())?;
    let differ = |[du, ds, dg]: [f64; 3]| {
        let other = PushModel { mu_g: plain.mu_g + dg, ..plain };
        let (_, other) = rest_start(known, &other, slip, u.re() + du, s.re() + ds)?;
        let difference = du + ds + dg; // Two of them are zero.
        Some([(other.alpha - start.alpha) / difference, (other.a_t - start.a_t) / difference])
    };
    let place = REST_DIFFERENCE * known.part.inertia_per_mass().sqrt();
    let (by_u, by_s) = (differ([REST_DIFFERENCE, 0.0, 0.0])?, differ([0.0, place, 0.0])?);
    let (du, ds) = (u - u.re(), s - s.re());
    let mut alpha = du * by_u[0] + ds * by_s[0] + start.alpha;
    let mut a_t = du * by_u[1] + ds * by_s[1] + start.a_t;
    if let Some(mu_g) = mu_g.filter(|mu_g| mu_g.re() > 0.0) {
        let by_mu_g = differ([0.0, 0.0, REST_DIFFERENCE * plain.mu_g])?;
        let dg = mu_g - mu_g.re();
        (alpha, a_t) = (alpha + dg * by_mu_g[0], a_t + dg * by_mu_g[1]);
    }
    let state = plain.lifted::<T>().after_rest([u, s], [alpha, a_t], span);
    let contact = contact.map(T::from);
    let mu_g = mu_g.unwrap_or_else(|| T::from(plain.mu_g));
    Some(InitialState { time: span, state, contact, rest: Some((u, alpha * 0.5)), mu_g })
}

/// Contact and accelerations of the start from rest.
fn rest_start(
    known: &Known,
    model: &PushModel,
    slip: Option<Slip>,
    u: f64,
    s: f64,
) -> Option<(ContactMode, RestStart)> {
    let [x, y] = known.finger.acceleration.into();
    if x.hypot(y) <= 0.0 {
        return Some((ContactMode::Frictionless, NO_START)); // Nothing ever moves.
    }
    if x * u.cos() + y * u.sin() <= 0.0 {
        return None; // The finger leaves.
    }
    let start = |contact: &ContactMode| model.rest_start(contact, u, s);
    let contact = match (known.touch, slip) {
        (Touch::Frictionless, _) => ContactMode::Frictionless,
        (Touch::Rolling { .. }, _) => ContactMode::Rolling,
        (touch, Some(slip)) => sliding(touch, slip),
        (Touch::Sliding { .. }, None) => return None,
        (Touch::Coulomb { friction }, None) => {
            let begun = ContactFriction::same(friction).begun(0.0, start).ok()?;
            return Some(begun).filter(|(_, start)| start.force().pushes());
        }
    };
    let start = start(&contact).ok()?;
    start.force().pushes().then_some((contact, start))
}
