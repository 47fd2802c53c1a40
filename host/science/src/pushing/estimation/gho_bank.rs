//! The thesis's observers side by side: one for each edge that may be in contact (thesis §6.1).
//!
//! Implements: the parallel hypotheses of thesis §6.1. Which observer is right shows in how well its contact follows the felt one
//! once the start is forgotten: the second half of the data.
//! Frames: world. Units: SI. Errors: none; an observer that diverges has no cost.

use nalgebra::Vector2;

use super::gho::{Gho, GhoSettings};
use super::observation::{Hypothesis, Known, pose};
use crate::pushing::dynamics::{Contact, State};

/// Contact angles that a finger felt.
#[derive(Clone, Copy, Debug)]
pub struct Felt<'a> {
    /// At 0, `dt`, 2 `dt`, …, rad.
    pub angles: &'a [f64],
    /// Standard deviation of one, rad.
    pub sigma: f64,
    /// s.
    pub dt: f64,
}

/// What came of one observer.
#[derive(Clone, Debug, PartialEq)]
pub struct GhoRun {
    /// The edge it took to be in contact.
    pub edge: usize,
    /// And how.
    pub contact: Contact,
    /// Its estimates at 0, `dt`, …; fewer than there are angles where it diverged.
    pub trace: Vec<State>,
    /// Squared deviations from the felt angles in the second half of the data, in standard deviations; none where it diverged.
    pub cost: Option<f64>,
}

/// Runs an observer at each edge and contact of `sites` from the same estimate; the best comes first.
///
/// # Panics
/// If a site's edge is none of the part's.
#[must_use]
pub fn observe_gho(
    known: &Known,
    sites: &[(usize, Contact)],
    start: State,
    felt: &Felt,
    settings: GhoSettings,
) -> Vec<GhoRun> {
    let run = |&(edge, contact): &(usize, Contact)| {
        let seen = known.part.edge(edge).expect("sites are on edges of the part");
        let trace = Gho { model: known.model(seen), contact, settings }.trace(start, felt.angles, felt.dt);
        let cost = cost(&trace, felt);
        GhoRun { edge, contact, trace, cost }
    };
    let mut runs: Vec<_> = sites.iter().map(run).collect();
    let order = |run: &GhoRun| run.cost.unwrap_or(f64::INFINITY);
    runs.sort_by(|a, b| order(a).total_cmp(&order(b)));
    runs
}

fn cost(trace: &[State], felt: &Felt) -> Option<f64> {
    let angles = super::gho::without_turns(felt.angles, trace.first()?.u);
    if trace.len() < angles.len() {
        return None;
    }
    let half = angles.len() / 2;
    let deviations = trace.iter().zip(&angles).skip(half).map(|(estimate, angle)| (estimate.u - angle) / felt.sigma);
    Some(deviations.map(|deviation| deviation * deviation).sum::<f64>()).filter(|cost| cost.is_finite())
}

impl GhoRun {
    /// The run as an explanation of the data; none where the observer diverged.
    #[must_use]
    pub fn hypothesis(&self, known: &Known, felt: &Felt) -> Option<Hypothesis> {
        let (start, end, cost) = (*self.trace.first()?, *self.trace.last()?, self.cost?);
        let model = known.model(known.part.edge(self.edge).ok()?);
        let time_end = felt.dt * (self.trace.len() - 1) as f64;
        Some(Hypothesis {
            edge: self.edge,
            start,
            contact_start: self.contact,
            end,
            contact_end: self.contact,
            pose_end: pose(&model, start.u, time_end, &end),
            velocity_end: Vector2::from(model.velocity(&self.contact, time_end, &end)),
            covariance: None,
            state_covariance: None,
            grip: known.grip,
            grip_log_sd: None,
            cost,
            probability: 1.0,
        })
    }
}
