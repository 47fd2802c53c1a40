//! Mathematics that knows nothing of fingers and parts.

pub mod ode;
