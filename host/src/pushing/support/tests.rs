//! Laws of support friction, for all kinds of support.

use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;

/// Largest error of means relative to their scale (1, or the part's radius), where results are compared at one centre of
/// rotation. The closed form is allowed to lose two digits at 8 radii.
const ROUNDING: f64 = 2e-13;

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

fn as_vector(twist: &Twist) -> Vector3<f64> {
    Vector3::new(twist.velocity.x, twist.velocity.y, twist.omega)
}

fn from_vector(v: Vector3<f64>) -> Twist {
    Twist::new(v.xy(), v.z)
}

proptest! {
    #[test]
    fn the_series_continues_the_closed_form(polygon in star(), angle in 0.0..6.3_f64, distance in 6.0..8.0_f64) {
        let edges = Edges::new(&polygon, polygon.centroid());
        let centre = distance * edges.radius() * Vector2::new(angle.cos(), angle.sin());
        let twist = Twist::new(-turn_left(centre), 1.0);
        let [near, far] = edges.both_ways(&twist);
        prop_assert!((near.0.direction - far.0.direction).norm() < ROUNDING, "{near:?} {far:?}");
        prop_assert!((near.0.moment - far.0.moment).abs() < ROUNDING * edges.radius(), "{near:?} {far:?}");
        let speed = twist.velocity.norm();
        prop_assert!(((near.1 - far.1) * speed).amax() < 1e-11, "{near:?} {far:?}");
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
}
