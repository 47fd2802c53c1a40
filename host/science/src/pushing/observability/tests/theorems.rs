//! Thesis Theorems 19, 21 and 23 and Appendix E, as numbers: ranks of the differentials that their proofs name.
//!
//! With the misprints put right: v_FT and v_FN turn with the contact, the input of (5.29) has a plus, and ± in the
//! input of sliding contact is opposite to that of (5.41). u is a polar angle, so r drops out of the output's
//! derivatives. Friction under the part is left out, as in the proofs: none of the differentials they name contains it.
//!
//! Lie derivatives are taken with nested dual numbers and share nothing with the library; one test compares the fields
//! with it.

use nalgebra::{DMatrix, SMatrix, SVector};
use num_dual::{Derivative, Dual, DualNum, DualSVec64};

use super::*;

/// Numbers that a function may be asked for: plain, or with derivatives nested as deep as the proof goes.
trait Number: DualNum<f64> + Copy {}
impl<T: DualNum<f64> + Copy> Number for T {}

/// A function of the state.
trait Function<const N: usize>: Copy {
    fn at<T: Number>(&self, x: &[T; N]) -> T;
}

/// A vector field on the states.
trait Field<const N: usize>: Copy {
    fn at<T: Number>(&self, x: &[T; N]) -> [T; N];
}

/// L_field function.
#[derive(Clone, Copy)]
struct Lie<V, H>(V, H);

impl<const N: usize, V: Field<N>, H: Function<N>> Function<N> for Lie<V, H> {
    fn at<T: Number>(&self, x: &[T; N]) -> T {
        let velocity = self.0.at(x);
        let moving = std::array::from_fn(|i| Dual::<T, f64>::new(x[i], velocity[i]));
        self.1.at(&moving).eps
    }
}

/// The first state: the contact angle.
#[derive(Clone, Copy)]
struct Component(usize);

impl<const N: usize> Function<N> for Component {
    fn at<T: Number>(&self, x: &[T; N]) -> T {
        x[self.0]
    }
}

fn differential<const N: usize>(function: &impl Function<N>, x: &[f64; N]) -> SVector<f64, N> {
    let seeded = std::array::from_fn(|i| {
        DualSVec64::<N>::new(x[i], Derivative::derivative_generic(nalgebra::Const::<N>, nalgebra::Const::<1>, i))
    });
    function.at(&seeded).eps.unwrap_generic(nalgebra::Const::<N>, nalgebra::Const::<1>)
}

/// Rank of differentials, each state counted in metres and seconds of the scales; rows at length 1, for Lie derivatives
/// of different orders have different units.
fn rank<const N: usize>(differentials: &[SVector<f64, N>]) -> usize {
    // Centimetres: lengths of the parts below; seconds are theirs too.
    const LENGTH: f64 = 0.02;
    let scale = |i: usize| if i == 1 || i >= 3 { LENGTH } else { 1.0 };
    let rows: Vec<_> = differentials
        .iter()
        .map(|row| SVector::<f64, N>::from_fn(|i, _| row[i] * scale(i)))
        .map(|row| if row.norm() > 1e-9 { row.normalize() } else { row * 0.0 })
        .collect();
    let matrix = DMatrix::from_fn(rows.len(), N, |i, j| rows[i][j]);
    // Rounding in the closed forms is 1e-13; what is independent here is above 1e-4.
    matrix.rank(1e-8)
}

/// The disk and the polygon without support friction: state (u, s, ω, v_T, v_FT, v_FN); m is 0 without contact
/// friction.
#[derive(Clone, Copy, Debug)]
struct Sliding {
    radius: f64,
    height: f64,
    rho_squared: f64,
    m: f64,
}

impl Sliding {
    fn reach(&self) -> f64 {
        self.radius + self.height
    }

    /// ρ² + s² − m h s.
    fn denominator<T: Number>(&self, s: T) -> T {
        s * (s - self.m * self.height) + self.rho_squared
    }
}

