//! The largest circle inside a region: the best place for a sampling point, as far as possible from every edge.
//!
//! Its centre is at the same distance from three things on the boundary, each a line or an inner corner (a vertex of
//! the region's medial axis, thesis §3.6). Regions have few of them, so all triples are tried: each has a closed form.
//! Larger regions are divided into squares until few things are near enough to matter in each, or until a square cannot
//! hold anything better ("poly­label" of Agafonkin 2016, with an exact end), so that long and thin regions take no
//! longer than others.
//!
//! Frames: the region's. Units: m. Errors: none; a region without room for any circle has none.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use nalgebra::{Point2, Vector2, Vector3};

use super::subdivision::Piece;

/// Relative error of a radius: a tenth of what is promised.
const RADIUS_TOLERANCE: f64 = 1e-7;

/// Lines and corners of which all triples are tried: more are divided first.
const SITES_MAX: usize = 12;

/// Squares to look at before the best found so far is taken; met only where rounding hides what is better.
const SQUARES_MAX: usize = 200_000;

/// Determinants of unit vectors below this are 0 up to rounding.
const PARALLEL: f64 = 1e-14;

/// A circle of the plane; of a plan's point, its radius is the point's clearance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Circle {
    /// Its centre, m.
    pub centre: Point2<f64>,
    /// Its radius, m.
    pub radius: f64,
}

/// The largest circle in a region that is given by its boundary, with the region to the left; within a millionth of its
/// radius.
#[must_use]
pub fn largest_circle(boundary: impl Iterator<Item = impl Iterator<Item = Piece>>) -> Option<Circle> {
    let room = Room::new(boundary)?;
    room.largest().map(|circle| Circle { centre: circle.centre + room.offset, ..circle })
}

/// The inside of a boundary.
struct Room {
    walls: Vec<Wall>,
    /// From coordinates here, which are small, to the caller's.
    offset: Vector2<f64>,
}

/// A straight piece of the boundary.
#[derive(Clone, Copy, Debug)]
struct Wall {
    start: Point2<f64>,
    end: Point2<f64>,
    line: Line,
    /// Whether the region turns round its end: an inner angle above 180°.
    corner_at_end: bool,
}

/// A line with the region at its positive side: distance = normal · p − offset.
#[derive(Clone, Copy, Debug)]
struct Line {
    normal: Vector2<f64>,
    offset: f64,
}

/// What a circle can touch.
#[derive(Clone, Copy, Debug)]
enum Site {
    Line(Line),
    Corner(Point2<f64>),
}

impl Room {
    fn new(boundary: impl Iterator<Item = impl Iterator<Item = Piece>>) -> Option<Self> {
        let mut boundary = boundary.map(Iterator::collect::<Vec<Piece>>).peekable();
        let offset = boundary.peek()?.first()?.start.coords;
        let walls = boundary.flat_map(|pieces| walls(&joined(&pieces), offset)).collect();
        Some(Self { walls, offset })
    }

    fn largest(&self) -> Option<Circle> {
        let mut best = None;
        let all: Vec<u32> = (0..u32::try_from(self.walls.len()).unwrap_or(u32::MAX)).collect();
        if !self.try_all(&all, &mut best) {
            self.divide(all, &mut best);
        }
        best
    }

    /// Tries the circles that touch three of these walls or their corners; refuses where they are too many.
    fn try_all(&self, walls: &[u32], best: &mut Option<Circle>) -> bool {
        let mut sites = Vec::with_capacity(SITES_MAX + 1);
        for &wall in walls {
            let wall = &self.walls[wall as usize];
            sites.push(Site::Line(wall.line));
            sites.extend(wall.corner_at_end.then_some(Site::Corner(wall.end)));
            if sites.len() > SITES_MAX {
                return false;
            }
        }
        for (i, a) in sites.iter().enumerate() {
            for (j, b) in sites.iter().enumerate().take(i) {
                for c in &sites[..j] {
                    touching([a, b, c]).into_iter().flatten().for_each(|circle| self.improve(best, circle));
                }
            }
        }
        true
    }

    /// Takes a circle if it is the best so far and really fits.
    fn improve(&self, best: &mut Option<Circle>, circle: Circle) {
        let known = best.map_or(0.0, |best| best.radius);
        // Written so that NaN fails. What it touches was computed with rounding, so its radius is measured anew.
        if circle.radius > known {
            let radius = self.clearance(circle.centre);
            if radius > known {
                *best = Some(Circle { radius, ..circle });
            }
        }
    }

