//! Pose and motion of a pushed part from what the finger feels. Pure: no files, clocks or threads.
//!
//! - [`Known`], [`Observation`]: what is known and what was felt; [`estimate`]: what that says; [`Estimate`].

pub mod from_rest;
mod observation;

pub use observation::{Channel, Estimate, Fit, Hypothesis, Known, Measured, Observation, Prior, Touch};

/// Every pose and motion that explains an observation.
#[must_use]
pub fn estimate(_known: &Known, observation: &Observation) -> Estimate {
    let fit = Fit { cost: None, degrees_of_freedom: observation.len(), cost_max: 0.0 };
    Estimate { hypotheses: Vec::new(), fit }
}
