//! Support friction of polygons, compared with one square root, one logarithm and two divisions an edge. Run with
//! `cargo bench --bench friction`.
//!
//! Bars, as ratios to that yardstick measured in the same run: integrals ≤ 2.0, with their gradient ≤ 2.7, vectorised ≤
//! 1.2; and time proportional to the number of edges up to 10,000.

mod yardstick;

use std::f64::consts::TAU;
use std::hint::black_box;

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::pushing::dynamics::support::{SupportFriction, Twist};
use yardstick::best_of_turns;

/// Edges in the polygons; the first is the thesis's.
const EDGES: [u32; 5] = [3, 7, 64, 1000, 10_000];

/// Evaluations of an edge in one timed run: a tenth of a millisecond, so that some runs are not interrupted on a busy
/// computer.
const EDGES_A_RUN: u32 = 20_000;

/// What the thesis took for the integral of a 7-gon and for its partial derivatives, s (Lisp on a Sparcstation 20, ch.
/// 6).
const THESIS_7_GON_S: [f64; 2] = [0.183, 1.118];

fn main() {
    println!(
        "ns an edge, centres of rotation within 6 cm of a part 6 to 10 cm across; in brackets the ratio to the yardstick"
    );
    println!(
        "{:>6} {:>10} {:>16} {:>16} {:>16} {:>13}",
        "edges", "yardstick", "integrals", "with gradient", "many at once", "far away, ns"
    );
    for edges in EDGES {
        measure(edges);
    }
}

fn measure(edges: u32) {
    let Ok(polygon) = polygon(edges) else { return };
    let support = SupportFriction::uniform(&polygon);
    let (near, far) = (twists(0.0..0.06), twists(0.6..6.0));
    let with_gradient = |twist: &Twist| {
        let (sliding, gradient) = support.mean_sliding_and_gradient(twist);
        sliding.moment + gradient[(0, 0)] + gradient[(2, 2)]
    };
    let [unit, integrals, gradient, many, far] = best_of_turns([
        &mut || evaluate(edges, &near, |twist| roots_and_logarithms(&polygon, twist)),
        &mut || evaluate(edges, &near, |twist| support.mean_sliding(twist).moment),
        &mut || evaluate(edges, &near, with_gradient),
        &mut || evaluate_many(edges, &near, &support),
        &mut || evaluate(edges, &far, |twist| support.mean_sliding(twist).moment),
    ])
    .map(|seconds| seconds / f64::from(evaluations(edges)) * 1e9);
    let column = |ns: f64| format!("{:.2} ({:.2})", ns / f64::from(edges), ns / unit);
    println!(
        "{edges:>6} {:>10.2} {:>16} {:>16} {:>16} {far:>13.0}",
        unit / f64::from(edges),
        column(integrals),
        column(gradient),
        column(many)
    );
    if edges == 7 {
        let [a, b] = THESIS_7_GON_S;
        println!(
            "       the 7-gon: {integrals:.0} ns against {a} s in the thesis, {:.1e} times faster;",
            a / integrals * 1e9
        );
        println!(
            "       with all partial derivatives {gradient:.0} ns against {b} s, {:.1e} times faster",
            b / gradient * 1e9
        );
    }
}

/// A star with long and short rays, 6 to 10 cm across, not convex.
fn polygon(edges: u32) -> Result<SimplePolygon, palpate::geometry::PolygonError> {
    let corner = |i: u32| {
        let (angle, radius) = (TAU * f64::from(i) / f64::from(edges), 0.03 + 0.02 * f64::from(i * 7919 % 101) / 101.0);
        Point2::new(radius * angle.cos(), radius * angle.sin())
    };
    SimplePolygon::new((0..edges).map(corner).collect::<Vec<_>>())
}

/// Twists whose centres of rotation lie all over a ring with these radii, m.
fn twists(radii: std::ops::Range<f64>) -> Vec<Twist> {
    let one = |i: u32| {
        let (angle, share) = (2.4 * f64::from(i), (f64::from(i) / 256.0).sqrt());
        let radius = radii.start + share * (radii.end - radii.start);
        Twist::new(radius * 0.7 * Vector2::new(angle.cos(), angle.sin()), 0.7)
    };
    (0..256).map(one).collect()
}

/// The yardstick: the vertices of the same polygon, each on its own.
fn roots_and_logarithms(polygon: &SimplePolygon, twist: &Twist) -> f64 {
    let centre = Point2::from(twist.velocity);
    let one = |p: &Point2<f64>| {
        let d = p - centre;
        let squared = d.norm_squared();
        let distance = squared.sqrt();
        squared.ln() + (d.x / distance) * (d.y / distance)
    };
    polygon.vertices().iter().map(one).sum()
}

/// How often to evaluate in one timed run.
fn evaluations(edges: u32) -> u32 {
    (EDGES_A_RUN / edges).max(1)
}

/// One timed run.
fn evaluate(edges: u32, twists: &[Twist], mut evaluate: impl FnMut(&Twist) -> f64) {
    let mut sum = 0.0;
    for twist in twists.iter().cycle().take(evaluations(edges) as usize) {
        sum += evaluate(black_box(twist));
    }
    black_box(sum);
}

/// One timed run of the same number of evaluations, all twists at once.
fn evaluate_many(edges: u32, twists: &[Twist], support: &SupportFriction) {
    let mut left = evaluations(edges) as usize;
    while left > 0 {
        let now = left.min(twists.len());
        black_box(support.mean_slidings(black_box(&twists[..now])));
        left -= now;
    }
}
