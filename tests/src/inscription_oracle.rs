//! Inscription by exhaustion: every assignment of vertices to lines, and every minimum of χ² that a blind search finds.
//!
//! Shares nothing with the code it checks: no support function, no sweep, no derivatives. Slow: for small polygons.
//! Units: m, rad. Poses are `[x, y, theta]`, `p_world = R(theta) p_part + (x, y)`.

use std::f64::consts::{PI, TAU};

/// The points q with q·(cos, sin)(angle) ≤ offset: `(angle, offset)`.
pub type Line = (f64, f64);

/// A sensor's place and the angles of the right and left sides of what it sees.
pub type Cone = ([f64; 2], f64, f64);

/// Residuals up to this share of the part's size touch.
const TOUCH_RELATIVE: f64 = 1e-9;
/// Poses nearer than this, in sizes and rad, are one.
const SAME: f64 = 1e-7;
/// A cosine may exceed 1 by this much at a tangency.
const TANGENT: f64 = 1e-13;

/// The lines of a cone.
#[must_use]
pub fn lines_of(cone: &Cone) -> [Line; 2] {
    let ([x, y], right, left) = *cone;
    let through = |angle: f64| (angle, x * angle.cos() + y * angle.sin());
    [through(right - PI / 2.0), through(left + PI / 2.0)]
}

/// Where a pose takes the vertices.
#[must_use]
pub fn moved(polygon: &[[f64; 2]], [x, y, theta]: [f64; 3]) -> Vec<[f64; 2]> {
    let (sin, cos) = theta.sin_cos();
    polygon.iter().map(|[px, py]| [cos * px - sin * py + x, sin * px + cos * py + y]).collect()
}

/// The longer side of the bounding box.
#[must_use]
pub fn size(polygon: &[[f64; 2]]) -> f64 {
    let span = |axis: usize| {
        let all = || polygon.iter().map(|p| p[axis]);
        all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
    };
    span(0).max(span(1))
}

/// The largest distance between a line and the outermost vertex toward it.
#[must_use]
pub fn residual(polygon: &[[f64; 2]], lines: &[Line], pose: [f64; 3]) -> f64 {
    let vertices = moved(polygon, pose);
    let miss = |(angle, offset): &Line| {
        let beyond = vertices.iter().map(|p| p[0] * angle.cos() + p[1] * angle.sin() - offset);
        beyond.fold(f64::NEG_INFINITY, f64::max).abs()
    };
    lines.iter().map(miss).fold(0.0, f64::max)
}

/// All poses that touch all lines, by trying every vertex on each of three lines that are not concurrent; none if all
/// are.
#[must_use]
pub fn all_poses(polygon: &[[f64; 2]], lines: &[Line]) -> Option<Vec<[f64; 3]>> {
    let three = widest_triple(lines)?;
    let (n, size) = (polygon.len(), size(polygon));
    let mut poses: Vec<[f64; 3]> = Vec::new();
    for index in 0..n * n * n {
        let vertices = [index % n, index / n % n, index / n / n].map(|k| polygon[k]);
        for pose in poses_on(vertices, three) {
            let is_new = poses.iter().all(|other| !same(*other, pose, size));
            if residual(polygon, lines, pose) <= TOUCH_RELATIVE * size && is_new {
                poses.push(pose);
            }
        }
    }
    poses.sort_by(|a, b| a[2].total_cmp(&b[2]));
    Some(poses)
}

/// Whether two poses are one.
#[must_use]
pub fn same(a: [f64; 3], b: [f64; 3], size: f64) -> bool {
    let turn = (a[2] - b[2]).rem_euclid(TAU);
    turn.min(TAU - turn) < SAME && (a[0] - b[0]).hypot(a[1] - b[1]) < SAME * size
}

/// The three lines with the largest determinant of their coefficients.
fn widest_triple(lines: &[Line]) -> Option<[Line; 3]> {
    let mut best = (1e-10, None);
    for a in 0..lines.len() {
        for b in a + 1..lines.len() {
            for c in b + 1..lines.len() {
                let three = [lines[a], lines[b], lines[c]];
                let [p, q, r] = three.map(|(angle, offset)| [angle.cos(), angle.sin(), offset]);
                let determinant = p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
                    + p[2] * (q[0] * r[1] - q[1] * r[0]);
                if determinant.abs() > best.0 {
                    best = (determinant.abs(), Some(three));
                }
            }
        }
    }
    best.1
}

