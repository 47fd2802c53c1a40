//! Pieces of a drawing, joined end to end to one outline.
//!
//! Ends that are nearer to each other than a hundred-thousandth of the drawing are one: programs write five digits or more.

use std::collections::HashMap;

use nalgebra::Point2;
use palpate::geometry::curve::Chords;
use palpate::geometry::mesh::signed_area;
use palpate::geometry::{PolygonError, SimplePolygon, bounding_box};

use super::error::{Place, ShapeError, check_size};
use super::{Drawn, Request, VERTICES_MAX};

/// Ends so near to each other, as a share of the drawing's longer side, are one.
const JOINED_RELATIVE: f64 = 1e-5;

/// A line from point to point, in the unit of the file.
pub(super) struct Piece {
    pub(super) chords: Chords,
    pub(super) place: Place,
}

/// A closed line, with the piece that each of its edges is of.
struct Loop {
    points: Vec<Point2<f64>>,
    pieces: Vec<usize>,
}

/// The outline that pieces make; their unit is so many metres.
pub(super) fn outline(
    pieces: &[Piece],
    metres: f64,
    request: &Request,
    layers: &[String],
) -> Result<Drawn, ShapeError> {
    let count: usize = pieces.iter().map(|piece| piece.chords.points.len()).sum();
    let nothing = || ShapeError::Nothing { layer: request.layer.clone(), layers: layers.to_vec() };
    if count == 0 {
        return Err(nothing());
    }
    if count > 4 * VERTICES_MAX {
        return Err(ShapeError::TooManyVertices { count });
    }
    let all: Vec<_> = pieces.iter().flat_map(|piece| piece.chords.points.iter().copied()).collect();
    let (low, high) = bounding_box(&all);
    let extent = (high - low).amax();
    check_size(extent * metres)?;
    let near = JOINED_RELATIVE * extent;
    let loops = loops(pieces, near)?;
    let area = |index: &usize| signed_area(&loops[*index].points).abs();
    let largest = (0..loops.len()).max_by(|a, b| area(a).total_cmp(&area(b))).ok_or_else(nothing)?;
    let told = |index: usize| pieces[loops[index].pieces[0]].place.to_string();
    let encloses = |index: &usize| contains(&loops[largest].points, loops[*index].points[0]);
    let others = || (0..loops.len()).filter(|index| *index != largest);
    if let Some(second) = others().find(|index| !encloses(index)) {
        let count = 1 + others().filter(|index| !encloses(index)).count();
        return Err(ShapeError::Several { count, first: told(largest), second: told(second), is_solid: false });
    }
    if let (Some(hole), false) = (others().next(), request.fills_holes) {
        return Err(ShapeError::Hole { place: told(hole), of: Some(told(largest)) });
    }
    polygon(&loops[largest], pieces, metres)
}

/// The loop as a polygon, counter-clockwise.
fn polygon(found: &Loop, pieces: &[Piece], metres: f64) -> Result<Drawn, ShapeError> {
    let Loop { points, pieces: of } = found;
    if points.len() > VERTICES_MAX {
        return Err(ShapeError::TooManyVertices { count: points.len() });
    }
    let is_clockwise = signed_area(points) < 0.0;
    let mut vertices: Vec<_> = points.iter().map(|point| point * metres).collect();
    let n = vertices.len();
    if is_clockwise {
        vertices.reverse();
    }
    let outline = SimplePolygon::new(vertices).map_err(|error| {
        // Edge i of the reversed outline is the one that went from n − 2 − i.
        let piece = |edge: usize| of[if is_clockwise { (2 * n - 2 - edge) % n } else { edge }];
        let edges = match error {
            PolygonError::Crossing { first, second } => {
                Some([first, second].map(|edge| pieces[piece(edge)].place.to_string()).into())
            }
            _ => None,
        };
        ShapeError::Outline { place: pieces[of[0]].place.to_string(), error, edges }
    })?;
    let error = of.iter().map(|piece| pieces[*piece].chords.error).fold(0.0, f64::max) * metres;
    Ok(Drawn { outline, error, solid: None })
}

