//! Discriminating sets: the fewest elements that tell the sets of a collection apart (thesis §3.2–3.5).
//!
//! The problem is NP-complete, so no method is good for all of it; together these prove the fewest for scenes of the
//! thesis's size within seconds.
//!
//! In reading order:
//! - `system`: sets and elements; the columns that matter of them;
//! - `greedy`, `local`: good choices; `partition` with `splits` and `packing`, `branch` with `simplex` and `cuts`:
//!   bounds, and better choices;
//! - `solve`: all of these in turn, components apart; `tree`: asking one element after the other.
//!
//! Errors: none. Sets that no element tells apart stay together.

mod branch;
mod cuts;
mod greedy;
mod local;
mod packing;
mod partition;
mod simplex;
mod solve;
mod splits;
mod system;
#[cfg(test)]
mod tests;
mod tree;

pub(super) use partition::log2_ceil;
pub(super) use solve::halting_fewest;
pub use solve::{Choice, Effort, Proof, Search, fewest};
pub use system::SetSystem;
pub use tree::{Question, questions};
