//! Uniform pressure over a polygon, in closed form.
//!
//! The field of speeds of a part that turns is a cone over the plane with its tip at the centre of rotation `q`, so
//! `∫ |p − q| dA` and its derivatives by `q` are sums over the edges. With `r` the distance from `q`, `n` an edge's outward normal,
//! `h` the distance of `q` from the edge's line and `a`, `b` the places of its ends along the line from the foot of `q`:
//!
//! ```text
//! Λ = ∫ ds/r = ln((b + r₁)/(a + r₀))        K = ∫ r ds = (b r₁ − a r₀ + h² Λ)/2
//! G = ∫ (p − q)/r dA = Σ n K                M = ∫ r dA = Σ h K / 3
//! S = ∂²M/∂q² = Σ n (t (r₁ − r₀) + n h Λ)ᵀ
//! ```
//!
//! Then, for turning with the sign `σ`: `I₁ = σ ẑ × G`, `I₂ = σ (q · G + M)`.
//!
//! Nothing is divided by `h`, so a centre of rotation on an edge, on its line or at a vertex needs no case of its own.
//! Far away the terms cancel to second order in the distance; from [`NEAR_MAX`] on, `far` takes over.
//!
//! Frames: the polygon's axes, origin at its centroid. Units: SI. Errors: none.

use std::sync::OnceLock;

use nalgebra::{Matrix2, Matrix3, Point2, Vector2};

use super::far::Far;
use super::{MeanSliding, Twist, turn_left};
use crate::geometry::SimplePolygon;

/// Largest distance of the centre of rotation from the centroid for the closed form, in radii of the part.
///
/// The closed form loses about the square of this times 1e-16 of the result; the series beyond it converges like its powers.
const NEAR_MAX: f64 = 8.0;

/// Square of a distance from an edge's line, m², below which its logarithm is left out: it only occurs multiplied by the distance.
const ON_LINE_SQUARED: f64 = 1e-300;

/// Length of an edge over the sum of its ends' distances, below which `Λ` is taken from its power series.
///
/// The terms left out are then below 3e-17 of the whole. Above it, the logarithm of the quotient has 15 digits.
const SERIES_MAX: f64 = 0.2;

/// A polygon's edges, relative to its centroid.
#[derive(Clone, Debug)]
pub(super) struct Edges {
    edges: Vec<Edge>,
    area: f64,
    /// Largest distance of a vertex from the centroid, m.
    radius: f64,
    far: OnceLock<Far>,
}

#[derive(Clone, Copy, Debug)]
struct Edge {
    start: Vector2<f64>,
    along: Vector2<f64>,
    length: f64,
    /// Place of the start along the edge's line, from the foot of the centroid, m.
    place: f64,
    /// Distance of the edge's line from the centroid, positive outwards, m.
    height: f64,
}

impl Edge {
    fn new(start: Vector2<f64>, end: Vector2<f64>) -> Self {
        let length = (end - start).norm();
        let along = (end - start) / length;
        Self { start, along, length, place: start.dot(&along), height: start.perp(&along) }
    }

    /// Outward.
    fn normal(&self) -> Vector2<f64> {
        Vector2::new(self.along.y, -self.along.x)
    }
}

/// Sums over all edges for one centre of rotation.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    /// `G`, m².
    pull: Vector2<f64>,
    /// `M`, m³.
    distance: f64,
    /// `S`, m: `xx`, `xy`, `yy`.
    bend: [f64; 3],
}

