//! What was felt, in standard deviations, and what a guess would have had felt instead.
//!
//! A guess predicts the force per unit mass of the part. Beside the mass a few numbers are unsure of which the force is a
//! linear function, nearly: they are found in closed form for every guess.
//!
//! Units: standard deviations; masses in kg. Errors: none.

use std::fmt::Debug;

use nalgebra::{DMatrix, DVector, Vector2};

use super::path::Path;
use crate::math::random::Draw;
use crate::pushing::finger_motion::Leg;

/// Force that was felt over a push.
pub(super) trait Felt: Debug + Sync {
    /// Two values an instant, or a window: in standard deviations, whitened.
    fn data(&self) -> &DVector<f64>;

    /// Independent values that the size of the covariance is known from; infinite where it is known.
    fn freedom(&self) -> f64;

    /// The first force that the contact exerts on the finger, N.
    fn first(&self) -> Vector2<f64>;

    /// The same as the data for a guess played through, for an onset so much later than it was taken for, s.
    fn predicted(&self, path: &Path, delay: f64) -> Predicted;

    /// Standard deviation of the onset where it is to be found with the rest, s.
    fn onset_sd(&self) -> Option<f64>;

    /// The same of the time up to a moment alone, s, where it can be had.
    fn beginning(&self, _until: f64) -> Option<Box<dyn Felt>> {
        None
    }

    /// What the finger's own mass has had read of a motion, in the data's standard deviations; none where it has none, or
    /// the data do not know of it.
    fn carried(&self, _legs: &[Leg]) -> Option<DVector<f64>> {
        None
    }

    /// Onsets to try before a fit, s later than what it was taken for; the first is that.
    fn onsets_tried(&self) -> Vec<f64>;
}

/// What a model is off by changes from one to another within so long, s: as the part turns, other places of its support
/// carry most of the friction.
const DRIFT_S: f64 = 0.1;

/// Functions of time, from one moment to another, of which any that changes slowly is a sum: linear from knot to knot.
pub(super) fn drift_weights(from: f64, to: f64) -> impl Iterator<Item = impl Fn(f64) -> f64> {
    let apart = ((to - from) / DRIFT_S).ceil().max(1.0);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "the knots of a push are few")]
    let last = apart as usize;
    let weight =
        move |knot: usize| move |time: f64| (1.0 - ((time - from) / (to - from) * apart - knot as f64).abs()).max(0.0);
    (0..=last).map(weight)
}

/// What a guess would have felt, whitened, per unit mass of the part.
#[derive(Clone, Debug)]
pub(super) struct Predicted {
    pub(super) shape: DVector<f64>,
    /// For each jump of the force that a reading fell into, a standard deviation of what may have been felt of it.
    pub(super) unsure: Vec<DVector<f64>>,
    /// For each number of outline and motion, a standard deviation of what is felt by it.
    pub(super) numbers: Vec<OfNumber>,
    /// For each number that adds to what is felt whatever the part's mass, a standard deviation of what it adds.
    pub(super) beside: Vec<DVector<f64>>,
}

/// What is felt of one standard deviation of a number.
#[derive(Clone, Debug)]
pub(super) struct OfNumber {
    /// Per unit mass of the part.
    pub(super) per_mass: DVector<f64>,
    /// Of the finger's own mass, where the number is one of its motion.
    pub(super) carried: Option<DVector<f64>>,
    pub(super) off: NumberOff,
}

/// How many standard deviations a number is off what it is taken for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct NumberOff {
    /// In what is predicted.
    pub(super) predicted: f64,
    /// In the data, from which what the finger carries is taken.
    pub(super) felt: f64,
}

impl OfNumber {
    /// The same of a number that is held so many times as much where it is as by its prior: z² + λ (z − z₀)² is, but for what is
    /// constant, the square of y = (1 + λ)^½ (z − λ z₀ / (1 + λ)), which is found instead; see [`undamped`].
    pub(super) fn damped(&self, damping: f64) -> Self {
        let wider = (1.0 + damping).sqrt();
        let NumberOff { predicted, felt } = self.off;
        let damped = |z: f64| (z - damping * predicted / (1.0 + damping)) * wider;
        Self {
            per_mass: &self.per_mass / wider,
            carried: self.carried.as_ref().map(|carried| carried / wider),
            off: NumberOff { predicted: damped(predicted), felt: damped(felt) },
        }
    }

    fn at(&self, mass: f64) -> DVector<f64> {
        let per_mass = &self.per_mass * mass;
        self.carried.as_ref().map_or_else(|| per_mass.clone(), |carried| &per_mass + carried)
    }
}

/// The number z of one that was found damped, of where it was.
pub(super) fn undamped(found: f64, was: f64, damping: f64) -> f64 {
    damping * was / (1.0 + damping) + found / (1.0 + damping).sqrt()
}

/// A prediction of some mass against what was felt.
#[derive(Clone, Debug)]
pub(super) struct Compared {
    /// Best mass, kg.
    pub(super) mass: f64,
    /// What is felt and not explained, standard deviations.
    pub(super) rest: DVector<f64>,
    /// Squared, with what it takes of the jumps.
    pub(super) cost: f64,
}

