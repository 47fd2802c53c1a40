//! A cover of all poses that touches and ways passed leave.
//!
//! A pose that touches at the first touch's centre `c₁` is known by the place on the disk's curve and the normal's world
//! angle `ν` there. A cell is a piece of one feature of the curve times an interval of `ν`. Within it a point of the part
//! that is at `x` moves from where it is in the cell's middle by no more than
//! `ρ(x) = |x − c₁| hν + h` on a side, `|x − c₁| hν + (|x − c₁| + r) h/r` at a corner, with half widths `hν` and `h`: a change
//! of `ν` turns the part about `c₁`, one along a side shifts it, one along an arc turns it about the corner. Distances
//! change by no more than that, so a cell is dropped where its middle misses a reading by more than `ρ` and what the
//! reading may be off.
//!
//! Frames: world, unless named. Units: m, rad. Errors: none.

use std::f64::consts::TAU;

use nalgebra::{Isometry2, Point2, Rotation2, Vector2};

use super::{FingerTouch, TRUSTED_SD, TouchTask};
use crate::geometry::disk_curve::{DiskCurve, Feature, Place};
use crate::geometry::{Pose, SimplePolygon, bounding_box, distance_to_segment, is_crossed_by_ray};
use crate::math::angle::wrap_angle;

/// Poses that stand for all before the first touch.
pub(super) const SPREAD: u32 = 1500;

/// For each of them so many are tried: parts that fill their rectangle, or ways that leave little of it.
const SPREAD_TRIES: u32 = 133;

/// The additive recurrence that spreads points evenly over a cube, in fractions of 1: powers of the inverse of the real
/// root of x⁴ = x + 1 (M. Roberts, 2018).
const RECURRENCE: [f64; 3] = [0.819_172_513_396_164_4, 0.671_043_606_703_789_2, 0.549_700_477_901_970_3];

/// Half widths of the first cells: along the outline (m) and of the normal's angle (rad).
const FIRST: [f64; 2] = [4e-3, 0.12];

/// With one touch cells are no wider than this, as the part's motion, m: enough to choose where to go next.
const WIDTH_OF_ONE: f64 = 4e-3;

/// With two touches, m.
const WIDTH_OF_TWO: f64 = 8e-4;

/// With three and more, in standard deviations of a touch: what is left is then one group about each pose.
const WIDTH_SD: f64 = 2.0;

/// More cells than this are not divided further: too much is left to be called poses.
const CELLS_MAX: usize = 4000;

/// A stretch of the disk's way on which it met nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Way {
    pub(super) from: Point2<f64>,
    pub(super) to: Point2<f64>,
    /// The disk may have touched by so much without notice, m.
    pub(super) slack: f64,
}

/// A piece of a feature times an interval of the normal's angle.
#[derive(Clone, Copy, Debug)]
struct Cell {
    place: Place,
    half: f64,
    normal: f64,
    normal_half: f64,
}

/// A cover.
#[derive(Clone, Debug)]
pub(super) struct Cells {
    first: Point2<f64>,
    first_sigma: f64,
    cells: Vec<Cell>,
    is_fine: bool,
}

/// So many poses in the rectangle, evenly spread, that no way passes through.
pub(super) fn spread(task: &TouchTask, passed: &[Way], count: u32) -> Vec<Pose> {
    let [low, high] = task.area;
    let span = high - low;
    let at = |index: u32| {
        let [x, y, turn] = RECURRENCE.map(|step| (0.5 + step * f64::from(index)).fract());
        // Of the middle of the outline's bounding box, so that long parts fit as often as round ones.
        let theta = TAU * turn;
        let turned: Vec<_> = task.outline.vertices().iter().map(|v| Rotation2::new(theta) * v).collect();
        let (least, most) = bounding_box(&turned);
        let room = span - (most - least);
        (room.min() >= 0.0).then(|| {
            let origin = low.coords + Vector2::new(x * span.x, y * span.y) - nalgebra::center(&least, &most).coords;
            let pose = Pose { x: origin.x, y: origin.y, theta };
            let is_inside = origin + least.coords >= low.coords && origin + most.coords <= high.coords;
            (pose, is_inside)
        })
    };
    let fits = |pose: &Pose| {
        let to_part = pose.isometry().inverse();
        passed.iter().all(|way| clearance(&task.outline, &to_part, way) >= task.radius - way.slack)
    };
    let tried = (0..SPREAD_TRIES * count).filter_map(at).filter(|(_, is_inside)| *is_inside).map(|(pose, _)| pose);
    tried.filter(fits).take(count as usize).collect()
}

