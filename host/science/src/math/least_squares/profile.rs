//! Profile likelihood: how the cost rises, and where its valley runs, where one unknown is held beside its best value
//! and all others are fitted again.
//!
//! The inverse of the curvature takes the cost for a parabola, so the valley for a straight line. Where an unknown is
//! known poorly, neither is so. What is found at places on both sides says how much wider the estimate is
//! ([`Beside::excess`]): in the mean over the errors as the Gauss–Hermite rule of five points has it.
//!
//! Source: D. M. Bates and D. G. Watts, "Nonlinear Regression Analysis and Its Applications", Wiley 1988, chapter 6.
//! Assumes: the place that is begun from is a minimum. Units: any; costs in squared standard deviations. Errors: none; a
//! side that cannot be evaluated is none.

use nalgebra::{DMatrix, DVector, SVector};

use super::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};

/// Nodes of the Gauss–Hermite rule of five points on either side of its middle, in standard deviations, and their
/// weights: exact where estimates bend as the fourth power of the error.
const NODES: [(f64, f64); 2] =
    [(1.355_626_179_974_266, 0.222_075_922_005_612_6), (2.856_970_013_872_806, 0.011_257_411_327_720_69)];

/// A valley is longer than its parabola says by no more than the square root of this: one fit on either side says no
/// more, and where the cost does not rise at all it would be endless.
const LONGER_MAX: f64 = 9.0;

/// A problem with one more unknown held where it is.
#[derive(Clone, Copy, Debug)]
pub struct Held<'a, P> {
    /// All of it.
    pub problem: &'a P,
    /// Which unknown no step may change.
    pub unknown: usize,
}

impl<const N: usize, P: LeastSquaresProblem<N>> LeastSquaresProblem<N> for Held<'_, P> {
    type Place = P::Place;

    fn cost(&self, place: &P::Place) -> f64 {
        self.problem.cost(place)
    }

    fn normal_equations(&self, place: &P::Place) -> NormalEquations<N> {
        self.problem.normal_equations(place)
    }

    fn moved(&self, place: &P::Place, step: &SVector<f64, N>) -> Option<P::Place> {
        self.problem.moved(place, step)
    }

    fn held(&self, place: &P::Place, equations: &NormalEquations<N>) -> [bool; N] {
        let mut held = self.problem.held(place, equations);
        held[self.unknown] = true;
        held
    }

    fn limited(&self, step: SVector<f64, N>) -> SVector<f64, N> {
        self.problem.limited(step)
    }

    fn is_minimum(&self, place: &P::Place, equations: &NormalEquations<N>) -> bool {
        self.problem.is_minimum(place, equations)
    }
}

/// A place on the floor of a valley, beside the minimum.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Beside<Place> {
    /// All unknowns.
    pub place: Place,
    /// How far the held one is from its best value, in its standard deviations; negative on one side.
    pub deviations: f64,
    /// By how much the cost is above that of the minimum.
    pub rise: f64,
    /// Its share in the mean over the errors.
    weight: f64,
}

/// The places to the right or left (`side` 1 or −1) of a minimum, nearest first: where one unknown is held at the rule's
/// nodes, each fitted from the one before; `along` is the step of one standard deviation of the unknown, with all others
/// as they follow on the parabola.
pub fn beside<const N: usize, P: LeastSquaresProblem<N>>(
    problem: &P,
    minimum: &P::Place,
    (unknown, along): (usize, &SVector<f64, N>),
    side: f64,
    settings: &LeastSquaresSettings<N>,
) -> Vec<Beside<P::Place>> {
    let held = Held { problem, unknown };
    let least = problem.cost(minimum);
    let mut found: Vec<Beside<P::Place>> = Vec::with_capacity(NODES.len());
    for (node, weight) in NODES {
        let (from, before) = found.last().map_or((minimum, 0.0), |last| (&last.place, last.deviations));
        let deviations = side * node;
        let Some(begun) = problem.moved(from, &(along * (deviations - before))) else { break };
        let place = minimise(&held, begun, settings, |_| false).place;
        let rise = problem.cost(&place) - least;
        if !rise.is_finite() {
            break;
        }
        found.push(Beside { place, deviations, rise, weight });
    }
    found
}

impl<Place> Beside<Place> {
    /// The same with the place told in another way.
    pub fn map<Other>(self, told: impl FnOnce(Place) -> Other) -> Beside<Other> {
        let Self { place, deviations, rise, weight } = self;
        Beside { place: told(place), deviations, rise, weight }
    }

    /// What this place adds to the mean squares of an estimate that is linear in the unknowns only nearby: `off` is its
    /// change from the minimum to here, `straight` the change if it were linear.
    ///
    /// Where the cost rises less than its parabola says, the valley is longer, too.
    #[must_use]
    pub fn excess(&self, off: &DVector<f64>, straight: &DVector<f64>) -> DMatrix<f64> {
        let square = self.deviations * self.deviations;
        let rise = self.rise.clamp(square / LONGER_MAX, square);
        let aside = off - straight;
        (&aside * aside.transpose() + off * off.transpose() * (square / rise - 1.0)) * self.weight
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector2};
    use proptest::prelude::*;

    use super::*;

    /// Residuals x and (y − b x²) over a tenth: a parabola for a valley.
    struct Bent(f64);

    impl LeastSquaresProblem<2> for Bent {
        type Place = Vector2<f64>;

        fn cost(&self, v: &Vector2<f64>) -> f64 {
            self.normal_equations(v).cost
        }

        fn normal_equations(&self, v: &Vector2<f64>) -> NormalEquations<2> {
            let mut equations = NormalEquations::zero();
            equations.add(v.x, Vector2::new(1.0, 0.0));
            equations.add(10.0 * (v.y - self.0 * v.x * v.x), Vector2::new(-20.0 * self.0 * v.x, 10.0));
            equations
        }

        fn moved(&self, v: &Vector2<f64>, step: &Vector2<f64>) -> Option<Vector2<f64>> {
            Some(v + step)
        }
    }

    proptest! {
        /// Of normal x the mean square of b x² is 3 b².
        #[test]
        fn a_bent_valley_adds_the_mean_square_of_its_bend(b in -2.0..2.0) {
            let settings = LeastSquaresSettings::default();
            let along = Vector2::new(1.0, 0.0);
            let vector = |v: Vector2<f64>| DVector::from_column_slice(v.as_slice());
            let mut mean = DMatrix::zeros(2, 2);
            for side in [-1.0, 1.0] {
                for beside in beside(&Bent(b), &Vector2::zeros(), (0, &along), side, &settings) {
                    prop_assert!((beside.rise - beside.deviations.powi(2)).abs() < 1e-6);
                    mean += beside.excess(&vector(beside.place), &vector(along * beside.deviations));
                }
            }
            let mean = Matrix2::from_column_slice(mean.as_slice());
            prop_assert!((mean - Matrix2::new(0.0, 0.0, 0.0, 3.0 * b * b)).norm() < 1e-6, "{mean}");
        }
    }
}
