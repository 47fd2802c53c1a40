//! Minima of χ² at corner changes.
//!
//! Where the sensor sees more of the part than it should, the residual is that of the larger of two corners' bearings,
//! and χ² has a valley where they are equal: where the edge between them points at the sensor. A place in it is a
//! minimum if it is one along the valley, and the slopes on both sides rise: some mean of the two corners' gradients
//! cancels those of all other readings.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};

use super::Settled;
use super::objective::{Objective, Placed, Residual};
use crate::inscription::readings::{Bearing, Side};
use crate::math::least_squares::NormalEquations;

/// Valleys are sought among edges that point at a sensor to within this many σ where descent stalled, or [`NEAR_MIN`].
const NEAR_SD: f64 = 0.3;

/// And to within this angle, rad, however small σ is.
const NEAR_MIN: f64 = 1e-6;

/// Most edges considered: a pose has three unknowns, so no more than three can be fixed.
const EDGES_MAX: usize = 3;

/// Steps along a valley; each is Newton's.
const STEPS_MAX: usize = 30;

/// Steps are good enough when they are shorter than this share of the part's size.
const STEP_MIN_RELATIVE: f64 = 1e-12;

/// A mean's weight may be outside [0, 1] by this much, for rounding.
const WEIGHT_ROUNDING: f64 = 1e-6;

/// χ² of the corners held and of the outermost corners are equal up to this share of 1 + χ².
const HELD_ROUNDING: f64 = 1e-7;

/// Halvings of a way along a valley until it leads down.
const HALVINGS: usize = 6;

/// A place is lower if χ² is so much less, as a share of 1 + χ²: far above rounding, so that descent ends.
const PROGRESS_MIN: f64 = 1e-6;

/// The mean gradient cancels up to this share of the largest of its terms.
const BALANCE: f64 = 1e-6;

/// An edge that points at a sensor: its ends are both outermost.
#[derive(Clone, Copy, Debug)]
struct Edge {
    bearing: usize,
    corners: [usize; 2],
    gap: f64,
}

/// What there is along the valleys near a place.
#[derive(Debug, Default)]
pub(super) struct Along {
    /// Minima of χ².
    pub minima: Vec<Settled>,
    /// Lower places that are none.
    pub lower: Vec<Placed>,
}

impl Edge {
    /// The same edge with its first or its second corner first.
    fn seen_from(&self, end: usize) -> Self {
        let [a, b] = self.corners;
        Self { corners: if end == 0 { [a, b] } else { [b, a] }, ..*self }
    }
}

/// A covariance that exceeds neither of two in any direction less than it must: in the axes that both share, the larger
/// of each variance.
pub(in crate::inscription) fn covering(a: &Matrix3<f64>, b: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let root = a.cholesky()?.l();
    let inverse = root.try_inverse()?;
    let relative = (inverse * b * inverse.transpose()).symmetric_eigen();
    let larger = relative.eigenvalues.map(|value| value.max(1.0));
    let axes = root * relative.eigenvectors;
    Some(axes * Matrix3::from_diagonal(&larger) * axes.transpose())
}

/// Whether a sensor sees more of the part than it should: then χ² is a valley where the outermost corner changes,
/// otherwise a ridge.
fn sees_too_much(bearing: &Bearing, residual: f64) -> bool {
    if bearing.side == Side::Left { residual < 0.0 } else { residual > 0.0 }
}

