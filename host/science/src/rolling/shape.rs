//! Smooth convex shapes, described by their support function.
//!
//! The support function `h(n)` is the distance from the origin to the plane that touches the body with outward normal
//! `n`. Extended to all vectors as a function homogeneous of degree 1, its gradient is the point of contact `β(n)` and
//! its Hessian `H(n)`, restricted to the tangent plane, has the two radii of curvature as eigenvalues. Rolling needs no
//! more of a shape than `β`, `H` and, for sensitivities, the slope of `H`.
//!
//! Implements: Schneider, *Convex Bodies*, 2.5; in place of the patches, metric and shape operator of thesis §4.1 and
//! §7.1, which have umbilics and poles.
//! Assumes: `n` of length 1 (the formulas for ellipsoids hold for any length), radii of curvature finite and above 0.
//! Frames: the body's. Units: m. Errors: none here; see [`body`](super::body) for what is refused.

use std::fmt;
use std::sync::Arc;

use nalgebra::{Matrix3, Vector3};

use crate::math::{Algebraic, Jet, Number};

/// A smooth convex shape.
#[derive(Clone, Debug, PartialEq)]
pub enum Shape {
    /// `h = |diag(a) p|`.
    Ellipsoid(Ellipsoid),
    /// `h = |diag(a) p| + e p₃³/|p|² − z_c p₃`.
    Egg(Egg),
    /// `h = r|p| + (Σ (aᵢ pᵢ)⁴)^¼`.
    Rounded(RoundedShape),
    /// Any other smooth strictly convex shape, by a function of its own.
    Custom(Custom),
}

/// An ellipsoid with its axes along the body's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ellipsoid {
    /// Semi-axes along the body axes, m.
    pub semi_axes: [f64; 3],
}

/// An ellipsoid whose ends along the third axis differ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Egg {
    /// Of the ellipsoid that it comes from, m.
    pub semi_axes: [f64; 3],
    /// How much longer the end at +z is, m.
    pub skew: f64,
    /// Where the origin lies on the third axis, from the ellipsoid's centre, m.
    pub origin: f64,
}

/// A body with nearly flat faces: the dual of a superellipsoid of exponent 4/3, rolled out by a ball.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RoundedShape {
    /// Without the ball, m.
    pub semi_axes: [f64; 3],
    /// Radius of the ball, the least radius of curvature, m.
    pub radius: f64,
}

/// A shape known by its support function alone, differentiated automatically.
#[derive(Clone)]
pub struct Custom(Arc<dyn Differentiated>);

/// A support function: homogeneous of degree 1, twice continuously differentiable but at the origin.
///
/// ```
/// use palpate::math::Number;
/// use palpate::rolling::{Custom, Shape, SupportFunction};
///
/// /// A ball of 2 cm.
/// #[derive(Debug)]
/// struct Ball;
///
/// impl SupportFunction for Ball {
///     fn support<T: Number>(&self, [x, y, z]: [T; 3]) -> T {
///         (x * x + y * y + z * z).sqrt() * 0.02
///     }
/// }
///
/// let ball = Shape::Custom(Custom::new(Ball));
/// let normal = nalgebra::Vector3::new(0.6, 0.0, 0.8);
/// assert!((ball.contact(&normal) - normal * 0.02).norm() < 1e-15);
/// ```
pub trait SupportFunction: fmt::Debug + Send + Sync {
    /// Support function `h(p)`, body axes, m.
    fn support<T: Number>(&self, p: [T; 3]) -> T;
}

/// The surface near one contact.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Local {
    /// The point of contact `β`, m.
    pub contact: Vector3<f64>,
    /// `H`: how the contact moves as the normal turns, m. It maps the normal itself to 0.
    pub hessian: Matrix3<f64>,
    /// `d ↦ DH[d] v`: how `H v` changes as the normal turns by `d`, both across the normal, m.
    pub slope: Matrix3<f64>,
}

/// A contact without the root and the quotients that an ellipsoid's takes: `β = point/√square`, `β' = motion/√square³`.
///
/// Formulas that are multiplied out need neither before the end, which shortens the chain of operations that wait for
/// each other in a Runge–Kutta stage. Other shapes have the square 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Scaled {
    pub(super) point: Vector3<f64>,
    pub(super) motion: Vector3<f64>,
    pub(super) square: f64,
}

