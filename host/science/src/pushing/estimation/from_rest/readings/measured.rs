//! A finger whose places were measured, by a clock of its own.
//!
//! The force says when the push began; the places say how the finger then moved, and when by their own clock. What they
//! leave open is told by numbers that are found with the rest: the clock's offset and the modes of the motion of which most
//! is felt. Of a finger that has hardly moved yet nobody knows which way it goes: until then a force is believed as far as
//! that way is known.
//!
//! Where the finger turns, the sensor's axes turn with it, at the times that go with the offset, and so do its readings.
//!
//! Implements: the offset's posterior from the evidence of the places for each onset; modes by
//! [`FittedPath::modes`]; all as [`super::super::numbers`].
//! Frames: world axes. Units: SI; readings in time of the force's clock, places in that of the path's; path time + offset =
//! force time. Errors: none; a path too short to tell a motion explains nothing.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex};

use super::super::numbers::MotionNumbers;
use super::super::path::Guess;
use super::super::{SAME_PLACE, misfit_limit};
use super::read_force::Doubts;
use super::{
    Concluded, FeltPush, ForceHypothesis, ForceReading, KnownOfFinger, Looked, Minimum, conclude, distinct_edges,
    legs_since, near_best,
};
use crate::pushing::finger_motion::Leg;
use crate::pushing::measured_path::{FittedPath, MeasuredPath, PathEffects, PathModes, TOLD_RAD, Wandering};
use crate::pushing::measured_turn::MeasuredTurn;
use crate::search::{Halt, Searched, Stop};

/// A finger whose places were measured, by a clock of its own.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredFinger<'a> {
    /// Of the clamp, in time of the path's clock.
    pub path: &'a MeasuredPath,
    /// How it turns about the disk's centre, by the same clock, and the sensor with it; none where it does not.
    pub turn: Option<&'a MeasuredTurn>,
    /// Standard deviation of what that clock lags behind the force's, s; 0 where it is the same.
    pub clock_offset_sd: f64,
}

/// What readings say of a push of a finger whose places were measured.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MeasuredEstimate {
    /// When the push began, by the force's clock, s; none of a part that moves already, and where none was felt.
    pub onset: Option<f64>,
    /// What explains the readings, the likeliest first, each with what the path's clock then is early, s.
    pub hypotheses: Vec<(f64, ForceHypothesis)>,
}

/// Offsets at which everything is sought, in standard deviations of what the places leave open of it.
const OFFSETS_TRIED: [f64; 3] = [0.0, -1.3, 1.3];

/// Known to this an offset is not sought, s: the motion changes by nothing that is felt.
const OFFSET_SURE_S: f64 = 1e-4;

/// Minima of each offset that are looked at.
const OFFSET_LEADS: usize = 32;

/// The best minima of all offsets, which are followed with all numbers: a place from several offsets too, as a fit may not get from
/// one to another.
const BEST_LEADS: usize = 10;

/// The same with those of every edge in turn. Without them, of 60 pushes 3 had the truth not among those found.
const LEADS: usize = 20;

/// What costs so many times the best there is, or what chance would have it cost, leads nowhere.
const HOPELESS: f64 = 8.0;

/// Most modes of a measured motion that are found.
const MODES: usize = 14;

/// Offsets that are compared on each side of the best, and the standard deviations to which they reach.
const COMPARED: (i32, f64) = (8, 3.0);

/// A force of so many standard deviations is one.
const LOUD: f64 = 6.0;

/// The same as [`super::estimate_until`] for a finger whose places were measured; readings are in time of their own
/// clock, and the motion in `known` is left aside.
#[must_use]
pub fn estimate_measured_until(
    known: &KnownOfFinger,
    finger: &MeasuredFinger,
    readings: &[ForceReading],
    stop: Stop<'_>,
) -> Searched<MeasuredEstimate> {
    let halt = Halt::new(stop);
    let onset = if known.is_moving { None } else { force_onset(readings, known.noise) };
    let found = match Measured::new(known, finger, readings, onset) {
        Some(measured) if onset.is_some() || known.is_moving => measured.estimate(&halt),
        _ => Vec::new(),
    };
    halt.searched(MeasuredEstimate { onset, hypotheses: found })
}

