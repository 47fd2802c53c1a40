//! Motions looked up instead of simulated: for a push that is made again and again.
//!
//! Finger, part, path and u₀ fixed, the motions from a grid of s₀ are kept. Contacts are then compared with the table,
//! and a few simulations make the candidates exact: one that shows how far off the table is, and one or two to be sure.
//!
//! Implements: the table lookup that thesis §8.2.2 proposes.
//! Assumes: as [`super`]. Units: SI. Errors: none; contacts later than the table are simulated as without it.

use super::root_polishing::Rough;
use super::{ContactInterval, Contacts, HOPELESS, RestingPoses, RestingPush, TimedContact, Watched};
use crate::math::roots::{NearZero, near_zeros};
use crate::search::{Halt, Searched, Stop, never};

/// Times kept of each motion.
const TIMES: usize = 32;

/// How far a table may be off, in the unit of u: between its places and times it is interpolated by cubics.
const TABLE_ERROR: f64 = 1e-4;

/// How far it may be off, at the most, for a candidate to be given up without a simulation, in the unit of u.
const TABLE_ERROR_MAX: f64 = 5e-3;

/// A contact that ends this much later than a kept time, as a share of the step, ends at it.
const END_APART: f64 = 1e-6;

/// How many times the change over one step of the grid a misfit may change in the last, cut one.
const BORDER_REACH: f64 = 5.0;

/// The motions of one push from all places on the part.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::estimation::{Object, RestingPush, Table, TimedContact};
/// use palpate::pushing::dynamics::{FingerPath, FingerShape};
///
/// let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03]].map(Point2::from))?;
/// let (velocity0, acceleration) = (Vector2::zeros(), Vector2::new(0.01, 0.1)); // m/s, m/s²
/// let path = FingerPath { centre0: Point2::origin(), velocity0, acceleration };
/// let push = RestingPush::new(Object::Polygon(block), 0.0, FingerShape::Disk { radius: 0.01 }, path, 1.5)?;
/// let table = Table::new(&push, 1.0);
/// let measured = push.predicted(Some(0), 0.005, &[0.6, 0.9]);
/// let contacts = [TimedContact { t: 0.6, u: measured[0] }, TimedContact { t: 0.9, u: measured[1] }];
/// assert!((table.observe(&contacts, 1e-6).solutions[0].s0 - 0.005).abs() < 1e-9); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Table<'p> {
    push: &'p RestingPush,
    times: Vec<f64>,
    contact_intervals: Vec<IntervalTable>,
}

#[derive(Clone, Debug)]
struct IntervalTable {
    interval: ContactInterval,
    places: Vec<f64>,
    /// The motion from each place.
    motions: Vec<Motion>,
}

/// What one place leads to.
#[derive(Clone, Debug)]
struct Motion {
    /// u at each of the times while the contact lasts.
    angles: Vec<f64>,
    /// When the contact ends, s, and u then; none if it lasts as long as the table.
    end: Option<(f64, f64)>,
}

impl<'p> Table<'p> {
    /// Simulates the push from every place up to `time_end` (s).
    #[must_use]
    pub fn new(push: &'p RestingPush, time_end: f64) -> Self {
        Self::new_until(push, time_end, &never).unwrap_or_else(|| unreachable!("nobody wishes it to stop"))
    }

    /// The same, ended when `stop` says so: then there is none, because poses would be missing from half a table.
    #[must_use]
    pub fn new_until(push: &'p RestingPush, time_end: f64, stop: Stop<'_>) -> Option<Self> {
        let halt = Halt::new(stop);
        let step = time_end / TIMES as f64;
        let times: Vec<_> = (1..=TIMES).map(|index| step * index as f64).collect();
        let table = |&interval: &ContactInterval| {
            let places = interval.grid(push.refinement(time_end));
            // Half a motion is none.
            let motion = |&s0: &f64| {
                let motion = Motion::of(&push.watched(&halt), &interval, s0, &times);
                halt.goes_on().map(|()| motion)
            };
            let motions = places.iter().map(motion).collect::<Option<_>>()?;
            Some(IntervalTable { interval, places, motions })
        };
        let contact_intervals = push.contact_intervals.iter().map(table).collect::<Option<_>>()?;
        Some(Self { push, contact_intervals, times })
    }

    /// The push that it is a table of.
    pub(super) fn push(&self) -> &RestingPush {
        self.push
    }

