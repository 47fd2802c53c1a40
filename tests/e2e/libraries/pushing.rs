//! The kind `push` against the same pushes in world coordinates (`palpate_tests::push_oracle`).

use std::f64::consts::PI;

use palpate::math::random::Draw;
use palpate_files::solve::Problem;
use palpate_files::solve::kinds::push::{Push, PushAnswer, PushEndReasonAnswer, PushSample};
use palpate_tests::project::reference_cases;
use palpate_tests::push_oracle::{Motion, Seen, Tangential, World};
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

/// One push, as a problem and as a world.
struct Case {
    problem: Value,
    world: World,
    start: Motion,
    tangential: Tangential,
}

/// A quadrilateral on feet, its mass where it likes, pushed at an edge by a moving finger.
fn case(seed: u64, mode: &str) -> Case {
    let mut draw = Draw::new(seed);
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
        mu_g: mu * 9.81,
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
        PushEndReasonAnswer::Break => seen.normal_force,
        PushEndReasonAnswer::Stick => seen.slip * case.problem["initial"]["sliding_sign"].as_f64().unwrap(),
        PushEndReasonAnswer::EdgeLo | PushEndReasonAnswer::EdgeHi => {
            (seen.s - answer.last.s) * (case.inside() - answer.last.s).signum()
        }
        other => panic!("{other:?} cannot be judged"),
    };
    if answer.end.reason != PushEndReasonAnswer::Time && answer.end.t > 2.0 * EVENT_S {
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

/// Coulomb's law in the world frame: steps that end where a slip or a friction cone is used up.
struct Switching {
    friction: f64,
    /// 1 or −1 while the part slides, along the edge's counter-clockwise direction; 0 while it rolls.
    slides: f64,
}

/// Bisections of a step to find where it must end: to rounding.
const BISECTIONS: u32 = 50;

impl Switching {
    fn tangential(&self) -> Tangential {
        if self.slides == 0.0 { Tangential::NoSlip } else { Tangential::Multiple(-self.friction * self.slides) }
    }

    /// What keeps the contact as it is; negative once that is over.
    fn margin(&self, world: &World, t: f64, motion: &Motion) -> f64 {
        let seen = world.seen(t, motion, self.tangential());
        if self.slides == 0.0 {
            self.friction * seen.normal_force - seen.tangential_force.abs()
        } else {
            seen.slip * self.slides
        }
    }

    /// A step with what changes in it.
    fn step(&mut self, world: &World, t: f64, motion: &Motion, dt: f64) -> Motion {
        let end = world.step(t, motion, self.tangential(), dt);
        if self.margin(world, t + dt, &end) >= 0.0 || dt < 1e-12 {
            return end;
        }
        let (mut good, mut bad) = (0.0, dt);
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (good + bad);
            let there = world.step(t, motion, self.tangential(), middle);
            if self.margin(world, t + middle, &there) < 0.0 { bad = middle } else { good = middle }
        }
        let there = world.step(t, motion, self.tangential(), good);
        self.change(world, t + good, &there);
        self.step(world, t + good, &there, dt - good)
    }

    /// Rolls if friction suffices; otherwise slides against what it lacks.
    fn change(&mut self, world: &World, t: f64, motion: &Motion) {
        let rolling = world.seen(t, motion, Tangential::NoSlip);
        let (force, most) = (rolling.tangential_force, self.friction * rolling.normal_force);
        self.slides = if self.slides != 0.0 && force.abs() <= most { 0.0 } else { -force.signum() };
    }
}

#[test]
fn coulombs_law_switches_as_in_the_world_frame() {
    let (mut compared, mut changes) = (0, 0);
    for seed in 0..PUSHES {
        let mut case = case(seed, "sliding");
        let friction = case.problem["mu_c"].as_f64().unwrap();
        case.problem["mode"] = json!("coulomb");
        case.problem["initial"].as_object_mut().unwrap().remove("sliding_sign");
        let Tangential::Multiple(multiple) = case.tangential else { panic!("slides at first") };
        let mut law = Switching { friction, slides: -multiple.signum() };
        let answer = serde_json::from_value::<Push>(case.problem.clone()).unwrap().solve().unwrap();
        let (mut motion, mut step) = (case.start, 0);
        'push: for sample in &answer.samples {
            while f64::from(step + 1) * STEP_S <= sample.t + 0.5 * STEP_S {
                motion = law.step(&case.world, f64::from(step) * STEP_S, &motion, STEP_S);
                step += 1;
                if case.world.slowest_foot(&motion) < FOOT_SLOW {
                    break 'push;
                }
            }
            agrees(sample, &motion, &case.world.seen(f64::from(step) * STEP_S, &motion, law.tangential()));
            compared += 1;
        }
        changes += usize::from(law.slides == 0.0);
    }
    assert!(compared > 120 && changes > 10, "only {compared} samples and {changes} changes were compared");
}

