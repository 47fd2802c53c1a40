//! Supporting lines of a part that is carried past light barriers and turning beams.
//!
//! A barrier switches when the part begins to cover its beam and when the part leaves it: at both moments the beam is a
//! line that the part's hull touches, first with its front, then with its rear. A beam that turns about a point, such as
//! that of a scanner beside a belt, is covered while it sweeps over the part: its angles then are the sides of a cone.
//! What was read at different times is moved to one by the known velocity of what carries the part.
//!
//! [`Passages`] makes the covered stretches of one part from switches that change, with contacts that bounce.
//!
//! Source: thesis §2.5 (cones of a sensor beside a moving belt). Assumes: one known velocity, no turn; barriers whose beams
//! are longer than the part is wide. Pure. Frame: world. Units: m, s, rad. Errors: none; a beam along the part's way tells
//! nothing.

use std::collections::VecDeque;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

use nalgebra::{Point2, Vector2};

use super::readings::{Bearing, HalfPlane, Side};
use super::touches::{Fence, TouchReadings};
use crate::geometry::SimplePolygon;
use crate::math::angle::wrap_angle;
use crate::math::random::Draw;

/// A beam within this of the part's way tells nothing of when it is covered, rad.
const ALONG_RAD: f64 = 1e-3;

/// A light barrier with a straight beam.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Barrier {
    /// A point of the beam.
    pub at: Point2<f64>,
    /// Its polar angle, either way.
    pub direction: f64,
    /// Standard deviation of where the beam is, across it, m.
    pub sigma: f64,
    /// Standard deviation of when it switches, s.
    pub time_sigma: f64,
}

/// A beam that turns about a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TurningBeam {
    /// The point.
    pub apex: Point2<f64>,
    /// Polar angle of the beam at the time 0.
    pub phase: f64,
    /// Of its turn, counter-clockwise, rad/s; much faster than the part goes by.
    pub rate: f64,
}

/// What a part covers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Beam {
    /// One that stays.
    Barrier(Barrier),
    /// One that turns.
    Turning(TurningBeam),
}

/// A stretch of time in which a part covered a beam, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Covered {
    /// Its beginning.
    pub from: f64,
    /// Its end.
    pub to: f64,
}

impl Barrier {
    /// The beam as the line that the part's front touches first; none where the part goes along it.
    #[must_use]
    pub fn front(&self, velocity: Vector2<f64>) -> Option<HalfPlane> {
        let line = self.line(self.direction + FRAC_PI_2);
        let across = line.normal.dot(&velocity);
        let ahead = if across > 0.0 { line } else { self.line(line.angle + PI) };
        (across.abs() > ALONG_RAD * velocity.norm()).then_some(ahead)
    }

    /// The beam with a normal to one side of it.
    fn line(&self, normal_angle: f64) -> HalfPlane {
        HalfPlane { point: self.at, ..HalfPlane::new(normal_angle, 0.0) }
    }

    /// The lines that the part's front and rear touch, moved to where it is at a time; none where it goes along the beam.
    #[must_use]
    pub fn fences(&self, covered: &Covered, velocity: Vector2<f64>, time: f64) -> Option<[Fence; 2]> {
        let front = self.front(velocity)?;
        let sigma = self.sigma.hypot(front.normal.dot(&velocity) * self.time_sigma);
        let fence = |line: HalfPlane, at: f64| {
            let line = HalfPlane { point: line.point + velocity * (time - at), ..line };
            Fence { line, sigma: Some(sigma) }
        };
        Some([fence(front, covered.from), fence(self.line(front.angle + PI), covered.to)])
    }

    /// When a part covers the beam that at the time 0 is as given; none where it goes along it.
    #[must_use]
    pub fn covered_by(&self, part: &SimplePolygon, velocity: Vector2<f64>) -> Option<Covered> {
        let front = self.front(velocity)?;
        let times = || part.vertices().iter().map(|corner| -front.beyond(*corner) / front.normal.dot(&velocity));
        Some(Covered { from: times().fold(f64::INFINITY, f64::min), to: times().fold(f64::NEG_INFINITY, f64::max) })
    }
}

impl TurningBeam {
    /// The sides of a part in the order in which the beam meets them.
    fn sides(&self) -> [Side; 2] {
        if self.rate > 0.0 { [Side::Right, Side::Left] } else { [Side::Left, Side::Right] }
    }

