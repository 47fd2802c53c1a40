//! Slow pushes against slow, obvious code: sums over feet, integrals along edges by Simpson's rule, minima by the golden
//! section. None of it shares a formula with what is tested, but for the definition of the dissipation.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point2, Rotation2, Vector2, Vector3};

use super::instant::{Asked, Instant, Touching};
use super::support::{EVEN, Ground};
use super::*;
use crate::geometry::disk_curve::{DiskCurve, Feature, Place};
use crate::geometry::{Pose, SimplePolygon};
use crate::math::random::Draw;
use crate::search::never;

/// A ring of none is taken for a small one, whose cost is this share at most.
const RING: f64 = 3e-7;

/// Golden sections: each leaves 0.618 of the interval.
const SECTIONS: usize = 64;

fn block() -> SimplePolygon {
    SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from)).unwrap()
}

/// Where a part stands, as what is tested is told, and as the oracle keeps it.
struct World {
    outline: SimplePolygon,
    support: Support,
    centre: Point2<f64>,
    height: f64,
}

impl World {
    /// Feet, with rings of none in every third world, or an even face by this chance.
    fn draw(draw: &mut Draw, raised: bool, face: f64) -> Self {
        let outline = draw.convex_polygon(7, 0.05);
        let support = if draw.chance(1.0 - face) {
            let count = 3 + draw.index(4);
            let weights: Vec<_> = (0..count).map(|_| draw.between(0.5, 2.0)).collect();
            let sum: f64 = weights.iter().sum();
            let foot = |weight: &f64| Foot {
                at: Point2::new(draw.between(-0.04, 0.04), draw.between(-0.04, 0.04)),
                share: weight / sum,
                friction: draw.between(0.1, 0.6),
            };
            let feet = weights.iter().map(foot).collect();
            Support::Feet { feet, ring_radius: if draw.chance(0.3) { 0.0 } else { draw.between(2e-4, 3e-3) } }
        } else {
            Support::Uniform { friction: draw.between(0.1, 0.6) }
        };
        let centre = support.centre(&outline);
        Self { outline, support, centre, height: if raised { draw.between(0.0, 0.01) } else { 0.0 } }
    }

    fn ground(&self) -> Ground {
        Ground::new(&self.support, &self.outline, self.height, None)
    }

    /// Dissipation of a twist of the supports' centre per weight, under a load that rises by `slope` (1/m) from 1 there.
    fn dissipation(&self, twist: &Vector3<f64>, [constant, x, y]: [f64; 3]) -> f64 {
        let load = |at: Vector2<f64>| (constant + x * at.x + y * at.y).max(0.0);
        match &self.support {
            Support::Feet { feet, ring_radius } => {
                let lost = |foot: &Foot| {
                    let at = foot.at - self.centre;
                    let velocity = Vector2::new(twist.x - twist.z * at.y, twist.y + twist.z * at.x);
                    foot.friction * foot.share * load(at) * velocity.norm().hypot(ring_radius * twist.z)
                };
                feet.iter().map(lost).sum()
            }
            Support::Uniform { friction } => {
                let (area, pole) = (self.outline.area(), Vector2::new(-twist.y, twist.x) / twist.z);
                let is_near = pole.norm() < 0.2;
                if !is_near {
                    // The speed is smooth: over the triangles from the centre to each edge.
                    let speed = |at: Vector2<f64>| {
                        load(at) * Vector2::new(twist.x - twist.z * at.y, twist.y + twist.z * at.x).norm()
                    };
                    let over = |from: Vector2<f64>, to: Vector2<f64>| {
                        let ray = |out: f64| out * simpson(40, &|share| speed((from + (to - from) * share) * out));
                        from.perp(&to) * simpson(40, &ray)
                    };
                    let edges = self.outline.edges().map(|(a, b)| (a - self.centre, b - self.centre));
                    return friction / area * edges.map(|(a, b)| over(a, b)).sum::<f64>();
                }
                // ∫ (k + s·p) |p| dA = ∮ (k/3 + s·p/4) |p| p × dp about the centre of rotation.
                let at_pole = constant + x * pole.x + y * pole.y;
                let along = |from: Vector2<f64>, to: Vector2<f64>| {
                    let value = |share: f64| {
                        let p = from + (to - from) * share;
                        (at_pole / 3.0 + (x * p.x + y * p.y) / 4.0) * p.norm()
                    };
                    from.perp(&to) * simpson(400, &value)
                };
                let edges = self.outline.edges().map(|(a, b)| (a - self.centre - pole, b - self.centre - pole));
                friction * twist.z.abs() / area * edges.map(|(a, b)| along(a, b)).sum::<f64>()
            }
        }
    }
}

