//! The outline as a finger's disk feels it: where its centre can be while it touches.
//!
//! While it touches, the centre is on the curve at distance `r` from the outline: straight beside a side, an arc about
//! a convex corner. A place on it is a feature and a length `ζ` along it, counter-clockwise. The curve crosses itself
//! where the disk meets a second point of the outline, which does not depend on how the part lies.
//!
//! Assumes: a simple polygon, counter-clockwise; vertices that are flat to rounding belong to their side.
//! Frames: part. Units: m. Errors: none.

use nalgebra::{Point2, Vector2};

use super::{SimplePolygon, corners_to_rounding, distance_to_segment, is_crossed_by_ray};

/// A disk overlaps a second point of the outline from this depth on, m: a tenth of what counts as touching.
const MEETS_FROM_M: f64 = 1e-10;

/// Depth up to which a disk touches rather than overlaps, m.
pub(crate) const TOUCHES_M: f64 = 1e-9;

/// So far beyond its end a feature may be met, m: where two of them join, rounding must not leave a gap.
const JOINT_M: f64 = 1e-12;

/// The least component of a finger's motion, length 1, into a part: rounding of directions is a hundred times less.
pub(crate) const INTO_LEAST: f64 = 1e-12;

/// What of the outline is touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Feature {
    /// A side, by its number.
    Side(usize),
    /// The corner at which the side of this number begins.
    Corner(usize),
}

/// A place of the disk's centre while it touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    pub(crate) feature: Feature,
    /// Along the centre's curve, from where the feature begins, m.
    pub(crate) along: f64,
}

/// A point of the outline and the outward normal there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Touched {
    pub(crate) at: Point2<f64>,
    pub(crate) normal: Vector2<f64>,
}

/// An end of a feature, for the disk.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bound {
    pub(crate) along: f64,
    /// What comes after it; none where the disk meets a second point of the outline.
    pub(crate) next: Option<Place>,
}

/// Edge or vertex of the outline as it was given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// An edge, from the vertex of the same number to the next.
    Edge(usize),
    /// A vertex.
    Vertex(usize),
}

#[derive(Clone, Debug)]
struct Side {
    start: Point2<f64>,
    /// Along it.
    direction: Vector2<f64>,
    /// Outwards.
    normal: Vector2<f64>,
    length: f64,
    /// The vertices on it with their places, the first included.
    vertices: Vec<(f64, usize)>,
    /// By how much the outline turns where it begins, rad: negative at a reflex corner.
    turn: f64,
}

impl Side {
    fn end(&self) -> Point2<f64> {
        self.start + self.direction * self.length
    }

    fn distance(&self, point: Point2<f64>) -> f64 {
        distance_to_segment(point, self.start, self.end())
    }
}

/// An outline and the radius of the disk that touches it.
#[derive(Clone, Debug)]
pub(crate) struct DiskCurve {
    sides: Vec<Side>,
    radius: f64,
}

impl DiskCurve {
    pub(crate) fn new(polygon: &SimplePolygon, radius: f64) -> Self {
        let vertices = polygon.vertices();
        let corners = corners_to_rounding(vertices);
        let side = |k: usize| {
            let (first, last) = (corners[k], corners[(k + 1) % corners.len()]);
            let (start, end) = (vertices[first], vertices[last]);
            let direction = (end - start).normalize();
            let count = (last + vertices.len() - first) % vertices.len();
            let on_it = (0..count).map(|i| (first + i) % vertices.len());
            Side {
                start,
                direction,
                normal: Vector2::new(direction.y, -direction.x),
                length: (end - start).norm(),
                vertices: on_it.map(|i| ((vertices[i] - start).dot(&direction), i)).collect(),
                turn: 0.0,
            }
        };
        let mut sides: Vec<_> = (0..corners.len()).map(side).collect();
        for k in 0..sides.len() {
            let before = sides[(k + sides.len() - 1) % sides.len()].direction;
            let after = sides[k].direction;
            sides[k].turn = before.perp(&after).atan2(before.dot(&after));
        }
        Self { sides, radius }
    }

    fn before(&self, side: usize) -> usize {
        (side + self.sides.len() - 1) % self.sides.len()
    }

    fn after(&self, side: usize) -> usize {
        (side + 1) % self.sides.len()
    }

    /// The touched point: beyond the feature's ends as if it went on.
    pub(crate) fn touched(&self, place: Place) -> Touched {
        match place.feature {
            Feature::Side(k) => {
                let side = &self.sides[k];
                Touched { at: side.start + side.direction * place.along, normal: side.normal }
            }
            Feature::Corner(k) => {
                let before = &self.sides[self.before(k)];
                let (sin, cos) = (place.along / self.radius).sin_cos();
                Touched { at: self.sides[k].start, normal: before.normal * cos + before.direction * sin }
            }
        }
    }

