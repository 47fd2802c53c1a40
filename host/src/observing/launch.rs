//! How a push can begin: the unknowns of a hypothesis, and the path's start that they make.
//!
//! The unknowns are, in this order, contact angle, place on the edge, angular velocity and velocity along the contact. A contact
//! without slip has no say in the last; a push from rest only in the first two.
//!
//! A push from rest is followed in closed form until the part has gone a small share of its size: up to then it moves straight, with
//! the acceleration of the start (see [`crate::pushing`]), and direction of friction and all.
//!
//! Frames: world. Units: SI. Errors: none; a start without a pushing force is none.

use nalgebra::{Const, Vector2};
use num_dual::{Derivative, DualSVec64};

use super::observation::{Known, Touch};
use super::path::{Launch, Site, lifted, without_slip};
use crate::pushing::{Contact, PushModel, RestStart, Scalar, Slip, State};

/// Numbers of unknowns that a hypothesis can have at most.
pub(super) const UNKNOWNS: usize = 4;

/// Contact angle (rad), place on the edge (m), angular velocity (rad/s), velocity along the contact (m/s), all at t = 0.
pub(super) type Unknowns = [f64; UNKNOWNS];

/// Differences of angle (rad) and place (in radii of gyration) by which a start from rest is derived: the solution is exact to
/// 1e-14, so the derivatives are to 1e-9.
const REST_DIFFERENCE: f64 = 1e-5;

/// How a push begins.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Begin {
    /// Finger and part move; no contact friction.
    Free,
    /// Finger and part move, without slip.
    NoSlip,
    /// Finger and part move, with slip in this direction.
    Slips(Slip),
    /// Finger and part are at rest. Where the contact slides throughout, in this direction.
    Rest(Option<Slip>),
}

impl Begin {
    /// All the ways in which a push can begin, for what is known of the contact and the finger.
    pub(super) fn all(known: &Known) -> Vec<Self> {
        let both = [Slip::Forward, Slip::Backward];
        let at_rest = Vector2::from(known.finger.velocity0) == Vector2::zeros();
        match (known.touch, at_rest) {
            (Touch::Sliding { .. }, true) => both.map(|slip| Self::Rest(Some(slip))).to_vec(),
            (_, true) => vec![Self::Rest(None)],
            (Touch::Frictionless, false) => vec![Self::Free],
            (Touch::Rolling { .. }, false) => vec![Self::NoSlip],
            (Touch::Sliding { .. }, false) => both.map(Self::Slips).to_vec(),
            (Touch::Coulomb { .. }, false) => vec![Self::NoSlip, Self::Slips(both[0]), Self::Slips(both[1])],
        }
    }

    /// How many of the unknowns it has.
    pub(super) fn unknowns(self) -> usize {
        match self {
            Self::Rest(_) => 2,
            Self::NoSlip => 3,
            Self::Free | Self::Slips(_) => 4,
        }
    }
}

/// A number that can be made one of the unknowns.
pub(super) trait Variable: Scalar {
    /// The value, as the unknown of this index where derivatives by it are carried.
    fn variable(value: f64, index: usize) -> Self;
}

impl Variable for f64 {
    fn variable(value: f64, _index: usize) -> Self {
        value
    }
}

impl<const N: usize> Variable for DualSVec64<N> {
    fn variable(value: f64, index: usize) -> Self {
        if index < N {
            Self::new(value, Derivative::derivative_generic(Const, Const, index))
        } else {
            Self::from_re(value)
        }
    }
}

/// The start of a path; none where the finger would not push, or slip is against its direction.
pub(super) fn launch<T: Variable>(
    known: &Known,
    site: &Site,
    begin: Begin,
    unknowns: &Unknowns,
    rest_span: f64,
) -> Option<Launch<T>> {
    let [u, s, omega, v_t] = [0, 1, 2, 3].map(|index| T::variable(unknowns[index], index));
    let state = State { u, s, omega, v_t };
    let model = lifted::<T>(&known.model(site.edge));
    let contact = match begin {
        Begin::Free => Contact::Frictionless,
        Begin::Slips(slip) => {
            let along = model.slip(0.0, &state).re() * slip.sign();
            return (along >= 0.0).then_some(moving(state, sliding(known.touch, slip)));
        }
        Begin::NoSlip => {
            let rolling = State { v_t: model.rolling_v_t(0.0, &state), ..state };
            return Some(moving(rolling, no_slip(known.touch, &model, &rolling)));
        }
        Begin::Rest(slip) => return from_rest(known, site, slip, (u, s), rest_span),
    };
    Some(moving(state, contact))
}

