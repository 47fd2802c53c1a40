//! Support friction for centres of rotation far away, up to and through pure translation.
//!
//! Write points and velocities as complex numbers, `V` for the velocity of the centroid. The point `p` moves with
//! `V + iωp = V (1 + εp)`, `ε = iω/V`, so the mean speed is `Φ = |V| f(ε)` with `f = ∫ |1 + εp| dA / A`. Far from the
//! centre of rotation `|εp| < 1`, and `f` is a power series in the two real parts of `ε`, whose coefficients are
//! moments of the part: it is as good at `ω = 0` as beside it, and costs the same for any number of vertices.
//!
//! With `κ = ω/|V|` and the unit vector `k = (V_y, V_x)/|V|`, `ε = κ k`; let `m = (k_b, −k_a)`, and subscripts of `f`
//! be derivatives in those directions. Along and across `V`:
//!
//! ```text
//! I₁/A = (f − κ f_k, κ f_m)         I₂/A = f_k
//! |V| ∂²Φ/∂V² = ( κ² f_kk              −κ (f_m + κ f_km)         )     |V| ∂I₂/∂ω = A f_kk
//!               ( −κ (f_m + κ f_km)    f − 2κ f_k + κ² f_mm      )     |V| ∂I₂/∂V = A (−κ f_kk, f_m + κ f_km)
//! ```
//!
//! Frames: the part's axes, origin at the centroid. Units: SI. Errors: none.

use nalgebra::Vector2;
use pulp::{Arch, Simd, WithSimd};

use super::{MeanSliding, SlidingGradient, Twist, turn_left};

/// Highest degree of the series.
///
/// At the nearest centres of rotation that come here, 8 radii away, what is left out of the second derivatives is
/// below 1e-16 of them.
const DEGREE: usize = 20;

/// Share of the second derivatives at which the series ends early.
const LEFT_OUT: f64 = 1e-17;

/// Points and weights of the Gauss rule on an edge, exact up to degree 21.
const NODES: [(f64, f64); 6] = [
    (0.125_233_408_511_468_9, 0.249_147_045_813_402_78),
    (0.367_831_498_998_180_2, 0.233_492_536_538_354_8),
    (0.587_317_954_286_617_4, 0.203_167_426_723_065_92),
    (0.769_902_674_194_304_7, 0.160_078_328_543_346_22),
    (0.904_117_256_370_474_9, 0.106_939_325_995_318_43),
    (0.981_560_634_246_719_3, 0.047_175_336_386_511_83),
];

/// Coefficients of one power of `a`, for the powers of `b` up to whole registers.
const ROWS: usize = 24;

/// One number for each power of `b`.
type Column = [f64; ROWS];

/// The series of one part.
#[derive(Clone, Debug)]
pub(super) struct FarField {
    /// `columns[j][m]` is the factor of `a^j b^m` in `f`, where `(a, b) = ε·radius`.
    columns: Vec<Column>,
    radius: f64,
    arch: Arch,
}

/// Value and derivatives of the series, the derivatives along `k` and `m`, by `ε·radius`.
struct Expansion {
    f: f64,
    k: f64,
    m: f64,
    kk: f64,
    km: f64,
    mm: f64,
}

impl FarField {
    /// The series of a shape whose outline is given by points and `p × dp` there, relative to its centroid.
    pub(super) fn new(rays: impl Iterator<Item = (Vector2<f64>, f64)>, area: f64, radius: f64) -> Self {
        let mut series = Self { columns: vec![[0.0; ROWS]; DEGREE + 1], radius, arch: Arch::new() };
        for (p, cross) in rays {
            series.add_ray(p / radius, cross / area);
        }
        series
    }