    /// The same as [`RestingPush::observe`].
    #[must_use]
    pub fn observe(&self, contacts: &[TimedContact], tolerance: f64) -> RestingPoses {
        self.observe_until(contacts, tolerance, &never).found
    }

    /// The same, ended when `stop` says so: then with the poses found by then.
    #[must_use]
    pub fn observe_until(&self, contacts: &[TimedContact], tolerance: f64, stop: Stop<'_>) -> Searched<RestingPoses> {
        let halt = Halt::new(stop);
        let poses = self.halting_observe(contacts, tolerance, &halt);
        halt.searched(poses)
    }

    fn halting_observe(&self, contacts: &[TimedContact], tolerance: f64, halt: &Halt<'_>) -> RestingPoses {
        let beyond = |contact: &TimedContact| !(contact.t > 0.0 && contact.t <= self.times[TIMES - 1]);
        if contacts.first().is_none_or(beyond) {
            return self.push.watched(halt).observe(contacts, tolerance);
        }
        let contacts = self.push.without_turns(contacts);
        let places = self
            .contact_intervals
            .iter()
            .take_while(|_| !halt.is_wished())
            .flat_map(|table| self.places(table, contacts[0], tolerance, halt));
        let places: Vec<_> = places.collect();
        let last = contacts[contacts.len() - 1];
        let hopeless = |interval: &ContactInterval, s0: f64| {
            let misfit = self.looked_up(interval, s0, last.t).map(|u| (u - last.u).abs());
            misfit.is_some_and(|misfit| misfit > TABLE_ERROR_MAX + HOPELESS * tolerance)
        };
        self.push.watched(halt).judged(&places, &Contacts { measured: contacts, tolerance }, &hopeless)
    }

    /// u at a time as the table has it; none where the contact may have ended.
    fn looked_up(&self, interval: &ContactInterval, s0: f64, t: f64) -> Option<f64> {
        let table = self.contact_intervals.iter().find(|table| table.interval.edge == interval.edge)?;
        let now: Vec<_> = table.motions.iter().map(|motion| self.at_time(motion, t)).collect();
        table.at_place(&now, s0)
    }

    /// Places of one interval that fit the first contact.
    fn places(
        &self,
        table: &IntervalTable,
        first: TimedContact,
        tolerance: f64,
        halt: &Halt<'_>,
    ) -> Vec<(ContactInterval, NearZero)> {
        let push = self.push.watched(halt);
        let now: Vec<_> = table.motions.iter().map(|motion| self.at_time(motion, first.t)).collect();
        let misfit = |s0: f64| Some(table.at_place(&now, s0)? - first.u);
        let rough = Rough { interval: table.interval, misfit: &misfit, grid: &table.places, error: TABLE_ERROR };
        let inside = push.places(&rough, first, tolerance);
        let at_borders = near_borders(&push, table, &now, first, tolerance);
        inside.into_iter().chain(at_borders).map(|near| (table.interval, near)).collect()
    }

    /// u at a time, of one motion; a cubic through the four times around it, u₀ at 0 and its mirror image before.
    fn at_time(&self, motion: &Motion, t: f64) -> Option<f64> {
        if motion.end.is_some() && t >= self.times[0] * motion.angles.len() as f64 {
            return self.near_end(motion, t);
        }
        let motion = &motion.angles;
        let step = self.times[0];
        let whole = (t / step).floor().min(TIMES as f64 - 2.0).max(0.0);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "between 0 and the number of times"
        )]
        let from = whole as usize;
        // The motion from rest is even in time to the order kept.
        let value = |index: usize, back: usize| match (index + 1).checked_sub(back) {
            Some(0) => Some(self.push.u0),
            Some(index) => motion.get(index - 1).copied(),
            None => motion.first().copied(),
        };
        let (before, here, next) = (value(from, 2)?, value(from, 1)?, value(from, 0)?);
        // Beyond the last of them the motion goes on along a parabola.
        let after = value(from + 1, 0).unwrap_or(3.0 * (next - here) + before);
        Some(cubic([before, here, next, after], t / step - whole))
    }
}