/// The drift f, or the inputs g_T and g_N.
#[derive(Clone, Copy)]
enum Part3<S> {
    Drift(S),
    Tangential(S),
    Normal(S),
}
use Part3::{Drift, Normal, Tangential};

impl Field<6> for Part3<Sliding> {
    fn at<T: Number>(&self, &[_, s, omega, v_t, finger_t, finger_n]: &[T; 6]) -> [T; 6] {
        let zero = T::from(0.0);
        match self {
            Drift(push) => {
                let along = v_t - finger_t;
                // λ (ρ² + s² − mhs)/ρ², of a finger that does not accelerate.
                let closing = omega * omega * push.reach() - omega * along * 2.0;
                let force = closing / push.denominator(s);
                [
                    omega,
                    along - omega * push.reach(),
                    force * (s - push.m * push.height),
                    omega * (finger_n + s * omega) + force * (push.m * push.rho_squared),
                    omega * finger_n,
                    -(omega * finger_t),
                ]
            }
            Tangential(_) => [zero, zero, zero, zero, T::from(1.0), zero],
            Normal(push) => {
                let force = -push.denominator(s).recip();
                let turn = force * (s - push.m * push.height);
                [zero, zero, turn, force * (push.m * push.rho_squared), zero, T::from(1.0)]
            }
        }
    }
}

const U: Component = Component(0);

/// The differentials of the proofs of Theorems 19 and 23, and those for the place where two of them depend.
fn sliding_differentials(push: Sliding, x: &[f64; 6]) -> [Vec<SVector<f64, 6>>; 2] {
    let (f, g) = (Drift(push), Normal(push));
    let common = [differential(&U, x), differential(&Component(4), x), differential(&Component(5), x)];
    let first = [differential(&Lie(f, U), x)];
    let gf = Lie(g, Lie(f, U));
    let gfgf = Lie(g, Lie(f, gf));
    let usual = [differential(&gf, x), differential(&Lie(f, gf), x)];
    let special = [differential(&gfgf, x), differential(&Lie(f, gfgf), x)];
    [usual, special].map(|two| [&common[..], &first, &two].concat())
}

prop_compose! {
    fn sliding(m: f64)(radius in 0.005..0.02, height in 0.01..0.03, rho in 0.01..0.03) -> Sliding {
        Sliding { radius, height, rho_squared: rho * rho, m }
    }
}

prop_compose! {
    /// A state without s.
    fn motion()(
        u in 1.2..1.9,
        omega in prop_oneof![-1.0..-0.2, 0.2..1.0],
        v_t in prop_oneof![-0.02..-0.005, 0.005..0.02],
        finger in [-0.01..0.01, -0.05..-0.04],
    ) -> [f64; 6] {
        [u, 0.0, omega, v_t, finger[0], finger[1]]
    }
}

fn at(motion: [f64; 6], s: f64) -> [f64; 6] {
    let mut x = motion;
    x[1] = s;
    x
}