impl Predicted {
    /// With nothing unsure about it.
    pub(super) const fn exact(shape: DVector<f64>) -> Self {
        Self { shape, unsure: Vec::new(), numbers: Vec::new(), beside: Vec::new() }
    }

    /// The same in deviations of noise so many times as large.
    pub(super) fn with_noise(self, times: f64) -> Self {
        let less = |columns: Vec<DVector<f64>>| columns.into_iter().map(|column| column / times).collect();
        Self { shape: self.shape / times, unsure: less(self.unsure), beside: less(self.beside), ..self }
    }

    /// What is unsure about it, for a mass, in standard deviations: jumps, then those of [`Self::nuisances`] that change
    /// anything.
    fn unsure_at(&self, mass: f64) -> Option<DMatrix<f64>> {
        let columns = self.unsure.iter().map(|sd| sd * mass).chain(self.nuisances(mass));
        let columns: Vec<_> = columns.filter(|column| column.iter().any(|value| *value != 0.0)).collect();
        (!columns.is_empty()).then(|| DMatrix::from_columns(&columns))
    }

    /// For each number of outline and motion, then for each that adds whatever the part's mass, a standard deviation of what it
    /// does.
    pub(super) fn nuisances(&self, mass: f64) -> impl Iterator<Item = DVector<f64>> + '_ {
        self.numbers.iter().map(move |number| number.at(mass)).chain(self.beside.iter().cloned())
    }

    /// How what is felt of a push may differ from one time to another: noise, and what is unsure whatever the numbers are, drawn
    /// by their standard deviations.
    pub(super) fn redrawn(&self, mass: f64, values: usize, draw: &mut Draw) -> DVector<f64> {
        let noise = DVector::from_fn(values, |_, _| draw.normal());
        let unsure = self.unsure.iter().map(|sd| sd * mass).chain(self.beside.iter().cloned());
        unsure.fold(noise, |sum, sd| sum + sd * draw.normal())
    }

    /// The mass, where it is not known the best, and the best of all that is unsure, each of which costs its square in
    /// standard deviations.
    pub(super) fn compared(&self, data: &DVector<f64>, known_mass: Option<f64>) -> Compared {
        let plain = known_mass.unwrap_or_else(|| self.shape.dot(data) / self.shape.norm_squared());
        // What a number is off already costs as if it were found: δ = z − z₀, and z is sought. What the finger carries
        // counts from what the data take it for.
        let shifted = self.numbers.iter().fold(data.clone(), |data, number| {
            let data = data + &number.per_mass * (plain * number.off.predicted);
            match &number.carried {
                Some(carried) => data + carried * number.off.felt,
                None => data,
            }
        });
        let data = &shifted;
        // One standard deviation of each, for a mass near the best.
        let Some(unsure) = self.unsure_at(plain) else {
            let rest = data - &self.shape * plain;
            return Compared { mass: plain, cost: rest.norm_squared(), rest };
        };
        let normal = unsure.tr_mul(&unsure) + DMatrix::identity(unsure.ncols(), unsure.ncols());
        // Positive definite, being a square and one.
        let taken = |of: &DVector<f64>| normal.clone().cholesky().map(|normal| normal.solve(&unsure.tr_mul(of)));
        let less = |of: &DVector<f64>| taken(of).map_or_else(|| of.clone(), |taken| of - &unsure * taken);
        let mass = known_mass.unwrap_or_else(|| self.shape.dot(&less(data)) / self.shape.dot(&less(&self.shape)));
        let off = data - &self.shape * mass;
        let taken = taken(&off).unwrap_or_else(|| DVector::zeros(unsure.ncols()));
        let rest = off - &unsure * &taken;
        Compared { mass, cost: rest.norm_squared() + taken.norm_squared(), rest }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// z² + λ (z − z₀)² + |data − shape − column (z − z₀)|² is least where its derivative is zero.
        #[test]
        fn a_damped_number_is_held_by_so_much(case in 0..100_000_usize, was in -3.0..3.0, damping in 0.0..1e4) {
            let mut draw = Draw::case(41, case);
            let mut vector = || DVector::from_fn(8, |_, _| draw.normal());
            let (data, shape, column) = (vector(), vector(), vector());
            let off = NumberOff { predicted: was, felt: was };
            let number = OfNumber { per_mass: column.clone(), carried: None, off }.damped(damping);
            let predicted = Predicted { numbers: vec![number], ..Predicted::exact(shape.clone()) };
            let rest = predicted.compared(&data, Some(1.0)).rest;
            let found = undamped(predicted.numbers[0].per_mass.dot(&rest), was, damping);
            let own = column.norm_squared();
            let least = (column.dot(&(data - shape)) + (own + damping) * was) / (1.0 + damping + own);
            prop_assert!((found - least).abs() < 1e-9 * (1.0 + least.abs()), "{found}, not {least}");
        }
    }
}
