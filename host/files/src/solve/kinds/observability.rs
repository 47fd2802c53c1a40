//! The kind `observability`: which changes of a state show in the contact. See [`palpate::pushing::observability`].
//!
//! To add a system: a type with its fields, a variant of [`Observability`], and what its answer adds to
//! [`ObservabilityAnswer`].

use std::collections::BTreeMap;

use palpate::gravity::GRAVITY_ASSUMED;
use palpate::math::Spectrum;
use palpate::pushing::dynamics::{ContactMode, Slip, Start};
use palpate::pushing::observability::{PushObservabilityError, STATE_NAMES, Scales, spectrum};
use palpate::rolling::observability::STATE_NAMES as ROLL_STATE_NAMES;
use palpate::rolling::{
    self, CannotFollow, Model, OnPalm, PalmAcceleration, Roll, RollError, SufficientCondition, observability,
};
use schemars::JsonSchema;
use serde::{Deserialize, Deserializer, Serialize};

use super::push::{Mode, Push, PushFields, PushStartFields};
use super::pushed::Pushed;
use super::roll::{BodyFields, Spin};
use crate::solve::fields::{NonNegative, Times, default_gravity};
use crate::solve::{InvalidInput, Pointer, Problem, SolveError, tagged};

/// A state of a system: what of it can be told from its contact?
#[derive(Clone, Debug, Serialize, JsonSchema)]
#[serde(tag = "system", rename_all = "snake_case")]
#[schemars(tag = "system", rename_all = "snake_case")]
pub enum Observability {
    /// A part that a finger pushes, observed by its contact angle.
    Push(Box<PushSystem>),
    /// A smooth convex body that rolls on a palm, observed by the contact's path.
    Roll(Box<RollSystem>),
}

impl<'de> Deserialize<'de> for Observability {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        tagged(
            deserializer,
            "system",
            &[("push", |fields| fields.read().map(Self::Push)), ("roll", |fields| fields.read().map(Self::Roll))],
        )
    }
}

/// What can be told.
#[derive(Clone, Debug, PartialEq, Serialize, JsonSchema)]
pub struct ObservabilityAnswer {
    /// How many numbers the state has.
    pub dimension: usize,
    /// How many independent changes of the state show in the contact.
    pub rank: usize,
    /// Whether all changes of the state show: `rank` is `dimension`.
    pub observable: bool,
    /// Of the contact's derivatives by the state in the system's scales, as shares of the largest, largest first. Below 1e-7
    /// counts as nothing.
    pub singular_values: Vec<f64>,
    /// A basis of the changes that do not show: weights of the states, each in its scale.
    pub unobservable_directions: Vec<BTreeMap<&'static str, f64>>,
    /// For `roll`: the thesis's Theorem 32, which is sufficient but not necessary.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sufficient_condition: Option<SufficientConditionFields>,
}

impl ObservabilityAnswer {
    /// From a spectrum and the names of its states.
    fn of(spectrum: Spectrum, names: &[&'static str]) -> Self {
        let named = |direction: &Vec<f64>| names.iter().copied().zip(direction.iter().copied()).collect();
        Self {
            dimension: spectrum.singular_values.len(),
            rank: spectrum.rank(),
            observable: spectrum.observable(),
            unobservable_directions: spectrum.unseen.iter().map(named).collect(),
            singular_values: spectrum.singular_values,
            sufficient_condition: None,
        }
    }
}

impl Problem for Observability {
    const KIND: &'static str = "observability";
    type Answer = ObservabilityAnswer;

    fn solve(&self) -> Result<ObservabilityAnswer, SolveError> {
        match self {
            Self::Push(push) => push.solve(),
            Self::Roll(roll) => roll.solve(),
        }
    }
}

/// A body that rolls: the state in question.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct RollSystem {
    /// The body that rolls.
    pub body: BodyFields,
    /// Whether the contact lets the body spin about the normal.
    pub spin: Spin,
    /// Gravity, m/s².
    #[serde(default = "default_gravity")]
    pub g: NonNegative,
    /// Quaternion `[w, x, y, z]` of length 1, body → palm.
    pub orientation: [f64; 4],
    /// Angular velocity, body axes, rad/s.
    pub omega: [f64; 3],
    /// How the palm accelerates while it feels.
    pub inputs: Inputs,
}

/// How the palm moves while it feels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Inputs {
    /// Not at all.
    Zero,
    /// Up and down.
    Vertical,
    /// In all directions, with unrelated frequencies.
    Generic,
}

impl From<Inputs> for rolling::Inputs {
    fn from(inputs: Inputs) -> Self {
        match inputs {
            Inputs::Zero => Self::Zero,
            Inputs::Vertical => Self::Vertical,
            Inputs::Generic => Self::Generic,
        }
    }
}

/// The thesis's Theorem 32 at one contact, with its terms. Lengths in units of the body's size L.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, JsonSchema)]
pub struct SufficientConditionFields {
    /// Whether the theorem says that the state is observable; where it does not, the rank decides.
    pub holds: bool,
    /// det(b₁, b₂, β) of (7.32); null at an umbilic.
    pub det_b1_b2_beta: Option<f64>,
    /// β·(I z) of (7.33), over the mass; without spin h(n), which takes its place.
    pub beta_dot_inertia_z: f64,
    /// |β × z|: where it is 0, (7.34) is asked instead of (7.33).
    pub beta_cross_z: f64,
    /// κ₁ xᵀD⁻¹x − κ₂ yᵀD⁻¹y of (7.34).
    pub curvature_term: f64,
    /// xᵀD⁻¹y of (7.34), in 1/L².
    pub mobility_term: f64,
}

