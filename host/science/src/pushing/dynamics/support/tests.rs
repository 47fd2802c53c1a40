//! Laws of support friction, for all kinds of support.

use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;

/// Largest error of means relative to their scale (1, or the part's radius), where results are compared at one centre
/// of rotation. The closed form is allowed to lose two digits at 8 radii.
const ROUNDING: f64 = 2e-13;

/// The same for gradients: that of the moment by the turning has the distance in it twice more.
const ROUNDING_OF_GRADIENT: f64 = 2e-11;

/// Star-shaped about a point inside, some cm across, convex or not, with its centroid anywhere within 10 cm.
pub(super) fn star() -> impl Strategy<Value = SimplePolygon> {
    let corners = (3_u32..12).prop_flat_map(|n| {
        proptest::collection::vec((0.01..0.05_f64, -0.3..0.3_f64), n as usize).prop_map(move |corners| {
            let step = std::f64::consts::TAU / f64::from(n);
            let at = |(i, (radius, jitter)): (u32, (f64, f64))| {
                let angle = step * (f64::from(i) + jitter);
                Vector2::new(radius * angle.cos(), radius * angle.sin())
            };
            (0..n).zip(corners).map(at).collect::<Vec<_>>()
        })
    });
    (corners, -0.1..0.1_f64, -0.1..0.1_f64).prop_filter_map("too thin", |(corners, x, y)| {
        let shift = Vector2::new(x, y);
        SimplePolygon::new(corners.into_iter().map(|p| Point2::from(p + shift)).collect::<Vec<_>>()).ok()
    })
}

/// Twists with their centre of rotation from the part's middle to infinitely far away.
pub(super) fn twist() -> impl Strategy<Value = Twist> {
    let speed = prop_oneof![Just(0.0), 1e-4..1.0_f64];
    let omega = prop_oneof![
        4 => -3.0..3.0_f64,
        2 => (-12.0..1.0_f64, any::<bool>()).prop_map(|(e, left)| 10_f64.powf(e) * if left { 1.0 } else { -1.0 }),
        1 => Just(0.0),
    ];
    (speed, 0.0..std::f64::consts::TAU, omega)
        .prop_map(|(v, angle, omega)| Twist::new(Vector2::new(v * angle.cos(), v * angle.sin()), omega))
        .prop_filter("moves", |twist| twist.velocity.norm() > 0.0 || twist.omega != 0.0)
}

/// Largest difference of means that are mathematically equal but computed from inputs that were rounded differently,
/// relative to 1 or the part's size: the lever of 0.2 m on parts of 1 cm costs a digit or two more.
const ROUNDED_INPUTS: f64 = 2e-12;

/// Length by which moments are compared, m: the farthest that a part here lies from its origin.
const REACH: f64 = 0.2;

fn assert_same(got: &MeanSliding, wanted: &MeanSliding) {
    let (direction, moment) = (got.direction - wanted.direction, got.moment - wanted.moment);
    assert!(direction.norm() < ROUNDED_INPUTS && moment.abs() < ROUNDED_INPUTS * REACH, "{got:?} is not {wanted:?}");
}

/// The polygon moved point by point.
fn moved(polygon: &SimplePolygon, change: impl Fn(&Point2<f64>) -> Point2<f64>) -> SimplePolygon {
    SimplePolygon::new(polygon.vertices().iter().map(change).collect::<Vec<_>>()).unwrap()
}

fn feet() -> impl Strategy<Value = SupportFriction> {
    proptest::collection::vec((-0.1..0.1_f64, -0.1..0.1_f64, 0.0..0.5_f64), 1..6).prop_map(|feet| {
        SupportFriction::feet(&feet.iter().map(|&(x, y, share)| (Point2::new(x, y), share)).collect::<Vec<_>>())
    })
}

/// Any kind of support.
fn support() -> impl Strategy<Value = SupportFriction> {
    let ellipse = (0.01..0.05_f64, 0.01..0.05_f64, -0.05..0.05_f64)
        .prop_map(|(a, b, x)| SupportFriction::ellipse([a, b]).with_origin(Point2::new(x, -x)));
    prop_oneof![4 => star().prop_map(|polygon| SupportFriction::uniform(&polygon)), 1 => feet(), 1 => ellipse]
}

