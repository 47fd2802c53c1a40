//! Random problems for experiments, reproducible on every machine.
//!
//! The one generator of the host's tables, demonstrations, benches, tests and fuzzing. It stands here because that is
//! the one place below all of them, this crate's own trials included; nothing else in the library draws, its randomness
//! is an argument. The simulated device has its noise from streams of its own, in `f32` for boards without `f64`
//! (`palpate_shared::sim`).
//!
//! [`Draw::case`] gives each case a generator of its own, so that a case stays the same whatever is drawn for others.
//!
//! Assumes: PCG32, whose streams are independent enough for this; it is no cipher. Units: the caller's.

use std::f64::consts::TAU;

use nalgebra::Point2;
use rand_core::{Rng as _, SeedableRng as _};
use rand_pcg::Pcg32;

use crate::geometry::{SimplePolygon, convex_hull};

/// 2⁻⁵³, the step of a uniform number made of 53 bits.
const UNIFORM_STEP: f64 = 1.0 / 9_007_199_254_740_992.0;

/// A sequence of random numbers.
#[derive(Clone, Debug)]
pub struct Draw(Pcg32);

impl Draw {
    /// The sequence of a seed.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        Self::case(seed, 0)
    }

    /// The sequence of one case under a seed.
    #[must_use]
    pub fn case(seed: u64, case: usize) -> Self {
        // An odd multiplier spreads neighbouring cases and keeps them distinct (Knuth's, from the golden ratio).
        Self(Pcg32::seed_from_u64(seed ^ (case as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)))
    }

    /// 64 random bits, all equally likely.
    pub fn bits(&mut self) -> u64 {
        self.0.next_u64()
    }

    /// A number uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        // 53 bits fit a double.
        (self.bits() >> 11) as f64 * UNIFORM_STEP
    }

    /// A number uniform in [`low`, `high`).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// 32 random bits, all equally likely.
    pub fn whole(&mut self) -> u32 {
        self.0.next_u32()
    }

    /// A number uniform in [`low`, `high`], of 32 bits.
    ///
    /// The end-to-end pushes are drawn with it: their seeds are chosen for contacts that press, and stay good only with the same
    /// numbers.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * f64::from(self.whole()) / f64::from(u32::MAX)
    }

    /// A number from the normal distribution with mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        // 1 − unit is never 0, so its logarithm is finite.
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (TAU * self.unit()).cos()
    }

    /// An index below `count`; 0 if `count` is 0.
    pub fn index(&mut self, count: usize) -> usize {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "below `count`, which is a usize")]
        let index = (self.unit() * count as f64) as usize;
        index
    }

    /// True with this probability.
    pub fn chance(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }

    /// The convex hull of points drawn uniformly from a disk of this radius: at least a triangle, at most `points`
    /// vertices.
    pub fn convex_polygon(&mut self, points: usize, radius: f64) -> SimplePolygon {
        loop {
            let cloud: Vec<_> = (0..points).map(|_| self.in_disk(radius)).collect();
            let corners: Vec<_> = convex_hull(&cloud).into_iter().map(|corner| cloud[corner]).collect();
            if let Ok(polygon) = SimplePolygon::new(corners) {
                return polygon;
            }
        }
    }

    /// A polygon that is star-shaped about its frame's origin, seldom convex: one vertex a sector, at distances uniform
    /// in [`low`, `high`).
    pub fn star_polygon(&mut self, vertices: usize, low: f64, high: f64) -> SimplePolygon {
        loop {
            let sector =
                |index: usize| TAU * f64::from(u32::try_from(index).unwrap_or(u32::MAX)) / vertices_f64(vertices);
            let outline: Vec<_> = (0..vertices)
                .map(|index| {
                    let angle = sector(index) + self.uniform(0.1, 0.9) * sector(1);
                    let distance = self.uniform(low, high);
                    Point2::new(distance * angle.cos(), distance * angle.sin())
                })
                .collect();
            if let Ok(polygon) = SimplePolygon::new(outline) {
                return polygon;
            }
        }
    }

    fn in_disk(&mut self, radius: f64) -> Point2<f64> {
        let (distance, angle) = (radius * self.unit().sqrt(), TAU * self.unit());
        Point2::new(distance * angle.cos(), distance * angle.sin())
    }
}

fn vertices_f64(count: usize) -> f64 {
    f64::from(u32::try_from(count).unwrap_or(u32::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_case_is_the_same_whatever_was_drawn_before() {
        let first = Draw::case(3, 7).unit();
        let mut other = Draw::case(3, 6);
        other.convex_polygon(9, 1.0);
        assert_eq!(first.to_bits(), Draw::case(3, 7).unit().to_bits());
        assert_ne!(first.to_bits(), Draw::case(3, 6).unit().to_bits());
    }

    #[test]
    fn drawn_polygons_are_as_asked() {
        for case in 0..100 {
            let mut draw = Draw::case(2, case);
            let hull = draw.convex_polygon(8, 0.05);
            assert!((3..=8).contains(&hull.vertices().len()));
            assert!(hull.first_reflex_vertex().is_none(), "case {case}");
            let star = draw.star_polygon(7, 0.02, 0.05);
            assert_eq!(star.vertices().len(), 7);
            assert!(star.vertices().iter().all(|point| (0.02..0.05).contains(&point.coords.norm())));
        }
    }

    #[test]
    fn the_normal_distribution_has_its_moments() {
        const COUNT: u32 = 20_000;
        let mut draw = Draw::case(5, 0);
        let numbers: Vec<_> = (0..COUNT).map(|_| draw.normal()).collect();
        let mean = numbers.iter().sum::<f64>() / f64::from(COUNT);
        let variance = numbers.iter().map(|number| number * number).sum::<f64>() / f64::from(COUNT);
        // Five standard deviations of either.
        assert!(mean.abs() < 5.0 / f64::from(COUNT).sqrt(), "{mean}");
        assert!((variance - 1.0).abs() < 5.0 * (2.0 / f64::from(COUNT)).sqrt(), "{variance}");
    }
}