    /// The distance to the nearest wall, negative outside.
    fn clearance(&self, p: Point2<f64>) -> f64 {
        let distance = self.walls.iter().map(|wall| wall.distance_squared(p)).fold(f64::INFINITY, f64::min).sqrt();
        if self.holds(p) { distance } else { -distance }
    }

    fn holds(&self, p: Point2<f64>) -> bool {
        let crossed = self.walls.iter().filter(|wall| {
            let Wall { start, end, .. } = wall;
            (start.y > p.y) != (end.y > p.y) && ((end - start).perp(&(p - start)) > 0.0) == (end.y > start.y)
        });
        crossed.count() % 2 == 1
    }

    /// Divides the plane into squares, best first.
    fn divide(&self, all: Vec<u32>, best: &mut Option<Circle>) {
        let ends = || self.walls.iter().map(|wall| wall.start);
        let (low, high) =
            ends().fold((self.walls[0].start, self.walls[0].start), |(low, high), p| (low.inf(&p), high.sup(&p)));
        let half = (high - low).max() / 2.0;
        let mut squares = BinaryHeap::from([self.square(nalgebra::center(&low, &high), half, all)]);
        for _ in 0..SQUARES_MAX {
            let Some(square) = squares.pop() else { return };
            let known = best.map_or(0.0, |best| best.radius);
            if square.bound <= known * (1.0 + RADIUS_TOLERANCE) {
                return;
            }
            if square.clearance > known {
                *best = Some(Circle { centre: square.centre, radius: square.clearance });
            }
            if !self.try_all(&square.walls, best) {
                squares.extend(self.quarters(&square));
            }
        }
    }

    fn quarters(&self, square: &Square) -> [Square; 4] {
        let half = square.half / 2.0;
        [[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]].map(|corner| {
            let centre = square.centre + half * Vector2::from(corner);
            self.square(centre, half, square.walls.clone())
        })
    }

    /// A square with the walls, out of these, that can be nearest to a point in it.
    fn square(&self, centre: Point2<f64>, half: f64, mut walls: Vec<u32>) -> Square {
        let distance = |wall: u32| self.walls[wall as usize].distance_squared(centre).sqrt();
        let nearest = walls.iter().map(|&wall| distance(wall)).fold(f64::INFINITY, f64::min);
        let reach = half * std::f64::consts::SQRT_2;
        walls.retain(|&wall| distance(wall) <= (nearest + 2.0 * reach) * (1.0 + RADIUS_TOLERANCE));
        let clearance = if self.holds(centre) { nearest } else { -nearest };
        Square { centre, half, clearance, bound: clearance + reach, walls }
    }
}

/// A square of the plane.
struct Square {
    centre: Point2<f64>,
    half: f64,
    /// Distance of its centre from the nearest edge, m.
    clearance: f64,
    /// No point in it has a larger clearance.
    bound: f64,
    walls: Vec<u32>,
}

