//! The kind `push` against the same pushes in world coordinates (`palpate_tests::push_oracle`).

#![expect(clippy::unwrap_used, reason = "a test stops at what it cannot read")]

use std::f64::consts::PI;

use palpate::solve::Problem;
use palpate::solve::kinds::push::{Push, PushAnswer, PushSample, Reason};
use palpate_tests::push_oracle::{Motion, Seen, Tangential, World};
use rand_core::{Rng, SeedableRng};
use rand_pcg::Pcg32;
use serde_json::{Value, json};

/// Pushes of each mode.
const PUSHES: u64 = 40;
/// Feet under each part.
const FEET: u32 = 6;
/// A foot slower than this may be coming to rest, which the oracle's steps cannot follow, m/s.
const FOOT_SLOW: f64 = 2e-3;
/// The oracle's step, s: friction changes within milliseconds, so its error is about (0.1)⁴ of what follows.
const STEP_S: f64 = 5e-5;
/// Steps between comparisons.
const STEPS: u32 = 400;
/// The oracle's Runge–Kutta error where a foot comes near the centre of rotation, as an angle.
const ANGLE_RAD: f64 = 1e-6;
/// The same as a length: the part is some centimetres across.
const LENGTH_M: f64 = 1e-7;
/// The same as a force per mass.
const FORCE: f64 = 1e-3;
/// How far from an event the oracle must be on its two sides, s.
const EVENT_S: f64 = 1e-3;

/// A source of problems.
struct Draw(Pcg32);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.0.next_u32()) / f64::from(u32::MAX)
    }
}

/// One push, as a problem and as a world.
struct Case {
    problem: Value,
    world: World,
    start: Motion,
    tangential: Tangential,
}

/// A quadrilateral on feet, its mass where it likes, pushed at an edge by a moving finger.
fn case(seed: u64, mode: &str) -> Case {
    let mut draw = Draw(Pcg32::seed_from_u64(seed));
    let corner = |draw: &mut Draw, x: f64, y: f64| [x + draw.between(-0.008, 0.008), y + draw.between(-0.008, 0.008)];
    let polygon = [(-0.03, -0.02), (0.03, -0.02), (0.03, 0.02), (-0.03, 0.02)].map(|(x, y)| corner(&mut draw, x, y));
    let edge = usize::try_from(seed % 4).unwrap();
    let (from, to) = (polygon[edge], polygon[(edge + 1) % 4]);
    let length = (to[0] - from[0]).hypot(to[1] - from[1]);
    let along = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
    let mass = [draw.between(-0.006, 0.006), draw.between(-0.006, 0.006)];
    let inertia = draw.between(2e-4, 5e-4);
    let u = draw.between(-PI, PI);
    let heading = u + draw.between(-0.2, 0.2);
    let (speed, acceleration) = (draw.between(0.03, 0.09), draw.between(0.0, 0.15));
    let toward = |size: f64| [size * heading.cos(), size * heading.sin()];
    let (mu, mu_c, radius) = (draw.between(0.1, 0.4), draw.between(0.05, 0.4), draw.between(0.0, 0.015));
    let vertex = [from[0] - mass[0], from[1] - mass[1]];
    let s = along[0] * vertex[0] + along[1] * vertex[1] + length * draw.between(0.3, 0.7);
    let feet: Vec<_> =
        (0..FEET).map(|_| ([draw.between(-0.03, 0.03), draw.between(-0.02, 0.02)], 1.0 / f64::from(FEET))).collect();
    let omega = draw.between(-0.5, 0.5);
    let centre = [draw.between(-0.1, 0.1), draw.between(-0.1, 0.1)];
    let world = World {
        normal: [along[1], -along[0]],
        vertex,
        inertia,
        feet: feet.iter().map(|&([x, y], share)| ([x - mass[0], y - mass[1]], share)).collect(),
        grip: mu * 9.81,
        radius,
        centre,
        velocity: toward(speed),
        acceleration: toward(acceleration),
    };
    // Rolling fixes the velocity along the disk: v_T that makes the slip zero. Slip is what v_T falls short of it.
    let rolling = world.seen(0.0, &world.start(u, s, omega, 0.0), Tangential::Multiple(0.0)).slip;
    let slip = if mode == "rolling" {
        0.0
    } else {
        draw.between(0.01, 0.06) * if seed.is_multiple_of(3) { -1.0 } else { 1.0 }
    };
    let v_t = rolling - slip;
    let mut initial = json!({"u": u, "s": s, "omega": omega});
    if mode != "rolling" {
        initial["vT"] = json!(v_t);
    }
    let mut problem = json!({
        "polygon": polygon, "edge": edge, "mu": mu, "g": 9.81, "mode": mode,
        "finger": {"radius": radius, "centre0": centre, "velocity0": world.velocity, "acceleration": world.acceleration},
        "support": {"feet": feet.iter().map(|([x, y], share)| [x, y, share]).collect::<Vec<_>>()},
        "centre_of_mass": mass, "inertia_per_mass": inertia,
        "times": (0..=20).map(|i| f64::from(i * STEPS) * STEP_S).collect::<Vec<_>>(),
    });
    let tangential = match mode {
        "rolling" => Tangential::NoSlip,
        "sliding" => {
            initial["sliding_sign"] = json!(slip.signum());
            problem["mu_c"] = json!(mu_c);
            // Friction on the part is against its slip.
            Tangential::Multiple(-mu_c * slip.signum())
        }
        _ => Tangential::Multiple(0.0),
    };
    problem["initial"] = initial;
    Case { problem, start: world.start(u, s, omega, v_t), world, tangential }
}

