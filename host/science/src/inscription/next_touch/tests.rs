use std::f64::consts::{PI, TAU};

use super::cells::{Middle, Way};
use super::*;
use crate::inscription::{Touch, TouchReadings, touched_poses};
use crate::math::random::Draw;

const SIGMA: f64 = 3e-5;

/// Friction angle of the finger, rad.
const CONE: f64 = 0.25;

const SQUARE: f64 = 0.2;

fn task(outline: SimplePolygon, radius: f64) -> TouchTask {
    let area = [Point2::origin(), Point2::new(SQUARE, SQUARE)];
    TouchTask { outline, radius, area, tolerance: TouchTolerance::default() }
}

fn inside(draw: &mut Draw, outline: &SimplePolygon) -> Pose {
    loop {
        let pose = Pose { x: draw.uniform(0.0, SQUARE), y: draw.uniform(0.0, SQUARE), theta: draw.uniform(0.0, TAU) };
        let fits = |v: &Point2<f64>| {
            let at = pose.isometry() * v;
            at.coords.min() >= 0.0 && at.coords.max() <= SQUARE
        };
        if outline.vertices().iter().all(fits) {
            return pose;
        }
    }
}

/// What a finger meets on a line, found by small steps: it shares nothing with the search but the distance from a piece.
fn met(draw: &mut Draw, task: &TouchTask, truth: &Pose, approach: &Approach) -> Met {
    let distance = |centre: Point2<f64>| {
        let at = truth.isometry().inverse() * centre;
        let to = task.outline.edges().map(|(start, end)| (distance_to_segment(at, start, end), start, end));
        to.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
    };
    let mut travel = 0.0;
    while travel < approach.length {
        let (left, start, end) = distance(approach.at(travel));
        if left - task.radius < 1e-9 {
            let centre = approach.at(travel);
            let at = truth.isometry().inverse() * centre;
            let along = ((at - start).dot(&(end - start)) / (end - start).norm_squared()).clamp(0.0, 1.0);
            let normal = truth.isometry() * (at - (start + (end - start) * along));
            let force_angle = normal.y.atan2(normal.x) + draw.uniform(-CONE, CONE);
            let off = Vector2::new(draw.normal(), draw.normal()) * SIGMA;
            return Met::Part(FingerTouch { centre: centre + off, sigma: SIGMA, force_angle, half_width: CONE });
        }
        // A disk can go as far as it is away.
        travel += (left - task.radius).max(1e-10);
    }
    Met::Nothing
}

fn any_line(draw: &mut Draw) -> Approach {
    let angle = draw.uniform(0.0, TAU);
    let direction = Vector2::new(angle.cos(), angle.sin());
    let through = Point2::new(draw.uniform(0.05, 0.15), draw.uniform(0.05, 0.15));
    Approach { from: through - direction * 0.3, direction, length: 0.6 }
}

fn apart(a: &Pose, b: &Pose, size: f64) -> f64 {
    let by = a.minus(b);
    by.x.hypot(by.y) + by.z.abs() * size
}

#[test]
fn the_true_pose_stays_in_the_cover_whatever_is_touched() {
    for case in 0..60 {
        let mut draw = Draw::case(21, case);
        let corners = 4 + draw.index(5);
        let outline =
            if case % 2 == 0 { draw.convex_polygon(corners, 0.04) } else { draw.star_polygon(corners, 0.02, 0.04) };
        let task = task(outline, [0.002, 0.015][case % 3 / 2]);
        let truth = inside(&mut draw, &task.outline);
        let mut search = TouchSearch::new(task.clone());
        for _ in 0..6 {
            let approach = any_line(&mut draw);
            search.take(&approach, &met(&mut draw, &task, &truth, &approach));
            let Belief::Covered { cells, .. } = &search.belief else { continue };
            // The truth misses the first touch by its error, and a cell's middle by its reach.
            let size = 0.08;
            let holds =
                |middle: Middle| apart(&middle.pose, &truth, size) <= 4.0 * middle.reach + 10.0 * TRUSTED_SD * SIGMA;
            assert!(
                cells.middles(&task, &search.curve, 0, 1).any(holds),
                "case {case}, {} touches",
                search.touches.len()
            );
        }
    }
}

