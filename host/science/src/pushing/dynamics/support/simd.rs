//! The sums of `uniform` over a polygon, four edges side by side, or four centres of rotation.
//!
//! Written without branches over arrays of four, which the compiler turns into vector instructions: those of AVX2 where
//! the machine has them (decided at run time by `pulp`), else the plain ones. Nothing is reordered or fused, so both
//! give the same bits.
//!
//! The logarithm is written out for the same reason, and takes a quotient in one division: with `k` the whole number
//! nearest to its logarithm to base 2, `ln(P/Q) = k ln 2 + 2 atanh((P − 2ᵏQ)/(P + 2ᵏQ))`. Where `k = 0`, that last
//! quotient is the edge's length over the sum of its ends' distances, which subtracts nothing.
//!
//! Frames: the polygon's axes, origin at its centroid. Units: SI. Errors: none.

use std::f64::consts::LN_2;

use nalgebra::Vector2;
use pulp::{Arch, NullaryFnOnce};

use super::uniform::Sums;

/// Edges or centres side by side: what an AVX2 register holds.
pub(super) const LANES: usize = 4;

/// Least denominator of a quotient, m or m²: below the square of any distance that a double of the part's size can tell
/// from 0.
///
/// Small enough to change nothing else, and large enough that no quotient of lengths up to 1e9 m overflows. Where it
/// acts the logarithm is multiplied by such a distance.
const LEAST: f64 = 1e-280;

/// Factors of `1, z, …` in `(atanh(√z)/√z − 1)/z`, by the Remez algorithm for `|√z| ≤ 0.2005`: error below 1.6e-17.
///
/// `k` comes from the bit patterns, which follow the logarithm to base 2 within 0.086: what remains of a quotient is
/// at most 2^0.586, and its `√z` 0.2004.
const ATANH: [f64; 7] = [
    0.333_333_333_333_364_7,
    0.199_999_999_980_209_23,
    0.142_857_147_083_770_7,
    0.111_110_683_756_087_01,
    0.090_932_138_238_307_5,
    0.076_243_792_505_432_12,
    0.076_896_488_611_274_27,
];

/// Exponent bits of a double, and how much an exponent is offset.
const EXPONENT: u64 = 0x7ff0_0000_0000_0000;
const MANTISSA_BITS: u32 = 52;
const EXPONENT_OFFSET: u64 = 1023;

/// One half more than an offset exponent, so that cutting off the mantissa rounds to the nearest.
const ROUNDED_OFFSET: u64 = (EXPONENT_OFFSET << MANTISSA_BITS) + (1 << (MANTISSA_BITS - 1));

/// 2^52: in a double of this exponent the mantissa is a whole number.
const WHOLE: f64 = 4_503_599_627_370_496.0;

/// The edges, four by four. The last four are filled up with edges of no length at the first vertex.
#[derive(Clone, Debug)]
pub(super) struct SimdEdges {
    vertices: Vec<Vector2<f64>>,
    blocks: Vec<Block>,
    arch: Arch,
}

/// Four edges of the polygon, axes as given.
#[derive(Clone, Copy, Debug)]
struct Block {
    /// Where they start, m.
    x: [f64; LANES],
    y: [f64; LANES],
    /// Their directions, unit vectors.
    along_x: [f64; LANES],
    along_y: [f64; LANES],
    /// Lengths of the edges, m.
    length: [f64; LANES],
}

/// [`Sums`] before the lanes are added up: twice `G`, six times `M`, and `S`.
#[derive(Clone, Copy, Debug, Default)]
struct LaneSums {
    pull_x: [f64; LANES],
    pull_y: [f64; LANES],
    distance: [f64; LANES],
    bend: [[f64; LANES]; 3],
}

/// What runs with the machine's widest vectors.
struct Summing<'a, const GRADIENT: bool> {
    blocks: &'a [Block],
    centre: Vector2<f64>,
}

