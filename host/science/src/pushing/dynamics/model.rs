//! What the motion of a pushed part depends on: part, contact edge, finger, and how they touch.
//!
//! Implements: the disk and the polygon of thesis §5.2.1, with the centre of mass and the inertia left free (§8.2.2).
//! Assumes: one disk touches one edge; the disk translates and does not turn; the pressure on the plane does not
//! change.
//! Frames: `part` (as the polygon was given), `edge` (part's axes turned so that x is the edge's outward normal and y
//! its counter-clockwise direction; origin at the centre of mass), `world`. Units: SI, per unit mass where named so.
//! Errors: [`ModelError`] for an edge that the polygon does not have.

use nalgebra::{Matrix2, Point2, Vector2};

use super::body::{Body, Mass};
use super::curve::PartSide;
use super::scalar::Scalar;
use super::support::SupportFriction;
use crate::geometry::{SimplePolygon, corners};

/// A part on its plane: outline, mass and what it rests on.
///
/// Mostly a polygon. An ellipse has no edges: who works with edges finds none of it, and where a finger touches it says
/// [`Part::touched`].
///
/// ```
/// use nalgebra::Point2;
/// use palpate::{Part, SimplePolygon};
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// assert!((part.inertia_per_mass() - (0.06_f64.powi(2) + 0.04_f64.powi(2)) / 12.0).abs() < 1e-15); // m²
/// assert!((part.edge(1)?.height - 0.03).abs() < 1e-15); // m from the centre of mass to the edge
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Part {
    polygon: SimplePolygon,
    /// The corners of the outline, by their vertices' numbers.
    corners: Vec<usize>,
    /// Semi-axes of an elliptic outline about the part frame's origin, m: `polygon` then is drawn in it.
    semi_axes: Option<[f64; 2]>,
    body: Body,
}

