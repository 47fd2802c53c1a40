//! Parts that slide on a plane while a finger pushes them. Pure: no files, clocks or threads.
//!
//! In reading order:
//! - [`support`]: what the plane does to a sliding part;
//! - `model`: part, edge, finger and contact, as plain data; `scalar`: the numbers they are written for;
//! - `dynamics`: accelerations and contact force; `rest`: how a part at rest begins to move;
//! - `integrate`: steps in time, fixed and error-controlled; `rollout`: fixed steps, state after state;
//! - `sensitivity`: derivatives of a push by its start and its parameters;
//! - `push`: a push from its start; `run`: a push in time, with what ends it.

mod dynamics;
mod integrate;
mod model;
mod push;
mod rest;
mod rollout;
mod run;
mod scalar;
mod sensitivity;
pub mod support;
#[cfg(test)]
mod tests;

pub use dynamics::Motion;
pub use model::{Contact, Edge, FOOT_AT_REST, Finger, Mass, ModelError, Part, PushModel, Slip, State};
pub use push::{ContactLaw, EdgeEnd, Push, PushError, Start};
pub use rest::{RestError, RestStart};
pub use run::{Acceleration, Change, ContactForce, End, EndReason, Run, RunError, Sample};
pub use scalar::Scalar;
pub use sensitivity::{Parameter, Seeded, derivatives};