#[test]
fn with_a_point_for_a_finger_all_poses_are_those_of_the_search_for_points() {
    let mut compared = 0;
    for case in 0..12 {
        let mut draw = Draw::case(22, case);
        let corners = 4 + draw.index(3);
        let task = task(draw.convex_polygon(corners, 0.04), 1e-6);
        let truth = inside(&mut draw, &task.outline);
        let mut search = TouchSearch::new(task.clone());
        while search.touches.len() < 4 {
            let approach = any_line(&mut draw);
            if let Met::Part(touch) = met(&mut draw, &task, &truth, &approach) {
                // Without the way there, and without the force's direction: points alone.
                let at = Approach { length: 0.0, from: touch.centre, ..approach };
                search.take(&at, &Met::Part(FingerTouch { half_width: PI, ..touch }));
            }
        }
        let Belief::Covered { cells, modes } = &search.belief else { panic!("nothing covered") };
        let touches = search.touches.iter().map(|touch| Touch { point: touch.centre, sigma: SIGMA, normal: None });
        let points = touched_poses(&task.outline, &TouchReadings { touches: touches.collect(), ..Default::default() });
        if !cells.is_fine() || points.loose.is_some() {
            continue;
        }
        // A point may also be inside the part there, which a finger cannot.
        let can_be = |pose: &Pose| {
            let corners = task.outline.vertices().iter().map(|vertex| pose.isometry() * vertex);
            let fits = corners.into_iter().all(|at| at.coords.min() >= 0.0 && at.coords.max() <= SQUARE);
            let ways = search.passed.iter().all(|Way { to, .. }| {
                search.curve.signed_distance(pose.isometry().inverse() * to).0 >= -TRUSTED_SD * SIGMA
            });
            fits && ways
        };
        for wanted in points.modes.iter().filter(|mode| can_be(&mode.pose)) {
            let found = modes.iter().any(|mode| outlines_apart(&task.outline, &mode.pose, &wanted.pose) < 2e-4);
            assert!(found, "case {case}: {:?} is not among {modes:?}", wanted.pose);
            compared += 1;
        }
    }
    assert!(compared >= 12, "{compared}");
}

fn found(outline: SimplePolygon, seed: u64) -> (Pose, TouchVerdict) {
    let mut draw = Draw::new(seed);
    let task = task(outline, 0.015);
    let truth = inside(&mut draw, &task.outline);
    let mut search = TouchSearch::new(task.clone());
    for _ in 0..20 {
        if !matches!(search.verdict(), TouchVerdict::Open { .. }) {
            break;
        }
        let next = search.next().unwrap();
        search.take(&next.approach, &met(&mut draw, &task, &truth, &next.approach));
    }
    (truth, search.verdict())
}

#[test]
fn a_part_of_no_symmetry_is_found() {
    let outline = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.01, 0.05]].map(Point2::from)).unwrap();
    let (truth, verdict) = found(outline, 5);
    let TouchVerdict::One(mode) = verdict else { panic!("{verdict:?}") };
    let off = mode.pose.minus(&truth);
    assert!(off.x.hypot(off.y) < 3e-4 && off.z.abs() < 0.3_f64.to_radians(), "{off}");
}

#[test]
fn touch_cannot_tell_how_a_rectangle_is_turned() {
    let outline = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from)).unwrap();
    let (truth, verdict) = found(outline.clone(), 6);
    let TouchVerdict::Alike(modes) = verdict else { panic!("{verdict:?}") };
    assert_eq!(modes.len(), 2);
    assert!(modes.iter().all(|mode| outlines_apart(&outline, &mode.pose, &truth) < 2e-4));
}

#[test]
fn touches_that_no_pose_explains_leave_none() {
    let outline = SimplePolygon::new([[0.0, 0.0], [0.03, 0.0], [0.0, 0.03]].map(Point2::from)).unwrap();
    let mut search = TouchSearch::new(task(outline, 0.005));
    // Two touches farther apart than the part is long.
    for x in [0.04, 0.16] {
        let from = Point2::new(x, -0.05);
        let approach = Approach { from, direction: Vector2::y(), length: 0.3 };
        let touch = FingerTouch { centre: Point2::new(x, 0.1), sigma: SIGMA, force_angle: -PI / 2.0, half_width: CONE };
        search.take(&approach, &Met::Part(touch));
    }
    assert_eq!((search.verdict(), search.next()), (TouchVerdict::NoPose, None));
}

#[test]
fn a_beam_that_bends_is_taken_into_account() {
    // 2 N on 27 N/mm bend it by 74 µm, against the way on which it came.
    let pressed = PressedFinger {
        place: Point2::new(0.05, 0.02),
        place_sd: 3e-6,
        force: Vector2::new(-2.0, 0.0),
        compliance: 1.0 / 27e3,
        compliance_log_sd: 0.05,
        friction_angle: 0.2,
        angle_sd: 0.01,
        moved: 0.0,
    };
    let touch = pressed.touch();
    assert!((touch.centre - Point2::new(0.05 - 2.0 / 27e3, 0.02)).norm() < 1e-15);
    assert!((touch.sigma - 4.77e-6).abs() < 1e-8 && (touch.force_angle - PI).abs() < 1e-12, "{touch:?}");
    assert!((touch.half_width - 0.24).abs() < 1e-12);
}

