//! Friction between finger and part, from pushes in which the finger slid along an edge whose normal is known.
//!
//! A contact that slides has its force on the edge of the friction cone, and the side on which it lies is against the
//! slip. So the ratio of force along the edge to force into it, over pushes that slid far, is the friction coefficient,
//! with all by which it wanders from place to place. Before a contact gives way it may hold more than while it slides;
//! that is in these ratios too, and decides how far the normal may be from the force.
//!
//! Every push counts alike, since friction goes with the place. What is stated of all is as uncertain as it changes when
//! one push is left out (jackknife: R. G. Miller, Biometrika 61, 1974).
//!
//! Assumes: the edge's normal is known to a few degrees, and the slip to a fraction of [`SLID_M`].
//! Units: SI. Errors: [`FrictionUnknown`] where too few pushes slid.

use serde::Serialize;

/// A push that slipped by less than this, m, may have stuck most of the time. The slip itself is known to half a
/// millimetre where poses and finger are measured apart.
pub const SLID_M: f64 = 3e-3;

/// Fewest pushes that slid: of fewer, the scatter from place to place is not known.
pub const SLID_MIN: usize = 5;

/// Forces of one push in contact with one edge.
#[derive(Clone, Debug, PartialEq)]
pub struct PushAlongEdge {
    /// Way of the finger along the edge, relative to the part, m: counter-clockwise about the part is positive.
    pub slip: f64,
    /// Angle from the edge's inward normal to the force on the part at each reading, rad: counter-clockwise is positive.
    pub angles: Vec<f64>,
}

impl PushAlongEdge {
    /// Ratios of the force along the edge, against the part's slip, to the force into it; none if the push stuck, or if
    /// its forces are mostly on the side on which friction cannot be.
    fn ratios(&self) -> Option<Vec<f64>> {
        // Far enough, and known at all.
        if self.slip.is_nan() || self.slip.abs() < SLID_M {
            return None;
        }
        // A finger that goes on counter-clockwise takes the part along: to the right of the inward normal.
        let ratios: Vec<f64> = self.angles.iter().map(|angle| -self.slip.signum() * angle.tan()).collect();
        let along = ratios.iter().filter(|ratio| **ratio > 0.0).count();
        (2 * along > ratios.len()).then_some(ratios)
    }
}

/// A number with its standard deviation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct WithDeviation {
    /// The number.
    pub value: f64,
    /// Its standard deviation.
    pub sd: f64,
}

/// What sliding pushes tell of the friction between finger and part.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SlidingFriction {
    /// The coefficient: half of the sliding contact has less, half has more.
    pub mu_c: WithDeviation,
    /// What the stated share of the sliding contact does not exceed: where the cone's edge is at the stickiest places.
    pub edge: WithDeviation,
    /// Pushes that slid.
    pub slid: usize,
}

impl SlidingFriction {
    /// The coefficient of a cone that holds the normal with the stated probability, also in another push: the edge with
    /// what it may be more.
    #[must_use]
    pub fn cone(&self) -> f64 {
        self.edge.value + self.edge.sd
    }
}

/// Why the friction is not known.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("the finger slid by {} mm or more in {slid} pushes against a known edge, {SLID_MIN} are needed", SLID_M * 1e3)]
pub struct FrictionUnknown {
    /// Pushes that slid.
    pub slid: usize,
}

/// The friction that pushes along edges tell, with the cone's edge for a probability `coverage` in (0, 1).
///
/// ```
/// use palpate::finger::contact::friction::{PushAlongEdge, sliding_friction};
///
/// // Six pushes that slid by 5 mm with a coefficient of 0.40 to 0.45: the force is to the right of the normal.
/// let pushes: Vec<_> = (0..6)
///     .map(|i| PushAlongEdge { slip: 5e-3, angles: vec![-(0.40 + 0.01 * f64::from(i)).atan(); 100] })
///     .collect();
/// let found = sliding_friction(&pushes, 0.95)?;
/// assert!((found.mu_c.value - 0.425).abs() < 0.01 && found.cone() < 0.5);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Errors
/// [`FrictionUnknown`] if too few slid.
pub fn sliding_friction(pushes: &[PushAlongEdge], coverage: f64) -> Result<SlidingFriction, FrictionUnknown> {
    let ratios: Vec<Vec<f64>> = pushes.iter().filter_map(PushAlongEdge::ratios).collect();
    let slid = ratios.len();
    if slid < SLID_MIN {
        return Err(FrictionUnknown { slid });
    }
    let pool = Pool::of(&ratios);
    let stated = |share: f64| {
        let left_out: Vec<f64> = (0..slid).map(|push| pool.quantile(share, Some(push))).collect();
        let mean = left_out.iter().sum::<f64>() / slid as f64;
        let squares: f64 = left_out.iter().map(|value| (value - mean).powi(2)).sum();
        let sd = (squares * (slid - 1) as f64 / slid as f64).sqrt();
        WithDeviation { value: pool.quantile(share, None), sd }
    };
    Ok(SlidingFriction { mu_c: stated(0.5), edge: stated(coverage), slid })
}

