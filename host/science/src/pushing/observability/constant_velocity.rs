//! What the contact angle tells of a push whose finger does not accelerate (thesis §5.2.2, §8.2.1): its Lie derivatives to
//! any order, in either precision.
//!
//! Theorems 19, 21 and 23 let the finger accelerate. Without that only u and its derivatives along the drift are left. They
//! are the coefficients of u as a power series of time; here with their derivatives by the state at its start, exact but
//! for rounding, and rounding of two kinds.
//!
//! Implements: the drifts of (5.27), (5.39) and of sliding contact with the signs put right, and support friction on a few
//! feet, which bear known shares of the weight. The finger's velocity along T and N are states with known values, which
//! turn with the contact, so no angle's sine is needed.
//! Assumes: the contact lasts in its mode. Units: SI; scaled as [`Scales`] says. Errors: none.

use nalgebra::{DMatrix, SVector};

use super::Scales;
use crate::math::twofold::{PIVOT_NONE, Twofold, expanded, pivots};
use crate::math::{Arithmetic, Jet, Spectrum, least_seen};

/// How many coefficients of u are made: orders 0 to 12.
pub const ORDERS: usize = 13;

/// So few coefficients are made of orders below: time grows with the cube.
const FEW: usize = 7;

/// A differential this much shorter than the longest is 0 but for rounding.
const LENGTH_NONE: f64 = 1e-13;

/// A foot slower than this rests, m/s: friction has no direction there, and no series.
const FOOT_RESTS: f64 = 2e-3;

/// A sliding contact that yields less than this share of what it does without turning jams (Painlevé).
const JAMS: f64 = 0.05;

/// Nearer than this share of its bound to where it may not go, a state is at the edge.
const EDGE: f64 = 1e-3;

/// A push at one instant, its finger at constant velocity.
#[derive(Clone, Debug, PartialEq)]
pub struct ConstantPush {
    /// Of the disk, m.
    pub radius: f64,
    /// Distance h of the edge's line from the centre of mass, m.
    pub height: f64,
    /// Inertia over mass ρ², m².
    pub inertia_per_mass: f64,
    /// What friction of the plane decelerates the part by, m/s²; 0 for none.
    pub mu_g: f64,
    /// Feet: distance from the centre of mass along the edge's normal and along the edge (m), share of the weight.
    pub feet: Vec<[f64; 3]>,
    /// What the contact does.
    pub contact: ConstantContact,
    /// s, ω and v_T (m, rad/s, m/s); in rolling v_T follows.
    pub state: [f64; 3],
    /// The finger's velocity along T and along N, m/s.
    pub finger: [f64; 2],
}

/// What a contact does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ConstantContact {
    /// Slides with this signed friction m; 0 without friction.
    Slides(f64),
    /// Rolls.
    Rolls,
}

/// What the derivatives of u up to an order tell.
#[derive(Clone, Debug, PartialEq)]
pub struct Told {
    /// Singular values of their differentials, scaled, in twofold precision up to the last step.
    pub spectrum: Spectrum,
    /// Of the elimination of the differentials with full pivoting the last pivot over the first, in `f64` and in twofold
    /// precision: what is 0 but for rounding differs between them by many orders of magnitude.
    pub last_pivot: [f64; 2],
}

impl Told {
    /// Whether every change of the state shows, and would in any precision.
    #[must_use]
    pub fn observable(&self) -> bool {
        self.last_pivot[1] > PIVOT_NONE
    }
}

/// Where a descent ended.
#[derive(Clone, Debug, PartialEq)]
pub struct LeastTold {
    /// The push at that state.
    pub push: ConstantPush,
    /// The least singular value there, as a share of the largest; 0 but for rounding where rank is lost.
    pub least: f64,
    /// Whether it is where it may not go on, so that it need not be a minimum.
    pub at_edge: bool,
}

impl ConstantPush {
    /// How many numbers the state has: u, s, ω and, unless the contact rolls, v_T.
    #[must_use]
    pub fn dimension(&self) -> usize {
        if self.contact == ConstantContact::Rolls { 3 } else { 4 }
    }

    /// The contact force into the part per mass, m/s²: the contact lasts where it is above 0.
    #[must_use]
    pub fn normal_force(&self) -> f64 {
        let [s, omega, v_t] = self.state;
        self.motion(&[0.0, s, omega, self.v_t(omega, v_t, self.finger[0]), self.finger[0], self.finger[1]]).1
    }