proptest! {
    /// Theorem 19, and the corrected (5.27): the fields are those of the library.
    #[test]
    fn fields_are_those_of_the_simulated_push(
        push in sliding(0.0), motion in motion(), s in -0.02..0.02, friction in -0.5..0.5, input in [-1.0..1.0, -1.0..1.0],
    ) {
        let push = Sliding { m: friction, ..push };
        let (x, h) = (at(motion, s), push.height);
        // Any part with this height will do: only its height and inertia count.
        let outline = [[-0.05, -h], [0.05, -h], [0.05, 0.05], [-0.05, 0.05]].map(Point2::from);
        let mass = crate::pushing::dynamics::Mass { centre_of_mass: Point2::origin(), inertia_per_mass: push.rho_squared };
        let part = Part::with_mass(SimplePolygon::new(outline).unwrap(), mass);
        let (normal, tangent) = (-Vector2::new(x[0].cos(), x[0].sin()), Vector2::new(-x[0].sin(), x[0].cos()));
        let world = |t: f64, n: f64| tangent * t + normal * n;
        let finger = Finger {
            radius: push.radius,
            centre0: Point2::origin(),
            velocity0: world(x[4], x[5]),
            acceleration: world(input[0], input[1]),
        };
        let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 0.0, finger };
        let slip = if friction < 0.0 { Slip::Backward } else { Slip::Forward };
        let state = State { u: x[0], s, omega: x[2], v_t: x[3] };
        let rates = model.motion(&ContactMode::Sliding { friction: friction.abs(), slip }, 0.0, &state).rates;
        let fields = [Drift(push).at(&x), Tangential(push).at(&x), Normal(push).at(&x)];
        for (i, rate) in [rates.u, rates.s, rates.omega, rates.v_t].into_iter().enumerate() {
            let ours = fields[0][i] + input[0] * fields[1][i] + input[1] * fields[2][i];
            prop_assert!((ours - rate).abs() < 1e-10 * (1.0 + rate.abs()), "{i}: {ours} {rate}");
        }
        // Rows 5 and 6: the finger's velocity by axes that turn with the contact, ω = u̇, as a difference of a moment.
        let moment = 1e-5;
        let later = |time: f64| {
            let (sin, cos) = (x[0] + x[2] * time).sin_cos();
            let velocity = finger.velocity0 + finger.acceleration * time;
            [velocity.dot(&Vector2::new(-sin, cos)), -velocity.dot(&Vector2::new(cos, sin))]
        };
        for row in [4, 5] {
            let ours = fields[0][row] + input[0] * fields[1][row] + input[1] * fields[2][row];
            let rate = (later(moment)[row - 4] - later(-moment)[row - 4]) / (2.0 * moment);
            prop_assert!((ours - rate).abs() < 1e-8, "{row}: {ours} {rate}");
        }
    }

    #[test]
    fn theorem_19_frictionless_contact_is_observable(push in sliding(0.0), motion in motion(), s in -0.03..0.03) {
        let rho = push.rho_squared.sqrt();
        prop_assume!((f64::abs(s) - rho).abs() > 1e-4);
        let [usual, _] = sliding_differentials(push, &at(motion, s));
        prop_assert_eq!(rank(&usual), 6);
    }

    /// Where s = ±ρ (not ρ alone) the usual differentials depend and the others do not, with the printed value.
    #[test]
    fn theorem_19_has_a_special_case_at_the_radius_of_gyration(push in sliding(0.0), motion in motion(), side in prop_oneof![Just(1.0), Just(-1.0)]) {
        let rho = push.rho_squared.sqrt();
        let x = at(motion, side * rho);
        let [usual, special] = sliding_differentials(push, &x);
        prop_assert!(rank(&usual) < 6);
        prop_assert_eq!(rank(&special), 6);
        let (f, g) = (Drift(push), Normal(push));
        let printed = push.reach() / (4.0 * rho.powi(4));
        let ours = differential(&Lie(g, Lie(f, Lie(g, Lie(f, U)))), &x)[1];
        prop_assert!((ours / printed - 1.0).abs() < 1e-9, "{ours} {printed}");
    }

    /// Only a part that bends around the finger can have r + h = 0; the proof then has no word left at s = ±ρ.
    #[test]
    fn theorem_19_says_nothing_where_the_disk_is_centred_on_the_part(push in sliding(0.0), motion in motion()) {
        let push = Sliding { height: -push.radius, ..push };
        let [usual, special] = sliding_differentials(push, &at(motion, push.rho_squared.sqrt()));
        prop_assert!(rank(&usual) < 6 && rank(&special) < 6);
    }

    #[test]
    fn theorem_23_sliding_contact_is_observable(
        push in sliding(0.0), motion in motion(), s in -0.03..0.03, m in prop_oneof![-0.4..-0.05, 0.05..0.4],
    ) {
        let push = Sliding { m, ..push };
        let from_special = f64::abs(s - m * push.height) - push.rho_squared.sqrt();
        prop_assume!(from_special.abs() > 1e-4);
        let [usual, _] = sliding_differentials(push, &at(motion, s));
        prop_assert_eq!(rank(&usual), 6);
    }

    /// At s = mh ± ρ the second set is needed, and fails exactly for tan φ = (r + h)/ρ.
    #[test]
    fn theorem_23_has_its_exception(
        push in sliding(0.0), motion in motion(), side in prop_oneof![Just(1.0), Just(-1.0)], share in prop_oneof![0.2..0.9, 1.1..1.4],
    ) {
        let rho = push.rho_squared.sqrt();
        let ranks = |share: f64| {
            let push = Sliding { m: side * share * push.reach() / rho, ..push };
            let s = push.m * push.height + side * rho;
            sliding_differentials(push, &at(motion, s)).map(|set| rank(&set))
        };
        let ([usual, special], [_, special_excepted]) = (ranks(share), ranks(1.0));
        prop_assert!(usual < 6);
        prop_assert_eq!(special, 6);
        prop_assert!(special_excepted < 6);
    }
}

