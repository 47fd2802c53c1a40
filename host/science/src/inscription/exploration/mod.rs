//! The outline of an unknown part from touches all around it, and where to touch next.
//!
//! A finger's disk goes along lines until it touches; its centre is then on the curve at the disk's radius from the
//! outline. Touches are kept in the order in which they lie around the part. Runs of them whose centres are on one line
//! are a side; sides and the corners in which they meet are fitted together ([`sides`]), also at the bottom of a notch into
//! which the disk does not reach: sides are taken to go on straight. What belongs to no side is joined by the points
//! touched ([`fit`]).
//!
//! The next touch is made in the gap between two neighbours in which the outline can be farthest from what is known
//! ([`gaps`]).
//!
//! Source: probing of polygons by lines, R. Cole and C. Yap, J. Algorithms 8 (1987) 19–38, here with a disk and errors.
//! Pure. Frames: world. Units: m, rad. Errors: none; too few touches are no outline.

mod fit;
mod gaps;
mod sides;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;

use nalgebra::{Point2, Vector2, center};

use super::next_touch::{Approach, FingerTouch, Met, NextTouch, across};
use crate::geometry::SimplePolygon;
use crate::geometry::mesh::signed_area;
use crate::math::angle::wrap_angle;

/// Touches by which an order around the part is begun.
const FIRST: usize = 4;

/// What is tried in a gap before it is taken to be closed to the disk.
const TRIES_MAX: usize = 3;

/// The golden ratio's fraction: offsets of lines before the first touch that leave no gap for long.
const GOLDEN: f64 = 0.618_033_988_749_894_9;

/// A way around that is shorter by this share of the radius is another one, and not rounding.
const SHORTER: f64 = 1e-9;

/// Directions of lines before the first touch.
const SEEKING: usize = 4;

/// What was found of an unknown outline.
#[derive(Clone, Debug, PartialEq)]
pub struct ExploredOutline {
    /// World.
    pub outline: SimplePolygon,
    /// Standard deviation of each of its edges' lines, m: what errors of touches leave, and how far the outline may be
    /// beside what joins two of them.
    pub deviations: Vec<f64>,
}

impl ExploredOutline {
    /// Root mean square of the edges' standard deviations along the outline, m.
    #[must_use]
    pub fn sigma(&self) -> f64 {
        let edges = self.outline.edges().zip(&self.deviations).map(|((start, end), sd)| ((end - start).norm(), *sd));
        let (length, sum) = edges.fold((0.0, 0.0), |(length, sum), (edge, sd)| (length + edge, sum + edge * sd * sd));
        (sum / length).sqrt()
    }
}

/// The exploration of an unknown part that is held still.
///
/// ```
/// use nalgebra::{Point2, Vector2};
/// use palpate::inscription::{Exploration, FingerTouch, Met};
///
/// let area = [Point2::origin(), Point2::new(0.2, 0.2)]; // m
/// let mut exploration = Exploration::new(0.015, area);
/// for _ in 0..4 {
///     let next = exploration.next().ok_or("nowhere to go")?;
///     let way = next.approach.direction;
///     // A round part of 6 cm about the middle.
///     let centre = Point2::new(0.1, 0.1) - way * 0.045;
///     let touch = FingerTouch { centre, sigma: 1e-5, force_angle: (-way.y).atan2(-way.x), half_width: 0.3 };
///     exploration.take(&next.approach, &Met::Part(touch));
/// }
/// assert!(exploration.outline().is_some());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug)]
pub struct Exploration {
    radius: f64,
    area: [Point2<f64>; 2],
    /// In the order in which they were made.
    touches: Vec<FingerTouch>,
    /// Their numbers in the order in which they lie around the part, counter-clockwise.
    order: Vec<usize>,
    /// Approaches before the first touch.
    sought: usize,
    /// How often the gap between two touches was aimed at in vain.
    tries: BTreeMap<[usize; 2], usize>,
}

impl Exploration {
    /// Nothing was touched yet; `area` holds all of the part.
    #[must_use]
    pub fn new(radius: f64, area: [Point2<f64>; 2]) -> Self {
        Self { radius, area, touches: Vec::new(), order: Vec::new(), sought: 0, tries: BTreeMap::new() }
    }

    /// The disk's radius, m.
    #[must_use]
    pub fn radius(&self) -> f64 {
        self.radius
    }

    /// Two corners of the rectangle that holds all of the part, m.
    #[must_use]
    pub fn area(&self) -> [Point2<f64>; 2] {
        self.area
    }

    /// The touches so far.
    #[must_use]
    pub fn touches(&self) -> &[FingerTouch] {
        &self.touches
    }

    /// Takes what came of an approach.
    pub fn take(&mut self, approach: &Approach, met: &Met) {
        let aimed = self.gap().filter(|gap| self.way_to(gap) == *approach).map(|gap| gap.between);
        let Met::Part(touch) = met else {
            self.sought += 1;
            if let Some(gap) = aimed {
                *self.tries.entry(gap).or_default() += 1;
            }
            return;
        };
        let number = self.touches.len();
        self.touches.push(*touch);
        if self.touches.len() <= FIRST {
            self.order.push(number);
            if self.touches.len() == FIRST {
                self.order_about_middle();
            }
            return;
        }
        self.put_in_order(number);
        let total = self.order.len();
        let place = self.order.iter().position(|&other| other == number).unwrap_or(0);
        let [before, after] = [place + total - 1, place + 1].map(|place| self.order[place % total]);
        match aimed {
            Some(gap) if gap == [before, after] => {
                // What is left of the gap was as hard to come to.
                let tried = self.tries.get(&gap).copied().unwrap_or(0);
                if tried > 0 {
                    self.tries.insert([before, number], tried);
                    self.tries.insert([number, after], tried);
                }
            }
            Some(gap) => *self.tries.entry(gap).or_default() += 1,
            None => {}
        }
    }

