//! Smooth convex bodies that roll on a palm: their motion, what the contact path tells, and how to read it.
//!
//! The palm feels where the body touches it: a path `u(t)`. From it alone this module finds the body's attitude and
//! angular velocity, modulo what symmetry hides; the thesis left that observer open.
//!
//! In reading order:
//! - [`shape`]: a surface by its support function; [`symmetry`]: turns that leave a body as it is; [`body`]: both with
//!   its inertia;
//! - [`palm`]: how the palm accelerates; [`mechanics`]: rates, contact force and energy at one instant; [`run`]: a
//!   whole roll;
//! - [`flow`]: how the motion changes with its start, the body and the palm; [`mod@observability`]: what of the state
//!   the path tells; [`constant_velocity`]: the same order by order, in two precisions;
//! - [`observer`]: pose and motion from a path, without a prior; [`tracker`]: the same live, contact by contact;
//! - [`gho`]: the thesis's kind of observer, and why it is not used.
//!
//! Implements: thesis chapter 7 without charts, with its errors put right (see [`mechanics`]).
//! Frames: body axes: origin at the centre of mass, principal axes of inertia; palm axes: e₃ up along the palm's
//! normal, the palm translates and does not turn. Orientations turn body axes into palm axes. Units: SI; forces,
//! energies and inertia over the body's mass, which drops out.

pub mod body;
pub mod constant_velocity;
pub mod flow;
pub mod gho;
pub mod mechanics;
pub mod observability;
pub mod observer;
pub mod palm;
pub mod run;
pub mod shape;
pub mod symmetry;
pub mod tracker;

pub use body::{BodyError, RollingBody};
pub use flow::{Columns, STATE_COLUMNS, StateWithTangent, Tangent};
pub use gho::RollGho;
pub use mechanics::{Model, RollRates, RollState, Spin, specific_force};
pub use observability::{CannotFollow, Inputs, RollObservability, SufficientCondition, observability};
pub use observer::{
    BodyKnowledge, Coverage, Noise, ObserveError, PalmKnowledge, RollEstimate, RollHypothesis, RollQuestion,
    RollVerdict,
};
pub use palm::{Harmonic, PalmAcceleration, Pieces, PiecesError};
pub use run::{OnPalm, Roll, RollEnd, RollEndReason, RollError, RollRun, RollSample};
pub use shape::{Custom, Egg, Ellipsoid, Local, RoundedShape, Shape, SupportFunction};
pub use symmetry::{Symmetry, SymmetryName};
pub use tracker::{Report, RollTracker, Tracked};

#[cfg(test)]
mod tests;
#[cfg(test)]
mod theorems;
