//! Where to begin: hypotheses near every local minimum of the cost.
//!
//! Contact angles tell the motion. After the first moments a part moves on its slow manifold ([`super::manifold`]), so that
//! from a place on an edge and the measured angle follow the rate at which the angle should change and the place should move: a
//! place is as bad as the angle that its rates add up to is off. One unknown an edge is left, and no simulation is needed; the
//! measured angle, used in place of the predicted one, keeps errors from growing, so that the minima are broad.
//!
//! Where the data do not tell the angle, or the push is over before the part has settled, a grid of coarse simulations is
//! looked through instead.
//!
//! Frames: world. Units: SI. Errors: none.

use std::f64::consts::TAU;

use nalgebra::Vector2;

use super::clock::count;
use super::data::{Data, Local, local};
use super::fit::{Candidate, Fitting};
use super::launch::{Begin, Unknowns};
use super::manifold::{Settled, settled};
use super::observation::{Known, Touch};
use super::path::Site;
use crate::pushing::{PushModel, Slip, State};

/// Places tried on an edge: one each so many parts of the radius of gyration, and how many at least and at most.
const PLACES_PER_RADIUS: f64 = 8.0;
/// See [`PLACES_PER_RADIUS`].
const PLACES: (f64, f64) = (5.0, 60.0);

/// How far beyond its stretch of the edge the contact may seem to go, in radii of gyration.
const BEYOND: f64 = 0.25;

/// Instants at which the rates are compared.
const NODES: usize = 12;

/// After so many times v/(µg) a part has settled.
const SETTLING: f64 = 4.0;

/// A push has to last for so many times the settling.
const SETTLED_SHARE: f64 = 2.0;

/// Values at the start from which its angle and rate are taken, as a time in units of v/(µg), s at most.
const FIRST_MOMENTS: f64 = 2.0;

/// Distance of the contact angles tried, rad, where the data do not tell it.
const ANGLE_STEP: f64 = 0.035;

/// Velocities along the contact that are tried beside the settled one, in finger speeds.
const ALONG: [f64; 4] = [-0.6, -0.2, 0.2, 0.6];

/// Slip that is tried where a push begins with slip and then rolls, in finger speeds.
const SLIPS: [f64; 2] = [0.1, 0.6];

/// Candidates from a grid of simulations that are worth a descent, for each site and beginning.
const FROM_GRID_MAX: usize = 12;

/// Hypotheses to begin with.
pub(super) fn seeds(fitting: &Fitting, sites: &[Site], begins: &[Begin]) -> Vec<Candidate> {
    let mut found = Vec::new();
    for &begin in begins {
        match angles(fitting.known, &fitting.data, begin) {
            Some(angles) if settles(fitting.known, &fitting.data) => {
                let felt = Felt::new(fitting, &angles);
                sites.iter().for_each(|site| found.extend(felt.seeds(site, begin)));
            }
            angles => {
                let starts = start_angles(fitting, angles.as_deref());
                sites.iter().for_each(|site| found.extend(grid_seeds(fitting, site, begin, &starts)));
            }
        }
    }
    found
}

/// The contact angles, where the data tell them: measured, or the direction of a force at a known angle to the normal.
fn angles(known: &Known, data: &Data, begin: Begin) -> Option<Vec<f64>> {
    if let Some(angle) = &data.angle {
        return Some(angle.values.clone());
    }
    let slip = match begin {
        Begin::Slips(slip) | Begin::Rest(Some(slip)) => slip.sign(),
        _ => 0.0,
    };
    let from_normal = match known.touch {
        Touch::Frictionless => 0.0,
        Touch::Sliding { friction } => (friction * slip).atan(),
        Touch::Rolling { .. } | Touch::Coulomb { .. } => return None,
    };
    let direction = data.direction.as_ref()?;
    let angles = direction.values.iter().map(|value| value - from_normal);
    let turns = data.u0_range.map_or(0.0, |[low, high]| {
        let off = 0.5 * (low + high) - (direction.values[0] - from_normal);
        (off / TAU).round() * TAU
    });
    Some(angles.map(|angle| angle + turns).collect())
}

/// In how long friction forgets the finger's speed, s.
fn forgets(known: &Known, time: f64) -> f64 {
    Vector2::from(known.finger.velocity(time)).norm() / known.grip
}

/// Whether the push lasts long enough for the part to settle.
fn settles(known: &Known, data: &Data) -> bool {
    data.values > 2 && SETTLED_SHARE * SETTLING * forgets(known, 0.0) < data.duration()
}

/// Places on a stretch of an edge, ends included.
fn places(known: &Known, site: &Site) -> Vec<f64> {
    let length = site.high - site.low;
    let wished = (length * PLACES_PER_RADIUS / known.part.inertia_per_mass().sqrt()).ceil();
    let steps = wished.clamp(PLACES.0, PLACES.1);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a few dozen")]
    let steps_whole = steps as usize;
    (0..=steps_whole).map(|i| site.low + length * count(i) / steps).collect()
}