/// The poses that put three vertices on three lines.
///
/// Subtracting multiples of two equations removes the position from the third; what is left is a cos θ + b sin θ = c.
fn poses_on(vertices: [[f64; 2]; 3], lines: [Line; 3]) -> Vec<[f64; 3]> {
    // n·(R v + t) = offset, with R v = cos θ (x, y) + sin θ (−y, x).
    let rows = [0, 1, 2].map(|k| {
        let ((angle, offset), [x, y]) = (lines[k], vertices[k]);
        let n = [angle.cos(), angle.sin()];
        (n, [n[0] * x + n[1] * y, n[1] * x - n[0] * y, offset])
    });
    // The pair of lines that cross at the largest angle gives the position.
    let cross = |i: usize, j: usize| rows[i].0[0] * rows[j].0[1] - rows[i].0[1] * rows[j].0[0];
    let pairs = [(0, 1, 2), (0, 2, 1), (1, 2, 0)];
    let Some(&(i, j, k)) = pairs.iter().max_by(|a, b| cross(a.0, a.1).abs().total_cmp(&cross(b.0, b.1).abs())) else {
        return Vec::new();
    };
    let (share_i, share_j) = (cross(k, j) / cross(i, j), cross(i, k) / cross(i, j));
    let [a, b, c] = [0, 1, 2].map(|term| rows[k].1[term] - share_i * rows[i].1[term] - share_j * rows[j].1[term]);
    let reach = a.hypot(b);
    let ratio = c / reach;
    if reach < 1e-300 || ratio.abs() > 1.0 + TANGENT {
        return Vec::new();
    }
    let (middle, half) = (b.atan2(a), ratio.clamp(-1.0, 1.0).acos());
    let pose = |theta: f64| {
        let right = |k: usize| rows[k].1[2] - theta.cos() * rows[k].1[0] - theta.sin() * rows[k].1[1];
        let x = (right(i) * rows[j].0[1] - right(j) * rows[i].0[1]) / cross(i, j);
        let y = (rows[i].0[0] * right(j) - rows[j].0[0] * right(i)) / cross(i, j);
        [x, y, theta.rem_euclid(TAU)]
    };
    vec![pose(middle + half), pose(middle - half)]
}

/// The angle in [−π, π).
fn wrap(angle: f64) -> f64 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// χ² of a pose: every bearing of every vertex, the least and the largest of which are the sides.
#[must_use]
pub fn chi2(polygon: &[[f64; 2]], cones: &[Cone], sigma: f64, pose: [f64; 3]) -> f64 {
    let vertices = moved(polygon, pose);
    let of_cone = |(apex, right, left): &Cone| {
        let middle = f64::midpoint(*right, *left);
        let bearings = || vertices.iter().map(|p| wrap((p[1] - apex[1]).atan2(p[0] - apex[0]) - middle) + middle);
        let (low, high) = (bearings().fold(f64::INFINITY, f64::min), bearings().fold(f64::NEG_INFINITY, f64::max));
        wrap(low - right).powi(2) + wrap(high - left).powi(2)
    };
    cones.iter().map(of_cone).sum::<f64>() / (sigma * sigma)
}

/// Where a compass search without derivatives comes to rest.
///
/// It tries steps along many directions and halves their length when none helps; lengths in units of the size and rad.
pub fn descend(
    objective: impl Fn([f64; 3]) -> f64,
    start: [f64; 3],
    size: f64,
    step: f64,
    mut direction: impl FnMut() -> [f64; 3],
) -> ([f64; 3], f64) {
    let (mut at, mut value, mut length) = (start, objective(start), step);
    let mut failures = 0;
    while length > 1e-11 {
        let d = direction();
        let next = [at[0] + length * size * d[0], at[1] + length * size * d[1], at[2] + length * d[2]];
        let there = objective(next);
        if there < value {
            (at, value, failures) = (next, there, 0);
            length *= 2.0;
        } else {
            failures += 1;
            if failures > 12 {
                (length, failures) = (length * 0.6, 0);
            }
        }
    }
    (at, value)
}
