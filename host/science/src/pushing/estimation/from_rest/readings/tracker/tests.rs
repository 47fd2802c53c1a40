use nalgebra::{Matrix3, Vector3};

use super::super::tests::Case;
use super::*;
use crate::math::random::Draw;
use crate::search::never;

/// Of all readings of a push one in so many: some 130 a second.
const EACH: usize = 10;

/// What simulations are off by where an exact contact leaves a covariance singular: m, m, rad.
const SLACK: [f64; 3] = [5e-6, 5e-6, 5e-5];

/// Noise of readings that tell a pose poorly, N.
const NOISY_N: f64 = 1.5e-2;

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

/// Of noisy readings a search leaves many pieces, and few that stand for them tell the same pose as surely.
#[test]
fn pieces_that_are_joined_say_what_all_of_them_do() {
    const WIDE: f64 = 10.0;
    let mut were_joined = 0;
    for case in 0..6 {
        let mut draw = Draw::case(31, case);
        let drawn = Case::draw(&mut draw);
        let readings: Vec<_> = drawn.readings(&mut draw, 0.0).into_iter().step_by(EACH).collect();
        let known = KnownOfFinger { noise: NOISY_N, mu_c: None, mass: None, ..drawn.known(&drawn.part) };
        let mut tracker = ForceTracker::new(&known);
        readings.iter().take(readings.len() / 2).for_each(|reading| tracker.take(&known, *reading));
        let Some(task) = tracker.search_now() else { panic!("case {case}: nothing to search") };
        let all = task.run(&known, &never).followed;
        let few = joined(all.clone(), &SAME.map(|near| WIDE * near));
        were_joined += usize::from(few.len() < all.len());
        let [all, few] = [&all, &few].map(|followed| {
            let total: f64 = followed.iter().map(|it| it.log_weight.exp()).sum();
            let weighed = |it: &Followed| Some((it.log_weight.exp() / total, it.motion(&known)?));
            Gaussian::of_mixture(&followed.iter().filter_map(weighed).collect::<Vec<_>>())
        });
        for place in 0..6 {
            let [sd, sd_few] = [all, few].map(|of| of.covariance[(place, place)].sqrt());
            let off = (few.mean[place] - all.mean[place]).abs();
            assert!(
                off < 0.1 * sd && (sd_few / sd - 1.0).abs() < 0.1,
                "case {case}: {place}: {off}, {sd_few} for {sd}"
            );
        }
    }
    assert!(were_joined > 3, "{were_joined}");
}

/// Noisy readings leave open whether a contact slipped a little: that it never did is followed beside it. Of these pushes some
/// never slip, and were once followed as slipping ones only.
#[test]
fn of_noisy_readings_a_contact_that_may_have_slipped_is_followed_as_one_that_never_did_too() {
    // A search takes as long as so many readings.
    const LATE: usize = 10;
    // A long valley that bends is not told well by one Gaussian.
    const BENT_MAX: usize = 1;
    let ends = (24..40).map(|case| {
        let mut draw = Draw::case(77, case);
        let drawn = Case::draw(&mut draw);
        let mut readings: Vec<_> = drawn.readings(&mut draw, 0.0).into_iter().step_by(EACH).collect();
        readings.iter_mut().for_each(|it| it.force += Vector2::new(draw.normal(), draw.normal()) * NOISY_N);
        let known = drawn.known(&drawn.part);
        let known = KnownOfFinger { mass: None, mu_c: None, noise: NOISY_N.hypot(known.noise), ..known };
        let tracker = track(&known, &readings, LATE, |_| {});
        assert_eq!(tracker.state(), TrackerState::Following, "case {case}");
        squared_error(&drawn, &known, &tracker)
    });
    let ends: Vec<_> = ends.collect();
    let beyond = ends.iter().filter(|end| **end > chi_square_quantile(0.9999, 2)).count();
    assert!(beyond <= BENT_MAX, "{ends:?}");
}
