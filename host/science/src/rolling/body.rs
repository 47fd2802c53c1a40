//! A smooth convex body: its shape and how its mass resists turning.
//!
//! Implements: the body of thesis §7.1. Mass properties of a uniform body come from integrals over the sphere of
//! normals, with `k` the product of the two radii of curvature: `V = ⅓∫h k`, centroid `1/(4V) ∫β h k`, second moments
//! `1/(5V) ∫ββᵀ h k`.
//! Assumes: the body frame's origin is the centre of mass and its axes are principal axes of inertia.
//! Frames: the body's. Units: SI; inertia over mass in m².
//! Errors: [`BodyError`] where the body is not strictly convex, or its frame is not the one assumed.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};

use super::shape::{Egg, Ellipsoid, RoundedShape, Shape};
use super::symmetry::Symmetry;

/// Least radius of curvature that counts as one, relative to the body's size: a sharper edge is an edge.
const CURVATURE_RADIUS_MIN: f64 = 1e-6;

/// How far the centroid of a uniform body may be from the frame's origin, relative to the body's size.
///
/// A micrometre on three centimetres: beyond it the offset would show in the motion, below it is rounding of the input.
const CENTROID_TOLERANCE: f64 = 3e-5;

/// How large products of inertia may be beside the moments: what quadrature leaves.
const PRODUCT_TOLERANCE: f64 = 1e-6;

/// How far a moment of inertia may exceed the sum of the other two, relative: rounding of the input.
const TRIANGLE_TOLERANCE: f64 = 1e-9;

/// Change from one quadrature to the next finer one at which it has converged, relative.
const QUADRATURE_TOLERANCE: f64 = 1e-13;

/// Rings of normals from pole to pole in the first and the last quadrature.
const RINGS: (usize, usize) = (24, 384);

/// A smooth, strictly convex rigid body.
///
/// ```
/// use palpate::RollingBody;
///
/// let pebble = RollingBody::ellipsoid([0.02, 0.03, 0.04])?; // semi-axes, m
/// assert_eq!(pebble.symmetry().name(), "D2");
/// # Ok::<(), palpate::rolling::BodyError>(())
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct RollingBody {
    shape: Shape,
    inertia: Vector3<f64>,
    symmetry: Symmetry,
    sharpest: f64,
}

/// Why there is no such body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum BodyError {
    /// A length that is none.
    #[error("{name} is {value:?} m: it must be finite and above 0")]
    Length {
        /// Which length, by its name.
        name: &'static str,
        /// The length as given, m.
        value: f64,
    },
    /// The skew or the place of the origin is no number.
    #[error("{name} is {value:?} m: it must be finite")]
    NotFinite {
        /// The number that is not finite, by its name.
        name: &'static str,
        /// The length as given, m.
        value: f64,
    },
    /// Flat or hollow somewhere, or with an edge.
    #[error(
        "the body is not strictly convex: where its outward normal is [{:.3}, {:.3}, {:.3}] a radius of curvature is \
         {radius:.3e} m, it must be above {limit:.1e} m: make the body rounder (smaller |e|, larger r, \
         semi-axes that differ less)",
        normal[0], normal[1], normal[2]
    )]
    NotConvex {
        /// Outward normal at the place, body axes, a unit vector.
        normal: [f64; 3],
        /// Radius of curvature there, m.
        radius: f64,
        /// The least allowed, m.
        limit: f64,
    },
    /// The origin is outside.
    #[error(
        "the origin, the centre of mass, is outside the body: the plane with outward normal {normal:?} is at {height:.3e} m"
    )]
    OriginOutside {
        /// Outward normal of the plane, body axes, a unit vector.
        normal: [f64; 3],
        /// Of the origin above the touching plane, m.
        height: f64,
    },
    /// Without a given inertia the density is uniform, and then the centroid is the centre of mass.
    #[error(
        "the centroid of the uniform body is at [{:.9}, {:.9}, {:.9}] m, it must be the origin within {limit:.1e} m: \
         set zc to {remedy:?}, or give inertia_per_mass for a body whose centre of mass is the origin",
        centroid[0], centroid[1], centroid[2]
    )]
    Centroid {
        /// The centroid, body frame, m.
        centroid: [f64; 3],
        /// The most that it may be off, m.
        limit: f64,
        /// The `zc` with which the centroid would be the origin, m.
        remedy: f64,
    },
    /// The uniform body's principal axes are not the frame's.
    #[error(
        "the frame's axes are not principal axes of the uniform body: the products of inertia are {products:?} m²: turn its frame"
    )]
    Axes {
        /// yz, zx, xy, m².
        products: [f64; 3],
    },
    /// A moment of inertia that is none.
    #[error(
        "inertia_per_mass[{axis}] is {value:?} m²: it must be finite and above 0 (a singular inertia belongs to no body)"
    )]
    Inertia {
        /// The principal axis, from 0.
        axis: usize,
        /// The moment as given, m².
        value: f64,
    },
    /// Moments of inertia that no body has.
    #[error(
        "inertia_per_mass[{axis}] = {value:?} m² exceeds the sum of the other two, {others:?} m²: no body has such moments \
         of inertia, check them"
    )]
    Triangle {
        /// The principal axis whose moment exceeds the sum of the others, from 0.
        axis: usize,
        /// The moment as given, m².
        value: f64,
        /// Sum of the other two, m².
        others: f64,
    },
}

