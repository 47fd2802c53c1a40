//! Pushes between disks, ellipses, lines and edges, judged by what they look like from outside: positions over time.
//!
//! Shares nothing with the equations of `palpate::pushing::dynamics`: accelerations are differences of sampled
//! velocities, velocities differences of sampled places, the contact is where the outlines, searched point by point,
//! come nearest.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Point2, Rotation2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::math::random::Draw;
use palpate::pushing::dynamics::{
    Body, ContactLaw, EdgeEnd, EndReason, FingerPath, FingerShape, Mass, Part, PartSide, PushRun, Sample, ShapedModel,
    ShapedPush, Start, State,
};

/// Pushes of each pair of outlines and law.
const PUSHES: u64 = 12;
/// Time between samples, s.
const STEP_S: f64 = 5e-5;
/// Samples in a group: differences need neighbours on both sides.
const STEPS: u32 = 4000;
/// Of a central difference: a third derivative of some 1e4 m/s⁴ at 0.05 ms, and rounding.
const ACCELERATION: f64 = 2e-4;
/// The same for velocities, m/s.
const VELOCITY: f64 = 1e-7;
/// The same for turning, rad/s: a part some centimetres across turns that much faster.
const TURNING: f64 = 1e-5;
/// How well two outlines touch, m: a search on squares stops at their rounding.
const TOUCH_M: f64 = 1e-10;
/// How well the nearest point is known along the outline, m: the gap is flat there.
const PLACE_M: f64 = 2e-6;
/// A foot slower than this may be about to stop, which no difference follows, m/s.
const FOOT_SLOW: f64 = 3e-3;
/// µ g, m/s².
const MU_G: f64 = 2.0;

#[derive(Clone, Copy, Debug)]
enum Outlines {
    EllipseOnEdge,
    EllipseOnEllipse,
    LineOnEllipse,
    DiskOnEllipse,
}

/// A part on feet, its outline as a curve in its own axes, and the push.
struct Case {
    feet: Vec<(Point2<f64>, f64)>,
    mass: Mass,
    part: Part,
    side: PartSide,
    shape: FingerShape,
    path: FingerPath,
    state: State,
}

fn case(seed: u64, outlines: Outlines) -> Case {
    let mut draw = Draw::new(seed);
    let corners = [(-0.03, -0.02), (0.03, -0.02), (0.03, 0.02), (-0.03, 0.02)];
    let corner = |(x, y): (f64, f64), draw: &mut Draw| {
        Point2::new(x + draw.between(-0.008, 0.008), y + draw.between(-0.008, 0.008))
    };
    let polygon = SimplePolygon::new(corners.map(|at| corner(at, &mut draw))).unwrap();
    let mass = Mass {
        centre_of_mass: Point2::new(draw.between(-0.004, 0.004), draw.between(-0.004, 0.004)),
        inertia_per_mass: draw.between(2e-4, 5e-4),
    };
    let feet: Vec<_> =
        (0..5).map(|_| (Point2::new(draw.between(-0.03, 0.03), draw.between(-0.02, 0.02)), 0.2)).collect();
    let part = Part::on_feet(polygon, &feet, mass);
    let axes = |draw: &mut Draw| [draw.between(0.008, 0.03), draw.between(0.008, 0.03)];
    let (semi_axes, middle) = (axes(&mut draw), -mass.centre_of_mass.coords);
    let ellipse = PartSide::Ellipse { semi_axes, middle };
    let (side, shape) = match outlines {
        Outlines::EllipseOnEdge => {
            (PartSide::Edge(part.edge(0).unwrap()), FingerShape::Ellipse { semi_axes: axes(&mut draw) })
        }
        Outlines::EllipseOnEllipse => (ellipse, FingerShape::Ellipse { semi_axes: axes(&mut draw) }),
        Outlines::LineOnEllipse => (ellipse, FingerShape::Line),
        Outlines::DiskOnEllipse => (ellipse, FingerShape::Disk { radius: draw.between(0.0, 0.02) }),
    };
    let (u, s) = match side {
        PartSide::Edge(edge) => {
            (draw.between(-PI, PI), edge.s_min + draw.between(0.4, 0.6) * (edge.s_max - edge.s_min))
        }
        PartSide::Ellipse { .. } => (draw.between(-PI, PI), draw.between(-PI, PI)),
    };
    let normal = match shape {
        FingerShape::Disk { .. } => u,
        FingerShape::Ellipse { semi_axes: [a, b] } => (a * u.sin()).atan2(b * u.cos()),
        FingerShape::Line => FRAC_PI_2,
    };
    let heading = Rotation2::new(normal + draw.between(-0.2, 0.2)) * Vector2::x();
    let path = FingerPath {
        centre0: Point2::new(draw.between(-0.1, 0.1), draw.between(-0.1, 0.1)),
        velocity0: heading * draw.between(0.03, 0.09),
        acceleration: heading * draw.between(0.0, 0.15),
    };
    let state = State { u, s, omega: draw.between(-0.4, 0.4), v_t: draw.between(-0.03, 0.03) };
    Case { feet, mass, part, side, shape, path, state }
}

