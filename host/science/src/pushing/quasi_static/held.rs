//! Friction of feet under a load that is given, four feet side by side: what coarse steps ask for again and again.
//!
//! The sums are those of the support (`support.rs`), without what only a load that follows the motion needs. Written
//! without branches over arrays of four, which the compiler turns into vector instructions where the machine has them
//! (decided at run time by `pulp`); nothing is reordered or fused by that, so all machines give the same bits.
//!
//! Frames: part axes, origin at the supports' centre. Units: SI; forces per weight. Errors: none.

use nalgebra::{Matrix3, Vector2, Vector3};
use pulp::{Arch, NullaryFnOnce};

use super::support::Loaded;

/// Feet side by side: what an AVX2 register holds.
const LANES: usize = 4;

/// One foot.
#[derive(Clone, Copy, Debug)]
pub(super) struct HeldFoot {
    /// m.
    pub(super) at: Vector2<f64>,
    /// Its scaled place: it bears its share times `y·λ`.
    pub(super) y: Vector3<f64>,
    /// Share times coefficient.
    pub(super) friction: f64,
}

/// Four feet.
#[derive(Clone, Copy, Debug)]
struct Block {
    x: [f64; LANES],
    y: [f64; LANES],
    load_x: [f64; LANES],
    load_y: [f64; LANES],
    friction: [f64; LANES],
}

/// All feet.
#[derive(Clone, Debug)]
pub(super) struct HeldFeet {
    blocks: Vec<Block>,
    ring_squared: f64,
    arch: Arch,
}

impl HeldFeet {
    /// These, each on a ring of this radius, m.
    pub(super) fn new(feet: impl IntoIterator<Item = HeldFoot>, ring: f64) -> Self {
        let feet: Vec<_> = feet.into_iter().collect();
        let block = |four: &[HeldFoot]| {
            // Lanes that are left over have the last foot again, without friction: so nothing is divided by 0 that was
            // not before.
            let foot = |i: usize| four[i.min(four.len() - 1)];
            Block {
                x: std::array::from_fn(|i| foot(i).at.x),
                y: std::array::from_fn(|i| foot(i).at.y),
                load_x: std::array::from_fn(|i| foot(i).y.y),
                load_y: std::array::from_fn(|i| foot(i).y.z),
                friction: std::array::from_fn(|i| if i < four.len() { foot(i).friction } else { 0.0 }),
            }
        };
        Self { blocks: feet.chunks(LANES).map(block).collect(), ring_squared: ring * ring, arch: Arch::new() }
    }

    /// Friction of a motion under a load.
    pub(super) fn loaded(&self, twist: &Vector3<f64>, load: &Vector3<f64>) -> Loaded {
        let sums = self.arch.dispatch(Summing { feet: self, twist, load });
        // Not within the loop's function, or the compiler takes the lanes apart there, too.
        let [x, y, moment, xx, xy, yy, xm, ym, mm] = sums.of.map(|[a, b, c, d]| (a + c) + (b + d));
        let slowest_squared = sums.slowest_squared.into_iter().fold(f64::INFINITY, f64::min);
        Loaded {
            wrench: Vector3::new(x, y, moment),
            gradient: Matrix3::new(xx, xy, xm, xy, yy, ym, xm, ym, mm),
            load: *load,
            slowest: slowest_squared.sqrt(),
        }
    }
}

/// Force along x and y, moment, and their derivatives by the twist: xx, xy, yy, x and moment, y and moment, moment.
struct LaneSums {
    of: [[f64; LANES]; 9],
    slowest_squared: [f64; LANES],
}

struct Summing<'a> {
    feet: &'a HeldFeet,
    twist: &'a Vector3<f64>,
    load: &'a Vector3<f64>,
}

impl NullaryFnOnce for Summing<'_> {
    type Output = LaneSums;

    #[inline(always)]
    fn call(self) -> LaneSums {
        let mut sums = LaneSums { of: [[0.0; LANES]; 9], slowest_squared: [f64::INFINITY; LANES] };
        for block in &self.feet.blocks {
            add_block(&mut sums, block, self.twist, self.load, self.feet.ring_squared);
        }
        sums
    }
}

