//! Where to begin: hypotheses near every local minimum of the cost.
//!
//! Where the data tell the contact angles, every edge is covered with cells ([`super::cover`]), at places so near to
//! each other that none can lie between them, and descents begin where one may come near the least cost. The first part
//! of the data excludes most of them for a fraction of the time: the whole costs no less. In each the
//! rates begin at those of the slow manifold ([`super::manifold`]), to which a part settles after the first moments, and
//! at what the first angles say beyond them.
//!
//! Where the data do not tell the angle, a grid of coarse simulations is looked through instead; so it is, more widely,
//! where nothing that was found explains the data. A valley may run between two of its angles: the best places at each
//! angle are looked at in cells too, which follow the angle and the rates to where they explain most.
//!
//! Frames: world. Units: SI. Errors: none.

use std::f64::consts::TAU;

use super::clock::count;
use super::cover::Cell;
use super::data::{Data, Local, local};
use super::fit::{Candidate, Fitting, STEP_MAX, relaxation_time};
use super::initial_state::{StartMode, Unknowns};
use super::manifold::settled;
use super::path::ContactInterval;
use crate::pushing::dynamics::{PushModel, Slip, State};
use crate::pushing::estimation::observation::{Known, Touch};

/// Places tried on an edge: one each so many parts of the radius of gyration, and how many at least and at most.
const PLACES_PER_RADIUS: f64 = 8.0;
/// Fewest and most places tried on an edge.
const PLACES: (f64, f64) = (5.0, 60.0);

/// After so many times v/(µg) a part has settled.
const SETTLING: f64 = 4.0;

/// A push has to last for so many times the settling: with a few values in what is left, the rates tell too little.
const SETTLED_SHARE: f64 = 3.0;

/// Values at the start from which its angle and rate are taken, as a time in units of v/(µg), s at most.
const FIRST_MOMENTS: f64 = 2.0;

/// The same at most, as a share of the push.
const FIRST_SHARE: f64 = 0.1;

/// A cell that may come within this of the least cost of all is worth a descent: a dozen times the gate of what is
/// listed, because its parabola may be off by as much. Of 3,000 pushes with Coulomb's friction a quarter of it loses one.
const NEAR_LEAST: f64 = 200.0;

/// A cell below its neighbours is worth a descent unless it is so many times farther from the least cost.
const HOPELESS: f64 = 30.0;

/// First parts of the data that are looked at before all of them: these shares, of at least so many values, and as many
/// relaxation times.
const EARLY_SHARES: [f64; 2] = [0.2, 0.4];
/// See [`EARLY_SHARES`].
const EARLY_VALUES: f64 = 8.0;
/// See [`EARLY_SHARES`].
const EARLY_RELAXATIONS: f64 = 6.0;
/// It is not worth it where it would be a larger share than this of the values, or of the steps of a simulation.
const EARLY_SHARE_MAX: f64 = 0.5;

/// From so many of the places that explain the first part best descents say what all the data may come to, in so many
/// steps.
const EARLY_DESCENTS: usize = 3;
/// See [`EARLY_DESCENTS`].
const EARLY_STEPS: usize = 8;
/// They end when the next step is predicted to bring less: a tenth of [`NEAR_LEAST`], to which it is compared.
const EARLY_ENOUGH: f64 = 0.1 * NEAR_LEAST;

/// A velocity along the contact so many standard deviations of its prior from none is not the only one tried.
const UNLIKELY_SIGMAS: f64 = 2.0;

/// Cells lead to one minimum where their lowest places differ by less than this share of the longest steps in every
/// unknown: half a millimetre, ten milliradians.
const SAME_SHARE: f64 = 0.03;

/// Distance of the contact angles tried, rad, where the data do not tell it.
const ANGLE_STEP: f64 = 0.035;

/// Rates at t = 0 that are tried in a wide search, from the settled one (0) to the mean of the first moments (1) and
/// beyond.
const OMEGA_SHARES: [f64; 4] = [0.0, 1.0, 2.0, 3.5];

