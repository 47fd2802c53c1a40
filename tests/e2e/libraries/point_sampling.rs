//! Telling polygons apart, from problem to points: what is answered is checked with exact integers and fractions of its
//! own.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use nalgebra::Point2;
use palpate::corner::{Corner, RIGHT_ANGLE};
use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::point_sampling::scenes::SceneKind;
use palpate::point_sampling::{Request, Scene, plan};
use palpate_files::solve::Problem;
use palpate_files::solve::kinds::point_sampling::PointSampling;

/// Scenes of each kind.
const SCENES: usize = 3;

/// Whether a point is inside an outline, by the angle it is seen under from there.
fn inside(outline: &SimplePolygon, p: Point2<f64>) -> bool {
    let turned: f64 = outline.edges().map(|(a, b)| (a - p).perp(&(b - p)).atan2((a - p).dot(&(b - p)))).sum();
    turned.abs() > 3.0
}

/// Distance to the nearest edge, by golden section along each.
fn clearance(scene: &[SimplePolygon], p: Point2<f64>) -> f64 {
    let along = |a: Point2<f64>, b: Point2<f64>| {
        let distance = |t: f64| (a + t * (b - a) - p).norm();
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..60 {
            let (left, right) = (high - 0.618 * (high - low), low + 0.618 * (high - low));
            if distance(left) < distance(right) { high = right } else { low = left }
        }
        distance((low + high) / 2.0)
    };
    scene.iter().flat_map(SimplePolygon::edges).map(|(a, b)| along(a, b)).fold(f64::INFINITY, f64::min)
}

fn scenes() -> impl Iterator<Item = (String, Vec<SimplePolygon>)> {
    let kinds = [
        ("sparse shapes", SceneKind::SPARSE_SHAPES, 25),
        ("sparse poses", SceneKind::SPARSE_POSES, 20),
        ("dense shapes", SceneKind::DENSE_SHAPES, 14),
        ("dense poses", SceneKind::DENSE_POSES, 10),
    ];
    kinds.into_iter().flat_map(|(name, kind, count)| {
        (0..SCENES).map(move |case| (format!("{name}, case {case}"), kind.draw(&mut Draw::case(11, case), count)))
    })
}

#[test]
fn points_tell_random_scenes_apart_and_are_proven_fewest() {
    for (name, scene) in scenes() {
        let plan = plan(&scene, &Request::default(), &|| false);
        let codes: BTreeSet<Vec<bool>> = scene
            .iter()
            .map(|outline| plan.points.iter().map(|point| inside(outline, point.centre)).collect())
            .collect();
        assert_eq!(codes.len(), scene.len(), "{name}");
        assert!(plan.is_fewest(), "{name}: {} of {}", plan.points.len(), plan.lower_bound);
        for (outline, signature) in scene.iter().zip(&plan.signatures) {
            assert!(
                plan.points.iter().zip(signature).all(|(point, &bit)| inside(outline, point.centre) == bit),
                "{name}"
            );
        }
        for point in &plan.points {
            // Golden section leaves 1e-12 of an edge.
            assert!((clearance(&scene, point.centre) - point.radius).abs() < 1e-9, "{name}");
        }
        assert!(plan.clearance_bound.is_none_or(|bound| bound >= plan.clearance() * (1.0 - 1e-6)), "{name}");
    }
}

#[test]
fn more_points_never_have_less_room() {
    for (name, scene) in scenes().step_by(4) {
        let asked = AtomicUsize::new(0);
        let stop = || asked.fetch_add(1, Relaxed) >= 20_000;
        let plans = Scene::new(&scene).trade_off(&Request::default(), &stop);
        let rooms: Vec<(usize, f64)> = plans.iter().map(|plan| (plan.points.len(), plan.clearance())).collect();
        assert!(rooms.windows(2).all(|pair| pair[0].0 < pair[1].0 && pair[0].1 < pair[1].1), "{name}: {rooms:?}");
    }
}

/// Figure 3.1: a part with twelve poses in the corner, told apart by four points, the least there can be.
#[test]
fn twelve_corner_poses_need_four_points() {
    // Millimetres.
    let part = [[0.0, 0.0], [52.0, -4.0], [71.0, 23.0], [49.0, 58.0], [21.0, 37.0], [-9.0, 49.0], [-17.0, 21.0]];
    let part = SimplePolygon::new(part.map(|[x, y]: [f64; 2]| Point2::new(x * 1e-3, y * 1e-3))).unwrap();
    let corner = Corner::new(RIGHT_ANGLE, nalgebra::Vector2::new(-1.0, -1.0)).unwrap();
    let poses = corner.poses(&part);
    assert_eq!(poses.len(), 12);
    let outlines: Vec<_> = poses.iter().map(|pose| corner.placed(&part, pose).unwrap()).collect();
    let plan = plan(&outlines, &Request::default(), &|| false);
    assert_eq!((plan.points.len(), plan.lower_bound, plan.indistinguishable.len()), (4, 4, 0));
    // Edges that share a fence leave no slivers: every region has room for a sensor far above rounding.
    assert!(plan.clearance() > 1e-4, "{}", plan.clearance());
}

#[test]
fn identical_shapes_are_named_in_pairs() {
    let line = r#"{"polygons": [[[0,0],[1,0],[1,1],[0,1]], [[0.5,0],[1.5,0],[1.5,1],[0.5,1]], [[1,0],[1,1],[0,1],[0,0]],
        [[0,0],[0.5,0],[1,0],[1,1],[0,1]]]}"#;
    let answer = serde_json::from_str::<PointSampling>(line).unwrap().solve().unwrap();
    assert_eq!(answer.pairs, [[0, 2], [0, 3], [2, 3]]);
    assert_eq!(answer.points.len(), 1);
}

#[test]
fn what_cannot_be_is_refused_with_its_place() {
    let told = |fields: &str| {
        let line = format!("{{\"polygons\": [[[0,0],[1,0],[1,1]]], {fields}}}");
        match serde_json::from_str::<PointSampling>(&line) {
            Err(error) => error.to_string(),
            Ok(problem) => problem.solve().unwrap_err().to_string(),
        }
    };
    assert!(told("\"min_area\": -1").contains("must be ≥ 0"));
    assert!(told("\"min_clearance\": -1").contains("must be ≥ 0"));
    assert!(told("\"objective\": \"most\"").contains("greedy"));
    assert!(told("\"separation\": 0").contains("from 1 to 64"));
    let none = serde_json::from_str::<PointSampling>("{\"polygons\": []}").unwrap().solve().unwrap_err().to_string();
    assert!(none.contains("at least one polygon"), "{none}");
}
