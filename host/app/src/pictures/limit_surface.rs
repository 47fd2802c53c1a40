//! The picture of a part's limit surface: all friction that the table can meet its motion with, and what a push made of
//! it.
//!
//! The surface is convex in (force x, force y, moment); seen along one of the forces it shows its outline, which is the
//! friction of motions without velocity in that direction. Beside it the ellipsoid that is often put in its place.
//!
//! Pure. Frames: the part's axes, moments about the centre of mass. Units: shares of µ·m·g, and mm for moments.

use std::f64::consts::TAU;

use nalgebra::{Rotation2, Vector2};
use palpate::pushing::dynamics::support::{EllipsoidalLimitSurface, MeanSliding, SupportFriction, Twist};
use palpate::pushing::dynamics::{Body, Sample};

use crate::pictures::plot::{Chart, Colour, Dash, Figure, Stroke};

/// Points of an outline.
const POINTS: u32 = 360;

/// Size of the page.
const PAGE: [f64; 2] = [1120.0, 560.0];

/// An axis of force, part axes.
#[derive(Clone, Copy)]
enum Axis {
    X,
    Y,
}

/// Draws the limit surface of a body's support and, on it, the friction during a push.
#[must_use]
pub fn figure(title: &str, body: &Body, push: &[Sample]) -> Figure {
    let chart = |axis| chart(axis, body, push);
    Figure::new(title, PAGE[0], PAGE[1])
        .subtitle(
            "friction on the table per µ·m·g, reversed: force in the part's axes, moment about the centre of mass",
        )
        .panel(chart(Axis::X))
        .panel(chart(Axis::Y))
}

fn chart(axis: Axis, body: &Body, push: &[Sample]) -> Chart {
    let (title, label) = match axis {
        Axis::X => ("Seen along y", "force along x / (µ m g)"),
        Axis::Y => ("Seen along x", "force along y / (µ m g)"),
    };
    let support = body.support();
    let ellipsoid = EllipsoidalLimitSurface::of(&support);
    let length = ellipsoid.moment_max.max(f64::MIN_POSITIVE);
    let mut chart = Chart::new(title, [label, "moment / (µ m g) [mm]"]);
    let near: Vec<_> = outline(axis, length).map(|twist| point(axis, &ellipsoid.mean_sliding(&twist))).collect();
    chart.curve("ellipsoid", &near, Stroke::solid(Colour::GREY, 1.4).with(Dash::Dashed));
    let exact: Vec<_> = outline(axis, length).map(|twist| point(axis, &support.mean_sliding(&twist))).collect();
    chart.curve("limit surface", &exact, Stroke::solid(Colour::BLUE, 1.8));
    let path: Vec<_> = push.iter().filter_map(|sample| friction(&support, sample)).map(|s| point(axis, &s)).collect();
    if let Some(start) = path.first() {
        chart.curve("this push", &path, Stroke::solid(Colour::VERMILLION, 1.8));
        chart.dots("its start", &[*start], Colour::VERMILLION);
    }
    chart
}

/// Motions whose friction is the surface's outline; `length` (m) weighs turning against translation.
fn outline(axis: Axis, length: f64) -> impl Iterator<Item = Twist> {
    (0..=POINTS).map(move |i| {
        let (sin, cos) = (TAU * f64::from(i) / f64::from(POINTS)).sin_cos();
        let along = match axis {
            Axis::X => Vector2::x(),
            Axis::Y => Vector2::y(),
        };
        Twist::new(along * cos, sin / length)
    })
}

fn point(axis: Axis, sliding: &MeanSliding) -> [f64; 2] {
    let force = match axis {
        Axis::X => sliding.direction.x,
        Axis::Y => sliding.direction.y,
    };
    [force, sliding.moment * 1e3]
}

/// Friction at one instant; none at rest.
fn friction(support: &SupportFriction, sample: &Sample) -> Option<MeanSliding> {
    let velocity = Rotation2::new(-sample.theta) * sample.velocity;
    let moves = velocity.norm() > 0.0 || sample.state.omega != 0.0;
    moves.then(|| support.mean_sliding(&Twist::new(velocity, sample.state.omega)))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point2;
    use palpate::pushing::dynamics::Mass;

    use super::*;

    /// Rounding of sums of a few terms.
    const ROUNDING: f64 = 1e-12;

    #[test]
    fn the_outline_encloses_all_friction() {
        let body = Body::ellipse([0.04, 0.02]);
        let support = body.support();
        for (other, sliding) in support.limit_surface(0.02, 12) {
            for twist in outline(Axis::Y, 0.02) {
                let most = support.mean_sliding(&twist).mean_speed(&twist);
                assert!(sliding.mean_speed(&twist) <= most + ROUNDING, "{other:?} {twist:?}");
            }
        }
    }

    #[test]
    fn feet_are_drawn_too() {
        let feet = [(Point2::new(0.03, 0.0), 0.5), (Point2::new(-0.03, 0.0), 0.5)];
        let mass = Mass { centre_of_mass: Point2::origin(), inertia_per_mass: 1e-3 };
        let svg = figure("two feet", &Body::on_feet(&feet, mass), &[]).to_page().to_svg();
        assert!(svg.contains("limit surface") && svg.contains("ellipsoid") && !svg.contains("this push"));
    }
}