/// The mean of a function from 0 to 1.
fn simpson(pieces: u32, value: &dyn Fn(f64) -> f64) -> f64 {
    let at = |k: u32| value(f64::from(k) / f64::from(2 * pieces));
    let inner: f64 = (0..pieces).map(|k| at(2 * k) + 4.0 * at(2 * k + 1) + at(2 * k + 2)).sum();
    inner / f64::from(6 * pieces)
}

/// Where a convex function is least, and the least.
fn golden(function: &mut dyn FnMut(f64) -> f64, from: f64, to: f64) -> (f64, f64) {
    let share = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut a, mut b) = (from, to);
    let (mut c, mut d) = (b - share * (b - a), a + share * (b - a));
    let (mut at_c, mut at_d) = (function(c), function(d));
    for _ in 0..SECTIONS {
        if at_c < at_d {
            (b, d, at_d) = (d, c, at_c);
            c = b - share * (b - a);
            at_c = function(c);
        } else {
            (a, c, at_c) = (c, d, at_d);
            d = a + share * (b - a);
            at_d = function(d);
        }
    }
    (0.5 * (a + b), at_c.min(at_d))
}

/// The place of a contact on the outline, seen from the supports' centre.
fn touch(draw: &mut Draw, world: &World) -> Touching {
    let edges: Vec<_> = world.outline.edges().collect();
    let (from, to) = edges[draw.index(edges.len())];
    let along = (to - from).normalize();
    let at = from + (to - from) * draw.unit() - world.centre;
    Touching { at, normal: Vector2::new(along.y, -along.x) }
}

/// The twist of the supports' centre.
fn twist(asked: &Asked, instant: &Instant) -> Vector3<f64> {
    let at_contact = asked.velocity + instant.slip * asked.touching.tangent();
    with_contact(asked.touching.at, at_contact, instant.omega)
}

/// The twist of the supports' centre of a part that turns while a point of it moves in a known way.
fn with_contact(at: Vector2<f64>, velocity: Vector2<f64>, omega: f64) -> Vector3<f64> {
    Vector3::new(velocity.x + omega * at.y, velocity.y - omega * at.x, omega)
}

fn asked(draw: &mut Draw, world: &World, slides: bool) -> Asked {
    let touching = touch(draw, world);
    let velocity = Rotation2::new(draw.between(-1.2, 1.2)) * -touching.normal;
    let edge = Rotation2::new(draw.between(0.05, 0.6) * if draw.chance(0.5) { 1.0 } else { -1.0 }) * -touching.normal;
    Asked { touching, velocity, force: slides.then_some(edge) }
}

#[test]
fn a_sticking_part_moves_as_costs_least() {
    for case in 0..600 {
        let draw = &mut Draw::case(1, case);
        let world = World::draw(draw, false, 0.1);
        let asked = asked(draw, &world, false);
        let found = world.ground().motion(&asked, None).unwrap();
        let cost =
            |omega: f64| world.dissipation(&with_contact(asked.touching.at, asked.velocity, omega), [1.0, 0.0, 0.0]);
        let (omega, least) = golden(&mut |omega| cost(omega), -500.0, 500.0);
        // A turn of the part's size, at least.
        let scale = omega.abs().max(20.0);
        // Where a foot all but rests the cost has a kink there.
        assert!((found.omega - omega).abs() <= 1e-6 * scale, "case {case}: {} {omega}", found.omega);
        // The cost is what the finger spends, and how it changes with the finger's velocity is the force.
        let spent = found.force.dot(&asked.velocity);
        assert!((spent - least).abs() <= 1e-7 * least, "case {case}: {spent} {least}");
    }
}

