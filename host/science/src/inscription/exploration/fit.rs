//! The outline that touches in their order around a part make: sides, corners, and what joins single touches.
//!
//! Frames: world. Units: m, rad. Errors: none.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Point2, Vector2};

use super::sides::{BELONGS_SD, Element, SIGMA_LEAST, Sides, Touched, turn};
use super::{Exploration, ExploredOutline};
use crate::geometry::{PolygonError, SimplePolygon, distance_to_segment};
use crate::inscription::next_touch::FingerTouch;
use crate::math::angle::wrap_angle;

/// Mean square of what may be anywhere between none and its most, as a share of the most's square.
const EVEN: f64 = 1.0 / 3.0;

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
    /// By how much each may be turned, rad.
    slack: Vec<f64>,
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

/// Where two sides meet, and what may be hidden there.
#[derive(Clone, Copy, Debug)]
struct Corner {
    at: Point2<f64>,
    is_touched: bool,
    /// How far from it each of the two sides was touched, m.
    untouched: [f64; 2],
    /// How far the outline may be beside it, m.
    hidden: f64,
}

impl<'a> Fitted<'a> {
    pub(super) fn of(exploration: &'a Exploration) -> Option<Self> {
        let touches: Vec<_> = exploration.order.iter().map(|&number| &exploration.touches[number]).collect();
        if touches.len() < super::FIRST {
            return None;
        }
        let radius = exploration.radius;
        let (normals, slack) = normals(&touches, radius);
        let total = touches.len();
        let after = vec![Between::Unknown; total];
        let mut fitted = Self { radius, after, normals, slack, touches, vertices: Vec::new() };
        let touches = fitted.touches.clone();
        let sides = Sides::of(&touches, &fitted.normals, radius);
        let touched: Vec<_> = (0..total).map(|place| sides.touched(place)).collect();
        fitted.take_normals(&touched);
        fitted.vertices = fitted.joined(&sides, &touched);
        Some(fitted)
    }

    /// The point of the outline that was touched.
    pub(super) fn contact(&self, place: usize) -> Point2<f64> {
        let place = place % self.touches.len();
        self.touches[place].centre - self.normals[place] * self.radius
    }

    fn take_normals(&mut self, touched: &[Option<Touched>]) {
        for (place, touched) in touched.iter().enumerate() {
            if let Some((_, normal)) = touched {
                (self.normals[place], self.slack[place]) = (*normal, 0.0);
            }
        }
    }

    /// Corners between sides, and points touched where there is none.
    fn joined(&mut self, sides: &Sides<'_>, touched: &[Option<Touched>]) -> Vec<Vertex> {
        let total = self.touches.len();
        let runs = &sides.runs;
        if runs.is_empty() {
            return (0..total).map(|place| self.loose(place)).collect();
        }
        let corners: Vec<_> =
            (0..runs.len()).map(|number| sides.meets[number].then(|| self.corner(sides, touched, number))).collect();
        for (number, run) in runs.iter().enumerate() {
            (run.first..run.first + run.count - 1).for_each(|place| self.after[place % total] = Between::Side);
            let between = match &corners[number] {
                Some(corner) if corner.is_touched => Between::Corner,
                Some(_) => Between::Foreseen,
                None => Between::Unknown,
            };
            let range = sides.between(number);
            (range.start - 1..range.end).for_each(|place| self.after[place % total] = between);
        }
        let mut vertices = Vec::new();
        for (number, run) in runs.iter().enumerate() {
            let before = (number + runs.len() - 1) % runs.len();
            let on = |place: usize| {
                let centre = self.touches[place % total].centre;
                centre - run.side.normal * (run.side.off(&centre) + self.radius)
            };
            let begin = corners[before].map_or_else(|| on(run.first), |corner| corner.at);
            let end = corners[number].map_or_else(|| on(run.first + run.count - 1), |corner| corner.at);
            vertices.push(Vertex {
                at: begin,
                sd: self.side_sd(sides, number, [corners[before], corners[number]], [begin, end]),
            });
            if corners[number].is_none() {
                let last = run.first + run.count - 1;
                vertices.push(Vertex { at: end, sd: self.loose(last).sd });
                vertices.extend(sides.between(number).map(|place| self.loose(place)));
            }
        }
        vertices
    }

    /// A point touched that belongs to nothing, and how well the outline is known up to the next.
    fn loose(&self, place: usize) -> Vertex {
        let total = self.touches.len();
        let (place, next) = (place % total, (place + 1) % total);
        let gap = (self.contact(next) - self.contact(place)).norm();
        let slack = self.slack[place] + self.slack[next];
        let turn = turn(&self.normals[place], &self.normals[next]).abs() + slack;
        // A normal that is turned moves the point along the disk.
        let hidden = height(gap + self.radius * slack, turn);
        Vertex { at: self.contact(place), sd: Sides::sd(self.touches[place]).hypot(hidden * EVEN.sqrt()) }
    }