    /// What the derivatives of u up to an order below [`ORDERS`] tell of the state.
    #[must_use]
    pub fn told(&self, order: usize, scales: &Scales) -> Told {
        let rows = self.rows::<Twofold, ORDERS>(order, scales);
        let states = self.dimension();
        let matrix = DMatrix::from_fn(rows.len().max(states), states, |row, column| {
            rows.get(row).map_or(0.0, |row| row[column].re())
        });
        let last = |pivots: Vec<f64>| pivots[states - 1];
        Told {
            spectrum: Spectrum::of(matrix),
            last_pivot: [last(pivots(self.rows::<f64, ORDERS>(order, scales), states)), last(pivots(rows, states))],
        }
    }

    /// Descends from this state to one of the same part and finger at which the derivatives of u up to an order come nearest to
    /// losing rank, with s, ω and v_T within ±`bounds` (m, rad/s, m/s); none where the contact does not last at the start.
    ///
    /// Each differential counts at length 1, so that every order weighs alike, and each state in units of what it shows at
    /// the start: rank is all that matters. On the way the contact presses, no foot rests and no sliding jams.
    #[must_use]
    pub fn least_told(&self, order: usize, scales: &Scales, bounds: [f64; 3]) -> Option<LeastTold> {
        self.least_told_along(order, scales, bounds, [true; 3])
    }

    /// The same with only some of s, ω and v_T free.
    #[must_use]
    pub fn least_told_along(
        &self,
        order: usize,
        scales: &Scales,
        bounds: [f64; 3],
        free: [bool; 3],
    ) -> Option<LeastTold> {
        let place = |x: &SVector<f64, 3>, i: usize| if free[i] { x[i] * bounds[i] } else { self.state[i] };
        let at = |x: &SVector<f64, 3>| Self { state: [0, 1, 2].map(|i| place(x, i)), ..self.clone() };
        let start = SVector::from([0, 1, 2].map(|i| if free[i] { self.state[i] / bounds[i] } else { 0.0 }));
        let directions = |x: &SVector<f64, 3>| {
            let push = at(x);
            push.lasts().then(|| push.directions(order, scales))
        };
        let shown: Vec<f64> = directions(&start)?.column_iter().map(|column| column.norm()).collect();
        let rows = |x: &SVector<f64, 3>| {
            let mut directions = directions(x)?;
            for (mut column, shown) in
                directions.column_iter_mut().zip(&shown).filter(|(_, shown)| **shown > LENGTH_NONE)
            {
                column /= *shown;
            }
            Some(directions)
        };
        let found = least_seen(rows, start, SVector::repeat(1.0))?;
        let push = at(&found.place);
        // At the edge of where a contact lasts, or of the bounds.
        let beside = |i: usize, sign: f64| {
            let mut x = found.place;
            x[i] += sign * EDGE;
            free[i] && (x[i].abs() > 1.0 || !at(&x).lasts())
        };
        let at_edge = (0..3).any(|i| beside(i, 1.0) || beside(i, -1.0));
        Some(LeastTold { push, least: found.least, at_edge })
    }

    /// Whether the contact lasts and the motion has a series: it presses, no foot rests and no sliding jams.
    fn lasts(&self) -> bool {
        self.normal_force() >= 0.0 && self.slowest_foot() > FOOT_RESTS && self.yielding() > JAMS
    }

    /// The differentials of the coefficients of u up to an order, each at length 1, in `f64`. What is 0 but for rounding beside
    /// the longest stays 0.
    fn directions(&self, order: usize, scales: &Scales) -> DMatrix<f64> {
        let rows =
            if order < FEW { self.rows::<f64, FEW>(order, scales) } else { self.rows::<f64, ORDERS>(order, scales) };
        let length = |row: &[f64; 4]| row.iter().map(|entry| entry * entry).sum::<f64>().sqrt();
        let longest = rows.iter().map(length).fold(0.0, f64::max);
        let states = self.dimension();
        DMatrix::from_fn(rows.len().max(states), states, |row, column| {
            let shown = rows.get(row).filter(|row| length(row) > LENGTH_NONE * longest);
            shown.map_or(0.0, |row| row[column] / length(row))
        })
    }

    /// How fast the slowest foot goes, m/s: where one rests friction has no direction, and no series. Infinite on ice.
    #[must_use]
    pub fn slowest_foot(&self) -> f64 {
        let [s, omega, v_t] = self.state;
        let (along, normal) = (self.v_t(omega, v_t, self.finger[0]), self.finger[1] + s * omega);
        let speed = |foot: &[f64; 3]| (along - omega * foot[0]).hypot(normal - omega * foot[1]);
        if self.mu_g > 0.0 { self.feet.iter().map(speed).fold(f64::INFINITY, f64::min) } else { f64::INFINITY }
    }