#[test]
fn a_sliding_part_moves_as_costs_least_for_the_power_it_takes() {
    let mut slid = 0;
    for case in 0..400 {
        let draw = &mut Draw::case(2, case);
        let world = World::draw(draw, false, 0.02);
        let asked = asked(draw, &world, true);
        let direction = asked.force.unwrap();
        let across = Vector2::new(-direction.y, direction.x);
        let cost = |aside: f64, omega: f64| {
            world.dissipation(&with_contact(asked.touching.at, direction + across * aside, omega), [1.0, 0.0, 0.0])
        };
        let (aside, least) = golden(&mut |aside| golden(&mut |omega| cost(aside, omega), -500.0, 500.0).1, -10.0, 10.0);
        let omega = golden(&mut |omega| cost(aside, omega), -500.0, 500.0).0;
        let Some(found) = world.ground().motion(&asked, None) else {
            // Such a force moves the contact away from the finger: it cannot slide so.
            let away = (direction + across * aside).dot(&asked.touching.normal);
            assert!(away > -1e-6, "case {case}: {away}");
            continue;
        };
        slid += 1;
        let strength = found.force.norm();
        assert!(found.force.perp(&direction).abs() <= 1e-7 * strength, "case {case}");
        // Per unit of power the cost is the force's size.
        assert!((strength - least).abs() <= 1e-6 * least, "case {case}: {strength} {least}");
        let found = twist(&asked, &found);
        let wanted = with_contact(asked.touching.at, direction + across * aside, omega);
        let (x, y) = (found.normalize(), wanted.normalize());
        // In a plane, a turn and a velocity at 5 cm are alike; the part's motion is known by its direction.
        assert!((x - y).norm() <= 1e-5 || x.dot(&y) < 0.0 && (x + y).norm() <= 1e-5, "case {case}: {found} {wanted}");
    }
    assert!(slid > 350, "{slid}");
}

/// Friction is the wrench that a convex dissipation supports: no motion gives the force more power than it costs.
#[test]
fn no_motion_takes_more_power_than_it_costs_and_loads_balance() {
    let mut raised = 0;
    for case in 0..1000 {
        let draw = &mut Draw::case(3, case);
        let world = World::draw(draw, true, 0.3);
        let slides = draw.chance(0.5);
        let asked = asked(draw, &world, slides);
        let ground = world.ground();
        let Some(found) = ground.motion_anew(&asked, None) else { continue };
        if ground.load_least(&found.load) < 0.0 {
            continue;
        }
        raised += 1;
        let [constant, x, y] = ground.load_in_metres(&found.load);
        let pressed =
            world.outline.vertices().iter().map(|p| p - world.centre).all(|p| constant + x * p.x + y * p.y >= 0.0);
        if matches!(world.support, Support::Uniform { .. }) && !pressed {
            continue; // The oracle's integrals are over the whole face.
        }
        let cost = |twist: &Vector3<f64>| world.dissipation(twist, [constant, x, y]);
        let power = |twist: &Vector3<f64>| {
            let at = asked.touching.at;
            found.force.x * (twist.x - twist.z * at.y) + found.force.y * (twist.y + twist.z * at.x)
        };
        let motion = twist(&asked, &found);
        let exact = cost(&motion);
        assert!((exact - power(&motion)).abs() <= RING * exact, "case {case}: {exact} {}", power(&motion));
        for _ in 0..50 {
            let near = draw.chance(0.5);
            let size = if near { 1e-3 } else { 1.0 };
            let other = Vector3::new(draw.normal(), draw.normal(), 20.0 * draw.normal()) * size * motion.xy().norm();
            let other = if near { motion + other } else { other };
            assert!(power(&other) <= cost(&other) + RING * exact, "case {case}: {} {}", power(&other), cost(&other));
        }
        if let Support::Feet { feet, .. } = &world.support {
            let bears = |foot: &Foot| {
                let at = foot.at - world.centre;
                foot.share * (constant + x * at.x + y * at.y).max(0.0)
            };
            let whole: f64 = feet.iter().map(bears).sum();
            let middle: Vector2<f64> = feet.iter().map(|foot| (foot.at - world.centre) * bears(foot)).sum();
            assert!((whole - 1.0).abs() < 1e-12 || world.height == 0.0, "case {case}: {whole}");
            assert!((middle - found.force * world.height).norm() < 1e-10, "case {case}: {middle}");
        }
    }
    assert!(raised > 900, "{raised}");
}

#[test]
fn a_face_under_rising_pressure_resists_as_its_integral() {
    for case in 0..200 {
        let draw = &mut Draw::case(4, case);
        let outline = draw.convex_polygon(6, 0.05);
        let support = Support::Uniform { friction: 0.3 };
        let world = World { centre: outline.centroid(), outline, support, height: 0.01 };
        let ground = world.ground();
        // Near and far centres of rotation.
        let omega = 10.0_f64.powf(draw.between(0.0, 3.0)) * if draw.chance(0.5) { 1.0 } else { -1.0 };
        let motion = Vector3::new(draw.normal(), draw.normal(), omega);
        let Some(loaded) = ground.loaded(&motion, &EVEN) else { continue };
        let [constant, x, y] = ground.load_in_metres(&loaded.load);
        if !world.outline.vertices().iter().map(|p| p - world.centre).all(|p| constant + x * p.x + y * p.y >= 0.0) {
            continue;
        }
        let cost = world.dissipation(&motion, [constant, x, y]);
        assert!(
            (loaded.wrench.dot(&motion) - cost).abs() <= 1e-9 * cost,
            "case {case}: {} {cost}",
            loaded.wrench.dot(&motion)
        );
    }
}