fn as_vector(twist: &Twist) -> Vector3<f64> {
    Vector3::new(twist.velocity.x, twist.velocity.y, twist.omega)
}

fn from_vector(v: Vector3<f64>) -> Twist {
    Twist::new(v.xy(), v.z)
}

proptest! {
    #[test]
    fn the_series_continues_the_closed_form(polygon in star(), angle in 0.0..6.3_f64, distance in 6.0..8.0_f64) {
        let shape = Uniform::polygon(&polygon, polygon.centroid());
        let centre = distance * shape.radius() * Vector2::new(angle.cos(), angle.sin());
        let twist = Twist::new(-turn_left(centre), 1.0);
        let [near, far] = shape.both_ways(&twist).map(|(sliding, gradient)| (sliding, gradient.matrix()));
        prop_assert!((near.0.direction - far.0.direction).norm() < ROUNDING, "{near:?} {far:?}");
        prop_assert!((near.0.moment - far.0.moment).abs() < ROUNDING * shape.radius(), "{near:?} {far:?}");
        // In units in which the part's radius and the speed are 1.
        let scale = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 1.0 / shape.radius()));
        let difference = scale * (near.1 - far.1) * scale * twist.velocity.norm();
        prop_assert!(difference.amax() < ROUNDING_OF_GRADIENT, "{difference} {near:?} {far:?}");
    }

    #[test]
    fn the_gradient_is_that_of_finite_differences(polygon in star(), twist in twist()) {
        let support = SupportFriction::uniform(&polygon);
        let (sliding, gradient) = support.mean_sliding_and_gradient(&twist);
        prop_assert_eq!(sliding, support.mean_sliding(&twist));
        let size = twist.velocity.norm().max(0.02 * twist.omega.abs());
        for (axis, unit) in [(0, 1.0), (1, 1.0), (2, 50.0)] {
            let mut step = Vector3::zeros();
            step[axis] = 1e-5 * size * unit;
            let at = |sign: f64| support.mean_sliding(&from_vector(as_vector(&twist) + sign * step));
            let (plus, minus) = (at(1.0), at(-1.0));
            let difference = Vector3::new(
                plus.direction.x - minus.direction.x,
                plus.direction.y - minus.direction.y,
                plus.moment - minus.moment,
            ) / (2.0 * step[axis]);
            let column = gradient.column(axis);
            prop_assert!((difference - column).amax() < 1e-4 * unit / size, "{difference} {column}");
        }
    }

    #[test]
    fn the_gradient_is_symmetric_dissipates_and_takes_the_twist_to_zero(support in support(), twist in twist()) {
        let (_, gradient) = support.mean_sliding_and_gradient(&twist);
        let scale = Vector3::new(1.0, 1.0, 1.0 / REACH);
        // In units in which turning moves the part's far end by 1.
        let size = twist.velocity.norm() + REACH * twist.omega.abs();
        let plain = Matrix3::from_diagonal(&scale) * gradient * Matrix3::from_diagonal(&scale) * size;
        let largest = plain.amax().max(1.0);
        prop_assert!((plain - plain.transpose()).amax() < 1e-12 * largest, "{plain}");
        prop_assert!(plain.symmetric_eigenvalues().min() > -1e-11 * largest, "{plain}");
        let along = plain * Vector3::new(twist.velocity.x, twist.velocity.y, twist.omega * REACH) / size;
        prop_assert!(along.amax() < 1e-11 * largest, "{along}");
    }

    #[test]
    fn friction_dissipates_most_against_its_own_motion(support in support(), twist in twist(), other in twist()) {
        let (own, others) = (support.mean_sliding(&twist), support.mean_sliding(&other));
        let power = own.mean_speed(&twist);
        let fastest = twist.velocity.norm() + REACH * twist.omega.abs();
        prop_assert!(power >= -ROUNDED_INPUTS * fastest);
        prop_assert!(others.mean_speed(&twist) <= power + ROUNDED_INPUTS * fastest);
    }

    #[test]
    fn only_the_direction_of_the_twist_counts(support in support(), twist in twist(), factor in -40..40_i32) {
        let factor = f64::from(factor).exp2();
        let scaled = from_vector(factor * as_vector(&twist));
        prop_assert_eq!(support.mean_sliding(&scaled), support.mean_sliding(&twist));
        let backwards = support.mean_sliding(&from_vector(-as_vector(&twist)));
        let forwards = support.mean_sliding(&twist);
        assert_same(&backwards, &MeanSliding { direction: -forwards.direction, moment: -forwards.moment });
        let (_, gradient) = support.mean_sliding_and_gradient(&twist);
        prop_assert_eq!(support.mean_sliding_and_gradient(&scaled).1 * factor, gradient);
    }

    #[test]
    fn many_twists_at_once_slide_as_one_by_one(support in support(), twists in proptest::collection::vec(twist(), 0..11)) {
        let together = support.mean_slidings(&twists);
        prop_assert_eq!(together.len(), twists.len());
        for (twist, together) in twists.iter().zip(together) {
            assert_same(&together, &support.mean_sliding(twist));
        }
    }

    #[test]
    fn turning_everything_turns_the_friction(polygon in star(), twist in twist(), angle in -4.0..4.0_f64) {
        let turn = nalgebra::Rotation2::new(angle);
        let turned = SupportFriction::uniform(&moved(&polygon, |p| turn * p));
        let got = turned.mean_sliding(&Twist::new(turn * twist.velocity, twist.omega));
        let before = SupportFriction::uniform(&polygon).mean_sliding(&twist);
        assert_same(&got, &MeanSliding { direction: turn * before.direction, ..before });
    }

    #[test]
    fn a_mirror_image_slides_as_one(polygon in star(), twist in twist()) {
        let flip = |v: Vector2<f64>| Vector2::new(v.x, -v.y);
        let mirrored: Vec<_> = polygon.vertices().iter().rev().map(|p| Point2::from(flip(p.coords))).collect();
        let mirrored = SupportFriction::uniform(&SimplePolygon::new(mirrored).unwrap());
        let got = mirrored.mean_sliding(&Twist::new(flip(twist.velocity), -twist.omega));
        let before = SupportFriction::uniform(&polygon).mean_sliding(&twist);
        assert_same(&got, &MeanSliding { direction: flip(before.direction), moment: -before.moment });
    }

    #[test]
    fn moving_the_origin_moves_only_the_moment(polygon in star(), twist in twist(), x in -0.05..0.05_f64, y in -0.05..0.05_f64) {
        let (origin, support) = (Point2::new(x, y), SupportFriction::uniform(&polygon));
        let there = twist.seen_from(origin.coords);
        let got = support.clone().with_origin(origin).mean_sliding(&there);
        assert_same(&got, &SupportFriction::uniform(&moved(&polygon, |p| p - origin.coords)).mean_sliding(&there));
        let before = support.mean_sliding(&twist);
        assert_same(&got, &MeanSliding { moment: before.moment - origin.coords.perp(&before.direction), ..before });
    }

    #[test]
    fn a_part_twice_as_large_has_twice_the_lever(polygon in star(), twist in twist(), power in -20..20_i32) {
        let scale = f64::from(power).exp2();
        let large = SupportFriction::uniform(&moved(&polygon, |p| scale * p));
        let got = large.mean_sliding(&Twist::new(twist.velocity, twist.omega / scale));
        let before = SupportFriction::uniform(&polygon).mean_sliding(&twist);
        assert_same(&MeanSliding { moment: got.moment / scale, ..got }, &before);
    }

    #[test]
    fn the_halves_of_a_part_make_the_whole(a in 0.01..0.05_f64, b in 0.01..0.05_f64, cut in -0.9..0.9_f64, twist in twist()) {
        let part = |points: &[[f64; 2]]| SimplePolygon::new(points.iter().map(|p| Point2::from(*p)).collect::<Vec<_>>()).unwrap();
        let whole = part(&[[-a, -b], [a, -b], [a, b], [-a, b]]);
        let (low, high) = (cut * a, -0.5 * cut * a);
        let halves = [part(&[[-a, -b], [low, -b], [high, b], [-a, b]]), part(&[[low, -b], [a, -b], [a, b], [high, b]])];
        let mut sum = MeanSliding::NONE;
        for half in &halves {
            let (share, sliding) = (half.area() / whole.area(), SupportFriction::uniform(half).mean_sliding(&twist));
            sum.direction += share * sliding.direction;
            sum.moment += share * sliding.moment;
        }
        assert_same(&SupportFriction::uniform(&whole).mean_sliding(&twist), &sum);
    }

    /// A polygon with the ellipse's area at `n` corners misses it by some 1/n² of it.
    #[test]
    fn an_ellipse_is_the_limit_of_polygons(a in 0.01..0.05_f64, b in 0.01..0.05_f64, twist in twist()) {
        let corner = |i: u32| {
            let (sin, cos) = (std::f64::consts::TAU * f64::from(i) / 1000.0).sin_cos();
            Point2::new(a * cos, b * sin)
        };
        let polygon = SimplePolygon::new((0..1000).map(corner).collect::<Vec<_>>()).unwrap();
        let (got, wanted) = (SupportFriction::ellipse([a, b]).mean_sliding(&twist), SupportFriction::uniform(&polygon).mean_sliding(&twist));
        prop_assert!((got.direction - wanted.direction).norm() < 2e-5, "{got:?} {wanted:?}");
        prop_assert!((got.moment - wanted.moment).abs() < 2e-5 * a.max(b), "{got:?} {wanted:?}");
    }

    #[test]
    fn the_limit_surface_has_its_twist_as_normal(support in support(), steps in 3..6_usize) {
        for (twist, point) in support.limit_surface(0.03, steps) {
            for (_, other) in support.limit_surface(0.03, steps) {
                prop_assert!(other.mean_speed(&twist) <= point.mean_speed(&twist) + 1e-12);
            }
        }
    }

    #[test]
    fn the_ellipsoid_is_exact_for_translation_and_for_turning_on_the_spot(support in support(), angle in 0.0..6.3_f64) {
        let ellipsoid = EllipsoidalLimitSurface::of(&support);
        let slide = Twist::new(Vector2::new(angle.cos(), angle.sin()), 0.0);
        let turn = Twist::new(Vector2::zeros(), -0.4).seen_from(-ellipsoid.centre_of_pressure.coords);
        assert_same(&ellipsoid.mean_sliding(&slide), &support.mean_sliding(&slide));
        let (got, wanted) = (ellipsoid.mean_sliding(&turn), support.mean_sliding(&turn));
        let lever = ellipsoid.centre_of_pressure.coords;
        let moments = [got, wanted].map(|sliding| sliding.moment - lever.perp(&sliding.direction));
        prop_assert!((moments[0] - moments[1]).abs() < ROUNDED_INPUTS * REACH, "{got:?} {wanted:?}");
    }
}

