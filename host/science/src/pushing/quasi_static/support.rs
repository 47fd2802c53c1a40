//! What a part stands on: how the plane resists its motion, and how its load spreads.
//!
//! The load is known by `λ = (a, S⁻ᵀ b)`: a foot, or a bit of the face, bears `g·w·max(0, λ·y)` with
//! `y = (1, S (p − p̄))`; `S` scales by the part's size, or so that feet near one line are spread as others. Friction of a
//! motion is linear in `λ` as long as the same feet bear load, which is why [`Ground::loaded`] finds load and force
//! together: of `L λ = (1, S (c − p̄ + h F/g))` with `L = Σ w y yᵀ` and `F = P λ` it solves
//! `(L − h E S P) λ = (1, S (c − p̄))` by Newton's method, which is exact once the right feet bear load.
//!
//! Implements: dissipation `D(v, ω) = Σ µᵢ Nᵢ √(|v + ω × pᵢ|² + e²ω²)` and its gradient, the force on the part.
//! Assumes: Coulomb friction.
//! Frames: part axes, origin at the supports' centre `p̄`. Units: SI; forces per weight.
//! Errors: none; where no load fits, none is found.

use nalgebra::{Cholesky, Matrix2, Matrix3, Point2, Vector2, Vector3};

use super::held::{HeldFeet, HeldFoot};
use super::pressure::Face;
use crate::geometry::SimplePolygon;
use crate::pushing::dynamics::Body;
use crate::pushing::dynamics::support::{SupportFriction, Twist};

/// The smallest ring a foot stands on, in sizes of the part. A ring of none is taken for this: the motion differs by
/// this much of the part's size in a turn of 1 rad at most, and where a foot at rest leaves the force open, the limit
/// of small rings is what is asked for. Much smaller rings would cost digits of the force: speeds are rounded to 1e-16.
const RING_LEAST: f64 = 1e-8;

/// A load is found when it moves by less than this share.
const LOAD_FOUND: f64 = 1e-13;

/// A last step of this share of the slowest foot's speed leaves an error of its square.
const LAST_STEP: f64 = 1e-7;

/// Feet nearer to one line than this, in sizes of the part, are on it.
const ON_LINE: f64 = 1e-9;

/// A misfit of this share that no step lessens is rounding.
const LOAD_ROUNDING: f64 = 1e-12;

/// Looks for a load: three are usual.
const LOAD_LOOKS: usize = 60;

/// Halvings of a step towards a load before it counts as failed.
const LOAD_HALVINGS: usize = 12;

/// A point that a part stands on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Foot {
    /// Part frame, m.
    pub at: Point2<f64>,
    /// Share of the weight while nothing pushes.
    pub share: f64,
    /// Friction against the plane.
    pub friction: f64,
}

/// What a part stands on.
#[derive(Clone, Debug, PartialEq)]
pub enum Support {
    /// Feet, each a ring.
    Feet {
        /// At least one.
        feet: Vec<Foot>,
        /// Radius of the ring, m.
        ring_radius: f64,
    },
    /// The whole outline, evenly.
    Uniform {
        /// Friction against the plane.
        friction: f64,
    },
}

impl Support {
    /// What a body stands on, with this friction against the plane: its feet as rings of this radius (m), or its whole
    /// outline.
    #[must_use]
    pub fn of(body: &Body, friction: f64, ring_radius: f64) -> Self {
        let foot = |(at, share)| Foot { at, share, friction };
        match body.feet() {
            Some(feet) => Self::Feet { feet: feet.map(foot).collect(), ring_radius },
            None => Self::Uniform { friction },
        }
    }

    /// Where its load is centred while nothing pushes, part frame, m.
    pub(super) fn centre(&self, outline: &SimplePolygon) -> Point2<f64> {
        match self {
            Self::Uniform { .. } => outline.centroid(),
            Self::Feet { feet, .. } => {
                let weight: f64 = feet.iter().map(|foot| foot.share).sum();
                Point2::from(feet.iter().map(|foot| foot.at.coords * foot.share).sum::<Vector2<f64>>() / weight)
            }
        }
    }

