//! Laws that pushes keep.

use std::f64::consts::{PI, TAU};

use nalgebra::{Isometry2, Point2, Rotation2, Vector2, Vector3};
use proptest::prelude::*;

use super::contact_mode::ContactFriction;
use super::support::{SupportFriction, Twist};
use super::*;
use crate::geometry::SimplePolygon;

/// Two ways to compute one acceleration, m/s² or rad/s² over ρ: rounding of values up to a hundred.
const ACCELERATION_ROUNDING: f64 = 1e-10;

/// Two runs of one push in other coordinates: each is within 1e-9 of the truth, relative to 1 rad, ρ and the speed.
const RUN_TOLERANCE: f64 = 1e-7;

/// A push drawn at random.
#[derive(Clone, Debug)]
struct Scene {
    outline: Vec<Point2<f64>>,
    edge: usize,
    mu_g: f64,
    finger: Finger,
    start: State,
}

impl Scene {
    fn part(&self) -> Part {
        Part::uniform(SimplePolygon::new(self.outline.clone()).unwrap())
    }

    fn model<'p>(&self, part: &'p Part) -> PushModel<'p> {
        PushModel { part, edge: part.edge(self.edge).unwrap(), mu_g: self.mu_g, finger: self.finger }
    }

    fn run(&self, law: ContactLaw, times: &[f64]) -> PushRun {
        let part = self.part();
        let start = Start::Moving(self.start);
        Push::new(self.model(&part), law, start, EdgeEnd::Stop).unwrap().run(times).unwrap()
    }
}

prop_compose! {
    /// A star-shaped outline with its radii in m, convex or not.
    fn outlines()(n in 3_usize..8)(
        radii in proptest::collection::vec(0.025..0.04, n),
        turns in proptest::collection::vec(-0.2..0.2, n),
    ) -> Vec<Point2<f64>> {
        let count = radii.len() as f64;
        let vertex = |(i, (radius, turn)): (usize, (f64, f64))| {
            Rotation2::new(TAU * (i as f64 + turn) / count) * Point2::new(radius, 0.0)
        };
        radii.into_iter().zip(turns).enumerate().map(vertex).collect()
    }
}

prop_compose! {
    /// A finger that pushes at a few cm/s into an edge, not too near its ends.
    fn scenes()(outline in outlines())(
        edge in 0..outline.len(),
        outline in Just(outline),
        u in -PI..PI,
        share in 0.2..0.8,
        heading in -0.3..0.3,
        (speed, acceleration, mu_g) in (0.02..0.08, 0.0..0.1, 1.0..5.0),
        (omega, v_t) in (-0.8..0.8, -0.02..0.02),
        radius in 0.0..0.01,
    ) -> Scene {
        let part = Part::uniform(SimplePolygon::new(outline.clone()).unwrap());
        let place = part.edge(edge).unwrap();
        let toward = Rotation2::new(u + heading) * Vector2::x();
        let finger = Finger {
            radius,
            centre0: Point2::new(0.3, -0.2),
            velocity0: Vector2::new(toward.x * speed, toward.y * speed),
            acceleration: Vector2::new(toward.x * acceleration, toward.y * acceleration),
        };
        let start = State { u, s: place.s_min + share * (place.s_max - place.s_min), omega, v_t };
        Scene { outline, edge, mu_g, finger, start }
    }
}

/// Scenes in which the disk touches its edge only.
fn possible_scenes() -> impl Strategy<Value = Scene> {
    scenes().prop_filter("the disk overlaps the part", |scene| {
        let (part, start) = (scene.part(), Start::Moving(scene.start));
        Push::new(scene.model(&part), ContactLaw::Frictionless, start, EdgeEnd::Stop).is_ok()
    })
}

fn contacts() -> impl Strategy<Value = ContactMode> {
    let slip = prop_oneof![Just(Slip::Forward), Just(Slip::Backward)];
    let sliding = (0.0..0.5, slip).prop_map(|(friction, slip)| ContactMode::Sliding { friction, slip });
    prop_oneof![Just(ContactMode::Frictionless), Just(ContactMode::Rolling), sliding]
}

/// Laws under which a push ends by itself in one way or another.
fn laws() -> impl Strategy<Value = ContactLaw> {
    let rolling = Just(ContactLaw::Rolling { friction: None });
    let limited = (0.05..0.5).prop_map(|friction| ContactLaw::Rolling { friction: Some(friction) });
    prop_oneof![Just(ContactLaw::Frictionless), rolling, limited]
}

fn grid(step: f64, count: u32) -> Vec<f64> {
    (0..=count).map(|i| f64::from(i) * step).collect()
}

/// Largest difference of two states, relative to 1 rad, ρ and the speed.
fn distance(a: &State, b: &State, radius: f64, speed: f64) -> f64 {
    let errors = [(a.u - b.u), (a.s - b.s) / radius, (a.omega - b.omega) * radius / speed, (a.v_t - b.v_t) / speed];
    errors.into_iter().map(f64::abs).fold(0.0, f64::max)
}

/// Kinetic energy per mass, m²/s².
fn kinetic(part: &Part, sample: &Sample) -> f64 {
    0.5 * (sample.velocity.norm_squared() + part.inertia_per_mass() * sample.state.omega.powi(2))
}

/// Power that the finger puts in less what support friction takes, per mass, m²/s³. From forces and velocities alone.
fn power(scene: &Scene, part: &Part, support: &SupportFriction, sample: &Sample) -> f64 {
    let State { u, omega, .. } = sample.state;
    let (normal, tangent) = (-Vector2::new(u.cos(), u.sin()), Vector2::new(-u.sin(), u.cos()));
    let force = sample.force.unwrap();
    let force = -(normal * force.normal) - tangent * force.tangential;
    let contact = scene.finger.centre(sample.t) - normal * scene.finger.radius;
    let centre = Isometry2::new(sample.position.coords, sample.theta) * part.centre_of_mass();
    let arm = contact - centre;
    let contact_velocity = sample.velocity + omega * Vector2::new(-arm.y, arm.x);
    let body_velocity = Rotation2::new(sample.theta).inverse() * sample.velocity;
    let twist = Twist::new(body_velocity, omega);
    force.dot(&contact_velocity) - scene.mu_g * support.mean_sliding(&twist).mean_speed(&twist)
}

/// Scaling of lengths and times: both to powers of two, so that rounding stays the same.
const LENGTH_SCALE: f64 = 4.0;
const TIME_SCALE: f64 = 2.0;

