//! Planar subdivision with the polygons that contain each region, compared with sorting three numbers for each region.
//! Run with `cargo bench --bench sampling`.
//!
//! Bars on a machine with nothing else to do: dense, 200 polygons and 48,000 regions, 25 ms; sparse, 1000 polygons, 8
//! ms; and a time proportional to the number of regions from one dense scene to the next.

mod yardstick;

use std::hint::black_box;

use palpate::math::random::Draw;
use palpate::point_sampling::Subdivision;
use palpate::point_sampling::scenes::SceneKind;
use yardstick::best_of_runs;

/// Numbers to sort for each region: about what comparing the crossings along edges and around nodes takes.
const NUMBERS_PER_REGION: usize = 3;

fn main() {
    println!(
        "{:<8} {:>9} {:>8} {:>14} {:>10} {:>10}",
        "scene", "polygons", "regions", "subdivision ms", "ns/region", "yardsticks"
    );
    // The density of 100 polygons in a square of side 1.
    let wide = SceneKind { side: 10.0_f64.sqrt(), ..SceneKind::SPARSE_SHAPES };
    measure("sparse", SceneKind::SPARSE_SHAPES, 100);
    measure("sparse", wide, 1000);
    for polygons in [40, 80, 150] {
        measure("dense", SceneKind::DENSE_POSES, polygons);
    }
}

fn measure(name: &str, kind: SceneKind, polygons: usize) {
    let scene = kind.draw(&mut Draw::case(1, 0), polygons);
    let regions = Subdivision::new(&scene).regions().count();
    let time = best_of_runs(|| {
        black_box(Subdivision::new(black_box(&scene)));
    });
    let mut draw = Draw::case(2, 0);
    let numbers: Vec<f64> = (0..regions * NUMBERS_PER_REGION).map(|_| draw.unit()).collect();
    let unit = best_of_runs(|| {
        let mut sorted = numbers.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        black_box(sorted);
    });
    let each = time * 1e9 / f64::from(u32::try_from(regions).unwrap_or(u32::MAX));
    println!("{name:<8} {polygons:>9} {regions:>8} {:>14.2} {each:>10.0} {:>10.2}", time * 1e3, time / unit);
}