    /// Whether feet that bear load are on one line, to rounding of a part of this size (m).
    pub(super) fn is_on_a_line(&self, size: f64) -> bool {
        let Self::Feet { feet, .. } = self else { return false };
        let standing: Vec<_> = feet.iter().filter(|foot| foot.share > 0.0).map(|foot| foot.at).collect();
        let Some(first) = standing.first() else { return true };
        let apart = |foot: &&Point2<f64>| (*foot - first).norm();
        let Some(far) = standing.iter().max_by(|a, b| apart(a).total_cmp(&apart(b))) else { return true };
        let along = far - first;
        standing.iter().all(|foot| along.perp(&(foot - first)).abs() <= ON_LINE * size * along.norm())
    }

    /// The largest coefficient of friction: 0 where nothing resists.
    pub(super) fn friction_max(&self) -> f64 {
        match self {
            Self::Uniform { friction } => *friction,
            Self::Feet { feet, .. } => {
                feet.iter().filter(|foot| foot.share > 0.0).map(|foot| foot.friction).fold(0.0, f64::max)
            }
        }
    }
}

/// Friction of one motion under one load, and how both enter it. Rows: force x, force y, moment.
#[derive(Clone, Copy, Debug)]
pub(super) struct Resistance {
    /// By the load `λ`: the friction is this times `λ`.
    pub(super) by_load: Matrix3<f64>,
    /// By the twist.
    pub(super) by_twist: Matrix3<f64>,
    /// `Σ w y yᵀ` over what bears load: times `λ` it is the load's sum and its first moments.
    pub(super) weighing: Matrix3<f64>,
    /// The slowest foot's speed, m/s: over changes of its velocity by this much friction turns round.
    pub(super) slowest: f64,
}

impl Resistance {
    pub(super) fn nothing() -> Self {
        let none = Matrix3::zeros();
        Self { by_load: none, by_twist: none, weighing: none, slowest: f64::INFINITY }
    }

    /// Adds a ring: `friction` is its share times the coefficient, `bears` that times its load.
    #[inline]
    fn add(
        &mut self,
        twist: &Vector3<f64>,
        at: Vector2<f64>,
        ring_squared: f64,
        friction: f64,
        bears: f64,
        y: &Vector3<f64>,
    ) {
        let velocity = Vector2::new(twist.x - twist.z * at.y, twist.y + twist.z * at.x);
        let speed = (velocity.norm_squared() + ring_squared * twist.z * twist.z).sqrt();
        if speed == 0.0 {
            return;
        }
        self.slowest = self.slowest.min(speed);
        let force = velocity / speed;
        let direction = Vector3::new(force.x, force.y, at.perp(&force) + ring_squared * twist.z / speed);
        self.by_load += direction * (y * friction).transpose();
        let metric = Matrix3::new(
            1.0,
            0.0,
            -at.y, //
            0.0,
            1.0,
            at.x, //
            -at.y,
            at.x,
            at.norm_squared() + ring_squared,
        );
        self.by_twist += (metric - direction * direction.transpose()) * (bears / speed);
    }
}

/// A foot seen from the supports' centre.
#[derive(Clone, Copy, Debug)]
struct Standing {
    at: Vector2<f64>,
    y: Vector3<f64>,
    share: f64,
    friction: f64,
}

/// What a load weighs, `Σ w y yᵀ`, if all feet bear.
fn weighing(feet: &[Standing]) -> Matrix3<f64> {
    feet.iter().map(|foot| foot.y * (foot.y * foot.share).transpose()).sum()
}

/// What resists motions under loads that are given.
#[derive(Clone, Debug)]
enum Held {
    Feet {
        feet: HeldFeet,
        /// The inverse of what a load weighs; none for feet on one line.
        spread: Option<Matrix3<f64>>,
    },
    /// As it resists others.
    Face,
}