fn scaled(scene: &Scene) -> Scene {
    let (speed, acceleration) = (LENGTH_SCALE / TIME_SCALE, LENGTH_SCALE / TIME_SCALE.powi(2));
    let State { u, s, omega, v_t } = scene.start;
    Scene {
        outline: scene.outline.iter().map(|point| point * LENGTH_SCALE).collect(),
        edge: scene.edge,
        mu_g: scene.mu_g * acceleration,
        finger: Finger {
            radius: scene.finger.radius * LENGTH_SCALE,
            centre0: scene.finger.centre0.map(|x| x * LENGTH_SCALE),
            velocity0: scene.finger.velocity0.map(|x| x * speed),
            acceleration: scene.finger.acceleration.map(|x| x * acceleration),
        },
        start: State { u, s: s * LENGTH_SCALE, omega: omega / TIME_SCALE, v_t: v_t * speed },
    }
}

/// The scene seen in a mirror on the y-axis of the world and on that of the part.
fn mirrored(scene: &Scene) -> Scene {
    let flip = |vector: Vector2<f64>| Vector2::new(-vector.x, vector.y);
    let State { u, s, omega, v_t } = scene.start;
    let n = scene.outline.len();
    Scene {
        outline: scene.outline.iter().rev().map(|point| flip(point.coords).into()).collect(),
        // Reversed, edge i runs from what was vertex n − 1 − i to the one before.
        edge: (2 * n - 2 - scene.edge) % n,
        mu_g: scene.mu_g,
        finger: Finger {
            radius: scene.finger.radius,
            centre0: flip(scene.finger.centre0.coords).into(),
            velocity0: flip(scene.finger.velocity0),
            acceleration: flip(scene.finger.acceleration),
        },
        start: State { u: PI - u, s: -s, omega: -omega, v_t: -v_t },
    }
}

