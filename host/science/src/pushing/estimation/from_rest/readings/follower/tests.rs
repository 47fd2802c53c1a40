use nalgebra::{Matrix3, Vector3};
use palpate_shared::sim::{BeamConfig, Carriage, CarriedBeam, CarriedConfig, CarriedMasses};

use super::super::tests::Case;
use super::super::tracker::TrackerState;
use super::*;
use crate::finger::judge::Judged;
use crate::geometry::Pose;
use crate::math::random::Draw;
use crate::math::statistics::chi_square_quantile;
use crate::pushing::estimation::from_rest::watch::WatchSettings;
use crate::search::never;

const PERIOD_NS: u32 = 250_000;
const PERIOD_S: f64 = 250e-6;

/// Rest before the push, s.
const REST_S: f64 = 1.2;

/// Of a sample, each axis, N.
const NOISE_N: f64 = 2e-3;

/// What a constant of the sensor is off by, N.
const BIAS_N: [f64; 2] = [0.3, -0.1];

/// What simulations and sums over periods are off by where an exact contact leaves a covariance singular: m, m, rad.
const SLACK: [f64; 3] = [1e-5, 1e-5, 1e-4];

/// Samples of a simulated finger of mass and stiffness that pushes the part after a rest.
fn samples(case: &Case, motion: &FingerMotion, draw: &mut Draw) -> Vec<Judged> {
    let mut beam = CarriedBeam::new(BeamConfig::default(), CarriedConfig::default());
    let count = (0_u32..).take_while(|k| f64::from(*k) * PERIOD_S < REST_S + motion.duration());
    let sample = |index: u32| {
        let from = f64::from(index) * PERIOD_S - REST_S;
        #[expect(clippy::cast_possible_truncation, reason = "the simulation computes in single precision")]
        let single = |v: Vector2<f64>| [v.x as f32, v.y as f32];
        let felt = beam.advance(PERIOD_NS, |after| {
            let t = from + 1e-9 * f64::from(after);
            if t < 0.0 {
                return Carriage::default();
            }
            let (force, acceleration) = (case.drawn.played.force_finger(t), motion.acceleration(t));
            Carriage { force: single(force), acceleration: single(acceleration) }
        });
        let noise = Vector2::new(draw.normal(), draw.normal()) * NOISE_N;
        let force = Vector2::from(felt.map(f64::from)) + Vector2::from(BIAS_N) + noise;
        Judged::Measured(Reading::new(REST_S + from + 0.5 * PERIOD_S, force))
    };
    count.map(sample).collect()
}

/// Follows a push of which mass and µ_c are not known; squared errors, in their own standard deviations, of the hypothesis
/// that is nearest, with how many there were and when.
fn follow(case: &Case, clock: Option<MotionClock>, draw: &mut Draw) -> (PushFollower, Vec<f64>) {
    let beam = CarriedMasses::new(&BeamConfig::default(), CarriedConfig::default().density);
    let known = case.known(&case.part);
    let known = KnownOfFinger { mass: None, mu_c: None, effective_mass: f64::from(beam.effective), ..known };
    let mut watch = PushWatch::new(WatchSettings { rest_s: 1.0, every_s: 0.1 }, None);
    let mut follower = PushFollower::new(clock);
    let mut errors = Vec::new();
    for item in samples(case, known.motion, draw) {
        watch.take([item]).unwrap();
        while let Some(time) = follower.next(&known, &watch) {
            if let Some(task) = follower.search_due() {
                let found = task.run(&follower.known(&known), &never);
                follower.adopt(&known, found);
            }
            if follower.tracker().unwrap().state() == TrackerState::Following {
                assert!((follower.tracker().unwrap().time() - time).abs() < 1e-9);
                errors.push(squared_error(case, &follower, &known));
            }
        }
    }
    (follower, errors)
}

fn squared_error(case: &Case, follower: &PushFollower, known: &KnownOfFinger) -> f64 {
    let truth: Pose = case.drawn.played.pose(follower.tracker().unwrap().time()).unwrap().into();
    let slack = Matrix3::from_diagonal(&Vector3::from(SLACK.map(|sd| sd * sd)));
    let squared = |found: &TrackedHypothesis| {
        let off = found.pose.minus(&truth);
        let covariance = found.covariance.fixed_view::<3, 3>(0, 0) + slack;
        (off.transpose() * covariance.try_inverse().unwrap() * off)[0]
    };
    follower.hypotheses(known).iter().map(squared).min_by(f64::total_cmp).unwrap_or(f64::INFINITY)
}

/// The last pose is within its region, most on the way are; the answer says something.
fn assert_followed(case: &Case, follower: &PushFollower, errors: &[f64], number: usize) {
    let known = case.known(&case.part);
    let within = errors.iter().filter(|error| **error < chi_square_quantile(0.99, 3)).count();
    assert!(within * 10 >= 9 * errors.len() && !errors.is_empty(), "case {number}: {within} of {}", errors.len());
    let end = squared_error(case, follower, &known);
    assert!(end < chi_square_quantile(0.9999, 3), "case {number}: {end} at the end");
    let best = &follower.hypotheses(&known)[0];
    let (distance, angle) = best.spread(&case.part);
    assert!(distance < 5e-3 && angle < 0.2, "case {number}: ± {distance} m, {angle} rad");
}

#[test]
fn a_push_is_followed_through_the_ringing_of_the_finger() {
    for case in 0..6 {
        let mut draw = Draw::case(51, case);
        let drawn = Case::draw(&mut draw);
        let (follower, errors) = follow(&drawn, None, &mut draw);
        let ringing = follower.ringing().unwrap();
        assert!((ringing.frequency_hz() - 177.3).abs() < 2.0, "case {case}: {ringing:?}");
        assert_followed(&drawn, &follower, &errors, case);
    }
}

#[test]
fn a_clock_that_is_told_and_off_is_in_the_covariance() {
    for case in 0..3 {
        let mut draw = Draw::case(52, case);
        let drawn = Case::draw(&mut draw);
        let clock = MotionClock { begins: REST_S + 3e-4, sd: 5e-4 };
        let (follower, errors) = follow(&drawn, Some(clock), &mut draw);
        assert_followed(&drawn, &follower, &errors, case);
        // As far as the disk goes in half a millisecond, at least.
        let known = drawn.known(&drawn.part);
        let time = follower.tracker().unwrap().time();
        let step = known.motion.centre(time + clock.sd) - known.motion.centre(time);
        let covariance = follower.hypotheses(&known)[0].covariance;
        let along = (step.transpose() * covariance.fixed_view::<2, 2>(0, 0) * step)[0] / step.norm_squared();
        assert!(along >= 0.99 * step.norm_squared(), "{along} m², {step}");
    }
}

#[test]
fn a_jump_of_acceleration_is_left_out_of_readings() {
    let segment =
        |seconds: f64, x: f64| crate::pushing::finger_motion::Segment { seconds, acceleration: Vector2::new(x, 0.0) };
    let motion =
        FingerMotion::new(nalgebra::Point2::origin(), &[segment(0.1, 1.0), segment(0.1, 1.05), segment(0.1, -1.0)]);
    let motion = motion.unwrap();
    assert_eq!(first_jump(&motion, 0.0, 0.15), None, "a rise of a twentieth is none");
    assert!((first_jump(&motion, 0.15, 0.25).unwrap() - 0.2).abs() < 1e-12);
    assert_eq!(first_jump(&motion, 0.21, 0.5), None);
}
