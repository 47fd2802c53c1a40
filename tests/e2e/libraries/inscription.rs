//! Inscription against exhaustion (`palpate_tests::inscription_oracle`), which shares nothing with it.

use std::f64::consts::TAU;

use nalgebra::{Matrix3, Point2, Vector3};
use palpate::geometry::{ConvexPolygon, SimplePolygon};
use palpate::inscription::{
    Bearing, Cone, Continuum, HalfPlane, Inscription, NoisyReadings, Pose, PoseMode, estimate, poses, view,
};
use palpate::math::random::Draw;
use palpate_tests::inscription_oracle as oracle;

/// Poses agree to this, in part sizes and rad: both are exact to rounding, which a bad triple of lines multiplies.
const POSE: f64 = 1e-8;
/// χ² agrees to this share of 1 + χ²: the compass search stops at steps of 1e-11.
const CHI2: f64 = 1e-4;
/// Random problems.
const PROBLEMS: usize = 300;
/// Problems with noise; each takes a blind search from many starts.
const NOISY_PROBLEMS: usize = 12;
/// Starts of that search.
const STARTS: u32 = 60;
/// Times that a search is begun anew where it came to rest.
const SHOVES: usize = 12;

fn outline(points: &[[f64; 2]]) -> ConvexPolygon {
    let points: Vec<_> = points.iter().map(|p| Point2::from(*p)).collect();
    ConvexPolygon::new(&SimplePolygon::new(points).unwrap()).unwrap()
}

fn found(polygon: &[[f64; 2]], lines: &[oracle::Line]) -> Result<Vec<Pose>, Continuum> {
    let lines: Vec<_> = lines.iter().map(|&(angle, offset)| HalfPlane::new(angle, offset)).collect();
    match poses(&outline(polygon), &lines) {
        Inscription::Poses(poses) => Ok(poses),
        Inscription::Underdetermined(continuum) => Err(continuum),
    }
}

/// Both find the same poses, one to one.
fn agree(polygon: &[[f64; 2]], lines: &[oracle::Line], what: &str) -> usize {
    let (ours, wanted) = (found(polygon, lines).unwrap(), oracle::all_poses(polygon, lines).unwrap());
    let size = oracle::size(polygon);
    let near = |pose: &Pose, other: &[f64; 3]| {
        let turn = (pose.theta - other[2]).rem_euclid(TAU);
        turn.min(TAU - turn) < POSE && (pose.x - other[0]).hypot(pose.y - other[1]) < POSE * size
    };
    for pose in &ours {
        assert!(wanted.iter().any(|other| near(pose, other)), "{what}: {pose:?} is not in {wanted:?}");
    }
    assert_eq!(ours.len(), wanted.len(), "{what}: {ours:?} against {wanted:?}");
    ours.len()
}

fn points(draw: &mut Draw, count: usize) -> Vec<[f64; 2]> {
    draw.convex_polygon(count, 1.0).vertices().iter().map(|p| [p.x, p.y]).collect()
}

/// A random pose with the cones under which sensors about it see the part.
fn views(draw: &mut Draw, polygon: &[[f64; 2]], cones: usize) -> (Pose, Vec<oracle::Cone>) {
    let pose = Pose { x: draw.uniform(-1.0, 1.0), y: draw.uniform(-1.0, 1.0), theta: draw.uniform(0.0, TAU) };
    let part = outline(polygon);
    let cone = |_| {
        let (distance, angle) = (draw.uniform(1.2, 3.0), draw.uniform(0.0, TAU));
        let apex = [pose.x + distance * angle.cos(), pose.y + distance * angle.sin()];
        let [right, left] = view(&part, &pose, Point2::from(apex)).unwrap();
        (apex, right.angle, right.angle + (left.angle - right.angle).rem_euclid(TAU))
    };
    (pose, (0..cones).map(cone).collect())
}

