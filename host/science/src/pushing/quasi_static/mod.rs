//! A part that a finger pushes so slowly that nothing swings: friction alone decides.
//!
//! At every instant the part moves so that the friction of its support balances the finger's force at the contact; of
//! all motions that the finger leaves possible that is the one that costs least. The support's load follows the push,
//! for it acts above the plane.
//!
//! In reading order:
//! - `support`: what the part stands on, how that resists a motion, and how the load spreads; `pressure`: of a face whose
//!   pressure rises along one direction;
//! - `instant`: motion and force at one instant;
//! - `run`: [`SlowPush`], along the finger's path, with all that happens on the way.
//!
//! Implements: `docs/NOTATION.md`, quasi-static pushing; maximal dissipation and the limit surface after Goyal, Ruina
//! and Papadopoulos (1991), sticking and sliding after Lynch (1992).
//! Assumes: no inertia; Coulomb friction at support and contact; a rigid disk that does not turn.
//! Frames: world, unless named. Units: SI; forces are on the part and per mass.
//! Errors: [`SlowPushError`]. A part that tips, or a finger that meets it twice, ends the run: no errors.

pub(crate) mod coarse;
mod held;
mod instant;
mod pressure;
mod run;
mod support;
#[cfg(test)]
mod tests;

pub use crate::geometry::Element;
pub use run::{SlowChange, SlowContact, SlowEnd, SlowMode, SlowPush, SlowPushError, SlowRun, SlowSample};
pub use support::{Foot, Support};