/// Corners of the polygon that is drawn in an elliptic outline: its sides are within 2e-4 of a semi-axis of it.
const ELLIPSE_CORNERS: u32 = 180;

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
        let body = Body::uniform(SupportFriction::uniform(&polygon), mass);
        Self::of(polygon, body)
    }

    /// A part on feet: points in the part's frame, m, each with its share of the weight. See [`Body::on_feet`].
    #[must_use]
    pub fn on_feet(polygon: SimplePolygon, feet: &[(Point2<f64>, f64)], mass: Mass) -> Self {
        Self::of(polygon, Body::on_feet(feet, mass))
    }

    /// The same with another outline, of which the edges mostly are where they were: a base that bears everywhere follows it,
    /// feet stay; the mass becomes that of a uniform plate, or stays.
    #[must_use]
    pub fn with_outline(&self, polygon: SimplePolygon, mass_follows: bool) -> Self {
        let mass = if mass_follows { Mass::uniform(&polygon) } else { self.body.mass() };
        let body = self.body.feet().map_or_else(
            || Body::uniform(SupportFriction::uniform(&polygon), mass),
            |feet| Body::on_feet(&feet.collect::<Vec<_>>(), mass),
        );
        Self::of(polygon, body)
    }

    /// The same outline with its mass and the middle of its pressure moved (m), and its pressure stretched about that
    /// middle: feet move, a base that bears everywhere bears over what its outline is stretched to.
    ///
    /// What pressure resists by turning and along each axis is changed by a stretch as by any pressure that lies as much
    /// nearer to its middle, or further from it.
    #[must_use]
    pub fn redistributed(
        &self,
        mass_moved: Vector2<f64>,
        pressure_moved: Vector2<f64>,
        stretch: &Matrix2<f64>,
    ) -> Self {
        let mass = Mass { centre_of_mass: self.centre_of_mass() + mass_moved, ..self.body.mass() };
        let middle = self.body.centre_of_pressure();
        let moved = |at: Point2<f64>| middle + stretch * (at - middle) + pressure_moved;
        let body = self.body.feet().map_or_else(
            || {
                let vertices = self.polygon.vertices().iter().map(|vertex| moved(*vertex));
                // A stretch keeps what crosses and what does not; one that loses all to rounding changes nothing.
                let base = SimplePolygon::new(vertices.collect::<Vec<_>>()).unwrap_or_else(|_| self.polygon.clone());
                Body::uniform(SupportFriction::uniform(&base), mass)
            },
            |feet| Body::on_feet(&feet.map(|(at, share)| (moved(at), share)).collect::<Vec<_>>(), mass),
        );
        Self { body, ..self.clone() }
    }

    fn of(polygon: SimplePolygon, body: Body) -> Self {
        let corners = corners(polygon.vertices());
        Self { polygon, corners, semi_axes: None, body }
    }

    /// A part with an elliptic outline about its frame's origin, semi-axes along x and y, m.
    ///
    /// # Panics
    /// If a semi-axis is not a positive number.
    #[must_use]
    pub fn elliptic(semi_axes: [f64; 2], body: Body) -> Self {
        let [a, b] = semi_axes;
        let at = |i: u32| f64::from(i) * std::f64::consts::TAU / f64::from(ELLIPSE_CORNERS);
        let drawn = (0..ELLIPSE_CORNERS).map(|i| Point2::new(a * at(i).cos(), b * at(i).sin())).collect::<Vec<_>>();
        let drawn = SimplePolygon::new(drawn);
        let Ok(polygon) = drawn else { panic!("semi-axes {semi_axes:?} m must be positive and finite") };
        Self { polygon, corners: Vec::new(), semi_axes: Some(semi_axes), body }
    }

    /// The semi-axes of an elliptic outline about the part frame's origin, along x and y, m; none of a polygon.
    #[must_use]
    pub fn semi_axes(&self) -> Option<[f64; 2]> {
        self.semi_axes
    }

    /// An elliptic part with other semi-axes (m); its mass becomes that of a uniform plate, or stays.
    fn with_semi_axes(&self, semi_axes: [f64; 2], mass_follows: bool) -> Self {
        let mass = if mass_follows { Mass::of_ellipse(semi_axes) } else { self.body.mass() };
        let body = self.body.feet().map_or_else(
            || Body::uniform(SupportFriction::ellipse(semi_axes), mass),
            |feet| Body::on_feet(&feet.collect::<Vec<_>>(), mass),
        );
        Self::elliptic(semi_axes, body)
    }

    /// How many numbers say how far an outline is off: an edge's line along its normal each, or a semi-axis.
    #[must_use]
    pub fn outline_numbers(&self) -> usize {
        if self.semi_axes.is_some() { 2 } else { self.polygon.vertices().len() }
    }

    /// The same with its outline off by each of these numbers, m; none where edges then cross.
    #[must_use]
    pub fn with_outline_off(&self, off: impl Fn(usize) -> f64, mass_follows: bool) -> Option<Self> {
        match self.semi_axes {
            None => Some(self.with_outline(self.polygon.with_edges_moved(off)?, mass_follows)),
            Some([a, b]) => {
                let moved = [a + off(0), b + off(1)];
                moved.iter().all(|axis| *axis > 0.0).then(|| self.with_semi_axes(moved, mass_follows))
            }
        }
    }

    /// Where a finger may touch it: the number of each straight side's first edge, or 0 of an ellipse.
    pub fn touchable(&self) -> impl Iterator<Item = usize> + '_ {
        self.corners.iter().copied().chain(self.semi_axes.map(|_| 0))
    }

    /// The outline at one of [`Self::touchable`], or at any edge.
    ///
    /// # Errors
    /// [`ModelError::NoSuchEdge`].
    pub fn touched(&self, index: usize) -> Result<PartSide, ModelError> {
        match self.semi_axes {
            Some(semi_axes) if index == 0 => Ok(PartSide::Ellipse { semi_axes, middle: -self.centre_of_mass().coords }),
            _ => self.edge(index).map(PartSide::Edge),
        }
    }

    /// The outline, part frame; of an ellipse a polygon of many corners drawn in it.
    #[must_use]
    pub fn polygon(&self) -> &SimplePolygon {
        &self.polygon
    }

    /// Mass distribution and support of the part.
    #[must_use]
    pub fn body(&self) -> &Body {
        &self.body
    }

    /// The centre of mass, part frame, m.
    #[must_use]
    pub fn centre_of_mass(&self) -> Point2<f64> {
        self.body.centre_of_mass()
    }

    /// ρ², m²: see [`Mass`].
    #[must_use]
    pub fn inertia_per_mass(&self) -> f64 {
        self.body.inertia_per_mass()
    }

    /// An edge as seen from the centre of mass, as far as it goes straight on: neighbours that are straight to within the
    /// tolerances of [`corners`] are one.
    ///
    /// # Errors
    /// [`ModelError::NoSuchEdge`]; [`ModelError::NoEdges`] of an ellipse.
    pub fn edge(&self, index: usize) -> Result<Edge, ModelError> {
        if self.semi_axes.is_some() {
            return Err(ModelError::NoEdges);
        }
        let edges = self.polygon.vertices().len();
        if index >= edges {
            return Err(ModelError::NoSuchEdge { index, edges });
        }
        Ok(self.edge_between(self.side_of(index)))
    }

    /// Each straight side once: the number of its first edge, and the side as [`Self::edge`] gives it.
    pub fn sides(&self) -> impl ExactSizeIterator<Item = (usize, Edge)> + '_ {
        (0..self.corners.len()).map(|side| (self.corners[side], self.edge_between(side)))
    }

    /// The ends of each straight side in turn, part frame, m.
    pub(crate) fn side_ends(&self) -> impl ExactSizeIterator<Item = [Point2<f64>; 2]> + '_ {
        (0..self.corners.len()).map(|side| self.ends(side))
    }

    /// The first edge of the straight side that an edge belongs to: what [`Self::sides`] numbers it by.
    #[must_use]
    pub fn side(&self, index: usize) -> usize {
        if self.semi_axes.is_some() {
            return index;
        }
        self.corners[self.side_of(index)]
    }

    /// The vertices between which the straight side of an edge runs, counter-clockwise.
    #[must_use]
    pub fn side_vertices(&self, index: usize) -> [usize; 2] {
        let side = self.side_of(index);
        [self.corners[side], self.corners[(side + 1) % self.corners.len()]]
    }

    /// Where the two vertices of an edge lie on its straight side: s, m.
    ///
    /// # Errors
    /// [`ModelError::NoSuchEdge`].
    pub fn edge_span(&self, index: usize) -> Result<[f64; 2], ModelError> {
        let edge = self.edge(index)?;
        let ends = [index, (index + 1) % self.polygon.vertices().len()];
        Ok(ends.map(|vertex| self.place_of(vertex, &edge).clamp(edge.s_min, edge.s_max)))
    }

    /// Of the edges that make one straight side with `index`, the one that holds the place `s` (m) on it; beyond its
    /// ends the outermost.
    #[must_use]
    pub fn edge_at(&self, index: usize, s: f64) -> usize {
        if self.semi_axes.is_some() {
            return index;
        }
        let n = self.polygon.vertices().len();
        let [first, next] = self.side_vertices(index);
        let edge = self.edge_between(self.side_of(index));
        let flat = (1..(next + n - first) % n).map(|step| (first + step) % n);
        flat.take_while(|vertex| self.place_of(*vertex, &edge) <= s).last().unwrap_or(first)
    }

    /// Where a vertex lies along a straight side: s, m.
    fn place_of(&self, vertex: usize, side: &Edge) -> f64 {
        let along = Vector2::new(-side.normal.y, side.normal.x);
        along.dot(&(self.polygon.vertices()[vertex] - self.centre_of_mass()))
    }

    /// The straight side that an edge belongs to.
    fn side_of(&self, index: usize) -> usize {
        // Before the first corner the last side goes on.
        self.corners.partition_point(|corner| *corner <= index).checked_sub(1).unwrap_or(self.corners.len() - 1)
    }

    fn ends(&self, side: usize) -> [Point2<f64>; 2] {
        [side, (side + 1) % self.corners.len()].map(|side| self.polygon.vertices()[self.corners[side]])
    }

    fn edge_between(&self, side: usize) -> Edge {
        let [start, end] = self.ends(side);
        let centre_of_mass = self.centre_of_mass();
        let (from, to) = (start - centre_of_mass, end - centre_of_mass);
        let direction = (to - from).normalize();
        let normal = Vector2::new(direction.y, -direction.x);
        Edge { normal, height: normal.dot(&from), s_min: direction.dot(&from), s_max: direction.dot(&to) }
    }

    /// How the support slides, in edge axes about the centre of mass: friction on the part per unit mass is −µg times
    /// that.
    #[inline]
    pub(super) fn sliding<T: Scalar>(&self, edge: &Edge, twist: EdgeTwist<T>) -> EdgeTwist<T> {
        let (x, y) = (edge.normal.x, edge.normal.y);
        let twist_body = [twist.normal * x - twist.along * y, twist.normal * y + twist.along * x, twist.turn];
        let [d_x, d_y, turn] = self.body.sliding(twist_body);
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

/// The contact seen from the centre of mass, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arm<T = f64> {
    /// Along the part's outward normal: h of an edge.
    pub(super) height: T,
    /// Along the part's counter-clockwise direction: s of an edge.
    pub(super) along: T,
}