impl Case {
    fn body(&self) -> &Body {
        self.part.body()
    }

    fn run(&self, law: ContactLaw) -> PushRun {
        let model = ShapedModel::new(self.body(), self.side, MU_G, self.shape, self.path).unwrap();
        let times: Vec<_> = (0..=STEPS).map(|i| f64::from(i) * STEP_S).collect();
        ShapedPush::new(model, law, Start::Moving(self.state), EdgeEnd::Stop).unwrap().run(&times).unwrap()
    }

    /// How far a world point is from the finger: negative inside. For an ellipse to first order, exact on its outline.
    fn outside_finger(&self, t: f64, point: Point2<f64>) -> f64 {
        let d = point - self.path.centre(t);
        match self.shape {
            FingerShape::Disk { radius } => d.norm() - radius,
            FingerShape::Ellipse { semi_axes: [a, b] } => {
                let (x, y) = (d.x / a, d.y / b);
                (x.hypot(y) - 1.0) / (x / a).hypot(y / b) * x.hypot(y)
            }
            FingerShape::Line => d.y,
        }
    }

    /// A point of the part's outline and the direction along it, world.
    fn outline(&self, sample: &Sample, parameter: f64) -> (Point2<f64>, Vector2<f64>) {
        let (point, along) = match self.side {
            PartSide::Ellipse { semi_axes: [a, b], .. } => {
                let (sin, cos) = parameter.sin_cos();
                (Point2::new(a * cos, b * sin), Vector2::new(-a * sin, b * cos))
            }
            PartSide::Edge(edge) => {
                let along = Vector2::new(-edge.normal.y, edge.normal.x);
                (self.mass.centre_of_mass + edge.normal * edge.height + along * parameter, along)
            }
        };
        let turn = Rotation2::new(sample.theta);
        (sample.position + turn * point.coords, turn * along.normalize())
    }

    /// The parameter at which the part comes nearest to the finger, by a search over its outline.
    fn nearest(&self, sample: &Sample) -> f64 {
        let gap = |parameter: f64| self.outside_finger(sample.t, self.outline(sample, parameter).0);
        let (low, high) = match self.side {
            PartSide::Ellipse { .. } => (0.0, TAU),
            PartSide::Edge(edge) => (edge.s_min - 0.01, edge.s_max + 0.01),
        };
        let places = (0..400).map(|i| low + (high - low) * f64::from(i) / 400.0);
        let mut best = places.min_by(|a, b| gap(*a).total_cmp(&gap(*b))).unwrap();
        let mut step = (high - low) / 400.0;
        while step > 1e-12 * (high - low) {
            match [best - step, best + step].into_iter().find(|place| gap(*place) < gap(best)) {
                Some(better) => best = better,
                None => step /= 2.0,
            }
        }
        best
    }

    fn centre_of_mass(&self, sample: &Sample) -> Point2<f64> {
        sample.position + Rotation2::new(sample.theta) * self.mass.centre_of_mass.coords
    }