    /// The part's sides as the beam met them, moved to where it is at a time.
    #[must_use]
    pub fn bearings(&self, covered: &Covered, velocity: Vector2<f64>, time: f64) -> [Bearing; 2] {
        let [first, last] = self.sides();
        [(covered.from, first), (covered.to, last)].map(|(at, side)| Bearing {
            apex: self.apex + velocity * (time - at),
            angle: wrap_angle(self.phase + self.rate * at),
            side,
        })
    }

    /// Each stretch of time in which the beam sweeps over a part that at the time 0 is as given, from one time to another.
    #[must_use]
    pub fn covered_by(&self, part: &SimplePolygon, velocity: Vector2<f64>, from: f64, to: f64) -> Vec<Covered> {
        let turn = TAU / self.rate.abs();
        let mut found = Vec::new();
        let mut near = from;
        while near < to {
            let met = self.sides().map(|side| self.met(part, velocity, side, near));
            if let [Some(from), Some(to)] = met
                && from < to
            {
                found.push(Covered { from, to });
            }
            near += turn;
        }
        found
    }

    /// When within half a turn of a time the beam meets a side of the part.
    fn met(&self, part: &SimplePolygon, velocity: Vector2<f64>, side: Side, near: f64) -> Option<f64> {
        let mut time = near;
        // The part hardly moves while the beam turns: each round is nearer by that share.
        for _ in 0..MEETING_ROUNDS {
            let middle = part.vertices()[0] + velocity * near - self.apex;
            let middle = middle.y.atan2(middle.x);
            let off = part.vertices().iter().map(|corner| {
                let seen = corner + velocity * time - self.apex;
                wrap_angle(seen.y.atan2(seen.x) - middle)
            });
            let off = match side {
                Side::Right => off.fold(f64::INFINITY, f64::min),
                Side::Left => off.fold(f64::NEG_INFINITY, f64::max),
            };
            // Both sides of one sweep are counted from its middle.
            let turns = ((self.phase + self.rate * near - middle) / TAU).round();
            let next = (middle + off + turns * TAU - self.phase) / self.rate;
            if (next - time).abs() < 1e-12 * (1.0 + time.abs()) {
                return Some(next);
            }
            time = next;
        }
        None
    }
}

/// Rounds in which a meeting of beam and part is found.
const MEETING_ROUNDS: usize = 60;

/// A beam that a part begins to cover, or leaves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamChange {
    /// When, s.
    pub time: f64,
    /// Which, by its place in the list.
    pub beam: usize,
    /// Whether it is covered from now on.
    pub is_covered: bool,
}

impl Beam {
    /// Standard deviation of when it switches as a part goes by, s; `bearing_sigma` in rad.
    fn time_sd(&self, velocity: Vector2<f64>, bearing_sigma: f64) -> f64 {
        match self {
            Self::Barrier(barrier) => {
                let across = barrier.front(velocity).map_or(f64::INFINITY, |front| front.normal.dot(&velocity));
                (barrier.sigma / across).hypot(barrier.time_sigma)
            }
            Self::Turning(beam) => bearing_sigma / beam.rate.abs(),
        }
    }
}

/// What a part that at the time 0 is as given, and goes by, changes, in order of time; turning beams while it is among the
/// barriers.
#[must_use]
pub fn changes(beams: &[Beam], part: &SimplePolygon, velocity: Vector2<f64>) -> Vec<BeamChange> {
    let barriers = beams.iter().filter_map(|beam| match beam {
        Beam::Barrier(barrier) => barrier.covered_by(part, velocity),
        Beam::Turning(_) => None,
    });
    let barriers: Vec<_> = barriers.collect();
    let from = barriers.iter().map(|covered| covered.from).fold(f64::INFINITY, f64::min);
    let to = barriers.iter().map(|covered| covered.to).fold(f64::NEG_INFINITY, f64::max);
    let covered = |beam: &Beam| match beam {
        Beam::Barrier(barrier) => barrier.covered_by(part, velocity).into_iter().collect(),
        Beam::Turning(beam) => beam.covered_by(part, velocity, from, to),
    };
    let both = |(place, beam): (usize, &Beam)| {
        let change = move |(time, is_covered)| BeamChange { time, beam: place, is_covered };
        covered(beam).into_iter().flat_map(move |it| [(it.from, true), (it.to, false)].map(change)).collect::<Vec<_>>()
    };
    let mut changes: Vec<_> = beams.iter().enumerate().flat_map(both).collect();
    changes.sort_by(|a, b| a.time.total_cmp(&b.time));
    changes
}

