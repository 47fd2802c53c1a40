//! The observer of Gauthier, Hammouri and Othman for a body that rolls, and why not to use it here.
//!
//! It copies the motion and adds the error of the contact through the inverse of the Jacobian of
//! `Z = (u, u', u'', u''')` by the state: eight numbers for eight. For rolling that map is no diffeomorphism: its
//! determinant changes sign several times a second, and there the correction is infinite. The observer is kept so that
//! anybody can see this (`palpate tables 7-gho`); [`observer`](super::observer) needs no such map.
//!
//! Implements: thesis §4.2.2 with all poles at −ζ (its printed s₁₁ has the wrong sign), for the point contact of
//! chapter 7.
//! Frames: changes of attitude and angular velocity in body axes. Units: SI; ζ in 1/s.
//! Errors: none; where the map is singular the state stops being a number. `None` for custom shapes, which carry no
//! derivatives of higher order.

use nalgebra::{Quaternion, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};

use super::mechanics::{Model, RollState, StateOf};
use crate::math::ode::{self, Moment, Moves};
use crate::math::{Jet, Number};

/// A number with the derivatives by a small turn and a change of the angular velocity.
type BySix = Jet<6>;

/// The observer of Gauthier, Hammouri and Othman for a rolling body (thesis §4.2.2).
#[derive(Clone, Copy, Debug)]
pub struct RollGho<'a> {
    /// The body, free to spin.
    pub model: Model<'a>,
    /// What it feels, palm axes, m/s²; constant.
    pub specific_force: Vector3<f64>,
    /// Rate of all poles, 1/s.
    pub zeta: f64,
}

impl RollGho<'_> {
    /// `∂(u, u', u'', u''')/∂(u, θ, ω)`.
    #[must_use]
    pub fn jacobian(&self, state: &RollState) -> Option<SMatrix<f64, 8, 8>> {
        let seeded = seed(state);
        let feel = &self.specific_force;
        let orders = [
            velocity(&self.model, &seeded, feel)?,
            acceleration(&self.model, &seeded, feel)?,
            jerk(&self.model, &seeded, feel)?,
        ];
        let mut jacobian = SMatrix::<f64, 8, 8>::zeros();
        for axis in 0..2 {
            jacobian[(axis, axis)] = 1.0;
            for (order, value) in orders.iter().enumerate() {
                for column in 0..6 {
                    jacobian[(2 * (order + 1) + axis, 2 + column)] = value[axis].slopes[column];
                }
            }
        }
        Some(jacobian)
    }

    /// The determinant of the Jacobian, in units of the body's size and √(g/size). The map is singular where it is 0.
    #[must_use]
    pub fn determinant(&self, state: &RollState) -> Option<f64> {
        let size = self.model.body.size();
        let rate = (self.specific_force.norm() / size).sqrt();
        // Rows: velocities, accelerations and jerks over the size; columns: angular velocities.
        let scale = size.powi(6) * rate.powi(12) / rate.powi(3);
        Some(self.jacobian(state)?.determinant() / scale)
    }

    /// One Runge–Kutta step of `dt` (s), for contacts `u` (m) that change linearly from its start to its end.
    #[must_use]
    pub fn step(&self, state: &RollState, u: [Vector2<f64>; 2], dt: f64) -> Option<RollState> {
        let at = |share: f64| u[0] * (1.0 - share) + u[1] * share;
        let slope = |moment: Moment, state: &RollState| self.slope(state, at(moment.share())).ok_or(());
        ode::try_step(state, dt, slope).ok()
    }

    /// Rates of (u, θ, ω): the motion's own, and the correction.
    fn slope(&self, state: &RollState, u: Vector2<f64>) -> Option<SVector<f64, 8>> {
        let rates = self.model.rates(state, &self.specific_force);
        let miss = u - state.u;
        let z = self.zeta;
        let gains = [4.0 * z, 6.0 * z * z, 4.0 * z.powi(3), z.powi(4)];
        let push = SVector::<f64, 8>::from_fn(|row, _| gains[row / 2] * miss[row % 2]);
        let correction = self.jacobian(state)?.lu().solve(&push)?;
        let mut slope = SVector::<f64, 8>::zeros();
        slope.fixed_rows_mut::<2>(0).copy_from(&rates.u);
        slope.fixed_rows_mut::<3>(2).copy_from(&state.omega);
        slope.fixed_rows_mut::<3>(5).copy_from(&rates.omega);
        Some(slope + correction)
    }
}

/// Rates of (u, θ, ω): the attitude turns by as much at once.
impl Moves<SVector<f64, 8>> for RollState {
    fn moved(&self, slope: &SVector<f64, 8>, dt: f64) -> Self {
        let turn = UnitQuaternion::from_scaled_axis(slope.fixed_rows::<3>(2) * dt);
        Self {
            orientation: (self.attitude() * turn).into_inner(),
            omega: self.omega + slope.fixed_rows::<3>(5) * dt,
            u: self.u + slope.fixed_rows::<2>(0) * dt,
        }
    }
}

