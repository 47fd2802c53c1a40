//! How a long search is ended before it is complete, and who does its work.
//!
//! A search of this library knows no clock and no threads: whoever calls it says when to stop, and on what runs beside what. It
//! asks now and then, every few milliseconds, and then ends with what it has found so far, which [`Searched::complete`] tells
//! from all there is. What does not need each other is handed out to be done together ([`Caller::work`]); what is found does
//! not depend on how.

use std::cell::Cell;
use std::cmp::Ordering;
use std::sync::Mutex;
#[cfg(test)]
use std::sync::atomic::AtomicUsize;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};

/// Who waits for a long search. Any `Fn() -> bool` is one that says when to stop, and does the work by itself.
///
/// ```
/// use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};
/// use palpate::Caller;
///
/// /// On two threads.
/// struct Two;
///
/// impl Caller for Two {
///     fn stops(&self) -> bool {
///         false
///     }
///
///     fn work(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
///         let next = AtomicUsize::new(0);
///         let work = || std::iter::repeat_with(|| next.fetch_add(1, Relaxed)).take_while(|k| *k < count).for_each(task);
///         std::thread::scope(|scope| {
///             scope.spawn(work);
///             work();
///         });
///     }
/// }
///
/// let done = AtomicUsize::new(0);
/// Two.work(100, &|task| drop(done.fetch_add(task, Relaxed)));
/// assert_eq!(done.into_inner(), 99 * 100 / 2);
/// ```
pub trait Caller: Sync {
    /// Asked now and then: whether to end.
    fn stops(&self) -> bool;

    /// Does the tasks from 0 to `count`, each once, in any order and any number at the same time. All are done when it returns.
    fn work(&self, count: usize, task: &(dyn Fn(usize) + Sync)) {
        (0..count).for_each(task);
    }
}

impl<F: Fn() -> bool + Sync> Caller for F {
    fn stops(&self) -> bool {
        self()
    }
}

/// Asked now and then by a long search whether to end, and given its work.
pub type Stop<'a> = &'a dyn Caller;

/// The wish of somebody who waits until a search is complete.
///
/// ```
/// assert!(!palpate::never());
/// ```
#[must_use]
pub fn never() -> bool {
    false
}

/// What a search found.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::*;
///
/// let part = Part::uniform(SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from))?);
/// let (velocity0, acceleration) = (Vector2::new(0.0, 0.05), Vector2::zeros()); // m/s, m/s²
/// let finger = Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration };
/// let known = Known { part: &part, mu_g: 0.3 * GRAVITY_ASSUMED, finger, touch: Touch::Rolling { friction: None } };
/// let measured = Measured::ContactAngle(Channel { values: vec![1.6, 1.605, 1.62, 1.64, 1.67], sigma: 2e-3 }); // rad
/// let observation = Observation { dt: 0.05, measured, prior: Prior::default() };
///
/// let stopped = known.estimate_until(&observation, &|| true); // by a clock, a key, a counter
/// assert!(!stopped.complete);
/// assert!(known.estimate_until(&observation, &never).complete);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Searched<T> {
    /// All that there is to find if the search is complete; otherwise what had been found, of which nothing follows
    /// about the rest.
    pub found: T,
    /// Whether the search came to its own end. Where it did not, nothing is excluded by not being found.
    pub complete: bool,
}

/// A wish to end that is kept once it was uttered.
pub(crate) struct Halt<'a> {
    stop: Stop<'a>,
    halted: AtomicBool,
}

impl<'a> Halt<'a> {
    pub(crate) fn new(stop: Stop<'a>) -> Self {
        Self { stop, halted: AtomicBool::new(false) }
    }

    /// Asks whether to end now; once it is so, it stays so.
    pub(crate) fn is_wished(&self) -> bool {
        if !self.was_wished() && self.stop.stops() {
            self.halted.store(true, Relaxed);
        }
        self.was_wished()
    }

    /// What becomes of each thing, in order, as far as that is done before the wish to end; at the same time where the caller
    /// likes.
    pub(crate) fn each<T: Send, U: Send>(&self, things: Vec<T>, of: impl Fn(T) -> U + Sync) -> Vec<U> {
        self.every(things, |thing| (!self.is_wished()).then(|| of(thing))).into_iter().flatten().collect()
    }