/// All pieces as closed lines.
fn loops(pieces: &[Piece], near: f64) -> Result<Vec<Loop>, ShapeError> {
    let ends = |piece: usize| {
        let points = &pieces[piece].chords.points;
        [points[0], points[points.len() - 1]]
    };
    let partners = partners(pieces, &ends, near)?;
    let mut is_used = vec![false; pieces.len()];
    let mut loops = Vec::new();
    for first in 0..pieces.len() {
        if is_used[first] {
            continue;
        }
        let mut found = Loop { points: Vec::new(), pieces: Vec::new() };
        // Into the piece by this end of it.
        let (mut piece, mut end) = (first, 0);
        while !is_used[piece] {
            is_used[piece] = true;
            let points = &pieces[piece].chords.points;
            let mut add = |point: &Point2<f64>| {
                if found.points.last().is_none_or(|last| (point - last).norm() > near) {
                    found.points.push(*point);
                    found.pieces.push(piece);
                } else if let Some(of) = found.pieces.last_mut() {
                    // The edge from here on is this piece's.
                    *of = piece;
                }
            };
            if end == 0 {
                points.iter().for_each(&mut add)
            } else {
                points.iter().rev().for_each(&mut add)
            }
            (piece, end) = partners[piece][1 - end];
        }
        while found.points.len() > 1 && (found.points[found.points.len() - 1] - found.points[0]).norm() <= near {
            found.points.pop();
            found.pieces.pop();
        }
        if found.points.len() < 3 {
            let place = pieces[first].place.clone();
            return Err(ShapeError::Entity { place, problem: "it encloses nothing: delete it".to_owned() });
        }
        loops.push(found);
    }
    Ok(loops)
}

/// For both ends of each piece, the piece and its end that go on there.
fn partners(
    pieces: &[Piece],
    ends: &dyn Fn(usize) -> [Point2<f64>; 2],
    near: f64,
) -> Result<Vec<[(usize, usize); 2]>, ShapeError> {
    let side = if near > 0.0 { near } else { 1.0 };
    #[expect(clippy::cast_possible_truncation, reason = "the drawing is a hundred thousand cells across")]
    let cell = |point: Point2<f64>| ((point.x / side).floor() as i64, (point.y / side).floor() as i64);
    let mut cells: HashMap<(i64, i64), Vec<(usize, usize)>> = HashMap::new();
    for piece in 0..pieces.len() {
        for (end, at) in ends(piece).into_iter().enumerate() {
            cells.entry(cell(at)).or_default().push((piece, end));
        }
    }
    let partner = |piece: usize, end: usize| {
        let at = ends(piece)[end];
        let (x, y) = cell(at);
        let mut there = Vec::new();
        for neighbour in (-1..=1).flat_map(|i| (-1..=1).map(move |j| (x.saturating_add(i), y.saturating_add(j)))) {
            for &(other, other_end) in cells.get(&neighbour).into_iter().flatten() {
                let is_self = (other, other_end) == (piece, end);
                if !is_self && (ends(other)[other_end] - at).norm() <= near {
                    there.push((other, other_end));
                    if let [(second, _), (third, _)] = there[..] {
                        let meeting = [piece, second, third].map(|piece| pieces[piece].place.clone());
                        return Err(ShapeError::Fork { pieces: Box::new(meeting), at: at.into() });
                    }
                }
            }
        }
        there.first().copied().ok_or_else(|| {
            let others =
                (0..pieces.len()).flat_map(|other| [(other, 0), (other, 1)]).filter(|other| *other != (piece, end));
            let gap = |(other, end): (usize, usize)| (ends(other)[end] - at).norm();
            let nearest = others.map(|other| (pieces[other.0].place.clone(), gap(other)));
            let nearest = nearest.min_by(|a, b| a.1.total_cmp(&b.1));
            ShapeError::Open { place: pieces[piece].place.clone(), at: at.into(), nearest: nearest.map(Box::new) }
        })
    };
    (0..pieces.len()).map(|piece| Ok([partner(piece, 0)?, partner(piece, 1)?])).collect()
}

/// Whether a point is within an outline, by how often a ray to the right crosses it.
pub(super) fn contains(outline: &[Point2<f64>], point: Point2<f64>) -> bool {
    let next = outline.iter().cycle().skip(1);
    let crossings = outline.iter().zip(next).filter(|(a, b)| {
        (a.y > point.y) != (b.y > point.y) && point.x < a.x + (b.x - a.x) * (point.y - a.y) / (b.y - a.y)
    });
    crossings.count() % 2 == 1
}
