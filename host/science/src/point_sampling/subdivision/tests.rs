//! The subdivision against sampling of a grid, sums of areas, and Euler's count of faces.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use nalgebra::Point2;
use proptest::prelude::*;

use super::super::plan::contains;
use super::Subdivision;
use crate::geometry::SimplePolygon;
use crate::point_sampling::Scene;
use crate::search::check_stopping_of_making;

/// A union of unit cells of a small board as a rectangle or an L, so that edges coincide, touch and cross in every way.
fn on_a_board() -> impl Strategy<Value = SimplePolygon> {
    let rectangle = (0..5_i32, 0..5_i32, 1..4_i32, 1..4_i32)
        .prop_map(|(x, y, w, h)| vec![[x, y], [x + w, y], [x + w, y + h], [x, y + h]]);
    let bracket = (0..4_i32, 0..4_i32, 1..3_i32, 1..3_i32).prop_map(|(x, y, w, h)| {
        vec![[x, y], [x + 2 * w, y], [x + 2 * w, y + h], [x + w, y + h], [x + w, y + 2 * h], [x, y + 2 * h]]
    });
    let diamond =
        (2..6_i32, 2..6_i32, 1..3_i32).prop_map(|(x, y, r)| vec![[x, y - r], [x + r, y], [x, y + r], [x - r, y]]);
    let corner = (0..5_i32, 0..5_i32, 1..4_i32).prop_map(|(x, y, s)| vec![[x, y], [x + s, y], [x, y + s]]);
    prop_oneof![rectangle, bracket, diamond, corner].prop_map(|points: Vec<[i32; 2]>| {
        let points: Vec<_> = points.iter().map(|p| Point2::new(f64::from(p[0]), f64::from(p[1]))).collect();
        SimplePolygon::new(points).unwrap()
    })
}

fn stars() -> impl Strategy<Value = SimplePolygon> {
    (proptest::collection::vec(0.2..1.0_f64, 3..9), -1.0..1.0_f64, -1.0..1.0_f64, 0.0..6.0_f64).prop_filter_map(
        "thin",
        |(radii, x, y, turn)| {
            let count = f64::from(u32::try_from(radii.len()).unwrap());
            let at = |i: usize| turn + std::f64::consts::TAU * f64::from(u32::try_from(i).unwrap()) / count;
            SimplePolygon::new(
                radii
                    .iter()
                    .enumerate()
                    .map(|(i, r)| Point2::new(x + r * at(i).cos(), y + r * at(i).sin()))
                    .collect::<Vec<_>>(),
            )
            .ok()
        },
    )
}

/// The polygons that contain each place of a grid that lies on no edge.
fn seen_on_a_grid(polygons: &[SimplePolygon], places: impl Iterator<Item = Point2<f64>>) -> BTreeSet<Vec<usize>> {
    let inside = |place: Point2<f64>| -> Option<Vec<usize>> {
        let has: Option<Vec<bool>> = polygons.iter().map(|polygon| contains(polygon, place)).collect();
        Some(has?.iter().enumerate().filter(|(_, has)| **has).map(|(number, _)| number).collect())
    };
    places.filter_map(inside).filter(|inside| !inside.is_empty()).collect()
}

fn found(subdivision: &Subdivision) -> Vec<(Vec<usize>, f64)> {
    subdivision.regions().map(|region| (region.inside().iter().collect(), region.area())).collect()
}

fn grid(low: f64, high: f64, count: u32) -> impl Iterator<Item = Point2<f64>> {
    let at = move |i: u32| low + (high - low) * (f64::from(i) + 0.37) / f64::from(count);
    (0..count).flat_map(move |i| (0..count).map(move |j| Point2::new(at(i), at(j))))
}

/// Faces of a board by flooding: quarters of its cells' triangles that no edge of a polygon separates.
fn faces_by_flooding(polygons: &[SimplePolygon]) -> usize {
    // Edges run along lines x = i, y = i, x + y = i and x − y = i; the places between those of a board of half cells
    // are triangles, each with a point of its own, and neighbours across a line are separated if an edge covers their
    // border.
    const SIDE: usize = 24;
    let place = |i: usize, j: usize, quarter: usize| {
        let shift = [[0.25, 0.0], [0.0, 0.25], [-0.25, 0.0], [0.0, -0.25]][quarter];
        let real = |i: usize| f64::from(u32::try_from(i).unwrap()) / 2.0 - 1.0 + 0.25;
        Point2::new(real(i) + shift[0] / 2.0, real(j) + shift[1] / 2.0)
    };
    let number = |i: usize, j: usize, quarter: usize| (i * SIDE + j) * 4 + quarter;
    let codes: Vec<Vec<bool>> = (0..SIDE * SIDE * 4)
        .map(|n| {
            polygons
                .iter()
                .map(|polygon| contains(polygon, place(n / 4 / SIDE, n / 4 % SIDE, n % 4)).unwrap())
                .collect()
        })
        .collect();
    let mut parent: Vec<usize> = (0..codes.len()).collect();
    fn root(parent: &[usize], mut n: usize) -> usize {
        while parent[n] != n {
            n = parent[n];
        }
        n
    }
    let mut join = |a: usize, b: usize| {
        // An edge between them changes who contains them: two polygons never change there both and back.
        if codes[a] == codes[b] {
            let (a, b) = (root(&parent, a), root(&parent, b));
            parent[a] = b;
        }
    };
    for i in 0..SIDE {
        for j in 0..SIDE {
            (0..4).for_each(|quarter| join(number(i, j, quarter), number(i, j, (quarter + 1) % 4)));
            if i + 1 < SIDE {
                join(number(i, j, 0), number(i + 1, j, 2));
            }
            if j + 1 < SIDE {
                join(number(i, j, 1), number(i, j + 1, 3));
            }
        }
    }
    let roots: BTreeSet<usize> =
        (0..codes.len()).filter(|&n| codes[n].contains(&true)).map(|n| root(&parent, n)).collect();
    roots.len()
}

