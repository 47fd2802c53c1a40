//! What the motion of a pushed part depends on: part, contact edge, finger, and how they touch.
//!
//! Implements: the disk and the polygon of thesis §5.2.1, with the centre of mass and the inertia left free (§8.2.2).
//! Assumes: one disk touches one edge; the disk translates and does not turn; the pressure on the plane does not change.
//! Frames: `part` (as the polygon was given), `edge` (part's axes turned so that x is the edge's outward normal and y its
//! counter-clockwise direction; origin at the centre of mass), `world`. Units: SI, per unit mass where named so.
//! Errors: [`ModelError`] for an edge that the polygon does not have.

use nalgebra::{Point2, Vector2};

use super::scalar::Scalar;
use super::support::SupportFriction;
use crate::geometry::SimplePolygon;

/// A part on its plane: what friction under it and its inertia are.
#[derive(Clone, Debug)]
pub struct Part {
    polygon: SimplePolygon,
    /// About the centre of mass.
    support: Support,
    centre_of_mass: Point2<f64>,
    inertia_per_mass: f64,
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
/// micrometre a second. Less creep makes the motion stiffer in proportion: a held foot with a third of the weight already
/// needs a step each microsecond.
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
    /// Part frame, m.
    pub centre_of_mass: Point2<f64>,
    /// Moment of inertia about the centre of mass over the mass (the radius of gyration squared), m².
    pub inertia_per_mass: f64,
}

impl Mass {
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

impl Part {
    /// A plate of uniform density that presses uniformly on the plane.
    #[must_use]
    pub fn uniform(polygon: SimplePolygon) -> Self {
        let mass = Mass::uniform(&polygon);
        Self::with_mass(polygon, mass)
    }

    /// A part that presses uniformly on the plane, its mass wherever it is.
    #[must_use]
    pub fn with_mass(polygon: SimplePolygon, mass: Mass) -> Self {
        let support = SupportFriction::uniform(&polygon).with_origin(mass.centre_of_mass);
        Self::new(polygon, Support::Uniform(support), mass)
    }

    /// A part on feet: points in the part's frame, m, each with its share of the weight.
    ///
    /// A foot slower than [`FOOT_AT_REST`] has friction in proportion to its speed, so that one that comes to rest under a
    /// moving part, as many do, stays there.
    #[must_use]
    pub fn on_feet(polygon: SimplePolygon, feet: &[(Point2<f64>, f64)], mass: Mass) -> Self {
        let feet = feet.iter().map(|&(at, share)| Foot { at: at - mass.centre_of_mass, share });
        Self::new(polygon, Support::Feet(feet.collect()), mass)
    }

    fn new(polygon: SimplePolygon, support: Support, mass: Mass) -> Self {
        let Mass { centre_of_mass, inertia_per_mass } = mass;
        Self { polygon, support, centre_of_mass, inertia_per_mass }
    }

    /// The outline, part frame.
    #[must_use]
    pub fn polygon(&self) -> &SimplePolygon {
        &self.polygon
    }

    /// The centre of mass, part frame, m.
    #[must_use]
    pub fn centre_of_mass(&self) -> Point2<f64> {
        self.centre_of_mass
    }

    /// ρ², m²: see [`Mass`].
    #[must_use]
    pub fn inertia_per_mass(&self) -> f64 {
        self.inertia_per_mass
    }

    /// An edge as seen from the centre of mass.
    ///
    /// # Errors
    /// [`ModelError::NoSuchEdge`].
    pub fn edge(&self, index: usize) -> Result<Edge, ModelError> {
        let edges = self.polygon.vertices().len();
        let (start, end) = self.polygon.edges().nth(index).ok_or(ModelError::NoSuchEdge { index, edges })?;
        let (from, to) = (start - self.centre_of_mass, end - self.centre_of_mass);
        let direction = (to - from).normalize();
        let normal = Vector2::new(direction.y, -direction.x);
        Ok(Edge { normal, height: normal.dot(&from), s_min: direction.dot(&from), s_max: direction.dot(&to) })
    }