/// A disk that turns on the spot resists with two thirds of its radius.
#[test]
fn a_disk_has_its_closed_form() {
    let disk = SupportFriction::ellipse([0.03, 0.03]);
    let (spin, gradient) = disk.mean_sliding_and_gradient(&Twist::new(Vector2::zeros(), 2.0));
    assert!(spin.direction.norm() < 1e-15 && (spin.moment - 0.02).abs() < 1e-16, "{spin:?}");
    // About the centre the mean of 1/r is 2/R, half of it for each direction of velocity: 1/(ωR).
    assert!((gradient.m11 * 0.06 - 1.0).abs() < 1e-13 && (gradient.m22 * 0.06 - 1.0).abs() < 1e-13, "{gradient}");
    // About a point of its rim: ∫ r dA = 32/9 R³, its mean 32/(9π) R; halving panels has to find that kink.
    let about_rim = disk.mean_sliding(&Twist::new(Vector2::new(0.0, 0.03), -1.0));
    let speed = about_rim.mean_speed(&Twist::new(Vector2::new(0.0, 0.03), -1.0));
    assert!((speed / 0.03 - 32.0 / (9.0 * std::f64::consts::PI)).abs() < 1e-13, "{speed}");
    assert!((disk.area().unwrap() / (std::f64::consts::PI * 9e-4) - 1.0).abs() < 1e-14);
}

