//! Rigs and oracles for the end-to-end tests in `tests/e2e`.

pub mod force_logs;
pub mod fuzz;
pub mod inscription_oracle;
pub mod newer;
pub mod oracle;
pub mod project;
pub mod push_oracle;
pub mod rig;