proptest! {
    #[test]
    fn a_board_has_the_faces_that_flooding_finds(polygons in proptest::collection::vec(on_a_board(), 1..8)) {
        let subdivision = Subdivision::new(&polygons);
        prop_assert_eq!(subdivision.regions().count(), faces_by_flooding(&polygons));
    }

    #[test]
    fn regions_add_up_to_the_polygons(polygons in proptest::collection::vec(prop_oneof![on_a_board(), stars()], 1..9)) {
        let regions = found(&Subdivision::new(&polygons));
        for (number, polygon) in polygons.iter().enumerate() {
            let sum: f64 = regions.iter().filter(|(inside, _)| inside.contains(&number)).map(|(_, area)| area).sum();
            prop_assert!((sum / polygon.area() - 1.0).abs() < 1e-9, "{} {}", sum, polygon.area());
        }
    }

    #[test]
    fn every_set_seen_on_a_grid_is_a_region(polygons in proptest::collection::vec(prop_oneof![on_a_board(), stars()], 1..9)) {
        let regions = found(&Subdivision::new(&polygons));
        for seen in seen_on_a_grid(&polygons, grid(-2.0, 9.0, 40)) {
            prop_assert!(regions.iter().any(|(inside, _)| *inside == seen), "{:?}", seen);
        }
    }

    /// Crossings plus connected components, in general position.
    #[test]
    fn faces_number_as_euler_says(polygons in proptest::collection::vec(stars(), 1..9)) {
        let edges: Vec<_> = polygons.iter().enumerate().flat_map(|(i, polygon)| polygon.edges().map(move |edge| (i, edge))).collect();
        let side = |(a, b): (Point2<f64>, Point2<f64>), c: Point2<f64>| (b - a).perp(&(c - a)) > 0.0;
        let (mut crossings, mut part) = (0, (0..polygons.len()).collect::<Vec<_>>());
        for (k, &(i, e)) in edges.iter().enumerate() {
            for &(j, f) in &edges[..k] {
                if i != j && side(e, f.0) != side(e, f.1) && side(f, e.0) != side(f, e.1) {
                    crossings += 1;
                    let (from, to) = (part[i], part[j]);
                    part.iter_mut().filter(|part| **part == from).for_each(|part| *part = to);
                }
            }
        }
        let components = part.iter().collect::<BTreeSet<_>>().len();
        let subdivision = Subdivision::new(&polygons);
        prop_assert_eq!(subdivision.regions().count() + subdivision.holes(), crossings + components);
    }
}

#[test]
fn identical_and_nested_polygons_are_no_special_case() {
    let square = |a: f64| SimplePolygon::new([[-a, -a], [a, -a], [a, a], [-a, a]].map(Point2::from)).unwrap();
    let mut regions = found(&Subdivision::new(&[square(0.1), square(0.2), square(0.1), square(0.3)]));
    regions.sort_by(|a, b| a.1.total_cmp(&b.1));
    let insides: Vec<_> = regions.iter().map(|(inside, _)| inside.clone()).collect();
    assert_eq!(insides, [vec![0, 1, 2, 3], vec![1, 3], vec![3]]);
    for ((_, area), expected) in regions.iter().zip([0.04, 0.12, 0.2]) {
        assert!((area - expected).abs() < 1e-12);
    }
}

#[test]
fn a_hole_between_polygons_is_no_region() {
    let bar = |x0: f64, y0: f64, x1: f64, y1: f64| {
        SimplePolygon::new([[x0, y0], [x1, y0], [x1, y1], [x0, y1]].map(Point2::from)).unwrap()
    };
    let frame = [bar(0.0, 0.0, 3.0, 1.0), bar(0.0, 2.0, 3.0, 3.0), bar(0.0, 0.0, 1.0, 3.0), bar(2.0, 0.0, 3.0, 3.0)];
    let subdivision = Subdivision::new(&frame);
    assert_eq!((subdivision.regions().count(), subdivision.holes()), (8, 1));
}

#[test]
fn a_subdivision_and_a_scene_in_the_making_can_be_stopped() {
    let square =
        |a: f64| SimplePolygon::new([[a, a], [a + 0.3, a], [a + 0.3, a + 0.3], [a, a + 0.3]].map(Point2::from));
    let squares: Vec<_> = [0.0, 0.1, 0.2, 0.5].map(|a| square(a).unwrap()).to_vec();
    check_stopping_of_making(|stop| Subdivision::new_until(&squares, stop));
    check_stopping_of_making(|stop| Scene::new_until(&squares, stop));
    let asked = AtomicUsize::new(0);
    let stop = || asked.fetch_add(1, Relaxed) == 2;
    assert!(Subdivision::new_until(&squares, &stop).is_none());
    assert_eq!(asked.load(Relaxed), 3, "it is not asked again");
}

#[test]
fn many_lines_through_one_point_make_no_slivers() {
    // Diagonals of a rectangle's copies meet where doubles cannot say so: at thirds.
    let blade = |k: u32| {
        let angle = f64::from(k);
        SimplePolygon::new([[0.0, 0.0], [3.0, 1.0 + angle], [3.0, 2.0 + angle]].map(Point2::from)).unwrap()
    };
    let blades: Vec<_> = (0..6).map(blade).collect();
    assert_eq!(Subdivision::new(&blades).regions().count(), 6);
}