#[test]
fn three_random_lines_leave_the_poses_that_exhaustion_finds() {
    for case in 0..PROBLEMS {
        let mut draw = Draw::case(21, case);
        let polygon = points(&mut draw, 7);
        let pose = [draw.uniform(-1.0, 1.0), draw.uniform(-1.0, 1.0), draw.uniform(0.0, TAU)];
        let vertices = oracle::moved(&polygon, pose);
        let lines = [0, 1, 2].map(|_| {
            let angle = draw.uniform(0.0, TAU);
            let height = vertices.iter().map(|p| p[0] * angle.cos() + p[1] * angle.sin());
            (angle, height.fold(f64::NEG_INFINITY, f64::max))
        });
        // Lines that all touch one vertex are concurrent: the only way not to be answered with poses.
        if oracle::all_poses(&polygon, &lines).is_none() {
            continue;
        }
        let Ok(ours) = found(&polygon, &lines) else { continue };
        agree(&polygon, &lines, &format!("case {case}"));
        assert_eq!(ours.len() % 2, 0, "case {case}: {ours:?}");
    }
}

#[test]
fn cones_leave_the_poses_that_exhaustion_finds() {
    for case in 0..PROBLEMS {
        let mut draw = Draw::case(22, case);
        let polygon = points(&mut draw, 8);
        let (_, cones) = views(&mut draw, &polygon, 2 + case % 4);
        let lines: Vec<_> = cones.iter().flat_map(oracle::lines_of).collect();
        assert!(agree(&polygon, &lines, &format!("case {case}")) >= 1, "case {case}");
    }
}

/// What a problem shows, its polygon and its lines.
type Named<'a> = (&'a str, &'a [[f64; 2]], Vec<oracle::Line>);

#[test]
fn flush_edges_tangencies_and_parallel_lines_agree_with_exhaustion() {
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let triangle = [[0.0, 0.0], [2.0, 0.0], [0.5, 1.5]];
    let quarter = TAU / 4.0;
    let cases: [Named<'_>; 8] = [
        ("a corner and a far wall", &square, vec![(2.0 * quarter, 0.0), (-quarter, 0.0), (0.0, 1.0)]),
        ("a box that fits exactly", &square, vec![(2.0 * quarter, 0.0), (-quarter, 0.0), (0.0, 1.0), (quarter, 1.0)]),
        (
            "jaws at the diagonal, a tangency",
            &square,
            vec![(0.0, 2.0_f64.sqrt()), (2.0 * quarter, 0.0), (quarter, 1.0)],
        ),
        ("jaws wider than the diagonal", &square, vec![(0.0, 1.5), (2.0 * quarter, 0.0), (quarter, 1.0)]),
        ("jaws nearer than the width", &square, vec![(0.0, 0.9), (2.0 * quarter, 0.0), (quarter, 1.0)]),
        ("two walls that face one way", &square, vec![(0.0, 1.0), (0.0, 1.1), (quarter, 1.0)]),
        ("an edge flush with the floor", &triangle, vec![(-quarter, 0.0), (quarter, 1.5), (0.0, 2.0)]),
        ("a vertex where two lines meet", &triangle, vec![(-quarter, 0.0), (2.0 * quarter, 0.0), (0.6, 1.65)]),
    ];
    for (what, polygon, lines) in cases {
        agree(polygon, &lines, what);
    }
}

#[test]
fn a_sensor_at_a_vertex_or_in_line_with_an_edge_is_no_special_case() {
    let part = [[-0.3, -0.2], [0.4, -0.25], [0.35, 0.3], [-0.2, 0.25]];
    // At vertex 1: the rays run along both of its edges. In line with edge 0: one ray touches two vertices.
    let angle = |from: [f64; 2], to: [f64; 2]| (to[1] - from[1]).atan2(to[0] - from[0]);
    let at_vertex = (part[1], angle(part[1], part[2]), angle(part[1], part[0]) + TAU);
    let beside = [1.1, -0.3];
    let in_line = (beside, angle(beside, part[2]), angle(beside, part[0]) + TAU);
    let elsewhere = ([-2.0, 1.0], angle([-2.0, 1.0], part[0]), angle([-2.0, 1.0], part[2]));
    for cones in [[at_vertex, elsewhere], [in_line, elsewhere], [at_vertex, in_line]] {
        let lines: Vec<_> = cones.iter().flat_map(oracle::lines_of).collect();
        assert!(oracle::residual(&part, &lines, [0.0; 3]) < 1e-12, "{cones:?}");
        assert!(agree(&part, &lines, &format!("{cones:?}")) >= 1);
    }
}