impl PartialEq for Square {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Square {}

impl PartialOrd for Square {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for Square {
    fn cmp(&self, other: &Self) -> Ordering {
        self.bound.total_cmp(&other.bound)
    }
}

/// Pieces of one line that follow each other, as one.
fn joined(pieces: &[Piece]) -> Vec<Piece> {
    let mut joined: Vec<Piece> = Vec::with_capacity(pieces.len());
    for piece in pieces {
        match joined.last_mut() {
            Some(last) if last.along == piece.along && last.through == piece.through => last.end = piece.end,
            _ => joined.push(*piece),
        }
    }
    joined
}

fn walls(pieces: &[Piece], offset: Vector2<f64>) -> Vec<Wall> {
    let next = pieces.iter().cycle().skip(1);
    let wall = |(piece, next): (&Piece, &Piece)| {
        let along = piece.along.normalize();
        let normal = Vector2::new(-along.y, along.x);
        let line = Line { normal, offset: normal.dot(&(piece.through - offset).coords) };
        let corner_at_end = piece.along.perp(&next.along) < 0.0;
        Wall { start: piece.start - offset, end: piece.end - offset, line, corner_at_end }
    };
    pieces.iter().zip(next).map(wall).collect()
}

impl Wall {
    fn distance_squared(&self, p: Point2<f64>) -> f64 {
        let along = self.end - self.start;
        let share = (p - self.start).dot(&along) / along.norm_squared();
        match share {
            share if share >= 1.0 => (p - self.end).norm_squared(),
            share if share > 0.0 => (self.line.normal.dot(&p.coords) - self.line.offset).powi(2),
            _ => (p - self.start).norm_squared(),
        }
    }
}

/// A plane in the space of circles (x, y, radius): `normal · circle = offset`.
type Plane = (Vector3<f64>, f64);

/// The circles that touch three sites, seen from the region's side of the lines.
///
/// In the space of circles those that touch a line are a plane, those through a point a cone, and those through two
/// points lie on a plane. So there are two planes in every case, and their line of intersection meets the third
/// surface.
fn touching(sites: [&Site; 3]) -> [Option<Circle>; 2] {
    let mut lines = sites.iter().filter_map(|site| if let Site::Line(line) = site { Some(line.plane()) } else { None });
    let mut corners = sites.iter().filter_map(|site| if let Site::Corner(point) = site { Some(*point) } else { None });
    match [corners.next(), corners.next(), corners.next()] {
        [None, ..] => match [lines.next(), lines.next(), lines.next()] {
            [Some(a), Some(b), Some(c)] => [meet_plane(Track::of(a, b), c), None],
            _ => [None; 2],
        },
        [Some(p), None, _] => match [lines.next(), lines.next()] {
            [Some(a), Some(b)] => meet_cone(Track::of(a, b), p),
            _ => [None; 2],
        },
        [Some(p), Some(q), None] => lines.next().map_or([None; 2], |a| meet_cone(Track::of(a, between(p, q)), p)),
        [Some(p), Some(q), Some(r)] => meet_cone(Track::of(between(p, q), between(p, r)), p),
    }
}

impl Line {
    fn plane(self) -> Plane {
        (Vector3::new(self.normal.x, self.normal.y, -1.0), self.offset)
    }
}

/// The circles with centres as far from one point as from another.
fn between(p: Point2<f64>, q: Point2<f64>) -> Plane {
    let across = (q - p).normalize();
    (Vector3::new(across.x, across.y, 0.0), across.dot(&nalgebra::center(&p, &q).coords))
}

/// A line in the space of circles.
struct Track {
    from: Vector3<f64>,
    along: Vector3<f64>,
}

impl Track {
    /// Where two planes meet.
    fn of((n, c): Plane, (m, d): Plane) -> Option<Self> {
        let along = n.cross(&m);
        let squared = along.norm_squared();
        if squared < PARALLEL * PARALLEL {
            return None;
        }
        let from = (c * m.cross(&along) + d * along.cross(&n)) / squared;
        Some(Self { from, along: along / squared.sqrt() })
    }

    fn at(&self, t: f64) -> Circle {
        let place = self.from + t * self.along;
        Circle { centre: Point2::new(place.x, place.y), radius: place.z }
    }
}

fn meet_plane(track: Option<Track>, (normal, offset): Plane) -> Option<Circle> {
    let track = track?;
    let over = normal.dot(&track.along);
    (over.abs() > PARALLEL).then(|| track.at((offset - normal.dot(&track.from)) / over))
}

/// Where a track meets the circles through a point: |centre − point|² = radius².
fn meet_cone(track: Option<Track>, point: Point2<f64>) -> [Option<Circle>; 2] {
    let Some(track) = track else { return [None; 2] };
    let metric = Vector3::new(1.0, 1.0, -1.0);
    let from = track.from - Vector3::new(point.x, point.y, 0.0);
    let product = |a: &Vector3<f64>, b: &Vector3<f64>| a.component_mul(&metric).dot(b);
    let (a, b, c) = (product(&track.along, &track.along), product(&track.along, &from), product(&from, &from));
    let root = (b * b - a * c).max(0.0).sqrt();
    // The form that loses no digits, and that has one root at least where a is 0.
    let q = -(b + root.copysign(b));
    [q / a, c / q].map(|t| t.is_finite().then(|| track.at(t)))
}

#[cfg(test)]
mod tests {
    use nalgebra::Isometry2;
    use proptest::prelude::*;

    use super::*;
    use crate::geometry::bounding_box;

    fn outline(points: &[Point2<f64>]) -> Vec<Piece> {
        let next = points.iter().cycle().skip(1);
        points.iter().zip(next).map(|(&start, &end)| Piece { start, end, along: end - start, through: start }).collect()
    }

    fn largest(loops: &[&[Point2<f64>]]) -> Circle {
        largest_circle(loops.iter().map(|points| outline(points).into_iter())).unwrap()
    }