impl From<SufficientCondition> for SufficientConditionFields {
    fn from(condition: SufficientCondition) -> Self {
        Self {
            holds: condition.holds,
            det_b1_b2_beta: condition.determinant,
            beta_dot_inertia_z: condition.contact_and_inertia,
            beta_cross_z: condition.contact_across_normal,
            curvature_term: condition.curvature_and_mobility,
            mobility_term: condition.mobility_across,
        }
    }
}

impl RollSystem {
    fn solve(&self) -> Result<ObservabilityAnswer, SolveError> {
        let body = self.body.build().map_err(|error| error.inside("body"))?;
        if self.g.get() == 0.0 {
            return Err(
                InvalidInput::at("g", "is 0: nothing presses the body onto the palm, give a gravity above 0").into()
            );
        }
        let on = OnPalm { body: &body, spin: self.spin.into(), palm: &PalmAcceleration::Rest, g: self.g.get() };
        let roll = Roll::new(on, self.orientation, self.omega, [0.0; 2]).map_err(refuse_start)?;
        let model = Model { body: &body, spin: self.spin.into() };
        let found = observability(&model, roll.start(), self.g.get(), self.inputs.into()).map_err(|error| {
            let field = if matches!(error, CannotFollow::TooSharp { .. }) { "body" } else { "omega" };
            InvalidInput::at(field, error.to_string())
        })?;
        let states = found.spectrum.singular_values.len();
        Ok(ObservabilityAnswer {
            sufficient_condition: Some(found.sufficient_condition.into()),
            ..ObservabilityAnswer::of(found.spectrum, &ROLL_STATE_NAMES[..states])
        })
    }
}

fn refuse_start(error: RollError) -> InvalidInput {
    let field = if matches!(error, RollError::Quaternion { .. }) { "orientation" } else { "omega" };
    InvalidInput::at(field, error.to_string())
}

/// A push in motion: the fields of the kind `push`, without times. What happens at the contact is `frictionless`,
/// `rolling` or `sliding`, and is taken to last.
pub type PushSystem = Pushed<PushSystemFields>;

/// A push in motion: the fields of the kind `push`, without times. What happens at the contact is `frictionless`,
/// `rolling` or `sliding`, and is taken to last.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "PushSystem")]
pub struct PushSystemFields {
    /// The edge in contact, from vertex `edge` to the next.
    pub edge: usize,
    /// The state in question; not at rest.
    pub initial: PushStartFields,
}

impl PushSystem {
    fn solve(&self) -> Result<ObservabilityAnswer, SolveError> {
        let push = self.push()?;
        let part = push.setup.part()?;
        let contact = self.contact()?;
        let (model, Start::Moving(state)) = push.checked(&part)? else {
            let message = "a part at rest has no direction of friction: give `omega` (and `vT`) instead";
            return Err(InvalidInput::at(Pointer::from("initial").key("at_rest"), message).into());
        };
        let length = part.inertia_per_mass().sqrt();
        // Without gravity there is no time to compare with; the usual one keeps the scales finite.
        let gravity = if self.setup.g.get() > 0.0 { self.setup.g.get() } else { GRAVITY_ASSUMED };
        let scales = Scales { length, time: (length / gravity).sqrt() };
        let spectrum = spectrum(&model, &contact, &state, &scales).map_err(refuse)?;
        let states = spectrum.singular_values.len();
        Ok(ObservabilityAnswer::of(spectrum, &STATE_NAMES[..states]))
    }

    /// The same as the kind `push` has it.
    fn push(&self) -> Result<Push, InvalidInput> {
        let PushSystemFields { edge, initial } = self.own.clone();
        let own = PushFields { edge, initial, times: Times::try_from(vec![0.0])?, stop_at_edge_end: true };
        Ok(Push { setup: self.setup.clone(), own })
    }

    fn contact(&self) -> Result<ContactMode, InvalidInput> {
        match self.setup.mode {
            Mode::Frictionless => Ok(ContactMode::Frictionless),
            Mode::Rolling => Ok(ContactMode::Rolling),
            Mode::Sliding => Ok(ContactMode::Sliding { friction: self.setup.needed_friction()?, slip: self.slip() }),
            Mode::Coulomb => {
                let message = "`coulomb` is no single system: ask for `rolling` and `sliding` apart";
                Err(InvalidInput::at("mode", message))
            }
        }
    }

    /// What `push` checks it to be: 1 or −1.
    fn slip(&self) -> Slip {
        if self.own.initial.sliding_sign.is_some_and(|sign| sign < 0.0) { Slip::Backward } else { Slip::Forward }
    }
}

fn refuse(error: PushObservabilityError) -> InvalidInput {
    let field = match error {
        PushObservabilityError::AtRest => Pointer::from("initial"),
        PushObservabilityError::Jammed => Pointer::from("initial").key("s"),
    };
    InvalidInput::at(field, error.to_string())
}