    /// Adds the triangles between the centroid and a bit of the outline at `p` (in radii); `weight` is twice their
    /// share of the area.
    ///
    /// `|1 + εp| = Σ Pₙ`, homogeneous of degree `n` in `ε` and `p` each:
    /// `n Pₙ = −(2n − 3) ℓ Pₙ₋₁ − (n − 3) |ε|²|p|² Pₙ₋₂`, with `ℓ = Re εp` (the recurrence of Gegenbauer polynomials).
    /// From the centroid outwards it integrates to `Pₙ/(n + 2)`.
    fn add_ray(&mut self, p: Vector2<f64>, weight: f64) {
        let p2 = p.norm_squared();
        let (mut before, mut here) = ([0.0; DEGREE + 1], [0.0; DEGREE + 1]);
        here[0] = 1.0;
        for n in 0..=DEGREE {
            let share = weight / (n as f64 + 2.0);
            for (m, p_m) in here[..=n].iter().enumerate() {
                self.columns[n - m][m] += share * p_m;
            }
            let next_n = n as f64 + 1.0;
            let (c1, c2) = (-(2.0 * next_n - 3.0) / next_n, -(next_n - 3.0) / next_n * p2);
            let mut next = [0.0; DEGREE + 1];
            for m in 0..=(n + 1).min(DEGREE) {
                let lower = |list: &[f64; DEGREE + 1], by: usize| m.checked_sub(by).map_or(0.0, |m| list[m]);
                next[m] = c1 * (p.x * here[m] - p.y * lower(&here, 1)) + c2 * (before[m] + lower(&before, 2));
            }
            (before, here) = (here, next);
        }
    }

    pub(super) fn mean_sliding(&self, twist: &Twist) -> MeanSliding {
        let Some((ahead, speed)) = direction(twist) else { return MeanSliding::NONE };
        let kappa = twist.omega / speed * self.radius;
        self.sliding(&self.expand::<false>(ahead, kappa), ahead, kappa)
    }

    pub(super) fn mean_sliding_and_gradient(&self, twist: &Twist) -> (MeanSliding, SlidingGradient) {
        let Some((ahead, speed)) = direction(twist) else { return (MeanSliding::NONE, SlidingGradient::default()) };
        let kappa = twist.omega / speed * self.radius;
        let expansion = self.expand::<true>(ahead, kappa);
        (self.sliding(&expansion, ahead, kappa), self.gradient(&expansion, ahead, kappa, speed))
    }

    fn sliding(&self, e: &Expansion, ahead: Vector2<f64>, kappa: f64) -> MeanSliding {
        let direction = (e.f - kappa * e.k) * ahead + kappa * e.m * turn_left(ahead);
        MeanSliding { direction, moment: self.radius * e.k }
    }

    fn gradient(&self, e: &Expansion, ahead: Vector2<f64>, kappa: f64, speed: f64) -> SlidingGradient {
        let across = turn_left(ahead);
        let mixed = e.m + kappa * e.km;
        let (along_along, along_across) = (kappa * kappa * e.kk, -kappa * mixed);
        let across_across = e.f - 2.0 * kappa * e.k + kappa * kappa * e.mm;
        let entry = |i: usize, j: usize| {
            along_along * ahead[i] * ahead[j]
                + along_across * (ahead[i] * across[j] + across[i] * ahead[j])
                + across_across * across[i] * across[j]
        };
        SlidingGradient {
            by_velocity: [entry(0, 0), entry(0, 1), entry(1, 1)].map(|entry| entry / speed),
            by_both: self.radius * (mixed * across - kappa * e.kk * ahead) / speed,
            by_omega: self.radius * self.radius * e.kk / speed,
        }
    }

    fn expand<const BENDS: bool>(&self, ahead: Vector2<f64>, kappa: f64) -> Expansion {
        let k = Vector2::new(ahead.y, ahead.x);
        let (a, b) = (kappa * k.x, kappa * k.y);
        let expanding = Expanding::<BENDS> { columns: &self.columns[..=degree_for(kappa)], a, b };
        let Derivatives { f, fa, fb, faa, fab, fbb } = self.arch.dispatch(expanding);
        let (x, y) = (k.x, k.y);
        Expansion {
            f,
            k: fa * x + fb * y,
            m: fa * y - fb * x,
            kk: faa * x * x + 2.0 * fab * x * y + fbb * y * y,
            km: (faa - fbb) * x * y + fab * (y * y - x * x),
            mm: faa * y * y - 2.0 * fab * x * y + fbb * x * x,
        }
    }
}

/// `f` and its derivatives by `a` and `b`; those of second order only where wanted.
#[derive(Clone, Copy, Debug)]
struct Derivatives {
    f: f64,
    fa: f64,
    fb: f64,
    faa: f64,
    fab: f64,
    fbb: f64,
}