impl SimdEdges {
    /// The edges of a polygon with these vertices.
    pub(super) fn new(vertices: Vec<Vector2<f64>>) -> Self {
        let first = vertices.first().copied().unwrap_or_default();
        let ends = vertices.iter().cycle().skip(1);
        let edges: Vec<_> = vertices.iter().zip(ends).map(|(start, end)| (*start, end - start)).collect();
        let blocks = edges.chunks(LANES).map(|chunk| Block::new(chunk, first)).collect();
        Self { vertices, blocks, arch: Arch::new() }
    }

    pub(super) fn vertices(&self) -> &[Vector2<f64>] {
        &self.vertices
    }

    #[inline]
    pub(super) fn sums<const GRADIENT: bool>(&self, centre: Vector2<f64>) -> Sums {
        self.arch.dispatch(Summing::<GRADIENT> { blocks: &self.blocks, centre }).total::<GRADIENT>()
    }

    /// The same for several centres side by side: with few edges faster than one by one, because no lane stays empty.
    pub(super) fn sums_of_four<const GRADIENT: bool>(&self, centres: &[Vector2<f64>; LANES]) -> [Sums; LANES] {
        let edges = self.vertices.len();
        let sums = self.arch.dispatch(SummingFour::<GRADIENT> { blocks: &self.blocks, edges, centres });
        std::array::from_fn(|i| sums.of_lane::<GRADIENT>(i))
    }
}

impl Block {
    /// Edges as start and extent; `first` is where to put those that are missing.
    fn new(edges: &[(Vector2<f64>, Vector2<f64>)], first: Vector2<f64>) -> Self {
        let zero = [0.0; LANES];
        let mut block = Self { x: [first.x; LANES], y: [first.y; LANES], along_x: zero, along_y: zero, length: zero };
        for (i, (start, extent)) in edges.iter().enumerate() {
            let length = extent.norm();
            (block.x[i], block.y[i], block.length[i]) = (start.x, start.y, length);
            (block.along_x[i], block.along_y[i]) = (extent.x / length, extent.y / length);
        }
        block
    }
}

/// The same over one edge after the other, for a centre in each lane.
struct SummingFour<'a, const GRADIENT: bool> {
    blocks: &'a [Block],
    edges: usize,
    centres: &'a [Vector2<f64>; LANES],
}

impl<const GRADIENT: bool> NullaryFnOnce for Summing<'_, GRADIENT> {
    type Output = LaneSums;

    /// Backwards, because a block needs the distance of the next one's first vertex.
    #[inline(always)]
    fn call(self) -> LaneSums {
        let mut sums = LaneSums::default();
        let Some(first) = self.blocks.first() else { return sums };
        let mut next = distance(first.x[0] - self.centre.x, first.y[0] - self.centre.y);
        for block in self.blocks.iter().rev() {
            next = add_block::<GRADIENT>(&mut sums, block, self.centre, next);
        }
        sums
    }
}

impl<const GRADIENT: bool> NullaryFnOnce for SummingFour<'_, GRADIENT> {
    type Output = LaneSums;

    #[inline(always)]
    fn call(self) -> LaneSums {
        let mut sums = LaneSums::default();
        let Some(first) = self.blocks.first() else { return sums };
        let (_, mut after) = seen_from(self.centres, first.x[0], first.y[0]);
        for at in (0..self.edges).rev() {
            let (block, lane) = (&self.blocks[at / LANES], at % LANES);
            let edge = Edge { tx: block.along_x[lane], ty: block.along_y[lane], length: block.length[lane] };
            let (d, r) = seen_from(self.centres, block.x[lane], block.y[lane]);
            for i in 0..LANES {
                add_edge::<GRADIENT>(&mut sums, i, &edge, [d[0][i], d[1][i]], [r[i], after[i]]);
            }
            after = r;
        }
        sums
    }
}