/// A support ready to resist.
#[derive(Clone, Debug)]
pub(super) struct Ground {
    kind: Kind,
    /// The supports' centre `p̄`, part frame, m.
    pub(super) centre: Point2<f64>,
    /// The part's size `ρ`, m.
    pub(super) size: f64,
    /// `(1, S (c − p̄))`.
    weight: Vector3<f64>,
    /// `S`, 1/m.
    #[cfg(test)]
    scale: Matrix2<f64>,
    /// `h S`.
    lift: Matrix2<f64>,
    /// Whether the contact is above the plane.
    lifts: bool,
    /// The largest coefficient: what forces are compared with.
    pub(super) friction: f64,
    /// Radius of the feet's rings, m.
    ring: f64,
    /// Set where a motion is found under the load it is looked for from, and not under that which its own force makes.
    held: Option<Held>,
    /// A last step of this share of the slowest foot's speed ends the search for a motion; its error is the square.
    pub(super) last_step: f64,
}

#[derive(Clone, Debug)]
enum Kind {
    Feet(Vec<Standing>),
    /// Without height.
    Even(Box<SupportFriction>),
    Face(Face),
}

/// Friction of a motion with the load that goes with it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loaded {
    /// Force and moment about the supports' centre, per weight.
    pub(super) wrench: Vector3<f64>,
    /// Its derivatives by the twist, the load's change included.
    pub(super) gradient: Matrix3<f64>,
    /// The load `λ`.
    pub(super) load: Vector3<f64>,
    /// See [`Resistance::slowest`].
    pub(super) slowest: f64,
}

/// The load while nothing pushes and the centre of mass is where the supports put it.
pub(super) const EVEN: Vector3<f64> = Vector3::new(1.0, 0.0, 0.0);

impl Ground {
    /// With the contact at `height` (m) and the centre of mass at `centre_of_mass` (part frame), or where the support
    /// puts it.
    pub(super) fn new(
        support: &Support,
        outline: &SimplePolygon,
        height: f64,
        centre_of_mass: Option<Point2<f64>>,
    ) -> Self {
        let centre = support.centre(outline);
        let size = outline.vertices().iter().map(|p| (p - centre).norm()).fold(0.0, f64::max);
        let scale = match support {
            Support::Feet { feet, .. } => spread(feet, centre),
            Support::Uniform { .. } => None,
        };
        let scale = scale.unwrap_or(Matrix2::identity() / size);
        let offset = centre_of_mass.map_or(Vector2::zeros(), |c| scale * (c - centre));
        let (kind, ring) = match support {
            Support::Feet { feet, ring_radius } => {
                let standing = feet.iter().filter(|foot| foot.share > 0.0).map(|foot| {
                    let at = foot.at - centre;
                    let y = scale * at;
                    let y = Vector3::new(1.0, y.x, y.y);
                    Standing { at, y, share: foot.share, friction: foot.friction }
                });
                (Kind::Feet(standing.collect()), ring_radius.max(RING_LEAST * size))
            }
            Support::Uniform { .. } if height == 0.0 => {
                (Kind::Even(Box::new(SupportFriction::uniform(outline).with_origin(centre))), 0.0)
            }
            Support::Uniform { .. } => {
                let vertices = outline.vertices().iter().map(|p| p - centre).collect();
                (Kind::Face(Face::new(vertices, outline.area(), size)), 0.0)
            }
        };
        Self {
            kind,
            centre,
            size,
            weight: Vector3::new(1.0, offset.x, offset.y),
            #[cfg(test)]
            scale,
            lift: scale * height,
            lifts: height > 0.0,
            friction: support.friction_max(),
            ring,
            held: None,
            last_step: LAST_STEP,
        }
    }

    /// The same for coarse steps: the load is that of the step before, and motions are found to `last_step`.
    pub(super) fn coarse(self, last_step: f64) -> Self {
        let held = match &self.kind {
            Kind::Feet(feet) => {
                let foot = |foot: &Standing| HeldFoot { at: foot.at, y: foot.y, friction: foot.share * foot.friction };
                Held::Feet {
                    feet: HeldFeet::new(feet.iter().map(foot), self.ring),
                    spread: weighing(feet).try_inverse(),
                }
            }
            Kind::Even(_) | Kind::Face(_) => Held::Face,
        };
        Self { held: Some(held), last_step, ..self }
    }

