//! Friction between a sliding part and the plane it lies on.
//!
//! Every bit of the support resists against the direction in which it slides. For a part with uniform pressure the
//! force is `−μ·g·(m/A)·I₁` and the moment `−μ·g·(m/A)·I₂` with
//! `I₁ = ∫ v̂ dA` and `I₂ = ∫ p × v̂ dA`, where `v̂` is the direction of the velocity at `p`. This module gives the two
//! divided by the area, so that a support of any kind gives the means of `v̂` and of `p × v̂`, weighed by pressure:
//! [`MeanSliding`]. Both are gradients of the mean speed `Φ = ∫ |v| dA / A`, hence their own gradient is symmetric and
//! positive semidefinite.
//!
//! Implements: thesis §5.1.2, eqs. (5.18) to (5.20), and appendix C, in closed forms of our own that need no angles and
//! no inside test. Symbols in `docs/NOTATION.md`.
//! Assumes: Coulomb friction, pressure known and constant. What rests exactly at the centre of rotation has no
//! friction.
//! Frames: any frame fixed to the part, of which the twist is that of the origin, in the part's axes. Units: SI.
//! Errors: none. A centre of rotation inside, on an edge, at a vertex or infinitely far away is valid.
//!
//! - `uniform`: uniform pressure; near centres of rotation by integrals along the outline,
//!   - `simd`: those of a polygon, in closed form, one square root and one logarithm an edge, four edges at a time;
//!   - `smooth`: those of a smooth curve, by quadrature;
//!   - `far_field`: far centres of rotation, by a power series that goes through pure translation;
//! - `feet`: support on a few points;
//! - `limit_surface`: all friction there can be, and [`EllipsoidalLimitSurface`], what others use instead.

mod far_field;
mod feet;
mod limit_surface;
mod simd;
mod smooth;
mod uniform;

use nalgebra::{Matrix3, Point2, Vector2};

use self::feet::Feet;
pub use self::limit_surface::EllipsoidalLimitSurface;
use self::simd::LANES;
use self::smooth::Smooth;
use self::uniform::Uniform;
use crate::geometry::SimplePolygon;

/// How a part moves in the plane: the velocity of its frame's origin, and its rate of turning.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Twist {
    /// Velocity of the origin, m/s.
    pub velocity: Vector2<f64>,
    /// Rate of turning, counter-clockwise, rad/s.
    pub omega: f64,
}

impl Twist {
    /// A twist from its parts, m/s and rad/s.
    #[must_use]
    pub fn new(velocity: Vector2<f64>, omega: f64) -> Self {
        Self { velocity, omega }
    }

    /// The velocity of the point that is now at `offset` (m) from the origin, m/s.
    #[must_use]
    pub fn velocity_at(&self, offset: Vector2<f64>) -> Vector2<f64> {
        self.velocity + self.omega * turn_left(offset)
    }

    /// The same motion seen from the point that is now at `offset` (m) from the origin.
    #[must_use]
    pub fn seen_from(&self, offset: Vector2<f64>) -> Self {
        Self { velocity: self.velocity_at(offset), omega: self.omega }
    }

    /// Whether to compute with it as it is.
    #[inline]
    fn is_of_plain_size(&self) -> bool {
        PLAIN_SQUARES.contains(&(self.velocity.norm_squared() + self.omega * self.omega))
    }

    /// The same direction of motion, and what has been divided by; no motion stays none.
    #[cold]
    #[inline(never)]
    fn of_size_one(&self) -> (Self, f64) {
        let size = self.velocity.amax().max(self.omega.abs());
        let size = if size == 0.0 { 1.0 } else { size };
        (Self { velocity: self.velocity / size, omega: self.omega / size }, size)
    }
}

/// How a support slides, averaged over its pressure. Of no dimension but the moment's length.
///
/// Friction on the part is `−μ·g` times this, per unit mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MeanSliding {
    /// Mean of the direction of sliding `v̂`: `I₁/A`. At most 1 long, in the part's axes.
    pub direction: Vector2<f64>,
    /// Mean of `p × v̂` about the frame's origin: `I₂/A`, m.
    pub moment: f64,
}