/// The same with noise, in order of time again.
#[must_use]
pub fn noisy(
    mut changes: Vec<BeamChange>,
    beams: &[Beam],
    velocity: Vector2<f64>,
    bearing_sigma: f64,
    draw: &mut Draw,
) -> Vec<BeamChange> {
    for change in &mut changes {
        change.time += beams[change.beam].time_sd(velocity, bearing_sigma) * draw.normal();
    }
    changes.sort_by(|a, b| a.time.total_cmp(&b.time));
    changes
}

/// A part that has gone by.
#[derive(Clone, Debug, PartialEq)]
pub struct Passage {
    /// Which beams it covered, by their places in the list, and when.
    pub covered: Vec<(usize, Covered)>,
    /// When the last barrier was free again, s.
    pub end: f64,
    /// Whether turning beams are left out, since another part was among the barriers.
    pub is_crowded: bool,
}

impl Passage {
    /// What it tells of the part where it was at the end; beams along the part's way tell nothing. `bearing_sigma` in rad.
    #[must_use]
    pub fn readings(&self, beams: &[Beam], velocity: Vector2<f64>, bearing_sigma: f64) -> TouchReadings {
        let mut readings = TouchReadings { bearing_sigma, ..TouchReadings::default() };
        for (place, beam) in beams.iter().enumerate() {
            let covered: Vec<_> =
                self.covered.iter().filter(|(of, _)| *of == place).map(|(_, covered)| covered).collect();
            match beam {
                Beam::Barrier(barrier) => readings
                    .fences
                    .extend(covered.iter().filter_map(|covered| barrier.fences(covered, velocity, self.end)).flatten()),
                Beam::Turning(beam) => readings
                    .bearings
                    .extend(evenly(&covered, CONES_MAX).flat_map(|covered| beam.bearings(covered, velocity, self.end))),
            }
        }
        readings
    }
}

