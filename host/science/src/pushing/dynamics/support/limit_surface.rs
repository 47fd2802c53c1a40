//! The limit surface: all friction that a support can meet a motion with, and the ellipsoid that is often put in its
//! place.
//!
//! Goyal, Ruina and Papadopoulos (1991) showed that friction wrenches lie on a convex surface whose normal is the
//! twist; Howe and Cutkosky (1996) put an ellipsoid through its circle of translations and its poles.
//!
//! Frames: any fixed to the part. Units: SI; forces per `μ·m·g`. Errors: none.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Point2, Vector2};

use super::{MeanSliding, SupportFriction, Twist};

/// An ellipsoid in place of the true limit surface: an approximation, exact only for pure translation and for turning
/// about the centre of pressure.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::dynamics::support::{EllipsoidalLimitSurface, SupportFriction, Twist};
///
/// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?;
/// let support = SupportFriction::uniform(&block);
/// let ellipsoid = EllipsoidalLimitSurface::of(&support);
/// // Turning about a corner, the ellipsoid errs by some percent of the weight times friction.
/// let about_corner = Twist::new(Vector2::new(0.02, -0.03), 1.0);
/// let (true_one, approximate) = (support.mean_sliding(&about_corner), ellipsoid.mean_sliding(&about_corner));
/// assert!((0.01..0.10).contains(&(true_one.direction - approximate.direction).norm()));
/// # Ok::<(), palpate::geometry::PolygonError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EllipsoidalLimitSurface {
    /// Where it has its middle, m.
    pub centre_of_pressure: Point2<f64>,
    /// Semi-axis along the forces: the share of the weight on the plane, 1 where all of it is.
    pub force_max: f64,
    /// Semi-axis along the moment: that of turning about the centre of pressure, m.
    pub moment_max: f64,
}

impl EllipsoidalLimitSurface {
    /// The ellipsoid with the true surface's extent along the axes.
    #[must_use]
    pub fn of(support: &SupportFriction) -> Self {
        let centre_of_pressure = support.centre_of_pressure();
        let there = support.clone().with_origin(centre_of_pressure);
        let slide = Twist::new(Vector2::x(), 0.0);
        let turn = Twist::new(Vector2::zeros(), 1.0);
        Self {
            centre_of_pressure,
            force_max: there.mean_sliding(&slide).direction.norm(),
            moment_max: there.mean_sliding(&turn).moment,
        }
    }

    /// What [`SupportFriction::mean_sliding`] is approximated by.
    #[must_use]
    pub fn mean_sliding(&self, twist: &Twist) -> MeanSliding {
        let offset = self.centre_of_pressure.coords;
        let there = twist.seen_from(offset);
        let (force, moment) = (self.force_max * there.velocity, self.moment_max * there.omega);
        let size = force.norm().hypot(moment);
        if size == 0.0 {
            return MeanSliding::NONE;
        }
        let sliding = MeanSliding { direction: self.force_max * force / size, moment: self.moment_max * moment / size };
        sliding.about(offset)
    }
}

/// Twists in all directions: `steps` circles of latitude from turning right to turning left, of `2·steps` each; the
/// turning is weighed by `length` (m; about half the part's size spaces the points evenly).
pub(super) fn twists(length: f64, steps: usize) -> impl Iterator<Item = Twist> {
    let last = steps.saturating_sub(1).max(1) as f64;
    (0..steps).flat_map(move |i| {
        let latitude = -FRAC_PI_2 + PI * i as f64 / last;
        (0..2 * steps).map(move |j| {
            let angle = TAU * j as f64 / (2 * steps) as f64;
            let across = latitude.cos() * Vector2::new(angle.cos(), angle.sin());
            Twist::new(across, latitude.sin() / length)
        })
    })
}
