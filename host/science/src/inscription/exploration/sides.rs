//! The straight sides on which touches lie, fitted together with the corners in which they meet.
//!
//! The centres of a disk that touches a polygon are on lines along its sides and on arcs about its corners. Lines alone are
//! turned by touches that lie a little beyond a corner, where the arc has hardly left the line; so all sides are fitted at
//! once, each touch by its distance from the outline that they make. Which sides there are is settled by evidence: one is
//! put in or left out where the squared misses fall or rise by enough.
//!
//! Frames: world. Units: m, rad; costs in squared standard deviations. Errors: none.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Point2, Vector2};

use crate::inscription::next_touch::FingerTouch;
use crate::math::angle::wrap_angle;
use crate::math::least_squares::{LeastSquaresProblem, LeastSquaresSettings, NormalEquations, minimise};

/// A touch belongs to a side or a corner within so many of its standard deviations.
pub(super) const BELONGS_SD: f64 = 3.5;

/// The normal of a side may be beyond what a force allows by so much, rad: forces beside the ends of sides.
const NORMAL_SLACK: f64 = 0.02;

/// What a side has to explain: two unknowns and a place that was looked for gain less by chance.
const EVIDENCE: f64 = 20.0;

/// What a touch costs that belongs to nothing, or not to what it should: where one is explained, a side may be for it.
const UNEXPLAINED: f64 = 60.0;

/// Two sides with a turn less than this between are not made to meet, rad: where they do is hardly known.
pub(super) const TURN_LEAST: f64 = 0.05;

/// Touches of a side that is short: what is taken for one of its neighbours' may be beyond it.
const SHORT: usize = 3;

/// Rounds of putting sides in and leaving them out.
const ROUNDS: usize = 24;

/// Times that all sides are fitted one after another, each with its neighbours where they are.
const SWEEPS: usize = 12;

/// Sweeps go on while the cost falls by more.
const SETTLED: f64 = 1e-2;

/// Rounding of a touch that is exact, m.
pub(super) const SIGMA_LEAST: f64 = 1e-9;

/// The line on which the disk's centres of a side are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    /// One of its points.
    pub(super) at: Point2<f64>,
    /// Along it, counter-clockwise around the part; of length 1.
    pub(super) along: Vector2<f64>,
    /// Out of the part.
    pub(super) normal: Vector2<f64>,
}

impl Side {
    /// Through a point, with this normal of length 1.
    fn new(at: Point2<f64>, normal: Vector2<f64>) -> Self {
        Self { at, along: Vector2::new(-normal.y, normal.x), normal }
    }

    /// Where two sides meet, moved inwards by a radius (m): parallel ones nowhere.
    pub(super) fn meets(&self, other: &Self, inwards: f64) -> Point2<f64> {
        let [from, to] = [self, other].map(|side| side.at - side.normal * inwards);
        from + self.along * ((to - from).perp(&other.along) / self.along.perp(&other.along))
    }

    /// How far out of it a centre is.
    pub(super) fn off(&self, centre: &Point2<f64>) -> f64 {
        (centre - self.at).dot(&self.normal)
    }

    /// How far along it, from `at`.
    pub(super) fn travel(&self, place: &Point2<f64>) -> f64 {
        (place - self.at).dot(&self.along)
    }
}

/// Touches that are on one side, by their places in the order: the last may be before the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) side: Side,
}

/// To what a touch belongs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Seat {
    /// A side.
    On(usize),
    /// A side, the next one, or the corner between.
    Around(usize),
    /// Nothing that is known.
    Loose,
}

/// What a disk touches.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Element {
    Side(usize),
    /// Where this side meets the next.
    Corner(usize),
}

/// What a disk touches, and out of the part there.
pub(super) type Touched = (Element, Vector2<f64>);

/// How far a centre is from where a disk touches.
struct Miss {
    /// m.
    off: f64,
    /// What is nearest.
    element: Element,
    /// Out of the part.
    normal: Vector2<f64>,
}

/// Sides in their order around the part.
#[derive(Clone, Debug)]
pub(super) struct Sides<'a> {
    radius: f64,
    touches: &'a [&'a FingerTouch],
    pub(super) runs: Vec<Run>,
    /// Whether each meets the next one.
    pub(super) meets: Vec<bool>,
    seats: Vec<Seat>,
}