impl Objective<'_> {
    /// The minima in valleys near a place, or to which a turn of so many rad at most leads; where there is none, lower
    /// places along the valleys to go on from.
    pub(super) fn along_valleys(&self, from: &Placed, turn: f64) -> Along {
        let (mut minima, mut lower) = (Vec::new(), Vec::new());
        let edges = self.edges_near(from, turn).unwrap_or_default();
        for subset in 1_usize..1 << edges.len() {
            let chosen: Vec<_> = (0..edges.len()).filter(|k| subset >> k & 1 == 1).map(|k| edges[k]).collect();
            let Some(end) = self.end_along(from, &chosen) else { continue };
            match self.minimum_at(&end, &chosen) {
                Some(minimum) => minima.push(minimum),
                None => lower.extend(self.lower_between(from, &end)),
            }
        }
        Along { minima, lower }
    }

    /// The edges nearest to pointing at a sensor that sees too much of the part.
    fn edges_near(&self, placed: &Placed, turn: f64) -> Option<Vec<Edge>> {
        let (n, sigma) = (self.part.corners().len(), self.readings.sigma);
        let mut edges = Vec::new();
        for (index, bearing) in self.readings.bearings.iter().enumerate() {
            self.goes_on_at(index)?;
            let residual = self.residual(index, placed)?;
            if !sees_too_much(bearing, residual.value) {
                continue;
            }
            for other in [(residual.corner + 1) % n, (residual.corner + n - 1) % n] {
                let corners = [residual.corner, other];
                let gap = self.bearing_between(bearing, corners, placed).abs();
                let [a, b] = corners.map(|corner| self.away(bearing, corner, placed));
                // By so much the bearing between an edge's ends changes as it turns.
                let turned = turn * (b - a).norm() / a.norm();
                if gap <= (NEAR_SD * sigma).max(NEAR_MIN).max(turned) {
                    edges.push(Edge { bearing: index, corners, gap });
                }
            }
        }
        edges.sort_by(|a, b| a.gap.total_cmp(&b.gap));
        edges.truncate(EDGES_MAX);
        Some(edges)
    }

    /// Where χ² is least with these edges pointing at their sensors.
    fn end_along(&self, start: &Placed, edges: &[Edge]) -> Option<Placed> {
        let mut placed = *start;
        for _ in 0..STEPS_MAX {
            let step = self.step_along(&placed, edges)?;
            placed = self.stepped(&placed, &step);
            if step.norm() <= STEP_MIN_RELATIVE * self.part.size() {
                break;
            }
        }
        Some(placed)
    }

    /// The end of a valley, if it is a minimum of χ².
    fn minimum_at(&self, placed: &Placed, edges: &[Edge]) -> Option<Settled> {
        let held = self.held(placed, edges)?;
        let free = self.quadratic(placed)?;
        let is_outermost = (free.cost - held.cost).abs() <= HELD_ROUNDING * (1.0 + free.cost);
        let is_valley = |edge: &Edge| {
            let bearing = &self.readings.bearings[edge.bearing];
            sees_too_much(bearing, self.bearing_residual(bearing, edge.corners[0], placed).value)
        };
        let is_minimum = is_outermost && edges.iter().all(is_valley) && self.is_balanced(placed, edges, &held);
        let information = is_minimum.then(|| self.information_of_all(placed, edges)).flatten()?;
        Some(Settled { placed: *placed, chi2: free.cost, information, at_corner_change: true })
    }

    /// A place between two, the second if it can be, that is lower than the first: the valley's end may lie beyond
    /// another corner change.
    fn lower_between(&self, from: &Placed, to: &Placed) -> Option<Placed> {
        let least = self.quadratic(from)?.cost;
        let whole = self.difference(to, from);
        let shares = std::iter::successors(Some(1.0), |share| Some(share / 2.0)).take(HALVINGS);
        let mut places = shares.map(|share| self.stepped(from, &(whole * share)));
        places.find(|placed| {
            self.quadratic(placed).is_some_and(|quadratic| least - quadratic.cost > PROGRESS_MIN * (1.0 + least))
        })
    }

    /// What is known of the pose whichever ends of the edges are the outermost: the inverse of the covariance that
    /// covers those of all. Which end comes first is a matter of rounding, and must not decide.
    fn information_of_all(&self, placed: &Placed, edges: &[Edge]) -> Option<Matrix3<f64>> {
        let ends = 0_usize..1 << edges.len();
        let mut covariances: Vec<Matrix3<f64>> = ends
            .filter_map(|ends| {
                let turned = edges.iter().enumerate().map(|(k, edge)| edge.seen_from(ends >> k & 1));
                self.held(placed, &turned.collect::<Vec<_>>())?.curvature.try_inverse()
            })
            .collect();
        // In an order that no frame and no rounding changes.
        covariances.sort_by(|a, b| a.trace().total_cmp(&b.trace()));
        covariances.into_iter().reduce(|a, b| covering(&a, &b).unwrap_or(b))?.try_inverse()
    }

    /// χ² with the first corner of each edge held.
    fn held(&self, placed: &Placed, edges: &[Edge]) -> Option<NormalEquations<3>> {
        let mut sum = NormalEquations::zero();
        for index in 0..self.count() {
            self.goes_on_at(index)?;
            let Residual { value, row, .. } = match edges.iter().find(|edge| edge.bearing == index) {
                Some(edge) => self.bearing_residual(&self.readings.bearings[index], edge.corners[0], placed),
                None => self.residual(index, placed)?,
            };
            sum.add(value, row);
        }
        Some(sum)
    }

    /// Newton's step for the least χ² on which each edge points at its sensor.
    fn step_along(&self, placed: &Placed, edges: &[Edge]) -> Option<Vector3<f64>> {
        let held = self.held(placed, edges)?;
        let count = 3 + edges.len();
        let (mut matrix, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
        // The constraints in the scale of the residuals.
        matrix.view_mut((0, 0), (3, 3)).copy_from(&held.curvature);
        right.rows_mut(0, 3).copy_from(&-held.gradient);
        for (k, edge) in edges.iter().enumerate() {
            let [a, b] = self.pair(placed, edge);
            let row = b.row - a.row;
            for axis in 0..3 {
                matrix[(3 + k, axis)] = row[axis];
                matrix[(axis, 3 + k)] = row[axis];
            }
            right[3 + k] = a.value - b.value;
        }
        let solution = matrix.lu().solve(&right)?;
        Some(Vector3::new(solution[0], solution[1], solution[2])).filter(|step| step.iter().all(|x| x.is_finite()))
    }

    /// The residuals of an edge's two corners.
    fn pair(&self, placed: &Placed, edge: &Edge) -> [Residual; 2] {
        let bearing = &self.readings.bearings[edge.bearing];
        edge.corners.map(|corner| self.bearing_residual(bearing, corner, placed))
    }

    /// Whether means of the corners' gradients cancel the rest, each with a weight in [0, 1].
    fn is_balanced(&self, placed: &Placed, edges: &[Edge], held: &NormalEquations<3>) -> bool {
        let pairs: Vec<_> = edges.iter().map(|edge| self.pair(placed, edge)).collect();
        let across = DMatrix::from_fn(3, pairs.len(), |axis, k| (pairs[k][1].row - pairs[k][0].row)[axis]);
        let gradient = DVector::from_column_slice((-held.gradient).as_slice());
        let Ok(shares) = across.clone().svd(true, true).solve(&gradient, f64::EPSILON) else { return false };
        let scale = held.gradient.norm().max(f64::MIN_POSITIVE);
        let cancels = (across * &shares - &gradient).norm() <= BALANCE * scale;
        let within = |(share, pair): (&f64, &[Residual; 2])| {
            let weight = share / pair[0].value;
            (-WEIGHT_ROUNDING..=1.0 + WEIGHT_ROUNDING).contains(&weight)
        };
        cancels && shares.iter().zip(&pairs).all(within)
    }
}