/// z₁ = x₁, z₂ = x₂ + x₁² of the linear system ż₁ = z₂, ż₂ = input: linear in disguise, so that it has what Theorems 14
/// and 15 ask for.
#[derive(Clone, Copy, Debug)]
struct Disguised;

impl Field<2> for Part3<Disguised> {
    fn at<T: Number>(&self, &[first, second]: &[T; 2]) -> [T; 2] {
        let (zero, rate) = (T::from(0.0), second + first * first);
        match self {
            Drift(_) => [rate, -(first * rate * 2.0)],
            Tangential(_) | Normal(_) => [zero, T::from(1.0)],
        }
    }
}

proptest! {
    /// Theorem 14: its condition 3 asks all repeated derivatives of the output by two inputs or more to vanish. Of (5.26)
    /// L_gN L_f L_gN L_f u does not, with the printed value but at s = 0 and s = ±ρ; u is an angle here, so r is missing.
    #[test]
    fn theorem_14_fails_for_the_disk_and_the_polygon(push in sliding(0.0), motion in motion(), s in -0.03..0.03) {
        let (f, g) = (Drift(push), Normal(push));
        let twice = Lie(g, Lie(f, Lie(g, Lie(f, U))));
        let value = |s: f64| twice.at(&at(motion, s));
        let (rho2, s2): (f64, f64) = (push.rho_squared, s * s);
        let printed = push.reach() * s * (s2 - rho2) / (s2 + rho2).powi(3);
        // Against the largest it can be.
        let scale = push.reach() / rho2.powf(1.5);
        prop_assert!((value(s) - printed).abs() < 1e-9 * scale, "{} {printed}", value(s));
        let rho = rho2.sqrt();
        prop_assert!([0.0, rho, -rho].iter().all(|&s| value(s).abs() < 1e-9 * scale));
        let far = f64::abs(s) > 0.1 * rho && (f64::abs(s) - rho).abs() > 0.1 * rho;
        prop_assert!(!far || value(s).abs() > 1e-4 * scale, "{} of {scale}", value(s));
    }

    /// What Theorem 14 asks of a system that is linear in other coordinates holds: the derivatives are those it speaks of.
    #[test]
    fn theorem_14_holds_for_a_linear_system_in_disguise(x in [-2.0..2.0, -2.0..2.0_f64]) {
        let (f, g) = (Drift(Disguised), Normal(Disguised));
        let columns = [g.at(&x), Bracket(f, g).at(&x)];
        let determinant = columns[0][0] * columns[1][1] - columns[0][1] * columns[1][0];
        prop_assert!(determinant.abs() > 0.5, "{columns:?}");
        let output = Component(0);
        prop_assert_eq!(rank(&[differential(&output, &x), differential(&Lie(f, output), &x)]), 2);
        prop_assert!((Lie(g, Lie(f, output)).at(&x) - 1.0).abs() < 1e-12);
        let words = [
            Lie(g, Lie(g, output)).at(&x),
            Lie(g, Lie(g, Lie(f, output))).at(&x),
            Lie(g, Lie(f, Lie(g, Lie(f, output)))).at(&x),
            Lie(g, Lie(f, Lie(g, Lie(f, Lie(f, output))))).at(&x),
            Lie(g, Lie(g, Lie(f, Lie(f, Lie(f, output))))).at(&x),
        ];
        prop_assert!(words.iter().all(|word| word.abs() < 1e-9), "{words:?}");
    }

    /// Theorem 15's condition holds for it without input, too: g is the field that only the first derivative feels.
    #[test]
    fn theorem_15_holds_for_a_linear_system_in_disguise(x in [-2.0..2.0, -2.0..2.0_f64]) {
        let (f, g) = (Drift(Disguised), Normal(Disguised));
        prop_assert!(Lie(g, Component(0)).at(&x).abs() < 1e-12 && (Lie(g, Lie(f, Component(0))).at(&x) - 1.0).abs() < 1e-12);
        let bracket = Bracket(g, Bracket(f, g)).at(&x);
        prop_assert!(bracket.iter().all(|part| part.abs() < 1e-12), "{bracket:?}");
    }
}

