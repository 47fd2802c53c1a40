//! Smooth convex bodies that roll on a palm: their motion, what the contact path tells, and how to read it.
//!
//! The palm feels where the body touches it: a path `u(t)`. From it alone this module finds the body's attitude and angular
//! velocity, modulo what symmetry hides; the thesis left that observer open.
//!
//! Implements: thesis chapter 7 without charts, with its errors put right (see [`mechanics`]).
//! Frames: body axes: origin at the centre of mass, principal axes of inertia; palm axes: e₃ up along the palm's normal, the
//! palm translates and does not turn. Orientations turn body axes into palm axes. Units: SI; forces, energies and inertia
//! over the body's mass, which drops out.

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

pub use body::{Body, BodyError};
pub use flow::{Columns, STATE_COLUMNS, Tangent};
pub use gho::Gho;
pub use mechanics::{Model, Rates, Spin, State, specific_force};
pub use observability::{CannotFollow, Inputs, Observability, SufficientCondition, observability};
pub use observer::{BodyKnowledge, Estimate, Hypothesis, Noise, ObserveError, PalmKnowledge, Question, Verdict};
pub use palm::{Harmonic, PalmAcceleration, Pieces, PiecesError};
pub use run::{End, EndReason, Roll, RollError, RollRun, Sample};
pub use shape::{Custom, Egg, Ellipsoid, Local, Rounded, Shape, SupportFunction};
pub use symmetry::{Symmetry, SymmetryName};
pub use tracker::{Report, Tracked, Tracker};

#[cfg(test)]
mod tests;