/// A point seen from each centre, and its distance.
#[inline(always)]
fn seen_from(centres: &[Vector2<f64>; LANES], x: f64, y: f64) -> ([[f64; LANES]; 2], [f64; LANES]) {
    let (mut d, mut r) = ([[0.0; LANES]; 2], [0.0; LANES]);
    for (i, centre) in centres.iter().enumerate() {
        (d[0][i], d[1][i]) = (x - centre.x, y - centre.y);
        r[i] = distance(d[0][i], d[1][i]);
    }
    (d, r)
}

impl LaneSums {
    /// One lane by itself.
    #[inline]
    fn of_lane<const GRADIENT: bool>(&self, i: usize) -> Sums {
        Sums {
            pull: Vector2::new(self.pull_x[i], self.pull_y[i]) / 2.0,
            distance: self.distance[i] * (1.0 / 6.0),
            bend: if GRADIENT { self.bend.map(|bend| bend[i]) } else { [0.0; 3] },
        }
    }

    /// The lanes added up. Not within the loop's function, or the compiler takes the lanes apart there, too.
    #[inline]
    fn total<const GRADIENT: bool>(&self) -> Sums {
        let total = |[a, b, c, d]: [f64; LANES]| (a + c) + (b + d);
        Sums {
            pull: Vector2::new(total(self.pull_x), total(self.pull_y)) / 2.0,
            distance: total(self.distance) * (1.0 / 6.0),
            bend: if GRADIENT { self.bend.map(total) } else { [0.0; 3] },
        }
    }
}

/// Adds four edges, given the distance of the vertex after them; returns that of their first.
#[inline(always)]
fn add_block<const GRADIENT: bool>(sums: &mut LaneSums, block: &Block, centre: Vector2<f64>, next: f64) -> f64 {
    let (mut dx, mut dy, mut r) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
    for i in 0..LANES {
        (dx[i], dy[i]) = (block.x[i] - centre.x, block.y[i] - centre.y);
        r[i] = distance(dx[i], dy[i]);
    }
    let [_, r_1, r_2, r_3] = r;
    let r_after = [r_1, r_2, r_3, next];
    for i in 0..LANES {
        let edge = Edge { tx: block.along_x[i], ty: block.along_y[i], length: block.length[i] };
        add_edge::<GRADIENT>(sums, i, &edge, [dx[i], dy[i]], [r[i], r_after[i]]);
    }
    r[0]
}

/// The direction of an edge and its length, m.
#[derive(Clone, Copy)]
struct Edge {
    tx: f64,
    ty: f64,
    length: f64,
}

/// Adds an edge to lane `i`, given its start seen from the centre of rotation, and the distances of its ends from
/// there.
#[inline(always)]
fn add_edge<const GRADIENT: bool>(sums: &mut LaneSums, i: usize, edge: &Edge, [dx, dy]: [f64; 2], [r0, r1]: [f64; 2]) {
    let Edge { tx, ty, length } = *edge;
    let a = tx * dx + ty * dy;
    let b = a + length;
    let h = ty * dx - tx * dy;
    let log = integral_of_reciprocal(length, [a, b], h * h, [r0, r1]);
    let twice_k = b * r1 - a * r0 + h * h * log;
    sums.pull_x[i] += ty * twice_k;
    sums.pull_y[i] -= tx * twice_k;
    sums.distance[i] += h * twice_k;
    if GRADIENT {
        let (along, across) = (r1 - r0, h * log);
        let (x, y) = (tx * along + ty * across, ty * along - tx * across);
        sums.bend[0][i] += ty * x;
        sums.bend[1][i] += ty * y;
        sums.bend[2][i] -= tx * y;
    }
}

#[inline(always)]
fn distance(x: f64, y: f64) -> f64 {
    (x * x + y * y).sqrt()
}

