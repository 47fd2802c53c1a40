//! What people and programs keep and exchange, for programs without a terminal: descriptions of parts, bodies, scenes,
//! views and motions; calibrations; force logs; and the JSON Lines of `palpate solve`.
//!
//! - what people describe in TOML: [`part`], [`body`], [`motion`], [`palm`], [`views`], [`scene`];
//! - what switches tell as they change: [`bits`]; the beams that a part is carried past: [`passing`];
//! - what is kept: [`calibration`] (plan, raw samples, result), [`sampling_plan`];
//! - what others recorded: [`recordings`]; the container of our own recordings: [`mcap`];
//! - what programs exchange: [`solve`];
//! - [`lines`]: streams of lines that may go on for ever; [`output`]: how any of it reaches the disk.
//!
//! Units: SI once read. Errors name the key or line, the value and the limit.

#![forbid(unsafe_code)]

pub mod bits;
pub mod body;
pub mod calibration;
pub mod lines;
pub mod mcap;
pub mod motion;
pub mod output;
pub mod palm;
pub mod part;
pub mod passing;
pub mod recordings;
pub mod sampling_plan;
pub mod scene;
pub mod shapes;
pub mod solve;
pub mod touches;
pub mod views;

/// The examples of the crate's page are compiled and run.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
