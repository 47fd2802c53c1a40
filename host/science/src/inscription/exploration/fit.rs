//! Touches in the order around a part, fitted by sides and corners.
//!
//! Frames: world. Units: m, rad. Errors: none.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Point2, Vector2};

use super::{Exploration, ExploredOutline};
use crate::geometry::{PolygonError, SimplePolygon};
use crate::inscription::next_touch::FingerTouch;
use crate::math::angle::wrap_angle;

/// A touch belongs to a side or a corner within so many of its standard deviations.
const BELONGS_SD: f64 = 3.5;

/// The normal of a side may be beyond what a force allows by so much, rad: forces beside the ends of sides.
const NORMAL_SLACK: f64 = 0.02;

/// A run is a side where about a corner its touches would be off by so many standard deviations more.
const STRAIGHT_SD: f64 = 5.0;

/// Steps to the corner that a run is about: two are enough for what is short beside the radius.
const ARC_STEPS: usize = 4;

/// Two sides with a turn less than this between are not made to meet, rad: where they do is hardly known.
const TURN_LEAST: f64 = 0.05;

/// Touches taken from each end of a side at most.
const TRIMS: usize = 4;

/// Rounding of a touch that is exact, m.
const SIGMA_LEAST: f64 = 1e-9;

/// The line on which the disk's centres of a side are.
#[derive(Clone, Copy, Debug)]
pub(super) struct Side {
    /// Their mean.
    pub(super) at: Point2<f64>,
    /// Along it, counter-clockwise around the part.
    pub(super) along: Vector2<f64>,
    /// Out of the part.
    pub(super) normal: Vector2<f64>,
    /// Of the line's offset at `at`, m.
    sd: f64,
    /// Of its turn, rad.
    turn_sd: f64,
}

impl Side {
    /// Where two sides meet, moved inwards by a radius (m): parallel ones nowhere.
    fn meets(&self, other: &Self, inwards: f64) -> Point2<f64> {
        let [from, to] = [self, other].map(|side| side.at - side.normal * inwards);
        from + self.along * ((to - from).perp(&other.along) / self.along.perp(&other.along))
    }

    /// How well its line is known beside a place, m.
    fn sd_at(&self, place: Point2<f64>) -> f64 {
        self.sd.hypot((place - self.at).dot(&self.along) * self.turn_sd)
    }
}

/// A run of touches on one side, by their places in the order: the last may be before the first.
#[derive(Clone, Copy, Debug)]
pub(super) struct Run {
    pub(super) first: usize,
    pub(super) count: usize,
    pub(super) side: Side,
}

/// What lies between two neighbours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Between {
    /// One side.
    Side,
    /// Sides up to a corner that was touched, or whose bottom the disk cannot reach.
    Corner,
    /// Two sides which would meet, where nothing was touched.
    Foreseen,
    /// Nobody knows.
    Unknown,
}

/// All touches, fitted.
pub(super) struct Fitted<'a> {
    radius: f64,
    pub(super) touches: Vec<&'a FingerTouch>,
    /// Out of the part, at each touch.
    pub(super) normals: Vec<Vector2<f64>>,
    /// The same by each touch and its neighbours alone.
    alone: Vec<Vector2<f64>>,
    runs: Vec<Run>,
    /// What comes after each touch.
    pub(super) after: Vec<Between>,
    vertices: Vec<Vertex>,
}

/// A point of the outline.
#[derive(Clone, Copy, Debug)]
struct Vertex {
    at: Point2<f64>,
    /// Of the edge that begins here, m.
    sd: f64,
}

impl<'a> Fitted<'a> {
    pub(super) fn of(exploration: &'a Exploration) -> Option<Self> {
        let touches: Vec<_> = exploration.order.iter().map(|&number| &exploration.touches[number]).collect();
        if touches.len() < super::FIRST {
            return None;
        }
        let radius = exploration.radius;
        let normals = normals(&touches, radius);
        let mut fitted = Self {
            radius,
            after: vec![Between::Unknown; touches.len()],
            touches,
            alone: normals.clone(),
            normals,
            runs: Vec::new(),
            vertices: Vec::new(),
        };
        fitted.find_sides();
        fitted.trim();
        fitted.join();
        Some(fitted)
    }

