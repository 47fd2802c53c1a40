//! What the search has found: whether a critical point of one choice of pieces is a minimum of χ², and which are one.

use nalgebra::{Cholesky, DMatrix, DVector, Matrix3, Vector3};

use super::OVERLAP_MAX_M;
use super::chain::{Piece, Place};
use super::objective::{Hold, Objective, Support, Vector3Scale, is_positive, outermost};
use super::terms::{At, Felt, Share, Span};
use crate::inscription::noise::{PoseMode, covering};
use crate::math::least_squares::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};

/// Minima within this many standard deviations of each other are one.
pub(super) const SAME_SD: f64 = 1e-2;

/// Steps of Newton's method; at a minimum that is flat to second order each gains a third only.
const STEPS_MAX: usize = 200;

/// A step of so many standard deviations is none.
const STEP_MIN_SD: f64 = 1e-11;

/// A choice of pieces holds where its cost is χ² but for this share of 1 + χ²: rounding errors.
const HOLDS: f64 = 1e-8;

/// A piece that costs only so much more, as a share of 1 + its cost, might be the nearer one beside the pose.
const TIE: f64 = 1e-6;

/// Poses beside a minimum where pieces tie: in standard deviations, no farther than minima that count as one; none may be
/// lower than by `PROBE_DEPTH` of 1 + χ².
const PROBES_SD: [f64; 3] = [0.01, 0.001, 0.0001];
const PROBE_DEPTH: f64 = 1e-9;

/// Directions of full rank: the least eigenvalue of their sum of squares is above this. At a minimum that is flat to
/// second order, the root of what rounding leaves of a turn.
const RANK_MIN: f64 = 1e-12;

/// No span at all.
const POINT: [Span; 2] = [Span { reach: 0.0, turn: 0.0 }; 2];

/// A local minimum of χ².
#[derive(Clone, Copy, Debug)]
pub(super) struct Minimum {
    pub at: At,
    pub chi2: f64,
    /// JᵀJ in the coordinates of the search.
    pub information: Matrix3<f64>,
    /// Two corners of the hull are outermost at once.
    pub is_bent: bool,
}

/// All that was found.
#[derive(Debug, Default)]
pub(super) struct Found {
    pub minima: Vec<Minimum>,
    /// The best one where the part can slide or turn, with its χ².
    pub loose: Option<(At, f64)>,
}

impl Found {
    fn knows(&self, at: &At) -> bool {
        let near = |minimum: &Minimum| {
            let apart = at.minus(&minimum.at);
            (apart.transpose() * minimum.information * apart)[0] < SAME_SD * SAME_SD
        };
        self.minima.iter().any(near)
    }

    /// The minima of another objective beside these.
    pub(super) fn settled(&self, objective: &Objective<'_>, gate: f64) -> Self {
        let mut found = Self::default();
        let places = self.minima.iter().map(|minimum| minimum.at).chain(self.loose.map(|(at, _)| at));
        // None where it is told to halt.
        let _ = places.map(|at| objective.settle(&at, gate, &mut found)).collect::<Option<Vec<_>>>();
        found
    }

    /// Best first.
    pub(super) fn modes(&self, objective: &Objective<'_>) -> Vec<PoseMode> {
        let mut minima = self.minima.clone();
        minima.sort_by(|a, b| a.chi2.total_cmp(&b.chi2));
        let mode = |minimum: &Minimum| {
            let covariance = minimum.at.pose_covariance(&inverse(&minimum.information)?);
            let pose = minimum.at.pose(objective.anchor);
            Some(PoseMode { pose, chi2: minimum.chi2, covariance, at_corner_change: minimum.is_bent })
        };
        minima.iter().filter_map(mode).collect()
    }
}

/// Of a positive matrix whose unknowns have different units.
fn inverse(matrix: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    let scale = Vector3Scale::of(matrix)?;
    let inverse = scale.scaled(matrix).cholesky()?.inverse();
    Some(scale.scaled(&inverse))
}

