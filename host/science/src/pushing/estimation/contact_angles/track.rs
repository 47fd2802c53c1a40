//! The estimate while the push goes on: one value in, everything that is still possible out.
//!
//! Each hypothesis starts where the value before left it and takes one Gauss–Newton step, so a value costs a few
//! simulations, not a search. While the window grows, one interval of the outline after the other is searched anew, so
//! that nothing is lost that more values bring out. When the window is full, its older part is dropped and what it said
//! about each hypothesis is kept as a Gaussian about the state at the window's new start (a moving horizon with an
//! arrival cost).
//!
//! A value that no hypothesis can follow, though they explained all before it, is held back: a spark, not a motion. If
//! the next ones cannot be followed either, the motion itself is another than was thought, and all of them count.
//! Values held back are named ([`Estimate::outliers`]).
//!
//! Assumes: values come each `dt` from contact onset on; one that got lost is given as none. Frames: world. Units: SI.
//! Errors: none. Until there are values enough, or where nothing explains them, there are no hypotheses.

use nalgebra::{DMatrix, Matrix5, Vector2, Vector5};

use super::contact_intervals::contact_intervals;
use super::data::Data;
use super::fit::{Candidate, Descent, Fitting, Given, Past};
use super::initial_state::{MU_G, StartMode, UNKNOWNS};
use super::path::ContactInterval;
use super::seed::{Width, seeds};
use super::select::{REST_ERROR, descend_together, fineness, judge_all, least_cost, merge_met, total_max};
use crate::pushing::dynamics::{ContactMode, Finger};
use crate::pushing::estimation::hypotheses::{Estimate, Fit};
use crate::pushing::estimation::observation::{Channel, Known, Measured, Observation, Prior};
use crate::search::{Effort, Halt, Searched, Stop, never};

/// Values before the first estimate.
const VALUES_FIRST: usize = 15;

/// Values between one search of an interval and the next.
const SEARCH_EACH: usize = 4;

/// Part of the window that is dropped when it is full: one in so many.
const DROPPED_SHARE: usize = 4;

/// A value is held back if it adds more than this to the cost of every hypothesis, though they take a step towards it:
/// six standard deviations, squared. Noise does that once in 10⁸ values.
const WILD: f64 = 36.0;

/// So many values in a row that cannot be followed are no sparks: the motion is another.
const WILD_IN_A_ROW: usize = 4;

/// What the model may be off by while a part of the window passes: rad, m, rad/s, m/s, of µg. It keeps the memory of
/// the past finite.
const DRIFT: [f64; UNKNOWNS] = [1e-4, 1e-5, 1e-3, 1e-4, 1e-2];

/// How to follow a push.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackerSettings {
    /// Time between values, s.
    pub dt: f64,
    /// Standard deviation of one, rad, above 0.
    pub sigma: f64,
    /// What is known of the start beforehand.
    pub prior: Prior,
    /// Most values in the window; at least twice [`Tracker::VALUES_FIRST`].
    pub window: usize,
}

