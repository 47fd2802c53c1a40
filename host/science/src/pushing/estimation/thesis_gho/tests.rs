use nalgebra::Point2;
use proptest::prelude::*;

use super::*;
use crate::geometry::SimplePolygon;
use crate::pushing::dynamics::{Part, Slip};

/// A pentagon of some centimetres, m.
const PENTAGON: [[f64; 2]; 5] =
    [[-0.02237, 0.0297], [-0.03108, -0.0037], [-0.01605, -0.03425], [0.02656, -0.02266], [0.02512, 0.01259]];

const DT: f64 = 0.01;

fn part() -> Part {
    Part::uniform(SimplePolygon::new(PENTAGON.map(Point2::from)).unwrap())
}

fn observer(part: &Part, contact: ContactMode, acceleration: [f64; 2]) -> Gho<'_> {
    let finger = Finger {
        radius: 0.01,
        centre0: Point2::origin(),
        velocity0: Vector2::new(0.0, 0.05),
        acceleration: acceleration.into(),
    };
    let model = PushModel { part, edge: part.edge(1).unwrap(), mu_g: 0.3 * 9.81, finger };
    Gho { model, contact, settings: GhoSettings::new(10.0) }
}

/// Steps so short that the simulation counts as exact.
fn measured(observer: &Gho, start: State, count: usize) -> Vec<f64> {
    let fine = observer.model.rollout(&observer.contact, &start, DT / 20.0).skip(19).step_by(20);
    std::iter::once(start.u).chain(fine.map(|state| state.u)).take(count).collect()
}

/// χ by differences of the rates alone.
fn chi(observer: &Gho, time: f64, x: &Vector4<f64>) -> Vector4<f64> {
    let finger = observer.model.finger;
    let steady = Finger { velocity0: finger.velocity(time), acceleration: Vector2::zeros(), ..finger };
    let model = PushModel { finger: steady, ..observer.model };
    let drift = |x: &Vector4<f64>| vector(&model.motion(&observer.contact, 0.0, &state(x)).rates);
    let f = drift(x);
    let look = 1e-4;
    let along = |share: f64| drift(&(x + f * (share * look)))[OMEGA];
    Vector4::new(x[U], x[OMEGA], f[OMEGA], (along(1.0) - along(-1.0)) / (2.0 * look))
}

/// One column of χ's Jacobian, by differences of a share of the state's own scales.
fn slope(observer: &Gho, time: f64, x: &Vector4<f64>, column: usize) -> Vector4<f64> {
    let mut step = Vector4::zeros();
    step[column] = 1e-4 * [1.0, 0.02, 1.0, 0.05][column];
    (chi(observer, time, &(x + step)) - chi(observer, time, &(x - step))) / (2.0 * step[column])
}

fn contacts() -> impl Strategy<Value = ContactMode> {
    prop_oneof![
        Just(ContactMode::Rolling),
        Just(ContactMode::Frictionless),
        Just(ContactMode::Sliding { friction: 0.2, slip: Slip::Backward }),
    ]
}