/// When the force begins: between the last quiet reading and the first of two that are not; none where it never does.
fn force_onset(readings: &[ForceReading], noise: f64) -> Option<f64> {
    let is_loud = |reading: &ForceReading| reading.force.norm() > LOUD * noise;
    let first = readings.windows(2).position(|two| two.iter().all(is_loud))?;
    let before = readings[..first].last().map_or(readings[first].time, |quiet| quiet.time);
    Some(0.5 * (before + readings[first].time))
}

/// What is known of a push before anything is sought.
struct Measured<'a> {
    known: &'a KnownOfFinger<'a>,
    path: &'a MeasuredPath,
    turn: Option<&'a MeasuredTurn>,
    readings: &'a [ForceReading],
    /// When the force begins; none of a part that moves.
    onset: Option<f64>,
    wandering: Wandering,
    offset: Offset,
    modes: PathModes,
    /// What the places cost whatever is found, the offset's prior included.
    misfit: f64,
}

/// What the places say of their clock's offset, s.
#[derive(Clone, Copy)]
struct Offset {
    best: f64,
    sd: f64,
}

/// Where a search comes to that takes the offset for one.
#[derive(Clone, Copy)]
struct OffsetLead {
    /// The offset, standard deviations off its best.
    sds: f64,
    /// With what motion and offset may change taken for noise, and the offset's own.
    cost: f64,
    guess: Guess,
    /// How many of its edge are followed before.
    place: usize,
}

impl OffsetLead {
    /// Whether it begins where another does.
    fn is_where(&self, other: &Self) -> bool {
        let (one, other) = (&self.guess, &other.guess);
        one.edge == other.edge && SAME_PLACE.holds([one.u, one.s], [other.u, other.s])
    }
}

impl<'a> Measured<'a> {
    fn new(
        known: &'a KnownOfFinger<'a>,
        finger: &MeasuredFinger<'a>,
        readings: &'a [ForceReading],
        onset: Option<f64>,
    ) -> Option<Self> {
        let (path, prior_sd) = (finger.path, finger.clock_offset_sd);
        let begins = |offset: f64| path_onset(path, onset, offset);
        let mut offset = Offset { best: 0.0, sd: prior_sd };
        let mut wandering = path.wandering(begins(0.0)?)?;
        if onset.is_some() && prior_sd > OFFSET_SURE_S {
            // The way it wanders, and when it begins, depend on each other.
            for _ in 0..2 {
                offset = told_offset(path, onset, &wandering, prior_sd)?;
                wandering = path.wandering(begins(offset.best)?)?;
            }
            offset.sd = offset.sd.hypot(period(readings) / 12.0_f64.sqrt()).min(prior_sd);
        }
        let fitted = path.fitted(begins(offset.best)?, &wandering)?;
        let count = readings.len() as f64;
        let heavy = known.mass.unwrap_or_else(|| mass_felt(known, readings)) + known.effective_mass;
        let until = readings.last()?.time - offset.best - begins(offset.best)?;
        let effects = PathEffects {
            rate: count / (readings.last()?.time - readings.first()?.time),
            noise: known.noise / heavy,
            mu_g: known.mu_g,
            until,
        };
        let prior = if prior_sd > 0.0 { (offset.best / prior_sd).powi(2) } else { 0.0 };
        let (modes, misfit) = (fitted.modes(&effects, MODES), fitted.misfit + prior);
        Some(Self { known, path, turn: finger.turn, readings, onset, wandering, offset, modes, misfit })
    }