fn turned(scene: &Scene, angle: f64) -> Scene {
    let turn = Rotation2::new(angle);
    let Finger { radius, centre0, velocity0, acceleration } = scene.finger;
    let finger =
        Finger { radius, centre0: turn * centre0, velocity0: turn * velocity0, acceleration: turn * acceleration };
    Scene { finger, start: State { u: scene.start.u + angle, ..scene.start }, ..scene.clone() }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    /// Work of the finger = energy of the part + what support friction turned to heat.
    #[test]
    fn energy_is_accounted_for(scene in possible_scenes(), contact in contacts()) {
        let law = match contact {
            ContactMode::Rolling => ContactLaw::Rolling { friction: None },
            ContactMode::Frictionless => ContactLaw::Frictionless,
            ContactMode::Sliding { friction, .. } => ContactLaw::Coulomb { friction },
        };
        let run = scene.run(law, &grid(1e-4, 4000));
        // One kind of contact: the force jumps between kinds, and with it the power.
        let kind = run.samples[0].contact;
        let last = run.samples.iter().take_while(|sample| sample.contact == kind).count();
        let samples = &run.samples[..(last - 1) / 2 * 2 + 1];
        let part = scene.part();
        let support = SupportFriction::uniform(part.polygon()).with_origin(part.centre_of_mass());
        let powers: Vec<_> = samples.iter().map(|sample| power(&scene, &part, &support, sample)).collect();
        let simpson = powers.windows(3).step_by(2).map(|p| (p[0] + 4.0 * p[1] + p[2]) * 1e-4 / 3.0).sum::<f64>();
        let gained = kinetic(&part, &samples[samples.len() - 1]) - kinetic(&part, &samples[0]);
        let scale = samples.iter().map(|sample| kinetic(&part, sample)).fold(0.0, f64::max);
        // Simpson's rule at 0.1 ms on powers that change within 5 ms or more.
        prop_assert!((gained - simpson).abs() <= 1e-6 * scale, "gained {gained:e}, put in {simpson:e} m²/s²");
    }

    /// Seen from a finger in steady motion, a part without any friction keeps its kinetic energy: the contact does no
    /// work.
    #[test]
    fn without_any_friction_energy_relative_to_a_steady_finger_is_kept(scene in possible_scenes()) {
        let scene = Scene { mu_g: 0.0, finger: Finger { acceleration: Vector2::zeros(), ..scene.finger }, ..scene };
        let (run, part) = (scene.run(ContactLaw::Frictionless, &[0.0, 0.5]), scene.part());
        let energy = |sample: &Sample| {
            let velocity = sample.velocity - Vector2::from(scene.finger.velocity0);
            0.5 * (velocity.norm_squared() + part.inertia_per_mass() * sample.state.omega.powi(2))
        };
        let (start, end) = (energy(&run.samples[0]), energy(&run.last));
        prop_assert!((start - end).abs() <= RUN_TOLERANCE * start, "{start:e} became {end:e} m²/s²");
    }

    #[test]
    fn turning_the_world_turns_the_push(scene in possible_scenes(), angle in -PI..PI) {
        let law = ContactLaw::Coulomb { friction: 0.2 };
        let (run, other) = (scene.run(law, &[0.0, 0.3]), turned(&scene, angle).run(law, &[0.0, 0.3]));
        let back = State { u: other.last.state.u - angle, ..other.last.state };
        let radius = scene.part().inertia_per_mass().sqrt();
        prop_assert_eq!(run.end.reason, other.end.reason);
        prop_assert!(distance(&run.last.state, &back, radius, 0.05) < RUN_TOLERANCE, "{:?} {:?}", run.last, other.last);
        let turned_back = Rotation2::new(-angle) * other.last.position;
        prop_assert!((turned_back - run.last.position).norm() < RUN_TOLERANCE * radius);
    }

    #[test]
    fn vertices_along_the_edges_change_no_push(
        scene in possible_scenes(), shares in proptest::collection::vec(0.01..0.99, 8),
    ) {
        // Each edge in two pieces; edge i is then pieces 2 i and 2 i + 1.
        let n = scene.outline.len();
        let pieces = (0..n).flat_map(|i| {
            let (from, to) = (scene.outline[i], scene.outline[(i + 1) % n]);
            [from, from + (to - from) * shares[i]]
        });
        let split = Scene { outline: pieces.collect(), edge: 2 * scene.edge + 1, ..scene.clone() };
        let (whole, parted) = (scene.part(), split.part());
        prop_assert_eq!(parted.sides().len(), n);
        prop_assert_eq!(parted.side_vertices(split.edge), [2 * scene.edge, 2 * ((scene.edge + 1) % n)]);
        let law = ContactLaw::Coulomb { friction: 0.2 };
        let (one, other) = (scene.run(law, &[0.3]), split.run(law, &[0.3]));
        prop_assert_eq!(one.end.reason, other.end.reason);
        let radius = whole.inertia_per_mass().sqrt();
        prop_assert!(distance(&one.last.state, &other.last.state, radius, 0.05) < RUN_TOLERANCE, "{:?} {:?}", one.last, other.last);
        // The piece that holds a place lies about it.
        let State { s, .. } = one.last.state;
        let held = parted.edge_at(split.edge, s);
        let edge = whole.edge(scene.edge).unwrap();
        let cut = edge.s_min + shares[scene.edge] * (edge.s_max - edge.s_min);
        prop_assert!(held / 2 == scene.edge && (held % 2 == 1) == (s >= cut) || (s - cut).abs() < 1e-9, "{} at {}", held, s);
    }

    #[test]
    fn the_part_frame_does_not_matter(scene in possible_scenes(), x in -0.1..0.1, y in -0.1..0.1, turn in -PI..PI) {
        let frame = Isometry2::new(Vector2::new(x, y), turn);
        let outline = scene.outline.iter().map(|point| frame * point).collect();
        let other = Scene { outline, ..scene.clone() };
        let law = ContactLaw::Coulomb { friction: 0.2 };
        let (run, other) = (scene.run(law, &[0.3]), other.run(law, &[0.3]));
        let radius = scene.part().inertia_per_mass().sqrt();
        prop_assert!(distance(&run.last.state, &other.last.state, radius, 0.05) < RUN_TOLERANCE);
        let vertex = |run: &PushRun, vertex| Isometry2::new(run.last.position.coords, run.last.theta) * vertex;
        let (here, there) = (vertex(&run, scene.outline[0]), vertex(&other, frame * scene.outline[0]));
        prop_assert!((here - there).norm() < RUN_TOLERANCE * radius, "{here} {there}");
    }

    #[test]
    fn a_mirror_image_moves_as_the_mirror_image(scene in possible_scenes()) {
        let law = ContactLaw::Coulomb { friction: 0.2 };
        let (run, image) = (scene.run(law, &[0.3]), mirrored(&scene).run(law, &[0.3]));
        let State { u, s, omega, v_t } = image.last.state;
        let seen = State { u: PI - u, s: -s, omega: -omega, v_t: -v_t };
        let radius = scene.part().inertia_per_mass().sqrt();
        prop_assert!(distance(&run.last.state, &seen, radius, 0.05) < RUN_TOLERANCE, "{:?} {:?}", run.last, image.last);
        let mirrored_end = match run.end.reason {
            EndReason::EdgeMin => EndReason::EdgeMax,
            EndReason::EdgeMax => EndReason::EdgeMin,
            other => other,
        };
        prop_assert_eq!(image.end.reason, mirrored_end);
    }

    #[test]
    fn lengths_and_times_have_no_scale_of_their_own(scene in possible_scenes()) {
        let law = ContactLaw::Coulomb { friction: 0.2 };
        let (run, large) = (scene.run(law, &[0.3]), scaled(&scene).run(law, &[0.3 * TIME_SCALE]));
        let State { u, s, omega, v_t } = large.last.state;
        let speed = LENGTH_SCALE / TIME_SCALE;
        let small = State { u, s: s / LENGTH_SCALE, omega: omega * TIME_SCALE, v_t: v_t / speed };
        let radius = scene.part().inertia_per_mass().sqrt();
        prop_assert_eq!(run.end.reason, large.end.reason);
        prop_assert!(distance(&run.last.state, &small, radius, 0.05) < RUN_TOLERANCE, "{:?} {:?}", run.last, large.last);
    }

    /// The model of any two outlines, of a disk on an edge, is the fast one.
    #[test]
    fn shaped_outlines_continue_the_disk_on_an_edge(scene in scenes(), contact in contacts(), t in 0.0..0.5) {
        let part = scene.part();
        let model = scene.model(&part);
        let shape = FingerShape::Disk { radius: scene.finger.radius };
        let side = PartSide::Edge(model.edge);
        let shaped = ShapedModel::new(part.body(), side, scene.mu_g, shape, scene.finger.path()).unwrap();
        let state = scene.start;
        let (fast, general) = (model.motion(&contact, t, &state), shaped.motion(&contact, t, &state));
        let scale = 1.0 + fast.normal_force.abs() + fast.rates.omega.abs();
        let difference = [
            fast.rates.u - general.rates.u,
            fast.rates.s - general.rates.s,
            fast.rates.omega - general.rates.omega,
            fast.rates.v_t - general.rates.v_t,
            fast.normal_force - general.normal_force,
            fast.tangential_force - general.tangential_force,
        ];
        for difference in difference {
            prop_assert!(difference.abs() < ACCELERATION_ROUNDING * scale, "{fast:?} {general:?}");
        }
        prop_assert!((model.slip(t, &state) - shaped.slip(t, &state)).abs() < 1e-14);
        prop_assert!((model.centre_of_mass(t, &state) - shaped.centre_of_mass(t, &state)).norm() < 1e-14);
    }

    /// Thesis §5.4.1: in rolling the contact covers the same length on disk and part.
    #[test]
    fn a_rolling_contact_moves_by_the_disks_radius_times_its_turn(scene in possible_scenes()) {
        let run = scene.run(ContactLaw::Rolling { friction: None }, &[0.0, 0.3]);
        let (start, end) = (run.samples[0].state, run.last.state);
        let unequal = (end.s - start.s) + scene.finger.radius * (end.u - start.u);
        prop_assert!(unequal.abs() < 1e-12, "{unequal:e} m");
    }

    /// Thesis §5.2.1 divides by s; these equations do not, and pass through s = 0 smoothly.
    #[test]
    fn nothing_is_special_about_the_foot_of_the_perpendicular(scene in scenes(), contact in contacts()) {
        let part = scene.part();
        let motion = |s: f64| scene.model(&part).motion(&contact, 0.0, &State { s, ..scene.start });
        let (below, at, above) = (motion(-1e-7), motion(0.0), motion(1e-7));
        let bend = |of: fn(&Motion) -> f64| (of(&below) + of(&above) - 2.0 * of(&at)).abs();
        // A tenth of a micrometre changes no acceleration's slope by more than 1e-7 of a value of some hundred.
        for of in [|m: &Motion| m.rates.omega, |m: &Motion| m.normal_force, |m: &Motion| m.rates.v_t] {
            prop_assert!(bend(of) < 1e-5, "{below:?} {at:?} {above:?}");
        }
    }

    /// Corollary 18: where the normal passes through the centre of mass, friction under the part alone turns it (5.16), and
    /// its acceleration is that of the finger's line (5.13) along the normal, of friction across it (5.17).
    #[test]
    fn corollary_18_a_normal_through_the_centre_of_mass_does_not_turn_the_part(scene in scenes()) {
        let part = scene.part();
        let model = scene.model(&part);
        let state = State { s: 0.0, ..scene.start };
        let motion = model.motion(&ContactMode::Frictionless, 0.0, &state);
        let edge = part.edge(scene.edge).unwrap();
        // World: N and T of the thesis; the part's edge has its outward normal along N.
        let (normal, tangent) = (-Vector2::new(state.u.cos(), state.u.sin()), Vector2::new(-state.u.sin(), state.u.cos()));
        let finger = scene.finger.velocity0;
        let velocity = normal * finger.dot(&normal) + tangent * state.v_t;
        let to_part = Rotation2::new(edge.normal.y.atan2(edge.normal.x) - normal.y.atan2(normal.x));
        let outline = SimplePolygon::new(scene.outline.clone()).unwrap();
        let support = SupportFriction::uniform(&outline).with_origin(part.centre_of_mass());
        let friction = support.mean_sliding(&Twist::new(to_part * velocity, state.omega));
        let turning = -scene.mu_g * friction.moment / part.inertia_per_mass();
        prop_assert!((motion.rates.omega - turning).abs() < 1e-9 * (1.0 + turning.abs()), "{motion:?} {turning}");
        let across = state.omega * finger.dot(&normal) - scene.mu_g * (to_part.inverse() * friction.direction).dot(&tangent);
        prop_assert!((motion.rates.v_t - across).abs() < 1e-9 * (1.0 + across.abs()), "{motion:?} {across}");
        let reach = scene.finger.radius + edge.height;
        let along = scene.finger.acceleration.dot(&normal) + 2.0 * state.omega * (state.v_t - finger.dot(&tangent))
            - state.omega.powi(2) * reach;
        let newton = -motion.normal_force - scene.mu_g * (to_part.inverse() * friction.direction).dot(&normal);
        prop_assert!((newton - along).abs() < 1e-9 * (1.0 + along.abs()), "{motion:?} {newton} {along}");
    }

    #[test]
    fn sliding_without_friction_is_frictionless(scene in scenes(), backward in any::<bool>()) {
        let slip = if backward { Slip::Backward } else { Slip::Forward };
        let part = scene.part();
        let motion = |contact| scene.model(&part).motion(&contact, 0.0, &scene.start);
        let (sliding, frictionless) = (motion(ContactMode::Sliding { friction: 0.0, slip }), motion(ContactMode::Frictionless));
        prop_assert!((sliding.rates.omega - frictionless.rates.omega).abs() < ACCELERATION_ROUNDING);
        prop_assert!((sliding.normal_force - frictionless.normal_force).abs() < ACCELERATION_ROUNDING);
    }

    /// Where the friction is just what rolling needs, sliding and rolling are one motion.
    #[test]
    fn sliding_on_the_rolling_force_is_rolling(scene in scenes()) {
        let part = scene.part();
        let model = scene.model(&part);
        let state = State { v_t: model.rolling_v_t(0.0, &scene.start), ..scene.start };
        let rolling = model.motion(&ContactMode::Rolling, 0.0, &state);
        prop_assume!(rolling.normal_force.abs() > 1e-3);
        let needed = rolling.tangential_force / rolling.normal_force;
        let contact = ContactMode::Sliding { friction: needed.abs(), slip: Slip::of(-needed) };
        prop_assume!(model.sliding_denominator(-needed, state.s).abs() > 1e-3);
        let sliding = model.motion(&contact, 0.0, &state);
        let scale = 1.0 + rolling.rates.omega.abs() + rolling.normal_force.abs();
        prop_assert!((sliding.rates.omega - rolling.rates.omega).abs() < 1e-7 * scale, "{rolling:?} {sliding:?}");
        prop_assert!((sliding.normal_force - rolling.normal_force).abs() < 1e-7 * scale, "{rolling:?} {sliding:?}");
    }

    /// Complementarity on the equations themselves: whatever the rule says of a contact without slip, the force pushes
    /// within the cone, and slip grows only the way that it says.
    #[test]
    fn the_mode_that_follows_is_the_one_that_the_equations_allow(scene in scenes(), friction in 0.0..0.8, t in 0.0..0.5) {
        /// Over this time the slip is looked at, s.
        const SOON: f64 = 1e-7;
        let part = scene.part();
        let model = scene.model(&part);
        let state = State { v_t: model.rolling_v_t(t, &scene.start), ..scene.start };
        let jams = [1.0, -1.0].iter().any(|sign| model.sliding_denominator(friction * sign, state.s) < 0.05);
        prop_assume!(!jams);
        let motion = |contact: &ContactMode| model.motion(contact, t, &state);
        // How fast the slip grows: at rest on each other now, so much later not.
        let grows = |contact: &ContactMode| {
            let Motion { rates, .. } = motion(contact);
            let soon = State {
                u: state.u + rates.u * SOON,
                s: state.s + rates.s * SOON,
                omega: state.omega + rates.omega * SOON,
                v_t: state.v_t + rates.v_t * SOON,
            };
            (model.slip(t + SOON, &soon) - model.slip(t, &state)) / SOON
        };
        let law = ContactFriction::same(friction);
        let rolling = motion(&ContactMode::Rolling).force();
        let follows = law.without_slip(&rolling);
        prop_assume!(law.unused(&rolling).abs() > 1e-3);
        for slip in [Slip::Forward, Slip::Backward] {
            let contact = law.slides(slip);
            let possible = motion(&contact).normal_force > 0.0 && grows(&contact) * slip.sign() > 0.0;
            let breaks = contact == follows && motion(&contact).normal_force <= 0.0;
            prop_assert_eq!(possible || breaks, contact == follows, "{:?}, grows at {}", contact, grows(&contact));
        }
        if follows == ContactMode::Rolling {
            prop_assert!(rolling.pushes() && rolling.tangential.abs() <= friction * rolling.normal);
        }
    }

    #[test]
    fn coulombs_law_holds_at_every_sample(scene in possible_scenes(), friction in 0.0..0.6) {
        let part = scene.part();
        let run = scene.run(ContactLaw::Coulomb { friction }, &grid(0.01, 40));
        for sample in &run.samples {
            let Some(ContactForce { normal, tangential }) = sample.force else { continue };
            let slip = scene.model(&part).slip(sample.t, &sample.state);
            match sample.contact {
                ContactMode::Rolling => {
                    prop_assert!(slip.abs() < ACCELERATION_ROUNDING && tangential.abs() <= friction * normal + 1e-9);
                }
                ContactMode::Sliding { slip: direction, .. } => {
                    prop_assert!(slip * direction.sign() > -1e-9, "slips at {slip:e} m/s against {direction:?}");
                    prop_assert!((tangential + direction.sign() * friction * normal).abs() < ACCELERATION_ROUNDING);
                }
                ContactMode::Frictionless => prop_assert!(false, "no contact friction under Coulomb's law"),
            }
        }
    }

    /// The start from rest minimises Gauss's function, without a word about its gradient.
    #[test]
    fn the_start_from_rest_is_the_least_constrained(
        scene in scenes(),
        toward in 0.1..3.0,
        shift in -0.01..0.01,
        turn in -0.5..0.5,
        rolls in any::<bool>(),
    ) {
        let part = scene.part();
        let State { u, s, .. } = scene.start;
        let finger = Vector2::new(u.cos() * toward, u.sin() * toward);
        let model = PushModel { finger: Finger { acceleration: finger, ..scene.finger }, ..scene.model(&part) };
        let contact = if rolls { ContactMode::Rolling } else { ContactMode::Frictionless };
        let start = model.rest_start(&contact, u, s).unwrap();
        let support = SupportFriction::uniform(part.polygon()).with_origin(part.centre_of_mass());
        let gauss = |a_n: f64, a_t: f64, alpha: f64| {
            let (normal, along) = (model.edge.normal, Vector2::new(-model.edge.normal.y, model.edge.normal.x));
            let twist = Twist::new(normal * a_n - along * a_t, alpha);
            let inertia = a_n * a_n + a_t * a_t + part.inertia_per_mass() * alpha * alpha;
            0.5 * inertia + scene.mu_g * support.mean_sliding(&twist).mean_speed(&twist)
        };
        // Neighbours that the contact permits: alike along N, in rolling along T too.
        let a_t = start.a_t + if rolls { model.edge.height * turn } else { shift };
        let (least, neighbour) =
            (gauss(start.a_n, start.a_t, start.alpha), gauss(start.a_n + s * turn, a_t, start.alpha + turn));
        prop_assert!(least <= neighbour + 1e-12 * least.abs(), "{start:?}: {least:e} > {neighbour:e}");
        let meets: f64 = start.a_n - s * start.alpha + toward;
        prop_assert!(meets.abs() < ACCELERATION_ROUNDING * (1.0 + toward), "the contact parts at {meets:e} m/s²");
        if !rolls {
            // Thesis §5.1.3: the part turns to the side on which it is pushed.
            prop_assert!(start.alpha * s >= -ACCELERATION_ROUNDING);
        }
    }

    #[test]
    fn a_start_from_rest_goes_on_as_its_motion_does(scene in scenes(), toward in 0.3..3.0, contact in contacts()) {
        let part = scene.part();
        let State { u, s, .. } = scene.start;
        let acceleration = Vector2::new(u.cos() * toward, u.sin() * toward);
        let finger = Finger { acceleration, velocity0: Vector2::zeros(), ..scene.finger };
        let model = PushModel { finger, ..scene.model(&part) };
        let start = model.rest_start(&contact, u, s).unwrap();
        // A moment later, the state that the start leads to accelerates as the start does.
        let t = 1e-7;
        let state = State { u, s, omega: start.alpha * t, v_t: start.a_t * t };
        let motion = model.motion(&contact, t, &state);
        let scale = 1.0 + start.alpha.abs() + start.normal_force.abs();
        prop_assert!((motion.rates.omega - start.alpha).abs() < 1e-6 * scale, "{start:?} {motion:?}");
        prop_assert!((motion.normal_force - start.normal_force).abs() < 1e-6 * scale, "{start:?} {motion:?}");
        prop_assert!((motion.tangential_force - start.tangential_force).abs() < 1e-6 * scale, "{start:?} {motion:?}");
    }

    /// Every parameter, against central differences of the same steps.
    #[test]
    fn derivatives_are_those_of_finite_differences(scene in scenes(), contact in contacts()) {
        const ALL: [Parameter; 10] = [
            Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT, Parameter::MuG, Parameter::ContactFriction,
            Parameter::FingerVelocity(0), Parameter::FingerVelocity(1),
            Parameter::FingerAcceleration(0), Parameter::FingerAcceleration(1),
        ];
        // Large enough to stand above rounding, small enough for the third derivative not to show.
        const SMALL: [f64; 10] = [1e-5, 1e-7, 1e-5, 1e-6, 1e-5, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6];
        /// Of a difference quotient, relative to the derivative or to what rounding leaves of it.
        const QUOTIENT: f64 = 2e-4;
        let part = scene.part();
        let model = scene.model(&part);
        let seeded = Seeded::new(&model, &contact, &scene.start, ALL);
        let exact = seeded.model.rollout(&seeded.contact, &seeded.start, 1e-3).nth(29).unwrap();
        let columns = derivatives(&exact);
        for (column, (parameter, small)) in ALL.into_iter().zip(SMALL).enumerate() {
            let end = |change: f64| {
                let (model, contact, start) = changed(model, contact, scene.start, parameter, change);
                let end = model.rollout(&contact, &start, 1e-3).nth(29).unwrap();
                nalgebra::Vector4::new(end.u, end.s / 0.02, end.omega * 0.1, end.v_t / 0.1)
            };
            let quotient = (end(small) - end(-small)) / (2.0 * small);
            let column = columns.column(column);
            let column = nalgebra::Vector4::new(column[0], column[1] / 0.02, column[2] * 0.1, column[3] / 0.1);
            prop_assert!(
                (quotient - column).norm() <= QUOTIENT * (column.norm() + 1e-9 / small),
                "{parameter:?}: {column:?}, by differences {quotient:?}"
            );
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// States after changes of contact, and the instants of these, against central differences of whole runs.
    #[test]
    fn derivatives_cross_changes_of_contact(scene in possible_scenes(), friction in 0.05..0.4) {
        const BY: [Parameter; 5] =
            [Parameter::U, Parameter::S, Parameter::Omega, Parameter::VT, Parameter::MuG];
        const SMALL: [f64; 5] = [1e-5, 1e-6, 1e-5, 1e-6, 1e-5];
        /// Of a difference of runs that are good to 1e-10, over 2e-6 and more; and of the steps that carry the
        /// derivatives.
        const QUOTIENT: f64 = 2e-3;
        let law = ContactLaw::Coulomb { friction };
        let part = scene.part();
        let run_with = |parameter, change: f64| {
            let (model, _, start) = changed(scene.model(&part), ContactMode::Rolling, scene.start, parameter, change);
            Push::new(model, law, Start::Moving(start), EdgeEnd::Extend).unwrap().run(&[0.15]).unwrap()
        };
        let push = Push::new(scene.model(&part), law, Start::Moving(scene.start), EdgeEnd::Extend).unwrap();
        let derived = push.run_derived(&[0.15], BY).unwrap();
        prop_assume!(!derived.changes.is_empty() && derived.run.end.reason == EndReason::Time);
        let slopes = derivatives(&derived.states[0]);
        let value = derived.states[0];
        // The derivatives' own steps follow the run.
        prop_assert!((value.u.value - derived.run.last.state.u).abs() < 1e-6, "{value:?} {:?}", derived.run.last);
        for (column, (parameter, small)) in BY.into_iter().zip(SMALL).enumerate() {
            let runs = [small, -small, 2.0 * small, -2.0 * small].map(|change| run_with(parameter, change));
            // Neighbours that change otherwise are on the other side of a kink.
            prop_assume!(runs.iter().all(|run| run.changes.len() == derived.changes.len()));
            let quotient = |of: &dyn Fn(&PushRun) -> f64| Quotient::of(runs.each_ref().map(of), small);
            let by_difference = [
                quotient(&|run| run.last.state.u),
                quotient(&|run| run.last.state.s / 0.02),
                quotient(&|run| run.last.state.omega * 0.1),
            ];
            let exact = [slopes[(0, column)], slopes[(1, column)] / 0.02, slopes[(2, column)] * 0.1];
            let size = exact.iter().fold(1e-10 / small, |size, x| size.max(x.abs()));
            for (by_difference, exact) in by_difference.into_iter().zip(exact) {
                prop_assert!(
                    (by_difference.value - exact).abs() <= QUOTIENT * size + by_difference.error,
                    "{parameter:?}: {exact:e}, {by_difference:?}; {:?}", derived.run.changes
                );
            }
            for (i, instant) in derived.changes.iter().enumerate() {
                let by_difference = quotient(&|run| run.changes[i].t);
                // Instants are located to about 1e-10 s.
                let bound = 5.0 * QUOTIENT * instant.slopes[column].abs() + 1e-10 / small + by_difference.error;
                prop_assert!(
                    (by_difference.value - instant.slopes[column]).abs() <= bound,
                    "{parameter:?}: dt = {:e}, {by_difference:?}", instant.slopes[column]
                );
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// The instant at which a push ends by itself, against central differences of whole runs.
    #[test]
    fn the_end_of_a_push_has_its_derivatives(scene in possible_scenes(), law in laws()) {
        const BY: [Parameter; 4] = [Parameter::S, Parameter::Omega, Parameter::MuG, Parameter::FingerVelocity(0)];
        const SMALL: [f64; 4] = [1e-6, 1e-5, 1e-5, 1e-6];
        /// Of the steps that carry the derivatives, and the 1e-10 s to which instants are located.
        const QUOTIENT: f64 = 5e-3;
        let part = scene.part();
        let run_with = |parameter, change: f64| {
            let (model, _, start) = changed(scene.model(&part), ContactMode::Rolling, scene.start, parameter, change);
            let push = Push::new(model, law, Start::Moving(start), EdgeEnd::Stop);
            push.ok().and_then(|push| push.run(&[1.5]).ok())
        };
        let push = Push::new(scene.model(&part), law, Start::Moving(scene.start), EdgeEnd::Stop);
        prop_assume!(push.is_ok());
        let derived = push.unwrap().run_derived(&[1.5], BY).unwrap();
        let Some(end) = derived.end else { return Err(TestCaseError::reject("ends in a jam")) };
        prop_assume!(derived.run.end.reason != EndReason::Time && derived.changes.is_empty() && end.value > 0.0);
        prop_assert!((end.value - derived.run.end.t).abs() < 1e-9);
        for (column, (parameter, small)) in BY.into_iter().zip(SMALL).enumerate() {
            let runs = [small, -small, 2.0 * small, -2.0 * small].map(|change| run_with(parameter, change));
            let [Some(a), Some(b), Some(c), Some(d)] = &runs else { continue };
            let runs = [a, b, c, d];
            prop_assume!(runs.iter().all(|run| run.end.reason == derived.run.end.reason && run.changes.is_empty()));
            let by_difference = Quotient::of(runs.map(|run| run.end.t), small);
            let exact = end.slopes[column];
            prop_assert!(
                (by_difference.value - exact).abs() <= QUOTIENT * exact.abs() + 1e-9 / small + by_difference.error,
                "{parameter:?}, {:?}: {exact:e}, {by_difference:?}", derived.run.end
            );
        }
    }
}

/// A slope by central differences.
#[derive(Clone, Copy, Debug)]
struct Quotient {
    value: f64,
    /// What third derivatives make of it: large where a change of contact is all but tangential, and its instant all
    /// but without a slope.
    error: f64,
}

impl Quotient {
    /// Of the values `small` before and behind, and twice as far: the error of the first is a third of how the two
    /// differ.
    fn of([plus, minus, far_plus, far_minus]: [f64; 4], small: f64) -> Self {
        let [value, far] = [(plus - minus) / (2.0 * small), (far_plus - far_minus) / (4.0 * small)];
        Self { value, error: (value - far).abs() }
    }
}

/// A push with one parameter changed.
fn changed<'p>(
    mut model: PushModel<'p>,
    mut contact: ContactMode,
    mut start: State,
    parameter: Parameter,
    change: f64,
) -> (PushModel<'p>, ContactMode, State) {
    match parameter {
        Parameter::U => start.u += change,
        Parameter::S => start.s += change,
        Parameter::Omega => start.omega += change,
        Parameter::VT => start.v_t += change,
        Parameter::MuG => model.mu_g += change,
        Parameter::ContactFriction => {
            if let ContactMode::Sliding { friction, .. } = &mut contact {
                *friction += change;
            }
        }
        Parameter::FingerVelocity(axis) => model.finger.velocity0[axis] += change,
        Parameter::FingerAcceleration(axis) => model.finger.acceleration[axis] += change,
    }
    (model, contact, start)
}

#[test]
fn fixed_steps_are_of_fourth_order() {
    let part = block();
    let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 2.943, finger: finger() };
    let start = State { u: 1.7, s: 0.004, omega: 0.3, v_t: 0.002 };
    for contact in [ContactMode::Rolling, ContactMode::Frictionless] {
        let truth = model.rollout(&contact, &start, 5e-5).nth(7999).unwrap().u;
        let exact =
            |steps: usize| model.rollout(&contact, &start, 0.4 / steps as f64).nth(steps - 1).unwrap().u - truth;
        let fast =
            |steps: usize| model.fast_rollout(&contact, &start, 0.4 / steps as f64).nth(steps - 1).unwrap().u - truth;
        // Half the step, a sixteenth of the error; terms of higher order blur that.
        for (coarse, fine) in [(exact(200), exact(400)), (fast(200), fast(400))] {
            let ratio = (coarse / fine).abs();
            assert!((8.0..40.0).contains(&ratio), "{contact:?}: {coarse:e} rad, {fine:e} rad at half the step");
        }
    }
}

/// At 5 ms, within ten times the worst errors documented: those are of pushes drawn otherwise.
#[test]
fn fixed_steps_err_as_documented() {
    let part = block();
    for i in 0..20 {
        let start = State { u: 1.4 + 0.02 * f64::from(i), s: 0.0008 * f64::from(i - 10), omega: 0.2, v_t: 0.002 };
        let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 2.943, finger: finger() };
        let truth = model.rollout(&ContactMode::Rolling, &start, 1e-4).nth(7999).unwrap();
        let exact = model.rollout(&ContactMode::Rolling, &start, 5e-3).nth(159).unwrap();
        let fast = model.fast_rollout(&ContactMode::Rolling, &start, 5e-3).nth(159).unwrap();
        let law = ContactLaw::Rolling { friction: None };
        let push = Push::new(model, law, Start::Moving(start), EdgeEnd::Extend).unwrap();
        let controlled = push.run(&[0.8]).unwrap().last.state;
        assert!((exact.u - truth.u).abs() < 5e-6, "{:e} rad", exact.u - truth.u);
        assert!((fast.u - truth.u).abs() < 4e-5, "{:e} rad", fast.u - truth.u);
        // The reference's own error shows here.
        assert!((controlled.u - truth.u).abs() < 1e-10, "{:e} rad", controlled.u - truth.u);
    }
}

/// A square of 6 cm by 4 cm about its frame's origin.
fn block() -> Part {
    Part::uniform(
        SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from)).unwrap(),
    )
}