impl RollingBody {
    /// An ellipsoid of uniform density.
    ///
    /// ```
    /// use palpate::rolling::RollingBody;
    ///
    /// let pebble = RollingBody::ellipsoid([0.02, 0.03, 0.04])?;
    /// assert!((pebble.inertia().x - (0.03_f64.powi(2) + 0.04_f64.powi(2)) / 5.0).abs() < 1e-15); // m²
    /// assert_eq!(pebble.symmetry().name(), "D2");
    /// # Ok::<(), palpate::rolling::BodyError>(())
    /// ```
    ///
    /// # Errors
    /// [`BodyError::Length`] for a semi-axis (m) that is not above 0, [`BodyError::NotConvex`] for a needle or a blade
    /// whose axes differ some thousandfold.
    pub fn ellipsoid(semi_axes: [f64; 3]) -> Result<Self, BodyError> {
        lengths(&semi_axes)?;
        let shape = Shape::Ellipsoid(Ellipsoid { semi_axes });
        let symmetry = Symmetry::of_ellipsoid(&semi_axes);
        let (longest, long) = Vector3::from(semi_axes).argmax();
        let short = semi_axes.into_iter().fold(long, f64::min);
        let (sharpest, limit) = (short / long * short, CURVATURE_RADIUS_MIN * long);
        if sharpest <= limit {
            let normal = Vector3::ith(longest, 1.0).into();
            return Err(BodyError::NotConvex { normal, radius: sharpest, limit });
        }
        Ok(Self { shape, inertia: ellipsoid_inertia(&semi_axes), symmetry, sharpest })
    }

    /// An egg; `inertia` over mass (m²) about the body axes, or that of uniform density.
    ///
    /// # Errors
    /// [`BodyError`] where it is not convex, or of uniform density with its centroid away from the origin.
    pub fn egg(egg: Egg, inertia: Option<[f64; 3]>) -> Result<Self, BodyError> {
        lengths(&egg.semi_axes)?;
        for (name, value) in [("e", egg.skew), ("zc", egg.origin)] {
            if !value.is_finite() {
                return Err(BodyError::NotFinite { name, value });
            }
        }
        Self::build(Shape::Egg(egg), inertia, |inertia| Symmetry::of_egg(&egg, inertia))
    }

    /// A rounded body; `inertia` over mass (m²) about the body axes, or that of uniform density.
    ///
    /// # Errors
    /// [`BodyError`] for lengths that are not above 0 and impossible moments of inertia.
    pub fn rounded(rounded: RoundedShape, inertia: Option<[f64; 3]>) -> Result<Self, BodyError> {
        lengths(&rounded.semi_axes)?;
        length("r", rounded.radius)?;
        Self::build(Shape::Rounded(rounded), inertia, |inertia| Symmetry::of_rounded(&rounded, inertia))
    }

    /// Any body; the caller knows the symmetry of its shape and inertia.
    ///
    /// # Errors
    /// [`BodyError`] where it is not convex, or of uniform density with its centroid away from the origin or with other
    /// principal axes than the frame's.
    pub fn custom(
        shape: super::shape::Custom,
        inertia: Option<[f64; 3]>,
        symmetry: Symmetry,
    ) -> Result<Self, BodyError> {
        Self::build(Shape::Custom(shape), inertia, |_| symmetry)
    }

