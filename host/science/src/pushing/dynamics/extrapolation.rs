//! Smooth motions to near rounding: a few large steps of high order, for a contact that stays as it is.
//!
//! A step is divided into 2, 4, 6, … parts by the explicit midpoint rule, whose error is a series in the square of a
//! part's length: each further division, extrapolated to parts of no length, gains two orders. Where no friction acts a
//! second of pushing takes one or two steps; [`super::run`] would take fifty, for it also looks for what ends the
//! contact.
//!
//! Implements: Gragg's method as Bulirsch and Stoer extrapolate it (Hairer, Nørsett, Wanner, *Solving Ordinary
//! Differential Equations I*, 2nd ed., II.9).
//! Assumes: no events: an edge goes on as a line, and the finger pulls where it would have to. Whether it has is for
//! the caller to see from the places passed. Friction under the part makes a start from rest too stiff for this.
//! Units: SI. Errors: none; a motion that takes too small steps has no end.

use super::contact_model::ContactModel;
use super::model::{ContactMode, State};

/// Divisions of a step tried before it is halved: order 16.
const DIVISIONS: usize = 8;

/// What the last extrapolation may change, as a share of 1 rad and of the radius of gyration: what is left is smaller
/// by far.
const CHANGE_MAX: f64 = 1e-11;

/// Halvings of the whole after which a motion is given up.
const HALVINGS_MAX: i32 = 12;

/// A place on the way, of the accuracy of the midpoint rule.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Passed {
    /// Of the contact on the part, as in [`State`].
    pub s: f64,
    /// Of the finger on the part, m/s².
    pub normal_force: f64,
}

/// A motion without events, by extrapolation to steps of no length.
#[derive(Clone, Copy, Debug)]
pub struct Extrapolation<'a, M> {
    /// Part, finger and support.
    pub model: &'a M,
    /// What the contact does throughout.
    pub contact: ContactMode,
}

/// How a step is made of smaller ones.
#[derive(Clone, Copy)]
struct Division {
    /// Of the whole step, s.
    length: f64,
    /// How many equal parts it has.
    parts: usize,
}

/// Components of a state, in the order of its fields.
type Components = [f64; 4];