/// The finger of most tests: up at 5 cm/s.
fn finger() -> Finger {
    Finger {
        radius: 0.01,
        centre0: Point2::origin(),
        velocity0: Vector2::new(0.0, 0.05),
        acceleration: Vector2::zeros(),
    }
}

#[test]
fn a_blocks_mass_is_that_of_the_textbook() {
    let part = block();
    // (a² + b²)/12
    assert!((part.inertia_per_mass() - (0.06_f64.powi(2) + 0.04_f64.powi(2)) / 12.0).abs() < 1e-18);
    assert!(part.centre_of_mass().coords.norm() < 1e-16);
    let edge = part.edge(0).unwrap();
    assert_eq!(edge.normal, Vector2::new(0.0, -1.0));
    assert!(Vector3::new(edge.height - 0.02, edge.s_min + 0.03, edge.s_max - 0.03).norm() < 1e-16);
}

/// Pushed through its centre of mass along its own symmetry, a block follows the finger and nothing else happens.
#[test]
fn a_block_pushed_at_its_middle_goes_straight() {
    let part = block();
    let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 2.943, finger: finger() };
    let start = Start::Moving(State { u: PI / 2.0, s: 0.0, omega: 0.0, v_t: 0.0 });
    let push = Push::new(model, ContactLaw::Frictionless, start, EdgeEnd::Stop).unwrap();
    let run = push.run(&[0.0, 0.5, 1.0]).unwrap();
    assert_eq!((run.end.reason, run.samples.len()), (EndReason::Time, 3));
    let Sample { position, force, theta, .. } = run.last;
    assert!((position - Point2::new(0.0, 0.05 + 0.03)).norm() < 1e-12 && theta.abs() < 1e-12, "{position} {theta}");
    // It does not accelerate, so the finger carries all of the friction.
    assert!((force.unwrap().normal - 2.943).abs() < 1e-12);
}