/// At most so many of a list, the first and the last among them.
fn evenly<'a, T>(all: &'a [&'a T], most: usize) -> impl Iterator<Item = &'a T> {
    let count = all.len().min(most);
    (0..count).map(move |place| all[if count > 1 { place * (all.len() - 1) / (count - 1) } else { 0 }])
}

/// Makes passages from beams that change.
#[derive(Clone, Debug)]
pub struct Passages {
    /// Places of the barriers in the list.
    barriers: Vec<usize>,
    debounce: f64,
    beams: Vec<Watched>,
}

/// One beam that is watched.
#[derive(Clone, Debug, Default)]
struct Watched {
    since: Option<f64>,
    /// When it seemed free again.
    freed: Option<f64>,
    done: VecDeque<Covered>,
}

/// Cones of one turning beam that are used of one part, evenly among all: the search for all poses takes a time that goes with
/// the lines, seconds of a few dozen, and the first and the last cone tell most.
const CONES_MAX: usize = 3;

/// A barrier that waits while another has seen so many parts is told of.
const BEHIND: usize = 3;

impl Passages {
    /// Of these beams; one that is free for less than so long, s, bounces.
    #[must_use]
    pub fn new(beams: &[Beam], debounce: f64) -> Self {
        let barriers = (0..beams.len()).filter(|place| matches!(beams[*place], Beam::Barrier(_))).collect();
        Self { barriers, debounce, beams: vec![Watched::default(); beams.len()] }
    }

    /// A beam is covered, or free, from a time on. Times do not go back.
    pub fn change(&mut self, beam: usize, time: f64, is_covered: bool) {
        self.until(time);
        let watched = &mut self.beams[beam];
        match (watched.since, is_covered) {
            (None, true) => watched.since = Some(time),
            // It was free for a moment only.
            (Some(_), true) => watched.freed = None,
            (Some(_), false) => watched.freed = watched.freed.or(Some(time)),
            (None, false) => {}
        }
    }

    /// Nothing has changed until this time, s.
    pub fn until(&mut self, time: f64) {
        let debounce = self.debounce;
        self.settle(|freed| time - freed >= debounce);
    }

    /// Nothing more comes.
    pub fn end(&mut self) {
        self.settle(|_| true);
    }

    fn settle(&mut self, is_free: impl Fn(f64) -> bool) {
        for watched in &mut self.beams {
            if let (Some(from), Some(to)) = (watched.since, watched.freed)
                && is_free(to)
            {
                watched.done.push_back(Covered { from, to });
                (watched.since, watched.freed) = (None, None);
            }
        }
    }

    /// The next part that every barrier has seen.
    pub fn next_passage(&mut self) -> Option<Passage> {
        let front = |&place: &usize| Some((place, *self.beams[place].done.front()?));
        let fronts: Vec<_> = self.barriers.iter().map(front).collect::<Option<_>>()?;
        let from = fronts.iter().map(|(_, covered)| covered.from).min_by(f64::total_cmp)?;
        let end = fronts.iter().map(|(_, covered)| covered.to).max_by(f64::total_cmp)?;
        for (place, _) in &fronts {
            self.beams[*place].done.pop_front();
        }
        let begins = |place: &usize| {
            let watched = &self.beams[*place];
            watched.done.front().map(|covered| covered.from).or(watched.since)
        };
        let is_next = self.barriers.iter().filter_map(begins).any(|from| from < end);
        let mut covered = fronts;
        let mut is_crowded = false;
        for (place, watched) in self.beams.iter_mut().enumerate().filter(|(place, _)| !self.barriers.contains(place)) {
            while watched.done.front().is_some_and(|front| front.to <= end) {
                let Some(front) = watched.done.pop_front() else { break };
                // What came before is of no part among the barriers.
                if front.from >= from && !is_next {
                    covered.push((place, front));
                }
                is_crowded |= front.from >= from && is_next;
            }
        }
        Some(Passage { covered, end, is_crowded })
    }

    /// A barrier that has seen no part while another saw several: its place in the list.
    #[must_use]
    pub fn behind(&self) -> Option<usize> {
        let seen = |place: &usize| self.beams[*place].done.len();
        let most = self.barriers.iter().map(seen).max()?;
        self.barriers.iter().copied().find(|place| seen(place) == 0 && most >= BEHIND)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry2;
    use proptest::prelude::*;

    use super::super::touched_poses;
    use super::*;

    const SPEED: Vector2<f64> = Vector2::new(0.12, 0.02);

    fn beams() -> Vec<Beam> {
        let barrier = |at: [f64; 2], direction: f64| {
            Beam::Barrier(Barrier { at: at.into(), direction, sigma: 5e-5, time_sigma: 2e-4 })
        };
        let scanner = |apex: [f64; 2], rate: f64| Beam::Turning(TurningBeam { apex: apex.into(), phase: 0.4, rate });
        vec![
            barrier([0.0, 0.0], 1.5),
            barrier([0.05, 0.0], 0.7),
            scanner([0.02, -0.25], 120.0),
            scanner([0.05, 0.3], -90.0),
        ]
    }

    fn part() -> SimplePolygon {
        let corners = [[0.0, 0.0], [0.06, 0.0], [0.05, 0.02], [0.02, 0.02], [0.01, 0.045]];
        SimplePolygon::new(corners.map(Point2::from)).unwrap()
    }

    fn moved(part: &SimplePolygon, by: Isometry2<f64>) -> SimplePolygon {
        SimplePolygon::new(part.vertices().iter().map(|corner| by * corner).collect::<Vec<_>>()).unwrap()
    }

    proptest! {
        /// At each moment at which a beam switches, found by looking, the line is one that the part touches.
        #[test]
        fn lines_touch_the_part_where_it_is_at_the_end(x in -0.3..-0.1, y in -0.03..0.03, turn in 0.0..TAU) {
            let (beams, placed) = (beams(), moved(&part(), Isometry2::new([x, y].into(), turn)));
            let mut passages = Passages::new(&beams, 1e-4);
            for BeamChange { time, beam, is_covered } in changes(&beams, &placed, SPEED) {
                passages.change(beam, time, is_covered);
            }
            passages.end();
            let passage = passages.next_passage().unwrap();
            let there = moved(&placed, Isometry2::translation(SPEED.x * passage.end, SPEED.y * passage.end));
            let readings = passage.readings(&beams, SPEED, 1e-4);
            prop_assert_eq!(readings.fences.len(), 4);
            prop_assert_eq!(readings.bearings.len(), 4 * CONES_MAX);
            let lines = readings.fences.iter().map(|fence| fence.line);
            for line in lines.chain(readings.bearings.iter().map(Bearing::half_plane)) {
                let outermost = there.vertices().iter().map(|corner| line.beyond(*corner)).fold(f64::NEG_INFINITY, f64::max);
                prop_assert!(outermost.abs() < 1e-9, "{line:?}: {outermost}");
            }
            prop_assert!(passages.next_passage().is_none());
        }
    }

    /// What is stated of the pose holds: normalised squares of drawn passages have their mean, the number of unknowns.
    #[test]
    fn poses_of_drawn_passages_are_as_uncertain_as_stated() {
        let upright = Barrier { at: Point2::new(0.08, 0.0), direction: 2.4, sigma: 5e-5, time_sigma: 2e-4 };
        let beams = [&beams()[..2], &[Beam::Barrier(upright)]].concat();
        let (mut sum, cases) = (0.0, 60);
        for case in 0..cases {
            let mut draw = Draw::case(81, case);
            let start =
                Isometry2::new([draw.uniform(-0.3, -0.15), draw.uniform(-0.02, 0.02)].into(), draw.uniform(0.0, TAU));
            let mut passages = Passages::new(&beams, 1e-4);
            for BeamChange { time, beam, is_covered } in
                noisy(changes(&beams, &moved(&part(), start), SPEED), &beams, SPEED, 2e-4, &mut draw)
            {
                passages.change(beam, time, is_covered);
            }
            passages.end();
            let passage = passages.next_passage().unwrap();
            let found = touched_poses(&part(), &passage.readings(&beams, SPEED, 2e-4));
            let truth = Isometry2::translation(SPEED.x * passage.end, SPEED.y * passage.end) * start;
            let squared = found.modes.iter().map(|mode| {
                let off = nalgebra::Vector3::new(
                    mode.pose.x - truth.translation.x,
                    mode.pose.y - truth.translation.y,
                    wrap_angle(mode.pose.theta - truth.rotation.angle()),
                );
                (off.transpose() * mode.covariance.try_inverse().unwrap() * off)[0]
            });
            sum += squared.fold(30.0, f64::min);
        }
        let mean = sum / cases as f64;
        // 3 ± 3.3 of √(2·3/60).
        assert!((2.0..4.1).contains(&mean), "{mean}");
    }

    #[test]
    fn parts_in_a_row_bounces_and_a_dead_barrier_are_told_apart() {
        let barriers = &beams()[..2];
        let mut passages = Passages::new(barriers, 5e-3);
        // Two parts in a row; the first barrier bounces at both ends.
        let lines = [
            (0.100, 0, true),
            (0.101, 0, false),
            (0.102, 0, true),
            (0.400, 0, false),
            (0.401, 0, true),
            (0.402, 0, false),
            (0.500, 1, true),
            (0.600, 0, true),
            (0.800, 1, false),
            (0.900, 0, false),
            (1.000, 1, true),
            (1.300, 1, false),
        ];
        let mut seen = Vec::new();
        for (time, beam, is_covered) in lines {
            passages.change(beam, time, is_covered);
            seen.extend(passages.next_passage());
        }
        passages.end();
        seen.extend(passages.next_passage());
        let times: Vec<_> = seen
            .iter()
            .map(|passage| passage.covered.iter().map(|(_, it)| (it.from, it.to)).collect::<Vec<_>>())
            .collect();
        assert_eq!(times, [[(0.1, 0.402), (0.5, 0.8)], [(0.6, 0.9), (1.0, 1.3)]]);
        assert_eq!(passages.behind(), None);
        for part in 0..BEHIND {
            let t = 2.0 + part as f64;
            passages.change(0, t, true);
            passages.change(0, t + 0.3, false);
        }
        passages.end();
        assert_eq!(passages.behind(), Some(1));
    }

    /// A beam along the part's way is never covered in a way that tells.
    #[test]
    fn a_beam_along_the_way_tells_nothing() {
        let along = Barrier { at: Point2::origin(), direction: SPEED.y.atan2(SPEED.x), sigma: 1e-4, time_sigma: 1e-3 };
        assert!(along.covered_by(&part(), SPEED).is_none());
        assert!(along.fences(&Covered { from: 0.0, to: 1.0 }, SPEED, 1.0).is_none());
    }
}
