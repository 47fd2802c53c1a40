use nalgebra::{Point2, Vector2};
use proptest::prelude::*;

use super::*;
use crate::geometry::SimplePolygon;
use crate::gravity::GRAVITY_ASSUMED;
use crate::pushing::dynamics::{ContactLaw, EdgeEnd, Finger, Part, Push, Slip, Start};

mod theorems;

/// A pentagon of some centimetres, m.
const PENTAGON: [[f64; 2]; 5] =
    [[-0.02237, 0.0297], [-0.03108, -0.0037], [-0.01605, -0.03425], [0.02656, -0.02266], [0.02512, 0.01259]];

fn part() -> Part {
    Part::uniform(SimplePolygon::new(PENTAGON.map(Point2::from)).unwrap())
}

fn scales(part: &Part) -> Scales {
    let length = part.inertia_per_mass().sqrt();
    Scales { length, time: (length / GRAVITY_ASSUMED).sqrt() }
}

fn model(part: &Part, edge: usize, mu_g: f64, velocity0: [f64; 2], acceleration: [f64; 2]) -> PushModel<'_> {
    let (velocity0, acceleration) = (velocity0.into(), acceleration.into());
    let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
    PushModel { part, edge: part.edge(edge).unwrap(), mu_g, finger }
}

fn law(contact: &ContactMode) -> ContactLaw {
    match *contact {
        ContactMode::Frictionless => ContactLaw::Frictionless,
        ContactMode::Rolling => ContactLaw::Rolling { friction: None },
        ContactMode::Sliding { friction, slip } => ContactLaw::Sliding { friction, slip },
    }
}

/// Contact angles after `1/8, …, 8/8` of the window, by the error-controlled simulation.
fn simulated(model: &PushModel, contact: &ContactMode, start: State, window: f64) -> Option<Vec<f64>> {
    let push = Push::new(*model, law(contact), Start::Moving(start), EdgeEnd::Extend).ok()?;
    let times: Vec<_> = (1..=8).map(|i| window * f64::from(i) / 8.0).collect();
    let run = push.run(&times).ok()?;
    (run.samples.len() == times.len()).then(|| run.samples.iter().map(|sample| sample.state.u).collect())
}

fn moved(state: &State, direction: &[f64], scales: &Scales, step: f64) -> State {
    let by = |i: usize| direction.get(i).copied().unwrap_or(0.0) * scales.of_states()[i] * step;
    State { u: state.u + by(0), s: state.s + by(1), omega: state.omega + by(2), v_t: state.v_t + by(3) }
}

/// Largest change of u after the start, per unit of the direction, by central differences.
fn change(model: &PushModel, contact: &ContactMode, state: &State, direction: &[f64], scales: &Scales) -> Option<f64> {
    const STEP: f64 = 1e-3;
    // Well within the window, so that the contact lasts.
    let window = scales.time;
    let at = |step: f64| simulated(model, contact, moved(state, direction, scales, step), window);
    let (ahead, behind) = (at(STEP)?, at(-STEP)?);
    Some(ahead.iter().zip(behind).map(|(a, b)| (a - b).abs() / (2.0 * STEP)).fold(0.0, f64::max))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Theorem 13: where the rank is full, a state and one beside it in any direction are told apart by the contact angle
    /// that follows, to first order in how far they are apart, and by no less than the smallest singular value says.
    #[test]
    fn theorem_13_full_rank_tells_neighbouring_states_apart(
        edge in 0..5_usize,
        at in 0.3..0.7,
        u in 1.4..1.7,
        omega in prop_oneof![-1.0..-0.3, 0.3..1.0],
        v_t in -0.003..0.003,
        rolling in any::<bool>(),
        towards in [-1.0..1.0, -1.0..1.0, -1.0..1.0, -1.0..1.0_f64],
    ) {
        let part = part();
        let scales = scales(&part);
        let model = model(&part, edge, 0.3 * GRAVITY_ASSUMED, [0.0, 0.05], [0.01, 0.02]);
        let s = model.edge.s_min + at * (model.edge.s_max - model.edge.s_min);
        let (contact, states) = if rolling { (ContactMode::Rolling, 3) } else { (ContactMode::Frictionless, 4) };
        let state = State { u, s, omega, v_t };
        let state = if rolling { State { v_t: model.rolling_v_t(0.0, &state), ..state } } else { state };
        let spectrum = spectrum(&model, &contact, &state, &scales).unwrap();
        prop_assume!(spectrum.observable());
        let length = towards[..states].iter().map(|x| x * x).sum::<f64>().sqrt();
        prop_assume!(length > 0.2);
        let direction: Vec<f64> = towards[..states].iter().map(|x| x / length).collect();
        let Some(change) = change(&model, &contact, &state, &direction, &scales) else { return Ok(()) };
        // The window of the spectrum is another one; a tenth is far from what rank 3 of 4 would leave, which is 1e-9.
        let least = spectrum.singular_values[states - 1] / spectrum.singular_values[0];
        prop_assert!(change > 0.1 * least, "{change} of {:?}", spectrum.singular_values);
    }

    /// Nothing generic goes unseen.
    #[test]
    fn a_generic_push_shows_its_state(
        edge in 0..5_usize,
        at in 0.1..0.9,
        u in 1.3..1.8,
        omega in prop_oneof![-1.0..-0.2, 0.2..1.0],
        v_t in -0.004..0.004,
        rolling in any::<bool>(),
    ) {
        let part = part();
        let model = model(&part, edge, 0.3 * GRAVITY_ASSUMED, [0.0, 0.05], [0.01, 0.02]);
        let s = model.edge.s_min + at * (model.edge.s_max - model.edge.s_min);
        let contact = if rolling { ContactMode::Rolling } else { ContactMode::Frictionless };
        let spectrum = spectrum(&model, &contact, &State { u, s, omega, v_t }, &scales(&part)).unwrap();
        prop_assert!(spectrum.observable(), "{spectrum:?}");
        prop_assert_eq!(spectrum.singular_values.len(), if rolling { 3 } else { 4 });
    }

    /// Whoever pushes a gliding part with no force cannot feel where; every other change of state is felt.
    #[test]
    fn without_a_force_the_place_on_the_edge_does_not_show(
        edge in 0..5_usize,
        at in 0.1..0.9,
        u in 1.3..1.8,
        v_t in prop_oneof![-0.3..-0.1, 0.1..0.3],
    ) {
        let part = part();
        let (speed, mu_g) = (0.5, 0.3 * GRAVITY_ASSUMED);
        let still = model(&part, edge, mu_g, [0.0, speed], [0.0; 2]);
        let s = still.edge.s_min + at * (still.edge.s_max - still.edge.s_min);
        let state = State { u, s, omega: 0.0, v_t };
        // The finger slows down as the part does by itself along the normal.
        let velocity = still.velocity(&ContactMode::Frictionless, 0.0, &state);
        let normal = -Vector2::new(u.cos(), u.sin());
        let slowing = -normal * (normal.dot(&velocity.normalize()) * mu_g);
        let model = model(&part, edge, mu_g, [0.0, speed], slowing.into());
        let scales = scales(&part);
        let spectrum = spectrum(&model, &ContactMode::Frictionless, &state, &scales).unwrap();
        prop_assert_eq!(&spectrum.unseen, &vec![vec![0.0, 1.0, 0.0, 0.0]], "{:?}", spectrum);
    }
}