#[test]
fn a_finger_that_stops_loses_the_part_where_it_stops() {
    let part = block();
    // Slower to brake than friction would be, so that the part is pushed to the end: at rest after 1 s.
    let finger = Finger { acceleration: Vector2::new(0.0, -0.05), ..finger() };
    let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 2.943, finger };
    let start = Start::Moving(State { u: PI / 2.0, s: 0.004, omega: 0.3, v_t: 0.0 });
    let run =
        Push::new(model, ContactLaw::Rolling { friction: None }, start, EdgeEnd::Stop).unwrap().run(&[2.0]).unwrap();
    assert_eq!(run.end.reason, EndReason::Break);
    assert!((run.end.t - 1.0).abs() < 1e-6 && run.last.velocity.norm() < 1e-8, "{:?}", run.last);
}

#[test]
fn a_contact_at_the_end_of_its_edge_stops_there_or_not_as_asked() {
    let part = block();
    let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 2.943, finger: finger() };
    // At the vertex, sliding outwards.
    let start = Start::Moving(State { u: PI / 2.0, s: 0.03, omega: 0.0, v_t: 0.01 });
    let run =
        |edge_end| Push::new(model, ContactLaw::Frictionless, start, edge_end).unwrap().run(&[0.0, 1e-3]).unwrap();
    let stopped = run(EdgeEnd::Stop);
    assert_eq!((stopped.end.reason, stopped.samples.len()), (EndReason::EdgeMax, 1));
    assert!(stopped.end.t.abs() < f64::EPSILON);
    let extended = run(EdgeEnd::Extend);
    assert_eq!(extended.end.reason, EndReason::Time);
    assert!(extended.last.state.s > 0.03, "{:?}", extended.last);
}