/// Squares of twists (of m/s and rad/s) that neither overflow nor underflow, nor will when multiplied with each other.
///
/// Twists beyond are brought to size 1 first; all others keep every bit.
const PLAIN_SQUARES: std::ops::Range<f64> = 1e-150..1e150;

impl MeanSliding {
    /// A support that does not move.
    const NONE: Self = Self { direction: Vector2::new(0.0, 0.0), moment: 0.0 };

    /// Mean speed `Φ` of the support under the twist that this belongs to, m/s; `μ·g` times it is the power lost per
    /// mass.
    #[must_use]
    pub fn mean_speed(&self, twist: &Twist) -> f64 {
        self.direction.dot(&twist.velocity) + self.moment * twist.omega
    }

    /// The same about an origin from which the present one is seen at `offset`, m.
    fn about(self, offset: Vector2<f64>) -> Self {
        Self { moment: self.moment + offset.perp(&self.direction), ..self }
    }
}

/// Derivatives of [`MeanSliding`] by the twist, which are symmetric.
#[derive(Clone, Copy, Debug, Default)]
struct SlidingGradient {
    /// Of the direction by the velocity, s/m: `xx`, `xy`, `yy`.
    by_velocity: [f64; 3],
    /// Of the moment by the velocity, or of the direction by the rate of turning, s.
    by_both: Vector2<f64>,
    /// Of the moment by the rate of turning, m·s.
    by_omega: f64,
}

impl SlidingGradient {
    /// From the velocity part, and that it takes the twist `(v, ω)` to zero.
    #[inline]
    fn of_degree_0(by_velocity: [f64; 3], velocity_per_omega: Vector2<f64>) -> Self {
        let mut gradient = Self { by_velocity, ..Self::default() };
        gradient.by_both = -gradient.times_velocity(velocity_per_omega);
        gradient.by_omega = -gradient.by_both.dot(&velocity_per_omega);
        gradient
    }

    #[inline]
    fn times_velocity(&self, v: Vector2<f64>) -> Vector2<f64> {
        let [xx, xy, yy] = self.by_velocity;
        Vector2::new(xx * v.x + xy * v.y, xy * v.x + yy * v.y)
    }

    /// Adds `factor w wᵀ` with `w = (v, m)`.
    fn add_outer(&mut self, v: Vector2<f64>, m: f64, factor: f64) {
        let [xx, xy, yy] = &mut self.by_velocity;
        *xx += factor * v.x * v.x;
        *xy += factor * v.x * v.y;
        *yy += factor * v.y * v.y;
        self.by_both += factor * m * v;
        self.by_omega += factor * m * m;
    }

    /// What [`MeanSliding::about`] makes of it: `JᵀGJ`, where `J` takes `(v, ω)` to `(v + ω ẑ × offset, ω)`.
    #[inline]
    fn about(self, offset: Vector2<f64>) -> Self {
        let lever = turn_left(offset);
        let by_both = self.by_both + self.times_velocity(lever);
        Self { by_both, by_omega: self.by_omega + (self.by_both + by_both).dot(&lever), ..self }
    }

    /// Rows direction x, direction y, moment; columns velocity x, y, omega.
    #[inline]
    fn matrix(&self) -> Matrix3<f64> {
        let ([xx, xy, yy], [x, y], turning) = (self.by_velocity, [self.by_both.x, self.by_both.y], self.by_omega);
        Matrix3::new(xx, xy, x, xy, yy, y, x, y, turning)
    }
}