#[test]
fn friction_changes_with_the_twist_as_its_gradient_says() {
    for case in 0..300 {
        let draw = &mut Draw::case(5, case);
        let mut world = World::draw(draw, true, 0.3);
        if let Support::Feet { ring_radius, .. } = &mut world.support {
            *ring_radius = ring_radius.max(2e-3);
        }
        let ground = world.ground();
        let motion = Vector3::new(draw.normal(), draw.normal(), 20.0 * draw.normal());
        let Some(loaded) = ground.loaded(&motion, &EVEN) else { continue };
        for column in 0..3 {
            let mut step = Vector3::zeros();
            step[column] = if column == 2 { 2e-4 } else { 1e-5 };
            let look = |twist: Vector3<f64>| ground.loaded(&twist, &loaded.load).map(|loaded| loaded.wrench);
            let (Some(before), Some(after)) = (look(motion - step), look(motion + step)) else { continue };
            let slope = (after - before) / (2.0 * step[column]);
            let told = Vector3::from(loaded.gradient.column(column));
            let scale = loaded.gradient.column(column).norm().max(1e-3);
            assert!((slope - told).norm() <= 2e-3 * scale, "case {case}: {slope} {told}");
        }
    }
}

/// A push along a bent path, at a part on three feet.
fn push() -> SlowPush {
    let feet = [([-0.02, -0.01], 0.3), ([0.02, -0.01], 0.3), ([0.0, 0.015], 0.4)];
    let feet = feet.map(|(at, share)| Foot { at: at.into(), share, friction: 0.3 }).to_vec();
    SlowPush {
        outline: block(),
        support: Support::Feet { feet, ring_radius: 1e-3 },
        centre_of_mass: None,
        gravity: 9.81,
        height: 0.005,
        radius: 0.004,
        contact_friction: [0.2, 0.25],
        path: [[0.02, -0.03], [0.018, -0.02], [0.014, -0.01], [0.03, 0.0]].map(Point2::from).to_vec(),
        pose: Pose { x: 0.0, y: 0.0, theta: 0.0 },
        step_max: 5e-4,
    }
}

fn run(push: &SlowPush) -> SlowRun {
    push.run(&never).unwrap()
}

fn assert_alike(a: &SlowRun, b: &SlowRun, tolerance: f64) {
    assert_eq!((a.end, a.samples.len()), (b.end, b.samples.len()));
    for (a, b) in a.samples.iter().zip(&b.samples) {
        let apart = (a.pose.origin() - b.pose.origin()).norm() / 0.06 + (a.pose.theta - b.pose.theta).abs();
        assert!(apart <= tolerance, "{a:?} {b:?}");
        assert_eq!(
            a.contact.map(|contact| (contact.mode, contact.element)),
            b.contact.map(|contact| (contact.mode, contact.element))
        );
        if let (Some(a), Some(b)) = (a.contact, b.contact) {
            assert!((a.force - b.force).norm() <= 10.0 * tolerance * a.force.norm(), "{a:?} {b:?}");
        }
    }
}

#[test]
fn shorter_steps_change_nothing() {
    let coarse = run(&push());
    assert!(
        coarse.samples.iter().any(|sample| sample.contact.is_some_and(|contact| contact.mode == SlowMode::Sliding))
    );
    assert_alike(&coarse, &run(&SlowPush { step_max: 3e-5, ..push() }), 1e-9);
}

#[test]
fn points_on_the_way_change_nothing() {
    let mut finer = push();
    finer.path = finer
        .path
        .windows(2)
        .flat_map(|pair| (0..7).map(|k| pair[0] + (pair[1] - pair[0]) * (f64::from(k) / 7.0)))
        .collect();
    finer.path.push(*push().path.last().unwrap());
    let mut run_finer = run(&finer);
    run_finer.samples = run_finer.samples.into_iter().step_by(7).collect();
    assert_alike(&run(&push()), &run_finer, 1e-9);
}

