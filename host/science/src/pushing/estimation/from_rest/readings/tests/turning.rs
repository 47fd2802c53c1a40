//! A wrist that turns while it pushes, against a world that shares nothing with the estimator: Newton and Euler in
//! Cartesian coordinates, frictions that rise steeply with speed instead of modes, small explicit steps.

use nalgebra::{Matrix3, Point2, Vector2, Vector3};

use super::super::*;
use super::NOISE_N;
use crate::geometry::SimplePolygon;
use crate::gravity::GRAVITY_ASSUMED;
use crate::math::random::Draw;
use crate::math::statistics::chi_square_quantile;
use crate::pushing::dynamics::Mass;
use crate::pushing::measured_path::MeasuredPath;
use crate::pushing::measured_turn::MeasuredTurn;
use crate::search::never;

const RADIUS_M: f64 = 0.01;
const MASS_KG: f64 = 0.25;
const FINGER_KG: f64 = 0.02;
const MU: f64 = 0.3;
const MU_C: f64 = 0.3;

/// What is added to the path's time is that of the force, s.
const OFFSET_S: f64 = 6e-3;

/// Steps of the world, s.
const STEP_S: f64 = 1.25e-7;

/// A reading every 8 ms.
const STEPS_A_READING: u32 = 64_000;

/// Of a push: 0.62 s.
const STEPS: u32 = 4_960_000;

/// Speeds at which frictions have most of their size, m/s: at a contact, and of a foot. Passed before the first reading of
/// a push that begins as this one does: a world whose friction comes later is another one.
const STEEP: (f64, f64) = (5e-7, 5e-7);

/// Corners, and feet with their shares.
const CORNERS: [[f64; 2]; 4] = [[-0.04, -0.025], [0.035, -0.03], [0.045, 0.02], [-0.03, 0.035]];
const FEET: [([f64; 2], f64); 4] =
    [([-0.03, -0.02], 0.28), ([0.03, -0.022], 0.27), ([0.035, 0.015], 0.22), ([-0.02, 0.026], 0.23)];

fn part() -> Part {
    let polygon = SimplePolygon::new(CORNERS.map(Point2::from)).unwrap();
    let mass = Mass::uniform(&polygon);
    Part::on_feet(polygon, &FEET.map(|(at, share)| (Point2::from(at), share)), mass)
}

/// Of the clamp: ahead, and aside from 0.25 s on.
fn acceleration(t: f64) -> Vector2<f64> {
    let bump = |t: f64, length: f64| {
        if t > 0.0 && t < length { (std::f64::consts::PI * t / length).sin() } else { 0.0 }
    };
    Vector2::new(0.25 * bump(t, 0.5), 0.35 * bump(t - 0.25, 0.5))
}

/// Angle, rate and its rate of the wrist: it begins at rest, somewhat turned.
fn wrist(t: f64, most: f64) -> [f64; 3] {
    let w = std::f64::consts::TAU / 1.2;
    if t <= 0.0 {
        return [0.3, 0.0, 0.0];
    }
    [0.3 + 0.5 * most * (1.0 - (w * t).cos()), 0.5 * most * w * (w * t).sin(), 0.5 * most * w * w * (w * t).cos()]
}

