//! Whether another pose could have been felt the same over a push with a turn: a search that shares nothing with estimator and
//! planner but the dynamics.
//!
//! From places all along each edge the part is pushed as the truth was, at fixed steps; the best places of each edge are improved
//! by Gauss–Newton with the derivatives of [`Seeded`]. A place that misses the first angles by far is given up.

use nalgebra::{Matrix3, Vector3};
use palpate::math::Jet;
use palpate::pushing::dynamics::{Contact, Parameter, PushModel, Scalar, Seeded, State};
use palpate::pushing::estimation::planning::{AMBIGUOUS_BELOW, Motion, ONE_PLACE_M};

use super::{Case, DT_S, FeltPush, Leg, OMEGA_SIGMA, SIGMA_RAD, legs};

/// Distance of places tried, m.
const GRID_M: f64 = 1e-3;

/// Steps between values.
const STEPS: usize = 2;

/// Iterations of the improvement; after some of them it must have come so near.
const ITERATIONS: usize = 20;
/// See [`ITERATIONS`].
const HOPELESS: (usize, f64) = (6, 1e4);

/// A step that lowers the cost by less ends the improvement.
const COST_STEP: f64 = 1e-3;

/// Standard deviation that keeps a rival's path on its edge, and how far beyond it may be; m.
const EDGE_SIGMA_M: f64 = 1e-5;
/// See [`EDGE_SIGMA_M`].
const BEYOND_M: f64 = 5e-5;

/// Places of an edge, of those that are better than their neighbours, that are improved.
const TRIED: usize = 5;

/// A push and one of the edges that may have been touched.
struct Search<'c> {
    case: &'c Case,
    felt: &'c FeltPush,
    /// The dynamics of each leg, and its values.
    legs: Vec<(PushModel<'c>, usize)>,
    edge: usize,
}

/// Whether a pose other than the truth has a cost below [`AMBIGUOUS_BELOW`] on exact angles.
pub(super) fn is_ambiguous(case: &Case, then: &Motion, felt: &FeltPush) -> bool {
    let edges = case.part.polygon().vertices().len();
    let legs = legs(then);
    (0..edges).any(|edge| {
        let modelled = |leg: &Leg| Some((case.model(edge, leg.finger)?, leg.values));
        let legs: Option<Vec<_>> = legs.iter().map(modelled).collect();
        legs.is_some_and(|legs| Search { case, felt, legs, edge }.has_rival())
    })
}

/// The states at the values' times.
fn states<'m, 'p: 'm, T: Scalar + 'm>(
    legs: impl Iterator<Item = (&'m PushModel<'p, T>, usize)>,
    start: &State<T>,
) -> Vec<State<T>> {
    let step = DT_S / STEPS as f64;
    let mut states = vec![*start];
    for (model, values) in legs {
        let from = states[states.len() - 1];
        states.extend(model.rollout(&Contact::Rolling, &from, step).skip(STEPS - 1).step_by(STEPS).take(values));
    }
    states
}