    /// What the closing is divided by for the force: 1 and more where the contact rolls, 0 where sliding jams (Painlevé).
    fn yielding(&self) -> f64 {
        match self.contact {
            ConstantContact::Rolls => 1.0,
            ConstantContact::Slides(m) => {
                1.0 + self.state[0] * (self.state[0] - m * self.height) / self.inertia_per_mass
            }
        }
    }

    /// The differentials of the coefficients of u, scaled.
    fn rows<A: Arithmetic, const K: usize>(&self, order: usize, scales: &Scales) -> Vec<[A; 4]> {
        let [s, omega, v_t] = self.state;
        let [finger_t, finger_n] = self.finger;
        let number = |value: f64, slopes: [f64; 4]| Jet { value: A::from(value), slopes: slopes.map(A::from) };
        // The finger's velocity is known in world axes: T turns by N, and N by −T.
        let finger = [number(finger_t, [finger_n, 0.0, 0.0, 0.0]), number(finger_n, [-finger_t, 0.0, 0.0, 0.0])];
        let (s, omega) = (number(s, [0.0, 1.0, 0.0, 0.0]), number(omega, [0.0, 0.0, 1.0, 0.0]));
        let free = number(v_t, [0.0, 0.0, 0.0, 1.0]);
        let v_t =
            if self.contact == ConstantContact::Rolls { finger[0] + omega * Jet::from(self.height) } else { free };
        let start = [number(0.0, [1.0, 0.0, 0.0, 0.0]), s, omega, v_t, finger[0], finger[1]];
        let path = expanded::<Jet<4, A>, 6, K>(start, |states| self.motion(states).0);
        let scaled = scales.of_states();
        let row = |k: usize| {
            // A coefficient of the k-th power of time, in units of time.
            let unit = scales.time.powi(i32::try_from(k).unwrap_or(i32::MAX));
            std::array::from_fn(|column| path[0].0[k].slopes[column] * A::from(scaled[column] * unit))
        };
        (0..=order.min(K - 1)).map(row).collect()
    }

    fn v_t(&self, omega: f64, v_t: f64, finger_t: f64) -> f64 {
        if self.contact == ConstantContact::Rolls { finger_t + self.height * omega } else { v_t }
    }

    /// Rates of u, s, ω, v_T, v_FT and v_FN, and the normal force.
    fn motion<A: Arithmetic>(&self, &[_, s, omega, v_t, finger_t, finger_n]: &[A; 6]) -> ([A; 6], A) {
        let of = |value: f64| A::from(value);
        let (h, r, rho2) = (of(self.height), of(self.radius), of(self.inertia_per_mass));
        let v_n = finger_n + s * omega;
        // Friction of the plane along T and N, and its moment, per mass.
        let zero = of(0.0);
        let (mut along, mut normal, mut moment) = (zero, zero, zero);
        for &[a, b, share] in self.feet.iter().filter(|_| self.mu_g > 0.0) {
            let (t, n) = (v_t - omega * of(a), v_n - omega * of(b));
            let scale = of(-self.mu_g * share) / (t * t + n * n).sqrt();
            let (force_t, force_n) = (t * scale, n * scale);
            along = along + force_t;
            normal = normal + force_n;
            moment = moment - force_t * of(a) - force_n * of(b);
        }
        let slip = v_t - finger_t;
        let (rates_s, rates_omega, rates_v_t, force) = match self.contact {
            ConstantContact::Rolls => {
                let turn = (s * normal + h * along + moment + r * s * omega * omega) / (rho2 + h * h + s * s);
                let force = normal - (turn * s + omega * omega * (h - r));
                let rate = turn * h + omega * finger_n;
                (-(omega * r), turn, rate, force)
            }
            ConstantContact::Slides(m) => {
                let (m, reach) = (of(m), r + h);
                let arm = s - m * h;
                let closing = omega * omega * reach - of(2.0) * omega * slip + normal - s * moment / rho2;
                let force = closing / (of(1.0) + s * arm / rho2);
                (slip - omega * reach, (force * arm + moment) / rho2, m * force + along + omega * v_n, force)
            }
        };
        ([omega, rates_s, rates_omega, rates_v_t, omega * finger_n, -(omega * finger_t)], force)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Vector2};
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::math::random::Draw;
    use crate::pushing::dynamics::{ContactMode, Finger, Mass, Part, PushModel, Slip, State};

    const SCALES: Scales = Scales { length: 0.02, time: 0.045 };