/// Readings of all pushes in order, each with the weight that makes its push count as 1.
struct Pool {
    /// Value, push, weight.
    readings: Vec<(f64, usize, f64)>,
    pushes: usize,
}

impl Pool {
    fn of(ratios: &[Vec<f64>]) -> Self {
        let each = ratios.iter().enumerate();
        let mut readings: Vec<_> = each
            .flat_map(|(push, ratios)| ratios.iter().map(move |ratio| (*ratio, push, 1.0 / ratios.len() as f64)))
            .collect();
        readings.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { readings, pushes: ratios.len() }
    }

    /// What a share of the weight does not exceed, perhaps without one of the pushes.
    fn quantile(&self, share: f64, without: Option<usize>) -> f64 {
        let goal = share * (self.pushes - usize::from(without.is_some())) as f64;
        let mut reached = 0.0;
        let mut last = f64::NAN;
        for &(value, _, weight) in self.readings.iter().filter(|(_, push, _)| Some(*push) != without) {
            reached += weight;
            last = value;
            if reached >= goal {
                break;
            }
        }
        last
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    /// Readings of a push.
    const READINGS: usize = 400;

    /// Pushes whose friction is 0.42 ± 0.05 from push to push and ± 0.03 within; all slide, to either side.
    fn pushes(count: usize, seed: u64) -> Vec<PushAlongEdge> {
        let draw = &mut Draw::case(seed, 0);
        (0..count)
            .map(|i| {
                let side = if i % 2 == 0 { 1.0 } else { -1.0 };
                let friction = 0.42 + 0.05 * draw.normal();
                let angles = (0..READINGS).map(|_| -side * (friction + 0.03 * draw.normal()).atan()).collect();
                PushAlongEdge { slip: side * 6e-3, angles }
            })
            .collect()
    }

    #[test]
    fn the_friction_is_found_with_its_uncertainty() {
        let mut off = Vec::new();
        for seed in 0..200 {
            let found = sliding_friction(&pushes(25, seed), 0.95).unwrap();
            assert_eq!(found.slid, 25);
            assert!((found.mu_c.value - 0.42).abs() < 0.05, "seed {seed}: {found:?}");
            off.push((found.mu_c.value - 0.42) / found.mu_c.sd);
        }
        // 25 pushes of ± 0.058: the mean of squares in stated variances is near 1. A jackknife of medians of so few is
        // right to a third; 200 draws to a tenth.
        let square = off.iter().map(|off| off * off).sum::<f64>() / 200.0;
        assert!((0.6..1.6).contains(&square), "{square}");
    }

    #[test]
    fn the_cone_holds_further_pushes_as_often_as_stated() {
        let (mut held, mut all) = (0_usize, 0_usize);
        for seed in 0..100 {
            let cone = sliding_friction(&pushes(20, seed), 0.95).unwrap().cone().atan();
            for push in pushes(20, 1000 + seed) {
                held += push.angles.iter().filter(|angle| angle.abs() <= cone).count();
                all += push.angles.len();
            }
        }
        let share = held as f64 / all as f64;
        assert!((0.94..0.99).contains(&share), "{share}");
    }

    #[test]
    fn what_did_not_slide_tells_nothing() {
        let mut some = pushes(9, 3);
        some[0].slip = 1e-3;
        some[1].slip = f64::NAN;
        // Forces on the side from which friction pulls the other way: a slip that is none.
        some[2].slip = -some[2].slip;
        assert_eq!(sliding_friction(&some, 0.95).unwrap().slid, 6);
        assert_eq!(sliding_friction(&some[..6], 0.95), Err(FrictionUnknown { slid: 3 }));
        assert!(FrictionUnknown { slid: 3 }.to_string().contains("3 mm or more in 3 pushes"));
    }

    #[test]
    fn one_push_with_odd_forces_changes_little() {
        let mut some = pushes(20, 5);
        let before = sliding_friction(&some, 0.95).unwrap();
        some[7].angles.iter_mut().for_each(|angle| *angle = 0.05 * angle.signum());
        let after = sliding_friction(&some, 0.95).unwrap();
        assert!((after.mu_c.value - before.mu_c.value).abs() < 2.0 * before.mu_c.sd, "{before:?} {after:?}");
    }
}
