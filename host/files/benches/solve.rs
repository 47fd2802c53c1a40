//! What the frame of `palpate solve` costs: lines a second on a kind that computes next to nothing, and the check of a
//! polygon.

#![allow(clippy::unwrap_used, reason = "a benchmark stops at the first surprise")]

use std::io::Cursor;
use std::num::NonZeroUsize;

use divan::Bencher;
use divan::counter::ItemsCount;
use nalgebra::Point2;
use palpate::geometry::SimplePolygon;
use palpate_files::solve::fields::Polygon;
use palpate_files::solve::{Kind, Problem, Registry, SolveError, run};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const LINES: u32 = 100_000;
const KINDS: Registry = Registry::new(&[Kind::of::<Area>()]);

#[derive(Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Area {
    polygon: Polygon,
}

#[derive(Serialize, JsonSchema)]
struct AreaAnswer {
    /// m².
    area: f64,
}

impl Problem for Area {
    const KIND: &'static str = "area";
    type Answer = AreaAnswer;

    fn solve(&self) -> Result<AreaAnswer, SolveError> {
        Ok(AreaAnswer { area: self.polygon.area() })
    }
}

fn main() {
    divan::main();
}

/// Lines of about 90 bytes, solved in memory.
#[divan::bench(args = [1, 2], sample_count = 10)]
fn lines(bencher: Bencher, jobs: usize) {
    let line =
        |i| format!("{{\"problem\":\"area\",\"id\":{i},\"polygon\":[[0,0],[0.06,0],[0.06,0.04],[0,0.04{i}]]}}\n");
    let input: String = (0..LINES).map(line).collect();
    bencher.counter(ItemsCount::new(LINES)).with_inputs(|| Cursor::new(input.clone().into_bytes())).bench_values(
        |input| {
            let summary = run(KINDS, NonZeroUsize::new(jobs).unwrap(), input, &mut std::io::sink()).unwrap();
            assert_eq!((summary.answered, summary.failed), (u64::from(LINES), 0));
        },
    );
}

/// A regular polygon: what the check costs a part with a fine outline.
#[divan::bench(args = [4, 100, 10_000])]
fn check_regular_polygon(bencher: Bencher, vertices: u32) {
    let step = std::f64::consts::TAU / f64::from(vertices);
    let outline: Vec<_> = (0..vertices).map(|i| on_circle(step * f64::from(i))).collect();
    bencher.counter(ItemsCount::new(vertices)).bench(|| SimplePolygon::new(&*outline).unwrap());
}

fn on_circle(angle: f64) -> Point2<f64> {
    Point2::new(angle.cos(), angle.sin())
}

/// A zigzag of long teeth across the direction of the sweep, which all lie under it at once: the worst case of the check.
#[divan::bench(args = [100, 10_000])]
fn check_zigzag(bencher: Bencher, vertices: u32) {
    let zigzag = |i: u32| Point2::new(f64::from(i % 2), f64::from(i) / f64::from(vertices));
    let mut outline: Vec<_> = (0..vertices - 2).map(zigzag).collect();
    outline.extend([Point2::new(-1.0, 1.0), Point2::new(-1.0, -1.0)]);
    let turn = nalgebra::Rotation2::new(std::f64::consts::FRAC_PI_4);
    outline.iter_mut().for_each(|p| *p = turn * *p);
    bencher.counter(ItemsCount::new(vertices)).bench(|| SimplePolygon::new(&*outline).unwrap());
}