/// A parabola on which a finger translates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FingerPath<T: nalgebra::Scalar = f64> {
    /// The finger's own point at t = 0 (the centre of a disk or an ellipse, a point on a line), world axes, m.
    pub centre0: Point2<f64>,
    /// Velocity at t = 0, world axes, m/s.
    pub velocity0: Vector2<T>,
    /// Acceleration a_F, world axes, m/s².
    pub acceleration: Vector2<T>,
}

impl FingerPath {
    /// The finger's own point at time `t` (s), m.
    #[must_use]
    pub fn centre(&self, t: f64) -> Point2<f64> {
        self.centre0 + self.velocity0 * t + self.acceleration * (0.5 * t * t)
    }
}

impl<T: Scalar> FingerPath<T> {
    /// The velocity at time `t` (s), m/s.
    #[must_use]
    pub fn velocity(&self, t: f64) -> Vector2<T> {
        self.velocity0.zip_map(&self.acceleration, |velocity, acceleration| velocity + acceleration * t)
    }
}

/// A disk that translates on a parabola and never turns.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::Finger;
///
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::new(0.0, 0.02)); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// assert!((finger.centre(2.0).y - (0.05 * 2.0 + 0.02 * 2.0)).abs() < 1e-15); // m
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Finger<T: nalgebra::Scalar = f64> {
    /// Radius r of the disk, m.
    pub radius: f64,
    /// Centre at t = 0, world axes, m.
    pub centre0: Point2<f64>,
    /// Velocity at t = 0, world axes, m/s.
    pub velocity0: Vector2<T>,
    /// Acceleration a_F, world axes, m/s².
    pub acceleration: Vector2<T>,
}

