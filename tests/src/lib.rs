//! Rigs and oracles for the end-to-end tests in `tests/e2e`.
//!
//! - [`oracle`], [`push_oracle`], [`beam_oracle`], [`inscription_oracle`], [`force_logs`]: slow, obvious code to check against;
//! - [`rig`]: devices, sessions and hostile lines; [`newer`]: what a newer peer would send;
//! - [`fuzz`], [`fuzz_files`]: what must hold for any bytes; [`project`]: files of the project.

#![forbid(unsafe_code)]

pub mod beam_oracle;
pub mod force_logs;
pub mod fuzz;
pub mod fuzz_files;
pub mod inscription_oracle;
pub mod newer;
pub mod oracle;
pub mod project;
pub mod push_oracle;
pub mod rig;
