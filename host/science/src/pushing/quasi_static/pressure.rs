//! Friction of a polygon on which the pressure rises linearly along one direction, and is nought where that would be
//! negative.
//!
//! The pressure is `λ·y` with `y = (1, x/ρ, y/ρ)`, `ρ` the part's size, on what of the polygon has `λ·y ≥ 0`. With `q`
//! the centre of rotation, `x` seen from it, `r = |x|`, and for each edge its outward normal `n`, its direction `t`, the
//! distance `h` of `q` from its line, and `s` along it from the foot of `q`:
//!
//! ```text
//! Λ = ∫ ds/r        K = ∫ r ds        J = ∫ s²/r ds
//! G = ∫ x/r dA = Σ n K                        M = ∫ r dA = Σ h K/3
//! T = ∫ x xᵀ/r dA = Σ h (n nᵀ h² Λ + (n tᵀ + t nᵀ) h Δr + t tᵀ J)/3
//! H = ∫ r x dA = Σ h (n h K + t Δr³/3)/4
//! S = ∂²/∂q² ∫ L r dA = Σ n (n h (L₀ Λ + L₁ Δr) + t (L₀ Δr + L₁ J))ᵀ − ∇L Gᵀ,  with L = L₀ + L₁ s along the edge
//! ```
//!
//! by the divergence theorem, as in the support's `uniform`. Far centres of rotation, for which these cancel, are
//! summed over Gauss points instead: the part's speeds are smooth then.
//!
//! Frames: part axes, origin at the centroid. Units: SI. Errors: none.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use super::support::Resistance;

/// From this distance of the centre of rotation on, in sizes of the part, it is far: the closed form loses the cube of
/// this times 1e-16, the rule of [`GAUSS`] errs by less.
const FAR: f64 = 6.0;

/// Positive points and weights of the Gauss rule with 8 points, for an interval of length 2.
const GAUSS: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_3),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// A polygon under pressure.
#[derive(Clone, Debug)]
pub(super) struct Face {
    /// Seen from the centroid, m.
    vertices: Vec<Vector2<f64>>,
    /// m².
    area: f64,
    /// The largest distance of a vertex from the centroid, m.
    size: f64,
    /// Means of `y yᵀ` over the whole polygon.
    moments: Matrix3<f64>,
    /// Of the whole polygon.
    points: Vec<GaussPoint>,
}

/// A place, m, and its share of the polygon's area.
#[derive(Clone, Copy, Debug)]
struct GaussPoint {
    at: Vector2<f64>,
    share: f64,
}

/// Integrals that do not depend on the pressure.
#[derive(Default)]
struct Sums {
    pull: Vector2<f64>,
    distance: f64,
    tensor: Matrix2<f64>,
    distance_moment: Vector2<f64>,
}

impl Face {
    pub(super) fn new(vertices: Vec<Vector2<f64>>, area: f64, size: f64) -> Self {
        let moments = moments(&vertices, size) / area;
        let points = gauss_points(&vertices, area).collect();
        Self { vertices, area, size, moments, points }
    }

    /// How the face resists a twist (of the centroid) under the pressure `load`, per friction and weight.
    pub(super) fn resistance(&self, twist: &Vector3<f64>, load: &Vector3<f64>) -> Resistance {
        let pressed = self.pressed(load);
        let is_near = twist.xy().norm() < FAR * self.size * twist.z.abs();
        let mut resistance = match &pressed {
            None if is_near => self.near(&self.vertices, twist, load),
            None => self.far(self.points.iter().copied(), twist, load),
            Some(part) if is_near => self.near(part, twist, load),
            Some(part) => self.far(gauss_points(part, self.area), twist, load),
        };
        resistance.weighing = pressed.map_or(self.moments, |part| moments(&part, self.size) / self.area);
        resistance
    }