fn agrees(sample: &PushSample, motion: &Motion, seen: &Seen) {
    let place = format!("t = {} s: {sample:?}\n{seen:?}\n{motion:?}", sample.t);
    let turn = wrapped(sample.u - seen.u);
    assert!(turn.abs() < ANGLE_RAD && (sample.omega - motion[5]).abs() < 1e2 * ANGLE_RAD, "{place}");
    assert!((sample.s - seen.s).abs() < LENGTH_M, "{place}");
    let velocity = (sample.velocity[0] - motion[3]).hypot(sample.velocity[1] - motion[4]);
    assert!(velocity < 1e2 * LENGTH_M, "{place}");
    assert!((sample.normal_force.unwrap() - seen.normal_force).abs() < FORCE, "{place}");
    assert!((sample.tangential_force.unwrap() - seen.tangential_force).abs() < FORCE, "{place}");
}

/// Follows the oracle beside the answer and tells how many samples agreed.
fn follow(case: &Case, answer: &PushAnswer) -> usize {
    let (mut motion, mut step) = (case.start, 0_u32);
    let mut to = |t: f64| {
        while f64::from(step + 1) * STEP_S <= t + 0.5 * STEP_S {
            motion = case.world.step(f64::from(step) * STEP_S, &motion, case.tangential, STEP_S);
            step += 1;
            if case.world.slowest_foot(&motion) < FOOT_SLOW {
                return None;
            }
        }
        let now = f64::from(step) * STEP_S;
        Some((motion, case.world.seen(now, &motion, case.tangential)))
    };
    for (i, sample) in answer.samples.iter().enumerate() {
        let Some((motion, seen)) = to(sample.t) else { return i };
        agrees(sample, &motion, &seen);
    }
    // Without its events, the oracle goes on: what ended the push changes sign there.
    let margin = |seen: &Seen| match answer.end.reason {
        Reason::Break => seen.normal_force,
        Reason::Stick => seen.slip * case.problem["initial"]["sliding_sign"].as_f64().unwrap(),
        Reason::EdgeLo | Reason::EdgeHi => (seen.s - answer.last.s) * (case.inside() - answer.last.s).signum(),
        other => panic!("{other:?} cannot be judged"),
    };
    if answer.end.reason != Reason::Time && answer.end.t > 2.0 * EVENT_S {
        let last = answer.samples.last().map_or(0.0, |sample| sample.t);
        if answer.end.t - EVENT_S > last {
            let Some((_, seen)) = to(answer.end.t - EVENT_S) else { return answer.samples.len() };
            assert!(margin(&seen) > 0.0, "{:?}: {seen:?} before", answer.end);
        }
        if let Some((_, seen)) = to(answer.end.t + EVENT_S) {
            assert!(margin(&seen) < 0.0, "{:?}: {seen:?} after", answer.end);
        }
    }
    answer.samples.len()
}

impl Case {
    /// A place on the edge between its ends.
    fn inside(&self) -> f64 {
        self.problem["initial"]["s"].as_f64().unwrap()
    }
}