fn moving<T>(state: State<T>, contact: Contact<T>) -> Launch<T> {
    Launch { time: 0.0, state, contact, rest: None }
}

fn sliding<T: Scalar>(touch: Touch, slip: Slip) -> Contact<T> {
    match touch {
        Touch::Sliding { friction } | Touch::Coulomb { friction } => {
            Contact::Sliding { friction: T::from(friction), slip }
        }
        Touch::Frictionless | Touch::Rolling { .. } => Contact::Frictionless,
    }
}

fn no_slip<T: Scalar>(touch: Touch, model: &PushModel<T>, state: &State<T>) -> Contact<T> {
    match touch {
        Touch::Coulomb { friction } => without_slip(model, 0.0, state, friction),
        _ => Contact::Rolling,
    }
}

/// How long a start from rest is followed in closed form, s: until the part has gone this share of its size.
pub(super) fn rest_span(known: &Known, share: f64) -> f64 {
    let acceleration = Vector2::from(known.finger.acceleration).norm();
    (2.0 * share * known.part.inertia_per_mass().sqrt() / acceleration).sqrt()
}

fn from_rest<T: Variable>(
    known: &Known,
    site: &Site,
    slip: Option<Slip>,
    (u, s): (T, T),
    span: f64,
) -> Option<Launch<T>> {
    let plain = known.model(site.edge);
    let (contact, start) = rest_start(known, &plain, slip, u.re(), s.re())?;
    let differ = |du: f64, ds: f64| {
        let (_, other) = rest_start(known, &plain, slip, u.re() + du, s.re() + ds)?;
        let difference = du + ds; // One of them is zero.
        Some([(other.alpha - start.alpha) / difference, (other.a_t - start.a_t) / difference])
    };
    let place = REST_DIFFERENCE * known.part.inertia_per_mass().sqrt();
    let (by_u, by_s) = (differ(REST_DIFFERENCE, 0.0)?, differ(0.0, place)?);
    let (du, ds) = (u - u.re(), s - s.re());
    let alpha = du * by_u[0] + ds * by_s[0] + start.alpha;
    let a_t = du * by_u[1] + ds * by_s[1] + start.a_t;
    let [x, y] = known.finger.acceleration;
    let (sin, cos) = u.sin_cos();
    let finger_a_t = cos * y - sin * x;
    let reach = known.finger.radius + site.edge.height;
    let half = 0.5 * span * span;
    let state = State {
        u: u + alpha * half,
        s: s + (a_t - finger_a_t - alpha * reach) * half,
        omega: alpha * span,
        v_t: a_t * span,
    };
    let contact = match contact {
        Contact::Frictionless => Contact::Frictionless,
        Contact::Rolling => Contact::Rolling,
        Contact::Sliding { friction, slip } => Contact::Sliding { friction: T::from(friction), slip },
    };
    Some(Launch { time: span, state, contact, rest: Some((u, alpha * 0.5)) })
}

/// Contact and accelerations of the start from rest.
fn rest_start(known: &Known, model: &PushModel, slip: Option<Slip>, u: f64, s: f64) -> Option<(Contact, RestStart)> {
    let [x, y] = known.finger.acceleration;
    if x * u.cos() + y * u.sin() <= 0.0 {
        return None; // The finger leaves.
    }
    let start = |contact: Contact| {
        let start = model.rest_start(&contact, u, s).ok()?;
        (start.normal_force > 0.0).then_some((contact, start))
    };
    match (known.touch, slip) {
        (Touch::Frictionless, _) => start(Contact::Frictionless),
        (Touch::Rolling { .. }, _) => start(Contact::Rolling),
        (touch, Some(slip)) => start(sliding(touch, slip)),
        (Touch::Sliding { .. }, None) => None,
        (Touch::Coulomb { friction }, None) => {
            let (_, rolling) = start(Contact::Rolling)?;
            if rolling.tangential_force.abs() <= friction * rolling.normal_force {
                return Some((Contact::Rolling, rolling));
            }
            let slip = if rolling.tangential_force > 0.0 { Slip::Backward } else { Slip::Forward };
            start(Contact::Sliding { friction, slip })
        }
    }
}