impl Finger {
    /// The centre at time `t` (s), m.
    #[must_use]
    pub fn centre(&self, t: f64) -> Point2<f64> {
        self.path().centre(t)
    }
}

impl<T: nalgebra::Scalar + Copy> Finger<T> {
    /// Path of the finger's centre, world.
    #[must_use]
    pub fn path(&self) -> FingerPath<T> {
        FingerPath { centre0: self.centre0, velocity0: self.velocity0, acceleration: self.acceleration }
    }
}

impl<T: Scalar> Finger<T> {
    /// The velocity at time `t` (s), m/s.
    #[must_use]
    pub fn velocity(&self, t: f64) -> Vector2<T> {
        self.velocity0.zip_map(&self.acceleration, |velocity, acceleration| velocity + acceleration * t)
    }
}

/// How finger and part touch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ContactMode<T = f64> {
    /// Without friction between finger and part.
    Frictionless,
    /// The two do not slip on each other.
    Rolling,
    /// The part slides along the disk.
    Sliding {
        /// µ_c, between finger and part.
        friction: T,
        /// Where the part slides.
        slip: Slip,
    },
}

impl<T: Scalar> ContactMode<T> {
    /// m = µ_c times the sign of the slip: tangential over normal force on the part, but for the sign; none where
    /// nothing slips.
    #[inline]
    pub(crate) fn signed_friction(&self) -> Option<T> {
        match *self {
            Self::Frictionless => Some(T::from(0.0)),
            Self::Sliding { friction, slip } => Some(friction * slip.sign()),
            Self::Rolling => None,
        }
    }