impl Shape {
    /// The contact and how it moves as the normal turns.
    #[inline(always)]
    pub(super) fn roll_scaled(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> Scaled {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.roll_scaled(normal, turning),
            _ => {
                let (point, motion) = self.roll(normal, turning);
                Scaled { point, motion, square: 1.0 }
            }
        }
    }

    /// The point of contact where the outward normal is `normal`, m.
    #[must_use]
    pub fn contact(&self, normal: &Vector3<f64>) -> Vector3<f64> {
        self.roll(normal, &Vector3::zeros()).0
    }

    /// `h(normal)`: how high the origin is above a plane with this outward normal, m.
    #[must_use]
    pub fn height(&self, normal: &Vector3<f64>) -> f64 {
        self.contact(normal).dot(normal)
    }

    /// The contact `β` and `H·turning`: where it is and where it goes as the normal turns.
    #[inline(always)]
    #[must_use]
    pub fn roll(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.roll(normal, turning),
            Self::Egg(egg) => egg.roll(normal, turning),
            Self::Rounded(rounded) => rounded.roll(normal, turning),
            Self::Custom(Custom(function)) => {
                let Local { contact, hessian, .. } = function.local(normal, turning);
                (contact, hessian * turning)
            }
        }
    }

    /// The surface at `normal`, with the slope of `H·turning`.
    #[inline(always)]
    #[must_use]
    pub fn local(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> Local {
        match self {
            Self::Ellipsoid(ellipsoid) => ellipsoid.local(normal, turning),
            Self::Egg(egg) => egg.local(normal, turning),
            Self::Rounded(rounded) => rounded.local(normal, turning),
            Self::Custom(Custom(function)) => function.local(normal, turning),
        }
    }

    /// [`roll`](Self::roll) with numbers that carry derivatives; `None` for a [`Custom`] shape, which cannot.
    #[must_use]
    pub fn roll_with<T: Algebraic>(&self, normal: [T; 3], turning: [T; 3]) -> Option<([T; 3], [T; 3])> {
        match self {
            Self::Ellipsoid(ellipsoid) => Some(ellipsoid.roll_with(normal, turning)),
            Self::Egg(egg) => Some(egg.roll_with(normal, turning)),
            Self::Rounded(rounded) => Some(rounded.roll_with(normal, turning)),
            Self::Custom(_) => None,
        }
    }

    /// A length to measure others by: the mean of the distances to the touching planes across the three axes, m.
    #[must_use]
    pub fn size(&self) -> f64 {
        let both = |axis: Vector3<f64>| self.height(&axis) + self.height(&-axis);
        (both(Vector3::x()) + both(Vector3::y()) + both(Vector3::z())) / 6.0
    }
}

impl Ellipsoid {
    fn squares(&self) -> Vector3<f64> {
        Vector3::from(self.semi_axes.map(|a| a * a))
    }

    #[inline(always)]
    fn roll(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let Scaled { point, motion, square } = self.roll_scaled(normal, turning);
        let per_h = 1.0 / square.sqrt();
        (point * per_h, motion * (per_h / square))
    }

