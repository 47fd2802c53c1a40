//! A cover of every edge: how well each place on it can explain the data, whatever the other unknowns.
//!
//! Where the contact angles are known, a descent finds all unknowns but the place from afar: the angle at t = 0 is
//! measured, the rates follow from it within the time in which friction forgets speed, and a prior holds what is left.
//! What remains is a function of one variable an edge, the least cost by the place. It is looked at in cells that lie
//! side by side and overlap, each with value, slope and curvature; a descent of all unknowns begins in every cell in
//! which it may come near the least of all.
//!
//! Units: SI; costs of no dimension. Errors: none; a place from which nothing moves explains nothing.

use nalgebra::Vector5;

use super::fit::{CURVATURE_MIN, Candidate, Descent, Fitting};
use super::initial_state::{PLACE, UNKNOWNS};
use crate::math::least_squares::{LeastSquaresProblem as _, NormalEquations};

/// Steps by which the other unknowns come to where they explain most: they begin near.
const STEPS_MAX: usize = 4;

/// Another step is taken where it is predicted to bring more than this share of the cost, and more than
/// [`WORTH_A_STEP`].
const WORTH_A_STEP_SHARE: f64 = 0.7;
/// What a step must be predicted to lower the cost by.
const WORTH_A_STEP: f64 = 4.0;

/// What a place on an edge can explain, near it to second order.
#[derive(Clone, Debug)]
pub(super) struct Cell {
    /// With the other unknowns where they explain most there.
    pub(super) at: Candidate,
    /// Cost and penalty there.
    pub(super) total: f64,
    /// Half the slope of the least cost by the place, 1/m.
    slope: f64,
    /// Half its curvature, 1/m².
    curvature: f64,
    /// By how much the unknowns change with the place where they explain most, per m.
    response: Vector5<f64>,
    /// How far the cell reaches on either side, m.
    reach: [f64; 2],
}

impl Cell {
    /// Around a place with neighbours, from a first guess of the other unknowns; none where nothing moves. `held` is the
    /// fitting with the place held.
    pub(super) fn around(fitting: &Fitting, held: &Fitting, guess: Candidate, reach: [f64; 2]) -> Option<Self> {
        let mut descent = held.descend(guess)?;
        for _ in 0..STEPS_MAX {
            let worth = (WORTH_A_STEP_SHARE * descent.evaluation.total()).max(WORTH_A_STEP);
            if descent.predicted_reduction < worth || !held.improve(&mut descent) {
                break;
            }
        }
        Self::at(fitting, held, &descent, reach)
    }

    fn at(fitting: &Fitting, held: &Fitting, descent: &Descent, reach: [f64; 2]) -> Option<Self> {
        let evaluation = &descent.evaluation;
        let equations = fitting.normal_equations(evaluation);
        let NormalEquations { cost, gradient, curvature } = equations;
        // Of the other unknowns alone.
        let (mut others, mut gradient_others, mut mixed) = (curvature, gradient, curvature.column(PLACE).into_owned());
        let is_held = held.held(evaluation, &equations);
        for i in 0..UNKNOWNS {
            if is_held[i] {
                others.row_mut(i).fill(0.0);
                others.column_mut(i).fill(0.0);
                (gradient_others[i], mixed[i]) = (0.0, 0.0);
            }
            others[(i, i)] += CURVATURE_MIN[i];
        }
        // At the best of their parabola what is left is a parabola in the place (Schur's complement).
        let inverse = others.cholesky()?.inverse();
        let response = -(inverse * mixed);
        let step = -(inverse * gradient_others);
        let mut candidate = evaluation.candidate;
        for (unknown, step) in candidate.unknowns.iter_mut().zip(step.iter()) {
            *unknown += step;
        }
        Some(Self {
            at: candidate,
            total: cost + gradient_others.dot(&step),
            slope: gradient[PLACE] + mixed.dot(&step),
            curvature: (curvature[(PLACE, PLACE)] + mixed.dot(&response)).max(0.0),
            response,
            reach,
        })
    }

    /// Where in the cell the parabola is lowest, from its place, m.
    fn lowest(&self) -> f64 {
        let [below, above] = self.reach;
        if self.curvature > 0.0 {
            (-self.slope / self.curvature).clamp(-below, above)
        } else if self.slope > 0.0 {
            -below
        } else {
            above
        }
    }

