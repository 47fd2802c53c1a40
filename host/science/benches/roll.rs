//! Rolling in time: the fixed step of observers, alone and with sensitivities, and a whole estimate. Run with
//! `cargo bench --bench roll`.
//!
//! The bars: 200 ns a step, 1 µs with six sensitivities, 30 ms for an estimate from 0.4 s of contacts. A step's floor
//! is the chain of its four stages, each some 80 cycles of operations that wait for each other: about 110 ns at 3 GHz.

mod yardstick;

use std::hint::black_box;

use nalgebra::{Quaternion, Vector2, Vector3};
use palpate::rolling::{
    BodyKnowledge, Columns, Model, Noise, PalmAcceleration, PalmKnowledge, RollQuestion, RollState, RollingBody, Spin,
    StateWithTangent, specific_force,
};
use yardstick::best_of_runs;

/// The observers' step, s.
const STEP: f64 = 0.004;

/// Steps in a run: short enough that a busy machine leaves some of the runs alone.
const STEPS: u32 = 2000;

/// Square roots, divisions and products of the yardstick: about what one Runge–Kutta step of an ellipsoid needs.
const YARDSTICK: [u32; 3] = [8, 20, 600];

fn main() {
    let yardstick_s = best_of_runs(|| (0..STEPS).for_each(|k| yardstick(f64::from(k)))) / f64::from(STEPS);
    let [roots, divisions, products] = YARDSTICK;
    println!(
        "yardstick: {roots} square roots, {divisions} divisions, {products} products and sums: {:.0} ns",
        yardstick_s * 1e9
    );
    let report = |name: &str, seconds: f64| {
        println!("{name:48} {:9.0} ns  {:6.2} × yardstick", seconds * 1e9, seconds / yardstick_s);
    };
    let body = ellipsoid();
    for spin in [Spin::Free, Spin::NoSpin] {
        let model = Model { body: &body, spin };
        let name = format!("{spin:?}").to_lowercase();
        report(&format!("RK4 step, spin {name}"), step(&model));
        report(&format!("RK4 step with 6 sensitivities, spin {name}"), step_with::<6>(&model, Columns::STATE));
        let all = Columns { semi_axes: true, palm: true };
        report(&format!("RK4 step with 12 sensitivities, spin {name}"), step_with::<12>(&model, all));
        report(&format!("estimate from 0.4 s at 500 Hz, 1 mm, spin {name}"), estimate(&model));
    }
}

fn ellipsoid() -> RollingBody {
    RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap_or_else(|error| panic!("{error}"))
}

fn start(model: &Model) -> RollState {
    let orientation = Quaternion::new(0.3, -0.5, 0.7, 0.2).normalize();
    let mut state = RollState { orientation, omega: Vector3::new(2.0, -3.0, 1.5), u: Vector2::zeros() };
    if model.spin == Spin::NoSpin {
        let normal = state.normal();
        state.omega -= normal * normal.dot(&state.omega);
    }
    state
}

fn weight() -> [Vector3<f64>; 3] {
    [specific_force(Vector3::zeros(), 9.81); 3]
}

/// Best time of one step, s.
fn step(model: &Model) -> f64 {
    let (begun, specific_force) = (start(model), weight());
    best_of_runs(|| {
        let end = (0..STEPS).fold(black_box(begun), |state, _| model.step(&state, &specific_force, STEP));
        black_box(end);
    }) / f64::from(STEPS)
}

fn step_with<const N: usize>(model: &Model, columns: Columns) -> f64 {
    let (begun, specific_force) = (start(model), weight());
    best_of_runs(|| {
        let seed = black_box(StateWithTangent::<N>::seed(&begun));
        // A new seed now and then keeps the sensitivities from overflowing.
        let end = (0..STEPS).fold(seed, |here, k| {
            let here = if k % 100 == 0 { StateWithTangent { state: here.state, ..seed } } else { here };
            model.step_with(columns, &here, &specific_force, STEP)
        });
        black_box(end);
    }) / f64::from(STEPS)
}

fn estimate(model: &Model) -> f64 {
    let specific_force = weight();
    let path = std::iter::successors(Some(start(model)), |state| Some(model.step(state, &specific_force, 0.002)));
    let rounded: Vec<_> = path.take(201).map(|state| state.u.map(|x| (x * 1e3).round() * 1e-3)).collect();
    let question = RollQuestion {
        body: BodyKnowledge::OneOf(vec![model.body.clone()]),
        spins: vec![model.spin],
        palm: PalmKnowledge::Known(PalmAcceleration::Rest),
        g: 9.81,
        noise: Noise::Grid(1e-3),
    };
    best_of_runs(|| {
        let _ = black_box(question.answer(0.002, black_box(&rounded)));
    })
}

/// Arithmetic in chains of four, as vectors of three give it to a processor.
fn yardstick(seed: f64) {
    let [roots, divisions, products] = YARDSTICK;
    let mut lanes = [seed + 1.0, seed + 2.0, seed + 3.0, seed + 4.0];
    for k in 0..products / 4 {
        for lane in &mut lanes {
            *lane = *lane * 0.999 + 0.5;
        }
        if k % (products / 4 / divisions) == 0 {
            lanes[0] = 1.0 / (lanes[1] + 1.0);
        }
        if k % (products / 4 / roots) == 0 {
            lanes[2] = (lanes[3] + 1.0).sqrt();
        }
    }
    black_box(lanes);
}