/// The distance of a way from the part, 0 where it leads through.
fn clearance(outline: &SimplePolygon, to_part: &Isometry2<f64>, way: &Way) -> f64 {
    let (a, b) = (to_part * way.from, to_part * way.to);
    let (mut least, mut inside) = (f64::INFINITY, false);
    for (start, end) in outline.edges() {
        inside ^= is_crossed_by_ray(a, start, end);
        let sides = |p: Point2<f64>, q: Point2<f64>, x: Point2<f64>| (q - p).perp(&(x - p)) > 0.0;
        if sides(start, end, a) != sides(start, end, b) && sides(a, b, start) != sides(a, b, end) {
            return 0.0;
        }
        for (point, [from, to]) in [(a, [start, end]), (b, [start, end]), (start, [a, b]), (end, [a, b])] {
            least = least.min(distance_to_segment(point, from, to));
        }
    }
    if inside { 0.0 } else { least }
}

/// A pose in a cell's middle.
#[derive(Clone, Copy, Debug)]
pub(super) struct Middle {
    pub(super) pose: Pose,
    /// How far any point of the part may be from there, m.
    pub(super) reach: f64,
}

impl Cells {
    /// All poses that touch at this touch.
    pub(super) fn about(task: &TouchTask, curve: &DiskCurve, first: &FingerTouch) -> Self {
        let pieces = |length: f64, half_max: f64| {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a length over a few mm")]
            let count = (length / (2.0 * half_max)).ceil().max(1.0) as u32;
            let half = 0.5 * length / f64::from(count);
            (0..count).map(move |k| (half * f64::from(2 * k + 1), half))
        };
        let mut cells = Vec::new();
        for feature in curve.features() {
            for (along, half) in pieces(curve.length(feature), FIRST[0]) {
                for (turn, normal_half) in pieces(2.0 * first.half_width, FIRST[1]) {
                    let normal = first.force_angle - first.half_width + turn;
                    cells.push(Cell { place: Place { feature, along }, half, normal, normal_half });
                }
            }
        }
        debug_assert!(task.radius > 0.0, "a disk has a radius");
        Self { first: first.centre, first_sigma: first.sigma, cells, is_fine: false }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.cells.is_empty()
    }

    /// Whether cells are as small as readings are exact.
    pub(super) fn is_fine(&self) -> bool {
        self.is_fine
    }

    pub(super) fn len(&self) -> usize {
        self.cells.len()
    }

    /// The cells' middles: after so many that are skipped, one of so many.
    pub(super) fn middles<'a>(
        &'a self,
        task: &'a TouchTask,
        curve: &'a DiskCurve,
        skipped: usize,
        stride: usize,
    ) -> impl Iterator<Item = Middle> + 'a {
        let size = farthest(task);
        self.cells.iter().skip(skipped).step_by(stride).map(move |cell| self.middle(cell, task, curve, size))
    }

    /// Drops what readings exclude, and divides the rest until it is small enough for their number.
    /// After ways that met nothing since the last touch (`barren`) cells are smaller by a factor of two each: coarse ones hide
    /// what such a way excludes.
    pub(super) fn refine(
        &mut self,
        task: &TouchTask,
        curve: &DiskCurve,
        touches: &[FingerTouch],
        passed: &[Way],
        barren: i32,
    ) {
        let sigma = touches.iter().map(|touch| touch.sigma).fold(f64::INFINITY, f64::min);
        let width = match touches.len() {
            0 | 1 => WIDTH_OF_ONE,
            2 => WIDTH_OF_TWO,
            _ => WIDTH_SD * sigma,
        };
        let width = (width * 0.5_f64.powi(barren)).max(WIDTH_SD * sigma);
        let size = farthest(task);
        let readings = Readings { task, touches, passed, first_sigma: self.first_sigma };
        let mut todo = std::mem::take(&mut self.cells);
        let mut done = Vec::new();
        let mut is_divided = true;
        while !todo.is_empty() {
            let mut next = Vec::with_capacity(todo.len());
            for cell in &todo {
                let middle = self.middle(cell, task, curve, size);
                // Where a way is inside of the disk's curve it is no farther than this from the first touch.
                let far = cell.reach(size + 2.0 * task.radius, task.radius);
                let reach_at = |x| self.reach_at(cell, x, task.radius);
                if readings.exclude(&middle, &reach_at, far, cell.turn_half(task.radius)) {
                    continue;
                }
                if middle.reach <= width {
                    done.push(*cell);
                } else {
                    next.extend(cell.halves(task.radius, size));
                }
            }
            if done.len() + next.len() > CELLS_MAX {
                done.append(&mut next);
                is_divided = false;
            }
            todo = next;
        }
        self.is_fine = touches.len() >= 3 && is_divided;
        self.cells = done;
    }

    fn middle(&self, cell: &Cell, task: &TouchTask, curve: &DiskCurve, size: f64) -> Middle {
        let touched = curve.touched(cell.place);
        let theta = cell.normal - touched.normal.y.atan2(touched.normal.x);
        let from_part = touched.at.coords + touched.normal * task.radius;
        let origin = self.first - Rotation2::new(theta) * from_part;
        let pose = Pose { x: origin.x, y: origin.y, theta };
        let reach = cell.reach(size + task.radius, task.radius);
        Middle { pose, reach }
    }

    fn reach_at(&self, cell: &Cell, at: Point2<f64>, radius: f64) -> f64 {
        cell.reach((at - self.first).norm(), radius)
    }
}

