//! The rule against what Coulomb's law says of a mode by itself: forces and accelerations of one contact, of any
//! inertia.

#![expect(clippy::float_cmp, reason = "mirrored and mapped numbers are the same to the bit")]

use proptest::prelude::*;

use super::*;
use crate::math::Jet;

/// The three modes that Coulomb's law knows.
fn modes(friction: &ContactFriction) -> [ContactMode; 3] {
    [ContactMode::Rolling, friction.slides(Slip::Forward), friction.slides(Slip::Backward)]
}

/// A contact in the symbols of the module.
#[derive(Clone, Copy, Debug)]
struct Point {
    w_nn: f64,
    w_nt: f64,
    w_tt: f64,
    /// Of rolling.
    needed: ContactForce,
    friction: ContactFriction,
}

impl Point {
    /// D.
    fn denominator(&self, slip: Slip) -> f64 {
        self.w_nn - self.friction.sliding * slip.sign() * self.w_nt
    }

    fn jams_neither_way(&self) -> bool {
        [Slip::Forward, Slip::Backward].iter().all(|slip| self.denominator(*slip) > 0.01)
    }

    /// The force that keeps the contact in a mode.
    fn force(&self, mode: &ContactMode) -> ContactForce {
        let ContactMode::Sliding { friction, slip } = *mode else { return self.needed };
        let push = self.w_nn * self.needed.normal + self.w_nt * self.needed.tangential;
        let normal = push / self.denominator(slip);
        ContactForce { normal, tangential: -friction * slip.sign() * normal }
    }

    /// Accelerations of the part's point relative to the finger, away from it and along the edge.
    fn accelerations(&self, force: ContactForce) -> [f64; 2] {
        let (n, t) = (force.normal - self.needed.normal, force.tangential - self.needed.tangential);
        [self.w_nn * n + self.w_nt * t, self.w_nt * n + self.w_tt * t]
    }

    /// How far a mode is from breaking any of Coulomb's conditions, where nothing slips yet; below 0 it does.
    fn consistency(&self, mode: &ContactMode) -> f64 {
        let force = self.force(mode);
        let [apart, along] = self.accelerations(force);
        assert!(apart.abs() < 1e-9, "the contact is kept, {apart:e}");
        let condition = match *mode {
            ContactMode::Sliding { friction, slip } => {
                assert!((force.tangential.abs() - friction * force.normal.abs()).abs() < 1e-9);
                assert!(force.normal < 0.0 || force.tangential * slip.sign() <= 0.0, "friction opposes slip");
                along * slip.sign()
            }
            _ => self.friction.sticking * force.normal - force.tangential.abs(),
        };
        condition.min(force.normal)
    }

    /// How fast the part leaves a finger that does not push it.
    fn parting(&self) -> f64 {
        self.accelerations(ContactForce { normal: 0.0, tangential: 0.0 })[0]
    }

    fn mirrored(&self) -> Self {
        let ContactForce { normal, tangential } = self.needed;
        Self { w_nt: -self.w_nt, needed: ContactForce { normal, tangential: -tangential }, ..*self }
    }
}

fn mirrored(mode: &ContactMode) -> ContactMode {
    match *mode {
        ContactMode::Sliding { friction, slip } => ContactMode::Sliding { friction, slip: slip.reversed() },
        other => other,
    }
}

prop_compose! {
    fn points()(
        (w_nn, w_tt) in (0.5..4.0, 0.5..4.0),
        coupling in -0.95..0.95,
        (normal, tangential) in (-5.0..10.0, -10.0..10.0),
        (sliding, extra) in (0.0..1.5, prop_oneof![Just(0.0), 0.0..0.5]),
    ) -> Point {
        let friction = ContactFriction { sliding, sticking: sliding + extra };
        let w_nt = coupling * f64::sqrt(w_nn * w_tt);
        Point { w_nn, w_nt, w_tt, needed: ContactForce { normal, tangential }, friction }
    }
}

/// Contacts that have a force whichever way they slide.
fn sound() -> impl Strategy<Value = Point> {
    points().prop_filter("jams", Point::jams_neither_way)
}