    /// What of the polygon is pressed on, if not all: pieces of it joined along the border count as one polygon.
    fn pressed(&self, load: &Vector3<f64>) -> Option<Vec<Vector2<f64>>> {
        let pressure = |p: &Vector2<f64>| load.x + (load.y * p.x + load.z * p.y) / self.size;
        if self.vertices.iter().all(|p| pressure(p) >= 0.0) {
            return None;
        }
        let mut kept = Vec::with_capacity(self.vertices.len() + 4);
        for (i, from) in self.vertices.iter().enumerate() {
            let to = &self.vertices[(i + 1) % self.vertices.len()];
            let (at_from, at_to) = (pressure(from), pressure(to));
            if at_from >= 0.0 {
                kept.push(*from);
            }
            if (at_from >= 0.0) != (at_to >= 0.0) {
                kept.push(from + (to - from) * (at_from / (at_from - at_to)));
            }
        }
        Some(kept)
    }

    fn near(&self, vertices: &[Vector2<f64>], twist: &Vector3<f64>, load: &Vector3<f64>) -> Resistance {
        let pole = Vector2::new(-twist.y, twist.x) / twist.z;
        let slope = Vector2::new(load.y, load.z) / self.size;
        let at_pole = load.x + slope.dot(&pole);
        let mut sums = Sums::default();
        let mut bend = Matrix2::zeros();
        for (i, from) in vertices.iter().enumerate() {
            let (start, end) = (from - pole, vertices[(i + 1) % vertices.len()] - pole);
            sums.add_edge(start, end, at_pole, slope, &mut bend);
        }
        bend -= slope * sums.pull.transpose();
        let (sign, per_area) = (twist.z.signum(), self.area.recip());
        let column = |pull: Vector2<f64>, moment: f64| {
            let force = sign * per_area * Vector2::new(-pull.y, pull.x);
            Vector3::new(force.x, force.y, sign * per_area * moment + pole.perp(&force))
        };
        let Sums { pull, distance, tensor, distance_moment } = sums;
        let rising = |k: usize| {
            let pulled = tensor.column(k) + pull * pole[k];
            column(pulled / self.size, (distance_moment[k] + pole[k] * distance) / self.size)
        };
        let by_load = Matrix3::from_columns(&[column(pull, distance), rising(0), rising(1)]);
        // The speeds are of degree 1 in the twist, which gives the rest of the gradient.
        let scale = per_area / twist.z.abs();
        let off = -0.5 * scale * (bend.m12 + bend.m21);
        let by_velocity = Matrix2::new(scale * bend.m22, off, off, scale * bend.m11);
        let per_omega = Vector2::new(twist.x, twist.y) / twist.z;
        let both = -(by_velocity * per_omega);
        let turning = -both.dot(&per_omega);
        let by_twist = Matrix3::new(
            by_velocity.m11,
            by_velocity.m12,
            both.x, //
            by_velocity.m21,
            by_velocity.m22,
            both.y, //
            both.x,
            both.y,
            turning,
        );
        Resistance { by_load, by_twist, weighing: Matrix3::zeros(), slowest: f64::INFINITY }
    }

    fn far(&self, points: impl Iterator<Item = GaussPoint>, twist: &Vector3<f64>, load: &Vector3<f64>) -> Resistance {
        let (load_x, load_y) = (load.y / self.size, load.z / self.size);
        // Friction under an even pressure and under those that rise along x and along y.
        let mut by_load = [[0.0; 3]; 3];
        let [mut xx, mut xy, mut yy, mut xm, mut ym, mut mm] = [0.0; 6];
        for GaussPoint { at, share } in points {
            let (u, v) = (twist.x - twist.z * at.y, twist.y + twist.z * at.x);
            let per_speed = 1.0 / (u * u + v * v).sqrt();
            let (fx, fy) = (u * per_speed, v * per_speed);
            let moment = at.x * fy - at.y * fx;
            let bears = share * per_speed * (load.x + load_x * at.x + load_y * at.y);
            for (column, pressure) in by_load.iter_mut().zip([share, share * at.x, share * at.y]) {
                column[0] += pressure * fx;
                column[1] += pressure * fy;
                column[2] += pressure * moment;
            }
            xx += bears * (1.0 - fx * fx);
            xy -= bears * fx * fy;
            yy += bears * (1.0 - fy * fy);
            xm -= bears * (at.y + fx * moment);
            ym += bears * (at.x - fy * moment);
            mm += bears * (at.x * at.x + at.y * at.y - moment * moment);
        }
        let [even, along_x, along_y] = by_load.map(Vector3::from);
        Resistance {
            by_load: Matrix3::from_columns(&[even, along_x / self.size, along_y / self.size]),
            by_twist: Matrix3::new(xx, xy, xm, xy, yy, ym, xm, ym, mm),
            weighing: Matrix3::zeros(),
            slowest: f64::INFINITY,
        }
    }
}