#[test]
fn a_turned_world_is_pushed_the_same() {
    let turn = Rotation2::new(2.0);
    let mut turned = push();
    turned.path.iter_mut().for_each(|point| *point = turn * *point);
    turned.pose.theta = 2.0;
    let mut back = run(&turned);
    for sample in &mut back.samples {
        let origin = turn.inverse() * sample.pose.origin();
        sample.pose = Pose { x: origin.x, y: origin.y, theta: sample.pose.theta - 2.0 };
        if let Some(contact) = &mut sample.contact {
            contact.force = turn.inverse() * contact.force;
        }
    }
    assert_alike(&run(&push()), &back, 1e-10);
}

#[test]
fn a_block_pushed_at_its_middle_goes_straight_until_the_path_ends() {
    let mut straight = push();
    straight.support = Support::Uniform { friction: 0.3 };
    straight.path = [[0.0, -0.03], [0.0, -0.03], [0.0, -0.014]].map(Point2::from).to_vec();
    let run = run(&straight);
    assert_eq!((run.end, run.samples.len()), (SlowEnd::Path, 3));
    assert_eq!(run.samples[0], run.samples[1], "a repeated point repeats its sample");
    let SlowSample { pose, contact: Some(contact) } = run.samples[2] else { panic!("{run:?}") };
    assert!(pose.x.abs() < 1e-12 && (pose.y - 0.010).abs() < 1e-12 && pose.theta.abs() < 1e-12, "{pose:?}");
    assert!((contact.force - Vector2::new(0.0, 0.3 * 9.81)).norm() < 1e-9, "{contact:?}");
    assert_eq!((contact.mode, contact.element), (SlowMode::Sticking, Element::Edge(0)));
    assert!((contact.normal_angle + 0.5 * PI).abs() < 1e-12);
}

/// What is told of changes is what samples show, and where: no mode lasts between two of them.
#[test]
fn changes_are_where_the_contact_is_seen_to_change() {
    // Up to the part, aside one way and the other, and away from it.
    let legs = [[0.02, -0.03], [0.02, -0.016], [0.03, -0.015], [0.0, -0.012], [0.0, -0.03]];
    let coarse = SlowPush { path: legs.map(Point2::from).to_vec(), ..push() };
    let mut finer = coarse.clone();
    let ways = &coarse.path;
    let way = |pair: &[Point2<f64>]| {
        (0..400).map(|k| pair[0] + (pair[1] - pair[0]) * (f64::from(k) / 400.0)).collect::<Vec<_>>()
    };
    finer.path = ways.windows(2).flat_map(way).chain(ways.last().copied()).collect();
    let found = run(&finer);
    let mut lengths = vec![0.0];
    lengths.extend(finer.path.windows(2).scan(0.0, |sum, pair| {
        *sum += (pair[1] - pair[0]).norm();
        Some(*sum)
    }));
    let modes: Vec<_> = found.samples.iter().map(|sample| sample.contact.map(|contact| contact.mode)).collect();
    let seen: Vec<_> = (1..modes.len()).filter(|&i| modes[i] != modes[i - 1]).collect();
    assert!(seen.len() >= 3, "it touches, and slips more than once: {:?}", found.changes);
    assert_eq!(seen.len(), found.changes.len(), "{:?}", found.changes);
    for (&i, change) in seen.iter().zip(&found.changes) {
        assert_eq!(change.to, modes[i]);
        // A sample shows the motion that arrives at it.
        assert!((lengths[i - 1] - 1e-12..=lengths[i]).contains(&change.length), "{change:?} {}", lengths[i]);
    }
    // However finely it is looked at, and turned.
    assert_eq!(run(&coarse).changes.len(), found.changes.len());
}

#[test]
fn a_push_far_above_the_plane_tips_the_part() {
    let high = SlowPush { height: 0.5, ..push() };
    let run = run(&high);
    assert_eq!(run.end, SlowEnd::Tip);
    assert!(run.length < 0.02, "{}", run.length);
}

#[test]
fn a_finger_in_a_notch_meets_its_other_side() {
    let notched = [
        [-0.03, -0.02],
        [-0.01, -0.02],
        [-0.01, 0.0],
        [0.01, 0.0],
        [0.01, -0.02],
        [0.03, -0.02],
        [0.03, 0.02],
        [-0.03, 0.02],
    ];
    let mut push = push();
    push.outline = SimplePolygon::new(notched.map(Point2::from)).unwrap();
    push.height = 0.0;
    push.path = [[0.004, -0.03], [0.004, -0.002], [0.03, -0.002]].map(Point2::from).to_vec();
    let run = run(&push);
    assert_eq!((run.end, run.samples.len()), (SlowEnd::SecondContact, 2), "{run:?}");
}

