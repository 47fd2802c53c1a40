//! How well time limits are kept: `cargo bench -p palpate-files --bench time_limits [NAME]`.
//!
//! Problems that take much longer than their limit are told to stop after 0.3 s of the thread's own processor time, so
//! that what else runs on the computer does not count. Told are the longest time between two questions whether to stop,
//! as a multiple of the 5 ms after which there should be one, and what was used beyond the limit, as a multiple of what
//! may be: a tenth of it, or 100 ms if that is more. Bar: at most 1 in the last column. With `PALPATE_GAPS` set, who looked
//! after a long time without a look is shown.

#![allow(clippy::unwrap_used, reason = "a benchmark stops at the first surprise")]

use std::f64::consts::{FRAC_PI_2, TAU};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use palpate_files::solve::kinds::corner_poses::CornerPoses;
use palpate_files::solve::kinds::initial_pose::InitialPose;
use palpate_files::solve::kinds::inscription::Inscription;
use palpate_files::solve::kinds::observe_push::ObservePush;
use palpate_files::solve::kinds::observe_roll::ObserveRoll;
use palpate_files::solve::kinds::point_sampling::PointSampling;
use palpate_files::solve::kinds::push::Push;
use palpate_files::solve::kinds::roll::Roll;
use palpate_files::solve::{Problem, SolveError};
use serde_json::{Value, json};

const LIMIT: Duration = Duration::from_millis(300);

/// A look every so often is wanted.
const LOOK_EACH: Duration = Duration::from_millis(5);

/// What may be used beyond a limit, if it is more than a tenth.
const BEYOND: Duration = Duration::from_millis(100);

/// Clock time after which it is worth asking for processor time, which takes a microsecond or two.
const WORTH_ASKING: Duration = Duration::from_micros(200);

fn main() {
    let wanted = std::env::args().skip(1).find(|word| !word.starts_with('-'));
    let is_wanted = |name: &str| wanted.as_ref().is_none_or(|wanted| name.contains(wanted.as_str()));
    println!("{:<28} {:>8} {:>10} {:>13} {:>13}  ended", "problem", "looks", "used [s]", "gap / 5 ms", "over / may be");
    let cases: Vec<(&str, Case)> = vec![
        ("sampling, 40 rectangles", case::<PointSampling>(rectangles(40, "fewest"))),
        ("sampling, 150 rectangles", case::<PointSampling>(rectangles(150, "fewest"))),
        ("sampling, 600 rectangles", case::<PointSampling>(rectangles(600, "fewest"))),
        ("sampling, 600, greedy", case::<PointSampling>(rectangles(600, "greedy"))),
        ("sampling, 2000 rectangles", case::<PointSampling>(rectangles(2000, "fewest"))),
        ("initial pose, friction", case::<InitialPose>(initial_pose(json!({"type": "ellipse", "a": 0.03, "b": 0.02})))),
        (
            "initial pose, 1000-gon",
            case::<InitialPose>(initial_pose(json!({"type": "polygon", "vertices": round(1000)}))),
        ),
        ("push at 1 nm/s", case::<Push>(push("rolling", 1e-9, vec![1e3, 1e5]))),
        ("push at 1 nm/s, frictionless", case::<Push>(push("frictionless", 1e-9, vec![1e3, 1e5]))),
        ("push, 10⁶ samples", case::<Push>(push("rolling", 1e-3, even(1_000_000, 1e-5)))),
        ("observe push, magnitudes", case::<ObservePush>(magnitudes(600))),
        ("observe push, 1000-gon", case::<ObservePush>(angles(round(1000), "rolling", 13, 0.02))),
        ("observe push, Coulomb", case::<ObservePush>(angles(round(1000), "coulomb", 13, 0.02))),
        ("observe push, 6000 angles", case::<ObservePush>(angles(json!(BLOCK), "coulomb", 6000, 5e-4))),
        ("observe roll, 1000 bodies", case::<ObserveRoll>(bodies(1000, 31))),
        ("observe roll, 3000 contacts", case::<ObserveRoll>(bodies(1, 3000))),
        ("observe roll, all unknown", case::<ObserveRoll>(unknown_body(61))),
        ("roll, for a day", case::<Roll>(roll(even(86_400, 1.0)))),
        ("inscription, 1000 cones", case::<Inscription>(cones(1000, 1000))),
        ("inscription, 30 cones", case::<Inscription>(cones(1000, 30))),
        (
            "corner, 30,000-gon",
            case::<CornerPoses>(json!({"polygon": round(30_000), "corner_angle": 1.5, "push": [-1, -1]})),
        ),
    ];
    for (name, case) in cases {
        if is_wanted(name) {
            let Run { looks, used, gap, ended } = case();
            let over = used.saturating_sub(LIMIT).as_secs_f64() / BEYOND.max(LIMIT / 10).as_secs_f64();
            let gap = gap.as_secs_f64() / LOOK_EACH.as_secs_f64();
            println!("{name:<28} {looks:>8} {:>10.3} {gap:>13.2} {over:>13.2}  {ended}", used.as_secs_f64());
        }
    }
}