    /// The load under a force (per weight) on the contact; none for feet on one line.
    ///
    /// Feet that would have to be held down bear nothing in [`Ground::loaded`]; what they would bear is not spread anew.
    pub(super) fn load_under(&self, force: Vector2<f64>) -> Option<Vector3<f64>> {
        let Kind::Feet(feet) = &self.kind else { return Some(EVEN) };
        let lifted = self.lift * force;
        let spread = match &self.held {
            Some(Held::Feet { spread, .. }) => *spread,
            Some(Held::Face) | None => weighing(feet).try_inverse(),
        };
        match spread {
            Some(inverse) => Some(inverse * (self.weight + Vector3::new(0.0, lifted.x, lifted.y))),
            // On one line, or on one foot, nothing else can be while the push is in the plane.
            None => (!self.lifts).then_some(EVEN),
        }
    }

    /// The same with a share of the height, and rings not smaller than a share of the part's size.
    pub(super) fn eased(&self, share: f64, ring: f64) -> Self {
        Self {
            lift: self.lift * share,
            lifts: self.lifts && share > 0.0,
            ring: self.ring.max(ring * self.size),
            // Made for other rings.
            held: None,
            ..self.clone()
        }
    }

    /// Whether the contact is above the plane.
    pub(super) fn is_lifted(&self) -> bool {
        self.lifts
    }

    /// Whether rings are so small that a foot may as well rest.
    pub(super) fn feet_may_rest(&self) -> bool {
        matches!(self.kind, Kind::Feet(_)) && self.ring < 1e-3 * self.size
    }

    /// The foot nearest to the centre of rotation, and the ring about it, m.
    pub(super) fn slowest_foot(&self, twist: &Vector3<f64>) -> Option<(Vector2<f64>, f64)> {
        let Kind::Feet(feet) = &self.kind else { return None };
        let pole = Vector2::new(-twist.y, twist.x) / twist.z;
        let nearest = feet.iter().min_by(|a, b| (a.at - pole).norm_squared().total_cmp(&(b.at - pole).norm_squared()));
        nearest.map(|foot| (foot.at, self.ring))
    }

    /// The least load on a foot of a support that cannot spread its load in more than one way, per its share.
    ///
    /// Three feet bear what they must, or the part tips; with more, others take over.
    pub(super) fn load_least(&self, load: &Vector3<f64>) -> f64 {
        match &self.kind {
            Kind::Feet(feet) if self.lifts && feet.len() <= 3 => {
                feet.iter().map(|foot| foot.y.dot(load)).fold(f64::INFINITY, f64::min)
            }
            _ => 1.0,
        }
    }

    /// The load as constant and slope along both axes of the part: 1, 1/m, 1/m.
    #[cfg(test)]
    pub(super) fn load_in_metres(&self, load: &Vector3<f64>) -> [f64; 3] {
        let slope = self.scale.transpose() * Vector2::new(load.y, load.z);
        [load.x, slope.x, slope.y]
    }

    fn resistance(&self, twist: &Vector3<f64>, load: &Vector3<f64>) -> Resistance {
        match &self.kind {
            Kind::Feet(feet) => {
                let mut resistance = Resistance::nothing();
                let spares = self.lifts && feet.len() > 3;
                for foot in feet {
                    let bears = foot.y.dot(load);
                    if spares && bears <= 0.0 {
                        continue;
                    }
                    let friction = foot.share * foot.friction;
                    resistance.add(twist, foot.at, self.ring * self.ring, friction, friction * bears, &foot.y);
                    if self.lifts {
                        resistance.weighing += foot.y * (foot.y * foot.share).transpose();
                    }
                }
                resistance
            }
            Kind::Even(even) => {
                let motion = Twist::new(Vector2::new(twist.x, twist.y), twist.z);
                let (sliding, gradient) = even.mean_sliding_and_gradient(&motion);
                let mut resistance = Resistance::nothing();
                let wrench = Vector3::new(sliding.direction.x, sliding.direction.y, sliding.moment);
                resistance.by_load.set_column(0, &(wrench * self.friction));
                resistance.by_twist = gradient * self.friction;
                resistance
            }
            Kind::Face(face) => {
                let mut resistance = face.resistance(twist, load);
                resistance.by_load *= self.friction;
                resistance.by_twist *= self.friction;
                resistance
            }
        }
    }

