//! A carried finger by finite elements: what its gauges feel and where its tip is, from nothing but the beam's equation.
//!
//! Euler–Bernoulli elements with cubic shapes (deflection and slope at each node), consistent mass, the disk's mass and
//! moment of inertia at the last node; damping proportional to stiffness, which is that of the material (Kelvin and
//! Voigt). Coordinates are those of the room: the first node is moved as the clamp is, and the beam follows. Newmark's
//! average acceleration, steps of 10 µs. Curvature at the gauges is the mean of the two elements that meet there.
//!
//! Shares nothing with `palpate_shared::sim`: all modes that the elements have, in double precision. Units: SI.
//! Panics where its own equations cannot be solved, which would be its own fault.

#![allow(clippy::needless_range_loop, reason = "rows and columns of a matrix")]

/// Elements between the clamp and the contact plane: 5 mm each of the default finger, so that its gauges are on a node.
const ELEMENTS: usize = 13;

/// The node that the gauges are at.
const GAUGE_NODE: usize = 1;

/// Deflections and slopes of all nodes.
const ALL: usize = 2 * (ELEMENTS + 1);

/// Without those of the clamp.
const FREE: usize = ALL - 2;

/// Length of a step, s: at 300 Hz (ω h)²/12 = 3e-5 of a period is lost.
pub const STEP_S: f64 = 1e-5;

type Matrix = Vec<Vec<f64>>;

/// A finger, by what it is made of.
#[derive(Clone, Copy, Debug)]
pub struct Finger {
    /// Bending stiffness, N·m².
    pub stiffness: f64,
    /// Mass per length, kg/m.
    pub mass_per_length: f64,
    /// From the clamp to the contact plane, m; the gauges are at a thirteenth of it.
    pub length: f64,
    /// Of the disk, kg.
    pub disk_mass: f64,
    /// Of the disk about its diameter, kg·m².
    pub disk_inertia: f64,
    /// Damping ratio of the first mode.
    pub damping_ratio: f64,
}

/// What happens to it at a time, along one axis.
#[derive(Clone, Copy, Debug, Default)]
pub struct Moment {
    /// Place of the clamp, m, its velocity and acceleration.
    pub clamp: [f64; 3],
    /// Force on the tip, N.
    pub force: f64,
}

/// What becomes of it.
#[derive(Clone, Copy, Debug)]
pub struct Seen {
    /// Bending moment that the gauges' strain stands for, over their distance to the contact plane, N.
    pub gauge_force: f64,
    /// Of the tip, less the clamp's, m.
    pub tip: f64,
}

/// A finger at rest that then lives through what `moment` says of each time, s, for so many steps.
#[must_use]
pub fn simulate(finger: &Finger, steps: usize, moment: impl Fn(f64) -> Moment) -> Vec<Seen> {
    let (mass, stiffness) = assembled(finger);
    let damping_time = 2.0 * finger.damping_ratio / first_frequency(&mass, &stiffness);
    // M ẍ + τ K ẋ + K x = f, with (x, ẋ, ẍ)₊ by Newmark: β = 1/4, γ = 1/2.
    let h = STEP_S;
    let effective: Matrix = (0..FREE)
        .map(|row| {
            let entry = |column: usize| {
                let k = stiffness[row + 2][column + 2];
                mass[row + 2][column + 2] + (0.5 * h * damping_time + 0.25 * h * h) * k
            };
            (0..FREE).map(entry).collect()
        })
        .collect();
    let solver = Factors::new(effective);
    let load = |now: &Moment| {
        let [place, velocity, acceleration] = now.clamp;
        let mut load: Vec<_> = (2..ALL)
            .map(|row| -mass[row][0] * acceleration - stiffness[row][0] * (damping_time * velocity + place))
            .collect();
        load[FREE - 2] += now.force;
        load
    };
    let first = moment(0.0);
    // It begins with the clamp's place and velocity throughout.
    let all = |value: f64| (0..FREE).map(|row| if row % 2 == 0 { value } else { 0.0 }).collect::<Vec<_>>();
    let (mut x, mut v) = (all(first.clamp[0]), all(first.clamp[1]));
    let mut a = Factors::new(free(&mass)).solve(load(&first));
    let mut seen = Vec::new();
    for step in 1..=steps {
        let now = moment(step as f64 * h);
        let x_ahead: Vec<_> = (0..FREE).map(|i| x[i] + h * v[i] + 0.25 * h * h * a[i]).collect();
        let v_ahead: Vec<_> = (0..FREE).map(|i| v[i] + 0.5 * h * a[i]).collect();
        let mut right = load(&now);
        for row in 0..FREE {
            for column in 0..FREE {
                right[row] -= stiffness[row + 2][column + 2] * (x_ahead[column] + damping_time * v_ahead[column]);
            }
        }
        // What rests and is not bent feels no elastic force: the forward part was taken whole.
        a = solver.solve(right);
        (0..FREE).for_each(|i| {
            x[i] = x_ahead[i] + 0.25 * h * h * a[i];
            v[i] = v_ahead[i] + 0.5 * h * a[i];
        });
        seen.push(look(finger, now.clamp[0], &x));
    }
    seen
}