type Case = Box<dyn FnOnce() -> Run>;

/// How a problem was worked on.
struct Run {
    looks: usize,
    used: Duration,
    /// The longest without a look.
    gap: Duration,
    ended: String,
}

/// How a search has asked whether to end.
struct Looks {
    count: usize,
    /// The longest time that it worked without asking.
    gap: Duration,
    /// When it asked last, and how long it had worked.
    asked: Instant,
    used: Duration,
    is_over: bool,
}

fn case<P: Problem>(problem: Value) -> Case {
    Box::new(move || {
        let problem: P = serde_json::from_value(problem).unwrap();
        let begun = processor_time();
        let looks =
            Mutex::new(Looks { count: 0, gap: Duration::ZERO, asked: Instant::now(), used: begun, is_over: false });
        let stop = || {
            let mut looks = looks.lock().unwrap();
            looks.count += 1;
            if looks.asked.elapsed() >= WORTH_ASKING {
                let now = processor_time();
                let gap = now.saturating_sub(looks.used);
                if !looks.is_over {
                    looks.gap = looks.gap.max(gap);
                    trace(gap);
                }
                looks.is_over = now.saturating_sub(begun) >= LIMIT;
                (looks.asked, looks.used) = (Instant::now(), now);
            }
            looks.is_over
        };
        let ended = match problem.solve_until(&stop) {
            Ok(searched) if searched.complete => "whole".to_owned(),
            Ok(_) => "with what was found".to_owned(),
            Err(SolveError::Stopped) => "with nothing".to_owned(),
            Err(error) => error.to_string(),
        };
        let Looks { count, gap, .. } = looks.into_inner().unwrap();
        Run { looks: count, used: processor_time().saturating_sub(begun), gap, ended }
    })
}

/// Says who looked, after a time without a look that is nearly too long, if `PALPATE_GAPS` is set.
fn trace(gap: Duration) {
    if gap > LOOK_EACH * 4 / 5 && std::env::var_os("PALPATE_GAPS").is_some() {
        eprintln!("{gap:?} before this look:\n{}", std::backtrace::Backtrace::force_capture());
    }
}

/// What this thread has used of the processor.
#[cfg(unix)]
fn processor_time() -> Duration {
    rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime).try_into().unwrap()
}

/// Where the system is not asked, the time since the program began.
#[cfg(not(unix))]
fn processor_time() -> Duration {
    since_begun()
}

#[cfg(not(unix))]
fn since_begun() -> Duration {
    static BEGUN: std::sync::OnceLock<Instant> = std::sync::OnceLock::new();
    BEGUN.get_or_init(Instant::now).elapsed()
}

const BLOCK: [[f64; 2]; 4] = [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]];

fn count(number: usize) -> f64 {
    f64::from(u32::try_from(number).unwrap())
}

fn even(number: usize, step: f64) -> Vec<f64> {
    (0..number).map(|index| step * count(index)).collect()
}

/// A regular polygon of 6 cm.
fn round(vertices: usize) -> Value {
    let corner = |index| (TAU * count(index) / count(vertices)).sin_cos();
    (0..vertices).map(corner).map(|(sin, cos)| json!([0.03 * cos, 0.03 * sin])).collect()
}

/// Numbers in [0, 1) that look random: the golden ratio's multiples.
fn scattered(index: usize, ratio: f64) -> f64 {
    (count(index) * ratio).fract()
}