/// Parts on feet that come to rest while the part turns about them: what was too stiff.
mod feet_at_rest {
    use super::*;
    use crate::math::random::Draw;
    use crate::pushing::quasi_static::{SlowEnd, SlowPush, Support as SlowSupport};
    use crate::search::never;

    const MU: f64 = 0.3;
    const G: f64 = 9.81;
    const MU_C: f64 = 0.4;
    const SPEED: f64 = 2.5e-3;
    const RADIUS: f64 = 1e-3;

    fn triangle() -> SimplePolygon {
        SimplePolygon::new([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Point2::from)).unwrap()
    }

    /// On this many feet, drawn.
    fn part(count: usize, draw: &mut Draw) -> Part {
        let outline = triangle();
        let foot = |draw: &mut Draw| {
            let (a, b) = (draw.unit(), draw.unit());
            let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
            Point2::new(0.008 + 0.12 * a, 0.008 + 0.12 * b)
        };
        let shares: Vec<_> = (0..count).map(|_| draw.uniform(0.5, 1.5)).collect();
        let sum: f64 = shares.iter().sum();
        let feet: Vec<_> = shares.iter().map(|share| (foot(draw), share / sum)).collect();
        let mass = Mass::uniform(&outline);
        Part::on_feet(outline, &feet, mass)
    }