/// The sum of the series, with the machine's widest vectors.
struct Expanding<'a, const BENDS: bool> {
    columns: &'a [Column],
    a: f64,
    b: f64,
}

impl<const BENDS: bool> WithSimd for Expanding<'_, BENDS> {
    type Output = Derivatives;

    /// Horner's scheme in `a` for as many powers of `b` at once as fit, then the sum over these. Nothing is fused, so
    /// that every machine gives the same digits but for the order of that sum.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Derivatives {
        let Self { columns, a, b } = self;
        let powers = Powers::of(b);
        let [power, slope, bend] = [&powers.powers, &powers.slopes, &powers.bends].map(|rows| S::as_simd_f64s(rows).0);
        let (zero, a) = (simd.splat_f64s(0.0), simd.splat_f64s(a));
        let mut sums = [zero; 6];
        for block in 0..columns.len().div_ceil(S::F64_LANES) {
            let (mut g, mut ga, mut gaa) = (zero, zero, zero);
            // Beyond this there are no coefficients.
            for column in columns[..columns.len() - S::F64_LANES * block].iter().rev() {
                if BENDS {
                    gaa = simd.add_f64s(simd.mul_f64s(gaa, a), ga);
                }
                ga = simd.add_f64s(simd.mul_f64s(ga, a), g);
                g = simd.add_f64s(simd.mul_f64s(g, a), S::as_simd_f64s(column).0[block]);
            }
            let add = |sum: &mut S::f64s, x, y| *sum = simd.add_f64s(*sum, simd.mul_f64s(x, y));
            add(&mut sums[0], g, power[block]);
            add(&mut sums[1], ga, power[block]);
            add(&mut sums[2], g, slope[block]);
            if BENDS {
                add(&mut sums[3], gaa, power[block]);
                add(&mut sums[4], ga, slope[block]);
                add(&mut sums[5], g, bend[block]);
            }
        }
        let [f, fa, fb, half_faa, fab, fbb] = sums.map(|sum| simd.reduce_sum_f64s(sum));
        Derivatives { f, fa, fb, faa: 2.0 * half_faa, fab, fbb }
    }
}

/// The powers of a number, from 0, and their first and second derivatives.
struct Powers {
    powers: Column,
    slopes: Column,
    bends: Column,
}

impl Powers {
    #[inline(always)]
    fn of(b: f64) -> Self {
        let (mut powers, mut slopes, mut bends) = ([1.0; ROWS], [0.0; ROWS], [0.0; ROWS]);
        let square = b * b;
        powers[1] = b;
        for m in 2..ROWS {
            // Two chains, so that few products wait for others.
            powers[m] = powers[m - 2] * square;
        }
        for m in 1..ROWS {
            slopes[m] = m as f64 * powers[m - 1];
        }
        for m in 2..ROWS {
            bends[m] = (m * (m - 1)) as f64 * powers[m - 2];
        }
        Self { powers, slopes, bends }
    }
}

/// The degree at which the series may end, from how much its terms shrink with each degree.
fn degree_for(kappa: f64) -> usize {
    // The second derivatives begin at degree 2, and their error with the power of one degree less than the last.
    let mut degree = 2;
    let mut left_out = kappa.abs();
    while left_out > LEFT_OUT && degree < DEGREE {
        left_out *= kappa.abs();
        degree += 1;
    }
    degree
}

/// Points of a polygon's outline and `p × dp` there, with which the series comes out exactly.
pub(super) fn rays_of_polygon(vertices: &[Vector2<f64>]) -> impl Iterator<Item = (Vector2<f64>, f64)> {
    let ends = vertices.iter().cycle().skip(1);
    vertices.iter().zip(ends).flat_map(|(start, end)| {
        let (middle, half, cross) = ((start + end) / 2.0, (end - start) / 2.0, start.perp(end) / 2.0);
        NODES.into_iter().flat_map(move |(x, w)| [(middle + x * half, w * cross), (middle - x * half, w * cross)])
    })
}

/// The direction in which the centroid moves and its speed; `None` if it does not move.
fn direction(twist: &Twist) -> Option<(Vector2<f64>, f64)> {
    let speed = twist.velocity.norm();
    (speed != 0.0).then(|| (twist.velocity / speed, speed))
}