/// A state with its derivatives by (θ, ω).
fn seed(state: &RollState) -> StateOf<BySix> {
    let unit = |column: usize| SVector::<f64, 6>::ith(column, 1.0);
    let number = |value: f64, slopes: SVector<f64, 6>| BySix { value, slopes: slopes.into() };
    let q = state.orientation.normalize();
    // q ⊗ (1, θ/2)
    let turned = |axis: usize| q * Quaternion::from_imag(Vector3::ith(axis, 0.5));
    let turns = [turned(0), turned(1), turned(2)];
    let component = |pick: fn(&Quaternion<f64>) -> f64| {
        let slopes = (0..3).map(|axis| unit(axis) * pick(&turns[axis])).sum();
        number(pick(&q), slopes)
    };
    StateOf {
        orientation: [component(|q| q.w), component(|q| q.i), component(|q| q.j), component(|q| q.k)],
        omega: [0, 1, 2].map(|axis| number(state.omega[axis], unit(3 + axis))),
    }
}

/// The state a moment later: its rates as derivatives by time.
fn flowing<T: Number>(model: &Model, state: &StateOf<T>, specific_force: &Vector3<f64>) -> Option<StateOf<Jet<1, T>>> {
    let (_, rates) = model.rates_with(state, specific_force)?;
    Some(StateOf {
        orientation: [0, 1, 2, 3].map(|i| Jet { value: state.orientation[i], slopes: [rates.orientation[i]] }),
        omega: [0, 1, 2].map(|i| Jet { value: state.omega[i], slopes: [rates.omega[i]] }),
    })
}

fn velocity<T: Number>(model: &Model, state: &StateOf<T>, specific_force: &Vector3<f64>) -> Option<[T; 2]> {
    Some(model.rates_with(state, specific_force)?.0)
}

fn acceleration<T: Number>(model: &Model, state: &StateOf<T>, specific_force: &Vector3<f64>) -> Option<[T; 2]> {
    Some(velocity(model, &flowing(model, state, specific_force)?, specific_force)?.map(|component| component.slopes[0]))
}

fn jerk<T: Number>(model: &Model, state: &StateOf<T>, specific_force: &Vector3<f64>) -> Option<[T; 2]> {
    Some(
        acceleration(model, &flowing(model, state, specific_force)?, specific_force)?
            .map(|component| component.slopes[0]),
    )
}

#[cfg(test)]
mod tests {
    use super::super::mechanics::{Spin, specific_force};
    use super::super::tests::{bodies, state_of};
    use super::*;

    #[test]
    fn the_map_is_that_of_the_motions_derivatives() {
        let specific_force = specific_force(Vector3::new(0.3, -0.2, 0.1), 9.81);
        for body in bodies() {
            let model = Model { body, spin: Spin::Free };
            let gho = RollGho { model, specific_force, zeta: 10.0 };
            let state = state_of(Spin::Free, [0.4, -0.3, 0.8, 0.1], [2.0, -3.0, 1.0]);
            let jacobian = gho.jacobian(&state).unwrap();
            // Derivatives by time from a stencil of whole motions, by the state from differences.
            let derivatives = |state: &RollState| {
                let h = 2e-3;
                let at = |steps: f64| {
                    model
                        .step(
                            &model.step(state, &[specific_force; 3], steps * h / 2.0),
                            &[specific_force; 3],
                            steps * h / 2.0,
                        )
                        .u
                };
                let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(at);
                [
                    (c - b) * (2.0 / 3.0 / h) - (d - a) / (12.0 * h),
                    (b + c - state.u * 2.0) / (h * h),
                    (d - c * 2.0 + b * 2.0 - a) / (2.0 * h.powi(3)),
                ]
            };
            for column in 0..6 {
                let step = 1e-3;
                let mut slope = SVector::<f64, 8>::zeros();
                slope[2 + column] = step;
                let (ahead, behind) = (derivatives(&state.moved(&slope, 1.0)), derivatives(&state.moved(&slope, -1.0)));
                for order in 0..3 {
                    let wanted = (ahead[order] - behind[order]) / (2.0 * step);
                    for axis in 0..2 {
                        let got = jacobian[(2 * (order + 1) + axis, 2 + column)];
                        // Stencils of 2 ms: three digits of the third derivative.
                        let scale = 1.0 + jacobian.rows(2 * (order + 1), 2).abs().max();
                        assert!((got - wanted[axis]).abs() < 5e-3 * scale, "{column} {order}: {got} {}", wanted[axis]);
                    }
                }
            }
        }
    }
}