/// Conditions that miss by less may be met or not, m/s²: rounding.
const ROUNDING: f64 = 1e-9;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn what_follows_meets_every_condition_or_the_contact_breaks(point in sound()) {
        let mode = point.friction.without_slip(&point.needed);
        if point.force(&mode).pushes() {
            prop_assert!(point.consistency(&mode) > -ROUNDING, "{mode:?} misses by {:e}", point.consistency(&mode));
        } else {
            prop_assert!(point.parting() > -ROUNDING, "breaks, but presses at {:e} m/s²", point.parting());
        }
    }

    /// With one coefficient; with a higher one for sticking, whatever sticks could slide, and the rule says that it
    /// sticks.
    #[test]
    fn nothing_else_could_follow(point in sound()) {
        let friction = ContactFriction::same(point.friction.sliding);
        let point = Point { friction, ..point };
        let follows = friction.without_slip(&point.needed);
        for mode in modes(&friction).into_iter().filter(|mode| *mode != follows) {
            prop_assert!(point.consistency(&mode) < ROUNDING, "{mode:?} could follow as well as {follows:?}");
        }
    }

    #[test]
    fn a_slip_that_friction_has_stopped_is_like_none(point in sound()) {
        for slip in [Slip::Forward, Slip::Backward] {
            let sliding = point.friction.slides(slip);
            let growing = point.accelerations(point.force(&sliding))[1] * slip.sign();
            if point.force(&sliding).pushes() && growing < -ROUNDING {
                let without = point.friction.without_slip(&point.needed);
                prop_assert_eq!(point.friction.after(&sliding, &point.needed), without);
            }
        }
    }

    #[test]
    fn a_mirror_image_does_the_mirror_image(point in points()) {
        let (friction, image) = (point.friction, point.mirrored());
        let follows = friction.without_slip(&point.needed);
        prop_assert_eq!(friction.without_slip(&image.needed), mirrored(&follows));
        for mode in modes(&friction) {
            let (after, of_image) = (friction.after(&mode, &point.needed), friction.after(&mirrored(&mode), &image.needed));
            prop_assert_eq!(of_image, mirrored(&after));
            prop_assert_eq!(friction.left(&mode, || 0.1, || point.needed), friction.left(&mirrored(&mode), || -0.1, || image.needed));
        }
    }

    #[test]
    fn a_mode_lasts_as_long_as_it_would_follow(point in points(), slip in -0.1..0.1) {
        let friction = point.friction;
        let rolls = friction.left(&ContactMode::Rolling, || slip, || point.needed) >= 0.0;
        prop_assert_eq!(rolls, friction.without_slip(&point.needed) == ContactMode::Rolling);
        let [counter_clockwise, clockwise] = friction.unused_each_way(&point.needed);
        prop_assert_eq!(friction.unused(&point.needed), counter_clockwise.min(clockwise));
        for direction in [Slip::Forward, Slip::Backward] {
            let sliding = friction.slides(direction);
            let lasts = friction.left(&sliding, || slip, || point.needed) >= 0.0;
            prop_assert_eq!(lasts, friction.at_slip(slip, || point.needed) == sliding);
        }
    }

    /// What rolled slides, and against what it would have needed, however near to the edge of the cone rounding puts
    /// it.
    #[test]
    fn rolling_that_has_used_up_its_friction_slides_against_the_force(point in points()) {
        let after = point.friction.after(&ContactMode::Rolling, &point.needed);
        let ContactMode::Sliding { friction, slip } = after else { return Err(TestCaseError::fail("rolls on")) };
        prop_assert_eq!(friction, point.friction.sliding);
        prop_assert!(slip.sign() * point.needed.tangential <= 0.0);
    }

    #[test]
    fn between_the_two_coefficients_what_rests_sticks_and_what_slides_goes_on(
        (sliding, extra, share) in (0.0..1.5, 0.01..0.5, 0.01..0.99),
        normal in 0.1..10.0,
    ) {
        let friction = ContactFriction { sliding, sticking: sliding + extra };
        let needed = ContactForce { normal, tangential: (sliding + share * extra) * normal };
        prop_assert_eq!(friction.without_slip(&needed), ContactMode::Rolling);
        prop_assert_eq!(friction.at_slip(0.01, || needed), friction.slides(Slip::Forward));
        prop_assert_eq!(friction.after(&friction.slides(Slip::Backward), &needed), ContactMode::Rolling);
    }

    #[test]
    fn derivatives_have_no_say(point in points(), slopes in prop::array::uniform2(-1e3..1e3), slip in -0.1..0.1) {
        let jet = |value: f64| Jet { value, slopes };
        let ContactFriction { sliding, sticking } = point.friction;
        let friction = ContactFriction { sliding: jet(sliding), sticking: jet(sticking) };
        let needed = ContactForce { normal: jet(point.needed.normal), tangential: jet(point.needed.tangential) };
        let plain = |mode: ContactMode<Jet<2>>| match mode {
            ContactMode::Sliding { friction, slip } => ContactMode::Sliding { friction: friction.value, slip },
            ContactMode::Rolling => ContactMode::Rolling,
            ContactMode::Frictionless => ContactMode::Frictionless,
        };
        prop_assert_eq!(plain(friction.without_slip(&needed)), point.friction.without_slip(&point.needed));
        prop_assert_eq!(plain(friction.at_slip(slip, || needed)), point.friction.at_slip(slip, || point.needed));
        prop_assert_eq!(friction.unused(&needed).value, point.friction.unused(&point.needed));
        for direction in [Slip::Forward, Slip::Backward] {
            let (carried, bare) = (friction.slides(direction), point.friction.slides(direction));
            prop_assert_eq!(plain(friction.after(&carried, &needed)), point.friction.after(&bare, &point.needed));
        }
    }

    #[test]
    fn endless_friction_never_slips_while_it_is_pushed(point in points()) {
        let friction = ContactFriction::same(f64::INFINITY);
        let sticks = friction.without_slip(&point.needed) == ContactMode::Rolling;
        prop_assert_eq!(sticks, point.needed.pushes());
    }
}

/// Rolling would have to pull here; sliding pushes.
#[test]
fn a_contact_that_rolling_would_have_to_pull_can_slide() {
    let friction = ContactFriction::same(0.2);
    let needed = ContactForce { normal: -1.0, tangential: 4.0 };
    let point = Point { w_nn: 1.0, w_nt: 0.8, w_tt: 1.0, needed, friction };
    let follows = friction.without_slip(&needed);
    assert_eq!(follows, friction.slides(Slip::Backward));
    assert!(point.force(&follows).pushes() && point.consistency(&follows) > 0.1, "{:?}", point.force(&follows));
}

#[test]
fn a_contact_jams_where_the_denominator_is_used_up() {
    assert!(jams(0.0) && jams(-1.0) && jams(JAM_DENOMINATOR));
    assert!(!jams(1e-8));
}
