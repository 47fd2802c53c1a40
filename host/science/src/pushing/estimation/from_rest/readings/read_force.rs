//! Readings of a push in standard deviations, and what a guess would have had read.
//!
//! Units: standard deviations; SI where said. Errors: none; without readings after the onset there is nothing to compare.

use nalgebra::{DVector, Rotation2, Vector2};

use super::super::felt::{Felt, Predicted, drift_weights};
use super::super::path::Path;
use super::{ForceReading, KnownOfFinger};
use crate::pushing::finger_motion::Leg;

/// Readings whose mean is the first force, s: a part that begins to turn does so by a millirad meanwhile.
const FIRST_S: f64 = 0.01;

/// What a simulated force may be off by, as a share of it.
pub(super) const MODEL_SHARE: f64 = 2e-4;

/// A reading this near a change of the finger's acceleration is after it, s.
const AFTER_S: f64 = 1e-9;

/// A jump of the force at a moment that is not known is spread over no more than this, s.
pub(super) const JUMP_S: f64 = 5e-3;

/// What readings may be off beside their noise.
#[derive(Clone, Debug)]
pub(super) struct Doubts {
    /// Of each value, N.
    pub(super) added: f64,
    /// Until when, since the start, s, as which share of the force, ascending.
    pub(super) shares: Vec<(f64, f64)>,
    /// After them.
    pub(super) share: f64,
    /// The share of the force by which all that is simulated may be off, and slowly: see [`drift_weights`].
    pub(super) drift: f64,
}

impl Doubts {
    pub(super) const fn none() -> Self {
        Self { added: 0.0, shares: Vec::new(), share: 0.0, drift: 0.0 }
    }

    /// The same with a share of the force more.
    pub(super) fn and_share(mut self, more: f64) -> Self {
        self.shares.iter_mut().for_each(|(_, share)| *share += more);
        Self { share: self.share + more, ..self }
    }

    /// The same with a model that is off by a share of the force, slowly.
    pub(super) fn and_drift(self, drift: f64) -> Self {
        Self { drift, ..self }
    }

    fn share_at(&self, time: f64) -> f64 {
        self.shares.iter().find(|(until, _)| time <= *until).map_or(self.share, |(_, share)| *share)
    }
}

/// Readings since the onset, in standard deviations.
#[derive(Clone, Debug)]
pub(super) struct ReadForce {
    /// Since the onset, s.
    times: Vec<f64>,
    /// Time from one to the next, s.
    period: f64,
    /// Of each, N.
    deviations: Vec<f64>,
    data: DVector<f64>,
    /// As they were read, in the sensor's axes, N, where those turn.
    turning: Option<Vec<Vector2<f64>>>,
    /// What one standard deviation of the effective mass adds, where it has one; then of each thing that the model is off by.
    beside: Vec<DVector<f64>>,
    first: Vector2<f64>,
    /// Squared readings before the onset, in standard deviations, and how many values they are.
    before: (f64, usize),
    /// kg.
    effective_mass: f64,
}

impl ReadForce {
    /// None without readings after the onset.
    pub(super) fn new(known: &KnownOfFinger, legs: &[Leg], readings: &[ForceReading], doubts: &Doubts) -> Option<Self> {
        let acceleration = |time: f64| acceleration(legs, time + AFTER_S);
        // A reading at the onset itself may be of either side.
        let (skip, take) = if known.is_moving { (0.0, -AFTER_S) } else { (-AFTER_S, AFTER_S) };
        let before = &readings[..readings.partition_point(|reading| reading.time < skip)];
        let after = &readings[readings.partition_point(|reading| reading.time <= take)..];
        let [first, .., last] = after else { return None };
        let contact = |reading: &ForceReading| {
            turned(legs, reading.time + AFTER_S, reading.force) + known.effective_mass * acceleration(reading.time)
        };
        let early: Vec<_> =
            after.iter().take_while(|reading| reading.time <= first.time + FIRST_S).map(contact).collect();
        let deviations: Vec<_> = after
            .iter()
            .map(|reading| {
                let share = MODEL_SHARE + doubts.share_at(reading.time);
                known.noise.hypot(doubts.added).hypot(share * contact(reading).norm())
            })
            .collect();
        let stacked = |of: &dyn Fn(&ForceReading) -> Vector2<f64>| {
            let values = after.iter().zip(&deviations).flat_map(|(reading, deviation)| {
                let of = of(reading) / *deviation;
                [of.x, of.y]
            });
            DVector::from_iterator(2 * after.len(), values)
        };
        let mut beside = Vec::new();
        if known.effective_mass_sd > 0.0 {
            beside.push(stacked(&|reading| -known.effective_mass_sd * acceleration(reading.time)));
        }
        if doubts.drift > 0.0 {
            for weight in drift_weights(first.time, last.time) {
                let size = |reading: &ForceReading| doubts.drift * weight(reading.time) * contact(reading).norm();
                beside.push(stacked(&|reading| Vector2::new(size(reading), 0.0)));
                beside.push(stacked(&|reading| Vector2::new(0.0, size(reading))));
            }
        }
        let squares = before.iter().map(|reading| reading.force.norm_squared()).sum::<f64>();
        Some(Self {
            times: after.iter().map(|reading| reading.time + AFTER_S).collect(),
            period: (last.time - first.time) / (after.len() - 1) as f64,
            data: stacked(&contact),
            turning: legs.iter().any(|leg| !leg.turn.is_still()).then(|| after.iter().map(|it| it.force).collect()),
            beside,
            first: early.iter().sum::<Vector2<f64>>() / early.len() as f64,
            before: (squares / known.noise.powi(2), 2 * before.len()),
            deviations,
            effective_mass: known.effective_mass,
        })
    }

