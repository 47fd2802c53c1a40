use std::f64::consts::FRAC_PI_2;
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use proptest::prelude::*;

use super::*;
use crate::search::check_stopping_of_making;

/// The motion by quite another way: the part's three coordinates under the one constraint that the gap between the
/// outlines stays 0, the gap from support functions, its derivatives by differences. Frictionless.
struct ByGap {
    shape: FingerShape,
    object: Object,
    rho_squared: f64,
    acceleration: [f64; 2],
    /// The normal's angle is looked for around this.
    near: f64,
}

/// Step of the differences, m and rad.
const STEP: f64 = 1e-4;

impl ByGap {
    fn support_of_object(&self, angle: f64) -> f64 {
        let direction = Vector2::new(angle.cos(), angle.sin());
        match &self.object {
            Object::Polygon(polygon) => {
                let centroid = polygon.centroid();
                polygon.vertices().iter().map(|v| (v - centroid).dot(&direction)).fold(f64::MIN, f64::max)
            }
            Object::Ellipse([a, b]) => (a * direction.x).hypot(b * direction.y),
        }
    }

    fn support_of_finger(&self, angle: f64) -> f64 {
        match self.shape {
            FingerShape::Disk { radius } => radius,
            FingerShape::Ellipse { semi_axes: [a, b] } => (a * angle.cos()).hypot(b * angle.sin()),
            FingerShape::Line => 0.0,
        }
    }

    /// Room between the outlines' supporting lines across one direction.
    fn room(&self, q: [f64; 3], angle: f64) -> f64 {
        let along = q[0] * angle.cos() + q[1] * angle.sin();
        along - self.support_of_finger(angle) - self.support_of_object(angle + PI - q[2])
    }

    /// Direction in which the outlines are furthest apart.
    fn normal(&self, q: [f64; 3]) -> f64 {
        if self.shape == FingerShape::Line {
            return FRAC_PI_2;
        }
        let (mut low, mut high) = (self.near - 0.6, self.near + 0.6);
        for _ in 0..100 {
            let (left, right) = (low + (high - low) * 0.382, low + (high - low) * 0.618);
            if self.room(q, left) < self.room(q, right) { low = left } else { high = right }
        }
        0.5 * (low + high)
    }

    fn gap(&self, q: [f64; 3]) -> f64 {
        self.room(q, self.normal(q))
    }

    /// Acceleration relative to the finger.
    fn acceleration(&self, q: [f64; 3], v: [f64; 3]) -> [f64; 3] {
        let moved = |share: f64, by: [f64; 3]| self.gap([0, 1, 2].map(|i| q[i] + share * by[i]));
        let unit = |i: usize| [0, 1, 2].map(|j| if i == j { 1.0 } else { 0.0 });
        let gradient = [0, 1, 2].map(|i| (moved(STEP, unit(i)) - moved(-STEP, unit(i))) / (2.0 * STEP));
        let size = v.iter().map(|v| v.abs()).fold(1e-9, f64::max);
        let look = 3.0 * STEP / size;
        let bend = (moved(look, v) - 2.0 * moved(0.0, v) + moved(-look, v)) / (look * look);
        let free = [-self.acceleration[0], -self.acceleration[1], 0.0];
        let mobility = [1.0, 1.0, 1.0 / self.rho_squared];
        let response: f64 = (0..3).map(|i| gradient[i] * gradient[i] * mobility[i]).sum();
        let wanted: f64 = -bend - (0..3).map(|i| gradient[i] * free[i]).sum::<f64>();
        [0, 1, 2].map(|i| free[i] + mobility[i] * gradient[i] * wanted / response)
    }

    /// Coordinates after `time`.
    fn after(&self, q0: [f64; 3], time: f64) -> [f64; 3] {
        const STEPS: u32 = 100;
        let dt = time / f64::from(STEPS);
        let add = |a: [f64; 3], b: [f64; 3], share: f64| [0, 1, 2].map(|i| a[i] + share * b[i]);
        let (mut q, mut v) = (q0, [0.0; 3]);
        for _ in 0..STEPS {
            let a1 = self.acceleration(q, v);
            let (q2, v2) = (add(q, v, dt / 2.0), add(v, a1, dt / 2.0));
            let a2 = self.acceleration(q2, v2);
            let (q3, v3) = (add(q, v2, dt / 2.0), add(v, a2, dt / 2.0));
            let a3 = self.acceleration(q3, v3);
            let (q4, v4) = (add(q, v3, dt), add(v, a3, dt));
            let a4 = self.acceleration(q4, v4);
            q = [0, 1, 2].map(|i| q[i] + dt / 6.0 * (v[i] + 2.0 * (v2[i] + v3[i]) + v4[i]));
            v = [0, 1, 2].map(|i| v[i] + dt / 6.0 * (a1[i] + 2.0 * (a2[i] + a3[i]) + a4[i]));
        }
        q
    }

