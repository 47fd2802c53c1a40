//! What the contact's path tells of a roll whose palm does not accelerate: the coefficients of u(t) order by order, in two
//! precisions.
//!
//! [`observability`](mod@super::observability) weighs all orders at once, over a window and in one precision. Here they are taken one by one:
//! the coefficients of u as a power series of time, with their derivatives by the state at its start, exact but for
//! rounding, and rounding of two kinds. What is 0 but for rounding shrinks by 16 digits from one to the other; what is not
//! stays, and raising the order can only add.
//!
//! Implements: the rank condition of thesis §7.2 for a palm at rest or at constant velocity, with the motion of
//! [`mechanics`](super::mechanics).
//! Assumes: the contact lasts. Frames: changes of attitude about body axes, of angular velocity in palm axes. Units:
//! relative to rad, the body's size L and √(g/L). Errors: none; `None` for a custom shape, which carries no series.

use nalgebra::Vector3;

use super::mechanics::{Model, RollState, Spin, StateOf};
use super::shape::Shape;
use crate::math::twofold::{PIVOT_NONE, Series, Twofold, expanded, pivots};
use crate::math::{Algebraic, Jet};

/// How many coefficients of u are made: orders 0 to 12.
pub const ORDERS: usize = 13;

/// Columns of a row: u (2), a small turn (3), the angular velocity (3, of which the last is missing without spin).
const STATES: usize = 8;

/// What the derivatives of u up to an order tell.
#[derive(Clone, Debug, PartialEq)]
pub struct RollTold {
    /// Pivots of the elimination of their differentials as shares of the first, as many as the state has numbers: in `f64` and
    /// in twofold precision.
    pub pivots: [Vec<f64>; 2],
}

impl RollTold {
    /// How many changes of state show, and would in any precision.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.pivots[1].iter().filter(|pivot| **pivot > PIVOT_NONE).count()
    }

    /// The least pivot that counts in twofold precision, in both precisions.
    #[must_use]
    pub fn last_seen(&self) -> [f64; 2] {
        [0, 1].map(|precision| self.rank().checked_sub(1).map_or(0.0, |last| self.pivots[precision][last]))
    }

    /// The largest pivot that does not count, in both precisions; none where all do.
    #[must_use]
    pub fn first_unseen(&self) -> Option<[f64; 2]> {
        (self.rank() < self.pivots[1].len()).then(|| [0, 1].map(|precision| self.pivots[precision][self.rank()]))
    }
}

/// What the derivatives of u tell of a state up to each of these orders, all below [`ORDERS`].
#[must_use]
pub fn told(model: &Model, state: &RollState, g: f64, orders: &[usize]) -> Option<Vec<RollTold>> {
    let (plain, twofold) = (rows::<f64>(model, state, g)?, rows::<Twofold>(model, state, g)?);
    let states = model.dimension();
    let told = |&order: &usize| {
        let count = 2 * (order + 1).min(ORDERS);
        RollTold { pivots: [pivots(plain[..count].to_vec(), states), pivots(twofold[..count].to_vec(), states)] }
    };
    Some(orders.iter().map(told).collect())
}

/// The differentials of the coefficients of u over the size, two an order.
fn rows<A: Algebraic>(model: &Model, state: &RollState, g: f64) -> Option<Vec<[A; STATES]>> {
    if matches!(model.body.shape(), Shape::Custom(_)) {
        return None;
    }
    let size = model.body.size();
    let rate = (g / size).sqrt();
    let start = seed::<A>(model, state);
    let feel = Vector3::new(0.0, 0.0, g);
    let path = expanded::<Jet<6, A>, 9, ORDERS>(start, |states| {
        let &[_, _, w, x, y, z, p, q, r] = states;
        let here = StateOf { orientation: [w, x, y, z], omega: [p, q, r] };
        let Some((u, StateOf { orientation: [w, x, y, z], omega: [p, q, r] })) = model.rates_with(&here, &feel) else {
            return [Series::from(f64::NAN); 9];
        };
        [u[0], u[1], w, x, y, z, p, q, r]
    });
    let row = |order: usize, axis: usize| {
        let mut row = [A::from(0.0); STATES];
        // u itself shows at once and changes nothing.
        row[axis] = A::from(if order == 0 { 1.0 } else { 0.0 });
        let unit = (1.0 / rate).powi(i32::try_from(order).unwrap_or(i32::MAX)) / size;
        for (column, slope) in path[axis].0[order].slopes.into_iter().enumerate() {
            row[2 + column] = slope * (if column < 3 { unit } else { unit * rate });
        }
        row
    };
    Some((0..ORDERS).flat_map(|order| [row(order, 0), row(order, 1)]).collect())
}