    /// The first touches, around the middle of what they touched.
    fn order_about_middle(&mut self) {
        let sum: Vector2<f64> = self.touches.iter().map(|touch| touch.centre.coords).sum();
        let middle = Point2::from(sum / self.touches.len() as f64);
        let angle = |number: usize| {
            let way = self.touches[number].centre - middle;
            way.y.atan2(way.x)
        };
        let mut order = self.order.clone();
        order.sort_by(|&a, &b| angle(a).total_cmp(&angle(b)));
        self.order = order;
    }

    /// How far two touches are apart, in places and normals. Normals turn as little as the cones of the forces allow:
    /// friction would shuffle the touches of a side otherwise.
    fn apart(&self, a: usize, b: usize) -> f64 {
        let [a, b] = [a, b].map(|number| &self.touches[number]);
        let turn = wrap_angle(a.force_angle - b.force_angle).abs() - a.half_width - b.half_width;
        (a.centre - b.centre).norm().hypot(self.radius * turn.max(0.0))
    }

    /// Puts a touch where it makes the way around longer least; then turns stretches of the way around wherever that makes
    /// it shorter: what was put in while little was known may be the wrong way round.
    fn put_in_order(&mut self, number: usize) {
        let total = self.order.len();
        let longer = |place: usize| {
            let [a, b] = [place, (place + 1) % total].map(|place| self.order[place]);
            self.apart(a, number) + self.apart(number, b) - self.apart(a, b)
        };
        let place = (0..total).min_by(|&a, &b| longer(a).total_cmp(&longer(b))).unwrap_or(0);
        self.order.insert(place + 1, number);
        while let Some((first, last)) = self.turned_round() {
            self.order[first..=last].reverse();
        }
        let centres: Vec<_> = self.order.iter().map(|&number| self.touches[number].centre).collect();
        if signed_area(&centres) < 0.0 {
            self.order.reverse();
        }
    }

    /// A stretch of the order, first and last place, that is shorter the other way round.
    fn turned_round(&self) -> Option<(usize, usize)> {
        let total = self.order.len();
        let apart = |a: usize, b: usize| self.apart(self.order[a % total], self.order[b % total]);
        let gains = |first: usize, last: usize| {
            apart(first - 1, first) + apart(last, last + 1) - apart(first - 1, last) - apart(first, last + 1)
        };
        let mut stretches = (1..total).flat_map(|first| (first + 1..total).map(move |last| (first, last)));
        let gain = |&(first, last): &(usize, usize)| gains(first, last) > SHORTER * self.radius;
        stretches.find(gain)
    }

    /// The touch to make next: where least is known. None where the disk can come to no gap that is left.
    #[must_use]
    pub fn next(&self) -> Option<NextTouch> {
        let approach = match *self.touches.as_slice() {
            [] => self.seek(),
            // From the other side.
            [first] => {
                let normal = outwards(&first);
                self.across(first.centre - normal * self.radius, normal)
            }
            [first, second] => self.across(middle(&first, &second), left(&(second.centre - first.centre))),
            [first, second, _] => self.across(middle(&first, &second), -left(&(second.centre - first.centre))),
            _ => self.way_to(&self.gap()?),
        };
        // Of poses nothing is said.
        Some(NextTouch { approach, free_travel: 0.0, meets: f64::NAN, leaves: f64::NAN })
    }

    /// Where least is known.
    fn gap(&self) -> Option<gaps::Gap> {
        gaps::next(self)
    }

    fn way_to(&self, gap: &gaps::Gap) -> Approach {
        self.across(gap.through, gap.direction)
    }

    fn across(&self, foot: Point2<f64>, direction: Vector2<f64>) -> Approach {
        across(self.area, self.radius, foot, direction)
    }

    /// Lines across the rectangle, farther and farther in between.
    fn seek(&self) -> Approach {
        let direction = [Vector2::x(), Vector2::y(), -Vector2::x(), -Vector2::y()][self.sought % SEEKING];
        let share = (0.5 + GOLDEN * (self.sought / SEEKING) as f64).fract();
        let [low, high] = self.area;
        self.across(low + (high - low) * share, direction)
    }

    /// What is known of the outline; none where too little was touched to be one.
    #[must_use]
    pub fn outline(&self) -> Option<ExploredOutline> {
        fit::Fitted::of(self)?.outline()
    }
}

/// The middle between two places of the disk.
fn middle(a: &FingerTouch, b: &FingerTouch) -> Point2<f64> {
    center(&a.centre, &b.centre)
}

/// A quarter turn counter-clockwise of a way's direction.
fn left(way: &Vector2<f64>) -> Vector2<f64> {
    Vector2::new(-way.y, way.x).try_normalize(f64::MIN_POSITIVE).unwrap_or_else(Vector2::y)
}

/// Out of the part, as the force says.
fn outwards(touch: &FingerTouch) -> Vector2<f64> {
    Vector2::new(touch.force_angle.cos(), touch.force_angle.sin())
}