/// Follows a push from contact onset on.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::geometry::SimplePolygon;
/// use palpate::pushing::estimation::{Known, Prior, Touch, Tracker, TrackerSettings};
/// use palpate::pushing::dynamics::{ContactMode, Finger, Part, PushModel, State};
///
/// let wedge = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.025], [-0.03, 0.01]].map(Point2::from))?;
/// let part = Part::uniform(wedge);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let known = Known { part: &part, mu_g: 0.3 * 9.81, finger, touch: Touch::Rolling { friction: None } };
/// let settings = TrackerSettings { dt: 0.01, sigma: 2e-3, prior: Prior::default(), window: 80 };
/// let mut tracker = Tracker::new(known, settings);
///
/// let model = PushModel { part: &part, edge: part.edge(0)?, mu_g: 0.3 * 9.81, finger };
/// let start = State { u: 1.6, s: 0.012, omega: 0.1, v_t: 0.0 };
/// let measured = std::iter::once(start).chain(model.rollout(&ContactMode::Rolling, &start, 0.01)).take(50);
/// let mut end = start;
/// for state in measured {
///     tracker.push_sample(Some(state.u));
///     end = state;
/// }
/// let found = tracker.estimate().hypotheses.iter().find(|found| found.edge == 0).unwrap();
/// assert!((found.end.s - end.s).abs() < 1e-3); // m
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Tracker<'p> {
    /// With the finger as it is at the start of the window.
    known: Known<'p>,
    settings: TrackerSettings,
    contact_intervals: Vec<ContactInterval>,
    start_modes: Vec<StartMode>,
    window: Vec<f64>,
    /// Whether older values were dropped.
    full: bool,
    /// Values taken so far, dropped ones included.
    count: usize,
    next_interval: usize,
    /// Whether all intervals were searched at once, as is done first.
    searched_everywhere: bool,
    live: Vec<Candidate>,
    /// The least cost among them.
    cost: f64,
    /// Values held back, in their order: number, from the first of the push on, and what it was, rad.
    held_back: Vec<(usize, f64)>,
    estimate: Estimate,
}

impl<'p> Tracker<'p> {
    /// Values before the first estimate.
    pub const VALUES_FIRST: usize = VALUES_FIRST;

    /// Starts at contact onset; `known` has the finger's motion from there on.
    #[must_use]
    pub fn new(known: Known<'p>, settings: TrackerSettings) -> Self {
        let settings = TrackerSettings { window: settings.window.max(2 * VALUES_FIRST), ..settings };
        let fit = Fit { cost: None, degrees_of_freedom: 0, cost_max: 0.0 };
        Self {
            contact_intervals: contact_intervals(known.part, known.finger.radius, &Halt::new(&never)),
            start_modes: StartMode::all(&known),
            known,
            settings,
            window: Vec::new(),
            full: false,
            count: 0,
            next_interval: 0,
            searched_everywhere: false,
            live: Vec::new(),
            cost: f64::INFINITY,
            held_back: Vec::new(),
            estimate: Estimate::unexplained(fit, 0.0),
        }
    }

    /// The estimate at the last value's time.
    #[must_use]
    pub fn estimate(&self) -> &Estimate {
        &self.estimate
    }

    /// The finger's motion with t = 0 moved to the last value's time: what a planner or another estimate goes on from.
    #[must_use]
    pub fn finger_now(&self) -> Finger {
        moved(&self.known.finger, self.time_of(self.window.len().saturating_sub(1)))
    }

    /// Takes the next contact angle, rad; none for one that got lost. Whole turns do not count.
    pub fn push_sample(&mut self, angle: Option<f64>) -> &Estimate {
        self.push_sample_until(angle, &never).found
    }

    /// The same, ended when `stop` says so: then the estimate stays that of the last value whose update was complete.
    ///
    /// The value counts all the same: the next update takes the hypotheses on to both.
    pub fn push_sample_until(&mut self, angle: Option<f64>, stop: Stop<'_>) -> Searched<&Estimate> {
        let halt = Halt::new(stop);
        self.window.push(angle.unwrap_or(f64::NAN));
        self.count += 1;
        if self.window.len() >= VALUES_FIRST {
            // Half an update would have lost hypotheses.
            let mut updated = self.clone();
            if updated.update(&halt).is_some() && !halt.was_wished() {
                *self = updated;
            }
        }
        // Nothing is known of what would be dropped before all intervals were searched once.
        if self.searched_everywhere && self.window.len() >= self.settings.window {
            self.drop_oldest(self.settings.window / DROPPED_SHARE);
        }
        halt.searched(&self.estimate)
    }

    fn time_of(&self, value: usize) -> f64 {
        super::clock::count(value) * self.settings.dt
    }