    fn estimate(&self, halt: &Halt<'_>) -> Vec<(f64, ForceHypothesis)> {
        let (edges, symmetry) = distinct_edges(self.known.part);
        let minimum =
            |lead: OffsetLead| Some((lead.sds, self.at(lead.sds, |push| push.minimum(lead.guess, false, halt))??));
        let leads = self.leads(&edges, halt);
        let minima = halt.each(leads, minimum).into_iter().flatten().collect();
        // Only what may be listed is looked at further.
        let minima = near_best(minima, |(_, minimum): &(f64, Minimum)| minimum.place());
        let concluded = |(sds, minimum): (f64, Minimum)| {
            let mut found = self.at(sds, |push| {
                Some((push.offset_of(minimum.found.taken()), push.concluded(&minimum.found, &Looked::ALONE, halt)?))
            })??;
            self.count_path(&mut found.1);
            Some(found)
        };
        let found = halt.every(minima, concluded).into_iter().flatten();
        let (offsets, found): (Vec<_>, Vec<_>) = found.unzip();
        let costs: Vec<_> = found.iter().map(|found| found.found.cost).collect();
        let listed = conclude(found, self.known, symmetry);
        let of = |listed: &ForceHypothesis| {
            let same = costs.iter().position(|cost| cost.to_bits() == listed.cost.to_bits());
            same.map_or(0.0, |place| offsets[place])
        };
        listed.into_iter().map(|listed| (of(&listed), listed)).collect()
    }

    /// What is followed: what explains best, of any offset, and then of every edge in turn, each place once.
    fn leads(&self, edges: &[usize], halt: &Halt<'_>) -> Vec<OffsetLead> {
        let mut begun = self.begun(edges, halt);
        begun.sort_by(|a, b| a.cost.total_cmp(&b.cost));
        let least = begun.first().map_or(0.0, |begun| begun.cost);
        begun.retain(|begun| begun.cost <= HOPELESS * least.max(2.0 * self.readings.len() as f64));
        let mut others = begun.split_off(BEST_LEADS.min(begun.len()));
        others.sort_by(|a, b| a.place.cmp(&b.place).then(a.cost.total_cmp(&b.cost)));
        for next in others {
            if begun.len() < LEADS && !begun.iter().any(|lead| lead.is_where(&next)) {
                begun.push(next);
            }
        }
        begun
    }

    /// Where searches come to, each of which takes the offset for one.
    fn begun(&self, edges: &[usize], halt: &Halt<'_>) -> Vec<OffsetLead> {
        let at = |sds: f64| {
            let leads = self.at(sds, |push| push.leads(edges, OFFSET_LEADS, halt).followed).unwrap_or_default();
            let place = |index: usize, of: &Guess| leads[..index].iter().filter(|(_, it)| it.edge == of.edge).count();
            let lead = |(index, &(cost, guess)): (usize, &(f64, Guess))| OffsetLead {
                sds,
                cost: cost + sds * sds,
                guess,
                place: place(index, &guess),
            };
            leads.iter().enumerate().map(lead).collect::<Vec<_>>()
        };
        let tried = if self.offset.sd > OFFSET_SURE_S { &OFFSETS_TRIED[..] } else { &OFFSETS_TRIED[..1] };
        halt.each(tried.to_vec(), |sds| Some(at(sds))).into_iter().flatten().flatten().collect()
    }

    /// Something of the push, the offset being taken for so many standard deviations off its best; none where the places
    /// tell no motion.
    fn at<T>(&self, sds: f64, of: impl FnOnce(&FeltPush) -> T) -> Option<T> {
        let offset = self.offset.best + sds * self.offset.sd;
        let begins = path_onset(self.path, self.onset, offset)?;
        let fitted = self.path.fitted(begins, &self.wandering)?;
        let motion = fitted.motion([])?;
        let known = KnownOfFinger { motion: &motion, ..*self.known };
        let moved = |reading: &ForceReading| ForceReading { time: reading.time - offset - begins, ..*reading };
        let readings: Vec<_> = self.readings.iter().map(moved).collect();
        let numbers = PathNumbers { measured: self, fitted, sds, last: Mutex::default() };
        FeltPush::new(&known, &readings, Some(numbers)).map(|push| of(&push))
    }

