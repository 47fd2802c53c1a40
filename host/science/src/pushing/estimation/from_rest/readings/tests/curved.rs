//! Elliptic parts and fingers against pushes of the error-controlled simulation, noise drawn.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::super::*;
use super::NOISE_N;
use crate::gravity::GRAVITY_ASSUMED;
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;
use crate::math::statistics::chi_square_quantile;
use crate::pushing::dynamics::{
    Body, ContactLaw, EdgeEnd, EndReason, FingerPath, Mass, PartSide, Sample, ShapedModel, ShapedPush, Start,
};
use crate::pushing::finger_motion::Segment;
use crate::search::never;

/// The finger goes ahead, then turns aside.
const TURN: [(f64, [f64; 2]); 2] = [(0.3, [0.15, 0.0]), (0.3, [0.02, 0.15])];

/// From one reading to the next, s: none at the turn.
const PERIOD_S: f64 = 8e-3;

const MU: f64 = 0.3;

const RADIUS_M: f64 = 6e-3;

/// A push of an elliptic part.
struct Push {
    part: Part,
    shape: Option<FingerShape>,
    motion: FingerMotion,
    mass: f64,
    samples: Vec<Sample>,
}

impl Push {
    /// One that lasts as long as the finger's motion.
    fn draw(
        draw: &mut Draw,
        semi_axes: [f64; 2],
        shape: Option<FingerShape>,
        centre_of_mass: Option<Point2<f64>>,
    ) -> Self {
        let body = centre_of_mass.map_or_else(
            || Body::ellipse(semi_axes),
            |centre_of_mass| {
                let mass = Mass { centre_of_mass, ..Mass::of_ellipse(semi_axes) };
                Body::uniform(crate::pushing::dynamics::support::SupportFriction::ellipse(semi_axes), mass)
            },
        );
        let part = Part::elliptic(semi_axes, body);
        let motion = FingerMotion::new(
            Point2::origin(),
            &TURN.map(|(seconds, acceleration)| Segment { seconds, acceleration: acceleration.into() }),
        )
        .unwrap();
        loop {
            let (u, s) = (draw.uniform(-0.5, 0.5), draw.uniform(0.0, std::f64::consts::TAU));
            let (mass, mu_c) = (draw.uniform(0.1, 0.5), draw.uniform(0.15, 0.5));
            if let Some(samples) = run(&part, shape, mu_c, [u, s]) {
                return Self { part, shape, motion, mass, samples };
            }
        }
    }

    fn shape(&self) -> FingerShape {
        self.shape.unwrap_or(FingerShape::Disk { radius: RADIUS_M })
    }

    fn readings(&self, draw: &mut Draw) -> Vec<ForceReading> {
        let mut read = |time: f64, force: Vector2<f64>| ForceReading {
            time,
            force: force + Vector2::new(draw.normal(), draw.normal()) * NOISE_N,
        };
        let before = [read(-0.02, Vector2::zeros()), read(-0.01, Vector2::zeros())];
        let after: Vec<_> = self
            .samples
            .iter()
            .map(|sample| {
                let (sin, cos) = self.shape().normal_angle(sample.state.u).sin_cos();
                let force = sample.force.unwrap();
                let on_part = Vector2::new(cos, sin) * force.normal + Vector2::new(sin, -cos) * force.tangential;
                read(sample.t, -on_part * self.mass)
            })
            .collect();
        before.into_iter().chain(after).collect()
    }

    fn known(&self) -> KnownOfFinger<'_> {
        let shape = self.shape;
        KnownOfFinger { shape, ..KnownOfFinger::new(&self.part, MU * GRAVITY_ASSUMED, RADIUS_M, &self.motion, NOISE_N) }
    }

    /// How far a hypothesis is off, m and rad, and squared in what it states.
    fn off(&self, found: &ForceHypothesis) -> (f64, f64, f64) {
        let last = self.samples.last().unwrap();
        let pose = found.pose_end;
        let [x, y, theta] = pose.into();
        let angle = wrap_angle(theta - last.theta);
        let off = Vector3::new(x - last.position.x, y - last.position.y, angle);
        let slack = Matrix3::from_diagonal(&Vector3::new(5e-6, 5e-6, 5e-5).map(|sd: f64| sd * sd));
        let covariance = found.covariance.fixed_view::<3, 3>(0, 0) + slack;
        (off.xy().norm(), angle.abs(), (off.transpose() * covariance.try_inverse().unwrap() * off)[0])
    }
}