    fn pushes() -> impl Strategy<Value = ConstantPush> {
        let contact = prop_oneof![
            Just(ConstantContact::Rolls),
            Just(ConstantContact::Slides(0.0)),
            (0.1..0.4).prop_map(ConstantContact::Slides),
            (-0.4..-0.1).prop_map(ConstantContact::Slides),
        ];
        let feet = [
            [-0.02..0.02, -0.02..0.02, 0.2..0.4_f64],
            [-0.02..0.02, -0.02..0.02, 0.2..0.4],
            [-0.02..0.02, -0.02..0.02, 0.2..0.4],
        ];
        let state = [-0.02..0.02, -2.0..2.0, -0.03..0.03_f64];
        (0.005..0.02, 0.01..0.03, 0.01..0.03_f64, 0.5..4.0_f64, feet, contact, state, -0.02..0.02_f64, -0.08..-0.03_f64)
            .prop_map(|(radius, height, rho, mu_g, feet, contact, state, along, into)| ConstantPush {
                radius,
                height,
                inertia_per_mass: rho * rho,
                mu_g,
                feet: feet.to_vec(),
                contact,
                state,
                finger: [along, into],
            })
    }

    proptest! {
        /// The rates are those of the library's push on the same feet.
        #[test]
        fn the_motion_is_that_of_the_simulated_push(push in pushes()) {
            let (h, u) = (push.height, std::f64::consts::FRAC_PI_2);
            // Edge 0 runs along x, its normal is −y: a foot at (a, b) along normal and edge is at (b, −a).
            let outline = [[-0.05, -h], [0.05, -h], [0.05, 0.05], [-0.05, 0.05]].map(Point2::from);
            let feet: Vec<_> = push.feet.iter().map(|&[a, b, share]| (Point2::new(b, -a), share)).collect();
            let mass = Mass { centre_of_mass: Point2::origin(), inertia_per_mass: push.inertia_per_mass };
            let part = Part::on_feet(SimplePolygon::new(outline).unwrap(), &feet, mass);
            // T = (−1, 0) and N = (0, −1) at u = 90°.
            let velocity0 = Vector2::new(-push.finger[0], -push.finger[1]);
            let finger = Finger { radius: push.radius, centre0: Point2::origin(), velocity0, acceleration: Vector2::zeros() };
            let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: push.mu_g, finger };
            let [s, omega, v_t] = push.state;
            let v_t = push.v_t(omega, v_t, push.finger[0]);
            let mode = match push.contact {
                ConstantContact::Rolls => ContactMode::Rolling,
                ConstantContact::Slides(m) => ContactMode::Sliding { friction: m.abs(), slip: if m < 0.0 { Slip::Backward } else { Slip::Forward } },
            };
            let motion = model.motion(&mode, 0.0, &State { u, s, omega, v_t });
            let (ours, force) = push.motion(&[u, s, omega, v_t, push.finger[0], push.finger[1]]);
            let wanted = [motion.rates.u, motion.rates.s, motion.rates.omega];
            for (ours, wanted) in ours.iter().zip(wanted) {
                prop_assert!((ours - wanted).abs() < 1e-9 * (1.0 + wanted.abs()), "{ours} {wanted} {push:?}");
            }
            if mode != ContactMode::Rolling {
                prop_assert!((ours[3] - motion.rates.v_t).abs() < 1e-9 * (1.0 + motion.rates.v_t.abs()));
            }
            prop_assert!((force - motion.normal_force).abs() < 1e-9 * (1.0 + force.abs()), "{force} {motion:?}");
        }

        /// More derivatives tell no less, and both precisions say the same of what shows.
        #[test]
        fn a_raised_order_tells_no_less(push in pushes()) {
            let told = [3, 5, 8, 12].map(|order| push.told(order, &SCALES));
            for pair in told.windows(2) {
                prop_assert!(pair[1].observable() || !pair[0].observable(), "{told:?}");
            }
            if told[3].last_pivot[1] > 1e-8 {
                prop_assert!((told[3].last_pivot[0] / told[3].last_pivot[1] - 1.0).abs() < 1e-3, "{:?}", told[3]);
            }
        }

        /// The thesis conjectures below Theorem 19 that without acceleration all but finitely many states are observable.
        /// Without friction on the table a whole surface is not: where the part does not turn, u and ω are all that shows.
        #[test]
        fn a_part_that_does_not_turn_on_ice_hides_its_place(push in pushes()) {
            let mut push = ConstantPush { mu_g: 0.0, ..push };
            push.state[1] = 0.0;
            let told = push.told(12, &SCALES);
            prop_assert!(!told.observable() && told.spectrum.rank() == 2, "{told:?}");
        }

