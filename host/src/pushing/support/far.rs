//! Support friction for centres of rotation far away, up to and through pure translation.
//!
//! Write points and velocities as complex numbers, `V` for the velocity of the centroid. The point `p` moves with
//! `V + iωp = V (1 + εp)`, `ε = iω/V`, so the mean speed is `Φ = |V| f(ε)` with `f = ∫ |1 + εp| dA / A`. Far from the centre of
//! rotation `|εp| < 1`, and `f` is a power series in the two real parts of `ε`, whose coefficients are moments of the part: it is as
//! good at `ω = 0` as beside it, and costs the same for any number of vertices.
//!
//! With `κ = ω/|V|` and the unit vector `k = (V_y, V_x)/|V|`, `ε = κ k`; let `m = (k_b, −k_a)`, and subscripts of `f` be derivatives
//! in those directions. Along and across `V`:
//!
//! ```text
//! I₁/A = (f − κ f_k, κ f_m)         I₂/A = f_k
//! |V| ∂²Φ/∂V² = ( κ² f_kk              −κ (f_m + κ f_km)         )     |V| ∂I₂/∂ω = A f_kk
//!               ( −κ (f_m + κ f_km)    f − 2κ f_k + κ² f_mm      )     |V| ∂I₂/∂V = A (−κ f_kk, f_m + κ f_km)
//! ```
//!
//! Frames: the part's axes, origin at the centroid. Units: SI. Errors: none.

use nalgebra::{Matrix3, Vector2};

use super::{MeanSliding, Twist, turn_left};

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

/// The series of one part.
#[derive(Clone, Debug)]
pub(super) struct Far {
    /// `rows[m][j]` is the factor of `a^j b^m` in `f`, where `(a, b) = ε·radius`.
    rows: Vec<Vec<f64>>,
    radius: f64,
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

impl Far {
    /// The series of a shape whose outline is given by points and `p × dp` there, relative to its centroid.
    pub(super) fn new(rays: impl Iterator<Item = (Vector2<f64>, f64)>, area: f64, radius: f64) -> Self {
        let mut series = Self { rows: (0..=DEGREE).map(|m| vec![0.0; DEGREE + 1 - m]).collect(), radius };
        for (p, cross) in rays {
            series.add_ray(p / radius, cross / area);
        }
        series
    }

    /// Adds the triangles between the centroid and a bit of the outline at `p` (in radii); `weight` is twice their share of the area.
    ///
    /// `|1 + εp| = Σ Pₙ`, homogeneous of degree `n` in `ε` and `p` each: `n Pₙ = −(2n − 3) ℓ Pₙ₋₁ − (n − 3) |ε|²|p|² Pₙ₋₂`, with
    /// `ℓ = Re εp` (the recurrence of Gegenbauer polynomials). From the centroid outwards it integrates to `Pₙ/(n + 2)`.
    fn add_ray(&mut self, p: Vector2<f64>, weight: f64) {
        let p2 = p.norm_squared();
        let (mut before, mut here) = ([0.0; DEGREE + 1], [0.0; DEGREE + 1]);
        here[0] = 1.0;
        for n in 0..=DEGREE {
            let share = weight / (n as f64 + 2.0);
            for (m, p_m) in here[..=n].iter().enumerate() {
                self.rows[m][n - m] += share * p_m;
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
        self.sliding(&self.expand(ahead, kappa), ahead, kappa)
    }

    pub(super) fn mean_sliding_and_gradient(&self, twist: &Twist) -> (MeanSliding, Matrix3<f64>) {
        let Some((ahead, speed)) = direction(twist) else { return (MeanSliding::NONE, Matrix3::zeros()) };
        let kappa = twist.omega / speed * self.radius;
        let expansion = self.expand(ahead, kappa);
        (self.sliding(&expansion, ahead, kappa), self.gradient(&expansion, ahead, kappa) / speed)
    }

    fn sliding(&self, e: &Expansion, ahead: Vector2<f64>, kappa: f64) -> MeanSliding {
        let direction = (e.f - kappa * e.k) * ahead + kappa * e.m * turn_left(ahead);
        MeanSliding { direction, moment: self.radius * e.k }
    }

    /// The gradient times the speed of the centroid.
    fn gradient(&self, e: &Expansion, ahead: Vector2<f64>, kappa: f64) -> Matrix3<f64> {
        let across = turn_left(ahead);
        let mixed = e.m + kappa * e.km;
        let by_velocity = kappa * kappa * e.kk * ahead * ahead.transpose()
            - kappa * mixed * (ahead * across.transpose() + across * ahead.transpose())
            + (e.f - 2.0 * kappa * e.k + kappa * kappa * e.mm) * across * across.transpose();
        let by_both = self.radius * (mixed * across - kappa * e.kk * ahead);
        let by_omega = self.radius * self.radius * e.kk;
        let v = by_velocity;
        #[rustfmt::skip]
        let gradient = Matrix3::new(
            v.m11, v.m12, by_both.x,
            v.m21, v.m22, by_both.y,
            by_both.x, by_both.y, by_omega,
        );
        gradient
    }

    /// Horner's scheme in both variables.
    fn expand(&self, ahead: Vector2<f64>, kappa: f64) -> Expansion {
        let k = Vector2::new(ahead.y, ahead.x);
        let (a, b) = (kappa * k.x, kappa * k.y);
        let degree = degree_for(kappa);
        let (mut f, mut fa, mut fb, mut faa, mut fab, mut fbb) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        for (m, row) in self.rows[..=degree].iter().enumerate().rev() {
            let (mut g, mut ga, mut gaa) = (0.0, 0.0, 0.0);
            for coefficient in row[..=degree - m].iter().rev() {
                gaa = gaa * a + 2.0 * ga;
                ga = ga * a + g;
                g = g * a + coefficient;
            }
            fbb = fbb * b + 2.0 * fb;
            fb = fb * b + f;
            f = f * b + g;
            fab = fab * b + fa;
            fa = fa * b + ga;
            faa = faa * b + gaa;
        }
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
    (speed > 0.0).then(|| (twist.velocity / speed, speed))
}
