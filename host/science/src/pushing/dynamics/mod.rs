//! Parts that slide on a plane while a finger pushes them. Pure: no files, clocks or threads.
//!
//! In reading order:
//! - [`support`]: what the plane does to a sliding part;
//! - `body`: a mass and what it rests on; `model`: part, edge, finger and contact, as plain data; `scalar`: the
//!   numbers they are written for, plain or with derivatives;
//! - `resting`: how a rigid part shares its weight among what it stands on;
//! - `contact_model`: what a push in time asks of a model; `disk_on_edge`: accelerations and contact force of a disk on
//!   an edge; `curve` and `shaped`: of any two outlines; `rest`: how a part at rest begins to move;
//! - `contact_mode`: whether a contact sticks, slides, breaks or jams, for all who follow a push; `mode_change`: when,
//!   and what that does to derivatives;
//! - `integrate`: steps in time, fixed and error-controlled; `extrapolation`: smooth motions in a few large ones;
//!   `rollout`: fixed steps, state after state;
//! - `sensitivity`: derivatives of a push by its start and its parameters; `switching`: these across changes of
//!   contact;
//! - `push`: a push from its start; `run`: a push in time, with what ends it.

mod body;
pub(crate) mod contact_mode;
mod contact_model;
mod curve;
mod disk_on_edge;
mod extrapolation;
mod integrate;
pub(crate) mod mode_change;
mod model;
mod push;
mod rest;
pub mod resting;
mod rollout;
mod run;
mod scalar;
mod sensitivity;
mod shaped;
pub mod support;
mod switching;
#[cfg(test)]
mod tests;

pub use body::{Body, FOOT_AT_REST, Mass};
pub use contact_mode::ContactForce;
pub use contact_model::ContactModel;
pub use curve::{FingerShape, PartSide};
pub use disk_on_edge::Motion;
pub use extrapolation::{Extrapolation, Passed};
pub(in crate::pushing) use integrate::{LinearisedMotion, stiff_step};
pub use model::{ContactMode, Edge, Finger, FingerPath, ModelError, Part, PushModel, Slip, State};
pub use push::{ContactLaw, EdgeEnd, FingerTrack, Push, PushError, PushOf, ShapedPush, Start};
pub use rest::{RestError, RestStart};
pub use run::{Acceleration, Change, End, EndReason, PushRun, PushRunError, Sample, SecondContact};
pub use scalar::Scalar;
pub use sensitivity::{Parameter, Seeded, derivatives};
pub use shaped::{ShapeError, ShapedModel, Turning};
pub use switching::DerivedRun;
