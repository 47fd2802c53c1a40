//! A first matrix that up to nearly half of the contacts being wrong does not spoil.
//!
//! Least median of squares over small subsets: every pair of contacts whose loads compare gives a matrix, and so does
//! every triple by directions alone (`n⊥ · A d = 0`, three equations for four entries up to their size). The one that
//! leaves the smallest middle misfit among all contacts wins. Exhaustive in a fixed order instead of random: the same
//! data give the same matrix, bit for bit.
//!
//! Source: Rousseeuw, "Least median of squares regression", JASA 79 (1984).
//! Frames: finger. Units: whatever counts and loads come in; misfits are angles in rad and logarithms of ratios.
//! Errors: `None` if no subset determines a matrix.

use nalgebra::{Matrix2, Matrix3, Matrix3x4, Vector2, Vector4};

use super::measurements::Load;
use crate::math::angle::{contact_angle, push_direction, wrap_angle};
use crate::math::statistics::median;

/// One contact reduced to what a first guess needs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observation {
    /// Contact angle, rad.
    pub(super) angle: f64,
    /// What is known of its size.
    pub(super) load: Load,
    /// Counts with the tare taken off.
    pub(super) counts: Vector2<f64>,
}

/// At most this many triples are tried; 24 contacts have 2024. More are thinned evenly, which keeps it under 0.1 s.
const TRIPLES_MAX: usize = 20_000;

/// The same for pairs; 72 contacts have 2556.
const PAIRS_MAX: usize = 5_000;

/// A determinant below this, of unit vectors, means that a subset does not determine a matrix.
const DEGENERATE: f64 = 1e-6;

/// The inverse matrix `A` (force over counts, of right sign; its size is right only if a load is known).
pub(super) fn robust_inverse(observations: &[Observation]) -> Option<Matrix2<f64>> {
    let candidates = from_pairs(observations).into_iter().chain(from_triples(observations));
    let mut best: Option<(f64, Matrix2<f64>)> = None;
    for candidate in candidates.filter_map(|candidate| with_sign(candidate, observations)) {
        let misfit = middle_misfit(&candidate, observations);
        if misfit.is_finite() && best.is_none_or(|(least, _)| misfit < least) {
            best = Some((misfit, candidate));
        }
    }
    best.map(|(_, inverse)| with_size(inverse, observations))
}

/// Relative size of a load that can be compared with another of the same kind.
fn comparable_load(load: Load) -> Option<f64> {
    match load {
        Load::Unknown => None,
        Load::Same => Some(1.0),
        Load::Newtons(newtons) => Some(newtons),
    }
}

/// Whether two loads are both known, or both the same.
fn compare(a: Load, b: Load) -> bool {
    matches!((a, b), (Load::Same, Load::Same) | (Load::Newtons(_), Load::Newtons(_)))
}

fn from_pairs(observations: &[Observation]) -> Vec<Matrix2<f64>> {
    let n = observations.len();
    let stride = (n * n.saturating_sub(1) / 2).div_ceil(PAIRS_MAX).max(1);
    let pairs = (0..n).flat_map(|i| (i + 1..n).map(move |j| (&observations[i], &observations[j])));
    pairs.step_by(stride).filter(|(a, b)| compare(a.load, b.load)).filter_map(|(a, b)| from_pair(a, b)).collect()
}

/// `A = [F₁ F₂] [d₁ d₂]⁻¹`.
fn from_pair(a: &Observation, b: &Observation) -> Option<Matrix2<f64>> {
    let force = |o: &Observation| comparable_load(o.load).map(|load| push_direction(o.angle) * load);
    let forces = Matrix2::from_columns(&[force(a)?, force(b)?]);
    let directions = push_direction(a.angle).perp(&push_direction(b.angle));
    let counts = Matrix2::from_columns(&[a.counts, b.counts]);
    let spread = counts.determinant().abs() / (a.counts.norm() * b.counts.norm());
    if directions.abs() < DEGENERATE || spread.is_nan() || spread < DEGENERATE {
        return None;
    }
    counts.try_inverse().map(|inverse| forces * inverse)
}

fn from_triples(observations: &[Observation]) -> Vec<Matrix2<f64>> {
    let n = observations.len();
    let count = n * n.saturating_sub(1) * n.saturating_sub(2) / 6;
    let stride = count.div_ceil(TRIPLES_MAX).max(1);
    let triples = (0..n).flat_map(|i| (i + 1..n).flat_map(move |j| (j + 1..n).map(move |k| [i, j, k])));
    triples.step_by(stride).filter_map(|triple| from_triple(triple.map(|index| &observations[index]))).collect()
}