        /// On a table with friction it shows all the same.
        #[test]
        fn a_part_that_does_not_turn_on_a_table_shows_its_place(push in pushes()) {
            let mut push = push;
            push.state[1] = 0.0;
            let told = push.told(12, &SCALES);
            prop_assert!(told.observable(), "{told:?} {push:?}");
        }
    }

    /// The push of `palpate tables observability --plot`: on ice, without friction at the finger, there are two more rates of
    /// turning at which the proof's three derivatives do not tell. The fourth does, so nothing is hidden there.
    #[test]
    fn where_three_derivatives_do_not_tell_on_ice_a_fourth_does() {
        let told = |omega: f64, order: usize| {
            let push = ConstantPush {
                radius: 0.01,
                height: 0.02,
                inertia_per_mass: 4e-4,
                mu_g: 0.0,
                feet: Vec::new(),
                contact: ConstantContact::Slides(0.0),
                state: [0.006, omega, 0.012],
                finger: [0.0, -0.05],
            };
            push.told(order, &SCALES).last_pivot[1]
        };
        for omega in [0.426_077_601_115_024_1, 0.978_374_279_729_932_6] {
            let [here, beside] = [omega, omega + 0.05].map(|omega| told(omega, 3));
            assert!(here < 1e-9 * beside, "{omega}: {here:e} {beside:e}");
            assert!(told(omega, 4) > 1e-3 * beside, "{omega}: {:e} {beside:e}", told(omega, 4));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        /// On a table three derivatives miss whole surfaces. Where a descent ends on one, more derivatives tell what those miss.
        #[test]
        fn where_three_derivatives_do_not_tell_on_a_table_more_do(push in pushes()) {
            let found = push.least_told(push.dimension() - 1, &SCALES, [0.02, 2.0, 0.03]);
            prop_assume!(found.as_ref().is_some_and(|found| found.least < 1e-9));
            let push = found.unwrap().push;
            let few = push.told(push.dimension() - 1, &SCALES).last_pivot[1];
            let more = push.told(12, &SCALES).last_pivot[1];
            prop_assert!(few < 1e-9 && more > 1e2 * few && more > PIVOT_NONE, "{few:e} {more:e} {push:?}");
        }
    }

    /// Seeking finds what is there: on ice the surface ω = 0, beside which the contact lets go.
    #[test]
    fn descents_find_the_states_that_hide_their_place_on_ice() {
        let found: Vec<_> = (0..60)
            .filter_map(|case| {
                let mut draw = Draw::case(1, case);
                let push = ConstantPush {
                    radius: draw.uniform(0.005, 0.02),
                    height: draw.uniform(0.01, 0.03),
                    inertia_per_mass: draw.uniform(0.01, 0.03).powi(2),
                    mu_g: 0.0,
                    feet: Vec::new(),
                    contact: ConstantContact::Slides(draw.uniform(-0.4, 0.4)),
                    state: [draw.uniform(-0.02, 0.02), draw.uniform(-2.0, 2.0), draw.uniform(-0.03, 0.03)],
                    finger: [draw.uniform(-0.02, 0.02), -0.05],
                };
                push.least_told(6, &SCALES, [0.02, 2.0, 0.03])
            })
            .collect();
        let lost: Vec<_> = found.iter().filter(|found| found.least < 1e-9).collect();
        assert!(found.len() > 20 && lost.len() > found.len() / 2, "{} of {}", lost.len(), found.len());
        // Its differentials shrink with powers of ω times the unit of time, here 0.045 s: the fourth is below what counts, 1e-13 of
        // the longest, from some 0.0125 rad/s down, where a descent then ends. Of parts drawn over 2 rad/s.
        assert!(lost.iter().all(|found| found.push.state[1].abs() < 0.05), "{lost:?}");
    }

    /// Appendix E's condition 1 fails where s² = h² + ρ²; a derivative more tells what it misses.
    #[test]
    fn rolling_on_ice_needs_a_third_derivative_beside_the_radius_of_gyration() {
        let (height, rho2) = (0.02, 4e-4);
        let push = ConstantPush {
            radius: 0.01,
            height,
            inertia_per_mass: rho2,
            mu_g: 0.0,
            feet: Vec::new(),
            contact: ConstantContact::Rolls,
            state: [(height * height + rho2).sqrt(), 1.5, 0.0],
            finger: [0.0, -0.05],
        };
        assert!(!push.told(2, &SCALES).observable() || push.told(2, &SCALES).last_pivot[1] < 1e-14);
        assert!(push.told(3, &SCALES).observable() && push.told(3, &SCALES).last_pivot[1] > 1e-6);
    }
}
