//! `palpate solve`: JSON Lines in, JSON Lines out.
//!
//! The machine-readable front door to every computation. This module is its frame; a kind of problem is a type that
//! implements [`Problem`] and one entry in [`KINDS`]. For users the interface is described in `docs/SOLVE.md`.
//!
//! In reading order:
//! - [`problem`](Problem): what a kind is, and the list of kinds;
//! - [`fields`]: types of fields that kinds share, [`read()`] and [`tagged`] to read them with the place of every
//!   error;
//! - [`kinds`]: the kinds of problem;
//! - `line`: one line to `id`, kind and fields, strictly JSON, divided as `text`; `answer`: one problem in, one answer out:
//!   [`Registry::solve`];
//! - `pipeline` (threads and streams, which nothing else has): lines solved side by side and answered in order by
//!   [`run`];
//! - `error`: the codes, messages and places; `finite`: no NaN leaves; `panics`: a crash ends one line; [`schema`];
//!   `spelling`: "did you mean".
//!
//! Units: SI and radians. Errors: [`RunError`] where input or output fails; everything else is an answer.

mod answer;
mod error;
pub mod fields;
mod finite;
pub mod kinds;
mod line;
mod panics;
mod pipeline;
mod problem;
mod read;
pub mod schema;
mod spelling;
#[cfg(test)]
mod testing;
mod text;

pub use error::{ErrorCode, ErrorLine, Failure, InvalidInput, Pointer, SolveError};
pub use pipeline::{RunError, Summary, run};
pub use problem::{KINDS, Kind, KindSchema, Problem, Registry};
pub use read::{Fields, Variant, read, tagged};