/// Appendix A: a fan with its centre p0 and n − 1 vertices on an arc, in a triangle of altitude d.
fn fan(n: u32, d: f64) -> Vec<[f64; 2]> {
    let alpha = 0.35;
    let share = (alpha / (2.0 * f64::from(n - 2))).cos();
    let largest = (d / (std::f64::consts::FRAC_PI_6 - alpha).cos()).min(d / share);
    let r = d + 0.5 * (largest - d);
    let step = alpha / f64::from(n - 2);
    let arc = (0..n - 1).map(|k| [r * (step * f64::from(k)).cos(), r * (step * f64::from(k)).sin()]);
    std::iter::once([0.0, 0.0]).chain(arc).collect()
}

#[test]
fn appendix_a_has_exactly_six_poses_a_vertex() {
    let (d, third) = (1.0, TAU / 3.0);
    let triangle = [0.0, third, 2.0 * third].map(|turn| (TAU / 4.0 + turn, d / 3.0));
    // With 1000 vertices the arc's corners differ from a circle by 1e-8 of its radius.
    for n in [3, 4, 5, 7, 10, 33, 64, 200, 1000] {
        let poses = found(&fan(n, d), &triangle).unwrap();
        assert_eq!(poses.len(), 6 * n as usize, "n = {n}");
    }
}

/// Theorem 2: no more than 6n poses, by both ways to find them, and between two walls and a third line no more than 4n. Of
/// random polygons, of fans, which have 6n in appendix A's triangle, and of regular polygons, which if n is odd have 4n
/// between walls that are farther apart than an edge and its corner and nearer than two corners.
#[test]
fn theorem_2_no_more_than_six_poses_a_vertex_in_three_half_planes() {
    let mut reached = [0, 0];
    for case in 0..PROBLEMS {
        let mut draw = Draw::case(25, case);
        let n = 3 + case % 5;
        let corner = TAU / n as f64;
        let polygon = match case % 3 {
            0 => fan(u32::try_from(n).unwrap(), 1.0),
            1 => (0..n).map(|k| corner * k as f64).map(|angle| [angle.cos(), angle.sin()]).collect(),
            _ => points(&mut draw, n),
        };
        let height = draw.uniform(0.2, 0.5) * oracle::size(&polygon);
        let sides = [0.0, draw.uniform(1.8, 2.4), draw.uniform(3.9, 4.5)];
        let triangle = match case % 2 {
            0 => [0.0, 1.0, 2.0].map(|third| (TAU * (0.25 + third / 3.0), 1.0 / 3.0)),
            _ => sides.map(|angle| (angle, height * draw.uniform(0.9, 1.1))),
        };
        let wide = if case % 2 == 0 {
            let [flush, across] = [1.0 + (corner / 2.0).cos(), 2.0 * (corner / 4.0).cos()];
            (flush + across) / 4.0
        } else {
            height
        };
        let jaws = [(0.0, wide), (TAU / 2.0, wide), (draw.uniform(0.5, 2.6), height)];
        for (which, (lines, a_vertex)) in [(triangle, 6), (jaws, 4)].into_iter().enumerate() {
            let Ok(ours) = found(&polygon, &lines) else { continue };
            let wanted = oracle::all_poses(&polygon, &lines).unwrap();
            assert_eq!(ours.len(), wanted.len(), "case {case}: {polygon:?} {lines:?}");
            assert!(ours.len() <= a_vertex * n, "case {case}: {} poses of {n} vertices", ours.len());
            reached[which] += usize::from(ours.len() == a_vertex * n);
        }
    }
    assert!(reached.iter().all(|count| *count > 20), "{reached:?}");
}