    /// Friction of a motion with its load, looked for from the load `near`; none where no load fits.
    pub(super) fn loaded(&self, twist: &Vector3<f64>, near: &Vector3<f64>) -> Option<Loaded> {
        match &self.held {
            Some(Held::Feet { feet, .. }) => return Some(feet.loaded(twist, near)),
            Some(Held::Face) => return Some(self.under(twist, near)),
            None => {}
        }
        if !self.lifts {
            let resistance = self.resistance(twist, &EVEN);
            let wrench = resistance.by_load.column(0).into();
            return Some(Loaded { wrench, gradient: resistance.by_twist, load: EVEN, slowest: resistance.slowest });
        }
        let mut load = *near;
        let mut resistance = self.resistance(twist, &load);
        let mut system = self.system(&resistance);
        let mut misfit = (system * load - self.weight).norm();
        for _ in 0..LOAD_LOOKS {
            let step = system.try_inverse()? * self.weight - load;
            if step.norm() <= LOAD_FOUND * (1.0 + load.norm()) {
                return self.found(&resistance, &system, load);
            }
            let mut share = 1.0;
            let mut taken = false;
            for _ in 0..LOAD_HALVINGS {
                let tried = load + step * share;
                let resisting = self.resistance(twist, &tried);
                let trial = self.system(&resisting);
                let left = (trial * tried - self.weight).norm();
                if left < misfit || left <= LOAD_FOUND {
                    (load, resistance, system, misfit) = (tried, resisting, trial, left);
                    taken = true;
                    break;
                }
                share *= 0.5;
            }
            if !taken {
                // What is left may be rounding.
                return (misfit <= LOAD_ROUNDING * (1.0 + load.norm()))
                    .then(|| self.found(&resistance, &system, load))?;
            }
        }
        None
    }

    /// Friction of a motion under a given load.
    fn under(&self, twist: &Vector3<f64>, load: &Vector3<f64>) -> Loaded {
        let resistance = self.resistance(twist, load);
        let wrench = resistance.by_load * load;
        Loaded { wrench, gradient: resistance.by_twist, load: *load, slowest: resistance.slowest }
    }

    /// Friction, and how it changes with the twist, its load with it.
    fn found(&self, resistance: &Resistance, system: &Matrix3<f64>, load: Vector3<f64>) -> Option<Loaded> {
        let forces = resistance.by_twist.fixed_rows::<2>(0);
        let mut pushes = Matrix3::zeros();
        pushes.fixed_rows_mut::<2>(1).copy_from(&(self.lift * forces));
        // How the load goes with the twist, and friction with the load.
        let gradient = resistance.by_twist + resistance.by_load * (system.try_inverse()? * pushes);
        Some(Loaded { wrench: resistance.by_load * load, gradient, load, slowest: resistance.slowest })
    }

    /// `L − h E S P`.
    fn system(&self, resistance: &Resistance) -> Matrix3<f64> {
        let mut system = resistance.weighing;
        let pushes = self.lift * resistance.by_load.fixed_rows::<2>(0);
        for row in 0..2 {
            for column in 0..3 {
                system[(row + 1, column)] -= pushes[(row, column)];
            }
        }
        system
    }
}

/// What scales places so that feet are spread alike in all directions, 1/m; none for feet on one line.
fn spread(feet: &[Foot], centre: Point2<f64>) -> Option<Matrix2<f64>> {
    let weight: f64 = feet.iter().map(|foot| foot.share).sum();
    let squares = feet.iter().map(|foot| (foot.at - centre) * (foot.at - centre).transpose() * (foot.share / weight));
    Cholesky::new(squares.sum())?.l().try_inverse()
}