impl Search<'_> {
    fn has_rival(&self) -> bool {
        let costs: Vec<_> = self.places().into_iter().map(|start| (self.plain_cost(&start), start)).collect();
        let at = |place: usize| costs.get(place).map_or(f64::INFINITY, |found| found.0);
        let lowest = |place: &usize| at(*place) <= at(place.wrapping_sub(1)) && at(*place) <= at(place + 1);
        let mut best: Vec<_> = (0..costs.len()).filter(lowest).map(|place| costs[place]).collect();
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        best.into_iter().take(TRIED).any(|(_, start)| self.leads_to_rival(start))
    }

    fn places(&self) -> Vec<State> {
        let edge = &self.legs[0].0.edge;
        let length = edge.s_max - edge.s_min;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few dozen")]
        let steps = (length / GRID_M).ceil() as u32;
        let place = |i: u32| edge.s_min + length * f64::from(i) / f64::from(steps);
        (0..=steps).map(|i| State { s: place(i), ..self.case.start }).collect()
    }

    fn plain_cost(&self, start: &State) -> f64 {
        let states = states(self.legs.iter().map(|(model, values)| (model, *values)), start);
        states.iter().zip(&self.felt.angles).map(|(state, angle)| ((state.u - angle) / SIGMA_RAD).powi(2)).sum()
    }

    fn leads_to_rival(&self, mut start: State) -> bool {
        let mut damping = 1e-3;
        let mut now = self.normal_equations(&start);
        for iteration in 0..ITERATIONS {
            if iteration >= HOPELESS.0 && now.total > HOPELESS.1 {
                return false;
            }
            let mut matrix = now.curvature;
            for i in 0..3 {
                matrix[(i, i)] = matrix[(i, i)] * (1.0 + damping) + 1e-9;
            }
            let Some(step) = matrix.cholesky().map(|matrix| matrix.solve(&now.gradient)) else { return false };
            let next =
                State { u: start.u - step[0], s: start.s - step[1], omega: start.omega - step[2], v_t: start.v_t };
            let there = self.normal_equations(&next);
            if there.total < now.total {
                let gained = now.total - there.total;
                (start, now, damping) = (next, there, damping * 0.2);
                if gained < COST_STEP || self.is_rival(&now) {
                    break;
                }
            } else {
                damping = (damping * 10.0).max(1e-6);
            }
        }
        self.is_rival(&now)
    }

    fn is_rival(&self, found: &Normal) -> bool {
        let is_truth = self.edge == self.case.edge && (found.s_end - self.felt.s_end).abs() < ONE_PLACE_M;
        !is_truth && found.possible && found.cost < AMBIGUOUS_BELOW
    }

    fn normal_equations(&self, start: &State) -> Normal {
        let parameters = [Parameter::U, Parameter::S, Parameter::Omega];
        let seeded: Vec<_> = self
            .legs
            .iter()
            .map(|(model, values)| (Seeded::new(model, &Contact::Rolling, start, parameters), *values))
            .collect();
        let mut normal = Normal::new(start);
        let states = states(seeded.iter().map(|(leg, values)| (&leg.model, *values)), &seeded[0].0.start);
        for (value, state) in states.into_iter().take(self.felt.angles.len()).enumerate() {
            normal.add(angle_residual(state.u, self.felt.angles[value]), true);
            self.keep_on_edge(&mut normal, state.s);
            normal.s_end = state.s.value;
            normal.possible &= self.pushes(value, &state);
        }
        normal.add(Jet { value: start.omega / OMEGA_SIGMA, slopes: [0.0, 0.0, 1.0 / OMEGA_SIGMA] }, true);
        normal
    }

    fn keep_on_edge(&self, normal: &mut Normal, s: Jet<3>) {
        let edge = &self.legs[0].0.edge;
        let beyond = (s.value - edge.s_max).max(0.0) - (edge.s_min - s.value).max(0.0);
        if beyond != 0.0 {
            let slopes = s.slopes.map(|slope| slope / EDGE_SIGMA_M);
            normal.add(Jet { value: beyond / EDGE_SIGMA_M, slopes }, false);
        }
        normal.possible &= beyond.abs() < BEYOND_M;
    }

    /// Whether the part still is pushed at a value.
    fn pushes(&self, value: usize, state: &State<Jet<3>>) -> bool {
        let mut since = 0;
        let leg = self.legs.iter().find(|(_, values)| {
            let here = value < since + values;
            since += if here { 0 } else { *values };
            here
        });
        // The last value ends the last leg.
        let Some((model, _)) = leg else { return true };
        let time = (value - since) as f64 * DT_S;
        let State { u, s, omega, v_t } = *state;
        let state = State { u: u.value, s: s.value, omega: omega.value, v_t: v_t.value };
        model.motion(&Contact::Rolling, time, &state).normal_force > 0.0
    }
}

fn angle_residual(predicted: Jet<3>, felt: f64) -> Jet<3> {
    Jet { value: (predicted.value - felt) / SIGMA_RAD, slopes: predicted.slopes.map(|slope| slope / SIGMA_RAD) }
}

/// A cost and what a step needs.
struct Normal {
    /// Without what keeps the path on its edge, and with it.
    cost: f64,
    total: f64,
    gradient: Vector3<f64>,
    curvature: Matrix3<f64>,
    s_end: f64,
    possible: bool,
}

impl Normal {
    fn new(start: &State) -> Self {
        let (gradient, curvature) = (Vector3::zeros(), Matrix3::zeros());
        Self { cost: 0.0, total: 0.0, gradient, curvature, s_end: start.s, possible: true }
    }

    fn add(&mut self, residual: Jet<3>, counts: bool) {
        let slopes = Vector3::from(residual.slopes);
        let square = residual.value * residual.value;
        self.cost += if counts { square } else { 0.0 };
        self.total += square;
        self.gradient += slopes * residual.value;
        self.curvature += slopes * slopes.transpose();
    }
}
