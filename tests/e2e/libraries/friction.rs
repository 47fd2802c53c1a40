//! Support friction against quadrature of its definition, which shares nothing with the closed forms.

use nalgebra::{Point2, Vector2};
use palpate::geometry::SimplePolygon;
use palpate::pushing::dynamics::support::{SupportFriction, Twist};
use palpate_tests::oracle::friction_integrals;

/// What quadrature may leave out of one triangle, m² or m³ in parts of 1 m.
const QUADRATURE: f64 = 1e-12;

/// Largest difference, relative to the area and to area times size: some hundred of [`QUADRATURE`].
const TOLERANCE: f64 = 2e-10;

/// Parts about 1 m across: convex, thin, with notches, with a flat vertex, with their origin outside.
const PARTS: [&[[f64; 2]]; 5] = [
    &[[0.0, 0.0], [1.0, 0.0], [0.4, 0.8]],
    &[[-0.5, -0.02], [0.5, -0.02], [0.5, 0.02], [-0.5, 0.02]],
    &[[0.0, 0.0], [1.0, 0.0], [1.0, 0.3], [0.3, 0.3], [0.3, 1.0], [0.0, 1.0]],
    &[
        [0.6, 0.0],
        [0.2, 0.15],
        [0.2, 0.57],
        [-0.1, 0.25],
        [-0.5, 0.35],
        [-0.25, 0.0],
        [-0.5, -0.35],
        [-0.1, -0.25],
        [0.2, -0.57],
    ],
    &[[2.0, 1.0], [2.5, 1.0], [3.0, 1.0], [3.0, 1.6], [2.2, 1.8]],
];

fn compare(part: &[[f64; 2]], twist: &Twist) {
    let polygon = SimplePolygon::new(part.iter().map(|p| Point2::from(*p)).collect::<Vec<_>>()).unwrap();
    let mean = SupportFriction::uniform(&polygon).mean_sliding(twist);
    let area = polygon.area();
    let [x, y, moment] = friction_integrals(part, twist.velocity.into(), twist.omega, QUADRATURE);
    // The parts lie within 4 m of their origins.
    for (got, wanted, scale) in [(mean.direction.x, x, 1.0), (mean.direction.y, y, 1.0), (mean.moment, moment, 4.0)] {
        let (got, tolerance) = (got * area, TOLERANCE * scale * area.max(0.1));
        assert!(
            (got - wanted).abs() < tolerance,
            "{got} is not {wanted} within {tolerance:e} for {twist:?} of {part:?}"
        );
    }
}

/// The twist about a centre of rotation.
fn about(centre: [f64; 2], omega: f64) -> Twist {
    Twist::new(omega * Vector2::new(centre[1], -centre[0]), omega)
}

#[test]
fn turning_about_points_inside_and_outside_agrees_with_quadrature() {
    for part in PARTS {
        for centre in [[0.1, 0.05], [0.31, 0.29], [0.9, 0.9], [2.6, 1.3], [-1.0, 2.0]] {
            compare(part, &about(centre, 0.8));
            compare(part, &about(centre, -2.0));
        }
    }
}

#[test]
fn turning_about_vertices_and_points_of_edges_agrees_with_quadrature() {
    for part in PARTS {
        for (i, p) in part.iter().enumerate().take(4) {
            let next = part[(i + 1) % part.len()];
            let between = |share: f64| [0, 1].map(|k| p[k] + share * (next[k] - p[k]));
            // The vertex, the middle of the edge, its extension, and a hair's breadth beside it.
            let [x, y] = between(0.5);
            for centre in [*p, between(0.5), between(1.5), [x + 1e-9, y - 1e-9]] {
                compare(part, &about(centre, 1.5));
            }
        }
    }
}

#[test]
fn turning_about_far_points_agrees_with_quadrature() {
    for part in PARTS {
        for distance in [3.0, 4.6, 8.0, 30.0, 1e4, 1e9] {
            compare(part, &about([-0.6 * distance, 0.8 * distance], 1.0 / distance));
        }
        compare(part, &Twist::new(Vector2::new(0.3, -0.1), 0.0));
    }
}