impl Objective<'_> {
    /// Where Newton's method for one choice ends; none where it does not, or where it should halt.
    pub(super) fn refined(&self, hold: &Hold, start: &At) -> Option<At> {
        let mut at = *start;
        for _ in 0..STEPS_MAX {
            let sum = self.sum(hold, &at)?;
            let step = self.newton(&sum)?;
            at = at.stepped(&step);
            if (step.transpose() * sum.gauss * step)[0] < STEP_MIN_SD * STEP_MIN_SD {
                return Some(at);
            }
        }
        Some(at)
    }

    /// Newton's step; where the curvature is not positive Gauss's, and along what it leaves open none.
    fn newton(&self, sum: &Share) -> Option<Vector3<f64>> {
        let floor = sum.gauss[(0, 0)].max(sum.gauss[(1, 1)]);
        let size = self.chain.size;
        let least = Vector3::new(floor, floor, floor * size * size) * OPEN;
        let scale = Vector3Scale(sum.gauss.diagonal().zip_map(&least, f64::max).map(f64::sqrt));
        let gradient = sum.gradient.component_div(&scale.0);
        let full = scale.scaled(&(sum.gauss + sum.bend));
        let step = match Cholesky::new(full).filter(|root| root.l_dirty().diagonal().min() > OPEN.sqrt()) {
            Some(root) => -root.solve(&gradient),
            None => {
                let axes = full.symmetric_eigen();
                let mut step = Vector3::zeros();
                for (value, axis) in axes.eigenvalues.iter().zip(axes.eigenvectors.column_iter()) {
                    if value.abs() > OPEN {
                        step -= axis * (axis.dot(&gradient) / value);
                    }
                }
                step
            }
        };
        Some(step.component_div(&scale.0)).filter(|step| step.iter().all(|value| value.is_finite()))
    }

    /// Adds the minimum here, if it is one inside the gate. Whether the choice holds here.
    pub(super) fn accept(&self, at: &At, hold: &Hold, gate: f64, found: &mut Found) -> Option<bool> {
        let chi2 = self.chi2(at)?;
        let sum = self.sum(hold, at)?;
        if (sum.cost - chi2).abs() > HOLDS * (1.0 + chi2) {
            return Some(false);
        }
        if chi2 > gate || found.knows(at) || self.clearance(at) < -OVERLAP_MAX_M {
            return Some(true);
        }
        let whole = sum.gauss + sum.bend;
        if sum.directions.symmetric_eigenvalues().min() < RANK_MIN {
            if found.loose.is_none_or(|(_, least)| chi2 < least) {
                found.loose = Some((*at, chi2));
            }
            return Some(true);
        }
        if is_positive(&whole) && (!self.is_tied(at, hold)? || self.is_lowest_around(at, chi2, &sum.gauss)?) {
            found.minima.push(Minimum { at: *at, chi2, information: sum.gauss, is_bent: false });
        }
        Some(true)
    }

    /// Whether a touch might be held by another piece, or a line by another corner, close by.
    fn is_tied(&self, at: &At, hold: &Hold) -> Option<bool> {
        for (index, (felt, piece)) in self.touches.iter().zip(&hold.touches).enumerate() {
            self.goes_on_at(index)?;
            let cost = felt.share(&self.chain, *piece, at, &POINT).cost;
            if self.least_but(felt, *piece, at) - cost < TIE * (1.0 + cost) {
                return Some(true);
            }
        }
        let mut misses = Vec::new();
        for (line, support) in self.lines.iter().zip(&hold.lines) {
            line.misses(&self.hull, at, &mut misses);
            let (Support::Corner(corner) | Support::Flush(corner)) = *support;
            let miss = misses[corner];
            if misses
                .iter()
                .enumerate()
                .any(|(k, other)| k != corner && (other - miss).abs() < TIE * (1.0 + miss.abs()))
            {
                return Some(true);
            }
        }
        Some(false)
    }

    /// The least cost of a touch on any piece but this one.
    fn least_but(&self, felt: &Felt, held: Piece, at: &At) -> f64 {
        let point = felt.on_part(at);
        let weight = felt.weight * felt.weight;
        let mut least = f64::INFINITY;
        let mut offer = |piece: Piece, cost: f64| {
            if piece != held {
                least = least.min(cost);
            }
        };
        for (index, edge) in self.chain.edges.iter().enumerate() {
            let normal = felt.normal.map(|_| index);
            let miss = felt.normal_miss(edge.angle, at.theta).powi(2);
            let (along, off) = edge.along_and_off(point);
            if (0.0..=edge.length).contains(&along) {
                offer(Piece { place: Place::Edge(index), normal }, off * off * weight + miss);
            }
            let next = if index + 1 == self.chain.edges.len() { 0 } else { index + 1 };
            for corner in [index, next] {
                let apart = (point - self.chain.corners[corner].at).norm_squared() * weight;
                offer(Piece { place: Place::Corner(corner), normal }, apart + miss);
            }
            let corner = &self.chain.corners[index];
            if let Some((angle, _)) = felt.normal
                && corner.is_convex()
                && corner.beyond(angle - at.theta) <= 0.0
            {
                let apart = (point - corner.at).norm_squared() * weight;
                offer(Piece { place: Place::Corner(index), normal: None }, apart);
            }
        }
        least
    }

    /// Whether no pose beside has a lower χ²; `information` says how far beside.
    fn is_lowest_around(&self, at: &At, chi2: f64, information: &Matrix3<f64>) -> Option<bool> {
        let Some(scale) = Vector3Scale::of(information) else { return Some(false) };
        let Some(root) = scale.scaled(information).cholesky() else { return Some(false) };
        let Some(axes) = root.l().transpose().try_inverse() else { return Some(false) };
        for sd in PROBES_SD {
            for code in 0..27_i32 {
                let digit = |power: i32| f64::from(code / power % 3 - 1);
                let step = (axes * Vector3::new(digit(1), digit(3), digit(9))).component_div(&scale.0) * sd;
                if self.chi2(&at.stepped(&step))? < chi2 - PROBE_DEPTH * (1.0 + chi2) {
                    return Some(false);
                }
            }
        }
        Some(true)
    }

    /// Goes down from a pose in χ² itself, and adds the minimum where it ends.
    pub(super) fn settle(&self, start: &At, gate: f64, found: &mut Found) -> Option<()> {
        let settings = LeastSquaresSettings { steps_max: STEPS_MAX, ..LeastSquaresSettings::default() };
        let end = minimise(self, *start, &settings, |_| self.halt().is_wished()).place;
        let (_, hold) = self.held(&end)?;
        let refined = self.refined(&hold, &end)?;
        let apart = refined.minus(&end);
        let is_near = (apart.transpose() * self.sum(&hold, &end)?.gauss * apart)[0] < 1.0;
        if !(is_near && self.accept(&refined, &hold, gate, found)?) {
            self.settle_flush(&end, &hold, gate, found)?;
        }
        Some(())
    }

    /// Where a descent has stalled because two corners of the hull are outermost for some lines: the minimum along that.
    fn settle_flush(&self, end: &At, hold: &Hold, gate: f64, found: &mut Found) -> Option<()> {
        let mut misses = Vec::new();
        let mut flush = Vec::new();
        for (index, line) in self.lines.iter().enumerate() {
            line.misses(&self.hull, end, &mut misses);
            let corner = outermost(&misses, line.sense());
            for side in [corner, (corner + self.hull.len() - 1) % self.hull.len()] {
                if (misses[side] - misses[self.next(side)]).abs() < STALLED_SD {
                    flush.push((index, side));
                }
            }
        }
        for subset in 1_usize..1 << flush.len().min(FLUSH_MAX) {
            let mut chosen = hold.clone();
            for (k, (line, side)) in flush.iter().enumerate().filter(|(k, _)| subset >> k & 1 == 1) {
                let _ = k;
                chosen.lines[*line] = Support::Flush(*side);
            }
            self.accept_flush(&chosen, end, gate, found)?;
        }
        Some(())
    }

    /// Adds the minimum with some sides flush on their lines to which Newton's method leads, if it is one.
    pub(super) fn accept_flush(&self, hold: &Hold, start: &At, gate: f64, found: &mut Found) -> Option<()> {
        let mut at = *start;
        let mut multipliers = DVector::zeros(0);
        for _ in 0..STEPS_MAX {
            let Some((step, lambda)) = self.step_flush(hold, &at)? else { return Some(()) };
            at = at.stepped(&step);
            multipliers = lambda;
            if (step.transpose() * self.sum(hold, &at)?.gauss * step)[0] < STEP_MIN_SD * STEP_MIN_SD {
                break;
            }
        }
        let chi2 = self.chi2(&at)?;
        let sum = self.sum(hold, &at)?;
        if (sum.cost - chi2).abs() > HOLDS * (1.0 + chi2) || chi2 > gate || found.knows(&at) {
            return Some(());
        }
        let flush = flush_of(hold);
        // Weights of the first corner: the line's pull is shared between the two.
        let shared = flush.iter().zip(multipliers.iter()).all(|((line, side), multiplier)| {
            let value = self.line_row(*line, *side, &at, &POINT).0.value;
            let share = 1.0 + multiplier / value;
            value == 0.0 || (-SHARE_ROUNDING..=1.0 + SHARE_ROUNDING).contains(&share)
        });
        if !shared || self.clearance(&at) < -OVERLAP_MAX_M {
            return Some(());
        }
        let Some(information) = self.information_of_all(hold, &flush, &at)? else { return Some(()) };
        if self.is_lowest_around(&at, chi2, &information)? {
            found.minima.push(Minimum { at, chi2, information, is_bent: true });
        }
        Some(())
    }

    /// Newton's step for the least χ² on which sides are flush, with the multipliers of that.
    fn step_flush(&self, hold: &Hold, at: &At) -> Option<Option<(Vector3<f64>, DVector<f64>)>> {
        let sum = self.sum(hold, at)?;
        let flush = flush_of(hold);
        let count = 3 + flush.len();
        let mut curvature = sum.gauss + sum.bend;
        let (mut matrix, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
        for (k, (line, side)) in flush.iter().enumerate() {
            let (first, _) = self.line_row(*line, *side, at, &POINT);
            let (second, _) = self.line_row(*line, self.next(*side), at, &POINT);
            let slope = first.slope - second.slope;
            // Half the pull is the second corner's, about.
            curvature -= (first.bend - second.bend) * (first.value / 2.0);
            for axis in 0..3 {
                matrix[(3 + k, axis)] = slope[axis];
                matrix[(axis, 3 + k)] = slope[axis];
            }
            right[3 + k] = second.value - first.value;
        }
        matrix.view_mut((0, 0), (3, 3)).copy_from(&curvature);
        right.rows_mut(0, 3).copy_from(&-sum.gradient);
        // Alike in size, whatever the units.
        let scale = DVector::from_iterator(count, (0..count).map(|k| matrix.column(k).amax().max(f64::MIN_POSITIVE)));
        for k in 0..count {
            for i in 0..count {
                matrix[(i, k)] /= scale[k];
            }
        }
        let Some(solution) = matrix.full_piv_lu().solve(&right) else { return Some(None) };
        let solution = solution.component_div(&scale);
        let step = Vector3::new(solution[0], solution[1], solution[2]);
        if !solution.iter().all(|value| value.is_finite()) {
            return Some(None);
        }
        Some(Some((step, solution.rows(3, flush.len()).into_owned())))
    }

    /// What is known of the pose whichever ends of the flush sides touch.
    fn information_of_all(&self, hold: &Hold, flush: &[(usize, usize)], at: &At) -> Option<Option<Matrix3<f64>>> {
        let mut covariances = Vec::new();
        for ends in 0_usize..1 << flush.len() {
            let mut chosen = hold.clone();
            for (k, (line, side)) in flush.iter().enumerate() {
                chosen.lines[*line] = Support::Corner(if ends >> k & 1 == 1 { self.next(*side) } else { *side });
            }
            covariances.extend(inverse(&self.sum(&chosen, at)?.gauss));
        }
        // In an order that no frame and no rounding changes.
        covariances.sort_by(|a, b| a.trace().total_cmp(&b.trace()));
        let all = covariances.into_iter().reduce(|a, b| covering(&a, &b).unwrap_or(b));
        Some(all.and_then(|all| inverse(&all)))
    }
}

