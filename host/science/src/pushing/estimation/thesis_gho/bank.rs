//! The thesis's observers side by side: one for each edge that may be in contact (thesis §6.1).
//!
//! Implements: the parallel hypotheses of thesis §6.1. Which observer is right shows in how well its contact follows
//! the felt one once the start is forgotten: the second half of the data.
//! Frames: world. Units: SI. Errors: none; an observer that diverges has no cost.

use super::{Gho, GhoSettings, without_turns};
use crate::math::statistics::chi_square_quantile;
use crate::pushing::dynamics::{ContactMode, State};
use crate::pushing::estimation::hypotheses::{Estimate, Fit, Hypothesis, Observer, pose};
use crate::pushing::estimation::observation::{Known, Measured, Observation};
use crate::search::{Halt, Searched, Stop, never};

/// Probability with which data of the model pass the test of fit, as with the other observers.
const FIT_PROBABILITY: f64 = 0.999;

/// An observer at each edge and contact that may be, all from the same estimate.
#[derive(Clone, Copy, Debug)]
pub struct GhoBank<'k> {
    /// What is known of the push.
    pub known: &'k Known<'k>,
    /// Edges of the part and how they may be touched.
    pub contacts: &'k [(usize, ContactMode)],
    /// The estimate that every observer begins with.
    pub start: State,
    /// How the observers correct themselves.
    pub settings: GhoSettings,
}

/// What came of one observer.
#[derive(Clone, Debug, PartialEq)]
pub struct GhoRun {
    /// The edge it took to be in contact.
    pub edge: usize,
    /// The contact mode that it took.
    pub contact: ContactMode,
    /// Its estimates at 0, `dt`, …; fewer than there are angles where it diverged.
    pub trace: Vec<State>,
    /// Squared deviations from the felt angles in the second half of the data, in standard deviations; none where it
    /// diverged.
    pub cost: Option<f64>,
}

impl GhoBank<'_> {
    /// Runs every observer; the best comes first. None runs where no contact angles were felt.
    ///
    /// # Panics
    /// If an edge of `contacts` is none of the part's.
    #[must_use]
    pub fn runs(&self, observation: &Observation) -> Vec<GhoRun> {
        self.runs_until(observation, &never).found
    }

    /// The same, ended when `stop` says so: then with the observers that had run to their end by then.
    ///
    /// # Panics
    /// If an edge of `contacts` is none of the part's.
    #[must_use]
    pub fn runs_until(&self, observation: &Observation, stop: Stop<'_>) -> Searched<Vec<GhoRun>> {
        let halt = Halt::new(stop);
        let runs = self.halting_runs(observation, &halt);
        halt.searched(runs)
    }

    fn halting_runs(&self, observation: &Observation, halt: &Halt) -> Vec<GhoRun> {
        let Measured::ContactAngle(measured) = &observation.measured else { return Vec::new() };
        let run = |&(edge, contact): &(usize, ContactMode)| {
            let line = self.known.part.edge(edge).expect("contacts are on edges of the part");
            let gho = Gho { model: self.known.model(line), contact, settings: self.settings };
            let trace = gho.halting_trace(self.start, &measured.values, observation.dt, halt)?;
            let cost = cost(&trace, &measured.values, measured.sigma);
            Some(GhoRun { edge, contact, trace, cost })
        };
        let mut runs: Vec<_> = self.contacts.iter().map_while(run).collect();
        let order = |run: &GhoRun| run.cost.unwrap_or(f64::INFINITY);
        runs.sort_by(|a, b| order(a).total_cmp(&order(b)));
        runs
    }

    /// A run as an explanation of the data; none where the observer diverged.
    #[must_use]
    pub fn hypothesis(&self, run: &GhoRun, dt: f64) -> Option<Hypothesis> {
        let (start, end, cost) = (*run.trace.first()?, *run.trace.last()?, run.cost?);
        let model = self.known.model(self.known.part.edge(run.edge).ok()?);
        let time_end = dt * (run.trace.len() - 1) as f64;
        Some(Hypothesis {
            edge: self.known.part.edge_at(run.edge, end.s),
            side: self.known.part.side(run.edge),
            start,
            contact_start: run.contact,
            end,
            contact_end: run.contact,
            law: self.known.touch.law(run.contact),
            pose_start: pose(&model, start.u, 0.0, &start),
            pose_end: pose(&model, start.u, time_end, &end),
            velocity_end: model.velocity(&run.contact, time_end, &end),
            covariance: None,
            state_covariance: None,
            mu_g: self.known.mu_g,
            mu_g_log_sd: None,
            from_force: None,
            cost,
            probability: 1.0,
        })
    }
}

impl Observer for GhoBank<'_> {
    type Observation = Observation;

    /// Every observer that did not diverge, the best first. The thesis gives no uncertainty, hence no covariance;
    /// probabilities are equal shares, because the cost of a run that was pulled along by the data is no likelihood.
    fn estimate_until(&self, observation: &Observation, stop: Stop<'_>) -> Searched<Estimate> {
        let halt = Halt::new(stop);
        let runs = self.halting_runs(observation, &halt);
        let mut hypotheses: Vec<_> = runs.iter().filter_map(|run| self.hypothesis(run, observation.dt)).collect();
        let share = 1.0 / hypotheses.len().max(1) as f64;
        hypotheses.iter_mut().for_each(|hypothesis| hypothesis.probability = share);
        let values = observation.len();
        let degrees_of_freedom = values - values / 2;
        let fit = Fit {
            cost: hypotheses.first().map(|best| best.cost),
            degrees_of_freedom,
            cost_max: chi_square_quantile(FIT_PROBABILITY, degrees_of_freedom),
        };
        let time_end = observation.dt * values.saturating_sub(1) as f64;
        halt.searched(Estimate { hypotheses, ..Estimate::unexplained(fit, time_end) })
    }
}

fn cost(trace: &[State], measured: &[f64], sigma: f64) -> Option<f64> {
    let angles = without_turns(measured, trace.first()?.u);
    if trace.len() < angles.len() {
        return None;
    }
    let half = angles.len() / 2;
    let deviations = trace.iter().zip(&angles).skip(half).map(|(estimate, angle)| (estimate.u - angle) / sigma);
    Some(deviations.map(|deviation| deviation * deviation).sum::<f64>()).filter(|cost| cost.is_finite())
}