/// u, orientation and angular velocity with their derivatives by a small turn about body axes, at which the angular
/// velocity stays what it is in palm axes, and by that. A contact without spin starts without any, to the last digit.
fn seed<A: Algebraic>(model: &Model, state: &RollState) -> [Jet<6, A>; 9] {
    let half = |value: f64, axis: usize| {
        let mut jet = Jet::<6, A>::from(value);
        jet.slopes[axis] = A::from(0.5);
        jet
    };
    let turn = [0, 1, 2].map(|axis| half(0.0, axis));
    let [i, j, k, w] = <[f64; 4]>::from(state.orientation.coords);
    // q ⊗ (1, θ/2)
    let [a, b, c] = turn;
    let q =
        [-(a * i) - b * j - c * k + w, a * w + c * j - b * k + i, b * w + a * k - c * i + j, c * w + b * i - a * j + k];
    let in_palm = state.orientation.normalize();
    let in_palm = nalgebra::UnitQuaternion::new_unchecked(in_palm) * state.omega;
    let palm = [0, 1, 2].map(|axis| {
        let known = model.spin == Spin::NoSpin && axis == 2;
        let mut jet = Jet::<6, A>::from(if known { 0.0 } else { in_palm[axis] });
        jet.slopes[3 + axis] = A::from(1.0);
        jet
    });
    let omega = StateOf { orientation: q, omega: palm }.to_body(palm);
    let zero = Jet::from(0.0);
    [zero, zero, q[0], q[1], q[2], q[3], omega[0], omega[1], omega[2]]
}

#[cfg(test)]
mod tests {
    use nalgebra::{Quaternion, UnitQuaternion, Vector2};

    use super::super::body::RollingBody;
    use super::super::flow::{Columns, STATE_COLUMNS, StateWithTangent};
    use super::super::observability::{Inputs, observability};
    use super::super::tests::{bodies, state_of};
    use super::*;
    use crate::gravity::GRAVITY_ASSUMED;
    use crate::math::Arithmetic;

    /// What 13 coefficients say of a moment later, against steps of the integrator and its sensitivities.
    #[test]
    fn the_series_is_the_motion() {
        /// s.
        const LATER: f64 = 0.004;
        /// Steps of a tenth of a millisecond err by 1e-12 here, the series by less.
        const AGREE: f64 = 1e-10;
        let feel = Vector3::new(0.0, 0.0, GRAVITY_ASSUMED);
        for body in bodies() {
            for spin in [Spin::Free, Spin::NoSpin] {
                let model = Model { body, spin };
                let state = state_of(spin, [0.4, -0.3, 0.8, 0.1], [2.0, -3.0, 1.0]).normalized();
                let mut flow = StateWithTangent::<STATE_COLUMNS>::seed(&state);
                for _ in 0..40 {
                    flow = model.step_with(Columns::STATE, &flow, &[feel; 3], LATER / 40.0);
                }
                let rows = rows::<Twofold>(&model, &state, GRAVITY_ASSUMED).unwrap();
                let rate = (GRAVITY_ASSUMED / body.size()).sqrt();
                for axis in 0..2 {
                    for column in 0..model.dimension() - 2 {
                        let summed: f64 = (0..ORDERS)
                            .map(|order| {
                                rows[2 * order + axis][2 + column].re()
                                    * (LATER * rate).powi(i32::try_from(order).unwrap())
                            })
                            .sum();
                        let scale = if column < 3 { 1.0 } else { rate };
                        let wanted = flow.tangent.u[axis][column] * scale / body.size();
                        assert!(
                            (summed - wanted).abs() < AGREE * (1.0 + wanted.abs()),
                            "{spin:?} {axis} {column}: {summed} {wanted}"
                        );
                    }
                }
            }
        }
    }

    /// The verdicts of the window stand when the order rises and the digits double: what shows is the same to both
    /// precisions, and what does not is 0 but for rounding of the one or of the other.
    #[test]
    fn the_windows_verdicts_stand_in_raised_order_and_precision() {
        let end = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.7).into_inner();
        let still =
            |orientation: Quaternion<f64>| RollState { orientation, omega: Vector3::zeros(), u: Vector2::zeros() };
        let tilted = |spin| state_of(spin, [1.0, 0.4, -0.7, 0.2], [4.0, -6.0, 3.0]);
        let triaxial = RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap();
        let spheroid = RollingBody::ellipsoid([0.02, 0.02, 0.035]).unwrap();
        let sphere = RollingBody::ellipsoid([0.03; 3]).unwrap();
        for spin in [Spin::Free, Spin::NoSpin] {
            let mut cases: Vec<_> = bodies().iter().map(|body| (body, tilted(spin))).collect();
            cases.extend([(&spheroid, tilted(spin)), (&sphere, tilted(spin)), (&triaxial, still(end))]);
            for (body, state) in cases {
                let model = Model { body, spin };
                let window = observability(&model, &state, GRAVITY_ASSUMED, Inputs::Zero).unwrap().spectrum.rank();
                let told = told(&model, &state, GRAVITY_ASSUMED, &[3, 4, 6, 8, 12]).unwrap();
                assert!(told.windows(2).all(|pair| pair[0].rank() <= pair[1].rank()), "{told:?}");
                for told in &told[2..] {
                    assert_eq!(told.rank(), window, "{spin:?} {body:?} {told:?}");
                    let [plain, twofold] = told.last_seen();
                    assert!(twofold > 1e-10 && (plain / twofold - 1.0).abs() < 1e-3, "{told:?}");
                    if let Some([plain, twofold]) = told.first_unseen() {
                        assert!(plain < 1e-13 && twofold < 1e-28, "{told:?}");
                    }
                }
            }
        }
    }
}
