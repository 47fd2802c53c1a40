//! The estimator on pushes that the same model made, with a truth that is known.

use nalgebra::{Point2, Rotation2, Vector2};

use super::cloud::{effective_number, resampled};
use super::*;
use crate::geometry::{Pose, SimplePolygon};
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;

/// Few, for tests of a second.
const FEW: FilterSettings = FilterSettings { particles: 200, ..FilterSettings::STANDARD };

fn scene() -> SlowScene {
    let outline = SimplePolygon::new([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Point2::from)).unwrap();
    let feet = [[0.01, 0.01], [0.13, 0.01], [0.01, 0.13]].map(Point2::from).to_vec();
    let centre = Point2::new(0.05, 0.05);
    SlowScene::new(&outline, centre, 1.5, &Standing::Feet(feet), SlowConstants::BOARD).unwrap()
}

/// A push of a part that lies at `before`, towards a point near its centre of mass from this direction; what was felt,
/// and where the part lies then.
fn pushed(scene: &SlowScene, before: &Pose, angle: f64, aside: f64) -> (FeltPush, Pose) {
    let direction = Vector2::new(angle.cos(), angle.sin());
    let origin = Point2::new(before.x, before.y) + Vector2::new(-direction.y, direction.x) * aside - direction * 0.05;
    let mut felt = FeltPush { origin, direction, tool_yaw: angle, end: 0.0, onset: Onset::Unknown, forces: Vec::new() };
    let touched = scene.first_touch(&felt, before).unwrap();
    felt.end = touched + 13e-3;
    felt.onset = Onset::At(touched + SlowConstants::BOARD.felt_late);
    felt.forces =
        (0..14).map(|i| FeltForce { travel: touched + 1e-3 * f64::from(i), force: Vector2::zeros() }).collect();
    let own = PushParameters { friction_log: 0.1, contrasts: [0.1, -0.1], contact_log: 0.05, frame: 0.01 };
    let simulated = scene.simulate(&felt, before, &own, 0.25e-3);
    felt.forces.retain(|force| force.travel > touched + 1e-3);
    let made = simulated.forces.iter().flatten().rev().zip(felt.forces.iter_mut().rev());
    made.for_each(|(force, felt)| felt.force = *force);
    (felt, simulated.pose)
}

#[test]
fn a_chain_of_pushes_finds_a_part_that_lay_in_a_box() {
    let scene = scene();
    let filter = SlowFilter { scene: &scene, settings: FEW };
    let mut pose = Pose { x: 0.3, y: -0.1, theta: 0.4 };
    let mut draw = Draw::new(3);
    let mut cloud: Option<Cloud> = None;
    for (angle, aside) in [(1.2, 0.02), (-2.6, -0.01), (-0.9, 0.015), (2.9, 0.0), (0.6, -0.02)] {
        let (felt, after) = pushed(&scene, &pose, angle, aside);
        let told = Pose { x: pose.x + 6e-3, y: pose.y - 4e-3, theta: pose.theta - 0.08 };
        let before = cloud.as_ref().map_or(Before::Box(told, 10e-3, 0.17), Before::After);
        let result = filter.push(&before, &felt, &ParameterBelief::default(), &mut draw);
        assert!(result.effective_force > 5.0, "effective number {}", result.effective_force);
        cloud = Some(result.cloud);
        pose = after;
    }
    let cloud = cloud.unwrap();
    let found = cloud.middle();
    let (off, turn) = ((found.x - pose.x).hypot(found.y - pose.y), wrap_angle(found.theta - pose.theta).abs());
    // What a chain of real pushes leaves in nine of ten cases.
    assert!(off < 3e-3 && turn < 0.045, "{off} m, {turn} rad");
    let region = Region::of(&cloud, Kernel::of(&FEW), &mut draw);
    assert!(region.holds(&pose));
    assert!(!region.holds(&Pose { x: pose.x + 0.03, ..pose }));
}

#[test]
fn the_same_seed_gives_the_same_cloud_and_another_another() {
    let scene = scene();
    let filter = SlowFilter { scene: &scene, settings: FEW };
    let pose = Pose { x: 0.0, y: 0.0, theta: -1.0 };
    let (felt, _) = pushed(&scene, &pose, 0.5, 0.01);
    let run = |seed| {
        filter.push(&Before::Measured(pose, 3e-4, 3e-3), &felt, &ParameterBelief::default(), &mut Draw::new(seed)).cloud
    };
    assert_eq!(run(1), run(1));
    assert_ne!(run(1), run(2));
}

#[test]
fn turning_the_world_turns_the_push() {
    let scene = scene();
    let pose = Pose { x: 0.02, y: 0.01, theta: 0.3 };
    let (felt, after) = pushed(&scene, &pose, 2.0, -0.015);
    let turn = Rotation2::new(1.1);
    let turned = FeltPush {
        origin: turn * felt.origin,
        direction: turn * felt.direction,
        tool_yaw: felt.tool_yaw + 1.1,
        ..felt.clone()
    };
    let at = turn * Point2::new(pose.x, pose.y);
    let own = PushParameters { friction_log: 0.1, contrasts: [0.1, -0.1], contact_log: 0.05, frame: 0.01 };
    let there = scene.simulate(&turned, &Pose { x: at.x, y: at.y, theta: pose.theta + 1.1 }, &own, 0.25e-3).pose;
    let wanted = turn * Point2::new(after.x, after.y);
    assert!((there.x - wanted.x).hypot(there.y - wanted.y) < 1e-9);
    assert!((there.theta - after.theta - 1.1).abs() < 1e-9);
}

