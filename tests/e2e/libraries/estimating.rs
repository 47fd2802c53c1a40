//! The kind `observe_push` on contacts from pushes in world coordinates (`palpate_tests::push_oracle`), which share no
//! formula with the estimator: parts on feet, their mass where it likes, any edge.

use palpate::math::random::Draw;
use palpate_files::solve::Problem;
use palpate_files::solve::kinds::observe_push::{ObservePush, ObservePushAnswer, ObservePushStatus};
use palpate_tests::push_oracle::{Motion, Seen, Tangential, World};
use serde_json::{Value, json};

/// Pushes of each mode.
const PUSHES: u64 = 6;
/// Feet under each part.
const FEET: u32 = 12;
/// A foot slower than this may be coming to rest, which the oracle's steps cannot follow, m/s.
const FOOT_SLOW: f64 = 3e-3;
/// The oracle's step, s: friction changes within milliseconds, so its error is about (0.1)⁴ of what follows.
const STEP_S: f64 = 5e-5;
/// Steps between values.
const STEPS: u32 = 200;
/// Values.
const VALUES: u32 = 51;
/// What is told of the oracle's own error, rad: see `STEP_S`.
const SIGMA_RAD: f64 = 1e-5;
/// The bar for exact data: 0.2 mm and 1 mrad.
const PLACE_M: f64 = 2e-4;
/// See [`PLACE_M`].
const TURN_RAD: f64 = 1e-3;

/// A push as a problem, and its truth.
struct Case {
    problem: Value,
    edge: usize,
    end: Seen,
    motion: Motion,
    mass: [f64; 2],
}

/// The first case from a seed on that keeps its contact.
fn case(seed: u64, mode: &str) -> Case {
    let mut draw = Draw::new(seed);
    loop {
        if let Some(case) = try_case(&mut draw, mode) {
            return case;
        }
    }
}

fn try_case(draw: &mut Draw, mode: &str) -> Option<Case> {
    let corner = |draw: &mut Draw, x: f64, y: f64| [x + draw.between(-0.009, 0.009), y + draw.between(-0.009, 0.009)];
    let polygon = [(-0.03, -0.02), (0.03, -0.02), (0.03, 0.02), (-0.03, 0.02)].map(|(x, y)| corner(draw, x, y));
    let edge = usize::try_from(draw.whole() % 4).unwrap();
    let (from, to) = (polygon[edge], polygon[(edge + 1) % 4]);
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    let along = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
    let mass = [draw.between(-0.006, 0.006), draw.between(-0.006, 0.006)];
    let feet: Vec<_> =
        (0..FEET).map(|_| ([draw.between(-0.03, 0.03), draw.between(-0.02, 0.02)], 1.0 / f64::from(FEET))).collect();
    let vertex = [from[0] - mass[0], from[1] - mass[1]];
    let s_min = along[0] * vertex[0] + along[1] * vertex[1];
    let u = draw.between(-3.0, 3.0);
    let heading = u + draw.between(-0.2, 0.2);
    let toward = |size: f64| [size * heading.cos(), size * heading.sin()];
    let world = World {
        normal: [along[1], -along[0]],
        vertex,
        inertia: draw.between(2e-4, 5e-4),
        feet: feet.iter().map(|&([x, y], share)| ([x - mass[0], y - mass[1]], share)).collect(),
        mu_g: draw.between(0.2, 0.4) * 9.81,
        radius: draw.between(0.005, 0.015),
        centre: [draw.between(-0.1, 0.1), draw.between(-0.1, 0.1)],
        velocity: toward(draw.between(0.04, 0.08)),
        acceleration: toward(draw.between(0.0, 0.05)),
    };
    let s = s_min + length * draw.between(0.2, 0.8);
    let omega = draw.between(-0.5, 0.5);
    let rolling = world.seen(0.0, &world.start(u, s, omega, 0.0), Tangential::Multiple(0.0)).slip;
    let (v_t, tangential) = match mode {
        "rolling" => (rolling, Tangential::NoSlip),
        _ => (draw.between(-0.005, 0.005), Tangential::Multiple(0.0)),
    };
    let (mut motion, mut angles) = (world.start(u, s, omega, v_t), Vec::new());
    let mut seen = world.seen(0.0, &motion, tangential);
    for step in 0..=STEPS * (VALUES - 1) {
        let now = f64::from(step) * STEP_S;
        if step % STEPS == 0 {
            seen = world.seen(now, &motion, tangential);
            let on_edge = (s_min..s_min + length).contains(&seen.s);
            if !on_edge || seen.normal_force <= 0.0 {
                return None;
            }
            angles.push(seen.u);
        }
        if world.slowest_foot(&motion) < FOOT_SLOW {
            return None;
        }
        if step < STEPS * (VALUES - 1) {
            motion = world.step(now, &motion, tangential, STEP_S);
        }
    }
    let problem = json!({
        "polygon": polygon, "mu": world.mu_g / 9.81, "g": 9.81, "mode": mode,
        "finger": {
            "radius": world.radius, "centre0": world.centre, "velocity0": world.velocity,
            "acceleration": world.acceleration,
        },
        "support": {"feet": feet.iter().map(|([x, y], share)| [x, y, share]).collect::<Vec<_>>()},
        "centre_of_mass": mass, "inertia_per_mass": world.inertia,
        "dt": f64::from(STEPS) * STEP_S, "contact_angle": angles, "sigma": SIGMA_RAD,
        "prior": {"omega0_sigma": 1.0, "vT0_sigma": 0.01},
    });
    Some(Case { problem, edge, end: seen, motion, mass })
}