/// Gauss points of a polygon, in triangles that its first vertex makes with its edges; shares are of an area of `area`, m².
fn gauss_points(vertices: &[Vector2<f64>], area: f64) -> impl Iterator<Item = GaussPoint> + '_ {
    let points = || GAUSS.iter().flat_map(|&(x, w)| [(0.5 - 0.5 * x, 0.5 * w), (0.5 + 0.5 * x, 0.5 * w)]);
    // There may be none where nothing is pressed.
    let first = vertices.first().copied().unwrap_or_default();
    vertices.windows(2).skip(1).flat_map(move |edge| {
        let (from, along) = (edge[0] - first, edge[1] - edge[0]);
        let cross = from.perp(&along) / area;
        points().flat_map(move |(outwards, weight)| {
            points().map(move |(share, other_weight)| GaussPoint {
                at: first + outwards * (from + share * along),
                share: cross * weight * other_weight * outwards,
            })
        })
    })
}

impl Sums {
    /// Adds an edge whose ends are seen from the pole, and its part of `S` to `bend`.
    fn add_edge(
        &mut self,
        start: Vector2<f64>,
        end: Vector2<f64>,
        at_pole: f64,
        slope: Vector2<f64>,
        bend: &mut Matrix2<f64>,
    ) {
        let along = end - start;
        let length = along.norm();
        if length == 0.0 {
            return;
        }
        let t = along / length;
        let n = Vector2::new(t.y, -t.x);
        let (h, s0, s1) = (start.dot(&n), start.dot(&t), end.dot(&t));
        let (r0, r1) = (start.norm(), end.norm());
        // The logarithm comes with a factor that vanishes where it does not exist.
        let log = if h == 0.0 {
            0.0
        } else if s0 >= 0.0 {
            ((s1 + r1) / (s0 + r0)).ln()
        } else if s1 <= 0.0 {
            ((r0 - s0) / (r1 - s1)).ln()
        } else {
            ((s1 + r1) * (r0 - s0) / (h * h)).ln()
        };
        let difference = r1 - r0;
        let (ends, bow) = (s1 * r1 - s0 * r0, h * h * log);
        let (k, j) = (0.5 * (ends + bow), 0.5 * (ends - bow));
        self.pull += n * k;
        self.distance += h * k / 3.0;
        let mixed = n * t.transpose();
        self.tensor +=
            (n * n.transpose() * bow + (mixed + mixed.transpose()) * (h * difference) + t * t.transpose() * j)
                * (h / 3.0);
        self.distance_moment += (n * (h * k) + t * ((r1.powi(3) - r0.powi(3)) / 3.0)) * (h / 4.0);
        let (constant, rising) = (at_pole + h * slope.dot(&n), slope.dot(&t));
        let across = h * (constant * log + rising * difference);
        let lengthwise = constant * difference + rising * j;
        *bend += n * (n * across + t * lengthwise).transpose();
    }
}

/// Integrals of `y yᵀ` over a polygon, m².
fn moments(vertices: &[Vector2<f64>], size: f64) -> Matrix3<f64> {
    let mut sum = Matrix3::zeros();
    for (i, a) in vertices.iter().enumerate() {
        let b = vertices[(i + 1) % vertices.len()];
        let cross = a.perp(&b);
        let (p, q) = (a / size, b / size);
        let first = (p + q) / 6.0;
        let second = |u: usize, v: usize| (2.0 * (p[u] * p[v] + q[u] * q[v]) + p[u] * q[v] + p[v] * q[u]) / 24.0;
        let (xx, xy, yy) = (second(0, 0), second(0, 1), second(1, 1));
        sum += Matrix3::new(0.5, first.x, first.y, first.x, xx, xy, first.y, xy, yy) * cross;
    }
    sum
}