/// The pressure with which a part rests on the plane, ready to give its friction.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::dynamics::support::{SupportFriction, Twist};
///
/// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?;
/// let support = SupportFriction::uniform(&block);
/// let spin = support.mean_sliding(&Twist::new(Vector2::zeros(), 0.5));
/// // A block turning on the spot resists with μ·m·g times its mean distance from the middle, 19.3 mm.
/// assert!((spin.moment - 0.0193).abs() < 0.0001 && spin.direction.norm() < 1e-15);
/// # Ok::<(), palpate::geometry::PolygonError>(())
/// ```
#[derive(Clone, Debug)]
pub struct SupportFriction {
    pressure: Pressure,
    /// From the frame's origin to the pressure's own centre, m.
    centre: Vector2<f64>,
}

/// Where the weight rests, relative to a centre of its own.
#[derive(Clone, Debug)]
enum Pressure {
    Uniform(Uniform),
    Feet(Feet),
}

impl SupportFriction {
    /// Pressure uniform over a polygon, in the polygon's frame.
    #[must_use]
    pub fn uniform(polygon: &SimplePolygon) -> Self {
        let centroid = polygon.centroid();
        Self { pressure: Pressure::Uniform(Uniform::polygon(polygon, centroid)), centre: centroid.coords }
    }

    /// Pressure uniform over an ellipse with these semi-axes along x and y, m, in the frame at its middle.
    ///
    /// By quadrature: up to an aspect ratio of 50, errors stay below 1e-12 (gradients 1e-10) of the largest possible
    /// values.
    ///
    /// # Panics
    /// If a semi-axis is not a positive number.
    #[must_use]
    pub fn ellipse(semi_axes: [f64; 2]) -> Self {
        assert!(semi_axes.iter().all(|a| *a > 0.0 && a.is_finite()), "semi-axes {semi_axes:?} m must be positive");
        Self { pressure: Pressure::Uniform(Uniform::smooth(Smooth::ellipse(semi_axes))), centre: Vector2::zeros() }
    }

    /// Pressure uniform within a smooth closed curve, counter-clockwise, that sees its centroid at the frame's origin.
    ///
    /// `outline` gives the point (m) and its derivative at a parameter from 0 to 1, with period 1. By quadrature on 16
    /// panels of 16 points, which are halved towards the centre of rotation: as exact as [`Self::ellipse`] where the
    /// panels resolve the curve.
    #[must_use]
    pub fn smooth(outline: impl Fn(f64) -> (Point2<f64>, Vector2<f64>) + Send + Sync + 'static) -> Self {
        Self { pressure: Pressure::Uniform(Uniform::smooth(Smooth::new(outline))), centre: Vector2::zeros() }
    }

    /// Feet that each bear a share of the weight: points in the part's frame, m, and shares, used as given.
    ///
    /// A foot momentarily at rest has no friction.
    #[must_use]
    pub fn feet(feet: &[(Point2<f64>, f64)]) -> Self {
        Self { pressure: Pressure::Feet(Feet::new(feet)), centre: Vector2::zeros() }
    }

    /// The same support in a frame with its origin moved to `origin`, which is given in the present frame, m.
    ///
    /// With the centre of mass as origin, twists and moments are those of the part's dynamics.
    #[must_use]
    pub fn with_origin(self, origin: Point2<f64>) -> Self {
        Self { centre: self.centre - origin.coords, ..self }
    }

    /// The point about which the pressure has no moment, in the frame, m; for feet whose shares cancel, the origin.
    #[must_use]
    pub fn centre_of_pressure(&self) -> Point2<f64> {
        let own = match &self.pressure {
            Pressure::Uniform(_) => Vector2::zeros(),
            Pressure::Feet(feet) => feet.centre_of_pressure(),
        };
        Point2::from(self.centre + own)
    }

    /// The area over which a uniform pressure rests, m².
    #[must_use]
    pub fn area(&self) -> Option<f64> {
        match &self.pressure {
            Pressure::Uniform(shape) => Some(shape.area()),
            Pressure::Feet(_) => None,
        }
    }