proptest! {
    /// Against differences of the rates, twice and three times over.
    #[test]
    fn the_correction_moves_chi_by_the_gains(
        contact in contacts(), u in 1.4..1.7, s in -0.01..0.01, omega in 0.2..1.0, v_t in 0.004..0.02, time in 0.0..0.5,
    ) {
        let part = part();
        let observer = observer(&part, contact, [0.01, 0.02]);
        let x = vector(&observer.complete(time, &State { u, s, omega, v_t }));
        let pull = observer.pull(time, &x);
        let states = if contact == ContactMode::Rolling { 3 } else { 4 };
        let moved: Vector4<f64> = (0..states).map(|column| slope(&observer, time, &x, column) * pull[column]).sum();
        let zeta = observer.settings.zeta;
        let gains = if states == 3 {
            vec![3.0 * zeta, 3.0 * zeta.powi(2), zeta.powi(3)]
        } else {
            vec![4.0 * zeta, 6.0 * zeta.powi(2), 4.0 * zeta.powi(3), zeta.powi(4)]
        };
        // Two differences on top of each other, of terms that cancel to the gains.
        let scale = |row: usize| (0..states).map(|column| (slope(&observer, time, &x, column)[row] * pull[column]).abs()).sum::<f64>();
        for (row, gain) in gains.iter().enumerate() {
            let tolerance = 1e-3 * scale(row).max(*gain);
            prop_assert!((moved[row] - gain).abs() < tolerance, "{row}: {} {gain}", moved[row]);
        }
    }

    #[test]
    fn an_observer_that_starts_at_the_truth_stays_there(contact in contacts(), s in -0.01..0.01, omega in 0.1..0.6) {
        const SHORT: f64 = 1e-3;
        /// m per rad and second by which the angle pulls the place: most states have below 1, and singular ones have no
        /// limit.
        const PULL_MAX: f64 = 5.0;
        let part = part();
        let observer = observer(&part, contact, [0.0, 0.025]);
        // Slips backward at 10 cm/s where it slides.
        let start = observer.complete(0.0, &State { u: 1.6, s, omega, v_t: 0.1 });
        let truth: Vec<_> = observer.model.rollout(&contact, &start, SHORT).take(20).collect();
        let angles: Vec<_> = std::iter::once(start.u).chain(truth.iter().map(|state| state.u)).collect();
        let trace = observer.trace(start, &angles, SHORT);
        let pulls = std::iter::once(&start).chain(&truth).map(|state| observer.pull(0.0, &vector(state))[1].abs());
        let pull = pulls.fold(0.0, f64::max);
        // Where the angle hardly shows the place, the observer's map is nearly singular, and any error throws it off.
        prop_assume!(pull < PULL_MAX);
        for (estimate, truth) in trace[1..].iter().zip(&truth) {
            // What contacts interpolated between steps of 1 ms leave, and where it pulls the place in 20 ms: far, where
            // a sliding contact hardly shows it.
            let (u, s) = ((estimate.u - truth.u).abs(), (estimate.s - truth.s).abs());
            prop_assert!(u < 1e-5 && s < 1e-4 + pull * 1e-5 * 0.02, "{estimate:?} {truth:?} {pull}");
        }
    }
}

/// How far an estimate is from the truth, each state in its scale: a radian, the radius of gyration, its rates.
fn error(part: &Part, estimate: &State, truth: &State) -> f64 {
    let length = part.inertia_per_mass().sqrt();
    let along = ((estimate.s - truth.s) / length).hypot((estimate.v_t - truth.v_t) / length);
    (estimate.u - truth.u).hypot(estimate.omega - truth.omega).hypot(along)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    /// Theorem 16 where its conditions hold along the way: errors fall at least as e^(−ζt/3), from beside the truth, with
    /// the correction always on. Rolling by three states, without friction by four.
    #[test]
    fn theorem_16_errors_fall_as_fast_as_the_gains_say(
        rolling in any::<bool>(), u in 1.5..1.65, s in -0.008..0.008, omega in 0.2..0.5, zeta in 30.0..50.0,
        off in [-1.0..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0_f64],
    ) {
        /// s: contacts between two are interpolated.
        const SHORT: f64 = 2.5e-4;
        /// m per rad and second, over ζ³: what the map's inverse makes of the contact angle.
        const PULL_MAX: f64 = 2e-3;
        let part = part();
        let contact = if rolling { ContactMode::Rolling } else { ContactMode::Frictionless };
        let observer = observer(&part, contact, [0.0, 0.02]);
        let settings = GhoSettings { zeta, correction_on: 1.0, correction_off: 0.0 };
        let observer = Gho { settings, ..observer };
        let start = observer.complete(0.0, &State { u, s, omega, v_t: 0.01 });
        // From the start to where e^(−ζt) is 3e-7.
        let steps = (0_u32..).take_while(|&k| f64::from(k) * SHORT < 15.0 / zeta).count();
        let followed = std::iter::once(start).chain(observer.model.rollout(&contact, &start, SHORT));
        let truth: Vec<State> =
            followed.take(steps + 1).enumerate().map(|(i, state)| observer.complete(i as f64 * SHORT, &state)).collect();
        // Condition 1 holds well along all of the way.
        let pulls = truth.iter().enumerate().step_by(20).map(|(i, state)| {
            let pull = observer.pull(i as f64 * SHORT, &vector(state));
            pull[1].abs() / zeta.powi(3)
        });
        prop_assume!(pulls.fold(0.0, f64::max) < PULL_MAX);
        let angles: Vec<_> = truth.iter().map(|state| state.u).collect();
        // So near that the map is straight there, and far beside what interpolation does (4e-8 rad).
        let beside = State {
            u: start.u + 1e-5 * off[0],
            s: start.s + 1e-6 * off[1],
            omega: start.omega + 3e-4 * off[2],
            v_t: start.v_t + 1e-6 * off[3],
        };
        let trace = observer.trace(beside, &angles, SHORT);
        prop_assert_eq!(trace.len(), angles.len());
        let errors: Vec<f64> = trace.iter().zip(&truth).map(|(estimate, truth)| error(&part, estimate, truth)).collect();
        // K(ζ) is what errors grow to at first; it is over by 6/ζ.
        let early = steps * 2 / 5;
        let largest = errors[..early].iter().fold(0.0_f64, |most, error| most.max(*error));
        let wanted = largest * (-zeta * SHORT * (steps - early) as f64 / 3.0).exp();
        prop_assert!(errors[steps] < wanted, "{} of {largest}, wanted {wanted}", errors[steps]);
    }
}