/// The stated error of thin ellipses: against panels of a curve that runs evenly along its outline instead.
#[test]
fn a_thin_ellipse_keeps_its_digits() {
    let thin = SupportFriction::ellipse([0.05, 0.001]);
    let shifted = SupportFriction::smooth(|t| {
        // The same ellipse, started elsewhere and run through unevenly.
        let angle = std::f64::consts::TAU * t + 0.3 * (std::f64::consts::TAU * t).sin() + 0.1;
        let speed = std::f64::consts::TAU * (1.0 + 0.3 * (std::f64::consts::TAU * t).cos());
        let (sin, cos) = angle.sin_cos();
        (Point2::new(0.05 * cos, 0.001 * sin), speed * Vector2::new(-0.05 * sin, 0.001 * cos))
    });
    for (x, y) in [(0.0, 0.0), (0.05, 0.0), (0.03, 0.0008), (0.049, 1e-9), (0.0, 0.3), (0.06, -0.01), (1e6, 1e6)] {
        let twist = Twist::new(Vector2::new(y, -x), 1.0);
        let ((a, da), (b, db)) = (thin.mean_sliding_and_gradient(&twist), shifted.mean_sliding_and_gradient(&twist));
        assert!(
            (a.direction - b.direction).norm() < 1e-12 && (a.moment - b.moment).abs() < 1e-12 * 0.05,
            "{a:?} {b:?}"
        );
        assert!((da - db).amax() <= 1e-10 * da.amax(), "{da} {db}");
    }
}