/// Corollary 3: cones at two corners of appendix A's triangle share a side, so that a part inscribed in both touches its
/// three sides: 6n poses; no more in cones drawn at random, and so no more than the 8n of Claim 1.
#[test]
fn corollary_3_no_more_than_six_poses_a_vertex_in_two_cones() {
    let (third, corner) = (TAU / 3.0, 2.0 / 3.0);
    // The corner at −π/2 and that a third of a turn on; each sees the triangle under 60°.
    let cones = [0.0, third].map(|turn| {
        let outward = turn - TAU / 4.0;
        let middle = outward + TAU / 2.0;
        ([corner * outward.cos(), corner * outward.sin()], middle - TAU / 12.0, middle + TAU / 12.0)
    });
    let lines: Vec<_> = cones.iter().flat_map(oracle::lines_of).collect();
    for n in [3, 4, 5, 7, 10] {
        let fan = fan(n, 1.0);
        assert_eq!(agree(&fan, &lines, &format!("n = {n}")), 6 * n as usize);
    }
    for case in 0..PROBLEMS {
        let mut draw = Draw::case(26, case);
        let n = 3 + case % 5;
        let polygon = points(&mut draw, n);
        let (_, cones) = views(&mut draw, &polygon, 2);
        let lines: Vec<_> = cones.iter().flat_map(oracle::lines_of).collect();
        let count = agree(&polygon, &lines, &format!("case {case}"));
        assert!(count <= 6 * n, "case {case}: {count} poses of {n} vertices");
    }
}

#[test]
fn what_does_not_determine_the_pose_is_told_apart() {
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let one = oracle::lines_of(&([-2.0, 0.3], -0.15, 0.34)).to_vec();
    assert_eq!(found(&square, &one), Err(Continuum::TooFewLines { distinct: 2 }));
    let twice = [one.clone(), one.clone()].concat();
    assert_eq!(found(&square, &twice), Err(Continuum::TooFewLines { distinct: 2 }));
    let parallel = vec![(0.0, 1.0), (TAU / 2.0, 0.0), (0.0, 1.1)];
    assert_eq!(found(&square, &parallel), Err(Continuum::Parallel));
    // Three lines through one point, as far from the origin as rounding lets it be seen.
    for at in [[-2.0, 0.3], [1000.0, -3000.0]] {
        let through = [0.2, 1.4, 2.9].map(|angle: f64| (angle, at[0] * angle.cos() + at[1] * angle.sin()));
        assert!(matches!(found(&square, &through), Err(Continuum::Concurrent { .. })), "{at:?}");
    }
}

fn readings(cones: &[oracle::Cone], sigma: f64) -> NoisyReadings {
    let cone = |(apex, right, left): &oracle::Cone| Cone::new(Point2::from(*apex), *right, *left).unwrap();
    let bearings: Vec<Bearing> = cones.iter().flat_map(|c| cone(c).bearings()).collect();
    NoisyReadings { bearings, fences: Vec::new(), sigma }
}

fn noisy(draw: &mut Draw, cones: &[oracle::Cone], sigma: f64) -> Vec<oracle::Cone> {
    cones
        .iter()
        .map(|(apex, right, left)| (*apex, right + sigma * draw.normal(), left + sigma * draw.normal()))
        .collect()
}