/// What is seen of a deflection.
fn look(finger: &Finger, clamp: f64, x: &[f64]) -> Seen {
    let h = finger.length / ELEMENTS as f64;
    let node = |n: usize| if n == 0 { [clamp, 0.0] } else { [x[2 * n - 2], x[2 * n - 1]] };
    // Second derivative of the cubic between two nodes, at its start and its end.
    let curvature = |n: usize, at_end: bool| {
        let ([w0, s0], [w1, s1]) = (node(n), node(n + 1));
        let slope = (w1 - w0) / h;
        if at_end { (2.0 * s0 + 4.0 * s1 - 6.0 * slope) / h } else { (6.0 * slope - 4.0 * s0 - 2.0 * s1) / h }
    };
    let at_gauges = 0.5 * (curvature(GAUGE_NODE - 1, true) + curvature(GAUGE_NODE, false));
    let to_contact = finger.length - GAUGE_NODE as f64 * h;
    Seen { gauge_force: finger.stiffness * at_gauges / to_contact, tip: x[FREE - 2] - clamp }
}

/// Mass and stiffness of all nodes.
fn assembled(finger: &Finger) -> (Matrix, Matrix) {
    let h = finger.length / ELEMENTS as f64;
    let k = finger.stiffness / (h * h * h);
    let stiffness = [
        [12.0, 6.0 * h, -12.0, 6.0 * h],
        [6.0 * h, 4.0 * h * h, -6.0 * h, 2.0 * h * h],
        [-12.0, -6.0 * h, 12.0, -6.0 * h],
        [6.0 * h, 2.0 * h * h, -6.0 * h, 4.0 * h * h],
    ];
    let m = finger.mass_per_length * h / 420.0;
    let mass = [
        [156.0, 22.0 * h, 54.0, -13.0 * h],
        [22.0 * h, 4.0 * h * h, 13.0 * h, -3.0 * h * h],
        [54.0, 13.0 * h, 156.0, -22.0 * h],
        [-13.0 * h, -3.0 * h * h, -22.0 * h, 4.0 * h * h],
    ];
    let (mut all_mass, mut all_stiffness) = (vec![vec![0.0; ALL]; ALL], vec![vec![0.0; ALL]; ALL]);
    for element in 0..ELEMENTS {
        for row in 0..4 {
            for column in 0..4 {
                all_mass[2 * element + row][2 * element + column] += m * mass[row][column];
                all_stiffness[2 * element + row][2 * element + column] += k * stiffness[row][column];
            }
        }
    }
    all_mass[ALL - 2][ALL - 2] += finger.disk_mass;
    all_mass[ALL - 1][ALL - 1] += finger.disk_inertia;
    (all_mass, all_stiffness)
}

/// Without the clamp.
fn free(all: &Matrix) -> Matrix {
    all[2..].iter().map(|row| row[2..].to_vec()).collect()
}

/// Angular frequency of the first mode, rad/s: inverse iteration, and Rayleigh's quotient.
fn first_frequency(mass: &Matrix, stiffness: &Matrix) -> f64 {
    let (mass, stiffness) = (free(mass), free(stiffness));
    let by = |matrix: &Matrix, x: &[f64]| -> Vec<f64> {
        matrix.iter().map(|row| row.iter().zip(x).map(|(a, b)| a * b).sum()).collect()
    };
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let solver = Factors::new(stiffness.clone());
    let mut shape = vec![1.0; FREE];
    for _ in 0..50 {
        shape = solver.solve(by(&mass, &shape));
        let size = dot(&shape, &shape).sqrt();
        shape.iter_mut().for_each(|x| *x /= size);
    }
    (dot(&shape, &by(&stiffness, &shape)) / dot(&shape, &by(&mass, &shape))).sqrt()
}

/// A symmetric, positive definite matrix as L Lᵀ.
struct Factors(Matrix);

impl Factors {
    fn new(matrix: Matrix) -> Self {
        let n = matrix.len();
        let mut l = vec![vec![0.0_f64; n]; n];
        for row in 0..n {
            for column in 0..=row {
                let sum: f64 = (0..column).map(|k| l[row][k] * l[column][k]).sum();
                let left = matrix[row][column] - sum;
                l[row][column] = if row == column {
                    assert!(left > 0.0, "the beam's equations are not positive definite at {row}");
                    left.sqrt()
                } else {
                    left / l[column][column]
                };
            }
        }
        Self(l)
    }

    fn solve(&self, mut right: Vec<f64>) -> Vec<f64> {
        let (l, n) = (&self.0, right.len());
        for row in 0..n {
            let sum: f64 = (0..row).map(|k| l[row][k] * right[k]).sum();
            right[row] = (right[row] - sum) / l[row][row];
        }
        for row in (0..n).rev() {
            let sum: f64 = (row + 1..n).map(|k| l[k][row] * right[k]).sum();
            right[row] = (right[row] - sum) / l[row][row];
        }
        right
    }
}