/// Rates at t = 0 that are tried in a wide search where the angles are not known, in standard deviations of the prior.
const OMEGA_SIGMAS: [f64; 7] = [-2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0];

/// Those where there is no prior, rad/s.
const OMEGA_USUAL: f64 = 1.0;

/// Velocities along the contact that are tried beside the settled one, in finger speeds.
const ALONG: [f64; 4] = [-0.6, -0.2, 0.2, 0.6];

/// A slip that is tried in any case, and the least distance of others, in finger speeds.
const SLIP_SMALL: f64 = 0.1;

/// By how much more than its mean over the first moments the rate at t = 0 differs from the settled one, which it
/// decays to: x/(1 − e⁻ˣ) for x of [`FIRST_MOMENTS`].
const FIRST_EXCESS: f64 = 2.3;

/// Candidates from a grid of simulations that are worth a descent, for each interval and beginning: entries lower than
/// all around them.
const FROM_GRID_MAX: usize = 12;

/// Further ones that cells at the best places of each angle lead to. Of 5,720 pushes felt by forces the grid's own lose
/// six, a dozen of these three, two dozen none of those.
const FROM_CELLS_MAX: usize = 40;

/// How widely to look for beginnings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Width {
    /// Cells on every edge where the angles are told; otherwise on the slow manifold, where there is one.
    Narrow,
    /// Among simulations from many starts: for what those do not lead to.
    Wide,
}

/// Hypotheses to begin with.
pub(super) fn seeds(
    fitting: &Fitting,
    contact_intervals: &[ContactInterval],
    start_modes: &[StartMode],
    width: Width,
) -> Vec<Candidate> {
    let mut found = Vec::new();
    let mut branches = Vec::new();
    for &start_mode in start_modes {
        match angles(fitting.known, &fitting.data, start_mode) {
            Some(angles) if width == Width::Narrow => {
                let cover = Cover { fitting, start_mode, first: first_angle(fitting, &angles) };
                contact_intervals.iter().for_each(|interval| branches.extend(cover.branches(interval)));
            }
            angles => {
                let grid = StartGrid { fitting, starts: start_angles(fitting, angles.as_deref()), width };
                contact_intervals.iter().for_each(|interval| found.extend(grid.seeds(interval, start_mode)));
            }
        }
    }
    look_early(fitting, &mut branches);
    let held = fitting.holding_the_place();
    let cells = |branch: Vec<Place>| {
        branch.into_iter().map(|place| Cell::around(fitting, &held, place.guess, place.reach)).collect()
    };
    found.extend(worth_a_descent(&branches.into_iter().map(cells).collect::<Vec<_>>()));
    found
}

/// Fittings of first parts of the data that are much cheaper than all, each longer than the last.
fn first_parts<'a, 'p>(fitting: &Fitting<'a, 'p>) -> impl Iterator<Item = Fitting<'a, 'p>> {
    let data = &fitting.data;
    let settled = EARLY_RELAXATIONS * relaxation_time(fitting.known, data, 0.0) / data.dt;
    let shares = EARLY_SHARES.map(|share| (count(data.values) * share).max(settled).max(EARLY_VALUES).ceil());
    let most = EARLY_SHARE_MAX * count(data.values);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "whole, ≥ 0, and below the count")]
    let parts =
        shares.into_iter().filter(move |values| *values <= most).map(|values| fitting.of_first(values as usize));
    let steps = |fitting: &Fitting| count(fitting.clock.knots.len());
    parts.filter(move |early| steps(early) <= EARLY_SHARE_MAX * steps(fitting))
}