    fn touch(&self, place: usize) -> &FingerTouch {
        self.touches[place % self.touches.len()]
    }

    /// The point of the outline that was touched.
    pub(super) fn contact(&self, place: usize) -> Point2<f64> {
        let place = place % self.touches.len();
        self.touches[place].centre - self.normals[place] * self.radius
    }

    /// The line through the centres of a run, if they are on one.
    fn side(&self, first: usize, count: usize) -> Option<Side> {
        let run = || (first..first + count).map(|place| self.touch(place));
        let weight = |touch: &FingerTouch| touch.sigma.max(SIGMA_LEAST).powi(-2);
        let total: f64 = run().map(weight).sum();
        let at = Point2::from(run().map(|touch| touch.centre.coords * weight(touch)).sum::<Vector2<f64>>() / total);
        let ends = self.touch(first + count - 1).centre - self.touch(first).centre;
        let mut along = ends.try_normalize(f64::MIN_POSITIVE)?;
        let mut spread = 0.0;
        // The ends are nearly on it, so a small turn is all that is left.
        for _ in 0..2 {
            let across = Vector2::new(along.y, -along.x);
            let (mut squares, mut product) = (0.0, 0.0);
            for touch in run() {
                let off = touch.centre - at;
                squares += weight(touch) * off.dot(&along).powi(2);
                product += weight(touch) * off.dot(&along) * off.dot(&across);
            }
            spread = squares;
            along = (along + across * (product / squares)).normalize();
        }
        let normal = Vector2::new(along.y, -along.x);
        let angle = normal.y.atan2(normal.x);
        let fits = |touch: &FingerTouch| {
            (touch.centre - at).dot(&normal).abs() <= BELONGS_SD * touch.sigma.max(SIGMA_LEAST)
                && wrap_angle(touch.force_angle - angle).abs() <= touch.half_width + NORMAL_SLACK
        };
        // In their order along it.
        let goes_on = (first..first + count - 1)
            .all(|place| (self.touch(place + 1).centre - self.touch(place).centre).dot(&along) >= 0.0);
        let sd = total.powf(-0.5);
        (goes_on && run().all(fits)).then_some(Side { at, along, normal, sd, turn_sd: spread.powf(-0.5) })
    }

    /// Whether the centres of a run are rather on its line than about a corner.
    fn is_straight(&self, first: usize, count: usize, side: &Side) -> bool {
        if count < 3 {
            return false;
        }
        let run = || (first..first + count).map(|place| self.touch(place));
        let weight = |touch: &FingerTouch| touch.sigma.max(SIGMA_LEAST).powi(-2);
        let line: f64 = run().map(|touch| weight(touch) * (touch.centre - side.at).dot(&side.normal).powi(2)).sum();
        // The corner by Gauss and Newton: it is near this one where there is one.
        let mut corner = side.at - side.normal * self.radius;
        let mut arc = f64::INFINITY;
        for _ in 0..ARC_STEPS {
            let (mut normal, mut right) = (Matrix2::zeros(), Vector2::zeros());
            arc = 0.0;
            for touch in run() {
                let way = touch.centre - corner;
                let (off, unit) =
                    (way.norm() - self.radius, way.try_normalize(f64::MIN_POSITIVE).unwrap_or(side.normal));
                normal += unit * unit.transpose() * weight(touch);
                right += unit * off * weight(touch);
                arc += weight(touch) * off * off;
            }
            let Some(step) = normal.try_inverse().map(|inverse| inverse * right) else { break };
            // No farther than a run of this length allows.
            corner += step.cap_magnitude(self.radius);
        }
        arc - line >= STRAIGHT_SD * STRAIGHT_SD
    }