/// The matrix with `n⊥ · A d = 0` for three contacts, of length 1 and either sign.
fn from_triple(triple: [&Observation; 3]) -> Option<Matrix2<f64>> {
    let mut equations = Matrix3x4::zeros();
    for (row, observation) in triple.into_iter().enumerate() {
        let (n, d) = (push_direction(observation.angle), observation.counts.try_normalize(0.0)?);
        equations.set_row(row, &nalgebra::RowVector4::new(-n.y * d.x, -n.y * d.y, n.x * d.x, n.x * d.y));
    }
    let entries = null_vector(&equations).try_normalize(DEGENERATE)?;
    let matrix = Matrix2::new(entries[0], entries[1], entries[2], entries[3]);
    (matrix.determinant().abs() > DEGENERATE).then_some(matrix)
}

/// The vector orthogonal to three rows: their generalised cross product.
fn null_vector(rows: &Matrix3x4<f64>) -> Vector4<f64> {
    let minor = |skipped: usize| -> f64 {
        let kept: [usize; 3] = std::array::from_fn(|index| if index < skipped { index } else { index + 1 });
        Matrix3::from_columns(&kept.map(|column| rows.column(column).into_owned())).determinant()
    };
    Vector4::new(minor(0), -minor(1), minor(2), -minor(3))
}

/// Chooses the sign with which most contacts push instead of pull.
fn with_sign(inverse: Matrix2<f64>, observations: &[Observation]) -> Option<Matrix2<f64>> {
    let pushes = |o: &&Observation| push_direction(o.angle).dot(&(inverse * o.counts)) > 0.0;
    let pushing = observations.iter().filter(pushes).count();
    let sign = if 2 * pushing >= observations.len() { 1.0 } else { -1.0 };
    inverse.iter().all(|entry| entry.is_finite()).then_some(inverse * sign)
}

/// The misfit that half of all contacts (and three more) stay below: angle², plus log-ratio² where loads compare.
fn middle_misfit(inverse: &Matrix2<f64>, observations: &[Observation]) -> f64 {
    let sizes = LogSizes::new(inverse, observations);
    let mut misfits: Vec<f64> =
        observations.iter().map(|o| angle_misfit(inverse, o).powi(2) + sizes.misfit(inverse, o).powi(2)).collect();
    misfits.sort_by(f64::total_cmp);
    let middle = (observations.len() + 3).div_ceil(2).min(observations.len());
    misfits[..middle].last().copied().unwrap_or(f64::INFINITY)
}

fn angle_misfit(inverse: &Matrix2<f64>, observation: &Observation) -> f64 {
    wrap_angle(contact_angle(inverse * observation.counts) - observation.angle)
}

/// Size of a force over what it was called, as a logarithm.
fn log_size(inverse: &Matrix2<f64>, observation: &Observation) -> Option<f64> {
    comparable_load(observation.load).map(|load| ((inverse * observation.counts).norm() / load).ln())
}

/// Typical sizes of the known loads and of the loads called the same.
struct LogSizes {
    known: f64,
    same: f64,
}

impl LogSizes {
    fn new(inverse: &Matrix2<f64>, observations: &[Observation]) -> Self {
        let median_of = |kind: fn(Load) -> bool| {
            median(observations.iter().filter(|o| kind(o.load)).filter_map(|o| log_size(inverse, o)))
        };
        let known = median_of(|load| matches!(load, Load::Newtons(_))).unwrap_or(0.0);
        Self { known, same: median_of(|load| load == Load::Same).unwrap_or(0.0) }
    }

    fn misfit(&self, inverse: &Matrix2<f64>, observation: &Observation) -> f64 {
        let typical = if observation.load == Load::Same { self.same } else { self.known };
        log_size(inverse, observation).map_or(0.0, |size| size - typical)
    }
}

/// Scales to the known loads; without any, to forces of mean size 1.
fn with_size(inverse: Matrix2<f64>, observations: &[Observation]) -> Matrix2<f64> {
    let newtons = |o: &Observation| if let Load::Newtons(newtons) = o.load { Some(newtons) } else { None };
    let ratios = observations.iter().filter_map(|o| Some(newtons(o)? / (inverse * o.counts).norm()));
    let sizes = || observations.iter().map(|o| 1.0 / (inverse * o.counts).norm());
    let scale = median(ratios).or_else(|| median(sizes())).filter(|scale| scale.is_finite());
    inverse * scale.unwrap_or(1.0)
}