    fn corner(&self, sides: &Sides<'_>, touched: &[Option<Touched>], number: usize) -> Corner {
        let next = sides.next(number);
        let (a, b) = (&sides.runs[number].side, &sides.runs[next].side);
        let (at, turn) = (sides.corner(number), sides.turn(number));
        // The disk's centre where it touches both sides of a notch; at a corner, where it leaves the side.
        let ends =
            if turn < 0.0 { [a.meets(b, 0.0); 2] } else { [at + a.normal * self.radius, at + b.normal * self.radius] };
        let mut untouched = [f64::INFINITY; 2];
        let mut is_touched = false;
        for (touch, touched) in self.touches.iter().zip(touched) {
            let Some((element, _)) = *touched else { continue };
            let on = if element == Element::Side(number) { 0 } else { 1 };
            if element == Element::Corner(number) {
                is_touched = true;
            } else if element == Element::Side(number) || element == Element::Side(next) {
                untouched[on] = untouched[on].min((touch.centre - ends[on]).norm());
            }
            // A touch beside an end is off the side by the radius times half the angle's square.
            let near = (2.0 * BELONGS_SD * self.radius * Sides::sd(touch)).sqrt();
            is_touched |= turn < 0.0 && (touch.centre - ends[0]).norm() <= near;
        }
        // In a notch the disk is as far from its bottom as from where it touches.
        let beyond = if turn < 0.0 { self.radius * (0.5 * turn.abs()).tan() } else { 0.0 };
        let untouched = untouched.map(|way| way.min(4.0 * self.radius) + beyond);
        let chord = a.along * untouched[0] + b.along * untouched[1];
        let hidden = if is_touched { 0.0 } else { untouched[0] * untouched[1] * turn.sin().abs() / chord.norm() };
        Corner { at, is_touched, untouched, hidden }
    }

    /// Standard deviation of a side between its ends, m: its line's, and what may be hidden at its ends.
    fn side_sd(&self, sides: &Sides<'_>, number: usize, corners: [Option<Corner>; 2], ends: [Point2<f64>; 2]) -> f64 {
        let side = &sides.runs[number].side;
        let length = (ends[1] - ends[0]).norm().max(SIGMA_LEAST);
        let line = sides.variance(number, ends.map(|end| side.travel(&end)));
        let hidden = corners.into_iter().enumerate().flat_map(|(end, corner)| {
            // At its first end it is the second of the two that meet.
            corner.map(|corner| corner.hidden * corner.hidden * EVEN * (corner.untouched[1 - end] / length).min(1.0))
        });
        (line + hidden.sum::<f64>()).sqrt()
    }

    pub(super) fn outline(&self) -> Option<ExploredOutline> {
        // Points that were touched twice are one.
        let mut vertices: Vec<Vertex> = Vec::new();
        for vertex in &self.vertices {
            if vertices.last().is_none_or(|other| (vertex.at - other.at).norm() > SIGMA_LEAST) {
                vertices.push(*vertex);
            }
        }
        simple(vertices)
    }
}

/// The outline through these points. Where errors, of points close to each other, make it cross itself, of the edges that
/// cross the end that is known least is left out; the edge in its place is known no better than by how far it is from it.
fn simple(mut vertices: Vec<Vertex>) -> Option<ExploredOutline> {
    loop {
        let count = vertices.len();
        let worst = match SimplePolygon::new(vertices.iter().map(|vertex| vertex.at).collect::<Vec<_>>()) {
            Ok(outline) => {
                let deviations = vertices.iter().map(|vertex| vertex.sd).collect();
                return Some(ExploredOutline { outline, deviations });
            }
            Err(PolygonError::Crossing { first, second }) => {
                let ends = [first, first + 1, second, second + 1].map(|place| place % count);
                ends.into_iter().max_by(|&a, &b| vertices[a].sd.total_cmp(&vertices[b].sd))?
            }
            Err(error) => error.vertex()?,
        };
        let left_out = vertices.remove(worst);
        let count = vertices.len();
        if count < 3 {
            return None;
        }
        let [before, after] = [(worst + count - 1) % count, worst % count];
        let off = distance_to_segment(left_out.at, vertices[before].at, vertices[after].at);
        vertices[before].sd = vertices[before].sd.max(left_out.sd).max(off);
    }
}

/// How far an outline may be from a chord of this length (m) between two tangents with a turn (rad), m.
pub(super) fn height(gap: f64, turn: f64) -> f64 {
    const TURN_MOST: f64 = 2.5;
    0.5 * gap * (0.5 * turn.abs().min(TURN_MOST)).tan()
}

/// Out of the part at each touch: the middle of what the force allows and no other disk covers; and half of what that is.
fn normals(touches: &[&FingerTouch], radius: f64) -> (Vec<Vector2<f64>>, Vec<f64>) {
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
        (Vector2::new(angle.cos(), angle.sin()), (0.5 * (high - low)).clamp(0.0, FRAC_PI_2))
    };
    (0..touches.len()).map(of).unzip()
}
