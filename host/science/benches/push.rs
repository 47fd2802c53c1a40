//! Pushes in time: the fixed step of observers, with and without derivatives, and the error-controlled run. Run with
//! `cargo bench --bench push`.
//!
//! The bars: 0.8 s of a rolling pentagon at 5 ms steps within 60 µs; 3 s of a block on one to six feet, pushed at 2.5 mm/s,
//! within 50 ms, feet that come to rest included.

mod yardstick;

use std::hint::black_box;

use nalgebra::{Point2, Rotation2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::dynamics::{
    ContactLaw, ContactMode, EdgeEnd, Finger, Mass, Parameter, Part, Push, PushModel, Scalar, Seeded, Slip, Start,
    State,
};
use yardstick::best_of_runs;

/// Length of a push, s.
const DURATION: f64 = 0.8;

/// The observers' step, s.
const STEP: f64 = 0.005;

/// Steps in a push.
const STEPS: usize = 160;

/// Pushes in one run: enough for the clock's grain not to show, few enough for some runs not to be interrupted on a
/// busy computer.
const PUSHES: u32 = 2;

/// Times that the best of some runs is taken.
const RUNS_OF_RUNS: usize = 10;

/// A pentagon of some centimetres, m.
const PENTAGON: [[f64; 2]; 5] =
    [[-0.02237, 0.0297], [-0.03108, -0.0037], [-0.01605, -0.03425], [0.02656, -0.02266], [0.02512, 0.01259]];

fn main() {
    let outline = SimplePolygon::new(PENTAGON.map(Point2::from)).unwrap_or_else(|error| panic!("{error}"));
    let part = Part::uniform(outline);
    let edge = part.edge(1).unwrap_or_else(|error| panic!("{error}"));
    let finger = Finger {
        radius: 0.01,
        centre0: Point2::origin(),
        velocity0: Vector2::new(0.0, 0.05),
        acceleration: Vector2::new(0.0, 0.02),
    };
    let model = PushModel { part: &part, edge, mu_g: 0.3 * 9.81, finger };
    let start = State { u: 1.6, s: 0.002, omega: 0.1, v_t: 0.0 };
    let yardstick_s = per_push(|| yardstick(black_box(start.u)));
    println!(
        "yardstick: 5 square roots, 5 logarithms and 10 divisions a rate, 4 rates a step: {:.1} µs",
        yardstick_s * 1e6
    );
    let report = |name: &str, seconds: f64| {
        println!(
            "{name:58} {:8.1} µs  {:6.1} ns a rate  {:5.2} × yardstick",
            seconds * 1e6,
            seconds * 1e9 / (4 * STEPS) as f64,
            seconds / yardstick_s
        );
    };
    let sliding = ContactMode::Sliding { friction: 0.2, slip: Slip::Forward };
    for (name, contact) in
        [("rolling", ContactMode::Rolling), ("frictionless", ContactMode::Frictionless), ("sliding", sliding)]
    {
        report(&format!("{name}, 160 steps of 5 ms"), per_push(|| roll_out(&model, &contact, &start)));
    }
    let seconds = per_push(|| {
        black_box(black_box(&model).fast_rollout(&ContactMode::Rolling, black_box(&start), STEP).nth(STEPS - 1));
    });
    report("rolling, 160 steps of 5 ms, two rates a step", seconds);
    let parameters = [Parameter::U, Parameter::S, Parameter::Omega];
    let seeded = Seeded::new(&model, &ContactMode::Rolling, &start, parameters);
    let seconds = per_push(|| roll_out(&seeded.model, &seeded.contact, &seeded.start));
    report("rolling with derivatives by u, s and ω", seconds);
    let parameters = [Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT];
    for (name, contact) in [("rolling", ContactMode::Rolling), ("frictionless", ContactMode::Frictionless)] {
        let jets = Seeded::new(&model, &contact, &start, parameters);
        let seconds = per_push(|| roll_out(&jets.model, &jets.contact, &jets.start));
        report(&format!("{name} with jets by u, s, ω and v_T"), seconds);
        let seconds = per_push(|| {
            black_box(black_box(&jets.model).fast_rollout(&jets.contact, black_box(&jets.start), STEP).nth(STEPS - 1));
        });
        report(&format!("{name} with jets, two rates a step"), seconds);
    }
    let law = ContactLaw::Rolling { friction: None };
    let push = Push::new(model, law, Start::Moving(start), EdgeEnd::Extend).unwrap_or_else(|error| panic!("{error}"));
    let seconds = per_push(|| {
        let _ = black_box(black_box(&push).run(&[DURATION]));
    });
    report("rolling, error-controlled with events", seconds);
    on_feet();
}

/// ms that a slow push on feet may take.
const FEET_BAR_MS: f64 = 50.0;

/// Pushes on each number of feet.
const ON_FEET: usize = 20;

/// Length of a slow push, s.
const SLOW_DURATION: f64 = 3.0;

/// m/s.
const SLOW_SPEED: f64 = 2.5e-3;

/// Slow pushes of a block on one to six feet, which come to rest while it turns about them.
fn on_feet() {
    println!(
        "ms a push of {SLOW_DURATION} s at 2.5 mm/s on feet, least of 30 runs each, {ON_FEET} pushes; bar {FEET_BAR_MS} ms"
    );
    println!("{:>5} {:>8} {:>8} {:>8} {:>10}", "feet", "median", "90 %", "most", "no answer");
    for feet in 1..=6 {
        let (mut times, mut unanswered) = (Vec::new(), 0);
        for number in 0..ON_FEET {
            let mut draw = Draw::case(12, number * 6 + feet);
            let part = block_on_feet(feet, &mut draw);
            let push = slow_push(&part, &mut draw);
            unanswered += usize::from(push.run(&[SLOW_DURATION]).is_err());
            let mut run = || {
                let _ = black_box(black_box(&push).run(&[SLOW_DURATION]));
            };
            times.push(1e3 * best_of_runs(&mut run));
        }
        let at = |per_cent| percentile(times.iter().copied(), per_cent).unwrap_or(f64::NAN);
        println!("{feet:>5} {:>8.2} {:>8.2} {:>8.2} {unanswered:>10}", at(50), at(90), at(100));
    }
}

/// A right-angled block with legs of 150 mm on so many feet, anywhere under it, the load anyhow.
fn block_on_feet(count: usize, draw: &mut Draw) -> Part {
    let corners = [[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Point2::from);
    let outline = SimplePolygon::new(corners).unwrap_or_else(|error| panic!("{error}"));
    let foot = |draw: &mut Draw| {
        let (a, b) = (draw.unit(), draw.unit());
        let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
        Point2::new(0.008 + 0.12 * a, 0.008 + 0.12 * b)
    };
    let shares: Vec<_> = (0..count).map(|_| draw.uniform(0.5, 1.5)).collect();
    let sum: f64 = shares.iter().sum();
    let feet: Vec<_> = shares.iter().map(|share| (foot(draw), share / sum)).collect();
    let mass = Mass::uniform(&outline);
    Part::on_feet(outline, &feet, mass)
}

/// A finger of 1 mm that goes straight on into an edge, and the part that goes along.
fn slow_push<'p>(part: &'p Part, draw: &mut Draw) -> Push<'p> {
    let edge = part.edge(draw.index(3)).unwrap_or_else(|error| panic!("{error}"));
    let s = edge.s_min + (edge.s_max - edge.s_min) * draw.uniform(0.25, 0.75);
    let normal = edge.normal;
    let velocity0 = Rotation2::new(draw.uniform(-0.6, 0.6)) * -normal * SLOW_SPEED;
    let point = part.body().centre_of_mass() + normal * edge.height + Vector2::new(-normal.y, normal.x) * s;
    let radius = 1e-3;
    let finger = Finger { radius, centre0: point + normal * radius, velocity0, acceleration: Vector2::zeros() };
    let model = PushModel { part, edge, mu_g: 0.3 * 9.81, finger };
    let state = State { u: (-normal.y).atan2(-normal.x), s, omega: 0.0, v_t: 0.0 };
    let state = State { v_t: model.rolling_v_t(0.0, &state), ..state };
    Push::new(model, ContactLaw::Coulomb { friction: 0.4 }, Start::Moving(state), EdgeEnd::Stop)
        .unwrap_or_else(|error| panic!("{error}"))
}

/// Best time of one push, s.
fn per_push(mut push: impl FnMut()) -> f64 {
    (0..RUNS_OF_RUNS).map(|_| best_of_runs(|| (0..PUSHES).for_each(|_| push()))).fold(f64::INFINITY, f64::min)
        / f64::from(PUSHES)
}

fn roll_out<T: Scalar>(model: &PushModel<T>, contact: &ContactMode<T>, start: &State<T>) {
    black_box(black_box(model).rollout(contact, black_box(start), STEP).nth(STEPS - 1));
}

/// What the friction of a pentagon cannot do without, as often as a push needs it.
fn yardstick(seed: f64) {
    let mut sum = 0.0;
    for i in 0..4 * STEPS * PENTAGON.len() {
        let x = seed + i as f64;
        sum += x.sqrt() + x.ln() + 1.0 / x + 2.0 / (x + 1.0);
    }
    black_box(sum);
}
