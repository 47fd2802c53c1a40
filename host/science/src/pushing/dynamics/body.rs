//! What slides: a mass and what it rests on, whatever its outline.
//!
//! Assumes: the pressure on the plane does not change (thesis §8.2.2 leaves centre of mass and pressure free).
//! Frames: `body`: the part's axes, origin at the centre of mass; `part` where named. Units: SI, per unit mass where
//! named so.
//! Errors: none.

use nalgebra::{Point2, Vector2};

use super::scalar::Scalar;
use super::support::SupportFriction;
use crate::geometry::SimplePolygon;

/// A mass on a plane with its support.
#[derive(Clone, Debug)]
pub struct Body {
    /// About the centre of mass.
    support: Support,
    mass: Mass,
}

/// What a part rests on, about its centre of mass.
#[derive(Clone, Debug)]
enum Support {
    Uniform(SupportFriction),
    Feet(Vec<Foot>),
}

#[derive(Clone, Copy, Debug)]
struct Foot {
    at: Vector2<f64>,
    share: f64,
}

/// Speed of a foot below which it counts as creeping, m/s.
///
/// Friction holds a foot at rest with any force up to its limit; here it does so by a creep below this speed, under a
/// micrometre a second. Less creep makes the motion stiffer in proportion: a held foot with a third of the weight
/// already needs a step each microsecond.
pub const FOOT_AT_REST: f64 = 1e-6;

/// Mean direction of sliding and its moment, over the feet.
fn feet_sliding<T: Scalar>(feet: &[Foot], [x, y, omega]: [T; 3]) -> [T; 3] {
    let mut sum = [T::from(0.0); 3];
    for Foot { at, share } in feet {
        let velocity = [x - omega * at.y, y + omega * at.x];
        let squared = velocity[0] * velocity[0] + velocity[1] * velocity[1];
        let creeps = squared.re() < FOOT_AT_REST * FOOT_AT_REST;
        let speed = if creeps { T::from(FOOT_AT_REST) } else { squared.sqrt() };
        let direction = velocity.map(|component| component / speed * *share);
        sum = [sum[0] + direction[0], sum[1] + direction[1], sum[2] + direction[1] * at.x - direction[0] * at.y];
    }
    sum
}

/// Where a part's mass is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mass {
    /// Centre of mass, part frame, m.
    pub centre_of_mass: Point2<f64>,
    /// Moment of inertia about the centre of mass over the mass (the radius of gyration squared), m².
    pub inertia_per_mass: f64,
}

impl Mass {
    /// That of an elliptic plate of uniform density about its middle; semi-axes in m.
    #[must_use]
    pub fn of_ellipse([a, b]: [f64; 2]) -> Self {
        Self { centre_of_mass: Point2::origin(), inertia_per_mass: (a * a + b * b) / 4.0 }
    }

    /// That of a plate of uniform density.
    #[must_use]
    pub fn uniform(polygon: &SimplePolygon) -> Self {
        // Measured from a vertex, so that a polygon far from the origin loses no digits.
        let corner = polygon.vertices()[0];
        let edges = || polygon.edges().map(|(a, b)| (a - corner, b - corner));
        let doubled_area: f64 = edges().map(|(a, b)| a.perp(&b)).sum();
        let from_corner = edges().map(|(a, b)| (a + b) * a.perp(&b)).sum::<Vector2<f64>>() / (3.0 * doubled_area);
        let second_moment = |(a, b): (Vector2<f64>, Vector2<f64>)| {
            let (a, b) = (a - from_corner, b - from_corner);
            a.perp(&b) * (a.norm_squared() + a.dot(&b) + b.norm_squared())
        };
        let inertia_per_mass = edges().map(second_moment).sum::<f64>() / (6.0 * doubled_area);
        Self { centre_of_mass: corner + from_corner, inertia_per_mass }
    }
}

impl Body {
    /// On a support given in the part's frame.
    #[must_use]
    pub fn uniform(support: SupportFriction, mass: Mass) -> Self {
        Self { support: Support::Uniform(support.with_origin(mass.centre_of_mass)), mass }
    }

    /// An elliptic plate with semi-axes along the part's x and y, m, of uniform density and pressure, its frame at its
    /// middle.
    #[must_use]
    pub fn ellipse(semi_axes: [f64; 2]) -> Self {
        Self::uniform(SupportFriction::ellipse(semi_axes), Mass::of_ellipse(semi_axes))
    }

    /// On feet: points in the part's frame, m, each with its share of the weight.
    ///
    /// A foot slower than [`FOOT_AT_REST`] has friction in proportion to its speed, so that one that comes to rest
    /// under a moving part, as many do, stays there.
    #[must_use]
    pub fn on_feet(feet: &[(Point2<f64>, f64)], mass: Mass) -> Self {
        let feet = feet.iter().map(|&(at, share)| Foot { at: at - mass.centre_of_mass, share });
        Self { support: Support::Feet(feet.collect()), mass }
    }

    /// What it rests on, about the centre of mass; feet without their creep.
    #[must_use]
    pub fn support(&self) -> SupportFriction {
        match &self.support {
            Support::Uniform(support) => support.clone(),
            Support::Feet(feet) => {
                let feet: Vec<_> = feet.iter().map(|foot| (Point2::from(foot.at), foot.share)).collect();
                SupportFriction::feet(&feet)
            }
        }
    }

    /// Where it stands, part frame, m, and the share of the weight there; none of a base that bears everywhere.
    #[must_use]
    pub fn feet(&self) -> Option<impl Iterator<Item = (Point2<f64>, f64)> + '_> {
        match &self.support {
            Support::Uniform(_) => None,
            Support::Feet(feet) => Some(feet.iter().map(|foot| (self.centre_of_mass() + foot.at, foot.share))),
        }
    }

    /// The point about which the pressure has no moment, part frame, m.
    #[must_use]
    pub fn centre_of_pressure(&self) -> Point2<f64> {
        self.centre_of_mass() + self.support().centre_of_pressure().coords
    }

    /// Where its mass is.
    #[must_use]
    pub fn mass(&self) -> Mass {
        self.mass
    }

    /// The centre of mass, part frame, m.
    #[must_use]
    pub fn centre_of_mass(&self) -> Point2<f64> {
        self.mass.centre_of_mass
    }

    /// ρ², m²: see [`Mass`].
    #[must_use]
    pub fn inertia_per_mass(&self) -> f64 {
        self.mass.inertia_per_mass
    }

    /// How the support slides under a twist (velocity x, y of the centre of mass, ω): the means of the direction of
    /// sliding and of its moment. Friction per unit mass is −µg times that.
    #[inline]
    pub(super) fn sliding<T: Scalar>(&self, twist_body: [T; 3]) -> [T; 3] {
        match &self.support {
            Support::Uniform(support) => T::mean_sliding(support, twist_body),
            Support::Feet(feet) => feet_sliding(feet, twist_body),
        }
    }
}