/// Leaves of each branch the places that first parts of the data do not exclude: all of the data cost no less. What is
/// left begins with what the first part says.
fn look_early(fitting: &Fitting, branches: &mut [Vec<Place>]) {
    let mut most = None;
    for early in first_parts(fitting) {
        let held = early.holding_the_place();
        let cells: Vec<Vec<Option<Cell>>> = branches
            .iter()
            .map(|branch| branch.iter().map(|place| Cell::around(&early, &held, place.guess, place.reach)).collect())
            .collect();
        let most = *most.get_or_insert_with(|| soon_reached(fitting, cells.iter().flatten().flatten()) + NEAR_LEAST);
        for (branch, cells) in branches.iter_mut().zip(cells) {
            let is_worth = are_worth(&cells, most);
            let places = branch.drain(..).zip(cells).zip(is_worth);
            let kept = places.filter(|(_, is_worth)| *is_worth);
            *branch = kept.filter_map(|((place, cell), _)| Some(Place { guess: cell?.at, ..place })).collect();
        }
    }
}

/// Which cells of a branch are worth a closer look: those that may come to no more than `most`, and those below their
/// neighbours unless they are hopeless.
fn are_worth(cells: &[Option<Cell>], most: f64) -> Vec<bool> {
    let of = |value: fn(&Cell) -> f64| -> Vec<f64> {
        cells.iter().map(|cell| cell.as_ref().map_or(f64::INFINITY, value)).collect()
    };
    let least = of(Cell::least);
    let mut is_worth: Vec<_> = least.iter().map(|least| *least <= most).collect();
    let lowest = minima(&of(|cell| cell.total)).into_iter().filter(|lowest| least[*lowest] <= HOPELESS * most);
    lowest.for_each(|lowest| is_worth[lowest] = true);
    is_worth
}

/// What descents from the cells that explain most come to soon.
fn soon_reached<'c>(fitting: &Fitting, cells: impl Iterator<Item = &'c Cell>) -> f64 {
    let mut most_likely: Vec<_> = cells.collect();
    most_likely.sort_by(|a, b| a.least().total_cmp(&b.least()));
    let reached = most_likely.iter().take(EARLY_DESCENTS).filter_map(|cell| descended(fitting, cell.candidate()));
    reached.fold(f64::INFINITY, f64::min)
}

/// What a descent from a candidate comes to soon.
fn descended(fitting: &Fitting, candidate: Candidate) -> Option<f64> {
    let mut descent = fitting.descend(candidate)?;
    fitting.improve_until(&mut descent, EARLY_ENOUGH, EARLY_STEPS);
    Some(descent.evaluation.total())
}

/// How a push may have begun where the contact angles are known: at which places of an edge, and how.
struct Cover<'a, 'p> {
    fitting: &'a Fitting<'a, 'p>,
    start_mode: StartMode,
    /// Contact angle and its rate at t = 0.
    first: Local,
}

/// A place of an edge to look at.
struct Place {
    /// What the other unknowns may be there.
    guess: Candidate,
    /// How far its cell reaches on either side, m.
    reach: [f64; 2],
}

impl<'a, 'p> Cover<'a, 'p> {
    /// The places along an interval, in order, for each way of beginning there.
    fn branches(&self, interval: &ContactInterval) -> Vec<Vec<Place>> {
        let known = self.fitting.known;
        let model = known.model(interval.edge);
        let places = places(known, interval);
        let spacing = places[1] - places[0];
        let mut branches: Vec<Vec<Place>> = Vec::new();
        for s in places.into_iter().take_while(|_| self.fitting.goes_on().is_some()) {
            let reach = reach(interval, s, spacing);
            for (branch, guess) in self.guesses(interval, &model, s).into_iter().enumerate() {
                if branches.len() <= branch {
                    branches.push(Vec::new());
                }
                branches[branch].push(Place { guess, reach });
            }
        }
        branches
    }