#[test]
fn a_distant_estimate_comes_to_the_truth() {
    let part = part();
    let observer = observer(&part, ContactMode::Rolling, [0.0; 2]);
    let start = State { u: 1.65, s: 0.004, omega: 0.0, v_t: 0.0 };
    let angles = measured(&observer, start, 121);
    let estimate = State { u: 1.5, s: 0.02, omega: 0.7, v_t: 0.0 };
    let trace = observer.trace(estimate, &angles, DT);
    let truth = observer.model.rollout(&observer.contact, &start, DT).nth(119).unwrap();
    let end = trace[120];
    assert!((end.s - truth.s).abs() < 1e-3 && (end.omega - truth.omega).abs() < 0.05, "{end:?} {truth:?}");
}

#[test]
fn whole_turns_of_the_contact_angle_do_not_count() {
    let part = part();
    let observer = observer(&part, ContactMode::Frictionless, [0.0; 2]);
    let start = State { u: 1.6, s: 0.004, omega: 0.2, v_t: 0.0 };
    let angles = measured(&observer, start, 40);
    let turned: Vec<_> =
        angles.iter().zip([0.0, 1.0, 2.0].iter().cycle()).map(|(u, turns)| u + turns * 2.0 * PI).collect();
    let (plain, turned) = (observer.trace(start, &angles, DT), observer.trace(start, &turned, DT));
    assert!(plain.iter().zip(&turned).all(|(a, b)| (a.u - b.u).abs() < 1e-9), "{plain:?} {turned:?}");
}

#[test]
fn the_correction_is_on_and_off_in_turns() {
    let settings = GhoSettings::new(10.0);
    let on: Vec<_> = (0..31).filter(|&i| settings.corrects(f64::from(i) * DT)).collect();
    assert_eq!(on, [0, 1, 2, 3, 4, 5, 10, 11, 12, 13, 14, 15, 20, 21, 22, 23, 24, 25, 30]);
    let with = |[correction_on, correction_off]: [f64; 2]| GhoSettings { zeta: 10.0, correction_on, correction_off };
    assert!((0..100).all(|i| with([0.06, 0.0]).corrects(f64::from(i) * DT)));
    assert!((0..100).all(|i| !with([0.0, 0.04]).corrects(f64::from(i) * DT)));
}

#[test]
fn an_observer_that_diverges_ends_its_trace() {
    let part = part();
    let observer = Gho {
        settings: GhoSettings { zeta: 1e6, correction_on: 1.0, correction_off: 0.0 },
        ..observer(&part, ContactMode::Frictionless, [0.0; 2])
    };
    let start = State { u: 1.2, s: 0.004, omega: 0.2, v_t: 0.0 };
    let trace = observer.trace(start, &[1.6; 200], DT);
    assert!(trace.len() < 200 && trace.iter().all(|state| state.s.is_finite()), "{}", trace.len());
}

/// Pulled a hundred times too hard, an estimate that is still a number after as many steps: the place is a million times
/// the part's size by then, and no explanation.
#[test]
fn an_observer_that_runs_away_is_no_hypothesis() {
    let part = part();
    let contact = ContactMode::Sliding { friction: 0.2, slip: Slip::Backward };
    let observer = Gho {
        settings: GhoSettings { zeta: 400.0, correction_on: 1.0, correction_off: 0.0 },
        ..observer(&part, contact, [0.0; 2])
    };
    let angles: Vec<_> = (0..40).map(|k| 1.6 + 0.1 * f64::from(k % 3)).collect();
    let trace = observer.trace(State { u: 1.2, s: 0.004, omega: 0.2, v_t: 0.1 }, &angles, DT);
    let far = trace.iter().map(|state| state.s.abs()).fold(0.0, f64::max);
    assert!(trace.len() < angles.len() && far < DIVERGED * part.inertia_per_mass().sqrt(), "{} {far}", trace.len());
}