impl<M: ContactModel> Extrapolation<'_, M> {
    /// The state at time `until` (s) of a part that is in `state` at `time`; places on the way are added to `passed`.
    ///
    /// Measured on 400 random frictionless pushes from rest over a second: u within 1e-11 of [`super::PushOf::run`].
    #[must_use]
    pub fn end(&self, time: f64, state: State, until: f64, passed: &mut Vec<Passed>) -> Option<State> {
        let (mut time, mut state) = (time, Components::from(state));
        let mut length = until - time;
        let length_min = length * 0.5_f64.powi(HALVINGS_MAX);
        while time < until {
            let step = length.min(until - time);
            match self.step(time, &state, step, passed) {
                Some(next) => {
                    state = next;
                    time = if step >= until - time { until } else { time + step };
                }
                None => length *= 0.5,
            }
            if length < length_min {
                return None;
            }
        }
        Some(state.into())
    }

    /// A step, if its extrapolations settle.
    fn step(&self, time: f64, state: &Components, length: f64, passed: &mut Vec<Passed>) -> Option<Components> {
        let (begin, mut places) = (self.rates(time, state), Vec::with_capacity(2 * DIVISIONS));
        // The tableau's last row: without extrapolation, extrapolated once, and so on.
        let mut row: Vec<Components> = Vec::with_capacity(DIVISIONS);
        for division in 0..DIVISIONS {
            places.clear();
            places.push(begin.1);
            let mut best =
                self.divided(time, state, &begin.0, Division { length, parts: 2 * (division + 1) }, &mut places);
            let mut change = [f64::INFINITY; 4];
            for (order, before) in row.iter_mut().enumerate() {
                let ratio = (division + 1) as f64 / (division - order) as f64;
                let better = std::array::from_fn(|i| best[i] + (best[i] - before[i]) / (ratio * ratio - 1.0));
                change = std::array::from_fn(|i| better[i] - best[i]);
                *before = best;
                best = better;
            }
            row.push(best);
            if division > 1 && self.is_small(&change, length) {
                passed.append(&mut places);
                return Some(best);
            }
        }
        None
    }

    /// The state after a step divided into some parts.
    fn divided(
        &self,
        time: f64,
        state: &Components,
        begin: &Components,
        Division { length, parts }: Division,
        places: &mut Vec<Passed>,
    ) -> Components {
        let part = length / parts as f64;
        let moved =
            |from: &Components, rates: &Components, late: f64| std::array::from_fn(|i| from[i] + late * rates[i]);
        let (mut before, mut here) = (*state, moved(state, begin, part));
        for index in 1..parts {
            let (rates, place) = self.rates(time + part * index as f64, &here);
            places.push(place);
            (before, here) = (here, moved(&before, &rates, 2.0 * part));
        }
        here
    }

    /// What is seen of a state in passing.
    #[must_use]
    pub fn place(&self, time: f64, state: &State) -> Passed {
        self.rates(time, &Components::from(*state)).1
    }

    fn rates(&self, time: f64, state: &Components) -> (Components, Passed) {
        let motion = self.model.motion(&self.contact, time, &(*state).into());
        (motion.rates.into(), Passed { s: state[1], normal_force: motion.normal_force })
    }

    fn is_small(&self, change: &Components, length: f64) -> bool {
        let radius = self.model.body().inertia_per_mass().sqrt();
        // A place in metres counts by the part's size, on a straight finger too.
        let scale = [radius.min(1.0), radius, 1.0 / length, radius / length];
        change.iter().zip(scale).all(|(change, scale)| change.abs() <= CHANGE_MAX * scale)
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use nalgebra::{Point2, Vector2};
    use proptest::prelude::*;

    use super::*;
    use crate::pushing::dynamics::{
        Body, ContactLaw, EdgeEnd, FingerPath, FingerShape, Mass, PartSide, ShapedModel, ShapedPush, Start,
    };

    /// What two simulations of so good error control differ by, rad and m.
    const SAME: f64 = 1e-10;

    proptest! {
        #[test]
        fn ends_where_small_steps_lead(
            part in [0.018..0.05, 0.018..0.05], finger in [0.01..0.03, 0.01..0.03], s in 0.0..PI, u in 1.3..2.0,
            sideways in -0.05..0.05, until in 0.2..1.0,
        ) {
            let body = Body::on_feet(&[], Mass::of_ellipse(part));
            let side = PartSide::Ellipse { semi_axes: part, middle: Vector2::zeros() };
            let acceleration = Vector2::new(sideways, 0.1);
            let path = FingerPath { centre0: Point2::origin(), velocity0: Vector2::zeros(), acceleration };
            let shape = FingerShape::Ellipse { semi_axes: finger };
            let model = ShapedModel::new(&body, side, 0.0, shape, path).unwrap();
            let push = ShapedPush::new(model, ContactLaw::Frictionless, Start::Rest { u, s }, EdgeEnd::Extend).unwrap();
            let run = push.run(&[until]).unwrap();
            let mut passed = Vec::new();
            let extrapolation = Extrapolation { model: &model, contact: ContactMode::Frictionless };
            let end = extrapolation.end(0.0, State { u, s, omega: 0.0, v_t: 0.0 }, until, &mut passed).unwrap();
            let pressed = passed.iter().all(|place| place.normal_force > 0.0);
            if let Some(sample) = run.samples.first() {
                let gap = (end.u - sample.state.u).abs().max((end.s - sample.state.s).abs());
                prop_assert!(gap < SAME, "{end:?} {sample:?}");
            } else {
                prop_assert!(!pressed || extrapolation.place(until, &end).normal_force < 0.0, "{:?} {passed:?}", run.end);
            }
        }
    }
}