    /// The longest runs first, of touches that are on none yet.
    fn find_sides(&mut self) {
        let total = self.touches.len();
        let mut is_taken = vec![false; total];
        loop {
            let mut longest: Option<(f64, Run)> = None;
            for first in 0..total {
                let mut best = None;
                for count in 2..=total {
                    if (first..first + count).any(|place| is_taken[place % total]) {
                        break;
                    }
                    let Some(side) = self.side(first, count) else {
                        if count > 2 {
                            break;
                        }
                        continue;
                    };
                    if self.is_straight(first, count, &side) {
                        best = Some(Run { first, count, side });
                    }
                }
                let Some(run) = best else { continue };
                let length = (self.touch(run.first + run.count - 1).centre - self.touch(run.first).centre).norm();
                if longest.is_none_or(|(most, _)| length > most) {
                    longest = Some((length, run));
                }
            }
            let Some((_, run)) = longest else { break };
            for place in run.first..run.first + run.count {
                is_taken[place % total] = true;
                self.normals[place % total] = run.side.normal;
                if place + 1 < run.first + run.count {
                    self.after[place % total] = Between::Side;
                }
            }
            self.runs.push(run);
        }
        self.runs.sort_by_key(|run| run.first);
    }

    /// Takes from the ends of sides what was touched beyond a convex corner: there the disk is hardly off the side's line
    /// at first, and yet turns it.
    fn trim(&mut self) {
        let total = self.touches.len();
        let count = self.runs.len();
        if count < 2 {
            return;
        }
        for _ in 0..TRIMS {
            let mut is_done = true;
            for number in 0..count {
                let other = (number + 1) % count;
                let (a, b) = (self.runs[number], self.runs[other]);
                let turn = turn(&a.side.normal, &b.side.normal);
                if !(TURN_LEAST..PI - TURN_LEAST).contains(&turn) {
                    continue;
                }
                let corner = a.side.meets(&b.side, self.radius);
                let last = a.first + a.count - 1;
                if a.count > 3 && (self.touch(last).centre - corner).dot(&a.side.along) > 0.0 {
                    is_done &= !self.shorten(number, a.first, last % total);
                }
                let b = self.runs[other];
                if b.count > 3 && (self.touch(b.first).centre - corner).dot(&b.side.along) < 0.0 {
                    is_done &= !self.shorten(other, b.first + 1, b.first);
                }
            }
            if is_done {
                break;
            }
        }
        self.runs.sort_by_key(|run| run.first);
    }

    /// Leaves one touch out of a run, at its end; whether the others are a side.
    fn shorten(&mut self, number: usize, first: usize, left_out: usize) -> bool {
        let (total, count) = (self.touches.len(), self.runs[number].count - 1);
        let Some(side) = self.side(first, count).filter(|side| self.is_straight(first, count, side)) else {
            return false;
        };
        self.runs[number] = Run { first: first % total, count, side };
        self.normals[left_out] = self.alone[left_out];
        let before_end = if first % total == left_out { left_out } else { (left_out + total - 1) % total };
        self.after[if first % total == (left_out + 1) % total { left_out } else { before_end }] = Between::Unknown;
        for place in first..first + count {
            self.normals[place % total] = side.normal;
        }
        true
    }