#[test]
fn a_finger_inside_the_part_is_refused() {
    let mut inside = push();
    inside.path[0] = Point2::new(0.0, -0.0235);
    let refused = inside.run(&never);
    assert!(matches!(refused, Err(SlowPushError::Overlap { depth }) if (depth - 5e-4).abs() < 1e-12), "{refused:?}");
    inside.path[0] = Point2::new(0.0, -0.024 + 5e-10);
    assert!(inside.run(&never).is_ok(), "touching to 1e-9 m is not overlapping");
    inside.path[0] = Point2::origin();
    assert!(matches!(inside.run(&never), Err(SlowPushError::Overlap { .. })));
}

#[test]
fn a_push_ends_when_it_is_asked_to() {
    assert!(matches!(push().run(&|| true), Err(SlowPushError::Stopped { .. })));
}

#[test]
fn what_nothing_resists_is_refused() {
    let smooth = SlowPush { support: Support::Uniform { friction: 0.0 }, ..push() };
    assert_eq!(smooth.run(&never), Err(SlowPushError::NoFriction));
    let feet = [-0.01, 0.0, 0.02].map(|x| Foot { at: Point2::new(x, x), share: 1.0 / 3.0, friction: 0.3 }).to_vec();
    let on_a_line = SlowPush { support: Support::Feet { feet, ring_radius: 1e-3 }, ..push() };
    assert_eq!(on_a_line.run(&never), Err(SlowPushError::FeetOnALine));
    assert!(SlowPush { height: 0.0, ..on_a_line }.run(&never).is_ok());
}

/// The disk's centre goes once round the part along sides and about corners.
#[test]
fn the_centres_curve_closes() {
    let outline = DiskCurve::new(&block(), 0.004);
    let mut place = Place { feature: Feature::Side(0), along: 0.0 };
    let mut length = 0.0;
    for _ in 0..8 {
        let [_, on] = outline.bounds(place);
        length += on.along;
        let there = outline.touched(Place { along: on.along, ..place });
        place = on.next.unwrap();
        let next = outline.touched(place);
        assert!((there.at - next.at).norm() < 1e-15 && (there.normal - next.normal).norm() < 1e-15, "{place:?}");
    }
    assert_eq!(place.feature, Feature::Side(0));
    assert!((length - (0.2 + TAU * 0.004)).abs() < 1e-12, "{length}");
}

/// Where the part would slide along the finger, its motion ends in rounding: the finger leaves, whatever the steps.
#[test]
fn a_finger_that_slides_off_leaves_whatever_the_steps() {
    let vertices = [
        [-0.03360409301730394, 0.034879543780808646],
        [-0.012108783046418228, -0.025705961830257387],
        [0.036382320976296165, 0.0011256358442904568],
        [0.015008307571371685, 0.03807860953096435],
    ];
    let feet = [
        [0.006920661655758525, 0.00569758612550109, 0.31331927988232905],
        [-0.013713773084408222, 0.01992230640244103, 0.34308766220949233],
        [-0.006890435892760727, 0.005538729690897859, 0.34359305790817873],
    ];
    let foot = |[x, y, share]: [f64; 3]| Foot { at: Point2::new(x, y), share, friction: 0.22638202718276104 };
    let path = [[0.09685988661419596, -0.10627141427463287], [0.05961924930237764, 0.004327070943789123]];
    let [x, y, theta] = [0.04933870134326612, -0.02730757713481978, -2.816409313044792];
    for step in 1..=8 {
        let pushed = SlowPush {
            outline: SimplePolygon::new(vertices.map(Point2::from)).unwrap(),
            support: Support::Feet { feet: feet.map(foot).to_vec(), ring_radius: 0.0 },
            height: 0.0,
            radius: 0.02,
            contact_friction: [0.529829650399619; 2],
            path: path.map(Point2::from).to_vec(),
            pose: Pose { x, y, theta },
            step_max: 1e-4 * f64::from(step),
            ..push()
        };
        let run = pushed.run(&never).unwrap();
        assert_eq!(run.end, SlowEnd::Path, "{step}");
        let last = run.samples.last().unwrap();
        assert!(last.contact.is_none() && (last.pose.theta + 1.31171442).abs() < 1e-7, "{step}: {last:?}");
    }
}