    /// Where the finger feels the contact.
    fn contact_angle(&self, q: [f64; 3]) -> f64 {
        let angle = self.normal(q);
        match (self.shape, &self.object) {
            (FingerShape::Disk { .. }, _) => angle,
            (FingerShape::Ellipse { semi_axes: [a, b] }, _) => (b * angle.sin()).atan2(a * angle.cos()),
            (FingerShape::Line, Object::Ellipse([a, b])) => {
                let psi = angle + PI - q[2];
                let support = (a * psi.cos()).hypot(b * psi.sin());
                let (x, y) = (a * a * psi.cos() / support, b * b * psi.sin() / support);
                -(q[0] + q[2].cos() * x - q[2].sin() * y)
            }
            (FingerShape::Line, Object::Polygon(_)) => f64::NAN,
        }
    }
}

fn push(shape: FingerShape, object: Object, acceleration: [f64; 2], u0: f64) -> RestingPush {
    let path = FingerPath {
        centre0: Point2::new(0.01, -0.02),
        velocity0: Vector2::zeros(),
        acceleration: acceleration.into(),
    };
    RestingPush::new(object, 0.0, shape, path, u0).unwrap()
}

fn triangle() -> Object {
    Object::Polygon(SimplePolygon::new([[-0.03, -0.02], [0.035, -0.015], [0.01, 0.03]].map(Point2::from)).unwrap())
}