/// What was felt, at some instants.
struct Felt<'a, 'p> {
    fitting: &'a Fitting<'a, 'p>,
    /// Times, s.
    times: Vec<f64>,
    /// Contact angles, rad.
    angles: Vec<f64>,
    /// At t = 0.
    first: Local,
}

impl<'a, 'p> Felt<'a, 'p> {
    fn new(fitting: &'a Fitting<'a, 'p>, angles: &[f64]) -> Self {
        let data = &fitting.data;
        let forgets = forgets(fitting.known, 0.0);
        let from = (SETTLING * forgets).max(fitting.rest_span);
        let spacing = (data.duration() - from) / count(NODES - 1);
        let times: Vec<_> = (0..NODES).map(|i| from + spacing * count(i)).collect();
        let width = (0.5 * spacing).max(data.dt);
        let smooth = times.iter().map(|&time| local(angles, data.dt, time, width).value).collect();
        let first = local(angles, data.dt, 0.0, (FIRST_MOMENTS * forgets).max(data.dt));
        Self { fitting, times, angles: smooth, first }
    }

    /// Near the local minima of one site.
    fn seeds(&self, site: &Site, begin: Begin) -> Vec<Candidate> {
        let model = self.fitting.known.model(site.edge);
        let places = places(self.fitting.known, site);
        let off: Vec<_> = places.iter().map(|&s| self.mismatch(site, &model, begin, s)).collect();
        let minima = minima(&off).into_iter().map(|i| vertex(&places, &off, i));
        minima.flat_map(|s| self.candidates(site, &model, begin, s)).collect()
    }

    /// How far off the angles are that the settled rates add up to, from a place at t = 0, rad².
    fn mismatch(&self, site: &Site, model: &PushModel, begin: Begin, s0: f64) -> f64 {
        let slip = slip_of(begin);
        let beyond = BEYOND * self.fitting.known.part.inertia_per_mass().sqrt();
        let mut near = State { u: self.first.value, s: s0, omega: 0.0, v_t: 0.0 };
        let (mut time, mut turned, mut last): (f64, f64, Option<Settled>) = (0.0, 0.0, None);
        let mut offsets = [0.0; NODES];
        for (i, offset) in offsets.iter_mut().enumerate() {
            let step = self.times[i] - time;
            near.s = self.moved(model, &near, last.as_ref(), s0, (i, step));
            (near.u, time) = (self.angles[i], self.times[i]);
            if near.s < site.low - beyond || near.s > site.high + beyond {
                return f64::INFINITY;
            }
            let Some(now) = settled(model, self.fitting.known.touch, slip, time, &near) else { return f64::INFINITY };
            if now.normal_force < 0.0 {
                return f64::INFINITY;
            }
            if let (Some(last), true) = (last, i > 0) {
                turned += 0.5 * step * (last.state.omega + now.state.omega);
            }
            *offset = near.u - turned;
            near = now.state;
            last = Some(now);
        }
        let mean = offsets.iter().sum::<f64>() / count(NODES);
        offsets.iter().map(|offset| (offset - mean) * (offset - mean)).sum()
    }

    /// The place at a node: exactly by the angle where the contact rolls, otherwise by its rate.
    fn moved(&self, model: &PushModel, near: &State, last: Option<&Settled>, s0: f64, (i, step): (usize, f64)) -> f64 {
        match (self.fitting.known.touch, last) {
            (Touch::Rolling { .. }, _) => s0 - model.finger.radius * (self.angles[i] - self.first.value),
            (_, None) => s0,
            (_, Some(last)) => near.s + step * last.s_rate,
        }
    }

    fn candidates(&self, site: &Site, model: &PushModel, begin: Begin, s0: f64) -> Vec<Candidate> {
        let start = State { u: self.first.value, s: s0, omega: self.first.rate, v_t: 0.0 };
        let near = settled(model, self.fitting.known.touch, slip_of(begin), 0.0, &start).map_or(start, |now| now.state);
        along_contact(self.fitting.known, model, begin, &near)
            .into_iter()
            .map(|v_t| Candidate { site: *site, begin, unknowns: [start.u, s0, near.omega, v_t] })
            .collect()
    }
}

fn slip_of(begin: Begin) -> Option<Slip> {
    match begin {
        Begin::Slips(slip) => Some(slip),
        Begin::Rest(slip) => slip,
        Begin::Free | Begin::NoSlip => None,
    }
}

/// Velocities along the contact to begin with: the settled one, or where a push begins with slip, some slips.
fn along_contact(known: &Known, model: &PushModel, begin: Begin, near: &State) -> Vec<f64> {
    let Begin::Slips(slip) = begin else { return vec![near.v_t] };
    let none = model.rolling_v_t(0.0, near);
    let speed = Vector2::from(known.finger.velocity0).norm();
    let settled = (none - near.v_t) * slip.sign();
    if matches!(known.touch, Touch::Sliding { .. }) && settled > 0.0 {
        return vec![near.v_t];
    }
    SLIPS.iter().map(|share| none - slip.sign() * share * speed).collect()
}