    /// Counts the places among the data of a minimum.
    fn count_path(&self, found: &mut Concluded) {
        let of_path = to_count(self.wandering.degrees_of_freedom);
        let freedom = found.found.degrees_of_freedom;
        found.cost += self.misfit;
        found.found.cost += self.misfit;
        found.found.degrees_of_freedom += of_path;
        found.cost_max += misfit_limit(freedom + of_path, f64::INFINITY) - misfit_limit(freedom, f64::INFINITY);
    }
}

/// When the finger begins to move, by the path's clock: of a part that moves already since who knows when.
fn path_onset(path: &MeasuredPath, onset: Option<f64>, offset: f64) -> Option<f64> {
    Some(onset.map_or(*path.times.first()?, |onset| onset - offset))
}

/// The offset's mean and standard deviation by the places and its prior: sums over offsets, then over nearer ones.
fn told_offset(path: &MeasuredPath, onset: Option<f64>, wandering: &Wandering, prior_sd: f64) -> Option<Offset> {
    let mut told = Offset { best: 0.0, sd: prior_sd };
    for _ in 0..2 {
        let (count, reach) = COMPARED;
        let step = reach * told.sd / f64::from(count);
        let offsets: Vec<_> = (-count..=count).map(|place| told.best + f64::from(place) * step).collect();
        let surprise = |offset: f64| {
            let fitted = path.fitted(path_onset(path, onset, offset)?, wandering)?;
            Some(fitted.surprise + (offset / prior_sd).powi(2))
        };
        let surprises: Vec<_> = offsets.iter().map(|offset| surprise(*offset).unwrap_or(f64::INFINITY)).collect();
        let least = surprises.iter().copied().min_by(f64::total_cmp).filter(|least| least.is_finite())?;
        let weights: Vec<_> = surprises.iter().map(|surprise| (-0.5 * (surprise - least)).exp()).collect();
        let total: f64 = weights.iter().sum();
        let mean = |of: &dyn Fn(f64) -> f64| {
            weights.iter().zip(&offsets).map(|(weight, offset)| weight * of(*offset)).sum::<f64>() / total
        };
        let best = mean(&|offset| offset);
        // Between two offsets nothing was looked at.
        let sd = mean(&|offset| (offset - best).powi(2)).sqrt().hypot(0.5 * step);
        told = Offset { best, sd };
    }
    Some(told)
}

/// Mean time between readings, s.
fn period(readings: &[ForceReading]) -> f64 {
    match readings {
        [first, .., last] => (last.time - first.time) / (readings.len() - 1) as f64,
        _ => 0.0,
    }
}

/// About the part's mass, from how the plane's friction is felt, kg.
fn mass_felt(known: &KnownOfFinger, readings: &[ForceReading]) -> f64 {
    let felt = readings.iter().map(|reading| reading.force.norm()).fold(0.0, f64::max);
    felt / known.mu_g.max(f64::MIN_POSITIVE)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of values")]
fn to_count(values: f64) -> usize {
    values.max(0.0).round() as usize
}

/// What is not known of a measured motion, as numbers in standard deviations: modes, then the offset, if that is one.
pub(super) struct PathNumbers<'a> {
    measured: &'a Measured<'a>,
    fitted: FittedPath,
    /// What the offset is taken for in `fitted`.
    sds: f64,
    /// Motions of the offsets asked for last: modes are looked at one after the other, of several minima at the same time.
    last: Mutex<VecDeque<(u64, Arc<FittedPath>)>>,
}

/// Offsets of which the motion is kept.
const OFFSETS_KEPT: usize = 16;