impl Table<'_> {
    /// u between the last of the times that a motion lasts to and its end: the cubic through the end and the last
    /// three.
    fn near_end(&self, motion: &Motion, t: f64) -> Option<f64> {
        let (end, u_end) = motion.end.filter(|(end, _)| t <= *end)?;
        let (step, last) = (self.times[0], motion.angles.len());
        let kept = |index: usize| {
            (step * index as f64, index.checked_sub(1).map_or(self.push.u0, |index| motion.angles[index]))
        };
        let (at_last, u_last) = kept(last);
        if end - at_last < END_APART * step {
            return Some(u_last);
        }
        // The motion from rest is even in time to the order kept: what comes before it is its mirror image.
        let mirrored = |(at, u): (f64, f64)| (-at, u);
        let before = match last {
            0 => vec![mirrored((end, u_end))],
            1 => vec![mirrored(kept(1)), kept(0)],
            _ => vec![kept(last - 2), kept(last - 1)],
        };
        let points: Vec<_> = before.into_iter().chain([(at_last, u_last), (end, u_end)]).collect();
        Some(lagrange(&points, t))
    }
}

impl Motion {
    /// Without friction under the part as if the contact lasted.
    fn of(push: &Watched<'_>, interval: &ContactInterval, s0: f64, times: &[f64]) -> Self {
        if push.mu_g == 0.0
            && let Some(event_free) = push.event_free(interval, s0, times)
        {
            return Self { angles: event_free.angles, end: None };
        }
        let Some(run) = push.run(interval, s0, times) else {
            return Self { angles: Vec::new(), end: Some((0.0, push.u0)) };
        };
        let angles: Vec<_> = run.samples.iter().map(|sample| sample.state.u).collect();
        let end = (angles.len() < times.len()).then_some((run.last.t, run.last.state.u));
        Self { angles, end }
    }
}

/// Places between one whose contact lasts and one whose does not: simulated where the misfit can reach zero there.
fn near_borders(
    push: &Watched<'_>,
    table: &IntervalTable,
    now: &[Option<f64>],
    first: TimedContact,
    tolerance: f64,
) -> Vec<NearZero> {
    let exact = |s0: f64| push.misfit(&table.interval, s0, first);
    // Changes of the two steps of the grid that lead to the border; where there are none, anything is possible.
    let reaches = |here: usize, beside: usize, beyond: usize| {
        let value = |index: usize| now.get(index).copied().flatten();
        let change = |a: usize, b: usize| value(a).zip(value(b)).map_or(f64::INFINITY, |(a, b)| (a - b).abs());
        let change = change(here, beside).max(change(beside, beyond));
        value(here).is_some_and(|u| (u - first.u).abs() <= tolerance + BORDER_REACH * change)
    };
    let cells = (1..now.len()).filter(|&index| match (now[index - 1], now[index]) {
        (Some(_), None) => reaches(index - 1, index.wrapping_sub(2), index.wrapping_sub(3)),
        (None, Some(_)) => reaches(index, index + 1, index + 2),
        _ => false,
    });
    cells.flat_map(|index| near_zeros(&exact, &table.places[index - 1..=index], tolerance)).collect()
}

/// The polynomial through some points, at one place.
fn lagrange(points: &[(f64, f64)], t: f64) -> f64 {
    let weight = |index: usize| -> f64 {
        let others = points.iter().enumerate().filter(|(other, _)| *other != index);
        others.map(|(_, (at, _))| (t - at) / (points[index].0 - at)).product()
    };
    points.iter().enumerate().map(|(index, (_, u))| weight(index) * u).sum()
}

impl IntervalTable {
    /// The kept values between their places: a cubic through the four around.
    fn at_place(&self, values: &[Option<f64>], s0: f64) -> Option<f64> {
        let step = self.places[1] - self.places[0];
        let last = self.places.len() - 2;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the places there are")]
        let from = (((s0 - self.places[0]) / step).floor().max(0.0) as usize).min(last);
        let share = (s0 - self.places[from]) / step;
        let (here, next) = (values[from], values[from + 1]);
        if share == 0.0 {
            return here;
        }
        let (here, next) = (here?, next?);
        // Beyond an end the values go on straight.
        let before = from.checked_sub(1).and_then(|index| values[index]).unwrap_or(2.0 * here - next);
        let after = values.get(from + 2).copied().flatten().unwrap_or(2.0 * next - here);
        Some(cubic([before, here, next, after], share))
    }
}

/// The cubic through values at −1, 0, 1 and 2.
fn cubic([before, here, next, after]: [f64; 4], x: f64) -> f64 {
    let weights = [
        -x * (x - 1.0) * (x - 2.0) / 6.0,
        (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0,
        -(x + 1.0) * x * (x - 2.0) / 2.0,
        (x + 1.0) * x * (x - 1.0) / 6.0,
    ];
    weights[0] * before + weights[1] * here + weights[2] * next + weights[3] * after
}