/// `Λ = ∫ ds/r` along an edge from `a` to `b` on a line whose distance squared is `h2`, the ends at the distances `r0`
/// and `r1`.
#[inline(always)]
fn integral_of_reciprocal(length: f64, [a, b]: [f64; 2], h2: f64, [r0, r1]: [f64; 2]) -> f64 {
    // `LEAST` is added where nothing waits for it.
    let (u, v) = (a.abs() + LEAST + r0, b.abs() + LEAST + r1);
    // `(b + r1)/(a + r0)` in the one of its forms that subtracts nothing.
    let foot_inside = a * b < 0.0;
    let (more, less) = if u > v { (u, v) } else { (v, u) };
    let over = if foot_inside { u * v } else { more };
    let under = if foot_inside { at_least(h2) } else { less };
    log_of_quotient(over, under, length, r0 + r1)
}

/// Not `f64::max`, which costs more because it also looks for NaN.
#[inline(always)]
fn at_least(x: f64) -> f64 {
    if x > LEAST { x } else { LEAST }
}

/// `ln(over/under)`, given numbers of which the quotient is `(over − under)/(over + under)`, but exact.
#[inline(always)]
fn log_of_quotient(over: f64, under: f64, exact_over: f64, exact_under: f64) -> f64 {
    let power = over.to_bits().wrapping_sub(under.to_bits()).wrapping_add(ROUNDED_OFFSET);
    let under = under * f64::from_bits(power & EXPONENT);
    let k = f64::from_bits(WHOLE.to_bits() | power >> MANTISSA_BITS) - (WHOLE + EXPONENT_OFFSET as f64);
    let exact = k == 0.0;
    let numerator = if exact { exact_over } else { over - under };
    let denominator = if exact { exact_under + LEAST } else { over + under };
    let y = numerator / denominator;
    let (z, twice_y) = (y * y, y + y);
    // From large to small; only the last term has to wait for the series.
    (k * LN_2 + twice_y) + twice_y * z * atanh_series(z)
}

/// `(atanh(√z)/√z − 1)/z`, its terms paired so that few wait for others.
#[inline(always)]
fn atanh_series(z: f64) -> f64 {
    let [c1, c2, c3, c4, c5, c6, c7] = ATANH;
    let z2 = z * z;
    let low = c1 + z * c2 + z2 * (c3 + z * c4);
    let high = c5 + z * c6 + z2 * c7;
    low + z2 * z2 * high
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Largest error of the logarithm relative to itself, or to 1 if that is less: some roundings.
    const ROUNDING: f64 = 1e-15;

    proptest! {
        #[test]
        fn the_logarithm_of_a_quotient_is_right(over in -60.0..60.0_f64, under in -900.0..60.0_f64) {
            let (over, under) = (over.exp2(), under.exp2());
            // No shorter way to the quotient here, so none of its accuracy close to 1 either.
            let found = log_of_quotient(over, under, over - under, over + under);
            let expected = (over / under).ln();
            prop_assert!((found - expected).abs() < ROUNDING * expected.abs().max(1.0), "{found} {expected}");
        }

        #[test]
        fn a_quotient_near_one_keeps_its_digits(excess in -50.0..-2.0_f64) {
            let length = excess.exp2();
            let (found, expected) = (log_of_quotient(1.0 + length, 1.0, length, 2.0 + length), length.ln_1p());
            prop_assert!((found / expected - 1.0).abs() < ROUNDING, "{found} {expected}");
        }

        #[test]
        fn wide_and_plain_vectors_give_the_same_bits(x in -0.1..0.1_f64, y in -0.1..0.1_f64) {
            let vertices = [[0.03, 0.0], [0.0, 0.02], [-0.04, -0.01], [-0.01, -0.03], [0.01, -0.025]].map(Vector2::from);
            let lanes = SimdEdges::new(vertices.to_vec());
            let plain = SimdEdges { arch: Arch::Scalar, ..lanes.clone() };
            let centre = Vector2::new(x, y);
            let (wide, plain) = (lanes.sums::<true>(centre), plain.sums::<true>(centre));
            prop_assert_eq!((wide.pull, wide.distance, wide.bend), (plain.pull, plain.distance, plain.bend));
        }
    }
}