    /// Takes the hypotheses on to the last value; none where one should halt before it is done.
    fn update(&mut self, halt: &Halt<'_>) -> Option<()> {
        let (effort, known) = (Effort::new(halt), self.known);
        let mut fitting = self.fitting(&known, self.window.clone(), &effort);
        let mut minima = self.followed(&fitting, halt)?;
        if self.is_wild(&minima) {
            self.hold_back_last();
            fitting = self.fitting(&known, self.window.clone(), &effort);
            minima = self.followed(&fitting, halt)?;
        }
        minima.extend(self.searched(&fitting, halt));
        halt.goes_on()?;
        self.conclude(&fitting, minima);
        if self.estimate.hypotheses.is_empty() && self.is_search_due() {
            self.search_without_wild(halt);
        }
        self.searched_everywhere = true;
        Some(())
    }

    /// The hypotheses so far, a step nearer to the values; none where one should halt.
    fn followed(&self, fitting: &Fitting, halt: &Halt<'_>) -> Option<Vec<Descent>> {
        let going = self.live.iter().take_while(|_| !halt.is_wished());
        let mut minima: Vec<_> = going.filter_map(|candidate| fitting.descend(*candidate)).collect();
        for descent in &mut minima {
            halt.goes_on()?;
            fitting.improve(descent);
        }
        halt.goes_on()?;
        Some(minima)
    }

    fn conclude(&mut self, fitting: &Fitting, mut minima: Vec<Descent>) {
        keep_near_best(&mut minima);
        self.cost = least_cost(&minima);
        let judged = judge_all(fitting, &minima, self.start_modes.len());
        let outliers = self.held_back.iter().map(|(number, _)| *number).collect();
        self.estimate = Estimate { simulations: fitting.effort.simulations(), outliers, ..judged };
        self.live = minima.iter().map(|descent| descent.evaluation.candidate).collect();
    }

    /// Whether hypotheses that explained all values before the last cannot follow that one.
    fn is_wild(&self, followed: &[Descent]) -> bool {
        !self.estimate.hypotheses.is_empty() && least_cost(followed) > self.cost + WILD
    }

    /// Number, from the first of the push on, of the first value in the window.
    fn first_number(&self) -> usize {
        self.count - self.window.len()
    }

    /// Holds the last value back; if those before it were too, they all count.
    fn hold_back_last(&mut self) {
        let last = self.count - 1;
        let before = self.held_back.len().saturating_sub(WILD_IN_A_ROW - 1);
        let row = &self.held_back[before..];
        if row.len() + 1 < WILD_IN_A_ROW || row[0].0 + row.len() != last {
            return self.hold_back(self.window.len() - 1);
        }
        for (number, value) in self.held_back.split_off(before) {
            if let Some(place) = number.checked_sub(self.first_number()) {
                self.window[place] = value;
            }
        }
    }

    fn hold_back(&mut self, place: usize) {
        let value = std::mem::replace(&mut self.window[place], f64::NAN);
        self.held_back.push((self.first_number() + place, value));
    }

    /// Searches everywhere without the values that no smooth motion passes through, and keeps to that if it explains
    /// the others.
    fn search_without_wild(&mut self, halt: &Halt<'_>) {
        let (effort, known, mut tried) = (Effort::new(halt), self.known, self.clone());
        let fitting = self.fitting(&known, self.window.clone(), &effort);
        let Some(wild) = fitting.data.outliers().filter(|wild| !wild.is_empty()) else { return };
        wild.into_iter().for_each(|place| tried.hold_back(place));
        tried.held_back.sort_by_key(|(number, _)| *number);
        let fitting = tried.fitting(&known, tried.window.clone(), &effort);
        let candidates = seeds(&fitting, &tried.contact_intervals, &tried.start_modes, Width::Narrow);
        tried.conclude(&fitting, descend_together(&fitting, &candidates, halt));
        if !tried.estimate.hypotheses.is_empty() {
            *self = tried;
        }
    }

