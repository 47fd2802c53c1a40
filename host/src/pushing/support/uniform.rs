//! Uniform pressure over a polygon or within a smooth curve.
//!
//! The field of speeds of a part that turns is a cone over the plane with its tip at the centre of rotation `q`, so
//! `∫ |p − q| dA` and its derivatives by `q` are integrals along the outline, and for a polygon sums over its edges. With `r` the distance from `q`, `n` an edge's outward normal,
//! `h` the distance of `q` from the edge's line and `a`, `b` the places of its ends along the line from the foot of `q`:
//!
//! ```text
//! Λ = ∫ ds/r = ln((b + r₁)/(a + r₀))        K = ∫ r ds = (b r₁ − a r₀ + h² Λ)/2
//! G = ∫ (p − q)/r dA = ∮ r n ds = Σ n K         M = ∫ r dA = ∮ r (p − q)·n ds / 3 = Σ h K / 3
//! S = ∂²M/∂q² = ∮ n (p − q)ᵀ/r ds = Σ n (t (r₁ − r₀) + n h Λ)ᵀ
//! ```
//!
//! Then, for turning with the sign `σ`: `I₁ = σ ẑ × G`, `I₂ = σ (q · G + M)`.
//!
//! Nothing is divided by `h`, so a centre of rotation on an edge, on its line or at a vertex needs no case of its own.
//! Far away the terms cancel to second order in the distance; from [`NEAR_MAX`] on, `far` takes over.
//!
//! Frames: the part's axes, origin at the centroid. Units: SI. Errors: none.

use std::sync::OnceLock;

use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use super::far::{self, Far};
use super::lanes::Lanes;
use super::smooth::Smooth;
use super::{MeanSliding, Twist, turn_left};
use crate::geometry::SimplePolygon;

/// Largest distance of the centre of rotation from the centroid for the closed form, in radii of the part.
///
/// The closed form loses about the square of this times 1e-16 of the result; the series beyond it converges like its powers.
const NEAR_MAX: f64 = 8.0;

/// A shape with the same pressure everywhere, relative to its centroid.
#[derive(Clone, Debug)]
pub(super) struct Uniform {
    outline: Outline,
    /// m².
    area: f64,
    /// Largest distance of the outline from the centroid, m.
    radius: f64,
    far: OnceLock<Far>,
}

#[derive(Clone, Debug)]
enum Outline {
    Polygon(Lanes),
    Smooth(Smooth),
}

/// Integrals over the shape for one centre of rotation.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sums {
    /// `G`, m².
    pub(super) pull: Vector2<f64>,
    /// `M`, m³.
    pub(super) distance: f64,
    /// `S`, m: `xx`, `xy`, `yy`; zero unless asked for.
    pub(super) bend: [f64; 3],
}

impl Uniform {
    pub(super) fn polygon(polygon: &SimplePolygon, centroid: Point2<f64>) -> Self {
        let vertices: Vec<_> = polygon.vertices().iter().map(|p| p - centroid).collect();
        let radius = vertices.iter().map(|p| p.norm()).fold(0.0, f64::max);
        let outline = Outline::Polygon(Lanes::new(vertices));
        Self { outline, area: polygon.area(), radius, far: OnceLock::new() }
    }

    /// Within a smooth curve that runs counter-clockwise about the origin, its centroid.
    pub(super) fn smooth(outline: Smooth) -> Self {
        let rays = || outline.rays();
        let area = rays().map(|(_, cross)| 0.5 * cross).sum();
        let radius = rays().map(|(p, _)| p.norm()).fold(0.0, f64::max);
        Self { outline: Outline::Smooth(outline), area, radius, far: OnceLock::new() }
    }

    /// m².
    pub(super) fn area(&self) -> f64 {
        self.area
    }

    pub(super) fn mean_sliding(&self, twist: &Twist) -> MeanSliding {
        match self.near_centre(twist) {
            Some(centre) => self.near_sliding(&self.sums::<false>(centre), centre, twist.omega),
            None => self.far().mean_sliding(twist),
        }
    }

    pub(super) fn mean_sliding_and_gradient(&self, twist: &Twist) -> (MeanSliding, Matrix3<f64>) {
        let Some(centre) = self.near_centre(twist) else {
            return self.far().mean_sliding_and_gradient(twist);
        };
        let sums = self.sums::<true>(centre);
        (self.near_sliding(&sums, centre, twist.omega), self.near_gradient(&sums, twist))
    }

    fn sums<const GRADIENT: bool>(&self, centre: Vector2<f64>) -> Sums {
        match &self.outline {
            Outline::Polygon(lanes) => lanes.sums::<GRADIENT>(centre),
            Outline::Smooth(smooth) => smooth.sums(centre),
        }
    }

    fn far(&self) -> &Far {
        self.far.get_or_init(|| match &self.outline {
            Outline::Polygon(lanes) => Far::new(far::rays_of_polygon(lanes.vertices()), self.area, self.radius),
            Outline::Smooth(smooth) => Far::new(smooth.rays(), self.area, self.radius),
        })
    }

    /// The centre of rotation, if it is near enough for the closed form.
    fn near_centre(&self, twist: &Twist) -> Option<Vector2<f64>> {
        let reach = NEAR_MAX * self.radius * twist.omega;
        let near = twist.velocity.norm_squared() < reach * reach;
        near.then(|| turn_left(twist.velocity / twist.omega))
    }

    fn near_sliding(&self, sums: &Sums, centre: Vector2<f64>, omega: f64) -> MeanSliding {
        let scale = omega.signum() / self.area;
        let moment = centre.dot(&sums.pull) + sums.distance;
        MeanSliding { direction: scale * turn_left(sums.pull), moment: scale * moment }
    }

    /// From `Φ = |ω| M(q)/A` with `q = ẑ × v/ω`, and because `Φ` is of degree 1.
    fn near_gradient(&self, sums: &Sums, twist: &Twist) -> Matrix3<f64> {
        let scale = 1.0 / (self.area * twist.omega.abs());
        let [xx, xy, yy] = sums.bend.map(|bend| scale * bend);
        let by_velocity = Matrix2::new(yy, -xy, -xy, xx);
        gradient_of_degree_0(&by_velocity, twist.velocity / twist.omega)
    }
}

/// Completes a symmetric gradient that takes the twist `(v, ω)` to zero from its velocity part and `v/ω`.
fn gradient_of_degree_0(by_velocity: &Matrix2<f64>, velocity_per_omega: Vector2<f64>) -> Matrix3<f64> {
    let mixed = -by_velocity * velocity_per_omega;
    let by_omega = -mixed.dot(&velocity_per_omega);
    let v = by_velocity;
    #[rustfmt::skip]
    let gradient = Matrix3::new(
        v.m11, v.m12, mixed.x,
        v.m21, v.m22, mixed.y,
        mixed.x, mixed.y, by_omega,
    );
    gradient
}

#[cfg(test)]
impl Uniform {
    pub(super) fn radius(&self) -> f64 {
        self.radius
    }

    /// The closed form and the series, whichever would be chosen.
    pub(super) fn both_ways(&self, twist: &Twist) -> [(MeanSliding, Matrix3<f64>); 2] {
        let centre = turn_left(twist.velocity / twist.omega);
        let sums = self.sums::<true>(centre);
        let near = (self.near_sliding(&sums, centre, twist.omega), self.near_gradient(&sums, twist));
        [near, self.far().mean_sliding_and_gradient(twist)]
    }
}