#[test]
fn a_foot_at_rest_has_no_friction() {
    let support = SupportFriction::feet(&[(Point2::new(0.02, 0.0), 0.25), (Point2::new(-0.02, 0.0), 0.75)]);
    let about_the_first = Twist::new(Vector2::new(0.0, -0.02), 1.0);
    let (sliding, gradient) = support.mean_sliding_and_gradient(&about_the_first);
    assert_eq!(sliding, MeanSliding { direction: Vector2::new(0.0, -0.75), moment: 0.015 });
    assert!(gradient.iter().all(|x| x.is_finite()));
    assert!((support.centre_of_pressure() - Point2::new(-0.01, 0.0)).norm() < 1e-17);
}

#[test]
fn a_twist_that_is_no_number_gives_none() {
    for support in [SupportFriction::uniform(&block()), SupportFriction::ellipse([0.02, 0.01])] {
        let twist = Twist::new(Vector2::new(f64::NAN, 0.0), 0.5);
        assert!(support.mean_sliding(&twist).moment.is_nan());
        assert!(support.mean_sliding_and_gradient(&twist).1.m33.is_nan());
    }
}

#[test]
fn no_motion_has_no_friction() {
    let rest = Twist::new(Vector2::zeros(), 0.0);
    let block = SupportFriction::uniform(&block());
    for support in [block, SupportFriction::ellipse([0.1, 0.2]), SupportFriction::feet(&[(Point2::origin(), 1.0)])] {
        assert_eq!(support.mean_sliding_and_gradient(&rest), (MeanSliding::NONE, Matrix3::zeros()));
    }
}

fn block() -> SimplePolygon {
    SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from)).unwrap()
}

/// From turning about a point 8 radii away to pure translation, friction changes as its gradient says, with no step
/// anywhere.
#[test]
fn translation_is_the_limit_of_turning_ever_less() {
    let support = SupportFriction::uniform(&block());
    let velocity = Vector2::new(0.05, 0.02);
    let (translation, gradient) = support.mean_sliding_and_gradient(&Twist::new(velocity, 0.0));
    assert!((translation.direction - velocity.normalize()).norm() < 1e-15 && translation.moment.abs() < 1e-17);
    for exponent in 4..40 {
        let omega = 0.1_f64.powi(exponent);
        let got = support.mean_sliding(&Twist::new(velocity, omega));
        let change = gradient.column(2) * omega;
        // What is left is of second order in the angle ω R/v.
        let second_order = (omega * 0.036 / velocity.norm()).powi(2);
        assert!(
            (got.direction - translation.direction - change.xy()).norm() < second_order + 1e-15,
            "{omega:e}: {got:?}"
        );
        assert!((got.moment - change.z).abs() < 0.036 * (second_order + 1e-15), "{omega:e}: {got:?}");
    }
}