    /// Clearance by sampling a fine grid: what any finer one could add is half its diagonal.
    fn by_grid(points: &[Point2<f64>], cells: u32) -> f64 {
        let room = Room::new(std::iter::once(outline(points).into_iter())).unwrap();
        let (low, high) = bounding_box(points);
        let step = (high - low) / f64::from(cells);
        let places = (0..=cells).flat_map(|i| (0..=cells).map(move |j| Vector2::new(f64::from(i), f64::from(j))));
        let clearances = places.map(|place| room.clearance(low + step.component_mul(&place) - room.offset));
        clearances.fold(0.0, f64::max)
    }

    #[test]
    fn simple_regions_have_their_known_circles() {
        let rectangle = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [0.0, 1.0]].map(Point2::from);
        assert!((largest(&[&rectangle]).radius - 0.5).abs() < 1e-12);
        let triangle = [[0.0, 0.0], [4.0, 0.0], [0.0, 3.0]].map(Point2::from);
        let circle = largest(&[&triangle]);
        assert!((circle.radius - 1.0).abs() < 1e-12 && (circle.centre - Point2::new(1.0, 1.0)).norm() < 1e-12);
        // Past the inner corner of an L: tangent to the two outer sides and through the corner (1, 1).
        let bracket = [[0.0, 0.0], [3.0, 0.0], [3.0, 1.0], [1.0, 1.0], [1.0, 3.0], [0.0, 3.0]].map(Point2::from);
        let radius = 2.0 - std::f64::consts::SQRT_2;
        assert!((largest(&[&bracket]).radius - radius).abs() < 1e-12);
        // A square ring: into a corner of it, outside the inner square.
        let outer = [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]].map(Point2::from);
        let inner = [[1.0, 1.0], [1.0, 3.0], [3.0, 3.0], [3.0, 1.0]].map(Point2::from);
        assert!((largest(&[&outer, &inner]).radius - radius).abs() < 1e-12);
    }

    #[test]
    fn a_round_region_and_a_long_arc_are_found_whatever_the_number_of_edges() {
        let ring = |radius: f64, count: u32| -> Vec<Point2<f64>> {
            let at = |i: u32| std::f64::consts::TAU * f64::from(i) / f64::from(count);
            (0..count).map(|i| Point2::new(radius * at(i).cos(), radius * at(i).sin())).collect()
        };
        let disk = ring(1.0, 500);
        let apothem = (std::f64::consts::PI / 500.0).cos();
        assert!((largest(&[&disk]).radius / apothem - 1.0).abs() < 1e-6);
        let hole: Vec<_> = ring(0.9, 400).into_iter().rev().collect();
        let radius = largest(&[&disk, &hole]).radius;
        assert!(radius > 0.0499 && radius < 0.0501, "{radius}");
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn no_grid_finds_a_larger_circle(radii in proptest::collection::vec(0.05..1.0_f64, 3..24), flatten in 1e-3..1.0_f64) {
            let count = f64::from(u32::try_from(radii.len()).unwrap());
            let at = |i: usize| std::f64::consts::TAU * f64::from(u32::try_from(i).unwrap()) / count;
            let star: Vec<_> = radii.iter().enumerate().map(|(i, r)| Point2::new(r * at(i).cos(), flatten * r * at(i).sin())).collect();
            prop_assume!(radii.len() > 3 || crate::geometry::SimplePolygon::new(star.clone()).is_ok());
            let found = largest(&[&star]).radius;
            let sampled = by_grid(&star, 60);
            prop_assert!(found >= sampled * (1.0 - 1e-9), "{} {}", found, sampled);
        }

        #[test]
        fn moving_and_scaling_a_region_moves_and_scales_its_circle(
            radii in proptest::collection::vec(0.2..1.0_f64, 4..20), scale in 1e-6..1e3_f64, angle in -3.0..3.0_f64, x in -5.0..5.0_f64,
        ) {
            let count = f64::from(u32::try_from(radii.len()).unwrap());
            let at = |i: usize| std::f64::consts::TAU * f64::from(u32::try_from(i).unwrap()) / count;
            let star: Vec<_> = radii.iter().enumerate().map(|(i, r)| Point2::new(r * at(i).cos(), r * at(i).sin())).collect();
            let motion = Isometry2::new(Vector2::new(x, 1.0), angle);
            let moved: Vec<_> = star.iter().map(|p| motion * (p * scale)).collect();
            let (before, after) = (largest(&[&star]), largest(&[&moved]));
            // The rounding of coordinates near 5 m counts where the region is micrometres across.
            let tolerance = 1e-6 + 1e-13 / (scale * before.radius);
            prop_assert!((after.radius / (scale * before.radius) - 1.0).abs() < tolerance, "{} {}", after.radius, scale * before.radius);
        }
    }
}