    /// The least that the parabola comes to in the cell.
    pub(super) fn least(&self) -> f64 {
        let off = self.lowest();
        self.total + off * (2.0 * self.slope + off * self.curvature)
    }

    /// What to begin a descent with.
    pub(super) fn candidate(&self) -> Candidate {
        let off = self.lowest();
        let mut candidate = self.at;
        for (i, unknown) in candidate.unknowns.iter_mut().enumerate() {
            *unknown += if i == PLACE { off } else { self.response[i] * off };
        }
        candidate
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::FRAC_PI_2;

    use nalgebra::{Point2, Vector2};

    use super::super::contact_intervals::contact_intervals;
    use super::super::data::Data;
    use super::super::fit::Given;
    use super::super::initial_state::StartMode;
    use super::super::select::fineness;
    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Part, Push, PushModel, Start, State};
    use crate::pushing::estimation::{Channel, Known, Measured, Observation, Prior, Touch};
    use crate::search::{Effort, Halt, never};

    #[test]
    fn a_cell_has_slope_and_curvature_of_the_least_cost_by_the_place() {
        let block = [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from);
        let part = Part::uniform(SimplePolygon::new(block).unwrap());
        let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::new(0.01, 0.02));
        let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
        let rolling = (Touch::Rolling { friction: None }, ContactLaw::Rolling { friction: None });
        for (touch, law) in [rolling, (Touch::Frictionless, ContactLaw::Frictionless)] {
            let known = Known { part: &part, mu_g: 3.0, finger, touch };
            let start = Start::Moving(State { u: FRAC_PI_2, s: 0.012, omega: 0.4, v_t: 0.002 });
            let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 3.0, finger };
            let push = Push::new(model, law, start, EdgeEnd::Stop).unwrap();
            let times: Vec<_> = (0..8).map(|value| 0.05 * f64::from(value)).collect();
            let values = push.run(&times).unwrap().samples.iter().map(|sample| sample.state.u).collect();
            let prior = Prior { omega0_sigma: Some(0.5), v_t0_sigma: Some(0.004), mu_g_log_sigma: Some(0.2) };
            let observation =
                Observation { dt: 0.05, measured: Measured::ContactAngle(Channel { values, sigma: 2e-3 }), prior };
            let halt = Halt::new(&never);
            let effort = Effort::new(&halt);
            let given = Given { known: &known, data: Data::new(&observation), prior };
            let fitting = Fitting::new(given, fineness(2e-3, 1.0), 1e-4, &effort);
            let held = fitting.holding_the_place();
            let interval = contact_intervals(&part, finger.radius, &Halt::new(&never))[0];
            let start_mode = StartMode::all(&known)[0];
            // The least cost at a place, by many steps.
            let least = |s: f64| {
                let guess = Candidate { interval, start_mode, unknowns: [FRAC_PI_2, s, 0.4, 0.0, 0.0], past: None };
                let mut descent = held.descend(guess).unwrap();
                while held.improve(&mut descent) && descent.predicted_reduction > 1e-12 {}
                descent
            };
            // Near the truth, where residuals are small.
            let (s, step) = (0.0121, 2e-5);
            let cell = Cell::at(&fitting, &held, &least(s), [step, step]).unwrap();
            let [before, at, after] = [s - step, s, s + step].map(|s| least(s).evaluation.total());
            let (slope, curvature) =
                ((after - before) / (4.0 * step), (after - 2.0 * at + before) / (2.0 * step * step));
            assert!((cell.total - at).abs() < 1e-6 * at, "{touch:?}: {} {at}", cell.total);
            assert!((cell.slope - slope).abs() < 1e-3 * slope.abs(), "{touch:?}: {} {slope}", cell.slope);
            // After Gauss, residuals times their second derivatives are left out.
            assert!((cell.curvature - curvature).abs() < 0.1 * curvature, "{touch:?}: {} {curvature}", cell.curvature);
            // The other unknowns follow the place as the cell says.
            let moved =
                least(s + step).evaluation.candidate.unknowns[2] - least(s - step).evaluation.candidate.unknowns[2];
            let response = moved / (2.0 * step);
            assert!((cell.response[2] - response).abs() < 0.1 * response.abs(), "{} {response}", cell.response[2]);
        }
    }
}