    /// Corners between sides, and points touched where there is none.
    fn join(&mut self) {
        let total = self.touches.len();
        let loose_deviation = |fitted: &Self, place: usize| {
            let gap = (fitted.contact(place + 1) - fitted.contact(place)).norm();
            let [a, b] = [place, place + 1].map(|place| fitted.normals[place % total]);
            fitted.touch(place).sigma.hypot(height(gap, turn(&a, &b)))
        };
        if self.runs.is_empty() {
            self.vertices =
                (0..total).map(|place| Vertex { at: self.contact(place), sd: loose_deviation(self, place) }).collect();
            return;
        }
        let mut vertices = Vec::new();
        for number in 0..self.runs.len() {
            let (run, next) = (self.runs[number], self.runs[(number + 1) % self.runs.len()]);
            let last = run.first + run.count - 1;
            // Places beyond the end of the order are those from its beginning.
            let start = if next.first <= run.first { next.first + total } else { next.first };
            let start = if start <= last { start + total } else { start };
            let side_sd = |at: Point2<f64>, side: &Side| {
                let far = (at - side.at).dot(&side.along);
                // Over a side that is as long on either hand.
                side.sd.hypot(far * side.turn_sd / 3.0_f64.sqrt())
            };
            if let Some((corner, is_touched)) = self.corner(&run.side, last, &next.side, start) {
                let between = if is_touched { Between::Corner } else { Between::Foreseen };
                (last..start).for_each(|place| self.after[place % total] = between);
                vertices.push(Vertex { at: corner, sd: side_sd(corner, &next.side) });
                continue;
            }
            // The side ends where it was touched last.
            let on_side = |place: usize| self.touch(place).centre;
            let end = on_side(last) - run.side.normal * self.radius;
            let end = end - run.side.normal * (on_side(last) - run.side.at).dot(&run.side.normal);
            vertices.push(Vertex { at: end, sd: loose_deviation(self, last) });
            for place in last + 1..start {
                vertices.push(Vertex { at: self.contact(place), sd: loose_deviation(self, place) });
            }
            let begin = on_side(start) - next.side.normal * self.radius;
            let begin = begin - next.side.normal * (on_side(start) - next.side.at).dot(&next.side.normal);
            vertices.push(Vertex { at: begin, sd: side_sd(begin, &next.side) });
        }
        self.vertices = vertices;
    }

    /// Where two sides meet, if all that was touched between says so; and whether the corner was touched, or is the bottom
    /// of a notch as deep as the disk comes.
    fn corner(&self, a: &Side, last: usize, b: &Side, start: usize) -> Option<(Point2<f64>, bool)> {
        let turn = turn(&a.normal, &b.normal);
        if turn.abs() < TURN_LEAST || turn.abs() > PI - TURN_LEAST {
            return None;
        }
        let corner = a.meets(b, self.radius);
        // The corner of two lines that turn little is known poorly along them.
        let corner_sd = a.sd_at(corner).hypot(b.sd_at(corner)) / turn.sin().abs();
        // Beyond the end of one and before the begin of the other.
        let slack = |place: usize| BELONGS_SD * self.touch(place).sigma.max(SIGMA_LEAST);
        let [end, begin] = [last, start].map(|place| self.touch(place).centre);
        let off_end = (corner - end).dot(&a.along);
        let off_begin = (begin - corner).dot(&b.along);
        // A touch beyond a convex corner by an angle is off its side by the radius times half the angle's square; as much
        // again, because the side was fitted through it.
        let round = |place: usize| (4.0 * self.radius * slack(place)).sqrt();
        if off_end < -round(last) || off_begin < -round(start) {
            return None;
        }
        let belongs = |place: usize| {
            let touch = self.touch(place);
            let beside = |side: &Side, sign: f64| {
                let off = (touch.centre - side.at).dot(&side.normal);
                let along = (corner - touch.centre).dot(&side.along) * sign;
                off.abs() <= slack(place).hypot(BELONGS_SD * side.sd_at(touch.centre)) && along >= 0.0
            };
            let off = (touch.centre - corner).norm() - self.radius;
            let is_at = off.abs() <= slack(place).hypot(BELONGS_SD * corner_sd);
            (is_at || beside(a, 1.0) || beside(b, -1.0)).then_some(is_at)
        };
        let mut is_touched = false;
        for place in last + 1..start {
            is_touched |= belongs(place)?;
        }
        // No disk was where the part would be.
        let is_free = self
            .touches
            .iter()
            .all(|touch| (touch.centre - corner).norm() >= self.radius - BELONGS_SD * touch.sigma.hypot(corner_sd));
        if turn > 0.0 {
            // The ends of the sides touch it themselves where they are as near.
            let near = |off: f64, place: usize| off <= round(place);
            return is_free.then_some((corner, is_touched || near(off_end, last) && near(off_begin, start)));
        }
        // The disk comes no deeper than where it touches both.
        let bottom = a.meets(b, 0.0);
        let near = |centre: Point2<f64>, place: usize| (centre - bottom).norm() <= round(place);
        is_free.then_some((corner, is_touched || near(end, last) && near(begin, start)))
    }

