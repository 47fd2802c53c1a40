//! Tables 3.1 and 3.2: how many points tell random polygons apart.

use std::time::{Duration, Instant};

use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::point_sampling::scenes::SceneKind;
use palpate::point_sampling::{Effort, Search, SetSystem, Subdivision, fewest};

use super::{Cell, Experiment, Table, TableSettings};

/// How long to look for fewer points or a proof in each scene.
const TIME_LIMIT: Duration = Duration::from_secs(60);

/// Thesis Table 3.1.
pub(super) const SPARSE: Experiment =
    Experiment { name: "3.1", title: "points that tell sparse polygons or poses apart", cases: 1, run: sparse };

/// Thesis Table 3.2.
pub(super) const DENSE: Experiment =
    Experiment { name: "3.2", title: "points that tell dense polygons or poses apart", cases: 1, run: dense };

/// Polygons, regions and points of one of the thesis's tests.
type Test = [usize; 3];

const SPARSE_SHAPES: [Test; 6] =
    [[50, 320, 31], [60, 500, 37], [70, 594, 41], [80, 783, 46], [90, 973, 47], [100, 1422, 51]];
const SPARSE_POSES: [Test; 6] =
    [[50, 362, 36], [60, 609, 34], [70, 741, 34], [80, 1061, 39], [90, 1125, 49], [100, 1643, 61]];
const DENSE_SHAPES: [Test; 6] =
    [[25, 776, 8], [30, 998, 8], [35, 1270, 12], [40, 1759, 12], [45, 2153, 11], [50, 2678, 13]];
/// The last number of regions is 4995 in the table and 4955 in the caption of figure 3.6.
const DENSE_POSES: [Test; 6] =
    [[10, 264, 4], [20, 1121, 7], [25, 1781, 6], [30, 2796, 7], [35, 3655, 9], [40, 4995, 9]];

fn sparse(settings: &TableSettings) -> Table {
    run(
        settings,
        [("shapes", SceneKind::SPARSE_SHAPES, SPARSE_SHAPES), ("poses", SceneKind::SPARSE_POSES, SPARSE_POSES)],
    )
}

fn dense(settings: &TableSettings) -> Table {
    run(settings, [("shapes", SceneKind::DENSE_SHAPES, DENSE_SHAPES), ("poses", SceneKind::DENSE_POSES, DENSE_POSES)])
}

fn run(settings: &TableSettings, groups: [(&str, SceneKind, [Test; 6]); 2]) -> Table {
    let mut table = Table::new([
        "group",
        "polygons",
        "regions",
        "thesis",
        "greedy",
        "thesis greedy",
        "fewest",
        "no fewer than",
        "root bound",
        "time s",
    ]);
    table.definitions.push(
        "Random polygons are cycles of a random walk on 100 random lines, or random poses of one such polygon, in a square; the \
         thesis leaves the walk open, so its scenes are other ones."
            .to_owned(),
    );
    table
        .definitions
        .push(format!("The fewest are proven where they equal the bound; {} s a scene.", TIME_LIMIT.as_secs()));
    for (group, kind, tests) in groups {
        for (test, thesis) in tests.into_iter().enumerate() {
            for case in 0..settings.cases {
                let scene = kind.draw(&mut Draw::case(settings.seed, 100 * test + case), thesis[0]);
                match row(group, &scene, thesis) {
                    Some(cells) => table.push(cells),
                    None => {
                        table.failures.push(format!("{group}, {} polygons, case {case}: not told apart", thesis[0]))
                    }
                }
            }
        }
    }
    table
}

/// One scene's row; none if the points found do not tell its polygons apart.
fn row(group: &str, scene: &[SimplePolygon], [polygons, regions, points]: Test) -> Option<Vec<Cell>> {
    let subdivision = Subdivision::new(scene);
    let holders = subdivision.regions().map(|region| region.inside().to_set()).collect();
    let system = SetSystem::new(scene.len(), holders);
    let order: Vec<usize> = (0..system.elements()).collect();
    let begun = Instant::now();
    let stop = || begun.elapsed() >= TIME_LIMIT;
    let search = |effort| Search { separation: 1, target: 0, effort, stop: &stop };
    let greedy = fewest(&system, &order, &search(Effort::Greedy));
    let best = fewest(&system, &order, &search(Effort::Full));
    system.tells_apart(&best.elements).then(|| {
        vec![
            group.into(),
            Cell::count(polygons),
            Cell::count(system.elements()),
            Cell::count(regions),
            Cell::count(greedy.elements.len()),
            Cell::count(points),
            Cell::count(best.elements.len()),
            Cell::count(best.lower_bound),
            Cell::count(best.proof.program.max(best.proof.digits)),
            Cell::number(begun.elapsed().as_secs_f64(), 2),
        ]
    })
}