#[test]
fn a_part_that_lies_anywhere_touches_where_it_was_felt() {
    let scene = scene();
    let (felt, after) = pushed(&scene, &Pose { x: 0.0, y: 0.0, theta: 0.0 }, 0.4, 0.01);
    // Half a metre of outline and 160° want more.
    let settings = FilterSettings { particles: 2 * FEW.particles, ..FEW };
    let filter = SlowFilter { scene: &scene, settings };
    let result = filter.push(&Before::Anywhere, &felt, &ParameterBelief::default(), &mut Draw::new(5));
    let cells = Cells::of(&result.cloud, &Kernel { place: 1.5e-3, angle: 0.03, ..Kernel::of(&FEW) }, &mut Draw::new(6));
    // Many edges and angles remain, the truth among them.
    assert!(cells.count() > 100 && cells.holds(&after), "{} cells", cells.count());
}

#[test]
fn what_is_known_widely_is_searched_until_enough_meets_the_onset() {
    let scene = scene();
    let filter = SlowFilter { scene: &scene, settings: FEW };
    let pose = Pose { x: 0.0, y: 0.0, theta: 0.0 };
    let (felt, _) = pushed(&scene, &pose, 0.4, 0.01);
    let belief = ParameterBelief::default();
    // One in a hundred poses of such a box meets it: the candidates of one draw are not enough.
    let found = filter.push(&Before::Box(pose, 50e-3, 0.5), &felt, &belief, &mut Draw::new(12));
    assert!(found.effective_onset >= FEW.particles as f64, "effective number {}", found.effective_onset);
    // What no pose explains ends too.
    let never = FeltPush { onset: Onset::At(felt.end + 1.0), ..felt.clone() };
    let unexplained = filter.push(&Before::Measured(pose, 3e-4, 3e-3), &never, &belief, &mut Draw::new(12));
    assert_eq!(unexplained.cloud.poses.len(), FEW.particles);
}

#[test]
fn a_cloud_from_anywhere_is_thinned_by_halves() {
    let scene = scene();
    let few = FilterSettings { particles: 50, ..FEW };
    let filter = SlowFilter { scene: &scene, settings: few };
    let (felt, _) = pushed(&scene, &Pose { x: 0.0, y: 0.0, theta: 0.0 }, 0.4, 0.01);
    let mut draw = Draw::new(12);
    let mut cloud = filter.push(&Before::Anywhere, &felt, &ParameterBelief::default(), &mut draw).cloud;
    let mut kept = vec![cloud.poses.len()];
    for _ in 0..2 {
        cloud = filter.push(&Before::After(&cloud), &felt, &ParameterBelief::default(), &mut draw).cloud;
        kept.push(cloud.poses.len());
    }
    assert_eq!(kept, [100, 50, 50]);
}

#[test]
fn the_middle_of_two_heaps_is_that_of_the_larger() {
    let at = |x: f64, theta: f64| Pose { x, y: 0.1, theta };
    // Across the cut of the angle.
    let larger = [at(0.0, 3.1), at(1e-3, -3.1), at(2e-3, 3.1), at(3e-3, -3.1)];
    let cloud = Cloud { poses: larger.into_iter().chain([at(0.2, 1.0); 3]).collect() };
    let middle = cloud.middle();
    assert!((middle.x - 1.5e-3).abs() < 1e-12 && (middle.y - 0.1).abs() < 1e-12, "{middle:?}");
    assert!(wrap_angle(middle.theta - std::f64::consts::PI).abs() < 1e-9, "{middle:?}");
}

#[test]
fn a_log_teaches_the_friction_that_made_it() {
    let scene = scene();
    let slippery = SlowConstants { friction: 0.8 * SlowConstants::BOARD.friction, ..SlowConstants::BOARD };
    let outline = SimplePolygon::new([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Point2::from)).unwrap();
    let feet = [[0.01, 0.01], [0.13, 0.01], [0.01, 0.13]].map(Point2::from).to_vec();
    let truth = SlowScene::new(&outline, Point2::new(0.05, 0.05), 1.5, &Standing::Feet(feet), slippery).unwrap();
    let mut before = Pose { x: 0.0, y: 0.0, theta: 0.0 };
    let known: Vec<_> = (0..8)
        .map(|i| {
            let (felt, after) = pushed(&truth, &before, 0.8 * f64::from(i), 0.012 * f64::from(i % 3 - 1));
            let push = KnownPush { felt, before, after };
            before = after;
            push
        })
        .collect();
    let (_, belief) = learned(&scene, &known, &FEW);
    // 0.8 times, and 0.1 that every push here has.
    let wanted = 0.8_f64.ln() + 0.1;
    assert!((belief.middle.friction_log - wanted).abs() < 0.04, "{}, wanted {wanted}", belief.middle.friction_log);
}