/// The farthest that two points of the outline are apart.
fn farthest(task: &TouchTask) -> f64 {
    let vertices = task.outline.vertices();
    let from = |a: &Point2<f64>| vertices.iter().map(|b| (b - a).norm()).fold(0.0, f64::max);
    vertices.iter().map(from).fold(0.0, f64::max)
}

impl Cell {
    /// `ρ` at this distance from the first touch's centre.
    fn reach(&self, distance: f64, radius: f64) -> f64 {
        let along = match self.place.feature {
            Feature::Side(_) => self.half,
            Feature::Corner(_) => (distance + radius) * self.half / radius,
        };
        distance * self.normal_half + along
    }

    /// How far the part may be turned from where it is in the middle, rad.
    fn turn_half(&self, radius: f64) -> f64 {
        match self.place.feature {
            Feature::Side(_) => self.normal_half,
            Feature::Corner(_) => self.normal_half + self.half / radius,
        }
    }

    /// Two cells, divided where it moves a part of this size most.
    fn halves(&self, radius: f64, size: f64) -> [Self; 2] {
        let by_turn = (size + radius) * self.normal_half;
        if 2.0 * by_turn > self.reach(size + radius, radius) {
            let normal_half = 0.5 * self.normal_half;
            [-normal_half, normal_half].map(|by| Self { normal: self.normal + by, normal_half, ..*self })
        } else {
            let half = 0.5 * self.half;
            let moved = |by: f64| Place { along: self.place.along + by, ..self.place };
            [-half, half].map(|by| Self { place: moved(by), half, ..*self })
        }
    }
}

/// All that was felt.
struct Readings<'a> {
    task: &'a TouchTask,
    touches: &'a [FingerTouch],
    passed: &'a [Way],
    first_sigma: f64,
}

impl Readings<'_> {
    /// Whether no pose of a cell can be, with how far points move in it, also those `far` ones near which a way could meet the
    /// part, and how far it turns.
    fn exclude(&self, middle: &Middle, reach_at: &dyn Fn(Point2<f64>) -> f64, far: f64, turn: f64) -> bool {
        let to_part = middle.pose.isometry().inverse();
        let [low, high] = self.task.area;
        let beyond = middle.reach + TRUSTED_SD * self.first_sigma;
        let is_outside = |vertex: &Point2<f64>| {
            let at = middle.pose.isometry() * vertex;
            (low - at).max() > beyond || (at - high).max() > beyond
        };
        self.task.outline.vertices().iter().any(is_outside)
            || self.touches.iter().skip(1).any(|touch| {
                let off = TRUSTED_SD * touch.sigma.hypot(self.first_sigma) + reach_at(touch.centre);
                !self.can_touch(&to_part, middle.pose.theta, touch, off, turn)
            })
            || self.passed.iter().any(|way| {
                let reach = reach_at(way.from).max(reach_at(way.to)).min(far);
                let off = reach + way.slack + TRUSTED_SD * self.first_sigma;
                clearance(&self.task.outline, &to_part, way) < self.task.radius - off
            })
    }

    /// Whether the disk can touch where it did, distances being off by no more than `off` and turns by `turn`.
    fn can_touch(&self, to_part: &Isometry2<f64>, theta: f64, touch: &FingerTouch, off: f64, turn: f64) -> bool {
        let radius = self.task.radius;
        let at = to_part * touch.centre;
        let (mut least, mut inside, mut is_met) = (f64::INFINITY, false, false);
        // Rotating a corner's normal takes the disk along its arc by this much.
        let aside = turn + (off / radius).min(1.0).asin();
        for (start, end) in self.task.outline.edges() {
            inside ^= is_crossed_by_ray(at, start, end);
            let distance = distance_to_segment(at, start, end);
            least = least.min(distance);
            if is_met || (distance - radius).abs() > off {
                continue;
            }
            let (way, to) = ((end - start).normalize(), at - start);
            let along = to.dot(&way);
            let near = |normal: Vector2<f64>, slack: f64| {
                let angle = theta + normal.y.atan2(normal.x);
                wrap_angle(angle - touch.force_angle).abs() <= touch.half_width + slack
            };
            let beside = Vector2::new(way.y, -way.x);
            is_met = (-off..=(end - start).norm() + off).contains(&along) && near(beside, turn)
                || along <= off && near(to, aside)
                || along >= (end - start).norm() - off && near(at - end, aside);
        }
        is_met && if inside { -least } else { least } >= radius - off
    }
}