    fn build(
        shape: Shape,
        inertia: Option<[f64; 3]>,
        symmetry: impl Fn(&Vector3<f64>) -> Symmetry,
    ) -> Result<Self, BodyError> {
        let sharpest = check_convex(&shape)?;
        let inertia = match inertia {
            Some(inertia) => given_inertia(inertia)?,
            None => uniform_inertia(&shape)?,
        };
        let symmetry = symmetry(&inertia);
        Ok(Self { shape, inertia, symmetry, sharpest })
    }

    /// The shape by its support function, body frame.
    #[must_use]
    pub fn shape(&self) -> &Shape {
        &self.shape
    }

    /// Principal moments of inertia over the mass, m².
    #[must_use]
    pub fn inertia(&self) -> Vector3<f64> {
        self.inertia
    }

    /// Which turns leave shape and inertia as they are.
    #[must_use]
    pub fn symmetry(&self) -> Symmetry {
        self.symmetry
    }

    /// A length to measure others by, m: the mean semi-axis of an ellipsoid.
    #[must_use]
    pub fn size(&self) -> f64 {
        self.shape.size()
    }

    /// The least radius of curvature, m.
    #[must_use]
    pub fn sharpest(&self) -> f64 {
        self.sharpest
    }

    /// A circumscribed radius: no contact is further from the centre of mass, m (to the grid of [`normals`]).
    #[must_use]
    pub fn reach(&self) -> f64 {
        normals().map(|normal| self.shape.contact(&normal).norm()).fold(0.0, f64::max)
    }
}

fn length(name: &'static str, value: f64) -> Result<(), BodyError> {
    if value.is_finite() && value > 0.0 { Ok(()) } else { Err(BodyError::Length { name, value }) }
}

fn lengths(semi_axes: &[f64; 3]) -> Result<(), BodyError> {
    let names = ["semi-axis 0", "semi-axis 1", "semi-axis 2"];
    names.into_iter().zip(semi_axes).try_for_each(|(name, &value)| length(name, value))
}

/// Of a uniform ellipsoid, over its mass, m².
pub(super) fn ellipsoid_inertia(semi_axes: &[f64; 3]) -> Vector3<f64> {
    let [a, b, c] = semi_axes.map(|axis| axis * axis / 5.0);
    Vector3::new(b + c, c + a, a + b)
}

fn given_inertia(inertia: [f64; 3]) -> Result<Vector3<f64>, BodyError> {
    for (axis, &value) in inertia.iter().enumerate() {
        if !(value.is_finite() && value > 0.0) {
            return Err(BodyError::Inertia { axis, value });
        }
    }
    let total: f64 = inertia.iter().sum();
    for (axis, &value) in inertia.iter().enumerate() {
        let others = total - value;
        if value > others * (1.0 + TRIANGLE_TOLERANCE) {
            return Err(BodyError::Triangle { axis, value, others });
        }
    }
    Ok(Vector3::from(inertia))
}

/// Sum and product of the radii of curvature, m and m².
fn curvature_radii(hessian: &Matrix3<f64>) -> (f64, f64) {
    let sum = hessian.trace();
    (sum, 0.5 * (sum * sum - hessian.component_mul(hessian).sum()))
}

/// The smaller radius of curvature, m; negative where the shape is hollow.
fn curvature_radius_min(shape: &Shape, normal: &Vector3<f64>) -> f64 {
    let (sum, product) = curvature_radii(&shape.local(normal, &Vector3::zeros()).hessian);
    let root = (sum * sum - 4.0 * product).max(0.0).sqrt();
    0.5 * (sum - root)
}

/// Normals all over the sphere, about 3° apart: Fibonacci's spiral.
pub fn normals() -> impl Iterator<Item = Vector3<f64>> {
    const COUNT: u32 = 5000;
    let golden = PI * (3.0 - 5.0_f64.sqrt());
    (0..COUNT).map(move |k| {
        let k = f64::from(k);
        let z = 1.0 - (2.0 * k + 1.0) / f64::from(COUNT);
        let (sin, cos) = (golden * k).sin_cos();
        let radius = (1.0 - z * z).sqrt();
        Vector3::new(radius * cos, radius * sin, z)
    })
}