fn left(v: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

/// A world as it is: the part's centre of mass and turn with their rates; the clamp's place and velocity.
#[derive(Clone, Copy)]
struct World {
    at: Vector3<f64>,
    rate: Vector3<f64>,
    finger: Vector2<f64>,
    speed: Vector2<f64>,
}

impl World {
    /// The finger at the origin touches an edge at a contact angle and a place (m) along it.
    fn touching(part: &Part, edge: usize, u: f64, s: f64) -> Self {
        let edge = part.edge(edge).unwrap();
        let inward = Vector2::new(u.cos(), u.sin());
        // n turns to −inward.
        let theta = (-inward.y).atan2(-inward.x) - edge.normal.y.atan2(edge.normal.x);
        let n = -inward;
        let centre = inward * RADIUS_M - n * edge.height - left(n) * s;
        Self {
            at: Vector3::new(centre.x, centre.y, theta),
            rate: Vector3::zeros(),
            finger: Vector2::zeros(),
            speed: Vector2::zeros(),
        }
    }

    /// Accelerations of the part and the force on it, N.
    fn forces(&self, part: &Part, edge: usize, t: f64, most: f64) -> (Vector3<f64>, Vector2<f64>) {
        let edge = part.edge(edge).unwrap();
        let rotation = nalgebra::Rotation2::new(self.at.z);
        let (n, omega) = (rotation * edge.normal, self.rate.z);
        let (along, v) = (left(n), self.rate.xy());
        let mut drag = Vector3::zeros();
        for (foot, share) in FEET {
            let arm = rotation * (Point2::from(foot) - part.centre_of_mass());
            let slides = v + left(arm) * omega;
            let force = -slides / slides.norm().hypot(STEEP.1) * (share * MU * GRAVITY_ASSUMED);
            drag += Vector3::new(force.x, force.y, arm.perp(&force) / part.inertia_per_mass());
        }
        let from_centre = self.finger - self.at.xy();
        let contact = from_centre - n * RADIUS_M;
        let rim = self.speed + left(-n * RADIUS_M) * wrist(t, most)[1];
        let slip = along.dot(&(v + left(contact) * omega - rim));
        // Per unit of the normal force.
        let unit = -n - along * (MU_C * (slip / STEEP.0).tanh());
        let by_unit = Vector3::new(unit.x, unit.y, contact.perp(&unit) / part.inertia_per_mass());
        // The finger's distance from the edge stays the radius: its second derivative is 0.
        let closing = |a: &Vector3<f64>| -n.dot(&a.xy()) + a.z * left(n).dot(&from_centre);
        let own = n.dot(&acceleration(t)) + 2.0 * omega * left(n).dot(&(self.speed - v))
            - omega * omega * n.dot(&from_centre);
        let normal = (-(own + closing(&drag)) / closing(&by_unit)).max(0.0);
        (drag + by_unit * normal, unit * (normal * MASS_KG))
    }

    fn moved(&self, rates: &(Vector3<f64>, Vector3<f64>, Vector2<f64>, Vector2<f64>), dt: f64) -> Self {
        Self {
            at: self.at + rates.0 * dt,
            rate: self.rate + rates.1 * dt,
            finger: self.finger + rates.2 * dt,
            speed: self.speed + rates.3 * dt,
        }
    }

    /// One step of Heun's method.
    fn step(&self, part: &Part, edge: usize, t: f64, most: f64) -> Self {
        let rates =
            |world: &Self, t: f64| (world.rate, world.forces(part, edge, t, most).0, world.speed, acceleration(t));
        let first = rates(self, t);
        let second = rates(&self.moved(&first, STEP_S), t + STEP_S);
        self.moved(&first, 0.5 * STEP_S).moved(&second, 0.5 * STEP_S)
    }
}

/// The places of a clamp, what its sensor reads while it turns up to so far (rad), and the part's pose at the last reading.
struct Felt {
    path: MeasuredPath,
    angles: Vec<f64>,
    readings: Vec<ForceReading>,
    end: Vector3<f64>,
}

fn felt(part: &Part, edge: usize, u: f64, s: f64, most: f64, draw: &mut Draw) -> Felt {
    let sigma = 3e-6;
    let mut world = World::touching(part, edge, u, s);
    let (mut places, mut times, mut angles) = (Vec::new(), Vec::new(), Vec::new());
    let mut readings = Vec::new();
    let mut noisy = |of: Vector2<f64>, sd: f64| of + Vector2::new(draw.normal(), draw.normal()) * sd;
    let mut end = world.at;
    for n in -10..80 {
        let t = 0.01 * f64::from(n);
        // What comes before is known, and what comes after too: the finger alone.
        let mut finger = (Vector2::zeros(), Vector2::zeros());
        for step in 0..10 * n.max(0) {
            let a = acceleration(1e-3 * (f64::from(step) + 0.5));
            finger = (finger.0 + finger.1 * 1e-3 + a * 0.5e-6, finger.1 + a * 1e-3);
        }
        times.push(t - OFFSET_S);
        places.push(Point2::from(noisy(finger.0, sigma)));
        angles.push(wrist(t, most)[0]);
    }
    for n in -10..0 {
        readings.push(ForceReading { time: 8e-3 * f64::from(n), force: noisy(Vector2::zeros(), NOISE_N) });
    }
    for step in 0..STEPS {
        let t = f64::from(step) * STEP_S;
        if step % STEPS_A_READING == STEPS_A_READING / 2 {
            let (_, force) = world.forces(part, edge, t, most);
            let on_finger = -force - acceleration(t) * FINGER_KG;
            let read = nalgebra::Rotation2::new(-wrist(t, most)[0]) * on_finger;
            readings.push(ForceReading { time: t, force: noisy(read, NOISE_N) });
            end = world.at;
        }
        world = world.step(part, edge, t, most);
    }
    Felt { path: MeasuredPath { times, places, sigma }, angles, readings, end }
}

#[test]
fn a_part_is_found_by_a_finger_that_turns_and_only_if_that_is_told() {
    let part = part();
    let still = FingerMotion::untold();
    for (case, (edge, u, s, most)) in [(3, 0.15, 0.004, 1.0), (1, -0.2, -0.003, -0.8)].into_iter().enumerate() {
        let felt = felt(&part, edge, u, s, most, &mut Draw::case(71, case));
        let turn = MeasuredTurn::new(&felt.path.times, &felt.angles).unwrap();
        let known = KnownOfFinger {
            mu_c: Some(MU_C),
            effective_mass: FINGER_KG,
            ..KnownOfFinger::new(&part, MU * GRAVITY_ASSUMED, RADIUS_M, &still, NOISE_N)
        };
        let found = |turn: Option<&MeasuredTurn>| {
            let finger = MeasuredFinger { path: &felt.path, turn, clock_offset_sd: 0.01 };
            estimate_measured_until(&known, &finger, &felt.readings, &never).found.hypotheses
        };
        let off = |found: &ForceHypothesis| {
            let centre = found.pose_end.isometry() * part.centre_of_mass();
            let turned = crate::math::angle::wrap_angle(found.pose_end.theta - felt.end.z);
            Vector3::new(centre.x - felt.end.x, centre.y - felt.end.y, turned)
        };
        let told = found(Some(&turn));
        let is_right = |(offset, found): &(f64, ForceHypothesis)| {
            let off = off(found);
            let slack = Matrix3::from_diagonal(&Vector3::new(3e-5, 3e-5, 3e-4).map(|sd: f64| sd * sd));
            let covariance = found.covariance.fixed_view::<3, 3>(0, 0) + slack;
            let squared = (off.transpose() * covariance.try_inverse().unwrap() * off)[0];
            found.edge == edge
                && (offset - OFFSET_S).abs() < 4e-3
                && (squared < chi_square_quantile(0.999, 3) || (off.xy().norm() < 2e-4 && off.z.abs() < 3e-3))
        };
        let seen: Vec<_> = told.iter().map(|it| (it.0, it.1.edge, off(&it.1), it.1.cost, it.1.probability)).collect();
        assert!(told.iter().any(is_right), "case {case}: {seen:?}");
        assert!(!found(None).iter().any(is_right), "case {case}");
    }
}