    /// How a push may have begun at a place.
    fn guesses(&self, interval: &ContactInterval, model: &PushModel, s: f64) -> Vec<Candidate> {
        let (known, start_mode) = (self.fitting.known, self.start_mode);
        let start = State { u: self.first.value, s, omega: self.first.rate, v_t: 0.0 };
        let near = settled(model, known.touch, slip_of(known, start_mode), 0.0, &start).map_or(start, |now| now.state);
        let omega = near.omega + FIRST_EXCESS * (self.first.rate - near.omega);
        let near = State { omega, ..near };
        let mut along = along_contact(known, model, start_mode, &near);
        // A push may begin far from the settled motion along the contact: where a prior says so, it is believed too.
        let is_unlikely = |sigma: f64| near.v_t.abs() > UNLIKELY_SIGMAS * sigma;
        if start_mode == StartMode::Free && self.fitting.prior.v_t0_sigma.is_some_and(is_unlikely) {
            along.push(0.0);
        }
        let unknowns = along.into_iter().map(|along| [start.u, s, omega, along, 0.0]);
        unknowns.map(|unknowns| Candidate { interval: *interval, start_mode, unknowns, past: None }).collect()
    }
}

/// What to begin descents with: cells that may come near the least cost, and of each branch those that are lower than
/// their neighbours.
fn worth_a_descent(branches: &[Vec<Option<Cell>>]) -> Vec<Candidate> {
    let totals = branches.iter().flatten().flatten().map(|cell| cell.total);
    let most = totals.fold(f64::INFINITY, f64::min) + NEAR_LEAST;
    let mut found = Vec::new();
    for branch in branches {
        let worth = branch.iter().zip(are_worth(branch, most)).filter(|(_, is_worth)| *is_worth);
        let mut last: Option<Candidate> = None;
        for candidate in worth.filter_map(|(cell, _)| Some(cell.as_ref()?.candidate())) {
            if last.is_none_or(|last| !lead_to_one(&last, &candidate)) {
                found.push(candidate);
            }
            last = Some(candidate);
        }
    }
    found
}

/// Whether descents that begin at these lead to one minimum.
fn lead_to_one(a: &Candidate, b: &Candidate) -> bool {
    let longest = STEP_MAX.iter().map(|step| SAME_SHARE * step);
    a.unknowns.iter().zip(b.unknowns).zip(longest).all(|((a, b), near)| (a - b).abs() <= near)
}

