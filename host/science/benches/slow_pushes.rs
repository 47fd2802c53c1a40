//! The estimator of slow pushes: how long one push takes. Run with `cargo bench --bench slow_pushes`.
//!
//! Bar: 0.5 s a push of the thread's own time, whatever the part stands on and however little is known before; one thread. Pushes are made by the
//! model itself, of a right-angled block with legs of 150 mm, towards points near its centre of mass from all sides, as the
//! recordings are.

mod yardstick;

use nalgebra::{Point2, Vector2};
use palpate::geometry::{Pose, SimplePolygon};
use palpate::math::random::Draw;
use palpate::math::statistics::percentile;
use palpate::pushing::estimation::slow_pushes::{
    Before, FeltForce, FeltPush, FilterSettings, Kernel, Onset, ParameterBelief, PushParameters, Region, SlowConstants,
    SlowFilter, SlowScene, Standing,
};
use yardstick::best_of_runs_within;

/// Seconds that one push may take.
const BAR_S: f64 = 0.5;

/// Pushes of each kind.
const PUSHES: usize = 12;

/// A push is run again until this is over, s.
const AGAIN_S: f64 = 0.3;

/// Goes from the first touch, m.
const TRAVEL_M: f64 = 13e-3;

fn main() {
    println!("ms a push, least of some runs each, over {PUSHES} pushes; bar {:.0} ms", 1e3 * BAR_S);
    println!("{:>8} {:>12} {:>8} {:>8} {:>8}", "stands", "known before", "median", "most", "kept");
    let feet = |feet: [[f64; 2]; 3]| Standing::Feet(feet.map(Point2::from).to_vec());
    let standings = [
        ("far feet", feet([[0.01, 0.01], [0.13, 0.01], [0.01, 0.13]])),
        ("near", feet([[0.03, 0.03], [0.063, 0.043], [0.043, 0.063]])),
        ("face", Standing::Face),
    ];
    for (name, standing) in &standings {
        measure(name, standing);
    }
}

fn measure(name: &str, standing: &Standing) {
    let outline = SimplePolygon::new([[0.0, 0.0], [0.15, 0.0], [0.0, 0.15]].map(Point2::from)).expect("a triangle");
    let scene = SlowScene::new(&outline, Point2::new(0.05, 0.05), 1.5, standing, SlowConstants::BOARD);
    let scene = scene.expect("it stands");
    let filter = SlowFilter { scene: &scene, settings: FilterSettings::STANDARD };
    let belief = ParameterBelief::default();
    let mut times: [Vec<f64>; 4] = Default::default();
    let mut kept = [0; 4];
    for number in 0..PUSHES {
        let mut draw = Draw::case(7, number);
        let pose = Pose { x: 0.0, y: 0.0, theta: 0.5 * number as f64 };
        let felt = pushed(&scene, &pose, &mut draw);
        let begun = filter.push(&Before::Box(pose, 10e-3, 0.17), &felt, &belief, &mut draw);
        let cloud = begun.cloud;
        let moved = scene.simulate(&felt, &pose, &PushParameters::default(), filter.settings.stride).pose;
        let next = pushed(&scene, &moved, &mut draw);
        let pushes = [
            (Before::Measured(pose, 3e-4, 3e-3), &felt),
            (Before::Box(pose, 10e-3, 0.17), &felt),
            (Before::Anywhere, &felt),
            (Before::After(&cloud), &next),
        ];
        for (n, (before, felt)) in pushes.iter().enumerate() {
            let mut push = || {
                let after = filter.push(before, felt, &belief, &mut Draw::case(8, number));
                // Stating what it leaves belongs to it.
                let region = Region::of(&after.cloud, Kernel::of(&filter.settings), &mut Draw::new(1));
                kept[n] = after.cloud.poses.len();
                std::hint::black_box(region);
            };
            times[n].push(1e3 * best_of_runs_within(AGAIN_S, &mut push));
        }
    }
    for ((known, times), kept) in ["pose", "box", "nothing", "push before"].iter().zip(&times).zip(kept) {
        let at = |per_cent| percentile(times.iter().copied(), per_cent).unwrap_or(f64::NAN);
        println!("{name:>8} {known:>12} {:>8.0} {:>8.0} {kept:>8}", at(50), at(100));
    }
}

/// A push of a part that lies here, and what is felt of it.
fn pushed(scene: &SlowScene, pose: &Pose, draw: &mut Draw) -> FeltPush {
    let angle = draw.uniform(-3.0, 3.0);
    let direction = Vector2::new(angle.cos(), angle.sin());
    let aside = Vector2::new(-direction.y, direction.x) * draw.uniform(-0.02, 0.02);
    let origin = Point2::new(pose.x, pose.y) + aside - direction * 0.05;
    let mut felt = FeltPush { origin, direction, tool_yaw: angle, end: 0.0, onset: Onset::Unknown, forces: Vec::new() };
    let touched = scene.first_touch(&felt, pose).expect("it is pushed at its middle");
    felt.end = touched + TRAVEL_M;
    felt.onset = Onset::At(touched + scene.constants().felt_late);
    felt.forces =
        (2..13).map(|i| FeltForce { travel: touched + 1e-3 * f64::from(i), force: Vector2::zeros() }).collect();
    let simulated = scene.simulate(&felt, pose, &PushParameters::default(), FilterSettings::STANDARD.stride);
    for (felt, force) in felt.forces.iter_mut().zip(&simulated.forces) {
        felt.force = force.unwrap_or_default();
    }
    felt.forces.retain(|felt| felt.force.norm() > 0.0);
    felt
}