    /// Points of the limit surface: twists in all directions with the friction each meets.
    ///
    /// Every point is a friction wrench per `μ·m·g`, reversed; the surface's outward normal there has the direction of
    /// its twist. About the centre of pressure, pure translations give the unit circle at no moment. There are `steps`
    /// circles of latitude of `2·steps` points each, from turning right to turning left; `length` (m) weighs turning
    /// against translation, and half the part's size spaces the points evenly.
    #[must_use]
    pub fn limit_surface(&self, length: f64, steps: usize) -> Vec<(Twist, MeanSliding)> {
        let twists: Vec<_> = limit_surface::twists(length, steps).collect();
        let slidings = self.mean_slidings(&twists);
        twists.into_iter().zip(slidings).collect()
    }

    /// Mean direction of sliding and its moment, both about the frame's origin, under a twist of that origin.
    ///
    /// Of degree 0: only the twist's direction counts. No motion at all gives zero.
    #[must_use]
    pub fn mean_sliding(&self, twist: &Twist) -> MeanSliding {
        if twist.is_of_plain_size() { self.plain_sliding(twist) } else { self.plain_sliding(&twist.of_size_one().0) }
    }

    /// [`Self::mean_sliding`] of many twists, four at a time: for parts of few edges about twice as fast as one by one.
    ///
    /// What comes out differs from that by roundings, because sums are taken in another order.
    #[must_use]
    pub fn mean_slidings(&self, twists: &[Twist]) -> Vec<MeanSliding> {
        let (fours, rest) = twists.as_chunks::<LANES>();
        let fours = fours.iter().flat_map(|four| self.four_slidings(four));
        fours.chain(rest.iter().map(|twist| self.mean_sliding(twist))).collect()
    }

    fn four_slidings(&self, twists: &[Twist; LANES]) -> [MeanSliding; LANES] {
        match &self.pressure {
            Pressure::Uniform(shape) if twists.iter().all(Twist::is_of_plain_size) => {
                let about = twists.map(|twist| twist.seen_from(self.centre));
                shape.mean_slidings(&about).map(|sliding| sliding.about(self.centre))
            }
            _ => twists.map(|twist| self.mean_sliding(&twist)),
        }
    }

    /// [`Self::mean_sliding`] and its gradient: rows direction x, direction y, moment; columns velocity x, y, omega.
    ///
    /// The gradient is symmetric and positive semidefinite, and takes the twist itself to zero. It does not exist
    /// without motion, nor for feet at a foot at rest: there it counts that foot, or everything, as having none.
    #[must_use]
    pub fn mean_sliding_and_gradient(&self, twist: &Twist) -> (MeanSliding, Matrix3<f64>) {
        if twist.is_of_plain_size() {
            return self.plain_gradient(twist);
        }
        let (twist, size) = twist.of_size_one();
        let (sliding, gradient) = self.plain_gradient(&twist);
        (sliding, gradient / size)
    }

    fn plain_sliding(&self, twist: &Twist) -> MeanSliding {
        let twist = twist.seen_from(self.centre);
        let sliding = match &self.pressure {
            Pressure::Uniform(shape) => shape.mean_sliding(&twist),
            Pressure::Feet(feet) => feet.mean_sliding(&twist),
        };
        sliding.about(self.centre)
    }

    fn plain_gradient(&self, twist: &Twist) -> (MeanSliding, Matrix3<f64>) {
        let twist = twist.seen_from(self.centre);
        // Finished in each branch by itself, so that numbers stay in registers.
        let about = |(sliding, gradient): (MeanSliding, SlidingGradient)| {
            (sliding.about(self.centre), gradient.about(self.centre).matrix())
        };
        match &self.pressure {
            Pressure::Uniform(shape) => shape.mean_sliding_and_gradient(&twist, about),
            Pressure::Feet(feet) => about(feet.mean_sliding_and_gradient(&twist)),
        }
    }
}

/// A vector turned by a right angle counter-clockwise: `ẑ × v`.
fn turn_left(v: Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-v.y, v.x)
}

#[cfg(test)]
mod tests;