#[test]
fn an_approach_that_meets_nothing_is_not_proposed_again() {
    // Found on a simulated robot: two touches, then a line that passes a corner by 0.8 mm.
    let corners = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.025], [0.035, 0.045], [0.0, 0.03]];
    let outline = SimplePolygon::new(corners.map(Point2::from)).unwrap();
    let area = [Point2::origin(), Point2::new(0.1, 0.1)];
    let mut search = TouchSearch::new(TouchTask { outline, radius: 0.015, area, tolerance: TouchTolerance::default() });
    let approach = |from: [f64; 2], to: [f64; 2]| {
        let (from, to) = (Point2::from(from) * 1e-3, Point2::from(to) * 1e-3);
        Approach { from, direction: (to - from).normalize(), length: (to - from).norm() }
    };
    let touch = |centre: [f64; 2], angle_deg: f64| {
        let (force_angle, half_width) = (angle_deg.to_radians(), 14.7_f64.to_radians());
        Met::Part(FingerTouch { centre: Point2::from(centre) * 1e-3, sigma: 3.1e-5, force_angle, half_width })
    };
    search.take(&approach([116.9, -17.0], [61.4, 117.0]), &touch([97.44, 30.07], -67.5));
    search.take(&approach([47.3, -17.0], [11.4, 117.0]), &touch([40.45, 8.39], -115.2));
    let passes = search.next().unwrap().approach;
    search.take(&passes, &Met::Nothing);
    let next = search.next().unwrap().approach;
    assert!((next.from - passes.from).norm() + (next.direction - passes.direction).norm() > 1e-3, "{next:?}");
}

/// Touches until it is decided; how it ended, and the number of approaches.
fn which(draw: &mut Draw, parts: &[SimplePolygon], there: &SimplePolygon, truth: &Pose) -> (PartsVerdict, usize) {
    let task = task(there.clone(), 0.015);
    let mut search = PartsSearch::new(parts, task.radius, task.area, task.tolerance);
    for approaches in 0..40 {
        match (search.verdict(), search.next()) {
            (PartsVerdict::Open(_), Some(next)) => {
                let met = met(draw, &task, truth, &next.approach);
                search.take(&next.approach, &met);
            }
            (verdict, _) => return (verdict, approaches),
        }
    }
    (search.verdict(), 40)
}

#[test]
fn of_many_parts_the_right_one_is_named_and_a_stranger_is_none() {
    let mut draw = Draw::case(33, 0);
    let mut part = |_| {
        let corners = 4 + draw.index(5);
        if draw.chance(0.5) { draw.convex_polygon(corners, 0.05) } else { draw.star_polygon(corners, 0.02, 0.05) }
    };
    let all: Vec<_> = (0..45).map(&mut part).collect();
    let (parts, strangers) = all.split_at(40);
    for case in 0..10 {
        let mut draw = Draw::case(34, case);
        let there = if case % 2 == 0 { &parts[case] } else { &strangers[case / 2] };
        let truth = inside(&mut draw, there);
        let (verdict, _) = which(&mut draw, parts, there, &truth);
        if case % 2 == 1 {
            assert_eq!(verdict, PartsVerdict::NoneOfThese, "case {case}");
            continue;
        }
        let PartsVerdict::One(left) = verdict else { panic!("case {case}: {verdict:?}") };
        assert_eq!(left.part, case);
        let off = |mode: &PoseMode| outlines_apart(there, &mode.pose, &truth);
        assert!(left.modes.iter().map(off).fold(f64::INFINITY, f64::min) < 5e-4, "case {case}");
    }
}

#[test]
fn the_same_part_twice_is_said_to_be_alike() {
    let wedge = SimplePolygon::new([[0.0, 0.0], [0.06, 0.0], [0.02, 0.04]].map(Point2::from)).unwrap();
    let moved = SimplePolygon::new([[0.01, 0.0], [0.07, 0.0], [0.03, 0.04]].map(Point2::from)).unwrap();
    let mut draw = Draw::case(35, 0);
    let truth = inside(&mut draw, &wedge);
    let (verdict, _) = which(&mut draw, &[wedge.clone(), moved], &wedge, &truth);
    let PartsVerdict::Alike(left) = verdict else { panic!("{verdict:?}") };
    assert_eq!(left.iter().map(|left| left.part).collect::<Vec<_>>(), [0, 1]);
}