/// The normal at which `value` is least: the best of [`normals`], then ever smaller steps around it.
fn least(value: impl Fn(&Vector3<f64>) -> f64) -> (Vector3<f64>, f64) {
    let on_axes = (0..3).flat_map(|axis| [1.0, -1.0].map(|sign| Vector3::ith(axis, sign)));
    let better = |best: (Vector3<f64>, f64), normal: Vector3<f64>| {
        let here = value(&normal);
        // Written so that NaN wins: a shape without a curvature is none.
        if best.1 <= here { best } else { (normal, here) }
    };
    let start = Vector3::z();
    let mut best = normals().chain(on_axes).fold((start, value(&start)), better);
    let mut step = 0.03;
    for _ in 0..20 {
        let before = best.0;
        let around = (0..3).flat_map(|axis| [step, -step].map(|step| (before + Vector3::ith(axis, step)).normalize()));
        best = around.fold(best, better);
        step *= 0.5;
    }
    best
}

/// The least radius of curvature, m, if there is one everywhere and the origin is inside.
fn check_convex(shape: &Shape) -> Result<f64, BodyError> {
    let limit = CURVATURE_RADIUS_MIN * shape.size().abs();
    let (normal, radius) = least(|normal| curvature_radius_min(shape, normal));
    // Written so that NaN fails.
    if !(radius > limit && limit > 0.0) {
        return Err(BodyError::NotConvex { normal: normal.into(), radius, limit });
    }
    let (normal, height) = least(|normal| shape.height(normal));
    if height > 0.0 { Ok(radius) } else { Err(BodyError::OriginOutside { normal: normal.into(), height }) }
}

/// Centroid and second moments of a uniform body over its volume.
#[derive(Clone, Copy, Debug)]
struct Moments {
    centroid: Vector3<f64>,
    second: Matrix3<f64>,
}

fn uniform_inertia(shape: &Shape) -> Result<Vector3<f64>, BodyError> {
    let Moments { centroid, second, .. } = moments(shape);
    let size = shape.size();
    let limit = CENTROID_TOLERANCE * size;
    if centroid.norm() > limit {
        let origin = if let Shape::Egg(egg) = shape { egg.origin } else { 0.0 };
        return Err(BodyError::Centroid { centroid: centroid.into(), limit, remedy: origin + centroid.z });
    }
    let products = [second[(1, 2)], second[(2, 0)], second[(0, 1)]];
    if products.iter().any(|product| product.abs() > PRODUCT_TOLERANCE * size * size) {
        return Err(BodyError::Axes { products });
    }
    let [x, y, z] = [second[(0, 0)], second[(1, 1)], second[(2, 2)]];
    Ok(Vector3::new(y + z, z + x, x + y))
}

/// By ever finer quadrature, until it has converged.
fn moments(shape: &Shape) -> Moments {
    let mut rings = RINGS.0;
    let mut coarse = quadrature(shape, rings);
    while rings < RINGS.1 {
        rings *= 2;
        let fine = quadrature(shape, rings);
        let change = (fine.second - coarse.second).norm() / fine.second.norm()
            + (fine.centroid - coarse.centroid).norm() / fine.second.norm().sqrt();
        coarse = fine;
        if change < QUADRATURE_TOLERANCE {
            break;
        }
    }
    coarse
}

/// Gauss's rule from pole to pole, equal steps around: both converge exponentially for a smooth body.
fn quadrature(shape: &Shape, rings: usize) -> Moments {
    let around = 2 * rings;
    let step = 2.0 * PI / around as f64;
    let (mut volume, mut first, mut second) = (0.0, Vector3::zeros(), Matrix3::zeros());
    for (z, weight) in gauss(rings) {
        let radius = (1.0 - z * z).sqrt();
        for k in 0..around {
            let (sin, cos) = (step * k as f64).sin_cos();
            let normal = Vector3::new(radius * cos, radius * sin, z);
            let local = shape.local(&normal, &Vector3::zeros());
            let cone = weight * step * local.contact.dot(&normal) * curvature_radii(&local.hessian).1;
            volume += cone / 3.0;
            first += local.contact * (cone / 4.0);
            second += local.contact * local.contact.transpose() * (cone / 5.0);
        }
    }
    Moments { centroid: first / volume, second: second / volume }
}