impl<'a> Sides<'a> {
    /// The sides of touches in their order; `normals` are out of the part, as each touch and its neighbours tell alone.
    pub(super) fn of(touches: &'a [&'a FingerTouch], normals: &[Vector2<f64>], radius: f64) -> Self {
        let mut sides =
            Self { radius, touches, runs: Vec::new(), meets: Vec::new(), seats: vec![Seat::Loose; touches.len()] };
        sides.runs = sides.straight_runs();
        sides.join();
        sides.settle();
        sides.choose(normals);
        sides.leave_loose();
        sides
    }

    fn touch(&self, place: usize) -> &FingerTouch {
        self.touches[place % self.touches.len()]
    }

    pub(super) fn next(&self, number: usize) -> usize {
        (number + 1) % self.runs.len()
    }

    fn before(&self, number: usize) -> usize {
        (number + self.runs.len() - 1) % self.runs.len()
    }

    pub(super) fn sd(touch: &FingerTouch) -> f64 {
        touch.sigma.max(SIGMA_LEAST)
    }

    /// Places after a side's last touch and before the next side's first.
    pub(super) fn between(&self, number: usize) -> std::ops::Range<usize> {
        let (run, next) = (&self.runs[number], &self.runs[self.next(number)]);
        let end = run.first + run.count;
        let total = self.touches.len();
        // The next begins at or after the end, perhaps once around.
        end..end + (next.first + 2 * total - end) % total
    }

    /// By how much the outward normal turns from a side to the next, rad: above 0 where the outline is convex.
    pub(super) fn turn(&self, number: usize) -> f64 {
        turn(&self.runs[number].side.normal, &self.runs[self.next(number)].side.normal)
    }

    /// Where a side and the next meet.
    pub(super) fn corner(&self, number: usize) -> Point2<f64> {
        self.runs[number].side.meets(&self.runs[self.next(number)].side, self.radius)
    }

    /// The line through the centres of a run, if they are on one.
    fn line(&self, first: usize, count: usize) -> Option<Side> {
        let run = || (first..first + count).map(|place| self.touch(place));
        let weight = |touch: &FingerTouch| Self::sd(touch).powi(-2);
        let total: f64 = run().map(weight).sum();
        let at = Point2::from(run().map(|touch| touch.centre.coords * weight(touch)).sum::<Vector2<f64>>() / total);
        let ends = self.touch(first + count - 1).centre - self.touch(first).centre;
        let mut along = ends.try_normalize(f64::MIN_POSITIVE)?;
        // The ends are nearly on it, so a small turn is all that is left.
        for _ in 0..2 {
            let across = Vector2::new(along.y, -along.x);
            let (mut squares, mut product) = (0.0, 0.0);
            for touch in run() {
                let off = touch.centre - at;
                squares += weight(touch) * off.dot(&along).powi(2);
                product += weight(touch) * off.dot(&along) * off.dot(&across);
            }
            along = (along + across * (product / squares)).normalize();
        }
        let side = Side::new(at, Vector2::new(along.y, -along.x));
        let fits = |touch: &FingerTouch| {
            side.off(&touch.centre).abs() <= BELONGS_SD * Self::sd(touch)
                && beyond_cone(touch, &side.normal) <= NORMAL_SLACK
        };
        // In their order along it.
        let goes_on = (first..first + count - 1)
            .all(|place| (self.touch(place + 1).centre - self.touch(place).centre).dot(&along) >= 0.0);
        (goes_on && run().all(fits)).then_some(side)
    }

    /// Runs of three touches and more on a line, the longest first; no touch is in two.
    fn straight_runs(&self) -> Vec<Run> {
        const COUNT_LEAST: usize = 3;
        let total = self.touches.len();
        let mut is_taken = vec![false; total];
        let mut runs: Vec<Run> = Vec::new();
        loop {
            let mut longest: Option<(f64, Run)> = None;
            for first in 0..total {
                let mut best = None;
                for count in COUNT_LEAST..=total {
                    if (first..first + count).any(|place| is_taken[place % total]) {
                        break;
                    }
                    let Some(side) = self.line(first, count) else { break };
                    best = Some(Run { first, count, side });
                }
                let Some(run) = best else { continue };
                let length = (self.touch(run.first + run.count - 1).centre - self.touch(run.first).centre).norm();
                if longest.is_none_or(|(most, _)| length > most) {
                    longest = Some((length, run));
                }
            }
            let Some((_, run)) = longest else { break };
            (run.first..run.first + run.count).for_each(|place| is_taken[place % total] = true);
            runs.push(run);
        }
        runs.sort_by_key(|run| run.first);
        runs
    }

    /// Makes sides meet that can, and seats all touches.
    fn join(&mut self) {
        let can = |turn: f64| (TURN_LEAST..PI - TURN_LEAST).contains(&turn.abs());
        self.meets = (0..self.runs.len()).map(|number| self.runs.len() > 1 && can(self.turn(number))).collect();
        self.seat();
    }

    fn seat(&mut self) {
        let total = self.touches.len();
        self.seats = vec![Seat::Loose; total];
        for (number, run) in self.runs.iter().enumerate() {
            let before = self.before(number);
            for j in 0..run.count {
                // Only touches at a side's ends may be beyond them.
                let around = if 2 * j < run.count { before } else { number };
                let seat = if self.meets[around] { Seat::Around(around) } else { Seat::On(number) };
                self.seats[(run.first + j) % total] = seat;
            }
            if self.meets[number] {
                self.between(number).for_each(|place| self.seats[place % total] = Seat::Around(number));
            }
        }
    }

    /// How far a touch is from what it belongs to.
    fn miss(&self, place: usize, side: &dyn Fn(usize) -> Side) -> Option<Miss> {
        let centre = &self.touch(place).centre;
        match self.seats[place] {
            Seat::Loose => None,
            Seat::On(number) => {
                let side = side(number);
                Some(Miss { off: side.off(centre), element: Element::Side(number), normal: side.normal })
            }
            Seat::Around(number) => {
                let misses = self.near(number).map(|number| self.miss_of(number, centre, side));
                misses.min_by(|a, b| (a.off + self.radius).abs().total_cmp(&(b.off + self.radius).abs()))
            }
        }
    }

    /// Sides on which touches around a corner may be: those that meet there, and where these are short what is beyond.
    fn near(&self, number: usize) -> impl Iterator<Item = usize> + '_ {
        let (before, next) = (self.before(number), self.next(number));
        let beyond = |side: usize, corner: usize| self.meets[corner] && self.runs[side].count <= SHORT;
        let ends =
            [(before, beyond(number, before)), (number, true), (next, true), (self.next(next), beyond(next, next))];
        ends.into_iter().filter(|(_, is_near)| *is_near).map(|(number, _)| number)
    }

    /// Touches that a side may concern.
    fn places(&self, number: usize) -> Vec<usize> {
        let concerns = |place: &usize| match self.seats[*place] {
            Seat::On(own) => own == number,
            Seat::Around(corner) => self.near(corner).any(|near| self.is_beside(near, number)),
            Seat::Loose => false,
        };
        (0..self.touches.len()).filter(concerns).collect()
    }

    /// Whether a side ends where another does.
    fn is_beside(&self, number: usize, other: usize) -> bool {
        number == other || self.before(number) == other || self.next(number) == other
    }

    /// How far a centre is from one side, which ends where it meets others.
    fn miss_of(&self, number: usize, centre: &Point2<f64>, side: &dyn Fn(usize) -> Side) -> Miss {
        let own = side(number);
        let before = self.before(number);
        let travel = own.travel(centre);
        let at = |corner: usize| self.meets[corner].then(|| side(corner).meets(&side(self.next(corner)), self.radius));
        let [from, to] = [at(before), at(number)];
        let beyond = |corner: &Point2<f64>, first: usize| {
            let way = centre - corner;
            let normal = way.try_normalize(f64::MIN_POSITIVE).unwrap_or(own.normal);
            Miss { off: way.norm() - self.radius, element: Element::Corner(first), normal }
        };
        match (from, to) {
            (Some(from), _) if travel < own.travel(&from) => beyond(&from, before),
            (_, Some(to)) if travel > own.travel(&to) => beyond(&to, number),
            _ => Miss { off: own.off(centre), element: Element::Side(number), normal: own.normal },
        }
    }

    /// What a touch touches, and out of the part there.
    pub(super) fn touched(&self, place: usize) -> Option<Touched> {
        let miss = self.miss(place, &|number| self.runs[number].side)?;
        Some((miss.element, miss.normal))
    }

    /// Squared misses of a touch, and of its force beyond what friction allows.
    fn cost_of(&self, place: usize) -> f64 {
        let touch = self.touch(place);
        let missed = self.miss(place, &|number| self.runs[number].side);
        missed.map_or(UNEXPLAINED, |miss| {
            let beyond = beyond_cone(touch, &miss.normal).max(0.0);
            (miss.off / Self::sd(touch)).powi(2) + (BELONGS_SD * beyond / NORMAL_SLACK).powi(2)
        })
    }

    fn cost(&self) -> f64 {
        (0..self.touches.len()).map(|place| self.cost_of(place).min(UNEXPLAINED)).sum()
    }

    /// Fits all sides to their touches.
    fn settle(&mut self) {
        self.settle_some(&(0..self.runs.len()).collect::<Vec<_>>());
    }

    /// Fits a side and those beside it, two on either hand.
    fn settle_around(&mut self, number: usize) {
        let count = self.runs.len();
        let mut some: Vec<_> = (count - 2.min(count)..=count + 2).map(|off| (number + off) % count).collect();
        some.sort_unstable();
        some.dedup();
        self.settle_some(&some);
    }

    fn settle_some(&mut self, numbers: &[usize]) {
        let mut cost = self.cost();
        let places: Vec<_> = numbers.iter().map(|&number| self.places(number)).collect();
        for _ in 0..SWEEPS {
            for (&number, places) in numbers.iter().zip(&places) {
                let one = OneSide { sides: self, number, places };
                let settings = LeastSquaresSettings { steps_max: 3, ..LeastSquaresSettings::default() };
                self.runs[number].side = minimise(&one, self.runs[number].side, &settings, |_| false).place;
            }
            let before = std::mem::replace(&mut cost, self.cost());
            if before - cost <= SETTLED {
                break;
            }
        }
    }

    /// Puts sides in and leaves them out as long as that is worth it.
    fn choose(&mut self, normals: &[Vector2<f64>]) {
        for _ in 0..ROUNDS {
            let cost = self.cost();
            let lowest = |candidates: Vec<Self>| {
                let costs = candidates.into_iter().map(|candidate| (candidate.cost(), candidate));
                costs.min_by(|a, b| a.0.total_cmp(&b.0))
            };
            let without = (0..self.runs.len()).filter_map(|number| self.without(number)).collect();
            if let Some((_, fewer)) = lowest(without).filter(|(without, _)| *without <= cost + EVIDENCE) {
                *self = fewer;
                continue;
            }
            let with = (0..self.runs.len()).flat_map(|number| self.with(number, normals)).collect();
            match lowest(with).filter(|(with, _)| *with < cost - EVIDENCE) {
                Some((_, more)) => *self = more,
                None => break,
            }
        }
    }

    fn without(&self, number: usize) -> Option<Self> {
        const RUNS_LEAST: usize = 3;
        // What explains more touches than this is there.
        const COUNT_MOST: usize = 5;
        if self.runs.len() <= RUNS_LEAST || self.runs[number].count > COUNT_MOST {
            return None;
        }
        let mut fewer = self.clone();
        fewer.runs.remove(number);
        fewer.join();
        fewer.settle_around(number % fewer.runs.len());
        Some(fewer)
    }

    /// With a side between this one and the next, where a touch is farthest from what it should belong to.
    fn with(&self, number: usize, normals: &[Vector2<f64>]) -> Vec<Self> {
        let total = self.touches.len();
        let run = &self.runs[number];
        let next = &self.runs[self.next(number)];
        let between = self.between(number);
        // The sides' own ends too, if they have others.
        let begin = between.start - usize::from(run.count > 2);
        let end = between.end + usize::from(next.count > 2);
        let worst = (begin..end).max_by(|&a, &b| self.cost_of(a % total).total_cmp(&self.cost_of(b % total)));
        let Some(worst) = worst.filter(|worst| self.cost_of(worst % total) >= BELONGS_SD * BELONGS_SD) else {
            return Vec::new();
        };
        let centre = self.touch(worst).centre;
        let through = |from: usize, to: usize| {
            let along = (self.touch(to).centre - self.touch(from).centre).try_normalize(f64::MIN_POSITIVE)?;
            Some(Vector2::new(along.y, -along.x))
        };
        let ways = [Some(normals[worst % total]), through(worst, worst + 1), through(worst + total - 1, worst)];
        let with = |normal: Vector2<f64>| {
            let mut more = self.clone();
            if worst < between.start {
                more.runs[number].count -= 1;
            } else if worst >= between.end {
                let next = self.next(number);
                more.runs[next].first = (more.runs[next].first + 1) % total;
                more.runs[next].count -= 1;
            }
            more.runs.insert(number + 1, Run { first: worst % total, count: 1, side: Side::new(centre, normal) });
            more.join();
            more.settle_around(number + 1);
            more
        };
        ways.into_iter().flatten().map(with).collect()
    }

    /// Corners that touches contradict are none.
    fn leave_loose(&mut self) {
        let is_bad = |sides: &Self, number: usize| {
            let mut places = (0..sides.touches.len()).filter(|&place| sides.seats[place] == Seat::Around(number));
            sides.meets[number] && places.any(|place| sides.cost_of(place) > UNEXPLAINED)
        };
        while let Some(number) = (0..self.runs.len()).find(|&number| is_bad(self, number)) {
            self.meets[number] = false;
            self.seat();
            self.settle();
        }
    }

    /// Covariance of a side's offset (m) and turn (rad), neighbours where they are.
    fn covariance(&self, number: usize) -> Option<Matrix2<f64>> {
        let one = OneSide { sides: self, number, places: &self.places(number) };
        one.normal_equations(&self.runs[number].side).curvature.try_inverse()
    }

    /// Mean variance of a side over a stretch of it, m²: of its offset, which its turn changes along it.
    pub(super) fn variance(&self, number: usize, [from, to]: [f64; 2]) -> f64 {
        let Some(covariance) = self.covariance(number) else { return self.radius * self.radius };
        let (mean, square) = (0.5 * (from + to), (from * from + from * to + to * to) / 3.0);
        let variance = covariance[(0, 0)] - 2.0 * mean * covariance[(0, 1)] + square * covariance[(1, 1)];
        variance.max(0.0)
    }
}