    fn fitting<'a>(&self, known: &'a Known<'p>, values: Vec<f64>, effort: &'a Effort<'a>) -> Fitting<'a, 'p> {
        let TrackerSettings { dt, sigma, prior, .. } = self.settings;
        let measured = Measured::ContactAngle(Channel { values, sigma });
        let data = Data::new(&Observation { dt, measured, prior });
        Fitting::new(Given { known, data, prior }, fineness(sigma, 1.0), REST_ERROR * sigma, effort)
    }

    fn is_first(&self) -> bool {
        !self.searched_everywhere
    }

    fn is_search_due(&self) -> bool {
        !self.full && (self.is_first() || self.window.len().is_multiple_of(SEARCH_EACH))
    }

    /// Minima of the intervals whose turn it is: all at first, then one now and then until values are dropped.
    fn searched(&mut self, fitting: &Fitting, halt: &Halt<'_>) -> Vec<Descent> {
        let candidates = if self.is_first() {
            seeds(fitting, &self.contact_intervals, &self.start_modes, Width::Narrow)
        } else if self.is_search_due() && !self.contact_intervals.is_empty() {
            self.next_interval = (self.next_interval + 1) % self.contact_intervals.len();
            seeds(fitting, &[self.contact_intervals[self.next_interval]], &self.start_modes, Width::Narrow)
        } else {
            return Vec::new();
        };
        descend_together(fitting, &candidates, halt)
    }

    /// Moves the window's start, and keeps what the values before it said.
    fn drop_oldest(&mut self, dropped: usize) {
        let halt = Halt::new(&never);
        let (effort, known) = (Effort::new(&halt), self.known);
        // The value at the new start stays in the window.
        let mut values = self.window[..=dropped].to_vec();
        values[dropped] = f64::NAN;
        let fitting = self.fitting(&known, values, &effort);
        let time = self.time_of(dropped);
        self.live = self.live.iter().filter_map(|candidate| remembered(&fitting, candidate, time)).collect();
        self.window.drain(..dropped);
        self.known.finger = moved(&known.finger, time);
        self.full = true;
    }
}

/// The same motion with another t = 0.
fn moved(finger: &Finger, time: f64) -> Finger {
    Finger { centre0: finger.centre(time), velocity0: finger.velocity(time), ..*finger }
}

/// Drops what is far above the best, and the worse of two that are one.
fn keep_near_best(minima: &mut Vec<Descent>) {
    let most = total_max(minima.iter());
    minima.retain(|descent| descent.evaluation.total() <= most);
    merge_met(minima);
}

/// A candidate at the end of some values, with what they say about it there. None where they say it cannot be.
fn remembered(fitting: &Fitting, candidate: &Candidate, time: f64) -> Option<Candidate> {
    let descent = fitting.descend(*candidate)?;
    let evaluation = &descent.evaluation;
    let (end, edge) = (evaluation.end, candidate.interval.edge);
    // The plane's friction stays what it is.
    let mut by_start = Matrix5::identity();
    by_start.fixed_rows_mut::<MU_G>(0).copy_from(&evaluation.end_by_start);
    let (start_mode, along) = match evaluation.contact_end {
        ContactMode::Frictionless => (StartMode::Free, end.v_t),
        ContactMode::Rolling => (StartMode::NoSlip, 0.0),
        ContactMode::Sliding { slip, .. } => {
            // v_FT + hω − v_T in the direction of the slip; T turns with the contact.
            let model = fitting.known.model(edge);
            let finger_v_n = -model.finger.velocity(time).dot(&Vector2::new(end.u.cos(), end.u.sin()));
            let row = by_start.row(0) * finger_v_n + by_start.row(2) * edge.height - by_start.row(3);
            by_start.set_row(3, &(row * slip.sign()));
            (StartMode::Slips(slip), (model.slip(time, &end) * slip.sign()).max(0.0))
        }
    };
    let (covariance, step) = fitting.spread(&descent)?;
    let drift = Matrix5::from_diagonal(&Vector5::from(DRIFT).map(|drift| drift * drift));
    let spread = by_start * covariance * by_start.transpose() + drift;
    let unknowns = [end.u, end.s, end.omega, along, candidate.unknowns[MU_G]];
    let past = Past {
        best: Vector5::from(unknowns) + by_start * step,
        information: inverse_of(&spread, |unknown| fitting.has(start_mode, unknown))?,
        cost: evaluation.cost - step.dot(&(evaluation.information * step)),
        terms: fitting.data.terms() + fitting.prior_terms(candidate),
    };
    Some(Candidate { interval: candidate.interval, start_mode, unknowns, past: Some(past) })
}