impl Edges {
    pub(super) fn new(polygon: &SimplePolygon, centroid: Point2<f64>) -> Self {
        let edges: Vec<_> = polygon.edges().map(|(a, b)| Edge::new(a - centroid, b - centroid)).collect();
        let radius = edges.iter().map(|edge| edge.start.norm()).fold(0.0, f64::max);
        Self { edges, area: polygon.area(), radius, far: OnceLock::new() }
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

    fn far(&self) -> &Far {
        self.far.get_or_init(|| Far::of_polygon(self.edges.iter().map(|edge| edge.start), self.area, self.radius))
    }

    /// The centre of rotation, if it is near enough for the closed form.
    fn near_centre(&self, twist: &Twist) -> Option<Vector2<f64>> {
        let reach = NEAR_MAX * self.radius * twist.omega.abs();
        let near = twist.velocity.amax() < reach && twist.velocity.norm() < reach;
        near.then(|| turn_left(twist.velocity / twist.omega))
    }

    fn near_sliding(&self, sums: &Sums, centre: Vector2<f64>, omega: f64) -> MeanSliding {
        let scale = omega.signum() / self.area;
        let moment = centre.dot(&sums.pull) + sums.distance;
        MeanSliding { direction: scale * turn_left(sums.pull), moment: scale * moment }
    }

    /// From `Φ = |ω| M(q)/A` with `q = ẑ × v/ω`, and because `Φ` is of degree 1.
    fn near_gradient(&self, sums: &Sums, twist: &Twist) -> Matrix3<f64> {
        let [xx, xy, yy] = sums.bend.map(|bend| bend / (self.area * twist.omega.abs()));
        let by_velocity = Matrix2::new(yy, -xy, -xy, xx);
        gradient_of_degree_0(&by_velocity, twist.velocity / twist.omega)
    }

    fn sums<const GRADIENT: bool>(&self, centre: Vector2<f64>) -> Sums {
        let mut sums = Sums::default();
        let first_distance = (self.edges[0].start - centre).norm();
        let mut r0 = first_distance;
        for (i, edge) in self.edges.iter().enumerate() {
            let r1 = match self.edges.get(i + 1) {
                Some(next) => (next.start - centre).norm(),
                None => first_distance,
            };
            add_edge::<GRADIENT>(&mut sums, edge, centre, [r0, r1]);
            r0 = r1;
        }
        sums.distance /= 3.0;
        sums
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

fn add_edge<const GRADIENT: bool>(sums: &mut Sums, edge: &Edge, centre: Vector2<f64>, [r0, r1]: [f64; 2]) {
    let normal = edge.normal();
    let a = edge.place - edge.along.dot(&centre);
    let b = a + edge.length;
    let h = edge.height - normal.dot(&centre);
    let log = reciprocal_integral(edge.length, [a, b], h * h, [r0, r1]);
    let k = 0.5 * (b * r1 - a * r0 + h * h * log);
    sums.pull += k * normal;
    sums.distance += h * k;
    if GRADIENT {
        let (along, across) = (r1 - r0, h * log);
        sums.bend[0] += normal.x * (edge.along.x * along + normal.x * across);
        sums.bend[1] += normal.x * (edge.along.y * along + normal.y * across);
        sums.bend[2] += normal.y * (edge.along.y * along + normal.y * across);
    }
}

/// `Λ = ∫ ds/r` along an edge from `a` to `b` on a line at the distance `√h2`, with the ends' distances `r0`, `r1`.
fn reciprocal_integral(length: f64, [a, b]: [f64; 2], h2: f64, [r0, r1]: [f64; 2]) -> f64 {
    if h2 < ON_LINE_SQUARED {
        return 0.0;
    }
    let share = length / (r0 + r1);
    if share < SERIES_MAX {
        return 2.0 * atanh_series(share);
    }
    // The same quotient three times, each where it subtracts nothing.
    let (over, under) = if a >= 0.0 {
        (b + r1, a + r0)
    } else if b <= 0.0 {
        (r0 - a, r1 - b)
    } else {
        ((b + r1) * (r0 - a), h2)
    };
    (over / under).ln()
}

/// `atanh(x)` for `|x| ≤` [`SERIES_MAX`].
fn atanh_series(x: f64) -> f64 {
    let z = x * x;
    // 1/(2k + 1) for k = 10, …, 1.
    let series = [21.0, 19.0, 17.0, 15.0, 13.0, 11.0, 9.0, 7.0, 5.0, 3.0].iter().fold(0.0, |sum, n| sum * z + 1.0 / n);
    x + x * z * series
}

#[cfg(test)]
impl Edges {
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