/// The lines on which sides are flush, with the first corners of these.
pub(super) fn flush_of(hold: &Hold) -> Vec<(usize, usize)> {
    let flush = |(line, support): (usize, &Support)| match support {
        Support::Flush(side) => Some((line, *side)),
        Support::Corner(_) => None,
    };
    hold.lines.iter().enumerate().filter_map(flush).collect()
}

/// Curvatures below this share of the others are none: of a direction in which the part is free rounding leaves a
/// hundredth of it, and a step that trusted that would be any.
const OPEN: f64 = 1e-14;

/// A descent has stalled between two corners if their misses differ by less, in standard deviations.
const STALLED_SD: f64 = 1e-2;

/// Sides that may be flush at once beside what a descent has come to.
const FLUSH_MAX: usize = 4;

/// How far a share may be outside [0, 1] by rounding.
const SHARE_ROUNDING: f64 = 1e-6;

impl LeastSquaresProblem<3> for Objective<'_> {
    type Place = At;

    fn cost(&self, at: &At) -> f64 {
        self.chi2(at).unwrap_or(f64::INFINITY)
    }

    fn normal_equations(&self, at: &At) -> NormalEquations<3> {
        let held = self.held(at).and_then(|(_, hold)| self.sum(&hold, at));
        held.map_or_else(NormalEquations::zero, |sum| NormalEquations {
            cost: sum.cost,
            gradient: sum.gradient,
            curvature: sum.gauss,
        })
    }

    fn moved(&self, at: &At, step: &Vector3<f64>) -> Option<At> {
        Some(at.stepped(step))
    }
}