impl MotionNumbers for PathNumbers<'_> {
    fn taken_for(&self) -> Vec<f64> {
        let modes = std::iter::repeat_n(0.0, self.measured.modes.modes.len());
        modes.chain(self.seeks_offset().then_some(self.sds)).collect()
    }

    /// In time since the push began, or since the first reading of a part that moves.
    fn legs(&self, off: &[f64]) -> Option<Vec<Leg>> {
        let Measured { known, path, turn, readings, onset, wandering, modes, .. } = self.measured;
        let offset = self.offset(off);
        let begins = path_onset(path, *onset, offset)?;
        let changes = off.iter().copied().zip(modes.modes.iter().map(Vec::as_slice));
        let is_new = onset.is_some() && offset.to_bits() != self.offset(&self.taken_for()).to_bits();
        let motion = if is_new {
            self.fitted_at(offset, || path.fitted(begins, wandering))?.motion(changes)?
        } else {
            self.fitted.motion(changes)?
        };
        let from = if known.is_moving { readings.first()?.time - offset - begins } else { 0.0 };
        let turned = |leg: Leg| match turn {
            Some(turn) => Leg { turn: turn.over(begins + leg.from, begins + leg.to), ..leg },
            None => leg,
        };
        Some(legs_since(motion.legs(known.radius).map(turned), from))
    }
}

impl PathNumbers<'_> {
    /// The motion of an offset, fitted where it was not asked for lately.
    fn fitted_at(&self, offset: f64, fit: impl FnOnce() -> Option<FittedPath>) -> Option<Arc<FittedPath>> {
        let is_it = |(of, _): &&(u64, Arc<FittedPath>)| *of == offset.to_bits();
        if let Some((_, fitted)) = self.last.lock().ok()?.iter().find(is_it) {
            return Some(Arc::clone(fitted));
        }
        let fitted = Arc::new(fit()?);
        let mut last = self.last.lock().ok()?;
        last.push_front((offset.to_bits(), Arc::clone(&fitted)));
        last.truncate(OFFSETS_KEPT);
        Some(fitted)
    }

    fn seeks_offset(&self) -> bool {
        self.measured.offset.sd > OFFSET_SURE_S
    }

    /// The offset that goes with numbers, s.
    fn offset(&self, off: &[f64]) -> f64 {
        let Offset { best, sd } = self.measured.offset;
        let sds = if self.seeks_offset() { off.last().copied().unwrap_or(self.sds) } else { self.sds };
        best + sds * sd
    }

    /// What the motion leaves open of each reading: for a search that finds none of the numbers. A start so long after the
    /// motion's, s.
    pub(super) fn doubts_of_all(&self, from: f64) -> Doubts {
        let Measured { known, readings, wandering, .. } = self.measured;
        let heavy = known.mass.unwrap_or_else(|| mass_felt(known, readings)) + known.effective_mass;
        let shares = self.shares(from);
        let share = shares.last().map_or(0.0, |(_, share)| *share);
        Doubts { added: heavy * wandering.acceleration_sd, shares, share, drift: 0.0 }
    }

    /// What is left of that once the numbers are found.
    pub(super) fn doubts_of_rest(&self, from: f64) -> Doubts {
        let Measured { known, readings, modes, .. } = self.measured;
        let values = 2.0 * readings.len() as f64;
        let shares = self.shares(from).into_iter().take_while(|(_, share)| *share > TOLD_RAD).collect();
        Doubts { added: known.noise * (modes.rest / values).sqrt(), shares, share: 0.0, drift: 0.0 }
    }

    /// How uncertain the finger's way is, rad, until when.
    fn shares(&self, from: f64) -> Vec<(f64, f64)> {
        let mut before = 1.0;
        let share = |(until, way): (f64, f64)| (until - from, std::mem::replace(&mut before, way));
        self.fitted.ways().into_iter().map(share).collect()
    }
}

impl FeltPush<'_, '_> {
    /// The offset that goes with numbers of outline and motion, s.
    fn offset_of(&self, off: &[f64]) -> f64 {
        let after_part =
            |path: &PathNumbers<'_>| path.offset(&off[self.unknown().of_part()..][..path.taken_for().len()]);
        self.path.as_ref().map_or(0.0, after_part)
    }
}
