use nalgebra::{Matrix3, Vector3};

use super::super::tests::Case;
use super::*;
use crate::math::random::Draw;
use crate::search::never;

/// Of all readings of a push one in so many: some 130 a second.
const EACH: usize = 10;

/// What simulations are off by where an exact contact leaves a covariance singular: m, m, rad.
const SLACK: [f64; 3] = [5e-6, 5e-6, 5e-5];

/// Follows all readings; what a search finds comes so many readings late.
fn track(
    known: &KnownOfFinger,
    readings: &[ForceReading],
    late: usize,
    mut each: impl FnMut(&ForceTracker),
) -> ForceTracker {
    let mut tracker = ForceTracker::new(known);
    let mut found: Option<(usize, Found)> = None;
    for (index, reading) in readings.iter().enumerate() {
        tracker.take(known, *reading);
        if let Some(task) = tracker.search_due() {
            found = Some((index + late, task.run(known, &never)));
        }
        if let Some((_, found)) = found.take_if(|(at, _)| *at <= index) {
            tracker.adopt(known, found);
        }
        each(&tracker);
    }
    tracker
}

/// Squared error of the nearest hypothesis in its own standard deviations, of two degrees of freedom on an exact contact.
fn squared_error(case: &Case, known: &KnownOfFinger, tracker: &ForceTracker) -> f64 {
    let truth: Pose = case.drawn.played.pose(tracker.time()).unwrap().into();
    let squared = |found: &TrackedHypothesis| {
        let off = found.pose.minus(&truth);
        let slack = Matrix3::from_diagonal(&Vector3::from(SLACK.map(|sd| sd * sd)));
        let covariance = found.covariance.fixed_view::<3, 3>(0, 0) + slack;
        (off.transpose() * covariance.try_inverse().unwrap() * off)[0]
    };
    tracker.hypotheses(known).iter().map(squared).min_by(f64::total_cmp).unwrap_or(f64::INFINITY)
}

/// The errors over pushes that are followed, twenty times in each.
fn errors(seed: u64, cases: usize, from: f64, late: usize, of: impl Fn(KnownOfFinger) -> KnownOfFinger) -> Vec<f64> {
    let mut errors = Vec::new();
    for case in 0..cases {
        let mut draw = Draw::case(seed, case);
        let drawn = Case::draw(&mut draw);
        let readings: Vec<_> = drawn.readings(&mut draw, from).into_iter().step_by(EACH).collect();
        let known = of(drawn.known(&drawn.part));
        let mut taken = 0;
        let tracker = track(&known, &readings, late, |tracker| {
            taken += 1;
            if tracker.state() == TrackerState::Following && taken % 5 == 0 {
                errors.push(squared_error(&drawn, &known, tracker));
            }
        });
        assert_eq!(tracker.state(), TrackerState::Following, "case {case}");
        let end = squared_error(&drawn, &known, &tracker);
        assert!(end < chi_square_quantile(0.9999, 2), "case {case}: {end} at the end");
    }
    errors
}

/// Stated regions hold the truth: most errors are within what two degrees of freedom have 99 times in 100. Hypotheses of a
/// first search may still be many, and some bend.
fn assert_honest(errors: &[f64]) {
    assert!(errors.len() > 20, "{}", errors.len());
    let within = errors.iter().filter(|error| **error < chi_square_quantile(0.99, 2)).count();
    assert!(within * 100 >= 93 * errors.len(), "{within} of {}", errors.len());
}

#[test]
fn a_push_from_rest_is_followed_with_mass_and_friction_known_or_not() {
    assert_honest(&errors(31, 8, 0.0, 0, |known| known));
    assert_honest(&errors(32, 10, 0.0, 0, |known| KnownOfFinger { mass: None, mu_c: None, ..known }));
}

#[test]
fn a_finger_whose_own_mass_is_known_poorly_is_followed() {
    fn unsure(known: KnownOfFinger) -> KnownOfFinger {
        KnownOfFinger { effective_mass: 0.025, effective_mass_sd: 0.01, mass: None, ..known }
    }
    assert_honest(&errors(33, 4, 0.0, 0, unsure));
}

#[test]
fn what_is_searched_elsewhere_is_taken_on_to_now() {
    assert_honest(&errors(34, 3, 0.0, 20, |known| known));
}

#[test]
fn a_push_is_followed_from_the_middle_of_it() {
    assert_honest(&errors(35, 8, 0.15, 0, |known| KnownOfFinger { is_moving: true, ..known }));
}

#[test]
fn a_contact_that_is_lost_is_none_and_the_next_one_is_searched_anew() {
    let mut draw = Draw::case(36, 0);
    let drawn = Case::draw(&mut draw);
    let mut readings: Vec<_> = drawn.readings(&mut draw, 0.0).into_iter().step_by(EACH).collect();
    let known = drawn.known(&drawn.part);
    // Nothing but noise from 0.35 to 0.42 s.
    for reading in readings.iter_mut().filter(|reading| (0.35..0.42).contains(&reading.time)) {
        let acceleration = known.motion.acceleration(reading.time);
        reading.force = -acceleration * known.effective_mass + Vector2::new(draw.normal(), draw.normal()) * known.noise;
    }
    let mut states = Vec::new();
    track(&known, &readings, 0, |tracker| {
        let is_new = states.last() != Some(&tracker.state());
        states.extend(is_new.then_some(tracker.state()));
    });
    use TrackerState::{Following, NoContact, Searching};
    assert_eq!(states, [NoContact, Searching, Following, NoContact, Searching, Following]);
}

#[test]
fn a_force_that_no_push_of_the_part_has_leaves_no_hypothesis() {
    let mut draw = Draw::case(37, 0);
    let drawn = Case::draw(&mut draw);
    let mut readings: Vec<_> = drawn.readings(&mut draw, 0.0).into_iter().step_by(EACH).collect();
    let known = drawn.known(&drawn.part);
    // From 0.4 s on something else is pushed: the force turns round as no part does.
    for reading in readings.iter_mut().filter(|reading| reading.time > 0.4) {
        let angle = 20.0 * reading.time;
        reading.force = Vector2::new(angle.cos(), angle.sin()) * 0.8;
    }
    let tracker = track(&known, &readings, 0, |_| ());
    assert_eq!(tracker.state(), TrackerState::Searching);
    assert!(tracker.hypotheses(&known).is_empty());
}
