//! Rank of the derivatives of outputs by a state, and the changes of state that no output shows.
//!
//! Implements: the observability rank condition of thesis §4.2.1 (Theorem 13), as a number: singular values instead of
//! a yes or no, so that what is nearly lost shows too.
//! Units: none; the caller scales the state. Errors: none.

use nalgebra::{DMatrix, DVector};

/// Singular value, as a share of the largest, below which a change of state counts as unseen.
///
/// Of 200 random pushes, what was seen stayed above 1e-4 at 5 cm/s and above 8e-7 at half a millimetre a second; what
/// was not was at rounding, 1e-16.
pub const RANK_THRESHOLD: f64 = 1e-7;

/// Components of an unseen direction below this are rounding, and written as 0.
const COMPONENT_NONE: f64 = 1e-6;

/// What outputs show of a state.
#[derive(Clone, Debug, PartialEq)]
pub struct Spectrum {
    /// Of the derivatives, as shares of the largest, largest first: as many as the state has components.
    pub singular_values: Vec<f64>,
    /// A basis of the changes of state that no output shows, in the caller's scales; each is of length 1, its largest
    /// component positive.
    pub unseen: Vec<Vec<f64>>,
}

impl Spectrum {
    /// Of the derivatives of outputs: one row each, at least as many as there are states in the columns.
    ///
    /// ```
    /// use nalgebra::DMatrix;
    /// use palpate::math::Spectrum;
    ///
    /// // Two outputs that show the first state and the sum of the others.
    /// let outputs = DMatrix::from_row_slice(3, 3, &[1.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 2.0, 2.0]);
    /// let spectrum = Spectrum::of(outputs);
    /// assert_eq!(spectrum.rank(), 2);
    /// assert!((spectrum.unseen[0][1] + spectrum.unseen[0][2]).abs() < 1e-12);
    /// ```
    #[must_use]
    pub fn of(outputs: DMatrix<f64>) -> Self {
        let states = outputs.ncols();
        let svd = outputs.svd(false, true);
        let mut order: Vec<usize> = (0..states).collect();
        order.sort_by(|&i, &j| svd.singular_values[j].total_cmp(&svd.singular_values[i]));
        let largest = order.first().map_or(0.0, |&i| svd.singular_values[i]);
        let share = |i: usize| if largest > 0.0 { svd.singular_values[i] / largest } else { 0.0 };
        let singular_values: Vec<f64> = order.iter().map(|&i| share(i)).collect();
        let rank = singular_values.iter().filter(|share| **share > RANK_THRESHOLD).count();
        let rows = svd.v_t.unwrap_or_else(|| DMatrix::identity(states, states));
        let unseen = order[rank..].iter().map(|&i| rows.row(i).transpose()).collect();
        Self { singular_values, unseen: legible_basis(unseen) }
    }

    /// How many changes of state show.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.singular_values.len() - self.unseen.len()
    }

    /// Whether every change of state shows.
    #[must_use]
    pub fn observable(&self) -> bool {
        self.unseen.is_empty()
    }
}

/// A basis of the same space with as many zeros as elimination gives: it then names single states where it can.
fn legible_basis(mut basis: Vec<DVector<f64>>) -> Vec<Vec<f64>> {
    let mut used = Vec::new();
    for row in 0..basis.len() {
        // The largest component left is the safest to divide by.
        let left = (0..basis[row].len()).filter(|column| !used.contains(column));
        let Some(pivot) = left.max_by(|&i, &j| basis[row][i].abs().total_cmp(&basis[row][j].abs())) else { break };
        used.push(pivot);
        let cleaned = &basis[row] / basis[row][pivot];
        for (_, vector) in basis.iter_mut().enumerate().filter(|&(other, _)| other != row) {
            let factor = vector[pivot];
            *vector -= &cleaned * factor;
        }
        basis[row] = cleaned;
    }
    basis.into_iter().map(|vector| tidy(&vector)).collect()
}

/// The direction at length 1, rounding taken off, its largest component positive.
fn tidy(direction: &DVector<f64>) -> Vec<f64> {
    let direction = direction.normalize();
    let sign = direction[direction.icamax()].signum();
    direction.iter().map(|&component| if component.abs() < COMPONENT_NONE { 0.0 } else { component * sign }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn single_states_are_named_where_they_can_be() {
        // Rotated by hand: the outputs see only the sum of the first two of four states.
        let outputs = DMatrix::from_fn(5, 4, |row, column| if column < 2 { 1.0 + row as f64 } else { 0.0 });
        let spectrum = Spectrum::of(outputs);
        assert_eq!((spectrum.rank(), spectrum.observable()), (1, false));
        let mut unseen = spectrum.unseen;
        unseen.sort_by(|a, b| a[0].abs().total_cmp(&b[0].abs()));
        let singles: Vec<_> = unseen[..2].iter().map(|v| v.iter().filter(|c| **c != 0.0).count()).collect();
        assert_eq!(singles, [1, 1], "{unseen:?}");
        assert!((unseen[2][0] + unseen[2][1]).abs() < 1e-12, "{unseen:?}");
    }

    #[test]
    fn the_threshold_divides_seen_from_unseen() {
        let of = |least: f64| Spectrum::of(DMatrix::from_diagonal(&DVector::from_vec(vec![2.0, 1.0, 2.0 * least])));
        assert_eq!(of(2e-7).rank(), 3);
        assert_eq!(of(0.5e-7).rank(), 2);
        assert_eq!(of(0.5e-7).unseen, [[0.0, 0.0, 1.0]]);
    }

    #[test]
    fn outputs_that_show_nothing_leave_everything_unseen() {
        let spectrum = Spectrum::of(DMatrix::zeros(4, 3));
        assert_eq!((spectrum.rank(), spectrum.unseen.len()), (0, 3));
        assert_eq!(spectrum.singular_values, [0.0; 3]);
    }
}