    /// The same of each thing whatever is wished: of what was found before.
    pub(crate) fn every<T: Send, U: Send>(&self, things: Vec<T>, of: impl Fn(T) -> U + Sync) -> Vec<U> {
        let things: Vec<_> = things.into_iter().map(|thing| Mutex::new(Some(thing))).collect();
        let made: Vec<_> = things.iter().map(|_| Mutex::new(None)).collect();
        self.stop.work(things.len(), &|task| {
            let thing = things[task].lock().ok().and_then(|mut thing| thing.take());
            let after = thing.map(&of);
            if let Ok(mut made) = made[task].lock() {
                *made = after;
            }
        });
        made.into_iter().filter_map(|made| made.into_inner().ok().flatten()).collect()
    }

    /// Asks whether to go on: none where one should not, for `?`.
    pub(crate) fn goes_on(&self) -> Option<()> {
        (!self.is_wished()).then_some(())
    }

    /// For much cheap work in a row.
    pub(crate) fn now_and_then(&self) -> NowAndThen<'_> {
        NowAndThen { halt: self, done: 0 }
    }

    /// Sorts, equal ones in the order in which they are. None where one should halt before all are sorted.
    pub(crate) fn sort_by<T: Copy>(&self, things: &mut Vec<T>, compare: impl Fn(&T, &T) -> Ordering) -> Option<()> {
        let mut looks = self.now_and_then();
        for run in things.chunks_mut(CHEAP) {
            self.goes_on()?;
            run.sort_by(&compare);
        }
        let (mut width, mut merged) = (CHEAP, Vec::new());
        while width < things.len() {
            merged.clear();
            merged.reserve_exact(things.len());
            for pair in things.chunks(2 * width) {
                let (mut left, mut right) = pair.split_at(width.min(pair.len()));
                while let (Some((a, left_rest)), Some((b, right_rest))) = (left.split_first(), right.split_first()) {
                    looks.goes_on()?;
                    if compare(a, b).is_le() {
                        merged.push(*a);
                        left = left_rest;
                    } else {
                        merged.push(*b);
                        right = right_rest;
                    }
                }
                merged.extend_from_slice(left);
                merged.extend_from_slice(right);
            }
            std::mem::swap(things, &mut merged);
            width *= 2;
        }
        Some(())
    }

    /// Whether it was uttered; does not ask.
    pub(crate) fn was_wished(&self) -> bool {
        self.halted.load(Relaxed)
    }

    /// What was found, with whether anything was left out.
    pub(crate) fn searched<T>(&self, found: T) -> Searched<T> {
        Searched { found, complete: !self.was_wished() }
    }
}

/// Steps of cheap work, a microsecond at most, between two questions whether to end.
const CHEAP: usize = 1024;

/// Asks whether to go on at every so many steps of cheap work.
pub(crate) struct NowAndThen<'a> {
    halt: &'a Halt<'a>,
    done: usize,
}

impl NowAndThen<'_> {
    /// Before a step: none where one should not go on, for `?`.
    pub(crate) fn goes_on(&mut self) -> Option<()> {
        self.done += 1;
        if self.done.is_multiple_of(CHEAP) { self.halt.goes_on() } else { Some(()) }
    }
}

/// What a search costs as it goes, and whether it shall go on.
#[derive(Debug)]
pub(crate) struct Effort<'a> {
    simulations: Cell<usize>,
    halt: &'a Halt<'a>,
}

impl<'a> Effort<'a> {
    pub(crate) fn new(halt: &'a Halt<'a>) -> Self {
        Self { simulations: Cell::new(0), halt }
    }

    /// Counts a forward simulation; none where there should be no more.
    pub(crate) fn simulate(&self) -> Option<()> {
        self.simulations.update(|count| count + 1);
        self.halt.goes_on()
    }

    /// The wish that ends the search.
    pub(crate) fn halt(&self) -> &'a Halt<'a> {
        self.halt
    }

    /// Forward simulations so far.
    pub(crate) fn simulations(&self) -> usize {
        self.simulations.get()
    }
}

impl std::fmt::Debug for Halt<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Halt").field("halted", &self.halted).finish_non_exhaustive()
    }
}