fn answer(problem: &Value) -> ObservePushAnswer {
    serde_json::from_value::<ObservePush>(problem.clone()).unwrap().solve().unwrap()
}

fn is_named(mode: &str) {
    for seed in 0..PUSHES {
        let case = case(seed, mode);
        let answer = answer(&case.problem);
        let told = format!("{mode}, seed {seed}: edge {}, {:?}\n{answer:?}\n{}", case.edge, case.end, case.problem);
        let first = answer.hypotheses.first().unwrap_or_else(|| panic!("{told}"));
        let [x, y, angle, ..] = case.motion;
        let (sin, cos) = first.pose_end.theta.sin_cos();
        let [c_x, c_y] = case.mass;
        let off = (first.pose_end.x + cos * c_x - sin * c_y - x).hypot(first.pose_end.y + sin * c_x + cos * c_y - y);
        let turn = (first.pose_end.theta - angle).sin().abs();
        assert!(first.edge == case.edge && (first.s_end - case.end.s).abs() < PLACE_M, "{told}");
        assert!(off < PLACE_M && turn < TURN_RAD && cos * angle.cos() + sin * angle.sin() > 0.0, "{told}");
    }
}

#[test]
fn the_pose_of_a_rolling_part_on_feet_is_named() {
    is_named("rolling");
}

#[test]
fn the_pose_of_a_part_on_feet_without_contact_friction_is_named() {
    is_named("frictionless");
}

#[test]
fn contacts_of_another_part_are_explained_by_nothing() {
    let mut case = case(0, "rolling");
    // Half as large: it turns much faster.
    for vertex in case.problem["polygon"].as_array_mut().unwrap() {
        for coordinate in vertex.as_array_mut().unwrap() {
            *coordinate = json!(coordinate.as_f64().unwrap() / 2.0);
        }
    }
    case.problem["support"] = Value::Null;
    case.problem["centre_of_mass"] = Value::Null;
    case.problem["inertia_per_mass"] = Value::Null;
    let answer = answer(&case.problem);
    assert!(answer.status == ObservePushStatus::Unexplained && answer.hypotheses.is_empty(), "{answer:?}");
    let fit = answer.fit.unwrap();
    assert!(fit.cost.is_none_or(|cost| cost > fit.cost_max), "{fit:?}");
}
