//! Smooth convex bodies that roll on a palm: their motion, what the contact path tells, and how to read it.
//!
//! The palm feels where the body touches it: a path `u(t)`. From it alone this module finds the body's attitude and
//! angular velocity, modulo what symmetry hides; the thesis left that observer open.
//!
//! Implements: thesis chapter 7 without charts, with its errors put right (see [`mechanics`]).
//! Frames: body axes: origin at the centre of mass, principal axes of inertia; palm axes: e₃ up along the palm's
//! normal, the palm translates and does not turn. Orientations turn body axes into palm axes. Units: SI; forces,
//! energies and inertia over the body's mass, which drops out.

pub mod body;
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
    BodyKnowledge, Noise, ObserveError, PalmKnowledge, RollEstimate, RollHypothesis, RollQuestion, RollVerdict,
};
pub use palm::{Harmonic, PalmAcceleration, Pieces, PiecesError};
pub use run::{OnPalm, Roll, RollEnd, RollEndReason, RollError, RollRun, RollSample};
pub use shape::{Custom, Egg, Ellipsoid, Local, RoundedShape, Shape, SupportFunction};
pub use symmetry::{Symmetry, SymmetryName};
pub use tracker::{Report, RollTracker, Tracked};

#[cfg(test)]
mod tests;