    pub(super) fn outline(&self) -> Option<ExploredOutline> {
        // Points that were touched twice are one.
        let mut vertices: Vec<Vertex> = Vec::new();
        for vertex in &self.vertices {
            let is_new =
                |other: &Vertex| (vertex.at - other.at).norm() > SIGMA_LEAST.max(0.5 * vertex.sd.min(other.sd));
            if vertices.last().is_none_or(is_new) {
                vertices.push(*vertex);
            }
        }
        simple(vertices).or_else(|| {
            let contacts =
                (0..self.touches.len()).map(|place| Vertex { at: self.contact(place), sd: self.touch(place).sigma });
            simple(contacts.collect())
        })
    }
}

/// The outline through these points. Where errors, of points close to each other, make it cross itself, of the edges that
/// cross the end that is known least is left out.
fn simple(mut vertices: Vec<Vertex>) -> Option<ExploredOutline> {
    loop {
        let count = vertices.len();
        match SimplePolygon::new(vertices.iter().map(|vertex| vertex.at).collect::<Vec<_>>()) {
            Ok(outline) => {
                let deviations = vertices.iter().map(|vertex| vertex.sd).collect();
                return Some(ExploredOutline { outline, deviations });
            }
            Err(PolygonError::Crossing { first, second }) => {
                let ends = [first, first + 1, second, second + 1].map(|place| place % count);
                let worst = ends.into_iter().max_by(|&a, &b| vertices[a].sd.total_cmp(&vertices[b].sd))?;
                vertices.remove(worst);
            }
            Err(error) => {
                vertices.remove(error.vertex()?);
            }
        }
    }
}

/// By how much the outward normal turns, rad: above 0 where the outline is convex.
pub(super) fn turn(from: &Vector2<f64>, to: &Vector2<f64>) -> f64 {
    from.perp(to).atan2(from.dot(to))
}

/// How far an outline may be from a chord of this length (m) between two tangents with a turn (rad), m.
pub(super) fn height(gap: f64, turn: f64) -> f64 {
    const TURN_MOST: f64 = 2.5;
    0.5 * gap * (0.5 * turn.abs().min(TURN_MOST)).tan()
}

/// Out of the part at each touch: the middle of what the force allows and no other disk covers.
fn normals(touches: &[&FingerTouch], radius: f64) -> Vec<Vector2<f64>> {
    let of = |place: usize| {
        let touch = touches[place];
        // As turns from the force.
        let [mut low, mut high] = [-touch.half_width, touch.half_width];
        for other in [(place + touches.len() - 1) % touches.len(), (place + 1) % touches.len()] {
            let way = touches[other].centre - touch.centre;
            let apart = way.norm();
            if apart <= SIGMA_LEAST || apart >= 2.0 * radius {
                continue;
            }
            // The disk there covers what this one touches around its direction.
            let covered = (apart / (2.0 * radius)).acos();
            let at = wrap_angle((-way.y).atan2(-way.x) - touch.force_angle);
            if at > 0.0 {
                high = high.min(at - covered);
            } else {
                low = low.max(at + covered);
            }
        }
        // What errors leave of nothing is between.
        let angle = touch.force_angle + 0.5 * (low + high).clamp(-2.0 * touch.half_width, 2.0 * touch.half_width);
        Vector2::new(angle.cos(), angle.sin())
    };
    (0..touches.len()).map(of).collect()
}