/// Rolling without support friction: state (u, s, ω).
#[derive(Clone, Copy, Debug)]
struct Rolling {
    radius: f64,
    height: f64,
    rho_squared: f64,
}

impl Rolling {
    fn denominator<T: Number>(&self, s: T) -> T {
        s * s + (self.height * self.height + self.rho_squared)
    }
}

impl Field<3> for Part3<Rolling> {
    fn at<T: Number>(&self, &[_, s, omega]: &[T; 3]) -> [T; 3] {
        let zero = T::from(0.0);
        match self {
            Drift(push) => {
                let turn = s * omega * omega * push.radius / push.denominator(s);
                [omega, -(omega * push.radius), turn]
            }
            Tangential(push) => [zero, zero, -(push.denominator(s).recip() * push.height)],
            Normal(push) => [zero, zero, -(s / push.denominator(s))],
        }
    }
}

prop_compose! {
    fn rolling()(radius in 0.005..0.02, height in 0.01..0.03, rho in 0.01..0.03) -> Rolling {
        Rolling { radius, height, rho_squared: rho * rho }
    }
}

/// du, dL_f u and the differentials by which the input along T, then along N, shows s.
fn rolling_differentials(push: Rolling, x: &[f64; 3]) -> [SVector<f64, 3>; 4] {
    let first = Lie(Drift(push), U);
    [
        differential(&U, x),
        differential(&first, x),
        differential(&Lie(Tangential(push), first), x),
        differential(&Lie(Normal(push), first), x),
    ]
}

