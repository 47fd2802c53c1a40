//! Attitudes spread evenly, modulo a symmetry.
//!
//! Implements: super-Fibonacci spirals (Alexa, *Super-Fibonacci Spirals: Fast, Low-Discrepancy Sampling of SO(3)*, CVPR
//! 2022), of which one of each class is kept: the one that turns least.
//! Units: none. Errors: none.

use std::collections::HashMap;
use std::f64::consts::{PI, SQRT_2, TAU};
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::super::symmetry::Symmetry;

/// Alexa's second constant, the root of ψ⁴ = ψ + 4.
const PSI: f64 = 1.533_751_168_755_204_3;

type Spread = Arc<Vec<UnitQuaternion<f64>>>;

/// About `count / order` attitudes, none of which a turn of the group takes to another; computed once.
pub(super) fn spread(symmetry: Symmetry, count: usize) -> Spread {
    static KNOWN: LazyLock<Mutex<HashMap<(String, usize), Spread>>> = LazyLock::new(Mutex::default);
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    Arc::clone(known.entry((format!("{symmetry:?}"), count)).or_insert_with(|| Arc::new(make(symmetry, count))))
}

fn make(symmetry: Symmetry, count: usize) -> Vec<UnitQuaternion<f64>> {
    match symmetry {
        Symmetry::Sphere => vec![UnitQuaternion::identity()],
        Symmetry::Revolution { axis, both_ways } => {
            // As dense on the sphere of axes as the others are among attitudes.
            let axes = ((count as f64).powf(2.0 / 3.0) * 1.5).ceil();
            let toward = |k: f64| {
                let z = 1.0 - (2.0 * k + 1.0) / axes * if both_ways { 0.5 } else { 1.0 };
                let (sin, cos) = (k * PI * (3.0 - 5.0_f64.sqrt())).sin_cos();
                let radius = (1.0 - z * z).sqrt();
                let direction = Vector3::new(radius * cos, radius * sin, z);
                UnitQuaternion::rotation_between(&Vector3::ith(axis, 1.0), &direction)
                    .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::ith_axis((axis + 1) % 3), PI))
            };
            std::iter::successors(Some(0.0), |k| Some(k + 1.0)).take_while(|k| *k < axes).map(toward).collect()
        }
        _ => {
            let turns = symmetry.turns();
            let represents = |q: &UnitQuaternion<f64>| turns.iter().all(|turn| (q * turn).w.abs() <= q.w.abs() + 1e-12);
            (0..count).map(|k| spiral(k as f64 + 0.5, count as f64)).filter(represents).collect()
        }
    }
}

fn spiral(s: f64, count: f64) -> UnitQuaternion<f64> {
    let (r, t) = ((s / count).sqrt(), (1.0 - s / count).sqrt());
    let (a, b) = (TAU * s / SQRT_2, TAU * s / PSI);
    UnitQuaternion::new_normalize(Quaternion::new(t * b.cos(), r * a.sin(), r * a.cos(), t * b.sin()))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Random attitudes are within the spacing of a spread one.
    #[test]
    fn no_attitude_is_far_from_the_spread() {
        let groups = [
            Symmetry::C1,
            Symmetry::C2(2),
            Symmetry::D2,
            Symmetry::D4(0),
            Symmetry::O,
            Symmetry::Revolution { axis: 1, both_ways: true },
            Symmetry::Revolution { axis: 0, both_ways: false },
        ];
        for symmetry in groups {
            let spread = spread(symmetry, 4000);
            for k in 0..50 {
                let k = f64::from(k);
                let any = UnitQuaternion::from_euler_angles(1.7 * k, 0.9 * k * k, 2.3 * k);
                let nearest = spread.iter().map(|q| symmetry.angle(q, &any)).fold(f64::INFINITY, f64::min);
                // 8π²/4000 of SO(3) each: a ball of 0.17 rad; covering takes twice that.
                assert!(nearest < 0.35, "{symmetry:?}: {nearest}");
            }
        }
        assert_eq!(spread(Symmetry::D2, 4000).len(), 1000);
    }
}