    /// How the support slides, in edge axes about the centre of mass: friction on the part per unit mass is −µg times that.
    #[inline]
    pub(super) fn sliding<T: Scalar>(&self, edge: &Edge, twist: EdgeTwist<T>) -> EdgeTwist<T> {
        let (x, y) = (edge.normal.x, edge.normal.y);
        let body = [twist.normal * x - twist.along * y, twist.normal * y + twist.along * x, twist.turn];
        let [d_x, d_y, turn] = match &self.support {
            Support::Uniform(support) => T::mean_sliding(support, body),
            Support::Feet(feet) => feet_sliding(feet, body),
        };
        EdgeTwist { normal: d_x * x + d_y * y, along: d_y * x - d_x * y, turn }
    }
}

/// An edge as seen from the centre of mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Edge {
    /// Outward unit normal n, part axes. The edge runs along (−n.y, n.x).
    pub normal: Vector2<f64>,
    /// h: distance of the edge's line from the centre of mass along n, m; negative where a non-convex part has its
    /// centre of mass beyond the edge.
    pub height: f64,
    /// s at the edge's first vertex, m.
    pub s_min: f64,
    /// s at the edge's second vertex, m.
    pub s_max: f64,
}

/// Components in edge axes of a twist, a wrench or whatever pairs with them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct EdgeTwist<T> {
    /// Along the outward normal.
    pub(super) normal: T,
    /// Along the edge, counter-clockwise.
    pub(super) along: T,
    /// About the centre of mass.
    pub(super) turn: T,
}

/// A disk that translates on a parabola and never turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finger<T = f64> {
    /// Radius r of the disk, m.
    pub radius: f64,
    /// Centre at t = 0, world axes, m.
    pub centre0: [f64; 2],
    /// Velocity at t = 0, world axes, m/s.
    pub velocity0: [T; 2],
    /// Acceleration a_F, world axes, m/s².
    pub acceleration: [T; 2],
}

impl Finger {
    /// The centre at time `t` (s), m.
    #[must_use]
    pub fn centre(&self, t: f64) -> Point2<f64> {
        let [centre, velocity, acceleration] = [self.centre0, self.velocity0, self.acceleration].map(Vector2::from);
        Point2::from(centre + velocity * t + acceleration * (0.5 * t * t))
    }
}

impl<T: Scalar> Finger<T> {
    /// The velocity at time `t` (s), m/s.
    #[must_use]
    pub fn velocity(&self, t: f64) -> [T; 2] {
        [0, 1].map(|axis| self.velocity0[axis] + self.acceleration[axis] * t)
    }
}

/// How finger and part touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contact<T = f64> {
    /// No contact friction.
    Frictionless,
    /// The two do not slip on each other.
    Rolling,
    /// The part slides along the disk.
    Sliding {
        /// µ_c.
        friction: T,
        /// Where the part slides.
        slip: Slip,
    },
}

/// Direction in which the part slides on the finger, along the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slip {
    /// Counter-clockwise.
    Forward,
    /// Clockwise.
    Backward,
}

impl Slip {
    /// 1 or −1.
    #[must_use]
    pub fn sign(self) -> f64 {
        match self {
            Self::Forward => 1.0,
            Self::Backward => -1.0,
        }
    }

    /// The direction of a number's sign.
    pub(super) fn of(value: f64) -> Self {
        if value < 0.0 { Self::Backward } else { Self::Forward }
    }

    /// The other direction.
    #[must_use]
    pub fn reversed(self) -> Self {
        match self {
            Self::Forward => Self::Backward,
            Self::Backward => Self::Forward,
        }
    }
}

/// State of a pushed part at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct State<T = f64> {
    /// Polar angle of the contact seen from the disk's centre, rad; not wrapped.
    pub u: T,
    /// Place of the contact along the edge, from the foot of the perpendicular through the centre of mass, m.
    pub s: T,
    /// Angular velocity of the part, rad/s.
    pub omega: T,
    /// Velocity of the centre of mass along T = (−sin u, cos u), m/s. In rolling it follows from the rest.
    pub v_t: T,
}

/// A part pushed at one of its edges. Parameters of type `T` can carry derivatives.
#[derive(Clone, Copy, Debug)]
pub struct PushModel<'p, T = f64> {
    /// The part.
    pub part: &'p Part,
    /// The edge in contact.
    pub edge: Edge,
    /// µ g: what support friction decelerates a sliding part by, m/s².
    pub grip: T,
    /// The finger and its motion.
    pub finger: Finger<T>,
}

/// Why a model cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// The polygon has fewer edges.
    #[error("{index} is no edge of a polygon with {edges}: edges count from 0 to {}", edges - 1)]
    NoSuchEdge {
        /// The edge asked for.
        index: usize,
        /// How many there are.
        edges: usize,
    },
}