    /// The same in other numbers.
    pub(crate) fn map<U>(&self, convert: impl Fn(T) -> U) -> ContactMode<U> {
        match *self {
            Self::Frictionless => ContactMode::Frictionless,
            Self::Rolling => ContactMode::Rolling,
            Self::Sliding { friction, slip } => ContactMode::Sliding { friction: convert(friction), slip },
        }
    }
}

/// Direction in which the part slides on the finger, along the edge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Slip {
    /// Counter-clockwise along the part's outline.
    Forward,
    /// Clockwise along the part's outline.
    Backward,
}

impl Slip {
    /// 1 for [`Self::Forward`], −1 for [`Self::Backward`].
    #[must_use]
    pub fn sign(self) -> f64 {
        match self {
            Self::Forward => 1.0,
            Self::Backward => -1.0,
        }
    }

    /// The direction of a slip, or of whatever has its sign; 0 counts as forward.
    #[must_use]
    pub fn of(value: f64) -> Self {
        if value < 0.0 { Self::Backward } else { Self::Forward }
    }

    /// The other of the two directions.
    #[must_use]
    pub fn reversed(self) -> Self {
        match self {
            Self::Forward => Self::Backward,
            Self::Backward => Self::Forward,
        }
    }
}

/// State of a pushed part at one instant.
///
/// ```
/// use palpate::State;
///
/// let state = State { u: 1.5, s: 0.005, omega: 0.0, v_t: 0.0 }; // rad, m, rad/s, m/s
/// assert_ne!(State { s: -0.005, ..state }, state); // as far on the other side of the foot of the perpendicular
/// ```
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

impl<T: Copy> State<T> {
    /// The same in other numbers.
    pub(crate) fn map<U>(&self, convert: impl Fn(T) -> U) -> State<U> {
        State { u: convert(self.u), s: convert(self.s), omega: convert(self.omega), v_t: convert(self.v_t) }
    }
}

/// A part pushed at one of its edges. Parameters of type `T` can carry derivatives.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::{Finger, Part, PushModel, SimplePolygon, State};
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 0.3 * 9.81, finger };
/// let state = State { u: std::f64::consts::FRAC_PI_2, s: 0.0, omega: 0.0, v_t: 0.0 };
/// // The centre of mass is a radius and the edge's height, 2 cm, ahead of the disk's centre.
/// assert!((model.centre_of_mass(0.0, &state).y - 0.03).abs() < 1e-15); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug)]
pub struct PushModel<'p, T: nalgebra::Scalar = f64> {
    /// The part on its plane.
    pub part: &'p Part,
    /// The edge in contact.
    pub edge: Edge,
    /// µ g: what support friction decelerates a sliding part by, m/s².
    pub mu_g: T,
    /// The finger and its motion.
    pub finger: Finger<T>,
}

impl<'p> PushModel<'p> {
    /// The same with numbers that can carry derivatives.
    pub(in crate::pushing) fn lifted<T: Scalar>(&self) -> PushModel<'p, T> {
        let Finger { radius, centre0, velocity0, acceleration } = self.finger;
        let finger =
            Finger { radius, centre0, velocity0: velocity0.map(T::from), acceleration: acceleration.map(T::from) };
        PushModel { part: self.part, edge: self.edge, mu_g: T::from(self.mu_g), finger }
    }
}

/// Why a model cannot be built.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ModelError {
    /// The part is an ellipse.
    #[error("an elliptic part has no edges")]
    NoEdges,
    /// The polygon has fewer edges.
    #[error("{index} is no edge of a polygon with {edges}: edges count from 0 to {}", edges - 1)]
    NoSuchEdge {
        /// The edge asked for.
        index: usize,
        /// How many edges the part has.
        edges: usize,
    },
}