fn run(part: &Part, shape: Option<FingerShape>, mu_c: f64, [u, s]: [f64; 2]) -> Option<Vec<Sample>> {
    let shape = shape.unwrap_or(FingerShape::Disk { radius: RADIUS_M });
    let path = FingerPath { centre0: Point2::origin(), velocity0: Vector2::zeros(), acceleration: TURN[0].1.into() };
    let side = part.touched(0).unwrap();
    assert!(matches!(side, PartSide::Ellipse { .. }));
    let model = ShapedModel::new(part.body(), side, MU * GRAVITY_ASSUMED, shape, path).unwrap();
    let law = ContactLaw::Coulomb { friction: mu_c };
    let push = ShapedPush::new(model, law, Start::Rest { u, s }, EdgeEnd::Stop).ok()?;
    let push = push.with_changes(&[(TURN[0].0, TURN[1].1.into())]).unwrap();
    let times: Vec<_> = (0..75).map(|n| 1e-3 + PERIOD_S * f64::from(n)).collect();
    let run = push.run(&times).ok()?;
    (run.end.reason == EndReason::Time).then_some(run.samples)
}

/// Semi-axes by which a turn is told.
fn longish(draw: &mut Draw) -> [f64; 2] {
    let a = draw.uniform(0.02, 0.045);
    [a, a * draw.uniform(0.5, 0.85)]
}

/// The truth is among what is found, and nothing else is found alone.
fn assert_found(push: &Push, known: &KnownOfFinger, readings: &[ForceReading], equal: usize, case: usize) {
    let found = estimate_until(known, readings, &never).found;
    let off: Vec<_> = found.iter().map(|found| push.off(found)).collect();
    let is_right = |(distance, angle, squared): &(f64, f64, f64)| {
        *squared < chi_square_quantile(0.999, 3) || (*distance < 2e-4 && *angle < 3e-3)
    };
    assert!(off.iter().any(is_right), "case {case}: {off:?} {found:#?} {:?}", push.samples[0]);
    assert!(found.len().is_multiple_of(equal), "case {case}: {}", found.len());
    let all: f64 = found.iter().map(|found| found.probability).sum();
    assert!((all - 1.0).abs() < 1e-9, "{all}");
}

#[test]
fn an_elliptic_part_is_found_with_the_turn_that_looks_the_same() {
    for case in 0..4 {
        let mut draw = Draw::case(61, case);
        let semi_axes = longish(&mut draw);
        let push = Push::draw(&mut draw, semi_axes, None, None);
        let readings = push.readings(&mut draw);
        assert_found(&push, &push.known(), &readings, 2, case);
    }
}

#[test]
fn an_elliptic_part_with_its_mass_aside_has_one_turn_that_fits() {
    for case in 0..2 {
        let mut draw = Draw::case(62, case);
        let semi_axes = longish(&mut draw);
        let push = Push::draw(&mut draw, semi_axes, None, Some(Point2::new(4e-3, -2e-3)));
        let readings = push.readings(&mut draw);
        assert_found(&push, &push.known(), &readings, 1, case);
    }
}

#[test]
fn an_elliptic_finger_finds_an_elliptic_part() {
    for case in 0..3 {
        let mut draw = Draw::case(63, case);
        let (semi_axes, finger) = (longish(&mut draw), [draw.uniform(4e-3, 9e-3), draw.uniform(4e-3, 9e-3)]);
        let push = Push::draw(&mut draw, semi_axes, Some(FingerShape::Ellipse { semi_axes: finger }), None);
        let readings = push.readings(&mut draw);
        assert_found(&push, &push.known(), &readings, 2, case);
    }
}

/// A disk looks the same however it is turned: its place is told, and its angle is said to be anything.
#[test]
fn of_a_disk_no_angle_is_told() {
    let mut draw = Draw::case(64, 0);
    let push = Push::draw(&mut draw, [0.03, 0.03], None, None);
    let found = estimate_until(&push.known(), &push.readings(&mut draw), &never).found;
    let [only] = &found[..] else { panic!("{found:#?}") };
    assert!(only.is_continuum);
    let (distance, ..) = push.off(only);
    assert!(distance < 3e-4, "{distance} m");
}

/// The general model with a finger that is an ellipse in name only leads to what the disk's own model leads to.
#[test]
fn a_round_ellipse_finds_on_a_polygon_what_the_disk_finds() {
    for case in 0..2 {
        let mut draw = Draw::case(65, case);
        let drawn = super::Case::draw(&mut draw);
        let readings = drawn.readings(&mut draw, 0.0);
        let known = drawn.known(&drawn.part);
        let shape = FingerShape::Ellipse { semi_axes: [known.radius; 2] };
        let disk = estimate_until(&known, &readings, &never).found;
        let ellipse = estimate_until(&KnownOfFinger { shape: Some(shape), ..known }, &readings, &never).found;
        assert_eq!(disk.len(), ellipse.len(), "case {case}");
        for (disk, ellipse) in disk.iter().zip(&ellipse) {
            let off = disk.pose_end.minus(&ellipse.pose_end);
            // Fits end within a fiftieth of a standard deviation's cost: a seventh of one.
            let sd = |index: usize| disk.covariance[(index, index)].sqrt() + 1e-7;
            assert!((0..3).all(|index| off[index].abs() < 0.2 * sd(index)), "case {case}: {off}");
            assert_eq!(disk.edge, ellipse.edge);
        }
    }
}