/// The inverse of the rows and columns of some unknowns, zeros elsewhere.
fn inverse_of(matrix: &Matrix5<f64>, is_there: impl Fn(usize) -> bool) -> Option<Matrix5<f64>> {
    let there: Vec<_> = (0..UNKNOWNS).filter(|unknown| is_there(*unknown)).collect();
    let block = DMatrix::from_fn(there.len(), there.len(), |i, j| matrix[(there[i], there[j])]);
    let inverse = block.cholesky()?.inverse();
    let mut widened = Matrix5::zeros();
    for (i, row) in there.iter().enumerate() {
        for (j, column) in there.iter().enumerate() {
            widened[(*row, *column)] = inverse[(i, j)];
        }
    }
    Some(widened)
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

    use nalgebra::Point2;

    use super::*;
    use crate::geometry::SimplePolygon;
    use crate::pushing::dynamics::{Part, PushModel, State};
    use crate::pushing::estimation::Touch;
    use crate::search::check_stopping;

    /// rad: 0.112°.
    const SIGMA: f64 = 1.95e-3;

    /// Four of the estimate's own standard deviations.
    const DEVIATIONS: f64 = 4.0;

    /// Follows a push of `values` values with an alternating error of one standard deviation.
    fn follow(touch: Touch, contact: ContactMode, values: usize) {
        let outline = [[-0.031, -0.022], [0.03, -0.018], [0.022, 0.027], [-0.028, 0.012]].map(Point2::from);
        let part = Part::uniform(SimplePolygon::new(outline).unwrap());
        let finger = Finger {
            radius: 0.01,
            centre0: Point2::origin(),
            velocity0: Vector2::new(0.0, 0.05),
            acceleration: Vector2::zeros(),
        };
        let known = Known { part: &part, mu_g: 0.3 * 9.81, finger, touch };
        let prior = Prior { omega0_sigma: Some(1.0), v_t0_sigma: Some(0.004), mu_g_log_sigma: None };
        let mut tracker = Tracker::new(known, TrackerSettings { dt: 0.01, sigma: SIGMA, prior, window: 60 });
        let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 0.3 * 9.81, finger };
        let start = State { u: 1.6, s: 0.006, omega: 0.2, v_t: 0.0 };
        let path = std::iter::once(start).chain(model.rollout(&contact, &start, 0.002)).step_by(5).take(values);
        for (i, truth) in path.enumerate() {
            let error = if i.is_multiple_of(2) { SIGMA } else { -SIGMA };
            let lost = i % 17 == 16;
            tracker.push_sample((!lost).then_some(truth.u + error));
            if i + 1 < 2 * VALUES_FIRST {
                continue;
            }
            let off = |found: &&crate::pushing::estimation::Hypothesis| {
                let deviation = found.state_covariance.map_or(f64::INFINITY, |covariance| covariance.m22.sqrt());
                (found.end.s - truth.s).abs() / deviation
            };
            let found = tracker.estimate().hypotheses.iter().filter(|found| found.edge == 0);
            let nearest = found.map(|found| off(&found)).fold(f64::INFINITY, f64::min);
            assert!(nearest < DEVIATIONS, "value {i}: {nearest} deviations off: {:?}", tracker.estimate());
        }
    }

    /// A tracker that took so many values of a rolling push, and the value after.
    fn tracker_after(values: usize, then: impl FnOnce(Tracker<'_>, f64)) {
        let outline = [[-0.031, -0.022], [0.03, -0.018], [0.022, 0.027], [-0.028, 0.012]].map(Point2::from);
        let part = Part::uniform(SimplePolygon::new(outline).unwrap());
        let finger = Finger {
            radius: 0.01,
            centre0: Point2::origin(),
            velocity0: Vector2::new(0.0, 0.05),
            acceleration: Vector2::zeros(),
        };
        let known = Known { part: &part, mu_g: 0.3 * 9.81, finger, touch: Touch::Rolling { friction: None } };
        let settings = TrackerSettings { dt: 0.01, sigma: SIGMA, prior: Prior::default(), window: 60 };
        let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 0.3 * 9.81, finger };
        let start = State { u: 1.6, s: 0.006, omega: 0.2, v_t: 0.0 };
        let rollout = model.rollout(&ContactMode::Rolling, &start, 0.01);
        let angles: Vec<_> = std::iter::once(start).chain(rollout).take(values + 1).map(|state| state.u).collect();
        let mut tracker = Tracker::new(known, settings);
        for angle in &angles[..values] {
            tracker.push_sample(Some(*angle));
        }
        then(tracker, angles[values]);
    }

    #[test]
    fn one_update_can_be_stopped() {
        // The first estimate, one that only follows, one that searches an interval too.
        for values in [VALUES_FIRST - 1, VALUES_FIRST + 1, 5 * SEARCH_EACH - 1] {
            tracker_after(values, |tracker, angle| {
                check_stopping(|stop| {
                    let mut tracker = tracker.clone();
                    let Searched { found, complete } = tracker.push_sample_until(Some(angle), stop);
                    Searched { found: found.clone(), complete }
                });
            });
        }
    }

    #[test]
    fn what_a_stopped_update_left_out_is_done_at_the_next_value() {
        tracker_after(VALUES_FIRST - 1, |mut tracker, angle| {
            let asked = AtomicUsize::new(0);
            let stop = || asked.fetch_add(1, Relaxed) == 2;
            let stopped = tracker.push_sample_until(Some(angle), &stop);
            assert!(!stopped.complete && stopped.found.hypotheses.is_empty());
            assert_eq!(asked.load(Relaxed), 3, "it is not asked again");
            // All intervals are searched with the first value that there is time for.
            assert!(!tracker.push_sample(None).hypotheses.is_empty());
        });
        tracker_after(VALUES_FIRST + 1, |mut tracker, angle| {
            let before = format!("{:?}", tracker.estimate());
            let stopped = tracker.push_sample_until(Some(angle), &|| true);
            assert_eq!(format!("{:?}", stopped.found), before);
            assert!(tracker.push_sample(None).time_end > tracker.time_of(VALUES_FIRST + 2) - 1e-9);
        });
    }

    #[test]
    fn updates_stopped_for_longer_than_the_window_lose_nothing() {
        tracker_after(0, |mut tracker, angle| {
            for _ in 0..tracker.settings.window + 5 {
                tracker.push_sample_until(Some(angle), &|| true);
            }
            assert!(!tracker.searched_everywhere);
            tracker.push_sample(Some(angle));
            assert!(tracker.searched_everywhere && tracker.estimate().fit.degrees_of_freedom > tracker.settings.window);
        });
    }

    #[test]
    fn a_rolling_part_stays_in_the_set_beyond_the_window() {
        follow(Touch::Rolling { friction: None }, ContactMode::Rolling, 110);
    }

    #[test]
    fn a_part_without_contact_friction_stays_in_the_set_beyond_the_window() {
        follow(Touch::Frictionless, ContactMode::Frictionless, 110);
    }
}