/// The contact angles, where the data tell them: measured, or the direction of a force at a known angle to the normal.
pub(super) fn angles(known: &Known, data: &Data, start_mode: StartMode) -> Option<Vec<f64>> {
    if let Some(angle) = &data.angle {
        return Some(angle.values.clone());
    }
    let slip = match start_mode {
        StartMode::Slips(slip) | StartMode::Rest(Some(slip)) => slip.sign(),
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

/// How long a moving part takes to settle, s; none where the push is over before.
pub(super) fn settling(known: &Known, data: &Data) -> Option<f64> {
    let time = SETTLING * relaxation_time(known, data, 0.0);
    (!known.starts_at_rest() && data.values > 2 && SETTLED_SHARE * time < data.duration()).then_some(time)
}

/// Whether the push lasts long enough for the part to settle.
fn settles(known: &Known, data: &Data) -> bool {
    settling(known, data).is_some() || known.starts_at_rest() && known.mu_g > 0.0
}

/// Places on a stretch of an edge, ends included.
fn places(known: &Known, interval: &ContactInterval) -> Vec<f64> {
    let length = interval.high - interval.low;
    let wished = (length * PLACES_PER_RADIUS / known.part.inertia_per_mass().sqrt()).ceil();
    let steps = wished.clamp(PLACES.0, PLACES.1);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a few dozen")]
    let steps_whole = steps as usize;
    (0..=steps_whole).map(|i| interval.low + length * count(i) / steps).collect()
}

/// How far a cell at a place among others of this spacing reaches on either side, m.
fn reach(interval: &ContactInterval, s: f64, spacing: f64) -> [f64; 2] {
    [s - interval.low, interval.high - s].map(|room| room.clamp(0.0, spacing))
}

/// Where the contact slides throughout: in which direction.
fn slip_of(known: &Known, start_mode: StartMode) -> Option<Slip> {
    match (known.touch, start_mode) {
        (Touch::Sliding { .. }, StartMode::Slips(slip)) => Some(slip),
        (Touch::Sliding { .. }, StartMode::Rest(slip)) => slip,
        _ => None,
    }
}

/// What to begin with along the contact: the settled velocity; where a push begins with slip, the settled slip or some
/// others.
fn along_contact(known: &Known, model: &PushModel, start_mode: StartMode, near: &State) -> Vec<f64> {
    let StartMode::Slips(slip) = start_mode else { return vec![near.v_t] };
    let speed = known.finger.velocity0.norm();
    let rolling = model.rolling_v_t(0.0, near);
    // The settled slip of a contact that slides on, and that of a part at rest, which the finger drags along.
    let slips = [rolling - near.v_t, rolling].map(|v_t| v_t * slip.sign());
    let mut tried = vec![SLIP_SMALL * speed];
    for slip in slips {
        if tried.iter().all(|other| (slip - other) > SLIP_SMALL * speed) {
            tried.push(slip);
        }
    }
    tried
}

/// Indices of local minima, ends included; of equal neighbours the first.
fn minima(values: &[f64]) -> Vec<usize> {
    let before = |i: usize| if i == 0 { f64::INFINITY } else { values[i - 1] };
    let after = |i: usize| values.get(i + 1).copied().unwrap_or(f64::INFINITY);
    let lowest = |i: &usize| values[*i].is_finite() && values[*i] < before(*i) && values[*i] <= after(*i);
    (0..values.len()).filter(lowest).collect()
}

/// Contact angle and its rate at t = 0 of a part that may not settle during the push.
fn first_angle(fitting: &Fitting, angles: &[f64]) -> Local {
    let data = &fitting.data;
    let relaxation_time = if fitting.known.starts_at_rest() { 0.0 } else { relaxation_time(fitting.known, data, 0.0) };
    let moments = FIRST_MOMENTS * relaxation_time.min(FIRST_SHARE * data.duration());
    local(angles, data.dt, 0.0, moments.max(data.dt))
}

/// Contact angles to try at t = 0.
fn start_angles(fitting: &Fitting, angles: Option<&[f64]>) -> Vec<Local> {
    let data = &fitting.data;
    if let Some(angles) = angles {
        return vec![first_angle(fitting, angles)];
    }
    let [low, high] = data.u0_range.unwrap_or_else(|| {
        // The finger pushes ahead of itself.
        let finger = &fitting.known.finger;
        let toward = if fitting.known.starts_at_rest() { finger.acceleration } else { finger.velocity0 };
        let [x, y] = toward.into();
        let ahead = y.atan2(x);
        [ahead - 0.5 * TAU, ahead + 0.5 * TAU]
    });
    let steps = ((high - low) / ANGLE_STEP).ceil().clamp(1.0, TAU / ANGLE_STEP);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a few hundred")]
    let whole = steps as usize;
    (0..=whole).map(|i| Local { value: low + (high - low) * count(i) / steps, rate: 0.0 }).collect()
}

/// What simulations begin with, to be tried at every place.
struct StartGrid<'a, 'p> {
    fitting: &'a Fitting<'a, 'p>,
    /// Contact angles and their rates.
    starts: Vec<Local>,
    width: Width,
}

impl StartGrid<'_, '_> {
    /// Near the local minima among simulations from a grid of starts.
    fn seeds(&self, interval: &ContactInterval, start_mode: StartMode) -> Vec<Candidate> {
        let fitting = self.fitting;
        let model = fitting.known.model(interval.edge);
        let places = places(fitting.known, interval);
        let mut rows: Vec<Vec<(f64, Option<Candidate>)>> = Vec::new();
        for start in &self.starts {
            let tried = places.iter().map(|&s| {
                if fitting.goes_on().is_none() {
                    return (f64::INFINITY, None);
                }
                let unknowns = self.tries(&model, start_mode, start, s);
                let costs = unknowns.into_iter().filter_map(|unknowns| {
                    let candidate = Candidate { interval: *interval, start_mode, unknowns, past: None };
                    Some((fitting.cost(&candidate)?, Some(candidate)))
                });
                costs.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((f64::INFINITY, None))
            });
            rows.push(tried.collect());
        }
        let mut lowest: Vec<_> = grid_minima(&rows);
        lowest.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut found: Vec<_> = lowest.into_iter().take(FROM_GRID_MAX).filter_map(|(_, candidate)| candidate).collect();
        let mut cells = self.cells(interval, &places, &rows);
        cells.sort_by(|a, b| a.least().total_cmp(&b.least()));
        let most = found.len() + FROM_CELLS_MAX;
        for candidate in cells.iter().map(Cell::candidate) {
            if found.len() < most && !found.iter().any(|other| lead_to_one(other, &candidate)) {
                found.push(candidate);
            }
        }
        found
    }

    /// Around the best places at each angle.
    fn cells(&self, interval: &ContactInterval, places: &[f64], rows: &[Vec<(f64, Option<Candidate>)>]) -> Vec<Cell> {
        let fitting = self.fitting;
        let held = fitting.holding_the_place();
        let spacing = places[1] - places[0];
        let around = |guess: Candidate, s: f64| {
            fitting.goes_on().and_then(|()| Cell::around(fitting, &held, guess, reach(interval, s, spacing)))
        };
        let of_row = |row: &Vec<(f64, Option<Candidate>)>| -> Vec<Cell> {
            let best = minima(&row.iter().map(|entry| entry.0).collect::<Vec<_>>());
            best.into_iter().filter_map(|place| around(row[place].1?, places[place])).collect()
        };
        rows.iter().flat_map(of_row).collect()
    }

    /// Starts to try at one angle and place.
    fn tries(&self, model: &PushModel, start_mode: StartMode, start: &Local, s: f64) -> Vec<Unknowns> {
        let (fitting, width) = (self.fitting, self.width);
        let known = fitting.known;
        let smoothed = State { u: start.value, s, omega: start.rate, v_t: 0.0 };
        let settled = settled(model, known.touch, slip_of(known, start_mode), 0.0, &smoothed).map(|now| now.state);
        let settles = settles(known, &fitting.data);
        let from = settled.filter(|_| settles).unwrap_or(smoothed);
        let angle_known = angles(known, &fitting.data, start_mode).is_some();
        let toward_smoothed = |share: &f64| from.omega + share * (smoothed.omega - from.omega);
        let sigma = fitting.prior.omega0_sigma.unwrap_or(OMEGA_USUAL);
        let omegas: Vec<f64> = match (width, angle_known) {
            // Of known angles only the wide search comes here: the narrow one covers the edges.
            (_, true) => OMEGA_SHARES.iter().map(toward_smoothed).collect(),
            (Width::Narrow, false) if settles => vec![from.omega],
            (Width::Narrow, false) => vec![from.omega, 0.0, -from.omega],
            (Width::Wide, false) => OMEGA_SIGMAS.iter().map(|share| share * sigma).chain([from.omega]).collect(),
        };
        let mut tried = Vec::new();
        for omega in omegas {
            let mut along = along_contact(known, model, start_mode, &State { omega, ..from });
            if width == Width::Wide || !settles {
                let speed = known.finger.velocity0.norm();
                match start_mode {
                    StartMode::Free => along.extend(ALONG.map(|share| share * speed)),
                    StartMode::Slips(_) => along.extend(ALONG.map(|share| share.abs() * speed)),
                    StartMode::NoSlip | StartMode::Rest(_) => {}
                }
            }
            tried.extend(along.into_iter().map(|along| [from.u, s, omega, along, 0.0]));
        }
        tried
    }
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