    #[inline(always)]
    fn roll_scaled(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> Scaled {
        let e = self.squares();
        let point = e.component_mul(normal);
        let square = point.dot(normal);
        let motion = e.component_mul(turning) * square - point * point.dot(turning);
        Scaled { point, motion, square }
    }

    #[inline(always)]
    fn local(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> Local {
        let e = self.squares();
        let w = e.component_mul(normal);
        let per_h = 1.0 / w.dot(normal).sqrt();
        let contact = w * per_h;
        let hessian = (Matrix3::from_diagonal(&e) - contact * contact.transpose()) * per_h;
        let pushed = hessian * turning;
        // DH[d]v = −((β·d) Hv + (β·v) Hd + β (Hv·d)) / h, from differentiating H = (E − ββᵀ)/h.
        let outer = pushed * contact.transpose();
        let slope = -(outer + outer.transpose() + hessian * contact.dot(turning)) * per_h;
        Local { contact, hessian, slope }
    }

    fn roll_with<T: Algebraic>(&self, normal: [T; 3], turning: [T; 3]) -> ([T; 3], [T; 3]) {
        let e = self.semi_axes.map(|a| a * a);
        let w = [0, 1, 2].map(|i| normal[i] * e[i]);
        let per_h = dot(w, normal).sqrt().recip();
        let contact = w.map(|w| w * per_h);
        let along = dot(contact, turning);
        (contact, [0, 1, 2].map(|i| (turning[i] * e[i] - contact[i] * along) * per_h))
    }
}

impl Egg {
    fn ellipsoid(&self) -> Ellipsoid {
        Ellipsoid { semi_axes: self.semi_axes }
    }

    fn roll(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let (contact, moving) = self.ellipsoid().roll(normal, turning);
        (contact + self.skewed_contact(normal), moving + self.skewed_hessian(normal) * turning)
    }

    fn local(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> Local {
        let Local { contact, hessian, slope } = self.ellipsoid().local(normal, turning);
        Local {
            contact: contact + self.skewed_contact(normal),
            hessian: hessian + self.skewed_hessian(normal),
            slope: slope + self.skewed_slope(normal, turning),
        }
    }

    /// Gradient of `e p₃³/|p|² − z_c p₃`.
    fn skewed_contact(&self, p: &Vector3<f64>) -> Vector3<f64> {
        let mut contact = p * (-2.0 * self.skew * p.z.powi(3));
        contact.z += 3.0 * self.skew * p.z * p.z - self.origin;
        contact
    }

    /// Hessian of the same.
    fn skewed_hessian(&self, p: &Vector3<f64>) -> Matrix3<f64> {
        let z = p.z;
        let mut hessian = p * p.transpose() * (8.0 * z.powi(3));
        for i in 0..3 {
            hessian[(i, i)] -= 2.0 * z.powi(3);
            hessian[(2, i)] -= 6.0 * z * z * p[i];
            hessian[(i, 2)] -= 6.0 * z * z * p[i];
        }
        hessian[(2, 2)] += 6.0 * z;
        hessian * self.skew
    }

    /// Slope of the Hessian times `v`, for `v` and the change of `p` across `p`.
    fn skewed_slope(&self, p: &Vector3<f64>, v: &Vector3<f64>) -> Matrix3<f64> {
        let z = p.z;
        let up = Vector3::z();
        let flat = up * (6.0 * v.z) - p * (12.0 * z * v.z) - v * (6.0 * z * z);
        let mut slope = flat * up.transpose() + (p * (8.0 * z.powi(3)) - up * (6.0 * z * z)) * v.transpose();
        slope -= Matrix3::from_diagonal_element(6.0 * z * z * v.z);
        slope * self.skew
    }

    fn roll_with<T: Algebraic>(&self, p: [T; 3], v: [T; 3]) -> ([T; 3], [T; 3]) {
        let (mut contact, mut moving) = self.ellipsoid().roll_with(p, v);
        let (e, z, along) = (self.skew, p[2], dot(p, v));
        let (square, cube) = (z * z, z * z * z);
        for i in 0..3 {
            contact[i] = contact[i] - p[i] * cube * (2.0 * e);
            moving[i] = moving[i] + (cube * (p[i] * along * 8.0 - v[i] * 2.0) - square * p[i] * v[2] * 6.0) * e;
        }
        contact[2] = contact[2] + (square * (3.0 * e) - self.origin);
        moving[2] = moving[2] + (z * v[2] * 6.0 - square * along * 6.0) * e;
        (contact, moving)
    }
}

impl RoundedShape {
    /// `aᵢ⁴`, m⁴.
    fn fourths(&self) -> Vector3<f64> {
        Vector3::from(self.semi_axes.map(|a| a.powi(4)))
    }

    fn roll(&self, p: &Vector3<f64>, v: &Vector3<f64>) -> (Vector3<f64>, Vector3<f64>) {
        let e = self.fourths();
        let squares = e.component_mul(p).component_mul(p);
        let cubes = squares.component_mul(p);
        let q = cubes.dot(p);
        let q3 = 1.0 / (q.sqrt() * q.sqrt().sqrt()); // q^(−¾)
        let contact = p * self.radius + cubes * q3;
        let flat = (squares.component_mul(v) - cubes * (cubes.dot(v) / q)) * (3.0 * q3);
        (contact, (v - p * p.dot(v)) * self.radius + flat)
    }

    fn local(&self, p: &Vector3<f64>, v: &Vector3<f64>) -> Local {
        let e = self.fourths();
        let squares = e.component_mul(p).component_mul(p);
        let cubes = squares.component_mul(p);
        let q = cubes.dot(p);
        let q3 = 1.0 / (q.sqrt() * q.sqrt().sqrt()); // q^(−¾)
        let diagonal = Matrix3::from_diagonal(&squares);
        let ball = (Matrix3::identity() - p * p.transpose()) * self.radius;
        let hessian = ball + (diagonal - cubes * cubes.transpose() / q) * (3.0 * q3);
        // The slope of 3 q^(−¾) (diag(a⁴p²) − c cᵀ/q) v with c = a⁴p³, dq = 4 c·d and dc = 3 diag(a⁴p²) d.
        let (pushed, along) = (squares.component_mul(v), cubes.dot(v) / q);
        let bent = Matrix3::from_diagonal(&e.component_mul(p).component_mul(v)) * 2.0;
        let mixed = pushed * cubes.transpose();
        let flat = bent - (mixed + mixed.transpose() + diagonal * (along * q)) * (3.0 / q)
            + cubes * cubes.transpose() * (7.0 * along / q);
        let slope = flat * (3.0 * q3) - p * v.transpose() * self.radius;
        Local { contact: p * self.radius + cubes * q3, hessian, slope }
    }

    fn roll_with<T: Algebraic>(&self, p: [T; 3], v: [T; 3]) -> ([T; 3], [T; 3]) {
        let e = self.fourths();
        let squares = [0, 1, 2].map(|i| p[i] * p[i] * e[i]);
        let cubes = [0, 1, 2].map(|i| squares[i] * p[i]);
        let q = dot(cubes, p);
        let q3 = (q.sqrt() * q.sqrt().sqrt()).recip();
        let (along, across) = (dot(cubes, v) / q, dot(p, v));
        let contact = [0, 1, 2].map(|i| p[i] * self.radius + cubes[i] * q3);
        let flat = |i: usize| (squares[i] * v[i] - cubes[i] * along) * q3 * 3.0;
        (contact, [0, 1, 2].map(|i| (v[i] - p[i] * across) * self.radius + flat(i)))
    }
}

/// `a·b` of numbers with derivatives.
pub(super) fn dot<T: Algebraic>(a: [T; 3], b: [T; 3]) -> T {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// `a × b` of numbers with derivatives.
pub(super) fn cross<T: Algebraic>(a: [T; 3], b: [T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Derivatives of a support function, behind which its type is hidden.
trait Differentiated: fmt::Debug + Send + Sync {
    fn local(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> Local;
}

impl<F: SupportFunction> Differentiated for F {
    fn local(&self, normal: &Vector3<f64>, turning: &Vector3<f64>) -> Local {
        let along = |i: usize, j: usize| {
            let unit = |axis: usize, k: usize| f64::from(u8::from(axis == k));
            // Three independent small steps, one inside the other: along axis i, along axis j, and along the turning.
            let p = [0, 1, 2].map(|k| {
                let first = Jet { value: normal[k], slopes: [unit(i, k)] };
                let second = Jet { value: first, slopes: [Jet::from(unit(j, k))] };
                Jet { value: second, slopes: [Jet::from(turning[k])] }
            });
            self.support::<Jet<1, Jet<1, Jet<1>>>>(p)
        };
        let mut local = Local { contact: Vector3::zeros(), hessian: Matrix3::zeros(), slope: Matrix3::zeros() };
        for i in 0..3 {
            for j in 0..=i {
                let h = along(i, j);
                let [turned] = h.slopes;
                local.contact[i] = h.value.value.slopes[0];
                local.hessian[(i, j)] = h.value.slopes[0].slopes[0];
                local.hessian[(j, i)] = h.value.slopes[0].slopes[0];
                local.slope[(i, j)] = turned.slopes[0].slopes[0];
                local.slope[(j, i)] = turned.slopes[0].slopes[0];
            }
        }
        local
    }
}

impl Custom {
    /// Hides the type of a support function.
    pub fn new(function: impl SupportFunction + 'static) -> Self {
        Self(Arc::new(function))
    }
}

impl fmt::Debug for Custom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl PartialEq for Custom {
    /// The same function object: functions cannot be compared.
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Relative rounding of some dozens of operations with cancellation.
    const ROUNDING: f64 = 1e-11;

    /// The same three shapes by their formulas alone.
    #[derive(Debug)]
    enum Formula {
        Ellipsoid([f64; 3]),
        Egg([f64; 3], f64, f64),
        Rounded([f64; 3], f64),
    }

    impl SupportFunction for Formula {
        fn support<T: Number>(&self, p: [T; 3]) -> T {
            let norm = |a: [f64; 3]| [0, 1, 2].map(|i| p[i] * p[i] * (a[i] * a[i])).into_iter().sum::<T>().sqrt();
            match *self {
                Self::Ellipsoid(a) => norm(a),
                Self::Egg(a, e, zc) => norm(a) + p[2].powi(3) / dot(p, p) * e - p[2] * zc,
                Self::Rounded(a, r) => {
                    let fourths = [0, 1, 2].map(|i| (p[i] * a[i]).powi(4)).into_iter().sum::<T>();
                    norm([r; 3]) + fourths.sqrt().sqrt()
                }
            }
        }
    }

    fn pairs() -> [(Shape, Shape); 3] {
        let custom = |formula| Shape::Custom(Custom::new(formula));
        let (a, b) = ([0.02, 0.03, 0.04], [0.025, 0.03, 0.04]);
        [
            (Shape::Ellipsoid(Ellipsoid { semi_axes: a }), custom(Formula::Ellipsoid(a))),
            (Shape::Egg(Egg { semi_axes: b, skew: 0.004, origin: 0.0018 }), custom(Formula::Egg(b, 0.004, 0.0018))),
            (Shape::Rounded(RoundedShape { semi_axes: a, radius: 0.012 }), custom(Formula::Rounded(a, 0.012))),
        ]
    }

    fn unit() -> impl Strategy<Value = Vector3<f64>> {
        [-1.0..1.0, -1.0..1.0, -1.0..1.0_f64]
            .prop_map(Vector3::from)
            .prop_filter_map("a direction", |v| v.try_normalize(0.1))
    }

    proptest! {
        #[test]
        fn derivatives_by_hand_are_those_of_the_formula(n in unit(), w in unit(), d in unit()) {
            let (v, d) = (n.cross(&w), n.cross(&d));
            for (by_hand, automatic) in pairs() {
                let (got, wanted) = (by_hand.local(&n, &v), automatic.local(&n, &v));
                prop_assert!((got.contact - wanted.contact).norm() < ROUNDING, "{by_hand:?}: {got:?} {wanted:?}");
                prop_assert!((got.hessian - wanted.hessian).norm() < ROUNDING, "{by_hand:?}: {got:?} {wanted:?}");
                let slopes = (got.slope * d, wanted.slope * d);
                prop_assert!((slopes.0 - slopes.1).norm() < ROUNDING, "{by_hand:?}: {slopes:?}");
            }
        }

        #[test]
        fn all_ways_to_a_contact_agree(n in unit(), w in unit()) {
            let v = n.cross(&w);
            for (shape, _) in pairs() {
                let (contact, moving) = shape.roll(&n, &v);
                let local = shape.local(&n, &v);
                prop_assert!((contact - local.contact).norm() < ROUNDING, "{shape:?}");
                prop_assert!((moving - local.hessian * v).norm() < ROUNDING, "{shape:?}");
                let (plain, pushed) = shape.roll_with::<f64>(n.into(), v.into()).unwrap();
                prop_assert!((contact - Vector3::from(plain)).norm() < ROUNDING, "{shape:?}");
                prop_assert!((moving - Vector3::from(pushed)).norm() < ROUNDING, "{shape:?}");
            }
        }

        /// Euler's theorem for homogeneous functions.
        #[test]
        fn the_contact_has_the_height_and_a_normal_without_curvature(n in unit()) {
            for (by_hand, automatic) in pairs() {
                prop_assert!((by_hand.height(&n) - automatic.height(&n)).abs() < ROUNDING);
                prop_assert!((by_hand.local(&n, &Vector3::zeros()).hessian * n).norm() < ROUNDING);
            }
        }
    }

    #[test]
    fn the_size_of_an_ellipsoid_is_its_mean_semi_axis() {
        assert!((pairs()[0].0.size() - 0.03).abs() < ROUNDING);
    }
}
