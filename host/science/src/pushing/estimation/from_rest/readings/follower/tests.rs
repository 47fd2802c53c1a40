use nalgebra::{Matrix3, Point2, Vector3};
use palpate_shared::sim::{BeamConfig, Carriage, CarriedBeam, CarriedConfig, CarriedMasses};

use super::super::tests::Case;
use super::super::tracker::TrackerState;
use super::*;
use crate::finger::judge::Judged;
use crate::geometry::Pose;
use crate::math::random::Draw;
use crate::math::statistics::chi_square_quantile;
use crate::pushing::estimation::from_rest::watch::WatchSettings;
use crate::pushing::finger_motion::Segment;
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
        while let Some(time) = follower.next(&known, None, &watch) {
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
fn assert_followed(case: &Case, motion: &FingerMotion, follower: &PushFollower, errors: &[f64], number: usize) {
    let known = KnownOfFinger { motion, ..case.known(&case.part) };
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
        assert_followed(&drawn, drawn.known(&drawn.part).motion, &follower, &errors, case);
    }
}

#[test]
fn a_clock_that_is_told_and_off_is_in_the_covariance() {
    for case in 0..3 {
        let mut draw = Draw::case(52, case);
        let drawn = Case::draw(&mut draw);
        let clock = MotionClock { begins: REST_S + 3e-4, sd: 5e-4 };
        let (follower, errors) = follow(&drawn, Some(clock), &mut draw);
        assert_followed(&drawn, drawn.known(&drawn.part).motion, &follower, &errors, case);
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
    let segment = |seconds: f64, x: f64| Segment { seconds, acceleration: Vector2::new(x, 0.0) };
    let motion = FingerMotion::new(Point2::origin(), &[segment(0.1, 1.0), segment(0.1, 1.05), segment(0.1, -1.0)]);
    let motion = motion.unwrap();
    assert_eq!(first_jump(&motion, 0.0, 0.15), None, "a rise of a twentieth is none");
    assert!((first_jump(&motion, 0.15, 0.25).unwrap() - 0.2).abs() < 1e-12);
    assert_eq!(first_jump(&motion, 0.21, 0.5), None);
}

/// The same of a motion that is measured while it goes, by a clock of its own.
fn follow_measured(case: &Case, sd: f64, per_second: f64, draw: &mut Draw) -> (PushFollower, StreamedPath, Vec<f64>) {
    /// When the path's clock shows 0, s of that of the force.
    const CLOCK_S: f64 = -0.04;
    let beam = CarriedMasses::new(&BeamConfig::default(), CarriedConfig::default().density);
    let known = case.known(&case.part);
    let known = KnownOfFinger { mass: None, mu_c: None, effective_mass: f64::from(beam.effective), ..known };
    let truth = known.motion;
    let mut watch = PushWatch::new(WatchSettings { rest_s: 1.0, every_s: 0.1 }, None);
    let (mut follower, mut path, mut errors) = (PushFollower::new(None), StreamedPath::new(sd), Vec::new());
    let mut measured = 0.5;
    let samples = samples(case, truth, draw);
    let count = samples.len();
    for (index, item) in samples.into_iter().enumerate() {
        let (now, is_last) = (index as f64 * PERIOD_S, index + 1 == count);
        watch.take([item]).unwrap();
        let mut is_new = is_last;
        while measured < now {
            let off = Vector2::new(draw.normal(), draw.normal()) * sd;
            path.take(measured - CLOCK_S, truth.centre((measured - REST_S).max(0.0)) + off).unwrap();
            measured += draw.uniform(0.7, 1.3) / per_second;
            is_new = true;
        }
        if is_last {
            path.end().unwrap();
        }
        let Some(motion) = path.motion().filter(|_| is_new) else { continue };
        let known = KnownOfFinger { motion, ..known };
        while follower.next(&known, Some(&path), &watch).is_some() {
            if let Some(task) = follower.search_due() {
                let found = task.run(&follower.known(&known), &never);
                follower.adopt(&known, found);
            }
            if follower.tracker().unwrap().state() == TrackerState::Following {
                errors.push(squared_error(case, &follower, &known));
            }
        }
    }
    (follower, path, errors)
}

/// From a robot's own controller to what is watched by a camera: told is never wrong, and within the tenth of a second that
/// it takes longer nearly every push is followed.
#[test]
fn a_push_is_followed_whose_motion_is_measured_meanwhile() {
    let mut followed = 0;
    // Of each coordinate, m, and how many places a second.
    let kinds = [(5e-6, 250.0), (2e-5, 500.0), (1e-5, 100.0), (1e-5, 20.0)];
    for (kind, case) in kinds.into_iter().flat_map(|kind| (0..4).map(move |case| (kind, case))) {
        let (sd, per_second) = kind;
        let mut draw = Draw::case(53, case);
        let drawn = Case::draw(&mut draw);
        let (follower, path, errors) = follow_measured(&drawn, sd, per_second, &mut draw);
        if !errors.is_empty() {
            assert_followed(&drawn, path.motion().unwrap(), &follower, &errors, case);
            followed += 1;
        }
    }
    assert!(followed >= 14, "{followed} of 16");
}

#[test]
fn a_step_of_a_measured_acceleration_is_left_out_of_readings() {
    let doubts = MotionDoubts { acceleration_sd: 0.01, smeared_s: 0.01, ..MotionDoubts::default() };
    let segment = |seconds: f64, x: f64| Segment { seconds, acceleration: Vector2::new(x, 0.0) };
    let steps_at_0_1 = |by: f64| {
        let motion = FingerMotion::new(Point2::origin(), &[segment(0.1, 0.1), segment(0.1, 0.1 + by)]).unwrap();
        steps(&motion, &doubts, 0.082, 0.095)
    };
    assert!(steps_at_0_1(0.07) && !steps_at_0_1(0.05));
}
