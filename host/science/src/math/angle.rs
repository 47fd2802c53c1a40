//! The contact angle: what a force on the finger says about where it is touched.
//!
//! Frame: finger. **Force is the force on the finger's disk**, so a contact at the polar angle `u`, seen from the
//! disk's centre, pushes along `−(cos u, sin u)` when it has no friction. Angles are in radians and in `(−π, π]`.

use nalgebra::{Matrix2, Vector2};

/// Unit force on the finger from a frictionless contact at polar angle `u`: `−(cos u, sin u)`.
#[must_use]
pub fn push_direction(u: f64) -> Vector2<f64> {
    let (sin, cos) = u.sin_cos();
    Vector2::new(-cos, -sin)
}

/// Polar angle of the contact, seen from the disk's centre, that pushes with this force; in `(-π, π]`, 0 for no force.
///
/// ```
/// use palpate::math::angle::contact_angle;
/// // Something to the right of the disk pushes it to the left.
/// assert_eq!(contact_angle([-2.0, 0.0].into()), 0.0);
/// ```
#[must_use]
pub fn contact_angle(force_finger: Vector2<f64>) -> f64 {
    // Adding 0 turns a negative zero into a positive one, for which `atan2` gives 0 and π, never −π.
    (0.0 - force_finger.y).atan2(0.0 - force_finger.x)
}

/// The same angle in `(-π, π]`.
#[must_use]
pub fn wrap_angle(angle: f64) -> f64 {
    let turned = angle.rem_euclid(std::f64::consts::TAU);
    if turned > std::f64::consts::PI { turned - std::f64::consts::TAU } else { turned }
}

/// First-order variance of a vector's direction, rad²: `n⊥ᵀ Σ n⊥ / |F|²`. Infinite for a zero vector.
#[must_use]
pub fn direction_variance(vector: Vector2<f64>, covariance: &Matrix2<f64>) -> f64 {
    let across = Vector2::new(-vector.y, vector.x);
    let squared = vector.norm_squared();
    if squared > 0.0 { across.dot(&(covariance * across)) / (squared * squared) } else { f64::INFINITY }
}
