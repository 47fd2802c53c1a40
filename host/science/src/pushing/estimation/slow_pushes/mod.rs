//! Where a part lies after slow pushes, from the finger's way and the force that it feels.
//!
//! Nothing of inertia is in a slow push, and friction is not what it was a millimetre ago; so a cloud of poses is moved
//! by the quasi-static model with numbers of friction drawn for each, and weighed by what is exact (where the finger
//! was when it began to touch) and, with caution, by what is not (the force). One push holds little; a chain of them
//! holds a few millimetres.
//!
//! In reading order: `constants`, all numbers and where they come from; `felt`, what a push tells; `scene`, part and
//! model; `filter`, the estimator; `cloud` and `region`, what it states; `learning`, constants from pushes;
//! `tip_gaps`, the finger's place without a model of pushing.
//!
//! Frames: world; poses are of the centre of mass. Units: SI.

mod cloud;
mod constants;
mod felt;
mod filter;
mod learning;
mod region;
mod scene;
#[cfg(test)]
mod tests;
mod tip_gaps;

pub use cloud::{Cloud, Heap, Kernel};
pub use constants::{BLOCK_EDGE_FRICTIONS, FilterSettings, SlowConstants, Spread};
pub use felt::{FeltForce, FeltPush, Onset};
pub use filter::{AfterPush, Before, ParameterBelief, SlowFilter};
pub use learning::{KnownLog, KnownPush, calibrated, edge_frictions, learned};
pub use region::{CELL, Cells, Region};
pub use scene::{PushParameters, SimulatedPush, SlowScene, Standing};
pub use tip_gaps::{TipFromGaps, TipGapsError, tip_from_gaps};