    /// The disk's centre at a place.
    fn centre(&self, place: Place) -> Point2<f64> {
        let touched = self.touched(place);
        touched.at + touched.normal * self.radius
    }

    /// The length of a feature's part of the centre's curve, m.
    pub(crate) fn length(&self, feature: Feature) -> f64 {
        match feature {
            Feature::Side(k) => self.sides[k].length,
            Feature::Corner(k) => self.radius * self.sides[k].turn,
        }
    }

    /// The edge that holds a place, ends included, otherwise the vertex.
    pub(crate) fn element(&self, place: Place) -> Element {
        match place.feature {
            Feature::Side(k) => {
                let vertices = &self.sides[k].vertices;
                let held = vertices.iter().rev().find(|(along, _)| *along <= place.along);
                Element::Edge(held.unwrap_or(&vertices[0]).1)
            }
            Feature::Corner(k) if place.along <= 0.0 => {
                let vertices = &self.sides[self.before(k)].vertices;
                Element::Edge(vertices[vertices.len() - 1].1)
            }
            Feature::Corner(k) if place.along >= self.length(place.feature) => {
                Element::Edge(self.sides[k].vertices[0].1)
            }
            Feature::Corner(k) => Element::Vertex(self.sides[k].vertices[0].1),
        }
    }

    /// How far the disk can go either way on a feature, from a place on it.
    pub(crate) fn bounds(&self, place: Place) -> [Bound; 2] {
        let length = self.length(place.feature);
        let on_side = |k: usize, along: f64| Some(Place { feature: Feature::Side(k), along });
        let on_corner =
            |k: usize, along: f64| (self.sides[k].turn > 0.0).then_some(Place { feature: Feature::Corner(k), along });
        let (back, on) = match place.feature {
            Feature::Side(k) => {
                let next = self.after(k);
                (on_corner(k, self.length(Feature::Corner(k))), on_corner(next, 0.0))
            }
            Feature::Corner(k) => {
                let before = self.before(k);
                (on_side(before, self.sides[before].length), on_side(k, 0.0))
            }
        };
        let mut bounds = [Bound { along: 0.0, next: back }, Bound { along: length, next: on }];
        for other in 0..self.sides.len() {
            if self.is_beside(place.feature, other) {
                continue;
            }
            let [from, to] = self.clear_of(place, other, [bounds[0].along, bounds[1].along]);
            if from > bounds[0].along {
                bounds[0] = Bound { along: from, next: None };
            }
            if to < bounds[1].along {
                bounds[1] = Bound { along: to, next: None };
            }
        }
        bounds
    }

    /// Whether a side belongs to a feature, or is its neighbour at a convex corner: the disk cannot meet it there.
    fn is_beside(&self, feature: Feature, other: usize) -> bool {
        match feature {
            Feature::Side(k) => {
                let (before, after) = (self.before(k), self.after(k));
                other == k
                    || other == before && self.sides[k].turn > 0.0
                    || other == after && self.sides[after].turn > 0.0
            }
            Feature::Corner(k) => other == k || other == self.before(k),
        }
    }

    /// The stretch about a place, within another, in which the disk is clear of a side.
    fn clear_of(&self, place: Place, other: usize, [from, to]: [f64; 2]) -> [f64; 2] {
        let side = &self.sides[other];
        let reach = self.radius - MEETS_FROM_M.min(1e-3 * self.radius);
        let mut marks = Vec::with_capacity(14);
        match place.feature {
            Feature::Side(k) => {
                let this = &self.sides[k];
                let (start, way) = (this.start + this.normal * self.radius, this.direction);
                for sign in [1.0, -1.0] {
                    let slope = way.dot(&side.normal);
                    marks.push((sign * reach - (start - side.start).dot(&side.normal)) / slope);
                }
                for end in [side.start, side.end()] {
                    let to_end = end - start;
                    let (along, off) = (to_end.dot(&way), to_end.perp(&way));
                    let half = (reach * reach - off * off).sqrt();
                    marks.extend([along - half, along + half]);
                }
            }
            Feature::Corner(k) => {
                let (middle, radius) = (self.sides[k].start, self.radius);
                let first = self.sides[self.before(k)].normal;
                let first = first.y.atan2(first.x);
                let mut mark = |angle: f64| {
                    marks.push((angle - first).rem_euclid(std::f64::consts::TAU) * radius);
                };
                let facing = side.normal.y.atan2(side.normal.x);
                for sign in [1.0, -1.0] {
                    let turn = ((sign * reach - (middle - side.start).dot(&side.normal)) / radius).acos();
                    mark(facing + turn);
                    mark(facing - turn);
                }
                for end in [side.start, side.end()] {
                    let to_end = end - middle;
                    let apart = to_end.norm();
                    let turn = ((radius * radius + apart * apart - reach * reach) / (2.0 * radius * apart)).acos();
                    let facing = to_end.y.atan2(to_end.x);
                    mark(facing + turn);
                    mark(facing - turn);
                }
            }
        }
        // What does not exist is not a number, and drops out here.
        marks.retain(|mark| from < *mark && *mark < to);
        marks.extend([from, to]);
        marks.sort_by(f64::total_cmp);
        let here = place.along.clamp(from, to);
        let meets = |a: f64, b: f64| {
            let middle = Place { along: 0.5 * (a + b), ..place };
            side.distance(self.centre(middle)) < reach
        };
        let back = marks.windows(2).rev().find(|pair| pair[0] < here && meets(pair[0], pair[1]));
        let on = marks.windows(2).find(|pair| pair[1] > here && meets(pair[0], pair[1]));
        // Where it meets already, that is as far as it goes.
        [back.map_or(from, |pair| pair[1].min(here)), on.map_or(to, |pair| pair[0].max(here))]
    }