    /// A finger that goes straight on at 2.5 mm/s into an edge, and the part that goes along.
    fn pushed<'p>(part: &'p Part, speed: f64, draw: &mut Draw) -> Push<'p> {
        let edge = part.edge(draw.index(3)).unwrap();
        let s = edge.s_min + (edge.s_max - edge.s_min) * draw.uniform(0.25, 0.75);
        let turn = draw.uniform(-0.6, 0.6);
        let normal = edge.normal;
        let tangent = Vector2::new(-normal.y, normal.x);
        let point = part.body().centre_of_mass() + normal * edge.height + tangent * s;
        let velocity0 = Rotation2::new(turn) * -normal * speed;
        let finger =
            Finger { radius: RADIUS, centre0: point + normal * RADIUS, velocity0, acceleration: Vector2::zeros() };
        let model = PushModel { part, edge, mu_g: MU * G, finger };
        let u = (-normal.y).atan2(-normal.x);
        let state = State { u, s, omega: 0.0, v_t: 0.0 };
        let state = State { v_t: model.rolling_v_t(0.0, &state), ..state };
        Push::new(model, ContactLaw::Coulomb { friction: MU_C }, Start::Moving(state), EdgeEnd::Stop).unwrap()
    }

    /// A fine-stepped integration knows nothing of stiff steps: a fifth of a microsecond each, up to the first change.
    #[test]
    fn stiff_steps_agree_with_steps_of_a_fifth_of_a_microsecond() {
        const DT: f64 = 0.2e-6;
        let mut rested = 0;
        for case in 0..12 {
            let draw = &mut Draw::case(11, case);
            let part = part(3, draw);
            let push = pushed(&part, SPEED, draw);
            let until = 0.06;
            let Ok(run) = push.run(&[until]) else { panic!("case {case}") };
            // Of one kind of contact from its first change on, if there was one.
            let (from, contact) = run.changes.last().map_or((0.0, run.last.contact), |change| (change.t, change.to));
            if run.end.reason != EndReason::Time || until - from < 0.02 {
                continue;
            }
            let begin = push.run(&[from + 1e-4]).unwrap().last;
            let model = push.model;
            let steps = ((until - begin.t) / DT).round();
            let dt = (until - begin.t) / steps;
            let mut state = begin.state;
            let mut k = 0.0;
            while k < steps {
                state = model.step(&contact, begin.t + k * dt, &state, dt);
                k += 1.0;
            }
            let found = run.last.state;
            let off = [(found.u - state.u).abs(), (found.s - state.s).abs(), (found.omega - state.omega).abs()];
            // A thousandth of what a foot at rest creeps.
            assert!(off[0] < 1e-7 && off[1] < 1e-9 && off[2] < 1e-7, "case {case}: {off:?}");
            let velocity = model.velocity(&contact, until, &state);
            let turn = Rotation2::new(model.theta(&state));
            let slowest = part.body().feet().unwrap().map(|(at, _)| {
                let arm = turn * (at - part.body().centre_of_mass());
                (velocity + Vector2::new(-arm.y, arm.x) * state.omega).norm()
            });
            rested += usize::from(slowest.fold(f64::INFINITY, f64::min) < 2e-6);
        }
        assert!(rested >= 2, "feet came to rest in {rested} pushes");
    }

    /// How far a slow push in time ends from where one without inertia does, m and rad; none where either ends early.
    fn off_quasi_static(case: usize, speed: f64) -> Option<[f64; 2]> {
        let draw = &mut Draw::case(12, case);
        let part = part(1 + case % 6, draw);
        let push = pushed(&part, speed, draw);
        let until = 3.0 * SPEED / speed;
        let run = push.run(&[until]).unwrap_or_else(|error| panic!("case {case}: {error}"));
        let finger = push.model.finger;
        let slow = SlowPush {
            outline: triangle(),
            support: SlowSupport::of(part.body(), MU, 0.0),
            centre_of_mass: None,
            gravity: G,
            height: 0.0,
            radius: RADIUS,
            contact_friction: [MU_C; 2],
            path: vec![finger.centre0, finger.centre0 + finger.velocity0 * until],
            pose: crate::Pose { x: 0.0, y: 0.0, theta: 0.0 },
            step_max: 5e-4,
        };
        let slowly = slow.run(&never).unwrap();
        if run.end.reason != EndReason::Time || slowly.end != SlowEnd::Path {
            return None;
        }
        let pose = slowly.samples[1].pose;
        Some([(run.last.position - pose.origin()).norm(), (run.last.theta - pose.theta).abs()])
    }

    /// At 2.5 mm/s a part is where a push without inertia, which minimises dissipation, leaves it, but for what it slides until
    /// it has the finger's speed, v²/(µg) = 2 µm, and for the creep of feet at rest, 3 µm: what an unstable push makes of
    /// that is some tens of micrometres. That it is inertia shows at half the speed, which leaves a quarter of it, and twice
    /// the creep. On one foot a part spins freely about it, and nothing but inertia stops it.
    #[test]
    fn slow_pushes_on_one_to_six_feet_are_quasi_static() {
        const ALLOWED: [f64; 2] = [5e-5, 8e-4];
        let mut sums = [0.0; 2];
        let mut compared = 0;
        for case in 0..60 {
            // Answered on one foot, too.
            let both = [SPEED, 0.5 * SPEED].map(|speed| off_quasi_static(case, speed));
            let ([Some(full), Some(half)], true) = (both, case % 6 > 0) else { continue };
            compared += 1;
            sums = [sums[0] + full[0], sums[1] + half[0]];
            for off in [full, half] {
                assert!(off[0] < ALLOWED[0] && off[1] < ALLOWED[1], "case {case}: {off:?} m and rad, not {ALLOWED:?}");
            }
        }
        assert!(compared >= 40, "{compared}");
        assert!(sums[1] < 0.6 * sums[0], "{sums:?} m in all, at both speeds");
    }
}