/// Nodes and weights of Gauss's rule on [−1, 1]: Newton's iteration on the Legendre polynomial.
fn gauss(count: usize) -> impl Iterator<Item = (f64, f64)> {
    let n = count as f64;
    (0..count).map(move |k| {
        let mut z = (PI * (k as f64 + 0.75) / (n + 0.5)).cos();
        let mut slope = 1.0;
        for _ in 0..8 {
            let (mut before, mut here) = (1.0, z);
            for j in 2..=count {
                let j = j as f64;
                (before, here) = (here, ((2.0 * j - 1.0) * z * here - (j - 1.0) * before) / j);
            }
            slope = n * (z * here - before) / (z * z - 1.0);
            z -= here / slope;
        }
        (z, 2.0 / ((1.0 - z * z) * slope * slope))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative, of quadrature that has converged.
    const CONVERGED: f64 = 1e-12;

    fn egg(skew: f64, origin: f64) -> Egg {
        Egg { semi_axes: [0.025, 0.03, 0.04], skew, origin }
    }

    #[test]
    fn quadrature_gives_the_closed_form_of_an_ellipsoid() {
        let semi_axes = [0.015, 0.03, 0.05];
        let moments = moments(&Shape::Ellipsoid(Ellipsoid { semi_axes }));
        assert!(moments.centroid.norm() < CONVERGED * 0.03);
        let second = moments.second.diagonal();
        let wanted = Vector3::from(semi_axes.map(|a| a * a / 5.0));
        assert!((second - wanted).norm() < CONVERGED * wanted.norm(), "{second} {wanted}");
    }

    #[test]
    fn an_egg_has_the_reference_inertia() {
        // Computed once with 30 digits by other means (the reference cases of the kind `roll`).
        let wanted =
            Vector3::new(0.000_498_210_173_234_432_5, 0.000_443_193_777_953_453_54, 0.000_305_255_400_637_189_4);
        let body = RollingBody::egg(egg(0.004, 0.001_868_354_824_588_91), None).unwrap();
        assert!((body.inertia() - wanted).norm() < 1e-10 * wanted.norm(), "{}", body.inertia());
    }

    #[test]
    fn a_rounded_body_has_the_reference_inertia() {
        let wanted =
            Vector3::new(0.000_517_523_992_561_089_8, 0.000_388_682_507_261_944_2, 0.000_459_153_872_679_460_7);
        let body = RollingBody::rounded(RoundedShape { semi_axes: [0.02, 0.03, 0.025], radius: 0.012 }, None).unwrap();
        assert!((body.inertia() - wanted).norm() < 1e-8 * wanted.norm(), "{}", body.inertia());
    }

    #[test]
    fn a_uniform_egg_away_from_its_centroid_is_told_where_it_should_be() {
        let error = RollingBody::egg(egg(0.004, 0.0), None).unwrap_err();
        let BodyError::Centroid { remedy, .. } = error else { panic!("{error}") };
        assert!((remedy - 0.001_868_354_824_588_91).abs() < 1e-9, "{remedy}");
        assert!(RollingBody::egg(egg(0.004, 0.0), Some([5e-4, 4e-4, 3e-4])).is_ok());
    }

    #[test]
    fn impossible_bodies_are_refused() {
        let flat = RollingBody::egg(egg(0.03, 0.01), Some([5e-4, 4e-4, 3e-4])).unwrap_err();
        assert!(matches!(flat, BodyError::NotConvex { .. }), "{flat}");
        let outside = RollingBody::egg(egg(0.0, 0.05), Some([5e-4, 4e-4, 3e-4])).unwrap_err();
        assert!(matches!(outside, BodyError::OriginOutside { .. }), "{outside}");
        let edge = RollingBody::rounded(RoundedShape { semi_axes: [0.02; 3], radius: 1e-12 }, None).unwrap_err();
        assert!(matches!(edge, BodyError::NotConvex { .. }), "{edge}");
        for inertia in [[0.0, 4e-4, 3e-4], [5e-4, -4e-4, 3e-4], [9e-4, 4e-4, 3e-4], [f64::NAN, 1.0, 1.0]] {
            assert!(RollingBody::egg(egg(0.004, 0.001_868), Some(inertia)).is_err(), "{inertia:?}");
        }
        for semi_axes in [[0.0, 0.02, 0.03], [-0.01, 0.02, 0.03], [f64::NAN, 0.02, 0.03]] {
            assert!(RollingBody::ellipsoid(semi_axes).is_err(), "{semi_axes:?}");
        }
        for semi_axes in [[0.02, 0.03, 1e9], [0.02, 1e-200, 0.03], [0.02, 0.03, 1e300]] {
            let needle = RollingBody::ellipsoid(semi_axes).unwrap_err();
            assert!(matches!(needle, BodyError::NotConvex { .. }), "{needle}");
        }
    }
}