    /// Time from one reading to the next, s.
    pub(super) fn period(&self) -> f64 {
        self.period
    }

    /// Squared readings before the onset, in standard deviations, and how many values they are.
    pub(super) fn before(&self) -> (f64, usize) {
        self.before
    }
}

/// That of a motion at a time, right-continuous, m/s².
fn acceleration(legs: &[Leg], time: f64) -> Vector2<f64> {
    let leg = legs.iter().rev().find(|leg| leg.from <= time);
    leg.map_or_else(Vector2::zeros, |leg| leg.finger.acceleration)
}

/// What was read in the sensor's axes at a time, along the world's.
fn turned(legs: &[Leg], time: f64, force: Vector2<f64>) -> Vector2<f64> {
    let leg = legs.iter().rev().find(|leg| leg.from <= time).or(legs.first());
    let angle = leg.map_or(0.0, |leg| leg.turn.angle(time - leg.from));
    if angle == 0.0 { force } else { Rotation2::new(angle) * force }
}

impl Felt for ReadForce {
    fn data(&self) -> &DVector<f64> {
        &self.data
    }

    fn freedom(&self) -> f64 {
        f64::INFINITY
    }

    fn first(&self) -> Vector2<f64> {
        self.first
    }

    fn predicted(&self, path: &Path, _delay: f64) -> Predicted {
        let mut force = path.forces_in_finger_time(self.period.min(JUMP_S));
        let mut shape = DVector::zeros(self.data.len());
        let mut unsure: Vec<(usize, DVector<f64>)> = Vec::new();
        for (row, (&time, deviation)) in self.times.iter().zip(&self.deviations).enumerate() {
            let mean = force.at(time) / *deviation;
            shape.fixed_rows_mut::<2>(2 * row).copy_from(&mean);
            if let Some((jump, sd)) = force.unsure(time) {
                if unsure.last().is_none_or(|(last, _)| *last != jump) {
                    unsure.push((jump, DVector::zeros(self.data.len())));
                }
                let column = unsure.last_mut().map(|(_, column)| column);
                column.into_iter().for_each(|column| column.fixed_rows_mut::<2>(2 * row).copy_from(&(sd / *deviation)));
            }
        }
        let unsure = unsure.into_iter().map(|(_, column)| column).collect();
        Predicted { unsure, beside: self.beside.clone(), ..Predicted::exact(shape) }
    }

    fn beginning(&self, until: f64) -> Option<Box<dyn Felt>> {
        let readings = self.times.partition_point(|time| *time <= until);
        let of = |values: &DVector<f64>| values.rows(0, 2 * readings).into_owned();
        Some(Box::new(Self {
            times: self.times[..readings].to_vec(),
            deviations: self.deviations[..readings].to_vec(),
            data: of(&self.data),
            turning: self.turning.as_ref().map(|forces| forces[..readings].to_vec()),
            beside: self.beside.iter().map(of).collect(),
            ..*self
        }))
    }

    fn carried(&self, legs: &[Leg]) -> Option<DVector<f64>> {
        let values = self.times.iter().zip(&self.deviations).enumerate().flat_map(|(row, (&time, deviation))| {
            let inertia = acceleration(legs, time) * self.effective_mass;
            let read = self.turning.as_ref().map_or_else(Vector2::zeros, |forces| turned(legs, time, forces[row]));
            let of = (inertia + read) / *deviation;
            [of.x, of.y]
        });
        (self.effective_mass > 0.0 || self.turning.is_some()).then(|| DVector::from_iterator(self.data.len(), values))
    }

    fn onset_sd(&self) -> Option<f64> {
        None
    }

    fn onsets_tried(&self) -> Vec<f64> {
        vec![0.0]
    }
}