/// Directions, by differences of the error-controlled simulation, which shares no derivative with the spectrum.
#[test]
fn unseen_directions_do_not_change_the_simulated_angle_and_others_do() {
    let part = part();
    let scales = scales(&part);
    // No friction anywhere, the finger accelerating along the edge: nothing turns the part.
    let model = model(&part, 0, 0.0, [0.0, 0.05], [0.1, 0.0]);
    let u = std::f64::consts::FRAC_PI_2;
    let state = State { u, s: 0.004, omega: 0.0, v_t: 0.003 };
    let contact = ContactMode::Frictionless;
    let spectrum = spectrum(&model, &contact, &state, &scales).unwrap();
    assert_eq!(spectrum.rank(), 2, "{spectrum:?}");
    for unseen in &spectrum.unseen {
        // The step is 1e-3 and u is exact to 3e-11 rad.
        let change = change(&model, &contact, &state, unseen, &scales);
        assert!(change.is_none_or(|change| change < 1e-6), "{unseen:?}: {change:?}");
    }
    for seen in [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]] {
        let pressed = PushModel { finger: Finger { acceleration: Vector2::new(0.1, 0.01), ..model.finger }, ..model };
        let change = change(&pressed, &contact, &state, &seen, &scales).unwrap();
        assert!(change > 0.1, "{seen:?}: {change}");
    }
}

#[test]
fn singular_values_are_those_of_finite_differences() {
    let part = part();
    let scales = scales(&part);
    let model = model(&part, 1, 0.3 * GRAVITY_ASSUMED, [0.0, 0.05], [0.0, 0.02]);
    let state = State { u: 1.55, s: 0.003, omega: 0.4, v_t: 0.002 };
    for contact in [ContactMode::Frictionless, ContactMode::Sliding { friction: 0.2, slip: Slip::Forward }] {
        let state = match contact {
            // Slips forward at 10 cm/s, so that it lasts over the window.
            ContactMode::Sliding { .. } => State { v_t: model.rolling_v_t(0.0, &state) - 0.1, ..state },
            _ => state,
        };
        let pace = Pace::new(&model, &contact, &state, &scales).unwrap();
        let parameters = [Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT];
        let seeded = Seeded::new(&model, &contact, &state, parameters);
        let window = scales.time / 4.0;
        let steps = 2000;
        let ours = seeded.model.rollout(&seeded.contact, &seeded.start, window / f64::from(steps)).nth(1999).unwrap();
        let (step, end) = (1e-5, 7);
        for (column, name) in STATE_NAMES.iter().enumerate() {
            let mut direction = [0.0; 4];
            direction[column] = 1.0;
            let at = |step: f64| simulated(&model, &contact, moved(&state, &direction, &scales, step), window).unwrap();
            let expected = (at(step)[end] - at(-step)[end]) / (2.0 * step);
            let got = gradient(&ours.u)[column] * scales.of_states()[column];
            // Differences: the square of the step, and 3e-11 of the simulation over 2e-5.
            assert!((got - expected).abs() < 1e-5, "{contact:?} {name}: {got} {expected}");
        }
        assert!(pace.window > window);
    }
}

#[test]
fn a_part_at_rest_and_one_that_jams_have_no_answer() {
    let part = part();
    let scales = scales(&part);
    let model = model(&part, 0, 1.0, [0.0; 2], [0.0, 0.1]);
    let rest = State { u: 1.5, s: 0.0, omega: 0.0, v_t: 0.0 };
    assert_eq!(spectrum(&model, &ContactMode::Frictionless, &rest, &scales), Err(PushObservabilityError::AtRest));
    // D = 1 + s (s − m h)/ρ² is 0 to rounding for s = 0.01 m and this friction.
    let friction = (part.inertia_per_mass() + 1e-4) / (0.01 * model.edge.height);
    let moving = State { omega: 0.1, s: 0.01, ..rest };
    let contact = ContactMode::Sliding { friction, slip: Slip::Forward };
    assert_eq!(spectrum(&model, &contact, &moving, &scales), Err(PushObservabilityError::Jammed));
}
