//! `palpate solve` on the kinds that ask what contacts say: the shared cases, the documented lines, and what is refused.

#![allow(clippy::unwrap_used, reason = "clippy exempts tests, but not their helpers")]

mod gho;
mod initial_pose;
mod observability;
mod solving;