/// Indices of local minima, ends included.
fn minima(values: &[f64]) -> Vec<usize> {
    let at = |i: Option<usize>| i.and_then(|i| values.get(i)).copied().unwrap_or(f64::INFINITY);
    let lowest = |i: &usize| {
        let value = values[*i];
        value.is_finite() && value <= at(i.checked_sub(1)) && value < at(Some(i + 1)).max(value.next_up())
    };
    (0..values.len()).filter(|i| lowest(i) && values[*i] <= at(Some(i + 1))).collect()
}

/// Where the parabola through a minimum and its neighbours is lowest.
fn vertex(places: &[f64], values: &[f64], i: usize) -> f64 {
    if i == 0 || i + 1 >= values.len() || !values[i - 1].is_finite() || !values[i + 1].is_finite() {
        return places[i];
    }
    let (left, right) = (values[i - 1] - values[i], values[i + 1] - values[i]);
    if left + right <= 0.0 {
        return places[i];
    }
    places[i] + 0.5 * (places[i + 1] - places[i]) * (left - right) / (left + right)
}

/// Contact angles to try at t = 0.
fn start_angles(fitting: &Fitting, angles: Option<&[f64]>) -> Vec<Local> {
    let data = &fitting.data;
    if let Some(angles) = angles {
        let width = (FIRST_MOMENTS * forgets(fitting.known, 0.0)).clamp(data.dt, (0.1 * data.duration()).max(data.dt));
        return vec![local(angles, data.dt, 0.0, width)];
    }
    let [low, high] = data.u0_range.unwrap_or_else(|| {
        // The finger pushes ahead of itself.
        let [x, y] = [0, 1].map(|axis| {
            let velocity = fitting.known.finger.velocity0;
            if velocity == [0.0; 2] { fitting.known.finger.acceleration[axis] } else { velocity[axis] }
        });
        let ahead = y.atan2(x);
        [ahead - 0.5 * TAU, ahead + 0.5 * TAU]
    });
    let steps = ((high - low) / ANGLE_STEP).ceil().clamp(1.0, TAU / ANGLE_STEP);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a few hundred")]
    let whole = steps as usize;
    (0..=whole).map(|i| Local { value: low + (high - low) * count(i) / steps, rate: 0.0 }).collect()
}

/// Near the local minima among coarse simulations from a grid of starts.
fn grid_seeds(fitting: &Fitting, site: &Site, begin: Begin, starts: &[Local]) -> Vec<Candidate> {
    let model = fitting.known.model(site.edge);
    let settles = settles(fitting.known, &fitting.data);
    let places = places(fitting.known, site);
    let mut rows: Vec<Vec<(f64, Option<Candidate>)>> = Vec::new();
    for start in starts {
        let tried = places.iter().map(|&s| {
            let unknowns = tries(fitting, &model, begin, (start, s), settles);
            let costs = unknowns.into_iter().filter_map(|unknowns| {
                let candidate = Candidate { site: *site, begin, unknowns };
                Some((fitting.cost(&candidate)?, Some(candidate)))
            });
            costs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, None))
        });
        rows.push(tried.collect());
    }
    let mut found: Vec<_> = grid_minima(&rows);
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.truncate(FROM_GRID_MAX);
    found.into_iter().filter_map(|(_, candidate)| candidate).collect()
}

/// Starts to try at one angle and place.
fn tries(
    fitting: &Fitting,
    model: &PushModel,
    begin: Begin,
    (start, s): (&Local, f64),
    settles: bool,
) -> Vec<Unknowns> {
    let known = fitting.known;
    let near = State { u: start.value, s, omega: start.rate, v_t: 0.0 };
    let settled = settled(model, known.touch, slip_of(begin), 0.0, &near).map(|now| now.state);
    let from = settled.filter(|_| settles).unwrap_or(near);
    let mut along = along_contact(known, model, begin, &from);
    if !settles && matches!(begin, Begin::Free | Begin::Slips(_)) {
        let speed = Vector2::from(known.finger.velocity0).norm();
        along.extend(ALONG.map(|share| share * speed));
        along.extend(settled.map(|state| state.v_t));
    }
    along.into_iter().map(|v_t| [from.u, s, from.omega, v_t]).collect()
}

/// Entries that are no larger than their neighbours in their row and in those beside it.
fn grid_minima(rows: &[Vec<(f64, Option<Candidate>)>]) -> Vec<(f64, Option<Candidate>)> {
    let mut found = Vec::new();
    for (i, row) in rows.iter().enumerate() {
        for (j, entry) in row.iter().enumerate() {
            let beside = rows[i.saturating_sub(1)..(i + 2).min(rows.len())].iter();
            let around = beside.flat_map(|row| &row[j.saturating_sub(1)..(j + 2).min(row.len())]);
            if entry.0.is_finite() && around.into_iter().all(|other| entry.0 <= other.0) {
                found.push(*entry);
            }
        }
    }
    found
}