proptest! {
    /// Theorem 21: the tangential input shows s unless s = 0, where the normal one does.
    #[test]
    fn theorem_21_rolling_contact_is_observable(push in rolling(), s in prop_oneof![-0.03..-0.001, 0.001..0.03], omega in -1.0..1.0) {
        let [u, first, tangential, _] = rolling_differentials(push, &[1.5, s, omega]);
        prop_assert_eq!(rank(&[u, first, tangential]), 3);
        let [u, first, tangential, normal] = rolling_differentials(push, &[1.5, 0.0, omega]);
        prop_assert_eq!(rank(&[u, first, tangential]), 2);
        prop_assert_eq!(rank(&[u, first, normal]), 3);
    }

    /// An edge through the centre of mass (h = 0), touched at s = ±ρ: neither input shows s by itself, but the drift
    /// then carries the contact away from there.
    #[test]
    fn theorem_21_needs_one_derivative_more_on_an_edge_through_the_centre(push in rolling(), omega in prop_oneof![-1.0..-0.1, 0.1..1.0]) {
        let push = Rolling { height: 0.0, ..push };
        let x = [1.5, push.rho_squared.sqrt(), omega];
        prop_assert_eq!(rank(&rolling_differentials(push, &x)), 2);
        let normal = Lie(Normal(push), Lie(Drift(push), U));
        let further = differential(&Lie(Drift(push), normal), &x);
        prop_assert_eq!(rank(&[differential(&U, &x), differential(&Lie(Drift(push), U), &x), further]), 3);
    }

    /// Appendix E: the conditions for linear errors by output injection fail for the simplest rolling push.
    #[test]
    fn appendix_e_no_output_injection_makes_the_errors_linear(push in rolling(), s in -0.03..0.03, omega in prop_oneof![-1.0..-0.2, 0.2..1.0]) {
        let size = push.height * push.height + push.rho_squared;
        prop_assume!(f64::abs(s * s / size - 1.0) > 0.01);
        let x = [1.5, s, omega];
        let f = Drift(push);
        let differentials = [differential(&U, &x), differential(&Lie(f, U), &x), differential(&Lie(f, Lie(f, U)), &x)];
        // Condition 1 holds ...
        prop_assert_eq!(rank(&differentials), 3);
        // ... and g is the field that only the second derivative feels.
        let matrix = SMatrix::<f64, 3, 3>::from_rows(&differentials.map(|row| row.transpose()));
        let solved = matrix.try_inverse().unwrap() * SVector::<f64, 3>::z();
        let unseen = Unseen(push);
        let ours = SVector::<f64, 3>::from(unseen.at(&x));
        prop_assert!((solved - ours).norm() < 1e-9 * ours.norm(), "{solved} {ours}");
        // Condition 2 asks their brackets to vanish, but [g, ad_f g] has the printed component; g is r times the
        // printed one, because u is an angle here.
        let [_, along, _] = Bracket(unseen, Bracket(f, unseen)).at(&x);
        let (r, c, s2) = (push.radius, size, s * s);
        let printed = 2.0 * (c + s2).powi(2) * (-5.0 * c.powi(3) + 9.0 * c * c * s2 - 15.0 * c * s2 * s2 + 3.0 * s2.powi(3))
            / (r.powi(3) * omega.powi(3) * (c - s2).powi(4));
        prop_assert!((along / (r * r * printed) - 1.0).abs() < 1e-7, "{along} {printed}");
        // ad_f g on the way there, of the same g.
        let [none, beside, turn] = Bracket(f, unseen).at(&x);
        let printed = 4.0 * s * (-2.0 * c * c - c * s2 + s2 * s2) / (r * omega * (c - s2).powi(2));
        let scale = 4.0 * c.powf(2.5) / (r * omega.abs() * (c - s2).powi(2));
        prop_assert!(none.abs() < 1e-12 && (beside - r * printed).abs() < 1e-9 * r * scale, "{beside} {printed}");
        prop_assert!((turn + 1.0).abs() < 1e-9, "{turn}");
    }
}

/// g of Appendix E.
#[derive(Clone, Copy)]
struct Unseen(Rolling);

impl Field<3> for Unseen {
    fn at<T: Number>(&self, &[_, s, omega]: &[T; 3]) -> [T; 3] {
        let Self(push) = self;
        let size = push.height * push.height + push.rho_squared;
        let (zero, sum) = (T::from(0.0), push.denominator(s));
        [zero, sum * sum / (omega * omega * (-(s * s) + size) * push.radius), zero]
    }
}

/// The Lie bracket [v, w] = ∂w/∂x v − ∂v/∂x w.
#[derive(Clone, Copy)]
struct Bracket<V, W>(V, W);

impl<const N: usize, V: Field<N>, W: Field<N>> Field<N> for Bracket<V, W> {
    fn at<T: Number>(&self, x: &[T; N]) -> [T; N] {
        let (v, w) = (self.0.at(x), self.1.at(x));
        let along = |direction: [T; N]| std::array::from_fn(|i| Dual::<T, f64>::new(x[i], direction[i]));
        let (w_along_v, v_along_w) = (self.1.at(&along(v)), self.0.at(&along(w)));
        std::array::from_fn(|i| w_along_v[i].eps - v_along_w[i].eps)
    }
}