#[test]
fn sliding_pushes_tell_the_friction_of_each_edge() {
    let factors = [1.3, 0.8, 1.0];
    let truth = scene().with_edge_frictions(&factors);
    let before = Pose { x: 0.0, y: 0.0, theta: 0.0 };
    // At 48° to 54° to the normals of legs and hypotenuse, which the finger slides along on its way past the middle.
    let known: Vec<_> = [140.0_f64, -50.0, 175.0, -85.0]
        .into_iter()
        .flat_map(|way| (0..6).map(move |i| (way + f64::from(i % 3), 2e-3 * f64::from(i - 2))))
        .map(|(way, aside)| {
            let (felt, after) = pushed(&truth, &before, way.to_radians(), aside);
            KnownPush { felt, before, after }
        })
        .collect();
    let outline = SimplePolygon::new([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Point2::from)).unwrap();
    let standing = Standing::Face;
    let logs = [KnownLog { standing: &standing, pushes: &known }];
    let found = edge_frictions(&outline, Point2::new(0.05, 0.05), &logs, &SlowConstants::BOARD);
    // The force's frame is turned by 0.01 rad in every push: 3 % of the tangent, and its sign goes with the side.
    for edge in [0, 2] {
        let ratio = found[edge] / found[1] * factors[1] / factors[edge];
        assert!((ratio - 1.0).abs() < 0.06, "edge {edge}: {found:?}");
    }
    // Nothing slid, nothing is told.
    let few = [KnownLog { standing: &standing, pushes: &known[..2] }];
    assert_eq!(edge_frictions(&outline, Point2::new(0.05, 0.05), &few, &SlowConstants::BOARD), [1.0; 3]);
}

#[test]
fn as_many_are_taken_as_weights_say() {
    let taken = resampled(&[0.0, 1.0, 3.0, 0.0], 400, &mut Draw::new(1));
    let count = |number| taken.iter().filter(|taken| **taken == number).count();
    assert_eq!([count(0), count(1), count(2), count(3)], [0, 100, 300, 0]);
    assert_eq!(resampled(&[0.0, 0.0], 4, &mut Draw::new(1)), [0, 0, 1, 1]);
    assert!((effective_number(&[1.0, 1.0, 0.0]) - 2.0).abs() < 1e-12);
}

#[test]
fn a_region_of_one_normal_heap_has_its_ellipsoid() {
    // Through a kernel without tails a heap of one pose is normal: its 95 % region is the ellipsoid of 2.796 deviations
    // (chi-square of three freedoms, 7.815).
    let cloud = Cloud { poses: vec![Pose { x: 0.1, y: 0.2, theta: 3.1 }] };
    let kernel = Kernel { place: 1e-3, angle: 1.0_f64.to_radians(), tail_share: 0.0, tail_width: 3.0 };
    let region = Region::of(&cloud, kernel, &mut Draw::new(2));
    let [along, across, turn] = region.semi_axes().map(|axis| axis / 2.796);
    // A thousand poses leave the threshold uncertain by some per cent.
    assert!((along / 1e-3 - 1.0).abs() < 0.07, "{along}");
    assert!((across - along).abs() < 1e-12 && (turn / 1.0_f64.to_radians() - along / 1e-3).abs() < 1e-9);
    // The angle goes on across the cut.
    assert!(region.holds(&Pose { x: 0.1, y: 0.2, theta: 3.1 + 0.04 - std::f64::consts::TAU }));
    assert!(!region.holds(&Pose { x: 0.1, y: 0.2, theta: 3.1 + 0.06 }));
}

#[test]
fn heaps_share_a_cloud_out() {
    let mut draw = Draw::new(5);
    let mut about = |x: f64, theta: f64, count: usize| -> Vec<Pose> {
        let one =
            |_| Pose { x: x + 1e-3 * draw.normal(), y: 2e-3 * draw.normal(), theta: theta + 0.01 * draw.normal() };
        (0..count).map(one).collect()
    };
    let poses = [about(0.1, 3.1, 600), about(0.1, 0.0, 300), about(0.3, 3.1, 100)].concat();
    let cloud = Cloud { poses };
    let heaps = cloud.heaps(0.02);
    assert_eq!(heaps.len(), 3, "{heaps:?}");
    for (heap, (x, theta, share)) in heaps.iter().zip([(0.1, 3.1, 0.6), (0.1, 0.0, 0.3), (0.3, 3.1, 0.1)]) {
        assert!((heap.pose.x - x).abs() < 5e-4 && (heap.pose.theta - theta).abs() < 5e-3, "{heap:?}");
        assert!((heap.share - share).abs() < 0.01, "{heap:?}");
        // Of 100 poses a standard deviation is known to 7 %: four of these.
        let near = |value: f64, wanted: f64| (value / wanted - 1.0).abs() < 0.28;
        assert!(near(heap.sd[0], 1e-3) && near(heap.sd[1], 2e-3) && near(heap.sd[2], 0.01), "{heap:?}");
    }
    assert_eq!(cloud.middle(), heaps[0].pose);
}