fn rectangles(number: usize, objective: &str) -> Value {
    let rectangle = |index: usize| {
        let [x, y] = [0.618_033_988_75, 0.754_877_666_25].map(|ratio| scattered(index, ratio));
        let [w, h] = [0.569_840_290_998, 0.324_717_957_2].map(|ratio| 0.3 + 0.3 * scattered(index, ratio));
        json!([[x, y], [x + w, y], [x + w, y + h], [x, y + h]])
    };
    json!({"polygons": (0..number).map(rectangle).collect::<Vec<_>>(), "objective": objective})
}

fn initial_pose(object: Value) -> Value {
    json!({
        "finger": {"type": "ellipse", "a": 0.02, "b": 0.01, "acceleration": [0.01, 0.1]}, "object": object, "mu": 0.3,
        "g": 0.05, "u0": 1.2, "contacts": [[0.3, 1.25], [0.5, 1.3]],
    })
}

fn push(mode: &str, speed: f64, times: Vec<f64>) -> Value {
    let mut initial = json!({"u": FRAC_PI_2, "s": 0.01, "omega": 0.0});
    if mode != "rolling" {
        initial["vT"] = json!(0.1 * speed);
    }
    json!({
        "polygon": BLOCK, "edge": 0, "mu": 0.3, "mode": mode, "initial": initial, "times": times,
        "finger": {"radius": 0.01, "centre0": [0, -0.03], "velocity0": [0.3 * speed, speed], "acceleration": [0, 0]},
        "stop_at_edge_end": false,
    })
}

fn finger() -> Value {
    json!({"radius": 0.01, "centre0": [0, 0], "velocity0": [0, 0.05], "acceleration": [0, 0]})
}

fn magnitudes(number: usize) -> Value {
    let value = |index| 2.9 + 5e-4 * count(index) + 1e-3 * (scattered(index, 0.618_033_988_75) - 0.5);
    json!({
        "polygon": BLOCK, "mu": 0.3, "mode": "rolling", "finger": finger(), "dt": 1e-3, "mu_sigma_log": 0.2,
        "force_magnitude": (0..number).map(value).collect::<Vec<_>>(), "sigma_magnitude_log": 0.01,
    })
}

fn angles(polygon: Value, mode: &str, number: usize, dt: f64) -> Value {
    let value = |index| 1.6 + 0.2 * count(index) * dt + 1e-3 * scattered(index, 0.618_033_988_75);
    json!({
        "polygon": polygon, "mu": 0.3, "mode": mode, "mu_c": 0.3, "finger": finger(), "dt": dt, "sigma": 1e-3,
        "contact_angle": (0..number).map(value).collect::<Vec<_>>(),
    })
}

fn contacts(number: usize) -> Value {
    (0..number).map(|index| json!([1e-3 * (0.3 * count(index)).sin(), 5e-4 * count(index)])).collect()
}

fn bodies(number: usize, readings: usize) -> Value {
    let body = |index| json!({"ellipsoid": [0.02 + 1e-5 * count(index), 0.03, 0.04]});
    json!({
        "bodies": (0..number).map(body).collect::<Vec<_>>(), "spin": "none", "palm_acceleration": null,
        "dt": 0.6 / count(readings), "u": contacts(readings), "noise": {"gauss": 1e-5},
    })
}

fn unknown_body(readings: usize) -> Value {
    json!({
        "body": {"ellipsoid": "unknown"}, "spin": "unknown", "palm_acceleration": "unknown_constant", "dt": 0.02,
        "u": contacts(readings), "noise": {"gauss": 1e-5},
    })
}

fn roll(times: Vec<f64>) -> Value {
    json!({
        "body": {"ellipsoid": [0.02, 0.03, 0.04]}, "spin": "free", "palm_acceleration": null, "times": times,
        "initial": {"orientation": [1, 0, 0, 0], "omega": [1, 0.5, 0.2], "u": [0, 0]},
    })
}

fn cones(vertices: usize, number: usize) -> Value {
    let cone = |index| {
        let around = TAU * count(index) / count(number);
        let (back, half) = (around + TAU / 2.0, 0.15 + 1e-3 * scattered(index, 0.618_033_988_75));
        json!({"apex": [0.2 * around.cos(), 0.2 * around.sin()], "right": back - half, "left": back + half})
    };
    json!({"polygon": round(vertices), "cones": (0..number).map(cone).collect::<Vec<_>>(), "sigma": 1e-3})
}