/// Adds four feet.
#[inline(always)]
fn add_block(sums: &mut LaneSums, block: &Block, twist: &Vector3<f64>, load: &Vector3<f64>, ring_squared: f64) {
    let on_ring = ring_squared * twist.z * twist.z;
    for i in 0..LANES {
        let (px, py) = (block.x[i], block.y[i]);
        let bears = load.x + block.load_x[i] * load.y + block.load_y[i] * load.z;
        let bears = block.friction[i] * if bears > 0.0 { bears } else { 0.0 };
        let (u, v) = (twist.x - twist.z * py, twist.y + twist.z * px);
        let speed_squared = u * u + v * v + on_ring;
        let slowest = sums.slowest_squared[i];
        sums.slowest_squared[i] = if speed_squared < slowest { speed_squared } else { slowest };
        let per_speed = bears / speed_squared.sqrt();
        let bend = per_speed / speed_squared;
        let turned = px * v - py * u + ring_squared * twist.z;
        let (bend_u, bend_v) = (bend * u, bend * v);
        sums.of[0][i] += per_speed * u;
        sums.of[1][i] += per_speed * v;
        sums.of[2][i] += per_speed * turned;
        sums.of[3][i] += per_speed - bend_u * u;
        sums.of[4][i] -= bend_u * v;
        sums.of[5][i] += per_speed - bend_v * v;
        sums.of[6][i] -= per_speed * py + bend_u * turned;
        sums.of[7][i] += per_speed * px - bend_v * turned;
        sums.of[8][i] += per_speed * (px * px + py * py + ring_squared) - bend * turned * turned;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::random::Draw;

    /// Rounding of sums of numbers of size 1, and of their derivatives by differences of this step.
    const ROUNDING: f64 = 1e-12;
    const STEP: f64 = 1e-5;
    const DIFFERENCES: f64 = 1e-6;

    fn feet(count: usize, draw: &mut Draw) -> Vec<HeldFoot> {
        let foot = |_| HeldFoot {
            at: Vector2::new(draw.between(-1.0, 1.0), draw.between(-1.0, 1.0)),
            y: Vector3::new(1.0, draw.between(-0.5, 0.5), draw.between(-0.5, 0.5)),
            friction: draw.between(0.1, 0.3),
        };
        (0..count).map(foot).collect()
    }

    #[test]
    fn feet_side_by_side_resist_as_one_by_one() {
        for case in 0..40 {
            let draw = &mut Draw::case(3, case);
            let all = feet(1 + case % 9, draw);
            let mut number = || draw.between(-1.0, 1.0);
            let twist = Vector3::new(number(), number(), number());
            let load = Vector3::new(1.0, number(), number());
            let ring = 0.1;
            let held = HeldFeet::new(all.iter().copied(), ring);
            // Each foot by itself: friction against its velocity, by its dissipation's slope.
            let wrench = |twist: &Vector3<f64>| -> Vector3<f64> {
                let each = all.iter().map(|foot| {
                    let velocity = Vector2::new(twist.x - twist.z * foot.at.y, twist.y + twist.z * foot.at.x);
                    let speed = (velocity.norm_squared() + (ring * twist.z).powi(2)).sqrt();
                    let size = foot.friction * foot.y.dot(&load).max(0.0) / speed;
                    let force = velocity * size;
                    Vector3::new(force.x, force.y, foot.at.perp(&force) + size * ring * ring * twist.z)
                });
                each.sum()
            };
            let loaded = held.loaded(&twist, &load);
            assert!((loaded.wrench - wrench(&twist)).norm() < ROUNDING, "case {case}");
            for axis in 0..3 {
                let step = Vector3::ith(axis, STEP);
                let slope = (wrench(&(twist + step)) - wrench(&(twist - step))) / (2.0 * STEP);
                assert!((loaded.gradient.column(axis) - slope).norm() < DIFFERENCES, "case {case}, axis {axis}");
            }
            let plain = HeldFeet { arch: Arch::Scalar, ..held.clone() }.loaded(&twist, &load);
            assert_eq!((plain.wrench, plain.gradient), (loaded.wrench, loaded.gradient), "the same bits");
        }
    }
}
