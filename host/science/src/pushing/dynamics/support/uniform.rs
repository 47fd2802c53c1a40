//! Uniform pressure over a polygon or within a smooth curve.
//!
//! The field of speeds of a part that turns is a cone over the plane with its tip at the centre of rotation `q`, so
//! `∫ |p − q| dA` and its derivatives by `q` are integrals along the outline, and for a polygon sums over its edges.
//! With `r` the distance from `q`, `n` an edge's outward normal, `h` the distance of `q` from the edge's line and `a`,
//! `b` the places of its ends along the line from the foot of `q`:
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
//! Far away the terms cancel to second order in the distance; from [`NEAR_MAX`] on, `far_field` takes over.
//!
//! Frames: the part's axes, origin at the centroid. Units: SI. Errors: none.

use std::sync::OnceLock;

use nalgebra::{Point2, Vector2};

use super::far_field::{self, FarField};
use super::simd::{LANES, SimdEdges};
use super::smooth::Smooth;
use super::{MeanSliding, SlidingGradient, Twist, turn_left};
use crate::geometry::SimplePolygon;

/// Largest distance of the centre of rotation from the centroid for the closed form, in radii of the part.
///
/// The closed form loses about the square of this times 1e-16 of the result; the series beyond it converges like its
/// powers.
const NEAR_MAX: f64 = 8.0;

/// A shape with the same pressure everywhere, relative to its centroid.
#[derive(Clone, Debug)]
pub(super) struct Uniform {
    outline: Outline,
    /// Area of the support, m².
    area: f64,
    /// One over the area, 1/m².
    per_area: f64,
    /// Largest distance of the outline from the centroid, m.
    radius: f64,
    far_field: OnceLock<FarField>,
}

#[derive(Clone, Debug)]
enum Outline {
    Polygon(SimdEdges),
    Smooth(Smooth),
}

/// A centre of rotation.
struct Pole {
    /// The centre of rotation, m.
    at: Vector2<f64>,
    /// One over the rate of turning about it, s/rad.
    per_omega: f64,
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
        let outline = Outline::Polygon(SimdEdges::new(vertices));
        Self::new(outline, polygon.area(), radius)
    }

    /// Within a smooth curve that runs counter-clockwise about the origin, its centroid.
    pub(super) fn smooth(outline: Smooth) -> Self {
        let rays = || outline.rays();
        let area = rays().map(|(_, cross)| 0.5 * cross).sum();
        let radius = rays().map(|(p, _)| p.norm()).fold(0.0, f64::max);
        Self::new(Outline::Smooth(outline), area, radius)
    }

    fn new(outline: Outline, area: f64, radius: f64) -> Self {
        Self { outline, area, per_area: area.recip(), radius, far_field: OnceLock::new() }
    }

    /// Area of the support, m².
    pub(super) fn area(&self) -> f64 {
        self.area
    }

    #[inline]
    pub(super) fn mean_sliding(&self, twist: &Twist) -> MeanSliding {
        match self.near_pole(twist) {
            Some(pole) => self.near_sliding(&self.sums::<false>(pole.at), &pole),
            None => self.far_field().mean_sliding(twist),
        }
    }

    /// The sliding and its gradient, handed to `finish`.
    #[inline]
    pub(super) fn mean_sliding_and_gradient<T>(
        &self,
        twist: &Twist,
        finish: impl Fn((MeanSliding, SlidingGradient)) -> T,
    ) -> T {
        let Some(pole) = self.near_pole(twist) else {
            return finish(self.far_field().mean_sliding_and_gradient(twist));
        };
        let sums = self.sums::<true>(pole.at);
        finish((self.near_sliding(&sums, &pole), self.near_gradient(&sums, &pole)))
    }

    /// [`Self::mean_sliding`] of several twists at once.
    pub(super) fn mean_slidings(&self, twists: &[Twist; LANES]) -> [MeanSliding; LANES] {
        if let Outline::Polygon(lanes) = &self.outline
            && twists.iter().all(|twist| self.is_near(twist))
        {
            let poles = twists.map(|twist| Pole::of(&twist));
            let sums = lanes.sums_of_four::<false>(&std::array::from_fn(|i| poles[i].at));
            return std::array::from_fn(|i| self.near_sliding(&sums[i], &poles[i]));
        }
        twists.map(|twist| self.mean_sliding(&twist))
    }

    #[inline]
    fn sums<const GRADIENT: bool>(&self, centre: Vector2<f64>) -> Sums {
        match &self.outline {
            Outline::Polygon(lanes) => lanes.sums::<GRADIENT>(centre),
            Outline::Smooth(smooth) => smooth.sums(centre),
        }
    }

    fn far_field(&self) -> &FarField {
        self.far_field.get_or_init(|| match &self.outline {
            Outline::Polygon(lanes) => {
                FarField::new(far_field::rays_of_polygon(lanes.vertices()), self.area, self.radius)
            }
            Outline::Smooth(smooth) => FarField::new(smooth.rays(), self.area, self.radius),
        })
    }

    /// The centre of rotation, if it is near enough for the closed form.
    #[inline]
    fn near_pole(&self, twist: &Twist) -> Option<Pole> {
        self.is_near(twist).then(|| Pole::of(twist))
    }

    #[inline]
    fn is_near(&self, twist: &Twist) -> bool {
        let reach = NEAR_MAX * self.radius * twist.omega;
        twist.velocity.norm_squared() < reach * reach
    }

    #[inline]
    fn near_sliding(&self, sums: &Sums, pole: &Pole) -> MeanSliding {
        let scale = self.per_area.copysign(pole.per_omega);
        let moment = pole.at.dot(&sums.pull) + sums.distance;
        MeanSliding { direction: scale * turn_left(sums.pull), moment: scale * moment }
    }

    /// From `Φ = |ω| M(q)/A` with `q = ẑ × v/ω`, and because `Φ` is of degree 1.
    #[inline]
    fn near_gradient(&self, sums: &Sums, pole: &Pole) -> SlidingGradient {
        let scale = self.per_area * pole.per_omega.abs();
        let [xx, xy, yy] = sums.bend.map(|bend| scale * bend);
        SlidingGradient::of_degree_0([yy, -xy, xx], -turn_left(pole.at))
    }
}

impl Pole {
    #[inline]
    fn of(twist: &Twist) -> Self {
        let per_omega = twist.omega.recip();
        Self { at: per_omega * turn_left(twist.velocity), per_omega }
    }
}

#[cfg(test)]
impl Uniform {
    pub(super) fn radius(&self) -> f64 {
        self.radius
    }

    /// The closed form and the series, whichever would be chosen.
    pub(super) fn both_ways(&self, twist: &Twist) -> [(MeanSliding, SlidingGradient); 2] {
        let pole = Pole::of(twist);
        let sums = self.sums::<true>(pole.at);
        let near = (self.near_sliding(&sums, &pole), self.near_gradient(&sums, &pole));
        [near, self.far_field().mean_sliding_and_gradient(twist)]
    }
}