/// Largest force or moment (over a centimetre) that nothing explains, m/s²: the start is solved to 1e-9.
const UNEXPLAINED: f64 = 1e-7;

/// A foot that begins to move slower than this may be held, m/s².
const FOOT_HELD: f64 = 1e-3;

/// A start from rest is the one set of accelerations that Newton, Coulomb under the feet and Coulomb at the contact
/// allow.
#[test]
fn starts_from_rest_obey_newton_and_coulomb() {
    let (mut judged, mut slid) = (0, 0);
    for seed in 0..3 * PUSHES {
        let case = case(seed, "sliding");
        let mut problem = case.problem.clone();
        let (u, s) = (problem["initial"]["u"].as_f64().unwrap(), problem["initial"]["s"].as_f64().unwrap());
        let heading = u + 0.6 * f64::from(u32::try_from(seed % 7).unwrap()) / 3.0 - 0.6;
        let finger = [heading.cos() * 0.4, heading.sin() * 0.4];
        problem["mode"] = json!("coulomb");
        problem["initial"] = json!({"u": u, "s": s, "at_rest": true});
        problem["finger"]["velocity0"] = json!([0.0, 0.0]);
        problem["finger"]["acceleration"] = json!(finger);
        problem["times"] = json!([0.0]);
        let answer = serde_json::from_value::<Push>(problem.clone()).unwrap().solve().unwrap();
        let (start, at) = (answer.initial_acceleration.unwrap(), answer.samples[0]);
        let (Some(normal_force), Some(tangential_force)) = (at.normal_force, at.tangential_force) else { continue };
        let ([a_x, a_y], alpha) = (start.centroid, start.alpha);
        // World axes; the contact as seen from the centre of mass, by the oracle's own geometry.
        let (normal, along) = ([-u.cos(), -u.sin()], [u.sin(), -u.cos()]);
        let height = case.world.normal[0] * case.world.vertex[0] + case.world.normal[1] * case.world.vertex[1];
        let contact = [height * normal[0] + s * along[0], height * normal[1] + s * along[1]];
        let turn = (normal[1].atan2(normal[0]) - case.world.normal[1].atan2(case.world.normal[0])).sin_cos();
        let push = [0, 1].map(|i| tangential_force * along[i] - normal_force * normal[i]);
        let mut left = [push[0] - a_x, push[1] - a_y];
        let mut moment = contact[0] * push[1] - contact[1] * push[0] - case.world.inertia * alpha;
        let mut slowest = f64::INFINITY;
        for ([x, y], share) in &case.world.feet {
            let arm = [turn.1 * x - turn.0 * y, turn.0 * x + turn.1 * y];
            let starts = [a_x - alpha * arm[1], a_y + alpha * arm[0]];
            let size = starts[0].hypot(starts[1]);
            slowest = slowest.min(size);
            let friction = starts.map(|component| -case.world.mu_g * share * component / size);
            left = [left[0] + friction[0], left[1] + friction[1]];
            moment += arm[0] * friction[1] - arm[1] * friction[0];
        }
        if slowest < FOOT_HELD {
            continue;
        }
        assert!(left[0].hypot(left[1]) < UNEXPLAINED && moment.abs() < 1e-2 * UNEXPLAINED, "{seed}: {left:?} {moment}");
        let relative = [a_x - alpha * contact[1] - finger[0], a_y + alpha * contact[0] - finger[1]];
        let parts = relative[0] * normal[0] + relative[1] * normal[1];
        let slips = relative[0] * along[0] + relative[1] * along[1];
        let friction = problem["mu_c"].as_f64().unwrap();
        assert!(parts.abs() < UNEXPLAINED && normal_force > 0.0, "{seed}: the contact parts at {parts} m/s²");
        if slips.abs() < UNEXPLAINED {
            assert!(tangential_force.abs() <= friction * normal_force + UNEXPLAINED, "{seed}: beyond the cone");
        } else {
            let against = tangential_force + friction * normal_force * slips.signum();
            assert!(against.abs() < UNEXPLAINED, "{seed}: {against} m/s² off sliding friction");
            slid += 1;
        }
        judged += 1;
    }
    assert!(judged > 60 && slid > 5 && slid < judged, "{judged} starts, {slid} of them sliding");
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
    let Some(cases) = reference_cases("push") else { return };
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