/// One side, with all others where they are.
struct OneSide<'s, 'a> {
    sides: &'s Sides<'a>,
    number: usize,
    /// Touches that it may concern.
    places: &'s [usize],
}

impl OneSide<'_, '_> {
    fn side<'f>(&'f self, moved: &'f Side) -> impl Fn(usize) -> Side + 'f {
        move |number| if number == self.number { *moved } else { self.sides.runs[number].side }
    }
}

impl LeastSquaresProblem<2> for OneSide<'_, '_> {
    type Place = Side;

    fn cost(&self, place: &Side) -> f64 {
        let side = self.side(place);
        let square = |place: usize| {
            let miss = self.sides.miss(place, &side)?;
            Some((miss.off / Sides::sd(self.sides.touch(place))).powi(2))
        };
        self.places.iter().copied().filter_map(square).sum()
    }

    /// By how far the side goes out (m) and turns counter-clockwise about its point (rad).
    fn normal_equations(&self, moved: &Side) -> NormalEquations<2> {
        let side = self.side(moved);
        let mut equations = NormalEquations::zero();
        for &place in self.places {
            let Some(Miss { off, element, normal }) = self.sides.miss(place, &side) else { continue };
            let touch = self.sides.touch(place);
            let weight = 1.0 / Sides::sd(touch);
            // At a point so far along it, its line goes out by 1 and by -travel.
            let slopes = |gain: f64, travel: f64| Vector2::new(1.0, -travel) * gain;
            let slopes = match element {
                Element::Side(number) if number == self.number => slopes(-1.0, moved.travel(&touch.centre)),
                Element::Corner(first) if first == self.number || self.sides.next(first) == self.number => {
                    let other = if first == self.number { self.sides.next(first) } else { first };
                    let other = side(other);
                    let corner = moved.meets(&other, self.sides.radius);
                    // The corner goes along the other side.
                    let goes = other.along / moved.normal.dot(&other.along);
                    slopes(-normal.dot(&goes), moved.travel(&corner))
                }
                _ => Vector2::zeros(),
            };
            equations.add(weight * off, slopes * weight);
        }
        equations
    }

    fn moved(&self, place: &Side, step: &Vector2<f64>) -> Option<Side> {
        let turned = nalgebra::Rotation2::new(step[1]) * place.normal;
        Some(Side::new(place.at + place.normal * step[0], turned))
    }
}

/// By how much a normal is beyond what a force allows, rad; below 0 where it is within.
fn beyond_cone(touch: &FingerTouch, normal: &Vector2<f64>) -> f64 {
    wrap_angle(touch.force_angle - normal.y.atan2(normal.x)).abs() - touch.half_width
}

/// By how much an outward normal turns, rad: above 0 where the outline is convex.
pub(super) fn turn(from: &Vector2<f64>, to: &Vector2<f64>) -> f64 {
    from.perp(to).atan2(from.dot(to))
}
