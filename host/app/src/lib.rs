//! The tool `palpate`: commands, pictures and the thesis's tables over the libraries.
//!
//! In reading order: `cli` (one file a command), [`live`] (samples from a session, the person at the bench), [`pictures`],
//! [`push_scenario`] (a push as the command line says it), [`thesis`] (its experiments, run again), [`advice`] (what to do
//! about an error), `messages` (what standard error is told), `progress` (what a person sees while nothing is printed yet), `recording` (a run
//! kept, and played), `report` (one on a page), `screen` (a finger watched full screen), `web` (the same in a browser), `width` (prose on
//! terminals).

#![forbid(unsafe_code)]

pub mod advice;
mod cli;
pub mod live;
mod messages;
pub mod pictures;
mod progress;
pub mod push_scenario;
mod recording;
mod report;
mod screen;
pub mod thesis;
mod threads;
#[cfg(feature = "web")]
mod web;
mod width;

pub use cli::run;