    /// Friction and its moment on the part, and the slowest foot.
    fn friction(&self, sample: &Sample) -> (Vector2<f64>, f64, f64) {
        let (mut force, mut moment, mut slowest) = (Vector2::zeros(), 0.0, f64::INFINITY);
        for (at, share) in &self.feet {
            let arm = Rotation2::new(sample.theta) * (at - self.mass.centre_of_mass);
            let velocity = sample.velocity + sample.state.omega * Vector2::new(-arm.y, arm.x);
            slowest = slowest.min(velocity.norm());
            let on_foot = -MU_G * *share * velocity.normalize();
            force += on_foot;
            moment += arm.perp(&on_foot);
        }
        (force, moment, slowest)
    }

    /// Whether three neighbours in time obey kinematics and Newton; false if that cannot be told.
    fn check(&self, [before, here, after]: &[Sample; 3]) -> bool {
        let (friction, friction_moment, slowest) = self.friction(here);
        let same = [before, after].iter().all(|other| other.contact == here.contact);
        if slowest < FOOT_SLOW || !same {
            return false;
        }
        let place = format!("{:?} on {:?}, t = {}\n{here:?}", self.shape, self.side, here.t);
        let rate = |quantity: &dyn Fn(&Sample) -> Vector2<f64>| (quantity(after) - quantity(before)) / (2.0 * STEP_S);
        let velocity = rate(&|sample| self.centre_of_mass(sample).coords);
        let turning = (after.theta - before.theta) / (2.0 * STEP_S);
        assert!((velocity - here.velocity).norm() < VELOCITY, "{velocity} {place}");
        assert!((turning - here.state.omega).abs() < TURNING, "{turning} {place}");
        let nearest = self.nearest(here);
        let (contact, along) = self.outline(here, nearest);
        let gap = self.outside_finger(here.t, contact);
        assert!(gap.abs() < TOUCH_M, "they are {gap:e} m apart: {place}");
        let stated = self.outline(here, here.state.s).0;
        assert!((stated - contact).norm() < PLACE_M, "{place}");
        let force = here.force.unwrap();
        let normal = Vector2::new(along.y, -along.x);
        let pushing = -force.normal * normal + force.tangential * along;
        let acceleration = rate(&|sample| sample.velocity);
        let left_over = acceleration - friction - pushing;
        assert!(left_over.norm() < ACCELERATION, "{left_over} m/s² without a force: {place}");
        let arm = stated - self.centre_of_mass(here);
        let alpha = (after.state.omega - before.state.omega) / (2.0 * STEP_S);
        let moment = self.mass.inertia_per_mass * alpha - friction_moment - arm.perp(&pushing);
        assert!(moment.abs() < 0.03 * ACCELERATION, "{moment} m²/s² without a force: {place}");
        true
    }
}

fn judge(outlines: Outlines, law: ContactLaw) {
    let mut judged = 0;
    for seed in 0..PUSHES {
        let case = case(seed, outlines);
        let run = case.run(law);
        assert!(run.end.reason != EndReason::Jam, "{:?}", run.end);
        for middle in (1..run.samples.len().saturating_sub(1)).step_by(97) {
            let neighbours = [middle - 1, middle, middle + 1].map(|i| run.samples[i]);
            judged += usize::from(case.check(&neighbours));
        }
    }
    assert!(judged > 60, "only {judged} instants were judged");
}

#[test]
fn theorem_17_frictionless_ellipses_lines_and_disks_obey_newton() {
    for outlines in
        [Outlines::EllipseOnEdge, Outlines::EllipseOnEllipse, Outlines::LineOnEllipse, Outlines::DiskOnEllipse]
    {
        judge(outlines, ContactLaw::Frictionless);
    }
}

#[test]
fn proposition_20_rolling_ellipses_lines_and_disks_obey_newton() {
    for outlines in
        [Outlines::EllipseOnEdge, Outlines::EllipseOnEllipse, Outlines::LineOnEllipse, Outlines::DiskOnEllipse]
    {
        judge(outlines, ContactLaw::Rolling { friction: None });
    }
}

#[test]
fn proposition_22_ellipses_lines_and_disks_under_coulombs_law_obey_newton() {
    for outlines in
        [Outlines::EllipseOnEdge, Outlines::EllipseOnEllipse, Outlines::LineOnEllipse, Outlines::DiskOnEllipse]
    {
        judge(outlines, ContactLaw::Coulomb { friction: 0.25 });
    }
}