fn shapes() -> impl Strategy<Value = (FingerShape, Object)> {
    let axes = || [0.012..0.03, 0.012..0.03];
    let finger = || axes().prop_map(|semi_axes| FingerShape::Ellipse { semi_axes });
    let ellipse = || [0.02..0.045, 0.02..0.045].prop_map(Object::Ellipse);
    prop_oneof![
        (finger(), ellipse()),
        (Just(FingerShape::Line), ellipse()),
        (finger(), Just(triangle())),
        (Just(FingerShape::Disk { radius: 0.01 }), Just(triangle())),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn predictions_are_those_of_a_part_that_keeps_a_gap_of_zero(
        (shape, object) in shapes(), edge in 0..3_usize, share in 0.3..0.7, side in -0.03..0.03, u0 in 1.4..1.7,
    ) {
        let acceleration = [side, 0.1];
        let u0 = if shape == FingerShape::Line { 0.0 } else { u0 };
        let push = push(shape, object.clone(), acceleration, u0);
        let (edge, s0) = match &object {
            Object::Polygon(_) => (Some(edge), push.contact_intervals[edge].range[0] + share * push.contact_intervals[edge].length()),
            Object::Ellipse(_) => (None, share * PI),
        };
        let predicted = push.predicted(edge, s0, &[0.3]);
        prop_assume!(predicted.len() == 1);
        let pose = push.resting_pose(edge, s0).unwrap();
        let centroid = push.body.centre_of_mass();
        let world = pose.isometry() * centroid;
        let oracle = ByGap {
            shape, object, rho_squared: push.body.inertia_per_mass(), acceleration, near: push.normal_angle(),
        };
        let q0 = [world.x - 0.01, world.y + 0.02, pose.theta];
        // The resting pose touches, at u0.
        prop_assert!(oracle.gap(q0).abs() < 1e-9, "{}", oracle.gap(q0));
        prop_assert!((oracle.contact_angle(q0) - u0).abs() < 1e-5, "{} {u0}", oracle.contact_angle(q0));
        let measured = oracle.contact_angle(oracle.after(q0, 0.3));
        // Differences of a gap that is known to rounding.
        prop_assert!((measured - predicted[0]).abs() < 2e-5, "{measured} {predicted:?}");
    }

    /// Whatever the place, the contacts it leads to lead back to it, by simulation and by table.
    #[test]
    fn no_place_is_lost((shape, object) in shapes(), edge in 0..3_usize, share in 0.02..0.98, u0 in 1.4..1.7) {
        let u0 = if shape == FingerShape::Line { 0.0 } else { u0 };
        let push = push(shape, object.clone(), [0.01, 0.1], u0);
        let interval = push.contact_intervals[edge % push.contact_intervals.len()];
        let s0 = interval.range[0] + share * interval.length();
        let measured = push.predicted(interval.edge, s0, &[0.5, 0.8]);
        prop_assume!(measured.len() == 2);
        let contacts = [TimedContact { t: 0.5, u: measured[0] }, TimedContact { t: 0.8, u: measured[1] + 4.0 * PI * f64::from(u8::from(shape != FingerShape::Line)) }];
        let simulated = push.observe(&contacts, 1e-6);
        let table = Table::new(&push, 0.8).observe(&contacts, 1e-6);
        for poses in [&simulated, &table] {
            // What is all but a circle fits along a stretch of places, or anywhere; one of them stands for all.
            let fits = |at: f64, count: usize| {
                let predicted = push.predicted(interval.edge, at, &[0.5, 0.8]);
                predicted.iter().zip(&measured).take(count).filter(|(u, felt)| (*u - *felt).abs() <= 1e-6).count() == count
            };
            let is_it = |pose: &RestingPose, count: usize| {
                let way = interval.way(s0, pose.s0);
                let same = pose.anywhere || way.abs() < 1e-5;
                pose.edge == interval.edge && (same || [0.25, 0.5, 0.75].iter().all(|share| fits(s0 + share * way, count)))
            };
            let found = |poses: &[RestingPose], count: usize| poses.iter().any(|pose| is_it(pose, count));
            prop_assert!(found(&poses.candidates, 1) && found(&poses.solutions, 2), "{interval:?} {s0} {poses:?}");
        }
        prop_assert_eq!(simulated.candidates.len(), table.candidates.len(), "{:?} {:?}", simulated, table);
    }
}

/// Where u(t₁) as a function of s₀ turns back, two candidates become one: it must not be lost.
#[test]
fn a_place_at_a_fold_is_found() {
    for (object, contact_intervals) in [(Object::Ellipse([0.025, 0.048]), 1), (triangle(), 3)] {
        let push = push(FingerShape::Ellipse { semi_axes: [0.012, 0.021] }, object, [-0.02, 0.08], 1.7);
        let mut folds = 0;
        for interval in &push.contact_intervals[..contact_intervals] {
            let u = |share: f64| {
                let halt = Halt::new(&never);
                let place = interval.range[0] + share * interval.length();
                push.watched(&halt).angles(interval, place, &[0.5]).first().copied()
            };
            let shares: Vec<_> = (1..200).map(|i| f64::from(i) / 200.0).collect();
            for three in shares.windows(3) {
                let (Some(a), Some(b), Some(c)) = (u(three[0]), u(three[1]), u(three[2])) else { continue };
                if (b - a) * (c - b) > 0.0 {
                    continue;
                }
                folds += 1;
                // The vertex of the parabola through the three: next to the fold, on either side of it.
                let at = three[1] + 0.5 / 200.0 * (a - c) / (a - 2.0 * b + c);
                let s0 = interval.range[0] + at * interval.length();
                let measured = push.predicted(interval.edge, s0, &[0.5, 0.8]);
                let contacts: Vec<_> = [0.5, 0.8].iter().zip(&measured).map(|(&t, &u)| TimedContact { t, u }).collect();
                for poses in [push.observe(&contacts, 1e-6), Table::new(&push, 0.8).observe(&contacts, 1e-6)] {
                    let near = |pose: &RestingPose| {
                        pose.edge == interval.edge && interval.gap(pose.s0, s0) < 1e-3 * interval.length()
                    };
                    assert!(poses.candidates.iter().any(near), "{s0} {poses:?}");
                    assert!(contacts.len() < 2 || poses.solutions.iter().any(near), "{s0} {poses:?}");
                }
            }
        }
        assert!(folds > 0, "no fold among the places tried");
    }
}

#[test]
fn a_circle_can_lie_any_way() {
    let push = push(FingerShape::Line, Object::Ellipse([0.03, 0.03]), [0.02, 0.1], 0.0);
    let u = push.predicted(None, 1.0, &[0.5])[0];
    let poses = push.observe(&[TimedContact { t: 0.5, u }], 1e-6);
    assert!(poses.solutions.len() == 1 && poses.solutions[0].anywhere, "{poses:?}");
    assert!(push.observe(&[TimedContact { t: 0.5, u: u + 0.01 }], 1e-6).solutions.is_empty());
}

#[test]
fn a_square_lies_in_four_ways() {
    let square = SimplePolygon::new([[-0.02, -0.02], [0.02, -0.02], [0.02, 0.02], [-0.02, 0.02]].map(Point2::from));
    let push = push(FingerShape::Disk { radius: 0.01 }, Object::Polygon(square.unwrap()), [0.0, 0.1], 1.5);
    let measured = push.predicted(Some(2), 0.007, &[0.4, 0.7]);
    let contacts = [TimedContact { t: 0.4, u: measured[0] }, TimedContact { t: 0.7, u: measured[1] }];
    let poses = push.observe(&contacts, 1e-6);
    assert_eq!(poses.solutions.len(), 4, "{poses:?}");
}

#[test]
fn later_contacts_decide_within_their_tolerance() {
    let push = push(FingerShape::Disk { radius: 0.01 }, triangle(), [0.01, 0.1], 1.55);
    let measured = push.predicted(Some(1), 0.006, &[0.4, 0.6, 0.8]);
    let with = |noise: [f64; 3], tolerance: f64| {
        let contacts: Vec<_> = [0.4, 0.6, 0.8]
            .iter()
            .zip(&measured)
            .zip(noise)
            .map(|((&t, &u), noise)| TimedContact { t, u: u + noise })
            .collect();
        push.observe(&contacts, tolerance)
    };
    // Rounded to milliradians, the contacts still leave the right pose, near where it was.
    let rounded = with([4e-4, -5e-4, 5e-4], 1e-3);
    assert!(rounded.solutions.iter().any(|pose| pose.edge == Some(1) && (pose.s0 - 0.006).abs() < 1e-3), "{rounded:?}");
    assert!(with([4e-4, -5e-4, 5e-4], 1e-6).solutions.is_empty());
    assert!(with([0.0, 0.0, 0.3], 1e-3).solutions.is_empty());
}

#[test]
fn impossible_pushes_are_refused() {
    let new = |object: Object, shape: FingerShape, acceleration: [f64; 2]| {
        let path =
            FingerPath { centre0: Point2::origin(), velocity0: Vector2::zeros(), acceleration: acceleration.into() };
        RestingPush::new(object, 0.0, shape, path, FRAC_PI_2).map(|_| ())
    };
    let disk = FingerShape::Disk { radius: 0.01 };
    assert!(matches!(new(triangle(), disk, [0.0, -0.1]), Err(InitialPoseError::MovesAway { .. })));
    assert!(matches!(new(triangle(), disk, [0.0; 2]), Err(InitialPoseError::MovesAway { .. })));
    let line = new(triangle(), FingerShape::Line, [0.0, 0.1]);
    assert_eq!(line, Err(InitialPoseError::Shape(ShapeError::BothStraight)));
}

/// A polygon, a finger and a push of which one edge's candidate has a contact that ends between two times of a table.
#[test]
fn a_contact_that_ends_soon_after_it_was_felt_is_in_the_table() {
    let corners = [
        [-0.044_473_945, -0.012_663_368],
        [-0.030_748_561, -0.027_045_985],
        [-0.012_560_288, -0.042_831_971],
        [0.019_940_711, -0.032_086_864],
        [0.008_742_711, -0.015_441_571],
        [-0.022_149_828, 0.009_274_390],
        [-0.030_800_993, 0.001_514_084],
    ];
    let object = Object::Polygon(SimplePolygon::new(corners.map(Point2::from)).unwrap());
    let shape = FingerShape::Ellipse { semi_axes: [0.024_758_498, 0.017_338_234] };
    let push = push(shape, object, [-0.026_780_753, 0.093_252_006], 1.952_510_745);
    let times = [0.482_969_508, 0.988_323_216];
    let measured = push.predicted(Some(4), 0.009_740_169, &times);
    let contacts: Vec<_> = times.iter().zip(&measured).map(|(&t, &u)| TimedContact { t, u }).collect();
    let edges = |poses: &RestingPoses| {
        let mut edges: Vec<_> = poses.candidates.iter().map(|pose| pose.edge).collect();
        edges.sort_unstable();
        edges
    };
    let wanted = [1, 2, 4, 6].map(Some);
    assert_eq!(edges(&push.observe(&contacts, 1e-8)), wanted);
    // Wherever the kept times lie about the end of that contact.
    for time_end in [1.0, 1.02, 1.04, 1.06, 1.087_155_538] {
        assert_eq!(edges(&Table::new(&push, time_end).observe(&contacts, 1e-8)), wanted, "{time_end} s");
    }
}

#[test]
fn a_table_in_the_making_can_be_stopped() {
    let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03]].map(Point2::from)).unwrap();
    let push = push(FingerShape::Disk { radius: 0.01 }, Object::Polygon(block), [0.01, 0.1], 1.5);
    check_stopping_of_making(|stop| Table::new_until(&push, 0.8, stop));
    let asked = AtomicUsize::new(0);
    let stop = || asked.fetch_add(1, Relaxed) == 2;
    assert!(Table::new_until(&push, 0.8, &stop).is_none());
    assert_eq!(asked.load(Relaxed), 3, "it is not asked again");
}