    /// Where a disk going straight from `centre` along `direction` (length 1) first touches, and after which length, if
    /// that is less than `length`: where it goes into the part by more than `into_least`, for grazing is no touch.
    pub(crate) fn first_touch(
        &self,
        centre: Point2<f64>,
        direction: Vector2<f64>,
        length: f64,
        into_least: f64,
    ) -> Option<(f64, Place)> {
        let features = (0..self.sides.len()).flat_map(|k| [Feature::Side(k), Feature::Corner(k)]);
        let touches = features.filter_map(|feature| {
            let (after, along) = self.touch(feature, centre, direction, into_least)?;
            (after < length).then_some((after, Place { feature, along }))
        });
        touches.min_by(|a, b| a.0.total_cmp(&b.0))
    }

    fn touch(
        &self,
        feature: Feature,
        centre: Point2<f64>,
        direction: Vector2<f64>,
        into_least: f64,
    ) -> Option<(f64, f64)> {
        match feature {
            Feature::Side(k) => {
                let side = &self.sides[k];
                let into = -direction.dot(&side.normal);
                let gap = (centre - side.start).dot(&side.normal) - self.radius;
                if into <= into_least || gap < -2.0 * TOUCHES_M {
                    return None;
                }
                let after = (gap / into).max(0.0);
                let along = (centre + direction * after - side.start).dot(&side.direction);
                within(along, side.length).map(|along| (after, along))
            }
            Feature::Corner(k) => {
                let side = &self.sides[k];
                let before = &self.sides[self.before(k)];
                let from_corner = centre - side.start;
                let (closing, off) = (-from_corner.dot(&direction), from_corner.perp(&direction));
                if side.turn <= 0.0 || off.abs() >= self.radius || from_corner.norm() < self.radius - 2.0 * TOUCHES_M {
                    return None;
                }
                let after = (closing - (self.radius * self.radius - off * off).sqrt()).max(0.0);
                let there = from_corner + direction * after;
                if there.norm() > self.radius + 2.0 * TOUCHES_M || -there.dot(&direction) <= into_least * self.radius {
                    return None;
                }
                let along = self.radius * before.normal.perp(&there).atan2(before.normal.dot(&there));
                within(along, self.length(feature)).map(|along| (after, along))
            }
        }
    }

    /// The features on which the disk may be.
    pub(crate) fn features(&self) -> impl Iterator<Item = Feature> + '_ {
        let corners = (0..self.sides.len()).filter(|&k| self.sides[k].turn > 0.0 && self.radius > 0.0);
        (0..self.sides.len()).map(Feature::Side).chain(corners.map(Feature::Corner))
    }

    /// Of the disk, m.
    pub(crate) fn radius(&self) -> f64 {
        self.radius
    }

    /// The distance of a point from the part, negative inside, and the nearest point of the outline.
    pub(crate) fn signed_distance(&self, point: Point2<f64>) -> (f64, Point2<f64>) {
        let (mut distance, mut nearest, mut is_inside) = (f64::INFINITY, point, false);
        for side in &self.sides {
            let (start, end) = (side.start, side.end());
            let along = (point - start).dot(&side.direction).clamp(0.0, side.length);
            let at = start + side.direction * along;
            if (point - at).norm() < distance {
                (distance, nearest) = ((point - at).norm(), at);
            }
            is_inside ^= is_crossed_by_ray(point, start, end);
        }
        (if is_inside { -distance } else { distance }, nearest)
    }

    /// The distance of a point from the outline, m.
    pub(crate) fn distance(&self, point: Point2<f64>) -> f64 {
        self.sides.iter().map(|side| side.distance(point)).fold(f64::INFINITY, f64::min)
    }
}

/// A place on a feature of this length, if it is one.
fn within(along: f64, length: f64) -> Option<f64> {
    (-JOINT_M..=length + JOINT_M).contains(&along).then_some(along.clamp(0.0, length))
}