/// What any search that can be stopped has to keep: it asks, what it returns when told to stop says that it is incomplete, and a wish
/// that is never uttered changes nothing.
#[cfg(test)]
pub(crate) fn check_stopping<T: std::fmt::Debug>(search: impl Fn(Stop<'_>) -> Searched<T>) {
    let asked = AtomicUsize::new(0);
    let whole = search(&|| asked.fetch_add(1, Relaxed) == usize::MAX);
    let asked = asked.into_inner();
    assert!(whole.complete && asked > 1, "asked {asked} times");
    for after in [0, 1, asked / 4, asked / 2, asked - 1] {
        let left = AtomicUsize::new(0);
        let stopped = search(&|| left.fetch_add(1, Relaxed) >= after);
        assert!(!stopped.complete, "stopped after {after} of {asked} questions: {:?}", stopped.found);
    }
    let again = search(&never);
    assert!(again.complete);
    assert_eq!(format!("{:?}", again.found), format!("{:?}", whole.found));
}

/// The same of what is made whole or not at all.
#[cfg(test)]
pub(crate) fn check_stopping_of_making<T: std::fmt::Debug>(make: impl Fn(Stop<'_>) -> Option<T>) {
    check_stopping(|stop| {
        let found = make(stop);
        Searched { complete: found.is_some(), found }
    });
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point2, Quaternion, Vector2, Vector3};

    use super::*;
    use crate::geometry::{ConvexPolygon, SimplePolygon};
    use crate::inscription::{Cone, NoisyReadings, estimate_until};
    use crate::point_sampling::{Objective, Request, Scene};
    use crate::pushing::dynamics::{
        ContactLaw, ContactMode, EdgeEnd, Finger, FingerPath, FingerShape, Part, Push, PushModel, Start, State,
    };
    use crate::pushing::estimation::{
        Channel, GhoBank, GhoSettings, Known, Measured, Object, Observation, Prior, RestingPush, TimedContact, Touch,
    };
    use crate::rolling::{
        BodyKnowledge, Model, Noise, OnPalm, PalmAcceleration, PalmKnowledge, Roll, RollQuestion, RollState,
        RollingBody, Spin, specific_force,
    };

    /// A block that a finger of 1 cm pushes at this speed, m/s.
    fn block_and_finger(speed: f64) -> (Part, Finger) {
        let block = [[-0.03, -0.02], [0.03, -0.02], [0.03, 0.02], [-0.03, 0.02]].map(Point2::from);
        let part = Part::uniform(SimplePolygon::new(block).unwrap());
        let (velocity0, acceleration) = (Vector2::new(0.0, speed), Vector2::zeros());
        (part, Finger { radius: 0.01, centre0: Point2::origin(), velocity0, acceleration })
    }

    /// A clock that goes on by one each time somebody looks at it, and says stop at `limit`.
    fn looks_until(limit: usize, work: impl FnOnce(Stop<'_>)) -> usize {
        let looks = AtomicUsize::new(0);
        work(&|| looks.fetch_add(1, Relaxed) + 1 >= limit);
        looks.into_inner()
    }

    #[test]
    fn a_sort_is_the_standard_one_and_looks_at_the_clock_at_every_so_many_of_its_steps() {
        let mut draw = crate::math::random::Draw::case(3, 0);
        // The second of a pair tells equal ones apart.
        let drawn: Vec<_> = (0..20_000_u32).map(|k| ((draw.normal() * 1e3).round(), k)).collect();
        let by_first = |a: &(f64, u32), b: &(f64, u32)| a.0.total_cmp(&b.0);
        for count in [0, 1, 1023, 1024, 1025, 5000, 20_000] {
            let (mut sorted, mut wanted) = (drawn[..count].to_vec(), drawn[..count].to_vec());
            wanted.sort_by(by_first);
            let looks =
                looks_until(usize::MAX, |stop| assert!(Halt::new(stop).sort_by(&mut sorted, by_first).is_some()));
            assert_eq!(sorted, wanted);
            let rounds = if count > CHEAP { count.div_ceil(CHEAP).next_power_of_two().ilog2() as usize } else { 0 };
            // What is left of one run when the other is used up is not compared.
            assert!(looks + count / CHEAP >= count / CHEAP * (1 + rounds), "{looks} looks at {count}");
            for limit in [1, looks / 2, looks] {
                let stopped = looks_until(limit.max(1), |stop| {
                    assert_eq!(Halt::new(stop).sort_by(&mut drawn[..count].to_vec(), by_first).is_none(), count > 0);
                });
                assert!(stopped <= limit.max(1));
            }
        }
    }

    #[test]
    fn a_push_looks_at_the_clock_at_every_step_and_every_sample_and_half_of_one_is_none() {
        let (part, finger) = block_and_finger(1e-9);
        let model = PushModel { part: &part, edge: part.edge(0).unwrap(), mu_g: 3.0, finger };
        let start = Start::Moving(State { u: 1.57, s: 0.01, omega: 0.0, v_t: 0.0 });
        let push = Push::new(model, ContactLaw::Rolling { friction: None }, start, EdgeEnd::Stop).unwrap();
        // Slow motion is stiff: this would take two million steps.
        let looks = looks_until(300, |stop| assert!(push.run_until(&[1e5], stop).is_err()));
        assert_eq!(looks, 300);
        let (part, finger) = block_and_finger(0.05);
        let model = PushModel { part: &part, finger, ..model };
        let push = Push::new(model, ContactLaw::Rolling { friction: None }, start, EdgeEnd::Stop).unwrap();
        let times: Vec<_> = (0..500).map(|sample| 1e-7 * f64::from(sample)).collect();
        let looks =
            looks_until(usize::MAX, |stop| assert_eq!(push.run_until(&times, stop).unwrap().samples.len(), 500));
        assert!(looks >= 500, "{looks}");
        check_stopping_of_making(|stop| push.run_until(&times, stop).ok());
    }

    #[test]
    fn a_roll_looks_at_the_clock_at_every_step_and_half_of_one_is_none() {
        let body = RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap();
        let on = OnPalm { body: &body, spin: Spin::Free, palm: &PalmAcceleration::Rest, g: 9.81 };
        let roll = Roll::new(on, [1.0, 0.0, 0.0, 0.0], [1.0, 0.5, 0.2], [0.0; 2]).unwrap();
        assert_eq!(looks_until(300, |stop| assert!(roll.run_until(&[1e4], stop).is_err())), 300);
        check_stopping_of_making(|stop| roll.run_until(&[0.01, 0.02], stop).ok());
    }

    /// With friction under the part every look at a place is a simulation, of milliseconds.
    #[test]
    fn a_search_for_resting_poses_with_friction_looks_at_the_clock_within_its_simulations() {
        let path = FingerPath {
            centre0: Point2::origin(),
            velocity0: Vector2::zeros(),
            acceleration: Vector2::new(0.01, 2.0),
        };
        let shape = FingerShape::Ellipse { semi_axes: [0.02, 0.01] };
        let push = RestingPush::new(Object::Ellipse([0.03, 0.02]), 0.5, shape, path, 1.2).unwrap();
        let contacts = [TimedContact { t: 0.1, u: 1.25 }, TimedContact { t: 0.15, u: 1.3 }];
        let looks = looks_until(3000, |stop| assert!(!push.observe_until(&contacts, 1e-6, stop).complete));
        assert_eq!(looks, 3000);
    }

    #[test]
    fn the_thesis_observers_look_at_the_clock_at_every_step_and_broken_off_they_are_left_out() {
        let (part, finger) = block_and_finger(0.05);
        let known = Known { part: &part, mu_g: 3.0, finger, touch: Touch::Rolling { friction: None } };
        let contacts: Vec<_> = (0..4).map(|edge| (edge, ContactMode::Rolling)).collect();
        let start = State { u: 1.57, s: 0.01, omega: 0.0, v_t: 0.0 };
        let bank = GhoBank { known: &known, contacts: &contacts, start, settings: GhoSettings::new(20.0) };
        let values = (0..50).map(|value| 1.57 + 1e-3 * f64::from(value)).collect();
        let measured = Measured::ContactAngle(Channel { values, sigma: 1e-3 });
        let observation = Observation { dt: 0.01, measured, prior: Prior::default() };
        let whole = looks_until(usize::MAX, |stop| assert_eq!(bank.runs_until(&observation, stop).found.len(), 4));
        assert!(whole >= 4 * 40, "{whole}");
        looks_until(whole / 2, |stop| {
            let half = bank.runs_until(&observation, stop);
            assert!(!half.complete && half.found.len() < 4);
            let all = bank.runs(&observation);
            assert!(half.found.iter().all(|run| all.contains(run)));
        });
        check_stopping(|stop| bank.runs_until(&observation, stop));
    }

    #[test]
    fn a_plan_of_points_can_be_stopped_before_there_is_any_and_after() {
        let bar = |x: f64, y: f64, w: f64, h: f64| {
            SimplePolygon::new([[x, y], [x + w, y], [x + w, y + h], [x, y + h]].map(Point2::from)).unwrap()
        };
        let bars =
            (0..6).flat_map(|k| [bar(0.0, 2.0 * f64::from(k), 11.0, 1.0), bar(2.0 * f64::from(k), 0.0, 1.0, 11.0)]);
        let bars: Vec<_> = bars.collect();
        let scene = Scene::new(&bars);
        for objective in [Objective::Fewest, Objective::Greedy] {
            let request = Request { objective, ..Request::default() };
            let wanted = scene.plan(&request, &never);
            assert_eq!(scene.plan_until(&request, &never), Some(wanted.clone()));
            assert!(scene.plan_until(&request, &|| true).is_none());
            let whole = looks_until(usize::MAX, |stop| drop(scene.plan_until(&request, stop)));
            for limit in [2, whole / 4, whole / 2, whole - 1] {
                looks_until(limit, |stop| {
                    let plan = scene.plan_until(&request, stop);
                    // What there is of it is true.
                    assert!(plan.is_none_or(|plan| plan.lower_bound <= wanted.points.len()
                        && plan.points.len() >= wanted.lower_bound
                        && plan.indistinguishable == wanted.indistinguishable));
                });
            }
        }
    }

    #[test]
    fn a_search_for_inscriptions_can_be_stopped() {
        let block = [[0.0, 0.0], [0.06, 0.0], [0.06, 0.04], [0.0, 0.04]].map(Point2::from);
        let block = ConvexPolygon::new(&SimplePolygon::new(block).unwrap()).unwrap();
        let views = [(-0.2, 0.0, 0.001, 0.199), (0.0, -0.2, 1.279, 1.569), (0.3, 0.1, 3.341, 3.535)];
        let bearings = views.iter().flat_map(|&(x, y, right, left)| {
            Cone::new(Point2::new(x, y), right, left).unwrap().bearings().into_iter().collect::<Vec<_>>()
        });
        let readings = NoisyReadings { bearings: bearings.collect(), fences: Vec::new(), sigma: 1e-3 };
        check_stopping(|stop| estimate_until(&block, &readings, stop).unwrap());
    }

    #[test]
    fn a_search_for_resting_poses_can_be_stopped() {
        let block = SimplePolygon::new([[-0.03, -0.02], [0.03, -0.02], [0.02, 0.03]].map(Point2::from)).unwrap();
        let path = FingerPath {
            centre0: Point2::origin(),
            velocity0: Vector2::zeros(),
            acceleration: Vector2::new(0.01, 0.1),
        };
        let shape = FingerShape::Disk { radius: 0.01 };
        let push = RestingPush::new(Object::Polygon(block), 0.0, shape, path, 1.5).unwrap();
        let felt = push.predicted(Some(0), 0.005, &[0.6, 0.9]);
        let contacts = [TimedContact { t: 0.6, u: felt[0] }, TimedContact { t: 0.9, u: felt[1] }];
        check_stopping(|stop| push.observe_until(&contacts, 1e-6, stop));
    }

    #[test]
    fn a_search_for_a_rolling_body_can_be_stopped_and_is_then_not_certified() {
        let body = RollingBody::ellipsoid([0.02, 0.03, 0.04]).unwrap();
        let model = Model { body: &body, spin: Spin::NoSpin };
        let orientation = Quaternion::new(0.5, -0.5, -0.7, -0.1).normalize();
        let start = RollState { orientation, omega: Vector3::new(0.5, 0.2, 0.0), u: Vector2::new(0.001, 0.002) };
        let weight = specific_force(Vector3::zeros(), 9.81);
        let path = std::iter::successors(Some(start), |state| Some(model.step(state, &[weight; 3], 0.02)));
        let u: Vec<_> = path.take(31).map(|state| state.u).collect();
        let question = RollQuestion {
            body: BodyKnowledge::OneOf(vec![body.clone()]),
            spins: vec![Spin::NoSpin],
            palm: PalmKnowledge::Known(PalmAcceleration::Rest),
            g: 9.81,
            noise: Noise::Exact,
        };
        let stopped = question.answer_until(0.02, &u, &|| true).unwrap();
        assert!(!stopped.complete && !stopped.found.certified && stopped.found.hypotheses.is_empty());
        check_stopping(|stop| question.answer_until(0.02, &u, stop).unwrap());
    }
}
