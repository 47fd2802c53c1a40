//! Whether another pose could have been felt the same: a search that shares nothing with the estimator but the dynamics.
//!
//! From each edge and place on a fine grid the part is pushed as the truth was, at fixed steps; the best places of each edge are
//! improved by Gauss–Newton with the derivatives of [`Seeded`].

use nalgebra::{Const, SMatrix, SVector};

use super::world::{Case, Kind};
use crate::pushing::{Contact, Parameter, PushModel, Seeded, Slip, State};

/// Distance of places tried, m.
const GRID_M: f64 = 1e-3;

/// Steps between values.
const STEPS: usize = 2;

/// Iterations of the improvement.
const ITERATIONS: usize = 25;

/// Rivals are at least so far from the truth on its own edge, m.
const APART_M: f64 = 2e-3;

/// How far an end may lie beyond the edge, m.
const BEYOND_M: f64 = 1e-5;

/// Standard deviation that keeps a rival's path on the edge, m.
const EDGE_SIGMA_M: f64 = 1e-5;

/// Places of an edge, of those that are better than their neighbours, that are improved.
const TRIED: usize = 6;

/// The least cost of a pose that is not the truth, at the case's noise, on exact angles.
pub(super) fn nearest(case: &Case) -> f64 {
    let edges = case.part.polygon().vertices().len();
    let costs = (0..edges).flat_map(|edge| rivals_on(case, edge));
    costs.fold(f64::INFINITY, f64::min)
}

fn contacts(case: &Case) -> Vec<Contact> {
    match case.kind {
        Kind::Rolling => vec![Contact::Rolling],
        Kind::Frictionless => vec![Contact::Frictionless],
        Kind::Sliding => [Slip::Forward, Slip::Backward].map(|slip| Contact::Sliding { friction: 0.2, slip }).to_vec(),
        // What sticks soon rolls.
        Kind::Coulomb => vec![Contact::Rolling],
    }
}

fn rivals_on(case: &Case, edge: usize) -> Vec<f64> {
    let Some(model) = case.model(edge) else { return Vec::new() };
    let length = model.edge.s_max - model.edge.s_min;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few dozen")]
    let steps = (length / GRID_M).ceil() as u32;
    let mut costs = Vec::new();
    for contact in contacts(case) {
        let starts: Vec<_> = (0..=steps)
            .map(|i| State { s: model.edge.s_min + length * f64::from(i) / f64::from(steps), ..case.samples[0].state })
            .map(|start| (plain_cost(case, &model, &contact, &start), start))
            .collect();
        let lowest = |i: &usize| {
            let at = |j: usize| starts.get(j).map_or(f64::INFINITY, |start| start.0);
            starts[*i].0 <= at(i.wrapping_sub(1)) && starts[*i].0 <= at(i + 1)
        };
        let mut best: Vec<_> = (0..starts.len()).filter(lowest).map(|i| starts[i]).collect();
        best.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (_, start) in best.into_iter().take(TRIED) {
            costs.extend(improved(case, edge, &model, &contact, start));
        }
    }
    costs
}

fn step(case: &Case) -> f64 {
    #[expect(clippy::cast_precision_loss, reason = "2")]
    let steps = STEPS as f64;
    case.samples[1].t / steps
}

fn plain_cost(case: &Case, model: &PushModel, contact: &Contact, start: &State) -> f64 {
    let path = std::iter::once(*start).chain(model.rollout(contact, start, step(case))).step_by(STEPS);
    path.zip(&case.angles).map(|(state, angle)| (state.u - angle).powi(2)).sum()
}

fn improved(case: &Case, edge: usize, model: &PushModel, contact: &Contact, mut start: State) -> Option<f64> {
    let mut damping = 1e-3;
    let mut now = normal_equations(case, model, contact, &start);
    for _ in 0..ITERATIONS {
        let mut matrix = now.curvature;
        for i in 0..4 {
            matrix[(i, i)] *= 1.0 + damping;
            matrix[(i, i)] += 1e-9;
        }
        let step = -(matrix.try_inverse()? * now.gradient);
        let next = State {
            u: start.u + step[0],
            s: start.s + step[1],
            omega: start.omega + step[2],
            v_t: start.v_t + step[3],
        };
        let there = normal_equations(case, model, contact, &next);
        if there.total < now.total {
            let gained = now.total - there.total;
            (start, now, damping) = (next, there, damping * 0.2);
            if gained < 1e-6 {
                break;
            }
        } else {
            damping = (damping * 10.0).max(1e-6);
        }
    }
    let is_truth = edge == case.edge && (now.end.s - case.end().state.s).abs() < APART_M;
    (!is_truth && now.possible).then_some(now.cost)
}

struct Normal {
    cost: f64,
    total: f64,
    gradient: SVector<f64, 4>,
    curvature: SMatrix<f64, 4, 4>,
    end: State,
    possible: bool,
}

fn normal_equations(case: &Case, model: &PushModel, contact: &Contact, start: &State) -> Normal {
    let parameters = [Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT];
    let seeded = Seeded::new(model, contact, start, parameters);
    let path = std::iter::once(seeded.start).chain(seeded.model.rollout(&seeded.contact, &seeded.start, step(case)));
    let (mut cost, mut gradient, mut curvature) = (0.0, SVector::zeros(), SMatrix::zeros());
    let mut total = 0.0;
    let mut add = |residual: f64, slope: SVector<f64, 4>, counts: bool| {
        cost += if counts { residual * residual } else { 0.0 };
        total += residual * residual;
        gradient += slope * residual;
        curvature += slope * slope.transpose();
    };
    let (mut end, mut possible) = (*start, true);
    for (i, state) in path.step_by(STEPS).take(case.angles.len()).enumerate() {
        let sigma = case.sigma_used();
        let u = state.u.eps.unwrap_generic(Const, Const) / sigma;
        add((state.u.re - case.angles[i]) / sigma, u, true);
        let s = state.s.re;
        let beyond = (s - model.edge.s_max).max(0.0) - (model.edge.s_min - s).max(0.0);
        if beyond != 0.0 {
            add(beyond / EDGE_SIGMA_M, state.s.eps.unwrap_generic(Const, Const) / EDGE_SIGMA_M, false);
        }
        end = State { u: state.u.re, s, omega: state.omega.re, v_t: state.v_t.re };
        let pushes = model.motion(contact, case.samples[i].t, &end).normal_force > 0.0;
        possible &= beyond.abs() < 5.0 * BEYOND_M && pushes;
    }
    let prior = Case::prior();
    let sigmas = [prior.omega0_sigma, prior.v_t0_sigma.filter(|_| *contact != Contact::Rolling)];
    for (i, value) in [start.omega, start.v_t].into_iter().enumerate() {
        if let Some(sigma) = sigmas[i] {
            let mut slope = SVector::zeros();
            slope[i + 2] = 1.0 / sigma;
            add(value / sigma, slope, true);
        }
    }
    Normal { cost, total, gradient, curvature, end, possible }
}
