//! Acceleration by gravity, m/s².

/// Where nothing else is said, for parts and palms. On Earth it is from 9.78 at the equator to 9.83 at the poles, so
/// two decimals are what holds in most places.
///
/// ```
/// use palpate::GRAVITY_ASSUMED;
///
/// let mu_g = 0.3 * GRAVITY_ASSUMED; // what friction of 0.3 brakes a sliding part with, m/s²
/// assert!((mu_g - 2.943).abs() < 1e-12);
/// ```
pub const GRAVITY_ASSUMED: f64 = 9.81;

/// What defines the kilogram-force, exactly (3rd General Conference on Weights and Measures, 1901): turns the mass that
/// is stamped on a calibration weight into newtons. A local value belongs in the load itself, given in newtons.
pub const GRAVITY_STANDARD: f64 = 9.806_65;