/// Every minimum that a blind search finds inside the gate is listed, and what is listed is a minimum.
#[test]
fn the_modes_are_the_minima_that_a_blind_search_finds() {
    for case in 0..NOISY_PROBLEMS {
        let mut draw = Draw::case(23, case);
        let polygon = points(&mut draw, 7);
        let (truth, cones) = views(&mut draw, &polygon, 2 + case % 3);
        let sigma = [0.001, 0.008][case % 2];
        let cones = noisy(&mut draw, &cones, sigma);
        let estimate = estimate(&outline(&polygon), &readings(&cones, sigma)).unwrap();
        let chi2 = |pose: [f64; 3]| oracle::chi2(&polygon, &cones, sigma, pose);
        let size = oracle::size(&polygon);
        for mode in &estimate.modes {
            let at = [mode.pose.x, mode.pose.y, mode.pose.theta];
            assert!((chi2(at) - mode.chi2).abs() <= CHI2 * (1.0 + mode.chi2), "case {case}: {mode:?}, {}", chi2(at));
            let (_, lowest) = oracle::descend(chi2, at, size, 1e-4, || sphere(&mut draw));
            assert!(lowest > mode.chi2 - CHI2 * (1.0 + mode.chi2), "case {case}: {mode:?} goes down to {lowest}");
        }
        for start in 0..STARTS {
            let theta = TAU * f64::from(start) / f64::from(STARTS);
            // Turned about where its middle is seen.
            let middle = oracle::moved(&polygon, [truth.x, truth.y, truth.theta]);
            let middle = [0, 1]
                .map(|k| middle.iter().map(|p| p[k]).sum::<f64>() / f64::from(u32::try_from(middle.len()).unwrap()));
            let turned = oracle::moved(&polygon, [0.0, 0.0, theta]);
            let centre = [0, 1]
                .map(|k| turned.iter().map(|p| p[k]).sum::<f64>() / f64::from(u32::try_from(turned.len()).unwrap()));
            let from = [middle[0] - centre[0], middle[1] - centre[1], theta];
            let (mut at, mut value) = oracle::descend(chi2, from, size, 0.05, || sphere(&mut draw));
            // The search may come to rest in a valley: it gets a few shoves.
            for _ in 0..SHOVES {
                let listed = |mode: &PoseMode| mode.chi2 <= value + CHI2 * (1.0 + value) && near(mode, at, size);
                if value > 0.98 * estimate.gate || estimate.modes.iter().any(listed) {
                    break;
                }
                (at, value) = oracle::descend(chi2, at, size, 0.01, || sphere(&mut draw));
            }
            let listed = |mode: &PoseMode| mode.chi2 <= value + CHI2 * (1.0 + value) && near(mode, at, size);
            assert!(
                value > 0.98 * estimate.gate || estimate.modes.iter().any(listed),
                "case {case}: {at:?} with {value} is not in {:?}",
                estimate.modes
            );
        }
    }
}

/// Within what a search that crawls along a valley may leave.
fn near(mode: &PoseMode, at: [f64; 3], size: f64) -> bool {
    let turn = (mode.pose.theta - at[2]).rem_euclid(TAU);
    turn.min(TAU - turn) < 0.02 && (mode.pose.x - at[0]).hypot(mode.pose.y - at[1]) < 0.02 * size
}

fn sphere(draw: &mut Draw) -> [f64; 3] {
    let v = Vector3::new(draw.normal(), draw.normal(), draw.normal()).normalize();
    [v.x, v.y, v.z]
}

/// Normalised squared errors average the three unknowns, and the truth is inside the gate in 99 of 100.
#[test]
fn errors_are_as_large_as_stated() {
    const CASES: u32 = 1000;
    let (mut nees, mut clear, mut covered) = (0.0, 0_u32, 0_u32);
    for case in 0..CASES {
        let mut draw = Draw::case(24, case as usize);
        let polygon = points(&mut draw, 10);
        let (truth, cones) = views(&mut draw, &polygon, 4);
        let sigma = 0.1_f64.to_radians();
        let cones = noisy(&mut draw, &cones, sigma);
        let estimate = estimate(&outline(&polygon), &readings(&cones, sigma)).unwrap();
        let error = |mode: &PoseMode| {
            let turn = (mode.pose.theta - truth.theta + TAU / 2.0).rem_euclid(TAU) - TAU / 2.0;
            let error = Vector3::new(mode.pose.x - truth.x, mode.pose.y - truth.y, turn);
            let inverse: Matrix3<f64> = mode.covariance.try_inverse().unwrap();
            (error.transpose() * inverse * error)[0]
        };
        let nearest = estimate.modes.iter().map(error).fold(f64::INFINITY, f64::min);
        // Beyond 60 the mode of the truth itself was outside the gate.
        covered += u32::from(nearest < 60.0);
        if nearest < 60.0 {
            nees += nearest;
            clear += 1;
        }
    }
    let (nees, covered) = (nees / f64::from(clear), f64::from(covered) / f64::from(CASES));
    assert!((2.7..3.3).contains(&nees), "NEES {nees}");
    assert!((0.98..=1.0).contains(&covered), "covered {covered}");
}