fn compare(mode: &str) {
    let mut compared = 0;
    for seed in 0..PUSHES {
        let case = case(seed, mode);
        let problem: Push = serde_json::from_value(case.problem.clone()).unwrap();
        let answer = problem.solve().unwrap_or_else(|error| panic!("{error}: {}", case.problem));
        compared += follow(&case, &answer);
    }
    // Pushes end early, but not most of them at once.
    assert!(compared > 120, "only {compared} samples were compared");
}

#[test]
fn a_frictionless_push_is_that_of_the_world_frame() {
    compare("frictionless");
}

#[test]
fn a_rolling_push_is_that_of_the_world_frame() {
    compare("rolling");
}

#[test]
fn a_sliding_push_is_that_of_the_world_frame() {
    compare("sliding");
}

/// An angle between −π and π.
fn wrapped(angle: f64) -> f64 {
    (angle + PI).rem_euclid(2.0 * PI) - PI
}

/// What a sample is off by, in tolerances.
fn off_by(got: &Value, want: &Value, tolerance: &Value) -> f64 {
    let number = |value: &Value, key: &str| value[key].as_f64().unwrap();
    let scalar = |key: &str| (number(got, key) - number(want, key)).abs() / number(tolerance, key);
    let vector = |key: &str, i: usize| got[key][i].as_f64().unwrap() - want[key][i].as_f64().unwrap();
    let turn = wrapped(number(got, "u") - number(want, "u")).abs() / number(tolerance, "u");
    let velocity = vector("velocity", 0).hypot(vector("velocity", 1)) / number(tolerance, "velocity");
    let theta = wrapped(vector("pose", 2)).abs() / number(tolerance, "theta");
    let forces = ["normal_force", "tangential_force"]
        .map(|key| (number(got, key) - number(want, key)).abs() / number(tolerance, "force"));
    [turn, scalar("s"), scalar("omega"), scalar("vT"), velocity, theta, forces[0], forces[1]]
        .into_iter()
        .fold(0.0, f64::max)
}

/// The checked problems of `../shared/cases`, at their tolerances.
#[test]
fn public_cases_are_answered_as_expected() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/cases/push.jsonl");
    let Ok(text) = std::fs::read_to_string(path) else {
        eprintln!("NOT CHECKED: ../shared/cases is absent, so no public case was compared");
        return;
    };
    let cases: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert!(cases.len() >= 50, "only {} cases", cases.len());
    for case in cases {
        let (expected, tolerance) = (&case["expected"], &case["tolerance"]);
        let mut problem = case["problem"].clone();
        let id = problem["id"].clone();
        for frame in ["problem", "id"] {
            problem.as_object_mut().unwrap().remove(frame);
        }
        let answer = serde_json::from_value::<Push>(problem).unwrap().solve().unwrap();
        let answer = serde_json::to_value(answer).unwrap();
        if let Some(end) = expected.get("end") {
            assert_eq!(answer["end"]["reason"], end["reason"], "{id}");
            let late = answer["end"]["t"].as_f64().unwrap() - end["t"].as_f64().unwrap();
            assert!(late.abs() <= tolerance["end_time"].as_f64().unwrap(), "{id}: {late:e} s late");
        }
        for want in expected["samples"].as_array().into_iter().flatten() {
            let same_time =
                |sample: &&Value| (sample["t"].as_f64().unwrap() - want["t"].as_f64().unwrap()).abs() < 1e-12;
            let got = answer["samples"].as_array().unwrap().iter().find(same_time).unwrap();
            let off = off_by(got, want, tolerance);
            assert!(off <= 1.0, "{id}: off by {off} tolerances: {got} instead of {want}");
        }
        if let Some(want) = expected.get("initial_acceleration") {
            let got = &answer["initial_acceleration"];
            let off = |i: usize| got["centroid"][i].as_f64().unwrap() - want["centroid"][i].as_f64().unwrap();
            assert!(off(0).hypot(off(1)) <= tolerance["acceleration"].as_f64().unwrap(), "{id}: {got}, {want}");
            let alpha = got["alpha"].as_f64().unwrap() - want["alpha"].as_f64().unwrap();
            assert!(alpha.abs() <= tolerance["alpha"].as_f64().unwrap(), "{id}: {got}, {want}");
        }
    }
}
