//! Inscription of polygons in cones, compared with one pass over the vertices that computes a sine and a cosine each.
//! Run with `cargo bench --bench inscription`.
//!
//! Bars, two cones: ≤ 1 µs with 10 vertices, ≤ 30 µs with 1000; ten cones cost ≤ 0.5 µs more than two with 10 vertices.
//! From the cones' angles to the poses; the polygon is prepared once, as it is for a part that is seen again and again.

mod yardstick;

use std::f64::consts::TAU;
use std::hint::black_box;

use nalgebra::Point2;
use palpate::geometry::{ConvexPolygon, SimplePolygon};
use palpate::inscription::{Cone, HalfPlane, Inscription, Pose, poses, view};
use palpate::math::random::Draw;
use yardstick::best_of_runs;

/// Vertices of the polygons.
const VERTICES: [u32; 5] = [5, 10, 30, 100, 1000];

/// Vertices visited in one timed run: a tenth of a millisecond, so that some runs are not interrupted on a busy
/// computer.
const VERTICES_A_RUN: u32 = 4000;

/// Problems of each size, so that no branch is learnt by heart.
const PROBLEMS: u32 = 16;

/// A polygon and how it is seen.
struct Case {
    outline: SimplePolygon,
    part: ConvexPolygon,
    cones: Vec<Cone>,
}

fn main() {
    println!("µs a problem; in brackets the ratio to a sine and a cosine for each vertex");
    println!(
        "{:>8} {:>10} {:>16} {:>16} {:>16} {:>16}",
        "vertices", "yardstick", "two cones", "ten cones", "preparation", "poses of two"
    );
    for vertices in VERTICES {
        measure(vertices);
    }
}

fn measure(vertices: u32) {
    let cases = |cones: u32| (0..PROBLEMS).map(|k| case(vertices, cones, k)).collect::<Vec<_>>();
    let (two, ten) = (cases(2), cases(10));
    let unit = time(vertices, &two, |case| sines_and_cosines(&case.outline));
    let two_us = time(vertices, &two, solve);
    let ten_us = time(vertices, &ten, solve);
    let preparation = time(vertices, &two, |case| ConvexPolygon::new(&case.outline).map_or(0.0, |part| part.size()));
    let found: f64 = two.iter().map(solve).sum::<f64>() / f64::from(PROBLEMS);
    let column = |us: f64| format!("{us:.2} ({:.2})", us / unit);
    println!(
        "{vertices:>8} {unit:>10.3} {:>16} {:>16} {:>16} {found:>16.2}",
        column(two_us),
        column(ten_us),
        column(preparation)
    );
}

/// Random points of an ellipse 2 m by 1.2 m across, seen from places up to 2 m from its centre.
fn case(vertices: u32, cones: u32, seed: u32) -> Case {
    let mut draw = Draw::case(u64::from(vertices), seed as usize);
    let mut angles: Vec<_> = (0..vertices).map(|_| draw.uniform(0.0, TAU)).collect();
    angles.sort_by(f64::total_cmp);
    let corners: Vec<_> = angles.iter().map(|angle| Point2::new(angle.cos(), 0.6 * angle.sin())).collect();
    let outline = SimplePolygon::new(corners).unwrap_or_else(|error| panic!("{error}"));
    let part = ConvexPolygon::new(&outline).unwrap_or_else(|error| panic!("{error}"));
    let pose = Pose { x: 0.3, y: -0.2, theta: draw.uniform(0.0, TAU) };
    let cone = |_| {
        let (distance, angle) = (draw.uniform(1.2, 2.0), draw.uniform(0.0, TAU));
        let apex = Point2::new(pose.x + distance * angle.cos(), pose.y + distance * angle.sin());
        let [right, left] = view(&part, &pose, apex).unwrap_or_else(|| panic!("the sensor is outside"));
        Cone::new(apex, right.angle, left.angle).unwrap_or_else(|error| panic!("{error}"))
    };
    let cones = (0..cones).map(cone).collect();
    Case { outline, part, cones }
}

/// How many poses there are.
fn solve(case: &Case) -> f64 {
    let lines: Vec<HalfPlane> = case.cones.iter().flat_map(Cone::half_planes).collect();
    match poses(&case.part, &lines) {
        Inscription::Poses(poses) => f64::from(u32::try_from(poses.len()).unwrap_or(u32::MAX)),
        Inscription::Underdetermined(_) => f64::NAN,
    }
}

/// The yardstick.
fn sines_and_cosines(outline: &SimplePolygon) -> f64 {
    outline.vertices().iter().map(|p| p.x.sin() + p.y.cos()).sum()
}

/// Microseconds for one problem.
fn time(vertices: u32, cases: &[Case], mut work: impl FnMut(&Case) -> f64) -> f64 {
    let rounds = (VERTICES_A_RUN / vertices / PROBLEMS).max(1);
    let seconds = best_of_runs(|| {
        let mut sum = 0.0;
        for _ in 0..rounds {
            sum += cases.iter().map(|case| work(black_box(case))).sum::<f64>();
        }
        black_box(sum);
    });
    seconds / f64::from(rounds * PROBLEMS) * 1e6
}
