//! The tool `palpate` as people and programs use it: the real binary, its answers, and the pages that explain it.
//!
//! A target of the tool's package, so that cargo builds the binary before any test begins.

#![allow(clippy::unwrap_used, reason = "clippy exempts tests, but not their helpers")]

#[cfg(all(unix, feature = "web"))]
mod browser;
mod carried;
mod chain;
mod contact;
#[cfg(unix)]
mod devices;
#[cfg(unix)]
mod exported;
#[cfg(feature = "flash")]
mod flash;
#[cfg(all(unix, feature = "foxglove"))]
mod foxglove;
mod friction;
mod gho;
mod help;
mod import;
mod initial_pose;
mod inscribe;
mod newer_firmware;
mod observability;
mod observe;
mod observe_curved;
mod observe_follow;
mod observe_path;
mod observe_slow;
mod pages;
mod part;
mod passing;
#[cfg(unix)]
mod progress;
mod push;
mod real;
mod recording;
mod robot;
mod sample;
#[cfg(unix)]
mod screen;
#[cfg(all(unix, feature = "web"))]
mod serve;
mod shaken_palm;
mod solve;
mod solving;
mod support_friction;
mod thesis_examples;
mod touch;
mod tutorial;
mod warnings;
mod width;
mod zero_drift;

/// The tool's binary.
const PALPATE: &str = env!("CARGO_BIN_EXE_palpate");
